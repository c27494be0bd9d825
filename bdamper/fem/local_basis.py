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
  With all nodal diameters the largest error of family 1 of the 65 blades of :mod:`bdamper.fem`
  changes from 0.00012 to 0.00016 % only.

Only V moves the root.  All shapes are modes or static, so U, X and V do not couple in the stiffness
(Craig and Bampton, AIAA Journal 6, 1968, p. 1313).

The stiffness of the blade is assembled from its elements.  Matrices of a sector contain sums of
blade and disk at the root; the complete stiffness of the root shapes then counts as part of the
disk.  This has no effect on identical blades or on frequencies of different blades clamped at the
root.  It neglects the change of the strain energy of the blade by deformation of its root: a
deviation of 5 % changes family 1 of a coarse disk with a soft rim by 0.05 % too little.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.linalg import eigh
from scipy.sparse.linalg import SuperLU

from bdamper.fem.cyclic_symmetry import (
    CyclicSector,
    Sectors,
    cyclic_transformation,
    factorise,
    lowest_modes,
)
from bdamper.fem.reduced_bodies import (
    Wanted,
    location_loads,
    location_rows,
    nodes_of,
    residual_shapes,
)
from bdamper.fem.sector_faces import SectorFaces
from bdamper.fem.surface import Structure, check, hermitian
from bdamper.model.modal_basis import LocalBasis, fix_phase, rigid_motions
from bdamper.model.structure import Interface, Port
from bdamper.util import validation

SPRINGS = (0.3, 3.0)
"""Stiffness of the contact springs for the loads of attachment modes, relative to the mean
stiffness of a contact point of the blade without its cantilever modes.  On the shipped disk (1, 10)
or (0.1, 1, 10) give errors larger by half.
"""


@dataclass(frozen=True)
class LocalSizes(validation.Checked):
    """Number of shapes of a local basis.

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
    step : callable
        Called with a text before each nodal diameter is computed, to show progress.
    """

    body: Structure
    nodes: NDArray
    fixed: NDArray
    stiffness: sp.csr_matrix | None = None
    step: Callable[[str], None] = lambda text: None

    def __post_init__(self) -> None:
        inside = self.inside
        coupled = abs(self.body.stiffness) + abs(self.body.mass)
        outside = np.repeat(~inside, 3) @ coupled > 0.0
        root = inside & outside.reshape(-1, 3).any(axis=1)
        moving = ~self.fixed.ravel()
        self.root: NDArray = np.flatnonzero(root)
        self.root_dofs: NDArray = np.flatnonzero(np.repeat(root, 3) & moving)
        self.own_dofs: NDArray = np.flatnonzero(np.repeat(inside & ~root, 3) & moving)
        check(len(self.root_dofs), "a blade that no node of its root joins to the disk")
        check(
            len(self.own_dofs) >= 12,
            f"a blade of {len(self.own_dofs)} moving components besides its root",
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
        check(
            self.inside[wanted.contact.indices // 3].all(),
            "contact points that are not on the blade",
        )
        for name, place in wanted.locations.items():
            check(
                self.inside[nodes_of(place)].all(), f"location '{name}', which is not on the blade"
            )
        check(
            not self.inside[faces.nodes].any(),
            "a node of the blade that lies on a face at which the sector repeats",
        )

    @cached_property
    def solver(self) -> SuperLU:
        """Factorisation of the stiffness of the blade clamped at its root."""
        return factorise(self.body.stiffness[self.own_dofs][:, self.own_dofs])

    def _spread(self, values: NDArray) -> NDArray:
        """Expand columns from the blade without its root to all nodes of the sector."""
        out = np.zeros((self.body.n_dof, values.shape[1]))
        out[self.own_dofs] = values
        return out

    def cantilever(self, n_modes: int) -> tuple[NDArray, NDArray]:
        """Return squared frequencies (n_modes,) and modes (3 n_nodes, n_modes) of the blade clamped
        at its root."""
        stiffness, mass = (
            m[self.own_dofs][:, self.own_dofs] for m in (self.body.stiffness, self.body.mass)
        )
        omega2, shapes = lowest_modes(stiffness, mass, self.solver.solve, n_modes)
        return omega2, fix_phase(self._spread(shapes), self.body.mass)

    def contact_columns(self, contact: sp.csr_matrix) -> NDArray:
        """Return displacements (3 n_nodes, n) of the clamped blade under unit forces on the rows of
        ``contact``."""
        return self._spread(self.solver.solve(contact[:, self.own_dofs].T.toarray()))

    def attachments(self, columns: NDArray, modes: NDArray) -> NDArray:
        """Orthogonalise static shapes ``columns`` (3 n_nodes, n) to the cantilever modes and to
        each other.

        The result is mass-normalised.
        """
        shapes = columns - modes @ (modes.T @ (self.body.mass @ columns))  # rounding
        k, m = (shapes.T @ (matrix @ shapes) for matrix in (self.body.stiffness, self.body.mass))
        return np.asarray(shapes @ eigh(k, m)[1])

    def carried(self, shapes: NDArray) -> NDArray:
        """Return the static shapes (3 n_nodes, n) of the blade for displacements (n_root_dofs, n)
        of its root."""
        out = -self._spread(
            self.solver.solve(self.body.stiffness[self.own_dofs][:, self.root_dofs] @ shapes)
        )
        out[self.root_dofs] = shapes
        return out


def disk_matrices(
    blade: BladePart, sector: CyclicSector, carried: NDArray
) -> tuple[NDArray, NDArray]:
    """Return stiffness and mass (N // 2 + 1, n, n), complex, of static shapes of blade
    (3 n_nodes, n) and disk.

    ``sector`` is the sector at any of the nodal diameters.  The disk between its cut faces and the
    roots is real and factorised once; only the stiffness of the faces depends on the nodal
    diameter.  With a factorisation at each of 19 nodal diameters the import of a sector of 2,865
    nodes takes 1.4 times as long.
    """
    body, held = blade.body, blade.fixed.copy()
    held.ravel()[blade.own_dofs] = True
    moving, faces = ~held.ravel(), np.zeros(body.n_dof, bool)
    moving[blade.root_dofs] = False
    faces[body.dofs(sector.faces.nodes)] = True
    face, inner = np.flatnonzero(moving & faces), np.flatnonzero(moving & ~faces)
    of_inner, of_face = body.stiffness[inner], body.stiffness[face]
    factor, coupling = factorise(of_inner[:, inner]), of_inner[:, face].tocsc()
    motion = carried[blade.root_dofs]
    driven = factor.solve(np.ascontiguousarray(of_inner[:, blade.root_dofs] @ motion))
    stiffness = of_face[:, face].toarray()
    for start in range(0, len(face), 64):  # columns at a time, for memory
        columns = slice(start, start + 64)
        stiffness[:, columns] -= coupling.T @ factor.solve(coupling[:, columns].toarray())
    load = of_face[:, blade.root_dofs] @ motion - coupling.T @ driven
    out = []
    for d in range(sector.faces.n_sectors // 2 + 1):
        blade.step(f"disk of the wheel, nodal diameter {d}")
        t = cyclic_transformation(len(body.nodes), sector.faces, held, d)[face]
        t = t[:, np.unique(t.indices)].toarray()
        whole = np.zeros(carried.shape, t.dtype)
        whole[blade.own_dofs], whole[blade.root_dofs] = carried[blade.own_dofs], motion
        whole[face] = -t @ np.linalg.solve(t.conj().T @ stiffness @ t, t.conj().T @ load)
        push = coupling @ whole[face]
        parts = [factor.solve(np.ascontiguousarray(part)) for part in (push.real, push.imag)]
        whole[inner] = -driven - (parts[0] + 1j * parts[1] if np.iscomplexobj(t) else parts[0])
        out.append(
            [hermitian(whole.conj().T @ (matrix @ whole)) for matrix in (body.stiffness, body.mass)]
        )
    k, m = np.moveaxis(np.array(out, complex), 1, 0)
    return k, m


def sampled_waves(n_sectors: int) -> list[int]:
    """Return the nodal diameters 0, 1, 2, 4, 8 ... N/2 from which shapes are computed."""
    half = n_sectors // 2
    return sorted({0, half, *(2**k for k in range(half.bit_length() - 1))})


def root_shapes(blade: BladePart, sector: Sectors, n_sectors: int, sizes: LocalSizes) -> NDArray:
    """Return the principal shapes (n_root_dofs, n) of the root in the lowest modes."""
    motion = []
    for d in sampled_waves(n_sectors):
        omega2, shapes = sector(d).modes(sizes.modes)
        found = shapes[blade.root_dofs] / np.sqrt(omega2)
        motion += [found.real, found.imag]
    shapes, size, _ = np.linalg.svd(np.hstack(motion), full_matrices=False)
    return np.asarray(shapes[:, size > 1e-8 * size[0]][:, : sizes.interface])


def damper_motion(
    ports: Sequence[Port], interfaces: Mapping[str, Interface]
) -> tuple[NDArray, NDArray]:
    """Return rigid-body motions of the dampers (3 n_points, 6) at the ports of a blade, and their
    sectors (3 n_points,).

    Sectors are relative to the blade.  Points in contact with the ground or another blade have zero
    motion.
    """
    motion, sector = [], []
    for name, side in ports:
        face = interfaces[name]
        other = face.body_b if side == "a" else face.body_a
        rigid = face.frame @ rigid_motions(face.points, np.zeros(3), np.eye(3)).reshape(-1, 3, 6)
        body = face.body_a if side == "a" else face.body_b
        motion.append(rigid.reshape(-1, 6) * (other not in (body, "ground")))
        sector.append(
            np.full(3 * face.n_points, (face.sector_b - face.sector_a) * (1 if side == "a" else -1))
        )
    return np.concatenate(motion), np.concatenate(sector)


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
    the six lowest frequencies at nodal diameters 0 to 32 are

    | springs at the points, N/m | 2e7 | 2e8 | 2e9 | rigid, with the residual stiffness of the points |
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
    found, root = [], np.linalg.pinv(loads)  # the flexibility is root.T @ root
    spring = len(loads) / float(np.square(root).sum())
    contact = wheel.contact_modes.reshape(-1, wheel.n)
    for d in sampled_waves(n_sectors):
        motion = dampers[0] * np.exp(2j * np.pi * d * dampers[1] / n_sectors)[:, None]
        rigid, size, _ = np.linalg.svd(motion, full_matrices=False)
        rigid = rigid[:, size > 1e-9 * size[0]]
        stuck = contact - rigid @ (rigid.conj().T @ contact)
        for held in (factor * spring * stuck for factor in SPRINGS):
            last = min(sizes.modes, wheel.n) - 1
            omega2, modes = eigh(
                wheel.stiffness(d) + contact.T @ held, wheel.mass(d), subset_by_index=(0, last)
            )
            forces = held @ modes / np.sqrt(omega2)
            found += [forces.real, forces.imag]
    shapes = np.linalg.svd(root @ np.hstack(found), full_matrices=False)[0]
    return np.asarray(loads @ shapes[:, : sizes.attachment])


def local_shapes(
    blade: BladePart, sector: Sectors, wanted: Wanted, dampers: tuple[NDArray, NDArray],
    sizes: LocalSizes,
) -> tuple[NDArray, NDArray, NDArray, NDArray]:  # fmt: skip
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
    contact, (omega2, modes) = wanted.contact, blade.cantilever(sizes.cantilever)
    first = sector(0)
    n_sectors = first.faces.n_sectors
    carried = blade.carried(root_shapes(blade, sector, n_sectors, sizes))
    disk = disk_matrices(blade, first, carried)
    # shapes of unit mass on the average over all waves, so that all matrices have similar entries
    scale = eigh(*(mean_over_waves(matrices, n_sectors) for matrices in disk))[1]
    k, m = (hermitian(scale.T @ matrices @ scale) for matrices in disk)
    carried = carried @ scale
    columns = blade.contact_columns(contact)
    columns -= (modes / omega2) @ (contact @ modes).T
    size, loads = np.linalg.eigh(hermitian(contact @ columns))
    real = size > 1e-9 * size.max(initial=0.0)
    attached = np.zeros((len(modes), 0))
    if sizes.attachment and real.any():
        loads = loads[:, real] / np.sqrt(size[real])
        wheel = _made_of(blade, wanted, omega2, np.hstack([modes, columns @ loads, carried]), k, m)
        attached = blade.attachments(
            columns @ stuck_loads(wheel, loads, dampers, n_sectors, sizes), modes
        )
    if wanted.static_shapes and wanted.locations:
        loads = location_loads(blade.body, wanted.locations.values())
        static = residual_shapes(
            blade.body, np.hstack([modes, attached]), loads, blade.contact_columns(loads.T.tocsr())
        )
        attached = np.hstack([attached, static[1]])
    return omega2, np.hstack([modes, attached, carried]), k, m


def local_basis(
    blade: BladePart, sector: Sectors, wanted: Wanted, dampers: tuple[NDArray, NDArray],
    sizes: LocalSizes, region: str,
) -> LocalBasis:  # fmt: skip
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
    basis = _made_of(blade, wanted, *local_shapes(blade, sector, wanted, dampers, sizes))
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
    """Return the local basis with the shapes and matrices of :func:`local_shapes`."""
    body, n, r = blade.body, shapes.shape[1], stiffness.shape[1]
    clamped, root_rows, strain = slice(0, n - r), slice(n - r, n), np.zeros((r, r))
    carried = shapes[:, root_rows]
    if blade.stiffness is not None:
        strain = hermitian(carried.T @ (blade.stiffness @ carried))
    blade_stiffness = np.zeros((n, n))
    attached = np.einsum("ij,ij->j", shapes[:, clamped], body.stiffness @ shapes[:, clamped])[
        len(omega2) :
    ]
    blade_stiffness[clamped, clamped] = np.diag(np.append(omega2, attached))
    blade_stiffness[root_rows, root_rows] = strain
    blade_mass = shapes.T @ (body.mass @ shapes)
    root = carried[blade.root_dofs]
    blade_mass[root_rows, root_rows] -= root.T @ (
        body.mass[blade.root_dofs][:, blade.root_dofs] @ root
    )  # part of the disk
    blade_mass = hermitian(blade_mass)
    return LocalBasis(
        region="", omega2=omega2.copy(), damping_ratio=np.full(n, wanted.damping_ratio), blade_stiffness=blade_stiffness,
        blade_mass=blade_mass, disk_stiffness=stiffness - strain, disk_mass=mass - blade_mass[root_rows, root_rows],
        contact_modes=(wanted.contact @ shapes).reshape(-1, 3, n), locations=location_rows(wanted.locations, shapes),
    )  # fmt: skip


def mean_over_waves(matrices: NDArray, n_sectors: int) -> NDArray:
    """Return the real mean (n, n) of Hermitian matrices (N // 2 + 1, n, n) over all waves in both
    directions."""
    weight = np.where(2 * np.arange(len(matrices)) % n_sectors == 0, 1.0, 2.0)
    return np.asarray(np.einsum("d,dij->ij", weight, matrices).real / n_sectors)
