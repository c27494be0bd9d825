"""Optimal curve of a wheel: its highest blade over the preload, beside the tuned peak."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from bdamper.util import validate
from bdamper.util.cost import CostMeter
from bdamper.util.hdf5 import Storable
from bdamper.util.plotting import Plottable
from bdamper.util.repr import brief
from bdamper.util.status import Statuses
from bdamper.util.tables import Hertz, Metres, Newtons, Numbers, Quantity, Resonance, Tabular
from bdamper.util.text import amount
from bdamper.wheel.peak import WheelPeakOptions, peak
from bdamper.wheel.results import OfWheel
from bdamper.wheel.wheel_problem import WheelProblem


@brief
@dataclass(frozen=True)
class WheelOptimalCurve(OfWheel, Plottable, Tabular, Storable, kind="bdamper-wheel-optimal-curve"):
    """Highest amplitude of any blade over the preload.

    ``plot`` draws it beside the tuned wheel (:func:`bdamper.plot.plot_wheel_optimal`).

    Parameters
    ----------
    preload : (n,) float, N
    frequency, amplitude : (n,) float, Hz and m
        NaN where no peak was found.
    blade : (n,) int
        -1 where no peak was found.
    tuned_amplitude : (n,) float, m
    status, reason : tuple of str
        Of each preload.
    residual : (n,) float
    springs, error : (n,) float
        On the mean of dampers, 0 where they are free, and the error of the amplitude that they leave
        (:class:`~bdamper.wheel.results.WheelPeak`).
    """

    preload: Newtons
    frequency: Hertz
    amplitude: Resonance
    blade: Numbers
    tuned_amplitude: Metres
    status: Annotated[Statuses, Quantity()]
    reason: tuple[str, ...]
    residual: Numbers
    springs: Numbers
    error: Numbers

    def __len__(self) -> int:
        return len(self.preload)

    @property
    def amplification(self) -> NDArray:
        """(n,) float: amplitude over that of the tuned wheel at the same preload."""
        return self.amplitude / self.tuned_amplitude

    @property
    def candidates(self) -> NDArray:
        """Numbers of the preloads that may have the lowest highest blade, whatever dampers held leave open (``error``).

        The first is that with the least of what its amplitude may be at most, ``amplitude (1 + error)``; the others may be
        lower.  Preloads without a peak are none of them.
        """
        most, least = self.amplitude * (1.0 + self.error), self.amplitude * (1.0 - self.error)
        if np.isnan(most).all():
            return np.zeros(0, int)
        first = int(np.nanargmin(most))
        others = np.flatnonzero(least < most[first])
        return np.append(first, others[others != first])

    @property
    def best(self) -> int | None:
        """Number of the preload at which the highest blade is lowest, among those computed; None where that is open."""
        return int(self.candidates[0]) if len(self.candidates) == 1 else None

    def bottom_line(self) -> str:
        i = self.best
        if i is None:
            open_ = " or ".join(amount(self.preload[k], "N") for k in np.sort(self.candidates))
            return f"Errors leave open which preload is best: {open_}." if open_ else "No preload has a peak."
        top = f"{amount(self.amplitude[i], 'm')} (number {self.blade[i]})"
        tuned = f"{self.amplification[i]:.3g} times the tuned wheel"
        return f"The highest blade is lowest at {amount(self.preload[i], 'N')} of {len(self)} preloads: {top}, {tuned}."


@validate.spelt
def optimal_curve(
    wheel: WheelProblem, preloads: Sequence[float], *, options: WheelPeakOptions | None = None
) -> WheelOptimalCurve:
    """Highest amplitude of any blade at each of several preloads, every one searched for anew.

    Parameters
    ----------
    wheel : Wheel
    preloads : sequence of float, N
    options : WheelPeakOptions

    Returns
    -------
    WheelOptimalCurve
    """
    values = validate.numbers("preloads", preloads, above=0.0, unit="N")
    meter = CostMeter(time.perf_counter())
    found = [peak(wheel, float(preload), options=options) for preload in values]
    for one in found:
        meter.add(one.cost)
    columns: dict[str, Any] = {
        name: np.array([getattr(p, name) for p in found])
        for name in ("frequency", "blade", "tuned_amplitude", "residual", "springs", "error")
    }
    return WheelOptimalCurve(
        preload=values,
        amplitude=np.array([p.amplitude if p.found else np.nan for p in found]),
        status=tuple(p.status for p in found),
        reason=tuple(p.reason for p in found),
        **columns,
        cost=meter.read(time.perf_counter()),
        **wheel.record(),
    )
