"""Design studies: one question asked of many variants of a study, on any executor, with results that survive a crash.

Every point is computed from the study and its own settings alone, so results do not depend on order, workers or
interruptions.  With a results file each finished point is appended to it at once, as one line of JSON, and forced to disk;
a run that is killed leaves at most a torn last line, which the next run cuts off.  The first line identifies the study,
the settings and the question: a file of another one is refused.
"""

from __future__ import annotations

import contextlib
import hashlib
import itertools
import json
import os
import pickle
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, Future, as_completed
from dataclasses import asdict, dataclass, field, fields, is_dataclass, replace
from pathlib import Path as FilePath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bdamper.model.model import Model, _feed
from bdamper.peaks.optimal import highest_peak, optimal_curve, preload_values
from bdamper.problem.problem import Problem
from bdamper.problem.variation import check_name, vary
from bdamper.util import validate
from bdamper.util.blas import one_thread
from bdamper.util.cost import Cost, Stopwatch
from bdamper.util.errors import BdamperError, SettingError
from bdamper.util.hdf5 import Storable, plain
from bdamper.util.plotting import Plottable
from bdamper.util.repr import brief
from bdamper.util.versions import HERE, Versions

Values = Mapping[str, Any]
Task = Callable[[Problem, float | None], Values]
"""The question: a study and a preload (None if the sweep has none) to named numbers, texts or lists of numbers.

An answer named ``"warning"`` is a text, empty where nothing is left open; the result counts them.  One named ``"cost"``
that is a :class:`bdamper.util.cost.Cost` is kept apart, as the cost of the point.
"""


def _check_place(task: PeakTask | OptimalTask) -> None:
    """Where peaks are looked for."""
    validate.fields(task, validate.whole, "mode", least=1)
    if task.frequency is not None:
        validate.fields(task, validate.interval, "frequency")


@dataclass(frozen=True)
class PeakTask:
    """The highest resonance peak.

    Parameters
    ----------
    preload : float, N, optional
        Where the sweep itself does not vary it.
    frequency : (low, high), Hz, optional
        Around the free and the stuck resonance of ``mode`` by default.
    mode : int
    """

    preload: float | None = None
    frequency: tuple[float, float] | None = None
    mode: int = 1

    def __post_init__(self) -> None:
        if self.preload is not None:
            validate.fields(self, validate.number, "preload", least=0.0, unit="N")
        _check_place(self)

    def __call__(self, problem: Problem, preload: float | None) -> Values:
        at = self.preload if preload is None else preload
        if at is None:
            raise SettingError('preload: expected "preload" among the settings of the sweep or PeakTask(preload=...)')
        peak = highest_peak(problem, at, self.frequency, mode=self.mode)
        stick, slip, separation = (float(s) for s in peak.shares)
        return {
            "amplitude": peak.amplitude, "frequency": peak.frequency, "residual": peak.residual, "stick": stick,
            "slip": slip, "open": separation, "scan": peak.scan,
            "warning": "" if peak.scan == "complete" else f"scan {peak.scan}", "cost": peak.cost,
        }  # fmt: skip


@dataclass(frozen=True)
class OptimalTask:
    """Optimal curve and optimum.

    Parameters
    ----------
    preload : tuple of float, N
        Two ends, or all values.
    n : int
        Values between two ends.
    frequency : (low, high), Hz, optional
    mode : int
    """

    preload: tuple[float, ...] = (10.0, 25e3)
    n: int = 24
    frequency: tuple[float, float] | None = None
    mode: int = 1

    def __post_init__(self) -> None:
        preload_values(self.preload, self.n)
        _check_place(self)

    def __call__(self, problem: Problem, preload: float | None) -> Values:
        curve = optimal_curve(problem, self.preload, self.n, frequency=self.frequency, mode=self.mode)
        o = curve.optimum
        return {
            "curve_preload": curve.preload.tolist(), "curve_amplitude": curve.amplitude.tolist(),
            "curve_frequency": curve.frequency.tolist(), "optimum_preload": o.preload, "optimum_amplitude": o.amplitude,
            "optimum_frequency": o.frequency, "optimum_kind": o.kind, "optimum_uncertainty": o.uncertainty,
            "optimum_status": o.status, "free_frequency": curve.free.frequency, "free_amplitude": curve.free.amplitude,
            "stuck_frequency": curve.stuck.frequency, "stuck_amplitude": curve.stuck.amplitude,
            "warning": "; ".join(curve.warnings), "cost": curve.cost,
        }  # fmt: skip


@brief
@dataclass(frozen=True)
class SweepResult(Plottable, Storable, kind="bdamper-sweep"):
    """Answers at all points of a sweep.

    ``plot`` draws one answer over the last setting (:func:`bdamper.plot.plot_sweep`).

    Parameters
    ----------
    names : tuple of str
        Of the settings.
    points : tuple of mapping
        Settings of each point.
    values : tuple of mapping
        Answers at each point, empty where there is none.
    status : tuple of str
        "done", or "failed: " with the reason.
    seconds : (n,) float
        Spent on each point.
    shape : tuple of int
        Of the grid of settings, the last name fastest; one number if points were given in a list.
    settings : mapping
        Of the study that was varied.
    model_hash : str
    cost : tuple of Cost
        Of each point: what the question has metered of it, otherwise the time alone.
    """

    names: tuple[str, ...]
    points: tuple[dict[str, Any], ...]
    values: tuple[dict[str, Any], ...]
    status: tuple[str, ...]
    seconds: NDArray
    shape: tuple[int, ...]
    settings: dict[str, Any] = field(default_factory=dict)
    model_hash: str = ""
    cost: tuple[Cost, ...] = ()

    def __len__(self) -> int:
        return len(self.points)

    @property
    def complete(self) -> bool:
        """Whether there is an answer at every point; what it leaves open stands in ``warnings``."""
        return all(s == "done" for s in self.status)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What the answer at each point leaves open, empty where nothing."""
        return tuple(str(value.get("warning", "")) for value in self.values)

    @property
    def quantities(self) -> tuple[str, ...]:
        """Names of the answers."""
        return tuple(dict.fromkeys(name for value in self.values for name in value))

    def array(self, quantity: str) -> NDArray:
        """Answers as an array on the grid of settings, NaN where there is none.

        Raises
        ------
        SettingError
            If there is no such answer.
        """
        if quantity not in self.quantities:
            raise SettingError(f"quantity: expected one of {self.quantities}, found '{quantity}'")
        known = next(np.asarray(value[quantity]) for value in self.values if quantity in value)
        if known.dtype.kind not in "fiub":
            flat = [value.get(quantity, "") for value in self.values]
            return np.array(flat, object).reshape(self.shape)
        rows = [np.asarray(value.get(quantity, np.full(known.shape, np.nan)), float) for value in self.values]
        return np.array(rows).reshape(*self.shape, *known.shape)

    def __str__(self) -> str:
        failed = [s for s in self.status if s != "done"]
        warned = [w for w in self.warnings if w]
        lines = [
            f"sweep over {', '.join(self.names)}: {len(self)} points {self.shape}, {len(failed)} failed, "
            f"{len(warned)} with a warning, "
            f"{float(np.nansum(self.seconds)):.2f} s of work, {sum(c.evaluations for c in self.cost)} evaluations"
        ]
        for name in self.quantities:
            array = self.array(name)
            if array.dtype.kind == "f" and array.ndim == len(self.shape) and np.isfinite(array).any():
                lines.append(f"  {name}: {np.nanmin(array):.6g} to {np.nanmax(array):.6g}")
        lines += [f"  {text}" for text in dict.fromkeys(failed)]
        if warned:
            lines.append(f"  first warning: {warned[0]}")
        return "\n".join(lines)


# ---- what identifies a sweep ----


def study_fingerprint(problem: Problem) -> str:
    """Digest of the model and of all settings of a study."""
    digest = hashlib.sha256(problem.model.hash.encode())
    for item in fields(problem):
        if item.name != "model" and not item.name.startswith("_"):
            _feed(digest, item.name, getattr(problem, item.name))
    return digest.hexdigest()


def _named(task: Any) -> str:
    """A text for a callable that stays the same from run to run."""
    if is_dataclass(task) and not isinstance(task, type):
        return repr(task)
    return f"{getattr(task, '__module__', '')}.{getattr(task, '__qualname__', type(task).__qualname__)}"


# ---- the results file ----


class ResultsFile:
    """Lines of JSON, the first of which identifies the sweep; see the docstring of the module.

    Parameters
    ----------
    path : path
    header : mapping
        Compared with the first line of an existing file.
    """

    def __init__(self, path: str | FilePath, header: Mapping[str, Any]) -> None:
        self.path = FilePath(path)
        self.header = dict(header)
        self.records: dict[int, dict[str, Any]] = {}
        self.file = os.open(self.path, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o666)
        try:
            self._lock()
            self._read()
        except BaseException:
            os.close(self.file)
            raise

    def _lock(self) -> None:
        try:
            import fcntl
        except ImportError:  # no locks of this kind on this system
            return
        try:
            fcntl.flock(self.file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            raise BdamperError(
                f"{self.path}: expected a results file of its own, found one that another run uses"
            ) from error

    def _read(self) -> None:
        content = b""
        os.lseek(self.file, 0, os.SEEK_SET)
        while part := os.read(self.file, 1 << 20):
            content += part
        whole = content.rfind(b"\n") + 1
        lines = content[:whole].splitlines()
        if not lines:
            if content and not _dump(self.header).startswith(content[: len(_dump(self.header))]):
                raise BdamperError(f"{self.path}: expected a results file of a sweep, found something else")
            os.ftruncate(self.file, 0)
            self._write(self.header)
            return
        try:
            found = json.loads(lines[0])
        except ValueError as error:
            raise BdamperError(f"{self.path}: expected a results file of a sweep, found something else") from error
        self._compare(found)
        for number, line in enumerate(lines[1:], 2):
            try:
                record = json.loads(line)
                self.records[int(record["index"])] = record
            except (ValueError, KeyError, TypeError) as error:
                raise BdamperError(
                    f"{self.path}, line {number}: expected one finished point, found {line[:60]!r}"
                ) from error
        if whole < len(content):  # torn by the end of the run that wrote it
            os.ftruncate(self.file, whole)

    def _compare(self, found: Any) -> None:
        if not isinstance(found, dict) or found.get("format") != self.header["format"]:
            raise BdamperError(f"{self.path}: expected a results file of a sweep, found something else")
        own, other = (Versions.stored(header).bdamper for header in (self.header, found))
        if own != other:
            raise BdamperError(
                f"{self.path}: expected results of bdamper {own}, found those of bdamper {other}, "
                "which this version cannot continue"
            )
        for name, expected in json.loads(_dump(self.header)).items():
            if name not in HERE.attributes() and found.get(name) != expected:
                raise BdamperError(
                    f"{self.path}: expected results of this sweep, found those of another one: {name} is "
                    f"{_short(found.get(name))}, here {_short(expected)}"
                )

    def _write(self, record: Mapping[str, Any]) -> None:
        line = _dump(record)
        while line:
            line = line[os.write(self.file, line) :]
        os.fsync(self.file)

    def append(self, record: dict[str, Any]) -> None:
        """Add one finished point, on disk when this returns."""
        self._write(record)
        self.records[int(record["index"])] = record

    def close(self) -> None:
        os.close(self.file)


def _dump(record: Mapping[str, Any]) -> bytes:
    return json.dumps(record, default=plain).encode() + b"\n"


def _short(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 100 else text[:97] + "..."


# ---- the work ----


@dataclass(frozen=True)
class _Job:
    """What all points have in common."""

    problem: Problem
    evaluate: Task
    model: Callable[..., Model] | None = None

    def run(self, settings: Mapping[str, Any]) -> dict[str, Any]:
        watch = Stopwatch()
        status, values = "done", {}
        cost: Cost | None = None
        try:
            problem = self.problem
            arguments = {name[6:]: value for name, value in settings.items() if name.startswith("model.")}
            if arguments:
                assert self.model is not None
                problem = replace(problem, model=self.model(**arguments))
            rest = {k: v for k, v in settings.items() if k != "preload" and not k.startswith("model.")}
            if rest:
                problem = vary(problem, rest)
            preload = settings.get("preload")
            values = dict(self.evaluate(problem, None if preload is None else float(preload)))
            if isinstance(values.get("cost"), Cost):
                cost = values.pop("cost")
        except (BdamperError, ArithmeticError, np.linalg.LinAlgError) as error:
            status = f"failed: {error}"
        spent = watch.read()
        return {"status": status, "values": values, "seconds": spent["seconds"], "cost": asdict(cost or Cost(**spent))}


_jobs: dict[str, _Job] = {}


def _work(key: str, packed: bytes | _Job, settings: Mapping[str, Any]) -> dict[str, Any]:
    """One point in a worker, which unpacks the common part once."""
    if isinstance(packed, _Job):
        return packed.run(settings)
    job = _jobs.get(key)
    if job is None:
        _jobs.clear()
        job = _jobs[key] = pickle.loads(packed)
    return job.run(settings)


def _points(over: Any, combine: str) -> tuple[tuple[str, ...], list[dict[str, Any]], tuple[int, ...]]:
    if not isinstance(over, Mapping) or not over:
        raise SettingError(f"over: expected a mapping of setting to values, found {over!r}")
    names = tuple(over)
    columns: list[list[Any]] = []
    for name in names:
        if isinstance(over[name], (str, bytes)) or not isinstance(over[name], (Sequence, np.ndarray)):
            raise SettingError(f"over '{name}': expected a sequence of values, found {over[name]!r}")
        columns.append([v.item() if isinstance(v, np.generic) else v for v in over[name]])
        if not columns[-1]:
            raise SettingError(f"over '{name}': expected at least one value, found none")
    if combine == "product":
        return names, [dict(zip(names, row)) for row in itertools.product(*columns)], tuple(len(c) for c in columns)
    if combine == "zip":
        lengths = {len(c) for c in columns}
        if len(lengths) != 1:
            raise SettingError(f'combine="zip": expected as many values of each setting, found {[len(c) for c in columns]}')
        return names, [dict(zip(names, row)) for row in zip(*columns)], (len(columns[0]),)
    raise SettingError(f'combine: expected "product" or "zip", found {combine!r}')


@contextlib.contextmanager
def _bar(show: bool, total: int, done: int) -> Iterator[Any]:
    if not show:
        yield lambda: None
        return
    from tqdm.auto import tqdm

    with tqdm(total=total, initial=done, desc="sweep", unit="point") as bar:
        yield bar.update


@one_thread
def sweep(
    problem: Problem,
    over: Mapping[str, Sequence[Any] | NDArray],
    evaluate: Task | None = None,
    *,
    model: Callable[..., Model] | None = None,
    combine: str = "product",
    preload: float | None = None,
    frequency: tuple[float, float] | None = None,
    mode: int = 1,
    executor: Executor | None = None,
    results: str | FilePath | None = None,
    progress: bool = False,
) -> SweepResult:
    """Ask one question of many variants of a study.

    Parameters
    ----------
    problem : Problem
    over : mapping of name to sequence of values
        "preload", the settings of :mod:`bdamper.problem.variation` ("friction_coefficient", "excitation.amplitude",
        "damper_mass_factor" ...), and "model.<argument>" for arguments of ``model``.
    evaluate : callable, optional
        ``evaluate(study, preload)`` gives named answers: numbers, texts, lists of numbers.  The highest peak by default.
        For processes it must be picklable: a function of a module, or a :class:`PeakTask` or :class:`OptimalTask`.
    model : callable, optional
        Makes the model from its arguments.
    combine : {"product", "zip"}
        All combinations of the values, or the first with the first and so on.
    preload, frequency, mode
        Of the default question.
    executor : concurrent.futures.Executor, optional
        Threads, processes, ``dask.distributed.Client(...).get_executor()``, ``mpi4py.futures.MPIPoolExecutor``; one point
        after another without it.  It is not shut down.
    results : path, optional
        File to which finished points are appended, and from which an interrupted sweep goes on.
    progress : bool
        Show a progress bar.

    Returns
    -------
    SweepResult

    Raises
    ------
    SettingError
        For a name or value that cannot be varied.
    BdamperError
        If the results file is of another sweep.
    """
    names, points, shape = _points(over, combine)
    for name, value in (("evaluate", evaluate), ("model", model)):
        if value is not None and not callable(value):
            raise validate.unfit(name, "a callable (for evaluate: PeakTask(...), OptimalTask(...) or a function)", value)
    if executor is not None and not callable(getattr(executor, "submit", None)):
        raise validate.unfit("executor", "an executor with a method submit, as those of concurrent.futures", executor)
    validate.flag("progress", progress)
    for value in over.get("preload", ()):
        validate.number("over 'preload'", value, unit="N")
    for name in names:
        if name.startswith("model."):
            if model is None:
                raise SettingError(f"over '{name}': expected a model factory (model=...), found none")
        elif name != "preload":
            check_name(problem, name)
    if evaluate is None:
        evaluate = PeakTask(preload, frequency, mode)
        if preload is None and "preload" not in names:
            raise SettingError('preload: expected a number, or "preload" among the settings of the sweep')
    elif preload is not None or frequency is not None or mode != 1:
        raise SettingError("preload, frequency, mode: expected none of them together with evaluate, which has its own")
    job = _Job(problem, evaluate, model)
    store: ResultsFile | None = None
    records: dict[int, dict[str, Any]] = {}
    if results is not None:
        header = {
            "format": "bdamper-sweep-results", "version": 3, **HERE.attributes(), "study": study_fingerprint(problem),
            "evaluate": _named(evaluate), "model": _named(model) if model is not None else None, "combine": combine,
            "over": {name: list(over[name]) for name in names},
        }  # fmt: skip
        store = ResultsFile(results, header)
        records = store.records
    try:
        todo = [i for i in range(len(points)) if i not in records]
        with _bar(progress, len(points), len(points) - len(todo)) as advance:
            for i, record in _outcomes(job, points, todo, executor):
                record = {"index": i, **record}
                if store is not None:
                    store.append(record)
                records[i] = record
                advance()
    finally:
        if store is not None:
            store.close()
    # the same form whether a point was just computed or read from the file
    ordered = [json.loads(_dump(records[i])) for i in range(len(points))]
    return SweepResult(
        names=names,
        points=tuple(points),
        values=tuple(r["values"] for r in ordered),
        status=tuple(r["status"] for r in ordered),
        seconds=np.array([r["seconds"] for r in ordered]),
        shape=shape,
        settings=problem.record(None),
        model_hash=problem.model.hash,
        cost=tuple(Cost(**r["cost"]) if "cost" in r else Cost(seconds=r["seconds"]) for r in ordered),
    )


def _outcomes(
    job: _Job, points: list[dict[str, Any]], todo: list[int], executor: Executor | None
) -> Iterator[tuple[int, dict[str, Any]]]:
    """Points as they are finished."""
    if executor is None or not todo:
        for i in todo:
            yield i, job.run(points[i])
        return
    # what variants share is made before it is sent out
    _ = job.problem.stiffness
    packed: bytes | _Job
    try:
        packed = pickle.dumps(job)
        key = hashlib.sha256(packed).hexdigest()
        _jobs.clear()
        _jobs[key] = job  # threads of this process use the study itself
    except (pickle.PicklingError, AttributeError, TypeError):
        packed, key = job, ""  # serves threads; a process pool will say why it cannot
    futures: dict[Future[dict[str, Any]], int] = {}
    try:
        for i in todo:
            futures[executor.submit(_work, key, packed, points[i])] = i
        for future in as_completed(futures):
            yield futures[future], future.result()
    finally:
        for future in futures:
            future.cancel()
        _jobs.pop(key, None)
