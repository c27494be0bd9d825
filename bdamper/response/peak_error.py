"""Error of a peak: how much it changes with more harmonics, or in another richer study."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bdamper.util.formatting import amount, counted, listed, percent
from bdamper.util.statement import Row
from bdamper.util.tables import Cycles, Metre, Second

HARMONICS = "harmonics"
VECTORS = "residual modes"
"""Source of error: contact forces that the residual modes do not describe."""
ROW_NAMES = {HARMONICS: "Harmonics", VECTORS: "Residual modes"}
"""Names of the sources in printed rows."""
ADDED = {HARMONICS: "two more harmonics", VECTORS: "more residual modes"}
"""What shows the error from a source in a peak or curve."""


@dataclass(frozen=True)
class HarmonicPeak:
    """Peak computed with a given number of harmonics.

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


@dataclass(frozen=True)
class SourceError:
    """Estimated error of a peak from one source.

    Parameters
    ----------
    source : str
        Name of the source, for example "harmonics", "contact points", "modes" or "time".
    amplitude, frequency : float
        Relative change of the peak with a more accurate setting; NaN without an estimate.
    uncertainty : float
        Relative change that the estimate may have missed; 0 if the peak was recomputed with the
        more accurate setting.
    against : str
        The more accurate setting and the method, or the reason why there is no estimate.
    seconds : float
        Processor time of the estimate; 0 if it was not measured.
    """

    source: str
    amplitude: float
    frequency: float
    uncertainty: float
    against: str
    seconds: Second = 0.0

    @property
    def known(self) -> bool:
        """Whether there is an estimate that is larger than its uncertainty."""
        change = np.abs([self.amplitude, self.frequency])
        if not np.isfinite(change).all():
            return False
        return bool(self.uncertainty == 0.0 or self.uncertainty < change.max())

    @property
    def size(self) -> float:
        """Larger of the two relative changes; NaN if unknown."""
        if not self.known:
            return float("nan")
        return float(np.fmax(abs(self.amplitude), abs(self.frequency)))

    def __str__(self) -> str:
        if not self.known:
            return f"{self.source}: not estimated: {self.against}"
        amplitude = f"amplitude {percent(self.amplitude, sign=True)}"
        frequency = f"frequency {percent(self.frequency, sign=True)}"
        change = f"{amplitude}, {frequency}"
        # an uncertainty far below the error is not worth its digits
        if self.uncertainty > 0.05 * self.size:
            change += f", may miss {percent(self.uncertainty)}"
        return f"{self.source}: {change} ({self.against})"


def amplitude_error(errors: Sequence[SourceError]) -> float:
    """Return the relative error of the amplitude, the sum of the sizes over all sources.

    NaN if a source is unknown, or if there is none.  Changes of opposite signs do not cancel,
    because further harmonics and residual modes may change one alone.
    """
    if not errors:
        return float("nan")
    return float(sum(abs(item.amplitude) if item.known else np.nan for item in errors))


def changes_by_source(errors: Sequence[SourceError]) -> dict[str, float]:
    """Return the relative changes of an amplitude by harmonics and by residual modes, and the error
    by both, as results of a sweep; NaN if unknown.
    """
    changes = {item.source: item.amplitude if item.known else np.nan for item in errors}
    return {
        "harmonic_change": float(changes.get(HARMONICS, np.nan)),
        "vector_change": float(changes.get(VECTORS, np.nan)),
        "error": amplitude_error(errors),
    }


NEGLIGIBLE = 1e-3
"""Relative error whose digits are not printed."""
LARGE_SHARE = 1.0 / 3.0
"""Share of the error from which its source is named."""


def error_text(errors: Sequence[SourceError]) -> str:
    """Return the error of an amplitude with the more accurate settings that show it, such as "error
    about 11 %, compared with two more harmonics"; "" without estimates.
    """
    if not errors:
        return ""
    known = [item for item in errors if item.known]
    unknown = [item.source for item in errors if not item.known]
    total = amplitude_error(known)
    texts = []
    if known and total < NEGLIGIBLE:
        texts.append(f"error below {percent(NEGLIGIBLE)}")
    elif known:
        large = [item.source for item in known if abs(item.amplitude) > LARGE_SHARE * total]
        shown_by = [ADDED.get(source, source) for source in large]
        texts.append(f"error about {percent(total)}, compared with {listed(shown_by)}")
    if unknown:
        texts.append(f"error from {listed(unknown)} unknown")
    return ", ".join(texts)


def error_rows(
    errors: Sequence[SourceError], amplitude: float, harmonic_peaks: Sequence[HarmonicPeak] = ()
) -> list[Row]:
    """Return a row for each source of error of an amplitude (m).

    ``harmonic_peaks`` has the peaks with still more harmonics after a large change.
    """
    rows = []
    for item in errors:
        name = ROW_NAMES.get(item.source, item.source)
        if not item.known:
            rows.append(Row(name, "unknown", item.against))
            continue
        is_reading = item.uncertainty > 0.0
        about = "about " if is_reading else ""
        value = f"{about}{percent(item.amplitude, sign=True)}"
        remark = f"with {item.against}"
        # residual modes change a peak with more harmonics
        if item.source == HARMONICS:
            changed = amount((1.0 + item.amplitude) * amplitude, "m")
            remark = f"{changed} {remark}"
        seconds = f", {amount(item.seconds, 's', 2)}" if item.seconds else ""
        rows.append(Row(name, value, f"{remark}{seconds}"))
        if item.source == HARMONICS and len(harmonic_peaks) > 1:
            rows.append(Row("", "", further_text(harmonic_peaks[1:])))
    return rows


def further_text(peaks: Sequence[HarmonicPeak]) -> str:
    """Return the peaks with still more harmonics in words."""
    texts = [
        f"{amount(peak.amplitude, 'm')} with {counted(peak.harmonics, 'harmonic')}"
        for peak in peaks
    ]
    return listed(texts)
