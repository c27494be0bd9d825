"""Selection of the physical effects that change a peak significantly.

The *reference* is the study with all effects that its model allows. For each effect, the analysis
computes how much the highest peak of the reference changes without it, and how much work is saved.

1. The peak is embedded in the study without the effect; one adjoint solution estimates the change
   (:mod:`bdamper.analyses.error_estimates`). If the omission of an effect frees a direction of
   motion, the mean position may drift away from the peak. Such an effect has no estimate, and the
   complete curve without it is computed.
2. If the estimate with its uncertainty exceeds the tolerance, Newton's method continues from the
   peak. If this fails or the peak changes considerably, the complete curve without the effect is
   computed. If this fails too, the change is unknown and the effect is significant.
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

from bdamper.analyses.error_estimates import Tops, compare, estimate_change, whole_curve
from bdamper.contact.laws import LAW_BONDED
from bdamper.harmonic_balance.checks import check_question
from bdamper.harmonic_balance.effects import MOTIONS, OFF, Effects, harmonic_numbers
from bdamper.harmonic_balance.equations import Equations
from bdamper.harmonic_balance.problem import Problem
from bdamper.model.kinematics import RIGID_NAMES
from bdamper.response.richer_peak import Change, embed
from bdamper.util import validation
from bdamper.util.display import Plottable, Result
from bdamper.util.errors import BdamperError, SettingError
from bdamper.util.formatting import amount, counted, percent, sentence, short_repr
from bdamper.util.progress import one_thread, progress_stages, shows_progress
from bdamper.util.statement import Row, Statement
from bdamper.util.storage import Storable
from bdamper.util.tables import Column, Tabular, columns_of_rows

PRINTED_NAMES = {
    "bias": "mean position shift (bias)",
    "harmonics beyond 1": "more than 1 harmonic",
    "harmonics beyond 3": "more than 3 harmonics",
}
"""Effects whose printed name differs from that for :meth:`bdamper.Effects.without`."""


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
        Number of operations of a Newton iteration without the effect, relative to the reference.
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
        """Recommendation for this effect in the study."""
        if self.on:
            return "keep" if self.significant else "omit"
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
        Number of operations of a Newton iteration with the significant effects, relative to the
        reference.
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
        return tuple(effect.name for effect in self.effects if not effect.significant)

    def _statement(self) -> Statement:
        verdict = self._advice
        rows = []
        if self.negligible:
            rows = [
                Row("Omitted effects", str(len(self.negligible)), ", ".join(self.negligible)),
                Row(
                    "Change in peak",
                    percent(self.amplitude_change, sign=True),
                    "without all of them",
                ),
                Row("Computing effort", f"{self.work:.2g}", "relative to all effects"),
            ]
        # for these the reason is not the size of the change
        small_but_kept = [
            effect
            for effect in self.effects
            if effect.significant and effect.size <= self.tolerance
        ]
        for i, effect in enumerate(small_but_kept):
            name = PRINTED_NAMES.get(effect.name, effect.name)
            rows.append(Row("" if i else "Small but kept", name, effect.reason))
        subject = f"preload {amount(self.preload, 'N')}, tolerance {percent(self.tolerance)}"
        remarks = [
            "Each row omits one effect: change of amplitude, change of frequency, and effort relative "
            f"to the computation with all {counted(len(self.effects), 'effect')}"
        ]
        remarks += [sentence(note) for note in self.notes]
        return Statement([f"{verdict}: {subject}"], rows, remarks=remarks, table=self._rows())

    @property
    def _advice(self) -> str:
        """Numbers of effects to keep, to switch on, to omit, and to leave off."""
        verdicts = [effect.verdict for effect in self.effects]
        parts = []
        n_kept = verdicts.count("keep")
        if n_kept:
            parts.append(f"keep {counted(n_kept, 'effect')}")
        for verdict, words in (
            ("switch on", "switch on"),
            ("omit", "omit"),
            ("stays off", "leave off"),
        ):
            if verdict in verdicts:
                parts.append(f"{words} {verdicts.count(verdict)}")
        return sentence(", ".join(parts))

    def _rows(self) -> list[tuple[str, ...]]:
        """Return the printed table: its head, and a row for each effect and for all omitted ones."""
        rows: list[tuple[str, ...]] = []
        rows.append(
            (
                "Effect omitted",
                "Amplitude",
                "Frequency",
                "Method",
                "Effort",
                "In study",
                "Advice",
            )
        )
        for effect in self.effects:
            method = effect.source
            # a computed change has no uncertainty
            uncertainty = percent(effect.uncertainty)
            if method == "estimated" and uncertainty != "0 %":
                method += f", ± {uncertainty}"
            row = (
                PRINTED_NAMES.get(effect.name, effect.name),
                percent(effect.amplitude_change, sign=True),
                percent(effect.frequency_change, sign=True),
                method,
                f"{effect.work:.2f}",
                "on" if effect.on else "off",
                effect.verdict,
            )
            rows.append(row)
        if self.negligible:
            amplitude = percent(self.amplitude_change, sign=True)
            frequency = percent(self.frequency_change, sign=True)
            rows.append(
                ("all omitted", amplitude, frequency, "computed", f"{self.work:.2f}", "", "")
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
        rows, changes = _chosen(reference, rows, tolerance)
    amplitude_change, frequency_change = changes
    significant = effects
    for row in rows:
        if not row.significant:
            significant = significant.without(row.name)
    curve = reference.curve
    notes: tuple[str, ...] = ()
    if not curve.complete:
        notes = (f"the curve with all effects is {curve.status} ({curve.reason})",)
    return EffectSignificance(
        preload=preload,
        interval=frequency,
        tolerance=tolerance,
        amplitude=curve.peak.amplitude,
        frequency=curve.peak.frequency,
        effects=tuple(rows),
        reference=effects,
        significant=significant,
        amplitude_change=amplitude_change,
        frequency_change=frequency_change,
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
        # the study has an effect if its settings differ without it
        on = present.without(name) != present
        leaner = self.problem.replace(**self.effects.without(name))
        if not leaner.static(self.preload).ok:
            return self._as_row(
                name, on, Change(), source="unknown", work=np.nan, reason="no static state"
            )
        system = leaner.system(self.preload)
        peak = self.curve.peak
        # a mean that is no longer held may drift away from the peak, which then gives no estimate
        n_free = free_motions(leaner, self.preload)
        if n_free > free_motions(self.problem, self.preload):
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
        """Compute the change of the highest peak to another study, see :func:`compare`.

        After a large fall by Newton's method the complete curve follows.
        """
        change = compare(self.problem, leaner, self.preload, self.tops, by_newton)
        if by_newton and change.amplitude < -LARGE_FALL:
            change = compare(self.problem, leaner, self.preload, self.tops)
        return change


LARGE_FALL = 0.1
"""Relative fall of a peak without an effect from which another peak may be higher.

On a small wedge the peak falls by 18 % without a rotation of the damper, and the highest point of
the complete curve by 12 %.
"""
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
        remaining, omitted = _omitted(reference.effects, rows, kept, tolerance)
        amplitude_change, frequency_change = 0.0, 0.0
        if omitted:
            try:
                change = reference.computed(reference.problem.replace(**remaining))
                amplitude_change, frequency_change = change.amplitude, change.frequency
            except BdamperError:
                amplitude_change, frequency_change = np.inf, np.inf
        # false if the change is unknown (NaN)
        if max(abs(amplitude_change), abs(frequency_change)) <= tolerance:
            break
        largest = max(omitted, key=lambda row: row.size)
        kept[largest.name] = "the change is larger together with other effects"
    marked = []
    for row in rows:
        # the effect is absent: omitted alone, or with an effect that contains it
        if remaining.without(row.name) == remaining:
            marked.append(replace(row, significant=False, reason=""))
            continue
        reason = row.reason or kept.get(row.name, "")
        if not reason and row.size <= tolerance:
            if row.work >= SAVES_NOTHING:
                reason = "omitting it saves no time"
            else:
                reason = "the sum of all changes would exceed the tolerance"
        marked.append(replace(row, significant=True, reason=reason))
    return marked, (amplitude_change, frequency_change)


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
        # an effect of the study stays if its omission saves nothing; others need not be added
        if row.on and not row.work < SAVES_NOTHING:
            continue
        remaining = effects.without(row.name)
        # an effect that contains this one may be omitted already
        if remaining == effects:
            continue
        effects = remaining
        total += row.size
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
    """Return the number of rigid-body motions of the mean that only friction resists.

    Neither modes nor closed contacts resist them.
    """
    sector = problem.at(preload).sector
    # the mean is harmonic 0
    basis = sector.bases[0]
    spring_basis = (sector.spring_bases or sector.bases)[0]
    points = sector.points
    n_modes = len(basis.omega2)
    if n_modes == 0:
        return 0
    # springs (n_points, 3) along t1, t2 and n that hold without friction: all normal ones, and the
    # tangential ones of bonded points, which do not slip
    contacts = np.zeros((len(points.kn), 3))
    contacts[:, 2] = points.kn
    bonded = points.law == LAW_BONDED
    contacts[bonded, :2] = points.kt[bonded]
    stiffness = np.diag(basis.omega2)
    for springs, motion in ((contacts, basis.G), (sector.springs, spring_basis.G)):
        # motion of the points (3 n_points, n_modes), and the spring of each of its rows
        rows = motion.real.reshape(-1, n_modes)
        spring_of_row = np.broadcast_to(springs, motion.shape[:2]).reshape(-1, 1)
        stiffness = stiffness + rows.T @ (spring_of_row * rows)
    # coordinates have different units and stiffnesses: scale to a unit diagonal
    diagonal = np.diag(stiffness)
    unit = np.sqrt(np.maximum(diagonal, 1e-12 * diagonal.max()))
    resistance = np.linalg.eigvalsh(stiffness / np.outer(unit, unit))
    # in the reference models a held motion has at least 5e-4, a free one 1e-17
    return int(np.count_nonzero(resistance < 1e-9))


def _work(system: Equations) -> float:
    """Return the number of operations of a Newton iteration in millions, on any machine."""
    evaluation, jacobian, factorisation, _ = system.work
    return float(evaluation + jacobian + factorisation)


def fullest(problem: Problem) -> Effects:
    """Return all effects that the model of a study allows.

    They include three harmonics if the model has their modes, and two elastic damper modes. The
    number of blade modes does not change; :mod:`bdamper.analyses.error_estimates` estimates the
    effect of more modes.
    """
    present = Effects.of(problem)
    # highest harmonic for whose nodal diameter the model has modes
    highest = 1
    most_harmonics = 3  # five harmonics would take some five times as long
    for harmonic in range(2, most_harmonics + 1):
        try:
            problem.coupling.basis(harmonic)
        except SettingError:
            break
        highest = harmonic
    numbers = sorted({*harmonic_numbers(present["harmonics"]), *range(1, highest + 1)})
    # the setting is their number if there are no gaps, otherwise it lists them
    has_no_gap = numbers[-1] == len(numbers)
    harmonics = len(numbers) if has_no_gap else tuple(numbers)
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
        "harmonics": harmonics,
        "damper_modes": damper_modes,
        "rigid_modes": RIGID_NAMES,
        "contact_points": None,
    }
    return Effects(present | switched_on)


def parts(problem: Problem, effects: Effects) -> list[str]:
    """Return the names of all active effects that :meth:`Effects.without` can remove one by one.

    Large numbers of modes and contact points are halved.
    """
    bodies = problem.model.bodies.values()
    names = ["bias", "variable normal load", "separation"]
    # excited harmonics are needed
    highest_excited = max(problem.settings.excited)
    names += [f"harmonics beyond {highest}" for highest in (1, 3) if highest >= highest_excited]
    if problem.model.n_blades > 1:
        names.append("harmonic nodal diameters")
    if any(face.kind == "constraint" for face in problem.model.interfaces.values()):
        names.append("constraint planes")
    if any(body.kind == "free" for body in bodies):
        # a loaded body must move along the preload, its Y axis
        loaded = any(body.load is not None for body in bodies)
        for motion in MOTIONS:
            if not (loaded and motion == "translation Y"):
                names.append(motion)
        names.append("damper modes beyond 0")
    blade_modes = effects["blade_modes"]
    has_blades = any(body.kind == "constrained" for body in bodies)
    if has_blades and blade_modes > 1:
        names.append(f"blade modes beyond {blade_modes // 2}")
    # None means all points of a face
    points_of_model = problem.settings.most_points
    points = min(points_of_model, effects["contact_points"] or points_of_model)
    if points > 1:
        names.append(f"contact points beyond {points // 2}")
    return [name for name in names if effects.without(name) != effects]
