"""Rows 13 to 16: self-locking wedges, nodal diameters of harmonics, no excitation, units."""

from dataclasses import replace

import numpy as np
import pytest

import bdamper as bd
from bdamper.response.response_curve import self_locking
from tests.models import acyclic_model, wedge_model
from tests.plain import plain_study


@pytest.mark.parametrize(
    ("angle", "mu", "locks"), [(45.0, 0.3, False), (20.0, 0.3, False), (15.0, 0.3, True)]
)
def test_case_13_self_locking_is_named(angle, mu, locks):
    """tan(alpha) <= mu: 15 degrees lock at mu = 0.3 (16.7 degrees), 20 do not."""
    alpha = np.radians(angle)
    study = plain_study(
        acyclic_model(1, alpha=alpha, beta=alpha, n_damper_modes=0),
        engine_order=0,
        contact_stiffness="model",
        friction_coefficient=mu,
        excitation=bd.Excitation("tip", "tangential", 1.0),
    )
    assert self_locking(study.problem) == (("damper",) if locks else ())
    curve = study.frequency_response(200.0, (250.0, 300.0))
    assert any("not unique" in note for note in curve.notes) == locks
    if locks:
        # the same load by another history: another normal load, both in equilibrium
        from dataclasses import replace

        from bdamper.contact.static_state import StaticSystem, static_state

        problem = study.problem
        (force, shift), basis, kn = (
            problem.damper_load,
            problem.bases[0],
            problem.point_stiffness[:, 2],
        )
        system = StaticSystem(
            basis.omega2, basis.G.real, problem.tangential_stiffness, kn, problem.friction, -kn * problem.point_gaps,
            force, shift, np.zeros_like(force),
        )  # fmt: skip
        direct = static_state(system, 200.0)
        over = static_state(replace(system), 200.0, start=static_state(system, 2000.0))
        assert direct.ok
        assert over.ok
        assert over.force[:, 2].sum() > 1.05 * direct.force[:, 2].sum()


@pytest.mark.parametrize(
    ("n_blades", "engine_order", "expected"),
    [(12, 4, [0, 4, 4, 0]), (12, 6, [0, 6, 0, 6]), (8, 8, [0, 0, 0, 0])],
)
def test_case_14_each_harmonic_has_its_nodal_diameter(n_blades, engine_order, expected):
    model = wedge_model(1, n_blades, engine_order, harmonics=3)
    study = plain_study(
        model, engine_order=engine_order, harmonics=3, contact_stiffness="model",
        excitation=bd.Excitation("tip", "tangential", 1.0),
    )  # fmt: skip
    assert [b.nodal_diameter for b in study.problem.bases] == expected
    # phase 0 or pi between neighbours: real relative motion; else complex
    phase = 2 * np.pi * engine_order / n_blades
    for l, b in enumerate(study.problem.bases):
        real = abs(np.sin(l * phase)) < 1e-12
        assert (np.abs(b.G.imag).max() < 1e-12 * np.abs(b.G).max()) == real
    assert study.frequency_response(100.0, (250.0, 300.0)).complete


@pytest.mark.parametrize(
    "still", [bd.Excitation("tip", "tangential", amplitude) for amplitude in (0.0, 1e-320)]
)
def test_case_15_no_excitation_has_no_response(still):
    """Every analysis says so, but for the static one."""
    study = plain_study(
        acyclic_model(1), engine_order=0, contact_stiffness="model", excitation=still
    )
    assert study.static(200.0).ok
    interval = 250.0, 300.0
    asked = [
        lambda: study.frequency_response(200.0, interval), lambda: study.peak(200.0), lambda: study.peak(200.0, interval),
        lambda: study.optimal_curve((20.0, 200.0), n=3), lambda: study.stuck(interval, 200.0), lambda: study.free(interval),
        lambda: study.frequency_sweep(200.0, interval), lambda: study.problem.system(200.0),
    ]  # fmt: skip
    for ask in asked:
        with pytest.raises(
            bd.SettingError,
            match=r"^excitation: expected a force that works on .*, found .* N at 'tip'",
        ):
            ask()


@pytest.mark.parametrize("factor", [1e6, 1e-6])
def test_case_16_excitation_and_preload_scaled_together(factor):
    model = acyclic_model(1)
    # without gaps the equations are homogeneous
    faces = {
        name: replace(face, gap=np.zeros(face.n_points)) for name, face in model.interfaces.items()
    }
    model = replace(model, interfaces=faces)

    def curve(scale):
        study = plain_study(
            model,
            engine_order=0,
            contact_stiffness="model",
            excitation=bd.Excitation("tip", "tangential", 2.0 * scale),
        )
        return study.frequency_response(200.0 * scale, (250.0, 400.0))

    one, other = curve(1.0), curve(factor)
    assert one.complete
    assert other.complete
    assert abs(other.peak.frequency / one.peak.frequency - 1.0) < 1e-6
    assert abs(other.peak.amplitude / one.peak.amplitude / factor - 1.0) < 1e-6


@pytest.mark.parametrize("unit", [1e6, 1e-6])
def test_case_16_another_unit_of_time(unit):
    """Frequencies, stiffness and damping in other units: the same path, point by point."""
    from tests.hard.test_case_04_17_folds_and_peaks import STUCK, followed
    from tests.oscillators import oscillator

    def path(t):
        system = oscillator(
            1.0, 0.05 / t, np.array([[1.0, 0.3], [0.3, 2.0]]) / t**2, [[1.0, 0.0], [0.0, 0.0], [0.0, 1.0]],
            np.array([0.1, 0.12]) / t**2, [0.0, 1.0], 3, kt=0.6 / t**2, kn=6.0 / t**2, mu=0.4, n0=0.35 / t**2,
        )  # fmt: skip
        return followed(system, 1.0 / t, 3.0 / t, STUCK / t**2)

    one, other = path(1.0), path(unit)
    assert one.status == other.status == "complete"
    folds = [np.array([p.y[-1] for p in q.points if p.kind == "fold"]) for q in (one, other)]
    np.testing.assert_allclose(folds[1] * unit, folds[0], rtol=1e-8)
