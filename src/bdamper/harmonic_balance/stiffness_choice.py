"""Contact stiffness of a study: by the method that its settings name, or by the best that its model has the data for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bdamper.contact.residual_flexibility import ResidualModes
from bdamper.contact.stiffness import Contact, PerArea, contact_stiffness
from bdamper.harmonic_balance.settings import Settings
from bdamper.model.kinematics import Coupling
from bdamper.model.patch_merging import united_sum
from bdamper.util.errors import ModelError, SettingError
from bdamper.util.warn import say


def contact_of(settings: Settings, coupling: Coupling, friction: NDArray) -> Contact:
    """Contact stiffness by the method asked for, with residual modes if it has any.

    By default residual modes; where the model lacks what they need, what it carries, or unit tractions.
    """
    if settings.contact_stiffness is not None:
        return _contact_by(settings, coupling, friction, settings.contact_stiffness)
    try:
        contact = _contact_by(settings, coupling, friction, "residual_modes")
        for l in sorted({0, *settings.active_harmonics}):
            _ = contact.residual and contact.residual.basis(l)
        return contact
    except (ModelError, SettingError) as error:
        why = str(error)
    carried = all(name in settings.model.contact for name in coupling.interfaces)
    contact = _contact_by(settings, coupling, friction, "model" if carried else "unit_traction")
    note = (
        f'contact stiffness "{contact.method}" instead of residual modes ({why}); peaks may be off by tens of per cent, '
        "which more blade modes would show"
    )
    say(note)
    return replace(contact, note=note)


def _contact_by(settings: Settings, coupling: Coupling, friction: NDArray, method: Any) -> Contact:
    given = method
    if isinstance(method, str) and method == "model":
        missing = [name for name in coupling.interfaces if name not in settings.model.contact]
        if missing:
            raise SettingError(f'contact_stiffness="model": the model has none for interfaces {missing}')
        return Contact({n: coupling.model.contact[n] for n in coupling.interfaces}, method=given)
    if settings.contact_points is not None and not isinstance(method, (str, ResidualModes, PerArea)):
        # numbers are given for the points of the model
        whole = method if isinstance(method, Mapping) else dict.fromkeys(coupling.interfaces, method)
        method = {}
        for name, k in whole.items():
            face = settings.model.interfaces[name]
            values = np.broadcast_to(np.asarray(k, float), (face.n_points, 3))
            method[name] = united_sum(face, settings.contact_points, values)
    return replace(contact_stiffness(coupling, method, friction), method=given)
