"""Cases on which estimated errors are compared with true ones.

Models, resonances and preloads are those of :mod:`tests.effect_cases`; every case takes one source of error.  True is the
highest peak under the settings that the estimate looks at: of a response curve, of the search for peaks, and of the branch
that the cheap peak leads to, which may come off the curve and close on itself.  Where the resonance has left the interval,
it is looked for on one curve far beyond it.  A case whose reference is a curve of more than 1,500 points is left out: it
would take minutes for what it has beside the peak.  References with up to seven harmonics take seconds with few contact
points and a contact that is not nearly loose, so cases of harmonics have these (:func:`affordable`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

import bdamper as bd
from bdamper.analyses.accuracy import varied
from bdamper.analyses.error_estimates import estimate_errors
from bdamper.response.highest_peak import AT_END
from bdamper.response.peak import Peak, find_peak
from bdamper.response.response_curve_result import ResponseCurve
from bdamper.response.richer_peak import embed
from tests.effect_cases import Case, draw, scene, study_of

SOURCES = ("harmonics", "contact_forces", "contact points", "modes")
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
    study = study_of(case).replace(harmonics=1, damper_modes=0)
    changes: dict = {}
    if source == "harmonics":
        own = int(rng.choice([1, 2, 3]))
        study, changes = (
            study._with_problem(varied(study.problem, {"harmonics": own})),
            {"harmonics": own + 4},
        )
    elif source == "contact_forces":
        n = int(rng.choice([24, 32, 64, 128, 256]))
        study, changes = study.replace(contact_forces=bd.AFT(n)), {"contact_forces": "event_driven"}
    elif source == "contact points":
        full = study.settings.most_points
        study = study.replace(contact_points=int(rng.choice([full // 2, full // 3 + 1, full - 1])))
        changes = {"contact_points": full}
    else:
        study = study.replace(blade_modes=8 if case.kind == "reference" else 2)
        changes = {"blade_modes": 40, "damper_modes": 10}
        if case.kind != "reference":
            changes = {"blade_modes": 5, "damper_modes": 2}
    place = scene(study, case)
    if place is None:
        return None
    preload, interval = place
    try:
        curve = study.frequency_response(preload, interval)
        if not curve.complete:
            return None
        richest = study._with_problem(varied(study.problem, changes))
        own = study.peak(preload, interval)
        top = highest_of_richer(study, richest, curve, own)
    except bd.BdamperError:
        return None
    if top is None:
        return None
    base = (
        own if curve.peak_at_end else curve.peak
    )  # a search follows its curve coarsely, and corners are points of it
    error = top[0] / known_amplitude(base) - 1.0, top[1] / base.frequency - 1.0
    if max(map(abs, error)) < 1e-8:
        return None
    found = estimate_errors(study.problem, curve, sources=[source])[source]
    return Compared(
        case, source, (found.amplitude, found.frequency), error, len(curve.folds) > 0, found.against
    )


def known_amplitude(peak: Peak) -> float:
    """Amplitude of a peak, or of the highest maximum beside a higher end of the interval."""
    return peak.amplitude if peak.ok else peak.lower_bound


def highest_of_richer(
    study: bd.Study, richer: bd.Study, curve: ResponseCurve, own: Peak
) -> tuple[float, float] | None:
    """Amplitude and frequency of the highest peak of a richer study, NaN if it has none; None if its curve takes too long.

    An end of the interval counts only where the curve itself has no maximum.  Where the richer response is highest at an
    end and that of the study is not, the resonance has left the interval, and is the next maximum beyond that end.
    """
    preload, interval = curve.preload, (curve.frequency.min(), curve.frequency.max())
    finer = richer.frequency_response(preload, interval, options=LONGEST)
    if not finer.complete:
        return None
    if finer.peak_at_end and not curve.peak_at_end:
        return beyond(richer, finer)
    at_end = AT_END in own.search_reason
    tops = [
        top
        for top in (richer.peak(preload, interval),)
        if at_end or AT_END not in top.search_reason
    ]
    if not at_end and (apart := apart_from(study, richer, preload, own)) is not None:
        tops.append(apart)
    if at_end or not finer.peak_at_end:
        tops.append(finer.peak)
    return max(((known_amplitude(top), top.frequency) for top in tops), default=(np.nan, np.nan))


def beyond(study: bd.Study, curve: ResponseCurve) -> tuple[float, float] | None:
    """The maximum next to the end at which a curve is highest, outside its interval, and higher than that end."""
    low, high = curve.frequency.min(), curve.frequency.max()
    upward = curve.peak.frequency == high
    wide = (low, 1.5 * high) if upward else (low / 1.5, high)
    curve, end = study.frequency_response(curve.preload, wide, options=LONGEST), curve.peak
    if not curve.complete:
        return None
    a, f, branch = curve.amplitude, curve.frequency, curve.branch
    inner = (
        (branch[:-2] == branch[1:-1])
        & (branch[2:] == branch[1:-1])
        & (a[1:-1] >= a[:-2])
        & (a[1:-1] >= a[2:])
    )
    at = 1 + np.flatnonzero(
        inner & (a[1:-1] > end.amplitude) & ((f[1:-1] > high) if upward else (f[1:-1] < low))
    )
    nearest = min(at, key=lambda i: abs(f[i] - end.frequency), default=None)
    return (np.nan, np.nan) if nearest is None else (float(a[nearest]), float(f[nearest]))


def apart_from(study: bd.Study, richer: bd.Study, preload: float, own: Peak) -> Peak | None:
    """The peak of a richer study that Newton finds from the peak of a study."""
    found = find_peak(
        richer.problem.system(preload), embed(study.problem, richer.problem, preload, own.y)
    )
    return found if found.ok else None
