"""Loops, energies and equivalent stiffness of the contacts of a bladed disk."""

from dataclasses import replace

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
import pytest

import bdamper as bd
from bdamper.harmonic_balance.contact_cycle import energies
from tests.plain import plain_study

INTERVAL = (335.0, 350.0)


@pytest.fixture(scope="module")
def study():
    model = bd.reference_model("bladed_disk", 9)
    return plain_study(model, bd.Excitation("tip"), engine_order=5, friction_coefficient=0.4)


@pytest.fixture(scope="module")
def curve(study):
    return study.frequency_response(500.0, INTERVAL)


@pytest.fixture(scope="module")
def cycle(study, curve):
    return study.hysteresis(curve)


def area(x, f):
    return float(np.sum(0.5 * (f[1:] + f[:-1]) * np.diff(x)))


def test_energies_balance_along_a_curve(study, curve):
    found = study.dissipation(curve)
    assert not found._facts()  # the facts of a single solution would be numbers of points here
    assert np.abs(found.imbalance).max() < 2e-9  # the residual of a point of a curve is 1e-9
    assert found.amplitude == pytest.approx(curve.amplitude, rel=1e-12)
    assert (found.energy >= -1e-12 * found.excitation.max()).all()
    assert found.lost.max() > 0.5 * found.excitation.max()
    stuck = curve.shares[:, 0] > 1.0 - 1e-12
    assert not stuck.any() or np.abs(found.lost[stuck]).max() < 1e-12 * found.excitation.max()


@pytest.mark.slow
def test_points_that_never_slip_or_are_left_out(study):
    bonded = study.replace(friction_law="bonded")
    found = bonded.hysteresis(bonded.frequency_response(500.0, (352.0, 354.0)))
    assert abs(found.lost) < 1e-9 * found.excitation and abs(found.imbalance) < 2e-9
    part = study.replace(
        separation=False, gap={"left": np.r_[1e-3, np.zeros(8)], "right": np.zeros(9)}
    )
    found = part.hysteresis(part.frequency_response(500.0, (353.0, 353.5)))
    assert abs(found.imbalance) < 2e-9 and found.lost > 0.1 * found.excitation
    v, n = found.displacement[1:18, 2], found.force[1:18, 2]
    kn = part.problem.point_stiffness[1:18, 2]
    assert n.min() < -1.0 and not found.gap[1:18].any(), "surfaces are held together"
    assert n - n[:, :1] == pytest.approx(kn[:, None] * (v - v[:, :1]), abs=1e-9 * n.max())
    assert np.flatnonzero(np.isnan(found.displacement[:, 0, 0])).tolist() == [0]
    assert found.energy[0] == 0.0 and not found.force[0].any()
    with pytest.raises(bd.SettingError, match="which the settings omit"):
        found.loop(0)
    assert np.isfinite(found.loop("left")[0]).all()


def test_areas_of_loops_are_the_energies(cycle):
    rows = np.flatnonzero(cycle.energy > 0.01 * cycle.energy.max())
    assert len(rows) > 9
    for i in rows:
        loops = [area(*cycle.loop(int(i), direction)) for direction in ("t1", "t2", "n")]
        assert sum(loops) == pytest.approx(cycle.energy[i], rel=2e-3)
    assert area(*cycle.loop()) == pytest.approx(cycle.lost, rel=2e-4), "one harmonic: the whole"
    assert np.pi * cycle.width * cycle.amplitude**2 == pytest.approx(cycle.lost, rel=1e-12)
    assert sum(cycle.by_interface.values()) == pytest.approx(cycle.lost, rel=1e-12)


def test_forces_lie_in_the_cone_and_the_gap_is_open_without_pressure(study, cycle):
    t, n = cycle.force[:, :2], cycle.force[:, 2]
    assert (
        np.abs(t) <= study.problem.friction[:, None, None] * n[:, None] * (1.0 + 1e-9) + 1e-9
    ).all()
    assert (cycle.gap[n > 0.0] == 0.0).all() and (n[cycle.gap > 0.0] == 0.0).all()
    assert (cycle.gap > 0.0).any() and (n > 0.0).any()


def test_residual_modes_are_in_series_with_the_contact_elements(study):
    """Stuck: the equivalent stiffness is that of the whole contact, whatever part of its elasticity residual modes hold."""
    found = []
    for method in ("unit_traction", bd.ResidualModes(n_vectors=2)):
        other = study.replace(contact_stiffness=method, blade_modes=4, constraint_planes=False)
        system, static = other.problem.system(2e4), other.static(2e4)
        stuck = system.structure.linear.response(
            2.0 * np.pi * 300.0, other.problem.at(2e4).stuck_springs()
        )
        u = system.layout.pack(static.q, 0.05 * stuck)
        found.append(energies(system, u, 2.0 * np.pi * 300.0)["stiffness"])
    assert found[0].imag == pytest.approx(0.0, abs=1e-9 * found[0].real)
    assert found[1].real == pytest.approx(
        found[0].real, rel=0.3
    )  # a ninth of it without the residual modes


def test_springs_of_the_bodies_are_no_contacts():
    """Damping that is not proportional stands in springs between coordinates; a cubic spring is shown, not counted."""
    K = np.array([[2.0, -1.0], [-1.0, 1.0]])
    contact = bd.Contact(0, kt=0.5, mu=1.0, preload=9.0)
    chain = bd.lumped(
        np.eye(2),
        [[0.1, 0.0], [0.0, 0.0]],
        K,
        contacts=[contact],
        forces={0: 0.1},
        cubic={(1, 0): 0.5},
    )
    found = chain.hysteresis(chain.frequency_response(0.0, (0.10, 0.11)))
    assert found.interfaces == ("contact 1", "cubic 1") and abs(found.imbalance) < 2e-9
    assert found.stiffness == pytest.approx(0.5, rel=1e-9), "stuck, at the response itself"
    x, f = found.loop("cubic 1")
    assert f == pytest.approx(0.5 * x**3, abs=1e-9 * np.abs(f).max())


def test_a_face_has_the_sum_of_its_forces(cycle):
    x, f = cycle.loop("right")
    rows = cycle.rows("right")
    assert f == pytest.approx(cycle.force[rows, 0].sum(axis=0))
    assert x[:-1].mean() == pytest.approx(0.0, abs=1e-12 * np.ptp(x))
    alone = replace(cycle, area=np.where(np.arange(len(cycle.area)) == rows[2], 1.0, 0.0))
    assert alone.loop("right")[0] == pytest.approx(cycle.loop(int(rows[2]))[0])


def test_of_an_optimal_curve(study):
    curve = study.optimal_curve((4e3, 8e3), 2, frequency=(270.0, 380.0), check=False)
    found = study.dissipation(curve)
    assert found.preload == pytest.approx(curve.preload)
    assert np.abs(found.imbalance).max() < 1e-9
    least = study.hysteresis(curve)
    assert least.amplitude == pytest.approx(np.nanmin(curve.amplitude), rel=1e-9)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (
            lambda s, c: s.hysteresis(s.model),
            "result: expected a response curve, a peak or an optimal curve of this study",
        ),
        (
            lambda s, c: s.dissipation(s.free(INTERVAL)),
            "expected a response curve .study.frequency_response., found a free curve",
        ),
        (lambda s, c: s.replace(friction_coefficient=0.3).dissipation(c), "different settings"),
        (lambda s, c: s.hysteresis(c, 10**6), "index of a point: expected"),
        (lambda s, c: s.hysteresis(c).loop("top"), "where: expected one of"),
        (
            lambda s, c: s.hysteresis(c).plot(where=["whole", "left"]),
            'where: expected contact points and faces, or only "whole"',
        ),
    ],
)
def test_what_does_not_fit_is_refused(study, curve, wrong, message):
    with pytest.raises(bd.SettingError, match=message):
        wrong(study, curve)


@pytest.mark.slow
def test_pictures(study, curve, cycle):
    found = study.dissipation(curve)
    axes = [
        *cycle.plot().axes, *cycle.plot(where=["left", "right"], direction="n").axes, *cycle.plot(where=12).axes,
        *cycle.plot_history(12).axes,
        *cycle.plot_energy().axes[:1], *found.plot().axes, *found.plot(over="frequency").axes,
    ]  # fmt: skip
    for ax in axes:
        units = (
            "(N)",
            "(mN)",
            "(mJ)",
            "(µJ)",
            "(nm)",
            "(µm)",
            "(m)",
            "(mm)",
            "(kN/m)",
            "(%)",
            "(J)",
            "(Hz)",
            "(periods)",
        )
        assert ax.get_ylabel().endswith(units), ax.get_ylabel()
        assert ax.get_xlabel().endswith(units) or not ax.get_xlabel()
    texts = [t.get_text().split(",")[0] for t in axes[1].get_legend().get_texts()]
    assert texts == ["left face", "right face"]
    plt.close("all")
