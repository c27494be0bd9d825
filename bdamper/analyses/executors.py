"""Execution of the points of a sweep on the workers of an executor.

A job consists of a study and its function, and has a size of some megabytes. If each task contained
the job, Dask would need half a second per task, and a worker that is killed while receiving one can
block a process pool. Therefore tasks contain the path of a file with the job, which a worker reads
once. If a worker cannot read it, for example on another host, the point is submitted again with the
job. Threads of this process use the job itself. A few tasks for each worker are submitted at a
time.

A small point takes less time than Dask needs for a task. Therefore a task contains as many points
as can be computed in :data:`SECONDS`. It ends after this time, and points that it did not reach are
submitted again. The finished points of a task are stored in one write. The only required method of
an executor is :meth:`concurrent.futures.Executor.submit`.
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
NOT_RUN: Record = {
    "status": errors.NOT_RUN,
    "reason": "",
    "values": {},
    "seconds": 0.0,
    "cost": {**vars(Cost())},
}
"""Record of a point that was not computed because of an interruption."""


Job = Callable[[Mapping[str, Any]], Mapping[str, Any]]
"""Function of the settings of a point that returns its named results; picklable for other
processes.
"""


def recorded(job: Job, settings: Mapping[str, Any]) -> Record:
    """Return the record of one point: its named results, or the reason for a failure.

    A result "cost" of type :class:`bdamper.util.progress.Cost` is the cost of the point, and a
    result "status" that begins with a word of :data:`bdamper.util.errors.STATUSES` is its status.
    """
    meter = CostMeter()
    ending = errors.Ending()
    values: dict[str, Any] = {}
    try:
        # a worker has neither the LongWork nor the mark of the call that submitted the job
        with LongWork() as work, inside_package():
            values = dict(job(settings))
        # a job that returned may still have an answer that is incomplete
        status, reason = errors.separated(str(values.get("status", "")))
        if status in errors.STATUSES:
            ending = errors.Ending(status, reason)
            del values["status"]
        if work.interrupted:
            raise ExecutorEnded(work.reason) if work.reason else KeyboardInterrupt
    # SciPy raises ValueError for matrices with infinite entries
    except (BdamperError, ArithmeticError, ValueError, MemoryError, ExecutorEnded) as error:
        # MemoryError often has no text
        ending = errors.Ending(errors.FAILED, str(error) or type(error).__name__)
    spent = meter.read()
    cost = spent
    if isinstance(values.get("cost"), Cost):
        cost = values.pop("cost")
    return {
        "status": ending.status,
        "reason": ending.reason,
        "values": values,
        "seconds": spent.seconds,
        "cost": {**vars(cost)},
    }


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

    An error or an interruption at a later point ends the list. This point raises it again as the
    first of another task.
    """
    if isinstance(job, _Packed):
        try:
            job = _unpacked(job)
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
    """Return the job in two forms: for tasks, and for workers that cannot read the file of the
    first.

    Both are the job itself if it needs no file.
    """
    # threads share the memory of this process
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
        # a worker never reads an incomplete file
        path.with_suffix(".part").write_bytes(content)
        path.with_suffix(".part").rename(path)
    return _Packed(path), _Packed(path, content)


TASKS = 4
"""Number of submitted tasks for each worker."""
SECONDS = 0.1
"""Time of a task with several points."""


def run_points(
    job: Job,
    point: Callable[[int], Mapping[str, Any]],
    todo: Sequence[int],
    executor: Executor | None,
    keep: Keep,
) -> None:
    """Compute points, and store the points of each task as soon as it is finished.

    Parameters
    ----------
    job : Job
    point : callable
        Returns the settings of a point.
    todo : sequence of int
        Indices of the points to compute.
    executor : concurrent.futures.Executor, optional
        Without an executor, the points are computed one after the other.
    keep : callable
        Receives indices and records of the points of each task in the order of completion. After an
        interruption it may receive a point twice.

    Raises
    ------
    KeyboardInterrupt
        On Ctrl-C or shutdown of the executor. All finished points are stored before this or another
        error is raised.
    """
    if executor is None or not todo:
        for i in todo:
            keep([i], [recorded(job, point(i))])
        return
    most_running = TASKS * _n_workers(executor)
    waiting = deque(todo)
    running: dict[Future[list[Record] | None], list[int]] = {}
    task_size = 1
    with ExitStack() as stack:
        packed, with_content = _pack(job, executor, stack)

        def submit(task: list[int], packed_job: Job | _Packed) -> None:
            with executor_errors(RuntimeError):  # raised after a shutdown
                future = executor.submit(_run, packed_job, [point(i) for i in task])
            running[future] = task

        try:
            while waiting or running:
                while waiting and len(running) < most_running:
                    n = min(task_size, len(waiting))
                    submit([waiting.popleft() for _ in range(n)], packed)
                for future in wait(running, return_when=FIRST_COMPLETED).done:
                    task = running[future]
                    with executor_errors():
                        records = future.result()
                    # a worker that cannot read the file of the job returns None
                    if records is None:
                        submit(task, with_content)
                    else:
                        keep(task, records)
                        # points that the task did not reach come next, in their order
                        left = task[len(records) :]
                        waiting.extendleft(reversed(left))
                        task_size = _fitting(records)
                    # after the task is stored, because storing may be interrupted
                    del running[future]
        except BaseException:
            for future, task in running.items():
                _keep_finished(future, task, keep)
            raise


def _n_workers(executor: Executor) -> int:
    """Return the number of workers of an executor; 32 for others, such as the executor of Dask."""
    # attributes of executors of the standard library and of MPI
    for name in ("_max_workers", "num_workers"):
        number = getattr(executor, name, None)
        if isinstance(number, int):
            return number
    return 32


def _keep_finished(future: Future[list[Record] | None], task: list[int], keep: Keep) -> None:
    """Cancel a task; if it has already finished without an error, store its points."""
    if future.cancel() or not future.done() or future.exception():
        return
    records = future.result()
    if records:
        keep(task, records)


def _fitting(records: Sequence[Record]) -> int:
    """Return the number of points that take :data:`SECONDS`, at most twice as many as these."""
    seconds = sum(record["seconds"] for record in records)
    # points that took less than half the time double their number
    at_least = 0.5 * SECONDS
    return max(1, int(len(records) * SECONDS / max(seconds, at_least)))


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
    status, reason : tuple of str
    seconds : (n,) float
    """

    values: NDArray
    cost: NDArray
    status: tuple[str, ...]
    reason: tuple[str, ...]
    seconds: NDArray


class _Table:
    """Records of points by column, which need a sixth of the memory of mappings."""

    def __init__(self, n: int) -> None:
        self.known = np.zeros(n, bool)
        self.seconds = np.zeros(n)
        self.status = [errors.NOT_RUN] * n
        self.reason = [""] * n
        self.columns: dict[str, dict[str, NDArray]] = {"values": {}, "cost": {}}

    def put(self, i: int, record: Record) -> None:
        """Store the record of a point."""
        self.known[i] = True
        self.seconds[i] = record["seconds"]
        # results files of version 0.10 have the reason in the status
        status, reason = errors.separated(record["status"])
        # equal texts share their memory
        self.status[i] = sys.intern(status)
        self.reason[i] = sys.intern(record.get("reason", reason))
        for group, columns in self.columns.items():
            for name, value in record[group].items():
                column = self._column(columns, name, isinstance(value, float))
                column[i] = sys.intern(value) if isinstance(value, str) else value

    def _column(self, columns: dict[str, NDArray], name: str, is_float: bool) -> NDArray:
        """Return a column that can store a value; it has numbers as long as all values are."""
        n = len(self.known)
        if name not in columns:
            columns[name] = np.full(n, np.nan if is_float else None)
        elif not is_float and columns[name].dtype == float:
            columns[name] = columns[name].astype(object)
            columns[name][~self.known] = None
        return columns[name]

    def records(self) -> Records:
        n = len(self.known)
        values = named_fields(self.columns["values"], n)
        cost = named_fields(self.columns["cost"], n)
        return Records(values, cost, tuple(self.status), tuple(self.reason), self.seconds)


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
    """Return the records of all points.

    They have the same form for computed points and for points from the results file.

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
        After Ctrl-C or shutdown of the executor, unfinished points have the record :data:`NOT_RUN`
        with the reason.
    """
    n = len(names)
    table = _Table(n)
    if store is not None:
        index = {name: i for i, name in enumerate(names)}
        for record in store.finished():
            if record["index"] in index:
                table.put(index[record["index"]], record)
    todo = np.flatnonzero(~table.known).tolist()
    with (
        LongWork() as work,
        progress_counter(progress, n, n - len(todo), what, unit) as advance,
    ):

        def keep(task: Sequence[int], records: Sequence[Record]) -> None:
            lines = {}
            for i, record in zip(task, records):
                # a point may be received twice after an interruption
                if not table.known[i]:
                    lines[i] = json_line({"index": names[i], **record})
            # read back from its line of the results file, so that a computed point has the same
            # types as one that a later run takes from the file
            for i, line in lines.items():
                record_in_file = from_line(line)
                table.put(i, record_in_file)
                advance()
            if store is not None:
                store.append(*lines.values())

        run_points(job, point, todo, executor, keep)
    not_run = NOT_RUN | {"reason": str(work.reason)}
    for i in np.flatnonzero(~table.known).tolist():
        table.put(i, not_run)
    return table.records()
