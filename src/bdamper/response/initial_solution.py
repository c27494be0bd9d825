"""The first point of a curve: a solution at one frequency, from nothing but the static state.

The chain is, in this order,

1. the static state under the preload (:mod:`bdamper.contact.static_state`), with the linear response of the stuck contact
on top
   of it, and Newton's method from there,
2. the same with line search (and least norm where the Jacobian is rank-deficient),
3. excitation ramp: continuation in the level of the excitation from the static state on, around folds,
4. support homotopy: free bodies (all, if none is free) rest on springs and dampers that fade, while the excitation is
   raised.

The result lists what was tried.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bdamper.contact.static_state import PreloadState
from bdamper.harmonic_balance.equations import OK, STATUS_TEXT, Equations
from bdamper.harmonic_balance.sector import Sector, excitation_ramp, supported_by
from bdamper.response.continuation import DRIFTED_OFF, follow
from bdamper.response.continuation_options import SIDE_POINTS, ContinuationOptions, Path
from bdamper.util.cost import CostMeter

DRAG, SPRING = 10.0, 1.0
"""Support of free bodies: on the vibration, and on the mean.

Of 453 places on the bladed disk (9 and 24 points, one to five harmonics, 20 to 200 N at 1 N) and on random wedges with
preloads below 20 times the excitation, Newton's method finds a solution at 197, the excitation ramp at 243 of the others,
and this support at 8 of the 13 that are left.  Of nine other supports none did better there.  On one random
model, whose shrouds just touch without preload, two supports were compared: only the one that raises the excitation
meanwhile found a start.
"""


def first_point(
    system: Equations[Sector],
    state: PreloadState,
    springs: NDArray,
    omega: float,
    options: ContinuationOptions,
    meter: CostMeter,
) -> tuple[NDArray | None, list[str], NDArray]:
    """A solution at one frequency.

    Parameters
    ----------
    system : Equations[Sector]
    state : PreloadState
        The static state, converged.
    springs : (n_points, 3) float
        Linear springs of the points that stick.
    omega : float, rad/s
    options : ContinuationOptions
    meter : CostMeter

    Returns
    -------
    (n_unknowns + 1,) float or None, what was tried, and where the last Newton iteration ended
    """
    log = [f"static state: converged in {state.iterations} iterations, residual {state.residual:.1e}"]
    mean, stuck = state.q[: system.n_mean], system.structure.linear.response(omega, springs)
    start = system.layout.pack(mean, stuck)
    last = np.append(start, omega)
    scale = system.units(last, omega)
    for name, line_search, iterations in (("Newton", False, 20), ("Newton with line search", True, 60)):
        if system.spent:
            break
        c = system.correct_at(start, omega, scale, options.tolerance, iterations, line_search)
        meter.count(c.iterations)
        log.append(f"{name} from the stuck response: {STATUS_TEXT[c.status]}, {c.iterations} iterations")
        last = c.y
        if c.status == OK:
            return c.y, log, last
    found = None if system.spent else _by_homotopy(system, omega, options, meter, log, mean, stuck)
    if found is None and system.spent:
        log.append("the budget of evaluations is used up")
    return found, log, last


def _by_homotopy(
    system: Equations[Sector], omega: float, options: ContinuationOptions, meter: CostMeter, log: list[str],
    mean: NDArray, stuck: NDArray,
) -> NDArray | None:  # fmt: skip
    """The excitation is raised from almost nothing to its full level, along the curve and around its folds; failing that,
    free bodies (all, if none is free) start on a support, where they neither bounce nor drift, and it fades.
    """
    # share of the excitation at which the support sets off; the ramp does at a tenth of it. With the whole of it the
    # ramp finds no start on the wedge dampers of eight sectors where the excitation equals the preload; with a tenth of
    # it the support finds none on one of two random structures that need it
    first = 1e-2
    level = 0.1 * first
    start = np.append(system.layout.pack(mean, level * stuck), level)
    path = _homotopy(excitation_ramp(system, omega), start, options, meter)
    if path.status == "complete":
        log.append(f"excitation ramp: full level after {len(path.points)} steps")
        return np.append(path.points[-1].y[:-1], omega)
    reached = f"{100 * path.points[-1].y[-1]:.3g} %" if path.points else "no excitation"
    why = path.reason if path.reason == DRIFTED_OFF else path.status
    log.append(f"excitation ramp: stopped at {reached} ({why})")
    if system.spent:
        return None
    supported = supported_by(system, omega, DRAG, SPRING)
    u = system.layout.pack(mean, first * stuck)
    scale = np.full(len(u) + 1, max(float(np.linalg.norm(u)), 1e-300))
    c = supported.correct_at(u, first, scale, options.tolerance, 60, True)
    meter.count(c.iterations)
    if c.status != OK:
        log.append(f"support homotopy: {STATUS_TEXT[c.status]} on the support")
        return None
    path = _homotopy(supported, c.y, replace(options, patience=SIDE_POINTS), meter)
    if path.status == "complete":
        log.append(f"support homotopy: support gone after {len(path.points)} steps")
        return np.append(path.points[-1].y[:-1], omega)
    why = "the bodies drift away" if path.status == "drifted off" else path.status
    log.append(f"support homotopy failed after {len(path.points)} points ({why})")
    return None


def _homotopy(system: Equations[Sector], start: NDArray, options: ContinuationOptions, meter: CostMeter) -> Path:
    """Along the last unknown, from where the start has it to 1."""
    limits = 0.5 * float(start[-1]), 1.0
    path = follow(system, start, limits, options=replace(options, locate=False, max_points=SIDE_POINTS))
    meter.count(path.iterations, path.failed_steps)
    return path
