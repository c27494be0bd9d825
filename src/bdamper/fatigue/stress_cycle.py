r"""Stress over the cycle of a solution, at the points of the model's stress sets.

.. math:: \sigma(\theta) = \Omega^2 \sigma_1 + S_0 q_0 + A_0 F_0
          + \sum_{l \ge 1} \mathrm{Re}[(S_l q_l + A_l F_l)\,e^{i l \theta}],

with all modes that the model has: coordinates of the modes that the study retains come from the solution, those of the
others from the contact forces and the excitation on them, as they answer at ``l omega``.  The centrifugal stress is that of
the rotor without dampers, whose share comes with ``q_0`` and ``F_0``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from bdamper.contact.laws import PointArrays
from bdamper.fatigue import criteria
from bdamper.harmonic_balance.contact_setup import without_separation
from bdamper.harmonic_balance.equations import Equations
from bdamper.harmonic_balance.problem import Problem
from bdamper.harmonic_balance.result_checks import Solutions, SomeResult, solutions_of
from bdamper.harmonic_balance.sector import Sector
from bdamper.model.loads import Direction, direction_vector
from bdamper.model.structure import Body, ModalBasis, StressSet
from bdamper.util import validation
from bdamper.util.display import Comparable, Plottable
from bdamper.util.errors import SettingError
from bdamper.util.formatting import amount, short_repr
from bdamper.util.storage import Recorded, Storable
from bdamper.util.tables import Numbers, Pascals, PerRow, Quantity, Tabular


@dataclass(frozen=True, kw_only=True)
class AtPoints:
    """What is known of the points of stress sets, and of the solution whose stress it is.

    Parameters
    ----------
    points : (n, 3) float, m
    names : tuple of str
        Name of each point: its set and its number in it, from 1.
    counted : (n,) bool
        Points away from contact faces, which margins count.
    spread : (n,) float
        Difference between elements over the mean, a sign of the error of the mesh; NaN where the set does not know it.
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
class StressCycle(AtPoints, Plottable, Comparable, Tabular, Recorded, Storable, kind="bdamper-stress", row="location"):
    """Stress over the cycle of one solution.

    ``plot`` draws the von Mises value and the components over the cycle (:func:`bdamper.plot.plot_stress`).

    Parameters
    ----------
    coefficients : (n, 6, H + 1) complex, Pa
        Mean, centrifugal stress included, and amplitude of each harmonic; components xx, yy, zz, xy, yz, xz.
    settings : mapping
    model_hash : str
    """

    coefficients: PerRow

    def over_cycle(self, theta: NDArray) -> NDArray:
        """(n, 6, n_theta) stress (Pa) at angles of the excitation (rad)."""
        return criteria.over_cycle(self.coefficients, np.asarray(theta, float))

    def amplitude_and_mean(self, criterion: str = "von_mises") -> criteria.Cycle:
        """Amplitude and mean (n,), Pa, by one of "von_mises", "signed_von_mises", "principal"."""
        validation.choice("criterion", criterion, criteria.CRITERIA[:3])
        return criteria.amplitude_and_mean(self.coefficients, criterion)

    @property
    def amplitude(self) -> Pascals:
        """(n,) float, Pa: amplitude by von Mises."""
        return self.amplitude_and_mean().amplitude

    @property
    def mean(self) -> Pascals:
        """(n,) float, Pa: the mean beside it."""
        return self.amplitude_and_mean().mean

    @property
    def critical(self) -> int:
        """The counted point of largest amplitude by von Mises."""
        return int(np.where(self.counted, self.amplitude, -1.0).argmax())

    def _headline(self) -> str:
        i, cycle = self.critical, self.amplitude_and_mean()
        stress = f"{amount(cycle.amplitude[i], 'Pa')} about a mean of {amount(cycle.mean[i], 'Pa')}"
        at = f"{amount(self.frequency, 'Hz')}, preload {amount(self.preload, 'N')}"
        return f"Largest stress amplitude (von Mises) {stress} at {self.names[i]} ({at})."


@validation.check_arguments
def stress(
    problem: Problem,
    result: SomeResult,
    index: int | None = None,
    *,
    sets: str | Sequence[str] | None = None,
    speed: float | None = None,
) -> StressCycle:
    """Stress over the cycle of a solution.

    Parameters
    ----------
    problem : Problem
    result : Peak, ResponseCurve or OptimalCurve
        Of this problem.
    index : int, optional
        Point of a curve; by default the highest of a curve, and the least of an optimal curve.
    sets : str or sequence of str, optional
        Stress sets of the model; all by default.
    speed : float, rad/s, optional
        Speed of rotation; that of the study if it has one, otherwise the speed at which the engine order excites at the
        frequency of the solution, and none for a structure that does not rotate.

    Raises
    ------
    SettingError
        If the model has no stress, or the result is not one of this problem.
    """
    chosen, found = chosen_sets(problem, sets), solutions_of(problem, result)
    n = len(found.unknowns)
    if n > 1:
        index = _highest(result, found) if index is None else validation.integer("index", index, least=0, most=n - 1)
    return of_solution(problem, Solutions(*(column[[index or 0]] for column in found)), chosen, speed)


@validation.check_arguments
def gauge_stress(
    problem: Problem,
    result: SomeResult,
    gauge: str | Sequence[float],
    direction: Direction,
    elastic: Sequence[float] | None = None,
) -> NDArray:
    """Normal stress along a direction, or the strain that a gauge measures there, at every point of a result.

    Parameters
    ----------
    problem : Problem
    result : Peak, ResponseCurve or OptimalCurve
        Of this problem.
    gauge : str or (3,) float, m
        Name of a point of a stress set ("root 12", as :class:`StressCycle` names them), or a place whose nearest point is
        no farther away than a twentieth of the largest coordinate of the points.
    direction : {"tangential", "radial", "axial"} or three floats
    elastic : (Young's modulus in Pa, Poisson's ratio), optional
        Return strain, of a linear elastic isotropic material.

    Returns
    -------
    (n, n_harmonics + 1) complex, Pa or 1
        Mean, centrifugal part included, and amplitude of each harmonic; n is 1 for a peak, NaN where a curve has no value.

    Raises
    ------
    SettingError
        If there is no such point or none near the place, or the result is not one of this problem.
    """
    named = {f"{s.name} {k + 1}": (s, k) for s in chosen_sets(problem) for k in range(len(s))}
    if not isinstance(gauge, str):
        place, points = validation.numbers("gauge, m", gauge, 3), np.array([s.points[k] for s, k in named.values()])
        away, near = np.linalg.norm(points - place, axis=1), 0.05 * np.abs(points).max()
        gauge, least = list(named)[int(away.argmin())], float(away.min())
        told = f"'{gauge}' as the nearest, {amount(least, 'm')} away"
        validation.check(
            least <= near, "gauge", f"a place within {amount(near, 'm')} of a point of the stress sets", told
        )
    whole, k = named[validation.choice("gauge", gauge, named)]
    tensor = coefficients_of(problem, solutions_of(problem, result), (whole,))[:, k]
    x, y, z = direction_vector(direction, "direction")
    along = np.array([x * x, y * y, z * z, 2.0 * x * y, 2.0 * y * z, 2.0 * x * z])
    if elastic is not None:
        modulus, poisson = validation.numbers("elastic, Young's modulus and Poisson's ratio", elastic, 2, least=0.0)
        expected = "a modulus above 0 and a ratio from 0 to 0.5"
        validation.check(modulus > 0.0 and poisson <= 0.5, "elastic", expected, elastic)
        along = ((1.0 + poisson) * along - poisson * np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])) / modulus
    return np.asarray(np.einsum("c,mcl->ml", along, tensor))


def _highest(result: Any, found: Solutions) -> int:
    height = -np.asarray(result.amplitude) if np.ndim(result.preload) else np.asarray(result.amplitude)  # the least is best
    return int(np.where(np.isfinite(height) & np.isfinite(found.unknowns).all(axis=1), height, -np.inf).argmax())


def speeds(problem: Problem, frequency: NDArray, speed: float | None = None) -> NDArray:
    """(m,) speed of rotation, rad/s: the one given, that of the study, or that at which the engine order excites."""
    turning = speed if speed is not None else problem.settings.speed
    if turning is not None:
        return np.full(len(frequency), validation.number("speed", turning, least=0.0, unit="rad/s"))
    own = 2.0 * np.pi / problem.engine_order if problem.model.n_blades > 1 and problem.engine_order else 0.0
    return own * frequency


def chosen_sets(problem: Problem, sets: str | Sequence[str] | None = None) -> tuple[StressSet, ...]:
    """The stress sets asked for, as the study's contact points have them."""
    known = problem.coupling.model.stress
    validation.check(known, "stress", "a model with stress sets", "none (docs/fatigue.md tells how to make them)")
    names = [sets] if isinstance(sets, str) else list(known if sets is None else sets)
    return tuple(known[validation.choice("stress set", name, list(known))] for name in names)


def of_solution(problem: Problem, found: Solutions, chosen: Sequence[StressSet], speed: float | None = None) -> StressCycle:
    """Stress over the cycle of one solution."""
    bare = [s for s in chosen if not s.contact and problem.model.bodies[s.body].ports]
    notes = [f"set '{s.name}' has no rows for contact forces: it lacks their share" for s in bare]
    notes += [f"set '{s.name}' has no centrifugal stress: the mean lacks it" for s in chosen if s.static is None]
    return StressCycle(
        points=np.concatenate([s.points for s in chosen]),
        names=tuple(f"{s.name} {k + 1}" for s in chosen for k in range(len(s))),
        coefficients=coefficients_of(problem, found, chosen, speed)[0],
        counted=np.concatenate([s.counted for s in chosen]),
        spread=np.concatenate([np.full(len(s), np.nan) if s.spread is None else s.spread for s in chosen]),
        frequency=float(found.frequency[0]),
        preload=float(found.preload[0]),
        speed=float(speeds(problem, found.frequency, speed)[0]),
        notes=tuple(notes),
        **problem.recorded(),
    )


def coefficients_of(problem: Problem, found: Solutions, sets: Sequence[StressSet], speed: float | None = None) -> NDArray:
    """Mean and harmonics (m, n, 6, H + 1) of the stress, Pa."""
    n, n_harmonics = sum(map(len, sets)), problem.harmonic_numbers[-1]
    out = np.full((len(found.unknowns), n, 6, n_harmonics + 1), np.nan, complex)
    centrifugal = np.concatenate([np.zeros((len(s), 6)) if s.static is None else s.static for s in sets])
    present = sorted({0, *problem.settings.active_harmonics})
    parts = {l: [_Rows.make(problem, s, l) for s in sets] for l in present}
    turning = speeds(problem, found.frequency, speed)
    systems: dict[float, tuple[Equations[Sector], NDArray]] = {}
    for i, (u, frequency, preload) in enumerate(zip(*found)):
        if not np.isfinite(u).all():
            continue
        if preload not in systems:
            systems = {preload: (problem.system(preload), _contact_axes(problem, preload))}
        system, axes = systems[preload]
        F = system.contact(u)[1]
        out[i] = 0.0
        for l in present:
            f = F[..., 0] if l == 0 else F[..., 2 * l - 1] - 1j * F[..., 2 * l]
            force = np.einsum("pdk,pd->k", axes, f)
            q = system.layout.amplitudes(u, l)
            coordinates = problem.bases[l].coordinates
            if l == 0 and not problem.settings.bias:
                state = problem.equilibrium(preload)
                q, force, coordinates = state.q, state.force.ravel(), problem.static_basis.coordinates
            by_body: dict[str, dict[int, complex]] = {}
            for coordinate, value in zip(coordinates, q):
                by_body.setdefault(coordinate.body, {})[coordinate.index] = value
            values = [rows.stress(by_body.get(rows.body.name, {}), force, 2.0 * np.pi * frequency) for rows in parts[l]]
            out[i, ..., l] = np.concatenate(values)
        out[i, ..., 0] = out[i, ..., 0].real + turning[i] ** 2 * centrifugal
    return out


def _contact_axes(problem: Problem, preload: float) -> NDArray:
    """(n_system, 3, 3 n_points) from forces at the points of the equations to those along the axes of the model."""
    n = problem.coupling.n_points
    basis = replace(problem.bases[1], G=np.eye(3 * n).reshape(n, 3, 3 * n))
    points = PointArrays(
        kt=np.ones((n, 2)), kn=np.ones(n), mu=np.zeros(n), n0=np.zeros(n), slider=np.zeros((n, 2)),
        law=problem.point_laws.copy(), shift=np.zeros((n, 3)),
    )  # fmt: skip
    bases = [basis]
    if not problem.settings.separation or not problem.settings.variable_normal_load:
        state = problem.equilibrium(preload)
        constant = not problem.settings.variable_normal_load
        bases, _ = without_separation(bases, points, state, problem.friction_points, constant_load=constant)
    return np.asarray(bases[0].G.real)


@dataclass(frozen=True)
class _Rows:
    """What gives the stress of one set at one harmonic."""

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
        """(3 n,) contact forces on the body at its ports, from those (3 n_points,) of the contacts."""
        coupling = self.problem.coupling
        model, out = coupling.model, np.zeros((len(self.basis.contact_modes), 3), complex)
        force = force.reshape(-1, 3) * np.array([1.0, 1.0, -1.0])
        for name, side in self.body.ports:
            if name in coupling.interfaces:
                face = model.interfaces[name]
                sector, sense = (face.sector_a, 1.0) if side == "a" else (face.sector_b, -1.0)
                turn = np.exp(-2j * np.pi * coupling.engine_order * self.harmonic * sector / model.n_blades)
                out[model.port_slice(self.body.name, (name, side))] = sense * turn * force[coupling.rows(name)]
        return out.ravel()

    def stress(self, known: dict[int, complex], force: NDArray, omega: float) -> NDArray:
        """(n, 6) complex amplitude: retained modes by their coordinates, the others by the forces on them."""
        problem, basis, l = self.problem, self.basis, self.harmonic
        at_ports = self.port_forces(force)
        q = basis.contact_modes.reshape(len(at_ports), -1).conj().T @ at_ports
        for at, along, excitation in problem.settings.excited.get(l, []):
            if at in basis.locations:
                q = q + (along @ basis.locations[at]).conj() * excitation
        given = problem.settings.damping_ratio
        ratio = basis.damping_ratio if given is None else np.full(basis.n_modes, given)
        w = l * omega
        dynamic = basis.omega2 - w**2 + 2j * ratio * np.sqrt(basis.omega2) * w
        q = np.divide(q, dynamic, out=np.zeros_like(q), where=dynamic != 0.0)
        for index, value in known.items():
            q[index] = value
        out = self.modes @ q
        if self.contact is not None and len(at_ports):
            out = out + self.contact @ at_ports
        return np.asarray(out)
