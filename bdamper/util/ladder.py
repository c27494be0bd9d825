"""What more harmonics change of an answer: its ladder, one rung for each number of harmonics."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bdamper.util.estimates import ErrorEstimates, SourceError
from bdamper.util.plotting import Plottable
from bdamper.util.repr import brief
from bdamper.util.status import COMPLETE, Status
from bdamper.util.tables import Column, Cycles, Metre, Newton, Second, Tabular, from_rows
from bdamper.util.text import aligned, amount, percent

COMPARED = 3
"""Rungs, the last that are known, that have to agree."""


@dataclass(frozen=True)
class Rung:
    """Amplitude and frequency of the highest point with one number of harmonics.

    Parameters
    ----------
    harmonics : int
    preload : float, N
    amplitude, frequency : float, m, Hz
        NaN where they are not known.
    change : float
        Relative, of the amplitude from the last rung with fewer harmonics that is known at this preload; NaN without one.
    seconds : float
        Processor time of the thread that has computed the rung; 0 where another rung's time holds it.
    status : str
        "complete", or why amplitude and frequency are not known.
    """

    harmonics: int
    preload: Newton
    amplitude: Metre = float("nan")
    frequency: Cycles = float("nan")
    change: float = float("nan")
    seconds: Second = 0.0
    status: Status = COMPLETE

    @property
    def known(self) -> bool:
        """Whether there is a whole answer."""
        return bool(np.isfinite(self.amplitude))


def _spread(values: list[float]) -> float:
    """Range of values relative to the last one, with the sign of the change from the first to the last."""
    return float(np.copysign((max(values) - min(values)) / values[-1], values[-1] - values[0]))


@brief
@dataclass(frozen=True)
class Ladder(Plottable, Tabular):
    """Whole answers with more and more harmonics, beside the answer that they check.

    Agreement is no proof of convergence, since harmonics come into resonance one by one; the ladder shows what those that
    were computed say.  ``plot`` draws amplitudes, their range and what they cost over the number of harmonics
    (:func:`bdamper.plot.plot_ladder`).

    Parameters
    ----------
    tolerance : float
        Relative.
    preload : float, N
        Of the answer.
    answer : int
        Harmonics of the answer.
    rungs : tuple of Rung
        At that preload, with rising harmonics.
    others : tuple of Rung
        At other preloads: pairs of the answer's harmonics and two more.
    by_frequency : bool
        Whether frequencies have to agree, too.
    limit : str
        What forbids still more harmonics; empty where nothing does.
    """

    tolerance: float
    preload: float
    answer: int
    rungs: tuple[Rung, ...]
    others: tuple[Rung, ...] = ()
    by_frequency: bool = False
    limit: str = ""

    def columns(self) -> dict[str, Column]:
        """A row for each rung."""
        return from_rows((*self.rungs, *self.others))

    @property
    def compared(self) -> tuple[Rung, ...]:
        """The last three rungs that are known, and the answer."""
        known = [r for r in self.rungs if r.known]
        return tuple(r for i, r in enumerate(known) if i >= len(known) - COMPARED or r.harmonics == self.answer)

    @property
    def range(self) -> tuple[float, float]:
        """Least and largest amplitude (m) of the rungs that are compared."""
        amplitude = [r.amplitude for r in self.compared] or [float("nan")]
        return min(amplitude), max(amplitude)

    @property
    def error(self) -> float:
        """Largest relative difference of the rungs that are compared; NaN with fewer than two."""
        rungs = self.compared
        if len(rungs) < 2:
            return float("nan")
        amplitude, frequency = abs(_spread([r.amplitude for r in rungs])), abs(_spread([r.frequency for r in rungs]))
        return max(amplitude, frequency) if self.by_frequency else amplitude

    def estimates(self, missing: Sequence[str]) -> ErrorEstimates:
        """The error by harmonics as one of the estimates by source, beside those that were not asked.

        Changes are as large as the range of the rungs that are compared, with the sign of the change from the first to the
        last of them; fewer than three give no estimate.
        """
        own = next((r for r in self.rungs if self._is_answer(r)), Rung(self.answer, self.preload))
        rungs = self.compared
        amplitude = frequency = np.nan
        if len(rungs) >= COMPARED:
            amplitude, frequency = _spread([r.amplitude for r in rungs]), _spread([r.frequency for r in rungs])
        found = SourceError("harmonics", amplitude, frequency, 0.0, self.note, self.seconds)
        others = (SourceError(name, np.nan, np.nan, 0.0, "not asked") for name in missing)
        return ErrorEstimates(self.preload, own.frequency, own.amplitude, (found, *others), self.seconds)

    @property
    def converged(self) -> bool:
        """Whether at least three rungs, the answer among them, agree to the tolerance."""
        rungs = self.compared
        return len(rungs) >= COMPARED and self.error <= self.tolerance and any(r.harmonics == self.answer for r in rungs)

    @property
    def seconds(self) -> float:
        """Processor time of all rungs but the answer."""
        return sum(r.seconds for r in (*self.rungs, *self.others) if not self._is_answer(r))

    def _is_answer(self, rung: Rung) -> bool:
        return (rung.harmonics, rung.preload) == (self.answer, self.preload)

    @property
    def ranges(self) -> tuple[tuple[float, float, float], ...]:
        """Preload (N), least and largest amplitude (m) at every preload at which more than one rung is known."""
        found = [(self.preload, *self.range)] if len(self.compared) > 1 else []
        for preload in dict.fromkeys(r.preload for r in self.others):
            amplitude = [r.amplitude for r in self.others if r.preload == preload and r.known]
            if len(amplitude) > 1:
                found.append((preload, min(amplitude), max(amplitude)))
        return tuple(sorted(found))

    @property
    def preloads(self) -> tuple[float, float] | None:
        """Range (N) of the preload of the least amplitude with two more harmonics; None where that stays.

        Where another checked preload gives less, from the answer's to the checked ones on both sides of the least, 0 or
        infinity where none was checked beyond.
        """
        richer = sorted(
            (r.preload, r.amplitude) for r in (*self.rungs, *self.others) if r.harmonics == self.answer + 2 and r.known
        )
        least = min(range(len(richer)), key=lambda i: richer[i][1], default=0)
        if self.preload not in [p for p, _ in richer] or richer[least][0] == self.preload:
            return None
        below = richer[least - 1][0] if least > 0 else 0.0
        above = richer[least + 1][0] if least + 1 < len(richer) else float("inf")
        return min(self.preload, below), max(self.preload, above)

    @property
    def note(self) -> str:
        """What the rungs say, in words."""
        rungs = self.compared
        numbers = " and ".join(", ".join(str(r.harmonics) for r in rungs).rsplit(", ", 1))
        low, high = self.range
        if self.converged:
            text = f"converged to {percent(self.tolerance)}: {numbers} harmonics differ by {percent(self.error)}"
        elif len(rungs) < 2:
            text = "convergence with harmonics not known"
        else:
            what = "not converged to" if self.error > self.tolerance else "fewer than three answers to compare for"
            ends = f"{amount(low, 'm', 5)} to {amount(high, 'm', 5)}"
            text = f"{what} {percent(self.tolerance)}: {ends} with {numbers} harmonics"
            if self.by_frequency:
                at = [r.frequency for r in rungs]
                text += f", {amount(min(at), 'Hz', 6)} to {amount(max(at), 'Hz', 6)}"
        text += "".join(f"; {r.harmonics} harmonics not known ({r.status})" for r in self.rungs if not r.known)
        if self.preloads is not None:
            low, high = self.preloads
            place = f"from {amount(low, 'N')} to {amount(high, 'N')}"
            if low == 0.0 or high == np.inf:
                place = f"at {amount(high, 'N')} or below" if low == 0.0 else f"at {amount(low, 'N')} or above"
            text += f"; with {self.answer + 2} harmonics the optimum lies {place}"
        return text + (f"; {self.limit}" if self.limit and not self.converged else "")

    def bottom_line(self) -> str:
        return f"{self.note[0].upper()}{self.note[1:]}."

    def details(self) -> str:
        own = sum(r.seconds for r in self.rungs if self._is_answer(r))
        times = f"processor time: answer {own:.3g} s, others {self.seconds:.3g} s"
        rows = [("harmonics", "preload", "amplitude", "frequency", "change", "time", "")]
        for r in (*self.rungs, *self.others):
            found = (amount(r.amplitude, "m", 4), amount(r.frequency, "Hz", 5)) if r.known else ("not known", "")
            change = percent(r.change, True) if np.isfinite(r.change) else ""
            time = f"{r.seconds:.2f} s" if r.seconds else ""
            of = "answer" if self._is_answer(r) else ""
            rows.append((str(r.harmonics), amount(r.preload, "N", 5), *found, change, time, of))
        return "\n".join([self.note, times, *aligned(rows)])
