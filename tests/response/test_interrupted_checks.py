"""Interrupts of an optimal curve with its checks: each one has an effect, soon, and what is known remains."""

import collections
import dataclasses
import json
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import bdamper as bd
from bdamper.analyses import accuracy, optimum, robust_optimum
from bdamper.response import optimal_curve as optimal
from bdamper.response.optimum_checks import checks
from bdamper.response.verification import FrictionPeak
from bdamper.time_domain import time_response
from bdamper.util.storage import json_line
from tests.integrations import interrupted_at
from tests.util.test_disk import BAND, pressed

RANGE, COUNT, SEED = (0.05, 2.0), 5, 160


@pytest.fixture(scope="module")
def study():
    return pressed()


@pytest.fixture(scope="module")
def searched(study):
    return study.optimal_curve(RANGE, COUNT, frequency=BAND, check=False)


def test_a_check_that_was_not_run_has_the_price_of_its_curves(searched):
    def prices(curves, shares=searched.shares):
        curve = dataclasses.replace(searched, curves=tuple(curves), shares=shares)
        white = [check for check in checks(curve) if check.colour == "white"]
        return {check.name: check.seconds for check in white}, str(curve)

    def with_processor(factor):
        for curve in searched.curves:
            cost = dataclasses.replace(curve.cost, processor=factor * curve.cost.processor)
            yield dataclasses.replace(curve, cost=cost)

    own, text = prices(searched.curves)
    twice, _ = prices(with_processor(2.0))
    assert {"Time integration", "Other friction coefficients"} <= own.keys()
    for name in ("Time integration", "Other friction coefficients"):
        assert own[name] > 0.0
        assert twice[name] == pytest.approx(2.0 * own[name])
    assert "time integration, about" in text
    # contacts that are closed half as long double the price of a time step
    shares = searched.shares.copy()
    shares[:, 2] = 1.0 - 0.5 * (1.0 - shares[:, 2])
    rattling, _ = prices(searched.curves, shares)
    assert rattling["Time integration"] == pytest.approx(2.0 * own["Time integration"])
    # files of versions that did not measure it have no processor time
    unknown, text = prices(with_processor(0.0))
    assert np.isnan(list(unknown.values())).all()
    assert "time integration: study" in text


def test_an_interrupt_after_the_last_integration(study, searched, monkeypatch):
    depth = []

    def interrupted(parts):
        depth.append(parts)
        results = run_all(parts)
        depth.pop()
        if not depth:
            raise KeyboardInterrupt
        return results

    run_all = time_response.on_threads
    monkeypatch.setattr(time_response, "on_threads", interrupted)
    curve = study.with_time_response(searched, [searched.optimum.preload])
    assert curve.time_response[0].status == "complete"
    assert curve.interrupted and not searched.interrupted


def test_an_interrupted_integration_keeps_its_motions_and_refutes_nothing(
    study, searched, monkeypatch
):
    whole = study.with_time_response(searched, [searched.optimum.preload]).time_response[0]
    for call, colour in ((2, "white"), (8, "amber")):
        interrupted_at(monkeypatch, call)
        curve = optimum.check_optimum(study.problem, searched)
        monkeypatch.undo()
        [response] = curve.time_response
        assert curve.interrupted and response.status == "interrupted"
        assert response.balance == pytest.approx(searched.optimum.amplitude, rel=1e-6)
        assert 0 < response.periods < whole.periods
        if colour == "amber":
            assert response.mean == pytest.approx(whole.mean, rel=0.05)
        else:
            assert np.isnan(response.mean)
        [check] = [check for check in checks(curve) if check.name == "Time integration"]
        assert check.colour == colour and check.found.startswith("interrupted")
        assert "by harmonic balance alone" in curve._headline() and not curve.failures
        for text in (str(curve), str(response)):
            assert "nan" not in text and "confirm" not in text
        assert "Remedy: run the time integration to its end" in str(response)


def test_an_interrupted_repetition_keeps_the_result(study, searched, monkeypatch):
    preload = [searched.optimum.preload]
    whole = study.with_time_response(searched, preload)
    interrupted_at(monkeypatch, 8)
    curve = study.with_time_response(whole, preload)
    assert curve.interrupted and curve.time_response == whole.time_response


def test_an_interrupt_while_a_preload_is_searched_that_tolerates_other_friction(
    study, searched, monkeypatch
):
    def steep(peaks, preload):
        # twice as high at 0.84 times the friction
        return lambda factor: FrictionPeak(factor, preload, 0.5 * factor**-4.0)

    def interrupted(curve, preload):
        raise KeyboardInterrupt

    monkeypatch.setattr(robust_optimum._FrictionPeaks, "at", steep)
    monkeypatch.setattr(robust_optimum, "_by_distance", interrupted)
    curve = robust_optimum.with_other_friction(study.problem, searched)
    assert [peak.status for peak in curve.other_friction] == ["complete"] * 3
    assert curve.friction_range.limits and curve.interrupted


def test_an_interrupt_between_two_checks(study, searched, monkeypatch):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(optimum.robust_optimum, "with_other_friction", interrupted)
    curve = optimum.check_optimum(study.problem, searched)
    assert curve.interrupted and curve.time_response[0].status == "complete"
    assert curve.convergence is not None and not curve.other_friction


# ---- finished checks in the file of a search ----


@pytest.fixture
def computed(monkeypatch):
    """Count curves of the search, time integrations, ladders of harmonics, and other peaks."""
    counts = collections.Counter()

    def counting(name, of, method):
        own = getattr(of, method)

        def counted(*given, **asked):
            counts[name] += 1
            return own(*given, **asked)

        monkeypatch.setattr(of, method, counted)

    counting("curves", optimal, "at_preload")
    counting("time", time_response, "time_response")
    counting("harmonics", accuracy, "_converge")
    counting("friction", robust_optimum.SteadyPeak, "__call__")
    return counts


def resumed(study, path, **asked):
    return study.optimal_curve(RANGE, COUNT, frequency=BAND, progress=False, resume=path, **asked)


def without_times(part):
    """A part that is not in the file takes another time."""

    def of(pairs):
        return {name: value for name, value in pairs if name not in ("seconds", "cost")}

    return json.loads(json_line(dataclasses.asdict(part)), object_pairs_hook=of)


def same_answer(curve, whole):
    assert not curve.interrupted
    for own, expected in (
        *zip(curve.time_response, whole.time_response, strict=True),
        *zip(curve.other_friction, whole.other_friction, strict=True),
        (curve.convergence, whole.convergence),
        (curve.friction_range, whole.friction_range),
    ):
        # texts, because unknown numbers differ from themselves
        assert str(without_times(own)) == str(without_times(expected))
    assert curve.cost.evaluations == whole.cost.evaluations
    assert curve.design_amplitude == whole.design_amplitude
    np.testing.assert_array_equal(curve.amplitude, whole.amplitude)


@pytest.mark.slow
def test_a_killed_run_computes_no_finished_check_again(study, computed, tmp_path):
    """The file of a killed run ends behind any of its parts, with a part of the next one."""
    path = tmp_path / "whole.jsonl"
    whole = resumed(study, path)
    lines = path.read_bytes().splitlines(keepends=True)
    records = [json.loads(line) for line in lines[1:]]
    n_curves = sum("curve" in record for record in records)
    n_checks = sum("part" in record for record in records)
    assert n_curves + n_checks == len(records)
    # the peak with the friction of the study is known from its curve, and also stored
    assert n_checks == n_parts(computed) + 1 >= 5
    computed.clear()
    same_answer(resumed(study, path), whole)
    assert not computed

    for n_kept in range(n_curves, len(records)):
        cut = tmp_path / f"{n_kept}.jsonl"
        following = lines[1 + n_kept]
        cut.write_bytes(b"".join(lines[: 1 + n_kept]) + following[: len(following) // 2])
        computed.clear()
        same_answer(resumed(study, cut), whole)
        missing = len(records) - n_kept
        assert computed["curves"] == 0 and missing - 1 <= n_parts(computed) <= missing


def n_parts(computed):
    return computed["time"] + computed["harmonics"] + computed["friction"]


def interrupted_call(*_):
    raise KeyboardInterrupt


@pytest.mark.slow
def test_an_interrupted_run_computes_no_finished_check_again(
    study, computed, monkeypatch, tmp_path
):
    path = tmp_path / "search.jsonl"
    # between two checks
    with monkeypatch.context() as changed:
        changed.setattr(optimum.robust_optimum, "with_other_friction", interrupted_call)
        assert resumed(study, path).interrupted
    computed.clear()
    assert not resumed(study, path).interrupted
    assert computed["time"] == computed["harmonics"] == 0 < computed["friction"]
    # another limit of the processor time is another time integration
    computed.clear()
    assert not resumed(study, path, seconds=200.0).interrupted
    assert dict(computed) == {"time": 1}


@pytest.mark.slow
def test_an_interrupted_integration_begins_again(study, computed, monkeypatch, tmp_path):
    path = tmp_path / "search.jsonl"
    with bd.set_workers(1), monkeypatch.context() as changed:
        interrupted_at(changed, 8)
        [response] = resumed(study, path).time_response
    assert response.status == "interrupted"
    computed.clear()
    curve = resumed(study, path)
    assert computed["time"] == 1 and curve.time_response[0].ok
    assert computed["curves"] == 0


@pytest.mark.slow
def test_a_largest_time_returns_what_is_known_and_the_price_of_the_rest(
    study, computed, monkeypatch, tmp_path
):
    path = tmp_path / "search.jsonl"
    limits = []

    def at_once(seconds, over):
        limits.append(seconds)
        return Stopper(over)

    class Stopper:
        """Timer whose time is over when the time integration begins."""

        def __init__(self, over):
            own = time_response.time_response

            def begins(*given, **asked):
                over()
                return own(*given, **asked)

            changed.setattr(time_response, "time_response", begins)

        def start(self):
            pass

        def cancel(self):
            pass

    with bd.set_workers(1), monkeypatch.context() as changed:
        changed.setattr("bdamper.util.progress.Timer", at_once)
        curve = resumed(study, path, maximum=60.0)
    assert limits == [60.0] and curve.interrupted and curve.optimum.ok
    missing = {check.name: check.price for check in checks(curve) if check.colour == "white"}
    for name in ("Time integration", "More harmonics", "Other friction coefficients"):
        assert missing[name].startswith("about ")
    computed.clear()
    assert not resumed(study, path).interrupted
    assert computed["curves"] == 0


@pytest.mark.slow
def test_a_largest_time_within_the_curves(study, tmp_path):
    path = tmp_path / "search.jsonl"
    with pytest.raises(bd.SettingError, match="no response curve within 1e-09 s"):
        resumed(study, path, maximum=1e-9)
    curve = resumed(study, path, maximum=1e9)
    assert not curve.interrupted


KILLED_IN_TIME = """
import itertools, os, pathlib, signal, sys, time
import bdamper as bd
from bdamper.time_domain.integration import AllSectors
from tests.response.test_interrupted_checks import resumed
from tests.util.test_disk import pressed

path = pathlib.Path(sys.argv[1])
own, done = AllSectors.integrate, itertools.count()

def killed(ring, *given, **asked):
    if next(done) == 8:
        while b"more harmonics" not in path.read_bytes():
            time.sleep(0.01)
        os.kill(os.getpid(), signal.SIGKILL)
    return own(ring, *given, **asked)

AllSectors.integrate = killed
# the harmonics have a thread of their own
with bd.set_workers(2):
    resumed(pressed(), path)
"""


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="the system has no such signal")
def test_a_process_killed_while_it_integrates_keeps_its_harmonics(study, computed, tmp_path):
    path = tmp_path / "search.jsonl"
    command = [sys.executable, "-c", KILLED_IN_TIME, str(path)]
    root = Path(__file__).parents[2]
    child = subprocess.run(
        command, cwd=root, env=os.environ | {"PYTHONPATH": str(root)}, timeout=120, check=False
    )
    assert child.returncode == -signal.SIGKILL
    curve = resumed(study, path)
    assert not curve.interrupted
    assert computed["time"] == 1 and computed["harmonics"] == 0
    assert computed["curves"] == 0


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="the system has no such timer")
def test_interrupts_at_random_instants(study, tmp_path):
    """At an instant of processor time, which does not depend on other programs."""
    instants = []

    def interrupt(*_):
        instants.append(time.process_time())
        raise KeyboardInterrupt

    def computed(path):
        return study.optimal_curve(RANGE, COUNT, frequency=BAND, progress=False, resume=path)

    start = time.process_time()
    whole = computed(tmp_path / "whole.jsonl")
    taken = time.process_time() - start
    assert not whole.interrupted
    at = dict(zip(whole.preload, whole.amplitude))

    fractions = random.Random(SEED)
    before = signal.signal(signal.SIGPROF, interrupt)
    try:
        for k in range(16):
            instants.clear()
            path = tmp_path / f"{k}.jsonl"
            try:
                signal.setitimer(signal.ITIMER_PROF, 0.9 * taken * fractions.random())
                curve = computed(path)
            except KeyboardInterrupt:
                # nothing was known: the file has its header at most
                assert not path.exists() or len(path.read_text().splitlines()) <= 1
                continue
            finally:
                signal.setitimer(signal.ITIMER_PROF, 0.0)
            if not instants:
                continue
            assert curve.interrupted, "the interrupt had no effect"
            assert time.process_time() - instants[0] < 1.0
            known = np.isfinite(curve.amplitude)
            right = [at[preload] for preload in curve.preload[known]]
            np.testing.assert_allclose(curve.amplitude[known], right, rtol=1e-9)
    finally:
        signal.signal(signal.SIGPROF, before)
