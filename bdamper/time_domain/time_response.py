"""Highest steady amplitude in time at one preload, with its error, and one motion in time from a solution.

**Structure.**  A response curve may retain few modes, because its cost grows with them; in time they cost little.  The
integration therefore has all stored modes of the constrained bodies.  A free body is rigid in time, unless its first
elastic frequency is below :data:`RIGID_BEYOND` times the frequency of the highest harmonic (:func:`structure_in_time`).

**Error.**  The search (``bdamper.time_domain.steady_amplitude``) uses n time steps per period.  From its highest motion

* 2n and, from there, 4n time steps are used, because contacts may chatter only with shorter steps;
* the motion continues in a richer structure: all elastic modes of the free bodies, and :data:`VECTORS` residual modes
  for the flexibility of the contact faces;
* its amplitude is extrapolated up to the frequency at which it falls.

The range of the result extends beyond these amplitudes by the remaining change of the mean, at least the 1 % to which a
motion settles.  If two of them differ by more than 5 %, the amplitude is not settled, and only the range is stated.  Where
a motion falls with a refinement, it is repeated from the next highest motions, because the frequency of a fall depends on
all of these settings.
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
from bdamper.response.optimal_curve_result import OptimalCurve
from bdamper.response.peak import Peak
from bdamper.response.response_curve import check_curve, frequency_response
from bdamper.response.response_curve_result import ResponseCurve, uninterrupted
from bdamper.response.verification import MotionInTime, TimeResponse, energy_change
from bdamper.time_domain.integration import (
    STEPS,
    EnergyGained,
    IntegrationFailed,
    Ring,
    ring_of,
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
    SettingError,
    quiet,
    warn_implausible,
    with_reason,
)
from bdamper.util.formatting import amount, counted, peak_text
from bdamper.util.progress import (
    Cost,
    CostMeter,
    LongWork,
    one_thread,
    progress_stages,
    shows_progress,
)
from bdamper.util.workers import on_threads

NEIGHBOUR = 1.35
"""Ratio of the preloads at which an optimum is checked in time: the amplitude rises steeply below it and slowly above."""
RIGID_BEYOND = 3.0
"""Ratio of the first elastic frequency of a free body to the highest harmonic above which the body is rigid in time."""
VECTORS = 24
"""Residual modes per harmonic of the richer structure."""

# ---- structures in time ----


def structure_in_time(problem: Problem, frequency: float) -> tuple[Problem, str]:
    """Return the problem with the modes for the integration near a frequency (Hz), and a text about them."""
    s = problem.settings
    blade, curve = s.most_modes("constrained"), min(s.blade_modes, s.most_modes("constrained"))
    ratios = _first_elastic(problem, frequency * max(problem.harmonic_numbers, default=1))
    elastic = {
        name: n for name, n in _all_elastic(problem).items() if n and ratios[name] <= RIGID_BEYOND
    }
    damper = {name: max(n, elastic.get(name, 0)) for name, n in s.by_body("damper_modes").items()}
    texts = [f"{curve} of {blade} blade modes in the curve, {blade} in time"] * (blade > 0)
    texts += [
        f"{name} {'elastic' if damper[name] else 'rigid'}, first elastic frequency {ratio:.3g} times the highest harmonic"
        for name, ratio in ratios.items() if np.isfinite(ratio)
    ]  # fmt: skip
    text = "; ".join(texts)
    structure = _with_modes(problem, max(blade, s.blade_modes), damper, s.contact_stiffness)
    return (structure, text) if structure is not None else (problem, f"{curve} blade modes")


def richer_structure(problem: Problem) -> tuple[Problem, str] | None:
    """Return a structure with all elastic modes and more residual modes, and its name, or None if there is none."""
    s, elastic = problem.settings, _all_elastic(problem)
    damper = {name: max(n, elastic[name]) for name, n in s.by_body("damper_modes").items()}
    residual = problem.contact.residual
    stiffness, name = s.contact_stiffness, "all modes"
    if residual is not None and (method := _residual_method(problem)) is not None:
        stiffness, name = replace(method, n_vectors=VECTORS), f"all modes, {VECTORS} residual modes"
    if damper == s.by_body("damper_modes") and stiffness is s.contact_stiffness:
        return None
    richer = _with_modes(problem, s.blade_modes, damper, stiffness)
    return None if richer is None else (richer, name)


def _residual_method(problem: Problem) -> ResidualModes | None:
    """Return the settings of residual modes with fewer vectors than in the richer structure; None if there are none."""
    method = problem.stiffness_method
    method = ResidualModes() if method == "residual_modes" else method
    fewer = (
        isinstance(method, ResidualModes)
        and method.n_vectors != "all"
        and method.n_vectors < VECTORS
    )
    return method if fewer else None


def _with_modes(
    problem: Problem, blade: int, damper: Mapping[str, int], stiffness: Any
) -> Problem | None:
    """Return the problem with these numbers of modes and contact stiffness; None if the model does not allow it."""
    modes: Any = dict(damper) if len(set(damper.values())) > 1 else max(damper.values(), default=0)
    changes = {"blade_modes": blade, "damper_modes": modes, "contact_stiffness": stiffness}
    now = {"blade_modes": problem.settings.blade_modes, "damper_modes": problem.settings.damper_modes,
           "contact_stiffness": problem.settings.contact_stiffness}  # fmt: skip
    changes = {
        name: value
        for name, value in changes.items()
        if value is not now[name] and value != now[name]
    }
    if not changes:
        return problem
    try:
        with quiet():
            changed = problem.replace(**changes)
            _ = changed.bases
        return changed
    except BdamperError:
        return None


def _all_elastic(problem: Problem) -> dict[str, int]:
    bodies = problem.model.bodies
    return {
        name: bodies[name].bases[0].n_natural - len(RIGID_NAMES)
        for name in problem.settings.free_bodies
    }


def _first_elastic(problem: Problem, frequency: float) -> dict[str, float]:
    """Return the first elastic frequency of each free body over a frequency (Hz); infinite without elastic modes."""
    out = {}
    for name, n in _all_elastic(problem).items():
        omega2 = np.sort(problem.model.bodies[name].bases[0].omega2)
        out[name] = (
            float(np.sqrt(omega2[len(RIGID_NAMES)]) / (TWO_PI * frequency))
            if n > 0
            else float("inf")
        )
    return out


# ---- highest steady amplitude ----


@one_thread
def time_response(
    problem: Problem, result: ResponseCurve | Peak, *, steps_per_period: int | None = None, blades: int | None = None,
    starts: int = 1, progress: bool | None = None,
) -> TimeResponse:  # fmt: skip
    """See :meth:`bdamper.Study.time_response`."""
    starts = validation.integer("starts", starts, least=1)
    steps = (
        STEPS
        if steps_per_period is None
        else validation.integer("steps_per_period", steps_per_period, least=16)
    )
    if isinstance(result, Peak):
        result = _curve_of_peak(problem, result)
    check_curve(problem, result)
    if result.peak_at_end:
        highest = peak_text(result.peak.amplitude, result.peak.frequency, 6)
        raise SettingError(
            f"curve: expected a curve with a peak, found its highest amplitude at its end, {highest}"
        )
    watch, balance, top, preload = CostMeter(), BalanceCurve(result), result.peak, result.preload
    structure, text = structure_in_time(problem, top.frequency)
    none = TimeResponse(
        *(np.nan,) * 4, preload, top.amplitude, structure=text, **problem.recorded()
    )
    if not np.isfinite(balance.flank):
        why = "next to the tip there are several solutions at all frequencies; widen the interval"
        return replace(none, status=with_reason(NOT_FOUND, why))
    source = ring_of(problem, preload, blades)
    ring = source if structure is problem else ring_of(structure, preload, blades)
    search, progress = SteadySearch(ring, source, balance, steps), shows_progress(progress)
    found = _integrate(search, structure, preload, blades, starts, progress)
    if found.step_error and not found.interrupted:
        # shorter steps resolve the contacts better, so the search begins again
        finer = SteadySearch(ring, source, balance, 4 * steps)
        first, found = found, _integrate(finer, structure, preload, blades, starts, progress)
        found.search.periods += first.search.periods
        found = replace(found, cost=first.cost + found.cost)
    search = found.search
    if (
        search.best is None
        and search.failure
        and structure.settings.blade_modes != problem.settings.blade_modes
    ):
        search.failure += (
            f"; try a response curve with blade_modes={structure.settings.blade_modes}, as in time"
        )
    cost = watch.read(ring.cost + found.cost)
    none = replace(
        none, periods=search.periods, diameters=ring.nodal_diameters, cost=cost, fall=search.fall
    )
    omitted = (
        "" if result.complete else f"there may be a higher peak, as the curve is {result.status}"
    )
    return _stated(none, found, omitted)


@dataclass(frozen=True)
class _Integrations:
    """Motions of one search, with one number of time steps per period.

    Parameters
    ----------
    search : SteadySearch
    runs : dict of str to SteadyPoint
        The highest motion, with refinements.
    starts : dict of str to float, m
        Amplitudes that other initial states lead to.
    step_error : str
        Why the time steps are too long, or "".
    interrupted : bool
    cost : Cost
        Cost of the richer structure.
    """

    search: SteadySearch
    runs: dict[str, SteadyPoint]
    starts: dict[str, float]
    step_error: str
    interrupted: bool
    cost: Cost


def _integrate(
    search: SteadySearch,
    structure: Problem,
    preload: float,
    blades: int | None,
    starts: int,
    progress: bool,
) -> _Integrations:
    """Search for the highest motion, and refine it."""
    ring, steps = search.ring, search.steps
    runs: dict[str, SteadyPoint] = {}
    others: dict[str, float] = {}
    error = ""
    whole: Ring | None = None
    what = f"time integration at {amount(preload, 'N')}, {counted(ring.n, 'blade')}"
    with LongWork() as work, progress_stages(progress, what, "step") as report:
        search.on_frequency = lambda frequency: report(f"{frequency:.6g} Hz", len(runs), 3 + starts)
        try:
            search.run()
            if (best := search.best) is not None and not (error := step_error(best.transient)):
                runs[f"{steps} steps"] = best
                # refinements are tried from three motions
                points = sorted(search.points, key=lambda p: -p.mean)[:3]
                richer = richer_structure(structure)
                if richer is not None:
                    whole = ring_of(richer[0], preload, blades)

                def with_shorter_steps() -> None:
                    shorter = runs[f"{2 * steps} steps"] = _refine(search, points, ring, 2)
                    runs[f"{4 * steps} steps"] = _refine(search, [shorter, *points], ring, 4)
                    others.update(_other_starts(search, best, starts))

                def in_richer_structure() -> None:
                    if richer is not None and whole is not None:
                        runs[richer[1]] = _refine(search, points, whole, 1)

                on_threads([with_shorter_steps, in_richer_structure])
        except IntegrationFailed as failed:
            search.failure = str(failed)
            # motions from before the failure still count
            if isinstance(failed, EnergyGained) or search.best is None:
                error = str(failed)
    # the order in which they ended depends on the threads
    names = [f"{factor * steps} steps" for factor in (1, 2, 4)]
    names += [name for name in runs if name not in names]
    runs = {name: runs[name] for name in names if name in runs}
    cost = Cost() if whole is None else whole.cost
    return _Integrations(search, runs, others, error, work.interrupted, cost)


def _curve_of_peak(problem: Problem, peak: Peak) -> ResponseCurve:
    """Return the response curve of a peak in its interval."""
    what = "the highest peak of this study at its preload"
    if not peak.converged or "frequency" not in peak.settings:
        raise validation.invalid("result", "a peak at a preload", peak.status)
    if peak.model_hash != problem.model.hash:
        raise validation.invalid("result", what, "a peak of another model")
    curve = frequency_response(problem, peak.parameter, tuple(peak.settings["frequency"]))
    if not (len(curve) and np.isclose(curve.peak.amplitude, peak.amplitude, rtol=1e-3, atol=0.0)):
        raise validation.invalid(
            "result", what, f"{amount(peak.amplitude, 'm')} at {peak.frequency:.6g} Hz"
        )
    return curve


def _refine(search: SteadySearch, points: list[SteadyPoint], ring: Ring, finer: int) -> SteadyPoint:
    """Return the highest motion with ``finer`` times the steps, or in a richer structure.

    A richer structure may need shorter steps.

    Raises
    ------
    EnergyGained
        If the steps are too long even if they are four times shorter.
    """
    refined = _with_steps(search, points, ring, finer)
    if step_error(refined.transient):
        refined = _with_steps(search, points, ring, 4 * finer)
    return _balanced(refined)


def _balanced(point: SteadyPoint) -> SteadyPoint:
    """Return the motion, or raise :class:`EnergyGained` if its time steps are too long."""
    if error := step_error(point.transient):
        raise EnergyGained(error)
    return point


def _with_steps(
    search: SteadySearch, points: list[SteadyPoint], ring: Ring, finer: int
) -> SteadyPoint:
    """Return the highest motion that stays with ``finer`` times the steps, tried from ``points`` in this order."""
    for point in points:
        if not point.stays:
            continue
        motion = point.transient.motion
        if ring is not search.ring:
            motion = transfer(search.ring, motion, ring)
        motion = motion._replace(a=None)
        refined = search.settle_apart(ring, point.frequency, motion, point.mean, finer)
        # a beat that the longer steps had damped needs more periods to show its full range
        moved = abs(refined.mean / point.mean - 1.0) > 0.5 * CRITERIA.drift
        if refined.stays and moved:
            latest = refined.transient.motion
            refined = search.settle_apart(
                ring, point.frequency, latest, refined.mean, finer, parting=True
            )
        if refined.stays:
            break
    return refined


def _at_fall(search: SteadySearch) -> float:
    """Return the amplitude (m) of the highest motion, extrapolated to the frequency at which it falls."""
    best, *others = sorted(search.points, key=lambda p: -p.mean)
    gap = search.fall - best.frequency
    behind = [p for p in others if (p.frequency - best.frequency) * gap < 0.0]
    if not behind or search.between(search.fall):
        return best.mean
    near = min(behind, key=lambda p: abs(p.frequency - best.frequency))
    return best.mean + max(0.0, (best.mean - near.mean) * gap / (best.frequency - near.frequency))


def _other_starts(search: SteadySearch, best: SteadyPoint, starts: int) -> dict[str, float]:
    """Return the amplitudes (m) that other disturbances and tractions of the highest motion lead to."""
    tractions, out = search.ring.tractions(best.transient.motion), {}
    for k in range(1, starts):
        name = list(tractions)[(k - 1) % len(tractions)]
        motion = search.ring.seeded(
            best.transient.motion._replace(w=tractions[name]), CRITERIA.seed, k
        )
        out[f"start {k}, {name}"] = _balanced(
            search.settle_apart(search.ring, best.frequency, motion, best.mean)
        ).mean
    return out


def _stated(none: TimeResponse, found: _Integrations, omitted: str) -> TimeResponse:
    """Return the result of a search: ``none``, a result without amplitudes, completed by the motions found.

    ``omitted`` is a doubt about the response curve, or empty.
    """
    search, best, interrupted = found.search, found.search.best, found.interrupted
    # an amplitude with energy that the time steps supply is no bound either
    if found.step_error:
        return replace(
            none, status=INTERRUPTED if interrupted else with_reason(NOT_FOUND, found.step_error)
        )
    if best is None:
        why = search.failure or "no motion stays near the peak"
        return replace(none, status=INTERRUPTED if interrupted else with_reason(NOT_FOUND, why))
    runs, others = found.runs or {f"{search.steps} steps": best}, found.starts
    answers = {name: run.mean for name, run in runs.items()}
    if search.fall == search.fall:
        answers["at the fall"] = _at_fall(search)
    higher = {name: mean for name, mean in others.items() if mean > best.mean}
    lowest, highest, doubt = error_range(answers | higher, runs.values())
    end = (
        "the curve ends before the motion falls; widen the interval" if search.at_end(best) else ""
    )
    left = "; ".join(filter(None, (doubt, search.failure, end, omitted)))
    carried, all_ = len(search.ring.nodal_diameters), search.ring.n // 2 + 1
    said = "; ".join(filter(None, (
        f"from the tip; a sweep from the flank has at most {amount(search.below, 'm')}"
        if search.below < best.mean else "",
        f"{carried} of {all_} nodal diameters were integrated" if carried < all_ else "",
    )))  # fmt: skip
    return replace(
        none, mean=best.mean, lowest=lowest, highest=highest,
        highest_period=highest_period(runs.values()), half_range=best.half_range, frequency=best.frequency,
        answers=answers, starts=others,
        status=INTERRUPTED if interrupted else with_reason(INCOMPLETE, left) if left else with_reason(COMPLETE, said),
        **of_blades(best.transient, len(best.amplitude)),
    )  # fmt: skip


def highest_period(runs: Iterable[SteadyPoint]) -> float:
    """Return the highest amplitude (m) of a single period of the motions that stay."""
    return max(float(run.amplitude.max()) for run in runs if run.stays)


def error_range(
    answers: Mapping[str, float], runs: Collection[SteadyPoint]
) -> tuple[float, float, str]:
    """Return the range (m) of the answers and the reason if it is wide, or "".

    The range is widened by the uncertainty of the means and by the standard deviation of single periods: the mean of a
    motion that is not periodic depends on its start.  It contains the highest single period.
    """
    low, high = min(answers.values()), max(answers.values())
    stay = [run for run in runs if run.stays]
    change = max(CRITERIA.drift, *(abs(run.change) for run in stay))
    scatter = max(change, *(float(np.std(run.amplitude)) / run.mean for run in stay))
    doubts = [
        "not settled" if high > (1.0 + CRITERIA.tolerance) * low else "",
        f"its mean is uncertain by {100.0 * change:.2g} %" if change > CRITERIA.tolerance else "",
    ]
    top = max((1.0 + scatter) * high, highest_period(runs))
    return (1.0 - scatter) * low, top, "; ".join(filter(None, doubts))


def of_blades(transient: Transient, periods: int) -> dict[str, Any]:
    """Return the fields of a result about all blades, from the last periods of a time integration."""
    blades, half = transient.blades[-periods:], len(transient.harmonics) // 2
    ratio = outside(transient, half)[0] if half else 0.0
    return {
        "blade": transient.blade, "blades": np.abs(blades), "waves": transient.ring.waves(blades),
        "energy": tuple(float(x) for x in np.mean(transient.energy[-periods:], axis=0)),
        "growth": float(np.log(ratio)) / half if ratio else float("nan"),
    }  # fmt: skip


@one_thread
def with_time_response(
    problem: Problem,
    curve: OptimalCurve,
    preload: Sequence[float] | NDArray | None = None,
    *,
    progress: bool | None = None,
) -> OptimalCurve:
    """See :meth:`bdamper.Study.with_time_response`."""
    validation.instance("curve", curve, OptimalCurve)
    if curve.model_hash != problem.model.hash:
        raise validation.invalid(
            "curve", "an optimal curve of this study", "a curve of another model"
        )
    progress = shows_progress(progress)
    if preload is None:
        best = curve.optimum.preload
        preloads = [p for p in (best, NEIGHBOUR * best) if np.isfinite(p)]
    else:
        preloads = [float(p) for p in validation.numbers("preload", preload, above=0.0, unit="N")]
    missing = {p: TimeResponse(*(np.nan,) * 4, p, np.nan, status=INTERRUPTED) for p in preloads}
    responses = missing | {response.preload: response for response in curve.time_response}
    costs: dict[float, Cost] = {}

    def integrate(p: float) -> None:
        try:
            tracked = uninterrupted(frequency_response(problem, p, curve.settings["frequency"]))
            costs[p] = tracked.cost
            responses[p] = time_response(problem, tracked, progress=progress)
            costs[p] += responses[p].cost
        except BdamperError as error:
            responses[p] = replace(missing[p], status=with_reason(NOT_FOUND, error))

    start = time.perf_counter()
    with LongWork():
        on_threads([partial(integrate, p) for p in preloads])
    seconds = curve.cost.seconds + time.perf_counter() - start
    cost = sum((costs[p] for p in sorted(costs)), curve.cost)
    in_order = tuple(responses[p] for p in sorted(responses))
    return replace(curve, time_response=in_order, cost=replace(cost, seconds=seconds))


# ---- one motion ----


def disturbed(ring: Ring, u: NDArray, omega: float, steps: int | None = None) -> Transient:
    """Return a time integration from a solution (n_unknowns,) with a disturbance of every nodal diameter."""
    transient = Transient(ring, omega, u, steps)
    return Transient(ring, omega, ring.seeded(transient.motion, CRITERIA.seed, 0), transient.steps)


def compare_with_solution(
    transient: Transient, expected: NDArray, tolerance: float = CRITERIA.tolerance, periods: int = CRITERIA.longest,
    progress: bool = False,
) -> tuple[Verdict, bool]:  # fmt: skip
    """Integrate until it is decided whether the motion keeps the response ``expected`` (n_harmonics + 1,) complex, m.

    Returns
    -------
    verdict : Verdict
    interrupted : bool

    Raises
    ------
    IntegrationFailed
        If the time integration fails.
    """

    def verdict_so_far() -> Verdict:
        return judged(transient.amplitude, float(abs(expected[1])), tolerance, transient.memory)

    stopped = transient.run(periods, progress, lambda: verdict_so_far().verdict != UNDECIDED)
    if not transient.harmonics:
        raise KeyboardInterrupt
    return verdict_so_far(), stopped


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
    progress: bool | None = None,
) -> MotionInTime:
    """See :meth:`bdamper.Study.motion_in_time`."""
    check_curve(problem, curve)
    validation.check_value(
        len(curve), "curve", "a curve with points", f"no points ({curve.status}: {curve.reason})"
    )
    tolerance, n = validation.number("tolerance", tolerance, above=0.0, most=1.0), len(curve)
    free, progress = frequency is not None, shows_progress(progress)
    if frequency is not None:
        frequency = validation.number("frequency", frequency, above=0.0, unit="Hz")
        low, high = curve.frequency.min(), curve.frequency.max()
        if not low <= frequency <= high:
            warn_implausible(
                "frequency", f"{low:g} to {high:g} Hz, within the curve", f"{frequency:g}"
            )
        if index is not None:
            raise validation.invalid("index", "none, since a frequency is given", index)
        i = int(np.abs(curve.frequency - frequency).argmin())
    else:
        i = (
            curve.peak_index
            if index is None
            else validation.integer("index of a point", index, -n, n - 1)
        )
        frequency = float(curve.frequency[i])
    least, default, steps = (
        (CRITERIA.look, 200, STEPS) if free else (1, CRITERIA.longest, CRITERIA.steps)
    )
    periods = default if periods is None else validation.integer("periods", periods, least=least)
    steps = steps if steps_per_period is None else steps_per_period
    watch, ring = CostMeter(), ring_of(problem, curve.preload)
    expected = problem.system(curve.preload).response(curve.unknowns[i])

    def with_steps(steps: int) -> tuple[Transient, str, dict[str, Any], NDArray]:
        """Return the motion, its status, fields of the result, and the amplitudes that the result states."""
        transient = disturbed(ring, curve.unknowns[i], TWO_PI * frequency, steps)
        if free:
            status, more = _without_decision(transient, periods, progress)
            return transient, status, more, second_half(transient.amplitude)
        status, more, last = _with_decision(transient, expected, tolerance, periods, progress)
        return transient, status, more, transient.amplitude[-last:]

    try:
        transient, status, more, amplitude = with_steps(steps)
        error = step_error(transient)
    except IntegrationFailed as failed:
        status, error = "", str(failed)
    # shorter steps resolve the contacts better, so the motion begins again
    if error and status != INTERRUPTED:
        transient, status, more, amplitude = with_steps(4 * steps)
        error = step_error(transient)
        if error and status != INTERRUPTED:
            raise EnergyGained(f"time integration at {frequency:.6g} Hz: {error}")
    more |= of_blades(transient, len(amplitude))
    return MotionInTime(
        float(amplitude.mean()), float(amplitude.min()), float(amplitude.max()), frequency, curve.preload,
        transient.response, repeats_after=repeats_after(transient.response), diameters=ring.nodal_diameters,
        status=_with_energy(status, more), cost=watch.read(ring.cost), **more, **problem.recorded(),
    )  # fmt: skip


def _with_energy(status: str, result: Mapping[str, Any]) -> str:
    """Return the status, incomplete while the stored energy changes.

    A motion with a verdict has settled, and only exchanges energy with the loads at rest.
    """
    reason = status.partition(": ")[2] or (
        "" if "verdict" in result else energy_change(result["energy"])
    )
    return with_reason(INCOMPLETE, reason) if reason and status != INTERRUPTED else status


def _without_decision(
    transient: Transient, periods: int, progress: bool
) -> tuple[str, dict[str, Any]]:
    """Integrate a number of periods and return the status, incomplete while the mean changes, without further fields."""
    interrupted = transient.run(periods, progress)
    if interrupted and len(transient.harmonics) < CRITERIA.look:
        raise KeyboardInterrupt
    change = to_come(transient.amplitude, transient.memory)
    moving = f"the mean changes by another {100.0 * change:+.2g} % by estimate; use more periods"
    reason = moving if abs(change) > CRITERIA.drift else ""
    return INTERRUPTED if interrupted else with_reason(
        INCOMPLETE, reason
    ) if reason else COMPLETE, {}


def _with_decision(
    transient: Transient, expected: NDArray, tolerance: float, periods: int, progress: bool
) -> tuple[str, dict[str, Any], int]:
    """Integrate until a decision and return the status, the fields of the result on it, and the number of its periods."""
    (verdict, reason, last), interrupted = compare_with_solution(
        transient, expected, tolerance, periods, progress
    )
    apart, size = (
        float(np.linalg.norm(x[1:])) for x in (transient.response[-1] - expected, expected)
    )
    status = (
        INTERRUPTED
        if interrupted
        else with_reason(INCOMPLETE, UNDECIDED)
        if verdict == UNDECIDED
        else COMPLETE
    )
    distance = apart / max(size, 1e-300)
    decided = {
        "balance": float(abs(expected[1])),
        "distance": distance,
        "verdict": verdict,
        "reason": reason,
    }
    return status, decided, last
