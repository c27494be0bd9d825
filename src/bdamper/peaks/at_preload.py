"""The whole response at one preload as part of an optimal curve, and how a file keeps it."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from threading import Event

import numpy as np

from bdamper.continuation.path import ContinuationOptions
from bdamper.continuation.rattle import open_at_rest, rattles
from bdamper.continuation.track import without_points
from bdamper.peaks.highest import AtPreload, found_at
from bdamper.peaks.newton import PeakOptions
from bdamper.peaks.sensitivity import amplitude_sensitivity
from bdamper.problem.problem import Problem
from bdamper.util.blas import one_thread
from bdamper.util.cost import Cost
from bdamper.util.errors import BdamperError
from bdamper.util.progress import ended_by

LOST = (ArithmeticError, np.linalg.LinAlgError)
"""What a solution raises that cannot be computed, as where numbers overflow: one preload is lost by it, no curve."""


@one_thread
def at_preload(
    problem: Problem,
    preload: float,
    frequency: tuple[float, float],
    options: PeakOptions | None = None,
    budget: int | None = None,
    stop: Event | None = None,
) -> AtPreload:
    """The response at a preload; another thread ends the work by setting ``stop``."""
    with ended_by(stop or Event()):
        try:
            found = found_at(problem, preload, frequency, options=options, budget=budget)
        except LOST as error:
            why = f"failed: {type(error).__name__}: {error}"
            lost = without_points(problem, preload, why, ContinuationOptions(), Cost())
            found = AtPreload(preload, lost, None, np.nan, "", Cost())
    curve, slope, why = found.curve, np.nan, ""
    if found.top is not None:
        why = rattles(curve, open_at_rest(problem, preload))
        peak = found.top.peak
        with suppress(*LOST, BdamperError):  # none at a corner
            slope = amplitude_sensitivity(peak, problem.system, preload) * preload / peak.amplitude
    light = replace(curve, unknowns=np.zeros((len(curve), 0)), harmonics=curve.harmonics[:, :2], start_log=())
    return replace(found, curve=light, slope=slope, rattles=why)
