"""Bodies of an imported model from stiffness and mass matrices, with the checks that only the reduction can make."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from bdamper.io.from_modes import compare_known
from bdamper.io.over_speed import rotation_of
from bdamper.io.plausible import check_rigid_motion
from bdamper.io.prepare import NodeSet, PreparedBody, Ring
from bdamper.model.model import Body
from bdamper.reduction.bodies import Wanted, constrained_body, free_body, nodes_of
from bdamper.reduction.cyclic import CyclicSector
from bdamper.reduction.free_body import FreeBody

if TYPE_CHECKING:
    from bdamper.reduction.stress import StressRows

POSITIVE = "a positive definite stiffness (fixed nodes?) and a positive definite mass matrix"


def held_components(body: PreparedBody, wanted: Wanted, fixed: NodeSet | None, ring: Ring) -> NDArray:
    """Mask (n_nodes, 3) of the components that are held, those at images of held nodes on the other sector face included.

    Other programs want only one face held: their tie of the faces holds the other.

    Raises
    ------
    ModelError
        If a contact face or location has no rows in the matrices.
    """
    held = None if fixed is None else body.node_set(fixed, "fixed")
    _check_reached(body, wanted, held)
    mask = body.fixed(held)
    out = np.stack([ring.faces.images(component) for component in mask.T], axis=1)
    if added := int((out & ~mask).any(axis=1).sum()):
        body.checks.append(f"{body.name}: {added} nodes of a sector face held as images of held nodes of the other one")
    return out


def cyclic_sectors(
    body: PreparedBody, ring: Ring, mask: NDArray, kept: Collection[int] = ()
) -> Callable[[int], CyclicSector]:
    """The sector from matrices as a function of the nodal diameter; modes of those in ``kept`` are kept.

    Raises
    ------
    ModelError
        If hardly anything of the sector can move.
    """
    free = int((~mask).sum())
    body.require(free >= 12, "matrices", "more than a dozen free components", free)
    made: dict[int, CyclicSector] = {}

    def sector(d: int) -> CyclicSector:
        if d in made:
            return made[d]
        body.step(f"nodal diameter {d}")
        for other in made.values():
            other.forget_factors()
        with body.refusing(f"nodal diameter {d}", "a sector whose fixed components both sector faces can have"):
            out = CyclicSector(body.structure, ring.faces, mask, d)
        if d == 0 or ring.n_blades == 1:  # the pivots take as long as a factorisation; elsewhere the frequencies tell
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
    fewer, compared = replace(wanted, n_modes=n_modes), set[int]()
    known = {*body.expected, *(modes.nodal_diameter for modes in body.given.modes)}
    known_first = sorted(ring.diameters, key=lambda d: d not in known)

    def checked(d: int) -> CyclicSector:
        made = sector(d)
        if d not in compared:
            compared.add(d)
            compare_known(body, d, made.modes(n_modes)[0], ring)
        if d in ring.pictured:
            body.keep_pictures(d, made.modes(n_modes)[1])
        for rows in stress:
            rows.add(made, wanted.contact, *fewer.shapes(made)[:2])
        return made

    with body.refusing("matrices", POSITIVE):
        built = constrained_body(body.name, fewer, checked, known_first, ring.diameters, rotation_of(body))
    built = replace(built, bases=dict(sorted(built.bases.items())))
    for d, basis in built.bases.items():
        _check_positive(body, d, basis.omega2)
    body.checks.append("stiffness symmetric and positive definite at every nodal diameter, mass symmetric")
    if n_modes < wanted.n_modes:
        body.checks.append(f"{n_modes} modes instead of {wanted.n_modes}: the matrices have too few rows for more")
    return built


def _check_reached(body: PreparedBody, wanted: Wanted, held: NDArray | None) -> None:
    """Contact faces and locations have rows in the matrices, or are held by name."""
    empty = np.setdiff1d(np.flatnonzero(body.fixed(None).all(axis=1)), [] if held is None else held)
    wrong = np.intersect1d(np.unique(wanted.contact.indices // 3), empty)
    if len(wrong):
        found = f"node {body.given.numbers[wrong[0]]} and {len(wrong)} such in all without any"
        raise body.error("contact faces", "nodes with rows in the matrices", found)
    for name, place in wanted.locations.items():
        for node in np.intersect1d(nodes_of(place), empty)[:1]:
            raise body.error(f"location '{name}'", "a node with rows in the matrices", f"node {body.given.numbers[node]}")


def _check_held(body: PreparedBody, sector: CyclicSector, held: bool) -> None:
    """The pivots of the factorisation show a stiffness that is indefinite, or a body that is not held."""
    item = f"stiffness matrix, nodal diameter {sector.nodal_diameter}"
    factor = sector.solver
    pivots = factor.U.diagonal().real
    smallest = np.abs(pivots).min()
    expected = "a body that is held: fixed=(a set of nodes), or components without rows in the matrices"
    found = "neither, and some motion costs no force: nothing holds the sector"
    body.require(held or smallest >= 1e-9 * np.median(np.abs(pivots)), item, expected, found)
    if np.array_equal(factor.perm_r, factor.perm_c) and np.any(pivots <= 0.0):
        raise body.error(item, "a positive definite matrix", f"{int((pivots <= 0.0).sum())} negative eigenvalues")
    scale = np.median(np.abs(sector.stiffness.diagonal()))
    found = f"a pivot {smallest / scale:.2g} times the stiffness of a node: some motion costs no force"
    expected = "a body that is held (fixed nodes, or rows left out of the matrices)"
    body.require(smallest >= 1e-13 * scale, item, expected, found)


def _check_positive(body: PreparedBody, d: int, omega2: NDArray) -> None:
    item = f"nodal diameter {d}"
    body.require(np.isfinite(omega2).all() and omega2[0] > 0.0, item, "squared frequencies > 0", f"{omega2[0]:.6g}")
    # A body that is not held has six squared frequencies that are rounding.
    if len(omega2) > 1 and omega2[0] < 1e-10 * omega2[-1]:
        low, high = np.sqrt(omega2[[0, -1]]) / (2 * np.pi)
        raise body.error(item, "a sector that is held (fixed nodes)", f"a frequency of {low:.3g} Hz beside {high:.3g} Hz")


def free_from_matrices(body: PreparedBody, wanted: Wanted) -> Body:
    """A damper from its matrices, under the centrifugal load of its own mass.

    Raises
    ------
    ModelError
        If the matrices hold the body somewhere, or it has other motions without force than the six rigid ones.
    """
    mask = body.fixed(None)
    if mask.any():
        wrong = body.used[mask[body.used].any(axis=1)]
        body.require(len(wrong) > 0, "matrices", "no nodes without rows on a free body", int(mask.any(axis=1).sum()))
        found = f"some missing at node {body.given.numbers[wrong[0]]} and {len(wrong)} such in all"
        raise body.error("matrices", "rows for all three components of every node of a free body", found)
    body.step(body.name)
    structure = body.structure
    check_rigid_motion(body, structure)
    with body.refusing("mass matrix", "a positive definite matrix"):
        free = FreeBody(structure, np.eye(3))
    axes = body.damper_axes(free.centre)
    free = FreeBody(structure, axes)
    wanted = replace(wanted, n_modes=min(wanted.n_modes, max(6, structure.n_dof // 2)))
    with body.refusing("matrices", "a stiffness matrix with six rigid-body motions and no others"):
        built = free_body(body.name, wanted, free, axes[1])
    omega2 = built.bases[0].omega2
    if len(omega2) > 6 and not omega2[6] > 0.0:
        raise body.error("stiffness matrix", "six rigid-body motions and no others", f"omega2 = {omega2[6]:.3g}")
    moments = f"principal moments {', '.join(f'{m:.4g}' for m in np.linalg.eigvalsh(free.inertia))} kg m2"
    body.checks.append(f"{body.name}: six rigid-body motions without force; mass {free.total_mass:.6g} kg, {moments}")
    return built
