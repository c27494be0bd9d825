"""Highest peak of a mistuned bladed disk: a search on a reduced disk, and its highest peaks
corrected on the full one.

Continuation of the tuned peak into mistuning loses the peak of the blade with the largest amplitude
too often.  The search (:mod:`bdamper.mistuning.peak_search`) takes four steps.

1. Sweep the frequency band of the tuned disk's waves, with springs that hold the dampers.
2. Follow the response uphill from the highest maxima to the peaks of single blades.
3. Weaken the springs to zero for all peaks that may be the highest.
4. If large blades were reduced to a few shapes, correct the peaks that may be the highest on the
   full disk.  The change is part of the error estimate.

The error estimate also contains the changes of the highest peak (at constant phase, on the disk of
the search) and of the tuned peak due to two more harmonics.  An undamped resonance that friction
does not limit has no amplitude, as in one sector (:mod:`bdamper.response.resolution`).

A harmonic-balance peak need not be a steady state.  The curve of a lumped disk of six blades (300
N, ``tests/mistuning/test_in_time.py``) continues from its first maximum of 2.2 mm through some
ninety folds to others of 5.4 to 12 mm.  In time integration, the first one persists, and all others
that were tested decay within a hundred periods (``BladedDisk.time_response``).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from itertools import product
from math import tau
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from bdamper.mistuning.disk_equations import DiskSystem, of_blade
from bdamper.mistuning.disk_problem import DiskProblem, disk_system
from bdamper.mistuning.peak_search import (
    FAR,
    SHAPES,
    WEAKER,
    Climbed,
    Search,
    band,
    close,
    family_shapes,
    reduced_state,
)
from bdamper.model.structure import Model
from bdamper.response.branches import NO_DIGITS, UNBOUNDED, LeftOut
from bdamper.response.peak import Peak
from bdamper.response.resolution import why_unresolved
from bdamper.util import validation
from bdamper.util.display import Plottable, Result, draw
from bdamper.util.errors import COMPLETE, HELD, INCOMPLETE, NOT_FOUND, warn
from bdamper.util.formatting import amount, peak_text, percent, short_repr
from bdamper.util.progress import Cost, CostMeter, one_thread, shows_progress, with_progress
from bdamper.util.records import Data
from bdamper.util.statement import Row, Statement
from bdamper.util.storage import FilePath, Recorded, Storable


@short_repr
@dataclass(frozen=True)
class DiskPeak(Result, Plottable, Recorded, Storable, kind="bdamper-wheel-peak"):
    """Highest amplitude of any blade of a mistuned bladed disk at one preload.

    ``plot`` draws a bar for each blade (:func:`bdamper.plot.plot_wheel_peak`).

    Parameters
    ----------
    preload : float, N
    frequency : float, Hz
    amplitude : float, m
        Amplitude of the first harmonic; NaN if no peak was found or rounding leaves no significant
        digits, infinite if it is unbounded.
    blade : int
        Number of the blade with the largest amplitude; -1 if no peak was found.
    tuned_amplitude : float, m
        Highest peak of the tuned disk at the same preload and engine order.
    response : (n_blades, n_harmonics + 1) complex, m
        Response of all blades at the peak, the mean first.
    climbs : (n, 5) float
        One row for each peak of a local search: blade; frequency (Hz) and amplitude (m) with the
        springs of the sweep; the weakest springs with a solution; and the amplitude (m) with those.
    sweep_frequency : (n,) float, Hz
        Frequencies of the coarse sweep with a solution.
    status, reason : str
        "complete"; "held" if the peak was found only with support springs on the dampers or on the
        reduced disk; "incomplete" for a lower bound, if the sweep has a gap or no blade reaches the
        amplitude of the tuned disk; "not found".
    residual : float
    unknowns : (n_blades, n_coefficients, n_sector) float
    springs : float
        Support springs on the mean of dampers, relative to their stuck stiffness; 0 if dampers are
        free.
    error : float
        Relative estimate of how much higher the highest peak with free dampers may be.  It is the
        largest of the change due to weaker springs, the error of the reduced disk, and the
        difference of peaks that the local searches missed, plus ``harmonics_error``.
    lower_error : float
        Relative estimate of how much lower this peak may be: the larger of the change due to weaker
        springs and the error of the reduced disk, plus ``harmonics_error``.  Missed peaks can only
        be higher.
    harmonics_error : float
        Relative change, of either sign, due to two more harmonics; NaN if it is unknown.
    interval : (low, high), Hz
        Band of the sweep.
    cost : Cost
    settings : mapping
        Settings of the tuned study, with the frequency deviations of the blades.
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
    # without a default, unlike that of the base class
    status: str = field()
    reason: str = field()
    residual: float
    unknowns: NDArray
    springs: float = 0.0
    error: float = 0.0
    harmonics_error: Annotated[float, Data(derived=True)] = float("nan")
    lower_error: Annotated[float, Data(derived=True)] = float("nan")
    interval: tuple[float, float] = (np.nan, np.nan)
    cost: Cost = field(default_factory=Cost)
    _summary_fields = (
        "status",
        "amplitude",
        "frequency",
        "blade",
        "amplification",
        "error",
        "springs",
    )

    @property
    def found(self) -> bool:
        """Whether the status is "complete" or "held"."""
        return self.status in (COMPLETE, HELD)

    @property
    def amplification(self) -> float:
        """Amplitude relative to the peak of the tuned disk; a lower bound, with a warning, if the
        peak is incomplete."""
        if self.status == INCOMPLETE:
            warn(f"amplification: a lower bound, since the peak is incomplete: {self.reason}")
        return self.amplitude / self.tuned_amplitude

    @property
    def amplitudes(self) -> NDArray:
        """Amplitudes (n_blades,) of all blades at the peak, m."""
        return np.abs(self.response[:, 1])

    @property
    def nodal_diameters(self) -> NDArray:
        """Amplitudes (n_blades,) of the travelling waves of 0 to N - 1 nodal diameters in the first
        harmonic, m."""
        return np.asarray(np.abs(np.fft.fft(self.response[:, 1])) / len(self.response))

    def plot_wheel(self, model: Model, path: FilePath | None = None, **options: Any) -> Any:
        """Draw the disk from the front, with blades coloured by their amplitude
        (:func:`bdamper.plot.plot_wheel`).
        """
        return draw(self, "figure", "plot_wheel", path, model, **options)

    def _statement(self) -> Statement:
        preload = f"preload {amount(self.preload, 'N')}"
        if not np.isfinite(self.amplitude):
            return Statement([f"No peak of the bladed disk: {preload}, {self.reason}"])
        peak = peak_text(self.amplitude, self.frequency)
        subject = f"blade {self.blade} (counted from 0) of {len(self.response)}, {preload}"
        is_lower_bound = self.status == INCOMPLETE
        if is_lower_bound:
            verdict = f"Not for design: a blade may have a larger amplitude than {peak}: {subject}"
        else:
            verdict = f"Largest blade amplitude {peak}: {subject}"
        factor = f"{self.amplitude / self.tuned_amplitude:.3g}"
        at_least = "at least; " if is_lower_bound else ""
        tuned = f"{at_least}relative to the tuned disk, {amount(self.tuned_amplitude, 'm')}"
        rows = [Row("Amplification", factor, tuned)]
        if self.error:
            rows.append(
                Row(
                    "Error",
                    percent(self.error),
                    "estimate; the highest amplitude may be higher by this much",
                )
            )
        remarks = []
        if not self.ok:
            remarks.append(f"{self.status.capitalize()}: {self.reason}")
        if is_lower_bound:
            remarks.append("Remedy: try DiskPeakOptions(least=240)")
        remarks.append("Not covered: time integration, wear")
        return Statement([verdict], rows, remarks=remarks)


MISSED = 0.045
"""Relative excess of a peak that may have been missed if the sweep has more maxima than local
searches.  Of 188 searches with three times as many local searches, four exceed all other error
terms: by 2.0, 2.1, 3.4 and 4.3 % (measured-disks.md, "Peaks of mistuned disks")."""


@validation.check_arguments
@dataclass(frozen=True)
class DiskPeakOptions(validation.Checked):
    """Options of the search for the highest peak.

    Parameters
    ----------
    spacing : float
        Spacing of the sweep, relative to the half-power width of the tuned peak.
    climbs : int
        Number of local searches, one for each peak.  With 8 searches from 30 points, the cost is 15
        % lower than with 12 searches from 60 points.  In 723 cases on 65 blades, 8 searches miss a
        peak by more than 1 % in 124 cases and find more in 73 (docs/evidence/measured-disks.md, "Peaks of
        mistuned disks").
    least, most : int
        Limits of the number of points of the sweep.
    """

    spacing: Annotated[float, validation.Limits(above=0.0, most=10.0)] = 0.5
    climbs: validation.Count = 12
    least: validation.Count = 60
    most: validation.Count = 300


@dataclass(frozen=True)
class _Equations:
    """Equations of the search, and their relation to the full disk.

    Parameters
    ----------
    whole, system : DiskSystem
        Equations of the full disk and of the search; the same object without reduction.
    shapes : (n, m) float or None
        Shapes of the reduced blades.
    mean : (n_blades, n) float, m
        Static state of the blades, about which they move in their shapes.
    """

    whole: DiskSystem
    system: DiskSystem
    shapes: NDArray | None
    mean: NDArray

    @classmethod
    def of(cls, disk: DiskProblem, preload: float) -> _Equations:
        full = disk.structure
        whole = disk.system(preload)
        state = disk.state(preload)
        mean = state.mean[:, : full.n]
        without_reduction = cls(whole=whole, system=whole, shapes=None, mean=mean)
        # a reduction saves work only if there are more coordinates than shapes
        if full.n <= SHAPES + 1 or not full.tuned.settings.bias:
            return without_reduction
        omega = tau * disk.tuned_peak(preload).frequency
        shapes = family_shapes(full, omega)
        if not close(full, shapes, omega):
            return without_reduction
        on_blades = disk.excitation[:, : full.n] @ shapes
        on_dampers = disk.excitation[:, full.n :]
        system = disk_system(
            full.reduced(shapes),
            reduced_state(full, state, shapes),
            np.hstack([on_blades, on_dampers]),
            disk.response_row @ shapes,
        )
        return cls(whole=whole, system=system, shapes=shapes, mean=mean)

    @property
    def is_reduced(self) -> bool:
        """Whether the search uses the reduced disk."""
        return self.shapes is not None

    def expanded(self, y: NDArray) -> NDArray:
        """Return the point of the full disk that corresponds to a point of the search.

        A point contains the unknowns, and the angular frequency (rad/s) as its last entry.
        """
        if self.shapes is None:
            return y
        omega = y[-1]
        # coefficients (n_blades, n_coefficients, n_shapes + n_damper)
        reduced = self.system.structure.array(y[:-1])
        n_shapes = self.shapes.shape[1]
        blades = reduced[..., :n_shapes] @ self.shapes.T
        # the first coefficient is the mean position
        blades[:, 0] += self.mean
        dampers = reduced[..., n_shapes:]
        unknowns = self.whole.structure.flat(np.concatenate([blades, dampers], axis=2))
        return np.append(unknowns, omega)


@dataclass(frozen=True)
class _Sweep:
    """Sweep of a frequency band, and the peaks of the local searches that start from it.

    Parameters
    ----------
    solutions : list of (n_unknowns + 1,) float or None
        One for each frequency; None without solution.
    held : list of Climbed
        Different peaks with the springs of the sweep.
    """

    solutions: list[NDArray | None]
    held: list[Climbed]


def _sweep_band(search: Search, points: NDArray, n_climbs: int, progress: bool) -> _Sweep:
    """Sweep the frequencies (rad/s) of a band and follow the highest maxima uphill."""
    frequencies = with_progress(points.tolist(), progress, "bladed disk: sweep", "frequency")
    solutions = search.sweep(frequencies)
    maxima = search.candidates(solutions, n_climbs)
    starts = with_progress(maxima, progress, "bladed disk: peaks", "peak")
    climbed = [search.climb(y, blade, search.springs) for y, blade in starts]
    held = search.different([c for c in climbed if c is not None])
    return _Sweep(solutions, held)


@validation.check_arguments
@one_thread
def peak(
    disk: DiskProblem,
    preload: float,
    frequency: tuple[float, float] | None = None,
    *,
    options: DiskPeakOptions | None = None,
    progress: bool | None = None,
) -> DiskPeak:
    """Find the highest amplitude of any blade at a preload.

    Parameters
    ----------
    disk, preload : BladedDisk, float (N)
    frequency : (low, high), Hz, optional
        Band of the sweep; ``bdamper.mistuning.peak_search.band`` by default.  If no blade has a
        peak in the default band, it is extended to 1.5 times the frequency of the tuned peak.
    options, progress : DiskPeakOptions, bool
        Progress is shown by default.

    Returns
    -------
    DiskPeak
        ``status`` is one of the following, and ``reason`` explains it.

        * "complete": the peak was found with free dampers, and the sweep has no gap of two or more
          adjacent frequencies.
        * "held": the peak was found only with support springs on the dampers (``springs``), or only
          on the reduced disk.
        * "incomplete": a lower bound.  The sweep has a gap, or no blade reaches the amplitude of
          the tuned disk; or the resonance is unbounded, or sharper than double precision resolves.
        * "not found": no local search converges; the amplitude is NaN.

        Peaks outside the band are ignored.

    Notes
    -----
    A lumped disk of six blades (engine order 2, 300 N) shows why the band is extended.  With held
    dampers the disk vibrates at 295 Hz, 13 Hz above the default band, and its peak at 230 Hz lies
    on a branch from folds at 291 Hz.  The same disk at 100 N shows why peaks are compared with the
    tuned disk: the search found a "held" peak of 1.9 mm with an error of 20 %, whereas one sector
    reaches 118 mm.
    """
    meter = CostMeter()
    progress = shows_progress(progress)
    options = validation.instance("options", options or DiskPeakOptions(), DiskPeakOptions)
    if frequency is not None:
        frequency = validation.interval("frequency", frequency)
    equations = _Equations.of(disk, preload)
    tuned = disk.tuned_peak(preload)
    not_found = DiskPeak(
        preload=float(preload),
        frequency=np.nan,
        amplitude=np.nan,
        blade=-1,
        tuned_amplitude=tuned.amplitude,
        response=np.zeros((disk.n_blades, 0)),
        climbs=np.zeros((0, 5)),
        sweep_frequency=np.zeros(0),
        status=NOT_FOUND,
        reason="",
        residual=np.nan,
        error=np.nan,
        unknowns=np.zeros(equations.whole.structure.shape),
        **disk.record(),
    )
    unresolved = _unresolved_tuned(tuned)
    if unresolved and (frequency is None or frequency[0] <= tuned.frequency <= frequency[1]):
        return _without_amplitude(replace(not_found, frequency=tuned.frequency), unresolved)
    # the tuned peak determines the band and its width
    if not len(tuned.y):
        reason = f"the tuned disk has no peak: {tuned.status_text}"
        return replace(not_found, reason=reason)
    begin, end, width = band(disk, preload)
    bands = [(begin, end), (begin, max(end, FAR * tuned.frequency))]
    if frequency is not None:
        bands = [frequency]

    # the first search with a peak ends the loop: in each band with weaker and weaker springs
    for (low, high), springs in product(bands, WEAKER):
        spacing = options.spacing * width
        n_points = int(np.clip(np.ceil((high - low) / spacing) + 1, options.least, options.most))
        points = tau * np.linspace(low, high, n_points)
        limits = (float(points[0]), float(points[-1]))
        search = Search(equations.system, tau * width, limits, meter, springs)
        swept = _sweep_band(search, points, options.climbs, progress)
        if swept.held:
            break
    solutions = [y for y in swept.solutions if y is not None]
    n_maxima = len(search.candidates(swept.solutions, options.climbs + 1))
    all_climbed = n_maxima <= options.climbs

    peaks = search.freed(swept.held)
    whole = replace(search, system=equations.whole) if equations.is_reduced else search
    top, changed = _corrected(equations, search, whole, peaks)

    gap = _gap(points, swept.solutions)
    tuned_higher = _tuned_higher(top, tuned, low, high)
    counts = f"{len(peaks)} peaks from {len(solutions)} of {n_points} points"
    # columns: blade, frequency and amplitude at first, weakest springs, amplitude with them
    climbs = [
        (peak.blade, peak.omega / tau, peak.heights[0], peak.springs[-1], peak.height)
        for peak in peaks
    ]
    # the angular frequency is the last unknown
    swept_omega = np.array([y[-1] for y in solutions])
    not_found = replace(
        not_found,
        climbs=np.array(climbs).reshape(-1, 5),
        sweep_frequency=swept_omega / tau,
        reason=_reason(top, gap, changed, equations, counts) + tuned_higher,
        interval=(low, high),
        cost=meter.read(),
    )
    if top is None:
        return not_found
    reduced_only = equations.is_reduced and changed is None
    solved = search if reduced_only else whole
    system = solved.held(top.springs[-1])
    structure = system.structure
    unknowns = top.at.y[:-1]
    is_lower_bound = bool(tuned_higher or gap)
    harmonics_error = _harmonics_error(disk, preload, search, top, peaks)
    error, lower_error = _errors(top, peaks, changed, equations, all_climbed)
    reason = not_found.reason
    if np.isnan(harmonics_error):
        reason += (
            "; the error does not include the effect of more harmonics, because no solution "
            "with more was found"
        )
    else:
        error += harmonics_error
        lower_error += harmonics_error
    found = replace(
        not_found,
        frequency=top.omega / tau,
        amplitude=top.height,
        blade=top.blade,
        response=structure.responses(unknowns),
        status=_status(top, is_lower_bound, reduced_only),
        reason=reason,
        residual=top.at.residual,
        springs=top.springs[-1],
        error=error,
        lower_error=lower_error,
        harmonics_error=harmonics_error,
        unknowns=structure.array(unknowns),
        cost=meter.read(),
    )
    of_highest = of_blade(system, top.blade)
    why = why_unresolved(of_highest, top.at.y, structure.structure.damping_ratio)
    if why:
        # a range of no width, whose text names the frequency of the peak
        text = LeftOut(found.frequency, found.frequency, why).at_middle
        return _without_amplitude(found, text)
    return found


def _unresolved_tuned(tuned: Peak) -> str:
    """Return why the tuned peak is unbounded or cannot be resolved; "" if it has an amplitude.

    Blades that differ have the same damping and friction, so their peaks have no amplitude either.
    """
    has_no_amplitude = tuned.reason.startswith((UNBOUNDED, NO_DIGITS))
    return tuned.reason if has_no_amplitude else ""


def _without_amplitude(peak: DiskPeak, why: str) -> DiskPeak:
    """Return a peak as unbounded or without digits."""
    amplitude = np.inf if why.startswith(UNBOUNDED) else np.nan
    reason = f"{why}; {peak.reason}" if peak.reason else why
    return replace(
        peak,
        amplitude=amplitude,
        status=INCOMPLETE,
        reason=reason,
        error=np.nan,
        lower_error=np.nan,
    )


def _harmonics_error(
    disk: DiskProblem, preload: float, search: Search, top: Climbed, peaks: list[Climbed]
) -> float:
    """Return the larger relative change by more harmonics, of the highest and of the tuned peak.

    A change is NaN if there is no solution with more harmonics.  An unknown change is left out; the
    result is NaN if both are unknown.
    """
    # the highest peak was corrected from one of the search: that of its blade, if there is one,
    # and of these the nearest in frequency
    of_blade = [peak for peak in peaks if peak.blade == top.blade] or peaks
    of_search = min(of_blade, key=lambda peak: abs(peak.omega - top.omega))
    changes = (search.change_by_harmonics(of_search), disk.tuned_change(preload))
    known = [abs(change) for change in changes if np.isfinite(change)]
    return max(known, default=np.nan)


def _corrected(
    equations: _Equations, search: Search, whole: Search, peaks: list[Climbed]
) -> tuple[Climbed | None, float | None]:
    """Solve the highest peak to the tolerance, on the full disk.

    Peaks of the reduced disk are corrected on the full one, from the highest on.  The loop stops
    when the next peak cannot be higher, given the changes so far.

    Returns
    -------
    peak : Climbed or None
        Highest peak of the full disk.  If no correction converges, it is the highest peak of the
        reduced disk; None if that does not converge either.
    changed : float or None
        Largest relative change of an amplitude by the correction; None without a peak of the full
        disk.
    """
    highest_first = sorted(peaks, key=lambda peak: -peak.height)
    # smallest relative change by the reduction that is assumed for the next peak
    least_change = 1e-3
    best: Climbed | None = None
    changed: float | None = None
    for peak in highest_first:
        if best is not None and changed is not None:
            upper_estimate = peak.height * (1.0 + max(changed, least_change))
            if upper_estimate <= best.height:
                break
        start = equations.expanded(peak.at.y) if equations.is_reduced else None
        exact = whole.settled(peak, start)
        if exact is None:
            continue
        change = abs(exact.height / peak.height - 1.0)
        changed = max(changed or 0.0, change)
        if best is None or exact.height > best.height:
            best = exact
    if best is not None or not equations.is_reduced:
        return best, changed
    for peak in highest_first:
        settled = search.settled(peak)
        if settled is not None:
            return settled, None
    return None, None


def _errors(
    top: Climbed,
    peaks: list[Climbed],
    changed: float | None,
    equations: _Equations,
    all_climbed: bool,
) -> tuple[float, float]:
    """Estimate how much higher the highest peak may be, and how much lower (relative), from
    springs, reduction and, for higher peaks alone, missed peaks."""
    # assumed error of the reduction if no peak was found on the full disk. On the shipped disk
    # (65 blades, 2 %) it is 0.3 to 2.7 % at 500 N and below 0.8 % at 1 and 2 kN
    default_reduction = 0.03
    if not equations.is_reduced:
        reduction = 0.0
    elif changed is None:
        reduction = default_reduction
    else:
        reduction = changed
    errors = [top.error]
    # a peak corrected on the full disk has no error of the reduction
    if changed is None:
        errors.append(reduction)
    lower_error = max(errors)
    if not all_climbed:
        errors.append(MISSED)
    # peaks whose springs could not be weakened may become higher than this one
    for peak in peaks:
        if peak.last:
            errors.append(peak.highest * (1.0 + reduction) / top.height - 1.0)
    return max(errors), lower_error


def _status(top: Climbed, is_lower_bound: bool, reduced_only: bool) -> str:
    """Return the status of the highest peak; ``reduced_only``: it is not of the full disk."""
    has_springs = top.springs[-1] > 0.0
    if is_lower_bound:
        return INCOMPLETE
    if has_springs or reduced_only:
        return HELD
    return COMPLETE


def _tuned_higher(top: Climbed | None, tuned: Peak, low: float, high: float) -> str:
    """Return a note if the tuned disk has a higher peak than all peaks found, or if none was found;
    otherwise "".

    ``low`` and ``high`` (Hz) are the band of the search.
    """
    # an incomplete peak of the tuned disk has no amplitude, but a lower bound
    highest_tuned = tuned.amplitude if np.isfinite(tuned.amplitude) else tuned.lower_bound
    if top is not None:
        # a tuned peak outside the band was not searched for
        in_band = low <= tuned.frequency <= high
        tuned_is_higher = in_band and top.height * (1.0 + MISSED) < highest_tuned
        if not tuned_is_higher:
            return ""
    tuned_peak = f"{amount(highest_tuned, 'm')} at {amount(tuned.frequency, 'Hz')}"
    return f"; searched from {low:.6g} to {high:.6g} Hz, but the tuned disk has {tuned_peak}"


def _gap(omega: NDArray, swept: list[NDArray | None]) -> tuple[float, float] | None:
    """Return the ends (rad/s) of the longest gap of the sweep, None without a gap.

    A gap consists of two or more adjacent frequencies without a solution.
    """
    # runs of failed frequencies; both ends of the sweep are padded with a success
    failed = np.array([y is None for y in swept], bool)
    padded = np.pad(failed, 1)
    begin = np.flatnonzero(padded[1:] & ~padded[:-1])
    end = np.flatnonzero(padded[:-1] & ~padded[1:])  # one after the last failed frequency
    length = end - begin
    if len(length) == 0 or length.max() < 2:
        return None
    longest = int(np.argmax(length))
    return float(omega[begin[longest]]), float(omega[end[longest] - 1])


def _reason(
    top: Climbed | None,
    gap: tuple[float, float] | None,
    changed: float | None,
    equations: _Equations,
    counts: str,
) -> str:
    """Return the reason for the status of the highest peak.

    ``counts`` says how many peaks were found, ``gap`` (rad/s) is a part of the sweep without a
    solution, and ``changed`` is None if the peak was not corrected on the full disk.
    """
    parts = [counts]
    if equations.is_reduced and top is not None and changed is None:
        parts.append("found only on the reduced disk")
    if top is not None and top.springs[-1]:
        parts.append(
            f"springs with {top.springs[-1]:.2g} times the stuck stiffness hold the mean position "
            f"of the dampers, which changes the amplitude by about {100.0 * top.error:.2g} %"
        )
    if gap is not None:
        parts.append(f"no solution found between {gap[0] / tau:.6g} and {gap[1] / tau:.6g} Hz")
    return "; ".join(parts)
