"""Where tests set off from: a first solution, peaks through values of a parameter, equations with other forces."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from bdamper.contact.laws import LAW_CONSTANT, LAW_SEPARABLE
from bdamper.response.branches import first_point
from bdamper.response.peak import find_peak
from bdamper.response.response_curve import why_no_solution
from bdamper.response.sensitivity import sensitivities
from bdamper.util.errors import SettingError

NEAR = 0.2
"""Distance of a peak from its prediction, relative to the vibration."""


class Followed(NamedTuple):
    """Peaks at the values, as far as they exist, the last value up to which the peak was followed, and how it ended."""

    peaks: tuple
    ended: float
    status: str
    reason: str


def _next(family, known, value):
    """The peak at a value, predicted from the last two; None if it is not near."""
    last, before = known[-1], known[-2] if len(known) > 1 else None
    if before is not None and before.parameter != last.parameter:
        slope = (last.y - before.y) / (last.parameter - before.parameter)
    else:
        try:
            slope = np.nan_to_num(sensitivities(last, {"p": (family, last.parameter)})["p"].y)
        except (SettingError, ArithmeticError):
            slope = np.zeros_like(last.y)
    system, guess = family(value), last.y + (value - last.parameter) * slope
    found = find_peak(system, guess, tangent=last.tangent, scale=last.scale, curvature=last.curvature, parameter=value,
                      reach=0.5)  # fmt: skip
    n = system.n_mean
    near = np.linalg.norm((found.y - guess)[n:-1]) < NEAR * np.linalg.norm(last.y[n:-1])
    return (found if found.ok and near else None), found.status


def follow_peak(family, start, values):
    known, peaks = [start], []
    for value in map(float, values):
        way = [value]
        while way:
            if way[-1] == known[-1].parameter:
                found, reason = known[-1], ""
            else:
                found, reason = _next(family, known, way[-1])
            if found is None:
                way.append(0.5 * (known[-1].parameter + way[-1]))
                if len(way) > 14:
                    return Followed(tuple(peaks), known[-1].parameter, "vanished", reason or "far")
                continue
            known = [*known[-1:], found]
            way.pop()
        peaks.append(known[-1])
    return Followed(tuple(peaks), known[-1].parameter, "complete", "")


def find_start(problem, preload, omega, options, meter):
    """A solution (n_unknowns + 1,) at one frequency (rad/s), None where there is none, and what was tried."""
    case = problem.at(preload)
    if not case.static.ok:
        return None, [f"static state: {case.static.reason}"]
    system = case.equations
    meter.watch(system)
    found, log, last = first_point(system, case.static, case.stuck_springs(), omega, options, meter)
    why = (
        ""
        if found is not None
        else why_no_solution(system, problem.coupling.model, problem.bases[0].coordinates, last)
    )
    return found, [*log, why] if why else log


def changed(system, force=None, slider=None):
    """The same equations under another modal force, or with other sliders (n_points, 2), m."""
    sector = system.structure
    points = sector.points if slider is None else replace(sector.points, slider=slider)
    return replace(sector, points=points, force=sector.force if force is None else force).equations


def slider_interval(system, u):
    """(n_points, 2, 2) m, sliders that a point which never slips may have, NaN where it slips, opens or has no friction.

    Such a point rests with any slider from the largest ``u_d - mu N/kt`` to the smallest ``u_d + mu N/kt`` of the cycle.
    """
    law, kt = np.asarray(system.structure.points.law), np.asarray(system.structure.points.kt)
    one_d = ((law == LAW_SEPARABLE) | (law == LAW_CONSTANT))[:, None]
    out = np.full((system.n_points, 2, 2), np.nan)
    for end, far in enumerate((-np.inf, np.inf)):
        X, F, share = changed(
            system, slider=np.where(one_d, far, system.structure.points.slider)
        ).contact(u)
        rests = one_d & (share[:, [0, 2]] > 1.0 - 1e-9)
        out[..., end] = np.where(
            rests, X[:, :2, 0] - F[:, :2, 0] / np.where(rests, kt, 1.0), np.nan
        )
    return out
