r"""Static contact with friction on the full flexibility, condensed to the contact points, with a certificate.

With the flexibility :math:`R` of both sides, the rigid-body motion :math:`\eta` of free bodies and the displacement
:math:`x_0` per newton of load, the relative motion :math:`x = (u_1, u_2, v)` of the surfaces and the forces
:math:`F = (T_1, T_2, N)` satisfy

.. math:: x = \Psi\eta + P x_0 - R F,\qquad \Psi^T F = P f,

.. math:: N \ge 0,\quad v \le g,\quad N (v - g) = 0;\qquad |T_d| \le \mu N,\quad
          (\mu N - |T_d|)\,(u_d - w_d) = 0,\quad T_d\,(u_d - w_d) \ge 0,

:math:`g` the initial gap and :math:`w` the position at which a point was stuck before the load step.  The same conditions
read :math:`F = \mathrm{law}(x + F/k)` with the law of an elastic contact element of any stiffness :math:`k > 0`, which
cancels: piecewise linear equations for :math:`(F, \eta)`, solved by Newton's method on the states of the points, with the
load in steps where that is needed.  :class:`Certificate` measures the conditions themselves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bdamper.coupling import Coupling
from bdamper.errors import ModelError, SettingError

STICK, SLIP_PLUS, SLIP_MINUS, OPEN = range(4)


@dataclass(frozen=True)
class Certificate:
    """Largest violations of equilibrium and of the contact conditions, without unit.

    Forces are relative to the largest contact force, displacements to the largest relative motion or gap, products to the
    product of both.

    Parameters
    ----------
    equilibrium : float
    tension, penetration, separation : float
        ``N < 0``; ``v > g``; ``N (g - v)``.
    friction, sticking, sense : float
        ``|T| > mu N``; motion of a point whose friction is below its limit; friction along the slip instead of against it.
    """

    equilibrium: float
    tension: float
    penetration: float
    separation: float
    friction: float
    sticking: float
    sense: float

    @property
    def worst(self) -> float:
        return max(vars(self).values())

    def __str__(self) -> str:
        return ", ".join(f"{name} {value:.1e}" for name, value in vars(self).items())


@dataclass(frozen=True)
class StaticContactProblem:
    """Arrays of the problem.

    Parameters
    ----------
    flexibility : (3 n, 3 n) float, m/N
    rigid : (3 n, n_rigid) float
        Relative motion by rigid-body coordinates.
    load : (n_rigid,) float
        Their generalised force per newton of load.
    offset : (n, 3) float, m/N
        Relative motion by the load without contact.
    friction, gap : (n,) float
    """

    flexibility: NDArray
    rigid: NDArray
    load: NDArray
    offset: NDArray
    friction: NDArray
    gap: NDArray


@dataclass(frozen=True)
class StaticContactSolution:
    """A state of the contact.

    Parameters
    ----------
    load : float, N
    force : (n, 3) float, N
        T1, T2, N; N positive in compression.
    motion : (n, 3) float, m
        u1, u2, v of the surfaces.
    slider : (n, 2) float, m
    rigid : (n_rigid,) float
    status : (n, 2) int
        0 stick, 1 slip +, 2 slip -, 3 open.
    certificate : Certificate
    iterations, steps : int
    """

    load: float
    force: NDArray
    motion: NDArray
    slider: NDArray
    rigid: NDArray
    status: NDArray
    certificate: Certificate
    iterations: int
    steps: int


def certify(
    problem: StaticContactProblem, load: float, force: NDArray, motion: NDArray, rest: NDArray
) -> Certificate:
    """Violations of the conditions by forces (n, 3) and motion (n, 3), ``rest`` (n, 2) where the points were stuck before.

    The motion is what the caller claims; that it belongs to the forces is not checked here.
    """
    size = max(float(np.abs(force).max(initial=0.0)), 1e-300)
    slip = motion[:, :2] - rest
    distance = problem.gap - motion[:, 2]
    reach = max(float(np.abs(motion).max(initial=0.0)), float(np.abs(problem.gap).max(initial=0.0)), 1e-300)
    normal = force[:, 2]
    limit = problem.friction[:, None] * normal[:, None]
    balance = problem.rigid.T @ force.ravel() - load * problem.load
    largest = max(float(np.abs(problem.rigid.T).max(initial=0.0)) * size, 1e-300)

    def top(values: NDArray, unit: float) -> float:
        return max(0.0, float(np.max(values, initial=0.0))) / unit

    return Certificate(
        equilibrium=top(np.abs(balance), largest),
        tension=top(-normal, size),
        penetration=top(-distance, reach),
        separation=top(np.abs(normal * distance), size * reach),
        friction=top(np.abs(force[:, :2]) - limit, size),
        sticking=top(np.abs((limit - np.abs(force[:, :2])) * slip), size * reach),
        sense=top(-force[:, :2] * slip, size * reach),
    )


def _law(
    problem: StaticContactProblem, k: NDArray, z: NDArray, rest: NDArray, fixed: NDArray | None
) -> tuple[NDArray, NDArray]:
    """Forces and states of elements of stiffness k (n, 3) at z (n, 3); friction limits ``mu N``, or fixed ones."""
    level = k[:, 2] * (z[:, 2] - problem.gap)
    normal = np.maximum(level, 0.0)
    limit = (problem.friction * normal if fixed is None else fixed)[:, None]
    trial = k[:, :2] * (z[:, :2] - rest)
    status = np.where(trial > limit, SLIP_PLUS, np.where(trial < -limit, SLIP_MINUS, STICK))
    if fixed is None:
        status[level <= 0.0] = OPEN
    return np.column_stack([np.clip(trial, -limit, limit), normal]), status


def _tangent(
    problem: StaticContactProblem, k: NDArray, status: NDArray, closed: NDArray, fixed: NDArray | None
) -> NDArray:
    """(n, 3, 3) derivative of the law in given states."""
    out = np.zeros((len(k), 3, 3))
    out[closed, 2, 2] = k[closed, 2]
    for d in range(2):
        stick = status[:, d] == STICK
        out[stick, d, d] = k[stick, d]
        if fixed is not None:
            continue
        for sign, state in ((1.0, SLIP_PLUS), (-1.0, SLIP_MINUS)):
            slip = status[:, d] == state
            out[slip, d, 2] = sign * problem.friction[slip] * k[slip, 2]
    return out


class _Solver:
    """Newton's method in units of the size of forces: unknowns F and eta."""

    def __init__(self, problem: StaticContactProblem) -> None:
        self.problem = problem
        n = len(problem.gap)
        self.n = n
        self.k = (1.0 / np.diag(problem.flexibility)).reshape(n, 3)
        # a rigid coordinate is measured by the displacement that it gives
        self.rigid_unit = np.abs(problem.rigid).max(initial=1e-300) * self.k.mean()
        self.iterations = 0
        self.fixed: NDArray | None = None

    def motion(self, load: float, F: NDArray, eta: NDArray) -> NDArray:
        p = self.problem
        return (p.rigid @ eta - p.flexibility @ F.ravel()).reshape(-1, 3) + load * p.offset

    def residual(
        self, load: float, F: NDArray, eta: NDArray, rest: NDArray
    ) -> tuple[NDArray, NDArray, NDArray, NDArray]:
        x = self.motion(load, F, eta)
        law, status = _law(self.problem, self.k, x + F / self.k, rest, self.fixed)
        balance = self.problem.rigid.T @ F.ravel() - load * self.problem.load
        return (F - law).ravel(), balance, status, law[:, 2] > 0.0

    def newton_step(
        self, r: NDArray, balance: NDArray, status: NDArray, closed: NDArray
    ) -> tuple[NDArray, NDArray]:
        p, n, m = self.problem, self.n, self.problem.rigid.shape[1]
        B = _tangent(p, self.k, status, closed, self.fixed)
        # F - law(x + F/k): dF - B (dF/k + Psi deta - R dF)
        A = np.zeros((3 * n + m, 3 * n + m))
        A[: 3 * n, : 3 * n] = self._force_block(B)
        A[: 3 * n, 3 * n :] = -np.matmul(B, p.rigid.reshape(n, 3, m)).reshape(3 * n, m) / self.rigid_unit
        A[3 * n :, : 3 * n] = p.rigid.T / np.abs(p.rigid).max(initial=1e-300)
        b = -np.concatenate([r, balance / np.abs(p.rigid).max(initial=1e-300)])
        try:
            step = np.linalg.solve(A, b)
            if not np.isfinite(step).all() or np.abs(A @ step - b).max() > 1e-8 * np.abs(b).max():
                raise np.linalg.LinAlgError
        except np.linalg.LinAlgError:
            step = np.linalg.lstsq(A, b, rcond=1e-12)[0]
        return step[: 3 * n].reshape(n, 3), step[3 * n :] / self.rigid_unit

    def _force_block(self, B: NDArray) -> NDArray:
        n = self.n
        block = np.matmul(B, self.problem.flexibility.reshape(n, 3, 3 * n)).reshape(3 * n, 3 * n)
        block.flat[:: 3 * n + 1] += 1.0
        for i in range(3):
            for j in range(3):
                block[np.arange(n) * 3 + i, np.arange(n) * 3 + j] -= B[:, i, j] / self.k[:, j]
        return block

    def solve(
        self, load: float, F: NDArray, eta: NDArray, rest: NDArray, tolerance: float, max_iterations: int
    ) -> tuple[NDArray, NDArray, NDArray, bool]:
        """Newton with other stiffnesses of the elements where one does not lead there: the solution is the same."""
        own = self.k
        try:
            for factor in (1.0, 10.0, 0.1, 100.0, 0.01):
                self.k = factor * own
                out = self.newton(load, F, eta, rest, tolerance, max_iterations)
                if out[3]:
                    return out
            self.k = own
            return self.by_limits(load, F, eta, rest, tolerance, max_iterations)
        finally:
            self.k = own

    def by_limits(
        self, load: float, F: NDArray, eta: NDArray, rest: NDArray, tolerance: float, max_iterations: int
    ) -> tuple[NDArray, NDArray, NDArray, bool]:
        """Friction limits held fixed in turn and renewed (a convex problem each), then Newton's method as before."""
        mu = self.problem.friction
        try:
            self.fixed = mu * np.maximum(F[:, 2], 0.0)
            for turn in range(40):
                F, eta, status, ok = self.newton(load, F, eta, rest, tolerance, 2 * max_iterations)
                if not ok:
                    return F, eta, status, False
                limit = mu * np.maximum(F[:, 2], 0.0)
                change = float(np.abs(limit - self.fixed).max(initial=0.0))
                self.fixed = limit
                if turn % 4 == 3 or change < 1e-8 * float(np.abs(F).max(initial=0.0)):
                    self.fixed = None
                    out = self.newton(load, F, eta, rest, tolerance, max_iterations)
                    if out[3]:
                        return out
                    self.fixed = limit
        finally:
            self.fixed = None
        return F, eta, status, False

    def newton(
        self, load: float, F: NDArray, eta: NDArray, rest: NDArray, tolerance: float, max_iterations: int
    ) -> tuple[NDArray, NDArray, NDArray, bool]:
        """Newton with a line search; forces, rigid coordinates, states, and whether it converged."""
        size = max(float(np.abs(F).max(initial=0.0)), abs(load) * float(np.abs(self.problem.load).max(initial=0.0)))
        unit = np.abs(self.problem.rigid).max(initial=1e-300)
        r, balance, status, closed = self.residual(load, F, eta, rest)

        def norm(r: NDArray, balance: NDArray) -> float:
            return float(np.sqrt(r @ r + balance @ balance / unit**2))

        now = norm(r, balance)
        for _ in range(max_iterations):
            size = max(float(np.abs(F).max(initial=0.0)), 1e-300)
            if now <= tolerance * size:
                return F, eta, status, True
            self.iterations += 1
            dF, deta = self.newton_step(r, balance, status, closed)
            fraction, best = 1.0, (np.inf, F, eta, r, balance, status, closed)
            for _ in range(6):
                trial = F + fraction * dF, eta + fraction * deta
                r_t, balance_t, status_t, closed_t = self.residual(load, *trial, rest)
                value = norm(r_t, balance_t)
                if value < best[0]:
                    best = (value, *trial, r_t, balance_t, status_t, closed_t)
                if value < (1.0 - 0.1 * fraction) * now:
                    break
                fraction *= 0.5
            if best[0] >= now:
                # no descent along Newton's direction: the full step moves to other states
                F, eta = F + dF, eta + deta
                r, balance, status, closed = self.residual(load, F, eta, rest)
                now = norm(r, balance)
            else:
                now, F, eta, r, balance, status, closed = best
        return F, eta, status, now <= tolerance * max(float(np.abs(F).max(initial=0.0)), 1e-300)


    def seat(
        self, load: float, rest: NDArray, tolerance: float, max_iterations: int
    ) -> tuple[NDArray, NDArray, NDArray, bool]:
        """First state under load: from all points bonded without gaps, then with the gaps opened step by step."""
        F, eta = _bonded(self.problem, self, load)
        whole = self.problem
        if not np.any(whole.gap):
            return self.solve(load, F, eta, rest, tolerance, max_iterations)
        part, step = 0.0, 1.0
        self.problem = replace(whole, gap=np.zeros_like(whole.gap))
        F, eta, status, ok = self.solve(load, F, eta, rest, tolerance, max_iterations)
        while ok and part < 1.0:
            now = min(1.0, part + step)
            self.problem = replace(whole, gap=now * whole.gap)
            trial = self.solve(load, F, eta, rest, tolerance, max_iterations)
            if trial[3]:
                F, eta, status, _ = trial
                part, step = now, 2.0 * step
            else:
                step *= 0.25
                ok = step > 1e-4
        self.problem = whole
        return F, eta, status, ok


def solve_static_contact(
    problem: StaticContactProblem,
    loads: Sequence[float] = (1.0,),
    *,
    steps: int = 8,
    tolerance: float = 1e-12,
    max_iterations: int = 25,
) -> list[StaticContactSolution]:
    """States of the contact at the end of each leg of a history of loads, from rest without load.

    Parameters
    ----------
    problem : StaticContactProblem
    loads : sequence of float, N
        Passed one after the other.
    steps : int
        Load steps of a leg.  Without gaps the first leg, from rest, needs only one: the state is proportional to the load.
    tolerance : float
        On the residual, relative to the largest contact force.
    max_iterations : int
        In a step; a step that fails is halved, down to a hundredth.

    Raises
    ------
    ModelError
        If there is nothing that loads the contact, or no state was found.
    """
    if not np.any(problem.load):
        raise ModelError("static contact: expected a load on a free body, the model has none")
    n = len(problem.gap)
    solver = _Solver(problem)
    F, eta, rest = np.zeros((n, 3)), np.zeros(problem.rigid.shape[1]), np.zeros((n, 2))
    # all points closed: with gaps and no contact yet nothing would hold the body
    at, out = 0.0, []
    for leg, target in enumerate(loads):
        if not (np.isfinite(target) and target >= 0.0):
            raise SettingError(f"load history: expected finite numbers >= 0 N, found {target}")
        done, taken = 0.0, 0
        fraction = 1.0 if leg == 0 and not np.any(problem.gap) else 1.0 / steps
        first = at
        while done < 1.0 and target != first:
            now = min(1.0, done + fraction)
            load = first + now * (target - first)
            ok = False
            if at > 0.0:
                F_new, eta_new, status, ok = solver.solve(load, F, eta, rest, tolerance, max_iterations)
            if at == 0.0 or (not ok and np.any(problem.gap) and fraction < 1.0 / steps):
                F_new, eta_new, status, ok = solver.seat(load, rest, tolerance, max_iterations)
            if not ok:
                fraction *= 0.5
                if fraction < 1e-2 / steps:
                    raise ModelError(
                        f"static contact: the states of the points did not settle beyond a load of {at:.6g} N (of "
                        f"{target:.6g} N); give the contact stiffness or finite element contact forces instead"
                    )
                continue
            F, eta, at, done, taken = F_new, eta_new, load, now, taken + 1
            motion = solver.motion(load, F, eta)
            before = rest
            rest = np.where(status == STICK, rest, motion[:, :2])
        if target == first:
            motion, before = solver.motion(at, F, eta), rest
            status = solver.residual(at, F, eta, rest)[2]
        out.append(
            StaticContactSolution(
                at, F, motion, rest, eta, status, certify(problem, at, F, motion, before), solver.iterations, taken
            )
        )
    return out


def _bonded(problem: StaticContactProblem, solver: _Solver, load: float) -> tuple[NDArray, NDArray]:
    """All points closed and stuck, at zero gap: the first guess."""
    n, m = solver.n, problem.rigid.shape[1]
    status = np.full((n, 2), STICK)
    eta = np.zeros(m)
    F = np.zeros((n, 3))
    x = solver.motion(load, F, eta)
    r = (F - solver.k * x).ravel()
    balance = problem.rigid.T @ F.ravel() - load * problem.load
    dF, deta = solver.newton_step(r, balance, status, np.full(n, True))
    return dF, deta


def static_contact_problem(coupling: Coupling, friction: NDArray, gap: NDArray) -> StaticContactProblem:
    """The problem of a model: every mode counts through the flexibility at nodal diameter 0.

    Parameters
    ----------
    coupling : Coupling
        Interfaces and retained rigid-body modes.
    friction, gap : (n_points,) float
    """
    modes = {}
    for body in coupling.model.bodies.values():
        if body.kind != "ground":
            keep = np.asarray(coupling.modes[body.name])
            modes[body.name] = keep[body.bases[0].omega2[keep] == 0.0]
    bare = Coupling(coupling.model, coupling.interfaces, modes, coupling.engine_order, coupling.single_basis)
    load, offset = bare.load()
    n = coupling.n_points
    flexibility = bare.residual_flexibility(0).real
    return StaticContactProblem(flexibility, bare.basis(0).G.real.reshape(3 * n, -1), load, offset, friction, gap)
