"""Execution of the points of a sweep on the workers of an executor.

The job, a study with its function, has some megabytes. With the job in each task, Dask needs half a second for a task, and
a worker that is killed while it receives one can block a process pool. Therefore tasks contain the path of a file with the
job, which a worker reads once. If a worker cannot read it, for example on another host, the point is submitted again with
the job. Threads of this process use the job itself. A few tasks for each worker are submitted at a time.

Small points need less time than Dask needs for a task. Therefore a task contains as many points as take :data:`SECONDS`. It
ends after this time, and points that it did not reach are submitted again. The finished points of a task are stored in one
write.
The only required method of an executor is :meth:`concurrent.futures.Executor.submit`.
"""

from __future__ import annotations

import pickle
import sys
import tempfile
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ThreadPoolExecutor, wait
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any
from uuid import uuid4

import numpy as np
from numpy.typing import NDArray

from bdamper.util import errors, validation
from bdamper.util.errors import BdamperError, inside_package
from bdamper.util.progress import (
    Cost,
    CostMeter,
    ExecutorEnded,
    LongWork,
    executor_errors,
    progress_counter,
)
from bdamper.util.records import named_fields
from bdamper.util.storage import ResultsFile, from_line, json_line
from bdamper.util.workers import set_workers

Record = dict[str, Any]
Keep = Callable[[Sequence[int], Sequence[Record]], None]
NOT_RUN: Record = {"status": errors.NOT_RUN, "values": {}, "seconds": 0.0, "cost": {**vars(Cost())}}
"""Record of a point that was not computed because of an interruption."""


Job = Callable[[Mapping[str, Any]], Mapping[str, Any]]
"""Function of the settings of a point that returns its named results; picklable for other processes."""


def recorded(job: Job, settings: Mapping[str, Any]) -> Record:
    """Return the record of one point: its named results, or the reason of a failure.

    A result "cost" of type :class:`bdamper.util.progress.Cost` is the cost of the point, and a result "status" that begins
    with a word of :data:`bdamper.util.errors.STATUSES` is its status.
    """
    watch, ending, values = CostMeter(), errors.COMPLETE, dict[str, Any]()
    try:
        # a worker has neither the LongWork nor the mark of the call that submitted the job
        with LongWork() as work, inside_package():
            values = dict(job(settings))
        # a job that returned may still have an answer that is incomplete
        status = values.get("status")
        if isinstance(status, str) and errors.status_word(status) in errors.STATUSES:
            ending = values.pop("status")
        if work.interrupted:
            raise ExecutorEnded(work.reason) if work.reason else KeyboardInterrupt
    # SciPy raises ValueError for matrices with infinite entries
    except (BdamperError, ArithmeticError, ValueError, MemoryError, ExecutorEnded) as error:
        # MemoryError often has no text
        ending = errors.with_reason(errors.FAILED, error if str(error) else type(error).__name__)
    spent = watch.read()
    cost = values.pop("cost") if isinstance(values.get("cost"), Cost) else spent
    return {"status": ending, "values": values, "seconds": spent.seconds, "cost": {**vars(cost)}}


@dataclass(frozen=True)
class _Packed:
    """Pickled job: the path of its file and, for workers that cannot read the file, its content."""

    path: Path
    content: bytes = field(default=b"", compare=False)


@lru_cache(maxsize=4)  # several sweeps may share the workers
def _unpacked(job: _Packed) -> Job:
    unpacked: Job = pickle.loads(job.content or job.path.read_bytes())
    return unpacked


def _run(job: Job | _Packed, points: Sequence[Mapping[str, Any]]) -> list[Record] | None:
    """Return the records of the first points, at least one; None if the worker cannot read the job.

    An error or an interruption at a later point ends the list. This point raises it again as the first of another task.
    """
    try:
        job = _unpacked(job) if isinstance(job, _Packed) else job
    except OSError:
        return None
    end = time.monotonic() + SECONDS
    # the other workers of the executor compute on the other cores
    with set_workers(1):
        records = [recorded(job, points[0])]
        with suppress(BaseException):
            for settings in points[1:]:
                if time.monotonic() > end:
                    break
                records.append(recorded(job, settings))
    return records


def _pack(job: Job, executor: Executor, stack: ExitStack) -> tuple[Job | _Packed, Job | _Packed]:
    """Return the job as the tasks contain it, and as the tasks for workers that cannot read its file contain it."""
    if isinstance(executor, ThreadPoolExecutor):
        return job, job
    try:
        content = pickle.dumps(job)
    except (pickle.PicklingError, AttributeError, TypeError):
        return job, job  # Dask can send more; a process pool raises an error with the reason
    path = Path(uuid4().hex)
    with suppress(OSError):  # for example on a full disk
        folder = tempfile.TemporaryDirectory(prefix="bdamper-", ignore_cleanup_errors=True)
        path = Path(stack.enter_context(folder)) / "job.pickle"
        path.with_suffix(".part").write_bytes(content)
        path.with_suffix(".part").rename(path)
    return _Packed(path), _Packed(path, content)


TASKS, SECONDS = 4, 0.1
"""Number of submitted tasks for each worker, and time of a task with several points."""


def run_points(
    job: Job,
    point: Callable[[int], Mapping[str, Any]],
    todo: Sequence[int],
    executor: Executor | None,
    keep: Keep,
) -> None:
    """Compute points and store those of each task as soon as it is finished.

    Parameters
    ----------
    job : Job
    point : callable
        Returns the settings of a point.
    todo : sequence of int
        Indices of the points to compute.
    executor : concurrent.futures.Executor, optional
        Without it points are computed one after the other.
    keep : callable
        Receives indices and records of the points of each task in the order of completion. After an interruption it may
        receive a point twice.

    Raises
    ------
    KeyboardInterrupt
        On Ctrl-C or the end of the executor. All finished points are stored before this or another error is raised.
    """
    if executor is None or not todo:
        for i in todo:
            keep([i], [recorded(job, point(i))])
        return
    numbers = (getattr(executor, name, None) for name in ("_max_workers", "num_workers"))
    most = TASKS * next(
        (n for n in numbers if isinstance(n, int)), 32
    )  # the executor of Dask has no such attribute
    waiting, running, size = deque(todo), dict[Future[list[Record] | None], list[int]](), 1
    with ExitStack() as stack:
        small, whole = _pack(job, executor, stack)

        def submit(task: list[int], packed: Job | _Packed) -> None:
            with executor_errors(RuntimeError):  # raised after a shutdown
                future = executor.submit(_run, packed, [point(i) for i in task])
            running[future] = task

        try:
            while waiting or running:
                while waiting and len(running) < most:
                    submit([waiting.popleft() for _ in range(min(size, len(waiting)))], small)
                for future in wait(running, return_when=FIRST_COMPLETED).done:
                    task = running[future]
                    with executor_errors():
                        records = future.result()
                    if records is None:
                        submit(task, whole)
                    else:
                        keep(task, records)
                        waiting.extendleft(task[: len(records) - 1 : -1])
                        size = _fitting(records)
                    del running[future]  # after it is stored, since storing may be interrupted
        except BaseException:
            for future, task in running.items():
                if (
                    not future.cancel()
                    and future.done()
                    and not future.exception()
                    and (records := future.result())
                ):
                    keep(task, records)
            raise


def _fitting(records: Sequence[Record]) -> int:
    """Return the number of points that take :data:`SECONDS`, at most twice as many as these."""
    seconds = sum(record["seconds"] for record in records)
    return max(1, int(len(records) * SECONDS / max(seconds, 0.5 * SECONDS)))


def check_executor(executor: Any) -> None:
    """Raise SettingError unless the executor is None or has a method ``submit``."""
    if executor is not None and not callable(getattr(executor, "submit", None)):
        expected = "an executor with a method submit, such as those of concurrent.futures"
        raise validation.invalid("executor", expected, executor)


@dataclass(frozen=True)
class Records:
    """Records of n points.

    Parameters
    ----------
    values, cost : (n,) array with named fields
    status : tuple of str
    seconds : (n,) float
    """

    values: NDArray
    cost: NDArray
    status: tuple[str, ...]
    seconds: NDArray


class _Table:
    """Records of points by column, which need a sixth of the memory of mappings."""

    def __init__(self, n: int) -> None:
        self.known, self.seconds, self.status = np.zeros(n, bool), np.zeros(n), [errors.NOT_RUN] * n
        self.columns: dict[str, dict[str, NDArray]] = {"values": {}, "cost": {}}

    def put(self, i: int, record: Record) -> None:
        self.known[i], self.seconds[i], self.status[i] = (
            True,
            record["seconds"],
            sys.intern(record["status"]),
        )
        for group, columns in self.columns.items():
            for name, value in record[group].items():
                column, plain = columns.get(name), isinstance(value, float)
                if column is None:
                    column = columns[name] = np.full(len(self.known), np.nan if plain else None)
                elif not plain and column.dtype == float:
                    column = columns[name] = column.astype(object)
                    column[~self.known] = None
                column[i] = sys.intern(value) if isinstance(value, str) else value

    def records(self) -> Records:
        values, cost = (named_fields(columns, len(self.known)) for columns in self.columns.values())
        return Records(values, cost, tuple(self.status), self.seconds)


def run_stored(
    job: Job,
    point: Callable[[int], Mapping[str, Any]],
    names: Sequence[int | str],
    executor: Executor | None,
    store: ResultsFile | None,
    progress: bool,
    what: str,
    unit: str,
) -> Records:
    """Return the records of all points, in the same form for computed points and for points from the results file.

    Parameters
    ----------
    job, point, executor
        See :func:`run_points`.
    names : sequence of int or str
        Keys of the points in the file.
    store : ResultsFile, optional
        Its points are not computed again; finished points are appended.
    progress : bool
        Whether to show a progress bar.
    what, unit : str
        Labels of the progress bar.

    Returns
    -------
    Records
        After Ctrl-C or the end of the executor, unfinished points have the record :data:`NOT_RUN` with the reason.
    """
    table, index = _Table(len(names)), {name: i for i, name in enumerate(names)}
    for record in () if store is None else store.finished():
        if record["index"] in index:
            table.put(index[record["index"]], record)
    todo = np.flatnonzero(~table.known).tolist()
    with (
        LongWork() as work,
        progress_counter(progress, len(names), len(names) - len(todo), what, unit) as advance,
    ):

        def keep(task: Sequence[int], found: Sequence[Record]) -> None:
            new = {
                i: json_line({"index": names[i], **record})
                for i, record in zip(task, found)
                if not table.known[i]
            }
            for i, line in new.items():
                table.put(i, from_line(line))
                advance()
            if store is not None:
                store.append(*new.values())

        run_points(job, point, todo, executor, keep)
    not_run = NOT_RUN | {"status": errors.with_reason(errors.NOT_RUN, work.reason)}
    for i in np.flatnonzero(~table.known).tolist():
        table.put(i, not_run)
    return table.records()
