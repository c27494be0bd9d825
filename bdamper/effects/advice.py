"""Which of the effects that a study leaves out would change its highest peak.

For each effect the peak of the study is embedded in the study with this effect on; :mod:`bdamper.effects.indicator`
estimates its change.  The estimate is about one peak.  So the other maxima and the points near the top of the curve are
asked as well (:mod:`bdamper.effects.rivals`): where one of them may become the highest, what the estimate misses is as
large as the way to there.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import get_lapack_funcs

from bdamper.balance.system import HarmonicSystem
from bdamper.continuation.curve import Curve, uninterrupted
from bdamper.continuation.track import track
from bdamper.effects.indicator import Estimate, change_or_unknown, embed_between, highest_peaks
from bdamper.effects.rivals import Rival, place_at, place_of_peak, rivals, summits, superharmonic_points
from bdamper.peaks.newton import Peak, coarse_options
from bdamper.problem.effects import Effects
from bdamper.problem.problem import Problem
from bdamper.util import validate
from bdamper.util.blas import one_thread
from bdamper.util.errors import BdamperError, SettingError
from bdamper.util.hdf5 import Storable
from bdamper.util.plotting import Plottable
from bdamper.util.repr import brief


@dataclass(frozen=True)
class EffectAdvice:
    """What one effect would change.

    Parameters
    ----------
    name : str
    amplitude_change, frequency_change : float
        Estimated relative change of the peak; NaN if the indicator could not tell.
    defect : float
        Relative change that the estimate may miss, at the peak or because another place becomes the highest.
    reliability : {"small", "significant", "must be on"}
    unknowns, points : int
        Unknowns and contact elements with the effect on.
    cost : float
        Time of a Newton iteration with the effect on, relative to that without.
    reason : str
        Why the estimate of the peak is not enough, if so: what may overtake it.
    """

    name: str
    amplitude_change: float
    frequency_change: float
    defect: float
    reliability: str
    unknowns: int
    points: int
    cost: float
    reason: str = ""


@brief
@dataclass(frozen=True)
class Advice(Plottable, Storable, kind="bdamper-advice", version=3, oldest=3):
    """Estimated changes of a peak by all effects that are off.

    ``plot`` draws bars of the estimated changes (:func:`bdamper.plot.plot_advice`).

    Parameters
    ----------
    preload : float, N
    frequency, amplitude : float, Hz, m
        The converged peak of the study as it is.
    tolerance : float
    unknowns, points : int
        Of the study as it is.
    effects : tuple of EffectAdvice
        The largest change first.
    notes : tuple of str
        What else to know of the curve that the peak was found on.
    seconds : float
        For the estimates alone.
    """

    preload: float
    frequency: float
    amplitude: float
    tolerance: float
    unknowns: int
    points: int
    effects: tuple[EffectAdvice, ...]
    notes: tuple[str, ...] = ()
    seconds: float = field(default=0.0, compare=False)

    def __getitem__(self, name: str) -> EffectAdvice:
        for item in self.effects:
            if item.name == name:
                return item
        raise KeyError(f"no advice on '{name}'; there is some on {[e.name for e in self.effects]}")

    @property
    def called_for(self) -> tuple[str, ...]:
        """Effects that are not small."""
        return tuple(e.name for e in self.effects if e.reliability != "small")

    def __str__(self) -> str:
        lines = [
            f"peak {self.amplitude:.6g} m at {self.frequency:.6g} Hz, preload {self.preload:g} N; tolerance "
            f"{100 * self.tolerance:g} %; {self.unknowns} unknowns, {self.points} contact elements",
            f"{'effect switched on':<26}{'amplitude':>11}{'frequency':>11}{'may miss':>11}  {'reliability':<12}"
            f"{'unknowns':>9}{'points':>7}{'cost':>10}",
        ]
        for e in self.effects:
            lines.append(
                f"{e.name:<26}{_percent(e.amplitude_change):>11}{_percent(e.frequency_change):>11}"
                f"{_percent(e.defect, sign=False):>11}  {e.reliability:<12}{e.unknowns:>9}{e.points:>7}{_times(e.cost):>10}"
                + (f"  {e.reason}" if e.reason else "")
            )
        return "\n".join([*lines, *self.notes])


def _times(value: float) -> str:
    return f"{value:.1f}x" if value < 1e6 else f"{value:.1e}x"


def _percent(value: float, sign: bool = True) -> str:
    if not np.isfinite(value):
        return "unknown"
    digits = ".2f" if abs(value) < 10.0 else ".0f" if abs(value) < 1e4 else ".0e"
    return f"{100 * value:{'+' if sign else ''}{digits}} %"


@one_thread
def advise(
    problem: Problem,
    preload: float,
    frequency: tuple[float, float],
    *,
    against: Effects | None = None,
    tolerance: float = 0.01,
    curve: Curve | None = None,
) -> Advice:
    """Which of the effects that a study leaves out would change its highest peak.

    Parameters
    ----------
    problem : Problem
        As cheap as one likes.
    preload : float, N
    frequency : (low, high), Hz
        Interval in which the peak is looked for.
    against : Effects, optional
        The effects to ask about: those that are on there and off in the study.  By default all that the model allows, with
        five harmonics, two elastic damper modes and coupled friction.
    tolerance : float
        Relative change of amplitude or frequency that counts as small.
    curve : Curve, optional
        Of the study at this preload, if it is known already.

    Returns
    -------
    Advice

    Raises
    ------
    BdamperError
        If the study has no peak there.
    """
    preload, frequency = problem.check_preload(preload), validate.interval("frequency", frequency)
    tolerance = validate.number("tolerance", tolerance, above=0.0, below=1.0)
    if against is not None:
        validate.instance("against", against, Effects)
    own = Effects.of(problem)
    rich = against or fullest(problem)
    system = problem.system(preload)
    if curve is None:
        curve = uninterrupted(track(problem, preload, frequency, options=coarse_options()))
    peaks = highest_peaks(system, curve) if len(curve) else []
    if not peaks:
        raise BdamperError(f"no peak between {frequency[0]:g} and {frequency[1]:g} Hz at {preload:g} N: {curve.reason}")
    begin = time.perf_counter()
    own_time = _iteration_time(system, peaks[0].y)
    items = []
    for name, effects in own.missing(rich).items():
        richer = problem.with_effects(effects)
        items.append(_advice_on(name, problem, richer, preload, curve, peaks, tolerance, own_time))
    items.sort(key=lambda e: -max(abs(np.nan_to_num(e.amplitude_change, nan=9.0)), abs(e.frequency_change)))
    return Advice(
        float(preload), peaks[0].frequency, peaks[0].amplitude, tolerance, system.n_unknowns, system.n_points,
        tuple(items), _notes(curve, peaks[0]), time.perf_counter() - begin,
    )  # fmt: skip


def _notes(curve: Curve, peak: Peak) -> tuple[str, ...]:
    """What of a curve its highest peak does not tell."""
    notes = []
    if not curve.complete:
        notes.append(f"the curve is {curve.status}, what it has not reached may be higher: {curve.reason}")
    notes += [f"not followed, may be higher: {part}" for part in curve.left_out]
    top = int(np.argmax(curve.amplitude))
    if curve.amplitude[top] > (1.0 + 1e-3) * peak.amplitude:
        what = "a summit that is no maximum" if top in summits(curve) else "where the interval ends"
        notes.append(f"the response is higher at {curve.frequency[top]:.6g} Hz, {what}: {curve.amplitude[top]:.6g} m")
    return tuple(notes)


def _advice_on(
    name: str,
    problem: Problem,
    richer: Problem,
    preload: float,
    curve: Curve,
    peaks: list[Peak],
    tolerance: float,
    own_time: float,
) -> EffectAdvice:
    if not richer.static(preload).converged:
        size = richer.n_unknowns, richer.coupling.n_points
        return EffectAdvice(name, np.nan, np.nan, np.inf, "must be on", *size, np.nan, "no static state")
    system, rich = problem.system(preload), richer.system(preload)
    size = rich.n_unknowns, rich.n_points

    def moved(y: NDArray) -> NDArray:
        return embed_between(problem, richer, system, rich, preload, y)

    def ask(y: NDArray) -> Estimate:
        return change_or_unknown(rich, moved(y))

    top = place_of_peak(peaks[0], ask)
    e = top.estimate
    others: list[Rival] = []
    if np.isfinite(e.size):
        springs = (richer.stuck_springs(richer.static(preload)), None)
        parts = superharmonic_points(curve, system, rich, springs, moved, top.amplitude)
        between = [place_at(system, y, ask) for part in parts for y in part]
        others = list(rivals(curve, peaks, ask, top, tolerance, between))
    defect, reliability, reason = judged(e, others, tolerance)
    cost = _iteration_time(rich, moved(peaks[0].y)) / own_time
    return EffectAdvice(name, e.amplitude, e.frequency, defect, reliability, *size, cost, reason)


def judged(estimate: Estimate, others: list[Rival], tolerance: float) -> tuple[float, str, str]:
    """What the estimate of the peak may miss, how far it is to be relied on, and why no further.

    A change is small only if no other place may make it larger.  Its size can be relied on as far as no other place is
    expected to become the highest.
    """
    highest = max(others, key=lambda rival: rival.may_miss, default=None)
    most, reason = estimate, ""
    if highest is not None and highest.may_miss > estimate.defect:
        most = replace(estimate, defect=highest.may_miss)
        reason = f"may be higher at {highest.place.frequency:.5g} Hz"
    expected = max([estimate.defect, *(rival.misses for rival in others)])
    reliability = replace(estimate, defect=expected).reliability(tolerance)
    if reliability == "small" and most.size > tolerance:
        reliability = "must be on"
    return most.defect, reliability, reason


def _iteration_time(system: HarmonicSystem, y: NDArray) -> float:
    """Seconds of a residual with Jacobian and a factorisation, the shorter of two."""
    best = np.inf
    for _ in range(2):
        begin = time.perf_counter()
        _, J, _ = system.evaluate(y[:-1], y[-1])
        get_lapack_funcs("getrf", (J,))(J)
        best = min(best, time.perf_counter() - begin)
    return best


def fullest(problem: Problem) -> Effects:
    """All effects that a study could simulate: five harmonics where the model has their nodal diameters."""
    own = Effects.of(problem)
    most = 1
    for l in range(2, 6):
        try:
            problem.coupling.basis(l)
        except SettingError:
            break
        most = l
    bodies = problem.model.bodies.values()
    blade = [min(b.n_modes for b in body.bases.values()) for body in bodies if body.kind == "constrained"]
    damper = [body.bases[0].n_modes - 6 for body in bodies if body.kind == "free"]
    plain = own.friction_law == "separable" and own.residual_traction == "static"
    harmonics = sorted({*own.harmonic_numbers, *range(1, most + 1)})
    return replace(
        own,
        harmonics=len(harmonics) if harmonics[-1] == len(harmonics) else tuple(harmonics),
        bias=True,
        variable_normal_load=True,
        separation=True,
        friction_law="coupled" if plain else own.friction_law,
        rotation=("X", "Y", "Z"),
        translation=("X", "Y", "Z"),
        damper_modes=max(own.damper_modes, min([2, *damper])) if damper else own.damper_modes,
        harmonic_nodal_diameters=True,
        constraints=True,
        contact_points=None,
        blade_modes=max(own.blade_modes, min([20, 2 * own.blade_modes, *blade])),
    )
