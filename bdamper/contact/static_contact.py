r"""Static contact with friction of the full model, condensed to the contact points.

This problem determines the contact forces :math:`F = (T_1, T_2, N)` of Eqs (4) and (10), for which the paper uses a finite
element contact analysis.  With the flexibility :math:`R` of both sides, the rigid-body motion :math:`\Psi\eta` of free
bodies and the motion :math:`x_0` under the load without contact, the relative motion :math:`x = (u_1, u_2, v)` of the
surfaces satisfies

.. math:: x = \Psi\eta + x_0 - R F,\qquad \Psi^T F = f,

.. math:: N \ge 0,\quad v \le 0,\quad N v = 0;\qquad |T_d| \le \mu N,\quad
          (\mu N - |T_d|)\,(u_d - w_d) = 0,\quad T_d\,(u_d - w_d) \ge 0

with the slider positions :math:`w`, zero at the start.  There are no gaps, so forces and motion are proportional to the
load and a load of 1 N is sufficient.  Loading history and gaps are part of :mod:`bdamper.contact.static_state`.

The contact conditions are equivalent to :math:`F = \mathrm{law}(x + F/k)`, with an elastic contact element of arbitrary
stiffness :math:`k > 0`.  These piecewise linear equations for :math:`(F, \eta)` are solved by Newton iteration on the
contact states.  It failed for 184 of 600 random wedges with six points.  An overdamped motion then leads to equilibrium
(:meth:`_Solver.creep`); :math:`w` is the slider position of its last step.

With friction there may be several states, or none: the load then exceeds the friction limits and the body slides away.

:func:`wedge_friction` bounds the normal forces on a rigid wedge.  Every set of forces with :math:`\Psi^T F = P f`,
:math:`N_i \ge 0` and :math:`|T_{d,i}| \le \mu N_i` is in equilibrium.  Linear programs give the interval of the total
normal force on each face.  If it has no upper bound, the wedge is self-locking: it stays in place by friction without load.
For plane symmetric faces at the angle :math:`\alpha` to the load this requires :math:`\tan\alpha \le \mu`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from bdamper.contact.preload_state import STICK
from bdamper.contact.static_state import law_tangent, limited_forces
from bdamper.model.kinematics import Coupling
from bdamper.util import validation
from bdamper.util.display import Summarised
from bdamper.util.errors import ModelError, SettingError, check
from bdamper.util.formatting import short_repr

TOLERANCE = 1e-12
"""Largest residual relative to the largest contact force."""


@short_repr
@dataclass(frozen=True)
class StaticContactProblem:
    """Arrays of the static contact problem, per newton of load.

    Parameters
    ----------
    flexibility : (3 n, 3 n) float, m/N
        R, both sides of the interfaces together.
    rigid : (3 n, n_rigid) float
        Psi: relative motion for unit rigid-body coordinates.
    load : (n_rigid,) float
        f: generalised force on the rigid-body coordinates.
    offset : (n, 3) float, m/N
        x_0: relative motion under the load without contact.
    friction : (n,) float
        Friction coefficients.
    """

    flexibility: NDArray
    rigid: NDArray
    load: NDArray
    offset: NDArray
    friction: NDArray


@short_repr
@dataclass(frozen=True)
class StaticContactSolution:
    """Static equilibrium with contact, per newton of load.

    Parameters
    ----------
    force : (n, 3) float
        T1, T2, N; N is positive in compression.
    motion : (n, 3) float, m/N
        u1, u2, v of the surfaces.
    rigid : (n_rigid,) float
        Rigid-body coordinates.
    status : (n, 2) int
        0 stick, 1 slip +, 2 slip -, 3 separation.
    rest : (n, 2) float, m/N
        Slider positions; not zero only if the overdamped motion found the state.
    """

    force: NDArray
    motion: NDArray
    rigid: NDArray
    status: NDArray
    rest: NDArray


class _Solver:
    """Newton iteration for F and eta, with an overdamped motion as fallback.  Residuals have the unit of a force.

    The methods return F (3 n,) and eta (n_rigid,) as in :class:`StaticContactSolution`.
    """

    def __init__(self, problem: StaticContactProblem) -> None:
        self.problem = problem
        self.n, m = len(problem.friction), problem.rigid.shape[1]
        self.flexibility = problem.flexibility
        self.k = (1.0 / np.diag(problem.flexibility)).reshape(self.n, 3)
        # scale rigid-body coordinates by the displacement that they cause
        self.largest = float(np.abs(problem.rigid).max()) if problem.rigid.size else 1.0
        self.rigid_unit = self.largest * self.k.mean()
        self.iterations = 0
        # typical contact force under 1 N of load
        lever = np.abs(problem.rigid).max(axis=0, initial=0.0)
        force = np.divide(np.abs(problem.load), lever, out=np.zeros(m), where=lever > 0.0)
        self.unit_force = max(float(force.max(initial=0.0)), 1e-300)
        # terms of the overdamped motion: damping of the rigid-body coordinates, additional motion of the surfaces
        self.drag, self.eta_before, self.extra = (
            np.zeros((m, m)),
            np.zeros(m),
            np.zeros((self.n, 3)),
        )

    def motion(self, F: NDArray, eta: NDArray) -> NDArray:
        p = self.problem
        return (p.rigid @ eta - self.flexibility @ F.ravel()).reshape(-1, 3) + p.offset + self.extra

    def residual(self, F: NDArray, eta: NDArray, rest: NDArray) -> tuple[NDArray, NDArray, NDArray]:
        """Return the residuals of the contact law (3 n,) and of equilibrium (n_rigid,), and the states (n, 2)."""
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
        block = np.matmul(B, self.flexibility.reshape(n, 3, 3 * n)).reshape(3 * n, 3 * n)
        block.flat[:: 3 * n + 1] += 1.0
        block.reshape(n, 3, n, 3)[range(n), :, range(n)] -= B / self.k[:, None]
        A[: 3 * n, : 3 * n] = block
        A[: 3 * n, 3 * n :] = (
            -np.matmul(B, p.rigid.reshape(n, 3, m)).reshape(3 * n, m) / self.rigid_unit
        )
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

    def creep(self) -> tuple[NDArray, NDArray, NDArray, bool, NDArray]:
        r"""Follow an overdamped motion from rest to equilibrium, with sliders that follow slip.

        .. math:: x = \Psi\eta + x_0 - R F - S \dot F,\qquad \Psi^T F + D \dot\eta = f

        ``S`` is the diagonal of ``R`` and ``D`` the stiffness of the bonded contact.  A short implicit step has exactly one
        solution for any friction coefficient: ``S/dt`` decouples the points and ``D/dt`` supports the body.  The time step
        grows while the Newton iteration converges.  At the end of the motion the static conditions hold.
        """
        p, S, step = self.problem, 1.0 / self.k, _Solver(self.problem)
        m = p.rigid.shape[1]
        D = p.rigid.T @ (self.k.ravel()[:, None] * p.rigid)
        D = D + 1e-9 * np.trace(D) / max(m, 1) * np.eye(m)
        F, eta, rest = np.zeros((self.n, 3)), np.zeros(m), np.zeros((self.n, 2))
        status, dt = np.full((self.n, 2), STICK), 0.1
        for _ in range(200):
            step.flexibility, step.k = p.flexibility + np.diag(S.ravel() / dt), 1.0 / (S + S / dt)
            step.extra, step.drag, step.eta_before, step.iterations = S * F / dt, D / dt, eta, 0
            F_new, eta_new, status, ok = step.newton(F, eta, rest, 0.01 * TOLERANCE)
            if not ok:
                F_new, eta_new, status, ok = step.newton(F_new, eta_new, rest, most=2)
            if not ok:
                dt *= 0.2
                if dt < 1e-7:
                    break
                continue
            rest = np.where(status == STICK, rest, step.motion(F_new, eta_new)[:, :2])
            moved = float(np.abs(F_new - F).max()) / max(float(np.abs(F_new).max()), 1e-300)
            F, eta = F_new, eta_new
            dt *= 4.0 if step.iterations <= 6 else 1.0
            if moved < 0.3 * min(1.0, dt) or dt > 1e3:
                out = self.newton(F, eta, rest, most=8)
                if out[3]:
                    return *out, rest
        return F, eta, status, False, rest

    def newton(
        self, F: NDArray, eta: NDArray, rest: NDArray, tolerance: float = TOLERANCE, most: int = 25
    ) -> tuple[NDArray, NDArray, NDArray, bool]:
        """Solve by Newton iteration with line search in at most ``most`` steps.

        Returns
        -------
        force : (n, 3) float
        rigid : (n_rigid,) float
        status : (n, 2) int
        converged : bool
        """

        def at(
            F: NDArray, eta: NDArray
        ) -> tuple[float, NDArray, NDArray, NDArray, NDArray, NDArray]:
            r, balance, status = self.residual(F, eta, rest)
            return (
                float(np.sqrt(r @ r + balance @ balance / self.largest**2)),
                F,
                eta,
                r,
                balance,
                status,
            )

        now, F, eta, r, balance, status = at(F, eta)
        for left in range(most, -1, -1):
            converged = now <= tolerance * max(float(np.abs(F).max(initial=0.0)), self.unit_force)
            if converged or not left:
                break
            self.iterations += 1
            dF, deta = self.newton_step(r, balance, status)
            trials = []
            for fraction in 0.5 ** np.arange(6):
                trials.append(at(F + fraction * dF, eta + fraction * deta))
                if trials[-1][0] < (1.0 - 0.1 * fraction) * now:
                    break
            best = min(trials, key=lambda trial: trial[0])
            # without descent in this direction: take the full step, which leads to other contact states
            now, F, eta, r, balance, status = best if best[0] < now else trials[0]
        return F, eta, status, converged


def solve_static_contact(problem: StaticContactProblem) -> StaticContactSolution:
    """Compute the static contact state under a load of 1 N, applied to the unloaded structure.

    Parameters
    ----------
    problem : StaticContactProblem

    Returns
    -------
    StaticContactSolution

    Raises
    ------
    ModelError
        If the model has no load on a free body, if no contact forces balance the load, or if the iteration does not
        converge.
    """
    if not (np.any(problem.load) or np.any(problem.offset)):
        raise ModelError("static contact: expected a load on a free body, the model has none")
    solver, rest = _Solver(problem), np.zeros((len(problem.friction), 2))
    F, eta, status, ok = solver.newton(*_bonded(problem, solver), rest)
    if not ok:
        p = problem
        balanced = (
            forces_in_balance(np.zeros(len(p.rigid)), p.friction, p.rigid, p.load).status != 2
        )
        expected = "contact forces with N >= 0, |T| <= mu N in equilibrium with the load"
        check(balanced, "static contact", expected, "none: the body slides away")
        F, eta, status, ok, rest = solver.creep()
    if not ok:
        instead = "set contact_stiffness, or store finite element contact forces in the model"
        raise ModelError(
            f"static contact: the Newton iteration on the contact states did not converge; {instead}"
        )
    return StaticContactSolution(F, solver.motion(F, eta), eta, status, rest)


def _bonded(problem: StaticContactProblem, solver: _Solver) -> tuple[NDArray, NDArray]:
    """Return F and eta with all points in stick as the initial guess."""
    x = solver.motion(np.zeros((solver.n, 3)), np.zeros(problem.rigid.shape[1]))
    return solver.newton_step(-(solver.k * x).ravel(), -problem.load, np.full((solver.n, 2), STICK))


def forces_in_balance(
    cost: NDArray, friction: NDArray, rigid: NDArray, load: NDArray
) -> scipy.optimize.OptimizeResult:
    """Minimise ``cost @ F`` over forces with ``N >= 0``, ``|T_d| <= mu N`` in equilibrium with a load, by a linear program.

    Parameters
    ----------
    cost : (3 n,) float
        Coefficients of the stacked forces (T1, T2, N) of the points.
    friction : (n,) float
    rigid : (3 n, n_rigid) float
        Relative motion for unit rigid-body coordinates.
    load : (n_rigid,) float
        Generalised force.

    Returns
    -------
    scipy.optimize.OptimizeResult
        ``status`` 2: no equilibrium; 3: no lower bound.
    """
    n, unit = len(friction), np.abs(rigid).max(axis=0)
    unit[unit == 0.0] = 1.0
    tangents = [[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0]]
    limits = np.kron(np.eye(n), tangents) - np.kron(np.diag(friction), [[0.0, 0.0, 1.0]] * 4)
    bounds = [(None, None), (None, None), (0.0, None)] * n
    return scipy.optimize.linprog(
        cost, limits, np.zeros(4 * n), (rigid / unit).T, load / unit, bounds
    )


def static_contact_problem(
    coupling: Coupling, friction: NDArray | None = None
) -> StaticContactProblem:
    """Return the static contact problem of a model, with its full static flexibility at nodal diameter 0.

    Parameters
    ----------
    coupling : Coupling
        Selects the interfaces and the rigid-body modes.
    friction : (n_points,) float, optional
        Friction coefficients, zero by default.
    """
    modes = {}
    for body in coupling.model.bodies.values():
        if body.kind != "ground":
            retained = np.asarray(coupling.modes[body.name])
            modes[body.name] = retained[body.bases[0].omega2[retained] == 0.0]
    # without elastic modes the residual flexibility is the complete flexibility
    rigid = replace(coupling, modes=modes)
    load, offset = rigid.load()
    n = coupling.n_points
    flexibility = rigid.residual_flexibility(0).real
    friction = np.zeros(n) if friction is None else friction
    return StaticContactProblem(
        flexibility, rigid.basis(0).G.real.reshape(3 * n, -1), load, offset, friction
    )


# ---- Range of the normal forces on a wedge ----


@short_repr
@dataclass(frozen=True)
class WedgeFriction(Summarised):
    """Interval of the total normal force on each face of a rigid wedge with friction.

    Parameters
    ----------
    interfaces : tuple of str
    load : float, N
    lowest, highest : (n_interfaces,) float, N
        Bounds of the total normal force; infinite if there is no bound.
    angle : (n_interfaces,) float, rad
        Angle between face and load.
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
        """Whether the wedge stays in place by friction without load."""
        return bool(np.isinf(self.highest).any())

    def __str__(self) -> str:
        lines = [f"Possible normal forces under {self.load:g} N (statics and Coulomb friction):"]
        for name, low, high, angle, mu in zip(
            self.interfaces, self.lowest, self.highest, self.angle, self.friction
        ):
            lines.append(
                f"  {name}: {low:.6g} to {high:.6g} N (face at {np.degrees(angle):.4g} deg, mu {mu:g})"
            )
        if self.self_locking:
            lines.append(
                "  self-locking, tan(alpha) <= mu: the normal force is not unique and may remain without load"
            )
        return "\n".join(lines)


def _corners(coupling: Coupling, name: str, friction: NDArray) -> NDArray:
    """Return the indices of points whose friction cones span all forces of a face.

    On a plane face with one friction coefficient these are the corners of its convex hull, otherwise all points.
    """
    face, rows = coupling.model.interfaces[name], np.arange(coupling.n_points)[coupling.rows(name)]
    relative = face.points - face.points.mean(axis=0)
    size = float(np.abs(relative).max())
    plane = (
        np.abs(relative @ face.frame[0, 2]).max() <= 1e-9 * size
        and np.ptp(face.frame, axis=0).max() <= 1e-9
    )
    if not plane or np.ptp(friction[rows]) > 0.0:
        return rows
    try:
        return rows[
            np.sort(scipy.spatial.ConvexHull(relative @ face.frame[0, :2].T / size).vertices)
        ]
    except (scipy.spatial.QhullError, ValueError):  # fewer than three points, or all on a line
        return rows


def wedge_friction(
    coupling: Coupling,
    friction: NDArray,
    load: float = 1.0,
    shares: Mapping[str, float] | None = None,
) -> WedgeFriction:
    """Compute the interval of the total normal force on each friction interface of rigid free bodies.

    Parameters
    ----------
    coupling : Coupling
    friction : (n_points,) float
        Friction coefficients.
    load : float, N
    shares : mapping of body name to float, optional
        Load on each body per newton of ``load``; 1 for all loaded bodies by default.

    Returns
    -------
    WedgeFriction

    Raises
    ------
    SettingError
        If no free body carries a load, or no contact forces are in equilibrium with it.
    """
    faces = coupling.model.interfaces
    loaded = {
        b.name: b.load
        for b in coupling.model.bodies.values()
        if b.kind == "free" and b.load is not None
    }
    validation.check(loaded, "wedge friction", "a free body with a load", "none")
    pressed = {
        name: loaded.get(faces[name].body_a) or loaded.get(faces[name].body_b)
        for name in coupling.friction_faces
    }
    names = tuple(name for name, by in pressed.items() if by is not None)
    basis = coupling.basis(0)
    f, _ = coupling.load(shares)
    rigid = basis.omega2 == 0.0
    corners = [_corners(coupling, name, friction) for name in names]
    rows = np.concatenate(corners)
    G = basis.G.real[rows][..., rigid]
    mu = friction[rows]
    lowest, highest = np.empty(len(names)), np.empty(len(names))
    face = np.repeat(np.arange(len(names)), [len(k) for k in corners])
    for i, name in enumerate(names):
        cost = np.kron(face == i, [0.0, 0.0, 1.0])
        for sign, bound in ((1.0, lowest), (-1.0, highest)):
            optimum = forces_in_balance(sign * cost, mu, G.reshape(3 * len(rows), -1), f[rigid])
            if optimum.status == 2:
                none = f"found none at '{name}' and the other faces"
                raise SettingError(
                    f"wedge friction: expected contact forces in equilibrium with the load, {none}"
                )
            bound[i] = np.inf if optimum.status in (3, 4) else sign * optimum.fun * load
    angle = np.empty(len(names))
    for i, name in enumerate(names):
        normal, by = (
            faces[name].frame[:, 2].mean(axis=0),
            np.asarray(pressed[name].direction, float),
        )  # type: ignore[union-attr]
        angle[i] = np.arcsin(np.clip(normal @ by / np.linalg.norm(normal), -1.0, 1.0))
    mean_mu = np.array([mu[face == i].mean() for i in range(len(names))])
    return WedgeFriction(names, float(load), lowest, highest, np.abs(angle), mean_mu)
