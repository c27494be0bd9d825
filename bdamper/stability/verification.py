"""Whether marching in time agrees with a harmonic-balance solution.

All sectors are marched (:mod:`bdamper.stability.march`) from the solution, and the amplitude of each period (of the
harmonic of the excitation) is compared with the solution's, until ``bdamper.stability.march.judged`` decides or so
many periods are over.  A growth that shows only after hundreds of periods is beyond this, as it is beyond a test.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from bdamper.continuation.curve import Curve
from bdamper.continuation.track import check_curve
from bdamper.problem.problem import Problem, matching
from bdamper.stability.disturbances import TWO_PI
from bdamper.stability.march import AGREES, BOUNDS, DIFFERS, March
from bdamper.stability.time_integration import ring_of
from bdamper.util import validate
from bdamper.util.blas import one_thread
from bdamper.util.cost import Cost, Stopwatch
from bdamper.util.plotting import Plottable
from bdamper.util.repr import brief
from bdamper.util.tables import Metres, Quantity, Seconds, Tabular
from bdamper.util.text import amount, height, percent


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
    time: Seconds
    response: Metres
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

    @property
    def expected_response(self) -> Annotated[NDArray, Quantity("m", name="expected")]:
        """(n,) float, m: the harmonic-balance solution at the same instants."""
        turns = np.exp(2j * np.pi * self.frequency * np.outer(self.time, np.arange(len(self.expected))))
        return (turns @ self.expected).real

    @property
    def seconds(self) -> float:
        """Wall-clock time in all."""
        return self.cost.seconds

    @property
    def distance(self) -> float:
        """Distance of the vibration (all harmonics of the response besides the mean), relative to its size."""
        size = float(np.linalg.norm(self.expected[1:]))
        return float(np.linalg.norm((self.settled - self.expected)[1:])) / max(size, 1e-300)

    def bottom_line(self) -> str:
        heights = f"{height(abs(self.settled[1]), self.frequency)}, expected {amount(abs(self.expected[1]), 'm')}"
        motion = {AGREES: "the motion stays", DIFFERS: "the motion leaves"}.get(self.verdict, "not known whether it stays")
        agrees = f"{self.verdict} within {percent(self.tolerance)}"
        return f"Time integration: {agrees}, {motion}: {heights} ({self.reason})."

    def details(self) -> str:
        ended = ", interrupted by the user" if self.interrupted else ""
        return (
            f"{self.bottom_line()}\n  distance {self.distance:.2e}, drift {self.drift:.1e} a period, {self.periods} "
            f"periods of {self.steps_per_period} steps{ended}, {self.sectors} sectors\n  {self.cost}"
        )


def verified(
    march: March, expected: NDArray, tolerance: float = BOUNDS.tolerance, periods: int = BOUNDS.most, progress: bool = False
) -> Verification:
    """March until it is clear whether the motion keeps to a response.

    Parameters
    ----------
    march : March
        At its start, a harmonic-balance solution.
    expected : (n_harmonics + 1,) complex, m
        Response amplitudes of that.
    tolerance : float
    periods : int
        At most.
    progress : bool
        Show a bar of the periods.

    Returns
    -------
    Verification
        After Ctrl-C that of the periods marched by then.
    """
    periods = validate.whole("periods", periods, least=1)
    tolerance = validate.number("tolerance", tolerance, above=0.0, most=1.0)
    watch, ring, omega, n = Stopwatch(), march.ring, march.omega, march.steps
    interrupted = march.until_judged(float(abs(expected[1])), tolerance, periods, progress=progress)
    if not march.harmonics:
        raise KeyboardInterrupt
    verdict, reason = march.judged(float(abs(expected[1])), tolerance)
    row = ring.response_row()
    with np.errstate(invalid="ignore", over="ignore"):  # where the march left the range of numbers
        response = ring.march(march.before, omega, n, trace=True).trace @ row
        drift = float(abs(row @ (march.motion.q - march.before.q)))
    size = max(float(np.abs(response).max()), 1e-300)
    return Verification(
        frequency=omega / TWO_PI,
        expected=expected,
        settled=march.harmonics[-1],
        time=TWO_PI / omega * np.arange(n) / n,
        response=response,
        amplitude=march.amplitude,
        verdict=verdict,
        tolerance=tolerance,
        reason=reason,
        periods=len(march.harmonics),
        steps_per_period=n,
        sectors=ring.n,
        drift=drift / size,
        cost=replace(ring.cost, **watch.read()),
        interrupted=interrupted,
    )


@one_thread
def verify(
    problem: Problem,
    curve: Curve,
    index: int | None = None,
    *,
    tolerance: float = BOUNDS.tolerance,
    periods: int = BOUNDS.most,
    steps_per_period: int | None = None,
    progress: bool = False,
) -> Verification:
    """March in time from a point of a tracking curve and say whether the motion agrees with it.

    All sectors take part, each with its own contacts; no Fourier series is cut off, no travelling wave assumed
    (:mod:`bdamper.stability.verification`).  The march ends as soon as it is decided, most often after 48 to 200 periods.

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
        1,024 by default.
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
    problem = matching(problem, validate.instance("curve", curve, Curve, "a tracking curve").settings)
    check_curve(problem, curve)
    i = curve.peak.index if index is None else validate.whole("index of a point", index, -len(curve), len(curve) - 1)
    system, u, omega = problem.system(curve.preload), curve.unknowns[i], TWO_PI * float(curve.frequency[i])
    steps = BOUNDS.steps if steps_per_period is None else steps_per_period
    march = March(ring_of(problem, curve.preload), omega, u, steps)
    return verified(march, system.response(u), tolerance, periods, progress)
