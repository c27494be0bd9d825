"""Verdict on the highest response at a preload: every analysis gives the same."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import bdamper as bd
from bdamper.analyses import crossings
from bdamper.response import followed_peak
from bdamper.response.highest_peak import FOLLOWED
from bdamper.response.response_curve_result import NO_STEADY
from bdamper.util.errors import COMPLETE, INCOMPLETE, NOT_FOUND
from bdamper.util.progress import CostMeter
from tests.printed import said

MODELS = Path(__file__).parents[1] / "models"


def verdict(status: str, reason: str) -> str:
    """Return the verdict in one word: complete, incomplete, followed, not steady, or unbounded."""
    if reason.startswith(NO_STEADY):
        return "not steady"
    if FOLLOWED in reason:
        return "followed"
    if reason.startswith("unbounded"):
        return "unbounded"
    return status


def verdicts(
    study: bd.Study, preload: float, interval: tuple[float, float], in_time: bool = False
) -> dict[str, str]:
    """Return the verdict of every analysis at a preload (N) and in an interval (Hz)."""
    peak = study.peak(preload, interval)
    curve = study.frequency_response(preload, interval)
    single = bd.sweep(study, {"friction_factor": [1.0]}, bd.PeakTask(preload, interval))
    around = [0.5 * preload, preload, 2.0 * preload]
    swept = bd.sweep(study, {"preload": around}, frequency=interval)
    optimal = study.optimal_curve(around, frequency=interval, check=False)
    compared = bd.compare({"study": study}, lambda _: curve)
    row = int(np.flatnonzero(optimal.preload == preload)[0])
    found = {
        "peak": verdict(peak.status, peak.reason),
        "peak of the curve": verdict(curve.peak.status, curve.peak.reason),
        "sweep": verdict(single.status[0], single.reason[0]),
        "sweep over the preload": verdict(swept.status[1], swept.reason[1]),
        "optimal curve": verdict(optimal.status[row], optimal.reason[row]),
    }
    # amplitudes are stated if the verdict is complete, and never otherwise
    stated = [
        peak.amplitude,
        single.array("amplitude")[0],
        swept.array("amplitude")[1],
        optimal.amplitude[row],
        compared.curves[0].peak.amplitude if curve.peak.ok else np.nan,
    ]
    if peak.ok:
        assert stated == pytest.approx([peak.amplitude] * len(stated), rel=1e-3)
    else:
        assert not np.isfinite(stated).any()
    if in_time:
        assert study.time_response(curve).ok == peak.ok
    return found


@pytest.mark.slow
def test_a_branch_that_only_lower_preloads_show():
    """An independent integration keeps 84.9 mm for 600 periods, the curve reaches 32.8 mm."""
    study = bd.load_study(MODELS / "study_followed.h5")
    preload = 0.09145101144214342
    interval = (0.06405198871972549, 0.8958762237234519)
    found = verdicts(study, preload, interval, in_time=True)
    assert set(found.values()) == {"followed"}, found
    curve = study.frequency_response(preload, interval)
    assert curve.amplitude.max() == pytest.approx(0.0328, rel=1e-2)
    assert study.peak(preload, interval).lower_bound == pytest.approx(0.084906, rel=1e-3)
    assert curve.status == "incomplete" and FOLLOWED in curve.reason
    assert "Lower bound" in str(curve) and "followed from" in str(curve)


def test_an_interrupt_during_the_verdict_keeps_the_curve(monkeypatch):
    study = bd.load_study(MODELS / "study_followed.h5")
    interval = (0.06405198871972549, 0.8958762237234519)

    def stops(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(followed_peak, "_coarse_at", stops)
    curve = study.frequency_response(0.09145101144214342, interval)
    assert curve.status == "interrupted" and curve.amplitude.max() > 0.0328


SEED = 10099
"""Seed of all drawn studies; each draws from this seed and its own number."""


def drawn_masses(number: int) -> tuple[bd.Study, float]:
    """Return two or three masses in a row, the last of them pressed on its neighbour, and a preload (N)."""
    rng = np.random.default_rng([SEED, number])
    n = int(rng.integers(2, 4))
    mass = rng.uniform(0.5, 1.5, n)
    mass[-1] = rng.uniform(0.05, 0.3)
    stiffness = np.diag(rng.uniform(0.5, 1.5, n))
    stiffness[-1, -1] = rng.uniform(0.0, 0.1)
    for i in range(n - 2):
        coupling = rng.uniform(0.1, 0.5)
        stiffness[i : i + 2, i : i + 2] += coupling * np.array([[1.0, -1.0], [-1.0, 1.0]])
    contact = bd.Contact(
        (n - 1, n - 2),
        normal=n - 1,
        kt=rng.uniform(0.5, 3.0),
        kn=rng.uniform(0.5, 3.0),
        mu=rng.uniform(0.2, 0.8),
    )
    force = 0.1
    study = bd.lumped(
        mass,
        rng.uniform(0.002, 0.02, n),
        stiffness,
        contacts=[contact],
        forces={0: force},
        load_per_preload={n - 1: 1.0},
        harmonics=int(rng.choice([1, 3])),
    )
    return study, force * float(10.0 ** rng.uniform(-1.0, 0.7))


def drawn_wedge(number: int) -> tuple[bd.Study, float]:
    """Return a wedge between two blades of two directions each, three bodies, and a preload (N)."""
    rng = np.random.default_rng([SEED, number])
    blades = np.diag(rng.uniform(1.1e6, 1.5e6, 4))
    # coupling of the directions of each blade
    blades[0, 1] = blades[1, 0] = -rng.uniform(0.3e6, 0.6e6)
    blades[2, 3] = blades[3, 2] = -rng.uniform(0.3e6, 0.6e6)
    stiffness = np.zeros((6, 6))
    stiffness[:4, :4] = blades
    stiffness[4:, 4:] = rng.uniform(0.1e6, 0.4e6) * np.array([[1.0, -1.0], [-1.0, 1.0]])
    angle = rng.uniform(0.45, 0.9)
    c, s = np.cos(angle), np.sin(angle)
    law = {"kt": rng.uniform(2e5, 6e5), "kn": rng.uniform(2e5, 6e5), "mu": rng.uniform(0.2, 0.5)}
    left = bd.Contact({0: -c, 1: -s, 4: c, 5: s}, {0: s, 1: -c, 4: -s, 5: c}, **law)
    right = bd.Contact({2: -c, 3: s, 4: c, 5: -s}, {2: -s, 3: -c, 4: s, 5: c}, **law)
    damping = [rng.uniform(2.0, 8.0)] * 4 + [0.0, 0.0]
    study = bd.lumped(
        [1.0] * 4 + [rng.uniform(0.05, 0.2)] * 2,
        damping,
        stiffness,
        contacts=[left, right],
        forces={0: 1.0},
        load_per_preload={5: 1.0},
        harmonics=1,
    )
    return study, float(10.0 ** rng.uniform(-0.5, 0.7))


SHIPPED = (("turbine_blade", 5), ("bladed_disk", 5), ("bladed_disk", 10), ("shrouded_blade", 4))
"""Shipped models with a loaded damper, and engine orders."""


def drawn_shipped(number: int) -> tuple[bd.Study, float]:
    """Return a study of a shipped model, and a preload (N)."""
    rng = np.random.default_rng([SEED, number])
    name, order = SHIPPED[int(rng.integers(len(SHIPPED)))]
    force = float(rng.uniform(0.5, 3.0))
    study = bd.Study(
        bd.reference_model(name),
        bd.Excitation("tip", direction="tangential", amplitude=force),
        engine_order=order,
        friction_coefficient=float(rng.uniform(0.2, 0.45)),
        harmonics=1,
    )
    return study, force * float(10.0 ** rng.uniform(1.3, 3.0))


def check_drawn(study: bd.Study, preload: float) -> str:
    """Return the verdict on a study, which all analyses must give."""
    interval = study.peak(preload).settings.get("frequency")
    found = verdicts(study, preload, tuple(interval))
    assert len(set(found.values())) == 1, found
    return found["peak"]


NO_FOLDS = 22
"""A wedge whose curve has no folds, so that a single preload is not compared with lower ones.

A branch that detaches at 0.6 times the preload reaches 37.7 µm at this preload, where the curve has
11.6 µm.  Only analyses over preloads know it.
"""
CHEAP = (3, 5, 8, 9, 11, 13, 15, 20, 21, 26)
"""Numbers of the draws that take ten seconds together."""


def verdicts_of_draws(numbers: Iterable[int]) -> set[str]:
    """Return the verdicts on drawn masses (0 to 19) and wedges (20 to 29), each the same everywhere."""
    failures = {}
    seen = set()
    for number in numbers:
        draw = drawn_masses if number < 20 else drawn_wedge
        try:
            seen.add(check_drawn(*draw(number)))
        except AssertionError as error:
            failures[number] = str(error)
    assert not failures
    return seen


@pytest.mark.slow
def test_drawn_masses_and_wedges():
    assert verdicts_of_draws(CHEAP) == {"complete", "incomplete", "followed"}


@pytest.mark.slow
@pytest.mark.parametrize("preloads", [(0.5, 1.0), tuple(np.geomspace(0.5, 1.0, 16))])
def test_a_detached_branch_is_found_from_close_and_distant_preloads(preloads):
    """Between close preloads no amplitude falls by a third; a single preload names the check."""
    study, preload = drawn_wedge(NO_FOLDS)
    interval = tuple(study.peak(preload, errors=False).settings["frequency"])
    curve = study.optimal_curve(
        [share * preload for share in preloads], frequency=interval, check=False, errors=False
    )
    assert FOLLOWED in curve.reason[-1]
    assert curve.lower_bound[-1] == pytest.approx(37.67e-6, rel=1e-3)
    single = study.peak(preload, interval, errors=False)
    assert single.amplitude == pytest.approx(11.62e-6, rel=1e-3)
    assert "lower preloads: study.optimal_curve((1.01, 3.37))" in said(single)


@pytest.mark.nightly
@pytest.mark.slow
def test_more_drawn_masses_and_wedges():
    verdicts_of_draws(set(range(30)) - {*CHEAP, NO_FOLDS})


@pytest.mark.nightly
@pytest.mark.slow
@pytest.mark.parametrize("number", range(30, 40))
def test_drawn_shipped_models(number):
    check_drawn(*drawn_shipped(number))


@pytest.mark.nightly
@pytest.mark.slow
def test_a_rattling_damper_has_no_peak_anywhere():
    """Time integration leaves the solution of 164 µm at 327 Hz and settles at 51 µm.

    Its highest motion, 127 µm with the same modes, is at another frequency.
    """
    study = bd.Study(
        bd.reference_model("bladed_disk"),
        bd.Excitation("tip", direction="tangential", amplitude=2.01),
        engine_order=10,
        friction_coefficient=0.441,
        harmonics=3,
        blade_modes=5,
    )
    preload = 312.67
    peak = study.peak(preload)
    curve = study.frequency_response(preload, tuple(peak.settings["frequency"]))
    swept = bd.sweep(study, {"preload": [preload]})
    assert verdict(peak.status, peak.reason) == "not steady" and np.isnan(peak.amplitude)
    assert verdict(curve.status, curve.reason) == "not steady" and not curve.peak.ok
    assert verdict(swept.status[0], swept.reason[0]) == "not steady"
    assert str(curve).startswith("No steady periodic response expected; highest solution 164 µm")
    compared = bd.compare({"study": study}, lambda _: curve)
    assert str(compared).startswith("No peak of 'study' to compare with: incomplete")
    motion = study.motion_in_time(curve, curve.peak_index)
    assert motion.verdict == "does not agree" and motion.mean < 0.5 * curve.peak.amplitude


@pytest.mark.parametrize(
    ("reason", "kind"),
    [(f"{NO_STEADY} is expected", NOT_FOUND), (f"{FOLLOWED} 1 N", INCOMPLETE), ("", COMPLETE)],
)
def test_a_crossing_asks_the_peak_at_its_speed(monkeypatch, reason, kind):
    """Without folds nothing is computed."""
    asked = []

    def at_speed(family, speed, mode):
        asked.append(speed)
        return SimpleNamespace(status=kind, reason=reason, cost=None)

    monkeypatch.setattr(crossings, "highest_at_speed", at_speed)
    task = crossings.CrossingTask((1.0, 2.0))
    folded, plain = SimpleNamespace(folds=[3]), SimpleNamespace(folds=[])
    end = task._verdict_at_speed(None, folded, 1.5, CostMeter())
    assert end.status == kind and reason in end.reason and asked == [1.5]
    assert task._verdict_at_speed(None, plain, 1.5, CostMeter()).ok and asked == [1.5]
