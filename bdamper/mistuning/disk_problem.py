"""Static state and equations of a mistuned bladed disk, before any analysis of its vibration.

If dampers differ, the static contact analysis covers all sectors.  Constant loads and interference
are applied first, then the preload.  Each load step starts from the sliders of the last one and
ends at the first change of a contact state (:func:`bdamper.contact.static_state.linear_range`).
Its equations are the harmonic balance equations without harmonics.

Newton iteration starts the first step from the state of equal dampers.  From zero it does not
converge on 65 blades with friction coefficients or masses that differ by 0.5 to 10 %, and shorter
steps do not help.  Without gaps a state is proportional to its load, so each further step starts
from the last state times the ratio of the loads.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bdamper.contact.laws import LAW_BONDED, LAW_CUBIC, LAW_NORMAL, PointArrays
from bdamper.contact.static_state import AT_LIMIT, SHORTEST, linear_range
from bdamper.harmonic_balance.checks import Asking, like, problem_of
from bdamper.harmonic_balance.equations import OK
from bdamper.harmonic_balance.model_sizes import Sizes
from bdamper.harmonic_balance.problem import Problem
from bdamper.mistuning.disk_equations import DiskScene, DiskSystem, Structure
from bdamper.mistuning.mistuning import DamperVariation, Mistuning
from bdamper.response.highest_peak import highest_peak
from bdamper.response.peak import Peak
from bdamper.util import validation
from bdamper.util.display import Summarised
from bdamper.util.errors import SettingError, StaticError
from bdamper.util.progress import one_thread

# ---- Static state ----

STEPS = 8
LEFT = 1e-10
"""Tolerance of the residual, relative to the load."""


class Loading(NamedTuple):
    """Loads on the dampers of a bladed disk.

    Parameters
    ----------
    load, constant : (n_blades, n_sector) float
        Static forces proportional to the load factor, and constant ones.
    shift : (n_blades, n_points, 3) float, m
        Motion that the coordinates do not represent, under the full load.
    history : sequence of float
        Load factors, in their order.
    """

    load: NDArray
    constant: NDArray
    shift: NDArray
    history: Sequence[float]


def static_disk(
    structure: Structure, points: PointArrays, loading: Loading, pinned: NDArray, alike: NDArray
) -> tuple[NDArray, NDArray, NDArray]:
    """Compute the static state of a bladed disk with unequal dampers after a history of load
    factors.

    Parameters
    ----------
    structure : Structure
    points : PointArrays
        Contact points of all sectors.
    loading : Loading
    pinned : (n_blades,) bool
        Missing dampers, whose coordinates stay zero.
    alike : (n_blades, n_sector) float
        Static state of a disk with equal dampers under the full load, the first guess.

    Returns
    -------
    q, slider, force : (n_blades, n_sector), (n_blades n_points, 2), (n_blades n_points, 3) float
        Static state, positions of the sliders (m) and contact forces (N).

    Raises
    ------
    StaticError
        If no equilibrium was found for a load step.
    SettingError
        If there are cubic springs.
    """
    load, constant, shift, history = loading
    if (points.law == LAW_CUBIC).any():
        raise SettingError(
            "dampers must be equal in a model with cubic springs; found dampers that differ"
        )
    bonded, shift = points.law == LAW_BONDED, shift.reshape(-1, 3)
    free = np.logical_not(bonded)
    pressed = free & (points.n0 > 0.0) & (points.kn > 0.0)
    interference = np.zeros_like(shift)
    interference[pressed, 2] = points.n0[pressed] / points.kn[pressed]
    bare = replace(points, n0=np.where(pressed, 0.0, points.n0))
    frictional = replace(bare, kt=bare.kt * free[:, None], kn=bare.kn * free, n0=bare.n0 * free)
    springs = np.concatenate([frictional.kt, frictional.kn[:, None]], axis=1)
    scale = max(
        float(np.abs(load).max() + np.abs(constant).max()),
        1e-9 * float(points.n0.max(initial=0.0)),
        1e-300,
    )
    no_excitation, u, done = np.zeros(load.shape, complex), np.zeros(load.size), np.zeros(2)
    slider, force, x = (
        np.zeros((len(points.kn), 2)),
        np.zeros((len(points.kn), 3)),
        np.zeros((len(points.kn), 3)),
    )
    first = [(1.0, 0.0)] if pressed.any() or np.any(constant) else []
    for target in np.array([*first, *((1.0, factor) for factor in history)]):
        begin, part, longest = done, 0.0, 1.0 / STEPS
        step = longest
        while part < 1.0 and np.any(target != begin):
            step = min(step, longest)
            end = 1.0 if step > (1.0 - SHORTEST) * (1.0 - part) else part + step
            share, factor = now = begin + end * (target - begin)
            total_shift = factor * shift + share * interference
            system = DiskScene(
                structure, replace(bare, slider=slider, shift=total_shift), (0,), factor * load + share * constant,
                no_excitation, np.zeros(structure.n), pinned, (scale, scale), 0.0 * load,
            ).equations  # fmt: skip
            start = factor / done[1] * u if done[1] else u + factor * alike.ravel()
            unit = np.full(len(u) + 1, max(float(np.abs(start).max()), 1e-9))
            solution = system.correct_at(start, 1.0, unit, LEFT, 60, 2)
            if solution.status != OK:
                step *= 0.5
                if step < longest / 64.0:
                    raise StaticError(
                        f"no static state of the bladed disk was found beyond {100 * done[1]:.3g} % of the preload "
                        f"(residual {solution.residual:.2g})"
                    )
                continue
            motion, forces, _ = system.contact(solution.y[:-1])
            new_x = motion[..., 0]
            close = AT_LIMIT * float(
                (springs * (np.abs(x) + np.abs(new_x) + np.abs(total_shift))).max(initial=0.0)
            )
            within, beyond = linear_range(frictional, x, new_x, slider, close)
            if within < 1.0 and step > SHORTEST:
                step *= 0.1 * within
                continue
            step = longest if within < 1.0 else max((end - part) * (beyond - 1.0), SHORTEST)
            u, done, part, x, force = solution.y[:-1], now, end, new_x, forces[..., 0]
            stretch = force[:, :2] / np.where(points.kt > 0.0, points.kt, 1.0)
            slider = np.where(points.kt > 0.0, x[:, :2] - stretch, x[:, :2])
            slider[bonded] = 0.0
    return u.reshape(load.shape), slider, force


def disk_points(structure: Structure, dampers: DamperVariation) -> PointArrays:
    """Return the contact points of all sectors, sector by sector, with sliders at zero and no
    shift."""
    tuned, N = structure.tuned, structure.n_blades
    n_points = len(structure.sector)
    on_damper = (
        structure.rows[..., structure.n :].any(axis=(1, 2))
        if structure.n_damper
        else np.zeros(n_points, bool)
    )

    def at_points(factor: NDArray, neutral: float) -> NDArray:
        return np.where(on_damper, factor[:, None], neutral)

    present = at_points(np.where(dampers.missing, 0.0, 1.0), 1.0)
    k = at_points(dampers.contact_stiffness, 1.0) * present
    kn = k * tuned.point_stiffness[:, 2]
    kt = k[..., None] * tuned.point_stiffness[:, :2] * (tuned.point_laws != LAW_NORMAL)[:, None]
    return PointArrays(
        kt=kt.reshape(-1, 2),
        kn=kn.ravel(),
        mu=(at_points(dampers.friction_coefficient, 1.0) * present * tuned.friction).ravel(),
        n0=(-kn * (tuned.point_gaps + at_points(dampers.gap, 0.0))).ravel(),
        slider=np.zeros((N * n_points, 2)),
        law=np.tile(tuned.point_laws, N),
        shift=np.zeros((N * n_points, 3)),
    )


def local_vector(structure: Structure, modal: NDArray, force: bool) -> NDArray:
    """Return the mean motion or static force of a sector (n_sector,) from modal values of the tuned
    study."""
    phi = structure.modes(0)
    coordinates, bodies = structure.tuned.static_basis.coordinates, structure.tuned.model.bodies
    of_damper = np.array([bodies[c.body].local is None for c in coordinates], bool)
    blade = structure.local.mass(0) @ phi if force else phi
    return np.concatenate([(blade @ modal[~of_damper]).real, modal[of_damper]])


@dataclass(frozen=True, eq=False)
class Loaded:
    """Static state of a bladed disk under a preload.

    Parameters
    ----------
    points : PointArrays
        Contact points of all sectors, with the static sliders and the motion that the coordinates
        do not represent.
    load : (n_blades, n_sector) float
        Static forces.
    mean : (n_blades, n_sector) float
        Static state.
    force : (n_blades, n_points, 3) float, N
        Static contact forces.
    missing : (n_blades,) bool
        Missing dampers.
    """

    points: PointArrays
    load: NDArray
    mean: NDArray
    force: NDArray
    missing: NDArray


def loaded(structure: Structure, preload: float, dampers: DamperVariation | None) -> Loaded:
    """Compute the static state under a preload (N), which acts on a damper of nominal mass.

    Raises
    ------
    StaticError
        If no static state was found.
    """
    tuned, N, n = structure.tuned, structure.n_blades, structure.n
    variation = DamperVariation.of(N) if dampers is None else dampers
    pinned, points = variation.missing, disk_points(structure, variation)
    modal, shift = tuned.damper_load
    load = np.tile(local_vector(structure, preload * modal, True), (N, 1))
    constant = np.tile(local_vector(structure, tuned.fixed_load[0], True), (N, 1))
    factor = np.where(pinned, 0.0, variation.mass)
    load[:, n:] *= factor[:, None]
    constant[pinned, n:] = 0.0
    moved = preload * factor[:, None, None] * shift
    state = tuned.at(preload).equilibrium
    mean = np.tile(local_vector(structure, state.q, False), (N, 1))
    if dampers is None:
        slider, force = np.tile(state.slider, (N, 1)), np.tile(state.force, (N, 1))
    else:
        mean[pinned, n:] = 0.0
        loading = Loading(load, constant, moved, tuned.settings.load_history)
        mean, slider, force = static_disk(structure, points, loading, pinned, mean)
    slider = np.where(np.tile(tuned.bonded_points, N)[:, None], 0.0, slider)
    points = replace(points, slider=slider, shift=moved.reshape(-1, 3))
    return Loaded(points, load + constant, mean, force.reshape(N, -1, 3), pinned)


def disk_system(
    structure: Structure, state: Loaded, excitation: NDArray, response_row: NDArray
) -> DiskSystem:
    """Return the equations of the vibration about a static state under an excitation
    (n_blades, n_sector) complex, N kg^-1/2."""
    tuned = structure.tuned
    scale = float(np.abs(excitation).max())
    pressed = structure.gathered(state.force)
    largest = max(float(np.abs(state.load).max()), float(np.abs(pressed).max()), scale)
    shift = state.points.shift
    if not tuned.settings.bias:
        shift = shift + structure.motion(state.mean).reshape(-1, 3)
    return DiskScene(
        structure, replace(state.points, shift=shift), tuned.settings.active_harmonics, state.load, excitation,
        response_row, state.missing, (largest, scale), state.mean, tuned.settings.contact_forces,
    ).equations  # fmt: skip


# ---- Problem ----


@dataclass(frozen=True, eq=False, repr=False)
class DiskProblem(Summarised):
    """Bladed disk and its equations; for the parameters see
    :class:`~bdamper.mistuning.BladedDisk`."""

    study: Asking | Problem
    mistuning: Mistuning | ArrayLike | None = None
    dampers: DamperVariation | None = None
    _tuned_peaks: dict[float, Peak] = field(default_factory=dict, repr=False)
    _states: dict[float, Loaded] = field(default_factory=dict, init=False, repr=False)
    _structure: Structure | None = field(default=None, repr=False)
    """Structure with nominal blades and dampers."""
    structure: Structure = field(init=False, repr=False)
    """Matrices of the bladed disk."""

    def __post_init__(self) -> None:
        problem = problem_of(self.study)
        n = self.study.model.n_blades
        mistuning, mass = Mistuning.of(n, self.mistuning), np.ones(n)
        if self.dampers is not None:
            validation.instance("dampers", self.dampers, DamperVariation)
            if self.dampers.n_blades != n:
                raise SettingError(
                    f"dampers: the model has {n} dampers, found {self.dampers.n_blades}"
                )
            mass = self.dampers.mass
        nominal = Structure.of(problem) if self._structure is None else self._structure
        object.__setattr__(self, "mistuning", mistuning)
        object.__setattr__(self, "_structure", nominal)
        object.__setattr__(self, "structure", nominal.varied(mistuning, mass))

    def replace(self, **changes: Any) -> Self:
        """Return the same disk with another ``mistuning`` or other ``dampers``; unchanged parts are
        shared."""
        for name in changes:
            validation.choice("settings of a bladed disk", name, ("mistuning", "dampers"))
        return replace(self, **changes)

    @property
    def n_blades(self) -> int:
        return self.study.model.n_blades

    @property
    def sizes(self) -> Sizes:
        """Sizes of the model of the study, as reference for plausible arguments."""
        return problem_of(self.study).sizes

    @property
    def deviation(self) -> NDArray:
        """Relative frequency deviations of the blades, (n_blades, n_modes)."""
        return Mistuning.of(self.n_blades, self.mistuning).deviation.reshape(self.n_blades, -1)

    def tuned(self) -> Asking | Problem:
        """Return the study of one sector that spans the same space, with the same contact
        stiffness."""
        return like(self.study, self.structure.tuned)

    @cached_property
    def excitation(self) -> NDArray:
        """Complex forces (n_blades, n_sector) of the first harmonic on the
        coordinates, N kg^-1/2."""
        s, tuned = self.structure, self.structure.tuned
        e = tuned.settings.excitation
        one_force = tuned.settings.acts_at_location and not e.beside
        validation.check_value(
            one_force, "excitation of a bladed disk", "one force at a location", e
        )
        row = s.location_rows(e.location, e.direction, "excitation")
        periods = (
            (int(tuned.engine_order) * np.arange(self.n_blades)) % self.n_blades / self.n_blades
        )
        wave = e.amplitude * np.exp(1j * e.phase + 2j * np.pi * periods)
        out = np.zeros((self.n_blades, s.n_sector), complex)
        out[:, : s.n] = np.outer(wave, row)
        if not out.any():
            raise SettingError(
                f"excitation: expected a force on the blades, found {e.amplitude:g} N at '{e.location}'"
            )
        return out

    @cached_property
    def response_row(self) -> NDArray:
        """Row (n,) whose product with the blade coordinates is the response, m."""
        response = self.structure.tuned.settings.response_location
        return self.structure.location_rows(response.location, response.direction, "response")

    def state(self, preload: float) -> Loaded:
        """Return the static state under a preload (N)."""
        preload = self.structure.tuned.check_preload(preload)
        if preload not in self._states:
            self._states[preload] = loaded(self.structure, preload, self.dampers)
        return self._states[preload]

    def system(self, preload: float) -> DiskSystem:
        """Return new equations at a preload (N), with new counters."""
        return disk_system(self.structure, self.state(preload), self.excitation, self.response_row)

    @one_thread
    def tuned_peak(self, preload: float) -> Peak:
        """Return the highest peak of the tuned disk at a preload; its amplitude is NaN if none was
        found."""
        if preload not in self._tuned_peaks:
            peak = highest_peak(self.structure.tuned, preload)
            self._tuned_peaks[preload] = peak if peak.converged else replace(peak, amplitude=np.nan)
        return self._tuned_peaks[preload]

    def record(self) -> dict[str, Any]:
        """Return the settings and the model hash that all results store."""
        disk = {
            "mistuning": str(self.mistuning),
            "dampers": str(self.dampers),
            "deviation": self.deviation.tolist(),
        }
        return {
            "settings": self.structure.tuned.record() | disk,
            "model_hash": self.study.model.hash,
        }

    def __str__(self) -> str:
        s = self.structure
        lines = [
            f"bladed disk of {self.n_blades} blades, {s.n} coordinates of each blade, {s.n_damper} of each damper",
            f"  {self.mistuning}",
            f"  {self.dampers or 'equal dampers'}",
        ]
        return "\n".join(lines)

    def __repr__(self) -> str:
        return str(self).split("\n", 1)[0]
