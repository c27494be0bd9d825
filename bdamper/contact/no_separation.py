"""Contact points that do not separate, or whose friction limit is constant, in terms of the elements of the core.

A point that stays closed has the two-sided normal spring ``n0 + kn v``.  It is the difference of two one-sided ones,

    n0 + kn v = max(n0 + kn v, 0) - max(-n0 - kn v, 0),

so a second point with the normal turned round joins the first; it carries no force, and costs next to nothing, unless the
contact would open.  Friction acts where there is pressure, ``|T| <= mu max(n0 + kn v, 0)``.

With a constant friction limit the core has laws of its own, which keep the static normal load and a two-sided normal
spring.

Friction points that are open in the static state stay open: they are left out.  Bonded points neither open nor slip in any
case, and remain what they are.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bdamper.contact.laws import LAW_BONDED, LAW_CONSTANT, LAW_COUPLED, LAW_COUPLED_CONSTANT, LAW_NORMAL, LAW_SEPARABLE
from bdamper.contact.points import PointArrays
from bdamper.contact.static import OPEN, PreloadState
from bdamper.model.coupling import HarmonicBasis

CONSTANT = {LAW_SEPARABLE: LAW_CONSTANT, LAW_COUPLED: LAW_COUPLED_CONSTANT}
"""The law of constant normal load that stands for each law of variable load."""


def without_separation(
    bases: list[HarmonicBasis],
    points: PointArrays,
    state: PreloadState,
    friction_points: NDArray,
    *,
    constant_load: bool,
) -> tuple[list[HarmonicBasis], PointArrays]:
    """Modes and points under the assumption that the static contact area is kept.

    Parameters
    ----------
    bases : list of HarmonicBasis
    points : PointArrays
    state : PreloadState
        Static state: decides which points are closed, and the constant normal load.
    friction_points : (n_points,) bool
        The points that the assumption is about; constraint planes remain one-sided.
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
        return _with_constant_load(bases, points, state, keep, np.isin(keep, held))
    normal = np.array([0.0, 0.0, 1.0])
    # for each element of the new system: the point, the components of its motion that it sees, and its sense
    parts: list[tuple[NDArray, NDArray]] = [(keep, np.ones(3)), (held, -normal)]
    n_keep, n_held = len(keep), len(held)
    source = np.concatenate([index for index, _ in parts])
    mask = np.concatenate([np.tile(m, (len(index), 1)) for index, m in parts])
    new = PointArrays(
        kt=points.kt[source],
        kn=points.kn[source],
        mu=points.mu[source],
        n0=points.n0[source],
        slider=points.slider[source],
        law=points.law[source],
        shift=points.shift[source] * mask,
        index=source,
    )
    reverse = slice(n_keep, n_keep + n_held)
    new.law[n_keep:] = LAW_NORMAL
    new.mu[n_keep:] = 0.0
    new.kt[n_keep:] = 0.0
    new.slider[n_keep:] = 0.0
    new.n0[reverse] *= -1.0
    return [replace(b, G=b.G[source] * mask[..., None]) for b in bases], new


def _with_constant_load(
    bases: list[HarmonicBasis], points: PointArrays, state: PreloadState, keep: NDArray, friction: NDArray
) -> tuple[list[HarmonicBasis], PointArrays]:
    """The kept points, those of friction interfaces under the static normal load."""
    law = points.law[keep].copy()
    for i in np.flatnonzero(friction):
        law[i] = CONSTANT.get(int(law[i]), LAW_CONSTANT if law[i] == LAW_NORMAL else int(law[i]))
    new = PointArrays(
        kt=points.kt[keep],
        kn=points.kn[keep],
        mu=points.mu[keep],
        n0=points.n0[keep],
        slider=points.slider[keep],
        law=law,
        shift=points.shift[keep],
        load=state.force[keep, 2],
        index=keep,
    )
    return [replace(b, G=b.G[keep]) for b in bases], new
