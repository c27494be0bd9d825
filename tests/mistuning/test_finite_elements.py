"""Mistuned wheels with friction whose local basis is made from finite elements."""

import numpy as np
import pytest

pytest.importorskip("skfem", reason="scikit-fem is not installed (extra bdamper[fe])")

import bdamper as bd
from bdamper import fem
from bdamper.fem import LocalSizes
from bdamper.mistuning import DamperVariation, Mistuning
from bdamper.mistuning.bladed_disk import BladedDisk
from bdamper.response.events import ContinuationOptions
from bdamper.util.progress import CostMeter
from tests.annulus import small_sector, small_wheel
from tests.following import find_start
from tests.mistuning.lumped import solution
from tests.mistuning.lumped import wave as wave_of
from tests.mistuning.test_symmetry import assert_same, turned

PRELOAD, ZETA = 100.0, 2e-3


def wheel_of_five(engine_order=1):
    """A wheel whose blades differ by 2 % and whose dampers slip and lift."""
    study = bd.Study(
        small_wheel(small_sector(5, disk=0.3)), bd.Excitation("tip", amplitude=3.0, phase=0.4), engine_order,
        friction_coefficient=0.3, harmonics=1, blade_modes=20, contact_stiffness=3e7, damping_ratio=ZETA,
    )  # fmt: skip
    return BladedDisk(study, Mistuning(0.02 * np.random.default_rng(2).normal(size=5)))


def slip_and_separation(wheel, system, X):
    """Share of the cycle in slip, and of friction points that open and close."""
    shares = system.contact(system.structure.flat(X))[2].reshape(len(X), -1, 5)[
        :, wheel.structure.tuned.friction > 0.0
    ]
    return 0.5 * shares[..., [1, 3]].sum(axis=-1).mean(), (
        (shares[..., 4] > 0.02) & (shares[..., 4] < 0.98)
    ).mean()


def solved(wheel, frequency):
    """A solution from the wave of the tuned wheel, and the equations."""
    system = wheel.system(PRELOAD)
    omega = 2.0 * np.pi * frequency
    y, _ = find_start(
        wheel.structure.tuned, PRELOAD, omega, ContinuationOptions(tolerance=1e-10), CostMeter()
    )
    found = solution(system, omega, system.structure.flat(wave_of(wheel.structure, y[:-1])))
    assert found.status == 0
    X = system.structure.array(found.y[:-1])
    assert min(slip_and_separation(wheel, system, X)) > 0.1
    return X, system


@pytest.mark.nightly
@pytest.mark.slow
def test_directions_of_a_wheel_of_finite_elements():
    """A pattern turned by a blade turns the answer; blades that are twisted have no mirror plane."""
    frequency = 330.0
    forward = wheel_of_five()
    pattern, backward = forward.mistuning, wheel_of_five(engine_order=4)
    found, system = solved(forward, frequency)
    other, _ = solved(forward.replace(mistuning=np.roll(pattern.deviation, 1, axis=0)), frequency)
    assert_same(other, turned(found), 1e-7)
    height = np.abs(system.structure.responses(system.structure.flat(found))[:, 1])
    for mistuning, places in (
        (pattern.deviation[-np.arange(5)], -np.arange(5)),
        (pattern, np.arange(5)),
    ):
        back, system = solved(backward.replace(mistuning=mistuning), frequency)
        ratio = (
            np.abs(system.structure.responses(system.structure.flat(back))[:, 1])[places] / height
        )
        assert np.abs(ratio - 1.0).max() > 1e-3


@pytest.mark.nightly
@pytest.mark.slow
def test_a_disk_of_six_blades_whose_dampers_differ():
    """What is built passes the checks of a model, and the state of its dampers is proportional to the load."""
    model = fem.bladed_disk(
        points=4, engine_order=2, fe=fem.SectorFE(fem.Geometry(n_blades=6)), wheel=LocalSizes()
    )
    study = bd.Study(model, bd.Excitation("tip"), 2, friction_coefficient=0.4, harmonics=1)
    dampers = DamperVariation.random(6, mass=0.05, friction_coefficient=0.1, missing=[3], seed=1)
    wheel = BladedDisk(study, dampers=dampers)
    one, ten = wheel.state(1000.0), wheel.state(1e4)
    np.testing.assert_allclose(ten.force, 10.0 * one.force, atol=1e-7 * np.abs(ten.force).max())
    assert one.force[[2, 4]].any(axis=(1, 2)).all() and not one.force[3].any()
