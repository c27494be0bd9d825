r"""Answers at one excitation from those at another, without computing.

Coulomb friction and contact springs give equations that are homogeneous in force: if ``q`` solves them under excitation
``F`` and preload ``P``, then ``s q`` solves them under ``s F`` and ``s P``.  A gap ``g`` that is open at rest keeps its
width, so both solutions hold only if the closing ``c`` of this gap stays below it in either of them.

A damper that no spring holds along some direction ``v`` (along the axis, say, where its faces are parallel to it) drifts
until it touches a guard.  Friction forces do not depend on its mean position, so coordinates whose origin lies at
``tau v`` serve as well: there the gaps are ``g - G v tau``.  Of the origins, those are tried at which one of the gaps is
closed at rest, and the others have to stay open.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import null_space

from bdamper.contact.laws import LAW_CUBIC
from bdamper.plot.motion import modal_amplitudes
from bdamper.response.optimal_curve_result import Limit, OptimalCurve
from bdamper.response.response_curve_result import ResponseCurve
from bdamper.study import Study


def rescaled_curve(study: Study, curve: ResponseCurve, factor: float) -> ResponseCurve | None:
    """A response curve at an excitation and a preload that are both multiplied by a factor.

    Parameters
    ----------
    study : Study
        At the excitation that is asked for.
    curve : ResponseCurve
        Of the same study at its own excitation.
    factor : float
        Ratio of the excitations.

    Returns
    -------
    ResponseCurve or None
        None where a gap closes, or the equations are not homogeneous.
    """
    load = np.full(len(curve), curve.preload)
    origin = origins(study, curve.unknowns, load, factor) if curve.complete else None
    if origin is None:
        return None
    harmonics, rest = factor * curve.harmonics, (1.0 - factor) * origin
    harmonics[:, 0] += rest @ study.problem.response_rows[0].real
    known: dict[str, Any] = {"harmonics": harmonics, "unknowns": _multiplied(curve.unknowns, origin, factor)}
    return replace(curve, **known, preload=factor * curve.preload, settings=_settings(study, curve))


def rescaled_optimal(study: Study, found: OptimalCurve, factor: float) -> OptimalCurve | None:
    """An optimal curve at an excitation and preloads that are all multiplied; parameters as of :func:`rescaled_curve`.

    None also where the search left something open, since its texts name preloads.
    """
    whole = found.complete and found.optimum.verified
    origin = origins(study, found.unknowns, found.preload, factor) if whole else None
    if origin is None:
        return None
    arrays: dict[str, Any] = {name: factor * getattr(found, name) for name in ("preload", "amplitude")}
    arrays["unknowns"] = _multiplied(found.unknowns, origin, factor)
    o, free, stuck = found.optimum, found.free, found.stuck
    curves = (replace(c, harmonics=factor * c.harmonics, preload=factor * c.preload) for c in found.curves)
    return replace(
        found, **arrays, curves=tuple(curves), settings=_settings(study, found),
        optimum=replace(o, preload=factor * o.preload, amplitude=factor * o.amplitude),
        free=Limit(free.frequency, factor * free.amplitude), stuck=Limit(stuck.frequency, factor * stuck.amplitude),
    )  # fmt: skip


def _settings(study: Study, result: ResponseCurve | OptimalCurve) -> dict[str, object]:
    return {**result.settings, "excitation": study.problem.record()["excitation"]}


def _multiplied(unknowns: NDArray, origin: NDArray, factor: float) -> NDArray:
    """Unknowns multiplied about origins of their mean."""
    out = factor * unknowns
    out[:, : origin.shape[1]] += (1.0 - factor) * origin
    return out


def origins(study: Study, unknowns: NDArray, preload: NDArray, factor: float) -> NDArray | None:
    """Where the mean of each solution may be multiplied about; None where the solutions may not be multiplied.

    Parameters
    ----------
    study : Study
    unknowns : (n, n_unknowns) float
        Solutions before it.
    preload : (n,) float, N
        Of each.
    factor : float

    Returns
    -------
    (n, n_mean) float or None
        Modal coordinates of the mean.
    """
    problem, settings = study.problem, study.settings
    gaps = problem.point_gaps
    own = (problem.point_laws == LAW_CUBIC).any() or not problem.static_system.scales or problem.own_laws is not None
    if own or settings.speed is not None or settings.residual_slip_std or not settings.bias:
        return None
    far, basis = gaps > 0.0, problem.bases[0]
    mean, *waves = modal_amplitudes(problem, unknowns)
    out, fits = np.zeros_like(mean), np.zeros(len(mean), bool)
    closing = mean @ basis.G.real[far, 2].T + np.outer(preload, problem.static_system.shift[far, 2])
    for other, wave in zip(problem.bases[1:], waves):
        closing = closing + np.abs(wave @ other.G[far, 2].T)
    pressing, stiffness = basis.G.real[~far, 2], np.diag(basis.omega2 / basis.omega2.max())
    drifts = null_space(np.concatenate([pressing / (np.abs(pressing).max(initial=0.0) or 1.0), stiffness]))
    drift = drifts[:, 0] if drifts.shape[1] == 1 else np.zeros(len(basis.omega2))
    moves = basis.G.real[far, 2] @ drift
    reached = np.abs(moves) > 0.0
    closed = 1e-6  # relative width below which a gap counts as closed
    for tau in (0.0, *(gaps[far][reached] / moves[reached])):
        left = gaps[far] - tau * moves
        open_ = max(1.0, factor) * (closing - tau * moves) < left
        fit = ((left >= -closed * gaps[far]) & (open_ | (left <= closed * gaps[far]))).all(axis=1)
        out[fit & ~fits] = tau * drift
        fits |= fit
    return out if fits.all() else None
