"""Bodies of an imported model from stiffness and mass matrices, with the checks that only the reduction can make."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from bdamper.io.from_modes import compare_known
from bdamper.io.over_speed import rotation_of
from bdamper.io.plausible import check_rigid_motion
from bdamper.io.prepare import NodeSet, PreparedBody, Ring
from bdamper.model.model import Body
from bdamper.reduction.bodies import Wanted, constrained_body, free_body
from bdamper.reduction.cyclic import CyclicSector
from bdamper.reduction.free_body import FreeBody

if TYPE_CHECKING:
    from bdamper.reduction.stress import StressRows

POSITIVE = "a positive definite stiffness (fixed nodes?) and a positive definite mass matrix"


@dataclass
class Sectors:
    """The sector at each nodal diameter from matrices; calling it gives one, checked.

    Parameters
    ----------
    body : PreparedBody
    wanted : Wanted
    ring : Ring
    fixed : NodeSet, optional
        Clamped nodes.
    kept : collection of int
        Nodal diameters that are asked for more than once: their modes are kept.

    Raises
    ------
    ModelError
        If the sector is not held, or a contact face or location has no rows in the matrices.
    """

    body: PreparedBody
    wanted: Wanted
    ring: Ring
    fixed: NodeSet | None
    kept: Collection[int] = ()

    def __post_init__(self) -> None:
        held = None if self.fixed is None else self.body.node_set(self.fixed, "fixed")
        self.mask = self.body.fixed(held)
        _check_reached(self.body, self.wanted, self.mask, held)
        free = int((~self.mask).sum())
        self.body.require(free >= 12, "matrices", "more than a dozen free components", free)
        self.n_modes = min(self.wanted.n_modes, max(1, (free - 3 * len(self.ring.right)) // 2))
        self._made: dict[int, CyclicSector] = {}

    def __call__(self, d: int) -> CyclicSector:
        """The sector at a nodal diameter."""
        if d in self._made:
            return self._made[d]
        body, ring = self.body, self.ring
        body.step(f"nodal diameter {d}")
        with body.refusing(f"nodal diameter {d}", "fixed nodes alike on both sector faces"):
            made = CyclicSector(body.structure, ring.left, ring.right, self.mask, ring.n_blades, d)
        if d == 0 or ring.n_blades == 1:  # the pivots take as long as a factorisation; elsewhere the frequencies tell
            _check_held(body, made, bool(self.mask.any()))
        if d in self.kept:
            self._made[d] = made
        return made


def constrained_from_matrices(sectors: Sectors, stress: Iterable[StressRows] = ()) -> Body:
    """A sector from its matrices at each nodal diameter; ``stress`` collects that of its vectors.

    Raises
    ------
    ModelError
        If the sector is not held, or a matrix is not positive definite.
    """
    body, wanted, ring, n_modes = sectors.body, sectors.wanted, sectors.ring, sectors.n_modes
    rotation = rotation_of(body)
    if rotation is not None:
        sectors.kept = {0, *sectors.kept}  # for the displacement by rotation
    compared: set[int] = set()
    known = {*body.expected, *(modes.nodal_diameter for modes in body.given.modes)}
    known_first = sorted(ring.diameters, key=lambda d: d not in known)

    def sector(d: int) -> CyclicSector:
        made = sectors(d)
        if d not in compared:
            compared.add(d)
            compare_known(body, d, made.modes(n_modes)[0], ring)
        if d in ring.pictured:
            body.keep_pictures(d, made.modes(n_modes)[1])
        for rows in stress:
            rows.add(made, wanted.contact, n_modes)
        return made

    with body.refusing("matrices", POSITIVE):
        fewer = replace(wanted, n_modes=n_modes)
        built = constrained_body(body.name, fewer, sector, known_first, ring.diameters, rotation)
    for d in sectors.kept:
        if d in ring.diameters:
            sectors(d).forget_factors()
    built = replace(built, bases=dict(sorted(built.bases.items())))
    for d, basis in built.bases.items():
        _check_positive(body, d, basis.omega2)
    body.checks.append("stiffness symmetric and positive definite at every nodal diameter, mass symmetric")
    if n_modes < wanted.n_modes:
        body.checks.append(f"{n_modes} modes instead of {wanted.n_modes}: the matrices have too few rows for more")
    return built


def _check_reached(body: PreparedBody, wanted: Wanted, mask: NDArray, held: NDArray | None) -> None:
    """Contact faces and locations have rows in the matrices."""
    empty = np.flatnonzero(mask.all(axis=1))
    if held is not None:
        empty = np.setdiff1d(empty, held)
    wrong = np.intersect1d(np.unique(wanted.contact.indices // 3), empty)
    if len(wrong):
        found = f"node {body.given.numbers[wrong[0]]} and {len(wrong)} such in all without any"
        raise body.error("contact faces", "nodes with rows in the matrices", found)
    for name, node in wanted.locations.items():
        if node in empty:
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
    moments = ", ".join(f"{m:.4g}" for m in np.linalg.eigvalsh(free.inertia))
    body.checks.append(
        f"damper: six rigid-body motions without force; mass {free.total_mass:.6g} kg, principal moments {moments} kg m2"
    )
    return built
