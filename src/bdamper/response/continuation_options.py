"""What a path along a curve is: its settings, its points, how it ended."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from bdamper.harmonic_balance.equations import Correction, norm2
from bdamper.util import validation
from bdamper.util.short_repr import brief

AtLeastTwo = Annotated[int, partial(validation.whole, least=2)]
SIDE_POINTS = 1000
"""Points of a path that is no part of a curve: outside of its interval, or along which an excitation is raised or a support
fades.  Outside, with 150, one more of 100 narrow bands (``benchmarks/bench_narrow.py``) loses its highest branch."""


@validation.spelt
@dataclass(frozen=True)
class ContinuationOptions:
    """Settings of the continuation.

    Parameters
    ----------
    tolerance : float
        On the largest residual, relative to excitation and static load.
    step, min_step, max_step : float
        First, smallest and largest step in scaled unknowns (0.1: a tenth of the present vibration).
    max_turn : float, rad
        Largest angle between successive tangents of an accepted step.
    max_points : int
        Of one path.
    patience : int
        Points without getting any further in frequency, to either side of where it set off, after which a path is left as a
        tangle of folds.  Without this limit the widest gap grows on three of six curves with tangles (from 5.3 to 23, 1.0
        to 3.5 and 11.7 to 12.0 Hz) and shrinks on one (from 7.6 to 6.5 Hz); none of 284 ordinary curves changes.
    budget : int or None
        Evaluations of the equations after which a curve ends with what it has; None sets it from the sizes of the problem
        (``bdamper.response.branches.evaluation_budget``).
    max_iterations : int
        Newton iterations in a step.
    locate : bool
        Refine folds and amplitude maxima.
    locate_tolerance : float
        On folds and maxima, relative to the step in which they lie.
    corner_step : float
        Longest failed step that is searched for a corner of the curve; longer ones are shortened first.
    """

    tolerance: Annotated[float, validation.Limits(above=0.0, below=1e-2)] = 1e-9
    step: validation.Positive = 0.05
    min_step: validation.Positive = 1e-7
    max_step: validation.Positive = 0.15
    max_turn: Annotated[float, validation.Limits(above=0.0, most=np.pi)] = 0.45
    max_points: AtLeastTwo = 5000
    patience: AtLeastTwo = 400
    budget: validation.Count | None = None
    max_iterations: AtLeastTwo = 8
    locate: bool = True
    locate_tolerance: Annotated[float, validation.Limits(above=0.0, below=1.0)] = 1e-8
    corner_step: validation.Positive = 0.3

    def __post_init__(self) -> None:
        validation.checked(self)
        steps = self.min_step, self.step, self.max_step
        validation.that(sorted(steps) == list(steps), "steps", "0 < min_step <= step <= max_step", steps)


@brief
@dataclass(frozen=True)
class Path:
    """Points of a path and how it ended.

    Parameters
    ----------
    points : tuple of Correction
    status : str
        "complete", "turned back" (to the bound away from which it set off), "closed" (on itself), "many folds" (too many
        without progress), "drifted off" (a free body that nothing stops), "stalled", "too many points", "out of budget" or
        "interrupted".
    reason : str
    iterations, failed_steps : int
    tangle : (low, high), rad/s, or None
        Of the folds in which the path was left.
    """

    points: tuple[Correction, ...]
    status: str
    reason: str
    iterations: int
    failed_steps: int
    tangle: tuple[float, float] | None = None


def is_drift(tangent: NDArray, n_mean: int) -> bool:
    """Whether a path moves the mean position alone: same vibration, same frequency."""
    return norm2(tangent[n_mean:]) < 1e-6
