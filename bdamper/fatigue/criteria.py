r"""Stress amplitude, mean stress and safety factors of multiaxial stress cycles.

A cycle is ``sigma(theta) = c_0 + sum_l Re[c_l exp(i l theta)]`` with six components in the order
xx, yy, zz, xy, yz, xz.

* *von Mises*: the amplitude is half the largest von Mises value of
  ``sigma(theta_1) - sigma(theta_2)`` over all pairs of instants. The mean is the trace of the mean
  tensor, which is the mean stress in uniaxial tension and zero in pure shear.  The amplitude is
  invariant, continuous and equal to the classical value in proportional loading. For one harmonic
  it is ``sqrt((z^H D z + |z^T D z|)/2)`` with the quadratic form D of the von Mises value.
* *Findley* (:func:`findley`): ``tau_a + k sigma_max`` on the critical plane, the plane of its
  maximum. ``tau_a`` is the radius of the smallest circle around the path of the shear stress [1]_.

The cycle is sampled, and the best samples are refined by Newton's method. If two maxima are almost
equal, the result may be the lower one; it was at most 0.04 % below the other in 15,000 random
cycles.

With amplitude a, mean m, :math:`m_+ = \max(m, 0)`, endurance limit :math:`S_e`, ultimate strength
:math:`S_u` and yield strength :math:`S_y`, the safety factor n is:

==========  ========================================  ==================================
line        factor on amplitude and mean              factor on the amplitude alone
==========  ========================================  ==================================
Goodman     :math:`1/n = a/S_e + m_+/S_u`             :math:`S_e (1 - m_+/S_u)/a`
Soderberg   :math:`1/n = a/S_e + m_+/S_y`             :math:`S_e (1 - m_+/S_y)/a`
Gerber      :math:`n a/S_e + (n m_+/S_u)^2 = 1`       :math:`S_e (1 - (m_+/S_u)^2)/a`
==========  ========================================  ==================================

A compressive mean stress has no effect. For a blade the factor on the amplitude alone is relevant:
rotation fixes the mean stress, and only the excitation can grow. This factor is 0 if the mean
stress exceeds its limit. The factor on both is 1 if the mean stress alone is at its limit, and
always positive.

.. [1] W. N. Findley, J. Eng. Ind. 81, 301-306, 1959.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations_with_replacement
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bdamper.fatigue.haigh_table import HaighTable, means_per_amplitude
from bdamper.util import validation
from bdamper.util.errors import warn_implausible

CRITERIA = ("von_mises", "findley")

_INDEX = np.array([[0, 3, 5], [3, 1, 4], [5, 4, 2]])
# Maps stress components to five deviatoric coordinates whose Euclidean norm is the von Mises value.
_DEVIATOR = np.zeros((5, 6))
_DEVIATOR[0, :2] = [np.sqrt(3.0) / 2.0, -np.sqrt(3.0) / 2.0]
_DEVIATOR[1, :3] = [-0.5, -0.5, 1.0]
_DEVIATOR[2:, 3:] = np.sqrt(3.0) * np.eye(3)


class Cycle(NamedTuple):
    """Stress amplitude and mean stress (n,) of cycles, in the unit of the stress."""

    amplitude: NDArray
    mean: NDArray


def tensors(stress: NDArray) -> NDArray:
    """Return stress components (..., 6) as tensors (..., 3, 3)."""
    return np.asarray(stress)[..., _INDEX]


def von_mises(stress: NDArray) -> NDArray:
    """Return the von Mises value (...) of stress components (..., 6)."""
    return np.linalg.norm(np.asarray(stress) @ _DEVIATOR.T, axis=-1)


def angles(n_harmonics: int) -> NDArray:
    """Return the sampling angles (n,) of a cycle in rad.

    128 angles resolve up to seven harmonics; there are 256 for more.
    """
    n = 128 if n_harmonics <= 7 else 256
    return 2.0 * np.pi * np.arange(n) / n


def over_cycle(coefficients: NDArray, theta: NDArray) -> NDArray:
    """Evaluate Fourier coefficients (..., H + 1), mean first, at angles (n_theta,) in rad."""
    l = np.arange(coefficients.shape[-1])
    return (np.asarray(coefficients) @ np.exp(1j * l[:, None] * theta)).real


def _derivatives(coefficients: NDArray, theta: NDArray) -> tuple[NDArray, NDArray, NDArray]:
    """Evaluate each of n cycles (n, m, H + 1) at its own angle (n,).

    Return values, first and second derivatives, (n, m).
    """
    l = np.arange(coefficients.shape[-1])
    phase = np.exp(1j * l * theta[:, None])  # (n, H + 1)
    wave = coefficients * phase[:, None]
    value = wave.sum(-1).real
    first = (1j * l * wave).sum(-1).real
    second = (-(l**2) * wave).sum(-1).real
    return value, first, second


def amplitude_and_mean(coefficients: NDArray) -> Cycle:
    """Return von Mises amplitude and mean of stress cycles.

    Parameters
    ----------
    coefficients : (n, 6, H + 1) complex, Pa
        Mean and harmonics of the stress components.

    Returns
    -------
    Cycle
    """
    coefficients = np.asarray(coefficients, complex)
    if not len(coefficients):
        return Cycle(np.zeros(0), np.zeros(0))
    # blocks limit the memory of the matrix of all pairs of instants
    n_blocks = -(-len(coefficients) // 256)
    parts = [_by_von_mises(block) for block in np.array_split(coefficients, n_blocks)]
    return Cycle(
        amplitude=np.concatenate([part.amplitude for part in parts]),
        mean=np.concatenate([part.mean for part in parts]),
    )


def _by_von_mises(c: NDArray) -> Cycle:
    """Return von Mises amplitude and mean of cycles (n, 6, H + 1).

    The amplitude is half the largest distance between two instants of the path of the deviator.
    """
    # coefficients of the deviator, (n, 5, H + 1); the mean has no effect on distances
    y = np.einsum("ij,njl->nil", _DEVIATOR, c)
    y[..., 0] = 0.0
    theta = angles(c.shape[-1] - 1)
    path = over_cycle(y, theta)
    # squared distances (n, n_theta, n_theta): |y_1 - y_2|^2 = |y_1|^2 + |y_2|^2 - 2 y_1 y_2
    square = (path**2).sum(axis=1)
    product = path.transpose(0, 2, 1) @ path
    distance = square[:, :, None] + square[:, None] - 2.0 * product
    # the best pair of sampled instants of each cycle, refined between the samples
    best = distance.reshape(len(c), -1).argmax(axis=1)
    first, second = np.unravel_index(best, distance.shape[1:])
    pair = np.stack([theta[first], theta[second]], axis=1)
    largest = _refine_pair(y, pair)
    # trace of the mean stress
    mean = c[:, :3, 0].real.sum(axis=1)
    return Cycle(amplitude=0.5 * np.sqrt(largest), mean=mean)


def largest_von_mises(coefficients: NDArray) -> NDArray:
    """Return the largest von Mises value (n,) of the total stress over cycles (n, 6, H + 1)."""
    c = np.asarray(coefficients, complex)
    # coefficients of the deviator, (n, 5, H + 1), whose norm is the von Mises value
    y = np.einsum("ij,njl->nil", _DEVIATOR, c)
    sampled = angles(c.shape[-1] - 1)
    square = (over_cycle(y, sampled) ** 2).sum(axis=1)
    best = sampled[square.argmax(axis=1)]

    def rates(theta: NDArray) -> tuple[NDArray, NDArray]:
        """Return first and second derivatives of half the squared value."""
        value, first, second = _derivatives(y, theta)
        return (value * first).sum(1), (first**2 + value * second).sum(1)

    spacing = sampled[1] - sampled[0]
    refined = _climbed(rates, best, most=spacing)
    deviator, _, _ = _derivatives(y, refined)
    return np.linalg.norm(deviator, axis=1)


def _climbed(
    rates: Callable[[NDArray], tuple[NDArray, NDArray]], theta: NDArray, most: float
) -> NDArray:
    """Refine maxima of cycles by Newton's method.

    Parameters
    ----------
    rates : callable
        Returns first and second derivatives (n,) at angles (n,).
    theta : (n,) float, rad
        Initial angles.
    most : float, rad
        Largest step.
    """
    for _ in range(4):
        slope, curvature = rates(theta)
        # a Newton step where the function is concave; elsewhere the angle stays
        concave = curvature < 0.0
        step = np.clip(-slope / np.where(concave, curvature, 1.0), -most, most)
        theta = theta + np.where(concave, step, 0.0)
    return theta


def _pair_difference(y: NDArray, pair: NDArray) -> tuple[NDArray, NDArray, NDArray]:
    """Evaluate ``|y(theta_1) - y(theta_2)|^2`` at pairs (n, 2) of angles.

    Return values (n,), gradients (n, 2) and second derivatives (n, 2, 2).
    """
    y1, first1, second1 = _derivatives(y, pair[:, 0])
    y2, first2, second2 = _derivatives(y, pair[:, 1])
    difference = y1 - y2
    value = (difference**2).sum(1)
    by_theta1 = (difference * first1).sum(1)
    by_theta2 = -(difference * first2).sum(1)
    gradient = 2.0 * np.stack([by_theta1, by_theta2], axis=1)
    hessian = np.empty((len(y), 2, 2))
    hessian[:, 0, 0] = 2.0 * ((difference * second1).sum(1) + (first1**2).sum(1))
    hessian[:, 1, 1] = 2.0 * ((first2**2).sum(1) - (difference * second2).sum(1))
    mixed = -2.0 * (first1 * first2).sum(1)
    hessian[:, 0, 1] = mixed
    hessian[:, 1, 0] = mixed
    return value, gradient, hessian


def _refine_pair(y: NDArray, pair: NDArray) -> NDArray:
    """Maximise ``|y(theta_1) - y(theta_2)|^2`` by Newton's method and return the maxima (n,).

    ``pair`` (n, 2) contains the initial angles.
    """
    value, gradient, hessian = _pair_difference(y, pair)
    for _ in range(8):
        # Newton step gradient/|curvature| along the principal axes: the absolute value makes it
        # an ascent also where the function is not concave
        curvature, axes = np.linalg.eigh(hessian)  # (n, 2) in ascending order, (n, 2, 2)
        size_of_first = np.maximum(np.abs(curvature[:, :1]), 1e-300)
        size = np.maximum(np.abs(curvature), 1e-9 * size_of_first)
        along_axes = np.einsum("nji,nj->ni", axes, gradient) / size
        step = np.einsum("nij,nj->ni", axes, along_axes)
        # at most 0.1 rad in either angle
        longest = np.maximum(np.abs(step).max(axis=1), 1e-300)
        step *= np.minimum(1.0, 0.1 / longest)[:, None]

        new_value, new_gradient, new_hessian = _pair_difference(y, pair + step)
        better = new_value > value
        if not better.any():
            break
        pair = np.where(better[:, None], pair + step, pair)
        value = np.where(better, new_value, value)
        gradient = np.where(better[:, None], new_gradient, gradient)
        hessian = np.where(better[:, None, None], new_hessian, hessian)
    return value


def findley(coefficients: NDArray, k: float, limit: float | None = None) -> NDArray:
    """Return the largest ``tau_a + k sigma_max`` over all planes.

    Parameters
    ----------
    coefficients : (n, 6, H + 1) complex, Pa
        Mean and harmonics of the stress components.
    k : float
        Weight of the normal stress.
    limit : float, optional
        Limit of the criterion, Pa. If given, the result is the largest
        ``(tau_a + k sigma_a)/(limit - k sigma_m)``, the reciprocal safety factor on the vibration
        alone. ``sigma_m`` is the mean of the normal stress, ``sigma_a`` its largest excess over the
        mean. The value is infinite if the mean stress exceeds the limit.

    Returns
    -------
    (n,) float
        In Pa, or dimensionless if ``limit`` is given.
    """
    c = np.asarray(coefficients, complex)
    planes = _half_sphere()
    largest = np.zeros(len(c))
    for i, cycle in enumerate(c):
        # a coarse search over all planes, then a fine one from the three best
        coarse = _plane_values(cycle, planes, k, limit, samples=64)
        best_three = planes[np.argsort(coarse)[-3:]]
        largest[i] = max(_refine_plane(cycle, normal, k, limit) for normal in best_three)
    return largest


def _half_sphere(n_rings: int = 12) -> NDArray:
    """Return unit normals (n, 3) of about equal distance on a half sphere.

    12 rings have some 220 normals.
    """
    rings = []
    polar_angles = (np.arange(n_rings) + 0.5) * 0.5 * np.pi / n_rings
    for polar in polar_angles:
        # the circumference of the ring determines its number of normals
        n = max(round(4 * n_rings * np.sin(polar) * 0.6), 3)
        azimuth = 2.0 * np.pi * np.arange(n) / n
        x = np.sin(polar) * np.cos(azimuth)
        y = np.sin(polar) * np.sin(azimuth)
        z = np.full(n, np.cos(polar))
        rings.append(np.column_stack([x, y, z]))
    return np.concatenate(rings)


def _frames(normals: NDArray) -> tuple[NDArray, NDArray]:
    """Return two orthogonal unit vectors (n, 3) in each of the planes with normals (n, 3)."""
    # z, or x for normals close to z: a direction that is not parallel to the normal
    far_from_z = np.abs(normals[:, 2:]) < 0.9
    helper = np.where(far_from_z, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]])
    a = np.cross(normals, helper)
    a /= np.linalg.norm(a, axis=1)[:, None]
    return a, np.cross(normals, a)


def _plane_values(
    c: NDArray, normals: NDArray, k: float, limit: float | None, samples: int
) -> NDArray:
    """Return the criterion (n,) of one cycle (6, H + 1) on planes with the given normals (n, 3).

    It is a stress in Pa, or with a limit the reciprocal safety factor (:func:`findley`).
    """
    theta = 2.0 * np.pi * np.arange(samples) / samples
    # coefficients of the stress vector on each plane, (n, 3, H + 1)
    traction = np.einsum("ijl,nj->nil", c[_INDEX], normals)

    # path of the shear stress in the plane
    a, b = _frames(normals)
    along_a = over_cycle(np.einsum("ni,nil->nl", a, traction), theta)
    along_b = over_cycle(np.einsum("ni,nil->nl", b, traction), theta)
    shear_amplitude = smallest_circle(np.stack([along_a, along_b], axis=-1))

    # mean of the normal stress, and its largest excess over the mean
    normal = np.einsum("ni,nil->nl", normals, traction)
    mean = normal[:, 0].real.copy()
    normal[:, 0] = 0.0
    excess = _parabola(over_cycle(normal, theta))

    if limit is None:
        return np.asarray(shear_amplitude + k * (mean + excess))
    # rest of the limit for the vibration after the mean stress
    left = limit - k * mean
    allowable = left > 0.0
    ratio = (shear_amplitude + k * excess) / np.where(allowable, left, 1.0)
    return np.where(allowable, ratio, np.inf)


def _parabola(values: NDArray) -> NDArray:
    """Return the maxima (n,) of periodic samples (n, m).

    A parabola through the largest sample and its neighbours gives them.
    """
    n_samples = values.shape[1]
    rows = np.arange(len(values))
    i = values.argmax(axis=1)
    # the samples are periodic: index -1 is the last one
    before = values[rows, i - 1]
    top = values[rows, i]
    after = values[rows, (i + 1) % n_samples]
    bend = 2.0 * top - before - after
    # equal samples have no parabola; the sample is the maximum
    concave = bend > 0.0
    rise = (after - before) ** 2 / (8.0 * np.where(concave, bend, 1.0))
    return np.asarray(top + np.where(concave, rise, 0.0))


def _refine_plane(c: NDArray, normal: NDArray, k: float, limit: float | None) -> float:
    """Maximise the criterion over planes by a pattern search on the sphere; return the maximum.

    The search begins at a unit normal (3,).  It compares each normal with eight around it, and
    halves their distance, from 0.1 to 1e-4 rad, when none of them is better.
    """
    samples = 1024
    azimuth = (np.arange(8) * np.pi / 4.0)[:, None]
    value = float(_plane_values(c, normal[None], k, limit, samples)[0])
    distance = 0.1
    while distance > 1e-4 and np.isfinite(value):
        a, b = _frames(normal[None])
        # normals (8, 3) on a circle around the present one
        around = normal + distance * (np.cos(azimuth) * a + np.sin(azimuth) * b)
        around /= np.linalg.norm(around, axis=1)[:, None]
        candidates = _plane_values(c, around, k, limit, samples)
        if candidates.max() > value * (1.0 + 1e-12):
            value = float(candidates.max())
            normal = around[candidates.argmax()]
        else:
            distance *= 0.5
    return value


def smallest_circle(path: NDArray) -> NDArray:
    """Return the radius (n,) of the smallest circle around each path (n, m, 2).

    Two or three support points define a circle.  The farthest point outside replaces one of them,
    or is added to two of them, until no point lies outside.  The radius increases in each step.
    """
    n = len(path)
    rows = np.arange(n)
    # begin with the point farthest from the mean, as three equal support points
    from_mean = path - path.mean(axis=1)[:, None]
    first = (from_mean**2).sum(-1).argmax(axis=1)
    support = np.repeat(path[rows, first][:, None], 3, axis=1)
    centre = support[:, 0].copy()
    radius = np.zeros(n)
    for _ in range(60):
        distance = np.linalg.norm(path - centre[:, None], axis=-1)
        farthest = distance.argmax(axis=1)
        outside = distance[rows, farthest] > radius * (1.0 + 1e-10) + 1e-300
        if not outside.any():
            break
        added = path[rows, farthest][:, None]
        four = np.concatenate([support, added], axis=1)[outside]
        support[outside], centre[outside], radius[outside] = _circle_of_four(four)
    return radius


def _circle_of_four(points: NDArray) -> tuple[NDArray, NDArray, NDArray]:
    """Return support points, centres and radii of the smallest circles around four points.

    ``points`` is (n, 4, 2).  The last point lies on the circle; one or two of the first three
    points complete the support.
    """
    last = points[:, 3]
    # six supports with the last point: one more point (equal indices) or two
    others = list(combinations_with_replacement(range(3), 2))
    centres_of_supports = []
    radii_of_supports = []
    for i, j in others:
        if i == j:
            centre = 0.5 * (points[:, i] + last)
        else:
            centre = _circumcentre(points[:, i], points[:, j], last)
        centres_of_supports.append(centre)
        radii_of_supports.append(np.linalg.norm(centre - last, axis=1))
    centres = np.stack(centres_of_supports, axis=1)  # (n, 6, 2)
    radii = np.stack(radii_of_supports, axis=1)  # (n, 6)

    # the smallest of the circles that contain all four points
    with np.errstate(invalid="ignore"):
        # from each centre to each point, (n, 6, 4)
        distance = np.linalg.norm(points[:, None] - centres[:, :, None], axis=-1)
        farthest = distance.max(axis=2)
    contains_all = farthest <= radii * (1.0 + 1e-9) + 1e-300
    good = np.isfinite(radii) & contains_all
    best = np.where(good, radii, np.inf).argmin(axis=1)

    # two of the first three points, and the last one (index 3)
    rows = np.arange(len(points))
    support = np.column_stack([np.array(others)[best], np.full(len(rows), 3)])
    return points[rows[:, None], support], centres[rows, best], radii[rows, best]


def _circumcentre(a: NDArray, b: NDArray, c: NDArray) -> NDArray:
    """Return the centre (n, 2) of the circle through three points (n, 2).

    It is not finite if the points lie on a line.
    """
    # with c as origin, the centre satisfies 2 u x = |u|^2 and 2 v x = |v|^2
    u = a - c
    v = b - c
    uu = (u**2).sum(1)
    vv = (v**2).sum(1)
    det = 2.0 * (u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])
    with np.errstate(all="ignore"):
        x = (v[:, 1] * uu - u[:, 1] * vv) / det
        y = (u[:, 0] * vv - v[:, 0] * uu) / det
    return c + np.stack([x, y], axis=1)


DIFFERENT_LIMIT = 2.0
"""Plausible factor between the endurance limit and the Haigh table of the same material."""
LINES = ("goodman", "gerber", "soderberg", "table")
ON = ("amplitude", "both")


@validation.check_arguments
@dataclass(frozen=True)
class Material(validation.Checked):
    """Strength data of a material.

    Parameters
    ----------
    endurance_limit : float, Pa
        Allowable amplitude of fully reversed stress for infinite life, at the relevant survival
        probability, surface finish, size and temperature.
    ultimate_strength, yield_strength : float, Pa
        Strengths at the same temperature.
    findley_k : float
        Weight of the normal stress in Findley's criterion, typically 0.2 to 0.3 for ductile metals.
        Determine it from two endurance limits if they are known.
    name, source : str
        Description and origin of the data.
    haigh : HaighTable, optional
        Allowable stress amplitudes at one survival probability, used by the line "table".

    Raises
    ------
    SettingError
        If a number is not positive, if yield strength or endurance limit exceed the ultimate
        strength, or if the table has several probabilities or a mean stress above the ultimate
        strength.
    """

    endurance_limit: validation.Positive
    ultimate_strength: validation.Positive
    yield_strength: validation.Positive
    findley_k: validation.Positive = 0.3
    name: str = ""
    source: str = ""
    haigh: HaighTable | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.haigh is not None:
            self._check_table(validation.instance("haigh", self.haigh, HaighTable))
        for name in ("yield_strength", "endurance_limit"):
            expected = f"at most the ultimate strength, {self.ultimate_strength:g} Pa"
            strength = getattr(self, name)
            too_large = strength > self.ultimate_strength
            validation.check(not too_large, name, expected, f"{strength:g}")

    def _check_table(self, table: HaighTable) -> None:
        n_probabilities = len(table.probabilities)
        expected = "a table of one survival probability (table.at_probability(0.99))"
        validation.check(n_probabilities == 1, "haigh", expected, n_probabilities)
        expected = f"mean stresses below the ultimate strength, {self.ultimate_strength:g} Pa"
        largest = max(table.mean)
        validation.check(largest < self.ultimate_strength, "haigh", expected, f"{largest:g}")
        without_mean = [
            float(table.allowed(0.0, self.ultimate_strength, temperature))
            for temperature in table.temperatures
        ]
        low = min(without_mean) / DIFFERENT_LIMIT
        high = max(without_mean) * DIFFERENT_LIMIT
        if not low <= self.endurance_limit <= high:
            warn_implausible(
                "endurance_limit",
                f"{low:.3g} to {high:.3g} Pa, within a factor of {DIFFERENT_LIMIT:g} of the Haigh "
                "table without mean stress",
                f"{self.endurance_limit:.4g} Pa; possibly the limit or the table of another "
                "material, or in another unit",
            )

    def limit(self, line: str) -> float:
        """Return the mean stress (Pa) at which no amplitude is allowable."""
        if line == "soderberg":
            return float(self.yield_strength)
        return float(self.ultimate_strength)

    def allowed(
        self,
        mean: NDArray | float,
        line: str = "goodman",
        temperature: NDArray | float | None = None,
    ) -> NDArray:
        """Return the allowable stress amplitude at a mean stress, both (...) in Pa.

        If ``line`` is "table" and the table covers several temperatures, ``temperature`` (...) in
        °C is required.
        """
        if line == "table":
            if self.haigh is None:
                raise validation.invalid("line", "a material with a HaighTable (haigh=)", line)
            return self.haigh.allowed(mean, self.ultimate_strength, temperature)
        # a compressive mean stress has no effect
        tension = np.maximum(np.asarray(mean, float), 0.0)
        used = tension / self.limit(line)
        if line == "gerber":
            used = used**2
        left = np.maximum(1.0 - used, 0.0)
        return np.asarray(self.endurance_limit * left)

    def factor(
        self,
        amplitude: NDArray | float,
        mean: NDArray | float,
        line: str = "goodman",
        on: str = "amplitude",
        temperature: NDArray | float | None = None,
    ) -> NDArray:
        """Return the safety factor of stress cycles.

        Parameters
        ----------
        amplitude, mean : (...) float, Pa
            Stress amplitude and mean stress.
        line : {"goodman", "gerber", "soderberg", "table"}
            Failure line in the Haigh diagram.
        on : {"amplitude", "both"}
            Quantity that the factor multiplies: the amplitude, or amplitude and mean.
        temperature : (...) float, °C, optional
            Temperature at the points, for the line "table".

        Returns
        -------
        (...) float
        """
        validation.choice("line", line, LINES)
        validation.choice("on", on, ON)
        amplitude, mean = np.broadcast_arrays(np.asarray(amplitude, float), np.asarray(mean, float))
        vibrates = amplitude > 0.0
        # a factor is infinite without the stress that it multiplies
        with np.errstate(divide="ignore", invalid="ignore"):
            if on == "amplitude":
                allowed = self.allowed(mean, line, temperature)
                # without vibration the mean stress alone decides
                at_rest = np.where(allowed > 0.0, np.inf, 0.0)
                return np.where(vibrates, allowed / amplitude, at_rest)
            if line == "table":
                # amplitude and mean grow together on a ray of constant ratio
                rays = np.where(vibrates, mean / amplitude, 0.0)
                allowable = self._on_ray(rays, line, temperature)
                at_rest = self.ultimate_strength / np.maximum(mean, 0.0)
                return np.where(vibrates, allowable / amplitude, at_rest)
            of_amplitude = amplitude / self.endurance_limit
            of_mean = np.maximum(mean, 0.0) / self.limit(line)
            if line == "gerber":
                # positive root of n of_amplitude + (n of_mean)^2 = 1, without cancellation
                root = np.sqrt(of_amplitude**2 + 4.0 * of_mean**2)
                return np.asarray(2.0 / (of_amplitude + root))
            return np.asarray(1.0 / (of_amplitude + of_mean))

    def amplitude_at_ratio(
        self,
        ratio: NDArray | float,
        line: str = "goodman",
        temperature: NDArray | float | None = None,
    ) -> NDArray:
        """Return the allowable stress amplitude at a stress ratio R = minimum over maximum.

        Parameters
        ----------
        ratio : (...) float
            Below 1; -1 is fully reversed stress, 0 pulsating tension.
        line : {"goodman", "gerber", "soderberg", "table"}
        temperature : (...) float, °C, optional
            Temperature, for the line "table".

        Returns
        -------
        (...) float, Pa
        """
        validation.choice("line", line, LINES)
        return self._on_ray(means_per_amplitude(ratio), line, temperature)

    def _on_ray(self, rays: NDArray, line: str, temperature: NDArray | float | None) -> NDArray:
        """Return the allowable amplitudes (...) on rays (...) of a mean stress per amplitude.

        They are found by bisection: the amplitude rises along the ray, the allowable one falls.
        """
        highest = self.endurance_limit if self.haigh is None else max(self.haigh.amplitude)
        low = np.zeros_like(rays, float)
        high = np.full_like(low, 1.001 * max(highest, self.endurance_limit))
        n_halvings = 60  # to the last digit of a double
        for _ in range(n_halvings):
            middle = 0.5 * (low + high)
            endured = self.allowed(middle * rays, line, temperature) >= middle
            low = np.where(endured, middle, low)
            high = np.where(endured, high, middle)
        return np.asarray(0.5 * (low + high))

    @property
    def findley_limit(self) -> float:
        """Limit of Findley's ``tau_a + k sigma_max`` (Pa).

        It is the value in uniaxial stress at the endurance limit.
        """
        k = self.findley_k
        return 0.5 * self.endurance_limit * (k + np.sqrt(1.0 + k**2))


AISI_1050 = Material(
    endurance_limit=224e6,
    ultimate_strength=690e6,
    yield_strength=580e6,
    name="AISI 1050, cold drawn, machined, 99 % survival",
    source="Shigley's Mechanical Engineering Design: Table A-20 (690 and 580 MPa); "
    "endurance limit 0.5 Su times 4.51 Su^-0.265 (machined surface, Su in MPa) "
    "times 0.814 (99 % survival)",
)
"""Example of a material; not a blade material."""
