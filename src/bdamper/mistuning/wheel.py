"""The wheel: a study of all blades and dampers at once."""

from __future__ import annotations

from dataclasses import dataclass

from bdamper.mistuning.optimal import optimal_curve
from bdamper.mistuning.peak import peak
from bdamper.mistuning.response_curve import frequency_response
from bdamper.mistuning.steady_amplitude import time_response
from bdamper.mistuning.wheel_problem import WheelProblem
from bdamper.util import validation
from bdamper.util.short_repr import brief


@validation.spelt
@brief
@dataclass(frozen=True, eq=False)
class BladedDisk(WheelProblem):
    """All blades and dampers of a wheel at once, blades mistuned and dampers different.

    Laws, their evaluation and the preload are those of the study.  Blades and disk are described by the local basis of the
    model (``bdamper.model.local_basis.LocalBasis``); where the study's contact stiffness is a method, attachments carry the
    flexibility of the contacts, and points have the stiffness of what the basis leaves out (:func:`tuned_problem`).

    Parameters
    ----------
    study : Study
        Of one sector; its engine order, excitation and response are those of the wheel.
    mistuning : Mistuning or array, optional
        Frequency deviations of the blades clamped at their roots; none by default.
    dampers : DamperVariation, optional
        How dampers differ; all alike by default.

    Raises
    ------
    SettingError, ModelError
        If a setting does not fit a wheel, or the model has no local basis.
    """

    frequency_response = frequency_response
    peak = peak
    time_response = time_response
    optimal_curve = optimal_curve
