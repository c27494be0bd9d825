"""Root of a scalar function in an interval with a sign change.

The next trial is the zero of the inverse interpolation polynomial through the last four points at most.  If their values
are not monotonic, or the zero lies outside the bracket, the trial is the secant through the ends of the bracket.  The value
at an end that remains twice is then reduced, so that both ends of the bracket move [1]_.  If a trial is not below
half the value that it replaces, the next trial is the midpoint.  If the function jumps through zero, the root is the jump.

The search stops if the secant step through the last two trials on one side is within the tolerance, regardless of the
width of the bracket.  A secant across the root would mistake a jump for a root nearby.

References
----------
.. [1] N. Anderson, A. Bjoerck, BIT 13 (1973), 253-264.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from typing import NamedTuple

import numpy as np


class Root(NamedTuple):
    """Result of a root search.

    Parameters
    ----------
    at, value : float
        Last trial and the function there.
    step : float
        Estimated error of ``at``: secant step through the last two trials on one side, at most the width of the bracket.
    trials : int
        Number of function evaluations.
    """

    at: float
    value: float
    step: float
    trials: int


def find_root(
    function: Callable[[float], float], low: tuple[float, float], high: tuple[float, float], tolerance: float,
    most_trials: int = 80,
) -> Root:  # fmt: skip
    """Find the root of a function within a bracket.

    Parameters
    ----------
    function : callable
        Scalar function, which may jump; it is evaluated at least once.
    low, high : (x, value)
        Ends of the bracket in ascending order, with values of different signs.
    tolerance : float
        Absolute tolerance of the root.
    most_trials : int

    Returns
    -------
    Root

    Raises
    ------
    ValueError
        If the values at the ends have the same sign.
    """
    trials = root_trials(low, high, tolerance, most_trials)
    at = next(trials)
    while True:
        try:
            at = trials.send(function(at))
        except StopIteration as found:
            root: Root = found.value
            return root


def root_trials(
    low: tuple[float, float], high: tuple[float, float], tolerance: float, most_trials: int = 80
) -> Generator[float, float, Root]:
    """Yield the trials of :func:`find_root` and receive the function values by ``send``.

    The caller evaluates the function, so that the search calls nothing.
    """
    (a, f_a), (b, f_b) = low, high
    if f_a * f_b > 0.0:
        raise ValueError(f"a bracket needs values of different signs at its ends, found {f_a:g} and {f_b:g}")
    sign = 1.0 if f_b > f_a else -1.0
    true_a, true_b = f_a, f_b  # f_a and f_b may be reduced for the secant
    fixed = ""  # end of the bracket that did not move in the previous trial
    known = [low, high]
    x = _secant(a, f_a, b, f_b)
    for trials in range(1, most_trials + 1):
        at, f = x, (yield x)
        known.append((at, f))
        if sign * f < 0.0:
            moved, before = at - a, true_a
            f_b *= _weight(f, true_a) if fixed == "b" else 1.0
            a, f_a, true_a, fixed = at, f, f, "b"
        else:
            moved, before = b - at, true_b
            f_a *= _weight(f, true_b) if fixed == "a" else 1.0
            b, f_b, true_b, fixed = at, f, f, "a"
        step = min(abs(f * moved / (before - f)) if f != before else np.inf, b - a)
        if step <= tolerance or f == 0.0:
            break
        x = 0.5 * (a + b)
        if abs(f) <= 0.5 * abs(before):
            x = _zero_of_inverse(sorted(known[-4:]))
            x = x if a < x < b else _secant(a, f_a, b, f_b)
    return Root(at, f, step, trials)


def _weight(new: float, old: float) -> float:
    """Return the factor for the value at the end that remains, from the values at the end that moves."""
    return 1.0 - new / old if abs(new) < abs(old) else 0.5


def _secant(a: float, f_a: float, b: float, f_b: float) -> float:
    """Return the root of the line through two points; the midpoint if rounding places it outside."""
    x = (a * f_b - b * f_a) / (f_b - f_a) if f_b != f_a else a
    return x if a < x < b else 0.5 * (a + b)


def _zero_of_inverse(known: list[tuple[float, float]]) -> float:
    """Return the zero of the inverse interpolation polynomial (Neville); NaN if the values are not monotonic."""
    x, f = [at for at, _ in known], np.array([value for _, value in known])
    rises = np.diff(f)
    if not ((rises > 0.0).all() or (rises < 0.0).all()):
        return np.nan
    for width in range(1, len(x)):
        x = [(f[i + width] * x[i] - f[i] * x[i + 1]) / (f[i + width] - f[i]) for i in range(len(x) - 1)]
    return float(x[0])
