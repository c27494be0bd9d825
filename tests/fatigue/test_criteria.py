"""Amplitude and mean of stress cycles against closed forms, and what they must not depend on."""

from __future__ import annotations

import numpy as np
import pytest

from bdamper.fatigue import AISI_1050, Material
from bdamper.fatigue.criteria import (
    _parabola,
    amplitude_and_mean,
    angles,
    findley,
    largest_von_mises,
    smallest_circle,
    von_mises,
)
from bdamper.util.errors import SettingError

STEEL = Material(300e6, 900e6, 800e6)


def cycle(mean, *harmonics):
    """One cycle (1, 6, H + 1) from the components of its mean and of its harmonics."""
    return np.stack([np.asarray(part, complex) for part in (mean, *harmonics)], axis=1)[None]


def random_cycles(n, n_harmonics):
    rng = np.random.default_rng(3)
    c = rng.standard_normal((n, 6, n_harmonics + 1)) + 1j * rng.standard_normal(
        (n, 6, n_harmonics + 1)
    )
    c[..., 0] = c[..., 0].real
    return c / (1.0 + np.arange(n_harmonics + 1)) ** 2


def turned(c, rotation):
    index = np.array([[0, 3, 5], [3, 1, 4], [5, 4, 2]])
    tensor = np.einsum("ia,nabl,jb->nijl", rotation, c[:, index], rotation)
    return tensor[:, [0, 1, 2, 0, 1, 0], [0, 1, 2, 1, 2, 2]]


def test_von_mises_of_one_harmonic_is_its_closed_form():
    c = random_cycles(40, 1)
    form = np.zeros((6, 6))
    form[:3, :3] = 1.5 * np.eye(3) - 0.5
    form[3:, 3:] = 3.0 * np.eye(3)
    z = c[..., 1]
    hermitian = np.einsum("ni,ij,nj->n", z.conj(), form, z).real
    expected = np.sqrt(0.5 * (hermitian + np.abs(np.einsum("ni,ij,nj->n", z, form, z))))
    np.testing.assert_allclose(amplitude_and_mean(c).amplitude, expected, rtol=1e-8)


def test_findley_of_uniaxial_stress_is_its_closed_form():
    k, mean, amplitude = 0.3, 100.0, 80.0
    value = findley(cycle([mean, 0, 0, 0, 0, 0], [amplitude * np.exp(0.3j), 0, 0, 0, 0, 0]), k)
    top = mean + amplitude
    assert value[0] == pytest.approx(0.5 * (k * top + np.hypot(amplitude, k * top)), rel=1e-5)


@pytest.mark.slow
def test_findley_on_the_amplitude_alone_finds_the_factor_at_which_the_whole_criterion_is_met():
    c, k, limit = random_cycles(2, 2), 0.3, 2.0
    factor = 1.0 / findley(c, k, limit)
    grown = c.copy()
    grown[..., 1:] *= factor[:, None, None]
    np.testing.assert_allclose(findley(grown, k), limit, rtol=2e-5)


@pytest.mark.slow
def test_amplitudes_do_not_depend_on_axes():
    c = random_cycles(20, 3)
    rotation = np.linalg.qr(np.random.default_rng(4).standard_normal((3, 3)))[0]
    rotation *= np.linalg.det(rotation)
    for a, b in zip(amplitude_and_mean(c), amplitude_and_mean(turned(c, rotation))):
        np.testing.assert_allclose(a, b, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(
        findley(c[:2], 0.3), findley(turned(c[:2], rotation), 0.3), rtol=1e-4
    )


def test_amplitudes_do_not_depend_on_when_the_cycle_starts():
    c = random_cycles(20, 3)
    later = c * np.exp(0.123j * np.arange(4))
    for a, b in zip(amplitude_and_mean(c), amplitude_and_mean(later)):
        np.testing.assert_allclose(a, b, rtol=1e-10, atol=1e-10)
    np.testing.assert_allclose(largest_von_mises(c), largest_von_mises(later), rtol=1e-10)


def test_von_mises_amplitude_is_no_less_than_of_any_two_instants():
    c = random_cycles(5, 3)
    theta = np.linspace(0.0, 2.0 * np.pi, 240, endpoint=False) + 0.01
    path = np.einsum("nil,lt->nit", c, np.exp(1j * np.arange(4)[:, None] * theta)).real.transpose(
        0, 2, 1
    )
    pairs = 0.5 * von_mises(path[:, :, None] - path[:, None]).reshape(5, -1).max(axis=1)
    amplitude = amplitude_and_mean(c).amplitude
    assert (amplitude >= pairs).all() and (amplitude < 1.001 * pairs).all()
    assert len(angles(3)) == 128 and len(angles(8)) == 256


def test_a_maximum_between_samples_is_that_of_their_parabola():
    """Exact for 5 - (t - top)^2 at the three samples around the maximum, also over the end of the period."""
    t = np.arange(-3.0, 4.0)
    samples = [5.0 - (t - top) ** 2 for top in (0.3, -0.4)]
    values = np.array([*samples, np.roll(samples[0], 3), np.roll(samples[1], -3), np.full(7, 2.0)])
    assert values[2:4].argmax(axis=1).tolist() == [6, 0]
    np.testing.assert_allclose(_parabola(values), [5.0, 5.0, 5.0, 5.0, 2.0], rtol=1e-12)


def test_smallest_circle_of_an_obtuse_and_an_acute_triangle_and_an_ellipse():
    obtuse = np.array([[0.0, 0.0], [4.0, 0.0], [2.0, 0.5]])
    acute = np.array([[0.0, 0.0], [4.0, 0.0], [2.0, 3.0]])
    theta = np.linspace(0.0, 2.0 * np.pi, 64, endpoint=False)
    np.testing.assert_allclose(
        smallest_circle(np.stack([obtuse, acute])), [2.0, 13.0 / 6.0], rtol=1e-12
    )
    ellipse = np.stack([3.0 * np.cos(theta), np.sin(theta + 0.2)], axis=-1)[None]
    long = np.linalg.svd([[3.0, 0.0], [np.sin(0.2), np.cos(0.2)]])[1][0]
    np.testing.assert_allclose(smallest_circle(ellipse), long, rtol=2e-3)


@pytest.mark.parametrize(
    ("line", "both", "alone"),
    [("goodman", 1.6667, 2.5), ("soderberg", 1.5584, 2.3438), ("gerber", 2.0311, 3.3333)],
)
def test_factors_are_those_of_the_closed_forms(line, both, alone):
    assert STEEL.factor(80e6, 300e6, line, "both") == pytest.approx(both, abs=5e-5)
    assert STEEL.factor(80e6, 300e6, line) == pytest.approx(alone, abs=5e-5)
    assert STEEL.factor(80e6, -300e6, line) == pytest.approx(3.75)  # compression does not help
    assert STEEL.factor(80e6, -300e6, line, "both") == pytest.approx(3.75)
    assert STEEL.factor(80e6, 950e6, line) == 0.0 and STEEL.factor(0.0, 100e6, line) == np.inf


def test_the_factor_of_gerber_leads_onto_its_parabola():
    n = STEEL.factor(80e6, 300e6, "gerber", "both")
    assert n * 80 / 300 + (n * 300 / 900) ** 2 == pytest.approx(1.0, rel=1e-12)


def test_the_limit_of_findley_is_that_of_the_endurance_limit():
    amplitude = STEEL.endurance_limit
    value = findley(cycle([0] * 6, [amplitude, 0, 0, 0, 0, 0]), STEEL.findley_k)
    assert value[0] == pytest.approx(STEEL.findley_limit, rel=1e-5)


def test_a_material_is_refused_where_it_cannot_be():
    with pytest.raises(
        SettingError, match="yield_strength: expected at most the ultimate strength"
    ):
        Material(100e6, 300e6, 400e6)
    with pytest.raises(SettingError, match="endurance_limit"):
        Material(0.0, 300e6, 200e6)
    with pytest.raises(SettingError, match="line"):
        STEEL.factor(1.0, 1.0, "straight")
    share = 4.51 * 690.0**-0.265 * 0.814  # share in the documented example
    assert AISI_1050.endurance_limit == pytest.approx(0.5 * 690e6 * share, rel=1e-3)
