"""The finite element objects behind a model of a bladed disk with wedge dampers.

`SectorFE` holds the meshes, matrices, factorisations and modes, which do not depend on the contact points:
several contact grids, and the full finite element reference for them, are made from one of it.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from bdamper.fe.assemble import Discretisation, discretise
from bdamper.fe.contact_points import Patches, averaging_matrix, wedge_patches
from bdamper.fe.geometry import Geometry, Material, turn
from bdamper.fe.mesh import MeshDensity, damper_mesh, sector_mesh
from bdamper.reduction.cyclic import CyclicSector, match_faces
from bdamper.reduction.free_body import FreeBody


@dataclass
class SectorFE:
    """Sector and damper as finite element bodies.

    Parameters
    ----------
    geometry : Geometry
    density : MeshDensity
    material : Material
    """

    geometry: Geometry = field(default_factory=Geometry)
    density: MeshDensity = field(default_factory=lambda: MeshDensity.preset("coarse"))
    material: Material = field(default_factory=Material)

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
        self.left: NDArray = left
        self.right: NDArray = match_faces(nodes, left, right, g.pitch)
        # Midpoints of straight edges along the bore lie slightly inside its radius, all others outside.
        self.clamped: NDArray = np.flatnonzero(radius < g.bore_radius + 1e-8)
        self._cyclic: dict[int, CyclicSector] = {}

    def cyclic(self, nodal_diameter: int) -> CyclicSector:
        """The sector at one nodal diameter, 0 to ``n_blades // 2``."""
        if not 0 <= nodal_diameter <= self.geometry.n_blades // 2:
            raise ValueError(
                f"nodal diameter must be 0 to {self.geometry.n_blades // 2}, not {nodal_diameter}; "
                "larger ones are complex conjugates of these"
            )
        if nodal_diameter not in self._cyclic:
            self._cyclic[nodal_diameter] = CyclicSector(
                self.blade, self.left, self.right, self.clamped, self.geometry.n_blades, nodal_diameter
            )
        return self._cyclic[nodal_diameter]

    def blade_contact(self, left: Patches, right: Patches) -> sp.csr_matrix:
        """Averaging matrix of blade 0 for its ports at the interfaces "left" and "right", in this order.

        At "right" the blade stands in sector +1, so what blade 0 carries is its own left underside: the
        patches turned back by one pitch.
        """
        back = right.turned(turn(-self.geometry.pitch))
        return sp.vstack(
            [averaging_matrix(self.blade, left), averaging_matrix(self.blade, back)], format="csr"
        )

    def bonded_frequencies(
        self, nodal_diameter: int, points: int | tuple[int, int] = 48, n_modes: int = 5
    ) -> NDArray:
        """Frequencies (n_modes,), Hz, with the damper bonded at patches; see `bdamper.fe.bonded`."""
        from bdamper.fe.bonded import bonded_frequencies

        left, right = (wedge_patches(self.geometry, side, points) for side in ("left", "right"))
        return bonded_frequencies(self, nodal_diameter, left, right, n_modes)
