"""The optimal curve as a result: resonance over preload with its limits, its optimum and what happened on the way."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bdamper.continuation.curve import Curve
from bdamper.fatigue.margin import MarginCurve
from bdamper.util import validate
from bdamper.util.cost import Cost
from bdamper.util.differences import Comparable
from bdamper.util.estimates import ErrorEstimates, error_line
from bdamper.util.experience import richer
from bdamper.util.hdf5 import Recorded, Storable
from bdamper.util.kept import Kept
from bdamper.util.ladder import Ladder
from bdamper.util.plotting import Fact, Plottable
from bdamper.util.repr import brief
from bdamper.util.status import COMPLETE, INCOMPLETE, INTERRUPTED, Statuses, Translated, because, word
from bdamper.util.tables import Hertz, Kinds, Metres, Newtons, Numbers, Quantity, Resonance, Shares, Tabular
from bdamper.util.text import amount, height

ENDS = {
    "end": "end of the range, the optimum may lie beyond",
    "edge": "lowest preload with a steady response",
}
COARSE = 1e-5
"""Relative uncertainty of the preload of an optimum from which on it is told."""
NEAR_BEST = 1.2
"""Amplitude over that of the optimum up to which a range of preloads is printed: what a designer may give away."""


class _OfOptimum(Translated):
    """Of an optimum: one of versions before 0.3 is "converged", which tells of the search alone."""

    def read(self, value: str | tuple[str, ...]) -> str | tuple[str, ...]:
        return because(INCOMPLETE, "no tracking curve was compared") if value == "converged" else super().read(value)


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


class Swept(NamedTuple):
    """Highest amplitudes that slow sweeps of frequency meet at one preload, by its tracking curve.

    Parameters
    ----------
    preload : float, N
    up, down : float, m
        Of the sweep to higher and to lower frequencies; NaN where no stable solution is known at its start.
    up_frequency, down_frequency : float, Hz
    status : str
        Of the tracking curve.
    """

    preload: float
    up: float
    up_frequency: float
    down: float
    down_frequency: float
    status: str

    def __str__(self) -> str:
        up, down = f"{self.up:.4g} m at {self.up_frequency:.6g} Hz", f"{self.down:.4g} m at {self.down_frequency:.6g} Hz"
        return f"{self.preload:.6g} N: up {up}, down {down}" + (f", {self.status}" if self.status != "complete" else "")


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
    status: Annotated[str, _OfOptimum()] = COMPLETE

    @property
    def verified(self) -> bool:
        """Whether it is complete: nothing known says that a lower value is elsewhere."""
        return self.status == COMPLETE

    @property
    def interrupted(self) -> bool:
        """Whether the search was interrupted; files of versions before 0.6 say so in the reason."""
        return INTERRUPTED in self.status

    def __str__(self) -> str:
        if self.kind == "flat":
            return f"no optimum: flat, {self.amplitude:.6g} m at {self.frequency:.6g} Hz at every preload"
        if self.kind == "none":
            return f"no optimum, {self.status}"
        what = ENDS.get(self.kind, "so far" if self.interrupted else self.kind)
        name = "optimum" if self.verified and self.kind not in ENDS else "least"
        known = f"; preload known to a relative {self.uncertainty:.2g}" if self.uncertainty > COARSE else ""
        place = f"{self.amplitude:.6g} m at {self.preload:.7g} N, {self.frequency:.6g} Hz"
        return f"{name} {place} ({what}), {self.status}{known}"


@brief
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
    rank_deficiency : (n,) int
    unknowns : (n, n_unknowns) float
    status : tuple of str
        "complete", with a colon where an end of the interval is higher than all maxima; "incomplete: ..." with what was not
        followed, or where there is no maximum; "not found: ..." with the reason.
    free, stuck : Limit
    optimum : OptimumPoint
    cost : Cost
    settings : mapping
    model_hash : str
    error_estimates : ErrorEstimates or None
        Of the peak at the optimum, by source, where they were asked for.
    ladder : Ladder or None
        What more harmonics would change of the optimum, and of the amplitude at some other preloads.
    lower_bound : (n,) float, m
        Highest response found at a preload without a value, NaN where there is a value or nothing was found (everywhere in
        files of versions before 0.3).
    goes_on : (n,) bool
        Whether the highest point lies on one smooth branch with that of the preload before, by their tangents.
    kind : tuple of str
        Of the highest point at each preload: "peak", "corner", "drift" or "fold"; empty without a value.
    curves : tuple of Curve
        The whole curves that the values are from, and those between them that the search for the optimum took, by rising
        preload; followed coarsely, and without their unknowns.
    detached : tuple of str
        Highest points on closed branches, which do not count.
    no_steady_below : float, N
        No steady periodic response is expected up to this preload, by the sign of :mod:`bdamper.continuation.rattle`: the
        damper rattles.  There are no values there and nothing was searched below; 0 where nothing shows it.
    swept : tuple of Swept
        What :meth:`bdamper.Study.with_sweeps` has found at some preloads.
    margins : tuple of MarginCurve
        Margins against fatigue along the curve, where they were asked for.
    kept : tuple of Kept
        What a blade keeps by a march in time at the optimum, and wherever :meth:`bdamper.Study.with_kept` was asked.
    """

    preload: Newtons
    amplitude: Resonance
    frequency: Hertz
    shares: Shares
    residual: Numbers
    rank_deficiency: NDArray
    unknowns: NDArray
    status: Annotated[Statuses, Quantity()]
    free: Limit
    stuck: Limit
    optimum: OptimumPoint
    cost: Cost
    error_estimates: ErrorEstimates | None = None
    ladder: Ladder | None = None
    lower_bound: Metres = field(default_factory=lambda: np.empty(0))
    goes_on: NDArray = field(default_factory=lambda: np.empty(0, bool))
    kind: Kinds = ()
    curves: tuple[Curve, ...] = ()
    detached: tuple[str, ...] = ()
    no_steady_below: float = 0.0
    swept: tuple[Swept, ...] = ()
    margins: tuple[MarginCurve, ...] = ()
    kept: tuple[Kept, ...] = ()

    def __post_init__(self) -> None:
        if not self.goes_on.size:
            object.__setattr__(self, "goes_on", np.append(False, np.isfinite(self.amplitude[1:] + self.amplitude[:-1])))
        if not self.kind:
            object.__setattr__(self, "kind", tuple("peak" if np.isfinite(a) else "" for a in self.amplitude))
        if not self.lower_bound.size:
            object.__setattr__(self, "lower_bound", np.full(len(self.preload), np.nan))

    def __len__(self) -> int:
        return len(self.preload)

    @property
    def complete(self) -> bool:
        """Whether there is a value at every preload."""
        return bool(np.isfinite(self.amplitude).all())

    @property
    def interrupted(self) -> bool:
        """Whether the search was interrupted: the curve holds what was known by then."""
        return self.optimum.interrupted

    @property
    def warnings(self) -> tuple[str, ...]:
        """What the curve and its optimum leave open: preloads without a value, an optimum that is not verified."""
        low = self.status[0] if self.no_steady_below else ""
        gone = [(p, s) for p, s in zip(self.preload, self.status) if s not in ("complete", low)]
        out = [low] * bool(low) + [f"{p:.6g} N: {s}" for p, s in gone]
        o = self.optimum
        if o.kind in ENDS:
            out.append(f"optimum: least value at the {ENDS[o.kind]}")
        if o.kind != "flat" and not o.verified:
            known = f", preload known to a relative {o.uncertainty:.2g}" if o.uncertainty > COARSE else ""
            out.append(f"optimum {o.status}{known}")
        return tuple(out)

    @property
    def best(self) -> int | None:
        """Number of the preload with the least value, None where one without a value could be lower or none has one."""
        if not np.isfinite(self.amplitude).any():
            return None
        k = int(np.nanargmin(self.amplitude))
        open_ = ~np.isfinite(self.amplitude) & (self.preload > self.no_steady_below)
        return None if np.any(open_ & ~(self.lower_bound >= self.amplitude[k])) else k

    @property
    def shift_percent(self) -> Annotated[NDArray, Quantity("%", name="frequency_shift")]:
        """(n,) float: frequency relative to that of the free resonance, in percent."""
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
        validate.require(np.isfinite(best.preload), "preloads_within", "a curve with an optimum", best)
        limit = validate.number("amplitude", amplitude, least=best.amplitude, unit="m")
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
    def maxima(self) -> tuple[tuple[float, float], ...]:
        """Preload (N) and amplitude (m) of all maxima of the curves, the highest ones and those below them."""
        kinds = [(c, np.array([kind == "maximum" for kind in c.point_kind], bool)) for c in self.curves]
        return tuple((c.preload, float(a)) for c, marked in kinds for a in c.amplitude[marked])

    @property
    def least_kept(self) -> Kept | None:
        """Of the preloads whose march in time is complete that at which a blade keeps least; None of fewer than two."""
        return min(self._known, key=lambda k: k.mean) if len(self._known) > 1 else None

    @property
    def _known(self) -> list[Kept]:
        """What a blade keeps where nothing is left open about it."""
        return [k for k in self.kept if np.isfinite(k.mean) and word(k.status) == COMPLETE]

    def facts(self) -> tuple[Fact, ...]:
        """The optimum and how far it is verified, and the limits without contact and with all closed points stuck."""
        o, bad = self.optimum, int(np.count_nonzero(~np.isfinite(self.amplitude)))
        gone = f", {bad} without a value" if bad else ""
        best = [
            Fact("optimum preload" if o.verified else "preload of the least value", o.preload, "N"),
            Fact("amplitude there", o.amplitude, "m"),
            Fact("frequency there", o.frequency, "Hz"),
        ]  # fmt: skip
        return (
            Fact("optimal curve", f"{self.preload[0]:g} to {self.preload[-1]:g} N, {len(self)} points{gone}"),
            *(best if np.isfinite(o.preload) else []),
            Fact("optimum is", f"{o.kind}, {o.status}"),
            *(Fact("a blade keeps", k.text) for k in self.kept if k.preload == o.preload),
            *(Fact("least is kept", f"at {amount(k.preload, 'N')}, {k.text}") for k in (self.least_kept,) if k),
            *(Fact("by experience", line) for line in richer(self.settings)[:1]),
            *([] if self.ladder is None else [Fact("harmonics", self.ladder.note)]),
            *([] if self.error_estimates is None else [Fact("error", error_line(self.error_estimates))]),
            Fact("free amplitude", self.free.amplitude, "m"),
            Fact("free frequency", self.free.frequency, "Hz"),
            Fact("stuck amplitude", self.stuck.amplitude, "m"),
            Fact("stuck frequency", self.stuck.frequency, "Hz"),
        )

    def bottom_line(self) -> str:
        o, at = self.optimum, height(self.optimum.amplitude, self.optimum.frequency)
        if not np.isfinite(o.preload):
            return f"The preload does not matter: {at}." if o.kind == "flat" else f"No optimum: {o.status}."
        gain = f", {self.free.amplitude / o.amplitude:.3g} times less than without contact"
        gain = f"{gain} ({amount(self.free.amplitude, 'm')})" if np.isfinite(self.free.amplitude) else ""
        where = f"a preload of {amount(o.preload, 'N')}" + (f", the {ENDS[o.kind]}" if o.kind in ENDS else "")
        out = [f"Least resonance at {where}: {at}{gain}."]
        out += [self._said_of(kept) for kept in self.kept]
        if least := self.least_kept:
            beyond = ", the last on its side: less may be kept beyond" if least in (self._known[0], self._known[-1]) else ""
            out.append(f"Of the preloads where it is known a blade keeps least at {amount(least.preload, 'N')}{beyond}.")
        low, high = self.preloads_within(NEAR_BEST * o.amplitude)
        limit = amount(NEAR_BEST * o.amplitude, "m")
        out.append(f"From {amount(low, 'N')} to {amount(high, 'N')} it stays below {limit}.")
        if not o.verified:
            out.append(f"The search for the optimum is {o.status}.")
        if self.ladder is not None and not self.ladder.converged:
            out.append(f"Harmonics: {self.ladder.note}.")
        unknown = () if self.error_estimates is None else self.error_estimates.unknown
        return " ".join([*out, *([f"Not checked: {', '.join(unknown)}."] if unknown else [])])

    def _said_of(self, kept: Kept) -> str:
        """What a blade keeps, beside the amplitude of the balance."""
        numbers = self.settings.get("harmonics", ())
        of = f"{amount(kept.balance, 'm')} with {len(numbers)} harmonic{'s' if len(numbers) != 1 else ''}"
        at = "" if kept.preload == self.optimum.preload else f"At {amount(kept.preload, 'N')} "
        doubt = f", {kept.status}" if word(kept.status) != COMPLETE else ""
        return f"{at}{of}; a blade keeps {kept.text}{doubt}." if np.isfinite(kept.mean) else kept.bottom_line()

    def details(self) -> str:
        bad = int(np.count_nonzero(~np.isfinite(self.amplitude)))
        jumps = int(np.count_nonzero(~self.goes_on[1:] & np.isfinite(self.amplitude[1:] + self.amplitude[:-1])))
        lines = [
            f"optimal curve, {self.preload[0]:g} to {self.preload[-1]:g} N: {len(self)} points"
            + (f", {bad} without a value" if bad else ""),
            f"  {self.optimum}",
            f"  {error_line(self.error_estimates)}",
            f"  free {self.free.amplitude:.6g} m at {self.free.frequency:.6g} Hz, stuck {self.stuck.amplitude:.6g} m at "
            f"{self.stuck.frequency:.6g} Hz: ratio {self.ratio:.3g}, shift {self.stuck_shift_percent:.3g} %",
            f"  {len(self.curves) or len(self)} curves, {jumps} jumps; {self.cost.seconds:.3f} s, "
            f"{self.cost.iterations} iterations",
            *(f"  detached at {item}" for item in self.detached),
        ]
        if self.ladder is not None:
            note, *table = self.ladder.details().split("\n")
            high = self.ladder.range[1]
            if high > self.optimum.amplitude:
                below, above = self.preloads_within(high)
                note += f"\n  from {below:.4g} to {above:.4g} N the amplitude is at most {high:.4g} m"
            lines += [f"  {line}" for line in (note, *table)]
        if self.no_steady_below:
            lines.append(f"  {self.status[0]}")
        lines += [f"  {line}" for line in richer(self.settings)]
        lines += [f"  slow sweeps at {item}" for item in self.swept]
        lines += [f"  {line}" for item in self.kept for line in item.details().split("\n")]
        for item in self.margins:
            best = f"largest {item.best_margin:.4g} at {item.best_value:.6g} N, {item.best_status}"
            lines.append(f"  margin against fatigue ({item.rule}): {best}")
            lines += [f"    {line}" for line in item.kept_lines]
        told = self.status[0] if self.no_steady_below else None
        open_ = [w for w in self.warnings if w != told and not w.startswith("optimum")]
        if open_:
            lines.append(f"  {len(open_)} preloads with a warning, first {open_[0]}")
        return "\n".join(lines)
