"""Quasi-static contact analysis of a whole wheel whose dampers differ.

Constant loads and interference grow first, then the load.  Each load step starts from the sliders of the step before and
ends at the first change of state of a contact point (:func:`bdamper.contact.static_state.linear_range`).  Its equations are
those of the wheel without harmonics.

Newton's method starts the first step from the state of equal dampers: from zero it does not converge on 65 blades with
friction coefficients or masses that differ by 0.5 to 10 %, and shorter steps do not help.  Without gaps a state is
proportional to its load, so each further step starts from the last state times the ratio of the loads.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bdamper.contact.law_codes import LAW_BONDED, LAW_CUBIC
from bdamper.contact.point_parameters import PointArrays
from bdamper.contact.static_state import AT_LIMIT, SHORTEST, linear_range
from bdamper.harmonic_balance.equations import OK
from bdamper.mistuning.structure import Structure
from bdamper.mistuning.wheel_equations import WheelScene
from bdamper.util.errors import SettingError, StaticError

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
    bonded, shift = points.law == LAW_BONDED, shift.reshape(-1, 3)
    free = np.logical_not(bonded)
    pressed = free & (points.n0 > 0.0) & (points.kn > 0.0)
    interference = np.zeros_like(shift)
    interference[pressed, 2] = points.n0[pressed] / points.kn[pressed]
    bare = replace(points, n0=np.where(pressed, 0.0, points.n0))
    frictional = replace(bare, kt=bare.kt * free[:, None], kn=bare.kn * free, n0=bare.n0 * free)
    springs = np.concatenate([frictional.kt, frictional.kn[:, None]], axis=1)
    scale = max(float(np.abs(load).max() + np.abs(constant).max()), 1e-9 * float(points.n0.max(initial=0.0)), 1e-300)
    still, u, done = np.zeros(load.shape, complex), np.zeros(load.size), np.zeros(2)
    slider, force, x = np.zeros((len(points.kn), 2)), np.zeros((len(points.kn), 3)), np.zeros((len(points.kn), 3))
    first = [(1.0, 0.0)] if pressed.any() or np.any(constant) else []
    for target in np.array([*first, *((1.0, factor) for factor in history)]):
        begin, part, longest = done, 0.0, 1.0 / STEPS
        step = longest
        while part < 1.0 and np.any(target != begin):
            step = min(step, longest)
            end = 1.0 if step > (1.0 - SHORTEST) * (1.0 - part) else part + step
            share, factor = now = begin + end * (target - begin)
            carried = factor * shift + share * interference
            system = WheelScene(
                structure, replace(bare, slider=slider, shift=carried), (0,), factor * load + share * constant, still,
                np.zeros(structure.n), pinned, (scale, scale), 0.0 * load,
            ).equations  # fmt: skip
            start = factor / done[1] * u if done[1] else u + factor * alike.ravel()
            found = system.correct_at(start, 1.0, np.full(len(u) + 1, max(float(np.abs(start).max()), 1e-9)), LEFT, 60, 2)
            if found.status != OK:
                step *= 0.5
                if step < longest / 64.0:
                    raise StaticError(
                        f"expected a static state of the wheel, found none beyond {100 * done[1]:.3g} % of the preload "
                        f"(residual {found.residual:.2g})"
                    )
                continue
            motion, forces, _ = system.contact(found.y[:-1])
            moved = motion[..., 0]
            close = AT_LIMIT * float((springs * (np.abs(x) + np.abs(moved) + np.abs(carried))).max(initial=0.0))
            within, beyond = linear_range(frictional, x, moved, slider, close)
            if within < 1.0 and step > SHORTEST:
                step *= 0.1 * within
                continue
            step = longest if within < 1.0 else max((end - part) * (beyond - 1.0), SHORTEST)
            u, done, part, x, force = found.y[:-1], now, end, moved, forces[..., 0]
            stretch = force[:, :2] / np.where(points.kt > 0.0, points.kt, 1.0)
            slider = np.where(points.kt > 0.0, x[:, :2] - stretch, x[:, :2])
            slider[bonded] = 0.0
    return u.reshape(load.shape), slider, force
