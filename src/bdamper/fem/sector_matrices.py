"""One sector of the reference disk and its wedge damper as finite element bodies.

`SectorFE` holds the meshes, matrices, factorisations and modes, none of which depends on the contact points: one
object serves several grids of contact points and the full finite element solution that they are compared with.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from bdamper.fem.assembly import Discretisation, discretise
from bdamper.fem.contact_patches import Patches
from bdamper.fem.contact_points import averaging_matrix
from bdamper.fem.cyclic_symmetry import CyclicSector
from bdamper.fem.free_body import FreeBody
from bdamper.fem.geometric_stiffness import stiffness_per_squared_speed
from bdamper.fem.geometry import Geometry, Material, turn
from bdamper.fem.mesh import MeshDensity, damper_mesh, join_blocks, sector_blocks, sector_mesh
from bdamper.fem.reduced_bodies import Wanted
from bdamper.fem.rotation import Rotation
from bdamper.fem.sector_faces import match_faces
from bdamper.fem.sector_local_basis import BladePart, LocalSizes, damper_motion, local_basis
from bdamper.model.local_basis import LocalBasis
from bdamper.model.structure import Interface
from bdamper.util import validation


@dataclass
class SectorFE:
    """Sector and damper as finite element bodies.

    Parameters
    ----------
    geometry : Geometry
    density : MeshDensity
    material : Material
    keep_factors : bool
        Keep the factorisations of all nodal diameters, instead of that of the latest alone (half a gigabyte each on the
        reference mesh).
    """

    geometry: Geometry = field(default_factory=Geometry)
    density: MeshDensity = field(default_factory=lambda: MeshDensity.preset("coarse"))
    material: Material = field(default_factory=Material)
    keep_factors: bool = True

    def __post_init__(self) -> None:
        g = self.geometry
        self.blade: Discretisation = discretise(sector_mesh(g, self.density), self.material)
        self.damper: FreeBody[Discretisation] = FreeBody(
            discretise(damper_mesh(g, self.density), self.material), turn(0.5 * g.pitch).T
        )
        nodes = self.blade.nodes
        angle, radius = np.arctan2(nodes[:, 0], nodes[:, 1]), np.hypot(nodes[:, 0], nodes[:, 1])
        on_disk = radius < g.rim_radius + 1e-8
        left = np.flatnonzero(on_disk & (np.abs(angle + 0.5 * g.pitch) < 1e-9))
        right = np.flatnonzero(on_disk & (np.abs(angle - 0.5 * g.pitch) < 1e-9))
        self.faces = match_faces(nodes, left, right, g.n_blades)
        # Midpoints of straight edges along the bore lie slightly inside its radius, all others outside.
        self.clamped: NDArray = np.flatnonzero(radius < g.bore_radius + 1e-8)
        self._cyclic: dict[int, CyclicSector] = {}

    def cyclic(self, nodal_diameter: int) -> CyclicSector:
        """The sector at one nodal diameter, 0 to ``n_blades // 2``."""
        validation.whole("nodal diameter", nodal_diameter, most=self.geometry.n_blades // 2)
        if not self.keep_factors:
            for d, other in self._cyclic.items():
                if d != nodal_diameter:
                    other.forget_factors()
        if nodal_diameter not in self._cyclic:
            self._cyclic[nodal_diameter] = CyclicSector(self.blade, self.faces, self.clamped, nodal_diameter)
        return self._cyclic[nodal_diameter]

    def rotation(self, check_at: float | None = None) -> Rotation:
        """How the stiffness of the sector changes with rotor speed.

        Parameters
        ----------
        check_at : float, rad/s, optional
            Speed at which frequencies are compared with those of the full matrices.
        """
        return Rotation(stiffness_per_squared_speed(self.blade, self.cyclic(0)), 0.0, check_at, "bdamper.fem")

    def blade_part(self) -> BladePart:
        """Shank, platform and airfoil, the blade of a wheel; it meets the disk at the rim, under the shank."""
        blocks = sector_blocks(self.geometry, self.density)[1:]  # without the disk
        part = discretise(join_blocks(blocks), self.material)
        nodes = cKDTree(self.blade.nodes).query(part.nodes)[1]
        dofs = self.blade.dofs(nodes)
        entries = part.stiffness.tocoo()
        shape = self.blade.stiffness.shape
        stiffness = sp.csr_matrix((entries.data, (dofs[entries.row], dofs[entries.col])), shape=shape)
        fixed = np.zeros((len(self.blade.nodes), 3), bool)
        fixed[self.clamped] = True
        return BladePart(self.blade, nodes, fixed, stiffness)

    def local_basis(self, wanted: Wanted, interfaces: Mapping[str, Interface], sizes: LocalSizes) -> LocalBasis:
        """Coordinates of blade and disk for mistuned wheels; see :func:`bdamper.fem.local_basis`."""
        dampers = damper_motion(wanted.ports, interfaces)
        return local_basis(self.blade_part(), self.cyclic, wanted, dampers, sizes, "shank, platform and airfoil")

    def blade_contact(self, left: Patches, right: Patches) -> sp.csr_matrix:
        """Averaging matrix of blade 0 for its ports at the interfaces "left" and "right", in this order.

        At "right" the blade stands in sector +1, so what blade 0 carries is its own left underside: the
        patches turned back by one pitch.
        """
        back = right.turned(turn(-self.geometry.pitch))
        return sp.vstack([averaging_matrix(self.blade, left), averaging_matrix(self.blade, back)], format="csr")

    def damper_contact(self, *patches: Patches) -> sp.csr_matrix:
        """Averaging matrix of the damper over patches of its faces, one below the other."""
        return sp.vstack([averaging_matrix(self.damper.body, p) for p in patches], format="csr")
