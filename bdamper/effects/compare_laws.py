"""What the choice of the friction law changes: the same tracking curve under several laws."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from bdamper.continuation.curve import Curve, uninterrupted
from bdamper.continuation.path import ContinuationOptions
from bdamper.continuation.track import track
from bdamper.problem.effects import Effects
from bdamper.problem.plausible import check_question
from bdamper.problem.problem import Problem
from bdamper.util import validate
from bdamper.util.blas import one_thread
from bdamper.util.hdf5 import Storable
from bdamper.util.plotting import Plottable
from bdamper.util.repr import brief
from bdamper.util.tables import Column, Tabular, joined
from bdamper.util.text import amount, percent

LAWS = ("separable", "major", "coupled", "constant_normal_load", "bonded")
"""Names of laws; "major" is the separable law along the major directions of the motion."""


@brief
@dataclass(frozen=True)
class LawComparison(Plottable, Tabular, Storable, kind="bdamper-law-comparison", oldest=2):
    """Curves of one study under several friction laws.

    ``plot`` draws all curves in one picture (:func:`bdamper.plot.plot_laws`).

    Parameters
    ----------
    laws : tuple of str
        Names out of :data:`LAWS`; the last one is the reference of the differences.
    curves : tuple of Curve
    """

    laws: tuple[str, ...]
    curves: tuple[Curve, ...]

    def difference(self, law: str) -> float:
        """Peak amplitude under a law relative to the reference, minus one."""
        return self.curves[self.laws.index(law)].peak.amplitude / self.curves[-1].peak.amplitude - 1.0

    def columns(self) -> dict[str, Column]:
        """The points of all curves one below the other, each with its law."""
        return {"law": Column(np.repeat(self.laws, [len(c) for c in self.curves])), **joined(self.curves)}

    def bottom_line(self) -> str:
        known = [law for law, curve in zip(self.laws[:-1], self.curves) if len(curve) and len(self.curves[-1])]
        parts = ", ".join(f"{percent(self.difference(law), True)} under '{law}'" for law in known) or "no law to compare"
        return f"Peaks beside that under the law '{self.laws[-1]}', at {amount(self.curves[0].preload, 'N')}: {parts}."


@one_thread
def compare_laws(
    problem: Problem,
    preload: float,
    frequency: tuple[float, float],
    laws: Sequence[str] = ("separable", "major", "coupled"),
    *,
    options: ContinuationOptions | None = None,
) -> LawComparison:
    """Tracking curves under several friction laws, everything else the same.

    Parameters
    ----------
    problem : Problem
    preload : float, N
    frequency : (low, high), Hz
    laws : sequence of str
        Out of :data:`LAWS`.  The coupled law is sampled, with 128 samples unless ``evaluation`` says otherwise.
    options : ContinuationOptions

    Returns
    -------
    LawComparison
    """
    preload, frequency = problem.check_preload(preload), validate.interval("frequency", frequency)
    check_question(problem, [preload], frequency)
    laws = validate.names("laws", laws, LAWS, least=2)
    curves = [uninterrupted(track(_under(problem, law), preload, frequency, options=options)) for law in laws]
    return LawComparison(laws, tuple(curves))


def _under(problem: Problem, law: str) -> Problem:
    if law == "major":
        return replace(problem, friction_law="separable", friction_axes="major")
    plain = replace(problem, friction_axes="contact")
    if law == "coupled":
        return plain.with_effects(replace(Effects.of(problem), friction_law="coupled"))
    return replace(plain, friction_law=law)
