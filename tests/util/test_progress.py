"""Progress of long work: what is shown, that it changes no result, and that Ctrl-C keeps what is kept without it."""

import re
import subprocess
import sys
from dataclasses import fields
from itertools import count
from types import SimpleNamespace

import numpy as np
import pytest

from bdamper.mistuning import BladedDisk, DiskPeakOptions, Mistuning
from bdamper.util import progress
from bdamper.util.progress import Cost, progress_stages, with_progress
from tests.each import each
from tests.every_result import BAND, result
from tests.golden.scenes import turning
from tests.mistuning.lumped import lumped_study
from tests.util.test_disk import pressed

WORK = {
    "peak": (lambda: pressed().peak, (2.0, BAND), "response curve"),
    "time_response": (lambda: pressed().time_response, lambda: (result("peak"),), "time integration at "),
    "effect_significance": (lambda: pressed().effect_significance, (2.0, BAND), "effect significance: without "),
    "harmonic_convergence": (lambda: pressed().harmonic_convergence, lambda: (result("peak"),), "harmonic convergence: "),
    "nonlinear_mode": (lambda: pressed().nonlinear_mode, (2.0, 1, (1e-3, 10.0)), "nonlinear mode"),
    "flutter": (lambda: pressed().flutter, ((1.0, 2.0), -0.01), "flutter: 2 N"),
    "run_up": (lambda: turning().run_up, ((420.0, 465.0),), "run-up"),
    "peak of a disk": (
        lambda: BladedDisk(lumped_study(), Mistuning.random(6, 0.02, seed=1)).peak, (300.0,), "bladed disk: sweep",
    ),
}  # fmt: skip
OPTIONS = {"peak of a disk": {"options": DiskPeakOptions(climbs=2, least=20)}, "flutter": {"n": 2}}


def given_to(name):
    given = WORK[name][1]
    return given() if callable(given) else given


def done(name, **options):
    work = WORK[name][0]()
    return work(*given_to(name), **OPTIONS.get(name, {}), **options)


class Bar:
    """Progress bar that notes what it is told; Ctrl-C comes with an update of this number."""

    def __init__(self, told, at, items, text):
        self.told, self.at, self.items, self.text = told, at, items, text
        self.n, self.total, self.ended = 0, len(items), False

    def __iter__(self):
        for item in self.items:
            self.set_description(self.text)
            yield item
            self.update(1)

    def __enter__(self):
        return self

    def __exit__(self, *error):
        return None

    def set_description(self, text, refresh=True):
        self.told.append(text)
        if len(self.told) == self.at:
            raise KeyboardInterrupt

    def update(self, more):
        self.n += more
        self.ended = self.n == self.total


def bars(monkeypatch, at=0):
    """Return the bars that are made from now on, and the texts that they show."""
    made, told = [], []

    def bar(items=(), desc="", **given):
        made.append(Bar(told, at, items, desc))
        return made[-1]

    monkeypatch.setattr(progress, "_bar", bar)
    return made, told


def same(a, b):
    for f in fields(a):
        x, y = getattr(a, f.name), getattr(b, f.name)
        if isinstance(x, np.ndarray):
            np.testing.assert_array_equal(x, y, err_msg=f.name)
        elif not isinstance(x, Cost):
            assert re.sub(r"seconds=[^,)]*", "", str(x)) == re.sub(r"seconds=[^,)]*", "", str(y)), (
                f.name
            )


@pytest.mark.slow
@each("name", WORK)
def test_long_work_reports_and_ends_at_its_total_with_the_same_result(name, monkeypatch):
    plain = done(name)
    made, told = bars(monkeypatch)
    shown = done(name, progress=True)
    assert any(text.startswith(WORK[name][2]) for text in told), told
    assert made and all(bar.ended for bar in made)
    same(plain, shown)


KEPT = {"time_response": "interrupted", "harmonic_convergence": "interrupted"}
"""Analyses that return what they have computed."""


@each("name", WORK)
def test_ctrl_c_in_a_report(name, monkeypatch):
    given_to(name)  # computed and kept, so that Ctrl-C comes in the work itself
    made, _ = bars(monkeypatch, at=2)
    if name in KEPT:
        found = done(name, progress=True)
        assert found.status.startswith(KEPT[name])
        # a search in time keeps its motion and closes its own bar
        assert name == "time_response" or not made[0].ended
        return
    with pytest.raises(KeyboardInterrupt):
        done(name, progress=True)


def test_work_without_parts_or_with_fewer_than_expected(capsys, monkeypatch):
    monkeypatch.setattr(progress, "FIRST_LINE", 0.0)
    with progress_stages(True, "work", "part"):
        pass
    assert capsys.readouterr().err == ""
    with progress_stages(True, "work", "part") as report:
        report("first", 1, 10)
    assert capsys.readouterr().err == "work: first: 0 %\nwork: first: 10 %\nwork: 100 %\n"
    assert list(with_progress([1, 2], True, "work", "part")) == [1, 2]
    assert capsys.readouterr().err == "work: 0 %\nwork: 50 %\nwork: 100 %\n"


def test_a_batch_job_has_lines_after_ten_seconds_unless_they_are_off(capsys, monkeypatch):
    """Twenty steps of 0.9 s: the first line at the twelfth, then one at each tenth."""
    for asked, expected in ((None, ["50", "60", "70", "80", "90"]), (False, [])):
        clock = count(0.0, 0.9)
        monkeypatch.setattr(progress, "time", SimpleNamespace(monotonic=lambda: next(clock)))
        for _ in with_progress(range(20), progress.shows_progress(asked), "work", "part"):
            pass
        lines = capsys.readouterr().err.splitlines()
        told = [line.removeprefix("work: ").split(" %")[0] for line in lines]
        assert [tenth for tenth in told if tenth != "100"] == expected


def test_where_there_is_no_terminal_a_line_comes_every_half_minute(capsys, monkeypatch):
    clock = count(0.0, 11.0)
    monkeypatch.setattr(progress, "time", SimpleNamespace(monotonic=lambda: next(clock)))
    with progress_stages(True, "work", "part") as report:
        for stage in "abcdefgh":
            report(stage, 0, 10)
    lines = capsys.readouterr().err.splitlines()
    assert (
        lines[-1] == "work: 100 %"
        and 2 <= len(lines) - 1 <= 4
        and all(line.endswith(": 0 %") for line in lines[:-1])
    )


def test_the_share_only_rises_when_more_parts_are_found():
    """After 5 of 10 parts there are 20: each of the 15 that are left is a thirtieth of the whole."""
    share = progress._RisingShare()
    assert share.after(5, 10) == pytest.approx(0.5)
    assert share.after(5, 20) == pytest.approx(0.5)
    assert share.after(8, 20) == pytest.approx(0.5 + 3.0 / 30.0)
    assert share.after(2, 12) == pytest.approx(0.6), "a smaller number is an earlier one"
    assert share.after(20, 20) == pytest.approx(1.0)


def test_lines_never_fall_and_name_the_seconds_that_are_left(capsys, monkeypatch):
    """Ten seconds for each of 10, then 20 parts: 30 % after 30 s, so 70 s are left."""
    clock = SimpleNamespace(now=0.0)
    monkeypatch.setattr(progress, "time", SimpleNamespace(monotonic=lambda: clock.now))
    with progress_stages(True, "work", "part") as report:
        for done in range(1, 20):
            clock.now += 10.0
            report("", done, 10 if done < 6 else 20)
    lines = capsys.readouterr().err.splitlines()
    percent = [int(line.split()[1]) for line in lines]
    assert percent == sorted(percent) and percent[-1] == 100
    assert "work: 30 %, about 70 s left" in lines


def test_a_curve_reports_each_point_once(monkeypatch):
    made, told = bars(monkeypatch)
    curve = pressed().frequency_response(2.0, BAND, progress=True)
    assert len(made) == 1 and len(told) <= len(curve) + 1


KILLED_WITH_THE_LOCK = """
import os, signal
from tqdm import tqdm
from bdamper.util.progress import with_progress

tqdm.get_lock()
child = os.fork()
if child == 0:
    tqdm.get_lock().acquire()
    os.kill(os.getpid(), signal.SIGKILL)
os.waitpid(child, 0)
print(sum(with_progress(range(4), True, "work", "part")))
"""


def test_a_process_that_was_killed_while_it_drew_stops_no_other():
    """Forked processes share the lock of tqdm, and the operating system does not release it."""
    done = subprocess.run(
        [sys.executable, "-c", KILLED_WITH_THE_LOCK], capture_output=True, text=True, timeout=60
    )
    assert done.stdout == "6\n", done.stderr
