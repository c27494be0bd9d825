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
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from itertools import count
from math import gcd
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from bdamper.fem.local_basis import sampled_waves
from bdamper.fem.reduced_bodies import Place, Wanted, needed_nodal_diameters, picture_mesh
from bdamper.fem.sector_faces import SectorFaces, find_faces, match_faces, no_faces, tie_faces
from bdamper.fem.surface import corner_count, facets_on_nodes
from bdamper.importers.arrays import as_integers, number_table
from bdamper.importers.bodies import (
    constrained_from_matrices,
    constrained_from_modes,
    free_from_matrices,
    free_from_modes,
)
from bdamper.importers.contact_faces import (
    ContactFaces,
    LaidContacts,
    from_first_sector,
    lay_contacts,
)
from bdamper.importers.fe_body import BOUNDS, FEBody
from bdamper.importers.options import DAMPER_MODES, HARMONICS, Checks, Placement, Reduction, Sector
from bdamper.importers.plausibility import check_bodies, check_lowest
from bdamper.importers.prepared_body import ImportReport, PreparedBody, Ring
from bdamper.importers.stress_sets import stress_rows
from bdamper.model.model_file import save_model
from bdamper.model.structure import Body, Location, ModalBasis, Model
from bdamper.model.validation import check_model
from bdamper.util import validation
from bdamper.util.display import Plottable
from bdamper.util.errors import SettingError, check
from bdamper.util.formatting import short_repr
from bdamper.util.progress import one_thread, progress_stages, shows_progress
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
    for name, value in (
        {} if fields is None else validation.instance("forces", fields, Mapping, "a mapping")
    ).items():
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
    good = (
        numbers.ndim == 1
        and len(numbers)
        and forces.shape == (len(numbers), 3)
        and np.isfinite(forces).all()
    )
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
        Passed checks with their numerical results.
    missing : tuple of str
        Quantities that the model lacks, each with a remedy or a consequence.
    failed : tuple of str
        Failed comparisons with another program.
    bases : tuple of str
        Origin of masses and frequencies, and the node of the largest stress.

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
    bases: tuple[str, ...] = ()

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
            frequencies.append(
                f"{d:4d}  {shown}{'  ...' if len(values) > 6 else ''}  ({len(values)} modes)"
            )
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
                f"mass {free.mass:.6g} kg, centre ({', '.join(f'{c:.6g}' for c in free.centre)}) m, "
                f"radius {free.radius:.6g} m",
                f"principal moments of inertia {', '.join(f'{m:.6g}' for m in moments)} kg m2",
            ]
            if len(elastic := frequencies_of(free.bases[0])[6:12]):
                texts.append("elastic modes, Hz: " + "  ".join(f"{f:.6g}" for f in elastic))
        damping = [
            f"{body.name}: {body.damping_text}"
            for body in self.model.bodies.values()
            if body.damping_text
        ]
        parts |= {"Modal damping ratio": damping}
        parts |= {"Origin of these numbers": [*self.bases], "Interfaces": [*self.faces]}
        parts |= {"Checks passed": [*self.checks], "Not in this model": [*self.missing]}
        lines = ["Import report"]
        for title, texts in parts.items():
            if texts:
                lines += ["", title, *(f"  {text}" for text in texts)]
        return "\n".join(lines)


# ---- Model ----


INTEGRATED = 33
"""Largest period of an excitation, in sectors, for which a model has all nodal diameters for time integration."""


@validation.check_arguments
@one_thread
def build_model(
    blade: FEBody,
    damper: FEBody | Mapping[str, FEBody] | None = None,
    *,
    contacts: Sequence[ContactFaces],
    sector: Sector = Sector(),
    placement: Placement = Placement(),
    reduction: Reduction = Reduction(),
    locations: Mapping[str, object] | None = None,
    forces: Mapping[str, object] | None = None,
    checks: Checks = Checks(),
    progress: bool | None = None,
) -> BuiltModel:
    """Make a model from finite element bodies.

    Parameters
    ----------
    blade, damper : FEBody, FEBody or mapping of name to FEBody
        One sector (or a whole structure with ``Sector(n_blades=1)``), and optional free bodies in contact with a blade.
    contacts : sequence of ContactFaces
        Pairs of faces in contact.
    sector : Sector
        Number of sectors, their faces, clamped nodes, the blade, nodes with stress.
    placement : Placement
        Units and axes of the files.
    reduction : Reduction
        Nodal diameters, or engine orders that determine them, and numbers of modes.
    locations : mapping of name to location
        Points of excitation and response: a node number, a position (3,), or a tuple of the name of a body and one of
        these.
    forces : mapping of name to (node numbers, forces) or to a CSV file
        Fields of nodal forces (:func:`force_fields`).
    checks : Checks
        Frequencies of another program for comparison, and the treatment of failures.
    progress : bool, optional
        Whether to show a progress bar; by default only on a terminal.

    Raises
    ------
    ModelError, SettingError
        If bodies, contacts and settings do not fit together, or a check fails.
    """
    for name, option, kind in (
        ("sector", sector, Sector), ("placement", placement, Placement), ("reduction", reduction, Reduction),
        ("checks", checks, Checks),
    ):  # fmt: skip
        validation.instance(name, option, kind)
    report = ImportReport(checks.strict)
    bodies = _prepared(blade, damper, placement, report)
    contacts = _checked_contacts(contacts)
    faces = _sector_faces(bodies["blade"], sector)
    diameters, excited, reason = _diameters(faces.n_sectors, reduction, blade)
    report.checks.append(f"{len(diameters)} nodal diameters, {reason}")
    expected = checks.expected_frequencies or {}
    for d in expected:
        check(
            d in diameters, "expected_frequencies", f"nodal diameters out of {list(diameters)}", d
        )
    ring = Ring(faces, diameters, excited or diameters, expected)
    check_bodies(bodies, faces.n_sectors, checks.check_units, sector.elasticity)
    contacts, bodies = from_first_sector(contacts, bodies, faces.n_sectors)
    laid, places = (
        lay_contacts(contacts, bodies, faces.n_sectors),
        _locations(locations, bodies, forces),
    )
    rows = stress_rows(bodies["blade"], sector, laid, ring)
    with _shown(progress, len(bodies), ring, sector.blade_nodes is not None, report):
        made, shapes = _reduced(bodies, laid, places, ring, sector, reduction, rows)
    if checks.check_units:
        for name, body in bodies.items():
            check_lowest(body, made[name])
    bases = [
        *_origins(bodies, ring),
        *(_largest_stress(bodies["blade"], row, ring) for row in rows),
    ]
    return _assembled(bodies, laid, places, made, shapes, rows, faces.n_sectors, report, bases)


# -----------------------------------------------------------------------------------------------------------
# Settings


def _prepared(
    blade: FEBody,
    damper: FEBody | Mapping[str, FEBody] | None,
    placement: Placement,
    report: ImportReport,
) -> dict[str, PreparedBody]:
    """Return the bodies in SI units and in the axes of the model; the first one is the blade."""
    free = damper if isinstance(damper, Mapping) else {} if damper is None else {"damper": damper}
    reserved = [name for name in free if name in ("blade", "ground") or not isinstance(name, str)]
    validation.check(not reserved, "free bodies", "names other than 'blade' and 'ground'", reserved)
    out = {}
    for name, raw in {"blade": blade, **free}.items():
        body = validation.instance(name, raw, FEBody, "an FEBody, as read_arrays returns it")
        out[name] = PreparedBody(name, body, placement, report)
    return out


def _counts(free: Sequence[str], reduction: Reduction) -> dict[str, int]:
    """Return the number of modes of each body."""
    given = reduction.n_damper_modes
    named = given if isinstance(given, Mapping) else dict.fromkeys(free, given)
    validation.mapping("n_damper_modes", named, free, "free bodies")
    return {"blade": reduction.n_modes, **dict.fromkeys(free, DAMPER_MODES), **named}


def _checked_contacts(contacts: Sequence[ContactFaces]) -> tuple[ContactFaces, ...]:
    several = isinstance(contacts, Iterable) and not isinstance(contacts, str)
    out = (
        tuple(validation.instance("contacts", contact, ContactFaces) for contact in contacts)
        if several
        else ()
    )
    validation.check_value(out, "contacts", "a sequence of one or more ContactFaces", contacts)
    names = [contact.name for contact in out]
    validation.check_value(len(set(names)) == len(names), "contacts", "each name once", names)
    return out


def _diameters(
    n_blades: int, reduction: Reduction, blade: FEBody
) -> tuple[tuple[int, ...], tuple[int, ...], str]:
    """Return the nodal diameters of a model, the excited nodal diameters, and the reason for the choice."""
    given, harmonics = reduction.nodal_diameters, reduction.harmonics
    orders: Sequence[int] = reduction.engine_order or ()  # type: ignore[assignment]  # checked by the class
    excited = tuple(sorted({min(order % n_blades, -order % n_blades) for order in orders}))
    listed = (
        None
        if blade.stiffness is not None or not blade.modes
        else {modes.nodal_diameter for modes in blade.modes}
    )
    if given is not None or not orders:
        if given is None and n_blades > 1 and listed is None:
            raise SettingError(
                "nodal diameters: expected engine_order or nodal_diameters, found neither"
            )
        chosen = given if given is not None else [0] if n_blades == 1 else sorted(listed or ())
        return (
            tuple(sorted({0, *validation.integers("nodal_diameters", chosen, most=n_blades // 2)})),
            excited,
            "given",
        )
    most = harmonics or HARMONICS
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


def _sector_faces(body: PreparedBody, sector: Sector) -> SectorFaces:
    """Return the sector faces, given or found in the mesh; faces with different meshes are tied by interpolation."""
    n_blades = sector.n_blades
    if n_blades == 1:
        return no_faces()
    tolerance = BOUNDS.sector_faces * body.size
    if sector.faces is None:
        faces = (
            find_faces(body.nodes, body.boundary, n_blades, tolerance) if body.elements else None
        )
        if faces is None:
            expected = "the two faces of the sector" + (
                "" if n_blades else ", and n_blades (1 if nothing repeats)"
            )
            raise SettingError(
                f"sector faces: expected {expected}, as no rotation carries faces of elements onto others"
            )
        body.passed(f"sector faces: found from the geometry, {faces.n_sectors} sectors")
        return faces
    first, second = (body.node_set(s, "sector faces") for s in sector.faces)
    angle, exact = _angle_between(body, first, second), n_blades is not None
    nearest = max(2, round(2.0 * np.pi / angle))
    n_blades = n_blades or nearest
    apart = f"the faces are {np.rad2deg(angle):.6g} degrees apart, nearest are {nearest} sectors"
    deviation = 1.0 - 2.0 * np.pi / n_blades / angle
    alike = n_blades == nearest and abs(deviation) <= sector.angle_tolerance
    body.require(
        exact or alike,
        "sector faces",
        f"360/N degrees within {100 * sector.angle_tolerance:g} %",
        apart,
    )
    if not exact:
        body.passed(
            f"{n_blades} sectors, from the {np.rad2deg(angle):.4g} degrees between the sector faces"
        )
    problems, pitches = [], (None, angle) if alike else (None,)
    for pitch in pitches:
        for left, right, words in (
            (first, second, "the first set lies toward -X"), (second, first, "the sets were exchanged"),
        ):  # fmt: skip
            try:
                matched = match_faces(body.nodes, left, right, n_blades, tolerance, pitch)
            except ValueError as error:
                problems.append(str(error))
                continue
            body.passed(
                f"sector faces: {len(left)} pairs of nodes match within {tolerance:.2g} m; {words}"
            )
            _report_deviation(body, pitch, n_blades)
            return matched
    expected = f"two sets of nodes of which a rotation by 2 pi/{n_blades} about the axis carries one onto the other"
    found = f"{apart}; {problems[0]}; the other way: {problems[1].split(': ')[-1]}"
    body.require(body.elements, "sector faces", expected, found)
    # if the meshes differ, the angle between the centres of the faces is biased; one sector more or less may fit better
    counts = [(n, None) for n in range(max(n_blades - 1, 2), n_blades + 2)] + [
        (n_blades, pitch) for pitch in pitches[1:]
    ]
    with body.refusing("sector faces", expected):
        ways = [
            (n, pitch, pair) for n, pitch in counts for pair in ((first, second), (second, first))
        ]
        tied = [
            (tie_faces(body.nodes, body.boundary, *pair, n, pitch), pitch)
            for n, pitch, pair in ways
        ]
    best, pitch = min(tied, key=lambda way: way[0].distance)
    if exact:
        fits = best.n_sectors != n_blades and best.distance <= BOUNDS.tied_faces * body.size
        body.require(not fits, "sector faces", expected, f"faces that fit {best.n_sectors} sectors")
        best, pitch = min(
            (way for way in tied if way[0].n_sectors == n_blades), key=lambda way: way[0].distance
        )
    elif best.n_sectors != n_blades:
        n_blades = best.n_sectors
        body.passed(f"{n_blades} sectors fit best")
    limit = (
        sector.face_tolerance * _mean_edge(body, best.independent)
        if alike
        else BOUNDS.tied_faces * body.size
    )
    found += (
        f"; meshes that differ are at best {best.distance:.3g} m apart, tolerance {limit:.3g} m"
    )
    body.require(best.distance <= limit, "sector faces", expected, found)
    tied_nodes = f"{len(best.dependent)} nodes tied by interpolation to {len(best.independent)}"
    body.passed(
        f"sector faces: meshes that differ, {tied_nodes}, at most {best.distance:.2g} m apart"
    )
    _report_deviation(body, pitch, n_blades)
    return best


def _angle_between(body: PreparedBody, first: NDArray, second: NDArray) -> float:
    """Return the angle between the centres of two faces, rad."""
    angles = [np.arctan2(*body.nodes[nodes, :2].mean(axis=0)) for nodes in (first, second)]
    return max(float(abs((angles[1] - angles[0] + np.pi) % (2.0 * np.pi) - np.pi)), 1e-3)


def _report_deviation(body: PreparedBody, angle: float | None, n_blades: int) -> None:
    if angle is not None:
        degrees, pitch = np.rad2deg(angle), 360.0 / n_blades
        found = f"{degrees:.6g} degrees apart, {100.0 * (degrees / pitch - 1.0):+.2g} % from {pitch:.6g}"
        body.passed(f"sector faces: {found}; tied as if they were one pitch apart")


def _mean_edge(body: PreparedBody, nodes: NDArray) -> float:
    """Return the mean edge of the outer faces of elements on some nodes, m."""
    groups = facets_on_nodes(body.boundary, nodes).groups
    corners = [body.nodes[group[:, : corner_count(group.shape[1])]] for group in groups]
    return float(
        np.concatenate(
            [np.linalg.norm(x - np.roll(x, 1, axis=1), axis=2).ravel() for x in corners]
        ).mean()
    )


def _locations(
    locations: Mapping[str, object] | None, bodies: Mapping[str, PreparedBody], forces: Mapping[str, object] | None,
) -> dict[str, tuple[str, Place]]:  # fmt: skip
    """Return body and node (or field of forces) of each named location."""
    out: dict[str, tuple[str, Place]] = {
        name: ("blade", f) for name, f in force_fields(forces, bodies["blade"]).items()
    }
    named = (
        {}
        if locations is None
        else validation.instance("locations", locations, Mapping, "a mapping")
    )
    for name, value in named.items():
        body = "blade"
        if isinstance(value, tuple) and len(value) == 2 and isinstance(value[0], str):
            body, value = value
        validation.check(
            body in bodies, f"location '{name}'", f"a body out of {sorted(bodies)}", f"'{body}'"
        )
        validation.check(
            name not in out,
            f"location '{name}'",
            "a name that forces do not have",
            f"'{name}' twice",
        )
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
def _shown(
    progress: bool | None, n_bodies: int, ring: Ring, local: bool, report: ImportReport
) -> Iterator[None]:
    """Show a progress bar with the steps of the work."""
    waves = {*ring.diameters, *sampled_waves(ring.faces.n_sectors)} if local else ring.diameters
    total, done = (
        len(waves) + n_bodies - 1 + (ring.faces.n_sectors // 2 + 1 if local else 0),
        count(),
    )
    with progress_stages(shows_progress(progress), "import", "step") as show:
        report.step = lambda text: show(text, next(done), total)
        yield


def _reduced(
    bodies: Mapping[str, PreparedBody], laid: LaidContacts, places: Mapping[str, tuple[str, Place]], ring: Ring,
    sector: Sector, reduction: Reduction, rows: Sequence[StressRows],
) -> tuple[dict[str, Body], dict[int, NDArray]]:  # fmt: skip
    """Reduce all bodies, from matrices or from modes; return them with the mode shapes for pictures."""
    made, pictures = {}, dict[int, NDArray]()
    counts = _counts([name for name in bodies if name != "blade"], reduction)
    for name, body in bodies.items():
        located = {key: place for key, (owner, place) in places.items() if owner == name}
        wanted = Wanted(
            laid.ports[name],
            laid.rows[name],
            located,
            counts[name],
            reduction.damping_ratio,
            static_shapes=True,
        )
        if name == "blade" and body.has_matrices:
            options = sector, reduction.local_sizes, laid.interfaces, rows
            made[name], pictures = constrained_from_matrices(body, wanted, ring, *options)
        elif name == "blade":
            alone = sector.blade_nodes is None
            validation.check(
                alone,
                "blade_nodes",
                "a sector of a cyclic structure with its matrices",
                "modes alone",
            )
            made[name], pictures = constrained_from_modes(body, wanted, ring)
        else:
            made[name] = (free_from_matrices if body.has_matrices else free_from_modes)(
                body, wanted
            )
    if laid.ports["ground"]:
        made["ground"] = Body("ground", "ground", laid.ports["ground"])
    return made, pictures


def _origins(bodies: Mapping[str, PreparedBody], ring: Ring) -> Iterator[str]:
    """Return the sources of masses and frequencies of the report, and of the frequencies compared with them."""
    for name, body in bodies.items():
        files = "stiffness and mass matrix of the files"
        if name != "blade":
            source = "mass matrix" if body.has_matrices else "given MassProperties"
            yield f"{name}: mass, centre and inertia from the {source}"
            continue
        own = sorted(
            {
                *ring.expected,
                *(modes.nodal_diameter for modes in body.raw.modes if body.has_matrices),
            }
        )
        compared = (
            f"compared with those of the program at nodal diameters {', '.join(map(str, own))}"
        )
        compared = (
            compared
            if own
            else "not compared with those of the program (expected_frequencies, or a result file)"
        )
        yield f"{name}: frequencies from {f'{files}, {compared}' if body.has_matrices else 'the modes of the file'}"


def _largest_stress(body: PreparedBody, rows: StressRows, ring: Ring) -> str:
    """Return the node of the largest von Mises stress in the lowest mode of the first excited nodal diameter."""
    d = ring.pictured[0]
    node = rows.largest(d)
    place = ", ".join(f"{x:.6g}" for x in body.raw.nodes[node])
    where = f"node {body.raw.numbers[node]} at ({place}) in the file"
    return f"stress '{rows.name}': largest at {where}, lowest mode of nodal diameter {d}"


def _assembled(
    bodies: Mapping[str, PreparedBody], laid: LaidContacts, places: Mapping[str, tuple[str, Place]],
    made: Mapping[str, Body], pictures: Mapping[int, NDArray], rows: Sequence[StressRows], n_blades: int,
    report: ImportReport, bases: Sequence[str],
) -> BuiltModel:  # fmt: skip
    """Return the model with its report."""
    averaged = "bdamper.importers.build_model, mean over elements at nodes"
    model = Model(
        n_blades=n_blades,
        bodies=made,
        interfaces=laid.interfaces,
        locations={key: _location(key, bodies[b], place) for key, (b, place) in places.items()},
        contact=laid.stiffness,
        stress={
            row.name: row.set("blade", averaged, np.asarray(bodies["blade"].raw.numbers))
            for row in rows
        },
        meshes={
            name: picture_mesh(body.boundary, body.nodes, pictures if name == "blade" else {})
            for name, body in bodies.items()
            if body.elements
        },
    )
    check_model(model, where="built model")
    sources = {name: str(body.raw) for name, body in bodies.items()}
    checks, missing, failed = map(tuple, (report.checks, report.missing, report.failed))
    built = BuiltModel(model, sources, laid.faces, checks, missing, failed, tuple(bases))
    provenance = {
        "source": "; ".join(f"{name}: {body.raw.source}" for name, body in bodies.items()),
        "made by": "bdamper.importers.build_model",
        "date": datetime.date.today().isoformat(),
        "report": str(built)[:20000],
    }
    return replace(built, model=replace(model, provenance=provenance))
