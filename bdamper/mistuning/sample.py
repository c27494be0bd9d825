"""Samples of mistuned bladed disks: the largest blade amplitude of each disk, in a file from which
a run can be resumed, with an audit of the search.

The deviations and the dampers of disk ``k`` are drawn with the seed ``(seed, k)``.  One unit
pattern is scaled to every standard deviation.  A disk is therefore the same at every preload and
standard deviation, and in a study with more harmonics.  More disks can be added to a sample in the
same results file.

**Audit.** A coarse sweep with local searches (:mod:`bdamper.mistuning.peak_search`) can miss the
highest peak.  Therefore a random fraction of the disks, drawn before any result is known, is
searched again with half the spacing and three times the number of local searches.  After the
sample, the same fraction of the disks with the largest amplitudes of each cell is also searched
again, because results are quoted from the tail.  Both searches release their dampers, and the
released peaks are compared.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import AbstractContextManager, closing, nullcontext
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from bdamper.analyses.executors import Records, check_executor, run_stored
from bdamper.harmonic_balance.parameters import study_fingerprint
from bdamper.harmonic_balance.problem import Problem
from bdamper.harmonic_balance.study_boundary import StudyLike, problem_of
from bdamper.mistuning.bladed_disk import OF_PEAKS, BladedDisk, answers
from bdamper.mistuning.mistuning import DamperVariation, Mistuning
from bdamper.mistuning.peak import DiskPeakOptions
from bdamper.mistuning.statistics import Interval, WeibullTail, percentile, share, weibull_tail
from bdamper.response.peak import Peak
from bdamper.util import validation
from bdamper.util.display import Fact, Plottable, Summarised, WithChecks, draw
from bdamper.util.errors import (
    COMPLETE,
    FAILED,
    NOT_RUN,
    BdamperError,
    SettingError,
    WithRowStatus,
    all_complete,
)
from bdamper.util.formatting import amount, beyond, counted, ordinal, percent, short_repr
from bdamper.util.progress import one_thread, shows_progress
from bdamper.util.records import Data, numbers_of
from bdamper.util.statement import Row, Statement
from bdamper.util.storage import INSTALLED, FilePath, Recorded, ResultsFile, Storable
from bdamper.util.tables import (
    Hertz,
    Metres,
    Newtons,
    Numbers,
    Quantity,
    Resonance,
    Seconds,
    Tabular,
)


def highest_disks(height: NDArray, audit: float) -> NDArray:
    """Return the mask (n_disks, ...) of the fraction ``audit`` of the disks with the highest
    amplitudes in each cell."""
    # rounded up, but 0.1 of 30 disks are 3 in spite of rounding
    n = int(np.ceil(audit * len(height) - 1e-9))
    has_peak = np.isfinite(height)
    # ascending in the negative heights, disks without a peak last
    negative_height = -np.nan_to_num(height, nan=-np.inf)
    order = np.argsort(negative_height, axis=0, kind="stable")
    # the inverse of the order is the rank of each disk, 0 for the highest
    rank = np.argsort(order, axis=0, kind="stable")
    return np.asarray((rank < n) & has_peak)


@short_repr
@dataclass(frozen=True)
class Audit(Summarised, Tabular, row="search"):
    """Comparison of the highest peaks of a search with a thorough search of the same disks, with
    free dampers in both.

    Parameters
    ----------
    kind : {"disks chosen at random", "disks with the largest amplitudes"}
    disk : (n,) int
    standard_deviation, preload : (n,) float
    search, thorough : (n,) float, m
        Highest amplitude of any blade in each search; NaN if unknown.
    error : (n,) float
        Error estimate of the search (:class:`~bdamper.mistuning.peak.DiskPeak`).
    tolerance : float
        A peak counts as missed if the thorough search exceeds it by more than this relative
        difference.
    status, reason : tuple of str
        "complete", or the status of a search without a peak, and its reason.
    """

    kind: str
    disk: Numbers
    standard_deviation: Numbers
    preload: Newtons
    search: Metres
    thorough: Metres
    error: Numbers
    tolerance: float
    status: Annotated[tuple[str, ...], Quantity(name="run")]
    reason: Annotated[tuple[str, ...], Quantity(name="run_reason")]

    @property
    def missed(self) -> Numbers:
        """Whether the thorough search found a higher peak, (n,) bool."""
        return np.asarray(self.thorough > (1.0 + self.tolerance) * self.search)

    @property
    def covered(self) -> NDArray:
        """Whether the higher peak is within the error estimate of the search or within the
        tolerance, (n,) bool.
        """
        return np.asarray(
            self.thorough <= (1.0 + np.maximum(self.error, self.tolerance)) * self.search
        )

    @property
    def undecided(self) -> NDArray:
        """Whether one of the searches found no peak, (n,) bool."""
        return ~self.missed & (np.array(self.status) != COMPLETE)

    @property
    def share(self) -> Interval:
        """Fraction of the disks with a missed peak, with its binomial 95 % interval.

        Only disks with a conclusive result count: disks with a missed peak, and disks for which
        both searches found all peaks.
        """
        return share(*self._disk_counts)

    @property
    def _disk_counts(self) -> tuple[int, int]:
        """Numbers of disks with a missed peak and of disks with a conclusive result."""
        missed = np.unique(self.disk[self.missed])
        undecided = np.setdiff1d(self.disk[self.undecided], missed)
        return len(missed), len(np.setdiff1d(self.disk, undecided))

    def _statement(self) -> Statement:
        missed = self.missed
        n_disks = len(np.unique(self.disk))
        low, share, high = (100.0 * part for part in self.share)
        numbers = ", ".join(map(str, np.unique(self.disk[missed])))
        n_beyond_error = int((missed & ~self.covered).sum())
        affected, decided = self._disk_counts
        rows = [
            Row("Disks", str(n_disks), f"{self.kind.removeprefix('disks ')}, {decided} conclusive"),
            Row("Thorough searches", str(len(missed)), f"{self.undecided.sum()} undecided"),
            Row("Higher peaks", str(missed.sum()), f"by more than {100.0 * self.tolerance:g} %"),
            Row(
                "Beyond their error",
                str(n_beyond_error),
                "higher by more than the estimated error of the first search",
            ),
        ]
        if numbers:
            rows.append(Row("Affected disks", "", f"{numbers} (counted from 0)"))
        part = f"{affected} of {decided} disks with a conclusive result"
        interval = f"{share:.3g} %; 95 % confidence: {low:.3g} to {high:.3g} %"
        verdict = f"A thorough search finds higher peaks in {part} ({interval})"
        remarks = [MISSED_REMEDY] if missed.any() else []
        return Statement([verdict], rows, remarks=remarks)


MISSED_REMEDY = "Remedy: sample again with a finer search, DiskPeakOptions(spacing=, climbs=)"
"""Remark if thorough searches find higher peaks."""


@short_repr
@dataclass(frozen=True)
class BestPreload(Summarised):
    """Preload of a sample at which a percentile of the largest blade amplitude is smallest.

    Parameters
    ----------
    percentile : float
    standard_deviation : float
    preload : float, N
    amplitude : Interval, m
        The percentile at this preload, with its 95 % interval, which includes the errors of the
        amplitudes.
    low, high : float, N
        Range of the best preload in 95 % of the bootstrap samples, which resample disks, for
        amplitudes within their errors.
    kind : {"interior", "end"}
        Whether the preload is inside the range of the sample or at one of its ends.
    tuned_preload, tuned_amplitude : float, N and m
        The best of the same preloads for the tuned disk.
    disks : int
        Number of disks with a peak at every preload; only these are used.
    end : {"", "lower", "upper"}
        End of the range at which the preload lies.
    """

    percentile: float
    standard_deviation: float
    preload: float
    amplitude: Interval
    low: float
    high: float
    kind: str
    tuned_preload: float
    tuned_amplitude: float
    disks: int
    end: str = ""

    def _statement(self) -> Statement:
        preload = amount(self.preload, "N")
        if self.low < self.high:
            preload = Interval(self.low, self.preload, self.high).to_text("N")
        rows = [
            Row(
                "Amplitude",
                amount(self.amplitude.value, "m", 4),
                f"{ordinal(self.percentile)} percentile of the disks; 95 % confidence: "
                f"{self.amplitude.ends_text('m')}",
            ),
            Row(
                "Tuned disk",
                amount(self.tuned_amplitude, "m"),
                f"lowest of the same preloads, at {amount(self.tuned_preload, 'N')}",
            ),
        ]
        deviation = f"{100.0 * self.standard_deviation:g} % standard deviation of the frequencies"
        disks = f"{counted(self.disks, 'bladed disk')} with a peak at every preload"
        subject = f"{disks}, {deviation}"
        criterion = f"for the {ordinal(self.percentile)} percentile"
        if self.kind == "interior":
            return Statement([f"Best preload {criterion} {preload}: {subject}"], rows)
        best = amount(self.preload, "N")
        verdict = (
            f"Not for design: the best preload {criterion}, {best}, is at the {self.end} end of the "
            f"range: {subject}"
        )
        remarks = [f"Remedy: include preloads {beyond(self.end)} {best} in the sample"]
        return Statement([verdict], rows, remarks=remarks)


@short_repr
@dataclass(frozen=True)
class MistunedSample(
    WithRowStatus,
    WithChecks,
    Plottable,
    Tabular,
    Recorded,
    Storable,
    kind="bdamper-wheel-sample",
    row="disk",
):
    """Largest blade amplitudes of many mistuned bladed disks.

    Arrays of shape (n_disks, n_deviations, n_preloads) are NaN without a result.  ``plot`` draws
    percentiles against the standard deviation or the preload (:func:`bdamper.plot.plot_sample`),
    ``plot_tail`` the distribution with its tail.

    Parameters
    ----------
    n_blades : int
    disks : (n_disks,) int
        Numbers of the disks, which determine their random draws.
    standard_deviation : (n_deviations,) float
    preload : (n_preloads,) float, N
    amplitude, frequency, blade : float, m and Hz
        Amplitude and frequency of the blade with the largest amplitude, and its number.
    residual, springs, error, lower_error : float
        Residual, support springs of the dampers, and estimates of how much higher and how much
        lower the amplitude may be (:class:`~bdamper.mistuning.peak.DiskPeak`).
    tuned_amplitude : (n_preloads,) float, m
        Amplitude of the tuned disk at the same preload.
    status, reason : tuple of str
        In the order of the arrays: "complete", "failed" or "not run", and the reason for it.
    audited : (n,) int
        Disks drawn for the audit before any result.
    audit_share : float
        Probability of this draw, and fraction of the highest disks that are audited.
    curve_amplitude : float, m
        Result of the thorough search for the audited disks.
    curve_status, curve_reason : tuple of str
    processor, curve_processor : float, s
        Processor time of the peaks and of the audit.
    drawn : mapping
        Distribution, variations of the dampers and seed.
    settings : mapping
        Settings of the tuned study.
    model_hash : str
    """

    n_blades: int
    disks: NDArray
    standard_deviation: NDArray
    preload: Newtons
    amplitude: Resonance
    frequency: Hertz
    blade: Numbers
    residual: Numbers
    springs: Numbers
    error: Numbers
    tuned_amplitude: NDArray
    status: Annotated[tuple[str, ...], Quantity(name="run")]
    audited: NDArray
    audit_share: float
    curve_amplitude: Metres
    curve_status: tuple[str, ...]
    processor: Seconds
    curve_processor: NDArray
    drawn: dict[str, Any] = field(default_factory=dict)
    lower_error: Annotated[NDArray, Data(derived=True), Quantity()] = field(
        default_factory=lambda: np.zeros(0)
    )
    reason: Annotated[tuple[str, ...], Data(derived=True), Quantity(name="run_reason")] = ()
    curve_reason: Annotated[tuple[str, ...], Data(derived=True)] = ()

    def __post_init__(self) -> None:
        # in files of version 0.10 and older the error has no part by harmonics; that of a complete
        # peak with free dampers has missed peaks alone, which can only be higher
        lower_error = self.lower_error
        if lower_error is None or np.size(lower_error) == 0:
            lower_error = np.full(np.shape(self.error), np.nan)
        complete = np.reshape(self.status, np.shape(self.error)) == COMPLETE
        free = complete & (self.springs == 0.0)
        of_old_files = np.where(free, 0.0 * self.error, self.error)
        is_missing = np.isnan(lower_error) & np.isfinite(self.error)
        object.__setattr__(self, "lower_error", np.where(is_missing, of_old_files, lower_error))
        super().__post_init__()
        if not self.curve_reason:
            object.__setattr__(self, "curve_reason", ("",) * len(self.curve_status))

    def __len__(self) -> int:
        return len(self.disks)

    @property
    def complete(self) -> bool:
        """Whether the search of every disk, and the thorough search of every audited disk, is
        complete."""
        audits_complete = all(s in (COMPLETE, "not asked") for s in self.curve_status)
        return all_complete(self.status) and audits_complete

    @property
    def ok(self) -> bool:
        """Whether the result is complete."""
        return self.complete

    @property
    def amplification(self) -> Numbers:
        """Amplitude relative to the tuned disk at the same preload, (n_disks, n_deviations,
        n_preloads)."""
        return np.asarray(self.amplitude / self.tuned_amplitude)

    @property
    def held(self) -> float:
        """Fraction of the peaks that were found only with support springs on the dampers."""
        springs_of_peaks = self.springs[np.isfinite(self.springs)]
        if not len(springs_of_peaks):
            return 0.0
        return float(np.mean(springs_of_peaks > 0.0))

    def percentile(self, q: float, quantity: str = "amplification") -> NDArray:
        """Return the lower end, estimate and upper end of a percentile over the disks, (3,
        n_deviations, n_preloads).

        Intervals are distribution-free (:mod:`bdamper.mistuning.statistics`).  The upper end
        includes the ``error`` of the amplitudes, the lower end their ``lower_error``.  Ends are
        infinite if the sample is too small.
        """
        names = ("amplification", "amplitude", "frequency")
        values = getattr(self, validation.choice("quantity", quantity, names))
        error = self.error
        lower_error = self.lower_error
        if quantity == "frequency":
            # the error estimates belong to the amplitudes; unknown ones remain NaN
            error = 0.0 * self.error
            lower_error = 0.0 * self.lower_error
        _, n_deviations, n_preloads = values.shape
        intervals = np.zeros((3, n_deviations, n_preloads))
        for i, j in np.ndindex(n_deviations, n_preloads):
            intervals[:, i, j] = percentile(
                values[:, i, j], q, error[:, i, j], lower_error[:, i, j]
            )
        return intervals

    def tail(
        self,
        standard_deviation: float | None = None,
        preload: float | None = None,
        tail: float = 0.5,
    ) -> WeibullTail:
        """Fit a Weibull distribution to the upper amplification factors of one cell; the last
        values by default."""
        i, j = self.cell(standard_deviation, preload)
        return weibull_tail(self.amplification[:, i, j], tail)

    def cell(self, standard_deviation: float | None, preload: float | None) -> tuple[int, int]:
        """Return the indices of a standard deviation and of a preload in the sample.

        None selects the last value.

        Raises
        ------
        SettingError
            If the sample has no such value.
        """
        i = self._index("standard_deviation", standard_deviation)
        j = self._index("preload", preload)
        return i, j

    def _index(self, name: str, value: float | None) -> int:
        """Return the index of a value in the sample; None selects the last value."""
        values = getattr(self, name)
        if value is None:
            value = values[-1]
        index = np.flatnonzero(np.isclose(values, value, rtol=1e-9, atol=0.0))
        if not len(index):
            raise SettingError(f"{name}: expected one of {values.tolist()}, found {value!r}")
        return int(index[0])

    def best_preload(self, q: float = 95.0, standard_deviation: float | None = None) -> BestPreload:
        """Find the preload of the sample at which the ``q``-th percentile of the largest blade
        amplitude is smallest.

        Raises
        ------
        BdamperError
            If no disk has a peak at every preload.
        """
        i, _ = self.cell(standard_deviation, None)
        height = self.amplitude[:, i]
        error = self.error[:, i]
        lower_error = self.lower_error[:, i]
        complete = np.isfinite(height).all(axis=1)
        n = int(complete.sum())
        if not n:
            raise BdamperError("best preload: no bladed disk has a peak at every preload")

        # the same disks at every preload
        height_of_complete = np.where(complete[:, None], height, np.nan)
        intervals = [
            percentile(height_of_complete[:, j], q, error[:, j], lower_error[:, j])
            for j in range(len(self.preload))
        ]
        best = int(np.argmin([interval.value for interval in intervals]))

        # preloads that may be the best of each bootstrap sample, for amplitudes within their errors
        n_bootstrap = 2000
        generator = np.random.default_rng(0)
        # lower and upper bounds of the amplitudes, (2, n, n_preloads)
        bounds = np.stack([height * (1.0 - lower_error), height * (1.0 + error)])[:, complete]
        lowest_best = []
        highest_best = []
        for _ in range(n_bootstrap):
            resample = bounds[:, generator.integers(n, size=n)]
            # percentiles (n_preloads,) of both bounds
            lower, upper = np.quantile(resample, q / 100.0, axis=1, method="median_unbiased")
            # a preload may be the best if its lower bound is below all upper bounds
            possible = self.preload[lower <= upper.min()]
            lowest_best.append(possible.min())
            highest_best.append(possible.max())
        low = np.quantile(lowest_best, 0.025, method="nearest")
        high = np.quantile(highest_best, 0.975, method="nearest")

        end = ""
        if self.preload[best] == self.preload.min():
            end = "lower"
        elif self.preload[best] == self.preload.max():
            end = "upper"
        tuned_best = int(np.argmin(np.nan_to_num(self.tuned_amplitude, nan=np.inf)))
        return BestPreload(
            percentile=q,
            standard_deviation=float(self.standard_deviation[i]),
            preload=float(self.preload[best]),
            amplitude=intervals[best],
            low=float(low),
            high=float(high),
            kind="end" if end else "interior",
            tuned_preload=float(self.preload[tuned_best]),
            tuned_amplitude=float(self.tuned_amplitude[tuned_best]),
            disks=n,
            end=end,
        )

    def audit(self, tail: bool = False, tolerance: float = 0.01) -> Audit:
        """Compare with the thorough search of some disks: disks chosen at random or, with ``tail``,
        the disks with the largest amplitudes of each cell.
        """
        if tail:
            kind = "disks with the largest amplitudes"
            chosen = highest_disks(self.amplitude, self.audit_share)
        else:
            kind = "disks chosen at random"
            drawn = np.isin(self.disks, self.audited)
            chosen = np.broadcast_to(drawn[:, None, None], self.amplitude.shape)

        # a failure of the first search counts before the result of the thorough search
        first_failed = np.array(self.status) == FAILED
        status = np.where(first_failed, self.status, self.curve_status)
        reason = np.where(first_failed, self.reason, self.curve_reason)
        searched = ~np.isin(status, ("not asked", NOT_RUN))

        flat = np.flatnonzero(chosen.ravel() & searched)
        i, j, k = np.unravel_index(flat, chosen.shape)
        return Audit(
            kind=kind,
            disk=self.disks[i],
            standard_deviation=self.standard_deviation[j],
            preload=self.preload[k],
            search=self.amplitude.ravel()[flat],
            thorough=self.curve_amplitude.ravel()[flat],
            error=self.error.ravel()[flat],
            tolerance=validation.number("tolerance", tolerance, above=0.0),
            status=tuple(status[flat].tolist()),
            reason=tuple(reason[flat].tolist()),
        )

    def plot_tail(self, path: FilePath | None = None, **options: Any) -> Any:
        """Draw the distribution of one cell with its tail
        (:func:`bdamper.plot.plot_sample_tail`)."""
        return draw(self, "figure", "plot_tail", path, **options)

    def _grid(self) -> dict[str, Any]:
        return {
            "disk": self.disks,
            "standard_deviation": self.standard_deviation,
            "preload": self.preload,
        }

    def _facts(self) -> tuple[Fact, ...]:
        """Return the number of disks, the factors of every cell, and the results of the audits."""
        _, middle, _ = self.percentile(50.0)
        upper = self.percentile(95.0)
        cells = []
        for i, deviation in enumerate(self.standard_deviation):
            for j, preload in enumerate(self.preload):
                name = f"factor at {100.0 * deviation:g} %, {preload:g} N"
                low_end, estimate, high_end = upper[:, i, j]
                interval = Interval(low=low_end, value=estimate, high=high_end)
                cells.append(Fact(name, f"median {middle[i, j]:.4g}, 95 % {interval}"))
        audits = []
        for audit in (self.audit(), self.audit(tail=True)):
            missed = f"{audit.missed.sum()} of {len(audit.disk)}"
            audits.append(Fact(f"missed, {audit.kind}", missed))
        of_peaks = float(np.nansum(self.processor))
        of_audit = float(np.nansum(self.curve_processor))
        return (
            Fact("disks", f"{len(self)} of {self.n_blades} blades"),
            Fact("without a peak", self.status.count(FAILED)),
            Fact("held", int((self.springs > 0.0).sum())),
            *cells,
            *audits,
            Fact("processor", f"{of_peaks:.0f} s, {of_audit:.0f} s for the audit"),
        )

    def _statement(self) -> Statement:
        # lower end, estimate and upper end in the last cell (standard deviation and preload)
        _, median, _ = self.percentile(50.0)[:, -1, -1]
        low, upper, high = self.percentile(95.0)[:, -1, -1]
        deviation = f"{100.0 * float(self.standard_deviation[-1]):.3g} %"
        n_disks = f"{len(self)} disks"
        of_several = ", the highest" if len(self.preload) > 1 else ""
        subject = f"{self.n_blades} blades, preload {amount(self.preload[-1], 'N')}{of_several}"
        if not np.isfinite(median):
            return Statement([f"Too few peaks were found at {deviation} mistuning: {subject}"])
        raised = f"raises the largest amplitude to {median:.3g} times that of the tuned disk"
        verdict = f"Mistuning of {deviation} {raised} (median of {n_disks}): {subject}"
        ends = Interval(low, upper, high).ends_text("", digits=3)
        at = f"at {amount(self.preload[-1], 'N')}"
        n_failed = self.status.count(FAILED)
        cells = counted(len(self.preload), "preload")
        if len(self.standard_deviation) > 1:
            cells = f"{counted(len(self.standard_deviation), 'standard deviation')}, {cells}"
        rows = [
            Row("95th percentile", f"{upper:.3g}", f"{at}; 95 % confidence interval: {ends}"),
            Row(
                "Peak searches",
                str(self.amplitude.size),
                f"{n_disks}, {cells}; {n_failed} found no peak",
            ),
        ]
        checks = []
        for name, audit in (
            ("Random disks searched again", self.audit()),
            ("Highest disks searched again", self.audit(tail=True)),
        ):
            n_missed = int(audit.missed.sum())
            if n_missed:
                outcome = "uncertain"
            elif len(audit.disk):
                outcome = "pass"
            else:
                outcome = "not run"
            found = (
                f"{n_missed} of {counted(len(audit.disk), 'thorough search')} found a higher peak"
            )
            checks.append(Row(name, outcome, found))
        missed = any(check.value == "uncertain" for check in checks)
        in_brackets = "In brackets: 95 % confidence interval, widened by the errors of the peaks"
        if self.held:
            held = percent(self.held)
            in_brackets += (
                f"; in {held} of the peaks weak artificial springs hold the dampers, and widen it"
            )
        remarks = [in_brackets]
        if not np.isfinite(self.percentile(95.0)).all():
            without_limit = "Without an upper limit there are too few disks"
            if n_failed:
                without_limit = (
                    "A disk without a peak may have any amplitude; with many of them there is no "
                    "upper limit"
                )
            remarks.append(without_limit)
        if missed:
            remarks.append(MISSED_REMEDY)
        return Statement([verdict], rows, checks, remarks, table=self._cell_table())

    def _cell_table(self) -> list[tuple[str, ...]]:
        """Return median and upper percentile of the amplification in each cell."""
        _, middle, _ = self.percentile(50.0)
        upper = self.percentile(95.0)
        table: list[tuple[str, ...]] = [
            ("Mistuning", "Preload", "Median", "95th percentile", "Not found")
        ]
        for i, deviation in enumerate(self.standard_deviation):
            for j, preload in enumerate(self.preload):
                low_end, estimate, high_end = upper[:, i, j]
                cells = (
                    f"{100.0 * deviation:g} %",
                    amount(preload, "N"),
                    f"{middle[i, j]:.4g}",
                    str(Interval(low=low_end, value=estimate, high=high_end)),
                    str(int(np.isnan(self.amplitude[:, i, j]).sum())),
                )
                table.append(cells)
        return table


_AUDIT = 3
"""Last number of the seed that draws the audited disks."""


@dataclass(frozen=True)
class _Sample:
    """Disks of a sample and the search for their peaks.

    Parameters
    ----------
    disk : BladedDisk
        Bladed disk without mistuning.
    mistuning : callable
        Returns the mistuning for a standard deviation and a seed.
    random : mapping
        Distribution, damper variations and seed, stored with the result.
    options : DiskPeakOptions
    over : mapping
        Numbers of the disks, standard deviations and preloads.
    """

    disk: BladedDisk
    mistuning: Callable[..., Mistuning]
    random: Mapping[str, Any]
    options: DiskPeakOptions
    over: Mapping[str, Sequence[Any]]

    @property
    def shape(self) -> tuple[int, ...]:
        return tuple(len(values) for values in self.over.values())

    def draw(self, k: int, standard_deviation: float) -> BladedDisk:
        """Return disk ``k`` with its random blades and dampers."""
        seed = (self.random["seed"], k)
        disk = self.disk.replace(mistuning=self.mistuning(standard_deviation, seed=seed))
        spread = self.random["dampers"]
        if not spread:
            return disk
        dampers = DamperVariation.random(disk.n_blades, **spread, seed=seed)
        return disk.replace(dampers=dampers)

    def audits(self, peaks: Records, share: float, drawn: NDArray) -> list[int]:
        """Return the indices of the points to search again: the disks ``drawn`` in advance and the
        highest disks.

        Nothing is returned before all peaks are known.
        """
        if NOT_RUN in peaks.status:
            return []
        height = numbers_of(peaks.values, "amplitude").reshape(self.shape)
        is_drawn = np.isin(self.over["disk"], drawn)
        chosen = highest_disks(height, share) | is_drawn[:, None, None]
        return [int(i) for i in np.flatnonzero(chosen & np.isfinite(height))]

    def __call__(self, settings: Mapping[str, Any]) -> Mapping[str, Any]:
        """Search for the highest peak of one disk at one preload.

        The settings are the disk, the standard deviation and the preload.  For the audit they also
        contain an interval (Hz), in which the search is thorough.
        """
        interval = settings.get("interval")
        options = self.options if interval is None else thorough(self.options)
        disk = self.draw(settings["disk"], settings["standard_deviation"])
        peak = disk.peak(settings["preload"], interval, options=options)
        return answers(peak) | {"interval": list(peak.interval)}

    def header(self) -> dict[str, Any]:
        """Return the header that identifies the sample in its results file; it does not depend on
        the number of disks."""
        # more disks may be added, so their numbers do not identify the sample
        over = {name: values for name, values in self.over.items() if name != "disk"}
        return {
            "format": "bdamper-wheel-sample",
            "version": 4,
            **INSTALLED.attributes(),
            "study": study_fingerprint(problem_of(self.disk.study)),
            **self.random,
            **over,
            "options": repr(self.options),
        }


def thorough(options: DiskPeakOptions) -> DiskPeakOptions:
    """Return the options of the audit: half the spacing and three times the number of local
    searches.
    """
    return replace(
        options,
        spacing=0.5 * options.spacing,
        climbs=3 * options.climbs,
        least=2 * options.least,
        most=2 * options.most,
    )


def audit_disks(disks: Sequence[int], share: float, seed: int = 0) -> NDArray:
    """Return the numbers of the audited disks, each drawn independently with a probability before
    any result is known."""
    share = validation.number("audit", share, least=0.0, most=1.0)
    draws = [np.random.default_rng([seed, k, _AUDIT]).random() for k in disks]
    return np.array([k for k, draw in zip(disks, draws) if draw < share], int)


@validation.check_arguments
@one_thread
def mistuned_sample(
    study: StudyLike | Problem,
    standard_deviation: float | Sequence[float] | NDArray,
    preload: float | Sequence[float] | NDArray,
    disks: int | Sequence[int] = 1000,
    *,
    distribution: str | Mistuning = "normal",
    dampers: Mapping[str, Any] | None = None,
    options: DiskPeakOptions | None = None,
    audit: float = 0.05,
    seed: int = 0,
    executor: Executor | None = None,
    resume: str | Path | None = None,
    progress: bool | None = None,
) -> MistunedSample:
    """Compute the largest blade amplitude of many mistuned bladed disks for each standard deviation
    and preload.

    Parameters
    ----------
    study : Study
        Study of one sector, whose model has a local basis.
    standard_deviation : float or (n_deviations,) float
        Relative standard deviation of the blade frequencies clamped at the root.
    preload : float or (n_preloads,) float, N
    disks : int or sequence of int
        Number of disks, or their numbers.  Disk ``k`` does not depend on the others.
    distribution : {"normal", "uniform"} or Mistuning
        See :meth:`bdamper.mistuning.Mistuning.random`; a measured pattern is resampled with
        repetition.
    dampers : mapping, optional
        Arguments of :meth:`bdamper.mistuning.DamperVariation.random`: relative standard deviations
        of "mass", "friction_coefficient" and "contact_stiffness", mean of "gap" (m), and numbers of
        "missing" dampers.  Identical dampers by default.
    options : DiskPeakOptions
        Options of the search for each peak.
    audit : float
        Probability that a disk is drawn for a thorough search, and fraction of the highest disks
        searched thoroughly.
    seed : int
        Equal seeds give equal disks.
    executor, resume, progress
        See :func:`bdamper.sweep`.  The results file can be resumed with more disks.

    Returns
    -------
    MistunedSample
        After Ctrl-C, or if a worker dies, it contains the finished results.

    Raises
    ------
    SettingError, ModelError
        If a setting is invalid, or the model has no local basis.
    BdamperError
        If the results file belongs to another sample, or the tuned disk has no peak at a preload.
    """
    disk = BladedDisk(study)
    deviations = np.atleast_1d(standard_deviation)
    deviations = validation.numbers("standard_deviation", deviations, least=0.0)
    preloads = validation.numbers("preload", np.atleast_1d(preload), least=0.0, unit="N")
    if np.ndim(disks) == 0:
        disks = range(validation.integer("disks", disks, least=1))
    numbers = validation.integers("disks", disks)
    seed = validation.integer("seed", seed)
    dampers = validation.instance(
        "dampers", dampers or {}, Mapping, "variations of dampers by name"
    )
    options = validation.instance("options", options or DiskPeakOptions(), DiskPeakOptions)
    check_executor(executor)
    progress = shows_progress(progress)

    # stored with the result, and part of the header of the results file
    stored_distribution = distribution
    if isinstance(distribution, Mistuning):
        stored_distribution = distribution.deviation.tolist()
    random = {"distribution": stored_distribution, "dampers": dict(dampers), "seed": seed}
    over = {
        "disk": numbers,
        "standard_deviation": deviations.tolist(),
        "preload": preloads.tolist(),
    }
    mistuning = partial(Mistuning.random, disk.n_blades, distribution=distribution)
    sample = _Sample(disk, mistuning, random, options, over)
    # refuse invalid deviations, dampers or numbers of modes before the work
    sample.draw(0, float(deviations.max()))
    audited = audit_disks(numbers, audit, seed)
    # computed once, then sent to the workers with the disk
    tuned = [disk.tuned_peak(value) for value in over["preload"]]
    for value in over["preload"]:
        disk.tuned_change(value)

    results: AbstractContextManager[ResultsFile | None] = nullcontext()
    if resume is not None:
        results = closing(ResultsFile(resume, sample.header(), "sample of bladed disks"))
    with results as store:
        run = partial(run_stored, sample, executor=executor, store=store, progress=progress)
        peaks, searched, indices = _records(sample, audit, audited, run)
    return _result(
        sample,
        peaks,
        searched,
        indices,
        tuned=tuned,
        audited=audited,
        audit_share=float(audit),
    )


def _records(
    sample: _Sample, audit: float, audited: NDArray, run: Callable[..., Records]
) -> tuple[Records, Records, list[int]]:
    """Return the records of all peaks and of the thorough searches, and the indices of these."""
    points = []
    names = []
    for cell in itertools.product(*sample.over.values()):
        points.append(dict(zip(sample.over, cell)))
        names.append(" ".join(map(str, cell)))
    peaks = run(points.__getitem__, names, what="disks", unit="peak")

    # the thorough search covers the band of the first search
    indices = sample.audits(peaks, audit, audited)
    searches = [points[i] | {"interval": peaks.values["interval"][i]} for i in indices]
    search_names = [f"audit {names[i]}" for i in indices]
    searched = run(searches.__getitem__, search_names, what="audit", unit="search")
    return peaks, searched, indices


def _result(
    sample: _Sample,
    peaks: Records,
    searched: Records,
    indices: list[int],
    *,
    tuned: list[Peak],
    audited: NDArray,
    audit_share: float,
) -> MistunedSample:
    """Assemble the sample from the records of all searches."""
    n_points = len(peaks.status)

    def of_searched(values: NDArray, missing: float) -> NDArray:
        """Return values of all points, ``missing`` without a thorough search."""
        of_points = np.full(n_points, missing)
        of_points[indices] = values
        return of_points.reshape(sample.shape)

    curve_status = ["not asked"] * n_points
    curve_reason = [""] * n_points
    for i, status, reason in zip(indices, searched.status, searched.reason):
        curve_status[i] = status
        curve_reason[i] = reason
    columns: dict[str, Any] = {
        name: numbers_of(peaks.values, name).reshape(sample.shape) for name in OF_PEAKS
    }
    disks, deviations, preloads = map(np.array, sample.over.values())
    return MistunedSample(
        n_blades=sample.disk.n_blades,
        disks=disks,
        standard_deviation=deviations,
        preload=preloads,
        **columns,
        audited=audited,
        audit_share=audit_share,
        tuned_amplitude=np.array([p.amplitude for p in tuned]),
        status=peaks.status,
        reason=peaks.reason,
        curve_amplitude=of_searched(numbers_of(searched.values, "amplitude"), np.nan),
        curve_status=tuple(curve_status),
        curve_reason=tuple(curve_reason),
        processor=numbers_of(peaks.cost, "processor").reshape(sample.shape),
        curve_processor=of_searched(numbers_of(searched.cost, "processor"), 0.0),
        drawn=dict(sample.random),
        settings=sample.disk.structure.tuned.record(),
        model_hash=sample.disk.study.model.hash,
    )
