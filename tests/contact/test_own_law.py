"""Contact laws as functions in studies: joints with known answers, statics, time, files, and what is refused."""

import ctypes
import pickle
import re
import shutil
import subprocess
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy import LowLevelCallable

import bdamper as bd
from bdamper import _core
from bdamper.harmonic_balance.contact_cycle import energies
from bdamper.time_domain.integration import AllSectors

PAGE = (Path(__file__).parents[2] / "docs" / "lumped.md").read_text()
NUMBER = ctypes.POINTER(ctypes.c_double)


def joint(law=None, force=0.4, **settings):
    """One mass on a spring and a joint that slides."""
    contact = bd.Contact(0, kt=1.0, mu=1.0, preload=1.0)
    settings = {"harmonics": 3, **({} if law is None else {"friction_law": law}), **settings}
    return bd.lumped(1.0, 0.02, 1.0, contacts=[contact], forces={0: force}, **settings)


def ground(**settings):
    """The blade of docs/lumped.md that rubs on the ground: slips, opens, and has two folds."""
    contact = bd.Contact(0, 1, kt=0.6, kn=6.0, mu=0.4, preload=0.35)
    return bd.lumped(
        [1.0, 1.0], [0.05, 0.05], [[1.0, 0.3], [0.3, 2.0]], contacts=[contact], forces={0: 0.1, 1: 0.12}, response=1,
        harmonics=5, **settings,
    )  # fmt: skip


def as_jenkins(study, names, mu):
    """Laws with one element at each point, which is separable friction."""
    laws = {}
    for name in names:
        k = study.problem.stiffness[name].stiffness
        assert (k[:, 0] == k[:, 1]).all()
        one, zero = np.ones(len(k)), np.zeros(len(k))
        p = np.column_stack([one, k[:, 2], k[:, 0], zero, mu * one])
        laws[name] = bd.ContactLaw(_core.jenkins, 2, p, k, "jenkins")
    return laws


class TestIwan:
    def test_n_sliders_are_n_interfaces(self):
        k, f = np.array([0.3, 0.4, 0.2, 0.1]), np.array([0.05, 0.2, 0.3, 1.0])
        sampled = bd.AFT(128)
        contacts = [bd.Contact(0, kt=k_, mu=1.0, preload=f_) for k_, f_ in zip(k, f)]
        many = bd.lumped(
            1.0, 0.02, 1.0, contacts=contacts, forces={0: 0.4}, harmonics=3, contact_forces=sampled
        )
        one = joint(bd.ContactLaw.jenkins(k, f))
        expected, found = (study.frequency_response(0.0, (0.12, 0.25)) for study in (many, one))
        np.testing.assert_allclose(found.amplitude, expected.amplitude, rtol=1e-10)
        assert found.cost.evaluations == expected.cost.evaluations
        stuck = [study.stuck((0.1, 0.3), 0.0).peak.frequency for study in (many, one)]
        assert stuck[0] == pytest.approx(stuck[1], rel=1e-12)


class TestBoucWen:
    def test_balance_and_time_agree(self):
        """The integration is of second order in its step, and finds the motion of nine harmonics."""
        law = bd.ContactLaw.bouc_wen(1.0, 0.1, 2.0, 0.5)
        study = joint(law, harmonics=9, contact_forces=bd.AFT(512))
        curve = study.frequency_response(0.0, (0.15, 0.22))
        top = int(np.argmax(curve.amplitude))
        omega, u = 2 * np.pi * curve.frequency[top], curve.unknowns[top]
        system = study.problem.system(0.0)
        ring = AllSectors(system, 1, 1)
        motion = ring.start(u, omega, 512)
        assert motion.w.shape == (1, 1, 2 + 5)
        last = ring.integrate(motion, omega, 512, 30)
        assert abs(last.harmonics[-1, 0, 1]) == pytest.approx(curve.amplitude[top], rel=5e-4)
        lost = energies(system, u, omega)
        assert lost["contact"].sum() + lost["damping"] == pytest.approx(
            lost["excitation"], rel=1e-8
        )


@pytest.mark.slow
def test_a_sweep_in_time_is_that_of_our_friction():
    """A joint of one Jenkins element, and our friction under a constant normal load."""
    ours, own = joint(), joint(bd.ContactLaw.jenkins([1.0], [1.0]))
    expected, found = (study.frequency_sweep(0.0, (0.15, 0.16)) for study in (ours, own))
    assert found.amplitude.max() == pytest.approx(expected.amplitude.max(), rel=1e-3)


class TestOurFriction:
    """A law that is separable friction gives the curve of separable friction."""

    @pytest.mark.slow
    def test_a_damper_under_load(self):
        """Statics with slip under the load, then tracking with 18 own points among constraint planes."""
        model = bd.reference_model("bladed_disk")
        study = bd.Study(
            model, bd.Excitation("tip", "axial", amplitude=5.0), engine_order=3, friction_coefficient=0.3,
            contact_forces=bd.AFT(128), harmonics=1,
        )  # fmt: skip
        stiffness = {name: c.stiffness.copy() for name, c in study.problem.stiffness.items()}
        for k in stiffness.values():
            k[:, 1] = k[:, 0]
        ours = study.replace(contact_stiffness=stiffness)
        own = ours.replace(friction_law=as_jenkins(ours, ("left", "right"), 0.3))
        states = [s.static(300.0) for s in (ours, own)]
        assert states[1].ok and "slip" in states[1].state
        assert states[1].state == states[0].state
        np.testing.assert_allclose(
            states[1].force, states[0].force, atol=1e-9 * np.abs(states[0].force).max()
        )
        band = (715.0, 750.0)
        expected, found = (s.frequency_response(300.0, band) for s in (ours, own))
        np.testing.assert_allclose(found.amplitude, expected.amplitude, rtol=1e-8)
        stuck = [s.stuck((200.0, 900.0), 300.0).peak for s in (ours, own)]
        assert stuck[1].amplitude == pytest.approx(stuck[0].amplitude, rel=1e-9)


class TestFiles:
    def test_studies_and_results_keep_the_law(self, tmp_path):
        law = bd.ContactLaw.iwan(0.5, 1.0, -0.5, 0.2, n=4)
        study = joint({"contact 1": law})
        study.save(tmp_path / "study.h5")
        again = bd.load_study(tmp_path / "study.h5")
        assert again.problem.record() == study.problem.record()
        peak = study.peak(0.0, (0.14, 0.25))
        assert again.peak(0.0, (0.14, 0.25)).amplitude == peak.amplitude
        peak.save(tmp_path / "peak.h5")
        kept = bd.load(tmp_path / "peak.h5").settings["friction_law"]["contact 1"]
        assert kept["contact_law"] == "iwan" and kept["parameters"] == law.parameters.tolist()

    def test_a_function_is_not_in_a_file(self, tmp_path):
        law = bd.ContactLaw(
            _core.bouc_wen, 2, [0.0, 1.0, 0.1, 2.0, 0.5, 1.0], [1.0, 1.0, 0.0], "of my own"
        )
        study = joint(law)
        study.save(tmp_path / "study.h5")
        with pytest.raises(
            bd.SettingError,
            match=r"friction_law: expected a built-in law \(jenkins, iwan, bouc_wen\), found 'of my own', "
            "whose function is not in the file; create the study again with this law",
        ):
            bd.load_study(tmp_path / "study.h5")
        with pytest.raises(bd.SettingError, match="of my own"):
            pickle.loads(pickle.dumps(law))

    def test_static_states_keep_what_points_remember(self, tmp_path):
        state = joint(bd.ContactLaw.bouc_wen(1.0, 0.1, 2.0, 0.5)).static(0.0)
        state.save(tmp_path / "state.h5")
        np.testing.assert_array_equal(bd.load(tmp_path / "state.h5").memory, state.memory)


class TestRefused:
    @pytest.mark.parametrize(
        "function", [lambda *a: None, "coulomb", 3, None, ctypes.CFUNCTYPE(None, ctypes.c_void_p)(0)]
    )  # fmt: skip
    def test_what_is_no_compiled_law(self, function):
        with pytest.raises(bd.SettingError, match="function: expected"):
            bd.ContactLaw(function, 1, [1.0], [1.0, 1.0, 1.0])

    @pytest.mark.parametrize(
        "change",
        [
            {"n_state": -1}, {"n_state": 0.5}, {"parameters": [np.nan]}, {"parameters": 1.0}, {"stick": [1.0, 1.0]},
            {"stick": [0.0, 0.0, 0.0]}, {"stick": [1.0, -1.0, 1.0]},
        ],
    )  # fmt: skip
    def test_numbers(self, change):
        given = {
            "n_state": 2,
            "parameters": [0.0, 1.0, 0.1, 2.0, 0.5, 1.0],
            "stick": [1.0, 1.0, 0.0],
        } | change
        with pytest.raises(bd.SettingError, match=f"{next(iter(change))}: expected"):
            bd.ContactLaw(_core.bouc_wen, **given)

    @pytest.mark.parametrize(
        "make",
        [
            lambda: bd.ContactLaw.bouc_wen(1.0, 0.1, 1.0, 1.5),
            lambda: bd.ContactLaw.bouc_wen(1.0, 0.1, 1.0, 0.5, 0.9),
            lambda: bd.ContactLaw.iwan(1.0, 1.0, -1.0, 0.2),
            lambda: bd.ContactLaw.bouc_wen(1.0, 0.1, 1.0, -1.5),
            lambda: bd.ContactLaw.jenkins([1.0, 0.0], [1.0, 1.0]),
            lambda: bd.ContactLaw.jenkins([1.0], [-1.0]),
        ],
    )
    def test_laws_that_gain_energy_or_carry_nothing(self, make):
        with pytest.raises(bd.SettingError, match="expected"):
            make()

    @pytest.mark.parametrize(
        ("name", "value"),
        [("separation", False), ("variable_normal_load", False), ("stability", True)],
    )
    def test_settings(self, name, value):
        with pytest.raises(bd.SettingError, match=f"{name}: expected .* with a ContactLaw"):
            joint(bd.ContactLaw.jenkins([1.0], [0.5]), **{name: value})

    def test_rows_that_do_not_fit_the_points(self):
        law = bd.ContactLaw(_core.bouc_wen, 2, np.ones((3, 6)), [1.0, 1.0, 0.0], "bouc_wen")
        with pytest.raises(
            bd.SettingError,
            match="parameters of law 'bouc_wen': expected 1 rows for 'contact 1', found 3",
        ):
            joint(law).static(0.0)

    def test_analyses_that_know_events(self):
        study = joint(bd.ContactLaw.jenkins([1.0], [0.5]))
        curve = study.frequency_response(0.0, (0.14, 0.2))
        with pytest.raises(
            bd.SettingError,
            match=r"friction_law: stability needs .* of the laws in the C core, found jenkins",
        ):
            study.with_stability(curve)

    def test_wheels(self):
        model = bd.reference_model("bladed_disk")
        law = bd.ContactLaw.jenkins([1e7], [1.0], kn=1e7)
        study = bd.Study(model, bd.Excitation("tip", "axial"), engine_order=3, friction_law=law)
        with pytest.raises(bd.SettingError, match=r"a bladed disk needs .* found jenkins"):
            bd.BladedDisk(study)


class TestPerPoint:
    def test_friction_coefficients_of_points(self):
        model = bd.reference_model("bladed_disk")
        n = model.interfaces["left"].n_points
        same = {"left": np.full(n, 0.3), "right": 0.3}
        make = lambda mu, **s: bd.Study(
            model, bd.Excitation("tip", "axial"), engine_order=3, friction_coefficient=mu, **s
        )
        np.testing.assert_array_equal(make(same).problem.friction, make(0.3).problem.friction)
        rising = {"left": np.linspace(0.1, 0.5, n), "right": 0.0}
        study = make(rising)
        np.testing.assert_array_equal(
            study.problem.friction[study.problem.coupling.rows("left")], rising["left"]
        )
        assert study.problem.record()["friction_coefficient"]["left"] == rising["left"].tolist()
        assert study.settings.friction_values() == rising["left"].tolist()
        area = model.interfaces["left"].area
        united = make(rising, contact_points=1).problem.friction[0]
        assert united == pytest.approx(area @ rising["left"] / area.sum())
        for wrong in (np.full(n - 1, 0.3), np.full(n, -0.1)):
            with pytest.raises(
                bd.SettingError,
                match=f"friction_coefficient of 'left': expected {n} finite numbers",
            ):
                make({"left": wrong, "right": 0.3})


def own_curve(law):
    """Of the law of the page, and of separable friction whose closings are not interpolated."""
    ours = ground(contact_forces=bd.AFT(128, interpolate=False))
    return [
        study.frequency_response(0.0, (0.25, 0.54))
        for study in (ours, ours.replace(friction_law=law))
    ]


def test_the_example_in_c(tmp_path):
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        pytest.skip("no C compiler")
    (code,) = [block for block in re.findall(r"```c\n(.*?)```", PAGE, re.S) if "#include" in block]
    (tmp_path / "coulomb.c").write_text(code)
    library = tmp_path / "coulomb.so"
    command = [
        compiler,
        "-O2",
        "-shared",
        "-fPIC",
        str(tmp_path / "coulomb.c"),
        "-o",
        str(library),
        "-lm",
    ]
    subprocess.run(command, check=True, timeout=60)
    function = ctypes.CDLL(str(library)).coulomb
    function.restype, function.argtypes = None, [NUMBER] * 10 + [ctypes.c_void_p]
    law = bd.ContactLaw(
        LowLevelCallable(function), n_state=2, parameters=[0.6, 6.0, 0.4], stick=[0.6, 0.6, 6.0]
    )
    assert law.name == "coulomb"
    expected, found = own_curve(law)
    np.testing.assert_allclose(found.amplitude, expected.amplitude, rtol=1e-9)


def test_the_example_with_numba():
    pytest.importorskip("numba", reason="numba is not installed")
    (code,) = [block for block in re.findall(r"```py\n(.*?)```", PAGE, re.S) if "numba" in block]
    names = {"bd": bd}
    exec(code, names)
    expected, found = own_curve(names["law"])
    np.testing.assert_allclose(found.amplitude, expected.amplitude, rtol=1e-9)


def test_the_jacobian_of_states_that_depend_on_each_other():
    """A law whose states decay with the distance by a full matrix, against finite differences."""
    decay, b, c = np.array([[0.5, 0.3], [-0.2, 0.7]]), np.array([0.4, -0.1]), np.array([0.3, 0.5])

    @ctypes.CFUNCTYPE(None, *[NUMBER] * 10, ctypes.c_void_p)
    def function(x, before, p, s0, s1, F, Fx, Fs, sx, ss, data):
        step, state = x[0] - before[0], np.array([s0[0], s0[1]])
        rate, change = b - np.sign(step) * decay @ state, np.eye(2) - abs(step) * decay
        s1[0], s1[1] = state + rate * step
        F[0], F[1], F[2] = x[0] + c[0] * s1[0] + c[1] * s1[1], 0.0, 0.0
        if Fx:
            Fx[0] = 1.0
            for i in range(2):
                Fs[i], sx[6 * i], sx[6 * i + 3] = c[i], rate[i], -rate[i]
                ss[2 * i], ss[2 * i + 1] = change[i]

    law = bd.ContactLaw(
        LowLevelCallable(function), n_state=2, parameters=[0.0], stick=[1.0, 0.0, 0.0]
    )
    system = joint(law, harmonics=2, contact_forces=bd.AFT(32)).problem.system(0.0)
    y = np.append(np.random.default_rng(5).normal(size=system.n_unknowns), 1.3)
    jacobian, h = system.evaluate_at(y)[1], 1e-6
    for k in range(system.n_unknowns):
        step = h * np.eye(len(y))[k]
        expected = (system.residual(y + step) - system.residual(y - step)) / (2.0 * h)
        np.testing.assert_allclose(
            jacobian[:, k], expected, rtol=0.0, atol=1e-7 * np.abs(jacobian).max()
        )


def two_joints(**settings):
    """Two joints on one mass: the first has a law of its own, the second friction."""
    contacts = [
        bd.Contact(0, kt=0.5, mu=1.0, preload=1.0),
        bd.Contact(0, kt=0.5, mu=0.5, preload=1.0),
    ]
    law = {"contact 1": bd.ContactLaw.jenkins([0.5], 0.4), "contact 2": "uncoupled"}
    settings = {"harmonics": 1, "friction_law": law, **settings}
    return bd.lumped(1.0, 0.02, 1.0, contacts=contacts, forces={0: 0.4}, **settings)


def test_friction_that_a_law_does_not_use_is_named(tmp_path):
    """It changes nothing, and neither the study nor a result names it."""
    study = joint(bd.ContactLaw.jenkins([1.0], 0.5), harmonics=1)
    unused = r"friction_coefficient has no effect on 'contact 1', because a ContactLaw has its own parameters"
    for change in ({"friction_coefficient": 0.9}, {"friction_coefficient": {"contact 1": 0.9}},
                   {"friction_coefficient.contact 1": 0.9}):  # fmt: skip
        with pytest.warns(bd.PlausibilityWarning, match=unused):
            other = study.replace(**change)
        band = (0.12, 0.24)
        assert other.peak(0.0, band).amplitude == study.peak(0.0, band).amplitude
        assert "0.9" not in str(other.problem.record()["friction_coefficient"])
    peak = study.peak(0.0, (0.12, 0.24))
    assert peak.settings["friction_coefficient"] == {}
    peak.save(tmp_path / "peak.h5")
    loaded = bd.load_study(tmp_path / "peak.h5", study.model)
    assert loaded.peak(0.0, (0.12, 0.24)).amplitude == peak.amplitude
    old = replace(peak, settings=peak.settings | {"friction_coefficient": {"contact 1": 1.0}})
    assert np.isfinite(study.hysteresis(old).force).all(), "files of earlier versions have it"


def test_friction_of_other_interfaces_is_used():
    study = two_joints()
    assert study.problem.record()["friction_coefficient"] == {"contact 2": 0.5}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        single = study.replace(friction_coefficient={"contact 2": 0.3})
        named = study.replace(**{"friction_coefficient.contact 2": 0.3})
        halved = study.replace(friction_factor=0.6)
    for other in (single, named, halved):
        assert other.problem.record()["friction_coefficient"]["contact 2"] == pytest.approx(0.3)
    with pytest.warns(
        bd.PlausibilityWarning, match="no effect on 'contact 1', because a ContactLaw"
    ):
        study.replace(friction_coefficient={"contact 1": 0.2, "contact 2": 0.3})
    with pytest.raises(bd.SettingError, match="expected a value for interface 'contact 2'"):
        study.replace(friction_coefficient={})
