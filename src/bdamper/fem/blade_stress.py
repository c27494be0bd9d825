"""Stress of the reference blade at the points that ship with its model; see :mod:`bdamper.fem.stress_rows`."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from bdamper.fem.assembly import Discretisation, local_order
from bdamper.fem.contact_patches import Patches
from bdamper.fem.element_stress import Solids
from bdamper.fem.geometry import Geometry, turn
from bdamper.fem.sector_matrices import SectorFE
from bdamper.fem.stress_rows import StressRows, near_patches
from bdamper.model.stress_recovery import StressSet


def solids_of(body: Discretisation) -> tuple[Solids, ...]:
    """The elements of a body."""
    m = body.material
    return (Solids("C3D20", body.elements[:, local_order()], m.youngs_modulus, m.poisson_ratio),)


def blade_stress(
    fe: SectorFE, contact: sp.spmatrix, faces: tuple[Patches, Patches], nodal_diameters: Iterable[int], n_modes: int
) -> dict[str, StressSet]:
    """The set "blade" of the reference sector, at :func:`blade_points`, in single precision.

    Parameters
    ----------
    fe : SectorFE
    contact : (3 n_points, 3 n_nodes) sparse
    faces : the patches "left" and "right" of the damper of sector 0
    nodal_diameters : iterable of int
    n_modes : int
    """
    at = blade_points(fe.blade, fe.geometry)
    near = near_patches(fe.blade.nodes[at], faces[0], faces[1].turned(turn(-fe.geometry.pitch)))
    rows = StressRows("blade", solids_of(fe.blade), fe.blade.nodes, at, near)
    for d in sorted({0, *nodal_diameters}):
        rows.add(fe.cyclic(d), contact, *fe.cyclic(d).modes(n_modes))
    return {"blade": rows.set("blade", "bdamper.fem.blade_stress, mean over elements at nodes")}


def blade_points(body: Discretisation, g: Geometry) -> NDArray:
    """Nodes of the shipped points: around the airfoil a sixth of its height above the root, and around the shank halfway.

    Leading and trailing edge and the middle of either side; the four edges of the shank and the middle of either side.
    """
    root = g.ridge_radius + g.platform_edge_thickness
    # height of the shipped points above the root of the airfoil, of its whole height; the root itself is a sharp edge
    above_root = 1.0 / 6.0
    y = root + above_root * g.airfoil_height
    chord = g.root_chord + above_root * (g.tip_chord - g.root_chord)
    thickness = g.root_thickness + above_root * (g.tip_thickness - g.root_thickness)
    c, s = np.cos(above_root * g.twist), np.sin(above_root * g.twist)
    section = [(-2.0 * g.camber / 3.0, sense * 0.5 * chord) for sense in (-1.0, 1.0)]
    section += [(g.camber / 3.0 + sense * 0.5 * thickness, 0.0) for sense in (-1.0, 1.0)]
    places = [[c * x + s * z, y, c * z - s * x] for x, z in section]
    underside = float(g.underside_points(np.array([g.underside_range[1]]))[0, 1])  # where it meets the shank
    middle = 0.5 * (np.sqrt(g.rim_radius**2 - 0.25 * g.shank_width**2) + underside)
    places += [[sx * 0.5 * g.shank_width, middle, sz * 0.5 * g.axial_length] for sx in (-1, 1) for sz in (-1, 0, 1)]
    return np.array([body.nearest_node(np.array(place)) for place in places])
