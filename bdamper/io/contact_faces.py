"""Interfaces of an imported model: pairs of faces that touch, and the contact points laid over them.

A contact point is the mean over a patch that both faces have in common (:mod:`bdamper.reduction.patches`).  The sector in
which a damper meets its neighbour follows from the positions of the faces and the directions in which they look.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Annotated, Literal

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from bdamper.io.bounds import BOUNDS
from bdamper.io.import_report import FaceSummary
from bdamper.io.prepare import FaceSet, PreparedBody
from bdamper.model.checks import require
from bdamper.model.model import ContactStiffness, Interface, Port, turn
from bdamper.reduction.facets import Facets, area_vectors
from bdamper.reduction.patches import Patches, PatchMeans, patches_on_faces, patches_on_rectangles
from bdamper.util import validate
from bdamper.util.errors import SettingError, mismatch
from bdamper.util.repr import brief
from bdamper.util.warn import implausible


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
    body_a, body_b : {"damper", "blade", "ground"} or the name of one of several free bodies
    points : int or (int, int)
        Contact points, in all or along t1 and t2.
    kind : {"friction", "constraint"}
    sector_b : int, optional
        Sector in which body b is met, -1, 0 or 1; found from the positions by default.
    gap : float (in the units of the files) or "measured"
        Initial normal distance; "measured" takes that of the two meshes.
    frame : (3, 3) float, optional
        Rows t1, t2, n in the axes of the model; by default n is the mean outward normal of face a, and t2 points
        against the axis of rotation.
    patches : Patches, optional
        Rectangles in the axes of the model, in place of a grid.
    stiffness : (3,) or (n_points, 3) float, N/m, optional
        Contact stiffness of the user along t1, t2, n.

    Raises
    ------
    SettingError
        If a value is of another type or out of range.
    """

    name: str
    faces_a: FaceSet
    faces_b: FaceSet | None = None
    body_a: str = "damper"
    body_b: str = "blade"
    points: Annotated[int | tuple[int, int], _points] = 24
    kind: Literal["friction", "constraint"] = "friction"
    sector_b: Annotated[int, partial(validate.whole, least=-1, most=1)] | None = None
    gap: Annotated[float | Literal["measured"], _gap] = 0.0
    frame: Annotated[NDArray, _frame] | None = None
    patches: Patches | None = None
    stiffness: NDArray | tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        validate.instance("name of a contact", self.name, str, "a text")
        validate.checked(self, f"{self.item}: ")

    @property
    def item(self) -> str:
        """Name of this contact in messages."""
        return f"contact '{self.name}'"

    @property
    def pair(self) -> str:
        """The same with its bodies."""
        return f"{self.item} between {self.body_a} and {self.body_b}"


def _points(name: str, points: int | tuple[int, int]) -> int | tuple[int, ...]:
    pair = isinstance(points, Sequence | np.ndarray) and not isinstance(points, str | bytes)
    counts = tuple(points) if pair else (points,)  # type: ignore[arg-type]
    good = len(counts) == (2 if pair else 1)
    validate.that(good, name, "a number of contact points or two, along t1 and t2", points)
    counts = tuple(validate.whole(name, n, 1, BOUNDS.points) for n in counts)
    validate.that(np.prod(counts) <= BOUNDS.points, name, f"at most {BOUNDS.points} contact points on a face", points)
    return counts if pair else counts[0]


def _gap(name: str, gap: float | str) -> float | str:
    if not isinstance(gap, str):
        return validate.number(name, gap)
    validate.that(gap == "measured", name, "a distance in the units of the files, or 'measured'", gap)
    return gap


def _frame(name: str, frame: NDArray) -> NDArray:
    rows = frame if isinstance(frame, np.ndarray | Sequence) and np.shape(frame) == (3, 3) else None
    axes = np.array([validate.numbers(name, row, 3) for row in rows]) if rows is not None else np.zeros((3, 3))
    if not np.allclose(axes @ axes.T, np.eye(3), atol=BOUNDS.axes) or np.linalg.det(axes) < 0.0:
        expected = "three rows t1, t2, n of length 1 at right angles, right-handed"
        raise validate.unfit(name, expected, np.asarray(frame).tolist())
    return frame


@dataclass(frozen=True)
class LaidContacts:
    """All interfaces of a model and the rows of its bodies at their contact points.

    Parameters
    ----------
    interfaces : dict of interface name to Interface
    stiffness : dict of interface name to ContactStiffness
        Of the user.
    faces : tuple of FaceSummary
    ports : dict of body name to tuple of Port
    rows : dict of body name to (3 n_points, 3 n_nodes) sparse
        From the nodal displacements of a body, in the axes of its own sector, to the contact points of its ports.
    """

    interfaces: dict[str, Interface]
    stiffness: dict[str, ContactStiffness]
    faces: tuple[FaceSummary, ...]
    ports: dict[str, tuple[Port, ...]]
    rows: dict[str, sp.csr_matrix]


def from_first_sector(
    contacts: Sequence[ContactFaces], bodies: Mapping[str, PreparedBody], n_blades: int
) -> tuple[tuple[ContactFaces, ...], dict[str, PreparedBody]]:
    """Contacts and bodies with free bodies in sector 0: between its blade and the next one, wherever they are drawn.

    A damper beside another blade, or at the other flank, is turned about the axis by whole pitches.
    """
    bodies = dict(bodies)
    for name in [name for name in bodies if name != "blade"]:
        contacts = tuple(_from_free(contact, name) for contact in contacts)
        contacts = _one_from_first_sector(contacts, bodies, name, n_blades)
    return tuple(contacts), bodies


def _one_from_first_sector(
    contacts: tuple[ContactFaces, ...], bodies: dict[str, PreparedBody], name: str, n_blades: int
) -> tuple[ContactFaces, ...]:
    """Contacts with one free body in sector 0, where it is moved to among the bodies."""
    touching = [c for c in contacts if (c.body_a, c.body_b) == (name, "blade")]
    if n_blades == 1 or not touching:
        return contacts
    damper, blade = bodies[name], bodies["blade"]
    sectors = set()
    for contact in touching:
        if contact.faces_b is None:
            return contacts  # refused where it is laid
        face_a, face_b = damper.faces(contact.faces_a, contact.item), blade.faces(contact.faces_b, contact.item)
        sectors.add(_nearest(range(n_blades), damper, face_a, blade, face_b, n_blades)[2])
    first = next((s for s in sectors if (s - 1) % n_blades not in sectors), 0)
    if not first:
        return contacts
    sector = first if 2 * first <= n_blades else first - n_blades
    back = turn(-2.0 * np.pi / n_blades * sector)
    place = replace(damper.place, radial=(back @ damper.place.rotation)[1])
    bodies[name] = replace(damper, place=place)
    damper.checks.append(f"{name}: drawn {sector:+d} sectors on, moved between the blades of sectors 0 and 1")
    return tuple(_turned(c, back, sector) if c.body_a == name else c for c in contacts)


def _from_free(contact: ContactFaces, name: str) -> ContactFaces:
    """The same contact with a free body as body a."""
    if (contact.body_a, contact.body_b) != ("blade", name) or contact.frame is not None or contact.patches is not None:
        return contact
    assert contact.faces_b is not None
    sector = None if contact.sector_b is None else -contact.sector_b
    return replace(contact, body_a=name, body_b="blade", faces_a=contact.faces_b, faces_b=contact.faces_a, sector_b=sector)


def _turned(contact: ContactFaces, back: NDArray, sector: int) -> ContactFaces:
    """A contact of a damper that is turned by ``back`` (3, 3), so many sectors."""
    frame = None if contact.frame is None else np.asarray(contact.frame) @ back.T
    patches = None if contact.patches is None else contact.patches.turned(back)
    sector_b = None if contact.sector_b is None or contact.body_b == "ground" else contact.sector_b - sector
    return replace(contact, frame=frame, patches=patches, sector_b=sector_b)


def lay_contacts(contacts: Sequence[ContactFaces], bodies: Mapping[str, PreparedBody], n_blades: int) -> LaidContacts:
    """Lay contact points over all pairs of faces.

    Raises
    ------
    ModelError, SettingError
        If a body or a set does not exist, or two faces do not touch.
    """
    interfaces, stiffness, faces = {}, {}, []
    ports: dict[str, list[Port]] = {name: [] for name in (*bodies, "ground")}
    rows: dict[str, list[sp.csr_matrix]] = {name: [] for name in bodies}
    unit = bodies["blade"].place.units.length
    for given in contacts:
        contact = given if isinstance(given.gap, str) else replace(given, gap=unit * given.gap)
        interface, means, summary = _laid(contact, bodies, n_blades)
        interfaces[contact.name] = interface
        faces.append(summary)
        ports[contact.body_a].append((contact.name, "a"))
        ports[contact.body_b].append((contact.name, "b"))
        rows[contact.body_a].append(means.matrix_a)
        if means.matrix_b is not None:
            # Body b, s sectors on, moves there by R^s times its own displacement (and a phase, which enters later).
            rotation = sp.csr_matrix(turn(2.0 * np.pi / n_blades * interface.sector_b))
            own = sp.kron(sp.identity(means.matrix_b.shape[1] // 3), rotation, format="csr")
            rows[contact.body_b].append((means.matrix_b @ own).tocsr())
        if contact.stiffness is not None:
            stiffness[contact.name] = _user_stiffness(contact, len(means.area))
    stacked = {
        name: sp.vstack(parts, format="csr") if parts else sp.csr_matrix((0, 3 * len(bodies[name].nodes)))
        for name, parts in rows.items()
    }
    return LaidContacts(interfaces, stiffness, tuple(faces), {name: tuple(p) for name, p in ports.items()}, stacked)


def _user_stiffness(contact: ContactFaces, n: int) -> ContactStiffness:
    values = np.asarray(contact.stiffness, float)
    if values.shape not in ((3,), (n, 3)) or not (np.isfinite(values).all() and np.all(values >= 0.0)):
        raise SettingError(f"{contact.item}: expected stiffness (3,) or ({n}, 3) >= 0 N/m, found {values.shape}")
    return ContactStiffness(np.broadcast_to(values, (n, 3)).copy(), "user")


def _laid(
    contact: ContactFaces, bodies: Mapping[str, PreparedBody], n_blades: int
) -> tuple[Interface, PatchMeans, FaceSummary]:
    """Interface, means and summary of one pair of faces."""
    item = contact.item
    validate.require(contact.body_a in bodies, item, f"body_a out of {sorted(bodies)}", f"'{contact.body_a}'")
    if contact.body_b not in (*bodies, "ground"):
        raise SettingError(f"{item}: expected body_b out of {[*sorted(bodies), 'ground']}, found '{contact.body_b}'")
    if (contact.faces_b is None) != (contact.body_b == "ground"):
        raise SettingError(f"{item}: expected faces_b on '{contact.body_b}' (none on the ground)")
    a = bodies[contact.body_a]
    face_a = a.faces(contact.faces_a, item)
    area_a, area_b, sector = _area(face_a, a.nodes), None, 0
    face_b = placed = None
    with a.refusing(item, "faces on which contact points can be laid"):
        if contact.faces_b is not None:
            b = bodies[contact.body_b]
            face_b = b.faces(contact.faces_b, item)
            sector = _sector_of(contact, a, face_a, b, face_b, n_blades)
            placed = b.nodes @ turn(2.0 * np.pi / n_blades * sector).T
            area_b = _area(face_b, placed)
        means = _means(contact, a.nodes, face_a, placed, face_b)
    _check_touching(contact, means, area_a, area_b)
    distance = means.distance
    gap = distance.copy() if isinstance(contact.gap, str) else np.full(len(means.area), float(contact.gap))
    sides, places = (contact.body_a, 0, contact.body_b, sector), (means.points_a, means.area, means.frame)
    interface = Interface(contact.name, contact.kind, *sides, *places, gap)
    return interface, means, FaceSummary(interface, area_a, area_b, np.array([distance.min(), distance.max()]))


def _means(
    contact: ContactFaces, nodes_a: NDArray, face_a: Facets, nodes_b: NDArray | None, face_b: Facets | None
) -> PatchMeans:
    """Means over the patches of the user, or over a grid on what the faces have in common."""
    what = (f"{contact.item}, faces of the {contact.body_a}", f"{contact.item}, faces of the {contact.body_b}")
    if contact.patches is None:
        return patches_on_faces(contact.points, nodes_a, face_a, nodes_b, face_b, frame=contact.frame, what=what)
    a = patches_on_rectangles(contact.patches, nodes_a, face_a, what[0])
    if nodes_b is None or face_b is None:
        return a
    b = patches_on_rectangles(contact.patches, nodes_b, face_b, what[1])
    return PatchMeans(a.area, a.frame, a.points_a, b.points_a, a.matrix_a, b.matrix_a)


def _area(face: Facets, nodes: NDArray) -> float:
    return float(np.linalg.norm(area_vectors(face, nodes), axis=1).sum())


def _check_touching(contact: ContactFaces, means: PatchMeans, area_a: float, area_b: float | None) -> None:
    """Refuse faces that hardly overlap, lie apart, or have a gap of the size of the face."""
    pair, area = contact.pair, float(means.area.sum())
    if area_b is not None and contact.patches is None and area < BOUNDS.overlap * min(area_a, area_b):
        expected = f"faces that have at least {100 * BOUNDS.overlap:.0f} % of the smaller one in common"
        raise mismatch(pair, expected, f"{area:.4g} m2 of {area_a:.4g} and {area_b:.4g} m2")
    width, distance = np.sqrt(area), means.distance
    farthest = distance[np.abs(distance).argmax()]
    found = f"a distance of {farthest:.4g} m with faces {width:.4g} m wide"
    require(abs(farthest) <= BOUNDS.distance * width, pair, "faces that lie on each other", found)
    if not isinstance(contact.gap, str) and abs(contact.gap) > BOUNDS.distance * width:
        found = f"{contact.gap:.4g} m on a face {width:.4g} m wide"
        raise mismatch(f"{contact.item}: gap", "much less than the width of the face, in the units of the files", found)
    _warn_of_misfit(contact, means, area_a, area_b)


def _warn_of_misfit(contact: ContactFaces, means: PatchMeans, area_a: float, area_b: float | None) -> None:
    """Warn of faces that touch, but not as they would in one assembly: one of the bodies may stand beside its place."""
    area = float(means.area.sum())
    pair, width = contact.pair, np.sqrt(area)
    if not isinstance(contact.gap, str):
        off = means.distance - contact.gap
        worst = float(off[np.abs(off).argmax()])
        if area_b is not None and abs(worst) > BOUNDS.misfit * width:
            expected = f"meshes within {BOUNDS.misfit * width:.2g} m of the gap {contact.gap:g} m (or gap='measured')"
            implausible(pair, expected, f"{abs(worst):.3g} m {'farther apart' if worst > 0.0 else 'into each other'}")
    if area_b is None or contact.patches is not None or abs(area_a / area_b - 1.0) > BOUNDS.agreement:
        return
    share = area / min(area_a, area_b)
    if share < 1.0 - BOUNDS.misfit:
        found = f"{100.0 * share:.3g} % in common, as of a shift by some {(1.0 - share) * width:.2g} m"
        implausible(pair, f"faces of equal areas that match to {100 * BOUNDS.misfit:g} %", found)


def _centre_and_normal(facets: Facets, nodes: NDArray) -> tuple[NDArray, NDArray]:
    vectors = area_vectors(facets, nodes)
    weight = np.linalg.norm(vectors, axis=1)
    middle = np.concatenate([nodes[c].mean(axis=1) for c in facets.corners])
    total = vectors.sum(axis=0)
    return weight @ middle / max(weight.sum(), 1e-300), total / max(np.linalg.norm(total), 1e-300)


def _sector_of(
    contact: ContactFaces, a: PreparedBody, face_a: Facets, b: PreparedBody, face_b: Facets, n_blades: int
) -> int:
    """Sector in which face b lies on face a: the one in which it is nearest; there it must look the other way."""
    allowed: tuple[int, ...] = (0,) if n_blades == 1 else (-1, 0, 1)
    candidates = allowed if contact.sector_b is None else (contact.sector_b,)
    if contact.sector_b is not None and contact.sector_b not in allowed:
        raise SettingError(f"{contact.item}: expected sector_b in {list(allowed)}, found {contact.sector_b!r}")
    if contact.body_a == contact.body_b:
        candidates = tuple(s for s in candidates if s != 0)
        if not candidates:
            raise SettingError(f"{contact.item}: a body touches itself in a neighbouring sector only")
    distance, product, sector = _nearest(candidates, a, face_a, b, face_b, n_blades)
    expected = "outward normals that point at each other (faces seen from outside counter-clockwise)"
    found = f"a cosine of {product:.3f} between them in sector {sector:+d}, {distance:.4g} m apart"
    require(product <= -0.5, contact.pair, expected, found)
    return sector


def _nearest(
    sectors: Iterable[int], a: PreparedBody, face_a: Facets, b: PreparedBody, face_b: Facets, n_blades: int
) -> tuple[float, float, int]:
    """Distance of the centres of two faces (m), cosine of their normals, and the sector of face b in which it is least."""
    (centre_a, normal_a), (centre_b, normal_b) = _centre_and_normal(face_a, a.nodes), _centre_and_normal(face_b, b.nodes)
    scores = []
    for sector in sectors:
        rotation = turn(2.0 * np.pi / n_blades * sector)
        distance = float(np.linalg.norm(rotation @ centre_b - centre_a))
        scores.append((distance, float(normal_a @ rotation @ normal_b), sector))
    return min(scores)
