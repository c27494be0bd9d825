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
"""Number of groups in each direction that is kept if possible.

Two rows of points carry moments over half of the length of a face, three over two thirds.  With two rows a wedge rolls too
easily: the bladed disk has 0.84 mm instead of 16 um at its optimum.
"""


def rows_of_points(face: Interface) -> list[NDArray]:
    """Number the rows of contact points along t1 and along t2; return the two numbers of each point, 2 x (n_points,)."""
    out, apart = [], 0.1 * np.sqrt(face.area.mean())  # centres in one row may be this far apart
    for x in np.einsum("pij,pj->ip", face.frame, face.points - face.points.mean(axis=0))[:2]:
        order, row = np.argsort(x), np.zeros(len(x), int)
        row[order[1:]] = np.cumsum(np.diff(x[order]) > apart)
        out.append(row)
    return out


def group_patches(face: Interface, n_groups: int) -> NDArray:
    """Divide the patches of a face into a grid of at most ``n_groups`` groups; return the group of each patch (n_points,).

    The grid has at least three groups in both directions if the number allows it, and is symmetric if it can be.
    """
    rows = rows_of_points(face)
    n1, n2 = (int(row.max()) + 1 for row in rows)

    def quality(grid: tuple[int, int]) -> tuple[int, ...]:
        a, b = grid
        return min(a, b, ROWS), a * b, -bool(n1 % a) - bool(n2 % b), min(a, b)

    grid = max(((a, min(n2, n_groups // a)) for a in range(1, min(n1, n_groups) + 1)), key=quality)
    first, second = (_symmetric(row, n, groups) for row, n, groups in zip(rows, (n1, n2), grid))
    label: NDArray = np.unique(first * n2 + second, return_inverse=True)[1]
    return label


def _symmetric(row: NDArray, n_rows: int, n_groups: int) -> NDArray:
    """Return the group of each row; both ends have groups of the same sizes."""
    nearer = np.minimum(row, n_rows - 1 - row)
    group = (2 * nearer + 1) * n_groups // (2 * n_rows)
    return np.where(row == nearer, group, n_groups - 1 - group)


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
            face, points=self.mean @ face.points, area=self.area, frame=self.frame, gap=self.mean @ face.gap
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
        contact={name: ContactStiffness(groups[name].sum @ c.stiffness, c.source) for name, c in model.contact.items()},
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
        unite = partial(_united, body=body, groups=groups) if field.is_record else partial(mean, shape=field.data.shape)
        if value is not None:
            changed[field.name] = {key: unite(part) for key, part in value.items()} if field.keys else unite(value)
    return replace(record, **changed)


def united(face: Interface, n_points: int | None, values: NDArray, kind: Literal["sum", "mean"]) -> NDArray:
    """Return values (n_groups, ...) of the groups of a face from those of its patches (n_points, ...).

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
    validation.instance("interface", interface, Interface, "an Interface, for example model.interfaces['left']")
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
