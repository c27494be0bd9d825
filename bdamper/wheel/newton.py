"""Newton's method on the equations of a wheel, steps found iteratively.

A step is solved iteratively (:mod:`bdamper.wheel.system`), loosely: the next one costs no more than a better one.  On the
shipped disk (65 blades, 500 N to 2 kN) climbs and curves take a fifth to a half less time so than with tolerances that
follow the residual.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bdamper.util.progress import end_if_asked
from bdamper.wheel.krylov import gmres
from bdamper.wheel.system import PLAIN, Ease, Inverse, Linearised, WheelSystem

Plane = tuple[NDArray, float]

TOLERANCE = 1e-9
"""On the residual, relative to excitation and static load."""
LOOSE = 1e-2
"""Largest relative residual of a Newton step's linear equations."""
SLOW = 0.2
"""Ratio of a step to the one before above which the Jacobian of an earlier point serves no more."""


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
    plane: Plane | None = None,
    *,
    tolerance: float = TOLERANCE,
    least: int = 0,
    most: int = 12,
    line_search: bool = False,
    ease: Ease = PLAIN,
    inverse: Inverse | None = None,
    longest: float = np.inf,
    free: int = 0,
    content: float = 0.0,
    rough: float = np.inf,
) -> Corrected:
    """Newton at a fixed frequency, or in a plane of unknowns and frequency.

    Parameters
    ----------
    system : WheelSystem
    X, omega : start
    plane : (normal, normal_omega), optional
        Steps are at right angles to it, whose motion (n_blades, n_coefficients, n_root) is that of the root shapes; without
        it the frequency stays.
    tolerance : float
        On the residual, relative to excitation and static load.
    least, most : int
        Iterations.
    line_search : bool
        Shorten steps that do not reduce the residual.
    ease : Ease
        Of the equations.
    inverse : Inverse, optional
        The one made last, of the Jacobian nearby, used while it serves.
    longest, free : float, int
        A step of the vibration longer than this ends the iteration, not converged, after so many of any length.
    content, rough : float
        A whole step shorter than the first, relative to the vibration, that leads to a residual below the second ends it as
        converged.  The residual says little on the way: contacts are stiff.
    """
    end_if_asked()
    at = system.linearised(X, omega, ease)
    size = system.size(at.residual)
    last = np.inf
    for iteration in range(most + 1):
        if (size <= tolerance and iteration >= least) or iteration == most or not np.isfinite(size):
            return Corrected(size <= tolerance, X, omega, iteration, size, at, inverse)
        if inverse is None or line_search:
            inverse = at.inverse()
        dX, d_omega, _ = solved(at, inverse, plane, LOOSE)
        if inverse.at is not at and not size_of(dX) < SLOW * last:
            inverse = at.inverse()
            dX, d_omega, _ = solved(at, inverse, plane, LOOSE)
        last = size_of(dX)
        before, factor = size, 1.0
        if last > longest and iteration >= free:
            return Corrected(False, X, omega, iteration, size, at, inverse)
        if line_search:
            factor, at = _shortened(system, X, omega, inverse, dX, d_omega, ease)
        else:
            at = system.linearised(X + dX, omega + d_omega, ease)
        X, omega = X + factor * dX, omega + factor * d_omega
        size = system.size(at.residual)
        if factor == 1.0 and size < rough and last < content * size_of(X):
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
        at = replace(new, springs=held * system.constants.damper_springs)
    return Corrected(size <= tolerance, X, omega, iteration, size, at, None)


def size_of(X: NDArray) -> float:
    """Norm of the vibration."""
    return float(np.sqrt((X[:, 1:] ** 2).sum()))


def _shortened(
    system: WheelSystem, X: NDArray, omega: float, inverse: Inverse, dX: NDArray, d_omega: float, ease: Ease
) -> tuple[float, Linearised]:
    """1, or the best of shorter factors of a step where the step that would follow with the same inverse is no shorter.

    With the equations there: derivatives are a tenth of the price of a trial, and a trial that serves is not repeated.
    """
    norm, least, factor = float(np.linalg.norm(dX)), np.inf, 1.0
    for trial in 0.5 ** np.arange(8):
        new = system.linearised(X + trial * dX, omega + trial * d_omega, ease)
        now = float(np.nan_to_num(np.linalg.norm(inverse(new.residual)), nan=np.inf))
        if now < least or trial == 1.0:
            least, factor, at = now, float(trial), new
        if now < (1.0 - 0.25 * trial) * norm:
            break
    return factor, at


def solved(
    at: Linearised,
    inverse: Inverse,
    plane: Plane | None,
    tolerance: float,
    right: tuple[NDArray, float] | None = None,
) -> tuple[NDArray, float, int]:
    """Newton step, or the solution for another right-hand side of unknowns and plane; with the iterations it took.

    What the approximate inverse leaves out for good (:mod:`bdamper.wheel.system`) is put right where the tolerance is below
    ``LOOSE``, by the same steps for what is left of the right-hand side.
    """
    system, root = at.system, at.system.constants.root
    b, wanted = (-at.residual, 0.0) if right is None else right
    shape = b[..., root].shape
    normal, normal_omega = plane or (np.zeros(shape), 1.0)
    aside = np.zeros(system.shape) if plane is None else inverse.by_omega  # the frequency is eliminated first
    pivot = normal_omega - float((normal * aside[..., root]).sum()) if plane is not None else 1.0
    count = 0

    def ahead(y: NDArray, wanted: float) -> float:
        """Change of the frequency that leads into the plane."""
        return (wanted - float((normal * y).sum())) / pivot if plane is not None else 0.0

    def product(y: NDArray) -> NDArray:
        out = inverse.on_root(inverse.left_out(y.reshape(shape)))
        return y + (out - ahead(out, 0.0) * aside[..., root]).ravel()

    def step(b: NDArray, wanted: float) -> tuple[NDArray, float]:
        nonlocal count
        whole = inverse(b) if b.any() else b
        start = whole[..., root] - ahead(whole[..., root], wanted) * aside[..., root]
        y, needed, _ = gmres(product, start.ravel(), LOOSE)
        count += needed
        r = np.zeros(system.shape)
        r[..., root] = inverse.left_out(y.reshape(shape))
        x = whole - inverse(r)
        d = ahead(x[..., root], wanted)
        return x - d * aside, d

    x, d = step(b, wanted)
    size = last = size_of(x)
    while tolerance < LOOSE and size > 0.0:
        more, faster = step(b - at.product(x) - d * at.by_omega, 0.0)
        now = size_of(more)
        if not now < 0.5 * last:
            break
        x, d = x + more, d + faster
        if now**2 <= tolerance * last * size:
            break
        last = now
    system.iterations += count
    return x, d, count


def plane_across(direction: tuple[NDArray, float], X: NDArray, unit_omega: float, system: WheelSystem) -> Plane:
    """Plane at right angles to a direction, in the vibration of the root shapes and the frequency in units of their own.

    Root shapes alone, since equations are solved for them (:mod:`bdamper.wheel.system`).
    """
    normal = direction[0][..., system.constants.root] / size_of(X[..., system.constants.root]) ** 2
    normal[:, 0] = 0.0
    return normal, direction[1] / unit_omega**2
