"""The highest peak of a wheel: a search on the reduced wheel, its best peaks corrected on the whole one.

The worst blade's peak is not that of the tuned wheel followed into mistuning, which loses it too often.  The search
(:mod:`bdamper.mistuning.peak_search`) sweeps the band of the tuned wheel's waves (:mod:`bdamper.mistuning.peak_search`)
with dampers held by springs, climbs to the peaks of single blades from its highest maxima, and frees the dampers of all
that may be the highest. Large blades are reduced to the shapes that matter there (:mod:`bdamper.mistuning.peak_search`);
the peaks that may be the highest are then found anew on the whole wheel, and what that changes is part of the error.

A peak need not be what a blade keeps: the curve of a lumped wheel of six blades (300 N,
``tests/mistuning/test_in_time.py``) goes on from its first maximum of 2.2 mm through some ninety folds to others of 5.4 to
12 mm; in time it keeps the first, and falls from those that were marched within a hundred periods
(``BladedDisk.time_response``).

The highest peak of a wheel as a result.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from itertools import product
from math import tau
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from bdamper.mistuning.peak_search import FAR, SHAPES, WEAKER, Climbed, Search, band, close, family_shapes, reduced_state
from bdamper.mistuning.wheel_equations import WheelSystem
from bdamper.mistuning.wheel_problem import WheelProblem, wheel_system
from bdamper.model.structure import Model
from bdamper.response.peak import Peak
from bdamper.util import errors as status
from bdamper.util import validation
from bdamper.util.display import Plottable, draw
from bdamper.util.errors import COMPLETE, HELD
from bdamper.util.formatting import amount, peak_text, short_repr
from bdamper.util.progress import Cost, CostMeter, one_thread
from bdamper.util.storage import Recorded, Storable

# ---- The highest peak of a wheel as a result ----


@short_repr
@dataclass(frozen=True)
class WheelPeak(Plottable, Recorded, Storable, kind="bdamper-wheel-peak"):
    """The highest amplitude of any blade of a wheel at one preload.

    ``plot`` draws bars over the blades (:func:`bdamper.plot.plot_wheel_peak`).

    Parameters
    ----------
    preload : float, N
    frequency : float, Hz
    amplitude : float, m
        Of the first harmonic; NaN if no peak was found.
    blade : int
        The highest one, -1 if no peak was found.
    tuned_amplitude : float, m
        Of the highest peak of the tuned wheel at the same preload and engine order.
    response : (n_blades, n_harmonics + 1) complex, m
        Of all blades there, the mean first.
    climbs : (n, 5) float
        Of every peak found by a local search: blade, frequency (Hz) and amplitude (m) with the mean of dampers held as in
        the sweep; the weakest springs with which it was found, and its amplitude (m) then.
    sweep_frequency : (n,) float, Hz
        Of the coarse sweep's solutions.
    status, reason : str
        "complete"; "held" if the peak was found only with springs on the mean of dampers or on the reduced wheel;
        "incomplete", a lower bound, if the sweep leaves out a part of its band or no blade is as high as those of the tuned
        wheel, as the reason says; or "not found".
    residual : float
    unknowns : (n_blades, n_coefficients, n_sector) float
    springs : float
        On the mean of dampers, relative to their stiffness when stuck; 0 where dampers are free.
    error : float
        Estimate of how much higher the highest peak with free dampers may be, relative: from what weaker springs have
        changed, what the reduced wheel of the search is off the whole one, and what local searches may have missed; 0 where
        dampers are free and all maxima of the sweep were examined.
    interval : (low, high), Hz
        Band of the sweep.
    cost : Cost
    settings : mapping
        Of the tuned study, with the frequency deviations of the blades.
    model_hash : str
    """

    preload: float
    frequency: float
    amplitude: float
    blade: int
    tuned_amplitude: float
    response: NDArray
    climbs: NDArray
    sweep_frequency: NDArray
    status: str
    reason: str
    residual: float
    unknowns: NDArray
    springs: float = 0.0
    error: float = 0.0
    interval: tuple[float, float] = (np.nan, np.nan)
    cost: Cost = field(default_factory=Cost)
    _summary_fields = ("status", "amplitude", "frequency", "blade", "amplification", "error", "springs")

    @property
    def converged(self) -> bool:
        """With dampers free."""
        return self.status == COMPLETE

    @property
    def found(self) -> bool:
        """Complete or held."""
        return self.status in (COMPLETE, HELD)

    @property
    def amplification(self) -> float:
        """Amplitude over that of the tuned wheel's peak."""
        return self.amplitude / self.tuned_amplitude

    @property
    def amplitudes(self) -> NDArray:
        """(n_blades,) float, m: of all blades at the peak."""
        return np.abs(self.response[:, 1])

    @property
    def nodal_diameters(self) -> NDArray:
        """(n_blades,) float, m: amplitudes of the waves of 0 to N - 1 nodal diameters in the first harmonic."""
        return np.asarray(np.abs(np.fft.fft(self.response[:, 1])) / len(self.response))

    def plot_wheel(self, model: Model, *arguments: Any, **options: Any) -> Any:
        """Draw the wheel from the front, blades coloured by their amplitude (:func:`bdamper.plot.plot_wheel`)."""
        return draw(self, "plot_wheel", model, *arguments, **options)

    def _headline(self) -> str:
        if not np.isfinite(self.amplitude):
            return f"No peak of the wheel at a preload of {amount(self.preload, 'N')}: {self.reason}."
        top = peak_text(self.amplitude, self.frequency)
        tuned = f"{self.amplification:.3g} times the tuned wheel ({amount(self.tuned_amplitude, 'm')})"
        open_ = "" if self.converged else f" {self.status.capitalize()}: {self.reason}."
        head = f"Highest of {len(self.response)} blades at a preload of {amount(self.preload, 'N')}"
        return f"{head}: number {self.blade}, {top}, {tuned}.{open_}"


# ---- The highest peak of a wheel ----


MISSED = 0.045
"""How much higher a peak may be that no climb has reached, where the sweep has more maxima than were climbed: of 188
searches with three times as many attempts those that found more than any other error covers found 2.0, 2.1, 3.4 and 4.3 %
(docs/measured.md, "Peaks of mistuned wheels")."""


@validation.check_arguments
@dataclass(frozen=True)
class WheelPeakOptions(validation.Checked):
    """Settings of the search for the highest peak.

    Parameters
    ----------
    spacing : float
        Of the points of the sweep, relative to the width of the tuned peak at half its power.
    climbs : int
        Local searches, one for each peak.  Eight from 30 points take 15 % fewer evaluations than twelve from 60, and miss
        peaks by more than 1 % that these find in 124 of 723 searches on 65 blades, and find more in 73 (docs/measured.md,
        "Peaks of mistuned wheels").
    least, most : int
        Points of the sweep.
    """

    spacing: Annotated[float, validation.Limits(above=0.0, most=10.0)] = 0.5
    climbs: validation.Count = 12
    least: validation.Count = 60
    most: validation.Count = 300


@dataclass(frozen=True)
class _Equations:
    """Equations of the search, and how their points become those of the whole wheel.

    Parameters
    ----------
    whole, system : WheelSystem
        The same where nothing is reduced.
    shapes : (n, m) float or None
        Of the reduced blades.
    mean : (n_blades, n) float, m
        Static state of the blades, from which they move in their shapes.
    """

    whole: WheelSystem
    system: WheelSystem
    shapes: NDArray | None
    mean: NDArray

    @classmethod
    def of(cls, wheel: WheelProblem, preload: float) -> _Equations:
        whole, s = wheel.system(preload), wheel.structure
        state, n = wheel.state(preload), s.n
        omega = tau * wheel.tuned_peak(preload).frequency
        large = n > SHAPES + 1 and wheel.structure.tuned.settings.bias
        shapes = family_shapes(s, omega) if large else None
        if shapes is None or not close(s, shapes, omega):
            return cls(whole, whole, None, state.mean[:, :n])
        excitation = np.hstack([wheel.excitation[:, :n] @ shapes, wheel.excitation[:, n:]])
        system = wheel_system(s.reduced(shapes), reduced_state(s, state, shapes), excitation, wheel.response_row @ shapes)
        return cls(whole, system, shapes, state.mean[:, :n])

    def expanded(self, y: NDArray) -> NDArray:
        """A point of the whole wheel from one of the search."""
        if self.shapes is None:
            return y
        X, m = self.system.structure.array(y[:-1]), self.shapes.shape[1]
        U = X[..., :m] @ self.shapes.T
        U[:, 0] += self.mean
        return np.append(self.whole.structure.flat(np.concatenate([U, X[..., m:]], axis=2)), y[-1])


@validation.check_arguments
@one_thread
def peak(
    wheel: WheelProblem,
    preload: float,
    frequency: tuple[float, float] | None = None,
    *,
    options: WheelPeakOptions | None = None,
) -> WheelPeak:
    """Highest amplitude of any blade at a preload.

    Parameters
    ----------
    wheel : BladedDisk
    preload : float, N
    frequency : (low, high), Hz, optional
        Of the sweep; ``bdamper.mistuning.peak_search.band`` by default, and where no blade has a peak in it up to 1.5
        times the tuned peak's: a lumped wheel of six blades (engine order 2, 300 N) vibrates at 295 Hz with its dampers
        held, 13 Hz above that band, and its peak of 230 Hz lies on a branch that comes down from folds at 291 Hz.
    options : WheelPeakOptions

    Returns
    -------
    WheelPeak
        ``status`` is "complete" if a peak was found with dampers free, and the sweep has solutions at all frequencies but
        single ones.  It is "incomplete", a lower bound, if the sweep has none at two and more in a row, or if no blade is
        as high as those of the tuned wheel, and ``reason`` says so: a lumped wheel of six blades (engine order 2, 100 N)
        had "held" 1.9 mm with an error of 20 % where its sector rattles at 118 mm.  It is "held" if the peak was found
        only with springs on the mean of dampers, ``springs`` of their stiffness when stuck, or only on the reduced wheel;
        and "not found", the amplitude NaN, if no local search converges.  Peaks beyond the band do not count.
    """
    meter = CostMeter()
    options = validation.instance("options", options or WheelPeakOptions(), WheelPeakOptions)
    if frequency is not None:
        frequency = validation.interval("frequency", frequency)
    equations = _Equations.of(wheel, preload)
    tuned = wheel.tuned_peak(preload)
    begin, end, width = band(wheel, preload)
    bands = [frequency] if frequency else [(begin, end), (begin, max(end, FAR * tuned.frequency))]
    for (low, high), springs in product(bands, WEAKER):
        n = int(np.clip(np.ceil((high - low) / (options.spacing * width)) + 1, options.least, options.most))
        points = tau * np.linspace(low, high, n)
        search = Search(equations.system, tau * width, (float(points[0]), float(points[-1])), meter, springs)
        swept = search.sweep(points)
        climbed = [search.climb(y, blade, springs) for y, blade in search.candidates(swept, options.climbs)]
        if held := search.different([c for c in climbed if c is not None]):
            break
    met = [y for y in swept if y is not None]
    all_climbed = len(search.candidates(swept, options.climbs + 1)) <= options.climbs
    peaks = search.freed(held)
    whole = replace(search, system=equations.whole) if equations.shapes is not None else search
    top, changed = _corrected(equations, search, whole, peaks)
    system = None if top is None else (whole if changed is not None else search).held(top.springs[-1])
    u = None if top is None else top.at.y[:-1]
    gap, higher = _gap(points, swept), _tuned_higher(top, tuned, low, high)
    return WheelPeak(
        preload=float(preload),
        frequency=np.nan if top is None else float(top.at.y[-1]) / tau,
        amplitude=np.nan if top is None else top.height,
        blade=-1 if top is None else top.blade,
        tuned_amplitude=tuned.amplitude,
        response=np.zeros((wheel.n_blades, 0)) if system is None or u is None else system.structure.responses(u),
        climbs=np.array([(c.blade, c.at.y[-1] / tau, c.heights[0], c.springs[-1], c.height) for c in peaks]).reshape(-1, 5),
        sweep_frequency=np.array([y[-1] for y in met]) / tau,
        status=_status(top, bool(higher or gap), changed is None and equations.shapes is not None),
        reason=_reason(top, gap, changed, equations, f"{len(peaks)} peaks from {len(met)} of {n} points") + higher,
        residual=np.nan if top is None else top.at.residual,
        springs=0.0 if top is None else top.springs[-1],
        error=np.nan if top is None else _error(top, peaks, changed, equations, all_climbed),
        interval=(low, high),
        unknowns=np.zeros(equations.whole.structure.shape) if system is None or u is None else system.structure.array(u),
        cost=meter.read(),
        **wheel.record(),
    )


def _corrected(
    equations: _Equations, search: Search, whole: Search, peaks: list[Climbed]
) -> tuple[Climbed | None, float | None]:
    """The highest peak as a solution to the tolerance, and by how much it is off that of the reduced wheel.

    Peaks of the reduced wheel are looked for on the whole one, from the highest on, until the next could not be higher by
    more than the reduction has changed those before; where none is found there, the reduced one's is the answer.
    """
    best: Climbed | None = None
    changed: float | None = None
    guess = 1e-3  # change of a peak from the reduced to the whole wheel that is expected where one has changed by less
    for peak in sorted(peaks, key=lambda p: -p.height):
        if best is not None and (changed is None or peak.height * (1.0 + max(changed, guess)) <= best.height):
            break
        found = whole.settled(peak, equations.expanded(peak.at.y)) if equations.shapes is not None else search.settled(peak)
        if found is None:
            continue
        changed = max(changed or 0.0, abs(found.height / peak.height - 1.0))
        best = found if best is None or found.height > best.height else best
    if best is not None or equations.shapes is None:
        return best, changed
    settled = (search.settled(peak) for peak in sorted(peaks, key=lambda p: -p.height))
    return next((peak for peak in settled if peak is not None), None), None


def _error(top: Climbed, peaks: list[Climbed], changed: float | None, equations: _Equations, all_climbed: bool) -> float:
    """How much higher the highest peak may be than the one found, relative: by springs, by what was reduced or missed."""
    # largest difference of a peak of the reduced wheel that was not found on the whole one. On the shipped disk (65
    # blades, 2 %) it is 0.3 to 2.7 % at 500 N and below 0.8 % at 1 and 2 kN
    surrogate = 0.03
    reduced = 0.0 if equations.shapes is None else surrogate if changed is None else changed
    rivals = [c.highest * (1.0 + reduced) / top.height - 1.0 for c in peaks if c.last]
    return max([top.error, 0.0 if changed is not None else reduced, 0.0 if all_climbed else MISSED, *rivals])


def _status(top: Climbed | None, lower: bool, reduced: bool) -> str:
    if top is None:
        return status.NOT_FOUND
    return status.INCOMPLETE if lower else status.HELD if top.springs[-1] or reduced else status.COMPLETE


def _tuned_higher(top: Climbed | None, tuned: Peak, low: float, high: float) -> str:
    """Where blades of the tuned wheel are higher than the highest one found, or where none was found at all."""
    if top is not None and not (low <= tuned.frequency <= high and top.height * (1.0 + MISSED) < tuned.amplitude):
        return ""
    there = f"the tuned wheel has {amount(tuned.amplitude, 'm')} at {amount(tuned.frequency, 'Hz', 6)}"
    return f"; searched from {low:.6g} to {high:.6g} Hz, {there}"


def _gap(omega: NDArray, swept: list[NDArray | None]) -> tuple[float, float] | None:
    """Ends of the longest part of a band with two and more frequencies in a row that have no solution."""
    lost = np.array([False, *(found is None for found in swept), False])
    begin, end = np.flatnonzero(lost[1:] & ~lost[:-1]), np.flatnonzero(~lost[1:] & lost[:-1])
    if not len(begin) or (end - begin).max() < 2:
        return None
    k = int(np.argmax(end - begin))
    return float(omega[begin[k]]), float(omega[end[k] - 1])


def _reason(
    top: Climbed | None, gap: tuple[float, float] | None, changed: float | None, equations: _Equations, found: str
) -> str:
    parts = [found]
    if equations.shapes is not None and top is not None and changed is None:
        parts.append("found on the reduced wheel alone")
    if top is not None and top.springs[-1]:
        parts.append(
            f"the mean of dampers held by springs of {top.springs[-1]:.2g} of their stuck stiffness, which change the "
            f"amplitude by some {100.0 * top.error:.2g} %"
        )
    if gap is not None:
        parts.append(f"no solution found between {gap[0] / tau:.6g} and {gap[1] / tau:.6g} Hz")
    return "; ".join(parts)
