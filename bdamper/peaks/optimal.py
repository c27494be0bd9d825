"""Optimal curve and frequency-shift curve: the resonance peak over the preload, from free to stuck.

All peaks are followed over the preload (:mod:`bdamper.peaks.peak_set`); the optimal curve is the highest of those known at
each preload, and events (peaks that vanish, jumps, scans) are kept in the result (:mod:`bdamper.peaks.optimal_curve`).
The optimum is the least value on it (:mod:`bdamper.peaks.envelope`).
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from bdamper.balance.system import HarmonicSystem
from bdamper.peaks.envelope import LeastEnvelope
from bdamper.peaks.newton import Family, Peak, PeakOptions
from bdamper.peaks.optimal_curve import Limit, OptimalCurve, OptimumPoint
from bdamper.peaks.peak_set import PeakSet
from bdamper.peaks.scan import linear_peak, peaks_at, resonance_interval, scan
from bdamper.peaks.sensitivity import PeakSensitivity, sensitivities
from bdamper.problem.variation import FACTORS, setting_names, vary
from bdamper.util import validate
from bdamper.util.cost import CostMeter
from bdamper.util.errors import BdamperError, SettingError

if TYPE_CHECKING:
    from bdamper.study import Study

PARAMETERS = (
    "preload", "friction_coefficient", "contact_stiffness_factor", "excitation.amplitude", "damper_mass_factor",
    "damping_factor",
)  # fmt: skip
FOLLOWING = PeakOptions(max_halvings=3, position_tolerance=1e-6)
"""Settings with which peaks are followed, unless others are given: a peak's amplitude has an error of second order in its
place."""


def optimal_curve(
    study: Study,
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
    study : Study
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
    _check_options(options)
    if not np.any(study._load[0]):
        why = study._why_no_load
        raise SettingError(f"optimal_curve: expected a model with a body that carries a load, found that {why}")
    meter = CostMeter(start)
    frequency = peak_interval(study, frequency, mode)
    free = linear_peak(study, frequency, float(values[-1]), stuck=False)
    stuck = linear_peak(study, frequency, float(values[-1]), stuck=True)
    known = PeakSet(study, values, frequency, options or FOLLOWING, meter)
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
        unknowns=column(lambda item: item[1].y[:-1], np.full(study.n_unknowns, np.nan)),
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
        settings=study._settings(None) | {"frequency": [float(f) for f in frequency]},
        model_hash=study.model.hash,
    )


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


def peak_interval(study: Study, frequency: tuple[float, float] | None, mode: int = 1) -> tuple[float, float]:
    """The interval (Hz) that is given, or the one around the resonances of a mode."""
    mode = validate.whole("mode", mode, least=1)
    return resonance_interval(study, mode) if frequency is None else validate.interval("frequency", frequency)


def _check_options(options: PeakOptions | None) -> None:
    if options is not None:
        validate.instance("options", options, PeakOptions)


# ---- single peaks and their sensitivities ----


def highest_peak(
    study: Study,
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
    preload = study._check_preload(preload)
    frequency = peak_interval(study, frequency, mode)
    _check_options(options)
    meter = CostMeter(time.perf_counter())
    found = scan(study, preload, frequency, options=options, meter=meter)
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


def peak_sensitivities(
    study: Study, peak: Peak, parameters: Sequence[str] = PARAMETERS, *, options: PeakOptions | None = None
) -> dict[str, PeakSensitivity]:
    """Derivatives of a peak's amplitude and frequency with respect to the preload and to settings.

    Parameters
    ----------
    study : Study
    peak : Peak
        Of this study, at ``peak.parameter`` newtons of preload.
    parameters : sequence of str
        "preload" or any setting with a number (see :mod:`bdamper.problem.variation`); factors are taken at 1.
    options : PeakOptions

    Raises
    ------
    SettingError
        If the peak is not converged or lies at a corner, and with sampled evaluation: events between samples make the
        amplitude a rippled function of frequency, with tops that move by ripples.
    """
    validate.instance("peak", peak, Peak, "a Peak, as Study.peak returns it")
    _check_options(options)
    if study.evaluation != "exact":
        raise SettingError(f'sensitivities: expected evaluation="exact", found {study.evaluation}: the peak has ripples')
    families: dict[str, tuple[Family, float]] = {}
    parameters = validate.names("parameters", parameters, ("preload", *setting_names(study)))
    preload = peak.parameter
    for name in parameters:
        if name == "preload":
            if preload > 0.0:
                families[name] = (study.system, preload)
            continue
        if name == "damper_mass_factor" and not any(b.kind == "free" for b in study.model.bodies.values()):
            continue
        families[name] = (setting_family(study, name, preload), setting_value(study, name))
    return sensitivities(peak, families, options)


def setting_value(study: Study, name: str) -> float:
    """Present value of a numeric setting, 1 for a factor."""
    if name in FACTORS:
        return 1.0
    value: Any = study
    for part in name.split("."):
        value = getattr(value, part if part != "response" else "_response")
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise SettingError(f"{name}: expected a setting that is one number, found {value!r}")
    return float(value)


def setting_family(study: Study, name: str, preload: float) -> Family:
    """The equations at one preload as a function of one numeric setting."""

    def family(value: float) -> HarmonicSystem:
        return vary(study, {name: value}).system(preload)

    return family


__all__ = [
    "Limit",
    "OptimalCurve",
    "OptimumPoint",
    "highest_peak",
    "linear_peak",
    "optimal_curve",
    "peak_interval",
    "peak_sensitivities",
    "peaks_at",
    "preload_values",
    "resonance_interval",
    "setting_family",
    "setting_value",
]
