"""Interfaces of an imported model: pairs of faces in contact, and their contact points.

The displacement of a contact point is the mean over a patch that both faces share
(:mod:`bdamper.fem.contact_patches`).  The sector in which a damper touches its neighbour follows
from the positions and normals of the faces.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from bdamper.fem.contact_patches import Patches, PatchMeans, patches_on_faces, patches_on_rectangles
from bdamper.fem.surface import Facets, area_vectors
from bdamper.importers.fe_body import BOUNDS
from bdamper.importers.prepared_body import FaceSet, PreparedBody
from bdamper.model.contact_points import ROWS
from bdamper.model.structure import ContactStiffness, Interface, Port, turn
from bdamper.util import quantities, validation
from bdamper.util.errors import check, warn_implausible
from bdamper.util.formatting import area_text, short_repr


@short_repr
@dataclass(frozen=True)
class ContactFaces:
    """Pair of faces in contact, and the arrangement of its contact points.

    Parameters
    ----------
    name : str
        Name of the interface.
    faces_a : str, (n,) int, (n, 3 | 4 | 6 | 8) int, or tuple of such two-dimensional arrays
        Face of body a: name of a set, node numbers that include complete element faces, or element
        faces by their node numbers, counter-clockwise as seen from outside.
    faces_b : str, int array or tuple of int arrays, optional
        Face of body b in the same form; None for a contact with the ground.
    body_a, body_b : {"damper", "blade", "ground"}, or the name of one of several free bodies
    points : int or (int, int)
        Maximum number of contact points, or their numbers along t1 and t2; a free body needs three
        along t1. A single number is reduced to the number of points that the coarser mesh of the
        two faces resolves.
    kind : {"friction", "constraint"}
        A constraint has no friction.
    sector_b : {-1, 0, 1}, optional
        Sector of body b.  By default it follows from the positions of the faces.
    gap : float or "measured"
        Initial normal distance in the unit of length of the files; "measured" takes the distance of
        the meshes.
    patches : Patches, optional
        Rectangles in one plane, in the axes of the model, which replace the grid.  In a grid the
        normal n is the mean outward normal of face a, and t2 points against the axis of rotation.
    stiffness : (3,) or (n_points, 3) float, N/m, optional
        Contact stiffness along t1, t2, n.

    Raises
    ------
    SettingError
        If a value has the wrong type or is out of range.
    """

    name: str
    faces_a: FaceSet
    faces_b: FaceSet | None = None
    body_a: str = "damper"
    body_b: str = "blade"
    points: Annotated[int | tuple[int, int], _points] = 24
    kind: Literal["friction", "constraint"] = "friction"
    sector_b: Annotated[int, partial(validation.integer, least=-1, most=1)] | None = None
    gap: Annotated[float | Literal["measured"], _gap] = 0.0
    patches: Patches | None = None
    stiffness: Annotated[NDArray | tuple[float, float, float], _stiffness] | None = None

    def __post_init__(self) -> None:
        validation.instance("name of a contact", self.name, str, "a text")
        validation.check_fields(self, f"{self.item}: ")

    @property
    def item(self) -> str:
        """Name of the contact in messages."""
        return f"contact '{self.name}'"


def _points(name: str, points: int | tuple[int, int]) -> int | tuple[int, ...]:
    """Check one or two numbers of contact points."""
    is_sequence = isinstance(points, Sequence | np.ndarray) and not isinstance(points, str | bytes)
    counts = tuple(points) if is_sequence else (points,)  # type: ignore[arg-type]
    expected = "a number of contact points or two, along t1 and t2"
    validation.check_value(not is_sequence or len(counts) == 2, name, expected, points)
    counts = tuple(validation.integer(name, n, least=1, most=BOUNDS.points) for n in counts)
    expected = f"at most {BOUNDS.points} contact points on a face"
    validation.check_value(np.prod(counts) <= BOUNDS.points, name, expected, points)
    return counts if is_sequence else counts[0]


def _gap(name: str, gap: float | str) -> float | str:
    """Check a distance, or the text "measured"."""
    if not isinstance(gap, str):
        return validation.number(name, gap)
    expected = "a distance in the units of the files, or 'measured'"
    validation.check_value(gap == "measured", name, expected, gap)
    return gap


def _stiffness(name: str, stiffness: Any) -> Any:
    """Convert quantities; their number is checked when the number of points is known."""
    return quantities.in_lists(name, stiffness, "N/m")


@dataclass(frozen=True)
class LaidContacts:
    """Interfaces of a model, and the displacements of contact points as functions of nodal
    displacements.

    Parameters
    ----------
    interfaces : dict of interface name to Interface
    stiffness : dict of interface name to ContactStiffness
        Contact stiffness from the user.
    faces : tuple of str
        Area, overlap and normal of each interface, for the report.
    overlaps : dict of interface name to str
        Shares of both faces, and the sector of side b.
    ports : dict of body name to tuple of Port
        Interfaces and sides of each body.
    rows : dict of body name to (3 n_points, 3 n_nodes) sparse
        Displacements at the contact points of the ports from the nodal displacements of the body in
        its own sector.
    """

    interfaces: dict[str, Interface]
    stiffness: dict[str, ContactStiffness]
    faces: tuple[str, ...]
    overlaps: dict[str, str]
    ports: dict[str, tuple[Port, ...]]
    rows: dict[str, sp.csr_matrix]


def from_first_sector(
    contacts: Sequence[ContactFaces], bodies: Mapping[str, PreparedBody], n_blades: int
) -> tuple[tuple[ContactFaces, ...], dict[str, PreparedBody]]:
    """Move free bodies to the position between the blades of sectors 0 and 1.

    A damper that is meshed at another blade, or on the other side of the blade, is rotated by whole
    sectors.

    Parameters
    ----------
    contacts : sequence of ContactFaces
    bodies : mapping of name to PreparedBody
    n_blades : int

    Returns
    -------
    contacts : tuple of ContactFaces
        Contacts with the free body as body a.
    bodies : dict of name to PreparedBody
    """
    # the ground, which is not among the bodies, stays body b
    contacts = tuple(
        _from_free(contact) if contact.body_b in bodies else contact for contact in contacts
    )
    moved = dict(bodies)
    for name, body in bodies.items():
        if name == "blade":
            continue
        sector = _sector_drawn(name, contacts, bodies, n_blades)
        if sector == 0:
            continue
        back = turn(-2.0 * np.pi / n_blades * sector)
        # the body turns if the direction that becomes Y turns
        radial = (back @ body.placement.rotation)[1]
        moved[name] = replace(body, placement=replace(body.placement, radial=radial))
        body.passed(f"{name}: {sector:+d} sectors away in the mesh, moved between blades 0 and 1")
        contacts = tuple(
            _turned(contact, back, sector) if contact.body_a == name else contact
            for contact in contacts
        )
    return contacts, moved


def _sector_drawn(
    name: str, contacts: Sequence[ContactFaces], bodies: Mapping[str, PreparedBody], n_blades: int
) -> int:
    """Return the place of a free body in the mesh, in sectors from that between blades 0 and 1."""
    damper, blade = bodies[name], bodies["blade"]
    touched = set()
    for contact in contacts:
        if (contact.body_a, contact.body_b) != (name, "blade") or contact.faces_b is None:
            continue
        face_a = damper.faces(contact.faces_a, contact.item)
        face_b = blade.faces(contact.faces_b, contact.item)
        nearest = _nearest(range(n_blades), damper, face_a, blade, face_b, n_blades)
        touched.add(nearest.sector)
    # of two neighbouring blades, the one whose predecessor the body does not touch
    for sector in touched:
        if (sector - 1) % n_blades not in touched:
            return sector if 2 * sector <= n_blades else sector - n_blades
    return 0


def _from_free(contact: ContactFaces) -> ContactFaces:
    """Exchange bodies a and b if the free body is body b."""
    moves_faces_only = contact.patches is None and contact.faces_b is not None
    if not moves_faces_only or contact.body_a != "blade" or contact.body_b == "blade":
        return contact
    return replace(
        contact,
        body_a=contact.body_b,
        body_b="blade",
        faces_a=contact.faces_b,  # type: ignore[arg-type]
        faces_b=contact.faces_a,
        sector_b=None if contact.sector_b is None else -contact.sector_b,
    )


def _turned(contact: ContactFaces, back: NDArray, sector: int) -> ContactFaces:
    """Return the contact after the rotation of its damper by ``back`` (3, 3), some sectors."""
    patches = None if contact.patches is None else contact.patches.turned(back)
    if contact.sector_b is None or contact.body_b == "ground":
        sector_b = None
    else:
        sector_b = contact.sector_b - sector
    return replace(contact, patches=patches, sector_b=sector_b)


def lay_contacts(
    contacts: Sequence[ContactFaces],
    bodies: Mapping[str, PreparedBody],
    n_blades: int,
    rings: Collection[str] = (),
) -> LaidContacts:
    """Compute the contact points of all pairs of faces.

    Parameters
    ----------
    contacts : sequence of ContactFaces
    bodies : mapping of name to PreparedBody
    n_blades : int
    rings : collection of str
        Bodies whose contact axes turn with the position along the circumference.

    Returns
    -------
    LaidContacts

    Raises
    ------
    ModelError, SettingError
        If a body or set does not exist, or two faces are not in contact.
    """
    interfaces: dict[str, Interface] = {}
    stiffness: dict[str, ContactStiffness] = {}
    figures: list[str] = []
    overlaps: dict[str, str] = {}
    laid: list[ContactFaces] = []
    ports: dict[str, list[Port]] = {name: [] for name in (*bodies, "ground")}
    rows = {name: [sp.csr_matrix((0, 3 * len(body.nodes)))] for name, body in bodies.items()}
    metres = bodies["blade"].placement.units.length
    for contact in contacts:
        if not isinstance(contact.gap, str):
            contact = replace(contact, gap=metres * contact.gap)
        along_ring = contact.body_a in rings or contact.body_b in rings
        interface, means, overlap = _laid(contact, bodies, n_blades, along_ring)
        for earlier in laid:
            _check_other_faces(contact, interface, earlier, interfaces[earlier.name], bodies)
        laid.append(contact)
        interfaces[contact.name] = interface
        figures.append(_face_text(contact, means, overlap))
        overlaps[contact.name] = overlap
        ports[contact.body_a].append((contact.name, "a"))
        ports[contact.body_b].append((contact.name, "b"))
        rows[contact.body_a].append(means.matrix_a)
        if means.matrix_b is not None:
            # In sector s the displacements of body b are rotated by R^s.  Their phase enters with
            # the nodal diameter.
            rotation = sp.csr_matrix(turn(2.0 * np.pi / n_blades * interface.sector_b))
            n_nodes = means.matrix_b.shape[1] // 3
            rotations = sp.kron(sp.identity(n_nodes), rotation, format="csr")
            rows[contact.body_b].append((means.matrix_b @ rotations).tocsr())
        if contact.stiffness is not None:
            stiffness[contact.name] = _user_stiffness(contact, len(means.area))
    return LaidContacts(
        interfaces,
        stiffness,
        tuple(figures),
        overlaps=overlaps,
        ports={name: tuple(of_body) for name, of_body in ports.items()},
        rows={name: sp.vstack(of_body, format="csr") for name, of_body in rows.items()},
    )


def _check_other_faces(
    contact: ContactFaces,
    interface: Interface,
    earlier_contact: ContactFaces,
    earlier: Interface,
    bodies: Mapping[str, PreparedBody],
) -> None:
    """Raise ModelError if two contacts are the same pair of faces, in either order of bodies."""
    # the sector of body b is relative to body a, so its sign changes with the order
    pair = (interface.body_a, interface.body_b, interface.sector_b)
    same = pair == (earlier.body_a, earlier.body_b, earlier.sector_b)
    exchanged = pair == (earlier.body_b, earlier.body_a, -earlier.sector_b)
    expected = f"other faces than those of contact '{earlier_contact.name}'"
    if contact.patches is not None or earlier_contact.patches is not None:
        # several patches may lie on one face, but not in the same place
        difference = interface.points[:, None] - earlier.points[None]  # (point, earlier point, 3)
        apart = np.linalg.norm(difference, axis=2)
        near = 1e-6 * np.sqrt(min(interface.area.min(), earlier.area.min()))
        n_repeated = int((apart < near).any(axis=1).sum())
        found = f"{n_repeated} contact points at the same positions"
        check(not (same and n_repeated), contact.item, expected, found)
        return
    if same:
        _check_sides(contact, earlier_contact, ("a", "b"), bodies, expected)
    if exchanged:
        _check_sides(contact, earlier_contact, ("b", "a"), bodies, expected)


def _check_sides(
    contact: ContactFaces,
    earlier: ContactFaces,
    sides: tuple[str, str],
    bodies: Mapping[str, PreparedBody],
    expected: str,
) -> None:
    """Raise ModelError if two contacts share elements of both faces.

    Sides a and b are compared with ``sides`` of the earlier contact.  One shared face is permitted.
    ``expected`` is the text of the error.
    """
    n_shared = []
    for side, earlier_side in zip(("a", "b"), sides):
        body = contact.body_a if side == "a" else contact.body_b
        if body == "ground":
            continue
        elements = _elements_of(contact, side, bodies)
        n_shared.append(len(elements & _elements_of(earlier, earlier_side, bodies)))
    found = f"{max(n_shared)} element faces of both; remove one of the contacts"
    check(min(n_shared) == 0, contact.item, expected, found)


def _elements_of(
    contact: ContactFaces, side: str, bodies: Mapping[str, PreparedBody]
) -> set[tuple[int, ...]]:
    """Return the element faces on one side of a contact, each as its sorted corners."""
    if side == "a":
        body, faces = contact.body_a, contact.faces_a
    else:
        assert contact.faces_b is not None
        body, faces = contact.body_b, contact.faces_b
    facets = bodies[body].faces(faces, contact.item)
    sorted_corners: set[tuple[int, ...]] = set()
    # one array of faces for each number of corners
    for group in facets.corners:
        sorted_corners.update(tuple(sorted(corners)) for corners in group.tolist())
    return sorted_corners


def _user_stiffness(contact: ContactFaces, n_points: int) -> ContactStiffness:
    """Return the stiffness of the user at each contact point."""
    values = np.asarray(contact.stiffness, float)
    good = values.shape in ((3,), (n_points, 3)) and np.isfinite(values).all()
    expected = f"stiffness (3,) or ({n_points}, 3) >= 0 N/m"
    validation.check(good and (values >= 0.0).all(), contact.item, expected, values.shape)
    return ContactStiffness(np.broadcast_to(values, (n_points, 3)).copy(), "user")


def _laid(
    contact: ContactFaces, bodies: Mapping[str, PreparedBody], n_blades: int, along_ring: bool
) -> tuple[Interface, PatchMeans, str]:
    """Return interface, patch means and, as text, the overlap of one pair of faces."""
    item, body_a, body_b = contact.item, contact.body_a, contact.body_b
    validation.check(body_a in bodies, item, f"body_a out of {sorted(bodies)}", f"'{body_a}'")
    allowed = [*sorted(bodies), "ground"]
    validation.check(body_b in allowed, item, f"body_b out of {allowed}", f"'{body_b}'")
    has_b = contact.faces_b is not None
    if body_b == "ground":
        validation.check_sentence(not has_b, item, "omit faces_b for a contact with the ground")
    else:
        validation.check_sentence(has_b, item, f"give faces_b, the contact faces of '{body_b}'")
    a = bodies[body_a]
    face_a = a.faces(contact.faces_a, item)
    areas = [_area(face_a, a.nodes)]
    sector = 0
    face_b, nodes_b = None, None
    with a.refusing(item, "faces on which contact points can be placed"):
        if contact.faces_b is not None:
            b = bodies[body_b]
            face_b = b.faces(contact.faces_b, item)
            sector = _sector_of(contact, a, face_a, b, face_b, n_blades)
            nodes_b = b.nodes @ turn(2.0 * np.pi / n_blades * sector).T
            areas.append(_area(face_b, nodes_b))
        means = _means(contact, a.nodes, face_a, nodes_b, face_b)
        if along_ring and contact.patches is None:
            means = _along_circumference(means)
    _check_touching(contact, means, areas)
    distance = means.distance
    if isinstance(contact.gap, str):
        gap = distance.copy()  # as measured
    else:
        gap = np.full(len(means.area), float(contact.gap))
    interface = Interface(
        name=contact.name,
        kind=contact.kind,
        body_a=body_a,
        sector_a=0,
        body_b=body_b,
        sector_b=sector,
        points=means.points_a,
        area=means.area,
        frame=means.frame,
        gap=gap,
    )
    # a grid of 0 rows consists of the rectangles of the user
    rolls = body_a != "blade" and not along_ring
    if contact.kind == "friction" and rolls and 0 < means.grid[0] < ROWS:
        expected = (
            f"at least {ROWS} rows of contact points along t1, "
            "which keep a damper from rolling on its faces"
        )
        found = f"{means.grid[0]}: amplitudes of a wedge may be wrong by several times"
        warn_implausible(item, expected, found)
    area = float(means.area.sum())
    fractions = [f"{100 * area / whole:.4g} % of face {side}" for side, whole in zip("ab", areas)]
    return interface, means, f"{', '.join(fractions)}; side b in sector {sector:+d}"


def _face_text(contact: ContactFaces, means: PatchMeans, overlap: str) -> str:
    """Return number of points, area, overlap and normal of an interface, for the report."""
    area = area_text(float(means.area.sum()))
    # a component that is zero but for rounding has no sign
    mean_normal = means.frame[:, 2].mean(axis=0).round(4) + 0.0
    normal = ", ".join(f"{component:.4f}" for component in mean_normal)
    distance = means.distance
    return (
        f"{contact.name}: {_points_text(contact, means)}, {area}, {overlap}\n"
        f"mean outward normal of side a ({normal}), "
        f"meshes {distance.min():.2g} to {distance.max():.2g} m apart"
    )


def _points_text(contact: ContactFaces, means: PatchMeans) -> str:
    """Return the number of points, and why it was chosen, for the report."""
    text = f"{len(means.area)} points"
    if not means.lines:
        return text
    n_1, n_2 = means.grid
    meshes = " and ".join(
        f"{face.along_1} x {face.along_2} on side {side}" for face, side in zip(means.lines, "ab")
    )
    chosen = f"{n_1} x {n_2} along t1 and t2; lines of nodes: {meshes}"
    if isinstance(contact.points, tuple):
        return f"{text} ({chosen})"
    if n_1 * n_2 < contact.points:
        chosen += f", which do not resolve {contact.points} points"
    return f"{text} ({chosen})"


def _means(
    contact: ContactFaces,
    nodes_a: NDArray,
    face_a: Facets,
    nodes_b: NDArray | None,
    face_b: Facets | None,
) -> PatchMeans:
    """Return the means over the rectangles of the user, or over a grid on the overlap."""
    what_a = f"{contact.item}, faces of the {contact.body_a}"
    what_b = f"{contact.item}, faces of the {contact.body_b}"
    if contact.patches is None:
        what = (what_a, what_b)
        return patches_on_faces(contact.points, nodes_a, face_a, nodes_b, face_b, what=what)
    on_face_a = patches_on_rectangles(contact.patches, nodes_a, face_a, what_a)
    if nodes_b is None or face_b is None:
        return on_face_a
    # means over one face, here face b, have the names of body a
    on_face_b = patches_on_rectangles(contact.patches, nodes_b, face_b, what_b)
    return replace(on_face_a, points_b=on_face_b.points_a, matrix_b=on_face_b.matrix_a)


def _along_circumference(means: PatchMeans) -> PatchMeans:
    """Turn the axes of each patch about the axis of rotation, from the middle of the face to the
    patch.
    """
    # in the direction of the middle of the face; the total area does not change the direction
    middle_x, middle_y, _ = means.area @ means.points_a
    angle_of_middle = np.arctan2(middle_x, middle_y)
    x = means.points_a[:, 0]
    y = means.points_a[:, 1]
    angles = np.arctan2(x, y) - angle_of_middle
    frame = np.array([axes @ turn(angle).T for axes, angle in zip(means.frame, angles)])
    # components along the new axes from components along the old ones
    change = sp.block_diag(frame @ means.frame.transpose(0, 2, 1), format="csr")
    matrix_b = None if means.matrix_b is None else (change @ means.matrix_b).tocsr()
    matrix_a = (change @ means.matrix_a).tocsr()
    return replace(means, frame=frame, matrix_a=matrix_a, matrix_b=matrix_b)


def _area(face: Facets, nodes: NDArray) -> float:
    return float(np.linalg.norm(area_vectors(face, nodes), axis=1).sum())


def _check_touching(contact: ContactFaces, means: PatchMeans, areas: Sequence[float]) -> None:
    """Raise ModelError if two faces hardly overlap or are far apart; warn about a smaller misfit.

    A smaller misfit indicates a body that is not at its position in the assembly.
    """
    item = contact.item
    distance = means.distance
    area = float(means.area.sum())
    width = np.sqrt(area)
    share = area / min(areas)
    # rectangles of the user, or a face toward the ground, need not cover a whole face
    overlap_counts = contact.patches is None and len(areas) == 2
    expected = f"faces that have at least {100 * BOUNDS.overlap:.0f} % of the smaller one in common"
    found = f"{area:.4g} m2 of {' and '.join(f'{whole:.4g}' for whole in areas)} m2"
    check(not overlap_counts or share >= BOUNDS.overlap, item, expected, found)
    # with its sign
    farthest = distance[np.abs(distance).argmax()]
    found = f"a distance of {farthest:.4g} m with faces {width:.4g} m wide"
    close = abs(farthest) <= BOUNDS.distance * width
    check(close, item, "faces that lie on each other", found)
    if not isinstance(contact.gap, str):
        _check_gap(contact, contact.gap, distance, width, two_faces=len(areas) == 2)
    equal_areas = overlap_counts and max(areas) <= (1.0 + BOUNDS.agreement) * min(areas)
    if equal_areas and share < 1.0 - BOUNDS.misfit:
        shift = (1.0 - share) * width
        expected = f"faces of equal areas that match to {100 * BOUNDS.misfit:g} %"
        found = f"{100.0 * share:.3g} % in common, as after a shift by about {shift:.2g} m"
        warn_implausible(item, expected, found)


def _check_gap(
    contact: ContactFaces, gap: float, distance: NDArray, width: float, *, two_faces: bool
) -> None:
    """Raise ModelError for a gap as wide as the face; warn if the meshes have another distance."""
    expected = "much less than the width of the face, in the units of the files"
    found = f"{gap:.4g} m on a face {width:.4g} m wide"
    check(abs(gap) <= BOUNDS.distance * width, f"{contact.item}: gap", expected, found)
    misfit = distance - gap
    worst = float(misfit[np.abs(misfit).argmax()])
    limit = BOUNDS.misfit * width
    if two_faces and abs(worst) > limit:
        expected = f"meshes within {limit:.2g} m of the gap {gap:g} m (or gap='measured')"
        found = f"{abs(worst):.3g} m {'farther apart' if worst > 0.0 else 'of overlap'}"
        warn_implausible(contact.item, expected, found)


def _centre_and_normal(facets: Facets, nodes: NDArray) -> tuple[NDArray, NDArray]:
    """Return the centre of a face and its mean outward normal."""
    vectors = area_vectors(facets, nodes)
    areas = np.linalg.norm(vectors, axis=1)
    middles = np.concatenate([nodes[corners].mean(axis=1) for corners in facets.corners])
    total = vectors.sum(axis=0)
    centre = areas @ middles / max(areas.sum(), 1e-300)
    normal = total / max(np.linalg.norm(total), 1e-300)
    return centre, normal


def _sector_of(
    contact: ContactFaces,
    a: PreparedBody,
    face_a: Facets,
    b: PreparedBody,
    face_b: Facets,
    n_blades: int,
) -> int:
    """Return the sector in which face b is nearest to face a; raise ModelError unless their normals
    are opposed.
    """
    same_body = contact.body_a == contact.body_b
    # a body does not touch itself, and a single sector has no neighbours
    allowed = [] if same_body else [0]
    if n_blades > 1:
        allowed = sorted([*allowed, -1, 1])
    expected = "another body, or a neighbouring sector of the same body"
    validation.check(allowed, contact.item, expected, "neither")
    candidates = allowed
    if contact.sector_b is not None:
        possible = contact.sector_b in allowed
        validation.check(possible, contact.item, f"sector_b in {allowed}", contact.sector_b)
        candidates = [contact.sector_b]
    nearest = _nearest(candidates, a, face_a, b, face_b, n_blades)
    expected = (
        "outward normals that point at each other (faces seen from outside counter-clockwise)"
    )
    found = (
        f"a cosine of {nearest.cosine:.3f} between them in sector {nearest.sector:+d}, "
        f"{nearest.distance:.4g} m apart"
    )
    check(nearest.cosine <= -0.5, contact.item, expected, found)
    return nearest.sector


class _Nearest(NamedTuple):
    """Sector in which face b is nearest to face a; compared by distance first.

    Parameters
    ----------
    distance : float
        Distance of the centres, m.
    cosine : float
        Cosine of the angle between the normals.
    sector : int
    """

    distance: float
    cosine: float
    sector: int


def _nearest(
    sectors: Iterable[int],
    a: PreparedBody,
    face_a: Facets,
    b: PreparedBody,
    face_b: Facets,
    n_blades: int,
) -> _Nearest:
    """Return the sector in which face b is nearest to face a."""
    centre_a, normal_a = _centre_and_normal(face_a, a.nodes)
    centre_b, normal_b = _centre_and_normal(face_b, b.nodes)
    candidates = []
    for sector in sectors:
        rotation = turn(2.0 * np.pi / n_blades * sector)
        distance = float(np.linalg.norm(rotation @ centre_b - centre_a))
        cosine = float(normal_a @ rotation @ normal_b)
        candidates.append(_Nearest(distance, cosine, sector))
    return min(candidates)
