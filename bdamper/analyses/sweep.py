"""Sweeps over settings of a problem, and comparisons of several studies.

:func:`sweep` evaluates one function for many variants of a problem, on any executor. Every point
depends on the problem and its own settings only, so results do not depend on order, workers or
interruptions. A results file (:mod:`bdamper.util.storage`) can store finished points.

:func:`compare` evaluates one function for several studies. The function returns a response curve or
an optimal curve, and the :class:`Comparison` relates all of them to the first.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import closing, nullcontext, suppress
from dataclasses import dataclass, is_dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Self

import numpy as np
from numpy.typing import NDArray

from bdamper.analyses.executors import Records, check_executor, run_stored
from bdamper.harmonic_balance.checks import check_question
from bdamper.harmonic_balance.parameters import (
    MASS,
    check_name,
    present_name,
    study_fingerprint,
    vary,
)
from bdamper.harmonic_balance.problem import Problem
from bdamper.harmonic_balance.rotor_speed import preload_at
from bdamper.harmonic_balance.study_boundary import StudyLike, in_type_of, problem_of
from bdamper.response.branches import UNBOUNDED
from bdamper.response.first_slip import first_slip
from bdamper.response.followed_peak import followed_peaks, highest_peak
from bdamper.response.linear_limits import free_and_stuck
from bdamper.response.optimal_curve import optimal_curve, preload_values
from bdamper.response.optimal_curve_result import OptimalCurve
from bdamper.response.optimum_checks import checks
from bdamper.response.peak import Peak
from bdamper.response.peak_error import changes_by_source
from bdamper.response.response_curve_result import ResponseCurve
from bdamper.util import plausible_ranges, validation
from bdamper.util.display import Differences, Plottable, Result, WithChecks
from bdamper.util.errors import (
    COMPLETE,
    FAILED,
    INCOMPLETE,
    NOT_RUN,
    BdamperError,
    SettingError,
    StaticError,
    WithRowStatus,
    all_complete,
    called_by_user,
    inside_user_code,
    with_reason,
)
from bdamper.util.formatting import (
    amount,
    beyond,
    counted,
    peak_text,
    percent,
    short_repr,
    short_text,
    spaced,
    unit_of,
)
from bdamper.util.progress import LongWork, one_thread, shows_progress, with_progress
from bdamper.util.records import Data, named_fields, names_of, row_of
from bdamper.util.statement import Row, Statement
from bdamper.util.storage import INSTALLED, Recorded, ResultsFile, Storable
from bdamper.util.tables import EXTREMES, Column, Tabular, concatenate

Values = Mapping[str, Any]
SEPARATOR = "; "
"""Text between two warnings of a point."""
MOST_FAILURES = 3
"""Failed points that an error names."""
Task = Callable[[Any, float | None], Values]
"""Function of a study (or problem) and a preload (None if the sweep has none) that returns named
numbers, texts or lists of numbers.

"warning" is a text, empty if there is none; the result collects the others. "cost" may be a
:class:`bdamper.util.progress.Cost`, the cost of the point.
"""


@validation.check_arguments
@dataclass(frozen=True)
class PeakTask(validation.Checked):
    """Task of a sweep: find the highest resonance peak.

    Parameters
    ----------
    preload : float, N, optional
        Preload if the sweep does not vary it; by default the load of the damper at the rotor speed
        of each study.
    frequency : (low, high), Hz, optional
        Search interval; by default around the free and the stuck resonance of ``mode``.
    mode : int
    errors : bool
        Estimate the errors by harmonics and residual modes: "harmonic_change", "vector_change", and
        their sum "error", relative to the amplitude.
    shroud : str
        Name of an interface between neighbouring blades.  It adds its state at rest and its first
        slip; a sweep over ``"constant_loads.shroud"`` or ``"gap.shroud"`` then shows which
        interference a shroud needs, and one over ``"speed"`` what rotation leaves of it.

        - "shroud_force", N: normal force at rest
        - "interference", m: largest one of its points at assembly
        - "static_slip", m: largest one of its points from assembly to rest
        - "first_slip": excitation of first slip over that of the study
          (:meth:`bdamper.Study.first_slip`)
        - "locked_amplitude", m: amplitude at first slip
    """

    preload: validation.Force | None = None
    frequency: validation.Interval | None = None
    mode: validation.Count = 1
    errors: bool = True
    shroud: str = ""

    def __post_init__(self) -> None:
        expected = "the name of an interface between blades, or an empty text"
        validation.check_value(isinstance(self.shroud, str), "shroud", expected, self.shroud)
        super().__post_init__()

    def __call__(self, study: StudyLike | Problem, preload: float | None) -> Values:
        problem = problem_of(study)
        # the preload of the task, if the sweep does not vary it
        load: Any = self.preload if preload is None else preload
        if load is None:
            speed = problem.settings.speed
            if speed is None:
                raise SettingError("preload: expected a number, or a study at a rotor speed")
            load = preload_at(problem, speed)
        if self.shroud:
            validation.choice("shroud", self.shroud, problem.settings.shrouds)
        peak = highest_peak(problem, load, self.frequency, mode=self.mode, errors=self.errors)
        stick, slip, separation = peak.shares
        doubts = []
        search = with_reason(peak.search_status, peak.search_reason)
        if peak.search_reason.startswith(UNBOUNDED):
            doubts.append(peak.search_reason)
        elif search != COMPLETE:
            doubts.append(f"search {search}")
        of_shroud: dict[str, Any] = {}
        if self.shroud:
            of_shroud, doubt = self._shroud_values(problem, load)
            if doubt:
                doubts.append(doubt)
        return {
            "amplitude": peak.amplitude if peak.ok else np.nan,
            "lower_bound": peak.lower_bound,
            "frequency": peak.frequency if peak.ok else np.nan,
            **({"error": peak.error} if self.errors else {}),
            **of_shroud,
            "residual": peak.residual,
            "stick": float(stick),
            "slip": float(slip),
            "open": float(separation),
            **(changes_by_source(peak.errors) if self.errors else {}),
            "search_status": peak.search_status,
            "search_reason": peak.search_reason,
            "status": peak.status_text,
            "warning": SEPARATOR.join(doubts),
            "cost": peak.cost,
        }

    def _shroud_values(self, problem: Problem, preload: float) -> tuple[dict[str, Any], str]:
        """Return the state of the shroud at rest and its first slip, and a doubt about them."""
        state = problem.static(preload)
        doubt = state.too_far
        factor = np.nan
        locked_amplitude = np.nan
        try:
            limit = first_slip(problem.at(preload), self.frequency, self.mode)
            factor = limit.factor
            locked_amplitude = limit.amplitude_at_first_slip
        except BdamperError as error:
            doubt = f"no first slip: {error}"
        values = {
            "shroud_force": state.normal_force[self.shroud],
            "interference": state.largest_interference.get(self.shroud, np.nan),
            "static_slip": state.static_slip[self.shroud],
            "first_slip": factor,
            "locked_amplitude": locked_amplitude,
        }
        return values, doubt


@validation.check_arguments
@dataclass(frozen=True)
class OptimalTask(validation.Checked):
    """Task of a sweep: compute the optimal curve and its optimum.

    Parameters
    ----------
    preload : tuple of float, N
        Lower and upper limit, or all values.
    n : int
        Number of values between two limits.
    frequency : (low, high), Hz, optional
    mode : int
    errors : bool
        Estimate the errors of the optimum, as in :class:`PeakTask`.
    """

    preload: tuple[float, ...] = (10.0, 25e3)
    n: int = 24
    frequency: validation.Interval | None = None
    mode: validation.Count = 1
    errors: bool = True

    def __post_init__(self) -> None:
        preload_values(self.preload, self.n)
        super().__post_init__()

    def __call__(self, study: StudyLike | Problem, preload: float | None) -> Values:
        curve = optimal_curve(
            problem_of(study),
            self.preload,
            self.n,
            frequency=self.frequency,
            mode=self.mode,
            errors=self.errors,
        )
        optimum = curve.optimum
        # the preloads that refine the curve differ from point to point of the sweep
        requested = curve.requested
        return {
            "curve_preload": curve.preload[requested].tolist(),
            "curve_amplitude": curve.amplitude[requested].tolist(),
            "curve_frequency": curve.frequency[requested].tolist(),
            "optimum_preload": optimum.preload,
            "optimum_amplitude": optimum.amplitude,
            "optimum_frequency": optimum.frequency,
            **(changes_by_source(curve.errors_at(optimum.preload)) if self.errors else {}),
            "optimum_kind": optimum.kind,
            "optimum_uncertainty": optimum.uncertainty,
            "optimum_status": optimum.status,
            "optimum_reason": optimum.reason,
            "free_frequency": curve.free.frequency,
            "free_amplitude": curve.free.amplitude,
            "stuck_frequency": curve.stuck.frequency,
            "stuck_amplitude": curve.stuck.amplitude,
            "warning": SEPARATOR.join(curve.warnings),
            "cost": curve.cost,
        }


@short_repr
@dataclass(frozen=True)
class SweepResult(
    WithRowStatus, WithChecks, Plottable, Tabular, Recorded, Storable, kind="bdamper-sweep"
):
    """Results at all points of a sweep.

    ``plot`` draws one quantity against the last setting, or the quantities of a shroud
    (:func:`bdamper.plot.plot_sweep`).

    Parameters
    ----------
    names : tuple of str
        Names of the settings.
    points : (n,) array with named fields
        Settings of each point: ``points["preload"]`` contains all preloads.
    values : (n,) array with named fields
        Results of each point; NaN or None if there is none.
    status : tuple of str
        "complete", "failed", "not run" after an interruption, or the status of the returned result.
    reason : tuple of str
        Reason for the status of each point, "" if there is none.
    seconds : (n,) float
        Elapsed time of the computation of each point.
    shape : tuple of int
        Shape of the grid of settings, in which the last setting varies fastest; one number for a
        list of points.
    settings : mapping
        Settings of the base problem, before the sweep changes it.
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
    reason: Annotated[tuple[str, ...], Data(derived=True)] = ()

    def __len__(self) -> int:
        return len(self.points)

    def with_present_names(self) -> Self:
        """Return a result of an earlier version with the present names of settings."""
        settings = {present_name(name): self.points[name] for name in names_of(self.points)}
        names = tuple(present_name(name) for name in self.names)
        return replace(self, names=names, points=named_fields(settings, len(self)))

    def check_rows(self) -> None:
        """Raise ValueError unless every point of the grid has settings, values, status and time."""
        cost = self.seconds if self.cost is None else self.cost
        counts = [
            int(np.prod(self.shape)),
            len(self.points),
            len(self.values),
            len(self.status),
            len(self.reason),
            len(self.seconds),
            len(cost),
        ]
        if len(set(counts)) > 1:
            names = "grid, points, values, status, reason, seconds and cost"
            raise ValueError(f"{names} differ in length: {', '.join(map(str, counts))}")

    @property
    def complete(self) -> bool:
        """Whether every point has a result; see ``warnings`` for doubts about the results."""
        return all_complete(self.status)

    @property
    def ok(self) -> bool:
        """Whether the result is complete."""
        return self.complete

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warning of each point, empty if there is none."""
        if "warning" not in self.quantities:
            return ("",) * len(self)
        # None if the point has no result
        return tuple(str(warning or "") for warning in self.values["warning"].tolist())

    def _common_parts(self) -> tuple[str, ...]:
        """Return the parts of the warnings that all computed points have."""
        of_points = [
            warning.split(SEPARATOR)
            for warning, status in zip(self.warnings, self.status)
            if warning or status == COMPLETE
        ]
        if not of_points:
            return ()
        first, *others = of_points
        return tuple(part for part in first if part and all(part in other for other in others))

    def _own_warnings(self) -> list[str]:
        """Return the warning of each point without the parts that all points have."""
        common = self._common_parts()
        own = []
        for warning in self.warnings:
            parts = [part for part in warning.split(SEPARATOR) if part not in common]
            own.append(SEPARATOR.join(parts))
        return own

    def _rows(self) -> list[tuple[str, ...]]:
        """Return the header and rows of the table, with the particular warning of each point.

        Columns with the same reasons are shown once.
        """
        own = dict(zip(self.warnings, self._own_warnings()))
        rows = [tuple(own.get(cell, cell) for cell in row) for row in self.as_rows()]
        columns: list[tuple[str, ...]] = []
        seen = set()
        for head, *cells in zip(*rows):
            # of the search of each point, and of its run
            if head.endswith("reason"):
                if tuple(cells) in seen:
                    continue
                seen.add(tuple(cells))
            columns.append((head, *cells))
        return list(zip(*columns))

    def _remarks(self) -> list[str]:
        """Return the warnings of all and of single points that the first lines do not name."""
        # printed lines are wrapped, so texts are compared without line breaks
        printed = " ".join(self._statement().text.split())
        of_all = SEPARATOR.join(self._common_parts())
        remarks = dict.fromkeys([of_all, *self._own_warnings()])  # each once, in this order
        return [remark for remark in remarks if remark and " ".join(remark.split()) not in printed]

    @property
    def quantities(self) -> tuple[str, ...]:
        """Names of the computed quantities."""
        return names_of(self.values)

    def array(self, quantity: str) -> NDArray:
        """Return a quantity as an array on the grid of settings.

        A point without a value has NaN in an array of numbers, and "" in an array of texts.

        Raises
        ------
        SettingError
            If there is no such quantity, or no point has a result.
        """
        if not self.quantities:
            raise SettingError(self._without_results(quantity))
        validation.choice("quantity", quantity, self.quantities)
        column = self.values[quantity]
        if column.dtype != object:
            return column.astype(float).reshape(self.shape)
        # an object column has texts, lists of numbers, or None at points without a value
        present = [value for value in column if value is not None]
        if not present or not _is_numeric(present[0]):
            texts = ["" if value is None else value for value in column]
            # a value may itself be a list, which np.array would turn into a further dimension
            return np.fromiter(texts, object, len(self)).reshape(self.shape)
        shape_of_value = np.shape(present[0])
        missing = np.full(shape_of_value, np.nan)
        rows = [missing if value is None else np.asarray(value, float) for value in column]
        return np.array(rows).reshape(*self.shape, *shape_of_value)

    def _without_results(self, quantity: str) -> str:
        """Return the error for a quantity if no point has a result, with the first failures."""
        failures = [
            f"{as_words(row_of(self.points, i))}: {self.status_text[i]}"
            for i in range(min(len(self), MOST_FAILURES))
        ]
        if len(self) > MOST_FAILURES:
            failures.append(f"and {len(self) - MOST_FAILURES} more")
        return (
            f"quantity: expected at least one point whose result contains '{quantity}', found "
            f"none ({SEPARATOR.join(failures)}); change the settings that these reasons name, and "
            "compute again"
        )

    def _grid(self) -> dict[str, Any]:
        # a list of points has no grid, and lists and mappings are no coordinates
        if len(self.shape) != len(self.names):
            return {}
        columns = {name: self.points[name].tolist() for name in self.names}
        for value in itertools.chain(*columns.values()):
            if isinstance(value, (list, dict)):
                return {}

        grid = {}
        for (name, column), n in zip(columns.items(), self.shape):
            different = list(dict.fromkeys(column))
            if len(different) != n:
                raise SettingError(
                    f"to_xarray: the values of '{name}' must be distinct, because they become "
                    f"coordinates; found {len(different)} distinct values among {n}; use to_pandas"
                )
            grid[name] = different
        return grid

    def columns(self) -> dict[str, Column]:
        """Return one row for each point with settings, quantities, status and time.

        Lists have a second dimension in xarray.
        """
        columns = {}
        for name in self.names:
            values = self.points[name].tolist()
            shown = [str(value) if isinstance(value, dict) else value for value in values]
            columns[name] = Column(np.array(shown), unit_of(name))
        for name in self.quantities:
            by_point = self.array(name).reshape(len(self), -1)
            # a quantity may have the name of a setting
            key = f"answer_{name}" if name in columns else name
            unit = unit_of(name.removeprefix("curve_"))
            if by_point.shape[1] == 1:
                columns[key] = Column(by_point[:, 0], unit)
            else:
                columns[key] = Column(by_point, unit, ("point", f"{key}_index"))
        columns["run"] = Column(np.array(self.status))
        columns["run_reason"] = Column(np.array(self.reason))
        columns["seconds"] = Column(self.seconds, "s")
        return columns

    def _main_quantity(self) -> str:
        """Return the first quantity with one real number for each point, "" without one."""
        for name in self.quantities:
            column = self.array(name)
            if column.dtype.kind == "f" and column.ndim == len(self.shape):
                return name
        return ""

    def _counts(self, values: NDArray) -> str:
        """Return the number of points as text, and how many of them lack a result or are in doubt.

        ``values`` (n,) is the main quantity, empty without one.
        """
        n_failed = self.status.count(FAILED)
        n_not_run = self.status.count(NOT_RUN)
        n_missing = 0
        n_unbounded = 0
        if len(values):
            n_missing = int(np.count_nonzero(~np.isfinite(values))) - n_failed - n_not_run
            n_unbounded = sum(reason.startswith(UNBOUNDED) for reason in self.reason)
        # the warning of a missing value says why it is missing
        n_warnings = sum(1 for warning in self.warnings if warning)
        counts = {
            UNBOUNDED: n_unbounded,
            "not found": n_missing - n_unbounded,
            "failed": n_failed,
            "not run": n_not_run,
            "with a warning": n_warnings - n_missing,
        }
        settings = ", ".join(spaced(name) for name in self.names)
        parts = [f"{counted(len(self), 'point')} over {settings}"]
        parts += [f"{n} {what}" for what, n in counts.items() if n > 0]
        return ", ".join(parts)

    def _loading_statement(self) -> Statement:
        """Return the statement of a force that increases until the damper slides."""
        table, further = self._few_rows()
        known = np.flatnonzero(np.isfinite(self.array("displacement")))
        last = known[-1]
        force = amount(self.points["force"][last], "N")
        moved = amount(float(self.array("displacement")[last]), "m")
        if FAILED in self.status:
            first = amount(self.points["force"][self.status.index(FAILED)], "N")
            verdict = f"The damper slides at {first}: displacement {moved} at {force}"
        else:
            verdict = f"No sliding up to {force}: displacement {moved}"
        slipping = percent(float(self.array("slipping")[last]))
        rows = [Row("Slipping points", slipping, f"of the closed points, at {force}")]
        return Statement([verdict], rows, remarks=further, table=table)

    def _statement(self) -> Statement:
        if self.names == ("force",) and {"displacement", "slipping"} <= set(self.quantities):
            return self._loading_statement()
        name = self._main_quantity()
        values = self.array(name).ravel() if name else np.empty(0)
        points = self._counts(values)
        table, further = self._few_rows()
        if not np.isfinite(values).any():
            reasons = [warning for warning in self.warnings if warning]
            verdict = f"{points}: {reasons[0]}" if reasons else points
            return Statement([verdict], remarks=further, table=table)

        def value_text(i: int) -> str:
            return amount(values[i], unit_of(name))

        lowest = int(np.nanargmin(values))
        highest = int(np.nanargmax(values))
        n_known = int(np.isfinite(values).sum())
        rounding = 1e-9 * abs(float(values[lowest]))
        if n_known > 1 and values[highest] - values[lowest] <= rounding:
            settings = ", ".join(spaced(setting) for setting in self.names)
            verdict = f"No effect of {settings}: {spaced(name)} {value_text(lowest)} at all points"
            return Statement([verdict], [Row("Sweep", points)], remarks=further, table=table)
        place = as_words(row_of(self.points, lowest))
        verdict = f"Lowest {spaced(name)} {value_text(lowest)}: {place}"
        rows = [Row("Sweep", points)]
        if highest != lowest:
            place = as_words(row_of(self.points, highest))
            rows.insert(0, Row("Highest", value_text(highest), place))
        return Statement(
            [verdict], rows, remarks=[*further, *self._at_ends(lowest, spaced(name))], table=table
        )

    def _few_rows(self) -> tuple[list[tuple[str, ...]], list[str]]:
        """Return the first rows without the residual and without a status that is always complete."""
        rows = self._rows()
        if not rows or rows[0][1:] == EXTREMES:
            return self._first_rows([row for row in rows if row[0] != "residual"])
        columns = [
            column
            for column in zip(*rows)
            if column[0] != "residual" and {*column[1:]} != {COMPLETE}
        ]
        return self._first_rows([*zip(*columns)])

    def _at_ends(self, i: int, quantity: str) -> list[str]:
        """Return a remark for each setting whose value at the point with the lowest ``quantity`` is
        an end of its range.
        """
        remarks = []
        for name in self.names:
            values = self.points[name].tolist()
            numbers = {value for value in values if isinstance(value, float | int)}
            # texts and lists have no order; as text all values can be compared
            only_numbers = len(numbers) >= len(set(map(repr, values)))
            if len(numbers) < 2 or not only_numbers:
                continue
            if values[i] == min(numbers):
                end = "lower"
            elif values[i] == max(numbers):
                end = "upper"
            else:
                continue
            remark = f"The lowest {quantity} is at the {end} end of the {spaced(name)} range"
            # counts begin at 1, other settings at 0
            is_count = isinstance(values[i], int)
            is_natural = end == "lower" and values[i] <= (1 if is_count else 0.0)
            if quantity == "amplitude" and not is_natural:
                value = as_words({name: values[i]}).removeprefix(f"{spaced(name)} ")
                remark += f": include {spaced(name)} values {beyond(end)} {value}"
            remarks.append(remark)
        return remarks


def _is_numeric(value: Any) -> bool:
    """Return whether a value is a number, a truth value or a list of them."""
    return np.asarray(value).dtype.kind in "fiub"


def as_words(point: Mapping[str, Any]) -> str:
    """Return the settings of a point as text with units."""
    words = []
    for name, value in point.items():
        if isinstance(value, float):
            text = amount(value, unit_of(name), 6)
        else:
            text = short_text(value)
        words.append(f"{spaced(name)} {text}")
    return ", ".join(words)


def _named(task: Any) -> str:
    """Return a stable identifier of a callable."""
    if is_dataclass(task) and not isinstance(task, type):
        return repr(task)
    module = getattr(task, "__module__", "")
    # an object with a call method has only the name of its class
    name = getattr(task, "__qualname__", type(task).__qualname__)
    return f"{module}.{name}"


@dataclass(frozen=True)
class _Job:
    """Study and function of all points."""

    study: StudyLike | Problem
    evaluate: Task

    def varied(self, settings: Mapping[str, Any]) -> StudyLike | Problem:
        """Return the study under the settings of a point; the preload is not one of its
        settings."""
        changed = {name: value for name, value in settings.items() if name != "preload"}
        return vary(self.study, changed) if changed else self.study

    def check(self, points: NDArray) -> None:
        """Raise the first error if the settings of no point are valid."""
        first_error: BdamperError | None = None
        for i in range(len(points)):
            try:
                self.varied(row_of(points, i))
                return
            except BdamperError as error:
                first_error = first_error or error
        if first_error is not None:
            raise first_error

    def __call__(self, settings: Mapping[str, Any]) -> Values:
        preload = settings.get("preload")
        if preload is not None:
            preload = float(preload)
        study = self.varied(settings)
        if isinstance(self.evaluate, (PeakTask, OptimalTask)):
            return self.evaluate(study, preload)
        with inside_user_code():
            return self.evaluate(study, preload)


def _points(over: Any, combine: str) -> tuple[tuple[str, ...], NDArray, tuple[int, ...]]:
    """Return names, settings of each point, and shape of the grid."""
    validation.check_value(
        isinstance(over, Mapping) and over, "over", "a mapping of setting to values", over
    )
    names = tuple(over)
    columns: dict[str, Sequence[Any]] = {}
    for name in names:
        values = over[name]
        is_sequence = isinstance(values, (Sequence, np.ndarray))
        if not is_sequence or isinstance(values, (str, bytes)):
            raise SettingError(f"over '{name}': expected a sequence of values, found {values!r}")
        # the JSON of a results file has no numbers of NumPy
        columns[name] = [v.item() if isinstance(v, np.generic) else v for v in values]
        validation.check(columns[name], f"over '{name}'", "at least one value", "none")
    lengths = [len(column) for column in columns.values()]
    if combine == "product":
        combinations = list(itertools.product(*columns.values()))
        columns = dict(zip(names, zip(*combinations)))
        return names, named_fields(columns, len(combinations)), tuple(lengths)
    if combine == "zip":
        validation.check(
            len({*lengths}) == 1,
            'combine="zip"',
            "the same number of values for each setting",
            lengths,
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
    *,
    at_speed: bool,
) -> Task:
    """Return the function to evaluate: ``evaluate``, or the search for the highest peak.

    ``at_speed`` tells whether the study has a rotor speed, from which its preload follows.
    """
    if evaluate is None:
        evaluate = PeakTask(preload, frequency, mode)
    elif preload is not None or frequency is not None or mode != 1:
        raise SettingError("preload, frequency, mode: omit them if evaluate is given")
    task: Task = evaluate
    # a class is callable, but its instances are the tasks
    is_task = callable(task) and not isinstance(task, type)
    expected = "PeakTask(...), OptimalTask(...) or a function"
    validation.check_value(is_task, "evaluate", expected, task)
    has_load = {"preload", "speed"} & {*names} or at_speed
    if isinstance(task, PeakTask) and task.preload is None and not has_load:
        raise SettingError(
            'preload: expected a number, or "preload" among the settings of the sweep, found neither'
        )
    return task


def _check_plausible(
    problem: Problem, evaluate: Task, over: Mapping[str, Any], in_task: bool
) -> None:
    """Warn once about implausible values, unless the sweep varies them.

    ``in_task``: the preload is part of the task; an argument of the sweep has been checked.
    """
    if not isinstance(evaluate, PeakTask | OptimalTask):
        return
    # plausible preloads depend on the excitation
    if any(name.startswith("excitation") for name in over):
        return
    preload_or_preloads = over.get("preload", evaluate.preload)
    if preload_or_preloads is None:
        # the loads at rotor speeds are no choice
        return
    preloads = validation.numbers("preload", np.atleast_1d(preload_or_preloads), unit="N")
    if in_task:
        plausible_ranges.check("sweep", "preload", preloads, problem.sizes)
    check_question(problem, preloads, evaluate.frequency)
    if evaluate.mode > 1:
        # a mode that does not exist is an error before the first point; the status of a point
        # names a preload without a static state
        with suppress(StaticError):
            free_and_stuck(problem.at(float(preloads.max())), evaluate.mode)


def _check_loads(problem: Problem, evaluate: Task, points: NDArray) -> None:
    """Warn once if preloads of a sweep contradict the centrifugal load of the damper.

    The load follows from rotor speed and mass, so only sweeps over one of them are checked.
    """
    if not {"speed", MASS} & {*names_of(points)}:
        return
    preloads_of: dict[tuple[Any, float], list[float]] = {}
    for i in range(len(points)):
        point = row_of(points, i)
        preload = point.get("preload", getattr(evaluate, "preload", None))
        # without one it is the centrifugal load
        if preload is None:
            continue
        speed = point.get("speed", problem.settings.speed)
        mass_factor = point.get(MASS, 1.0)
        preloads_of.setdefault((speed, mass_factor), []).extend(np.ravel(preload))
    for (speed, mass_factor), preloads in preloads_of.items():
        warned = problem.sizes.check_preload(np.array(preloads), speed, mass_factor)
        if warned:
            return


def _lines_over_preload(points: NDArray) -> list[dict[float, int]]:
    """Return the points with equal other settings, as mappings of preload to point."""
    lines: dict[str, dict[float, int]] = {}
    for i in range(len(points)):
        settings = row_of(points, i)
        other_settings = repr({**settings, "preload": None})
        lines.setdefault(other_settings, {})[float(settings["preload"])] = i
    return list(lines.values())


def _with_followed_peaks(job: _Job, task: PeakTask, points: NDArray, records: Records) -> Records:
    """Return the records of a sweep over the preload, without amplitudes below a peak of a lower
    preload.

    The points with equal other settings are compared with each other
    (:mod:`bdamper.response.followed_peak`).
    """
    if "amplitude" not in names_of(records.values):
        return records
    values = records.values.copy()
    status = list(records.status)
    reason = list(records.reason)
    amplitude = values["amplitude"].astype(float)
    for line in _lines_over_preload(points):
        height = {preload: float(amplitude[i]) for preload, i in line.items()}
        any_point = next(iter(line.values()))
        problem = problem_of(job.varied(row_of(points, any_point)))

        def peak_at(preload: float, problem: Problem = problem) -> Peak | None:
            peak = highest_peak(problem, preload, task.frequency, mode=task.mode)
            return peak if peak.ok and not peak.corner else None

        higher_peaks = followed_peaks(problem, height, lambda _: True, peak_at)
        for preload, followed in higher_peaks.items():
            i = line[preload]
            values["amplitude"][i] = np.nan
            values["frequency"][i] = np.nan
            values["lower_bound"][i] = followed.peak.amplitude
            values["warning"][i] = followed.note
            status[i] = INCOMPLETE
            reason[i] = followed.note
    return replace(records, values=values, status=tuple(status), reason=tuple(reason))


def _header(job: _Job, over: Mapping[str, Any], combine: str) -> dict[str, Any]:
    """Return the identification of a sweep in its results file."""
    return {
        "format": "bdamper-sweep-results",
        "version": 5,
        **INSTALLED.attributes(),
        "study": study_fingerprint(problem_of(job.study)),
        "evaluate": _named(job.evaluate),
        "combine": combine,
        "over": {name: list(values) for name, values in over.items()},
    }


@validation.check_arguments
@one_thread
def sweep(
    study: StudyLike | Problem,
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
        ``evaluate(study, preload)`` returns named numbers, texts or lists of numbers; by default
        the highest peak. Process pools need a module-level function, a :class:`PeakTask` or an
        :class:`OptimalTask`.
    combine : {"product", "zip"}
        All combinations of the values, or element-wise combinations.
    preload, frequency, mode
        See :class:`PeakTask`.
    executor : concurrent.futures.Executor, optional
        Threads, processes, ``dask.distributed.Client(...).get_executor()`` or
        ``mpi4py.futures.MPIPoolExecutor``.
    resume : path, optional
        Results file: finished points are appended to it, and an interrupted sweep continues from
        it.
    progress : bool, optional
        Show progress: a bar or, without a terminal, lines of text after ten seconds; on by default.

    Returns
    -------
    SweepResult
        After Ctrl-C or shutdown of the executor, unfinished points have the status "not run".

    Raises
    ------
    BdamperError
        If a setting cannot be varied or a value is invalid (SettingError), or the results file
        belongs to another sweep.
    """
    names, points, shape = _points(over, combine)
    problem = problem_of(study)
    _check_names(problem, over)
    check_executor(executor)
    progress = shows_progress(progress)
    at_speed = problem.settings.speed is not None
    evaluate = _question(evaluate, names, preload, frequency, mode, at_speed=at_speed)
    in_task = preload is None and "preload" not in over and called_by_user()
    _check_plausible(problem, evaluate, over, in_task)
    _check_loads(problem, evaluate, points)
    job = _Job(study, evaluate)
    job.check(points)
    if executor is not None:
        # computed once, before the job is sent to the workers
        _ = problem.stiffness
    results_file: Any = nullcontext()
    if resume is not None:
        results_file = closing(ResultsFile(resume, _header(job, over, combine)))
    with results_file as store:
        settings_at = partial(row_of, points)
        every_point = range(len(points))
        records = run_stored(
            job, settings_at, every_point, executor, store, progress, "sweep", "point"
        )
    if type(evaluate) is PeakTask and "preload" in names:
        with LongWork():
            records = _with_followed_peaks(job, evaluate, points, records)
    return SweepResult(names, points, shape=shape, **vars(records), **problem.recorded())


# ---- Comparison of studies ----


@short_repr
@dataclass(frozen=True)
class Comparison(Result, Plottable, Tabular, Storable, kind="bdamper-comparison"):
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
        if self.curves:
            return dict(zip(self.names, self.curves))
        return dict(zip(self.names, self.optimal))

    @property
    def differences(self) -> dict[str, Differences]:
        """Differences between the first result and each of the others."""
        first, *others = self.results.values()
        return {name: first.diff(other) for name, other in zip(self.names[1:], others)}

    def columns(self) -> dict[str, Column]:
        """Return the points of all curves with the name of their study."""
        results: tuple[ResponseCurve, ...] | tuple[OptimalCurve, ...] = self.curves or self.optimal
        lengths = [len(result) for result in results]
        name = Column(np.repeat(np.array(self.names), lengths))
        return {"name": name, **concatenate(results)}

    def change(self, name: str) -> float:
        """Return the relative change of the amplitude from the first study.

        NaN if an amplitude is unknown.
        """
        amplitude = _outcome(self.results[name]).amplitude
        reference = _outcome(self.results[self.names[0]]).amplitude
        return amplitude / reference - 1.0

    def _known_changes(self) -> dict[str, float]:
        """Return the changes of the other studies, as far as their amplitudes are known."""
        changes = {name: self.change(name) for name in self.names[1:]}
        return {name: change for name, change in changes.items() if np.isfinite(change)}

    def _rows(self) -> list[tuple[str, ...]]:
        since = f"change from '{self.names[0]}'"
        rows: list[tuple[str, ...]] = [
            ("", "amplitude", "frequency", "preload", since, "time", "status")
        ]
        changes = self._known_changes()
        for name, result in self.results.items():
            outcome = _outcome(result)
            row = (
                name,
                amount(outcome.amplitude, "m"),
                amount(outcome.frequency, "Hz"),
                amount(outcome.preload, "N"),
                percent(changes[name], sign=True) if name in changes else "",
                amount(result.cost.seconds, "s"),
                outcome.status,
            )
            rows.append(row)
        return rows

    def _statement(self) -> Statement:
        reference_name = self.names[0]
        reference = _outcome(self.results[reference_name])
        table = self._rows()
        if not np.isfinite(reference.amplitude):
            verdict = f"No peak of '{reference_name}' to compare with: {reference.status}"
            return Statement([verdict], table=table)
        known = {reference_name: 0.0, **self._known_changes()}
        best = min(known, key=lambda name: known[name])
        outcome = _outcome(self.results[best])
        peak = peak_text(outcome.amplitude, outcome.frequency)
        verdict = f"Lowest with '{best}': {peak}, preload {amount(outcome.preload, 'N')}"
        if best != reference_name:
            verdict += f", {percent(-known[best])} lower than with '{reference_name}'"
        doubts = [
            f"Not for design: '{name}': {_outcome(result).status}"
            for name, result in self.results.items()
            if _failed(result)
        ]
        return Statement([*doubts, verdict], table=table)


def _failed(result: ResponseCurve | OptimalCurve) -> list[str]:
    """Return the failures of the checks of an optimal curve."""
    if not isinstance(result, OptimalCurve):
        return []
    return [check.failure for check in checks(result) if check.colour == "red"]


@dataclass(frozen=True)
class _Outcome:
    """Amplitude (m), frequency (Hz) and preload (N) of a result, NaN if unknown, with its
    status."""

    amplitude: float
    frequency: float
    preload: float
    status: str


def _outcome(result: ResponseCurve | OptimalCurve) -> _Outcome:
    """Return the optimum of an optimal curve, or the highest peak of a response curve."""
    if isinstance(result, OptimalCurve):
        optimum = result.optimum
        status = "; ".join(_failed(result)) or optimum.status_text
        return _Outcome(optimum.amplitude, optimum.frequency, optimum.preload, status)
    if not len(result):
        return _Outcome(np.nan, np.nan, result.preload, result.status_text)
    top = result.peak
    if result.peak_at_end:
        status = f"{result.status}, no peak: highest {peak_text(top.amplitude, top.frequency)}"
        return _Outcome(np.nan, np.nan, result.preload, status)
    reason = result.may_be_higher
    if reason:
        bound = f"lower bound {peak_text(top.amplitude, top.frequency)}: {reason}"
        return _Outcome(np.nan, np.nan, result.preload, with_reason(INCOMPLETE, bound))
    return _Outcome(top.amplitude, top.frequency, result.preload, result.status)


def _variants(studies: Mapping[str, Any]) -> list[Any]:
    """Return the studies of a comparison; mappings are settings that differ from the first."""
    expected = "a mapping of one or more names to studies or settings"
    is_mapping = isinstance(studies, Mapping) and len(studies) > 0
    has_names = is_mapping and all(isinstance(key, str) for key in studies)
    validation.check_value(has_names, "studies", expected, studies)
    first = next(iter(studies.values()))
    problem = problem_of(first)
    variants = []
    for name, entry in studies.items():
        settings: Any = validation.instance(
            f"study '{name}'", getattr(entry, "problem", entry), (Problem, Mapping), expected
        )
        if isinstance(settings, Problem):
            variants.append(entry)
        else:
            variants.append(in_type_of(first, vary(problem, settings)))
    return variants


@validation.check_arguments
@one_thread
def compare(
    studies: Mapping[str, StudyLike | Problem | Mapping[str, Any]],
    question: Callable[[Any], ResponseCurve | OptimalCurve],
    *,
    progress: bool | None = None,
) -> Comparison:
    """Evaluate one function for several studies.

    Parameters
    ----------
    studies : mapping of name to study or settings
        The first is a study, the reference. Others may be mappings of settings that differ from it,
        with the names of :func:`bdamper.sweep`: ``{"now": study, "smooth": {"friction_coefficient":
        0.2}}``.
    question : callable
        Function that returns the response curve or optimal curve of a study, for example ``lambda
        study: study.frequency_response(500.0, (280.0, 380.0))``.
    progress : bool, optional
        Show progress: a bar or, without a terminal, lines of text after ten seconds; on by default.

    Returns
    -------
    Comparison
        After Ctrl-C it contains the studies up to the interrupted one.

    Raises
    ------
    SettingError
        If a study or a setting does not fit; raised before any computation.
    """
    variants = _variants(studies)
    validation.check_value(callable(question), "question", "a function of a study", question)
    results: list[ResponseCurve | OptimalCurve] = []
    for study in with_progress(variants, shows_progress(progress), "studies", "study"):
        with inside_user_code():
            answered = question(study)
        result = validation.instance(
            "answer", answered, (ResponseCurve, OptimalCurve), "a ResponseCurve or an OptimalCurve"
        )
        kind = type(results[0]) if results else type(result)
        validation.instance("answer", result, kind, "the same kind of result from every study")
        results.append(result)
        if result.interrupted:
            break
    curves = tuple(result for result in results if isinstance(result, ResponseCurve))
    optimal = tuple(result for result in results if isinstance(result, OptimalCurve))
    return Comparison(tuple(studies)[: len(results)], curves, optimal)
