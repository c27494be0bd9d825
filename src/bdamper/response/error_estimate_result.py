"""What error estimates look like: one number for each source of error, and what it was measured against."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bdamper.util import validation
from bdamper.util.display import Summarised
from bdamper.util.formatting import amount, height, percent
from bdamper.util.short_repr import brief


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


@brief
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
        peak = f"{height(self.amplitude, self.frequency)}, preload {amount(self.preload, 'N')}"
        return f"{self.line[0].upper()}{self.line[1:]} of the peak of {peak}."
