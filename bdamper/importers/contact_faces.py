"""Interfaces of an imported model: pairs of faces in contact, and their contact points.

The displacement of a contact point is the mean over a patch that both faces share (:mod:`bdamper.fem.contact_patches`).
The sector in which a damper touches its neighbour follows from the positions and normals of the faces.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Annotated, Any, Literal

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from bdamper.fem.contact_patches import Patches, PatchMeans, patches_on_faces, patches_on_rectangles
from bdamper.fem.surface import Facets, area_vectors
from bdamper.importers.fe_body import BOUNDS
from bdamper.importers.prepared_body import FaceSet, PreparedBody
from bdamper.model.contact_points import ROWS
from bdamper.model.structure import ContactStiffness, Interface, Port, turn
from bdamper.util import validation
from bdamper.util.errors import check, warn_implausible
from bdamper.util.formatting import short_repr


@short_repr
@dataclass(frozen=True)
class ContactFaces:
    """Pair of faces in contact, and the arrangement of its contact points.

    Parameters
    ----------
    name : str
        Name of the interface.
    faces_a : str, (n,) int, (n, 3 | 4 | 6 | 8) int, or tuple of such two-dimensional arrays
        Face of body a: name of a set, node numbers that include complete element faces, or element faces by their node
        numbers, counter-clockwise as seen from outside.
    faces_b : str, int array or tuple of int arrays, optional
        Face of body b in the same form; None for a contact with the ground.
    body_a, body_b : {"damper", "blade", "ground"}, or the name of one of several free bodies
    points : int or (int, int)
        Number of contact points, in total or along t1 and t2; a free body needs three along t1.
    kind : {"friction", "constraint"}
        A constraint has no friction.
    sector_b : {-1, 0, 1}, optional
        Sector of body b.  By default it follows from the positions of the faces.
    gap : float or "measured"
        Initial normal distance in the unit of length of the files; "measured" takes the distance of the meshes.
    patches : Patches, optional
        Rectangles in one plane, in the axes of the model, which replace the grid.  In a grid the normal n is the mean
        outward normal of face a, and t2 points against the axis of rotation.
    stiffness : (3,) or (n_points, 3) float, N/m, optional
        Contact stiffness along t1, t2, n.

    Raises
    ------
    SettingError
        If a value has another type or is out of range.
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
    stiffness: NDArray | tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        validation.instance("name of a contact", self.name, str, "a text")
        validation.check_fields(self, f"{self.item}: ")

    @property
    def item(self) -> str:
        """Name of the contact in messages."""
        return f"contact '{self.name}'"


def _points(name: str, points: int | tuple[int, int]) -> int | tuple[int, ...]:
    pair = isinstance(points, Sequence | np.ndarray) and not isinstance(points, str | bytes)
    counts = tuple(points) if pair else (points,)  # type: ignore[arg-type]
    good = len(counts) == (2 if pair else 1)
    validation.check_value(good, name, "a number of contact points or two, along t1 and t2", points)
    counts = tuple(validation.integer(name, n, 1, BOUNDS.points) for n in counts)
    validation.check_value(
        np.prod(counts) <= BOUNDS.points,
        name,
        f"at most {BOUNDS.points} contact points on a face",
        points,
    )
    return counts if pair else counts[0]


def _gap(name: str, gap: float | str) -> float | str:
    if not isinstance(gap, str):
        return validation.number(name, gap)
    validation.check_value(
        gap == "measured", name, "a distance in the units of the files, or 'measured'", gap
    )
    return gap


@dataclass(frozen=True)
class LaidContacts:
    """Interfaces of a model, and the displacements of contact points as functions of nodal displacements.

    Parameters
    ----------
    interfaces : dict of interface name to Interface
    stiffness : dict of interface name to ContactStiffness
        Contact stiffness from the user.
    faces : tuple of str
        Area, overlap and normal of each interface, for the report.
    ports : dict of body name to tuple of Port
        Interfaces and sides of each body.
    rows : dict of body name to (3 n_points, 3 n_nodes) sparse
        Displacements at the contact points of the ports from the nodal displacements of the body in its own sector.
    """

    interfaces: dict[str, Interface]
    stiffness: dict[str, ContactStiffness]
    faces: tuple[str, ...]
    ports: dict[str, tuple[Port, ...]]
    rows: dict[str, sp.csr_matrix]


def from_first_sector(
    contacts: Sequence[ContactFaces], bodies: Mapping[str, PreparedBody], n_blades: int
) -> tuple[tuple[ContactFaces, ...], dict[str, PreparedBody]]:
    """Move free bodies to the position between the blades of sectors 0 and 1.

    A damper that the mesh has at another blade, or at the other flank, is rotated by whole sectors.

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
    contacts, moved = (
        tuple(_from_free(c) if c.body_b in bodies else c for c in contacts),
        dict(bodies),
    )
    for name in [name for name in bodies if name != "blade"]:
        sector = _sector_drawn(name, contacts, bodies, n_blades)
        if sector:
            back, damper = turn(-2.0 * np.pi / n_blades * sector), bodies[name]
            moved[name] = replace(
                damper,
                placement=replace(damper.placement, radial=(back @ damper.placement.rotation)[1]),
            )
            damper.passed(
                f"{name}: {sector:+d} sectors off in the mesh, moved between blades 0 and 1"
            )
            contacts = tuple(_turned(c, back, sector) if c.body_a == name else c for c in contacts)
    return contacts, moved


def _sector_drawn(
    name: str, contacts: Sequence[ContactFaces], bodies: Mapping[str, PreparedBody], n_blades: int
) -> int:
    """Return the position of a free body in the mesh, in sectors from its nominal position between blades 0 and 1."""
    damper, blade, sectors = bodies[name], bodies["blade"], set()
    for contact in contacts:
        if (contact.body_a, contact.body_b) == (name, "blade") and contact.faces_b is not None:
            face_a, face_b = (
                damper.faces(contact.faces_a, contact.item),
                blade.faces(contact.faces_b, contact.item),
            )
            sectors.add(_nearest(range(n_blades), damper, face_a, blade, face_b, n_blades)[2])
    first = next((s for s in sectors if (s - 1) % n_blades not in sectors), 0)
    return first if 2 * first <= n_blades else first - n_blades


def _from_free(contact: ContactFaces) -> ContactFaces:
    """Exchange bodies a and b if the free body is body b."""
    plain = contact.patches is None and contact.faces_b is not None
    if not plain or contact.body_a != "blade" or contact.body_b == "blade":
        return contact
    sector = None if contact.sector_b is None else -contact.sector_b
    faces: dict[str, Any] = {"faces_a": contact.faces_b, "faces_b": contact.faces_a}
    return replace(contact, body_a=contact.body_b, body_b="blade", **faces, sector_b=sector)


def _turned(contact: ContactFaces, back: NDArray, sector: int) -> ContactFaces:
    """Return the contact after the rotation of its damper by ``back`` (3, 3), a number of sectors."""
    patches = None if contact.patches is None else contact.patches.turned(back)
    sector_b = (
        None
        if contact.sector_b is None or contact.body_b == "ground"
        else contact.sector_b - sector
    )
    return replace(contact, patches=patches, sector_b=sector_b)


def lay_contacts(
    contacts: Sequence[ContactFaces], bodies: Mapping[str, PreparedBody], n_blades: int
) -> LaidContacts:
    """Compute the contact points of all pairs of faces.

    Parameters
    ----------
    contacts : sequence of ContactFaces
    bodies : mapping of name to PreparedBody
    n_blades : int

    Returns
    -------
    LaidContacts

    Raises
    ------
    ModelError, SettingError
        If a body or set does not exist, or two faces are not in contact.
    """
    interfaces: dict[str, Interface] = {}
    stiffness, faces, laid = {}, [], list[ContactFaces]()
    ports: dict[str, list[Port]] = {name: [] for name in (*bodies, "ground")}
    rows = {name: [sp.csr_matrix((0, 3 * len(body.nodes)))] for name, body in bodies.items()}
    unit = bodies["blade"].placement.units.length
    for contact in contacts:
        contact = (
            contact if isinstance(contact.gap, str) else replace(contact, gap=unit * contact.gap)
        )
        interface, means, figures = _laid(contact, bodies, n_blades)
        for other in laid:
            _check_other_faces(contact, interface, other, interfaces[other.name], bodies)
        laid.append(contact)
        interfaces[contact.name] = interface
        faces.append(figures)
        ports[contact.body_a].append((contact.name, "a"))
        ports[contact.body_b].append((contact.name, "b"))
        rows[contact.body_a].append(means.matrix_a)
        if means.matrix_b is not None:
            # In sector s the displacements of body b are rotated by R^s.  Their phase enters with the nodal diameter.
            rotation = sp.csr_matrix(turn(2.0 * np.pi / n_blades * interface.sector_b))
            rotations = sp.kron(sp.identity(means.matrix_b.shape[1] // 3), rotation, format="csr")
            rows[contact.body_b].append((means.matrix_b @ rotations).tocsr())
        if contact.stiffness is not None:
            stiffness[contact.name] = _user_stiffness(contact, len(means.area))
    stacked = {name: sp.vstack(parts, format="csr") for name, parts in rows.items()}
    return LaidContacts(
        interfaces, stiffness, tuple(faces), {name: tuple(p) for name, p in ports.items()}, stacked
    )


def _check_other_faces(
    contact: ContactFaces,
    own: Interface,
    other: ContactFaces,
    earlier: Interface,
    bodies: Mapping[str, PreparedBody],
) -> None:
    """Raise ModelError if two contacts are the same pair of faces, in this or the other order of their bodies."""
    same = (own.body_a, own.body_b, own.sector_b) == (
        earlier.body_a,
        earlier.body_b,
        earlier.sector_b,
    )
    turned = (own.body_a, own.body_b, own.sector_b) == (
        earlier.body_b,
        earlier.body_a,
        -earlier.sector_b,
    )
    expected = f"other faces than those of contact '{other.name}'"
    if contact.patches is not None or other.patches is not None:
        # several patches may lie on one face, but not in the same place
        apart = np.linalg.norm(own.points[:, None] - earlier.points[None], axis=2)
        near = 1e-6 * np.sqrt(min(own.area.min(), earlier.area.min()))
        twice = int((apart < near).any(axis=1).sum())
        check(
            not (same and twice),
            contact.item,
            expected,
            f"{twice} contact points in the same places",
        )
        return
    for matches, sides in ((same, ("a", "b")), (turned, ("b", "a"))):
        if not matches:
            continue
        n_shared = [
            len(_elements_of(contact, side, bodies) & _elements_of(other, opposite, bodies))
            for side, opposite in zip(("a", "b"), sides)
            if (own.body_a, own.body_b)[side == "b"] != "ground"
        ]
        found = f"{max(n_shared)} element faces of both; remove one of the contacts"
        check(min(n_shared) == 0, contact.item, expected, found)


def _elements_of(
    contact: ContactFaces, side: str, bodies: Mapping[str, PreparedBody]
) -> set[tuple[int, ...]]:
    """Return the element faces on one side of a contact, each as its sorted corners."""
    body, faces = (
        (contact.body_a, contact.faces_a) if side == "a" else (contact.body_b, contact.faces_b)
    )
    assert faces is not None
    facets = bodies[body].faces(faces, contact.item)
    return {tuple(sorted(corners)) for group in facets.corners for corners in group.tolist()}


def _user_stiffness(contact: ContactFaces, n: int) -> ContactStiffness:
    values = np.asarray(contact.stiffness, float)
    good = values.shape in ((3,), (n, 3)) and np.isfinite(values).all() and (values >= 0.0).all()
    validation.check(good, contact.item, f"stiffness (3,) or ({n}, 3) >= 0 N/m", values.shape)
    return ContactStiffness(np.broadcast_to(values, (n, 3)).copy(), "user")


def _laid(
    contact: ContactFaces, bodies: Mapping[str, PreparedBody], n_blades: int
) -> tuple[Interface, PatchMeans, str]:
    """Return interface, patch means and report text of one pair of faces."""
    item, body_a, body_b = contact.item, contact.body_a, contact.body_b
    validation.check(body_a in bodies, item, f"body_a out of {sorted(bodies)}", f"'{body_a}'")
    known = [*sorted(bodies), "ground"]
    validation.check(body_b in known, item, f"body_b out of {known}", f"'{body_b}'")
    has_b, found = contact.faces_b is not None, "none" if contact.faces_b is None else "some"
    validation.check(
        has_b == (body_b != "ground"), item, f"faces_b on '{body_b}' (none on the ground)", found
    )
    a = bodies[body_a]
    face_a = a.faces(contact.faces_a, item)
    areas, sector, face_b, nodes_b = [_area(face_a, a.nodes)], 0, None, None
    with a.refusing(item, "faces on which contact points can be laid"):
        if contact.faces_b is not None:
            b = bodies[body_b]
            face_b = b.faces(contact.faces_b, item)
            sector = _sector_of(contact, a, face_a, b, face_b, n_blades)
            nodes_b = b.nodes @ turn(2.0 * np.pi / n_blades * sector).T
            areas.append(_area(face_b, nodes_b))
        means = _means(contact, a.nodes, face_a, nodes_b, face_b)
    _check_touching(contact, means, areas)
    distance = means.distance
    gap = (
        distance.copy()
        if isinstance(contact.gap, str)
        else np.full(len(means.area), float(contact.gap))
    )
    points = (means.points_a, means.area, means.frame)
    interface = Interface(contact.name, contact.kind, body_a, 0, body_b, sector, *points, gap)
    if contact.kind == "friction" and body_a != "blade" and 0 < means.rows < ROWS:
        expected = f"at least {ROWS} rows of contact points along t1, which keep a damper from rolling on its faces"
        warn_implausible(
            item, expected, f"{means.rows}: amplitudes of a wedge may be wrong by several times"
        )
    area = float(means.area.sum())
    fractions = ", ".join(
        f"{100 * area / whole:.4g} % of face {side}" for side, whole in zip("ab", areas)
    )
    normal = ", ".join(f"{c:.4f}" for c in means.frame[:, 2].mean(axis=0))
    return (
        interface,
        means,
        (
            f"{contact.name}: {len(means.area)} points, {area:.6g} m2 ({fractions}), side b in sector {sector:+d}\n"
            f"    mean outward normal of side a ({normal}), meshes {distance.min():.2g} to {distance.max():.2g} m apart"
        ),
    )


def _means(
    contact: ContactFaces,
    nodes_a: NDArray,
    face_a: Facets,
    nodes_b: NDArray | None,
    face_b: Facets | None,
) -> PatchMeans:
    """Return the means over the rectangles of the user, or over a grid on the overlap of the faces."""
    what = (
        f"{contact.item}, faces of the {contact.body_a}",
        f"{contact.item}, faces of the {contact.body_b}",
    )
    if contact.patches is None:
        return patches_on_faces(contact.points, nodes_a, face_a, nodes_b, face_b, what=what)
    a = patches_on_rectangles(contact.patches, nodes_a, face_a, what[0])
    if nodes_b is None or face_b is None:
        return a
    b = patches_on_rectangles(contact.patches, nodes_b, face_b, what[1])
    return replace(a, points_b=b.points_a, matrix_b=b.matrix_a)


def _area(face: Facets, nodes: NDArray) -> float:
    return float(np.linalg.norm(area_vectors(face, nodes), axis=1).sum())


def _check_touching(contact: ContactFaces, means: PatchMeans, areas: Sequence[float]) -> None:
    """Raise ModelError if two faces hardly overlap or are far apart; warn of a smaller misfit.

    A smaller misfit indicates a body that is not at its position in the assembly.
    """
    item, distance, area = contact.item, means.distance, float(means.area.sum())
    width, share = np.sqrt(area), area / min(areas)
    measured = contact.patches is None and len(areas) == 2
    expected = f"faces that have at least {100 * BOUNDS.overlap:.0f} % of the smaller one in common"
    found = f"{area:.4g} m2 of {' and '.join(f'{a:.4g}' for a in areas)} m2"
    check(not measured or share >= BOUNDS.overlap, item, expected, found)
    farthest = distance[np.abs(distance).argmax()]
    found = f"a distance of {farthest:.4g} m with faces {width:.4g} m wide"
    check(abs(farthest) <= BOUNDS.distance * width, item, "faces that lie on each other", found)
    if not isinstance(contact.gap, str):
        expected = "much less than the width of the face, in the units of the files"
        found = f"{contact.gap:.4g} m on a face {width:.4g} m wide"
        check(abs(contact.gap) <= BOUNDS.distance * width, f"{item}: gap", expected, found)
        off = distance - contact.gap
        worst = float(off[np.abs(off).argmax()])
        if len(areas) == 2 and abs(worst) > BOUNDS.misfit * width:
            expected = f"meshes within {BOUNDS.misfit * width:.2g} m of the gap {contact.gap:g} m (or gap='measured')"
            warn_implausible(
                item,
                expected,
                f"{abs(worst):.3g} m {'farther apart' if worst > 0.0 else 'into each other'}",
            )
    if (
        measured
        and max(areas) <= (1.0 + BOUNDS.agreement) * min(areas)
        and share < 1.0 - BOUNDS.misfit
    ):
        found = f"{100.0 * share:.3g} % in common, as after a shift by about {(1.0 - share) * width:.2g} m"
        warn_implausible(
            item, f"faces of equal areas that match to {100 * BOUNDS.misfit:g} %", found
        )


def _centre_and_normal(facets: Facets, nodes: NDArray) -> tuple[NDArray, NDArray]:
    vectors = area_vectors(facets, nodes)
    weight = np.linalg.norm(vectors, axis=1)
    middle = np.concatenate([nodes[c].mean(axis=1) for c in facets.corners])
    total = vectors.sum(axis=0)
    return weight @ middle / max(weight.sum(), 1e-300), total / max(np.linalg.norm(total), 1e-300)


def _sector_of(
    contact: ContactFaces,
    a: PreparedBody,
    face_a: Facets,
    b: PreparedBody,
    face_b: Facets,
    n_blades: int,
) -> int:
    """Return the sector in which face b is nearest to face a; raise ModelError unless their normals are opposed."""
    same_body = contact.body_a == contact.body_b
    allowed = [s for s in (-1, 0, 1) if (s == 0 or n_blades > 1) and not (same_body and s == 0)]
    validation.check(
        allowed, contact.item, "another body, or a neighbouring sector of the same body", "neither"
    )
    wrong = contact.sector_b is not None and contact.sector_b not in allowed
    validation.check(not wrong, contact.item, f"sector_b in {allowed}", contact.sector_b)
    candidates = allowed if contact.sector_b is None else [contact.sector_b]
    distance, product, sector = _nearest(candidates, a, face_a, b, face_b, n_blades)
    expected = (
        "outward normals that point at each other (faces seen from outside counter-clockwise)"
    )
    found = f"a cosine of {product:.3f} between them in sector {sector:+d}, {distance:.4g} m apart"
    check(product <= -0.5, contact.item, expected, found)
    return sector


def _nearest(
    sectors: Iterable[int],
    a: PreparedBody,
    face_a: Facets,
    b: PreparedBody,
    face_b: Facets,
    n_blades: int,
) -> tuple[float, float, int]:
    """Return the sector in which face b is nearest to face a.

    Returns
    -------
    distance : float
        Distance of the centres, m.
    cosine : float
        Cosine of the angle between the normals.
    sector : int
    """
    (centre_a, normal_a), (centre_b, normal_b) = (
        _centre_and_normal(face_a, a.nodes),
        _centre_and_normal(face_b, b.nodes),
    )
    scores = []
    for sector in sectors:
        rotation = turn(2.0 * np.pi / n_blades * sector)
        distance = float(np.linalg.norm(rotation @ centre_b - centre_a))
        scores.append((distance, float(normal_a @ rotation @ normal_b), sector))
    return min(scores)
