r"""Bodies of a model from finite element structures: modes, receptances and loads at contact
points.

The displacement of a free body is the sum of a rigid-body motion and an elastic deformation
(paper, Eqs 5 to 7).  The rigid-body modes are three translations and three rotations about the
centre of mass, mass-orthonormal: :math:`\Psi^T M \Psi = I`.  A load accelerates the body.  Load and
inertia forces together are self-equilibrated,

.. math:: P^T f, \qquad P = I - \Psi\Psi^T M,

and deform the body (inertia relief).  Six statically determinate constraints have no reaction under
these forces.  With the stiffness matrix :math:`K_c` of the constrained body, the elastic
displacement orthogonal to the rigid-body modes is

.. math:: u_e = P K_c^{-1} P^T f

for any choice of the constraints.  Its expansion in elastic modes is
:math:`\sum \phi\phi^T/\omega^2`.

Rotation causes a body force per mass :math:`\Omega^2 (x, y, 0)`, here scaled to a resultant of 1 N
along the radial direction of the damper.

A ring is a free body of N sectors.  With the matrix T of the phase condition
(:mod:`bdamper.fem.cyclic_symmetry`), :math:`u = T q`, the same formulas apply to the coordinates q
of one sector with the matrices :math:`T^H K T` and :math:`T^H M T`.  A rigid-body motion with the
translation :math:`c` satisfies the phase condition if :math:`R c = e^{-i\varphi} c`, and so does a
rotation about the direction c:

* :math:`d = 0`: c along Z, two motions,
* :math:`d = 1`: :math:`c = (1, -i, 0)/\sqrt 2`, two motions,
* other nodal diameters: none.

At d = 0 the load of rotation deforms a closed ring against its hoop stiffness.  A split ring has
one gap.  Its hoop force vanishes at the ends and, without friction along the circumference, in the
whole ring.  The model distributes the opening of the gap evenly over the sector faces: at d = 0 the
radial translation of the sector is a third rigid-body motion, and the contacts carry the whole
load.  The bending stiffness against a uniform change of radius, which is small in a slender ring,
and the missing connection at the gap in the waves of other nodal diameters are neglected.

References
----------
D. Laxalde, F. Thouverez, J.-J. Sinou, J.-P. Lombard, "Qualitative analysis of forced response of
blisks with friction ring dampers", *European Journal of Mechanics A/Solids* 26 (2007).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Generic, Literal, TypeVar

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.linalg import qr

from bdamper.fem.cyclic_symmetry import CyclicSector, Sectors, cyclic_transformation
from bdamper.fem.factorisation import Factors, factorise
from bdamper.fem.lowest_modes import lowest_modes
from bdamper.fem.rotation import Rotation, spin_displacement
from bdamper.fem.sector_faces import SectorFaces
from bdamper.fem.sector_inside import reported_blocks
from bdamper.fem.surface import Facets, Structure, corner_count, hermitian, require
from bdamper.model.modal_basis import SpinStatic, fix_phase, rigid_motions
from bdamper.model.structure import Body, BodyLoad, ModalBasis, Port, SurfaceMesh
from bdamper.util.progress import Report, no_report

# ---- Free body ----


def isostatic_dofs(nodes: NDArray, corner: int = 0) -> NDArray:
    """Return the indices (6,) of six degrees of freedom that constrain rigid-body motion.

    They are components of three distant nodes: three of one, two of another and one of the third.

    Parameters
    ----------
    nodes : (n, 3) float, m
    corner : int
        Index of the first of the three nodes; any node may be chosen.
    """
    from_corner = nodes - nodes[corner]
    second = int(np.argmax(np.linalg.norm(from_corner, axis=1)))
    length = np.linalg.norm(nodes[second] - nodes[corner])
    direction = (nodes[second] - nodes[corner]) / length
    from_line = from_corner - np.outer(from_corner @ direction, direction)
    third = int(np.argmax(np.linalg.norm(from_line, axis=1)))
    candidates = np.concatenate([3 * node + np.arange(3) for node in (corner, second, third)])
    # three translations and three rotations at the nine candidates, all of similar size: (9, 6)
    motion = rigid_motions(nodes, nodes[corner], np.eye(3))[candidates]
    motion[:, 3:] /= length
    # choose six rows by pivoting: the largest component orthogonal to the previous rows
    chosen = qr(motion.T, mode="r", pivoting=True)[1][:6]
    return np.sort(candidates[chosen])


S = TypeVar("S", bound=Structure)


def orthonormal(motion: NDArray, mass: sp.spmatrix) -> NDArray:
    """Return mass-orthonormal combinations of motions (n, n_motions)."""
    # twice, to remove the rounding error of the first projection
    for _ in range(2):
        lower = np.linalg.cholesky(motion.conj().T @ (mass @ motion))
        motion = np.linalg.solve(lower, motion.conj().T).conj().T
    return motion


class Floating:
    """Elastic structure with rigid-body motions.

    Parameters
    ----------
    stiffness, mass : (n, n) sparse
    rigid : (n, n_rigid)
        Mass-orthonormal rigid-body modes.
    constrained : (n_rigid,) int
        Constrained degrees of freedom of the auxiliary problem.
    report : Report
        Receives the progress of long passes.
    """

    def __init__(
        self,
        stiffness: sp.spmatrix,
        mass: sp.spmatrix,
        rigid: NDArray,
        constrained: NDArray,
        report: Report = no_report,
    ) -> None:
        self.report = report
        self.stiffness = stiffness
        self.mass = mass
        self.rigid = rigid
        self._rigid_momentum: NDArray = mass @ rigid
        self._kept = np.setdiff1d(np.arange(len(rigid)), constrained)

    @cached_property
    def solver(self) -> Factors:
        """Factorisation of the stiffness matrix of the constrained structure."""
        self.report("factorisation", 0, 1)
        factors = factorise(self.stiffness[self._kept][:, self._kept])
        self.report("factorisation", 1, 1)
        return factors

    def remove_rigid(self, displacement: NDArray) -> NDArray:
        """Return ``P u``, the part (n, ...) orthogonal to the rigid-body modes in the mass
        matrix."""
        return displacement - self.rigid @ (self._rigid_momentum.conj().T @ displacement)

    def elastic_response(self, load: NDArray) -> NDArray:
        """Return the elastic displacement (n, ...) under ``load`` (n, ...) with inertia relief."""
        load = load - self._rigid_momentum @ (self.rigid.conj().T @ load)
        out = np.zeros_like(load)
        out[self._kept] = self.solver.solve(np.ascontiguousarray(load[self._kept]))
        return self.remove_rigid(out)

    def static_response(self, load: NDArray) -> NDArray:
        """Return the elastic displacements (n, n_loads) under ``load`` (n, n_loads) with inertia
        relief, a pass that is reported."""
        # before the static shapes, whose progress follows
        _ = self.solver
        displacement = np.empty(load.shape, np.result_type(load, self.rigid))
        for columns in reported_blocks(load.shape[1], "static shapes", self.report):
            displacement[:, columns] = self.elastic_response(load[:, columns])
        return displacement

    def elastic_modes(self, n_modes: int) -> tuple[NDArray, NDArray]:
        """Compute the lowest elastic modes.

        Returns
        -------
        omega2 : (n_modes,) float, rad2/s2
        shapes : (n, n_modes), kg^-1/2
        """
        n_rigid = self.rigid.shape[1]
        # before the modes, whose progress follows
        _ = self.solver
        omega2, shapes = lowest_modes(
            self.stiffness, self.mass, self.elastic_response, n_modes, n_rigid, self.report
        )
        return omega2, self.remove_rigid(shapes)


@dataclass
class FreeBody(Generic[S]):
    """Free body at its position in the model.

    Parameters
    ----------
    body : Structure
    axes : (3, 3) float
        Directions of the rigid-body translations and rotations as rows.
    constrained : (6,) int, optional
        Constrained degrees of freedom of the auxiliary problem.
    report : Report
        Receives the progress of long passes.
    """

    body: S
    axes: NDArray
    constrained: NDArray | None = None
    report: Report = field(default=no_report, repr=False)
    _modes: tuple[NDArray, NDArray] | None = field(default=None, init=False, repr=False)

    def __post_init__(self) -> None:
        body, mass = self.body, self.body.mass
        if self.constrained is None:
            self.constrained = isostatic_dofs(body.nodes)
        # only products of rigid motions give the inertia of the body: the positions are no rigid
        # motion, and condensed internal degrees of freedom follow any other field
        about_origin = rigid_motions(body.nodes, np.zeros(3), np.eye(3))
        rigid_mass = about_origin.T @ (mass @ about_origin)  # (6, 6)
        self.total_mass = float(rigid_mass[0, 0])
        # the momentum of a unit rotation is the cross product of its axis and the first moment
        about_x, about_y, about_z = rigid_mass[:3, 3:].T
        first_moment = np.array([about_z[1], about_x[2], about_y[0]])
        self.centre: NDArray = first_moment / self.total_mass
        rotation = rigid_motions(body.nodes, self.centre, np.eye(3))[:, 3:]
        self.inertia: NDArray = rotation.T @ (mass @ rotation)
        motion = rigid_motions(body.nodes, self.centre, self.axes)
        self.rigid: NDArray = orthonormal(motion, mass)
        self._floating = Floating(body.stiffness, mass, self.rigid, self.constrained, self.report)

    def remove_rigid(self, displacement: NDArray) -> NDArray:
        """Return ``P u``, the part (3 n_nodes, ...) orthogonal to the rigid-body modes in the mass
        matrix."""
        return self._floating.remove_rigid(displacement)

    def elastic_response(self, load: NDArray) -> NDArray:
        """Return the elastic displacement (3 n_nodes, ...) under ``load`` (3 n_nodes, ...) with
        inertia relief."""
        return self._floating.elastic_response(load)

    def modes(self, n_modes: int) -> tuple[NDArray, NDArray]:
        """Compute six rigid-body modes and the lowest elastic modes.

        Returns
        -------
        omega2 : (n_modes,) float, rad2/s2
        shapes : (3 n_nodes, n_modes) float, kg^-1/2
        """
        require(
            n_modes >= 6,
            f"n_modes: expected at least six, the rigid modes of a free body, found {n_modes}",
        )
        n_elastic = n_modes - 6
        missing = self._modes is None or len(self._modes[0]) < n_elastic
        if n_elastic and missing:
            omega2, shapes = self._floating.elastic_modes(n_elastic)
            self._modes = omega2, fix_phase(shapes, self.body.mass)
        if self._modes is None:
            return np.zeros(6), self.rigid
        omega2, shapes = self._modes
        every_omega2 = np.append(np.zeros(6), omega2[:n_elastic])
        return every_omega2, np.hstack([self.rigid, shapes[:, :n_elastic]])

    def receptance(self, contact: sp.spmatrix) -> NDArray:
        """Return the elastic receptance (n, n) between the rows of ``contact``
        (n, 3 n_nodes), m/N."""
        return hermitian(contact @ self._floating.static_response(contact.T.toarray()))

    def centrifugal_load(self, radial: NDArray) -> NDArray:
        """Return nodal forces (3 n_nodes,) of rotation about Z with a resultant of 1 N along
        ``radial`` (3,).

        Mass, centre and inertia determine its force and moment.  The nodal forces alone miss them by
        1e-4 if internal degrees of freedom have been condensed.
        """
        distance = self.centre * [1.0, 1.0, 0.0]
        resultant = self.total_mass * distance
        # r x (r_x, r_y, 0) over the mass, about the centre: products of inertia
        moment = np.array([self.inertia[1, 2], -self.inertia[0, 2], 0.0])
        exact = np.concatenate([resultant, moment])

        body = self.body
        force = body.body_force(body.nodes * [1.0, 1.0, 0.0]).ravel()
        # forces and moments belong to unit motions along and about X, Y and Z
        unit_motion = rigid_motions(body.nodes, self.centre, np.eye(3))
        momentum = body.mass @ unit_motion
        missing = exact - unit_motion.T @ force
        force = force + momentum @ np.linalg.solve(unit_motion.T @ momentum, missing)
        return force / (resultant @ radial)


# ---- Ring ----


def ring_motions(nodes: NDArray, nodal_diameter: int) -> NDArray:
    """Return the rigid-body motions (3 n_nodes, n_rigid) of a ring at a nodal diameter.

    The ring has at least three sectors.
    """
    if nodal_diameter == 0:
        direction = np.array([0.0, 0.0, 1.0])
    elif nodal_diameter == 1:
        direction = np.array([1.0, -1.0j, 0.0]) / np.sqrt(2.0)
    else:
        return np.zeros((3 * len(nodes), 0))
    # rotations about the middle of the ring
    middle = nodes.mean(axis=0) * [0.0, 0.0, 1.0]
    along_and_about = rigid_motions(nodes, middle, np.eye(3))
    translation = along_and_about[:, :3] @ direction
    rotation = along_and_about[:, 3:] @ direction
    return np.stack([translation, rotation], axis=1)


class RingSector:
    """One sector of a ring, free in space, at one nodal diameter.

    Parameters
    ----------
    body : Structure
    faces : SectorFaces
        Sector faces of the ring, without nodes on the axis; at least three sectors.
    nodal_diameter : int
    radial : (3,) float, optional
        Radial direction of the sector of a split ring; None for a closed ring.
    report : Report
        Receives the progress of long passes.
    """

    def __init__(
        self,
        body: Structure,
        faces: SectorFaces,
        nodal_diameter: int,
        radial: NDArray | None = None,
        report: Report = no_report,
    ) -> None:
        require(faces.n_sectors >= 3, f"a ring has at least 3 sectors, not {faces.n_sectors}")
        require(not len(faces.axis), "a ring has no nodes on the axis of rotation")
        n_nodes = len(body.nodes)
        self.body = body
        self.nodal_diameter = nodal_diameter
        nothing_held = np.zeros((n_nodes, 3), bool)
        to_nodes = cyclic_transformation(n_nodes, faces, nothing_held, nodal_diameter)
        # coordinates of the sector are the displacements of its independent nodes
        is_independent = np.ones(n_nodes, bool)
        is_independent[faces.dependent] = False
        own = np.repeat(is_independent, 3)
        rigid = ring_motions(body.nodes, nodal_diameter)[own]
        n_rigid = rigid.shape[1]
        constrained = np.zeros(0, int)
        if n_rigid:
            # choose rows by pivoting: the largest component orthogonal to the previous rows
            constrained = qr(rigid.conj().T, mode="r", pivoting=True)[1][:n_rigid]
        if radial is not None and nodal_diameter == 0:
            # the radial translation of the sector is one more coordinate, the last one
            translation = np.tile(radial, n_nodes)[:, None]
            n = to_nodes.shape[1]
            to_nodes = sp.hstack([to_nodes, translation]).tocsr()
            constrained = np.append(constrained, n)
            radial_motion = np.zeros((n + 1, 1))
            radial_motion[n] = 1.0
            other_motions = np.vstack([rigid, np.zeros((1, n_rigid))])
            rigid = np.hstack([radial_motion, other_motions])
        self.transformation = to_nodes
        adjoint = to_nodes.conj().T
        stiffness = (adjoint @ body.stiffness @ to_nodes).tocsr()
        mass = (adjoint @ body.mass @ to_nodes).tocsr()
        if n_rigid:
            rigid = orthonormal(rigid, mass)
        self._floating = Floating(stiffness, mass, rigid, constrained, report)

    @property
    def n_rigid(self) -> int:
        """Number of rigid-body modes."""
        return self._floating.rigid.shape[1]

    def modes(self, n_modes: int) -> tuple[NDArray, NDArray]:
        """Compute the rigid-body modes and the lowest elastic modes.

        Returns
        -------
        omega2 : (n_modes,) float, rad2/s2
        shapes : (3 n_nodes, n_modes) float or complex, kg^-1/2
        """
        rigid = self.transformation @ self._floating.rigid
        omega2, elastic = self._floating.elastic_modes(n_modes - self.n_rigid)
        shapes = fix_phase(self.transformation @ elastic, self.body.mass)
        return np.append(np.zeros(self.n_rigid), omega2), np.hstack([rigid, shapes])

    def static_response(self, load: sp.spmatrix | NDArray) -> NDArray:
        """Return the elastic displacements (3 n_nodes, n) under ``load`` (3 n_nodes, n) on the
        sector, with inertia relief."""
        force = self.transformation.conj().T @ load
        force = force.toarray() if sp.issparse(force) else np.asarray(force)
        force = force.astype(self._floating.stiffness.dtype)
        return np.asarray(self.transformation @ self._floating.static_response(force))

    def receptance(self, contact: sp.spmatrix) -> NDArray:
        """Return the elastic receptance (n, n) between the rows of ``contact``
        (n, 3 n_nodes), m/N."""
        return hermitian(contact @ self.static_response(contact.T))


# ---- Bodies of a model ----


LEAST = 1e-8
"""Energy that counts as zero: of a residual shape relative to the static shape of its force, and of
a combination of residual shapes relative to the others.
"""

PICTURED_MODES = 10
"""Number of mode shapes at each nodal diameter that a model stores for plots."""


def needed_nodal_diameters(n_blades: int, engine_order: int, harmonics: int) -> tuple[int, ...]:
    """Return the nodal diameters of harmonics 0 to ``harmonics`` of an engine order.

    A wave of more than N/2 nodal diameters is a wave of fewer in the other direction.
    """
    diameters = set()
    for harmonic in range(harmonics + 1):
        d = engine_order * harmonic % n_blades
        diameters.add(min(d, n_blades - d))
    return tuple(sorted(diameters))


Place = int | NDArray
"""Index of a node, field (n_nodes, 3) complex of forces (N), or three fields (n_nodes, 3, 3) of forces."""


def nodes_of(place: Place) -> NDArray:
    """Return the indices of the nodes with forces."""
    if isinstance(place, np.ndarray):
        return np.flatnonzero(place.reshape(len(place), -1).any(axis=1))
    return np.array([place])


def place_loads(place: Place, n_dof: int) -> sp.csc_matrix:
    """Return three loads (n_dof, 3) at a location.

    They are unit forces along X, Y and Z at a node; real part, imaginary part and zeros of a field;
    or three fields.
    """
    if isinstance(place, np.ndarray) and place.ndim == 3:
        return sp.csc_matrix(place.reshape(n_dof, 3))
    if isinstance(place, np.ndarray):
        columns = [place.real.ravel(), place.imag.ravel(), np.zeros(place.size)]
        return sp.csc_matrix(np.stack(columns, axis=1))
    components = np.arange(3)
    entries = (np.ones(3), (3 * place + components, components))
    return sp.csc_matrix(entries, shape=(n_dof, 3))


def location_rows(places: Mapping[str, Place], shapes: NDArray) -> dict[str, NDArray]:
    """Return rows (3, n_modes) of ``shapes`` (3 n_nodes, n_modes) for a location.

    These are the motion of a node, or the work of the real and of the imaginary part of a field of
    forces, and zeros.
    """
    return {name: place_loads(place, len(shapes)).T @ shapes for name, place in places.items()}


def location_loads(body: Structure, places: Iterable[Place]) -> sp.csc_matrix:
    """Return the nonzero loads (3 n_nodes, n) of several locations."""
    loads = sp.hstack([place_loads(place, body.n_dof) for place in places], format="csc")
    return loads[:, np.diff(loads.indptr) > 0]


def picture_mesh(surface: Facets, nodes: NDArray, shapes: Mapping[int, NDArray]) -> SurfaceMesh:
    """Return the corners of a surface as quadrilaterals for plots.

    Triangles repeat their last corner.  ``shapes`` are mode shapes (n_nodes, 3, n_modes) by nodal
    diameter.
    """
    groups = []
    for facets in surface.groups:
        is_quadrilateral = corner_count(facets.shape[1]) == 4
        corners = [0, 1, 2, 3] if is_quadrilateral else [0, 1, 2, 2]
        groups.append(facets[:, corners])
    quads = np.concatenate(groups)
    # renumber the nodes of the surface from 0
    used, new_number = np.unique(quads, return_inverse=True)
    renumbered = new_number.reshape(quads.shape).astype(np.int32)
    modes = {d: values[used] for d, values in shapes.items()}
    return SurfaceMesh(nodes[used].copy(), renumbered, modes)


@dataclass(frozen=True)
class Wanted:
    """Locations, contact points and number of modes for the reduction of a body.

    Parameters
    ----------
    ports : tuple of Port
    contact : (3 n_points, 3 n_nodes) sparse
        Matrix from nodal displacements to the contact points of all ports.
    locations : mapping of name to node index, or to a field (n_nodes, 3) complex of forces (N)
    n_modes : int
    damping_ratio : float
        Damping ratio of all elastic modes.
    static_shapes : bool
        Add static shapes to the modes of a sector: those of forces at the locations, and the modes
        of a second rotor speed.  The stored reference models have none.
    """

    ports: tuple[Port, ...]
    contact: sp.csr_matrix
    locations: Mapping[str, Place]
    n_modes: int
    damping_ratio: float
    static_shapes: bool = False

    def shapes(
        self, sector: CyclicSector, others: Iterable[CyclicSector] = ()
    ) -> tuple[NDArray, NDArray, int | None]:
        """Return squared frequencies (n,) and shapes (3 n_nodes, n) of a sector, and the number of
        static shapes.

        Static shapes are mass-normalised and orthogonal to the modes in the stiffness, so each is
        one more mode whose squared frequency is its stiffness.  They include the part of the modes
        of ``others``, the same sector at other rotor speeds, that the modes of ``sector`` cannot
        represent.  Without them frequencies at this speed would be too high, by 0.09 % on an imported
        sector, and further modes of ``sector`` hardly improve them.
        """
        omega2, modes = sector.modes(self.n_modes)
        if not self.static_shapes:
            return omega2, modes, None
        # forces with their static shapes; a shape u is the response to the force K u
        loads: list[NDArray] = []
        responses: list[NDArray] = []
        if self.locations:
            at_locations = location_loads(sector.body, self.locations.values())
            loads.append(at_locations.toarray())
            responses.append(sector.transformation @ sector.static_response(at_locations))
        for other in others:
            _, modes_of_other = other.modes(self.n_modes)
            loads.append(sector.body.stiffness @ modes_of_other)
            responses.append(modes_of_other)
        if not loads:
            return omega2, modes, None
        # mass-normalised shapes: their stiffness is a squared frequency
        omega2_of_static, static = residual_shapes(
            sector.body, modes, np.hstack(loads), np.hstack(responses)
        )
        all_omega2 = np.append(omega2, omega2_of_static)
        all_shapes = np.hstack([modes, static])
        return all_omega2, all_shapes, len(omega2_of_static)

    def basis(
        self,
        omega2: NDArray,
        shapes: NDArray,
        flexibility: NDArray | None = None,
        static: int | None = None,
    ) -> ModalBasis:
        """Return the modal basis for mass-normalised modes (3 n_nodes, n) with squared frequencies
        (n,)."""
        return ModalBasis(
            omega2=omega2.copy(),
            damping_ratio=np.where(omega2 > 0.0, self.damping_ratio, 0.0),
            contact_modes=(self.contact @ shapes).reshape(-1, 3, len(omega2)),
            locations=location_rows(self.locations, shapes),
            flexibility=flexibility,
            static_shapes=static,
        )


def residual_shapes(
    body: Structure, kept: NDArray, loads: NDArray, static: NDArray
) -> tuple[NDArray, NDArray]:
    r"""Return residual static shapes :math:`(K^{-1} - \Phi \Omega^{-2} \Phi^H) f`, orthogonalised.

    Parameters
    ----------
    body : Structure
    kept : (3 n_nodes, n_kept)
        Shapes that are retained, orthogonal in the stiffness.
    loads, static : (3 n_nodes, n)
        Forces and their static shapes.

    Returns
    -------
    omega2 : (m,) float, ascending
    shapes : (3 n_nodes, m)
        Mass-normalised; orthogonal to the retained shapes in the stiffness and to each other in
        mass and stiffness.  There are fewer shapes than loads if residual shapes are zero or
        dependent.
    """
    kept_stiffness = np.einsum("ij,ij->j", kept.conj(), body.stiffness @ kept).real
    residual = static
    for _ in range(2):  # twice, to reduce rounding errors
        parts = kept.conj().T @ (body.stiffness @ residual)
        residual = residual - (kept / kept_stiffness) @ parts

    # shapes of unit energy, without those that the retained shapes already contain
    energy = np.einsum("ij,ij->j", residual.conj(), body.stiffness @ residual).real
    static_energy = np.einsum("ij,ij->j", static.conj(), loads).real
    is_new = energy > LEAST * static_energy
    residual = residual[:, is_new] / np.sqrt(energy[is_new])

    # orthogonal in the stiffness, without dependent shapes
    stiffness = hermitian(residual.conj().T @ (body.stiffness @ residual))
    energy, combination = np.linalg.eigh(stiffness)
    independent = energy > LEAST * energy.max(initial=0.0)
    residual = residual @ (combination[:, independent] / np.sqrt(energy[independent]))

    # orthogonal in the mass too; a shape of unit energy has the inverse of omega2 as its mass
    mass, combination = np.linalg.eigh(hermitian(residual.conj().T @ (body.mass @ residual)))
    shapes = (residual @ combination / np.sqrt(mass))[:, ::-1]
    return 1.0 / mass[::-1], fix_phase(shapes, body.mass)


def constrained_body(
    name: str,
    wanted: Wanted,
    sector: Sectors,
    nodal_diameters: Iterable[int],
    rotation: Rotation | None = None,
    seen: Callable[[CyclicSector, NDArray, NDArray], None] | None = None,
) -> Body:
    """Return the body for a supported sector at several nodal diameters.

    Parameters
    ----------
    name : str
    wanted : Wanted
    sector : callable
        Returns the `CyclicSector` at a nodal diameter.
    nodal_diameters : iterable of int
    rotation : Rotation, optional
        Change of the stiffness with rotor speed.
    seen : callable, optional
        Called at each nodal diameter with the sector, the squared frequencies (n,) and the shapes
        (3 n_nodes, n).
    """
    bases = {}
    for d in nodal_diameters:
        reduced = sector(d)
        others = [] if rotation is None else rotation.at_other_speeds(reduced)
        omega2, shapes, n_static = wanted.shapes(reduced, others)
        if seen is not None:
            seen(reduced, omega2, shapes)
        flexibility = reduced.receptance(wanted.contact)
        bases[d] = wanted.basis(omega2, shapes, flexibility, n_static)
        if rotation is not None:
            bases[d] = rotation.basis(bases[d], reduced, shapes, wanted.contact, others)
    spin = None
    if rotation is not None:
        displacement = spin_displacement(sector(0))
        theory: Literal["linear", "stiffened"] = "stiffened"
        if rotation.omega_ref == 0.0:
            theory = "linear"
        spin = SpinStatic(
            contact=(wanted.contact @ displacement).reshape(-1, 3),
            locations=location_rows(wanted.locations, displacement),
            theory=theory,
            omega=rotation.omega_ref,
        )
    return Body(name, "constrained", wanted.ports, bases, spin=spin)


def free_body(name: str, wanted: Wanted, free: FreeBody, radial: NDArray) -> Body:
    """Return a free body with rigid-body and elastic modes.

    Its centrifugal load is along ``radial`` (3,).  The number of modes in ``wanted`` includes the
    six rigid-body modes.
    """
    omega2, shapes = free.modes(wanted.n_modes)
    force = free.centrifugal_load(radial)
    basis = wanted.basis(omega2, shapes, free.receptance(wanted.contact))
    displacement = (wanted.contact @ free.elastic_response(force)).reshape(-1, 3)
    return Body(
        name,
        "free",
        wanted.ports,
        {0: basis},
        mass=free.total_mass,
        centre=free.centre,
        inertia=free.inertia,
        load=BodyLoad(direction=radial, generalised=shapes.T @ force, displacement=displacement),
    )


def ring_body(
    name: str,
    wanted: Wanted,
    sector: Callable[[int], RingSector],
    nodal_diameters: Iterable[int],
    whole: FreeBody,
    seen: Callable[[RingSector, NDArray, NDArray], None] | None = None,
) -> Body:
    """Return a ring with rigid-body and elastic modes at several nodal diameters, including 0.

    Parameters
    ----------
    name : str
    wanted : Wanted
        The number of modes includes the rigid-body modes.
    sector : callable
        Returns the `RingSector` at a nodal diameter.
    nodal_diameters : iterable of int
    whole : FreeBody
        The sector on its own.  Its second axis is the radial direction, along which the centrifugal
        load of the sector acts.
    seen : callable, optional
        Called at each nodal diameter with the sector, the squared frequencies (n,) and the shapes
        (3 n_nodes, n).
    """
    radial = whole.axes[1]
    force = whole.centrifugal_load(radial)
    bases = {}
    for d in nodal_diameters:
        at_diameter = sector(d)
        omega2, shapes = at_diameter.modes(wanted.n_modes)
        if seen is not None:
            seen(at_diameter, omega2, shapes)
        bases[d] = wanted.basis(omega2, shapes, at_diameter.receptance(wanted.contact))
        if d == 0:
            displacement = wanted.contact @ at_diameter.static_response(force[:, None])
            load = BodyLoad(radial, shapes.T @ force, displacement.reshape(-1, 3))
    return Body(
        name,
        "ring",
        wanted.ports,
        bases,
        mass=whole.total_mass,
        centre=whole.centre,
        inertia=whole.inertia,
        load=load,
    )
