"""Equations of a whole wheel: derivatives, the approximate inverse, and the tuned limit."""

import weakref
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import bdamper as bd
from bdamper.continuation.path import ContinuationOptions
from bdamper.continuation.track import find_start
from bdamper.util.cost import CostMeter
from bdamper.wheel import DamperVariation, constants, newton
from bdamper.wheel.condensation import Condensation, pair
from bdamper.wheel.krylov import gmres
from bdamper.wheel.newton import LOOSE, correct, solved
from bdamper.wheel.system import PLAIN, Ease
from bdamper.wheel.wheel import Wheel
from tests.wheel.lumped import lumped_study
from tests.wheel.oracle import Inverse, Ring

PRELOAD = 300.0


def wheel(n_blades=6, harmonics=2, amplitude=100.0, **options):
    study = lumped_study(n_blades, 1, harmonics=harmonics, n_c=2, r=2, **options)
    return Wheel(study.with_(excitation=bd.Excitation("tip", amplitude=amplitude)))


def dense(operator, shape):
    """Matrix of a linear map of arrays."""
    return np.array([operator(e.reshape(shape)).ravel() for e in np.eye(int(np.prod(shape)))]).T


def test_the_ring_is_eliminated_exactly():
    rng = np.random.default_rng(0)
    for n in (3, 4, 7):
        lower, diagonal, upper = rng.normal(size=(3, n, 2, 2))
        diagonal = diagonal + 4.0 * np.eye(2)
        A = np.zeros((n, 2, n, 2))
        for k in range(n):
            A[k, :, k] += diagonal[k]
            A[k, :, k - 1] += lower[k]
            A[k, :, (k + 1) % n] += upper[k]
        b = rng.normal(size=(n, 2))
        x = Ring.of(lower, diagonal, upper).solve(b)
        np.testing.assert_allclose(np.einsum("iajb,jb->ia", A, x), b, atol=1e-12)


def test_gmres_reaches_its_tolerance():
    rng = np.random.default_rng(1)
    A = np.eye(40) + 0.1 * rng.normal(size=(40, 40))
    b = rng.normal(size=40)
    x, count, residual = gmres(lambda v: A @ v, b, 1e-10)
    assert count < 40 and residual <= 1e-10
    assert np.linalg.norm(A @ x - b) <= 1.1e-10 * np.linalg.norm(b)


@pytest.mark.parametrize("harmonics", [1, (1, 3)])
def test_derivatives_are_those_of_the_residual(harmonics):
    w = wheel(harmonics=harmonics).with_(mistuning=0.03 * np.random.default_rng(2).normal(size=6))
    system, mean = w.system(PRELOAD)
    rng = np.random.default_rng(3)
    X = 1e-6 * rng.normal(size=system.shape)
    X[:, 0] = mean
    X[system.still] = 0.0
    omega = 2.0 * np.pi * 180.0
    at = system.linearised(X, omega)
    assert 0.1 < at.shares[..., 1].mean() < 0.9
    direction = 1e-6 * rng.normal(size=X.shape)
    direction[system.still] = 0.0
    h = 1e-5
    difference = (system.residual(X + h * direction, omega) - system.residual(X - h * direction, omega)) / (2.0 * h)
    exact = at.product(direction)
    assert np.abs(difference - exact).max() < 1e-7 * np.abs(exact).max()
    difference = (system.residual(X, omega + 1e-3) - system.residual(X, omega - 1e-3)) / 2e-3
    assert np.abs(difference - at.by_omega).max() < 1e-7 * np.abs(at.by_omega).max()


def test_the_approximate_inverse_is_exact_on_a_ring_of_three():
    """All sectors are next neighbours there; what is left out is damping between them alone."""
    w = wheel(3, 1)
    system, mean = w.system(PRELOAD)
    X = np.zeros(system.shape)
    X[:, 0] = mean
    X[:, 1] = 1e-7
    at = system.linearised(X, 2.0 * np.pi * 150.0)
    J, B = dense(at.product, X.shape), dense(at.inverse(), X.shape)
    assert np.abs(np.linalg.eigvals(J @ B) - 1.0).max() < 1e-2


@pytest.mark.parametrize(
    ("n_blades", "harmonics", "options"), [(3, 1, {}), (4, 2, {"n_att": 2}), (7, (1, 3), {"bias": False})]
)
def test_the_core_eliminates_as_plain_numpy_does(n_blades, harmonics, options):
    w = wheel(n_blades, harmonics, **options).with_(mistuning=0.03 * np.random.default_rng(2).normal(size=n_blades))
    system, mean = w.system(PRELOAD)
    rng = np.random.default_rng(3)
    X = 1e-6 * rng.normal(size=system.shape)
    X[:, 0] = mean
    X[system.still] = 0.0
    r = rng.normal(size=X.shape)
    for ease in (PLAIN, Ease(damping=0.3, springs=0.1)):
        at = system.linearised(X, 2.0 * np.pi * 180.0, ease, held=1e-3)
        core, plain = at.inverse()(r), Inverse.of(at)(r)
        assert np.abs(core - plain).max() < 1e-9 * np.abs(plain).max()


@pytest.mark.parametrize(("n_c", "stiffness", "condensed"), [(2, 2e6, 0), (7, 2e4, 3)])
@pytest.mark.parametrize("damped", [False, True])
def test_linear_equations_are_solved(damped, n_c, stiffness, condensed, monkeypatch):
    """What is left out is put right step by step, with nothing condensed or some of each blade's coordinates."""
    monkeypatch.setattr("bdamper.wheel.constants.KEPT", 1)  # of two root shapes
    study = lumped_study(7, 1, harmonics=(1, 3), n_c=n_c, r=2, n_att=2).with_(contact_stiffness=stiffness)
    study = study.with_(excitation=bd.Excitation("tip", amplitude=100.0), damping_ratio=None if damped else 0.0)
    w = Wheel(study, mistuning=0.03 * np.random.default_rng(2).normal(size=7))
    far = 0.01 * np.cos(4.0 * np.pi * np.arange(7) / 7)[:, None, None] * np.eye(2)  # a disk whose mass couples sectors, too
    w = Wheel(study, w.mistuning, _structure=replace(w.structure, disk_mass=w.structure.disk_mass + far))
    system, mean = w.system(PRELOAD)
    rng = np.random.default_rng(3)
    X = np.where(system.still, 0.0, 1e-6 * rng.normal(size=system.shape))
    X[:, 0] = mean
    at = system.linearised(X, 2.0 * np.pi * 180.0, Ease(0.1, 0.2))
    inverse, root = at.inverse(), system.constants.root
    assert inverse.condensed.flexibility.shape[2] == condensed
    r = np.zeros(system.shape)
    r[..., root] = rng.normal(size=r[..., root].shape)
    r[system.still] = 0.0
    whole = inverse(r)
    np.testing.assert_allclose(inverse.on_root(r[..., root]), whole[..., root], rtol=0, atol=1e-12 * np.abs(whole).max())
    x = np.where(system.still, 0.0, 1e-6 * rng.normal(size=system.shape))
    normal, d = rng.normal(size=x[..., root].shape), 0.3
    right = at.product(x) + d * at.by_omega, float((normal * x[..., root]).sum()) + 0.7 * d
    for plane, given, ahead in (None, (at.product(x), 0.0), 0.0), ((normal, 0.7), right, d):
        found, change, count = solved(at, inverse, plane, 1e-12, given)
        error = np.linalg.norm(found - x) / np.linalg.norm(x) + abs(change - ahead)
        assert error < 1e-8 and count > 2, (error, count)
        found, change, _ = solved(at, inverse, plane, LOOSE, given)
        once = np.linalg.norm(found - x) / np.linalg.norm(x) + abs(change - ahead)
        assert 1e-8 < once < 0.1, once


def condensed_wheel():
    """Five blades, some coordinates of which are condensed out, and a place at rest."""
    study = lumped_study(5, 1, harmonics=1, n_c=7, r=2).with_(contact_stiffness=2e4)
    w = Wheel(study.with_(excitation=bd.Excitation("tip", amplitude=100.0)))
    system, mean = w.system(PRELOAD)
    X = np.zeros(system.shape)
    X[:, 0] = mean
    return w, system, X


def test_the_core_refuses_an_older_inverse():
    """Its memory is that of the next one; another octave has other condensed coordinates, and memory of its own."""
    _, system, X = condensed_wheel()
    omega = 2.0 * np.pi * 100.0
    r = np.random.default_rng(0).normal(size=X.shape)
    first = system.linearised(X, omega).inverse()
    expected = first(r)
    second = system.linearised(X, 1.001 * omega).inverse()
    assert first.core is second.core
    with pytest.raises(ValueError, match=r"^factored: expected the number of .* last, 2 \(0 for none\), found 1$"):
        first(r)
    far = system.linearised(X, 4.0 * omega).inverse()
    assert far.core is not second.core
    assert far.condensed.flexibility.shape[2] < second.condensed.flexibility.shape[2]
    assert correct(system, X, omega, inverse=far, most=1).inverse is far
    np.testing.assert_array_equal(system.linearised(X, omega).inverse()(r), expected)


def test_a_singular_matrix_leaves_no_factors():
    _, system, X = condensed_wheel()
    at = system.linearised(X, 0.0)
    good = at.inverse()
    with pytest.raises(FloatingPointError):
        replace(at, tangents=0.0 * at.tangents, springs=0.0 * at.springs).inverse()
    with pytest.raises(ValueError, match=r"^factored: .* last, 0 .* found 1"):
        good(np.zeros(X.shape))


def test_newton_ends_where_it_may():
    system, mean = wheel(6, 1).system(PRELOAD)
    X, omega, options = np.zeros(system.shape), 2.0 * np.pi * 190.0, {"line_search": True, "most": 40}
    X[:, 0] = mean
    whole = correct(system, X, omega, **options)
    content = correct(system, X, omega, content=10.0, **options)
    rough = correct(system, X, omega, content=10.0, rough=1e-4, **options)
    assert whole.converged and content.converged and rough.converged
    assert whole.residual <= 1e-9 < rough.residual < 1e-4 < content.residual
    for at in (whole, content, rough):
        np.testing.assert_array_equal(at.at.residual, system.residual(at.X, omega))
    for free in (0, 2):
        short = correct(system, X, omega, longest=0.0, free=free, **options)
        assert not short.converged and short.iterations == free


def test_a_step_to_where_nothing_is_finite_is_shortened():
    X = np.ones((1, 3, 1))

    def linearised(X, *_):
        return SimpleNamespace(residual=np.where(X > 1.5, np.nan, X))

    factor, at = newton._shortened(SimpleNamespace(linearised=linearised), X, 1.0, lambda r: r, 4.0 * X, 0.0, PLAIN)
    assert factor == 0.125 and np.isfinite(at.residual).all()


@pytest.mark.parametrize("deviation", [0.0, 0.1])
def test_blades_are_condensed_to_the_second_order_of_their_damping(deviation):
    """Two combinations of coordinates move contact points: against the whole equations, forces on kept shapes or on all."""
    rng = np.random.default_rng(4)
    n, kept, omega = 7, 2, 2.0
    root, force = rng.normal(size=(3, n, n)), rng.normal(size=(3, 3, n))
    stiffness, mass, loss = root[0] @ root[0].T + n * np.eye(n), np.eye(n) + 0.05 * root[1] @ root[1].T, root[2] @ root[2].T
    rows = np.zeros((2, 3, n + 1))
    rows[..., :n] = rng.normal(size=(2, 3, 2)) @ rng.normal(size=(2, n))
    rows[..., n - kept : n] = rng.normal(size=(2, 3, kept))
    blades = stiffness * (1.0 + deviation * np.arange(3))[:, None, None]

    def error(size, r):
        damping, lost = size * loss, 0.3 * size
        of = Condensation.of(blades, stiffness, mass, damping, rows, np.ones((2, 3)), kept, 0.01)
        assert of.contact.shape[1] == 2 and of.poles.shape == (3, 3)
        condensed = of.at(omega, 1, lost)
        on_b, on_z = condensed.forces(r)
        P, G = rows[..., :n].reshape(6, n), of.rows[..., :-1].reshape(6, -1)
        b, whole = np.empty_like(on_b), np.empty_like(r)
        for k, l in np.ndindex(3, 2):
            left = condensed.stiffness[l, k] + 1j * condensed.damping[l, k] + G.T @ G
            w = l * omega
            full = blades[k] - w**2 * mass + 1j * w * (damping + lost * mass) + P.T @ P
            for out, matrix, f in ((b, left, on_b), (whole, full, r)):
                x = np.linalg.solve(matrix, np.array([1.0, -1j])[: 1 + l] @ f[k, pair(l)])
                out[k, pair(l)] = np.array([x.real, -x.imag])[: 1 + l]
        off = np.abs(condensed.motion(b, on_z) - whole)
        assert off[:, 0].max() < 1e-12 * np.abs(whole).max()
        return off.max() / np.abs(whole).max(), off[..., -kept:].max() / np.abs(whole).max()

    assert error(0.0, force)[0] < 1e-12
    assert error(0.002, force)[0] < 0.6 * error(0.004, force)[0] < 0.05
    force[..., :-kept] = 0.0
    assert error(0.002, force)[1] < 0.3 * error(0.004, force)[1] < 3e-4


@pytest.mark.parametrize("harmonics", [1, 3])
def test_a_tuned_wheel_has_the_waves_of_the_study(harmonics):
    w = wheel(6, harmonics)
    tuned = w.tuned()
    system, mean = w.system(PRELOAD)
    omega = 2.0 * np.pi * 200.0
    y, _ = find_start(tuned, PRELOAD, omega, ContinuationOptions(tolerance=1e-11), CostMeter(0.0))
    wave = w.structure.wave(y[:-1])
    assert system.size(system.residual(wave, omega)) < 1e-10
    X = np.zeros(system.shape)
    X[:, 0] = mean
    found = correct(system, X, omega, most=40, line_search=True, tolerance=1e-11)
    assert found.converged
    assert 0.1 < found.at.shares[..., 1].mean() < 0.9
    assert np.abs(found.X - wave).max() < 1e-7 * np.abs(wave).max()
    rows = tuned.system(PRELOAD).response(y[:-1])
    np.testing.assert_allclose(w.response(wave)[0], rows, rtol=1e-9, atol=1e-12 * np.abs(rows).max())


def test_the_static_state_of_dampers_that_are_alike_is_that_of_the_study():
    w = wheel(5, 1)
    ones = np.ones(5)
    alike = DamperVariation(ones, ones, ones, 0.0 * ones, np.zeros(5, bool))
    (system, mean), (other, found) = w.system(PRELOAD), w.with_(dampers=alike).system(PRELOAD)
    assert np.abs(found - mean).max() < 1e-8 * np.abs(mean).max()
    slip = np.abs(system.contact.points.slider - other.contact.points.slider)
    assert slip.max() < 1e-8 * np.abs(system.contact.points.slider).max()


def test_a_missing_damper_leaves_its_place_empty():
    rng = np.random.default_rng(5)
    gone = np.arange(6) == 2
    mass, mu, stiffness, gap = rng.random((4, 6))
    dampers = DamperVariation(1.0 + 0.2 * mass, 1.0 + 0.1 * mu, 1.0 - 0.2 * stiffness, 1e-7 * gap, gone)
    w = wheel(6, 1).with_(dampers=dampers, mistuning=0.01 * rng.normal(size=6))
    system, mean = w.system(PRELOAD)
    X = np.zeros(system.shape)
    X[:, 0] = mean
    found = correct(system, X, 2.0 * np.pi * 190.0, most=40, line_search=True)
    assert found.converged
    n = w.structure.n
    F = system.forces(found.X)[0]
    assert not found.X[2, :, n:].any() and not F[2].any()
    assert F[[1, 3]].any(axis=(1, 2, 3)).all()
    balance = F[..., 0].reshape(6, -1) @ w.structure.rows[..., n:].reshape(-1, 6)
    load = system.force[:, 0, n:]
    assert np.abs(balance - load).max() < 1e-8 * np.abs(load).max()
    assert load[0].max() > 0.0 and load[2].max() == 0.0


def test_one_workspace_for_each_thread_whatever_the_preloads(monkeypatch):
    """The elimination's memory is shared by all preloads, belongs to one thread, and goes with it and with the wheel."""
    alive, core = weakref.WeakSet(), constants.Elimination

    class Counted:
        def __init__(self, *arguments):
            self.core = core(*arguments)
            alive.add(self)

        def __getattr__(self, name):
            return getattr(self.core, name)

    monkeypatch.setattr(constants, "Elimination", Counted)

    def eliminate(w, preload):
        system, mean = w.system(preload)
        X = np.zeros(system.shape)
        X[:, 0] = mean
        system.linearised(X, 700.0).inverse()(X)
        return len(alive)

    w = wheel(3, 1)
    assert [eliminate(w, preload) for preload in np.linspace(100.0, 400.0, 30)] == [1] * 30
    with ThreadPoolExecutor(1) as pool:
        assert [pool.submit(eliminate, w, preload).result() for preload in (200.0, 300.0)] == [2, 2]
    assert len(alive) == 1
    one, none = np.ones(3), np.zeros(3)
    varied = DamperVariation(np.array([1.0, 1.1, 0.9]), one, one, none, none > 0.0)
    assert eliminate(w.with_(dampers=varied), 300.0) == 2  # that of the static state is gone, too
    assert len(alive) == 1
    del w
    assert not alive
