"""The search for an optimal curve that is interrupted: what it returns, and that it goes on from its file."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from concurrent.futures import Executor, Future
from dataclasses import replace

import numpy as np
import pytest

import bdamper as bd
from bdamper.response.events import ContinuationOptions
from bdamper.response.highest_peak import AtPreload
from bdamper.response.optimal_curve import at_preload, optimal_curve
from bdamper.response.response_curve import without_points
from bdamper.util.display import Fact
from bdamper.util.progress import Cost
from bdamper.util.storage import json_line

ASKED = {"preload": (20.0, 10e3), "n": 8, "frequency": (250.0, 400.0)}


def new_study(**settings):
    model = bd.reference_model(contact_points=9)
    scene = {
        "engine_order": 5, "friction_coefficient": 0.3, "contact_stiffness": "unit_traction", "harmonics": 1,
        "blade_modes": 10,
    }  # fmt: skip
    return bd.Study(model, excitation=bd.Excitation("tip"), **scene | settings)


class Here(Executor):
    """Does what is submitted at once; Ctrl-C comes in a call of this number."""

    def __init__(self, at=0):
        self.calls, self.at = 0, at

    def submit(self, function, *args):
        self.calls += 1
        if self.calls == self.at:
            raise KeyboardInterrupt
        out = Future()
        out.set_result(function(*args))
        return out


@pytest.fixture(scope="module")
def whole():
    """With an optimum between preloads."""
    curve = optimal_curve(new_study().problem, **ASKED)
    assert (
        curve.ok
        and curve.complete
        and curve.optimum.ok
        and len(curve.curves) == len(curve) > ASKED["n"]
    )
    return curve


def same(a, b):
    assert str(a.optimum) == str(b.optimum) and a.status == b.status
    np.testing.assert_array_equal(a.amplitude, b.amplitude)
    np.testing.assert_array_equal(a.unknowns, b.unknowns)
    np.testing.assert_array_equal(a.goes_on, b.goes_on)
    assert [len(c) for c in a.curves] == [len(c) for c in b.curves]


@pytest.mark.slow
def test_goes_on_from_any_curve_with_the_same_result(whole, tmp_path):
    path, kept = tmp_path / "search.jsonl", []
    for _ in range(20):
        try:
            # three curves more each time
            curve = optimal_curve(new_study().problem, **ASKED, resume=path, executor=Here(4))
        except KeyboardInterrupt:
            continue
        kept.append(len(path.read_text().splitlines()) - 1)
        if not curve.interrupted:
            break
        assert Fact("optimum", "not located, interrupted: by the user") in curve._facts()
    assert kept[:2] == [3, 6] and kept[-1] == len(whole.curves)
    same(curve, whole)
    executor = Here()
    same(optimal_curve(new_study().problem, **ASKED, resume=path, executor=executor), whole)
    assert executor.calls == 0


def test_interrupted_before_anything_is_known():
    with pytest.raises(KeyboardInterrupt):
        optimal_curve(new_study().problem, **ASKED, executor=Here(1))


@pytest.mark.slow
def test_an_interrupted_curve_has_the_values_that_were_finished(whole, tmp_path):
    curve = optimal_curve(new_study().problem, **ASKED, executor=Here(4))
    known = np.isfinite(curve.amplitude)
    assert known.tolist() == [False] * 5 + [True] * 3  # from the highest preload down
    np.testing.assert_array_equal(curve.amplitude[known], whole.amplitude[whole.requested][known])
    assert (
        set(np.array(curve.status_text)[~known]) == {"not found: no curve was followed"}
        and not curve.complete
    )
    assert curve.interrupted and curve.optimum.kind == "unknown"
    assert curve.optimum.amplitude == np.nanmin(curve.amplitude) and not curve.optimum.ok
    curve.save(tmp_path / "part.h5")
    assert bd.load(tmp_path / "part.h5").interrupted


def test_what_is_kept_is_what_was_found():
    study = new_study()
    there = at_preload(study.problem, 300.0, (250.0, 400.0))
    again = AtPreload.of(json.loads(json_line(there.record())))
    assert (again.value, again.slope, again.ending) == (there.value, there.slope, there.ending)
    for name in (
        "frequency",
        "amplitude",
        "shares",
        "branch",
        "point_kind",
        "missing_ranges",
        "settings",
    ):
        assert np.array_equal(getattr(again.curve, name), getattr(there.curve, name)), name
    assert np.array_equal(again.top.peak.y, there.top.peak.y) and again.top.kind == there.top.kind
    assert json.loads(json_line(again.record())) == json.loads(json_line(there.record()))


def test_a_curve_without_points_keeps_its_shape():
    curve = without_points(new_study().problem, 300.0, "failed", ContinuationOptions(), Cost())
    light = replace(curve, harmonics=curve.harmonics[:, :2])
    again = AtPreload.of(
        json.loads(json_line(AtPreload(300.0, light, None, np.nan, "", Cost()).record()))
    ).curve
    assert (
        again.amplitude.shape == (0,)
        and again.shares.shape == (0, 3)
        and list(again.columns()) == list(light.columns())
    )


def test_a_file_of_another_search_is_refused(tmp_path):
    path, asked = (
        tmp_path / "search.jsonl",
        {"preload": (2e3, 4e3), "n": 2, "frequency": (250.0, 400.0)},
    )
    study = new_study()
    optimal_curve(study.problem, **asked, resume=path)
    for other, changes, what in (
        (study.replace(friction_coefficient=0.4), {}, "study"),
        (study, {"n": 3}, "preload"),
        (study, {"frequency": (250.0, 390.0)}, "frequency"),
        (study, {"options": bd.PeakOptions(max_trials=30)}, "options"),
    ):
        with pytest.raises(bd.BdamperError, match=f"results of different settings: {what}"):
            optimal_curve(other.problem, **asked | changes, resume=path)


def test_progress_tells_what_is_done(capsys, monkeypatch):
    monkeypatch.setattr("bdamper.util.progress.FIRST_LINE", 0.0)
    optimal_curve(new_study().problem, (2e3, 4e3), 3, frequency=(250.0, 400.0), progress=True)
    shown = capsys.readouterr().err
    told = [int(share) for share in re.findall(r"^optimal curve: \d{4} N: +(\d+) %$", shown, re.M)]
    assert len(told) >= 2 and told == sorted(told), shown


SCRIPT = """
import json, sys
import bdamper as bd
study = bd.Study(bd.reference_model(), bd.Excitation("tip"), 5, contact_stiffness="unit_traction", harmonics=3)
print("begins", flush=True)
curve = study.optimal_curve((50.0, 5e3), 20, frequency=(250.0, 400.0), resume=sys.argv[1])
print(json.dumps([curve.interrupted, curve.convergence is None]))
"""


@pytest.mark.slow
@pytest.mark.usefixtures("interruptible")
def test_a_signal(tmp_path):
    child = subprocess.Popen(
        [sys.executable, "-c", SCRIPT, tmp_path / "search.jsonl"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert child.stdout.readline() == "begins\n"
    while (
        not (tmp_path / "search.jsonl").exists()
        or b'"index"' not in (tmp_path / "search.jsonl").read_bytes()
    ):
        time.sleep(0.1)
    os.kill(child.pid, signal.SIGINT)
    out, err = child.communicate(timeout=120)
    assert json.loads(out) == [True, True], err
