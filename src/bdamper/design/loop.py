r"""Contact stiffness and friction from measured hysteresis loops.

The contact is n sliders side by side, each a spring :math:`k_t/n` with a friction limit :math:`\mu_i N/n`; the
coefficients are the middles of n equal parts between :math:`\mu(1-s)` and :math:`\mu(1+s)`, so that a spread s > 0 rounds
the corners of the loop.  With one slider the whole loop has to do with two straight lines, and a contact that slips point
after point seems softer than it is.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from bdamper.design.fit import deviations
from bdamper.io.measured import FORCES, LENGTHS, read_columns
from bdamper.util import validate
from bdamper.util.plotting import Plottable
from bdamper.util.repr import brief
from bdamper.util.text import amount, percent


@brief
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
        s above: half the width of the even distribution of the friction limits, over their mean.
    deviation : (3,) float
        Standard deviations of these, with the residual as noise.
    misfit : float
        Root mean square of the residual over that of the force.
    sliders : int
    displacement, force, model : (n,) float
        m, N, N; the measured force without its mean.
    """

    kt: float
    mu: float
    spread: float
    deviation: NDArray
    misfit: float
    sliders: int
    displacement: NDArray
    force: NDArray
    model: NDArray
    _told = ("kt", "mu", "spread", "misfit")

    def bottom_line(self) -> str:
        kt, mu, spread = self.deviation
        return (
            f"Tangential stiffness {amount(self.kt, 'N/m')} (deviation {amount(kt, 'N/m')}), friction coefficient "
            f"{self.mu:.3g} ({mu:.2g}), spread of the limits {self.spread:.2g} ({spread:.2g}); misfit "
            f"{percent(self.misfit)} of the force."
        )


def sliding_force(displacement: NDArray, kt: float, limits: NDArray) -> NDArray:
    """Force (N) of sliders side by side over a closed history of displacement (m), after it has repeated itself.

    Parameters
    ----------
    displacement : (n,) float
    kt : float, N/m
        Of all sliders together.
    limits : (n_sliders,) float, N
        Of each.
    """
    spring, stretch = kt / len(limits), np.zeros(len(limits))
    reach, out = limits / spring, np.empty(len(displacement))
    before = displacement[0]
    # passes through a measured loop, of which the last counts: the first brings the sliders to where they would be
    cycles = 2
    for _ in range(cycles):
        for i, x in enumerate(displacement):
            stretch = np.clip(stretch + x - before, -reach, reach)
            before, out[i] = x, spring * stretch.sum()
    return out


@validate.spelt
def fit_loop(displacement: NDArray, force: NDArray, *, normal: float, sliders: int = 20) -> FittedLoop:
    """Contact stiffness, friction coefficient and its spread from one period of a measured loop.

    Parameters
    ----------
    displacement : (n,) float, m
        Relative, in the order of time; its first and last point are neighbours.
    force : (n,) float, N
        Tangential.
    normal : float, N
        Constant normal load.
    sliders : int
        1 for an element that slips at once.

    Raises
    ------
    SettingError
        If there are fewer than ten points, or no slip is seen: then friction is not known.
    """
    x, y = validate.numbers("displacement", displacement), validate.numbers("force", force)
    expected = "ten or more displacements and as many forces"
    validate.require(len(x) == len(y) >= 10, "loop", expected, f"{len(x)} and {len(y)}")
    normal = validate.number("normal", normal, above=0.0, unit="N")
    sliders = validate.whole("sliders", sliders, least=1)
    y = y - 0.5 * (y.max() + y.min())
    area = abs(float(y @ (np.roll(x, -1) - np.roll(x, 1)))) / 2.0
    sticks = 0.02  # area of a loop over that of the rectangle around it up to which it says nothing of friction
    slips = area > sticks * np.ptp(x) * np.ptp(y)
    validate.require(slips, "loop", "slip, without which friction is not known", "a loop that sticks")
    steps = np.abs(np.diff(x)) > 1e-12 * np.ptp(x)
    slope = float(np.quantile(np.abs(np.diff(y)[steps] / np.diff(x)[steps]), 0.9))
    places = (2.0 * np.arange(sliders) + 1.0) / sliders - 1.0

    def model(p: NDArray) -> NDArray:
        limits = np.exp(p[1]) * normal / sliders * (1.0 + (p[2] if sliders > 1 else 0.0) * places)
        force = sliding_force(x, float(np.exp(p[0])), limits)
        return force + p[3]

    spreads = (0.1, 0.5, 0.9)  # spreads from which the search begins
    starts = [np.array([np.log(slope), np.log(np.abs(y).max() / normal), s, 0.0]) for s in spreads]
    bounds: Any = ([-np.inf, -np.inf, 0.0, -np.inf], [np.inf, np.inf, 1.0, np.inf])
    size = float(np.sqrt(np.mean(y**2)))
    tries = starts if sliders > 1 else starts[:1]
    solved = [least_squares(lambda p: (model(p) - y) / size, start, bounds=bounds, xtol=1e-12) for start in tries]
    best = min(solved, key=lambda found: found.cost)
    p = best.x
    kt, mu, spread = float(np.exp(p[0])), float(np.exp(p[1])), float(p[2]) if sliders > 1 else 0.0
    scatter = 2.0 * best.cost / max(len(x) - len(p), 1)
    deviation = np.sqrt(scatter) * deviations(best.jac)[:3] * [kt, mu, float(sliders > 1)]
    return FittedLoop(kt, mu, spread, deviation, float(np.sqrt(2.0 * best.cost / len(x))), sliders, x, y, model(p))


def read_loop(path: str | Path) -> tuple[NDArray, NDArray]:
    """Displacement (m) and force (N) of a CSV file with these two columns, their units in brackets.

    Raises
    ------
    BdamperError
        If a column is missing, a unit is not known, or a value is not a finite number; the message names the line.
    """
    found = read_columns(path, ("displacement", "force"), units={"displacement": LENGTHS, "force": FORCES})
    return found["displacement"][0], found["force"][0]
