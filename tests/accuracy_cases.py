"""Cases on which estimated errors are compared with true ones, and settings chosen by themselves with all others.

Models, resonances and preloads are those of :mod:`tests.effect_cases`; every case takes one source of error.  True is the
highest peak under settings richer than those that the estimate looks at.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

import bdamper as bd
from bdamper.accuracy import varied
from bdamper.estimation import estimate_errors, points_on_a_face
from tests.effect_cases import Case, draw, scene, study_of

SOURCES = ("harmonics", "evaluation", "contact points", "modes")


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


def compare(number: int) -> Compared | None:
    """Estimate and truth of one case; None where there is no peak, or no error to speak of."""
    case = draw(number)
    rng = np.random.default_rng([8, number])
    source = SOURCES[(number // 2) % len(SOURCES)]
    study = replace(study_of(case), harmonics=1, damper_modes=0)
    changes: dict = {}
    if source == "harmonics":
        own = int(rng.choice([1, 2, 3]))
        study, changes = varied(study, {"harmonics": own}), {"harmonics": own + 11}
    elif source == "evaluation":
        n = int(rng.choice([24, 32, 64, 128, 256]))
        study, changes = replace(study, evaluation=bd.Sampled(n)), {"evaluation": "exact"}
    elif source == "contact points":
        full = points_on_a_face(study)
        study = replace(study, contact_points=int(rng.choice([full // 2, full // 3 + 1, full - 1])))
        changes = {"contact_points": full}
    else:
        study = replace(study, blade_modes=8 if case.kind == "reference" else 2)
        changes = dict(zip(("blade_modes", "damper_modes"), (40, 10) if case.kind == "reference" else (5, 2)))
    place = scene(study, case)
    if place is None:
        return None
    preload, interval = place
    try:
        curve = study.track(preload, interval)
        if not curve.complete:
            return None
        peak = curve.peak
        true = varied(study, changes).peak(preload, interval)
    except bd.BdamperError:
        return None
    error = true.amplitude / peak.amplitude - 1.0, true.frequency / peak.frequency - 1.0
    if max(map(abs, error)) < 1e-8:
        return None
    found = estimate_errors(study, curve, sources=[source])[source]
    return Compared(case, source, (found.amplitude, found.frequency), error, bool(curve.folds), found.against)
