"""Error estimates of a peak by source: what richer settings would change.

For each source the peak is compared with the highest point of a whole curve of a richer problem.  With more harmonics that
takes long: there the converged peak is embedded in the richer problem, Newton's method goes on to the peak there (at an end
of the interval: to the response at this frequency), and the whole curve is followed only if it fails.  Lower peaks of the
curve that could become the highest are carried over with it (:mod:`bdamper.analyses.refined_peak`).  Where the richer
response is highest at an end of the interval and that of the curve is not, the resonance has left the interval, which is
then widened there by up to 39 % of the frequency.

Nothing is concluded from poorer settings.  A source for which the model has nothing richer, or whose richer curve cannot be
followed, is not estimated, and says why.

``harmonics``
    As many more as there are, at least four; where the model lacks a nodal diameter the modes of the fundamental stand in.
``contact_forces``
    Samples against exact events.
``contact points``
    United patches against the patches of the model.
``modes``
    Twice as many modes with residual modes, which leave an error that falls with the fourth power of the frequency of the
    first mode left out (at least as many as a blade has by default, since twice none would be none); otherwise, where
    convergence is slow, all modes of the model.
``residual flexibility``
    Contact stiffness by a diagonal rule against residual modes, which carry all of it for the stuck modes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from bdamper.analyses.change_estimate import Change
from bdamper.analyses.refined_peak import Tops, compare
from bdamper.contact.law_codes import AFT
from bdamper.contact.residual_flexibility import ResidualModes
from bdamper.harmonic_balance.effects import BLADE_MODES, MAX_HARMONIC, Effects, harmonic_numbers
from bdamper.harmonic_balance.problem import Problem
from bdamper.harmonic_balance.result_checks import check_result
from bdamper.model.kinematics import RIGID_NAMES
from bdamper.response.curve import ResponseCurve
from bdamper.response.error_estimate_result import ErrorEstimates, SourceError
from bdamper.response.peak import Peak
from bdamper.response.response_curve import check_curve
from bdamper.util import validation
from bdamper.util.errors import BdamperError, SettingError
from bdamper.util.threading import one_thread

SOURCES = ("harmonics", "contact_forces", "contact points", "modes", "residual flexibility")


@one_thread
def estimate_errors(problem: Problem, result: ResponseCurve | Peak, *, sources: Sequence[str] = SOURCES) -> ErrorEstimates:
    """Estimated errors of a peak by source.

    Parameters
    ----------
    problem : Problem
        That the result was computed with.
    result : ResponseCurve or Peak
        Of a response curve the highest peak is taken.
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
    sources = validation.names("sources", sources, SOURCES)
    validation.instance("result", result, (ResponseCurve, Peak), "a ResponseCurve or a Peak of this study")
    if isinstance(result, ResponseCurve):
        check_curve(problem, result)
        preload = result.preload
        tops = replace(Tops.of(problem, result), follow=not result.peak_at_end)
    else:
        validation.require(result.converged, "peak", "a converged one", f"status '{result.status}'")
        check_result(problem, result, "peak")
        preload, tops = result.parameter, Tops((result,))
    top = tops.peaks[0]
    items = tuple(item for s in sources if (item := _of_source(problem, s, preload, tops)) is not None)
    return ErrorEstimates(preload, top.frequency, top.amplitude, items)


def _of_source(problem: Problem, source: str, preload: float, tops: Tops) -> SourceError | None:
    try:
        richer = richer_study(problem, source)
        if richer is None:
            return None
        by_newton = richer.problem.harmonic_numbers != problem.harmonic_numbers
        found = compare(problem, richer.problem, preload, tops, by_newton)
        how = f"{richer.text}; {found.how}" if found.known else found.how
    except BdamperError as error:
        found, how = Change(np.nan, np.nan, np.inf), str(error)
    return SourceError(source, *found[:3], how)


# ---- richer studies ----


class Richer(NamedTuple):
    """A study that is richer than another in one source of error, and in what."""

    problem: Problem
    text: str


def richer_study(problem: Problem, source: str) -> Richer | None:
    """A study that is richer in one respect, or None where the source is no concern of the study.

    Raises
    ------
    BdamperError
        If there is none, with the reason.
    """
    return {
        "harmonics": _more_harmonics,
        "contact_forces": _exact_events,
        "contact points": _more_points,
        "modes": _more_modes,
        "residual flexibility": _residual_modes,
    }[source](problem)


def missing_harmonics(problem: Problem, top: int) -> list[int]:
    """Harmonics up to the top one for which the model has no modes."""
    out = []
    for l in range(2, top + 1):
        d, _ = problem.model.folded_nodal_diameter(
            problem.engine_order * (1 if problem.settings.fundamental_modes_only else l)
        )
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
    return problem.replace(model=replace(model, bodies=bodies), harmonics=harmonics)


def _more_harmonics(problem: Problem) -> Richer:
    own = problem.harmonic_numbers
    top = min(own[-1] + max(4, own[-1]), MAX_HARMONIC)
    if top == own[-1]:
        raise BdamperError(f"there are no more than {MAX_HARMONIC} harmonics")
    lacking = missing_harmonics(problem, top)
    text = f"harmonics 1 to {top}" + (f", with the modes of the first for {lacking[0]} and more" if lacking else "")
    return Richer(with_stand_ins(problem, top), text)


def _exact_events(problem: Problem) -> Richer | None:
    own = problem.settings.contact_forces
    if not isinstance(own, AFT):
        return None
    try:
        return Richer(problem.replace(contact_forces="event_driven"), "exact events")
    except SettingError:  # there are none with coupled friction
        return Richer(problem.replace(contact_forces=AFT(4 * own.n_time)), f"{4 * own.n_time} samples")


def _more_points(problem: Problem) -> Richer:
    full = problem.settings.most_points
    if problem.settings.contact_points is None or problem.settings.contact_points >= full:
        raise BdamperError("the model has no more contact points")
    return Richer(problem.replace(contact_points=None), f"{full} contact points on a face")


def _more_modes(problem: Problem) -> Richer:
    s = problem.settings
    own, blade = s.by_body("damper_modes"), s.most_modes("constrained")
    rich = {name: problem.model.bodies[name].bases[0].n_natural - len(RIGID_NAMES) for name in own}
    if isinstance(s.contact_stiffness, ResidualModes) or s.contact_stiffness == "residual_modes":
        blade = min(blade, max(BLADE_MODES, 2 * s.blade_modes))
        rich = {name: min(most, max(BLADE_MODES, 2 * own[name])) for name, most in rich.items()}
    if blade <= s.blade_modes and rich == own:
        raise BdamperError("the model has no more modes")
    counts = " and ".join(map(str, sorted(set(rich.values()) - {0})))
    text = f"{blade} modes" + (f", {counts} elastic modes of the damper" if counts else "")
    modes = rich if len(set(rich.values())) > 1 else max(rich.values(), default=0)
    return Richer(problem.replace(blade_modes=max(blade, s.blade_modes), damper_modes=modes), text)


def _residual_modes(problem: Problem) -> Richer | None:
    if problem.stiffness_method not in ("unit_traction", "cigeroglu2009"):
        return None
    return Richer(problem.replace(contact_stiffness="residual_modes"), "residual modes")


@one_thread
def with_errors(problem: Problem, curve: ResponseCurve, *, sources: Sequence[str] = SOURCES) -> ResponseCurve:
    """The same response curve with estimated errors of its highest peak, which it prints in one line and saves.

    Parameters
    ----------
    problem : Problem
    curve : ResponseCurve
        Of this problem.
    sources : sequence of str
        What to estimate: "harmonics", "evaluation", "contact points", "modes", "residual flexibility".
    """
    validation.instance("curve", curve, ResponseCurve)
    return replace(curve, error_estimates=estimate_errors(problem, curve, sources=sources))
