"""Rotor speed: a problem at one speed and its conditions, and the equations along an engine order
line.

The preload of a free body is its centrifugal load ``P = m r Omega^2`` along its radial axis, with
the radius ``r`` of its centre of mass at rest.  Speeds are in rad/s.

On an engine order line, ``omega = EO Omega``, all quantities depend on the rotor speed:

    R(u, omega) = r(u, omega; K(Omega), G(Omega), k(Omega), P(Omega), ...) = 0

Each array of the equations, and the row of the response, is a polynomial in the squared speed that
interpolates the arrays at a few speeds.  The derivative along the line is the exact derivative of
the polynomials (``csrc/balance/speed_family.c``).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Annotated, Any

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from bdamper import _core
from bdamper.contact.laws import refuse
from bdamper.harmonic_balance.equations import Equations, Rows
from bdamper.harmonic_balance.problem import Problem
from bdamper.harmonic_balance.sector import SectorData
from bdamper.model.kinematics import HarmonicBasis, centrifugal_load
from bdamper.model.validation import as_checked
from bdamper.util import validation
from bdamper.util.errors import SettingError, warn_implausible
from bdamper.util.formatting import short_text

RPM = 60.0 / (2.0 * np.pi)
"""Revolutions per minute in one rad/s."""
Table = Mapping[float, float] | Callable[[float], float]
"""Function of one number, or a table of its values for linear interpolation, which is an error
outside the table."""
Excitations = Callable[[float, int], float] | Mapping[int, Any]


def read(name: str, table: Table, at: float) -> float:
    """Evaluate a function, or interpolate a table linearly; raise SettingError outside the
    table."""
    if callable(table):
        return validation.number(f"{name} at {at:g}", table(at))
    places = sorted(table)
    if not places[0] <= at <= places[-1]:
        raise SettingError(
            f"{name}: expected a table that includes {at:g}, found {places[0]:g} to {places[-1]:g}"
        )
    return float(np.interp(at, places, [table[x] for x in places]))


def _table(name: str, table: Table) -> Table:
    if isinstance(table, Mapping) and table:
        validation.numbers(f"{name}, where its values are given", list(table))
        validation.numbers(f"{name}, values", list(table.values()))
    elif not callable(table):
        raise validation.invalid(name, "a function, or a mapping of numbers to numbers", table)
    return table


def _excitation(name: str, excitation: Excitations) -> Excitations:
    if isinstance(excitation, Mapping) and excitation:
        for order, value in excitation.items():
            order = validation.integer(f"{name}, engine order", order, least=1)
            item = f"{name} of engine order {order}"
            if isinstance(value, Mapping):
                _table(item, value)
            else:
                validation.number(item, value, above=0.0, unit="N")
    elif not callable(excitation):
        expected = "a function or a mapping of engine order to newtons"
        raise validation.invalid(name, expected, excitation)
    return excitation


@validation.check_arguments
@dataclass(frozen=True)
class Conditions:
    """Conditions that depend on the rotor speed in addition to structure and preload.

    Parameters
    ----------
    friction : mapping of number to number, or callable, optional
        Friction coefficient of all friction faces as a function of speed (rad/s), or of
        ``temperature`` if it is given.
    temperature : mapping of number to number, or callable, optional
        Temperature of the contacts as a function of speed, in the unit that ``friction`` uses.
    excitation : callable or mapping, optional
        Amplitude of the excitation (N): ``excitation(omega, engine_order)``, or for each engine
        order a number or a mapping of speed to newtons.

    Raises
    ------
    SettingError
        If a value is not valid, or a temperature is given without friction.
    """

    friction: Annotated[Table, _table] | None = None
    temperature: Annotated[Table, _table] | None = None
    excitation: Annotated[Excitations, _excitation] | None = None

    def __post_init__(self) -> None:
        validation.check_fields(self)
        if self.temperature is not None and self.friction is None:
            raise SettingError(
                "temperature: give friction as well, as a function or table of temperature"
            )

    def __repr__(self) -> str:  # without memory addresses, so that it is reproducible
        stated = []
        for item in fields(self):
            value = getattr(self, item.name)
            if value is None:
                continue
            text = repr(value)
            if hasattr(value, "__qualname__"):
                text = f"{value.__module__}.{value.__qualname__}"
            stated.append(f"{item.name}={text}")
        return f"Conditions({', '.join(stated)})"

    def values(
        self, speeds: Iterable[float], engine_orders: Iterable[int]
    ) -> tuple[tuple[float | None, ...], ...]:
        """Return the friction coefficient and the excitation of each engine order at given speeds.

        These values identify the conditions in results files, because callables cannot be compared.
        """
        orders = list(engine_orders)
        by_speed = []
        for omega in speeds:
            excitations = [self.excitation_at(omega, order) for order in orders]
            by_speed.append((self.friction_at(omega), *excitations))
        return tuple(by_speed)

    def reach(self, engine_order: int) -> tuple[float, float]:
        """Return the range of speeds (rad/s) covered by all tables of speed."""
        # with a temperature the friction coefficient is a table over temperature, not speed
        over_speed: list[Any] = [self.friction]
        if self.temperature is not None:
            over_speed = [self.temperature]
        if isinstance(self.excitation, Mapping):
            over_speed.append(self.excitation.get(engine_order))
        tables = [table for table in over_speed if isinstance(table, Mapping)]
        low = max((min(table) for table in tables), default=0.0)
        high = min((max(table) for table in tables), default=float("inf"))
        return low, high

    def friction_at(self, omega: float) -> float | None:
        """Return the friction coefficient at a speed; None if it is constant."""
        if self.friction is None:
            return None
        variable = omega
        if self.temperature is not None:
            variable = read("temperature", self.temperature, omega)
        friction = read("friction", self.friction, variable)
        return validation.number("friction", friction, least=0.0)

    def excitation_at(self, omega: float, engine_order: int) -> float | None:
        """Return the amplitude of the excitation (N) at a speed; None if it is constant."""
        excitation = self.excitation
        if excitation is None:
            return None
        if callable(excitation):
            force: Any = excitation(omega, engine_order)
        elif engine_order not in excitation:
            raise SettingError(
                f"excitation: expected a value for engine order {engine_order}, "
                f"found orders {list(excitation)}"
            )
        else:
            force = excitation[engine_order]
            if isinstance(force, Mapping):
                force = read("excitation", force, omega)
        return validation.number(
            f"excitation of engine order {engine_order} at {omega:g} rad/s",
            force,
            above=0.0,
            unit="N",
        )


def preload_at(problem: Problem, omega: float) -> float:
    """Return the preload (N) from the damper's mass at a rotor speed (rad/s); 0 if the damper
    carries no load."""
    return centrifugal_load(problem.model) * omega**2 if problem.carries_load else 0.0


Speeds = Sequence[float] | NDArray | float
"""One rotor speed or several."""


def asked_speeds(
    problem: Problem,
    speeds: Speeds | None,
    rpm: Speeds | None,
    check: Callable[..., Any] = validation.numbers,
) -> Any:
    """Return speeds in rad/s from arguments in rad/s or in revolutions per minute; warn if rpm were
    probably given as rad/s.

    Raises
    ------
    SettingError
        If none or both are given, or a speed is not positive.
    """
    if (speeds is None) == (rpm is None):
        raise SettingError(
            f"rotor speed: expected a value in rad/s or rpm=, found {'none' if rpm is None else 'both'}"
        )
    if rpm is not None:
        return check("rpm", rpm, above=0.0) / RPM
    name = "speeds" if check is validation.numbers else "rotor speed"
    values = check(name, speeds, above=0.0, unit="rad/s")
    radius = 0.0
    for place in problem.model.locations.values():
        radius = max(float(np.hypot(*place.position[:2])), radius)
    # largest plausible tip speed (m/s): the longest titanium blades of steam turbines reach about
    # 750
    tip_speed = 800.0
    if radius * np.max(values) > tip_speed:
        warn_implausible(
            "rotor speed",
            f"at most {tip_speed / radius:.0f} rad/s, {tip_speed:g} m/s at a radius of {radius:.3g} m",
            f"{np.max(values):g}; possibly given in revolutions per minute; use rpm={short_text(speeds)}",
        )
    return values


def at_speed(
    problem: Problem,
    omega: float | None = None,
    *,
    rpm: float | None = None,
    conditions: Conditions,
) -> Problem:
    """See :meth:`bdamper.Study.at_speed`."""
    bodies = problem.model.bodies.values()
    depends_on_speed = conditions != Conditions()
    for body in bodies:
        modes_over_speed = any(basis.speed for basis in body.bases.values())
        if body.load is not None or body.spin is not None or modes_over_speed:
            depends_on_speed = True
    validation.check(
        depends_on_speed,
        "rotor speed",
        "a model with a loaded body, speed-dependent modes or displacement due to rotation, or "
        "conditions",
        "a model in which nothing depends on speed",
    )
    speed = asked_speeds(problem, omega, rpm, validation.number)
    return under(problem, speed, conditions)


def under(problem: Problem, omega: float, conditions: Conditions) -> Problem:
    """Return the problem at a rotor speed (rad/s) under the given conditions; see
    :func:`at_speed`."""
    changes: dict[str, Any] = {"model": as_checked(problem.model.at_speed(omega)), "speed": omega}
    mu = conditions.friction_at(omega)
    if mu is not None:
        changes["friction_coefficient"] = mu
    force = conditions.excitation_at(omega, int(problem.engine_order))
    if force is not None:
        changes["excitation"] = replace(problem.settings.excitation, amplitude=force)
    return problem.replace(**changes)


def node_speeds(low: float, high: float, n: int) -> NDArray:
    """Return n speeds, descending, whose squares are the Chebyshev points of the interval of the
    squared speed."""
    low_square = low**2
    high_square = high**2
    # zeros of the Chebyshev polynomial T_n in (-1, 1)
    chebyshev_points = np.cos(np.pi * (np.arange(n) + 0.5) / n)
    middle = 0.5 * (low_square + high_square)
    half = 0.5 * (high_square - low_square)
    return np.sqrt(middle + half * chebyshev_points)


@dataclass(frozen=True, eq=False)
class Family:
    """Equations whose rotor speed follows from the frequency.

    Parameters
    ----------
    sectors : sequence of SectorData
        Sectors at two or more speeds.
    speeds : (n,) float, rad/s
    rows : Rows
        Rows of the response along the line.
    weights : (n, n) float
        Matrix from values at the speeds to coefficients of Chebyshev polynomials.
    """

    sectors: tuple[SectorData, ...]
    speeds: NDArray
    rows: Rows
    weights: NDArray

    @property
    def engine_order(self) -> int:
        """Engine order of the line."""
        return self.rows.engine_order

    @property
    def bases(self) -> list[HarmonicBasis]:
        """Modes of each harmonic at the middle speed."""
        return self.sectors[len(self.sectors) // 2].bases

    def at(self, omega: float) -> Equations[SectorData]:
        """Return the equations at the speed that belongs to a frequency (rad/s), with the frequency
        as a free parameter."""
        # weights (n,) of the sectors at this speed
        weights = self.rows.basis(omega, len(self.speeds)) @ self.weights
        middle = self.sectors[len(self.sectors) // 2]

        def mixed(name: str) -> NDArray:
            """Return an array of the core at this speed."""
            return sum(w * sector.arrays[name] for w, sector in zip(weights, self.sectors))

        # the arrays of the core contain the modes of all harmonics one after the other
        n_points = len(middle.points.kn)
        n_modes = [len(b.omega2) for b in middle.bases]
        # indices at which the next harmonic begins
        ends = np.cumsum(n_modes)[:-1]
        stiffness = np.split(mixed("stiffness"), ends)
        mass = np.split(mixed("mass"), ends)
        damping = np.split(mixed("damping"), ends)
        modes_at_points = np.split(mixed("G"), 3 * n_points * ends)
        bases = []
        for l, basis in enumerate(middle.bases):
            # the array of the core contains all damping, so it is entered as a drag
            mixed_basis = replace(
                basis,
                omega2=stiffness[l],
                mass=mass[l],
                damping_ratio=np.zeros_like(stiffness[l]),
                drag=damping[l],
                G=modes_at_points[l].reshape(basis.G.shape),
            )
            bases.append(mixed_basis)

        points = replace(
            middle.points,
            kt=mixed("kt"),
            kn=mixed("kn"),
            mu=mixed("mu"),
            n0=mixed("n0"),
            slider=mixed("w"),
            shift=mixed("shift"),
            load=mixed("load"),
        )
        sector = replace(
            middle,
            bases=bases,
            points=points,
            force=mixed("force"),
            response_rows=self.response_rows(omega),
        )
        return sector.equations

    def response_rows(self, omega: float) -> list[NDArray]:
        """Return the rows of modal amplitudes that give the response at a frequency (rad/s), for
        each harmonic."""
        weights = self.rows.basis(omega, len(self.speeds)) @ self.weights
        rows = []
        for l in range(len(self.sectors[0].bases)):
            row = sum(w * sector.response_rows[l] for w, sector in zip(weights, self.sectors))
            rows.append(row)
        return rows


def responses(system: Equations[Family], y: NDArray) -> NDArray:
    """Return complex response amplitudes (n, n_harmonics + 1) of mean and harmonics.

    The points (n, n_unknowns + 1) lie on the engine order line.
    """
    amplitudes = np.empty((len(y), system.n_harmonics + 1), complex)
    for i, point in enumerate(y):
        u = point[:-1]
        omega = point[-1]
        for l, row in enumerate(system.structure.response_rows(omega)):
            amplitudes[i, l] = system.layout.amplitudes(u, l) @ row
    return amplitudes


def family_equations(
    systems: Sequence[Equations[SectorData]], speeds: NDArray, engine_order: int
) -> Equations[Family]:
    """Create the equations along an engine order line.

    Parameters
    ----------
    systems : sequence of Equations
        Equations at two or more speeds, in comparable coordinates.  The middle one provides the
        constant quantities.
    speeds : (n,) float, rad/s
    engine_order : int

    Raises
    ------
    SettingError
        If contact laws or the number of unknowns differ between speeds.
    """
    middle = systems[len(systems) // 2]
    speeds = np.asarray(speeds, float)
    refuse(middle.structure.points.own, "a curve as a function of speed")
    squares = speeds**2
    nodes = tuple(
        system.core for system in systems if isinstance(system.core, _core.SectorEquations)
    )
    try:
        core = middle.structure.core(nodes=nodes, squares=squares, order=float(engine_order))
    except ValueError as error:
        raise SettingError(
            f"rotor speed: the number of unknowns or the contact law changes between two "
            f"speeds ({error})"
        ) from error
    # polynomials through the values at the speeds, in the squared speed mapped to (-1, 1)
    centre = 0.5 * float(squares.max() + squares.min())
    half = 0.5 * float(squares.max() - squares.min())
    # [i, k]: T_k at speed i; the inverse gives coefficients from values
    polynomials = chebyshev.chebvander((squares - centre) / half, len(squares) - 1)
    weights = np.linalg.inv(polynomials)
    # response rows (n, 2, n_unknowns) at the speeds
    values = np.array([system.rows.coefficients[0] for system in systems])
    coefficients = np.tensordot(weights, values, 1)
    rows = Rows(coefficients, squares=(centre, half), engine_order=engine_order)
    sectors = tuple(system.structure for system in systems)
    return Equations(
        core=core,
        structure=Family(sectors, speeds, rows, weights),
        layout=middle.layout,
        response_rows=middle.response_rows,
        rows=rows,
        measure=middle.measure,
        row_scale=middle.row_scale,
        n_points=middle.n_points,
        work=middle.work,
    )
