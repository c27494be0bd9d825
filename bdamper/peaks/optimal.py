"""Optimal curve and frequency-shift curve: the resonance peak over the preload, from free to stuck.

All peaks are followed over the preload (:mod:`bdamper.peaks.envelope`); the optimal curve is the highest of those known at
each preload, the optimum its least value, and the result keeps events: peaks that vanish, jumps, scans
(:mod:`bdamper.peaks.optimal_curve`).
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bdamper.continuation.rattle import NO_STEADY
from bdamper.peaks.envelope import PeakEnvelope
from bdamper.peaks.highest import check_options
from bdamper.peaks.interval import linear_peak, peak_interval
from bdamper.peaks.least import least_peak, least_so_far, verified_optimum
from bdamper.peaks.newton import PeakOptions
from bdamper.peaks.optimal_curve import OptimalCurve, OptimumPoint
from bdamper.problem.problem import Problem
from bdamper.problem.variation import study_fingerprint
from bdamper.util import validate
from bdamper.util.blas import one_thread
from bdamper.util.cost import CostMeter
from bdamper.util.errors import SettingError
from bdamper.util.progress import LongWork, stages
from bdamper.util.results_file import ResultsFile
from bdamper.util.versions import HERE

FOLLOWING = PeakOptions(max_halvings=3, position_tolerance=1e-6)
"""Settings with which peaks are followed by default: an error in the place of a peak changes its amplitude in second order
only."""


@one_thread
def optimal_curve(
    problem: Problem,
    preload: tuple[float, float] | Sequence[float] | NDArray = (10.0, 25e3),
    n: int = 50,
    *,
    frequency: tuple[float, float] | None = None,
    mode: int = 1,
    checks: int = 0,
    verify: bool = True,
    options: PeakOptions | None = None,
    progress: bool = False,
    resume: str | Path | None = None,
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
    verify : bool
        Compare the optimum with whole tracking curves, and search on where they contradict it.
    options : PeakOptions
        ``FOLLOWING`` by default.
    progress : bool
        Show what is being done, and the time left for the scans over frequency that are known to be needed.
    resume : path, optional
        File that keeps every scan with the peaks that were followed from it; a search that was interrupted goes on from
        there and ends with the same result.

    Returns
    -------
    OptimalCurve
        After Ctrl-C with what was known by then: its optimum is "not verified: interrupted by the user".

    Raises
    ------
    BdamperError
        If there is no peak in the interval at any of the preloads, or the file is of another search.
    KeyboardInterrupt
        If the search was interrupted before it found a peak.
    """
    start = time.perf_counter()
    values = preload_values(preload, n)
    checks = validate.whole("checks", checks)
    for name, value in (("verify", verify), ("progress", progress)):
        validate.flag(name, value)
    check_options(options)
    if not problem.carries_load:
        why = problem.why_no_load
        raise SettingError(f"optimal_curve: expected a model with a body that carries a load, found that {why}")
    meter = CostMeter(start)
    frequency = peak_interval(problem, frequency, mode)
    free = linear_peak(problem, frequency, float(values[-1]), stuck=False)
    stuck = linear_peak(problem, frequency, float(values[-1]), stuck=True)
    known = PeakEnvelope(problem, values, frequency, options or FOLLOWING, meter)
    optimum = _search(known, checks, verify, progress, resume)
    settings = problem.record(None) | {"frequency": [float(f) for f in frequency]}
    for k in range(known.first, len(known.preload) - 1):
        known.note_change(k)
    columns = _columns(known, problem.n_unknowns)
    return OptimalCurve(
        **columns, free=free, stuck=stuck, optimum=optimum, events=tuple(known.events),
        cost=meter.read(time.perf_counter()), settings=settings, model_hash=problem.model.hash,
        no_steady_below=known.no_steady_below,
    )  # fmt: skip


def _search(known: PeakEnvelope, checks: int, verify: bool, progress: bool, resume: str | Path | None) -> OptimumPoint:
    """The optimum, after all peaks were found; what is known of both if that was interrupted."""
    asked = {"preload": known.preload, "frequency": known.frequency, "checks": checks, "options": known.options}
    with ExitStack() as stack:
        if resume is not None:
            known.file = stack.enter_context(closing(search_file(resume, known.problem, **asked)))
        if progress:
            known.report = stack.enter_context(stages("optimal curve", "scan"))
        with LongWork() as work:
            known.find_all(checks)
            optimum = verified_optimum(known) if verify else least_peak(known)
    if not work.interrupted:
        return optimum
    if not known.branches:
        raise KeyboardInterrupt
    return least_so_far(known)


def search_file(path: str | Path, problem: Problem, **asked: Any) -> ResultsFile:
    """The file of a search, guarded by the model, the settings and what was asked, as far as it is given."""
    header = {"format": "bdamper-optimal-search", "version": 1, **HERE.attributes(), "study": study_fingerprint(problem)}
    return ResultsFile(path, header | asked, "search for an optimal curve")


def _columns(known: PeakEnvelope, n_unknowns: int) -> dict[str, Any]:
    """Fields of an optimal curve that hold the highest peak at each preload, and all peaks."""
    asked = [int(k) for k in np.flatnonzero(known.asked)]
    values = [known.value(k) for k in asked]
    on = np.array([False, *(known.goes_on(k) for k in range(len(known.preload) - 1))])
    every = [(b.number, q, known.isolated(b, k)) for b in known.branches for k, q in sorted(b.peaks.items())]

    def column(name: str, fill: Any) -> NDArray:
        return np.array([fill if item is None else getattr(item[1], name) for item in values])

    return {
        "preload": known.preload[asked],
        "amplitude": column("amplitude", np.nan),
        "lower_bound": np.array([known.lower_bound(k) if item is None else np.nan for k, item in zip(asked, values)]),
        "frequency": column("frequency", np.nan),
        "shares": column("shares", np.full(3, np.nan)),
        "residual": column("residual", np.nan),
        "rank_deficiency": column("rank_deficiency", 0),
        "branch": np.array([-1 if item is None else item[0].number for item in values]),
        "unknowns": np.array([np.full(n_unknowns, np.nan) if item is None else item[1].y[:-1] for item in values]),
        "status": tuple(_status(known, k) for k in asked),
        "goes_on": np.array(
            [
                i > 0 and values[i] is not None and values[i - 1] is not None and all(on[asked[i - 1] + 1 : k + 1])
                for i, k in enumerate(asked)
            ]
        ),
        "peak_preload": np.array([q.parameter for _, q, _ in every]),
        "peak_amplitude": np.array([q.amplitude for _, q, _ in every]),
        "peak_frequency": np.array([q.frequency for _, q, _ in every]),
        "peak_branch": np.array([number for number, _, _ in every], int),
        "peak_detached": np.array([isolated for _, _, isolated in every], bool),
        "branch_end": tuple(f"down: {b.down or 'end of range'}; up: {b.up or 'end of range'}" for b in known.branches),
    }


def _status(known: PeakEnvelope, k: int) -> str:
    """What is known at a preload, with the ending of the scan over frequency if one was made there."""
    there = known.scan_at(k)
    if k < known.first:
        edge = known.no_steady_below
        return f"{NO_STEADY} below {edge:.6g} N: {known.scanned[edge].rattles}"
    if known.value(k) is not None:
        return "followed" if there is None else "scanned"
    what = "no peak found" if known.highest(k) is None else "lower bound"
    return f"{what}, scan over frequency {'not made' if there is None else there.ending}"


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
