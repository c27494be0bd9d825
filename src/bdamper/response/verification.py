"""What was marched in time at one preload, as a result carries it.

What more harmonics change of one peak: amplitude and frequency with each number, and modes they meet.

What error estimates look like: one number for each source of error, and what it was measured against.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bdamper.util import validation
from bdamper.util.display import Fact, Plottable, Summarised, draw
from bdamper.util.errors import COMPLETE
from bdamper.util.formatting import amount, peak_text, percent, short_repr, span
from bdamper.util.progress import Cost
from bdamper.util.storage import Recorded, Storable
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

# ---- What was marched in time at one preload, as a result carries it ----


ALIKE = 0.05
"""Relative difference of the means of two blades up to which blades vibrate alike, and part of the largest wave below which
others are not named."""


@short_repr
@dataclass(frozen=True)
class TimeResponse(
    Plottable, Tabular, Recorded, Storable, kind="bdamper-time-response", row="period"
):
    """What was marched in time at one preload: the highest amplitude toward the tip of the response, or one motion.

    ``plot`` draws the amplitudes of all blades, or those of the periods of one motion (:func:`bdamper.plot.plot_blades`).

    Parameters
    ----------
    mean, lowest, highest : float, m
        Amplitude of the harmonic of the excitation on the highest blade: mean over the last periods, and of single periods
        among them.  Where answers differ too much the ends are those of all answers.
    frequency, preload : float, Hz, N
    balance : float, m
        Highest peak of the harmonic balance, from beside which the march came, or the solution from which it started.
    fall : float, Hz
        Where the motion fell to another level; NaN where it did not.
    direction : {"down", "up", ""}
        Way of the frequency; empty where nothing had to be marched.
    periods : int
        TimeResponse in all.
    diameters : tuple of int
        Nodal diameters that took part.
    status : str
        "complete", "interrupted", or "incomplete: " and "not found: " with the reason.
    cost : Cost
    blade : int
        The highest one; that of the peak for a mistuned wheel.
    blades : (n_periods, n_blades) float, m
        Amplitudes of all blades in the last periods.
    waves : (n_blades, 2) float
        Nodal diameters and amplitudes (m) of the travelling waves that make up the motion, the largest first.  One that
        travels against the excitation has a negative nodal diameter.
    answers : dict of str to float, m
        Means of the highest blade with 2n and 4n steps, from the other side and from other starts.
    energy : tuple of four float, J
        In a period, all blades: work of the excitation, loss in damping, loss in contacts, and rise of kinetic and strain
        energy.
    growth : float
        Rate per period at which what does not belong to the wave of the excitation grows; negative if it decays, NaN where
        it is too small to tell.
    harmonics : (n_periods, n_harmonics + 1) complex, m
        Response amplitudes of the highest blade in all periods of one motion; the first column is the mean.
    repeats_after : int or None
        Periods after which one motion repeats: 1 if it is periodic, None if it is irregular.
    verdict : str
        "agrees", "does not agree" or "undecided": whether a motion stays at the solution it began with, if that was asked.
    reason : str
        Of the verdict.
    distance : float
        Of the vibration in the last period from that solution, relative to its size.
    settings : mapping
    model_hash : str
    """

    mean: Metre
    lowest: Metre
    highest: Metre
    frequency: Cycles
    preload: Newton
    balance: Metre
    fall: Cycles = float("nan")
    direction: str = ""
    periods: int = 0
    diameters: tuple[int, ...] = ()
    status: str = COMPLETE
    cost: Cost = field(default_factory=Cost)
    blade: int = -1
    blades: NDArray = field(default_factory=lambda: np.zeros((0, 0)), compare=False)
    waves: NDArray = field(default_factory=lambda: np.zeros((0, 2)), compare=False)
    answers: Annotated[dict[str, float], Quantity("m")] = field(default_factory=dict)
    energy: tuple[float, ...] = ()
    growth: float = field(default=float("nan"), compare=False)
    harmonics: Annotated[NDArray, Quantity("m", dims=(ROW, "harmonic"))] = field(
        default_factory=lambda: np.zeros((0, 2), complex), compare=False
    )
    repeats_after: int | None = None
    verdict: str = ""
    reason: str = ""
    distance: float = field(default=float("nan"), compare=False)
    _summary_fields = (
        "mean", "lowest", "highest", "balance", "frequency", "fall", "preload", "direction", "diameters", "answers",
        "growth", "verdict", "distance", "status",
    )  # fmt: skip

    @property
    def period(self) -> Numbers:
        """(n_periods,) int."""
        return np.arange(len(self.harmonics))

    @property
    def amplitude(self) -> Amplitude:
        """(n_periods,) amplitude of the harmonic of the excitation on the highest blade of one motion, m."""
        return np.abs(self.harmonics[:, 1])

    def columns(self) -> dict[str, Column]:
        """Those of the periods of one motion."""
        found = super().columns()
        return {name: found[name] for name in ("period", "amplitude", "harmonics")}

    @property
    def spread(self) -> tuple[float, float]:
        """Mean amplitudes of the lowest and of the highest blade, m; NaN where there is no march."""
        mean = self.blades.mean(axis=0) if self.blades.size else np.full(1, np.nan)
        return float(mean.min()), float(mean.max())

    @property
    def parted(self) -> bool:
        """Whether equal blades vibrate differently, the same ones high in both halves of the periods."""
        low, high = self.spread
        if not (len(self.waves) > 1 < len(self.blades) and high > (1.0 + ALIKE) * low):
            return False
        halves = [half.mean(axis=0) for half in np.array_split(self.blades, 2)]
        # correlation of the means of all blades over two halves of the periods from which on the same ones are high
        same = 0.8
        return bool(np.corrcoef(*halves)[0, 1] > same)

    @property
    def numerical_loss(self) -> float:
        """Error of the energy balance of a period, relative to the work of the excitation; NaN without time integration."""
        return (self.energy[0] - sum(self.energy[1:])) / self.energy[0] if self.energy else float("nan")

    @property
    def elsewhere(self) -> int:
        """How many of the other starts came to another motion."""
        own = next((a for name, a in self.answers.items() if name.endswith("steps")), self.mean)
        return sum(abs(a / own - 1.0) > ALIKE for name, a in self.answers.items() if name.startswith("start"))

    @property
    def factor(self) -> float:
        """Highest period over the amplitude of the balance, by which stress of the balance is scaled."""
        return self.highest / self.balance

    @property
    def text(self) -> str:
        """Mean and range: "55 µm (53 to 58)", the range alone where answers differ; the status where there is none."""
        if self.mean != self.mean:
            return self.status
        if "not settled" in self.status:
            return span(min(self.answers.values()), max(self.answers.values()), "m")
        return f"{amount(self.mean, 'm')} ({span(self.lowest, self.highest, 'm', near=self.mean).rpartition(' ')[0]})"

    def mark(self, ax: object) -> object:
        """Draw mean and range as one point with a bar over response curves (:func:`bdamper.plot.mark_time_response`)."""
        return draw(self, "mark", ax)

    def _headline(self) -> str:
        at = f"At {amount(self.preload, 'N')}"
        if self.mean != self.mean:
            why = self.status.partition(": ")[2] or self.status
            return f"{at} the amplitude in time is not known, so nothing confirms the peak of the harmonic balance: {why}."
        if len(self.harmonics):
            return f"{at} {self._motion()}"
        peak = f"the peak of the harmonic balance is {amount(self.balance, 'm')}"
        doubt = f" ({self.status})" if self.status != COMPLETE else ""
        head = f"{at} in time the highest blade has {self.text} at {amount(self.frequency, 'Hz', 6)}; {peak}{doubt}."
        if self.parted:
            head = f"{head} Blades do not vibrate alike: {span(*self.spread, 'm')}."
        if starts := sum(name.startswith("start") for name in self.answers):
            head = f"{head} {self.elsewhere} of {starts} other starts came to another motion."
        jump = f" The motion jumps to a lower amplitude at {amount(self.fall, 'Hz', 6)}."
        return head if self.fall != self.fall else head + jump

    def _motion(self) -> str:
        """What one motion comes to, and whether it stays at a solution."""
        kind = {None: "irregular", 1: "periodic"}.get(self.repeats_after, f"{self.repeats_after}-periodic")
        comes = f"the highest blade comes to {self.text} in time at {amount(self.frequency, 'Hz', 6)}, {kind}"
        alike = f" Blades do not vibrate alike: {span(*self.spread, 'm')}." if self.parted else ""
        if not self.verdict:
            return f"{comes}; {self.status}.{alike}"
        return f"time {self.verdict} with the solution of {amount(self.balance, 'm')}: {comes} ({self.reason}).{alike}"

    def _facts(self) -> tuple[Fact, ...]:
        """Facts of the time integration, with the energy of a period and the waves."""
        unequal = self.blades.size and not self.waves.size
        out = [Fact("blade", self.blade)] * bool(unequal) + list(super()._facts())
        if self.energy:
            work = self.energy[0]
            shares = [f"{name} {percent(x / work)}" for name, x in zip(("damping", "contacts"), self.energy[1:])]
            loss = f"numerical {percent(self.numerical_loss)}, rise {percent(self.energy[3] / work)}"
            out.append(Fact("energy of a period", f"{amount(work, 'J')}: {', '.join(shares)}, {loss}"))
        if len(self.waves) > 1:
            out.append(Fact("lowest to highest blade", span(*self.spread, "m")))
            told = [(d, a) for d, a in self.waves if a > ALIKE * self.waves[0, 1]]
            ways = [f"{abs(d):.0f} {'backward' if d < 0 else 'forward'} {amount(float(a), 'm')}" for d, a in told]
            out.append(Fact("waves, nodal diameters", ", ".join(ways)))
        return tuple(out)


# ---- What more harmonics change of one peak ----


@dataclass(frozen=True)
class HarmonicPeak:
    """The peak with one number of harmonics.

    Parameters
    ----------
    harmonics : int
        The highest harmonic.
    amplitude, frequency : float, m, Hz
    seconds : float
        Of the processor.
    """

    harmonics: int
    amplitude: Metre
    frequency: Cycles
    seconds: Second = 0.0


class Meeting(NamedTuple):
    """A harmonic near a mode of the structure with stuck contacts.

    Parameters
    ----------
    harmonic, mode : int
        The mode is counted from 1 at the nodal diameter of the harmonic.
    nodal_diameter : int
        -1 in a structure that is no bladed disk.
    frequency : float, Hz
        Of the mode.
    distance : float
        Frequency of the harmonic relative to that of the mode, minus one.
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


@short_repr
@dataclass(frozen=True)
class Convergence(Plottable, Tabular):
    """One peak with more and more harmonics.

    ``plot`` draws the amplitude over the number of harmonics (:func:`bdamper.plot.plot_convergence`).

    Parameters
    ----------
    preload : float, N
    tolerance : float
        Relative, on the amplitude.
    peaks : tuple of HarmonicPeak
        The answer first, then those with more harmonics.
    internal_resonances : tuple of Meeting
        Of all harmonics up to the highest that could be asked for.
    limit : str
        What ends the numbers of harmonics before the highest that was asked for; empty where nothing does.
    status : str
        "complete", "interrupted", or "incomplete: " with why no peak was found with more harmonics.
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
        """A row for each number of harmonics."""
        return columns_of_rows(self.peaks)

    @property
    def settled(self) -> tuple[HarmonicPeak, ...]:
        """The last peaks, as many as agree to the tolerance with each other."""
        found = self.peaks[-1:]
        for peak in self.peaks[-2::-1]:
            amplitude = [p.amplitude for p in (peak, *found)]
            if max(amplitude) - min(amplitude) > self.tolerance * found[-1].amplitude:
                break
            found = (peak, *found)
        return found

    @property
    def range(self) -> tuple[float, float]:
        """Least and largest amplitude (m) of the settled peaks, of all where fewer than two agree."""
        amplitude = [p.amplitude for p in (self.settled if len(self.settled) > 1 else self.peaks)]
        return min(amplitude), max(amplitude)

    @property
    def converged(self) -> bool:
        """Whether the answer agrees with all peaks with more harmonics, at least two, up to the end."""
        return self.status == COMPLETE and len(self.peaks) > 2 and len(self.settled) == len(self.peaks)

    @property
    def verdict(self) -> str:
        """Result of the convergence study in words."""
        own, *more = self.peaks
        others = [p for p in self.settled if p is not own] if len(self.settled) > 1 else more
        if not others:
            return "not known with more harmonics"
        low, high = min(p.amplitude for p in others), max(p.amplitude for p in others)
        heights = amount(high, "m") if amount(low, "m") == amount(high, "m") else span(low, high, "m")
        first, last = others[0].harmonics, others[-1].harmonics
        found = f"{heights} with {first if first == last else f'{first} to {last}'}"
        if self.converged:
            return f"{found}: converged to {percent(self.tolerance)}"
        if len(self.settled) == len(self.peaks):
            return f"{found}: agrees so far"
        return f"{found}: not converged with {own.harmonics}"

    @property
    def note(self) -> str:
        """Answer, verdict, and what ended the harmonics."""
        own = self.peaks[0]
        text = f"{amount(own.amplitude, 'm')} with {own.harmonics} harmonic{'s' * (own.harmonics != 1)}, {self.verdict}"
        text += f"; {self.highest_harmonic}" if self.highest_harmonic else ""
        text += f"; {self.status}" if self.status != COMPLETE else ""
        return text

    def _headline(self) -> str:
        return f"{self.note}."


# ---- What error estimates look like ----


@dataclass(frozen=True)
class SourceError:
    """Estimated error of a peak from one source.

    Parameters
    ----------
    source : {"harmonics", "evaluation", "contact points", "modes", "residual flexibility", "solver"}
    amplitude, frequency : float
        Relative change of the peak that a richer setting would make; NaN where none could be estimated.
    uncertainty : float
        Relative change that the estimate may have missed; 0 where the peak was computed with the richer setting.
    against : str
        The richer setting and how the change was found, or why there is no estimate.
    """

    source: str
    amplitude: float
    frequency: float
    uncertainty: float
    against: str

    @property
    def known(self) -> bool:
        """Whether there is an estimate that misses less than it finds."""
        found = np.isfinite(self.amplitude) and np.isfinite(self.frequency)
        return bool(found and (self.uncertainty == 0.0 or self.uncertainty < max(abs(self.amplitude), abs(self.frequency))))

    @property
    def size(self) -> float:
        """The larger of both relative changes; NaN where they are not known."""
        return float(np.fmax(abs(self.amplitude), abs(self.frequency))) if self.known else float("nan")

    def __str__(self) -> str:
        change = f"amplitude {percent(self.amplitude, True)}, frequency {percent(self.frequency, True)}"
        miss = f", may miss {percent(self.uncertainty)}" if self.uncertainty > 0.05 * self.size else ""
        return f"{self.source}: {f'{change}{miss} ({self.against})' if self.known else f'not estimated: {self.against}'}"


@short_repr
@dataclass(frozen=True)
class ErrorEstimates(Summarised):
    """Estimated errors of a peak, by source.

    Parameters
    ----------
    preload : float, N
    frequency, amplitude : float, Hz, m
        Of the peak.
    sources : tuple of SourceError
        Changes towards richer settings, one setting at a time.
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
        """Sum of the sizes of all known errors: a bound if they do not help each other."""
        return float(np.nansum([s.size for s in self.sources]))

    @property
    def unknown(self) -> tuple[str, ...]:
        """Sources without an estimate."""
        return tuple(s.source for s in self.sources if not s.known)

    @property
    def line(self) -> str:
        """All of it in one line, in per cent; sources of less than a hundredth of the sum are not named."""
        known = sorted((s for s in self.sources if s.known), key=lambda s: -s.size)
        if not known:
            return "error not estimated"
        named = ", ".join(f"{s.source} {percent(s.size)[:-2]}" for s in known if s.size > 0.01 * self.total)
        text = f"{percent(self.total)} ({named})" if self.total > 1e-5 else "below 0.001 %"
        return f"estimated error {text}" + (f", not estimated: {', '.join(self.unknown)}" if self.unknown else "")

    def _headline(self) -> str:
        peak = f"{peak_text(self.amplitude, self.frequency)}, preload {amount(self.preload, 'N')}"
        return f"{self.line[0].upper()}{self.line[1:]} of the peak of {peak}."
