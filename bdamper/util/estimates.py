"""What error estimates look like: one number for each source of error, and what it was measured against."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from bdamper.util.repr import brief


@dataclass(frozen=True)
class SourceError:
    """Estimated error of a peak from one source.

    Parameters
    ----------
    source : {"harmonics", "evaluation", "contact points", "modes", "solver"}
    amplitude, frequency : float
        Relative change of the peak that a richer setting would make; NaN where none could be estimated.
    uncertainty : float
        Relative change that the estimate may have missed.
    against : str
        The richer setting, and how the change was found.
    seconds : float
    """

    source: str
    amplitude: float
    frequency: float
    uncertainty: float
    against: str
    seconds: float = field(default=0.0, compare=False)

    @property
    def known(self) -> bool:
        """Whether there is an estimate."""
        return bool(np.isfinite(self.amplitude) and np.isfinite(self.frequency))

    @property
    def size(self) -> float:
        """The larger of both relative changes; NaN where they are not known."""
        return float(np.fmax(abs(self.amplitude), abs(self.frequency))) if self.known else float("nan")


@brief
@dataclass(frozen=True)
class ErrorEstimates:
    """Estimated errors of a peak, by source.

    Parameters
    ----------
    preload : float, N
    frequency, amplitude : float, Hz, m
        Of the peak.
    sources : tuple of SourceError
        Changes towards richer settings, one setting at a time.
    seconds : float
        For all estimates.
    """

    preload: float
    frequency: float
    amplitude: float
    sources: tuple[SourceError, ...]
    seconds: float = field(default=0.0, compare=False)

    def __getitem__(self, source: str) -> SourceError:
        for item in self.sources:
            if item.source == source:
                return item
        raise KeyError(f"no estimate for '{source}'; there are {[s.source for s in self.sources]}")

    @property
    def total(self) -> float:
        """Sum of the sizes of all known errors: a bound if they do not help each other."""
        return float(np.nansum([s.size for s in self.sources]))

    @property
    def amplitude_error(self) -> float:
        """Relative change of the amplitude if all settings were richer, signs kept."""
        return float(np.nansum([s.amplitude for s in self.sources]))

    @property
    def largest(self) -> SourceError:
        """The source that matters most."""
        return max(self.sources, key=lambda s: -1.0 if np.isnan(s.size) else s.size)

    @property
    def unknown(self) -> tuple[str, ...]:
        """Sources without an estimate."""
        return tuple(s.source for s in self.sources if not s.known)

    def __str__(self) -> str:
        all_known = f"about {percent(self.total)} in all, most from {self.largest.source}"
        some_known = f"at least {percent(self.total)}, those of {', '.join(self.unknown)} are not known"
        lines = [
            f"errors of the peak {self.amplitude:.6g} m at {self.frequency:.6g} Hz, preload {self.preload:g} N: "
            + (some_known if self.unknown else all_known)
        ]
        for s in self.sources:
            change = (
                f"amplitude {percent(s.amplitude, True)}, frequency {percent(s.frequency, True)}"
                + (f", may miss {percent(s.uncertainty)}" if s.uncertainty > 0.25 * s.size else "")
                if s.known
                else "not known"
            )
            lines.append(f"  {s.source}: {change} ({s.against})")
        return "\n".join(lines)


def percent(value: float, sign: bool = False) -> str:
    """A relative number with two digits; from 100 % on in whole percent."""
    if not np.isfinite(value):
        return "unknown"
    return f"{100.0 * value:{'+' if sign else ''}{'.0f' if 0.995 <= abs(value) < 1e4 else '.2g'}} %"
