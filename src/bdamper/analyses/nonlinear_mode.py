"""Following a nonlinear mode over its amplitude.

Up to some amplitude nothing slips or opens, and the mode is that of stuck contact, exactly: this part is one piece
without steps.  From there on the branch is followed by arclength, since it may turn back in the amplitude where a
harmonic meets another mode; from its upper end, too, where it does not get there.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bdamper.analyses.nonlinear_mode_result import NonlinearMode
from bdamper.contact.static_state import PreloadState
from bdamper.harmonic_balance.contact_cycle import at_angles
from bdamper.harmonic_balance.equations import OK, Correction, Equations
from bdamper.harmonic_balance.nonlinear_mode_equations import Mode, mode_equations
from bdamper.harmonic_balance.problem import Problem, stuck_springs
from bdamper.response.branches import Piece, evaluation_budget, in_order
from bdamper.response.continuation import TWO_PI, follow
from bdamper.response.continuation_options import ContinuationOptions, Path
from bdamper.util import validation
from bdamper.util.cost import CostMeter
from bdamper.util.errors import SettingError
from bdamper.util.status import COMPLETE, INCOMPLETE, NOT_FOUND
from bdamper.util.threading import one_thread

RIGID = 1e-6
"""Of the highest frequency without contact: those below it are rigid motions."""
FLAT = 1e-6
"""By how much a maximum of the damping exceeds its neighbours at least, relative."""


@validation.spelt
@one_thread
def nonlinear_mode(
    problem: Problem,
    preload: float,
    mode: int = 1,
    amplitude: tuple[float, float] = (1e-6, 1e-3),
    *,
    options: ContinuationOptions | None = None,
) -> NonlinearMode:
    """Frequency and damping of a mode over the amplitude of the free vibration.

    The motion is periodic: a force in proportion to mass times velocity, ``2 omega zeta M q'``, balances all losses, and
    zeta is the modal damping ratio (M. Krack, Computers & Structures 154, 2015).  Excitation has no part in it.

    Parameters
    ----------
    problem : Problem
    preload : float, N
    mode : int
        1 for the lowest elastic mode without contact; the stuck mode most like it is followed by continuity.
    amplitude : (low, high), m
        Of the first harmonic of the response.
    options : ContinuationOptions

    Returns
    -------
    NonlinearMode
        "complete" if the branch reaches the upper amplitude as the same mode; otherwise ``reason`` says where it ends.

    Raises
    ------
    SettingError
        If a value does not fit, or the response does not move in this mode.
    """
    preload, mode = problem.check_preload(preload), validation.whole("mode", mode, least=1)
    low, high = validation.interval("amplitude", amplitude, "m")
    validation.instance("options", options or ContinuationOptions(), ContinuationOptions)
    meter = CostMeter()
    state = problem.equilibrium(preload)
    system, omega = mode_system(problem, preload, mode, low)
    meter.watch(system)
    branch = _Branch(system, (low, high), options or ContinuationOptions())
    branch.run(state, omega)
    meter.count(sum(p.path.iterations for p in branch.pieces), sum(p.path.failed_steps for p in branch.pieces))
    points = in_order(branch.pieces)
    y = np.array([p.y for p, _ in points]).reshape(len(points), system.n_unknowns + 1)
    u, correlation = system.structure.motion(y), _correlation(system, y)
    status, reason = _ending(branch, y, correlation, mode)
    return NonlinearMode(
        frequency=y[:, -3] / TWO_PI,
        damping_ratio=y[:, -2],
        harmonics=system.structure.driven.response(u),
        unknowns=u,
        correlation=correlation,
        shares=np.array([p.shares for p, _ in points]).reshape(-1, 3),
        residual=np.array([p.residual for p, _ in points]),
        branch=np.array([way.branch for _, way in points], int),
        point_kind=_kinds(points, y[:, -2]),
        linear_to=branch.linear_to,
        preload=preload,
        mode=mode,
        scales_to=_scales_to(problem, system, u, preload),
        status=status,
        reason=reason,
        cost=meter.read(),
        **problem.recorded(options),
    )


def mode_system(problem: Problem, preload: float, mode: int, low: float) -> tuple[Equations[Mode], float]:
    """Equations of a mode for amplitudes of the response from ``low`` (m) on, and its stuck frequency (rad/s)."""
    state, driven = problem.equilibrium(preload), problem.system(preload)
    free, alone = driven.structure.linear.modes(None)
    elastic = np.flatnonzero(free > RIGID * free[-1])
    mode = validation.whole("mode", mode, least=1, most=len(elastic))
    frequencies, shapes = driven.structure.linear.modes(stuck_springs(problem, state))
    across = np.abs((driven.structure.bases[1].mass * alone[:, elastic[mode - 1]].conj()) @ shapes)
    k = int(np.argmax(across))
    row, shape = driven.response_rows[1], shapes[:, k]
    if not abs(row @ shape) > 1e-6 * float(np.linalg.norm(row) * np.linalg.norm(shape)):
        raise SettingError(f"response: expected a place and direction that mode {mode} moves, found one that it does not")
    # of the lowest amplitude: how small a motion the first point is looked for at, where contacts slip already
    descent = 1e-4
    return mode_equations(driven, float(frequencies[k]), shape, descent * low), float(frequencies[k])


class _Branch:
    """The branch through the stuck mode, between two amplitudes (m)."""

    def __init__(self, system: Equations[Mode], amplitude: tuple[float, float], options: ContinuationOptions) -> None:
        self.system = system.within(options.budget or evaluation_budget(system))
        self.options = options
        self.low, self.high = (float(np.log(a / system.structure.reference)) for a in amplitude)
        self.pieces: list[Piece] = []
        self.linear_to = np.nan

    def run(self, state: PreloadState, omega: float) -> None:
        """Follows it from its start; from the upper end as well, if it does not get there."""
        start = self._start(state, omega)
        if start is None:
            self.pieces.append(Piece(Path((), NOT_FOUND, "no motion at the lowest amplitude", 0, 0), True))
            return
        ahead = self._linear(start)
        if ahead.y[-1] >= self.high:
            last = self._at(start.y, self.high)
            points = [replace(c, kind="end") for c in (start, last)]
            reason = f"reached {self.system.measure.place(self.high)}, where nothing slips yet"
            self.pieces.append(Piece(Path(tuple(points), COMPLETE, reason, 0, 0), True))
            return
        path = follow(self.system, ahead.y, (float(start.y[-1]), self.high), options=self.options)
        if ahead is not start:
            path = replace(path, points=(replace(start, kind="end"), *path.points))
        self.pieces.append(Piece(path, True))
        if path.status != COMPLETE and path.points and not self.system.spent:
            self._from_above(path.points[-1].y)

    def _scale(self, y: NDArray) -> NDArray:
        return self.system.units(y, 1.0)

    def _at(self, y: NDArray, parameter: float) -> Correction:
        """Newton with line search from a point at another amplitude."""
        y = np.append(y[:-1], parameter)
        return self.system.correct_at(y[:-1], parameter, self._scale(y), self.options.tolerance, 40, True)

    def _start(self, state: PreloadState, omega: float) -> Correction | None:
        """The motion of the lowest amplitude; where there is none near the linear mode, that of a smaller one."""
        guess = self.system.structure.start(state.q, omega, self.system.structure.reference * float(np.exp(self.low)))
        for lower in np.log([1.0, 0.1, 0.01, 0.002]):
            found = self._at(guess, self.low + float(lower))
            if found.status == OK:
                return found
        return None

    def _linear(self, start: Correction) -> Correction:
        """The last point up to which the motion only grows, a little before something slips or opens; or the start."""

        def holds(parameter: float) -> bool:
            y = np.append(start.y[:-1], parameter)
            r = np.empty(self.system.n_unknowns)
            self.system.core.evaluate(y, r)
            return float(np.abs(r * self.system.row_scale).max()) <= self.options.tolerance

        least, most = float(start.y[-1]), self.high
        if not holds(least + 1e-3):
            return start
        if not holds(most):
            while most - least > 1e-12:
                middle = 0.5 * (least + most)
                least, most = (middle, most) if holds(middle) else (least, middle)
        self.linear_to = float(self.system.structure.reference * np.exp(most))
        stuck_part = 0.9  # of the amplitude at which something begins to slip: where steps begin
        begin = most if most == self.high else most + float(np.log(stuck_part))
        return self._at(start.y, begin) if begin > start.y[-1] else start

    def _from_above(self, last: NDArray) -> None:
        """The branch that a motion of the largest amplitude lies on, downward."""
        found = self._at(last, self.high)
        if found.status == OK:
            path = follow(self.system, found.y, (self.low, self.high), up=False, options=self.options)
            self.pieces.append(Piece(path, False, 1))


def _correlation(system: Equations[Mode], y: NDArray) -> NDArray:
    """(n,) square of the cosine between the first harmonic and the stuck mode, in the norm of the mass."""
    a, mass = system.layout.amplitudes(y, 1), system.structure.basis.mass
    across = np.abs(a @ (mass * system.structure.stuck.conj())) ** 2
    return np.asarray(across / ((np.abs(a) ** 2 @ mass) * (np.abs(system.structure.stuck) ** 2 @ mass)))


def _scales_to(problem: Problem, system: Equations[Mode], u: NDArray, preload: float) -> float:
    """Highest preload (N) up to which motions u grow in proportion to it; 0 where they do not at all.

    Without interference, cubic springs and constant forces the contact is homogeneous as long as no gap closes in a cycle.
    """
    static = problem.static_system
    if preload == 0.0 or problem.settings.residual_slip_std or np.any(static.cubic):
        return 0.0
    if np.any(static.n0 > 0.0) or np.any(static.constant_force):
        return 0.0
    gapped = static.n0 < 0.0
    gap = -static.n0[gapped] / static.kn[gapped]
    theta = np.linspace(0.0, TWO_PI, 64 * system.n_harmonics, endpoint=False)
    closing = (system.structure.driven.contact(one)[0][gapped, 2] for one in u)
    used = [(at_angles(v, theta).max(axis=1) / gap).max(initial=0.0) for v in closing]
    most = max(used, default=1.0)
    return 0.0 if most >= 1.0 else preload / most if most > 0.0 else float("inf")


def _kinds(points: list[tuple[Correction, Piece]], damping: NDArray) -> tuple[str, ...]:
    """What the points are; a maximum of the damping that hardly stands out among its neighbours is none."""
    around = np.concatenate([damping[:1], damping, damping[-1:]])
    low = np.maximum(around[:-2], around[2:]) >= (1.0 - FLAT) * damping
    return tuple("regular" if p.kind == "maximum" and flat else p.kind for (p, _), flat in zip(points, low))


def _ending(branch: _Branch, y: NDArray, correlation: NDArray, mode: int) -> tuple[str, str]:
    """Status and reason of the mode."""
    path, place = branch.pieces[0].path, branch.system.measure.place
    if not path.points:
        return NOT_FOUND, path.reason
    reason = f"{path.status}: {path.reason}" if path.status != COMPLETE else path.reason
    apart = len(branch.pieces) > 1
    reason += f"; another branch from {place(branch.high)} down" if apart else ""
    familiar = 0.5  # correlation with the stuck mode below which a motion counts as that of another one
    overdamped = 0.5  # damping ratio beyond which a periodic motion says little about one that decays
    foreign, over = correlation < familiar, y[:, -2] > overdamped
    if foreign.any():
        at = y[int(np.argmax(foreign))]
        reason += f"; beyond {place(at[-1])} the motion is no longer that of mode {mode}: it meets another one"
    if over.any():
        at = y[int(np.argmax(over))]
        reason += f"; damping is above {overdamped:g} from {place(at[-1])} on, where no motion decays so"
    whole = path.status == COMPLETE and not foreign.any() and not over.any()
    return COMPLETE if whole else INCOMPLETE, reason
