"""Initial distance of contact surfaces that do not fit: errors of angle and crowning."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bdamper.model.structure import Interface
from bdamper.util import validation


@validation.spelt
def face_gap(
    interface: Interface,
    *,
    angle: float = 0.0,
    axial_angle: float = 0.0,
    crowning: float = 0.0,
    axial_crowning: float = 0.0,
) -> NDArray:
    """Gap at the contact points of a plane face whose partner is turned against it or crowned.

    Parameters
    ----------
    interface : Interface
    angle, axial_angle : float, rad
        Slope of the gap along t1, along t2.
    crowning, axial_crowning : float, m
        The gap grows quadratically from the middle of the face to its outermost points along t1, along t2 by this height;
        negative for a hollow face.

    Returns
    -------
    (n_points,) float, m
        Smallest value 0: the surfaces are moved together until they touch.

    Raises
    ------
    SettingError
        If a number is not finite, or an angle beyond 0.1 rad.
    """
    validation.instance("interface", interface, Interface, "an Interface, for example model.interfaces['left']")
    for name, value in (("angle", angle), ("axial_angle", axial_angle)):
        validation.number(f"misfit {name}", value, least=-0.1, most=0.1, unit="rad")
    for name, value in (("crowning", crowning), ("axial_crowning", axial_crowning)):
        validation.number(f"misfit {name}", value, unit="m")
    away = interface.points - interface.points.mean(axis=0)
    gap = np.zeros(interface.n_points)
    for axis, slope, height in ((0, angle, crowning), (1, axial_angle, axial_crowning)):
        x = np.einsum("ij,ij->i", away, interface.frame[:, axis])
        gap += np.tan(slope) * x + height * (x / max(float(np.abs(x).max()), 1e-300)) ** 2
    return gap - gap.min()
