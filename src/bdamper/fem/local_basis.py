"""The local basis of a wheel from the matrices of one sector: the blade by itself, the disk as waves see it.

The blade meets the disk in the nodes of its root.  With f for the other nodes of the blade, r for the root and g for the
rest of the disk, the coordinates of :mod:`bdamper.model.modal_basis` have these shapes:

* cantilever modes U: modes of :math:`K_{ff}, M_{ff}`;
* attachments X: static shapes :math:`K_{ff}^{-1} P^T q` of loads q on the contact points, without their part in U.  The
  loads q are the principal contact forces in the lowest modes of wheels whose dampers stick (:func:`stuck_loads`);
* static shapes of forces at the locations, without their part in U and X, where they are asked for; they count as
  attachments;
* shapes of the root V, with the static shapes of blade, :math:`-K_{ff}^{-1} K_{fr} V`, and disk, at each nodal diameter.
  V are the principal shapes (singular vectors) of the root's motion, divided by the frequency, in the lowest modes of the
  sector at nodal diameters 0, 1, 2, 4, 8 ... N/2 (all of them change nothing: the largest error of family 1 of the 65
  blades of :mod:`bdamper.fem` is 0.00016 against 0.00012 %).

None but the last moves the root, and all are static or modes, so that U, X and V do not couple in the stiffness (Craig
and Bampton, AIAA Journal 6, 1968, p. 1313).

The stiffness of the blade alone is that of its own elements.  From matrices of a whole sector it cannot be told at the
root, where entries of blade and disk are added up; then all of the stiffness of the coordinates of the root counts as the
disk's.  This has no effect on equal blades, and none on the frequencies of unequal ones clamped at the root; what a
deviation leaves out is the strain of the blade when its root deforms (a deviation of 5 % moves family 1 of a coarse wheel
with a soft disk by 0.05 % too little).
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

from bdamper.fem.cyclic_symmetry import CyclicSector, cyclic_transformation, factorise, lowest_modes
from bdamper.fem.reduced_bodies import Wanted, location_loads, location_rows, nodes_of, residual_shapes
from bdamper.fem.sector_faces import SectorFaces
from bdamper.fem.surface import Structure, check, hermitian
from bdamper.model.modal_basis import LocalBasis, fix_phase, rigid_motions
from bdamper.model.structure import Interface, Port
from bdamper.util import validation

SPRINGS = (0.3, 3.0)
"""Springs on which dampers stick where the loads of attachments are chosen, times the mean stiffness of a contact point on
the blade without its cantilever modes.  On the shipped disk (1, 10) or (0.1, 1, 10) leave errors half as large again."""


@dataclass(frozen=True)
class LocalSizes(validation.Checked):
    """How many shapes a local basis has.

    Parameters
    ----------
    cantilever : int
        Modes of the blade clamped at its root, well above the families of interest.  Ten leave the sixth stuck family of
        coarse wheels of 5, 6, 7 and 8 blades 0.6, 6.3, 0.4 and 0.2 % too high, twelve 0.2, 0.3, 0.35 and 0.2 %; more
        attachments do not help there.
    attachment : int
        Static shapes of contact forces.
    interface : int
        Shapes of the root.
    modes : int
        Modes at each nodal diameter from which shapes of the root and loads of the attachments are taken.
    """

    cantilever: validation.Count = 12
    attachment: validation.Natural = 12
    interface: validation.Count = 16
    modes: validation.Count = 10


@dataclass
class BladePart:
    """The nodes of a blade within a sector.

    Parameters
    ----------
    body : Structure
        The sector.
    nodes : (n,) int
        All nodes of the blade, those of its root included.
    fixed : (n_nodes, 3) bool
        Components that do not move.
    stiffness : (3 n_nodes, 3 n_nodes) sparse, optional
        Of the elements of the blade alone, N/m.
    step : function of a text
        Told each nodal diameter of the disk as its work begins.
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
        check(len(self.own_dofs) >= 12, f"a blade of {len(self.own_dofs)} moving components besides its root")

    @property
    def inside(self) -> NDArray:
        """(n_nodes,) bool: nodes of the blade."""
        return np.isin(np.arange(len(self.body.nodes)), self.nodes)

    def check_wanted(self, wanted: Wanted, faces: SectorFaces) -> None:
        """Contact points and locations are on the blade, which has no node on the faces of the sector.

        Raises
        ------
        ValueError
        """
        check(self.inside[wanted.contact.indices // 3].all(), "contact points that are not on the blade")
        for name, place in wanted.locations.items():
            check(self.inside[nodes_of(place)].all(), f"location '{name}', which is not on the blade")
        check(not self.inside[faces.nodes].any(), "a node of the blade that lies on a face at which the sector repeats")

    @cached_property
    def solver(self) -> SuperLU:
        """Factorisation of the stiffness of the blade clamped at its root."""
        return factorise(self.body.stiffness[self.own_dofs][:, self.own_dofs])

    def _spread(self, values: NDArray) -> NDArray:
        """Values of the blade without its root as columns over all nodes of the sector."""
        out = np.zeros((self.body.n_dof, values.shape[1]))
        out[self.own_dofs] = values
        return out

    def cantilever(self, n_modes: int) -> tuple[NDArray, NDArray]:
        """Squared frequencies (n_modes,) and modes (3 n_nodes, n_modes) of the blade clamped at its root."""
        stiffness, mass = (m[self.own_dofs][:, self.own_dofs] for m in (self.body.stiffness, self.body.mass))
        omega2, shapes = lowest_modes(stiffness, mass, self.solver.solve, n_modes)
        return omega2, fix_phase(self._spread(shapes), self.body.mass)

    def contact_columns(self, contact: sp.csr_matrix) -> NDArray:
        """Displacements (3 n_nodes, n) of the clamped blade under unit forces on the rows of ``contact`` (n, 3 n_nodes)."""
        return self._spread(self.solver.solve(contact[:, self.own_dofs].T.toarray()))

    def attachments(self, columns: NDArray, modes: NDArray) -> NDArray:
        """Attachment shapes, mass-normalised and orthogonal to each other and to the cantilever modes.

        ``columns`` (3 n_nodes, n) are static shapes, ``modes`` the cantilever modes.
        """
        shapes = columns - modes @ (modes.T @ (self.body.mass @ columns))  # rounding
        k, m = (shapes.T @ (matrix @ shapes) for matrix in (self.body.stiffness, self.body.mass))
        return np.asarray(shapes @ eigh(k, m)[1])

    def carried(self, shapes: NDArray) -> NDArray:
        """Static shapes (3 n_nodes, n) of the blade alone on motions (n_root_dofs, n) of its root."""
        out = -self._spread(self.solver.solve(self.body.stiffness[self.own_dofs][:, self.root_dofs] @ shapes))
        out[self.root_dofs] = shapes
        return out


def disk_matrices(blade: BladePart, sector: CyclicSector, carried: NDArray) -> tuple[NDArray, NDArray]:
    """Stiffness and mass (N // 2 + 1, n, n) of static shapes of blade (3 n_nodes, n) and disk together, complex.

    ``sector`` is the sector at any of them.  The disk between its cut faces and the roots is factorised once, real; what
    depends on the nodal diameter is the stiffness of the faces.  With a factorisation at each of 19 nodal diameters
    the whole import of a sector of 2,865 nodes takes 1.4 times as long.
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
        out.append([hermitian(whole.conj().T @ (matrix @ whole)) for matrix in (body.stiffness, body.mass)])
    k, m = np.moveaxis(np.array(out, complex), 1, 0)
    return k, m


def sampled_waves(n_sectors: int) -> list[int]:
    """Nodal diameters 0, 1, 2, 4, 8 ... N/2, from whose modes shapes are taken."""
    half = n_sectors // 2
    return sorted({0, half, *(2**k for k in range(half.bit_length() - 1))})


def root_shapes(blade: BladePart, sector: Callable[[int], CyclicSector], n_sectors: int, sizes: LocalSizes) -> NDArray:
    """Principal shapes (n_root_dofs, n) of the root in the lowest modes."""
    motion = []
    for d in sampled_waves(n_sectors):
        omega2, shapes = sector(d).modes(sizes.modes)
        found = shapes[blade.root_dofs] / np.sqrt(omega2)
        motion += [found.real, found.imag]
    shapes, size, _ = np.linalg.svd(np.hstack(motion), full_matrices=False)
    return np.asarray(shapes[:, size > 1e-8 * size[0]][:, : sizes.interface])


def damper_motion(ports: Sequence[Port], interfaces: Mapping[str, Interface]) -> tuple[NDArray, NDArray]:
    """Rigid motion of the dampers (3 n_points, 6) at the points of a blade's ports, and their sectors (3 n_points,).

    Sectors count from that of the blade; what meets the ground, or another blade, does not move.
    """
    motion, sector = [], []
    for name, side in ports:
        face = interfaces[name]
        other = face.body_b if side == "a" else face.body_a
        rigid = face.frame @ rigid_motions(face.points, np.zeros(3), np.eye(3)).reshape(-1, 3, 6)
        own = face.body_a if side == "a" else face.body_b
        motion.append(rigid.reshape(-1, 6) * (other not in (own, "ground")))
        sector.append(np.full(3 * face.n_points, (face.sector_b - face.sector_a) * (1 if side == "a" else -1)))
    return np.concatenate(motion), np.concatenate(sector)


def stuck_loads(
    wheel: LocalBasis, loads: NDArray, dampers: tuple[NDArray, NDArray], n_sectors: int, sizes: LocalSizes
) -> NDArray:
    """Principal loads (3 n_points, n) of the contact forces in the lowest modes of wheels whose dampers stick.

    Dampers are rigid, free and without mass, on springs :data:`SPRINGS` at every point.  Principal are those loads that
    carry most of the forces' energy in the flexibility that the cantilever modes leave out.  On the coarse disk of 65
    blades (9 points a face, 12 attachments) the six lowest frequencies at nodal diameters 0 to 32 are off by at most

    | springs at the points, N/m | 2e7 | 2e8 | 2e9 | rigid, with the residual stiffness of the points |
    |---|---|---|---|---|
    | these loads | 0.02 % | 0.09 % | 0.25 % | -0.4 -1.3 -0.6 -1.5 -0.7 -0.9 % |
    | loads of the largest flexibility | 0.09 % | 0.8 % | 7 % | 0.8 4.0 1.6 9.2 3.2 4.9 % |

    Parameters
    ----------
    wheel : LocalBasis
        With the static shapes of all loads as attachments.
    loads : (3 n_points, n_attachment) float
        On the contact points, orthogonal in the flexibility that the cantilever modes leave out.
    dampers, n_sectors, sizes
        As in :func:`local_basis`.
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
            omega2, modes = eigh(wheel.stiffness(d) + contact.T @ held, wheel.mass(d), subset_by_index=(0, last))
            forces = held @ modes / np.sqrt(omega2)
            found += [forces.real, forces.imag]
    shapes = np.linalg.svd(root @ np.hstack(found), full_matrices=False)[0]
    return np.asarray(loads @ shapes[:, : sizes.attachment])


def local_shapes(
    blade: BladePart, sector: Callable[[int], CyclicSector], wanted: Wanted, dampers: tuple[NDArray, NDArray],
    sizes: LocalSizes,
) -> tuple[NDArray, NDArray, NDArray, NDArray]:  # fmt: skip
    """The shapes of :func:`local_basis`, parameters as there.

    Returns
    -------
    omega2 : (n_cantilever,) float, rad2/s2
    shapes : (3 n_nodes, n) float, kg^-1/2
        Of the blade, on all nodes of the sector; cantilever modes, attachments, shapes carried by the root.
    stiffness, mass : (N // 2 + 1, n_interface, n_interface) complex
        Of the last shapes, blade and disk together, at each nodal diameter.
    """
    contact, (omega2, modes) = wanted.contact, blade.cantilever(sizes.cantilever)
    first = sector(0)
    n_sectors = first.faces.n_sectors
    carried = blade.carried(root_shapes(blade, sector, n_sectors, sizes))
    disk = disk_matrices(blade, first, carried)
    # shapes of unit mass on the average over all waves, for numbers of one size
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
        attached = blade.attachments(columns @ stuck_loads(wheel, loads, dampers, n_sectors, sizes), modes)
    if wanted.static_shapes and wanted.locations:
        loads = location_loads(blade.body, wanted.locations.values())
        static = residual_shapes(blade.body, np.hstack([modes, attached]), loads, blade.contact_columns(loads.T.tocsr()))
        attached = np.hstack([attached, static[1]])
    return omega2, np.hstack([modes, attached, carried]), k, m


def local_basis(
    blade: BladePart, sector: Callable[[int], CyclicSector], wanted: Wanted, dampers: tuple[NDArray, NDArray],
    sizes: LocalSizes, region: str,
) -> LocalBasis:  # fmt: skip
    """Reduce a sector to its local basis.

    Parameters
    ----------
    blade : BladePart
    sector : function of the nodal diameter
        Not acyclic.
    wanted : Wanted
        All of it on the blade; ``sizes`` say how many modes.
    dampers : (3 n_points, 6) float, (3 n_points,) int
        Rigid motion of what the contact points meet, and its sector (:func:`damper_motion`).
    sizes : LocalSizes
    region : str
        What counts as the blade, in words.

    Raises
    ------
    ValueError
        If contact points or locations are not on the blade, or its root lies on a face at which the sector repeats.
    """
    blade.check_wanted(wanted, sector(0).faces)
    made = _made_of(blade, wanted, *local_shapes(blade, sector, wanted, dampers, sizes))
    flexibility = hermitian(wanted.contact @ blade.contact_columns(wanted.contact))
    return replace(made, region=region, flexibility=flexibility)


def _made_of(
    blade: BladePart, wanted: Wanted, omega2: NDArray, shapes: NDArray, stiffness: NDArray, mass: NDArray
) -> LocalBasis:
    """The local basis of shapes as :func:`local_shapes` returns them."""
    body, n, r = blade.body, shapes.shape[1], stiffness.shape[1]
    own, rest, strain = slice(0, n - r), slice(n - r, n), np.zeros((r, r))
    carried = shapes[:, rest]
    if blade.stiffness is not None:
        strain = hermitian(carried.T @ (blade.stiffness @ carried))
    blade_stiffness = np.zeros((n, n))
    attached = np.einsum("ij,ij->j", shapes[:, own], body.stiffness @ shapes[:, own])[len(omega2) :]
    blade_stiffness[own, own] = np.diag(np.append(omega2, attached))
    blade_stiffness[rest, rest] = strain
    blade_mass = shapes.T @ (body.mass @ shapes)
    root = carried[blade.root_dofs]
    blade_mass[rest, rest] -= root.T @ (body.mass[blade.root_dofs][:, blade.root_dofs] @ root)  # counts as the disk's
    blade_mass = hermitian(blade_mass)
    return LocalBasis(
        region="", omega2=omega2.copy(), damping_ratio=np.full(n, wanted.damping_ratio), blade_stiffness=blade_stiffness,
        blade_mass=blade_mass, disk_stiffness=stiffness - strain, disk_mass=mass - blade_mass[rest, rest],
        contact_modes=(wanted.contact @ shapes).reshape(-1, 3, n), locations=location_rows(wanted.locations, shapes),
    )  # fmt: skip


def mean_over_waves(matrices: NDArray, n_sectors: int) -> NDArray:
    """Mean (n, n), real, of Hermitian matrices (N // 2 + 1, n, n) over all waves of both directions."""
    weight = np.where(2 * np.arange(len(matrices)) % n_sectors == 0, 1.0, 2.0)
    return np.asarray(np.einsum("d,dij->ij", weight, matrices).real / n_sectors)
