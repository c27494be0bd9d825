r"""Amplitude and mean of a stress tensor over a cycle, by four definitions.

A cycle is ``sigma(theta) = c_0 + sum_l Re[c_l exp(i l theta)]``, six components in the order xx, yy, zz, xy, yz, xz.

* *von Mises*: half the largest von Mises value of ``sigma(theta_1) - sigma(theta_2)`` over all pairs of instants; mean: the
  trace of the mean tensor (its stress under tension, nothing under shear).  Invariant, continuous, and the classical value
  where the stress is proportional.  Of one harmonic, ``sqrt((z^H D z + |z^T D z|)/2)`` with D the form of von Mises.
* *signed von Mises*: half the range, and the middle, of the von Mises value of the whole stress with the sign of its trace.
  It hides torsion on a mean tension, and jumps where the sign changes.
* *principal*: amplitude and middle of the normal stress on the one fixed plane on which its amplitude is largest.  The
  largest eigenvalue of an instant would halve a field that turns.
* *critical plane* (:func:`findley`): ``tau_a + k sigma_max`` on the plane where it is largest, ``tau_a`` the radius of the
  smallest circle around the path of the shear stress (W. N. Findley, J. Eng. Ind. 81, 301-306, 1959).

Instants are sampled, and the best ones refined by Newton's method, so that the result does not depend on where samples lie.

Limits of a material under vibration, and the factor between a cycle and these limits.

With amplitude a, mean m, :math:`m_+ = \max(m, 0)`, endurance limit :math:`S_e`, ultimate strength :math:`S_u` and yield
strength :math:`S_y`:

==========  =====================================================  ====================================
line        factor n on amplitude and mean together                factor on the amplitude alone
==========  =====================================================  ====================================
Goodman     :math:`1/n = a/S_e + m_+/S_u`                          :math:`S_e (1 - m_+/S_u)/a`
Soderberg   :math:`1/n = a/S_e + m_+/S_y`                          :math:`S_e (1 - m_+/S_y)/a`
Gerber      :math:`n a/S_e + (n m_+/S_u)^2 = 1`                    :math:`S_e (1 - (m_+/S_u)^2)/a`
==========  =====================================================  ====================================

Compression neither helps nor hurts.  On the amplitude alone is what counts for a blade: the speed of rotation fixes the
mean, the excitation may grow.  There a mean beyond its limit leaves nothing, a factor 0.  On both together the factor goes
through 1 where the mean alone meets its limit and stays positive: both may be divided by it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations_with_replacement
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bdamper.util import validation

# ---- Amplitude and mean of a stress tensor over a cycle, by four definitions ----


CRITERIA = ("von_mises", "signed_von_mises", "principal", "findley")

_INDEX = np.array([[0, 3, 5], [3, 1, 4], [5, 4, 2]])
# Coordinates in which the von Mises value of a tensor is its length: deviators by two normal differences and three shears.
_DEVIATOR = np.zeros((5, 6))
_DEVIATOR[0, :2] = [np.sqrt(3.0) / 2.0, -np.sqrt(3.0) / 2.0]
_DEVIATOR[1, :3] = [-0.5, -0.5, 1.0]
_DEVIATOR[2:, 3:] = np.sqrt(3.0) * np.eye(3)


class Cycle(NamedTuple):
    """Amplitude and mean (n,) of cycles, in the unit of the stress."""

    amplitude: NDArray
    mean: NDArray


def tensors(stress: NDArray) -> NDArray:
    """(..., 3, 3) tensors of components (..., 6)."""
    return np.asarray(stress)[..., _INDEX]


def von_mises(stress: NDArray) -> NDArray:
    """(...) von Mises value of stress (..., 6)."""
    return np.linalg.norm(np.asarray(stress) @ _DEVIATOR.T, axis=-1)


def angles(n_harmonics: int) -> NDArray:
    """(n,) rad: instants at which a cycle is sampled, 128 up to seven harmonics and 256 beyond."""
    n = 128 if n_harmonics <= 7 else 256
    return 2.0 * np.pi * np.arange(n) / n


def over_cycle(coefficients: NDArray, theta: NDArray) -> NDArray:
    """(..., n_theta) values of cycles (..., H + 1), the mean first."""
    l = np.arange(coefficients.shape[-1])
    return (np.asarray(coefficients) @ np.exp(1j * l[:, None] * theta)).real


def _at(coefficients: NDArray, theta: NDArray) -> tuple[NDArray, NDArray, NDArray]:
    """Values, first and second derivatives (n, m) of cycles (n, m, H + 1), each at an instant (n,) of its own."""
    l = np.arange(coefficients.shape[-1])
    wave = coefficients * np.exp(1j * l * theta[:, None])[:, None]
    return wave.sum(-1).real, (1j * l * wave).sum(-1).real, (-(l**2) * wave).sum(-1).real


def amplitude_and_mean(coefficients: NDArray, criterion: str = "von_mises") -> Cycle:
    """Amplitude and mean of cycles (n, 6, H + 1) by "von_mises", "signed_von_mises" or "principal"."""
    by = {"von_mises": _by_von_mises, "signed_von_mises": _by_signed_von_mises, "principal": _by_principal}
    coefficients = np.asarray(coefficients, complex)
    if not len(coefficients):
        return Cycle(np.zeros(0), np.zeros(0))
    blocks = np.array_split(coefficients, -(-len(coefficients) // 256))  # whose pairs of instants are held at once
    parts = [by[criterion](block) for block in blocks]
    return Cycle(*(np.concatenate(part) for part in zip(*parts)))


def _by_von_mises(c: NDArray) -> Cycle:
    y = np.einsum("ij,njl->nil", _DEVIATOR, c)
    y[..., 0] = 0.0  # differences do not see the mean
    theta = angles(c.shape[-1] - 1)
    path = over_cycle(y, theta)
    square = (path**2).sum(axis=1)
    apart = square[:, :, None] + square[:, None] - 2.0 * path.transpose(0, 2, 1) @ path
    best = apart.reshape(len(c), -1).argmax(axis=1)
    pair = theta[np.stack(np.unravel_index(best, apart.shape[1:]), axis=1)]
    value = _refine_pair(y, pair)
    return Cycle(0.5 * np.sqrt(value), c[:, :3, 0].real.sum(axis=1))


def largest_von_mises(coefficients: NDArray) -> NDArray:
    """(n,) largest von Mises value of the whole stress over cycles (n, 6, H + 1)."""
    c = np.asarray(coefficients, complex)
    y, theta = np.einsum("ij,njl->nil", _DEVIATOR, c), angles(c.shape[-1] - 1)
    at = theta[(over_cycle(y, theta) ** 2).sum(axis=1).argmax(axis=1)]

    def rates(at: NDArray) -> tuple[NDArray, NDArray]:
        value, rate, bend = _at(y, at)
        return (value * rate).sum(1), (rate**2 + value * bend).sum(1)

    at = _climbed(rates, at, theta[1])
    return np.linalg.norm(_at(y, at)[0], axis=1)


def _climbed(rates: Callable[[NDArray], tuple[NDArray, NDArray]], at: NDArray, most: float) -> NDArray:
    """Instants (n,) of maxima near given ones, by Newton's method with both derivatives, in steps up to ``most``."""
    for _ in range(4):
        slope, curve = rates(at)
        falls = curve < 0.0
        at = at + np.where(falls, np.clip(-slope / np.where(falls, curve, 1.0), -most, most), 0.0)
    return at


def _refine_pair(y: NDArray, pair: NDArray) -> NDArray:
    """Largest ``|y(theta_1) - y(theta_2)|^2`` (n,) near given pairs of instants, by Newton's method."""

    def parts(at: NDArray) -> tuple[NDArray, NDArray, NDArray]:
        (y1, d1, s1), (y2, d2, s2) = _at(y, at[:, 0]), _at(y, at[:, 1])
        diff = y1 - y2
        slope = 2.0 * np.stack([(diff * d1).sum(1), -(diff * d2).sum(1)], axis=1)
        mixed = -2.0 * (d1 * d2).sum(1)
        curve = np.empty((len(y), 2, 2))
        curve[:, 0, 0] = 2.0 * ((diff * s1).sum(1) + (d1**2).sum(1))
        curve[:, 1, 1] = 2.0 * ((d2**2).sum(1) - (diff * s2).sum(1))
        curve[:, 0, 1] = curve[:, 1, 0] = mixed
        return (diff**2).sum(1), slope, curve

    value, slope, curve = parts(pair)
    for _ in range(8):
        low, axes = np.linalg.eigh(curve)
        size = np.maximum(np.abs(low), 1e-9 * np.maximum(np.abs(low[:, :1]), 1e-300))
        step = np.einsum("nij,nj->ni", axes, np.einsum("nji,nj->ni", axes, slope) / size)
        step *= np.minimum(1.0, 0.1 / np.maximum(np.abs(step).max(axis=1), 1e-300))[:, None]
        new, new_slope, new_curve = parts(pair + step)
        better = new > value
        if not better.any():
            break
        pair = np.where(better[:, None], pair + step, pair)
        value = np.where(better, new, value)
        slope = np.where(better[:, None], new_slope, slope)
        curve = np.where(better[:, None, None], new_curve, curve)
    return value


def _extremes(c: NDArray) -> tuple[NDArray, NDArray]:
    """Instants (n,) of the largest and least value of scalar cycles (n, H + 1), by samples and Newton's method."""
    theta = angles(c.shape[-1] - 1)
    values = over_cycle(c, theta)

    def climbed(sense: float) -> NDArray:
        def rates(at: NDArray) -> tuple[NDArray, NDArray]:
            _, slope, curve = _at(c[:, None], at)
            return sense * slope[:, 0], sense * curve[:, 0]

        return _climbed(rates, theta[(sense * values).argmax(axis=1)], theta[1])

    return climbed(1.0), climbed(-1.0)


def _by_signed_von_mises(c: NDArray) -> Cycle:
    stress = over_cycle(c, 2.0 * np.pi * np.arange(1024) / 1024).transpose(0, 2, 1)
    signed = np.where(stress[..., :3].sum(-1) < 0.0, -1.0, 1.0) * von_mises(stress)
    high, low = signed.max(axis=1), signed.min(axis=1)
    return Cycle(0.5 * (high - low), 0.5 * (high + low))


def _by_principal(c: NDArray) -> Cycle:
    coarse = 2.0 * np.pi * np.arange(64) / 64
    i, j = np.triu_indices(len(coarse), 1)
    path = over_cycle(c, coarse)
    apart = (path[:, :, i] - path[:, :, j]).transpose(0, 2, 1)
    best = np.abs(np.linalg.eigvalsh(tensors(apart))).max(axis=-1).argmax(axis=1)
    first, second = coarse[i[best]], coarse[j[best]]
    for _ in range(30):
        difference = tensors(_at(c, first)[0] - _at(c, second)[0])
        value, axes = np.linalg.eigh(difference)
        top = np.abs(value[:, 2]) >= np.abs(value[:, 0])
        plane = np.where(top[:, None], axes[..., 2], axes[..., 0])
        normal = np.einsum("ni,nijl,nj->nl", plane, c[:, _INDEX], plane)
        first, second = _extremes(normal)
    high, low = (_at(normal[:, None], at)[0][:, 0] for at in (first, second))
    return Cycle(0.5 * (high - low), 0.5 * (high + low))


# -----------------------------------------------------------------------------------------------------------
# Critical plane


def findley(coefficients: NDArray, k: float, limit: float | None = None) -> NDArray:
    """(n,) largest ``tau_a + k sigma_max`` over all planes.

    Parameters
    ----------
    coefficients : (n, 6, H + 1) complex
    k : float
        Weight of the normal stress.
    limit : float, optional
        If given, the largest ``(tau_a + k sigma_a)/(limit - k sigma_m)`` instead: the reciprocal factor on the vibration
        alone, sigma_m and sigma_a mean and amplitude above it of the normal stress; infinite where the mean uses it up.
    """
    c = np.asarray(coefficients, complex)
    planes, values = _half_sphere(), np.zeros(len(c))
    for p in range(len(c)):
        start = planes[np.argsort(_plane_values(c[p], planes, k, limit, 64))[-3:]]
        values[p] = max(_refine_plane(c[p], normal, k, limit) for normal in start)
    return values


def _half_sphere(n_rings: int = 12) -> NDArray:
    """(n, 3) unit normals, about equally far apart: some 220 of a half sphere."""
    out = []
    for polar in (np.arange(n_rings) + 0.5) * 0.5 * np.pi / n_rings:
        n = max(round(4 * n_rings * np.sin(polar) * 0.6), 3)
        turn = 2.0 * np.pi * np.arange(n) / n
        out.append(np.column_stack([np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn), np.full(n, np.cos(polar))]))
    return np.concatenate(out)


def _frames(normals: NDArray) -> tuple[NDArray, NDArray]:
    """Two unit vectors (n, 3) in each plane."""
    helper = np.where(np.abs(normals[:, 2:]) < 0.9, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]])
    a = np.cross(normals, helper)
    a /= np.linalg.norm(a, axis=1)[:, None]
    return a, np.cross(normals, a)


def _plane_values(c: NDArray, normals: NDArray, k: float, limit: float | None, samples: int) -> NDArray:
    """(n,) value on each plane of one cycle (6, H + 1)."""
    traction = np.einsum("ijl,nj->nil", c[_INDEX], normals)
    a, b = _frames(normals)
    theta = 2.0 * np.pi * np.arange(samples) / samples
    normal = np.einsum("ni,nil->nl", normals, traction)
    path = np.stack([over_cycle(np.einsum("ni,nil->nl", t, traction), theta) for t in (a, b)], axis=-1)
    mean = normal[:, 0].real.copy()
    normal[:, 0] = 0.0
    rise = _parabola(over_cycle(normal, theta))
    radius = smallest_circle(path)
    if limit is None:
        return np.asarray(radius + k * (mean + rise))
    left = limit - k * mean
    return np.where(left > 0.0, (radius + k * rise) / np.where(left > 0.0, left, 1.0), np.inf)


def _parabola(values: NDArray) -> NDArray:
    """Largest values (n,) of periodic samples (n, m), by the parabola through the largest and its neighbours."""
    i = values.argmax(axis=1)
    n, rows = values.shape[1], np.arange(len(values))
    before, top, after = values[rows, i - 1], values[rows, i], values[rows, (i + 1) % n]
    bend = 2.0 * top - before - after
    return np.asarray(top + np.where(bend > 0.0, (after - before) ** 2 / (8.0 * np.where(bend > 0.0, bend, 1.0)), 0.0))


def _refine_plane(c: NDArray, normal: NDArray, k: float, limit: float | None) -> float:
    """Largest value on planes near a given one: steps along the sphere that are halved until they are 1e-4 rad."""
    turn = np.arange(8) * np.pi / 4.0
    value = float(_plane_values(c, normal[None], k, limit, 1024)[0])
    step = 0.1
    while step > 1e-4 and np.isfinite(value):
        a, b = _frames(normal[None])
        around = normal + step * (np.cos(turn)[:, None] * a + np.sin(turn)[:, None] * b)
        around /= np.linalg.norm(around, axis=1)[:, None]
        found = _plane_values(c, around, k, limit, 1024)
        if found.max() > value * (1.0 + 1e-12):
            value, normal = float(found.max()), around[found.argmax()]
        else:
            step *= 0.5
    return value


def smallest_circle(path: NDArray) -> NDArray:
    """Radius (n,) of the smallest circle around each path (n, m, 2).

    The farthest point joins the two or three that hold the circle until none lies outside; the radius rises at each step.
    """
    n = len(path)
    rows = np.arange(n)
    first = ((path - path.mean(axis=1)[:, None]) ** 2).sum(-1).argmax(axis=1)
    support = np.repeat(path[rows, first][:, None], 3, axis=1)
    centre, radius = support[:, 0].copy(), np.zeros(n)
    for _ in range(60):
        distance = np.linalg.norm(path - centre[:, None], axis=-1)
        far = distance.argmax(axis=1)
        outside = distance[rows, far] > radius * (1.0 + 1e-10) + 1e-300
        if not outside.any():
            break
        four = np.concatenate([support, path[rows, far][:, None]], axis=1)[outside]
        support[outside], centre[outside], radius[outside] = _circle_of_four(four)
    return radius


def _circle_of_four(points: NDArray) -> tuple[NDArray, NDArray, NDArray]:
    """Smallest circle (n) around four points (n, 4, 2), of which the last lies on it: its support, centre and radius."""
    centres, radii = [], []
    others = list(combinations_with_replacement(range(3), 2))  # one of the first three points beside the last, or two
    for i, j in others:
        a, b, c = points[:, i], points[:, j], points[:, 3]
        if i == j:
            centre = 0.5 * (a + c)
        else:
            u, v = a - c, b - c
            det = 2.0 * (u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])
            uu, vv = (u**2).sum(1), (v**2).sum(1)
            with np.errstate(all="ignore"):
                x = (v[:, 1] * uu - u[:, 1] * vv) / det
                y = (u[:, 0] * vv - v[:, 0] * uu) / det
            centre = c + np.stack([x, y], axis=1)
        centres.append(centre)
        radii.append(np.linalg.norm(centre - c, axis=1))
    centre, radius = np.stack(centres, 1), np.stack(radii, 1)
    with np.errstate(invalid="ignore"):
        reach = np.linalg.norm(points[:, None] - centre[:, :, None], axis=-1).max(axis=2)
    good = np.isfinite(radius) & (reach <= radius * (1.0 + 1e-9) + 1e-300)
    best = np.where(good, radius, np.inf).argmin(axis=1)
    rows = np.arange(len(points))
    support = np.column_stack([np.array(others)[best], np.full(len(rows), 3)])
    return points[rows[:, None], support], centre[rows, best], radius[rows, best]


# ---- Limits of a material under vibration, and the factor between a cycle and these limits ----


LINES = ("goodman", "gerber", "soderberg")
ON = ("amplitude", "both")


@validation.check_arguments
@dataclass(frozen=True)
class Material(validation.Checked):
    """Strength of a material, as the user knows it for this part.

    Parameters
    ----------
    endurance_limit : float, Pa
        Amplitude of fully reversed stress that is endured without end, at the survival, surface, size and temperature that
        the part is judged by.
    ultimate_strength, yield_strength : float, Pa
        At the same temperature.
    findley_k : float
        Weight of the normal stress in Findley's criterion, typically 0.2 to 0.3 for ductile metals; from two endurance
        limits where they are known.
    name, source : str

    Raises
    ------
    SettingError
        If a number is not positive, the yield strength exceeds the ultimate one, or the endurance limit that too.
    """

    endurance_limit: validation.Positive
    ultimate_strength: validation.Positive
    yield_strength: validation.Positive
    findley_k: validation.Positive = 0.3
    name: str = ""
    source: str = ""

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("yield_strength", "endurance_limit"):
            expected = f"at most the ultimate strength, {self.ultimate_strength:g} Pa"
            validation.check(not getattr(self, name) > self.ultimate_strength, name, expected, f"{getattr(self, name):g}")

    def limit(self, line: str) -> float:
        """Mean stress (Pa) that leaves no amplitude."""
        return float(self.yield_strength if line == "soderberg" else self.ultimate_strength)

    def allowed(self, mean: NDArray | float, line: str = "goodman") -> NDArray:
        """(...) amplitude (Pa) that is endured at a mean stress (Pa)."""
        share = np.maximum(np.asarray(mean, float), 0.0) / self.limit(line)
        left = 1.0 - (share**2 if line == "gerber" else share)
        return np.asarray(self.endurance_limit * np.maximum(left, 0.0))

    def factor(
        self, amplitude: NDArray | float, mean: NDArray | float, line: str = "goodman", on: str = "amplitude"
    ) -> NDArray:
        """(...) factor on the amplitude, or on amplitude and mean together, before the line is met.

        Parameters
        ----------
        amplitude, mean : (...) float, Pa
        line : {"goodman", "gerber", "soderberg"}
        on : {"amplitude", "both"}
        """
        validation.choice("line", line, LINES)
        validation.choice("on", on, ON)
        amplitude, mean = np.broadcast_arrays(np.asarray(amplitude, float), np.asarray(mean, float))
        with np.errstate(divide="ignore", invalid="ignore"):
            if on == "amplitude":
                allowed = self.allowed(mean, line)
                return np.where(amplitude > 0.0, allowed / amplitude, np.where(allowed > 0.0, np.inf, 0.0))
            b, share = amplitude / self.endurance_limit, np.maximum(mean, 0.0) / self.limit(line)
            if line == "gerber":  # the positive root, without the difference of nearly equal numbers
                return np.asarray(2.0 / (b + np.sqrt(b**2 + 4.0 * share**2)))
            return np.asarray(1.0 / (b + share))

    @property
    def findley_limit(self) -> float:
        """Findley's ``tau_a + k sigma_max`` at the endurance limit (Pa), by its closed form for uniaxial stress."""
        return 0.5 * self.endurance_limit * (self.findley_k + np.sqrt(1.0 + self.findley_k**2))


AISI_1050 = Material(
    endurance_limit=224e6,
    ultimate_strength=690e6,
    yield_strength=580e6,
    name="AISI 1050, cold drawn, machined, 99 % survival",
    source="Shigley's Mechanical Engineering Design: Table A-20 (690 and 580 MPa); endurance limit 0.5 Su times "
    "4.51 Su^-0.265 (machined surface, Su in MPa) times 0.814 (99 % survival)",
)
"""An example of how a material is stated; not one for blades."""
