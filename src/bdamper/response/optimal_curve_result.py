"""The optimal curve as a result: resonance over preload with its limits, its optimum and what happened on the way."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from bdamper.fatigue.margin import MarginCurve
from bdamper.harmonic_balance.problem import Problem
from bdamper.harmonic_balance.result_checks import Asking
from bdamper.response.response_curve_result import NOT_IN_TIME, ResponseCurve
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
SAFE = (1.2, 1.5)
"""Preloads to build, over the optimum: the amplitude rises steeply below it and slowly above."""
NEAR_BEST = 1.2
"""Amplitude over that of the optimum up to which a range of preloads is printed: what a designer may give away."""


@dataclass(frozen=True)
class Limit:
    """Linear resonance without contact ("free") or with all closed points stuck.

    Parameters
    ----------
    frequency : float, Hz
    amplitude : float, m
    """

    frequency: float
    amplitude: float


@dataclass(frozen=True)
class OptimumPoint:
    """Preload of the least resonance amplitude.

    Parameters
    ----------
    preload : float, N
        NaN if the curve is flat, or no preload has a value.
    amplitude : float, m
    frequency : float, Hz
    kind : {"smooth", "crossing", "jump", "end", "edge", "unknown", "flat", "none"}
        Zero derivative; two peaks of equal height; the end of a higher peak, with the least amplitude as the limit from
        the side on which it is gone; the end of the range of preloads, or of those with a value; the edge below which
        no response is steady; not known, as where the search was interrupted; none, since the preload does not matter
        (nothing slips, or all of it is bonded), or since no preload has a value.
    uncertainty : float
        Relative, of the preload.
    status : str
        "complete" if no preload without a value could take its place, and the tangents of the highest points at two
        neighbouring preloads nowhere lead below it; a lower value that no tangent leads to may still be missed between
        preloads far apart.  Otherwise "incomplete", "interrupted" or "not found" with the reason after a colon.
    """

    preload: float
    amplitude: float
    frequency: float
    kind: str
    uncertainty: float
    status: str = COMPLETE

    def __post_init__(self) -> None:
        first, colon, reason = self.status.partition(":")  # of files of version 0.6
        now = {"verified": COMPLETE, "not verified": INCOMPLETE}.get(first, first)
        object.__setattr__(self, "status", f"{now}{colon}{reason}")

    @property
    def verified(self) -> bool:
        """Whether it is complete: nothing known says that a lower value is elsewhere."""
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
        Of the highest peak; NaN where none was found, and where the response over frequency was not followed to its ends,
        so that there may be a higher one.
    frequency : (n,) float, Hz
    shares : (n, 3) float
        Stick, slip and open at the peak, mean over the friction points and the cycle.
    residual : (n,) float
    unknowns : (n, n_unknowns) float
    status : tuple of str
        "complete", with a colon where an end of the interval is higher than all maxima; "incomplete: ..." with what was not
        followed, or where there is no maximum; "not found: ..." with the reason.
    free, stuck : Limit
    optimum : OptimumPoint
    cost : Cost
        Of the whole answer: the curves, the marches in time and the peaks with more harmonics.
    settings : mapping
    model_hash : str
    lower_bound : (n,) float, m
        Highest response found at a preload without a value, NaN where there is a value or nothing was found.
    goes_on : (n,) bool
        Whether the highest point lies on one smooth branch with that of the preload before, by their tangents.
    kind : tuple of str
        Of the highest point at each preload: "peak", "corner", "drift" or "fold"; empty without a value.
    convergence : Convergence or None
        The peak at the optimum with more harmonics.
    curves : tuple of ResponseCurve
        The whole curves that the values are from, and those between them that the search for the optimum took, by rising
        preload; followed coarsely, and without their unknowns.
    lowest_steady_preload : float, N
        No steady periodic response is expected up to this preload, by the sign of
        :mod:`bdamper.response.response_curve`: the damper rattles.  There are no values there and nothing was searched
        below; 0 where nothing shows it.
    margins : tuple of MarginCurve
        Margins against fatigue along the curve, where they were asked for.
    time_response : tuple of TimeResponse
        Marches in time at the optimum, and wherever :meth:`bdamper.Study.with_time_response` was asked.
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
        """Whether the search was interrupted: the curve holds what was known by then."""
        return INTERRUPTED in self.optimum.status  # which files of version 0.6 have in the reason

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings: preloads without a value, an optimum that is not verified."""
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
        """(n,) float: frequency relative to that of the free resonance, in per cent."""
        return 100.0 * (self.frequency / self.free.frequency - 1.0)

    @property
    def stuck_shift_percent(self) -> float:
        """Shift of the stuck limit."""
        return 100.0 * (self.stuck.frequency / self.free.frequency - 1.0)

    @property
    def ratio(self) -> float:
        """Amplitude of the stuck limit over that of the optimum."""
        return self.stuck.amplitude / self.optimum.amplitude

    def preloads_within(self, amplitude: float) -> tuple[float, float]:
        """The range of preloads (N) around the optimum in which the amplitude is at most the given one (m).

        Raises
        ------
        SettingError
            If the curve has no optimum, or that is higher.
        """
        best = self.optimum
        validation.check(np.isfinite(best.preload), "preloads_within", "a curve with an optimum", best)
        limit = validation.number("amplitude", amplitude, least=best.amplitude, unit="m")
        ends = []
        for step in (-1, 1):
            beyond = np.flatnonzero(step * (self.preload - best.preload) > 0.0)[::step]
            preload, before = best.preload, best.amplitude
            for p, a in zip(self.preload[beyond], self.amplitude[beyond]):
                if not a <= limit:  # above it, or not known
                    share = np.log(limit / before) / np.log(a / before) if a > before else 0.0
                    preload *= (p / preload) ** share
                    break
                preload, before = p, a
            ends.append(float(preload))
        return ends[0], ends[1]

    @property
    def optimum_in_time(self) -> TimeResponse | None:
        """The least amplitude in time among complete marches at several preloads; None of fewer than two."""
        return min(self._known, key=lambda k: k.mean) if len(self._known) > 1 else None

    @property
    def _known(self) -> list[TimeResponse]:
        """Marches that leave nothing open."""
        return [k for k in self.time_response if np.isfinite(k.mean) and status_word(k.status) == COMPLETE]

    @property
    def detached(self) -> tuple[str, ...]:
        """Highest points on closed branches of the curves, with their preloads; they do not count."""
        return tuple(f"at {curve.preload:.6g} N {fold}" for curve in self.curves for fold in curve.detached)

    def report(self, path: FilePath, study: Asking | Problem | None = None, *, fit: Recorded | None = None) -> None:
        """Write one HTML file for a design review: pictures inside, no links, the same bytes for the same results.

        Parameters
        ----------
        path : path-like
        study : Study, optional
            Of this curve: with it the response at the optimum is followed and its contact states, loops and sensitivities
            are computed.
        fit : bdamper.analyses.fit.Fitted, optional
            Where friction and contact stiffness come from.

        Raises
        ------
        BdamperError
            If the curve has no optimum, is not of this study, the extra ``bdamper[report]`` is missing, or the file cannot
            be written.
        """
        draw(self, "report", path, study, fit)

    def _headline(self) -> str:
        o = self.optimum
        if not np.isfinite(o.preload):
            at = peak_text(o.amplitude, o.frequency)
            at_preloads = zip(self.preload, self.status)
            failed = [f"; at {amount(p, 'N')} {why}" for p, why in at_preloads if status_word(why) != COMPLETE]
            first = "".join(failed[:1])
            return f"The preload does not matter: {at}." if o.kind == "flat" else f"No optimum: {o.status}{first}."
        free = self.free.amplitude
        gain = f", {free / o.amplitude:.3g} times below the free blade ({amount(free, 'm')})" if np.isfinite(free) else ""
        force, shares = (
            self.settings.get("excitation", {}).get("amplitude", 0.0),
            loads_text(self.settings.get("load_per_preload")),
        )
        per = " per newton of excitation" if force == 1.0 else f" at {amount(force, 'N')} of excitation" if force else ""
        per = f" ({shares}){per}" if shares else per
        where = f"{amount(o.preload, 'N')} of preload{per}" + (f", {ENDS[o.kind]}" if o.kind in ENDS else "")
        out = [f"Optimum: {where}. Peak {peak_text(o.amplitude, o.frequency)}{gain}."]
        out += [self._said_of(kept) for kept in self.time_response] or [NOT_IN_TIME]
        if least := self.optimum_in_time:
            last = least in (self._known[0], self._known[-1])
            beyond = ", the last preload on that side: it may be lower beyond" if last else ""
            out.append(f"In time the amplitude is lowest at {amount(least.preload, 'N')}{beyond}.")
        near = span(*self.preloads_within(NEAR_BEST * o.amplitude), "N")
        out.append(f"Within {percent(NEAR_BEST - 1.0)} of the minimum from {near}.")
        out.append(self._recommended() if o.verified else f"The search for the optimum is {o.status}.")
        if self.convergence is not None:
            out.append(f"More harmonics: {self.convergence.verdict}.")
        return " ".join(filter(None, out))

    def _said_of(self, time_response: TimeResponse) -> str:
        """The steady-state amplitude in time, beside that of the harmonic balance."""
        at = "" if time_response.preload == self.optimum.preload else f" at {amount(time_response.preload, 'N')}"
        if not np.isfinite(time_response.mean):
            return time_response._headline()
        if status_word(time_response.status) != COMPLETE:
            return f"Time integration{at} gives {time_response.text}, {time_response.status}."
        more = 100.0 * (time_response.mean / time_response.balance - 1.0)
        change = f"{abs(more):.0f} % {'more' if more > 0.0 else 'less'}"
        alike = f" Blades do not vibrate alike: {span(*time_response.spread, 'm')}." if time_response.parted else ""
        return f"Time integration{at} gives {amount(time_response.mean, 'm')} ({change}).{alike}"

    def _recommended(self) -> str:
        """The preloads to build, and the rise of the amplitude to the preloads on either side of half the optimum."""
        best, text = float(f"{self.optimum.preload:.3g}"), ""
        k = int(np.searchsorted(self.preload, 0.5 * best))
        rise = self.amplitude[k - 1 : k + 1] / self.optimum.amplitude if k else np.full(1, np.nan)
        if rise.min() > 1.0:
            text = f"; at half the optimum the amplitude is {rise.min():.2g} to {rise.max():.2g} times higher"
        known = np.isfinite(self.amplitude[self.preload > 1.001 * best][:1]).all()
        said = f"Recommended: {span(SAFE[0] * best, SAFE[1] * best, 'N')}{text}."
        return said if known and self.optimum.kind != "end" else ""
