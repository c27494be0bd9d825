"""Nastran: bulk data, and matrices of OP4 files or DMIG cards.

OP4 matrices KNN and MNN contain six rows for each grid point in ascending order of the numbers, but
none for the dependent components of RBE2, RBE3 and MPC.  Empty rows (rotations of solid elements,
fixed components) are dropped.

A dependent grid point without solid elements and rows is omitted.  The dependent grid points of an
RBE2 whose independent grid point is fixed (SPC, SPC1) are fixed themselves.  Any other tie of solid
elements is an error, because the unknowns of a body are the displacements of its nodes.

References
----------
MSC, *Nastran Quick Reference Guide* (bulk data, DMIG).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from bdamper.importers.arrays import square_matrix
from bdamper.importers.bulk_data import Card, read_cards
from bdamper.importers.deck_keywords import (
    BDF_HARMLESS,
    BDF_IN_MATRICES,
    BDF_READ,
    BDF_TIES,
    CURE,
    refuse,
)
from bdamper.importers.fe_body import ElementKind, FEBody, Modes, mesh_body, reader
from bdamper.importers.op4 import read_op4
from bdamper.util.errors import check
from bdamper.util.storage import FilePath

_N_CORNERS = {"CTETRA": 4, "CPENTA": 6, "CHEXA": 8}
_N_QUADRATIC = {"CTETRA": 10, "CPENTA": 15, "CHEXA": 20}
_RECTANGULAR, _CYLINDRICAL, _SPHERICAL = "R", "C", "S"
_SYMMETRIC = 6  # form of a matrix of which one triangle is written
_REAL_TYPES = (1, 2)


class _Tied(NamedTuple):
    """Effect of constraints on the matrices.

    Parameters
    ----------
    rows : (n, 2) int
        Grid point and component of each row of KNN.
    held : set of int
        Held independent grid points.
    spare : set of int
        Dependent and held grid points without solid elements.
    """

    rows: NDArray
    held: set[int]
    spare: set[int]


@dataclass(frozen=True)
class _Grid:
    """Grid point: position in system ``place``, axes of displacement of system ``axes``, and
    components that are held.
    """

    position: tuple[float, float, float]
    place: int
    axes: int
    held: str
    item: str = field(compare=False)


class _Cards:
    """Cards of a file by name."""

    def __init__(self, source: Path, include_folder: FilePath | None) -> None:
        self.all = read_cards(source, include_folder)
        for card in self.all:
            if card.name not in BDF_READ | BDF_HARMLESS | BDF_IN_MATRICES | BDF_TIES:
                refuse(card.text, card.item, sorted(BDF_READ))
        self.grids = self._grids()

    def named(self, *names: str) -> list[Card]:
        """Return the cards with one of the names, in their order."""
        return [card for card in self.all if card.name in names]

    def _grids(self) -> dict[int, _Grid]:
        """Return the grid points by number."""
        default_place = default_axes = 0
        default_held = ""
        for card in self.named("GRDSET"):
            default_place, default_axes = card.integer(1, 0), card.integer(5, 0)
            default_held = card.word(6)
        grids: dict[int, _Grid] = {}
        for card in self.named("GRID"):
            number = card.integer(0)
            grid = _Grid(
                (card.real(2, 0.0), card.real(3, 0.0), card.real(4, 0.0)),
                card.integer(1, default_place),
                card.integer(5, default_axes),
                card.word(6) or default_held,
                card.item,
            )
            again = grids.setdefault(number, grid)
            check(again == grid, card.item, "each grid point once", f"{number} twice")
        return grids


@reader("a bulk data file of Nastran", ".bdf", ".dat", ".nas")
def read_bdf(path: Path, include_folder: FilePath | None = None) -> FEBody:
    """Read grid points, solid elements, sets and DMIG matrices KAAX and MAAX of a bulk data file.

    Parameters
    ----------
    path : path-like
    include_folder : path-like, optional
        Further folder from which files may be included.  Files in the folder of the including file
        and below are always permitted.

    Returns
    -------
    FEBody

    Raises
    ------
    FileNotFoundError, ModelError
        If the file does not exist, is damaged, or has a card that could change the mesh.
    """
    return _bulk(path, include_folder)[0]


@reader("a bulk data file of Nastran")
def _bulk(path: Path, include_folder: FilePath | None) -> tuple[FEBody, _Tied]:
    """Read a bulk data file and the effect of its constraints."""
    cards = _Cards(path, include_folder)
    systems = _Systems(cards)
    numbers = sorted(cards.grids)
    nodes = [systems.position(number) for number in numbers]
    elements, kinds = _solid_elements(cards)
    counts = Counter(card.name for card in cards.all)
    notes = [
        f"cards {name} ({count}) are not read: the matrices must contain them"
        for name, count in counts.items()
        if name in BDF_IN_MATRICES
    ]
    solid = {grid for element in elements for grid in element}
    tied = _tied(cards, solid, notes)
    body = mesh_body(
        str(path),
        "grid points (GRID)",
        numbers,
        nodes,
        elements,
        kinds,
        node_sets=_node_sets(cards),
        notes=tuple(notes),
    )
    axes = {}
    for number, position in zip(numbers, body.nodes):
        if cards.grids[number].axes != 0:
            axes[number] = systems.displacement_axes(number, position)
    return _with_dmig(replace(body, node_axes=axes), cards, tied, str(path)), tied


def _node_sets(cards: _Cards) -> dict[str, NDArray]:
    """Return the grid points of each SET1 that is not empty."""
    members: dict[str, set[int]] = {}
    for card in cards.named("SET1"):
        members.setdefault(f"SET{card.integer(0)}", set()).update(card.integers(1))
    return {name: np.array(sorted(grids), np.int64) for name, grids in members.items() if grids}


def _solid_elements(cards: _Cards) -> tuple[list[list[int]], list[ElementKind]]:
    """Return grid points and kind of each solid element."""
    materials = _materials(cards)
    element_of: dict[int, tuple[str, list[int], int]] = {}
    for card in cards.named(*_N_CORNERS):
        words = range(2, len(card.fields))
        # a mid-side node may be blank or 0
        grids = [grid for grid in (card.integer(k, 0) for k in words) if grid != 0]
        n_corners, n_quadratic = _N_CORNERS[card.name], _N_QUADRATIC[card.name]
        plausible = n_corners <= len(grids) <= n_quadratic
        check(plausible, card.item, f"{n_corners} to {n_quadratic} grid points", len(grids))
        absent = [grid for grid in grids if grid not in cards.grids]
        check(not absent, card.item, "existing grid points", f"{absent[:1]}")
        # without some mid-side nodes an element has its corners only
        if len(grids) != n_quadratic:
            grids = grids[:n_corners]
        number = card.integer(0)
        element = (card.name, grids, card.integer(1, number))
        again = element_of.setdefault(number, element)
        check(again == element, card.item, "each element once", f"{number} twice")
    elements, kinds = [], []
    for _, grids, section in element_of.values():
        elements.append(grids)
        constants = materials.get(section, (None, None, None))
        kinds.append(ElementKind(f"C3D{len(grids)}", *constants))
    return elements, kinds


_Constants = tuple[float | None, float | None, float | None]


def _materials(cards: _Cards) -> dict[int, _Constants]:
    """Return Young's modulus, Poisson's ratio and density (MAT1) of each section (PSOLID)."""
    mass_factor = 1.0
    for card in cards.named("PARAM"):
        if card.word(0) == "WTMASS":
            mass_factor = card.real(1)
    material_of: dict[int, _Constants] = {}
    for card in cards.named("MAT1"):
        young, shear, poisson = (card.optional_real(k) for k in (1, 2, 3))
        # two of the three constants give the third
        if young is None and shear is not None and poisson is not None:
            young = 2.0 * (1.0 + poisson) * shear
        elif poisson is None and young is not None:
            poisson = young / (2.0 * shear) - 1.0 if shear else 0.0
        # a blank density is 0
        density = mass_factor * card.real(4, 0.0) or None
        material_of[card.integer(0)] = (young, poisson, density)
    constants = {}
    for card in cards.named("PSOLID"):
        material = card.integer(1, 0)
        if material in material_of:
            constants[card.integer(0)] = material_of[material]
    return constants


# ---- Constraints ----


def _tied(cards: _Cards, solid: set[int], notes: list[str]) -> _Tied:
    """Return the effect of constraints, and add notes on it.

    Raises
    ------
    ModelError
        If grid points of solid elements are tied to a grid point that is not held.
    """
    dependent: set[tuple[int, int]] = set()
    held: set[int] = set()
    held_grids = _held(cards)
    for tie in _ties(cards):
        dependent |= tie.dependent
        if solid.isdisjoint(grid for grid, _ in tie.dependent):
            notes.append(
                f"{tie.name} ties grid points without solid elements: it must be in the matrices"
            )
            continue
        expected = (
            "a mesh without constraints, or RBE2 to a grid point that SPC1 fixes in 123456 "
            f"({CURE})"
        )
        check(tie.independent in held_grids, tie.card.item, expected, tie.card.text)
        held.add(tie.independent)
        notes.append(
            f"{tie.name} fixes its dependent grid points, because {tie.independent} is fixed"
        )
    rows = []
    for grid in sorted(cards.grids):
        for component in range(1, 7):
            if (grid, component) not in dependent:
                rows.append((grid, component))
    spare = held.union(grid for grid, _ in dependent) - solid
    return _Tied(np.array(rows, np.int64).reshape(-1, 2), held, spare)


class _Tie(NamedTuple):
    """Constraint between components of grid points.

    Parameters
    ----------
    name : str
        Name and number of the card.
    card : Card
    independent : int
        Independent grid point of RBE2; 0 for other cards.
    dependent : set of (int, int)
        Grid point and component of each dependent displacement.
    """

    name: str
    card: Card
    independent: int
    dependent: set[tuple[int, int]]


def _ties(cards: _Cards) -> Iterator[_Tie]:
    """Iterate over RBE2, RBE3 and MPC."""
    for card in cards.named("RBE2"):
        # all dependent grid points have the same components, such as "123"; a thermal expansion
        # coefficient may follow them
        last = len(card.fields) - 1
        has_expansion = last >= 3 and "." in card.fields[last]
        grids = card.integers(3, last if has_expansion else last + 1)
        dependent = {(grid, k) for grid in grids for k in _components(card, card.word(2))}
        yield _Tie(f"RBE2 {card.word(0)}", card, card.integer(1), dependent)
    for card in cards.named("RBE3"):
        yield _Tie(f"RBE3 {card.word(0)}", card, 0, _dependent_of_rbe3(card))
    for card in cards.named("MPC"):
        # the first grid point and component of an equation depend on the others
        grid = card.integer(1)
        components = _components(card, card.word(2))
        yield _Tie(f"MPC {card.word(0)} {grid}", card, 0, {(grid, k) for k in components})


def _dependent_of_rbe3(card: Card) -> set[tuple[int, int]]:
    """Return the dependent displacements of RBE3: those of its reference point, unless the card
    names others after UM.
    """
    words = [word.upper() for word in card.fields]
    if "UM" not in words:
        return {(card.integer(2), k) for k in _components(card, card.word(3))}
    dependent: set[tuple[int, int]] = set()
    after = [word for word in words[words.index("UM") + 1 :] if word]
    if "ALPHA" in after:
        after = after[: after.index("ALPHA")]
    for grid, components in zip(after[::2], after[1::2]):
        check(grid.isdigit(), card.item, "grid points and components after UM", f"'{grid}'")
        dependent.update((int(grid), k) for k in _components(card, components))
    return dependent


def _components(card: Card, text: str) -> list[int]:
    """Return the components in a text such as "123"."""
    check(set(text) <= set("0123456"), card.item, "components out of 123456", f"'{text}'")
    return [int(component) for component in text]


def _held(cards: _Cards) -> set[int]:
    """Return the grid points that are held in all six components.

    They are held by their GRID, or by the set of SPC and SPC1 if there is only one.
    """
    components_of = {number: set(grid.held) for number, grid in cards.grids.items()}
    single = cards.named("SPC", "SPC1")
    if len({card.integer(0) for card in single}) == 1:
        for card in single:
            if card.name == "SPC1":
                pairs = [(grid, card.word(1)) for grid in card.integers(2)]
            else:
                # two triples of grid point, components and displacement
                starts = [k for k in (1, 4) if card.word(k)]
                pairs = [(card.integer(k), card.word(k + 1)) for k in starts]
            for grid, components in pairs:
                components_of.setdefault(grid, set()).update(components)
    return {grid for grid, components in components_of.items() if components >= set("123456")}


# ---- Coordinate systems ----


class _System(NamedTuple):
    """Coordinate system.

    Parameters
    ----------
    kind : str
        "R", "C" or "S": rectangular, cylindrical or spherical.
    origin : (3,) float
    axes : (3, 3) float
        Unit vectors as rows.
    """

    kind: str
    origin: NDArray
    axes: NDArray

    def to_basic(self, coordinates: tuple[float, float, float]) -> NDArray:
        """Return the position (3,) in basic coordinates."""
        a, b, c = coordinates
        local = np.array([a, b, c])
        if self.kind == _CYLINDRICAL:
            angle = np.radians(b)
            local = np.array([a * np.cos(angle), a * np.sin(angle), c])
        elif self.kind == _SPHERICAL:
            polar, azimuth = np.radians(b), np.radians(c)
            in_plane = a * np.sin(polar)
            local = np.array(
                [in_plane * np.cos(azimuth), in_plane * np.sin(azimuth), a * np.cos(polar)]
            )
        return self.origin + local @ self.axes


class _Systems:
    """Coordinate systems of a file, which may depend on others and on grid points."""

    def __init__(self, cards: _Cards) -> None:
        self._grids = cards.grids
        self._known = {0: _System(_RECTANGULAR, np.zeros(3), np.eye(3))}
        # card and place of the first of its fields
        self._cards: dict[int, tuple[Card, int]] = {}
        self._open: set[int] = set()
        for card in cards.named("CORD1R", "CORD1C", "CORD1S", "CORD2R", "CORD2C", "CORD2S"):
            # a card of grid points may define two systems
            starts = (0, 4) if card.name.startswith("CORD1") else (0,)
            for start in starts:
                if card.word(start):
                    self._cards[card.integer(start)] = (card, start)

    def _system(self, number: int, item: str) -> _System:
        if number in self._known:
            return self._known[number]
        check(number in self._cards, item, "an existing coordinate system", number)
        card, start = self._cards[number]
        check(number not in self._open, card.item, "no system that depends on itself", number)
        self._open.add(number)
        if card.name.startswith("CORD1"):
            grids = [card.integer(start + k) for k in (1, 2, 3)]
            points = [self._of_grid(grid, card.item) for grid in grids]
        else:
            reference = self._system(card.integer(1, 0), card.item)
            points = []
            for k in (2, 5, 8):
                point = (card.real(k, 0.0), card.real(k + 1, 0.0), card.real(k + 2, 0.0))
                points.append(reference.to_basic(point))
        self._open.discard(number)
        # origin, a point on the third axis, and a point in the plane of the first and third
        origin, on_z, in_xz = points
        z = on_z - origin
        y = np.cross(z, in_xz - origin)
        separate = np.linalg.norm(z) > 0.0 and np.linalg.norm(y) > 0.0
        check(separate, card.item, "three points that are not on one line", points)
        z, y = z / np.linalg.norm(z), y / np.linalg.norm(y)
        system = _System(card.name[-1], origin, np.array([np.cross(y, z), y, z]))
        self._known[number] = system
        return system

    def _of_grid(self, number: int, item: str) -> NDArray:
        check(number in self._grids, item, "an existing grid point", number)
        return self.position(number)

    def position(self, number: int) -> NDArray:
        """Return the position (3,) of a grid point in basic coordinates."""
        grid = self._grids[number]
        return self._system(grid.place, grid.item).to_basic(grid.position)

    def displacement_axes(self, number: int, position: NDArray) -> NDArray:
        """Return the axes (3, 3) of the displacements of a grid point, as rows."""
        grid = self._grids[number]
        system = self._system(grid.axes, grid.item)
        expected = "rectangular or cylindrical axes of displacement"
        check(system.kind != _SPHERICAL, grid.item, expected, "spherical ones")
        if system.kind == _RECTANGULAR:
            return system.axes
        radial = system.axes @ (position - system.origin) * [1.0, 1.0, 0.0]
        radius = np.linalg.norm(radial)
        expected = "a position off the axis of its cylindrical system"
        check(radius > 0.0, grid.item, expected, "a position on it")
        r = radial / radius
        z = np.array([0.0, 0.0, 1.0])
        return np.array([r, np.cross(z, r), z]) @ system.axes


# ---- Matrices ----


def _with_dmig(body: FEBody, cards: _Cards, tied: _Tied, source: str) -> FEBody:
    """Add stiffness and mass of DMIG cards if the file has both, and a note on other matrices."""
    cards_of: dict[str, list[Card]] = {}
    for card in cards.named("DMIG"):
        cards_of.setdefault(card.word(0), []).append(card)
    pair: tuple[str, ...] = ()
    if "KAAX" in cards_of and "MAAX" in cards_of:
        pair = ("KAAX", "MAAX")
    elif "K2GG" in cards_of and "M2GG" in cards_of:
        pair = ("K2GG", "M2GG")
    unused = sorted(set(cards_of) - set(pair))
    if unused:
        note = f"matrices {', '.join(unused)} (DMIG) are not used"
        body = replace(body, notes=(*body.notes, note))
    if not pair:
        return body
    entries = [_dmig_entries(cards_of[name]) for name in pair]
    # the same table of equations for both matrices
    places = sorted({place for matrix in entries for pair in matrix for place in pair})
    row_of = {place: row for row, place in enumerate(places)}
    matrices = []
    for name, matrix in zip(pair, entries):
        rows = [row_of[row] for row, _ in matrix]
        columns = [row_of[column] for _, column in matrix]
        shape = (len(places), len(places))
        full = sp.coo_matrix((list(matrix.values()), (rows, columns)), shape=shape)
        matrices.append(square_matrix(full, f"{source}: DMIG {name}"))
    dofs = np.array(places, np.int64)
    with_matrices = replace(body, stiffness=matrices[0], mass=matrices[1], dofs=dofs)
    return _without_empty(with_matrices, tied)


_Place = tuple[int, int]


def _dmig_entries(cards: list[Card]) -> dict[tuple[_Place, _Place], float]:
    """Return the entries of a matrix by the grid point and component of row and column."""
    entries: dict[tuple[_Place, _Place], float] = {}
    form = 0
    for card in cards:
        if card.word(1) == "0":
            # the head of the matrix
            form = card.integer(2)
            real = card.integer(3) in _REAL_TYPES
            check(real, card.item, "a real matrix", f"values of type {card.word(3)}")
            continue
        column = (card.integer(1), card.integer(2, 0))
        for k in range(4, len(card.fields), 4):
            if not card.word(k):
                continue
            row = (card.integer(k), card.integer(k + 1, 0))
            value = card.real(k + 2, 0.0)
            entries[row, column] = value
    if form == _SYMMETRIC:
        # an entry is written in one of the two triangles
        for (row, column), value in list(entries.items()):
            entries.setdefault((column, row), value)
    check(bool(entries), cards[0].item, "entries of the matrix", "none")
    return entries


def _without_empty(body: FEBody, tied: _Tied) -> FEBody:
    """Drop the rows that are empty in both matrices or held, and the spare grid points without
    rows.
    """
    assert body.stiffness is not None and body.mass is not None and body.dofs is not None
    stiffness_sum = np.asarray(abs(body.stiffness).sum(axis=1)).ravel()
    mass_sum = np.asarray(abs(body.mass).sum(axis=1)).ravel()
    used = stiffness_sum + mass_sum > 0.0
    held = np.isin(body.dofs[:, 0], list(tied.held))
    keep = np.flatnonzero(used & ~held)
    notes = body.notes
    n_dropped = len(used) - len(keep)
    if n_dropped:
        notes = (*notes, f"{n_dropped} fixed or empty rows dropped")
    dofs = body.dofs[keep]
    without_rows = tied.spare.difference(dofs[:, 0].tolist())
    kept = ~np.isin(body.numbers, list(without_rows))
    return replace(
        body,
        numbers=body.numbers[kept],
        nodes=body.nodes[kept],
        stiffness=body.stiffness[keep][:, keep],
        mass=body.mass[keep][:, keep],
        dofs=dofs,
        notes=notes,
    )


def read_nastran(
    bulk: FilePath,
    stiffness: FilePath | None = None,
    mass: FilePath | None = None,
    names: tuple[str, str] = ("KNN", "MNN"),
    modes: tuple[Modes, ...] = (),
    include_folder: FilePath | None = None,
) -> FEBody:
    """Read a body from bulk data and matrices.

    Parameters
    ----------
    bulk : path-like
        Bulk data.  Its DMIG matrices are used if ``stiffness`` is omitted.
    stiffness, mass : path-like, optional
        OP4 files with six rows for each grid point, but none for dependent components.  One file
        may contain both matrices.
    names : (str, str)
        Names of the matrices in these files.  KNN and MNN include multipoint constraints, KGG and
        MGG do not.
    modes : tuple of Modes
        Modes to compare with, see :func:`read_op2`.
    include_folder : path-like, optional
        Further folder from which files may be included.  Files in the folder of the including file
        and below are always permitted.

    Returns
    -------
    FEBody

    Raises
    ------
    FileNotFoundError, ModelError
        If a file does not exist or is damaged, or has no matrices of these names and sizes.
    """
    body, tied = _bulk(bulk, include_folder)
    if stiffness is None:
        return replace(body, modes=modes)
    matrices = []
    n_rows = len(tied.rows)
    for path, name in zip((stiffness, mass or stiffness), names):
        content = read_op4(path)
        found = f"the matrices {sorted(content)}"
        check(name in content, str(path), f"a matrix '{name}'", found)
        expected = (
            f"{n_rows} rows: six for each grid point, without the dependent components of RBE2, "
            "RBE3, MPC"
        )
        check(content[name].shape[0] == n_rows, str(path), expected, content[name].shape[0])
        matrices.append(content[name])
    with_matrices = replace(
        body,
        stiffness=matrices[0],
        mass=matrices[1],
        dofs=tied.rows,
        source=f"{stiffness}, {bulk}",
    )
    return replace(_without_empty(with_matrices, tied), modes=modes)
