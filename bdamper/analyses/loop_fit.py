r"""Identification of contact stiffness and friction from measured hysteresis loops.

The contact model consists of n sliders in parallel, each with the stiffness :math:`k_t/n` and the friction limit
:math:`\mu_i N/n`. The coefficients :math:`\mu_i` are the midpoints of n equal parts between :math:`\mu(1-s)` and
:math:`\mu(1+s)`. A spread s > 0 rounds the corners of the loop. A single slider underestimates the stiffness of a contact
whose points slip one after the other.

By Masing's rule the loop between the displacements :math:`x_-` and :math:`x_+` has two piecewise linear branches

.. math:: f = f_0 \pm \Big(\tfrac12 H - \sum_i \tfrac{k_t}{n} \min(|x_\pm - x|, 2 \mu_i N / k_t)\Big)

with the upper sign for decreasing x, and H the sum at :math:`|x_\pm - x| = x_+ - x_-`. Friction limits that differ between
left and right only change :math:`f_0`. A backlash b, a tangential clearance in series with the sliders, interrupts both
branches at the force zero by a distance b without change of force; the sliders then move by :math:`x_+ - x_- - b`. The
zero of the force is a parameter, since load cells have offsets. Displacement and force both have errors. The fit minimises
the sum of squared distances from the points to their branch, each axis in units of its noise. The noise follows from third
differences, which are otherwise small in a smooth record. Standard deviations follow from fits without one block of
successive points each (jackknife), which allows for correlated errors.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy
from numpy.typing import NDArray

from bdamper.analyses.fit import left_out
from bdamper.importers.measurements import FORCES, LENGTHS, read_columns
from bdamper.util import validation
from bdamper.util.display import Plottable
from bdamper.util.errors import COMPLETE, INCOMPLETE, with_reason
from bdamper.util.formatting import amount, percent, short_repr

REVERSAL = 10.0
"""Least reversal of the displacement as a multiple of its noise; as a fraction of its range it is ``CLOSED``."""
CLOSED = 0.05
"""Relative difference up to which a loop is closed and turning points coincide."""
STICKS = 0.01
"""Half the height of a loop, relative to the range of its force, below which it does not determine the friction."""
RESOLVED = 1e-4
"""Lower limit of the noise relative to the range, for records without noise."""
DIFFERENCE = 5e-3
"""Step of the finite differences; it smooths the corners of the sliders, which would stop the search."""
ITERATIONS = 40
"""Maximum number of evaluations of a search."""
FULL_WAY = 0.98
"""Fraction of the largest travel in a period.  Only periods with more travel determine the drift."""
DRIFT = 0.01
"""Drift over a record, relative to the range, from which it is removed."""
POOR = 0.05
"""Misfit above which the model does not describe a loop."""


@short_repr
@dataclass(frozen=True)
class FittedLoop(Plottable):
    """Contact stiffness and friction identified from a hysteresis loop.

    ``plot`` draws measured and fitted force over displacement (:func:`bdamper.plot.plot_loop`).

    Parameters
    ----------
    kt : float, N/m
        Tangential contact stiffness.
    mu : float
        Mean friction coefficient of the sliders.
    spread : float
        Half width of the uniform distribution of the friction limits over their mean, s above.
    backlash : float, m
        Tangential clearance; 0 if it was not fitted.
    deviation : (4,) float
        Standard deviations of kt, mu, spread and backlash.
    misfit : float
        Root mean square distance from the points to the loop in excess of the noise; each axis relative to its root mean
        square.
    noise : (2,) float
        Standard deviations of the noise of displacement (m) and force (N).
    sliders : int
    displacement, force, model : (n,) float, m, N, N
        Fitted points without drift, and force of the model at these displacements.
    energy, friction, stiffness : (n_cycles,), (n_cycles, 2), (n_cycles, 2) float, J, N, N/m
        Measured area of each cycle; friction to the left and right: median force over the second half of a branch;
        stiffness after the left and right turning point: slope over the first quarter of the change of force.
    status : str
        "complete", or "incomplete: ..." with the reason for doubt.
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
    notes: tuple[str, ...] = ()
    _summary_fields = ("kt", "mu", "spread", "backlash", "misfit", "status", "notes")

    def _headline(self) -> str:
        kt, mu, spread, play = self.deviation
        clearance = (
            f", backlash {amount(self.backlash, 'm')} ({amount(play, 'm')})"
            if self.backlash
            else ""
        )
        doubt = self.status.partition(": ")[2]
        return (
            f"{doubt[:1].upper()}{doubt[1:]}{doubt and '. '}"
            f"Tangential stiffness {amount(self.kt, 'N/m')} (deviation {amount(kt, 'N/m')}), friction coefficient "
            f"{self.mu:.3g} ({mu:.2g}), spread of the limits {self.spread:.2g} ({spread:.2g}){clearance}; misfit "
            f"{percent(self.misfit)} beyond the noise."
        )


@validation.check_arguments
def fit_loop(
    displacement: NDArray,
    force: NDArray,
    *,
    normal: float,
    sliders: int = 20,
    backlash: bool = False,
) -> FittedLoop:
    """Identify contact stiffness, friction coefficient, its spread and backlash from a measured loop.

    Parameters
    ----------
    displacement : (n,) float, m
        Relative displacement in chronological order over one period or more. In a longer record only periods with full
        amplitude are fitted, without start and end, and linear drift of displacement and force is removed.
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
        If there are fewer than ten points; if there is no closed period because of drift, varying amplitude or missing
        points; if the force has the opposite sign; if the points are in reverse order; or if there is no slip.
    """
    x, y = validation.numbers("displacement", displacement), validation.numbers("force", force)
    expected = "ten or more displacements and as many forces"
    validation.check(len(x) == len(y) >= 10, "loop", expected, f"{len(x)} and {len(y)}")
    normal = validation.number("normal", normal, above=0.0, unit="N")
    sliders = validation.integer("sliders", sliders, least=1)
    noise = np.array([_noise(x), _noise(y)])
    apart = max(REVERSAL * noise[0], CLOSED * float(np.ptp(x)))
    turns = _turns(x, apart)
    x, y, notes = _without_drift(x, y, turns)
    sense = _senses(x, y, turns, apart)
    if len(turns) <= 2:  # the period begins where a branch does
        x, y, sense = (np.roll(values, -turns[0]) for values in (x, y, sense))
    used = sense != 0.0
    if not used.all():
        notes += (f"fitted to {used.sum()} of {len(x)} points, those of periods of full amplitude",)
    cycles = _cycles(x, y, sense, noise)
    x, y, sense = x[used], y[used], sense[used]
    _check_signs(x, y, sense)
    if len(cycles["energy"]) > 1 and np.ptp(cycles["energy"]) > CLOSED * np.median(
        cycles["energy"]
    ):
        change = percent(np.ptp(cycles["energy"]) / np.median(cycles["energy"]))
        notes += (f"the energy differs by {change} between cycles: no steady state",)
    loop = _Loop(x, y, sense, noise, normal, sliders, backlash)
    p, r, J = loop.fitted()
    relative = r / [np.std(x), np.std(y)] * noise
    beyond = (relative**2).sum(axis=1) * (1.0 - 1.0 / np.maximum((r**2).sum(axis=1), 1e-12))
    misfit = float(np.sqrt(max(beyond.mean(), 0.0)))
    blocks = np.array_split(np.arange(r.size), max(int(np.sqrt(len(x))), 3))
    scale = [np.exp(p[0]), np.exp(p[1]), float(sliders > 1), 1.0, 1.0, 1.0, np.ptp(x), 1.0]
    deviation = np.append(left_out(r.ravel(), J, blocks) * scale[: len(p)], 0.0)[[0, 1, 2, 6]]
    wrong = f"the model does not describe this loop (misfit {percent(misfit)} beyond the noise)"
    return FittedLoop(
        kt=float(np.exp(p[0])), mu=float(np.exp(p[1])), spread=float(p[2]) if sliders > 1 else 0.0,
        backlash=float(p[6] * np.ptp(x)) if backlash else 0.0, deviation=deviation, misfit=misfit, noise=noise,
        sliders=sliders, displacement=x, force=y, model=loop.force(p), **cycles, notes=notes,
        status=with_reason(INCOMPLETE, wrong) if misfit > POOR else COMPLETE,
    )  # fmt: skip


def _noise(values: NDArray) -> float:
    """Return the standard deviation of the noise from the median of third differences, which ignores corners."""
    third = float(np.median(np.abs(np.diff(values, 3)))) / (0.6745 * np.sqrt(20.0))
    return max(third, RESOLVED * float(np.ptp(values)))


def _turns(x: NDArray, apart: float) -> NDArray:
    """Return the indices of turning points, at which the displacement reverses by at least ``apart``."""
    kinds = {
        int(i): way
        for way in (1.0, -1.0)
        for i in scipy.signal.find_peaks(way * x, prominence=apart)[0]
    }
    # of successive turning points of the same kind only the first counts
    return np.array(
        [
            i
            for before, i in itertools.pairwise([-1, *sorted(kinds)])
            if kinds[i] != kinds.get(before)
        ],
        int,
    )


def _without_drift(
    x: NDArray, y: NDArray, turns: NDArray
) -> tuple[NDArray, NDArray, tuple[str, ...]]:
    """Return displacement and force without linear drift, and notes about removed drift.

    The drift is determined from the means over the periods of nearly full amplitude.
    """
    rise, notes = np.abs(np.diff(x[turns])), tuple[str, ...]()
    both = rise[1:] + rise[:-1]  # travel in each period
    full = np.flatnonzero(both > FULL_WAY * both.max(initial=0.0))
    if len(full) < 3:
        return x, y, notes
    out, time = [], np.arange(len(x)) - (len(x) - 1) / 2.0
    middle = [(time[turns[i]] + time[turns[i + 2] - 1]) / 2.0 for i in full]
    for name, values in (("displacement", x), ("force", y)):
        slope = float(
            np.polyfit(middle, [values[turns[i] : turns[i + 2]].mean() for i in full], 1)[0]
        )
        share = slope * len(x) / np.ptp(values)
        drifts = abs(share) > DRIFT
        notes += (
            (f"drift of the {name} by {percent(abs(share))} of its range over the record removed",)
            if drifts
            else ()
        )
        out.append(values - slope * time if drifts else values)
    return out[0], out[1], notes


def _senses(x: NDArray, y: NDArray, turns: NDArray, apart: float) -> NDArray:
    """Return 1 at points of increasing displacement, -1 at points of decreasing displacement and 0 outside of periods."""
    ends = np.array([0, *turns, len(x)])
    rise = np.diff(x[np.minimum(ends, len(x) - 1)])
    sense = np.sign(rise)
    if len(turns) > 2:  # start and end are incomplete periods
        full = np.abs(rise) > np.ptp(x[turns]) - apart
        full[[0, -1]] = False
        sense = sense * full
    expected = "a closed period or more; remove drift, or give whole periods of constant amplitude"
    validation.check(
        {-1.0, 1.0} <= set(sense),
        "displacement",
        expected,
        f"{len(turns)} turning points and no full period",
    )
    if len(turns) <= 2:
        for name, values in (("displacement", x), ("force", y)):
            span, step = float(np.ptp(values)), float(np.abs(np.diff(values)).max())
            gap = abs(float(values[-1] - values[0]))
            found = f"{percent(gap / span)} of its range between the first and the last point"
            validation.check(gap <= max(2.0 * step, CLOSED * span), name, expected, found)
    return np.repeat(sense, np.diff(ends))


def _cycles(x: NDArray, y: NDArray, sense: NDArray, noise: NDArray) -> dict[str, NDArray]:
    """Return energy, friction and stiffness of each cycle of two successive branches; columns are left and right."""
    parts = [
        part
        for part in np.split(np.arange(len(x)), np.flatnonzero(np.diff(sense)) + 1)
        if sense[part[0]] != 0.0
    ]
    energy, friction, stiffness, after = [], [], [], 0
    for pair in itertools.pairwise(parts):
        if pair[0][0] < after or pair[1][0] > pair[0][-1] + 1:
            continue
        whole, after = np.concatenate(pair), pair[1][-1] + 1
        energy.append(
            0.5 * float((y[whole] + np.roll(y[whole], -1)) @ (np.roll(x[whole], -1) - x[whole]))
        )
        fall, rise = sorted(pair, key=lambda part: sense[part[0]])
        friction.append([-_late(x[fall], y[fall]), _late(x[rise], y[rise])])
        stiffness.append([_slope(x[part], y[part], noise) for part in (rise, fall)])
    return {
        "energy": np.array(energy),
        "friction": np.array(friction),
        "stiffness": np.array(stiffness),
    }


def _late(x: NDArray, y: NDArray) -> float:
    """Return the median force over the second half of the displacement of a branch."""
    return float(np.median(y[np.abs(x - x[0]) > 0.5 * abs(x[-1] - x[0])]))


def _slope(x: NDArray, y: NDArray, noise: NDArray) -> float:
    """Return the slope of a branch over the first quarter of the change of its force, by orthogonal regression."""
    n = int(np.argmax(np.abs(y - y[0]) > 0.25 * np.ptp(y)))
    if n < 3:
        return float("nan")
    points = np.column_stack([x[:n], y[:n]]) / noise
    dx, dy = np.linalg.svd(points - points.mean(axis=0))[2][0] * noise
    return float(dy / dx)


def _check_signs(x: NDArray, y: NDArray, sense: NDArray) -> None:
    """Raise SettingError for a loop without slip, with energy supply or with negative stiffness."""
    slope, half, _ = np.linalg.lstsq(np.column_stack([x, sense, np.ones(len(x))]), y, rcond=None)[0]
    slips = abs(half) > STICKS * np.ptp(y)
    validation.check(
        slips, "loop", "slip, without which friction is not known", "a loop that sticks"
    )
    opposite = bool(slope * np.ptp(x) < -CLOSED * np.ptp(y))
    mends = {
        "change the sign of the force": opposite,
        "reverse the order of the points": opposite == (half > 0.0),
    }
    mend = " and ".join(words for words, needed in mends.items() if needed)
    found = "negative stiffness" if half > 0.0 else "energy that is supplied"
    validation.check(
        not mend, "loop", "positive stiffness and energy that is dissipated", f"{found}; {mend}"
    )


@dataclass(eq=False)
class _Loop:
    """Branches of the slider model and their distances from measured points.

    The parameters p are the logarithms of kt and mu, the spread, and the mean force and both turning points of the
    displacement, relative to the measured ranges.  A fit of the backlash also has the backlash and the zero of the force.
    """

    x: NDArray
    y: NDArray
    sense: NDArray
    noise: NDArray
    normal: float
    sliders: int
    backlash: bool

    def branches(self, p: NDArray) -> dict[float, NDArray]:
        """Return the corners (sliders + 4, 2) of both branches by the sign of the velocity."""
        places = (2.0 * np.arange(self.sliders) + 1.0) / self.sliders - 1.0
        low, high = p[4:6] * np.ptp(self.x) + self.x.min()
        play = p[6] * np.ptp(self.x) if self.backlash else 0.0
        slip = (
            2.0 * np.exp(p[1] - p[0]) * self.normal * (1.0 + p[2] * places)
        )  # from stick to full slip of each slider
        way = np.minimum(np.concatenate([[0.0], slip, [np.inf]]), max(high - low - play, 0.0))
        drop = np.exp(p[0]) / self.sliders * np.minimum(way[:, None], slip).sum(axis=1)
        middle, zero = self.y.min() + np.array([p[3], p[7] if self.backlash else p[3]]) * np.ptp(
            self.y
        )
        out = {}
        for sense, turn in ((-1.0, high), (1.0, low)):
            before = float(
                np.clip(drop[-1] / 2.0 + sense * (zero - middle), 0.0, drop[-1])
            )  # change of force up to zero
            at = int(np.searchsorted(drop, before))
            # the clearance is crossed at zero force
            ways = np.insert(
                way + play * (np.arange(len(way)) >= at),
                at,
                np.interp(before, drop, way) + [0.0, play],
            )
            drops = np.insert(drop, at, [before, before])
            out[sense] = np.column_stack(
                [turn + sense * ways, middle + sense * (drops - drop[-1] / 2.0)]
            )
        return out

    def force(self, p: NDArray) -> NDArray:
        """Return the force (n,) of the model at the measured displacements."""
        up, down = (self.branches(p)[sense][:: int(sense)] for sense in (1.0, -1.0))
        return np.where(self.sense > 0.0, np.interp(self.x, *up.T), np.interp(self.x, *down.T))

    def residual(self, p: NDArray) -> NDArray:
        """Return the vectors (2 n,) from the points to the nearest points of their branch, in units of the noise."""
        out, points = (
            np.empty(len(self.x), complex),
            self.x / self.noise[0] + 1j * self.y / self.noise[1],
        )
        for sense, corners in self.branches(p).items():
            out[self.sense == sense] = _nearest(
                points[self.sense == sense], corners @ ([1.0, 1j] / self.noise)
            )
        return out.view(float)

    def fitted(self) -> tuple[NDArray, NDArray, NDArray]:
        """Return the best parameters, the residuals (n, 2) and their derivatives (2 n, 6 or 8)."""
        limit = np.log(0.5 * np.ptp(np.quantile(self.y, [0.02, 0.98])) / self.normal)
        soft = np.log(np.ptp(self.y) / np.ptp(self.x))
        size, zero = 8 if self.backlash else 6, -self.y.min() / np.ptp(self.y)
        steps = itertools.product(
            soft + np.linspace(0.0, 4.0, 9), limit + np.array([0.0, 0.3, 0.7])
        )
        grid = [
            np.array([*step, 0.0, 0.5, 0.0, 1.0, 0.0, np.clip(zero, 0.0, 1.0)])[:size]
            for step in steps
        ]
        lower, upper = (
            [-np.inf, -np.inf, 0.0, -1.0, -1.0, 0.5, 0.0, -1.0],
            [np.inf, np.inf, 1.0, 2.0, 0.5, 2.0, 1.0, 2.0],
        )
        bounds = np.array([lower, upper])[:, :size]
        tries = []
        spreads, plays = (
            (0.1, 0.5, 0.9) if self.sliders > 1 else (0.0,),
            (0.03, 0.1, 0.3) if self.backlash else (0.0,),
        )
        for spread, play in itertools.product(spreads, plays):
            starts = [
                p + np.array([0.0, 0.0, spread, 0.0, 0.0, 0.0, play, 0.0])[:size] for p in grid
            ]
            start = min(starts, key=lambda p: float((self.residual(p) ** 2).sum()))
            origin = (
                start - 1.0
            )  # shifts the parameters to about 1, since difference steps are relative
            solution = scipy.optimize.least_squares(
                lambda q, origin=origin: self.residual(origin + q), start - origin, "3-point", bounds - origin,
                xtol=1e-8, ftol=1e-10, diff_step=DIFFERENCE, max_nfev=ITERATIONS,
            )  # fmt: skip
            tries.append(
                (solution.cost, origin + solution.x, solution.fun.reshape(-1, 2), solution.jac)
            )
        return min(tries, key=lambda each: each[0])[1:]


def _nearest(points: NDArray, corners: NDArray) -> NDArray:
    """Return the vectors (n,) from points to the nearest points of a polygonal line; all are complex numbers."""
    away, along = points[:, None] - corners[:-1], np.diff(corners)
    share = np.clip((away * along.conj()).real / np.maximum(np.abs(along) ** 2, 1e-300), 0.0, 1.0)
    way = share * along - away
    return way[np.arange(len(points)), np.abs(way).argmin(axis=1)]


def read_loop(path: str | Path) -> tuple[NDArray, NDArray]:
    """Read displacement (m) and force (N) from a CSV file with these two columns, their units in brackets.

    Parameters
    ----------
    path : str or Path

    Returns
    -------
    displacement, force : (n,) float, m and N

    Raises
    ------
    BdamperError
        If a column is missing, a unit is unknown, or a value is not a finite number; the message contains the line.
    """
    columns = read_columns(
        path, ("displacement", "force"), units={"displacement": LENGTHS, "force": FORCES}
    )
    return columns["displacement"][0], columns["force"][0]
