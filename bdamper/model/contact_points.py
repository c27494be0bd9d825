"""Contact points of a face: union of neighbouring patches, and gaps of imperfect surfaces.

To reduce the number of contact points, the patches of a face are united to a coarser grid of groups.  A group has the
area-weighted mean displacement ``m = A u`` of its patches, and ``A^H`` distributes its force over them.  Its static
receptance is ``A R A^H``; the work of the forces does not change.
"""

from __future__ import annotations

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

Two rows carry moments over half of the length of a face, three over two thirds (docs/evidence/measured.md).
"""


def group_patches(face: Interface, n_groups: int) -> NDArray:
    """Divide the patches of a face into at most ``n_groups`` groups; return the group of each patch (n_points,).

    Strips of about equal area along t1 are divided into groups of about equal area along t2.  If the number allows it, both
    directions have at least three groups, otherwise t1.  On a grid whole rows are united, symmetrically.
    """
    place = np.einsum("pij,pj->pi", face.frame, face.points - face.points.mean(axis=0))[:, :2]
    apart = 0.2 * np.sqrt(face.area.mean())  # smaller differences are those within a row
    n1, n2 = 1 + (np.diff(np.sort(place, axis=0), axis=0) > apart).sum(axis=0)
    share = face.n_points / (n1 * n2)
    if not 0.5 <= share <= 1.0:  # no rows
        n1, n2 = (int(max(1.0, np.sqrt(share) * n)) for n in (n1, n2))

    def quality(grid: tuple[int, int]) -> tuple[int, ...]:
        a, b = grid
        return min(a, b, ROWS), min(a, ROWS), a * b, -bool(n1 % a) - bool(n2 % b), min(a, b)

    strips, groups = max(
        ((a, min(n2, n_groups // a)) for a in range(1, min(n1, n_groups) + 1)), key=quality
    )
    label = groups * _equal_parts(place[:, 0], face.area, strips, apart)
    for strip in np.unique(label):
        inside = label == strip
        label[inside] += _equal_parts(place[inside, 1], face.area[inside], groups, apart)
    ordered: NDArray = np.unique(label, return_inverse=True)[1]
    return ordered


def _equal_parts(x: NDArray, area: NDArray, n: int, apart: float) -> NDArray:
    """Divide patches at coordinates ``x`` into ``n`` parts of about equal area without dividing rows.

    A hundredth of a part is neglected, so that rounding changes no group.
    """
    below = np.clip(0.5 + (x[:, None] - x) / apart, 0.0, 1.0) @ area / area.sum()
    part = (n * np.minimum(below, 1.0 - below) + 0.01).astype(int)
    return np.where(below < 0.51, part, n - 1 - part)


class _Groups:
    """Matrices of sums and means over the groups of one face."""

    def __init__(self, face: Interface, n_groups: int | None) -> None:
        n = face.n_points
        reduce = n_groups is not None and n_groups < n and face.kind == "friction"
        label = group_patches(face, int(n_groups)) if reduce else np.arange(n)  # type: ignore[arg-type]
        m = int(label.max()) + 1 if n else 0
        self.sum = np.zeros((m, n))
        self.sum[label, np.arange(n)] = 1.0
        self.area = self.sum @ face.area
        self.mean = self.sum * face.area / self.area[:, None]
        frames = np.einsum("mp,pij->mij", self.mean, face.frame)
        self.frame = np.array([scipy.linalg.polar(frame)[0] for frame in frames]).reshape(m, 3, 3)
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
    return replace(
        model,
        interfaces={name: g.face for name, g in groups.items()},
        bodies={name: _united(body, body, groups) for name, body in model.bodies.items()},
        contact={
            name: ContactStiffness(groups[name].sum @ c.stiffness, c.source)
            for name, c in model.contact.items()
        },
        static={
            name: StaticContact(
                (groups[name].forces @ s.force.ravel()).reshape(-1, 3),
                (groups[name].vectors @ s.displacement_a.ravel()).reshape(-1, 3),
                (groups[name].vectors @ s.displacement_b.ravel()).reshape(-1, 3),
            )
            for name, s in model.static.items()
        },
        stress={name: _united(s, model.bodies[s.body], groups) for name, s in model.stress.items()},
    )


def _united(record: Any, body: Body, groups: dict[str, _Groups]) -> Any:
    """Return a record of a body with united contact points.

    The annotated types of its class define which axes of its arrays are contact points.
    """
    if not body.ports:
        return record
    A = scipy.linalg.block_diag(*(groups[name].vectors for name, _ in body.ports))

    def mean(x: NDArray, shape: Shape) -> NDArray:
        if "n_points" in shape:  # vectors at the points
            x = (A @ x.reshape(A.shape[1], -1)).reshape(-1, 3, *x.shape[2:])
        for axis in (k for k, size in enumerate(shape) if size == "n_forces"):
            x = np.swapaxes(np.swapaxes(x, axis, -1) @ A.T, axis, -1)
        return x

    kind: Kind = type(record)
    changed = {}
    for field in (field for field in layout(kind) if not field.is_attribute):
        value: Any = getattr(record, field.name)
        unite = (
            partial(_united, body=body, groups=groups)
            if field.is_record
            else partial(mean, shape=field.data.shape)
        )
        if value is not None:
            changed[field.name] = (
                {key: unite(part) for key, part in value.items()} if field.keys else unite(value)
            )
    return replace(record, **changed)


def united(
    face: Interface, n_points: int | None, values: NDArray, kind: Literal["sum", "mean"]
) -> NDArray:
    """Return values (n_groups, ...) of the groups of a face from values (n_points, ...) of its patches.

    Stiffness and loads are summed; gaps and coefficients are means weighted with the area.
    """
    matrix: NDArray = getattr(_Groups(face, n_points), kind)
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
        Height of a gap that increases quadratically from the centre of the face to its outermost points along t1 and along
        t2; negative for a hollow face.

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
    away = interface.points - interface.points.mean(axis=0)
    gap = np.zeros(interface.n_points)
    for axis, slope, height in ((0, angle, crowning), (1, axial_angle, axial_crowning)):
        x = np.einsum("ij,ij->i", away, interface.frame[:, axis])
        gap += np.tan(slope) * x + height * (x / max(float(np.abs(x).max()), 1e-300)) ** 2
    return gap - gap.min()
