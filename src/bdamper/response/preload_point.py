"""The whole response at one preload as part of an optimal curve, and how a file keeps it."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from threading import Event

import numpy as np

from bdamper.harmonic_balance.problem import Problem
from bdamper.response.continuation_options import ContinuationOptions
from bdamper.response.highest_peak import AtPreload, found_at
from bdamper.response.peak import PeakOptions
from bdamper.response.rattle_detection import open_at_rest, rattles
from bdamper.response.response_curve import without_points
from bdamper.response.sensitivity import amplitude_sensitivity
from bdamper.util.cost import Cost
from bdamper.util.errors import BdamperError
from bdamper.util.progress import ended_by
from bdamper.util.threading import one_thread

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
