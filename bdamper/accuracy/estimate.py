"""Error estimates of a peak by source: what richer settings would change.

For each source the peak is compared with the highest point of a whole curve of a richer problem.  With more harmonics that
takes long: there the converged peak is embedded in the richer problem, Newton's method goes on to the peak there (at an end
of the interval: to the response at this frequency), and the whole curve is followed only if it fails.  Lower peaks of the
curve that could become the highest (:data:`NEARLY_HIGHEST`) are carried over with it.  The residual left and missed
events are small: their effect follows from one Newton step (:func:`bdamper.effects.indicator.estimate_change`).

Nothing is concluded from poorer settings.  A source for which the model has nothing richer, or whose richer curve cannot be
followed, is not estimated, and says why.

``harmonics``
    As many more as there are, at least four; where the model lacks a nodal diameter the modes of the fundamental stand in.
``evaluation``
    Samples against exact events.  Exact events against dense samples: there the sampling error itself, some 1e-6, is the
    most that missed events can hide behind.
``contact points``
    United patches against the patches of the model.
``modes``
    Twice as many modes with residual modes, which leave an error that falls with the fourth power of the frequency of the
    first mode left out (at least as many as a blade has by default, since twice none would be none); otherwise, where
    convergence is slow, all modes of the model.
``residual flexibility``
    Contact stiffness by a diagonal rule against residual modes, which carry all of it for the stuck modes.
``solver``
    The residual that is left, and the place of the peak between points of a curve.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from bdamper.contact.laws import Sampled
from bdamper.contact.residual_modes import ResidualModes
from bdamper.continuation.curve import Curve, uninterrupted
from bdamper.continuation.track import check_curve, track
from bdamper.effects.indicator import embed_between, estimate_change
from bdamper.harmonic_balance.system import OK, HarmonicSystem
from bdamper.model.model import Model
from bdamper.peaks.least import AGREES
from bdamper.peaks.newton import Peak, PeakOptions, find_peak, peak_scale, same_peak
from bdamper.peaks.optimal_curve import NOT_VERIFIED, OptimalCurve
from bdamper.problem.effects import BLADE_MODES, MAX_HARMONIC, Effects, harmonic_numbers
from bdamper.problem.problem import Problem
from bdamper.util import validate
from bdamper.util.blas import one_thread
from bdamper.util.errors import BdamperError, SettingError
from bdamper.util.estimates import ErrorEstimates, SourceError
from bdamper.util.status import COMPLETE

SOURCES = ("harmonics", "evaluation", "contact points", "modes", "residual flexibility", "solver")
NEARLY_HIGHEST = 0.7
"""Height over that of the highest peak, from which on a lower one is carried over with it.

A peak that changes by more than the rest, 30 %, may leave the top to one that is not carried over, so then a whole curve is
taken.  In the scenes of ``benchmarks.estimate_scenes`` the changes that Newton's method finds are at most 6 %, and those of
whole curves to 1e-4.
"""
LOOSE = PeakOptions(tolerance=1e-8, position_tolerance=1e-3)
"""How exactly the peak of the richer problem is found."""


@dataclass(frozen=True)
class Tops:
    """The highest peak of a study under one preload, and what else may become the highest.

    Parameters
    ----------
    peaks : tuple of Peak
        The highest first.
    interval : (low, high), Hz, or None
        Of the curve that they are from.
    place : {"peak", "corner", "end"}
        Whether the highest is a maximum that Newton's method has refined, another point of the curve, or an end of it.
    """

    peaks: tuple[Peak, ...]
    interval: tuple[float, float] | None
    place: str


@one_thread
def estimate_errors(
    problem: Problem,
    result: Curve | Peak | OptimalCurve,
    preload: float | None = None,
    *,
    sources: Sequence[str] = SOURCES,
) -> ErrorEstimates:
    """Estimated errors of a peak by source.

    Parameters
    ----------
    problem : Problem
        That the result was computed with.
    result : Curve, Peak or OptimalCurve
        Of a tracking curve the highest peak is taken, of an optimal curve that of a tracking curve at its optimum.
    preload : float, N, optional
        For a peak that does not carry it as its parameter.
    sources : sequence of str
        Out of :data:`SOURCES`.

    Returns
    -------
    ErrorEstimates

    Raises
    ------
    SettingError
        If the result is not one of this study, or not converged.
    """
    sources = validate.names("sources", sources, SOURCES)
    kinds = Curve, Peak, OptimalCurve
    validate.instance("result", result, kinds, "a Curve, a Peak or an OptimalCurve of this study")
    begin = time.perf_counter()
    problem = problem.matching(result.settings)
    location = 0.0, 0.0
    if isinstance(result, OptimalCurve):
        best, found = result.optimum, _at_optimum(problem, result)
        if isinstance(found, str):
            items = tuple(SourceError(source, *_unknown(found)) for source in sources)
            return ErrorEstimates(best.preload, best.frequency, best.amplitude, items, time.perf_counter() - begin)
        result = found
    if isinstance(result, Curve):
        check_curve(problem, result)
        preload, amplitude, frequency = result.preload, result.peak.amplitude, result.peak.frequency
        tops = _tops_of(problem, result)
        location = tops.peaks[0].amplitude / amplitude - 1.0, tops.peaks[0].frequency / frequency - 1.0
    else:
        preload = _preload_of(problem, result, preload)
        amplitude, frequency = result.amplitude, result.frequency
        tops = Tops((result,), None, "corner" if isinstance(problem.evaluation, Sampled) else "peak")
    items = tuple(item for s in sources if (item := _of_source(problem, s, preload, tops, location)) is not None)
    return ErrorEstimates(preload, frequency, amplitude, items, time.perf_counter() - begin)


def _at_optimum(problem: Problem, result: OptimalCurve) -> Curve | str:
    """A tracking curve at the preload of the optimum (at any, if it is flat), or why none can stand for it."""
    n = problem.n_unknowns
    if result.model_hash != problem.model.hash or result.unknowns.shape[1] != n:
        raise SettingError(
            f"result: expected an optimal curve of this model and of this study with {n} unknowns, found another"
        )
    best = result.optimum
    if best.kind == "none":
        return f"the optimal curve has no optimum ({best.status.removeprefix(NOT_VERIFIED)})"
    preload = float(result.preload[-1]) if best.kind == "flat" else best.preload
    curve = uninterrupted(track(problem, preload, tuple(result.settings["frequency"])))
    if not curve.complete:
        return f"no whole curve at {preload:.6g} N: {curve.reason}"
    if not abs(curve.peak.amplitude / best.amplitude - 1.0) <= AGREES:
        return f"the curve at {preload:.6g} N is highest at {curve.peak.amplitude:.6g} m, not {best.amplitude:.6g} m"
    return curve


def _tops_of(problem: Problem, curve: Curve) -> Tops:
    """The highest peak of a curve and those nearly as high, refined."""
    top, amplitude = curve.peak, curve.amplitude
    others = [i for i, kind in enumerate(curve.point_kind) if kind == "maximum" and i != top.index]
    found = []
    for i in [top.index, *(i for i in others if amplitude[i] > NEARLY_HIGHEST * top.amplitude)]:
        at, height = float(curve.frequency[i]), float(amplitude[i])
        y = np.append(curve.unknowns[i], 2.0 * np.pi * at)
        peak = find_peak(problem.system(curve.preload), y)
        residual = float(curve.residual[i])
        point = replace(peak, y=y, frequency=at, amplitude=height, residual=residual, status=COMPLETE)
        good = peak.converged and same_peak(peak, point)
        good = good and not isinstance(problem.evaluation, Sampled)  # samples make many small peaks
        if i == top.index:
            place = "end" if curve.point_kind[i] == "end" else "peak" if good else "corner"
        found.append(peak if good and not (place == "end" and i == top.index) else point)
    return Tops(tuple(found), (float(curve.frequency.min()), float(curve.frequency.max())), place)


def _preload_of(problem: Problem, peak: Peak, preload: float | None) -> float:
    """The preload of a converged peak of this problem, that it carries or that is given."""
    if not peak.converged:
        raise SettingError(f"peak: expected a converged one, found status '{peak.status}'")
    preload = peak.parameter if preload is None else problem.check_preload(preload)
    if not np.isfinite(preload):
        raise SettingError("preload is required: this peak has no stored preload")
    n = problem.system(preload).n_unknowns
    if len(peak.y) != n + 1:
        raise SettingError(f"peak: expected one of this study with {n} unknowns, found {len(peak.y) - 1}")
    return preload


def _of_source(
    problem: Problem, source: str, preload: float, tops: Tops, location: tuple[float, float]
) -> SourceError | None:
    begin = time.perf_counter()
    peak = tops.peaks[0]

    def result(amplitude: float, frequency: float, uncertainty: float, text: str) -> SourceError:
        return SourceError(source, float(amplitude), float(frequency), uncertainty, text, time.perf_counter() - begin)

    if source == "solver":
        e = estimate_change(problem.system(preload), peak.y)
        text = f"residual {peak.residual:.1e}" + (", place of the peak on the curve" if any(location) else "")
        return result(e.amplitude + location[0], e.frequency + location[1], 0.0, text)
    if source == "evaluation" and not isinstance(problem.evaluation, Sampled):
        amplitude, frequency, n = _missed_events(problem, preload, peak.y)
        return result(amplitude, frequency, 0.0, f"exact events against {n} samples, whose own error this may be")
    try:
        richer = richer_study(problem, source)
        if richer is None:
            return None
        if isinstance(richer, str):
            return result(*_unknown(richer))
        amplitude, frequency, uncertainty, how = change_of_peak(problem, richer.problem, preload, tops)
    except BdamperError as error:
        return result(*_unknown(str(error)))
    return result(amplitude, frequency, uncertainty, f"{richer.text}; {how}")


Change = tuple[float, float, float, str]
"""Relative change of amplitude and of frequency, how much it may miss, and how it was found."""


def _unknown(why: str) -> Change:
    return np.nan, np.nan, np.inf, why


def change_of_peak(problem: Problem, richer: Problem, preload: float, tops: Tops) -> Change:
    """How the highest peak (of the first problem, under ``preload`` in N) changes with the settings of a richer problem."""
    if not richer.static(preload).converged:
        return _unknown(f"no static state: {richer.static(preload).note}")
    a, b = problem.system(preload), richer.system(preload)
    embedded = [embed_between(problem, richer, a, b, preload, peak.y) for peak in tops.peaks]
    if richer.harmonic_numbers != problem.harmonic_numbers:
        found = None
        if tops.place != "end":
            found = _solved(b, embedded, tops)
        elif len(tops.peaks) == 1:
            found = _change_at_frequency(b, embedded[0], tops.peaks[0])
        if found is not None:
            return found
    peak = tops.peaks[0]
    interval = tops.interval or (0.85 * peak.frequency, 1.2 * peak.frequency)
    curve = uninterrupted(track(richer, preload, interval))
    if not curve.complete:
        return _unknown(f"no whole curve: {curve.reason}")
    top = curve.peak
    if curve.peak_at_end and tops.place != "end":
        return _unknown(f"the richer curve is highest at {top.frequency:.6g} Hz, an end of the interval")
    return top.amplitude / peak.amplitude - 1.0, top.frequency / peak.frequency - 1.0, 0.0, "found anew by a whole curve"


def _solved(system: HarmonicSystem, embedded: list[NDArray], tops: Tops) -> Change | None:
    """The highest of the peaks to which Newton's method leads from each; None if it fails, or leads to another one."""
    best: Peak | None = None
    for y, peak in zip(embedded, tops.peaks):
        found = find_peak(system, y, options=LOOSE)
        changes = found.amplitude / peak.amplitude - 1.0, found.frequency / peak.frequency - 1.0
        if not found.converged or max(map(abs, changes)) > 1.0 - NEARLY_HIGHEST:
            return None
        best = found if best is None or found.amplitude > best.amplitude else best
    assert best is not None
    first = tops.peaks[0]
    return best.amplitude / first.amplitude - 1.0, best.frequency / first.frequency - 1.0, 0.0, "solved"


def _change_at_frequency(system: HarmonicSystem, y: NDArray, peak: Peak) -> Change | None:
    """To the response of another system at the frequency of a point."""
    for search in (False, True):
        c = system.correct_at(y[:-1], float(y[-1]), peak_scale(system, y, y[-1]), 1e-9, 60 if search else 20, search)
        if c.status == OK:
            change = float(abs(system.response(c.y[:-1])[1])) / peak.amplitude - 1.0
            return change, 0.0, 0.0, "solved at the end of the interval"
    return None


def _missed_events(problem: Problem, preload: float, y: NDArray) -> tuple[float, float, int]:
    """Change towards the limit of many samples, extrapolated from two numbers of them."""
    exact = problem.system(preload)
    n = 512 * max(2, exact.n_harmonics)
    r = [np.empty(exact.n_unknowns), np.empty(exact.n_unknowns)]
    for samples, out in zip((n, 2 * n), r):
        dense = problem.sharing(["static_states"], evaluation=Sampled(samples))
        dense.system(preload).core.evaluate(np.ascontiguousarray(y), out)
    e = estimate_change(exact, y, (4.0 * r[1] - r[0]) / 3.0)
    return e.amplitude, e.frequency, 2 * n


# ---- richer studies ----


@dataclass(frozen=True)
class Richer:
    """A study that is richer than another in one source of error, and in what."""

    problem: Problem
    text: str


def richer_study(problem: Problem, source: str) -> Richer | str | None:
    """A study that is richer in one respect, why there is none, or None where the source is no concern of the study."""
    return {
        "harmonics": _more_harmonics,
        "evaluation": _exact_events,
        "contact points": _more_points,
        "modes": _more_modes,
        "residual flexibility": _residual_modes,
    }[source](problem)


def missing_harmonics(problem: Problem, top: int) -> list[int]:
    """Harmonics up to the top one for which the model has no modes."""
    out = []
    for l in range(2, top + 1):
        d, _ = problem.model.folded_nodal_diameter(problem.engine_order * (1 if problem.single_basis else l))
        if any(body.kind == "constrained" and d not in body.bases for body in problem.model.bodies.values()):
            out.append(l)
    return out


def with_stand_ins(problem: Problem, harmonics: int | tuple[int, ...]) -> Problem:
    """The study with harmonics for which modes of the fundamental's nodal diameter stand in where the model has none."""
    lacking = missing_harmonics(problem, harmonic_numbers(harmonics)[-1])
    if not lacking:
        return problem.with_effects(replace(Effects.of(problem), harmonics=harmonics))
    return replace(problem, model=_model_with_stand_ins(problem, lacking), harmonics=harmonics)


def _model_with_stand_ins(problem: Problem, harmonics: list[int]) -> Model:
    model = problem.model
    own, _ = model.folded_nodal_diameter(problem.engine_order)
    bodies = {}
    for name, body in model.bodies.items():
        bases = dict(body.bases)
        if body.kind == "constrained":
            for l in harmonics:
                bases.setdefault(model.folded_nodal_diameter(problem.engine_order * l)[0], bases[own])
        bodies[name] = replace(body, bases=bases)
    return replace(model, bodies=bodies)


def _more_harmonics(problem: Problem) -> Richer | str:
    own = problem.harmonic_numbers
    top = min(own[-1] + max(4, own[-1]), MAX_HARMONIC)
    if top == own[-1]:
        return f"there are no more than {MAX_HARMONIC} harmonics"
    lacking = missing_harmonics(problem, top)
    text = f"harmonics 1 to {top}"
    if lacking:
        text += f", with the modes of the first for {lacking[0]} and more"
    return Richer(with_stand_ins(problem, top), text)


def _exact_events(problem: Problem) -> Richer | None:
    if not isinstance(problem.evaluation, Sampled):
        return None
    finer = finer_evaluation(problem, problem.harmonic_numbers[-1])
    if finer.evaluation == "exact":
        return Richer(finer, "exact events")
    dense = Sampled(4 * problem.evaluation.n_time)
    return Richer(replace(problem, evaluation=dense), f"{dense.n_time} samples")


def finer_evaluation(problem: Problem, harmonics: int) -> Problem:
    """The study with exact events; with coupled friction, which has none, with 32 samples for each harmonic at least."""
    if not isinstance(problem.evaluation, Sampled):
        return problem
    try:
        return replace(problem, evaluation="exact")
    except SettingError:
        return replace(problem, evaluation=Sampled(max(problem.evaluation.n_time, 128, 32 * harmonics)))


def _more_points(problem: Problem) -> Richer | str:
    full = problem.most_points
    if problem.contact_points is None or problem.contact_points >= full:
        return "the model has no more contact points"
    return Richer(replace(problem, contact_points=None), f"{full} contact points on a face")


def _more_modes(problem: Problem) -> Richer | str:
    blade, damper = problem.most_modes("constrained"), max(problem.most_modes("free"), problem.damper_modes)
    if isinstance(problem.contact_stiffness, ResidualModes) or problem.contact_stiffness == "residual_modes":
        blade = min(blade, max(BLADE_MODES, 2 * problem.blade_modes))
        damper = min(damper, max(BLADE_MODES, 2 * problem.damper_modes))
    if blade <= problem.blade_modes and damper <= problem.damper_modes:
        return "the model has no more modes"
    text = f"{blade} modes" + (f", {damper} elastic modes of the damper" if damper else "")
    return Richer(replace(problem, blade_modes=max(blade, problem.blade_modes), damper_modes=damper), text)


def _residual_modes(problem: Problem) -> Richer | None:
    if problem.stiffness_method not in ("unit_traction", "eq4"):
        return None
    return Richer(replace(problem, contact_stiffness="residual_modes"), "residual modes")


Estimated = TypeVar("Estimated", Curve, OptimalCurve)


@one_thread
def with_errors(problem: Problem, result: Estimated, *, sources: Sequence[str] = SOURCES) -> Estimated:
    """The same tracking or optimal curve with estimated errors of its highest peak (of that at its optimum).

    It prints them in one line and saves them.  Where a ladder says what more harmonics change (:mod:`bdamper.util.ladder`),
    that is the error by harmonics.
    """
    validate.instance("result", result, (Curve, OptimalCurve), "a Curve or an OptimalCurve of this study")
    sources = validate.names("sources", sources, SOURCES)
    ladder = result.ladder.estimates(()) if result.ladder is not None and "harmonics" in sources else None
    if ladder is None or not ladder["harmonics"].known:
        return replace(result, error_estimates=estimate_errors(problem, result, sources=sources))
    rest = tuple(source for source in sources if source != "harmonics")
    errors: ErrorEstimates = estimate_errors(problem, result, sources=rest) if rest else replace(ladder, sources=())
    return replace(result, error_estimates=replace(errors, sources=(ladder["harmonics"], *errors.sources)))
