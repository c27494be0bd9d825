"""Cases on which estimated errors are compared with true ones.

Models, resonances and preloads are those of :mod:`tests.effect_cases`; every case takes one source of error.  True is the
highest peak under the settings that the estimate looks at: of a tracking curve, of the search for peaks, and of the branch
that the cheap peak leads to.  (Where a branch comes off the curve and closes on itself, or a peak leaves the
interval, only the last finds it.)  A case whose reference is a curve of more than 1,500 points is left out: it would take
minutes for what it has beside the peak.  References with up to seven harmonics take seconds with few contact points and
a contact that is not nearly loose, so cases of harmonics have these (:func:`affordable`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

import bdamper as bd
from bdamper.accuracy.estimate import estimate_errors
from bdamper.accuracy.ladders import varied
from bdamper.continuation.curve import Curve
from bdamper.effects.indicator import embed
from bdamper.peaks.newton import Peak, find_peak
from tests.effect_cases import Case, draw, scene, study_of

SOURCES = ("harmonics", "evaluation", "contact points", "modes")
LONGEST = bd.ContinuationOptions(max_points=1500)
"""How references are tracked."""


@dataclass(frozen=True)
class Compared:
    """Estimated and true relative change of a peak."""

    case: Case
    source: str
    estimated: tuple[float, float]
    true: tuple[float, float]
    folded: bool
    text: str

    @property
    def effectivity(self) -> float:
        """Size of the estimated over that of the true change, the larger of amplitude and frequency each."""
        return max(map(abs, self.estimated)) / max(max(map(abs, self.true)), 1e-300)


def affordable(case: Case) -> Case:
    """A case with few contact points on a face and a preload that is not very low."""
    return replace(case, points=9 if case.kind == "reference" else 4, level=max(case.level, 0.1))


def compare(number: int) -> Compared | None:
    """Estimate and truth of one case; None where there is no peak, or no error to speak of."""
    source = SOURCES[(number // 2) % len(SOURCES)]
    case = affordable(draw(number)) if source == "harmonics" else draw(number)
    rng = np.random.default_rng([8, number])
    study = replace(study_of(case), harmonics=1, damper_modes=0)
    changes: dict = {}
    if source == "harmonics":
        own = int(rng.choice([1, 2, 3]))
        study, changes = varied(study, {"harmonics": own}), {"harmonics": own + 4}
    elif source == "evaluation":
        n = int(rng.choice([24, 32, 64, 128, 256]))
        study, changes = replace(study, evaluation=bd.Sampled(n)), {"evaluation": "exact"}
    elif source == "contact points":
        full = study.most_points
        study = replace(study, contact_points=int(rng.choice([full // 2, full // 3 + 1, full - 1])))
        changes = {"contact_points": full}
    else:
        study = replace(study, blade_modes=8 if case.kind == "reference" else 2)
        changes = {"blade_modes": 40, "damper_modes": 10}
        if case.kind != "reference":
            changes = {"blade_modes": 5, "damper_modes": 2}
    place = scene(study, case)
    if place is None:
        return None
    preload, interval = place
    try:
        curve = study.track(preload, interval)
        if not curve.complete:
            return None
        peak = curve.peak
        richest = varied(study, changes)
        true = richest.peak(preload, interval)
    except bd.BdamperError:
        return None
    finer = richest.track(preload, interval, options=LONGEST)
    if not finer.complete:
        return None
    tops = [(true.amplitude, true.frequency), (finer.peak.amplitude, finer.peak.frequency)]
    apart = apart_from(study, richest, curve)
    if apart is not None and curve.point_kind[peak.index] != "end":
        tops.append((apart.amplitude, apart.frequency))
    top = max(tops)
    error = top[0] / peak.amplitude - 1.0, top[1] / peak.frequency - 1.0
    if max(map(abs, error)) < 1e-8:
        return None
    found = estimate_errors(study, curve, sources=[source])[source]
    return Compared(case, source, (found.amplitude, found.frequency), error, bool(curve.folds), found.against)


def apart_from(study: bd.Study, richer: bd.Study, curve: Curve) -> Peak | None:
    """The peak of a richer study that Newton finds from the highest point of a curve."""
    top = curve.peak
    b = richer.system(curve.preload)
    y = np.append(curve.unknowns[top.index], 2.0 * np.pi * top.frequency)
    start = embed(study, richer, curve.preload, y)
    found = find_peak(b, start)
    return found if found.converged else None
