"""Excitation by an acceleration of the held nodes, against closed forms and bare matrices."""

import numpy as np
import pytest

import bdamper as bd
from bdamper.util.errors import BdamperError
from tests.each import each
from tests.printed import said

OPEN = bd.Contact(normal=0, kn=1.0, gap=1e3)
"""A contact that never closes."""


@each("absolute", [False, True])
def test_one_mass_on_a_shaken_ground(absolute):
    """Closed form: relative -a / (w0^2 - w^2 + 2 i zeta w0 w), absolute relative - a / w^2."""
    mass, damping, stiffness, a = 2.0, 0.3, 50.0, 1.7
    study = bd.lumped(
        mass, damping, stiffness, contacts=[OPEN], base=a, absolute=absolute, harmonics=3
    )
    curve = study.frequency_response(0.0, (0.5, 1.2))
    omega = 2.0 * np.pi * curve.frequency
    relative = -mass * a / (stiffness - mass * omega**2 + 1j * damping * omega)
    space = relative - a / omega**2
    expected = space if absolute else relative
    np.testing.assert_allclose(curve.amplitude, np.abs(expected), rtol=1e-6)
    np.testing.assert_allclose(study.response_at(curve, "x0")[:, 1], relative, rtol=1e-6)
    if absolute:
        found = study.response_at(curve, "x0", absolute=True)[:, 1]
        np.testing.assert_allclose(found, space, rtol=1e-6)
    # the ground rests in a nonlinear mode
    mode = study.nonlinear_mode(0.0, 1, (1e-4, 1e-2))
    natural = np.sqrt(stiffness / mass) / (2.0 * np.pi)
    np.testing.assert_allclose(mode.frequency, natural, rtol=1e-9)


def test_several_masses_move_with_the_ground_in_their_own_ratio():
    """A combination of two coordinates on bare matrices; the second moves by half of the ground."""
    M = np.array([[2.0, 0.1], [0.1, 1.0]])
    K = np.array([[80.0, -30.0], [-30.0, 30.0]])
    C = np.array([[0.3, -0.1], [-0.1, 0.2]])
    ratio, row = np.array([1.0, 0.5]), np.array([1.0, -0.3])
    response = {0: 1.0, 1: -0.3}
    for absolute in (False, True):
        study = bd.lumped(
            M, C, K, contacts=[OPEN], base={0: 2.0j, 1: 1.0j}, response=response, absolute=absolute
        )
        curve = study.frequency_response(0.0, (0.4, 0.9))
        expected = []
        for omega in 2.0 * np.pi * curve.frequency:
            dynamic = K - omega**2 * M + 1j * omega * C
            motion = np.linalg.solve(dynamic, -M @ ratio * 2.0j)
            expected.append(row @ (motion - absolute * ratio * 2.0j / omega**2))
        found = study.response_at(curve, "response", absolute=absolute)[:, 1]
        np.testing.assert_allclose(found, expected, rtol=1e-6)


def test_friction_on_a_shaken_ground():
    """A Jenkins element sees the relative motion: the peak is that under the force -m a."""
    settings = {"contacts": [bd.Contact(0, kt=1.0, mu=1.0, preload=1.0)], "harmonics": 7}
    shaken = bd.lumped(1.0, 0.02, 1.0, base=-1.0, **settings).peak(0.0, (0.1, 0.3))
    forced = bd.lumped(1.0, 0.02, 1.0, forces={0: 1.0}, **settings).peak(0.0, (0.1, 0.3))
    assert shaken.amplitude == pytest.approx(forced.amplitude, rel=1e-9)


def test_what_a_base_excitation_lacks_is_named():
    contacts = [OPEN]
    with pytest.raises(BdamperError, match="expected forces or an acceleration of the base, found"):
        bd.lumped(1.0, 0.1, 1.0, contacts=contacts)
    with pytest.raises(BdamperError, match="absolute: expected base= for True"):
        bd.lumped(1.0, 0.1, 1.0, contacts=contacts, forces={0: 1.0}, absolute=True)
    forced = bd.lumped(1.0, 0.1, 1.0, contacts=contacts, forces={0: 1.0})
    with pytest.raises(BdamperError, match="expected an excitation at the base"):
        forced.replace(response=bd.Response("x0", absolute=True))
    study = bd.lumped(1.0, 0.1, 1.0, contacts=contacts, base=2.0)
    assert "2 m/s2 at base" in str(study)
    peak = study.peak(0.0, (0.1, 0.3))
    with pytest.raises(BdamperError, match="expected a study whose response is absolute"):
        study.response_at(peak, "x0", absolute=True)
    absolute = study.replace(response=bd.Response("x0", absolute=True))
    with pytest.raises(BdamperError, match="expected a response relative to the base"):
        absolute.time_response(absolute.peak(0.0, (0.1, 0.3)))


class TestImported:
    """A block of finite elements, held at one end."""

    @pytest.fixture(scope="class")
    @classmethod
    def block(cls):
        pytest.importorskip("skfem", reason="scikit-fem is not installed (extra bdamper[fe])")
        from bdamper.fem.meshes import (
            ElasticMaterial,
            Geometry,
            MeshDensity,
            damper_mesh,
            discretise,
            local_order,
        )

        density = MeshDensity(2, 2, 1, 4, 2, 2, 1, 6, 2, 1, 1, 2)
        body = discretise(damper_mesh(Geometry(), density), ElasticMaterial())
        z = body.nodes[:, 2]
        sets = {
            "end": np.flatnonzero(z > z.max() - 1e-9),
            "face": np.flatnonzero(z < z.min() + 1e-9),
        }
        return body, body.elements[:, local_order()], sets

    @staticmethod
    def built(block, **other):
        from bdamper.importers import ContactFaces, read_arrays
        from tests.imports import build

        body, elements, sets = block
        arrays = read_arrays(body.stiffness, body.mass, body.nodes, elements=elements, sets=sets)
        pad = ContactFaces("pad", "face", None, "blade", "ground", points=(2, 2), gap=1e-4)
        tip = body.nodes[np.argmin(body.nodes[:, 2])]
        settings = {"n_blades": 1, "fixed": "end", "contacts": [pad], "n_modes": 4}
        settings |= {"base": True, "locations": {"tip": tip}} | other
        return build(arrays, **settings).model

    @each("direction", [(1.0, 0.0, 0.0), (0.0, 0.6, 0.8)])
    def test_held_nodes_are_accelerated(self, block, direction):
        """The bare matrices with the displacement -a / w^2 of the held nodes prescribed."""
        body, _, sets = block
        model = self.built(block)
        settings = {"response": bd.Response("tip", direction, absolute=True), "harmonics": 1}
        settings |= {"blade_modes": 4, "damping_ratio": 1e-7, "contact_stiffness": 1e6}
        excitation = bd.Excitation("base", direction, 3.0)
        study = bd.Study(model, excitation, **settings)
        assert "3 m/s2 at base" in str(study)
        first = np.sqrt(model.bodies["blade"].bases[0].omega2[0]) / (2.0 * np.pi)
        curve = study.frequency_response(0.0, (0.3 * first, 0.7 * first))
        K, M = body.stiffness.tocsr(), body.mass.tocsr()
        held = (3 * sets["end"][:, None] + np.arange(3)).ravel()
        others = np.setdiff1d(np.arange(body.n_dof), held)
        tip = 3 * int(np.argmin(body.nodes[:, 2])) + np.arange(3)
        along = np.array(direction)
        for i in (0, len(curve) // 2, -1):
            omega = 2.0 * np.pi * curve.frequency[i]
            motion = np.tile(-3.0 / omega**2 * along, len(body.nodes))
            dynamic = (K - omega**2 * M)[others]
            load = -dynamic[:, held] @ motion[held]
            motion[others] = np.linalg.solve(dynamic[:, others].toarray(), load)
            assert curve.amplitude[i] == pytest.approx(abs(along @ motion[tip]), rel=1e-5)
            relative = study.response_at(curve, "tip", direction)[i, 1]
            expected = along @ motion[tip] + 3.0 / omega**2
            assert relative == pytest.approx(expected, rel=2e-3)

    def test_what_an_import_lacks_is_named(self, block):
        with pytest.raises(BdamperError, match="excitation location: expected one of"):
            bd.Study(self.built(block, base=False), bd.Excitation("base"))
        with pytest.raises(BdamperError, match="base: expected no other location"):
            self.built(block, locations={"base": block[0].nodes[0]})


def test_the_base_carries_a_free_damper():
    """The unit motion of the base is that of the rigid-body modes, whose inertia forces it has."""
    from bdamper.model.kinematics import inertia_of_free_body, standard_rigid_modes

    model = bd.reference_model("turbine_blade")
    damper = next(body for body in model.bodies.values() if body.kind == "free")
    body = standard_rigid_modes(model, damper)
    inertia = inertia_of_free_body(body)
    face = model.interfaces[body.ports[0][0]]
    # a translation of the base by 1 m moves the contact points by the axes of their frames
    moved = body.bases[0].contact_modes[: face.n_points] @ -inertia.T
    np.testing.assert_allclose(moved.real, face.frame, atol=1e-9)
    np.testing.assert_allclose(inertia @ inertia.T, body.mass * np.eye(3), rtol=1e-12, atol=1e-15)


# ---- Measured accelerations of the base ----


def shaken(stiffness=50.0, damping=0.3, absolute=False):
    """One mass on the ground, whose contact never closes."""
    return bd.lumped(2.0, damping, stiffness, contacts=[OPEN], base=1.0, absolute=absolute)


def closed_form(omega, absolute):
    relative = -2.0 / (52.0 - 2.0 * omega**2 + 0.36j * omega)
    return relative - absolute / omega**2


@pytest.mark.slow
@each("absolute", [False, True])
@each("control", ["force", "response", "phase"])
def test_a_measured_base_acceleration_is_fitted(tmp_path, control, absolute):
    """An accelerometer on the mass, while the acceleration of the base changes over the sweep."""
    frequency = np.linspace(0.6, 1.0, 21)
    omega = 2.0 * np.pi * frequency
    base = 0.5 + frequency
    motion = base * closed_form(omega, absolute)
    acceleration = -(omega**2) * motion
    path = tmp_path / "shaker.csv"
    columns = frequency, np.abs(acceleration), np.angle(acceleration, deg=True), base / 9.80665
    header = "frequency (Hz),acceleration (m/s^2),phase (deg),base acceleration (g)"
    np.savetxt(path, np.array(columns).T, delimiter=",", header=header, comments="", fmt="%.15g")
    data = bd.importers.read_response(path)
    np.testing.assert_allclose(data.base_acceleration, base, rtol=1e-12)
    ranges = {"stiffness": (40.0, 70.0), "damping": (0.1, 1.0)}

    def study(stiffness=50.0, damping=0.3):
        return shaken(stiffness, damping, absolute)

    test = bd.MeasuredResponse(data, control=control)
    found = bd.fit(study, test, ranges, noise=0.01, intervals="linear")

    assert found.values == pytest.approx([52.0, 0.36], rel=1e-3)


def test_phase_control_without_phases_is_at_the_phase_resonance():
    """The relative motion is then 90 degrees ahead of the base: at w0, with a / (2 zeta w0^2)."""
    natural = np.sqrt(52.0 / 2.0)
    amplitude = np.array([0.1, 0.2])
    base = amplitude * 0.36 * natural / 2.0
    data = bd.importers.Measurement(
        "pll", np.full(2, natural / (2.0 * np.pi)), amplitude + 0j, base_acceleration=base
    )
    ranges = {"stiffness": (40.0, 70.0), "damping": (0.1, 1.0)}
    test = bd.MeasuredResponse(data, control="phase")
    found = bd.fit(shaken, test, ranges, noise=0.01, intervals="linear")

    assert found.values == pytest.approx([52.0, 0.36], rel=1e-3)


def test_another_excitation_than_that_of_the_study_is_named():
    frequency = np.linspace(0.6, 1.0, 5)
    response = np.ones(5) + 0j
    data = bd.importers.Measurement("rig", frequency, response, force=np.ones(5))
    with pytest.raises(
        BdamperError, match=r"rig: expected the excitation .* in m/s2, found forces"
    ):
        bd.fit(shaken, bd.MeasuredResponse(data), {"stiffness": (40.0, 70.0)})
    with pytest.raises(BdamperError, match="give either force or base_acceleration, not both"):
        bd.importers.Measurement(
            "rig", frequency, response, force=np.ones(5), base_acceleration=np.ones(5)
        )


@pytest.mark.parametrize("measured", ["force", "base_acceleration"])
def test_a_nominal_amplitude_of_the_other_kind_is_refused(measured):
    nominal = "base_acceleration" if measured == "force" else "force"
    frequency = np.array([1.0, 2.0, 3.0])
    data = bd.importers.Measurement("rig", frequency, np.ones(3, complex), **{measured: np.ones(3)})
    assert bd.MeasuredResponse(data, **{measured: 2.0}).data is data
    with pytest.raises(bd.SettingError, match="cannot replace the other excitation"):
        bd.MeasuredResponse(data, **{nominal: 2.0})


@pytest.mark.slow
def test_a_printed_optimum_names_the_acceleration():
    """An acceleration of 1 m/s2 is no newton, so preloads do not scale with it."""
    contact = bd.Contact(0, 1, kt=1.0, kn=1.0, mu=0.5)
    study = bd.lumped([1.0, 1.0], [0.02, 0.02], [[2.0, -1.0], [-1.0, 2.0]], contacts=[contact],
                      load_per_preload={1: 1.0}, base=1.0, response=0, harmonics=1)  # fmt: skip
    curve = study.optimal_curve((0.2, 60.0), 5, frequency=(0.1, 0.4), check=False)
    words = said(curve)
    assert "1 m/s² of base acceleration" in words
    assert "newton of excitation" not in words and "1 N of excitation" not in words
