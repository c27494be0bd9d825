"""Equations along an engine order line, ``omega = EO Omega``, on which all quantities depend on the rotor speed.

    R(u, omega) = r(u, omega; K(Omega), G(Omega), k(Omega), P(Omega), ...) = 0

Each array of the equations, and the row of the response, is a polynomial in the squared speed that interpolates the arrays
at a few speeds.  The derivative along the line is the exact derivative of the polynomials
(``csrc/balance/speed_family.c``).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from bdamper import _core
from bdamper.contact.laws import refuse
from bdamper.harmonic_balance.equations import Equations, Rows
from bdamper.harmonic_balance.sector import Sector
from bdamper.model.kinematics import HarmonicBasis
from bdamper.util.errors import SettingError


def node_speeds(low: float, high: float, n: int) -> NDArray:
    """Return n speeds, descending, whose squares are the Chebyshev points of the interval of the squared speed."""
    low, high = low**2, high**2
    return np.sqrt(0.5 * (low + high) + 0.5 * (high - low) * np.cos(np.pi * (np.arange(n) + 0.5) / n))


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

        stiffness, mass, damping, G = (mixed(name) for name in ("stiffness", "mass", "damping", "G"))
        ends = np.cumsum([len(b.omega2) for b in middle.bases])[:-1]
        n_points = len(middle.points.kn)
        parts = zip(*(np.split(a, ends) for a in (stiffness, mass, damping)), np.split(G, 3 * n_points * ends))
        bases = [
            replace(b, omega2=k, mass=m, damping_ratio=np.zeros_like(k), drag=c, G=g.reshape(b.G.shape))
            for b, (k, m, c, g) in zip(middle.bases, parts)
        ]
        points = replace(
            middle.points, kt=mixed("kt"), kn=mixed("kn"), mu=mixed("mu"), n0=mixed("n0"), slider=mixed("w"),
            shift=mixed("shift"), load=mixed("load"),
        )  # fmt: skip
        rows = self.response_rows(omega)
        return replace(middle, bases=bases, points=points, force=mixed("force"), response_rows=rows).equations

    def response_rows(self, omega: float) -> list[NDArray]:
        """Return the rows of modal amplitudes that give the response at a frequency (rad/s), for each harmonic."""
        weights = self.rows.basis(omega, len(self.speeds)) @ self.weights
        harmonics = range(len(self.sectors[0].bases))
        return [sum(w * s.response_rows[l] for w, s in zip(weights, self.sectors)) for l in harmonics]


def responses(system: Equations[Family], y: NDArray) -> NDArray:
    """Return complex response amplitudes (n, n_harmonics + 1) at points (n, n_unknowns + 1) of the line, the mean first."""
    rows = [system.structure.response_rows(point[-1]) for point in y]
    out = [[system.layout.amplitudes(point[:-1], l) @ row for l, row in enumerate(of)] for point, of in zip(y, rows)]
    return np.array(out, complex).reshape(len(y), system.n_harmonics + 1)


def family_equations(systems: Sequence[Equations[Sector]], speeds: NDArray, engine_order: int) -> Equations[Family]:
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
    interval = 0.5 * float(squares.max() + squares.min()), 0.5 * float(squares.max() - squares.min())
    weights = np.linalg.inv(chebyshev.chebvander((squares - interval[0]) / interval[1], len(squares) - 1))
    values = np.array([system.rows.coefficients[0] for system in systems])
    rows = Rows(np.tensordot(weights, values, 1), interval, engine_order)
    sectors = tuple(system.structure for system in systems)
    return Equations(
        core, Family(sectors, speeds, rows, weights), middle.layout, middle.response_rows, rows, middle.measure,
        middle.row_scale, middle.n_points, middle.work,
    )  # fmt: skip
