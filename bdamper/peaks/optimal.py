"""Optimal curve and frequency-shift curve: the resonance peak over the preload, from free to stuck.

All peaks are followed over the preload (:mod:`bdamper.peaks.peak_set`); the optimal curve is the highest of those known at
each preload, and events (peaks that vanish, jumps, scans) are kept in the result (:mod:`bdamper.peaks.optimal_curve`).
The optimum is the least value on it (:mod:`bdamper.peaks.envelope`).
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bdamper.peaks.envelope import LeastEnvelope
from bdamper.peaks.newton import Peak, PeakOptions
from bdamper.peaks.optimal_curve import OptimalCurve, OptimumPoint
from bdamper.peaks.peak_set import PeakSet
from bdamper.peaks.scan import linear_peak, resonance_interval, scan
from bdamper.problem.problem import Problem
from bdamper.util import validate
from bdamper.util.blas import one_thread
from bdamper.util.cost import CostMeter
from bdamper.util.errors import BdamperError, SettingError

FOLLOWING = PeakOptions(max_halvings=3, position_tolerance=1e-6)
"""Settings with which peaks are followed, unless others are given: a peak's amplitude has an error of second order in its
place."""


@one_thread
def optimal_curve(
    problem: Problem,
    preload: tuple[float, float] | Sequence[float] | NDArray = (10.0, 25e3),
    n: int = 50,
    *,
    frequency: tuple[float, float] | None = None,
    mode: int = 1,
    checks: int = 0,
    options: PeakOptions | None = None,
) -> OptimalCurve:
    """Resonance amplitude and frequency over the preload, and the preload of least amplitude.

    Parameters
    ----------
    problem : Problem
    preload : (low, high) or sequence of more than two values, N
        Two values: ``n`` preloads between them, equal ratios apart.
    n : int
    frequency : (low, high), Hz, optional
        Where to look for peaks; around the free and the stuck resonance of ``mode`` by default.
    mode : int
        Mode of the constrained bodies, 1 for the lowest.
    checks : int
        Preloads, besides the ends of the range, at which the whole response is followed to look for higher peaks in any
        case.
    options : PeakOptions
        ``FOLLOWING`` by default.

    Returns
    -------
    OptimalCurve

    Raises
    ------
    BdamperError
        If there is no peak in the interval at any of the preloads.
    """
    start = time.perf_counter()
    values = preload_values(preload, n)
    checks = validate.whole("checks", checks)
    check_options(options)
    if not np.any(problem.damper_load[0]):
        why = problem.why_no_load
        raise SettingError(f"optimal_curve: expected a model with a body that carries a load, found that {why}")
    meter = CostMeter(start)
    frequency = peak_interval(problem, frequency, mode)
    free = linear_peak(problem, frequency, float(values[-1]), stuck=False)
    stuck = linear_peak(problem, frequency, float(values[-1]), stuck=True)
    known = PeakSet(problem, values, frequency, options or FOLLOWING, meter)
    known.run(checks)
    optimum = LeastEnvelope(known).point()
    leaders = [known.leader(k) for k in range(len(values))]

    def column(get: Any, fill: Any) -> NDArray:
        return np.array([get(item) if item is not None else fill for item in leaders])

    every = [(b.number, q) for b in known.branches for _, q in sorted(b.peaks.items())]
    status = []
    for k, item in enumerate(leaders):
        if item is None:
            status.append(f"no peak found, scan over frequency {known.scanned.get(k, 'not made')}")
        else:
            ending = known.scanned.get(k)
            status.append("followed" if ending is None else ("scanned" if ending == "complete" else f"scan {ending}"))
    return OptimalCurve(
        preload=values,
        amplitude=column(lambda item: item[1].amplitude, np.nan),
        frequency=column(lambda item: item[1].frequency, np.nan),
        shares=column(lambda item: item[1].shares, np.full(3, np.nan)),
        residual=column(lambda item: item[1].residual, np.nan),
        rank_deficiency=column(lambda item: item[1].rank_deficiency, 0),
        branch=column(lambda item: item[0].number, -1),
        unknowns=column(lambda item: item[1].y[:-1], np.full(problem.n_unknowns, np.nan)),
        status=tuple(status),
        peak_preload=np.array([q.parameter for _, q in every]),
        peak_amplitude=np.array([q.amplitude for _, q in every]),
        peak_frequency=np.array([q.frequency for _, q in every]),
        peak_branch=np.array([number for number, _ in every], int),
        peak_detached=np.array([k in b.detached for b in known.branches for k in sorted(b.peaks)], bool),
        branch_end=tuple(f"down: {b.down or 'end of range'}; up: {b.up or 'end of range'}" for b in known.branches),
        free=free,
        stuck=stuck,
        optimum=optimum,
        events=tuple(known.events),
        cost=meter.read(time.perf_counter()),
        settings=problem.record(None) | {"frequency": [float(f) for f in frequency]},
        model_hash=problem.model.hash,
    )


@one_thread
def optimum(
    problem: Problem,
    preload: tuple[float, float] | Sequence[float] | NDArray = (10.0, 25e3),
    n: int = 24,
    *,
    frequency: tuple[float, float] | None = None,
    mode: int = 1,
    options: PeakOptions | None = None,
) -> OptimumPoint:
    """The preload of least resonance amplitude; see :func:`optimal_curve`."""
    return optimal_curve(problem, preload, n, frequency=frequency, mode=mode, options=options).optimum


def preload_values(preload: Any, n: int) -> NDArray:
    """Preloads of a curve: ``n`` between two given ones, equal ratios apart, or the longer sequence that is given.

    Raises
    ------
    SettingError
        If they are not positive and increasing.
    """
    if np.ndim(n) > 0:
        raise SettingError(f"n: expected a whole number, and an interval by its name as frequency=(low, high), found {n!r}")
    values = validate.numbers("preload", preload, above=0.0, unit="N")
    if len(values) < 2 or np.any(np.diff(values) <= 0.0):
        raise validate.unfit("preload", "(low, high) or a longer sequence of increasing values", preload)
    n = validate.whole("n", n, least=2)
    return values if len(values) > 2 else np.geomspace(values[0], values[1], n)


def peak_interval(problem: Problem, frequency: tuple[float, float] | None, mode: int = 1) -> tuple[float, float]:
    """The interval (Hz) that is given, or the one around the resonances of a mode."""
    mode = validate.whole("mode", mode, least=1)
    return resonance_interval(problem, mode) if frequency is None else validate.interval("frequency", frequency)


def check_options(options: PeakOptions | None) -> None:
    if options is not None:
        validate.instance("options", options, PeakOptions)



@one_thread
def highest_peak(
    problem: Problem,
    preload: float,
    frequency: tuple[float, float] | None = None,
    *,
    mode: int = 1,
    options: PeakOptions | None = None,
) -> Peak:
    """The highest peak at one preload.

    A corner of the curve at which the damper walks is no peak, for it has no condition that could be followed; where it
    is higher, ``scan`` of the peak says so.

    Raises
    ------
    BdamperError
        If no peak was found in the interval.
    """
    preload = problem.check_preload(preload)
    frequency = peak_interval(problem, frequency, mode)
    check_options(options)
    meter = CostMeter(time.perf_counter())
    found = scan(problem, preload, frequency, options=options, meter=meter)
    peaks, ending, walk = found.peaks, found.ending, found.walk
    if walk is not None and (not peaks or walk[1] > peaks[0].amplitude):
        ending += f"; higher where the damper walks, {walk[1]:.6g} m at {walk[0]:.6g} Hz"
    if not peaks:
        raise BdamperError(
            f"no peak found at {preload:g} N between {frequency[0]:.6g} and {frequency[1]:.6g} Hz; the response curve "
            f"ended as: {ending}"
        )
    cost = meter.read(time.perf_counter())
    iterations = cost.iterations + sum(p.iterations for p in peaks)
    return replace(peaks[0], cost=replace(cost, iterations=iterations), scan=ending)
