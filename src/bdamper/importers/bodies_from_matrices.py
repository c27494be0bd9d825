"""Bodies of an imported model from stiffness and mass matrices, with the checks that only the reduction can make."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from bdamper.fem.cyclic_symmetry import CyclicSector
from bdamper.fem.free_body import FreeBody
from bdamper.fem.reduced_bodies import Wanted, constrained_body, free_body
from bdamper.importers.bodies_from_modes import check_reached, compare_known
from bdamper.importers.plausibility import check_rigid_motion
from bdamper.importers.prepared_body import NodeSet, PreparedBody, Ring
from bdamper.importers.two_speeds import rotation_of
from bdamper.model.structure import Body

if TYPE_CHECKING:
    from bdamper.fem.stress_rows import StressRows


def held_components(body: PreparedBody, wanted: Wanted, fixed: NodeSet | None, ring: Ring) -> NDArray:
    """Mask (n_nodes, 3) of the components that are held, those at images of held nodes on the other sector face included.

    Other programs want only one face held: their tie of the faces holds the other.

    Raises
    ------
    ModelError
        If a contact face or location has no rows in the matrices.
    """
    held = None if fixed is None else body.node_set(fixed, "fixed")
    without = np.flatnonzero(body.fixed(None).all(axis=1))
    check_reached(body, wanted, without if held is None else np.setdiff1d(without, held), "rows in the matrices")
    mask = body.fixed(held)
    out = np.stack([ring.faces.images(component) for component in mask.T], axis=1)
    if added := int((out & ~mask).any(axis=1).sum()):
        body.checks.append(f"{body.name}: {added} nodes of a sector face held as images of held nodes of the other one")
    return out


def cyclic_sectors(
    body: PreparedBody, ring: Ring, mask: NDArray, kept: Collection[int] = ()
) -> Callable[[int], CyclicSector]:
    """The sector from matrices as a function of the nodal diameter; modes of those in ``kept`` are kept."""
    made: dict[int, CyclicSector] = {}

    def sector(d: int) -> CyclicSector:
        if d in made:
            return made[d]
        body.step(f"nodal diameter {d}")
        for other in made.values():
            other.forget_factors()
        with body.refusing(f"nodal diameter {d}", "a sector whose fixed components both sector faces can have"):
            out = CyclicSector(body.structure, ring.faces, mask, d)
        if d == 0 or ring.faces.n_sectors == 1:  # elsewhere the frequencies tell
            _check_held(body, out, bool(mask.any()))
        if d in kept:
            made[d] = out
        return out

    return sector


def constrained_from_matrices(
    body: PreparedBody, wanted: Wanted, ring: Ring, sector: Callable[[int], CyclicSector], mask: NDArray,
    stress: Iterable[StressRows] = (),
) -> Body:  # fmt: skip
    """A sector from its matrices at each nodal diameter; ``stress`` collects that of its vectors.

    Raises
    ------
    ModelError
        If the sector is not held, or a matrix is not positive definite.
    """
    free = int((~mask).sum())
    n_modes = min(wanted.n_modes, max(1, (free - 3 * len(ring.faces.dependent)) // 2))

    def seen(made: CyclicSector, omega2: NDArray, shapes: NDArray) -> None:
        d = made.nodal_diameter
        compare_known(body, d, made.modes(n_modes)[0], ring)
        if d in ring.pictured:
            body.keep_pictures(d, made.modes(n_modes)[1])
        for rows in stress:
            rows.add(made, wanted.contact, omega2, shapes)

    expected = "a positive definite stiffness (fixed nodes?) and a positive definite mass matrix"
    with body.refusing("matrices", expected):
        fewer = replace(wanted, n_modes=n_modes)
        built = constrained_body(body.name, fewer, sector, ring.diameters, rotation_of(body), seen)
    for d, basis in built.bases.items():  # a body that is not held has six squared frequencies that are rounding
        low, high = basis.omega2[[0, -1]]
        expected, found = "a sector that is held (fixed nodes)", f"squared frequencies {low:.3g} to {high:.3g} rad2/s2"
        body.require(low > max(1e-10 * high, 0.0), f"nodal diameter {d}", expected, found)
    body.checks.append("stiffness symmetric and positive definite at every nodal diameter, mass symmetric")
    if n_modes < wanted.n_modes:
        body.checks.append(f"{n_modes} modes instead of {wanted.n_modes}: the matrices have too few rows for more")
    return built


def _check_held(body: PreparedBody, sector: CyclicSector, held: bool) -> None:
    """The pivots of the factorisation show a stiffness that is indefinite, or a body that is not held."""
    item = f"stiffness matrix, nodal diameter {sector.nodal_diameter}"
    factor = sector.solver
    pivots = factor.U.diagonal().real
    least = 1e-13 * np.median(np.abs(sector.stiffness.diagonal())) if held else 1e-9 * np.median(np.abs(pivots))
    expected = "a body that is held: fixed=(a set of nodes), or components without rows in the matrices"
    found = f"{'fixed components' if held else 'neither'}, and still some motion costs no force"
    body.require(np.abs(pivots).min() >= least, item, expected, found)
    negative = int((pivots <= 0.0).sum()) if np.array_equal(factor.perm_r, factor.perm_c) else 0
    body.require(not negative, item, "a positive definite matrix", f"{negative} negative eigenvalues")


def free_from_matrices(body: PreparedBody, wanted: Wanted) -> Body:
    """A damper from its matrices, under the centrifugal load of its own mass.

    Raises
    ------
    ModelError
        If the matrices hold the body somewhere, or it has other motions without force than the six rigid ones.
    """
    wrong = body.given.numbers[body.fixed(None).any(axis=1)]
    found = f"some missing at node {', '.join(map(str, wrong[:1]))} and {len(wrong)} such in all"
    body.require(not len(wrong), "matrices", "rows for all three components of every node of a free body", found)
    body.step(body.name)
    structure = body.structure
    check_rigid_motion(body)
    with body.refusing("mass matrix", "a positive definite matrix"):
        free = FreeBody(structure, np.eye(3))
    axes = body.damper_axes(free.centre)
    free = FreeBody(structure, axes)
    wanted = replace(wanted, n_modes=min(wanted.n_modes, max(6, structure.n_dof // 2)))
    with body.refusing("matrices", "a stiffness matrix with six rigid-body motions and no others"):
        built = free_body(body.name, wanted, free, axes[1])
    omega2 = built.bases[0].omega2
    found = f"omega2 = {omega2[6:].min(initial=np.inf):.3g}"
    body.require((omega2[6:] > 0.0).all(), "stiffness matrix", "six rigid-body motions and no others", found)
    body.checks.append(f"{body.name}: six rigid-body motions without force")
    return built
