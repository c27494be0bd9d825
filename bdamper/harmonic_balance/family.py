"""Equations along the line of an engine order, ``omega = EO Omega``, where everything changes with the rotor speed.

    R(u, omega) = r(u, omega; K(Omega), G(Omega), k(Omega), P(Omega), ...) = 0

Every array of the equations is the polynomial of the squared speed through those of the equations at a few speeds, and so
is the row of the response; the derivative along the line is exactly that of the polynomials (``csrc/bd_family.c``).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from bdamper import _core
from bdamper.harmonic_balance.conditions import Condition, Peak, Plane
from bdamper.harmonic_balance.system import OK, Correction, HarmonicSystem
from bdamper.util.errors import SettingError


def node_speeds(low: float, high: float, n: int) -> NDArray:
    """(n,) speeds at which the squared speed has the Chebyshev points of an interval, the highest first."""
    low, high = low**2, high**2
    return np.sqrt(0.5 * (low + high) + 0.5 * (high - low) * np.cos(np.pi * (np.arange(n) + 0.5) / n))


class HarmonicFamily(HarmonicSystem):
    """Equations of which the frequency decides the speed.

    Parameters
    ----------
    systems : sequence of HarmonicSystem
        Equations at two or more speeds, with unknowns that can be compared; those in the middle of the sequence lend
        what does not change.
    speeds : (n,) float, rad/s
    engine_order : int

    Raises
    ------
    SettingError
        If contact laws or numbers of unknowns differ from speed to speed.
    """

    def __init__(self, systems: Sequence[HarmonicSystem], speeds: NDArray, engine_order: int) -> None:
        middle = systems[len(systems) // 2]
        super().__init__(
            middle.bases, middle.points, middle.force, middle.response_rows, middle.evaluation, middle.force_scale
        )
        self.systems, self.speeds, self.engine_order = tuple(systems), np.asarray(speeds, float), engine_order
        self.spring_bases, self.springs = middle.spring_bases, middle.springs
        nodes = tuple(system.core for system in systems if isinstance(system.core, _core.Sector))
        try:
            self.core = _core.Sector(
                **self.arrays, **self._fixed, nodes=nodes, squares=self.speeds**2, order=float(engine_order)
            )  # fmt: skip
        except ValueError as error:
            raise SettingError(f"over speed: expected unknowns and contact laws that stay as they are: {error}") from error
        squares = self.speeds**2
        self._middle, self._half = 0.5 * (squares.max() + squares.min()), 0.5 * (squares.max() - squares.min())
        self._inverse = np.linalg.inv(chebyshev.chebvander((squares - self._middle) / self._half, len(squares) - 1))
        rows = [np.concatenate(self._parts(np.asarray(system.response_rows[1]))) for system in systems]
        self._rows = self._inverse @ np.array(rows)  # real and imaginary part, one behind the other
        self._slopes = chebyshev.chebder(self._rows) / self._half

    # ---- one speed ----

    def _basis(self, omega: NDArray | float, n: int) -> NDArray:
        """(..., n) Chebyshev polynomials of the squared speed at frequencies along the line."""
        t = ((omega / self.engine_order) ** 2 - self._middle) / self._half
        values = [0.0 * t + 1.0, t]
        while len(values) < n:
            values.append(2.0 * t * values[-1] - values[-2])
        return np.array(values[:n]).T

    def at(self, omega: float) -> HarmonicSystem:
        """The equations at the speed of a frequency, in which the frequency is free."""
        weights = self._basis(omega, len(self.speeds)) @ self._inverse

        def mixed(name: str) -> NDArray:
            return sum(w * system.arrays[name] for w, system in zip(weights, self.systems))

        stiffness, mass, damping, G = (mixed(name) for name in ("stiffness", "mass", "damping", "G"))
        ends = np.cumsum([len(b.omega2) for b in self.bases])[:-1]
        parts = zip(*(np.split(a, ends) for a in (stiffness, mass, damping)), np.split(G, 3 * self.n_points * ends))
        bases = [
            replace(b, omega2=k, mass=m, damping_ratio=np.zeros_like(k), drag=c, G=g.reshape(b.G.shape))
            for b, (k, m, c, g) in zip(self.bases, parts)
        ]
        points = replace(
            self.points, kt=mixed("kt"), kn=mixed("kn"), mu=mixed("mu"), n0=mixed("n0"), slider=mixed("w"),
            shift=mixed("shift"), load=mixed("load"),
        )  # fmt: skip
        rows = [sum(w * system.response_rows[l] for w, system in zip(weights, self.systems)) for l in range(len(bases))]
        out = HarmonicSystem(bases, points, mixed("force"), rows, self.evaluation, self.force_scale)
        out.spring_bases, out.springs = self.spring_bases, self.springs
        return out

    # ---- the response, whose row changes along the line ----

    def parts_at(self, omega: float) -> tuple[NDArray, NDArray]:
        """Rows of the unknowns that give real and imaginary part of the first harmonic at a frequency."""
        re, im = (self._basis(float(omega), len(self._rows)) @ self._rows).reshape(2, -1)
        return re, im

    def first_harmonic(self, y: NDArray) -> NDArray:
        """(...,) complex amplitude of the first harmonic of the response at points (..., n_unknowns + 1)."""
        rows = self._basis(y[..., -1], len(self._rows)) @ self._rows
        n = self.n_unknowns
        return np.asarray(((rows[..., :n] + 1j * rows[..., n:]) * y[..., :-1]).sum(axis=-1))

    def squared_gradient(self, y: NDArray) -> tuple[NDArray, float]:
        """Gradient of half the squared amplitude of the first harmonic with respect to y, and the squared amplitude."""
        omega, u = float(y[-1]), y[:-1]
        re, im = self.parts_at(omega)
        a, b = float(re @ u), float(im @ u)
        slopes = (self._basis(omega, len(self._slopes)) @ self._slopes).reshape(2, -1) @ u
        by_square = a * float(slopes[0]) + b * float(slopes[1])
        return np.append(a * re + b * im, by_square * 2.0 * omega / self.engine_order**2), a * a + b * b

    def solve(
        self,
        y: NDArray,
        condition: Condition,
        scale: NDArray,
        tolerance: float,
        max_iterations: int,
        line_search: int = 0,
        reach: float = 0.0,
        loose: float = 0.0,
        rough: float = 0.0,
    ) -> Correction:
        """As of other equations; a peak of the response with its row as it is there is followed by secants to its own."""
        c = super().solve(y, condition, scale, tolerance, max_iterations, line_search, reach, loose, rough)
        if not isinstance(condition, Peak):
            return c
        for _ in range(max_iterations):
            if c.status != OK or not c.curvature < 0.0:
                break
            gradient, square = self.squared_gradient(c.y)
            way = -float(gradient @ (c.tangent * scale)) / square / c.curvature
            if abs(way) <= condition.tolerance:
                break
            beside = super().solve(c.y + way * c.tangent * scale, Plane(c.tangent), scale, tolerance, max_iterations)
            c = replace(beside, curvature=c.curvature, slope=0.0, iterations=c.iterations + beside.iterations)
        return c
