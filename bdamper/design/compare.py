"""Designs beside each other: the same question asked of several problems, their curves kept."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from bdamper.continuation.curve import Curve
from bdamper.continuation.track import track
from bdamper.peaks.interval import peak_interval
from bdamper.peaks.optimal import optimal_curve, preload_values
from bdamper.peaks.optimal_curve import OptimalCurve
from bdamper.problem.plausible import check_question
from bdamper.problem.problem import Problem
from bdamper.problem.variation import vary
from bdamper.util import validate
from bdamper.util.blas import one_thread
from bdamper.util.differences import Differences
from bdamper.util.hdf5 import Storable
from bdamper.util.plotting import Plottable
from bdamper.util.progress import each
from bdamper.util.repr import brief
from bdamper.util.tables import Column, Tabular, joined
from bdamper.util.text import aligned, amount, height, percent

Found = TypeVar("Found", Curve, OptimalCurve)


@brief
@dataclass(frozen=True)
class DesignComparison(Plottable, Tabular, Storable, kind="bdamper-designs"):
    """Tracking curves or optimal curves of several designs.

    ``plot`` draws all of them on the same axes (:func:`bdamper.plot.plot_designs`).

    Parameters
    ----------
    names : tuple of str
        Of the designs; changes are those from the first.
    curves : tuple of Curve
        One for each design, or none.
    optimal : tuple of OptimalCurve
        One for each design, or none.
    """

    names: tuple[str, ...]
    curves: tuple[Curve, ...] = ()
    optimal: tuple[OptimalCurve, ...] = ()

    def __len__(self) -> int:
        return len(self.names)

    @property
    def results(self) -> dict[str, Curve] | dict[str, OptimalCurve]:
        """What there is of each design, by its name."""
        return dict(zip(self.names, self.curves)) if self.curves else dict(zip(self.names, self.optimal))

    @property
    def differences(self) -> dict[str, Differences]:
        """What differs between the first design and each of the others."""
        first, *others = self.results.values()
        return {name: first.compare(other) for name, other in zip(self.names[1:], others)}

    def columns(self) -> dict[str, Column]:
        """The points of all curves one below the other, each with the name of its design."""
        results: tuple[Curve, ...] | tuple[OptimalCurve, ...] = self.curves or self.optimal
        return {"design": Column(np.repeat(np.array(self.names), [len(r) for r in results])), **joined(results)}

    def _table(self) -> list[tuple[str, ...]]:
        rows = [(name, *_outcome(result)) for name, result in self.results.items()]
        reference = rows[0][1]

        def change(amplitude: float) -> str:
            return percent(amplitude / reference - 1.0, True) if np.isfinite(amplitude / reference) else ""

        return [
            ("design", "amplitude", "frequency", "preload", "change", ""),
            *((n, amount(a, "m"), amount(f, "Hz", 6), amount(p, "N"), change(a) if n != self.names[0] else "", s)
              for n, a, f, p, s in rows),
        ]  # fmt: skip

    def bottom_line(self) -> str:
        known = {name: _outcome(result) for name, result in self.results.items()}
        found = {name: row for name, row in known.items() if np.isfinite(row[0])}
        if not found:
            return "No design has a peak."
        least = min(found, key=lambda name: found[name][0])
        a, f, p, _ = found[least]
        first = known[self.names[0]][0]
        change = f", {percent(a / first - 1.0, True)} beside '{self.names[0]}'" if a < first else ""
        place = f"{height(a, f)}, preload {amount(p, 'N')}"
        return f"Least amplitude of {len(self)} designs: '{least}' with {place}{change}."

    def details(self) -> str:
        return "\n".join(aligned(self._table()))


def _outcome(result: Curve | OptimalCurve) -> tuple[float, float, float, str]:
    """Amplitude (m), frequency (Hz), preload (N) of a design, and how far they are to be trusted."""
    if isinstance(result, OptimalCurve):
        o = result.optimum
        return o.amplitude, o.frequency, o.preload, f"{o.kind}, {o.status}"
    if not len(result):
        return np.nan, np.nan, result.preload, f"{result.status}: {result.reason}"
    top = result.peak
    return top.amplitude, top.frequency, result.preload, f"{result.status}{', no peak' if result.peak_at_end else ''}"


@one_thread
def compare_designs(
    problem: Problem,
    designs: Mapping[str, Problem | Mapping[str, Any]],
    preload: float | Sequence[float] | NDArray,
    frequency: tuple[float, float] | None = None,
    *,
    n: int = 24,
    name: str = "as it is",
    progress: bool = False,
) -> DesignComparison:
    """Curves of this problem and of other designs, to be drawn on the same axes.

    Parameters
    ----------
    problem : Problem
    designs : mapping of name to problem or settings
        Settings are those in which the design differs from this problem, with the names that a sweep takes
        (:func:`bdamper.sweep`): ``{"heavier": {"damper_mass_factor": 1.2}, "smooth": {"friction_coefficient": 0.2}}``.
    preload : float, or sequence of two or more, N
        One preload: tracking curves.  Two ends, or all values: optimal curves, without a ladder of harmonics.
    frequency : (low, high), Hz, optional
        Around the free and the stuck resonances of the designs by default.
    n : int
        Preloads between two ends.
    name : str
        Of this problem, which comes first.
    progress : bool

    Returns
    -------
    DesignComparison
        After Ctrl-C the designs up to the one that was interrupted.

    Raises
    ------
    SettingError
        Before any work, if a design or a setting does not fit.
    """
    if not isinstance(designs, Mapping) or not designs or not all(isinstance(key, str) for key in designs):
        raise validate.unfit("designs", "a mapping of one or more names to studies or settings", designs)
    validate.that(name not in designs, "name", "a name that no other design has", name)
    kinds, words = (Problem, Mapping), "a study or a mapping of settings"
    every = {name: problem}
    for key, design in designs.items():
        validate.instance(f"design '{key}'", design, kinds, words)
        every[key] = design if isinstance(design, Problem) else vary(problem, design)
    if np.ndim(preload) > 0:
        preloads = preload_values(preload, n)
        check_question(problem, preloads, frequency)
        results = _until_interrupted(every, lambda d: optimal_curve(d, preloads, frequency=frequency), progress)
        return DesignComparison(tuple(every)[: len(results)], (), results)
    load = max([design.check_preload(preload) for design in every.values()])  # type: ignore[arg-type]
    ends = [peak_interval(design, frequency) for design in every.values()]
    interval = min(low for low, _ in ends), max(high for _, high in ends)
    check_question(problem, [load], frequency)
    curves = _until_interrupted(every, lambda d: track(d, load, interval), progress)
    return DesignComparison(tuple(every)[: len(curves)], curves)


def _until_interrupted(designs: Mapping[str, Problem], ask: Callable[[Problem], Found], show: bool) -> tuple[Found, ...]:
    """What each design answers, up to the one at which the user has interrupted."""
    found: list[Found] = []
    for design in each(list(designs.values()), show, "designs", "design"):
        found.append(ask(design))
        if found[-1].interrupted:
            break
    return tuple(found)
