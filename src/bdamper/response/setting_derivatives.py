"""Derivatives of peaks and curves with respect to the preload and to settings; equations as functions of one setting."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bdamper.harmonic_balance.closing_conditions import Fixed, Plane
from bdamper.harmonic_balance.equations import Equations, norm2
from bdamper.harmonic_balance.parameters import FACTORS, OF_LOAD, setting_names, vary
from bdamper.harmonic_balance.problem import Problem
from bdamper.harmonic_balance.residual_mode_alignment import like
from bdamper.harmonic_balance.result_checks import check_result
from bdamper.response.continuation_options import ContinuationOptions
from bdamper.response.curve import ResponseCurve
from bdamper.response.peak import Family, Peak
from bdamper.response.response_curve import check_curve
from bdamper.response.sensitivity import CurveSensitivity, PeakSensitivity, across, sensitivities
from bdamper.util import validation
from bdamper.util.errors import SettingError
from bdamper.util.threading import one_thread

PARAMETERS = (
    "preload", "friction_coefficient", "contact_stiffness_factor", "excitation.amplitude", "damper_mass_factor",
    "damping_factor",
)  # fmt: skip


@one_thread
def peak_sensitivities(problem: Problem, peak: Peak, parameters: Sequence[str] = PARAMETERS) -> dict[str, PeakSensitivity]:
    """Derivatives of a peak's amplitude and frequency with respect to the preload and to settings.

    Parameters
    ----------
    problem : Problem
    peak : Peak
        Of this problem, at a preload of ``peak.parameter`` newtons.
    parameters : sequence of str
        "preload" or any setting with a number (see :mod:`bdamper.harmonic_balance.parameters`); factors are taken at 1.
        "damper_mass" is the mass of the free bodies with the preload that goes with it at a fixed rotor speed, as a factor;
        "damper_mass_factor" is their inertia alone; "damper_mass.rear" and "damper_mass_factor.rear" are those of one.

    Returns
    -------
    dict of name to PeakSensitivity
        Derivatives that are not known are NaN, with a ``reason``.

    Raises
    ------
    SettingError
        If the peak is not converged or lies at a corner, or the evaluation is sampled: events between samples make the
        amplitude a rippled function of frequency, whose maxima move from ripple to ripple.
    """
    validation.instance("peak", peak, Peak, "a Peak, as Study.peak returns it")
    if peak.model_hash:
        check_result(problem, peak, "peak")
    return sensitivities(peak, families(problem, parameters, peak.parameter))


@one_thread
def curve_sensitivities(
    problem: Problem, curve: ResponseCurve, parameters: Sequence[str] = PARAMETERS
) -> dict[str, CurveSensitivity]:
    """Derivatives of a whole response curve with respect to the preload and to settings, finite at its folds.

    Parameters
    ----------
    problem : Problem
    curve : ResponseCurve
        A response curve of this problem.
    parameters : sequence of str
        As for :func:`peak_sensitivities`.

    Returns
    -------
    dict of name to CurveSensitivity
        ``bdamper.plot.plot_band`` draws with them what uncertain settings make of the curve.

    Raises
    ------
    SettingError
        If the curve is another one, or the evaluation is sampled.
    """
    check_curve(problem, validation.instance("curve", curve, ResponseCurve))
    system, n = problem.system(curve.preload), len(curve)
    y = np.column_stack([curve.unknowns, 2.0 * np.pi * curve.frequency])
    width = max(float(np.pi * np.ptp(curve.frequency)), 1e-300) if n else 1.0
    scale = np.array([system.units(p, width) for p in y]).reshape(y.shape)
    points = []
    for i, (p, unit) in enumerate(zip(y, scale)):
        beside = [k for k in (i - 1, i + 1) if 0 <= k < n and curve.branch[k] == curve.branch[i]]
        chord = (y[beside[-1]] - y[beside[0] if len(beside) > 1 else i]) / unit if beside else np.zeros(len(p))
        chord = chord * (-1.0 if beside == [i - 1] else 1.0)
        border = Plane(chord / norm2(chord)) if chord.any() else Fixed()
        points.append(system.solve(p, border, unit, ContinuationOptions().tolerance, ContinuationOptions().max_iterations))
    return across(system, points, scale, families(problem, parameters, curve.preload))


def band(
    curve: ResponseCurve, found: Mapping[str, CurveSensitivity], deviations: Mapping[str, float]
) -> tuple[NDArray, NDArray, NDArray]:
    """Standard deviation of a curve whose parameters scatter independently, to first order.

    Parameters
    ----------
    curve : ResponseCurve
    found : mapping of name to CurveSensitivity
        Of this curve.
    deviations : mapping of name to float
        Standard deviation of each parameter.

    Returns
    -------
    deviation : (n,) float
        Of each point across the curve, in ln(amplitude) and in ln(frequency) over the width at half the highest amplitude;
        NaN where the mean alone drifts along the curve.
    frequency, amplitude : (n, 2) float, Hz and m
        Edges of the band two standard deviations to both sides.
    """
    for name, value in validation.mapping("deviations", deviations, found, "parameters").items():
        validation.number(f"deviation of {name}", value, least=0.0)
    f, response = curve.frequency, curve.harmonics[:, 1]
    high = curve.amplitude >= 0.5 * curve.amplitude.max()
    width = max(float(np.ptp(np.log(f[high]))), 1e-6)
    own = [(found[name], value) for name, value in deviations.items()]
    moves = [d * np.array([s.frequency / f / width, (s.response / response).real]) for s, d in own]
    along = next(iter(found.values())).tangent
    normal = np.array([-(along[:, 1] / response).real, along[:, 0].real / f / width])
    with np.errstate(invalid="ignore"):  # where the mean alone drifts along the curve nothing is across it
        normal /= np.hypot(*normal)
    deviation = np.sqrt(sum((normal * move).sum(axis=0) ** 2 for move in moves))
    way = 2.0 * np.array([-1.0, 1.0]) * (deviation * normal)[..., None]
    return deviation, f[:, None] * np.exp(width * way[0]), curve.amplitude[:, None] * np.exp(way[1])


def families(problem: Problem, parameters: Sequence[str], preload: float) -> dict[str, tuple[Family, float]]:
    """The equations at one preload as functions of each parameter with its value; those that mean nothing are left out."""
    if (given := problem.settings.contact_forces) != "event_driven":
        raise SettingError(f'sensitivities: expected contact_forces="event_driven", found {given}: the peak has ripples')
    out: dict[str, tuple[Family, float]] = {}
    for name in validation.names("parameters", parameters, ("preload", *setting_names(problem))):
        if name == "preload":
            if preload > 0.0:
                out[name] = (problem.system, preload)
            continue
        if name == "contact_stiffness_factor" and problem.settings.holds_preload:
            continue
        if name.startswith("damper_mass") and not any(b.kind == "free" for b in problem.model.bodies.values()):
            continue
        out[name] = (setting_family(problem, name, preload), setting_value(problem, name))
    return out


def setting_value(problem: Problem, name: str) -> float:
    """Present value of a numeric setting, 1 for a factor."""
    head, _, part = name.partition(".")
    if head in FACTORS:
        return 1.0
    value: Any = problem.settings
    if of_part := part and head in ("friction_coefficient", *OF_LOAD):
        of_face = head == "friction_coefficient"
        value = (value.friction_by_interface() if of_face else value.given_loads(head)).get(part, 0.0)
    for part in () if of_part else name.split("."):
        value = getattr(value, part if part != "response" else "response_location")
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise SettingError(f"{name}: expected a setting that is one number, found {value!r}")
    return float(value)


def setting_family(problem: Problem, name: str, preload: float) -> Family:
    """The equations at one preload as a function of one numeric setting."""

    # at a rotor speed the preload is the load of the first body
    turning = problem.settings.speed is not None
    on_first = ("damper_mass", *(f"damper_mass.{body}" for body in list(problem.body_loads or ())[:1] if turning))

    def family(value: float) -> Equations:
        varied = like(vary(problem, {name: value}), problem)
        return varied.system(value * preload if name in on_first else preload)

    return family
