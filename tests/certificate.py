"""Violations of equilibrium and of the contact conditions by static forces, from their definition in docs/theory.md."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bdamper.contact.static_contact import StaticContactProblem


def certify(
    problem: StaticContactProblem, force: NDArray, motion: NDArray, rest: NDArray
) -> dict[str, float]:
    """Largest violations by forces (n, 3) and motion (n, 3), ``rest`` (n, 2) where the points were stuck before.

    Forces are relative to the largest contact force, or to a thousandth of the load where there is hardly any,
    displacements to the largest relative motion, products to the product of both.
    """
    size = max(np.abs(force).max(), 1e-3 * np.abs(problem.load).max(initial=0.0), 1e-300)
    slip, normal, distance = motion[:, :2] - rest, force[:, 2], -motion[:, 2]
    reach, tangential = max(np.abs(motion).max(), 1e-300), force[:, :2]
    limit = problem.friction[:, None] * normal[:, None]
    balance = problem.rigid.T @ force.ravel() - problem.load
    largest, work = max(np.abs(problem.rigid).max(initial=0.0) * size, 1e-300), size * reach
    violations = {
        "equilibrium": np.abs(balance) / largest,
        "tension": -normal / size,
        "penetration": -distance / reach,
        "separation": np.abs(normal * distance) / work,
        "friction": (np.abs(tangential) - limit) / size,
        "sticking": np.abs((limit - np.abs(tangential)) * slip) / work,
        "sense": -tangential * slip / work,
    }
    return {name: float(np.max(values, initial=0.0)) for name, values in violations.items()}


def worst(problem: StaticContactProblem, solution) -> float:
    """The largest of all violations by a solution."""
    return max(certify(problem, solution.force, solution.motion, solution.rest).values())
