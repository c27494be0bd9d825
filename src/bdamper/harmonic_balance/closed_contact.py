"""Contact points that do not separate, or whose friction limit is constant, in terms of the elements of the core.

A point that stays closed has the two-sided normal spring ``n0 + kn v``.  It is the difference of two one-sided ones,

    n0 + kn v = max(n0 + kn v, 0) - max(-n0 - kn v, 0),

so a second point with the opposite normal is added to the first; it carries no force, and takes hardly any time, unless the
contact would open.  Friction acts where there is pressure, ``|T| <= mu max(n0 + kn v, 0)``.

With a constant friction limit the core has laws of its own, which keep the static normal load and a two-sided normal
spring.

Friction points that are open in the static state stay open: they are left out.  Bonded points neither open nor slip in any
case, and remain as they are.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bdamper.contact.law_codes import LAW_BONDED, LAW_CONSTANT, LAW_COUPLED, LAW_COUPLED_CONSTANT, LAW_NORMAL, LAW_SEPARABLE
from bdamper.contact.point_parameters import PointArrays
from bdamper.contact.static_state import OPEN, PreloadState
from bdamper.model.kinematics import HarmonicBasis

CONSTANT = {LAW_SEPARABLE: LAW_CONSTANT, LAW_COUPLED: LAW_COUPLED_CONSTANT}
"""The law of constant normal load that replaces each law of variable load."""


def without_separation(
    bases: list[HarmonicBasis], points: PointArrays, state: PreloadState, friction_points: NDArray, *, constant_load: bool
) -> tuple[list[HarmonicBasis], PointArrays]:
    """Modes and points under the assumption that the static contact area is kept.

    Parameters
    ----------
    bases : list of HarmonicBasis
    points : PointArrays
    state : PreloadState
        Static state: decides which points are closed, and the constant normal load.
    friction_points : (n_points,) bool
        The points to which the assumption applies; constraint planes remain one-sided.
    constant_load : bool
        The friction limit keeps its static value.

    Returns
    -------
    bases, points
        First the points that are kept, in their order, then the additional ones.
    """
    closed = ~(state.status == OPEN).any(axis=1)
    bonded = points.law == LAW_BONDED
    keep = np.flatnonzero(closed | bonded | ~friction_points)
    held = np.flatnonzero(closed & friction_points & ~bonded)
    if constant_load:
        kept = points.taken(keep)
        for i in np.flatnonzero(np.isin(keep, held)):
            law = int(kept.law[i])
            kept.law[i] = CONSTANT.get(law, LAW_CONSTANT if law == LAW_NORMAL else law)
        return [replace(b, G=b.G[keep]) for b in bases], replace(kept, load=state.force[keep, 2])
    source, added = np.concatenate([keep, held]), slice(len(keep), None)
    # components of the motion that each element of the new system sees, and their sense
    mask = np.ones((len(source), 3))
    mask[added] = [-0.0, -0.0, -1.0]
    new = points.taken(source)
    new.law[added] = LAW_NORMAL
    for array in (new.mu, new.kt, new.slider):
        array[added] = 0.0
    new.n0[added] *= -1.0
    new = replace(new, shift=new.shift * mask)
    return [replace(b, G=b.G[source] * mask[..., None]) for b in bases], new
