"""A root of a function of one variable between two places where its sign differs.

The next trial is where the polynomial in the value through up to four places known last is zero (inverse interpolation).
Where these are not in order, or it leads out of the bracket, it is the secant through the ends of the bracket, the value at
an end that stays twice reduced so that the bracket closes from both sides (Anderson and Bjoerck, BIT 13 (1973), 253-264).
A function that jumps through zero has its root at the jump; where a trial is not half the value that it replaces, the
middle of the bracket comes next.

The search stops on the step of the secant through the last trial and the one before on the same side: once it is
within the tolerance, the last trial is the root, however wide the bracket still is.  A secant across the root would take a
jump for a root beside it.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from typing import NamedTuple

import numpy as np


class Root(NamedTuple):
    """Result of a search for a root.

    Parameters
    ----------
    at, value : float
        Place of the last evaluation and the function there.
    step : float
        Of the secant through the last two trials on one side, or the bracket if that is less: about the error.
    trials : int
        Evaluations of the function.
    """

    at: float
    value: float
    step: float
    trials: int


def find_root(
    function: Callable[[float], float], low: tuple[float, float], high: tuple[float, float], tolerance: float,
    most_trials: int = 80,
) -> Root:  # fmt: skip
    """Root of a function within a bracket, by secants.

    Parameters
    ----------
    function : callable
        May jump; it is evaluated at least once.
    low, high : (place, value)
        Ends of the bracket in ascending order, with values of different signs.
    tolerance : float
        On the place.
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
    """The same as a generator: yields places and is sent the values of the function there, so that it calls nothing."""
    (a, f_a), (b, f_b) = low, high
    if f_a * f_b > 0.0:
        raise ValueError(f"a bracket needs values of different signs at its ends, found {f_a:g} and {f_b:g}")
    sign = 1.0 if f_b > f_a else -1.0
    true_a, true_b = f_a, f_b  # f_a and f_b are what the secant takes them for
    kept = ""  # the end that stayed in the trial before
    known = [low, high]
    x = _secant(a, f_a, b, f_b)
    for trials in range(1, most_trials + 1):
        at, f = x, (yield x)
        known.append((at, f))
        if sign * f < 0.0:
            moved, before = at - a, true_a
            f_b *= _weight(f, true_a) if kept == "b" else 1.0
            a, f_a, true_a, kept = at, f, f, "b"
        else:
            moved, before = b - at, true_b
            f_a *= _weight(f, true_b) if kept == "a" else 1.0
            b, f_b, true_b, kept = at, f, f, "a"
        step = min(abs(f * moved / (before - f)) if f != before else np.inf, b - a)
        if step <= tolerance or f == 0.0:
            break
        x = 0.5 * (a + b)
        if abs(f) <= 0.5 * abs(before):
            x = _zero_of_inverse(sorted(known[-4:]))
            x = x if a < x < b else _secant(a, f_a, b, f_b)
    return Root(at, f, step, trials)


def _weight(new: float, old: float) -> float:
    """Factor on the value at the end that stays, from the values at the other end that moves."""
    return 1.0 - new / old if abs(new) < abs(old) else 0.5


def _secant(a: float, f_a: float, b: float, f_b: float) -> float:
    """Root of the line through two points whose values differ in sign; the middle if rounding puts it outside."""
    x = (a * f_b - b * f_a) / (f_b - f_a) if f_b != f_a else a
    return x if a < x < b else 0.5 * (a + b)


def _zero_of_inverse(known: list[tuple[float, float]]) -> float:
    """Value at zero of the polynomial that gives the place by the function (Neville); NaN if the function turns."""
    x, f = [at for at, _ in known], np.array([value for _, value in known])
    rises = np.diff(f)
    if not ((rises > 0.0).all() or (rises < 0.0).all()):
        return np.nan
    for width in range(1, len(x)):
        x = [(f[i + width] * x[i] - f[i] * x[i + 1]) / (f[i + width] - f[i]) for i in range(len(x) - 1)]
    return float(x[0])
