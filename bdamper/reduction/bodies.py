"""The bodies of a model from reduced structures: modes, receptances and loads at contact points."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from bdamper.model.model import Body, BodyLoad, ModalBasis, Port, SurfaceMesh
from bdamper.model.spin import SpinStatic
from bdamper.reduction.cyclic import CyclicSector
from bdamper.reduction.facets import Facets, corner_count
from bdamper.reduction.free_body import FreeBody
from bdamper.reduction.spin import Rotation, spin_displacement


def needed_nodal_diameters(n_blades: int, engine_order: int, harmonics: int) -> tuple[int, ...]:
    """Nodal diameters of the harmonics 0 to ``harmonics`` of an engine order, folded to at most N/2."""
    orders = (engine_order * h % n_blades for h in range(harmonics + 1))
    return tuple(sorted({min(d, n_blades - d) for d in orders}))


def location_rows(nodes: Mapping[str, int], shapes: NDArray) -> dict[str, NDArray]:
    """Rows (3, n_modes) of ``shapes`` (3 n_nodes, n_modes) at named nodes."""
    return {name: shapes[3 * node : 3 * node + 3].copy() for name, node in nodes.items()}


def picture_mesh(surface: Facets, nodes: NDArray, shapes: Mapping[int, NDArray]) -> SurfaceMesh:
    """Quadrilaterals of a surface by its corners, triangles with their last corner twice, for pictures.

    ``shapes`` are mode shapes (n_nodes, 3, n_modes) by nodal diameter.
    """
    quads = np.concatenate([g[:, [0, 1, 2, 3 if corner_count(g.shape[1]) == 4 else 2]] for g in surface.groups])
    used, compact = np.unique(quads, return_inverse=True)
    modes = {d: values[used] for d, values in shapes.items()}
    return SurfaceMesh(nodes[used].copy(), compact.reshape(quads.shape).astype(np.int32), modes)


@dataclass(frozen=True)
class Wanted:
    """Where and with how many modes the motion of a body is wanted.

    Parameters
    ----------
    ports : tuple of Port
    contact : (3 n_points, 3 n_nodes) sparse
        From nodal displacements to the contact points of all ports.
    locations : mapping of name to node index
    n_modes : int
    damping_ratio : float
        Of all elastic modes.
    """

    ports: tuple[Port, ...]
    contact: sp.csr_matrix
    locations: Mapping[str, int]
    n_modes: int
    damping_ratio: float

    def basis(self, omega2: NDArray, shapes: NDArray, flexibility: NDArray | None = None) -> ModalBasis:
        """Mass-normalised modes (3 n_nodes, n) of squared frequencies (n,) at the contact points and locations."""
        return ModalBasis(
            omega2=omega2.copy(),
            damping_ratio=np.where(omega2 > 0.0, self.damping_ratio, 0.0),
            contact_modes=(self.contact @ shapes).reshape(-1, 3, len(omega2)),
            locations=location_rows(self.locations, shapes),
            flexibility=flexibility,
        )


def constrained_body(
    name: str, wanted: Wanted, sector: Callable[[int], CyclicSector], nodal_diameters: Iterable[int],
    flexibility_at: Collection[int], rotation: Rotation | None = None,
) -> Body:  # fmt: skip
    """A sector that is held somewhere, at several nodal diameters.

    Parameters
    ----------
    name : str
    wanted : Wanted
    sector : function of the nodal diameter
    nodal_diameters : iterable of int
    flexibility_at : collection of int
        Nodal diameters at which the static receptance is wanted.
    rotation : Rotation, optional
        What changes with the speed of rotation.
    """
    bases = {}
    for d in nodal_diameters:
        reduced = sector(d)
        touching = wanted.contact if d in flexibility_at else None
        bases[d] = wanted.basis(*reduced.modes(wanted.n_modes), None if touching is None else reduced.receptance(touching))
        if rotation is not None:
            bases[d] = rotation.basis(bases[d], reduced, touching)
    spin = None
    if rotation is not None:
        moved = spin_displacement(sector(0))
        theory: Literal["linear", "stiffened"] = "linear" if rotation.omega_ref == 0.0 else "stiffened"
        at_points = (wanted.contact @ moved).reshape(-1, 3)
        spin = SpinStatic(at_points, location_rows(wanted.locations, moved), theory, rotation.omega_ref)
    return Body(name, "constrained", wanted.ports, bases, spin=spin)


def free_body(name: str, wanted: Wanted, free: FreeBody, radial: NDArray) -> Body:
    """A free body with its rigid-body and elastic modes, under centrifugal load along ``radial`` (3,).

    The six rigid-body modes are among those wanted.
    """
    omega2, shapes = free.modes(wanted.n_modes)
    force = free.centrifugal_load(radial)
    basis = wanted.basis(omega2, shapes, free.receptance(wanted.contact))
    moved = (wanted.contact @ free.elastic_response(force)).reshape(-1, 3)
    load = BodyLoad(direction=radial, generalised=shapes.T @ force, displacement=moved)
    mass, centre, inertia = free.total_mass, free.centre, free.inertia
    return Body(name, "free", wanted.ports, {0: basis}, mass=mass, centre=centre, inertia=inertia, load=load)
