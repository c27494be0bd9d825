"""Note on a vibration that opens points of a shroud that are closed at rest, or closes others."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bdamper.contact.preload_state import OPEN
from bdamper.harmonic_balance.contact_cycle import histories
from bdamper.harmonic_balance.problem import LoadCase
from bdamper.response.linear_limits import linear_peak
from bdamper.response.response_curve_result import CONTACT_CHANGES
from bdamper.util.formatting import listed

ANGLES = 128
"""Number of phase angles at which the contact of a cycle is evaluated."""
FORCE_OF_CONTACT = 1e-6
"""Normal force relative to the largest one of the face in the cycle, below which a point is open."""
ANOTHER_FREQUENCY = 1e-3
"""Relative distance from which a peak lies above the stuck resonance."""


def changes_of_contact(case: LoadCase, frequency: tuple[float, float], y: NDArray) -> str:
    """Return a note on a vibration that opens or closes points of a shroud, "" if none does.

    Parameters
    ----------
    case : LoadCase
    frequency : (low, high), Hz
        Interval of the stuck resonance.
    y : (n_unknowns + 1,) float
        Solution at the highest point.
    """
    problem = case.problem
    settings = problem.settings
    faces = settings.shrouds
    # without separation the contact area does not change
    if not faces or not (settings.separation and settings.variable_normal_load):
        return ""
    theta = np.linspace(0.0, 2.0 * np.pi, ANGLES, endpoint=False)
    _, force = histories(case.equations, y[:-1], theta)
    closed_at_rest = ~(case.static.status == OPEN).any(axis=1)
    texts = []
    for name in faces:
        rows = problem.coupling.rows(name)
        normal = force[rows, 2]
        touches = normal > FORCE_OF_CONTACT * normal.max(initial=0.0)
        closed = closed_at_rest[rows]
        opens = int(np.sum(closed & ~touches.all(axis=1)))
        closes = int(np.sum(~closed & touches.any(axis=1)))
        parts = []
        if opens:
            parts.append(f"opens {opens} of the {int(closed.sum())} points closed at rest")
        if closes:
            parts.append(f"closes {closes} of the {int(np.sum(~closed))} points open at rest")
        if parts:
            texts.append(f"{' and '.join(parts)} on '{name}'")
    if not texts:
        return ""
    note = CONTACT_CHANGES.format(listed(texts))
    stuck = linear_peak(case, frequency, stuck=True)
    hertz = float(y[-1]) / (2.0 * np.pi)
    if hertz > (1.0 + ANOTHER_FREQUENCY) * stuck.frequency:
        note += (
            f"; the peak lies above the stuck resonance of the points closed at rest, "
            f"{stuck.frequency:.4g} Hz"
        )
    return note
