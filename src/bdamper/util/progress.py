"""Progress of long work on the terminal or in a notebook, and what an interruption (Ctrl-C) ends.

What a result has cost: seconds, counts, and work that does not depend on the machine.

Linear algebra on one thread while a curve is solved.

Matrices of some ten to some hundred rows are factorised thousands of times: threads of a BLAS then wait for each other
longer than they compute, on a busy machine many times longer.  What runs in parallel are curves
(:mod:`bdamper.analyses.sweep`). The limit holds in all threads of the process while the one that has set it first is at
work, and is taken back then.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, CancelledError
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field, fields, replace
from functools import cache
from threading import Event, Lock
from typing import Any, Protocol, TypeVar

from numpy.typing import NDArray
from threadpoolctl import ThreadpoolController

from bdamper.util.errors import one_line

# ---- Progress of long work on the terminal or in a notebook, and what an interruption (Ctrl-C)  ----


T = TypeVar("T")

_stop: ContextVar[tuple[Event, ...]] = ContextVar("_stop", default=())
_passed_on: ContextVar[bool] = ContextVar("_passed_on", default=False)


class ExecutorEnded(KeyboardInterrupt):
    """An executor takes no more tasks: this ends the work in the same way as Ctrl-C."""


@contextmanager
def executor_errors(refusal: type[Exception] = BrokenExecutor) -> Iterator[None]:
    """Turn errors of an executor that has ended, and its refusal of tasks, into :class:`ExecutorEnded`."""
    try:
        yield
    except (BrokenExecutor, CancelledError, refusal) as error:
        raise ExecutorEnded(one_line(error) or "its tasks were cancelled") from error


class LongWork:
    """A context that an interruption ends quietly, so that what there is by then can be returned.

    Parts of the work do not return what they have so far as their answer (:func:`is_part_of_work`), and work that is
    itself such a part passes the interruption on.

    Attributes
    ----------
    interrupted : bool
        Whether the work was ended.
    reason : str
        Why the executor has ended, if it has; empty after Ctrl-C.
    """

    def __init__(self) -> None:
        self.interrupted, self.reason = False, ""

    def __enter__(self) -> LongWork:
        self.outer = _passed_on.set(True)
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, *_: object) -> bool:
        _passed_on.reset(self.outer)
        self.interrupted = kind is not None and issubclass(kind, KeyboardInterrupt)
        self.reason = str(error) if isinstance(error, ExecutorEnded) else ""
        return self.interrupted and not is_part_of_work()


def is_part_of_work() -> bool:
    """Whether the caller is a part of longer work, which an interruption ends (:class:`LongWork`)."""
    return _passed_on.get()


@contextmanager
def stopped_by(stop: Event) -> Iterator[None]:
    """A context of a thread whose work another one ends by setting ``stop``, an interruption at the next correction."""
    before = _stop.set((*_stop.get(), stop))
    try:
        yield
    finally:
        _stop.reset(before)


def raise_if_stopped() -> None:
    """Raises KeyboardInterrupt where another thread has asked for it (:func:`stopped_by`)."""
    if any(stop.is_set() for stop in _stop.get()):
        raise KeyboardInterrupt


@contextmanager
def progress_counter(show: bool, total: int, done: int, what: str, unit: str) -> Iterator[Callable[[], Any]]:
    """A function that counts one more, in a bar with the time left if it is to be shown."""
    if not show:
        yield lambda: None
        return
    with _bar(total=total, initial=done, desc=what, unit=unit) as bar:
        yield bar.update


@contextmanager
def progress_stages(what: str, unit: str) -> Iterator[Callable[[str, int, int], None]]:
    """A bar, as a function of the stage that the work has reached, the units done and those that there are so far."""
    with _bar(desc=what, unit=unit) as bar:

        def report(stage: str, done: int, total: int) -> None:
            bar.total = max(total, bar.total or 0)
            bar.set_description(f"{what}: {stage}" if stage else what, refresh=False)
            bar.update(max(done - bar.n, 0))

        yield report


def with_progress(items: Sequence[T], show: bool, what: str, unit: str) -> Iterable[T]:
    """The items, with a bar that counts them if it is to be shown."""
    if not show:
        return items
    bar: Iterable[T] = _bar(items, desc=what, unit=unit)
    return bar


@contextmanager
def progress_bar(show: bool, low: float, high: float) -> Iterator[Callable[[Any], None] | None]:
    """Progress over the frequency interval, or nothing; a path that turns back does not take the bar back."""
    if not show:
        yield None
        return
    with progress_stages("tracking", "%") as report:
        yield lambda point: report("", int(min(100.0, 100.0 * (point.y[-1] - low) / (high - low))), 100)


def _bar(*items: Any, **given: Any) -> Any:
    """A bar; where standard error is no terminal, one line at each tenth of what there is to do."""
    from tqdm.auto import tqdm

    if sys.stderr.isatty() or "ipykernel.kernelapp" in sys.modules:
        return tqdm(*items, **given)

    class Lines(tqdm):  # type: ignore[misc]
        told = 0

        def display(self, msg: str | None = None, pos: int | None = None) -> None:
            tenth = int(10.0 * self.n / self.total + 1e-9) if self.total else 0
            if tenth > self.told:
                self.told = tenth
                self.fp.write(f"{self.desc}{': ' * (not self.desc.endswith(': '))}{10 * tenth} %\n")

    return Lines(*items, **given, mininterval=0.0, miniters=1, leave=False)


# ---- What a result has cost ----


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


# ---- Linear algebra on one thread while a curve is solved ----


_held = Lock()


@cache
def _controller() -> ThreadpoolController:
    """Of the libraries that are loaded; the search for them takes a millisecond."""
    return ThreadpoolController()


@contextmanager
def single_thread() -> Iterator[None]:
    """A context with one thread for linear algebra, unless another one holds it already."""
    if not _held.acquire(blocking=False):
        yield
        return
    try:
        with _controller().limit(limits=1, user_api="blas"):
            yield
    finally:
        _held.release()


one_thread = single_thread()
"""Decorator of a function that has one thread for linear algebra."""
