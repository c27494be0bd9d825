"""Newton's method on the equations of a wheel, steps found iteratively.

A step is solved by GMRES with the approximate inverse of :mod:`bdamper.wheel.system` to a tolerance that follows the
residual; the approximate inverse of one step serves those after it while it serves well.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bdamper.util.progress import end_if_asked
from bdamper.wheel.krylov import gmres
from bdamper.wheel.system import PLAIN, Ease, Inverse, Linearised, WheelSystem

LOOSE = 1e-2
"""Largest relative residual of a Newton step's linear equations."""
WORN = 7
"""Iterations of GMRES after which an approximate inverse is made anew, which costs five of them (65 blades).  The highest
peak of a wheel takes 37 s with 7, 44 with 12, 48 with 4."""


@dataclass(frozen=True, eq=False)
class Corrected:
    """Outcome of a Newton iteration.

    Parameters
    ----------
    converged : bool
    X : (n_blades, n_coefficients, n_sector) float
    omega : float, rad/s
    iterations : int
    residual : float
    at : Linearised
        At the returned point.
    inverse : Inverse or None
        The last approximate inverse.
    """

    converged: bool
    X: NDArray
    omega: float
    iterations: int
    residual: float
    at: Linearised
    inverse: Inverse | None


def correct(
    system: WheelSystem,
    X: NDArray,
    omega: float,
    plane: tuple[NDArray, float] | None = None,
    *,
    tolerance: float = 1e-9,
    least: int = 0,
    most: int = 12,
    line_search: bool = False,
    ease: Ease = PLAIN,
    inverse: Inverse | None = None,
    longest: float = np.inf,
    content: float = 0.0,
) -> Corrected:
    """Newton at a fixed frequency, or in a plane of unknowns and frequency.

    Parameters
    ----------
    system : WheelSystem
    X, omega : start
    plane : (normal, normal_omega), optional
        Steps are at right angles to it; without it the frequency stays.
    tolerance : float
        On the residual, relative to excitation and static load.
    least, most : int
        Iterations.
    line_search : bool
        Shorten steps that do not reduce the residual.
    ease : Ease
        Of the equations.
    inverse : Inverse, optional
        An approximate inverse from nearby, used while it serves.
    longest : float
        A step of the vibration longer than this ends the iteration, not converged.
    content : float
        A whole step shorter than this, relative to the vibration, ends it as converged.  The residual says little on the
        way: contacts are stiff.
    """
    end_if_asked()
    at = system.linearised(X, omega, ease)
    size = system.size(at.residual)
    worn = inverse is None
    for iteration in range(most + 1):
        if (size <= tolerance and iteration >= least) or iteration == most or not np.isfinite(size):
            return Corrected(size <= tolerance, X, omega, iteration, size, at, inverse)
        if worn or inverse is None:
            inverse, worn = at.inverse(), False
        wanted = 1e-3 if line_search else max(0.01 * tolerance / size, min(LOOSE, 10.0 * size)) if iteration else LOOSE
        dX, d_omega, count = solved(at, inverse, plane, min(LOOSE, wanted))
        worn = line_search or count > WORN
        before, factor = size, 1.0
        if longest < np.inf and np.sqrt((dX[:, 1:] ** 2).sum()) > longest:
            return Corrected(False, X, omega, iteration, size, at, inverse)
        if line_search:
            factor = _shortened(system, X, omega, inverse, dX, d_omega, ease)
        X, omega = X + factor * dX, omega + factor * d_omega
        at = system.linearised(X, omega, ease)
        size = system.size(at.residual)
        if factor == 1.0 and np.isfinite(size) and np.linalg.norm(dX[:, 1:]) < content * np.linalg.norm(X[:, 1:]):
            return Corrected(True, X, omega, iteration + 1, size, at, inverse)
        if not line_search and size > 1e3 * before and iteration > 1:
            return Corrected(False, X, omega, iteration + 1, size, at, inverse)
    raise AssertionError


def walked(system: WheelSystem, X: NDArray, omega: float, *, tolerance: float, most: int = 60) -> Corrected:
    """Newton at a fixed frequency with dampers that nothing holds along a direction: they walk until something does.

    The mean of every damper is held by springs in the Jacobian, which are weakened as long as its mean force stays, so
    that steps along a free direction grow, and stiffened where a step does not help.
    """
    end_if_asked()
    held = 1e-2
    at = system.linearised(X, omega, held=held)
    size = system.size(at.residual)
    for iteration in range(most):
        if size <= tolerance or not held < 1e6:
            break
        inverse = at.inverse()
        dX, _, _ = solved(at, inverse, None, LOOSE * min(1.0, 10.0 * size) + 1e-8)
        new = system.linearised(X + dX, omega, held=held)
        now = system.size(new.residual)
        if not now < 1.5 * size:
            held *= 10.0
            at = system.linearised(X, omega, held=held)
            continue
        held *= 0.2 if now > 0.5 * size else 1.0
        X, size = X + dX, now
        at = replace(new, springs=held * system.damper_springs)
    return Corrected(size <= tolerance, X, omega, iteration, size, at, None)


def _shortened(
    system: WheelSystem, X: NDArray, omega: float, inverse: Inverse, dX: NDArray, d_omega: float, ease: Ease
) -> float:
    """1, or the best of shorter factors of a step where the step that would follow with the same inverse is no shorter."""
    norm = float(np.linalg.norm(dX))
    best, factor = np.inf, 1.0
    for trial in 0.5 ** np.arange(8):
        now = float(np.linalg.norm(inverse(system.residual(X + trial * dX, omega + trial * d_omega, ease))))
        if now < best:
            best, factor = now, float(trial)
        if now < (1.0 - 0.25 * trial) * norm:
            break
    return factor


def solved(
    at: Linearised,
    inverse: Inverse,
    plane: tuple[NDArray, float] | None,
    tolerance: float,
    right: tuple[NDArray, float] | None = None,
) -> tuple[NDArray, float, int]:
    """Newton step, or the solution for another right-hand side of unknowns and plane; with the iterations it took."""
    system = at.system
    shape = system.shape
    b = -at.residual if right is None else right[0]

    if plane is None:
        x, count, _ = gmres(
            lambda x: at.product(x.reshape(shape)).ravel(),
            lambda r: inverse(r.reshape(shape)).ravel(),
            b.ravel(),
            tolerance,
        )
        system.iterations += count
        return x.reshape(shape), 0.0, count
    normal, normal_omega = plane[0].ravel(), plane[1]
    aside = inverse(at.by_omega).ravel()
    pivot = normal_omega - float(normal @ aside)
    unit = float(np.linalg.norm(aside)) or 1.0  # weighs the frequency as the motion that it brings

    def product(x: NDArray) -> NDArray:
        d = x[-1] / unit
        r = at.product(x[:-1].reshape(shape)) + d * at.by_omega
        return np.append(r.ravel(), normal @ x[:-1] + normal_omega * d)

    def solve(r: NDArray) -> NDArray:
        x = inverse(r[:-1].reshape(shape)).ravel()
        d = (r[-1] - normal @ x) / pivot
        return np.append(x - d * aside, d * unit)

    b = np.append(b.ravel(), 0.0 if right is None else right[1])
    x, count, _ = gmres(product, solve, b, tolerance)
    system.iterations += count
    return x[:-1].reshape(shape), float(x[-1]) / unit, count
