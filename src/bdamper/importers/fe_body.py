"""Data of one body from another program: nodes, elements, sets, matrices and modes, as numbers in its own units.

The readers fill these classes and :func:`bdamper.importers.build_model` makes a model of them.  Nothing here is converted:
units, axes and phases are converted where the model is built.

Reading files of other programs: one registry of readers, and what they share.

A reader is a function of a path under :func:`reader`, which turns every failure in it into one ModelError that names the
file, what was expected of it and what was found; with endings of names, :func:`read_body` finds it by them.  Checks within
a file go through :func:`bdamper.model.fields.check` or, where there are lines, :meth:`Lines.require`.

One table of the bounds of all checks of an import, with what each is of and what it was measured on.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import wraps
from itertools import groupby, repeat
from pathlib import Path, PureWindowsPath
from typing import Any, Concatenate, ParamSpec, TypeVar

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from bdamper.model.fields import check, check_all
from bdamper.util import validation
from bdamper.util.errors import BdamperError, mismatch
from bdamper.util.formatting import short_repr
from bdamper.util.storage import MOST_BYTES, FilePath

# ---- Data of one body from another program ----


@validation.check_arguments
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


@short_repr
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
        check(self.nodal_diameter >= 0, item, "a nodal diameter >= 0", self.nodal_diameter)
        if self.shapes.shape != (n, 3, m):
            raise mismatch(item, f"shapes ({n}, 3, {m}) for {n} nodes and {m} frequencies", self.shapes.shape)
        check(len(np.unique(self.numbers)) == n, item, "each node once", "a repeated node number")
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


@short_repr
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


@short_repr
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
        check(all(len(shape) == 2 for shape in shapes), f"{self.source}: elements", expected, f"shapes {shapes[:2]}")

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


# ---- Reading files of other programs ----


P = ParamSpec("P")
T = TypeVar("T")

BODIES: dict[str, Callable[[FilePath], Any]] = {}
"""Readers that return an FEBody, by the endings of the names of their files."""

# Exceptions that damaged input causes in parsers and libraries.  Programming errors of this package (AttributeError,
# NameError) pass unchanged; libraries that raise those too are read with ``library=True``.
_CAUSES: tuple[type[Exception], ...] = (OSError, EOFError, MemoryError, RecursionError, ValueError, LookupError, TypeError)
_CAUSES += (ArithmeticError, NotImplementedError, struct.error, zlib.error)

LARGEST_COUNT = MOST_BYTES // 8
"""Nodes, entries and so on beyond which a count in a file is taken for damage."""

MOST_INCLUDED, DEEPEST = 100, 5
"""Files that may be included in one file, in all and in each other."""


def reader(
    expected: str, *endings: str, library: bool = False
) -> Callable[[Callable[Concatenate[Path, P], T]], Callable[Concatenate[FilePath, P], T]]:
    """Decorate a function that reads one kind of file: failures become a ModelError.

    Parameters
    ----------
    expected : str
        What the file should be, for the message.
    endings : str
        If given, the function returns an :class:`bdamper.importers.FEBody` and reads files whose names end so.
    library : bool
        Whether a foreign library reads: then every exception is turned.
    """

    def decorate(function: Callable[Concatenate[Path, P], T]) -> Callable[Concatenate[FilePath, P], T]:
        @wraps(function)
        def read(path: FilePath, *args: P.args, **keywords: P.kwargs) -> T:
            source = Path(path)
            if not source.is_file():
                raise FileNotFoundError(f"there is no file '{source}'")
            try:
                with np.errstate(all="ignore"):  # on this thread; catch_warnings changes all
                    return function(source, *args, **keywords)
            except SystemExit as error:
                raise mismatch(str(source), expected, "the library ended the program") from error
            except Exception as error:
                if isinstance(error, BdamperError) or not (library or isinstance(error, _CAUSES)):
                    raise
                found = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
                raise mismatch(str(source), expected, found) from error

        BODIES.update(dict.fromkeys(endings, read))
        return read  # type: ignore[return-value]  # the path may be given by its name, too

    return decorate


def read_body(path: FilePath) -> Any:
    """A body from a file of any program: its reader follows from the ending of the name.

    Parameters
    ----------
    path : path-like
        ``.inp`` and ``.frd`` of CalculiX or Abaqus, ``.cdb`` and ``.rst`` of Ansys, ``.bdf``, ``.dat`` and ``.nas`` of
        Nastran, ``.unv`` and ``.uff``.

    Returns
    -------
    FEBody
        Nodes and what else the file has: elements, sets, modes.

    Raises
    ------
    FileNotFoundError, ModelError
    """
    ending = Path(path).suffix.lower()
    check(ending in BODIES, str(path), f"a name that ends in one of {sorted(BODIES)}", f"'{ending}'")
    return BODIES[ending](path)


def check_count(value: int, item: str, what: str, smallest: int = 0, largest: int = LARGEST_COUNT) -> int:
    """A count read from a file, if it can be one."""
    check(smallest <= value <= largest, item, f"{what} from {smallest} to {largest}", value)
    return int(value)


@contextmanager
def parsing(item: str, expected: str, found: object = None) -> Iterator[None]:
    """Turn what damaged data or numbers that do not fit raise in the block into the error for a thing.

    It says what was ``found``, a text, or otherwise what was raised.
    """
    try:
        yield
    except BdamperError:
        raise
    except (ValueError, IndexError, RuntimeError, ArithmeticError, np.linalg.LinAlgError, MemoryError) as error:
        raise mismatch(item, expected, error if found is None else f"'{str(found).strip()[:60]}'") from error


def data_lines(text: str, comments: str | tuple[str, ...]) -> list[tuple[int, str]]:
    """Lines of a text, with their numbers, that are neither empty nor comments."""
    lines = [(k, line.strip()) for k, line in enumerate(text.split("\n"), 1)]
    return [(k, line) for k, line in lines if line and not line.startswith(comments)]


class Included:
    """Files that a file includes: a bounded number, from its own folder or below."""

    def __init__(self) -> None:
        self._count = 0

    def path(self, name: str, source: Path, depth: int, item: str) -> Path:
        """Find a file that ``source`` includes.

        Parameters
        ----------
        name : str
        source : Path
        depth : int
            Number of files that include each other down to ``source``.
        item : str
            Name of the line in messages.

        Raises
        ------
        ModelError
        """
        self._count += 1
        limits = f"at most {MOST_INCLUDED} included files, {DEEPEST} in each other"
        check(self._count <= MOST_INCLUDED and depth < DEEPEST, item, limits, "more")
        relative = PureWindowsPath(name)  # takes both kinds of slashes
        below = not relative.anchor and ".." not in relative.parts
        check(below, item, "a file in the folder of this one or below", f"'{name[:60]}'")
        path = source.parent / relative.as_posix()
        check(path.is_file(), item, "an existing file", f"'{name[:60]}'")
        return path


class Lines:
    """The lines of a text file one after another, and errors that name the line that was read last."""

    def __init__(self, source: Path, encoding: str) -> None:
        self.source = source
        self._lines = source.read_text(encoding=encoding, errors="replace").splitlines()
        self._read = 0

    def __iter__(self) -> Iterator[str]:
        """The lines that are left; others may be taken by :meth:`take` in between."""
        while self._read < len(self._lines):
            yield self.take("another line")

    def take(self, what: str) -> str:
        """The next line, which is to hold ``what``."""
        check(self._read < len(self._lines), str(self.source), what, "the end of the file")
        self._read += 1
        return self._lines[self._read - 1]

    def follows(self, *starts: str) -> bool:
        """Whether there is a next line, and it starts with one of these texts."""
        return self._read < len(self._lines) and self._lines[self._read].startswith(starts)

    @property
    def item(self) -> str:
        """How messages name the line that was read last."""
        return f"{self.source}: line {self._read}"

    def require(self, good: object, expected: str, found: object) -> None:
        """Raise the error for the line that was read last unless it is good."""
        check(good, self.item, expected, found)


# ---- One table of the bounds of all checks of an import, with what each is of and what it was m ----


@dataclass(frozen=True)
class Bounds:
    """Bounds of the checks of an import; shares and relative differences where no unit is given."""

    # What no machine has points to mistaken units.
    size: tuple[float, float] = (1e-3, 30.0)
    """Largest extent of a body, m."""
    density: tuple[float, float] = (200.0, 30000.0)
    """Mass over volume, kg/m3."""
    frequency: tuple[float, float] = (0.1, 5e6)
    """Lowest elastic frequency, Hz."""
    wave_speed: tuple[float, float] = (1000.0, 15000.0)
    """Of longitudinal waves in solids of machines, m/s: 2200 in lead and in plastics, 12900 in beryllium."""
    radial_angle: float = 15.0
    """Largest angle (degrees) between ``radial`` and the middle of a narrow sector, for a lean of the blade."""

    # Matrices that belong to their nodes.
    symmetry: float = 1e-6
    """Difference between a matrix and its transpose over its largest entry."""
    rigid_strain: float = 3e-3
    """Strain of a rigid motion: the root of its energy over that of a stretch with the same displacements."""
    rigid_force: float = 0.01
    """Force of a rigid motion on a node, over the sum of the sizes of its parts.  On reference sector and damper at most
    4e-15 in the right order of the rows, 4e-5 with positions rounded to a micrometre; at least 0.1 and at the median 0.4
    to 0.8 in the order of components.  Stress stiffening adds some stress over modulus."""
    odd_ones: float = 0.5
    """Share of the nodes on which there may be such forces (springs to the ground act on few), and of the elements that may
    be twisted (sliver elements of a good mesh are few)."""

    # Two things that should be one.
    same_place: float = 1e-9
    """Distance of nodes at one place over the size of a body."""
    sector_faces: float = 1e-5
    """Distance of matching nodes of the sector faces over the size of the sector: files round positions."""
    tied_faces: float = 1e-4
    """Distance of sector faces whose meshes differ over the size of the sector: one blade of 100 too many is 6e-4."""
    agreement: float = 0.01
    """Difference up to which two programs agree on a frequency, two faces are equal in area, and modes at one speed are
    combinations of those at another."""
    axes: float = 1e-6
    """Product of two directions at right angles, and deviation of their lengths from 1."""

    # Faces that touch.
    overlap: float = 0.05
    """Share of the smaller face that two faces must have in common."""
    distance: float = 0.2
    """Distance of two faces, or gap between them, over the width of what they have in common."""
    misfit: float = 0.02
    """Distance of the meshes of two faces beside the gap that is given, over their width, and lack of overlap of faces that
    are equal in area; more than that draws a warning."""

    # Numbers of things.
    modes: int = 1000
    points: int = 400
    """Contact points on one face; a study with more than some 200 takes minutes."""


BOUNDS = Bounds()
