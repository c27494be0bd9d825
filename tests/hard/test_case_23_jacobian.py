"""Row 23: Jacobians against finite differences on random states of all laws; BDAMPER_HARD=10000 runs the full number.

Every point goes through a sequence of states (stick, slip, open) in its cycle.  Where that sequence is the same on both
sides of a state, central differences must give the Jacobian.  Where it changes there is an event; it is searched for by
bisection along the disturbance, and the Jacobian beyond it must give the difference to the state at the event
(semismoothness), better and better as the two draw together.
"""

from dataclasses import replace

import numpy as np
import pytest

from bdamper.contact.laws import (
    AFT,
    LAW_BONDED,
    LAW_CONSTANT,
    LAW_COUPLED,
    LAW_COUPLED_CONSTANT,
    LAW_NORMAL,
    LAW_SEPARABLE,
    PointArrays,
)
from bdamper.harmonic_balance.sector import segments
from tests import oracle
from tests.hard.random_studies import number_of_cases, random_study

BATCH = 50
QUICK = 25
"""Cases of the quick tests, half of the first batch."""
BATCHES = [
    (0, QUICK),
    (QUICK, BATCH),
    *((first, first + BATCH) for first in range(BATCH, number_of_cases(), BATCH)),
]
N_TIME = 64
LAWS = {
    "uncoupled": (LAW_SEPARABLE,),
    "normal": (LAW_NORMAL,),
    "constant": (LAW_CONSTANT,),
    "coupled": (LAW_COUPLED,),
    "coupled constant": (LAW_COUPLED_CONSTANT,),
    "bonded": (LAW_BONDED,),
    "mixed, exact": (LAW_SEPARABLE, LAW_NORMAL, LAW_CONSTANT, LAW_BONDED),
    "mixed, sampled": (
        LAW_SEPARABLE,
        LAW_NORMAL,
        LAW_CONSTANT,
        LAW_COUPLED,
        LAW_COUPLED_CONSTANT,
        LAW_BONDED,
    ),
}
"""The separable law, which most use, comes up as often as the others together."""
TURN = ("uncoupled", *list(LAWS)[1:], *["uncoupled"] * 6)


class State:
    """A random system near one of its solutions, a disturbance, and the events along it."""

    def __init__(self, seed):
        study, preload, interval = random_study(seed)
        rng = self.rng = np.random.default_rng(seed)
        plain = study.problem.system(preload)
        self.omega = 2 * np.pi * rng.uniform(*interval)
        case = study.problem.at(preload)
        u = plain.layout.pack(
            case.static.q, plain.structure.linear.response(self.omega, case.stuck_springs())
        )
        u = u + np.abs(u).max() * 10.0 ** rng.uniform(-3.0, -0.5) * rng.standard_normal(
            len(u)
        ) / np.sqrt(len(u))
        self.u = u
        self.name = TURN[seed % len(TURN)]
        given = plain.structure.points
        law = np.where(given.mu > 0.0, rng.choice(LAWS[self.name], plain.n_points), LAW_NORMAL)
        motion = plain.contact(u)[0]
        self.size = np.abs(motion[..., 1:]).max()
        load = rng.uniform(0.2, 3.0, plain.n_points) * given.kt.max(axis=1) * self.size
        coupled = np.isin(law, (LAW_COUPLED, LAW_COUPLED_CONSTANT)).any()
        self.coupled = bool(coupled)
        sampled = bool(coupled or (self.name == "uncoupled" and rng.random() < 0.2))
        self.contact_forces = AFT(N_TIME) if sampled else "event_driven"
        self.points = PointArrays(
            given.kt,
            given.kn,
            given.mu,
            given.n0,
            given.slider,
            law.astype(np.intc),
            given.shift,
            load,
        )
        self.system = replace(
            plain.structure, points=self.points, contact_forces=self.contact_forces
        ).equations
        # one unit along this direction moves the surfaces by the vibration
        direction = rng.standard_normal(len(u))
        moved = plain.contact(direction)[0] - plain.contact(0.0 * direction)[0]
        self.direction = direction * self.size / np.abs(moved).max()

    def at(self, h):
        return self.u + h * self.direction

    def sequence(self, h, which=None):
        """States through the cycle of every point (or some), a distance along the disturbance; samples, if there are."""
        X, _, _ = self.system.contact(self.at(h))
        p, out = self.points, []
        theta = 2 * np.pi * np.arange(N_TIME) / N_TIME
        for i in range(len(X)) if which is None else which:
            x, law = X[i], int(p.law[i])
            parts = segments(
                x, p.kt[i], float(p.kn[i]), float(p.mu[i]), float(p.n0[i]), p.slider[i], law, self.contact_forces,
                float(p.load[i]),
            )  # fmt: skip
            if isinstance(self.contact_forces, AFT):
                cycle = [
                    [(int(np.ceil(a * N_TIME / (2 * np.pi) - 1e-9)), s) for a, _, s in part]
                    for part in parts
                ]
                l = np.arange(1, x.shape[1] // 2 + 1)[:, None] * theta
                v = x[2, 0] + x[2, 1::2] @ np.cos(l) + x[2, 2::2] @ np.sin(l)
                lift = tuple(p.n0[i] + p.kn[i] * v > 0.0)
            else:
                cycle = [_turned([s for *_, s in part]) for part in parts]
                lift = _contact_changes(x[2], float(p.kn[i]), float(p.n0[i]))
            out.append((cycle, lift if law in (LAW_SEPARABLE, LAW_NORMAL, LAW_COUPLED) else 0))
        return out

    def evaluate(self, h):
        return self.system.evaluate(self.at(h), self.omega)


def _contact_changes(v, kn, n0):
    """How often n0 + kn v changes its sign in the cycle."""
    h = len(v) // 2
    z = np.zeros(2 * h + 1, complex)
    z[h] = n0 + kn * v[0]
    z[h + 1 :] = 0.5 * kn * (v[1::2] - 1j * v[2::2])
    z[:h] = z[:h:-1].conj()
    roots = np.roots(np.trim_zeros(z[::-1], "f"))
    return int((np.abs(np.abs(roots) - 1.0) < 1e-7).sum())


def _turned(states):
    """A cyclic sequence from its smallest turn on, repetitions left out."""
    states = [s for i, s in enumerate(states) if s != states[i - 1] or len(states) == 1] or states[
        :1
    ]
    return min((states[i:] + states[:i] for i in range(len(states))), default=[])


def event_within(state, reach=0.1):
    """The nearest event found within reach, as distances just before and just beyond it; none if there is none."""
    before, here = 0.0, state.sequence(0.0)
    for beyond in np.geomspace(1e-4, reach, 7):
        which = [i for i, (a, b) in enumerate(zip(state.sequence(beyond), here)) if a != b]
        if which:
            break
        before = beyond
    else:
        return None
    here = [here[i] for i in which]
    for _ in range(60):
        middle = 0.5 * (before + beyond)
        if middle in (before, beyond):
            break
        if state.sequence(middle, which) == here:
            before = middle
        else:
            beyond = middle
    return before, beyond


def error_beyond(state, event, h):
    """Of the Jacobian at a distance h beyond (before, if negative) an event, relative to its own effect."""
    r0, _, _ = state.evaluate(event)
    r, J, _ = state.evaluate(event + h)
    effect = h * (J @ state.direction)
    return np.abs(r - r0 - effect).max() / np.abs(effect).max()


def coupled_load_vanishes(state, event):
    """Whether the normal load of a point with a coupled law vanishes at a sample.

    While the limit R of friction vanishes over a step in which the slider moves by D, the angle of the force to the motion
    turns by a factor R^(D/dR).  The Jacobian approaches its limit with that power of R (less one where it grows again from
    zero), which may be any positive one, so that no decrease can be asked for within a few decades.
    """
    X, _, _ = state.system.contact(state.at(event))
    theta = 2 * np.pi * np.arange(N_TIME) / N_TIME
    for i in np.flatnonzero(state.points.law == LAW_COUPLED):
        load = state.points.n0[i] + state.points.kn[i] * (
            oracle.basis(theta, X.shape[2] // 2) @ X[i, 2]
        )
        if np.abs(load).min() < 1e-10 * np.abs(load).max():
            return True
    return False


def check_event(state, seed):
    """Whether there is an event nearby; the Jacobian on both sides of it."""
    found = event_within(state)
    if found is None:
        return False
    for h, event in ((1e-4, found[1]), (-1e-4, found[0])):
        errors = [error_beyond(state, event, h * 10.0**-k) for k in range(4)]
        assert errors[3] < 1e-3, (seed, state.name, errors)
        _, J, _ = state.evaluate(event)
        rounding = (
            4e-14 * np.abs(J @ state.at(event)).max() / np.abs(J @ state.direction).max() / abs(h)
        )
        if not coupled_load_vanishes(state, event):
            assert errors[3] < 0.1 * errors[0] + max(1e-5, 1e3 * rounding), (
                seed,
                state.name,
                errors,
            )
    return True


@pytest.mark.slow
@pytest.mark.parametrize(
    ("first", "end"),
    [pytest.param(*ends, marks=[pytest.mark.slow] if ends[0] >= QUICK else []) for ends in BATCHES],
)
def test_case_23_jacobian_of_the_system(first, end):
    away = events = 0
    for seed in range(first, end):
        state = State(seed)
        r, J, r_omega = state.evaluate(0.0)
        assert np.isfinite(J).all(), seed
        assert np.abs(J).max() > 0.0
        h = 1e-6
        effect = np.abs(J @ state.direction).max()
        if state.sequence(-h) == state.sequence(0.0) == state.sequence(h):
            away += 1
            quotient = (state.evaluate(h)[0] - state.evaluate(-h)[0]) / (2 * h)
            error = np.abs(quotient - J @ state.direction).max() / effect
            assert error < 1e-5, (seed, state.name, error)
        events += check_event(state, seed)
        d = 1e-6 * state.omega
        u = state.u
        quotient = (
            state.system.evaluate(u, state.omega + d)[0]
            - state.system.evaluate(u, state.omega - d)[0]
        ) / (2 * d)
        size = max(np.abs(r_omega).max(), np.abs(r).max() / state.omega)
        assert np.abs(quotient - r_omega).max() <= 1e-6 * size, seed
    assert away >= 0.9 * (end - first)
    assert events >= 0.2 * (end - first)
