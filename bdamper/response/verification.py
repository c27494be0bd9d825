"""Results of the checks of a solution: time integration, more harmonics, error estimates."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bdamper.harmonic_balance.subject import about, has_more_points
from bdamper.response.motion_range import exceeds
from bdamper.response.peak import half_range_row
from bdamper.response.peak_error import HarmonicPeak, SourceError
from bdamper.util import validation
from bdamper.util.display import Fact, Plottable, Result, draw
from bdamper.util.errors import COMPLETE, INCOMPLETE, INTERRUPTED, WithStatus
from bdamper.util.formatting import (
    amount,
    counted,
    extent,
    listed,
    peak_text,
    percent,
    same_digits,
    sentence,
    short_repr,
    span,
)
from bdamper.util.progress import Cost
from bdamper.util.records import Data, Reason, Record
from bdamper.util.statement import Row, Statement
from bdamper.util.storage import FilePath, Recorded, Storable
from bdamper.util.tables import (
    ROW,
    Amplitude,
    Column,
    Cycles,
    Metre,
    Newton,
    Numbers,
    Quantity,
    Second,
    Tabular,
    columns_of_rows,
)

# ---- response in time ----


ALIKE = 0.05
"""Relative difference of the mean amplitudes of two blades below which they vibrate equally.  Also
the amplitude relative to the largest wave below which waves are not listed.
"""
BEATS = 0.1
"""Excess of the highest period over the mean amplitude from which the headline names it."""
TO_ITS_END = "run the time integration to its end"
"""Remedy for a time integration that was interrupted, which has refuted nothing."""


def energy_shares(energy: tuple[float, ...]) -> tuple[float, NDArray]:
    """Return the energy (J) supplied in a period, and the fractions of it that are dissipated or
    stored.

    The fractions are damping, contacts, increase of kinetic and strain energy, and error of the
    time steps.

    The supplied energy is the work of the excitation plus all contributions that release energy,
    because the work alone may be close to zero far from a resonance.
    """
    work, *damping_contacts_rise = energy
    numerical = work - sum(damping_contacts_rise)
    taken = np.array([*damping_contacts_rise, numerical])
    # a negative loss supplies energy
    given = -taken[taken < 0.0].sum()
    supplied = max(work, 0.0) + given
    return float(supplied), taken / max(supplied, 1e-300)


def energy_change(energy: tuple[float, ...]) -> str:
    """Return a text if kinetic and strain energy change by a fifth of the supplied energy, or ""."""
    _, (_, _, rise, _) = energy_shares(energy)
    if abs(rise) <= 0.2:
        return ""
    change = f"{percent(rise, sign=True)} of the energy of a period"
    return f"its stored energy changes by {change}; use more periods"


TOO_FEW = "too few periods"
"""End of the reason for a verdict that requires more periods."""


class AllBlades(Result):
    """Base class of time integrations: blades, energy per period, and travelling waves."""

    blade: int
    blades: NDArray
    waves: NDArray
    energy: tuple[float, ...]

    @property
    def spread(self) -> tuple[float, float]:
        """Smallest and largest mean amplitude of the blades, m; NaN without time integration."""
        mean = self.blades.mean(axis=0) if self.blades.size else np.full(1, np.nan)
        return float(mean.min()), float(mean.max())

    @property
    def blades_differ(self) -> bool:
        """Whether identical blades vibrate with different amplitudes, the same blades with large
        amplitudes in both halves.
        """
        n_periods, n_waves = len(self.blades), len(self.waves)
        if n_waves < 2 or n_periods < 2:
            return False
        low, high = self.spread
        if not high > (1.0 + ALIKE) * low:
            return False
        first_half, second_half = np.array_split(self.blades, 2)
        correlation = np.corrcoef(first_half.mean(axis=0), second_half.mean(axis=0))[0, 1]
        # smallest correlation of the blade amplitudes at which the same blades are high
        same = 0.8
        return bool(correlation > same)

    @property
    def numerical_loss(self) -> float:
        """Error of the energy balance of a period, relative to the supplied energy; NaN without
        time integration.
        """
        if not self.energy:
            return float("nan")
        _, (_, _, _, numerical) = energy_shares(self.energy)
        return float(numerical)

    def _unlike_rows(self) -> list[Row]:
        """Return the row of the smallest and largest amplitude if identical blades vibrate differently."""
        if not self.blades_differ:
            return []
        return [Row("Different blades", span(*self.spread, "m"), "lowest to highest, means")]

    def _facts(self) -> tuple[Fact, ...]:
        """Return the most important values, the energy balance of a period and the waves."""
        facts: list[Fact] = []
        # blades of a mistuned disk have numbers, identical blades have waves
        if self.blades.size and not self.waves.size:
            facts.append(Fact("blade", self.blade))
        facts += super()._facts()
        if self.energy:
            supplied, shares = energy_shares(self.energy)
            takers = ("damping", "contacts", "rise", "numerical")
            listed = ", ".join(f"{name} {percent(x)}" for name, x in zip(takers, shares))
            facts.append(Fact("energy of a period", f"{amount(supplied, 'J')}: {listed}"))
        if len(self.waves) > 1:
            facts.append(Fact("lowest to highest blade", span(*self.spread, "m")))
            facts.append(Fact("waves, nodal diameters", self._wave_text()))
        return tuple(facts)

    def _wave_text(self) -> str:
        """Return nodal diameter, direction and amplitude of all waves that are not small."""
        largest = self.waves[0, 1]
        texts = []
        for diameter, amplitude in self.waves:
            if amplitude > ALIKE * largest:
                direction = "backward" if diameter < 0 else "forward"
                texts.append(f"{abs(diameter):.0f} {direction} {amount(float(amplitude), 'm')}")
        return ", ".join(texts)


@short_repr
@dataclass(frozen=True)
class TimeResponse(AllBlades, Plottable, Recorded, Storable, kind="bdamper-time-response"):
    """Highest steady-state amplitude near a resonance by time integration, with its error range.

    ``plot`` draws the amplitudes of all blades (:func:`bdamper.plot.plot_blades`).

    Parameters
    ----------
    mean : float, m
        Amplitude of the first harmonic of the blade with the largest amplitude, averaged over
        periods.
    lowest, highest : float, m
        Range of the mean: all ``answers`` and higher ``starts``, widened by the remaining change of
        a settled motion or the standard deviation of its periods.  It contains ``highest_period``.
    frequency, preload : float, Hz, N
    balance : float, m
        Amplitude of the highest peak by harmonic balance.
    highest_period : float, m
        Highest amplitude of a single period in all ``answers``.
    jump_frequency : float, Hz
        Frequency at which the motion jumps to another amplitude, the one closest to the highest
        motion; NaN if there is none.
    structure : str
        Modes in the response curve and in the time integration.
    periods : int
        Total number of periods.
    diameters : tuple of int
        Nodal diameters of the model.
    status : str
        "complete", "interrupted", "incomplete" or "not found".
    reason : str
        Reason for the status.  It begins with "not settled" if two of the ``answers``, or one of
        them and a higher one of the ``starts``, differ by more than 5 %.
    cost : Cost
    blade : int
        Blade with the largest amplitude.
    blades : (n_periods, n_blades) float, m
        Amplitudes of all blades in the last periods.
    waves : (n_blades, 2) float
        Nodal diameters and amplitudes (m) of the travelling waves of the motion, in descending
        order.  A wave against the direction of the excitation has a negative nodal diameter.
    answers : dict of str to float, m
        Mean amplitude of the blade with the largest amplitude with n, 2n and 4n time steps, in a
        more detailed structure, and at ``jump_frequency``.
    starts : dict of str to float, m
        Mean amplitude reached from different initial states.
    energy : tuple of four float, J
        Energies of all blades in a period: work of the excitation, energy dissipated by damping,
        energy dissipated by the contacts, and increase of kinetic and strain energy.
    growth : float
        Growth rate per period of the motion in waves other than the excited one; negative if this
        motion decays, NaN if it is too small.
    half_range : float, m
        Half of the peak-to-peak response of the blade with the largest amplitude, with the
        harmonics of the study, averaged over periods.
    settings : mapping
    model_hash : str
    """

    mean: Metre
    lowest: Metre
    highest: Metre
    frequency: Cycles
    preload: Newton
    balance: Metre
    highest_period: Metre = float("nan")
    jump_frequency: Annotated[float, Quantity("Hz"), Data(file="fall")] = float("nan")
    structure: str = ""
    periods: int = 0
    diameters: tuple[int, ...] = ()
    status: str = COMPLETE
    reason: Reason = ""
    cost: Cost = field(default_factory=Cost)
    blade: int = -1
    blades: NDArray = field(default_factory=lambda: np.zeros((0, 0)), compare=False)
    waves: NDArray = field(default_factory=lambda: np.zeros((0, 2)), compare=False)
    answers: Annotated[dict[str, float], Quantity("m")] = field(default_factory=dict)
    starts: Annotated[dict[str, float], Quantity("m")] = field(default_factory=dict)
    energy: tuple[float, ...] = ()
    growth: float = field(default=float("nan"), compare=False)
    half_range: Annotated[float, Quantity("m"), Data(derived=True)] = float("nan")
    _summary_fields = (
        "mean",
        "lowest",
        "highest",
        "highest_period",
        "balance",
        "frequency",
        "jump_frequency",
        "preload",
        "structure",
        "diameters",
        "answers",
        "starts",
        "growth",
        "status",
    )

    @property
    def elsewhere(self) -> int:
        """Number of the other initial states that lead to a different motion."""
        return len(self._other_motions)

    @property
    def _other_motions(self) -> list[float]:
        """Amplitudes (m) of different motions that other initial states lead to."""
        return [x for x in self.starts.values() if abs(x / self.mean - 1.0) > ALIKE]

    @property
    def largest(self) -> float:
        """Amplitude (m) to use for the stress: the larger of ``highest`` and ``highest_period``."""
        return float(np.fmax(self.highest, self.highest_period))

    @property
    def factor(self) -> float:
        """Factor on the stress: ratio of the largest amplitude by time integration to the
        harmonic-balance amplitude.
        """
        return self.largest / self.balance

    @property
    def text(self) -> str:
        """Mean and range, "55 µm (53 to 58)".

        If the integrations differ, it is the range only; if nothing was found, it is the status.
        """
        if np.isnan(self.mean):
            return self.status_text
        if "not settled" in self.reason:
            return span(self.lowest, self.highest, "m")
        return f"{amount(self.mean, 'm')} ({_range_without_unit(self)})"

    def mark(self, ax: object, path: FilePath | None = None) -> object:
        """Draw mean and range as a point with a bar on top of response curves.

        The picture is drawn by :func:`bdamper.plot.mark_time_response`.
        """
        return draw(self, "figure", "mark", path, ax)

    def _statement(self) -> Statement:
        subject = about(self.settings, self.preload)
        balance = Row("Harmonic balance", amount(self.balance, "m"), "the highest peak")
        if np.isnan(self.mean):
            reason = self.reason or self.status
            verdict = f"No amplitude by time integration, {reason}{subject}"
            remedy = "Remedy: choose another preload; time integration does not confirm this peak"
            if self.status == INTERRUPTED:
                remedy = f"Remedy: {TO_ITS_END}"
            return Statement([verdict], [balance], remarks=[remedy])
        if self.ok:
            largest = amount(self.largest, "m")
            verdict = f"Highest amplitude by time integration {largest}{subject}"
        else:
            verdict = f"Not for design: the time integration is {self.status_text}{subject}"
        balance = balance._replace(remark=self._change_text)
        rows = [*self._time_rows(), balance, *self._motion_rows()]
        remarks = [f"Not covered: {', '.join(self._open_effects())}"]
        if not self.ok:
            frequency = f"{self.frequency:.6g}"
            remedy = f"examine study.motion_in_time(curve, frequency={frequency}, periods=400)"
            if self.status == INTERRUPTED:
                remedy = TO_ITS_END
            remarks.insert(0, f"Remedy: {remedy}")
        return Statement([verdict], rows, self._check_rows(), remarks)

    @property
    def _change_text(self) -> str:
        """Difference of the mean by time integration from harmonic balance."""
        change = self.mean / self.balance - 1.0
        side = "higher" if change > 0.0 else "lower"
        return f"the mean by time integration is {percent(abs(change))} {side}"

    def _time_rows(self) -> list[Row]:
        """Return the range of the amplitude with its frequency and mean, and single periods."""
        place = amount(self.frequency, "Hz")
        # integrations that differ have no common mean
        if "not settled" not in self.reason:
            place += f", mean {amount(self.mean, 'm')}, range of all runs"
        value = span(self.lowest, self.highest, "m")
        rows = [Row("Time integration", value, place)]
        if self.highest_period > (1.0 + BEATS) * self.mean:
            rows.append(Row("", amount(self.highest_period, "m"), "highest single period"))
        return rows

    def _motion_rows(self) -> list[Row]:
        """Return the blades if they differ, the peak-to-peak motion and a jump."""
        rows = self._unlike_rows()
        if exceeds(self.half_range, self.mean):
            rows.append(half_range_row(self.half_range))
        if not np.isnan(self.jump_frequency):
            rows.append(Row("Jump", amount(self.jump_frequency, "Hz"), "to a lower amplitude"))
        return rows

    def _check_rows(self) -> list[Row]:
        """Return the outcome of the other time steps and structures, and of the other starts."""
        rows = []
        if self.answers:
            outcome = "pass" if self.ok else "FAIL"
            means = extent(min(self.answers.values()), max(self.answers.values()), "m")
            finding = f"mean {means} with {_integrations_text(self.answers)}"
            only_steps = all(name.endswith(" steps") for name in self.answers)
            name = "Time step" if only_steps else "Other integrations"
            rows.append(Row(name, outcome, finding))
        if self.starts:
            outcome = "uncertain" if self.elsewhere else "pass"
            finding = f"{self.elsewhere} of {len(self.starts)} lead to a different motion"
            others = self._other_motions
            if others:
                finding += f", {extent(min(others), max(others), 'm')}"
            rows.append(Row("Other starts", outcome, finding))
        return rows

    def _open_effects(self) -> list[str]:
        effects = ["mistuning", "wear"]
        if has_more_points(self.settings):
            effects.append("more contact points")
        return effects


@short_repr
@dataclass(frozen=True)
class MotionInTime(
    AllBlades, Plottable, Tabular, Recorded, Storable, kind="bdamper-motion-in-time", row="period"
):
    """Motion computed by time integration from a harmonic-balance solution, period by period.

    ``plot`` draws the amplitude of each period (:func:`bdamper.plot.plot_periods`).

    Parameters
    ----------
    mean, lowest, highest : float, m
        Amplitude of the first harmonic of the blade with the largest amplitude: mean, and range of
        single periods. If there is a verdict, they refer to the periods named in its reason,
        otherwise to the second half of the periods.
    frequency, preload : float, Hz, N
    harmonics : (n_periods, n_harmonics + 1) complex, m
        Response amplitudes of the blade with the largest amplitude; the first column is the mean
        position.
    balance : float, m
        Amplitude of the solution at which the motion starts; NaN if it is at another frequency.
    verdict : str
        "agrees", "does not agree" or "undecided": whether the motion stays at its initial solution,
        if examined.
    reason : str
        Reason for the verdict; without a verdict, reason for the status.
    distance : float
        Relative distance of the vibration in the last period from the initial solution.
    repeats_after : int or None
        Number of periods after which the motion repeats: 1 if periodic, None if irregular.
    diameters, status, cost, blade, blades, waves, energy, growth, settings, model_hash
            See :class:`TimeResponse`.
    """

    mean: Metre
    lowest: Metre
    highest: Metre
    frequency: Cycles
    preload: Newton
    harmonics: Annotated[NDArray, Quantity("m", dims=(ROW, "harmonic"))] = field(compare=False)
    balance: Metre = float("nan")
    verdict: str = ""
    reason: str = ""
    distance: float = field(default=float("nan"), compare=False)
    repeats_after: int | None = None
    diameters: tuple[int, ...] = ()
    status: str = COMPLETE
    cost: Cost = field(default_factory=Cost)
    blade: int = -1
    blades: NDArray = field(default_factory=lambda: np.zeros((0, 0)), compare=False)
    waves: NDArray = field(default_factory=lambda: np.zeros((0, 2)), compare=False)
    energy: tuple[float, ...] = ()
    growth: float = field(default=float("nan"), compare=False)
    _summary_fields = (
        "mean",
        "lowest",
        "highest",
        "balance",
        "frequency",
        "preload",
        "diameters",
        "growth",
        "verdict",
        "distance",
        "status",
    )

    @property
    def period(self) -> Numbers:
        """Number (n_periods,) of each period."""
        return np.arange(len(self.harmonics))

    @property
    def amplitude(self) -> Amplitude:
        """First-harmonic amplitude (n_periods,) of the blade with the largest amplitude, m."""
        return np.abs(self.harmonics[:, 1])

    def columns(self) -> dict[str, Column]:
        """Return the columns of the table, which has one row for each period."""
        columns = super().columns()
        return {name: columns[name] for name in ("period", "amplitude", "harmonics")}

    def _statement(self) -> Statement:
        solution = f"the {amount(self.balance, 'm')} solution"
        subject = about(self.settings, self.preload, amount(self.frequency, "Hz"))
        if not self.verdict:
            verdict = f"Amplitude by time integration {amount(self.mean, 'm')}{subject}"
        elif self._is_too_short:
            periods = counted(len(self.harmonics), "period")
            few = f"{periods} {'is' if len(self.harmonics) == 1 else 'are'} too few"
            verdict = (
                f"Inconclusive: {few} to tell whether the vibration stays at {solution}{subject}"
            )
        elif self.verdict == "undecided":
            verdict = f"Inconclusive: time integration may or may not stay at {solution}{subject}"
        elif self.verdict == "agrees":
            verdict = f"Confirmed: time integration stays at {solution}{subject}"
        else:
            verdict = f"Not confirmed: time integration leaves {solution}{subject}"
        extent = f"{span(self.lowest, self.highest, 'm')} in single periods"
        if not self._is_too_short:
            extent = f"{self._kind}, {extent}"
        rows = [Row("Amplitude", amount(self.mean, "m"), extent), *self._unlike_rows()]
        remarks = []
        checks = []
        if self.verdict:
            outcome = {"agrees": "pass", "undecided": "uncertain"}.get(self.verdict, "FAIL")
            checks.append(Row("Stays at the solution", outcome, self.reason))
        if not self.verdict and not self.ok:
            remarks.append(f"The integration is {self.status_text}")
        # an undecided verdict is the reason why the result is incomplete
        elif self.status == INTERRUPTED:
            remarks.append(f"The integration is {INTERRUPTED}")
        if self.verdict == "undecided" and self.status != INTERRUPTED:
            remarks.append("Remedy: integrate longer, with periods=400")
        if any(check.value == "FAIL" for check in checks):
            remarks.append("Remedy: use study.time_response(curve), the highest steady amplitude")
        return Statement([verdict], rows, checks, remarks)

    @property
    def _is_too_short(self) -> bool:
        """Whether the motion has too few periods for a verdict."""
        return self.verdict == "undecided" and TOO_FEW in self.reason

    @property
    def _kind(self) -> str:
        """Kind of the motion by the number of periods after which it repeats."""
        if self.repeats_after is None:
            return "irregular"
        return "periodic" if self.repeats_after == 1 else f"{self.repeats_after}-periodic"


def _integrations_text(names: Collection[str]) -> str:
    """Return the names of integrations, such as "256 and 512 steps per period, at the jump"."""
    numbers = [name.removesuffix(" steps") for name in names if name.endswith(" steps")]
    others = [name for name in names if not name.endswith(" steps")]
    steps = [f"{listed(numbers)} steps per period"] if numbers else []
    return ", ".join([*steps, *others])


def _range_without_unit(motion: TimeResponse | MotionInTime) -> str:
    """Return lowest and highest amplitude in the unit of the mean, which stands before them."""
    with_unit = span(motion.lowest, motion.highest, "m", near=motion.mean)
    return with_unit.rpartition(" ")[0]


# ---- different friction coefficients ----


FRICTION_SPREAD = 1.5
"""Factor to which friction coefficients of dampers are typically known: within it the amplitude may
not double."""
MUCH = 2.0
"""Amplitude with another friction coefficient over that of the study that counts as too high."""


CONVERGED_SHARE = 0.2
"""Share of a tolerance below which changes by more harmonics have converged to it."""
NEGLIGIBLE_CHANGE = 1e-3
"""Relative change by two more harmonics below which the order of changes means nothing.

Peaks of two masses with 9, 11 and 13 harmonics differ by 0.001 and 0.006 % and have converged.
"""


@dataclass(frozen=True)
class FrictionPeak(WithStatus, Record):
    """Highest peak with different friction coefficients.

    Parameters
    ----------
    factor : float
        Factor on all friction coefficients.
    preload : float, N
    amplitude : float, m
        NaN if unknown; infinite if no steady periodic response is expected.
    status, reason : str
    lower_bound : float, m
        Amplitude of the highest computed point if the peak is incomplete; otherwise NaN.
    """

    factor: float
    preload: Newton
    amplitude: Metre
    status: str = COMPLETE
    reason: Reason = ""
    lower_bound: Annotated[Metre, Data(derived=True)] = field(default=float("nan"), compare=False)

    def __post_init__(self) -> None:
        # files of version 0.7 have lower bounds as amplitudes
        if self.status == INCOMPLETE and np.isfinite(self.amplitude):
            object.__setattr__(self, "lower_bound", self.amplitude)
            object.__setattr__(self, "amplitude", float("nan"))

    def __str__(self) -> str:
        doubt = "" if self.ok else f" ({self.status_text})"
        return f"{self.size_text} with {self.factor:.3g} times the friction{doubt}"

    @property
    def size_text(self) -> str:
        """Amplitude in words: "75 µm", "at least 75 µm", "not steady" or "unknown"."""
        if self.amplitude == np.inf:
            return "not steady"
        if np.isfinite(self.amplitude):
            return amount(self.amplitude, "m")
        if self.lower_bound > 0.0:
            return f"at least {amount(self.lower_bound, 'm')}"
        return "unknown"

    def compared_with(self, own: FrictionPeak) -> str:
        """Compare with twice the amplitude of ``own``: "high" if larger, "low" if not, or
        "unknown".
        """
        limit = MUCH * own.amplitude
        if self.amplitude > limit or self.lower_bound > limit:
            return "high"
        if self.amplitude <= limit:
            return "low"
        return "unknown"


class FrictionLimit(NamedTuple):
    """Factor on the friction coefficients at which the amplitude doubles, in one direction.

    Parameters
    ----------
    inside : float
        Computed factor farthest from 1 for which the amplitude, here and at all computed factors
        closer to 1, stays below twice the amplitude of the study.
    outside : float
        Next computed factor, at which the amplitude is at least doubled; NaN if it does not double.
    known : bool
        False if the amplitude at ``outside`` is unknown.
    factor : float
        Factor at which the amplitude doubles, interpolated between ``inside`` and ``outside``; NaN
        if it does not double, or if the amplitude at ``outside`` is infinite or unknown.
    """

    inside: float
    outside: float
    known: bool
    factor: float = float("nan")

    @property
    def near(self) -> bool:
        """Whether the amplitude doubles, or is unknown, within the usual spread of friction.

        False if it does not double, because a comparison with NaN is false.
        """
        rounding = 1e-9
        # above 1 for less friction as well
        factor = max(self.outside, 1.0 / self.outside)
        return factor <= FRICTION_SPREAD * (1.0 + rounding)

    @property
    def doubles(self) -> float:
        """Factor at which the amplitude doubles; ``inside`` if it cannot be interpolated, and NaN
        if there is none.
        """
        if np.isnan(self.outside) or not self.known:
            return float("nan")
        return self.inside if np.isnan(self.factor) else self.factor

    @property
    def text(self) -> str:
        """Factor at which the amplitude doubles, or the range that contains it, in words."""
        if np.isfinite(self.factor):
            return f"{self.factor:.2g}"
        return " to ".join(f"{factor:.2g}" for factor in sorted((self.inside, self.outside)))


@dataclass(frozen=True)
class FrictionRange(Record):
    """Peaks at one preload with different friction, and the factors at which the amplitude doubles.

    Parameters
    ----------
    peaks : tuple of FrictionPeak
        All computed peaks by ascending factor.
    remedy : float, N
        Nearest preload at which the amplitude does not double between 1/1.5 and 1.5 times the
        friction; NaN if it is not needed, or if none was found.
    seconds : float
        Elapsed time of all peaks, including the search for ``remedy``.
    """

    peaks: tuple[FrictionPeak, ...] = ()
    remedy: Newton = field(default=float("nan"), compare=False)
    seconds: Second = field(default=0.0, compare=False)

    @property
    def limits(self) -> tuple[FrictionLimit, FrictionLimit] | None:
        """Limits below and above the friction of the study; None if its amplitude is unknown."""
        nominal = next((peak for peak in self.peaks if peak.factor == 1.0), None)
        if nominal is None or not np.isfinite(nominal.amplitude) or len(self.peaks) == 1:
            return None
        below = [peak for peak in reversed(self.peaks) if peak.factor < 1.0]
        above = [peak for peak in self.peaks if peak.factor > 1.0]
        return self._limit(nominal, below), self._limit(nominal, above)

    @staticmethod
    def _limit(nominal: FrictionPeak, outward: list[FrictionPeak]) -> FrictionLimit:
        """Return the factors on friction between which the amplitude reaches twice the nominal one.

        ``outward`` contains the peaks with less friction, or with more, in the order of their
        distance from nominal.
        """
        inside = nominal
        for peak in outward:
            comparison = peak.compared_with(nominal)
            if comparison == "low":
                inside = peak
                continue
            factor = float("nan")
            if comparison == "high" and np.isfinite(peak.amplitude):
                factor = _factor_between(inside, peak, MUCH * nominal.amplitude)
            known = comparison == "high"
            return FrictionLimit(inside.factor, peak.factor, known, factor)
        # all amplitudes are known and low: there is no factor at which the amplitude doubles
        return FrictionLimit(inside.factor, outside=np.nan, known=True)

    @property
    def doubles(self) -> tuple[float, float]:
        """Factors below and above 1 at which the amplitude doubles; NaN if there is none.

        They are interpolated between the computed factors.  If the amplitude is infinite at the
        outer one, the inner one is given.
        """
        if self.limits is None:
            return np.nan, np.nan
        below, above = self.limits
        return below.doubles, above.doubles

    def __str__(self) -> str:
        return f"{self.text} ({counted(len(self.peaks), 'peak')}, {amount(self.seconds, 's')})"

    @property
    def text(self) -> str:
        """Factors at which the amplitude doubles, and the range in which it does not, in words."""
        if self.limits is None:
            return "the friction at which the amplitude doubles is unknown"
        below, above = self.limits
        doubled = []
        unknown = []
        for limit in self.limits:
            if not limit.known:
                unknown.append(f"{limit.outside:.2g}")
            elif np.isfinite(limit.outside):
                doubled.append(limit.text)
        text = f"the amplitude doubles at {' and '.join(doubled)} times the friction"
        if not doubled:
            tolerated = f"from {below.inside:.2g} to {above.inside:.2g} times"
            text = f"the amplitude does not double {tolerated} the friction"
        elif above.inside > 1.0 and not np.isfinite(above.doubles):
            text += f", but not up to {above.inside:.2g} times"
        elif below.inside < 1.0 and not np.isfinite(below.doubles):
            text += f", but not down to {below.inside:.2g} times"
        if unknown:
            text += f"; unknown at {' and '.join(unknown)} times"
        return text

    @property
    def interrupted(self) -> bool:
        """Whether the search was interrupted."""
        return any(peak.status == INTERRUPTED for peak in self.peaks)


def _factor_between(inside: FrictionPeak, outside: FrictionPeak, amplitude: float) -> float:
    """Return the factor on friction between two peaks at which the amplitude (m) is reached.

    The logarithm of the amplitude is linear in the logarithm of the factor.
    """
    rise = np.log(outside.amplitude / inside.amplitude)
    share = np.log(amplitude / inside.amplitude) / rise
    return float(inside.factor * (outside.factor / inside.factor) ** share)


class Meeting(NamedTuple):
    """Harmonic near a mode of the structure with stuck contacts (internal resonance).

    Parameters
    ----------
    harmonic, mode : int
        Modes are counted from 1 at the nodal diameter of the harmonic.
    nodal_diameter : int
        -1 without cyclic symmetry.
    frequency : float, Hz
        Natural frequency of the mode.
    distance : float
        Ratio of the frequency of the harmonic to the natural frequency, minus one.
    """

    harmonic: int
    mode: int
    nodal_diameter: int
    frequency: float
    distance: float

    def __str__(self) -> str:
        return f"harmonic {self.harmonic} is within {self.mode_text}"

    @property
    def mode_text(self) -> str:
        """Distance from the mode, for example "1.5 % of mode 4 of the stuck structure (398 Hz)"."""
        mode = f"mode {self.mode} of the stuck structure"
        if self.nodal_diameter >= 0:
            mode += f" at nodal diameter {self.nodal_diameter}"
        return f"{percent(abs(self.distance))} of {mode} ({amount(self.frequency, 'Hz')})"


def _heights(peaks: Sequence[HarmonicPeak]) -> str:
    """Return the range of the amplitudes, or one amplitude if both ends have the same digits."""
    amplitudes = [peak.amplitude for peak in peaks]
    return extent(min(amplitudes), max(amplitudes), "m")


@short_repr
@dataclass(frozen=True)
class Convergence(Result, Plottable, Tabular):
    """Peak computed with an increasing number of harmonics.

    ``plot`` draws the amplitude against the number of harmonics
    (:func:`bdamper.plot.plot_convergence`).

    Parameters
    ----------
    preload : float, N
    tolerance : float
        Relative tolerance of the amplitude.
    peaks : tuple of HarmonicPeak
        Peak of the study, then peaks with more harmonics.
    internal_resonances : tuple of Meeting
        Internal resonances up to the highest possible harmonic.
    highest_harmonic : str
        Reason why the sequence ends before the highest requested harmonic, or "".
    blade_modes : int
        Blade modes of the peaks with more harmonics; 0 for the modes of the study.
    status : str
        "complete", "interrupted" or "incomplete".
    reason : str
        Reason why no peak was found with more harmonics.
    cost : Cost
    """

    preload: float
    tolerance: float
    peaks: tuple[HarmonicPeak, ...]
    internal_resonances: tuple[Meeting, ...] = ()
    highest_harmonic: str = ""
    blade_modes: int = 0
    status: str = COMPLETE
    reason: Reason = ""
    cost: Cost = field(default_factory=Cost)
    _summary_fields = ("preload", "status", "internal_resonances")

    def columns(self) -> dict[str, Column]:
        """Return the columns of the table, one row for each number of harmonics."""
        return columns_of_rows(self.peaks)

    @property
    def settled(self) -> tuple[HarmonicPeak, ...]:
        """Last peaks that agree within the tolerance."""
        agreeing = self.peaks[-1:]
        # add earlier peaks until one disagrees
        for peak in reversed(self.peaks[:-1]):
            longer = (peak, *agreeing)
            amplitudes = [item.amplitude for item in longer]
            most_harmonics = agreeing[-1]
            if max(amplitudes) - min(amplitudes) > self.tolerance * most_harmonics.amplitude:
                break
            agreeing = longer
        return agreeing

    @property
    def range(self) -> tuple[float, float]:
        """Smallest and largest amplitude (m) of all peaks."""
        amplitudes = [peak.amplitude for peak in self.peaks]
        return min(amplitudes), max(amplitudes)

    @property
    def ok(self) -> bool:
        """Whether the peak agrees with all peaks computed with more harmonics, of which there must
        be at least two.
        """
        if self.status != COMPLETE or len(self.peaks) <= 2:
            return False
        return self._all_agree

    @property
    def _all_agree(self) -> bool:
        return len(self.settled) == len(self.peaks)

    @property
    def verdict(self) -> str:
        """Result of the convergence study in words."""
        peak_of_study, *more = self.peaks
        if not more:
            return "not known with more harmonics"
        first = more[0].harmonics
        last = more[-1].harmonics
        numbers = f"{first}" if first == last else f"{first} to {last}"
        result = f"{_heights(more)} with {numbers}"
        settled = self.settled
        if 1 < len(settled) < len(more):
            result += f", {_heights(settled)} from {settled[0].harmonics} on"
        if self.ok:
            return f"{result}: converged to {percent(self.tolerance)}"
        if self._all_agree:
            return f"{result}: agrees so far"
        return f"{result}: not converged with {peak_of_study.harmonics}"

    @property
    def note(self) -> str:
        """Amplitude, verdict, and the reason why no more harmonics were used."""
        peak = self.peaks[0]
        harmonics = counted(peak.harmonics, "harmonic")
        text = f"{amount(peak.amplitude, 'm')} with {harmonics}, {self.verdict}"
        if self.blade_modes:
            text += f"; {self._modes_text}"
        if self.highest_harmonic:
            text += f"; {self.highest_harmonic}"
        if self.status != COMPLETE:
            text += f"; {self.status_text}"
        return text

    def _statement(self) -> Statement:
        own = self.peaks[0]
        harmonics = counted(own.harmonics, "harmonic")
        subject = f"{amount(own.amplitude, 'm')}{self._others_text()}"
        if np.isfinite(self.preload):
            subject += f", preload {amount(self.preload, 'N')}"
        if self.ok:
            verdict = f"Converged with {harmonics}: {subject}"
        elif not self.peaks[1:]:
            verdict = f"Not known with more than {harmonics}: {subject}"
        elif self._all_agree:
            verdict = f"Agrees so far with {harmonics}: {subject}"
        else:
            verdict = f"Not converged with {harmonics}: {subject}"
        table = [
            ("Harmonics", *(str(peak.harmonics) for peak in self.peaks)),
            ("Peak", *same_digits([amount(peak.amplitude, "m") for peak in self.peaks])),
            ("Frequency", *same_digits([amount(peak.frequency, "Hz") for peak in self.peaks])),
        ]
        rows = [
            Row("Internal resonance" if i == 0 else "", f"harmonic {item.harmonic}", item.mode_text)
            for i, item in enumerate(self.internal_resonances)
        ]
        remarks = [
            sentence(text)
            for text in (
                self._modes_text if self.blade_modes else "",
                self.highest_harmonic,
                self.status_text if self.status != COMPLETE else "",
            )
            if text
        ]
        settled = self.settled
        if not self.ok and 1 < len(settled) < len(self.peaks):
            remarks.append(f"Remedy: {self.settings_text(settled[0])}")
        open_effects = ["time integration", "more blade modes", "more contact points"]
        if self.blade_modes:
            open_effects.remove("more blade modes")
        remarks.append(f"Not covered: {', '.join(open_effects)}")
        return Statement([verdict], rows, self._spread_checks(), remarks, table)

    @property
    def _modes_text(self) -> str:
        """Modes of the peaks with more harmonics."""
        return f"the peaks with more harmonics have {counted(self.blade_modes, 'blade mode')}"

    def settings_text(self, peak: HarmonicPeak) -> str:
        """Return the settings with which a study has one of the peaks, as a remedy."""
        text = f"use harmonics={peak.harmonics}"
        if self.blade_modes:
            text += f", blade_modes={self.blade_modes}"
        return text

    def _others_text(self) -> str:
        """Return the amplitudes with more harmonics, "" without."""
        others = self.peaks[1:]
        if not others:
            return ""
        last = others[-1].harmonics
        if len(others) == 1:
            return f"; {last} harmonics give {_heights(others)}"
        return f"; {others[0].harmonics} to {last} harmonics give {_heights(others)}"

    def _spread_checks(self) -> list[Row]:
        """Return the checks of the spread from the harmonics of the study and from more on."""
        groups = [self.peaks]
        if 1 < len(self.settled) < len(self.peaks):
            groups.append(self.settled)
        rows = []
        for peaks in groups:
            if len(peaks) < 2:
                continue
            amplitudes = [peak.amplitude for peak in peaks]
            spread = (max(amplitudes) - min(amplitudes)) / peaks[-1].amplitude
            outcome = "pass" if spread <= self.tolerance else "FAIL"
            # a later peak may be missing
            if outcome == "pass" and len(peaks) <= 2:
                outcome = "uncertain"
            finding = f"{percent(spread)} (limit {percent(self.tolerance)})"
            compared = f"Spread from {peaks[0].harmonics} to {peaks[-1].harmonics} harmonics"
            rows.append(Row(compared, outcome, finding))
        return rows


# ---- error estimates ----

LARGE_ERROR = 0.1
"""Relative error of one source above which the first line names it with its setting."""
SETTING_OF = {
    "harmonics": "harmonics",
    "contact_forces": "contact_forces",
    "contact points": "contact_points",
    "modes": "blade_modes",
    "residual flexibility": "contact_stiffness",
}
"""Setting of a study that reduces the error of a source."""


@short_repr
@dataclass(frozen=True)
class ErrorEstimates(Result):
    """Estimated errors of a peak, by source.

    Parameters
    ----------
    preload : float, N
    frequency, amplitude : float, Hz, m
        Frequency and amplitude of the peak.
    sources : tuple of SourceError
        Changes due to more accurate settings, one setting at a time.
    harmonic_peaks : tuple of HarmonicPeak
        Peak of the study, then peaks with increasing numbers of harmonics; the amplitude is NaN if
        there is no peak. Empty if harmonics were not examined.
    cost : Cost
        Work of the estimates.
    """

    preload: float
    frequency: float
    amplitude: float
    sources: tuple[SourceError, ...]
    harmonic_peaks: tuple[HarmonicPeak, ...] = ()
    cost: Cost = field(default_factory=Cost, compare=False)
    _summary_fields = ("sources",)

    def __getitem__(self, source: str) -> SourceError:
        by_name = {item.source: item for item in self.sources}
        return by_name[validation.choice("source", source, by_name)]

    @property
    def total(self) -> float:
        """Sum of all known errors: an estimate, because they may interact."""
        return float(np.nansum([source.size for source in self.sources]))

    @property
    def unknown(self) -> tuple[str, ...]:
        """Sources without an estimate."""
        return tuple(item.source for item in self.sources if not item.known)

    @property
    def undecided(self) -> bool:
        """Whether the peaks do not converge with more harmonics, or one of them is missing.

        More harmonics then give no limit, and only time integration can determine the amplitude.
        """
        if not self.harmonic_peaks:
            return False
        amplitudes = np.array([peak.amplitude for peak in self.harmonic_peaks])
        if np.isnan(amplitudes).any():
            return True
        changes = np.abs(np.diff(amplitudes))
        if len(changes) < 2 or changes[-1] < NEGLIGIBLE_CHANGE * amplitudes[-1]:
            return False
        return bool(changes[-1] >= changes[-2])

    @property
    def largest_harmonic_change(self) -> float:
        """Largest relative change of the amplitude from one number of harmonics to the next.

        Infinite if a peak is missing, or if there are no peaks with more harmonics.
        """
        amplitudes = np.array([peak.amplitude for peak in self.harmonic_peaks])
        if len(amplitudes) < 2 or np.isnan(amplitudes).any():
            return float("inf")
        changes = np.abs(np.diff(amplitudes))
        return float(changes.max() / amplitudes[-1])

    @property
    def line(self) -> str:
        """Errors in one line, in per cent; sources below a hundredth of the sum are omitted."""
        estimated = [item for item in self.sources if item.known]
        if not estimated:
            return "error not estimated"
        total = self.total
        if total > 1e-5:
            shares = []
            for item in sorted(estimated, key=lambda item: -item.size):
                if item.size > 0.01 * total:
                    without_sign = percent(item.size).removesuffix(" %")
                    shares.append(f"{item.source} {without_sign}")
            text = f"estimated error {percent(total)} ({', '.join(shares)})"
        else:
            text = "estimated error below 0.001 %"
        if self.unknown:
            text += f", not estimated: {', '.join(self.unknown)}"
        return text

    def _statement(self) -> Statement:
        peak = f"{peak_text(self.amplitude, self.frequency)}, preload {amount(self.preload, 'N')}"
        remarks = []
        if self.undecided:
            verdict = f"Not decided by harmonic balance; time integration is needed: peak {peak}"
            if not any(item.source == "time" and item.known for item in self.sources):
                remarks.append("Remedy: study.time_response(peak)")
        elif all(not item.known for item in self.sources):
            verdict = f"Error not estimated: peak {peak}"
        elif self.total > 1e-5:
            verdict = f"Estimated error {percent(self.total)}{self._large_text()}: peak {peak}"
        else:
            verdict = f"Estimated error below 0.001 %: peak {peak}"
        table = [("Source", "Amplitude change", "Frequency change", "Compared with")]
        for item in sorted(self.sources, key=lambda item: -np.nan_to_num(item.size)):
            if item.known:
                changes = (
                    percent(item.amplitude, sign=True),
                    percent(item.frequency, sign=True),
                )
                against = item.against
                if item.uncertainty:
                    against += f"; may miss {percent(item.uncertainty)}"
                table.append((item.source, *changes, against))
        unknown = [
            Row(item.source, "not estimated", item.against)
            for item in self.sources
            if not item.known
        ]
        remarks.append(
            "Estimated error: sum of the magnitudes of all sources; an estimate, not a bound"
        )
        if not any(item.source == "time" for item in self.sources):
            remarks.append('Not covered: time integration (add "time" to sources)')
        return Statement([verdict], self._harmonic_rows(), unknown, remarks, table)

    def _large_text(self) -> str:
        """Return the sources with a large error and the settings that reduce them, or ""."""
        large = sorted(
            (item for item in self.sources if item.known and item.size > LARGE_ERROR),
            key=lambda item: -item.size,
        )
        texts = []
        for item in large:
            setting = SETTING_OF.get(item.source)
            remedy = f" ({setting}=)" if setting else ""
            texts.append(f"{item.source} {percent(item.size)}{remedy}")
        return f", {', '.join(texts)}" if texts else ""

    def _harmonic_rows(self) -> list[Row]:
        """Return the peaks with more harmonics if they do not decide."""
        if not self.undecided:
            return []
        rows = []
        for peak in self.harmonic_peaks:
            found = np.isfinite(peak.amplitude)
            text = amount(peak.amplitude, "m") if found else "no peak"
            rows.append(Row(counted(peak.harmonics, "harmonic"), text))
        return rows
