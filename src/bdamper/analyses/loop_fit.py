r"""Contact stiffness and friction from measured hysteresis loops.

The contact is n sliders in parallel, each a spring :math:`k_t/n` with a friction limit :math:`\mu_i N/n`.  The coefficients
are the midpoints of n equal parts between :math:`\mu(1-s)` and :math:`\mu(1+s)`, so a spread s > 0 rounds the corners of
the loop.  A single slider makes a contact that slips point after point seem softer than it is.

By Masing's rule the loop between the displacements :math:`x_-` and :math:`x_+` has two branches of straight lines,

.. math:: f = f_0 \pm \Big(\tfrac12 H - \sum_i \tfrac{k_t}{n} \min(|x_\pm - x|, 2 \mu_i N / k_t)\Big),

with the upper sign for decreasing x and H the sum at :math:`|x_\pm - x| = x_+ - x_-`.  Displacement and force both have
errors, so the fit minimises the sum of squared distances from the points to their branch, each axis in units of its noise.
The noise is measured: third differences of a smooth record contain little else.  Standard deviations follow from the
fits without one block of successive points after the other (jackknife), which allows for correlated errors.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy.optimize import least_squares

from bdamper.analyses.fit import left_out
from bdamper.importers.measurements import FORCES, LENGTHS, read_columns
from bdamper.util import validation
from bdamper.util.display import Plottable
from bdamper.util.errors import COMPLETE, INCOMPLETE, with_reason
from bdamper.util.formatting import amount, percent, short_repr

REVERSAL = 10.0
"""Reversals of the displacement count from this multiple of its noise, or from ``CLOSED`` of its range."""
CLOSED = 0.05
"""Difference, relative to the range, up to which a loop closes and turning points coincide."""
STICKS = 0.01
"""Half the height of a loop, relative to the range of its force, up to which it does not determine the friction."""
RESOLVED = 1e-4
"""Least noise, relative to the range, for records without noise."""
DIFFERENCE = 5e-3
"""Step of the derivatives: differences smooth the corners of the sliders, which would stop the search."""
ITERATIONS = 40
"""Iterations of a search."""
POOR = 0.05
"""Misfit above which the model does not describe a loop."""


@short_repr
@dataclass(frozen=True)
class FittedLoop(Plottable):
    """Contact stiffness and friction of a hysteresis loop.

    ``plot`` draws measured and fitted force over displacement (:func:`bdamper.plot.plot_loop`).

    Parameters
    ----------
    kt : float, N/m
    mu : float
        Mean over the sliders.
    spread : float
        Half width of the uniform distribution of the friction limits, divided by their mean (s above).
    deviation : (3,) float
        Standard deviations of kt, mu and spread.
    misfit : float
        Root mean square distance from the points to the loop beyond the measured noise, each axis relative to the root
        mean square of its values.
    noise : (2,) float
        Measured standard deviations of the noise of displacement (m) and force (N).
    sliders : int
    displacement, force, model : (n,) float
        Points that were fitted, in m and N, and the force of the model at these displacements.
    status : str
        "complete", or "incomplete: ..." with the reason why the values are doubtful.
    notes : tuple of str
    """

    kt: float
    mu: float
    spread: float
    deviation: NDArray
    misfit: float
    noise: NDArray
    sliders: int
    displacement: NDArray
    force: NDArray
    model: NDArray
    status: str = COMPLETE
    notes: tuple[str, ...] = ()
    _summary_fields = ("kt", "mu", "spread", "misfit", "status", "notes")

    def _headline(self) -> str:
        kt, mu, spread = self.deviation
        doubt = self.status.partition(": ")[2]
        return (
            f"{doubt[:1].upper()}{doubt[1:]}{doubt and '. '}"
            f"Tangential stiffness {amount(self.kt, 'N/m')} (deviation {amount(kt, 'N/m')}), friction coefficient "
            f"{self.mu:.3g} ({mu:.2g}), spread of the limits {self.spread:.2g} ({spread:.2g}); misfit "
            f"{percent(self.misfit)} beyond the noise."
        )


@validation.check_arguments
def fit_loop(displacement: NDArray, force: NDArray, *, normal: float, sliders: int = 20) -> FittedLoop:
    """Find contact stiffness, friction coefficient and its spread from a measured loop.

    Parameters
    ----------
    displacement : (n,) float, m
        Relative displacement in the order of time over one period or more.  If there are several periods, only those with
        full amplitude are fitted, without start and stop.
    force : (n,) float, N
        Tangential force, positive if it resists a positive displacement.
    normal : float, N
        Constant normal load.
    sliders : int
        1 for an element that slips at once.

    Returns
    -------
    FittedLoop

    Raises
    ------
    SettingError
        If there are fewer than ten points; the record has no closed period because of drift, varying amplitude or missing
        points; the force has the opposite sign; the points are in reverse order; or no slip is seen.
    """
    x, y = validation.numbers("displacement", displacement), validation.numbers("force", force)
    expected = "ten or more displacements and as many forces"
    validation.check(len(x) == len(y) >= 10, "loop", expected, f"{len(x)} and {len(y)}")
    normal = validation.number("normal", normal, above=0.0, unit="N")
    sliders = validation.integer("sliders", sliders, least=1)
    noise = np.array([_noise(x), _noise(y)])
    sense = _senses(x, y, max(REVERSAL * noise[0], CLOSED * float(np.ptp(x))))
    used = sense != 0.0
    notes = () if used.all() else (f"fitted to {used.sum()} of {len(x)} points, those of periods of full amplitude",)
    x, y, sense = x[used], y[used], sense[used]
    _check_signs(x, y, sense)
    loop = _Loop(x, y, sense, noise, normal, sliders)
    p, r, J = loop.fitted()
    relative = r / [np.std(x), np.std(y)] * noise
    beyond = (relative**2).sum(axis=1) * (1.0 - 1.0 / np.maximum((r**2).sum(axis=1), 1e-12))
    misfit = float(np.sqrt(max(beyond.mean(), 0.0)))
    blocks = np.array_split(np.arange(r.size), max(int(np.sqrt(len(x))), 3))
    deviation = left_out(r.ravel(), J, blocks)[:3] * [np.exp(p[0]), np.exp(p[1]), float(sliders > 1)]
    wrong = f"the model does not describe this loop (misfit {percent(misfit)} beyond the noise)"
    return FittedLoop(
        kt=float(np.exp(p[0])), mu=float(np.exp(p[1])), spread=float(p[2]), deviation=deviation, misfit=misfit, noise=noise,
        sliders=sliders, displacement=x, force=y, model=loop.force(p), notes=notes,
        status=with_reason(INCOMPLETE, wrong) if misfit > POOR else COMPLETE,
    )  # fmt: skip


def _noise(values: NDArray) -> float:
    """Estimate the standard deviation of the noise from third differences; a median, so that corners do not count."""
    third = float(np.median(np.abs(np.diff(values, 3)))) / (0.6745 * np.sqrt(20.0))
    return max(third, RESOLVED * float(np.ptp(values)))


def _senses(x: NDArray, y: NDArray, apart: float) -> NDArray:
    """Return 1 at points of increasing displacement, -1 at points of decreasing displacement and 0 outside of periods.

    Turning points are those from which the displacement returns by the distance ``apart``.
    """
    kinds = {int(i): way for way in (1.0, -1.0) for i in scipy.signal.find_peaks(way * x, prominence=apart)[0]}
    turns = [i for before, i in itertools.pairwise([-1, *sorted(kinds)]) if kinds[i] != kinds.get(before)]  # no equal peaks
    ends = np.array([0, *turns, len(x)])
    rise = np.diff(x[np.minimum(ends, len(x) - 1)])
    sense = np.sign(rise)
    if len(turns) > 2:  # start and stop are no part of a period
        full = np.abs(rise) > np.ptp(x[turns]) - apart
        full[[0, -1]] = False
        sense = sense * full
    expected = "a closed period or more; remove drift, or give whole periods of constant amplitude"
    validation.check(
        {-1.0, 1.0} <= set(sense), "displacement", expected, f"{len(turns)} turning points and no full period"
    )
    if len(turns) <= 2:
        for name, values in (("displacement", x), ("force", y)):
            span, step = float(np.ptp(values)), float(np.abs(np.diff(values)).max())
            gap = abs(float(values[-1] - values[0]))
            found = f"{percent(gap / span)} of its range between the first and the last point"
            validation.check(gap <= max(2.0 * step, CLOSED * span), name, expected, found)
    return np.repeat(sense, np.diff(ends))


def _check_signs(x: NDArray, y: NDArray, sense: NDArray) -> None:
    """Refuse a loop that sticks, supplies energy or has a negative stiffness."""
    slope, half, _ = np.linalg.lstsq(np.column_stack([x, sense, np.ones(len(x))]), y, rcond=None)[0]
    slips = abs(half) > STICKS * np.ptp(y)
    validation.check(slips, "loop", "slip, without which friction is not known", "a loop that sticks")
    opposite = bool(slope * np.ptp(x) < -CLOSED * np.ptp(y))
    mends = {"change the sign of the force": opposite, "reverse the order of the points": opposite == (half > 0.0)}
    mend = " and ".join(words for words, needed in mends.items() if needed)
    found = "negative stiffness" if half > 0.0 else "energy that is supplied"
    validation.check(not mend, "loop", "positive stiffness and energy that is dissipated", f"{found}; {mend}")


@dataclass(eq=False)
class _Loop:
    """Branches of sliders and their distances from measured points.

    Parameters p are the logarithms of kt and mu, the spread, and the mean force and both turning points of the
    displacement, each relative to its measured range.
    """

    x: NDArray
    y: NDArray
    sense: NDArray
    noise: NDArray
    normal: float
    sliders: int

    def branches(self, p: NDArray) -> dict[float, NDArray]:
        """Return the corners (sliders + 2, 2) of both branches by the sign of the velocity."""
        places = (2.0 * np.arange(self.sliders) + 1.0) / self.sliders - 1.0
        low, high = p[4:6] * np.ptp(self.x) + self.x.min()
        slip = 2.0 * np.exp(p[1] - p[0]) * self.normal * (1.0 + p[2] * places)  # from stick to full slip of each slider
        way = np.minimum(np.concatenate([[0.0], slip, [np.inf]]), max(high - low, 0.0))
        drop = np.exp(p[0]) / self.sliders * np.minimum(way[:, None], slip).sum(axis=1)
        middle = self.y.min() + p[3] * np.ptp(self.y)
        fall = np.column_stack([high - way, middle + drop[-1] / 2.0 - drop])
        return {-1.0: fall, 1.0: [low + high, 2.0 * middle] - fall}

    def force(self, p: NDArray) -> NDArray:
        """Return the force (n,) of the branches at the measured displacements."""
        up, down = self.branches(p)[1.0], self.branches(p)[-1.0][::-1]
        return np.where(self.sense > 0.0, np.interp(self.x, *up.T), np.interp(self.x, *down.T))

    def residual(self, p: NDArray) -> NDArray:
        """Return the vectors (2 n,) from the points to the nearest points of their branch, in units of the noise."""
        out, points = np.empty(len(self.x), complex), self.x / self.noise[0] + 1j * self.y / self.noise[1]
        for sense, corners in self.branches(p).items():
            out[self.sense == sense] = _nearest(points[self.sense == sense], corners @ ([1.0, 1j] / self.noise))
        return out.view(float)

    def fitted(self) -> tuple[NDArray, NDArray, NDArray]:
        """Return the best parameters, the residuals (n, 2) and their derivatives (2 n, 6)."""
        limit = np.log(0.5 * np.ptp(np.quantile(self.y, [0.02, 0.98])) / self.normal)
        soft = np.log(np.ptp(self.y) / np.ptp(self.x))
        steps = itertools.product(soft + np.linspace(0.0, 4.0, 9), limit + np.array([0.0, 0.3, 0.7]))
        grid = [np.array([*step, 0.0, 0.5, 0.0, 1.0]) for step in steps]
        bounds = np.array([[-np.inf, -np.inf, 0.0, -1.0, -1.0, 0.5], [np.inf, np.inf, 1.0, 2.0, 0.5, 2.0]])
        tries = []
        for spread in (0.1, 0.5, 0.9) if self.sliders > 1 else (0.0,):
            starts = [p + spread * np.eye(6)[2] for p in grid]
            start = min(starts, key=lambda p: float((self.residual(p) ** 2).sum()))
            origin = start - 1.0  # steps of the differences are relative to the parameters, which are about 1
            found = least_squares(
                lambda q, origin=origin: self.residual(origin + q), start - origin, "3-point", bounds - origin,
                xtol=1e-8, ftol=1e-10, diff_step=DIFFERENCE, max_nfev=ITERATIONS,
            )  # fmt: skip
            tries.append((found.cost, origin + found.x, found.fun.reshape(-1, 2), found.jac))
        return min(tries, key=lambda each: each[0])[1:]


def _nearest(points: NDArray, corners: NDArray) -> NDArray:
    """Return the vectors (n,) from points to the nearest points of a line through corners, all complex numbers."""
    away, along = points[:, None] - corners[:-1], np.diff(corners)
    share = np.clip((away * along.conj()).real / np.maximum(np.abs(along) ** 2, 1e-300), 0.0, 1.0)
    way = share * along - away
    return way[np.arange(len(points)), np.abs(way).argmin(axis=1)]


def read_loop(path: str | Path) -> tuple[NDArray, NDArray]:
    """Displacement (m) and force (N) of a CSV file with these two columns, their units in brackets.

    Raises
    ------
    BdamperError
        If a column is missing, a unit is not known, or a value is not a finite number; the message names the line.
    """
    found = read_columns(path, ("displacement", "force"), units={"displacement": LENGTHS, "force": FORCES})
    return found["displacement"][0], found["force"][0]
