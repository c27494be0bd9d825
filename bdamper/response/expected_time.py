"""Processor time that checks of a peak or of an optimum would take.

It follows from the time of an evaluation of the equations in the response curves.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from bdamper.util.formatting import amount
from bdamper.util.progress import Cost

INTEGRATION, BY_HARMONIC_BALANCE = 14e3, 17e3
"""Processor time of the time integration at one preload, if all contacts stay closed, and of more
harmonics and other friction coefficients, in evaluations of the equations of the response curves.

The first was measured on seven rings of blades, the second on the turbine blade alone
(docs/evidence/measured-time.md).
"""
LEAST_CLOSED = 0.1
"""Share of the period below which the price of the time integration no longer rises."""


def seconds_of_evaluation(costs: Iterable[Cost | None]) -> float:
    """Return the mean processor time of an evaluation (s); NaN if it was not measured."""
    total = sum((cost for cost in costs if cost is not None), Cost())
    if not total.processor > 0.0 or not total.evaluations:
        return float("nan")
    return total.processor / total.evaluations


def seconds_in_time(evaluation: float, open_share: float, settings: Mapping[str, Any]) -> float:
    """Return the processor time (s) of a time integration at a peak; NaN if unknown.

    It rises with the inverse of the share of the period in which contacts are closed, because each
    step has to find the states of the contacts.

    Parameters
    ----------
    evaluation : float, s
        Processor time of an evaluation.
    open_share : float
        Share of the period in which contacts are open at the peak.
    settings : mapping
        Settings of the study.  The time of a single sector, without an engine order, is unknown: it
        is a small part of the time of a ring.
    """
    if not settings.get("engine_order"):
        return float("nan")
    return INTEGRATION * evaluation / max(1.0 - open_share, LEAST_CLOSED)


def expected_text(seconds: float) -> str:
    """Return an expected time (s) with one digit as text; "" if unknown."""
    return f"about {amount(float(f'{seconds:.1g}'), 's')}" if seconds > 0.0 else ""
