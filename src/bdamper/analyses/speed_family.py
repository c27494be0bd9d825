"""One problem over rotor speed, as a family of equations.

At every speed the problem is made anew: modes, contact stiffness, preload, static state.  So that unknowns at two speeds
can be compared, those of a speed are turned onto those of the nearest speed that is known
(:mod:`bdamper.harmonic_balance.residual_mode_alignment`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from bdamper.harmonic_balance.equations import Equations
from bdamper.harmonic_balance.parameters import vary
from bdamper.harmonic_balance.problem import Problem
from bdamper.harmonic_balance.residual_mode_alignment import like
from bdamper.harmonic_balance.rotor_speed import Conditions, preload_at, under
from bdamper.harmonic_balance.sector import Sector
from bdamper.harmonic_balance.speed_family import Family, family_equations, node_speeds
from bdamper.model.validation import as_checked
from bdamper.response.resonance_interval import free_and_stuck

T = TypeVar("T")


def with_needed_bases(problem: Problem) -> Problem:
    """The same problem with those nodal diameters alone that its harmonics need, which is faster to make at a speed."""
    model = problem.model

    def needed(by_diameter: Mapping[int, T]) -> dict[int, T]:
        return {d: item for d, item in by_diameter.items() if d in problem.settings.needed_diameters}

    bodies = {n: b if b.kind == "free" else replace(b, bases=needed(b.bases)) for n, b in model.bodies.items()}
    stress = {n: replace(rows, modes=needed(rows.modes), contact=needed(rows.contact)) for n, rows in model.stress.items()}
    return problem.replace(model=as_checked(replace(model, bodies=bodies, stress=stress)))


class SpeedFamily:
    """A problem over rotor speed.

    Parameters
    ----------
    problem : Problem
        At any speed, or at none.
    conditions : Conditions
    """

    def __init__(self, problem: Problem, conditions: Conditions) -> None:
        self.whole = problem
        self.base = with_needed_bases(problem)
        self.conditions = conditions
        self._made: dict[float, Problem] = {}

    def problem(self, omega: float) -> Problem:
        """The problem at a speed (rad/s), its unknowns comparable with those at other speeds."""
        if omega not in self._made:
            made = under(self.base, omega, self.conditions)
            known = min(self._made, key=lambda other: abs(other - omega), default=None)
            self._made[omega] = made if known is None else like(made, self._made[known])
        return self._made[omega]

    def preload(self, omega: float) -> float:
        """Preload (N) at a speed."""
        return preload_at(self.whole, omega)

    def system(self, omega: float, mass: float = 1.0) -> Equations[Sector]:
        """The equations at a speed with a factor on the mass of the free bodies, load and inertia together."""
        problem = self.problem(omega)
        if mass != 1.0:
            problem = like(vary(problem, {"damper_mass": mass}), problem)
        return problem.system(mass * self.preload(omega))

    def along(self, low: float, high: float, nodes: int, mass: float = 1.0) -> Equations[Family]:
        """The equations along the line of the engine order between two speeds, made at so many of them.

        With a factor on the mass of the free bodies, load and inertia together.
        """
        speeds = node_speeds(low, high, nodes)
        systems = [self.system(float(omega), mass) for omega in speeds]
        return family_equations(systems, speeds, int(self.whole.engine_order))

    def resonances(self, low: float, high: float, mode: int) -> tuple[float, float]:
        """Speeds (rad/s) at which the free and the stuck resonance of a mode meet the line of the engine order.

        From those at two speeds, since squared frequencies are all but linear in the squared speed; 0 where a resonance
        meets no line.
        """
        squares, order = np.square([low, high]), float(self.whole.engine_order)
        found = []
        for column in np.transpose([self._linear(omega, mode) for omega in (low, high)]):
            slope = float(np.diff(column**2)[0] / np.diff(squares)[0])
            square = (column[0] ** 2 - slope * squares[0]) / (order**2 - slope) if order**2 > slope else 0.0
            found.append(float(np.sqrt(max(square, 0.0))))
        return min(found), max(found)

    def _linear(self, omega: float, mode: int) -> NDArray:
        """(2,) free and stuck resonance (rad/s) of a mode of the constrained bodies at a speed."""
        problem = self.problem(omega)
        both = free_and_stuck(problem, problem.equilibrium(self.preload(omega)), mode)
        return 2.0 * np.pi * np.array(both)[:, mode - 1]
