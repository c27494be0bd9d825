"""A sector from another program at two rotor speeds: matrices, and modes alone."""

import re
import warnings
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("skfem", reason="scikit-fem is not installed (extra bdamper[fe])")

from bdamper.fem.generated_models import SectorFE
from bdamper.fem.meshes import Geometry, MeshDensity
from bdamper.fem.rotation import Rotation, spin_softening
from bdamper.importers import Modes, Placement, over_speed
from bdamper.importers.bodies import distance_from_chord, rotation_of
from bdamper.importers.prepared_body import PreparedBody
from bdamper.model.modal_basis import ModalBasis
from bdamper.util.errors import BdamperWarning, ModelError, SettingError
from tests.fe_bodies import contacts
from tests.imports import build
from tests.printed import said

ND, TOP, BETWEEN, COUNT = 5, 600.0, 450.0, 12
SETTINGS = {
    "n_blades": 65, "nodal_diameters": (0, ND), "n_modes": COUNT, "n_damper_modes": 6,
    "faces": ("LOW", "HIGH"), "contacts": contacts(2),
}  # fmt: skip


@pytest.fixture(scope="module")
def fe():
    return SectorFE(Geometry(), MeshDensity(2, 1, 1, 2, 2, 1, 1, 3, 2, 1, 1, 2))


@pytest.fixture(scope="module")
def rotation(fe):
    return fe.rotation()


def at(blade, rotation, omega):
    return replace(blade, stiffness=blade.stiffness + omega**2 * rotation.per_squared_speed)


def frequencies(fe, rotation, omega, d, n):
    return np.sqrt(rotation.at_speed(fe.cyclic(d), omega).modes(n)[0])


@pytest.mark.slow
def test_matrices_at_two_speeds(fe, bodies, rotation):
    blade, damper = bodies
    given = over_speed({TOP: at(blade, rotation, TOP), 0.0: blade})
    built = build(given, damper, fixed="BORE", **SETTINGS)
    body = built.model.at_speed(BETWEEN).bodies["blade"]
    for d in (0, ND):
        found = np.sqrt(np.sort(body.bases[d].omega2)[:6])
        assert found == pytest.approx(frequencies(fe, rotation, BETWEEN, d, 6), rel=1e-4)
    assert built.model.bodies["blade"].bases[ND].speed.checked_at == TOP
    assert body.spin.theory == "linear" and np.abs(body.spin.contact).max() > 0.0
    assert "second speed: 600 rad/s" in said(built.summary()) and "spin softening 100 %" in said(
        built.summary()
    )
    free = np.repeat(~np.isin(blade.numbers, blade.node_sets["BORE"]), 3)
    dofs = np.column_stack((np.repeat(blade.numbers, 3), np.tile((1, 2, 3), len(blade.numbers))))[
        free
    ]
    without = [
        replace(b, dofs=dofs, stiffness=b.stiffness[free][:, free], mass=b.mass[free][:, free])
        for b in (blade, at(blade, rotation, TOP))
    ]
    left = build(over_speed({0.0: without[0], TOP: without[1]}), damper, **SETTINGS)
    assert "spin softening 100 %" in left.summary(), (
        "of matrices without the components that are held"
    )
    assert not built.model.neglected_over_speed()


@pytest.mark.slow
def test_matrices_of_a_speed_above_standstill_give_the_same_model(bodies, rotation):
    blade, damper = bodies
    low = build(
        over_speed({0.0: blade, TOP: at(blade, rotation, TOP)}), damper, fixed="BORE", **SETTINGS
    )
    running = over_speed({300.0: at(blade, rotation, 300.0), TOP: at(blade, rotation, TOP)})
    high = build(running, damper, fixed="BORE", **SETTINGS)
    a, b = (
        np.sort(m.model.at_speed(TOP).bodies["blade"].bases[ND].omega2)[:6] for m in (low, high)
    )
    np.testing.assert_allclose(a, b, rtol=2e-4)
    assert high.model.bodies["blade"].spin.theory == "stiffened"


@pytest.mark.slow
def test_a_stiffness_without_spin_softening_is_noticed(fe, bodies, rotation):
    blade, damper = bodies
    stiff = Rotation(rotation.per_squared_speed + spin_softening(fe.blade))
    built = build(
        over_speed({0.0: blade, TOP: at(blade, stiff, TOP)}), damper, fixed="BORE", **SETTINGS
    )
    assert "spin softening of the blade: the stiffness at 600 rad/s contains" in said(
        built.summary()
    )


def modes_at(fe, rotation, omega, numbers, count=COUNT, turned=0.0):
    out = []
    for d in (0, ND):
        omega2, shapes = rotation.at_speed(fe.cyclic(d), omega).modes(count)
        shapes = shapes.reshape(-1, 3, count) * (np.exp(1j * turned) if d else 1.0)
        out.append(
            Modes(
                d,
                np.sqrt(omega2) / (2 * np.pi),
                numbers,
                shapes,
                np.ones(count),
                f"{omega:g}.modes",
            )
        )
    return tuple(out)


def modal_body(fe, rotation, blade, omega, **options):
    return replace(
        blade,
        stiffness=None,
        mass=None,
        modes=modes_at(fe, rotation, omega, blade.numbers, **options),
    )


@pytest.mark.slow
def test_modes_alone_at_two_speeds(fe, bodies, rotation):
    blade, damper = bodies
    given = over_speed({
        0.0: modal_body(fe, rotation, blade, 0.0),
        TOP: modal_body(fe, rotation, blade, TOP, turned=1.1),
    })  # fmt: skip
    built = build(given, damper, **SETTINGS)
    basis = built.model.bodies["blade"].bases[ND]
    found = np.sqrt(np.sort(built.model.at_speed(BETWEEN).bodies["blade"].bases[ND].omega2)[:6])
    exact = frequencies(fe, rotation, BETWEEN, ND, 6)
    assert found == pytest.approx(exact, rel=1e-4)
    straight = np.sqrt(basis.omega2[:6])
    assert np.abs(straight / exact - 1.0).max() > 0.02
    assert "overlap of the modes at the two speeds at least 0.99" in said(built.summary())


@pytest.mark.slow
def test_modes_that_are_no_combinations_of_the_first_are_refused(fe, bodies, rotation):
    blade, damper = bodies
    first, other = (
        modal_body(fe, rotation, blade, 0.0),
        modal_body(fe, rotation, blade, TOP, count=COUNT + 1),
    )
    cut = [
        Modes(m.nodal_diameter, m.frequency[1:], m.numbers, m.shapes[..., 1:], m.modal_mass[1:])
        for m in other.modes
    ]
    with pytest.raises(
        ModelError, match="nodal diameter 0 at 600 rad/s: expected combinations of the modes"
    ):
        build(over_speed({0.0: first, TOP: replace(other, modes=tuple(cut))}), damper, **SETTINGS)


@pytest.mark.slow
def test_the_flexibility_at_the_second_speed_is_that_of_its_matrices(bodies, rotation):
    """Against an import of the matrices of this speed alone; the derivative at standstill is 5e-4 off."""
    blade, damper = bodies
    running = at(blade, rotation, TOP)
    built = build(over_speed({0.0: blade, TOP: running}), damper, fixed="BORE", **SETTINGS)
    alone = build(running, damper, fixed="BORE", **SETTINGS)
    basis = built.model.bodies["blade"].bases[ND]
    exact = alone.model.bodies["blade"].bases[ND].flexibility
    found = basis.at_speed(TOP)[0].flexibility
    np.testing.assert_allclose(found, exact, rtol=0.0, atol=1e-8 * np.abs(exact).max())
    assert basis.speed.flexibility_error < 1e-8
    assert f"flexibilities at nodal diameter {ND}, 0 and 600 rad/s are those" in said(
        built.summary()
    )
    for omega in (0.0, 200.0, 450.0, TOP):
        residual = basis.speed.residual(omega)
        size = np.sqrt(np.diag(residual).real)
        assert np.linalg.eigvalsh(residual / size / size[:, None])[0] > -1e-7, omega


@pytest.mark.slow
def test_matrices_at_three_speeds_make_the_stiffness_quadratic(fe, bodies, rotation):
    """At a speed of 0.75 of the highest one, half of the geometric stiffness is missing."""
    blade, damper = bodies
    geometric = rotation.per_squared_speed + spin_softening(fe.blade)
    middle_body = at(blade, rotation, BETWEEN)
    half = replace(middle_body, stiffness=middle_body.stiffness - 0.5 * BETWEEN**2 * geometric)
    given = over_speed({BETWEEN: half, 0.0: blade, TOP: at(blade, rotation, TOP)})
    assert given.between.rotor_speed == BETWEEN and given.faster.rotor_speed == TOP
    built = build(given, damper, fixed="BORE", **SETTINGS)
    assert "a third rotor speed" not in said(built.summary())
    basis = built.model.bodies["blade"].bases[ND]
    assert basis.speed.error < 1e-6 and basis.speed.flexibility_error < 1e-8
    # the parabola that is 0 at the first and the last speed, and half of the stiffness between
    x, middle, top = 300.0**2, BETWEEN**2, TOP**2
    missing = 0.5 * middle * x * (x - top) / (middle * (middle - top))
    bent = Rotation(rotation.per_squared_speed - missing / x * geometric)
    exact = frequencies(fe, bent, 300.0, ND, 6)
    found = np.sqrt(np.sort(basis.at_speed(300.0)[0].omega2)[:6])
    assert found == pytest.approx(exact, rel=1e-4)
    straight = frequencies(fe, rotation, 300.0, ND, 6)
    assert np.abs(straight / exact - 1.0).max() > 1e-3
    # between the speeds the residual flexibility is a mean of two
    first, last = (basis.speed.residual(omega) for omega in (BETWEEN, TOP))
    share = (500.0**2 - middle) / (top - middle)
    mean = (1.0 - share) * first + share * last
    np.testing.assert_allclose(basis.speed.residual(500.0), mean, atol=1e-12 * np.abs(mean).max())


def test_the_distance_of_a_squared_frequency_from_its_chord():
    """Two frequencies that cross: the lowest one is min(1 + 4 x, 2) with x = (speed/10)^2, its chord 1 + x."""
    basis = ModalBasis(
        omega2=np.array([1.0, 2.0]), damping_ratio=np.zeros(2), contact_modes=np.zeros((1, 3, 2))
    ).with_speed(np.diag([0.04, 0.0]))
    assert distance_from_chord(basis, 0.0, 10.0) == pytest.approx(2.0 / 1.25 - 1.0)


@pytest.mark.slow
def test_modes_at_a_third_speed_are_compared(fe, bodies, rotation):
    blade, damper = bodies
    first, middle, last = (modal_body(fe, rotation, blade, omega) for omega in (0.0, BETWEEN, TOP))
    built = build(over_speed({0.0: first, BETWEEN: middle, TOP: last}), damper, **SETTINGS)
    found = re.search(
        rf"nodal diameter {ND} at 450 rad/s, .* agree within ([\d.e-]+) %", said(built.summary())
    )
    assert float(found[1]) < 0.01


def rotation_from(bodies):
    """The change of stiffness with speed of a body at several speeds, without modes."""
    return rotation_of(PreparedBody("blade", over_speed(bodies), Placement()))


@pytest.mark.slow
def test_the_spin_softening_shows_matrices_of_other_speeds(bodies, rotation):
    """A stiffness K + omega^2 K' has all of the softening at its own speeds, and (true/said)^2 of it at others."""
    blade, _ = bodies
    at_speeds = {omega: at(blade, rotation, omega) for omega in (300.0, BETWEEN, TOP)}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = rotation_from({0.0: blade, BETWEEN: at_speeds[BETWEEN], TOP: at_speeds[TOP]})
        rotation_from({300.0: at_speeds[300.0], TOP: at_speeds[TOP]})
    difference = found.per_squared_speed - rotation.per_squared_speed
    assert abs(difference).max() < 1e-6 * abs(rotation.per_squared_speed).max()

    words = "expected all of the spin softening of the mass, or none, found"
    exchanged = f"at 600 rad/s: {words} -100 %; possibly the matrices of both speeds are exchanged"
    with pytest.raises(ModelError, match=exchanged):
        rotation_from({0.0: at_speeds[TOP], TOP: blade})
    in_rpm = TOP * 30.0 / np.pi
    with pytest.warns(BdamperWarning, match=f"{words} 1.1 %; possibly the speeds are in revol"):
        rotation_from({0.0: blade, in_rpm: at_speeds[TOP]})
    # 25 % up to the highest speed, 400 % up to the third one
    with (
        pytest.warns(BdamperWarning, match=f"at 1200 rad/s: {words} 25 %; .* belong to 600 rad/s"),
        pytest.raises(ModelError, match=f"at 600 rad/s: {words} 400 %; .* belong to 1200 rad/s"),
    ):
        rotation_from({0.0: blade, TOP: at(blade, rotation, 2.0 * TOP), 2.0 * TOP: at_speeds[TOP]})
    # (600^2 - 300^2)/(1200^2 - 300^2)
    with pytest.warns(BdamperWarning, match=f"{words} 20 %; .* belong to 600 rad/s"):
        rotation_from({300.0: at_speeds[300.0], 2.0 * TOP: at_speeds[TOP]})


@pytest.mark.slow
def test_modes_of_exchanged_speeds_are_named(fe, bodies, rotation):
    """Frequencies fall by more than spin softening explains, or by another part of their change."""
    blade, damper = bodies
    low_speeds = (0.0, 115.0, 133.0)
    first, middle, last = (modal_body(fe, rotation, blade, omega) for omega in low_speeds)
    falls = "squared frequencies that decrease from 0 rad/s by at most the spin softening"
    with pytest.warns(BdamperWarning, match=falls):
        build(over_speed({0.0: last, 133.0: first}), damper, **SETTINGS)
    # (115^2 - 100^2)/133^2
    part = "within 10 % of their change up to the highest speed, found 18.2 %"
    with pytest.warns(BdamperWarning, match=part):
        build(over_speed({0.0: first, 100.0: middle, 133.0: last}), damper, **SETTINGS)


@pytest.mark.slow
def test_speeds_that_do_not_fit_together_are_refused(fe, bodies, rotation):
    blade, _ = bodies
    with pytest.raises(SettingError, match="two or three rotor speeds"):
        over_speed({0.0: blade})
    with pytest.raises(SettingError, match=r"rotor speed: .*rad/s"):
        over_speed({0.0: blade, -1.0: blade})
    with pytest.raises(SettingError, match="matrices at all speeds, or modes at all speeds"):
        over_speed({0.0: blade, TOP: modal_body(fe, rotation, blade, TOP)})
    with pytest.raises(ModelError, match="expected the nodes of"):
        over_speed({0.0: blade, TOP: replace(blade, numbers=blade.numbers + 1)})
