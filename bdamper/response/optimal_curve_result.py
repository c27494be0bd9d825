"""Result of an optimal curve: resonance as a function of preload, linear limits, optimum and
curves.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, ClassVar, cast

import numpy as np
from numpy.typing import NDArray

from bdamper.fatigue.margin import MarginCurve
from bdamper.harmonic_balance.problem import Problem
from bdamper.harmonic_balance.study_boundary import StudyLike
from bdamper.response.linear_limits import Limit
from bdamper.response.motion_range import exceeds
from bdamper.response.optimum_checks import (
    EDGE,
    NEAR_BEST,
    checked_amplitudes,
    end_text,
    failed,
    known_in_time,
)
from bdamper.response.optimum_statement import statement
from bdamper.response.peak import Peak, half_range_row
from bdamper.response.peak_error import HARMONICS, VECTORS, SourceError
from bdamper.response.response_curve_result import ResponseCurve
from bdamper.response.verification import Convergence, FrictionPeak, FrictionRange, TimeResponse
from bdamper.util import validation
from bdamper.util.display import Comparable, Fact, InContact, WithChecks, draw
from bdamper.util.errors import COMPLETE, INCOMPLETE, INTERRUPTED, WithRowStatus, WithStatus
from bdamper.util.formatting import amount, percent, short_repr, span
from bdamper.util.progress import Cost
from bdamper.util.records import Data
from bdamper.util.statement import Row, Statement
from bdamper.util.storage import FilePath, Recorded, Storable
from bdamper.util.tables import (
    Hertz,
    Kinds,
    Metres,
    Newtons,
    Numbers,
    PerRow,
    Quantity,
    Resonance,
    Shares,
    Tabular,
)

KINDS = {
    "smooth": "smooth minimum",
    "crossing": "two peaks of equal height",
    "jump": "a higher peak on one side",
    "unknown": "not located",
    "flat": "none, the preload has no effect",
    "none": "none",
    "end": "at an end of the range; a lower amplitude may lie outside",
    "edge": EDGE,
}
"""Words for the kinds of an optimum."""


@dataclass(frozen=True)
class OptimumPoint(WithStatus):
    """Preload with the lowest resonance amplitude.

    Parameters
    ----------
    preload : float, N
        NaN if the curve is flat, or if no preload has a value.
    amplitude : float, m
    frequency : float, Hz
    kind : {"smooth", "crossing", "jump", "end", "edge", "unknown", "flat", "none"}
        - "smooth": zero derivative;
        - "crossing": two peaks of equal height;
        - "jump": end of a higher peak; the amplitude is the limit from the side without it;
        - "end": end of the range of preloads, or of the preloads with a value;
        - "edge": preload below which no response is steady;
        - "unknown": not determined, as after an interruption;
        - "flat": the preload has no effect (no slip, or bonded contact);
        - "none": no preload has a value.
    uncertainty : float
        Relative uncertainty of the preload.
    status : str
        "complete" if no preload without a value could replace it, and no tangents of the highest
        points at two neighbouring preloads indicate a lower value.  A lower value between distant
        preloads may still be missed.  Otherwise "incomplete", "interrupted" or "not found".
    reason : str
        Reason for the status, "" if it is complete.
    half_range : float, m
        Half of the largest peak-to-peak response on the response curve, with all harmonics.
    """

    preload: float
    amplitude: float
    frequency: float
    kind: str
    uncertainty: float
    status: str = COMPLETE
    reason: str = ""
    half_range: Annotated[float, Data(derived=True)] = float("nan")
    prints_fields: ClassVar[bool] = True
    """Whether ``print`` shows a table of the fields, so that other results list them as values."""

    def __post_init__(self) -> None:
        # files of version 0.6 have other words
        words = {"verified": COMPLETE, "not verified": INCOMPLETE}
        object.__setattr__(self, "status", words.get(self.status, self.status))

    @property
    def known_to(self) -> str:
        """Uncertainty of the preload in words; "" if it is negligible or unknown."""
        if 1e-5 < self.uncertainty < np.inf:
            return f"preload uncertain by {percent(self.uncertainty)}"
        return ""

    @property
    def text(self) -> str:
        """Kind, uncertainty of the preload unless negligible, and status unless complete."""
        text = KINDS[self.kind]
        if self.known_to:
            text += f", {self.known_to}"
        if not self.ok:
            text += f", {self.status_text}"
        return text

    def __str__(self) -> str:
        """Return a table of preload, amplitude, and frequency."""
        if not np.isfinite(self.preload):
            return Statement([f"No optimal preload: {self.text}"]).text
        rows = [
            Row("Preload", amount(self.preload, "N"), self.known_to),
            Row("Amplitude", amount(self.amplitude, "m"), "highest peak at this preload"),
            Row("Frequency", amount(self.frequency, "Hz"), ""),
        ]
        if exceeds(self.half_range, self.amplitude):
            rows.append(half_range_row(self.half_range))
        rows.append(Row("Kind", KINDS[self.kind], ""))
        if not self.ok:
            rows.append(Row("Status", self.status_text, ""))
        return Statement([], rows).text


class TimeResponses(tuple[TimeResponse, ...]):
    """Time integrations of an optimal curve; ``print`` shows a table."""

    __slots__ = ()

    def __str__(self) -> str:
        if not self:
            return "no time integration; study.with_time_response(curve) adds it"
        table = [("Preload", "Time integration", "Mean", "Frequency", "Harmonic balance", "Status")]
        for response in self:
            known = np.isfinite(response.mean)
            table.append(
                (
                    amount(response.preload, "N"),
                    span(response.lowest, response.highest, "m") if known else "unknown",
                    amount(response.mean, "m") if known else "",
                    amount(response.frequency, "Hz") if known else "",
                    amount(response.balance, "m"),
                    response.status_text,
                )
            )
        return Statement([], table=table).text


@short_repr
@dataclass(frozen=True)
class OptimalCurve(
    WithRowStatus,
    WithChecks,
    InContact,
    Comparable,
    Tabular,
    Recorded,
    Storable,
    kind="bdamper-optimal",
    row="preload",
):
    """Resonance as a function of the preload.

    The table has all preloads that were requested or computed, in ascending order.  The optimum is
    one of them.

    ``plot`` draws amplitude and frequency shift against the preload, as in Figs 8 and 9 of the
    paper (:func:`bdamper.plot.plot_optimal`).

    Parameters
    ----------
    preload : (n,) float, N
    amplitude : (n,) float, m
        Amplitude of the highest peak; NaN if none was found, or if the response curve is incomplete
        and may have a higher one.
    frequency : (n,) float, Hz
    shares : (n, 3) float
        Fractions of the cycle in stick, slip and separation at the peak, mean over the friction
        points.
    residual : (n,) float
    unknowns : (n, n_unknowns) float
    status : tuple of str
        "complete"; "incomplete" with omissions or without a maximum; "not found".
    reason : tuple of str
        Reason for the status, or a note if an end of the interval is higher than all maxima.
    free, stuck : Limit
    optimum : OptimumPoint
    cost : Cost
        Total cost of curves, time integrations and peaks with more harmonics.
    settings : mapping
    model_hash : str
    lower_bound : (n,) float, m
        Highest response found at a preload without a value; NaN at preloads with a value, or if
        nothing was found.
    goes_on : (n,) bool
        Whether the highest points at this preload and the previous one are on one smooth branch,
        judged by their tangents.
    kind : tuple of str
        Kind of the highest point at each preload: "peak", "corner", "drift" or "fold"; empty
        without a value.
    convergence : Convergence or None
        Peak at the optimum with more harmonics.
    curves : tuple of ResponseCurve
        Response curve at each preload, coarse and without the unknowns of harmonic balance.  It is
        empty if no curve was followed.
    requested : (n,) bool
        Whether the preload was requested; the search added the others near the optimum.
    lowest_steady_preload : float, N
        Up to this preload the damper rattles and no steady periodic response is expected
        (:mod:`bdamper.response.response_curve`).  There are no values at these preloads, and they
        are not searched.  0 if rattling is not expected.
    margins : tuple of MarginCurve
        Margins against fatigue along the curve, if requested.
    time_response : tuple of TimeResponse
        Time integrations at the optimum and at the preloads of
        :meth:`bdamper.Study.with_time_response`.
    other_friction : tuple of FrictionPeak
        Peaks at the recommended preload with lower and higher friction coefficients, by harmonic
        balance; the first one has the friction coefficients of the study.
    friction_range : FrictionRange or None
        Factors on the friction coefficients at which the amplitude at the recommended preload
        doubles.
    mass_radius : float, kg m
        Mass times radius of the body to which the preload is applied; NaN if unknown or without
        rotation.
    half_range : (n,) float, m, or None
        Half of the largest peak-to-peak response on the response curve of each preload, with all
        harmonics.
    harmonic_change, vector_change : (n,) float, or None
        Relative change of the amplitude with two more harmonics, and the further change with six
        more residual modes; NaN if unknown.  None if the errors were left out (``errors=False``), without residual
        modes, and in files of earlier versions.
    checks_interrupted : bool
        Whether Ctrl-C, or the limit of their time, ended the checks or the computation of the
        margins.
    model_doubts : tuple of str, optional
        Properties of the model due to which amplitudes may be wrong by a factor of several; None in
        files of earlier versions.
    neglected : tuple of str
        Effects of the rotor speed that the model neglects
        (``study.model.neglected_over_speed()``); empty in files of earlier
        versions.
    """

    preload: Newtons
    amplitude: Resonance
    frequency: Hertz
    shares: Shares
    residual: Numbers
    unknowns: PerRow
    status: Annotated[tuple[str, ...], Quantity()]
    free: Limit
    stuck: Limit
    optimum: OptimumPoint
    cost: Cost
    lower_bound: Metres
    goes_on: PerRow
    kind: Kinds
    convergence: Convergence | None = None
    curves: tuple[ResponseCurve, ...] = ()
    requested: Annotated[NDArray, Data(derived=True), Quantity()] = field(
        default_factory=lambda: np.zeros(0, bool)
    )
    lowest_steady_preload: float = 0.0
    margins: tuple[MarginCurve, ...] = ()
    time_response: tuple[TimeResponse, ...] = ()
    other_friction: tuple[FrictionPeak, ...] = ()
    friction_range: FrictionRange | None = None
    mass_radius: Annotated[float, Data(derived=True)] = float("nan")
    half_range: PerRow | None = None
    checks_interrupted: Annotated[bool, Data(derived=True)] = False
    model_doubts: Annotated[tuple[str, ...] | None, Data(derived=True)] = None
    neglected: Annotated[tuple[str, ...], Data(derived=True)] = ()
    reason: Annotated[tuple[str, ...], Data(derived=True), Quantity()] = ()
    harmonic_change: Annotated[NDArray, Quantity()] | None = None
    vector_change: Annotated[NDArray, Quantity()] | None = None
    _called = "curve"
    _summary_fields = (
        "optimum.preload",
        "optimum.amplitude",
        "optimum.frequency",
        "design_amplitude",
        "time_response",
        "optimum_in_time",
        "convergence",
        "other_friction",
        "friction_range",
        "free",
        "stuck",
        "ratio",
        "stuck_shift_percent",
        "margins",
        "detached",
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        # files of version 0.10 and older have the requested preloads alone
        if self.requested is None or len(self.requested) == 0:
            object.__setattr__(self, "requested", np.ones(len(self.preload), bool))
        object.__setattr__(self, "time_response", TimeResponses(self.time_response))

    def __len__(self) -> int:
        return len(self.preload)

    @property
    def complete(self) -> bool:
        """Whether there is a value at every preload."""
        return bool(np.isfinite(self.amplitude).all())

    @property
    def ok(self) -> bool:
        """Whether every preload has a value and the optimum is known to be the lowest in the range."""
        return self.complete and self.optimum.ok

    @property
    def interrupted(self) -> bool:
        """Whether Ctrl-C, or ``maximum``, ended the search, a check or the margins."""
        # files of version 0.6 have it in the reason
        if INTERRUPTED in self.optimum.status_text or self.checks_interrupted:
            return True
        if self.friction_range is not None and self.friction_range.interrupted:
            return True
        statuses = [response.status for response in self.time_response]
        statuses += [peak.status for peak in self.other_friction]
        statuses += [margins.best_status for margins in self.margins]
        if self.convergence is not None:
            statuses.append(self.convergence.status)
        return INTERRUPTED in statuses

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings: preloads without a value, and an optimum that is not verified."""
        texts = []
        # all preloads without a steady response have the status of the lowest preload
        not_steady = self.status_text[0] if self.lowest_steady_preload else ""
        if not_steady:
            texts.append(not_steady)
        for preload, status in zip(self.preload, self.status_text):
            if status not in (COMPLETE, not_steady):
                texts.append(f"{preload:.6g} N: {status}")
        best = self.optimum
        if end_text(self):
            texts.append(f"optimum: lowest amplitude {end_text(self)}")
        if best.kind != "flat" and not best.ok:
            uncertainty = f", {best.known_to}" if best.known_to else ""
            texts.append(f"optimum {best.status_text}{uncertainty}")
        return tuple(texts)

    @property
    def failures(self) -> tuple[str, ...]:
        """Descriptions of the failed checks; they begin the printed result.

        Empty if no check has failed, or if the amplitude does not depend on the preload.
        """
        return tuple(check.failure for check in failed(self))

    @property
    def error(self) -> Annotated[NDArray, Quantity()]:
        """Relative error (n,) of each amplitude, the sum of the sizes of both changes; NaN if one is
        unknown, or without estimates.
        """
        sizes = np.full(len(self), np.nan)
        if self.harmonic_change is not None:
            sizes = np.abs(self.harmonic_change)
        if self.vector_change is not None:
            sizes = sizes + np.abs(self.vector_change)
        return sizes

    def errors_at(self, preload: float) -> tuple[SourceError, ...]:
        """Return the errors of the amplitude at a computed preload (N); empty without estimates.

        Their frequencies are zero, because a curve has no changes of the frequency.
        """
        row = int(np.abs(self.preload - preload).argmin())
        errors = []
        for source, change, setting in (
            (HARMONICS, self.harmonic_change, "two more harmonics"),
            (VECTORS, self.vector_change, "six more residual modes"),
        ):
            if change is None:
                continue
            if np.isfinite(change[row]):
                errors.append(SourceError(source, float(change[row]), 0.0, 0.0, setting))
            else:
                against = f"with {setting}: study.estimate_errors(peak)"
                errors.append(SourceError(source, np.nan, np.nan, np.inf, against))
        return tuple(errors)

    @property
    def shift_percent(self) -> Annotated[NDArray, Quantity("%", name="frequency_shift")]:
        """Frequency (n,) relative to the free resonance, minus one, in per cent."""
        return 100.0 * (self.frequency / self.free.frequency - 1.0)

    @property
    def stuck_shift_percent(self) -> float:
        """Frequency shift of the stuck limit, in per cent."""
        return 100.0 * (self.stuck.frequency / self.free.frequency - 1.0)

    @property
    def ratio(self) -> float:
        """Ratio of the amplitude of the stuck limit to the amplitude at the optimum."""
        return self.stuck.amplitude / self.optimum.amplitude

    @property
    def near_best(self) -> tuple[float, float]:
        """Range of preloads (N) in which the amplitude is at most 1.2 times the amplitude at the
        optimum.

        The amplitudes are from harmonic balance.
        """
        return self.preloads_within(NEAR_BEST * self.optimum.amplitude)

    @property
    def range_in_time(self) -> tuple[TimeResponse, ...]:
        """Time responses at both ends of :attr:`near_best`; empty unless both were integrated."""
        if not np.isfinite(self.optimum.preload):
            return ()
        low, high = self.near_best
        at_low = self._integrated_at(low)
        at_high = self._integrated_at(high)
        if at_low is None or at_high is None:
            return ()
        return at_low, at_high

    def _integrated_at(self, preload: float) -> TimeResponse | None:
        """Return the time response at a preload, or None."""
        for response in self.time_response:
            if np.isclose(response.preload, preload, rtol=1e-6, atol=0.0):
                return response
        return None

    def preloads_within(self, amplitude: float) -> tuple[float, float]:
        """Return the preloads (N) around the optimum at which the amplitude (m) is not exceeded.

        The amplitudes are computed by harmonic balance, and interpolated between the preloads of
        the curve.

        Raises
        ------
        SettingError
            If the curve has no optimum, or if its amplitude is higher.
        """
        best = self.optimum
        validation.check(
            np.isfinite(best.preload), "preloads_within", "a curve with an optimum", best
        )
        limit = validation.number("amplitude", amplitude, least=best.amplitude, unit="m")
        amplitude_at = dict(zip(self.preload.tolist(), self.amplitude.tolist()))
        # from the optimum to both ends of the curve
        below = sorted((p for p in amplitude_at if p < best.preload), reverse=True)
        above = sorted(p for p in amplitude_at if p > best.preload)
        ends = []
        for outward in (below, above):
            preload = best.preload
            amplitude_here = best.amplitude
            for next_preload in outward:
                next_amplitude = amplitude_at[next_preload]
                # also if it is unknown (NaN): the range then ends at the last known preload
                if not next_amplitude <= limit:
                    share = 0.0
                    # linear in the logarithms of preload and amplitude
                    if next_amplitude > amplitude_here:
                        rise = np.log(next_amplitude / amplitude_here)
                        share = np.log(limit / amplitude_here) / rise
                    preload *= (next_preload / preload) ** share
                    break
                preload = next_preload
                amplitude_here = next_amplitude
            ends.append(float(preload))
        low, high = ends
        return low, high

    @property
    def optimum_in_time(self) -> TimeResponse | None:
        """Time response with the lowest upper bound of the amplitude; None if fewer than two exist."""
        known = [response for response in self.time_response if known_in_time(response)]
        # the lowest of several
        if len(known) < 2:
            return None
        return min(known, key=lambda response: response.largest)

    def peak_at(self, preload: float) -> Peak | None:
        """Return the highest peak at a preload (N) of the curve, without further computation.

        It has its unknowns and the errors of its amplitude, but no tangent.  The result is None if
        the preload has no value, or if the curve is stored without unknowns.
        """
        rows = np.flatnonzero(self.preload == preload)
        if not len(rows):
            return None
        row = int(rows[0])
        if self.status[row] != COMPLETE or not self.unknowns.shape[1]:
            return None
        frequency = float(self.frequency[row])
        y = np.append(self.unknowns[row], 2.0 * np.pi * frequency)
        half_range = np.nan
        if self.half_range is not None:
            half_range = float(self.half_range[row])
        return Peak(
            parameter=float(self.preload[row]),
            frequency=frequency,
            amplitude=float(self.amplitude[row]),
            y=y,
            tangent=np.zeros(len(y)),
            scale=np.ones(len(y)),
            slope=np.nan,
            curvature=np.nan,
            shares=self.shares[row],
            residual=float(self.residual[row]),
            iterations=0,
            trials=0,
            rank_deficiency=0,
            corner=self.kind[row] != "peak",
            search_status=COMPLETE,
            settings=self.settings,
            model_hash=self.model_hash,
            half_range=half_range,
            errors=self.errors_at(preload),
        )

    @property
    def recommended_preload(self) -> float:
        """Preload (N) with the lowest upper bound by time integration, otherwise the preload of the
        optimum.

        It is NaN if there is neither.
        """
        if self.optimum_in_time is not None:
            return self.optimum_in_time.preload
        return self.optimum.preload

    @property
    def recommended_response(self) -> TimeResponse | None:
        """Time response closest to the recommended preload, even if it has no amplitude, or None."""
        preload = self.recommended_preload
        if not np.isfinite(preload):
            return None

        def distance(response: TimeResponse) -> float:
            return float(abs(np.log(response.preload / preload)))

        return min(self.time_response, key=distance, default=None)

    @property
    def design_amplitude(self) -> float:
        """Largest amplitude (m) by time integration, more harmonics and other friction.

        NaN without time integration, after a failed check, or if the amplitude with one of the
        friction coefficients is unknown.
        """
        amplitude_by_check = checked_amplitudes(self)
        if not amplitude_by_check or failed(self):
            return float("nan")
        # NaN if one of them is
        return float(np.max(list(amplitude_by_check.values())))

    @property
    def detached(self) -> tuple[str, ...]:
        """Preload and highest point of each closed branch, in words; the optimum ignores them."""
        texts = []
        for curve in self.curves:
            for i in curve.detached:
                texts.append(f"at {curve.preload:.6g} N {curve.point_text(i, 'detached')}")
        return tuple(texts)

    def report(
        self,
        path: FilePath,
        study: StudyLike | Problem | None = None,
        *,
        fit: Recorded | None = None,
        disk: Recorded | None = None,
        project: str = "",
        author: str = "",
        date: str = "",
        model_file: str = "",
    ) -> Path:
        """Write one HTML file for a design review, with embedded pictures; return its path.

        The file has no links.  With a date it is reproducible byte by byte.

        Parameters
        ----------
        path : path-like
        study : Study, optional
            Study of this curve.  With it the report contains the bodies, the response at the
            optimum with contact states, the pressure at rest, hysteresis loops and sensitivities.
        fit : bdamper.analyses.fit_result.Fitted, optional
            Source of friction coefficient and contact stiffness.
        disk : DiskPeak or MistunedSample, optional
            Result of a mistuned bladed disk.
        project, author, date, model_file : str
            Texts for the beginning of the report; by default, the date is today.

        Returns
        -------
        pathlib.Path

        Raises
        ------
        BdamperError
            If the curve has no optimum or belongs to another study, the extra ``bdamper[report]``
            is missing, or the file cannot be written.
        """
        subject = {"project": project, "author": author, "date": date, "model_file": model_file}
        return cast(Path, draw(self, "report", path, study, fit, disk, **subject))

    def _statement(self) -> Statement:
        return statement(self)

    def _facts(self) -> tuple[Fact, ...]:
        best = self.optimum
        facts = [Fact("optimum", best.text)]
        # the amplitude is the first harmonic; others may add to the motion
        if exceeds(best.half_range, best.amplitude):
            facts.append(Fact("half of the range", best.half_range, "m"))
        return (*facts, *super()._facts())
