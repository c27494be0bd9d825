"""Stress from the rows of a model against the full finite element solution."""

from __future__ import annotations

import functools
import shutil
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("skfem", reason="scikit-fem is not installed (extra bdamper[fe])")

from scipy.sparse.linalg import splu

import bdamper as bd
from bdamper.fatigue.stress_cycle import _contact_axes, _Rows
from bdamper.fem.element_stress import element_rows, near_patches, node_average, von_mises_size
from bdamper.fem.generated_models import (
    SectorFE,
    blade_points,
    bladed_disk,
    solids_of,
    wedge_patches,
)
from bdamper.fem.meshes import ElasticMaterial, discretise, join_blocks
from tests.calculix_runs import centrifugal_stress

PRELOAD = 20e3


@pytest.fixture(scope="module")
def fe():
    return SectorFE()


@pytest.fixture(scope="module")
def model(fe):
    return bladed_disk(9, fe=fe, nodal_diameters=(5,), n_modes=20, stress=True)


@pytest.fixture(scope="module")
def rows(fe):
    nodes = blade_points(fe.blade, fe.geometry)
    pairs, owner = element_rows(solids_of(fe.blade), fe.blade.nodes, nodes)
    return node_average(owner, len(nodes)) @ pairs


def study_of(model, **settings):
    given = {
        "engine_order": 5,
        "harmonics": 1,
        "blade_modes": 10,
        "damper_modes": 4,
        "friction_coefficient": 0.4,
    }
    return bd.Study(model, bd.Excitation("tip", "tangential", 1.0), **given | settings)


def with_modes(model, n):
    """The model with fewer modes of the blade; what the others carried goes to the contact vectors."""
    blade, stress = model.bodies["blade"], model.stress["blade"]
    bases, modes, contact = {}, {}, {}
    for d, b in blade.bases.items():
        shapes = b.contact_modes.reshape(-1, b.n_modes)
        bases[d] = replace(
            b, omega2=b.omega2[:n], damping_ratio=b.damping_ratio[:n], contact_modes=b.contact_modes[..., :n],
            locations={name: shape[:, :n] for name, shape in b.locations.items()},
        )  # fmt: skip
        modes[d] = stress.modes[d][..., :n]
        contact[d] = (
            stress.contact[d] + (stress.modes[d][..., n:] / b.omega2[n:]) @ shapes[:, n:].conj().T
        )
    stress = replace(stress, modes=modes, contact=contact)
    return replace(
        model,
        bodies=model.bodies | {"blade": replace(blade, bases=bases)},
        stress={"blade": stress},
        meshes={},
    )


def full_response(fe, model, study, peak):
    """(3 n_nodes,) complex: the whole finite element model under the contact forces of a peak and the excitation."""
    system = study.problem.system(PRELOAD)
    force = system.contact(peak.y[:-1])[1]
    axes = _contact_axes(study.problem, PRELOAD)
    at_points = np.einsum("pdk,pd->k", axes, force[..., 1] - 1j * force[..., 2])
    ports = _Rows.make(study.problem, study.problem.coupling.model.stress["blade"], 1).port_forces(
        at_points
    )
    left, right = (wedge_patches(fe.geometry, side, 9) for side in ("left", "right"))
    load = fe.blade_contact(left, right).T @ ports
    load[3 * fe.blade.nearest_node(model.locations["tip"].position)] += 1.0
    sector, w = fe.cyclic(5), peak.y[-1]
    T = sector.transformation
    out = T @ splu((sector.stiffness - w**2 * sector.mass).tocsc()).solve(T.conj().T @ load)
    omega2, shapes = sector.modes(20)  # damping of the modes
    damped = 1.0 / (omega2 - w**2 + 2j * 0.002 * np.sqrt(omega2) * w) - 1.0 / (omega2 - w**2)
    return out + shapes @ (damped * (shapes.conj().T @ load))


@pytest.mark.slow
@pytest.mark.parametrize(("stored", "allowed"), [(10, 4e-3), (16, 1.5e-3), (20, 1e-3)])
def test_stuck_stress_is_that_of_the_whole_finite_element_model(fe, model, rows, stored, allowed):
    """A study with ten modes: at most 0.31 % off if the model has no more, 0.11 % if it has sixteen, 0.06 with twenty."""
    own = with_modes(model, stored) if stored < 20 else model
    study = study_of(own, friction_law="bonded", constraint_planes=False)
    peak = study.peak(PRELOAD)
    true = (rows @ full_response(fe, own, study, peak)).reshape(-1, 6)
    found = study.stress(peak).coefficients[..., 1]
    error = np.linalg.norm(found - true, axis=1) / np.linalg.norm(true, axis=1)
    assert error.max() < allowed
    q = study.problem.system(PRELOAD).layout.amplitudes(peak.y[:-1], 1)[:10]
    bare = np.linalg.norm(
        own.stress["blade"].modes[5][..., :10] @ q - true, axis=1
    ) / np.linalg.norm(true, axis=1)
    assert bare[0] > 0.03 and bare[4] > 0.5  # airfoil above the root, shank


@pytest.mark.slow
def test_stress_of_one_mode_by_hand_and_of_the_excitation_on_the_others(model):
    study = study_of(model)
    bare = replace(model.stress["blade"], contact={}, static=None)
    blade = _Rows.make(study.problem, bare, 1)
    nothing = np.zeros(3 * study.problem.coupling.n_points)
    q = {k: (0.3 - 0.2j) * (k == 2) for k in range(20)}
    np.testing.assert_allclose(
        blade.stress(q, nothing, 1800.0), bare.modes[5][..., 2] * (0.3 - 0.2j), rtol=1e-12
    )
    basis, w = model.bodies["blade"].bases[5], 1800.0
    pull = basis.locations["tip"][0].conj() / (
        basis.omega2 - w**2 + 2j * basis.damping_ratio * np.sqrt(basis.omega2) * w
    )
    np.testing.assert_allclose(blade.stress({}, nothing, w), bare.modes[5] @ pull, rtol=1e-9)


@pytest.mark.slow
def test_a_set_without_contact_vectors_and_centrifugal_stress_says_so(model):
    study = study_of(model)
    peak = study.peak(PRELOAD)
    bare = study.replace(
        model=replace(
            model, stress={"blade": replace(model.stress["blade"], contact={}, static=None)}
        )
    )
    own, peak = peak, replace(peak, model_hash=bare.model.hash)
    notes = bare.stress(peak).notes
    assert any("contact forces" in note for note in notes) and any(
        "centrifugal" in note for note in notes
    )
    assert not [note for note in study.stress(own).notes if "has no" in note]


@pytest.mark.slow
def test_a_gauge_reads_the_tensor_along_its_direction(model):
    study = study_of(model)
    curve = study.frequency_response(500.0, (300.0, 301.0))
    some = [0, len(curve) - 1]
    tensor = np.stack([study.stress(curve, i).coefficients[3] for i in some])  # (2, 6, H + 1)
    xx, yy, zz, xy, yz, xz = tensor.transpose(1, 0, 2)
    close = functools.partial(
        np.testing.assert_allclose, rtol=1e-9, atol=1e-9 * np.abs(tensor).max()
    )
    close(study.gauge_stress(curve, "blade point 4", (1.0, 0.0, 0.0))[some], xx)
    close(study.gauge_stress(curve, "blade point 4", (0.0, 1.0, 1.0))[some], (yy + zz) / 2 + yz)
    close(
        study.gauge_stress(curve, "blade point 4", (1.0, -2.0, 0.0))[some],
        (xx + 4 * yy - 4 * xy) / 5,
    )
    near = model.stress["blade"].points[3] + 1e-6
    close(study.gauge_stress(curve, near, (1.0, 0.0, 1.0))[some], (xx + zz) / 2 + xz)
    # Hooke's law along an axis, and the sum of three strains
    modulus, poisson = 2.1e11, 0.28
    strains = [
        study.gauge_stress(curve, "blade point 4", axis, (modulus, poisson))[some] * modulus
        for axis in np.eye(3)
    ]
    close(strains[1], yy - poisson * (xx + zz))
    close(sum(strains), (1 - 2 * poisson) * (xx + yy + zz))
    peak = study.peak(PRELOAD)
    close(
        study.gauge_stress(peak, "blade point 4", (0, 0, 1)),
        study.stress(peak).coefficients[3, 2][None],
    )
    for given, message in [
        (("blade point 0", "axial"), "gauge: expected one of"), (("blade point 4", (0, 0, 0)), "direction"),
        (("blade point 4", "axial", (0.0, 0.3)), "elastic: expected a modulus above 0"),
        (((1, 2), "axial"), "gauge, m: expected 3"), ((1e3 * near, "axial"), r"gauge: expected coordinates within .* away"),
    ]:  # fmt: skip
        with pytest.raises(bd.SettingError, match=message):
            study.gauge_stress(peak, *given)


@pytest.mark.slow
def test_a_gauge_is_near_a_point_or_refused(model):
    """Nearest points up to a twentieth of the largest coordinate are taken, farther ones are not."""
    study, points = study_of(model), model.stress["blade"].points
    peak, largest = study.peak(PRELOAD), np.abs(points).max()
    first = int(points[:, 2].argmax())
    outward = np.array([0.0, 0.0, largest])
    near, far = (points[first] + share * outward for share in (0.049, 0.051))
    own = study.gauge_stress(peak, f"blade point {first + 1}", "axial")
    np.testing.assert_array_equal(study.gauge_stress(peak, near, "axial"), own)
    with pytest.raises(
        bd.SettingError, match=rf"gauge: .* found 'blade point {first + 1}' as the nearest"
    ):
        study.gauge_stress(peak, far, "axial")


@pytest.mark.slow
def test_the_wave_the_other_way_round_is_the_conjugate(model):
    there, back = (
        _Rows.make(study_of(model, engine_order=e).problem, model.stress["blade"], 1)
        for e in (5, 60)
    )
    rng = np.random.default_rng(0)
    n = study_of(model).problem.coupling.n_points
    force = rng.standard_normal(3 * n) + 1j * rng.standard_normal(3 * n)
    q = dict(enumerate(rng.standard_normal(20) + 1j * rng.standard_normal(20)))
    ours = there.stress(q, force, 1800.0)
    theirs = back.stress({k: v.conjugate() for k, v in q.items()}, force.conj(), 1800.0)
    np.testing.assert_allclose(theirs, ours.conj(), rtol=1e-12)
    assert np.abs(ours.imag).max() > 0.01 * np.abs(ours).max()


@pytest.mark.slow
def test_the_dampers_share_of_the_mean_comes_with_the_solution_and_is_counted_once(model):
    """At rest but for the vibration: the mean is that of the preload on the faces; rotation adds its own."""
    study = study_of(model)
    peak = study.peak(PRELOAD)
    still, fast = (study.stress(peak, speed=speed) for speed in (0.0, 400.0))
    by_rotation = 400.0**2 * model.stress["blade"].static
    np.testing.assert_allclose(
        fast.coefficients[..., 0] - still.coefficients[..., 0], by_rotation, rtol=1e-9
    )
    np.testing.assert_array_equal(fast.coefficients[..., 1:], still.coefficients[..., 1:])
    faint = study.replace(excitation=bd.Excitation("tip", "tangential", 1e-3))
    resting = faint.replace(bias=False)  # its mean is the static state
    means = [
        s.stress(s.frequency_response(500.0, (300.0, 301.0)), 0, speed=0.0).coefficients[..., 0]
        for s in (faint, resting)
    ]
    np.testing.assert_allclose(*means, rtol=1e-3, atol=1e-4 * np.abs(means[0]).max())


@pytest.mark.slow
def test_fewer_contact_points_carry_the_same_forces(model):
    coarse = study_of(model, contact_points=1).problem.coupling.model.stress["blade"]
    fine = model.stress["blade"]
    assert coarse.contact[5].shape == (10, 6, 6)
    for k in range(2):  # the mean over each face
        every = fine.contact[5].reshape(10, 6, 18, 3)[:, :, 9 * k : 9 * k + 9].mean(axis=2)
        np.testing.assert_allclose(coarse.contact[5][..., 3 * k : 3 * k + 3], every, rtol=1e-9)


@pytest.mark.slow
def test_points_near_patches_are_known(fe):
    g = fe.geometry
    left = wedge_patches(g, "left", 9)
    away = left.frame[:, 2] * np.sqrt(left.area)[:, None]
    assert (
        near_patches(left.centre + 0.99 * away, left).all()
        and not near_patches(left.centre + 1.01 * away, left).any()
    )


@pytest.mark.slow
def test_stress_of_a_linear_displacement_is_exact():
    """A block under uniform strain: every node, every element."""
    grid = np.stack(
        np.meshgrid([0.0, 0.4, 1.0], [0.0, 0.7], [0.0, 0.3, 0.5], indexing="ij"), axis=-1
    )
    body = discretise(
        join_blocks([grid + 0.05 * np.sin(3.0 * grid[..., ::-1])]),
        ElasticMaterial(2e11, 0.3, 7800.0),
    )
    gradient = np.array([[1.0, 0.2, 0.3], [-0.1, 2.0, 0.4], [0.5, 0.6, -1.0]]) * 1e-3
    pairs, _ = element_rows(solids_of(body), body.nodes, np.arange(len(body.nodes)))
    found = (pairs @ (body.nodes @ gradient.T).ravel()).reshape(-1, 6)
    strain = 0.5 * (gradient + gradient.T)
    lame, shear = 2e11 * 0.3 / (1.3 * 0.4), 2e11 / 2.6
    stress = lame * np.trace(strain) * np.eye(3) + 2.0 * shear * strain
    expected = stress[[0, 1, 2, 0, 1, 0], [0, 1, 2, 1, 2, 2]]
    np.testing.assert_allclose(found, np.tile(expected, (len(found), 1)), rtol=1e-9)


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("ccx") is None, reason="CalculiX (ccx) is not installed")
def test_stress_is_that_of_calculix(fe, rows, tmp_path):
    """Centrifugal load on the sector, held at the bore and with its cut faces free: nodal stress of both programs."""
    ours, theirs = centrifugal_stress(fe, rows, blade_points(fe.blade, fe.geometry), tmp_path)
    apart = von_mises_size(ours - theirs) / von_mises_size(theirs)
    assert apart.max() < 3e-4  # digits of the file; 0.03 with the strain at the nodes themselves
