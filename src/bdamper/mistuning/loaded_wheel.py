"""A wheel under a preload: its contact points, its static state, and the equations of its vibration."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bdamper.contact.law_codes import LAW_NORMAL
from bdamper.contact.point_parameters import PointArrays
from bdamper.mistuning.mistuning import DamperVariation
from bdamper.mistuning.static import Loading, static_wheel
from bdamper.mistuning.structure import Structure
from bdamper.mistuning.wheel_equations import WheelScene, WheelSystem


def wheel_points(structure: Structure, dampers: DamperVariation) -> PointArrays:
    """Contact points of all sectors, sector by sector, with sliders at zero and no shift."""
    tuned, N = structure.tuned, structure.n_blades
    n_points = len(structure.sector)
    # points of the damper; others belong to blades alone
    own = structure.rows[..., structure.n :].any(axis=(1, 2)) if structure.n_damper else np.zeros(n_points, bool)

    def spread(factor: NDArray, neutral: float) -> NDArray:
        return np.where(own, factor[:, None], neutral)

    there = spread(np.where(dampers.missing, 0.0, 1.0), 1.0)
    k = spread(dampers.contact_stiffness, 1.0) * there
    kn = k * tuned.point_stiffness[:, 2]
    kt = k[..., None] * tuned.point_stiffness[:, :2] * (tuned.point_laws != LAW_NORMAL)[:, None]
    return PointArrays(
        kt=kt.reshape(-1, 2),
        kn=kn.ravel(),
        mu=(spread(dampers.friction_coefficient, 1.0) * there * tuned.friction).ravel(),
        n0=(-kn * (tuned.point_gaps + spread(dampers.gap, 0.0))).ravel(),
        slider=np.zeros((N * n_points, 2)),
        law=np.tile(tuned.point_laws, N),
        shift=np.zeros((N * n_points, 3)),
    )


def local_vector(structure: Structure, modal: NDArray, force: bool) -> NDArray:
    """(n_sector,) mean motion or static force of a sector from the tuned study's modes at nodal diameter 0."""
    phi = structure.modes(0)
    coordinates, bodies = structure.tuned.static_basis.coordinates, structure.tuned.model.bodies
    own = np.array([bodies[c.body].local is None for c in coordinates], bool)
    blade = structure.local.mass(0) @ phi if force else phi
    return np.concatenate([(blade @ modal[~own]).real, modal[own]])


@dataclass(frozen=True, eq=False)
class Loaded:
    """A wheel at rest under a preload.

    Parameters
    ----------
    points : PointArrays
        Of all sectors, with the sliders of the static state and the motion that the coordinates do not carry.
    load : (n_blades, n_sector) float
        Static forces.
    mean : (n_blades, n_sector) float
        Of the static state.
    force : (n_blades, n_points, 3) float, N
        Of the contacts there.
    missing : (n_blades,) bool
        Dampers that are not there.
    """

    points: PointArrays
    load: NDArray
    mean: NDArray
    force: NDArray
    missing: NDArray


def loaded(structure: Structure, preload: float, dampers: DamperVariation | None) -> Loaded:
    """The static state under a preload (N) of a damper of the nominal mass.

    Raises
    ------
    StaticError
        If no static state was found.
    """
    tuned, N, n = structure.tuned, structure.n_blades, structure.n
    given = DamperVariation.of(N) if dampers is None else dampers
    pinned, points = given.missing, wheel_points(structure, given)
    modal, shift = tuned.damper_load
    load = np.tile(local_vector(structure, preload * modal, True), (N, 1))
    constant = np.tile(local_vector(structure, tuned.fixed_load[0], True), (N, 1))
    factor = np.where(pinned, 0.0, given.mass)
    load[:, n:] *= factor[:, None]
    constant[pinned, n:] = 0.0
    moved = preload * factor[:, None, None] * shift
    state = tuned.equilibrium(preload)
    mean = np.tile(local_vector(structure, state.q, False), (N, 1))
    if dampers is None:
        slider, force = np.tile(state.slider, (N, 1)), np.tile(state.force, (N, 1))
    else:
        mean[pinned, n:] = 0.0
        loading = Loading(load, constant, moved, tuned.settings.load_history)
        mean, slider, force = static_wheel(structure, points, loading, pinned, mean)
    slider = np.where(np.tile(tuned.bonded_points, N)[:, None], 0.0, slider)
    points = replace(points, slider=slider, shift=moved.reshape(-1, 3))
    return Loaded(points, load + constant, mean, force.reshape(N, -1, 3), pinned)


def wheel_system(structure: Structure, state: Loaded, excitation: NDArray, response_row: NDArray) -> WheelSystem:
    """Equations of the vibration about a static state under an excitation (n_blades, n_sector) complex, N kg^-1/2."""
    tuned = structure.tuned
    scale = float(np.abs(excitation).max())
    pressed = structure.gathered(state.force)
    largest = max(float(np.abs(state.load).max()), float(np.abs(pressed).max()), scale)
    shift = state.points.shift
    if not tuned.settings.bias:
        shift = shift + structure.motion(state.mean).reshape(-1, 3)
    return WheelScene(
        structure, replace(state.points, shift=shift), tuned.settings.active_harmonics, state.load, excitation,
        response_row, state.missing, (largest, scale), state.mean, tuned.settings.contact_forces,
    ).equations  # fmt: skip
