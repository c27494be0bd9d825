"""Quasi-static contact analysis of a whole wheel whose dampers differ.

The law is that of :mod:`bdamper.contact.preload`, and so is the way: the load grows in steps, and every step starts from
the sliders of the step before.  The equations of a step are those of the mean alone, solved as those of the vibration are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bdamper.contact.laws import LAW_BONDED, LAW_CUBIC
from bdamper.contact.points import PointArrays
from bdamper.util.errors import SettingError, StaticError
from bdamper.wheel.constants import Constants
from bdamper.wheel.newton import TOLERANCE, correct, walked
from bdamper.wheel.static_points import StaticPoints
from bdamper.wheel.structure import Structure
from bdamper.wheel.system import WheelSystem

STEPS = 8


@dataclass(frozen=True, eq=False)
class WheelState:
    """Static state of a wheel.

    Parameters
    ----------
    q : (n_blades, n_sector) float
    slider : (n_blades n_points, 2) float, m
    force : (n_blades n_points, 3) float, N
    """

    q: NDArray
    slider: NDArray
    force: NDArray


def static_wheel(
    structure: Structure, points: PointArrays, load: NDArray, shift: NDArray, constant: NDArray, pinned: NDArray,
    history: Sequence[float],
) -> WheelState:  # fmt: skip
    """State after the load has passed through factors of itself.

    Parameters
    ----------
    structure : Structure
    points : PointArrays
        Of all sectors.
    load, constant : (n_blades, n_sector) float
        Static forces, and those that do not grow with the load.
    shift : (n_blades, n_points, 3) float, m
        Motion that the coordinates do not carry, under the whole load.
    pinned : (n_blades,) bool
    history : sequence of float

    Raises
    ------
    StaticError
        If a step has no solution.
    SettingError
        If there are cubic springs.
    """
    if (points.law == LAW_CUBIC).any():
        raise SettingError("dampers: expected all alike in a model with cubic springs, found dampers that differ")
    constants = Constants.of(structure, points, np.array([True, False, False]), pinned)
    scale = max(float(np.abs(load).max() + np.abs(constant).max()), 1e-300)
    touching = np.where(points.n0 < 0.0, 0.0, points.n0)
    scale = max(scale, 1e-9 * float(np.abs(touching).max(initial=0.0)))
    X = np.zeros((structure.n_blades, 3, structure.n_sector))
    start, done = replace(points, slider=np.zeros_like(points.slider)), 0.0
    force = np.zeros((len(points.kn), 3))

    def system_at(factor: float, points: PointArrays) -> WheelSystem:
        still, weight = np.zeros(load.shape, complex), factor * load + constant
        return WheelSystem(constants, StaticPoints(points), factor * shift, weight, still, (scale, scale))

    for target in history:
        step = (target - done) / STEPS
        least = abs(step) / 64.0
        while done != target:
            now = target if abs(target - done) <= 1.000001 * abs(step) else done + step
            system = system_at(now, start)
            found = correct(system, X, 0.0, tolerance=0.1 * TOLERANCE, most=40, line_search=True)
            if not found.converged:
                found = walked(system, X, 0.0, tolerance=0.1 * TOLERANCE)
            if not found.converged:
                step *= 0.5
                if abs(step) < least:
                    raise StaticError(
                        f"expected a static state of the wheel, found none beyond {100 * done:.3g} % of the preload "
                        f"(residual {found.residual:.2g})"
                    )
                continue
            X, done = found.X, now
            x = system.motion(X)
            x[..., 0] += system.shift
            u = x.reshape(-1, *x.shape[2:])
            force = system.contact.forces(u, False)[0][..., 0]
            stiff = np.where(points.kt > 0.0, points.kt, 1.0)
            slider = np.where(points.kt > 0.0, u[:, :2, 0] - force[:, :2] / stiff, u[:, :2, 0])
            slider[points.law == LAW_BONDED] = 0.0
            start = replace(start, slider=slider)
    return WheelState(X[:, 0], start.slider, force)
