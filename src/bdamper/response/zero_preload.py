"""The response curve without a preload: nothing holds the dampers in their seats, so the response is the free one.

A damper that its load presses against its neighbours leaves them against that load.  With its mean position so far off
that no contact point closes in a cycle, the free response satisfies all equations exactly, wherever beyond that it rests.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from bdamper.harmonic_balance.problem import Problem
from bdamper.response.curve import ResponseCurve
from bdamper.response.linear_curve import free

NOTE = "without a preload nothing holds the damper: this is the free response (study.free), with the damper off its seat"


def free_of_contact(problem: Problem, frequency: tuple[float, float], options: Any) -> ResponseCurve | None:
    """The free response as a response curve at no preload, with the dampers away from their seats.

    Parameters
    ----------
    problem : Problem
    frequency : (low, high), Hz
    options : ContinuationOptions

    Returns
    -------
    ResponseCurve or None
        None where these points do not satisfy the equations: a structure without a loaded damper, surfaces that press each
        other without a load, springs of a bonded contact, a mean that is held.
    """
    system, load = problem.system(0.0), problem.damper_load[0]
    rigid = problem.static_basis.omega2 == 0.0
    away = -np.where(rigid, load, 0.0)[: system.n_mean]
    opening = -(problem.static_basis.G.real[problem.friction_points, 2, : len(away)] @ away)
    if not (opening.size and opening.min() > 1e-6 * np.abs(opening).max() > 0.0):
        return None
    curve = free(problem, frequency)
    swing = 0.0
    for l in problem.settings.excited:
        G, amplitude = problem.bases[l].G[problem.friction_points, 2], system.layout.amplitudes(curve.unknowns, l)
        swing += np.abs(G @ amplitude.T).max(initial=0.0)
    overlap = max(0.0, -float(problem.point_gaps[problem.friction_points].min()))
    unknowns = curve.unknowns.copy()
    unknowns[:, : len(away)] += (2.0 * swing + overlap) / opening.min() * away
    residual = np.array([system.error(y) for y in np.column_stack([unknowns, 2.0 * np.pi * curve.frequency])])
    if not len(curve) or residual.max() > options.tolerance:
        return None
    return replace(
        curve, kind="tracking", unknowns=unknowns, harmonics=system.response(unknowns), residual=residual,
        rank_deficiency=np.full(len(curve), int(rigid.sum())), reason="the free response", notes=(NOTE,),
        settings=problem.record(options),
    )  # fmt: skip
