"""Contact laws by number, and how contact forces are found over a cycle.

The laws themselves are evaluated by the C core (``csrc/contact``: ``element.c``, ``event_driven.c``, ``aft.c``,
``coupled_friction.c``;
LAW_USER is a function that is supplied by the user, see :mod:`bdamper.contact.user_laws`).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Annotated

from bdamper.util import validation

LAW_SEPARABLE, LAW_NORMAL, LAW_CONSTANT, LAW_COUPLED, LAW_COUPLED_CONSTANT, LAW_BONDED, LAW_CUBIC, LAW_USER = range(8)
MAX_SAMPLES = 1 << 20
"""Samples per period that the core takes at most."""


@dataclass(frozen=True)
class AFT(validation.Checked):
    """Contact forces from samples in time (alternating frequency/time) instead of exact events.

    Parameters
    ----------
    n_time : int
        Samples per period, at least ``4 harmonics + 4``.
    interpolate : bool
        Interpolate the instant of closing between samples; without it the derivative does not converge.
    """

    n_time: Annotated[int, partial(validation.whole, least=8, most=MAX_SAMPLES)] = 128
    interpolate: bool = True


def check_evaluation(contact_forces: str | AFT, harmonics: int) -> None:
    """Refuse what is no evaluation, or too few samples for the highest harmonic."""
    if isinstance(contact_forces, AFT):
        expected = f"AFT with at least {4 * harmonics + 4} samples for {harmonics} harmonics"
        validation.that(contact_forces.n_time >= 4 * harmonics + 4, "contact_forces", expected, contact_forces.n_time)
    elif not isinstance(contact_forces, str) or contact_forces != "event_driven":
        raise validation.unfit("contact_forces", '"event_driven" or AFT(n_time)', contact_forces)
