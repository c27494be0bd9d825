"""One question asked of several studies, and one table of what comes of it: designs, friction laws, any settings.

In come studies by name and a question that returns a response curve or an optimal curve; out comes a
:class:`Comparison` with all of them, in which the first is what the others are compared with.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from bdamper.harmonic_balance.parameters import vary
from bdamper.harmonic_balance.problem import Problem
from bdamper.harmonic_balance.study_dispatch import Asking, like, problem_of
from bdamper.response.curve import ResponseCurve
from bdamper.response.optimal_curve_result import OptimalCurve
from bdamper.util import validation
from bdamper.util.differences import Differences
from bdamper.util.display import Plottable
from bdamper.util.formatting import amount, height, percent
from bdamper.util.progress import each
from bdamper.util.short_repr import brief
from bdamper.util.storage import Storable
from bdamper.util.tables import Column, Tabular, joined
from bdamper.util.threading import one_thread


@brief
@dataclass(frozen=True)
class Comparison(Plottable, Tabular, Storable, kind="bdamper-comparison"):
    """Response curves or optimal curves of several problems.

    ``plot`` draws all of them on the same axes (:func:`bdamper.plot.plot_comparison`).

    Parameters
    ----------
    names : tuple of str
        Of the problems; changes are those from the first.
    curves : tuple of ResponseCurve
        One for each problem, or none.
    optimal : tuple of OptimalCurve
        One for each problem, or none.
    """

    names: tuple[str, ...]
    curves: tuple[ResponseCurve, ...] = ()
    optimal: tuple[OptimalCurve, ...] = ()

    def __len__(self) -> int:
        return len(self.names)

    @property
    def results(self) -> dict[str, ResponseCurve] | dict[str, OptimalCurve]:
        """Results by the name of their problem."""
        return dict(zip(self.names, self.curves)) if self.curves else dict(zip(self.names, self.optimal))

    @property
    def differences(self) -> dict[str, Differences]:
        """Differences between the first result and each of the others."""
        first, *others = self.results.values()
        return {name: first.compare(other) for name, other in zip(self.names[1:], others)}

    def columns(self) -> dict[str, Column]:
        """The points of all curves one below the other, each with the name of its problem."""
        results: tuple[ResponseCurve, ...] | tuple[OptimalCurve, ...] = self.curves or self.optimal
        return {"name": Column(np.repeat(np.array(self.names), [len(r) for r in results])), **joined(results)}

    def change(self, name: str) -> float:
        """Amplitude relative to that of the first problem, minus one; NaN if one of both is not known."""
        of, first = (_outcome(self.results[key])[0] for key in (name, self.names[0]))
        return of / first - 1.0

    def _rows(self) -> list[tuple[str, ...]]:
        rows: list[tuple[str, ...]] = [("", "amplitude", "frequency", "preload", "change", "time", "")]
        for name, result in self.results.items():
            a, f, p, status = _outcome(result)
            told = percent(self.change(name), True) if name != self.names[0] and np.isfinite(self.change(name)) else ""
            numbers = amount(a, "m"), amount(f, "Hz", 6), amount(p, "N")
            rows.append((name, *numbers, told, amount(result.cost.seconds, "s"), status))
        return rows

    def _headline(self) -> str:
        a, f, p, why = _outcome(self.results[self.names[0]])
        if not np.isfinite(a):
            return f"No peak of '{self.names[0]}' to compare with: {why}."
        known = [(name, change) for name in self.names[1:] if np.isfinite(change := self.change(name))]
        parts = ", ".join(f"'{name}' {percent(change, True)}" for name, change in known) or "none is known"
        return f"Beside '{self.names[0]}' with {height(a, f)}, preload {amount(p, 'N')}: {parts}."


def _outcome(result: ResponseCurve | OptimalCurve) -> tuple[float, float, float, str]:
    """Amplitude (m), frequency (Hz), preload (N) of a result, and how far they are to be trusted."""
    if isinstance(result, OptimalCurve):
        o = result.optimum
        return o.amplitude, o.frequency, o.preload, f"{o.kind}, {o.status}"
    if not len(result):
        return np.nan, np.nan, result.preload, f"{result.status}: {result.reason}"
    top = result.peak
    if result.peak_at_end:
        return np.nan, np.nan, result.preload, f"{result.status}, no peak: highest {height(top.amplitude, top.frequency)}"
    return top.amplitude, top.frequency, result.preload, result.status


@validation.spelt
@one_thread
def compare(
    studies: Mapping[str, Asking | Problem | Mapping[str, Any]],
    question: Callable[[Any], ResponseCurve | OptimalCurve],
    *,
    progress: bool = False,
) -> Comparison:
    """The same question asked of several studies.

    Parameters
    ----------
    studies : mapping of name to study or settings
        The first is a study, with which the others are compared.  Settings are those in which a study differs from it, by
        the names that a sweep takes (:func:`bdamper.sweep`): ``{"now": study, "smooth": {"friction_coefficient": 0.2}}``.
    question : callable
        Returns the response curve or the optimal curve of a study, ``lambda study: study.frequency_response(500.0, (280.0,
        380.0))``.
    progress : bool
        Show a progress bar.

    Returns
    -------
    Comparison
        After Ctrl-C the studies up to the one that was interrupted.

    Raises
    ------
    SettingError
        Before any work, if a study or a setting does not fit.
    """
    words = "a mapping of one or more names to studies or settings"
    named = isinstance(studies, Mapping) and studies and all(isinstance(key, str) for key in studies)
    validation.that(bool(named), "studies", words, studies)
    first = next(iter(studies.values()))
    problem, asked = problem_of(first), []  # type: ignore[arg-type]
    for name, given in studies.items():
        own: Any = validation.instance(f"study '{name}'", getattr(given, "problem", given), (Problem, Mapping), words)
        asked.append(given if isinstance(own, Problem) else like(first, vary(problem, own)))  # type: ignore[type-var]
    found: list[ResponseCurve | OptimalCurve] = []
    for study in each(asked, progress, "studies", "study"):
        answer = validation.instance(
            "answer", question(study), (ResponseCurve, OptimalCurve), "a ResponseCurve or an OptimalCurve"
        )
        kind = type(found[0]) if found else type(answer)
        found.append(validation.instance("answer", answer, kind, "the same kind of result from every study"))
        if answer.interrupted:
            break
    curves = tuple(result for result in found if isinstance(result, ResponseCurve))
    optimal = tuple(result for result in found if isinstance(result, OptimalCurve))
    return Comparison(tuple(studies)[: len(found)], curves, optimal)
