r"""Stress over the vibration cycle of a solution at the points of stress sets.

.. math:: \sigma(\theta) = \Omega^2 \sigma_1 + S_0 q_0 + A_0 F_0
          + \sum_{l \ge 1} \mathrm{Re}[(S_l q_l + A_l F_l)\,e^{i l \theta}]

All modes of the model contribute. The solution contains the coordinates of the retained modes. The other modes respond to
contact forces and excitation at ``l omega``. The centrifugal stress belongs to the rotor without dampers; the effect of the
dampers is contained in ``q_0`` and ``F_0``. A free curve has no contact forces. In a stuck curve linear springs
replace the contacts, and the mean is the static state.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from bdamper.contact.laws import PointArrays
from bdamper.fatigue import criteria
from bdamper.harmonic_balance.checks import Solutions, SomeResult, solutions_of
from bdamper.harmonic_balance.contact_setup import without_separation
from bdamper.harmonic_balance.problem import Problem
from bdamper.model.loads import Direction, direction_vector
from bdamper.model.structure import Body, ModalBasis, StressSet
from bdamper.util import validation
from bdamper.util.display import Comparable, Plottable
from bdamper.util.errors import SettingError, warn_implausible
from bdamper.util.formatting import amount, peak_text, short_repr
from bdamper.util.storage import Recorded, Storable
from bdamper.util.tables import Numbers, Pascals, PerRow, Quantity, Tabular


@dataclass(frozen=True, kw_only=True)
class AtPoints:
    """Points of stress sets and the solution to which the stress belongs.

    Parameters
    ----------
    points : (n, 3) float, m
    names : tuple of str
        Stress set and node number of each point, or its position in the set from 1: "root node 215", "root point 3".
    counted : (n,) bool
        Points away from contact faces; margins ignore the others.
    spread : (n,) float
        Difference of the stress between adjacent elements over its mean, an indicator of the mesh error; NaN if not
        available.
    frequency, preload, speed : float, Hz, N, rad/s
    notes : tuple of str
    """

    points: Annotated[NDArray, Quantity("m", parts=("x", "y", "z"))]
    names: Annotated[tuple[str, ...], Quantity(name="name")]
    counted: Numbers
    spread: PerRow
    frequency: float
    preload: float
    speed: float
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.points)


@short_repr
@dataclass(frozen=True)
class StressCycle(
    AtPoints,
    Plottable,
    Comparable,
    Tabular,
    Recorded,
    Storable,
    kind="bdamper-stress",
    row="location",
):
    """Stress of one solution over the vibration cycle.

    ``plot`` draws the von Mises value and the components over the cycle (:func:`bdamper.plot.plot_stress`).

    Parameters
    ----------
    coefficients : (n, 6, H + 1) complex, Pa
        Mean with centrifugal stress, and complex amplitude of each harmonic; components xx, yy, zz, xy, yz, xz.
    settings : mapping
    model_hash : str
    """

    coefficients: PerRow

    def over_cycle(self, theta: NDArray) -> NDArray:
        """Return the stress (n, 6, n_theta) in Pa at phase angles of the excitation (rad)."""
        return criteria.over_cycle(self.coefficients, np.asarray(theta, float))

    def amplitude_and_mean(self) -> criteria.Cycle:
        """Return von Mises amplitude and mean (n,), Pa."""
        return criteria.amplitude_and_mean(self.coefficients)

    @property
    def amplitude(self) -> Pascals:
        """Von Mises stress amplitude (n,), Pa."""
        return self.amplitude_and_mean().amplitude

    @property
    def mean(self) -> Pascals:
        """Mean stress (n,), Pa: trace of the mean tensor."""
        return self.amplitude_and_mean().mean

    @property
    def critical(self) -> int:
        """Index of the counted point with the largest von Mises amplitude."""
        return int(np.where(self.counted, self.amplitude, -1.0).argmax())

    def _order(self) -> NDArray:
        return np.lexsort((-self.amplitude, ~self.counted))

    def _headline(self) -> str:
        i, cycle = self.critical, self.amplitude_and_mean()
        stress = f"{amount(cycle.amplitude[i], 'Pa')} about a mean of {amount(cycle.mean[i], 'Pa')}"
        at = f"{amount(self.frequency, 'Hz')}, preload {amount(self.preload, 'N')}"
        return f"Largest stress amplitude (von Mises) {stress} at {self.names[i]} ({at}).{doubts(self.notes)}"


@validation.check_arguments
def stress(
    problem: Problem,
    result: SomeResult,
    index: int | None = None,
    *,
    sets: str | Sequence[str] | None = None,
    speed: float | None = None,
) -> StressCycle:
    """Compute the stress of a solution over the vibration cycle.

    Parameters
    ----------
    problem : Problem
    result : Peak, ResponseCurve or OptimalCurve
        Result of this problem.
    index : int, optional
        Index of a point of a curve. By default the highest point of a response curve and the lowest of an optimal curve.
    sets : str or sequence of str, optional
        Stress sets of the model; all by default.
    speed : float, rad/s, optional
        Rotor speed. By default the speed of the study, or the speed at which the engine order excites at the frequency of
        the solution; 0 for a structure that does not rotate.

    Returns
    -------
    StressCycle

    Raises
    ------
    SettingError
        If the model has no stress sets, or the result belongs to another problem.
    """
    chosen, solutions = chosen_sets(problem, sets), solutions_of(problem, result)
    n = len(solutions.unknowns)
    if n > 1:
        if index is None:
            check_ends(result)
        index = (
            _highest(result, solutions)
            if index is None
            else validation.integer("index", index, least=0, most=n - 1)
        )
    chosen_one = Solutions(*(column[[index or 0]] for column in solutions))
    cycle = of_solution(problem, chosen_one, chosen, speed)
    return replace(cycle, notes=(*cycle.notes, *check_loads(problem, chosen_one, chosen, speed)))


@validation.check_arguments
def gauge_stress(
    problem: Problem,
    result: SomeResult,
    gauge: str | Sequence[float],
    direction: Direction,
    elastic: Sequence[float] | None = None,
) -> NDArray:
    """Return normal stress or strain at a gauge for every point of a result.

    Parameters
    ----------
    problem : Problem
    result : Peak, ResponseCurve or OptimalCurve
        Result of this problem.
    gauge : str or (3,) float, m
        Name of a point of a stress set ("root node 215" or "root point 3", as in :class:`StressCycle`), or coordinates. The
        nearest point is used; its distance is limited to a twentieth of the largest coordinate.
    direction : {"tangential", "radial", "axial"} or three floats
        Direction of the gauge.
    elastic : (Young's modulus in Pa, Poisson's ratio), optional
        Constants of a linear elastic isotropic material; if given, the result is strain.

    Returns
    -------
    (n, n_harmonics + 1) complex, Pa or 1
        Mean with centrifugal part, and complex amplitude of each harmonic. n is 1 for a peak; rows without a solution are
        NaN.

    Raises
    ------
    SettingError
        If there is no such point, no point near the coordinates, or the result belongs to another problem.
    """
    named = {name: (s, k) for s in chosen_sets(problem) for k, name in enumerate(s.point_names)}
    if not isinstance(gauge, str):
        position, points = (
            validation.numbers("gauge, m", gauge, 3),
            np.array([s.points[k] for s, k in named.values()]),
        )
        away, near = np.linalg.norm(points - position, axis=1), 0.05 * np.abs(points).max()
        gauge, least = list(named)[int(away.argmin())], float(away.min())
        nearest = f"'{gauge}' as the nearest, {amount(least, 'm')} away"
        expected = f"coordinates within {amount(near, 'm')} of a point of the stress sets"
        validation.check(least <= near, "gauge", expected, nearest)
    whole, k = named[validation.choice("gauge", gauge, named)]
    tensor = coefficients_of(problem, solutions_of(problem, result), (whole,))[:, k]
    x, y, z = direction_vector(direction, "direction")
    along = np.array([x * x, y * y, z * z, 2.0 * x * y, 2.0 * y * z, 2.0 * x * z])
    if elastic is not None:
        modulus, poisson = validation.numbers(
            "elastic, Young's modulus and Poisson's ratio", elastic, 2, least=0.0
        )
        expected = "a modulus above 0 and a ratio from 0 to 0.5"
        validation.check(modulus > 0.0 and poisson <= 0.5, "elastic", expected, elastic)
        along = (
            (1.0 + poisson) * along - poisson * np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
        ) / modulus
    return np.asarray(np.einsum("c,mcl->ml", along, tensor))


def _highest(result: Any, solutions: Solutions) -> int:
    sign = -1.0 if np.ndim(result.preload) else 1.0  # an optimal curve is best at its minimum
    height = sign * np.asarray(result.amplitude)
    return int(
        np.where(
            np.isfinite(height) & np.isfinite(solutions.unknowns).all(axis=1), height, -np.inf
        ).argmax()
    )


DOUBTED_LOAD = "the centrifugal stress belongs to a preload of "
SCALED = "vibration scaled by "
UNSETTLED = "the amplitude in time is "
APART = "elements at "
SMALLER = " of them with a smaller factor"


def speeds(problem: Problem, frequency: NDArray, speed: float | None = None) -> NDArray:
    """Return the rotor speed (m,) in rad/s.

    Parameters
    ----------
    problem : Problem
    frequency : (m,) float, Hz
    speed : float, rad/s, optional
        By default the speed of the study, or the speed at which the engine order excites at ``frequency``.
    """
    turning = speed if speed is not None else problem.settings.speed
    if turning is not None:
        return np.full(len(frequency), validation.number("speed", turning, least=0.0, unit="rad/s"))
    per_frequency = (
        2.0 * np.pi / problem.engine_order
        if problem.model.n_blades > 1 and problem.engine_order
        else 0.0
    )
    return per_frequency * frequency


def check_loads(
    problem: Problem, solutions: Solutions, chosen: Sequence[StressSet], speed: float | None = None
) -> tuple[str, ...]:
    """Compare the preloads with the centrifugal load of the damper at the rotor speed.

    Warn of a contradiction at a given speed.  Otherwise return it as a note: at the speed of the study the search that
    found the solutions has warned, and other studies need a speed for the static stress alone.
    """
    if (solutions.kind == "free").all():  # without dampers
        return ()
    turning = speeds(problem, solutions.frequency, speed)
    if speed is not None:
        problem.sizes.check_preload(solutions.preload, turning)
        return ()
    contradiction = problem.sizes.contradiction(solutions.preload, turning)
    if contradiction is None or (
        problem.settings.speed is None and all(s.static is None for s in chosen)
    ):
        return ()
    return ("{}{}, found {}".format(DOUBTED_LOAD, *contradiction),)


def check_ends(result: SomeResult) -> None:
    """Warn of a response curve whose highest point, or an optimal curve whose least amplitude, is at its end."""
    curve: Any = result
    if getattr(result, "peak_at_end", False):
        found = f"the highest response at its end, {peak_text(curve.peak.amplitude, curve.peak.frequency)}"
        warn_implausible("result", "a response curve with its peak inside the interval", found)
    elif getattr(getattr(result, "optimum", None), "kind", "") == "end":
        found = f"the least amplitude at its end, {amount(curve.optimum.preload, 'N')}"
        warn_implausible("result", "an optimal curve with its optimum inside the range", found)


def doubts(notes: Sequence[str]) -> str:
    """Return as sentences the notes that a reader of the largest stress or the least margin must know."""
    starts = (DOUBTED_LOAD, SCALED, UNSETTLED, APART)
    shown = [note for note in notes if note.startswith(starts) or note.endswith(SMALLER)]
    return "".join(f" {note[0].upper()}{note[1:]}." for note in shown)


def chosen_sets(problem: Problem, sets: str | Sequence[str] | None = None) -> tuple[StressSet, ...]:
    """Return stress sets by name, at the contact points of the study."""
    known = problem.coupling.model.stress
    validation.check(
        known, "stress", "a model with stress sets", "none (docs/speed.md explains how to add them)"
    )
    names = [sets] if isinstance(sets, str) else list(known if sets is None else sets)
    return tuple(known[validation.choice("stress set", name, list(known))] for name in names)


def of_solution(
    problem: Problem, solution: Solutions, chosen: Sequence[StressSet], speed: float | None = None
) -> StressCycle:
    """Return the stress of one solution over the cycle."""
    bare = [s for s in chosen if not s.contact and problem.model.bodies[s.body].ports]
    notes = [
        f"set '{s.name}' has no rows for contact forces: their stress is neglected" for s in bare
    ]
    notes += [
        f"set '{s.name}' has no centrifugal stress: the mean stress neglects it"
        for s in chosen
        if s.static is None
    ]
    return StressCycle(
        points=np.concatenate([s.points for s in chosen]),
        names=tuple(name for s in chosen for name in s.point_names),
        coefficients=coefficients_of(problem, solution, chosen, speed)[0],
        counted=np.concatenate([s.counted for s in chosen]),
        spread=np.concatenate(
            [np.full(len(s), np.nan) if s.spread is None else s.spread for s in chosen]
        ),
        frequency=float(solution.frequency[0]),
        preload=float(solution.preload[0]),
        speed=float(speeds(problem, solution.frequency, speed)[0]),
        notes=tuple(notes),
        **problem.recorded(),
    )


def coefficients_of(
    problem: Problem, solutions: Solutions, sets: Sequence[StressSet], speed: float | None = None
) -> NDArray:
    """Return mean and harmonics (m, n, 6, H + 1) of the stress of m solutions, Pa."""
    n, n_harmonics = sum(map(len, sets)), problem.harmonic_numbers[-1]
    out = np.full((len(solutions.unknowns), n, 6, n_harmonics + 1), np.nan, complex)
    centrifugal = np.concatenate(
        [np.zeros((len(s), 6)) if s.static is None else s.static for s in sets]
    )
    present = sorted({0, *problem.settings.active_harmonics})
    parts = {l: [_Rows.make(problem, s, l) for s in sets] for l in present}
    turning = speeds(problem, solutions.frequency, speed)
    contacts: dict[tuple[float, str], Callable[[NDArray], list[NDArray]]] = {}
    for i, (u, frequency, preload, kind) in enumerate(zip(*solutions)):
        if not np.isfinite(u).all():
            continue
        if (preload, kind) not in contacts:
            contacts = {(preload, kind): _contact_forces(problem, preload, kind)}
        forces = contacts[preload, kind](u)
        out[i] = 0.0
        for l in present:
            force, q = forces[l], problem.layout.amplitudes(u, l)
            coordinates = problem.bases[l].coordinates
            if l == 0 and (kind == "stuck" or (kind != "free" and not problem.settings.bias)):
                state = problem.at(preload).equilibrium
                q, force, coordinates = (
                    state.q,
                    state.force.ravel(),
                    problem.static_basis.coordinates,
                )
            by_body: dict[str, dict[int, complex]] = {}
            for coordinate, value in zip(coordinates, q):
                by_body.setdefault(coordinate.body, {})[coordinate.index] = value
            values = [
                rows.stress(by_body.get(rows.body.name, {}), force, 2.0 * np.pi * frequency)
                for rows in parts[l]
            ]
            out[i, ..., l] = np.concatenate(values)
        out[i, ..., 0] = out[i, ..., 0].real + turning[i] ** 2 * centrifugal
    return out


def _contact_forces(
    problem: Problem, preload: float, kind: str
) -> Callable[[NDArray], list[NDArray]]:
    """Return the function that gives the contact forces (3 n_points,) of each harmonic from the unknowns of a solution."""
    case = problem.at(preload)
    if kind in ("free", "stuck"):
        linear = case.sector.linear
        springs = linear.springs + (case.stuck_springs(touching=True) if kind == "stuck" else 0.0)
        return lambda u: [
            (springs * (basis.G @ linear.layout.amplitudes(u, l))).ravel()
            for l, basis in enumerate(linear.bases)
        ]
    system, axes = case.equations, _contact_axes(problem, preload)

    def forces(u: NDArray) -> list[NDArray]:
        F = system.contact(u)[1]
        harmonics = np.concatenate([F[..., :1], F[..., 1::2] - 1j * F[..., 2::2]], axis=-1)
        return list(np.einsum("pdk,pdl->lk", axes, harmonics))

    return forces


def _contact_axes(problem: Problem, preload: float) -> NDArray:
    """Return the transformation (n_system, 3, 3 n_points) of contact forces from the equations to the axes of the model."""
    n = problem.coupling.n_points
    basis = replace(problem.bases[1], G=np.eye(3 * n).reshape(n, 3, 3 * n))
    points = PointArrays(
        kt=np.ones((n, 2)), kn=np.ones(n), mu=np.zeros(n), n0=np.zeros(n), slider=np.zeros((n, 2)),
        law=problem.point_laws.copy(), shift=np.zeros((n, 3)),
    )  # fmt: skip
    bases = [basis]
    if not problem.settings.separation or not problem.settings.variable_normal_load:
        state = problem.at(preload).equilibrium
        constant = not problem.settings.variable_normal_load
        bases, _ = without_separation(
            bases, points, state, problem.friction_points, constant_load=constant
        )
    return np.asarray(bases[0].G.real)


@dataclass(frozen=True)
class _Rows:
    """Matrices for the stress of one set in one harmonic."""

    problem: Problem
    body: Body
    basis: ModalBasis
    modes: NDArray
    contact: NDArray | None
    harmonic: int

    @classmethod
    def make(cls, problem: Problem, chosen: StressSet, harmonic: int) -> _Rows:
        model = problem.coupling.model
        order = problem.engine_order * (1 if problem.settings.fundamental_modes_only else harmonic)
        d, conjugate = model.folded_nodal_diameter(order)
        body = model.bodies[chosen.body]
        if body.kind != "constrained":
            d, conjugate = 0, False
        if d not in chosen.modes:
            needed = f"harmonic {harmonic} needs nodal diameter {d}, it has {sorted(chosen.modes)}"
            raise SettingError(f"stress set '{chosen.name}': {needed}")
        basis, S, A = body.bases[d], chosen.modes[d], chosen.contact.get(d)
        if conjugate:
            basis, S, A = basis.conjugate(), S.conj(), None if A is None else A.conj()
        if harmonic == 0:
            S, A = S.real, None if A is None else A.real
        return cls(problem, body, basis, S, A, harmonic)

    def port_forces(self, force: NDArray) -> NDArray:
        """Return the contact forces (3 n,) on the ports of the body from the forces (3 n_points,) of the contacts."""
        coupling = self.problem.coupling
        model, out = coupling.model, np.zeros((len(self.basis.contact_modes), 3), complex)
        force = force.reshape(-1, 3) * np.array([1.0, 1.0, -1.0])
        for name, side in self.body.ports:
            if name in coupling.interfaces:
                face = model.interfaces[name]
                sector, sense = (face.sector_a, 1.0) if side == "a" else (face.sector_b, -1.0)
                turn = np.exp(
                    -2j * np.pi * coupling.engine_order * self.harmonic * sector / model.n_blades
                )
                out[model.port_slice(self.body.name, (name, side))] = (
                    sense * turn * force[coupling.rows(name)]
                )
        return out.ravel()

    def stress(self, known: dict[int, complex], force: NDArray, omega: float) -> NDArray:
        """Return the complex stress amplitude (n, 6).

        Parameters
        ----------
        known : mapping of mode index to complex
            Coordinates of the retained modes; the other modes respond to the forces.
        force : (3 n_points,) complex, N
        omega : float, rad/s
            Angular frequency of the fundamental harmonic.
        """
        problem, basis, l = self.problem, self.basis, self.harmonic
        at_ports = self.port_forces(force)
        q = basis.contact_modes.reshape(len(at_ports), -1).conj().T @ at_ports
        for at, along, excitation in problem.settings.excited.get(l, []):
            if at in basis.locations:
                q = q + (along @ basis.locations[at]).conj() * excitation
        ratio_of_study = problem.settings.damping_ratio
        ratio = (
            basis.damping_ratio
            if ratio_of_study is None
            else np.full(basis.n_modes, ratio_of_study)
        )
        w = l * omega
        dynamic = basis.omega2 - w**2 + 2j * ratio * np.sqrt(basis.omega2) * w
        q = np.divide(q, dynamic, out=np.zeros_like(q), where=dynamic != 0.0)
        for index, value in known.items():
            q[index] = value
        out = self.modes @ q
        if self.contact is not None and len(at_ports):
            out = out + self.contact @ at_ports
        return np.asarray(out)
