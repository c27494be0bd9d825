"""What a result has cost: seconds, counts, and work that does not depend on the machine."""

from __future__ import annotations

import time
from dataclasses import dataclass, field, fields, replace
from typing import Any, Protocol

from numpy.typing import NDArray


class Counted(Protocol):
    """A system of equations whose core counts what it does."""

    @property
    def core(self) -> Any:
        """With a count of what it does, ``cost``."""

    @property
    def work(self) -> NDArray:
        """(4,) million operations of an evaluation, Jacobian, factorisation, solution by least norm."""


@dataclass(frozen=True)
class Cost:
    """Processor and wall-clock time by kind of work.

    Parameters
    ----------
    seconds : float
        Wall-clock time in all.
    processor : float
        Processor seconds of the threads that did the work.  0 in files of versions that did not count them.
    contact, assembly, algebra, time_integration : float
        Parts of these in the C core: contact forces, modal sums and products, linear algebra, integration in time.
        Wall-clock seconds, with the integration in ``contact``, in files of versions up to 0.7.
    evaluations, jacobians, factorisations : int
    iterations, failed_steps : int
    least_norm : int
        Solutions by least norm, where the equations leave a direction undetermined.
    work : float
        Million operations: what the evaluations and Jacobians cost by their sizes, the same on every machine.  With n
        unknowns, p contact points and H harmonics an evaluation counts 28,000 p (2 H + 1), or p (120,000 + 1,200 samples),
        a Jacobian 6 p n^2, a factorisation n^3 + 700 n^2 + 1,000,000, a solution by least norm 15 n^3.  The weights are
        fitted to processor times of response curves, with what Python and the rest of the core spend in between.
    """

    seconds: float = 0.0
    processor: float = 0.0
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
    time_integration: float = 0.0

    @property
    def core(self) -> float:
        """Processor seconds inside the C core."""
        return self.contact + self.assembly + self.algebra + self.time_integration

    @property
    def python(self) -> float:
        """Processor seconds outside the C core."""
        return max(0.0, self.processor - self.core)

    def __add__(self, other: Cost) -> Cost:
        """What both have taken, one after the other."""
        return Cost(**{f.name: getattr(self, f.name) + getattr(other, f.name) for f in fields(self)})

    def __str__(self) -> str:
        processor = f", {self.processor:.3f} s of the processor" if self.processor > 0.0 else ""
        return (
            f"{self.seconds:.3f} s{processor}: contact {self.contact:.3f}, "
            f"assembly {self.assembly:.3f}, algebra {self.algebra:.3f}, time {self.time_integration:.3f}, "
            f"Python {self.python:.3f}; "
            f"{self.evaluations} evaluations, {self.iterations} iterations, {self.failed_steps} failed steps"
        )


WEIGHED = ("evaluations", "jacobians", "factorisations", "least_norm")
"""Counts of the core in the order in which :attr:`Counted.work` weighs them."""


@dataclass
class CostMeter:
    """Sums what serves one result, in the thread that made the meter: time, several systems, and parts metered before."""

    start: float = field(default_factory=time.perf_counter)
    systems: list[tuple[Counted, Any]] = field(default_factory=list)
    iterations: int = 0
    failed_steps: int = 0
    parts: list[Cost] = field(default_factory=list)
    processor_start: float = field(default_factory=time.thread_time)

    def add(self, cost: Cost) -> None:
        """Count in what a part of the work, done while this meter ran, has metered by itself."""
        self.parts.append(cost)

    def count(self, iterations: int, failed_steps: int = 0) -> None:
        """Adds iterations and failed steps."""
        self.iterations += iterations
        self.failed_steps += failed_steps

    def watch(self, system: Counted) -> None:
        """Count what a system does from now on, once."""
        if all(system.core is not other.core for other, _ in self.systems):
            self.systems.append((system, system.core.cost))

    @property
    def work(self) -> float:
        """Million operations so far."""
        total = sum(part.work for part in self.parts)
        for system, before in self.systems:
            total += float(system.work @ [getattr(system.core.cost, name) - getattr(before, name) for name in WEIGHED])
        return float(total)

    def read(self, *parts: Cost) -> Cost:
        """The cost so far, with that of parts that have not been added."""
        own: dict[str, Any] = {
            name: sum(getattr(system.core.cost, name) - getattr(before, name) for system, before in self.systems)
            for name in ("contact", "assembly", "algebra", *WEIGHED)
        }
        mine = Cost(**own, iterations=self.iterations, failed_steps=self.failed_steps)
        seconds, processor = time.perf_counter() - self.start, time.thread_time() - self.processor_start
        work = self.work + sum(part.work for part in parts)
        return replace(sum((*self.parts, *parts), mine), seconds=seconds, processor=processor, work=work)
