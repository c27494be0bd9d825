"""Optimal curves under uncertainty, and preloads that are optimal by other measures than the amplitude of one study.

Uncertainty
    Settings are drawn from distributions of :mod:`scipy.stats` (any object with a ``ppf``) by a scrambled Sobol sequence,
    whose averages converge faster than those of independent draws. The optimal curve of every draw is one point of a
    :func:`bdamper.sweep`, with its executors and results files. Percentiles over the sample give bands, and the preload at
    which a percentile of the amplitude is least.

Largest fatigue margin
    A higher preload changes position and shape of the bending and increases the mean stress. The preload with the largest
    margin may therefore differ from the preload with the least amplitude. The margin at a preload is the margin of the
    highest point of the complete response curve. Its maximum between the preloads of an optimal curve is refined in the
    same way as the least amplitude (:mod:`bdamper.response.scalar_search`). The derivatives are finite differences of
    peaks at neighbouring preloads.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import scipy
from numpy.typing import NDArray

from bdamper.analyses.sweep import OptimalTask, PeakTask, SweepResult, Values, sweep
from bdamper.fatigue.criteria import Material
from bdamper.fatigue.margin import LeastMargin, MarginCurve
from bdamper.harmonic_balance.checks import Asking, problem_of
from bdamper.harmonic_balance.parameters import vary
from bdamper.harmonic_balance.problem import Problem
from bdamper.response import response_curve as tracking
from bdamper.response.linear_limits import peak_interval
from bdamper.response.optimal_curve import Curves, at_preload, preload_values
from bdamper.response.optimal_curve_result import OptimalCurve
from bdamper.response.peak import Peak, find_peak
from bdamper.response.response_curve import NO_STEADY
from bdamper.response.scalar_search import Sample, find_minimum
from bdamper.response.verification import FrictionPeak
from bdamper.util import validation
from bdamper.util.display import Plottable, Summarised
from bdamper.util.errors import (
    COMPLETE,
    FAILED,
    INCOMPLETE,
    INTERRUPTED,
    NOT_FOUND,
    NOT_RUN,
    BdamperError,
    SettingError,
    all_complete,
    status_word,
    with_reason,
)
from bdamper.util.formatting import amount, counted, percent, short_repr, spaced
from bdamper.util.progress import LongWork, one_thread, with_progress
from bdamper.util.storage import Recorded, Storable
from bdamper.util.tables import ROW, Column, Newtons, Quantity, Tabular

# ---- Uncertainty ----


def sample(distributions: Mapping[str, Any], n: int, *, seed: int = 0) -> dict[str, NDArray]:
    """Draw settings from independent distributions by a scrambled Sobol sequence.

    Parameters
    ----------
    distributions : mapping of setting to distribution
        Frozen distributions of scipy.stats, for example ``scipy.stats.norm(0.3, 0.03)``. For "residual_slip_std" a number,
        the standard deviation in m; every draw has other offsets at the contact points.
    n : int
        Number of draws, a power of two.
    seed : int
        Equal seeds give equal draws.

    Returns
    -------
    mapping of setting to (n,) float
    """
    if not isinstance(distributions, Mapping) or not distributions:
        raise SettingError(f"distributions: expected a mapping of setting to distribution, found {distributions!r}")
    all_distributions, distributions = distributions, {k: d for k, d in distributions.items() if k != "residual_slip_std"}
    for name, distribution in distributions.items():
        if not callable(getattr(distribution, "ppf", None)):
            raise SettingError(f"distribution of '{name}': expected one of scipy.stats, found {distribution!r}")
    n, seed = validation.integer("n", n, least=2), validation.integer("seed", seed)
    validation.check(n & (n - 1) == 0, "n", "a power of two for a Sobol sequence", n)
    drawn = {}
    if "residual_slip_std" in all_distributions:
        spread = validation.number("residual_slip_std", all_distributions["residual_slip_std"], least=0.0, unit="m")
        drawn = {"residual_slip_std": np.full(n, spread), "residual_slip_seed": np.arange(n) + float(n * seed)}
    unit = scipy.stats.qmc.Sobol(max(len(distributions), 1), scramble=True, seed=seed).random(n)
    # a ppf may be infinite at 0 and 1
    unit = np.clip(unit, 1e-12, 1.0 - 1e-12)
    return {name: np.asarray(dist.ppf(unit[:, i]), float) for i, (name, dist) in enumerate(distributions.items())} | drawn


@short_repr
@dataclass(frozen=True)
class RobustOptimum(Summarised):
    """Preload at which a percentile of the resonance amplitude over a sample is least.

    Parameters
    ----------
    preload : float, N
    amplitude : float, m
        Percentile of the amplitude at this preload.
    percentile : float
    uncertainty : float
        Relative half-width of the last bracket of the preload.
    kind : {"interior", "end"}
        Whether the preload is inside the range or at one of its ends.
    warnings : int
        Number of peaks in the last grid that are lower bounds.
    status : str
        "complete"; "incomplete" if a preload without a peak in every draw could have a lower percentile; "interrupted",
        with the reason if the executor ended.
    """

    preload: float
    amplitude: float
    percentile: float
    uncertainty: float
    kind: str
    warnings: int = 0
    status: str = COMPLETE

    def __str__(self) -> str:
        edge = ", an end of the range," if self.kind == "end" else ""
        doubts = "" if self.status == COMPLETE else f" The search is {self.status}."
        doubts += f" {self.warnings} of the last peaks are lower bounds." if self.warnings else ""
        return (
            f"At a preload of {amount(self.preload, 'N')}{edge} {self.percentile:g} % of the draws stay below "
            f"{amount(self.amplitude, 'm')}: least of all preloads, known to {percent(self.uncertainty)}.{doubts}"
        )


@short_repr
@dataclass(frozen=True)
class OptimalCurveUncertainty(Plottable, Tabular, Recorded, Storable, kind="bdamper-optimal-curve-uncertainty",
    row="preload"):
    """Optimal curves of a sample.

    ``plot`` draws percentile bands (:func:`bdamper.plot.plot_optimal_curve_uncertainty`).

    Parameters
    ----------
    preload : (m,) float, N
    amplitude, frequency : (n, m) float
        Values of each draw in m and Hz; NaN without a peak or for draws that were not run.
    samples : mapping of setting to (n,) float
    status : tuple of str
        Status of each draw, as in :class:`bdamper.analyses.sweep.SweepResult`.
    settings : mapping
        Settings of the varied problem.
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

    def __len__(self) -> int:
        return len(self.amplitude)

    def percentile(self, q: float | Sequence[float], quantity: str = "amplitude") -> NDArray:
        """Return percentiles over the sample at every preload, (m,) or (len(q), m).

        Draws without a peak at a preload are ignored there.

        Parameters
        ----------
        q : float or sequence of float
            Percentiles from 0 to 100.
        quantity : {"amplitude", "frequency"}
        """
        validation.choice("quantity", quantity, ("amplitude", "frequency"))
        validation.numbers("percentile", np.atleast_1d(q), least=0.0, most=100.0)
        values = np.asarray(getattr(self, quantity))
        known, out = np.isfinite(values).any(axis=0), np.full((*np.shape(q), values.shape[1]), np.nan)
        out[..., known] = np.nanpercentile(values[:, known], q, axis=0)
        return out

    @property
    def complete(self) -> bool:
        """Whether every draw has an optimal curve."""
        return all_complete(self.status)

    def columns(self) -> dict[str, Column]:
        """Return percentiles at each preload, and the curves of all draws for xarray."""
        bands = {
            f"{name}_{q}": Column(self.percentile(float(q), name), unit)
            for name, unit in (("amplitude", "m"), ("frequency", "Hz"))
            for q in (5, 25, 50, 75, 95)
        }
        samples = {f"sample_{name}": Column(values, "", ("draw",)) for name, values in self.samples.items()}
        return super().columns() | bands | samples

    def _headline(self) -> str:
        if not np.isfinite(self.amplitude).any():
            return f"No peak at any preload of {counted(len(self), 'draw')}."
        _, mid, high = self.percentile([5.0, 50.0, 95.0])
        k = int(np.nanargmin(high))
        return (
            f"At a preload of {amount(self.preload[k], 'N')} 95 % of {counted(len(self), 'draw')} of "
            f"{', '.join(map(spaced, self.samples))} stay below {amount(high[k], 'm')}, "
            f"half below {amount(mid[k], 'm')}: least of the preloads tried."
        )


@validation.check_arguments
def optimal_curve_uncertainty(
    study: Asking | Problem,
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
    task = OptimalTask(tuple(float(p) for p in values), len(values), frequency, mode)
    done = sweep(study, dict(samples), task, combine="zip", executor=executor, resume=resume, progress=progress)
    nothing = np.full((len(done), len(values)), np.nan)
    return OptimalCurveUncertainty(
        preload=values,
        amplitude=done.array("curve_amplitude") if done.quantities else nothing,
        frequency=done.array("curve_frequency") if done.quantities else nothing,
        samples={name: np.asarray(column, float) for name, column in samples.items()},
        status=done.status,
        settings=done.settings,
        model_hash=done.model_hash,
        warnings=done.warnings,
    )


def _check_samples(samples: Any) -> None:
    validation.instance("samples", samples, Mapping, "a mapping of settings to numbers, as sample returns it")
    expected = "settings other than the preload"
    validation.check(samples and "preload" not in samples, "samples", expected, ", ".join(samples) or "none")
    for name, values in samples.items():
        validation.check(np.ndim(values) > 0, f"samples '{name}'", "a sequence of values", values)
    lengths = [len(values) for values in samples.values()]
    validation.check(len({*lengths}) == 1, "samples", "equal numbers of values", lengths)


class SteadyPeak(PeakTask):
    """Evaluation of the highest peak at a preload, as the search for an optimum counts it.

    The amplitude is a lower bound if it is not known, zero if nothing was found, and infinite if the damper rattles.
    """

    def __call__(self, study: Asking | Problem, preload: float | None) -> Values:
        problem, load = problem_of(study), float(preload or 0.0)
        there = at_preload(problem, load, peak_interval(problem.at(load), self.frequency, self.mode))
        height = np.inf if there.rattles else float(np.nan_to_num(there.height))
        status = with_reason(NOT_FOUND, f"{NO_STEADY}: {there.rattles}") if there.rattles else there.status
        return {"amplitude": height, "known": there.known, "search": status, "cost": there.cost}


OTHER_FRICTION = (1.0, 0.7, 1.3)
"""Factors on the friction coefficients in the check of an optimum; typical ones, 0.2 to 0.6, differ more."""


@one_thread
def with_other_friction(problem: Problem, curve: OptimalCurve, progress: bool = False) -> OptimalCurve:
    """Return the optimal curve with the peaks at its recommended preload with lower and higher friction coefficients.

    Without an optimum or without friction the curve is returned as it is.  After Ctrl-C the peaks that are missing have the
    status "interrupted".
    """
    preload = curve.recommended_preload
    if not np.isfinite(preload) or not problem.settings.friction_values():
        return curve
    start, cost = time.perf_counter(), curve.cost
    out = {k: FrictionPeak(k, preload, np.nan, INTERRUPTED) for k in OTHER_FRICTION}
    evaluate = SteadyPeak(frequency=tuple(curve.settings["frequency"]))
    with LongWork():
        for factor in with_progress(OTHER_FRICTION, progress, "other friction coefficients", "peak"):
            try:
                found = evaluate(vary(problem, {"friction_factor": factor}), preload)
            except BdamperError as error:
                out[factor] = replace(out[factor], status=with_reason(NOT_FOUND, error))
                continue
            size = found["amplitude"] if 0.0 < found["amplitude"] < np.inf else np.nan
            out[factor], cost = FrictionPeak(factor, preload, size, found["search"]), cost + found["cost"]
    cost = replace(cost, seconds=curve.cost.seconds + time.perf_counter() - start)
    return replace(curve, other_friction=tuple(out.values()), cost=cost)


def _percentiles(done: SweepResult, n: int, percentile: float) -> list[tuple[float, bool]]:
    """Return the percentile of the amplitude at each of ``n`` preloads, and whether it is known or a lower bound."""
    for i, status in enumerate(done.status):
        if status_word(status) == FAILED:
            raise BdamperError(f"robust optimum: draw {i // n} {status}")
    size, known = (done.array(name).reshape(-1, n) for name in ("amplitude", "known"))
    steady = ~np.isinf(size).any(axis=0)
    height = np.percentile(np.where(steady, size, 0.0), percentile, axis=0)
    return [(float(h) if s else np.inf, bool(k.all())) for h, s, k in zip(height, steady, known.T)]


@validation.check_arguments
def robust_optimum(
    study: Asking | Problem,
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

    Percentiles are computed from the highest peaks at each preload of a grid, without interpolation in the preload. The
    grid is refined around its least value down to the tolerance. Preloads at which a damper rattles do not count.

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
        If a draw fails, no preload of the first grid has a peak in every draw, or the executor ended within it.
    KeyboardInterrupt
        If the first grid was interrupted.
    """
    _check_samples(samples)
    percentile = validation.number("percentile", percentile, least=0.0, most=100.0)
    n = validation.integer("n", n, least=5)
    tolerance = validation.number("tolerance", tolerance, least=1e-9, below=1.0)
    limits = preload_values(preload, 2)[[0, -1]]
    low, high = (float(p) for p in limits)
    optimum: RobustOptimum | None = None
    known = dict[float, tuple[float, bool]]()  # percentile, or a lower bound of it, and which of the two
    while optimum is None or optimum.uncertainty > tolerance:
        grid = [float(p) for p in preload_values((low, high), n) if float(p) not in known]
        points: dict[str, Any] = {name: [value for value in values for _ in grid] for name, values in samples.items()}
        points["preload"] = grid * (len(next(iter(points.values()))) // len(grid))
        task = SteadyPeak(frequency=frequency, mode=mode)
        done = sweep(study, points, task, combine="zip", executor=executor, progress=progress)
        left = [s.removeprefix(NOT_RUN) for s in done.status if status_word(s) == NOT_RUN]
        if left:
            if optimum is None:
                raise BdamperError(f"robust optimum{left[0]}") if left[0] else KeyboardInterrupt
            return replace(optimum, status=f"{INTERRUPTED}{left[0]}")
        known |= dict(zip(grid, _percentiles(done, len(grid), percentile)))
        places = sorted(known)
        k = min(range(len(places)), key=lambda i: known[places[i]][0] if known[places[i]][1] else np.inf)
        best, (amplitude, found) = places[k], known[places[k]]
        if not (found and amplitude < np.inf):
            raise BdamperError(f"robust optimum: no preload from {low:g} to {high:g} N has a steady peak in every draw")
        lower = sum(value < amplitude for value, certain in known.values() if not certain)
        low, high = places[max(k - 1, 0)], places[min(k + 1, len(places) - 1)]
        width = float(np.log(high / low)) / 2.0
        why = f"{counted(lower, 'preload')} without a peak in every draw could be lower"
        status = with_reason(INCOMPLETE, why) if lower else COMPLETE
        kind, unsure = "end" if best in limits else "interior", int(np.count_nonzero(done.array("known") == 0.0))
        optimum = RobustOptimum(best, amplitude, float(percentile), width, kind, unsure, status)
    return optimum


# ---- Largest fatigue margin ----


PRELOAD_STEP = 1e-3
"""Relative distance of the preloads for the derivative of a margin; peaks accurate to 1e-8 give an error of 1e-5."""
AGREES = 0.02
"""Relative difference by which the least margin of a response curve may be below the margin of the highest peak."""
WHERE = {"end": "at the end of the preloads with a value", "unknown": "next to preloads without a value"}
"""Status of the largest margin if it was not refined."""


@one_thread
def best_margin(
    problem: Problem,
    /,
    curve: OptimalCurve,
    material: Material,
    **judged: Any,
) -> MarginCurve:
    """Compute margins along an optimal curve, and refine the preload with the largest margin.

    Parameters
    ----------
    problem : Problem
    curve : OptimalCurve
        Curve of this problem. If it contains amplitudes from time integration, ``in_time`` contains their margins.
    material : Material
    **judged
        ``criterion``, ``line``, ``on``, ``sets`` and ``speed``, see :class:`bdamper.fatigue.margin.LeastMargin`.

    Returns
    -------
    MarginCurve
        ``best_value`` is the preload, ``best_status`` its accuracy. After Ctrl-C it is the best preload of the curve.

    Raises
    ------
    SettingError
        If the model has no stress sets, or a setting does not fit.
    """
    validation.instance("curve", curve, OptimalCurve)
    judge = LeastMargin(material, **judged)
    result = judge.along(problem, curve)
    low, high = curve.settings["frequency"]

    def place(peak: Peak, p: float) -> Sample:
        """Return ln(preload), -ln(margin) and its derivative, which is NaN if a neighbouring peak was not found."""
        system, neighbours = problem.system, (p * (1.0 - PRELOAD_STEP), p * (1.0 + PRELOAD_STEP))
        along: dict[str, Any] = {} if peak.corner else {"tangent": peak.tangent, "scale": peak.scale}
        near = [find_peak(system(q), peak.y, parameter=q, **along) for q in neighbours]
        here = _height(judge, problem, peak, p)
        ends = [_height(judge, problem, q, q.parameter) if q.converged else np.nan for q in near]
        return Sample(float(np.log(p)), here, (ends[1] - ends[0]) / float(np.log(neighbours[1] / neighbours[0])))

    def ask(places: Sequence[float]) -> list[Sample]:
        followed = curves.follow([float(np.exp(x)) for x in places])
        return [place(t.top.peak, t.preload) if t.known and t.top else Sample(x, np.inf) for x, t in zip(places, followed)]

    with Curves(problem, (low, high)) as curves:
        rows = [(k, float(p), np.isfinite(a)) for k, (p, a) in enumerate(zip(curve.preload, curve.amplitude))]
        places = [place(_peak(problem, curve, k), p) if is_known else Sample(np.log(p), np.inf) for k, p, is_known in rows]
        places, best = find_minimum(places, ask, lambda a, b, x: x)
        responses = {k.preload: k for k in curve.time_response if np.isfinite(k.mean)}
        peaks = [(p, peak.top.peak) for p in responses for peak in curves.follow([p]) if peak.known and peak.top]
        tops = [(p, top.y) for p, top in peaks if np.isclose(top.amplitude, responses[p].balance, rtol=1e-3, atol=0.0)]
    if curves.interrupted:
        i = result.greatest
        return replace(result, best_value=result.values[i], best_margin=result.margin[i], best_status=INTERRUPTED)
    at = places[best.index]
    preload, value = float(np.exp(at.x)), float(np.exp(-at.value))
    where = WHERE.get(best.kind, "refined between its neighbours")
    doubt = _doubt(problem, curve, judge, preload, value)
    status = with_reason(INCOMPLETE, f"{where}, {doubt}") if doubt else with_reason(COMPLETE, where)
    in_time = tuple(judge.margins(problem, y, p, responses[p]) for p, y in tops)
    return replace(result, best_value=preload, best_margin=value, best_status=status, in_time=in_time)


def _height(judge: LeastMargin, problem: Problem, peak: Peak, preload: float) -> float:
    value = judge(problem, peak.y[:-1], float(peak.y[-1]), preload)
    return float(-np.log(value)) if value > 0.0 else np.inf


def _peak(problem: Problem, curve: OptimalCurve, i: int) -> Peak:
    """Return a point of an optimal curve as a peak, with its tangent if it has one."""
    p = float(curve.preload[i])
    y = np.append(curve.unknowns[i], 2.0 * np.pi * curve.frequency[i])
    return find_peak(problem.system(p), y, parameter=p)


def _doubt(problem: Problem, curve: OptimalCurve, judge: LeastMargin, preload: float, value: float) -> str:
    """Return the contradiction between the complete response curve at a preload and the margin there; empty if they agree.
    """
    low, high = curve.settings["frequency"]
    whole = tracking.frequency_response(problem, preload, (low, high))
    if not whole.complete:
        return f"the response curve there is {whole.status}"
    try:
        margins = judge.along(problem, whole)
    except SettingError as error:
        return str(error)
    i = margins.least
    least, hertz = float(margins.margin[i]), float(whole.frequency[i])
    if least < (1.0 - AGREES) * value:
        return f"on the response curve there the margin is {least:.4g} at {hertz:.6g} Hz"
    return ""
