"""Multipliers against brute force: disturbed states integrated in time through one period, every event located."""

from dataclasses import replace

import numpy as np
import pytest

import bdamper as bd
from bdamper.contact.laws import LAW_COUPLED
from bdamper.harmonic_balance.sector import segments
from bdamper.time_domain.floquet import monodromy, multipliers, unstable_solutions
from bdamper.time_domain.integration import AllSectors, Motion
from tests import printed
from tests.event_integration import EventIntegrator
from tests.following import slider_interval
from tests.hard.test_case_04_17_folds_and_peaks import STUCK, followed, two_oscillators
from tests.integrations import compared
from tests.models import acyclic_model
from tests.plain import plain_study


@pytest.fixture(scope="module")
def path():
    return followed(two_oscillators(15), 1.0, 3.5, STUCK)


def prepared(system, y, n_steps=96):
    """An integrator, the state at angle 0, contact and friction there, and the sliders that can move."""
    u, omega = y[:-1], y[-1]
    integrator = EventIntegrator(system, omega, n_steps)
    x, _, _ = system.contact(u)
    p = system.structure.points
    cycles = [
        segments(x[i], p.kt[i], p.kn[i], p.mu[i], p.n0[i], p.slider[i], p.law[i])[d]
        for i, d in integrator.pairs
    ]
    closed = (
        system.structure.points.n0
        + system.structure.points.kn * (x[:, 2, 0] + x[:, 2, 1::2].sum(axis=1))
        > 0.0
    )
    states = [next(s for a, b, s in parts if -a % (2.0 * np.pi) < b - a) for parts in cycles]
    sliders = AllSectors(system, 1, 0).initial_slider(u, omega, 4096)[0]
    z = integrator.start(u, states, np.array([sliders[pair] for pair in integrator.pairs]))
    moving = [any(s for *_, s in parts) for parts in cycles]
    return (
        integrator,
        z,
        closed,
        states,
        [j for j, state in enumerate(states) if state == 0 and moving[j]],
    )


@pytest.mark.nightly
@pytest.mark.slow
def test_multipliers_against_time_integration(path):
    """Points with slip or separation, stable and not; disturbed motions meet events of their own, located exactly."""
    system = two_oscillators(15)
    points = [p for p in path.points if p.shares[0] < 0.45][::14]
    assert len(points) >= 4
    verdicts = set()
    for p in points:
        found = multipliers(system, p.y[:-1], p.y[-1])
        integrator, *rest = prepared(system, p.y)
        expected = integrator.multipliers(*rest)
        for value in found[:4]:  # harmonic balance with 15 harmonics is no exact motion
            assert np.abs(expected - value).min() < 1e-3
        verdicts.add(bool(np.abs(found[0]) > 1.0))
        assert (np.abs(found[0]) > 1.0) == (np.abs(expected[0]) > 1.0)
    assert verdicts == {True, False}


@pytest.mark.nightly
@pytest.mark.slow
def test_multipliers_of_a_stiff_rig_with_a_free_damper():
    """Modes of the damper on its contacts at 27 to 40 times the frequency: fifty events in a period.

    Sliders that rest at the end of their interval are moved off it, or differences would not converge to a derivative.
    """
    model = acyclic_model(1, n_points=4, n_blade_modes=2, n_damper_modes=0)
    omega, u = 2 * np.pi * 358.523, None
    for harmonics in (3, 15, 31, 47, 63):
        study = plain_study(
            model, engine_order=0, harmonics=harmonics, contact_stiffness="model", damping_ratio=0.03,
            excitation=bd.Excitation("tip", "tangential", 40.0),
        )  # fmt: skip
        system = study.problem.system(200.0)
        if u is None:
            u = study.frequency_response(200.0, (300.0, 358.523)).unknowns[-1]
        guess = np.append(u, np.zeros(system.n_unknowns - len(u)))
        u = system.correct_at(guess, omega, np.ones(len(guess) + 1), 1e-10, 100, True).y[:-1]
    for _ in range(3):
        ends = slider_interval(system, u)
        margin = 0.05 * (ends[..., 1] - ends[..., 0])
        inside = np.clip(
            system.structure.points.slider, ends[..., 0] + margin, ends[..., 1] - margin
        )
        points = replace(
            system.structure.points,
            slider=np.where(np.isnan(margin), system.structure.points.slider, inside),
        )
        scale = 1.0 / system.row_scale[0], 1.0 / system.row_scale[-1]
        system = replace(
            system.structure, points=points, contact_forces="event_driven", force_scale=scale
        ).equations
        found = system.correct_at(u, omega, np.ones(len(u) + 1), 1e-10, 100, True)
        assert found.status == 0
        u = found.y[:-1]
    values = multipliers(system, u, omega)
    integrator, *rest = prepared(system, np.append(u, omega), 512)
    expected = integrator.multipliers(*rest)
    np.testing.assert_allclose(np.abs(values[:4]), np.abs(expected[:4]), atol=2.5e-2)
    assert np.abs(values[0]) > 1.05


def test_a_multiplier_is_one_at_a_fold(path):
    system = two_oscillators(15)
    folds = [
        p
        for p in path.points
        if (p.kind == "fold" and p.shares[1] > 0.0) or (p.kind == "fold" and p.shares[2] > 0.1)
    ]
    assert folds
    for p in folds:
        values = multipliers(system, p.y[:-1], p.y[-1])
        assert np.abs(values - 1.0).min() < 2e-2


def test_sign_of_the_determinant_agrees_with_the_multipliers(path):
    """det J < 0 means unstable: no point may be unstable by the sign and stable by its multipliers."""
    system = two_oscillators(15)
    for p in path.points[::4]:
        _, J, _ = system.evaluate(p.y[:-1], p.y[-1])
        largest = np.abs(multipliers(system, p.y[:-1], p.y[-1])).max()
        if abs(largest - 1.0) > 0.02:
            assert (np.linalg.slogdet(J)[0] > 0) == (largest < 1.0)


@pytest.mark.slow
def test_a_neutral_position_has_no_sign():
    """Under a constant normal load a wedge in gross slip has mean positions that no contact determines."""
    study = plain_study(
        acyclic_model(1, n_points=4, n_blade_modes=2), engine_order=0, harmonics=5, variable_normal_load=False,
        friction_law="coupled", contact_forces=bd.AFT(128), contact_stiffness=1e6, friction_coefficient=0.3,
        damping_ratio=0.01, excitation=bd.Excitation("tip", "tangential", 100.0),
    )  # fmt: skip
    curve, system = study.frequency_response(50.0, (280.0, 330.0)), study.problem.system(50.0)
    values = []
    for u, omega in zip(curve.unknowns, 2.0 * np.pi * curve.frequency):
        J = system.evaluate(u, omega)[1]
        values.append(np.linalg.svd(J / np.abs(J).max(axis=1, keepdims=True), compute_uv=False)[-1])
    neutral = np.array(values) < 1e-12
    assert neutral.any() and not neutral.all()
    judged = study.with_stability(curve)
    assert not judged.unstable[neutral].any()
    said = {"undecided (det J >= 0) with 5 harmonics", "unstable (det J < 0) with 5 harmonics"}
    assert set(judged.labels) <= said and judged.unstable_count == judged.unstable.sum()
    signs = replace(judged, unstable=np.arange(len(judged)) % 2 == 1)
    assert set(signs.labels[::2]) == {min(said)} and set(signs.labels[1::2]) == {max(said)}
    assert "unstable (det J < 0)" in signs.plot().axes[0].get_legend_handles_labels()[1]


def test_stuck_sliders_are_left_out():
    system = two_oscillators(3)
    p = followed(system, 1.0, 1.05, STUCK).points[0]
    assert p.shares[0] == 0.5  # one of two directions has no friction
    M = monodromy(system, p.y[:-1], p.y[-1])
    assert M.shape == (4, 4)
    # linear: the determinant is that of viscous damping alone
    np.testing.assert_allclose(np.linalg.det(M), np.exp(-2 * 0.05 * 2 * np.pi / p.y[-1]), rtol=1e-9)


def test_sampled_law_is_judged_along_the_events_of_its_motion(path):
    exact, sampled = two_oscillators(15), two_oscillators(15, contact_forces=bd.AFT(512))
    for p in [q for q in path.points if q.shares[2] > 0.5][::12]:
        a, b = (unstable_solutions(system, p.y[None, :-1], p.y[-1:]) for system in (exact, sampled))
        assert a == b and "multipliers" in a[1]
        largest = (np.abs(multipliers(system, p.y[:-1], p.y[-1])[0]) for system in (exact, sampled))
        np.testing.assert_allclose(*largest, rtol=1e-12)


def test_coupled_law_is_judged_by_the_determinant_and_verified(path):
    """Motion along one tangential axis: the disk of the coupled law is the interval of the separable one."""
    exact = two_oscillators(15)
    points = replace(exact.structure.points, law=np.array([LAW_COUPLED], np.intc))
    coupled = replace(exact.structure, points=points, contact_forces=bd.AFT(512)).equations
    folds = [i for i, p in enumerate(path.points) if p.kind == "fold"]
    between = path.points[folds[0] + 3 : folds[1] - 2]
    chosen = [between[len(between) // 2], path.points[folds[0] - 5]]
    unstable, note = unstable_solutions(
        coupled, np.array([p.y[:-1] for p in chosen]), np.array([p.y[-1] for p in chosen])
    )
    assert unstable.tolist() == [True, False] and "sign of det J" in note
    # disturbed a little and integrated over many periods, the unstable solution is left, the stable one comes back
    ring = AllSectors(coupled, 1, 0)
    n = ring.n_coordinates
    for p, leaves in zip(chosen, unstable):
        u, omega = p.y[:-1], p.y[-1]
        q, v = ring.state(u, omega, 0.0)
        first, size = q, 1e-3 * np.abs(q).max()
        q = q + size * np.repeat([1.0, 0.0], n)
        q = ring.integrate(
            Motion(q, v, ring.initial_slider(u, omega, 256)), omega, 256, 30
        ).motion.q
        away = np.abs(q - first).max()
        assert away > 20.0 * size if leaves else away < size
    p = max((q for q in path.points), key=lambda q: abs(exact.response(q.y[:-1])[1]))
    assert compared(coupled, p.y[:-1], p.y[-1], 1, 0, 400, periods=30).distance < 1e-2


@pytest.mark.slow
def test_a_fully_stuck_solution_under_constant_load_is_linear():
    """Most sliders rest at the end of their interval, as static slip leaves them; the structure is the one with springs."""
    study = plain_study(
        acyclic_model(1, n_points=4, n_blade_modes=2, n_damper_modes=0),
        engine_order=0,
        contact_stiffness="model",
        damping_ratio=0.02,
        excitation=bd.Excitation("tip", "tangential", 1.0),
        variable_normal_load=False,
    )
    curve = study.frequency_response(2000.0, (300.0, 300.2))
    assert curve.shares[0, 0] == 1.0
    system, omega = study.problem.system(2000.0), 2.0 * np.pi * curve.frequency[0]
    _, _, shares = system.contact(curve.unknowns[0])
    points, basis = system.structure.points, system.structure.bases[0]
    springs = np.column_stack(
        [points.kt * (shares[:, [0, 2]] > 0.5), points.kn * (shares[:, 4] < 0.5)]
    )
    G = np.asarray(basis.G).real
    n = len(basis.omega2)
    K = np.diag(basis.omega2) + np.einsum("pdi,pd,pdj->ij", G, springs, G)
    A = np.block(
        [
            [np.zeros((n, n)), np.eye(n)],
            [-K, -np.diag(2.0 * basis.damping_ratio * np.sqrt(basis.omega2))],
        ]
    )
    period = 2.0 * np.pi / omega
    expected = np.exp(np.linalg.eigvals(A) * period)
    assert not unstable_solutions(system, curve.unknowns[:1], np.array([omega]))[0].any()
    values = multipliers(system, curve.unknowns[0], omega)
    np.testing.assert_allclose(np.abs(values[0]), np.abs(expected).max(), atol=1e-6)
    assert len(values) == 2 * n
    for value in values:
        assert np.abs(expected - value).min() < 1e-6


def test_coupled_law_of_a_study():
    """Friction along both tangential axes: harmonic balance, verdict and time integration of one acyclic structure."""
    study = plain_study(
        acyclic_model(1, n_points=4, n_blade_modes=2),
        engine_order=0,
        harmonics=3,
        contact_stiffness=2e6,
        friction_coefficient=0.3,
        friction_law="coupled",
        contact_forces=bd.AFT(64),
        damping_ratio=0.03,
        excitation=bd.Excitation("tip", "tangential", 100.0),
    )
    curve = study.frequency_response(50.0, (290.0, 320.0))
    assert curve.complete
    assert curve.peak.shares[1] > 0.02
    assert study.motion_in_time(curve, periods=5, steps_per_period=448).distance < 0.02
    i = curve.peak_index
    system = study.problem.system(50.0)
    assert not unstable_solutions(system, curve.unknowns[[i]], 2 * np.pi * curve.frequency[[i]])[
        0
    ].any()


@pytest.mark.slow
def test_curves_carry_stability(tmp_path):
    study = plain_study(
        acyclic_model(1),
        engine_order=0,
        contact_stiffness="model",
        damping_ratio=0.02,
        excitation=bd.Excitation("tip", "tangential", 40.0),
    )
    curve = study.frequency_response(200.0, (250.0, 450.0), stability=True)
    assert curve.complete
    assert curve.unstable.shape == (len(curve),)
    assert "all disturbances" in curve.stability_note
    assert "unstable count" in curve.summary()
    curve.save(tmp_path / "curve.h5")
    again = bd.load(tmp_path / "curve.h5")
    np.testing.assert_array_equal(again.unstable, curve.unstable)
    assert again.notes == curve.notes
    assert again.stability_note == curve.stability_note


def test_cyclic_structures_by_the_determinant():
    study = plain_study(
        bd.reference_model("bladed_disk", 9),
        engine_order=5,
        friction_coefficient=0.4,
        excitation=bd.Excitation("tip", "tangential", 1.0),
    )
    curve, system = (
        study.frequency_response(1000.0, (320.0, 380.0), stability=True),
        study.problem.system(1000.0),
    )
    solutions = zip(curve.unknowns, 2.0 * np.pi * curve.frequency)
    by_sign = np.array(
        [np.linalg.slogdet(system.evaluate(u, omega)[1])[0] > 0.0 for u, omega in solutions]
    )
    assert "the others are not examined" in curve.stability_note
    again = study.with_stability(curve)
    assert again.stability_note == curve.stability_note, "seconds are no part of a result"
    assert not again.diff(curve)
    n_unstable = int(curve.unstable.sum())
    assert n_unstable > 0
    assert printed.row(curve, "Stability").remark == f"{n_unstable} of {len(curve)} points unstable"
    folds = curve.folds
    assert len(folds) == 2
    # the sign of the determinant changes at the folds alone
    assert not by_sign[folds[0] + 1 : folds[1]].any()
    assert by_sign[: folds[0]].all() and by_sign[folds[1] + 1 :].all()
    # between the folds all points are unstable, and no other point is said to be stable
    elsewhere = np.delete(np.arange(len(curve)), folds)  # at a fold det J is zero to rounding
    np.testing.assert_array_equal(curve.unstable[elsewhere], ~by_sign[elsewhere])
    said = np.where(
        curve.unstable,
        "unstable (det J < 0) with 1 harmonic",
        "undecided (det J >= 0) with 1 harmonic",
    )
    assert curve.labels.tolist() == said.tolist()
    other = bd.reference_model("bladed_disk", 24)
    with pytest.raises(bd.SettingError, match="curve"):
        plain_study(other, engine_order=5, excitation=bd.Excitation("tip")).with_stability(curve)
