"""Time integration of all sectors against harmonic balance, closed forms and its own order of accuracy."""

from dataclasses import replace

import numpy as np
import pytest

import bdamper as bd
from bdamper.contact.laws import LAW_BONDED
from bdamper.harmonic_balance.sector import SectorData
from bdamper.time_domain.floquet import multipliers, unstable_solutions
from bdamper.time_domain.integration import AllSectors, IntegrationFailed
from bdamper.time_domain.transient import AGREES, CRITERIA, DIFFERS, UNDECIDED, judged
from tests.hard.test_case_04_17_folds_and_peaks import STUCK, followed, two_oscillators
from tests.integrations import compared, fails_after, integrated, interrupted_at
from tests.models import acyclic_model, wedge_model
from tests.plain import plain_study


def distance(n_harm, periods=45, steps=600):
    system = two_oscillators(n_harm)
    p = max(
        followed(system, 1.0, 3.5, STUCK).points, key=lambda q: abs(system.response(q.y[:-1])[1])
    )
    return compared(system, p.y[:-1], p.y[-1], 1, 0, steps, periods=periods)


@pytest.mark.slow
def test_settled_response_approaches_harmonic_balance_with_more_harmonics():
    one, many = distance(1).distance, distance(13).distance
    assert many < 5e-3
    assert many < 0.2 * one


def test_linear_motion_to_second_order():
    """Fully stuck: harmonic balance is exact, so the distance is the error of the integration."""
    system = two_oscillators(1)
    p = followed(system, 1.0, 1.02, STUCK).points[0]
    errors = []
    for n in (100, 200):
        ring = AllSectors(system, 1, 0)
        settled = ring.integrate(ring.start(p.y[:-1], p.y[-1], n), p.y[-1], n, 150).harmonics[
            -1, 0, 1
        ]
        errors.append(abs(settled / system.response(p.y[None, :-1])[0, 1] - 1.0))
    assert 3.5 < errors[0] / errors[1] < 4.5
    assert errors[1] < 1e-3


def test_ring_of_sectors_keeps_the_travelling_wave():
    """Bias, fundamental and second harmonic in different nodal diameters; friction and separation; all sectors."""
    model = wedge_model(
        0, n_blades=8, engine_order=2, n_points=4, n_blade_modes=2, harmonics=3, n_damper_modes=0
    )
    study = plain_study(
        model,
        engine_order=2,
        harmonics=3,
        contact_stiffness=3e6,
        friction_coefficient=0.3,
        damping_ratio=0.03,
        excitation=bd.Excitation("tip", "tangential", 20.0),
    )
    curve = study.frequency_response(400.0, (250.0, 350.0))
    assert curve.complete
    result = study.motion_in_time(curve, periods=20)
    assert result.blades.shape[1] == 4  # the pattern repeats
    assert (curve.peak.shares[1:] > 0.01).all()  # slip and separation
    assert result.distance < 0.03
    assert "distance" in result.summary() and "evaluations" in result.summary()
    cost = result.cost
    assert cost.evaluations >= 20 * CRITERIA.steps
    assert cost.contact == 0.0 < cost.time_integration <= cost.core < cost.processor
    assert result.plot().axes[0].get_xlabel() == "Period of the excitation"


def rig(law, contact_forces="event_driven", harmonics=5):
    """Two blades and a wedge that slips on them."""
    return plain_study(
        acyclic_model(1, n_points=4, n_blade_modes=2),
        engine_order=0,
        harmonics=harmonics,
        contact_stiffness=2e6,
        friction_coefficient=0.3,
        contact_forces=contact_forces,
        damping_ratio=0.03,
        excitation=bd.Excitation("tip", "tangential", 100.0),
        **law,
    )


LAWS = {
    "constant normal load": {"variable_normal_load": False, "harmonics": 13},
    "constant load in a disk": {
        "friction_law": "coupled",
        "variable_normal_load": False,
        "contact_forces": bd.AFT(128),
    },
    "bonded": {"friction_law": "bonded"},
    "sampled": {"contact_forces": bd.AFT(128), "harmonics": 9},
}
# Some twice what the harmonics that are left out amount to: 4.2e-4 and 4.2e-3 under constant load, 6.0e-3 with nine
# harmonics of a variable load (2.2e-3 with thirteen, 9.8e-3 with five).  The bonded structure is linear: what remains is
# the error of the integration, 1.5e-4.
DISTANCE = {
    "constant normal load": 1e-3,
    "constant load in a disk": 1e-2,
    "bonded": 1e-3,
    "sampled": 1e-2,
}


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [pytest.param(n, marks=[pytest.mark.slow] * (n == "constant normal load")) for n in LAWS],
)
def test_other_contact_laws_settle_where_harmonic_balance_says(name):
    """The peak in time, and that no other law has it.

    Under a constant normal load the motion has odd harmonics alone.  The equations with five or seven harmonics have
    further branches with even ones, which the motion in time does not have.  They branch off within the interval, and
    rounding decides which branch a curve follows.  With thirteen harmonics the curve passes none of them.
    """
    law = dict(LAWS[name])
    harmonics = law.pop("harmonics", 5)
    study = rig(law, law.pop("contact_forces", "event_driven"), harmonics)
    curve = study.frequency_response(50.0, (290.0, 320.0))
    assert curve.complete
    if name != "bonded":
        assert curve.peak.shares[1] > 0.02  # it slips
    found = study.motion_in_time(curve, periods=12, steps_per_period=448)
    assert found.distance < DISTANCE[name]
    if name.startswith("constant"):
        expected = curve.harmonics[curve.peak_index]
        assert np.abs(expected[2::2]).max() < 1e-9 * np.abs(expected[1])
    # the motion of one law is none of the others
    if name == "sampled":
        return
    i = curve.peak_index
    omega = 2 * np.pi * curve.frequency[i]
    of_another = rig({}, harmonics=harmonics).problem.system(50.0)
    other = compared(of_another, curve.unknowns[i], omega, 1, 0, 448, periods=12)
    assert other.distance > 3.0 * found.distance
    unstable, note = unstable_solutions(
        study.problem.system(50.0), curve.unknowns[[i]], np.array([omega])
    )
    if (
        name == "constant load in a disk"
    ):  # det J is that of five harmonics, beyond one of their branches
        assert "det J" in note
        return
    assert not unstable.any() and "multipliers" in note
    if name == "bonded":  # linear: the least damped mode, to second order in the step
        system = study.problem.system(50.0)
        basis, n = system.structure.bases[0], system.n_mean
        points = system.structure.points
        springs = np.column_stack([points.kt, points.kn]) * (points.law == LAW_BONDED)[:, None]
        stiffness = np.diag(basis.omega2) + np.einsum(
            "pam,pa,pan->mn", basis.G.real, springs, basis.G.real
        )
        found = multipliers(system, curve.unknowns[i], omega)
        rates = np.linalg.eigvals(
            np.block([[np.zeros((n, n)), np.eye(n)], [-stiffness, -np.diag(basis.damping)]])
        )
        np.testing.assert_allclose(
            np.abs(found[0]), np.exp(rates.real.max() / curve.peak.frequency), rtol=2e-3
        )


def test_a_motion_may_differ():
    """A motion that is not the solution is told from it."""
    system = two_oscillators(5)
    p = followed(system, 1.5, 2.2, STUCK).points[3]
    wrong = p.y[:-1].copy()
    wrong[2:] *= 1.3
    found = compared(system, wrong, p.y[-1], 1, 0, 400, periods=48)
    assert found.distance > 0.1 and found.verdict != AGREES
    right = compared(system, p.y[:-1], p.y[-1], 1, 0, 400)
    assert (
        right.verdict == AGREES and right.distance < 0.02 and len(right.transient.amplitude) == 96
    )
    assert compared(system, p.y[:-1], p.y[-1], 1, 0, 400, periods=5).verdict == UNDECIDED


def test_an_integration_that_fails_is_no_response(monkeypatch):
    system = two_oscillators(1)
    p = followed(system, 1.0, 1.02, STUCK).points[0]
    u, omega = p.y[:-1], p.y[-1]
    for ask in (
        lambda: compared(system, u, omega, 1, 0, 256),
        lambda: integrated(system, omega, 1, 0, u, 100, 256),
    ):
        fails_after(monkeypatch, 20)
        with pytest.raises(IntegrationFailed, match="the time integration fails near "):
            ask()
        monkeypatch.undo()


def test_what_decides():
    """Amplitudes made up, for a memory of 200 periods and a tolerance of 5 %."""
    k = np.arange(400.0)
    noise = np.random.default_rng(0).uniform(-1.0, 1.0, 400)
    cases = {
        "stays": (1.0 + 1e-6 * k, AGREES, 96),
        "leaves": (1.0 + 1e-4 * np.exp(k / 20.0), DIFFERS, None),
        "settles elsewhere": (1.0 - 0.2 * (1.0 - np.exp(-k / 10.0)), DIFFERS, 48),
        "settles just outside": (1.06 + 0.0 * k, DIFFERS, 96),
        "settles within": (1.0 + 0.03 * (1.0 - np.exp(-k / 200.0)), AGREES, None),
        "creeps out of the tolerance": (1.0 + 0.08 * (1.0 - np.exp(-k / 200.0)), DIFFERS, None),
        "has not crept out yet": (1.0 + 0.054 * (1.0 - np.exp(-k / 200.0)), UNDECIDED, None),
        "scatters a little": (1.0 + 0.04 * noise, AGREES, None),
        "scatters": (1.0 + 0.4 * noise, DIFFERS, None),
        "comes back": (1.0 + 0.5 * np.exp(-k / 60.0), AGREES, None),
    }
    for name, (amplitude, expected, after) in cases.items():
        looks = [judged(amplitude[:n], 1.0, 0.05, 200.0) for n in range(16, 401, 16)]
        first = next((i for i, look in enumerate(looks) if look[0] != UNDECIDED), len(looks) - 1)
        assert looks[first][0] == expected, (name, looks[first])
        assert after is None or 16 * (first + 1) == after, name


def test_an_interruption_leaves_the_periods_so_far(monkeypatch):
    system = two_oscillators(5)
    p = followed(system, 1.5, 2.2, STUCK).points[3]
    interrupted_at(monkeypatch, 4)
    found = compared(system, p.y[:-1], p.y[-1], 1, 0, 400, periods=60)
    monkeypatch.undo()
    whole = compared(system, p.y[:-1], p.y[-1], 1, 0, 400, periods=4)
    assert found.interrupted and not whole.interrupted and len(found.transient.harmonics) == 4
    np.testing.assert_array_equal(found.transient.harmonics, whole.transient.harmonics)


@pytest.mark.slow
@pytest.mark.parametrize("frequency", [340.0, 357.0])
def test_residual_modes_are_like_many_modes_in_time(frequency):
    """Six patterns beside ten blade modes, and forty modes with the flexibility that these leave out at each point: either
    motion stays on its own curve, and they differ as the curves do (by 16 and 30 %)."""
    settings = {"engine_order": 5, "friction_coefficient": 0.4, "damping_ratio": 0.005, "harmonics": 1,
                "excitation": bd.Excitation("tip", "tangential", 1.0)}  # fmt: skip
    model = bd.reference_model("bladed_disk", 9)
    expected, found = [], []
    for more in ({}, {"blade_modes": 40, "contact_stiffness": "unit_traction"}):
        study = bd.Study(model, **settings, **more)
        curve = study.frequency_response(2000.0, (frequency - 2.0, frequency + 2.0))
        i = int(np.abs(curve.frequency - frequency).argmin())
        assert ((np.concatenate([b.mass for b in study.problem.bases]) == 0.0).any()) == (not more)
        system, omega = study.problem.system(2000.0), 2 * np.pi * curve.frequency[i]
        expected.append(curve.amplitude[i])
        found.append(
            integrated(system, omega, 65, 5, curve.unknowns[i], 80, 256).amplitude[-20:].mean()
        )
    np.testing.assert_allclose(found, expected, rtol=0.01)
    assert abs(np.diff(found)[0]) == pytest.approx(
        abs(np.diff(expected)[0]), abs=0.01 * max(expected)
    )


def test_what_cannot_be_integrated_is_refused():
    model = wedge_model(4, n_blades=8, engine_order=1, n_points=4, n_blade_modes=2, harmonics=3)
    study = plain_study(
        model, engine_order=1, harmonics=3, fundamental_modes_only=True, contact_stiffness="model",
        excitation=bd.Excitation("tip", "tangential", 1.0),
    )  # fmt: skip
    with pytest.raises(bd.SettingError, match="fundamental_modes_only"):
        AllSectors(study.problem.system(100.0), 8, 1)
    study = plain_study(
        acyclic_model(1),
        engine_order=0,
        contact_stiffness="model",
        excitation=bd.Excitation("tip", "tangential", 1.0),
    )
    curve = study.frequency_response(200.0, (300.0, 310.0))
    with pytest.raises(bd.SettingError, match="index"):
        study.motion_in_time(curve, 10**6)
    with pytest.raises(
        bd.SettingError, match="index: expected none, since a frequency is given, found 0"
    ):
        study.motion_in_time(curve, 0, frequency=305.0)
    with pytest.raises(bd.SettingError, match="steps_per_period"):
        study.motion_in_time(curve, 0, steps_per_period=8)


def test_without_a_mean_the_wave_alone_is_integrated():
    """A mean that is held has no coordinates: no other nodal diameter, and no reason to ask for several bases."""
    model = wedge_model(
        0, n_blades=8, engine_order=2, n_points=4, n_blade_modes=2, harmonics=3, n_damper_modes=0
    )
    study = plain_study(model, engine_order=2, contact_stiffness=3e6, friction_coefficient=0.3, damping_ratio=0.03,
                        bias=False, excitation=bd.Excitation("tip", "tangential", 200.0))  # fmt: skip
    curve = study.frequency_response(400.0, (250.0, 255.0))
    assert AllSectors(study.problem.system(400.0), 8, 2).families == {1: 1}
    found = compared(
        study.problem.system(400.0), curve.unknowns[0], 2 * np.pi * curve.frequency[0], 8, 2, 1024
    )
    last = np.abs(found.transient.response[-1])
    assert found.verdict == AGREES and last[0] < 1e-3 * last[1]


def test_modal_coordinates_may_have_any_mass():
    """The same structure in other units of its modal coordinates: the same motion in time and the same multipliers."""
    system, size = two_oscillators(5), np.array([3.0, 0.2])
    bases = [
        replace(b, omega2=b.omega2 * size**2, mass=b.mass * size**2, G=b.G * size)
        for b in system.structure.bases
    ]
    u_size = np.tile(size, system.n_unknowns // 2)
    rows = [r * size for r in system.response_rows]
    scaled = SectorData(
        bases, system.structure.points, system.structure.force * u_size, rows
    ).equations
    p = max(followed(system, 1.5, 2.2, STUCK).points, key=lambda q: q.shares[1])
    u = p.y[:-1] / u_size
    np.testing.assert_allclose(scaled.response(u), system.response(p.y[:-1]), rtol=1e-12)
    one, other = (
        integrated(s, p.y[-1], 1, 0, x, 5, 400).response
        for s, x in ((system, p.y[:-1]), (scaled, u))
    )
    np.testing.assert_allclose(other, one, atol=1e-9 * np.abs(one).max())
    values = [
        np.sort_complex(multipliers(s, x, p.y[-1])) for s, x in ((system, p.y[:-1]), (scaled, u))
    ]
    np.testing.assert_allclose(values[1], values[0], rtol=0, atol=1e-8)
