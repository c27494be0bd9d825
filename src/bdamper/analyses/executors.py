"""Execution of the points of a sweep on the workers of an executor; each worker receives the common data once.

The job, a study with its function, has some megabytes, a task some hundred bytes. The job is therefore written to a file.
Tasks contain its digest, and a worker reads the file when it receives a digest for the first time. A worker that cannot
read the file, for example on another host, returns the task. Tasks with the job itself are then submitted, at most one for
each worker without the job. If all tasks contained the job, a scheduler would store it once for each point. The only
required method of an executor is :meth:`concurrent.futures.Executor.submit`.
"""

from __future__ import annotations

import hashlib
import json
import os
import pickle
import platform
import tempfile
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor, Future
from contextlib import ExitStack, suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path
from queue import SimpleQueue
from typing import Any, Protocol

import numpy as np

from bdamper.util import errors, validation
from bdamper.util.errors import BdamperError
from bdamper.util.progress import Cost, CostMeter, ExecutorEnded, LongWork, executor_errors, progress_counter
from bdamper.util.storage import ResultsFile, json_line

Record = dict[str, Any]
Keep = Callable[[int, Record], None]
NOT_RUN: Record = {"status": errors.NOT_RUN, "values": {}, "seconds": 0.0, "cost": {}}
"""Record of a point that was not computed because of an interruption."""


class Job(Protocol):
    """Common data of all points; picklable for other processes."""

    def run(self, settings: Mapping[str, Any]) -> Record:
        """Return the record of the point with these settings."""
        ...


def recorded(ask: Callable[[], Mapping[str, Any]]) -> Record:
    """Return the record of one point: the named results of a function, or the reason of a failure.

    A result "cost" of type :class:`bdamper.util.progress.Cost` is the cost of the point.
    """
    watch, ending, values = CostMeter(), errors.COMPLETE, dict[str, Any]()
    try:
        with LongWork() as work:  # in a worker there is no outer LongWork
            values = dict(ask())
        if work.interrupted:
            raise ExecutorEnded(work.reason) if work.reason else KeyboardInterrupt
    except (BdamperError, ArithmeticError, np.linalg.LinAlgError, ExecutorEnded) as error:
        ending = errors.with_reason(errors.FAILED, error)
    spent = watch.read()
    cost = values.pop("cost") if isinstance(values.get("cost"), Cost) else spent
    return {"status": ending, "values": values, "seconds": spent.seconds, "cost": asdict(cost)}


MOST_JOBS = 8
"""Number of jobs that a process stores, since several sweeps may share a pool; older ones are read again."""
_jobs: dict[str, Job] = {}
"""Jobs of this process and of its tasks, by the digests of their pickles."""


def _keep_job(key: str, job: Job) -> Job:
    """Store a job, and remove the oldest ones beyond :data:`MOST_JOBS`."""
    _jobs[key] = job
    for former in list(_jobs)[:-MOST_JOBS]:
        _jobs.pop(former, None)
    return job


def _unpacked(key: str, path: str, packed: bytes | None) -> Job | None:
    """Return the job of a digest from memory, from the bytes, or from the file; None if it is not available."""
    job = _jobs.get(key)
    if job is None:
        if packed is None:
            try:
                packed = Path(path).read_bytes()
            except OSError:
                return None
            if hashlib.sha256(packed).hexdigest() != key:
                return None
        job = _keep_job(key, pickle.loads(packed))
    return job


def work(key: str, path: str, packed: bytes | Job | None, settings: Mapping[str, Any]) -> tuple[str, Record | None]:
    """Return the name of the worker, and the record of one point; None if the worker cannot read the job."""
    job = _unpacked(key, path, packed) if packed is None or isinstance(packed, bytes) else packed
    return f"{platform.node()} {os.getpid()}", None if job is None else job.run(settings)


Task = Future[tuple[str, Record | None]]
"""Task on an executor."""


@dataclass
class _Tasks:
    """Tasks of an executor and the state of its workers.

    ``without`` contains the workers that returned a task and have not received the job, ``carriers`` the running tasks that
    contain it.
    """

    executor: Executor
    key: str
    path: str
    packed: bytes | Job
    points: Sequence[Mapping[str, Any]]
    running: dict[Task, int] = field(default_factory=dict)
    finished: SimpleQueue[Task] = field(default_factory=SimpleQueue)
    without: set[str] = field(default_factory=set)
    carriers: set[Task] = field(default_factory=set)
    handed_back: list[int] = field(default_factory=list)

    def submit(self, i: int, carries: bool) -> None:
        """Submit a point with the job, or with its digest only."""
        with executor_errors(RuntimeError):  # raised after a shutdown
            future = self.executor.submit(work, self.key, self.path, self.packed if carries else None, self.points[i])
        self.running[future] = i
        if carries:
            self.carriers.add(future)
        future.add_done_callback(self.finished.put)

    def record(self, future: Task) -> Record | None:
        """Return the record of a finished task; None if the worker returned the task."""
        self.carriers.discard(future)
        with executor_errors():
            worker, record = future.result()
        if record is None:
            self.without.add(worker)
            self.handed_back.append(self.running[future])
        else:
            self.without.discard(worker)
        return record

    def submit_again(self) -> None:
        """Submit returned tasks again, with the job if workers lack it."""
        while self.handed_back and (not self.without or len(self.carriers) < len(self.without)):
            self.submit(self.handed_back.pop(0), bool(self.without))

    def left(self, keep: Keep) -> None:
        """Store finished points after an early end of the work."""
        for future, i in self.running.items():
            if not future.cancel() and future.done() and future.exception() is None:
                record = future.result()[1]
                if record is not None:
                    keep(i, record)


def run_points(
    job: Job, points: Sequence[Mapping[str, Any]], todo: Sequence[int], executor: Executor | None, keep: Keep
) -> None:
    """Compute points and store each as soon as it is finished.

    Parameters
    ----------
    job : Job
    points : sequence of mapping
        Settings of all points.
    todo : sequence of int
        Indices of the points to compute.
    executor : concurrent.futures.Executor, optional
        Without it points are computed one after the other.
    keep : callable
        Receives index and record of each point in the order of completion. After an interruption it may receive a point
        twice.

    Raises
    ------
    KeyboardInterrupt
        On Ctrl-C or the end of the executor. All finished points are stored before this or another error is raised.
    """
    if executor is None or not todo:
        for i in todo:
            keep(i, job.run(points[i]))
        return
    packed: bytes | Job
    try:
        packed = pickle.dumps(job)
        key = hashlib.sha256(packed).hexdigest()
        _keep_job(key, job)  # threads of this process use the job itself
    except (pickle.PicklingError, AttributeError, TypeError):
        packed, key = job, ""  # sufficient for threads; a process pool raises an error with the reason
    with ExitStack() as stack:
        path = Path()
        with suppress(OSError):  # on a full disk tasks contain the job
            folder = tempfile.TemporaryDirectory(prefix="bdamper-", ignore_cleanup_errors=True)
            path = Path(stack.enter_context(folder)) / "job.pickle"
            if isinstance(packed, bytes):
                path.write_bytes(packed)
        tasks = _Tasks(executor, key, str(path), packed, points)
        try:
            for i in todo:
                tasks.submit(i, carries=not key)
            while tasks.running:
                future = tasks.finished.get()
                record = tasks.record(future)
                if record is not None:
                    keep(tasks.running[future], record)
                del tasks.running[future]  # after it is stored, since storing may be interrupted
                tasks.submit_again()
        except BaseException:
            tasks.left(keep)
            raise
        finally:
            for future in tasks.running:
                future.cancel()
            if _jobs.get(key) is job:
                del _jobs[key]


def check_executor(executor: Any) -> None:
    """Raise SettingError unless the executor is None or has a method ``submit``."""
    if executor is not None and not callable(getattr(executor, "submit", None)):
        raise validation.invalid("executor", "an executor with a method submit, as those of concurrent.futures", executor)


def run_stored(
    job: Job,
    points: Sequence[Mapping[str, Any]],
    names: Sequence[int | str],
    executor: Executor | None,
    store: ResultsFile | None,
    progress: bool,
    what: str,
    unit: str,
) -> list[Record]:
    """Return the records of all points, in the same form for computed points and for points from the results file.

    Parameters
    ----------
    job, points, executor
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
    list of mapping
        After Ctrl-C or the end of the executor, unfinished points have the record :data:`NOT_RUN` with the reason.
    """
    records: dict[int | str, Record] = {} if store is None else dict(store.records)
    todo = [i for i, name in enumerate(names) if name not in records]
    with LongWork() as work, progress_counter(progress, len(points), len(points) - len(todo), what, unit) as advance:

        def keep(i: int, record: Record) -> None:
            records[names[i]] = {"index": names[i], **record}
            if store is not None and names[i] not in store.records:
                store.append(records[names[i]])
            advance()

        run_points(job, points, todo, executor, keep)
    not_run = NOT_RUN | {"status": errors.with_reason(errors.NOT_RUN, work.reason)}
    return [json.loads(json_line(records.get(name, not_run))) for name in names]
