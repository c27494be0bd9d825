"""A tracking curve with one harmonic and few modes where that is enough, and with what is called for elsewhere.

1. The curve is followed with one harmonic, without the elastic modes of the damper where the linear stuck resonances do not
   need them.
2. The indicator (:mod:`bdamper.effects.indicator`) is asked at every third point, at maxima and folds: what the full study
would
   change there, and which harmonics make it up.
3. Where that exceeds half of the tolerance, in intervals of frequency, the curve is followed anew with what is called for
   there.  Neighbouring intervals with different needs stay apart where the curve is single-valued between them.  Each piece
   is asked again, and followed with everything on if it is not good enough.
"""

from __future__ import annotations

import time
from dataclasses import fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from bdamper.continuation.curve import Curve, uninterrupted
from bdamper.continuation.follower import ContinuationOptions
from bdamper.effects.adaptive import MARGIN, On, Search, check_tolerance
from bdamper.effects.indicator import Estimate
from bdamper.util.cost import Cost

if TYPE_CHECKING:
    from bdamper.study import Study

APART = 0.03
"""Parts of the frequency interval below which intervals of different needs are not worth a curve of their own."""

Window = tuple[float, float, On]


def adaptive_curve(
    study: Study,
    preload: float,
    frequency: tuple[float, float],
    *,
    tolerance: float = 0.01,
    options: ContinuationOptions | None = None,
) -> Curve:
    """A tracking curve with the harmonics and modes of the study only where they are called for.

    Parameters
    ----------
    study : Study
        With everything on that is to be taken into account.
    preload : float, N
    frequency : (low, high), Hz
    tolerance : float
        On amplitude and frequency at the same phase of the response, relative, at every point.
    options : ContinuationOptions

    Returns
    -------
    Curve
        In the unknowns of the full study, zero where a harmonic or mode is off.  ``settings["adaptive"]`` holds what was on
        in which interval, and the largest estimated error that remains.  Branches are the pieces that were followed in one
        go; where one ends and the next begins they differ by less than the tolerance.
    """
    check_tolerance(tolerance)
    begin = time.perf_counter()
    search = Search(study, float(preload), frequency, tolerance)
    search.least = base = search.rigid_if_enough()
    everything = search.everything
    curve = uninterrupted(search.variant(base)[0].track(preload, frequency, options=options))
    if not curve.complete or base == everything:
        whole = curve if base == everything else uninterrupted(study.track(preload, frequency, options=options))
        return _noted(whole, tolerance, base, [(*frequency, everything)], 0.0, curve, begin)
    at, estimates = sampled_estimates(search, curve, base)
    pieces: list[Curve] = []
    used: list[Window] = []
    rest = 0.0
    for low, high, on in _windows(curve, at, estimates, search):
        for wanted in dict.fromkeys((on, everything)):
            piece = uninterrupted(search.variant(wanted)[0].track(preload, (low, high), options=options))
            _, left = sampled_estimates(search, piece, wanted)
            error = max((e.size for e in left), default=0.0)
            if wanted == everything or (piece.complete and error <= tolerance):
                break
        pieces.append(_widened(search, piece, wanted))
        used.append((low, high, wanted))
        rest = max(rest, error)
    outside = np.ones(len(curve), bool)
    for low, high, _ in used:
        outside &= (curve.frequency < low) | (curve.frequency > high)
    calm = [e.size for i, e in zip(at, estimates) if outside[i]]
    rest = max(rest, max(calm, default=0.0))
    return _noted(_joined(_widened(search, curve, base), outside, pieces), tolerance, base, used, rest, curve, begin)


def sampled_estimates(search: Search, curve: Curve, on: On) -> tuple[list[int], list[Estimate]]:
    """Estimates at every few points of a curve and at its maxima and folds; none where nothing is left out."""
    if on == search.everything:
        return [], []
    at = [i for i in range(len(curve)) if i % 3 == 0 or curve.point_kind[i] in ("maximum", "fold") or i == len(curve) - 1]
    return at, [search.estimate(np.append(curve.unknowns[i], 2.0 * np.pi * curve.frequency[i]), on) for i in at]


def _windows(curve: Curve, at: list[int], estimates: list[Estimate], search: Search) -> list[Window]:
    """Frequency intervals in which more than the least is called for, and what."""
    spans: list[Window] = []
    for k, e in enumerate(estimates):
        if e.size > MARGIN * search.tolerance:
            f = curve.frequency[at[max(k - 1, 0)] : at[min(k + 1, len(at) - 1)] + 1]
            spans.append((float(f.min()), float(f.max()), search.called_for(e, search.least)))
    narrow = APART * (search.frequency[1] - search.frequency[0])
    cuts = sorted({f for low, high, _ in spans for f in (low, high)})
    parts: list[Window] = []
    for low, high in zip(cuts, cuts[1:]):
        wanted = [on for a, b, on in spans if a < high and b > low]
        if wanted:
            parts.append((low, high, _both(wanted)))
    folded = _folded(curve, narrow)
    out: list[Window] = []
    for low, high, on in parts:
        if out:
            a, b, before = out[-1]
            cut = any(x <= b and low <= y for x, y in folded)
            if low - b <= narrow and (cut or before == on or low > b or min(b - a, high - low) <= narrow):
                out[-1] = (a, high, _both([before, on]))
                continue
        out.append((low, high, on))
    return out


def _folded(curve: Curve, margin: float) -> list[tuple[float, float]]:
    """Intervals between folds, where the curve has several solutions, and a little beyond."""
    f = np.sort([curve.frequency[i] for i, kind in enumerate(curve.point_kind) if kind == "fold"])
    back = curve.frequency[curve.backward]
    if not len(f) and not len(back):
        return []
    several = np.concatenate([f, back])
    return [(float(several.min()) - margin, float(several.max()) + margin)]


def _both(wanted: list[On]) -> On:
    """What is on in any of them."""
    harmonics = tuple(sorted({l for on in wanted for l in on.harmonics}))
    return On(harmonics, max(on.damper_modes for on in wanted))


def _widened(search: Search, curve: Curve, on: On) -> Curve:
    """The curve in the unknowns of the full study."""
    if on == search.everything:
        return curve
    rich = search.variant(search.everything)[1]
    unknowns = np.zeros((len(curve), rich.n_unknowns))
    for i in range(len(curve)):
        unknowns[i] = search.moved(np.append(curve.unknowns[i], 0.0), on, search.everything)[:-1]
    return replace(curve, unknowns=unknowns, harmonics=rich.response(unknowns))


def _joined(base: Curve, outside: NDArray, pieces: list[Curve]) -> Curve:
    """Points of the base curve outside of the windows, and the pieces, each followed in one go a branch of its own."""
    parts: list[tuple[Curve, NDArray]] = []
    # runs of the base curve between windows
    cuts = np.flatnonzero(np.diff(outside.astype(int))) + 1
    for run in np.split(np.arange(len(base)), cuts):
        if len(run) and outside[run[0]]:
            parts.append((base, run))
    parts += [(piece, np.arange(len(piece))) for piece in pieces if len(piece)]
    parts.sort(key=lambda p: float(p[0].frequency[p[1]].min()))
    branch: list[NDArray] = []
    for curve, index in parts:
        own = curve.branch[index]
        branch.append(own - own.min() + (branch[-1].max() + 1 if branch else 0))

    names = ("frequency", "harmonics", "unknowns", "residual", "shares", "backward", "rank_deficiency")
    arrays: dict[str, Any] = {
        name: np.concatenate([getattr(curve, name)[index] for curve, index in parts]) for name in names
    }
    stable = [None if curve.stable is None else curve.stable[index] for curve, index in parts]
    judged = [s for s in stable if s is not None]
    arrays["stable"] = np.concatenate(judged) if judged and len(judged) == len(stable) else None
    bad = [piece for piece in pieces if not piece.complete]
    spans = [(piece.frequency.min(), piece.frequency.max()) for piece in pieces if len(piece)]
    kept = [part for part in base.left_out if not any(a <= part.low and part.high <= b for a, b in spans)]
    return replace(
        base,
        **arrays,
        left_out=tuple(sorted({*kept, *(part for piece in pieces for part in piece.left_out)})),
        branch=np.concatenate(branch),
        point_kind=tuple(curve.point_kind[i] for curve, index in parts for i in index),
        status="incomplete" if bad else base.status,
        reason="; ".join(piece.reason for piece in bad) if bad else base.reason,
        start_log=tuple(line for curve in [base, *pieces] for line in curve.start_log),
        notes=tuple(dict.fromkeys(line for curve in [base, *pieces] for line in curve.notes)),
        cost=_summed([base.cost, *(piece.cost for piece in pieces)]),
        settings={**(pieces[0] if pieces else base).settings},
    )


def _summed(costs: list[Cost]) -> Cost:
    return Cost(*(sum(getattr(c, f.name) for c in costs) for f in fields(Cost)))


def _noted(
    curve: Curve,
    tolerance: float,
    base: On,
    windows: list[Window],
    error: float,
    first: Curve,
    begin: float,
) -> Curve:
    note = {
        "tolerance": tolerance,
        "elsewhere": _text(base),
        "intervals": [{"from": low, "to": high, **_text(on)} for low, high, on in windows],
        "estimated_error": error,
        "points_with_one_harmonic": len(first),
    }
    cost = replace(curve.cost, seconds=time.perf_counter() - begin)
    return replace(curve, settings={**curve.settings, "adaptive": note}, cost=cost)


def _text(on: On) -> dict[str, Any]:
    return {"harmonics": list(on.harmonics), "damper_modes": on.damper_modes}
