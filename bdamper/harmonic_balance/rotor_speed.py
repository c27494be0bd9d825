"""Rotor speed: a problem at one speed and its conditions, and the equations along an engine order line.

The preload of a free body is its centrifugal load ``P = m r Omega^2`` along its radial axis, with the radius ``r`` of its
centre of mass at rest.  Speeds are in rad/s.

On an engine order line, ``omega = EO Omega``, all quantities depend on the rotor speed:

    R(u, omega) = r(u, omega; K(Omega), G(Omega), k(Omega), P(Omega), ...) = 0

Each array of the equations, and the row of the response, is a polynomial in the squared speed that interpolates the arrays
at a few speeds.  The derivative along the line is the exact derivative of the polynomials
(``csrc/balance/speed_family.c``).
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
from bdamper.harmonic_balance.sector import Sector
from bdamper.model.kinematics import HarmonicBasis, centrifugal_load
from bdamper.model.validation import as_checked
from bdamper.util import validation
from bdamper.util.errors import SettingError, warn_implausible
from bdamper.util.formatting import short_text

RPM = 60.0 / (2.0 * np.pi)
"""Revolutions per minute in one rad/s."""
Table = Mapping[float, float] | Callable[[float], float]
"""Function of one number, or a table of its values for linear interpolation, which is an error outside the table."""
Excitations = Callable[[float, int], float] | Mapping[int, Any]


def read(name: str, table: Table, at: float) -> float:
    """Evaluate a function, or interpolate a table linearly; raise SettingError outside the table."""
    if callable(table):
        return validation.number(f"{name} at {at:g}", table(at))
    places = sorted(table)
    if not places[0] <= at <= places[-1]:
        raise SettingError(
            f"{name}: expected a table that reaches {at:g}, found {places[0]:g} to {places[-1]:g}"
        )
    return float(np.interp(at, places, [table[x] for x in places]))


def _table(name: str, table: Table) -> Table:
    if isinstance(table, Mapping) and table:
        validation.numbers(f"{name}, where its values are given", list(table))
        validation.numbers(f"{name}, values", list(table.values()))
    elif not callable(table):
        raise validation.invalid(name, "a function, or a mapping of numbers to numbers", table)
    return table


def _excitation(name: str, given: Excitations) -> Excitations:
    if isinstance(given, Mapping) and given:
        for order, value in given.items():
            item = f"{name} of engine order {validation.integer(f'{name}, engine order', order, least=1)}"
            _ = (
                _table(item, value)
                if isinstance(value, Mapping)
                else validation.number(item, value, above=0.0, unit="N")
            )
    elif not callable(given):
        raise validation.invalid(name, "a function or a mapping of engine order to newtons", given)
    return given


@validation.check_arguments
@dataclass(frozen=True)
class Conditions:
    """Conditions that depend on the rotor speed in addition to structure and preload.

    Parameters
    ----------
    friction : mapping of number to number, or callable, optional
        Friction coefficient of all friction faces over speed (rad/s), or over ``temperature`` if given.
    temperature : mapping of number to number, or callable, optional
        Temperature of the contacts over speed, in the unit that ``friction`` uses.
    excitation : callable or mapping, optional
        Amplitude of the excitation (N): ``excitation(omega, engine_order)``, or for each engine order a number or a mapping
        of speed to newtons.

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
                "temperature: expected friction with it, a function or table of temperature, found none"
            )

    def __repr__(self) -> str:  # without memory addresses, so that it is reproducible
        def named(value: object) -> str:
            return (
                f"{value.__module__}.{value.__qualname__}"
                if hasattr(value, "__qualname__")
                else repr(value)
            )

        given = {f.name: getattr(self, f.name) for f in fields(self)}
        return f"Conditions({', '.join(f'{name}={named(v)}' for name, v in given.items() if v is not None)})"

    def values(
        self, speeds: Iterable[float], engine_orders: Iterable[int]
    ) -> tuple[tuple[float | None, ...], ...]:
        """Return friction coefficient and excitation of each order at speeds.

        These values identify the conditions in results files, since callables cannot be compared.
        """
        orders = list(engine_orders)
        return tuple(
            (self.friction_at(w), *(self.excitation_at(w, order) for order in orders))
            for w in speeds
        )

    def reach(self, engine_order: int) -> tuple[float, float]:
        """Return the range of speeds (rad/s) that all tables over speed cover."""
        over = self.friction if self.temperature is None else self.temperature
        force = self.excitation.get(engine_order) if isinstance(self.excitation, Mapping) else None
        tables = [table for table in (over, force) if isinstance(table, Mapping)]
        return max((min(t) for t in tables), default=0.0), min(
            (max(t) for t in tables), default=float("inf")
        )

    def friction_at(self, omega: float) -> float | None:
        """Return the friction coefficient at a speed; None if it is constant."""
        if self.friction is None:
            return None
        at = omega if self.temperature is None else read("temperature", self.temperature, omega)
        return validation.number("friction", read("friction", self.friction, at), least=0.0)

    def excitation_at(self, omega: float, engine_order: int) -> float | None:
        """Return the amplitude of the excitation (N) at a speed; None if it is constant."""
        given = self.excitation
        if given is None:
            return None
        if callable(given):
            force: Any = given(omega, engine_order)
        elif engine_order not in given:
            raise SettingError(
                f"excitation: expected a value for engine order {engine_order}, found orders {list(given)}"
            )
        else:
            force = given[engine_order]
            force = read("excitation", force, omega) if isinstance(force, Mapping) else force
        return validation.number(
            f"excitation of engine order {engine_order} at {omega:g} rad/s",
            force,
            above=0.0,
            unit="N",
        )


def preload_at(problem: Problem, omega: float) -> float:
    """Return the preload (N) from the damper's mass at a rotor speed (rad/s); 0 if the damper carries no load."""
    return centrifugal_load(problem.model) * omega**2 if problem.carries_load else 0.0


Speeds = Sequence[float] | NDArray | float
"""One rotor speed or several."""


def asked_speeds(
    problem: Problem,
    speeds: Speeds | None,
    rpm: Speeds | None,
    check: Callable[..., Any] = validation.numbers,
) -> Any:
    """Return speeds in rad/s from arguments in rad/s or in revolutions per minute; warn if rpm were probably given as
    rad/s.

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
    values = check(
        "speeds" if check is validation.numbers else "rotor speed", speeds, above=0.0, unit="rad/s"
    )
    radius = max(
        (float(np.hypot(*place.position[:2])) for place in problem.model.locations.values()),
        default=0.0,
    )
    # largest plausible tip speed (m/s): the longest titanium blades of steam turbines reach about 750
    tip_speed = 800.0
    if radius * np.max(values) > tip_speed:
        warn_implausible(
            "rotor speed",
            f"at most {tip_speed / radius:.0f} rad/s, {tip_speed:g} m/s at a radius of {radius:.3g} m",
            f"{np.max(values):g}: revolutions per minute suspected, which are given as rpm={short_text(speeds)}",
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
    turns = any(
        b.load is not None or b.spin is not None or any(x.speed for x in b.bases.values())
        for b in bodies
    )
    expected = (
        "a model with a loaded body, modes over speed or displacement by rotation, or conditions"
    )
    given = conditions != Conditions()
    validation.check(
        turns or given, "rotor speed", expected, "a model in which nothing depends on speed"
    )
    return under(problem, asked_speeds(problem, omega, rpm, validation.number), conditions)


def under(problem: Problem, omega: float, conditions: Conditions) -> Problem:
    """Return the problem at a rotor speed (rad/s) under the given conditions; see :func:`at_speed`."""
    changes: dict[str, Any] = {"model": as_checked(problem.model.at_speed(omega)), "speed": omega}
    mu = conditions.friction_at(omega)
    if mu is not None:
        changes["friction_coefficient"] = mu
    force = conditions.excitation_at(omega, int(problem.engine_order))
    if force is not None:
        changes["excitation"] = replace(problem.settings.excitation, amplitude=force)
    return problem.replace(**changes)


def node_speeds(low: float, high: float, n: int) -> NDArray:
    """Return n speeds, descending, whose squares are the Chebyshev points of the interval of the squared speed."""
    low, high = low**2, high**2
    return np.sqrt(
        0.5 * (low + high) + 0.5 * (high - low) * np.cos(np.pi * (np.arange(n) + 0.5) / n)
    )


@dataclass(frozen=True, eq=False)
class Family:
    """Equations whose rotor speed follows from the frequency.

    Parameters
    ----------
    sectors : sequence of Sector
        Sectors at two or more speeds.
    speeds : (n,) float, rad/s
    rows : Rows
        Rows of the response along the line.
    weights : (n, n) float
        Matrix from values at the speeds to coefficients of Chebyshev polynomials.
    """

    sectors: tuple[Sector, ...]
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

    def at(self, omega: float) -> Equations[Sector]:
        """Return the equations at the speed that belongs to a frequency (rad/s), with the frequency as a free parameter."""
        weights = self.rows.basis(omega, len(self.speeds)) @ self.weights
        middle = self.sectors[len(self.sectors) // 2]

        def mixed(name: str) -> NDArray:
            return sum(w * sector.arrays[name] for w, sector in zip(weights, self.sectors))

        stiffness, mass, damping, G = (
            mixed(name) for name in ("stiffness", "mass", "damping", "G")
        )
        ends = np.cumsum([len(b.omega2) for b in middle.bases])[:-1]
        n_points = len(middle.points.kn)
        parts = zip(
            *(np.split(a, ends) for a in (stiffness, mass, damping)),
            np.split(G, 3 * n_points * ends),
        )
        bases = [
            replace(
                b, omega2=k, mass=m, damping_ratio=np.zeros_like(k), drag=c, G=g.reshape(b.G.shape)
            )
            for b, (k, m, c, g) in zip(middle.bases, parts)
        ]
        points = replace(
            middle.points, kt=mixed("kt"), kn=mixed("kn"), mu=mixed("mu"), n0=mixed("n0"), slider=mixed("w"),
            shift=mixed("shift"), load=mixed("load"),
        )  # fmt: skip
        rows = self.response_rows(omega)
        return replace(
            middle, bases=bases, points=points, force=mixed("force"), response_rows=rows
        ).equations

    def response_rows(self, omega: float) -> list[NDArray]:
        """Return the rows of modal amplitudes that give the response at a frequency (rad/s), for each harmonic."""
        weights = self.rows.basis(omega, len(self.speeds)) @ self.weights
        harmonics = range(len(self.sectors[0].bases))
        return [
            sum(w * s.response_rows[l] for w, s in zip(weights, self.sectors)) for l in harmonics
        ]


def responses(system: Equations[Family], y: NDArray) -> NDArray:
    """Return complex response amplitudes (n, n_harmonics + 1) at points (n, n_unknowns + 1) of the line, the mean first."""
    rows = [system.structure.response_rows(point[-1]) for point in y]
    out = [
        [system.layout.amplitudes(point[:-1], l) @ row for l, row in enumerate(of)]
        for point, of in zip(y, rows)
    ]
    return np.array(out, complex).reshape(len(y), system.n_harmonics + 1)


def family_equations(
    systems: Sequence[Equations[Sector]], speeds: NDArray, engine_order: int
) -> Equations[Family]:
    """Create the equations along an engine order line.

    Parameters
    ----------
    systems : sequence of Equations
        Equations at two or more speeds, in comparable coordinates.  The middle one provides the constant quantities.
    speeds : (n,) float, rad/s
    engine_order : int

    Raises
    ------
    SettingError
        If contact laws or the number of unknowns differ between speeds.
    """
    middle, speeds = systems[len(systems) // 2], np.asarray(speeds, float)
    refuse(middle.structure.points.own, "a curve over speed")
    squares = speeds**2
    nodes = tuple(system.core for system in systems if isinstance(system.core, _core.Sector))
    try:
        core = middle.structure.core(nodes=nodes, squares=squares, order=float(engine_order))
    except ValueError as error:
        raise SettingError(
            f"over rotor speed: the number of unknowns or the contact law changes between two speeds ({error})"
        ) from error
    interval = (
        0.5 * float(squares.max() + squares.min()),
        0.5 * float(squares.max() - squares.min()),
    )
    weights = np.linalg.inv(
        chebyshev.chebvander((squares - interval[0]) / interval[1], len(squares) - 1)
    )
    values = np.array([system.rows.coefficients[0] for system in systems])
    rows = Rows(np.tensordot(weights, values, 1), interval, engine_order)
    sectors = tuple(system.structure for system in systems)
    return Equations(
        core, Family(sectors, speeds, rows, weights), middle.layout, middle.response_rows, rows, middle.measure,
        middle.row_scale, middle.n_points, middle.work,
    )  # fmt: skip
