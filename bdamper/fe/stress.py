r"""Stress at nodes of a meshed body, and its rows for modes, contact forces and the centrifugal load.

The strain is taken at the node itself in each element that meets there, the stress tensor is averaged over these elements:
CalculiX' nodal values agree to a hundredth of a percent away from edges, while an extrapolation from integration points
is off by up to 3 %.  How far the elements differ is a sign of the error of the mesh; at an edge without a fillet the stress
does not converge at all.

.. math:: S = C B \Phi, \qquad A = C B\,(K^{-1} P^H - \Phi \Omega^{-2} \Phi^H P^H),
          \qquad \sigma_1 = C B\,u_s,\quad K u_s = M E_s x,\ E_s = \mathrm{diag}(1, 1, 0).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from skfem import Basis, ElementHexS2

from bdamper.fe.assemble import Discretisation
from bdamper.fe.geometry import Geometry, turn
from bdamper.fe.sector import SectorFE
from bdamper.model.stress import StressSet
from bdamper.reduction.cyclic import CyclicSector
from bdamper.reduction.patches import Patches

SHEARS = ((0, 1), (1, 2), (0, 2))
"""Indices of the components xy, yz, xz."""
ABOVE_ROOT = 1.0 / 6.0
"""Height of the shipped points above the root of the airfoil, of its whole height; the root itself is a sharp edge."""


def element_rows(body: Discretisation, nodes: NDArray) -> tuple[sp.csr_matrix, NDArray]:
    """Stress at nodes by each element that meets there.

    Parameters
    ----------
    body : Discretisation
    nodes : (n,) int

    Returns
    -------
    rows : (6 m, 3 n_nodes) sparse, Pa/m
        Components xx, yy, zz, xy, yz, xz of ``m`` pairs of a node and an element.
    owner : (m,) int
        The node of each pair, as its place in ``nodes``.
    """
    nodes = np.asarray(nodes)
    touched = np.flatnonzero(np.isin(body.elements, nodes).any(axis=1))
    local = ElementHexS2().doflocs.T
    basis = Basis(body.mesh, ElementHexS2(), elements=touched, quadrature=(local, np.ones(local.shape[1])))
    gradient = np.stack([b[0].grad for b in basis.basis])  # (20, 3, n_elements, 20): of shape function a at node L
    own = body.elements[touched]
    place = {int(node): k for k, node in enumerate(nodes)}
    pairs = [(place[int(own[e, L])], e, L) for e, L in np.argwhere(np.isin(own, nodes))]
    owner, e, L = (np.array(column, int) for column in zip(*pairs))
    g = gradient[:, :, e, L].transpose(2, 0, 1)  # (m, 20, 3)
    young, nu = body.material.youngs_modulus, body.material.poisson_ratio
    lame, shear = young * nu / ((1 + nu) * (1 - 2 * nu)), young / (2 * (1 + nu))
    blocks = np.zeros((len(owner), 6, 20, 3))
    for i in range(3):
        blocks[:, :3, :, i] += lame * g[:, None, :, i]
        blocks[:, i, :, i] += 2.0 * shear * g[..., i]
    for row, (i, j) in enumerate(SHEARS, 3):
        blocks[:, row, :, i] += shear * g[..., j]
        blocks[:, row, :, j] += shear * g[..., i]
    dof = (3 * own[e][:, :, None] + np.arange(3)).reshape(len(owner), 1, 60)
    columns = np.broadcast_to(dof, (len(owner), 6, 60)).ravel()
    lines = np.repeat(np.arange(6 * len(owner)), 60)
    rows = sp.csr_matrix((blocks.reshape(-1), (lines, columns)), shape=(6 * len(owner), body.n_dof))
    return rows, owner


def node_average(owner: NDArray, n: int) -> sp.csr_matrix:
    """(6 n, 6 m) sparse: mean over the pairs of each node."""
    share = 1.0 / np.bincount(owner, minlength=n)[owner]
    mean = sp.csr_matrix((share, (owner, np.arange(len(owner)))), shape=(n, len(owner)))
    return sp.kron(mean, sp.identity(6), format="csr")


def von_mises_size(stress: NDArray) -> NDArray:
    """(...) size of complex or real stress amplitudes (..., 6) by the form of von Mises."""
    normal, tangential = stress[..., :3], stress[..., 3:]
    square = 0.5 * (np.abs(normal - np.roll(normal, -1, axis=-1)) ** 2).sum(axis=-1)
    return np.sqrt(square + 3.0 * (np.abs(tangential) ** 2).sum(axis=-1))


def near_patches(points: NDArray, *faces: Patches) -> NDArray:
    """(n,) bool: points that lie on a patch or nearer to one than the mean length of its edges."""
    near = np.zeros(len(points), bool)
    for face in faces:
        local = np.einsum("pij,npj->npi", face.frame, points[:, None] - face.centre)
        beyond = np.maximum(np.abs(local[..., :2]) - 0.5 * face.size, 0.0)
        distance = np.sqrt((beyond**2).sum(axis=-1) + local[..., 2] ** 2)
        near |= (distance <= np.sqrt(face.area)).any(axis=1)
    return near


def stress_set(
    name: str,
    body_name: str,
    body: Discretisation,
    sector: Callable[[int], CyclicSector],
    contact: sp.spmatrix,
    nodes: NDArray,
    nodal_diameters: Iterable[int],
    n_modes: int,
    near_contact: NDArray | None = None,
    precision: Any = float,
) -> StressSet:
    """Stress rows of a body at nodes.

    Parameters
    ----------
    name, body_name : str
    body : Discretisation
    sector : function of the nodal diameter
    contact : (3 n_points, 3 n_nodes) sparse
        From nodal displacements to contact points, all ports of the body.
    nodes : (n,) int
        Away from the cut faces of the sector, where the neighbour's elements would belong to the average.
    nodal_diameters : iterable of int
        0 is always added.
    n_modes : int
    near_contact : (n,) bool, optional
    precision : {float, numpy.float32}
        Of the rows; single precision halves the file.

    Raises
    ------
    ValueError
        If a node lies on a cut face.
    """
    held = sector(0)
    if np.isin(nodes, np.concatenate([held.left, held.right])).any():
        raise ValueError("stress rows: expected nodes away from the cut faces of the sector")
    pairs, owner = element_rows(body, nodes)
    average = node_average(owner, len(nodes))
    rows = average @ pairs
    diameters = sorted({0, *nodal_diameters})
    modes, residual = {}, {}
    for d in diameters:
        reduced = sector(d)
        omega2, shapes = reduced.modes(n_modes)
        S = rows @ shapes
        unit = rows @ (reduced.transformation @ reduced.contact_response(contact))
        A = unit - (S / omega2) @ (contact @ shapes).conj().T
        modes[d], residual[d] = _kept(S, precision), _kept(A, precision)
    first = sector(next((d for d in diameters if d), 0)).modes(n_modes)[1][:, 0]
    mean = (rows @ first).reshape(-1, 6)
    apart = von_mises_size((pairs @ first).reshape(-1, 6) - mean[owner])
    spread = np.zeros(len(nodes))
    np.maximum.at(spread, owner, apart)
    load = body.body_force(body.nodes * np.array([1.0, 1.0, 0.0])).reshape(-1, 1)
    static = held.transformation @ held.static_response(load)
    return StressSet(
        name=name,
        body=body_name,
        points=body.nodes[nodes].copy(),
        modes=modes,
        contact=residual,
        static=(rows @ static.real).reshape(-1, 6),
        spread=spread / von_mises_size(mean),
        near_contact=near_contact,
        source="bdamper.fe.stress, mean over elements at nodes",
    )


def _kept(rows: NDArray, precision: Any) -> NDArray:
    out = rows.reshape(-1, 6, rows.shape[1])
    single = np.complex64 if np.iscomplexobj(out) else np.float32
    return out.astype(single).astype(out.dtype) if precision is np.float32 else out


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
    rows = stress_set("blade", "blade", fe.blade, fe.cyclic, contact, at, nodal_diameters, n_modes, near, np.float32)
    return {"blade": rows}


def blade_points(body: Discretisation, g: Geometry) -> NDArray:
    """Nodes of the shipped points: around the airfoil a sixth of its height above the root, and around the shank halfway.

    Leading and trailing edge and the middle of either side; the four edges of the shank and the middle of either side.
    """
    root = g.ridge_radius + g.platform_edge_thickness
    y = root + ABOVE_ROOT * g.airfoil_height
    chord = g.root_chord + ABOVE_ROOT * (g.tip_chord - g.root_chord)
    thickness = g.root_thickness + ABOVE_ROOT * (g.tip_thickness - g.root_thickness)
    c, s = np.cos(ABOVE_ROOT * g.twist), np.sin(ABOVE_ROOT * g.twist)
    section = [(-2.0 * g.camber / 3.0, sense * 0.5 * chord) for sense in (-1.0, 1.0)]
    section += [(g.camber / 3.0 + sense * 0.5 * thickness, 0.0) for sense in (-1.0, 1.0)]
    places = [[c * x + s * z, y, c * z - s * x] for x, z in section]
    middle = 0.5 * (np.sqrt(g.rim_radius**2 - 0.25 * g.shank_width**2) + _underside_at_shank(g))
    places += [[sx * 0.5 * g.shank_width, middle, sz * 0.5 * g.axial_length] for sx in (-1, 1) for sz in (-1, 0, 1)]
    return np.array([body.nearest_node(np.array(place)) for place in places])


def _underside_at_shank(g: Geometry) -> float:
    """Radius (m) at which the underside of the platform meets the shank."""
    return float(g.underside_points(np.array([g.underside_range[1]]))[0, 1])
