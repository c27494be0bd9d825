"""Cases over models, modes, engine orders and preloads on which adaptive simulation is compared with everything on.

Half of them are the reference bladed disk, half are random wedges and test rigs of :mod:`tests.models`.  Cases are drawn
from a seed; nothing is left out afterwards.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

import bdamper as bd
from bdamper.response.response_curve_result import ResponseCurve
from tests import models
from tests.plain import plain_study

HARMONICS = 5


@dataclass(frozen=True)
class Case:
    """One model, mode, engine order; the preload relative to the one at which the whole contact would begin to slip."""

    number: int
    kind: str
    seed: int
    engine_order: int
    points: int
    mode: int
    direction: str
    level: float
    friction: float

    def __str__(self) -> str:
        return (
            f"{self.number}: {self.kind} {self.seed}, engine order {self.engine_order}, {self.points} points, resonance "
            f"{self.mode}, {self.direction}, mu {self.friction:.2f}, preload level {self.level:.3g}"
        )


def draw(number: int) -> Case:
    """The case of a number; even numbers are the reference model."""
    rng = np.random.default_rng([2009, number])
    friction = float(rng.uniform(0.25, 0.6))
    direction = str(rng.choice(["tangential", "axial"]))
    level = float(np.exp(rng.uniform(np.log(0.03), np.log(3.0))))
    mode = int(rng.choice([1, 2]))
    if number % 2 == 0:
        order, points = int(rng.choice([5, 10, 15, 20, 25, 30])), int(rng.choice([9, 24]))
        return Case(number, "reference", 0, order, points, mode, direction, level, friction)
    kind = str(rng.choice(["wedge", "wedge", "acyclic"]))
    order = int(rng.choice([1, 2, 3, 5])) if kind == "wedge" else 1
    return Case(
        number, kind, number, order, int(rng.choice([4, 6, 9])), mode, direction, level, friction
    )


@lru_cache(maxsize=4)
def _reference(points: int) -> bd.Model:
    return bd.reference_model("bladed_disk", points)


def _model(case: Case) -> bd.Model:
    if case.kind == "reference":
        return _reference(case.points)
    if case.kind == "wedge":
        return models.wedge_model(
            case.seed,
            engine_order=case.engine_order,
            n_points=case.points,
            harmonics=HARMONICS,
            alpha=0.9,
            beta=0.9,
        )
    return models.acyclic_model(case.seed, n_points=case.points, alpha=0.9, beta=0.9)


def everything_on(case: Case) -> dict[str, Any]:
    """The effects of the answer that counts as right."""
    return {
        "harmonics": HARMONICS,
        "damper_modes": 2,
        "blade_modes": 10 if case.kind == "reference" else 5,
    }


def study_of(case: Case, effects: dict[str, Any] | None = None) -> bd.Study:
    """The study of a case, with everything on by default."""
    study = plain_study(
        _model(case),
        bd.Excitation("tip", case.direction),
        engine_order=case.engine_order,
        friction_coefficient=case.friction,
    )
    return study.replace(**effects or everything_on(case))


def resonances(curve: ResponseCurve) -> list[float]:
    """Frequencies of the maxima of a linear curve, Hz, those of 10 % of the largest and more."""
    a = curve.amplitude
    top = np.flatnonzero((a[1:-1] > a[:-2]) & (a[1:-1] > a[2:])) + 1
    return [float(curve.frequency[i]) for i in top if a[i] > 0.1 * a[top].max()]


def scene(study: bd.Study, case: Case) -> tuple[float, tuple[float, float]] | None:
    """Preload (N) and interval (Hz), from below the free to above the stuck resonance; None without such a resonance.

    The static contact has to exist; the unit of preload is that at which friction could not carry the tangential forces
    of the stuck resonance any more.
    """
    state = study.static(100.0)
    if not state.ok:
        return None
    stuck, free = study.stuck((150.0, 1500.0)), resonances(study.free((150.0, 1500.0)))
    found = resonances(stuck)
    if not found:
        return None
    high = found[min(case.mode, len(found)) - 1]
    below = [f for f in free if f < high]
    low = max(0.95 * below[-1] if below else 0.0, 0.75 * high)
    at = int(np.argmin(np.abs(stuck.frequency - high)))
    system = study.problem.system(100.0)
    c, s = system.layout.slices(1)
    q = stuck.unknowns[at][c] - 1j * stuck.unknowns[at][s]
    motion = np.abs(study.problem.bases[1].G @ q)[:, :2]
    springs = study.problem.at(state.load).stuck_springs()[:, :2]
    tangential = float((springs * motion).sum())
    capacity = case.friction * float(state.force[study.problem.friction > 0.0, 2].sum()) / 100.0
    return case.level * tangential / capacity, (low, 1.06 * high)


def found(path: str) -> list[dict]:
    """Results that an earlier run has written, one JSON object on each line."""
    try:
        with open(path) as file:
            return [json.loads(line) for line in file]
    except FileNotFoundError:
        return []
