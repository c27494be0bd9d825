r"""Search for the peaks of single blades of a mistuned bladed disk, on reduced blades and in a
frequency band.

**Search.**  Near a peak Newton iteration fails from remote points: with stuck contacts the blades
respond so strongly that all contacts slip in the next iteration, and a damper in full slip is free
along its axis.  Springs on the mean of dampers prevent both.  They are weakened along each peak
until the dampers are free.

**Reduced disk.**  Blades move in one shape of their mode family and in shapes of the contact
flexibility.  With the modes :math:`\phi_{dj}` of the tuned disk with free dampers at every nodal
diameter d, the family j of the peak, and the frequency :math:`\omega_0` of the tuned peak,

.. math::
    W = \frac1N \sum_d \sum_{i \ne j}
        \frac{\phi_{di} \phi_{di}^H}{\omega_{di}^2 - \omega_0^2} , \qquad
    \sqrt{k} B W B^T \sqrt{k} = U S U^T ,

where B is the motion of the contact points by the blade and k their stiffness.  The shapes are
:math:`W B^T \sqrt{k} U` of the largest S, and the common shape of all :math:`\phi_{dj}`.  Blades
move in these about the static state of the full disk.  Dampers and contact points are not reduced.

**Band.**  The frequency band of the highest peaks follows from the waves of the tuned disk.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from math import tau

import numpy as np
from numpy.typing import NDArray

from bdamper.harmonic_balance.equations import OK, Correction, Fixed, Plane, norm2
from bdamper.harmonic_balance.problem import Problem
from bdamper.mistuning.disk_equations import KEPT, DiskMatrices, DiskSystem, of_blade
from bdamper.mistuning.disk_problem import MORE_HARMONICS, DiskProblem, Loaded
from bdamper.response.peak import PeakOptions, find_peak, phase_row, slope_along
from bdamper.util.errors import SettingError
from bdamper.util.progress import CostMeter, raise_if_stopped

# ---- Search ----

WEAKER = (0.1, 0.01, 0.0)
"""Springs on the mean of dampers, relative to their stuck stiffness: for the sweep, then for each
peak in turn.  A sweep without peaks is repeated with the next value: a tuned lumped disk of six
blades (300 N) has no peak with 0.1, but one with 0."""
ERROR = (0.0, 0.06), (2e-3, 0.13), (2e-2, 0.2)
"""Pairs (springs, error): smallest relative error assumed with springs above the first number.  The
change by weaker springs so far predicts the remaining change poorly, so it is only a lower bound.
On 12 disks of 13 blades of the shipped disk (2 %, 300 N to 2 kN) these errors cover 41 of 42 peaks
with springs of 0.1, and 42 of 42 with 0.01."""
BELOW = (2e-2, 0.1), (0.0, 0.03)
"""Pairs (springs, margin): peaks with springs above the first number are released further if they
are at most this relative margin below the highest.  On 65 blades of the shipped disk (2 %, 2 kN)
the third of the held peaks rises from 0.659 to 0.705 mm with free dampers, while the first has
0.659 mm.  From springs of 0.01 on amplitudes rise by 1.2 % at most."""
SAME = 0.05
"""Distance in widths of the tuned peak below which two peaks of one blade are the same."""

GAIN = 1e-5
"""Estimated relative increase of the amplitude below which a local search ends."""
NEAR = 2e-3
"""Newton step, relative to the vibration, accepted at the first point of a local search."""
ROUGH = 1e-2
"""Residual accepted there.

Without a limit of the residual, dampers that are nearly free have not yet reached their positions.
"""
TOLERANCE = 1e-9
"""Residual of a peak, relative to excitation and static load."""
EXACT = PeakOptions(tolerance=TOLERANCE, max_trials=12)
SHARE = 0.05
"""Newton step accepted at the next point of a local search, relative to its step.  On 12 disks of
13 blades 0.02 takes as many factorisations; 0.2 takes a quarter more and loses a peak."""
CLOSE_TO_PEAK = 1e-4
"""Residual of a solution with more harmonics, which only estimates an error."""
LEAST = 3e-5
"""Smallest step of a local search, relative to the vibration."""
PLACES = 60
"""Largest number of points of a local search."""
REACH = 1.0
"""Largest distance of a local search from its initial peak, relative to the vibration there.  On a
lumped disk of six blades (300 N) a peak of 1.2 mm with springs of 0.1 becomes 2.2 mm with free
dampers.  Without this limit it becomes 5.5 mm, which does not persist in time."""


@dataclass(frozen=True, eq=False)
class Climbed:
    """Peak of the blade that is the highest at its frequency, followed to weaker springs.

    Parameters
    ----------
    at : Correction
        Solution at the peak.
    blade : int
    springs, heights : tuple of float, - and m
        Springs with which a solution was found, and the amplitudes with them.
    last : bool
        True if no peak was found with weaker springs.
    """

    at: Correction
    blade: int
    springs: tuple[float, ...]
    heights: tuple[float, ...]
    last: bool = False

    @property
    def omega(self) -> float:
        """Angular frequency, rad/s: the last entry of the solution."""
        return float(self.at.y[-1])

    @property
    def height(self) -> float:
        """Amplitude with the weakest springs, m."""
        return self.heights[-1]

    @property
    def final(self) -> bool:
        """Whether the springs cannot be weakened further: none are left, or no peak was found."""
        return self.last or self.springs[-1] == 0.0

    @property
    def error(self) -> float:
        """Estimate of the relative change of the amplitude until the dampers are free
        (see ``ERROR``)."""
        weakest = self.springs[-1]
        if not weakest:
            # the dampers are free
            return 0.0
        change_so_far = (max(self.heights) - min(self.heights)) / self.height
        assumed = [error for threshold, error in ERROR if weakest > threshold]
        return max(change_so_far, *assumed)

    @property
    def below(self) -> float:
        """Margin below the highest peak within which this one may still become the highest.

        The first pair of ``BELOW`` with weaker springs contains it; free dampers have none.
        """
        return next(margin for springs, margin in BELOW if self.springs[-1] > springs)

    @property
    def highest(self) -> float:
        """Upper estimate of the amplitude with free dampers."""
        return self.height * (1.0 + self.error)


@dataclass(frozen=True, eq=False)
class Search:
    """Search for peaks with the equations of one bladed disk.

    Parameters
    ----------
    system : DiskSystem
        Equations with free dampers.
    width : float, rad/s
        Half-power width of the tuned peak.
    band : (low, high), rad/s
        Peaks outside are ignored.
    meter : CostMeter
    springs : float
        Stiffness of the support springs during the sweep, relative to the stuck contacts.
    """

    system: DiskSystem
    width: float
    band: tuple[float, float]
    meter: CostMeter = field(default_factory=CostMeter)
    springs: float = WEAKER[0]
    _held: dict[float, DiskSystem] = field(default_factory=dict, init=False, repr=False)

    def held(self, springs: float) -> DiskSystem:
        """Return the equations with support springs of a relative stiffness; the meter counts their
        work."""
        if springs not in self._held:
            self._held[springs] = self.system.structure.held(springs) if springs else self.system
            self.meter.watch(self._held[springs])
        return self._held[springs]

    def sweep(self, omega: Iterable[float]) -> list[NDArray | None]:
        """Solve approximately, with support springs, at ascending frequencies (rad/s).

        Return one solution with its frequency, (n_unknowns + 1,), for each frequency; None if
        Newton iteration fails.

        Each solution starts from the previous solution.  The first Newton step is then the response
        of the linearised disk with the contact states of that solution, which reveals resonances
        between two frequencies.  Extrapolation would pass over them.
        """
        system = self.held(self.springs)
        at_rest = system.structure.at_rest
        last = at_rest
        accepted_step = 0.05  # Newton step relative to the vibration
        swept: list[NDArray | None] = []
        for omega_now in omega:
            solution = None
            # a second attempt from rest if the previous solution is too far away
            for start in (last, at_rest):
                raise_if_stopped()
                guess = np.append(start, omega_now)
                scale = self.system.structure.units_about(guess, self.width)
                # starting from rest requires an accurate solution
                loose = 0.0 if start is at_rest else accepted_step
                correction = system.solve(
                    guess,
                    Fixed(),
                    scale,
                    tolerance=1e-6,
                    max_iterations=25,
                    line_search=2,
                    loose=loose,
                )
                if correction.status == OK:
                    solution = correction.y
                    last = solution[:-1]
                    break
            swept.append(solution)
        return swept

    def candidates(self, swept: list[NDArray | None], most: int) -> list[tuple[NDArray, int]]:
        """Return solutions and blades of the highest local maxima of a sweep, at most ``most``.

        Two maxima differ in blade or in frequency.  A solution next to a frequency without solution
        may count as a maximum.
        """
        structure = self.system.structure
        n_blades = structure.shape[0]
        # amplitude of the first harmonic (n_frequencies, n_blades), -infinity without a solution
        height = np.full((len(swept), n_blades), -np.inf)
        for i, y in enumerate(swept):
            if y is not None:
                height[i] = np.abs(structure.responses(y[:-1])[:, 1])

        # a local maximum is not lower than at the frequencies before and after it
        padded = np.pad(height, ((1, 1), (0, 0)), constant_values=-np.inf)
        before = padded[:-2]
        after = padded[2:]
        is_maximum = (height >= before) & (height >= after) & np.isfinite(height)
        places, blades = np.nonzero(is_maximum)
        highest_first = np.argsort(-height[places, blades])

        chosen: list[tuple[NDArray, int]] = []
        taken: list[tuple[int, int]] = []  # place and blade
        for place, blade in zip(places[highest_first].tolist(), blades[highest_first].tolist()):
            y = swept[place]
            if y is None:
                continue
            # equal heights at adjacent frequencies are one maximum
            if any(abs(place - other) <= 1 and blade == of for other, of in taken):
                continue
            taken.append((place, blade))
            chosen.append((y, blade))
            if len(chosen) == most:
                break
        return chosen

    def climb(
        self, y: NDArray, blade: int, springs: float, tangent: NDArray | None = None
    ) -> Climbed | None:
        """Find the peak near a point; if another blade has a larger amplitude there, continue with
        its peak.

        The first point has the frequency of ``y``, or lies in the plane normal to ``tangent``.
        Return None if no peak is found.
        """
        system = self.held(springs)
        n_blades = system.structure.shape[0]
        for _ in range(n_blades):
            scale = system.structure.units_about(y, self.width)
            top = uphill(of_blade(system, blade), y, tangent, scale)
            if top is None:
                return None
            in_band = self.band[0] <= top.y[-1] <= self.band[1]
            if not in_band:
                return None
            heights = np.abs(system.structure.responses(top.y[:-1])[:, 1])
            highest = int(np.argmax(heights))
            # identical blades differ by rounding
            if heights[highest] <= heights[blade] * (1.0 + 1e-9):
                return Climbed(
                    at=top, blade=blade, springs=(springs,), heights=(float(heights[blade]),)
                )
            y = top.y
            tangent = top.tangent
            blade = highest
        return None

    def settled(self, peak: Climbed, y: NDArray | None = None) -> Climbed | None:
        """Locate a peak to the full tolerance, or search for it again from a point ``y`` near it.

        A peak from ``y`` has the tolerance of :func:`uphill`.  On 65 blades with three harmonics
        the exact search took 76 s and failed.  The new amplitude replaces the last height of the
        peak.  Return None if there is no solution.
        """
        if y is not None:
            climbed = self.climb(y, peak.blade, peak.springs[-1])
            if climbed is None:
                return None
            heights = (*peak.heights[:-1], climbed.height)
            peak = replace(climbed, springs=peak.springs, heights=heights)
        system = self.held(peak.springs[-1])
        scale = system.structure.units_about(peak.at.y, self.width)
        # onto the curve, in the plane normal to it
        solution = system.solve(
            peak.at.y,
            Plane(peak.at.tangent),
            scale,
            tolerance=TOLERANCE,
            max_iterations=25,
            line_search=2,
        )
        if solution.status != OK:
            return None
        if y is None:
            # largest distance from the end of a local search to its peak, relative to the vibration
            reach = 0.05
            top = find_peak(
                of_blade(system, peak.blade),
                solution.y,
                tangent=solution.tangent,
                scale=scale,
                options=EXACT,
                reach=reach,
            )
            # otherwise the end of the local search, an accurate solution, counts as the peak
            if top.ok:
                solution = replace(solution, y=top.y, tangent=top.tangent, residual=top.residual)
        response = system.structure.responses(solution.y[:-1])
        height = float(np.abs(response[peak.blade, 1]))
        return replace(peak, at=solution, heights=(*peak.heights[:-1], height))

    def change_by_harmonics(self, peak: Climbed) -> float:
        """Return the relative change of a peak by more harmonics (:data:`MORE_HARMONICS`), or by
        fewer of them if there is no solution; NaN if it is unknown.

        The phase of the blade is held, because it follows a resonance that shifts.  On 65 blades of
        the shipped disk (2 %, 2 kN) the change is -12.6 % on the reduced disk and -12.2 % on the
        full one; it takes 1.5 s, the search 4.8 s.
        """
        # data of the equations; their own structure are the matrices of the disk
        scene = self.held(peak.springs[-1]).structure
        # coefficients (n_blades, n_coefficients, n_sector) of the peak: mean, then cosine and sine
        # of every harmonic up to the highest, with zeros for a harmonic that is no unknown
        of_peak = scene.array(peak.at.y[:-1])
        n_coefficients = of_peak.shape[1]
        highest = max(scene.harmonics)
        # more harmonics need more root shapes in the elimination than a first harmonic
        matrices = replace(scene.structure, n_kept=KEPT)
        for n_more in range(MORE_HARMONICS, 0, -1):
            harmonics = {*scene.harmonics, *range(1, highest + n_more + 1)}
            richer = replace(scene, harmonics=harmonics, structure=matrices)
            try:
                system = of_blade(richer.equations, peak.blade)
            # sampled contact forces may be too coarse for more harmonics
            except SettingError:
                continue
            self.meter.watch(system)
            # both arrays have a place for every harmonic, so the present ones come first also if
            # some are left out; the new ones begin with zero
            coefficients = np.zeros(richer.shape)
            coefficients[:, :n_coefficients] = of_peak
            start = np.append(richer.flat(coefficients), peak.omega)
            row, scale = phase_row(system, start)
            solution = system.solve(
                start,
                Plane(row),
                scale,
                tolerance=CLOSE_TO_PEAK,
                max_iterations=25,
                line_search=2,
            )
            if solution.status == OK:
                responses = richer.responses(solution.y[:-1])
                # the height of a peak is the first harmonic of the response
                amplitudes = np.abs(responses[:, 1])
                return float(amplitudes.max()) / peak.height - 1.0
        return np.nan

    def different(self, peaks: list[Climbed]) -> list[Climbed]:
        """Return the peaks without duplicates (same blade and springs, nearly the same
        frequency)."""
        distinct: list[Climbed] = []
        for peak in peaks:
            if not any(self._are_same(peak, other) for other in distinct):
                distinct.append(peak)
        return distinct

    def _are_same(self, a: Climbed, b: Climbed) -> bool:
        if a.blade != b.blade or a.springs[-1] != b.springs[-1]:
            return False
        return abs(a.omega - b.omega) < SAME * self.width

    def freed(self, peaks: list[Climbed]) -> list[Climbed]:
        """Follow peaks to weaker springs until no peak that may become the highest has springs left
        to weaken.

        Peaks with the strongest springs come first, because a high peak with weaker springs
        excludes others. This order takes 5 % fewer evaluations than the order by height with twelve
        candidates (nine searches on 65 blades), 2 % fewer with eight (twenty searches).
        """
        remaining = list(peaks)
        while remaining:
            highest = max(peak.height for peak in remaining)
            # peaks that may become the highest and have springs left to weaken
            candidates = []
            for i, peak in enumerate(remaining):
                if peak.final:
                    continue
                if peak.height >= (1.0 - peak.below) * highest:
                    candidates.append(i)
            if not candidates:
                break
            # the strongest springs; of equal springs the highest peak
            chosen = max(candidates, key=lambda i: (remaining[i].springs[-1], remaining[i].height))
            remaining[chosen] = self.weakened(remaining[chosen])
            remaining = self.different(remaining)
        return remaining

    def weakened(self, peak: Climbed) -> Climbed:
        """Return the peak with the next weaker springs or, if none is found, with intermediate
        springs.

        Without a peak with either, return the same peak, marked as the last.
        """
        present = peak.springs[-1]
        target = next(springs for springs in WEAKER if springs < 0.99 * present)
        intermediate = 0.3 * present
        trials = [target]
        if intermediate > max(1.01 * target, 1e-4):
            trials.append(intermediate)
        for springs in trials:
            climbed = self.climb(peak.at.y, peak.blade, springs, peak.at.tangent)
            if climbed is None:
                continue
            return replace(
                climbed,
                springs=(*peak.springs, springs),
                heights=(*peak.heights, climbed.height),
            )
        return replace(peak, last=True)


def uphill(
    system: DiskSystem, y: NDArray, tangent: NDArray | None, scale: NDArray
) -> Correction | None:
    """Find the maximum of one blade's response along the curve near a point; stop if another blade
    becomes higher.

    The secant method is applied to the slope of the amplitude.  Newton iteration at intermediate
    points stops early, so one factorisation yields both the last correction and the slope.

    Parameters
    ----------
    system : DiskSystem
        Equations with the response of one blade.
    y : (n_unknowns + 1,) float
        Approximate solution.
    tangent : (n_unknowns + 1,) float, optional
        Tangent of the curve.  The first point lies in the plane normal to it; if omitted, the
        frequency is fixed.
    scale : (n_unknowns + 1,) float
        Scale of each unknown.

    Returns
    -------
    Correction or None
        Maximum, or a point at which another blade is higher; None if no point was found within
        ``REACH``.
    """
    condition: Fixed | Plane
    if tangent is None:
        condition = Fixed()
        reach = np.inf
    else:
        condition = Plane(tangent)
        reach = REACH
    start = y
    point = system.solve(
        y,
        condition,
        scale,
        tolerance=1e-6,
        max_iterations=25,
        line_search=2,
        loose=NEAR,
        rough=ROUGH,
    )
    last_step = 0.0
    last_slope = 0.0
    curvature = 1.0
    has_curvature = False  # known from the slopes at two points
    bracket = np.inf
    longest = 0.5
    for _ in range(PLACES):
        if point.status != OK:
            return None
        # of the vibration: without mean position and frequency
        moved = (point.y - start) / scale
        if norm2(moved[system.n_mean : -1]) > reach:
            return None

        slope = slope_along(system, point.y, point.tangent, scale)
        if last_step:
            has_curvature = True
            curvature = (last_slope - slope) / last_step
            # the maximum lies between the two points; the slope may jump there at a contact event,
            # so the bracket is at least halved
            if slope * last_slope < 0.0:
                bracket = 0.5 * abs(last_step)
        step = _uphill_step(slope, curvature, furthest=min(bracket, 0.5))

        # expected increase of ln(amplitude); the curvature of curves is 0.1 to 10
        gain = 0.5 * abs(slope * step) if has_curvature else 5.0 * slope**2
        near_maximum = curvature > 0.0 or bracket < 0.5
        if near_maximum and (gain < GAIN or abs(step) < LEAST):
            return point
        # another blade stays higher than this one can become
        heights = np.abs(system.structure.responses(point.y[:-1])[:, 1])
        height = float(abs(system.rows.value(point.y)))
        highest = heights.max()
        if has_curvature and curvature > 0.0 and height * (1.0 + 4.0 * gain) < 0.98 * highest:
            return point

        last_slope = slope
        trial = float(np.clip(step, -longest, longest))
        last_step, point = _ahead(system, point, scale, trial)
        easy = last_step == trial and point.iterations <= 2
        longest = 3.0 * abs(last_step) if easy else 1.5 * abs(last_step)
    return None


def _uphill_step(slope: float, curvature: float, furthest: float) -> float:
    """Return the step of the secant method to the maximum, at most ``furthest``.

    If the slope does not decrease along the curve, the step is the longest one uphill.
    """
    if slope == 0.0:
        return 0.0
    secant = slope / curvature if curvature > 0.0 else slope * np.inf
    return float(np.clip(secant, -furthest, furthest))


def _ahead(
    system: DiskSystem, point: Correction, scale: NDArray, step: float
) -> tuple[float, Correction]:
    """Return the step along the curve and the next point.

    The step is shortened until Newton iteration converges or the step is too small.
    """
    smallest = max(LEAST, 0.05 * abs(step))
    while True:
        guess = point.y + step * point.tangent * scale
        # the mean position may drift far while the vibration hardly changes
        guess[: system.n_mean] = point.y[: system.n_mean]
        new = system.solve(
            guess,
            Plane(point.tangent),
            scale,
            tolerance=1e-6,
            max_iterations=6,
            line_search=2,
            reach=1.0,
            loose=SHARE * abs(step),
            rough=ROUGH,
        )
        if new.status == OK or abs(step) < smallest:
            return step, new
        step *= 0.3


# ---- Reduced disk ----

SHAPES = 12
"""Number of shapes of the contact flexibility.  On the shipped disk (9 points, 54 rows of motion)
the error of the stuck frequency over five nodal diameters is 47, 3.5, 1.1, 0.3 and 0.1 Hz with 1,
4, 8, 10 and 12 shapes."""

CLOSE = 2e-3
"""Largest relative change of the free and the stuck frequency by an acceptable reduction.  With 65
finite-element blades it is 2e-4 and 7e-5.  With lumped blades with fourteen random attachments the
stuck frequency changes by 5e-2, and peaks were too low by a factor of four."""


def close(structure: DiskMatrices, shapes: NDArray, omega: float) -> bool:
    """Return whether a reduction to shapes keeps the frequency nearest to ``omega`` (rad/s).

    The frequency is compared with free and with stuck dampers.
    """
    nodal_diameter = int(structure.tuned.engine_order) % structure.n_blades
    reduced = structure.reduced(shapes)
    stuck = structure.tuned.point_stiffness
    free = 0.0 * stuck
    for springs in (free, stuck):
        full_squares, _, _ = structure.wave(nodal_diameter, springs)
        reduced_squares, _, _ = reduced.wave(nodal_diameter, springs)
        full_frequencies = np.sqrt(np.abs(full_squares))
        reduced_frequencies = np.sqrt(np.abs(reduced_squares))
        nearest = full_frequencies[np.argmin(np.abs(full_frequencies - omega))]
        if np.abs(reduced_frequencies - nearest).min() > CLOSE * nearest:
            return False
    return True


def family_shapes(structure: DiskMatrices, omega: float) -> NDArray:
    """Return mass-normalised shapes of the blades (n, m).

    The first are shapes of the contact flexibility, the most flexible ones last; the last is the
    shape of the mode family.

    Parameters
    ----------
    structure : DiskMatrices
    omega : float, rad/s
        Frequency of the tuned peak.  The family contains the highest mode below it at the engine
        order, with free dampers.
    """
    tuned = structure.tuned
    local = structure.local
    n_blades = structure.n_blades
    n = structure.n
    modes = [local.modes(d) for d in range(n_blades // 2 + 1)]
    engine_order = int(tuned.engine_order) % n_blades
    squares_at_engine_order, _ = modes[min(engine_order, n_blades - engine_order)]
    n_below = int(np.searchsorted(np.sqrt(squares_at_engine_order), 1.001 * omega))
    family = max(n_below - 1, 0)

    # mean flexibility at omega over all waves, without the family, which responds in resonance
    flexibility = np.zeros((n, n))
    family_modes = []
    for d, (squares, phi) in enumerate(modes):
        # a wave of 0 or N/2 nodal diameters is its own reverse
        n_directions = 1.0 if 2 * d % n_blades == 0 else 2.0
        weight = n_directions / n_blades
        difference = squares - omega**2
        difference[family] = np.inf
        flexibility += weight * ((phi / difference) @ phi.conj().T).real
        family_modes.append(phi[:, family].real)
        family_modes.append(phi[:, family].imag)

    # the common shape of the family is the first principal shape in the mass matrix
    mean_disk_mass = structure.disk_mass.mean(axis=0).real
    # the coordinates of the root, which the disk shares, are the last ones
    mass = structure.mass + np.pad(mean_disk_mass, (n - structure.n_root, 0))
    # with mass = L L^T, |L^T x|^2 is x^T mass x
    lower = np.linalg.cholesky(mass)
    principal, _, _ = np.linalg.svd(lower.T @ np.array(family_modes).T, full_matrices=False)
    family_shape = np.linalg.solve(lower.T, principal[:, 0])

    # static shapes of the principal loads on the contact springs: loads in units of the root of the
    # spring, (3 n_points, n), and the largest eigenvalues last
    root_stiffness = np.sqrt(tuned.point_stiffness).reshape(-1, 1)
    springs = root_stiffness * structure.rows[..., :n].reshape(-1, n)
    _, loads = np.linalg.eigh(springs @ flexibility @ springs.T)
    contact_shapes = flexibility @ springs.T @ loads[:, -SHAPES:]
    shapes = np.column_stack([contact_shapes, family_shape])
    modal_mass = np.einsum("ij,ik,kj->j", shapes, mass, shapes)
    return np.asarray(shapes / np.sqrt(modal_mass))


def reduced_state(structure: DiskMatrices, state: Loaded, shapes: NDArray) -> Loaded:
    """Return the static state as the origin of the motion in shapes, with the remaining static
    forces."""
    n = structure.n
    blades = state.mean[:, :n]
    dampers = state.mean[:, n:]
    load_on_blades = state.load[:, :n]
    load_on_dampers = state.load[:, n:]
    without_dampers = np.pad(blades, ((0, 0), (0, structure.n_damper)))
    motion = structure.motion(without_dampers).reshape(-1, 3)
    remaining = (load_on_blades - structure.elastic_forces(blades)) @ shapes
    no_motion = np.zeros((len(blades), shapes.shape[1]))
    return replace(
        state,
        points=replace(state.points, shift=state.points.shift + motion),
        load=np.hstack([remaining, load_on_dampers]),
        mean=np.hstack([no_motion, dampers]),
    )


# ---- Band ----

FAR = 1.5
"""Ratio to the frequency of the tuned peak beyond which waves of other nodal diameters count as
another mode family."""


def band(disk: DiskProblem, preload: float) -> tuple[float, float, float]:
    """Return the frequency band (low, high) of the peaks and the half-power width of the tuned
    peak, in Hz.

    Each contact point is replaced by its equivalent spring and damper in the first harmonic at the
    tuned peak.  The band contains the resonances of all waves of the tuned disk.  It is extended by
    the standard deviation of the blade frequencies and by two widths at each end.
    """
    s = disk.structure
    tuned = s.tuned
    peak = disk.tuned_peak(preload)
    omega = float(peak.y[-1])  # the last entry; unknowns before it
    springs, loss = _equivalent_contacts(tuned, preload, peak.y[:-1])

    # mode of the tuned disk at its peak, and the half-power width from all its losses
    nominal = replace(s, stiffness=s.local.blade_stiffness[None])
    N = s.n_blades
    engine_order = int(tuned.engine_order) % N
    nodal_diameter = min(engine_order, N - engine_order)
    # squared frequencies, modes, and their motion (3 n_points, n_modes) at the contacts
    squares, phi, motion = nominal.wave(nodal_diameter, springs)
    nearest = int(np.argmin(np.abs(squares - omega**2)))
    blade_mode = phi[: s.n, nearest]
    friction = float((loss.ravel() * np.abs(motion[:, nearest]) ** 2).sum())
    viscous = float((blade_mode.conj() @ s.damping[nodal_diameter] @ blade_mode).real) * omega
    width = (friction + viscous) / omega

    # resonance of each wave: the mode whose cantilever part is most like that of the peak
    cantilever_mode = phi[: s.local.n_cantilever, nearest]
    resonances = []
    for d in range(N // 2 + 1):
        squares, phi, _ = nominal.wave(d, springs)
        of_family = (squares > (omega / FAR) ** 2) & (squares < (omega * FAR) ** 2)
        near = np.flatnonzero(of_family)
        if len(near) == 0:
            continue
        # correlation (n_near,) of each mode with the mode of the peak
        cantilever = phi[: s.local.n_cantilever, near]
        projection = np.abs(cantilever_mode.conj() @ cantilever)
        correlation = projection / np.linalg.norm(cantilever, axis=0)
        most_similar = near[int(np.argmax(correlation))]
        resonances.append(float(np.sqrt(squares[most_similar])))

    mean = float(disk.deviation.mean())
    spread = float(disk.deviation.std())
    low = min(omega, *resonances) * (1.0 + mean - spread) - 2.0 * width
    high = max(omega, *resonances) * (1.0 + mean + spread) + 2.0 * width
    return low / tau, high / tau, width / tau


def _equivalent_contacts(tuned: Problem, preload: float, u: NDArray) -> tuple[NDArray, NDArray]:
    """Return springs and losses of the contacts in the first harmonic, (n_points, 3) each, N/m.

    They are real and imaginary part of force over motion, and 0 in a direction without motion.
    """
    motion, force, _ = tuned.system(preload).contact(u)
    # coefficient 0 is the mean, 1 and 2 are cosine and sine of the first harmonic
    complex_motion = motion[..., 1] - 1j * motion[..., 2]
    complex_force = force[..., 1] - 1j * force[..., 2]
    moves = np.abs(complex_motion) > 0.0
    divisor = np.where(moves, complex_motion, 1.0)
    complex_stiffness = np.where(moves, complex_force / divisor, 0.0)
    springs = np.maximum(complex_stiffness.real, 0.0)
    loss = np.maximum(complex_stiffness.imag, 0.0)
    return springs, loss
