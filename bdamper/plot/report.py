"""Report of an optimal curve for a design review: one HTML file, from ``report.html``.

Each check has a colour and a rule: green if passed, amber if uncertain, red if failed, white if not
computed.  The first lines name each failed check.  The file contains no link, and equal results of
one day give identical files.
"""

from __future__ import annotations

import io
import json
from collections.abc import Mapping
from dataclasses import replace
from datetime import date
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np

from bdamper.analyses.fit_result import Fitted
from bdamper.analyses.hysteresis import hysteresis
from bdamper.harmonic_balance.checks import check_result
from bdamper.harmonic_balance.problem import Problem
from bdamper.harmonic_balance.rotor_speed import RPM
from bdamper.harmonic_balance.study_boundary import StudyLike, problem_of
from bdamper.mistuning.peak import DiskPeak
from bdamper.mistuning.sample import MistunedSample
from bdamper.plot.axes import save_figure
from bdamper.response import linear_limits
from bdamper.response.followed_peak import highest_peak
from bdamper.response.optimal_curve_result import OptimalCurve
from bdamper.response.optimum_checks import Check, checks, graded
from bdamper.response.optimum_statement import statement
from bdamper.response.response_curve import frequency_response
from bdamper.response.sensitivity import peak_sensitivities
from bdamper.util import validation
from bdamper.util.display import Plottable, draw, in_unit_of_response, register_plot
from bdamper.util.errors import COMPLETE, import_extra
from bdamper.util.formatting import amount, spaced, truncate
from bdamper.util.storage import FilePath, check_folder, replacing

NOISE = 1.5, 3.0
"""Largest misfits of a fit for green and for amber, in units of its noise."""
BELONG = (
    "harmonics",
    "blade_modes",
    "contact_points",
    "friction_coefficient",
    "contact_stiffness_factor",
)
"""Settings that must agree between a curve and a fit."""
NOT_MODELLED = (
    "Mistuning: all blades and all dampers are equal (see BladedDisk for mistuned bladed disks).",
    "Temperature changes and frictional heating.",
    "Wear and running-in: contact faces, gaps and friction are constant.",
    "Friction laws other than Coulomb friction with one coefficient for each face, for stick and "
    "slip.",
    "Coriolis forces, large displacements, nonlinear material, and large sliding of contact "
    "points.",
    "Fluid forces other than modal damping, and transient responses.",
)


@register_plot(OptimalCurve, "report")
def write_report(
    curve: OptimalCurve,
    path: FilePath,
    study: StudyLike | Problem | None = None,
    fit: Fitted | None = None,
    disk: DiskPeak | MistunedSample | None = None,
    **subject: str,
) -> Path:
    """Write the report of an optimal curve.

    See :meth:`bdamper.response.optimal_curve_result.OptimalCurve.report`.
    """
    jinja2 = import_extra("jinja2", "report", "report")
    check_folder(path)
    best = curve.optimum
    has_optimum = np.isfinite(best.amplitude) and np.isfinite(best.preload)
    expected = "an optimal curve with an optimum"
    validation.check(has_optimum, "report", expected, f"none: {best.status_text}")
    problem = None if study is None else problem_of(study)
    if disk is not None:
        validation.instance("disk", disk, (DiskPeak, MistunedSample))
    if fit is not None:
        validation.instance("fit", fit, Fitted)

    figures = [("Resonance against preload", _picture(curve))]
    sensitivities: list[tuple[str, ...]] = []
    if problem is None:
        figures += _nearest_response(curve)
    else:
        check_result(problem, curve)
        at_optimum, sensitivities = _at_optimum(problem, curve)
        figures += at_optimum
        if problem.model.meshes:
            figures.insert(0, ("Blades and dampers of the stage", _picture(problem.model)))
    figures += [("Margin against fatigue", _picture(margins)) for margins in curve.margins]
    if disk is not None:
        figures.append((f"Mistuned bladed disk: {disk._headline().rstrip('.')}", _picture(disk)))
    if fit is not None:
        figures.append(("Measured responses and the model", _picture(fit)))

    all_checks = lights(curve, fit)
    # constants that were not fitted do not colour the report
    colours = [
        check.colour for check in all_checks if check.name != "Contact constants" or fit is not None
    ]
    worst_colour = next(
        colour for colour in ("red", "white", "amber", "green") if colour in colours
    )
    low, high = curve.near_best
    template = Path(__file__).with_name("report.html").read_text(encoding="utf-8")
    environment = jinja2.Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True)
    text = environment.from_string(template).render(
        curve=curve,
        fit=fit,
        figures=figures,
        lights=all_checks,
        sensitivities=sensitivities,
        subject=_subject(curve, subject) | _damper(curve, problem),
        answer=_answer(curve, _contact_constants(curve, fit)),
        colour=worst_colour,
        left_out=NOT_MODELLED,
        notes=curve.warnings,
        settings=_settings(curve.settings),
        range=f"{amount(low, 'N')} to {amount(high, 'N')}",
        given=study is not None,
        lines=_lines_to_repeat(curve, subject.get("model_file") or "model.h5"),
    )
    with replacing(path) as temporary:
        temporary.write_bytes(text.encode())
    return Path(path)


def _answer(curve: OptimalCurve, constants: Check) -> str:
    """Return verdict, quantities and remedies in HTML, without the checks, which follow."""
    printed = replace(statement(curve, [constants]), checks=(), times=())
    return in_unit_of_response(curve, printed).html


def _nearest_response(curve: OptimalCurve) -> list[tuple[str, str]]:
    """Return the response curve at the preload nearest to the optimum, if there is one."""
    followed = [response for response in curve.curves if len(response)]
    if not followed:
        return []
    nearest = min(followed, key=lambda c: abs(np.log(c.preload / curve.optimum.preload)))
    preload = amount(nearest.preload, "N")
    title = f"Response against frequency at {preload}, the nearest preload with a response curve"
    return [(title, _picture(nearest))]


def _lines_to_repeat(curve: OptimalCurve, model_file: str) -> tuple[str, ...]:
    """Return the lines of Python that compute the curve again."""
    arguments = _asked(curve)
    interval = curve.settings.get("frequency")
    if interval:
        arguments += f", frequency=({interval[0]:.12g}, {interval[1]:.12g})"
    if not curve.time_response:
        arguments += ", check=False"
    load = f'study = bd.load_study("best.h5", bd.load_model("{model_file}"))'
    return (
        "import bdamper as bd",
        f'{load}  # best.save("best.h5") has the settings',
        f"best = study.optimal_curve({arguments})",
    )


def _asked(curve: OptimalCurve) -> str:
    """Return the requested preloads as arguments: a range and a number, or a list."""
    preloads = curve.preload[curve.requested]
    low = preloads[0]
    high = preloads[-1]
    n = len(preloads)
    if np.allclose(preloads, np.geomspace(low, high, n), rtol=1e-9, atol=0.0):
        return f"({low:.12g}, {high:.12g}), {n}"
    return f"[{', '.join(f'{preload:.12g}' for preload in preloads)}]"


def _subject(curve: OptimalCurve, given: Mapping[str, str]) -> dict[str, str]:
    """Return the first rows: project, author, date, model, excitation, speed and preloads."""
    settings = curve.settings
    force = settings.get("excitation") or {}
    direction_and_location = [force.get("direction"), force.get("location")]
    where = " at ".join(str(part) for part in direction_and_location if part is not None)
    is_modal = str(force.get("location")).startswith("mode ")
    unit = "N kg^-1/2" if is_modal else "N"
    amplitude = f"amplitude {force.get('amplitude', 0.0):g} {unit}"
    speed = settings.get("speed")
    speed_text = "not given, frequencies of the model"
    if speed is not None:
        speed_text = f"{speed * RPM:.6g} rpm"
    return {
        "project": given.get("project", ""),
        "author": given.get("author", ""),
        "date": given.get("date") or date.today().isoformat(),
        "model": f"{given.get('model_file', '')} {curve.model_hash}".lstrip(),
        "excitation": f"engine order {settings.get('engine_order')}, {where}, {amplitude}",
        "rotor speed": speed_text,
        "preloads": f"{amount(curve.preload[0], 'N')} to {amount(curve.preload[-1], 'N')}",
    }


GIVE_STUDY = "as in the model; report(path, study) prints it"


def _damper(curve: OptimalCurve, problem: Problem | None) -> dict[str, str]:
    """Return the rows of the report with modal damping, mass and radius of the dampers."""
    if problem is not None:
        return {"modal damping ratio": problem.damping_text, "damper": problem.model.masses_text}
    damping_ratio = curve.settings.get("damping_ratio")
    damping_text = GIVE_STUDY if damping_ratio is None else f"{damping_ratio:g}"
    return {"modal damping ratio": damping_text, "damper": GIVE_STUDY}


DEFAULTS = {
    "damping_ratio": "as in the model (above)",
    "gap": "as in the model",
    "contact_points": "all of the model",
    "load_per_preload": "1 on each loaded body",
    "response": "at the excitation",
}
"""Meaning of settings that are not given; no others have an effect."""


def _settings(settings: Mapping[str, Any]) -> dict[str, str]:
    """Return all settings as strings, and the meaning of those that are not given."""
    texts = {}
    for name, value in sorted(settings.items()):
        if name == "load_per_preload" and settings.get("speed") is not None:
            texts[name] = "in proportion to mass times radius"
        elif value is None:
            texts[name] = DEFAULTS.get(name, "none")
        else:
            texts[name] = _short(value)
    return texts


def _has(settings: Mapping[str, Any], name: str, value: Any) -> bool:
    """Return whether a setting has a value.

    ``name`` is a setting, or setting and part as "friction_coefficient.left".  Without a part, all
    values of a mapping must be equal to it or 0.
    """
    setting, _, part = name.partition(".")
    actual = settings.get(setting, value)
    if not isinstance(actual, Mapping):
        return bool(actual == value)
    if isinstance(value, Mapping):
        return dict(actual) == dict(value)
    if part:
        return part not in actual or bool(actual[part] == value)
    return all(of_part in (value, 0.0) for of_part in actual.values())


def lights(curve: OptimalCurve, fit: Fitted | None = None) -> list[Check]:
    """Return the checks of an optimal curve, with a check of the contact constants."""
    return [*checks(curve), _contact_constants(curve, fit)]


def _contact_constants(curve: OptimalCurve, fit: Fitted | None) -> Check:
    """Rate the contact constants by the fit from which they are taken."""
    name = "Contact constants"
    if fit is None:
        return Check("white", name, "assumed, not fitted", "white without a fit")
    fitted = fit.settings | dict(zip(fit.names, fit.values.tolist()))
    others = []
    for setting, value in fitted.items():
        belongs = setting.partition(".")[0] in BELONG
        if belongs and not _has(curve.settings, setting, value):
            others.append(spaced(setting))
    green, amber = NOISE
    rule = (
        f"green below {green:g} times the noise, amber below {amber:g}, red above, "
        "or if incomplete or not used"
    )
    result = f"misfit {fit.misfit:.2g} times the noise, {fit.status_text}"
    if others:
        result += f"; the curve has other values of {', '.join(others)}"
    is_usable = fit.status == COMPLETE and not others
    colour = graded(fit.misfit, green, amber) if is_usable else "red"
    remedy = "compute the curve with the fitted values" if others else "improve the fit"
    return Check(colour, name, result, rule, f"contact constants: {result}", remedy)


def _at_optimum(
    problem: Problem, curve: OptimalCurve
) -> tuple[list[tuple[str, str]], list[tuple[str, ...]]]:
    """Return the plots of the response at the optimum, and the rows of its sensitivities."""
    preload = curve.optimum.preload
    load = amount(preload, "N")
    band = _band_around_peaks(curve)
    tracked = frequency_response(problem, preload, band)
    peak = highest_peak(problem, preload, band)
    limits = [linear_limits.free(problem, band), linear_limits.stuck(problem, band, preload)]
    figures = [(f"Response against frequency at {load}", _picture(tracked, limits=limits))]
    if not peak.ok:
        return figures, []
    contacts = _picture(peak, "plot_contacts", problem)
    figures.append((f"Stick, slip and separation over a cycle of the peak at {load}", contacts))
    if len(problem.coupling.interfaces):
        figures.append((f"Pressure at rest under {load}", _picture(problem.static(preload))))
    loop = _picture(hysteresis(problem, peak))
    figures.append((f"Hysteresis loop of all contacts at the peak at {load}", loop))
    sensitivities: list[tuple[str, ...]] = []
    # there are no derivatives at a corner, and none of sampled contact forces
    if not peak.corner and problem.settings.contact_forces == "event_driven":
        for s in peak_sensitivities(problem, peak).values():
            # changes in per cent for one per cent of the parameter
            amplitude = s.value * s.amplitude / peak.amplitude
            frequency = s.value * s.frequency / peak.frequency
            if np.isfinite(amplitude):
                cells = (f"{amplitude:+.3f} %", f"{frequency:+.4f} %")
            else:
                cells = ("not known", s.reason)
            sensitivities.append((spaced(s.name), *cells))
    return figures, sensitivities


def _band_around_peaks(curve: OptimalCurve) -> tuple[float, float]:
    """Return an interval (Hz) with the peak at the optimum, the free and the stuck resonance."""
    free = curve.free.frequency
    stuck = curve.stuck.frequency
    margin = max(0.25 * abs(stuck - free), 0.03 * free)
    peaks = [f for f in (free, curve.optimum.frequency, stuck) if np.isfinite(f)]
    # a shroud raises the frequency several times, so that the margin may exceed the lowest one
    low = max(min(peaks) - margin, 0.7 * min(peaks))
    return low, max(peaks) + margin


def _short(value: Any) -> str:
    """Format a setting as one line."""
    if isinstance(value, str):
        return truncate(value, 120)
    if isinstance(value, Mapping):
        # parts that are not given have no effect
        value = {name: part for name, part in value.items() if part is not None}
    return truncate(json.dumps(value, sort_keys=True), 120)


def _picture(shown: Plottable, kind: str = "plot", *arguments: Any, **options: Any) -> str:
    """Return the plot of a result as an HTML image."""
    svg = io.BytesIO()
    # equal results give identical files
    metadata = {"Date": None, "Creator": None}
    axes = draw(shown, kind, *arguments, **options)
    save_figure(axes, svg, format="svg", dpi=110, metadata=metadata)
    # a third shorter than in base 64
    text = svg.getvalue().decode().replace('"', "'").replace("\n", " ")
    quoted = quote(text, safe=" ()*+,-./:;=?@[]_!")
    return f'<img alt="figure" src="data:image/svg+xml,{quoted}">'
