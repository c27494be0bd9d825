"""Sweeps over settings of a problem, and comparisons of several studies.

:func:`sweep` evaluates one function for many variants of a problem, on any executor. Every point depends on the problem and
its own settings only, so results do not depend on order, workers or interruptions. A results file
(:mod:`bdamper.util.storage`) can store finished points.

:func:`compare` evaluates one function for several studies. The function returns a response curve or an optimal curve, and
the :class:`Comparison` relates all of them to the first.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import closing, nullcontext, suppress
from dataclasses import dataclass, is_dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from bdamper.analyses.executors import Records, check_executor, run_stored
from bdamper.harmonic_balance.checks import Asking, check_question, like, problem_of
from bdamper.harmonic_balance.parameters import (
    MASS,
    check_name,
    present_name,
    study_fingerprint,
    vary,
)
from bdamper.harmonic_balance.problem import Problem
from bdamper.response.followed_peak import drops, followed_peaks, single_peak
from bdamper.response.headline import checks
from bdamper.response.highest_peak import highest_peak
from bdamper.response.linear_limits import free_and_stuck
from bdamper.response.optimal_curve import optimal_curve, preload_values
from bdamper.response.optimal_curve_result import OptimalCurve
from bdamper.response.peak import Peak
from bdamper.response.response_curve_result import ResponseCurve
from bdamper.util import plausible_ranges, validation
from bdamper.util.display import Differences, Plottable
from bdamper.util.errors import (
    FAILED,
    INCOMPLETE,
    NOT_RUN,
    BdamperError,
    SettingError,
    StaticError,
    all_complete,
    called_by_user,
    inside_user_code,
    status_word,
    with_reason,
)
from bdamper.util.formatting import (
    UNITS,
    amount,
    counted,
    peak_text,
    percent,
    short_repr,
    short_text,
    spaced,
)
from bdamper.util.progress import LongWork, one_thread, shows_progress, with_progress
from bdamper.util.records import named_fields, names_of, row_of
from bdamper.util.storage import INSTALLED, Recorded, ResultsFile, Storable
from bdamper.util.tables import Column, Tabular, concatenate

Values = Mapping[str, Any]
Task = Callable[[Any, float | None], Values]
"""Function of a study (or problem) and a preload (None if the sweep has none) that returns named numbers, texts or lists
of numbers.

"warning" is a text, empty if there is none; the result collects the others. "cost" may be a
:class:`bdamper.util.progress.Cost`, the cost of the point.
"""


@validation.check_arguments
@dataclass(frozen=True)
class PeakTask(validation.Checked):
    """Evaluation of the highest resonance peak.

    Parameters
    ----------
    preload : float, N, optional
        Preload if the sweep does not vary it.
    frequency : (low, high), Hz, optional
        Search interval; by default around the free and the stuck resonance of ``mode``.
    mode : int
    """

    preload: validation.Force | None = None
    frequency: validation.Interval | None = None
    mode: validation.Count = 1

    def __call__(self, study: Asking | Problem, preload: float | None) -> Values:
        at: Any = self.preload if preload is None else preload
        # a sweep over the preload compares its points with each other
        search = single_peak if preload is None else highest_peak
        peak = search(problem_of(study), at, self.frequency, mode=self.mode)
        stick, slip, separation = (float(s) for s in peak.shares)
        amplitude, frequency = (
            (peak.amplitude, peak.frequency) if peak.converged else (np.nan, np.nan)
        )
        return {
            "amplitude": amplitude,
            "lower_bound": peak.lower_bound,
            "frequency": frequency,
            "residual": peak.residual,
            "stick": stick,
            "slip": slip,
            "open": separation,
            "search_status": peak.search_status,
            "status": peak.status,
            "warning": "" if peak.search_status == "complete" else f"scan {peak.search_status}",
            "cost": peak.cost,
        }


@validation.check_arguments
@dataclass(frozen=True)
class OptimalTask(validation.Checked):
    """Evaluation of optimal curve and optimum.

    Parameters
    ----------
    preload : tuple of float, N
        Lower and upper limit, or all values.
    n : int
        Number of values between two limits.
    frequency : (low, high), Hz, optional
    mode : int
    """

    preload: tuple[float, ...] = (10.0, 25e3)
    n: int = 24
    frequency: validation.Interval | None = None
    mode: validation.Count = 1

    def __post_init__(self) -> None:
        preload_values(self.preload, self.n)
        super().__post_init__()

    def __call__(self, study: Asking | Problem, preload: float | None) -> Values:
        curve = optimal_curve(
            problem_of(study), self.preload, self.n, frequency=self.frequency, mode=self.mode
        )
        o = curve.optimum
        shared = curve.requested  # the other preloads differ from point to point
        return {
            "curve_preload": curve.preload[shared].tolist(), "curve_amplitude": curve.amplitude[shared].tolist(),
            "curve_frequency": curve.frequency[shared].tolist(), "optimum_preload": o.preload,
            "optimum_amplitude": o.amplitude, "optimum_frequency": o.frequency, "optimum_kind": o.kind,
            "optimum_uncertainty": o.uncertainty, "optimum_status": o.status,
            "free_frequency": curve.free.frequency, "free_amplitude": curve.free.amplitude,
            "stuck_frequency": curve.stuck.frequency, "stuck_amplitude": curve.stuck.amplitude,
            "warning": "; ".join(curve.warnings), "cost": curve.cost,
        }  # fmt: skip


@short_repr
@dataclass(frozen=True)
class SweepResult(Plottable, Tabular, Recorded, Storable, kind="bdamper-sweep"):
    """Results at all points of a sweep.

    ``plot`` draws one quantity over the last setting (:func:`bdamper.plot.plot_sweep`).

    Parameters
    ----------
    names : tuple of str
        Names of the settings.
    points : (n,) array with named fields
        Settings of each point: ``points["preload"]`` are all preloads.
    values : (n,) array with named fields
        Results of each point; NaN or None if there is none.
    status : tuple of str
        "complete", "failed: " with the reason, or "not run" after an interruption, with the reason if the executor ended.
    seconds : (n,) float
        Elapsed time of each point.
    shape : tuple of int
        Shape of the grid of settings, the last name fastest; one number for a list of points.
    settings : mapping
        Settings of the varied problem.
    model_hash : str
    cost : (n,) array with the fields of Cost, optional
        Cost of each point as returned by the evaluation; otherwise its elapsed time only.
    """

    names: tuple[str, ...]
    points: NDArray
    values: NDArray
    status: tuple[str, ...]
    seconds: NDArray
    shape: tuple[int, ...]
    cost: NDArray | None = None

    def __len__(self) -> int:
        return len(self.points)

    def with_present_names(self) -> Self:
        """Return a result of version 3 of the format with the present names of settings."""
        columns = {present_name(name): self.points[name] for name in names_of(self.points)}
        points = named_fields(columns, len(self))
        return replace(self, names=tuple(map(present_name, self.names)), points=points)

    def check_rows(self) -> None:
        """Raise ValueError unless every point of the grid has settings, values, status and time."""
        parts = (
            self.points,
            self.values,
            self.status,
            self.seconds,
            self.seconds if self.cost is None else self.cost,
        )
        counts = [int(np.prod(self.shape)), *(len(part) for part in parts)]
        if len(set(counts)) > 1:
            raise ValueError(f"grid, points, values, status, seconds and cost of {counts} points")

    @property
    def complete(self) -> bool:
        """Whether every point has a result; see ``warnings`` for doubts about the results."""
        return all_complete(self.status)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warning of each point, empty if there is none."""
        found = (
            self.values["warning"].tolist() if "warning" in self.quantities else [""] * len(self)
        )
        return tuple(str(warning or "") for warning in found)

    @property
    def quantities(self) -> tuple[str, ...]:
        """Names of the computed quantities."""
        return names_of(self.values)

    def array(self, quantity: str) -> NDArray:
        """Return a quantity as an array on the grid of settings; NaN at points without a value.

        Raises
        ------
        SettingError
            If there is no such quantity.
        """
        validation.choice("quantity", quantity, self.quantities)
        column = self.values[quantity]
        if column.dtype != object:
            return column.astype(float).reshape(self.shape)
        known = next((np.asarray(value) for value in column if value is not None), np.array(""))
        if known.dtype.kind not in "fiub":
            return np.fromiter(
                ("" if value is None else value for value in column), object, len(self)
            ).reshape(self.shape)
        rows = [
            np.full(known.shape, np.nan) if value is None else np.asarray(value, float)
            for value in column
        ]
        return np.array(rows).reshape(*self.shape, *known.shape)

    def _grid(self) -> dict[str, Any]:
        columns = {name: self.points[name].tolist() for name in self.names}
        if len(self.shape) != len(self.names) or any(
            isinstance(v, (list, dict)) for c in columns.values() for v in c
        ):
            return {}
        grid = {name: list(dict.fromkeys(column)) for name, column in columns.items()}
        for (name, values), n in zip(grid.items(), self.shape):
            if len(values) != n:
                raise SettingError(
                    f"to_xarray of a sweep: expected each value of '{name}' once, as coordinates are, found {n} values of "
                    f"which {len(values)} differ; to_pandas takes them all"
                )
        return grid

    def columns(self) -> dict[str, Column]:
        """Return one row for each point with settings, quantities, status and time; lists have a second dimension in
        xarray.
        """
        settings = {name: np.array([str(v) if isinstance(v, dict) else v for v in self.points[name].tolist()])
                    for name in self.names}  # fmt: skip
        out = {name: Column(values, UNITS.get(name, "")) for name, values in settings.items()}
        for name in self.quantities:
            values = self.array(name).reshape(len(self), -1)
            key, unit = (
                name if name not in out else f"answer_{name}",
                UNITS.get(name.removeprefix("curve_"), ""),
            )
            single = values.shape[1] == 1
            out[key] = (
                Column(values[:, 0], unit)
                if single
                else Column(values, unit, ("point", f"{key}_index"))
            )
        return out | {"run": Column(np.array(self.status)), "seconds": Column(self.seconds, "s")}

    def _headline(self) -> str:
        name = next(
            (
                q
                for q in self.quantities
                if self.array(q).dtype.kind == "f" and self.array(q).ndim == len(self.shape)
            ),
            "",
        )
        known = self.array(name).ravel() if name else np.empty(0)
        words = [status_word(s) for s in self.status]
        missing = (
            int(np.count_nonzero(~np.isfinite(known))) - words.count(FAILED) - words.count(NOT_RUN)
            if name
            else 0
        )
        doubted = sum(map(bool, self.warnings)) - missing
        counts = [
            (missing, "not found"),
            (words.count(FAILED), "failed"),
            (words.count(NOT_RUN), "not run"),
        ]
        counts.append((doubted, "with a warning"))
        points = f"{counted(len(self), 'point')} over {', '.join(spaced(n) for n in self.names)}"
        points = ", ".join([points, *(f"{n} {what}" for n, what in counts if n > 0)])
        if not np.isfinite(known).any():
            return f"{points}{next((f': {why}' for why in self.warnings if why), '')}."
        i, j = int(np.nanargmin(known)), int(np.nanargmax(known))
        ends = (
            f"{amount(known[k], UNITS.get(name, ''))} ({as_words(row_of(self.points, k))})"
            for k in dict.fromkeys((i, j))
        )
        return f"{spaced(name).capitalize()} {'from ' * (i != j)}{' to '.join(ends)}; {points}."


def as_words(point: Mapping[str, Any]) -> str:
    """Return the settings of a point as text with units."""
    texts = {
        n: amount(v, UNITS.get(n, ""), 6) if isinstance(v, float) else short_text(v)
        for n, v in point.items()
    }
    return ", ".join(f"{spaced(name)} {text}" for name, text in texts.items())


def _named(task: Any) -> str:
    """Return a stable identifier of a callable."""
    if is_dataclass(task) and not isinstance(task, type):
        return repr(task)
    return f"{getattr(task, '__module__', '')}.{getattr(task, '__qualname__', type(task).__qualname__)}"


@dataclass(frozen=True)
class _Job:
    """Study and function of all points."""

    study: Asking | Problem
    evaluate: Task

    def varied(self, settings: Mapping[str, Any]) -> Asking | Problem:
        varied = {name: value for name, value in settings.items() if name != "preload"}
        return vary(self.study, varied) if varied else self.study

    def check(self, points: NDArray) -> None:
        """Raise the first error if the settings of no point are valid."""
        first: BdamperError | None = None
        for i in range(len(points)):
            try:
                self.varied(row_of(points, i))
                return
            except BdamperError as error:
                first = first or error
        if first is not None:
            raise first

    def __call__(self, settings: Mapping[str, Any]) -> Values:
        preload = settings.get("preload")
        if preload is not None:
            preload = float(preload)
        varied = self.varied(settings)
        if isinstance(self.evaluate, (PeakTask, OptimalTask)):
            return self.evaluate(varied, preload)
        with inside_user_code():
            return self.evaluate(varied, preload)


def _points(over: Any, combine: str) -> tuple[tuple[str, ...], NDArray, tuple[int, ...]]:
    """Return names, settings of each point, and shape of the grid."""
    validation.check_value(
        isinstance(over, Mapping) and over, "over", "a mapping of setting to values", over
    )
    names = tuple(over)
    columns: dict[str, Sequence[Any]] = {}
    for name in names:
        if isinstance(over[name], (str, bytes)) or not isinstance(
            over[name], (Sequence, np.ndarray)
        ):
            raise SettingError(
                f"over '{name}': expected a sequence of values, found {over[name]!r}"
            )
        columns[name] = [v.item() if isinstance(v, np.generic) else v for v in over[name]]
        validation.check(columns[name], f"over '{name}'", "at least one value", "none")
    lengths = [len(column) for column in columns.values()]
    if combine == "product":
        columns = dict(zip(names, zip(*itertools.product(*columns.values()))))
        return names, named_fields(columns, len(columns[names[0]])), tuple(lengths)
    if combine == "zip":
        validation.check(
            len({*lengths}) == 1, 'combine="zip"', "as many values of each setting", lengths
        )
        return names, named_fields(columns, lengths[0]), (lengths[0],)
    raise SettingError(f'combine: expected "product" or "zip", found {combine!r}')


def _check_names(problem: Problem, over: Mapping[str, Any]) -> None:
    """Raise SettingError if a setting of a sweep cannot be varied."""
    for value in over.get("preload", ()):
        validation.number("over 'preload'", value, unit="N")
    for name in over:
        if name != "preload":
            check_name(problem, name)


def _question(
    evaluate: Any,
    names: Sequence[str],
    preload: float | None,
    frequency: tuple[float, float] | None,
    mode: int,
) -> Task:
    """Return the function to evaluate: the given one, or the search for the highest peak."""
    if evaluate is not None and (preload is not None or frequency is not None or mode != 1):
        raise SettingError("preload, frequency, mode: omit them if evaluate is given")
    task: Task = PeakTask(preload, frequency, mode) if evaluate is None else evaluate
    good = callable(task) and not isinstance(task, type)
    validation.check_value(good, "evaluate", "PeakTask(...), OptimalTask(...) or a function", task)
    if isinstance(task, PeakTask) and task.preload is None and "preload" not in names:
        raise SettingError(
            'preload: expected a number, or "preload" among the settings of the sweep, found neither'
        )
    return task


def _check_plausible(
    problem: Problem, evaluate: Task, over: Mapping[str, Any], in_task: bool
) -> None:
    """Warn once about implausible values, unless the sweep varies them; ``in_task``: the task has the preload."""
    varied = any(name.startswith("excitation") for name in over)
    if isinstance(evaluate, PeakTask | OptimalTask) and not varied:
        preload = validation.numbers(
            "preload", np.atleast_1d(over.get("preload", evaluate.preload)), unit="N"
        )
        if in_task:
            plausible_ranges.check("sweep", "preload", preload, problem.sizes)
        check_question(problem, preload, evaluate.frequency)
        if evaluate.mode > 1:
            with suppress(StaticError):  # the point of this preload says so
                free_and_stuck(problem.at(float(preload.max())), evaluate.mode)


def _check_loads(problem: Problem, evaluate: Task, points: NDArray) -> None:
    """Warn once if a sweep over speed or mass of the damper has preloads that contradict its centrifugal load."""
    if not {"speed", MASS} & {*names_of(points)}:
        return
    groups: dict[tuple[Any, float], list[float]] = {}
    for i in range(len(points)):
        point = row_of(points, i)
        preload = point.get("preload", getattr(evaluate, "preload", None))
        if preload is not None:
            at = point.get("speed", problem.settings.speed), point.get(MASS, 1.0)
            groups.setdefault(at, []).extend(np.ravel(preload))
    any(problem.sizes.check_preload(np.array(preloads), *at) for at, preloads in groups.items())


def _with_followed_peaks(job: _Job, task: PeakTask, points: NDArray, found: Records) -> Records:
    """Return the records of a sweep over the preload, without amplitudes below a peak of the next lower preload.

    The points with equal other settings are compared with each other (:mod:`bdamper.response.followed_peak`).
    """
    groups: dict[str, dict[float, int]] = {}
    for i in range(len(points)):
        settings = row_of(points, i)
        groups.setdefault(repr({**settings, "preload": None}), {})[float(settings["preload"])] = i
    if "amplitude" not in names_of(found.values):
        return found
    values, status = found.values.copy(), list(found.status)
    amplitude = values["amplitude"].astype(float)
    for group in groups.values():
        heights = {p: float(amplitude[i]) for p, i in group.items()}
        ordered = [heights[p] for p in sorted(heights) if np.isfinite(heights[p])]
        if not any(drops(a, b) for a, b in itertools.pairwise(ordered)):
            continue
        problem = problem_of(job.varied(row_of(points, next(iter(group.values())))))

        def peak_at(preload: float, problem: Problem = problem) -> Peak | None:
            peak = highest_peak(problem, preload, task.frequency, mode=task.mode)
            return peak if peak.converged and not peak.corner else None

        for p, followed in followed_peaks(problem, heights, lambda _: True, peak_at).items():
            i = group[p]
            values["amplitude"][i], values["frequency"][i] = np.nan, np.nan
            values["lower_bound"][i] = followed.peak.amplitude
            status[i] = with_reason(INCOMPLETE, followed.note)
            values["warning"][i] = followed.note
    return replace(found, values=values, status=tuple(status))


def _header(job: _Job, over: Mapping[str, Any], combine: str) -> dict[str, Any]:
    """Return the identification of a sweep in its results file."""
    return {
        "format": "bdamper-sweep-results", "version": 5, **INSTALLED.attributes(),
        "study": study_fingerprint(problem_of(job.study)), "evaluate": _named(job.evaluate), "combine": combine,
        "over": {name: list(values) for name, values in over.items()},
    }  # fmt: skip


@validation.check_arguments
@one_thread
def sweep(
    study: Asking | Problem,
    over: Mapping[str, Sequence[Any] | NDArray],
    evaluate: Task | None = None,
    *,
    combine: str = "product",
    preload: float | None = None,
    frequency: tuple[float, float] | None = None,
    mode: int = 1,
    executor: Executor | None = None,
    resume: str | Path | None = None,
    progress: bool | None = None,
) -> SweepResult:
    """Evaluate a function for many variants of a problem.

    Parameters
    ----------
    study : Study
    over : mapping of name to sequence of values
        "preload" and the settings of :mod:`bdamper.harmonic_balance.parameters`.
    evaluate : callable, optional
        ``evaluate(study, preload)`` returns named numbers, texts or lists of numbers; by default the highest peak. Process
        pools need a module-level function, a :class:`PeakTask` or an :class:`OptimalTask`.
    combine : {"product", "zip"}
        All combinations of the values, or element-wise combinations.
    preload, frequency, mode
        See :class:`PeakTask`.
    executor : concurrent.futures.Executor, optional
        Threads, processes, ``dask.distributed.Client(...).get_executor()`` or ``mpi4py.futures.MPIPoolExecutor``.
    resume : path, optional
        Results file: finished points are appended to it, and an interrupted sweep continues from it.
    progress : bool, optional
        Whether to show a progress bar; by default in a terminal and a notebook.

    Returns
    -------
    SweepResult
        After Ctrl-C or the end of the executor, unfinished points have the status "not run".

    Raises
    ------
    BdamperError
        If a name or value cannot be varied (SettingError), or the results file belongs to another sweep.
    """
    names, points, shape = _points(over, combine)
    problem = problem_of(study)
    _check_names(problem, over)
    check_executor(executor)
    progress = shows_progress(progress)
    evaluate = _question(evaluate, names, preload, frequency, mode)
    _check_plausible(
        problem, evaluate, over, preload is None and "preload" not in over and called_by_user()
    )
    _check_loads(problem, evaluate, points)
    job = _Job(study, evaluate)
    job.check(points)
    if executor is not None:
        _ = problem.stiffness  # computed once, before the job is sent to the workers
    opened = (
        nullcontext()
        if resume is None
        else closing(ResultsFile(resume, _header(job, over, combine)))
    )
    with opened as store:
        point = partial(row_of, points)
        found = run_stored(
            job, point, range(len(points)), executor, store, progress, "sweep", "point"
        )
    if type(evaluate) is PeakTask and "preload" in names:
        with LongWork():
            found = _with_followed_peaks(job, evaluate, points, found)
    return SweepResult(names, points, shape=shape, **vars(found), **problem.recorded())


# ---- Comparison of studies ----


@short_repr
@dataclass(frozen=True)
class Comparison(Plottable, Tabular, Storable, kind="bdamper-comparison"):
    """Response curves or optimal curves of several studies.

    ``plot`` draws all of them in the same axes (:func:`bdamper.plot.plot_comparison`).

    Parameters
    ----------
    names : tuple of str
        Names of the studies; the first is the reference of all changes.
    curves : tuple of ResponseCurve
        One for each study, or empty.
    optimal : tuple of OptimalCurve
        One for each study, or empty.
    """

    names: tuple[str, ...]
    curves: tuple[ResponseCurve, ...] = ()
    optimal: tuple[OptimalCurve, ...] = ()

    def __len__(self) -> int:
        return len(self.names)

    @property
    def results(self) -> dict[str, ResponseCurve] | dict[str, OptimalCurve]:
        """Results by the name of the study."""
        return (
            dict(zip(self.names, self.curves))
            if self.curves
            else dict(zip(self.names, self.optimal))
        )

    @property
    def differences(self) -> dict[str, Differences]:
        """Differences between the first result and each of the others."""
        first, *others = self.results.values()
        return {name: first.diff(other) for name, other in zip(self.names[1:], others)}

    def columns(self) -> dict[str, Column]:
        """Return the points of all curves with the name of their study."""
        results: tuple[ResponseCurve, ...] | tuple[OptimalCurve, ...] = self.curves or self.optimal
        return {
            "name": Column(np.repeat(np.array(self.names), [len(r) for r in results])),
            **concatenate(results),
        }

    def change(self, name: str) -> float:
        """Return the relative change of the amplitude from the first study; NaN if an amplitude is unknown."""
        of, first = (_outcome(self.results[key])[0] for key in (name, self.names[0]))
        return of / first - 1.0

    def _rows(self) -> list[tuple[str, ...]]:
        rows: list[tuple[str, ...]] = [
            ("", "amplitude", "frequency", "preload", "change", "time", "status")
        ]
        for name, result in self.results.items():
            a, f, p, status = _outcome(result)
            change = (
                percent(self.change(name), True)
                if name != self.names[0] and np.isfinite(self.change(name))
                else ""
            )
            numbers = amount(a, "m"), amount(f, "Hz", 6), amount(p, "N")
            rows.append((name, *numbers, change, amount(result.cost.seconds, "s"), status))
        return rows

    def _headline(self) -> str:
        a, f, p, why = _outcome(self.results[self.names[0]])
        if not np.isfinite(a):
            return f"No peak of '{self.names[0]}' to compare with: {why}."
        known = [
            (name, change) for name in self.names[1:] if np.isfinite(change := self.change(name))
        ]
        parts = (
            ", ".join(f"'{name}' {percent(change, True)}" for name, change in known)
            or "none is known"
        )
        doubts = [
            f"'{name}': {_outcome(result)[3]}"
            for name, result in self.results.items()
            if _failed(result)
        ]
        doubt = f" Not for design: {'; '.join(doubts)}." if doubts else ""
        return f"Changes from '{self.names[0]}' with {peak_text(a, f)}, preload {amount(p, 'N')}: {parts}.{doubt}"


def _failed(result: ResponseCurve | OptimalCurve) -> list[str]:
    """Return the failures of the checks of an optimal curve."""
    return (
        [check.failure for check in checks(result) if check.colour == "red"]
        if isinstance(result, OptimalCurve)
        else []
    )


def _outcome(result: ResponseCurve | OptimalCurve) -> tuple[float, float, float, str]:
    """Return amplitude (m), frequency (Hz), preload (N) and status of a result."""
    if isinstance(result, OptimalCurve):
        o = result.optimum
        return o.amplitude, o.frequency, o.preload, "; ".join(_failed(result)) or o.status
    if not len(result):
        return np.nan, np.nan, result.preload, f"{result.status}: {result.reason}"
    top = result.peak
    if result.peak_at_end:
        status = f"{result.status}, no peak: highest {peak_text(top.amplitude, top.frequency)}"
        return np.nan, np.nan, result.preload, status
    if why := result.may_be_higher:
        bound = f"lower bound {peak_text(top.amplitude, top.frequency)}: {why}"
        return np.nan, np.nan, result.preload, with_reason(INCOMPLETE, bound)
    return top.amplitude, top.frequency, result.preload, result.status


@validation.check_arguments
@one_thread
def compare(
    studies: Mapping[str, Asking | Problem | Mapping[str, Any]],
    question: Callable[[Any], ResponseCurve | OptimalCurve],
    *,
    progress: bool | None = None,
) -> Comparison:
    """Evaluate one function for several studies.

    Parameters
    ----------
    studies : mapping of name to study or settings
        The first is a study, the reference. Others may be mappings of settings that differ from it, with the names of
        :func:`bdamper.sweep`: ``{"now": study, "smooth": {"friction_coefficient": 0.2}}``.
    question : callable
        Returns the response curve or optimal curve of a study, for example ``lambda study: study.frequency_response(500.0,
        (280.0, 380.0))``.
    progress : bool, optional
        Whether to show a progress bar; by default in a terminal and a notebook.

    Returns
    -------
    Comparison
        After Ctrl-C it contains the studies up to the interrupted one.

    Raises
    ------
    SettingError
        If a study or a setting does not fit; raised before any computation.
    """
    words = "a mapping of one or more names to studies or settings"
    named = (
        isinstance(studies, Mapping) and studies and all(isinstance(key, str) for key in studies)
    )
    validation.check_value(bool(named), "studies", words, studies)
    first = next(iter(studies.values()))
    problem, variants = problem_of(first), []  # type: ignore[arg-type]
    for name, entry in studies.items():
        settings: Any = validation.instance(
            f"study '{name}'", getattr(entry, "problem", entry), (Problem, Mapping), words
        )
        if isinstance(settings, Problem):
            variants.append(entry)
        else:
            variants.append(like(first, vary(problem, settings)))  # type: ignore[type-var]
    validation.check_value(callable(question), "question", "a function of a study", question)
    results: list[ResponseCurve | OptimalCurve] = []
    for study in with_progress(variants, shows_progress(progress), "studies", "study"):
        with inside_user_code():
            answered = question(study)
        answer = validation.instance(
            "answer", answered, (ResponseCurve, OptimalCurve), "a ResponseCurve or an OptimalCurve"
        )
        kind = type(results[0]) if results else type(answer)
        results.append(
            validation.instance("answer", answer, kind, "the same kind of result from every study")
        )
        if answer.interrupted:
            break
    curves = tuple(result for result in results if isinstance(result, ResponseCurve))
    optimal = tuple(result for result in results if isinstance(result, OptimalCurve))
    return Comparison(tuple(studies)[: len(results)], curves, optimal)
