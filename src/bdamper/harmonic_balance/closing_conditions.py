"""What is asked of a point beside the equations: one condition for the one free parameter.

A linear one is a plane in scaled unknowns; a stationary one holds where something has no slope along the curve, which
Newton's method on the curve and a secant along it find together (``csrc/solver/newton.c``).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Plane:
    """A plane through the guess.

    Parameters
    ----------
    normal : (n_unknowns + 1,) float
        In scaled unknowns; the tangent that is found points along it.
    """

    normal: NDArray


@dataclass(frozen=True)
class Fixed:
    """The parameter stays where the guess has it."""


@dataclass(frozen=True)
class Stationary:
    """Something has no slope along the curve.

    Parameters
    ----------
    tangent : (n_unknowns + 1,) float
        Estimate of the direction of the curve, of unit length in scaled unknowns.
    curvature : float
        Estimate of the derivative along the curve of what vanishes; its sign is that of the point.
    tolerance : float
        On the distance to the point, in scaled unknowns.
    max_step : float
        Along the curve at a time, in scaled unknowns.
    """

    tangent: NDArray
    curvature: float
    tolerance: float
    max_step: float


class Fold(Stationary):
    """The parameter: the tangent's last entry vanishes."""


class Peak(Stationary):
    """The amplitude of the first harmonic of the response, at a maximum: the slope of its logarithm falls through zero."""


Condition = Plane | Fixed | Fold | Peak


def for_core(condition: Condition, n_unknowns: int) -> tuple[NDArray, dict[str, Any]]:
    """The tangent on entry, which becomes that of the point found, and other arguments of the core's ``solve``."""
    if isinstance(condition, Plane):
        return np.zeros(n_unknowns + 1), {"row": condition.normal}
    if isinstance(condition, Fixed):
        return np.zeros(n_unknowns + 1), {"row": np.append(np.zeros(n_unknowns), 1.0)}
    return np.array(condition.tangent, float), {
        "curvature": condition.curvature, "place_tolerance": condition.tolerance, "max_step": condition.max_step,
    }  # fmt: skip
