"""Contact points of a face: union of neighbouring patches, and gaps of imperfect surfaces.

To reduce the number of contact points, the patches of a face are united to a coarser grid of
groups.  A group has the area-weighted mean displacement ``m = A u`` of its patches, and ``A^H``
distributes its force over them.  Its static receptance is ``A R A^H``; the work of the forces does
not change.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any, Literal

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from bdamper.model.structure import Body, ContactStiffness, Interface, Model, StaticContact
from bdamper.util import validation
from bdamper.util.records import Kind, Shape, layout

# ---- Union of patches ----


ROWS = 3
"""Smallest number of rows of contact points along t1 with which a wedge does not roll too easily.

Two rows carry moments over half of the length of a face, three over two thirds
(docs/evidence/measured.md).
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
    steps = np.diff(np.sort(_places(face), axis=0), axis=0)
    n1, n2 = 1 + (steps > _least_row_distance(face)).sum(axis=0)
    share = face.n_points / (n1 * n2)
    if 0.5 <= share <= 1.0:
        return int(n1), int(n2)
    return int(max(1.0, np.sqrt(share) * n1)), int(max(1.0, np.sqrt(share) * n2))


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
    best = (1, min(n2, n_groups))
    for n_strips in range(2, min(n1, n_groups) + 1):
        grid = (n_strips, min(n2, n_groups // n_strips))
        if _grid_quality(grid, (n1, n2)) > _grid_quality(best, (n1, n2)):
            best = grid
    strips, groups = best

    label = groups * _equal_parts(place[:, 0], face.area, strips, apart)
    for strip in np.unique(label):
        inside = label == strip
        label[inside] += _equal_parts(place[inside, 1], face.area[inside], groups, apart)
    ordered: NDArray = np.unique(label, return_inverse=True)[1]
    return ordered


def _grid_quality(grid: tuple[int, int], rows: tuple[int, int]) -> tuple[int, ...]:
    """Return the quality of a grid of groups along t1 and t2; earlier entries take precedence.

    ``rows`` contains the numbers of rows of patches.
    """
    a, b = grid
    enough_rows = min(a, b, ROWS)
    enough_along_t1 = min(a, ROWS)
    # groups of different numbers of rows
    uneven = int(rows[0] % a > 0) + int(rows[1] % b > 0)
    return enough_rows, enough_along_t1, a * b, -uneven, min(a, b)


def _equal_parts(x: NDArray, area: NDArray, n: int, apart: float) -> NDArray:
    """Return the part of each patch at coordinates ``x`` in ``n`` parts of about equal area.

    Parts consist of whole rows.  A hundredth of a part is neglected, so that rounding changes no
    group.
    """
    # share of the area below each patch; half of the row of the patch counts
    below = np.clip(0.5 + (x[:, None] - x) / apart, 0.0, 1.0) @ area / area.sum()
    # counted from the nearer end, so that symmetric faces have symmetric parts
    part = (n * np.minimum(below, 1.0 - below) + 0.01).astype(int)
    return np.where(below < 0.51, part, n - 1 - part)


class _Groups:
    """Matrices of sums and means over the groups of one face."""

    def __init__(self, face: Interface, n_groups: int | None) -> None:
        n = face.n_points
        label = np.arange(n)
        if n_groups is not None and n_groups < n and face.kind == "friction":
            label = group_patches(face, int(n_groups))
        m = int(label.max()) + 1 if n else 0
        self.sum = np.zeros((m, n))
        self.sum[label, np.arange(n)] = 1.0
        self.area = self.sum @ face.area
        self.mean = self.sum * face.area / self.area[:, None]

        # the mean of rotations is not a rotation: the nearest one
        frames = np.einsum("mp,pij->mij", self.mean, face.frame)
        self.frame = np.array([scipy.linalg.polar(frame)[0] for frame in frames]).reshape(m, 3, 3)
        # from the axes of each patch to the axes of its group
        turn = np.einsum("pij,pkj->pik", self.frame[label], face.frame)
        self.vectors = np.einsum("mp,pij->mipj", self.mean, turn).reshape(3 * m, 3 * n)
        self.forces = np.einsum("mp,pij->mipj", self.sum, turn).reshape(3 * m, 3 * n)
        self.face = replace(
            face,
            points=self.mean @ face.points,
            area=self.area,
            frame=self.frame,
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
        Largest number of contact points of a friction face; smaller faces do not change.

    Returns
    -------
    Model
    """
    groups = {name: _Groups(face, n_points) for name, face in model.interfaces.items()}
    bodies = {name: _united(body, body, groups) for name, body in model.bodies.items()}
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
        stress[name] = _united(points, model.bodies[points.body], groups)
    return replace(
        model,
        interfaces={name: group.face for name, group in groups.items()},
        bodies=bodies,
        contact=contact,
        static=static,
        stress=stress,
    )


def _united(record: Any, body: Body, groups: dict[str, _Groups]) -> Any:
    """Return a record of a body with united contact points.

    The annotated types of its class define which axes of its arrays are contact points.
    """
    if not body.ports:
        return record
    vectors = [groups[name].vectors for name, _ in body.ports]
    A = scipy.linalg.block_diag(*vectors)

    def mean(x: NDArray, shape: Shape) -> NDArray:
        """Return the array for the groups; ``shape`` names its axes."""
        if "n_points" in shape:  # vectors at the points
            flat = x.reshape(A.shape[1], -1)
            x = (A @ flat).reshape(-1, 3, *x.shape[2:])
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
            unite = partial(_united, body=body, groups=groups)
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
        Gap with the minimum 0: the surfaces touch at one point at least.

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
    for axis, slope, height in ((0, angle, crowning), (1, axial_angle, axial_crowning)):
        x = np.einsum("ij,ij->i", relative, interface.frame[:, axis])
        half_length = max(float(np.abs(x).max()), 1e-300)
        gap += np.tan(slope) * x + height * (x / half_length) ** 2
    return gap - gap.min()
