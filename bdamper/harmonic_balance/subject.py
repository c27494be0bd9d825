"""Subject of a printed result: preload, engine order, excitation, friction coefficients.

All functions take the settings that a result stores; for missing settings, the text is empty.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bdamper.model.loads import BASE
from bdamper.util.formatting import amount, loads_text

Settings = Mapping[str, Any]


def about(settings: Settings, preload: float = float("nan"), *further: str) -> str:
    """Return ": " with preload (N), engine order and excitation, or "" if all are unknown."""
    parts = [preload_text(preload, settings), *further, *condition(settings)]
    known = [part for part in parts if part]
    return f": {', '.join(known)}" if known else ""


def preload_text(preload: float, settings: Settings) -> str:
    """Return the preload (N) with the loads per newton, or "" if it is unknown."""
    if not np.isfinite(preload):
        return ""
    text = f"preload {amount(preload, 'N')}"
    loads = loads_text(settings.get("load_per_preload"))
    return f"{text} ({loads})" if loads else text


def condition(settings: Settings) -> list[str]:
    """Return engine order and excitation as texts, without unknown ones."""
    texts = []
    # order 0, the same force on all sectors, has no text
    order = settings.get("engine_order")
    if order:
        texts.append(f"engine order {order}")
    excitation = excitation_text(settings)
    if excitation:
        texts.append(excitation)
    return texts


def excitation_text(settings: Settings) -> str:
    """Return the amplitude of the excitation; empty if unknown."""
    excitation = settings.get("excitation", {})
    amplitude = excitation.get("amplitude", 0.0)
    if not amplitude:
        return ""
    if excitation.get("location") == BASE:
        return f"{amplitude:g} m/s² of base acceleration"
    return f"{amount(amplitude, 'N')} of excitation"


def friction_coefficients(settings: Settings) -> NDArray:
    """Return the different friction coefficients of all interfaces and points, without zero."""
    friction = settings.get("friction_coefficient", 0.0)
    by_interface = list(friction.values()) if isinstance(friction, Mapping) else [friction]
    coefficients = np.concatenate([np.ravel(coefficient) for coefficient in by_interface])
    return np.unique(coefficients[coefficients > 0.0])


def has_more_points(settings: Settings) -> bool:
    """Return whether the faces can have more contact points.

    With given stiffness each contact point is a joint, and there are no more of them, unless
    ``contact_points`` has united some.
    """
    # a name, or a mapping from the kind to values or options
    stiffness = settings.get("contact_stiffness", "")
    are_joints = stiffness == "model" or "values" in stiffness
    return not are_joints or settings.get("contact_points") is not None


def has_residual_modes(settings: Settings) -> bool:
    """Return whether residual modes represent the flexibility of the omitted modes."""
    # a name, or a mapping from the name to options
    return "residual_modes" in settings.get("contact_stiffness", "")


def not_covered(settings: Settings, effects: Sequence[str] = (), equal_blades: bool = True) -> str:
    """Return the line that lists the effects not included in a computed amplitude."""
    listed = [*effects, "mistuning", "wear"] if equal_blades else [*effects, "wear"]
    if has_more_points(settings):
        listed.append("more contact points")
    return f"Not covered: {', '.join(listed)}"
