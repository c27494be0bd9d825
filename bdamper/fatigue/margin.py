"""Safety factors against fatigue of solutions and curves.

The margin of a solution is the least safety factor of all counted points of the stress sets. A curve over frequency,
preload or speed has a margin at every point.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import partial
from typing import Annotated, Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from bdamper.fatigue import criteria
from bdamper.fatigue import stress_cycle as over_cycle
from bdamper.fatigue.criteria import LINES, ON, Material
from bdamper.fatigue.stress_cycle import AtPoints, StressCycle
from bdamper.harmonic_balance.checks import Solutions, SomeResult, solutions_of
from bdamper.harmonic_balance.problem import Problem
from bdamper.util import validation
from bdamper.util.display import Comparable, Plottable, draw
from bdamper.util.errors import COMPLETE, BdamperError, status_word
from bdamper.util.formatting import UNITS, amount, counted, short_repr
from bdamper.util.storage import FilePath, Recorded, Storable
from bdamper.util.tables import (
    ROW,
    Column,
    Hertz,
    Metres,
    Newtons,
    Numbers,
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
    line : {"goodman", "gerber", "soderberg"}
        Failure line in the Haigh diagram. "findley" ignores it, since it includes the mean stress.
    on : {"amplitude", "both"}
        Quantity that the factor multiplies: the vibration, or mean and vibration.
    """

    criterion: Annotated[str, partial(validation.choice, choices=criteria.CRITERIA)] = "von_mises"
    line: Annotated[str, partial(validation.choice, choices=LINES)] = "goodman"
    on: Annotated[str, partial(validation.choice, choices=ON)] = "amplitude"

    def __str__(self) -> str:
        line = "" if self.criterion == "findley" else f", {self.line.capitalize()}"
        what = "amplitude and mean" if self.on == "both" else "amplitude"
        return f"{self.criterion.replace('_', ' ')}{line}, factor on {what}"

    def judge(
        self, coefficients: NDArray, material: Material
    ) -> tuple[NDArray, NDArray, NDArray, NDArray]:
        """Evaluate stress cycles.

        Parameters
        ----------
        coefficients : (n, 6, H + 1) complex, Pa
        material : Material

        Returns
        -------
        amplitude, mean : (n,) float, Pa
            Von Mises values for every criterion.
        factor : (n,) float
            Safety factor against fatigue.
        yield_factor : (n,) float
            Yield strength over the largest von Mises stress.
        """
        amplitude, mean = criteria.amplitude_and_mean(coefficients)
        if self.criterion != "findley":
            factor = material.factor(amplitude, mean, self.line, self.on)
        else:
            limit = material.findley_limit
            value = criteria.findley(
                coefficients, material.findley_k, None if self.on == "both" else limit
            )
            factor = (limit if self.on == "both" else 1.0) / np.maximum(value, 1e-300)
        largest = np.maximum(criteria.largest_von_mises(coefficients), 1e-300)
        return amplitude, mean, factor, material.yield_strength / largest


@runtime_checkable
class SteadyAmplitude(Protocol):
    """Steady-state amplitude from time integration (``bdamper.response.verification.TimeResponse``)."""

    @property
    def factor(self) -> float: ...
    @property
    def preload(self) -> float: ...
    @property
    def largest(self) -> float: ...
    @property
    def status(self) -> str: ...
    @property
    def text(self) -> str: ...


@short_repr
@dataclass(frozen=True)
class Margins(
    AtPoints,
    Plottable,
    Comparable,
    Tabular,
    Recorded,
    Storable,
    kind="bdamper-margins",
    row="location",
):
    """Safety factors of one solution at every point of the stress sets.

    ``plot`` draws the Haigh diagram with the points (:func:`bdamper.plot.plot_haigh`), ``plot_critical`` the critical point
    on the body (:func:`bdamper.plot.plot_critical`).

    Parameters
    ----------
    amplitude, mean : (n,) float, Pa
        Stress amplitude and mean stress.
    factor : (n,) float
        Safety factor on the vibration, or on vibration and mean; below 1 the limit is exceeded.
    yield_factor : (n,) float
        Yield strength over the largest von Mises stress of the cycle; below 1 the first cycle yields.
    material : Material
    rule : Rule
    settings : mapping
    model_hash : str
    """

    amplitude: Annotated[NDArray, Quantity("Pa", "Stress amplitude")]
    mean: Annotated[NDArray, Quantity("Pa", "Mean stress")]
    factor: Numbers
    yield_factor: Numbers
    material: Material
    rule: Rule
    _summary_fields = ("least", "frequency", "preload", "speed", "rule", "material.name")

    @property
    def critical(self) -> int:
        """Index of the counted point with the least factor."""
        return int(np.where(self.counted, self.factor, np.inf).argmin())

    def _order(self) -> NDArray:
        return np.lexsort((self.factor, ~self.counted))

    @property
    def least(self) -> float:
        """Margin of the solution: the least factor of the counted points."""
        return float(self.factor[self.critical])

    @property
    def yields(self) -> bool:
        """Whether a counted point yields in the first cycle."""
        return bool((self.yield_factor < 1.0)[self.counted].any())

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
        """Draw the points on the body in 3-D, coloured by their factor (:func:`bdamper.plot.plot_critical`)."""
        return draw(self, "figure", "plot_critical", path, model)

    def _headline(self) -> str:
        i = self.critical
        stress = f"{amount(self.amplitude[i], 'Pa')} about a mean of {amount(self.mean[i], 'Pa')}"
        judged = (
            "the vibration is below the limit" if self.least >= 1.0 else "the limit is exceeded"
        )
        yields = " It yields in the first cycle." if self.yields else ""
        least = f"Least at {self.names[i]}, {stress}."
        scaled = any(note.startswith(over_cycle.SCALED) for note in self.notes)
        how = "" if scaled else " by harmonic balance alone"
        return f"Margin against fatigue {self.least:.3g}{how}: {judged}. {least}{yields}{over_cycle.doubts(self.notes)}"


@short_repr
@dataclass(frozen=True)
class MarginCurve(Plottable, Comparable, Tabular, Recorded, Storable, kind="bdamper-margin-curve"):
    """Margin over frequency, preload, rotor speed or damper mass.

    ``plot`` draws it with the response amplitude (:func:`bdamper.plot.plot_margin`).

    Parameters
    ----------
    over, unit : str
        Name and unit of the abscissa: "frequency", "preload", "speed", "damper mass" ...
    values : (n,) float
        Abscissa.
    margin : (n,) float
        Least factor of the counted points; NaN without a solution.
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
        Abscissa and value of the largest margin, refined between the values if possible; NaN if not computed.
    best_status : str
        Accuracy of the largest margin.
    in_time : tuple of Margins
        Margins at the largest blade amplitude in time integration, at the preloads with a time integration.
    notes : tuple of str
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
    in_time: tuple[Margins, ...] = ()
    notes: tuple[str, ...] = ()
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
    def least(self) -> int:
        """Index of the least margin.

        Raises
        ------
        BdamperError
            If there is no margin at any value.
        """
        return self._place(np.nanargmin)

    @property
    def greatest(self) -> int:
        """Index of the largest margin; raises BdamperError as ``least`` does."""
        return self._place(np.nanargmax)

    def _place(self, of: Callable[[NDArray], Any]) -> int:
        if np.isnan(self.margin).all():
            raise BdamperError(f"no margin found at any of {len(self)} values of {self.over}")
        return int(of(self.margin))

    @property
    def critical_name(self) -> Annotated[list[str], Quantity(name="critical")]:
        """Name of the critical point at each value; empty without a solution."""
        return [self.names[k] if k >= 0 else "" for k in self.critical]

    def _dimension(self) -> str:
        return self.over.replace(" ", "_")

    def columns(self) -> dict[str, Column]:
        """Return one row for each value; stresses and factors at all points have the dimension "location"."""
        return {self._dimension(): Column(self.values, self.unit), **super().columns()}

    def _headline(self) -> str:
        if np.isnan(self.margin).all():
            return (
                f"No margin against fatigue was found at any of {len(self)} values of {self.over}."
            )
        i, j = self.least, self.greatest
        value, best = (
            (self.values[j], self.margin[j])
            if np.isnan(self.best_value)
            else (self.best_value, self.best_margin)
        )
        worst = f"{self.margin[i]:.3g} at {amount(self.values[i], self.unit)} ({self.names[self.critical[i]]})"
        how = "" if self.in_time else " by harmonic balance alone"
        head = f"Margin against fatigue over {self.over}{how}: largest {best:.3g} at {amount(value, self.unit)}"
        limit = (
            ["Below 1 the limit is exceeded."]
            if min([self.margin[i], *(m.least for m in self.in_time)]) < 1.0
            else []
        )
        own = (over_cycle.SCALED, over_cycle.UNSETTLED, over_cycle.APART)
        why = [
            "; ".join(x for x in m.notes if x.startswith(own) and x not in self.notes)
            for m in self.in_time
        ]
        in_time = (
            f"At {amount(m.preload, 'N')} it is {m.least:.3g} in time, {w}."
            for m, w in zip(self.in_time, why)
        )
        return " ".join([f"{head}, least {worst}.", *in_time, *limit]) + over_cycle.doubts(
            self.notes
        )


def margin(
    problem: Problem,
    /,
    result: SomeResult | StressCycle,
    material: Material,
    index: int | None = None,
    *,
    time_response: SteadyAmplitude | None = None,
    **judged: Any,
) -> Margins | MarginCurve:
    """Compute safety factors against fatigue for infinite life.

    Parameters
    ----------
    problem : Problem
    result : Peak, ResponseCurve, OptimalCurve or StressCycle
        Result of this problem.
    material : Material
    index : int, optional
        Index of a point of a curve; all points by default.
    time_response : TimeResponse, optional
        Time integration at the preload of the solution (:meth:`bdamper.Study.time_response`). The vibration is multiplied
        by the ratio of the largest amplitude in time to the amplitude of the harmonic balance; ``notes`` contain this
        ratio.
    **judged
        ``criterion``, ``line``, ``on``, ``sets`` and ``speed``, see :class:`LeastMargin`.

    Returns
    -------
    Margins or MarginCurve
        Margins of one solution, or the margin at every point of a curve.

    Raises
    ------
    SettingError
        If the model has no stress sets, or if a setting or the result does not fit.
    """
    judge = LeastMargin(material, **judged)
    if not isinstance(result, StressCycle) and (
        hasattr(result, "y") or index is not None or time_response is not None
    ):
        result = over_cycle.stress(problem, result, index, sets=judge.sets, speed=judge.speed)
    if isinstance(result, StressCycle):
        return judge.of_cycle(_scaled_to_time(result, time_response))
    return judge.along(problem, result)


def _scaled_to_time(cycle: StressCycle, time_response: SteadyAmplitude | None) -> StressCycle:
    """Scale the vibration to the largest amplitude in time integration."""
    if time_response is None:
        return cycle
    validation.instance(
        "time_response", time_response, SteadyAmplitude, "a TimeResponse of this study"
    )
    # preloads are printed with three digits
    if (
        not np.isfinite(time_response.factor)
        or abs(time_response.preload - cycle.preload) > 5e-3 * cycle.preload
    ):
        expected = f"a time integration at {cycle.preload:g} N"
        raise validation.invalid(
            "time_response", expected, f"{time_response.text} at {time_response.preload:g} N"
        )
    coefficients = cycle.coefficients.copy()
    coefficients[..., 1:] *= time_response.factor
    highest = amount(time_response.largest, "m")
    note = f"{over_cycle.SCALED}{time_response.factor:.3g}: the highest blade reaches {highest} in time"
    settled = status_word(time_response.status) == COMPLETE
    doubt = () if settled else (f"{over_cycle.UNSETTLED}{time_response.status}",)
    return replace(cycle, coefficients=coefficients, notes=(*cycle.notes, note, *doubt))


def _caveats(cycle: StressCycle, factor: NDArray) -> tuple[str, ...]:
    """Return as notes a large difference of the elements at the critical point, and the points that are left out."""
    i, out = int(np.where(cycle.counted, factor, np.inf).argmin()), []
    large_spread = (
        0.2  # relative difference between elements above which the stress counts as uncertain
    )
    if cycle.spread[i] > large_spread:
        apart = f"{100.0 * cycle.spread[i]:.3g} %"
        out.append(
            f"{over_cycle.APART}{cycle.names[i]} differ by {apart}: its stress may not have converged with the mesh"
        )
    if not cycle.counted.all():
        smaller = int((factor < factor[i])[~cycle.counted].sum())
        which = f", {smaller}{over_cycle.SMALLER}" if smaller else ""
        out.append(
            f"left out: {counted(int((~cycle.counted).sum()), 'point')} on or next to contact faces{which}"
        )
    return tuple(out)


@validation.check_arguments
@dataclass(frozen=True)
class LeastMargin(Rule):
    """Failure criterion with material, stress sets and speed; a quantity for :meth:`bdamper.Study.resonance_crossings`.

    A call with problem, unknowns of a solution, angular frequency (rad/s) and preload (N) returns the margin.

    Parameters
    ----------
    material : Material
    criterion : {"von_mises", "findley"}
        Definition of the stress amplitude (:mod:`bdamper.fatigue.criteria`).
    line : {"goodman", "gerber", "soderberg"}
        Failure line in the Haigh diagram; ignored by "findley".
    on : {"amplitude", "both"}
        Quantity that the factor multiplies: the vibration at constant mean stress, or vibration and mean.
    sets, speed
        See :func:`bdamper.fatigue.stress_cycle.stress`.
    """

    material: Annotated[Material, partial(validation.instance, kind=Material)]
    sets: str | Sequence[str] | None = field(default=None, kw_only=True)
    speed: float | None = field(default=None, kw_only=True)

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
        solution = Solutions(
            y[None, :-1], y[-1:] / (2.0 * np.pi), np.array([preload]), np.array(["response"])
        )
        cycle = over_cycle.of_solution(
            problem, solution, over_cycle.chosen_sets(problem, self.sets), self.speed
        )
        return self.of_cycle(_scaled_to_time(cycle, time_response))

    def of_cycle(self, cycle: StressCycle) -> Margins:
        """Return the margins of a stress cycle."""
        amplitude, mean, factor, to_yield = self.judge(cycle.coefficients, self.material)
        copied = {f.name: getattr(cycle, f.name) for f in fields(AtPoints)} | self._of(cycle)
        copied["notes"] += _caveats(cycle, factor)
        return Margins(
            amplitude=amplitude, mean=mean, factor=factor, yield_factor=to_yield, **copied
        )

    def _of(self, cycle: StressCycle) -> dict[str, Any]:
        """Return the fields that margins copy from a stress cycle.

        Raises
        ------
        SettingError
            If the stress cycle has no counted point.
        """
        validation.check(
            cycle.counted.any(),
            "margin",
            "points away from contact faces",
            "none in the stress sets",
        )
        origin = {"settings": cycle.settings, "model_hash": cycle.model_hash}
        return {"material": self.material, "rule": self.rule, "notes": cycle.notes, **origin}

    def along(self, problem: Problem, curve: Any) -> MarginCurve:
        """Return the margin at every point of a curve."""
        chosen, solutions = over_cycle.chosen_sets(problem, self.sets), solutions_of(problem, curve)
        known = np.isfinite(solutions.unknowns).all(axis=1)
        validation.check(known.any(), "margin", "a curve with solutions", "none")
        solved = Solutions(*(column[known] for column in solutions))
        first = over_cycle.of_solution(
            problem, Solutions(*(column[:1] for column in solved)), chosen, self.speed
        )
        over_cycle.check_ends(curve)
        shared = self._of(first)
        shared["notes"] += over_cycle.check_loads(problem, solved, chosen, self.speed)
        coefficients = over_cycle.coefficients_of(problem, solved, chosen, self.speed)
        m, n = coefficients.shape[:2]
        amplitude, mean, factor = np.full((3, len(known), n), np.nan)
        for column, x in zip(
            (amplitude, mean, factor), self.judge(coefficients.reshape(m * n, 6, -1), self.material)
        ):
            column[known] = x.reshape(m, n)
        counted = np.where(first.counted & known[:, None], factor, np.inf)
        critical = np.where(known, counted.argmin(axis=1), -1)
        shared["notes"] += _caveats(first, factor[counted.min(axis=1).argmin()])
        over = "preload" if np.ndim(curve.preload) else "frequency"
        return MarginCurve(
            over=over, unit=UNITS[over], values=np.asarray(getattr(curve, over), float),
            margin=np.where(known, counted.min(axis=1), np.nan), response=np.asarray(curve.amplitude, float),
            names=first.names, critical=critical, amplitude=amplitude, mean=mean, factor=factor,
            frequency=np.asarray(solutions.frequency), preload=np.asarray(solutions.preload),
            speed=over_cycle.speeds(problem, solutions.frequency, self.speed), **shared,
        )  # fmt: skip
