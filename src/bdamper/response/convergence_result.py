"""What more harmonics change of one peak: amplitude and frequency with each number, and modes they meet."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

from bdamper.util.cost import Cost
from bdamper.util.display import Plottable
from bdamper.util.formatting import amount, percent, span
from bdamper.util.short_repr import brief
from bdamper.util.status import COMPLETE
from bdamper.util.tables import Column, Cycles, Metre, Second, Tabular, from_rows


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


@brief
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
        return from_rows(self.peaks)

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
