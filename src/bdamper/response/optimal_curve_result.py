"""Result of an optimal curve: resonance over the preload with its linear limits, its optimum and the curves behind it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from bdamper.fatigue.margin import MarginCurve
from bdamper.harmonic_balance.problem import Problem
from bdamper.harmonic_balance.result_checks import Asking
from bdamper.response.linear_limits import Limit
from bdamper.response.peak import NOT_IN_TIME
from bdamper.response.response_curve_result import ResponseCurve
from bdamper.response.verification import Convergence, TimeResponse
from bdamper.util import validation
from bdamper.util.display import Comparable, Plottable, draw
from bdamper.util.errors import COMPLETE, INCOMPLETE, INTERRUPTED, status_word
from bdamper.util.formatting import amount, loads_text, peak_text, percent, short_repr, span
from bdamper.util.progress import Cost
from bdamper.util.storage import FilePath, Recorded, Storable
from bdamper.util.tables import Hertz, Kinds, Metres, Newtons, Numbers, PerRow, Quantity, Resonance, Shares, Tabular

ENDS = {
    "end": "end of the range, the optimum may lie beyond",
    "edge": "lowest preload with a steady response",
}
NEAR_BEST = 1.2
"""Amplitude over the optimum that defines the printed range of acceptable preloads."""


@dataclass(frozen=True)
class OptimumPoint:
    """Preload of minimum resonance amplitude.

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
        "complete" if no preload without a value could replace it, and no tangents of the highest points at two neighbouring
        preloads indicate a lower value.  A lower value between distant preloads may still be missed.  Otherwise
        "incomplete", "interrupted" or "not found" with the reason after a colon.
    """

    preload: float
    amplitude: float
    frequency: float
    kind: str
    uncertainty: float
    status: str = COMPLETE

    def __post_init__(self) -> None:
        first, colon, reason = self.status.partition(":")  # files of version 0.6
        now = {"verified": COMPLETE, "not verified": INCOMPLETE}.get(first, first)
        object.__setattr__(self, "status", f"{now}{colon}{reason}")

    @property
    def verified(self) -> bool:
        """Whether the status is complete: no information indicates a lower value elsewhere."""
        return self.status == COMPLETE


@short_repr
@dataclass(frozen=True)
class OptimalCurve(Plottable, Comparable, Tabular, Recorded, Storable, kind="bdamper-optimal", row="preload"):
    """Resonance over preload.

    ``plot`` draws amplitude and frequency shift over the preload, as in Figs 8 and 9 of the paper
    (:func:`bdamper.plot.plot_optimal`).

    Parameters
    ----------
    preload : (n,) float, N
    amplitude : (n,) float, m
        Amplitude of the highest peak; NaN if none was found, or if the response curve is incomplete and may have a higher
        one.
    frequency : (n,) float, Hz
    shares : (n, 3) float
        Fractions of the cycle in stick, slip and separation at the peak, mean over the friction points.
    residual : (n,) float
    unknowns : (n, n_unknowns) float
    status : tuple of str
        "complete", with a note after a colon if an end of the interval is higher than all maxima; "incomplete: ..." with
        the omissions, or without a maximum; "not found: ..." with the reason.
    free, stuck : Limit
    optimum : OptimumPoint
    cost : Cost
        Total cost of curves, time integrations and peaks with more harmonics.
    settings : mapping
    model_hash : str
    lower_bound : (n,) float, m
        Highest response found at a preload without a value; NaN with a value, or if nothing was found.
    goes_on : (n,) bool
        Whether the highest points at this preload and the previous one are on one smooth branch, by their tangents.
    kind : tuple of str
        Kind of the highest point at each preload: "peak", "corner", "drift" or "fold"; empty without a value.
    convergence : Convergence or None
        Peak at the optimum with more harmonics.
    curves : tuple of ResponseCurve
        Complete curves of all values and of the search for the optimum, by ascending preload; coarse, and without unknowns.
    lowest_steady_preload : float, N
        Up to this preload the damper rattles and no steady periodic response is expected
        (:mod:`bdamper.response.response_curve`).  There are no values there, and no search below.  0 if there is no sign of
        it.
    margins : tuple of MarginCurve
        Margins against fatigue along the curve, if requested.
    time_response : tuple of TimeResponse
        Time integrations at the optimum and at the preloads of :meth:`bdamper.Study.with_time_response`.
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
    lowest_steady_preload: float = 0.0
    margins: tuple[MarginCurve, ...] = ()
    time_response: tuple[TimeResponse, ...] = ()
    _summary_fields = (
        "optimum", "time_response", "optimum_in_time", "convergence", "free", "stuck", "ratio", "stuck_shift_percent",
        "margins", "detached",
    )  # fmt: skip

    def __len__(self) -> int:
        return len(self.preload)

    @property
    def complete(self) -> bool:
        """Whether there is a value at every preload."""
        return bool(np.isfinite(self.amplitude).all())

    @property
    def interrupted(self) -> bool:
        """Whether the search was interrupted; the curve then contains the part computed so far."""
        return INTERRUPTED in self.optimum.status  # files of version 0.6 have it in the reason

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings: preloads without a value, and an optimum that is not verified."""
        low = self.status[0] if self.lowest_steady_preload else ""
        gone = [(p, s) for p, s in zip(self.preload, self.status) if s not in ("complete", low)]
        out = [low] * bool(low) + [f"{p:.6g} N: {s}" for p, s in gone]
        o = self.optimum
        if o.kind in ENDS:
            out.append(f"optimum: least value at the {ENDS[o.kind]}")
        if o.kind != "flat" and not o.verified:
            known = f", preload known to a relative {o.uncertainty:.2g}" if o.uncertainty > 1e-5 else ""
            out.append(f"optimum {o.status}{known}")
        return tuple(out)

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
        """Amplitude of the stuck limit over the amplitude of the optimum."""
        return self.stuck.amplitude / self.optimum.amplitude

    def preloads_within(self, amplitude: float) -> tuple[float, float]:
        """Return the range of preloads (N) around the optimum in which the amplitude is at most the given one (m).

        Raises
        ------
        SettingError
            If the curve has no optimum, or if its amplitude is higher.
        """
        best = self.optimum
        validation.check(np.isfinite(best.preload), "preloads_within", "a curve with an optimum", best)
        limit = validation.number("amplitude", amplitude, least=best.amplitude, unit="m")
        ends = []
        for step in (-1, 1):
            beyond = np.flatnonzero(step * (self.preload - best.preload) > 0.0)[::step]
            preload, before = best.preload, best.amplitude
            for p, a in zip(self.preload[beyond], self.amplitude[beyond]):
                if not a <= limit:  # also if unknown
                    share = np.log(limit / before) / np.log(a / before) if a > before else 0.0
                    preload *= (p / preload) ** share
                    break
                preload, before = p, a
            ends.append(float(preload))
        return ends[0], ends[1]

    @property
    def optimum_in_time(self) -> TimeResponse | None:
        """Time response with the least upper bound of the amplitude, of two or more preloads; otherwise None."""
        return min(self._known, key=lambda k: k.highest) if len(self._known) > 1 else None

    @property
    def _known(self) -> list[TimeResponse]:
        """Time responses with a range, even if it is wide."""
        return [k for k in self.time_response if np.isfinite(k.mean) and k.status != INTERRUPTED]

    @property
    def detached(self) -> tuple[str, ...]:
        """Highest points on closed branches of the curves, with their preloads; they do not count."""
        return tuple(
            f"at {curve.preload:.6g} N {curve.point_text(i, 'detached')}" for curve in self.curves for i in curve.detached
        )

    def report(self, path: FilePath, study: Asking | Problem | None = None, *, fit: Recorded | None = None) -> None:
        """Write one HTML file for a design review, with embedded pictures and without links; reproducible byte by byte.

        Parameters
        ----------
        path : path-like
        study : Study, optional
            Study of this curve.  With it the report contains the response at the optimum with contact states, hysteresis
            loops and sensitivities.
        fit : bdamper.analyses.fit_result.Fitted, optional
            Source of friction coefficient and contact stiffness.

        Raises
        ------
        BdamperError
            If the curve has no optimum or belongs to another study, the extra ``bdamper[report]`` is missing, or the file
            cannot be written.
        """
        draw(self, "report", path, study, fit)

    def _headline(self) -> str:
        o = self.optimum
        if not np.isfinite(o.preload):
            at = peak_text(o.amplitude, o.frequency)
            failed = [
                f"; at {amount(p, 'N')} {why}" for p, why in zip(self.preload, self.status) if status_word(why) != COMPLETE
            ]
            first = "".join(failed[:1])
            return f"The preload does not matter: {at}." if o.kind == "flat" else f"No optimum: {o.status}{first}."
        free = self.free.amplitude
        gain = f", {free / o.amplitude:.3g} times below the free blade ({amount(free, 'm')})" if np.isfinite(free) else ""
        force = self.settings.get("excitation", {}).get("amplitude", 0.0)
        shares = loads_text(self.settings.get("load_per_preload"))
        per = " per newton of excitation" if force == 1.0 else f" at {amount(force, 'N')} of excitation" if force else ""
        per = f" ({shares}){per}" if shares else per
        where = f"{amount(o.preload, 'N')} of preload{per}" + (f", {ENDS[o.kind]}" if o.kind in ENDS else "")
        out = [f"Optimum: {where}. Peak {peak_text(o.amplitude, o.frequency)}{gain}."]
        out += [self._in_time(response) for response in self.time_response] or [NOT_IN_TIME]
        near = span(*self.preloads_within(NEAR_BEST * o.amplitude), "N")
        out.append(f"Within {percent(NEAR_BEST - 1.0)} of the minimum from {near}.")
        out.append(self._recommended() if o.verified else f"The search for the optimum is {o.status}.")
        if self.convergence is not None:
            out.append(f"More harmonics: {self.convergence.verdict}.")
        return " ".join(filter(None, out))

    def _in_time(self, time_response: TimeResponse) -> str:
        """Return a sentence on the steady-state amplitude in time, compared with the harmonic balance."""
        at = "" if time_response.preload == self.optimum.preload else f" at {amount(time_response.preload, 'N')}"
        if not np.isfinite(time_response.mean):
            return time_response._headline()
        if status_word(time_response.status) != COMPLETE:
            return f"Time integration{at} gives {time_response.text}, {time_response.status}."
        more = 100.0 * (time_response.mean / time_response.balance - 1.0)
        change = f"{abs(more):.0f} % {'more' if more > 0.0 else 'less'}"
        alike = f" Blades do not vibrate alike: {span(*time_response.spread, 'm')}." if time_response.parted else ""
        return f"Time integration{at} gives {time_response.text}, {change} than harmonic balance.{alike}"

    def _recommended(self) -> str:
        """Return a sentence with the preload of least amplitude in time and the rise at half of the optimum."""
        best = float(f"{self.optimum.preload:.3g}")
        k = int(np.searchsorted(self.preload, 0.5 * best))
        rise = self.amplitude[k - 1 : k + 1] / self.optimum.amplitude if k else np.full(1, np.nan)
        lower = ""
        if rise.min() > 1.0:
            lower = f"at half the optimum the amplitude is {rise.min():.2g} to {rise.max():.2g} times higher"
        if not (least := self.optimum_in_time):
            why = "no preload is recommended, as the amplitude in time is not known at two"
            said = "; ".join(filter(None, (why if self.time_response else "", lower)))
            return f"{said[0].upper()}{said[1:]}." if said else ""
        beyond = {self._known[0].preload: "lower", self._known[-1].preload: "higher"}.get(least.preload, "")
        said = f"Recommended: {amount(least.preload, 'N')}, where the amplitude in time is least, at most "
        said += amount(least.highest, "m") + ("" if least.settled else f" ({least.status})")
        said += f"; it may be less at {beyond} preloads" if beyond else ""
        if not np.isclose(least.preload, self.optimum.preload):
            said += f"; harmonic balance alone has its minimum at {amount(self.optimum.preload, 'N')}"
        return f"{said}; {lower}." if lower else f"{said}."
