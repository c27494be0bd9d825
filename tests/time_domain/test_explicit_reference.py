"""Time integration beside an explicit one in plain NumPy, whose steps follow the stiffest contact, on six scenes.

``plain_transient.integrate`` takes central differences and applies the law point by point; it shares neither step nor
solver with the core.  Both start from the same motion and are compared by the mean amplitudes of all blades over the last
periods. Where blades vibrate differently that is the motion to which the core has come.  The first scene chatters: with
10,400 explicit steps, or 16,384 of the core, it leaves its motion after six to ten periods and with 4,096 of the core it
does not, so only the first four periods are compared there.
"""

import numpy as np
import pytest

import bdamper as bd
from bdamper.time_domain.integration import Motion, all_sectors
from bdamper.time_domain.steady_amplitude import BalanceCurve
from bdamper.time_domain.transient import CRITERIA, Transient
from tests.time_domain import plain_transient
from tests.time_domain.test_frequency_sweep import W0, one_mass

SCENES = {
    "blade, blades part": ("turbine_blade", 10, 0.496, 38.5, 671.0, 6, 4),
    "blade, above its optimum": ("turbine_blade", 5, 0.54, 43.7, 661.0, 12, 15),
    "blade, optimum": ("turbine_blade", 5, 0.3, 103.6, 660.8, 12, 15),
    "disk, near the fall": ("bladed_disk", 5, 0.4, 125.0, 315.0, 13, 15),
}
"""Model, engine order, friction coefficient, preload (N), frequency (Hz), blades, periods."""
STEPS = 2600
"""Of the explicit integration."""


def highest_frequency(ring):
    """rad/s, with every contact closed and stuck, coordinates without mass aside."""
    a, highest = ring.system.structure.arrays, 0.0
    springs = np.column_stack([a["kt"], a["kn"]])
    for l, s, *_ in ring.blocks:
        heavy = ring.mass[s] > 0.0
        G = np.asarray(ring.wide.structure.bases[l].G).reshape(springs.size, -1)[:, heavy]
        stiffness = np.diag(ring.stiffness[s][heavy]) + (G.conj().T * springs.ravel()) @ G
        highest = max(
            highest,
            np.abs(np.linalg.eigvals(stiffness / ring.mass[s][heavy, None])).max(initial=0.0),
        )
    return np.sqrt(highest)


def explicit(ring, start, omega, periods, steps):
    """(periods, n_blades) complex harmonic of the excitation; stable with all contacts stuck."""
    assert steps > np.pi * highest_frequency(ring) / omega
    turn, out, motion = 2.0 / steps * np.exp(-2j * np.pi * np.arange(steps) / steps), [], start
    for _ in range(periods):
        motion, trace = plain_transient.integrate(ring, motion[:3], omega, steps, steps)
        out.append(turn @ trace @ ring.rows.T)
    return np.array(out)


def both(ring, u, frequency, before, periods, window, steps=STEPS, own_steps=512):
    """Means (n_blades,) of all amplitudes over the last periods by both, after so many periods of the core."""
    omega = 2.0 * np.pi * frequency
    settling = Transient(ring, omega, ring.seeded(ring.start(u, omega, 256), CRITERIA.seed, 0), 256)
    settling.run(before)
    start = Motion(*settling.motion[:3])
    transient = Transient(ring, omega, start, own_steps)
    transient.run(periods)
    found = explicit(ring, start, omega, periods, steps)
    return (np.abs(x[-window:]).mean(axis=0) for x in (transient.blades, found))


def study_of(model, order, friction, **given):
    excitation = (
        bd.Excitation("tip", "tangential", 1.0)
        if model == "turbine_blade"
        else bd.Excitation("tip")
    )
    given = {"contact_stiffness": "unit_traction", **given}
    return bd.Study(
        bd.reference_model(model, 9), excitation, order, friction_coefficient=friction, **given
    )


@pytest.mark.slow
def test_one_mass_that_opens_its_contact():
    """Beside the fold, where the branch bends to lower frequencies: from the balance to the motion in time."""
    study = one_mass(normal=0, kn=0.5 * W0**2, preload=5.0).replace(harmonics=5)
    balance = BalanceCurve(study.frequency_response(0.0, (9.0, 14.0)))
    frequency = balance.tip + 0.3
    found, expected = both(
        all_sectors(study.problem, 0.0), balance.solution(frequency), frequency, 0, 20, 10, 500
    )
    assert expected == pytest.approx(found, rel=5e-3) and found[0] > 0.9 * balance.at(frequency)[0]


@pytest.mark.slow
def test_six_blades_with_disturbances():
    """Of the turbine blade with two modes, just after disturbances of every nodal diameter: each blade has its own way."""
    study = study_of("turbine_blade", 10, 0.496, blade_modes=2)
    balance = BalanceCurve(study.frequency_response(38.5, (640.0, 690.0)))
    frequency = balance.tip
    found, expected = both(
        all_sectors(study.problem, 38.5),
        balance.solution(frequency),
        frequency,
        0,
        4,
        2,
        own_steps=1024,
    )
    assert expected == pytest.approx(found, rel=5e-3) and np.ptp(found) > 0.02 * found.mean()


@pytest.mark.nightly
@pytest.mark.slow
@pytest.mark.parametrize("name", SCENES)
def test_all_blades_of_real_scenes(name):
    model, order, friction, preload, frequency, blades, periods = SCENES[name]
    study = study_of(model, order, friction)
    interval = (600.0, 720.0) if model == "turbine_blade" else (285.0, 380.0)
    balance = BalanceCurve(study.frequency_response(preload, interval))
    ring = all_sectors(study.problem, preload)
    assert ring.n == blades
    found, expected = both(
        ring, balance.solution(frequency), frequency, 240, periods, min(periods, 5)
    )
    assert expected.max() == pytest.approx(found.max(), rel=0.03)
    if np.ptp(found) > 0.2 * found.mean():
        assert np.corrcoef(found, expected)[0, 1] > 0.9, "other blades are high"
