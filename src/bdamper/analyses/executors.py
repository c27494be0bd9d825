"""Points of a sweep on the workers of an executor, each of which receives what all points have in common once.

The job, a study with its question, takes some megabytes, a task some hundred bytes.  So the job is written to a file that
tasks name with its digest, and a worker reads it when it meets the digest first.  A worker that does not see the file (on
another host) hands the task back; as many tasks at a time as there are such workers then carry the job itself, until all of
them have it; if all carried it, a scheduler would hold it as often as there are points.  This asks nothing of an executor
but :meth:`concurrent.futures.Executor.submit`.
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
"""Record of a point that interrupted work has left out."""


class Job(Protocol):
    """Data common to all points; picklable if other processes need it."""

    def run(self, settings: Mapping[str, Any]) -> Record:
        """The record of the point with some settings."""
        ...


def recorded(ask: Callable[[], Mapping[str, Any]]) -> Record:
    """Record of one point: the answers to a question, or why there are none.

    An answer named "cost" that is a :class:`bdamper.util.progress.Cost` is the cost of the point.
    """
    watch, ending, values = CostMeter(), errors.COMPLETE, dict[str, Any]()
    try:
        with LongWork() as work:  # a worker does not know that the point is part of longer work
            values = dict(ask())
        if work.interrupted:
            raise ExecutorEnded(work.reason) if work.reason else KeyboardInterrupt
    except (BdamperError, ArithmeticError, np.linalg.LinAlgError, ExecutorEnded) as error:
        ending = errors.with_reason(errors.FAILED, error)
    spent = watch.read()
    cost = values.pop("cost") if isinstance(values.get("cost"), Cost) else spent
    return {"status": ending, "values": values, "seconds": spent.seconds, "cost": asdict(cost)}


MOST_JOBS = 8
"""Jobs that a process keeps, since several sweeps may share a pool; it reads older ones again if it needs them."""
_jobs: dict[str, Job] = {}
"""Jobs of this process and of the tasks that it has run, by the digests of their pickles."""


def _keep_job(key: str, job: Job) -> Job:
    """Keep a job, and remove the oldest ones beyond :data:`MOST_JOBS`."""
    _jobs[key] = job
    for former in list(_jobs)[:-MOST_JOBS]:
        _jobs.pop(former, None)
    return job


def _unpacked(key: str, path: str, packed: bytes | None) -> Job | None:
    """The job of a digest: the one that is kept, from the bytes, or from the file; None without any of them."""
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
    """Name of the worker that ran this, and the record of one point, None if the worker has no way to the job."""
    job = _unpacked(key, path, packed) if packed is None or isinstance(packed, bytes) else packed
    return f"{platform.node()} {os.getpid()}", None if job is None else job.run(settings)


Task = Future[tuple[str, Record | None]]
"""One that runs on an executor."""


@dataclass
class _Tasks:
    """Tasks of an executor, and what is known of its workers.

    ``without`` has the workers that have handed a task back and not yet received the job, ``carriers`` the running tasks
    that carry it.
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
        """Submit a point, with the job or with its digest alone."""
        with executor_errors(RuntimeError):  # as one that was shut down raises it
            future = self.executor.submit(work, self.key, self.path, self.packed if carries else None, self.points[i])
        self.running[future] = i
        if carries:
            self.carriers.add(future)
        future.add_done_callback(self.finished.put)

    def record(self, future: Task) -> Record | None:
        """Record of a finished task, None if it was handed back."""
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
        """Submit what was handed back, with the job as long as workers are without it."""
        while self.handed_back and (not self.without or len(self.carriers) < len(self.without)):
            self.submit(self.handed_back.pop(0), bool(self.without))

    def left(self, keep: Keep) -> None:
        """Keep what was finished when the work ended early."""
        for future, i in self.running.items():
            if not future.cancel() and future.done() and future.exception() is None:
                record = future.result()[1]
                if record is not None:
                    keep(i, record)


def run_points(
    job: Job, points: Sequence[Mapping[str, Any]], todo: Sequence[int], executor: Executor | None, keep: Keep
) -> None:
    """Run points, and keep each as soon as it is finished.

    Parameters
    ----------
    job : Job
    points : sequence of mapping
    todo : sequence of int
        Numbers of the points to run.
    executor : concurrent.futures.Executor, optional
        One point after another without it.
    keep : callable
        Receives number and record of each finished point, in the order in which they are finished; that of one in which
        it was interrupted once more.

    Raises
    ------
    KeyboardInterrupt
        On Ctrl-C, or if the executor has ended; as other errors, after all that was finished by then has been kept.
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
        packed, key = job, ""  # enough for threads; a pool of processes raises an error that says why it cannot
    with ExitStack() as stack:
        path = Path()
        with suppress(OSError):  # without room for the file tasks carry the job
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
                del tasks.running[future]  # not before it is kept, which may be interrupted
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
    """Refuse what takes no tasks; None stands for this process."""
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
    """Records of all points, in the same form whether a point was just computed or read from the file.

    Parameters
    ----------
    job, points, executor
        As in :func:`run_points`.
    names : sequence of int or str
        Of the points in the file.
    store : ResultsFile, optional
        What it has is not computed again; each point is added as soon as it is finished.
    progress : bool
        Whether to show a bar, of some ``what`` in some ``unit``.

    Returns
    -------
    list of mapping
        After Ctrl-C, or the end of the executor, :data:`NOT_RUN` with the reason for points that were not finished.
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
