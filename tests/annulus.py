"""The whole annulus of a finite element sector, put together in one global frame; nothing of the cyclic conventions enters.

Nodes of all sectors are turned to their places and merged where they coincide; matrices are turned alike and added up,
those of each blade with a factor of its own.  `Annulus.projected` reduces it to the local coordinates of all sectors.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import eigsh, splu
from scipy.spatial import cKDTree

from bdamper.fem import Geometry, LocalSizes, MeshDensity, SectorFE, bladed_disk
from bdamper.fem.generated_models import wedge_patches
from bdamper.fem.local_basis import damper_motion, local_shapes
from bdamper.fem.meshes import interface
from bdamper.fem.reduced_bodies import Wanted

POINTS = (2, 2)
SIZES = LocalSizes()


def small_sector(n_blades: int, disk: float = 1.0) -> SectorFE:
    """A coarse sector (1,551 degrees of freedom) of a wheel of 5 to 8 blades, the stiffness of its disk times ``disk``."""
    angle = (
        np.pi / 3 if n_blades > 5 else np.pi / 4
    )  # angle of the faces, so that platforms slope downward
    geometry = Geometry(
        n_blades, bore_radius=0.05, rim_radius=0.08, ridge_radius=0.1215, face_angle=angle
    )
    fe = SectorFE(geometry, MeshDensity(2, 1, 1, 2, 1, 1, 1, 2, 1, 1, 1, 2))
    blade = fe.blade_part().stiffness
    fe.blade = replace(fe.blade, stiffness=(blade + disk * (fe.blade.stiffness - blade)).tocsr())
    return fe


def small_wheel(fe: SectorFE, sizes: LocalSizes = SIZES):
    """The model of such a sector with its local basis and the modes of all nodal diameters."""
    diameters = tuple(range(fe.geometry.n_blades // 2 + 1))
    return bladed_disk(
        POINTS, n_modes=20, n_damper_modes=6, nodal_diameters=diameters, fe=fe, wheel=sizes
    )


def dampers_between(left, right) -> tuple[np.ndarray, np.ndarray]:
    """Rigid motion of the dampers at the contact patches of a blade, and their sectors."""
    faces = (
        interface("left", left, "damper", "blade"),
        interface("right", right, "damper", "blade", sector_b=1),
    )
    return damper_motion((("left", "b"), ("right", "b")), {face.name: face for face in faces})


def turn(angle: float) -> np.ndarray:
    """From the axes of a sector to those of one at ``angle`` (rad) further toward +X."""
    return np.array(
        [[np.cos(angle), np.sin(angle), 0], [-np.sin(angle), np.cos(angle), 0], [0, 0, 1]]
    )


class Annulus:
    """All sectors of ``fe``; coordinates of the reduction as in `bdamper.fem.local_basis` with ``sizes``."""

    def __init__(self, fe: SectorFE, sizes: LocalSizes = SIZES):
        self.fe, self.sizes, self.N = fe, sizes, fe.geometry.n_blades
        self.part = fe.blade_part()
        g, nodes = fe.geometry, fe.blade.nodes
        places = np.concatenate([nodes @ turn(2 * np.pi * k / self.N).T for k in range(self.N)])
        first = cKDTree(places).query_ball_point(places, 1e-8)
        unique, index = np.unique([min(group) for group in first], return_inverse=True)
        self.index = index.reshape(self.N, -1)  # global node of each node of each sector
        radius = np.hypot(places[unique, 0], places[unique, 1])
        self.moving = np.flatnonzero(np.repeat(radius > g.bore_radius + 1e-8, 3))
        blocks = [
            np.broadcast_to(turn(2 * np.pi * k / self.N), (len(nodes), 3, 3)) for k in range(self.N)
        ]
        shape = (3 * len(nodes), 3 * len(unique))
        # from the motion of the annulus to that of the nodes of a sector in its own axes
        self.own = []
        for block, columns in zip(blocks, self.index):
            rows = sp.bsr_matrix(
                (block.transpose(0, 2, 1), columns, np.arange(len(nodes) + 1)), shape=shape
            )
            self.own.append(rows.tocsr())
        left, right = (wedge_patches(g, side, POINTS) for side in ("left", "right"))
        self.contact = fe.blade_contact(left, right)
        self.dampers = dampers_between(left, right)

    def matrices(self, deviation=None) -> tuple[sp.csc_matrix, sp.csc_matrix]:
        """Stiffness and mass of the moving components; blades of frequency deviation (N,), clamped at their roots."""
        deviation = np.zeros(self.N) if deviation is None else deviation
        blade, disk = self.part.stiffness, self.fe.blade.stiffness - self.part.stiffness
        k = sum(o.T @ (disk + (1.0 + e) ** 2 * blade) @ o for o, e in zip(self.own, deviation))
        m = sum(o.T @ self.fe.blade.mass @ o for o in self.own)
        return tuple(a.tocsr()[self.moving][:, self.moving].tocsc() for a in (k, m))

    def contact_rows(self, sector: int) -> sp.csr_matrix:
        """From the moving components to the contact points of the blade of a sector, (3 n_points, n), ports left, right."""
        return (self.contact @ self.own[sector]).tocsr()[:, self.moving]

    def stuck(self, damper_modes, stiffness: float) -> sp.csc_matrix:
        """Stiffness of dampers without mass, stuck by springs (N/m) at every contact point.

        ``damper_modes`` (3 n_points, 6): rigid motions of a damper at the points of its left and right face.
        """
        rigid = np.linalg.qr(damper_modes)[0]
        half, out = self.contact.shape[0] // 2, 0.0
        for n in range(self.N):
            rows = sp.vstack(
                [self.contact_rows(n)[:half], self.contact_rows((n + 1) % self.N)[half:]]
            )
            out = out + stiffness * (
                rows.T @ sp.csr_matrix(np.eye(2 * half) - rigid @ rigid.T) @ rows
            )
        return sp.csc_matrix(out)

    def frequencies(self, k, m, n: int) -> np.ndarray:
        """The lowest n frequencies, Hz."""
        start = np.random.default_rng(0).standard_normal(k.shape[0])
        omega2 = eigsh(k, n, M=m, sigma=0.0, v0=start, return_eigenvectors=False)
        return np.sqrt(np.sort(omega2)) / (2 * np.pi)

    @cached_property
    def basis(self) -> np.ndarray:
        """Motion (n_moving, N n) of the annulus by the local coordinates of all sectors, one sector after the other."""
        wanted = Wanted((), self.contact, {}, 1, 0.0)
        shapes = local_shapes(self.part, self.fe.cyclic, wanted, self.dampers, self.sizes)[1]
        nodes = np.zeros(len(self.fe.blade.nodes), bool)
        nodes[self.part.nodes] = True
        of_blade = sp.diags(np.repeat(nodes, 3).astype(float))
        out = np.hstack([(o.T @ (of_blade @ shapes))[self.moving] for o in self.own])
        # the disk follows the roots: static, all other nodes of the annulus free
        blades = np.unique(self.index[:, nodes])
        disk = ~np.isin(self.moving // 3, blades)
        k = self.matrices()[0].tocsr()
        out[disk] = -splu(k[disk][:, disk].tocsc()).solve(k[disk][:, ~disk] @ out[~disk])
        return out

    def projected(self, deviation=None) -> tuple[np.ndarray, np.ndarray]:
        """Stiffness and mass (N n, N n) in the coordinates of :attr:`basis`."""
        return tuple(self.basis.T @ (a @ self.basis) for a in self.matrices(deviation))


def wheel_matrices(local, n_blades: int, deviation=None) -> tuple[np.ndarray, np.ndarray]:
    """Stiffness and mass (N n, N n) of a whole wheel from a local basis, without a transform: by sums over waves."""
    deviation = np.zeros(n_blades) if deviation is None else deviation
    n, r, out = local.n, local.n_interface, []
    for blade, disk, factor in (
        (local.blade_stiffness, local.disk_stiffness, (1.0 + np.asarray(deviation)) ** 2),
        (local.blade_mass, local.disk_mass, np.ones(n_blades)),
    ):
        whole = np.zeros((n_blades, n, n_blades, n))
        for a in range(n_blades):
            whole[a, :, a] += factor[a] * blade
            for b in range(n_blades):
                for d in range(n_blades):
                    wave = disk[d] if 2 * d <= n_blades else disk[n_blades - d].conj()
                    part = wave * np.exp(2j * np.pi * d * (a - b) / n_blades) / n_blades
                    whole[a, n - r :, b, n - r :] += part.real
        out.append(whole.reshape(n_blades * n, -1))
    return tuple(out)
