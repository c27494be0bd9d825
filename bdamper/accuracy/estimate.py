"""Error estimates of a peak by source: what richer settings would change.

For each source the peak is compared with the highest point of a whole curve of a richer problem.  With more harmonics that
takes long: there the converged peak is embedded in the richer problem, Newton's method goes on to the peak there (at an end
of the interval: to the response at this frequency), and the whole curve is followed only if it fails.  Lower peaks of the
curve that could become the highest are carried over with it (:mod:`bdamper.effects.richer`).  Where the richer response is
highest at an end of the interval and that of the curve is not, the resonance has left the interval, which is then widened
there by up to 39 % of the frequency.  The residual left is small: its effect follows from one Newton step
(:func:`bdamper.effects.indicator.estimate_change`).

Nothing is concluded from poorer settings.  A source for which the model has nothing richer, or whose richer curve cannot be
followed, is not estimated, and says why.

``harmonics``
    As many more as there are, at least four; where the model lacks a nodal diameter the modes of the fundamental stand in.
``evaluation``
    Samples against exact events.
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
from dataclasses import replace
from typing import NamedTuple, TypeVar

import numpy as np

from bdamper.contact.laws import Sampled
from bdamper.contact.residual_modes import ResidualModes
from bdamper.continuation.curve import Curve, uninterrupted
from bdamper.continuation.track import check_curve, track
from bdamper.effects.indicator import estimate_change
from bdamper.effects.richer import Tops, compare
from bdamper.model.coupling import RIGID_NAMES
from bdamper.peaks.highest import NEAR, highest_of_curve
from bdamper.peaks.newton import Peak
from bdamper.peaks.optimal_curve import OptimalCurve
from bdamper.problem.effects import BLADE_MODES, MAX_HARMONIC, Effects, harmonic_numbers
from bdamper.problem.problem import Problem
from bdamper.util import validate
from bdamper.util.blas import one_thread
from bdamper.util.errors import BdamperError, SettingError
from bdamper.util.estimates import ErrorEstimates, SourceError

SOURCES = ("harmonics", "evaluation", "contact points", "modes", "residual flexibility", "solver")


@one_thread
def estimate_errors(
    problem: Problem, result: Curve | Peak | OptimalCurve, preload: float | None = None, *, sources: Sequence[str] = SOURCES
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
    validate.instance("result", result, (Curve, Peak, OptimalCurve), "a Curve, a Peak or an OptimalCurve of this study")
    begin = time.perf_counter()
    location = 0.0, 0.0
    if isinstance(result, OptimalCurve):
        best, found = result.optimum, _at_optimum(problem, result)
        if isinstance(found, str):
            items = tuple(SourceError(source, np.nan, np.nan, np.inf, found) for source in sources)
            return ErrorEstimates(best.preload, best.frequency, best.amplitude, items, time.perf_counter() - begin)
        result = found
    if isinstance(result, Curve):
        check_curve(problem, result)
        tops = replace(Tops.of(problem, result), follow=not result.peak_at_end)
        top = result.peak if result.peak_at_end == tops.at_end else tops.peaks[0]  # an end may be higher than the peak
        preload, amplitude, frequency = result.preload, top.amplitude, top.frequency
        location = tops.peaks[0].amplitude / amplitude - 1.0, tops.peaks[0].frequency / frequency - 1.0
    else:
        preload = _preload_of(problem, result, preload)
        amplitude, frequency = result.amplitude, result.frequency
        tops = Tops((result,))
    items = tuple(item for s in sources if (item := _of_source(problem, s, preload, tops, location)) is not None)
    return ErrorEstimates(preload, frequency, amplitude, items, time.perf_counter() - begin)


def _at_optimum(problem: Problem, result: OptimalCurve) -> Curve | str:
    """A tracking curve at the preload of the optimum (at any, if it is flat), or why none can stand for it."""
    n = problem.n_unknowns
    if result.model_hash != problem.model.hash or result.unknowns.shape[1] != n:
        expected = f"an optimal curve of this model and of this study with {n} unknowns"
        raise SettingError(f"result: expected {expected}, found another")
    best = result.optimum
    if best.kind == "none":
        return f"the optimal curve has no optimum ({best.status.partition(': ')[2]})"
    preload = float(result.preload[-1]) if best.kind == "flat" else best.preload
    curve = uninterrupted(track(problem, preload, tuple(result.settings["frequency"])))
    if not curve.complete:
        return f"no whole curve at {preload:.6g} N: {curve.reason}"
    top = highest_of_curve(problem.system(preload), curve).peak
    if not abs(top.amplitude / best.amplitude - 1.0) <= NEAR:
        return f"the curve at {preload:.6g} N is highest at {top.amplitude:.6g} m, not {best.amplitude:.6g} m"
    return curve


def _preload_of(problem: Problem, peak: Peak, preload: float | None) -> float:
    """The preload of a converged peak of this problem, that it carries or that is given."""
    validate.require(peak.converged, "peak", "a converged one", f"status '{peak.status}'")
    preload = peak.parameter if preload is None else problem.check_preload(preload)
    if not np.isfinite(preload):
        raise SettingError("preload is required: this peak has no stored preload")
    n = problem.system(preload).n_unknowns
    validate.require(len(peak.y) == n + 1, "peak", f"one of this study with {n} unknowns", len(peak.y) - 1)
    return preload


def _of_source(
    problem: Problem, source: str, preload: float, tops: Tops, location: tuple[float, float]
) -> SourceError | None:
    begin = time.perf_counter()
    peak = tops.peaks[0]

    def result(amplitude: float, frequency: float, text: str) -> SourceError:
        uncertainty = 0.0 if np.isfinite(amplitude) else np.inf
        return SourceError(source, float(amplitude), float(frequency), uncertainty, text, time.perf_counter() - begin)

    if source == "solver":
        e = estimate_change(problem.system(preload), peak.y)
        text = f"residual {peak.residual:.1e}" + (", place of the peak on the curve" if any(location) else "")
        return result(e.amplitude + location[0], e.frequency + location[1], text)
    try:
        richer = richer_study(problem, source)
        if richer is None:
            return None
        if isinstance(richer, str):
            return result(np.nan, np.nan, richer)
        by_newton = richer.problem.harmonic_numbers != problem.harmonic_numbers
        found = compare(problem, richer.problem, preload, tops, by_newton)
    except BdamperError as error:
        return result(np.nan, np.nan, str(error))
    return result(found.amplitude, found.frequency, f"{richer.text}; {found.how}" if found.known else found.how)


# ---- richer studies ----


class Richer(NamedTuple):
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
        d, _ = problem.model.folded_nodal_diameter(problem.engine_order * (1 if problem.settings.single_basis else l))
        if any(body.kind == "constrained" and d not in body.bases for body in problem.model.bodies.values()):
            out.append(l)
    return out


def with_stand_ins(problem: Problem, harmonics: int | tuple[int, ...]) -> Problem:
    """The study with harmonics for which modes of the fundamental's nodal diameter stand in where the model has none."""
    lacking = missing_harmonics(problem, harmonic_numbers(harmonics)[-1])
    if not lacking:
        return problem.with_effects(replace(Effects.of(problem), harmonics=harmonics))
    model, bodies = problem.model, {}
    own, *others = (model.folded_nodal_diameter(problem.engine_order * l)[0] for l in (1, *lacking))
    for name, body in model.bodies.items():
        lent = {d: body.bases[own] for d in others if body.kind == "constrained" and d not in body.bases}
        bodies[name] = replace(body, bases={**body.bases, **lent})
    return problem.with_(model=replace(model, bodies=bodies), harmonics=harmonics)


def _more_harmonics(problem: Problem) -> Richer | str:
    own = problem.harmonic_numbers
    top = min(own[-1] + max(4, own[-1]), MAX_HARMONIC)
    if top == own[-1]:
        return f"there are no more than {MAX_HARMONIC} harmonics"
    lacking = missing_harmonics(problem, top)
    text = f"harmonics 1 to {top}" + (f", with the modes of the first for {lacking[0]} and more" if lacking else "")
    return Richer(with_stand_ins(problem, top), text)


def _exact_events(problem: Problem) -> Richer | None:
    if not isinstance(problem.settings.evaluation, Sampled):
        return None
    finer = finer_evaluation(problem, problem.harmonic_numbers[-1])
    if finer.settings.evaluation == "exact":
        return Richer(finer, "exact events")
    dense = Sampled(4 * problem.settings.evaluation.n_time)
    return Richer(problem.with_(evaluation=dense), f"{dense.n_time} samples")


def finer_evaluation(problem: Problem, harmonics: int) -> Problem:
    """The study with exact events; with coupled friction, which has none, with 32 samples for each harmonic at least."""
    if not isinstance(problem.settings.evaluation, Sampled):
        return problem
    try:
        return problem.with_(evaluation="exact")
    except SettingError:
        return problem.with_(evaluation=Sampled(max(problem.settings.evaluation.n_time, 128, 32 * harmonics)))


def _more_points(problem: Problem) -> Richer | str:
    full = problem.settings.most_points
    if problem.settings.contact_points is None or problem.settings.contact_points >= full:
        return "the model has no more contact points"
    return Richer(problem.with_(contact_points=None), f"{full} contact points on a face")


def _more_modes(problem: Problem) -> Richer | str:
    s = problem.settings
    own, blade = s.by_body("damper_modes"), s.most_modes("constrained")
    rich = {name: problem.model.bodies[name].bases[0].n_natural - len(RIGID_NAMES) for name in own}
    if isinstance(s.contact_stiffness, ResidualModes) or s.contact_stiffness == "residual_modes":
        blade = min(blade, max(BLADE_MODES, 2 * s.blade_modes))
        rich = {name: min(most, max(BLADE_MODES, 2 * own[name])) for name, most in rich.items()}
    if blade <= s.blade_modes and rich == own:
        return "the model has no more modes"
    counts = " and ".join(map(str, sorted(set(rich.values()) - {0})))
    text = f"{blade} modes" + (f", {counts} elastic modes of the damper" if counts else "")
    modes = rich if len(set(rich.values())) > 1 else max(rich.values(), default=0)
    return Richer(problem.with_(blade_modes=max(blade, s.blade_modes), damper_modes=modes), text)


def _residual_modes(problem: Problem) -> Richer | None:
    if problem.stiffness_method not in ("unit_traction", "eq4"):
        return None
    return Richer(problem.with_(contact_stiffness="residual_modes"), "residual modes")


Estimated = TypeVar("Estimated", Curve, OptimalCurve)


@one_thread
def with_errors(problem: Problem, result: Estimated, *, sources: Sequence[str] = SOURCES) -> Estimated:
    """The same tracking or optimal curve with estimated errors of its highest peak (of that at its optimum).

    It prints them in one line and saves them.

    Parameters
    ----------
    problem : Problem
    result : Curve or OptimalCurve
        Of this problem.
    sources : sequence of str
        What to estimate: "harmonics", "evaluation", "contact points", "modes", "residual flexibility", "solver".
    """
    validate.instance("result", result, (Curve, OptimalCurve), "a Curve or an OptimalCurve of this study")
    sources = validate.names("sources", sources, SOURCES)
    return replace(result, error_estimates=estimate_errors(problem, result, sources=sources))
