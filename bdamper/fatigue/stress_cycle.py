r"""Stress over the vibration cycle of a solution at the points of stress sets.

.. math:: \sigma(\theta) = \Omega^2 \sigma_1 + S_0 q_0 + A_0 F_0
          + \sum_{l \ge 1} \mathrm{Re}[(S_l q_l + A_l F_l)\,e^{i l \theta}]

All modes of the model contribute. The solution contains the coordinates of the retained modes. The
other modes respond to contact forces and excitation at ``l omega``. The centrifugal stress applies
to the rotor without dampers; the effect of the dampers is contained in ``q_0`` and ``F_0``. A free
curve has no contact forces. In a stuck curve linear springs replace the contacts, and the mean is
the static state.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from bdamper.contact.laws import PointArrays
from bdamper.fatigue import criteria
from bdamper.harmonic_balance.checks import Solutions, SomeResult, solutions_of
from bdamper.harmonic_balance.contact_setup import without_separation
from bdamper.harmonic_balance.problem import Problem
from bdamper.harmonic_balance.subject import about
from bdamper.model.gauges import gauge_point, gauge_weights
from bdamper.model.loads import Direction
from bdamper.model.structure import Body, ModalBasis, StressSet
from bdamper.util import validation
from bdamper.util.display import Plottable, Result
from bdamper.util.errors import SettingError, warn_implausible
from bdamper.util.formatting import amount, peak_text, sentence, short_repr
from bdamper.util.records import Data
from bdamper.util.statement import Row, Statement
from bdamper.util.storage import Recorded, Storable
from bdamper.util.tables import Numbers, Pascals, PerRow, Quantity, Tabular


@dataclass(frozen=True, kw_only=True)
class AtPoints:
    """Points of stress sets and the solution to which the stress belongs.

    Parameters
    ----------
    points : (n, 3) float, m
    names : tuple of str
        Stress set and node number of each point, or its position in the set from 1: "root node
        215", "root point 3".
    counted : (n,) bool
        Points away from contact faces; margins ignore the others.  Printed as "used".
    spread : (n,) float
        Difference in stress between adjacent elements, divided by its mean, an indicator of the
        mesh error; NaN if not available.
    frequency, preload, speed : float, Hz, N, rad/s
    notes : tuple of str
    centrifugal_load : float, N
        Centrifugal load of the damper at this speed; 0 if it is unknown.
    """

    points: Annotated[NDArray, Quantity("m", parts=("x", "y", "z"))]
    names: Annotated[tuple[str, ...], Quantity(name="name")]
    counted: Numbers
    spread: PerRow
    frequency: float
    preload: float
    speed: float
    notes: tuple[str, ...] = ()
    centrifugal_load: Annotated[float, Data(derived=True)] = 0.0

    def __len__(self) -> int:
        return len(self.points)


@short_repr
@dataclass(frozen=True)
class StressCycle(
    AtPoints,
    Result,
    Plottable,
    Tabular,
    Recorded,
    Storable,
    kind="bdamper-stress",
    row="location",
):
    """Stress of one solution over the vibration cycle.

    ``plot`` draws the von Mises value and the components over the cycle
    (:func:`bdamper.plot.plot_stress`).

    Parameters
    ----------
    coefficients : (n, 6, H + 1) complex, Pa
        Mean, including the centrifugal stress, and the complex amplitude of each harmonic, for the
        components xx, yy, zz, xy, yz, xz.
    settings : mapping
    model_hash : str
    """

    coefficients: PerRow

    def over_cycle(self, theta: NDArray) -> NDArray:
        """Return the stress at phase angles of the excitation (rad), Pa, (n, 6, n_theta)."""
        return criteria.over_cycle(self.coefficients, np.asarray(theta, float))

    def amplitude_and_mean(self) -> criteria.Cycle:
        """Return the von Mises amplitude (n,) and the mean stress (n,), Pa."""
        return criteria.amplitude_and_mean(self.coefficients)

    @property
    def amplitude(self) -> Pascals:
        """Von Mises stress amplitude, Pa, (n,)."""
        return self.amplitude_and_mean().amplitude

    @property
    def mean(self) -> Pascals:
        """Mean stress, Pa, (n,): trace of the mean tensor."""
        return self.amplitude_and_mean().mean

    @property
    def critical(self) -> int:
        """Index of the point with the largest von Mises amplitude, among the points that count."""
        return int(np.where(self.counted, self.amplitude, -1.0).argmax())

    def _order(self) -> NDArray:
        """Return the indices of the points by decreasing amplitude, those that do not count
        last."""
        return np.lexsort((-self.amplitude, ~self.counted))

    def _statement(self) -> Statement:
        i = self.critical
        cycle = self.amplitude_and_mean()
        largest = f"{amount(cycle.amplitude[i], 'Pa')} at {self.names[i]}"
        subject = about(self.settings, self.preload, amount(self.frequency, "Hz"))
        (*head, used), *rows = self._rows()
        head.append("away from contact" if used == "used" else used)
        table, further = self._first_rows([tuple(head), *rows])
        verdict = f"Largest stress amplitude {largest}{subject}"
        check = load_check(self.notes)
        if check:
            further = [load_remedy(self.preload, self.centrifugal_load, self.speed), *further]
            verdict = f"{OTHER_SPEED}{subject}"
        return Statement(
            [verdict],
            [
                Row("Amplitude", amount(cycle.amplitude[i], "Pa"), f"von Mises, {self.names[i]}"),
                Row(
                    "Mean stress",
                    amount(cycle.mean[i], "Pa"),
                    "first invariant (trace) of the mean stress tensor",
                ),
            ],
            checks=check,
            remarks=[*further, *doubts(self.notes)],
            table=table,
            further=["fatigue safety factor: study.margin(stress, material)"],
        )


def stress(
    problem: Problem,
    result: SomeResult,
    index: int | None = None,
    *,
    sets: str | Sequence[str] | None = None,
    speed: float | None = None,
) -> StressCycle:
    """See :meth:`bdamper.Study.stress`."""
    chosen = chosen_sets(problem, sets)
    solutions = solutions_of(problem, result)
    n = len(solutions.unknowns)
    if n <= 1:
        # a peak, or a curve of one point
        i = index or 0
    elif index is None:
        check_ends(result)
        i = _highest(result, solutions)
    else:
        i = validation.integer("index", index, least=0, most=n - 1)
    solution = selected(solutions, [i])
    cycle = of_solution(problem, solution, chosen, speed)
    notes = (*cycle.notes, *check_loads(problem, solution, chosen, speed))
    return replace(cycle, notes=notes)


def selected(solutions: Solutions, rows: list[int] | NDArray) -> Solutions:
    """Return the solutions with the given indices, or those for which a mask is true."""
    return Solutions(
        unknowns=solutions.unknowns[rows],
        frequency=solutions.frequency[rows],
        preload=solutions.preload[rows],
        kind=solutions.kind[rows],
    )


def gauge_stress(
    problem: Problem,
    result: SomeResult,
    gauge: str | Sequence[float],
    direction: Direction,
    elastic: Sequence[float] | None = None,
) -> NDArray:
    """See :meth:`bdamper.Study.gauge_stress`."""
    # refuses a model without stress sets
    chosen_sets(problem)
    stress_set, point = gauge_point(problem.coupling.model.stress, gauge)
    coefficients = coefficients_of(problem, solutions_of(problem, result), (stress_set,))
    # weights of the six stress components, for m solutions and their harmonics l
    weights = gauge_weights(direction, elastic)
    return np.asarray(np.einsum("c,mcl->ml", weights, coefficients[:, point]))


def _highest(result: Any, solutions: Solutions) -> int:
    """Return the index of the best point: highest of a response curve, lowest of an optimal curve.

    Points without a solution do not count.
    """
    amplitude = np.asarray(result.amplitude)
    solved = np.isfinite(amplitude) & np.isfinite(solutions.unknowns).all(axis=1)
    is_optimal_curve = np.ndim(result.preload) > 0
    if is_optimal_curve:
        return int(np.where(solved, amplitude, np.inf).argmin())
    return int(np.where(solved, amplitude, -np.inf).argmax())


DOUBTED_LOAD = "the centrifugal stress belongs to a preload of "
OTHER_SPEED = "Not for design: the preload and the centrifugal stress belong to different speeds"
"""Verdict on a stress whose preload contradicts the rotor speed."""
MEASURES = "trace of the mean tensor; the amplitude is by von Mises"
SCALED = "vibration scaled by "
UNSETTLED = "the amplitude by time integration is "
APART = "elements at "
SMALLER = " of them with a smaller factor"


def speeds(problem: Problem, frequency: NDArray, speed: float | None = None) -> NDArray:
    """Return the rotor speed (m,) in rad/s.

    Parameters
    ----------
    problem : Problem
    frequency : (m,) float, Hz
    speed : float, rad/s, optional
        By default the speed of the study, or the speed at which the engine order excites at
        ``frequency``.
    """
    if speed is None:
        speed = problem.settings.speed
    if speed is not None:
        speed = validation.number("speed", speed, least=0.0, unit="rad/s")
        return np.full(len(frequency), speed)
    # engine order times speed is the excitation frequency; without an engine order nothing rotates
    per_frequency = 0.0
    if problem.model.n_blades > 1 and problem.engine_order:
        per_frequency = 2.0 * np.pi / problem.engine_order
    return per_frequency * frequency


def check_loads(
    problem: Problem, solutions: Solutions, chosen: Sequence[StressSet], speed: float | None = None
) -> tuple[str, ...]:
    """Compare the preloads with the centrifugal load of the damper at the rotor speed.

    Return a contradiction as a note, and warn about it at a given speed.  At the speed of the study
    the search that found the solutions has warned, and other studies need a speed for the static
    stress alone.
    """
    if (solutions.kind == "free").all():  # without dampers
        return ()
    rotor_speed = speeds(problem, solutions.frequency, speed)
    if speed is not None:
        problem.sizes.check_preload(solutions.preload, rotor_speed)
    contradiction = problem.sizes.contradiction(solutions.preload, rotor_speed)
    has_static = any(stress_set.static is not None for stress_set in chosen)
    needs_speed = has_static or speed is not None or problem.settings.speed is not None
    if contradiction is None or not needs_speed:
        return ()
    expected, found = contradiction
    return (f"{DOUBTED_LOAD}{expected}, found {found}",)


def check_ends(result: SomeResult) -> None:
    """Warn about a curve whose relevant point lies at an end: the highest point of a response
    curve, or the lowest amplitude of an optimal curve.
    """
    curve: Any = result
    if getattr(result, "peak_at_end", False):
        peak = peak_text(curve.peak.amplitude, curve.peak.frequency)
        found = f"the highest response at its end, {peak}"
        warn_implausible("result", "a response curve with its peak inside the interval", found)
    elif getattr(getattr(result, "optimum", None), "kind", "") == "end":
        found = f"the lowest amplitude at its end, {amount(curve.optimum.preload, 'N')}"
        warn_implausible("result", "an optimal curve with its optimum inside the range", found)


def load_check(notes: Sequence[str]) -> list[Row]:
    """Return the failed check of preloads that contradict the rotor speed; empty without one."""
    found = [sentence(note) for note in notes if note.startswith(DOUBTED_LOAD)]
    return [Row("Centrifugal load", "FAIL", text) for text in found]


def load_remedy(preload: float, load: float, speed: float) -> str:
    """Return the remedy for a preload (N) that contradicts the centrifugal load at a speed (rad/s).

    The damper has the load ``load`` (N) at this speed, 0 if it is unknown.
    """
    if not load > 0.0:
        return f"Remedy: use study.at_speed({speed:.4g})"
    return (
        f"Remedy: use study.at_speed({speed:.4g}), where this damper presses with "
        f"{amount(load, 'N')}; {amount(preload, 'N')} requires {preload / load:.2g} times its mass"
    )


def doubts(notes: Sequence[str]) -> list[str]:
    """Return the notes that qualify the largest stress or the smallest margin."""
    starts = (SCALED, UNSETTLED, APART)
    return [sentence(note) for note in notes if note.startswith(starts) or note.endswith(SMALLER)]


def chosen_sets(problem: Problem, sets: str | Sequence[str] | None = None) -> tuple[StressSet, ...]:
    """Return stress sets by name, at the contact points of the study."""
    stored = problem.coupling.model.stress
    found = "none (docs/speed.md explains how to add them)"
    validation.check(stored, "stress", "a model with stress sets", found)
    if sets is None:
        return tuple(stored.values())
    names = [sets] if isinstance(sets, str) else list(sets)
    return tuple(stored[validation.choice("stress set", name, list(stored))] for name in names)


def of_solution(
    problem: Problem, solution: Solutions, chosen: Sequence[StressSet], speed: float | None = None
) -> StressCycle:
    """Return the stress of one solution over the cycle."""
    notes = []
    for s in chosen:
        has_contact = bool(problem.model.bodies[s.body].ports)
        if has_contact and not s.contact:
            notes.append(
                f"set '{s.name}' has no rows for contact forces: their stress is neglected"
            )
    for s in chosen:
        if s.static is None:
            notes.append(f"set '{s.name}' has no centrifugal stress: the mean stress neglects it")
    rotor_speed = speeds(problem, solution.frequency, speed)
    names: list[str] = []
    spread = []
    for s in chosen:
        names += s.point_names
        spread.append(np.full(len(s), np.nan) if s.spread is None else s.spread)
    return StressCycle(
        points=np.concatenate([s.points for s in chosen]),
        names=tuple(names),
        coefficients=coefficients_of(problem, solution, chosen, speed)[0],
        counted=np.concatenate([s.counted for s in chosen]),
        spread=np.concatenate(spread),
        frequency=float(solution.frequency[0]),
        preload=float(solution.preload[0]),
        speed=float(rotor_speed[0]),
        centrifugal_load=float(problem.sizes.centrifugal_load(rotor_speed)[0]),
        notes=tuple(notes),
        **problem.recorded(),
    )


def coefficients_of(
    problem: Problem, solutions: Solutions, sets: Sequence[StressSet], speed: float | None = None
) -> NDArray:
    """Return mean and harmonics (m, n, 6, H + 1) of the stress of m solutions, Pa."""
    n_points = sum(len(s) for s in sets)
    highest_harmonic = problem.harmonic_numbers[-1]
    shape = (len(solutions.unknowns), n_points, 6, highest_harmonic + 1)
    # NaN without a solution
    stress = np.full(shape, np.nan, complex)
    # at unit rotor speed, (n, 6)
    centrifugal = np.concatenate(
        [np.zeros((len(s), 6)) if s.static is None else s.static for s in sets]
    )
    present = sorted({0, *problem.settings.active_harmonics})
    # for each harmonic, the rows of each set
    rows_of = {}
    for harmonic in present:
        rows_of[harmonic] = [_Rows.make(problem, stress_set, harmonic) for stress_set in sets]
    rotor_speed = speeds(problem, solutions.frequency, speed)
    # neighbouring solutions of a curve often have the same preload
    latest: tuple[float, str] | None = None
    for i, (u, frequency, preload, kind) in enumerate(zip(*solutions)):
        if not np.isfinite(u).all():
            continue
        if latest != (preload, kind):
            latest = (preload, kind)
            contact_forces = _contact_forces(problem, preload, kind)
        forces = contact_forces(u)
        omega = 2.0 * np.pi * frequency
        stress[i] = 0.0
        for harmonic in present:
            force = forces[harmonic]
            q = problem.layout.amplitudes(u, harmonic)
            coordinates = problem.bases[harmonic].coordinates
            if harmonic == 0 and _mean_is_static(problem, kind):
                state = problem.at(preload).equilibrium
                q = state.q
                force = state.force.ravel()
                coordinates = problem.static_basis.coordinates
            # values of the retained modes, by body and index of the mode
            by_body: dict[str, dict[int, complex]] = {}
            for coordinate, value in zip(coordinates, q):
                by_body.setdefault(coordinate.body, {})[coordinate.index] = value
            of_sets = []
            for rows in rows_of[harmonic]:
                retained = by_body.get(rows.body.name, {})
                of_sets.append(rows.stress(retained, force, omega))
            stress[i, ..., harmonic] = np.concatenate(of_sets)
        mean = stress[i, ..., 0].real
        stress[i, ..., 0] = mean + rotor_speed[i] ** 2 * centrifugal
    return stress


def _mean_is_static(problem: Problem, kind: str) -> bool:
    """Whether the mean of a solution is the static state under the preload."""
    if kind == "free":
        return False
    return kind == "stuck" or not problem.settings.bias


def _contact_forces(
    problem: Problem, preload: float, kind: str
) -> Callable[[NDArray], list[NDArray]]:
    """Return a function from the unknowns of a solution to contact forces.

    The forces are (3 n_points,) for each harmonic.
    """
    case = problem.at(preload)
    if kind in ("free", "stuck"):
        linear = case.sector.linear
        stuck = case.stuck_springs(touching=True) if kind == "stuck" else 0.0
        springs = linear.springs + stuck

        def forces_of_springs(u: NDArray) -> list[NDArray]:
            forces = []
            for l, basis in enumerate(linear.bases):
                motion = basis.G @ linear.layout.amplitudes(u, l)
                forces.append((springs * motion).ravel())
            return forces

        return forces_of_springs

    system = case.equations
    axes = _contact_axes(problem, preload)

    def forces_of_contact(u: NDArray) -> list[NDArray]:
        _, force, _ = system.contact(u)
        # mean, then cosine and sine of each harmonic
        mean = force[..., :1]
        cosine = force[..., 1::2]
        sine = force[..., 2::2]
        # (n_system, 3, H + 1); from points p and directions d to components k of harmonic l
        harmonics = np.concatenate([mean, cosine - 1j * sine], axis=-1)
        return list(np.einsum("pdk,pdl->lk", axes, harmonics))

    return forces_of_contact


def _contact_axes(problem: Problem, preload: float) -> NDArray:
    """Return the transformation of contact forces from the equations to the axes of the model.

    It is (n_system, 3, 3 n_points).
    """
    n = problem.coupling.n_points
    # unit motions of the model, which the equations transform like a basis
    units = replace(problem.bases[1], G=np.eye(3 * n).reshape(n, 3, 3 * n))
    separation = problem.settings.separation
    variable_load = problem.settings.variable_normal_load
    if separation and variable_load:
        # the equations have the axes of the model
        return np.asarray(units.G.real)
    points = PointArrays(
        kt=np.ones((n, 2)),
        kn=np.ones(n),
        mu=np.zeros(n),
        n0=np.zeros(n),
        slider=np.zeros((n, 2)),
        law=problem.point_laws.copy(),
        shift=np.zeros((n, 3)),
    )
    state = problem.at(preload).equilibrium
    bases, _ = without_separation(
        [units], points, state, problem.friction_points, constant_load=not variable_load
    )
    return np.asarray(bases[0].G.real)


@dataclass(frozen=True)
class _Rows:
    """Matrices for the stress of one set in one harmonic.

    Parameters
    ----------
    problem : Problem
    body : Body
    basis : ModalBasis
        Modes of the body.
    modes : (n, 6, n_modes) complex or float
        Stress of the modes.
    contact : (n, 6, 3 n_points) complex or float, optional
        Stress of unit forces on the ports of the body.
    harmonic : int
    """

    problem: Problem
    body: Body
    basis: ModalBasis
    modes: NDArray
    contact: NDArray | None
    harmonic: int

    @classmethod
    def make(cls, problem: Problem, chosen: StressSet, harmonic: int) -> _Rows:
        """Return the matrices of a stress set in a harmonic.

        Raises
        ------
        SettingError
            If the set has no modes of the nodal diameter of this harmonic.
        """
        model = problem.coupling.model
        wave = 1 if problem.settings.fundamental_modes_only else harmonic
        # a wave in the opposite direction has the complex conjugate modes
        d, conjugate = model.folded_nodal_diameter(problem.engine_order * wave)
        body = model.bodies[chosen.body]
        if body.kind != "constrained":
            # free bodies have the same modes in every wave
            d = 0
            conjugate = False
        if d not in chosen.modes:
            needed = (
                f"harmonic {harmonic} needs nodal diameter {d}; the set has {sorted(chosen.modes)}"
            )
            raise SettingError(f"stress set '{chosen.name}': {needed}")
        basis = body.bases[d]
        modes = chosen.modes[d]
        contact = chosen.contact.get(d)
        if conjugate:
            basis = basis.conjugate()
            modes = modes.conj()
            contact = None if contact is None else contact.conj()
        if harmonic == 0:
            modes = modes.real
            contact = None if contact is None else contact.real
        return cls(problem, body, basis, modes, contact, harmonic)

    def port_forces(self, force: NDArray) -> NDArray:
        """Return the contact forces (3 n,) on the ports of the body.

        ``force`` (3 n_points,) has the forces of all contacts.
        """
        coupling = self.problem.coupling
        model = coupling.model
        at_ports = np.zeros((len(self.basis.contact_modes), 3), complex)
        # N is positive in compression, against n of body a
        on_a = force.reshape(-1, 3) * np.array([1.0, 1.0, -1.0])
        for name, side in self.body.ports:
            if name not in coupling.interfaces:
                continue
            face = model.interfaces[name]
            if side == "a":
                sector = face.sector_a
                sense = 1.0
            else:
                sector = face.sector_b
                sense = -1.0
            # from the sector of the side back to the reference sector
            angle = -2j * np.pi * coupling.engine_order * self.harmonic * sector / model.n_blades
            rows = model.port_slice(self.body.name, (name, side))
            at_ports[rows] = sense * np.exp(angle) * on_a[coupling.rows(name)]
        return at_ports.ravel()

    def stress(self, retained: Mapping[int, complex], force: NDArray, omega: float) -> NDArray:
        """Return the complex stress amplitude (n, 6).

        Parameters
        ----------
        retained : mapping of mode index to complex
            Coordinates of the retained modes; the other modes respond to the forces.
        force : (3 n_points,) complex, N
        omega : float, rad/s
            Angular frequency of the fundamental harmonic.
        """
        settings = self.problem.settings
        basis = self.basis
        at_ports = self.port_forces(force)
        modal_force = basis.contact_modes.reshape(-1, basis.n_modes).conj().T @ at_ports
        for location, direction, excitation in settings.excited.get(self.harmonic, []):
            if location in basis.locations:
                shape = direction @ basis.locations[location]
                modal_force = modal_force + shape.conj() * excitation

        # response of the modes that are not retained
        ratio = basis.damping_ratio
        if settings.damping_ratio is not None:
            ratio = np.full(basis.n_modes, settings.damping_ratio)
        w = self.harmonic * omega
        dynamic_stiffness = basis.omega2 - w**2 + 2j * ratio * np.sqrt(basis.omega2) * w
        # rigid-body modes do not respond to the mean force
        q = np.zeros_like(modal_force)
        np.divide(modal_force, dynamic_stiffness, out=q, where=dynamic_stiffness != 0.0)
        for index, value in retained.items():
            q[index] = value

        stress = self.modes @ q
        if self.contact is not None and len(at_ports):
            stress = stress + self.contact @ at_ports
        return np.asarray(stress)
