"""Marches that start at the tip as well: drawn studies of three masses, compared with sweeps by an own program."""

import re
from math import cos, hypot, sin, tau
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
import pytest
import scipy.linalg

import bdamper as bd
from bdamper.time_domain import steady_amplitude as room
from bdamper.time_domain.steady_amplitude import SteadyPoint, TipSearch


class Drawn(NamedTuple):
    """Springs from the ground to the first mass and on to the next; gaps (mass, kn, gap), sliders (mass, kt, limit)."""

    mass: list[float]
    stiffness: list[float]
    beta: float
    gaps: list[tuple[int, float, float]]
    sliders: list[tuple[int, float, float]]
    force: float
    at: int


def random(seed):
    """Three masses with one or two contacts to the ground: gaps that close, or friction under a constant load."""
    rng = np.random.default_rng(seed)
    mass, k, zeta = rng.uniform(0.5, 2.0, 3), rng.uniform(0.5, 2.0, 3), 10.0 ** rng.uniform(-2.5, -1.5)
    gaps, sliders = [], []
    for _ in range(rng.integers(1, 3)):
        at = int(rng.integers(0, 3))
        if rng.random() < 0.5:
            gaps.append((at, float(10.0 ** rng.uniform(-0.5, 1.0)), float(10.0 ** rng.uniform(-1.0, 0.3))))
        else:
            sliders.append((at, float(10.0 ** rng.uniform(-0.5, 0.5)), float(0.5 * 10.0 ** rng.uniform(-1.0, 0.5))))
    beta = float(2.0 * zeta * np.sqrt(mass.mean() / k.mean()))
    force, at = float(10.0 ** rng.uniform(-1.5, -0.3)), int(rng.integers(0, 3))
    return Drawn(mass.tolist(), k.tolist(), beta, gaps, sliders, force, at)


def study_of(d):
    """Return the study and the frequencies (Hz) of its linear modes."""
    k0, k1, k2 = d.stiffness
    K = np.array([[k0 + k1, -k1, 0.0], [-k1, k1 + k2, -k2], [0.0, -k2, k2]])
    contacts = [bd.Contact(normal=at, kn=kn, gap=gap) for at, kn, gap in d.gaps]
    contacts += [bd.Contact(at, kt=kt, mu=0.5, preload=2.0 * limit) for at, kt, limit in d.sliders]
    study = bd.lumped(d.mass, d.beta * K, K, contacts=contacts, forces={d.at: d.force}, harmonics=7)
    return study, np.sqrt(scipy.linalg.eigh(K, np.diag(d.mass), eigvals_only=True)) / tau


def swept(d, start, end, periods, held, steps=500):
    """Amplitudes of a sweep from rest between two frequencies (Hz), held at the last, by the semi-implicit Euler method."""
    (k0, k1, k2), x, v, w, out = d.stiffness, [0.0] * 3, [0.0] * 3, [0.0] * len(d.sliders), []
    turn = [(cos(tau * j / steps), sin(tau * j / steps)) for j in range(steps + 1)]
    for period in range(periods + held):
        dt = 1.0 / (steps * (start + (end - start) * min(period / periods, 1.0)))
        c = s = 0.0
        for j in range(steps):
            e0, e1, e2 = (a + d.beta * b for a, b in zip(x, v))
            g = [-k0 * e0 - k1 * (e0 - e1), k1 * (e0 - e1) - k2 * (e1 - e2), k2 * (e1 - e2)]
            g[d.at] += d.force * turn[j][0]
            for at, kn, gap in d.gaps:
                g[at] -= kn * max(x[at] - gap, 0.0)
            for i, (at, kt, limit) in enumerate(d.sliders):
                traction = min(max(kt * (x[at] - w[i]), -limit), limit)
                w[i] = x[at] - traction / kt
                g[at] -= traction
            for i, m in enumerate(d.mass):
                v[i] += dt * g[i] / m
                x[i] += dt * v[i]
            c, s = c + x[d.at] * turn[j + 1][0], s + x[d.at] * turn[j + 1][1]
        out.append(2.0 * hypot(c, s) / steps)
    return np.array(out)


@pytest.mark.parametrize(("seed", "before"), [(112, 0.81), (155, 0.27)])
def test_a_motion_that_falls_on_the_way_to_a_tip_that_stays(seed, before, monkeypatch):
    """Compare with a slow sweep to the tip; along the curve the march has less than ``before`` times its amplitude."""
    d = random(seed)
    study, modes = study_of(d)
    curve = study.frequency_response(0.0, (0.5 * modes[0], min(1.4 * modes[0], 0.5 * modes[:2].sum())))
    found = study.time_response(curve)
    sweep = swept(d, 0.8 * found.frequency, found.frequency, 500, 300)[-50:]
    assert np.ptp(sweep) < 0.01 * sweep.mean() and found.mean == pytest.approx(sweep.mean(), rel=0.02)
    assert found.mean == pytest.approx(curve.peak.amplitude, rel=0.02)
    monkeypatch.setattr(TipSearch, "from_tip", lambda *_: None)
    along = study.time_response(curve)
    assert along.mean < before * found.mean and along.fall < found.frequency, "below the tip, to which the frequency rises"
    said = r"complete: started at the peak of the balance; along the curve the motion comes to .* m"
    assert re.fullmatch(said, found.status)


class _Tip:
    """A walk toward a tip of 2 m at 100 Hz, and motions from there that have given amplitudes."""

    def __init__(self, monkeypatch, first, after, stays=True, places=(1.0,)):
        levels = SimpleNamespace(frequency=np.array([90.0, 100.0]), amplitude=np.array([0.5, 2.0]), top=1)
        self.search, self.asked = TipSearch(None, levels, 64), []
        self.search.places = [SteadyPoint(99.0, np.array([mean]), True, None) for mean in places]
        self.search.fall, self.search.failure = 99.5, "" if places else "falls"
        march = SimpleNamespace(memory=1.0, run=lambda n: march.harmonics.extend(n * [0]), harmonics=[],
                                amplitude=np.array([2.0, *[first] * 9]), motion="later")  # fmt: skip
        monkeypatch.setattr(room, "March", lambda *given: march)
        monkeypatch.setattr(self.search, "solution", lambda f: "tip")
        monkeypatch.setattr(self.search, "integrate_at", lambda f, motion, own, limit: (
            self.asked.append((f, motion, own, limit)) or SteadyPoint(f, np.array([after]), stays, None)))  # fmt: skip
        monkeypatch.setattr(self.search, "follow_branch", lambda here, step: self.search.places.append(here))
        monkeypatch.setattr(self.search, "refine", lambda: None)
        self.search.from_tip(0.25)

    @property
    def means(self):
        return [p.mean for p in self.search.places]


def test_a_higher_motion_from_the_tip_is_a_place_and_its_fall_is_not_that_of_the_walk(monkeypatch):
    tip = _Tip(monkeypatch, 1.8, 1.7)
    assert tip.means == [1.0, 1.7] and tip.asked == [(100.0, "later", 2.0, pytest.approx(1.03))]
    assert tip.search.below == 1.0 and np.isnan(tip.search.fall)


def test_a_walk_that_falls_at_once_has_the_motion_from_the_tip(monkeypatch):
    tip = _Tip(monkeypatch, 1.8, 1.7, places=())
    assert tip.means == [1.7] and not tip.search.failure and tip.search.below == 0.0


@pytest.mark.parametrize(("first", "stays", "visits", "periods"), [(1.02, True, 0, 20), (1.8, False, 1, 20)])
def test_a_motion_that_falls_from_the_tip_changes_nothing(monkeypatch, first, stays, visits, periods):
    """Twenty periods that are no higher than the walk end it, as its fall in a visit does."""
    tip = _Tip(monkeypatch, first, 1.7, stays)
    assert tip.means == [1.0] and len(tip.asked) == visits and tip.search.periods == periods
    assert tip.search.fall == 99.5 and np.isnan(tip.search.below)


def test_nothing_is_started_where_the_walk_is_as_high_as_the_tip(monkeypatch):
    tip = _Tip(monkeypatch, 1.99, 1.99, places=(1.0, 1.91))
    assert tip.search.periods == 0 and not tip.asked and tip.means == [1.0, 1.91]


@pytest.mark.parametrize(("mean", "below", "said"), [
    (1.7, 1.0, "complete: started at the peak of the balance; along the curve the motion comes to 1 m"),
    (1.7, 0.0, "complete: started at the peak of the balance; along the curve the motion falls"),
    (1.0, 1.0, "complete"), (1.0, np.nan, "complete"),
])  # fmt: skip
def test_the_status_says_if_the_answer_started_at_the_tip(mean, below, said, monkeypatch):
    """Not if shorter steps have left the places along the curve alone."""
    study, modes = study_of(random(112))
    curve = study.frequency_response(0.0, (0.5 * modes[0], 1.4 * modes[0]))
    monkeypatch.setattr(TipSearch, "approach", lambda search, *_: setattr(search, "below", below))
    for name in ("from_tip", "verify"):
        monkeypatch.setattr(TipSearch, name, lambda *_: None)
    monkeypatch.setattr(TipSearch, "highest", lambda _: SteadyPoint(11.0, np.full(80, mean), True, None))
    monkeypatch.setattr(TipSearch, "open_question", lambda *_: "")
    assert study.time_response(curve).status == said
