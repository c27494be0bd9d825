"""Quasi-static contact analysis of a whole wheel whose dampers differ.

The load grows in steps, and every step starts from the sliders of the step before.  The equations of a step are those of
the wheel without harmonics: contacts at rest follow the law of :mod:`bdamper.contact.preload`.  Newton's method of the
first step starts from the state of dampers that are alike.  From nothing, where all contacts just touch, it does not arrive
on 65 blades with friction coefficients or masses 0.5 to 10 % apart, and shorter steps are no easier: where no faces are
apart a state is proportional to its load, so that every other step starts from that of the step before times the ratio of
their loads.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bdamper.contact.laws import LAW_BONDED, LAW_CUBIC
from bdamper.contact.points import PointArrays
from bdamper.harmonic_balance.equations import OK
from bdamper.util.errors import SettingError, StaticError
from bdamper.wheel.structure import Structure
from bdamper.wheel.system import WheelScene

STEPS = 8
LEFT = 1e-10
"""On the residual, relative to the load."""


class Loading(NamedTuple):
    """What presses the dampers of a wheel.

    Parameters
    ----------
    load, constant : (n_blades, n_sector) float
        Static forces, and those that do not grow with the load.
    shift : (n_blades, n_points, 3) float, m
        Motion that the coordinates do not carry, under the whole load.
    history : sequence of float
        Factors of the load through which it passes.
    """

    load: NDArray
    constant: NDArray
    shift: NDArray
    history: Sequence[float]


def static_wheel(
    structure: Structure, points: PointArrays, loading: Loading, pinned: NDArray, alike: NDArray
) -> tuple[NDArray, NDArray, NDArray]:
    """State after the load has passed through factors of itself.

    Parameters
    ----------
    structure : Structure
    points : PointArrays
        Of all sectors.
    loading : Loading
    pinned : (n_blades,) bool
    alike : (n_blades, n_sector) float
        State under the whole load of dampers that do not differ.

    Returns
    -------
    q : (n_blades, n_sector) float
    slider : (n_blades n_points, 2) float, m
    force : (n_blades n_points, 3) float, N

    Raises
    ------
    StaticError
        If a step has no solution.
    SettingError
        If there are cubic springs.
    """
    load, constant, shift, history = loading
    if (points.law == LAW_CUBIC).any():
        raise SettingError("dampers: expected all alike in a model with cubic springs, found dampers that differ")
    pressed = float(points.n0.max(initial=0.0))
    scale = max(float(np.abs(load).max() + np.abs(constant).max()), 1e-9 * pressed, 1e-300)
    still, u, done = np.zeros(load.shape, complex), np.zeros(load.size), 0.0
    slider, force = np.zeros((len(points.kn), 2)), np.zeros((len(points.kn), 3))
    for target in history:
        step = (target - done) / STEPS
        least = abs(step) / 64.0
        while done != target:
            now = target if abs(target - done) <= 1.000001 * abs(step) else done + step
            at = replace(points, slider=slider, shift=now * shift.reshape(-1, 3))
            system = WheelScene(
                structure, at, (0,), now * load + constant, still, np.zeros(structure.n), pinned, (scale, scale),
                0.0 * load,
            ).equations  # fmt: skip
            start = now / done * u if done else now * alike.ravel()
            found = system.correct_at(start, 1.0, np.full(len(u) + 1, max(float(np.abs(start).max()), 1e-9)), LEFT, 60, 2)
            if found.status != OK:
                step *= 0.5
                if abs(step) < least:
                    raise StaticError(
                        f"expected a static state of the wheel, found none beyond {100 * done:.3g} % of the preload "
                        f"(residual {found.residual:.2g})"
                    )
                continue
            u, done = found.y[:-1], now
            motion, forces, _ = system.contact(u)
            force, moved = forces[..., 0], motion[..., :2, 0]
            slider = np.where(points.kt > 0.0, moved - force[:, :2] / np.where(points.kt > 0.0, points.kt, 1.0), moved)
            slider[points.law == LAW_BONDED] = 0.0
    return u.reshape(load.shape), slider, force
