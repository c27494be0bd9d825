"""Scaling of results to another excitation and preload, without computation.

Coulomb friction and contact springs give equations that are homogeneous in force: if ``q`` is a solution under excitation
``F`` and preload ``P``, then ``s q`` is a solution under ``s F`` and ``s P``.  An initial gap ``g`` is not scaled, so both
solutions hold only if the closing ``c`` of each gap stays below ``g`` in both.

A damper may be free along a direction ``v`` (for example along the axis, if its faces are parallel to it).  It then drifts
until it touches a guard.  Friction forces do not depend on its mean position, so coordinates with the origin at ``tau v``
are equivalent; there the gaps are ``g - G v tau``.  The origins tried are those at which one gap is closed at rest; all
others must stay open.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import null_space

from bdamper.contact.laws import LAW_CUBIC
from bdamper.plot.motion import modal_amplitudes
from bdamper.response.linear_limits import Limit
from bdamper.response.optimal_curve_result import OptimalCurve
from bdamper.response.response_curve_result import ResponseCurve
from bdamper.study import Study


def rescaled_curve(study: Study, curve: ResponseCurve, factor: float) -> ResponseCurve | None:
    """Scale a response curve to another excitation, with the preload in proportion.

    Parameters
    ----------
    study : Study
        Study at the new excitation.
    curve : ResponseCurve
        Response curve of the same study at another excitation.
    factor : float
        Ratio of the new excitation to the old one.

    Returns
    -------
    ResponseCurve or None
        None if a gap closes, or the equations are not homogeneous.
    """
    load = np.full(len(curve), curve.preload)
    origin = origins(study, curve.unknowns, load, factor) if curve.complete else None
    if origin is None:
        return None
    harmonics, offset = factor * curve.harmonics, (1.0 - factor) * origin
    harmonics[:, 0] += offset @ study.problem.response_rows[0].real
    arrays: dict[str, Any] = {"harmonics": harmonics, "unknowns": _multiplied(curve.unknowns, origin, factor)}
    return replace(curve, **arrays, preload=factor * curve.preload, settings=_settings(study, curve))


def rescaled_optimal(study: Study, curve: OptimalCurve, factor: float) -> OptimalCurve | None:
    """Scale an optimal curve to another excitation, with all preloads in proportion (parameters as in
    :func:`rescaled_curve`).

    Return None also if the search was not complete, since its messages contain preloads.
    """
    verified = curve.complete and curve.optimum.verified
    origin = origins(study, curve.unknowns, curve.preload, factor) if verified else None
    if origin is None:
        return None
    arrays: dict[str, Any] = {name: factor * getattr(curve, name) for name in ("preload", "amplitude")}
    arrays["unknowns"] = _multiplied(curve.unknowns, origin, factor)
    o, free, stuck = curve.optimum, curve.free, curve.stuck
    scaled_curves = (replace(c, harmonics=factor * c.harmonics, preload=factor * c.preload) for c in curve.curves)
    return replace(
        curve, **arrays, curves=tuple(scaled_curves), settings=_settings(study, curve),
        optimum=replace(o, preload=factor * o.preload, amplitude=factor * o.amplitude),
        free=Limit(free.frequency, factor * free.amplitude), stuck=Limit(stuck.frequency, factor * stuck.amplitude),
    )  # fmt: skip


def _settings(study: Study, result: ResponseCurve | OptimalCurve) -> dict[str, object]:
    return {**result.settings, "excitation": study.problem.record()["excitation"]}


def _multiplied(unknowns: NDArray, origin: NDArray, factor: float) -> NDArray:
    """Scale unknowns about the origins of their mean."""
    out = factor * unknowns
    out[:, : origin.shape[1]] += (1.0 - factor) * origin
    return out


def origins(study: Study, unknowns: NDArray, preload: NDArray, factor: float) -> NDArray | None:
    """Return the origins about which the mean of each solution can be scaled, or None if scaling is not possible.

    Parameters
    ----------
    study : Study
    unknowns : (n, n_unknowns) float
        Solutions before scaling.
    preload : (n,) float, N
        Preload of each solution.
    factor : float

    Returns
    -------
    (n, n_mean) float or None
        Modal coordinates of the mean.
    """
    problem, settings = study.problem, study.settings
    gaps = problem.point_gaps
    laws = (problem.point_laws == LAW_CUBIC).any() or not problem.static_system.scales or problem.own_laws is not None
    if laws or settings.speed is not None or settings.residual_slip_std or not settings.bias:
        return None
    has_gap, basis = gaps > 0.0, problem.bases[0]
    mean, *amplitudes = modal_amplitudes(problem, unknowns)
    out, valid = np.zeros_like(mean), np.zeros(len(mean), bool)
    closing = mean @ basis.G.real[has_gap, 2].T + np.outer(preload, problem.static_system.shift[has_gap, 2])
    for harmonic_basis, amplitude in zip(problem.bases[1:], amplitudes):
        closing = closing + np.abs(amplitude @ harmonic_basis.G[has_gap, 2].T)
    pressing, stiffness = basis.G.real[~has_gap, 2], np.diag(basis.omega2 / basis.omega2.max())
    drifts = null_space(np.concatenate([pressing / (np.abs(pressing).max(initial=0.0) or 1.0), stiffness]))
    drift = drifts[:, 0] if drifts.shape[1] == 1 else np.zeros(len(basis.omega2))
    moves = basis.G.real[has_gap, 2] @ drift
    reached = np.abs(moves) > 0.0
    closed = 1e-6  # relative width below which a gap counts as closed
    for tau in (0.0, *(gaps[has_gap][reached] / moves[reached])):
        width = gaps[has_gap] - tau * moves
        stays_open = max(1.0, factor) * (closing - tau * moves) < width
        at_tau = ((width >= -closed * gaps[has_gap]) & (stays_open | (width <= closed * gaps[has_gap]))).all(axis=1)
        out[at_tau & ~valid] = tau * drift
        valid |= at_tau
    return out if valid.all() else None
