"""Derivatives of a peak with respect to the preload and to settings; equations as functions of one setting."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from bdamper.harmonic_balance.system import HarmonicSystem
from bdamper.peaks.highest import check_options
from bdamper.peaks.newton import Family, Peak, PeakOptions
from bdamper.peaks.sensitivity import PeakSensitivity, sensitivities
from bdamper.problem.problem import Problem
from bdamper.problem.settings import check_result
from bdamper.problem.variation import FACTORS, setting_names, vary
from bdamper.util import validate
from bdamper.util.blas import one_thread
from bdamper.util.errors import SettingError

PARAMETERS = (
    "preload", "friction_coefficient", "contact_stiffness_factor", "excitation.amplitude", "damper_mass_factor",
    "damping_factor",
)  # fmt: skip


@one_thread
def peak_sensitivities(
    problem: Problem, peak: Peak, parameters: Sequence[str] = PARAMETERS, *, options: PeakOptions | None = None
) -> dict[str, PeakSensitivity]:
    """Derivatives of a peak's amplitude and frequency with respect to the preload and to settings.

    Parameters
    ----------
    problem : Problem
    peak : Peak
        Of this problem, at a preload of ``peak.parameter`` newtons.
    parameters : sequence of str
        "preload" or any setting with a number (see :mod:`bdamper.problem.variation`); factors are taken at 1.
        "damper_mass" is the mass of the free bodies with the preload that goes with it at a fixed rotor speed, as a factor;
        "damper_mass_factor" is their inertia alone.
    options : PeakOptions

    Raises
    ------
    SettingError
        If the peak is not converged or lies at a corner, or the evaluation is sampled: events between samples make the
        amplitude a rippled function of frequency, whose maxima move from ripple to ripple.
    """
    validate.instance("peak", peak, Peak, "a Peak, as Study.peak returns it")
    check_options(options)
    if peak.model_hash:
        check_result(problem, peak, "peak")
    if problem.evaluation != "exact":
        raise SettingError(f'sensitivities: expected evaluation="exact", found {problem.evaluation}: the peak has ripples')
    families: dict[str, tuple[Family, float]] = {}
    parameters = validate.names("parameters", parameters, ("preload", *setting_names(problem)))
    preload = peak.parameter
    for name in parameters:
        if name == "preload":
            if preload > 0.0:
                families[name] = (problem.system, preload)
            continue
        if name == "contact_stiffness_factor" and problem.holds_preload:
            continue
        if name.startswith("damper_mass") and not any(b.kind == "free" for b in problem.model.bodies.values()):
            continue
        families[name] = (setting_family(problem, name, preload), setting_value(problem, name))
    return sensitivities(peak, families, options)


def setting_value(problem: Problem, name: str) -> float:
    """Present value of a numeric setting, 1 for a factor."""
    if name in FACTORS:
        return 1.0
    value: Any = problem
    for part in name.split("."):
        value = getattr(value, part if part != "response" else "response_location")
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise SettingError(f"{name}: expected a setting that is one number, found {value!r}")
    return float(value)


def setting_family(problem: Problem, name: str, preload: float) -> Family:
    """The equations at one preload as a function of one numeric setting."""

    def family(value: float) -> HarmonicSystem:
        return vary(problem, {name: value}).system(value * preload if name == "damper_mass" else preload)

    return family
