"""Models from the finite element bodies of any program: checks, reduction, contact points and a report.

The sector is called "blade" in the model, and a single free body "damper".  Several free bodies have their own names.  The
reduction is the same as for the reference models (:mod:`bdamper.fem`).

The import computes quantities that are easily mistaken, and the report lists them: the sector face toward +X, the sector in
which a damper meets its neighbour, the direction of travelling waves, and mass, centre of mass and inertia.

:func:`force_fields` converts nodal forces, such as a pressure field on a blade, to SI units and the axes of the model.
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
from bdamper.importers.prepared_body import ImportReport, NodeSet, Placement, PreparedBody, Ring
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


# ---- Fields of nodal forces ----


EXPECTED = "(node numbers (n,), forces (n, 3)), or a CSV file of rows: node, Re x, Im x, Re y, Im y, Re z, Im z"


def force_fields(fields: Mapping[str, object] | None, body: PreparedBody) -> dict[str, NDArray]:
    """Return the complex nodal forces (n_nodes, 3) of each field by name, N.

    Parameters
    ----------
    fields : mapping of name to (numbers, forces) or path, optional
        Node numbers (n,) and complex forces (n, 3) in the axes and units of the file, or a CSV file with both.  Comments
        start with ``#``.  Forces on the same node are added.
    body : PreparedBody
        Body on which the forces act.

    Raises
    ------
    SettingError, ModelError
        If a value is not a field of forces, all forces are zero, or a node does not exist.  The message names the field.
    """
    out = {}
    for name, value in ({} if fields is None else validation.instance("forces", fields, Mapping, "a mapping")).items():
        numbers, forces = _table(f"forces '{name}'", value)
        units, out[name] = body.placement.units, np.zeros((len(body.nodes), 3), complex)
        in_si = units.mass * units.length * forces @ body.placement.rotation.T
        np.add.at(out[name], body.index(numbers, f"forces '{name}'"), in_si)
        validation.check(out[name].any(), f"forces '{name}'", "forces other than 0", "zeros only")
    return out


def _table(item: str, value: Any) -> tuple[NDArray, NDArray]:
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


# ---- Result of an import ----


def frequencies_of(basis: ModalBasis) -> NDArray:
    """Return the natural frequencies (n_modes,) of a basis, Hz."""
    return np.sqrt(basis.omega2[: basis.n_natural]) / (2.0 * np.pi)


@short_repr
@dataclass(frozen=True)
class BuiltModel(Plottable):
    """Imported model with its report, which ``print`` shows.

    Parameters
    ----------
    model : Model
    sources : mapping of body to str
        Files and numbers of nodes, elements and equations.
    faces : tuple of str
        Area, overlap and normal of each interface.
    checks : tuple of str
        Passed checks, with figures.
    missing : tuple of str
        Quantities that the model lacks, each with a remedy or a consequence.
    failed : tuple of str
        Failed comparisons with another program.

    Notes
    -----
    ``plot`` draws the bodies with faces and points (:func:`bdamper.plot.plot_import_report`).
    """

    model: Model
    sources: Mapping[str, str] = field(default_factory=dict)
    faces: tuple[str, ...] = ()
    checks: tuple[str, ...] = ()
    missing: tuple[str, ...] = ()
    failed: tuple[str, ...] = ()

    @property
    def frequencies(self) -> dict[int, NDArray]:
        """Natural frequencies (n_modes,) of the sector at each nodal diameter, Hz."""
        return {d: frequencies_of(basis) for d, basis in self.model.bodies["blade"].bases.items()}

    def save(self, path: FilePath) -> None:
        """Write the model file, with the report in its provenance."""
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
            parts[f"Free body {free.name}, recomputed"] = texts = [
                f"mass {free.mass:.6g} kg, centre ({', '.join(f'{c:.6g}' for c in free.centre)}) m",
                f"principal moments of inertia {', '.join(f'{m:.6g}' for m in moments)} kg m2",
            ]
            if len(elastic := frequencies_of(free.bases[0])[6:12]):
                texts.append("elastic modes, Hz: " + "  ".join(f"{f:.6g}" for f in elastic))
        parts |= {"Interfaces": [*self.faces], "Checks passed": [*self.checks], "Not in this model": [*self.missing]}
        lines = ["Import report"]
        for title, texts in parts.items():
            if texts:
                lines += ["", title, *(f"  {text}" for text in texts)]
        return "\n".join(lines)


# ---- Model ----


HARMONICS = 9
"""Default number of harmonics that determine the nodal diameters of a model."""
DAMPER_MODES = 16
"""Default number of modes of a free body, including its six rigid ones."""
INTEGRATED = 33
"""Largest period of an excitation, in sectors, for which a model has all nodal diameters for time integration."""


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
        One sector (or a whole structure if ``n_blades=1``), and optional free bodies in contact with a blade.
    n_blades, contacts : int, sequence of ContactFaces
        Number of sectors (by default from the sector faces), and pairs of faces in contact.
    sector_faces, fixed : (set, set), set
        Faces at which the sector repeats (by default found in the mesh), and clamped nodes.
    locations, forces : mapping of name to node, position or (body, either), of name to (nodes, forces) or CSV file
        Points of excitation and response, and fields of nodal forces (:func:`force_fields`).
    engine_order, harmonics, nodal_diameters : int or sequence of int, int, sequence of int
        Nodal diameters (0 to N/2, 0 is added), or engine orders and harmonics that determine them (9 and time integration).
    n_modes, n_damper_modes, damping_ratio : int, int or mapping of name to int, float
        Modes of the sector at each nodal diameter and of free bodies (with six rigid modes); damping of elastic modes.
    units, axis, radial, origin : str or Units, (3,) float
        Units and axes of the files, see ``bdamper.importers.prepared_body.Placement``.
    expected_frequencies, strict : mapping of nodal diameter to frequencies (Hz), bool
        Results of another program, compared to 1 %, and whether a failed comparison (also with modes) is an error.
    wheel, wheel_shapes : set, LocalSizes
        All nodes of the blade up to the disk, for mistuned bladed disks, and the sizes of its basis.
    stress, elasticity : set or mapping of name to set, (Young's modulus, Poisson's ratio)
        Nodes with stress (extra ``bdamper[fe]``), and elastic constants in place of the constants of the file.
    check_units, progress : bool
        Whether implausible sizes, densities and frequencies are errors, and whether progress is shown (on a terminal).

    Raises
    ------
    ModelError, SettingError
        If bodies, contacts and settings do not fit together, or a check fails.
    """
    damping_ratio = validation.number("damping_ratio", damping_ratio, least=0.0, below=1.0)
    report = ImportReport(validation.flag("strict", strict))
    bodies = _prepared(blade, damper, Placement(axis, radial, origin, units))
    counts = _counts(list(bodies)[1:], n_modes, n_damper_modes)
    contacts = _checked_contacts(contacts)
    faces = _sector_faces(bodies["blade"], sector_faces, n_blades, report)
    diameters, excited, reason = _diameters(faces.n_sectors, engine_order, harmonics, nodal_diameters, blade)
    report.checks.append(f"{len(diameters)} nodal diameters, {reason}")
    ring = Ring(faces, diameters, excited or diameters, _known_frequencies(expected_frequencies, diameters))
    _check_bodies(bodies, faces.n_sectors, validation.flag("check_units", check_units), report)
    contacts, bodies = from_first_sector(contacts, bodies, faces.n_sectors, report)
    laid, places = lay_contacts(contacts, bodies, faces.n_sectors), _locations(locations, bodies, forces, report)
    rows = stress_rows(bodies["blade"], stress, elasticity, laid, ring, report)
    with _shown(progress, len(bodies), ring, wheel is not None, report):
        made, shapes = _reduced(bodies, laid, places, counts, damping_ratio, ring, fixed, wheel, wheel_shapes, rows, report)
    if check_units:
        for name, body in bodies.items():
            check_lowest(body, made[name], report)
    return _assembled(bodies, laid, places, made, shapes, rows, faces.n_sectors, report)


# -----------------------------------------------------------------------------------------------------------
# Settings


def _prepared(
    blade: FEBody, damper: FEBody | Mapping[str, FEBody] | None, placement: Placement
) -> dict[str, PreparedBody]:
    """Return the bodies in SI units and in the axes of the model; the first one is the blade."""
    free = damper if isinstance(damper, Mapping) else {} if damper is None else {"damper": damper}
    reserved = [name for name in free if name in ("blade", "ground") or not isinstance(name, str)]
    validation.check(not reserved, "free bodies", "names other than 'blade' and 'ground'", reserved)
    out = {}
    for name, raw in {"blade": blade, **free}.items():
        body = validation.instance(name, raw, FEBody, "an FEBody, as read_arrays returns it")
        out[name] = PreparedBody(name, body, placement)
    return out


def _counts(free: Sequence[str], n_modes: int, n_damper_modes: int | Mapping[str, int]) -> dict[str, int]:
    """Return the number of modes of each body."""
    named = n_damper_modes if isinstance(n_damper_modes, Mapping) else dict.fromkeys(free, n_damper_modes)
    validation.mapping("n_damper_modes", named, free, "free bodies")
    counts = {name: validation.integer("n_damper_modes", named.get(name, DAMPER_MODES), 6, BOUNDS.modes) for name in free}
    return {"blade": validation.integer("n_modes", n_modes, 1, BOUNDS.modes), **counts}


def _check_bodies(
    bodies: Mapping[str, PreparedBody], n_blades: int, check_units: bool, report: ImportReport
) -> None:
    check_radial(bodies["blade"], n_blades, report)
    for body in bodies.values():
        body.check_repeated()
        if body.has_matrices:
            check_not_swapped(body)
            if body.name == "blade":  # check_rigid_motion checks a free body
                check_table(body, report)
        check_corners(body)
        if check_units:
            check_sizes(body, report)


def _known_frequencies(
    frequencies: Mapping[int, Sequence[float]] | None, diameters: tuple[int, ...]
) -> Mapping[int, Sequence[float]]:
    known = validation.instance("expected_frequencies", {} if frequencies is None else frequencies, Mapping, "a mapping")
    for d, values in known.items():
        check(d in diameters, "expected_frequencies", f"nodal diameters out of {list(diameters)}", d)
        validation.numbers(f"expected_frequencies at nodal diameter {d}", values, above=0.0, unit="Hz")
    return known


def _checked_contacts(contacts: Sequence[ContactFaces]) -> tuple[ContactFaces, ...]:
    several = isinstance(contacts, Iterable) and not isinstance(contacts, str)
    out = tuple(validation.instance("contacts", contact, ContactFaces) for contact in contacts) if several else ()
    validation.check_value(out, "contacts", "a sequence of one or more ContactFaces", contacts)
    names = [contact.name for contact in out]
    validation.check_value(len(set(names)) == len(names), "contacts", "each name once", names)
    return out


def _diameters(
    n_blades: int, engine_order: int | Sequence[int] | None, harmonics: int | None, nodal_diameters: Sequence[int] | None,
    blade: FEBody,
) -> tuple[tuple[int, ...], tuple[int, ...], str]:  # fmt: skip
    """Return the nodal diameters of a model, the excited ones among them, and the reason for the choice."""
    orders = () if engine_order is None else validation.integers("engine_order", np.atleast_1d(engine_order))
    excited = tuple(sorted({min(order % n_blades, -order % n_blades) for order in orders}))
    listed = None if blade.stiffness is not None or not blade.modes else {modes.nodal_diameter for modes in blade.modes}
    if nodal_diameters is not None or not orders:
        if nodal_diameters is None and n_blades > 1 and listed is None:
            raise SettingError("nodal diameters: expected engine_order or nodal_diameters, found neither")
        chosen = nodal_diameters if nodal_diameters is not None else [0] if n_blades == 1 else sorted(listed or ())
        return tuple(sorted({0, *validation.integers("nodal_diameters", chosen, most=n_blades // 2)})), excited, "given"
    most = HARMONICS if harmonics is None else validation.integer("harmonics", harmonics, 1, 64)
    reason = f"for {most} harmonics of engine order {', '.join(map(str, orders))}"
    wanted = set[int]()
    for order in orders:
        distinct = n_blades // gcd(n_blades, order)  # period of the excitation in sectors
        in_time = distinct if harmonics is None and distinct <= INTEGRATED else 1
        wanted.update(needed_nodal_diameters(n_blades, order, max(most, in_time)))
    if harmonics is None:
        reason += " and time integration"
        wanted &= listed or wanted
    return tuple(sorted({0, *wanted})), excited, reason


def _sector_faces(
    body: PreparedBody, node_sets: tuple[NodeSet, NodeSet] | None, n_blades: int | None, report: ImportReport
) -> SectorFaces:
    """Return the sector faces, given or found in the mesh; faces with different meshes are tied by interpolation."""
    n_blades = None if n_blades is None else validation.integer("n_blades", n_blades, least=1)
    if n_blades == 1:
        return no_faces()
    tolerance = BOUNDS.sector_faces * body.size
    if node_sets is None:
        faces = find_faces(body.nodes, body.boundary, n_blades, tolerance) if body.elements else None
        if faces is None:
            expected = "the two faces of the sector" + ("" if n_blades else ", and n_blades (1 if nothing repeats)")
            raise SettingError(f"sector_faces: expected {expected}, as no rotation carries faces of elements onto others")
        report.checks.append(f"sector faces: found from the geometry, {faces.n_sectors} sectors")
        return faces
    if isinstance(node_sets, str) or not isinstance(node_sets, Sequence) or len(node_sets) != 2:
        raise validation.invalid("sector_faces", "two sets of nodes, the faces at which the sector repeats", node_sets)
    first, second = (body.node_set(s, "sector_faces") for s in node_sets)
    if n_blades is None:
        n_blades = _sectors_between(body, first, second, report)
    problems = []
    for left, right, words in ((first, second, "the first set lies toward -X"), (second, first, "the sets were exchanged")):
        try:
            matched = match_faces(body.nodes, left, right, n_blades, tolerance)
            report.checks.append(f"sector faces: {len(left)} pairs of nodes match within {tolerance:.2g} m; {words}")
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
    report.checks.append(f"sector faces: meshes that differ, {tied_nodes}, at most {best.distance:.2g} m apart")
    return best


def _sectors_between(body: PreparedBody, first: NDArray, second: NDArray, report: ImportReport) -> int:
    """Return the number of sectors from the mean angle between two faces."""
    angles = [np.arctan2(*body.nodes[nodes, :2].mean(axis=0)) for nodes in (first, second)]
    between = abs((angles[1] - angles[0] + np.pi) % (2.0 * np.pi) - np.pi)
    n_blades = max(2, round(2.0 * np.pi / max(between, 1e-3)))
    report.checks.append(f"{n_blades} sectors, from the {np.rad2deg(between):.4g} degrees between the sector faces")
    return n_blades


def _locations(
    locations: Mapping[str, object] | None, bodies: Mapping[str, PreparedBody], forces: Mapping[str, object] | None,
    report: ImportReport,
) -> dict[str, tuple[str, Place]]:  # fmt: skip
    """Return body and node (or field of forces) of each named location."""
    out: dict[str, tuple[str, Place]] = {name: ("blade", f) for name, f in force_fields(forces, bodies["blade"]).items()}
    named = {} if locations is None else validation.instance("locations", locations, Mapping, "a mapping")
    for name, value in named.items():
        body = "blade"
        if isinstance(value, tuple) and len(value) == 2 and isinstance(value[0], str):
            body, value = value
        validation.check(body in bodies, f"location '{name}'", f"a body out of {sorted(bodies)}", f"'{body}'")
        validation.check(name not in out, f"location '{name}'", "a name that forces do not have", f"'{name}' twice")
        out[name] = (body, bodies[body].node(value, f"location '{name}'", report))
    return out


def _location(name: str, body: PreparedBody, place: Place) -> Location:
    if not isinstance(place, np.ndarray):
        return Location(name, body.name, body.nodes[place].copy())
    sizes = np.linalg.norm(place, axis=1)
    return Location(name, body.name, sizes @ body.nodes / sizes.sum(), "forces")


# -----------------------------------------------------------------------------------------------------------
# Model


@contextmanager
def _shown(progress: bool | None, n_bodies: int, ring: Ring, wheel: bool, report: ImportReport) -> Iterator[None]:
    """Show a progress bar with the steps of the work."""
    if not (sys.stderr.isatty() if progress is None else validation.flag("progress", progress)):
        yield
        return
    waves = {*ring.diameters, *sampled_waves(ring.faces.n_sectors)} if wheel else ring.diameters
    total, done = len(waves) + n_bodies - 1 + (ring.faces.n_sectors // 2 + 1 if wheel else 0), count()
    with progress_stages("import", "step") as show:
        report.step = lambda text: show(text, next(done), total)
        yield
        show("done", total, total)


def _reduced(
    bodies: Mapping[str, PreparedBody], laid: LaidContacts, places: Mapping[str, tuple[str, Place]],
    counts: Mapping[str, int], damping_ratio: float, ring: Ring, fixed: NodeSet | None, wheel: NodeSet | None,
    shapes: LocalSizes | None, rows: Sequence[StressRows], report: ImportReport,
) -> tuple[dict[str, Body], dict[int, NDArray]]:  # fmt: skip
    """Reduce all bodies, from matrices or from modes; return them with the mode shapes for pictures."""
    made, pictures = {}, dict[int, NDArray]()
    for name, body in bodies.items():
        located = {key: place for key, (owner, place) in places.items() if owner == name}
        wanted = Wanted(laid.ports[name], laid.rows[name], located, counts[name], damping_ratio, static_shapes=True)
        if name == "blade" and body.has_matrices:
            mask = held_components(body, wanted, fixed, ring, report)
            part = None if wheel is None else blade_part(body, wanted, ring, mask, wheel, laid.interfaces, report)
            cached = [0] if body.raw.faster else []  # for the displacement by rotation
            cached += [] if part is None else sampled_waves(ring.faces.n_sectors)
            sector = cyclic_sectors(body, ring, mask, cached, report)
            made[name], pictures = constrained_from_matrices(body, wanted, ring, sector, mask, rows, report)
            if part is not None:
                sizes = shapes or LocalSizes()
                made[name] = with_local_basis(made[name], body, wanted, sector, laid.interfaces, part, sizes, report)
        elif name == "blade":
            validation.check(wheel is None, "wheel", "a sector of a cyclic structure with its matrices", "modes alone")
            made[name], pictures = constrained_from_modes(body, wanted, ring, report)
        else:
            made[name] = (free_from_matrices if body.has_matrices else free_from_modes)(body, wanted, report)
    if laid.ports["ground"]:
        made["ground"] = Body("ground", "ground", laid.ports["ground"])
    return made, pictures


def _assembled(
    bodies: Mapping[str, PreparedBody], laid: LaidContacts, places: Mapping[str, tuple[str, Place]],
    made: Mapping[str, Body], pictures: Mapping[int, NDArray], rows: Sequence[StressRows], n_blades: int,
    report: ImportReport,
) -> BuiltModel:  # fmt: skip
    """Return the model with its report."""
    model = Model(
        n_blades=n_blades,
        bodies=made,
        interfaces=laid.interfaces,
        locations={key: _location(key, bodies[b], place) for key, (b, place) in places.items()},
        contact=laid.stiffness,
        stress={row.name: row.set("blade", "bdamper.importers.build_model, mean over elements at nodes") for row in rows},
        meshes={
            name: picture_mesh(body.boundary, body.nodes, pictures if name == "blade" else {})
            for name, body in bodies.items()
            if body.elements
        },
    )
    check_model(model, where="built model")
    sources, texts = {name: str(body.raw) for name, body in bodies.items()}, (report.checks, report.missing, report.failed)
    built = BuiltModel(model, sources, laid.faces, *map(tuple, texts))
    provenance = {
        "source": "; ".join(f"{name}: {body.raw.source}" for name, body in bodies.items()),
        "made by": "bdamper.importers.build_model",
        "date": datetime.date.today().isoformat(),
        "report": str(built)[:20000],
    }
    return replace(built, model=replace(model, provenance=provenance))
