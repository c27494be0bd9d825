"""Tests come to an end: each has a time limit, and interruptions arrive where the shell that began them ignores SIGINT."""

import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]

HANGING = """
import time
import pytest
from hypothesis import given, strategies

def test_hangs():
    time.sleep(600.0)

@given(strategies.integers())
def test_draws_and_hangs(number):
    time.sleep(600.0)
"""


def run(*arguments, **ways):
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *arguments]
    return subprocess.run(
        command, cwd=ROOT, capture_output=True, text=True, timeout=240, check=False, **ways
    ).stdout


@pytest.mark.parametrize("test", ["test_hangs", "test_draws_and_hangs"])
@pytest.mark.slow
def test_what_hangs_is_ended(tmp_path, test):
    """With the settings and the hooks of the project, also where examples are drawn, which a failure would draw again."""
    (tmp_path / "test_it.py").write_text(HANGING)
    project = "-c", str(ROOT / "pyproject.toml"), "-p", "tests.conftest"
    found = run(*project, "-o", "timeout=1", f"{tmp_path}/test_it.py::{test}")
    assert "Timeout" in found and "test_it.py" in found


def test_every_test_has_a_limit(pytestconfig, request):
    assert float(pytestconfig.getini("timeout")) == 300.0
    for item in request.session.items:
        if marks := [
            mark for mark in item.iter_markers("timeout") if "timeout" in mark.kwargs or mark.args
        ]:
            assert (marks[0].args or [marks[0].kwargs["timeout"]])[0] >= 300


@pytest.mark.parametrize(
    "test",
    [
        "hard/test_branches.py::test_ctrl_c_ends_an_optimal_curve_whose_threads_are_at_work[30]",
        "response/test_interrupted.py::test_a_signal",
        "analyses/test_sweep.py::TestInterrupted::test_a_signal_to_all_processes",
    ],
)
@pytest.mark.slow
def test_interruptions_arrive_where_the_shell_ignores_them(test):
    """As for a job in the background (``&``), which inherits a SIGINT that is ignored."""
    found = run(f"tests/{test}", preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_IGN))
    assert re.search(r"^[1-9] passed", found, re.M), found
