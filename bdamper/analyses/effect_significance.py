"""Selection of the physical effects that change a peak significantly.

The *reference* is the study with all effects that its model allows. The analysis computes the
change of the highest peak of the reference without each effect, and the work saved.

1. The peak is embedded in the study without the effect; one adjoint solution estimates the change
   (:mod:`bdamper.analyses.error_estimates`). If the omission of an effect frees a direction of
   motion, the mean position may drift away from the peak. Such an effect has no estimate, and the
   complete curve without it is computed.
2. If the estimate with its uncertainty exceeds the tolerance, Newton's method continues from the
   peak. If this fails or the peak changes much, the complete curve without the effect is computed.
   If this fails too, the change is unknown and the effect is significant.
3. Effects are omitted one after the other, in order of the work saved, as long as the sum of their
   changes is within the tolerance. Together they may change the peak by more than the sum.
   Therefore the peak without all of them is computed and compared with the reference. As long as
   the difference exceeds the tolerance, the effect with the largest change is restored.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
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
from bdamper.util.display import Plottable, Result
from bdamper.util.errors import BdamperError, SettingError
from bdamper.util.formatting import amount, percent, sentence, short_repr
from bdamper.util.progress import one_thread, progress_stages, shows_progress
from bdamper.util.statement import Row, Statement
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
        """Largest relative change of amplitude or frequency plus the uncertainty.

        It is infinite if unknown.
        """
        return Change(self.amplitude_change, self.frequency_change, self.uncertainty).size

    @property
    def verdict(self) -> str:
        """Recommended action for the effect in the study."""
        if self.on:
            return "keep" if self.significant else "leave out"
        return "switch on" if self.significant else "stays off"


@short_repr
@dataclass(frozen=True)
class EffectSignificance(Result, Plottable, Tabular, Storable, kind="bdamper-effect-significance"):
    """Change of the peak without each effect, and the significant effects.

    ``plot`` draws bars of the changes (:func:`bdamper.plot.plot_effect_significance`).

    Parameters
    ----------
    preload : float, N
    interval : (low, high), Hz
        Search interval of the highest peak.
    tolerance : float
        Allowed relative change of amplitude or frequency of the highest peak by all omitted effects
        together.
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
    def negligible(self) -> tuple[str, ...]:
        """Names of the effects that are not significant."""
        return tuple(e.name for e in self.effects if not e.significant)

    def _statement(self) -> Statement:
        n = len(self.effects)
        n_kept = n - len(self.negligible)
        verdict = f"Keep {n_kept} of {n} effects" if self.negligible else f"Keep all {n} effects"
        rows = []
        if self.negligible:
            rows = [
                Row("Omitted effects", str(n - n_kept), ", ".join(self.negligible)),
                Row(
                    "Change in peak",
                    percent(self.amplitude_change, sign=True),
                    "without all of them",
                ),
                Row("Computing effort", f"{self.work:.2g}", "relative to all effects"),
            ]
        small = [e for e in self.effects if e.significant and e.size <= self.tolerance]
        if small:
            reasons = ", ".join(f"{effect.name} ({effect.reason})" for effect in small)
            rows.append(Row("Kept although small", str(len(small)), reasons))
        subject = f"preload {amount(self.preload, 'N')}, tolerance {percent(self.tolerance)}"
        remarks = [sentence(note) for note in self.notes]
        return Statement([f"{verdict}: {subject}"], rows, remarks=remarks, table=self._rows())

    def _rows(self) -> list[tuple[str, ...]]:
        rows: list[tuple[str, ...]] = []
        rows.append(
            (
                "Effect omitted",
                "Amplitude",
                "Frequency",
                "Uncertainty",
                "Method",
                "Relative effort",
                "In the study",
            )
        )
        for effect in self.effects:
            state = f"{'on' if effect.on else 'off'}: {effect.verdict}"
            if effect.reason:
                state += f" ({effect.reason})"
            row = (
                effect.name,
                percent(effect.amplitude_change, sign=True),
                percent(effect.frequency_change, sign=True),
                percent(effect.uncertainty) if effect.source == "estimated" else "",
                effect.source,
                f"{effect.work:.2f}",
                state,
            )
            rows.append(row)
        if self.negligible:
            amplitude = percent(self.amplitude_change, sign=True)
            frequency = percent(self.frequency_change, sign=True)
            rows.append(
                ("all omitted", amplitude, frequency, "", "computed", f"{self.work:.2f}", "")
            )
        return rows


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
    preload = problem.check_preload(preload)
    frequency = validation.interval("frequency", frequency)
    tolerance = validation.number("tolerance", tolerance, above=0.0, below=1.0)
    check_question(problem, [preload], frequency)
    present = Effects.of(problem)
    if against is None:
        effects = fullest(problem)
    else:
        effects = validation.instance("against", against, Effects)
    names = parts(problem, effects)
    n_steps = len(names) + 2
    rows: list[EffectRow] = []
    with progress_stages(shows_progress(progress), "effect significance", "step") as report:
        report("all effects", 0, n_steps)
        reference = _Reference(problem.replace(**effects), effects, preload, frequency)
        for i, name in enumerate(names, 1):
            report(f"without {name}", i, n_steps)
            rows.append(reference.row(name, present, tolerance))
        rows.sort(key=lambda row: -row.size)
        report("without all omitted effects", n_steps - 1, n_steps)
        rows, (amplitude, change) = _chosen(reference, rows, tolerance)
    significant = effects
    for row in rows:
        if not row.significant:
            significant = significant.without(row.name)
    curve = reference.curve
    notes: tuple[str, ...] = ()
    if not curve.complete:
        notes = (f"the curve with all effects ended as: {curve.status} ({curve.reason})",)
    return EffectSignificance(
        preload=preload,
        interval=frequency,
        tolerance=tolerance,
        amplitude=curve.peak.amplitude,
        frequency=curve.peak.frequency,
        effects=tuple(rows),
        reference=effects,
        significant=significant,
        amplitude_change=amplitude,
        frequency_change=change,
        work=_work(problem.replace(**significant).system(preload)) / reference.work,
        notes=notes,
    )


class _Reference:
    """Study with all effects, and its highest peak."""

    def __init__(
        self, problem: Problem, effects: Effects, preload: float, frequency: tuple[float, float]
    ) -> None:
        self.problem = problem
        self.effects = effects
        self.preload = preload
        self.curve = whole_curve(problem, preload, frequency)
        self.tops = Tops.of(problem, self.curve)
        self.work = _work(problem.system(preload))

    def row(self, name: str, present: Effects, tolerance: float) -> EffectRow:
        """Return the change of the peak without one effect.

        It is computed if the estimate exceeds the tolerance.
        """
        on = present.without(name) != present
        leaner = self.problem.replace(**self.effects.without(name))
        if not leaner.static(self.preload).ok:
            return self._as_row(
                name, on, Change(), source="unknown", work=np.nan, reason="no static state"
            )
        system = leaner.system(self.preload)
        peak = self.curve.peak
        if free_motions(leaner, self.preload) > free_motions(self.problem, self.preload):
            change = self.computed(leaner)
            source = "computed"
        else:
            change = Change()
            # the estimate needs a stationary amplitude
            if not peak.corner:
                change = estimate_change(system, embed(self.problem, leaner, self.preload, peak.y))
            source = "estimated"
            if change.size > tolerance:
                change = self.computed(leaner, by_newton=True)
                source = "computed"
        reason = ""
        if not change.known:
            source = "unknown"
            reason = change.how
        work = _work(system) / self.work
        return self._as_row(name, on, change, source=source, work=work, reason=reason)

    @staticmethod
    def _as_row(
        name: str, on: bool, change: Change, *, source: str, work: float, reason: str
    ) -> EffectRow:
        return EffectRow(
            name=name,
            on=on,
            amplitude_change=change.amplitude,
            frequency_change=change.frequency,
            uncertainty=change.uncertainty,
            source=source,
            work=work,
            reason=reason,
        )

    def computed(self, leaner: Problem, by_newton: bool = False) -> Change:
        """Compute the change of the highest peak to another study, see :func:`compare`."""
        return compare(self.problem, leaner, self.preload, self.tops, by_newton)


SAVES_NOTHING = 0.98
"""Relative work above which the omission of an effect saves nothing."""


def _chosen(
    reference: _Reference, rows: list[EffectRow], tolerance: float
) -> tuple[list[EffectRow], tuple[float, float]]:
    """Select the effects that can be omitted together.

    Return the rows with the selection, and the computed change of amplitude and frequency without
    the omitted effects.
    """
    # reasons to keep effects with a small change
    kept = {}
    for row in rows:
        reason = _contains_more(reference.effects, row, rows, tolerance)
        if reason:
            kept[row.name] = reason
    while True:
        effects, omitted = _omitted(reference.effects, rows, kept, tolerance)
        change = 0.0, 0.0
        if omitted:
            try:
                change = reference.computed(reference.problem.replace(**effects))[:2]
            except BdamperError:
                change = np.inf, np.inf
        if max(map(abs, change)) <= tolerance:  # false if the change is unknown
            break
        largest = max(omitted, key=lambda row: row.size)
        kept[largest.name] = "the change is larger together with other effects"
    marked = []
    for row in rows:
        # omitted, alone or with an effect that contains it
        if effects.without(row.name) == effects:
            marked.append(replace(row, significant=False, reason=""))
            continue
        reason = row.reason or kept.get(row.name, "")
        if not reason and row.size <= tolerance:
            if row.work >= SAVES_NOTHING:
                reason = "omitting it saves no time"
            else:
                reason = "the sum of all changes would exceed the tolerance"
        marked.append(replace(row, significant=True, reason=reason))
    return marked, change


def _omitted(
    effects: Effects, rows: list[EffectRow], kept: Mapping[str, str], tolerance: float
) -> tuple[Effects, list[EffectRow]]:
    """Return the remaining effects, and the rows of omitted effects in order of their work.

    The changes of omitted effects add up to the tolerance at most.
    """
    total = 0.0
    omitted = []
    for row in sorted(rows, key=lambda row: row.work):
        if row.name in kept or not total + row.size <= tolerance:
            continue
        if row.on and not row.work < SAVES_NOTHING:
            continue
        remaining = effects.without(row.name)
        # an effect that contains this one may be omitted already
        if remaining == effects:
            continue
        effects = remaining
        total = total + row.size
        omitted.append(row)
    return effects, omitted


def _contains_more(
    effects: Effects, row: EffectRow, rows: list[EffectRow], tolerance: float
) -> str:
    """Return "contains ..." with another significant effect that is omitted together with this one.

    It is empty without such an effect. The changes by the two effects may cancel by chance, so a
    small total change does not show that both are insignificant.
    """
    without = effects.without(row.name)
    for other in rows:
        is_large = other is not row and other.size > tolerance
        if is_large and without.without(other.name) == without:
            return f"contains {other.name}"
    return ""


def free_motions(problem: Problem, preload: float) -> int:
    """Return the number of motions of the mean that only friction resists.

    Neither modes nor closed contacts resist them.
    """
    sector = problem.at(preload).sector
    basis = sector.bases[0]
    points = sector.points
    n = len(basis.omega2)
    if n == 0:
        return 0
    contacts = np.zeros((len(points.kn), 3))
    contacts[:, 2] = points.kn
    # bonded points do not slip
    bonded = points.law == LAW_BONDED
    contacts[bonded, :2] = points.kt[bonded]
    spring_basis = (sector.spring_bases or sector.bases)[0]
    stiffness = np.diag(basis.omega2)
    for springs, G in ((contacts, basis.G), (sector.springs, spring_basis.G)):
        rows = G.real.reshape(-1, n)
        of_rows = np.broadcast_to(springs, G.shape[:2]).reshape(-1, 1)
        stiffness = stiffness + rows.T @ (of_rows * rows)
    # coordinates have different units and stiffnesses
    diagonal = np.diag(stiffness)
    unit = np.sqrt(np.maximum(diagonal, 1e-12 * diagonal.max()))
    resistance = np.linalg.eigvalsh(stiffness / np.outer(unit, unit))
    # in the reference models a held motion has at least 5e-4, a free one 1e-17
    return int(np.count_nonzero(resistance < 1e-9))


def _work(system: Equations) -> float:
    """Return the number of operations of a Newton iteration, on any machine."""
    return float(system.work[:3].sum())


def fullest(problem: Problem) -> Effects:
    """Return all effects that the model of a study allows.

    They include three harmonics if the model has their modes, and two elastic damper modes. The
    number of blade modes does not change; :mod:`bdamper.analyses.error_estimates` estimates the
    effect of more modes.
    """
    present = Effects.of(problem)
    highest = 1
    most_harmonics = 3  # five harmonics would take some five times as long
    for l in range(2, most_harmonics + 1):
        try:
            problem.coupling.basis(l)
        except SettingError:
            break
        highest = l
    numbers = sorted({*harmonic_numbers(present["harmonics"]), *range(1, highest + 1)})
    # a number means all harmonics up to it
    consecutive = numbers[-1] == len(numbers)
    least_modes = min(2, problem.settings.most_modes("free"))
    damper_modes: Any = present["damper_modes"]
    if isinstance(damper_modes, Mapping):
        by_body = problem.settings.by_body("damper_modes")
        damper_modes = {name: max(n, least_modes) for name, n in by_body.items()}
    else:
        damper_modes = max(damper_modes, least_modes)
    switched_on: dict[str, Any] = {}
    for settings in OFF.values():
        for name, off in settings.items():
            switched_on[name] = not off
    switched_on |= {
        "harmonics": len(numbers) if consecutive else tuple(numbers),
        "damper_modes": damper_modes,
        "rigid_modes": RIGID_NAMES,
        "contact_points": None,
    }
    return Effects(present | switched_on)


def parts(problem: Problem, effects: Effects) -> list[str]:
    """Return the names of all active effects that :meth:`Effects.without` can remove one by one."""
    bodies = problem.model.bodies.values()
    names = ["bias", "variable normal load", "separation"]
    # excited harmonics are needed
    highest_excited = max(problem.settings.excited)
    names += [f"harmonics beyond {l}" for l in (1, 3) if l >= highest_excited]
    if problem.model.n_blades > 1:
        names.append("harmonic nodal diameters")
    if any(face.kind == "constraint" for face in problem.model.interfaces.values()):
        names.append("constraint planes")
    if any(body.kind == "free" for body in bodies):
        # a loaded body moves along the preload
        loaded = any(body.load is not None for body in bodies)
        names += [motion for motion in MOTIONS if not (loaded and motion == "translation Y")]
        names.append("damper modes beyond 0")
    blade_modes = effects["blade_modes"]
    has_blades = any(body.kind == "constrained" for body in bodies)
    if has_blades and blade_modes > 1:
        names.append(f"blade modes beyond {blade_modes // 2}")
    points = problem.settings.most_points
    points = min(points, effects["contact_points"] or points)
    if points > 1:
        names.append(f"contact points beyond {points // 2}")
    return [name for name in names if effects.without(name) != effects]
