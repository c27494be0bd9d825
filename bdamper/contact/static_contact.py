r"""Static contact with friction of the full model, condensed to the contact points.

This problem determines the contact forces :math:`F = (T_1, T_2, N)` of Eqs. (4) and (10), for which
the paper uses a finite element contact analysis.  With the flexibility :math:`R` of both sides, the
rigid-body motion :math:`\Psi\eta` of free bodies and the motion :math:`x_0` under the load without
contact, the relative motion :math:`x = (u_1, u_2, v)` of the surfaces satisfies

.. math:: x = \Psi\eta + x_0 - R F,\qquad \Psi^T F = f,

.. math:: N \ge 0,\quad v \le 0,\quad N v = 0;\qquad |T_d| \le \mu N,\quad
          (\mu N - |T_d|)\,(u_d - w_d) = 0,\quad T_d\,(u_d - w_d) \ge 0

with the slider positions :math:`w`, zero at the start.  There are no gaps, so forces and motion are
proportional to the load and a load of 1 N is sufficient.  Loading history and gaps are part of
:mod:`bdamper.contact.static_state`.  Its solver does not replace this one: with contact springs in
place of rigid contact, 111 problems took 6 times as long and reached 1e-8 instead of 1e-10.

The contact conditions are equivalent to :math:`F = \mathrm{law}(x + F/k)`, with an elastic contact
element of arbitrary stiffness :math:`k > 0`.  These piecewise linear equations for
:math:`(F, \eta)` are solved by Newton iteration on the contact states.  For 184 of 600 random
wedges with six points it failed.  In this case an overdamped motion leads to equilibrium
(:meth:`_Solver.creep`); :math:`w` is the slider position of its last step.

With friction there may be several states, or none: the load then exceeds the friction limits and
the body slides away.

:func:`wedge_friction` bounds the normal forces on a rigid wedge.  Every set of forces with
:math:`\Psi^T F = P f`, :math:`N_i \ge 0` and :math:`|T_{d,i}| \le \mu N_i` is in equilibrium.
Linear programs give the interval of the total normal force on each face.  If it has no upper bound,
the wedge is self-locking: it stays in place by friction without load.  For plane symmetric faces at
the angle :math:`\alpha` to the load this requires :math:`\tan\alpha \le \mu`.
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
from bdamper.model.structure import Model
from bdamper.util import validation
from bdamper.util.display import Summarised
from bdamper.util.errors import ModelError, SettingError, check
from bdamper.util.formatting import amount, extent, short_repr
from bdamper.util.statement import Row, Statement

TOLERANCE = 1e-12
"""Largest residual relative to the largest contact force."""
NO_EQUILIBRIUM = 2
"""Status of a linear program without solution."""
NO_BOUND = (3, 4)
"""Statuses of a linear program without bound, or with numerical difficulties."""


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
        Slider positions; nonzero only if Newton's method failed and an overdamped motion led to the
        state.
    """

    force: NDArray
    motion: NDArray
    rigid: NDArray
    status: NDArray
    rest: NDArray


@dataclass(frozen=True)
class _Iterate:
    """Contact forces (n, 3) and rigid-body coordinates (n_rigid,), with their residuals.

    Parameters
    ----------
    force, eta : array
    law_residual : (3 n,) float, N
        Difference from the forces of the contact law.
    balance : (n_rigid,) float
        Residual of the equilibrium.
    status : (n, 2) int
    size : float, N
        Norm of both residuals.
    """

    force: NDArray
    eta: NDArray
    law_residual: NDArray
    balance: NDArray
    status: NDArray
    size: float


class _Solver:
    """Newton iteration for F (n, 3) and eta (n_rigid,), with an overdamped motion as fallback.

    Residuals have the unit of a force.
    """

    def __init__(self, problem: StaticContactProblem) -> None:
        self.problem = problem
        # numbers of points and of rigid-body coordinates
        self.n = len(problem.friction)
        self.m = problem.rigid.shape[1]
        self.flexibility = problem.flexibility
        # stiffness of the contact elements, N/m
        self.k = (1.0 / np.diag(problem.flexibility)).reshape(self.n, 3)
        # scale rigid-body coordinates by the displacement that they cause
        self.largest = float(np.abs(problem.rigid).max()) if problem.rigid.size else 1.0
        self.rigid_unit = self.largest * self.k.mean()
        self.iterations = 0
        # typical contact force under 1 N of load
        lever = np.abs(problem.rigid).max(axis=0, initial=0.0)
        force = np.divide(np.abs(problem.load), lever, out=np.zeros(self.m), where=lever > 0.0)
        self.unit_force = max(float(force.max(initial=0.0)), 1e-300)
        # terms of the overdamped motion: damping of the rigid-body coordinates, additional motion
        # of the surfaces
        self.drag = np.zeros((self.m, self.m))
        self.eta_before = np.zeros(self.m)
        self.extra_motion = np.zeros((self.n, 3))

    def motion(self, F: NDArray, eta: NDArray) -> NDArray:
        """Return the relative motion (n, 3) of the surfaces."""
        p = self.problem
        of_unknowns = p.rigid @ eta - self.flexibility @ F.ravel()
        return of_unknowns.reshape(-1, 3) + p.offset + self.extra_motion

    def iterate(self, F: NDArray, eta: NDArray, rest: NDArray) -> _Iterate:
        """Evaluate contact law and equilibrium.

        Parameters
        ----------
        F : (n, 3) float, N
            Contact forces along t1, t2 and n.
        eta : (m,) float
            Rigid-body coordinates.
        rest : (n, 2) float, m
            Slider positions.
        """
        p = self.problem
        # motion of the springs: the elastic contact element behind each point is compressed by F/k
        stretch = self.motion(F, eta) + F / self.k
        # forces of the springs without limits
        normal = self.k[:, 2] * stretch[:, 2]
        tangential = self.k[:, :2] * (stretch[:, :2] - rest)
        by_law, status = limited_forces(normal, tangential, p.friction)
        law_residual = (F - by_law).ravel()
        balance = p.rigid.T @ F.ravel() - p.load + self.drag @ (eta - self.eta_before)
        # divided by the largest motion of a unit coordinate, a generalised force is a force
        size = float(np.sqrt(law_residual @ law_residual + balance @ balance / self.largest**2))
        return _Iterate(
            force=F, eta=eta, law_residual=law_residual, balance=balance, status=status, size=size
        )

    def newton_step(
        self, law_residual: NDArray, balance: NDArray, status: NDArray
    ) -> tuple[NDArray, NDArray]:
        """Return the changes of F (n, 3) and eta (m,) that cancel both residuals.

        The residuals of the contact law (3 n,) and of equilibrium (m,) are linear while the points
        remain in the states ``status`` (n, 2).
        """
        p = self.problem
        n = self.n
        m = self.m
        # derivative (n, 3, 3) of the law of each point by its motion
        tangent = law_tangent(self.k[:, :2], self.k[:, 2], p.friction, status)

        # the residual F - law(Psi eta - R F + F/k) of the law changes, with B for the tangent, by
        # dF - B (Psi deta - R dF + dF/k) = (1 + B R - B/k) dF - B Psi deta
        flexibility = self.flexibility.reshape(n, 3, 3 * n)
        by_force = np.matmul(tangent, flexibility).reshape(3 * n, 3 * n)
        # add 1 to the diagonal
        by_force.flat[:: 3 * n + 1] += 1.0
        # a view with one diagonal block for each point
        of_points = by_force.reshape(n, 3, n, 3)
        of_points[range(n), :, range(n)] -= tangent / self.k[:, None]
        by_rigid = -np.matmul(tangent, p.rigid.reshape(n, 3, m)).reshape(3 * n, m)

        # 3 n rows of the law and m of equilibrium; 3 n columns of F and m of eta.  All rows have
        # the unit of a force: generalised forces are divided by the largest motion of a unit
        # coordinate.  The columns of eta are scaled to forces
        largest_motion = self.largest
        forces = slice(0, 3 * n)
        rigid = slice(3 * n, 3 * n + m)
        A = np.zeros((3 * n + m, 3 * n + m))
        A[forces, forces] = by_force
        A[forces, rigid] = by_rigid / self.rigid_unit
        A[rigid, forces] = p.rigid.T / largest_motion
        A[rigid, rigid] = self.drag / (largest_motion * self.rigid_unit)
        step = _solution(A, -np.concatenate([law_residual, balance / largest_motion]))
        dF = step[forces].reshape(n, 3)
        deta = step[rigid] / self.rigid_unit
        return dF, deta

    def creep(self) -> tuple[_Iterate, bool, NDArray]:
        r"""Follow an overdamped motion from rest to equilibrium, with sliders that follow slip.

        .. math:: x = \Psi\eta + x_0 - R F - S \dot F,\qquad \Psi^T F + D \dot\eta = f

        ``S`` is the diagonal of ``R`` and ``D`` the stiffness of the bonded contact.  A short
        implicit step has exactly one solution for any friction coefficient: ``S/dt`` decouples the
        points and ``D/dt`` supports the body.  The time step grows while the Newton iteration
        converges.  At the end of the motion the static conditions hold.

        Returns
        -------
        end : _Iterate
        converged : bool
        rest : (n, 2) float
            Slider positions.
        """
        p = self.problem
        # diagonal of R, (n, 3)
        S = 1.0 / self.k
        D = p.rigid.T @ (self.k.ravel()[:, None] * p.rigid)
        # a small part for rigid-body motions without motion at the contacts
        D = D + 1e-9 * np.trace(D) / max(self.m, 1) * np.eye(self.m)
        rest = np.zeros((self.n, 2))
        now = self.iterate(np.zeros((self.n, 3)), np.zeros(self.m), rest)
        damped = _Solver(p)
        dt = 0.1
        for _ in range(200):
            # the terms with a rate, by the implicit Euler method
            damped.flexibility = p.flexibility + np.diag(S.ravel() / dt)
            damped.k = 1.0 / (S + S / dt)
            damped.extra_motion = S * now.force / dt
            damped.drag = D / dt
            damped.eta_before = now.eta
            damped.iterations = 0
            after, converged = damped.newton(now.force, now.eta, rest, tolerance=0.01 * TOLERANCE)
            # rounding may prevent the small tolerance
            if not converged:
                after, converged = damped.newton(after.force, after.eta, rest, most=2)
            if not converged:
                dt *= 0.2
                if dt < 1e-7:
                    break
                continue

            surfaces = damped.motion(after.force, after.eta)
            rest = np.where(after.status == STICK, rest, surfaces[:, :2])
            change = float(np.abs(after.force - now.force).max())
            relative_change = change / max(float(np.abs(after.force).max()), 1e-300)
            now = after
            if damped.iterations <= 6:
                dt *= 4.0
            # close to rest the static problem may converge from here
            if relative_change < 0.3 * min(1.0, dt) or dt > 1e3:
                end, converged = self.newton(now.force, now.eta, rest, most=8)
                if converged:
                    return end, True, rest
        return now, False, rest

    def newton(
        self, F: NDArray, eta: NDArray, rest: NDArray, tolerance: float = TOLERANCE, most: int = 25
    ) -> tuple[_Iterate, bool]:
        """Solve by Newton iteration with line search in at most ``most`` steps.

        Returns the last iterate, and whether it has converged.
        """
        now = self.iterate(F, eta, rest)
        for left in range(most, -1, -1):
            largest_force = max(float(np.abs(now.force).max(initial=0.0)), self.unit_force)
            converged = now.size <= tolerance * largest_force
            if converged or not left:
                break
            self.iterations += 1
            now = self.line_search(now, rest)
        return now, converged

    def line_search(self, now: _Iterate, rest: NDArray) -> _Iterate:
        """Return the iterate after a Newton step, or after a fraction of it."""
        dF, deta = self.newton_step(now.law_residual, now.balance, now.status)
        trials = []
        for fraction in 0.5 ** np.arange(6):
            trial = self.iterate(now.force + fraction * dF, now.eta + fraction * deta, rest)
            trials.append(trial)
            # a tenth of the decrease that a linear residual would have
            if trial.size < (1.0 - 0.1 * fraction) * now.size:
                break
        best = min(trials, key=lambda trial: trial.size)
        if best.size < now.size:
            return best
        # no descent in this direction: the full step leads to other contact states
        return trials[0]

    def bonded(self) -> tuple[NDArray, NDArray]:
        """Return F and eta with all points in stick as the initial guess.

        In stick the equations are linear: one Newton step from zero solves them.
        """
        x = self.motion(F=np.zeros((self.n, 3)), eta=np.zeros(self.m))
        all_stick = np.full((self.n, 2), STICK)
        law_residual = -(self.k * x).ravel()
        return self.newton_step(law_residual, balance=-self.problem.load, status=all_stick)


def _solution(A: NDArray, b: NDArray) -> NDArray:
    """Solve A x = b, by least squares if the matrix is singular to working precision."""
    try:
        x = np.linalg.solve(A, b)
    except np.linalg.LinAlgError:
        x = np.full_like(b, np.nan)
    if np.isfinite(x).all():
        residual = np.abs(A @ x - b).max()
        if residual <= 1e-8 * np.abs(b).max():
            return x
    return np.linalg.lstsq(A, b, rcond=1e-12)[0]


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
        If the model has no load on a free body, if no contact forces balance the load, or if the
        iteration does not converge.
    """
    if not (np.any(problem.load) or np.any(problem.offset)):
        raise ModelError(
            "static contact: expected a load on a free body, found none; set load_per_preload or "
            "constant_loads"
        )
    solver = _Solver(problem)
    rest = np.zeros((len(problem.friction), 2))
    F, eta = solver.bonded()
    end, converged = solver.newton(F, eta, rest)
    if not converged:
        # without cost, the linear program only asks whether there is an equilibrium
        no_cost = np.zeros(len(problem.rigid))
        optimum = forces_in_balance(no_cost, problem.friction, problem.rigid, problem.load)
        check(
            optimum.status != NO_EQUILIBRIUM,
            "static contact",
            "contact forces with N >= 0 and |T| <= mu N that balance the load",
            "none, so that the body slides away; raise the friction coefficient, or correct the "
            "direction of the load or of the contact faces",
        )
        end, converged, rest = solver.creep()
    if not converged:
        raise ModelError(
            "static contact: the Newton iteration on the contact states did not converge; "
            "set contact_stiffness, or store finite element contact forces in the model"
        )
    return StaticContactSolution(
        force=end.force,
        motion=solver.motion(end.force, end.eta),
        rigid=end.eta,
        status=end.status,
        rest=rest,
    )


def forces_in_balance(
    cost: NDArray, friction: NDArray, rigid: NDArray, load: NDArray
) -> scipy.optimize.OptimizeResult:
    """Minimise ``cost @ F`` over forces in equilibrium with a load, by a linear program.

    The forces satisfy ``N >= 0`` and ``|T_d| <= mu N``.

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
    n = len(friction)
    # equations of equilibrium with coefficients up to 1
    unit = np.abs(rigid).max(axis=0)
    unit[unit == 0.0] = 1.0
    # +-T_d - mu N <= 0: four rows for each point, with columns T1, T2, N
    tangents = [[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0]]
    normals = [[0.0, 0.0, 1.0]] * 4
    limits = np.kron(np.eye(n), tangents) - np.kron(np.diag(friction), normals)
    # T1 and T2 have either sign
    bounds = [(None, None), (None, None), (0.0, None)] * n
    return scipy.optimize.linprog(
        cost,
        A_ub=limits,
        b_ub=np.zeros(4 * n),
        A_eq=(rigid / unit).T,
        b_eq=load / unit,
        bounds=bounds,
    )


def static_contact_problem(
    coupling: Coupling, friction: NDArray | None = None
) -> StaticContactProblem:
    """Return the static contact problem of a model.

    It has the full static flexibility at nodal diameter 0.

    Parameters
    ----------
    coupling : Coupling
        Selects the interfaces and the rigid-body modes.
    friction : (n_points,) float, optional
        Friction coefficients, zero by default.
    """
    rigid_modes = {}
    for body in coupling.model.bodies.values():
        if body.kind != "ground":
            retained = np.asarray(coupling.modes[body.name])
            rigid_modes[body.name] = retained[body.bases[0].omega2[retained] == 0.0]
    # without elastic modes the residual flexibility is the complete flexibility
    rigid = replace(coupling, modes=rigid_modes)
    load, offset = rigid.load()
    n = coupling.n_points
    return StaticContactProblem(
        flexibility=rigid.residual_flexibility(0).real,
        rigid=rigid.basis(0).G.real.reshape(3 * n, -1),
        load=load,
        offset=offset,
        friction=np.zeros(n) if friction is None else friction,
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
        """Whether friction alone holds the wedge in place without load."""
        return bool(np.isinf(self.highest).any())

    _states_all = True

    def _statement(self) -> Statement:
        subject = f"normal forces under {amount(self.load, 'N')}"
        remarks = ["Not covered: elasticity of the faces (study.static)"]
        if self.self_locking:
            verdict = f"Self-locking; friction alone can hold the wedge: {subject}"
            remarks.insert(
                0,
                "With tan(alpha) <= mu the normal force is not unique and may remain without load",
            )
        else:
            verdict = f"Not self-locking; without load the wedge slides out: {subject}"
            remarks.insert(0, "Within these limits, the normal force depends on the load history")
        rows = []
        for name, low, high, angle, mu in zip(
            self.interfaces, self.lowest, self.highest, self.angle, self.friction
        ):
            force = f"{amount(low, 'N')} or more" if np.isinf(high) else extent(low, high, "N")
            face = f"face at {np.degrees(angle):.4g} deg to the load, friction coefficient {mu:g}"
            rows.append(Row(name, force, face))
        return Statement([verdict], rows, remarks=remarks)


def _corners(coupling: Coupling, name: str, friction: NDArray) -> NDArray:
    """Return the indices of points whose friction cones span all forces of a face.

    On a plane face with one friction coefficient these are the corners of its convex hull,
    otherwise all points.
    """
    face = coupling.model.interfaces[name]
    indices = np.arange(coupling.n_points)[coupling.rows(name)]
    # fewer than three points have no polygon: a lumped contact has a single point
    if len(indices) < 3:
        return indices
    relative = face.points - face.points.mean(axis=0)
    size = float(np.abs(relative).max())
    # axes of the first point
    tangents = face.frame[0, :2]
    normal = face.frame[0, 2]
    is_flat = np.abs(relative @ normal).max() <= 1e-9 * size
    same_axes = np.ptp(face.frame, axis=0).max() <= 1e-9
    same_friction = np.ptp(friction[indices]) == 0.0
    # only then a force at any point is a sum of forces in the cones of the corners
    if not (is_flat and same_axes and same_friction):
        return indices
    in_plane = relative @ tangents.T / size
    try:
        hull = scipy.spatial.ConvexHull(in_plane)
    # fewer than three points, or all on a line
    except (scipy.spatial.QhullError, ValueError):
        return indices
    return indices[np.sort(hull.vertices)]


def wedge_friction(
    coupling: Coupling,
    friction: NDArray,
    load: float = 1.0,
    shares: Mapping[str, float] | None = None,
) -> WedgeFriction:
    """Compute the interval of the total normal force on each face of rigid free bodies.

    Faces are the interfaces with friction.  Lumped masses without springs are free bodies.

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
    bodies = coupling.model.bodies.values()
    loaded = {
        body.name: body.load
        for body in bodies
        if body.kind in ("free", "lumped") and body.load is not None
    }
    validation.check(loaded, "wedge friction", "a free body with a load", "none")
    basis = coupling.basis(0)
    modal_load, _ = coupling.load(shares)
    # rigid-body motions have the frequency zero
    is_rigid = basis.omega2 == 0.0
    # load of the body that each face touches; faces of other bodies do not count, and neither do
    # those that springs of a lumped mass press together
    load_on = {}
    for name in coupling.friction_faces:
        pressing = loaded.get(faces[name].body_a) or loaded.get(faces[name].body_b)
        closing = basis.G[coupling.rows(name)][:, 2][..., is_rigid]
        if pressing is not None and np.any(closing):
            load_on[name] = pressing
    validation.check(load_on, "wedge friction", "a face that presses on a free body", "none")
    corners = [_corners(coupling, name, friction) for name in load_on]
    points = np.concatenate(corners)
    # rigid-body motion (3 n_points, n_rigid) of these points
    rigid = basis.G.real[points][..., is_rigid].reshape(3 * len(points), -1)
    mu = friction[points]
    face_of_point = np.repeat(np.arange(len(corners)), [len(of_face) for of_face in corners])

    n_faces = len(load_on)
    lowest = np.empty(n_faces)
    highest = np.empty(n_faces)
    angle = np.empty(n_faces)
    mean_mu = np.empty(n_faces)
    for i, (name, pressing) in enumerate(load_on.items()):
        on_face = face_of_point == i
        # its product with stacked forces (T1, T2, N) is the total normal force of the face
        normal_force = np.kron(on_face, [0.0, 0.0, 1.0])
        # the highest force is found as the lowest negative force
        for sign, bound in ((1.0, lowest), (-1.0, highest)):
            optimum = forces_in_balance(sign * normal_force, mu, rigid, modal_load[is_rigid])
            if optimum.status == NO_EQUILIBRIUM:
                raise SettingError(
                    f"wedge friction: no contact forces at '{name}' and the other faces are in "
                    "equilibrium with the load"
                )
            bounded = optimum.status not in NO_BOUND
            bound[i] = sign * optimum.fun * load if bounded else np.inf
        if _is_lumped(coupling.model, name):
            first = 3 * int(np.argmax(on_face))
            angle[i] = _angle_of_motion(rigid[first : first + 3] @ modal_load[is_rigid])
        else:
            angle[i] = _angle_to_load(faces[name].frame[:, 2], pressing.direction)
        mean_mu[i] = mu[on_face].mean()
    return WedgeFriction(
        interfaces=tuple(load_on),
        load=float(load),
        lowest=lowest,
        highest=highest,
        angle=angle,
        friction=mean_mu,
    )


def _is_lumped(model: Model, name: str) -> bool:
    """Return whether an interface belongs to lumped masses, whose axes are motions."""
    face = model.interfaces[name]
    return any(model.bodies[body].kind == "lumped" for body in (face.body_a, face.body_b))


def _angle_of_motion(motion: NDArray) -> float:
    """Return the angle (rad) between a face and its motion (3,) along t1, t2, and n under the load."""
    return float(np.arctan2(abs(motion[2]), np.hypot(motion[0], motion[1])))


def _angle_to_load(normals: NDArray, direction: NDArray) -> float:
    """Return the angle (rad) between a face with normals (n, 3) and a load."""
    normal = normals.mean(axis=0)
    sine = normal @ np.asarray(direction, float) / np.linalg.norm(normal)
    return float(np.abs(np.arcsin(np.clip(sine, -1.0, 1.0))))
