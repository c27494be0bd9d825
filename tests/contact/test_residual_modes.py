"""Residual modes: algebra of the projection, and stuck frequencies against the bonded full finite element model."""

import re
from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg

import bdamper as bd
from bdamper.contact.residual_flexibility import (
    ResidualModes,
    ResidualSet,
    active_components,
    force_patterns,
    joined,
    stuck_modes,
)
from bdamper.model.kinematics import Coupling, retained_modes
from bdamper.util.errors import ModelError, SettingError
from tests.each import each
from tests.models import ALL_MODELS, wedge_model
from tests.plain import plain_study

SOURCE = "bonded frequencies, nodal diameter 5"


@pytest.fixture(scope="module", params=(9, 24, 48))
def reference(request):
    return bd.reference_model("bladed_disk", request.param)


def bonded_in_full(model):
    """Frequencies of the full finite element model with the damper bonded at the patches, kept with the model."""
    return np.array(
        [float(t) for t in re.findall(r"[\d.]+", model.provenance[SOURCE].replace("Hz", ""))]
    )


def bonded(model, blade_modes, damper_modes, contact):
    """First frequencies (Hz) of the reduced model with all friction points bonded."""
    study = plain_study(
        model,
        bd.Excitation("tip"),
        5,
        blade_modes=blade_modes,
        damper_modes=damper_modes,
        constraint_planes=False,
        contact_stiffness=contact,
    )
    springs = np.concatenate(
        [study.problem.stiffness[name].stiffness for name in study.problem.coupling.interfaces]
    )
    return study.problem.system(0.0).structure.linear.modes(springs)[0][:5] / (2 * np.pi)


@pytest.mark.slow
@each("damper_modes", [0, 10])
@each("blade_modes", [10, 20])
def test_bonded_frequencies_within_a_fifth_of_a_percent(reference, blade_modes, damper_modes):
    found = bonded(reference, blade_modes, damper_modes, ResidualModes(8))
    np.testing.assert_allclose(found, bonded_in_full(reference), rtol=2e-3)
    # and much better where the fundamental harmonic of a response curve lies
    np.testing.assert_allclose(found[:4], bonded_in_full(reference)[:4], rtol=5e-5)


def shift_by_a_third(coupling, at_end, options):
    """Return the shift of mode 1 (rad/s) by bonding the inner or outer third of the faces: with the
    residual modes of these options, or None for the complete residual flexibility of these points.
    """
    friction = np.full(coupling.n_points, 0.3)
    basis = coupling.basis(1)
    bonded = np.zeros((coupling.n_points, 3), bool)
    for name in coupling.friction_faces:
        rows = np.arange(coupling.n_points)[coupling.rows(name)]
        radius = np.linalg.norm(coupling.model.interfaces[name].points[:, :2], axis=1)
        relative = (radius - radius.min()) / np.ptp(radius)
        bonded[rows[relative < 0.3 if at_end == "inner" else relative > 0.7]] = True
    chosen = bonded.ravel()
    if options is None:
        R = coupling.residual_flexibility(1)[np.ix_(chosen, chosen)]
        G = basis.G.reshape(len(chosen), -1)[chosen]
        first = stuck_modes(replace(basis, G=G), R, "R", resolved=1e-9)[0][0]
    else:
        residual = ResidualSet.make(coupling, friction, options)
        whole = joined(basis, residual.basis(1))
        G = whole.G.reshape(len(chosen), -1)[chosen]
        springs = 1.0 / residual.flexibility.ravel()[chosen]
        stiffness = np.diag(whole.omega2) + G.conj().T @ (springs[:, None] * G)
        # residual modes without mass: the largest eigenvalue of M x = mu K x is 1 / omega^2
        first = scipy.linalg.eigh(np.diag(whole.mass), stiffness, eigvals_only=True)[-1] ** -0.5
    elastic = basis.omega2[basis.omega2 > 1e-6 * basis.omega2.max()]
    return float(first - np.sqrt(elastic.min()))


@pytest.mark.slow
@pytest.mark.parametrize(("name", "end"), [("turbine_blade", "inner"), ("bladed_disk", "outer")])
def test_soft_forces_represent_faces_that_touch_at_an_end(name, end):
    """Against the flexibility of the points that touch; forces of stuck modes alone are 7 and -4 % off."""
    coupling = coupling_of(bd.reference_model(name, 9), 5, 10)
    exact = shift_by_a_third(coupling, end, None)

    def error(**options):
        given = ResidualModes(inertia=False, **options)
        return abs(shift_by_a_third(coupling, end, given) / exact - 1.0)

    assert error(n_vectors="all") < 1e-6
    assert error() > 0.04
    assert error(n_soft=6) < 0.25 * error()


@pytest.mark.slow
def test_forces_that_the_mesh_hardly_resolves_do_not_limit_the_share():
    """48 points on faces with fewer nodes: 36 force patterns have 0.002 to 0.02 of the flexibility of a point."""
    coupling = coupling_of(bd.reference_model("paper_disk", 48), 5, 10)
    made = ResidualSet.make(coupling, np.full(coupling.n_points, 0.3), ResidualModes("all"))
    active = made.active.ravel()
    R = coupling.residual_flexibility(1)[np.ix_(active, active)]
    size = np.sqrt(np.diag(R).real)
    eigenvalues = np.linalg.eigvalsh(R / size[:, None] / size)
    assert ((eigenvalues > 0.002) & (eigenvalues < 0.02)).sum() > 20
    # harmonic 0 is a little less flexible
    assert made.share == pytest.approx(0.9 * eigenvalues[eigenvalues > 0.02].min(), rel=0.15)


def test_diagonal_stiffness_alone_is_percents_off(reference):
    """The test above can fail: the other methods do."""
    error = bonded(reference, 10, 0, "unit_traction") / bonded_in_full(reference) - 1.0
    assert np.abs(error).max() > 0.02


@pytest.mark.slow
def test_without_inertia_the_fifth_frequency_is_not_good_enough(reference):
    """The massless ones are exact for the static residual flexibility: 0.23 % at mode 5 with ten blade modes."""
    error = (
        bonded(reference, 10, 0, ResidualModes(8, inertia=False)) / bonded_in_full(reference) - 1.0
    )
    assert 2e-3 < error[4] < 2.6e-3
    assert np.abs(error[:4]).max() < 5e-4


def coupling_of(model, engine_order=2, blade_modes=3):
    modes = retained_modes(model, blade_modes, dict.fromkeys(model.bodies, 0))
    return Coupling(model, tuple(model.interfaces), modes, engine_order)


@pytest.mark.parametrize("name", sorted(ALL_MODELS))
def test_projection_is_exact_for_its_patterns_and_positive(name):
    model = ALL_MODELS[name](n_blade_modes=5)
    coupling = coupling_of(model)
    friction = np.full(coupling.n_points, 0.3)
    made = ResidualSet.make(coupling, friction, ResidualModes(4, inertia=False))
    D, share, bases = made.flexibility, made.share, [made.basis(l) for l in range(3)]
    active = active_components(coupling, friction).ravel()
    assert 0.0 < share <= 0.5
    assert np.all((D.ravel() > 0) == active)
    for l, basis in enumerate(bases):
        R = coupling.residual_flexibility(l)[np.ix_(active, active)]
        columns = basis.G.reshape(len(active), -1)[active]
        approximate = np.diag(D.ravel()[active]) + (columns / basis.omega2) @ columns.conj().T
        assert np.linalg.eigvalsh(approximate)[0] > 0.0
        b = coupling.basis(l)
        b = replace(b, G=b.G.reshape(len(active), -1)[active])
        pole, force = stuck_modes(b, R, "")
        if l == 1:
            n = len(basis.omega2)
            assert n >= 3
            W = force[:, :n]
            np.testing.assert_allclose(approximate @ W, R @ W, atol=1e-8 * np.abs(R @ W).max())
            assert np.abs(approximate - R).max() > 1e-3 * np.abs(R).max()
        K = np.diag(b.omega2) + b.G.conj().T @ np.linalg.solve(R, b.G)
        np.testing.assert_allclose(
            pole**2, np.linalg.eigvalsh(K), rtol=1e-5, atol=1e-6 * pole[-1] ** 2
        )


def test_residual_modes_are_damped_as_the_modes_left_out():
    """Two modes of the blade with a ratio of 0.1 % and two of the damper with 0.2 %; without inertia nothing is damped."""
    coupling = coupling_of(wedge_model(n_blade_modes=5))
    friction = np.full(coupling.n_points, 0.3)
    for inertia, expected in ((True, 1.5e-3), (False, 0.0)):
        basis = ResidualSet.make(coupling, friction, ResidualModes(4, inertia=inertia)).basis(1)
        assert len(basis.damping_ratio) == len(basis.omega2) == 4
        np.testing.assert_allclose(basis.damping_ratio, expected, rtol=1e-12)
        assert (basis.mass > 0.0).any() == inertia
        np.testing.assert_allclose(
            joined(coupling.basis(1), basis).damping_ratio[-4:], expected, rtol=1e-12
        )


def test_all_patterns_are_the_whole_flexibility():
    coupling = coupling_of(wedge_model(n_points=2))
    friction = np.full(coupling.n_points, 0.3)
    made = ResidualSet.make(coupling, friction, ResidualModes("all", inertia=False))
    D, bases = made.flexibility, [made.basis(l) for l in range(2)]
    active = active_components(coupling, friction).ravel()
    for l, basis in enumerate(bases):
        R = coupling.residual_flexibility(l)[np.ix_(active, active)]
        columns = basis.G.reshape(len(active), -1)[active]
        approximate = np.diag(D.ravel()[active]) + (columns / basis.omega2) @ columns.conj().T
        np.testing.assert_allclose(approximate, R, atol=1e-9 * np.abs(R).max())


def points_alike(apart=0.0):
    """Contact points of which every second one moves as the one before it, with a part ``apart`` of its own motion."""
    model = wedge_model(n_points=2)
    bodies = {}
    for name, body in model.bodies.items():
        n = 3 * len(body.bases[0].contact_modes) if body.bases else 0
        first = (
            np.kron(np.eye(n // 6), np.kron([[1.0, 0.0], [1.0 - apart, apart]], np.eye(3)))
            if n
            else None
        )
        bases = {
            d: replace(
                b, contact_modes=(first @ b.contact_modes.reshape(n, -1)).reshape(b.contact_modes.shape),
                flexibility=first @ b.flexibility @ first.T,
            )
            for d, b in body.bases.items()
        }  # fmt: skip
        bodies[name] = replace(body, bases=bases)
    return coupling_of(replace(model, bodies=bodies))


@pytest.mark.parametrize("parts", [False, True])
def test_forces_that_the_mesh_hardly_resolves_do_not_stiffen_the_contact(parts):
    """Points almost alike, as on a mesh with fewer nodes than points, have the contact stiffness of equal points."""
    friction = np.full(points_alike().n_points, 0.3)
    options = ResidualModes(partial_contact=parts)
    equal, almost = (ResidualSet.make(points_alike(e), friction, options) for e in (0.0, 1e-4))
    assert almost.share == pytest.approx(equal.share, rel=1e-2) and equal.share > 0.05
    np.testing.assert_allclose(almost.flexibility, equal.flexibility, rtol=1e-2)
    for harmonic in (0, 1, 2):
        found, expected = almost.basis(harmonic), equal.basis(harmonic)
        assert found.G.shape == expected.G.shape
        G = [s.G.reshape(-1, s.G.shape[2]) for s in (found, expected)]
        a, b = ((G[k] / s.omega2) @ G[k].conj().T for k, s in enumerate((found, expected)))
        np.testing.assert_allclose(a, b, atol=1e-3 * np.abs(b).max())


def test_forces_that_50_points_on_15_nodes_do_not_resolve_leave_the_share():
    """Their largest eigenvalue is 0.0014 in units of the flexibility of a point; with them the share falls to 0.001."""
    equal, apart = points_alike(), points_alike(0.055)
    flexibility = apart.residual_flexibility(1)
    size = np.sqrt(np.diag(flexibility).real)
    part = np.linalg.eigvalsh(flexibility / size[:, None] / size)
    assert part[len(part) // 2 - 1] == pytest.approx(1.4e-3, rel=0.05)
    friction = np.full(equal.n_points, 0.3)
    shares = [
        ResidualSet.make(coupling, friction, ResidualModes()).share for coupling in (equal, apart)
    ]
    assert shares[1] == pytest.approx(shares[0], rel=1e-2)


def test_all_patterns_of_points_that_share_nodes():
    """Two contact points that move alike: half of the forces move nothing, and the others are represented exactly."""
    coupling = points_alike()
    friction = np.full(coupling.n_points, 0.3)
    made = ResidualSet.make(coupling, friction, ResidualModes("all", inertia=False))
    active = active_components(coupling, friction).ravel()
    for harmonic in (0, 1):
        R, basis = (
            coupling.residual_flexibility(harmonic)[np.ix_(active, active)],
            made.basis(harmonic),
        )
        columns = basis.G.reshape(len(active), -1)[active]
        assert (
            columns.shape[1]
            == np.linalg.matrix_rank(R, 1e-9 * np.abs(R).max(), hermitian=True)
            == len(R) // 2
        )
        approximate = (
            np.diag(made.flexibility.ravel()[active]) + (columns / basis.omega2) @ columns.conj().T
        )
        equal = np.kron(
            np.eye(len(R) // 6), np.kron(np.full((2, 2), 0.5), np.eye(3))
        )  # the same force on both points
        np.testing.assert_allclose(approximate @ equal, R @ equal, atol=1e-6 * np.abs(R).max())


def test_mass_is_the_curvature_of_the_left_out_modes():
    """Dynamic flexibility of the residual coordinates on their patterns, to second order in frequency."""
    coupling = coupling_of(wedge_model(n_points=3, n_blade_modes=6), blade_modes=3)
    friction = np.full(coupling.n_points, 0.3)
    made = ResidualSet.make(coupling, friction, ResidualModes("all"))
    D, bases = made.flexibility, [made.basis(l) for l in range(2)]
    active = active_components(coupling, friction).ravel()
    G, pole, _ = coupling.left_out_modes(1)
    assert (
        (bases[1].mass > 0.0).sum() == len(pole) < len(bases[1].mass)
    )  # no more have a mass, be it of rounding
    G = G[active]
    R = coupling.residual_flexibility(1)[np.ix_(active, active)]
    columns = bases[1].G.reshape(len(active), -1)[active]
    error = []
    for omega in (200.0, 400.0):
        exact = R + (G * (1.0 / (pole - omega**2) - 1.0 / pole)) @ G.conj().T
        ours = (
            np.diag(D.ravel()[active])
            + (columns / (bases[1].omega2 - omega**2 * bases[1].mass)) @ columns.conj().T
        )
        error.append(np.abs(ours - exact).max())
    assert np.log2(error[1] / error[0]) == pytest.approx(4.0, abs=0.1)


def test_stuck_response_does_not_depend_on_the_share():
    model = bd.reference_model("bladed_disk", 9)
    found = [bonded(model, 10, 0, ResidualModes(5, share, inertia=False)) for share in (0.02, 0.1)]
    np.testing.assert_allclose(found[0], found[1], rtol=1e-7)


@pytest.mark.parametrize("bad", [0, 2.5, -1])
def test_bad_patterns_are_refused(bad):
    with pytest.raises(SettingError, match="n_vectors"):
        ResidualModes(bad)


def test_indefinite_flexibility_is_refused_with_its_eigenvalue():
    model = wedge_model()
    blade = model.bodies["blade"]
    basis = blade.bases[2]
    shift = (
        1.02
        * np.linalg.eigvalsh(coupling_of(model).residual_flexibility(1)).max()
        * np.eye(len(basis.flexibility))
    )
    bad = replace(
        blade, bases={**blade.bases, 2: replace(basis, flexibility=basis.flexibility - shift)}
    )
    coupling = coupling_of(replace(model, bodies={**model.bodies, "blade": bad}))
    with pytest.raises(ModelError, match=r"expected a positive.*found -?\d.*"):
        ResidualSet.make(coupling, np.full(coupling.n_points, 0.3), ResidualModes())


@pytest.mark.parametrize("lowest", [-5e-7, -5e-6])
def test_rounding_of_a_flexibility_is_no_negative_flexibility(lowest):
    """The forces of a negative eigenvalue get no vectors, so that rounding has no effect."""
    rng = np.random.default_rng(5)
    vectors = np.linalg.qr(rng.standard_normal((6, 6)))[0]
    positive = vectors[:, 1:] @ np.diag([0.5, 0.8, 1.0, 1.2, 1.6]) @ vectors[:, 1:].T
    R = positive + lowest * np.outer(vectors[:, 0], vectors[:, 0])
    R /= np.sqrt(np.outer(np.diag(R), np.diag(R)))
    smallest = np.linalg.eigvalsh(R)[0]
    assert 0.3 * abs(lowest) < abs(smallest) < 3.0 * abs(lowest)
    if lowest < -1e-6:
        with pytest.raises(ModelError, match=r"positive semi-definite.*found an eigenvalue of -"):
            force_patterns(R, "flexibility of a test")
        return
    patterns = force_patterns(R, "flexibility of a test")
    assert patterns.shape == (6, 5)
    np.testing.assert_allclose(patterns.T @ R @ patterns, np.eye(5), atol=1e-12)


def test_missing_nodal_diameter_is_named():
    model = wedge_model(harmonics=1)
    with pytest.raises(SettingError, match="needs nodal diameter 4"):
        ResidualSet.make(
            coupling_of(model), np.full(coupling_of(model).n_points, 0.3), ResidualModes()
        ).basis(2)


def test_stuck_modes_against_the_saddle_point_problem():
    """An oracle without the inverse of R: [Omega^2 - lambda, G^H; G, -R] is singular at the stuck frequencies."""
    coupling = coupling_of(wedge_model(n_points=2))
    active = active_components(coupling, np.full(coupling.n_points, 0.3)).ravel()
    R = coupling.residual_flexibility(1)[np.ix_(active, active)]
    b = coupling.basis(1)
    b = replace(b, G=b.G.reshape(len(active), -1)[active])
    pole, _ = stuck_modes(b, R, "")
    m = b.G.shape[1]
    for k in range(3):
        A = np.block([[np.diag(b.omega2 - pole[k] ** 2), b.G.conj().T], [b.G, -R]])
        size = np.concatenate(
            [np.sqrt(np.maximum(b.omega2, pole[k] ** 2)), 1.0 / np.sqrt(np.diag(R).real)]
        )
        size[m:] = np.sqrt(np.diag(R).real)
        scaled = (
            A / np.concatenate([size[:m], size[m:]])[:, None] / np.concatenate([size[:m], size[m:]])
        )
        assert scipy.linalg.svdvals(scaled)[-1] < 1e-6
