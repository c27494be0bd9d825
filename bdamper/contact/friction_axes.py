"""Tangential directions along which 1-D friction elements act: contact axes, or the major directions of the motion.

Two independent 1-D elements describe a planar motion best along its own principal axes, the major directions of the
paper's friction model (section 3).  They are those of the ellipse that the point draws in the contact plane when it
sticks, with ``u`` the complex amplitudes of its tangential motion:

    S = Re(u u^H),     tan(2 angle) = 2 S_12/(S_11 - S_22).

The stiffness along turned axes is the diagonal of the turned tensor; the term that couples the axes where ``kt_1 != kt_2``
is left out, since the two elements are independent.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bdamper.contact.points import PointArrays
from bdamper.model.coupling import HarmonicBasis


def major_angles(u: NDArray) -> NDArray:
    """Angle of the larger principal axis of planar harmonic motions from the first axis.

    Parameters
    ----------
    u : (n_points, 2) complex, m

    Returns
    -------
    (n_points,) float, rad, in (-pi/2, pi/2]; zero for circular motion and rest.
    """
    s11, s22 = np.abs(u[:, 0]) ** 2, np.abs(u[:, 1]) ** 2
    s12 = (u[:, 0] * u[:, 1].conj()).real
    return 0.5 * np.arctan2(2.0 * s12, s11 - s22)


def turned(bases: list[HarmonicBasis], points: PointArrays, angles: NDArray) -> tuple[list[HarmonicBasis], PointArrays]:
    """Modes and points with the tangential axes of every point turned in its contact plane.

    Parameters
    ----------
    bases : list of HarmonicBasis
    points : PointArrays
    angles : (n_points,) float, rad
    """
    c, s = np.cos(angles), np.sin(angles)
    R = np.array([[c, s], [-s, c]]).transpose(2, 0, 1)

    def turn(x: NDArray) -> NDArray:
        out = np.array(x)
        out[:, :2] = np.einsum("pij,pj...->pi...", R, x[:, :2])
        return out

    kt, slider = np.einsum("pij,pj->pi", R**2, points.kt), np.einsum("pij,pj->pi", R, points.slider)
    return [replace(b, G=turn(b.G)) for b in bases], replace(points, kt=kt, slider=slider, shift=turn(points.shift))
