"""Safety factors against fatigue for solutions and curves.

The margin of a solution is the smallest safety factor of all points of the stress sets that count.
A curve as a function of frequency, preload or speed has a margin at each of its points.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Annotated, Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from bdamper.fatigue import criteria
from bdamper.fatigue import stress_cycle as over_cycle
from bdamper.fatigue.criteria import LINES, ON, Material
from bdamper.fatigue.haigh_table import at_points
from bdamper.fatigue.stress_cycle import AtPoints, StressCycle
from bdamper.harmonic_balance.checks import Solutions, SomeResult, solutions_of
from bdamper.harmonic_balance.problem import Problem
from bdamper.harmonic_balance.subject import about
from bdamper.util import validation
from bdamper.util.display import Plottable, Result, draw
from bdamper.util.errors import COMPLETE, BdamperError
from bdamper.util.formatting import (
    UNITS,
    amount,
    beyond,
    counted,
    percent,
    sentence,
    short_repr,
    spaced,
)
from bdamper.util.records import Data, Reason
from bdamper.util.statement import Row, Statement
from bdamper.util.storage import FilePath, Recorded, Storable
from bdamper.util.tables import (
    ROW,
    Column,
    Hertz,
    Metres,
    Newtons,
    Numbers,
    PerRow,
    Quantity,
    RadiansPerSecond,
    Tabular,
)


@dataclass(frozen=True, kw_only=True)
class Rule(validation.Checked):
    """Failure criterion of a stress cycle.

    Parameters
    ----------
    criterion : {"von_mises", "findley"}
        Definition of the stress amplitude (:mod:`bdamper.fatigue.criteria`).
    line : {"goodman", "gerber", "soderberg", "table"}
        Failure line in the Haigh diagram. "findley" ignores it, because it includes the mean
        stress.
    on : {"amplitude", "both"}
        Quantity that the factor multiplies: the vibration, or mean and vibration.
    """

    criterion: Annotated[str, partial(validation.choice, choices=criteria.CRITERIA)] = "von_mises"
    line: Annotated[str, partial(validation.choice, choices=LINES)] = "goodman"
    on: Annotated[str, partial(validation.choice, choices=ON)] = "amplitude"

    def __str__(self) -> str:
        text = "Findley, "
        if self.criterion != "findley":
            stress = self.criterion.replace("_", " ").replace("mises", "Mises")
            text = f"{self.line.capitalize()}, {stress} amplitude; "
        what = "the amplitude at constant mean stress"
        if self.on == "both":
            what = "amplitude and mean stress together"
        return f"{text}safety factor on {what}"

    def judge(
        self, coefficients: NDArray, material: Material, temperature: NDArray | None = None
    ) -> tuple[NDArray, NDArray, NDArray, NDArray]:
        """Evaluate stress cycles.

        Parameters
        ----------
        coefficients : (n, 6, H + 1) complex, Pa
        material : Material
        temperature : (n,) float, °C, optional

        Returns
        -------
        amplitude, mean : (n,) float, Pa
            Von Mises values for every criterion.
        factor : (n,) float
            Safety factor against fatigue.
        yield_factor : (n,) float
            Ratio of yield strength to the largest von Mises stress.
        """
        amplitude, mean = criteria.amplitude_and_mean(coefficients)
        if self.criterion == "findley":
            factor = self._findley_factor(coefficients, material)
        else:
            factor = material.factor(amplitude, mean, self.line, self.on, temperature)
        largest = np.maximum(criteria.largest_von_mises(coefficients), 1e-300)
        return amplitude, mean, factor, material.yield_strength / largest

    def _findley_factor(self, coefficients: NDArray, material: Material) -> NDArray:
        """Return the safety factors (n,) of stress cycles (n, 6, H + 1) by Findley's criterion.

        They apply to mean and vibration if ``on`` is "both", and to the vibration alone if it is
        "amplitude".
        """
        k = material.findley_k
        limit = material.findley_limit
        smallest = 1e-300  # avoids a division by zero without stress
        if self.on == "both":
            largest_stress = criteria.findley(coefficients, k)  # Pa
            return limit / np.maximum(largest_stress, smallest)
        # with a limit the criterion returns the reciprocal factor instead of a stress
        reciprocal_factor = criteria.findley(coefficients, k, limit=limit)
        return 1.0 / np.maximum(reciprocal_factor, smallest)


@runtime_checkable
class SteadyAmplitude(Protocol):
    """Protocol of results with a steady-state amplitude, such as TimeResponse."""

    @property
    def factor(self) -> float: ...
    @property
    def preload(self) -> float: ...
    @property
    def largest(self) -> float: ...
    @property
    def ok(self) -> bool: ...
    @property
    def status_text(self) -> str: ...
    @property
    def text(self) -> str: ...


@short_repr
@dataclass(frozen=True)
class Margins(
    AtPoints,
    Result,
    Plottable,
    Tabular,
    Recorded,
    Storable,
    kind="bdamper-margins",
    row="location",
):
    """Safety factors of one solution at every point of the stress sets.

    The margin is a reserve factor: 1 is the limit.

    ``plot`` draws the Haigh diagram with the points (:func:`bdamper.plot.plot_haigh`),
    ``plot_critical`` the critical point on the body (:func:`bdamper.plot.plot_critical`).

    Parameters
    ----------
    amplitude, mean : (n,) float, Pa
        Stress amplitude and mean stress.
    factor : (n,) float
        Safety factor on the vibration, or on vibration and mean stress; the limit is exceeded if it
        is below 1.
    yield_factor : (n,) float
        Ratio of yield strength to the largest von Mises stress of the cycle; the point yields in
        the first cycle if it is below 1.
    material : Material
    rule : Rule
    error : float
        Relative error of the response amplitude by harmonics and residual modes, which the stress
        amplitudes share; NaN if unknown.
    settings : mapping
    model_hash : str
    """

    amplitude: Annotated[NDArray, Quantity("Pa", "Stress amplitude")]
    mean: Annotated[NDArray, Quantity("Pa", "Mean stress")]
    factor: Numbers
    yield_factor: Numbers
    material: Material
    rule: Rule
    error: Annotated[float, Data(derived=True)] = float("nan")
    _summary_fields = ("least", "frequency", "preload", "speed", "rule", "material.name")

    @property
    def critical(self) -> int:
        """Index of the point with the smallest safety factor, among the points that count."""
        return int(np.where(self.counted, self.factor, np.inf).argmin())

    def _order(self) -> NDArray:
        """Return the indices of the points by increasing factor, those that do not count last."""
        return np.lexsort((self.factor, ~self.counted))

    @property
    def least(self) -> float:
        """Margin of the solution: the smallest factor of the points that count."""
        return float(self.factor[self.critical])

    @property
    def yields(self) -> bool:
        """Whether any of the points that count yields in the first cycle."""
        return bool((self.yield_factor[self.counted] < 1.0).any())

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings about the margin."""
        if not self.yields:
            return self.notes
        worst = int(np.where(self.counted, self.yield_factor, np.inf).argmin())
        return (
            *self.notes,
            f"{self.names[worst]} yields in the first cycle: factor {self.yield_factor[worst]:.3g}",
        )

    def plot_critical(self, model: Any, path: FilePath | None = None) -> Any:
        """Draw the points on the body in 3-D, coloured by their factor.

        See :func:`bdamper.plot.plot_critical`.
        """
        return draw(self, "figure", "plot_critical", path, model)

    def _statement(self) -> Statement:
        i = self.critical
        in_time = any(note.startswith(over_cycle.SCALED) for note in self.notes)
        margin = f"fatigue safety factor {self.least:.3g} at {self.names[i]}"
        load_check = over_cycle.load_check(self.notes)
        if load_check:
            verdict = over_cycle.OTHER_SPEED
        elif self.least < 1.0 or self.yields:
            verdict = f"Not for design: {margin}"
            if self.yields:
                verdict += f", yield safety factor {self._least_yield_factor:.3g}"
        else:
            verdict = sentence(margin)
        rows = [
            Row("Stress amplitude", amount(self.amplitude[i], "Pa"), f"at {self.names[i]}"),
            Row("Mean stress", amount(self.mean[i], "Pa"), f"at {self.names[i]}"),
            _named("Criterion", str(self.rule)),
            _named("Material", self.material.name),
            *_error_rows(self.error),
        ]
        if load_check:
            name = "Fatigue safety factor"
            rows.insert(0, Row(name, f"{self.least:.3g}", f"at {self.names[i]}"))
        checks = [_fatigue_check(self.least), self._yield_check(), *load_check]
        call = "study.margin(peak, material, time_response=study.time_response(peak))"
        checks.append(_time_check(in_time, call))
        subject = about(self.settings, self.preload, amount(self.frequency, "Hz"))
        table, further = self._first_rows(self._printed_table())
        remarks = [*further, *over_cycle.doubts(self.notes), NOT_COVERED]
        if load_check:
            remarks.append(over_cycle.load_remedy(self.preload, self.centrifugal_load, self.speed))
        elif self.least < 1.0 or self.yields:
            remarks.append(REMEDY)
        return Statement([f"{verdict}{subject}"], rows, checks, remarks, table)

    def _printed_table(self) -> list[tuple[str, ...]]:
        """Return a header, and a row for each point: the lowest fatigue safety factor first."""
        rows: list[tuple[str, ...]] = [
            (
                "Point",
                "x, y, z (mm)",
                "Amplitude",
                "Mean",
                "Fatigue safety",
                "Yield safety",
                "Remark",
            )
        ]
        for i in self._order():
            rows.append(
                (
                    self.names[i],
                    ", ".join(f"{1e3 * x:.1f}" for x in self.points[i]),
                    amount(self.amplitude[i], "Pa"),
                    amount(self.mean[i], "Pa"),
                    f"{self.factor[i]:.3g}",
                    f"{self.yield_factor[i]:.3g}",
                    "" if self.counted[i] else "not used",
                )
            )
        return rows

    @property
    def _least_yield_factor(self) -> float:
        """Smallest yield factor of the points that count."""
        return float(np.where(self.counted, self.yield_factor, np.inf).min())

    def _yield_check(self) -> Row:
        """Return the check of the largest stress of the first cycle."""
        outcome = "FAIL" if self.yields else "pass"
        finding = (
            f"safety factor {self._least_yield_factor:.3g} in the first cycle, at least 1 required"
        )
        return Row("Yield", outcome, finding)


def _error_rows(error: float) -> list[Row]:
    """Return the row with the relative error of the response amplitude; none if it is unknown."""
    if not np.isfinite(error):
        return []
    return [
        Row("Amplitude error", percent(error), "of the response, by harmonics and residual modes")
    ]


def _fatigue_check(margin: float) -> Row:
    """Return the check of the smallest margin."""
    outcome = "pass" if margin >= 1.0 else "FAIL"
    return Row("Fatigue", outcome, f"safety factor {margin:.3g}, at least 1 required")


def _time_check(in_time: bool, call: str) -> Row:
    """Return whether time integration gave the vibration, and otherwise the call for it."""
    if in_time:
        return Row("Time integration", "run", "the vibration has the largest blade amplitude")
    return Row("Time integration", "not run", call)


def _named(name: str, text: str) -> Row:
    """Return the row of a text "first, others": the first part is the value, the others the remark."""
    value, _, remark = text.partition(", ")
    return Row(name, value, remark)


NOT_COVERED = "Not covered: mistuning, wear, other friction coefficients"
"""Effects that a margin does not contain."""
REMEDY = "Remedy: reduce the excitation or the stress, or choose a stronger material"
"""Remark on a failed margin."""


@short_repr
@dataclass(frozen=True)
class MarginCurve(Result, Plottable, Tabular, Recorded, Storable, kind="bdamper-margin-curve"):
    """Margin as a function of frequency, preload, rotor speed or damper mass.

    ``plot`` draws it with the response amplitude (:func:`bdamper.plot.plot_margin`).

    Parameters
    ----------
    over, unit : str
        Name and unit of the abscissa: "frequency", "preload", "speed", "damper mass" ...
    values : (n,) float
        Abscissa.
    margin : (n,) float
        Smallest safety factor of the points that count; NaN without a solution.
    response : (n,) float, m
        Response amplitude.
    names : tuple of str
        Names of the points of the stress sets.
    critical : (n,) int
        Index of the critical point in ``names``; -1 without a solution.
    amplitude, mean, factor : (n, n_points) float
        Stress amplitude (Pa), mean stress (Pa) and safety factor at all points.
    frequency, preload, speed : (n,) float, Hz, N, rad/s
    material : Material
    rule : Rule
    best_value, best_margin : float
        Abscissa and value of the largest margin, refined between the values if possible; NaN if not
        computed.
    best_status, best_reason : str
        Status of the search for the largest margin ("" without a search), and the reason.
    in_time : tuple of Margins
        Margins at the largest blade amplitude from time integration, for each preload that was
        integrated.
    notes : tuple of str
    centrifugal_load : (n,) float, N, or None
        Centrifugal load of the damper at each speed; None in files of earlier versions.
    error : (n,) float, or None
        Relative error of each response amplitude by harmonics and residual modes, which the stress
        amplitudes share; NaN if unknown.  None without estimates.
    settings : mapping
    model_hash : str
    """

    over: str
    unit: str
    values: NDArray
    margin: Annotated[NDArray, Quantity(label="Margin against fatigue")]
    response: Metres
    names: tuple[str, ...]
    critical: NDArray
    amplitude: Annotated[NDArray, Quantity("Pa", name="stress_amplitude", dims=(ROW, "location"))]
    mean: Annotated[NDArray, Quantity("Pa", name="stress_mean", dims=(ROW, "location"))]
    factor: Annotated[NDArray, Quantity(dims=(ROW, "location"))]
    frequency: Hertz
    preload: Newtons
    speed: RadiansPerSecond
    material: Material
    rule: Rule
    best_value: float = float("nan")
    best_margin: float = float("nan")
    best_status: str = ""
    best_reason: Reason = ""
    in_time: tuple[Margins, ...] = ()
    notes: tuple[str, ...] = ()
    centrifugal_load: PerRow | None = None
    error: PerRow | None = None
    _summary_fields = (
        "over",
        "best_value",
        "unit",
        "best_margin",
        "best_status",
        "rule",
        "material.name",
    )

    def __len__(self) -> int:
        return len(self.values)

    @property
    def status(self) -> str:
        """Status of the search for the largest margin; "complete" without a search."""
        return self.best_status or COMPLETE

    @property
    def reason(self) -> str:
        """Reason for the status."""
        return self.best_reason

    @property
    def least(self) -> int:
        """Index of the smallest margin.

        Raises
        ------
        BdamperError
            If there is no margin at any value.
        """
        self._check_margin()
        return int(np.nanargmin(self.margin))

    @property
    def greatest(self) -> int:
        """Index of the largest margin; raises BdamperError as ``least`` does."""
        self._check_margin()
        return int(np.nanargmax(self.margin))

    def _check_margin(self) -> None:
        """Raise BdamperError if there is no margin at any value."""
        if np.isnan(self.margin).all():
            raise BdamperError(f"no margin found at any of {len(self)} values of {self.over}")

    @property
    def critical_name(self) -> Annotated[list[str], Quantity(name="critical")]:
        """Name of the critical point at each value; empty without a solution."""
        return [self.names[k] if k >= 0 else "" for k in self.critical]

    def _dimension(self) -> str:
        return self.over.replace(" ", "_")

    def columns(self) -> dict[str, Column]:
        """Return one row for each value.

        Stresses and factors at all points have the dimension "location".
        """
        return {self._dimension(): Column(self.values, self.unit), **super().columns()}

    def _statement(self) -> Statement:
        if np.isnan(self.margin).all():
            places = f"{len(self)} values of {self.over}"
            return Statement([f"No fatigue safety factor was found at any of {places}"])
        least = self.least
        best_value, best_margin = self.best_value, self.best_margin
        if np.isnan(best_value):
            best_value, best_margin = self.values[self.greatest], self.margin[self.greatest]
        # of preloads and masses one is chosen; the others all occur
        is_chosen = self.over not in ("frequency", "speed")
        value, margin = (self.values[least], self.margin[least])
        if is_chosen:
            value, margin = best_value, best_margin
        point = self.names[self.critical[least]]
        name = "largest" if is_chosen else "smallest"
        text = f"{name} fatigue safety factor {margin:.3g} at {amount(value, self.unit)}"
        if not is_chosen:
            text += f", {point}"
        failed = margin < 1.0 or any(margins.least < 1.0 for margins in self.in_time)
        at_best = f"at {amount(best_value, self.unit)}"
        end = self._end(best_value) if is_chosen else ""
        if end:
            at_best += f", the {end} end of the range"
        at_least = f"at {amount(self.values[least], self.unit)}, {point}"
        rows = [
            Row("Largest safety factor", f"{best_margin:.3g}", at_best),
            Row("Smallest safety factor", f"{self.margin[least]:.3g}", at_least),
            *self._rows_in_time(),
        ]
        rows += _error_rows(self._error_at(value))
        in_time = [margins.least for margins in self.in_time]
        lowest = min([self.margin[least], *in_time])
        load_check = over_cycle.load_check(self.notes)
        # the factor of the verdict
        fatigue = _fatigue_check(min([margin, *in_time]))
        checks = [fatigue._replace(remark=f"{fatigue.remark}; {self._sufficient}"), *load_check]
        checks.append(_time_check(bool(self.in_time), self._call_in_time))
        verdict = f"Not for design: {text}" if failed else sentence(text)
        if is_chosen and margin < 1.0:
            below = f"the fatigue safety factor is below 1 at every {self.over}"
            best = f"the largest is {margin:.3g} at {amount(value, self.unit)}"
            verdict = f"Not for design: {below}; {best}"
        if load_check:
            verdict = over_cycle.OTHER_SPEED
        rows += [_named("Criterion", str(self.rule)), _named("Material", self.material.name)]
        remarks = [*over_cycle.doubts(self.notes), NOT_COVERED]
        if load_check:
            remarks = [*remarks, self._load_remedy(value)]
        elif lowest < 1.0:
            remarks = [*remarks, self._remedy(failed)]
        if end and not load_check:
            values = "preloads" if self.over == "preload" else f"values of {spaced(self.over)}"
            remarks.append(
                f"Include {values} {beyond(end)} {amount(best_value, self.unit)}: the safety factor may "
                "be larger there"
            )
        return Statement([f"{verdict}{about(self.settings)}"], rows, checks, remarks)

    def _end(self, value: float) -> str:
        """Return at which end of the abscissa a value lies: "lower", "upper", or "" inside."""
        if len(self) < 2:
            return ""
        if value == self.values.min():
            return "lower"
        return "upper" if value == self.values.max() else ""

    @property
    def _sufficient(self) -> str:
        """At how many values of the abscissa the safety factor is at least 1, in words."""
        n_sufficient = int(np.count_nonzero(self.margin >= 1.0))
        n_known = int(np.count_nonzero(np.isfinite(self.margin)))
        return f"{n_sufficient} of {counted(n_known, spaced(self.over))} reach it"

    def _error_at(self, value: float) -> float:
        """Return the error of the amplitude at the computed value nearest to a value of the
        abscissa; NaN if unknown.
        """
        if self.error is None:
            return float("nan")
        return float(self.error[np.abs(self.values - value).argmin()])

    @property
    def _call_in_time(self) -> str:
        """Call that computes the margin of a vibration by time integration."""
        if self.over == "preload":
            return "study.margin(study.with_time_response(curve), material)"
        in_time = "time_response=study.time_response(peak)"
        of_peak = f"study.margin(peak, material, {in_time})"
        if self.over == "frequency":
            return of_peak
        return f"study.at_speed(speed), then {of_peak}"

    def _remedy(self, failed: bool) -> str:
        """Return the remedy if a margin is below 1; some values may be sufficient."""
        if failed or self.over in ("frequency", "speed"):
            return REMEDY
        return f"Remedy: choose a {self.over} whose margin is at least 1"

    def _load_remedy(self, value: float) -> str:
        """Return the remedy for preloads that contradict the speed, at a value of the abscissa."""
        i = int(np.nanargmin(np.abs(self.values - value)))
        preload = value if self.over == "preload" else self.preload[i]
        load = 0.0 if self.centrifugal_load is None else self.centrifugal_load[i]
        return over_cycle.load_remedy(preload, load, self.speed[i])

    def _rows_in_time(self) -> list[Row]:
        """Return the margin of each time integration, with the notes that the curve lacks."""
        starts = (over_cycle.SCALED, over_cycle.UNSETTLED, over_cycle.APART)
        rows = []
        for margins in self.in_time:
            notes = [
                note for note in margins.notes if note.startswith(starts) and note not in self.notes
            ]
            place = f"at {amount(margins.preload, 'N')}"
            rows.append(Row("Time integration", f"{margins.least:.3g}", "; ".join([place, *notes])))
        return rows


def margin(
    problem: Problem,
    /,
    result: SomeResult | StressCycle,
    judge: LeastMargin,
    index: int | None = None,
    *,
    time_response: SteadyAmplitude | None = None,
) -> Margins | MarginCurve:
    """See :meth:`bdamper.Study.margin`."""
    error = float("nan")
    if not isinstance(result, StressCycle):
        one_solution = hasattr(result, "y") or index is not None or time_response is not None
        if not one_solution:
            return judge.along(problem, result)
        error = _error_of(result, index, time_response)
        result = over_cycle.stress(problem, result, index, sets=judge.sets, speed=judge.speed)
    margins = judge.of_cycle(_scaled_to_time(result, time_response))
    return replace(margins, error=error)


def _error_of(result: Any, index: int | None, time_response: SteadyAmplitude | None) -> float:
    """Return the relative error of the amplitude of one solution; NaN if unknown."""
    # the amplitude by time integration has no error by harmonics
    if time_response is not None:
        return float("nan")
    error = np.asarray(getattr(result, "error", np.nan), float)
    return float(error if error.ndim == 0 else error[index])


def _scaled_to_time(cycle: StressCycle, time_response: SteadyAmplitude | None) -> StressCycle:
    """Scale the vibration to the largest amplitude from time integration."""
    if time_response is None:
        return cycle
    validation.instance(
        "time_response", time_response, SteadyAmplitude, "a TimeResponse of this study"
    )
    # preloads are printed with three digits
    other_preload = abs(time_response.preload - cycle.preload) > 5e-3 * cycle.preload
    if not np.isfinite(time_response.factor) or other_preload:
        expected = f"a time integration at {cycle.preload:g} N"
        actual = f"{time_response.text} at {time_response.preload:g} N"
        raise validation.invalid("time_response", expected, actual)
    coefficients = cycle.coefficients.copy()
    coefficients[..., 1:] *= time_response.factor
    highest = amount(time_response.largest, "m")
    notes = [
        *cycle.notes,
        f"{over_cycle.SCALED}{time_response.factor:.3g}: "
        f"the largest amplitude by time integration is {highest}",
    ]
    if not time_response.ok:
        notes.append(f"{over_cycle.UNSETTLED}{time_response.status_text}")
    return replace(cycle, coefficients=coefficients, notes=tuple(notes))


LARGE_SPREAD = 0.2
"""Relative difference between elements above which the stress counts as uncertain."""


def _caveats(cycle: StressCycle, factor: NDArray) -> tuple[str, ...]:
    """Return notes about a mesh that is coarse at the critical point, and points left out.

    ``factor`` (n,) are the safety factors of all points of the cycle.
    """
    notes = []
    # the counted point with the smallest factor
    critical = int(np.where(cycle.counted, factor, np.inf).argmin())
    # relative difference between the elements that meet at this point
    spread = cycle.spread[critical]
    if spread > LARGE_SPREAD:
        notes.append(
            f"{over_cycle.APART}{cycle.names[critical]} differ by {100.0 * spread:.3g} %: "
            "its stress may not have converged with the mesh"
        )
    left_out = ~cycle.counted
    if left_out.any():
        points = counted(int(left_out.sum()), "point")
        note = f"omitted: {points} on or next to contact faces"
        n_smaller = int((factor[left_out] < factor[critical]).sum())
        if n_smaller:
            note += f", {n_smaller}{over_cycle.SMALLER}"
        notes.append(note)
    return tuple(notes)


@validation.check_arguments
@dataclass(frozen=True)
class LeastMargin(Rule):
    """Smallest safety factor of all points, for :meth:`bdamper.Study.resonance_crossings`.

    A call with problem, unknowns of a solution, angular frequency (rad/s) and preload (N) returns
    the margin.

    Parameters
    ----------
    material : Material
    criterion : {"von_mises", "findley"}
        Definition of the stress amplitude (:mod:`bdamper.fatigue.criteria`).
    line : {"goodman", "gerber", "soderberg", "table"}
        Failure line in the Haigh diagram; ignored by "findley".
    on : {"amplitude", "both"}
        Quantity that the factor multiplies: the vibration at constant mean stress, or vibration and
        mean.
    sets, speed
        See :func:`bdamper.fatigue.stress_cycle.stress`.
    temperature : float, (n,) float, or mapping of name to float, °C, optional
        Temperature of the points, by point or by set, in °C.
    """

    material: Annotated[Material, partial(validation.instance, kind=Material)]
    sets: str | Sequence[str] | None = field(default=None, kw_only=True)
    speed: float | None = field(default=None, kw_only=True)
    temperature: Any = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        used = self.temperature is None or (self.line == "table" and self.criterion != "findley")
        found = f"criterion '{self.criterion}' and line '{self.line}'"
        expected = (
            "line='table' with criterion='von_mises', because no other criterion or line uses it"
        )
        validation.check(used, "temperature", expected, found)

    @property
    def rule(self) -> Rule:
        """Criterion, failure line and scaled quantity."""
        return Rule(criterion=self.criterion, line=self.line, on=self.on)

    def __call__(self, problem: Problem, unknowns: NDArray, omega: float, preload: float) -> float:
        return self.margins(problem, np.append(unknowns, omega), preload).least

    def margins(
        self,
        problem: Problem,
        y: NDArray,
        preload: float,
        time_response: SteadyAmplitude | None = None,
    ) -> Margins:
        """Return the margins of a solution.

        Parameters
        ----------
        problem : Problem
        y : (n_unknowns + 1,) float
            Unknowns and angular frequency (rad/s).
        preload : float, N
        time_response : TimeResponse, optional
            Time integration to whose largest amplitude the vibration is scaled.
        """
        unknowns = y[:-1]
        omega = y[-1:]
        # a curve of one point
        solution = Solutions(
            unknowns=unknowns[None],
            frequency=omega / (2.0 * np.pi),
            preload=np.array([preload]),
            kind=np.array(["response"]),
        )
        chosen = over_cycle.chosen_sets(problem, self.sets)
        cycle = over_cycle.of_solution(problem, solution, chosen, self.speed)
        return self.of_cycle(_scaled_to_time(cycle, time_response))

    def of_cycle(self, cycle: StressCycle) -> Margins:
        """Return the margins of a stress cycle."""
        _check_counted(cycle)
        temperature = at_points(self.temperature, cycle.names)
        amplitude, mean, factor, yield_factor = self.judge(
            cycle.coefficients, self.material, temperature
        )
        return Margins(
            points=cycle.points,
            names=cycle.names,
            counted=cycle.counted,
            spread=cycle.spread,
            frequency=cycle.frequency,
            preload=cycle.preload,
            speed=cycle.speed,
            centrifugal_load=cycle.centrifugal_load,
            notes=(*cycle.notes, *_degrees(temperature), *_caveats(cycle, factor)),
            amplitude=amplitude,
            mean=mean,
            factor=factor,
            yield_factor=yield_factor,
            material=self.material,
            rule=self.rule,
            settings=cycle.settings,
            model_hash=cycle.model_hash,
        )

    def along(self, problem: Problem, curve: Any) -> MarginCurve:
        """Return the margin at every point of a curve; NaN at points without a solution.

        Raises
        ------
        SettingError
            If no point has a solution, or no point of the stress sets counts.
        """
        chosen = over_cycle.chosen_sets(problem, self.sets)
        solutions = solutions_of(problem, curve)
        has_solution = np.isfinite(solutions.unknowns).all(axis=1)
        validation.check_sentence(has_solution.any(), "margin", "the curve has no solutions")
        solved = over_cycle.selected(solutions, has_solution)
        first_solution = over_cycle.selected(solved, [0])
        first = over_cycle.of_solution(problem, first_solution, chosen, self.speed)
        over_cycle.check_ends(curve)
        _check_counted(first)
        load_notes = over_cycle.check_loads(problem, solved, chosen, self.speed)

        # the cycles of all points of all solutions together
        coefficients = over_cycle.coefficients_of(problem, solved, chosen, self.speed)
        n_solved, n_points = coefficients.shape[:2]
        cycles = coefficients.reshape(n_solved * n_points, 6, -1)
        temperature = at_points(self.temperature, first.names)
        temperature_of_cycles = None
        if temperature is not None:
            temperature_of_cycles = np.tile(temperature, n_solved)
        of_cycles = self.judge(cycles, self.material, temperature_of_cycles)
        # back on the points of the curve (n, n_points), NaN without a solution
        amplitude = np.full((len(has_solution), n_points), np.nan)
        mean = np.full_like(amplitude, np.nan)
        factor = np.full_like(amplitude, np.nan)
        for values, computed in zip((amplitude, mean, factor), of_cycles):
            values[has_solution] = computed.reshape(n_solved, n_points)

        # points that do not count, and solutions that are missing, never have the least factor
        counts = first.counted & has_solution[:, None]
        factor_of_counted = np.where(counts, factor, np.inf)
        least = factor_of_counted.min(axis=1)
        caveats = _caveats(first, factor[least.argmin()])
        over = "preload" if np.ndim(curve.preload) else "frequency"
        rotor_speed = over_cycle.speeds(problem, solutions.frequency, self.speed)
        return MarginCurve(
            over=over,
            unit=UNITS[over],
            values=np.asarray(getattr(curve, over), float),
            margin=np.where(has_solution, least, np.nan),
            response=np.asarray(curve.amplitude, float),
            names=first.names,
            critical=np.where(has_solution, factor_of_counted.argmin(axis=1), -1),
            amplitude=amplitude,
            mean=mean,
            factor=factor,
            frequency=np.asarray(solutions.frequency),
            preload=np.asarray(solutions.preload),
            speed=rotor_speed,
            material=self.material,
            rule=self.rule,
            notes=(*first.notes, *load_notes, *_degrees(temperature), *caveats),
            centrifugal_load=problem.sizes.centrifugal_load(rotor_speed),
            error=_errors_of(curve),
            settings=first.settings,
            model_hash=first.model_hash,
        )


def _errors_of(curve: Any) -> NDArray | None:
    """Return the relative error (n,) of each amplitude of a curve; None without estimates."""
    error = getattr(curve, "error", None)
    if error is None or not np.isfinite(error).any():
        return None
    return np.asarray(error, float)


def _degrees(temperature: NDArray | None) -> tuple[str, ...]:
    """Return a note with the temperatures of the points."""
    if temperature is None:
        return ()
    return (f"allowable amplitudes at {temperature.min():g} to {temperature.max():g} °C",)


def _check_counted(cycle: StressCycle) -> None:
    """Raise SettingError if the stress cycle has no counted point."""
    expected = "points away from contact faces"
    validation.check(cycle.counted.any(), "margin", expected, "none in the stress sets")
