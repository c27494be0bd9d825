"""The blade on the ground and the test rig: against the sector they are made of, and the shipped files."""

import numpy as np
import pytest

from tests.plain import plain_study

pytest.importorskip("skfem", reason="scikit-fem is not installed (extra bdamper[fe])")

import bdamper as bd
from bdamper.fem import blade_to_ground
from bdamper.fem.meshes import Geometry, MeshDensity, sector_mesh
from bdamper.model.validation import check_model
from tools.rig import rig, rig_mesh


@pytest.fixture(scope="module")
def small_rig():
    return rig(6, mesh="coarse", n_modes=12)


@pytest.fixture(scope="module")
def small_blade():
    return blade_to_ground(6, mesh="coarse", n_modes=12)


def test_rig_is_three_sectors_less_two_airfoils():
    g, n = Geometry(), MeshDensity.preset("coarse")
    whole, one = rig_mesh(g, n), sector_mesh(g, n)
    airfoil = n.centre * n.chord * n.airfoil
    assert whole.t.shape[1] == 3 * one.t.shape[1] - 2 * airfoil
    # the disk segments share their cut faces: a node less for each shared one
    assert whole.p.shape[1] < 3 * one.p.shape[1]


@pytest.mark.slow
def test_models_pass_the_checks(small_rig, small_blade):
    for model in (small_rig, small_blade):
        check_model(model)
        assert model.n_blades == 1


@pytest.mark.slow
def test_blade_frequencies_are_close_to_those_of_the_disk(small_rig, small_blade):
    """A stiff foundation raises the first bending mode by less than 2 %."""
    disk = bd.reference_model(contact_points=9).bodies["blade"].bases[5].omega2[0]
    for model, body in ((small_blade, "blade"), (small_rig, "blades")):
        assert 1.0 < np.sqrt(model.bodies[body].bases[0].omega2[0] / disk) < 1.02


def test_a_rigid_translation_is_the_same_in_body_and_contact_axes(small_rig):
    """Static equilibrium of each damper: normal and friction forces carry the load along its direction."""
    study = plain_study(
        small_rig, friction_coefficient=0.4, excitation=bd.Excitation("tip"), blade_modes=10
    )
    state = study.static(100.0)
    assert state.ok
    for side in ("left", "right"):
        total = np.zeros(3)
        for name in (f"{side}_inner", f"{side}_outer"):
            rows, face = study.problem.coupling.rows(name), small_rig.interfaces[name]
            # (T1, T2) act against u_b - u_a, hence along it on body a; N pushes against the outward normal of a
            force = state.force[rows] * [1.0, 1.0, -1.0]
            total += np.einsum("pij,pi->j", face.frame, force)
        load = 100.0 * small_rig.bodies[f"damper_{side}"].load.direction
        assert total == pytest.approx(-load, abs=1e-6)


def test_normal_of_the_blade_points_to_the_ground(small_blade):
    face = small_blade.interfaces["platform"]
    assert face.body_a == "blade" and face.body_b == "ground"
    normal = face.frame[0, 2]
    # the underside of the right wing of the platform: outward is down and away from the blade
    assert normal[0] > 0.4 and normal[1] < -0.4 and abs(normal[2]) < 1e-12
    assert np.linalg.det(face.frame[0]) == pytest.approx(1.0)


def test_flexibility_of_the_ground_contact_is_that_of_the_modes_and_more(small_blade):
    basis = small_blade.bodies["blade"].bases[0]
    modes = basis.contact_modes.reshape(-1, basis.n_modes)
    rest = basis.flexibility - (modes / basis.omega2) @ modes.T
    values = np.linalg.eigvalsh(rest)
    assert values.min() > -1e-8 * values.max() and values.max() > 0.0


@pytest.mark.parametrize("name", ["blade_to_ground", "test_rig"])
def test_shipped_models(name):
    model = bd.reference_model(name)
    assert model.n_blades == 1
    mesh = next(iter(model.meshes.values()))
    assert mesh.modes[0].shape == (len(mesh.points), 3, 10)
    # the shapes on the mesh are the modes of the body: the same at the tip
    body = next(iter(model.bodies))
    tip = np.argmin(np.linalg.norm(mesh.points - model.locations["tip"].position, axis=1))
    assert mesh.modes[0][tip] == pytest.approx(
        model.bodies[body].bases[0].locations["tip"][:, :10], rel=1e-5, abs=1e-5
    )
    with pytest.raises(bd.SettingError, match="expected one of"):
        bd.reference_model(name, contact_points=9)


def test_shipped_data_stay_small():
    """The wheel must not exceed 8 MB."""
    from importlib import resources

    total = sum(
        f.stat().st_size
        for f in (resources.files("bdamper") / "data").iterdir()
        if f.name.endswith(".h5")
    )
    assert total < 7.8e6
