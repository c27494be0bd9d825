"""Nonlinear modes: frequency and damping of free vibration as functions of its amplitude.

The equations describe a sector without excitation, with frequency and damping as unknowns
(``csrc/balance/nonlinear_mode.c``). A point ``y = (Q_0, P, omega, zeta, ln(A/A_0))`` contains the
mean, the vibration ``P`` scaled to the response amplitude ``A_0``, the angular frequency, the modal
damping ratio and the response amplitude ``A``.

At small amplitudes nothing slips or opens, and the mode is exactly the linear mode of stuck
contact: this part needs no steps. From there the branch is followed by arclength continuation,
because the amplitude may decrease along it if a harmonic resonates with another mode. If the branch
does not reach the upper amplitude, another branch is followed downward from there.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from bdamper import _core
from bdamper.contact.preload_state import PreloadState
from bdamper.harmonic_balance.checks import warn_of_small_slip
from bdamper.harmonic_balance.contact_cycle import at_angles
from bdamper.harmonic_balance.equations import OK, Correction, Equations, Rows, norm2
from bdamper.harmonic_balance.problem import Problem
from bdamper.harmonic_balance.sector import SectorData
from bdamper.model.kinematics import HarmonicBasis
from bdamper.response.branches import Piece, evaluation_budget, in_order
from bdamper.response.continuation import TWO_PI, follow
from bdamper.response.events import ContinuationOptions, Path
from bdamper.util import validation
from bdamper.util.display import InContact, Result
from bdamper.util.errors import COMPLETE, INCOMPLETE, NOT_FOUND, SettingError
from bdamper.util.formatting import amount, percent, short_repr, span
from bdamper.util.progress import Cost, CostMeter, one_thread, progress_bar, shows_progress
from bdamper.util.records import Data
from bdamper.util.statement import Row, Statement
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

OMEGA, ZETA, PARAMETER = -3, -2, -1
"""Indices of angular frequency, damping ratio and ln(A/A_0) in a point ``y``; the unknowns of the
motion precede them.
"""


@short_repr
@dataclass(frozen=True)
class NonlinearMode(
    Result,
    InContact,
    FrequencySeries,
    Tabular,
    Recorded,
    Storable,
    kind="bdamper-nonlinear-mode",
):
    """Free vibration of a structure with friction: frequency and damping as functions of amplitude.

    Every point is a converged periodic motion. ``plot`` draws frequency and damping against
    amplitude (:func:`bdamper.plot.plot_nonlinear_mode`).

    Parameters
    ----------
    frequency, damping_ratio : (n,) float, Hz and 1
        Frequency, and the ratio of the negative damping proportional to mass that would sustain the
        motion.
    harmonics : (n, n_harmonics + 1) complex, m
        Harmonics of the response; the first column is the mean.
    unknowns : (n, n_unknowns) float
        Modal coordinates (kg^1/2 m): mean, then cosine and sine amplitudes of each harmonic.
    correlation : (n,) float
        MAC of the first harmonic with the mode of stuck contact.
    shares : (n, 3) float
        Fractions of the cycle in stick, slip and separation, mean over the friction points.
    residual, branch : (n,) float and int
    point_kind : tuple of str
        "regular", "fold" (turning point of the amplitude), "maximum" (of the damping), "end" or
        "drift".
    linear_to : float, m
        Amplitude up to which no point slips or opens; NaN if a point slips or opens at the lowest
        amplitude.
    preload, mode : float (N) and int
    scales_to : float, N
        Highest preload to which the curve can be scaled (:meth:`at_preload`); 0 if it cannot be
        scaled.
    richer : int
        Highest harmonic of a second computation that was compared; 0 if there was none.
    damping_error, frequency_error : float
        Largest relative differences of the second computation at equal amplitudes.  Differences of
        the damping are relative to the highest damping ratio.  NaN if unknown.
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
    # without a default, unlike that of the base class
    status: str = field()
    reason: str = field()
    cost: Cost
    richer: Annotated[int, Data(derived=True)] = 0
    damping_error: Annotated[float, Data(derived=True)] = float("nan")
    frequency_error: Annotated[float, Data(derived=True)] = float("nan")
    _summary_fields = ("mode", "preload", "status", "folds", "linear_to", "scales_to")

    @property
    def folds(self) -> NDArray:
        """Indices (k,) of the turning points of the amplitude."""
        return np.array([i for i, kind in enumerate(self.point_kind) if kind == "fold"], int)

    def at(self, amplitude: float) -> list[tuple[float, float]]:
        """Return frequency (Hz) and damping ratio of all motions with an amplitude (m).

        They are in the order of the branch. Values between points are interpolated linearly over
        the logarithm of the amplitude.
        """
        amplitude = validation.number("amplitude", amplitude, above=0.0, unit="m")
        distance = np.log(self.amplitude / amplitude)
        # each crossing lies between point i and the next one; a point with exactly this amplitude
        # counts as the beginning of an interval, not as its end
        crosses = (distance[:-1] * distance[1:] <= 0.0) & (distance[1:] != 0.0)
        same_branch = self.branch[:-1] == self.branch[1:]
        i = np.flatnonzero(crosses & same_branch)
        share = distance[i] / (distance[i] - distance[i + 1])

        def interpolated(values: NDArray) -> list[float]:
            return (values[i] + share * (values[i + 1] - values[i])).tolist()

        return list(zip(interpolated(self.frequency), interpolated(self.damping_ratio)))

    def at_preload(self, preload: float) -> NonlinearMode:
        """Return the mode at another preload, with displacements and forces scaled in proportion.

        Raises
        ------
        SettingError
            If the mode does not scale to this preload, because of closing gaps, interference, cubic
            springs or constant forces.
        """
        preload = validation.number("preload", preload, above=0.0, unit="N")
        if preload > self.scales_to:
            expected = "a mode with displacements in proportion to the preload"
            found = (
                "one without preload, or with interference, cubic springs, constant forces or a "
                "gap that closes"
            )
            if self.scales_to:
                expected = f"at most {self.scales_to:.6g} N, because a gap closes above"
                found = f"{preload:.6g} N"
            raise SettingError(
                f"preload: expected {expected}, found {found}; compute the mode at this preload "
                "with study.nonlinear_mode"
            )
        factor = preload / self.preload
        return replace(
            self,
            preload=preload,
            harmonics=factor * self.harmonics,
            unknowns=factor * self.unknowns,
            linear_to=factor * self.linear_to,
        )

    def _statement(self) -> Statement:
        if not len(self):
            return Statement([f"No motion of mode {self.mode} was found: {self.reason}"])
        highest = int(np.argmax(self.damping_ratio))
        at_end = highest in (0, len(self) - 1)
        damping = amount(100.0 * self.damping_ratio[highest], "%")
        sources = "contacts and modal damping"
        subject = f"mode {self.mode}, preload {amount(self.preload, 'N')}"
        place = amount(self.amplitude[highest], "m")
        frequency = f"{amount(self.frequency[highest], 'Hz')} at the largest damping"
        edge = "largest damping at an end" if at_end else "range of the computed mode"
        rows = [
            Row("Amplitude", span(self.amplitude.min(), self.amplitude.max(), "m"), edge),
            Row("Frequency", span(self.frequency.min(), self.frequency.max(), "Hz"), frequency),
        ]
        if np.isfinite(self.linear_to):
            rows.append(Row("Linear", f"to {amount(self.linear_to, 'm')}", "all contacts stick"))
        remarks = []
        if not self.complete:
            remarks.append(f"The mode is {self.status}: {self.reason}")
        verdict = f"Largest damping ratio {damping} ({sources}) at {place}: {subject}"
        return Statement([verdict], rows, self._checks(), remarks)

    def _checks(self) -> list[Row]:
        """Return the row of the comparison with more harmonics, if there was one."""
        if not self.richer:
            return []
        harmonics = f"with harmonics up to {self.richer}"
        if np.isnan(self.damping_error):
            return [Row("More harmonics", "uncertain", f"no common amplitude {harmonics}")]
        outcome = "pass" if self.damping_error <= SETTLED else "uncertain"
        damping = f"damping differs by {percent(self.damping_error)} of the largest"
        frequency = f"frequency by {percent(self.frequency_error)}"
        return [Row("More harmonics", outcome, f"{damping}, {frequency}, {harmonics}")]

    def _compared_with(self, other: NonlinearMode, richer: int) -> NonlinearMode:
        """Return this mode with its differences from one with more harmonics."""
        damping_differences = []
        frequency_differences = []
        for own_amplitude, own_frequency, own_damping in zip(
            self.amplitude, self.frequency, self.damping_ratio
        ):
            motions = other.at(own_amplitude)
            if not motions:
                continue
            # where the branch folds there are several motions; the nearest in frequency counts
            distances = [abs(frequency - own_frequency) for frequency, _ in motions]
            other_frequency, other_damping = motions[int(np.argmin(distances))]
            frequency_differences.append(abs(other_frequency / own_frequency - 1.0))
            damping_differences.append(abs(other_damping - own_damping))
        if not damping_differences:
            return replace(self, richer=richer)
        # a mode without any loss has ratios of rounding size
        largest = max(float(np.max(np.abs(self.damping_ratio))), 1e-9)
        return replace(
            self,
            richer=richer,
            damping_error=max(damping_differences) / largest,
            frequency_error=max(frequency_differences),
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

    SHIFT = 0.05
    """Relative change of frequency that counts as much as the complete vibration."""
    DAMPING = 0.1
    """Change of damping ratio that counts as much as the complete vibration."""

    def vibration(self, y: NDArray) -> float:
        """Return the norm of the harmonics."""
        harmonics_at_reference = y[self.n_mean : OMEGA]
        return norm2(harmonics_at_reference) * float(np.exp(y[PARAMETER]))

    def units(self, y: NDArray, vibration: float, width: float) -> NDArray:
        """Return the units (n_unknowns + 1,) of mean, vibration, frequency, damping and
        ln(amplitude).

        ``vibration`` is the norm of the harmonics.  The logarithm, the parameter, has the unit 1;
        ``width`` has no effect.
        """
        scale = np.ones(len(y))
        mean = y[: self.n_mean]
        scale[: self.n_mean] = max(norm2(mean), vibration)
        # the vibration in y has the reference amplitude
        scale[self.n_mean : OMEGA] = vibration * float(np.exp(-y[PARAMETER]))
        scale[OMEGA] = self.SHIFT * y[OMEGA]
        scale[ZETA] = self.DAMPING
        return scale

    def place(self, parameter: float) -> str:
        """Return the response amplitude at a value of the parameter as text."""
        return f"{self.reference * np.exp(parameter):.6g} m"


@dataclass(frozen=True, eq=False)
class Mode:
    """Periodic motions sustained by a force proportional to mass times velocity.

    Two linear equations define the amplitude of the first harmonic of the response and its phase,
    which is zero.

    Parameters
    ----------
    driven : Equations
        Equations of one structure at one preload, with static forces only.
    stuck : (n_modes,) complex
        Approximate motion of the mode in the first harmonic, in modal coordinates, at the reference
        amplitude.
    reference : float, m
        Response amplitude A_0 below all computed amplitudes, so that the parameter is positive.
    """

    driven: Equations[SectorData]
    stuck: NDArray
    reference: float

    @property
    def basis(self) -> HarmonicBasis:
        """Modes of the first harmonic."""
        return self.driven.structure.bases[1]

    def start(self, mean: NDArray, omega: float, amplitude: float) -> NDArray:
        """Return the linear mode at a response amplitude (m) as an initial guess ``y``.

        ``mean`` contains the modal coordinates at rest, and ``omega`` (rad/s) is the frequency.
        """
        # damping ratio of the shape: its modal damping over 2 omega times its modal mass
        squared_shape = np.abs(self.stuck) ** 2
        modal_damping = squared_shape @ self.basis.damping
        modal_mass = squared_shape @ self.basis.mass
        zeta = float(modal_damping / modal_mass) / (2.0 * omega)
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
        first_harmonic = self.driven.response(u)[1]
        ratio = float(abs(first_harmonic)) / self.reference
        y = np.append(u, [omega, zeta, np.log(ratio)])
        # harmonics in y are scaled to the reference amplitude; the mean is not
        y[self.driven.n_mean : OMEGA] /= ratio
        return y

    def motion(self, y: NDArray) -> NDArray:
        """Return the unknowns (..., n_unknowns) of the driven equations at points."""
        u = np.array(y[..., :OMEGA])
        # harmonics in y are scaled to the reference amplitude; the mean is not
        amplitude_ratio = np.exp(y[..., PARAMETER:])
        u[..., self.driven.n_mean :] *= amplitude_ratio
        return u


def mode_equations(
    driven: Equations[SectorData], omega: float, shape: NDArray, reference: float
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
    sector = driven.core
    assert isinstance(sector, _core.SectorEquations)
    n_mean = driven.n_mean
    row = np.asarray(driven.response_rows[1])
    # scaled so that the response is the reference amplitude with phase zero
    stuck = np.asarray(shape) * (reference / (row @ shape))
    real, imaginary = driven.layout.parts(row / reference)
    # inertia forces have the size one in the scaled residual; the last two rows are the equations
    # of amplitude and phase
    weight = omega**2 * norm2(np.abs(stuck))
    scale = np.append(driven.row_scale, [1.0 / weight, 1.0 / weight])
    scale[n_mean:-2] = 1.0 / weight
    # maxima of this quantity are located along a branch: the damping ratio, which is the last
    # unknown, as the real part of one row (1, 2 parts, n_unknowns)
    damping = np.zeros((1, 2, len(scale)))
    damping[0, 0, -1] = 1.0
    return Equations(
        _core.Modes(sector, real, imaginary, weight, scale),
        Mode(driven, stuck, float(reference)),
        driven.layout,
        driven.response_rows,
        Rows(damping),
        InAmplitude(n_mean, float(reference)),
        scale,
        driven.n_points,
        driven.work,
    )


# ---- Continuation over amplitude ----


RIGID = 1e-6
"""Relative frequency, with respect to the highest one without contact, below which motions are
rigid.
"""
REACH = 1e-6
"""Relative margin of a branch beyond the highest of given amplitudes."""
SETTLED = 0.05
"""Largest difference of the damping ratio, relative to the highest one, that counts as settled."""
FLAT = 1e-6
"""Least relative height of a maximum of the damping above its neighbours."""


@one_thread
def nonlinear_mode(
    problem: Problem,
    preload: float,
    mode: int = 1,
    amplitude: tuple[float, float] = (1e-6, 1e-3),
    *,
    more_harmonics: int = 0,
    options: ContinuationOptions | None = None,
    progress: bool | None = None,
) -> NonlinearMode:
    """See :meth:`bdamper.Study.nonlinear_mode`."""
    more_harmonics = validation.integer("more_harmonics", more_harmonics, least=0)
    richer = _with_more_harmonics(problem, more_harmonics)
    found = _mode(problem, preload, mode, amplitude, options, progress)
    if not more_harmonics:
        return found
    second = _mode(richer, preload, mode, amplitude, options, progress)
    compared = found._compared_with(second, int(richer.harmonic_numbers[-1]))
    return replace(compared, cost=found.cost + second.cost)


def _with_more_harmonics(problem: Problem, more: int) -> Problem:
    """Return the problem with a higher highest harmonic; odd harmonics alone stay odd."""
    if not more:
        return problem
    numbers = [int(n) for n in problem.harmonic_numbers]
    highest = numbers[-1] + more
    odd_alone = len(numbers) > 1 and all(n % 2 == 1 for n in numbers)
    if odd_alone:
        return problem.replace(harmonics=range(1, highest + 1, 2))
    return problem.replace(harmonics=highest)


def _mode(
    problem: Problem,
    preload: float,
    mode: int,
    amplitude: tuple[float, float],
    options: ContinuationOptions | None,
    progress: bool | None,
) -> NonlinearMode:
    """Compute the mode with the harmonics of a problem."""
    preload = problem.check_preload(preload)
    mode = validation.integer("mode", mode, least=1)
    low, high = validation.interval("amplitude", amplitude, "m")
    applied_options = options or ContinuationOptions()
    validation.instance("options", applied_options, ContinuationOptions)
    meter = CostMeter()
    state = problem.at(preload).rest.equilibrium
    system, omega = mode_system(problem, preload, mode, low)
    meter.watch(system)
    branch = _Branch(system, (low, high), applied_options)
    with progress_bar(
        shows_progress(progress), branch.low, branch.high, "nonlinear mode"
    ) as branch.on_point:
        branch.run(state, omega)
    for piece in branch.pieces:
        meter.count(piece.path.iterations, piece.path.failed_steps)
    points = in_order(branch.pieces)
    # (n_points, n_unknowns + 1), also without any point
    y = np.array([point.y for point, _ in points]).reshape(len(points), system.n_unknowns + 1)
    u = system.structure.motion(y)
    shares = np.array([point.shares for point, _ in points]).reshape(-1, 3)
    correlation = _correlation(system, y)
    status, reason = _ending(branch, y, correlation, mode)
    if len(u):
        lowest = int(np.argmin(y[:, PARAMETER]))
        warn_of_small_slip(problem, system.structure.driven, u[lowest])
    return NonlinearMode(
        frequency=y[:, OMEGA] / TWO_PI,
        damping_ratio=y[:, ZETA],
        harmonics=system.structure.driven.response(u),
        unknowns=u,
        correlation=correlation,
        shares=shares,
        residual=np.array([point.residual for point, _ in points]),
        branch=np.array([piece.branch for _, piece in points], int),
        point_kind=_kinds(points, y[:, ZETA]),
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
    """Return the equations of a mode and its stuck frequency (rad/s).

    The response amplitudes begin at ``low`` (m).
    """
    case = problem.at(preload).rest
    driven = case.equations
    linear = driven.structure.linear
    free_frequencies, free_shapes = linear.modes(contact=None)
    # the last frequency is the highest
    elastic = np.flatnonzero(free_frequencies > RIGID * free_frequencies[-1])
    mode = validation.integer("mode", mode, least=1, most=len(elastic))
    free_shape = free_shapes[:, elastic[mode - 1]]
    # the stuck mode most similar to the free mode
    frequencies, shapes = linear.modes(case.stuck_springs())
    mass = driven.structure.bases[1].mass
    # similarity of each stuck mode, by the product weighted with the mass
    product = np.abs((mass * free_shape.conj()) @ shapes)
    nearest = int(np.argmax(product))
    frequency = float(frequencies[nearest])
    shape = shapes[:, nearest]
    row = driven.response_rows[1]
    largest_response = float(np.linalg.norm(row) * np.linalg.norm(shape))
    if not abs(row @ shape) > 1e-6 * largest_response:
        raise SettingError(
            f"response: mode {mode} does not move this location in this direction; choose another "
            "one"
        )
    # the start may need smaller motions than the lowest amplitude, if contacts slip there
    descent = 1e-4
    return mode_equations(driven, frequency, shape, descent * low), frequency


def mode_points(
    problem: Problem, preload: float, mode: int, amplitude: NDArray, low: float
) -> tuple[Equations[Mode], list[Correction | None]]:
    """Return the equations of a mode, and its motions at response amplitudes (n,) above ``low``
    (m).

    A motion that was not found is None.
    """
    system, omega = mode_system(problem, preload, mode, low)
    high = (1.0 + REACH) * float(amplitude.max())
    branch = _Branch(system, (low, high), ContinuationOptions())
    branch.run(problem.at(preload).rest.equilibrium, omega)
    points = branch.pieces[0].path.points
    y = np.array([point.y for point in points]).reshape(-1, system.n_unknowns + 1)
    motions: list[Correction | None] = []
    for parameter in np.log(amplitude / system.structure.reference):
        motions.append(_motion_between(branch, y, parameter))
    return system, motions


def _motion_between(branch: _Branch, y: NDArray, parameter: float) -> Correction | None:
    """Return the first motion at a parameter between two points (n, n_unknowns + 1) of a branch.

    It is None if the branch does not reach the parameter, or if Newton's method fails.
    """
    distance = y[:, PARAMETER] - parameter
    # each crossing lies between this point and the next one
    crossings = np.flatnonzero(distance[:-1] * distance[1:] <= 0.0)
    if not len(crossings):
        return None
    before = y[crossings[0]]
    after = y[crossings[0] + 1]
    share = (parameter - before[PARAMETER]) / (after[PARAMETER] - before[PARAMETER])
    solution = branch.at(before + share * (after - before), float(parameter))
    return solution if solution.status == OK else None


class _Branch:
    """Branch through the stuck mode between two amplitudes (m)."""

    def __init__(
        self, system: Equations[Mode], amplitude: tuple[float, float], options: ContinuationOptions
    ) -> None:
        self.system = system.within(options.budget or evaluation_budget(system))
        self.options = options
        low, high = amplitude
        self.low = float(np.log(low / system.structure.reference))
        self.high = float(np.log(high / system.structure.reference))
        self.pieces: list[Piece] = []
        self.linear_to = np.nan
        self.on_point: Callable[[Correction], None] | None = None

    def run(self, state: PreloadState, omega: float) -> None:
        """Follow the branch from its start.

        If it does not reach the upper amplitude, another branch is followed downward from there.
        """
        start = self._start(state, omega)
        if start is None:
            path = Path(
                points=(),
                status=NOT_FOUND,
                reason="no motion at the lowest amplitude",
                iterations=0,
                failed_steps=0,
            )
            self.pieces.append(Piece(path, up=True))
            return
        # the linear range needs no steps
        ahead = self._linear(start)
        if ahead.y[PARAMETER] >= self.high:
            last = self.at(start.y, self.high)
            points = replace(start, kind="end"), replace(last, kind="end")
            reason = (
                f"reached {self.system.measure.place(self.high)}, where no contact point slips yet"
            )
            path = Path(points, COMPLETE, reason, iterations=0, failed_steps=0)
            self.pieces.append(Piece(path, up=True))
            return
        limits = float(start.y[PARAMETER]), self.high
        path = follow(self.system, ahead.y, limits, options=self.options, on_point=self.on_point)
        if ahead is not start:
            path = replace(path, points=(replace(start, kind="end"), *path.points))
        self.pieces.append(Piece(path, up=True))
        if path.status != COMPLETE and path.points and not self.system.spent:
            self._from_above(path.points[-1].y)

    def at(self, y: NDArray, parameter: float) -> Correction:
        """Solve by Newton's method with line search from a point at another amplitude.

        ``parameter`` is the logarithm of the wanted amplitude over the reference.
        """
        y = np.append(y[:PARAMETER], parameter)
        scale = self.system.units(y, width=1.0)
        return self.system.correct_at(
            y[:PARAMETER],
            parameter,
            scale,
            tolerance=self.options.tolerance,
            max_iterations=40,
            line_search=1,
        )

    def _start(self, state: PreloadState, omega: float) -> Correction | None:
        """Return the motion at the lowest amplitude.

        If Newton's method fails there, it is a motion at a smaller amplitude; None if it always
        fails.
        """
        structure = self.system.structure
        amplitude = structure.reference * float(np.exp(self.low))
        guess = structure.start(state.q, omega, amplitude)
        # the linear mode is a better guess the smaller the motion
        for fraction in (1.0, 0.1, 0.01, 0.002):
            solution = self.at(guess, self.low + float(np.log(fraction)))
            if solution.status == OK:
                return solution
        return None

    def _linear(self, start: Correction) -> Correction:
        """Return the last point of the linear range, slightly before slip or separation begins.

        Without a linear range it is the start.
        """

        def is_linear(parameter: float) -> bool:
            """Return whether the motion of the start, at another amplitude, is a solution."""
            y = np.append(start.y[:PARAMETER], parameter)
            residual = np.empty(self.system.n_unknowns)
            self.system.core.evaluate(y, residual)
            largest = float(np.abs(residual * self.system.row_scale).max())
            return largest <= self.options.tolerance

        low = float(start.y[PARAMETER])
        end = self.high
        # a range of less than 0.1 % of the amplitude does not count
        if not is_linear(low + 1e-3):
            return start
        if not is_linear(end):
            # bisection between a linear and a nonlinear amplitude
            while end - low > 1e-12:
                middle = 0.5 * (low + end)
                if is_linear(middle):
                    low = middle
                else:
                    end = middle
        self.linear_to = float(self.system.structure.reference * np.exp(end))
        begin = end
        if end != self.high:
            # continuation begins at this share of the amplitude of first slip
            stuck_part = 0.9
            begin = end + float(np.log(stuck_part))
        if begin > start.y[PARAMETER]:
            return self.at(start.y, begin)
        return start

    def _from_above(self, last: NDArray) -> None:
        """Follow the branch at the largest amplitude downward."""
        solution = self.at(last, self.high)
        if solution.status != OK:
            return
        path = follow(
            self.system, solution.y, (self.low, self.high), up=False, options=self.options
        )
        self.pieces.append(Piece(path, up=False, branch=1))


def _correlation(system: Equations[Mode], y: NDArray) -> NDArray:
    """Return the MAC (n,) of the first harmonic and the stuck mode, weighted with the mass.

    ``y`` (n, n_unknowns + 1) contains the points of the branch.
    """
    first_harmonic = system.layout.amplitudes(y, harmonic=1)
    mass = system.structure.basis.mass
    stuck = system.structure.stuck
    product = np.abs(first_harmonic @ (mass * stuck.conj())) ** 2
    norm = np.abs(first_harmonic) ** 2 @ mass
    stuck_norm = np.abs(stuck) ** 2 @ mass
    return np.asarray(product / (norm * stuck_norm))


def _scales_to(problem: Problem, system: Equations[Mode], u: NDArray, preload: float) -> float:
    """Return the highest preload (N) to which motions u can be scaled; 0 if they cannot.

    Without interference, cubic springs and constant forces the contact is homogeneous as long as no
    gap closes in a cycle.
    """
    static = problem.static_system(preload)
    if preload == 0.0 or problem.settings.residual_slip_std or np.any(static.cubic):
        return 0.0
    if np.any(static.n0 > 0.0) or np.any(static.constant_force):
        return 0.0
    if np.any(problem.displacement_by_rotation):
        return 0.0
    # a negative force of a point at rest is a gap times the stiffness
    open_points = static.n0 < 0.0
    gap = -static.n0[open_points] / static.kn[open_points]
    theta = np.linspace(0.0, TWO_PI, 64 * system.n_harmonics, endpoint=False)
    # largest fraction of a gap that each motion closes
    closed_fractions = []
    for motion in u:
        # coefficients (n_points, 3, 2 H + 1) of the displacement; the normal direction is the last
        displacement, _, _ = system.structure.driven.contact(motion)
        normal = displacement[open_points, 2]
        closest = at_angles(normal, theta).max(axis=1)
        closed_fractions.append((closest / gap).max(initial=0.0))
    largest = max(closed_fractions, default=1.0)
    if largest >= 1.0:
        return 0.0
    if largest > 0.0:
        # the motion grows with the preload and then closes the complete gap
        return preload / largest
    return float("inf")


def _kinds(points: list[tuple[Correction, Piece]], damping: NDArray) -> tuple[str, ...]:
    """Return the kinds of the points; a flat maximum of the damping (n,) counts as regular."""
    kinds = []
    # the first and the last point are their own neighbours
    with_neighbours = np.concatenate([damping[:1], damping, damping[-1:]])
    higher_neighbour = np.maximum(with_neighbours[:-2], with_neighbours[2:])
    flat = higher_neighbour >= (1.0 - FLAT) * damping
    for (point, _), is_flat in zip(points, flat):
        kinds.append("regular" if point.kind == "maximum" and is_flat else point.kind)
    return tuple(kinds)


def _remedy(branch: _Branch) -> str:
    """Return what to do about a branch that folds and does not reach the highest amplitude.

    Where the motion is symmetric, even harmonics are zero. Branches of motions that are not
    symmetric begin on it where an even harmonic resonates, and the path may take one.
    """
    system = branch.system
    points = branch.pieces[0].path.points
    folds = [i for i, point in enumerate(points) if point.kind == "fold"]
    if not folds:
        return ""
    before = points[max(folds[0] - 1, 0)].y
    # norm of each harmonic with unknowns; 0 is the mean
    sizes = {}
    for harmonic, n_modes in enumerate(system.layout.n_mode):
        if harmonic > 0 and n_modes > 0:
            sizes[harmonic] = norm2(np.abs(system.layout.amplitudes(before, harmonic)))
    even = [size for harmonic, size in sizes.items() if harmonic % 2 == 0]
    vanishing = 1e-6
    if even and max(even) <= vanishing * sizes[1]:
        return (
            "; the mode has no even harmonics, and the path left it: compute it with "
            f"harmonics=tuple(range(1, {max(sizes) + 1}, 2))"
        )
    return (
        "; a harmonic resonates with another mode: compute it with other harmonics, or with "
        f"amplitudes below {system.measure.place(before[PARAMETER])}"
    )


def _parameter_at(parameter: NDArray, values: NDArray, limit: float, beyond: int) -> float:
    """Return the parameter at which values (n,) reach a limit, interpolated before point
    ``beyond``, the first point beyond the limit.
    """
    if beyond == 0:
        return float(parameter[0])
    before = beyond - 1
    share = (limit - values[before]) / (values[beyond] - values[before])
    return float(parameter[before] + share * (parameter[beyond] - parameter[before]))


def _ending(branch: _Branch, y: NDArray, correlation: NDArray, mode: int) -> tuple[str, str]:
    """Return status and reason of the mode.

    The reason states why the path ended and from which amplitude the result is not valid.
    """
    path = branch.pieces[0].path
    place = branch.system.measure.place
    if not path.points:
        return NOT_FOUND, path.reason
    reason = path.reason
    if path.status != COMPLETE:
        reason = f"{path.status}: {path.reason}"
        reason += _remedy(branch)
    if len(branch.pieces) > 1:
        reason += f"; there is another branch below {place(branch.high)}"
    # least correlation of the same mode with the stuck mode
    same_mode = 0.5
    other_mode = correlation < same_mode
    if other_mode.any():
        first = _parameter_at(y[:, PARAMETER], correlation, same_mode, int(np.argmax(other_mode)))
        reason += (
            f"; above {place(first)} the motion is no longer that of mode {mode}: it "
            "interacts with another mode"
        )
    # damping ratio above which the periodic motion does not represent a decaying one
    high_damping = 0.5
    overdamped = y[:, ZETA] > high_damping
    if overdamped.any():
        first = _parameter_at(y[:, PARAMETER], y[:, ZETA], high_damping, int(np.argmax(overdamped)))
        reason += (
            f"; above {place(first)} the damping ratio exceeds {high_damping:g}, which "
            "is too high for a periodic approximation"
        )
    if path.status != COMPLETE or other_mode.any() or overdamped.any():
        return INCOMPLETE, reason
    return COMPLETE, reason
