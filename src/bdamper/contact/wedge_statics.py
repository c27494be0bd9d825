r"""Statics of a wedge: the range of its normal forces.

A wedge between two rigid faces is statically indeterminate with friction: every set of contact forces with

.. math:: \Psi^T F = P f,\qquad N_i \ge 0,\qquad |T_{1,i}|, |T_{2,i}| \le \mu N_i

is an equilibrium, and elasticity and history choose among them.  The total normal force on a face lies in an interval whose
ends are linear programs.  Where the upper end is infinite, the wedge holds itself by friction alone, without load: it is
self-locking, for plane symmetric faces at the angle :math:`\alpha` from the load if :math:`\tan\alpha \le \mu`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from bdamper.contact.full_static_contact import forces_in_balance
from bdamper.model.kinematics import Coupling
from bdamper.util import validation
from bdamper.util.errors import SettingError
from bdamper.util.short_repr import brief


@brief
@dataclass(frozen=True)
class WedgeFriction:
    """Total normal forces that friction leaves possible on rigid faces.

    Parameters
    ----------
    interfaces : tuple of str
    load : float, N
    lowest, highest : (n_interfaces,) float, N
        Of the total normal force on each interface; infinite if nothing bounds it.
    angle : (n_interfaces,) float, rad
        Between the face and the load.
    friction : (n_interfaces,) float
        Mean friction coefficient.
    """

    interfaces: tuple[str, ...]
    load: float
    lowest: NDArray
    highest: NDArray
    angle: NDArray
    friction: NDArray

    @property
    def self_locking(self) -> bool:
        """Whether friction alone can hold the wedge, with any normal force."""
        return bool(np.isinf(self.highest).any())

    def __str__(self) -> str:
        lines = [f"normal force under a load of {self.load:g} N, as far as statics and friction determine it:"]
        for name, low, high, angle, mu in zip(self.interfaces, self.lowest, self.highest, self.angle, self.friction):
            lines.append(f"  {name}: {low:.6g} to {high:.6g} N (face at {np.degrees(angle):.4g} deg, mu {mu:g})")
        if self.self_locking:
            lines.append("  self-locking, tan(alpha) <= mu: the normal force is not unique and may stay without any load")
        return "\n".join(lines)


def _corners(coupling: Coupling, name: str, friction: NDArray) -> NDArray:
    """Contact points that suffice: on a plane face of one friction coefficient, forces act like some at its corners."""
    face, rows = coupling.model.interfaces[name], np.arange(coupling.n_points)[coupling.rows(name)]
    off = face.points - face.points.mean(axis=0)
    size = float(np.abs(off).max())
    plane = np.abs(off @ face.frame[0, 2]).max() <= 1e-9 * size and np.ptp(face.frame, axis=0).max() <= 1e-9
    if not plane or np.ptp(friction[rows]) > 0.0:
        return rows
    try:
        return rows[np.sort(ConvexHull(off @ face.frame[0, :2].T / size).vertices)]
    except (QhullError, ValueError):  # fewer than three points, or all on a line
        return rows


def wedge_friction(
    coupling: Coupling, friction: NDArray, load: float = 1.0, shares: Mapping[str, float] | None = None
) -> WedgeFriction:
    """Interval of the total normal force on each friction interface of rigid free bodies.

    Parameters
    ----------
    coupling : Coupling
    friction : (n_points,) float
    load : float, N
    shares : mapping of body name to float, optional
        Newtons on each body per newton of load; 1 on all by default.

    Raises
    ------
    SettingError
        If no free body carries a load, or no forces at the friction interfaces are in equilibrium with it.
    """
    faces = coupling.model.interfaces
    loaded = {b.name: b.load for b in coupling.model.bodies.values() if b.kind == "free" and b.load is not None}
    validation.require(loaded, "wedge friction", "a free body with a load", "none")
    pressed = {name: loaded.get(faces[name].body_a) or loaded.get(faces[name].body_b) for name in coupling.friction_faces}
    names = tuple(name for name, by in pressed.items() if by is not None)
    basis = coupling.basis(0)
    f, _ = coupling.load(shares)
    rigid = basis.omega2 == 0.0
    kept = [_corners(coupling, name, friction) for name in names]
    rows = np.concatenate(kept)
    G = basis.G.real[rows][..., rigid]
    mu = friction[rows]
    lowest, highest = np.empty(len(names)), np.empty(len(names))
    owner = np.repeat(np.arange(len(names)), [len(k) for k in kept])
    for i, name in enumerate(names):
        cost = np.kron(owner == i, [0.0, 0.0, 1.0])
        for sign, out in ((1.0, lowest), (-1.0, highest)):
            found = forces_in_balance(sign * cost, mu, G.reshape(3 * len(rows), -1), f[rigid])
            if found.status == 2:
                none = f"found none at '{name}' and the other faces"
                raise SettingError(f"wedge friction: expected contact forces in equilibrium with the load, {none}")
            out[i] = np.inf if found.status in (3, 4) else sign * found.fun * load
    angle = np.empty(len(names))
    for i, name in enumerate(names):
        normal, by = faces[name].frame[:, 2].mean(axis=0), np.asarray(pressed[name].direction, float)  # type: ignore[union-attr]
        angle[i] = np.arcsin(np.clip(normal @ by / np.linalg.norm(normal), -1.0, 1.0))
    mean_mu = np.array([mu[owner == i].mean() for i in range(len(names))])
    return WedgeFriction(names, float(load), lowest, highest, np.abs(angle), mean_mu)
