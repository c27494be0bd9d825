"""Margins against fatigue of solutions: the factor between the vibration and the limit of the material.

A result of many solutions, a curve over frequency or over preload, gets a margin at each of them: the least of all counted
points.
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
from bdamper.harmonic_balance.problem import Problem
from bdamper.harmonic_balance.result_checks import Solutions, SomeResult, solutions_of
from bdamper.util import validation
from bdamper.util.display import Comparable, Plottable, draw
from bdamper.util.errors import COMPLETE, BdamperError, status_word
from bdamper.util.formatting import UNITS, amount, short_repr
from bdamper.util.storage import Recorded, Storable
from bdamper.util.tables import ROW, Column, Hertz, Metres, Newtons, Numbers, Quantity, RadiansPerSecond, Tabular

HIDES = "signed von Mises hides vibration across the mean stress, such as torsion under tension, and jumps with its sign"


@dataclass(frozen=True, kw_only=True)
class Rule(validation.Checked):
    """Criterion for a stress cycle.

    Parameters
    ----------
    criterion : {"von_mises", "signed_von_mises", "principal", "findley"}
    line : {"goodman", "gerber", "soderberg"}
        Not used by "findley", which weighs the mean by itself.
    on : {"amplitude", "both"}
        What grows: the vibration alone, or mean and vibration together.
    """

    criterion: Annotated[str, partial(validation.choice, choices=criteria.CRITERIA)] = "von_mises"
    line: Annotated[str, partial(validation.choice, choices=LINES)] = "goodman"
    on: Annotated[str, partial(validation.choice, choices=ON)] = "amplitude"

    def __str__(self) -> str:
        line = "" if self.criterion == "findley" else f", {self.line.capitalize()}"
        what = "amplitude and mean" if self.on == "both" else "amplitude"
        return f"{self.criterion.replace('_', ' ')}{line}, factor on {what}"

    def judge(self, coefficients: NDArray, material: Material) -> tuple[NDArray, NDArray, NDArray, NDArray]:
        """Amplitude, mean (Pa), factor, and factor of the largest von Mises stress to yield, each (n,), of (n, 6, H + 1).

        With "findley" amplitude and mean are those by von Mises, to be shown.
        """
        by = "von_mises" if self.criterion == "findley" else self.criterion
        amplitude, mean = criteria.amplitude_and_mean(coefficients, by)
        if self.criterion != "findley":
            factor = material.factor(amplitude, mean, self.line, self.on)
        else:
            limit = material.findley_limit
            found = criteria.findley(coefficients, material.findley_k, None if self.on == "both" else limit)
            factor = (limit if self.on == "both" else 1.0) / np.maximum(found, 1e-300)
        largest = np.maximum(criteria.largest_von_mises(coefficients), 1e-300)
        return amplitude, mean, factor, material.yield_strength / largest


@runtime_checkable
class SteadyAmplitude(Protocol):
    """Steady-state amplitude from time integration (:class:`bdamper.response.verification.TimeResponse`)."""

    @property
    def factor(self) -> float: ...
    @property
    def preload(self) -> float: ...
    @property
    def highest(self) -> float: ...
    @property
    def status(self) -> str: ...
    @property
    def text(self) -> str: ...


@short_repr
@dataclass(frozen=True)
class Margins(AtPoints, Plottable, Comparable, Tabular, Recorded, Storable, kind="bdamper-margins", row="location"):
    """Margins of one solution at every point of the stress sets.

    ``plot`` draws the Haigh diagram with the points (:func:`bdamper.plot.plot_haigh`), ``plot_critical`` the critical
    location on the body (:func:`bdamper.plot.plot_critical`).

    Parameters
    ----------
    amplitude, mean : (n,) float, Pa
    factor : (n,) float
        On the vibration, or on vibration and mean, before the material's limit is met; below 1 it is exceeded.
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
        """The counted point of least factor."""
        return int(np.where(self.counted, self.factor, np.inf).argmin())

    @property
    def least(self) -> float:
        """The margin: the least factor of the counted points."""
        return float(self.factor[self.critical])

    @property
    def yields(self) -> bool:
        """Whether some counted point yields in the first cycle."""
        return bool((self.yield_factor < 1.0)[self.counted].any())

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings about the margin."""
        out = list(self.notes)
        i = self.critical
        if self.yields:
            worst = int(np.where(self.counted, self.yield_factor, np.inf).argmin())
            out.append(f"{self.names[worst]} yields in the first cycle: factor {self.yield_factor[worst]:.3g}")
        # difference between elements, over the mean, from which on the stress at a point is told to be uncertain
        large_spread = 0.2
        if self.spread[i] > large_spread:
            apart = f"{100.0 * self.spread[i]:.3g} %"
            out.append(f"elements at {self.names[i]} differ by {apart}: its stress may not have converged with the mesh")
        if not self.counted.all():
            out.append(f"{int((~self.counted).sum())} points on or next to contact faces are left out")
        return tuple(out)

    def plot_critical(self, model: Any) -> Any:
        """Draw the points on the body in 3-D, coloured by their factor (:func:`bdamper.plot.plot_critical`)."""
        return draw(self, "plot_critical", model)

    def _headline(self) -> str:
        i = self.critical
        stress = f"{amount(self.amplitude[i], 'Pa')} about a mean of {amount(self.mean[i], 'Pa')}"
        judged = "the vibration is below the limit" if self.least >= 1.0 else "the limit is exceeded"
        yields = " It yields in the first cycle." if self.yields else ""
        return f"Margin against fatigue {self.least:.3g}: {judged}. Least at {self.names[i]}, {stress}.{yields}"


@short_repr
@dataclass(frozen=True)
class MarginCurve(Plottable, Comparable, Tabular, Recorded, Storable, kind="bdamper-margin-curve"):
    """The margin over frequency, preload, speed or the mass of the damper.

    ``plot`` draws it with the amplitude of the response (:func:`bdamper.plot.plot_margin`).

    Parameters
    ----------
    over, unit : str
        What it is a curve over: "frequency", "preload", "speed", "damper mass" ...
    values : (n,) float
    margin : (n,) float
        Least factor of the counted points; NaN where there is no solution.
    response : (n,) float, m
        Amplitude of the response.
    names : tuple of str
        Of the points of the stress sets.
    critical : (n,) int
        Which of them is the critical one, -1 without a solution.
    amplitude, mean, factor : (n, n_points) float
        Pa, Pa, 1; at all points.
    frequency, preload, speed : (n,) float, Hz, N, rad/s
    material : Material
    rule : Rule
    best_value, best_margin : float
        Of the largest margin: as refined between the values, or the best of them; NaN where it means nothing.
    best_status : str
        How far the best is known.
    in_time : tuple of Margins
        Those of the largest period of the highest blade in time, at the preloads where that is known.
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
    _summary_fields = ("over", "best_value", "unit", "best_margin", "best_status", "rule", "material.name")

    def __len__(self) -> int:
        return len(self.values)

    @property
    def least(self) -> int:
        """Place of the least margin.

        Raises
        ------
        BdamperError
            If no value has one.
        """
        return self._place(np.nanargmin)

    @property
    def greatest(self) -> int:
        """Place of the largest margin; an error as for ``least``."""
        return self._place(np.nanargmax)

    def _place(self, of: Callable[[NDArray], Any]) -> int:
        if np.isnan(self.margin).all():
            raise BdamperError(f"no margin found at any of {len(self)} values of {self.over}")
        return int(of(self.margin))

    @property
    def critical_name(self) -> Annotated[list[str], Quantity(name="critical")]:
        """Name of the critical point at each value, empty without a solution."""
        return [self.names[k] if k >= 0 else "" for k in self.critical]

    def _dimension(self) -> str:
        return self.over.replace(" ", "_")

    def columns(self) -> dict[str, Column]:
        """A row for each value; stresses and factors at all points with the dimension "location"."""
        return {self._dimension(): Column(self.values, self.unit), **super().columns()}

    def _headline(self) -> str:
        if np.isnan(self.margin).all():
            return f"No margin against fatigue was found at any of {len(self)} values of {self.over}."
        i, j = self.least, self.greatest
        value, best = (self.values[j], self.margin[j]) if np.isnan(self.best_value) else (self.best_value, self.best_margin)
        worst = f"{self.margin[i]:.3g} at {amount(self.values[i], self.unit)} ({self.names[self.critical[i]]})"
        head = f"Margin against fatigue over {self.over}: largest {best:.3g} at {amount(value, self.unit)}"
        limit = ["Below 1 the limit is exceeded."] if min([self.margin[i], *(m.least for m in self.in_time)]) < 1.0 else []
        why = ["; ".join(note for note in m.notes if note not in self.notes) for m in self.in_time]
        marched = (f"At {amount(m.preload, 'N')} it is {m.least:.3g} in time, {w}." for m, w in zip(self.in_time, why))
        return " ".join([f"{head}, least {worst}.", *marched, *limit])


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
    """Margins against fatigue, of infinite life.

    Parameters
    ----------
    problem : Problem
    result : Peak, ResponseCurve, OptimalCurve or StressCycle
        Of this problem.
    material : Material
    index : int, optional
        One point of a curve; by default all of them.
    time_response : TimeResponse, optional
        March in time at the preload of the one solution (:meth:`bdamper.Study.time_response`): the vibration is scaled by
        its highest period over the amplitude of the balance, and ``notes`` say so.
    **judged
        ``criterion``, ``line``, ``on``, ``sets`` and ``speed``, as :class:`LeastMargin` has them.

    Returns
    -------
    Margins or MarginCurve
        Of one solution, or of every point of a curve.
    """
    judge = LeastMargin(material, **judged)
    if not isinstance(result, StressCycle) and (hasattr(result, "y") or index is not None or time_response is not None):
        result = over_cycle.stress(problem, result, index, sets=judge.sets, speed=judge.speed)
    return (
        judge.of_cycle(_as_kept(result, time_response)) if isinstance(result, StressCycle) else judge.along(problem, result)
    )


def _as_kept(found: StressCycle, time_response: SteadyAmplitude | None) -> StressCycle:
    """The stress of the largest period of the highest blade in time."""
    if time_response is None:
        return found
    validation.instance("time_response", time_response, SteadyAmplitude)
    if not np.isfinite(time_response.factor) or abs(time_response.preload - found.preload) > 1e-6 * found.preload:
        raise validation.invalid(
            "time_response", f"a march at {found.preload:g} N", f"{time_response.text} at {time_response.preload:g} N"
        )
    coefficients = found.coefficients.copy()
    coefficients[..., 1:] *= time_response.factor
    highest = amount(time_response.highest, "m")
    note = f"vibration scaled by {time_response.factor:.3g}: the highest blade reaches {highest} in time"
    doubt = () if status_word(time_response.status) == COMPLETE else (f"the amplitude in time is {time_response.status}",)
    return replace(found, coefficients=coefficients, notes=(*found.notes, note, *doubt))


@validation.check_arguments
@dataclass(frozen=True)
class LeastMargin(Rule):
    """How a margin is judged, and the question for the least one, as :meth:`bdamper.Study.crossings` takes it.

    A call takes a problem, the unknowns of a solution, its frequency (rad/s) and its preload (N).

    Parameters
    ----------
    material : Material
    criterion : {"von_mises", "signed_von_mises", "principal", "findley"}
        What amplitude and mean are (:mod:`bdamper.fatigue.criteria`).
    line : {"goodman", "gerber", "soderberg"}
        Not used by "findley".
    on : {"amplitude", "both"}
        The factor is on the vibration alone, at the mean stress that the speed gives, or on vibration and mean together.
    sets, speed
        As for :func:`bdamper.fatigue.stress_cycle.stress`.
    """

    material: Annotated[Material, partial(validation.instance, kind=Material)]
    sets: str | Sequence[str] | None = field(default=None, kw_only=True)
    speed: float | None = field(default=None, kw_only=True)

    @property
    def rule(self) -> Rule:
        """Criterion, line, and what the factor is on."""
        return Rule(criterion=self.criterion, line=self.line, on=self.on)

    def __call__(self, problem: Problem, unknowns: NDArray, omega: float, preload: float) -> float:
        return self.margins(problem, np.append(unknowns, omega), preload).least

    def margins(
        self, problem: Problem, y: NDArray, preload: float, time_response: SteadyAmplitude | None = None
    ) -> Margins:
        """At every point of a solution with its frequency (rad/s), of the motion in time where that is given."""
        found = Solutions(y[None, :-1], y[-1:] / (2.0 * np.pi), np.array([preload]))
        cycle = over_cycle.of_solution(problem, found, over_cycle.chosen_sets(problem, self.sets), self.speed)
        return self.of_cycle(_as_kept(cycle, time_response))

    def of_cycle(self, found: StressCycle) -> Margins:
        """The margins of one cycle of stress."""
        amplitude, mean, factor, to_yield = self.judge(found.coefficients, self.material)
        own = {f.name: getattr(found, f.name) for f in fields(AtPoints)} | self._of(found)
        return Margins(amplitude=amplitude, mean=mean, factor=factor, yield_factor=to_yield, **own)

    def _of(self, found: StressCycle) -> dict[str, Any]:
        """What margins take over from a cycle of stress, which needs points that count."""
        validation.check(found.counted.any(), "margin", "points away from contact faces", "none in the stress sets")
        notes = (*found.notes, *([HIDES] if self.criterion == "signed_von_mises" else []))
        own = {"settings": found.settings, "model_hash": found.model_hash}
        return {"material": self.material, "rule": self.rule, "notes": notes, **own}

    def along(self, problem: Problem, curve: Any) -> MarginCurve:
        """The margin at every point of a curve."""
        chosen, found = over_cycle.chosen_sets(problem, self.sets), solutions_of(problem, curve)
        known = np.isfinite(found.unknowns).all(axis=1)
        validation.check(known.any(), "margin", "a curve with solutions", "none")
        solved = Solutions(*(column[known] for column in found))
        first = over_cycle.of_solution(problem, Solutions(*(column[:1] for column in solved)), chosen, self.speed)
        shared = self._of(first)
        coefficients = over_cycle.coefficients_of(problem, solved, chosen, self.speed)
        m, n = coefficients.shape[:2]
        amplitude, mean, factor = np.full((3, len(known), n), np.nan)
        for column, x in zip((amplitude, mean, factor), self.judge(coefficients.reshape(m * n, 6, -1), self.material)):
            column[known] = x.reshape(m, n)
        counted = np.where(first.counted & known[:, None], factor, np.inf)
        critical = np.where(known, counted.argmin(axis=1), -1)
        over = "preload" if np.ndim(curve.preload) else "frequency"
        return MarginCurve(
            over=over, unit=UNITS[over], values=np.asarray(getattr(curve, over), float),
            margin=np.where(known, counted.min(axis=1), np.nan), response=np.asarray(curve.amplitude, float),
            names=first.names, critical=critical, amplitude=amplitude, mean=mean, factor=factor,
            frequency=np.asarray(found.frequency), preload=np.asarray(found.preload),
            speed=over_cycle.speeds(problem, found.frequency, self.speed), **shared,
        )  # fmt: skip
