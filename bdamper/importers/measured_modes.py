"""Measured frequency and damping of a mode over its amplitude, from tables and from free decays.

Rigs under phase control measure such points directly. A free decay contains them as well: at each
time the amplitude falls at a rate that is the product of damping ratio and angular frequency.
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
from bdamper.util import quantities, validation
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
        NaN if not measured. Under phase control the damping ratio is force over twice modal mass
        times acceleration.
    preload : float, N
    mode : int
        Number of the mode, as in :meth:`bdamper.Study.nonlinear_mode`.
    noise : float, optional
        Relative standard deviation of the frequencies. By default the noise of a fit times the
        damping ratio; the mean of the damping ratios replaces missing values.
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
        units = {"amplitude": "m", "frequency": "Hz", "damping_ratio": "", "preload": "N"}
        for field, unit in units.items():
            validation.check_attributes(self, quantities.in_lists, field, unit=unit)
        n_points = len(self.amplitude)
        for name in ("amplitude", "frequency", "damping_ratio"):
            values = np.asarray(getattr(self, name), float)
            complete = n_points > 0 and values.shape == (n_points,)
            check(complete, self.source, f"{name} of each point", f"{values.shape}")
            good = values > 0.0
            if name != "amplitude":
                good |= np.isnan(values)
            check_all(good, values, f"{name} above 0", self.source)
        if self.noise is not None:
            validation.number("noise", self.noise, above=0.0, below=1.0)
            return
        has_damping = not np.isnan(self.damping_ratio).all()
        expected = "noise of the frequencies where no damping ratio is measured"
        check(has_damping, self.source, expected, "none")


@validation.check_arguments
def read_mode(
    path: str | PathLike[str] | Mapping[str, Any], *, name: str | None = None, **conditions: Any
) -> MeasuredMode:
    """Read frequency and damping ratio of a mode over its amplitude.

    Parameters
    ----------
    path : path-like, or mapping of header to values
        Columns ``amplitude`` (displacement, velocity or acceleration), ``frequency (Hz)`` and
        ``damping ratio (%)``, which may be missing if ``noise`` is given.
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
        If a column or its unit is missing, or a value is not a finite number. The message names the
        line.
    """
    units = {"amplitude": None, "frequency": HERTZ, "damping ratio": RATIOS}
    every = ("amplitude", "frequency", "damping ratio")
    without_damping = ("amplitude", "frequency")
    may_be_blank = ("frequency", "damping ratio")
    columns = read_columns(
        path, every, without_damping, units=units, blank=may_be_blank, signed=False
    )
    measured, unit = columns["amplitude"]
    frequency, _ = columns["frequency"]
    if "damping ratio" in columns:
        damping_ratio, _ = columns["damping ratio"]
    else:
        damping_ratio = np.full(len(measured), np.nan)
    source = name or _name_of(path)
    # velocity or acceleration is the displacement times a power of the angular frequency
    factor, order = motion_unit(source, unit)
    amplitude = factor * measured / (2.0 * np.pi * frequency) ** order
    return MeasuredMode(amplitude, frequency, damping_ratio, source=source, **conditions)


def _name_of(path: str | PathLike[str] | Mapping[str, Any]) -> str:
    """Return the name of a file without its ending, or "table"."""
    return "table" if hasattr(path, "keys") else Path(str(path)).stem


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
        Columns ``time (s)``, with constant steps, and ``amplitude`` (displacement, velocity or
        acceleration) of one mode.
    periods : float, optional
        Length of the windows in periods; by default a twentieth of the record, at least 4.
    name : str, optional
        Name in results; by default the name of the file.
    **conditions
        ``preload``, ``mode`` and ``noise`` of :class:`MeasuredMode`.

    Returns
    -------
    MeasuredMode
        One point for each window, until noise deforms the decay: until the amplitude rises, or
        deviates by more than 5 % from the line.

    Notes
    -----
    The modulus of the analytic signal (Hilbert transform, :func:`scipy.signal.hilbert`) is the
    amplitude :math:`A(t)`, and the derivative of its phase is the damped frequency
    :math:`\omega_d`. Both follow from straight lines through :math:`\ln A` and the phase in each
    window (least squares). With the decay rate :math:`\delta = -d \ln A/dt` the frequency is
    :math:`\omega = (\omega_d^2 + \delta^2)^{1/2}`, and the damping ratio :math:`\delta/\omega`.
    Since the transform is periodic, the record is continued by its mirror image, and the first and
    last window are left out.
    """
    columns = read_columns(path, ("time", "amplitude"), units={"time": TIMES, "amplitude": None})
    time, _ = columns["time"]
    motion, unit = columns["amplitude"]
    source = name or _name_of(path)
    factor, order = motion_unit(source, unit)
    step = float(time[-1] - time[0]) / max(len(time) - 1, 1)
    constant = len(time) > 2 and np.ptp(np.diff(time)) < 0.01 * step
    check(constant, source, "times with a constant step", "others")
    # the mean over the last quarter is the offset of the sensor
    motion = factor * (motion - motion[-len(motion) // 4 :].mean())
    mirrored = np.append(motion[::-1], motion)
    signal = scipy.signal.hilbert(mirrored)[len(motion) :]
    log_amplitude = np.log(np.maximum(np.abs(signal), 1e-300))
    phase = np.unwrap(np.angle(signal))
    if periods is None:
        periods = max(4.0, (phase[-1] - phase[0]) / (40.0 * np.pi))
    window = 2.0 * np.pi * validation.number("periods", periods, least=1.0)
    edges = np.searchsorted(phase, np.arange(phase[0] + window, phase[-1] - window, window))
    # logarithm of the amplitude, decay rate and natural frequency of each window
    lines = []
    for start, end in zip(edges, edges[1:]):
        from_middle = time[start:end] - time[start:end].mean()
        coefficients, squares, *_ = np.polyfit(from_middle, log_amplitude[start:end], 1, full=True)
        slope, level = coefficients
        square, *_ = squares
        damped = np.polyfit(from_middle, phase[start:end], 1)[0]
        is_straight = square < STRAIGHT**2 * (end - start)
        if not (slope < 0.0 and is_straight):
            break
        lines.append((level, -slope, float(np.hypot(damped, slope))))
    expected = f"a decay over more than {3.0 * periods:.3g} periods"
    check(bool(lines), source, expected, f"none in {len(time)} samples")
    level, decay_rate, omega = np.array(lines).T
    return MeasuredMode(
        np.exp(level) / omega**order,
        omega / (2.0 * np.pi),
        decay_rate / omega,
        source=source,
        **conditions,
    )
