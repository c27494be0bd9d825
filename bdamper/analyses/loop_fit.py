r"""Identification of contact stiffness and friction from measured hysteresis loops.

The contact model consists of n sliders in parallel, each with the stiffness :math:`k_t/n` and the
friction limit :math:`\mu_i N/n`. The coefficients :math:`\mu_i` are the midpoints of n equal parts
between :math:`\mu(1-s)` and :math:`\mu(1+s)`. A spread s > 0 rounds the corners of the loop. A
single slider underestimates the stiffness of a contact whose points begin to slip one after
another.

By Masing's rule the loop between the displacements :math:`x_-` and :math:`x_+` has two piecewise
linear branches

.. math:: f = f_0 \pm \Big(\tfrac12 H - \sum_i \tfrac{k_t}{n} \min(|x_\pm - x|, 2 \mu_i N /
k_t)\Big)

with the upper sign for decreasing x, and H the sum at :math:`|x_\pm - x| = x_+ - x_-`. Friction
limits that differ between left and right only change :math:`f_0`. A backlash b, a tangential
clearance in series with the sliders, interrupts both branches at the force zero by a distance b
without change of force; the sliders then move by :math:`x_+ - x_- - b`. The zero of the force is a
parameter, because load cells have offsets. Displacement and force both have errors. The fit
minimises the sum of squared distances from the points to their branch, each axis in units of its
noise. The noise follows from third differences, which are otherwise small in a smooth record.
Standard deviations follow from fits without one block of successive points each (jackknife), which
allows for correlated errors.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from bdamper.analyses.fit import left_out
from bdamper.importers.measurements import FORCES, LENGTHS, read_columns
from bdamper.util import validation
from bdamper.util.display import Plottable, Result
from bdamper.util.errors import COMPLETE, INCOMPLETE
from bdamper.util.formatting import amount, percent, sentence, short_repr
from bdamper.util.statement import Row, Statement

REVERSAL = 10.0
"""Least reversal of the displacement as a multiple of its noise; as a fraction of its range it is
``CLOSED``.
"""
CLOSED = 0.05
"""Relative difference up to which a loop is closed and turning points coincide."""
STICKS = 0.01
"""Half the height of a loop, relative to the range of its force, below which it does not determine
the friction.
"""
RESOLVED = 1e-4
"""Lower limit of the noise relative to the range, for records without noise."""
DIFFERENCE = 5e-3
"""Step of the finite differences; it smooths the corners of the sliders, which would stop the
search.
"""
ITERATIONS = 40
"""Maximum number of evaluations of a search."""
FULL_WAY = 0.98
"""Fraction of the largest travel in a period.

Only periods with more travel determine the drift.
"""
DRIFT = 0.01
"""Drift over a record, relative to the range, from which it is removed."""
POOR = 0.05
"""Misfit above which the model does not describe a loop."""


@short_repr
@dataclass(frozen=True)
class FittedLoop(Result, Plottable):
    """Contact stiffness and friction identified from a hysteresis loop.

    ``plot`` draws measured and fitted force against displacement (:func:`bdamper.plot.plot_loop`).

    Parameters
    ----------
    kt : float, N/m
        Tangential contact stiffness.
    mu : float
        Mean friction coefficient of the sliders.
    spread : float
        Half-width of the uniform distribution of the friction limits, divided by their mean: s in
        the description of the module.
    backlash : float, m
        Tangential clearance; 0 if it was not fitted.
    deviation : (4,) float
        Standard deviations of kt, mu, spread and backlash.
    misfit : float
        Root mean square distance from the points to the loop in excess of the noise; each axis
        relative to its root mean square.
    noise : (2,) float
        Standard deviations of the noise of displacement (m) and force (N).
    sliders : int
    displacement, force, model : (n,) float, m, N, N
        Fitted points without drift, and force of the model at these displacements.
    energy, friction, stiffness : (n_cycles,), (n_cycles, 2), (n_cycles, 2) float, J, N, N/m
        Measured area of each cycle; friction to the left and right: median force over the second
        half of a branch; stiffness after the left and right turning point: slope over the first
        quarter of the change of force.
    status : str
        "complete" or "incomplete".
    reason : str
        Reason for doubt.
    notes : tuple of str
    """

    kt: float
    mu: float
    spread: float
    backlash: float
    deviation: NDArray
    misfit: float
    noise: NDArray
    sliders: int
    displacement: NDArray
    force: NDArray
    model: NDArray
    energy: NDArray
    friction: NDArray
    stiffness: NDArray
    status: str = COMPLETE
    reason: str = ""
    notes: tuple[str, ...] = ()
    _summary_fields = ("kt", "mu", "spread", "backlash", "misfit", "status", "notes")

    def _statement(self) -> Statement:
        kt, mu, spread, clearance = self.deviation
        rows = [
            Row("Friction coefficient", f"{self.mu:.3g}", f"standard error {mu:.2g}"),
            Row(
                "Tangential stiffness",
                amount(self.kt, "N/m"),
                f"standard error {amount(kt, 'N/m')}",
            ),
        ]
        if self.sliders > 1:
            ends = f"{100.0 * (1.0 - self.spread):.0f} to {100.0 * (1.0 + self.spread):.0f} %"
            half_width = (
                f"of their mean, uniformly distributed; half-width {percent(self.spread)}, "
                f"standard error {100.0 * spread:.2g} percentage points"
            )
            rows.append(Row("Slip limits", ends, half_width))
        if self.backlash:
            deviation = f"standard error {amount(clearance, 'm')}"
            rows.append(Row("Backlash", amount(self.backlash, "m"), deviation))
        misfit_of = (
            "root mean square distance of the points from the loop in excess of the noise, relative "
            "to the standard deviations of displacement and force"
        )
        rows.append(Row("Misfit", percent(self.misfit), misfit_of))
        found = f"friction coefficient {self.mu:.3g}, stiffness {amount(self.kt, 'N/m')}"
        verdict = f"Fitted with a misfit of {percent(self.misfit)}: {found}"
        if self.reason:
            verdict = f"Not fitted: {self.reason}"
        return Statement([verdict], rows, remarks=[sentence(note) for note in self.notes])


@validation.check_arguments
def fit_loop(
    displacement: NDArray,
    force: NDArray,
    *,
    normal: float,
    sliders: int = 20,
    backlash: bool = False,
) -> FittedLoop:
    """Identify contact stiffness, friction, its spread and backlash from a measured loop.

    Parameters
    ----------
    displacement : (n,) float, m
        Relative displacement in chronological order over one period or more. In a longer record
        only periods with full amplitude are fitted, without start and end, and linear drift of
        displacement and force is removed.
    force : (n,) float, N
        Tangential force, positive if it resists a positive displacement.
    normal : float, N
        Constant normal load.
    sliders : int
        Number of sliders; 1 for an element that changes from stick to slip at once.
    backlash : bool
        Whether to identify a tangential clearance.

    Returns
    -------
    FittedLoop

    Raises
    ------
    SettingError
        If there are fewer than ten points; if there is no closed period because of drift, varying
        amplitude or missing points; if the force has the opposite sign; if the points are in
        reverse order; or if there is no slip.
    """
    x = validation.numbers("displacement", displacement)
    y = validation.numbers("force", force)
    expected = "ten or more displacements and as many forces"
    validation.check(len(x) == len(y) >= 10, "loop", expected, f"{len(x)} and {len(y)}")
    normal = validation.number("normal", normal, above=0.0, unit="N")
    sliders = validation.integer("sliders", sliders, least=1)
    noise = np.array([_noise(x), _noise(y)])
    reversal = max(REVERSAL * noise[0], CLOSED * float(np.ptp(x)))
    turns = _turns(x, reversal)
    x, y, notes = _without_drift(x, y, turns)
    sense = _senses(x, y, turns, reversal)
    if len(turns) <= 2:
        # the only period begins where a branch does
        x = np.roll(x, -turns[0])
        y = np.roll(y, -turns[0])
        sense = np.roll(sense, -turns[0])
    used = sense != 0.0
    if not used.all():
        notes += (f"fitted to {used.sum()} of {len(x)} points, from periods with full amplitude",)
    cycles = _cycles(x, y, sense, noise)
    x = x[used]
    y = y[used]
    sense = sense[used]
    _check_signs(x, y, sense)
    energy = cycles["energy"]
    if len(energy) > 1 and np.ptp(energy) > CLOSED * np.median(energy):
        change = percent(np.ptp(energy) / np.median(energy))
        notes += (f"the energy differs by {change} between cycles: no steady state",)

    loop = _Loop(x, y, sense, noise, normal, sliders, backlash)
    fitted = loop.fitted()
    best = _Parameters(*fitted.parameters)
    misfit = _misfit(fitted.residual, x, y, noise)
    reason = ""
    if misfit > POOR:
        reason = f"the model does not describe this loop (misfit {percent(misfit)} in excess of the noise)"
    return FittedLoop(
        kt=float(np.exp(best.log_kt)),
        mu=float(np.exp(best.log_mu)),
        spread=float(best.spread) if sliders > 1 else 0.0,
        backlash=float(best.backlash * np.ptp(x)) if backlash else 0.0,
        deviation=_deviation(fitted, x, sliders),
        misfit=misfit,
        noise=noise,
        sliders=sliders,
        displacement=x,
        force=y,
        model=loop.force(fitted.parameters),
        energy=energy,
        friction=cycles["friction"],
        stiffness=cycles["stiffness"],
        status=INCOMPLETE if reason else COMPLETE,
        reason=reason,
        notes=notes,
    )


def _misfit(residual: NDArray, x: NDArray, y: NDArray, noise: NDArray) -> float:
    """Return the root mean square of the distances beyond the noise.

    ``residual`` (n, 2) is in units of the noise; each axis of the misfit is relative to its root
    mean square.
    """
    relative = residual / [np.std(x), np.std(y)] * noise
    # noise alone gives a squared residual of 1, which is taken from each square
    squared_residual = np.maximum((residual**2).sum(axis=1), 1e-12)
    fraction_beyond_noise = 1.0 - 1.0 / squared_residual
    beyond_noise = (relative**2).sum(axis=1) * fraction_beyond_noise
    return float(np.sqrt(max(beyond_noise.mean(), 0.0)))


def _deviation(fitted: _FittedSliders, x: NDArray, sliders: int) -> NDArray:
    """Return the standard deviations (4,) of stiffness, friction, spread and backlash.

    They have the units of the results (N/m, -, -, m); without a fit of the backlash its deviation
    is 0.
    """
    best = _Parameters(*fitted.parameters)
    # blocks of successive points, because their errors are correlated
    n_blocks = max(int(np.sqrt(len(x))), 3)
    blocks = np.array_split(np.arange(fitted.residual.size), n_blocks)
    deviations = left_out(fitted.residual.ravel(), fitted.derivatives, blocks)
    deviation = _Parameters(*deviations)
    # the deviation of a logarithm is relative
    kt = deviation.log_kt * np.exp(best.log_kt)
    mu = deviation.log_mu * np.exp(best.log_mu)
    # a single slider has no spread
    spread = deviation.spread if sliders > 1 else 0.0
    backlash = deviation.backlash * np.ptp(x)
    return np.array([kt, mu, spread, backlash])


def _noise(values: NDArray) -> float:
    """Return the standard deviation of the noise of a record.

    It follows from the median of third differences, which ignores corners.
    """
    # of normal noise the median is 0.6745 standard deviations, and the variance of a third
    # difference is 1 + 9 + 9 + 1 times that of a value
    third_difference = float(np.median(np.abs(np.diff(values, 3))))
    noise = third_difference / (0.6745 * np.sqrt(20.0))
    return max(noise, RESOLVED * float(np.ptp(values)))


def _turns(x: NDArray, reversal: float) -> NDArray:
    """Return the indices of turning points, at which the displacement reverses by ``reversal``."""
    sign_at: dict[int, float] = {}
    for sign in (1.0, -1.0):
        for i in scipy.signal.find_peaks(sign * x, prominence=reversal)[0]:
            sign_at[int(i)] = sign
    # of successive turning points of the same kind only the first counts
    turns: list[int] = []
    previous = 0.0
    for i in sorted(sign_at):
        if sign_at[i] != previous:
            turns.append(i)
        previous = sign_at[i]
    return np.array(turns, int)


def _without_drift(
    x: NDArray, y: NDArray, turns: NDArray
) -> tuple[NDArray, NDArray, tuple[str, ...]]:
    """Return displacement and force without linear drift, and notes about removed drift.

    The drift is determined from the means over the periods of nearly full amplitude.
    """
    # a period begins at each turning point and ends at the next but one
    rise = np.abs(np.diff(x[turns]))
    travel = rise[1:] + rise[:-1]
    full = np.flatnonzero(travel > FULL_WAY * travel.max(initial=0.0))
    if len(full) < 3:
        return x, y, ()
    begins = turns[full]
    ends = turns[full + 2]
    # time in sampling intervals from the middle of the record
    time = np.arange(len(x)) - (len(x) - 1) / 2.0
    middle = (time[begins] + time[ends - 1]) / 2.0
    notes: tuple[str, ...] = ()
    corrected = []
    for name, values in (("displacement", x), ("force", y)):
        means = [values[begin:end].mean() for begin, end in zip(begins, ends)]
        slope, _ = np.polyfit(middle, means, 1).tolist()
        share = abs(slope * len(x) / np.ptp(values))
        if share > DRIFT:
            values = values - slope * time
            notes += (
                f"removed a drift of the {name} by {percent(share)} of its range over the record",
            )
        corrected.append(values)
    return corrected[0], corrected[1], notes


def _senses(x: NDArray, y: NDArray, turns: NDArray, reversal: float) -> NDArray:
    """Return the sign (n,) of the velocity at each point, and 0 outside of periods.

    Raises
    ------
    SettingError
        If the record has no full period, or its only period is not closed.
    """
    # branches lie between successive turning points, and before the first and after the last
    ends = np.array([0, *turns, len(x)])
    rise = np.diff(x[np.minimum(ends, len(x) - 1)])
    sense = np.sign(rise)
    if len(turns) > 2:
        full = np.abs(rise) > np.ptp(x[turns]) - reversal
        # start and end are incomplete periods
        full[[0, -1]] = False
        sense = sense * full
    expected = (
        "at least one closed period; remove drift, or give whole periods of constant amplitude"
    )
    validation.check(
        {-1.0, 1.0} <= set(sense),
        "displacement",
        expected,
        f"{len(turns)} turning points and no full period",
    )
    if len(turns) <= 2:
        _check_closed("displacement", x, expected)
        _check_closed("force", y, expected)
    return np.repeat(sense, np.diff(ends))


def _check_closed(name: str, values: NDArray, expected: str) -> None:
    """Raise SettingError unless a period ends near its first point."""
    span = float(np.ptp(values))
    step = float(np.abs(np.diff(values)).max())
    gap = abs(float(values[-1] - values[0]))
    closed = gap <= max(2.0 * step, CLOSED * span)
    actual = f"{percent(gap / span)} of its range between the first and the last point"
    validation.check(closed, name, expected, actual)


def _cycles(x: NDArray, y: NDArray, sense: NDArray, noise: NDArray) -> dict[str, NDArray]:
    """Return energy, friction and stiffness of each cycle of two successive branches.

    The columns of friction and stiffness are left and right.
    """
    # indices of the points of each branch, on which the displacement rises or falls
    starts = np.flatnonzero(np.diff(sense)) + 1
    parts = np.split(np.arange(len(x)), starts)
    branches = [part for part in parts if sense[part[0]] != 0.0]
    energy: list[float] = []
    friction: list[list[float]] = []
    stiffness: list[list[float]] = []
    end_of_last_cycle = 0
    for first, second in itertools.pairwise(branches):
        belongs_to_last_cycle = first[0] < end_of_last_cycle
        has_gap = second[0] > first[-1] + 1
        if belongs_to_last_cycle or has_gap:
            continue
        end_of_last_cycle = second[-1] + 1
        cycle = np.concatenate([first, second])
        energy.append(_area(x[cycle], y[cycle]))
        first_rises = sense[first[0]] > 0.0
        rise, fall = (first, second) if first_rises else (second, first)
        friction.append([-_late_force(x[fall], y[fall]), _late_force(x[rise], y[rise])])
        stiffness.append([_slope(x[rise], y[rise], noise), _slope(x[fall], y[fall], noise)])
    return {
        "energy": np.array(energy),
        "friction": np.array(friction),
        "stiffness": np.array(stiffness),
    }


def _area(x: NDArray, y: NDArray) -> float:
    """Return the area of a closed loop by the trapezoidal rule."""
    steps = np.roll(x, -1) - x
    return 0.5 * float((y + np.roll(y, -1)) @ steps)


def _late_force(x: NDArray, y: NDArray) -> float:
    """Return the median force over the second half of the displacement of a branch."""
    second_half = np.abs(x - x[0]) > 0.5 * abs(x[-1] - x[0])
    return float(np.median(y[second_half]))


def _slope(x: NDArray, y: NDArray, noise: NDArray) -> float:
    """Return the slope (N/m) of a branch over the first quarter of the change of its force.

    The regression is orthogonal in units of the noise.  The slope is NaN if fewer than three points
    lie in this part.
    """
    change = np.abs(y - y[0])
    n = int(np.argmax(change > 0.25 * np.ptp(y)))
    if n < 3:
        return float("nan")
    # the first right singular vector is the direction of the largest scatter of the points
    points = np.column_stack([x[:n], y[:n]]) / noise
    directions = np.linalg.svd(points - points.mean(axis=0)).Vh
    dx, dy = directions[0] * noise
    return float(dy / dx)


def _check_signs(x: NDArray, y: NDArray, sense: NDArray) -> None:
    """Raise SettingError for a loop without slip, with energy supply or with negative stiffness."""
    # a line and half the height of the loop
    columns = np.column_stack([x, sense, np.ones(len(x))])
    slope, half_height, _ = np.linalg.lstsq(columns, y, rcond=None)[0]
    slips = abs(half_height) > STICKS * np.ptp(y)
    validation.check(
        slips, "loop", "slip, which determines the friction coefficient", "a loop without slip"
    )
    opposite_force = bool(slope * np.ptp(x) < -CLOSED * np.ptp(y))
    dissipates = half_height > 0.0
    remedies = []
    if opposite_force:
        remedies.append("change the sign of the force")
    # the sign of the force also changes the sign of the energy
    if opposite_force == dissipates:
        remedies.append("reverse the order of the points")
    problem = "negative stiffness" if dissipates else "an energy input"
    validation.check(
        not remedies,
        "loop",
        "a positive stiffness and a positive dissipated energy",
        f"{problem}; {' and '.join(remedies)}",
    )


@dataclass(frozen=True)
class _FittedSliders:
    """Best parameters (k,), residuals (n, 2) and their derivatives (2 n, k)."""

    parameters: NDArray
    residual: NDArray
    derivatives: NDArray


class _Parameters(NamedTuple):
    """Parameters of the slider model, in the order of the vectors of the fit.

    Parameters
    ----------
    log_kt, log_mu : float
        Logarithms of stiffness (N/m) and friction coefficient.
    spread : float
    mean_force : float
        Middle of the force; like ``zero_force`` it is 0 at the smallest measured force and 1 at the
        largest.
    low, high : float
        Turning points; 0 at the smallest measured displacement and 1 at the largest.
    backlash : float
        Clearance relative to the range of the displacement.
    zero_force : float
        Reading of the load cell without force.  A vector without backlash ends before the last two.
    """

    log_kt: float
    log_mu: float
    spread: float
    mean_force: float
    low: float
    high: float
    backlash: float = 0.0
    zero_force: float = 0.0


@dataclass(eq=False)
class _Loop:
    """Branches of the slider model and their distances from measured points.

    The vectors p contain the values of :class:`_Parameters`: eight if the backlash is fitted, the
    first six otherwise.
    """

    x: NDArray
    y: NDArray
    sense: NDArray
    noise: NDArray
    normal: float
    sliders: int
    backlash: bool

    def branches(self, p: NDArray) -> dict[float, NDArray]:
        """Return the corners (sliders + 4, 2) of both branches by the sign of the velocity.

        The columns are displacement (m) and force (N); a branch begins at its turning point.
        """
        model = _Parameters(*p)
        x_range = np.ptp(self.x)
        y_range = np.ptp(self.y)
        low = model.low * x_range + self.x.min()
        high = model.high * x_range + self.x.min()
        middle = self.y.min() + model.mean_force * y_range
        if self.backlash:
            clearance = model.backlash * x_range
            zero = self.y.min() + model.zero_force * y_range
        else:
            clearance = 0.0
            zero = middle

        # travel (sliders,) of each slider from the turning point to its slip: mean times factors
        # at equal distances from 1 - spread to 1 + spread
        places = (2.0 * np.arange(self.sliders) + 1.0) / self.sliders - 1.0
        mean_slip = 2.0 * np.exp(model.log_mu - model.log_kt) * self.normal
        slip = mean_slip * (1.0 + model.spread * places)
        # travel (sliders + 2,) of the corners: turning point, a slider begins to slip, end
        whole_travel = max(high - low - clearance, 0.0)
        travel = np.minimum(np.concatenate([[0.0], slip, [np.inf]]), whole_travel)
        # change of force (sliders + 2,) since the turning point
        stretch = np.minimum(travel[:, None], slip)  # (corner, slider)
        change = np.exp(model.log_kt) / self.sliders * stretch.sum(axis=1)
        half_height = change[-1] / 2.0

        branches = {}
        for sense, turn in ((-1.0, high), (1.0, low)):
            # the force of a branch is middle + sense (change - half_height); the clearance is
            # crossed at its zero, between two more corners with the same force
            exact_change = half_height + sense * (zero - middle)
            change_to_zero = float(np.clip(exact_change, 0.0, change[-1]))
            travel_to_zero = np.interp(change_to_zero, change, travel)
            crossing_travel = [travel_to_zero, travel_to_zero + clearance]
            crossing_change = [change_to_zero, change_to_zero]
            before = int(np.searchsorted(change, change_to_zero))  # number of earlier corners
            later_travel = travel[before:] + clearance
            travels = np.concatenate([travel[:before], crossing_travel, later_travel])
            changes = np.concatenate([change[:before], crossing_change, change[before:]])
            x = turn + sense * travels
            y = middle + sense * (changes - half_height)
            branches[sense] = np.column_stack([x, y])
        return branches

    def force(self, p: NDArray) -> NDArray:
        """Return the force (n,) of the model at the measured displacements."""
        branches = self.branches(p)
        # interpolation needs increasing displacements
        x_up, y_up = branches[1.0].T
        x_down, y_down = branches[-1.0][::-1].T
        force_up = np.interp(self.x, x_up, y_up)
        force_down = np.interp(self.x, x_down, y_down)
        return np.where(self.sense > 0.0, force_up, force_down)

    def residual(self, p: NDArray) -> NDArray:
        """Return the vectors (2 n,) from the points to their branch, in units of the noise.

        Displacement and force of each point are successive.
        """
        points = self.x / self.noise[0] + 1j * self.y / self.noise[1]
        vectors = np.empty(len(self.x), complex)
        for sense, corners in self.branches(p).items():
            on_branch = self.sense == sense
            scaled_corners = corners @ ([1.0, 1j] / self.noise)
            vectors[on_branch] = _nearest(points[on_branch], scaled_corners)
        return vectors.view(float)

    def fitted(self) -> _FittedSliders:
        """Return the best fit of searches from several spreads and backlashes."""
        lower = _Parameters(
            log_kt=-np.inf,
            log_mu=-np.inf,
            spread=0.0,
            mean_force=-1.0,
            low=-1.0,
            high=0.5,
            backlash=0.0,
            zero_force=-1.0,
        )
        upper = _Parameters(
            log_kt=np.inf,
            log_mu=np.inf,
            spread=1.0,
            mean_force=2.0,
            low=0.5,
            high=2.0,
            backlash=1.0,
            zero_force=2.0,
        )
        n_parameters = 8 if self.backlash else 6
        bounds = np.array([lower, upper])[:, :n_parameters]
        spreads = (0.1, 0.5, 0.9) if self.sliders > 1 else (0.0,)
        backlashes = (0.03, 0.1, 0.3) if self.backlash else (0.0,)
        solutions = []
        for spread, backlash in itertools.product(spreads, backlashes):
            starts = self._starts(spread, backlash)
            start = min(starts, key=lambda p: float((self.residual(p) ** 2).sum()))
            # difference steps are relative, therefore the parameters are shifted to about 1
            origin = start - 1.0
            solution = scipy.optimize.least_squares(
                lambda shifted, origin=origin: self.residual(origin + shifted),
                start - origin,
                "3-point",
                bounds - origin,
                xtol=1e-8,
                ftol=1e-10,
                diff_step=DIFFERENCE,
                max_nfev=ITERATIONS,
            )
            solution.x = origin + solution.x
            solutions.append(solution)
        best = min(solutions, key=lambda solution: solution.cost)
        return _FittedSliders(best.x, best.fun.reshape(-1, 2), best.jac)

    def _starts(self, spread: float, backlash: float) -> list[NDArray]:
        """Return initial parameters over a grid of stiffnesses and friction coefficients."""
        n_parameters = 8 if self.backlash else 6
        # the force at slip is nearly half the height, without outliers
        slip_force = 0.5 * np.ptp(np.quantile(self.y, [0.02, 0.98]))
        log_mu = np.log(slip_force / self.normal)
        # the secant from turning point to turning point, a lower bound of the stiffness
        log_secant = np.log(np.ptp(self.y) / np.ptp(self.x))
        zero_force = np.clip(-self.y.min() / np.ptp(self.y), 0.0, 1.0)
        starts = []
        for log_factor_kt in np.linspace(0.0, 4.0, 9):
            for log_factor_mu in (0.0, 0.3, 0.7):
                start = _Parameters(
                    log_kt=log_secant + log_factor_kt,
                    log_mu=log_mu + log_factor_mu,
                    spread=spread,
                    mean_force=0.5,
                    low=0.0,
                    high=1.0,
                    backlash=backlash,
                    zero_force=zero_force,
                )
                starts.append(np.array(start)[:n_parameters])
        return starts


def _nearest(points: NDArray, corners: NDArray) -> NDArray:
    """Return the vectors (n,) from points to a polygonal line; all are complex numbers."""
    # arrays are (n_points, n_edges); an edge is the vector between two corners
    edges = np.diff(corners)
    from_corner = points[:, None] - corners[:-1]
    # the foot of the perpendicular, as a fraction of the edge, or the nearer end of the edge
    along_edge = (from_corner * edges.conj()).real
    squared_length = np.maximum(np.abs(edges) ** 2, 1e-300)
    fraction = np.clip(along_edge / squared_length, 0.0, 1.0)
    to_edge = fraction * edges - from_corner
    nearest = np.abs(to_edge).argmin(axis=1)
    return to_edge[np.arange(len(points)), nearest]


def read_loop(path: str | Path) -> tuple[NDArray, NDArray]:
    """Read displacement (m) and force (N) from a CSV file.

    The file has these two columns, with their units in brackets.

    Parameters
    ----------
    path : str or Path

    Returns
    -------
    displacement, force : (n,) float, m and N

    Raises
    ------
    BdamperError
        If a column is missing, a unit is unknown, or a value is not a finite number; the message
        contains the line.
    """
    columns = read_columns(
        path, ("displacement", "force"), units={"displacement": LENGTHS, "force": FORCES}
    )
    return columns["displacement"][0], columns["force"][0]
