"""Rigid-body motion in metres and radians, contact status, surfaces."""

from dataclasses import replace

import numpy as np
import pytest

import bdamper as bd
from bdamper.model.structure import turn
from bdamper.plot.bodies import export_modes, export_response
from bdamper.plot.motion import (
    LARGEST_DRAWN,
    VIEW,
    contact_status,
    line_drawing,
    rigid_motion,
    sectors_shown,
    surface_motion,
)
from tests.plain import plain_study


@pytest.fixture(scope="module")
def solved():
    study = plain_study(
        bd.reference_model("bladed_disk", 24),
        engine_order=5,
        friction_coefficient=0.4,
        excitation=bd.Excitation("tip"),
    )
    curve = study.frequency_response(500.0, (330.0, 360.0))
    return study, curve


def test_rigid_motion_is_that_of_the_damper_at_its_points(solved):
    """Translation plus rotation about the centre of mass give what the modes give at the contact points."""
    study, curve = solved
    u = curve.peak.y[:-1]
    surface = surface_motion(study, u)["damper"]
    # contact axes of the front plane are X, Y, Z of the damper
    body = study.problem.coupling.model.bodies["damper"]
    face = study.problem.coupling.model.interfaces["front"]
    basis = study.problem.bases[1]
    q = u[len(study.problem.bases[0].omega2) :]
    n = len(basis.omega2)
    q = q[:n] - 1j * q[n : 2 * n]
    own = [k for k, c in enumerate(basis.coordinates) if c.body == "damper"]
    rows = study.problem.coupling.model.port_slice("damper", ("front", "a"))
    local = body.bases[0].contact_modes[rows][..., :6] @ q[own][:6]
    expected = np.einsum("pij,pi->pj", face.frame, local)
    # the surface moves rigidly: fit its motion and read it at the points
    fit, *_ = np.linalg.lstsq(
        np.c_[surface.points, np.ones(len(surface.points))], surface.amplitude, rcond=None
    )
    got = np.c_[face.points, np.ones(len(face.points))] @ fit
    assert np.abs(expected).max() > 1e-8
    assert got == pytest.approx(expected, abs=1e-9 * np.abs(expected).max())


def test_units_of_rigid_motion(solved):
    study, curve = solved
    motion = rigid_motion(study, curve.unknowns)
    assert motion.bias.shape == (len(curve), 6) and motion.vibratory.shape == (len(curve), 1, 6)
    mass = study.model.bodies["damper"].mass
    assert motion.amplitude[:, :3] == pytest.approx(
        np.abs(motion.modal_vibratory[:, 0, :3]) / np.sqrt(mass)
    )
    moments = np.linalg.eigvalsh(study.model.bodies["damper"].inertia)
    factor = motion.amplitude[:, 3:] / np.abs(motion.modal_vibratory[:, 0, 3:])
    assert np.sort(1.0 / factor[0] ** 2) == pytest.approx(moments, rel=1e-9)


def test_missing_rigid_modes_do_not_move(solved):
    study, _ = solved
    part = study.replace(rigid_modes=("TX", "TY", "TZ"))
    curve = part.frequency_response(500.0, (350.0, 380.0))
    motion = rigid_motion(part, curve.peak.y[:-1])
    assert np.all(motion.vibratory[0, 3:] == 0.0) and np.all(motion.amplitude[:2] > 0.0)


def test_unknown_body_is_named(solved):
    study, curve = solved
    with pytest.raises(
        bd.SettingError, match=r"must be one of the free bodies \['damper'\], found 'blade'"
    ):
        rigid_motion(study, curve.unknowns[0], "blade")


def test_status_agrees_with_the_curve_and_with_itself(solved):
    study, curve = solved
    i = curve.peak_index
    status = contact_status(study, curve.unknowns[i], 500.0)
    both = [*status.rows("left"), *status.rows("right")]
    assert status.share[both].mean(axis=(0, 1)) == pytest.approx(curve.shares[i], abs=1e-9)
    assert status.share.sum(axis=2) == pytest.approx(1.0, abs=1e-12)
    # open is where there is no normal load
    normal = study.hysteresis(curve, i, n_theta=2000).force[both, 2, :-1]
    opened = status.share[both][..., 2]
    assert opened.any() and np.all(normal >= 0.0)
    assert np.column_stack([np.mean(normal == 0.0, axis=1)] * 2) == pytest.approx(opened, abs=3e-3)


@pytest.mark.slow
@pytest.mark.parametrize(
    "settings",
    [
        {"separation": False},
        {"variable_normal_load": False},
        {"friction_law": "coupled", "contact_forces": bd.AFT(64)},
        {"friction_law": "bonded"},
        {"friction_coefficient": {"left": 0.3, "right": 0.0}},
    ],
    ids=str,
)
def test_status_under_every_law(solved, settings):
    study = solved[0].replace(**settings)
    curve = study.frequency_response(500.0, (350.0, 380.0))
    i = curve.peak_index
    _, _, core = (
        a[: study.problem.coupling.n_points]
        for a in study.problem.system(500.0).contact(curve.unknowns[i])
    )
    status = contact_status(study, curve.unknowns[i], 500.0)
    assert status.share.sum(axis=2) == pytest.approx(1.0, abs=1e-12)
    rubs = study.problem.friction > 0.0
    if len(core) == len(rubs) and study.problem.system(500.0).structure.points.index is None:
        assert status.share[rubs][..., 0] == pytest.approx(core[rubs][:, [0, 2]], abs=1e-9)
        opened = np.column_stack([core[:, 4]] * 2)
        assert status.share[rubs][..., 2] == pytest.approx(opened[rubs], abs=1e-9)
        assert status.share[..., 2] == pytest.approx(opened, abs=1.0 / 64.0)  # samples


def test_export_to_vtu(solved, tmp_path):
    meshio = pytest.importorskip("meshio")
    study, curve = solved
    path = export_modes(study.model, tmp_path / "modes.vtu")
    mesh, stored = meshio.read(path), study.model.meshes["blade"]
    assert len(mesh.cells_dict["quad"]) == len(stored.quads)
    name = next(n for n in mesh.point_data if n.startswith("mode 1,") and n.endswith("real"))
    assert mesh.point_data[name] == pytest.approx(stored.modes[5][..., 0].real)
    u = curve.peak.y[:-1]
    paths = export_response(study, u, tmp_path)
    assert [p.name for p in paths] == ["response_blade.vtu", "response_damper.vtu"]
    blade = (
        meshio.read(paths[0]).point_data["vibration, real, m"]
        + 1j * meshio.read(paths[0]).point_data["vibration, imaginary, m"]
    )
    # the tip on the surface moves as the response says (all ten modes of the study are on the mesh)
    tip = np.argmin(np.linalg.norm(stored.points - study.model.locations["tip"].position, axis=1))
    assert abs(blade[tip, 0]) == pytest.approx(curve.peak.amplitude, rel=1e-6)
    assert (
        "mean displacement, m" not in meshio.read(paths[0]).point_data
    )  # no shapes of nodal diameter 0
    with pytest.raises(bd.SettingError, match="mode shapes on its mesh"):
        export_modes(study.model, tmp_path / "x.vtu", body="damper")


SHIPPED = [("bladed_disk", 9), ("bladed_disk", 48), ("blade_to_ground", 24), ("test_rig", 24)]


@pytest.mark.parametrize(("name", "points"), SHIPPED)
def test_surfaces_of_shipped_models_move_as_the_response_says(name, points):
    model = bd.reference_model(name, points)
    study = bd.Study(
        model,
        bd.Excitation("tip"),
        engine_order=5 if model.n_blades > 1 else 0,
        contact_stiffness=1e8,
    )
    curve = study.free((250.0, 300.0))
    top = curve.peak
    body = model.locations["tip"].body
    mesh, motion = model.meshes[body], surface_motion(study, curve.unknowns[curve.peak_index])[body]
    tip = np.argmin(np.linalg.norm(mesh.points - model.locations["tip"].position, axis=1))
    assert abs(motion.amplitude[tip, 0]) == pytest.approx(top.amplitude, rel=1e-6)
    assert np.isfinite(motion.mean).all() == (0 in mesh.modes)


@pytest.mark.slow
def test_surfaces_without_mode_shapes_are_refused_or_named(solved, tmp_path):
    study, curve = solved
    u = curve.peak.y[:-1]
    mesh = study.model.meshes["blade"]
    bare = study.replace(model=replace(study.model, meshes={"blade": replace(mesh, modes={})}))
    for call in (lambda: surface_motion(bare, u), lambda: export_response(bare, u, tmp_path)):
        with pytest.raises(
            bd.SettingError,
            match="the mesh of 'blade' needs mode shapes of nodal diameter 5; it has none",
        ):
            call()
    for call in (
        lambda: bare.model.plot_mode(1),
        lambda: export_modes(bare.model, tmp_path / "x.vtu"),
    ):
        with pytest.raises(
            bd.SettingError, match="needs mode shapes on the mesh of a body, and the model has none"
        ):
            call()
    few = bare.replace(
        model=replace(
            study.model, meshes={"blade": replace(mesh, modes={5: mesh.modes[5][..., :1]})}
        )
    )
    with pytest.warns(
        bd.PlausibilityWarning,
        match="at most 1 % of the motion in modes without shapes on the mesh, found",
    ):
        surface_motion(few, u)


def test_a_line_drawing_has_each_sector_at_its_phase(solved):
    """Stuck contacts: the blade of the next sector moves with the damper at its face, and not with the opposite phase."""
    study = solved[0].replace(contact_stiffness_factor=100.0)
    stuck = study.stuck((330.0, 450.0), 500.0)
    drawing = line_drawing(study, stuck.peak.y[:-1])
    model, face = study.model, study.model.interfaces["right"]
    counts = [len(model.meshes[name].points) for name, *_ in sectors_shown(model)]
    sectors = [(name, sector) for name, sector, _ in sectors_shown(model)]
    parts = dict(zip(sectors, np.split(np.arange(sum(counts)), np.cumsum(counts)[:-1])))
    assert set(parts) == {("blade", 0), ("blade", 1), ("damper", 0)}
    pitch = 2.0 * np.pi / model.n_blades
    places = {key: model.meshes[key[0]].points @ turn(pitch * key[1]).T for key in parts}
    near = {
        key: np.argmin(np.linalg.norm(places[key][:, None] - face.points, axis=2), axis=0)
        for key in parts
    }
    moved = {key: drawing.amplitude[parts[key][near[key]]].mean(axis=0) for key in parts}
    damper, blade = moved["damper", 0], moved["blade", 1]
    assert np.linalg.norm(damper - blade) < 0.2 * np.linalg.norm(damper)
    other = blade * np.exp(-2j * study.settings.engine_order * pitch)
    assert np.linalg.norm(damper - other) > 0.5 * np.linalg.norm(damper)
    assert np.abs(drawing.amplitude).max() * drawing.magnification == pytest.approx(
        LARGEST_DRAWN * np.ptp(drawing.points, axis=0).max(), rel=0.4
    )


@pytest.mark.slow
def test_a_line_drawing_paints_the_farthest_face_first(solved):
    study, curve = solved
    drawing, model = line_drawing(study, curve.unknowns[0]), study.model
    depth = np.concatenate(
        [model.meshes[name].points @ turned.T @ VIEW[2] for name, _, turned in sectors_shown(model)]
    )
    assert (np.diff(depth[drawing.quads].mean(axis=1)) >= -1e-12).all()
    assert pytest.approx(np.eye(3), abs=2e-3) == VIEW @ VIEW.T
    assert len(drawing.body) == len(drawing.quads) and drawing.quads.max() < len(drawing.points)
    with pytest.raises(bd.SettingError, match="the mesh of a body"):
        line_drawing(study.replace(model=replace(model, meshes={})), curve.unknowns[0])
