"""Whether marching in time agrees with a harmonic-balance solution.

All sectors are marched (:mod:`bdamper.stability.time_integration`) from the solution, and the amplitude of each period (of
the harmonic of the excitation) is compared with the solution's.  After every 16 periods :func:`judged` looks whether that
decides:

* **Left.**  Farther than twice the tolerance in each of the last 32 periods, and the last 16 no nearer than the 16 before:
  the motion does not agree.
* **Settled.**  The mean of 16 periods has changed by less than 1 % within 80 periods, and no faster in their second half
  than in the first.  It agrees if the mean of these 80 is within the tolerance, and nine periods of ten within twice that;
  what the slowest mode may still add must not change the answer.  A growth that shows only after hundreds of periods is
  beyond this, as it is beyond a test.
* **Wanders.**  Farther than that in the last 80 periods, by more than what the slowest mode leaves of the distance in the
  80 before: it does not agree.

Otherwise the march goes on, and ends undecided after so many periods.

Measured on the shipped disk (nine points, unit tractions): the 50 points of ``benchmarks/bench_in_time.py`` (200, 500 and
2000 N, one and three harmonics, half of them near peaks and folds) are decided after 48 to 336 periods, in 0.2 to 2.9 s
(median 0.6), each as the marches there end, which have half the step, start disturbed and last up to 960 periods.  With
residual modes 12 points took 3 to 14 s.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bdamper.continuation.curve import Curve
from bdamper.continuation.track import check_curve
from bdamper.harmonic_balance.system import HarmonicSystem
from bdamper.problem.problem import Problem
from bdamper.stability.steady_state import ACCURACY, memory_of, to_come
from bdamper.stability.time_integration import TWO_PI, ring_and_steps
from bdamper.util import validate
from bdamper.util.blas import one_thread
from bdamper.util.cost import Cost, Stopwatch
from bdamper.util.plotting import Plottable
from bdamper.util.progress import LongWork, counter
from bdamper.util.repr import brief
from bdamper.util.tables import Column, Tabular

AGREES, DIFFERS, UNDECIDED = "agrees", "does not agree", "undecided"
LOOK = 16
"""Periods between two looks, and those over which a mean is taken."""
SETTLED_WITHIN, DRIFT = 80, 0.01
"""Periods over which a settled amplitude changes by less than this share."""


@brief
@dataclass(frozen=True)
class Verification(Plottable, Tabular):
    """Verdict of time integration on a harmonic-balance solution, with the last period in time beside it.

    ``plot`` draws the last period in time and the harmonic-balance solution (:func:`bdamper.plot.plot_verification`).

    Parameters
    ----------
    frequency : float, Hz
    expected, settled : (n_harmonics + 1,) complex, m
        Response amplitudes of the solution, and of the last period in time.
    time, response : (n,) float, s and m
        The last period of the response.
    amplitude : (periods,) float, m
        Of the harmonic of the excitation, in each period.
    verdict : {"agrees", "does not agree", "undecided"}
    tolerance : float
        Relative difference of the amplitude up to which it agrees.
    reason : str
        What decided, or what it would take.
    periods, steps_per_period, sectors : int
    drift : float
        Change of the response over the last period, relative to its size: zero once the motion has settled.
    cost : Cost
        The march counts as contact forces; an evaluation is one of all sectors.
    interrupted : bool
        Whether Ctrl-C has ended the march.
    """

    frequency: float
    expected: NDArray
    settled: NDArray
    time: NDArray
    response: NDArray
    amplitude: NDArray
    verdict: str
    tolerance: float
    reason: str
    periods: int
    steps_per_period: int
    sectors: int
    drift: float
    cost: Cost
    interrupted: bool = False

    def columns(self) -> dict[str, Column]:
        """The last period in time, and the harmonic-balance solution at the same instants."""
        turns = np.exp(2j * np.pi * self.frequency * np.outer(self.time, np.arange(len(self.expected))))
        response, expected = Column(self.response, "m"), Column((turns @ self.expected).real, "m")
        return {"time": Column(self.time, "s"), "response": response, "expected": expected}

    @property
    def seconds(self) -> float:
        """Wall-clock time in all."""
        return self.cost.seconds

    @property
    def distance(self) -> float:
        """Distance of the vibration (all harmonics of the response besides the mean), relative to its size."""
        size = float(np.linalg.norm(self.expected[1:]))
        return float(np.linalg.norm((self.settled - self.expected)[1:])) / max(size, 1e-300)

    def __str__(self) -> str:
        ended = ", interrupted by the user" if self.interrupted else ""
        return (
            f"time integration at {self.frequency:.6g} Hz{ended}: {self.verdict} within {100.0 * self.tolerance:g} % "
            f"({self.reason})\n"
            f"  |X1| {abs(self.settled[1]):.6g} m, expected {abs(self.expected[1]):.6g} m, distance {self.distance:.2e}; "
            f"{self.periods} periods of {self.steps_per_period} steps, {self.sectors} sectors, drift {self.drift:.1e} a "
            f"period\n  {self.cost}"
        )


def judged(amplitude: NDArray, expected: float, tolerance: float, memory: float) -> tuple[str, str]:
    """Verdict and reason from the amplitudes (n_periods,) marched so far; "undecided" asks for more of them.

    Parameters
    ----------
    amplitude : (n_periods,) float, m
    expected : float, m
    tolerance : float
    memory : float
        Periods in which a transient of the least damped mode falls to 1/e.
    """
    off = amplitude / max(expected, 1e-300) - 1.0
    n = len(off)
    last = float(off[-LOOK:].mean())
    if not np.isfinite(amplitude).all():
        return UNDECIDED, "the march left the range of numbers"
    if n < 3 * LOOK:
        return UNDECIDED, f"{100.0 * last:+.2g} % in the mean of {min(n, LOOK)} periods; at least {3 * LOOK} decide"
    away = np.abs(off[-2 * LOOK :])
    if (away > 2.0 * tolerance).all() and abs(last) >= abs(float(off[-2 * LOOK : -LOOK].mean())):
        return DIFFERS, f"{100.0 * last:+.2g} %, and no way back within {LOOK} periods"
    if n < SETTLED_WITHIN + LOOK:
        return UNDECIDED, f"{100.0 * last:+.2g} % so far; {SETTLED_WITHIN + LOOK} periods show whether it has settled"
    then, between, now = (float(off[n - k - LOOK : n - k].mean()) for k in (SETTLED_WITHIN, SETTLED_WITHIN // 2, 0))
    drift = (now - then) / max(1.0 + then, 1e-300)
    grows = abs(now - between) > max(1.2 * abs(between - then), 0.1 * DRIFT)
    recent, earlier = off[-SETTLED_WITHIN:], off[-2 * SETTLED_WITHIN : -SETTLED_WITHIN]
    stays = float(np.quantile(np.abs(recent), 0.9)) <= 2.0 * tolerance
    within = abs(float(recent.mean())) <= tolerance
    spread = f"{100.0 * recent.min():+.2g} to {100.0 * recent.max():+.2g} %"
    if abs(drift) < DRIFT and not grows and (not stays or within == (abs(last + to_come(amplitude, memory)) <= tolerance)):
        span = f", {spread}" if np.ptp(recent) > DRIFT else ""
        text = f"{100.0 * float(recent.mean()):+.2g} % in the mean of {SETTLED_WITHIN} periods{span}"
        return AGREES if stays and within else DIFFERS, text
    decayed = min(1.0, 1.1 * np.exp(-SETTLED_WITHIN / memory)) * np.abs(earlier).max()
    if n >= 2 * SETTLED_WITHIN and not stays and np.abs(recent).max() > decayed:
        return DIFFERS, f"wanders, {spread} within {SETTLED_WITHIN} periods"
    return UNDECIDED, (
        f"{100.0 * last:+.2g} %, changed by {100.0 * drift:+.2g} % within {SETTLED_WITHIN} periods; a transient takes "
        f"{memory:.3g} periods to fall to 1/e"
    )


def verify_solution(
    system: HarmonicSystem,
    u: NDArray,
    omega: float,
    n_blades: int,
    engine_order: int,
    *,
    tolerance: float = 0.05,
    periods: int = 1000,
    steps_per_period: int | None = None,
    progress: bool = False,
) -> Verification:
    """March from a harmonic-balance solution until it is clear whether the motion keeps to it.

    Parameters
    ----------
    system : HarmonicSystem
    u : (n_unknowns,) float
    omega : float, rad/s
    n_blades, engine_order : int
    tolerance : float
    periods : int
        At most.
    steps_per_period : int, optional
        By default such that the step resolves the stiffest contact.
    progress : bool
        Show a bar of the periods.

    Returns
    -------
    Verification
        After Ctrl-C that of the periods marched by then.
    """
    periods = validate.whole("periods", periods, least=1)
    tolerance = validate.number("tolerance", tolerance, above=0.0, most=1.0)
    watch = Stopwatch()
    ring, n = ring_and_steps(system, omega, n_blades, engine_order, steps_per_period, ACCURACY, u)
    motion = before = ring.start(u, omega, n)
    expected = np.asarray(system.response(np.asarray(u)[None])[0])
    memory = memory_of(ring, omega)
    found: list[NDArray] = []
    verdict, reason = UNDECIDED, ""
    with LongWork() as work, counter(progress, periods, 0, "marching", "period") as count:
        while len(found) < periods and verdict == UNDECIDED and np.isfinite(motion.q).all():
            marched = ring.march(motion, omega, n)
            before, motion = motion, marched.motion
            found.append(marched.harmonics[0])
            count()
            if len(found) % LOOK == 0 or len(found) == periods:
                verdict, reason = judged(np.abs(np.array(found)[:, 1]), float(abs(expected[1])), tolerance, memory)
    if work.interrupted and not found:
        raise KeyboardInterrupt
    amplitude = np.abs(np.array(found)[:, 1])
    if verdict == UNDECIDED:
        verdict, reason = judged(amplitude, float(abs(expected[1])), tolerance, memory)
    if ring.unsolved:
        verdict, reason = UNDECIDED, ring.unsolved
    row = ring.response_row()
    with np.errstate(invalid="ignore", over="ignore"):  # where the march left the range of numbers
        response = ring.march(before, omega, n, trace=True).trace @ row
        drift = float(abs(row @ (motion.q - before.q)))
    size = max(float(np.abs(response).max()), 1e-300)
    return Verification(
        frequency=omega / TWO_PI,
        expected=expected,
        settled=found[-1],
        time=TWO_PI / omega * np.arange(n) / n,
        response=response,
        amplitude=amplitude,
        verdict=verdict,
        tolerance=tolerance,
        reason=reason,
        periods=len(found),
        steps_per_period=n,
        sectors=ring.n,
        drift=drift / size,
        cost=replace(ring.cost, **watch.read()),
        interrupted=work.interrupted,
    )


@one_thread
def verify(
    problem: Problem,
    curve: Curve,
    index: int | None = None,
    *,
    tolerance: float = 0.05,
    periods: int = 1000,
    steps_per_period: int | None = None,
    progress: bool = False,
) -> Verification:
    """March in time from a point of a tracking curve and say whether the motion agrees with it.

    All sectors take part, each with its own contacts; no Fourier series is cut off, no travelling wave assumed
    (:mod:`bdamper.stability.verification`).  The march ends as soon as it is decided: most often after 48 to 200 periods,
    which take a second on the shipped disk with nine points and ten seconds with its residual modes.

    Parameters
    ----------
    problem : Problem
    curve : Curve
        Tracked with this problem.
    index : int, optional
        Of the point; the largest response by default.
    tolerance : float
        Difference of the amplitude, as a share of it, up to which the motion agrees.
    periods : int
        Periods of the excitation, at most.
    steps_per_period : int, optional
        By default what the stiffest contact asks for.
    progress : bool
        Show a bar of the periods, with the time left.

    Returns
    -------
    Verification
        With ``verdict`` "agrees", "does not agree" or "undecided"; after Ctrl-C that of the periods marched by then.

    Raises
    ------
    SettingError
        If the settings describe something else than a structure in time, or a number does not fit.
    """
    problem = problem.matching(validate.instance("curve", curve, Curve, "a tracking curve").settings)
    check_curve(problem, curve)
    i = curve.peak.index if index is None else validate.whole("index of a point", index, -len(curve), len(curve) - 1)
    return verify_solution(
        problem.system(curve.preload),
        curve.unknowns[i],
        2.0 * np.pi * float(curve.frequency[i]),
        problem.model.n_blades,
        int(problem.engine_order),
        tolerance=tolerance,
        periods=periods,
        steps_per_period=steps_per_period,
        progress=progress,
    )
