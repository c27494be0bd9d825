"""Contact points that do not separate, or whose friction limit is constant, in terms of the elements of the core.

A point that stays closed has the two-sided normal spring ``n0 + kn v``.  It is the difference of two one-sided ones,

    n0 + kn v = max(n0 + kn v, 0) - max(-n0 - kn v, 0),

so a second point with the normal turned round joins the first; it carries no force, and costs next to nothing, unless the
contact would open.  Friction acts where there is pressure, ``|T| <= mu max(n0 + kn v, 0)``.

With a constant friction limit the friction of a point is an element of its own that sees no normal motion and keeps the
static normal load; the normal spring is two-sided as before.

Friction points that are open in the static state stay open: they are left out.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bdamper.coupling import HarmonicBasis
from bdamper.preload import OPEN, PreloadState
from bdamper.system import LAW_NORMAL, PointArrays


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
    keep = np.flatnonzero(closed | ~friction_points)
    held = np.flatnonzero(closed & friction_points)
    normal = np.array([0.0, 0.0, 1.0])
    # for each element of the new system: the point, the components of its motion that it sees, and its sense
    parts: list[tuple[NDArray, NDArray]] = [(keep, np.ones(3)), (held, -normal)]
    n_keep, n_held = len(keep), len(held)
    if constant_load:
        parts.append((held, normal))
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
    )
    reverse = slice(n_keep, n_keep + n_held)
    new.law[n_keep:] = LAW_NORMAL
    new.mu[n_keep:] = 0.0
    new.kt[n_keep:] = 0.0
    new.n0[reverse] *= -1.0
    if constant_load:
        friction = np.isin(keep, held)
        mask[:n_keep][friction, 2] = 0.0
        new.shift[:n_keep][friction, 2] = 0.0
        new.kn[:n_keep][friction] = 0.0
        new.n0[:n_keep][friction] = state.force[keep[friction], 2]
    return [replace(b, G=b.G[source] * mask[..., None]) for b in bases], new
