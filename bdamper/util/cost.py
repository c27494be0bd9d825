"""What a result has cost: seconds, counts, and work that does not depend on the machine."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray


class Counted(Protocol):
    """A system of equations whose core counts what it does."""

    core: Any

    @property
    def work(self) -> NDArray:
        """(4,) million operations of an evaluation, Jacobian, factorisation, solution by least norm."""
        ...


@dataclass(frozen=True)
class Cost:
    """Where the time went.

    Parameters
    ----------
    seconds : float
        Wall-clock time in all.
    contact, assembly, algebra : float
        Seconds in the C core: contact forces, modal sums and products, linear algebra.
    evaluations, jacobians, factorisations : int
    iterations, failed_steps : int
    least_norm : int
        Solutions by least norm, where the equations leave a direction undetermined.
    work : float
        Million operations: what the evaluations and Jacobians cost by their sizes, the same on every machine.  With n
        unknowns, p contact points and H harmonics an evaluation counts 28,000 p (2 H + 1), or p (120,000 + 1,200 samples),
        a Jacobian 6 p n^2, a factorisation n^3 + 700 n^2 + 1,000,000, a solution by least norm 15 n^3.  The weights are
        fitted to processor times of tracking curves, with what Python and the rest of the core spend in between.
    """

    seconds: float = 0.0
    contact: float = 0.0
    assembly: float = 0.0
    algebra: float = 0.0
    evaluations: int = 0
    jacobians: int = 0
    factorisations: int = 0
    iterations: int = 0
    failed_steps: int = 0
    least_norm: int = 0
    work: float = 0.0

    @property
    def core(self) -> float:
        """Seconds inside the C core."""
        return self.contact + self.assembly + self.algebra

    @property
    def python(self) -> float:
        """Seconds outside the C core."""
        return max(0.0, self.seconds - self.core)

    def __str__(self) -> str:
        return (
            f"{self.seconds:.3f} s: contact {self.contact:.3f}, assembly {self.assembly:.3f}, algebra {self.algebra:.3f}, "
            f"Python {self.python:.3f}; {self.evaluations} evaluations, {self.iterations} iterations, "
            f"{self.failed_steps} failed steps"
        )


@dataclass
class CostMeter:
    """Sums the cost of several systems that serve one result."""

    start: float
    systems: list[tuple[Counted, tuple[float, ...]]] = field(default_factory=list)
    iterations: int = 0
    failed_steps: int = 0
    parts: list[Cost] = field(default_factory=list)

    def add(self, cost: Cost) -> None:
        """Count in what a part of the work, done while this meter ran, has metered by itself."""
        self.parts.append(cost)

    def watch(self, system: Counted) -> None:
        self.systems.append((system, system.core.cost))

    @property
    def work(self) -> float:
        """Million operations so far."""
        total = sum(p.work for p in self.parts)
        for system, before in self.systems:
            total += float(system.work @ (np.array(system.core.cost[3:]) - before[3:]))
        return float(total)

    def read(self, now: float) -> Cost:
        total = np.zeros(7)
        for system, before in self.systems:
            total += np.array(system.core.cost) - np.array(before)
        for p in self.parts:
            counts = p.evaluations, p.jacobians, p.factorisations, p.least_norm
            total += np.array([p.contact, p.assembly, p.algebra, *counts])
        c, a, g = (float(t) for t in total[:3])
        e, j, f, least = (int(t) for t in total[3:])
        iterations = self.iterations + sum(p.iterations for p in self.parts)
        failed = self.failed_steps + sum(p.failed_steps for p in self.parts)
        return Cost(now - self.start, c, a, g, e, j, f, iterations, failed, least, self.work)
