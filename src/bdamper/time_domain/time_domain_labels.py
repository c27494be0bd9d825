"""Stability from the motion in time: does a blade that starts at a solution stay there?

Harmonic balance gives a motion of ``H`` harmonics; the motion that the equations have next to it in time has a sequence of
stick, slip and separation of its own.  It is started at the solution with a disturbance of every nodal diameter and
marched until ``bdamper.time_domain.march.judged`` decides (``bdamper.time_domain.settling.verified``).  A damper
without damping of its own chatters at many points next to separated peaks, without any period; what counts there is the
amplitude to which this leads, averaged over many periods.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bdamper.response.continuation import TWO_PI
from bdamper.response.curve import ResponseCurve
from bdamper.time_domain.integration import MarchFailed, Ring
from bdamper.time_domain.march import AGREES, BOUNDS, UNDECIDED
from bdamper.time_domain.settling import march_from, verified
from bdamper.time_domain.wave_exponents import rests
from bdamper.util.cost import CostMeter
from bdamper.util.progress import LongWork, each


def judged_in_time(ring: Ring, curve: ResponseCurve, progress: bool) -> ResponseCurve:
    """A curve with stability from the harmonics, judged by the motion in time as well.

    That of the harmonics stays where a point remains undecided, as all do that follow after Ctrl-C.

    Parameters
    ----------
    ring : Ring
        Of the curve's preload.
    curve : ResponseCurve
    progress : bool
    """
    watch, stable, judged = CostMeter(), np.array(curve.stable, bool), 0
    moving = np.array([not rests(ring.system, u) for u in curve.unknowns], bool).reshape(len(curve))
    stable[~moving] = True
    ratios = np.where(moving, np.nan, 1.0)
    with LongWork() as work:
        for i in each(np.flatnonzero(moving).tolist(), progress, "motion in time", "point"):
            verdict, ratio = judged_at(ring, curve.unknowns[i], TWO_PI * float(curve.frequency[i]))
            judged += 1
            if verdict != UNDECIDED:
                stable[i], ratios[i] = verdict == AGREES, ratio
    note = (
        f"motion in time, amplitude kept to {100.0 * BOUNDS.tolerance:g} %: {judged} of {len(curve)} points judged, "
        f"{int((~moving).sum())} rest, {int(np.isnan(ratios).sum())} undecided; {watch.read().seconds:.3g} s"
        + (", interrupted by the user" if work.interrupted else "")
        + (f"; the undecided: {curve.stability_note}" if np.isnan(ratios).any() else "")
    )
    return replace(curve, stable=stable, stability_note=note, in_time=ratios)


def judged_at(ring: Ring, u: NDArray, omega: float) -> tuple[str, float]:
    """Verdict on a solution, and mean amplitude in time over that of the solution."""
    expected = ring.system.response(u)
    if not abs(expected[1]) > 0.0:
        return UNDECIDED, np.nan
    try:
        found = verified(march_from(ring, u, omega, BOUNDS.steps), expected)
    except MarchFailed:
        return UNDECIDED, np.nan
    return found.verdict, float(found.amplitude[-BOUNDS.settled :].mean() / found.balance)
