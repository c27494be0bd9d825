"""A speed-dependent model: the basis of a speed from two matrices."""

import hashlib
from dataclasses import replace

import h5py
import numpy as np
import pytest

import bdamper as bd
from bdamper.model.kinematics import centrifugal_load
from bdamper.model.modal_basis import SpeedBasis
from bdamper.model.model_file import read_model, write_model
from bdamper.model.structure import ModalBasis, feed_digest
from bdamper.model.validation import check_model
from bdamper.util.errors import ModelError, SettingError
from tests.models import wedge_model

SPEED = 400.0


def hermitian(rng, n, size):
    a = rng.standard_normal((n, n)) + 1j * rng.standard_normal((n, n))
    return size * (a + a.conj().T)


@pytest.fixture(scope="module")
def turning():
    """The shipped disk with made-up speed-dependent matrices at nodal diameter 5."""
    model = bd.reference_model("bladed_disk", 9)
    body, rng = model.bodies["blade"], np.random.default_rng(1)
    basis = replace(body.bases[5], speed=None)
    n, shapes = basis.n_modes, basis.contact_modes.reshape(-1, basis.n_modes)
    root = rng.standard_normal((54, 54))
    speed = SpeedBasis(
        omega_ref=0.0,
        stiffness0=np.diag(basis.omega2),
        stiffness2=np.diag(np.linspace(3.0, 9.0, n)) + hermitian(rng, n, 0.3),
        residual0=basis.flexibility - (shapes / basis.omega2) @ shapes.conj().T,
        residual2=1e-18 * root @ root.T,
        coriolis=1j * hermitian(rng, n, 0.1),
    )
    bodies = {
        **model.bodies,
        "blade": replace(body, bases={**body.bases, 5: replace(basis, speed=speed)}),
    }
    return replace(model, bodies=bodies)


def at(model, d=5):
    return model.bodies["blade"].bases[d]


@pytest.mark.slow
def test_the_basis_of_a_speed_has_the_receptance_of_stiffness_and_residual(turning):
    check_model(turning)
    basis, speed = at(turning.at_speed(SPEED)), at(turning).speed
    check_model(turning.at_speed(SPEED))
    shapes = at(turning).contact_modes.reshape(54, -1)
    stiffness = speed.stiffness0 + SPEED**2 * speed.stiffness2
    np.testing.assert_allclose(np.sort(basis.omega2), np.linalg.eigvalsh(stiffness), rtol=1e-12)
    expected = (
        speed.residual0
        + SPEED**2 * speed.residual2
        + shapes @ np.linalg.solve(stiffness, shapes.conj().T)
    )
    np.testing.assert_allclose(
        basis.flexibility, expected, rtol=0.0, atol=1e-12 * np.abs(expected).max()
    )
    forces = np.random.default_rng(0).standard_normal(
        54
    )  # dynamic receptance, free of the choice of modes
    modal = basis.contact_modes.reshape(54, -1).conj().T @ forces
    moved = basis.locations["tip"] @ (modal / (basis.omega2 - 2e6))
    direct = np.linalg.solve(stiffness - 2e6 * np.eye(len(stiffness)), shapes.conj().T @ forces)
    np.testing.assert_allclose(moved, at(turning).locations["tip"] @ direct, rtol=1e-9)


def test_the_speed_of_the_basis_gives_the_model_back(turning):
    again = turning.at_speed(0.0)
    assert again.hash == turning.hash
    assert turning.at_speed(SPEED).hash != turning.hash
    back = at(turning.at_speed(SPEED).at_speed(0.0))
    np.testing.assert_allclose(back.omega2, at(turning).omega2, rtol=1e-11)
    size = np.abs(at(turning).contact_modes).max()
    np.testing.assert_allclose(
        back.contact_modes, at(turning).contact_modes, rtol=0.0, atol=1e-9 * size
    )
    np.testing.assert_allclose(
        at(turning).conjugate().speed.stiffness2, at(turning).speed.stiffness2.T
    )


@pytest.mark.parametrize("flexible", [True, False])
def test_the_hash_knows_nothing_of_how_a_processor_rounds_what_follows(turning, flexible):
    basis, digests = at(turning), []
    if not flexible:  # then the matrices of the speed are all that is known of residual flexibility
        basis = replace(basis, flexibility=None)
    for change in ({}, {"residual0": 1.0 + 1e-15}, {"residual2": 1.0 + 1e-15}):
        speed = replace(
            basis.speed,
            **{name: getattr(basis.speed, name) * factor for name, factor in change.items()},
        )
        feed_digest(digest := hashlib.sha256(), "basis", replace(basis, speed=speed))
        digests.append(digest.hexdigest())
    assert (digests[0] == digests[1]) == flexible and digests[0] != digests[2] != digests[1]


def test_modes_keep_their_place_where_frequencies_cross():
    speed = SpeedBasis(0.0, np.diag([1.0, 2.0]), np.array([[3.0, 0.1j], [-0.1j, 1.0]]))
    basis = ModalBasis(np.array([1.0, 2.0]), np.zeros(2), np.zeros((0, 3, 2)), speed=speed)
    below, above = (basis.speed.modes(omega) for omega in (0.5, 2.0))
    assert below[0][0] < below[0][1] and above[0][0] > above[0][1]
    for omega2, shapes in (below, above):
        assert np.all(np.diag(shapes).real > 0.9) and np.abs(np.diag(shapes).imag).max() == 0.0
        assert omega2.shape == (2,)


def test_a_model_without_data_over_speed_stays_as_it_is_and_says_what_is_left_out():
    model = bd.reference_model("bladed_disk", 24)
    assert model.at_speed(SPEED).hash == model.hash
    (note,) = model.neglected_over_speed()
    assert note.startswith("blade, nodal diameters 0, 5,") and "spin softening" in note
    assert model.at_speed(SPEED).provenance["rotor speed"] == "400 rad/s"


@pytest.mark.slow
def test_united_contact_points_keep_the_receptance_at_a_speed(turning):
    from bdamper.model.contact_points import unite_contact_points

    first = unite_contact_points(turning, 4).at_speed(SPEED)
    then = unite_contact_points(turning.at_speed(SPEED), 4)
    np.testing.assert_allclose(at(first).flexibility, at(then).flexibility, rtol=0.0, atol=1e-18)


def changed(model, **parts):
    body, basis = model.bodies["blade"], at(model)
    bases = {**body.bases, 5: replace(basis, speed=replace(basis.speed, **parts))}
    return replace(model, bodies={**model.bodies, "blade": replace(body, bases=bases)})


@pytest.mark.slow
@pytest.mark.parametrize(
    ("parts", "words"),
    [
        ({"omega_ref": 50.0}, "stiffness0.*diagonal matrix of omega2"),
        ({"stiffness2": np.eye(39)}, r"stiffness2.*\(40, 40\)"),
        ({"stiffness2": np.triu(np.ones((40, 40)))}, "stiffness2.*Hermitian"),
        ({"residual0": np.eye(54)}, "residual0.*= flexibility"),
        (
            {"residual0": None},
            "residual0: expected residual0 and residual2, or neither, found only one",
        ),
        ({"coriolis": np.eye(40)}, "skew-Hermitian"),
        ({"checked_at": -1.0}, "checked_at.*>= 0"),
    ],
)
def test_data_over_speed_that_contradict_the_basis_are_refused(turning, parts, words):
    with pytest.raises(ModelError, match=words):
        check_model(changed(turning, **parts))


@pytest.mark.slow
def test_a_file_without_what_its_bases_cannot_supply_is_refused(turning, tmp_path):
    """Without flexibility nothing tells the residual flexibility at standstill."""
    basis = at(turning)
    bases = {**turning.bodies["blade"].bases, 5: replace(basis, flexibility=None)}
    model = replace(
        turning, bodies={**turning.bodies, "blade": replace(turning.bodies["blade"], bases=bases)}
    )
    with h5py.File(tmp_path / "model.h5", "w") as file:
        write_model(file, model)
        del file["bodies/blade/nd005/speed/residual0"]
        with pytest.raises(
            ModelError, match="residual0: the dataset is missing, and the basis has no flexibility"
        ):
            read_model(file)


def test_a_speed_that_tears_the_structure_is_refused(turning):
    with pytest.raises(
        SettingError, match=r"a stable structure, found .* import a second one closer"
    ):
        changed(turning, stiffness2=-50.0 * np.eye(40)).at_speed(600.0)
    with pytest.raises(SettingError, match=r"rotor speed: .*rad/s.*-1"):
        turning.at_speed(-1.0)


def test_size_of_the_coriolis_forces():
    speed = SpeedBasis(
        0.0, np.diag([4.0, 9.0]), np.eye(2), coriolis=np.array([[0.02j, 0.1], [-0.1, 0.0]])
    )
    shift, mixing = speed.coriolis_size(0.5, np.array([4.0, 9.0]))
    np.testing.assert_allclose(shift, [0.5 * 0.02 / 2.0, 0.0])
    np.testing.assert_allclose(mixing, [0.05, 0.05])


def test_the_shipped_disk_over_rotor_speed():
    model = bd.reference_model("bladed_disk", 9)
    blade = model.bodies["blade"]
    assert {0, *range(3, 11)} <= {d for d, basis in blade.bases.items() if basis.speed is not None}
    assert at(model).speed.checked_at == 600.0 and at(model).speed.error < 1e-5
    faster = model.at_speed(600.0)
    check_model(faster)
    for d in (0, 5, 8):
        low, high = (np.sqrt(at(m, d).omega2[0]) / (2.0 * np.pi) for m in (model, faster))
        assert low == pytest.approx(283.0, rel=2e-3) and high == pytest.approx(334.2, rel=2e-3)
        assert at(model, d).speed.stiffness2[0, 0].real == pytest.approx(3.495, rel=5e-3)
    shift, mixing = at(faster).speed.coriolis_size(600.0, at(faster).omega2)
    assert (
        1e-4 < shift[:10].max() < 1e-3 and mixing[:10].max() < 0.06
    )  # small enough to be left out
    assert 50e-6 < np.abs(blade.spin.contact[:, 2]).max() * 600.0**2 < 100e-6


def test_centrifugal_load_of_a_free_body_is_mass_times_radius():
    """The distance from the axis counts, not the position along it."""
    model = wedge_model(n_points=1, n_blade_modes=1, n_damper_modes=0)
    damper = replace(model.bodies["damper"], mass=2.0, centre=np.array([0.03, -0.04, 9.0]))
    heavy = replace(model, bodies={**model.bodies, "damper": damper})
    assert centrifugal_load(heavy) == pytest.approx(2.0 * 0.05, rel=1e-12)
