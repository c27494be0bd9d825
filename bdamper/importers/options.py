"""Options of an import: the sector, units and axes of the files, the reduction, and checks of the
result.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from bdamper.fem.local_basis import LocalSizes
from bdamper.importers.fe_body import BOUNDS, UNITS, Units
from bdamper.util import validation

NodeSet = str | NDArray | list[int]
"""Name of a set of nodes, or node numbers."""

HARMONICS = 9
"""Default number of harmonics that determine the nodal diameters of a model."""
DAMPER_MODES = 16
"""Default number of modes of a free body, including its six rigid ones."""


def _units(name: str, units: object) -> Units:
    """Return factors to SI units from themselves or from the name of a system of units."""
    if isinstance(units, Units):
        return units
    return UNITS[validation.choice(f"{name} (or Units(...))", units, sorted(UNITS))]


def _two_sets(name: str, faces: Any) -> Any:
    is_pair = isinstance(faces, Sequence) and not isinstance(faces, str) and len(faces) == 2
    expected = "two sets of nodes, one for each sector face"
    validation.check_value(is_pair, name, expected, faces)
    return faces


def _orders(name: str, orders: Any) -> tuple[int, ...]:
    return validation.integers(name, np.atleast_1d(orders))


def _frequencies(name: str, by_diameter: Any) -> Mapping[int, Sequence[float]]:
    validation.instance(name, by_diameter, Mapping, "a mapping")
    for d, values in by_diameter.items():
        validation.numbers(f"{name} at nodal diameter {d}", values, above=0.0, unit="Hz")
    return by_diameter


def _tuple(name: str, value: Any, n: int) -> tuple[float, ...]:
    """Check ``n`` numbers and return them as a tuple, so that options can be compared."""
    return tuple(validation.numbers(name, value, n).tolist())


def _rings(name: str, rings: Any) -> Mapping[str, tuple[NodeSet, NodeSet] | None]:
    """Check the faces of rings; None marks a body of separate pieces."""
    validation.instance(name, rings, Mapping, "a mapping of free bodies to pairs of sets")
    for body, faces in rings.items():
        if faces is not None:
            _two_sets(f"{name} '{body}'", faces)
    return rings


def _split_rings(name: str, names: Any) -> tuple[str, ...]:
    is_sequence = isinstance(names, Sequence) and not isinstance(names, str)
    are_names = is_sequence and all(isinstance(ring, str) for ring in names)
    validation.check_value(are_names, name, "a sequence of names of rings", names)
    return tuple(names)


Direction = Annotated[Any, partial(_tuple, n=3)]
Modes = Annotated[int, partial(validation.integer, least=1, most=BOUNDS.modes)]


@validation.check_arguments
@dataclass(frozen=True)
class Sector(validation.Checked):
    """Properties of a sector, or of a whole structure, that its file does not contain, and its node
    sets.

    Parameters
    ----------
    n_blades : int, optional
        Number of sectors; 1 for an acyclic structure. By default, it follows from the sector faces.
    faces : (set, set), optional
        Sector faces (cyclic symmetry faces), in either order. By default, they are found in the
        mesh.
    fixed : set, optional
        Clamped nodes.
    blade_nodes : set, optional
        All nodes of the blade up to the disk, which a model of mistuned bladed disks needs.
    stress : set or mapping of name to set, optional
        Nodes at which stresses are computed (extra ``bdamper[fe]``).
    rings : mapping of free body to (set, set), optional
        Sector faces of a friction ring, in either order. None instead of the faces declares that a
        body whose ends match its neighbours is a separate piece in each sector.
    split_rings : sequence of str
        Names of rings with one gap.  Their hoop force is zero, so that the contacts carry their
        whole centrifugal load.
    elasticity : (Young's modulus, Poisson's ratio), optional
        Elastic constants in the units of the file, which replace the constants of the file.
    angle_tolerance : float
        Largest deviation of the angle between the faces from one pitch, divided by this angle; by
        default as in CalculiX.
    face_tolerance : float
        Largest distance between faces with different meshes, divided by the mean edge length of
        their elements; by default as in CalculiX.

    Raises
    ------
    SettingError
        If a value has the wrong type or is out of range.
    """

    n_blades: validation.Count | None = None
    faces: Annotated[tuple[NodeSet, NodeSet], _two_sets] | None = None
    fixed: NodeSet | None = None
    blade_nodes: NodeSet | None = None
    stress: NodeSet | Mapping[str, NodeSet] | None = None
    rings: Annotated[Mapping[str, tuple[NodeSet, NodeSet] | None], _rings] | None = None
    split_rings: Annotated[Sequence[str], _split_rings] = ()
    elasticity: Annotated[Sequence[float], partial(_tuple, n=2)] | None = None
    angle_tolerance: validation.Share = 0.01
    face_tolerance: validation.Share = 0.025


@validation.check_arguments
@dataclass(frozen=True)
class Placement(validation.Checked):
    """Units and axes of the files.

    Parameters
    ----------
    units : str or Units
        Name of a system in ``UNITS``, or factors.
    axis : (3,) float
        Axis of rotation, in the axes of the file.
    radial : (3,) float
        Direction from the axis of rotation to the blade, in the axes of the file.
    origin : (3,) float
        Point on the axis of rotation, in the axes and the unit of length of the file.

    Raises
    ------
    SettingError
        If axis and radial are not perpendicular, one of them is zero, or the units are unknown.
    """

    units: Annotated[Any, _units] = "m-kg-s"
    axis: Direction = (0.0, 0.0, 1.0)
    radial: Direction = (0.0, 1.0, 0.0)
    origin: Direction = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        lengths = np.linalg.norm(self.axis) * np.linalg.norm(self.radial)
        cosine_times_lengths = abs(np.dot(self.axis, self.radial))
        perpendicular = lengths > 0.0 and cosine_times_lengths <= BOUNDS.axes * lengths
        found = f"{list(self.axis)} and {list(self.radial)}"
        validation.check(perpendicular, "axis and radial", "two directions at right angles", found)

    @cached_property
    def rotation(self) -> NDArray:
        """Axes X, Y, Z of the model as rows (3, 3), in the axes of the file."""
        z = self.axis / np.linalg.norm(self.axis)
        y = self.radial / np.linalg.norm(self.radial)
        return np.array([np.cross(y, z), y, z])


@validation.check_arguments
@dataclass(frozen=True)
class Reduction(validation.Checked):
    """Nodal diameters and modes of a model.

    Parameters
    ----------
    engine_order : int or sequence of int, optional
        Engine orders, which determine the nodal diameters with ``harmonics``.
    harmonics : int, optional
        Number of harmonics of the engine orders. By default, the model has the nodal diameters of
        nine harmonics and all that a time integration needs.
    nodal_diameters : sequence of int, optional
        Nodal diameters (0 to N/2, 0 is added), which replace the nodal diameters of the engine
        orders.
    n_modes : int
        Modes of the sector at each nodal diameter.
    n_damper_modes : int or mapping of name to int
        Modes of free bodies, including six rigid ones.
    damping_ratio : float
        Damping ratio of elastic modes.
    local_sizes : LocalSizes
        Sizes of the basis for mistuned bladed disks.

    Raises
    ------
    SettingError
        If a value has the wrong type or is out of range.
    """

    engine_order: Annotated[int | Sequence[int], _orders] | None = None
    harmonics: Annotated[int, partial(validation.integer, least=1, most=64)] | None = None
    nodal_diameters: Annotated[Sequence[int], validation.integers] | None = None
    n_modes: Modes = 40
    n_damper_modes: Annotated[
        int | Mapping[str, int],
        validation.each(partial(validation.integer, least=6, most=BOUNDS.modes)),
    ] = DAMPER_MODES
    damping_ratio: validation.Share = 0.002
    local_sizes: Annotated[LocalSizes, partial(validation.instance, kind=LocalSizes)] = LocalSizes()


@validation.check_arguments
@dataclass(frozen=True)
class Checks(validation.Checked):
    """Checks of an import.

    Parameters
    ----------
    expected_frequencies : mapping of nodal diameter to frequencies (Hz), optional
        Results of another program, which must agree within 1 %.
    strict : bool
        Whether a failed comparison (also with modes of a file) is an error.
    check_units : bool
        Whether implausible sizes, densities and frequencies are errors.

    Raises
    ------
    SettingError
        If a value has the wrong type or is out of range.
    """

    expected_frequencies: Annotated[Mapping[int, Sequence[float]], _frequencies] | None = None
    strict: bool = False
    check_units: bool = True
