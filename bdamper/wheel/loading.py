"""A wheel under a preload: its static state and the equations of its vibration."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from bdamper.contact.laws import LAW_NORMAL
from bdamper.contact.points import PointArrays
from bdamper.contact.preload import PreloadState
from bdamper.harmonic_balance.many_points import ManyPoints
from bdamper.wheel.structure import Structure
from bdamper.wheel.system import WheelSystem


def sector_points(structure: Structure, state: PreloadState) -> PointArrays:
    """The contact points of one sector of the tuned wheel in a static state."""
    tuned = structure.tuned
    _, shift = tuned.damper_load
    shift = state.load * shift
    if not tuned.bias:
        shift = shift + tuned.static_basis.G.real @ state.q
    return PointArrays(
        kt=tuned.point_stiffness[:, :2] * (tuned.point_laws != LAW_NORMAL)[:, None],
        kn=tuned.point_stiffness[:, 2],
        mu=tuned.friction,
        n0=-tuned.point_stiffness[:, 2] * tuned.point_gaps,
        slider=np.where(tuned.bonded_points[:, None], 0.0, state.slider),
        law=tuned.point_laws,
        shift=shift,
    )


def local_vector(structure: Structure, modal: NDArray, force: bool) -> NDArray:
    """(n_sector,) mean motion or static force of a sector from the tuned study's modes at nodal diameter 0."""
    phi, n = structure.modes(0), structure.n
    own = np.array(
        [structure.tuned.model.bodies[c.body].local is None for c in structure.tuned.static_basis.coordinates], bool
    )
    blade = structure.local.mass(0) @ phi if force else phi
    assert len(blade) == n
    return np.concatenate([(blade @ modal[~own]).real, modal[own]])


def wheel_system(
    structure: Structure, preload: float, dampers: Any, excitation: NDArray, scale: float
) -> tuple[WheelSystem, NDArray]:
    """Equations under a preload, and the mean motion (n_blades, n_sector) of the static state.

    Parameters
    ----------
    structure : Structure
    preload : float, N
    dampers : DamperVariation or None
    excitation : (n_blades, n_sector) complex, N kg^-1/2
    scale : float
        Force of the harmonics to which the residual is related.
    """
    tuned, N = structure.tuned, structure.n_blades
    state = tuned.equilibrium(preload)
    points = sector_points(structure, state)
    load, _ = tuned.damper_load
    force = state.load * load + tuned.constant_force
    whole = PointArrays(
        **{
            name: np.concatenate([getattr(points, name)] * N)
            for name in ("kt", "kn", "mu", "n0", "slider", "law", "shift")
        }
    )
    active = np.repeat([l in tuned.active_harmonics for l in range(tuned.harmonic_numbers[-1] + 1)], 2)[1:]
    pressed = np.einsum("pdm,pd->m", tuned.static_basis.G.real, state.force)
    mean = max(float(np.abs(force).max()), float(np.abs(pressed).max()), scale)
    system = WheelSystem(
        structure,
        ManyPoints(whole, tuned.harmonic_numbers[-1], tuned.evaluation),
        whole.shift.reshape(N, -1, 3),
        np.tile(local_vector(structure, force, True), (N, 1)),
        excitation,
        (mean or 1.0, scale or mean or 1.0),
        active,
        np.zeros(N, bool),
    )
    return system, np.tile(local_vector(structure, state.q, False), (N, 1))
