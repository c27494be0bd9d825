"""Selection of the physical effects that change a peak significantly.

The *reference* is the study with all effects that its model allows. The analysis computes the change of the highest peak of
the reference without each effect, and the work saved.

1. The peak is embedded in the study without the effect; one adjoint solution estimates the change
   (:mod:`bdamper.analyses.error_estimates`). An effect whose omission frees a direction of motion has no estimate, because
   the mean position may drift away from the peak: the complete curve without it is computed.
2. If the estimate with its uncertainty exceeds the tolerance, Newton's method continues from the peak; if this fails or the
   peak changes much, the complete curve without the effect is computed. If this fails too, the change is unknown and the
   effect is significant.
3. Effects are omitted one after the other, in order of the work saved, as long as the sum of their changes is within the
   tolerance. Together they may change the peak by more than the sum. Therefore the peak without all of them is computed and
   compared with the reference. Until they agree, the effect with the largest change is restored.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import reduce
from typing import Any

import numpy as np

from bdamper.analyses.error_estimates import (
    Change,
    Tops,
    compare,
    embed,
    estimate_change,
    whole_curve,
)
from bdamper.contact.laws import LAW_BONDED
from bdamper.harmonic_balance.checks import check_question
from bdamper.harmonic_balance.effects import MOTIONS, OFF, Effects, harmonic_numbers
from bdamper.harmonic_balance.equations import Equations
from bdamper.harmonic_balance.problem import Problem
from bdamper.model.kinematics import RIGID_NAMES
from bdamper.util import validation
from bdamper.util.display import Plottable
from bdamper.util.errors import BdamperError, SettingError
from bdamper.util.formatting import amount, percent, short_repr
from bdamper.util.progress import one_thread, progress_stages, shows_progress
from bdamper.util.storage import Storable
from bdamper.util.tables import Column, Tabular, columns_of_rows


@dataclass(frozen=True)
class EffectRow:
    """Change of the peak without one effect, and the significance of the effect.

    Parameters
    ----------
    name : str
        Name for :meth:`bdamper.Effects.without`.
    on : bool
        Whether the study has the effect.
    amplitude_change, frequency_change : float
        Relative change of the peak of the reference without this effect; NaN if unknown.
    uncertainty : float
        Possible error of an estimate, relative; 0 if the change was computed, infinite if unknown.
    source : {"estimated", "computed", "unknown"}
    work : float
        Operations of a Newton iteration without the effect, relative to the reference.
    significant : bool
    reason : str
        Reason why the change is unknown, or why an effect with a small change is significant.
    """

    name: str
    on: bool
    amplitude_change: float
    frequency_change: float
    uncertainty: float
    source: str
    work: float
    significant: bool = True
    reason: str = ""

    @property
    def size(self) -> float:
        """Largest relative change of amplitude or frequency plus the uncertainty; infinite if unknown."""
        return Change(self.amplitude_change, self.frequency_change, self.uncertainty).size

    @property
    def verdict(self) -> str:
        """Recommended action for the effect in the study."""
        if self.on:
            return "keep" if self.significant else "leave out"
        return "switch on" if self.significant else "stays off"


@short_repr
@dataclass(frozen=True)
class EffectSignificance(Plottable, Tabular, Storable, kind="bdamper-effect-significance"):
    """Change of the peak without each effect, and the significant effects.

    ``plot`` draws bars of the changes (:func:`bdamper.plot.plot_effect_significance`).

    Parameters
    ----------
    preload : float, N
    interval : (low, high), Hz
        Search interval of the highest peak.
    tolerance : float
        Allowed relative change of amplitude or frequency of the highest peak by all omitted effects together.
    amplitude, frequency : float, m, Hz
        Highest peak of the reference.
    effects : tuple of EffectRow
        The largest change first.
    reference, significant : Effects
        All effects, and only the significant effects.
    amplitude_change, frequency_change : float
        Computed relative change of the peak with the significant effects only.
    work : float
        Operations of a Newton iteration with the significant effects, relative to the reference.
    notes : tuple of str
        Status of the reference curve if it is not complete.
    """

    preload: float
    interval: tuple[float, float]
    tolerance: float
    amplitude: float
    frequency: float
    effects: tuple[EffectRow, ...]
    reference: Effects
    significant: Effects
    amplitude_change: float
    frequency_change: float
    work: float
    notes: tuple[str, ...] = ()

    def columns(self) -> dict[str, Column]:
        """Return one row for each effect; changes are relative."""
        return columns_of_rows(self.effects)

    def __getitem__(self, name: str) -> EffectRow:
        by_name = {item.name: item for item in self.effects}
        return by_name[validation.choice("effect", name, by_name)]

    @property
    def left_out(self) -> tuple[str, ...]:
        """Names of the effects that are not significant."""
        return tuple(e.name for e in self.effects if not e.significant)

    def _headline(self) -> str:
        left = ", ".join(self.left_out) or "none"
        change = f"the peak changes by {percent(self.amplitude_change, True)} and the work is {self.work:.2g} times as much"
        return (
            f"At a preload of {amount(self.preload, 'N')}, {len(self.effects) - len(self.left_out)} of {len(self.effects)} "
            f"effects are significant. Without the others ({left}) {change}."
        )

    def _rows(self) -> list[tuple[str, ...]]:
        rows = [("without", "amplitude", "frequency", "may miss", "source", "work", "in the study")]
        for e in self.effects:
            changes = percent(e.amplitude_change, True), percent(e.frequency_change, True)
            state = f"{'on' if e.on else 'off'}: {e.verdict}" + (
                f" ({e.reason})" if e.reason else ""
            )
            missed = percent(e.uncertainty) if e.source == "estimated" else ""
            rows.append((e.name, *changes, missed, e.source, f"{e.work:.2f}", state))
        changes = percent(self.amplitude_change, True), percent(self.frequency_change, True)
        return [*rows, ("all left out", *changes, "", "computed", f"{self.work:.2f}", "")]


@one_thread
def effect_significance(
    problem: Problem,
    preload: float,
    frequency: tuple[float, float],
    *,
    against: Effects | None = None,
    tolerance: float = 0.01,
    progress: bool | None = None,
) -> EffectSignificance:
    """See :meth:`bdamper.Study.effect_significance`."""
    preload, frequency = problem.check_preload(preload), validation.interval("frequency", frequency)
    tolerance = validation.number("tolerance", tolerance, above=0.0, below=1.0)
    check_question(problem, [preload], frequency)
    present = Effects.of(problem)
    effects = (
        fullest(problem) if against is None else validation.instance("against", against, Effects)
    )
    names, rows = parts(problem, effects), list[EffectRow]()
    with progress_stages(shows_progress(progress), "effect significance", "step") as report:
        report("all effects", 0, len(names) + 2)
        reference = _Reference(problem.replace(**effects), effects, preload, frequency)
        for i, name in enumerate(names, 1):
            report(f"without {name}", i, len(names) + 2)
            rows.append(reference.row(name, present, tolerance))
        rows.sort(key=lambda row: -row.size)
        report("without all omitted effects", len(names) + 1, len(names) + 2)
        rows, (amplitude, change) = _chosen(reference, rows, tolerance)
    significant = reduce(
        Effects.without, (row.name for row in rows if not row.significant), effects
    )
    whole = reference.curve
    notes = (
        ()
        if whole.complete
        else (f"the curve with all effects ended as: {whole.status} ({whole.reason})",)
    )
    work = _work(problem.replace(**significant).system(preload)) / reference.work
    return EffectSignificance(
        preload, frequency, tolerance, whole.peak.amplitude, whole.peak.frequency, tuple(rows), effects, significant,
        amplitude, change, work, notes,
    )  # fmt: skip


class _Reference:
    """Study with all effects, and its highest peak."""

    def __init__(
        self, problem: Problem, effects: Effects, preload: float, frequency: tuple[float, float]
    ) -> None:
        self.problem, self.effects, self.preload = problem, effects, preload
        self.curve = whole_curve(problem, preload, frequency)
        self.tops = Tops.of(problem, self.curve)
        self.work = _work(problem.system(preload))

    def row(self, name: str, present: Effects, tolerance: float) -> EffectRow:
        """Return the change of the peak without one effect; compute it if the estimate exceeds the tolerance."""
        on = present.without(name) != present
        leaner = self.problem.replace(**self.effects.without(name))
        if not leaner.static(self.preload).converged:
            return EffectRow(name, on, *Change()[:3], "unknown", np.nan, reason="no static state")
        system, change, source = leaner.system(self.preload), Change(), "estimated"
        peak = self.curve.peak
        if free_motions(leaner, self.preload) > free_motions(self.problem, self.preload):
            change, source = self.computed(leaner), "computed"
        elif not peak.corner:  # the estimate needs a stationary amplitude
            change = estimate_change(system, embed(self.problem, leaner, self.preload, peak.y))
        if source == "estimated" and change.size > tolerance:
            change, source = self.computed(leaner, True), "computed"
        source, why = (source, "") if change.known else ("unknown", change.how)
        return EffectRow(name, on, *change[:3], source, _work(system) / self.work, reason=why)

    def computed(self, leaner: Problem, by_newton: bool = False) -> Change:
        """Compute the change of the highest peak from the reference to another study, see :func:`compare`."""
        return compare(self.problem, leaner, self.preload, self.tops, by_newton)


def _chosen(
    reference: _Reference, rows: list[EffectRow], tolerance: float
) -> tuple[list[EffectRow], tuple[float, float]]:
    """Select the effects that can be omitted together.

    Return the rows with the selection, and the computed change of amplitude and frequency without the omitted effects.
    """
    taken_back = {
        row.name: reason
        for row in rows
        if (reason := _contains_more(reference.effects, row, rows, tolerance))
    }
    worth = 0.98  # relative work above which the omission of an effect saves nothing
    while True:
        effects, total, out = reference.effects, 0.0, dict[str, EffectRow]()
        for row in sorted(rows, key=lambda row: row.work):
            fits = row.name not in taken_back and total + row.size <= tolerance
            if fits and (row.work < worth or not row.on) and effects.without(row.name) != effects:
                effects, total = effects.without(row.name), total + row.size
                out[row.name] = row
        change = 0.0, 0.0
        if out:
            try:
                change = reference.computed(reference.problem.replace(**effects))[:2]
            except BdamperError:
                change = np.inf, np.inf
        if max(map(abs, change)) <= tolerance:  # false if the change is unknown
            break
        taken_back[max(out.values(), key=lambda row: row.size).name] = (
            "changes more together with others"
        )
    marked = []
    for row in rows:
        covered = (
            effects.without(row.name) == effects
        )  # omitted, alone or with an effect that contains it
        reason = row.reason or taken_back.get(row.name, "")
        if not covered and not reason and row.size <= tolerance:
            reason = "saves nothing" if row.work >= worth else "the sum would exceed the tolerance"
        marked.append(replace(row, significant=not covered, reason="" if covered else reason))
    return marked, change


def _contains_more(
    effects: Effects, row: EffectRow, rows: list[EffectRow], tolerance: float
) -> str:
    """Return the name of another significant effect that is omitted together with this one, as "contains ...", or "".

    The changes by the two effects may cancel by chance, so a small total change does not show that both are insignificant.
    """
    without = effects.without(row.name)
    large = (other.name for other in rows if other is not row and other.size > tolerance)
    return next((f"contains {name}" for name in large if without.without(name) == without), "")


def free_motions(problem: Problem, preload: float) -> int:
    """Return the number of motions of the mean that neither modes nor closed contacts resist, except by friction."""
    sector = problem.at(preload).sector
    basis, points = sector.bases[0], sector.points
    n = len(basis.omega2)
    if n == 0:
        return 0
    contacts = np.zeros((len(points.kn), 3))
    contacts[:, 2] = points.kn
    # bonded points do not slip
    bonded = points.law == LAW_BONDED
    contacts[bonded, :2] = points.kt[bonded]
    springs_at = (sector.spring_bases or sector.bases)[0].G
    stiffness = np.diag(basis.omega2)
    for k, at in ((contacts, basis.G), (sector.springs, springs_at)):
        rows = at.real.reshape(-1, n)
        stiffness = stiffness + rows.T @ (np.broadcast_to(k, at.shape[:2]).reshape(-1, 1) * rows)
    # coordinates have different units and stiffnesses
    diagonal = np.diag(stiffness)
    size = np.sqrt(np.maximum(diagonal, 1e-12 * diagonal.max()))
    resistance = np.linalg.eigvalsh(stiffness / np.outer(size, size))
    # in the reference models a held motion has at least 5e-4, a free one 1e-17
    return int(np.count_nonzero(resistance < 1e-9))


def _work(system: Equations) -> float:
    """Return the number of operations of a Newton iteration, which does not depend on the machine."""
    return float(system.work[:3].sum())


def fullest(problem: Problem) -> Effects:
    """Return all effects that the model of a study allows: three harmonics if it has their modes, two elastic damper
    modes.

    The number of blade modes does not change; :mod:`bdamper.analyses.error_estimates` estimates the effect of more modes.
    """
    present = Effects.of(problem)
    most = 1
    most_harmonics = 3  # five harmonics would take some five times as long
    for l in range(2, most_harmonics + 1):
        try:
            problem.coupling.basis(l)
        except SettingError:
            break
        most = l
    numbers = tuple(sorted({*harmonic_numbers(present["harmonics"]), *range(1, most + 1)}))
    on: dict[str, Any] = {
        name: not off for settings in OFF.values() for name, off in settings.items()
    }
    harmonics = len(numbers) if numbers[-1] == len(numbers) else numbers
    least = min(2, problem.settings.most_modes("free"))
    modes = {name: max(n, least) for name, n in problem.settings.by_body("damper_modes").items()}
    damper_modes: Any = (
        modes
        if isinstance(present["damper_modes"], Mapping)
        else max(present["damper_modes"], least)
    )
    on |= {
        "harmonics": harmonics,
        "damper_modes": damper_modes,
        "rigid_modes": RIGID_NAMES,
        "contact_points": None,
    }
    return Effects(present | on)


def parts(problem: Problem, effects: Effects) -> list[str]:
    """Return the names of all active effects that :meth:`Effects.without` can remove one by one."""
    points = problem.settings.most_points
    points = min(points, effects["contact_points"] or points)
    names = ["bias", "variable normal load", "separation"]
    names += [
        f"harmonics beyond {l}" for l in (1, 3) if l >= max(problem.settings.excited)
    ]  # excited ones are needed
    if problem.model.n_blades > 1:
        names.append("harmonic nodal diameters")
    if any(face.kind == "constraint" for face in problem.model.interfaces.values()):
        names.append("constraint planes")
    if any(body.kind == "free" for body in problem.model.bodies.values()):
        loaded = any(body.load is not None for body in problem.model.bodies.values())
        names += [
            motion for motion in MOTIONS if not (loaded and motion == "translation Y")
        ]  # along the preload
        names.append("damper modes beyond 0")
    modes = effects["blade_modes"]
    blades = any(body.kind == "constrained" for body in problem.model.bodies.values())
    names += [f"blade modes beyond {modes // 2}"] if blades and modes > 1 else []
    names += [f"contact points beyond {points // 2}"] if points > 1 else []
    return [name for name in names if effects.without(name) != effects]
