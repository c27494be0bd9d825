"""Error estimates of a peak by source: what richer settings would change.

For each source the peak is compared with the highest point of a whole curve of a richer problem.  With more harmonics that
takes long: there the converged peak is embedded in the richer problem, Newton's method goes on to the peak there (at an end
of the interval: to the response at this frequency), and the whole curve is followed only if it fails.  Lower peaks of the
curve that could become the highest are carried over with it (:mod:`bdamper.analyses.error_estimates`).  Where the richer
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

The change of a peak from one study to another, without computing the other peak.

A converged solution ``y = (u, omega)`` of one system is embedded in another one, richer or leaner: modes and harmonics that
both have keep their amplitudes, others are at rest or left out, and the mean keeps its distance from the static state.
There the residual ``R`` of the other system is not zero.  At a peak of the response the amplitude ``A`` is stationary along
the curve, so it does not matter at which point of the other curve it is compared; the phase of the response is held, which
follows a resonance that moves:

    B = [ J  R_omega ; grad(phase)  0 ],      B^T lambda = (grad A, 0),      B^T mu = (0, 1),
    dA = -lambda . R,                          domega = -mu . R.

One Jacobian of the other system and one factorisation give both.  ``R`` a second time, at ``y - B^-1 R``, tells how far
the linear estimate holds: what the same weights make of it is the *defect*, the part of the change that it has missed.

An estimate with its defect is an order of magnitude, to tell the small from what has to be computed.  On a test
rig (five harmonics, without separation) the estimated change of amplitude is +5.6 %, its defect 3.7 % and the true
change +1.3 %.

One question, asked of a problem and of a richer or leaner one: value, change, cost and status.

A *question* is a function that asks a problem for its highest point: a response curve (:func:`whole_curve`), a peak, or
amplitude and frequency.  :func:`ask` says what comes of it.  :func:`compare` says what another problem changes of an answer
that is known: where Newton's method leads from the peak to that of the other problem without changing it much, that is its
answer; otherwise its whole curve is followed.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bdamper.contact.laws import AFT
from bdamper.contact.residual_flexibility import ResidualModes
from bdamper.harmonic_balance.effects import BLADE_MODES, MAX_HARMONIC, Effects, harmonic_numbers
from bdamper.harmonic_balance.equations import OK, Equations, norm2
from bdamper.harmonic_balance.problem import Problem
from bdamper.harmonic_balance.result_checks import check_result
from bdamper.model.kinematics import RIGID_NAMES
from bdamper.response.highest_peak import highest_of_curve, maxima
from bdamper.response.peak import Peak, amplitude_and_phase, find_peak, same_peak
from bdamper.response.response_curve import check_curve, frequency_response
from bdamper.response.response_curve_result import ResponseCurve, uninterrupted
from bdamper.response.verification import ErrorEstimates, SourceError
from bdamper.util import validation
from bdamper.util.errors import COMPLETE, BdamperError, SettingError, status_word
from bdamper.util.formatting import short_text
from bdamper.util.progress import one_thread

# ---- The change of a peak from one study to another, without computing the other peak ----


class Change(NamedTuple):
    """Relative change that another study makes to a peak.

    Parameters
    ----------
    amplitude, frequency : float
        NaN if they are not known.
    uncertainty : float
        What the change may miss: 0 if it was computed, the defect of an estimate, infinite if nothing is known.
    how : str
        How it was found, or why not.
    """

    amplitude: float
    frequency: float
    uncertainty: float = 0.0
    how: str = ""

    @property
    def known(self) -> bool:
        """Whether it was found."""
        return bool(np.isfinite(self.amplitude))

    @property
    def size(self) -> float:
        """Largest relative change, with what it may miss; infinite if not known."""
        size = max(abs(self.amplitude), abs(self.frequency)) + self.uncertainty
        return float(size) if np.isfinite(size) else np.inf


def embed(old: Problem, new: Problem, preload: float, y: NDArray) -> NDArray:
    """A point of one study as a point of a study with other effects.

    Modes that both have keep their amplitudes, others are at rest; the mean keeps its distance from the static state.

    Parameters
    ----------
    old, new : Problem
    preload : float, N
    y : (n_unknowns + 1,) float
        Of the old study.

    Returns
    -------
    (n_unknowns + 1,) float
    """
    a, b = old.system(preload), new.system(preload)
    out = np.zeros(b.n_unknowns + 1)
    out[-1] = y[-1]
    if b.n_mean:
        before, after = old.static(preload).q, new.static(preload).q
        out[: b.n_mean] = after
        if a.n_mean:
            at, to = _common(a.structure.bases[0].coordinates, b.structure.bases[0].coordinates)
            out[to] += y[at] - before[at]
    for l in range(1, min(a.n_harmonics, b.n_harmonics) + 1):
        at, to = _common(a.structure.bases[l].coordinates, b.structure.bases[l].coordinates)
        for from_part, to_part in zip(a.layout.slices(l), b.layout.slices(l)):
            out[to_part.start + to] = y[from_part.start + at]
    return out


@lru_cache(maxsize=256)
def _common(a: tuple[Any, ...], b: tuple[Any, ...]) -> tuple[NDArray, NDArray]:
    place = {c: i for i, c in enumerate(b)}
    pairs = [(i, place[c]) for i, c in enumerate(a) if c in place]
    return np.array([i for i, _ in pairs], int), np.array([j for _, j in pairs], int)


def estimate_change(system: Equations, y: NDArray) -> Change:
    """Change of the peak from the point ``y`` to the solutions of a system that ``y`` does not solve.

    It is unknown where the equations of the system are not finite.

    Parameters
    ----------
    system : Equations
    y : (n_unknowns + 1,) float
        A peak of another system, embedded.
    """
    n, unknown = system.n_unknowns, Change(np.nan, np.nan, np.inf, "no estimate")
    if system.core.evaluate(np.ascontiguousarray(y), r := np.empty(n)) != OK:
        return unknown
    grow, turn, amplitude = amplitude_and_phase(system, y[:-1])
    scale = np.full(n + 1, max(norm2(y[system.n_mean : -1]), 1e-300))
    scale[n] = y[-1]
    border = np.append(turn, 0.0) * scale
    border /= max(norm2(border), 1e-300)
    weights = np.zeros((2, n + 1))  # d ln(amplitude) and d ln(frequency)
    weights[0, :n], weights[1, n] = grow / max(amplitude, 1e-300) * scale[:n], 1.0
    try:  # a mean position that nothing holds stays where it is
        dual = system.solve_linear(y, border, scale, weights, transposed=True)[:, :n]
        step = system.solve_linear(y, border, scale, np.append(-r, 0.0)[None])[0]
    except FloatingPointError:
        return unknown
    change = -(dual @ r)
    new = y + step * scale
    again = np.empty(n)
    if not new[-1] > 0.0 or system.core.evaluate(new, again) != OK:
        return unknown
    missed = dual @ again
    return Change(float(change[0]), float(change[1]), float(np.abs(missed).max()), "estimated")


# ---- One question, asked of a problem and of a richer or leaner one ----


Question = Callable[[Problem], Any]
NEARLY_HIGHEST = 0.7
"""Height over that of the highest peak, from which on a lower one is carried over with it.

A peak that changes by more than the rest, 30 %, may leave the top to one that is not carried over, so then a whole curve is
taken.  In the scenes of ``benchmarks.estimate_scenes`` the changes that Newton's method finds are at most 6 %, and those of
whole curves to 1e-4.
"""
WIDER = 1.05, 1.1, 1.2
"""By how much an interval is widened, one after the other, where the resonance has left it: 39 % in all."""


class Answer(NamedTuple):
    """What a question came to.

    Parameters
    ----------
    amplitude, frequency : float, m, Hz
        NaN if they are not known.
    why : str
        Why not; "" if they are.
    seconds : float
        Of the processor.
    result : ResponseCurve, Peak or tuple of float, or None
    """

    amplitude: float
    frequency: float
    why: str
    seconds: float
    result: Any


def ask(problem: Problem, question: Question) -> Answer:
    """The answer of a problem, in this thread; a failure is an answer, too."""
    begin, result = time.thread_time(), None
    try:
        result = question(problem)
        amplitude, frequency, why = _read(problem, result)
    except (BdamperError, ArithmeticError, np.linalg.LinAlgError) as error:
        amplitude, frequency, why = np.nan, np.nan, str(error)
    return Answer(float(amplitude), float(frequency), why, time.thread_time() - begin, result)


def _read(problem: Problem, result: Any) -> tuple[float, float, str]:
    """Amplitude, frequency, and why they are not known."""
    if not isinstance(result, ResponseCurve | Peak):
        try:
            amplitude, frequency = (float(value) for value in result)
        except (TypeError, ValueError):
            what = "a ResponseCurve, a Peak, or amplitude (m) and frequency (Hz)"
            raise SettingError(f"answer: expected {what}, found {short_text(result)}") from None
        return amplitude, frequency, ""
    if isinstance(result, Peak):
        known, why = (
            result.converged and status_word(result.search_status) == COMPLETE,
            f"status '{result.status}', scan {result.search_status}",
        )
    else:
        known, why = result.complete, f"{result.status}: {result.reason}"
    if not known:
        return np.nan, np.nan, why
    if isinstance(result, ResponseCurve):
        result = highest_of_curve(problem.system(result.preload), result).peak if result.peak_at_end else result.peak
    return result.amplitude, result.frequency, ""


def whole_curve(
    problem: Problem, preload: float, frequency: tuple[float, float], at_end: bool = False, wider: tuple | None = None
) -> ResponseCurve:
    """A response curve; an error where it has no point or, unless ``at_end``, no maximum within the interval.

    With factors ``wider`` it is an error, too, if an end is higher than every maximum.  The interval is first widened by
    them, one after the other, at the end at which the response is highest.
    """
    curve = uninterrupted(frequency_response(problem, preload, frequency))
    why = "" if len(curve) else curve.reason
    if not why and not at_end and curve.peak_at_end:
        if wider:
            low, high = frequency
            upward = 2.0 * curve.peak.frequency > low + high
            frequency = (low, high * wider[0]) if upward else (low / wider[0], high)
            return whole_curve(problem, preload, frequency, wider=wider[1:])
        if wider is not None or highest_of_curve(problem.system(preload), curve).kind == "end":
            why = "the response is highest at an end"
    if why:
        raise BdamperError(f"no peak at {preload:g} N between {frequency[0]:.6g} and {frequency[1]:.6g} Hz: {why}")
    return curve


@dataclass(frozen=True)
class Tops:
    """The highest peak of a study under one preload, and what else may become the highest.

    Parameters
    ----------
    peaks : tuple of Peak
        The highest first.
    interval : (low, high), Hz, or None
        Of the curve that they are from.
    at_end : bool
        Whether the highest is an end of the interval, which is no maximum.
    follow : bool
        Whether the interval is widened where the peak leaves it: not if an end is already higher, on the flank of another.
    """

    peaks: tuple[Peak, ...]
    interval: tuple[float, float] | None = None
    at_end: bool = False
    follow: bool = False

    @classmethod
    def of(cls, problem: Problem, curve: ResponseCurve) -> Tops:
        """The highest point of a response curve and the peaks nearly as high, refined."""
        system = problem.system(curve.preload)
        top = highest_of_curve(system, curve)
        lower = (p for p in maxima(system, curve, NEARLY_HIGHEST) if not same_peak(p, top.peak))
        return cls((top.peak, *lower), (float(curve.frequency.min()), float(curve.frequency.max())), top.kind == "end")


def compare(problem: Problem, other: Problem, preload: float, tops: Tops, by_newton: bool = False) -> Change:
    """How the highest peak changes from one problem to another under one preload (N).

    Parameters
    ----------
    problem, other : Problem
    preload : float, N
    tops : Tops
        Of the first problem.
    by_newton : bool
        Whether Newton's method is tried from its peaks before the whole curve of the other problem is followed.
    """
    state, peak = other.static(preload), tops.peaks[0]
    if not state.converged:
        return Change(np.nan, np.nan, np.inf, f"no static state: {state.note}")
    if by_newton:
        system = other.system(preload)
        embedded = [embed(problem, other, preload, top.y) for top in tops.peaks]
        found = _at_frequency(system, embedded, peak) if tops.at_end else _solved(system, embedded, tops)
        if found is not None:
            return found
    interval = tops.interval or (0.85 * peak.frequency, 1.2 * peak.frequency)
    answer = ask(other, lambda p: whole_curve(p, preload, interval, tops.at_end, WIDER if tops.follow else None))
    beyond = "" if interval[0] <= answer.frequency <= interval[1] else ", beyond the interval"
    return _change(peak, answer, f"no whole curve: {answer.why}" if answer.why else f"found anew by a whole curve{beyond}")


def _change(before: Peak, after: Answer | Peak, how: str) -> Change:
    a, f = after.amplitude / before.amplitude - 1.0, after.frequency / before.frequency - 1.0
    return Change(a, f, 0.0 if np.isfinite(a) else np.inf, how)


def _solved(system: Equations, embedded: list[NDArray], tops: Tops) -> Change | None:
    """The highest of the peaks to which Newton's method leads from each; None if it fails, or leads to another one."""
    found = []
    for y, peak in zip(embedded, tops.peaks):
        found.append(find_peak(system, y))
        change = _change(peak, found[-1], "")
        if not found[-1].converged or max(abs(change.amplitude), abs(change.frequency)) > 1.0 - NEARLY_HIGHEST:
            return None
    return _change(tops.peaks[0], max(found, key=lambda p: p.amplitude), "solved")


def _at_frequency(system: Equations, embedded: list[NDArray], peak: Peak) -> Change | None:
    """To the response of another system at the frequency of a point, if nothing else may become the highest."""
    y = embedded[0]
    for search in (False, True) if len(embedded) == 1 else ():
        c = system.correct_at(y[:-1], float(y[-1]), system.units(y, y[-1]), 1e-9, 60 if search else 20, search)
        if c.status == OK:
            change = float(abs(system.response(c.y[:-1])[1])) / peak.amplitude - 1.0
            return Change(change, 0.0, how="solved at the end of the interval")
    return None


# ---- Error estimates of a peak by source ----


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
        validation.check(result.converged, "peak", "a converged one", f"status '{result.status}'")
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
