"""The highest blade of a wheel over the preload, as a sweep."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import replace
from functools import partial
from typing import Any

from bdamper.analyses.sweep import SweepResult, sweep
from bdamper.mistuning.peak import WheelPeakOptions, peak
from bdamper.mistuning.peak_result import WheelPeak
from bdamper.mistuning.wheel_problem import WheelProblem
from bdamper.util import validation
from bdamper.util.errors import BdamperError

OF_PEAKS = "amplitude", "frequency", "blade", "residual", "springs", "error"
"""What sweeps and samples keep of a peak."""


def answers(found: WheelPeak) -> dict[str, Any]:
    """A peak with free or held dampers as the answers at a point of a sweep.

    Raises
    ------
    BdamperError
        If it is none, or a lower bound alone.
    """
    if not found.found:
        raise BdamperError(f"{found.status}: {found.reason}")
    return {name: getattr(found, name) for name in OF_PEAKS} | {"cost": found.cost}


def _highest(_: Any, preload: Any, *, wheel: WheelProblem, options: WheelPeakOptions | None) -> dict[str, Any]:
    """The highest peak of a wheel, as a question of a sweep."""
    found = peak(wheel, preload, options=options)
    return answers(found) | {"tuned_amplitude": found.tuned_amplitude}


@validation.spelt
def optimal_curve(
    wheel: WheelProblem,
    preloads: Sequence[float],
    *,
    options: WheelPeakOptions | None = None,
    executor: Executor | None = None,
    progress: bool = False,
) -> SweepResult:
    """Highest amplitude of any blade at each of several preloads, every one searched for anew.

    Parameters
    ----------
    wheel : BladedDisk
    preloads : sequence of float, N
    options : WheelPeakOptions
    executor, progress
        As in :func:`bdamper.sweep`.

    Returns
    -------
    SweepResult
        Over the preload, with amplitude, frequency and number of the highest blade, the springs that hold dampers, the
        error of the amplitude that they leave (:class:`~bdamper.mistuning.peak_result.WheelPeak`), and the tuned amplitude.
    """
    values = validation.numbers("preloads", preloads, above=0.0, unit="N")
    task = partial(_highest, wheel=wheel, options=options)
    found = sweep(wheel.study, {"preload": values}, task, executor=executor, progress=progress)
    return replace(found, **wheel.record())
