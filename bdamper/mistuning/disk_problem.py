"""Static state and equations of a mistuned bladed disk, before any analysis of its vibration.

If dampers differ, the static contact analysis covers all sectors.  Constant loads and interference
are applied first, then the preload.  Each load step starts from the sliders of the previous step
and ends at the first change of a contact state (:func:`bdamper.contact.static_state.linear_range`).
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
from bdamper.harmonic_balance.effects import MAX_HARMONIC
from bdamper.harmonic_balance.equations import OK
from bdamper.harmonic_balance.model_sizes import Sizes
from bdamper.harmonic_balance.problem import Problem
from bdamper.harmonic_balance.study_boundary import StudyLike, in_type_of, problem_of
from bdamper.mistuning.disk_equations import DiskMatrices, DiskScene, DiskSystem
from bdamper.mistuning.mistuning import DamperVariation, Mistuning
from bdamper.response.highest_peak import as_peak, found_at
from bdamper.response.linear_limits import peak_interval
from bdamper.response.peak import Peak
from bdamper.util import validation
from bdamper.util.display import Summarised
from bdamper.util.errors import SettingError, StaticError
from bdamper.util.progress import one_thread
from bdamper.util.statement import Row, Statement

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
    structure: DiskMatrices, points: PointArrays, loading: Loading, pinned: NDArray, alike: NDArray
) -> tuple[NDArray, NDArray, NDArray]:
    """Compute the static state of a bladed disk with unequal dampers after a history of load
    factors.

    Parameters
    ----------
    structure : DiskMatrices
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
    if (points.law == LAW_CUBIC).any():
        raise SettingError(
            "dampers must be identical in a model with cubic springs; found different dampers"
        )
    load = loading.load
    constant = loading.constant
    shift = loading.shift.reshape(-1, 3)
    n_points = len(points.kn)

    # contact with interference: its normal load is applied as a motion of the points (normal
    # direction 2)
    bonded = points.law == LAW_BONDED
    free = np.logical_not(bonded)
    pressed = free & (points.n0 > 0.0) & (points.kn > 0.0)
    interference = np.zeros_like(shift)
    interference[pressed, 2] = points.n0[pressed] / points.kn[pressed]
    bare = replace(points, n0=np.where(pressed, 0.0, points.n0))
    # bonded points do not change their state, so they do not limit a load step
    frictional = replace(bare, kt=bare.kt * free[:, None], kn=bare.kn * free, n0=bare.n0 * free)
    springs = np.concatenate([frictional.kt, frictional.kn[:, None]], axis=1)

    largest_load = float(np.abs(load).max() + np.abs(constant).max())
    largest_normal_load = float(points.n0.max(initial=0.0))
    scale = max(largest_load, 1e-9 * largest_normal_load, 1e-300)
    no_excitation = np.zeros(load.shape, complex)
    no_response = np.zeros(structure.n)
    no_mean = 0.0 * load

    # a load is a pair: share of interference and constant load, factor of the preload
    targets = [(1.0, factor) for factor in loading.history]
    if pressed.any() or np.any(constant):
        targets.insert(0, (1.0, 0.0))
    # the state at the end of the last step: unknowns, motion and sliders of the points, forces
    u = np.zeros(load.size)
    x = np.zeros((n_points, 3))
    slider = np.zeros((n_points, 2))
    force = np.zeros((n_points, 3))
    applied = np.zeros(2)
    longest = 1.0 / STEPS
    for target in np.array(targets):
        begin = applied
        part = 0.0  # of the way from begin to target
        step = longest
        while part < 1.0 and np.any(target != begin):
            step = min(step, longest)
            # a rest below the shortest step is included in this one
            is_last = step > (1.0 - SHORTEST) * (1.0 - part)
            end = 1.0 if is_last else part + step
            now = begin + end * (target - begin)
            share, factor = now
            total_shift = factor * shift + share * interference
            system = DiskScene(
                structure=structure,
                points=replace(bare, slider=slider, shift=total_shift),
                harmonics=(0,),
                load=factor * load + share * constant,
                excitation=no_excitation,
                response_row=no_response,
                missing=pinned,
                force_scale=(scale, scale),
                mean=no_mean,
            ).equations

            # without gaps a state is proportional to the preload
            factor_before = applied[1]
            if factor_before:
                start = factor / factor_before * u
            else:
                start = u + factor * alike.ravel()
            unit = np.full(len(u) + 1, max(float(np.abs(start).max()), 1e-9))
            # the static state does not depend on the frequency, here 1 rad/s
            solution = system.correct_at(
                start, 1.0, unit, tolerance=LEFT, max_iterations=60, line_search=2
            )
            if solution.status != OK:
                step *= 0.5
                if step < longest / 64.0:
                    raise StaticError(
                        "no static state of the bladed disk was found above "
                        f"{100 * factor_before:.3g} % of the preload "
                        f"(residual {solution.residual:.2g})"
                    )
                continue

            # the step must end at the first change of a contact state: within is its place in
            # this step and beyond its place after it, both 1 at the end of the step
            motion, forces, _ = system.contact(solution.y[:-1])
            mean_force = forces[..., 0]
            new_x = motion[..., 0]
            distance = np.abs(x) + np.abs(new_x) + np.abs(total_shift)
            close = AT_LIMIT * float((springs * distance).max(initial=0.0))
            within, beyond = linear_range(frictional, x, new_x, slider, close)
            if within < 1.0 and step > SHORTEST:
                step *= 0.1 * within
                continue
            if within < 1.0:
                step = longest
            else:
                step = max((end - part) * (beyond - 1.0), SHORTEST)
            u = solution.y[:-1]
            applied = now
            part = end
            x = new_x
            force = mean_force
            has_spring = points.kt > 0.0
            stretch = force[:, :2] / np.where(has_spring, points.kt, 1.0)
            slider = np.where(has_spring, x[:, :2] - stretch, x[:, :2])
            slider[bonded] = 0.0
    return u.reshape(load.shape), slider, force


def disk_points(structure: DiskMatrices, dampers: DamperVariation) -> PointArrays:
    """Return the contact points of all sectors, sector by sector, with sliders at zero and no
    shift."""
    tuned = structure.tuned
    n_blades = structure.n_blades
    n_points = len(structure.sector)  # of one sector
    on_damper = np.zeros(n_points, bool)
    if structure.n_damper:
        on_damper[:] = structure.rows[..., structure.n :].any(axis=(1, 2))

    def at_points(of_damper: NDArray, elsewhere: float) -> NDArray:
        """Assign the value of each damper (n_blades,) to its contact points (n_blades, n_points)."""
        return np.where(on_damper, of_damper[:, None], elsewhere)

    # missing dampers have no stiffness and no friction
    present = at_points(np.where(dampers.missing, 0.0, 1.0), elsewhere=1.0)
    factor = at_points(dampers.contact_stiffness, elsewhere=1.0) * present
    has_friction = tuned.point_laws != LAW_NORMAL
    # stiffness (n_points, 3) in both tangential directions and the normal one
    normal_stiffness = tuned.point_stiffness[:, 2]
    tangential_stiffness = tuned.point_stiffness[:, :2]
    kn = factor * normal_stiffness
    kt = factor[..., None] * tangential_stiffness * has_friction[:, None]
    mu = at_points(dampers.friction_coefficient, elsewhere=1.0) * present * tuned.friction
    gap = tuned.point_gaps + at_points(dampers.gap, elsewhere=0.0)
    return PointArrays(
        kt=kt.reshape(-1, 2),
        kn=kn.ravel(),
        mu=mu.ravel(),
        n0=(-kn * gap).ravel(),
        slider=np.zeros((n_blades * n_points, 2)),
        law=np.tile(tuned.point_laws, n_blades),
        shift=np.zeros((n_blades * n_points, 3)),
    )


def local_vector(structure: DiskMatrices, modal: NDArray, force: bool) -> NDArray:
    """Return the mean motion or static force of a sector (n_sector,) from modal values of the tuned
    study."""
    bodies = structure.tuned.model.bodies
    # the blade alone has a local basis; the coordinates of the damper remain modal
    names = [coordinate.body for coordinate in structure.tuned.static_basis.coordinates]
    of_damper = np.array([bodies[name].local is None for name in names], bool)

    from_modal = structure.modes(0)
    if force:
        # forces M phi f have the modal forces f, because phi^H M phi = I
        from_modal = structure.local.mass(0) @ from_modal
    blade = (from_modal @ modal[~of_damper]).real
    return np.concatenate([blade, modal[of_damper]])


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


def loaded(structure: DiskMatrices, preload: float, dampers: DamperVariation | None) -> Loaded:
    """Compute the static state under a preload (N), which acts on a damper of nominal mass.

    Raises
    ------
    StaticError
        If no static state was found.
    """
    tuned = structure.tuned
    n_blades = structure.n_blades
    # coordinates (n_sector,) of a sector: the first belong to the blade, others to the damper
    of_damper = slice(structure.n, None)
    variation = DamperVariation.of(n_blades) if dampers is None else dampers
    pinned = variation.missing
    points = disk_points(structure, variation)

    # the preload of a damper is proportional to its mass
    modal_load, motion_by_load = tuned.damper_load
    mass_factor = np.where(pinned, 0.0, variation.mass)

    def on_all_sectors(modal: NDArray, force: bool) -> NDArray:
        """Return the same motion or force on each sector, (n_blades, n_sector)."""
        return np.tile(local_vector(structure, modal, force), (n_blades, 1))

    load = on_all_sectors(preload * modal_load, force=True)
    load[:, of_damper] *= mass_factor[:, None]
    modal_constant, _ = tuned.fixed_load
    constant = on_all_sectors(modal_constant, force=True)
    constant[pinned, of_damper] = 0.0
    # motion (n_blades, n_points, 3) of the points without the coordinates
    shift = preload * mass_factor[:, None, None] * motion_by_load

    tuned_state = tuned.at(preload).equilibrium
    mean = on_all_sectors(tuned_state.q, force=False)
    if dampers is None:
        slider = np.tile(tuned_state.slider, (n_blades, 1))
        force = np.tile(tuned_state.force, (n_blades, 1))
    else:
        mean[pinned, of_damper] = 0.0
        loading = Loading(load, constant, shift, tuned.settings.load_history)
        mean, slider, force = static_disk(structure, points, loading, pinned, alike=mean)
    bonded = np.tile(tuned.bonded_points, n_blades)
    slider = np.where(bonded[:, None], 0.0, slider)
    return Loaded(
        points=replace(points, slider=slider, shift=shift.reshape(-1, 3)),
        load=load + constant,
        mean=mean,
        force=force.reshape(n_blades, -1, 3),
        missing=pinned,
    )


def disk_system(
    structure: DiskMatrices, state: Loaded, excitation: NDArray, response_row: NDArray
) -> DiskSystem:
    """Return the equations of the vibration about a static state.

    Parameters
    ----------
    structure : DiskMatrices
    state : Loaded
    excitation : (n_blades, n_sector) complex, N kg^-1/2
    response_row : (n,) float
    """
    tuned = structure.tuned
    excitation_scale = float(np.abs(excitation).max())
    contact_load = structure.gathered(state.force)
    largest_load = float(np.abs(state.load).max())
    largest_contact_load = float(np.abs(contact_load).max())
    mean_scale = max(largest_load, largest_contact_load, excitation_scale)
    # without bias the unknowns do not contain the static state
    shift = state.points.shift
    if not tuned.settings.bias:
        shift = shift + structure.motion(state.mean).reshape(-1, 3)
    return DiskScene(
        structure=structure,
        points=replace(state.points, shift=shift),
        harmonics=tuned.settings.active_harmonics,
        load=state.load,
        excitation=excitation,
        response_row=response_row,
        missing=state.missing,
        force_scale=(mean_scale, excitation_scale),
        mean=state.mean,
        contact_forces=tuned.settings.contact_forces,
    ).equations


# ---- Problem ----


MORE_HARMONICS = 2
"""Number of further harmonics that estimate the error of a peak: an even and an odd one."""


def _peak_of_curve(problem: Problem, preload: float) -> Peak:
    """Return the highest peak of the response curve of the tuned disk at a preload.

    Peaks that are followed from lower preloads are left out: the search for the highest blade
    begins on this curve, and may not begin on a branch that disturbed blades leave.
    """
    interval = peak_interval(problem.at(preload), None)
    return as_peak(problem, found_at(problem, preload, interval), interval)


@dataclass(frozen=True, eq=False, repr=False)
class DiskProblem(Summarised):
    """Bladed disk and its equations; for the parameters see
    :class:`~bdamper.mistuning.BladedDisk`."""

    study: StudyLike | Problem
    mistuning: Mistuning | ArrayLike | None = None
    dampers: DamperVariation | None = None
    _tuned_peaks: dict[float, Peak] = field(default_factory=dict, repr=False)
    _tuned_changes: dict[float, float] = field(default_factory=dict, repr=False)
    _states: dict[float, Loaded] = field(default_factory=dict, init=False, repr=False)
    _structure: DiskMatrices | None = field(default=None, repr=False)
    """Matrices with nominal blades and dampers."""
    structure: DiskMatrices = field(init=False, repr=False)
    """Matrices of the bladed disk."""

    def __post_init__(self) -> None:
        problem = problem_of(self.study)
        n = self.study.model.n_blades
        mistuning = Mistuning.of(n, self.mistuning)
        mass = np.ones(n)
        if self.dampers is not None:
            validation.instance("dampers", self.dampers, DamperVariation)
            if self.dampers.n_blades != n:
                raise SettingError(
                    f"dampers: the model has {n} dampers, found {self.dampers.n_blades}"
                )
            mass = self.dampers.mass
        nominal = DiskMatrices.of(problem) if self._structure is None else self._structure
        object.__setattr__(self, "mistuning", mistuning)
        object.__setattr__(self, "_structure", nominal)
        object.__setattr__(self, "structure", nominal.varied(mistuning, mass))

    def replace(self, **changes: Any) -> Self:
        """Return the same disk with a different ``mistuning`` or different ``dampers``; unchanged
        parts are shared.
        """
        for name in changes:
            validation.choice("settings of a bladed disk", name, ("mistuning", "dampers"))
        return replace(self, **changes)

    @property
    def n_blades(self) -> int:
        return self.study.model.n_blades

    @property
    def sizes(self) -> Sizes:
        """Characteristic sizes of the model, used to check whether arguments are plausible."""
        return problem_of(self.study).sizes

    @property
    def deviation(self) -> NDArray:
        """Relative frequency deviations of the blades, (n_blades, n_modes)."""
        return Mistuning.of(self.n_blades, self.mistuning).deviation.reshape(self.n_blades, -1)

    def tuned(self) -> StudyLike | Problem:
        """Return the study of one sector whose basis spans the same space, with the same contact
        stiffness."""
        return in_type_of(self.study, self.structure.tuned)

    @cached_property
    def excitation(self) -> NDArray:
        """Complex forces (n_blades, n_sector) of the first harmonic on the
        coordinates, N kg^-1/2."""
        matrices = self.structure
        tuned = matrices.tuned
        n_blades = self.n_blades
        force = tuned.settings.excitation
        one_force = tuned.settings.acts_at_location and not force.beside
        validation.check_value(
            one_force, "excitation of a bladed disk", "one force at a location", force
        )
        row = matrices.location_rows(force.location, force.direction, "excitation")
        # fraction of a period by which each blade is ahead of blade 0
        periods = int(tuned.engine_order) * np.arange(n_blades) % n_blades / n_blades
        wave = force.amplitude * np.exp(1j * force.phase + 2j * np.pi * periods)
        excitation = np.zeros((n_blades, matrices.n_sector), complex)
        excitation[:, : matrices.n] = np.outer(wave, row)
        if not excitation.any():
            raise SettingError(
                "excitation: expected a force on the blades, found "
                f"{force.amplitude:g} N at '{force.location}'"
            )
        return excitation

    @cached_property
    def response_row(self) -> NDArray:
        """Row (n,) whose product with the blade coordinates is the response, m."""
        response = self.structure.tuned.settings.response_location
        no_gauge = response.elastic is None
        expected = "the motion of a location as the response of a bladed disk"
        validation.check(no_gauge, "response", expected, f"a strain gauge, {response.shown}")
        return self.structure.location_rows(str(response.location), response.direction, "response")

    def state(self, preload: float) -> Loaded:
        """Return the static state under a preload (N)."""
        preload = self.structure.tuned.check_preload(preload)
        if preload not in self._states:
            self._states[preload] = loaded(self.structure, preload, self.dampers)
        return self._states[preload]

    def system(self, preload: float) -> DiskSystem:
        """Return a new system of equations at a preload (N), with its own counters."""
        return disk_system(self.structure, self.state(preload), self.excitation, self.response_row)

    @one_thread
    def tuned_peak(self, preload: float) -> Peak:
        """Return the highest peak of the tuned disk at a preload; its amplitude is NaN if none was
        found."""
        if preload not in self._tuned_peaks:
            peak = _peak_of_curve(self.structure.tuned, preload)
            if not peak.ok:
                peak = replace(peak, amplitude=np.nan)
            self._tuned_peaks[preload] = peak
        return self._tuned_peaks[preload]

    @validation.check_arguments
    @one_thread
    def tuned_change(self, preload: float) -> float:
        """Return the relative change of the tuned peak with additional harmonics
        (:data:`MORE_HARMONICS`).

        It is NaN if either peak is unknown.
        """
        if preload not in self._tuned_changes:
            self._tuned_changes[preload] = self._computed_change(preload)
        return self._tuned_changes[preload]

    def _computed_change(self, preload: float) -> float:
        """See :meth:`tuned_change`."""
        tuned = self.structure.tuned
        n_harmonics = tuned.harmonic_numbers[-1] + MORE_HARMONICS
        if n_harmonics > MAX_HARMONIC:
            return np.nan
        try:
            richer = _peak_of_curve(tuned.replace(harmonics=n_harmonics), preload)
        # sampled contact forces may be too coarse for more harmonics
        except SettingError:
            return np.nan
        # an amplitude without a complete search is NaN
        return richer.amplitude / self.tuned_peak(preload).amplitude - 1.0

    def record(self) -> dict[str, Any]:
        """Return the settings and the model hash that all results store."""
        disk = {
            "mistuning": Mistuning.of(self.n_blades, self.mistuning).record_text,
            "dampers": "None" if self.dampers is None else self.dampers.record_text,
            "deviation": self.deviation.tolist(),
        }
        return {
            "settings": self.structure.tuned.record() | disk,
            "model_hash": self.study.model.hash,
        }

    _states_all = True

    def _statement(self) -> Statement:
        structure = self.structure
        coordinates = (
            f"{structure.n} coordinates of each blade, {structure.n_damper} of each damper"
        )
        mistuning = Mistuning.of(self.n_blades, self.mistuning)
        deviation = f"standard deviation of frequency {100.0 * mistuning.deviation.std():.3g} %"
        dampers = "identical" if self.dampers is None else self.dampers._headline()
        rows = [Row("Blades", str(self.n_blades), deviation), Row("Dampers", "", dampers)]
        return Statement([f"Bladed disk of {self.n_blades} blades: {coordinates}"], rows)

    def __repr__(self) -> str:
        return self._headline()
