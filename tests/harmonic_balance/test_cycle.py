"""Energy of a cycle and histories of forces: balance, closed forms, and the forces that the core projects."""

import numpy as np
import pytest

import bdamper as bd
from bdamper.harmonic_balance.contact_cycle import energies, histories
from tests.oscillators import oscillator
from tests.plain import plain_study

KT = 2.0


def jenkins(harmonics, limit=1.0):
    """One mass on a spring, a dashpot and a friction element of stiffness 2 and the given limit, near resonance."""
    system = oscillator(
        1.0, 0.02, 1.0, [[1.0], [0.0], [0.0]], [1.0], [1.0], harmonics, kt=KT, kn=0.0, mu=1.0, n0=limit
    )  # fmt: skip
    guess = np.zeros(system.n_unknowns)
    guess[1:3] = 0.5, -3.0
    found = system.correct_at(
        guess, 1.15, np.ones(system.n_unknowns + 1), 1e-13, 50, line_search=True
    )
    assert found.status == 0
    return system, found.y[:-1]


def test_a_jenkins_element_in_closed_form():
    system, u = jenkins(1)
    e, A = energies(system, u, 1.15), abs(system.response(u)[1])
    assert A > 1.0 / KT
    assert e["contact"] == pytest.approx([4.0 * (A - 1.0 / KT)], rel=1e-12)
    angle = np.arccos(1.0 - 2.0 / (KT * A))
    assert e["stiffness"].real == pytest.approx(
        KT / np.pi * (angle - 0.5 * np.sin(2.0 * angle)), rel=1e-12
    )
    assert e["stiffness"].imag == pytest.approx(4.0 * (A - 1.0 / KT) / (np.pi * A**2), rel=1e-12)
    assert e["kinetic"] == pytest.approx(0.5 * 1.15**2 * A**2, rel=1e-12)


def test_the_history_of_a_jenkins_element_is_a_parallelogram():
    system, u = jenkins(1)
    theta = np.linspace(0.0, 2.0 * np.pi, 2001)
    X, F = histories(system, u, theta)
    x, f = X[0, 0], F[0, 0]
    assert np.abs(f).max() == pytest.approx(1.0, abs=1e-14)
    slope = np.diff(f) / np.where(np.abs(np.diff(x)) > 1e-9, np.diff(x), np.inf)
    inside = (np.abs(f[1:]) < 1.0 - 1e-9) & (np.abs(f[:-1]) < 1.0 - 1e-9)
    assert slope[inside] == pytest.approx(KT, rel=1e-6) and slope[~inside].max() <= KT * (
        1.0 + 1e-6
    )
    assert 0.1 < inside.mean() < 0.9


@pytest.mark.parametrize(
    ("settings", "error"),
    [
        ({}, 2e-6),
        ({"separation": False}, 2e-6),
        ({"variable_normal_load": False}, 2e-6),
        ({"friction_coefficient": {"left": 0.3, "right": 0.0}}, 2e-6),
        ({"friction_law": "bonded"}, 1e-12),
        (
            {"friction_law": "coupled", "contact_forces": bd.AFT(256)},
            2e-3,
        ),  # the error is of order 1/n_time with separation
    ],
    ids=str,
)
def test_histories_have_the_harmonics_of_the_core(settings, error):
    """Of any motion, at equal steps: those of the exact evaluation to second order in the step."""
    model = bd.reference_model("bladed_disk", 9)
    study = plain_study(model, bd.Excitation("tip"), engine_order=5, friction_coefficient=0.4)
    study = study.replace(**settings)
    system, static = study.problem.system(500.0), study.static(500.0)
    # small enough for points that come to rest in a disk
    size, frequency = (0.3, 360.0) if "contact_forces" in settings else (0.5, 355.0)
    stuck = system.structure.linear.response(
        2.0 * np.pi * frequency, study.problem.at(500.0).stuck_springs()
    )
    u = system.layout.pack(static.q, size * stuck)
    _, forces, share = system.contact(u)
    n = 3000 if error < 1e-4 else 256
    theta = 2.0 * np.pi * np.arange(n) / n
    _, F = histories(system, u, theta)
    mean, first = F.mean(axis=2), F @ np.exp(-1j * theta) * 2.0 / n
    scale = np.abs(forces).max()
    assert np.abs(mean - forces[..., 0]).max() < error * scale
    assert np.abs(first - (forces[..., 1] - 1j * forces[..., 2])).max() < error * scale
    if "friction_law" not in settings:
        assert 0.05 < share[:18, 0].mean() < 0.95
