"""A model from the finite element bodies of any program: checks, reduction, contact points.

The sector is called "blade" in the model, the free body "damper".  Everything is computed by the code that makes the
reference model (:mod:`bdamper.reduction`).  Quantities that are easily mistaken are computed instead of asked for: which
of the two sector faces lies toward +X, in which sector a damper meets its neighbour, in which direction a wave travels,
mass, centre and inertia.  The report lists them.
"""

from __future__ import annotations

import datetime
import os
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import count
from math import gcd
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from bdamper.io.bounds import BOUNDS
from bdamper.io.contact_faces import ContactFaces, LaidContacts, from_first_sector, lay_contacts
from bdamper.io.corner_order import check_corner_order
from bdamper.io.fe_body import FEBody, Units
from bdamper.io.from_matrices import Sectors, constrained_from_matrices, free_from_matrices
from bdamper.io.from_modes import constrained_from_modes, free_from_modes
from bdamper.io.import_report import ImportReport
from bdamper.io.imported_stress import stress_rows
from bdamper.io.local_from_matrices import blade_part, with_local_basis
from bdamper.io.model_file import save_model
from bdamper.io.plausible import check_lowest, check_not_swapped, check_one_scale, check_radial, check_sizes
from bdamper.io.prepare import NodeSet, Placement, PreparedBody, Ring, placement
from bdamper.io.row_order import check_row_order
from bdamper.model.checks import require
from bdamper.model.model import Body, Location, Model
from bdamper.model.validation import check_model
from bdamper.reduction.bodies import Wanted, needed_nodal_diameters, picture_mesh
from bdamper.reduction.cyclic import match_faces
from bdamper.reduction.local_coordinates import LocalSizes, sampled_waves
from bdamper.util import validate
from bdamper.util.blas import one_thread
from bdamper.util.errors import SettingError
from bdamper.util.progress import stages
from bdamper.util.repr import brief

if TYPE_CHECKING:
    from bdamper.reduction.stress import StressRows


HARMONICS = 9
"""Harmonics whose nodal diameters a model has by default."""
MARCHED = 33
"""Sectors after which an excitation repeats, up to which a model has all their nodal diameters, for marches in time."""


@brief
@dataclass(frozen=True)
class BuiltModel:
    """A model and the report on how it came about.

    Parameters
    ----------
    model : Model
    report : ImportReport
    """

    model: Model
    report: ImportReport

    def __str__(self) -> str:
        return str(self.report)

    def plot(self):  # type: ignore[no-untyped-def]
        """The picture of the report; see :meth:`ImportReport.plot`."""
        return self.report.plot()

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the model file; the report goes into its provenance."""
        save_model(self.model, path)


@validate.spelt
@one_thread
def build_model(
    blade: FEBody,
    damper: FEBody | None = None,
    *,
    n_blades: int,
    contacts: Sequence[ContactFaces],
    sector_faces: tuple[NodeSet, NodeSet] | None = None,
    fixed: NodeSet | None = None,
    locations: Mapping[str, object] | None = None,
    engine_order: int | Sequence[int] | None = None,
    harmonics: int | None = None,
    nodal_diameters: Sequence[int] | None = None,
    n_modes: int = 40,
    n_damper_modes: int = 16,
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
    blade, damper : FEBody
        One sector (or a whole structure, ``n_blades=1``); optionally a free body beside the blade of some sector.
    n_blades, contacts : int, sequence of ContactFaces
    sector_faces, fixed : (set, set), set, optional
        The two faces at which the sector repeats, in either order, needed if ``n_blades > 1``; clamped nodes of the blade.
    locations : mapping of name to node number, position, or (body, node number or position)
        Where forces act and the response is read; positions in the axes and units of the file.
    engine_order, harmonics, nodal_diameters : int or several, int, sequence of int (0 to N/2), optional
        Nodal diameters of the model, given or as the harmonics of engine orders need them; by default as nine harmonics and
        a march in time do, which the report weighs.  0 is always added.
    n_modes, n_damper_modes, damping_ratio : int, int, float
        Modes of the sector at each nodal diameter, and of the damper, its six rigid ones included; of all elastic modes.
    units, axis, radial, origin : str or Units, (3,) float
        One of ``bdamper.io.UNITS`` or factors; axis of rotation, direction to the blade and a point on the axis, in the
        axes and the unit of length of the files.
    expected_frequencies, strict : mapping of nodal diameter to frequencies (Hz), bool
        Of another program, compared to 1 %; such a comparison that fails, also with modes of a file, warns, or is refused.
    check_units : bool
        Whether sizes and densities far from anything built are refused.
    wheel, wheel_shapes : set, LocalSizes, optional
        All nodes of the blade, those of its root included, which the disk shares: for wheels of unequal blades.
    stress, elasticity : set or mapping of name to set, (Young's modulus, Poisson's ratio), optional
        Nodes of the blade for stress (extra ``bdamper[fe]``); constants in units of the file, in place of those in it.
    progress : bool, optional
        Whether steps and the time left are shown; by default on a terminal.

    Raises
    ------
    ModelError, SettingError
        At the first thing that is wrong, naming it, what was expected and what was found.
    """
    n_blades = validate.whole("n_blades", n_blades, least=1)
    counts = {"blade": validate.whole("n_modes", n_modes, 1, BOUNDS.modes)}
    counts["damper"] = validate.whole("n_damper_modes", n_damper_modes, 6, BOUNDS.modes)
    damping_ratio = validate.number("damping_ratio", damping_ratio, least=0.0, below=1.0)
    bodies = _prepared(blade, damper, placement(axis, radial, origin, units), validate.flag("strict", strict))
    contacts = _given_contacts(contacts)
    diameters, excited, reason = _diameters(n_blades, engine_order, harmonics, nodal_diameters, blade)
    bodies["blade"].expected = _known_frequencies(expected_frequencies, diameters)
    bodies["blade"].checks.append(f"{len(diameters)} nodal diameters, {reason}")
    _check_bodies(bodies, n_blades, validate.flag("check_units", check_units))
    ring = Ring(n_blades, *_sector_faces(bodies["blade"], sector_faces, n_blades), diameters, excited or diameters)
    contacts, bodies = from_first_sector(contacts, bodies, n_blades)
    laid, places = lay_contacts(contacts, bodies, n_blades), _locations(locations, bodies)
    rows = stress_rows(bodies["blade"], stress, elasticity, laid, ring)
    with _told(progress, bodies, ring, wheel is not None):
        made = _reduced(bodies, laid, places, counts, damping_ratio, ring, fixed, wheel, wheel_shapes, rows)
    return _assembled(bodies, laid, places, made, rows, n_blades, check_units)


# -----------------------------------------------------------------------------------------------------------
# Settings


def _prepared(blade: FEBody, damper: FEBody | None, place: Placement, strict: bool) -> dict[str, PreparedBody]:
    """The bodies in SI units and the axes of the model."""
    given = {"blade": blade} if damper is None else {"blade": blade, "damper": damper}
    for name, body in given.items():
        validate.instance(name, body, FEBody, "an FEBody, as read_arrays returns it")
    return {name: PreparedBody(name, body, place, strict=strict) for name, body in given.items()}


def _check_bodies(bodies: Mapping[str, PreparedBody], n_blades: int, check_units: bool) -> None:
    for body in bodies.values():
        body.check_repeated()
    if check_units and "damper" in bodies:
        check_one_scale(bodies["blade"], bodies["damper"])
    check_radial(bodies["blade"], n_blades)
    for body in bodies.values():
        if body.has_matrices:
            check_not_swapped(body)
            check_row_order(body)
        check_corner_order(body)
        if check_units:
            check_sizes(body)


def _known_frequencies(
    given: Mapping[int, Sequence[float]] | None, diameters: tuple[int, ...]
) -> Mapping[int, Sequence[float]]:
    if given is None:
        return {}
    for d, values in validate.instance("expected_frequencies", given, Mapping, "a mapping").items():
        require(d in diameters, "expected_frequencies", f"nodal diameters out of {list(diameters)}", d)
        validate.numbers(f"expected_frequencies at nodal diameter {d}", values, above=0.0, unit="Hz")
    return given


def _given_contacts(given: Sequence[ContactFaces]) -> tuple[ContactFaces, ...]:
    several = isinstance(given, Iterable) and not isinstance(given, str)
    contacts = tuple(validate.instance("contacts", contact, ContactFaces) for contact in given) if several else ()
    validate.that(contacts, "contacts", "a sequence of one or more ContactFaces", given)
    repeated = [c.name for k, c in enumerate(contacts) if c.name in [other.name for other in contacts[:k]]]
    if repeated:
        raise SettingError(f"contacts: expected each name once, found '{repeated[0]}' twice")
    return contacts


def _diameters(
    n_blades: int, engine_order: int | Sequence[int] | None, harmonics: int | None, given: Sequence[int] | None,
    blade: FEBody,
) -> tuple[tuple[int, ...], tuple[int, ...], str]:  # fmt: skip
    """Nodal diameters of a model, those of its engine orders, and why the model has the former."""
    several = isinstance(engine_order, Iterable) and not isinstance(engine_order, str)
    asked = engine_order if several else () if engine_order is None else (validate.whole("engine_order", engine_order),)
    orders = validate.wholes("engine_order", asked)
    excited = tuple(sorted({min(order % n_blades, -order % n_blades) for order in orders}))
    held = None if blade.stiffness is not None or not blade.modes else {modes.nodal_diameter for modes in blade.modes}
    if given is not None or not orders:
        if given is None and n_blades > 1 and held is None:
            raise SettingError("expected engine_order or nodal_diameters, found neither")
        chosen = given if given is not None else [0] if n_blades == 1 else sorted(held or ())
        return tuple(sorted({0, *validate.wholes("nodal_diameters", chosen, most=n_blades // 2)})), excited, "given"
    most = HARMONICS if harmonics is None else validate.whole("harmonics", harmonics, 1, 64)
    of_each = {order: [most] for order in orders}
    reason = f"for {most} harmonics of engine order {', '.join(map(str, orders))}"
    if harmonics is None:
        for order in orders:
            distinct = n_blades // gcd(n_blades, order)  # sectors after which the excitation repeats
            of_each[order].append(distinct if distinct <= MARCHED else 1)
    wanted = {d for order, counts in of_each.items() for d in needed_nodal_diameters(n_blades, order, max(counts))}
    if harmonics is None:
        few = {d for order in orders for d in needed_nodal_diameters(n_blades, order, 3)}
        reason += f" and a march in time, at {len(wanted) / len(few):.2g} times the work and size of harmonics=3"
        wanted &= held or wanted
    return tuple(sorted({0, *wanted})), excited, reason


def _sector_faces(body: PreparedBody, given: tuple[NodeSet, NodeSet] | None, n_blades: int) -> tuple[NDArray, NDArray]:
    """Matching nodes of the face toward -X and of the one toward +X."""
    if n_blades == 1:
        return np.empty(0, int), np.empty(0, int)
    if given is None:
        raise SettingError("sector_faces: expected the two faces of the sector, since n_blades > 1; found none")
    if isinstance(given, str) or not isinstance(given, Sequence) or len(given) != 2:
        raise validate.unfit("sector_faces", "two sets of nodes, the faces at which the sector repeats", given)
    first, second = (body.node_set(s, "sector_faces") for s in given)
    # Nodes on the axis of rotation would be their own image; nothing in a disk stands there.
    pitch = 2.0 * np.pi / n_blades
    tolerance = BOUNDS.sector_faces * body.size
    problems = []
    for left, right, words in ((first, second, "the first set lies toward -X"), (second, first, "the sets came swapped")):
        try:
            matched = match_faces(body.nodes, left, right, pitch, tolerance)
        except ValueError as error:
            problems.append(str(error))
            continue
        body.checks.append(f"sector faces: {len(left)} pairs of nodes match within {tolerance:.2g} m; {words}")
        return left, matched
    expected = f"two sets of nodes of which a rotation by 2 pi/{n_blades} about the axis carries one onto the other"
    raise body.error("sector_faces", expected, f"{problems[0]}; the other way: {problems[1]}")


def _locations(given: Mapping[str, object] | None, bodies: Mapping[str, PreparedBody]) -> dict[str, tuple[str, int]]:
    """Body and node of each named location."""
    out = {}
    for name, value in ({} if given is None else validate.instance("locations", given, Mapping, "a mapping")).items():
        body = "blade"
        if isinstance(value, tuple) and len(value) == 2 and isinstance(value[0], str):
            body, value = value
        validate.require(body in bodies, f"location '{name}'", f"a body out of {sorted(bodies)}", f"'{body}'")
        out[name] = (body, bodies[body].node(value, f"location '{name}'"))
    return out


# -----------------------------------------------------------------------------------------------------------
# Model


@contextmanager
def _told(progress: bool | None, bodies: Mapping[str, PreparedBody], ring: Ring, wheel: bool) -> Iterator[None]:
    """The steps of the work on a bar, each as it begins."""
    if not (sys.stderr.isatty() if progress is None else validate.flag("progress", progress)):
        yield
        return
    waves = {*ring.diameters, *sampled_waves(ring.n_blades)} if wheel else ring.diameters
    total, done = len(waves) + len(bodies) - 1 + (ring.n_blades // 2 + 1 if wheel else 0), count()
    with stages("import", "step") as report:
        for body in bodies.values():
            body.step = lambda text: report(text, next(done), total)
        yield
        report("done", total, total)


def _reduced(
    bodies: Mapping[str, PreparedBody], laid: LaidContacts, places: Mapping[str, tuple[str, int]],
    counts: Mapping[str, int], damping_ratio: float, ring: Ring, fixed: NodeSet | None, wheel: NodeSet | None,
    shapes: LocalSizes | None, rows: Sequence[StressRows],
) -> dict[str, Body]:  # fmt: skip
    """All bodies with their modes, by the way that the numbers given for each of them allow."""
    made = {}
    for name, body in bodies.items():
        nodes = {key: node for key, (owner, node) in places.items() if owner == name}
        wanted = Wanted(laid.ports[name], laid.rows[name], nodes, counts[name], damping_ratio)
        part = None if wheel is None or name != "blade" else blade_part(body, wanted, ring, fixed, wheel, laid.interfaces)
        if name == "blade" and body.has_matrices:
            sectors = Sectors(body, wanted, ring, fixed, kept=() if part is None else sampled_waves(ring.n_blades))
            made[name] = constrained_from_matrices(sectors, rows)
            if part is not None:
                made[name] = with_local_basis(made[name], sectors, laid.interfaces, part, shapes or LocalSizes())
        elif name == "blade":
            made[name] = constrained_from_modes(body, wanted, ring)
        else:
            made[name] = free_from_matrices(body, wanted) if body.has_matrices else free_from_modes(body, wanted)
    if laid.ports["ground"]:
        made["ground"] = Body("ground", "ground", laid.ports["ground"])
    return made


def _assembled(
    bodies: Mapping[str, PreparedBody], laid: LaidContacts, places: Mapping[str, tuple[str, int]],
    made: Mapping[str, Body], rows: Sequence[StressRows], n_blades: int, check_units: bool,
) -> BuiltModel:  # fmt: skip
    """The model and its report."""
    if check_units:
        for name, body in bodies.items():
            check_lowest(body, made[name])
    checks = [check for body in bodies.values() for check in body.checks]
    model = Model(
        n_blades=n_blades,
        bodies=made,
        interfaces=laid.interfaces,
        locations={key: Location(key, b, bodies[b].nodes[node].copy()) for key, (b, node) in places.items()},
        contact=laid.stiffness,
        stress={own.name: own.set("blade", "bdamper.io.build_model, mean over elements at nodes") for own in rows},
        meshes={
            name: picture_mesh(body.boundary, body.nodes, body.pictures) for name, body in bodies.items() if body.elements
        },
    )
    check_model(model, where="built model")
    checks.append("the model passes the checks of the model file")
    report = ImportReport(
        sources={name: str(body.given) for name, body in bodies.items()},
        faces=laid.faces,
        checks=tuple(checks),
        failed=tuple(text for body in bodies.values() for text in body.failed),
        missing=tuple(text for body in bodies.values() for text in body.missing),
        model=model,
    )
    provenance = {
        "source": "; ".join(f"{name}: {body.given.source}" for name, body in bodies.items()),
        "made by": "bdamper.io.build_model",
        "date": datetime.date.today().isoformat(),
        "report": str(report)[:20000],
    }
    return BuiltModel(replace(model, provenance=provenance), report)
