"""Models of a few masses: their equations against plain matrices, damping, static loads, files, and what is refused."""

import re
import warnings

import numpy as np
import pytest
import scipy.linalg

import bdamper as bd
from bdamper.harmonic_balance.contact_cycle import energies, histories
from bdamper.util.errors import BdamperWarning, SettingError
from tests.each import each

JENKINS = bd.Contact(0, kt=1.0, mu=0.5, preload=1.0)
M = np.array([[2.0, 0.3, 0.0], [0.3, 1.0, 0.1], [0.0, 0.1, 0.5]])
K = np.array(
    [[3.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 1.0]]
)  # freedom 2 hangs on freedom 1 alone


def plain_response(omega, C, stiffness, rows, springs, force):
    """Amplitudes of all freedoms with linear springs along some motions."""
    A = (
        stiffness
        + 1j * omega * C
        - omega**2 * M
        + sum(k * np.outer(g, g) for g, k in zip(rows, springs))
    )
    return np.linalg.solve(A, force)


@pytest.mark.parametrize(
    "damping", ["proportional", "of a free motion and beyond critical", "not proportional"]
)
def test_linear_responses_are_those_of_the_matrices(damping):
    """Motions of every kind, forces with phases, names of freedoms."""
    free = damping == "of a free motion and beyond critical"
    stiffness = K - np.diag([2.0, 0.0, 0.0]) if free else K
    C = 0.04 * M + (3.0 if free else 0.05) * stiffness
    if damping == "not proportional":
        C = np.array([[0.05, -0.01, 0.0], [-0.01, 0.02, 0.0], [0.0, 0.0, 0.1]])
    contacts = [
        bd.Contact("tip", (1, 0), kt=0.7, kn=0.9, mu=0.4, preload=2.0),
        bd.Contact({0: 0.6, "tip": -0.8}, kt=0.5, mu=0.3, preload=1.0),
        bd.Contact(normal=1, kn=0.4, gap=0.1),  # open at rest
    ]
    study = bd.lumped(
        M,
        C,
        stiffness,
        contacts=contacts,
        forces={0: 0.5, "tip": 0.2 * np.exp(0.7j)},
        locations={"tip": 2},
        response=1,
    )
    rows = np.array([[0.0, 0.0, 1.0], [-1.0, 1.0, 0.0], [0.6, 0.0, -0.8]])
    system = study.problem.system(0.0)
    springs = study.problem.at(0.0).stuck_springs()
    for omega in (0.3, 0.9, 2.2):
        for k, given in ((np.array([0.7, 0.9, 0.5]), springs), (np.zeros(3), None)):
            expected = plain_response(omega, C, stiffness, rows, k, [0.5, 0.0, 0.2 * np.exp(0.7j)])
            found = system.structure.linear.response(omega, given) @ system.response_rows[1]
            assert found == pytest.approx(expected[1], rel=1e-11)
    poles = np.sqrt(np.maximum(scipy.linalg.eigh(stiffness, M, eigvals_only=True), 0.0))
    assert system.structure.linear.modes(None)[0] == pytest.approx(poles, rel=1e-9, abs=1e-6)
    assert study.excitation.amplitude == 0.5
    assert (study.model.bodies["masses"].bases[0].drag is None) == (damping == "proportional")


def test_coordinates_of_other_damping_give_the_same_peak():
    """Damping that is all but proportional: modes of mass and damping with springs between them, against modes."""
    C = 0.02 * M + 0.02 * K
    nearly = C + 1e-7 * np.diag([1.0, -1.0, 2.0])
    ways = {
        "contacts": [bd.Contact((1, 0), 2, kt=0.5, kn=1.0, mu=0.4, preload=0.3)],
        "forces": {0: 0.2},
        "response": 2,
    }
    plain, tied = (bd.lumped(M, c, K, **ways) for c in (C, nearly))
    assert [face.kind for face in tied.model.interfaces.values()] == [
        "friction",
        "spring",
        "spring",
    ]
    expected, found = (study.peak(0.0) for study in (plain, tied))
    assert expected.ok and found.ok
    assert found.amplitude == pytest.approx(expected.amplitude, rel=1e-4)
    assert found.frequency == pytest.approx(expected.frequency, rel=1e-5)


def test_equal_frequencies_with_different_damping():
    """Uncoupled equal blades: any two modes span their plane, damping chooses them."""
    turn = np.array([[0.6, 0.8], [-0.8, 0.6]])
    C = turn @ np.diag([0.02, 0.05]) @ turn.T
    study = bd.lumped(np.eye(2), C, np.eye(2), contacts=[JENKINS], forces={0: 1.0})
    assert 2.0 * study.model.bodies["masses"].bases[0].damping_ratio == pytest.approx(
        [0.02, 0.05], rel=1e-12
    )


def test_loads_and_preloads():
    """At rest nothing is displaced under preloads; loads act per newton, and the contact follows."""
    contact = bd.Contact(normal=1, kn=4.0, preload=2.0)
    study = bd.lumped(
        [1.0, 1.0],
        [0.02, 0.02],
        [1.0, 1.0],
        contacts=[contact],
        forces={1: 0.1},
        load_per_preload={1: 0.5},
    )
    assert study.static(0.0).q == pytest.approx([0.0, 0.0], abs=1e-14)
    assert study.static(0.0).force[0, 2] == pytest.approx(2.0)
    assert study.static(10.0).force[0, 2] == pytest.approx(2.0 + 4.0 * 0.5 * 10.0 / (1.0 + 4.0))
    held = bd.lumped(1.0, 0.02, 1.0, contacts=[JENKINS], forces={0: 1.0})
    with pytest.raises(
        bd.SettingError, match="preload: expected 0, since no body of the model carries a load"
    ):
        held.peak(1.0, (0.1, 0.3))


def test_two_directions_with_coupled_friction():
    """A circular orbit of radius R loses 2 pi mu N sqrt(R^2 - b^2) with the reach b = mu N/kt of the spring."""
    contact = bd.Contact(0, tangential2=1, kt=1.0, mu=0.5, preload=1.0)
    study = bd.lumped(
        [1.0, 1.0], [0.1, 0.1], [1.0, 1.0], contacts=[contact], forces={0: 1.0, 1: -1.0j}, harmonics=1,
        friction_law="coupled", contact_forces=bd.AFT(512),
    )  # fmt: skip
    curve = study.frequency_response(0.0, (0.14, 0.2))
    radius = curve.peak.amplitude
    system = study.problem.system(0.0)
    lost = energies(system, curve.unknowns[curve.peak_index], 2.0 * np.pi * curve.peak.frequency)[
        "contact"
    ][0]
    assert lost == pytest.approx(2.0 * np.pi * 0.5 * np.sqrt(radius**2 - 0.5**2), rel=1e-4)
    assert radius > 2.0


def test_a_loaded_cubic_spring():
    """x + 2 x^3 = 3 at rest; small vibrations about it see the stiffness 1 + 6 x^2 = 7."""
    study = bd.lumped(1.0, 0.01, 1.0, cubic={0: 2.0}, forces={0: 1e-5}, load_per_preload={0: 1.0})
    assert study.static(3.0).ok
    assert study.static(3.0).q == pytest.approx([1.0], rel=1e-10)
    assert study.static(20.0, (2.0, 0.5, 1.0)).q + 2.0 * study.static(20.0).q ** 3 == pytest.approx(
        [20.0], rel=1e-9
    )
    peak = study.peak(3.0, (0.3, 0.6))
    assert 2.0 * np.pi * peak.frequency == pytest.approx(np.sqrt(7.0), rel=1e-5)
    assert peak.amplitude == pytest.approx(1e-5 / (0.01 * np.sqrt(7.0)), rel=1e-3)


def test_energy_and_history_of_a_cubic_spring():
    """It takes none; friction and damping take the work of the excitation, that of free masses included."""
    study = bd.lumped(
        [1.0, 0.5], [0.05, 0.1], [1.0, 0.0], contacts=[bd.Contact((0, 1), 1, kt=1.0, kn=2.0, mu=0.3, preload=1.0)],
        cubic={0: 0.3}, forces={0: 0.5, 1: 0.1j},
    )  # fmt: skip
    peak = study.peak(0.0, (0.15, 0.4))
    system, omega = study.problem.system(0.0), 2.0 * np.pi * peak.frequency
    found = energies(system, peak.y[:-1], omega)
    assert found["contact"][0] + found["damping"] == pytest.approx(found["excitation"], rel=1e-9)
    assert abs(found["contact"][1]) < 1e-12 * found["excitation"]
    X, F = histories(system, peak.y[:-1], np.linspace(0.0, 6.0, 7))
    assert F[1] == pytest.approx(np.array([0.3 * X[1, 0] ** 3, np.zeros(7), np.zeros(7)]))


@each(
    ("change", "message"),
    [
        ({"mass": [1.0, 0.0]}, "mass: expected a positive definite matrix"),
        (
            {"mass": [1.0, 1e-10]},  # positive definite, but nearly singular
            "mass: expected a positive definite matrix with eigenvalues above 1e-09 of its largest entry, 1 kg, found an "
            "eigenvalue of 1e-10 kg",
        ),
        (
            {"mass": [2.0, -1.0]},
            "mass: expected a positive definite matrix with eigenvalues above 1e-09 of its largest entry, 2 kg, found an "
            "eigenvalue of -1 kg",
        ),
        ({"stiffness": [[1.0, 2.0], [2.0, 1.0]]}, "stiffness: expected a positive semidefinite matrix, found a mode of -1"),
        ({"stiffness": [[1.0, 2.0], [0.0, 1.0]]}, "stiffness: expected a symmetric matrix, found a difference of 2"),
        ({"stiffness": np.eye(3)}, "stiffness: expected finite numbers, a diagonal or a matrix (2, 2) as the mass"),
        ({"damping": [0.1] * 3}, "damping: expected finite numbers, a diagonal or a matrix (2, 2) as the mass, found"),
        ({"damping": "low"}, "damping: expected a number, a diagonal or a matrix, found 'low'"),
        ({"damping": [0.1, -0.1]}, "damping: expected a positive semidefinite matrix, found a mode of -0.1 1/s"),
        (
            {"stiffness": [[1.0, -1.0], [-1.0, 1.0]], "damping": [0.1, 0.0]},
            "damping: expected a matrix that is diagonal in the modes of mass and stiffness, because one of them has "
            "no stiffness (0 Hz); found modes 1 and 2 coupled by 1 of their damping",
        ),
        ({"contacts": JENKINS}, "contacts: expected a sequence of Contact, found a Contact"),
        ({"contacts": [bd.Contact(2, kt=1.0, mu=1.0, preload=1.0)]}, "contact 1: expected a whole number from 0 to 1"),
        ({"contacts": [bd.Contact((0, 0), kt=1.0, mu=1.0, preload=1.0)]}, "contact 1: expected a motion of at least one"),
        ({"contacts": [bd.Contact("tip", kt=1.0, mu=1.0, preload=1.0)]}, "contact 1: expected one of ('x0', 'x1'), found"),
        ({"forces": {}}, "forces: expected a force on at least one degree of freedom, found none"),
        ({"forces": {0: "1 N"}}, "force on 0: expected a finite real or complex number in N, found '1 N'"),
        ({"forces": {2: 1.0}}, "forces: expected a whole number from 0 to 1, found 2"),
        ({"load_per_preload": {0: 0.0}}, "load_per_preload: expected a static force on at least one degree"),
        ({"cubic": {0: np.inf}}, "cubic 0: expected a finite number in N/m3, found inf"),
        ({"engine_order": 2}, "lumped: expected settings other than ['engine_order'], which follow from its"),
    ],
)  # fmt: skip
def test_refused(change, message):
    given = {
        "mass": [1.0, 1.0],
        "damping": [0.1, 0.1],
        "stiffness": [1.0, 1.0],
        "contacts": [JENKINS],
        "forces": {0: 1.0},
    }
    with pytest.raises(bd.SettingError, match="^" + re.escape(message)):
        bd.lumped(**(given | change))


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({}, "contact: expected tangential, normal or both, found neither"),
        ({"tangential": 0, "kt": 1.0, "preload": 1.0}, "contact: expected tangential, kt > 0 and mu > 0 together"),
        ({"normal": 0}, "contact: expected normal and kn > 0 together, found normal=0, kn=0"),
        ({"tangential": 0, "kt": 1.0, "mu": 0.3}, "contact: expected a preload > 0 and no gap for a constant normal"),
        ({"normal": 0, "kn": 1.0, "preload": 1.0, "gap": 1.0}, "contact: expected a preload or a gap, found 1 N and 1 m"),
        ({"normal": 0, "kn": -1.0}, "kn: expected a finite number >= 0 N/m, found -1.0"),
    ],
)  # fmt: skip
def test_contacts_refused(given, message):
    with pytest.raises(bd.SettingError, match="^" + re.escape(message)):
        bd.Contact(**given)


class TestWhatSettingsDoNotReach:
    """Preloads are forces, damping that couples modes is a matrix: settings that would leave them behind are refused."""

    def test_contact_stiffness_under_a_preload(self):
        study = bd.lumped(1.0, 0.02, 1.0, contacts=[JENKINS], forces={0: 1.0}, harmonics=5)
        for settings in ({"contact_stiffness_factor": 2.0}, {"contact_stiffness": 2.0}):
            with pytest.raises(
                bd.BdamperError, match="contact_stiffness: the preload in this model belongs"
            ):
                study.replace(**settings)
        assert "contact_stiffness_factor" not in study.peak_sensitivities(
            study.peak(0.0, (0.05, 0.5))
        )

    def test_damping_ratio_beside_a_damping_matrix(self):
        study = bd.lumped(M, np.diag([0.05, 0.02, 0.01]), K, contacts=[JENKINS], forces={0: 1.0})
        with pytest.raises(
            bd.BdamperError,
            match="damping_ratio: expected none, because the damping matrix",
        ):
            study.replace(damping_ratio=0.01)


def test_names_of_the_user_are_kept():
    stiffness = np.array([[3.0, -1.0], [-1.0, 1.5]])
    given = {"contacts": [bd.Contact(0, kt=1e-9, mu=1.0, preload=1.0)]}
    one = bd.lumped(
        [1.0, 2.0],
        0.02 * stiffness,
        stiffness,
        locations={"x1": 0},
        forces={"x1": 1.0},
        response=1,
        **given,
    )
    two = bd.lumped([1.0, 2.0], 0.02 * stiffness, stiffness, locations={"forces": 1}, forces={0: 1.0, 1: 0.5j},
                    response="forces", **given)  # fmt: skip
    for study, force in ((one, [1.0, 0.0]), (two, [1.0, 0.5j])):
        top = study.free((0.05, 0.5)).peak
        omega = 2.0 * np.pi * top.frequency
        x = np.linalg.solve(
            stiffness * (1.0 + 0.02j * omega) - omega**2 * np.diag([1.0, 2.0]), force
        )
        assert top.amplitude == pytest.approx(abs(x[1]), rel=1e-9)


def pressed(force, load=1.0):
    """Two masses with a contact that a preload closes."""
    contact = bd.Contact((1, 0), normal=1, kt=1.0, kn=1.0, mu=0.5)
    ways = {
        "contacts": [contact],
        "forces": {0: force},
        "load_per_preload": {1: load},
        "harmonics": 1,
    }
    return bd.lumped([1.0, 0.1], [0.02, 0.02], [1.0, 0.1], **ways)


@pytest.mark.filterwarnings("ignore:preload")
class TestSizesOfNumbers:
    """Forces whose squares are no numbers are refused, whatever is asked; all others are answered."""

    BAND = (0.1, 0.3)
    ASKS = (
        lambda study, preload: study.frequency_response(preload, TestSizesOfNumbers.BAND),
        lambda study, preload: study.peak(preload, TestSizesOfNumbers.BAND),
        lambda study, preload: study.optimal_curve(
            (preload, 2.0 * preload), 2, frequency=TestSizesOfNumbers.BAND
        ),
    )

    @each("ask", ASKS)
    @each("force", [1e-300, 1e-200, 1e-160, 1e160, 1e300])
    def test_forces(self, ask, force):
        found = re.escape(f"from 1e-100 to 1e+100, found {force:g} N at 'x0'")
        with pytest.raises(bd.SettingError, match=f"^excitation: expected .* {found}"):
            ask(pressed(force), 1.0)

    @pytest.mark.parametrize("ask", ASKS)
    def test_loads(self, ask):
        with pytest.raises(
            bd.SettingError,
            match=r"^load_per_preload: expected static forces on the modes up to 1e\+100, found ",
        ):
            ask(pressed(0.1), 1e300)

    @pytest.mark.parametrize("factor", [1e-90, 1e90])
    def test_loads_and_forces_multiplied_by_a_number_multiply_the_response(self, factor):
        one, peak = pressed(0.1).peak(1.0, self.BAND), pressed(0.1 * factor).peak(factor, self.BAND)
        assert peak.amplitude / factor == pytest.approx(one.amplitude, rel=1e-6)
        assert peak.frequency == pytest.approx(one.frequency, rel=1e-6)


def test_a_response_in_modal_coordinates_is_a_point_of_the_structure():
    """Two modes of a beam: the tip moves sum phi^2 F / (omega_k^2 - omega^2 + i omega d_k)."""
    phi, omega2, d = np.array([1.2, -0.7]), np.array([4.0, 81.0]), np.array([0.04, 0.18])
    tip = {0: phi[0], 1: phi[1]}
    stuck = bd.Contact({0: 0.1, 1: 0.3}, kt=1e-9, mu=1.0, preload=1e7)
    study = bd.lumped(
        np.eye(2),
        np.diag(d),
        np.diag(omega2),
        contacts=[stuck],
        forces=tip,
        response=tip,
        harmonics=1,
    )
    curve = study.frequency_response(0.0, (2.5 / (2.0 * np.pi), 3.5 / (2.0 * np.pi)))
    omega = 2.0 * np.pi * curve.frequency[:, None]
    expected = np.abs((phi**2 / (omega2 - omega**2 + 1j * omega * d)).sum(axis=1))
    np.testing.assert_allclose(curve.amplitude, expected, rtol=1e-8)


@each("response", [{}, {0: 0.0}, {"tip": 1.0}, {5: 1.0}, {0: "one"}])
def test_a_response_without_motion_is_refused(response):
    with pytest.raises(bd.SettingError, match="response"):
        bd.lumped(
            [1.0, 1.0],
            [0.1, 0.1],
            [1.0, 1.0],
            contacts=[JENKINS],
            forces={0: 1.0},
            response=response,
        )


class TestJoint:
    def test_damping_of_small_slip_is_that_of_the_power_law(self):
        """In small slip the damping ratio is loss / (2 pi k u^2); three decades below macroslip."""
        stiffness, friction, exponent = 1e4, 10.0, 1.5
        study = bd.joint(50.0, 0.0, stiffness, friction, exponent)
        last, a = friction / stiffness, 1.0 / exponent
        mode = study.nonlinear_mode(0.0, 1, (1.2e-3 * last, 0.1 * last))
        u = mode.amplitude
        loss = 4.0 * stiffness * a * last**2 * (u / last) ** (a + 2.0) / ((a + 1.0) * (a + 2.0))
        expected = loss / (2.0 * np.pi * (2.0 * np.pi * mode.frequency) ** 2 * u**2)
        np.testing.assert_allclose(mode.damping_ratio, expected, rtol=0.025)

    @each("analysis", ["mode", "curve"])
    def test_motions_below_the_first_slider_are_told(self, analysis):
        last = 10.0 / 1e4

        def answer(decades):
            study = bd.joint(50.0, 1e-3, 1e4, 10.0, decades=decades)
            if analysis == "mode":
                return study.nonlinear_mode(0.0, 1, (1e-4 * last, 1e-2 * last))
            weak = bd.Excitation("x0", amplitude=2.0 * 1e-3 * (100.0 * np.pi) ** 2 * 1e-4 * last)
            return study.replace(excitation=weak).frequency_response(0.0, (49.0, 51.0))

        with pytest.warns(BdamperWarning, match="the joint moves by .* its sliders resolve"):
            answer(3.0)
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            answer(5.0)

    def test_a_file_keeps_the_resolution(self, tmp_path):
        study = bd.joint(50.0, 1e-3, 1e4, 10.0)
        assert study.model.slip_resolution == pytest.approx(1e-6)
        study.save(tmp_path / "joint.h5")
        assert (
            bd.load_study(tmp_path / "joint.h5").model.slip_resolution
            == study.model.slip_resolution
        )

    def test_exponent_0_is_one_slider(self):
        study = bd.joint(50.0, 1e-3, 1e4, 10.0, 0.0)
        (face,) = study.model.interfaces.values()
        assert -face.gap[0] * 1e4 == pytest.approx(10.0)

    @each("wrong", [{"exponent": 0.05}, {"exponent": -1.0}, {"decades": 0.5}, {"sliders": 1}])
    def test_what_is_refused(self, wrong):
        with pytest.raises(bd.SettingError, match=next(iter(wrong))):
            bd.joint(50.0, 1e-3, 1e4, 10.0, **wrong)


def test_a_model_without_contacts_is_linear():
    """The curve of the oscillator is |x| = |f| / |k - m w^2 + i c w|."""
    study = bd.lumped(2.0, 0.1, 3.0, forces={0: 1.5}, harmonics=1)
    curve = study.frequency_response(0.0, (0.1, 0.3))
    w = 2 * np.pi * curve.frequency
    expected = 1.5 / np.abs(3.0 - 2.0 * w**2 + 0.1j * w)
    np.testing.assert_allclose(curve.amplitude, expected, rtol=1e-8)
    with pytest.raises(SettingError, match="optimal_curve: expected a model with contacts"):
        study.optimal_curve((1.0, 2.0))
