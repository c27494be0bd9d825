"""Slow oscillating growth on the reference model, followed in time on all 13 sectors that differ."""

import numpy as np
import pytest

import bdamper as bd
from bdamper.time_domain.integration import Motion, Ring
from bdamper.time_domain.wave_exponents import WaveDisturbances
from tests.hard.test_wave_stability import nearest_root
from tests.plain import plain_study

DRAG = 4.0 * 2.0 * np.pi * 350.0
"""1/s, so that the damper does not chatter on its contacts at 40 times the frequency."""


@pytest.fixture(scope="module")
def reference():
    """With one harmonic all motion is in nodal diameters 0 and 5, in harmonic balance and in time."""
    study = plain_study(
        bd.reference_model("bladed_disk", 9), engine_order=5, friction_coefficient=0.4, damping_ratio=0.001,
        excitation=bd.Excitation("tip", "tangential", 1.0),
    )  # fmt: skip
    study = study.replace(damper_drag=DRAG * study.model.bodies["damper"].mass)
    curve = study.frequency_response(1000.0, (346.0, 356.0))
    assert curve.complete
    return study, curve


@pytest.mark.slow
@pytest.mark.parametrize(("frequency", "grows"), [(348.17, True), (350.73, False)])
def test_growth_and_decay_in_time_are_those_of_the_exponents(reference, frequency, grows):
    study, curve = reference
    system = study.problem.system(1000.0)
    upper = np.flatnonzero(np.abs(curve.harmonics[:, 1]) > 2.7e-4)
    i = upper[np.argmin(np.abs(curve.frequency[upper] - frequency))]
    u, omega = curve.unknowns[i], 2 * np.pi * curve.frequency[i]
    disturbed = WaveDisturbances(system, u, omega)
    assert disturbed.growing(1e-6 * omega, 2 * omega) == (2 if grows else 0)
    near = disturbed.estimates()
    roots = np.array([nearest_root(disturbed, root) for root in near[(near.imag > 0.5 * omega) & (near.imag < 2 * omega)]])
    critical = roots[(roots.imag > 0.5 * omega) & (roots.imag < 2 * omega)]
    critical = critical[np.argmax(critical.real)] / omega
    assert 3e-4 < abs(critical.real) < 1e-3 and (critical.real > 0) == grows
    assert 0.96 < critical.imag < 0.98  # a blade mode of nodal diameter 0, which the wave itself leaves at rest

    # with 1,040 steps a period the decay is 0.0011: too fast by 0.0004, whatever its damping and tolerance
    ring, steps, periods, window = Ring(system, 65, 5), 4160, 96, 32
    assert ring.n == 13
    w = ring.initial_slider(u, omega, steps)
    q, v = ring.state(u, omega, 0.0)
    place = next(s.start for l, s, *_ in ring.blocks if l == 0)  # the first mode of nodal diameter 0
    q[place] += 2e-7
    response = ring.integrate(Motion(q, v, w), omega, steps, periods, trace=True).trace[:, place]
    t = 2 * np.pi * np.arange(window * steps) / steps
    waves = np.column_stack([np.ones_like(t), np.cos(critical.imag * t), np.sin(critical.imag * t)])
    parts = response.reshape(-1, window * steps)
    fitted = np.linalg.lstsq(waves, parts.T, rcond=None)[0]
    sizes = np.hypot(fitted[1], fitted[2])
    rates = np.diff(np.log(sizes)) / (2 * np.pi * window)
    np.testing.assert_allclose(rates, critical.real, atol=2e-4)


@pytest.mark.parametrize("preload", [1000.0, 50.0])
def test_the_sign_of_the_determinant_alone_says_something_else(preload):
    study = plain_study(
        bd.reference_model("bladed_disk", 9), engine_order=5, friction_coefficient=0.4,
        excitation=bd.Excitation("tip", "tangential", 1.0),
    )  # fmt: skip
    curve = study.frequency_response(preload, (250.0, 400.0), stability=True)
    system, omega = study.problem.system(preload), 2.0 * np.pi * curve.frequency
    assert 0.1 < (~curve.stable).mean() < 0.9
    signs = [np.linalg.slogdet(system.evaluate(u, w)[1])[0] for u, w in zip(curve.unknowns, omega)]
    assert ((np.array(signs) > 0.0) != curve.stable).any()


def plain_count(d, rate, band):
    """Turn of the phase of det D around the region, from many places, without estimates of roots."""
    line = rate + 1j * np.linspace(0.0, band, 12_001)
    across = rate + 1j * band + np.append(0.0, np.geomspace(1e-4 * d.omega, 1e4 * d.omega, 3000))
    phase = np.angle(np.exp(1j * np.diff(d._determinant(np.concatenate([line, across[1:], [across[-1].real]])).imag)))
    assert np.abs(phase).max() < 2.0
    turn = phase.sum() / np.pi
    assert abs(turn - round(turn)) < 0.05
    return -round(turn)


@pytest.mark.slow
def test_counts_against_plain_turns_of_the_phase():
    study = plain_study(
        bd.reference_model("bladed_disk", 9), engine_order=5, friction_coefficient=0.4,
        excitation=bd.Excitation("tip", "tangential", 1.0),
    )  # fmt: skip
    system, seen = study.problem.system(50.0), set()
    curve = study.frequency_response(50.0, (250.0, 400.0))
    for i in range(8, len(curve) - 5, 12):
        omega = 2 * np.pi * curve.frequency[i]
        d = WaveDisturbances(system, curve.unknowns[i], omega)
        count = d.growing(1e-6 * omega, 2 * omega)
        assert count == plain_count(d, 1e-6 * omega, 2 * omega)
        seen.add(count)
    assert len(seen) > 2
