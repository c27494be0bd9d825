"""More harmonics at one peak, by Newton's method along the condition of a peak.

With ``H`` harmonics the peak solves ``r_H(u, omega) = 0`` and ``phi_H = 0``, the slope of the amplitude along the curve
(``bdamper.response.peak``).  It starts at the peak with fewer harmonics, in which the new ones are at rest: Newton's
method with line search at the frequency of that peak, then the search for the peak.  Both must keep the sign of det J,
which changes at every fold: otherwise the solution belongs to another part of the curve.  Where this fails, the number of
harmonics half way comes first.

Agreement proves nothing while harmonics come into resonance one by one: at its optimum the turbine blade has 75.3, 75.0,
75.0, 75.2 and 74.2 um with 3, 5, 7, 9 and 12 harmonics and 69.4 um with 16.  So more harmonics follow up to the highest
that was asked for, and end before only

* where the structure ends: above the highest mode that the equations hold of a reduced body nothing can resonate;
* where the model has no modes of a nodal diameter;
* where the last two changes are below a fifth of the tolerance and no harmonic still to come is near a stuck mode.

A harmonic ``l`` meets a mode where ``l omega`` is within 5 % of a frequency of the structure with stuck contacts at its
nodal diameter.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from threading import Event

import numpy as np

from bdamper.analyses.change_estimate import embed
from bdamper.analyses.error_estimates import missing_harmonics
from bdamper.harmonic_balance.effects import MAX_HARMONIC
from bdamper.harmonic_balance.problem import Problem, stuck_springs
from bdamper.harmonic_balance.result_checks import check_result
from bdamper.response.convergence_result import Convergence, HarmonicPeak, Meeting
from bdamper.response.highest_peak import NEAR as NEAR_HIGHEST
from bdamper.response.highest_peak import highest_peak
from bdamper.response.optimal_curve_result import OptimalCurve
from bdamper.response.peak import Peak, PeakOptions, peak_of_sign, sign_of_jacobian
from bdamper.util import validation
from bdamper.util.cost import CostMeter
from bdamper.util.errors import BdamperError
from bdamper.util.formatting import height
from bdamper.util.progress import LongWork, ended_by
from bdamper.util.status import COMPLETE, INCOMPLETE, INTERRUPTED, NOT_FOUND, because
from bdamper.util.threading import one_thread

HARMONICS = (5, 7, 9, 12, 16, 20, 26)
"""Highest harmonics that are asked for by default."""
TOLERANCE = 0.05
"""Relative, on the amplitude, by default."""
NEAR_MODE = 0.05
"""Distance from a stuck mode within which a harmonic meets it: slip and separation move modes of the turbine blade by up to
3 %."""
OPTIONS = PeakOptions(tolerance=1e-8, position_tolerance=1e-4, max_trials=24)
"""How exactly the peaks are found."""


@one_thread
def harmonic_convergence(
    problem: Problem, peak: Peak, *, harmonics: Sequence[int] = HARMONICS, tolerance: float = TOLERANCE
) -> Convergence:
    """A peak with more and more harmonics.

    Parameters
    ----------
    problem : Problem
    peak : Peak
        A converged one of this study (:meth:`bdamper.Study.peak`).
    harmonics : sequence of int
        Highest harmonics to ask for, rising; all up to them take part, the odd ones alone where even ones vanish.
    tolerance : float
        Relative, on the amplitude: what counts as converged.

    Returns
    -------
    Convergence
        After Ctrl-C with what was known by then.

    Raises
    ------
    SettingError
        If the peak is none of this study, or has not converged.
    """
    validation.instance("peak", peak, Peak)
    validation.require(peak.converged, "peak", "a converged one", f"status '{peak.status}'")
    check_result(problem, peak, "peak")
    tolerance = validation.number("tolerance", tolerance, above=0.0, below=1.0)
    asked = [validation.whole("harmonics", n, 1, MAX_HARMONIC) for n in harmonics]
    validation.require(asked == sorted(set(asked)) and asked, "harmonics", "rising numbers", asked)
    own = problem.harmonic_numbers[-1]
    meter = CostMeter()
    most, limit = _most(problem, peak.frequency, max(own, asked[-1]))
    problems, limit = _richer(problem, sorted({min(n, most) for n in asked if n > own} - {own}), limit)
    found, status = [HarmonicPeak(own, peak.amplitude, peak.frequency)], COMPLETE
    internal_resonances: tuple[Meeting, ...] = ()
    with LongWork() as work:
        internal_resonances = tuple(_meetings(([problem] + problems)[-1], peak))
        at, sign = (problem, peak), sign_of_jacobian(problem.system(peak.parameter), peak.y)
        for richer in problems:
            begin, n = time.thread_time(), richer.harmonic_numbers[-1]
            new = _to(at, richer, sign, meter)
            if isinstance(new, str):
                status = because(INCOMPLETE, f"with {n} harmonics no peak was found beside this one ({new})")
                break
            at, seconds = new, time.thread_time() - begin
            found.append(HarmonicPeak(n, at[1].amplitude, at[1].frequency, seconds))
            if (
                _still(found, tolerance)
                and richer is not problems[-1]
                and not any(m.harmonic > n for m in internal_resonances)
            ):
                limit = "no later harmonic meets a mode"
                break
    status = INTERRUPTED if work.interrupted else status
    return Convergence(
        peak.parameter, tolerance, tuple(found), internal_resonances, limit, status, meter.read()
    )  # fmt: skip


# ---- the optimal curve ----


def at_optimum(problem: Problem, curve: OptimalCurve) -> Convergence | None:
    """The peak at the optimum of an optimal curve with up to 16 harmonics; None where there is no optimum."""
    best, found, status = curve.optimum, None, INTERRUPTED
    if not np.isfinite(best.preload):
        return None
    with LongWork():
        try:
            peak = highest_peak(problem, best.preload, tuple(curve.settings["frequency"]))
            if not abs(peak.amplitude / best.amplitude - 1.0) <= NEAR_HIGHEST:
                raise BdamperError(f"the highest peak there is {height(peak.amplitude, peak.frequency)}")
            found = harmonic_convergence(problem, peak, harmonics=[n for n in HARMONICS if n <= 16])
            found = replace(found, cost=found.cost if peak.cost is None else found.cost + peak.cost)
        except BdamperError as error:
            status = because(NOT_FOUND, error)
    own = HarmonicPeak(problem.harmonic_numbers[-1], best.amplitude, best.frequency)
    return found or Convergence(best.preload, TOLERANCE, (own,), status=status)


def beside(problem: Problem, curve: OptimalCurve, work: Callable[[], OptimalCurve]) -> OptimalCurve:
    """What some work makes of an optimal curve; on a thread beside it, the peak at the optimum with more harmonics.

    The cost of the curve takes in both, with the seconds that they need side by side.
    """
    start, stop = time.perf_counter(), Event()
    with ThreadPoolExecutor(1) as pool:
        more = pool.submit(ended_by(stop)(at_optimum), problem, curve)
        try:
            done = work()
            if any(k.status == INTERRUPTED for k in done.time_response):
                stop.set()
            found = more.result()
            whole = done.cost if found is None else done.cost + found.cost
            whole = replace(whole, seconds=curve.cost.seconds + time.perf_counter() - start)
            return replace(done, convergence=found, cost=whole)
        finally:
            stop.set()


# ---- which harmonics there are ----


def _still(found: Sequence[HarmonicPeak], tolerance: float) -> bool:
    """Whether the last two changes are below a fifth of the tolerance."""
    amplitude = [p.amplitude for p in found[-3:]]
    change = np.abs(np.diff(amplitude)) / amplitude[-1]
    return len(change) == 2 and bool(change.max() < 0.2 * tolerance)


def _richer(problem: Problem, numbers: Sequence[int], highest_harmonic: str) -> tuple[list[Problem], str]:
    """The problem with all harmonics up to each number, odd ones alone where even ones vanish, and what forbids more."""
    own, odd = problem.harmonic_numbers, not problem.settings.variable_normal_load
    found: list[Problem] = []
    for n in numbers:
        harmonics = tuple(l for l in range(1, n + 1) if l in own or l % 2 or not odd)
        try:
            richer = problem.replace(harmonics=harmonics)
            note = "" if richer.contact.note == problem.contact.note else richer.contact.note
        except BdamperError as error:
            note = str(error)
        if note:
            return found, f"no {n} harmonics are possible with the same settings ({note})"
        if richer.harmonic_numbers[-1] > (found or [problem])[-1].harmonic_numbers[-1]:
            found.append(richer)
    return found, highest_harmonic


def _most(problem: Problem, frequency: float, top: int) -> tuple[int, str]:
    """The highest harmonic up to ``top`` that the structure has a say in, and why there is none beyond."""
    own = problem.harmonic_numbers[-1]
    lacking = missing_harmonics(problem, top)
    for l in range(own + 1, top + 1):
        if l in lacking:
            d, _ = problem.model.folded_nodal_diameter(problem.engine_order * l)
            return l - 1, f"the model has no modes of harmonic {l}, nodal diameter {d}"
        end = _end(problem, l)
        if l * frequency > end:
            return l - 1, f"the structure ends at {1e-3 * end:.3g} kHz, harmonic {int(end / frequency)}"
    return top, ""


def _end(problem: Problem, harmonic: int) -> float:
    """Highest frequency (Hz) that the equations hold of a reduced body at the nodal diameter of a harmonic.

    Residual modes stand for all modes of the model; without them there are those that the study retains.
    """
    d, _ = problem.model.folded_nodal_diameter(
        problem.engine_order * (1 if problem.settings.fundamental_modes_only else harmonic)
    )
    ends = [np.inf]
    for name, body in problem.model.bodies.items():
        if body.kind == "constrained":
            omega2 = body.bases[d].omega2[: body.bases[d].n_natural]
            kept = omega2 if problem.contact.residual is not None else omega2[: problem.settings.blade_modes]
            ends.append(float(np.sqrt(kept.max())) / (2.0 * np.pi))
    return min(ends)


def _meetings(problem: Problem, peak: Peak) -> Iterator[Meeting]:
    """The harmonics of the problem that are near a mode with stuck contacts, each with the nearest one."""
    springs, linear = stuck_springs(problem, problem.static(peak.parameter)), problem.sector(peak.parameter).linear
    for l in problem.harmonic_numbers[1:]:
        modes = linear.modes(springs, l)[0] / (2.0 * np.pi)
        distance = l * peak.frequency / np.maximum(modes, 1e-300) - 1.0
        k = int(np.argmin(np.abs(distance)))
        if abs(distance[k]) <= NEAR_MODE:
            diameter = problem.bases[l].nodal_diameter if problem.model.n_blades > 1 else -1
            yield Meeting(l, k + 1, diameter, float(modes[k]), float(distance[k]))


# ---- the search ----


def _to(known: tuple[Problem, Peak], problem: Problem, sign: int, meter: CostMeter) -> tuple[Problem, Peak] | str:
    """A problem with more harmonics and its peak beside a known one, or why there is none.

    Where Newton's method fails, half of the new harmonics come first.
    """
    fewer, peak = known
    preload = peak.parameter
    system = problem.system(preload)
    meter.watch(system)
    guess = embed(fewer, problem, preload, peak.y)
    found, iterations = peak_of_sign(system, guess, sign, options=OPTIONS, parameter=preload)
    meter.count(iterations)
    if isinstance(found, Peak):
        return problem, found
    new = [l for l in problem.harmonic_numbers if l > fewer.harmonic_numbers[-1]]
    if len(new) == 1:
        return found
    some = tuple(l for l in problem.harmonic_numbers if l <= new[len(new) // 2 - 1])
    half = _to(known, problem.replace(harmonics=some), sign, meter)
    return half if isinstance(half, str) else _to(half, problem, sign, meter)
