"""Time integration period by period, and the criteria for a steady motion.

A :class:`Transient` starts from a harmonic-balance solution or from the end of another time
integration, and continues in complete periods of the excitation.  Period ``k`` contains the
response amplitudes

    X_l(k) = 2/T int_kT^(k+1)T x(t) exp(-i l omega t) dt        (half of this for l = 0).

All statements on a motion from time integration use these amplitudes and the criteria
:data:`CRITERIA`.

**Steady.**  :func:`settle` integrates until the motion is steady or has fallen: a motion falls if
its amplitude becomes less than the fraction :attr:`SteadyCriteria.jump` of the expected amplitude.
The second half of the n periods so far is divided into two quarters, the quarter before is the
third; their means m1, m2, m3 differ by d1 = m2 - m1 and d2 = m3 - m2.  A transient that falls by
the factor p = d2/d1 from one quarter to the next changes the mean by another p/(1 - p) d2.  The
motion is steady if d1, d2 and this change are below :attr:`SteadyCriteria.drift`.  The quarters
grow with n, so the scatter of a beating motion averages out.  If it does not within
:attr:`SteadyCriteria.most` periods, the largest of the three changes is the uncertainty of the
mean.

**Verdict.**  Every 16 periods :func:`judged` compares a motion with the solution at which it began:

* *Left*: the distance exceeds twice the tolerance in each of the last 32 periods, and did not
  decrease from 16 periods to the next 16.  The motion does not agree.
* *Settled*: the mean of 16 periods has changed by less than 1 % within 80 periods, and not faster
  in their second half.  The motion agrees if the mean of these 80 periods is within the tolerance,
  and nine of ten periods within twice the tolerance.  The remaining transient must not change the
  verdict.
* *Wanders*: nine of ten periods are not within twice the tolerance in the last 80, and the largest
  distance and the range exceed the values of the previous 80 periods after their decay.  The motion
  does not agree.

**Energy.**  Friction and closed contacts return no more energy than their springs store, so the
energy of a motion is bounded by its initial energy and the work of the excitation.  Time steps that
are too long for the contacts violate this bound; the integration fails if the energy exceeds it by
the factor :attr:`SteadyCriteria.gain`.  :func:`step_error` judges the last ten periods more
closely: their energy must balance to :attr:`SteadyCriteria.energy`, and the mean amplitude must not
exceed a bound that holds for all contacts.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bdamper.response.continuation import TWO_PI
from bdamper.response.motion_range import half_range
from bdamper.response.verification import TOO_FEW
from bdamper.time_domain.integration import STEPS, AllSectors, EnergyGained, Motion
from bdamper.util import validation
from bdamper.util.errors import SettingError
from bdamper.util.formatting import amount, percent
from bdamper.util.progress import LongWork, progress_counter, raise_if_stopped

AGREES, DIFFERS, UNDECIDED = "agrees", "does not agree", "undecided"


@dataclass(frozen=True)
class SteadyCriteria:
    """Criteria for motions from time integration.

    At 50 points the criteria give the same verdict as integrations of up to 960 periods
    (docs/evidence/measured-time.md, *Labels in time and long integrations*).

    Parameters
    ----------
    look : int
        Number of periods between two checks of a verdict, and number of periods in each mean.
    window : int
        Half the number of periods over which a verdict requires a settled amplitude.  Means are
        also computed over this number of periods.
    fewest, most : int
        Smallest and largest number of periods of :func:`settle`.
    lasting : int
        Smallest number of periods of the result of a search, unless its disturbances have decayed.
        Near an unstable solution a motion may seem steady for 20 periods before it decreases to
        half.
    decayed : float
        Amplitude of the waves, relative to ``seed``, below which they have decayed.  A motion is
        then the result if its mean has been constant for ``window`` periods.
    longest : int
        Largest number of periods until a verdict; the 50 points take at most 336.
    tolerance : float
        Relative difference up to which two amplitudes agree.
    drift : float
        Relative change of a settled mean, past or remaining.
    jump : float
        Fraction of the expected amplitude below which a motion has fallen.
    energy : float
        Error of the energy balance, relative to the energy supplied, above which the time steps are
        too long.  On the reference models it is below 0.4 % with 256 steps.  An error of 2 %
        changes amplitudes by at most 2 %, less than the tolerance.
    balanced : int
        Periods over which the energy must balance.
    gain : float
        Amplitude, or energy, relative to its bound above which the time integration is wrong.
    seed : float
        Relative amplitude of the waves that disturb a motion.
    rise : float
        Growth of these waves between two quarters above which the amplitudes of the blades diverge.
    repeats : float
        Relative change over a period below which a motion repeats: 1e-4 to 3e-4 for periodic
        motions between folds.
    most_repeated : int
        Largest number of periods of a subharmonic motion.
    pace : int
        Smallest number of periods in which a sweep covers the half width of the resonance.  With 15
        to 20 periods a motion of the difficult disk falls at 68 µm that is followed to 108 µm with
        40.  If a transient decays to 1/e in more periods, the sweep takes those: at a damping ratio
        of 0.001 a sweep with 40 periods reads 9 % low at the peak, and its highest place is no
        steady motion.
    stride : int
        Periods between two stored motions of a sweep.
    low, low_places : float, int
        A sweep ends when ``low_places`` stored motions are below the fraction ``low`` of its
        highest amplitude.  Solutions below this fraction of the highest solution are another level,
        not a ripple of the branch.
    confirmed : float
        Fraction of the harmonic-balance peak from which a motion settled there needs no sweeps.
    near : float
        Half-widths from the peak within which another branch of the curve makes sweeps necessary.
    fine : float
        Relative width of the interval in which a motion falls.
    most_points : int
        Largest number of motions that settle in the search around one motion.
    chatter : float
        Evaluations of the contact forces in a time step above which a search takes twice the steps:
        2 to 5 on the reference models, 7 to 10 on imported sectors without chatter, 25 to 71 with
        chatter.
    steps : int
        Time steps per period of a verdict.  The time steps damp chatter in slip: a motion that
        decreases to 0.855 of a solution stays at the solution with 256 steps; it decreases to 0.89
        with 512 and to 0.860 with 1,024 steps.
    """

    look: int = 16
    window: int = 40
    fewest: int = 20
    most: int = 240
    lasting: int = 100
    decayed: float = 0.1
    longest: int = 1000
    tolerance: float = 0.05
    drift: float = 0.01
    jump: float = 0.7
    energy: float = 0.02
    balanced: int = 10
    gain: float = 4.0
    seed: float = 0.01
    rise: float = 1.1
    repeats: float = 1e-3
    most_repeated: int = 4
    pace: int = 40
    stride: int = 8
    low: float = 0.9
    low_places: int = 3
    confirmed: float = 0.85
    near: float = 2.0
    fine: float = 1e-3
    most_points: int = 16
    chatter: float = 15.0
    steps: int = 1024


CRITERIA = SteadyCriteria()


class Transient:
    """Time integration of a structure, period by period.

    Parameters
    ----------
    sectors : AllSectors
    omega : float, rad/s
    start : (n_unknowns,) float or Motion
        Harmonic-balance solution at any frequency, or the end of another time integration.
    steps : int, optional
        Time steps per period; :data:`~bdamper.time_domain.integration.STEPS` by default.
    blade : int, optional
        Blade whose amplitude is returned; by default the blade with the highest mean amplitude in
        the second half of the periods.

    Attributes
    ----------
    motion : Motion
        Current state.
    harmonics : list of (n_blades, n_harmonics + 1) complex, m
        Response amplitudes of all blades in each period; the first is the mean.
    energy : list of (4,) float, J
        Energies of each period (:class:`~bdamper.time_domain.integration.Trajectory`).
    stored : list of (int, float)
        Numbers of periods, and the energy (J) that the contact springs store after them.
    memory : float
        Number of periods in which a transient of the least damped mode decays to 1/e.  Rigid
        motions of free bodies, which only contacts damp, are not included.

    Raises
    ------
    SettingError
        If the initial motion belongs to another structure, or there are too few time steps.
    """

    def __init__(
        self,
        sectors: AllSectors,
        omega: float,
        start: NDArray | Motion,
        steps: int | None = None,
        blade: int | None = None,
    ) -> None:
        if steps is None:
            self.steps = STEPS
        else:
            self.steps = validation.integer("steps_per_period", steps, least=16)
        self.sectors = sectors
        self.omega = omega
        self._blade = blade
        if isinstance(start, Motion):
            _check_motion(sectors, start)
            self.motion = start
        else:
            self.motion = sectors.start(start, omega, self.steps)
        self.harmonics: list[NDArray] = []
        self.energy: list[NDArray] = []
        # an amplitude decays like exp(-damping t/2): to 1/e in 2/damping, in periods 2 pi/omega
        damping = max(sectors.least_damping, 1e-9 * omega)
        self.memory = float(omega / (np.pi * damping))
        # energy of the motion, and its bound: initial energy, work of excitation and damping
        self._energy_now = sectors.energy(self.motion)
        self._energy_supplied = self._energy_now
        self.stored: list[tuple[int, float]] = [(0, sectors.contact_energy(self.motion))]

    @property
    def blades(self) -> NDArray:
        """First harmonic (n_periods, n_blades) of all blades, complex, m."""
        return np.array(self.harmonics)[:, :, 1]

    @property
    def response(self) -> NDArray:
        """Response (n_periods, n_harmonics + 1) of the blade, complex, m.

        It has the phases of the first blade.
        """
        amplitudes = np.array(self.harmonics)[:, self.blade]
        # the excited wave reaches the blade with this phase, and harmonic l with l times it
        phase = 2.0 * np.pi * self.blade * self.sectors.wave / self.sectors.n
        harmonic = np.arange(amplitudes.shape[1])
        return np.asarray(amplitudes * np.exp(-1j * phase * harmonic))

    @property
    def blade(self) -> int:
        """Index of the blade whose amplitude is returned."""
        if self._blade is not None:
            return self._blade
        return int(np.abs(second_half(self.blades)).mean(axis=0).argmax())

    @property
    def amplitude(self) -> NDArray:
        """Amplitude (n_periods,) of the first harmonic of the blade, m."""
        return np.abs(self.response[:, 1])

    def advance(self, periods: int = 1, ends: tuple[float, float] | None = None) -> None:
        """Integrate some periods; if ``ends`` (rad/s) is given, the frequency changes linearly with
        time.

        Raises
        ------
        IntegrationFailed
            If the contact forces of a time step are not found.
        EnergyGained
            If the energy exceeds its bound.
        """
        raise_if_stopped()
        begin, end = (self.omega, None) if ends is None else ends
        path = self.sectors.integrate(self.motion, begin, self.steps, periods, omega_end=end)
        self.motion = path.motion
        self.harmonics.extend(path.harmonics)
        self.energy.extend(path.energy)
        self.stored.append((len(self.harmonics), self.sectors.contact_energy(self.motion)))
        for work, damping, _, rise in path.energy:
            self._energy_now = self._energy_now + rise
            self._energy_supplied = self._energy_supplied + abs(work) + abs(damping)
            # "not <=" instead of ">": also if an energy is NaN
            if not self._energy_now <= CRITERIA.gain * self._energy_supplied:
                raise EnergyGained(
                    f"the time integration gains energy near {begin / TWO_PI:.6g} Hz, "
                    f"an error of its time steps: raise steps_per_period, {self.steps} now"
                )

    def run(
        self, periods: int, progress: bool = False, decided: Callable[[], bool] | None = None
    ) -> bool:
        """Integrate up to a total number of periods, or until ``decided`` returns true at a check.

        Returns
        -------
        bool
            Whether Ctrl-C ended the integration.
        """
        with (
            LongWork() as work,
            progress_counter(progress, periods, 0, "time integration", "period") as count,
        ):
            while len(self.harmonics) < periods:
                self.advance()
                count()
                at_check = len(self.harmonics) % CRITERIA.look == 0
                if decided is not None and at_check and decided():
                    break
        return work.interrupted

    def sweep(self, end: float, periods: int, count: Callable[[], Any] = lambda: None) -> None:
        """Integrate periods over which the frequency changes to ``end`` (rad/s).

        Its square changes linearly in the angle.
        """
        square = np.linspace(self.omega**2, end**2, periods + 1)
        for first in range(0, periods, CRITERIA.look):
            last = min(first + CRITERIA.look, periods)
            omega_first = float(np.sqrt(square[first]))
            omega_last = float(np.sqrt(square[last]))
            self.advance(last - first, (omega_first, omega_last))
            for _ in range(last - first):
                count()
        self.omega = end


def _check_motion(sectors: AllSectors, motion: Motion) -> None:
    """Raise SettingError if a motion does not have the coordinates and sliders of the sectors."""
    laws = sectors.system.structure.points.own
    width = 2 if laws is None else 2 + laws.width
    coordinates = (2 * sectors.n_coordinates,)
    sliders = (sectors.n, sectors.system.n_points, width)
    if motion.q.shape != coordinates or motion.w.shape != sliders:
        raise SettingError(
            "start: the motion belongs to another study; its coordinates and sliders have the "
            f"shapes {motion.q.shape} and {motion.w.shape} instead of {coordinates} and {sliders}"
        )


class SteadyPoint(NamedTuple):
    """Motion at one frequency after :func:`settle`.

    Parameters
    ----------
    transient : Transient
        Time integration with all periods.
    stays : bool
        Whether the motion stays near the expected amplitude: it has neither fallen nor grown beyond
        :attr:`SteadyCriteria.gain` times this amplitude.
    change : float
        Relative change of its mean, past or expected.
    """

    transient: Transient
    stays: bool
    change: float

    @property
    def frequency(self) -> float:
        """Frequency, Hz."""
        return self.transient.omega / TWO_PI

    @property
    def amplitude(self) -> NDArray:
        """Largest blade amplitude in each period of the second half, m, (n_periods,)."""
        return second_half(self.transient.amplitude)

    @property
    def mean(self) -> float:
        """Mean amplitude, m."""
        return float(self.amplitude.mean())

    @property
    def deviation(self) -> float:
        """Standard deviation of the amplitude of single periods, relative to their mean."""
        return float(np.std(self.amplitude)) / self.mean

    @property
    def half_range(self) -> float:
        """Half of the largest peak-to-peak response of a blade, mean over the same periods, m."""
        return float(half_range(second_half(self.transient.response)).mean())

    @property
    def steady(self) -> bool:
        """Whether the motion stays and its mean does not change."""
        return self.stays and abs(self.change) <= CRITERIA.drift


def settle(transient: Transient, expected: float, parting: bool = False) -> SteadyPoint:
    """Integrate until a motion is steady or has fallen, for at most :attr:`SteadyCriteria.most`
    periods.

    Parameters
    ----------
    transient : Transient
    expected : float, m
        Amplitude near which the motion may stay.
    parting : bool
        Whether to continue until the motion has lasted, and while the motion in other waves than
        the excited wave grows.  It has lasted after :attr:`SteadyCriteria.lasting` periods, or
        after fewer if these waves have decayed.
    """
    while True:
        transient.advance(CRITERIA.fewest // 2)
        n = len(transient.harmonics)
        # the means need at least these periods
        if n < CRITERIA.fewest:
            continue
        at_end = n >= CRITERIA.most
        change, before, last = _change(transient, at_end)
        # a beat may be low in one quarter, but at the end the latest quarter counts
        highest = last if at_end else max(before, last)
        fallen = highest < CRITERIA.jump * expected
        grown = min(before, last) > CRITERIA.gain * expected
        if fallen or grown:
            return SteadyPoint(transient, stays=False, change=change)
        if at_end:
            return SteadyPoint(transient, stays=True, change=change)
        is_constant = abs(change) <= CRITERIA.drift
        if is_constant and (not parting or _has_lasted(transient)):
            return SteadyPoint(transient, stays=True, change=change)


def unsettled(transient: Transient) -> SteadyPoint | None:
    """Return a motion that was interrupted before it settled; None without enough periods for a
    mean.
    """
    n_periods = len(transient.harmonics)
    if n_periods < CRITERIA.fewest:
        return None
    change = _change(transient, at_end=True).largest
    # the drift is at least the largest one of a settled motion
    change = float(np.copysign(max(abs(change), 2.0 * CRITERIA.drift), change))
    return SteadyPoint(transient, stays=True, change=change)


def _has_lasted(transient: Transient) -> bool:
    """Return whether a motion of constant mean has lasted, so that the blades do not part further.

    The mean is constant over the last three quarters of the periods.
    """
    n = len(transient.harmonics)
    quarter = n // 4
    waves = outside(transient, quarter)
    if n >= CRITERIA.lasting:
        return waves.growth <= CRITERIA.rise
    is_long = 3 * quarter >= CRITERIA.window
    return is_long and waves.size <= CRITERIA.decayed * CRITERIA.seed


class _Change(NamedTuple):
    """Change of a mean amplitude.

    Parameters
    ----------
    largest : float
        Largest relative change over the last three quarters, or expected.
    before, last : float, m
        Means of the last two quarters.
    """

    largest: float
    before: float
    last: float


def _change(transient: Transient, at_end: bool) -> _Change:
    """Return the change of the mean amplitude over the last three quarters of the periods.

    At the end a change that grows from one quarter to the next counts as a beat, without an
    expected change.
    """
    quarter = len(transient.harmonics) // 4
    last_three_quarters = transient.amplitude[-3 * quarter :]
    # means of the second, the third and the last quarter
    second, third, last = last_three_quarters.reshape(3, quarter).mean(axis=1)
    change_before = (third - second) / max(last, 1e-300)
    change_now = (last - third) / max(last, 1e-300)

    # a transient falls by at least this factor from one quarter to the next
    slowest = np.exp(-quarter / transient.memory)
    ratio = max(change_now / change_before, 0.0) if change_before else 0.0
    beats = at_end and ratio >= 1.0
    factor = 0.0 if beats else min(ratio, slowest)
    # rest of a geometric series, in units of the last change
    rest = factor / (1.0 - factor)
    if at_end and factor > 0.0:
        # from the mean of the last two quarters, half a change before the last one
        rest = rest + 0.5
    expected = change_now * rest
    largest = float(max(change_before, change_now, expected, key=abs))
    return _Change(largest=largest, before=third, last=last)


class OtherWaves(NamedTuple):
    """Motion in other waves than the excited wave.

    Parameters
    ----------
    growth : float
        Ratio of the size to the size in the same number of periods before, or 0 if the size is
        below the fraction :attr:`SteadyCriteria.decayed` of the disturbances.
    size : float
        Root mean square of the fraction of the motion in other waves.
    """

    growth: float
    size: float


def outside(transient: Transient, periods: int) -> OtherWaves:
    """Return the motion in other waves than the excited wave, in the last periods."""
    # fraction of the motion in other waves: in these periods, and in an equal number before them
    fraction = transient.sectors.departure(transient.blades[-2 * periods :])
    earlier, latest = np.array_split(fraction, 2)
    size_before = float(np.sqrt((earlier**2).mean()))
    size = float(np.sqrt((latest**2).mean()))
    growth = 0.0
    if size > CRITERIA.decayed * CRITERIA.seed and size_before > 0.0:
        growth = size / size_before
    return OtherWaves(growth=growth, size=size)


class Verdict(NamedTuple):
    """Verdict on a motion, its reason, and the number of last periods whose amplitudes the reason
    gives.
    """

    verdict: str
    reason: str
    periods: int


def energy_error(transient: Transient, periods: int = CRITERIA.balanced) -> float:
    """Return the error of the energy balance over the last periods, relative to the energy supplied
    in them.

    The time steps lose or gain the rest of the work after damping, contacts and rise.  The contacts
    return what their springs have stored; anything beyond is an error too.
    """
    # energy that the contact springs store now, and before these periods or at the first instant
    end, stored_now = transient.stored[-1]
    begin, stored_before = transient.stored[0]
    for n_periods, stored_then in transient.stored:
        if n_periods <= end - periods:
            begin, stored_before = n_periods, stored_then
    if end == begin:
        return 0.0
    work, damping, contacts, rise = np.sum(transient.energy[begin:end], axis=0)
    numerical = work - damping - contacts - rise
    if np.isfinite(stored_now):
        stored = stored_now - stored_before
    else:
        # the energy that user-defined laws store is unknown; energy that they return was stored
        stored = min(contacts, 0.0)
    dissipated = contacts - stored
    # each term may supply energy or take it
    supplies = np.array([work, -damping, -dissipated, -(rise + stored), -numerical])
    supplied = float(supplies[supplies > 0.0].sum())
    # far from a resonance little energy is supplied; a thousandth of the energy of the vibration is
    # the loss of a damping ratio of 1e-4
    vibration = (end - begin) * transient.sectors.vibration_energy(
        transient.motion, transient.omega
    )
    # contacts that dissipate less than nothing have returned more than they stored
    error = max(abs(numerical), -dissipated)
    return float(error / max(supplied + 1e-3 * vibration, 1e-300))


def step_error(transient: Transient) -> str:
    """Return the reason why the time steps are too long for a motion, from its energy or its
    amplitude, with a remedy, or "".
    """
    remedy = f"use steps_per_period={4 * transient.steps}"
    error = energy_error(transient)
    # also if the error is NaN
    if not error <= CRITERIA.energy:
        return f"the time steps change its energy by {percent(error)} per period; {remedy}"
    bound = transient.sectors.amplitude_bound(transient.omega)
    mean = np.abs(second_half(transient.blades)).mean(axis=0)
    if transient.sectors.n > 1:
        # a single blade may exceed the bound, which holds for the root mean square over all
        amplitude = float(np.sqrt((mean**2).mean()))
    else:
        # one sector may contain all blades of a mistuned disk
        amplitude = float(mean.max())
    if not amplitude <= (1.0 + CRITERIA.tolerance) * bound:
        return (
            f"its amplitude of {amount(amplitude, 'm')} is higher than without contacts, "
            f"where damping limits it to {amount(bound, 'm')}; {remedy}"
        )
    return ""


def judged(amplitude: NDArray, expected: float, tolerance: float, memory: float) -> Verdict:
    """Return the verdict from the amplitudes so far; "undecided" requires more periods.

    Parameters
    ----------
    amplitude : (n_periods,) float, m
    expected : float, m
        Amplitude of the solution.
    tolerance : float
        Relative tolerance.
    memory : float
        Periods in which a transient of the least damped mode falls to 1/e.
    """
    look = CRITERIA.look
    span = 2 * CRITERIA.window
    # relative distance (n_periods,) from the solution, and its mean over the last periods
    off = amplitude / max(expected, 1e-300) - 1.0
    n = len(off)
    last = float(off[-look:].mean())
    if n < 3 * look:
        periods = min(n, look)
        few = f"mean amplitude over {periods} periods {_in_percent(last)} % from the solution; {TOO_FEW}"
        return Verdict(UNDECIDED, few, periods)

    # left
    distances = np.abs(off[-2 * look :])
    before = float(off[-2 * look : -look].mean())
    if (distances > 2.0 * tolerance).all() and abs(last) >= abs(before):
        left = f"{_in_percent(last)} %, not approaching the solution within {look} periods"
        return Verdict(DIFFERS, left, look)
    if n < span + look:
        few = f"{_in_percent(last)} % so far; {span + look} periods show whether it has settled"
        return Verdict(UNDECIDED, few, look)

    # settled
    recent = off[-span:]
    mean = float(recent.mean())
    stays = float(np.quantile(np.abs(recent), 0.9)) <= 2.0 * tolerance
    within = abs(mean) <= tolerance
    still_within = abs(last + to_come(amplitude, memory)) <= tolerance
    same_verdict_later = not stays or within == still_within
    drift, fades = _drift(off, memory)
    spread = f"{_in_percent(recent.min())} to {_in_percent(recent.max())} %"
    # a motion that begins to beat, or an irregular one, has the right mean for some time
    agrees = stays and within
    varies = float(np.ptp(recent))
    is_short = varies > 2.0 * tolerance and n < 2 * span
    begins_to_beat = varies > tolerance and _range_grows(recent)
    if agrees and (is_short or begins_to_beat):
        varying = f"{spread} within {span} periods, which may grow"
        return Verdict(UNDECIDED, varying, look)
    if abs(drift) < CRITERIA.drift and fades and same_verdict_later:
        text = f"mean of {span} periods {_in_percent(mean)} %"
        if np.ptp(recent) > CRITERIA.drift:
            text = f"{text}, {spread}"
        return Verdict(AGREES if agrees else DIFFERS, text, span)

    # wanders
    if n >= 2 * span and not stays and _wanders(recent, off[-2 * span : -span], memory):
        return Verdict(DIFFERS, f"wanders, {spread} within {span} periods", span)
    changing = (
        f"{_in_percent(last)} %, changed by {_in_percent(drift)} % within {span} periods; "
        f"a transient takes {memory:.3g} periods to fall to 1/e"
    )
    return Verdict(UNDECIDED, changing, look)


def _in_percent(share: float) -> str:
    """Return a share as a number in per cent, with its sign."""
    return f"{100.0 * share:+.2g}"


def _range_grows(off: NDArray) -> bool:
    """Return whether most of the second half of the periods have a larger range than most of the
    first.
    """
    first_half, other_half = np.split(off, 2)
    # the range of the middle 60 % of the periods
    range_before = np.ptp(np.quantile(first_half, (0.2, 0.8)))
    range_now = np.ptp(np.quantile(other_half, (0.2, 0.8)))
    return bool(range_now > (1.0 + CRITERIA.tolerance) * range_before)


def _drift(off: NDArray, memory: float) -> tuple[float, bool]:
    """Return the relative drift of a mean within two windows, and whether it fades.

    ``off`` (n_periods,) contains the relative distances from a solution.
    """
    look = CRITERIA.look
    window = CRITERIA.window
    n = len(off)
    two_windows_ago = float(off[n - 2 * window - look : n - 2 * window].mean())
    one_window_ago = float(off[n - window - look : n - window].mean())
    now = float(off[n - look :].mean())
    drift = (now - two_windows_ago) / max(1.0 + two_windows_ago, 1e-300)
    slowest = float(np.exp(-window / memory))
    fades = drift_fades(one_window_ago - two_windows_ago, now - one_window_ago, slowest)
    return drift, fades


def _wanders(recent: NDArray, earlier: NDArray, memory: float) -> bool:
    """Return whether largest distance and range exceed those before, after their decay."""
    decay = min(1.0, 1.1 * np.exp(-len(recent) / memory))
    farther = np.abs(recent).max() > decay * np.abs(earlier).max()
    wider = np.ptp(recent) > decay * np.ptp(earlier)
    return bool(farther and wider)


def drift_fades(change_before: float, change_now: float, slowest: float) -> bool:
    """Return whether the mean becomes constant, judged by its changes over two windows of equal
    length.

    Near a fold the mean of a motion may drift at almost constant speed and fall after hundreds of
    periods.  A transient becomes ``slowest`` times as large from one window to the next, or
    smaller.  For slower changes the rest of a geometric series counts: if each change is r times
    the one before, r/(1 - r) times the last one is still to come.
    """
    # rounding
    if abs(change_now) <= 1e-3 * CRITERIA.drift:
        return True
    # changes of opposite sign belong to a beat
    if change_before * change_now <= 0.0:
        return abs(change_now) <= 1.2 * abs(change_before)
    ratio = change_now / change_before
    # a small change that grows can end in a fall
    if abs(change_now) <= 0.1 * CRITERIA.drift:
        return ratio <= 1.02
    if ratio >= 1.0:
        return False
    # rounding and a small ripple may slow a transient by a few per cent
    if ratio <= 1.02 * slowest:
        return True
    return abs(change_now) * ratio / (1.0 - ratio) <= CRITERIA.drift


def second_half(x: NDArray) -> NDArray:
    """Return the second half of the periods, from which means and ranges are computed."""
    return x[len(x) // 2 :]


def to_come(amplitude: NDArray, memory: float) -> float:
    """Return the estimated remaining relative change of the mean.

    The means of the last two quarters differ by a transient that falls to 1/e in ``memory``
    periods.  If it falls by a factor p from one quarter to the next, the remaining change is p/(1 -
    p) times the difference.
    """
    before, last = np.array_split(second_half(amplitude), 2)
    change = float((last.mean() - before.mean()) / max(float(last.mean()), 1e-300))
    # the factor p
    fall = np.exp(-len(last) / memory)
    return change * fall / (1.0 - fall)


def repeats_after(harmonics: NDArray) -> int | None:
    """Return the smallest number of periods after which a motion repeats in its last quarter, or
    None.

    Parameters
    ----------
    harmonics : (n_periods, n_harmonics + 1) complex, m
        Amplitudes of each period.
    """
    # without the mean
    vibration = harmonics[:, 1:]
    n_periods = len(vibration)
    last_quarter = np.arange(n_periods - max(1, n_periods // 4), n_periods)
    amplitude = max(float(np.linalg.norm(vibration[last_quarter], axis=1).max()), 1e-300)
    for n in range(1, CRITERIA.most_repeated + 1):
        # too few periods before the last quarter
        if last_quarter[0] < n:
            return None
        difference = vibration[last_quarter] - vibration[last_quarter - n]
        change = np.linalg.norm(difference, axis=1)
        if change.max() <= CRITERIA.repeats * amplitude:
            return n
    return None
