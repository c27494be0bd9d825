"""The whole response at one preload as part of an optimal curve, and how a file keeps it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from threading import Event
from typing import Any

import numpy as np

from bdamper.continuation.curve import Curve
from bdamper.continuation.path import ContinuationOptions
from bdamper.continuation.rattle import open_at_rest, rattles
from bdamper.continuation.track import without_points
from bdamper.peaks.highest import AT_END, Found, Highest, found_at, given_up
from bdamper.peaks.newton import PeakOptions
from bdamper.peaks.sensitivity import amplitude_sensitivity
from bdamper.problem.problem import Problem
from bdamper.util.blas import one_thread
from bdamper.util.cost import Cost
from bdamper.util.errors import BdamperError
from bdamper.util.hdf5 import typed
from bdamper.util.progress import ended_by
from bdamper.util.status import COMPLETE, INCOMPLETE, NOT_FOUND, because

LOST = (ArithmeticError, np.linalg.LinAlgError)
"""What a solution raises that cannot be computed, as where numbers overflow: one preload is lost by it, no curve."""


@dataclass(frozen=True)
class AtPreload:
    """The response over frequency at one preload.

    Parameters
    ----------
    preload : float, N
    curve : Curve
        Without its unknowns.
    top : Highest, optional
        Its highest point, None where nothing was found.
    slope : float
        d ln(amplitude)/d ln(preload) of that, NaN where it has none, as at a corner.
    rattles : str
        Why no steady periodic response is expected, if the curve shows the sign (:mod:`bdamper.continuation.rattle`).
    cost : Cost
    """

    preload: float
    curve: Curve
    top: Highest | None
    slope: float
    rattles: str
    cost: Cost

    @property
    def known(self) -> bool:
        """Whether no maximum of the branches that were followed is higher; see :func:`~bdamper.peaks.highest.given_up`."""
        return self.top is not None and self.curve.complete and self.top.kind != "end"

    @property
    def value(self) -> float:
        """ln(amplitude) of the highest point, infinite where that is not known."""
        return float(np.log(self.top.peak.amplitude)) if self.known and self.top is not None else np.inf

    @property
    def status(self) -> str:
        """ "complete", "incomplete" or "not found", with what is to be said of it."""
        if self.top is None or not self.curve.complete:
            own = NOT_FOUND if self.top is None else INCOMPLETE
            return because(own, f"{self.curve.status}: {self.curve.reason}".removeprefix(f"{own}: "))
        if self.top.kind == "end":
            return because(INCOMPLETE, AT_END)
        return because(COMPLETE, "; ".join(filter(None, (self.top.note, given_up(self.curve)))))

    def record(self) -> dict[str, Any]:
        """All of it in numbers, texts, lists and arrays."""
        return {"index": repr(self.preload), **asdict(self)}

    @staticmethod
    def of(record: Mapping[str, Any]) -> AtPreload:
        """Restore a record read from JSON, in which arrays of a curve without points have no shape."""
        made: AtPreload = typed(AtPreload, record)
        curve, n = made.curve, len(made.curve)
        harmonics, shares = curve.harmonics.reshape(n, 2), curve.shares.reshape(n, 3)
        return replace(made, curve=replace(curve, unknowns=np.zeros((n, 0)), harmonics=harmonics, shares=shares))


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
            found = Found(without_points(problem, preload, why, ContinuationOptions(), Cost()), None, Cost())
    curve, slope, why = found.curve, np.nan, ""
    if found.top is not None:
        why = rattles(curve.frequency, curve.amplitude, curve.shares[:, 2], curve.branch, open_at_rest(problem, preload))
        peak = found.top.peak
        if not peak.corner:
            try:
                slope = amplitude_sensitivity(peak, problem.system, preload, options) * preload / peak.amplitude
            except (*LOST, BdamperError):
                slope = np.nan
    light = replace(curve, unknowns=np.zeros((len(curve), 0)), harmonics=curve.harmonics[:, :2], start_log=())
    return AtPreload(preload, light, found.top, slope, why, found.cost)
