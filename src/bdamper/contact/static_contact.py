r"""Static contact forces with friction of the full model, condensed to the contact points.

These are the forces F of Eqs (4) and (10) of the paper, which come from a finite element contact analysis there.  With
the flexibility :math:`R` of both sides, the rigid-body motion :math:`\eta` of free bodies and the displacement
:math:`x_0` per newton of load, the relative motion :math:`x = (u_1, u_2, v)` of the surfaces and the forces
:math:`F = (T_1, T_2, N)` satisfy

.. math:: x = \Psi\eta + x_0 - R F,\qquad \Psi^T F = f,

.. math:: N \ge 0,\quad v \le 0,\quad N v = 0;\qquad |T_d| \le \mu N,\quad
          (\mu N - |T_d|)\,(u_d - w_d) = 0,\quad T_d\,(u_d - w_d) \ge 0,

:math:`w` the position at which a point was stuck before, that of rest.  There are no gaps, so forces and motion grow in
proportion to the load and one newton of it is enough; histories and gaps belong to :mod:`bdamper.contact.static_state`.
The same conditions read :math:`F = \mathrm{law}(x + F/k)` with the law of an elastic contact element of any stiffness
:math:`k > 0`, which cancels: piecewise linear equations for :math:`(F, \eta)`, solved by Newton's method on the states of
the points.  Where that finds no set of states (184 of 600 random wedges with six points) the body creeps into its state and
the sliders follow (:meth:`_Solver.creep`); :math:`w` is then the position of the last step of that motion.

With friction there may be several states, or none: then no forces within friction balance the load.

Statics of a wedge: the range of its normal forces.

A wedge between two rigid faces is statically indeterminate with friction: every set of contact forces with

.. math:: \Psi^T F = P f,\qquad N_i \ge 0,\qquad |T_{1,i}|, |T_{2,i}| \le \mu N_i

is an equilibrium, and elasticity and history choose among them.  The total normal force on a face lies in an interval whose
ends are linear programs.  Where the upper end is infinite, the wedge holds itself by friction alone, without load: it is
self-locking, for plane symmetric faces at the angle :math:`\alpha` from the load if :math:`\tan\alpha \le \mu`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import scipy.optimize
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from bdamper.contact.static_state import STICK, law_tangent, limited_forces
from bdamper.model.fields import check
from bdamper.model.kinematics import Coupling
from bdamper.util import validation
from bdamper.util.errors import ModelError, SettingError
from bdamper.util.formatting import short_repr

# ---- Static contact forces with friction of the full model, condensed to the contact points ----


TOLERANCE = 1e-12
"""On the residual, relative to the largest contact force."""


@short_repr
@dataclass(frozen=True)
class StaticContactProblem:
    """Arrays of the problem, per newton of load.

    Parameters
    ----------
    flexibility : (3 n, 3 n) float, m/N
    rigid : (3 n, n_rigid) float
        Relative motion by rigid-body coordinates.
    load : (n_rigid,) float
        Their generalised force.
    offset : (n, 3) float, m/N
        Relative motion by the load without contact.
    friction : (n,) float
    """

    flexibility: NDArray
    rigid: NDArray
    load: NDArray
    offset: NDArray
    friction: NDArray


@short_repr
@dataclass(frozen=True)
class StaticContactSolution:
    """A state of the contact, per newton of load.

    Parameters
    ----------
    force : (n, 3) float
        T1, T2, N; N positive in compression.
    motion : (n, 3) float, m/N
        u1, u2, v of the surfaces.
    rigid : (n_rigid,) float
    status : (n, 2) int
        0 stick, 1 slip +, 2 slip -, 3 open.
    rest : (n, 2) float, m/N
        Where the points were stuck before, their origin but for states that were found by creeping.
    """

    force: NDArray
    motion: NDArray
    rigid: NDArray
    status: NDArray
    rest: NDArray


class _Solver:
    """Newton's method in units of the size of forces, and creeping motion where it fails: unknowns F and eta."""

    def __init__(self, problem: StaticContactProblem) -> None:
        self.problem = problem
        self.n, m = len(problem.friction), problem.rigid.shape[1]
        self.flexibility = problem.flexibility
        self.k = (1.0 / np.diag(problem.flexibility)).reshape(self.n, 3)
        # a rigid coordinate is measured by the displacement that it gives
        self.largest = float(np.abs(problem.rigid).max()) if problem.rigid.size else 1.0
        self.rigid_unit = self.largest * self.k.mean()
        self.iterations = 0
        # force that goes with a newton of load
        reach = np.abs(problem.rigid).max(axis=0, initial=0.0)
        unit = np.divide(np.abs(problem.load), reach, out=np.zeros(m), where=reach > 0.0)
        self.unit_force = max(float(unit.max(initial=0.0)), 1e-300)
        D = problem.rigid.T @ (self.k.ravel()[:, None] * problem.rigid)
        self.damping = D + 1e-9 * np.trace(D) / max(m, 1) * np.eye(m)
        # of a creeping motion: drag on the rigid coordinates, and what adds to the motion of the surfaces
        self.drag, self.eta_before, self.extra = np.zeros((m, m)), np.zeros(m), np.zeros((self.n, 3))

    def motion(self, F: NDArray, eta: NDArray) -> NDArray:
        p = self.problem
        return (p.rigid @ eta - self.flexibility @ F.ravel()).reshape(-1, 3) + p.offset + self.extra

    def residual(self, F: NDArray, eta: NDArray, rest: NDArray) -> tuple[NDArray, NDArray, NDArray]:
        """Misfit of the law (3 n,) and of equilibrium (n_rigid,), and the states (n, 2)."""
        p, k = self.problem, self.k
        z = self.motion(F, eta) + F / k
        law, status = limited_forces(k[:, 2] * z[:, 2], k[:, :2] * (z[:, :2] - rest), p.friction)
        balance = p.rigid.T @ F.ravel() - p.load + self.drag @ (eta - self.eta_before)
        return (F - law).ravel(), balance, status

    def newton_step(self, r: NDArray, balance: NDArray, status: NDArray) -> tuple[NDArray, NDArray]:
        p, n, m = self.problem, self.n, self.problem.rigid.shape[1]
        B = law_tangent(self.k[:, :2], self.k[:, 2], p.friction, status)
        unit = self.largest
        # F - law(x + F/k): dF - B (dF/k + Psi deta - R dF)
        A = np.zeros((3 * n + m, 3 * n + m))
        A[: 3 * n, : 3 * n] = self._force_block(B)
        A[: 3 * n, 3 * n :] = -np.matmul(B, p.rigid.reshape(n, 3, m)).reshape(3 * n, m) / self.rigid_unit
        A[3 * n :, : 3 * n] = p.rigid.T / unit
        A[3 * n :, 3 * n :] = self.drag / (unit * self.rigid_unit)
        b = -np.concatenate([r, balance / unit])
        try:
            step = np.linalg.solve(A, b)
            if not np.isfinite(step).all() or np.abs(A @ step - b).max() > 1e-8 * np.abs(b).max():
                raise np.linalg.LinAlgError
        except np.linalg.LinAlgError:
            step = np.linalg.lstsq(A, b, rcond=1e-12)[0]
        return step[: 3 * n].reshape(n, 3), step[3 * n :] / self.rigid_unit

    def _force_block(self, B: NDArray) -> NDArray:
        n = self.n
        block = np.matmul(B, self.flexibility.reshape(n, 3, 3 * n)).reshape(3 * n, 3 * n)
        block.flat[:: 3 * n + 1] += 1.0
        block.reshape(n, 3, n, 3)[range(n), :, range(n)] -= B / self.k[:, None]
        return block

    def creep(self) -> tuple[NDArray, NDArray, NDArray, bool, NDArray]:
        r"""State at which a creeping motion from rest ends; the sliders follow the slip.

        .. math:: x = \Psi\eta + x_0 - R F - S \dot F,\qquad \Psi^T F + D \dot\eta = f

        with ``S`` the diagonal of ``R`` and ``D`` the stiffness of the bonded contact.  A short implicit step has one
        solution whatever the friction, since ``S/dt`` decouples the points and ``D/dt`` holds the body, with or without
        contact; steps grow while Newton's method converges, and where the motion ends the conditions of rest hold.
        """
        whole, own = self.problem.flexibility, self.k
        S = 1.0 / own
        F, eta, rest = np.zeros((self.n, 3)), np.zeros(self.problem.rigid.shape[1]), np.zeros((self.n, 2))
        status = np.full((self.n, 2), STICK)
        dt, quick = 0.1, 0
        for _ in range(200):
            try:
                self.flexibility = whole + np.diag(S.ravel() / dt)
                self.k = 1.0 / (S + S / dt)
                self.extra = S * F / dt
                self.drag, self.eta_before = self.damping / dt, eta
                before = self.iterations
                F_new, eta_new, status, ok = self.newton(F, eta, rest, 0.01 * TOLERANCE)
                if not ok:
                    F_new, eta_new, status, ok = self.newton(F_new, eta_new, rest, most=2)
                if ok:
                    rest = np.where(status == STICK, rest, self.motion(F_new, eta_new)[:, :2])
            finally:
                self.flexibility, self.k = whole, own
                self.extra, self.drag = np.zeros_like(self.extra), np.zeros_like(self.drag)
            if not ok:
                dt *= 0.2
                if dt < 1e-7:
                    break
                continue
            moved = float(np.abs(F_new - F).max()) / max(float(np.abs(F_new).max()), 1e-300)
            F, eta = F_new, eta_new
            quick = quick + 1 if self.iterations - before <= 6 else 0
            dt *= 4.0 if quick else 1.0
            if moved < 0.3 * min(1.0, dt) or dt > 1e3:
                out = self.newton(F, eta, rest, most=8)
                if out[3]:
                    return *out, rest
        return F, eta, status, False, rest

    def newton(
        self, F: NDArray, eta: NDArray, rest: NDArray, tolerance: float = TOLERANCE, most: int = 25
    ) -> tuple[NDArray, NDArray, NDArray, bool]:
        """Newton with a line search, at ``most`` so many steps; forces, rigid coordinates, states, whether it converged."""
        unit = self.largest
        r, balance, status = self.residual(F, eta, rest)

        def norm(r: NDArray, balance: NDArray) -> float:
            return float(np.sqrt(r @ r + balance @ balance / unit**2))

        now = norm(r, balance)
        for _ in range(most):
            if now <= tolerance * max(float(np.abs(F).max(initial=0.0)), self.unit_force):
                return F, eta, status, True
            self.iterations += 1
            dF, deta = self.newton_step(r, balance, status)
            fraction, best = 1.0, (np.inf, F, eta, r, balance, status)
            for _ in range(6):
                trial = F + fraction * dF, eta + fraction * deta
                r_t, balance_t, status_t = self.residual(*trial, rest)
                value = norm(r_t, balance_t)
                if value < best[0]:
                    best = (value, *trial, r_t, balance_t, status_t)
                if value < (1.0 - 0.1 * fraction) * now:
                    break
                fraction *= 0.5
            if best[0] >= now:
                # no descent along Newton's direction: the full step moves to other states
                F, eta = F + dF, eta + deta
                r, balance, status = self.residual(F, eta, rest)
                now = norm(r, balance)
            else:
                now, F, eta, r, balance, status = best
        return F, eta, status, now <= tolerance * max(float(np.abs(F).max(initial=0.0)), self.unit_force)


def solve_static_contact(problem: StaticContactProblem) -> StaticContactSolution:
    """State of the contact under one newton of load, from rest.

    Parameters
    ----------
    problem : StaticContactProblem

    Raises
    ------
    ModelError
        If there is nothing that loads the contact, or no state was found.
    """
    if not (np.any(problem.load) or np.any(problem.offset)):
        raise ModelError("static contact: expected a load on a free body, the model has none")
    solver, rest = _Solver(problem), np.zeros((len(problem.friction), 2))
    F, eta, status, ok = solver.newton(*_bonded(problem, solver), rest)
    if not ok:
        p = problem
        balanced = forces_in_balance(np.zeros(len(p.rigid)), p.friction, p.rigid, p.load).status != 2
        expected = "contact forces with N >= 0, |T| <= mu N in equilibrium with the load"
        check(balanced, "static contact", expected, "none: the body slides away")
        F, eta, status, ok, rest = solver.creep()
    if not ok:
        instead = "give the contact stiffness or finite element contact forces instead"
        raise ModelError(f"static contact: the states of the points did not settle; {instead}")
    return StaticContactSolution(F, solver.motion(F, eta), eta, status, rest)


def _bonded(problem: StaticContactProblem, solver: _Solver) -> tuple[NDArray, NDArray]:
    """All points closed and stuck: the first guess."""
    x = solver.motion(np.zeros((solver.n, 3)), np.zeros(problem.rigid.shape[1]))
    return solver.newton_step(-(solver.k * x).ravel(), -problem.load, np.full((solver.n, 2), STICK))


def forces_in_balance(cost: NDArray, friction: NDArray, rigid: NDArray, load: NDArray) -> scipy.optimize.OptimizeResult:
    """Linear program over forces with ``N >= 0``, ``|T_d| <= mu N`` that balance a load on rigid bodies.

    Parameters
    ----------
    cost : (3 n,) float
        What the stacked forces (T1, T2, N) of the points shall make least.
    friction : (n,) float
    rigid : (3 n, n_rigid) float
    load : (n_rigid,) float
    """
    n, unit = len(friction), np.abs(rigid).max(axis=0)
    unit[unit == 0.0] = 1.0
    along = [[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0]]
    limits = np.kron(np.eye(n), along) - np.kron(np.diag(friction), [[0.0, 0.0, 1.0]] * 4)
    bounds = [(None, None), (None, None), (0.0, None)] * n
    return scipy.optimize.linprog(cost, limits, np.zeros(4 * n), (rigid / unit).T, load / unit, bounds)


def static_contact_problem(coupling: Coupling, friction: NDArray | None = None) -> StaticContactProblem:
    """The problem of a model: every mode counts through the flexibility at nodal diameter 0.

    Parameters
    ----------
    coupling : Coupling
        Interfaces and retained rigid-body modes.
    friction : (n_points,) float, optional
        Zero everywhere by default.
    """
    modes = {}
    for body in coupling.model.bodies.values():
        if body.kind != "ground":
            keep = np.asarray(coupling.modes[body.name])
            modes[body.name] = keep[body.bases[0].omega2[keep] == 0.0]
    bare = replace(coupling, modes=modes)
    load, offset = bare.load()
    n = coupling.n_points
    flexibility = bare.residual_flexibility(0).real
    friction = np.zeros(n) if friction is None else friction
    return StaticContactProblem(flexibility, bare.basis(0).G.real.reshape(3 * n, -1), load, offset, friction)


# ---- Statics of a wedge ----


@short_repr
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
    validation.check(loaded, "wedge friction", "a free body with a load", "none")
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
