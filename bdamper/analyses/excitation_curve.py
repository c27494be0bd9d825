"""Resonance amplitude as a function of the excitation: the curve that a test at several levels
measures.

At a fixed preload the highest response is computed at each amplitude of the excitation, as in an
optimal curve at each preload.  The same search over one parameter then looks for the excitation at
which amplitude over excitation is lowest, where friction damps best.

If only the ratio of excitation F and preload N matters, nothing is solved at other excitations: the
response to F under N is that to F_0 under N F_0 / F, times F / F_0.  The optimal curve of the study
then contains all values.  This is so without gaps, cubic springs and constant loads.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from contextvars import copy_context
from dataclasses import dataclass, field, replace
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bdamper.harmonic_balance.contact_cycle import energies
from bdamper.harmonic_balance.parameters import vary
from bdamper.harmonic_balance.problem import Problem
from bdamper.response.continuation import TWO_PI
from bdamper.response.highest_peak import AtPreload, check_options
from bdamper.response.optimal_curve import (
    at_preload,
    curve_interval,
    optimal_curve,
    preload_values,
)
from bdamper.response.optimal_curve_result import OptimalCurve
from bdamper.response.peak import PeakOptions
from bdamper.response.scalar_search import Sample, find_minimum
from bdamper.response.sensitivity import amplitude_sensitivity, setting_family
from bdamper.util import validation
from bdamper.util.display import Plottable, Result
from bdamper.util.errors import COMPLETE, FAILURES_AT_ONE_PRELOAD, INCOMPLETE
from bdamper.util.formatting import amount, counted, percent, sentence, short_repr
from bdamper.util.progress import one_thread, progress_stages, shows_progress
from bdamper.util.records import Data
from bdamper.util.statement import Row, Statement
from bdamper.util.storage import Recorded, Storable
from bdamper.util.tables import Hertz, Metres, Numbers, Quantity, Tabular
from bdamper.util.workers import workers

EXCITATION = "excitation.amplitude"


@short_repr
@dataclass(frozen=True)
class ExcitationCurve(
    Result,
    Plottable,
    Tabular,
    Recorded,
    Storable,
    kind="bdamper-excitation-curve",
    row="excitation",
):
    """Highest response at a preload as a function of the amplitude of the excitation.

    ``plot`` draws amplitude and damping, with measured points
    (:func:`bdamper.plot.plot_excitation_curve`).

    Parameters
    ----------
    excitation : (n,) float, N or m/s2
        Requested amplitudes of the excitation and further ones of the search, ascending.
    amplitude, frequency : (n,) float, m and Hz
        Highest response and its frequency; NaN if it is not known.
    damping_ratio : (n,) float
        Dissipated energy over 4 pi times the kinetic energy of the motion.
    dissipated : (n,) float, J
        Energy that contacts and modal damping of one sector dissipate in a cycle.
    by_contacts : (n,) float, J
        Part of it that the contacts dissipate.
    requested : (n,) bool
    preload : float, N
    unit : str
        Unit of the excitation.
    scaled : bool
        Whether the values are scaled from an optimal curve.
    best : float
        Excitation with the lowest amplitude per excitation, in the range; NaN without values.
    statuses, reasons : tuple of str
        Status of each row, and the reason for it.
    settings : mapping
    model_hash : str
    """

    excitation: Annotated[NDArray, Quantity("", "Excitation amplitude")]
    amplitude: Metres
    frequency: Hertz
    damping_ratio: Annotated[NDArray, Quantity("", "Damping ratio")]
    dissipated: Annotated[NDArray, Quantity("J", "Energy dissipated per cycle")]
    by_contacts: Annotated[NDArray, Quantity("J", "Energy dissipated by the contacts")]
    requested: Numbers
    preload: float
    unit: str
    scaled: bool
    best: float
    statuses: Annotated[tuple[str, ...], Quantity(name="status")]
    reasons: Annotated[tuple[str, ...], Data(derived=True), Quantity(name="reason")]
    status: str = field()
    reason: str = field()

    def _statement(self) -> Statement:
        unit = self.unit
        known = np.isfinite(self.amplitude)
        low, high = amount(self.excitation[0], unit), amount(self.excitation[-1], unit)
        preload = amount(self.preload, "N")
        verdict = f"Resonances with {low} to {high} of excitation: preload {preload}"
        rows = []
        if known.any():
            first, last = np.flatnonzero(known)[[0, -1]]
            ends = (first, last)
            amplitudes = " and ".join(amount(self.amplitude[i], "m") for i in ends)
            frequencies = " and ".join(amount(self.frequency[i], "Hz") for i in ends)
            at_ends = " and ".join(f"at {amount(self.excitation[i], unit)}" for i in ends)
            rows.append(Row("Amplitude", amplitudes, at_ends))
            rows.append(Row("Frequency", frequencies, at_ends))
            best = int(np.nanargmin(self.amplitude / self.excitation))
            ratio = amount(self.amplitude[best] / self.excitation[best], "m")
            ratio += "/N" if unit == "N" else f" per {unit}"
            where = f"lowest of all excitations, at {amount(self.excitation[best], unit)}"
            rows.append(Row("Amplitude / excitation", ratio, where))
            top = int(np.nanargmax(self.damping_ratio))
            where = f"highest of all excitations, at {amount(self.excitation[top], unit)}"
            rows.append(Row("Damping ratio", percent(self.damping_ratio[top]), where))
        n_known = "all" if known.all() else str(int(known.sum()))
        rows.append(Row("Excitations", str(len(known)), f"peak found for {n_known}"))
        remarks = [
            "Damping ratio and dissipated energy: contacts and modal damping of one sector, per period."
        ]
        if self.scaled:
            remarks.append(
                "Scaled from an optimal curve: the response / excitation depends only on excitation / "
                "preload."
            )
        table, further = self._first_rows(self._printed_table())
        if not self.requested.all():
            remarks.append(f"{sentence(_ADDED)} excitations lie between the requested ones.")
        return Statement([verdict], rows, remarks=(*remarks, *further), table=table)

    def _printed_table(self) -> list[tuple[str, ...]]:
        """Return a header, and a row for each excitation."""
        head = (
            "Excitation",
            "Amplitude",
            "Frequency",
            "Damping ratio",
            "Dissipated",
            "By contacts",
        )
        rows: list[tuple[str, ...]] = [(*head, "Remark")]
        for i, excitation in enumerate(self.excitation):
            remarks = [] if self.requested[i] else [_ADDED]
            if self.statuses[i] != COMPLETE:
                remarks.append(self.statuses[i])
            rows.append(
                (
                    amount(excitation, self.unit),
                    amount(self.amplitude[i], "m"),
                    amount(self.frequency[i], "Hz"),
                    percent(self.damping_ratio[i]),
                    amount(self.dissipated[i], "J"),
                    amount(self.by_contacts[i], "J"),
                    ", ".join(remarks),
                )
            )
        return rows


_ADDED = "added"
"""Remark on excitations that the search has added."""


class _Level(NamedTuple):
    """Highest response at one excitation."""

    excitation: float
    amplitude: float
    frequency: float
    damping_ratio: float
    dissipated: float
    by_contacts: float
    status: str
    reason: str


def _level(
    problem: Problem,
    preload: float,
    unknowns: NDArray,
    factor: float,
    excitation: float,
    amplitude: float,
    frequency: float,
    status: str,
    reason: str,
) -> _Level:
    """Return the highest response with its energies.

    Parameters
    ----------
    problem, preload
        Equations that the motion solves.
    unknowns : (n_unknowns,) float
    factor : float
        Factor from this motion to the one at ``excitation``.
    """
    damping_ratio = dissipated = by_contacts = np.nan
    if np.isfinite(amplitude):
        cycle = energies(problem.at(preload).equations, unknowns, TWO_PI * frequency)
        by_contacts = float(np.sum(cycle["contact"])) * factor**2
        dissipated = by_contacts + cycle["damping"] * factor**2
        kinetic = cycle["kinetic"] * factor**2
        if kinetic > 0.0:
            damping_ratio = dissipated / (2.0 * TWO_PI * kinetic)
    return _Level(
        excitation, amplitude, frequency, damping_ratio, dissipated, by_contacts, status, reason
    )


@one_thread
def excitation_curve(
    problem: Problem,
    preload: float,
    excitation: tuple[float, float] | Sequence[float] | NDArray,
    n: int = 12,
    *,
    frequency: tuple[float, float] | None = None,
    mode: int = 1,
    options: PeakOptions | None = None,
    scaled_from: OptimalCurve | None = None,
    progress: bool | None = None,
) -> ExcitationCurve:
    """See :meth:`bdamper.Study.excitation_curve`."""
    preload = problem.check_preload(preload)
    unit = problem.settings.unit_of(problem.settings.excitation)
    levels = preload_values(excitation, n, "excitation", unit)
    check_options(options)
    depends_on_ratio = _depends_on_ratio(problem, preload)
    expected = "a study in which only the ratio of excitation and preload matters"
    found = "a gap, a cubic spring or a constant load"
    good = scaled_from is None or depends_on_ratio
    validation.check(good, "scaled_from", expected, found)
    if depends_on_ratio:
        curve = scaled_from
        if curve is None:
            preloads = np.sort(preload * problem.settings.excitation.amplitude / levels)
            curve = optimal_curve(
                problem,
                preloads,
                len(preloads),
                frequency=frequency,
                mode=mode,
                options=options,
                progress=shows_progress(progress),
            )
        rows = _scaled(problem, preload, curve, levels)
    else:
        search = _Search(problem, preload, levels, frequency, mode, options)
        rows = search.run(shows_progress(progress))
    rows.sort()
    known = [row for row in rows if np.isfinite(row.amplitude)]
    best = np.nan
    if known:
        best = min(known, key=lambda row: row.amplitude / row.excitation).excitation
    unknown = [row for row in rows if row.status != COMPLETE]
    status, reason = COMPLETE, ""
    if unknown:
        of_all = f"{len(unknown)} of {counted(len(rows), 'excitation')}"
        status, reason = INCOMPLETE, f"{of_all} without a result, the first: {unknown[0].reason}"
    columns = np.array([row[:6] for row in rows], float).reshape(-1, 6).T
    is_requested = np.isclose(columns[0][:, None], levels, rtol=1e-12, atol=0.0).any(axis=1)
    return ExcitationCurve(
        excitation=columns[0],
        amplitude=columns[1],
        frequency=columns[2],
        damping_ratio=columns[3],
        dissipated=columns[4],
        by_contacts=columns[5],
        requested=is_requested,
        preload=preload,
        unit=unit,
        scaled=depends_on_ratio,
        best=float(best),
        statuses=tuple(row.status for row in rows),
        reasons=tuple(row.reason for row in rows),
        status=status,
        reason=reason,
        **problem.recorded(options),
    )


def _depends_on_ratio(problem: Problem, preload: float) -> bool:
    """Return whether the motion under a preload depends on the ratio of excitation and preload
    only, times the preload.
    """
    if preload == 0.0 or not problem.carries_load or problem.settings.residual_slip_std:
        return False
    static = problem.static_system(preload)
    # a normal force at rest without preload is an interference, a negative one a gap
    if np.any(static.n0 != 0.0) or np.any(static.cubic) or np.any(static.constant_force):
        return False
    return not np.any(problem.displacement_by_rotation)


def _scaled(problem: Problem, preload: float, curve: OptimalCurve, levels: NDArray) -> list[_Level]:
    """Return the values of an optimal curve at a fixed preload, within the range of levels."""
    reference = problem.settings.excitation.amplitude
    rounding = 1e-9
    rows = []
    for i, own_preload in enumerate(curve.preload.tolist()):
        factor = preload / own_preload
        level = reference * factor
        if not levels[0] * (1.0 - rounding) <= level <= levels[-1] * (1.0 + rounding):
            continue
        # the requested level without its rounding
        nearest = float(levels[np.argmin(np.abs(levels - level))])
        if abs(nearest / level - 1.0) < rounding:
            level = nearest
        row = _level(
            problem,
            own_preload,
            curve.unknowns[i],
            factor,
            level,
            factor * float(curve.amplitude[i]),
            float(curve.frequency[i]),
            curve.status[i],
            curve.reason[i],
        )
        rows.append(row)
    return rows


@dataclass
class _Search:
    """Highest responses at several excitations, and the search for the lowest ratio."""

    problem: Problem
    preload: float
    levels: NDArray
    frequency: tuple[float, float] | None
    mode: int
    options: PeakOptions | None

    def run(self, progress: bool) -> list[_Level]:
        """Return the values at all excitations, also of the search."""
        interval = curve_interval(self.problem, np.array([self.preload]), self.frequency, self.mode)
        # responses by ln(excitation)
        found: dict[float, AtPreload] = {}

        def sample(x: float) -> Sample:
            response = found[x]
            return Sample(x, response.value - x, response.slope - 1.0)

        def evaluate(logs: Sequence[float]) -> list[Sample]:
            tasks = []
            for x in logs:
                task = pool.submit(copy_context().run, self._at, float(np.exp(x)), interval)
                tasks.append(task)
            for i, (x, task) in enumerate(zip(logs, tasks)):
                report(f"{np.exp(x):.4g} of excitation", len(found), len(found) + len(logs) - i)
                found[x] = task.result()
            return [sample(x) for x in logs]

        stages = progress_stages(progress, "excitation curve", "curve")
        with stages as report, ThreadPoolExecutor(workers()) as pool:
            known = evaluate(np.log(self.levels).tolist())
            if any(np.isfinite(value.value) for value in known):
                # the cubic through two samples and their slopes gives the minimum between them
                find_minimum(known, evaluate, lambda left, right, x: None)
        return [self._row(float(np.exp(x)), response) for x, response in found.items()]

    def _at(self, level: float, interval: tuple[float, float]) -> AtPreload:
        """Return the highest response at an excitation, with d ln(amplitude)/d ln(excitation)."""
        problem = vary(self.problem, {EXCITATION: level})
        response = at_preload(problem, self.preload, interval, self.options)
        slope = np.nan
        if response.top is not None:
            peak = response.top.peak
            # a corner has no slope
            with suppress(*FAILURES_AT_ONE_PRELOAD):
                family = setting_family(problem, EXCITATION, self.preload)
                slope = amplitude_sensitivity(peak, family, level) * level / peak.amplitude
        return replace(response, slope=slope)

    def _row(self, level: float, response: AtPreload) -> _Level:
        nearest = float(self.levels[np.argmin(np.abs(self.levels - level))])
        if abs(nearest / level - 1.0) < 1e-12:
            level = nearest
        ending = response.ending
        problem = vary(self.problem, {EXCITATION: level})
        amplitude, frequency, unknowns = np.nan, np.nan, np.zeros(0)
        if response.known and not response.rattles and response.top is not None:
            peak = response.top.peak
            amplitude, frequency, unknowns = peak.amplitude, peak.frequency, peak.y[:-1]
        return _level(
            problem,
            self.preload,
            unknowns,
            1.0,
            level,
            amplitude,
            frequency,
            ending.status,
            ending.reason,
        )
