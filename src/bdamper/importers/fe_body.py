"""Data of one body from another program: nodes, elements, sets, matrices and modes, as numbers in its own units.

The readers fill these classes and :func:`bdamper.importers.build_model` makes a model of them.  Nothing here is converted:
units, axes and phases are converted where the model is built.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import groupby, repeat
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from bdamper.model.fields import check_all, require
from bdamper.util import validation
from bdamper.util.errors import mismatch
from bdamper.util.short_repr import brief


@validation.spelt
@dataclass(frozen=True)
class Units(validation.Checked):
    """Units of a finite element model, as factors to metres and kilograms; time is in seconds.

    Parameters
    ----------
    length : float
        Metres per unit of length.
    mass : float
        Kilograms per unit of mass; the unit of force is mass times length over second squared.
    """

    length: validation.Positive = 1.0
    mass: validation.Positive = 1.0


UNITS = {
    "m-kg-s": Units(1.0, 1.0),
    "mm-t-s": Units(1e-3, 1e3),
    "mm-kg-s": Units(1e-3, 1.0),
    "in-lbf-s": Units(0.0254, 175.12683524647638),
}
"""Systems of units by name; "mm-t-s" is that of N and MPa."""


@brief
@dataclass(frozen=True)
class Modes:
    """Modes of one body at one nodal diameter, as a file has them.

    Parameters
    ----------
    nodal_diameter : int
    frequency : (n_modes,) float, Hz
    numbers : (n_nodes,) int
        Node numbers of the rows of ``shapes``.
    shapes : (n_nodes, 3, n_modes) float or complex
        Travelling waves (complex) or standing ones (real), of any direction, pairing and length.
    modal_mass : (n_modes,) float, optional
        Of each mode over one sector, in the file's unit of mass, as the file or the user states it; for standing waves,
        that of ``a + i b`` for a pair ``a, b``.  Not needed where a mass matrix is at hand.
    source : str
    """

    nodal_diameter: int
    frequency: NDArray
    numbers: NDArray
    shapes: NDArray
    modal_mass: NDArray | None = None
    source: str = ""

    def __post_init__(self) -> None:
        item = f"{self.source or 'modes'}, nodal diameter {self.nodal_diameter}"
        n, m = len(self.numbers), len(self.frequency)
        require(self.nodal_diameter >= 0, item, "a nodal diameter >= 0", self.nodal_diameter)
        if self.shapes.shape != (n, 3, m):
            raise mismatch(item, f"shapes ({n}, 3, {m}) for {n} nodes and {m} frequencies", self.shapes.shape)
        require(len(np.unique(self.numbers)) == n, item, "each node once", "a repeated node number")
        for values in (self.frequency, self.shapes):
            check_all(np.isfinite(values), values, "finite frequencies and shapes", item)
        if self.modal_mass is not None:
            mass = np.asarray(self.modal_mass)
            if mass.shape != (m,) or not (np.isfinite(mass).all() and np.all(mass > 0)):
                raise mismatch(item, f"{m} modal masses > 0", self.modal_mass)


def modes_by_diameter(given: Iterable[tuple[int, float, float, NDArray, NDArray]], source: str) -> tuple[Modes, ...]:
    """Modes that a file lists one by one, sorted by nodal diameter and frequency.

    Parameters
    ----------
    given : iterable of (nodal diameter, frequency in Hz, modal mass or 0, node numbers (n,), shape (n, 3))
    source : str

    Raises
    ------
    ModelError
        If modes of one nodal diameter are not given at the same nodes.
    """
    out = []
    for d, group in groupby(sorted(given, key=lambda mode: mode[:2]), key=lambda mode: mode[0]):
        _, frequency, mass, nodes, shapes = zip(*group)
        if others := [other for other in nodes if not np.array_equal(nodes[0], other)]:
            raise mismatch(f"{source}: modes of nodal diameter {d}", f"the nodes {nodes[0]} in every mode", others[0])
        masses = np.array(mass) if min(mass) > 0.0 else None
        out.append(Modes(d, np.array(frequency), nodes[0], np.stack(shapes, axis=2), masses, source))
    return tuple(out)


@brief
@dataclass(frozen=True)
class MassProperties:
    """Mass, centre and inertia of a rigid body, for a free body without a mass matrix.

    Parameters
    ----------
    mass : float
    centre : (3,) float
    inertia : (3, 3) float
        About the centre.
    """

    mass: float
    centre: NDArray
    inertia: NDArray


@dataclass(frozen=True)
class ElementKind:
    """Type and isotropic material of solid elements, for their stress.

    Parameters
    ----------
    name : str
        As CalculiX and Abaqus call the type, "C3D20R"; plain ones need none.
    youngs_modulus, poisson_ratio : float, optional
        In the units of the file.
    """

    name: str
    youngs_modulus: float | None = None
    poisson_ratio: float | None = None


def by_kind(
    elements: Iterable[Sequence[int] | NDArray], kinds: Iterable[ElementKind | None] = repeat(None)
) -> dict[str, Any]:
    """``elements`` and, where they are known, ``element_kinds`` of an :class:`FEBody` from elements one by one."""
    groups: dict[tuple[ElementKind | None, int], list[Sequence[int] | NDArray]] = {}
    for nodes, kind in zip(elements, kinds):
        groups.setdefault((kind, len(nodes)), []).append(nodes)
    arrays = tuple(np.array(group, np.int64) for group in groups.values())
    return {"elements": arrays, "element_kinds": tuple(kind for kind, _ in groups if kind is not None)}


@brief
@dataclass(frozen=True)
class FEBody:
    """A body of a finite element model, in the units, axes and numbers of the program that made it.

    Parameters
    ----------
    numbers : (n_nodes,) int
        Node numbers.
    nodes : (n_nodes, 3) float
        Positions.
    stiffness, mass : (n_eq, n_eq) sparse or None
        None if only modes are known.
    dofs : (n_eq, 2) int or None
        Node number and component (1, 2, 3) of each row of the matrices; None for three rows a node in the order of
        ``numbers``.  Components without a row count as fixed.
    elements : tuple of (n, 4 | 6 | 8 | 10 | 15 | 20) int arrays
        Node numbers of solid elements; needed where faces are given as sets of nodes.  Corners first: of hexahedra four in
        turn around one face, then the four opposite ones in the same turn.
    element_kinds : tuple of ElementKind
        Of each array of ``elements``; none counts as full integration and unknown material.
    node_sets : mapping of name to (n,) int
        Node numbers.
    face_sets : mapping of name to tuple of (n, 3 | 4 | 6 | 8) int arrays
        Node numbers of faces of elements, seen from outside counter-clockwise, corners first.
    node_axes : mapping of node number to (3, 3) float
        Rows: the axes of displacements at nodes with axes of their own.
    modes : tuple of Modes
        Compared with those of the matrices, or used in their place if there are none.
    rigid : MassProperties, optional
    source : str
        File or program, for messages and the report.
    notes : tuple of str
        Parts that a reader left out or changed.
    rotor_speed : float, rad/s
        Of the stiffness or the modes.
    faster : FEBody, optional
        The same body at a higher rotor speed, as :func:`bdamper.importers.over_speed` puts them together.
    """

    numbers: NDArray
    nodes: NDArray
    stiffness: sp.spmatrix | None = None
    mass: sp.spmatrix | None = None
    dofs: NDArray | None = None
    elements: tuple[NDArray, ...] = ()
    node_sets: Mapping[str, NDArray] = field(default_factory=dict)
    face_sets: Mapping[str, tuple[NDArray, ...]] = field(default_factory=dict)
    node_axes: Mapping[int, NDArray] = field(default_factory=dict)
    modes: tuple[Modes, ...] = ()
    rigid: MassProperties | None = None
    source: str = "the given arrays"
    notes: tuple[str, ...] = ()
    rotor_speed: float = 0.0
    faster: FEBody | None = None
    element_kinds: tuple[ElementKind, ...] = ()

    def __post_init__(self) -> None:
        shapes = [np.shape(e) for e in self.elements]
        expected = "arrays (n, nodes of an element) in a tuple"
        require(all(len(shape) == 2 for shape in shapes), f"{self.source}: elements", expected, f"shapes {shapes[:2]}")

    def __str__(self) -> str:
        n_elements = sum(len(e) for e in self.elements)
        lines = [f"{self.source}: {len(self.nodes)} nodes, {n_elements} solid elements"]
        if self.stiffness is not None:
            lines.append(f"  {self.stiffness.shape[0]} equations, {self.stiffness.nnz} entries in the stiffness matrix")
        lines += [f"  {len(m.frequency)} modes of nodal diameter {m.nodal_diameter}" for m in self.modes]
        if self.node_sets:
            lines.append("  node sets " + ", ".join(f"{k} ({len(v)})" for k, v in self.node_sets.items()))
        if self.face_sets:
            lines.append("  face sets " + ", ".join(f"{k} ({sum(map(len, v))})" for k, v in self.face_sets.items()))
        if self.faster:
            lines.append(f"  at {self.faster.rotor_speed:g} rad/s: {self.faster.source}")
        return "\n".join([*lines, *(f"  {note}" for note in self.notes)])
