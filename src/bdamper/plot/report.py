"""An optimal curve for a design review: one HTML file with pictures inside, from the template beside this module.

Each check has a light and the rule behind it: green where it holds, amber where the result is rough, red where it must not
be used as it is, white where nothing was computed.  There is no date in the file and no link, so that the same results give
the same bytes, and printing it gives the same pages anywhere.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from bdamper.analyses.fit import Fitted
from bdamper.analyses.hysteresis import hysteresis
from bdamper.harmonic_balance.problem import Problem
from bdamper.harmonic_balance.result_checks import Asking, check_result, problem_of
from bdamper.response.highest_peak import highest_peak
from bdamper.response.optimal_curve_result import ENDS, NEAR_BEST, OptimalCurve
from bdamper.response.response_curve import frequency_response
from bdamper.response.sensitivity import peak_sensitivities
from bdamper.util import validation
from bdamper.util.display import Plottable, draw, register_plot
from bdamper.util.errors import COMPLETE, import_extra, status_word
from bdamper.util.formatting import amount, percent, spaced, truncate
from bdamper.util.storage import FilePath, check_folder, file_errors

GOOD, FAIR = 0.05, 0.2
"""Relative differences up to which a light is green, and amber."""
NOISE = 1.5, 3.0
"""The same of the misfit of a fit, in units of its noise."""
SAFE = 1.5
"""Margin against fatigue from which on its light is green."""
BELONG = "harmonics", "blade_modes", "contact_points", "friction_coefficient", "contact_stiffness_factor"
"""Settings that a curve and the fit beside it have in common."""
NOT_MODELLED = (
    "Blades and dampers are all alike (a wheel of unequal ones: BladedDisk); the disk is cyclic.",
    "One temperature; friction does not heat.",
    "No wear and no running-in: faces, gaps and friction stay as they are given.",
    "Friction is Coulomb's, one coefficient for each face, equal at rest and in sliding.",
    "No Coriolis forces; bodies are linear, displacements small, contact points stay opposite to each other.",
    "No fluid but what modal damping stands for; steady responses alone.",
)


class Light(NamedTuple):
    """One check: its colour, what it is of, what was found, and the rule."""

    colour: str
    name: str
    found: str
    rule: str


@register_plot(OptimalCurve, "report")
def write_report(
    curve: OptimalCurve, path: FilePath, study: Asking | Problem | None = None, fit: Fitted | None = None
) -> None:
    """Write the report of an optimal curve (:meth:`bdamper.response.optimal_curve_result.OptimalCurve.report`)."""
    jinja2 = import_extra("jinja2", "report", "report")
    check_folder(path)
    best = curve.optimum
    known = np.isfinite(best.amplitude) and np.isfinite(best.preload)
    validation.check(known, "report", "an optimal curve with an optimum", f"one without: {best.status}")
    figures: list[tuple[str, str]] = [("Resonance over preload", _picture(curve))]
    rows: list[tuple[str, ...]] = []
    if study is None and curve.curves:
        at = min(curve.curves, key=lambda c: abs(np.log(c.preload / best.preload)))
        title = f"Response over frequency at {amount(at.preload, 'N')}, the nearest preload that was followed"
        figures.append((title, _picture(at)))
    elif study is not None:
        problem = problem_of(study)
        check_result(problem, curve)
        own, rows = _at_optimum(problem, curve)
        figures += own
    figures += [("Margin against fatigue", _picture(margins)) for margins in curve.margins]
    if fit is not None:
        figures.append(("Measured responses and the model", _picture(validation.instance("fit", fit, Fitted))))
    page = jinja2.Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True).from_string(
        Path(__file__).with_name("report.html").read_text(encoding="utf-8")
    )
    asked = curve.settings.get("frequency")
    band = f", frequency=({asked[0]:.12g}, {asked[1]:.12g})" if asked else ""
    check = "" if curve.time_response else ", check=False"
    low, high = curve.preloads_within(NEAR_BEST * best.amplitude)
    text = page.render(
        curve=curve, fit=fit, figures=figures, lights=lights(curve, fit), sensitivities=rows, left_out=NOT_MODELLED,
        notes=curve.warnings, settings={k: _short(v) for k, v in sorted(curve.settings.items())},
        range=f"{amount(low, 'N')} to {amount(high, 'N')}", given=study is not None,
        lines=(
            "import bdamper as bd",
            'study = bd.load_study("best.h5", bd.load_model("model.h5"))  # best.save("best.h5") has the settings',
            f"best = study.optimal_curve(({curve.preload[0]:.12g}, {curve.preload[-1]:.12g}), {len(curve)}{band}{check})",
        ),
    )  # fmt: skip
    with file_errors(path):
        Path(path).write_bytes(text.encode())


def _has(settings: Mapping[str, Any], name: str, value: Any) -> bool:
    """Whether settings have a value, on the part that the name ends with or on every interface with friction."""
    own, _, part = name.partition(".")
    found = settings.get(own, value)
    if not isinstance(found, Mapping):
        return bool(found == value)
    if isinstance(value, Mapping):
        return dict(found) == dict(value)
    return all(there in (value, 0.0) if not part else there == value for key, there in found.items() if part in ("", key))


def lights(curve: OptimalCurve, fit: Fitted | None = None) -> list[Light]:
    """The checks of an optimal curve, with the rules that decide their colours."""
    best = curve.optimum
    time_rule = f"green below {percent(GOOD)} of difference, amber below {percent(FAIR)}, red beyond, white if not run"
    inside = best.kind not in ENDS
    missing = int(np.count_nonzero(~np.isfinite(curve.amplitude) & (curve.preload > curve.lowest_steady_preload)))
    out = [
        Light("green" if inside else "red", "Optimum within the range", ENDS.get(best.kind, f"inside, {best.kind}"),
              "red at an end of the range of preloads"),
        Light("green" if best.verified else "red", "Optimum verified", best.status,
              "red if a lower value may be elsewhere"),
        Light("red" if missing else "green", "A value at every preload", f"{len(curve) - missing} of {len(curve)}",
              "red if a curve was not followed to its ends"),
    ]  # fmt: skip
    marched = [k for k in curve.time_response if np.isfinite(k.mean) and status_word(k.status) == COMPLETE]
    if marched:
        at = min(marched, key=lambda k: abs(np.log(k.preload / best.preload)))
        found = f"{at.text} in time, {amount(at.balance, 'm')} by harmonic balance"
        off = abs(at.mean / at.balance - 1.0)
        colour = "green" if off < GOOD else "amber" if off < FAIR else "red"
        out.append(Light(colour, "Harmonic balance against time", found, time_rule))
    else:
        why = curve.time_response[0].status if curve.time_response else "not run"
        out.append(Light("red" if curve.time_response else "white", "Harmonic balance against time", why, time_rule))
    more = curve.convergence
    agrees = more is not None and len(more.settled) == len(more.peaks) > 1
    colour = "white" if more is None else "green" if more.converged else "amber" if agrees else "red"
    rule = "green if two larger numbers agree, amber if one does, red if they change the optimum, white if not run"
    out.append(Light(colour, "More harmonics", more.note if more else "not run", rule))
    for margins in curve.margins:
        least = float(np.nanmax(margins.margin))
        colour = "green" if least >= SAFE else "amber" if least >= 1.0 else "red"
        rule = f"red below 1, amber below {SAFE:g}"
        out.append(Light(colour, "Margin against fatigue", f"{least:.3g}", rule))
    if fit is None:
        out.append(Light("white", "Contact constants", "assumed, not fitted", "white without a fit"))
    else:
        given = fit.settings | dict(zip(fit.names, fit.values.tolist()))
        other = [name for name in given if name.split(".")[0] in BELONG and not _has(curve.settings, name, given[name])]
        bad = fit.status != COMPLETE or fit.misfit > NOISE[1] or other
        rule = (
            f"green below {NOISE[0]:g} times the noise, amber below {NOISE[1]:g}, red beyond, incomplete or not those used"
        )
        found = f"misfit {fit.misfit:.2g} times the noise, {fit.status}"
        found += f"; the curve has other values of {', '.join(map(spaced, other))}" * bool(other)
        out.append(Light("red" if bad else "amber" if fit.misfit > NOISE[0] else "green", "Contact constants", found, rule))
    return out


def _at_optimum(problem: Problem, curve: OptimalCurve) -> tuple[list[tuple[str, str]], list[tuple[str, ...]]]:
    """Pictures of the response at the optimum, and rows of its sensitivities."""
    best, mode = curve.optimum, max(0.25 * abs(curve.stuck.frequency - curve.free.frequency), 0.03 * curve.free.frequency)
    ends = [f for f in (curve.free.frequency, best.frequency, curve.stuck.frequency) if np.isfinite(f)]
    band = (min(ends) - mode, max(ends) + mode)
    tracked = frequency_response(problem, best.preload, band)
    peak = highest_peak(problem, best.preload, band)
    where = amount(best.preload, "N")
    figures = [(f"Response over frequency at {where}", _picture(tracked))]
    if not peak.converged:
        return figures, []
    figures.append((f"Stick, slip and separation over a cycle of the peak at {where}", _picture(peak)))
    loop = _picture(hysteresis(problem, peak))
    figures.append((f"Contact forces over the motion of the response in a cycle of the peak at {where}", loop))
    rows: list[tuple[str, ...]] = []
    if not peak.corner and problem.settings.contact_forces == "event_driven":
        for s in peak_sensitivities(problem, peak).values():
            size, shift = s.value * s.amplitude / peak.amplitude, s.value * s.frequency / peak.frequency
            cells = (f"{size:+.3f} %", f"{shift:+.4f} %") if np.isfinite(size) else ("not known", s.reason)
            rows.append((spaced(s.name), *cells))
    return figures, rows


def _short(value: Any) -> str:
    """A setting as one line."""
    text = value if isinstance(value, str) else json.dumps(value, sort_keys=True)
    return truncate(text, 120)


def _picture(shown: Plottable) -> str:
    """The picture of a result inside the page."""
    svg = draw(shown, "image", format="svg", metadata={"Date": None, "Creator": None})
    return f'<img alt="figure" src="data:image/svg+xml;base64,{base64.b64encode(svg).decode()}">'
