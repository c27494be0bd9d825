r"""Peaks of single blades: a coarse sweep with dampers held by springs, climbs from its maxima, and ever weaker springs.

Near its peaks Newton's method fails from afar: with the contacts stuck the blades answer so strongly that the next step has
them all slip, and dampers that slip fully are free along their axis and go anywhere.  Springs on the mean of dampers mend
both, and are weakened along each peak until the dampers are free.

The reduced wheel: blades that move in one shape of their family and in those of the contacts' flexibility.

With :math:`\phi_{dj}` the free modes of the tuned wheel at every nodal diameter d, j the family of the peak, and
:math:`\omega_0` the frequency of the tuned peak,

.. math::
    W = \frac1N \sum_d \sum_{i \ne j} \frac{\phi_{di} \phi_{di}^H}{\omega_{di}^2 - \omega_0^2} , \qquad
    \sqrt{k} B W B^T \sqrt{k} = U S U^T ,

with the motion B of the contact points by the blade and their stiffness k, the shapes are :math:`W B^T \sqrt{k} U` of the
largest S, and the one shape that all :math:`\phi_{dj}` have in common.  Blades move in them about the static state of the
whole wheel; dampers and contact points are those of the whole wheel.

The frequencies between which the blades of a wheel may have their highest peaks, from the waves of the tuned wheel.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from math import tau

import numpy as np
from numpy.typing import NDArray

from bdamper.harmonic_balance.equations import OK, Correction, Fixed, Plane, norm2
from bdamper.mistuning.wheel_equations import Structure, WheelSystem, of_blade
from bdamper.mistuning.wheel_problem import Loaded, WheelProblem
from bdamper.response.peak import PeakOptions, find_peak, slope_along
from bdamper.util.progress import CostMeter, raise_if_stopped

# ---- Peaks of single blades ----


WEAKER = (0.1, 0.01, 0.0)
"""Springs on the mean of dampers, relative to their stiffness when stuck: of the sweep, and those with which its peaks
are looked for one after the other.  A sweep without peaks is tried again with the next: of a tuned lumped wheel of six
blades (300 N) that with springs of 0.1 has none, the one with free dampers has."""
ERROR = (0.0, 0.06), (2e-3, 0.13), (2e-2, 0.2)
"""Largest change of an amplitude between springs above the first number and free dampers; what weaker springs have changed
already says little of what comes, but no less is promised.  On 12 wheels of 13 blades of the shipped disk (2 %, 300 N to
2 kN) it covers the changes of 41 of 42 peaks with springs of 0.1 and of 42 of 42 with 0.01."""
BELOW = (2e-2, 0.1), (0.0, 0.03)
"""Peaks found with springs above the first number, up to so much below the highest, are freed further.  Of 65 blades of the
shipped disk (2 %, 2 kN) one that is third among the held, 0.659 mm, has 0.705 mm with free dampers, and the first 0.659;
from springs of 0.01 on amplitudes rise by 1.2 % at most."""
SAME = 0.05
"""Distance of peaks of one blade, in widths of the tuned peak, below which they are one."""

GAIN = 1e-5
"""By how much, relatively, an amplitude may still rise where a climb ends."""
NEAR, ROUGH = 2e-3, 1e-2
"""Newton step, relative to the vibration, and residual with which the first place of a climb is content.  With residuals of
any size dampers that are nearly free are still on their way."""
TOLERANCE = 1e-9
"""On the residual of a peak, relative to excitation and static load."""
EXACT = PeakOptions(tolerance=TOLERANCE, max_trials=12)
SHARE = 0.05
"""Of a climb's step: Newton step with which the place ahead is content.  On 12 wheels of 13 blades 0.02 takes as many
factorisations, 0.2 a quarter more, with a peak lost."""
LEAST = 3e-5
"""Shortest step of a climb, relative to the vibration."""
PLACES = 60
"""Of a climb."""
REACH = 1.0
"""Way of a climb that sets off from a peak, relative to the vibration there.  On a lumped wheel of six blades (300 N) a
peak of 1.2 mm with springs of 0.1 becomes 2.2 mm with free dampers; without this limit it becomes one of 5.5 mm, which no
blade keeps."""


@dataclass(frozen=True, eq=False)
class Climbed:
    """A peak of the blade that is the highest there, with ever weaker springs.

    Parameters
    ----------
    at : Correction
    blade : int
    springs, heights : tuple of float, - and m
        Springs with which it was found, and its amplitudes.
    last : bool
        No peak was found with weaker springs.
    """

    at: Correction
    blade: int
    springs: tuple[float, ...]
    heights: tuple[float, ...]
    last: bool = False

    @property
    def height(self) -> float:
        return self.heights[-1]

    @property
    def final(self) -> bool:
        return self.last or not self.springs[-1]

    @property
    def error(self) -> float:
        """Bound of how far its amplitude is from that with free dampers, relative, as far as is known (``ERROR``)."""
        springs, moved = self.springs[-1], (max(self.heights) - min(self.heights)) / self.height
        return max(moved, *(error for least, error in ERROR if springs > least)) if springs else 0.0

    @property
    def below(self) -> float:
        """How far below the highest it may be and still become the highest (``BELOW``)."""
        return next(below for least, below in BELOW if self.springs[-1] > least)

    @property
    def highest(self) -> float:
        """Upper estimate of its amplitude with free dampers."""
        return self.height * (1.0 + self.error)


@dataclass(frozen=True, eq=False)
class Search:
    """The search on the equations of one wheel.

    Parameters
    ----------
    system : WheelSystem
        With dampers free.
    width : float, rad/s
        Of the tuned peak at half its power.
    band : (low, high), rad/s
        Peaks beyond it do not count.
    meter : CostMeter
    springs : float
        Of the sweep.
    """

    system: WheelSystem
    width: float
    band: tuple[float, float]
    meter: CostMeter = field(default_factory=CostMeter)
    springs: float = WEAKER[0]
    _held: dict[float, WheelSystem] = field(default_factory=dict, init=False, repr=False)

    def held(self, springs: float) -> WheelSystem:
        """The equations with springs, which the meter watches."""
        if springs not in self._held:
            self._held[springs] = self.system.structure.held(springs) if springs else self.system
            self.meter.watch(self._held[springs])
        return self._held[springs]

    def near(self, system: WheelSystem, y: NDArray, tolerance: float, loose: float = 0.0) -> Correction:
        """Newton's method at the frequency of a point, with steps shortened."""
        raise_if_stopped()
        return system.solve(y, Fixed(), self.system.structure.units_about(y, self.width), tolerance, 25, 2, loose=loose)

    def sweep(self, omega: NDArray) -> list[NDArray | None]:
        """Loose points with dampers held at every frequency (rad/s), ascending, each from the one before, or None.

        Newton's first step from a solution nearby is that of the linear wheel with the contacts as they are there, which is
        what resonances between both frequencies need; extrapolation would pass over them.
        """
        system, out = self.held(self.springs), []
        last = system.structure.at_rest
        easy = 0.05  # Newton step, relative to the vibration, with which the sweep is content
        for w in omega:
            found = None
            for start in (last, system.structure.at_rest):
                c = self.near(system, np.append(start, w), 1e-6, easy if start is not system.structure.at_rest else 0.0)
                if c.status == OK:
                    found = c.y
                    break
            last = last if found is None else found[:-1]
            out.append(found)
        return out

    def candidates(self, swept: list[NDArray | None], most: int) -> list[tuple[NDArray, int]]:
        """Highest local maxima of single blades, of different blades or frequencies; ends of gaps count, too."""
        none = np.full(self.system.structure.shape[0], -np.inf)
        height = np.array([none if y is None else np.abs(self.system.structure.responses(y[:-1])[:, 1]) for y in swept])
        padded = np.pad(height, ((1, 1), (0, 0)), constant_values=-np.inf)
        maxima = np.argwhere((height >= padded[:-2]) & (height >= padded[2:]) & np.isfinite(height))
        out: list[tuple[NDArray, int]] = []
        taken: list[tuple[int, int]] = []
        for i, k in maxima[np.argsort(-height[tuple(maxima.T)])]:
            y = swept[i]
            if y is None or any(abs(i - j) <= 1 and k == other for j, other in taken):
                continue
            taken.append((int(i), int(k)))
            out.append((y, int(k)))
            if len(out) == most:
                break
        return out

    def climb(self, y: NDArray, blade: int, springs: float, tangent: NDArray | None = None) -> Climbed | None:
        """The peak near a point whose blade is the highest there, or None: where another one is, it is climbed next.

        The first place has the frequency of the point, or lies in the plane across a tangent.
        """
        system = self.held(springs)
        for _ in range(system.structure.shape[0]):
            found = uphill(of_blade(system, blade), y, tangent, system.structure.units_about(y, self.width))
            if found is None or not self.band[0] <= found.y[-1] <= self.band[1]:
                return None
            heights = np.abs(system.structure.responses(found.y[:-1])[:, 1])
            highest = int(np.argmax(heights))
            if heights[highest] <= heights[blade] * (1.0 + 1e-9):
                return Climbed(found, blade, (springs,), (float(heights[blade]),))
            y, tangent, blade = found.y, found.tangent, highest
        return None

    def settled(self, peak: Climbed, y: NDArray | None = None) -> Climbed | None:
        """The same peak as a solution to the tolerance, or where it is from another point near it.

        From that it is only as exact as climbs are: on 65 blades with three harmonics an exact one took 76 s and failed.
        """
        if y is not None:
            found = self.climb(y, peak.blade, peak.springs[-1])
            if found is None:
                return None
            peak = replace(found, springs=peak.springs, heights=(*peak.heights[:-1], found.height))
        system = self.held(peak.springs[-1])
        scale = system.structure.units_about(peak.at.y, self.width)
        c = system.solve(peak.at.y, Plane(peak.at.tangent), scale, TOLERANCE, 25, 2)
        if c.status != OK:
            return None
        near_by = 0.05  # way from where a climb has ended to the peak, relative to the vibration, at most
        if y is None:
            top = find_peak(of_blade(system, peak.blade), c.y, tangent=c.tangent, scale=scale, options=EXACT, reach=near_by)
            if top.converged:
                c = replace(c, y=top.y, tangent=top.tangent, residual=top.residual)
        height = float(np.abs(system.structure.responses(c.y[:-1])[peak.blade, 1]))
        return replace(peak, at=c, heights=(*peak.heights[:-1], height))

    def different(self, peaks: list[Climbed]) -> list[Climbed]:
        """Each peak once, of those of one blade with the same springs."""
        out: list[Climbed] = []
        for peak in peaks:
            alike = (other for other in out if other.blade == peak.blade and other.springs[-1] == peak.springs[-1])
            if not any(abs(peak.at.y[-1] - other.at.y[-1]) < SAME * self.width for other in alike):
                out.append(peak)
        return out

    def freed(self, peaks: list[Climbed]) -> list[Climbed]:
        """Peaks followed to weaker springs as far as needed: until none that may be the highest is left.

        The strongest springs come first, since peaks that are high with weaker ones spare others the way: with twelve
        climbs 5 % fewer evaluations than from the highest peak on (nine searches on 65 blades), with eight 2 % (twenty).
        """
        out = list(peaks)
        while out:
            top = max(peak.height for peak in out)
            left = [i for i, peak in enumerate(out) if not peak.final and peak.height >= (1.0 - peak.below) * top]
            if not left:
                break
            i = max(left, key=lambda i: (out[i].springs[-1], out[i].height))
            out[i] = self.weakened(out[i])
            out = self.different(out)
        return out

    def weakened(self, peak: Climbed) -> Climbed:
        """The same peak with the next springs, or with those on the way to them."""
        before = peak.springs[-1]
        target = next(springs for springs in WEAKER if springs < 0.99 * before)
        nearer = 0.3 * before
        for springs in (target, nearer) if nearer > max(1.01 * target, 1e-4) else (target,):
            found = self.climb(peak.at.y, peak.blade, springs, peak.at.tangent)
            if found is not None:
                return replace(found, springs=(*peak.springs, springs), heights=(*peak.heights, found.height))
        return replace(peak, last=True)


def uphill(system: WheelSystem, y: NDArray, tangent: NDArray | None, scale: NDArray) -> Correction | None:
    """The maximum of the response along the curve near a point, or a place where another blade is higher than this will be.

    Secant on the slope of the amplitude.  Places on the way are content with little: one factorisation serves the last
    correction of a place and its slope.

    Parameters
    ----------
    system : WheelSystem
        Of one blade.
    y : (n_unknowns + 1,) float
        A loose solution.
    tangent : (n_unknowns + 1,) float, optional
        Of a curve; the first place lies in the plane across it, or has the frequency of the point.
    scale : (n_unknowns + 1,) float
    """
    condition, reach = (Fixed(), np.inf) if tangent is None else (Plane(tangent), REACH)
    start = y
    place = system.solve(y, condition, scale, 1e-6, 25, 2, loose=NEAR, rough=ROUGH)
    h, before, bent, bracket, longest, known = 0.0, 0.0, 1.0, np.inf, 0.5, False
    for _ in range(PLACES):
        if place.status != OK or norm2(((place.y - start) / scale)[system.n_mean : -1]) > reach:
            return None
        slope = slope_along(system, place.y, place.tangent, scale)
        if h:
            known, bent = True, (before - slope) / h
            if slope * before < 0.0:  # the slope may jump where a contact changes its state: halved at the least
                bracket = 0.5 * abs(h)
        furthest = min(bracket, 0.5)
        step = float(np.clip(slope / bent if bent > 0.0 else slope * np.inf, -furthest, furthest)) if slope else 0.0
        rest = 0.5 * abs(slope * step) if known else 5.0 * slope**2  # curves are bent by 0.1 to 10
        if (bent > 0.0 or bracket < 0.5) and (rest < GAIN or abs(step) < LEAST):
            return place
        heights = np.abs(system.structure.responses(place.y[:-1])[:, 1])
        own = float(abs(system.rows.value(place.y)))
        if known and bent > 0.0 and own * (1.0 + 4.0 * rest) < 0.98 * heights.max():
            return place
        before, tried = slope, float(np.clip(step, -longest, longest))
        h, place = _ahead(system, place, scale, tried)
        longest = 3.0 * abs(h) if h == tried and place.iterations <= 2 else 1.5 * abs(h)
    return None


def _ahead(system: WheelSystem, place: Correction, scale: NDArray, h: float) -> tuple[float, Correction]:
    """Distance and place ahead along the curve, nearer where none is found, which may not be converged."""
    first = abs(h)
    while True:
        guess = place.y + h * place.tangent * scale
        guess[: system.n_mean] = place.y[: system.n_mean]
        new = system.solve(guess, Plane(place.tangent), scale, 1e-6, 6, 2, 1.0, SHARE * abs(h), ROUGH)
        if new.status == OK or abs(h) < max(LEAST, 0.05 * first):
            return h, new
        h *= 0.3


# ---- The reduced wheel ----


SHAPES = 12
"""Of the contacts' flexibility.  On the shipped disk (9 points, 54 rows of motion) the stuck frequency of five nodal
diameters is off by 47, 3.5, 1.1, 0.3 and 0.1 Hz with 1, 4, 8, 10 and 12."""

CLOSE = 2e-3
"""Relative change of the free and the stuck frequency up to which shapes serve.  With 65 real blades it is 2e-4 and 7e-5.
Of lumped wheels with fourteen random attachments the stuck one changes by 5e-2, and peaks came out a quarter as high."""


def close(structure: Structure, shapes: NDArray, omega: float) -> bool:
    """Whether the wave of the engine order has the same frequencies near one (rad/s) in shapes, dampers free and stuck."""
    d = int(structure.tuned.engine_order) % structure.n_blades
    for share in (0.0, 1.0):
        springs = share * structure.tuned.point_stiffness
        one, other = (np.sqrt(np.abs(s.wave(d, springs)[0])) for s in (structure, structure.reduced(shapes)))
        nearest = one[np.argmin(np.abs(one - omega))]
        if np.abs(other - nearest).min() > CLOSE * nearest:
            return False
    return True


def family_shapes(structure: Structure, omega: float) -> NDArray:
    """(n, m) shapes of the blades about a frequency (rad/s), of mass one: ever more flexible ones, the family's own last.

    Parameters
    ----------
    structure : Structure
    omega : float, rad/s
        Of the tuned peak; the family is that of the free mode below it at the engine order.
    """
    tuned, local, N = structure.tuned, structure.local, structure.n_blades
    modes = [local.modes(d) for d in range(N // 2 + 1)]
    e = int(tuned.engine_order) % N
    family = max(int(np.searchsorted(np.sqrt(modes[min(e, N - e)][0]), 1.001 * omega)) - 1, 0)
    W, own = np.zeros((structure.n, structure.n)), []
    for d, (squares, phi) in enumerate(modes):
        weight = (1.0 if 2 * d % N == 0 else 2.0) / N
        apart = squares - omega**2
        apart[family] = np.inf
        W += weight * ((phi / apart) @ phi.conj().T).real
        own += [phi[:, family].real, phi[:, family].imag]
    inside = (structure.n - structure.n_root, 0)
    M = structure.mass + np.pad(structure.disk_mass.mean(axis=0).real, inside)
    L = np.linalg.cholesky(M)
    common = np.linalg.solve(L.T, np.linalg.svd(L.T @ np.array(own).T, full_matrices=False)[0][:, 0])
    seen = np.sqrt(tuned.point_stiffness).reshape(-1, 1) * structure.rows[..., : structure.n].reshape(-1, structure.n)
    _, V = np.linalg.eigh(seen @ W @ seen.T)
    found = np.column_stack([W @ seen.T @ V[:, -SHAPES:], common])
    return np.asarray(found / np.sqrt(np.einsum("ij,ik,kj->j", found, M, found)))


def reduced_state(structure: Structure, state: Loaded, shapes: NDArray) -> Loaded:
    """The static state as that from which blades move in their shapes, with the forces that remain there."""
    n = structure.n
    at, load = state.mean[:, :n], state.load
    moved = structure.motion(np.pad(at, ((0, 0), (0, structure.n_damper)))).reshape(-1, 3)
    left = (load[:, :n] - structure.elastic_forces(at)) @ shapes
    still = np.zeros((len(at), shapes.shape[1]))
    return replace(
        state, points=replace(state.points, shift=state.points.shift + moved), load=np.hstack([left, load[:, n:]]),
        mean=np.hstack([still, state.mean[:, n:]]),
    )  # fmt: skip


# ---- The frequencies between which the blades of a wheel may have their highest peaks, from the ----


FAR = 1.5
"""Ratio to the frequency of the tuned peak beyond which a wave of another nodal diameter counts as of another family."""


def band(wheel: WheelProblem, preload: float) -> tuple[float, float, float]:
    """Frequencies (Hz) between which blades may have peaks, and the width of the tuned peak at half its power.

    Every contact point is replaced by the spring and the damper that do what it does in the first harmonic at the tuned
    peak.  The band holds the resonances of all waves of the tuned wheel, and is wider by the standard deviation of the
    blades' frequencies and by two widths at each end.
    """
    tuned, s = wheel.structure.tuned, wheel.structure
    top = wheel.tuned_peak(preload)
    system = tuned.system(preload)
    X, F, _ = system.contact(top.y[:-1])
    x, f = X[..., 1] - 1j * X[..., 2], F[..., 1] - 1j * F[..., 2]
    complex_stiffness = np.where(np.abs(x) > 0.0, f / np.where(np.abs(x) > 0.0, x, 1.0), 0.0)
    springs, loss = np.maximum(complex_stiffness.real, 0.0), np.maximum(complex_stiffness.imag, 0.0)
    omega = float(top.y[-1])
    N, n, nominal = s.n_blades, s.n, replace(s, stiffness=s.local.blade_stiffness[None])
    e = int(tuned.engine_order) % N
    reference, found = None, {}
    for d in [e if 2 * e <= N else N - e, *range(N // 2 + 1)]:
        squares, phi, motion = nominal.wave(d, springs)
        own = phi[: s.local.n_cantilever]
        if reference is None:
            k = int(np.argmin(np.abs(squares - omega**2)))
            reference = own[:, k]
            friction = float((loss.ravel() * np.abs(motion[:, k]) ** 2).sum())
            viscous = float((phi[:n, k].conj() @ s.damping[d] @ phi[:n, k]).real) * omega
            width = (friction + viscous) / omega
        near = np.flatnonzero((squares > (omega / FAR) ** 2) & (squares < (omega * FAR) ** 2))
        if len(near):
            alike = np.abs(reference.conj() @ own[:, near]) / np.linalg.norm(own[:, near], axis=0)
            found[d] = float(np.sqrt(squares[near[int(np.argmax(alike))]]))
    mean, spread = float(wheel.deviation.mean()), float(wheel.deviation.std())
    low = min(omega, *found.values()) * (1.0 + mean - spread) - 2.0 * width
    high = max(omega, *found.values()) * (1.0 + mean + spread) + 2.0 * width
    return low / tau, high / tau, width / tau
