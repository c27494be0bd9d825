"""Report of an optimal curve for a design review: one HTML file, from ``report.html``.

Each check has a colour and a rule: green if passed, amber if uncertain, red if failed, white if not
computed.  A red check is in the first sentence.  The file contains no link, and equal results of
one day give identical files.
"""

from __future__ import annotations

import io
import json
from collections.abc import Mapping
from datetime import date
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np

from bdamper.analyses.fit_result import Fitted
from bdamper.analyses.hysteresis import hysteresis
from bdamper.harmonic_balance.checks import Asking, check_result, problem_of
from bdamper.harmonic_balance.problem import Problem
from bdamper.harmonic_balance.rotor_speed import RPM
from bdamper.mistuning.peak import DiskPeak
from bdamper.mistuning.sample import MistunedSample
from bdamper.plot.axes import save_figure
from bdamper.response import linear_limits
from bdamper.response.headline import Check, checks, graded, headline
from bdamper.response.highest_peak import highest_peak
from bdamper.response.optimal_curve_result import OptimalCurve
from bdamper.response.response_curve import frequency_response
from bdamper.response.sensitivity import peak_sensitivities
from bdamper.util import validation
from bdamper.util.display import Plottable, draw, register_plot
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
    "Friction laws other than Coulomb friction with one coefficient for each face, for stick and slip.",
    "Coriolis forces, large displacements, nonlinear material, and large sliding of contact points.",
    "Fluid forces other than modal damping, and transient responses.",
)


@register_plot(OptimalCurve, "report")
def write_report(
    curve: OptimalCurve, path: FilePath, study: Asking | Problem | None = None, fit: Fitted | None = None,
    disk: DiskPeak | MistunedSample | None = None, **subject: str,
) -> Path:  # fmt: skip
    """Write the report of an optimal curve.

    See :meth:`bdamper.response.optimal_curve_result.OptimalCurve.report`.
    """
    jinja2 = import_extra("jinja2", "report", "report")
    check_folder(path)
    best = curve.optimum
    known = np.isfinite(best.amplitude) and np.isfinite(best.preload)
    validation.check(known, "report", "an optimal curve with an optimum", f"none: {best.status}")
    figures: list[tuple[str, str]] = [("Resonance over preload", _picture(curve))]
    rows: list[tuple[str, ...]] = []
    followed = [response for response in curve.curves if len(response)]
    if study is None and followed:
        nearest = min(followed, key=lambda c: abs(np.log(c.preload / best.preload)))
        title = f"Response over frequency at {amount(nearest.preload, 'N')}, the nearest preload with a response curve"
        figures.append((title, _picture(nearest)))
    elif study is not None:
        problem = problem_of(study)
        check_result(problem, curve)
        at_optimum, rows = _at_optimum(problem, curve)
        figures += at_optimum
        if problem.model.meshes:
            figures.insert(0, ("Blades and dampers of the stage", _picture(problem.model)))
    figures += [("Margin against fatigue", _picture(margins)) for margins in curve.margins]
    if disk is not None:
        validation.instance("disk", disk, (DiskPeak, MistunedSample))
        figures.append((f"Mistuned bladed disk: {disk._headline().rstrip('.')}", _picture(disk)))
    if fit is not None:
        figures.append(
            ("Measured responses and the model", _picture(validation.instance("fit", fit, Fitted)))
        )
    page = jinja2.Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True).from_string(
        Path(__file__).with_name("report.html").read_text(encoding="utf-8")
    )
    interval = curve.settings.get("frequency")
    band = f", frequency=({interval[0]:.12g}, {interval[1]:.12g})" if interval else ""
    check = "" if curve.time_response else ", check=False"
    low, high = curve.near_best
    found = lights(curve, fit)
    colours = [
        light.colour for light in found if light.name != "Contact constants" or fit is not None
    ]
    model = subject.get("model_file") or "model.h5"
    text = page.render(
        curve=curve, fit=fit, figures=figures, lights=found, sensitivities=rows,
        subject=_subject(curve, subject) | _damper(curve, None if study is None else problem_of(study)),
        headline=headline(curve, [_contact_constants(curve, fit)]),
        colour=next(c for c in ("red", "white", "amber", "green") if c in colours), left_out=NOT_MODELLED,
        notes=curve.warnings, settings=_settings(curve.settings),
        range=f"{amount(low, 'N')} to {amount(high, 'N')}", given=study is not None,
        lines=(
            "import bdamper as bd",
            f'study = bd.load_study("best.h5", bd.load_model("{model}"))  # best.save("best.h5") has the settings',
            f"best = study.optimal_curve({_asked(curve)}{band}{check})",
        ),
    )  # fmt: skip
    with replacing(path) as temporary:
        temporary.write_bytes(text.encode())
    return Path(path)


def _asked(curve: OptimalCurve) -> str:
    """Return the requested preloads as arguments: a range and a number, or a list."""
    asked = curve.preload[curve.requested]
    low, high, n = asked[0], asked[-1], len(asked)
    if np.allclose(asked, np.geomspace(low, high, n), rtol=1e-9, atol=0.0):
        return f"({low:.12g}, {high:.12g}), {n}"
    return f"[{', '.join(f'{p:.12g}' for p in asked)}]"


def _subject(curve: OptimalCurve, given: Mapping[str, str]) -> dict[str, str]:
    """Return the first rows: project, author, date, model, excitation, speed and preloads."""
    settings, force = curve.settings, curve.settings.get("excitation") or {}
    where = " at ".join(
        str(force[name]) for name in ("direction", "location") if force.get(name) is not None
    )
    unit = "N kg^-1/2" if str(force.get("location")).startswith("mode ") else "N"
    amplitude = f"amplitude {force.get('amplitude', 0.0):g} {unit}"
    speed = settings.get("speed")
    return {
        "project": given.get("project", ""),
        "author": given.get("author", ""),
        "date": given.get("date") or date.today().isoformat(),
        "model": f"{given.get('model_file', '')} {curve.model_hash}".lstrip(),
        "excitation": f"engine order {settings.get('engine_order')}, {where}, {amplitude}",
        "rotor speed": "not given, frequencies of the model"
        if speed is None
        else f"{speed * RPM:.6g} rpm",
        "preloads": f"{amount(curve.preload[0], 'N')} to {amount(curve.preload[-1], 'N')}",
    }


GIVE_STUDY = "as in the model; report(path, study) prints it"


def _damper(curve: OptimalCurve, problem: Problem | None) -> dict[str, str]:
    """Return the rows of the report with modal damping, mass and radius of the dampers."""
    if problem is not None:
        return {"modal damping ratio": problem.damping_text, "damper": problem.model.masses_text}
    given = curve.settings.get("damping_ratio")
    return {
        "modal damping ratio": GIVE_STUDY if given is None else f"{given:g}",
        "damper": GIVE_STUDY,
    }


DEFAULTS = {
    "damping_ratio": "as in the model (above)", "gap": "as in the model", "contact_points": "all of the model",
    "load_per_preload": "1 on each loaded body", "response": "at the excitation",
}  # fmt: skip
"""Meaning of settings that are not given; no others have an effect."""


def _settings(settings: Mapping[str, Any]) -> dict[str, str]:
    """Return all settings as texts, with the meaning of those that are not given."""
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

    ``name`` is a setting, or setting and part as "friction_coefficient.left".

    Without a part, all values of a mapping must be equal to it or 0.
    """
    setting, _, part = name.partition(".")
    actual = settings.get(setting, value)
    if not isinstance(actual, Mapping):
        return bool(actual == value)
    if isinstance(value, Mapping):
        return dict(actual) == dict(value)
    return all(
        v in (value, 0.0) if not part else v == value
        for key, v in actual.items()
        if part in ("", key)
    )


def lights(curve: OptimalCurve, fit: Fitted | None = None) -> list[Check]:
    """Return the checks of an optimal curve, with a check of the contact constants."""
    return [*checks(curve), _contact_constants(curve, fit)]


def _contact_constants(curve: OptimalCurve, fit: Fitted | None) -> Check:
    """Rate the contact constants by the fit from which they are taken."""
    name = "Contact constants"
    if fit is None:
        return Check("white", name, "assumed, not fitted", "white without a fit")
    fitted = fit.settings | dict(zip(fit.names, fit.values.tolist()))
    other = [
        name
        for name in fitted
        if name.split(".")[0] in BELONG and not _has(curve.settings, name, fitted[name])
    ]
    rule = f"green below {NOISE[0]:g} times the noise, amber below {NOISE[1]:g}, red above, or if incomplete or not used"
    result = f"misfit {fit.misfit:.2g} times the noise, {fit.status}"
    result += f"; the curve has other values of {', '.join(map(spaced, other))}" * bool(other)
    colour = "red" if fit.status != COMPLETE or other else graded(fit.misfit, *NOISE)
    remedy = "compute the curve with the fitted values" if other else "improve the fit"
    return Check(colour, name, result, rule, f"contact constants: {result}", remedy)


def _at_optimum(
    problem: Problem, curve: OptimalCurve
) -> tuple[list[tuple[str, str]], list[tuple[str, ...]]]:
    """Return the plots of the response at the optimum, and the rows of its sensitivities."""
    best, mode = (
        curve.optimum,
        max(0.25 * abs(curve.stuck.frequency - curve.free.frequency), 0.03 * curve.free.frequency),
    )
    ends = [
        f for f in (curve.free.frequency, best.frequency, curve.stuck.frequency) if np.isfinite(f)
    ]
    band = (min(ends) - mode, max(ends) + mode)
    tracked = frequency_response(problem, best.preload, band)
    peak = highest_peak(problem, best.preload, band)
    load = amount(best.preload, "N")
    limits = [linear_limits.free(problem, band), linear_limits.stuck(problem, band, best.preload)]
    figures = [(f"Response over frequency at {load}", _picture(tracked, limits=limits))]
    if not peak.converged:
        return figures, []
    contacts = _picture(peak, "plot_contacts", problem)
    figures.append((f"Stick, slip and separation over a cycle of the peak at {load}", contacts))
    if len(problem.coupling.interfaces):
        figures.append((f"Pressure at rest under {load}", _picture(problem.static(best.preload))))
    loop = _picture(hysteresis(problem, peak))
    figures.append((f"Hysteresis loop of all contacts at the peak at {load}", loop))
    rows: list[tuple[str, ...]] = []
    if not peak.corner and problem.settings.contact_forces == "event_driven":
        for s in peak_sensitivities(problem, peak).values():
            size, shift = (
                s.value * s.amplitude / peak.amplitude,
                s.value * s.frequency / peak.frequency,
            )
            cells = (
                (f"{size:+.3f} %", f"{shift:+.4f} %")
                if np.isfinite(size)
                else ("not known", s.reason)
            )
            rows.append((spaced(s.name), *cells))
    return figures, rows


def _short(value: Any) -> str:
    """Format a setting as one line."""
    if isinstance(value, Mapping):  # parts that are not given have no effect
        value = {name: part for name, part in value.items() if part is not None}
    text = value if isinstance(value, str) else json.dumps(value, sort_keys=True)
    return truncate(text, 120)


def _picture(shown: Plottable, kind: str = "plot", *arguments: Any, **options: Any) -> str:
    """Return the plot of a result as an HTML image."""
    svg = io.BytesIO()
    metadata = {"Date": None, "Creator": None}
    save_figure(
        draw(shown, kind, *arguments, **options), svg, format="svg", dpi=110, metadata=metadata
    )
    text = (
        svg.getvalue().decode().replace('"', "'").replace("\n", " ")
    )  # a third shorter than in base 64
    return f'<img alt="figure" src="data:image/svg+xml,{quote(text, safe=" ()*+,-./:;=?@[]_!")}">'
