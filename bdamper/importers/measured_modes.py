"""Measured frequency and damping of a mode over its amplitude, from tables and from free decays.

Rigs under phase control measure such points directly. A free decay contains them as well: at each time the amplitude falls
at a rate that is the product of damping ratio and angular frequency.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
import scipy  # scipy.signal loads on first use
from numpy.typing import NDArray

from bdamper.importers.measurements import HERTZ, motion_unit, read_columns
from bdamper.util import validation
from bdamper.util.errors import check
from bdamper.util.formatting import short_repr
from bdamper.util.records import check_all

STRAIGHT = 0.05
"""Relative deviation of the amplitude of a decay from a line, from which noise determines it."""
TIMES = {"s": 1.0, "ms": 1e-3}
"""Units of time in seconds."""
RATIOS = {"%": 0.01, "-": 1.0, "1": 1.0}
"""Units of a ratio.  A column without unit can be either."""


@short_repr
@dataclass(frozen=True)
class MeasuredMode:
    """Measured frequency and damping ratio of a mode over the amplitude of its vibration.

    Parameters
    ----------
    amplitude : (n,) float, m
        Amplitude at the response location of the study.
    frequency, damping_ratio : (n,) float, Hz and 1
        NaN if not measured. Under phase control the damping ratio is force over twice modal mass times acceleration.
    preload : float, N
    mode : int
        Number of the mode, as in :meth:`bdamper.Study.nonlinear_mode`.
    noise : float, optional
        Relative standard deviation of the frequencies. By default the noise of a fit times the damping ratio; the mean of
        the damping ratios replaces missing values.
    source : str
        Name in results.

    Raises
    ------
    ModelError
        If the arrays are empty, differ in length, or contain values that are not positive.
    """

    amplitude: NDArray
    frequency: NDArray
    damping_ratio: NDArray
    preload: float = 0.0
    mode: int = 1
    noise: float | None = None
    source: str = "mode"

    def __post_init__(self) -> None:
        n = len(self.amplitude)
        for name in ("amplitude", "frequency", "damping_ratio"):
            values = np.asarray(getattr(self, name), float)
            check(
                n > 0 and values.shape == (n,),
                self.source,
                f"{name} of each point",
                f"{values.shape}",
            )
            check_all(
                (values > 0.0) | (np.isnan(values) & (name != "amplitude")),
                values,
                f"{name} above 0",
                self.source,
            )
        unknown = self.noise is None and bool(np.isnan(self.damping_ratio).all())
        check(
            not unknown,
            self.source,
            "noise of the frequencies where no damping ratio is measured",
            "none",
        )
        if self.noise is not None:
            validation.number("noise", self.noise, above=0.0, below=1.0)


@validation.check_arguments
def read_mode(
    path: str | PathLike[str] | Mapping[str, Any], *, name: str | None = None, **conditions: Any
) -> MeasuredMode:
    """Read frequency and damping ratio of a mode over its amplitude.

    Parameters
    ----------
    path : path-like, or mapping of header to values
        Columns ``amplitude`` (displacement, velocity or acceleration), ``frequency (Hz)`` and ``damping ratio (%)``, which
        may be missing if ``noise`` is given.
    name : str, optional
        Name in results; by default the name of the file.
    **conditions
        ``preload``, ``mode`` and ``noise`` of :class:`MeasuredMode`.

    Returns
    -------
    MeasuredMode

    Raises
    ------
    BdamperError
        If a column or its unit is missing, or a value is not a finite number. The message names the line.
    """
    units = {"amplitude": None, "frequency": HERTZ, "damping ratio": RATIOS}
    every = tuple(units)
    found = read_columns(path, every, every[:2], units=units, blank=every[1:], signed=False)
    amplitude, frequency = found["amplitude"][0], found["frequency"][0]
    source = name or ("table" if hasattr(path, "keys") else Path(str(path)).stem)
    factor, order = motion_unit(source, found["amplitude"][1])
    damping = (
        found["damping ratio"][0] if "damping ratio" in found else np.full(len(amplitude), np.nan)
    )
    return MeasuredMode(
        factor * amplitude / (2.0 * np.pi * frequency) ** order,
        frequency,
        damping,
        source=source,
        **conditions,
    )


@validation.check_arguments
def read_ring_down(
    path: str | PathLike[str] | Mapping[str, Any],
    *,
    periods: float | None = None,
    name: str | None = None,
    **conditions: Any,
) -> MeasuredMode:
    r"""Return frequency and damping ratio over amplitude from a free decay.

    Parameters
    ----------
    path : path-like, or mapping of header to values
        Columns ``time (s)``, with constant steps, and ``amplitude`` (displacement, velocity or acceleration) of one mode.
    periods : float, optional
        Length of the windows in periods; by default a twentieth of the record, at least 4.
    name : str, optional
        Name in results; by default the name of the file.
    **conditions
        ``preload``, ``mode`` and ``noise`` of :class:`MeasuredMode`.

    Returns
    -------
    MeasuredMode
        One point for each window, until noise deforms the decay: until the amplitude rises, or deviates by more than 5 %
        from the line.

    Notes
    -----
    The modulus of the analytic signal (Hilbert transform, :func:`scipy.signal.hilbert`) is the amplitude :math:`A(t)`, and
    the derivative of its phase is the damped frequency :math:`\omega_d`. Both follow from straight lines through
    :math:`\ln A` and the phase in each window (least squares). With the decay rate :math:`\delta = -d \ln A/dt` the
    frequency is :math:`\omega = (\omega_d^2 + \delta^2)^{1/2}`, and the damping ratio :math:`\delta/\omega`. Since the
    transform is periodic, the record is continued by its mirror image, and the first and last window are left out.
    """
    found = read_columns(path, ("time", "amplitude"), units={"time": TIMES, "amplitude": None})
    (t, _), (x, unit) = found["time"], found["amplitude"]
    source = name or ("table" if hasattr(path, "keys") else Path(str(path)).stem)
    factor, order = motion_unit(source, unit)
    step = float(t[-1] - t[0]) / max(len(t) - 1, 1)
    check(
        len(t) > 2 and np.ptp(np.diff(t)) < 0.01 * step,
        source,
        "times with a constant step",
        "others",
    )
    x = factor * (x - x[-len(x) // 4 :].mean())
    signal = scipy.signal.hilbert(np.append(x[::-1], x))[len(x) :]
    log, phase = np.log(np.maximum(np.abs(signal), 1e-300)), np.unwrap(np.angle(signal))
    periods = max(4.0, (phase[-1] - phase[0]) / (40.0 * np.pi)) if periods is None else periods
    turn = 2.0 * np.pi * validation.number("periods", periods, least=1.0)
    edges = np.searchsorted(phase, np.arange(phase[0] + turn, phase[-1] - turn, turn))
    lines = []
    for a, b in zip(edges, edges[1:]):
        from_middle = t[a:b] - t[a:b].mean()
        (fall, level), (square, *_), *_ = np.polyfit(from_middle, log[a:b], 1, full=True)
        speed = np.polyfit(from_middle, phase[a:b], 1)[0]
        if not (fall < 0.0 and square < STRAIGHT**2 * (b - a)):
            break
        lines.append((level, -fall, float(np.hypot(speed, fall))))
    check(
        bool(lines),
        source,
        f"a decay over more than {3.0 * periods:.3g} periods",
        f"none in {len(t)} samples",
    )
    level, decay, omega = np.array(lines).T
    return MeasuredMode(
        np.exp(level) / omega**order,
        omega / (2.0 * np.pi),
        decay / omega,
        source=source,
        **conditions,
    )
