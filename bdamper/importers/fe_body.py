"""Data of one body of a finite element model, and the parts that the readers of files share.

The readers fill :class:`FEBody` with numbers in the units, axes and node numbers of the file.
:func:`bdamper.importers.build_model` converts them and makes a model.

Each reader is a function of a path decorated by :func:`reader`.  The decorator turns a failure into
one ModelError with the file, its expected content and the content found.  :func:`read_body` selects
a reader by the extension of the file name.

:data:`BOUNDS` contains the limits of all plausibility checks of an import.
"""

from __future__ import annotations

import re
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
from numpy.typing import ArrayLike, NDArray

from bdamper.util import quantities, validation
from bdamper.util.display import Summarised
from bdamper.util.errors import BdamperError, ModelError, check, mismatch, too_little_memory
from bdamper.util.formatting import counted, short_repr
from bdamper.util.records import check_all
from bdamper.util.statement import Row, Statement
from bdamper.util.storage import MOST_BYTES, FilePath, as_path, existing

# ---- Data of one body ----


@validation.check_arguments
@dataclass(frozen=True)
class Units(validation.Checked):
    """Units of a finite element model, as factors to metres and kilograms.

    The unit of time is the second.

    Parameters
    ----------
    length : float
        Metres per unit of length.
    mass : float
        Kilograms per unit of mass.  The unit of force is the unit of mass times the unit of length
        over second squared.
    """

    length: validation.Positive = 1.0
    mass: validation.Positive = 1.0


UNITS = {
    "m-kg-s": Units(1.0, 1.0),
    "mm-t-s": Units(1e-3, 1e3),
    "mm-kg-s": Units(1e-3, 1.0),
    "in-lbf-s": Units(0.0254, 175.12683524647638),
}
"""Systems of units by name.  The units N and MPa belong to "mm-t-s"."""


@short_repr
@dataclass(frozen=True)
class Modes:
    """Modes of one body at one nodal diameter, in the units and axes of the file.

    Parameters
    ----------
    nodal_diameter : int
    frequency : (n_modes,) float
        Natural frequencies, Hz.
    numbers : (n_nodes,) int
        Node number of each row of ``shapes``.
    shapes : (n_nodes, 3, n_modes) float or complex
        Complex travelling waves or real standing waves.  Direction, pairing and scale are
        arbitrary.
    modal_mass : (n_modes,) float, optional
        Modal mass of each mode over one sector.  For a pair of standing waves a and b it is the
        modal mass of ``a + i b``.  It is not needed if the body has a mass matrix.
    source : str
        File or program, for messages.

    Raises
    ------
    ModelError
        If shapes do not match, values are not finite, a node number is repeated, or a modal mass is
        not positive.
    """

    nodal_diameter: int
    frequency: NDArray
    numbers: NDArray
    shapes: NDArray
    modal_mass: NDArray | None = None
    source: str = ""

    def __post_init__(self) -> None:
        item = f"{self.source or 'modes'}, nodal diameter {self.nodal_diameter}"
        validation.check_attributes(self, quantities.in_lists, "frequency", unit="Hz")
        n_nodes = len(self.numbers)
        n_modes = len(self.frequency)
        check(self.nodal_diameter >= 0, item, "a nodal diameter >= 0", self.nodal_diameter)
        if self.shapes.shape != (n_nodes, 3, n_modes):
            expected = (
                f"shapes ({n_nodes}, 3, {n_modes}) for {n_nodes} nodes and {n_modes} frequencies"
            )
            raise mismatch(item, expected, self.shapes.shape)
        n_distinct = len(np.unique(self.numbers))
        check(n_distinct == n_nodes, item, "each node once", "a repeated node number")
        for values in (self.frequency, self.shapes):
            check_all(np.isfinite(values), values, "finite frequencies and shapes", item)
        if self.modal_mass is None:
            return
        mass = np.asarray(self.modal_mass)
        if mass.shape != (n_modes,) or not (np.isfinite(mass).all() and np.all(mass > 0)):
            raise mismatch(item, f"{n_modes} modal masses > 0", self.modal_mass)


def modes_by_diameter(
    listed: Iterable[tuple[int, float, float, NDArray, NDArray]], source: str
) -> tuple[Modes, ...]:
    """Group single modes by nodal diameter, sorted by frequency.

    Parameters
    ----------
    listed : iterable of tuple
        Nodal diameter, frequency in Hz, modal mass or 0 if unknown, node numbers (n,) and shape
        (n, 3) of each mode.
    source : str
        File, for messages.

    Returns
    -------
    tuple of Modes
        One for each nodal diameter.

    Raises
    ------
    ModelError
        If modes of one nodal diameter have different nodes.
    """
    # by nodal diameter and frequency only; the other parts cannot be compared
    ascending = sorted(listed, key=lambda mode: mode[:2])
    grouped = []
    for d, group in groupby(ascending, key=lambda mode: mode[0]):
        _, frequency, mass, numbers, shapes = zip(*group)
        for other in numbers:
            if not np.array_equal(numbers[0], other):
                item = f"{source}: modes of nodal diameter {d}"
                raise mismatch(item, f"the nodes {numbers[0]} in every mode", other)
        modal_mass = np.array(mass) if min(mass) > 0.0 else None
        stacked = np.stack(shapes, axis=2)
        grouped.append(Modes(d, np.array(frequency), numbers[0], stacked, modal_mass, source))
    return tuple(grouped)


@short_repr
@dataclass(frozen=True)
class MassProperties:
    """Mass, centre of mass and inertia of a rigid free body without a mass matrix, in the units and
    axes of the file.

    Parameters
    ----------
    mass : float
    centre : (3,) float
        Centre of mass.
    inertia : (3, 3) float
        Inertia tensor about the centre of mass.
    """

    mass: float
    centre: NDArray
    inertia: NDArray

    def __post_init__(self) -> None:
        # the units of the file are not known here
        fields = ("mass", "centre", "inertia")
        validation.check_attributes(self, quantities.in_lists, *fields, unit="")


@dataclass(frozen=True)
class ElementKind:
    """Type and isotropic material of solid elements, from which stress is recovered.

    Parameters
    ----------
    name : str
        Type in the notation of CalculiX and Abaqus, such as "C3D20R".
    youngs_modulus, poisson_ratio, density : float, optional
        Constants of the material in the units of the file.
    """

    name: str
    youngs_modulus: float | None = None
    poisson_ratio: float | None = None
    density: float | None = None


def by_kind(
    elements: Iterable[Sequence[int] | NDArray], kinds: Iterable[ElementKind | None] = repeat(None)
) -> dict[str, Any]:
    """Group single elements into the arguments ``elements`` and ``element_kinds`` of
    :class:`FEBody`.

    Parameters
    ----------
    elements : iterable of (n,) int
        Node numbers of each element.
    kinds : iterable of ElementKind or None
        Kind of each element.
    """
    groups: dict[tuple[ElementKind | None, int], list[Sequence[int] | NDArray]] = {}
    for nodes, kind in zip(elements, kinds):
        groups.setdefault((kind, len(nodes)), []).append(nodes)
    return {
        "elements": tuple(np.array(group, np.int64) for group in groups.values()),
        "element_kinds": tuple(kind for kind, _ in groups if kind is not None),
    }


@short_repr
@dataclass(frozen=True)
class FEBody(Summarised):
    """Body of a finite element model, in the units, axes and node numbers of its file.

    Parameters
    ----------
    numbers : (n_nodes,) int
        Node numbers.
    nodes : (n_nodes, 3) float
        Positions.
    stiffness, mass : (n_eq, n_eq) sparse, optional
        Matrices with both triangles.  They can be omitted if ``modes`` are given.
    dofs : (n_eq, 2) int, optional
        Node number and component (1, 2, 3) of each equation.  By default each node of ``numbers``
        has three equations in turn.  Components without an equation are fixed.
    elements : tuple of (n, 4 | 6 | 8 | 10 | 15 | 20) int arrays
        Node numbers of solid elements, corners first.  The corners of hexahedra are four in turn
        around one face, then the opposite four in the same turn.  Elements are needed if faces are
        given as sets of nodes.
    node_sets : mapping of name to (n,) int
        Node numbers.
    face_sets : mapping of name to tuple of (n, 3 | 4 | 6 | 8) int arrays
        Node numbers of element faces, corners first, counter-clockwise as seen from outside.
    node_axes : mapping of node number to (3, 3) float
        Axes of the displacements of single nodes, as rows.
    modes : tuple of Modes
        Modes to compare with the modes of the matrices, or to use if there are no matrices.
    rigid : MassProperties, optional
        Mass properties of a free body without matrices.
    source : str
        File or program, for messages and the report.
    notes : tuple of str
        Parts of the file that a reader omitted or changed.
    rotor_speed : float, rad/s
        Rotor speed of the stiffness or the modes.
    faster : FEBody, optional
        Same body at a higher rotor speed, see :func:`bdamper.importers.over_speed`.
    between : FEBody, optional
        Same body at a speed between both, whose frequencies are compared.
    element_kinds : tuple of ElementKind
        Kind of each array of ``elements``.  By default elements have full integration and an
        unknown material.

    Raises
    ------
    ModelError
        If ``elements`` is not a tuple of two-dimensional arrays.
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
    between: FEBody | None = None
    element_kinds: tuple[ElementKind, ...] = ()

    def __post_init__(self) -> None:
        validation.check_attributes(self, quantities.in_lists, "rotor_speed", unit="rad/s")
        shapes = [np.shape(elements) for elements in self.elements]
        check(
            all(len(shape) == 2 for shape in shapes),
            f"{self.source}: elements",
            "arrays (n, nodes of an element) in a tuple",
            f"shapes {shapes[:2]}",
        )

    _states_all = True

    def _statement(self) -> Statement:
        return Statement([self.source], self._size_rows(), remarks=self.notes)

    @property
    def source_text(self) -> str:
        """Source, sizes and notes of the body, a line for each."""
        sizes = [
            f"{row.name.lower()}: {', '.join(text for text in row[1:] if text)}"
            for row in self._size_rows()
        ]
        return "\n".join([self.source, *sizes, *self.notes])

    def _size_rows(self) -> list[Row]:
        """Return the numbers of nodes, elements and equations, and the sizes of the sets."""
        n_elements = sum(len(elements) for elements in self.elements)
        rows = [Row("Nodes", str(len(self.nodes)), counted(n_elements, "solid element"))]
        if self.stiffness is not None:
            entries = f"{self.stiffness.nnz} entries in the stiffness matrix"
            rows.append(Row("Equations", str(self.stiffness.shape[0]), entries))
        for modes in self.modes:
            diameter = f"nodal diameter {modes.nodal_diameter}"
            rows.append(Row("Modes", str(len(modes.frequency)), diameter))
        if self.node_sets:
            members = [f"{name} ({len(nodes)})" for name, nodes in self.node_sets.items()]
            rows.append(Row("Node sets", str(len(members)), ", ".join(members)))
        if self.face_sets:
            members = [f"{name} ({sum(map(len, faces))})" for name, faces in self.face_sets.items()]
            rows.append(Row("Face sets", str(len(members)), ", ".join(members)))
        if self.faster:
            speed = f"{self.faster.rotor_speed:g} rad/s"
            rows.append(Row("Second speed", speed, self.faster.source))
        if self.between:
            speed = f"{self.between.rotor_speed:g} rad/s"
            rows.append(Row("Compared speed", speed, self.between.source))
        return rows


# ---- Shared parts of the readers ----


def mesh_body(
    source: str,
    what: str,
    numbers: ArrayLike,
    nodes: ArrayLike,
    elements: Iterable[Sequence[int] | NDArray],
    kinds: Iterable[ElementKind | None] = repeat(None),
    **others: Any,
) -> FEBody:
    """Return the body of a mesh from the lists of a reader.

    Parameters
    ----------
    source : str
        File.
    what : str
        Part of the file with the nodes, for the message if there are none.
    numbers, nodes : (n_nodes,) int, (n_nodes, 3) float
    elements, kinds
        See :func:`by_kind`.
    **others
        Further arguments of :class:`FEBody`.
    """
    numbers, nodes = np.array(numbers, np.int64), np.array(nodes, float)
    check(len(numbers) > 0, source, what, "none")
    check_all(np.isfinite(nodes), nodes, "finite positions", f"{source}: nodes")
    return FEBody(numbers, nodes, **by_kind(elements, kinds), source=source, **others)


def rotate_to_file(shapes: NDArray, numbers: NDArray, axes: Mapping[int, NDArray]) -> None:
    """Rotate shapes of nodes from the axes of single nodes to the axes of the file, in place.

    Parameters
    ----------
    shapes : (n, 3, ...)
    numbers : (n,) int
        Node number of each row of ``shapes``.
    axes : mapping of node number to (3, 3) float
        Axes of the nodes that have their own, as rows.
    """
    for row, number in enumerate(numbers.tolist()):
        if number in axes:
            shapes[row] = np.asarray(axes[number]).T @ shapes[row]


P = ParamSpec("P")
T = TypeVar("T")

BODIES: dict[str, Callable[[FilePath], Any]] = {}
"""Readers that return an FEBody, by the extension of the file name."""

# Exceptions that damaged input causes in parsers.  AttributeError and NameError are errors of this
# package and pass unchanged, except from other packages (``library=True``).
_CAUSES: tuple[type[Exception], ...] = (
    OSError,
    EOFError,
    RecursionError,
    ValueError,
    LookupError,
    TypeError,
)
_CAUSES += (ArithmeticError, NotImplementedError, struct.error, zlib.error)

LARGEST_COUNT = MOST_BYTES // 8
"""Largest plausible count of nodes, entries and so on; a larger one indicates a damaged file."""

MOST_INCLUDED, DEEPEST = 100, 5
"""Largest number of included files, and of nested inclusions."""


def reader(
    expected: str, *endings: str, library: bool = False
) -> Callable[[Callable[Concatenate[Path, P], T]], Callable[Concatenate[FilePath, P], T]]:
    """Decorate a function that reads a file, so that a failure becomes one ModelError.

    Parameters
    ----------
    expected : str
        Expected content of the file, for the message.
    endings : str
        Endings of file names for which :func:`read_body` calls the function.  It must return an
        FEBody.
    library : bool
        Whether another package parses the file.  Then every exception becomes a ModelError.

    Raises
    ------
    FileNotFoundError
        From the decorated function, if there is no such file.
    """

    def decorate(
        function: Callable[Concatenate[Path, P], T],
    ) -> Callable[Concatenate[FilePath, P], T]:
        @wraps(function)
        def read(path: FilePath, *args: P.args, **keywords: P.kwargs) -> T:
            source = as_path(path)
            if not existing(source, ModelError).is_file():
                raise FileNotFoundError(f"there is no file '{source}'")
            try:
                with np.errstate(all="ignore"):  # acts on this thread only, unlike catch_warnings
                    return function(source, *args, **keywords)
            except SystemExit as error:
                raise mismatch(str(source), expected, "the library ended the program") from error
            except MemoryError as error:
                if isinstance(error, BdamperError):
                    raise
                raise too_little_memory(f"{source}, {expected}", error) from error
            except Exception as error:
                if isinstance(error, BdamperError) or not (library or isinstance(error, _CAUSES)):
                    raise
                found = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
                raise mismatch(str(source), expected, found) from error

        read = validation.check_arguments(read)
        BODIES.update(dict.fromkeys(endings, read))
        return read  # type: ignore[return-value]  # the path may be given by its name, too

    return decorate


def read_body(path: FilePath) -> Any:
    """Read a body from a file of any program, whose type follows from its extension.

    Parameters
    ----------
    path : path-like
        ``.inp`` or ``.frd`` of CalculiX or Abaqus, ``.cdb`` or ``.rst`` of Ansys, ``.bdf``,
        ``.dat`` or ``.nas`` of Nastran.

    Returns
    -------
    FEBody
        Nodes and, if the file has them, elements, sets and modes.

    Raises
    ------
    FileNotFoundError, ModelError
        If the file does not exist, its extension is unknown, or its content is damaged.
    """
    ending = as_path(path).suffix.lower()
    expected = f"a file name with one of the extensions {sorted(BODIES)}"
    check(ending in BODIES, str(path), expected, f"'{ending}'")
    return BODIES[ending](path)


def check_count(
    value: int, item: str, what: str, smallest: int = 0, largest: int = LARGEST_COUNT
) -> int:
    """Return a count read from a file; raise ModelError if it is out of range."""
    check(smallest <= value <= largest, item, f"{what} from {smallest} to {largest}", value)
    return int(value)


@contextmanager
def parsing(item: str, expected: str, found: object = None) -> Iterator[None]:
    """Turn errors of parsing or of numerical functions in the block into one ModelError.

    Parameters
    ----------
    item, expected : str
        Subject of the message and its expected content.
    found : object, optional
        Text that was parsed.  By default the message shows the original error.
    """
    try:
        yield
    except BdamperError:
        raise
    except (ValueError, LookupError, RuntimeError, ArithmeticError, np.linalg.LinAlgError) as error:
        shown = error if found is None else f"'{str(found).strip()[:60]}'"
        raise mismatch(item, expected, shown) from error


def data_lines(text: str, comments: str | tuple[str, ...]) -> list[tuple[int, str]]:
    """Return the numbered lines of a text, without empty lines and comments."""
    numbered = []
    for number, line in enumerate(text.split("\n"), 1):
        stripped = line.strip()
        if stripped and not stripped.startswith(comments):
            numbered.append((number, stripped))
    return numbered


class Included:
    """Resolver of the files included by a file, limited in number and to its folder.

    Parameters
    ----------
    folder : path-like, optional
        Further folder from which files may be included.
    """

    def __init__(self, folder: FilePath | None = None) -> None:
        self._count = 0
        self._folder: Path | None = None
        if folder is not None:
            self._folder = as_path(folder).resolve()
            check(self._folder.is_dir(), "include_folder", "an existing folder", f"'{folder}'")

    def path(self, name: str, source: Path, depth: int, item: str) -> Path:
        """Return the path of an included file.

        Parameters
        ----------
        name : str
            Name in the including file.
        source : Path
            Including file.
        depth : int
            Number of nested inclusions down to ``source``.
        item : str
            Name of the line in messages.

        Raises
        ------
        ModelError
            If there are too many files, or the file does not exist below the folder of ``source``
            or the further folder.
        """
        self._count += 1
        permitted = self._count <= MOST_INCLUDED and depth < DEEPEST
        expected = f"at most {MOST_INCLUDED} included files, nested at most {DEEPEST} deep"
        check(permitted, item, expected, "more")
        below = "a file in the folder of this one or below"
        relative = PureWindowsPath(name)  # accepts slashes and backslashes
        path = source.parent / relative.as_posix()
        if self._folder is not None and path.resolve().is_relative_to(self._folder):
            check(path.is_file(), item, "an existing file", f"'{name[:60]}'")
            return path
        is_below = not relative.anchor and ".." not in relative.parts
        expected = below if self._folder else f"{below}, or a folder named by include_folder"
        check(is_below, item, expected, f"'{name[:60]}'")
        check(path.is_file(), item, "an existing file", f"'{name[:60]}'")
        # a symbolic link can lead elsewhere
        is_inside = path.resolve().is_relative_to(source.parent.resolve())
        check(is_inside, item, below, f"'{name[:60]}', a link to another folder")
        return path


class Lines:
    """Iterator over the lines of a text file, whose errors give the line read last."""

    def __init__(self, source: Path, encoding: str) -> None:
        self.source = source
        self._lines = source.read_text(encoding=encoding, errors="replace").splitlines()
        self._read = 0

    def __iter__(self) -> Iterator[str]:
        """Iterate over the remaining lines; :meth:`take` may read lines in between."""
        while self._read < len(self._lines):
            yield self.take("another line")

    def take(self, what: str) -> str:
        """Return the next line; at the end of the file raise ModelError with the missing content
        ``what``.
        """
        check(self._read < len(self._lines), str(self.source), what, "the end of the file")
        self._read += 1
        return self._lines[self._read - 1]

    def follows(self, *starts: str) -> bool:
        """Return whether the next line starts with one of the texts."""
        return self._read < len(self._lines) and self._lines[self._read].startswith(starts)

    def follows_match(self, pattern: re.Pattern[str]) -> bool:
        """Return whether the next line matches a pattern from its start."""
        return self._read < len(self._lines) and pattern.match(self._lines[self._read]) is not None

    @property
    def item(self) -> str:
        """Name of the line read last, for messages."""
        return f"{self.source}: line {self._read}"

    def require(self, good: object, expected: str, found: object) -> None:
        """Raise a ModelError for the line read last unless ``good``."""
        check(good, self.item, expected, found)


# ---- Limits of all checks of an import ----


@dataclass(frozen=True)
class Bounds:
    """Limits of the checks of an import: fractions or relative differences without a unit."""

    # Values outside these ranges indicate mistaken units.
    size: tuple[float, float] = (1e-3, 30.0)
    """Largest extent of a body, m."""
    density: tuple[float, float] = (200.0, 30000.0)
    """Mass divided by volume, kg/m3."""
    frequency: tuple[float, float] = (0.1, 5e6)
    """Lowest elastic frequency, Hz."""
    wave_speed: tuple[float, float] = (1000.0, 15000.0)
    """Speed of longitudinal waves, m/s: 2200 in lead and in plastics, 12900 in beryllium."""
    radial_angle: float = 15.0
    """Largest angle (degrees) between ``radial`` and the middle of a narrow sector; it allows for
    lean of the blade.
    """

    # Matrices and nodes that belong together.
    symmetry: float = 1e-6
    """Difference between a matrix and its transpose, divided by the largest entry."""
    rigid_strain: float = 3e-3
    """Strain of a rigid motion: root of the ratio of its energy to the energy of a stretch of the
    same displacements.
    """
    rigid_force: float = 0.01
    """Nodal force of a rigid motion, divided by the sum of the sizes of its parts.

    On the reference sector and damper it is at most 4e-15 with rows in the right order, and 4e-5
    with positions rounded to a micrometre.  With rows in the order of components it is at least
    0.1, with a median of 0.4 to 0.8.  Stress stiffening contributes about stress divided by
    modulus.
    """
    odd_ones: float = 0.5
    """Fraction of nodes with forces above ``rigid_force``, and fraction of twisted elements, above
    which the model is rejected.  Springs to the ground act on few nodes, and a good mesh has few
    sliver elements.
    """

    # Quantities that should agree.
    same_place: float = 1e-9
    """Distance of coincident nodes, divided by the size of the body."""
    sector_faces: float = 1e-5
    """Distance of matching nodes of the sector faces, divided by the size of the sector; files
    round positions.
    """
    tied_faces: float = 1e-4
    """Distance of sector faces with different meshes, divided by the size of the sector; 101
    blades, not 100, give 6e-4.
    """
    agreement: float = 0.01
    """Largest difference of frequencies of two programs, of areas of equal faces, and of singular
    values from 1 for modes of two rotor speeds.
    """
    fall: float = 0.05
    """Fall of squared frequencies with speed beyond spin softening, as a fraction of it."""
    of_change: float = 0.1
    """Largest deviation of squared frequencies at a third speed, divided by their change between
    the other speeds.
    """
    material: float = 0.02
    """Largest difference of density and Young's modulus of elements and matrices; at most 0.006
    with the elements of CalculiX, distorted by 15 % of their length.
    """
    axes: float = 1e-6
    """Scalar product of two perpendicular directions, and deviation of their lengths from 1."""

    # Faces in contact.
    overlap: float = 0.05
    """Smallest overlap of two faces, as a fraction of the smaller face."""
    distance: float = 0.2
    """Largest distance of two faces, or gap, divided by the width of their overlap."""
    misfit: float = 0.02
    """Difference between the distance of two meshes and the given gap, divided by the width of the
    overlap, and lack of overlap of faces of equal area, above which the import warns.
    """

    # Largest counts.
    modes: int = 1000
    points: int = 400
    """Contact points on one face.  A study with more than about 200 takes minutes."""


BOUNDS = Bounds()
