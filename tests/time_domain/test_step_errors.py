"""Time steps that are too long: energy that contacts supply, amplitudes that no passive contact allows."""

from math import tau

import numpy as np
import pytest
import scipy.linalg

import bdamper as bd
from bdamper.importers import (
    ContactFaces,
    Placement,
    Reduction,
    Sector,
    build_model,
    example_decks,
    read_calculix,
)
from bdamper.time_domain import time_response
from bdamper.time_domain.integration import AllSectors, EnergyGained, all_sectors
from bdamper.time_domain.time_response import disturbed
from bdamper.time_domain.transient import CRITERIA, energy_error, step_error
from tests.each import each
from tests.time_domain.test_frequency_sweep import W0, one_mass

# ---- an imported sector ----


PRELOAD = 100.0


@pytest.fixture(scope="module")
def imported(tmp_path_factory):
    """The example sector of CalculiX with all its modes."""
    folder = tmp_path_factory.mktemp("deck")
    example_decks("calculix", folder)
    contacts = [
        ContactFaces(a, a.upper(), f"{b}_UNDERSIDE")
        for a, b in (("left", "RIGHT"), ("right", "LEFT"))
    ]
    contacts += [
        ContactFaces(name.lower(), name, body_b="ground", kind="constraint", points=(2, 2), gap=0.2)
        for name in ("FRONT", "BACK")
    ]
    built = build_model(
        read_calculix(folder / "sector"), read_calculix(folder / "damper"), contacts=contacts,
        sector=Sector(36, ("LOW", "HIGH"), fixed="BORE"), placement=Placement("mm-t-s", axis=(1, 0, 0)),
        reduction=Reduction(engine_order=4), locations={"tip": [0.0, 346.6, 0.0]},
    )  # fmt: skip
    excitation = bd.Excitation("tip", "tangential", 1.0)
    return bd.Study(
        built.model,
        excitation,
        engine_order=4,
        friction_coefficient=0.3,
        harmonics=1,
        blade_modes=40,
        damper_modes=6,
    )


@pytest.mark.slow
@pytest.mark.parametrize("radius", [0.3, 0.7])
def test_the_contacts_of_an_imported_sector_supply_no_energy(imported, radius):
    """With 0.7 they supplied most of it while the iteration for their forces gave up in many steps."""
    curve = imported.frequency_response(PRELOAD, (1300.0, 1400.0))
    ring, omega = all_sectors(imported.problem, PRELOAD), tau * curve.peak.frequency
    ring.radius = radius
    found = disturbed(ring, curve.unknowns[curve.peak_index], omega)
    found.advance(10)
    found.advance(10)
    assert energy_error(found) < 0.005 and not step_error(found)


@pytest.mark.slow
def test_a_free_blade_bounds_the_amplitude_of_an_imported_sector(imported):
    free = imported.free((950.0, 1010.0))
    omega, highest = tau * free.frequency[free.amplitude.argmax()], free.amplitude.max()
    system = imported.replace(contact_stiffness="unit_traction").problem.system(PRELOAD)
    assert highest < AllSectors(system, 36, 4).amplitude_bound(omega) < 1.5 * highest


# ---- the balance of energy ----


def pressed(stop=3.0, steps=256):
    """A mass that meets a stop in every period."""
    study = bd.lumped(
        [1.0], [0.04], [1.0], contacts=[bd.Contact(normal=0, kn=stop)], forces={0: 1.0}, harmonics=3
    )
    curve = study.frequency_response(0.0, (0.2, 0.3))
    transient = disturbed(
        all_sectors(study.problem, 0.0), curve.unknowns[0], tau * curve.frequency[0], steps
    )
    transient.advance(40)
    return transient


@each(
    ("taken", "right"),
    [(0.0, 0.0), (0.03, 0.03 / 1.03), (0.5, 1.0 / 3.0), (-0.03, 0.03), (-0.5, 0.5)],
)
def test_what_contacts_supply_or_time_steps_take_is_an_error(taken, right):
    """Shares of the work, supplied by the contacts and taken by the steps, or taken by the steps alone."""
    transient = pressed()
    work = float(np.sum(transient.energy[-10:], axis=0)[0]) / 10.0
    for energy in transient.energy:
        energy[2] -= max(taken, 0.0) * work
        energy[1] += min(taken, 0.0) * work
    transient.stored = [(0, 0.0), (30, 0.0), (40, 0.0)]
    assert energy_error(transient) == pytest.approx(right, abs=1e-2)
    assert bool(step_error(transient)) == (right > CRITERIA.energy)


def test_contacts_return_what_they_have_stored():
    transient = pressed()
    work = float(np.sum(transient.energy[-10:], axis=0)[0])
    for energy in transient.energy:
        energy[2] -= 0.05 * work
        energy[3] += 0.05 * work
    (_, stored) = transient.stored[-1]
    transient.stored = [(30, stored + 0.5 * work), (40, stored)]
    assert energy_error(transient) < 5e-3
    transient.stored = [(30, stored), (40, stored)]
    assert energy_error(transient) > 0.2


def test_an_undamped_motion_far_from_its_resonance_has_no_error():
    """Its energy of a period is rounding."""
    study = bd.lumped(
        [1.0],
        [0.0],
        [1.0],
        contacts=[bd.Contact(0, kt=0.5, mu=10.0, preload=1.0)],
        forces={0: 1e-3},
    )
    curve = study.frequency_response(0.0, (0.05, 0.06))
    transient = disturbed(
        all_sectors(study.problem, 0.0), curve.unknowns[0], tau * curve.frequency[0]
    )
    transient.advance(40)
    assert energy_error(transient) < CRITERIA.energy


# ---- the bound of the amplitude ----


def test_the_bound_of_one_mass_is_its_resonance():
    study = bd.lumped([2.0], [0.3], [5.0], contacts=[bd.Contact(normal=0, kn=1.0)], forces={0: 0.7})
    for omega in (1.0, np.sqrt(2.5)):
        assert all_sectors(study.problem, 0.0).amplitude_bound(omega) == pytest.approx(
            0.7 / (0.3 * omega), rel=1e-9
        )


def test_no_springs_and_dampers_between_three_masses_exceed_the_bound():
    """A contact does what springs and dampers do, with more harmonics; 200 of them drawn at random."""
    rng, closest = np.random.default_rng(3), 0.0
    mass, K = [1.0, 0.6, 1.4], np.array([[2.0, -1.0, 0.0], [-1.0, 2.5, -1.5], [0.0, -1.5, 1.5]])
    for _ in range(20):
        C = rng.uniform(0.01, 0.05) * K
        contacts = [bd.Contact(normal=0, kn=1.0), bd.Contact(1, kt=0.4, mu=0.5, preload=1.0)]
        study = bd.lumped(mass, C, K, contacts=contacts, forces={0: 1.0}, response=2)
        ring = all_sectors(study.problem, 0.0)
        for _ in range(10):
            added = np.diag(10.0 ** rng.uniform(-3.0, 1.5, 3))
            losses = np.diag(10.0 ** rng.uniform(-6.0, -1.0, 3))
            for squared in scipy.linalg.eigh(K + added, np.diag(mass), eigvals_only=True):
                omega = float(np.sqrt(squared))
                x = np.linalg.solve(
                    K + added - squared * np.diag(mass) + 1j * omega * (C + losses), [1.0, 0.0, 0.0]
                )
                ratio = abs(x[2]) / ring.amplitude_bound(omega)
                assert ratio <= 1.0
                closest = max(closest, ratio)
    assert closest > 0.5, "the bound is of no use"


def test_a_response_without_damping_has_no_bound():
    study = bd.lumped([1.0], [0.0], [1.0], contacts=[bd.Contact(normal=0, kn=1.0)], forces={0: 1.0})
    assert all_sectors(study.problem, 0.0).amplitude_bound(1.0) == np.inf


# ---- results ----


@pytest.fixture(scope="module")
def bent():
    study = one_mass(normal=0, kn=0.5 * W0**2, preload=5.0).replace(harmonics=5)
    return study, study.frequency_response(0.0, (9.0, 14.0))


@pytest.mark.slow
def test_too_long_time_steps_are_divided_by_four(bent, monkeypatch):
    study, curve = bent
    own = time_response.step_error
    monkeypatch.setattr(
        time_response, "step_error", lambda t: "too long" if t.steps < 128 else own(t)
    )
    found = study.time_response(curve, steps_per_period=64)
    assert found.ok and list(found.answers)[:2] == ["256 steps", "1024 steps"]
    motion = study.motion_in_time(curve, 0, steps_per_period=64)
    fine = study.motion_in_time(curve, 0, steps_per_period=256)
    assert motion.harmonics == pytest.approx(fine.harmonics)


def test_an_amplitude_above_that_without_contacts_is_not_stated(bent, monkeypatch):
    study, curve = bent
    monkeypatch.setattr(AllSectors, "amplitude_bound", lambda ring, omega: 0.005)
    found = study.time_response(curve, steps_per_period=16)
    assert found.status_text.startswith("not found: its amplitude of 1")
    assert "mm is higher than without contacts" in found.reason
    assert found.reason.endswith("where damping limits it to 5 mm; use steps_per_period=256")
    assert (
        np.isnan([found.mean, found.lowest, found.highest, found.largest]).all()
        and not found.answers
    )
    assert "upper" not in found.summary() and found._headline().startswith("No amplitude by time")
    with pytest.raises(
        EnergyGained, match=r"^time integration at .* Hz: its amplitude of 1\d\.?\d* mm is higher"
    ):
        study.motion_in_time(curve, steps_per_period=16)


def test_a_sweep_that_its_time_steps_feed_is_incomplete():
    study = bd.lumped(
        [1.0],
        [0.04],
        [1.0],
        contacts=[bd.Contact(normal=0, kn=1000.0)],
        forces={0: 1.0},
        harmonics=3,
    )
    swept = study.frequency_sweep(0.0, (0.24, 0.26), rate=1e-4, steps_per_period=32)
    assert swept.status == "incomplete" and swept.reason.startswith(
        "the time steps change its energy by "
    )
    assert swept.reason.endswith("use steps_per_period=128")
