"""Measured frequency and damping of a mode as functions of its amplitude, from tables and from free
decays.

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
from bdamper.util.errors import check, check_sentence, warn
from bdamper.util.formatting import short_repr
from bdamper.util.records import check_all

STRAIGHT_DECAY = 0.05
"""Relative deviation of the amplitude of a decay from a line, from which noise determines it."""
FLANK = 0.2
"""Width over which the filter of a band falls, relative to its width or its lower end."""
RINGING = 1.0
"""Time after the blow that is left out because the filter rings, times the width of a flank."""
DIGITS = 10.0
"""Distance between a peak and its neighbours, in digits of the record, from which it is clipped."""
EQUAL_SAMPLES, EQUAL_PEAKS = 3, 5
"""Equal samples in a row, or peaks of equal height, from which a record is clipped."""
WEAKEST, ABOVE_NOISE, VALLEY = 0.01, 8.0, 8.0
"""Height of a mode in the spectrum, relative to the largest one, the median and the valley beside it."""
MOST_MODES = 6
"""Number of modes that a message names."""
LEAST_SAMPLES = 4
"""Samples of the shortest window: a line through fewer has no deviation to judge it by."""
FAR = 3.0
"""Fall of the amplitude above which a decay that other modes end is returned, with a warning."""
TIMES = {"s": 1.0, "ms": 1e-3}
"""Units of time in seconds."""
RATIOS = {"%": 0.01, "-": 1.0, "1": 1.0}
"""Units of a ratio.  A column without unit can be either."""


@short_repr
@dataclass(frozen=True)
class MeasuredMode:
    """Measured frequency and damping ratio of a mode as functions of its amplitude.

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
        Relative standard deviation of the frequencies. By default, the noise of a fit times the
        damping ratio; missing damping ratios are replaced by the mean.
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
        expected = "a noise of the frequency at each point without a measured damping ratio"
        check(has_damping, self.source, expected, "no damping")


@validation.check_arguments
def read_mode(
    path: str | PathLike[str] | Mapping[str, Any], *, name: str | None = None, **conditions: Any
) -> MeasuredMode:
    """Read frequency and damping ratio of a mode as functions of its amplitude.

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
        If a column or its unit is missing, or a value is not a finite number. The message gives the
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
    """Return the name of a file without its extension, or "table"."""
    return "table" if hasattr(path, "keys") else Path(str(path)).stem


@validation.check_arguments
def read_ring_down(
    path: str | PathLike[str] | Mapping[str, Any],
    *,
    band: tuple[float, float] | None = None,
    periods: float | None = None,
    name: str | None = None,
    **conditions: Any,
) -> MeasuredMode:
    r"""Return frequency and damping ratio as functions of amplitude from a free decay.

    Parameters
    ----------
    path : path-like, or mapping of header to values
        Columns ``time (s)``, with constant steps, and ``amplitude`` (displacement, velocity or
        acceleration). Samples before the largest amplitude are omitted.
    band : (2,) float, Hz, optional
        Lowest and highest frequency that is evaluated: the band of one mode if an impact excites
        several.
    periods : float, optional
        Length of the windows in periods; by default a twentieth of the record, at least 4.
    name : str, optional
        Name in results; by default the name of the file.
    **conditions
        ``preload``, ``mode`` and ``noise`` of :class:`MeasuredMode`.

    Returns
    -------
    MeasuredMode
        One point for each window, until noise distorts the decay: until the amplitude rises, or
        deviates by more than 5 % from the line.

    Raises
    ------
    BdamperError
        If the record has no decay. If it has several modes, the message gives their frequencies and
        a band for each.

    Warns
    -----
    BdamperWarning
        If peaks of the record are clipped, in which case only the decay after the last of them is
        evaluated, or if the evaluation ends early because the record has several modes.

    Notes
    -----
    The modulus of the analytic signal (Hilbert transform, :func:`scipy.signal.hilbert`)
    is the amplitude :math:`A(t)`, and the derivative of its phase is the damped frequency
    :math:`\omega_d`. Both follow from straight lines through :math:`\ln A` and the phase in each
    window (least squares). With the decay rate :math:`\delta = -d \ln A/dt` the frequency is
    :math:`\omega = (\omega_d^2 + \delta^2)^{1/2}`, and the damping ratio :math:`\delta/\omega`.
    Since the transform is periodic, the record is continued by its mirror image, and the first and
    last windows are omitted. A band is a zero-phase filter: its factor on the spectrum is 1 inside
    the band, and falls to 0 on both sides over a fifth of the band width, at most a fifth of its
    lower end. The transient of this filter after the impact is also omitted.
    """
    columns = read_columns(path, ("time", "amplitude"), units={"time": TIMES, "amplitude": None})
    time, _ = columns["time"]
    motion, unit = columns["amplitude"]
    source = name or _name_of(path)
    factor, order = motion_unit(source, unit)
    step = float(time[-1] - time[0]) / max(len(time) - 1, 1)
    constant = len(time) > 2 and np.ptp(np.diff(time)) < 0.01 * step
    check_sentence(constant, source, "the time step must be constant")
    if band is not None:
        band = _band(band, step)
    behind = _end_of_clipping(motion)
    if behind > 0:
        warn(
            f"{source}: peaks up to {time[behind - 1]:.4g} s are clipped at "
            f"{np.abs(motion).max():.4g} {unit}; the decay is read from there on"
        )
    time, motion = time[behind:], motion[behind:]
    check_sentence(
        len(motion) > 2, source, "the record ends before the decay: all peaks are clipped"
    )
    # the mean over the last quarter is the offset of the sensor
    motion = factor * (motion - motion[-len(motion) // 4 :].mean())
    signal = _analytic(motion, step, band)
    # the decay begins at the largest amplitude
    first = int(np.argmax(np.abs(signal)))
    phase_before = np.unwrap(np.angle(signal[: first + 1]))
    if np.ptp(phase_before) < 2.0 * np.pi:
        # within the first period, which suffers from the transform: the record begins with the
        # decay
        first = 0
    if band is not None:
        first = min(first + int(RINGING / (_flank(band) * step)), len(time) - 1)
    lines, ends_early, window = _lines(time[first:], signal[first:], periods)
    # empty arrays without lines, which is an error below
    level, decay_rate, omega = np.array(lines).reshape(-1, 3).T
    falls_far = len(lines) > 0 and level[-1] < level[0] - np.log(FAR)
    modes = _modes(motion, step, band) if ends_early else []
    if len(modes) > 1:
        bands = " or ".join(_proposed(modes, k) for k in range(len(modes)))
        found = f"modes at {', '.join(f'{each:.5g}' for each in modes)} Hz; read one with {bands}"
        check(falls_far, source, "a decay of one mode", found)
        warn(f"{source}: other modes end the decay: {found}")
    expected = f"a decay over more than {3.0 * window:.3g} periods"
    check(bool(lines), source, expected, f"none in {len(time)} samples")
    frequency = omega / (2.0 * np.pi)
    if band is not None:
        inside = (band[0] <= frequency) & (frequency <= band[1])
        check_all(
            inside, frequency, f"frequencies in the band from {band[0]:g} to {band[1]:g} Hz", source
        )
    # of the displacement: each derivative over time is a factor omega
    amplitude = np.exp(level) / omega**order
    return MeasuredMode(
        amplitude=amplitude,
        frequency=frequency,
        damping_ratio=decay_rate / omega,
        source=source,
        **conditions,
    )


def _band(band: tuple[float, float], step: float) -> tuple[float, float]:
    """Return a band (Hz), below half of the sampling rate."""
    low, high = validation.interval("band", band)
    validation.number("upper end of band", high, most=0.5 / step, unit="Hz")
    return low, high


def _flank(band: tuple[float, float]) -> float:
    """Return the width (Hz) over which the filter of a band falls to zero on both sides."""
    low, high = band
    return FLANK * min(high - low, low)


def _end_of_clipping(motion: NDArray) -> int:
    """Return the index after the last clipped sample; 0 for a record without clipping.

    Samples of a clipped peak are equal, and their neighbours are lower by many digits of the
    record. The digits of a coarse record also make samples of a smooth peak equal, but those
    neighbours are lower by one or two digits.
    """
    values = np.unique(motion)
    if len(values) < 2:
        return 0
    # the smallest difference of two samples, a digit of the record
    digit = float(np.diff(values).min())
    end_of_clipping = 0
    # clipping at the top, then at the bottom
    for side in (motion, -motion):
        highest = side.max()
        is_highest = side == highest
        # the first sample of each run of highest samples, and the sample after it: (n_runs, 2)
        changes = np.diff(np.r_[False, is_highest, False].astype(int))
        start, end = np.flatnonzero(changes).reshape(-1, 2).T
        # the higher one of the samples before and after each run
        padded = np.pad(side, 1, constant_values=-np.inf)
        neighbour = np.maximum(padded[start], padded[end + 1])
        is_steep = highest - neighbour > DIGITS * digit
        start = start[is_steep]
        end = end[is_steep]
        lengths = end - start
        is_clipped = len(lengths) >= EQUAL_PEAKS or (lengths >= EQUAL_SAMPLES).any()
        if is_clipped:
            end_of_clipping = max(end_of_clipping, int(end[-1]))
    return end_of_clipping


def _analytic(motion: NDArray, step: float, band: tuple[float, float] | None) -> NDArray:
    """Return the analytic signal of a record, of the frequencies in a band (Hz) if there is one."""
    mirrored = np.append(motion[::-1], motion)
    if band is None:
        signal = scipy.signal.hilbert(mirrored)
    else:
        (low, high), flank = band, _flank(band)
        frequency = np.fft.fftfreq(len(mirrored), step)
        # a flank as a normal distribution rings for the shortest time; at both of its ends it is
        # two standard deviations from its middle
        beyond = np.maximum(low - frequency, frequency - high) / flank
        share = scipy.special.ndtr(4.0 * (0.5 - beyond))
        signal = np.fft.ifft(2.0 * share * np.fft.fft(mirrored))
    return np.asarray(signal[len(motion) :])


def _lines(
    time: NDArray, signal: NDArray, periods: float | None
) -> tuple[list[tuple[float, float, float]], bool, float]:
    """Return the lines through the windows of an analytic signal, until its amplitude is no decay.

    Returns
    -------
    lines : list of (float, float, float)
        Logarithm of the amplitude, decay rate (1/s) and natural angular frequency (rad/s) in the
        middle of each window.
    ends_early : bool
        Whether windows at the end of the record are left out.
    periods : float
        Length of the windows in periods.
    """
    log_amplitude = np.log(np.maximum(np.abs(signal), 1e-300))
    phase = np.unwrap(np.angle(signal))
    if periods is None:
        periods = max(4.0, (phase[-1] - phase[0]) / (40.0 * np.pi))
    periods = validation.number("periods", periods, least=1.0)
    window = 2.0 * np.pi * periods
    edges = np.searchsorted(phase, np.arange(phase[0] + window, phase[-1] - window, window))
    fewest = int(np.diff(edges).min(initial=LEAST_SAMPLES))
    expected = f"windows of at least {LEAST_SAMPLES} samples, for a line through them"
    found = f"{fewest} samples in {periods:g} periods"
    validation.check(fewest >= LEAST_SAMPLES, "periods", expected, found)
    lines: list[tuple[float, float, float]] = []
    for start, end in zip(edges, edges[1:]):
        from_middle = time[start:end] - time[start:end].mean()
        coefficients, squares, *_ = np.polyfit(from_middle, log_amplitude[start:end], 1, full=True)
        slope, level = coefficients
        square, *_ = squares
        damped_frequency, _ = np.polyfit(from_middle, phase[start:end], 1)
        # the mean square of the deviation from the line
        is_straight = square < STRAIGHT_DECAY**2 * (end - start)
        if not (slope < 0.0 and is_straight):
            return lines, True, periods
        natural_frequency = float(np.hypot(damped_frequency, slope))
        lines.append((level, -slope, natural_frequency))
    # a record too short for a window ends early as well
    return lines, not lines, periods


def _modes(motion: NDArray, step: float, band: tuple[float, float] | None) -> list[float]:
    """Return the frequencies (Hz) of the modes in a decay: the peaks of its spectrum in a band."""
    decay = motion[int(np.argmax(np.abs(motion))) :]
    # without this fall, a record that has not decayed at its end has further peaks near each mode
    fall = 0.5 + 0.5 * np.cos(np.pi * np.arange(len(decay)) / len(decay))
    size = np.abs(np.fft.rfft(decay * fall))
    frequency = np.fft.rfftfreq(len(decay), step)
    noise = float(np.median(size))
    if size.max() == 0.0:
        return []
    low, high = band or (0.0, np.inf)
    size = np.where((frequency >= low) & (frequency <= high), size, 0.0)
    least = max(WEAKEST * float(size.max()), ABOVE_NOISE * noise)
    level = np.log(np.maximum(size, 1e-3 * least))
    peaks, _ = scipy.signal.find_peaks(level, height=np.log(least), prominence=np.log(VALLEY))
    largest = peaks[np.argsort(-size[peaks])][:MOST_MODES]
    return [float(each) for each in np.sort(frequency[largest])]


def _proposed(modes: list[float], k: int) -> str:
    """Return the proposal of a band for a mode: half of the way to its neighbours and to zero."""
    others = [0.0, *modes[:k], *modes[k + 1 :]]
    half = 0.5 * min(abs(modes[k] - other) for other in others)
    return f"band=({modes[k] - half:.4g}, {modes[k] + half:.4g})"
