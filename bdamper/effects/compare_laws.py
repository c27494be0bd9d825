"""What the choice of the friction law changes: the same curve under several laws."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from bdamper.contact.laws import Sampled
from bdamper.continuation.curve import Curve, uninterrupted
from bdamper.continuation.follower import ContinuationOptions
from bdamper.continuation.track import track
from bdamper.problem.problem import Problem
from bdamper.util import validate
from bdamper.util.blas import one_thread
from bdamper.util.hdf5 import Storable
from bdamper.util.plotting import Plottable
from bdamper.util.repr import brief

CHOICES = {
    "separable": {"friction_law": "separable", "friction_axes": "contact"},
    "major": {"friction_law": "separable", "friction_axes": "major"},
    "coupled": {"friction_law": "coupled", "friction_axes": "contact"},
    "constant_normal_load": {"friction_law": "constant_normal_load", "friction_axes": "contact"},
    "bonded": {"friction_law": "bonded", "friction_axes": "contact"},
}
"""Settings of a study for each name; "major" is the separable law along the major directions of the motion."""


@brief
@dataclass(frozen=True)
class LawComparison(Plottable, Storable, kind="bdamper-law-comparison", oldest=2):
    """Curves of one study under several friction laws.

    ``plot`` draws all curves in one picture (:func:`bdamper.plot.plot_laws`).

    Parameters
    ----------
    laws : tuple of str
        Names out of :data:`CHOICES`; the last one is the reference of the differences.
    curves : tuple of Curve
    """

    laws: tuple[str, ...]
    curves: tuple[Curve, ...]

    def difference(self, law: str) -> float:
        """Peak amplitude under a law relative to the reference, minus one."""
        peaks = dict(zip(self.laws, (curve.peak.amplitude for curve in self.curves)))
        return peaks[law] / peaks[self.laws[-1]] - 1.0

    def __str__(self) -> str:
        width = max(map(len, self.laws))
        lines = [f"preload {self.curves[0].preload:g} N, peaks relative to '{self.laws[-1]}'"]
        for law, curve in zip(self.laws, self.curves):
            if not len(curve):
                lines.append(f"  {law:<{width}}  no points: {curve.status} ({curve.reason})")
                continue
            peak = curve.peak
            change = f"{100 * self.difference(law):+.2f} %" if len(self.curves[-1]) else "-"
            lines.append(
                f"  {law:<{width}}  {peak.amplitude:.6g} m at {peak.frequency:.6g} Hz  {change:>9}  {curve.status}"
            )
        return "\n".join(lines)



def known_laws(laws: Sequence[str]) -> tuple[str, ...]:
    """The names, checked."""
    return validate.names("laws", laws, CHOICES, least=2)


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
        Out of "separable", "major" (separable along major directions), "coupled", "constant_normal_load", "bonded".
        The coupled law is sampled, with 128 samples unless ``evaluation`` says otherwise.
    options : ContinuationOptions

    Returns
    -------
    LawComparison
        Prints the differences of the peaks to the last law.
    """
    preload, frequency = problem.check_preload(preload), validate.interval("frequency", frequency)
    curves = []
    for law in known_laws(laws):
        settings: dict[str, Any] = dict(CHOICES[law])
        if law != "major":
            settings["major_frequency"] = None
        if law == "coupled":
            settings["residual_traction"] = "static"
            if problem.evaluation == "exact":
                settings["evaluation"] = Sampled(max(128, 8 * problem.harmonic_numbers[-1] + 8))
        curves.append(uninterrupted(track(replace(problem, **settings), preload, frequency, options=options)))
    return LawComparison(tuple(laws), tuple(curves))
