"""A study as a whole: linear limits, independent checks of curve points, scaling, time shift, special preloads."""

from dataclasses import replace

import numpy as np
import pytest

import bdamper as bd
from bdamper.harmonic_balance.equations import OK
from bdamper.response.events import ContinuationOptions
from bdamper.util.errors import SettingError
from bdamper.util.progress import CostMeter
from tests import oracle
from tests.following import changed, find_start
from tests.models import RADIUS, ground_model, rotation, shroud_model, wedge_model
from tests.plain import plain_study

OPTIONS = ContinuationOptions(tolerance=1e-10)
BAND = (290.0, 420.0)


def wedge_study(**settings):
    model = settings.pop("model", None) or wedge_model(n_points=4, harmonics=3, alpha=0.8, beta=0.7)
    given = {
        "excitation": bd.Excitation("tip", amplitude=2.0),
        "engine_order": 2,
        "friction_coefficient": 0.3,
        "contact_stiffness": "model",
    }
    return plain_study(model, **{**given, **settings})


def relative_motion(model, engine_order, names):
    """Own assembly of (u1, u2, v) at harmonic 1 from the stored modes: (n_points, 3, n_modes), blade then damper.

    The damper's modes are those of the file, not turned into its own axes, so coordinates differ from the study's.
    """
    blade, damper = model.bodies["blade"].bases[engine_order], model.bodies["damper"].bases[0]
    phase = 2 * np.pi * engine_order / model.n_blades
    rows = []
    for name in names:
        n = model.interfaces[name].n_points
        row = np.zeros((n, 3, blade.n_modes + damper.n_modes), complex)
        if name in ("left", "right"):
            shift = 0.0 if name == "left" else phase
            row[..., : blade.n_modes] = blade.contact_modes[
                model.port_slice("blade", (name, "b"))
            ] * np.exp(1j * shift)
        row[..., blade.n_modes :] = -damper.contact_modes[model.port_slice("damper", (name, "a"))]
        row[:, 2] *= -1
        rows.append(row)
    return np.concatenate(rows)


class TestLinearLimits:
    @pytest.mark.parametrize("direction", ["tangential", "radial", "axial"])
    def test_free_is_the_modal_sum(self, direction):
        model = wedge_model(n_points=4)
        study = wedge_study(
            model=model,
            excitation=bd.Excitation("tip", direction=direction, amplitude=3.0, phase=0.4),
        )
        curve = study.free(BAND)
        basis = model.bodies["blade"].bases[2]
        axis = {"tangential": 0, "radial": 1, "axial": 2}[direction]
        row = basis.locations["tip"][axis]
        w = 2 * np.pi * curve.frequency[:, None]
        root = np.sqrt(basis.omega2)
        modal = (
            3.0 * np.exp(0.4j) * row.conj() / (root**2 - w**2 + 2j * basis.damping_ratio * root * w)
        )
        np.testing.assert_allclose(curve.harmonics[:, 1], modal @ row, rtol=1e-11)
        # the peak is refined, not that of a grid
        fine = np.linspace(0.999, 1.001, 20001) * curve.peak.frequency * 2 * np.pi
        fine = fine[:, None]
        modal = 3.0 * row.conj() / (root**2 - fine**2 + 2j * basis.damping_ratio * root * fine)
        assert curve.peak.amplitude == pytest.approx(np.abs(modal @ row).max(), rel=1e-6)

    @pytest.mark.parametrize("constraint_planes", [True, False])
    def test_stuck_is_the_system_with_springs(self, constraint_planes):
        """Direct solution with the modes of the file; the axial stops have a gap and stay open."""
        model = wedge_model(n_points=4)
        study = wedge_study(model=model, constraint_planes=constraint_planes, damper_modes=2)
        curve = study.stuck((300.0, 900.0), preload=100.0)
        G = relative_motion(model, 2, ["left", "right"])
        springs = np.concatenate([model.contact[name].stiffness for name in ("left", "right")])
        blade, damper = model.bodies["blade"].bases[2], model.bodies["damper"].bases[0]
        omega2 = np.concatenate([blade.omega2, damper.omega2])
        loss = 2 * np.concatenate([blade.damping_ratio, damper.damping_ratio]) * np.sqrt(omega2)
        flat = G.reshape(-1, len(omega2))
        K = np.diag(omega2) + flat.conj().T @ (springs.reshape(-1, 1) * flat)
        row = np.concatenate([blade.locations["tip"][0], np.zeros(damper.n_modes)])
        for i in range(0, len(curve), 37):
            w = 2 * np.pi * curve.frequency[i]
            q = np.linalg.solve(
                K - w**2 * np.eye(len(K)) + 1j * w * np.diag(loss), 2.0 * row.conj()
            )
            assert curve.harmonics[i, 1] == pytest.approx(row @ q, rel=1e-8)
        assert (curve.residual < 1e-9).all()

    def test_tracking_approaches_the_stuck_curve_under_high_preload(self):
        study = wedge_study(constraint_planes=False)
        frequency = study.stuck((300.0, 900.0)).peak.frequency
        band = (0.97 * frequency, 1.03 * frequency)
        stuck, tracked = study.stuck(band), study.frequency_response(1e7, band)
        assert tracked.complete
        assert (tracked.shares[:, 0] == 1.0).all()
        assert tracked.peak.amplitude == pytest.approx(stuck.peak.amplitude, rel=1e-8)
        assert tracked.peak.frequency == pytest.approx(stuck.peak.frequency, rel=1e-8)


class TestIndependentCheck:
    """Every point of a curve put into the residual of the oracle."""

    @staticmethod
    def check(study, preload, band, count=5):
        curve = study.frequency_response(preload, band)
        assert curve.complete, curve.reason
        system = study.problem.system(preload)
        arrays = dict(system.structure.arrays)
        arrays["G"] = [b.G for b in system.structure.bases]
        arrays["kt"] = np.where((arrays["law"] == 1)[:, None], 0.0, arrays["kt"])
        scale = system.row_scale
        for i in np.linspace(0, len(curve) - 1, count).astype(int):
            r = oracle.residual(curve.unknowns[i], 2 * np.pi * curve.frequency[i], arrays)
            assert np.abs(r * scale).max() <= 1.01e-9 + 1e-10
        return curve

    @pytest.mark.slow
    @pytest.mark.parametrize("harmonics", [1, 3])
    def test_wedge(self, harmonics):
        study = wedge_study(harmonics=harmonics, excitation=bd.Excitation("tip", amplitude=40.0))
        curve = self.check(study, 60.0, BAND)
        assert curve.shares[:, 1].max() > 0.05

    def test_ground(self):
        model = ground_model(n_points=2)
        face = replace(model.interfaces["pad"], gap=np.full(2, -2e-6))
        model = replace(model, interfaces={"pad": face})
        study = wedge_study(model=model, excitation=bd.Excitation("tip", amplitude=300.0))
        curve = self.check(study, 0.0, (280.0, 420.0))
        assert curve.shares[:, 1].max() > 0.01

    def test_shroud(self):
        model = shroud_model(n_points=2)
        face = replace(model.interfaces["shroud"], gap=np.full(2, -2e-6))
        model = replace(model, interfaces={"shroud": face})
        study = wedge_study(
            model=model, excitation=bd.Excitation("tip", amplitude=300.0), harmonics=2
        )
        curve = self.check(study, 0.0, (300.0, 420.0))
        assert curve.shares[:, 1].max() > 0.01


class TestScaling:
    @pytest.mark.parametrize("factor", [1e-6, 3.0, 1e6])
    def test_excitation_and_preload_together(self, factor):
        """Without gaps the response is homogeneous: the same curve, point by point."""
        study = wedge_study(
            constraint_planes=False, excitation=bd.Excitation("tip", amplitude=20.0)
        )
        scaled = study.replace(excitation=bd.Excitation("tip", amplitude=20.0 * factor))
        a, b = study.frequency_response(60.0, BAND), scaled.frequency_response(60.0 * factor, BAND)
        assert a.complete
        assert b.complete
        assert a.shares[:, 1].max() > 0.05
        assert b.peak.frequency == pytest.approx(a.peak.frequency, rel=1e-7)
        assert b.peak.amplitude / factor == pytest.approx(a.peak.amplitude, rel=1e-7)
        # each point of one is a solution of the other
        system = scaled.problem.system(60.0 * factor)
        for i in range(0, len(a), max(1, len(a) // 6)):
            r, _, _ = system.evaluate(factor * a.unknowns[i], 2 * np.pi * a.frequency[i])
            assert np.abs(r * system.row_scale).max() < 2e-9

    def test_phase_of_the_excitation_shifts_time(self):
        shift = 1.234
        study = wedge_study(harmonics=3, excitation=bd.Excitation("tip", amplitude=40.0))
        late = study.replace(excitation=bd.Excitation("tip", amplitude=40.0, phase=shift))
        omega = 2 * np.pi * 340.0
        y, _ = find_start(study.problem, 60.0, omega, OPTIONS, CostMeter())
        z, _ = find_start(late.problem, 60.0, omega, OPTIONS, CostMeter())
        assert y is not None
        assert z is not None
        system = study.problem.system(60.0)
        a, b = system.response(y[:-1]), late.problem.system(60.0).response(z[:-1])
        expected = a * np.exp(1j * shift * np.arange(4))
        np.testing.assert_allclose(b, expected, rtol=0, atol=1e-8 * np.abs(a).max())
        # and exactly: the shifted motion solves the shifted equations
        u = y[:-1].copy()
        for l in range(1, 4):
            c, s = system.layout.slices(l)
            q = system.layout.amplitudes(u, l) * np.exp(1j * l * shift)
            u[c], u[s] = q.real, -q.imag
        r, _, _ = late.problem.system(60.0).evaluate(u, omega)
        assert np.abs(r * system.row_scale).max() < 1e-9


class TestBases:
    def test_each_harmonic_has_its_nodal_diameter(self):
        study = wedge_study(harmonics=3)
        assert [b.nodal_diameter for b in study.problem.bases] == [0, 2, 4, 6]

    def test_single_basis_uses_that_of_the_fundamental(self):
        study = wedge_study(harmonics=3, fundamental_modes_only=True)
        own = wedge_study(harmonics=3)
        blade = study.model.bodies["blade"].bases[2]
        assert [b.nodal_diameter for b in study.problem.bases] == [2, 2, 2, 2]
        for l in (1, 2, 3):
            np.testing.assert_array_equal(
                study.problem.bases[l].omega2[: blade.n_modes], blade.omega2
            )
            # the phase to the next sector is still that of the harmonic
            rows = study.problem.coupling.rows("right")
            stored = blade.contact_modes[study.model.port_slice("blade", ("right", "b"))] * [
                [[1], [1], [-1]]
            ]
            phase = np.exp(2j * np.pi * 2 * l / study.model.n_blades)
            G = study.problem.bases[l].G[rows, :, : blade.n_modes]
            np.testing.assert_allclose(G, phase * stored, rtol=0, atol=1e-12)
        np.testing.assert_array_equal(study.problem.bases[1].G, own.problem.bases[1].G)
        assert not np.allclose(study.problem.bases[2].G, own.problem.bases[2].G)
        assert (
            study.frequency_response(1e6, (300.0, 310.0)).settings["fundamental_modes_only"] is True
        )

    def test_a_missing_nodal_diameter_is_named(self):
        model = wedge_model(harmonics=1)
        with pytest.raises(
            SettingError, match=r"needs nodal diameter 4.*fundamental_modes_only=True"
        ):
            wedge_study(model=model, harmonics=2)
        wedge_study(model=model, harmonics=2, fundamental_modes_only=True)


class TestSpecialPreloads:
    def test_without_friction_the_contact_is_linear_while_it_is_closed(self):
        study = wedge_study(friction_coefficient=0.0, constraint_planes=False)
        curve = study.frequency_response(1e5, BAND)
        assert curve.complete
        stuck = study.stuck(BAND)  # springs in the normal direction only
        expected = np.interp(curve.frequency, stuck.frequency, stuck.amplitude)
        away = np.abs(curve.frequency / stuck.peak.frequency - 1) > 0.01
        np.testing.assert_allclose(curve.amplitude[away], expected[away], rtol=2e-2)
        omega = 2 * np.pi * curve.frequency[0]
        system = study.problem.system(1e5)
        springs = study.problem.at(1e5).stuck_springs()
        assert not springs[:, :2].any()
        linear = system.structure.linear.response(omega, springs) @ system.response_rows[1]
        assert curve.harmonics[0, 1] == pytest.approx(linear, rel=1e-7)

    def test_without_a_preload_the_damper_leaves_its_seat(self):
        study = wedge_study(harmonics=2)
        curve, free = study.frequency_response(0.0, BAND), study.free(BAND)
        assert (
            curve.complete
            and curve.residual.max() <= 1e-9
            and (curve.shares == [0.0, 0.0, 1.0]).all()
        )
        np.testing.assert_array_equal(curve.harmonics[:, 1], free.harmonics[:, 1])
        system = study.problem.system(0.0)
        for u, f in zip(curve.unknowns[::20], curve.frequency[::20]):
            assert np.abs(system.evaluate(u, 2 * np.pi * f)[0] * system.row_scale).max() <= 1e-9
        assert any("study.free" in note for note in curve.notes)
        held = study.replace(bias=False).frequency_response(
            0.0, BAND
        )  # a mean that is held stays in contact
        assert not any("study.free" in note for note in held.notes)

    def test_no_preload_is_never_an_unconverged_curve(self):
        for model, harmonics in (
            (wedge_model(n_points=4), 1),
            (ground_model(n_points=2), 1),
            (shroud_model(), 2),
        ):
            study = wedge_study(model=model, harmonics=harmonics)
            curve = study.frequency_response(0.0, (300.0, 320.0))
            assert curve.status in ("complete", "incomplete", "not found")
            assert np.isfinite(curve.harmonics).all()
            assert (curve.residual <= 1e-9).all()
            system = study.problem.system(0.0)
            for u, f in zip(curve.unknowns[::5], curve.frequency[::5]):
                r, _, _ = system.evaluate(u, 2 * np.pi * f)
                assert np.abs(r * system.row_scale).max() <= 1e-9

    def test_without_excitation_the_response_is_the_static_state(self):
        study = wedge_study()
        state, system = study.static(100.0), study.problem.system(100.0)
        system = changed(
            system,
            np.where(np.arange(system.n_unknowns) < system.n_mean, system.structure.force, 0.0),
        )
        u = np.zeros(system.n_unknowns)
        u[: system.n_mean] = state.q
        r, _, _ = system.evaluate(u, 2000.0)
        assert np.abs(r * system.row_scale).max() < 1e-9
        c = system.correct_at(u, 2000.0, np.ones(len(u) + 1), 1e-9, 10)
        assert c.status == OK
        assert not c.y[system.n_mean : -1].any()


def test_the_neighbour_is_turned_the_right_way():
    """One rigid rotation of the whole disk about its axis moves no contact point against another: the blade modes of nodal
    diameter 0 put in by hand."""
    model = wedge_model(n_points=4)
    faces = {name: model.interfaces[name] for name in ("left", "right")}
    spin = np.array([0.0, 0.0, 1.0])
    turn = rotation(model.n_blades)
    ports = {"left": (faces["left"], np.eye(3)), "right": (faces["right"], turn)}
    own = []
    for face, R in ports.values():
        points, frames = face.points @ R, face.frame @ R  # in the axes of the blade's own sector
        own.append(np.einsum("pij,pj->pi", frames, np.cross(spin, points)))
    blade = model.bodies["blade"]
    modes = np.concatenate(own)[..., None]
    basis = replace(
        blade.bases[0],
        omega2=blade.bases[0].omega2[:1],
        damping_ratio=blade.bases[0].damping_ratio[:1],
        contact_modes=modes,
        locations={"tip": np.zeros((3, 1))},
        flexibility=None,
    )
    from bdamper.model.kinematics import Coupling

    moved = replace(model, bodies={**model.bodies, "blade": replace(blade, bases={0: basis})})
    coupling = Coupling(
        moved, ("left", "right"), {"blade": np.arange(1), "damper": np.arange(6)}, 2
    )
    G = coupling.basis(0).G
    # the damper must be able to follow: some rigid motion of it cancels that of both blades
    follow = np.linalg.lstsq(G[..., 1:].reshape(-1, 6), -G[..., 0].ravel(), rcond=None)
    left = G[..., 1:].reshape(-1, 6) @ follow[0] + G[..., 0].ravel()
    assert np.abs(left).max() < 1e-12 * RADIUS


@pytest.mark.parametrize("kind", ["free", "stuck"])
def test_linear_response_without_damping_is_unbounded_and_says_so(kind):
    """Every point solves its equations; |X| times the distance from the pole tends to a constant on both sides."""
    model = bd.reference_model("bladed_disk", contact_points=9)
    s = plain_study(
        model, bd.Excitation("tip"), engine_order=5, friction_coefficient=0.4, damping_ratio=0.0
    )
    curve = getattr(s, kind)((270.0, 380.0))
    assert (curve.residual < 1e-8).all()
    assert "unbounded at" in curve.reason
    assert "no damping" in curve.summary()
    pole = float(curve.reason.split("unbounded at ")[1].split()[0])
    system = s.problem.system(0.0 if kind == "free" else 1.0)
    springs = None if kind == "free" else s.problem.at(1.0).stuck_springs()
    exact = min(
        system.structure.linear.modes(springs)[0] / (2.0 * np.pi), key=lambda f: abs(f - pole)
    )
    distance = curve.frequency / exact - 1.0
    for side in (-1.0, 1.0):
        near = np.flatnonzero((side * distance > 0.0) & (np.abs(distance) < 1e-3))
        assert len(near) > 5
        residue = curve.amplitude[near] * np.abs(distance[near])
        np.testing.assert_allclose(residue, residue.mean(), rtol=1e-2)
