"""Local basis of a mistuned bladed disk from the matrices of one sector.

The blade is connected to the disk at the nodes of its root.  With f for the other nodes of the
blade, r for the root and g for the rest of the disk, the coordinates of
:mod:`bdamper.model.modal_basis` have these shapes:

* cantilever modes U: modes of :math:`K_{ff}, M_{ff}`;
* attachment modes X: static shapes :math:`K_{ff}^{-1} P^T q` of loads q on the contact points,
  without their part in U. The loads are the principal contact forces in the lowest modes with
  sticking dampers (:func:`stuck_loads`);
* if requested, static shapes of forces at the locations, without their part in U and X, counted as
  attachment modes;
* root shapes V with the static shapes of blade, :math:`-K_{ff}^{-1} K_{fr} V`, and disk, at each
  nodal diameter.  V are the principal shapes (singular vectors) of the motion of the root, divided
  by the frequency, in the lowest modes of the sector at nodal diameters 0, 1, 2, 4, 8 ... N/2.
  With all nodal diameters the largest error of family 1 for the 65 blades of :mod:`bdamper.fem`
  changes only from 0.00012 to 0.00016 %.

Only V moves the root.  All shapes are modes or static, so U, X and V do not couple in the stiffness
(Craig and Bampton, AIAA Journal 6, 1968, p. 1313).

The stiffness of the blade is assembled from its elements.  Matrices of a sector contain sums of
blade and disk at the root; the complete stiffness of the root shapes then counts as part of the
disk.  This has no effect on identical blades or on frequencies of different blades clamped at the
root.  It neglects that the strain energy of the blade also changes with the deformation of its
root: the change of family 1 of a coarse disk with a soft rim due to a deviation of 5 % is 0.05 %
too small.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.linalg import eigh

from bdamper.fem.cyclic_symmetry import (
    CyclicSector,
    Sectors,
    cyclic_transformation,
)
from bdamper.fem.factorisation import Factors, factorise
from bdamper.fem.lowest_modes import lowest_modes
from bdamper.fem.reduced_bodies import (
    Wanted,
    location_loads,
    location_rows,
    nodes_of,
    residual_shapes,
)
from bdamper.fem.sector_faces import SectorFaces
from bdamper.fem.sector_inside import SectorInside, face_ties, reported_blocks
from bdamper.fem.surface import Structure, hermitian, require
from bdamper.model.modal_basis import LocalBasis, fix_phase, rigid_motions
from bdamper.model.structure import Interface, Port
from bdamper.util import validation
from bdamper.util.progress import Steps

SPRINGS = (0.3, 3.0)
"""Stiffness of the contact springs for the loads of attachment modes, relative to the mean
stiffness of a contact point of the blade without its cantilever modes.  On the shipped disk (1, 10)
or (0.1, 1, 10) give errors larger by half.
"""


@dataclass(frozen=True)
class LocalSizes(validation.Checked):
    """Numbers of shapes in a local basis.

    Parameters
    ----------
    cantilever : int
        Modes of the blade clamped at its root, with frequencies well above the families of
        interest.  For coarse disks of 5, 6, 7 and 8 blades the error of the sixth stuck family is
        0.6, 6.3, 0.4 and 0.2 % with ten, and 0.2, 0.3, 0.35 and 0.2 % with twelve; more attachment
        modes do not reduce it.
    attachment : int
        Static shapes of contact forces.
    interface : int
        Root shapes.
    modes : int
        Modes at each nodal diameter that determine root shapes and loads of the attachment modes.
    """

    cantilever: validation.Count = 12
    attachment: validation.Natural = 12
    interface: validation.Count = 16
    modes: validation.Count = 10


@dataclass
class BladePart:
    """Nodes of the blade within a sector.

    Parameters
    ----------
    body : Structure
        Sector.
    nodes : (n,) int
        Nodes of the blade including its root.
    fixed : (n_nodes, 3) bool
        Fixed components.
    stiffness : (3 n_nodes, 3 n_nodes) sparse, optional
        Stiffness of the elements of the blade alone, N/m.
    steps : Steps
        Steps of the work, to show progress: the clamped blade, and the disk at each nodal diameter.
    """

    body: Structure
    nodes: NDArray
    fixed: NDArray
    stiffness: sp.csr_matrix | None = None
    steps: Steps = field(default_factory=Steps, repr=False)

    def __post_init__(self) -> None:
        inside = self.inside
        # whether each component is coupled to a node outside of the blade, (3 n_nodes,)
        couplings = abs(self.body.stiffness) + abs(self.body.mass)
        outside_components = np.repeat(~inside, 3)
        coupled_outside = outside_components @ couplings > 0.0
        # the root is shared with the disk
        root = inside & coupled_outside.reshape(-1, 3).any(axis=1)
        moving = ~self.fixed.ravel()
        self.root: NDArray = np.flatnonzero(root)
        self.root_dofs: NDArray = np.flatnonzero(np.repeat(root, 3) & moving)
        self.own_dofs: NDArray = np.flatnonzero(np.repeat(inside & ~root, 3) & moving)
        require(len(self.root_dofs), "a blade without a root node that connects it to the disk")
        require(
            len(self.own_dofs) >= 12,
            f"a blade with only {len(self.own_dofs)} degrees of freedom apart from its root",
        )

    @property
    def inside(self) -> NDArray:
        """Whether each node belongs to the blade, (n_nodes,) bool."""
        return np.isin(np.arange(len(self.body.nodes)), self.nodes)

    def check_wanted(self, wanted: Wanted, faces: SectorFaces) -> None:
        """Check that contact points and locations are on the blade, which has no node on the cut
        faces.

        Raises
        ------
        ValueError
            If a contact point or location is not on the blade, or a node of the blade is on a cut
            face.
        """
        on_blade = self.inside
        # columns of the contact rows are components, three of each node
        contact_nodes = wanted.contact.indices // 3
        require(on_blade[contact_nodes].all(), "contact points that are not on the blade")
        for name, place in wanted.locations.items():
            require(
                on_blade[nodes_of(place)].all(), f"location '{name}', which is not on the blade"
            )
        require(
            not on_blade[faces.nodes].any(),
            "a blade node that lies on a sector face",
        )

    @cached_property
    def solver(self) -> Factors:
        """Factorisation of the stiffness of the blade clamped at its root."""
        report = self.steps.report_pass
        report("factorisation", 0, 1)
        factors = factorise(self.body.stiffness[self.own_dofs][:, self.own_dofs])
        report("factorisation", 1, 1)
        return factors

    def _spread(self, values: NDArray) -> NDArray:
        """Expand columns from the blade without its root, (n_own_dofs, n), to all nodes of the
        sector, (3 n_nodes, n).
        """
        _, n_columns = values.shape
        on_sector = np.zeros((self.body.n_dof, n_columns))
        on_sector[self.own_dofs] = values
        return on_sector

    def cantilever(self, n_modes: int) -> tuple[NDArray, NDArray]:
        """Return squared frequencies (n_modes,) and modes (3 n_nodes, n_modes) of the blade clamped
        at its root."""
        stiffness = self.body.stiffness[self.own_dofs][:, self.own_dofs]
        mass = self.body.mass[self.own_dofs][:, self.own_dofs]
        report = self.steps.report_pass
        omega2, shapes = lowest_modes(stiffness, mass, self.solver.solve, n_modes, report=report)
        return omega2, fix_phase(self._spread(shapes), self.body.mass)

    def contact_columns(self, contact: sp.csr_matrix) -> NDArray:
        """Return displacements (3 n_nodes, n) of the clamped blade under unit forces on the rows of
        ``contact``."""
        force = contact[:, self.own_dofs].T.tocsc()
        solver = self.solver
        displacement = np.empty(force.shape)
        n_columns = force.shape[1]
        for columns in reported_blocks(n_columns, "static shapes", self.steps.report_pass):
            displacement[:, columns] = solver.solve(force[:, columns].toarray())
        return self._spread(displacement)

    def attachments(self, columns: NDArray, modes: NDArray) -> NDArray:
        """Orthogonalise static shapes ``columns`` (3 n_nodes, n) to the cantilever modes and to
        each other.

        The result is mass-normalised.
        """
        # the columns have been projected before, which rounding has disturbed
        part_in_modes = modes @ (modes.T @ (self.body.mass @ columns))
        shapes = columns - part_in_modes
        # eigenvectors are orthogonal in both matrices, and mass-normalised
        stiffness = shapes.T @ (self.body.stiffness @ shapes)
        mass = shapes.T @ (self.body.mass @ shapes)
        _, combination = eigh(stiffness, mass)
        return np.asarray(shapes @ combination)

    def carried(self, shapes: NDArray) -> NDArray:
        """Return the static shapes (3 n_nodes, n) of the blade for displacements (n_root_dofs, n)
        of its root."""
        # forces that hold the blade while its root moves; without them it follows the root
        holding_force = self.body.stiffness[self.own_dofs][:, self.root_dofs] @ shapes
        displacement = -self._spread(self.solver.solve(holding_force))
        displacement[self.root_dofs] = shapes
        return displacement


def disk_matrices(
    blade: BladePart, sector: CyclicSector, carried: NDArray
) -> tuple[NDArray, NDArray]:
    """Return stiffness and mass (N // 2 + 1, n, n), complex, of static shapes of blade
    (3 n_nodes, n) and disk.

    ``sector`` is the sector at any of the nodal diameters.  The disk between its cut faces and the
    roots is real and factorised once; only the motion of the faces depends on the nodal diameter.
    """
    body = blade.body
    # the clamped blade and its root do not take part in the solution for the disk
    held = blade.fixed.copy()
    held.ravel()[blade.own_dofs] = True
    held.ravel()[blade.root_dofs] = True
    disk = SectorInside(body, sector.faces, held, blade.steps.report_pass)

    # shapes with held faces, driven by the roots
    driven = np.array(carried)
    driven[disk.face] = 0.0
    driven[disk.inner] = 0.0
    driven[disk.inner] = -disk.factors.solve((body.stiffness @ driven)[disk.inner])
    force = body.stiffness @ driven
    momentum = body.mass @ driven
    stiffness_driven = hermitian(driven.T @ force)
    mass_driven = hermitian(driven.T @ momentum)
    # forces and momenta of the driven shapes on the static shapes of the faces
    force_of_faces = force[disk.face]
    momentum_of_faces = momentum[disk.face] + disk.force_on_faces(momentum[disk.inner])

    stiffness_of_wave, mass_of_wave = [], []
    for d in range(sector.faces.n_sectors // 2 + 1):
        blade.steps.begin(f"disk of the wheel, nodal diameter {d}")
        transformation = cyclic_transformation(len(body.nodes), sector.faces, held, d)
        # columns: independent motions of the faces in the wave
        ties, _ = face_ties(disk, transformation)
        adjoint = ties.conj().T
        # motion of the faces without force on them
        independent_stiffness = adjoint @ (disk.face_stiffness @ ties)
        faces = -ties @ np.linalg.solve(independent_stiffness, adjoint @ force_of_faces)
        # x = driven + faces: x^H K x has twice the mixed term; hermitian() halves the sum with the
        # adjoint, so that the factor 2 stays
        stiffness = faces.conj().T @ (disk.face_stiffness @ faces)
        mixed_stiffness = 2.0 * faces.conj().T @ force_of_faces
        stiffness_of_wave.append(stiffness_driven + hermitian(stiffness + mixed_stiffness))
        mass = faces.conj().T @ (disk.face_mass @ faces)
        mixed_mass = 2.0 * faces.conj().T @ momentum_of_faces
        mass_of_wave.append(mass_driven + hermitian(mass + mixed_mass))
    return np.array(stiffness_of_wave, complex), np.array(mass_of_wave, complex)


def sampled_waves(n_sectors: int) -> list[int]:
    """Return the nodal diameters 0, 1, 2, 4, 8 ... N/2 from which shapes are computed."""
    half = n_sectors // 2
    # up to N/4
    powers_of_two = [2**k for k in range(half.bit_length() - 1)]
    return sorted({0, half, *powers_of_two})


def root_shapes(blade: BladePart, sector: Sectors, n_sectors: int, sizes: LocalSizes) -> NDArray:
    """Return the principal shapes (n_root_dofs, n) of the root in the lowest modes."""
    motions = []
    for d in sampled_waves(n_sectors):
        omega2, shapes = sector(d).approximate_modes(sizes.modes)
        # low modes count more; a complex shape is two real ones
        root_motion = shapes[blade.root_dofs] / np.sqrt(omega2)
        motions += [root_motion.real, root_motion.imag]
    # principal shapes in the order of their size
    shapes, size, _ = np.linalg.svd(np.hstack(motions), full_matrices=False)
    independent = shapes[:, size > 1e-8 * size[0]]
    return np.asarray(independent[:, : sizes.interface])


def damper_motion(
    ports: Sequence[Port], interfaces: Mapping[str, Interface]
) -> tuple[NDArray, NDArray]:
    """Return rigid-body motions of the dampers (3 n_points, 6) at the ports of a blade, and their
    sectors (3 n_points,).

    Sectors are relative to the blade.  Points in contact with the ground or another blade have zero
    motion.
    """
    # a blisk has no ports: the arrays then have no rows
    motions, sectors = [np.zeros((0, 6))], [np.zeros(0, int)]
    for name, side in ports:
        face = interfaces[name]
        if side == "a":
            body, other = face.body_a, face.body_b
            sector = face.sector_b - face.sector_a
        else:
            body, other = face.body_b, face.body_a
            sector = face.sector_a - face.sector_b
        # displacements (n_points, 3, 6) of the points in six rigid-body motions about the origin,
        # along X, Y and Z and then along the axes t1, t2 and n of the face
        in_model_axes = rigid_motions(face.points, np.zeros(3), np.eye(3)).reshape(-1, 3, 6)
        motion = (face.frame @ in_model_axes).reshape(-1, 6)
        # ground and neighbouring blades are no dampers
        if other in (body, "ground"):
            motion = np.zeros_like(motion)
        motions.append(motion)
        sectors.append(np.full(3 * face.n_points, sector))
    return np.concatenate(motions), np.concatenate(sectors)


def stuck_loads(
    wheel: LocalBasis,
    loads: NDArray,
    dampers: tuple[NDArray, NDArray],
    n_sectors: int,
    sizes: LocalSizes,
) -> NDArray:
    """Return the principal loads (3 n_points, n) of the contact forces in the lowest modes with
    sticking dampers.

    Dampers are rigid, free and massless, on springs :data:`SPRINGS` at every point.  The principal
    loads have the largest energy of the contact forces in the flexibility without cantilever
    modes.  On the coarse disk of 65 blades (9 points a face, 12 attachments) the largest errors of
    the six lowest frequencies at nodal diameters 0 to 32 are as follows.  "Rigid" points have their
    residual stiffness.

    | springs at the points, N/m | 2e7 | 2e8 | 2e9 | rigid |
    |---|---|---|---|---|
    | these loads | 0.02 % | 0.09 % | 0.25 % | -0.4 -1.3 -0.6 -1.5 -0.7 -0.9 % |
    | loads of the largest flexibility | 0.09 % | 0.8 % | 7 % | 0.8 4.0 1.6 9.2 3.2 4.9 % |

    Parameters
    ----------
    wheel : LocalBasis
        Local basis with the static shapes of all loads as attachment modes.
    loads : (3 n_points, n_attachment) float
        Loads on the contact points, orthogonal in the flexibility without cantilever modes.
    dampers, sizes
        See :func:`local_basis`.
    n_sectors : int
    """
    # root (n_attachment, 3 n_points) of the flexibility F = root.T @ root of the points
    root = np.linalg.pinv(loads)
    # inverse of the mean of the diagonal of F
    mean_stiffness = len(loads) / float(np.square(root).sum())
    # motion (3 n_points, n) of the points in the coordinates of the wheel
    contact = wheel.contact_modes.reshape(-1, wheel.n)
    damper_modes, damper_sectors = dampers
    last_mode = min(sizes.modes, wheel.n) - 1
    forces = []
    for d in sampled_waves(n_sectors):
        # a damper in another sector moves with the phase of the wave there
        phase = np.exp(2j * np.pi * d * damper_sectors / n_sectors)
        # orthonormal basis of the rigid-body motions of the dampers at the points
        rigid, size, _ = np.linalg.svd(damper_modes * phase[:, None], full_matrices=False)
        rigid = rigid[:, size > 1e-9 * size[0]]
        # displacement relative to free dampers, which follow the points as far as possible
        relative = contact - rigid @ (rigid.conj().T @ contact)
        for factor in SPRINGS:
            spring_forces = factor * mean_stiffness * relative
            omega2, modes = eigh(
                wheel.stiffness(d) + contact.T @ spring_forces,
                wheel.mass(d),
                subset_by_index=(0, last_mode),
            )
            # low modes count more; complex forces are two real ones
            modal_forces = spring_forces @ modes / np.sqrt(omega2)
            forces += [modal_forces.real, modal_forces.imag]
    # the energy of forces f is f^T F f / 2 = |root f|^2 / 2; the svd sorts by it
    principal, _, _ = np.linalg.svd(root @ np.hstack(forces), full_matrices=False)
    return np.asarray(loads @ principal[:, : sizes.attachment])


def local_shapes(
    blade: BladePart,
    sector: Sectors,
    wanted: Wanted,
    dampers: tuple[NDArray, NDArray],
    sizes: LocalSizes,
) -> tuple[NDArray, NDArray, NDArray, NDArray]:
    """Compute the shapes of the local basis; for the parameters see :func:`local_basis`.

    Returns
    -------
    omega2 : (n_cantilever,) float, rad2/s2
    shapes : (3 n_nodes, n) float, kg^-1/2
        Shapes of the blade on all nodes of the sector: cantilever modes, attachment modes, root
        shapes.
    stiffness, mass : (N // 2 + 1, n_interface, n_interface) complex
        Matrices of the root shapes, blade and disk together, at each nodal diameter.
    """
    contact = wanted.contact
    blade.steps.begin("clamped blade of the wheel")
    omega2, modes = blade.cantilever(sizes.cantilever)
    first = sector(0)
    n_sectors = first.faces.n_sectors
    carried = blade.carried(root_shapes(blade, sector, n_sectors, sizes))
    disk_stiffness, disk_mass = disk_matrices(blade, first, carried)
    # normalise the shapes to unit mass averaged over all waves, so that all entries have
    # similar magnitudes
    mean_stiffness = mean_over_waves(disk_stiffness, n_sectors)
    _, scale = eigh(mean_stiffness, mean_over_waves(disk_mass, n_sectors))
    stiffness = hermitian(scale.T @ disk_stiffness @ scale)
    mass = hermitian(scale.T @ disk_mass @ scale)
    carried = carried @ scale

    # static shapes of the contact forces without their part in the cantilever modes
    columns = blade.contact_columns(contact)
    columns -= (modes / omega2) @ (contact @ modes).T
    # principal loads on the points, orthogonal in their flexibility
    flexibility, loads = np.linalg.eigh(hermitian(contact @ columns))
    flexible = flexibility > 1e-9 * flexibility.max(initial=0.0)
    attached = np.zeros((len(modes), 0))
    if sizes.attachment and flexible.any():
        # first all static shapes, to find the loads that matter with sticking dampers
        loads = loads[:, flexible] / np.sqrt(flexibility[flexible])
        every_shape = np.hstack([modes, columns @ loads, carried])
        wheel = _made_of(blade, wanted, omega2, every_shape, stiffness, mass)
        principal = stuck_loads(wheel, loads, dampers, n_sectors, sizes)
        attached = blade.attachments(columns @ principal, modes)
    if wanted.static_shapes and wanted.locations:
        forces = location_loads(blade.body, wanted.locations.values())
        static = blade.contact_columns(forces.T.tocsr())
        _, residual = residual_shapes(
            blade.body, np.hstack([modes, attached]), forces.toarray(), static
        )
        attached = np.hstack([attached, residual])
    return omega2, np.hstack([modes, attached, carried]), stiffness, mass


def local_basis(
    blade: BladePart,
    sector: Sectors,
    wanted: Wanted,
    dampers: tuple[NDArray, NDArray],
    sizes: LocalSizes,
    region: str,
) -> LocalBasis:
    """Reduce a sector to its local basis.

    Parameters
    ----------
    blade : BladePart
    sector : callable
        Returns the sector with cyclic symmetry at a nodal diameter.
    wanted : Wanted
        Contact points and locations on the blade; ``sizes`` determines the number of modes.
    dampers : (3 n_points, 6) float, (3 n_points,) int
        Rigid-body motion of the bodies in contact, and their sectors (:func:`damper_motion`).
    sizes : LocalSizes
    region : str
        Description of the part of the sector that is the blade.

    Returns
    -------
    LocalBasis

    Raises
    ------
    ValueError
        If contact points or locations are not on the blade, or its root is on a cut face.
    """
    blade.check_wanted(wanted, sector(0).faces)
    omega2, shapes, stiffness, mass = local_shapes(blade, sector, wanted, dampers, sizes)
    basis = _made_of(blade, wanted, omega2, shapes, stiffness, mass)
    flexibility = hermitian(wanted.contact @ blade.contact_columns(wanted.contact))
    return replace(basis, region=region, flexibility=flexibility)


def _made_of(
    blade: BladePart,
    wanted: Wanted,
    omega2: NDArray,
    shapes: NDArray,
    stiffness: NDArray,
    mass: NDArray,
) -> LocalBasis:
    """Return the local basis with the shapes and matrices of :func:`local_shapes`.

    ``stiffness`` and ``mass`` (N // 2 + 1, n_root, n_root) belong to the root shapes, the last
    columns of ``shapes``, for blade and disk together.
    """
    body = blade.body
    _, n = shapes.shape
    _, n_root, _ = stiffness.shape
    # cantilever and attachment modes, then root shapes
    clamped = slice(0, n - n_root)
    of_root = slice(n - n_root, n)
    clamped_shapes = shapes[:, clamped]
    carried = shapes[:, of_root]
    # the stiffness of the blade alone is known if its elements are
    root_stiffness = np.zeros((n_root, n_root))
    if blade.stiffness is not None:
        root_stiffness = hermitian(carried.T @ (blade.stiffness @ carried))
    # diagonal of the stiffness in the clamped shapes, which do not couple
    modal_stiffness = np.einsum("ij,ij->j", clamped_shapes, body.stiffness @ clamped_shapes)
    of_attachments = modal_stiffness[len(omega2) :]
    blade_stiffness = np.zeros((n, n))
    blade_stiffness[clamped, clamped] = np.diag(np.append(omega2, of_attachments))
    blade_stiffness[of_root, of_root] = root_stiffness
    blade_mass = shapes.T @ (body.mass @ shapes)
    # the mass of the root is part of the disk
    root_motion = carried[blade.root_dofs]
    root_mass = body.mass[blade.root_dofs][:, blade.root_dofs]
    blade_mass[of_root, of_root] -= root_motion.T @ (root_mass @ root_motion)
    blade_mass = hermitian(blade_mass)
    return LocalBasis(
        region="",
        omega2=omega2.copy(),
        damping_ratio=np.full(n, wanted.damping_ratio),
        blade_stiffness=blade_stiffness,
        blade_mass=blade_mass,
        disk_stiffness=stiffness - root_stiffness,
        disk_mass=mass - blade_mass[of_root, of_root],
        contact_modes=(wanted.contact @ shapes).reshape(-1, 3, n),
        locations=location_rows(wanted.locations, shapes),
    )


def mean_over_waves(matrices: NDArray, n_sectors: int) -> NDArray:
    """Return the real mean (n, n) of Hermitian matrices (N // 2 + 1, n, n) over all waves in both
    directions."""
    # a wave of 0 or N/2 nodal diameters is its own reverse
    is_standing = 2 * np.arange(len(matrices)) % n_sectors == 0
    n_directions = np.where(is_standing, 1.0, 2.0)
    return np.asarray(np.einsum("d,dij->ij", n_directions, matrices).real / n_sectors)
