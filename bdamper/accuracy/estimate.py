"""Error estimates of a peak by source: what richer settings would change.

For each source the converged peak is embedded in a richer problem; the change of amplitude and frequency follows from one
Newton step there (:func:`bdamper.effects.indicator.estimate_change`).  Where that step cannot be trusted (a large change,
or a second residual that contradicts it), or the curve is highest at an end of its interval, the peak is compared with the
highest point of a whole curve of the richer problem.  Curves with more harmonics take long: there Newton goes on to the
peak first (at an end of the interval: to the response at this frequency), and the whole curve is followed only if it fails.
An estimate that may miss more than it finds is unknown.

``harmonics``
    As many more as there are, at least eight; where the model lacks a nodal diameter the modes of the fundamental stand in.
``evaluation``
    Samples against exact events.  Exact events against dense samples: there the sampling error itself, some 1e-6, is the
    most that missed events can hide behind.
``contact points``
    United patches against the patches of the model.  For the patches of the model themselves the change to half as many
    is taken, with the sign turned: an error that falls with the number of points or faster is not larger.
``modes``
    All modes of the model.  Where there are no more, the change to half as many is taken, times one third: with residual
    flexibility modes converge with the fourth power of the frequency of the first one left out.
``residual flexibility``
    Contact stiffness by a diagonal rule against residual modes, which carry all of it for the stuck modes.
``solver``
    The residual that is left, and the place of the peak between points of a curve.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bdamper.contact.laws import Sampled
from bdamper.continuation.curve import Curve, uninterrupted
from bdamper.continuation.track import check_curve, track
from bdamper.effects.indicator import embed_between, estimate_change, estimate_or_unknown
from bdamper.harmonic_balance.system import OK
from bdamper.model.model import Model
from bdamper.peaks.newton import Peak, PeakOptions, find_peak, peak_scale
from bdamper.problem.effects import MAX_HARMONIC, Effects, harmonic_numbers
from bdamper.problem.problem import Problem
from bdamper.util import validate
from bdamper.util.blas import one_thread
from bdamper.util.errors import BdamperError, SettingError
from bdamper.util.estimates import ErrorEstimates, SourceError

SOURCES = ("harmonics", "evaluation", "contact points", "modes", "residual flexibility", "solver")
TRUSTED = 0.01
"""Relative change up to which one Newton step is enough if nothing contradicts it."""
POINTS_FACTOR = 1.0
"""Error of n contact points over the change to n/2 of them."""
ANOTHER = 0.3
"""Relative change beyond which the highest point of a richer curve may be elsewhere."""
LOOSE = PeakOptions(tolerance=1e-8, position_tolerance=1e-3)
"""How exactly the peak of the richer problem is found."""
MODES_FACTOR = 1.0 / 3.0
"""Error of n modes over the change to n/2 of them."""


@dataclass(frozen=True)
class Richer:
    """A study that differs from another in one source of error.

    Parameters
    ----------
    problem : Problem
    factor : float
        What the change is to be multiplied by: 1 for a richer study, negative for a poorer one.
    text : str
    """

    problem: Problem
    factor: float
    text: str


@one_thread
def estimate_errors(
    problem: Problem,
    result: Curve | Peak,
    preload: float | None = None,
    *,
    sources: Sequence[str] = SOURCES,
) -> ErrorEstimates:
    """Estimated errors of a peak by source.

    Parameters
    ----------
    problem : Problem
        That the result was computed with.
    result : Curve or Peak
        Of a tracking curve the highest peak is taken.
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
    validate.instance("result", result, (Curve, Peak), "a Curve or a Peak of this study")
    begin = time.perf_counter()
    problem = problem.matching(result.settings)
    if isinstance(result, Curve):
        check_curve(problem, result)
        preload, amplitude, frequency = result.preload, result.peak.amplitude, result.peak.frequency
        peak, end_of = _top_of(problem, result)
    else:
        preload = _preload_of(problem, result, preload)
        peak, end_of, amplitude, frequency = result, None, result.amplitude, result.frequency
    location = peak.amplitude / amplitude - 1.0, peak.frequency / frequency - 1.0
    items = [_of_source(problem, source, preload, peak, end_of, location) for source in sources]
    found = tuple(item for item in items if item is not None)
    return ErrorEstimates(preload, frequency, amplitude, found, time.perf_counter() - begin)


def _top_of(problem: Problem, curve: Curve) -> tuple[Peak, tuple[float, float] | None]:
    """The highest peak of a curve, refined; the interval (Hz) if the curve is highest at an end of it."""
    top = curve.peak
    end_of = (float(curve.frequency.min()), float(curve.frequency.max())) if curve.point_kind[top.index] == "end" else None
    y = np.append(curve.unknowns[top.index], 2.0 * np.pi * top.frequency)
    peak = find_peak(problem.system(curve.preload), y)
    near = abs(peak.amplitude / top.amplitude - 1.0) < 0.05 and abs(peak.frequency / top.frequency - 1.0) < 0.02
    many = isinstance(problem.evaluation, Sampled)  # samples make many small peaks
    if not (peak.converged and near) or end_of or many:
        peak = replace(
            peak, y=y, frequency=top.frequency, amplitude=top.amplitude, residual=float(curve.residual[top.index]),
            status="converged",
        )  # fmt: skip
    return peak, end_of


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
    problem: Problem,
    source: str,
    preload: float,
    peak: Peak,
    end_of: tuple[float, float] | None,
    location: tuple[float, float],
) -> SourceError | None:
    begin = time.perf_counter()

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
        if end_of:
            amplitude, frequency, uncertainty, how = change_at_end(problem, richer.problem, preload, peak, end_of)
        else:
            amplitude, frequency, uncertainty, how = change_of_peak(problem, richer.problem, preload, peak)
    except BdamperError as error:
        return result(np.nan, np.nan, np.inf, str(error))
    f = richer.factor
    if uncertainty > max(abs(amplitude), abs(frequency)):
        return result(np.nan, np.nan, np.inf, f"{richer.text}; {how} would miss by more than it finds")
    return result(f * amplitude, f * frequency, abs(f) * uncertainty, f"{richer.text}; {how}")


Change = tuple[float, float, float, str]
"""Relative change of amplitude and of frequency, how much it may miss, and how it was found."""


def _unknown(why: str) -> Change:
    return np.nan, np.nan, np.inf, why


def change_of_peak(problem: Problem, richer: Problem, preload: float, peak: Peak) -> Change:
    """How a peak (of the first problem, under ``preload`` in N) changes with the settings of a richer problem."""
    if not richer.static(preload).converged:
        return _unknown(f"no static state: {richer.static(preload).note}")
    system = richer.system(preload)
    y = embed_between(problem, richer, problem.system(preload), system, preload, peak.y)
    e = estimate_or_unknown(system, y)
    change = max(abs(e.amplitude), abs(e.frequency))
    stationary = not isinstance(problem.evaluation, Sampled)  # samples put corners into a curve, and its top on one of them
    if (stationary and change <= TRUSTED and e.defect <= 0.1 * change) or e.size < 1e-9:
        return e.amplitude, e.frequency, e.defect, "one Newton step"
    for guess in [e.y] * (e.size < ANOTHER) + [y] if richer.harmonic_numbers != problem.harmonic_numbers else []:
        found = find_peak(system, guess, options=LOOSE)
        changes = found.amplitude / peak.amplitude - 1.0, found.frequency / peak.frequency - 1.0
        if found.converged and max(map(abs, changes)) <= ANOTHER:
            return *changes, 0.0, "solved"
    moved = _stuck_resonance(richer, preload, peak.frequency) / _stuck_resonance(problem, preload, peak.frequency)
    around = 0.85 * min(1.0, moved) * peak.frequency, 1.2 * max(1.0, moved) * peak.frequency
    return _change_to_curve(richer, preload, peak, around)


def change_at_end(problem: Problem, richer: Problem, preload: float, peak: Peak, interval: tuple[float, float]) -> Change:
    """The same where a curve is highest at an end of its interval (Hz)."""
    if not richer.static(preload).converged:
        return _unknown(f"no static state: {richer.static(preload).note}")
    system = richer.system(preload)
    y = embed_between(problem, richer, problem.system(preload), system, preload, peak.y)
    for search in (False, True) if richer.harmonic_numbers != problem.harmonic_numbers else ():
        c = system.correct_at(y[:-1], float(y[-1]), peak_scale(system, y, y[-1]), 1e-9, 60 if search else 20, search)
        if c.status == OK:
            change = float(abs(system.response(c.y[:-1])[1])) / peak.amplitude - 1.0
            return change, 0.0, 0.0, "solved at the end of the interval"
    return _change_to_curve(richer, preload, peak, interval)


def _change_to_curve(richer: Problem, preload: float, peak: Peak, interval: tuple[float, float]) -> Change:
    """From a peak to the highest point of the whole curve of the richer problem."""
    curve = uninterrupted(track(richer, preload, interval))
    if not curve.complete:
        return _unknown(f"no whole curve: {curve.reason}")
    top = curve.peak
    return top.amplitude / peak.amplitude - 1.0, top.frequency / peak.frequency - 1.0, 0.0, "found anew by a whole curve"


def _stuck_resonance(problem: Problem, preload: float, frequency: float) -> float:
    """Frequency in Hz of the largest stuck resonance within a third of a frequency, or this itself."""
    system, springs = problem.system(preload), problem.stuck_springs(problem.static(preload))
    row = problem.response_rows[1]
    poles = [w for w in system.linear_modes(springs)[0] if 0.67 < w / (2.0 * np.pi * frequency) < 1.5]
    best = max(poles, key=lambda w: abs(system.linear_response(w, springs) @ row), default=2.0 * np.pi * frequency)
    return float(best) / (2.0 * np.pi)


def _missed_events(problem: Problem, preload: float, y: NDArray) -> tuple[float, float, int]:
    """Change towards the limit of many samples, extrapolated from two numbers of them."""
    exact = problem.system(preload)
    n = 512 * max(2, exact.n_harmonics)
    r = [np.empty(exact.n_unknowns), np.empty(exact.n_unknowns)]
    for samples, out in zip((n, 2 * n), r):
        dense = replace(problem, evaluation=Sampled(samples))
        dense.share_static_states(problem)
        dense.system(preload).core.evaluate(np.ascontiguousarray(y[:-1]), float(y[-1]), out)
    e = estimate_change(exact, y, (4.0 * r[1] - r[0]) / 3.0)
    return e.amplitude, e.frequency, 2 * n


# ---- richer studies ----


def richer_study(problem: Problem, source: str) -> Richer | None:
    """A study that is richer in one respect, or poorer where there is nothing richer; None if there is neither."""
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


def _more_harmonics(problem: Problem) -> Richer:
    own = problem.harmonic_numbers
    top = min(own[-1] + max(8, own[-1]), MAX_HARMONIC)
    lacking = missing_harmonics(problem, top)
    text = f"harmonics 1 to {top}"
    if lacking:
        text += f", with the modes of the first for {lacking[0]} and more"
    return Richer(with_stand_ins(problem, top), 1.0, text)


def _exact_events(problem: Problem) -> Richer | None:
    if not isinstance(problem.evaluation, Sampled):
        return None
    finer = finer_evaluation(problem, problem.harmonic_numbers[-1])
    if finer.evaluation == "exact":
        return Richer(finer, 1.0, "exact events")
    dense = Sampled(4 * problem.evaluation.n_time)
    return Richer(replace(problem, evaluation=dense), 1.0, f"{dense.n_time} samples")


def finer_evaluation(problem: Problem, harmonics: int) -> Problem:
    """The study with exact events; with coupled friction, which has none, with 32 samples for each harmonic at least."""
    if not isinstance(problem.evaluation, Sampled):
        return problem
    try:
        return replace(problem, evaluation="exact")
    except SettingError:
        return replace(problem, evaluation=Sampled(max(problem.evaluation.n_time, 128, 32 * harmonics)))


def points_on_a_face(problem: Problem) -> int:
    """Largest number of contact points on a friction face of the model."""
    return max((f.n_points for f in problem.model.interfaces.values() if f.kind == "friction"), default=0)


def _more_points(problem: Problem) -> Richer | None:
    full = points_on_a_face(problem)
    if problem.contact_points is not None and problem.contact_points < full:
        return Richer(replace(problem, contact_points=None), 1.0, f"{full} contact points on a face")
    if full < 2:
        return None
    half = full // 2
    return Richer(
        replace(problem, contact_points=half), -POINTS_FACTOR, f"from {half} contact points on a face to those of the model"
    )


def _more_modes(problem: Problem) -> Richer | None:
    bodies = problem.model.bodies.values()
    blade = [min(b.n_modes for b in body.bases.values()) for body in bodies if body.kind == "constrained"]
    damper = [body.bases[0].n_modes - 6 for body in bodies if body.kind == "free"]
    most = max(blade, default=0)
    elastic = max(min(damper, default=0), problem.damper_modes)
    if most > problem.blade_modes:
        text = f"{most} modes" + (f", {elastic} elastic modes of the damper" if damper else "")
        return Richer(replace(problem, blade_modes=most, damper_modes=elastic), 1.0, text)
    own = min(problem.blade_modes, most)
    if own < 2:
        return None
    return Richer(
        replace(problem, blade_modes=own // 2), -MODES_FACTOR, f"from {own // 2} to {own} modes, all that the model has"
    )


def _residual_modes(problem: Problem) -> Richer | None:
    if problem.contact_stiffness not in ("unit_traction", "eq4"):
        return None
    return Richer(replace(problem, contact_stiffness="residual_modes"), 1.0, "residual modes")


@one_thread
def with_errors(problem: Problem, curve: Curve, *, sources: Sequence[str] = SOURCES) -> Curve:
    """The same tracking curve with estimated errors of its highest peak, which it prints and saves."""
    validate.instance("curve", curve, Curve)
    return replace(curve, error_estimates=estimate_errors(problem, curve, sources=sources))
