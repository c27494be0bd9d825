r"""Stress at the nodes of solid elements as a linear function of nodal displacements, and stress
sets of a sector.

As in CalculiX, Abaqus, Ansys and Nastran, the stress at the integration points of an element is
extrapolated to its nodes and averaged over adjacent elements.  The difference between adjacent
elements indicates the discretisation error.  At an edge without fillet the stress does not
converge.  On a coarse, distorted block each element type agrees with CalculiX to 3e-4 of the
largest stress, the precision of its file.  Strain evaluated at the nodes differs by 7e-3 with 20
nodes.

Shape functions, nodes and integration points come from scikit-fem (extra ``bdamper[fe]``).  It
lacks the wedge of 15 nodes, which follows from its functions of the triangle (first order
:math:`\lambda_a`, second order :math:`T`) and of the line (:math:`l_e`, bubble b):

.. math:: N_{ae} = T_a l_e - \tfrac12 \lambda_a b,\qquad N_{ab,e} = T_{ab} l_e,\qquad N_a = \lambda_a b .

A stress set contains the stress of modes, of contact forces and of the centrifugal load at chosen
nodes:

.. math:: S = C B \Phi, \qquad A = C B\,(K^{-1} P^H - \Phi \Omega^{-2} \Phi^H P^H),
          \qquad \sigma_1 = C B\,u_s,\quad K u_s = M E_s x,\ E_s = \mathrm{diag}(1, 1, 0).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import combinations
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from skfem import (
    ElementHex1,
    ElementHexS2,
    ElementLineP1,
    ElementLineP2,
    ElementTetP1,
    ElementTetP2,
    ElementTriP1,
    ElementTriP2,
    ElementWedge1,
)
from skfem.quadrature import get_quadrature

from bdamper.fem.contact_patches import SQUARE, Patches
from bdamper.fem.cyclic_symmetry import CyclicSector
from bdamper.fem.rotation import spin_displacement
from bdamper.fem.surface import N_CORNER
from bdamper.model.structure import StressSet

# ---- Stress at nodes ----


SHEARS = ((0, 1), (1, 2), (0, 2))
"""Indices of the components xy, yz, xz."""
_FIRST = {4: ElementTetP1(), 6: ElementWedge1(), 8: ElementHex1()}
_SECOND = {10: ElementTetP2(), 20: ElementHexS2()}
_TRIANGLE = np.array([[0, 0], [1, 0], [0, 1]], float)
_USUAL_CORNERS = {
    4: np.vstack([np.zeros(3), np.eye(3)]),
    6: np.array([[*xy, z] for z in (0.0, 1.0) for xy in _TRIANGLE]),
    8: np.array([[*xy, z] for z in (0.0, 1.0) for xy in 0.5 * (SQUARE + 1.0)]),
}
"""Positions of the corners of tetrahedron, wedge and hexahedron on the reference elements of
scikit-fem.  The order is that of the programs, in which elements are given; the order of
scikit-fem differs."""


@dataclass(frozen=True)
class Solids:
    """Solid elements of one type and one isotropic material.

    Parameters
    ----------
    kind : str
        Name in CalculiX and Abaqus: "C3D4", "C3D6", "C3D8", "C3D8I", "C3D8R", "C3D10", "C3D15",
        "C3D20", "C3D20R".  "C3D6" has six integration points; "C3D6R" is the wedge of CalculiX with
        two.
    nodes : (n, 4 | 6 | 8 | 10 | 15 | 20) int
        Corners first, in the usual order; midside nodes in any order.
    youngs_modulus : float, Pa
    poisson_ratio : float
    """

    kind: str
    nodes: NDArray
    youngs_modulus: float
    poisson_ratio: float


def _values(element: Any, points: NDArray) -> tuple[NDArray, NDArray]:
    """Return shape functions and their gradients for an element of scikit-fem.

    Returns
    -------
    values : (n, n_points)
    gradients : (n, dimension, n_points)
    """
    values, gradients = [], []
    for k in range(len(element.doflocs)):
        value, gradient = element.lbasis(points, k)
        values.append(value)
        gradients.append(gradient)
    return np.array(values), np.array(gradients)


def _wedge(points: NDArray) -> tuple[NDArray, NDArray]:
    """Return shape functions and gradients of the second-order wedge.

    The nodes are the corners, the edges of the triangles, then the other edges.
    """
    across = points[:2]
    along = points[2:]
    quadratic, d_quadratic = _values(ElementTriP2(), across)
    linear, d_linear = _values(ElementTriP1(), across)
    ends, d_ends = _values(ElementLineP1(), along)
    line, d_line = _values(ElementLineP2(), along)
    # the third function of the line is its bubble
    middle = line[2]
    d_middle = d_line[2]

    def product(f: NDArray, df: NDArray, g: NDArray, dg: NDArray) -> NDArray:
        """Return f g with its three derivatives, for f of the triangle and g of the line."""
        value = (f * g)[:, None]
        d_across = df * g
        d_along = (f * dg[0])[:, None]
        return np.concatenate([value, d_across, d_along], axis=1)

    upright = product(linear, d_linear, middle, d_middle)
    lower = product(quadratic, d_quadratic, ends[0], d_ends[0])
    upper = product(quadratic, d_quadratic, ends[1], d_ends[1])
    # the corners are zero at the middles of the upright edges
    lower_corners = lower[:3] - 0.5 * upright
    upper_corners = upper[:3] - 0.5 * upright
    every = np.concatenate([lower_corners, upper_corners, lower[3:], upper[3:], upright])
    return every[:, 0], every[:, 1:]


def _shape_functions(n_nodes: int, points: NDArray) -> tuple[NDArray, NDArray]:
    """Return shape functions and their gradients for an element with ``n_nodes`` nodes.

    Returns
    -------
    values : (n_nodes, n_points)
    gradients : (n_nodes, 3, n_points)
    """
    if n_nodes == 15:
        return _wedge(points)
    return _values({**_FIRST, **_SECOND}[n_nodes], points)


@cache
def _places(n_nodes: int) -> NDArray:
    """Return the nodes (n_nodes, 3) of a reference element."""
    if n_nodes != 15:
        return np.asarray({**_FIRST, **_SECOND}[n_nodes].doflocs)
    corners = _FIRST[6].doflocs
    edge = ElementTriP2().doflocs[3:]
    bottom_edges = np.column_stack([edge, np.full(3, 0.0)])
    top_edges = np.column_stack([edge, np.full(3, 1.0)])
    upright_edges = np.column_stack([_TRIANGLE, np.full(3, 0.5)])
    return np.concatenate([corners, bottom_edges, top_edges, upright_edges])


def _integration_points(kind: str, n_nodes: int) -> NDArray:
    """Return the integration points (3, n_points) of a reference element."""
    n_corners = N_CORNER[n_nodes]
    if n_corners == 6:
        return _wedge_points(kind, n_nodes)
    first = _FIRST[n_corners]
    if n_corners == 8:
        # exact to degree 5 with 3 x 3 x 3 points, or to degree 3 with 2 x 2 x 2 points
        degree = 5 if n_nodes == 20 and kind != "C3D20R" else 3
        return get_quadrature(first, degree)[0]
    four_points = get_quadrature(first, 2)[0]
    # a tetrahedron of first order has constant stress
    if n_nodes == 4:
        return four_points.mean(axis=1, keepdims=True)
    return four_points


def _wedge_points(kind: str, n_nodes: int) -> NDArray:
    """Return the integration points (3, n_points) of a wedge, for which scikit-fem has no rule.

    Each point of a triangle is repeated along the line of points.
    """
    triangle = get_quadrature(ElementTriP1(), 2)[0]
    if kind == "C3D6R":
        triangle = triangle.mean(axis=1, keepdims=True)
    # two points for the first order, three for the second
    degree = 3 if n_nodes == 6 else 5
    (line,) = get_quadrature(ElementLineP1(), degree)[0]
    points = []
    for z in line:
        for x, y in triangle.T:
            points.append([x, y, z])
    return np.array(points).T


@cache
def _samples(kind: str, n_nodes: int) -> tuple[NDArray, NDArray]:
    """Return the integration points and the extrapolation to the nodes.

    The extrapolation fits the first-order shape functions by least squares; with 27 points it uses
    all 20 functions.

    Returns
    -------
    points : (3, n_points)
    extrapolation : (n_nodes, n_points)
    """
    points = _integration_points(kind, n_nodes)
    n_points = points.shape[1]
    fitted = _SECOND[20] if n_points == 27 else _FIRST[N_CORNER[n_nodes]]
    functions_at_nodes = _values(fitted, _places(n_nodes).T)[0].T
    functions_at_points = _values(fitted, points)[0].T
    # the pseudoinverse gives the coefficients of the fit for a value of 1 at each point
    coefficients = np.linalg.pinv(functions_at_points)
    return points, functions_at_nodes @ coefficients


def in_reference_order(elements: NDArray, nodes: NDArray) -> NDArray:
    """Return the nodes of elements (n_elements, n) in the order of the reference element.

    That is the order of :func:`_places`.  The corners are given in the usual order and only change
    places.  The midside nodes are given in any order; their positions ``nodes`` (n_nodes, 3)
    identify the edges.

    Raises
    ------
    ValueError
        If a midside node is missing.
    """
    n = elements.shape[1]
    n_corners = N_CORNER[n]
    places = _places(n)
    corner_places = places[:n_corners]
    midside_places = places[n_corners:]

    # for each reference corner, the place in the usual order with the same position
    to_usual = _USUAL_CORNERS[n_corners] - corner_places[:, None]  # (reference, usual, 3)
    usual_index = np.linalg.norm(to_usual, axis=2).argmin(axis=1)
    corner_nodes = elements[:, usual_index]
    if n == n_corners:
        return corner_nodes

    # for each reference midside node, the pair of corners with the node in the middle
    pairs = np.array(list(combinations(range(n_corners), 2)))
    pair_middles = 0.5 * (corner_places[pairs[:, 0]] + corner_places[pairs[:, 1]])
    to_middle = pair_middles - midside_places[:, None]  # (midside, pair, 3)
    edges = pairs[np.linalg.norm(to_middle, axis=2).argmin(axis=1)]

    # for each edge of each element, the midside node nearest to its middle
    ends = nodes[corner_nodes[:, edges]]  # (element, edge, 2, 3)
    edge_middles = ends.mean(axis=2)
    given = elements[:, n_corners:]
    to_given = nodes[given][:, None] - edge_middles[:, :, None]  # (element, edge, given, 3)
    distance = np.linalg.norm(to_given, axis=3)
    edge_length = np.linalg.norm(ends[:, :, 1] - ends[:, :, 0], axis=2)
    # the second term allows rounding on collapsed edges
    if np.any(distance.min(axis=2) > 0.3 * edge_length + 1e-9 * edge_length.max()):
        raise ValueError("second-order element: no midside node between two corners")
    midside_nodes = np.take_along_axis(given, distance.argmin(axis=2), axis=1)
    return np.hstack([corner_nodes, midside_nodes])


def _gradients(group: Solids, x: NDArray) -> tuple[NDArray, NDArray | None]:
    """Return gradients of all shape functions at the nodes of elements ``x`` (n_elements, n, 3).

    The gradients are computed at the integration points and extrapolated to the nodes.

    Returns
    -------
    gradient : (n_elements, n, n, 3)
        By element, node, shape function and coordinate.  For C3D8I (n_elements, 8, 11, 3), with
        three bubbles after the eight shape functions.
    bubbles : (n_elements, 9, 24) or None
        Bubble amplitudes for nodal displacements; None unless the elements are C3D8I.
    """
    n = x.shape[1]
    bubbles = None
    points, extrapolation = _samples(group.kind, n)
    _, local = _shape_functions(n, points)
    # e element, p integration point, a shape function, i coordinate, j coordinate of the
    # reference element
    jacobian = np.einsum("eai,ajp->epij", x, local, optimize=True)
    gradient = np.einsum("ajp,epji->epai", local, np.linalg.inv(jacobian), optimize=True)
    volume = np.abs(np.linalg.det(jacobian))
    if group.kind == "C3D8R":
        # reduced integration: all points have the mean gradient over the volume
        share = volume / volume.sum(axis=1, keepdims=True)
        mean = np.einsum("ep,epai->eai", share, gradient)
        gradient = np.repeat(mean[:, None], points.shape[1], axis=1)
    elif group.kind == "C3D8I":
        gradient, bubbles = _with_bubbles(group, x, points, gradient, volume)
    # L is the node to which the gradient is extrapolated
    at_nodes = np.einsum("Lp,epai->eLai", extrapolation, gradient, optimize=True)
    return at_nodes, bubbles


def nodal_integrals(elements: NDArray, nodes: NDArray) -> tuple[NDArray, NDArray, NDArray]:
    """Integrate the shape functions of solid elements and their gradients.

    Parameters
    ----------
    elements : (n_elements, n) int
        See :class:`Solids`.
    nodes : (n_nodes, 3) float, m

    Returns
    -------
    ordered : (n_elements, n) int
        Nodes of the elements in the order of the integrals.
    volume : (n_elements, n) float, m3
    gradient : (n_elements, n, 3) float, m2

    Raises
    ------
    ValueError
        If an element lacks a midside node.
    """
    ordered = in_reference_order(elements, nodes)
    n = elements.shape[1]
    if N_CORNER[n] == 6:
        # scikit-fem has no rule for wedges
        across, across_weight = get_quadrature(ElementTriP1(), 4)
        along, along_weight = get_quadrature(ElementLineP1(), 4)
        n_across, n_along = len(across_weight), len(along_weight)
        points = np.vstack([np.repeat(across, n_along, axis=1), np.tile(along, n_across)])
        weight = np.outer(across_weight, along_weight).ravel()
    else:
        points, weight = get_quadrature(_FIRST[N_CORNER[n]], 4)
    values, local_gradient = _shape_functions(n, points)
    # e element, p quadrature point, a shape function, i coordinate, j reference coordinate
    jacobian = np.einsum("eai,ajp->epij", nodes[ordered], local_gradient, optimize=True)
    # determinant times transposed inverse: these cofactors are finite where a collapsed element
    # has no inverse
    columns = []
    for k in range(3):
        column_after = jacobian[..., (k + 1) % 3]
        second_after = jacobian[..., (k + 2) % 3]
        columns.append(np.cross(column_after, second_after))
    cofactor = np.stack(columns, axis=-1)
    determinant = np.einsum("epi,epi->ep", jacobian[..., 0], cofactor[..., 0])
    # the determinant is negative for corners in the opposite sense of rotation
    signed = weight * np.sign(determinant)
    gradient = np.einsum("ep,ajp,epij->eai", signed, local_gradient, cofactor, optimize=True)
    volume = (signed * determinant) @ values.T
    return ordered, volume, gradient


def _with_bubbles(
    group: Solids, x: NDArray, points: NDArray, gradient: NDArray, volume: NDArray
) -> tuple[NDArray, NDArray]:
    """Add the incompatible modes of C3D8I (Wilson), condensed for zero force.

    As in CalculiX 2.20 their gradients use the map at the centre.  Other programs scale them by its
    volume, which changes the stress of a distorted block by 5 %.

    Parameters
    ----------
    x : (n_elements, 8, 3) float, m
    points : (3, n_points)
        Integration points on the reference element.
    gradient : (n_elements, n_points, 8, 3)
    volume : (n_elements, n_points)

    Returns
    -------
    gradient : (n_elements, n_points, 11, 3)
        Gradients of the shape functions, then of the bubbles.
    bubbles : (n_elements, 9, 24)
        Bubble amplitudes for nodal displacements.
    """
    _, centre_gradient = _values(_FIRST[8], np.full((3, 1), 0.5))
    centre = np.einsum("eai,ajp->eij", x, centre_gradient)
    # bubble k is 4 s (1 - s) in the reference coordinate s = k and depends on no other
    local = 4.0 * (1.0 - 2.0 * points.T)[:, :, None] * np.eye(3)  # (point, bubble, coordinate)
    bubble_gradient = np.einsum("pkj,eji->epki", local, np.linalg.inv(centre), optimize=True)
    gradient = np.concatenate([gradient, bubble_gradient], axis=2)
    lame, shear = lame_constants(group.youngs_modulus, group.poisson_ratio)
    # stiffness of isotropic elasticity, by element, bubble k, component i, function b, component j:
    # lame h_kibj + shear h_kjbi + shear delta_ij sum_l h_klbl
    h = np.einsum("ep,epki,epbj->ekibj", volume, bubble_gradient, gradient, optimize=True)
    stiffness = lame * h + shear * h.transpose(0, 1, 4, 3, 2)
    stiffness[:, :, range(3), :, range(3)] += shear * np.einsum("ekibi->ekb", h)
    stiffness = stiffness.reshape(len(x), 9, 33)
    # no force acts on the bubbles: of_nodes @ displacements + of_bubbles @ amplitudes = 0
    of_nodes = stiffness[:, :, :24]
    of_bubbles = stiffness[:, :, 24:]
    return gradient, -np.linalg.solve(of_bubbles, of_nodes)


def lame_constants(young: float, nu: float) -> tuple[float, float]:
    """Return Lame's constants, Pa, for Young's modulus and Poisson's ratio."""
    lame = young * nu / ((1 + nu) * (1 - 2 * nu))
    shear = young / (2 * (1 + nu))
    return lame, shear


def element_rows(
    solids: Sequence[Solids], nodes: NDArray, wanted: NDArray
) -> tuple[sp.csr_matrix, NDArray]:
    """Compute the stress at nodes from each adjacent element.

    Parameters
    ----------
    solids : sequence of Solids
    nodes : (n_nodes, 3) float, m
    wanted : (n,) int

    Returns
    -------
    rows : (6 m, 3 n_nodes) sparse, Pa/m
        Components xx, yy, zz, xy, yz, xz for ``m`` pairs of node and element.  If a node occurs
        repeatedly in a collapsed element, the mean over its positions forms one pair.
    owner : (m,) int
        Index of the node of each pair in ``wanted``.

    Raises
    ------
    ValueError
        If an element has no volume at an integration point, or lacks a midside node.
    """
    parts, owners = [], []
    # index of each node in wanted, -1 if it is not wanted
    position = np.full(len(nodes), -1)
    position[wanted] = np.arange(len(wanted))
    for group in solids:
        has_wanted_node = (position[group.nodes] >= 0).any(axis=1)
        touched = group.nodes[has_wanted_node]
        if not len(touched):
            continue
        ordered = in_reference_order(touched, nodes)
        try:
            gradient, bubbles = _gradients(group, nodes[ordered])
        except np.linalg.LinAlgError:
            raise ValueError(
                f"elements {group.kind} without volume at one of their points"
            ) from None
        # element and local number of each occurrence of a wanted node
        e, local = np.nonzero(position[ordered] >= 0)
        n_found = len(e)
        blocks = _stress(group, gradient[e, local])  # (n_found, 6, 3 n)
        if bubbles is not None:
            # the nodal displacements determine the bubbles
            blocks = blocks[..., :24] + blocks[..., 24:] @ bubbles[e]
        # the displacements of all nodes of the element, the same for its six stress components
        dof = (3 * ordered[e][:, :, None] + np.arange(3)).reshape(n_found, 1, -1)
        columns = np.broadcast_to(dof, blocks.shape)
        lines = np.repeat(np.arange(6 * n_found), dof.shape[2])
        shape = (6 * n_found, 3 * len(nodes))
        rows = sp.csr_matrix((blocks.ravel(), (lines, columns.ravel())), shape=shape)
        # a collapsed element has a node repeatedly: average over the pairs of element and node,
        # whose number also contains the node
        pair_number = e * len(nodes) + position[ordered[e, local]]
        pairs, pair_of_row = np.unique(pair_number, return_inverse=True)
        parts.append(node_average(pair_of_row, len(pairs)) @ rows)
        owners.append(pairs % len(nodes))
    return sp.vstack(parts, format="csr"), np.concatenate(owners)


def _stress(group: Solids, gradient: NDArray) -> NDArray:
    """Return the stress (m, 6, 3 n) for unit displacements of ``n`` nodes at ``m`` places.

    ``gradient`` (m, n, 3) has the gradients of the shape functions at these places.  The stress
    components are xx, yy, zz, xy, yz, xz.
    """
    m, n, _ = gradient.shape
    lame, shear = lame_constants(group.youngs_modulus, group.poisson_ratio)
    # by place, stress component, node, direction of its displacement
    blocks = np.zeros((m, 6, n, 3))
    for i in range(3):
        # the dilation contributes to all normal stresses
        blocks[:, :3, :, i] += lame * gradient[:, None, :, i]
        blocks[:, i, :, i] += 2.0 * shear * gradient[..., i]
    for row, (i, j) in enumerate(SHEARS, start=3):
        blocks[:, row, :, i] += shear * gradient[..., j]
        blocks[:, row, :, j] += shear * gradient[..., i]
    return blocks.reshape(m, 6, 3 * n)


def von_mises_size(stress: NDArray) -> NDArray:
    """Return the von Mises norm (...) of complex or real stress amplitudes (..., 6)."""
    normal = stress[..., :3]
    shear = stress[..., 3:]
    difference = normal - np.roll(normal, -1, axis=-1)
    square = 0.5 * (np.abs(difference) ** 2).sum(axis=-1)
    return np.sqrt(square + 3.0 * (np.abs(shear) ** 2).sum(axis=-1))


def node_average(owner: NDArray, n: int) -> sp.csr_matrix:
    """Return the sparse matrix (6 n, 6 m) of the mean over the pairs of each node.

    Pair i has six rows and belongs to node ``owner[i]`` (m,); there are ``n`` nodes.
    """
    pairs_of_node = np.bincount(owner, minlength=n)
    share = 1.0 / pairs_of_node[owner]
    mean = sp.csr_matrix((share, (owner, np.arange(len(owner)))), shape=(n, len(owner)))
    return sp.kron(mean, sp.identity(6), format="csr")


# ---- Stress sets of a sector ----


def near_patches(points: NDArray, *faces: Patches) -> NDArray:
    """Return whether each point (n,) is on a patch, or closer to it than the mean length of its
    edges."""
    near = np.zeros(len(points), bool)
    for face in faces:
        # along t1, t2 and n of each patch
        local = np.einsum("pij,npj->npi", face.frame, points[:, None] - face.centre)
        beyond = np.maximum(np.abs(local[..., :2]) - 0.5 * face.size, 0.0)
        distance = np.sqrt((beyond**2).sum(axis=-1) + local[..., 2] ** 2)
        near |= (distance <= np.sqrt(face.area)).any(axis=1)
    return near


class StressRows:
    """Collector of the stress of all vectors of a body over nodal diameters, in single precision.

    Parameters
    ----------
    name : str
    solids : sequence of Solids
    positions : (n_nodes, 3) float, m
    nodes : (n,) int
        Not on the cut faces of the sector, where elements of the neighbouring sector would
        contribute to the average.
    near_contact : (n,) bool, optional

    Raises
    ------
    ValueError
        See :func:`bdamper.fem.element_stress.element_rows`.
    """

    def __init__(
        self,
        name: str,
        solids: Sequence[Solids],
        positions: NDArray,
        nodes: NDArray,
        near_contact: NDArray | None = None,
    ) -> None:
        self.name = name
        self.nodes = nodes
        self.points = positions[nodes]
        self._near = near_contact
        self._pairs, self._owner = element_rows(solids, positions, nodes)
        self._rows = node_average(self._owner, len(nodes)) @ self._pairs
        self._modes: dict[int, NDArray] = {}
        self._contact: dict[int, NDArray] = {}
        self._static: NDArray | None = None
        self._spread: NDArray | None = None

    def add(
        self, sector: CyclicSector, contact: sp.spmatrix, omega2: NDArray, shapes: NDArray
    ) -> None:
        """Add the stress of modes and contact forces at one nodal diameter, at 0 also the stress of
        the centrifugal load.

        Parameters
        ----------
        sector : CyclicSector
        contact : (3 n_points, 3 n_nodes) sparse
            Matrix from nodal displacements to the contact points of all ports.
        omega2, shapes : (n,), (3 n_nodes, n)
            Squared frequencies (rad2/s2) and shapes of the basis of the body.
        """
        d = sector.nodal_diameter
        modes = self._rows @ shapes
        unit = self._rows @ (sector.transformation @ sector.contact_response(contact))
        # static stress of contact forces without its part in the modes
        contact_stress = unit - (modes / omega2) @ (contact @ shapes).conj().T
        self._modes[d] = self._kept(modes)
        self._contact[d] = self._kept(contact_stress)
        if d == 0:
            self._static = (self._rows @ spin_displacement(sector).real).reshape(-1, 6)
        # the lowest mode of the first nodal diameter other than 0 determines the spread; nodal
        # diameter 0 comes first and is replaced
        is_first_other = d > 0 and len(self._modes) <= 2
        if is_first_other or self._spread is None:
            lowest_shape = shapes[:, 0]
            self._spread = self._spread_of(lowest_shape)

    def _spread_of(self, shape: NDArray) -> NDArray:
        """Return the largest relative difference (n,) of an element from the mean at each node.

        Relative means divided by the von Mises stress of the mean over the elements of the node.
        ``shape`` (3 n_nodes,) is the displacement.
        """
        mean = (self._rows @ shape).reshape(-1, 6)
        # of each pair of node and element
        of_pair = (self._pairs @ shape).reshape(-1, 6)
        difference = von_mises_size(of_pair - mean[self._owner])
        largest = np.zeros(len(self.nodes))
        np.maximum.at(largest, self._owner, difference)
        return largest / von_mises_size(mean)

    def largest(self, nodal_diameter: int) -> int:
        """Return the node of the largest von Mises stress in the lowest mode of a nodal
        diameter."""
        lowest_mode = self._modes[nodal_diameter][..., 0]
        return int(self.nodes[von_mises_size(lowest_mode).argmax()])

    @staticmethod
    def _kept(rows: NDArray) -> NDArray:
        """Return rows (6 n, m) as (n, 6, m), rounded to single precision."""
        by_node = rows.reshape(len(rows) // 6, 6, rows.shape[1])
        single = np.complex64 if np.iscomplexobj(by_node) else np.float32
        return by_node.astype(single).astype(by_node.dtype)

    def set(self, body: str, source: str, numbers: NDArray | None = None) -> StressSet:
        """Return the stress set of the added nodal diameters for the named body.

        ``numbers`` are the numbers of all its nodes.
        """
        return StressSet(
            name=self.name,
            body=body,
            points=self.points,
            modes=self._modes,
            contact=self._contact,
            static=self._static,
            spread=self._spread,
            near_contact=self._near,
            source=source,
            nodes=None if numbers is None else numbers[self.nodes],
        )
