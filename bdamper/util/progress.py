"""Progress bars, interrupts, cost of results, and limits on the threads of linear algebra.

The systems have about ten to a few hundred rows and are factorised thousands of times.  The threads
of a BLAS spend more time waiting for each other than computing on such matrices, in particular on a
busy machine.  Curves run in parallel instead (:mod:`bdamper.analyses.sweep`).  The limit applies to
all threads of the process.  It ends when the thread that set it first has finished.
"""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, CancelledError
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field, fields, replace
from functools import cache
from threading import Event, Lock, Timer
from typing import Any, Protocol, TypeVar

from numpy.typing import NDArray
from threadpoolctl import ThreadpoolController

from bdamper.util import validation
from bdamper.util.errors import one_line

# ---- Progress bars and interrupts ----


T = TypeVar("T")

_stop: ContextVar[tuple[Event, ...]] = ContextVar("_stop", default=())
_passed_on: ContextVar[bool] = ContextVar("_passed_on", default=False)


class ExecutorEnded(KeyboardInterrupt):
    """Interruption by an executor that accepts no more tasks; the work ends as after Ctrl-C."""


@contextmanager
def executor_errors(refusal: type[Exception] = BrokenExecutor) -> Iterator[None]:
    """Convert the errors and cancellations of an executor that has ended to :class:`ExecutorEnded`."""
    dask = sys.modules.get("distributed")  # imported if one of its executors is in use
    killed = getattr(dask, "KilledWorker", BrokenExecutor)
    try:
        yield
    except (BrokenExecutor, CancelledError, refusal, killed) as e:
        raise ExecutorEnded(one_line(e) or "its tasks were cancelled") from e


class LongWork:
    """Context that suppresses an interrupt so that the caller can return its partial result.

    If the work is itself a part of longer work (:func:`is_part_of_work`), the interrupt propagates
    to the outer context.

    Attributes
    ----------
    interrupted : bool
        Whether the work was interrupted.
    reason : str
        Reason why the executor ended; empty after Ctrl-C.
    """

    def __init__(self) -> None:
        self.interrupted = False
        self.reason = ""

    def __enter__(self) -> LongWork:
        self.outer = _passed_on.set(True)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, *_: object
    ) -> bool:
        _passed_on.reset(self.outer)
        # a returned True suppresses the interrupt, which nested work passes on to the outer work
        self.interrupted = kind is not None and issubclass(kind, KeyboardInterrupt)
        self.reason = str(error) if isinstance(error, ExecutorEnded) else ""
        return self.interrupted and not is_part_of_work()


def is_part_of_work() -> bool:
    """Return whether the caller runs in :class:`LongWork`, where an interrupt must propagate."""
    return _passed_on.get()


@contextmanager
def stopped_by(stop: Event) -> Iterator[None]:
    """Allow the event ``stop`` of another thread to interrupt this thread at its next correction."""
    before = _stop.set((*_stop.get(), stop))
    try:
        yield
    finally:
        _stop.reset(before)


@contextmanager
def stopped_after(seconds: float | None) -> Iterator[Event]:
    """Interrupt the work of a block after an elapsed time (s); the event says whether it was over.

    None is no limit.
    """
    over = Event()
    if seconds is None:
        yield over
        return
    timer = Timer(min(seconds, threading.TIMEOUT_MAX), over.set)
    timer.daemon = True
    timer.start()
    try:
        with stopped_by(over):
            yield over
    finally:
        timer.cancel()


def raise_if_stopped() -> None:
    """Raise KeyboardInterrupt if another thread has set an event of :func:`stopped_by`."""
    if any(stop.is_set() for stop in _stop.get()):
        raise KeyboardInterrupt


def shows_progress(progress: bool | None) -> bool:
    """Return whether to show progress.

    By default progress is shown, except inside a longer computation that shows its own.
    """
    if progress is None:
        return not is_part_of_work()
    return validation.flag("progress", progress)


def _is_watched() -> bool:
    """Return whether standard error is a terminal or a notebook."""
    return sys.stderr.isatty() or "ipykernel.kernelapp" in sys.modules


@contextmanager
def progress_counter(
    show: bool, total: int, done: int, what: str, unit: str
) -> Iterator[Callable[[], Any]]:
    """Yield a function that counts one more part, shown in a progress bar if ``show``."""
    if not show:
        yield lambda: None
        return
    with _bar(total=total, initial=done, desc=what, unit=unit) as bar:
        yield bar.update


Report = Callable[[str, int, int], None]
"""Function of the stage of the computation, the number of finished parts and their total."""


def no_report(stage: str, done: int, total: int) -> None:
    """Report nothing."""


@dataclass
class Steps:
    """Steps of a long computation, counted by a progress bar, and the passes within each step.

    Parameters
    ----------
    show : Report
        Function that shows the text of a step, the number of finished steps, and ``total``.
    total : int
        Number of steps.
    """

    show: Report = no_report
    total: int = 0
    begun: int = field(default=0, init=False)
    current: str = field(default="", init=False)

    def begin(self, text: str) -> None:
        """Begin the next step of the computation."""
        self.show(text, self.begun, self.total)
        self.begun += 1
        self.current = text

    def report_pass(self, name: str, done: int, total: int) -> None:
        """Show a pass of the current step, with the finished number of its parts."""
        parts = f" {done} of {total}" if total > 1 else ""
        finished = max(self.begun - 1, 0)
        self.show(f"{self.current}, {name}{parts}", finished, self.total)


@dataclass
class _RisingShare:
    """Finished share of a computation whose number of parts may grow while it runs.

    When it grows, the parts that are left then divide the rest up to 1.
    """

    done: int = 0
    total: int = 0
    share: float = 0.0
    # where the number of parts last grew
    done_before: int = 0
    share_before: float = 0.0

    def after(self, done: int, total: int) -> float:
        """Return the share after ``done`` of at least ``total`` parts; it never decreases."""
        if total > self.total:
            self.total = total
            self.done_before = self.done
            self.share_before = self.share
        self.done = max(done, self.done)
        n_left = self.total - self.done_before
        if n_left > 0:
            of_rest = (self.done - self.done_before) / n_left
            self.share = max(self.share, self.share_before + (1.0 - self.share_before) * of_rest)
        return self.share


BEFORE_THE_END = 99
"""Largest per cent that a bar shows before its computation has ended."""


@contextmanager
def progress_stages(show: bool, what: str, unit: str) -> Iterator[Report]:
    """Yield a function that updates a progress bar if ``show``.

    The bar shows per cent, which only rise.  If the computation ends before its total, the bar is
    filled.
    """
    if not show:
        yield no_report
        return
    share = _RisingShare()
    with _bar(desc=what, unit=unit, bar_format=PERCENT_AND_TIME) as bar:

        def show_percent(text: str, percent: int) -> None:
            bar.total = 100
            bar.set_description(text, refresh=False)
            bar.update(max(percent - bar.n, 0))

        def report(stage: str, done: int, total: int) -> None:
            # a share that rounding leaves just below a whole number counts
            percent = int(100.0 * share.after(done, total) + 1e-9)
            show_percent(f"{what}: {stage}" if stage else what, min(percent, BEFORE_THE_END))

        yield report
        if share.total:
            show_percent(what, 100)


def with_progress(items: Sequence[T], show: bool, what: str, unit: str) -> Iterable[T]:
    """Return the items, wrapped in a progress bar if ``show``."""
    if not show:
        return items
    bar: Iterable[T] = _bar(items, desc=what, unit=unit)
    return bar


@contextmanager
def progress_bar(
    show: bool, low: float, high: float, what: str
) -> Iterator[Callable[[Any], None] | None]:
    """Yield a function that shows the progress of a path through an interval, or None if ``show``
    is false.

    The bar does not decrease if the path turns back.
    """
    percent_per_unit = 100.0 / (high - low)
    with progress_stages(show, what, "%") as report:

        def report_point(point: Any) -> None:
            # the last unknown is the coordinate of the path
            coordinate = point.y[-1]
            percent = min(100.0, percent_per_unit * (coordinate - low))
            report("", int(percent), 100)

        yield report_point if show else None


PERCENT_AND_TIME = "{l_bar}{bar}| {elapsed}, {remaining} left"
"""Format of a bar whose parts are per cent."""
FIRST_LINE = 10.0
"""Seconds of work before the first line if there is neither a terminal nor a notebook."""


@cache
def _bar_classes() -> tuple[type, type]:
    """Return the classes of bars that somebody watches, and of bars that print lines."""
    from tqdm.auto import tqdm

    class Bar(tqdm):  # type: ignore[misc]
        # The lock of tqdm belongs to all forked processes: if one is killed while it holds the lock,
        # the others wait for ever.  Bars of this package are drawn by one process.
        _lock = threading.RLock()

    class Lines(Bar):
        # bars are updated by the work alone, so that no thread is left behind
        monitor_interval = 0

        def __init__(self, *items: Any, **options: Any) -> None:
            self.tenths = -1
            self.started = self.printed = time.monotonic()
            super().__init__(*items, **options, mininterval=0.0, miniters=1, leave=False)

        def set_description(self, desc: str | None = None, refresh: bool | None = True) -> None:
            super().set_description(desc, refresh=False)
            self.display()

        def display(self, msg: str | None = None, pos: int | None = None) -> None:
            # a tenth that rounding leaves just below its number counts
            if not self.total:
                return
            tenth = int(10.0 * self.n / self.total + 1e-9)
            now = time.monotonic()
            # short runs print no progress
            if now < self.started + FIRST_LINE:
                return
            if tenth <= self.tenths and now <= self.printed + 30.0:
                return
            self.tenths = tenth
            self.printed = now
            # tqdm appends a colon to some descriptions
            description = self.desc if self.desc.endswith(": ") else f"{self.desc}: "
            self.fp.write(f"{description}{10 * tenth} %{self._left_text(now)}\n")

        def _left_text(self, now: float) -> str:
            """Return the seconds that are left at the mean speed so far; "" if they are unknown."""
            share = self.n / self.total
            if not 0.0 < share < 1.0:
                return ""
            seconds = (now - self.started) * (1.0 / share - 1.0)
            return f", about {seconds:.0f} s left" if seconds >= 1.0 else ""

    return Bar, Lines


def _bar(*items: Any, **options: Any) -> Any:
    """Return a progress bar of tqdm.

    If nobody watches it, as in a batch job, it prints lines instead: the first after
    :data:`FIRST_LINE`, then one at each tenth and every half minute.
    """
    watched, lines = _bar_classes()
    if _is_watched():
        # short runs show no bar; a new text is drawn although no part has ended
        return watched(*items, **options, delay=1.0, miniters=0)
    return lines(*items, **options)


# ---- Cost of a result ----


class Counted(Protocol):
    """System of equations with counters in the C core."""

    @property
    def core(self) -> Any:
        """Object of the C core with the counters ``cost``."""

    @property
    def work(self) -> NDArray:
        """Million operations (4,) of each item of :data:`WEIGHED`."""


@dataclass(frozen=True)
class Cost:
    """Time and counts of the work for a result.

    Parameters
    ----------
    seconds : float
        Wall-clock time.
    processor : float
        Processor time of the threads that did the work (s); 0 in files of versions that did not
        measure it.
    contact, assembly, algebra, time_integration : float
        Processor time of parts of the C core (s): contact forces, modal sums and products, linear
        algebra, and time integration.  Files of versions up to 0.7 contain wall-clock time, and
        ``contact`` includes time integration.
    evaluations, jacobians, factorisations : int
    iterations, failed_steps : int
    least_norm : int
        Number of minimum-norm solutions of equations that do not determine a direction.
    condensed : int
        Factorisations condensed to the motion at the contact points, for few contacts in many
        modes; ``factorisations`` includes them.
    work : float
        Work in million operations, independent of the computer.

    Notes
    -----
    With n unknowns, p contact points and H harmonics, an evaluation counts 28,000 p (2 H + 1).
    With sampled forces it counts p (120,000 + 1,200 samples).  A Jacobian counts 6 p n^2, a
    factorisation n^3 + 700 n^2 + 1,000,000, a least-norm solution 15 n^3.  Condensed factorisations
    count like the others, so the budget of a curve is the same.  The weights were fitted
    to processor times of response curves, including the time spent in Python.
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
    condensed: int = 0

    @property
    def core(self) -> float:
        """Processor time in the C core (s)."""
        return self.contact + self.assembly + self.algebra + self.time_integration

    @property
    def python(self) -> float:
        """Processor time outside the C core (s)."""
        return max(0.0, self.processor - self.core)

    def __add__(self, other: Cost) -> Cost:
        """Return the sum of two costs."""
        sums = {f.name: getattr(self, f.name) + getattr(other, f.name) for f in fields(self)}
        return Cost(**sums)

    def __str__(self) -> str:
        processor = f", {self.processor:.3f} s of processor time" if self.processor > 0.0 else ""
        condensed = ""
        if self.condensed:
            condensed = f"; {self.condensed} of {self.factorisations} factorisations condensed"
        return (
            f"{self.seconds:.3f} s{processor}: contact {self.contact:.3f}, "
            f"assembly {self.assembly:.3f}, algebra {self.algebra:.3f}, "
            f"time {self.time_integration:.3f}, Python {self.python:.3f}; "
            f"{self.evaluations} evaluations, {self.iterations} iterations, "
            f"{self.failed_steps} failed steps{condensed}"
        )


class _OtherThreads(threading.local):
    """Processor time (s) of other threads that have worked for this thread."""

    seconds: float = 0.0


_other_threads = _OtherThreads()


def processor_time() -> float:
    """Return the processor time (s) of this thread and of the threads that have worked for it."""
    return time.thread_time() + _other_threads.seconds


def add_processor_time(seconds: float) -> None:
    """Count the processor time (s) of another thread that has worked for this one."""
    _other_threads.seconds += seconds


WEIGHED = ("evaluations", "jacobians", "factorisations", "least_norm")
"""Counters in the order of the weights :attr:`Counted.work`."""


@dataclass
class CostMeter:
    """Meter for the cost of a result on the creating thread and the threads that work for it.

    It sums time, the counters of several systems, and the cost of parts measured separately.
    """

    start: float = field(default_factory=time.perf_counter)
    systems: list[tuple[Counted, Any]] = field(default_factory=list)
    iterations: int = 0
    failed_steps: int = 0
    parts: list[Cost] = field(default_factory=list)
    processor_start: float = field(default_factory=processor_time)

    def add(self, cost: Cost) -> None:
        """Add the cost of a part that was measured separately while this meter ran."""
        self.parts.append(cost)

    def count(self, iterations: int, failed_steps: int = 0) -> None:
        """Add iterations and failed steps."""
        self.iterations += iterations
        self.failed_steps += failed_steps

    def watch(self, system: Counted) -> None:
        """Include the work of a system from now on; repeated calls have no effect."""
        if all(system.core is not other.core for other, _ in self.systems):
            self.systems.append((system, system.core.cost))

    @property
    def work(self) -> float:
        """Work so far in million operations."""
        total = sum(part.work for part in self.parts)
        for system, before in self.systems:
            now = system.core.cost
            counts = [getattr(now, name) - getattr(before, name) for name in WEIGHED]
            total += float(system.work @ counts)
        return float(total)

    def read(self, *parts: Cost) -> Cost:
        """Return the cost so far, including the parts of :meth:`add`."""
        total = Cost()
        for system, before in self.systems:
            now = system.core.cost
            total += Cost(
                contact=now.contact - before.contact,
                assembly=now.assembly - before.assembly,
                algebra=now.algebra - before.algebra,
                evaluations=now.evaluations - before.evaluations,
                jacobians=now.jacobians - before.jacobians,
                factorisations=now.factorisations - before.factorisations,
                least_norm=now.least_norm - before.least_norm,
                condensed=now.condensed - before.condensed,
            )
        total += Cost(iterations=self.iterations, failed_steps=self.failed_steps)
        for part in (*self.parts, *parts):
            total += part
        # the parts ran while this meter did, whose clocks include them
        return replace(
            total,
            seconds=time.perf_counter() - self.start,
            processor=processor_time() - self.processor_start,
            work=self.work + sum(part.work for part in parts),
        )


# ---- Threads of linear algebra ----


_held = Lock()


@cache
def _controller() -> ThreadpoolController:
    """Return the controller of the loaded BLAS libraries.

    The search for them takes a millisecond.
    """
    return ThreadpoolController()


@contextmanager
def single_thread() -> Iterator[None]:
    """Limit linear algebra to one thread, unless another context already does."""
    if not _held.acquire(blocking=False):
        yield
        return
    try:
        with _controller().limit(limits=1, user_api="blas"):
            yield
    finally:
        _held.release()


one_thread = single_thread()
"""Decorator: run the function with one thread for linear algebra."""
