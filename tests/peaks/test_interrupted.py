"""The search for an optimal curve that is interrupted: what it returns, and that it goes on from its file."""

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace

import numpy as np
import pytest

import bdamper as bd
from bdamper.peaks import envelope
from bdamper.peaks.envelope import Branch, PeakEnvelope
from bdamper.peaks.newton import PeakOptions
from bdamper.peaks.optimal import optimal_curve
from bdamper.util.cost import CostMeter

ASKED = {"preload": (20.0, 10e3), "n": 12, "frequency": (250.0, 400.0)}


def new_study(**settings):
    model = bd.reference_model(contact_points=9)
    scene = {
        "engine_order": 5, "friction_coefficient": 0.3, "contact_stiffness": "unit_traction", "harmonics": 1,
        "blade_modes": 10,
    }  # fmt: skip
    return bd.Study(model, excitation=bd.Excitation("tip"), **scene | settings)


@pytest.fixture(scope="module")
def whole():
    """With a jump, and an optimum between preloads that a whole tracking curve verifies."""
    curve = optimal_curve(new_study(), **ASKED)
    assert curve.complete and curve.optimum.verified and sum("jump" in event for event in curve.events) == 1
    return curve


class Stop:
    """Ctrl-C in the n-th call of a method."""

    def __init__(self, monkeypatch, owner, name, at):
        self.calls = 0
        inner = getattr(owner, name)

        def call(*args, **keywords):
            self.calls += 1
            if self.calls == at:
                raise KeyboardInterrupt
            return inner(*args, **keywords)

        monkeypatch.setattr(owner, name, call)


def test_goes_on_from_every_scan_with_the_same_result(whole, monkeypatch, tmp_path):
    path, scans = tmp_path / "search.jsonl", []
    for _ in range(20):
        with monkeypatch.context() as patch:
            Stop(patch, PeakEnvelope, "_scan", 2)  # one scan more each time
            try:
                curve = optimal_curve(new_study(), **ASKED, resume=path)
            except KeyboardInterrupt:  # before the first peak
                continue
        scans.append(len(path.read_text().splitlines()) - 1)
        if not curve.interrupted:
            break
        assert curve.optimum.status == "not verified: interrupted by the user" and str(curve).count("interrupted") == 1
    assert scans[:-1] == list(range(1, len(scans))) and scans[-1] in (scans[-2], scans[-2] + 1) and len(scans) > 3
    for name in ("amplitude", "frequency", "unknowns", "branch", "peak_preload", "peak_amplitude", "peak_detached"):
        np.testing.assert_array_equal(getattr(curve, name), getattr(whole, name), err_msg=name)
    assert curve.optimum == whole.optimum and curve.status == whole.status and curve.branch_end == whole.branch_end
    assert curve.events == whole.events
    # what the first runs spent counts, but for scans that were interrupted
    assert curve.cost.evaluations == whole.cost.evaluations
    assert curve.cost.processor > 0.5 * whole.cost.processor
    # a finished search is read, and one in the middle of its last line goes on
    again = optimal_curve(new_study(), **ASKED, resume=path)
    path.write_bytes(path.read_bytes()[:-100])
    for result in (again, optimal_curve(new_study(), **ASKED, resume=path)):
        assert result.optimum == whole.optimum


def stop_following_from(monkeypatch, place):
    """Ctrl-C when peaks of the scan at a preload are followed upward; those downward are there."""
    follow = PeakEnvelope.follow

    def stopped(known, branch, k, step, last=None):
        if k == place and step > 0:
            raise KeyboardInterrupt
        follow(known, branch, k, step, last)

    monkeypatch.setattr(PeakEnvelope, "follow", stopped)


def test_interrupted_before_anything_is_certain(monkeypatch):
    stop_following_from(monkeypatch, ASKED["n"] - 1)
    with pytest.raises(KeyboardInterrupt):
        optimal_curve(new_study(), **ASKED)


def test_an_interrupted_scan_leaves_no_value(whole, monkeypatch, tmp_path):
    """Where branches are only followed in part a higher peak may be missing: values are those of whole scans alone."""
    stop_following_from(monkeypatch, 0)
    curve = optimal_curve(new_study(), **ASKED)
    known = np.isfinite(curve.amplitude)
    assert [s == "scanned" for s in curve.status] == known.tolist() and 0 < np.count_nonzero(known) < len(curve)
    np.testing.assert_array_equal(curve.amplitude[known], whole.amplitude[known])
    assert all("scan" in s for s, has in zip(curve.status, known) if not has) and not curve.complete
    assert curve.optimum.amplitude == np.nanmin(curve.amplitude) and not curve.optimum.verified
    assert curve.optimum.kind == "unknown"
    curve.save(tmp_path / "part.h5")
    assert bd.load(tmp_path / "part.h5").interrupted


def test_an_interrupted_verification_keeps_the_values(whole, monkeypatch):
    scan = PeakEnvelope._scan

    def stopped(known, k, whole):
        if whole:
            raise KeyboardInterrupt
        return scan(known, k, whole)

    monkeypatch.setattr(PeakEnvelope, "_scan", stopped)
    curve = optimal_curve(new_study(), **ASKED)
    np.testing.assert_array_equal(curve.amplitude, whole.amplitude)
    assert curve.interrupted and curve.optimum.uncertainty < 1.0
    assert curve.optimum.amplitude == pytest.approx(whole.optimum.amplitude, rel=1e-6)


def test_an_interrupted_scan_that_repeats_another_leaves_all_as_it_was(monkeypatch):
    """The first scan is incomplete and misses a peak that is known, which it takes for isolated; the next is broken off."""
    known = PeakEnvelope(new_study(), np.array([2e3, 4e3]), (250.0, 400.0), PeakOptions(), CostMeter(0.0))
    known.scan(1)
    told = known.scanned[4e3] = replace(known.scanned[4e3], ending="lost", bound=1.0, isolated=frozenset([0]))
    n, events = len(known.branches), list(known.events)
    with monkeypatch.context() as patch:
        patch.setattr(envelope, "same_peak", lambda a, b: False)  # finds the peak anew, and misses that of branch 0
        Stop(patch, PeakEnvelope, "follow", 2)
        with pytest.raises(KeyboardInterrupt):
            known.scan(1, whole=True)
    assert known.scanned == {4e3: told} and len(known.branches) == n and known.events == events
    assert known.highest(1) is None and known.value(1) is None and known.lower_bound(1) == 1.0
    known.scan(1, whole=True)
    assert known.value(1)[0].number == 0 and known.scanned[4e3].whole


def test_a_preload_whose_peaks_are_not_all_followed_has_none(monkeypatch):
    known = PeakEnvelope(new_study(), np.array([2e3, 4e3]), (250.0, 400.0), PeakOptions(), CostMeter(0.0))
    known.find_all()
    known.branches.append(Branch(1, dict(known.branches[0].peaks)))
    with monkeypatch.context() as patch:
        Stop(patch, PeakEnvelope, "follow", 2)
        with pytest.raises(KeyboardInterrupt):
            known.insert(3e3)
    assert known.preload.tolist() == [2e3, 3e3, 4e3] and known.at(1) == [] and known.value(0) is not None


def test_a_file_of_another_search_is_refused(tmp_path):
    path, asked = tmp_path / "search.jsonl", {"preload": (2e3, 4e3), "n": 2, "frequency": (250.0, 400.0)}
    study = new_study()
    optimal_curve(study, **asked, resume=path)
    content = path.read_bytes()
    for other, changes, what in (
        (replace(study, friction_coefficient=0.4), {}, "study"),
        (study, {"n": 3}, "preload"),
        (study, {"frequency": (250.0, 390.0)}, "frequency"),
        (study, {"checks": 1}, "checks"),
    ):
        with pytest.raises(bd.BdamperError, match=f"another one: {what}"):
            optimal_curve(other, **asked | changes, resume=path)
    path.write_bytes(content.replace(b'"preload": 4000.0', b'"preload": 4001.0', 1))
    with pytest.raises(bd.BdamperError, match=r"expected a scan at 4000 N next, found one at 4001 N"):
        optimal_curve(study, **asked, resume=path)


def test_progress_tells_what_is_done(capsys):
    optimal_curve(new_study(), (2e3, 4e3), 3, frequency=(250.0, 400.0), progress=True)
    shown = capsys.readouterr().err
    assert "scan at 4000 N" in shown and "peak followed to 2000 N" in shown and "verification at 2000 N" in shown


SCRIPT = """
import json, sys
import bdamper as bd
study = bd.Study(bd.reference_model(), bd.Excitation("tip"), 5, contact_stiffness="unit_traction", harmonics=3)
print("begins", flush=True)
curve = study.optimal_curve((50.0, 5e3), 20, frequency=(250.0, 400.0), resume=sys.argv[1])
print(json.dumps([curve.interrupted, curve.ladder is None]))
"""


@pytest.mark.slow
def test_a_signal(tmp_path):
    child = subprocess.Popen(
        [sys.executable, "-c", SCRIPT, tmp_path / "search.jsonl"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert child.stdout.readline() == "begins\n"
    while not (tmp_path / "search.jsonl").exists() or b'"index": 0' not in (tmp_path / "search.jsonl").read_bytes():
        time.sleep(0.1)
    os.kill(child.pid, signal.SIGINT)
    out, err = child.communicate(timeout=120)
    assert json.loads(out) == [True, True], err
