"""Time integration at one preload: the highest steady-state amplitude with its error, and single
motions.

**Structure.**  A response curve may retain few modes, because its cost increases with their number;
in time integration, modes cost little.  The integration therefore has all stored modes of the
constrained bodies.  A free body is rigid in time, unless its first elastic frequency is below
:data:`RIGID_BEYOND` times the frequency of the highest harmonic (:func:`structure_in_time`).

**Error.**  The search (``bdamper.time_domain.steady_amplitude``) uses n time steps per period.
Where contacts chatter it takes twice the given number.  From its highest motion

* 4n time steps are used, because contacts may chatter only with shorter steps;
* the motion continues in a more detailed structure: all elastic modes of the free bodies, and
  :data:`VECTORS` residual modes for the flexibility of the contact faces;
* its amplitude is extrapolated up to the frequency at which it falls.

The range of the result extends beyond these amplitudes by the remaining change of the mean, at
least the 1 % to which a motion settles.  If two of them differ by more than 5 %, the amplitude is
not settled, and only the range is stated.  If a motion falls after a
refinement, the refinement is repeated from the next highest motions, because all of these settings
affect the frequency at which a motion falls.
"""

from __future__ import annotations

import time
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bdamper.contact.residual_flexibility import ResidualModes
from bdamper.harmonic_balance.problem import Problem
from bdamper.model.kinematics import RIGID_NAMES
from bdamper.response.continuation import TWO_PI
from bdamper.response.followed_peak import with_verdict
from bdamper.response.optimal_curve_result import OptimalCurve
from bdamper.response.optimum_checks import FAIR
from bdamper.response.peak import Peak
from bdamper.response.response_curve import check_curve, frequency_response
from bdamper.response.response_curve_result import ResponseCurve, uninterrupted
from bdamper.response.verification import MotionInTime, TimeResponse, energy_change
from bdamper.time_domain.integration import (
    STEPS,
    AllSectors,
    EnergyGained,
    IntegrationFailed,
    TimeLimit,
    TimeSpent,
    all_sectors,
    transfer,
)
from bdamper.time_domain.steady_amplitude import BalanceCurve, SteadySearch
from bdamper.time_domain.transient import (
    CRITERIA,
    UNDECIDED,
    SteadyPoint,
    Transient,
    Verdict,
    judged,
    outside,
    repeats_after,
    second_half,
    step_error,
    to_come,
)
from bdamper.util import validation
from bdamper.util.errors import (
    COMPLETE,
    INCOMPLETE,
    INTERRUPTED,
    NOT_FOUND,
    BdamperError,
    Ending,
    SettingError,
    quiet,
    warn_implausible,
)
from bdamper.util.formatting import amount, counted, peak_text
from bdamper.util.progress import (
    Cost,
    CostMeter,
    LongWork,
    is_part_of_work,
    one_thread,
    progress_stages,
    shows_progress,
)
from bdamper.util.storage import FinishedParts
from bdamper.util.workers import on_threads

NEIGHBOUR = 1.35
"""Ratio of a second preload, at which time integration follows if it does not confirm the optimum,
to the preload of the optimum: the amplitude rises steeply below it and slowly above.
"""
RIGID_BEYOND = 3.0
"""Ratio of the first elastic frequency of a free body to the highest harmonic above which the body
is rigid in time.
"""
SECONDS = 300.0
"""Processor time of one result in time, about three times that of the longest response of the
shipped studies.
"""
VECTORS = 24
"""Residual modes per harmonic of the more detailed structure."""

# ---- structures in time ----


def structure_in_time(problem: Problem, frequency: float) -> tuple[Problem, str]:
    """Return the problem with the modes for the integration near a frequency (Hz), and a
    description of these modes.
    """
    settings = problem.settings
    blade_modes = settings.most_modes("constrained")
    in_curve = min(settings.blade_modes, blade_modes)
    texts = []
    if blade_modes > 0:
        texts.append(
            f"{in_curve} of {blade_modes} blade modes in the curve, all of them in time integration"
        )

    highest_harmonic = max(problem.harmonic_numbers, default=1)
    frequency_ratios = _first_elastic(problem, frequency * highest_harmonic)
    elastic_modes = _all_elastic(problem)
    damper_modes = settings.by_body("damper_modes")
    for name, ratio in frequency_ratios.items():
        # the highest harmonic excites the elastic modes of this body
        if ratio <= RIGID_BEYOND:
            damper_modes[name] = max(damper_modes[name], elastic_modes[name])
        if np.isfinite(ratio):
            kind = "elastic" if damper_modes[name] else "rigid"
            texts.append(
                f"{name} {kind}, first elastic frequency {ratio:.3g} times the highest harmonic"
            )

    structure = _with_modes(
        problem,
        max(blade_modes, settings.blade_modes),
        damper_modes,
        settings.contact_stiffness,
    )
    if structure is None:
        return problem, f"{in_curve} blade modes"
    return structure, "; ".join(texts)


def richer_structure(problem: Problem) -> tuple[Problem, str] | None:
    """Return a structure with all elastic modes and more residual modes, and its name, or None if
    there is none.
    """
    settings = problem.settings
    elastic_modes = _all_elastic(problem)
    damper_modes_now = settings.by_body("damper_modes")
    damper_modes = {name: max(n, elastic_modes[name]) for name, n in damper_modes_now.items()}

    stiffness = settings.contact_stiffness
    name = "all modes"
    if problem.contact.residual is not None:
        method = _few_residual_modes(problem)
        if method is not None:
            stiffness = replace(method, n_vectors=VECTORS)
            name = f"all modes, {VECTORS} residual modes"

    if damper_modes == damper_modes_now and stiffness is settings.contact_stiffness:
        return None
    richer = _with_modes(problem, settings.blade_modes, damper_modes, stiffness)
    if richer is None:
        return None
    return richer, name


def _few_residual_modes(problem: Problem) -> ResidualModes | None:
    """Return the settings of residual modes if they are fewer than in the structure with more modes."""
    method = problem.stiffness_method
    if method == "residual_modes":
        method = ResidualModes()
    if not isinstance(method, ResidualModes) or method.n_vectors == "all":
        return None
    return method if method.n_vectors < VECTORS else None


def _with_modes(
    problem: Problem, blade_modes: int, damper_modes: Mapping[str, int], stiffness: Any
) -> Problem | None:
    """Return the problem with these numbers of modes and contact stiffness; None if the model does
    not allow it.
    """
    # one number for all bodies, as a user gives it, if they agree
    of_dampers: Any = dict(damper_modes)
    if len(set(damper_modes.values())) <= 1:
        of_dampers = max(damper_modes.values(), default=0)
    wanted = {
        "blade_modes": blade_modes,
        "damper_modes": of_dampers,
        "contact_stiffness": stiffness,
    }
    changes = {}
    for name, value in wanted.items():
        value_now = getattr(problem.settings, name)
        # stiffnesses may be arrays, whose comparison has no truth value
        unchanged = value is value_now or value == value_now
        if not unchanged:
            changes[name] = value
    if not changes:
        return problem
    try:
        with quiet():
            changed = problem.replace(**changes)
            # the modes are selected, and refused, when they are first needed
            _ = changed.bases
    except BdamperError:
        return None
    return changed


def _all_elastic(problem: Problem) -> dict[str, int]:
    """Return the number of elastic modes of each free body."""
    bodies = problem.model.bodies
    return {name: bodies[name].n_elastic for name in problem.settings.free_bodies}


def _first_elastic(problem: Problem, frequency: float) -> dict[str, float]:
    """Return the first elastic frequency of each free body over a frequency (Hz); infinite without
    elastic modes.
    """
    ratios = {}
    n_rigid = len(RIGID_NAMES)
    for name, n_elastic in _all_elastic(problem).items():
        if n_elastic <= 0:
            ratios[name] = float("inf")
            continue
        # lowest over the nodal diameters; the rigid-body modes have the lowest frequencies
        bases = problem.model.bodies[name].bases.values()
        squared = min(np.sort(basis.omega2)[n_rigid] for basis in bases)
        first_elastic = np.sqrt(squared)
        ratios[name] = float(first_elastic / (TWO_PI * frequency))
    return ratios


# ---- highest steady amplitude ----


@one_thread
def time_response(
    problem: Problem,
    result: ResponseCurve | Peak,
    *,
    steps_per_period: int | None = None,
    blades: int | None = None,
    starts: int = 1,
    seconds: float = SECONDS,
    progress: bool | None = None,
) -> TimeResponse:
    """See :meth:`bdamper.Study.time_response`."""
    limit = TimeLimit(validation.number("seconds", seconds, above=0.0, unit="s"))
    starts = validation.integer("starts", starts, least=1)
    steps = STEPS
    if steps_per_period is not None:
        steps = validation.integer("steps_per_period", steps_per_period, least=16)
    if isinstance(result, Peak):
        result = _curve_of_peak(problem, result)
    check_curve(problem, result)
    if result.peak_at_end:
        highest = peak_text(result.peak.amplitude, result.peak.frequency, 6)
        raise SettingError(
            "curve: expected a curve with a peak, found its highest amplitude at its end, "
            f"{highest}"
        )

    watch = CostMeter()
    balance = BalanceCurve(result)
    preload = result.preload
    with limit.counted():
        structure, text = structure_in_time(problem, result.peak.frequency)
        held = _held_in_structure(problem, structure, result)
    without_amplitude = TimeResponse(
        mean=np.nan,
        lowest=np.nan,
        highest=np.nan,
        frequency=np.nan,
        preload=preload,
        balance=result.peak.amplitude,
        structure=text,
        **problem.recorded(),
    )
    if not np.isfinite(balance.flank):
        why = "all frequencies near the peak have several solutions; widen the interval"
        return replace(without_amplitude, status=NOT_FOUND, reason=why)

    sectors = all_sectors(structure, preload, blades, limit)
    if held is not None:
        balance = BalanceCurve(held)
    has_its_modes = held is not None or structure is problem
    source = sectors if has_its_modes else all_sectors(problem, preload, blades, limit)
    progress = shows_progress(progress)
    search = SteadySearch(sectors, source, balance, steps)
    # the progress bar names the amplitude that is known already
    known = amount(result.peak.amplitude, "m")
    what = (
        f"time integration at {amount(preload, 'N')} ({known} by harmonic balance), "
        f"{counted(sectors.n, 'blade')}"
    )
    integrations = _integrate(search, structure, preload, blades, starts, what, progress)
    if integrations.step_error and not integrations.stopped:
        # shorter steps resolve the contacts better, so the search begins again
        first = integrations
        search = SteadySearch(sectors, source, balance, 4 * steps)
        integrations = _integrate(search, structure, preload, blades, starts, what, progress)
        search.periods += first.search.periods
        integrations = replace(integrations, cost=first.cost + integrations.cost)

    modes_in_time = structure.settings.blade_modes
    more_modes_in_time = modes_in_time != problem.settings.blade_modes
    if search.best is None and search.failure and more_modes_in_time:
        # the curve may have its peak where the structure in time has none
        search.failure += (
            f"; try a response curve with blade_modes={modes_in_time}, as in time integration"
        )
    without_amplitude = replace(
        without_amplitude,
        periods=search.periods,
        diameters=sectors.nodal_diameters,
        cost=watch.read(sectors.cost + integrations.cost),
        jump_frequency=search.fall,
    )
    doubt_about_curve = ""
    if not result.complete:
        doubt_about_curve = f"there may be a higher peak, as the curve is {result.status}"
        if result.reason:
            doubt_about_curve += f" ({result.reason})"
    response = _stated(without_amplitude, integrations, doubt_about_curve)
    if integrations.interrupted and is_part_of_work():
        raise InterruptedResponse(response)
    return response


def _held_in_structure(
    problem: Problem, structure: Problem, curve: ResponseCurve
) -> ResponseCurve | None:
    """Return the response curve of joints that friction holds at rest, with the modes of the time integration.

    The friction forces that hold a joint belong to the modes with which they were computed.  With
    those of fewer modes a shroud slips in the first periods, and does not come back to the locked
    motion.  The result is None if nothing is held, or if the curve has no peak.
    """
    if structure is problem or problem.at(curve.preload).residual is None:
        return None
    interval = (float(curve.frequency.min()), float(curve.frequency.max()))
    held = uninterrupted(frequency_response(structure, curve.preload, interval))
    has_peak = held.complete and not held.peak_at_end
    return held if has_peak and np.isfinite(BalanceCurve(held).flank) else None


class InterruptedResponse(KeyboardInterrupt):
    """Interruption by Ctrl-C of a time response within another analysis.

    Parameters
    ----------
    response : TimeResponse
        Result of the motions so far.
    """

    def __init__(self, response: TimeResponse) -> None:
        super().__init__(response)
        self.response = response


@dataclass(frozen=True)
class _Integrations:
    """Motions of one search, with one number of time steps per period.

    Parameters
    ----------
    search : SteadySearch
    runs : dict of str to SteadyPoint
        The highest motion, with refinements.
    starts : dict of str to float, m
        Amplitudes reached from different initial states.
    step_error : str
        Why the time steps are too long, or "".
    time_spent : str
        That the processor time is used up, or "".
    interrupted : bool
    cost : Cost
        Cost of the more detailed structure.
    """

    search: SteadySearch
    runs: dict[str, SteadyPoint]
    starts: dict[str, float]
    step_error: str
    time_spent: str
    interrupted: bool
    cost: Cost

    @property
    def stopped(self) -> bool:
        """Whether the user or the limit of the processor time ended the integrations."""
        return self.interrupted or bool(self.time_spent)


def _integrate(
    search: SteadySearch,
    structure: Problem,
    preload: float,
    blades: int | None,
    starts: int,
    what: str,
    progress: bool,
) -> _Integrations:
    """Search for the highest motion, and refine it.

    ``blades`` is the number of blades of the ring (None for the smallest), ``starts`` the number of
    initial states, ``what`` the name of the work in the progress bar.  After Ctrl-C, a failure
    or the end of the processor time the result has the motions so far.
    """
    runs: dict[str, SteadyPoint] = {}
    others: dict[str, float] = {}
    richer: _RicherRing | None = None
    error = ""
    time_spent = ""
    interrupted = False
    with LongWork() as work, progress_stages(progress, what, "step") as report:
        # the search, shorter steps, the more detailed structure, and one run for each other start
        n_runs = 2 + starts
        search.on_frequency = lambda frequency: report(f"{frequency:.6g} Hz", len(runs), n_runs)
        try:
            search.run()
            best = search.best
            if best is not None:
                error = step_error(best.transient)
            if best is not None and not error:
                structure_and_name = richer_structure(structure)
                if structure_and_name is not None:
                    richer_problem, name = structure_and_name
                    of_richer = all_sectors(richer_problem, preload, blades, search.sectors.limit)
                    richer = _RicherRing(name, of_richer)
                _add_refinements(search, best, richer, starts, runs, others)
        except TimeSpent as spent:
            time_spent = str(spent)
        except IntegrationFailed as failed:
            search.failure = str(failed)
            # motions from before the failure still count
            if isinstance(failed, EnergyGained) or search.best is None:
                error = str(failed)
        except KeyboardInterrupt:
            # longer work receives it with the result, see time_response
            interrupted = True
    # the order in which they ended depends on the threads: first those with steps as names
    names = [_steps_name(search, factor) for factor in (1, 4)]
    names += [name for name in runs if name not in names]
    in_order = {name: runs[name] for name in names if name in runs}
    return _Integrations(
        search=search,
        runs=in_order,
        starts=others,
        step_error=error,
        time_spent=time_spent,
        interrupted=interrupted or work.interrupted,
        cost=Cost() if richer is None else richer.sectors.cost,
    )


@dataclass(frozen=True)
class _RicherRing:
    """Name of a more detailed structure, and all its sectors."""

    name: str
    sectors: AllSectors


def _steps_name(search: SteadySearch, factor: int) -> str:
    """Return the name of a motion with ``factor`` times the steps of the search."""
    return f"{factor * search.steps} steps"


def _add_refinements(
    search: SteadySearch,
    best: SteadyPoint,
    richer: _RicherRing | None,
    starts: int,
    runs: dict[str, SteadyPoint],
    others: dict[str, float],
) -> None:
    """Add the highest motion and its refinements to ``runs``, other initial states to ``others``.

    Finished motions stay there after Ctrl-C or a failure.
    """
    runs[_steps_name(search, factor=1)] = best
    if search.blades_part(best):
        # another motion may last as well, and the start decides which one is found
        starts = max(starts, 2)
    # refinements start from the highest motion; if it does not stay, from the next two
    lower = [point for point in search.points if point is not best]
    highest_first = sorted(lower, key=lambda point: -point.mean)
    points = [best, *highest_first[:2]]

    def with_shorter_steps() -> None:
        runs[_steps_name(search, factor=4)] = _refine(search, points, search.sectors, step_factor=4)

    def from_other_starts() -> None:
        others.update(_other_starts(search, best, starts))

    def in_richer_structure() -> None:
        if richer is not None:
            runs[richer.name] = _refine(search, points, richer.sectors, step_factor=1)

    on_threads([with_shorter_steps, in_richer_structure, from_other_starts])


def _curve_of_peak(problem: Problem, peak: Peak) -> ResponseCurve:
    """Return the response curve of a peak in its interval."""
    expected = "the highest peak of this study at its preload"
    if not peak.ok or "frequency" not in peak.settings:
        raise validation.invalid("result", "a peak at a preload", peak.status)
    if peak.model_hash != problem.model.hash:
        raise validation.invalid("result", expected, "a peak of another model")
    curve = frequency_response(problem, peak.parameter, tuple(peak.settings["frequency"]))
    if len(curve) == 0:
        raise validation.invalid("result", expected, f"no response curve: {curve.status_text}")
    highest = curve.peak
    on_curve = peak_text(highest.amplitude, highest.frequency, 6)
    found = peak_text(peak.amplitude, peak.frequency, 6)
    validation.check(
        np.isclose(highest.amplitude, peak.amplitude, rtol=1e-3, atol=0.0),
        "result",
        f"{expected}, {on_curve} on its response curve",
        f"{found}; pass the response curve of this study",
    )
    return curve


def _refine(
    search: SteadySearch, points: list[SteadyPoint], sectors: AllSectors, step_factor: int
) -> SteadyPoint:
    """Return the highest motion with ``step_factor`` times the steps, or with more modes.

    A structure with more modes may need shorter steps.

    Raises
    ------
    EnergyGained
        If the steps are too long even if they are four times shorter.
    """
    refined = _with_steps(search, points, sectors, step_factor)
    if step_error(refined.transient):
        refined = _with_steps(search, points, sectors, 4 * step_factor)
    return _balanced(refined)


def _balanced(point: SteadyPoint) -> SteadyPoint:
    """Return the motion, or raise :class:`EnergyGained` if its time steps are too long."""
    error = step_error(point.transient)
    if error:
        raise EnergyGained(error)
    return point


def _with_steps(
    search: SteadySearch, points: list[SteadyPoint], sectors: AllSectors, step_factor: int
) -> SteadyPoint:
    """Return the highest motion that stays with ``step_factor`` times the steps, tried from
    ``points`` in this order.

    If none stays, return the last one that was tried.
    """
    for point in points:
        if not point.stays:
            continue
        motion = point.transient.motion
        if sectors is not search.sectors:
            motion = transfer(search.sectors, motion, sectors)
        # accelerations belong to the steps and the structure that they were computed with
        motion = motion._replace(a=None)
        refined = search.settle_apart(sectors, point.frequency, motion, point.mean, step_factor)
        # a beat that the longer steps had damped needs more periods to show its full range; other
        # steps also move the mean of a periodic motion, which is then known
        varies = refined.deviation > 0.5 * CRITERIA.drift
        # with other modes the motion itself changes, and may still approach its mean
        moved = abs(refined.mean / point.mean - 1.0) > 0.5 * CRITERIA.drift
        approaches = moved and sectors is not search.sectors
        if refined.stays and (varies or approaches):
            latest = refined.transient.motion
            refined = search.settle_apart(
                sectors, point.frequency, latest, refined.mean, step_factor, parting=True
            )
        if refined.stays:
            break
    return refined


def _at_fall(search: SteadySearch) -> float:
    """Return the amplitude (m) of the highest motion, extrapolated to the frequency at which it
    falls.
    """
    best = search.best
    if best is None:
        return float("nan")
    to_fall = search.fall - best.frequency
    # motions on the side of the highest motion without its fall
    behind = []
    for point in search.points:
        is_behind = (point.frequency - best.frequency) * to_fall < 0.0
        if is_behind and point is not best:
            behind.append(point)
    # with motions between the highest one and its fall, the amplitude has a maximum there
    has_maximum_before_fall = len(search.between(search.fall)) > 0
    if not behind or has_maximum_before_fall:
        return best.mean
    # a straight line through the nearest motion behind and the highest one
    nearest = min(behind, key=lambda point: abs(point.frequency - best.frequency))
    rise = (best.mean - nearest.mean) * to_fall / (best.frequency - nearest.frequency)
    return best.mean + max(0.0, rise)


def _other_starts(search: SteadySearch, best: SteadyPoint, starts: int) -> dict[str, float]:
    """Return the amplitudes (m) that other disturbances and tractions of the highest motion lead
    to.
    """
    tractions = search.sectors.tractions(best.transient.motion)
    traction_names = list(tractions)
    amplitudes = {}
    # start 0 is the highest motion itself
    for start in range(1, starts):
        name = traction_names[(start - 1) % len(traction_names)]
        undisturbed = best.transient.motion._replace(w=tractions[name])
        motion = search.sectors.seeded(undisturbed, CRITERIA.seed, start)
        point = search.settle_apart(search.sectors, best.frequency, motion, best.mean)
        amplitudes[f"start {start}, {name}"] = _balanced(point).mean
    return amplitudes


def _stated(
    without_amplitude: TimeResponse, integrations: _Integrations, doubt_about_curve: str
) -> TimeResponse:
    """Return the result of a search: a result without amplitudes, completed by the motions.

    ``doubt_about_curve`` is a doubt about the response curve, or an empty string.
    """
    search = integrations.search
    best = search.best
    spent = _after_limit(integrations)
    # an amplitude to which the time steps supply energy is not a bound either
    if integrations.step_error or best is None:
        why = (
            integrations.step_error
            or spent
            or search.failure
            or "every integration leaves the peak"
        )
        end = _ending(NOT_FOUND, why, integrations.interrupted)
        return replace(without_amplitude, status=end.status, reason=end.reason)

    runs = integrations.runs
    if not runs:
        # interrupted, or failed, before the first refinement
        runs = {_steps_name(search, factor=1): best}
    answers = {name: run.mean for name, run in runs.items()}
    if not np.isnan(search.fall):
        answers["at the jump"] = _at_fall(search)
    starts = integrations.starts
    higher_starts = {name: mean for name, mean in starts.items() if mean > best.mean}
    lowest, highest, doubt_about_range = error_range(answers | higher_starts, runs.values())

    at_end = ""
    if search.at_end(best):
        at_end = "the curve ends before the motion jumps down; widen the interval"
    doubts = [doubt_about_range, spent, search.failure, at_end, doubt_about_curve]
    doubt = "; ".join(filter(None, doubts))
    if doubt:
        end = _ending(INCOMPLETE, doubt, integrations.interrupted)
    else:
        end = _ending(COMPLETE, _remarks(search, best), integrations.interrupted)
    return replace(
        without_amplitude,
        mean=best.mean,
        lowest=lowest,
        highest=highest,
        highest_period=highest_period(runs.values()),
        half_range=best.half_range,
        frequency=best.frequency,
        answers=answers,
        starts=starts,
        status=end.status,
        reason=end.reason,
        **of_blades(best.transient, len(best.amplitude)),
    )


def _after_limit(integrations: _Integrations) -> str:
    """Return the missing part of the work and a remedy if the processor time is used up, or ""."""
    limit = integrations.search.sectors.limit
    if not integrations.time_spent or limit is None:
        return ""
    search = integrations.search
    # motions that are still to be integrated with 1,024 steps, and in the more detailed structure
    missing_periods = 5 * CRITERIA.fewest
    if search.best is None or search.best is search.unsettled:
        missing = "before a motion settled"
        missing_periods += 2 * CRITERIA.lasting
    elif len(integrations.runs) == 0:
        missing = "before the search for the highest motion ended"
        missing_periods += CRITERIA.lasting
    else:
        missing = "before all refinements ended"
    seconds = missing_periods * search.seconds_per_period
    more = f", which takes about {amount(seconds, 's')} more" if seconds > 0.0 else ""
    return f"{integrations.time_spent} {missing}{more}; {limit.remedy}"


def _ending(status: str, reason: str, interrupted: bool) -> Ending:
    """Return a status with its reason, or "interrupted" if the user stopped the integration."""
    return Ending(INTERRUPTED) if interrupted else Ending(status, reason)


def _remarks(search: SteadySearch, best: SteadyPoint) -> str:
    """Return remarks on a complete result: how it was reached, and with which waves."""
    remarks = []
    if search.below < best.mean:
        below = amount(search.below, "m")
        remarks.append(f"from the peak; a sweep from the flank reaches at most {below}")
    n_integrated = len(search.sectors.nodal_diameters)
    n_diameters = search.sectors.n // 2 + 1
    if n_integrated < n_diameters:
        remarks.append(f"{n_integrated} of {n_diameters} nodal diameters were integrated")
    return "; ".join(remarks)


def highest_period(runs: Iterable[SteadyPoint]) -> float:
    """Return the highest amplitude (m) of a single period of the motions that stay."""
    return max(float(run.amplitude.max()) for run in runs if run.stays)


def error_range(
    answers: Mapping[str, float], runs: Collection[SteadyPoint]
) -> tuple[float, float, str]:
    """Return the range (m) of the answers and the reason if it is wide, or "".

    The range is widened by the uncertainty of the means and by the standard deviation of single
    periods: the mean of a motion that is not periodic depends on its start.  It contains the
    highest single period.
    """
    low = min(answers.values())
    high = max(answers.values())
    staying = [run for run in runs if run.stays]
    changes = [abs(run.change) for run in staying]
    change = max(CRITERIA.drift, *changes)
    deviations = [run.deviation for run in staying]
    widening = max(change, *deviations)

    doubts = []
    if high > (1.0 + CRITERIA.tolerance) * low:
        doubts.append("not settled")
    if change > CRITERIA.tolerance:
        doubts.append(f"its mean is uncertain by {100.0 * change:.2g} %")
    lowest = (1.0 - widening) * low
    highest = max((1.0 + widening) * high, highest_period(runs))
    return lowest, highest, "; ".join(doubts)


def of_blades(transient: Transient, periods: int) -> dict[str, Any]:
    """Return the fields of a result that describe all blades, from the last periods of a time
    integration.
    """
    blades = transient.blades[-periods:]
    mean_energy = np.mean(transient.energy[-periods:], axis=0)
    # logarithmic growth of the motion in other waves, per period
    growth = float("nan")
    half = len(transient.harmonics) // 2
    if half:
        ratio = outside(transient, half).growth
        if ratio:
            growth = float(np.log(ratio)) / half
    return {
        "blade": transient.blade,
        "blades": np.abs(blades),
        "waves": transient.sectors.waves(blades),
        "energy": tuple(float(value) for value in mean_energy),
        "growth": growth,
    }


@dataclass(frozen=True)
class _Integrated:
    """Time response at a preload, and the cost of both response curve and integration."""

    response: TimeResponse
    cost: Cost


@one_thread
def with_time_response(
    problem: Problem,
    curve: OptimalCurve,
    preload: Sequence[float] | NDArray | None = None,
    *,
    seconds: float = SECONDS,
    progress: bool | None = None,
    parts: FinishedParts | None = None,
) -> OptimalCurve:
    """See :meth:`bdamper.Study.with_time_response`; ``parts`` are finished integrations."""
    validation.instance("curve", curve, OptimalCurve)
    seconds = validation.number("seconds", seconds, above=0.0, unit="s")
    if curve.model_hash != problem.model.hash:
        raise validation.invalid(
            "curve", "an optimal curve of this study", "a curve of another model"
        )
    progress = shows_progress(progress)
    if preload is None:
        best = curve.optimum.preload
        # none without an optimum
        preloads = [best] if np.isfinite(best) else []
    else:
        preloads = [float(p) for p in validation.numbers("preload", preload, above=0.0, unit="N")]
    responses = {response.preload: response for response in curve.time_response}
    costs: dict[float, Cost] = {}
    complete = {p for p, status in zip(curve.preload, curve.status) if status == COMPLETE}

    parts = parts or FinishedParts()

    def integrated(load: float) -> _Integrated:
        """Follow the response curve at a preload (N), and integrate from its peak."""
        tracked = frequency_response(problem, load, curve.settings["frequency"])
        # at a complete preload of the optimal curve the highest point is known
        if load not in complete:
            tracked = with_verdict(problem, tracked, curve.settings["frequency"])
        tracked = uninterrupted(tracked)
        costs[load] = tracked.cost
        response = time_response(problem, tracked, seconds=seconds, progress=progress)
        return _Integrated(response, tracked.cost + response.cost)

    def integrate(load: float) -> None:
        """Integrate at one preload (N); a failure becomes the status of its response."""
        try:
            name = f"time integration at {load!r} N in {seconds!r} s"
            part = parts.once(name, _Integrated, partial(integrated, load))
            responses[load] = part.response
            costs[load] = part.cost
        except InterruptedResponse as interruption:
            costs[load] += interruption.response.cost
            # an earlier result at this preload has more than its interrupted repetition
            if responses[load].status == INTERRUPTED:
                responses[load] = interruption.response
            raise
        except BdamperError as error:
            responses[load] = replace(
                _not_integrated(curve, load), status=NOT_FOUND, reason=str(error)
            )

    def integrate_all(loads: Sequence[float]) -> None:
        """Integrate at several preloads (N), each of which counts as interrupted until it ends."""
        for load in loads:
            responses.setdefault(load, _not_integrated(curve, load))
        on_threads([partial(integrate, load) for load in loads])

    start = time.perf_counter()
    with LongWork() as work:
        integrate_all(preloads)
        if preload is None and not all(_confirms(responses[p]) for p in preloads):
            # another preload may be better
            integrate_all([NEIGHBOUR * p for p in preloads])
    # the preloads share the time, so their seconds do not add up
    elapsed = curve.cost.seconds + time.perf_counter() - start
    cost = sum((costs[p] for p in sorted(costs)), curve.cost)
    in_order = tuple(responses[p] for p in sorted(responses))
    return replace(
        curve,
        time_response=in_order,
        cost=replace(cost, seconds=elapsed),
        # an interrupt may come when all integrations have ended
        checks_interrupted=curve.checks_interrupted or work.interrupted,
    )


def _confirms(response: TimeResponse) -> bool:
    """Return whether a time response is complete and agrees with harmonic balance.

    The difference may be as large as in a check that is not failed.  The preload of an optimum that
    is confirmed remains recommended.
    """
    change = abs(response.mean / response.balance - 1.0)
    return response.ok and change <= FAIR


def _not_integrated(curve: OptimalCurve, preload: float) -> TimeResponse:
    """Return the result at a preload (N) whose integration has not ended.

    It has the amplitude by harmonic balance if the optimal curve has this preload.
    """
    rows = np.flatnonzero(curve.preload == preload)
    balance = float(curve.amplitude[rows[0]]) if len(rows) else np.nan
    return TimeResponse(
        mean=np.nan,
        lowest=np.nan,
        highest=np.nan,
        frequency=np.nan,
        preload=preload,
        balance=balance,
        status=INTERRUPTED,
    )


# ---- one motion ----


def disturbed(sectors: AllSectors, u: NDArray, omega: float, steps: int | None = None) -> Transient:
    """Return a time integration that starts from a solution (n_unknowns,) perturbed in every nodal
    diameter.
    """
    solution = Transient(sectors, omega, u, steps)
    motion = sectors.seeded(solution.motion, CRITERIA.seed, seed=0)
    return Transient(sectors, omega, motion, solution.steps)


def compare_with_solution(
    transient: Transient,
    expected: NDArray,
    tolerance: float = CRITERIA.tolerance,
    periods: int = CRITERIA.longest,
    progress: bool = False,
) -> tuple[Verdict, bool]:
    """Integrate until it is decided whether the motion stays at a solution.

    ``expected`` (n_harmonics + 1,) contains the mean and the complex amplitudes (m) of the response
    of this solution.

    Returns
    -------
    verdict : Verdict
    interrupted : bool

    Raises
    ------
    IntegrationFailed
        If the time integration fails.
    """

    def is_decided() -> bool:
        return _verdict_so_far(transient, expected, tolerance).verdict != UNDECIDED

    interrupted = transient.run(periods, progress, is_decided)
    # without a single period there is no result to keep
    if not transient.harmonics:
        raise KeyboardInterrupt
    return _verdict_so_far(transient, expected, tolerance), interrupted


def _verdict_so_far(transient: Transient, expected: NDArray, tolerance: float) -> Verdict:
    """Return the verdict on the periods that are known."""
    first_harmonic = float(abs(expected[1]))
    return judged(transient.amplitude, first_harmonic, tolerance, transient.memory)


@dataclass(frozen=True)
class _MotionRun:
    """One time integration from a solution.

    Parameters
    ----------
    transient : Transient
    end : Ending
    decision : dict
        Fields of the result on the decision, empty without one.
    amplitude : (n,) float, m
        Amplitudes that the result states.
    time_spent : bool
        Whether the limit of the processor time ended it.
    """

    transient: Transient
    end: Ending
    decision: dict[str, Any]
    amplitude: NDArray
    time_spent: bool = False

    @property
    def stopped(self) -> bool:
        """Whether the user or the limit of the processor time ended it."""
        return self.end.status == INTERRUPTED or self.time_spent


@one_thread
def motion_in_time(
    problem: Problem,
    curve: ResponseCurve,
    index: int | None = None,
    *,
    frequency: float | None = None,
    periods: int | None = None,
    tolerance: float = CRITERIA.tolerance,
    steps_per_period: int | None = None,
    seconds: float = SECONDS,
    progress: bool | None = None,
) -> MotionInTime:
    """See :meth:`bdamper.Study.motion_in_time`."""
    check_curve(problem, curve)
    validation.check_value(
        len(curve), "curve", "a curve with points", f"no points ({curve.status_text})"
    )
    tolerance = validation.number("tolerance", tolerance, above=0.0, most=1.0)
    limit = TimeLimit(validation.number("seconds", seconds, above=0.0, unit="s"))
    progress = shows_progress(progress)
    # at a frequency of the user the motion is not compared with a solution
    free = frequency is not None
    if frequency is None:
        point = _index_of_point(curve, index)
        frequency = float(curve.frequency[point])
    else:
        frequency = validation.number("frequency", frequency, above=0.0, unit="Hz")
        _check_on_curve(curve, frequency, index)
        point = int(np.abs(curve.frequency - frequency).argmin())

    if free:
        fewest_periods = CRITERIA.look
        default_periods = 200
        steps = STEPS
    else:
        fewest_periods = 1
        default_periods = CRITERIA.longest
        steps = CRITERIA.steps
    if periods is None:
        n_periods = default_periods
    else:
        n_periods = validation.integer("periods", periods, least=fewest_periods)
    if steps_per_period is not None:
        steps = steps_per_period

    watch = CostMeter()
    sectors = all_sectors(problem, curve.preload, limit=limit)
    solution = curve.unknowns[point]
    expected = problem.system(curve.preload).response(solution)
    omega = TWO_PI * frequency

    def with_steps(steps: int) -> _MotionRun:
        transient = disturbed(sectors, solution, omega, steps)
        if free:
            return _without_decision(transient, n_periods, progress)
        return _with_decision(transient, expected, tolerance, n_periods, progress)

    run = None
    try:
        run = with_steps(steps)
        error = step_error(run.transient)
    except IntegrationFailed as failed:
        error = str(failed)
    # shorter steps resolve the contacts better, so the motion begins again
    if run is None or (error and not run.stopped):
        run = with_steps(4 * steps)
        error = step_error(run.transient)
        if error and not run.stopped:
            raise EnergyGained(f"time integration at {frequency:.6g} Hz: {error}")
    amplitude = run.amplitude
    response = run.transient.response
    fields_of_blades = of_blades(run.transient, len(amplitude))
    end = _with_energy(run, fields_of_blades["energy"])
    if error and run.time_spent:
        end = Ending(INCOMPLETE, f"{end.reason}; {error}")
    return MotionInTime(
        mean=float(amplitude.mean()),
        lowest=float(amplitude.min()),
        highest=float(amplitude.max()),
        frequency=frequency,
        preload=curve.preload,
        harmonics=response,
        repeats_after=repeats_after(response),
        diameters=sectors.nodal_diameters,
        status=end.status,
        reason=end.reason,
        cost=watch.read(sectors.cost),
        **run.decision,
        **fields_of_blades,
        **problem.recorded(),
    )


def _index_of_point(curve: ResponseCurve, index: int | None) -> int:
    """Return the index of a point of a curve; by default that of its peak."""
    if index is None:
        return curve.peak_index
    n = len(curve)
    return validation.integer("index of a point", index, -n, n - 1)


def _check_on_curve(curve: ResponseCurve, frequency: float, index: int | None) -> None:
    """Warn about a frequency (Hz) beyond the curve, and refuse an index in addition to it."""
    low = curve.frequency.min()
    high = curve.frequency.max()
    if not low <= frequency <= high:
        warn_implausible("frequency", f"{low:g} to {high:g} Hz, within the curve", f"{frequency:g}")
    if index is not None:
        raise validation.invalid("index", "none, since a frequency is given", index)


def _with_energy(run: _MotionRun, energy: tuple[float, ...]) -> Ending:
    """Return the status, incomplete while the stored energy changes.

    A motion with a verdict has settled, and only exchanges energy with the loads at rest.
    """
    if run.decision or not run.end.ok:
        return run.end
    change = energy_change(energy)
    return Ending(INCOMPLETE, change) if change else run.end


def _without_decision(transient: Transient, periods: int, progress: bool) -> _MotionRun:
    """Integrate a number of periods; the result is incomplete while the mean changes."""
    interrupted = False
    time_spent = ""
    try:
        interrupted = transient.run(periods, progress)
    except TimeSpent as spent:
        time_spent = _spent_after(transient, spent, CRITERIA.look)
    # fewer periods do not show whether the mean changes
    if interrupted and len(transient.harmonics) < CRITERIA.look:
        raise KeyboardInterrupt
    change = to_come(transient.amplitude, transient.memory)
    if interrupted:
        end = Ending(INTERRUPTED)
    elif time_spent:
        end = Ending(INCOMPLETE, time_spent)
    elif abs(change) > CRITERIA.drift:
        percentage = f"{100.0 * change:+.2g} %"
        reason = f"the mean changes by another {percentage} by estimate; use more periods"
        end = Ending(INCOMPLETE, reason)
    else:
        end = Ending()
    stated = second_half(transient.amplitude)
    return _MotionRun(transient, end, {}, stated, time_spent=bool(time_spent))


def _spent_after(transient: Transient, spent: TimeSpent, fewest: int) -> str:
    """Return after how many periods the processor time was spent, with a remedy.

    Raises
    ------
    TimeSpent
        If fewer than ``fewest`` periods are known, which are no result.
    """
    n = len(transient.harmonics)
    limit = transient.sectors.limit
    remedy = "" if limit is None else limit.remedy
    if n < fewest:
        raise TimeSpent(f"{spent} before {counted(fewest, 'period')} ended; {remedy}")
    return f"{spent} after {counted(n, 'period')}; {remedy}"


def _with_decision(
    transient: Transient, expected: NDArray, tolerance: float, periods: int, progress: bool
) -> _MotionRun:
    """Integrate until it is decided whether the response remains ``expected``."""
    interrupted = False
    time_spent = ""
    try:
        verdict, interrupted = compare_with_solution(
            transient, expected, tolerance, periods, progress
        )
    except TimeSpent as spent:
        time_spent = _spent_after(transient, spent, fewest=1)
        verdict = _verdict_so_far(transient, expected, tolerance)
    # distance of the last period from the solution; without the mean, which does not vibrate
    last_period = transient.response[-1]
    apart = float(np.linalg.norm((last_period - expected)[1:]))
    size = float(np.linalg.norm(expected[1:]))
    if interrupted:
        status = INTERRUPTED
    elif verdict.verdict == UNDECIDED:
        status = INCOMPLETE
    else:
        status = COMPLETE
    decision = {
        "balance": float(abs(expected[1])),
        "distance": apart / max(size, 1e-300),
        "verdict": verdict.verdict,
    }
    reason = verdict.reason
    if time_spent and status == INCOMPLETE:
        reason = f"{reason}; {time_spent}"
    stated = transient.amplitude[-verdict.periods :]
    end = Ending(status, reason)
    return _MotionRun(transient, end, decision, stated, time_spent=bool(time_spent))
