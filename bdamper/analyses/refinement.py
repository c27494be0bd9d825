"""Refinement of a study until the estimated error of a peak is within a tolerance.

Each step estimates the errors of the peak by source (:mod:`bdamper.analyses.error_estimates`). The
estimate of a source has already solved a study that is more detailed in this respect. The study and
the peak of the largest source replace the former ones, so that no peak has to be searched for
again.

If the last refinement of a source used all the detail of the model, a fraction of the last change
remains as its error (:data:`bdamper.analyses.accuracy.LEFT`). The sum of all known errors is
compared with the tolerance.

The refinement ends without success if

* the sum of the errors that no study of this model can reduce exceeds the tolerance;
* a more detailed study has no peak;
* peaks with more harmonics do not approach each other, not even after a refinement of the
  harmonics: only time integration can then give the amplitude (changes below a fifth of the
  tolerance do not count);
* the next step would exceed the time limit, or a step does exceed it. The expected time grows with
  the square of the number of unknowns, because Jacobians take most of it.

The result then gives the settings or the model that would reach the tolerance. The required number
of modes is extrapolated from the part of the error that remains after doubling; the error is
assumed to be inversely proportional to the number of contact points.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, NamedTuple

import numpy as np

from bdamper.analyses.accuracy import LEFT
from bdamper.analyses.error_estimates import SOURCES, Enriched, Tops, examine, richer_study
from bdamper.harmonic_balance.problem import Problem
from bdamper.harmonic_balance.study_boundary import StudyLike, in_type_of, problem_of
from bdamper.harmonic_balance.subject import preload_text
from bdamper.response.motion_range import half_range
from bdamper.response.peak import Peak, check_peak
from bdamper.response.peak_error import SourceError
from bdamper.response.verification import CONVERGED_SHARE, ErrorEstimates
from bdamper.util import validation
from bdamper.util.display import Plottable, Result
from bdamper.util.errors import COMPLETE, INCOMPLETE, INTERRUPTED, BdamperError, Ending
from bdamper.util.formatting import amount, peak_text, percent, sentence, short_repr
from bdamper.util.progress import (
    Cost,
    CostMeter,
    LongWork,
    one_thread,
    progress_stages,
    shows_progress,
    stopped_after,
)
from bdamper.util.records import Data, Reason
from bdamper.util.statement import Row, Statement
from bdamper.util.storage import Recorded, Storable
from bdamper.util.tables import Column, Cycles, Metre, Second, Tabular, columns_of_rows

MAXIMUM = 600.0
"""Default limit of the time of all steps (s)."""
HALVED = 0.5
"""Part of the error of contact points that twice their number leaves."""
MOST_DOUBLINGS = 20
"""Doublings of a number from which nothing reasonable reaches the tolerance."""


@dataclass(frozen=True)
class RefinementStep:
    """Peak of one study of a refinement, its estimated error, and the cost of both.

    Parameters
    ----------
    change : str
        Settings that are more detailed than in the previous step; "" for the first step.
    amplitude, frequency : float, m, Hz
    error : float
        Estimated relative error; NaN if the estimate was stopped.
    largest : str
        Source of the largest error; "" if none is known.
    evaluations : int
        Evaluations of the equations for the estimate, which contains the peak of the next step.
    seconds : float
        Elapsed time of the estimate.
    """

    change: str
    amplitude: Metre
    frequency: Cycles
    error: float
    largest: str
    evaluations: int
    seconds: Second


class Need(NamedTuple):
    """Settings or model that would reach a tolerance, and the estimated time (s); NaN if unknown."""

    text: str = ""
    seconds: float = float("nan")


@short_repr
@dataclass(frozen=True)
class Refinement(Result, Plottable, Tabular, Recorded, Storable, kind="bdamper-refinement"):
    """Study that was enriched until the estimated error of a peak met a tolerance.

    ``plot`` draws the error against time (:func:`bdamper.plot.plot_refinement`).

    Parameters
    ----------
    preload : float, N
    tolerance : float
        Relative tolerance of amplitude and frequency.
    steps : tuple of RefinementStep
        One step for each study; the first belongs to the original study.
    peak : Peak
        Peak of the last study.
    sources : tuple of SourceError
        Estimated errors of this peak.
    status : str
        "complete", "interrupted" or "incomplete".
    reason : str
        Reason why the tolerance was not reached.
    needed : str
        Settings or model that would reach the tolerance, or "".
    needed_seconds : float
        Estimated time of the remaining steps; NaN if unknown.
    examined : tuple of str
        Sources whose errors were estimated.
    study : Study, optional
        Last study. It is not saved; :func:`bdamper.load_study` restores it from the file and the
        model.
    """

    preload: float
    tolerance: float
    steps: tuple[RefinementStep, ...]
    peak: Peak
    sources: tuple[SourceError, ...]
    status: str = COMPLETE
    reason: Reason = ""
    needed: str = ""
    needed_seconds: float = float("nan")
    examined: tuple[str, ...] = SOURCES
    # a file contains the settings of the study, and not the study
    study: Annotated[Any, Data(file=".")] = field(default=None, compare=False, repr=False)

    def columns(self) -> dict[str, Column]:
        """Return one row for each step."""
        return columns_of_rows(self.steps)

    @property
    def error(self) -> float:
        """Estimated relative error of the peak."""
        return self.steps[-1].error

    @property
    def seconds(self) -> float:
        """Elapsed time of all steps, s."""
        return float(sum(step.seconds for step in self.steps))

    @property
    def evaluations(self) -> int:
        """Evaluations of the equations in all steps."""
        return sum(step.evaluations for step in self.steps)

    @property
    def reached(self) -> bool:
        """Whether the estimated error is within the tolerance."""
        return self.ok

    def _statement(self) -> Statement:
        peak = peak_text(self.peak.amplitude, self.peak.frequency)
        subject = f"peak {peak}, {preload_text(self.preload, self.settings)}"
        reached = "reached" if self.reached else "not reached"
        remarks = []
        if not self.reached:
            remarks.append(sentence(self.reason or self.status))
        if self.needed:
            seconds = ""
            if np.isfinite(self.needed_seconds):
                seconds = f", in about {amount(self.needed_seconds, 's', 2)}"
            remarks.append(f"Needed: {self.needed}{seconds}")
        remarks.append("Evaluations: of the equations of motion, for the estimate in each row")
        left_out = [source for source in SOURCES if source not in self.examined]
        remarks.append(f"Not covered: {', '.join(['time integration', *left_out])}")
        unknown = [
            Row(item.source, "not estimated", item.against)
            for item in self.sources
            if not item.known
        ]
        tolerance = f"Tolerance of {percent(self.tolerance)} {reached}"
        verdict = f"{tolerance}: estimated error {percent(self.error)}, {subject}"
        return Statement([verdict], [], unknown, remarks, self._step_table())

    def _step_table(self) -> list[tuple[str, ...]]:
        table: list[tuple[str, ...]] = [
            ("Peak", "Frequency", "Error", "Largest source", "Evaluations", "Time", "Settings")
        ]
        for step in self.steps:
            table.append(
                (
                    amount(step.amplitude, "m"),
                    amount(step.frequency, "Hz"),
                    percent(step.error),
                    step.largest,
                    str(step.evaluations),
                    amount(step.seconds, "s", 2),
                    step.change or "initial",
                )
            )
        return table


@one_thread
def refine(
    study: StudyLike | Problem,
    peak: Peak,
    *,
    tolerance: float = 0.05,
    maximum: float = MAXIMUM,
    sources: Sequence[str] = SOURCES,
    progress: bool | None = None,
) -> Refinement:
    """See :meth:`bdamper.Study.refine`."""
    problem = problem_of(study)
    check_peak(problem, peak)
    tolerance = validation.number("tolerance", tolerance, above=0.0, below=1.0)
    maximum = validation.number("maximum", maximum, above=0.0)
    sources = validation.names("sources", sources, SOURCES)
    search = _Search(problem, peak, tolerance, maximum, tuple(sources))
    show = shows_progress(progress)
    with (
        LongWork() as work,
        stopped_after(maximum) as too_late,
        progress_stages(show, "refinement", "step") as report,
    ):
        while not search.ended:
            n_steps = len(search.steps)
            report(search.change, n_steps, n_steps + 1)
            search.step()
    if work.interrupted:
        search.interrupt(too_late.is_set())
    return search.result(study)


@dataclass
class _Search:
    """State of a refinement.

    Parameters
    ----------
    problem, peak : Problem, Peak
        Study and peak of the next or the last step.
    tolerance, maximum : float
    examined : tuple of str
        Sources of error.
    """

    problem: Problem
    peak: Peak
    tolerance: float
    maximum: float
    examined: tuple[str, ...]

    change: str = ""
    steps: list[RefinementStep] = field(default_factory=list)
    sources: tuple[SourceError, ...] = ()
    ending: Ending | None = None
    needed: Need = field(default_factory=Need)
    meter: CostMeter = field(default_factory=CostMeter)
    # change by the last refinement of each source
    refined: dict[str, SourceError] = field(default_factory=dict)

    @property
    def ended(self) -> bool:
        """Whether the tolerance is reached, or out of reach."""
        return self.ending is not None

    def interrupt(self, too_late: bool) -> None:
        """Record that the latest step was stopped, by Ctrl-C or at the largest time."""
        self.ending = Ending(INTERRUPTED)
        if too_late:
            self._end(f"the estimate was stopped after {amount(self.maximum, 's')}")
            self.needed = Need("a larger maximum, or a study with a simpler response curve")
        cost = self.meter.read()
        self._add_step(float("nan"), "", cost)

    def result(self, study: StudyLike | Problem) -> Refinement:
        """Return the result for the study of the question."""
        ending = self.ending or Ending()
        return Refinement(
            preload=self.peak.parameter,
            tolerance=self.tolerance,
            steps=tuple(self.steps),
            peak=self.peak,
            sources=self.sources,
            status=ending.status,
            reason=ending.reason,
            needed=self.needed.text,
            needed_seconds=self.needed.seconds,
            examined=self.examined,
            study=in_type_of(study, self.problem),
            **self.problem.recorded(),
        )

    def step(self) -> None:
        """Estimate the errors of the peak, then take the study of the largest or end."""
        self.meter = CostMeter()
        estimates, enriched = examine(self.problem, self.peak, self.examined, self.meter)
        self.sources = self._with_remainders(estimates)
        sizes = {item.source: item.size for item in self.sources if item.known}
        error = float(sum(sizes.values()))
        largest = max(sizes, key=lambda source: sizes[source], default="")
        self._add_step(error, largest, estimates.cost)
        missing = self._missing_peak(enriched)
        undecided = self._undecided(estimates)
        if undecided and (missing or "harmonics" in self.refined):
            self._end(f"{_amplitudes(estimates)}: harmonic balance cannot determine the amplitude")
            self.needed = Need("time integration, study.time_response(peak)")
        elif missing:
            self._end(missing)
        elif error <= self.tolerance and not undecided:
            self.ending = Ending()
        else:
            self._continue(estimates, enriched, sizes)

    def _undecided(self, estimates: ErrorEstimates) -> bool:
        """Return whether peaks with more harmonics leave the amplitude open at this tolerance.

        Changes far below the tolerance do not matter, even if the last one is the largest.
        Each change counts, because two large ones may cancel.
        """
        limit = CONVERGED_SHARE * self.tolerance
        return estimates.undecided and not estimates.largest_harmonic_change < limit

    def _add_step(self, error: float, largest: str, cost: Cost) -> None:
        peak = self.peak
        step = RefinementStep(
            self.change,
            peak.amplitude,
            peak.frequency,
            error,
            largest,
            cost.evaluations,
            cost.seconds,
        )
        self.steps.append(step)

    def _with_remainders(self, estimates: ErrorEstimates) -> tuple[SourceError, ...]:
        """Return the errors, also the part that the last refinement of exhausted sources left."""
        errors = {item.source: item for item in estimates.sources}
        for source, last in self.refined.items():
            error = errors.get(source)
            if error is not None and error.known:
                continue
            left = LEFT[source]
            if left == 0.0 and error is None:
                continue
            reason = (
                "assumed fraction of the last change; "
                f"{error.against if error else 'no further refinement'}"
            )
            errors[source] = SourceError(
                source,
                amplitude=left * last.amplitude,
                frequency=left * last.frequency,
                uncertainty=0.0,
                against=reason,
            )
        return tuple(errors.values())

    def _missing_peak(self, enriched: dict[str, Enriched]) -> str:
        """Return why a more detailed study does not continue the peak, or ""."""
        by_source = {item.source: item for item in self.sources}
        for source, richer in enriched.items():
            if _usable(richer.tops) is None:
                return f"with {richer.text}: {by_source[source].against}"
        return ""

    def _continue(
        self, estimates: ErrorEstimates, enriched: dict[str, Enriched], sizes: dict[str, float]
    ) -> None:
        """Take the study of the largest error that a study of the model reduces, or end."""
        fixed = {source: size for source, size in sizes.items() if source not in enriched}
        if sum(fixed.values()) > self.tolerance:
            named = " and ".join(f"{source} {percent(size)}" for source, size in fixed.items())
            self._end(f"the model has no more detail for {named}")
            self.needed = self._beyond_model(fixed)
            return
        reducible = {source: size for source, size in sizes.items() if source in enriched}
        worst = max(reducible, key=lambda source: reducible[source], default="")
        # without a limit of the harmonics their error is not known
        if self._undecided(estimates) and "harmonics" in enriched:
            worst = "harmonics"
        richer = enriched[worst]
        seconds = sum(step.seconds for step in self.steps)
        next_seconds = self._seconds_with(richer.problem)
        if seconds + next_seconds > self.maximum:
            limit = amount(self.maximum, "s")
            next_text = amount(next_seconds, "s", 2)
            self._end(f"the next step takes about {next_text}; the limit for all steps is {limit}")
            self.needed = self._forecast(sizes)
            return
        by_source = {item.source: item for item in estimates.sources}
        self.refined[worst] = by_source[worst]
        self.change = richer.text
        self.peak = _peak_of(richer, self.peak)
        self.problem = richer.problem

    def _end(self, reason: str) -> None:
        self.ending = Ending(INCOMPLETE, reason)

    def _seconds_with(self, other: Problem) -> float:
        """Return the expected time of a step with another problem."""
        growth = other.n_unknowns / self.problem.n_unknowns
        return self.steps[-1].seconds * max(growth, 1.0) ** 2

    def _forecast(self, sizes: dict[str, float]) -> Need:
        """Refine the study without computing, until the assumed errors meet the tolerance."""
        sizes = dict(sizes)
        problem = self.problem
        changes: dict[str, str] = {}
        seconds = 0.0
        exhausted: set[str] = set()
        while sum(sizes.values()) > self.tolerance:
            reducible = [source for source in sizes if source not in exhausted]
            if not reducible:
                return Need("a more detailed model")
            worst = max(reducible, key=lambda source: sizes[source])
            try:
                richer = richer_study(problem, worst)
            except BdamperError:
                richer = None
            if richer is None:
                exhausted.add(worst)
                continue
            problem, changes[worst] = richer
            sizes[worst] *= LEFT[worst]
            seconds += self._seconds_with(problem)
        # an undecided case may be within the tolerance
        text = ", ".join(changes.values()) or "more harmonics"
        return Need(text, seconds or float("nan"))

    def _beyond_model(self, fixed: dict[str, float]) -> Need:
        """Return the numbers of modes or points that would meet half of the tolerance."""
        allowed = 0.5 * self.tolerance / sum(fixed.values())
        texts = []
        growth = 1.0
        for source in fixed:
            present = self._number_of(source)
            left = HALVED if source == "contact points" else LEFT[source]
            if not present or not left:
                continue
            doublings = float(np.log(allowed) / np.log(left))
            if doublings > MOST_DOUBLINGS:
                continue
            factor = 2.0**doublings
            growth *= factor
            texts.append(f"about {np.ceil(factor * present):.0f} {source}")
        if not texts:
            return Need("time integration, study.time_response(peak)")
        seconds = self.steps[-1].seconds * growth**2
        return Need(f"a model with {' and '.join(texts)}", seconds)

    def _number_of(self, source: str) -> int:
        """Return the number of blade modes or contact points of the study; 0 for other sources."""
        settings = self.problem.settings
        if source == "modes":
            return settings.blade_modes
        if source == "contact points":
            return settings.contact_points or settings.most_points
        return 0


def _usable(tops: Tops | None) -> Tops | None:
    """Return the peaks of a more detailed study, or None if they contain no maximum."""
    if tops is None or tops.at_end or not tops.peaks[0].ok:
        return None
    return tops


def _peak_of(richer: Enriched, before: Peak) -> Peak:
    """Return the peak of a more detailed study with the settings that the study records."""
    tops = _usable(richer.tops)
    assert tops is not None
    peak = tops.peaks[0]
    system = richer.problem.system(before.parameter)
    recorded = richer.problem.recorded()
    if "frequency" in before.settings:
        recorded["settings"] |= {"frequency": before.settings["frequency"]}
    motion = float(half_range(system.response(peak.y[:-1])))
    return replace(peak, half_range=motion, notes=before.notes, cost=None, **recorded)


def _amplitudes(estimates: ErrorEstimates) -> str:
    """Return the peaks with increasing numbers of harmonics as text."""
    peaks: Sequence[Any] = estimates.harmonic_peaks
    texts = [
        amount(peak.amplitude, "m") if np.isfinite(peak.amplitude) else "no peak" for peak in peaks
    ]
    numbers = [str(peak.harmonics) for peak in peaks]
    return f"{', '.join(texts)} with {', '.join(numbers)} harmonics"
