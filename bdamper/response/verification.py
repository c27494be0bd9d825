"""Results of checks of a solution: time integration, convergence with harmonics, error estimates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bdamper.response.motion_range import exceeds, range_text
from bdamper.util import validation
from bdamper.util.display import Fact, Plottable, Summarised, draw
from bdamper.util.errors import COMPLETE, INCOMPLETE, INTERRUPTED, status_word
from bdamper.util.formatting import amount, counted, peak_text, percent, short_repr, span
from bdamper.util.progress import Cost
from bdamper.util.records import Data, Record
from bdamper.util.storage import FilePath, Recorded, Storable
from bdamper.util.tables import (
    ROW,
    Amplitude,
    Column,
    Cycles,
    Metre,
    Newton,
    Numbers,
    Quantity,
    Second,
    Tabular,
    columns_of_rows,
)

# ---- response in time ----


ALIKE = 0.05
"""Relative difference of the mean amplitudes of two blades below which they vibrate equally.  Also
the amplitude relative to the largest wave below which waves are not listed.
"""
BEATS = 0.1
"""Excess of the highest period over the mean amplitude from which the headline names it."""


def energy_shares(energy: tuple[float, ...]) -> tuple[float, NDArray]:
    """Return the energy (J) supplied in a period, and the shares that take it.

    Shares: damping, contacts, rise of kinetic and strain energy, and error of the time steps.

    The work of the excitation is the supply, with everything that gives energy instead of taking
    it: far from a resonance the work alone may be close to zero.
    """
    taken = np.array([*energy[1:], energy[0] - sum(energy[1:])])
    supplied = max(energy[0], 0.0) - taken[taken < 0.0].sum()
    return float(supplied), taken / max(supplied, 1e-300)


def energy_change(energy: tuple[float, ...]) -> str:
    """Return a text if kinetic and strain energy change by more than a fifth of the supply, or ""."""
    _, (_, _, rise, _) = energy_shares(energy)
    if abs(rise) <= 0.2:
        return ""
    return f"its stored energy changes by {percent(rise, True)} of the energy of a period; use more periods"


class AllBlades(Summarised):
    """Base class of motions in time: differences of the blades, energy of a period, travelling waves."""

    blade: int
    blades: NDArray
    waves: NDArray
    energy: tuple[float, ...]

    @property
    def spread(self) -> tuple[float, float]:
        """Mean amplitudes of the lowest and the highest blade, m; NaN without time integration."""
        mean = self.blades.mean(axis=0) if self.blades.size else np.full(1, np.nan)
        return float(mean.min()), float(mean.max())

    @property
    def parted(self) -> bool:
        """Whether equal blades vibrate differently, with the same high blades in all periods."""
        low, high = self.spread
        if not (len(self.waves) > 1 < len(self.blades) and high > (1.0 + ALIKE) * low):
            return False
        halves = [half.mean(axis=0) for half in np.array_split(self.blades, 2)]
        # smallest correlation of the blade amplitudes in both halves of the periods
        same = 0.8
        return bool(np.corrcoef(*halves)[0, 1] > same)

    @property
    def numerical_loss(self) -> float:
        """Error of the energy balance of a period relative to the supply; NaN if not integrated."""
        return float(energy_shares(self.energy)[1][3]) if self.energy else float("nan")

    def _unlike(self) -> str:
        return f" Blades do not vibrate alike: {span(*self.spread, 'm')}." if self.parted else ""

    def _facts(self) -> tuple[Fact, ...]:
        """Return facts of the time integration, with the energy of a period and the waves."""
        unequal = self.blades.size and not self.waves.size
        out = [Fact("blade", self.blade)] * bool(unequal) + list(super()._facts())
        if self.energy:
            supplied, shares = energy_shares(self.energy)
            listed = [
                f"{name} {percent(x)}"
                for name, x in zip(("damping", "contacts", "rise", "numerical"), shares)
            ]
            out.append(Fact("energy of a period", f"{amount(supplied, 'J')}: {', '.join(listed)}"))
        if len(self.waves) > 1:
            out.append(Fact("lowest to highest blade", span(*self.spread, "m")))
            high = [(d, a) for d, a in self.waves if a > ALIKE * self.waves[0, 1]]
            ways = [
                f"{abs(d):.0f} {'backward' if d < 0 else 'forward'} {amount(float(a), 'm')}"
                for d, a in high
            ]
            out.append(Fact("waves, nodal diameters", ", ".join(ways)))
        return tuple(out)


@short_repr
@dataclass(frozen=True)
class TimeResponse(AllBlades, Plottable, Recorded, Storable, kind="bdamper-time-response"):
    """Highest steady-state amplitude in time near a resonance at one preload, with its error.

    ``plot`` draws the amplitudes of all blades (:func:`bdamper.plot.plot_blades`).

    Parameters
    ----------
    mean : float, m
        Amplitude of the first harmonic of the highest blade, mean over periods.
    lowest, highest : float, m
        Range of the mean: all ``answers`` and higher ``starts``, widened by the remaining change of
        a settled motion or the standard deviation of its periods.  It contains ``highest_period``.
    frequency, preload : float, Hz, N
    balance : float, m
        Amplitude of the highest peak by harmonic balance.
    highest_period : float, m
        Highest amplitude of a single period in all ``answers``.
    fall : float, Hz
        Frequency closest to the highest motion at which the motion changes to another amplitude;
        NaN if there is none.
    structure : str
        Modes in the response curve and in time.
    periods : int
        Total number of periods.
    diameters : tuple of int
        Nodal diameters of the model.
    status : str
        "complete", "interrupted", or "incomplete: " and "not found: " with the reason.  It is
        "incomplete: not settled" if two of the ``answers``, or one of them and a higher one of the
        ``starts``, differ by more than 5 %.
    cost : Cost
    blade : int
        Highest blade.
    blades : (n_periods, n_blades) float, m
        Amplitudes of all blades in the last periods.
    waves : (n_blades, 2) float
        Nodal diameters and amplitudes (m) of the travelling waves of the motion, in descending
        order.  A wave against the direction of the excitation has a negative nodal diameter.
    answers : dict of str to float, m
        Mean amplitude of the highest blade with n, 2n and 4n time steps, in a richer structure, and
        at ``fall``.
    starts : dict of str to float, m
        Mean amplitude that other initial states lead to.
    energy : tuple of four float, J
        In a period, all blades: work of the excitation, loss in damping, loss in contacts, and rise
        of kinetic and strain energy.
    growth : float
        Growth rate per period of the motion in other waves than the excited wave; negative if it
        decays, NaN if too small.
    half_range : float, m
        Half of the peak-to-peak response of the highest blade with the harmonics of the study, mean
        over periods.
    settings : mapping
    model_hash : str
    """

    mean: Metre
    lowest: Metre
    highest: Metre
    frequency: Cycles
    preload: Newton
    balance: Metre
    highest_period: Metre = float("nan")
    fall: Cycles = float("nan")
    structure: str = ""
    periods: int = 0
    diameters: tuple[int, ...] = ()
    status: str = COMPLETE
    cost: Cost = field(default_factory=Cost)
    blade: int = -1
    blades: NDArray = field(default_factory=lambda: np.zeros((0, 0)), compare=False)
    waves: NDArray = field(default_factory=lambda: np.zeros((0, 2)), compare=False)
    answers: Annotated[dict[str, float], Quantity("m")] = field(default_factory=dict)
    starts: Annotated[dict[str, float], Quantity("m")] = field(default_factory=dict)
    energy: tuple[float, ...] = ()
    growth: float = field(default=float("nan"), compare=False)
    half_range: Annotated[float, Quantity("m"), Data(derived=True)] = float("nan")
    _summary_fields = (
        "mean", "lowest", "highest", "highest_period", "balance", "frequency", "fall", "preload", "structure", "diameters",
        "answers", "starts", "growth", "status",
    )  # fmt: skip

    @property
    def elsewhere(self) -> int:
        """Number of other initial states that lead to another motion."""
        return sum(abs(a / self.mean - 1.0) > ALIKE for a in self.starts.values())

    @property
    def settled(self) -> bool:
        """Whether all ``answers`` agree, and nothing indicates a higher motion: status "complete".

        Single periods may still differ, from ``lowest`` to ``highest``.
        """
        return status_word(self.status) == COMPLETE

    @property
    def largest(self) -> float:
        """Amplitude (m) for the stress: the larger of ``highest`` and ``highest_period``."""
        return float(np.fmax(self.highest, self.highest_period))

    @property
    def factor(self) -> float:
        """Largest amplitude in time over the one by harmonic balance, as a factor on stress."""
        return self.largest / self.balance

    @property
    def text(self) -> str:
        """Mean and range, "55 µm (53 to 58)".

        Only the range if answers differ; the status if nothing was found.
        """
        if self.mean != self.mean:
            return self.status
        if "not settled" in self.status:
            return span(self.lowest, self.highest, "m")
        return f"{amount(self.mean, 'm')} ({span(self.lowest, self.highest, 'm', near=self.mean).rpartition(' ')[0]})"

    def mark(self, ax: object, path: FilePath | None = None) -> object:
        """Draw mean and range as a point with a bar over response curves.

        The picture is drawn by :func:`bdamper.plot.mark_time_response`.
        """
        return draw(self, "figure", "mark", path, ax)

    def _headline(self) -> str:
        at = f"At {amount(self.preload, 'N')}"
        if self.mean != self.mean:
            why = self.status.partition(": ")[2] or self.status
            return f"{at} the amplitude in time is not known, so nothing confirms the peak of the harmonic balance: {why}."
        peak = f"the peak of the harmonic balance is {amount(self.balance, 'm')}"
        doubt = f" ({self.status})" if self.status != COMPLETE else ""
        head = f"{at} in time the highest blade has {self.text} at {amount(self.frequency, 'Hz', 6)}{doubt}; {peak}."
        if self.highest_period > (1.0 + BEATS) * self.mean:
            head = f"{head} Single periods reach {amount(self.highest_period, 'm')}."
        if exceeds(self.half_range, self.mean):
            head = (
                f"{head} These are amplitudes of the first harmonic; {range_text(self.half_range)}."
            )
        head += self._unlike()
        if self.starts:
            head = f"{head} {self.elsewhere} of {len(self.starts)} other starts came to another motion."
        jump = f" The motion jumps to a lower amplitude at {amount(self.fall, 'Hz', 6)}."
        return head if self.fall != self.fall else head + jump


@short_repr
@dataclass(frozen=True)
class MotionInTime(
    AllBlades, Plottable, Tabular, Recorded, Storable, kind="bdamper-motion-in-time", row="period"
):
    """One motion in time from a solution of the harmonic balance, period by period.

    ``plot`` draws the amplitude over the periods (:func:`bdamper.plot.plot_periods`).

    Parameters
    ----------
    mean, lowest, highest : float, m
        Amplitude of the first harmonic of the highest blade: mean, and range of single periods.
        With a verdict over the periods named in its reason, otherwise over the second half.
    frequency, preload : float, Hz, N
    harmonics : (n_periods, n_harmonics + 1) complex, m
        Response amplitudes of the highest blade; the first column is the mean position.
    balance : float, m
        Amplitude of the solution at which the motion starts; NaN if it is at another frequency.
    verdict : str
        "agrees", "does not agree" or "undecided": whether the motion stays at its initial solution,
        if examined.
    reason : str
        Reason of the verdict.
    distance : float
        Relative distance of the vibration in the last period from the initial solution.
    repeats_after : int or None
        Number of periods after which the motion repeats: 1 if periodic, None if irregular.
    diameters, status, cost, blade, blades, waves, energy, growth, settings, model_hash
            See :class:`TimeResponse`.
    """

    mean: Metre
    lowest: Metre
    highest: Metre
    frequency: Cycles
    preload: Newton
    harmonics: Annotated[NDArray, Quantity("m", dims=(ROW, "harmonic"))] = field(compare=False)
    balance: Metre = float("nan")
    verdict: str = ""
    reason: str = ""
    distance: float = field(default=float("nan"), compare=False)
    repeats_after: int | None = None
    diameters: tuple[int, ...] = ()
    status: str = COMPLETE
    cost: Cost = field(default_factory=Cost)
    blade: int = -1
    blades: NDArray = field(default_factory=lambda: np.zeros((0, 0)), compare=False)
    waves: NDArray = field(default_factory=lambda: np.zeros((0, 2)), compare=False)
    energy: tuple[float, ...] = ()
    growth: float = field(default=float("nan"), compare=False)
    _summary_fields = (
        "mean", "lowest", "highest", "balance", "frequency", "preload", "diameters", "growth", "verdict", "distance",
        "status",
    )  # fmt: skip

    @property
    def period(self) -> Numbers:
        """Number (n_periods,) of each period."""
        return np.arange(len(self.harmonics))

    @property
    def amplitude(self) -> Amplitude:
        """Amplitude (n_periods,) of the first harmonic of the highest blade, m."""
        return np.abs(self.harmonics[:, 1])

    def columns(self) -> dict[str, Column]:
        """Return the columns of the periods."""
        columns = super().columns()
        return {name: columns[name] for name in ("period", "amplitude", "harmonics")}

    def _headline(self) -> str:
        kind = {None: "irregular", 1: "periodic"}.get(
            self.repeats_after, f"{self.repeats_after}-periodic"
        )
        ends = span(self.lowest, self.highest, "m", near=self.mean).rpartition(" ")[0]
        comes = (
            f"the highest blade comes to {amount(self.mean, 'm')} ({ends}) in time at {amount(self.frequency, 'Hz', 6)}, "
            f"{kind}"
        )
        at = f"At {amount(self.preload, 'N')}"
        if not self.verdict:
            return f"{at} {comes}; {self.status}.{self._unlike()}"
        solution = f"the solution of {amount(self.balance, 'm')}"
        verdict = (
            f"it is undecided whether time integration agrees with {solution}" if self.verdict == "undecided"
            else f"time integration {self.verdict} with {solution}"
        )  # fmt: skip
        doubt = (
            f" Status: {self.status}."
            if self.status != COMPLETE and self.verdict not in self.status
            else ""
        )
        return f"{at} {verdict}: {comes} ({self.reason}).{self._unlike()}{doubt}"


# ---- convergence with harmonics ----


@dataclass(frozen=True)
class HarmonicPeak:
    """Peak with one number of harmonics.

    Parameters
    ----------
    harmonics : int
        Highest harmonic.
    amplitude, frequency : float, m, Hz
    seconds : float
        Processor time.
    """

    harmonics: int
    amplitude: Metre
    frequency: Cycles
    seconds: Second = 0.0


# ---- other friction coefficients ----


FRICTION_SPREAD = 1.5
"""Factor to which friction coefficients of dampers are typically known: within it the amplitude may
not double."""
MUCH = 2.0
"""Amplitude with another friction coefficient over that of the study that counts as too high."""


@dataclass(frozen=True)
class FrictionPeak(Record):
    """Highest peak with other friction coefficients.

    Parameters
    ----------
    factor : float
        Factor on all friction coefficients.
    preload : float, N
    amplitude : float, m
        NaN if unknown; infinite if no steady periodic response is expected.
    status : str
    lower_bound : float, m
        Amplitude of the highest computed point if the peak is incomplete; otherwise NaN.
    """

    factor: float
    preload: Newton
    amplitude: Metre
    status: str = COMPLETE
    lower_bound: Metre = field(default=float("nan"), compare=False)

    def __post_init__(self) -> None:
        # files of version 0.7 have lower bounds as amplitudes
        if status_word(self.status) == INCOMPLETE and np.isfinite(self.amplitude):
            object.__setattr__(self, "lower_bound", self.amplitude)
            object.__setattr__(self, "amplitude", float("nan"))

    def __str__(self) -> str:
        doubt = "" if self.status == COMPLETE else f" ({self.status})"
        return f"{self.size_text} with {self.factor:.3g} times the friction{doubt}"

    @property
    def size_text(self) -> str:
        """Amplitude as text: "75 µm", "at least 75 µm", "not steady" or "unknown"."""
        if self.amplitude == np.inf:
            return "not steady"
        if np.isfinite(self.amplitude):
            return amount(self.amplitude, "m")
        return f"at least {amount(self.lower_bound, 'm')}" if self.lower_bound > 0.0 else "unknown"

    def compared_with(self, own: FrictionPeak) -> str:
        """Return "high" if the amplitude exceeds twice that of ``own``, "low", or "unknown"."""
        limit = MUCH * own.amplitude
        if self.amplitude > limit or self.lower_bound > limit:
            return "high"
        return "low" if self.amplitude <= limit else "unknown"


class FrictionLimit(NamedTuple):
    """Factor on the friction coefficients at which the amplitude doubles, in one direction.

    Parameters
    ----------
    inside : float
        Farthest factor up to which no computed amplitude is twice that of the study.
    outside : float
        Next computed factor, with twice the amplitude or more; NaN if the amplitude does not
        double.
    known : bool
        Whether the amplitude at ``outside`` is known to be twice as high; otherwise it is unknown.
    """

    inside: float
    outside: float
    known: bool

    @property
    def near(self) -> bool:
        """Whether the amplitude doubles, or is unknown, within the usual spread of friction."""
        rounding = 1e-9
        return max(self.outside, 1.0 / self.outside) <= FRICTION_SPREAD * (1.0 + rounding)


@dataclass(frozen=True)
class FrictionRange(Record):
    """Peaks at one preload with other friction, and the factors at which the amplitude doubles.

    Parameters
    ----------
    peaks : tuple of FrictionPeak
        All computed peaks by ascending factor.
    remedy : float, N
        Nearest preload at which the amplitude does not double between 1/1.5 and 1.5 times the
        friction; NaN if there is no need for it, or if none was found.
    seconds : float
        Elapsed time of all peaks, also of the search for ``remedy``.
    """

    peaks: tuple[FrictionPeak, ...] = ()
    remedy: Newton = field(default=float("nan"), compare=False)
    seconds: Second = field(default=0.0, compare=False)

    @property
    def limits(self) -> tuple[FrictionLimit, FrictionLimit] | None:
        """Limits below and above the friction of the study; None if its amplitude is unknown."""
        own = next((peak for peak in self.peaks if peak.factor == 1.0), None)
        if own is None or not np.isfinite(own.amplitude) or len(self.peaks) == 1:
            return None
        below = [peak for peak in reversed(self.peaks) if peak.factor < 1.0]
        above = [peak for peak in self.peaks if peak.factor > 1.0]
        return self._limit(own, below), self._limit(own, above)

    @staticmethod
    def _limit(own: FrictionPeak, away: list[FrictionPeak]) -> FrictionLimit:
        """Return the limit in one direction, from the peaks in this direction by their distance."""
        inside = 1.0
        for peak in away:
            found = peak.compared_with(own)
            if found != "low":
                return FrictionLimit(inside, peak.factor, found == "high")
            inside = peak.factor
        return FrictionLimit(inside, np.nan, True)

    @property
    def doubles(self) -> tuple[float, float]:
        """Factors below and above 1 with twice the amplitude or more; NaN if there is none."""
        if self.limits is None:
            return np.nan, np.nan
        low, high = (limit.outside if limit.known else np.nan for limit in self.limits)
        return low, high

    def __str__(self) -> str:
        return f"{self.text} ({counted(len(self.peaks), 'peak')}, {amount(self.seconds, 's')})"

    @property
    def text(self) -> str:
        """Factors with twice the amplitude, and the range of factors without."""
        if self.limits is None:
            return "it is unknown with which friction the amplitude doubles"
        below, above = self.limits
        tolerated = f"from {below.inside:.2g} to {above.inside:.2g} times"
        doubled = [
            f"{limit.outside:.2g}"
            for limit in self.limits
            if limit.known and np.isfinite(limit.outside)
        ]
        unknown = [f"{limit.outside:.2g}" for limit in self.limits if not limit.known]
        if doubled:
            text = f"the amplitude doubles with {' and '.join(doubled)} times the friction, not {tolerated}"
        else:
            text = f"the amplitude does not double {tolerated} the friction"
        return f"{text}; it is unknown with {' and '.join(unknown)} times" if unknown else text

    @property
    def interrupted(self) -> bool:
        """Whether the search was interrupted."""
        return any(peak.status == INTERRUPTED for peak in self.peaks)


class Meeting(NamedTuple):
    """Harmonic near a mode of the structure with stuck contacts (internal resonance).

    Parameters
    ----------
    harmonic, mode : int
        Modes are counted from 1 at the nodal diameter of the harmonic.
    nodal_diameter : int
        -1 without cyclic symmetry.
    frequency : float, Hz
        Natural frequency of the mode.
    distance : float
        Frequency of the harmonic over the natural frequency, minus one.
    """

    harmonic: int
    mode: int
    nodal_diameter: int
    frequency: float
    distance: float

    def __str__(self) -> str:
        where = f" at nodal diameter {self.nodal_diameter}" if self.nodal_diameter >= 0 else ""
        near = f"within {percent(abs(self.distance))} of mode {self.mode} of the stuck structure{where}"
        return f"harmonic {self.harmonic} is {near} ({amount(self.frequency, 'Hz')})"


def _heights(peaks: Sequence[HarmonicPeak]) -> str:
    """Return the range of the amplitudes, or one amplitude if both ends have the same digits."""
    low, high = min(p.amplitude for p in peaks), max(p.amplitude for p in peaks)
    return amount(high, "m") if amount(low, "m") == amount(high, "m") else span(low, high, "m")


@short_repr
@dataclass(frozen=True)
class Convergence(Plottable, Tabular):
    """One peak with increasing number of harmonics.

    ``plot`` draws the amplitude over the number of harmonics
    (:func:`bdamper.plot.plot_convergence`).

    Parameters
    ----------
    preload : float, N
    tolerance : float
        Relative tolerance of the amplitude.
    peaks : tuple of HarmonicPeak
        Peak of the study, then peaks with more harmonics.
    internal_resonances : tuple of Meeting
        Internal resonances up to the highest possible harmonic.
    highest_harmonic : str
        Reason why the harmonics end before the highest requested one, or "".
    status : str
        "complete", "interrupted", or "incomplete: " with the reason why no peak was found with more
        harmonics.
    cost : Cost
    """

    preload: float
    tolerance: float
    peaks: tuple[HarmonicPeak, ...]
    internal_resonances: tuple[Meeting, ...] = ()
    highest_harmonic: str = ""
    status: str = COMPLETE
    cost: Cost = field(default_factory=Cost)
    _summary_fields = ("preload", "status", "internal_resonances")

    def columns(self) -> dict[str, Column]:
        """Return the columns of the table, one row for each number of harmonics."""
        return columns_of_rows(self.peaks)

    @property
    def settled(self) -> tuple[HarmonicPeak, ...]:
        """Last peaks that agree within the tolerance."""
        settled = self.peaks[-1:]
        for peak in self.peaks[-2::-1]:
            amplitude = [p.amplitude for p in (peak, *settled)]
            if max(amplitude) - min(amplitude) > self.tolerance * settled[-1].amplitude:
                break
            settled = (peak, *settled)
        return settled

    @property
    def range(self) -> tuple[float, float]:
        """Smallest and largest amplitude (m) of all peaks."""
        amplitude = [p.amplitude for p in self.peaks]
        return min(amplitude), max(amplitude)

    @property
    def converged(self) -> bool:
        """Whether the peak agrees with all peaks with more harmonics, at least two."""
        return (
            self.status == COMPLETE and len(self.peaks) > 2 and len(self.settled) == len(self.peaks)
        )

    @property
    def verdict(self) -> str:
        """Result of the convergence study in words."""
        first_peak, *more = self.peaks
        if not more:
            return "not known with more harmonics"
        first, last = more[0].harmonics, more[-1].harmonics
        result = f"{_heights(more)} with {first if first == last else f'{first} to {last}'}"
        if 1 < len(self.settled) < len(more):
            result += f", {_heights(self.settled)} from {self.settled[0].harmonics} on"
        if self.converged:
            return f"{result}: converged to {percent(self.tolerance)}"
        if len(self.settled) == len(self.peaks):
            return f"{result}: agrees so far"
        return f"{result}: not converged with {first_peak.harmonics}"

    @property
    def note(self) -> str:
        """Amplitude, verdict, and the reason why the harmonics end."""
        peak = self.peaks[0]
        text = f"{amount(peak.amplitude, 'm')} with {peak.harmonics} harmonic{'s' * (peak.harmonics != 1)}, {self.verdict}"
        text += f"; {self.highest_harmonic}" if self.highest_harmonic else ""
        text += f"; {self.status}" if self.status != COMPLETE else ""
        return text

    def _headline(self) -> str:
        return f"{self.note}."


# ---- error estimates ----


@dataclass(frozen=True)
class SourceError:
    """Estimated error of a peak from one source.

    Parameters
    ----------
    source : str
        "harmonics", "evaluation", "contact points", "modes", "residual flexibility" or "solver".
    amplitude, frequency : float
        Relative change of the peak with a more accurate setting; NaN without an estimate.
    uncertainty : float
        Relative change that the estimate may have missed; 0 if the peak was computed with the more
        accurate setting.
    against : str
        The more accurate setting and the method, or the reason why there is no estimate.
    """

    source: str
    amplitude: float
    frequency: float
    uncertainty: float
    against: str

    @property
    def known(self) -> bool:
        """Whether there is an estimate that is larger than its uncertainty."""
        change = np.abs([self.amplitude, self.frequency])
        return bool(
            np.isfinite(change).all()
            and (self.uncertainty == 0.0 or self.uncertainty < change.max())
        )

    @property
    def size(self) -> float:
        """Larger of both relative changes; NaN if unknown."""
        return (
            float(np.fmax(abs(self.amplitude), abs(self.frequency))) if self.known else float("nan")
        )

    def __str__(self) -> str:
        change = (
            f"amplitude {percent(self.amplitude, True)}, frequency {percent(self.frequency, True)}"
        )
        miss = (
            f", may miss {percent(self.uncertainty)}" if self.uncertainty > 0.05 * self.size else ""
        )
        return f"{self.source}: {f'{change}{miss} ({self.against})' if self.known else f'not estimated: {self.against}'}"


@short_repr
@dataclass(frozen=True)
class ErrorEstimates(Summarised):
    """Estimated errors of a peak, by source.

    Parameters
    ----------
    preload : float, N
    frequency, amplitude : float, Hz, m
        Frequency and amplitude of the peak.
    sources : tuple of SourceError
        Changes by more accurate settings, one setting at a time.
    """

    preload: float
    frequency: float
    amplitude: float
    sources: tuple[SourceError, ...]
    _summary_fields = ("sources",)

    def __getitem__(self, source: str) -> SourceError:
        by_name = {item.source: item for item in self.sources}
        return by_name[validation.choice("source", source, by_name)]

    @property
    def total(self) -> float:
        """Sum of all known errors: a bound if they do not interact."""
        return float(np.nansum([s.size for s in self.sources]))

    @property
    def unknown(self) -> tuple[str, ...]:
        """Sources without an estimate."""
        return tuple(s.source for s in self.sources if not s.known)

    @property
    def line(self) -> str:
        """Errors in one line, in per cent; sources below a hundredth of the sum are omitted."""
        known = sorted((s for s in self.sources if s.known), key=lambda s: -s.size)
        if not known:
            return "error not estimated"
        named = ", ".join(
            f"{s.source} {percent(s.size)[:-2]}" for s in known if s.size > 0.01 * self.total
        )
        text = f"{percent(self.total)} ({named})" if self.total > 1e-5 else "below 0.001 %"
        return f"estimated error {text}" + (
            f", not estimated: {', '.join(self.unknown)}" if self.unknown else ""
        )

    def _headline(self) -> str:
        peak = f"{peak_text(self.amplitude, self.frequency)}, preload {amount(self.preload, 'N')}"
        return f"{self.line[0].upper()}{self.line[1:]} of the peak of {peak}."
