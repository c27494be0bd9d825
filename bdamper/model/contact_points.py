"""Contact points of a face: union of neighbouring patches, and gaps of imperfect surfaces.

To reduce the number of contact points, the patches of a face are united to a coarser grid of
groups.  A group has the area-weighted mean displacement ``m = A u`` of its patches, and ``A^H``
distributes its force over them.  Its static receptance is ``A R A^H``; the work of the forces does
not change.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, Literal

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from bdamper.model.structure import ContactStiffness, Interface, Model, StaticContact
from bdamper.util import validation
from bdamper.util.records import Kind, Shape, layout

# ---- Union of patches ----


ROWS = 3
"""Smallest number of rows of contact points along t1 with which a wedge does not roll too easily.

Two rows carry moments over half of the length of a face, three over two thirds
(docs/evidence/measured-contact.md).
"""


def _places(face: Interface) -> NDArray:
    """Return coordinates (n_points, 2) along t1 and t2, from the centre of the points."""
    relative = face.points - face.points.mean(axis=0)
    return np.einsum("pij,pj->pi", face.frame, relative)[:, :2]


def _least_row_distance(face: Interface) -> float:
    """Return the distance below which two points belong to one row."""
    return float(0.2 * np.sqrt(face.area.mean()))


def rows_of_points(face: Interface) -> tuple[int, int]:
    """Return the numbers of rows of contact points along t1 and t2.

    They are estimated if the points form no grid.
    """
    # a row ends at each step of the sorted coordinates, t1 and t2 separately
    coordinates = np.sort(_places(face), axis=0)
    steps = np.diff(coordinates, axis=0)
    n1, n2 = 1 + (steps > _least_row_distance(face)).sum(axis=0)
    share = face.n_points / (n1 * n2)
    is_grid = 0.5 <= share <= 1.0
    if is_grid:
        return int(n1), int(n2)
    # a grid of the same proportions with as many places as points
    factor = np.sqrt(share)
    return int(max(1.0, factor * n1)), int(max(1.0, factor * n2))


def group_patches(face: Interface, n_groups: int) -> NDArray:
    """Divide the patches of a face into at most ``n_groups`` groups.

    The result (n_points,) is the group of each patch.

    The face is divided into strips of about equal area along t1, and each strip into groups of
    about equal area along t2.  Both directions have at least three groups if ``n_groups`` is large
    enough.  Otherwise t1 takes precedence.  On a grid, each group consists of whole rows, and the
    groups are symmetric about the middle of the face.
    """
    place = _places(face)
    apart = _least_row_distance(face)
    n1, n2 = rows_of_points(face)
    # numbers of strips along t1 and of groups along t2 in each strip
    best = (1, min(n2, n_groups))
    for n_strips in range(2, min(n1, n_groups) + 1):
        grid = (n_strips, min(n2, n_groups // n_strips))
        if _grid_quality(grid, (n1, n2)) > _grid_quality(best, (n1, n2)):
            best = grid
    n_strips, n_per_strip = best

    strip = _equal_parts(place[:, 0], face.area, n_strips, apart)
    label = n_per_strip * strip
    for number in np.unique(strip):
        inside = strip == number
        label[inside] += _equal_parts(place[inside, 1], face.area[inside], n_per_strip, apart)
    # numbers without empty groups
    _, group = np.unique(label, return_inverse=True)
    return np.asarray(group)


def _grid_quality(grid: tuple[int, int], rows: tuple[int, int]) -> tuple[int, ...]:
    """Return the quality of a grid of groups along t1 and t2; earlier entries take precedence.

    ``rows`` contains the numbers of rows of patches.
    """
    n1, n2 = grid
    rows1, rows2 = rows
    # more than ROWS groups along a direction are no better
    fewest = min(n1, n2, ROWS)
    along_t1 = min(n1, ROWS)
    # directions in which groups have different numbers of rows
    uneven = int(rows1 % n1 > 0) + int(rows2 % n2 > 0)
    return fewest, along_t1, n1 * n2, -uneven, min(n1, n2)


def _equal_parts(x: NDArray, area: NDArray, n: int, apart: float) -> NDArray:
    """Divide patches into ``n`` parts of about equal area; return the part 0 to n - 1 of each patch.

    ``x`` (n_patches,) are the coordinates of the patches.  Patches closer than ``apart`` belong to
    one row, and parts consist of whole rows.
    """
    # [i, j]: 1 if patch j is below patch i, 0 if above, and 0.5 at the same coordinate
    is_below = np.clip(0.5 + (x[:, None] - x) / apart, 0.0, 1.0)
    # share of the area below each patch, with half of its row
    below = is_below @ area / area.sum()
    # counted from the nearer end, so that symmetric faces have symmetric parts; rounding changes
    # no part if it is below a hundredth of a part
    from_nearer_end = (n * np.minimum(below, 1.0 - below) + 0.01).astype(int)
    lower_end_is_nearer = below < 0.51
    return np.where(lower_end_is_nearer, from_nearer_end, n - 1 - from_nearer_end)


class _Groups:
    """Groups of the n patches of a face, with the face whose points are the m groups.

    ``sum`` and ``mean`` (m, n) add values of patches and average them with the area.  ``vectors``
    and ``forces`` (3 m, 3 n) do the same for vectors along the axes of the patches; their results
    are along the axes of the groups.
    """

    def __init__(self, face: Interface, n_groups: int | None) -> None:
        n = face.n_points
        group = np.arange(n)
        if n_groups is not None and n_groups < n and face.kind == "friction":
            group = group_patches(face, int(n_groups))
        m = int(group.max()) + 1 if n else 0
        self.sum = np.zeros((m, n))
        self.sum[group, np.arange(n)] = 1.0
        area = self.sum @ face.area
        # (m, n) * (n,) / (m, 1)
        self.mean = self.sum * face.area / area[:, None]

        # the mean of rotations is not a rotation: its polar factor is the nearest one
        mean_frames = np.einsum("mp,pij->mij", self.mean, face.frame)
        frame = np.zeros((m, 3, 3))
        for i, mean_frame in enumerate(mean_frames):
            frame[i], _ = scipy.linalg.polar(mean_frame)
        # (n, 3, 3) from the axes of each patch to the axes of its group
        turn = np.einsum("pij,pkj->pik", frame[group], face.frame)
        self.vectors = np.einsum("mp,pij->mipj", self.mean, turn).reshape(3 * m, 3 * n)
        self.forces = np.einsum("mp,pij->mipj", self.sum, turn).reshape(3 * m, 3 * n)
        self.face = replace(
            face,
            points=self.mean @ face.points,
            area=area,
            frame=frame,
            gap=self.mean @ face.gap,
        )

    def mean_vectors(self, vectors: NDArray) -> NDArray:
        """Return the means (m, 3) of vectors (n, 3) at the patches."""
        return (self.vectors @ vectors.ravel()).reshape(-1, 3)

    def total_forces(self, forces: NDArray) -> NDArray:
        """Return the sums (m, 3) of forces (n, 3) at the patches."""
        return (self.forces @ forces.ravel()).reshape(-1, 3)


def unite_face(face: Interface, n_points: int) -> Interface:
    """Return a face with at most ``n_points`` contact points."""
    return _Groups(face, n_points).face


def unite_contact_points(model: Model, n_points: int) -> Model:
    """Return the model with at most ``n_points`` contact points on each friction face.

    Parameters
    ----------
    model : Model
    n_points : int
        Maximum number of contact points of a friction face; faces with fewer points do not change.

    Returns
    -------
    Model
    """
    groups = {name: _Groups(face, n_points) for name, face in model.interfaces.items()}
    # a body, and a stress set of a body, have arrays over all contact points of that body
    bodies = {}
    for name, body in model.bodies.items():
        bodies[name] = _united(body, ports=body.ports, groups=groups)
    contact = {}
    for name, springs in model.contact.items():
        stiffness = groups[name].sum @ springs.stiffness
        contact[name] = ContactStiffness(stiffness, springs.source)
    static = {}
    for name, solution in model.static.items():
        static[name] = StaticContact(
            force=groups[name].total_forces(solution.force),
            displacement_a=groups[name].mean_vectors(solution.displacement_a),
            displacement_b=groups[name].mean_vectors(solution.displacement_b),
        )
    stress = {}
    for name, points in model.stress.items():
        stress[name] = _united(points, ports=model.bodies[points.body].ports, groups=groups)
    return replace(
        model,
        interfaces={name: group.face for name, group in groups.items()},
        bodies=bodies,
        contact=contact,
        static=static,
        stress=stress,
    )


def _united(record: Any, ports: Sequence[tuple[str, str]], groups: dict[str, _Groups]) -> Any:
    """Return a record with united contact points: a body, its stress set, or a part of these.

    ``ports`` are the pairs (interface, side) of the body, in the order of its contact points.  The
    annotated types of the class of the record define which axes of its arrays are contact points.
    """
    if not ports:
        return record
    # one block for each port, (3 n_groups, 3 n_points) in total
    A = scipy.linalg.block_diag(*[groups[name].vectors for name, _ in ports])

    def mean(x: NDArray, shape: Shape) -> NDArray:
        """Return the array for the groups; ``shape`` names its axes."""
        # the first two axes of vectors at the points are point and component
        if "n_points" in shape:
            flat = x.reshape(A.shape[1], -1)
            x = (A @ flat).reshape(-1, 3, *x.shape[2:])
        # such an axis has three components of each point
        for axis, size in enumerate(shape):
            if size == "n_forces":
                last = np.swapaxes(x, axis, -1) @ A.T
                x = np.swapaxes(last, axis, -1)
        return x

    kind: Kind = type(record)
    changed: dict[str, Any] = {}
    for field in layout(kind):
        value: Any = getattr(record, field.name)
        if field.is_attribute or value is None:
            continue
        unite: Callable[[Any], Any]
        if field.is_record:
            unite = partial(_united, ports=ports, groups=groups)
        else:
            unite = partial(mean, shape=field.data.shape)
        if field.keys:
            changed[field.name] = {key: unite(part) for key, part in value.items()}
        else:
            changed[field.name] = unite(value)
    return replace(record, **changed)


def united(
    face: Interface, n_points: int | None, values: NDArray, kind: Literal["sum", "mean"]
) -> NDArray:
    """Return values (n_groups, ...) of the groups of a face from values of its patches.

    ``values`` is (n_points, ...).  Stiffness and loads are summed; gaps and
    coefficients are means weighted with the area.
    """
    groups = _Groups(face, n_points)
    matrix = groups.sum if kind == "sum" else groups.mean
    return matrix @ values


# ---- Gaps of imperfect surfaces ----


@validation.check_arguments
def face_gap(
    interface: Interface,
    *,
    angle: float = 0.0,
    axial_angle: float = 0.0,
    crowning: float = 0.0,
    axial_crowning: float = 0.0,
) -> NDArray:
    """Return the gap at the contact points of a plane face for an angular error or crowning.

    Parameters
    ----------
    interface : Interface
    angle, axial_angle : float, rad
        Slope of the gap along t1 and along t2.
    crowning, axial_crowning : float, m
        Height of a gap that increases quadratically from the centre of the face to its outermost
        points along t1 and along t2; negative for a hollow face.

    Returns
    -------
    (n_points,) float, m
        Gap with the minimum 0, so that the surfaces touch at one point at least.

    Raises
    ------
    SettingError
        If a number is not finite, or an angle exceeds 0.1 rad.
    """
    validation.instance(
        "interface", interface, Interface, "an Interface, for example model.interfaces['left']"
    )
    for name, value in (("angle", angle), ("axial_angle", axial_angle)):
        validation.number(f"misfit {name}", value, least=-0.1, most=0.1, unit="rad")
    for name, value in (("crowning", crowning), ("axial_crowning", axial_crowning)):
        validation.number(f"misfit {name}", value, unit="m")
    relative = interface.points - interface.points.mean(axis=0)
    gap = np.zeros(interface.n_points)
    # rows 0 and 1 of the frame are t1 and t2
    for axis, slope, height in ((0, angle, crowning), (1, axial_angle, axial_crowning)):
        x = np.einsum("ij,ij->i", relative, interface.frame[:, axis])
        half_length = max(float(np.abs(x).max()), 1e-300)
        gap += np.tan(slope) * x + height * (x / half_length) ** 2
    return gap - gap.min()
