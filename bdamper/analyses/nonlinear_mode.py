"""Nonlinear modes: frequency and damping of free vibration over its amplitude.

The equations describe a sector without excitation, with frequency and damping as unknowns
(``csrc/balance/nonlinear_mode.c``). A point ``y = (Q_0, P, omega, zeta, ln(A/A_0))`` contains the mean, the vibration ``P``
scaled to the response amplitude ``A_0``, the angular frequency, the modal damping ratio and the response amplitude ``A``.

At small amplitudes nothing slips or opens, and the mode is exactly the linear mode of stuck contact: this part needs no
steps. From
there the branch is followed by arclength continuation, because the amplitude may decrease along it if a harmonic resonates
with another mode. If the branch does not reach the upper amplitude, another branch is followed downward from there.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from bdamper import _core
from bdamper.contact.preload_state import PreloadState
from bdamper.harmonic_balance.checks import warn_of_small_slip
from bdamper.harmonic_balance.contact_cycle import at_angles
from bdamper.harmonic_balance.equations import OK, Correction, Equations, Rows, norm2
from bdamper.harmonic_balance.problem import Problem
from bdamper.harmonic_balance.sector import Sector
from bdamper.model.kinematics import HarmonicBasis
from bdamper.response.branches import Piece, evaluation_budget, in_order
from bdamper.response.continuation import TWO_PI, follow
from bdamper.response.events import ContinuationOptions, Path
from bdamper.util import validation
from bdamper.util.display import Comparable, InContact
from bdamper.util.errors import COMPLETE, INCOMPLETE, NOT_FOUND, SettingError
from bdamper.util.formatting import amount, peak_text, short_repr
from bdamper.util.progress import Cost, CostMeter, one_thread, progress_bar, shows_progress
from bdamper.util.storage import Recorded, Storable
from bdamper.util.tables import (
    ROW,
    FrequencySeries,
    Hertz,
    Kinds,
    Numbers,
    PerRow,
    Quantity,
    Shares,
    Tabular,
)


@short_repr
@dataclass(frozen=True)
class NonlinearMode(
    InContact,
    Comparable,
    FrequencySeries,
    Tabular,
    Recorded,
    Storable,
    kind="bdamper-nonlinear-mode",
):
    """Free vibration of a structure with friction: frequency and damping over amplitude.

    Every point is a converged periodic motion. ``plot`` draws frequency and damping over amplitude
    (:func:`bdamper.plot.plot_nonlinear_mode`).

    Parameters
    ----------
    frequency, damping_ratio : (n,) float, Hz and 1
        Frequency, and the ratio of the negative damping proportional to mass that would sustain the motion.
    harmonics : (n, n_harmonics + 1) complex, m
        Harmonics of the response; the first column is the mean.
    unknowns : (n, n_unknowns) float
        Modal coordinates (kg^1/2 m): mean, then cosine and sine amplitudes of each harmonic.
    correlation : (n,) float
        MAC of the first harmonic with the mode of stuck contact.
    shares : (n, 3) float
        Shares of stick, slip and separation, averaged over the friction points and the cycle.
    residual, branch : (n,) float and int
    point_kind : tuple of str
        "regular", "fold" (turning point of the amplitude), "maximum" (of the damping), "end" or "drift".
    linear_to : float, m
        Amplitude up to which nothing slips or opens; NaN if this is not so at the lowest amplitude.
    preload, mode : float (N) and int
    scales_to : float, N
        Highest preload to which the curve can be scaled (:meth:`at_preload`); 0 if it cannot be scaled.
    status, reason, cost, settings, model_hash
        See :class:`bdamper.response.response_curve_result.ResponseCurve`.
    """

    frequency: Hertz
    damping_ratio: Annotated[NDArray, Quantity("", "Modal damping ratio")]
    harmonics: Annotated[NDArray, Quantity("m", dims=(ROW, "harmonic"))]
    unknowns: PerRow
    correlation: Numbers
    shares: Shares
    residual: Numbers
    branch: Numbers
    point_kind: Kinds
    linear_to: float
    preload: float
    mode: int
    scales_to: float
    status: str
    reason: str
    cost: Cost
    _summary_fields = ("mode", "preload", "status", "folds", "linear_to", "scales_to")

    @property
    def folds(self) -> NDArray:
        """Indices (k,) of the turning points of the amplitude."""
        return np.array([i for i, kind in enumerate(self.point_kind) if kind == "fold"], int)

    def at(self, amplitude: float) -> list[tuple[float, float]]:
        """Return frequency (Hz) and damping ratio of all motions with an amplitude (m), in the order of the branch.

        Values between points are interpolated linearly over the logarithm of the amplitude.
        """
        a = np.log(self.amplitude / validation.number("amplitude", amplitude, above=0.0, unit="m"))
        i = np.flatnonzero(
            (a[:-1] * a[1:] <= 0.0) & (a[1:] != 0.0) & (self.branch[:-1] == self.branch[1:])
        )
        part = a[i] / (a[i] - a[i + 1])
        f, zeta = (x[i] + part * (x[i + 1] - x[i]) for x in (self.frequency, self.damping_ratio))
        return list(zip(f.tolist(), zeta.tolist()))

    def at_preload(self, preload: float) -> NonlinearMode:
        """Return the mode at another preload, with displacements and forces scaled in proportion.

        Raises
        ------
        SettingError
            If the mode does not scale to this preload, because of closing gaps, interference, cubic springs or constant
            forces.
        """
        preload = validation.number("preload", preload, above=0.0, unit="N")
        if preload > self.scales_to:
            actual = (
                f"one that scales to {self.scales_to:.6g} N"
                if self.scales_to
                else "one that does not scale"
            )
            raise SettingError(
                f"preload: expected a mode that scales to {preload:.6g} N, without interference, cubic springs, constant "
                f"forces and gaps that close, found {actual}; compute it there"
            )
        s = preload / self.preload
        return replace(
            self,
            preload=preload,
            harmonics=s * self.harmonics,
            unknowns=s * self.unknowns,
            linear_to=s * self.linear_to,
        )

    def _headline(self) -> str:
        if not len(self):
            return f"No motion of mode {self.mode} was found: {self.reason}."
        top, where = (
            int(np.argmax(self.damping_ratio)),
            f"under a preload of {amount(self.preload, 'N')}",
        )
        edge = ", an end of the range" if top in (0, len(self) - 1) else ""
        return (
            f"Damping of mode {self.mode} {where}: at most {amount(100.0 * self.damping_ratio[top], '%')}, with "
            f"{peak_text(self.amplitude[top], self.frequency[top])}{edge}; the frequency lies between "
            f"{amount(self.frequency.min(), 'Hz')} and {amount(self.frequency.max(), 'Hz')}."
            + ("" if self.complete else f" The mode is {self.status}: {self.reason}.")
        )


# ---- Equations of nonlinear modes ----


@dataclass(frozen=True)
class InAmplitude:
    """Scaling of unknowns for equations with the logarithm of the amplitude as parameter.

    Parameters
    ----------
    n_mean : int
        Number of unknowns of the mean.
    reference : float, m
        Response amplitude at parameter 0.
    """

    n_mean: int
    reference: float

    SHIFT, DAMPING = 0.05, 0.1
    """Relative change of frequency and change of damping ratio that count as much as the complete vibration."""

    def vibration(self, y: NDArray) -> float:
        """Return the norm of the harmonics."""
        return norm2(y[self.n_mean : -3]) * float(np.exp(y[-1]))

    def units(self, y: NDArray, vibration: float, width: float) -> NDArray:
        """Return the units of mean, vibration, frequency, damping and logarithm of the amplitude."""
        scale = np.ones(len(y))
        scale[: self.n_mean] = max(norm2(y[: self.n_mean]), vibration)
        scale[self.n_mean : -3] = vibration * float(np.exp(-y[-1]))
        scale[-3], scale[-2] = self.SHIFT * y[-3], self.DAMPING
        return scale

    def place(self, parameter: float) -> str:
        """Return the response amplitude at a value of the parameter as text."""
        return f"{self.reference * np.exp(parameter):.6g} m"


@dataclass(frozen=True, eq=False)
class Mode:
    """Periodic motions sustained by a force proportional to mass times velocity.

    Two linear equations define the amplitude of the first harmonic of the response and its phase, which is zero.

    Parameters
    ----------
    driven : Equations
        Equations of one structure at one preload, with static forces only.
    stuck : (n_modes,) complex
        Approximate motion of the mode in the first harmonic, in modal coordinates, at the reference amplitude.
    reference : float, m
        Response amplitude A_0 below all computed amplitudes, so that the parameter is positive.
    """

    driven: Equations[Sector]
    stuck: NDArray
    reference: float

    @property
    def basis(self) -> HarmonicBasis:
        """Modes of the first harmonic."""
        return self.driven.structure.bases[1]

    def start(self, mean: NDArray, omega: float, amplitude: float) -> NDArray:
        """Return the linear mode at a response amplitude (m), an initial guess."""
        size = np.abs(self.stuck) ** 2
        zeta = float(size @ self.basis.damping / (size @ self.basis.mass)) / (2.0 * omega)
        u = self.driven.layout.pack(mean[: self.driven.n_mean], self.stuck)
        return np.append(u, [omega, zeta, np.log(amplitude / self.reference)])

    def point(self, u: NDArray, omega: float, zeta: float) -> NDArray:
        """Return the point ``y`` of a motion whose response has phase zero.

        Parameters
        ----------
        u : (n_unknowns,) float
            Unknowns of the driven equations.
        omega : float, rad/s
        zeta : float
        """
        ratio = float(abs(self.driven.response(u)[1])) / self.reference
        y = np.append(u, [omega, zeta, np.log(ratio)])
        y[self.driven.n_mean : -3] /= ratio
        return y

    def motion(self, y: NDArray) -> NDArray:
        """Return the unknowns (..., n_unknowns) of the driven equations at points."""
        u = np.array(y[..., :-3])
        u[..., self.driven.n_mean :] *= np.exp(y[..., -1:])
        return u


def mode_equations(
    driven: Equations[Sector], omega: float, shape: NDArray, reference: float
) -> Equations[Mode]:
    """Return the equations of a mode.

    Parameters
    ----------
    driven : Equations
    omega : float, rad/s
        Approximate angular frequency.
    shape : (n_modes,) complex
        Approximate mode shape.
    reference : float, m
        Reference amplitude.
    """
    sector, n_mean = driven.core, driven.n_mean
    assert isinstance(sector, _core.Sector)
    row = np.asarray(driven.response_rows[1])
    stuck = np.asarray(shape) * (reference / (row @ shape))
    re, im = driven.layout.parts(row / reference)
    weight = omega**2 * norm2(np.abs(stuck))
    scale = np.append(driven.row_scale, [1.0 / weight, 1.0 / weight])
    scale[n_mean:-2] = 1.0 / weight
    damping = np.zeros((1, 2, len(scale)))
    damping[0, 0, -1] = 1.0  # maxima of the damping are located along a branch
    return Equations(
        _core.Modes(sector, re, im, weight, scale), Mode(driven, stuck, float(reference)), driven.layout,
        driven.response_rows, Rows(damping), InAmplitude(n_mean, float(reference)), scale, driven.n_points, driven.work,
    )  # fmt: skip


# ---- Continuation over amplitude ----


RIGID = 1e-6
"""Relative frequency, with respect to the highest one without contact, below which motions are rigid."""
REACH = 1e-6
"""Relative margin of a branch beyond the highest of given amplitudes."""
FLAT = 1e-6
"""Least relative height of a maximum of the damping above its neighbours."""


@one_thread
def nonlinear_mode(
    problem: Problem,
    preload: float,
    mode: int = 1,
    amplitude: tuple[float, float] = (1e-6, 1e-3),
    *,
    options: ContinuationOptions | None = None,
    progress: bool | None = None,
) -> NonlinearMode:
    """See :meth:`bdamper.Study.nonlinear_mode`."""
    preload, mode = problem.check_preload(preload), validation.integer("mode", mode, least=1)
    low, high = validation.interval("amplitude", amplitude, "m")
    validation.instance("options", options or ContinuationOptions(), ContinuationOptions)
    meter = CostMeter()
    state = problem.at(preload).equilibrium
    system, omega = mode_system(problem, preload, mode, low)
    meter.watch(system)
    branch = _Branch(system, (low, high), options or ContinuationOptions())
    with progress_bar(
        shows_progress(progress), branch.low, branch.high, "nonlinear mode"
    ) as branch.on_point:
        branch.run(state, omega)
    meter.count(
        sum(p.path.iterations for p in branch.pieces),
        sum(p.path.failed_steps for p in branch.pieces),
    )
    points = in_order(branch.pieces)
    y = np.array([p.y for p, _ in points]).reshape(len(points), system.n_unknowns + 1)
    u, correlation = system.structure.motion(y), _correlation(system, y)
    status, reason = _ending(branch, y, correlation, mode)
    if len(u):
        warn_of_small_slip(problem, system.structure.driven, u[np.argmin(y[:, -1])])
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


def mode_system(
    problem: Problem, preload: float, mode: int, low: float
) -> tuple[Equations[Mode], float]:
    """Return the equations of a mode for response amplitudes from ``low`` (m), and its stuck frequency (rad/s)."""
    case = problem.at(preload)
    driven = case.equations
    free, alone = driven.structure.linear.modes(None)
    elastic = np.flatnonzero(free > RIGID * free[-1])
    mode = validation.integer("mode", mode, least=1, most=len(elastic))
    frequencies, shapes = driven.structure.linear.modes(case.stuck_springs())
    across = np.abs((driven.structure.bases[1].mass * alone[:, elastic[mode - 1]].conj()) @ shapes)
    k = int(np.argmax(across))
    row, shape = driven.response_rows[1], shapes[:, k]
    if not abs(row @ shape) > 1e-6 * float(np.linalg.norm(row) * np.linalg.norm(shape)):
        raise SettingError(
            f"response: mode {mode} does not move this location in this direction; choose another one"
        )
    # the start may need smaller motions than the lowest amplitude, if contacts slip there
    descent = 1e-4
    return mode_equations(driven, float(frequencies[k]), shape, descent * low), float(
        frequencies[k]
    )


def mode_points(
    problem: Problem, preload: float, mode: int, amplitude: NDArray, low: float
) -> tuple[Equations[Mode], list[Correction | None]]:
    """Return the equations of a mode, and its motions at response amplitudes (m) above ``low``, or None without success."""
    system, omega = mode_system(problem, preload, mode, low)
    branch = _Branch(system, (low, (1.0 + REACH) * float(amplitude.max())), ContinuationOptions())
    branch.run(problem.at(preload).equilibrium, omega)
    y = np.array([p.y for p in branch.pieces[0].path.points]).reshape(-1, system.n_unknowns + 1)
    out: list[Correction | None] = []
    for parameter in np.log(amplitude / system.structure.reference):
        k = np.flatnonzero((y[:-1, -1] - parameter) * (y[1:, -1] - parameter) <= 0.0)
        c = None
        if len(k):
            before, after = y[k[0]], y[k[0] + 1]
            c = branch.at(
                before + (parameter - before[-1]) / (after[-1] - before[-1]) * (after - before),
                float(parameter),
            )
        out.append(c if c is not None and c.status == OK else None)
    return system, out


class _Branch:
    """Branch through the stuck mode between two amplitudes (m)."""

    def __init__(
        self, system: Equations[Mode], amplitude: tuple[float, float], options: ContinuationOptions
    ) -> None:
        self.system = system.within(options.budget or evaluation_budget(system))
        self.options = options
        self.low, self.high = (float(np.log(a / system.structure.reference)) for a in amplitude)
        self.pieces: list[Piece] = []
        self.linear_to = np.nan
        self.on_point: Callable[[Correction], None] | None = None

    def run(self, state: PreloadState, omega: float) -> None:
        """Follow the branch from its start, and from the upper amplitude if the branch does not reach it."""
        start = self._start(state, omega)
        if start is None:
            self.pieces.append(
                Piece(Path((), NOT_FOUND, "no motion at the lowest amplitude", 0, 0), True)
            )
            return
        ahead = self._linear(start)
        if ahead.y[-1] >= self.high:
            last = self.at(start.y, self.high)
            points = [replace(c, kind="end") for c in (start, last)]
            reason = f"reached {self.system.measure.place(self.high)}, where nothing slips yet"
            self.pieces.append(Piece(Path(tuple(points), COMPLETE, reason, 0, 0), True))
            return
        limits = float(start.y[-1]), self.high
        path = follow(self.system, ahead.y, limits, options=self.options, on_point=self.on_point)
        if ahead is not start:
            path = replace(path, points=(replace(start, kind="end"), *path.points))
        self.pieces.append(Piece(path, True))
        if path.status != COMPLETE and path.points and not self.system.spent:
            self._from_above(path.points[-1].y)

    def _scale(self, y: NDArray) -> NDArray:
        return self.system.units(y, 1.0)

    def at(self, y: NDArray, parameter: float) -> Correction:
        """Solve by Newton's method with line search from a point at another amplitude."""
        y = np.append(y[:-1], parameter)
        return self.system.correct_at(
            y[:-1], parameter, self._scale(y), self.options.tolerance, 40, True
        )

    def _start(self, state: PreloadState, omega: float) -> Correction | None:
        """Return the motion at the lowest amplitude, or at a smaller amplitude if Newton's method fails there.

        The result is None if it fails at all amplitudes.
        """
        guess = self.system.structure.start(
            state.q, omega, self.system.structure.reference * float(np.exp(self.low))
        )
        for lower in np.log([1.0, 0.1, 0.01, 0.002]):
            solution = self.at(guess, self.low + float(lower))
            if solution.status == OK:
                return solution
        return None

    def _linear(self, start: Correction) -> Correction:
        """Return the last point of the linear range, slightly before slip or separation begins; or the start."""

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
        stuck_part = 0.9  # continuation begins at this share of the amplitude of first slip
        begin = most if most == self.high else most + float(np.log(stuck_part))
        return self.at(start.y, begin) if begin > start.y[-1] else start

    def _from_above(self, last: NDArray) -> None:
        """Follow the branch at the largest amplitude downward."""
        solution = self.at(last, self.high)
        if solution.status == OK:
            path = follow(
                self.system, solution.y, (self.low, self.high), up=False, options=self.options
            )
            self.pieces.append(Piece(path, False, 1))


def _correlation(system: Equations[Mode], y: NDArray) -> NDArray:
    """Return the MAC (n,) of the first harmonic and the stuck mode, weighted with the mass."""
    a, mass = system.layout.amplitudes(y, 1), system.structure.basis.mass
    across = np.abs(a @ (mass * system.structure.stuck.conj())) ** 2
    return np.asarray(
        across / ((np.abs(a) ** 2 @ mass) * (np.abs(system.structure.stuck) ** 2 @ mass))
    )


def _scales_to(problem: Problem, system: Equations[Mode], u: NDArray, preload: float) -> float:
    """Return the highest preload (N) to which motions u can be scaled; 0 if they cannot.

    Without interference, cubic springs and constant forces the contact is homogeneous as long as no gap closes in a cycle.
    """
    static = problem.static_system(preload)
    if preload == 0.0 or problem.settings.residual_slip_std or np.any(static.cubic):
        return 0.0
    if (
        np.any(static.n0 > 0.0)
        or np.any(static.constant_force)
        or np.any(problem.displacement_by_rotation)
    ):
        return 0.0
    gapped = static.n0 < 0.0
    gap = -static.n0[gapped] / static.kn[gapped]
    theta = np.linspace(0.0, TWO_PI, 64 * system.n_harmonics, endpoint=False)
    closing = (system.structure.driven.contact(one)[0][gapped, 2] for one in u)
    used = [(at_angles(v, theta).max(axis=1) / gap).max(initial=0.0) for v in closing]
    most = max(used, default=1.0)
    return 0.0 if most >= 1.0 else preload / most if most > 0.0 else float("inf")


def _kinds(points: list[tuple[Correction, Piece]], damping: NDArray) -> tuple[str, ...]:
    """Return the kinds of the points; a flat maximum of the damping counts as regular."""
    around = np.concatenate([damping[:1], damping, damping[-1:]])
    low = np.maximum(around[:-2], around[2:]) >= (1.0 - FLAT) * damping
    return tuple(
        "regular" if p.kind == "maximum" and flat else p.kind for (p, _), flat in zip(points, low)
    )


def _ending(branch: _Branch, y: NDArray, correlation: NDArray, mode: int) -> tuple[str, str]:
    """Return status and reason of the mode."""
    path, place = branch.pieces[0].path, branch.system.measure.place
    if not path.points:
        return NOT_FOUND, path.reason
    reason = f"{path.status}: {path.reason}" if path.status != COMPLETE else path.reason
    apart = len(branch.pieces) > 1
    reason += f"; another branch from {place(branch.high)} down" if apart else ""
    familiar = 0.5  # least correlation of the same mode with the stuck mode
    overdamped = (
        0.5  # damping ratio above which the periodic motion does not represent a decaying one
    )
    foreign, over = correlation < familiar, y[:, -2] > overdamped
    if foreign.any():
        at = y[int(np.argmax(foreign))]
        reason += f"; beyond {place(at[-1])} the motion is no longer that of mode {mode}: it interacts with another mode"
    if over.any():
        at = y[int(np.argmax(over))]
        reason += f"; damping is above {overdamped:g} from {place(at[-1])} on, too high for a periodic approximation"
    whole = path.status == COMPLETE and not foreign.any() and not over.any()
    return COMPLETE if whole else INCOMPLETE, reason
