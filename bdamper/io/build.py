"""A model from the finite element bodies of any program: checks, reduction, contact points.

The sector is called "blade" in the model, the free body "damper".  Everything is computed by the code that makes the
reference model (:mod:`bdamper.reduction`).  What a user could get wrong is computed rather than asked for wherever
possible: which of the two sector faces lies toward +X, in which sector a damper meets its neighbour, which way a wave
travels, mass, centre and inertia; and it is written into the report.
"""

from __future__ import annotations

import datetime
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, TypeVar

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from bdamper.io.fe_body import FEBody, Units
from bdamper.io.import_report import FaceSummary, ImportReport
from bdamper.io.model_file import save_model
from bdamper.io.modes_route import compare_modes, constrained_from_modes, free_from_modes
from bdamper.io.plausible import (
    check_frequencies_against,
    check_not_swapped,
    check_one_scale,
    check_radial,
    check_rigid_motion,
    check_sizes,
)
from bdamper.io.prepare import FaceSet, NodeSet, PreparedBody, placement
from bdamper.model.model import Body, ContactStiffness, Interface, Location, Model, Port, SurfaceMesh, turn
from bdamper.model.validation import check_model
from bdamper.reduction.bodies import constrained_body, free_body, needed_nodal_diameters
from bdamper.reduction.cyclic import CyclicSector, match_faces
from bdamper.reduction.facets import Facets, area_vectors, corner_count
from bdamper.reduction.free_body import FreeBody
from bdamper.reduction.patches import Patches, PatchMeans, patches_on_faces, patches_on_rectangles
from bdamper.util import validate
from bdamper.util.errors import BdamperError, ModelError, SettingError, mismatch
from bdamper.util.repr import brief

MATCH_TOLERANCE = 1e-5
"""Largest distance of matching nodes of the sector faces, relative to the size of the sector (files round positions)."""

SMALLEST_OVERLAP = 0.05
"""Share of the smaller face that two faces must have in common."""

FRAME_TOLERANCE = 1e-6
MOST_POINTS = 400
"""Contact points on one face: a study with more than some 200 is no longer one of seconds."""
MOST_MODES = 1000

T = TypeVar("T")


@brief
@dataclass(frozen=True)
class ContactFaces:
    """A pair of faces that touch, and how contact points are laid over them.

    Parameters
    ----------
    name : str
        Of the interface.
    faces_a : str, (n,) int, (n, 3 | 4 | 6 | 8) int, or tuple of such arrays
        On body a: name of a set, node numbers (the faces of elements between them are found), or faces of elements by
        their node numbers, seen from outside counter-clockwise.
    faces_b : the same, or None against the ground
    body_a, body_b : {"damper", "blade", "ground"}
    points : int or (int, int)
        Contact points, in all or along t1 and t2.
    kind : {"friction", "constraint"}
    sector_b : int, optional
        Sector in which body b is met, -1, 0 or 1; found from the positions by default.
    gap : float (m) or "measured"
        Initial normal distance, in metres; "measured" takes that of the two meshes.
    frame : (3, 3) float, optional
        Rows t1, t2, n in the axes of the model; by default n is the mean outward normal of face a, and t2 points
        against the axis of rotation.
    patches : Patches, optional
        Rectangles in the axes of the model, in place of a grid.
    stiffness : (3,) or (n_points, 3) float, N/m, optional
        Contact stiffness of the user along t1, t2, n.
    """

    name: str
    faces_a: FaceSet
    faces_b: FaceSet | None = None
    body_a: str = "damper"
    body_b: str = "blade"
    points: int | tuple[int, int] = 24
    kind: Literal["friction", "constraint"] = "friction"
    sector_b: int | None = None
    gap: float | Literal["measured"] = 0.0
    frame: NDArray | None = None
    patches: Patches | None = None
    stiffness: NDArray | tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        item = f"contact '{self.name}'"
        validate.instance("name of a contact", self.name, str, "a text")
        validate.choice(f"{item}: kind", self.kind, ("friction", "constraint"))
        pair = isinstance(self.points, Sequence | np.ndarray) and not isinstance(self.points, str | bytes)
        counts = tuple(self.points) if pair else (self.points,)  # type: ignore[arg-type]
        if len(counts) != (2 if pair else 1):
            raise validate.unfit(f"{item}: points", "a number of contact points or two, along t1 and t2", self.points)
        counts = tuple(validate.whole(f"{item}: points", n, 1, MOST_POINTS) for n in counts)
        if int(np.prod(counts)) > MOST_POINTS:
            raise validate.unfit(f"{item}: points", f"at most {MOST_POINTS} contact points on a face", self.points)
        object.__setattr__(self, "points", counts if pair else counts[0])
        if not (isinstance(self.gap, str) and self.gap == "measured"):
            if isinstance(self.gap, str):
                raise validate.unfit(f"{item}: gap", "a distance in metres or 'measured'", self.gap)
            object.__setattr__(self, "gap", validate.number(f"{item}: gap", self.gap, unit="m"))
        if self.sector_b is not None:
            object.__setattr__(self, "sector_b", validate.whole(f"{item}: sector_b", self.sector_b, -1, 1))
        if self.frame is not None:
            _check_frame(self.frame, item)


def _check_frame(frame: NDArray, item: str) -> None:
    rows = frame if isinstance(frame, np.ndarray | Sequence) and np.shape(frame) == (3, 3) else None
    axes = np.array([validate.numbers(f"{item}: frame", row, 3) for row in rows]) if rows is not None else np.zeros((3, 3))
    if not np.allclose(axes @ axes.T, np.eye(3), atol=FRAME_TOLERANCE) or np.linalg.det(axes) < 0.0:
        expected = "three rows t1, t2, n of length 1 at right angles, right-handed"
        raise validate.unfit(f"{item}: frame", expected, np.asarray(frame).tolist())


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


def build_model(
    blade: FEBody,
    damper: FEBody | None = None,
    *,
    n_blades: int,
    contacts: Sequence[ContactFaces],
    sector_faces: tuple[NodeSet, NodeSet] | None = None,
    fixed: NodeSet | None = None,
    locations: Mapping[str, object] | None = None,
    engine_order: int | None = None,
    harmonics: int = 7,
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
) -> BuiltModel:
    """Make a model from finite element bodies.

    Parameters
    ----------
    blade : FEBody
        One sector (or a whole structure, ``n_blades=1``), held at ``fixed`` or by rows missing from its matrices.
    damper : FEBody, optional
        A free body at its place beside the blade of this sector.
    n_blades : int
    contacts : sequence of ContactFaces
    sector_faces : (set, set), optional
        The two faces at which the sector repeats, in either order; needed if ``n_blades > 1``.
    fixed : set, optional
        Clamped nodes of the blade.
    locations : mapping of name to node number, position, or (body, node number or position)
        Where forces act and the response is read; positions in the axes and units of the file.
    engine_order, harmonics : int
        Decide which nodal diameters are made, unless ``nodal_diameters`` says it.
    nodal_diameters : sequence of int, optional
        0 to N/2; 0 is always added, for the bias.
    n_modes, n_damper_modes : int
        Modes of the sector at each nodal diameter, and of the damper, its six rigid ones included; fewer if the body
        has fewer.
    damping_ratio : float
        Of all elastic modes.
    units : str or Units
        Of the files: one of :data:`bdamper.io.UNITS` or factors.
    axis, radial, origin : (3,) float
        Axis of rotation, direction to the blade and a point on the axis, in the axes (and the unit of length) of the files.
    expected_frequencies : mapping of nodal diameter to frequencies (Hz), optional
        Known from the program that made the matrices; compared to 1 %, and a ratio that looks like a mistaken unit is
        named.
    check_units : bool
        Whether sizes, density and frequencies far from anything built are refused.

    Returns
    -------
    BuiltModel

    Raises
    ------
    ModelError, SettingError
        At the first thing that is wrong, naming it, what was expected and what was found.
    """
    place = placement(axis, radial, origin, units)
    n_blades = validate.whole("n_blades", n_blades, least=1)
    n_modes = validate.whole("n_modes", n_modes, 1, MOST_MODES)
    n_damper_modes = validate.whole("n_damper_modes", n_damper_modes, 6, MOST_MODES)
    damping_ratio = validate.number("damping_ratio", damping_ratio, least=0.0, below=1.0)
    validate.flag("check_units", check_units)
    validate.instance("blade", blade, FEBody, "an FEBody, as read_arrays returns it")
    if damper is not None:
        validate.instance("damper", damper, FEBody, "an FEBody, as read_arrays returns it")
    contacts = _given_contacts(contacts)
    for name, mapping in (("locations", locations), ("expected_frequencies", expected_frequencies)):
        if mapping is not None:
            validate.instance(name, mapping, Mapping, "a mapping")
    for d, known in (expected_frequencies or {}).items():
        validate.numbers(f"expected_frequencies at nodal diameter {d}", known, above=0.0, unit="Hz")
    bodies = {"blade": PreparedBody("blade", blade, place)}
    if damper is not None:
        bodies["damper"] = PreparedBody("damper", damper, place)
    for body in bodies.values():
        body.check_repeated()
    if check_units and "damper" in bodies:
        check_one_scale(bodies["blade"], bodies["damper"])
    check_radial(bodies["blade"], n_blades)
    for body in bodies.values():
        if body.has_matrices:
            check_not_swapped(body)
    diameters = _diameters(n_blades, engine_order, harmonics, nodal_diameters, blade)
    pitch = 2.0 * np.pi / n_blades
    left, right = _sector_faces(bodies["blade"], sector_faces, n_blades)

    interfaces: dict[str, Interface] = {}
    faces: list[FaceSummary] = []
    ports: dict[str, list[Port]] = {name: [] for name in (*bodies, "ground")}
    rows: dict[str, list[sp.csr_matrix]] = {name: [] for name in bodies}
    stiffness: dict[str, ContactStiffness] = {}
    for contact in contacts:
        interface, means, summary = _interface(contact, bodies, n_blades)
        interfaces[contact.name] = interface
        faces.append(summary)
        ports[contact.body_a].append((contact.name, "a"))
        ports[contact.body_b].append((contact.name, "b"))
        rows[contact.body_a].append(means.matrix_a)
        if means.matrix_b is not None:
            rows[contact.body_b].append(_in_own_sector(means.matrix_b, turn(pitch * interface.sector_b)))
        if contact.stiffness is not None:
            stiffness[contact.name] = _user_stiffness(contact, len(means.area))
    contact_rows = {
        name: sp.vstack(parts, format="csr") if parts else sp.csr_matrix((0, 3 * len(bodies[name].nodes)))
        for name, parts in rows.items()
    }
    places = _locations(locations or {}, bodies)
    nodes_of = {name: {key: node for key, (body, node) in places.items() if body == name} for name in bodies}

    missing: list[str] = []
    made = {
        "blade": _constrained(
            bodies["blade"], tuple(ports["blade"]), contact_rows["blade"], nodes_of["blade"], left, right, fixed, n_blades,
            diameters, n_modes, damping_ratio, missing,
        )
    }  # fmt: skip
    if "damper" in bodies:
        made["damper"] = _free(
            bodies["damper"], tuple(ports["damper"]), contact_rows["damper"], nodes_of["damper"], n_damper_modes,
            damping_ratio, missing,
        )  # fmt: skip
    if ports["ground"]:
        made["ground"] = Body("ground", "ground", tuple(ports["ground"]))

    frequencies = {d: np.sqrt(b.omega2) / (2.0 * np.pi) for d, b in made["blade"].bases.items()}
    checks = [check for body in bodies.values() for check in body.checks]
    if expected_frequencies:
        checks.append(check_frequencies_against(frequencies, expected_frequencies, "blade", "expected_frequencies"))
    if check_units:
        for name, body in bodies.items():
            checks += check_sizes(body, made[name])
    model = Model(
        n_blades=n_blades,
        bodies=made,
        interfaces=interfaces,
        locations={key: Location(key, b, bodies[b].nodes[node].copy()) for key, (b, node) in places.items()},
        contact=stiffness,
        meshes={name: _surface(body) for name, body in bodies.items() if body.elements},
    )
    check_model(model, where="built model")
    checks.append("the model passes the checks of the model file")
    free = made.get("damper")
    report = ImportReport(
        sources={name: str(body.given) for name, body in bodies.items()},
        frequencies=frequencies,
        damper_frequencies=np.sqrt(free.bases[0].omega2[6:]) / (2.0 * np.pi) if free is not None else np.empty(0),
        faces=tuple(faces),
        mass=free.mass if free is not None else None,
        centre=free.centre if free is not None else None,
        inertia=free.inertia if free is not None else None,
        checks=tuple(checks),
        missing=tuple(missing),
        model=model,
    )
    model = Model(
        model.n_blades, model.bodies, model.interfaces, model.locations, model.contact, model.static, model.meshes,
        provenance={
            "source": "; ".join(f"{name}: {body.given.source}" for name, body in bodies.items()),
            "made by": "bdamper.io.build_model",
            "date": datetime.date.today().isoformat(),
            "report": str(report)[:20000],
        },
    )  # fmt: skip
    return BuiltModel(model, report)


# -----------------------------------------------------------------------------------------------------------
# Settings


def _given_contacts(given: Sequence[ContactFaces]) -> tuple[ContactFaces, ...]:
    several = isinstance(given, Iterable) and not isinstance(given, str)
    contacts = tuple(validate.instance("contacts", contact, ContactFaces) for contact in given) if several else ()
    if not contacts:
        raise validate.unfit("contacts", "a sequence of one or more ContactFaces", given)
    repeated = [c.name for k, c in enumerate(contacts) if c.name in [other.name for other in contacts[:k]]]
    if repeated:
        raise SettingError(f"contacts: expected each name once, found '{repeated[0]}' twice")
    return contacts


def _diameters(
    n_blades: int, engine_order: int | None, harmonics: int, given: Sequence[int] | None, blade: FEBody
) -> tuple[int, ...]:
    if given is None:
        if engine_order is None:
            if n_blades > 1 and blade.stiffness is None and blade.modes:
                given = [m.nodal_diameter for m in blade.modes]
            elif n_blades > 1:
                raise SettingError("expected engine_order or nodal_diameters, found neither")
            else:
                given = (0,)
        else:
            order, most = validate.whole("engine_order", engine_order), validate.whole("harmonics", harmonics, 1, 64)
            given = needed_nodal_diameters(n_blades, order, most)
    wanted = validate.wholes("nodal_diameters", given, most=n_blades // 2)
    return tuple(sorted({0, *wanted}))


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
    tolerance = MATCH_TOLERANCE * body.size
    problems = []
    for left, right, words in ((first, second, "the first set lies toward -X"), (second, first, "the sets came swapped")):
        try:
            matched = match_faces(body.nodes, left, right, pitch, tolerance)
        except ValueError as error:
            problems.append(str(error))
            continue
        body.checks.append(f"sector faces: {len(left)} pairs of nodes match within {tolerance:.2g} m; {words}")
        return left, matched
    raise mismatch(
        f"{body.where}: sector_faces",
        f"two sets of nodes of which a rotation by 2 pi/{n_blades} about the axis carries one onto the other",
        f"{problems[0]}; the other way: {problems[1]}",
    )


def _locations(given: Mapping[str, object], bodies: Mapping[str, PreparedBody]) -> dict[str, tuple[str, int]]:
    out = {}
    for name, value in given.items():
        body = "blade"
        if isinstance(value, tuple) and len(value) == 2 and isinstance(value[0], str):
            body, value = value
        if body not in bodies:
            raise SettingError(f"location '{name}': expected a body out of {sorted(bodies)}, found '{body}'")
        out[name] = (body, bodies[body].node(value, f"location '{name}'"))
    return out


# -----------------------------------------------------------------------------------------------------------
# Contact


def _interface(
    contact: ContactFaces, bodies: Mapping[str, PreparedBody], n_blades: int
) -> tuple[Interface, PatchMeans, FaceSummary]:
    item = f"contact '{contact.name}'"
    if contact.body_a not in bodies:
        raise SettingError(f"{item}: expected body_a out of {sorted(bodies)}, found '{contact.body_a}'")
    if contact.body_b not in (*bodies, "ground"):
        raise SettingError(f"{item}: expected body_b out of {[*sorted(bodies), 'ground']}, found '{contact.body_b}'")
    if (contact.faces_b is None) != (contact.body_b == "ground"):
        raise SettingError(f"{item}: expected faces_b on '{contact.body_b}' (none on the ground)")
    a = bodies[contact.body_a]
    face_a = a.faces(contact.faces_a, item)
    sector = 0
    means: PatchMeans
    area_b = None
    what = (f"{item}, faces of the {contact.body_a}", f"{item}, faces of the {contact.body_b}")
    try:
        if contact.faces_b is None:
            if contact.patches is not None:
                means = patches_on_rectangles(contact.patches, a.nodes, face_a, what[0])
            else:
                means = patches_on_faces(contact.points, a.nodes, face_a, frame=contact.frame, what=what)
        else:
            b = bodies[contact.body_b]
            face_b = b.faces(contact.faces_b, item)
            sector = _sector_of(contact, a, face_a, b, face_b, n_blades)
            placed = b.nodes @ turn(2.0 * np.pi / n_blades * sector).T
            area_b = float(np.linalg.norm(area_vectors(face_b, placed), axis=1).sum())
            if contact.patches is not None:
                means = _on_both(contact.patches, a.nodes, face_a, placed, face_b, what)
            else:
                means = patches_on_faces(contact.points, a.nodes, face_a, placed, face_b, frame=contact.frame, what=what)
    except ValueError as error:
        if isinstance(error, BdamperError):
            raise
        raise mismatch(a.where, f"faces for {item} on which contact points can be laid", error) from error
    area_a = float(np.linalg.norm(area_vectors(face_a, a.nodes), axis=1).sum())
    area = float(means.area.sum())
    if area_b is not None and contact.patches is None and area < SMALLEST_OVERLAP * min(area_a, area_b):
        raise mismatch(
            f"{item} between {contact.body_a} and {contact.body_b}",
            f"faces that have at least {100 * SMALLEST_OVERLAP:.0f} % of the smaller one in common",
            f"{area:.4g} m2 of {area_a:.4g} and {area_b:.4g} m2",
        )
    distance = means.distance
    reach = np.sqrt(area)
    if np.abs(distance).max() > 0.2 * reach:
        raise mismatch(
            f"{item} between {contact.body_a} and {contact.body_b}",
            "faces that lie on each other",
            f"a distance of {distance[np.abs(distance).argmax()]:.4g} m with faces {reach:.4g} m wide",
        )
    if isinstance(contact.gap, str):  # "measured"
        gap = distance.copy()
    else:
        if abs(contact.gap) > 0.2 * reach:
            found = f"{contact.gap:.4g} m on a face {reach:.4g} m wide"
            raise mismatch(f"{item}: gap", "metres, much less than the width of the face", found)
        gap = np.full(len(means.area), float(contact.gap))
    interface = Interface(
        contact.name, contact.kind, contact.body_a, 0, contact.body_b, sector, means.points_a, means.area, means.frame, gap
    )
    summary = FaceSummary(
        contact.name,
        len(means.area),
        area,
        area_a,
        area_b,
        np.array([distance.min(), distance.max()]),
        sector,
        means.frame[:, 2].mean(axis=0),
    )
    return interface, means, summary


def _on_both(
    patches: Patches, nodes_a: NDArray, face_a: Facets, nodes_b: NDArray, face_b: Facets, what: tuple[str, str]
) -> PatchMeans:
    """Given rectangles on both bodies."""
    a = patches_on_rectangles(patches, nodes_a, face_a, what[0])
    b = patches_on_rectangles(patches, nodes_b, face_b, what[1])
    return PatchMeans(a.area, a.frame, a.points_a, b.points_a, a.matrix_a, b.matrix_a)


def _centre_and_normal(facets: Facets, nodes: NDArray) -> tuple[NDArray, NDArray]:
    vectors = area_vectors(facets, nodes)
    weight = np.linalg.norm(vectors, axis=1)
    middle = np.array([nodes[c].mean(axis=0) for c in facets.corners()])
    total = vectors.sum(axis=0)
    return weight @ middle / max(weight.sum(), 1e-300), total / max(np.linalg.norm(total), 1e-300)


def _sector_of(
    contact: ContactFaces, a: PreparedBody, face_a: Facets, b: PreparedBody, face_b: Facets, n_blades: int
) -> int:
    """Sector in which face b lies on face a: the one in which it comes nearest and looks the other way."""
    item = f"contact '{contact.name}' between {contact.body_a} and {contact.body_b}"
    allowed: tuple[int, ...] = (0,) if n_blades == 1 else (-1, 0, 1)
    candidates = allowed if contact.sector_b is None else (contact.sector_b,)
    if contact.sector_b is not None and contact.sector_b not in allowed:
        raise SettingError(f"contact '{contact.name}': expected sector_b in {list(allowed)}, found {contact.sector_b!r}")
    if contact.body_a == contact.body_b:
        candidates = tuple(s for s in candidates if s != 0)
        if not candidates:
            raise SettingError(f"contact '{contact.name}': a body touches itself in a neighbouring sector only")
    centre_a, normal_a = _centre_and_normal(face_a, a.nodes)
    scores = []
    for sector in candidates:
        rotation = turn(2.0 * np.pi / n_blades * sector)
        centre_b, normal_b = _centre_and_normal(face_b, b.nodes @ rotation.T)
        scores.append((float(np.linalg.norm(centre_b - centre_a)), float(normal_a @ normal_b), sector))
    distance, product, sector = min(scores)
    if product > -0.5:
        raise mismatch(
            item,
            "outward normals that point at each other (faces seen from outside counter-clockwise)",
            f"a cosine of {product:.3f} between them in sector {sector:+d}, {distance:.4g} m apart",
        )
    return sector


def _in_own_sector(matrix: sp.csr_matrix, rotation: NDArray) -> sp.csr_matrix:
    """Rows of body b for displacements in the axes of its own sector.

    ``matrix`` takes displacements at the place of contact, along axes that do not turn with the sector; a body ``s``
    sectors on moves there by ``R^s`` times its own displacement (and a phase, which enters later).
    """
    n = matrix.shape[1] // 3
    return (matrix @ sp.kron(sp.identity(n), sp.csr_matrix(rotation), format="csr")).tocsr()


def _user_stiffness(contact: ContactFaces, n: int) -> ContactStiffness:
    values = np.asarray(contact.stiffness, float)
    if values.shape not in ((3,), (n, 3)) or not (np.isfinite(values).all() and np.all(values >= 0.0)):
        raise SettingError(f"contact '{contact.name}': expected stiffness (3,) or ({n}, 3) >= 0 N/m, found {values.shape}")
    return ContactStiffness(np.broadcast_to(values, (n, 3)).copy(), "user")


# -----------------------------------------------------------------------------------------------------------
# Bodies


def _library(item: str, expected: str, action: Callable[[], T]) -> T:
    """Run an action of SciPy or of the reduction; what it raises becomes one error of a line."""
    try:
        return action()
    except BdamperError:
        raise
    except (ValueError, RuntimeError, ArithmeticError, np.linalg.LinAlgError, MemoryError) as error:
        raise mismatch(item, expected, error) from error


def _constrained(
    body: PreparedBody,
    ports: tuple[Port, ...],
    contact: sp.csr_matrix,
    locations: Mapping[str, int],
    left: NDArray,
    right: NDArray,
    fixed: NodeSet | None,
    n_blades: int,
    diameters: tuple[int, ...],
    n_modes: int,
    damping_ratio: float,
    missing: list[str],
) -> Body:
    if not body.has_matrices:
        return constrained_from_modes(
            body, ports, contact, locations, left, right, n_blades, diameters, n_modes, damping_ratio, missing
        )
    held = None if fixed is None else body.node_set(fixed, "fixed")
    mask = body.fixed(held)
    structure = body.structure
    _check_reached(body, contact, locations, mask, held)
    free = int((~mask).sum())
    if free < 12:
        raise mismatch(f"{body.where}: matrices", "more than a dozen free components", f"{free}")
    wanted = min(n_modes, max(1, (free - 3 * len(right)) // 2))
    made: dict[int, CyclicSector] = {}

    def sector(d: int) -> CyclicSector:
        made.clear()  # a factorisation is large: keep one at a time
        made[d] = _library(
            f"{body.where}: nodal diameter {d}",
            "fixed nodes alike on both sector faces",
            lambda: CyclicSector(structure, left, right, mask, n_blades, d),
        )
        _check_held(body, made[d], d, bool(mask.any()))
        return made[d]

    built = _library(
        f"{body.where}: matrices",
        "a positive definite stiffness (fixed nodes?) and a positive definite mass matrix",
        lambda: constrained_body(
            "blade", ports, sector, contact, locations, diameters, wanted, damping_ratio, frozenset(diameters)
        ),
    )
    for d, basis in built.bases.items():
        _check_positive(body, d, basis.omega2)
    body.checks.append("stiffness symmetric and positive definite at every nodal diameter, mass symmetric")
    if wanted < n_modes:
        body.checks.append(f"{wanted} modes instead of {n_modes}: the body has no more to give")
    body.checks += compare_modes(body, built, left, right, n_blades)
    return built


def _check_held(body: PreparedBody, sector: CyclicSector, d: int, held: bool) -> None:
    """The pivots of the factorisation show a stiffness that is indefinite, or a body that is not held."""
    factor = sector.solver
    pivots = factor.U.diagonal().real
    if not held and np.abs(pivots).min() < 1e-9 * np.median(np.abs(pivots)):
        raise mismatch(
            f"{body.where}: stiffness matrix, nodal diameter {d}",
            "a body that is held: fixed=(a set of nodes), or components without rows in the matrices",
            "neither, and some motion costs no force: nothing holds the sector",
        )
    if np.array_equal(factor.perm_r, factor.perm_c) and np.any(pivots <= 0.0):
        raise mismatch(
            f"{body.where}: stiffness matrix, nodal diameter {d}",
            "a positive definite matrix",
            f"{int((pivots <= 0.0).sum())} negative eigenvalues",
        )
    scale = np.median(np.abs(sector.stiffness.diagonal()))
    if np.abs(pivots).min() < 1e-13 * scale:
        raise mismatch(
            f"{body.where}: stiffness matrix, nodal diameter {d}",
            "a body that is held (fixed nodes, or rows left out of the matrices)",
            f"a pivot {np.abs(pivots).min() / scale:.2g} times the stiffness of a node: some motion costs no force",
        )


def _check_positive(body: PreparedBody, d: int, omega2: NDArray) -> None:
    if not (np.isfinite(omega2).all() and omega2[0] > 0.0):
        raise mismatch(f"{body.where}: nodal diameter {d}", "squared frequencies > 0", f"{omega2[0]:.6g}")
    # A body that is not held has six squared frequencies that are rounding.
    if len(omega2) > 1 and omega2[0] < 1e-10 * omega2[-1]:
        raise mismatch(
            f"{body.where}: nodal diameter {d}",
            "a sector that is held (fixed nodes)",
            f"a frequency of {np.sqrt(omega2[0]) / (2 * np.pi):.3g} Hz beside {np.sqrt(omega2[-1]) / (2 * np.pi):.3g} Hz",
        )


def _check_reached(
    body: PreparedBody, contact: sp.csr_matrix, locations: Mapping[str, int], mask: NDArray, held: NDArray | None
) -> None:
    """Contact faces and locations have rows in the matrices."""
    empty = np.flatnonzero(mask.all(axis=1))
    if held is not None:
        empty = np.setdiff1d(empty, held)
    touched = np.unique(contact.indices // 3)
    wrong = np.intersect1d(touched, empty)
    if len(wrong):
        raise mismatch(
            f"{body.where}: contact faces",
            "nodes with rows in the matrices",
            f"node {body.given.numbers[wrong[0]]} and {len(wrong)} such in all without any",
        )
    for name, node in locations.items():
        if node in empty:
            raise mismatch(
                f"{body.where}: location '{name}'", "a node with rows in the matrices", f"node {body.given.numbers[node]}"
            )


def _free(
    body: PreparedBody,
    ports: tuple[Port, ...],
    contact: sp.csr_matrix,
    locations: Mapping[str, int],
    n_modes: int,
    damping_ratio: float,
    missing: list[str],
) -> Body:
    if not body.has_matrices:
        return free_from_modes(body, ports, contact, locations, n_modes, damping_ratio, missing)
    mask = body.fixed(None)
    if mask.any():
        wrong = body.used[mask[body.used].any(axis=1)]
        if len(wrong):
            raise mismatch(
                f"{body.where}: matrices",
                "rows for all three components of every node of a free body",
                f"some missing at node {body.given.numbers[wrong[0]]} and {len(wrong)} such in all",
            )
        raise mismatch(f"{body.where}: matrices", "no nodes without rows on a free body", f"{int(mask.any(axis=1).sum())}")
    structure = body.structure
    check_rigid_motion(body, structure)
    free: FreeBody = _library(
        f"{body.where}: mass matrix", "a positive definite matrix", lambda: FreeBody(structure, np.eye(3))
    )
    outward = free.centre * [1.0, 1.0, 0.0]
    if np.linalg.norm(outward) < 1e-6 * max(body.size, 1e-300):
        raise mismatch(f"{body.where}: centre of mass", "a place off the axis of rotation", f"{free.centre} m")
    radial = outward / np.linalg.norm(outward)
    # Rigid translations along the damper's own tangential, radial and axial direction.
    free = FreeBody(structure, np.array([np.cross(radial, [0.0, 0.0, 1.0]), radial, [0.0, 0.0, 1.0]]))
    wanted = min(n_modes, max(6, structure.n_dof // 2))
    built = _library(
        f"{body.where}: matrices",
        "a stiffness matrix with six rigid-body motions and no others",
        lambda: free_body("damper", ports, free, contact, locations, wanted, damping_ratio, radial),
    )
    omega2 = built.bases[0].omega2
    if len(omega2) > 6 and not omega2[6] > 0.0:
        raise mismatch(
            f"{body.where}: stiffness matrix", "six rigid-body motions and no others", f"omega2 = {omega2[6]:.3g}"
        )
    moments = np.linalg.eigvalsh(free.inertia)
    body.checks.append(
        f"damper: six rigid-body motions without force; mass {free.total_mass:.6g} kg, principal moments "
        + ", ".join(f"{m:.4g}" for m in moments)
        + " kg m2"
    )
    return built


def _surface(body: PreparedBody) -> SurfaceMesh:
    """Quadrilaterals of the outer surface; triangles repeat their last corner."""
    quads = []
    for group in body.boundary.groups:
        n = corner_count(group.shape[1])
        quads.append(group[:, [0, 1, 2, 3 if n == 4 else 2]])
    stacked = np.concatenate(quads)
    used, compact = np.unique(stacked, return_inverse=True)
    return SurfaceMesh(body.nodes[used].copy(), compact.reshape(stacked.shape))


__all__ = ["BuiltModel", "ContactFaces", "ModelError", "build_model"]
