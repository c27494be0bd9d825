"""A model from the finite element bodies of any program: checks, reduction, contact points.

The sector is called "blade" in the model, a single free body "damper"; several have names of their own.  Everything is
computed by the code that makes the reference model (:mod:`bdamper.fem`).  Quantities that are easily mistaken are
computed instead of asked for: which of the two sector faces lies toward +X, in which sector a damper meets its neighbour,
in which direction a wave travels, mass, centre and inertia.  The report lists them.

What an import returns: a model, and what was read, made and checked, as one page of text and a picture.

Fields of nodal forces, such as those of a pressure that a blade meets, in SI units and the axes of the model.
"""

from __future__ import annotations

import datetime
import os
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from itertools import count
from math import gcd
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from bdamper.fem.local_basis import LocalSizes, sampled_waves
from bdamper.fem.reduced_bodies import Place, Wanted, needed_nodal_diameters, picture_mesh
from bdamper.fem.sector_faces import SectorFaces, find_faces, match_faces, no_faces, tie_faces
from bdamper.importers.arrays import as_integers, number_table
from bdamper.importers.bodies import (
    blade_part,
    constrained_from_matrices,
    constrained_from_modes,
    cyclic_sectors,
    free_from_matrices,
    free_from_modes,
    held_components,
    stress_rows,
    with_local_basis,
)
from bdamper.importers.contact_faces import ContactFaces, LaidContacts, from_first_sector, lay_contacts
from bdamper.importers.fe_body import BOUNDS, FEBody, Units
from bdamper.importers.plausibility import (
    check_corners,
    check_lowest,
    check_not_swapped,
    check_radial,
    check_sizes,
    check_table,
)
from bdamper.importers.prepared_body import NodeSet, Placement, PreparedBody, Ring
from bdamper.model.fields import check
from bdamper.model.model_file import save_model
from bdamper.model.structure import Body, Location, ModalBasis, Model
from bdamper.model.validation import check_model
from bdamper.util import validation
from bdamper.util.display import Plottable
from bdamper.util.errors import SettingError
from bdamper.util.formatting import short_repr
from bdamper.util.progress import one_thread, progress_stages
from bdamper.util.storage import FilePath

if TYPE_CHECKING:
    from bdamper.fem.element_stress import StressRows


# ---- Fields of nodal forces, such as those of a pressure that a blade meets, in SI units and th ----


EXPECTED = "(node numbers (n,), forces (n, 3)), or a CSV file of rows: node, Re x, Im x, Re y, Im y, Re z, Im z"


def force_fields(given: Mapping[str, object] | None, body: PreparedBody) -> dict[str, NDArray]:
    """(n_nodes, 3) complex forces (N) of each field by name.

    Parameters
    ----------
    given : mapping of name to (numbers, forces) or path, optional
        Node numbers (n,) and complex forces (n, 3) in the axes and units of the file, or a CSV file with both; comments
        start with ``#``.  Forces on the same node add up.
    body : PreparedBody
        On whose nodes they act.

    Raises
    ------
    SettingError, ModelError
        If one is no field, or has none but zeros, or a node is not known; the message names the field.
    """
    out = {}
    for name, value in ({} if given is None else validation.instance("forces", given, Mapping, "a mapping")).items():
        numbers, forces = _table(f"forces '{name}'", value)
        units, out[name] = body.place.units, np.zeros((len(body.nodes), 3), complex)
        in_si = units.mass * units.length * forces @ body.place.rotation.T
        np.add.at(out[name], body.index(numbers, f"forces '{name}'"), in_si)
        validation.check(out[name].any(), f"forces '{name}'", "forces other than 0", "zeros alone")
    return out


def _table(item: str, value: Any) -> tuple[NDArray, NDArray]:
    """Node numbers and forces as they were given."""
    if isinstance(value, str | os.PathLike):
        table = number_table(Path(value), 7)
        return as_integers(table[:, 0], item), table[:, 1::2] + 1j * table[:, 2::2]
    validation.check_value(isinstance(value, tuple) and len(value) == 2, item, EXPECTED, value)
    try:
        numbers, forces = np.asarray(value[0]), np.asarray(value[1], complex)
    except (ValueError, TypeError) as error:
        raise validation.invalid(item, EXPECTED, value) from error
    good = numbers.ndim == 1 and len(numbers) and forces.shape == (len(numbers), 3) and np.isfinite(forces).all()
    validation.check_value(good, item, EXPECTED, value)
    return numbers, forces


# ---- What an import returns ----


def frequencies_of(basis: ModalBasis) -> NDArray:
    """Frequencies (n_modes,) of the modes of a body, Hz."""
    return np.sqrt(basis.omega2[: basis.n_natural]) / (2.0 * np.pi)


@short_repr
@dataclass(frozen=True)
class BuiltModel(Plottable):
    """A model and the report on how it came about, which it prints.

    ``plot`` draws the bodies with faces and points (:func:`bdamper.plot.plot_import_report`).

    Parameters
    ----------
    model : Model
    sources : mapping of body to str
        Files and numbers of nodes, elements and equations.
    faces : tuple of str
        Figures of each interface.
    checks : tuple of str
        Checks made and passed, with figures.
    missing : tuple of str
        Quantities that the model does not have, and what to do about it.
    failed : tuple of str
        Comparisons with another program that failed.
    """

    model: Model
    sources: Mapping[str, str] = field(default_factory=dict)
    faces: tuple[str, ...] = ()
    checks: tuple[str, ...] = ()
    missing: tuple[str, ...] = ()
    failed: tuple[str, ...] = ()

    @property
    def frequencies(self) -> dict[int, NDArray]:
        """Frequencies (n_modes,) of the sector, Hz, for each nodal diameter."""
        return {d: frequencies_of(basis) for d, basis in self.model.bodies["blade"].bases.items()}

    def save(self, path: FilePath) -> None:
        """Write the model file; the report goes into its provenance."""
        save_model(self.model, path)

    def __str__(self) -> str:
        frequencies = []
        for d, values in self.frequencies.items():
            shown = "  ".join(f"{f:.6g}" for f in values[:6])
            frequencies.append(f"{d:4d}  {shown}{'  ...' if len(values) > 6 else ''}  ({len(values)} modes)")
        parts: dict[str, list[str]] = {
            "Comparisons that FAILED": [*self.failed],
            "Read": [f"{name}: {text}" for name, text in self.sources.items()],
            "Frequencies of the sector, Hz, for each nodal diameter": frequencies,
        }
        for free in self.model.bodies.values():
            if free.centre is None or free.inertia is None:
                continue
            moments = np.linalg.eigvalsh(free.inertia)
            parts[f"Free body {free.name}, recomputed"] = own = [
                f"mass {free.mass:.6g} kg, centre ({', '.join(f'{c:.6g}' for c in free.centre)}) m",
                f"principal moments of inertia {', '.join(f'{m:.6g}' for m in moments)} kg m2",
            ]
            if len(elastic := frequencies_of(free.bases[0])[6:12]):
                own.append("elastic modes, Hz: " + "  ".join(f"{f:.6g}" for f in elastic))
        parts |= {"Interfaces": [*self.faces], "Checks passed": [*self.checks], "Not in this model": [*self.missing]}
        lines = ["Import report"]
        for title, texts in parts.items():
            if texts:
                lines += ["", title, *(f"  {text}" for text in texts)]
        return "\n".join(lines)


# ---- A model from the finite element bodies of any program ----


HARMONICS = 9
"""Harmonics whose nodal diameters a model has by default."""
DAMPER_MODES = 16
"""Modes of a free body by default, its six rigid ones included."""
MARCHED = 33
"""Sectors after which an excitation repeats, up to which a model has all their nodal diameters, for marches in time."""


@validation.check_arguments
@one_thread
def build_model(
    blade: FEBody,
    damper: FEBody | Mapping[str, FEBody] | None = None,
    *,
    n_blades: int | None = None,
    contacts: Sequence[ContactFaces],
    sector_faces: tuple[NodeSet, NodeSet] | None = None,
    fixed: NodeSet | None = None,
    locations: Mapping[str, object] | None = None,
    forces: Mapping[str, object] | None = None,
    engine_order: int | Sequence[int] | None = None,
    harmonics: int | None = None,
    nodal_diameters: Sequence[int] | None = None,
    n_modes: int = 40,
    n_damper_modes: int | Mapping[str, int] = DAMPER_MODES,
    damping_ratio: float = 0.002,
    units: str | Units = "m-kg-s",
    axis: Sequence[float] = (0.0, 0.0, 1.0),
    radial: Sequence[float] = (0.0, 1.0, 0.0),
    origin: Sequence[float] = (0.0, 0.0, 0.0),
    expected_frequencies: Mapping[int, Sequence[float]] | None = None,
    check_units: bool = True,
    strict: bool = False,
    wheel: NodeSet | None = None,
    wheel_shapes: LocalSizes | None = None,
    stress: NodeSet | Mapping[str, NodeSet] | None = None,
    elasticity: Sequence[float] | None = None,
    progress: bool | None = None,
) -> BuiltModel:
    """Make a model from finite element bodies.

    Parameters
    ----------
    blade, damper : FEBody, FEBody or mapping of name to FEBody
        One sector (or a whole structure, ``n_blades=1``); optionally free bodies beside the blade of some sector.
    n_blades, contacts : int (optional), sequence of ContactFaces
    sector_faces, fixed : (set, set), set, optional
        The two faces at which the sector repeats; found, as ``n_blades`` is, where their meshes match.  Clamped nodes.
    locations, forces : mapping of name to node, position or (body, one of both); to (nodes (n,), forces (n, 3)) or CSV file
        Where forces act and the response is read; nodal forces on the blade (``bdamper.importers.build``).
    engine_order, harmonics, nodal_diameters : int or several, int, sequence of int (0 to N/2), optional
        Nodal diameters of the model, given or as the harmonics of engine orders need them; by default as nine harmonics and
        a march in time do.  0 is always added.
    n_modes, n_damper_modes, damping_ratio : int, int, float
        Modes of the sector at each nodal diameter, and of a damper, its six rigid ones included, for all alike or by name;
        damping ratio of all elastic modes.
    units, axis, radial, origin : str or Units, (3,) float
        One of ``bdamper.importers.UNITS`` or factors; axis of rotation, direction to the blade and a point on the axis, in
        the axes and the unit of length of the files.
    expected_frequencies, strict : mapping of nodal diameter to frequencies (Hz), bool
        Of another program, compared to 1 %; a comparison that fails, also with modes of a file, warns; strict refuses.
    check_units : bool
        Whether sizes and densities far from anything built are refused.
    wheel, wheel_shapes : set, LocalSizes, optional
        All nodes of the blade, those of its root included, which the disk shares: for mistuned wheels.
    stress, elasticity : set or mapping of name to set, (Young's modulus, Poisson's ratio), optional
        Nodes of the blade for stress (extra ``bdamper[fe]``); constants in units of the file, in place of those in it.
    progress : bool, optional
        Whether steps and the time left are shown; by default on a terminal.

    Raises
    ------
    ModelError, SettingError
    """
    damping_ratio = validation.number("damping_ratio", damping_ratio, least=0.0, below=1.0)
    bodies = _prepared(blade, damper, Placement(axis, radial, origin, units), validation.flag("strict", strict))
    counts = _counts(list(bodies)[1:], n_modes, n_damper_modes)
    contacts = _given_contacts(contacts)
    faces = _sector_faces(bodies["blade"], sector_faces, n_blades)
    diameters, excited, reason = _diameters(n_blades := faces.n_sectors, engine_order, harmonics, nodal_diameters, blade)
    bodies["blade"].expected = _known_frequencies(expected_frequencies, diameters)
    bodies["blade"].checks.append(f"{len(diameters)} nodal diameters, {reason}")
    _check_bodies(bodies, n_blades, validation.flag("check_units", check_units))
    ring = Ring(faces, diameters, excited or diameters)
    contacts, bodies = from_first_sector(contacts, bodies, n_blades)
    laid, places = lay_contacts(contacts, bodies, n_blades), _locations(locations, bodies, forces)
    rows = stress_rows(bodies["blade"], stress, elasticity, laid, ring)
    with _shown(progress, bodies, ring, wheel is not None):
        made = _reduced(bodies, laid, places, counts, damping_ratio, ring, fixed, wheel, wheel_shapes, rows)
    return _assembled(bodies, laid, places, made, rows, n_blades, check_units)


# -----------------------------------------------------------------------------------------------------------
# Settings


def _prepared(
    blade: FEBody, damper: FEBody | Mapping[str, FEBody] | None, place: Placement, strict: bool
) -> dict[str, PreparedBody]:
    """The bodies in SI units and the axes of the model, the blade first."""
    free = damper if isinstance(damper, Mapping) else {} if damper is None else {"damper": damper}
    taken = [name for name in free if name in ("blade", "ground") or not isinstance(name, str)]
    validation.check(not taken, "free bodies", "names other than 'blade' and 'ground'", taken)
    out = {}
    for name, given in {"blade": blade, **free}.items():
        body = validation.instance(name, given, FEBody, "an FEBody, as read_arrays returns it")
        out[name] = PreparedBody(name, body, place, strict=strict)
    return out


def _counts(free: Sequence[str], n_modes: int, n_damper_modes: int | Mapping[str, int]) -> dict[str, int]:
    """Modes of each body."""
    given = n_damper_modes if isinstance(n_damper_modes, Mapping) else dict.fromkeys(free, n_damper_modes)
    validation.mapping("n_damper_modes", given, free, "free bodies")
    own = {name: validation.integer("n_damper_modes", given.get(name, DAMPER_MODES), 6, BOUNDS.modes) for name in free}
    return {"blade": validation.integer("n_modes", n_modes, 1, BOUNDS.modes), **own}


def _check_bodies(bodies: Mapping[str, PreparedBody], n_blades: int, check_units: bool) -> None:
    check_radial(bodies["blade"], n_blades)
    for body in bodies.values():
        body.check_repeated()
        if body.has_matrices:
            check_not_swapped(body)
            if body.name == "blade":  # a free body: check_rigid_motion
                check_table(body)
        check_corners(body)
        if check_units:
            check_sizes(body)


def _known_frequencies(
    given: Mapping[int, Sequence[float]] | None, diameters: tuple[int, ...]
) -> Mapping[int, Sequence[float]]:
    known = validation.instance("expected_frequencies", {} if given is None else given, Mapping, "a mapping")
    for d, values in known.items():
        check(d in diameters, "expected_frequencies", f"nodal diameters out of {list(diameters)}", d)
        validation.numbers(f"expected_frequencies at nodal diameter {d}", values, above=0.0, unit="Hz")
    return known


def _given_contacts(given: Sequence[ContactFaces]) -> tuple[ContactFaces, ...]:
    several = isinstance(given, Iterable) and not isinstance(given, str)
    contacts = tuple(validation.instance("contacts", contact, ContactFaces) for contact in given) if several else ()
    validation.check_value(contacts, "contacts", "a sequence of one or more ContactFaces", given)
    names = [contact.name for contact in contacts]
    validation.check_value(len(set(names)) == len(names), "contacts", "each name once", names)
    return contacts


def _diameters(
    n_blades: int, engine_order: int | Sequence[int] | None, harmonics: int | None, given: Sequence[int] | None,
    blade: FEBody,
) -> tuple[tuple[int, ...], tuple[int, ...], str]:  # fmt: skip
    """Nodal diameters of a model, those of its engine orders, and why the model has the former."""
    orders = () if engine_order is None else validation.integers("engine_order", np.atleast_1d(engine_order))
    excited = tuple(sorted({min(order % n_blades, -order % n_blades) for order in orders}))
    held = None if blade.stiffness is not None or not blade.modes else {modes.nodal_diameter for modes in blade.modes}
    if given is not None or not orders:
        if given is None and n_blades > 1 and held is None:
            raise SettingError("expected engine_order or nodal_diameters, found neither")
        chosen = given if given is not None else [0] if n_blades == 1 else sorted(held or ())
        return tuple(sorted({0, *validation.integers("nodal_diameters", chosen, most=n_blades // 2)})), excited, "given"
    most = HARMONICS if harmonics is None else validation.integer("harmonics", harmonics, 1, 64)
    reason = f"for {most} harmonics of engine order {', '.join(map(str, orders))}"
    wanted = set[int]()
    for order in orders:
        distinct = n_blades // gcd(n_blades, order)  # sectors after which the excitation repeats
        marched = distinct if harmonics is None and distinct <= MARCHED else 1
        wanted.update(needed_nodal_diameters(n_blades, order, max(most, marched)))
    if harmonics is None:
        reason += " and a march in time"
        wanted &= held or wanted
    return tuple(sorted({0, *wanted})), excited, reason


def _sector_faces(body: PreparedBody, given: tuple[NodeSet, NodeSet] | None, n_blades: int | None) -> SectorFaces:
    """The faces at which the sector repeats: those given, or found; matching ones, or tied by interpolation."""
    n_blades = None if n_blades is None else validation.integer("n_blades", n_blades, least=1)
    if n_blades == 1:
        return no_faces()
    tolerance = BOUNDS.sector_faces * body.size
    if given is None:
        faces = find_faces(body.nodes, body.boundary, n_blades, tolerance) if body.elements else None
        if faces is None:
            expected = "the two faces of the sector" + ("" if n_blades else ", and n_blades (1 if nothing repeats)")
            raise SettingError(f"sector_faces: expected {expected}, as no rotation carries faces of elements onto others")
        body.checks.append(f"sector faces: found from the geometry, {faces.n_sectors} sectors")
        return faces
    if isinstance(given, str) or not isinstance(given, Sequence) or len(given) != 2:
        raise validation.invalid("sector_faces", "two sets of nodes, the faces at which the sector repeats", given)
    first, second = (body.node_set(s, "sector_faces") for s in given)
    if n_blades is None:
        n_blades = _sectors_between(body, first, second)
    problems = []
    for left, right, words in ((first, second, "the first set lies toward -X"), (second, first, "the sets came swapped")):
        try:
            matched = match_faces(body.nodes, left, right, n_blades, tolerance)
            body.checks.append(f"sector faces: {len(left)} pairs of nodes match within {tolerance:.2g} m; {words}")
            return matched
        except ValueError as error:
            problems.append(str(error))
    expected = f"two sets of nodes of which a rotation by 2 pi/{n_blades} about the axis carries one onto the other"
    body.require(body.elements, "sector_faces", expected, "; the other way: ".join(problems))
    with body.refusing("sector_faces", expected):
        tied = [tie_faces(body.nodes, body.boundary, *pair, n_blades) for pair in ((first, second), (second, first))]
    best = min(tied, key=lambda faces: faces.distance)
    found = f"{'; the other way: '.join(problems)}; meshes that differ are at best {best.distance:.3g} m apart"
    body.require(best.distance <= BOUNDS.tied_faces * body.size, "sector_faces", expected, found)
    tied_nodes = f"{len(best.dependent)} nodes tied by interpolation to {len(best.independent)}"
    body.checks.append(f"sector faces: meshes that differ, {tied_nodes}, at most {best.distance:.2g} m apart")
    return best


def _sectors_between(body: PreparedBody, first: NDArray, second: NDArray) -> int:
    """Number of sectors from the mean angle between two faces."""
    angles = [np.arctan2(*body.nodes[nodes, :2].mean(axis=0)) for nodes in (first, second)]
    between = abs((angles[1] - angles[0] + np.pi) % (2.0 * np.pi) - np.pi)
    n_blades = max(2, round(2.0 * np.pi / max(between, 1e-3)))
    body.checks.append(f"{n_blades} sectors, from the {np.rad2deg(between):.4g} degrees between the sector faces")
    return n_blades


def _locations(
    given: Mapping[str, object] | None, bodies: Mapping[str, PreparedBody], forces: Mapping[str, object] | None
) -> dict[str, tuple[str, Place]]:
    """Body and node of each named location, or the field of forces of that name."""
    out: dict[str, tuple[str, Place]] = {name: ("blade", f) for name, f in force_fields(forces, bodies["blade"]).items()}
    for name, value in ({} if given is None else validation.instance("locations", given, Mapping, "a mapping")).items():
        body = "blade"
        if isinstance(value, tuple) and len(value) == 2 and isinstance(value[0], str):
            body, value = value
        validation.check(body in bodies, f"location '{name}'", f"a body out of {sorted(bodies)}", f"'{body}'")
        validation.check(name not in out, f"location '{name}'", "another name than one of forces", f"'{name}' twice")
        out[name] = (body, bodies[body].node(value, f"location '{name}'"))
    return out


def _location(name: str, body: PreparedBody, place: Place) -> Location:
    if not isinstance(place, np.ndarray):
        return Location(name, body.name, body.nodes[place].copy())
    sizes = np.linalg.norm(place, axis=1)
    return Location(name, body.name, sizes @ body.nodes / sizes.sum(), "forces")


# -----------------------------------------------------------------------------------------------------------
# Model


@contextmanager
def _shown(progress: bool | None, bodies: Mapping[str, PreparedBody], ring: Ring, wheel: bool) -> Iterator[None]:
    """The steps of the work on a bar, each as it begins."""
    if not (sys.stderr.isatty() if progress is None else validation.flag("progress", progress)):
        yield
        return
    waves = {*ring.diameters, *sampled_waves(ring.faces.n_sectors)} if wheel else ring.diameters
    total, done = len(waves) + len(bodies) - 1 + (ring.faces.n_sectors // 2 + 1 if wheel else 0), count()
    with progress_stages("import", "step") as report:
        for body in bodies.values():
            body.step = lambda text: report(text, next(done), total)
        yield
        report("done", total, total)


def _reduced(
    bodies: Mapping[str, PreparedBody], laid: LaidContacts, places: Mapping[str, tuple[str, Place]],
    counts: Mapping[str, int], damping_ratio: float, ring: Ring, fixed: NodeSet | None, wheel: NodeSet | None,
    shapes: LocalSizes | None, rows: Sequence[StressRows],
) -> dict[str, Body]:  # fmt: skip
    """All bodies with their modes, by the way that the numbers given for each of them allow."""
    made = {}
    for name, body in bodies.items():
        own = {key: place for key, (owner, place) in places.items() if owner == name}
        wanted = Wanted(laid.ports[name], laid.rows[name], own, counts[name], damping_ratio, static_shapes=True)
        if name == "blade" and body.has_matrices:
            mask = held_components(body, wanted, fixed, ring)
            part = None if wheel is None else blade_part(body, wanted, ring, mask, wheel, laid.interfaces)
            kept = [0] if body.given.faster else []  # for the displacement by rotation
            kept += [] if part is None else sampled_waves(ring.faces.n_sectors)
            sector = cyclic_sectors(body, ring, mask, kept)
            made[name] = constrained_from_matrices(body, wanted, ring, sector, mask, rows)
            if part is not None:
                sizes = shapes or LocalSizes()
                made[name] = with_local_basis(made[name], body, wanted, sector, laid.interfaces, part, sizes)
        elif name == "blade":
            validation.check(wheel is None, "wheel", "a sector of a cyclic structure with its matrices", "modes alone")
            made[name] = constrained_from_modes(body, wanted, ring)
        else:
            made[name] = free_from_matrices(body, wanted) if body.has_matrices else free_from_modes(body, wanted)
    if laid.ports["ground"]:
        made["ground"] = Body("ground", "ground", laid.ports["ground"])
    return made


def _assembled(
    bodies: Mapping[str, PreparedBody], laid: LaidContacts, places: Mapping[str, tuple[str, Place]],
    made: Mapping[str, Body], rows: Sequence[StressRows], n_blades: int, check_units: bool,
) -> BuiltModel:  # fmt: skip
    """The model and its report."""
    if check_units:
        for name, body in bodies.items():
            check_lowest(body, made[name])
    model = Model(
        n_blades=n_blades,
        bodies=made,
        interfaces=laid.interfaces,
        locations={key: _location(key, bodies[b], place) for key, (b, place) in places.items()},
        contact=laid.stiffness,
        stress={own.name: own.set("blade", "bdamper.importers.build_model, mean over elements at nodes") for own in rows},
        meshes={
            name: picture_mesh(body.boundary, body.nodes, body.pictures) for name, body in bodies.items() if body.elements
        },
    )
    check_model(model, where="built model")
    parts = ("checks", "missing", "failed")
    told = {part: tuple(text for body in bodies.values() for text in getattr(body, part)) for part in parts}
    built = BuiltModel(model, {name: str(body.given) for name, body in bodies.items()}, laid.faces, **told)
    provenance = {
        "source": "; ".join(f"{name}: {body.given.source}" for name, body in bodies.items()),
        "made by": "bdamper.importers.build_model",
        "date": datetime.date.today().isoformat(),
        "report": str(built)[:20000],
    }
    return replace(built, model=replace(model, provenance=provenance))
