"""Optimal curves under uncertainty, and preloads that are optimal by other measures.

Uncertainty
    Settings are drawn from distributions of :mod:`scipy.stats` (any object with a ``ppf``) by a
    scrambled Sobol sequence, whose averages converge faster than those of independent draws. The
    optimal curve of every draw is one point of a :func:`bdamper.sweep`, with its executors and
    results files. Percentiles over the sample give bands, and the preload at which a percentile of
    the amplitude is lowest. Percentiles are values of draws, without interpolation between draws. A
    draw without a peak counts as infinite, because its amplitude is unknown. Draws with invalid
    settings do not count.

Largest fatigue margin
    A higher preload changes the mode shape, and with it the position of the largest bending stress,
    and increases the mean stress. The preload with the largest margin may therefore differ from the
    preload with the lowest amplitude. The margin at a preload is the margin of the highest point of
    the complete response curve. Its maximum between the preloads of an optimal curve is refined in
    the same way as the lowest amplitude (:mod:`bdamper.response.scalar_search`). The derivatives
    are finite differences of peaks at neighbouring preloads.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Self

import numpy as np
import scipy
from numpy.typing import NDArray

from bdamper.analyses.friction_range import find_range, tolerates_friction
from bdamper.analyses.sweep import OptimalTask, PeakTask, SweepResult, Values, sweep
from bdamper.fatigue.margin import LeastMargin, MarginCurve
from bdamper.harmonic_balance.parameters import present_name, vary
from bdamper.harmonic_balance.problem import Problem
from bdamper.harmonic_balance.study_boundary import StudyLike, problem_of
from bdamper.response import response_curve as tracking
from bdamper.response.followed_peak import (
    Followed,
    followed_peaks,
    with_lower_preloads,
)
from bdamper.response.highest_peak import AtPreload
from bdamper.response.linear_limits import peak_interval
from bdamper.response.optimal_curve import Curves, at_preload, preload_values
from bdamper.response.optimal_curve_result import OptimalCurve
from bdamper.response.peak import Peak, find_peak
from bdamper.response.scalar_search import Sample, find_minimum
from bdamper.response.verification import FRICTION_SPREAD, MUCH, FrictionPeak, FrictionRange
from bdamper.util import validation
from bdamper.util.display import Plottable, Result
from bdamper.util.errors import (
    COMPLETE,
    FAILED,
    FAILURES_AT_ONE_PRELOAD,
    INCOMPLETE,
    INTERRUPTED,
    NOT_FOUND,
    NOT_RUN,
    BdamperError,
    SettingError,
    WithRowStatus,
    all_complete,
    one_line,
)
from bdamper.util.formatting import (
    amount,
    beyond,
    counted,
    ordinal,
    percent,
    short_repr,
    spaced,
)
from bdamper.util.progress import Cost, LongWork, one_thread, progress_stages
from bdamper.util.records import Data
from bdamper.util.statement import Row, Statement
from bdamper.util.storage import FinishedParts, Recorded, Storable
from bdamper.util.tables import ROW, Column, Newtons, Quantity, Tabular
from bdamper.util.workers import on_threads

# ---- Uncertainty ----


def sample(distributions: Mapping[str, Any], n: int, *, seed: int = 0) -> dict[str, NDArray]:
    """Draw settings from independent distributions with a scrambled Sobol sequence.

    Parameters
    ----------
    distributions : mapping of setting to distribution
        Frozen distributions of scipy.stats, for example ``scipy.stats.norm(0.3, 0.03)``. The
        setting "residual_slip_std" takes a number, the standard deviation in m; the offsets at the
        contact points differ from draw to draw.
    n : int
        Number of draws, a power of two.
    seed : int
        Equal seeds give equal draws.

    Returns
    -------
    mapping of setting to (n,) float
    """
    if not isinstance(distributions, Mapping) or not distributions:
        raise SettingError(
            f"distributions: expected a mapping of setting to distribution, found {distributions!r}"
        )
    # the standard deviation of residual slip is a number; all others are distributions
    drawn_settings = {
        name: distribution
        for name, distribution in distributions.items()
        if name != "residual_slip_std"
    }
    for name, distribution in drawn_settings.items():
        if not callable(getattr(distribution, "ppf", None)):
            raise SettingError(
                f"distribution of '{name}': expected one of scipy.stats, found {distribution!r}"
            )
    n = validation.integer("n", n, least=2)
    seed = validation.integer("seed", seed)
    is_power_of_two = n & (n - 1) == 0
    validation.check(is_power_of_two, "n", "a power of two for a Sobol sequence", n)
    residual_slip = {}
    if "residual_slip_std" in distributions:
        std = distributions["residual_slip_std"]
        std = validation.number("residual_slip_std", std, least=0.0, unit="m")
        residual_slip = {
            "residual_slip_std": np.full(n, std),
            "residual_slip_seed": np.arange(n) + float(n * seed),
        }
    n_dimensions = max(len(drawn_settings), 1)
    unit = scipy.stats.qmc.Sobol(n_dimensions, scramble=True, seed=seed).random(n)
    # a ppf may be infinite at 0 and 1
    unit = np.clip(unit, 1e-12, 1.0 - 1e-12)
    values = {
        name: np.asarray(distribution.ppf(unit[:, i]), float)
        for i, (name, distribution) in enumerate(drawn_settings.items())
    }
    return values | residual_slip


def _percentile_of_draws(values: NDArray, q: float | Sequence[float]) -> NDArray:
    """Return percentiles of draws (n, m) at each of m preloads, (m,) or (len(q), m).

    A percentile between two draws is the lower one below 50 %, and the higher one from 50 % on.  A
    band between a low and a high percentile then contains at least its share of the draws.  A draw
    without a value (NaN) counts as infinite.  Without draws the percentiles are NaN.
    """
    if not len(values):
        return np.full((*np.shape(q), values.shape[1]), np.nan)
    ranked = np.sort(np.where(np.isnan(values), np.inf, values), axis=0)
    place = np.asarray(q) / 100.0 * (len(values) - 1)
    rounding = 1e-9  # 7 % of 100 intervals are 7.000000000000001
    lower = np.floor(place + rounding)
    higher = np.ceil(place - rounding)
    outer = np.where(np.asarray(q) < 50.0, lower, higher)
    return np.asarray(ranked[outer.astype(int)])


def _draws_text(percentile: float, n: int) -> str:
    """Return "95 % of 32 draws", or "all 8 draws" if the percentile is the highest of them."""
    draws = counted(n, "draw")
    if _has_enough(percentile, n):
        return f"{percentile:g} % of {draws}"
    return "both draws" if n == 2 else f"all {draws}"


def _has_enough(percentile: float, n: int) -> bool:
    """Return whether there are enough draws for a percentile below the highest of them."""
    return n >= _draws_needed(percentile)


def _unknown_percentile_rows(percentile: float, n: int) -> list[Row]:
    """Return the row of a percentile for which there are too few draws, or none."""
    needed = _draws_needed(percentile)
    if not np.isfinite(needed) or n >= needed:
        return []
    name = f"{ordinal(percentile)} percentile"
    return [Row(name, "not known", f"requires at least {needed:g} draws")]


def _settings_text(names: Iterable[str]) -> str:
    """Return " of the friction coefficient" with the settings that differ between draws, or ""."""
    settings = " and the ".join(map(spaced, names))
    return f" of the {settings}" if settings else ""


def _draws_needed(percentile: float) -> float:
    """Return the smallest number of draws with a percentile below the highest draw.

    It is infinite for 100 %.
    """
    share_above = 1.0 - percentile / 100.0
    if not share_above > 0.0:
        return np.inf
    rounding = 1e-9
    return float(np.ceil(1.0 / share_above + 1.0 - rounding))


def _failed_text(failed: Mapping[int, str], n: int) -> str:
    """Return a text that names the draws that do not count, by index and reason.

    It is empty without such draws.
    """
    if not failed:
        return ""
    verb = "does" if len(failed) == 1 else "do"
    first = min(failed)
    return (
        f"{len(failed)} of {counted(n, 'draw')} failed and {verb} not count; the first is draw "
        f"{first}: {failed[first]}"
    )


def _invalid_draws(
    study: StudyLike | Problem, samples: Mapping[str, Sequence[float] | NDArray]
) -> dict[int, str]:
    """Return the reason for each draw with invalid settings, such as negative friction.

    Raises
    ------
    BdamperError
        If no draw is valid.
    """
    reasons: dict[int, str] = {}
    first_error: BdamperError | None = None
    n = len(next(iter(samples.values())))
    for i in range(n):
        draw = {name: np.asarray(values)[i].item() for name, values in samples.items()}
        try:
            vary(study, draw)
        except BdamperError as error:
            if first_error is None:
                first_error = error
            reasons[i] = one_line(error)
    if first_error is not None and len(reasons) == n:
        raise first_error
    return reasons


def _best_text(preload: float, end: str, at_most: str) -> str:
    """Return the verdict on a best preload (N), which an end of the range does not show."""
    best = amount(preload, "N")
    if not end:
        return f"Best preload {best}: {at_most}"
    return f"Not for design: the best preload, {best}, is at the {end} end of the range"


def _end_remedy(end: str, preload: float) -> str:
    """Return the remark on a best preload (N) at an end of the range."""
    return f"Remedy: include preloads {beyond(end)} {amount(preload, 'N')}"


def _end(preload: float, low: float, high: float) -> str:
    """Return at which end of a range (N) a preload lies: "lower", "upper", or "" inside."""
    if preload == low:
        return "lower"
    return "upper" if preload == high else ""


@short_repr
@dataclass(frozen=True)
class RobustOptimum(Result):
    """Preload at which a percentile of the resonance amplitude over a sample is lowest.

    Parameters
    ----------
    preload : float, N
    amplitude : float, m
        Percentile of the amplitude at this preload. Between two draws, the higher value is used.
        Draws without a peak count as infinite.
    percentile : float
    uncertainty : float
        Relative half-width of the last bracket of the preload.
    kind : {"interior", "end"}
        Whether the preload is inside the range or at one of its ends.
    end : {"", "lower", "upper"}
        End of the range at which the preload lies.
    warnings : int
        Number of peaks in the last grid that are lower bounds.
    status : str
        "complete"; "incomplete" if a preload without a peak in every draw could have a lower
        percentile; "interrupted".
    reason : str
        Reason for the status; after an interruption, the reason why the executor ended.
    draws : int
        Number of draws, without those that failed.
    failed : mapping of int to str
        Draws with invalid settings by index, with the reason.  They do not count.
    varied : tuple of str
        Settings that differ between draws.
    """

    preload: float
    amplitude: float
    percentile: float
    uncertainty: float
    kind: str
    warnings: int = 0
    status: str = COMPLETE
    reason: str = ""
    draws: int = 0
    failed: Mapping[int, str] = field(default_factory=dict)
    end: str = ""
    varied: tuple[str, ...] = ()

    def _statement(self) -> Statement:
        amplitude = amount(self.amplitude, "m")
        at_most = f"at most {amplitude} in {_draws_text(self.percentile, self.draws)}"
        verdict = _best_text(self.preload, self.end, at_most)
        kind = "largest"
        if _has_enough(self.percentile, self.draws):
            kind = f"{ordinal(self.percentile)} percentile"
        draws = f"{counted(self.draws, 'draw')}{_settings_text(self.varied)}"
        rows = [Row("Amplitude", amplitude, f"{kind} of {draws}")]
        rows += _unknown_percentile_rows(self.percentile, self.draws)
        # at an end of the range the best preload is not known
        if not self.end:
            half_width = "half of the last search interval"
            rows.append(
                Row("Uncertainty of the preload", f"± {percent(self.uncertainty)}", half_width)
            )
        remarks = [_failed_text(self.failed, self.draws + len(self.failed))]
        if not self.ok:
            remarks.append(f"The search is {self.status_text}")
        if self.warnings:
            remarks.append(f"{self.warnings} of the last peaks are lower bounds")
        if self.end:
            remarks.append(_end_remedy(self.end, self.preload))
        return Statement([verdict], rows, remarks=[text for text in remarks if text])


@short_repr
@dataclass(frozen=True)
class OptimalCurveUncertainty(
    WithRowStatus,
    Plottable,
    Tabular,
    Recorded,
    Storable,
    kind="bdamper-optimal-curve-uncertainty",
    row="preload",
):
    """Optimal curves of a sample.

    ``plot`` draws percentile bands (:func:`bdamper.plot.plot_optimal_curve_uncertainty`).

    Parameters
    ----------
    preload : (m,) float, N
    amplitude, frequency : (n, m) float
        Values of each draw in m and Hz; NaN without a peak or for draws that were not run.
    samples : mapping of setting to (n,) float
    status : tuple of str
        Status of each draw, as in :class:`bdamper.analyses.sweep.SweepResult`: "failed" if its
        settings are invalid, "not found" if it has no peak at any preload.  Draws that failed or
        were not run do not count in percentiles.
    reason : tuple of str
        Reason for the status of each draw, "" if there is none.
    settings : mapping
        Settings of the problem before the draws change it.
    model_hash : str
    warnings : tuple of str
        Warning of the optimal curve of each draw, empty if there is none.
    """

    preload: Newtons
    amplitude: Annotated[NDArray, Quantity("m", dims=("draw", ROW))]
    frequency: Annotated[NDArray, Quantity("Hz", dims=("draw", ROW))]
    samples: dict[str, NDArray]
    status: tuple[str, ...]
    warnings: tuple[str, ...] = ()
    reason: Annotated[tuple[str, ...], Data(derived=True)] = ()

    def __len__(self) -> int:
        return len(self.amplitude)

    def with_present_names(self) -> Self:
        """Return a result of an earlier version with the present names of settings."""
        return replace(
            self, samples={present_name(name): values for name, values in self.samples.items()}
        )

    def percentile(self, q: float | Sequence[float], quantity: str = "amplitude") -> NDArray:
        """Return percentiles over the sample at every preload, (m,) or (len(q), m).

        A percentile is the value of a draw: of the two adjacent draws the lower one below 50 %, and
        the higher one from 50 % on.  A draw without a peak counts as an infinite amplitude.
        Frequencies are NaN at preloads at which a draw has no peak.

        Parameters
        ----------
        q : float or sequence of float
            Percentiles from 0 to 100.
        quantity : {"amplitude", "frequency"}
        """
        validation.choice("quantity", quantity, ("amplitude", "frequency"))
        validation.numbers("percentile", np.atleast_1d(q), least=0.0, most=100.0)
        values = np.asarray(getattr(self, quantity))
        percentiles = _percentile_of_draws(values[self._counted], q)
        if quantity == "frequency":
            # an unknown frequency has no place among the others, high or low
            all_known = self._has_peak.all(axis=0)
            percentiles[..., ~all_known] = np.nan
        return percentiles

    @property
    def _counted(self) -> NDArray:
        """Whether each draw (n,) counts in percentiles: it was run, and its settings are valid."""
        return np.array([status not in (FAILED, NOT_RUN) for status in self.status], bool)

    @property
    def _has_peak(self) -> NDArray:
        """Whether each draw that counts has a peak at each preload."""
        return np.isfinite(self.amplitude[self._counted])

    @property
    def complete(self) -> bool:
        """Whether every draw has a value at every preload."""
        return all_complete(self.status) and bool(np.isfinite(self.amplitude).all())

    @property
    def ok(self) -> bool:
        """Whether the result is complete."""
        return self.complete

    def columns(self) -> dict[str, Column]:
        """Return percentiles at each preload, and the curves of all draws for xarray."""
        columns = super().columns()
        for name, unit in (("amplitude", "m"), ("frequency", "Hz")):
            for q in (5, 25, 50, 75, 95):
                columns[f"{name}_{q}"] = Column(self.percentile(float(q), name), unit)
        for name, values in self.samples.items():
            columns[f"sample_{name}"] = Column(values, "", ("draw",))
        return columns

    def _statement(self) -> Statement:
        failed = {i: self.reason[i] for i, status in enumerate(self.status) if status == FAILED}
        n_counted = int(self._counted.sum())
        remarks = [_failed_text(failed, len(self))] if failed else []
        if not np.isfinite(self.amplitude).any():
            verdict = f"No peak at any preload of {counted(n_counted, 'draw')}"
            return Statement([verdict], remarks=remarks)
        settings = _settings_text(self.samples)
        draws = _draws_text(95.0, n_counted)
        n_without_peak = int((~self._has_peak).any(axis=1).sum())
        if n_without_peak:
            draws_without = f"{n_without_peak} of {counted(n_counted, 'draw')}"
            remarks.append(
                f"{draws_without} have no peak at some preloads, where their amplitude counts as "
                "infinite"
            )
        median, high = self.percentile([50.0, 95.0])
        upper_name = "95th percentile" if _has_enough(95.0, n_counted) else "Largest"
        table: list[tuple[str, ...]] = [("Preload", "Median", upper_name)]
        for preload, middle, upper in zip(self.preload, median, high):
            cells = [amount(x, "m") if np.isfinite(x) else "no peak" for x in (middle, upper)]
            table.append((amount(preload, "N"), *cells))
        if not np.isfinite(high).any():
            verdict = f"No preload has a peak in {draws}{settings}"
            return Statement([verdict], remarks=remarks, table=table)
        best = int(np.argmin(high))
        at_most = f"at most {amount(high[best], 'm')} in {draws}"
        end = _end(self.preload[best], self.preload[0], self.preload[-1])
        verdict = _best_text(float(self.preload[best]), end, at_most)
        if end:
            remarks.append(_end_remedy(end, self.preload[best]))
        rows = [
            Row(
                "Amplitude",
                amount(high[best], "m"),
                f"{upper_name.lower()} of {counted(n_counted, 'draw')}{settings}",
            ),
            *_unknown_percentile_rows(95.0, n_counted),
        ]
        return Statement([verdict], rows, remarks=remarks, table=table)


@validation.check_arguments
def optimal_curve_uncertainty(
    study: StudyLike | Problem,
    samples: Mapping[str, Sequence[float] | NDArray],
    preload: tuple[float, float] | Sequence[float] | NDArray = (10.0, 25e3),
    n: int = 24,
    *,
    frequency: tuple[float, float] | None = None,
    mode: int = 1,
    executor: Executor | None = None,
    resume: str | Path | None = None,
    progress: bool | None = None,
) -> OptimalCurveUncertainty:
    """Compute the optimal curves of a sample of settings.

    Parameters
    ----------
    study : Study
    samples : mapping of setting to (n_draws,) float
        Sample, for example from :func:`sample`.
    preload, n, frequency, mode
        See :func:`bdamper.response.optimal_curve.optimal_curve`; all draws use the same preloads.
    executor, resume, progress
        See :func:`bdamper.sweep`.

    Returns
    -------
    OptimalCurveUncertainty
    """
    _check_samples(samples)
    values = preload_values(preload, n)
    task = OptimalTask(tuple(float(p) for p in values), len(values), frequency, mode, errors=False)
    curves = sweep(
        study,
        dict(samples),
        task,
        combine="zip",
        executor=executor,
        resume=resume,
        progress=progress,
    )
    if curves.quantities:
        amplitude = curves.array("curve_amplitude")
        curve_frequency = curves.array("curve_frequency")
    else:
        # no draw has a curve
        amplitude = np.full((len(curves), len(values)), np.nan)
        curve_frequency = amplitude
    invalid = _invalid_draws(study, samples)
    # a draw with valid settings whose search ended in an error has no peak
    status = list(curves.status)
    for i, of_draw in enumerate(curves.status):
        if of_draw == FAILED and i not in invalid:
            status[i] = NOT_FOUND
    return OptimalCurveUncertainty(
        preload=values,
        amplitude=amplitude,
        frequency=curve_frequency,
        samples={name: np.asarray(column, float) for name, column in samples.items()},
        status=tuple(status),
        reason=curves.reason,
        settings=curves.settings,
        model_hash=curves.model_hash,
        warnings=curves.warnings,
    )


def _check_samples(samples: Any) -> None:
    """Raise SettingError unless samples are sequences of equal lengths, without the preload."""
    validation.instance(
        "samples", samples, Mapping, "a mapping of settings to numbers, as sample returns it"
    )
    expected = "settings other than the preload"
    valid = samples and "preload" not in samples
    validation.check(valid, "samples", expected, ", ".join(samples) or "none")
    for name, values in samples.items():
        item = f"samples '{name}'"
        try:
            shape = np.shape(values)
        except ValueError:
            # sequences of different lengths have no shape
            shape = ()
        validation.check_value(len(shape) > 0, item, "a sequence of values", values)
        found = f"an array of shape {shape}"
        validation.check(len(shape) == 1, item, "one number for each draw", found)
    lengths = [len(values) for values in samples.values()]
    validation.check(len({*lengths}) == 1, "samples", "equal numbers of values", lengths)


@dataclass(frozen=True)
class SteadyPeak(PeakTask):
    """Evaluation of the highest peak at a preload, as used in the search for an optimum.

    The amplitude is a lower bound if it is not known, zero if nothing was found, and infinite if
    the damper rattles.

    Parameters
    ----------
    lowest : float, N
        Lowest preload of the search.  It has no lower neighbour whose peak could be followed, so
        its own response is computed at lower preloads as well.
    """

    lowest: float = 0.0

    def __call__(self, study: StudyLike | Problem, preload: float | None) -> Values:
        problem = problem_of(study)
        load = float(preload or 0.0)
        search = self.response(problem, load)
        ending = search.ending
        if search.rattles:
            amplitude = np.inf
        else:
            # NaN if nothing was found; it becomes zero, an infinite amplitude remains
            amplitude = float(np.nan_to_num(search.amplitude, posinf=np.inf))
        return {
            "amplitude": amplitude,
            "known": search.known,
            "search_status": ending.status,
            "search_reason": ending.reason,
            "cost": search.cost,
            "height": search.amplitude,
        }

    def response(self, problem: Problem, preload: float) -> AtPreload:
        """Return the response at a preload.

        At the lowest preload, also follow the peaks of still lower preloads.
        """
        interval = peak_interval(problem.at(preload), self.frequency, self.mode)
        response = at_preload(problem, preload, interval)
        if preload == self.lowest:
            return with_lower_preloads(problem, response, interval)
        return response


OTHER_FRICTION = (1.0, 0.7, 1.3)
"""Factors on the friction coefficients in the check of an optimum; typical ones, 0.2 to 0.6, differ
more.
"""
MOST_REMEDIES = 8
"""Largest number of preloads that are tried if the amplitude doubles within the spread of friction
coefficients.
"""


@one_thread
def with_other_friction(
    problem: Problem,
    curve: OptimalCurve,
    progress: bool = False,
    parts: FinishedParts | None = None,
) -> OptimalCurve:
    """Compute the peaks at the recommended preload with lower and higher friction coefficients.

    The result is the optimal curve with these peaks.  The friction coefficients are multiplied by
    the factors :data:`OTHER_FRICTION`.  ``friction_range`` contains the factors on the friction
    coefficients at which the amplitude doubles.  If it doubles within a factor of 1.5,
    ``friction_range.remedy`` is the nearest preload of the curve at which it does not.

    Without an optimum or without friction the curve does not change.  After Ctrl-C the missing
    peaks have the status "interrupted".  ``parts`` contain finished peaks.
    """
    preload = curve.recommended_preload
    if not np.isfinite(preload) or not problem.settings.friction_values():
        return curve
    start = time.perf_counter()
    low, high = curve.settings["frequency"]
    peaks = _FrictionPeaks(problem, (low, high), curve, parts or FinishedParts())
    # every peak counts as interrupted until it is computed
    by_factor = {
        factor: FrictionPeak(factor, preload, amplitude=np.nan, status=INTERRUPTED)
        for factor in OTHER_FRICTION
    }
    nominal = FrictionPeak(factor=1.0, preload=preload, amplitude=np.nan, status=INTERRUPTED)
    friction_range = FrictionRange((nominal,))
    with (
        LongWork() as work,
        progress_stages(progress, "other friction coefficients", "peak") as peaks.report,
    ):
        at_recommended = peaks.at(preload)

        def keep(factor: float) -> None:
            by_factor[factor] = at_recommended(factor)

        on_threads([partial(keep, factor) for factor in OTHER_FRICTION])
        friction_range = find_range(at_recommended)
        limits = friction_range.limits
        if limits is not None and any(limit.near for limit in limits):
            # the nearest preload that tolerates other friction, NaN without one
            remedy = np.nan
            for other in _by_distance(curve, preload):
                if tolerates_friction(peaks.at(other)):
                    remedy = other
                    break
            friction_range = replace(friction_range, remedy=remedy)
    seconds = time.perf_counter() - start
    cost = replace(curve.cost + peaks.cost, seconds=curve.cost.seconds + seconds)
    return replace(
        curve,
        other_friction=tuple(by_factor.values()),
        friction_range=replace(friction_range, seconds=seconds),
        cost=cost,
        # the search for a remedy, which has no status, may have been interrupted
        checks_interrupted=curve.checks_interrupted or work.interrupted,
    )


@dataclass(frozen=True)
class _Evaluated:
    """Peak with other friction, and its cost."""

    peak: FrictionPeak
    cost: Cost = field(default_factory=Cost)


@dataclass
class _FrictionPeaks:
    """Peaks with factors on the friction coefficients, each computed once.

    Parameters
    ----------
    problem : Problem
    frequency : (low, high), Hz
    curve : OptimalCurve
        Curve of the problem, which has peaks with the friction of the study.
    parts : FinishedParts
        Peaks that an earlier run has stored.
    """

    problem: Problem
    frequency: tuple[float, float]
    curve: OptimalCurve
    parts: FinishedParts
    computed: dict[tuple[float, float], _Evaluated] = field(default_factory=dict)
    report: Any = None

    @property
    def cost(self) -> Cost:
        """Cost of all peaks so far."""
        return sum((evaluated.cost for evaluated in self.computed.values()), Cost())

    def at(self, preload: float) -> Callable[[float], FrictionPeak]:
        """Return a function that computes the peak at a preload (N) for a factor on friction."""
        return lambda factor: self._peak(preload, factor)

    def _peak(self, preload: float, factor: float) -> FrictionPeak:
        key = preload, factor
        if key not in self.computed:
            n = len(self.computed)
            self.report(f"{factor:.3g} times, {preload:.4g} N", n, n + 1)
            name = f"peak with {factor!r} times the friction at {preload!r} N"
            compute = partial(self._compute, preload, factor)
            try:
                self.computed[key] = self.parts.once(name, _Evaluated, compute)
            except BdamperError as error:
                failed = FrictionPeak(factor, preload, np.nan, NOT_FOUND, str(error))
                self.computed[key] = _Evaluated(failed)
        return self.computed[key].peak

    def _compute(self, preload: float, factor: float) -> _Evaluated:
        problem = self.problem
        if factor == 1.0:
            own = self.curve.peak_at(preload)
            if own is not None:
                return _Evaluated(FrictionPeak(factor, preload, own.amplitude))
        else:
            problem = vary(problem, {"friction_factor": factor})
        # these preloads have no neighbours, so each counts as the lowest
        evaluate = SteadyPeak(frequency=self.frequency, lowest=preload)
        values = evaluate(problem, preload)
        amplitude = values["amplitude"]
        lower_bound = np.nan
        rattles = amplitude == np.inf
        if not values["known"] and not rattles:
            # an amplitude that is not known is a lower bound; zero says that nothing was found
            if amplitude > 0.0:
                lower_bound = amplitude
            amplitude = np.nan
        peak = FrictionPeak(
            factor,
            preload,
            amplitude,
            values["search_status"],
            values["search_reason"],
            lower_bound,
        )
        return _Evaluated(peak, values["cost"])


def _by_distance(curve: OptimalCurve, preload: float) -> list[float]:
    """Return the preloads (N) of an optimal curve that may tolerate other friction.

    The nearest to a preload comes first.  Friction and preload act nearly as a product: preloads
    are left out if their amplitude doubles at 1/1.5 or 1.5 times the preload.
    """
    amplitudes = {
        p: amplitude
        for p, amplitude in zip(curve.preload.tolist(), curve.amplitude.tolist())
        if np.isfinite(amplitude)
    }
    ascending = sorted(amplitudes)
    log_preloads = np.log(ascending)
    log_amplitudes = np.log([amplitudes[p] for p in ascending])

    def tolerant(p: float) -> bool:
        """Return whether the amplitude does not double with the lowest and highest friction."""
        log_spread = np.log(FRICTION_SPREAD)
        log_ends = np.log(p) + log_spread * np.array([-1.0, 1.0])
        log_at_ends = np.interp(log_ends, log_preloads, log_amplitudes)
        return bool((log_at_ends <= np.log(MUCH * amplitudes[p])).all())

    others = [p for p in amplitudes if not np.isclose(p, preload)]
    others.sort(key=lambda p: abs(np.log(p / preload)))
    return [p for p in others if tolerant(p)][:MOST_REMEDIES]


class _Draws:
    """Highest peaks of all draws at the preloads computed so far.

    Parameters
    ----------
    study : Study or Problem
    samples : mapping of setting to sequence of float
        See :func:`robust_optimum`.
    task : SteadyPeak
        Evaluation of a draw at a preload.
    """

    def __init__(
        self, study: StudyLike | Problem, samples: Mapping[str, Sequence[float]], task: SteadyPeak
    ) -> None:
        self.problem = problem_of(study)
        self.samples = samples
        self.task = task
        self.n = len(next(iter(samples.values())))
        # by preload, an entry per draw: amplitude as SteadyPeak returns it, amplitude of the
        # highest point, and 1 if the amplitude is known
        self.size: dict[float, NDArray] = {}
        self.height: dict[float, NDArray] = {}
        self.known: dict[float, NDArray] = {}
        self.followed: list[dict[float, Followed]] = [{} for _ in range(self.n)]

    def add(self, grid: Sequence[float], results: SweepResult) -> None:
        """Add the results of a sweep over all draws and a grid of preloads (N).

        Failed evaluations give NaN.
        """

        def by_preload(quantity: str) -> dict[float, NDArray]:
            if results.quantities:
                column = results.array(quantity).astype(float)
            else:
                column = np.full(len(results), np.nan)
            # the preload varies fastest
            return dict(zip(grid, column.reshape(-1, len(grid)).T))

        self.size |= by_preload("amplitude")
        self.height |= by_preload("height")
        self.known |= by_preload("known")

    def follow_drops(self) -> None:
        """Follow the peaks of lower preloads where the amplitude of a draw falls."""
        for i in range(self.n):
            self._follow(i, {p: float(height[i]) for p, height in self.height.items()})

    def _follow(self, i: int, heights: Mapping[float, float]) -> None:
        """Follow the peaks of a draw and take their amplitudes, which are lower bounds."""
        settings = {name: values[i] for name, values in self.samples.items()}
        problem = vary(self.problem, settings)

        def peak_at(preload: float) -> Peak | None:
            top = self.task.response(problem, preload).top
            if top is None or top.kind != "peak":
                return None
            return top.peak

        def steady(preload: float) -> bool:
            return bool(self.known[preload][i] == 1.0 and self.size[preload][i] < np.inf)

        self.followed[i] = followed_peaks(problem, heights, steady, peak_at, self.followed[i])
        for preload, followed in self.followed[i].items():
            self.size[preload][i] = followed.peak.amplitude
            self.known[preload][i] = 0.0

    def percentiles(self, percentile: float) -> dict[float, tuple[float, float]]:
        """Return the percentile of the amplitude at each preload, and a lower bound of it.

        Both are equal if every draw has a peak or rattles.  In the percentile a draw without a peak
        counts as infinite; in the lower bound it has the highest amplitude that was found, or zero.
        """
        bounds = {}
        for preload, size in self.size.items():
            upper = np.where(self.known[preload] == 1.0, size, np.inf)
            # NaN becomes zero, an infinite amplitude remains
            lower = np.nan_to_num(size, posinf=np.inf)
            # of both columns (n_draws, 2)
            high, low = _percentile_of_draws(np.column_stack([upper, lower]), percentile).tolist()
            bounds[preload] = high, low
        return bounds

    def unknown(self, preload: float) -> int:
        """Return the number of draws whose amplitude at a preload is not known."""
        return int(np.count_nonzero(self.known[preload] != 1.0))


@validation.check_arguments
def robust_optimum(
    study: StudyLike | Problem,
    samples: Mapping[str, Sequence[float] | NDArray],
    preload: tuple[float, float] = (10.0, 25e3),
    *,
    percentile: float = 95.0,
    n: int = 12,
    tolerance: float = 0.02,
    frequency: tuple[float, float] | None = None,
    mode: int = 1,
    executor: Executor | None = None,
    progress: bool | None = None,
) -> RobustOptimum:
    """Find the preload that minimises a percentile of the resonance amplitude over a sample.

    Percentiles are computed from the highest peaks at each preload of a grid, without interpolation
    in the preload or between draws. The grid is refined around its lowest value until the tolerance
    is met. A draw without a peak, or whose damper rattles, counts as infinite. Draws with invalid
    settings do not count, and the result names them.

    Parameters
    ----------
    study : Study
    samples : mapping of setting to (n_draws,) float
    preload : (low, high), N
    percentile : float
        Percentile from 0 to 100.
    n : int
        Number of preloads in a grid, at least 5.
    tolerance : float
        Relative tolerance of the preload.
    frequency, mode, executor, progress
        See :func:`optimal_curve_uncertainty`.

    Returns
    -------
    RobustOptimum
        After Ctrl-C it describes the last complete grid.

    Raises
    ------
    BdamperError
        If the settings of all draws are invalid, if no preload of the first grid has a finite
        percentile, or if the executor ended during this grid.
    KeyboardInterrupt
        If the first grid was interrupted.
    """
    _check_samples(samples)
    percentile = validation.number("percentile", percentile, least=0.0, most=100.0)
    n = validation.integer("n", n, least=5)
    tolerance = validation.number("tolerance", tolerance, least=1e-9, below=1.0)
    end_values = preload_values(preload, 2)
    low = float(end_values[0])
    high = float(end_values[-1])
    limits = (low, high)
    failed = _invalid_draws(study, samples)
    valid: dict[str, list[float]] = {}
    for name, values in samples.items():
        valid[name] = [value for i, value in enumerate(values) if i not in failed]
    n_draws = len(next(iter(valid.values())))
    optimum: RobustOptimum | None = None
    # percentile of the amplitude and its lower bound at each preload
    bounds: dict[float, tuple[float, float]] = {}
    task = SteadyPeak(frequency=frequency, mode=mode, lowest=low)
    draws = _Draws(study, valid, task)
    while optimum is None or optimum.uncertainty > tolerance:
        grid = [float(p) for p in preload_values((low, high), n) if float(p) not in bounds]
        # all preloads of the first draw, then all preloads of the second ...
        points: dict[str, Any] = {}
        for name, of_draws in valid.items():
            points[name] = [value for value in of_draws for _ in grid]
        points["preload"] = grid * n_draws
        results = sweep(study, points, task, combine="zip", executor=executor, progress=progress)
        if NOT_RUN in results.status:
            reason = results.reason[results.status.index(NOT_RUN)]
            if optimum is not None:
                return replace(optimum, status=INTERRUPTED, reason=reason)
            if reason:
                raise BdamperError(f"robust optimum: {reason}")
            raise KeyboardInterrupt
        draws.add(grid, results)
        draws.follow_drops()
        bounds |= draws.percentiles(percentile)

        preloads = sorted(bounds)
        percentiles = {p: upper for p, (upper, _) in bounds.items()}
        best = min(preloads, key=lambda p: percentiles[p])
        amplitude = percentiles[best]
        if amplitude == np.inf:
            raise BdamperError(
                f"robust optimum: no preload from {low:g} to {high:g} N has a steady peak in "
                f"{_draws_text(percentile, n_draws)}"
            )
        # the next grid lies between the neighbours of the best preload
        i = preloads.index(best)
        low = preloads[max(i - 1, 0)]
        high = preloads[min(i + 1, len(preloads) - 1)]
        # preloads whose percentile is not known (the bounds differ) and may be the least
        n_lower = sum(lower < min(amplitude, upper) for upper, lower in bounds.values())
        reason = ""
        if n_lower:
            preloads_text = counted(n_lower, "preload")
            reason = f"{preloads_text} whose peak was not found in every draw could be lower"
        optimum = RobustOptimum(
            preload=best,
            amplitude=amplitude,
            percentile=float(percentile),
            uncertainty=float(np.log(high / low)) / 2.0,
            kind="end" if best in limits else "interior",
            end=_end(best, *limits),
            warnings=sum(draws.unknown(p) for p in grid),
            status=INCOMPLETE if reason else COMPLETE,
            reason=reason,
            draws=n_draws,
            failed=failed,
            varied=tuple(samples),
        )
    return optimum


# ---- Largest fatigue margin ----


PRELOAD_STEP = 1e-3
"""Relative distance of the preloads for the derivative of a margin; peaks accurate to 1e-8 give an
error of 1e-5.
"""
AGREES = 0.02
"""Relative difference by which the least margin of a response curve may be below the margin of the
highest peak.
"""
WHERE = {
    "end": "at the end of the range of preloads with an amplitude",
    "unknown": "next to preloads without an amplitude",
}
"""Status of the largest margin if it was not refined."""


@one_thread
def best_margin(
    problem: Problem,
    /,
    curve: OptimalCurve,
    judge: LeastMargin,
) -> MarginCurve:
    """See :meth:`bdamper.Study.best_margin`."""
    validation.instance("curve", curve, OptimalCurve)
    result = judge.along(problem, curve)
    low, high = curve.settings["frequency"]
    search = _MarginSearch(problem, judge)

    def ask(places: Sequence[float]) -> list[Sample]:
        """Return samples at ln(preload); a preload without a known peak has an infinite value."""
        tops = curves.follow([float(np.exp(x)) for x in places])
        samples = []
        for x, top in zip(places, tops):
            if top.known and top.top:
                samples.append(search.sample(top.top.peak, top.preload))
            else:
                samples.append(Sample(x, np.inf))
        return samples

    with Curves(problem, (low, high)) as curves:
        samples = []
        for i, preload in enumerate(curve.preload):
            if np.isfinite(curve.amplitude[i]):
                samples.append(search.sample(_peak(problem, curve, i), float(preload)))
            else:
                samples.append(Sample(np.log(float(preload)), np.inf))
        # a minimum between two samples is not refined further: its guess x is returned
        samples, best = find_minimum(samples, ask, lambda a, b, x: x)

        # a time response counts if it belongs to the highest peak
        responses = {
            response.preload: response
            for response in curve.time_response
            if np.isfinite(response.mean)
        }
        confirmed = []
        for preload, response in responses.items():
            for top in curves.follow([preload]):
                if not (top.known and top.top):
                    continue
                peak = top.top.peak
                if np.isclose(peak.amplitude, response.balance, rtol=1e-3, atol=0.0):
                    confirmed.append((peak.y, preload))
    if curves.interrupted:
        i = result.greatest
        return replace(
            result,
            best_value=result.values[i],
            best_margin=result.margin[i],
            best_status=INTERRUPTED,
        )
    least = samples[best.index]
    best_preload = float(np.exp(least.x))
    margin = float(np.exp(-least.value))  # the value is -ln(margin)
    where = WHERE.get(best.kind, "refined between its neighbours")
    doubt = _doubt(problem, curve, judge, best_preload, margin)
    in_time = tuple(judge.margins(problem, y, p, responses[p]) for y, p in confirmed)
    return replace(
        result,
        best_value=best_preload,
        best_margin=margin,
        best_status=INCOMPLETE if doubt else COMPLETE,
        best_reason=f"{where}, {doubt}" if doubt else where,
        in_time=in_time,
    )


@dataclass(frozen=True)
class _MarginSearch:
    """Margins of peaks, as functions of the preload whose minimum is sought."""

    problem: Problem
    judge: LeastMargin

    def sample(self, peak: Peak, preload: float) -> Sample:
        """Return ln(preload), -ln(margin) and its derivative.

        The derivative is NaN if a neighbouring peak was not found.
        """
        below = preload * (1.0 - PRELOAD_STEP)
        above = preload * (1.0 + PRELOAD_STEP)
        height_below = self._height_near(peak, below)
        height_above = self._height_near(peak, above)
        slope = (height_above - height_below) / float(np.log(above / below))
        return Sample(float(np.log(preload)), self._height(peak, preload), slope)

    def _height_near(self, peak: Peak, preload: float) -> float:
        """Return -ln(margin) of the same peak at another preload; NaN if it was not found."""
        shape: dict[str, Any] = {}
        if not peak.corner:
            shape = {"tangent": peak.tangent, "scale": peak.scale}
        try:
            system = self.problem.system(preload)
            neighbour = find_peak(system, peak.y, parameter=preload, **shape)
        except FAILURES_AT_ONE_PRELOAD:
            return np.nan
        if not neighbour.ok:
            return np.nan
        return self._height(neighbour, preload)

    def _height(self, peak: Peak, preload: float) -> float:
        """Return -ln(margin) of a peak; infinite for a margin of zero."""
        unknowns = peak.y[:-1]
        omega = float(peak.y[-1])
        margin = self.judge(self.problem, unknowns, omega, preload)
        return float(-np.log(margin)) if margin > 0.0 else np.inf


def _peak(problem: Problem, curve: OptimalCurve, i: int) -> Peak:
    """Return a point of an optimal curve as a peak, with its tangent if it has one."""
    preload = float(curve.preload[i])
    y = np.append(curve.unknowns[i], 2.0 * np.pi * curve.frequency[i])
    return find_peak(problem.system(preload), y, parameter=preload)


def _doubt(
    problem: Problem, curve: OptimalCurve, judge: LeastMargin, preload: float, value: float
) -> str:
    """Return the contradiction between the complete response curve at a preload and the margin.

    Empty if they agree.
    """
    low, high = curve.settings["frequency"]
    whole = tracking.frequency_response(problem, preload, (low, high))
    if not whole.complete:
        return f"the response curve there is {whole.status}"
    try:
        margins = judge.along(problem, whole)
    except SettingError as error:
        return str(error)
    least = float(margins.margin[margins.least])
    frequency = amount(float(whole.frequency[margins.least]), "Hz")
    if least < (1.0 - AGREES) * value:
        return f"on the response curve there the margin is {least:.4g} at {frequency}"
    return ""
