"""Models from the finite element bodies of any program: checks, reduction, contact points and a
report.

The sector is called "blade" in the model, and a single free body "damper".  Several free bodies
have their own names.  The reduction is the same as for the reference models (:mod:`bdamper.fem`).

The import computes quantities that users often get wrong, and the report lists them: the sector
face toward +X, the sector in which a damper meets its neighbour, the direction of travelling waves,
and mass, centre of mass and inertia.

:func:`force_fields` converts nodal forces, such as a pressure field on a blade, to SI units and the
axes of the model.
"""

from __future__ import annotations

import datetime
import os
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import gcd
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from bdamper.contact.partial_contact import SMALL_SHIFT, WHOLE, coupling_of_default, partial_contact
from bdamper.contact.residual_flexibility import ResidualModes
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
    ring_from_matrices,
)
from bdamper.importers.contact_faces import (
    ContactFaces,
    LaidContacts,
    from_first_sector,
    lay_contacts,
)
from bdamper.importers.fe_body import BOUNDS, FEBody, Units
from bdamper.importers.fe_body import UNITS as UNITS_BY_NAME
from bdamper.importers.options import (
    DAMPER_MODES,
    HARMONICS,
    Checks,
    NodeSet,
    Placement,
    Reduction,
    Sector,
)
from bdamper.importers.plausibility import check_bodies, check_lowest
from bdamper.importers.prepared_body import CyclicStructure, ImportReport, PreparedBody
from bdamper.importers.stress_sets import check_surface, stress_rows
from bdamper.model.loads import BASE
from bdamper.model.model_file import save_model
from bdamper.model.structure import Body, Location, ModalBasis, Model
from bdamper.model.validation import check_model
from bdamper.util import validation
from bdamper.util.display import Plottable
from bdamper.util.errors import ModelError, SettingError, check
from bdamper.util.formatting import (
    amount,
    area_text,
    counted,
    listed,
    percent,
    sentence,
    short_repr,
    without_rounding,
)
from bdamper.util.progress import Steps, one_thread, progress_stages, shows_progress
from bdamper.util.statement import Row, Statement
from bdamper.util.storage import FilePath

if TYPE_CHECKING:
    from bdamper.fem.element_stress import StressRows


# ---- Fields of nodal forces ----


EXPECTED = (
    "(node numbers (n,), forces (n, 3)), or a CSV file of rows: "
    "node, Re x, Im x, Re y, Im y, Re z, Im z"
)


def force_fields(fields: Mapping[str, object] | None, body: PreparedBody) -> dict[str, NDArray]:
    """Return the complex nodal forces (n_nodes, 3) of each field by name, N.

    Parameters
    ----------
    fields : mapping of name to (numbers, forces) or path, optional
        Node numbers (n,) and complex forces (n, 3) in the axes and units of the file, or a CSV file
        with both.  Comments start with ``#``.  Forces on the same node are added.
    body : PreparedBody
        Body on which the forces act.

    Raises
    ------
    SettingError, ModelError
        If a value is not a field of forces, all forces are zero, or a node does not exist.  The
        message gives the field.
    """
    named = {} if fields is None else validation.instance("forces", fields, Mapping, "a mapping")
    units = body.placement.units
    by_name = {}
    for name, value in named.items():
        item = f"forces '{name}'"
        numbers, forces = _table(item, value)
        # a force is mass times length over squared seconds; rows of forces are turned into the
        # axes of the model
        in_si = units.mass * units.length * forces @ body.placement.rotation.T
        field_of_forces = np.zeros((len(body.nodes), 3), complex)
        # a node may be listed several times
        np.add.at(field_of_forces, body.index(numbers, item), in_si)
        validation.check(field_of_forces.any(), item, "forces other than 0", "zeros only")
        by_name[name] = field_of_forces
    return by_name


def _table(item: str, value: Any) -> tuple[NDArray, NDArray]:
    """Return node numbers (n,) and complex forces (n, 3) from arrays or from a file."""
    if isinstance(value, str | os.PathLike):
        # node number, then real and imaginary part along each axis
        table = number_table(Path(value), 7)
        numbers = table[:, 0]
        real = table[:, 1::2]
        imaginary = table[:, 2::2]
        return as_integers(numbers, item), real + 1j * imaginary
    is_pair = isinstance(value, tuple) and len(value) == 2
    validation.check_value(is_pair, item, EXPECTED, value)
    try:
        numbers = np.asarray(value[0])
        forces = np.asarray(value[1], complex)
    except (ValueError, TypeError) as error:
        raise validation.invalid(item, EXPECTED, value) from error
    good = numbers.ndim == 1 and len(numbers) > 0 and forces.shape == (len(numbers), 3)
    validation.check_value(good and np.isfinite(forces).all(), item, EXPECTED, value)
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
    node_sets : mapping of str to (n, 3) float, m
        Positions of the nodes of the clamp and of the sector faces, in the axes of the model.
    to_compare : tuple of (name, value, remark)
        Quantities to compare with the drawing and with the other program: mass and radius of free
        bodies, mode 1, rotor speeds at which the engine order meets the lowest modes, contacts,
        units, and the shifts of these modes by bonded faces.

    Notes
    -----
    ``plot`` draws the bodies with these sets, contact points and points of the stress
    (:func:`bdamper.plot.plot_import_report`).
    """

    model: Model
    sources: Mapping[str, str] = field(default_factory=dict)
    faces: tuple[str, ...] = ()
    checks: tuple[str, ...] = ()
    missing: tuple[str, ...] = ()
    failed: tuple[str, ...] = ()
    bases: tuple[str, ...] = ()
    node_sets: Mapping[str, NDArray] = field(default_factory=dict)
    to_compare: tuple[Row, ...] = ()

    @property
    def frequencies(self) -> dict[int, NDArray]:
        """Natural frequencies (n_modes,) of the sector at each nodal diameter, Hz."""
        return {d: frequencies_of(basis) for d, basis in self.model.bodies["blade"].bases.items()}

    def save(self, path: FilePath) -> None:
        """Write the model file, with the report in its provenance."""
        save_model(self.model, path)

    def _statement(self) -> Statement:
        bodies = ", ".join(
            body.name for body in self.model.bodies.values() if body.kind != "ground"
        )
        subject = f"imported model of {counted(self.model.n_blades, 'sector')} with {bodies}"
        if self.failed:
            verdict = [f"Not confirmed by the other program: {text}" for text in self.failed]
        elif self.checks:
            verdict = [f"All checks passed: {subject}"]
        else:
            verdict = [f"Not checked: {subject}"]
        checks = [_named_row(text, "FAIL") for text in self.failed]
        checks += [_named_row(text, "pass") for text in self.checks]
        remarks = []
        if self.failed:
            remarks.append(
                "Remedy: compare element types, supports and mass formulation of both programs"
            )
        remarks += [f"Not in this model: {text}" for text in self.missing]
        return Statement(
            verdict,
            self.to_compare,
            checks,
            remarks,
            table=self._frequency_table(),
            details=self._detail_rows(),
        )

    def summary(self) -> str:
        """Return the report with the findings of all checks."""
        return self._statement().full_text

    def _detail_rows(self) -> list[Row]:
        """Return files, mass properties, damping and interfaces of the model."""
        rows: list[Row] = []
        for name, text in self.sources.items():
            first, *others = text.split("\n")
            rows += [Row(name, "source", first), *(Row("", "", line) for line in others)]
        for text in self.bases:
            rows.append(_named_row(text, "origin"))
        for body in self.model.bodies.values():
            if body.centre is not None and body.inertia is not None:
                rows += _free_body_rows(body)
            if body.damping_text:
                rows.append(Row(body.name, body.damping_text, "modal damping ratio"))
        for text in self.faces:
            # "name: 9 points, area ...", with further lines on the same interface
            first, *others = text.split("\n")
            name, _, finding = first.partition(": ")
            points, _, rest = finding.partition(" points")
            rows.append(Row(name, f"{points} points", rest.strip(" ,")))
            rows += [Row("", "", line) for line in others]
        return rows

    def _frequency_table(self) -> list[tuple[str, ...]]:
        """Return the lowest frequencies of the sector at each nodal diameter."""
        table: list[tuple[str, ...]] = [
            ("Nodal diameter", "Modes", "Lowest frequencies of the sector (Hz)")
        ]
        for d, frequencies in self.frequencies.items():
            table.append((str(d), str(len(frequencies)), _lowest(frequencies)))
        return table


def _lowest(frequencies: NDArray) -> str:
    """Return the six lowest frequencies as text."""
    return "  ".join(f"{hertz:.6g}" for hertz in frequencies[:6])


COMPARED_MODES = 3
"""Lowest modes whose rotor speeds and shifts begin the report."""


def _rows_to_compare(
    model: Model,
    laid: LaidContacts,
    blade: PreparedBody,
    excited: int,
    orders: Sequence[int],
    report: ImportReport,
) -> list[Row]:
    """Return the quantities that a user compares with the drawing and with the other program.

    ``excited`` is the nodal diameter of the excitation, and ``orders`` are the engine orders, if
    they are known.
    """
    rows = []
    for body in model.bodies.values():
        if body.kind in ("free", "ring"):
            remarks = ["per sector"] if body.kind == "ring" else []
            radius = body.radius
            if radius is not None:
                remarks.append(f"at a radius of {amount(radius, 'm', 4)}")
            rows.append(
                Row(sentence(body.name), amount(body.mass or 0.0, "kg"), ", ".join(remarks))
            )
    bases = model.bodies["blade"].bases
    # nodal diameters that the user gives need not contain that of the excitation
    diameter = excited if excited in bases else min(bases)
    frequency = frequencies_of(bases[diameter])[0]
    at = f"at nodal diameter {diameter}, without contact"
    rows.append(Row("Mode 1", amount(float(frequency), "Hz"), at))
    if model.n_blades > 1:
        rows += _rows_of_orders(model, orders)
    for name, face in model.interfaces.items():
        if face.kind == "friction":
            rows.append(
                Row(f"Contact {name}", area_text(float(face.area.sum())), laid.overlaps[name])
            )
    rows.append(Row("Units", _units_text(blade.placement.units), "of the files"))
    if report.shifts:
        shifts = [
            percent(shift, sign=True).removesuffix(" %") for shift in report.shifts[:COMPARED_MODES]
        ]
        of_modes = f"shift of {_modes_text(len(shifts))} at nodal diameter {excited}"
        rows.append(Row("Bonded faces", f"{', '.join(shifts)} %", of_modes))
    return rows


def _modes_text(n: int) -> str:
    """Return the lowest ``n`` modes as text."""
    return "mode 1" if n == 1 else f"modes {listed(str(mode) for mode in range(1, n + 1))}"


def _rows_of_orders(model: Model, orders: Sequence[int]) -> list[Row]:
    """Return the rotor speeds at which each engine order meets the lowest modes.

    Without engine orders the row has the call that computes these speeds, for the lowest nodal
    diameter above 0 and a range around its first mode.
    """
    bases = model.bodies["blade"].bases
    rows = []
    for order in orders:
        diameter, _ = model.folded_nodal_diameter(order)
        # order 0 does not vary as the wheel turns
        if order == 0 or diameter not in bases:
            continue
        rpm = 60.0 * frequencies_of(bases[diameter])[:COMPARED_MODES] / order
        met = f"meets {_modes_text(len(rpm))}, without contact"
        if bases[diameter].speed is not None:
            met += "; rotation shifts them: study.campbell"
        speeds = ", ".join(f"{speed:.0f}" for speed in rpm.tolist())
        rows.append(Row(f"Engine order {order}", f"{speeds} rpm", met))
    if not rows:
        diameter = min((d for d in bases if d), default=0)
        order = diameter or model.n_blades
        lowest = 60.0 * float(frequencies_of(bases[diameter])[0]) / order
        limits = f"({0.8 * lowest:.0f}, {1.2 * lowest:.0f})"
        call = f"study.campbell(rpm={limits}, engine_orders=[{order}])"
        rows.append(Row("Engine order", "unknown", f"speeds at which one meets the modes: {call}"))
    return rows


def _units_text(units: Units) -> str:
    """Return the units of length, mass and time."""
    for name, known in UNITS_BY_NAME.items():
        if known == units:
            return name.replace("-", ", ")
    return f"{units.length:g} m, {units.mass:g} kg, s"


def _named_row(text: str, value: str) -> Row:
    """Return the row of a text "name: finding"; a text without a name concerns the model."""
    name, colon, finding = text.partition(": ")
    if not colon:
        return Row("model", value, text)
    return Row(name, value, finding)


def _free_body_rows(body: Body) -> list[Row]:
    """Return mass, centre, inertia and elastic frequencies of a free body."""
    assert body.centre is not None and body.inertia is not None
    size = float(np.abs(body.centre).max())
    centre = ", ".join(f"{without_rounding(float(x), size):.6g}" for x in body.centre)
    moments = ", ".join(f"{moment:.6g}" for moment in np.linalg.eigvalsh(body.inertia))
    is_ring = body.kind == "ring"
    mass_of = "mass per sector" if is_ring else "mass"
    rows = [
        Row(body.name, f"{body.mass:.6g} kg", f"{mass_of}, at a radius of {body.radius:.6g} m"),
        Row("", "", f"centre ({centre}) m"),
        Row("", "", f"principal moments of inertia {moments} kg m²"),
    ]
    if is_ring:
        for d, basis in body.bases.items():
            lowest = _lowest(frequencies_of(basis))
            rows.append(Row("", "", f"nodal diameter {d}: frequencies {lowest} Hz"))
        return rows
    # the first six frequencies belong to the rigid motions
    elastic = frequencies_of(body.bases[0])[6:]
    if len(elastic):
        rows.append(Row("", "", f"elastic modes {_lowest(elastic)} Hz"))
    return rows


# ---- Model ----


INTEGRATED = 33
"""Largest period of an excitation, in sectors, for which a model has all nodal diameters for time
integration.
"""


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
    base: bool = False,
    checks: Checks = Checks(),
    progress: bool | None = None,
) -> BuiltModel:
    """Make a model from finite element bodies.

    Parameters
    ----------
    blade, damper : FEBody, FEBody or mapping of name to FEBody
        One sector (or a whole structure with ``Sector(n_blades=1)``), and optionally free bodies in
        contact with a blade.
    contacts : sequence of ContactFaces
        Pairs of contact faces; none for a blisk, for which only the linear response can be
        computed.
    sector : Sector
        Number of sectors, sector faces, clamped nodes, nodes of the blade, and nodes at which
        stresses are computed.
    placement : Placement
        Units and axes of the files.
    reduction : Reduction
        Nodal diameters, or engine orders that determine them, and numbers of modes.
    locations : mapping of name to location
        Points of excitation and response: a node number, a position (3,), or a tuple of the name of
        a body and one of these.
    forces : mapping of name to (node numbers, forces) or to a CSV file
        Fields of nodal forces (:func:`force_fields`).
    base : bool
        Add the location "base": ``bd.Excitation("base", direction, a)`` accelerates the fixed nodes
        of a structure without sectors by ``a`` m/s2.
    checks : Checks
        Frequencies of another program for comparison, and the treatment of failures.
    progress : bool, optional
        Whether to show a progress bar; by default only on a terminal.

    Raises
    ------
    ModelError, SettingError
        If bodies, contacts and settings do not fit together, or a check fails.
    """
    validation.instance("sector", sector, Sector)
    validation.instance("placement", placement, Placement)
    validation.instance("reduction", reduction, Reduction)
    validation.instance("checks", checks, Checks)
    report = ImportReport(checks.strict)
    bodies = _prepared(blade, damper, placement, report)
    contacts = _checked_contacts(contacts)
    _check_free_bodies(bodies, contacts)
    faces = _sector_faces(bodies["blade"], sector)
    n_blades = faces.n_sectors
    diameters, excited, reason = _diameters(n_blades, reduction, blade)
    report.checks.append(f"{counted(len(diameters), 'nodal diameter')}, {reason}")
    expected = checks.expected_frequencies or {}
    for d in expected:
        allowed = f"nodal diameters out of {list(diameters)}"
        check(d in diameters, "expected_frequencies", allowed, d)
    # the sectors of the blade; free bodies in ``rings`` consist of sectors as well
    ring = CyclicStructure(faces, diameters, excited or diameters, expected)
    check_bodies(bodies, n_blades, checks.check_units, sector.elasticity)
    contacts, bodies = from_first_sector(contacts, bodies, n_blades)
    rings = _rings(bodies, sector, ring)
    laid = lay_contacts(contacts, bodies, n_blades, rings)
    places = _locations(locations, bodies, forces)
    if base:
        validation.check(BASE not in places, "base", "no other location 'base'", "one")
        places[BASE] = ("blade", _inertia_forces(bodies["blade"], n_blades))
    stresses = stress_rows(bodies["blade"], sector, laid, ring)
    n_steps = _number_of_steps(bodies, ring, rings, local=sector.blade_nodes is not None)
    with progress_stages(shows_progress(progress), "import", "step") as show:
        report.steps = Steps(show, n_steps)
        reduced, shapes = _reduced(bodies, laid, places, ring, rings, sector, reduction, stresses)
    if checks.check_units:
        for name, body in bodies.items():
            check_lowest(body, reduced[name])
    # stresses are judged in the lowest mode of this nodal diameter
    first_excited = ring.pictured[0]
    for stress in stresses:
        check_surface(bodies["blade"], stress.name, stress.largest(first_excited))
    bases = list(_origins(bodies, ring))
    bases += [_largest_stress(bodies["blade"], stress, ring) for stress in stresses]
    orders: Sequence[int] = reduction.engine_order or ()  # type: ignore[assignment]
    built = _assembled(bodies, laid, places, reduced, shapes, stresses, ring, report, bases, orders)
    return replace(built, node_sets=_node_sets(bodies["blade"], sector, faces))


# --------------------------------------------------------------------------------------------------
# Settings


def _prepared(
    blade: FEBody,
    damper: FEBody | Mapping[str, FEBody] | None,
    placement: Placement,
    report: ImportReport,
) -> dict[str, PreparedBody]:
    """Return the bodies in SI units and in the axes of the model; the first one is the blade."""
    free: Mapping[str, FEBody] = {}
    if isinstance(damper, Mapping):
        free = damper
    elif damper is not None:
        free = {"damper": damper}
    reserved = [name for name in free if name in ("blade", "ground") or not isinstance(name, str)]
    validation.check(not reserved, "free bodies", "names other than 'blade' and 'ground'", reserved)
    prepared = {}
    for name, raw in {"blade": blade, **free}.items():
        body = validation.instance(name, raw, FEBody, "an FEBody, as read_arrays returns it")
        prepared[name] = PreparedBody(name, body, placement, report)
    return prepared


def _node_sets(blade: PreparedBody, sector: Sector, faces: SectorFaces) -> dict[str, NDArray]:
    """Return the positions (n, 3) of the nodes of clamp and sector faces, without empty sets."""
    held = None if sector.fixed is None else blade.node_set(sector.fixed, "fixed")
    if blade.raw.stiffness is not None:
        clamp = np.flatnonzero(blade.fixed(held).all(axis=1))
    else:
        # modes alone do not show which components have no equation
        clamp = np.zeros(0, int) if held is None else held
    sets = {
        "clamp": clamp,
        "sector faces": faces.nodes,
    }
    return {name: blade.nodes[nodes] for name, nodes in sets.items() if len(nodes)}


def _counts(free: Sequence[str], reduction: Reduction) -> dict[str, int]:
    """Return the number of modes of each body; ``free`` are the names of the free bodies."""
    n_modes = reduction.n_damper_modes
    given = n_modes if isinstance(n_modes, Mapping) else dict.fromkeys(free, n_modes)
    validation.mapping("n_damper_modes", given, free, "free bodies")
    # a mapping need not contain all free bodies
    by_default = dict.fromkeys(free, DAMPER_MODES)
    return {"blade": reduction.n_modes, **by_default, **given}


def _checked_contacts(contacts: Sequence[ContactFaces]) -> tuple[ContactFaces, ...]:
    """Check type and name of each contact."""
    expected = "a sequence of ContactFaces"
    is_sequence = isinstance(contacts, Iterable) and not isinstance(contacts, str)
    validation.check_value(is_sequence, "contacts", expected, contacts)
    checked: list[ContactFaces] = []
    for contact in contacts:
        checked.append(validation.instance("contacts", contact, ContactFaces))
    names = [contact.name for contact in checked]
    validation.check_value(len(set(names)) == len(names), "contacts", "each name once", names)
    return tuple(checked)


def _check_free_bodies(bodies: Collection[str], contacts: Sequence[ContactFaces]) -> None:
    """Raise SettingError if a free body has no contact."""
    touched = {contact.body_a for contact in contacts} | {contact.body_b for contact in contacts}
    for name in bodies:
        in_contact = name == "blade" or name in touched
        validation.check(in_contact, "contacts", f"at least one contact of '{name}'", "none")


def _diameters(
    n_blades: int, reduction: Reduction, blade: FEBody
) -> tuple[tuple[int, ...], tuple[int, ...], str]:
    """Return the nodal diameters of a model, the excited nodal diameters, and the reason for the
    choice.
    """
    chosen = reduction.nodal_diameters
    harmonics = reduction.harmonics
    orders: Sequence[int] = reduction.engine_order or ()  # type: ignore[assignment]
    # an order excites a wave, which has the same nodal diameter, at most N/2, in both directions
    diameters_of_orders = {min(order % n_blades, -order % n_blades) for order in orders}
    excited = tuple(sorted(diameters_of_orders))
    # without matrices the model has at most the nodal diameters of the modes of the file
    with_modes: set[int] | None = None
    if blade.stiffness is None and blade.modes:
        with_modes = {modes.nodal_diameter for modes in blade.modes}
    if chosen is None and not orders:
        if n_blades == 1:
            chosen = [0]
        elif with_modes is not None:
            chosen = sorted(with_modes)
        else:
            raise SettingError(
                "nodal diameters: expected engine_order or nodal_diameters, found neither"
            )
    if chosen is not None:
        checked = validation.integers("nodal_diameters", chosen, most=n_blades // 2)
        return tuple(sorted({0, *checked})), excited, "given"
    n_harmonics = harmonics or HARMONICS
    wanted = set[int]()
    for order in orders:
        n_of_order = n_harmonics
        # period of the excitation in sectors; this number of harmonics excites all possible waves,
        # which time integration needs
        period = n_blades // gcd(n_blades, order)
        if harmonics is None and period <= INTEGRATED:
            n_of_order = max(n_harmonics, period)
        wanted.update(needed_nodal_diameters(n_blades, order, n_of_order))
    reason = f"for {counted(n_harmonics, 'harmonic')} of engine order {', '.join(map(str, orders))}"
    if harmonics is None:
        reason += " and time integration"
        if with_modes:
            wanted &= with_modes
    return tuple(sorted({0, *wanted})), excited, reason


@dataclass(frozen=True)
class _FacePair:
    """Two sets of nodes of the user at which the sector repeats.

    Parameters
    ----------
    first, second : (n,) int
        Node indices of the sets, in the order of the user.
    angle : float
        Angle between the centres of the sets, rad.
    n_blades : int
        Number of sectors, of the user or the nearest to the angle.
    exact : bool
        Whether the user gave the number of sectors.
    alike : bool
        Whether the angle is one pitch within the tolerance.
    apart : str
        The angle in words, for messages.
    expected : str
        Description of two faces that fit, for messages.
    """

    first: NDArray
    second: NDArray
    angle: float
    n_blades: int
    exact: bool
    alike: bool
    apart: str
    expected: str

    @property
    def pitches(self) -> tuple[float | None, ...]:
        """Pitches with which the faces may match: that of the number of sectors, then the angle."""
        return (None, self.angle) if self.alike else (None,)


def _sector_faces(body: PreparedBody, sector: Sector) -> SectorFaces:
    """Return the sector faces, given or found in the mesh.

    Faces with different meshes are tied by interpolation.
    """
    if sector.n_blades == 1:
        return no_faces()
    if sector.faces is None:
        return _found_faces(body, sector.n_blades)
    pair = _face_pair(body, sector.faces, sector)
    matched, problems = _matched_faces(body, pair)
    if matched is not None:
        return matched
    # reasons for both orders of the faces at the first pitch; another pitch adds two more
    one_way, other_way = problems[:2]
    other_found = other_way.split(": ")[-1]
    found = f"{pair.apart}; {one_way}; the other way: {other_found}"
    body.require(body.elements, "sector faces", pair.expected, found)
    return _tied_faces(body, pair, sector.face_tolerance, why_unmatched=found)


def _found_faces(body: PreparedBody, n_blades: int | None) -> SectorFaces:
    """Return the sector faces found in the mesh."""
    faces = None
    if body.elements:
        tolerance = BOUNDS.sector_faces * body.size
        faces = find_faces(body.nodes, body.boundary, n_blades, tolerance)
    if faces is None:
        expected = "the two faces of the sector"
        if not n_blades:
            expected += ", and n_blades (1 for an acyclic structure)"
        raise SettingError(
            f"sector faces: expected {expected}, found no rotation that maps element faces onto "
            "each other"
        )
    body.passed(f"sector faces: found from the geometry, {faces.n_sectors} sectors")
    return faces


def _face_pair(body: PreparedBody, faces: tuple[NodeSet, NodeSet], sector: Sector) -> _FacePair:
    """Return the faces of the user and the number of sectors; check the angle between them."""
    first = body.node_set(faces[0], "sector faces")
    second = body.node_set(faces[1], "sector faces")
    angle = _angle_between(body, first, second)
    nearest = max(2, round(2.0 * np.pi / angle))
    n_blades = sector.n_blades or nearest
    is_given = sector.n_blades is not None
    apart = (
        f"the faces are {np.rad2deg(angle):.6g} degrees apart; the closest number is {nearest} "
        "sectors"
    )
    pitch = 2.0 * np.pi / n_blades
    deviation = 1.0 - pitch / angle
    fits = n_blades == nearest and abs(deviation) <= sector.angle_tolerance
    expected = f"360/N degrees within {100 * sector.angle_tolerance:g} %"
    body.require(is_given or fits, "sector faces", expected, apart)
    if not is_given:
        degrees = np.rad2deg(angle)
        body.passed(f"{n_blades} sectors, from the {degrees:.4g} degrees between the sector faces")
    expected = (
        f"two sets of nodes that coincide after a rotation of one by 2 pi/{n_blades} about the axis"
    )
    return _FacePair(
        first=first,
        second=second,
        angle=angle,
        n_blades=n_blades,
        exact=is_given,
        alike=fits,
        apart=apart,
        expected=expected,
    )


def _matched_faces(body: PreparedBody, pair: _FacePair) -> tuple[SectorFaces | None, list[str]]:
    """Return faces whose nodes match in pairs, or None, with the reasons why others do not.

    Each pitch that does not match adds two reasons, for both orders of the faces.
    """
    tolerance = BOUNDS.sector_faces * body.size
    problems = []
    for pitch in pair.pitches:
        for left, right, words in (
            (pair.first, pair.second, "the first set lies toward -X"),
            (pair.second, pair.first, "the sets were exchanged"),
        ):
            try:
                matched = match_faces(body.nodes, left, right, pair.n_blades, tolerance, pitch)
            except ValueError as error:
                problems.append(str(error))
                continue
            body.passed(
                f"sector faces: {len(left)} pairs of nodes match within {tolerance:.2g} m; {words}"
            )
            _report_deviation(body, pitch, pair.n_blades)
            return matched, problems
    return None, problems


@dataclass(frozen=True)
class _Tie:
    """Faces with different meshes, tied by interpolation.

    Parameters
    ----------
    faces : SectorFaces
    angle : float or None
        Angle between the faces of the mesh (rad), or None for one pitch.
    """

    faces: SectorFaces
    angle: float | None


def _tied_faces(
    body: PreparedBody, pair: _FacePair, face_tolerance: float, why_unmatched: str
) -> SectorFaces:
    """Return faces with different meshes, tied by interpolation.

    Parameters
    ----------
    face_tolerance : float
        Largest distance of the faces, divided by the mean edge of their elements.
    why_unmatched : str
        Why the nodes do not match, for messages.
    """
    tie = _best_tie(body, pair)
    faces = tie.faces
    if pair.alike:
        limit = face_tolerance * _mean_edge(body, faces.independent)
    else:
        # faces whose angle contradicts the number of sectors have to fit much better
        limit = BOUNDS.tied_faces * body.size
    distances = f"at best {faces.distance:.3g} m apart, tolerance {limit:.3g} m"
    found = f"{why_unmatched}; meshes that differ are {distances}"
    body.require(faces.distance <= limit, "sector faces", pair.expected, found)
    tied_nodes = f"{len(faces.dependent)} nodes tied by interpolation to {len(faces.independent)}"
    body.passed(
        f"sector faces: meshes that differ, {tied_nodes}, at most {faces.distance:.2g} m apart"
    )
    _report_deviation(body, tie.angle, faces.n_sectors)
    return faces


def _best_tie(body: PreparedBody, pair: _FacePair) -> _Tie:
    """Return the tie of the two faces with the smallest distance.

    The user's number of sectors has priority, but no other number may fit within the tolerance.
    """
    ties = _possible_ties(body, pair)
    closest = min(ties, key=lambda tie: tie.faces.distance)
    n_sectors = closest.faces.n_sectors
    if n_sectors == pair.n_blades:
        return closest
    if not pair.exact:
        body.passed(f"{n_sectors} sectors fit best")
        return closest
    contradicts = closest.faces.distance <= BOUNDS.tied_faces * body.size
    fit = f"faces that fit {n_sectors} sectors"
    body.require(not contradicts, "sector faces", pair.expected, fit)
    of_user = [tie for tie in ties if tie.faces.n_sectors == pair.n_blades]
    return min(of_user, key=lambda tie: tie.faces.distance)


def _possible_ties(body: PreparedBody, pair: _FacePair) -> list[_Tie]:
    """Return the ties for several numbers of sectors and angles, with either face on the left."""
    # different meshes have different centres, so the angle between them may suggest one sector
    # too few or too many
    fewest = max(pair.n_blades - 1, 2)
    variants: list[tuple[int, float | None]] = [
        (n_sectors, None) for n_sectors in range(fewest, pair.n_blades + 2)
    ]
    if pair.alike:
        variants.append((pair.n_blades, pair.angle))
    ties = []
    with body.refusing("sector faces", pair.expected):
        for n_sectors, angle in variants:
            for left, right in ((pair.first, pair.second), (pair.second, pair.first)):
                faces = tie_faces(body.nodes, body.boundary, left, right, n_sectors, angle)
                ties.append(_Tie(faces, angle))
    return ties


def _angle_between(body: PreparedBody, first: NDArray, second: NDArray) -> float:
    """Return the angle between the centres of two faces (node indices) about Z, rad."""
    first_x, first_y = body.nodes[first, :2].mean(axis=0)
    second_x, second_y = body.nodes[second, :2].mean(axis=0)
    # measured from Y, the direction to the blade, towards X
    first_angle = np.arctan2(first_x, first_y)
    second_angle = np.arctan2(second_x, second_y)
    # from -pi to pi
    difference = (second_angle - first_angle + np.pi) % (2.0 * np.pi) - np.pi
    # a disk with thousands of sectors has the smallest angle
    return max(float(abs(difference)), 1e-3)


def _report_deviation(body: PreparedBody, angle: float | None, n_blades: int) -> None:
    """Report faces that are tied although their angle (rad) differs from one pitch."""
    if angle is None:
        return
    degrees = np.rad2deg(angle)
    pitch = 360.0 / n_blades
    deviation = 100.0 * (degrees / pitch - 1.0)
    body.passed(
        f"sector faces: {degrees:.6g} degrees apart, {deviation:+.2g} % from {pitch:.6g}; "
        "tied as if they were one pitch apart"
    )


def _rings(
    bodies: Mapping[str, PreparedBody], sector: Sector, ring: CyclicStructure
) -> dict[str, CyclicStructure]:
    """Return the rings among the free bodies, with the faces at which they repeat.

    Raises
    ------
    SettingError, ModelError
        If a name or a set does not exist, the faces do not fit the sectors of the blade, or a body
        that repeats is not named.
    """
    n_blades = ring.faces.n_sectors
    free = [name for name in bodies if name != "blade"]
    named = sector.rings or {}
    validation.mapping("rings", named, free, "free bodies")
    closed = [name for name, faces in named.items() if faces is not None]
    unknown = [name for name in sector.split_rings if name not in closed]
    expected = f"names out of the rings {closed}"
    validation.check(not unknown, "split_rings", expected, unknown)
    if n_blades == 1:
        no_ring = f"an acyclic structure has no rings; omit {', '.join(closed)}"
        validation.check_sentence(not closed, "rings", no_ring)
        return {}
    rings = {}
    for name in free:
        body = bodies[name]
        faces = named.get(name)
        if faces is None:
            # a body that the user names without faces does not repeat; others are checked
            if name not in named:
                _check_separate(body, n_blades)
            continue
        validation.check(n_blades >= 3, "rings", "at least 3 sectors", n_blades)
        body.require(body.has_matrices, "ring", "stiffness and mass matrix", "neither")
        of_ring = replace(sector, n_blades=n_blades, faces=faces)
        rings[name] = replace(ring, faces=_sector_faces(body, of_ring), expected={})
    return rings


def _check_separate(body: PreparedBody, n_blades: int) -> None:
    """Raise ModelError if a free body continues in the neighbouring sectors like a ring."""
    if not body.elements:
        return
    found = find_faces(body.nodes, body.boundary, n_blades, BOUNDS.sector_faces * body.size)
    if found is None:
        return
    numbers = body.raw.numbers
    # a pair of nodes that a rotation by one sector maps onto each other, as an example
    first = numbers[found.independent[0]]
    last = numbers[found.dependent[0]]
    raise body.error(
        "free body",
        f"Sector(rings={{'{body.name}': (set, set)}}) with the sector faces of the ring, or "
        f"rings={{'{body.name}': None}} for {n_blades} separate pieces",
        "faces that a rotation by one sector carries onto each other, for example "
        f"node {first} onto node {last}",
    )


def _mean_edge(body: PreparedBody, nodes: NDArray) -> float:
    """Return the mean edge of the outer faces of elements on some nodes, m."""
    lengths = []
    # triangles and quadrilaterals, with or without mid-side nodes, are separate groups
    for facets in facets_on_nodes(body.boundary, nodes).groups:
        _, n_nodes = facets.shape
        # the corners come first, (n_facets, n_corners, 3)
        corners = body.nodes[facets[:, : corner_count(n_nodes)]]
        edges = corners - np.roll(corners, 1, axis=1)
        lengths.append(np.linalg.norm(edges, axis=2).ravel())
    return float(np.concatenate(lengths).mean())


def _locations(
    locations: Mapping[str, object] | None,
    bodies: Mapping[str, PreparedBody],
    forces: Mapping[str, object] | None,
) -> dict[str, tuple[str, Place]]:
    """Return body and node (or field of forces) of each named location."""
    places: dict[str, tuple[str, Place]] = {}
    for name, forces_at_nodes in force_fields(forces, bodies["blade"]).items():
        places[name] = ("blade", forces_at_nodes)
    if locations is None:
        return places
    named = validation.instance("locations", locations, Mapping, "a mapping")
    for name, value in named.items():
        item = f"location '{name}'"
        # a node or position of the blade, or a pair of another body and one of these
        body, place = "blade", value
        if isinstance(value, tuple) and len(value) == 2 and isinstance(value[0], str):
            body, place = value
        validation.check(body in bodies, item, f"a body out of {sorted(bodies)}", f"'{body}'")
        unique = name not in places
        validation.check(unique, item, "a name that forces do not have", f"'{name}' twice")
        places[name] = (body, bodies[body].node(place, item))
    return places


def _inertia_forces(body: PreparedBody, n_blades: int) -> NDArray:
    """Return the forces (n_nodes, 3, 3) on the nodes under unit accelerations of the held nodes
    along X, Y and Z, in the motion relative to these.

    The mass matrix couples held nodes and others, so that its held rows count.
    """
    whole = n_blades == 1 and body.has_matrices
    found = "only modes" if n_blades == 1 else f"{n_blades} sectors"
    validation.check(whole, "base", "a structure without sectors and with its matrices", found)
    n_nodes = len(body.nodes)
    # unit translations of all nodes along X, Y and Z as columns, (3 n_nodes, 3)
    translations = np.tile(np.eye(3), (n_nodes, 1))
    forces = -(body.structure.mass @ translations)
    return np.asarray(forces).reshape(n_nodes, 3, 3)


def _location(name: str, body: PreparedBody, place: Place) -> Location:
    """Return the location of a node (its index), of an accelerated base, or of a field of forces.

    The base is at the mean position of the nodes.  The position of a field (n_nodes, 3) is the mean
    over its forces.
    """
    if not isinstance(place, np.ndarray):
        return Location(name, body.name, body.nodes[place].copy())
    # (n_nodes, 3, 3): a field of forces for each direction of the acceleration
    if place.ndim == 3:
        return Location(name, body.name, body.nodes.mean(axis=0), "base")
    sizes = np.linalg.norm(place, axis=1)
    mean_position = sizes @ body.nodes / sizes.sum()
    return Location(name, body.name, mean_position, "forces")


# --------------------------------------------------------------------------------------------------
# Model


def _number_of_steps(
    bodies: Mapping[str, PreparedBody],
    ring: CyclicStructure,
    rings: Mapping[str, CyclicStructure],
    local: bool,
) -> int:
    """Return the number of steps of the reduction, for progress.

    A step is a nodal diameter of the sector or of a ring, a free body with matrices, the clamped
    blade of a local basis, or its disk at a nodal diameter.  ``local`` tells whether there is a
    local basis.
    """
    n_steps = 0
    for name, body in bodies.items():
        if name != "blade" and body.has_matrices:
            n_steps += 1
        if name in rings:
            n_steps += len(ring.diameters)
    if not bodies["blade"].has_matrices:
        return n_steps
    diameters = set(ring.diameters)
    # the deformation by rotation, from matrices at two speeds, has nodal diameter 0
    if bodies["blade"].raw.faster:
        diameters.add(0)
    if local:
        n_sectors = ring.faces.n_sectors
        diameters.update(sampled_waves(n_sectors))
        n_clamped_blades = 1
        n_disks = n_sectors // 2 + 1
        n_steps += n_clamped_blades + n_disks
    return n_steps + len(diameters)


def _reduced(
    bodies: Mapping[str, PreparedBody],
    laid: LaidContacts,
    places: Mapping[str, tuple[str, Place]],
    ring: CyclicStructure,
    rings: Mapping[str, CyclicStructure],
    sector: Sector,
    reduction: Reduction,
    rows: Sequence[StressRows],
) -> tuple[dict[str, Body], dict[str, dict[int, NDArray]]]:
    """Reduce all bodies, from matrices or from modes.

    Returns
    -------
    reduced : dict of name to Body
    pictures : dict of name to dict of nodal diameter to array
        Mode shapes on the nodes of blade and rings, for pictures.
    """
    reduced: dict[str, Body] = {}
    pictures: dict[str, dict[int, NDArray]] = {}
    n_modes = _counts([name for name in bodies if name != "blade"], reduction)
    for name, body in bodies.items():
        on_body = {key: place for key, (owner, place) in places.items() if owner == name}
        wanted = Wanted(
            ports=laid.ports[name],
            contact=laid.rows[name],
            locations=on_body,
            n_modes=n_modes[name],
            damping_ratio=reduction.damping_ratio,
            static_shapes=True,
        )
        if name in rings:
            is_split = name in sector.split_rings
            reduced[name], pictures[name] = ring_from_matrices(body, wanted, rings[name], is_split)
        elif name != "blade":
            reduce = free_from_matrices if body.has_matrices else free_from_modes
            reduced[name] = reduce(body, wanted)
        elif body.has_matrices:
            reduced[name], pictures[name] = constrained_from_matrices(
                body, wanted, ring, sector, reduction.local_sizes, laid.interfaces, rows
            )
        else:
            validation.check(
                sector.blade_nodes is None,
                "blade_nodes",
                "a sector of a cyclic structure with its matrices",
                "only modes",
            )
            reduced[name], pictures[name] = constrained_from_modes(body, wanted, ring)
    if laid.ports["ground"]:
        reduced["ground"] = Body("ground", "ground", laid.ports["ground"])
    return reduced, pictures


def _origins(bodies: Mapping[str, PreparedBody], ring: CyclicStructure) -> Iterator[str]:
    """Iterate over the sources of masses and frequencies, and of the frequencies compared."""
    for name, body in bodies.items():
        if name == "blade":
            yield f"{name}: frequencies from {_origin_of_frequencies(body, ring)}"
        else:
            source = "mass matrix" if body.has_matrices else "given MassProperties"
            yield f"{name}: mass, centre and inertia from the {source}"


def _origin_of_frequencies(body: PreparedBody, ring: CyclicStructure) -> str:
    if not body.has_matrices:
        return "the modes of the file"
    files = "stiffness and mass matrix of the files"
    compared = sorted({*ring.expected, *(modes.nodal_diameter for modes in body.raw.modes)})
    if not compared:
        return (
            f"{files}, not compared with those of the program "
            "(expected_frequencies, or a result file)"
        )
    diameters = ", ".join(map(str, compared))
    return f"{files}, compared with those of the program at nodal diameters {diameters}"


def _largest_stress(body: PreparedBody, rows: StressRows, ring: CyclicStructure) -> str:
    """Return the node of the largest von Mises stress in the lowest mode of the first excited nodal
    diameter.
    """
    first_excited = ring.pictured[0]
    node = rows.largest(first_excited)
    position = ", ".join(f"{coordinate:.6g}" for coordinate in body.raw.nodes[node])
    where = f"node {body.raw.numbers[node]} at ({position}) in the file"
    mode = f"lowest mode of nodal diameter {first_excited}"
    return f"stress '{rows.name}': largest at {where}, {mode}"


def _needs_partial_contact(model: Model, nodal_diameter: int, report: ImportReport) -> bool:
    """Return whether the model needs the force vectors of faces that touch at one end.

    If faces or parts of them are bonded, mode 1 shifts.  Residual modes cause an error of this
    shift.  They have the vectors of whole faces or, at more cost, also vectors of parts:

    * no or hardly any shift: whole faces suffice;
    * accurate with whole faces: they suffice;
    * less error with parts of the faces: these are needed;
    * otherwise parts of the faces are no remedy, and the report names another one.

    The shifts of modes by bonded faces are also added to the report.
    """
    coupling = coupling_of_default(model, nodal_diameter)
    if coupling is None:
        return False
    try:
        whole_faces = partial_contact(coupling, ResidualModes())
        with_parts = partial_contact(coupling, ResidualModes(partial_contact=True))
    except ModelError as error:
        report.missing.append(f"shift of mode 1 by parts of the faces: {error}")
        return False
    shifts = whole_faces.shifts
    report.shifts.extend(shifts)
    by_mode = ", ".join(percent(shift) for shift in shifts)
    held_modes = 1 + np.flatnonzero(np.asarray(shifts) >= SMALL_SHIFT)
    hint = ""
    if len(held_modes) and held_modes[0] > 1:
        hint = (
            f"; the damper has little effect below mode {held_modes[0]}; select a mode with mode= "
            "in the methods of the study"
        )
    report.checks.append(
        f"dampers: bonded faces raise the lowest {counted(len(shifts), 'frequency')} of "
        f"nodal diameter {nodal_diameter} by {by_mode}{hint}"
    )
    # the error is relative to the shift, and undefined without a shift
    if WHOLE not in whole_faces.errors:
        report.checks.append("residual modes: bonding the faces does not shift mode 1")
        return False

    has_effect = whole_faces.shift >= SMALL_SHIFT
    is_needed = (
        has_effect
        and not whole_faces.accurate
        and with_parts.largest_error < whole_faces.largest_error
    )
    chosen = with_parts if is_needed else whole_faces
    vectors = "residual modes for partial contact" if is_needed else "residual modes"
    whole = percent(abs(chosen.errors[WHOLE]))
    of_part = percent(abs(chosen.errors[chosen.worst_part]))
    compared = (
        f"{vectors}: the shift of mode 1 by bonded faces ({percent(chosen.shift)}) agrees with "
        f"all vectors within {whole}, for parts within {of_part} ({chosen.worst_part})"
    )
    if is_needed:
        without = percent(abs(whole_faces.errors[whole_faces.worst_part]))
        compared += f"; within {without} with only the vectors of whole faces"
    if chosen.accurate or not has_effect:
        report.checks.append(compared)
        return is_needed
    remedy = (
        'contact_stiffness=bd.ResidualModes("all") has no such error, at several times the time'
    )
    report.missing.append(f"{compared}; {remedy}")
    return is_needed


def _assembled(
    bodies: Mapping[str, PreparedBody],
    laid: LaidContacts,
    places: Mapping[str, tuple[str, Place]],
    reduced: Mapping[str, Body],
    pictures: Mapping[str, Mapping[int, NDArray]],
    rows: Sequence[StressRows],
    ring: CyclicStructure,
    report: ImportReport,
    bases: Sequence[str],
    orders: Sequence[int],
) -> BuiltModel:
    """Return the model with its report; ``orders`` are the engine orders of the reduction."""
    locations = {}
    for name, (owner, place) in places.items():
        locations[name] = _location(name, bodies[owner], place)
    stress = {}
    averaged = "bdamper.importers.build_model, mean over elements at nodes"
    numbers = np.asarray(bodies["blade"].raw.numbers)
    for row in rows:
        stress[row.name] = row.set("blade", averaged, numbers)
    meshes = {}
    for name, body in bodies.items():
        if body.elements:
            shapes = pictures.get(name, {})
            meshes[name] = picture_mesh(body.boundary, body.nodes, shapes)
    model = Model(
        n_blades=ring.faces.n_sectors,
        bodies=reduced,
        interfaces=laid.interfaces,
        locations=locations,
        contact=laid.stiffness,
        stress=stress,
        meshes=meshes,
    )
    check_model(model, where="built model")
    if _needs_partial_contact(model, ring.pictured[0], report):
        model = replace(model, partial_contact=True)
    built = BuiltModel(
        model,
        sources={name: body.raw.source_text for name, body in bodies.items()},
        faces=laid.faces,
        checks=tuple(report.checks),
        missing=tuple(report.missing),
        failed=tuple(report.failed),
        bases=tuple(bases),
        to_compare=tuple(
            _rows_to_compare(model, laid, bodies["blade"], ring.pictured[0], orders, report)
        ),
    )
    provenance = {
        "source": "; ".join(f"{name}: {body.raw.source}" for name, body in bodies.items()),
        "made by": "bdamper.importers.build_model",
        "date": datetime.date.today().isoformat(),
        "report": built.summary()[:20000],
    }
    return replace(built, model=replace(model, provenance=provenance))
