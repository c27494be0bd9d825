"""Contact laws beside the separable one: coupled, constant load, normal alone, bonded; all against independent answers."""

from __future__ import annotations

import numpy as np
import pytest

from bdamper import _core
from tests import oracle
from tests.each import each

SEPARABLE, NORMAL, CONSTANT, COUPLED, COUPLED_CONSTANT, BONDED = range(6)
EXACT, SAMPLED, PLAIN = range(3)
SERVED = [(law, EXACT) for law in (SEPARABLE, NORMAL, CONSTANT, BONDED)] + [
    (law, evaluation) for law in range(6) for evaluation in (SAMPLED, PLAIN)
]


def evaluate(x, kt, kn, mu, n0, w, law, contact_forces=SAMPLED, n_time=64, load=None):
    x = np.ascontiguousarray(x, float)
    force, tangent = np.full(x.shape, np.nan), np.full(x.shape + x.shape, np.nan)
    shares, parts = _core.evaluate_contact(
        x, np.asarray(kt, float), kn, mu, n0, np.array(w, float), force, tangent, law, contact_forces,
        n_time if contact_forces else 0, n0 if load is None else load,
    )  # fmt: skip
    return force, tangent, np.array(shares), parts


def random_state(rng, harmonics):
    x = rng.normal(size=(3, 2 * harmonics + 1)) * np.exp(0.7 * rng.normal(size=(3, 1)))
    x[:, 1:] /= np.repeat(np.arange(1, harmonics + 1), 2)
    return x, {
        "kt": np.exp(0.5 * rng.normal(size=2)),
        "kn": float(np.exp(0.5 * rng.normal())),
        "mu": float(rng.uniform(0.05, 1.2)),
        "n0": float(1.5 * rng.normal() + 0.5),
        "w": 0.3 * rng.normal(size=2),
        "load": float(rng.normal() + 1.0),
    }


@each(("law", "contact_forces"), SERVED)
def test_forces_do_not_depend_on_where_a_body_has_moved(law, contact_forces):
    """Surface and slider 1e8 amplitudes away, in steps that doubles hold exactly: the same forces to the last digits."""
    rng = np.random.default_rng(40 + law)
    far = 2.0**27
    for _ in range(50):
        x, p = random_state(rng, 3)
        # sums with the distance are exact
        x[:2, 0] = np.round(x[:2, 0] * 2.0**20) / 2.0**20
        p["w"] = np.round(p["w"] * 2.0**20) / 2.0**20
        near = evaluate(x, law=law, contact_forces=contact_forces, **p)
        x[:2, 0] += far
        p["w"] = p["w"] + far
        away = evaluate(x, law=law, contact_forces=contact_forces, **p)
        for part in range(3):
            np.testing.assert_allclose(away[part], near[part], rtol=1e-12, atol=1e-13)


@pytest.mark.slow
@each(("law", "contact_forces"), SERVED)
def test_tangent_is_the_derivative_on_random_states(law, contact_forces):
    """Five thousand states over all laws and evaluations: a random direction each; a state whose finite difference
    straddles an event is asked again with a smaller step."""
    rng = np.random.default_rng(10 * law + contact_forces)
    straddled = nonlinear = 0
    for _ in range(315):
        x, p = random_state(rng, int(rng.choice([1, 1, 2, 3])))
        d = rng.normal(size=x.shape)
        _, tangent, shares, _ = evaluate(x, law=law, contact_forces=contact_forces, **p)
        assert np.isfinite(tangent).all()
        nonlinear += shares[1] > 0.0 or shares[3] > 0.0 or 0.0 < shares[4] < 1.0
        exact = np.einsum("aibj,bj->ai", tangent, d)
        for step, tolerance in ((1e-6, 1e-5), (1e-8, 1e-3), (1e-9, 1e-2)):
            plus, minus = (
                evaluate(x + s * d, law=law, contact_forces=contact_forces, **p)[0]
                for s in (step, -step)
            )
            error = np.abs((plus - minus) / (2 * step) - exact).max() / (1.0 + np.abs(exact).max())
            if error < tolerance:
                break
        straddled += step < 1e-6
        assert error < tolerance, (law, contact_forces, p, x.tolist())
    assert straddled <= 10
    assert nonlinear > 50 or law == BONDED


class TestConstantLoad:
    @pytest.mark.slow
    @pytest.mark.parametrize("harmonics", [1, 2, 4])
    def test_is_the_separable_law_without_normal_stiffness(self, harmonics):
        rng = np.random.default_rng(3)
        for _ in range(25):
            x, p = random_state(rng, harmonics)
            load = abs(p["load"])
            mine = evaluate(x, **{**p, "load": load}, law=CONSTANT, contact_forces=EXACT)
            expected = oracle.contact(x.copy(), p["kt"], 0.0, p["mu"], load, p["w"])
            np.testing.assert_allclose(mine[0][:2], expected[:2], rtol=0, atol=1e-11)
            normal = p["kn"] * x[2] + p["n0"] * (np.arange(x.shape[1]) == 0)
            np.testing.assert_allclose(mine[0][2], normal, rtol=0, atol=1e-14)

    def test_no_load_no_friction(self):
        x, p = random_state(np.random.default_rng(5), 2)
        for evaluation in (EXACT, SAMPLED):
            force, tangent, _, _ = evaluate(
                x, **{**p, "load": -1.0}, law=CONSTANT, contact_forces=evaluation
            )
            assert not force[:2].any()
            assert not tangent[:2].any()

    def test_sampled_converges_with_order_two(self):
        rng = np.random.default_rng(6)
        error = np.zeros(2)
        for _ in range(40):
            x, p = random_state(rng, 3)
            exact = evaluate(x, **p, law=CONSTANT, contact_forces=EXACT)[0]
            for i, n in enumerate((256, 2048)):
                error[i] += np.abs(evaluate(x, **p, law=CONSTANT, n_time=n)[0] - exact).max()
        assert error[0] > 0
        assert np.log(error[0] / error[1]) / np.log(8) > 1.8


class TestCoupled:
    @pytest.mark.parametrize("law", [COUPLED, COUPLED_CONSTANT])
    def test_steady_circular_motion(self, law):
        """Slider on the circle of radius sqrt(R^2 - b^2), work 2 pi mu N sqrt(R^2 - b^2), approached with order two."""
        kt, R, mu, N = 1.3, 0.8, 0.4, 2.0
        b = mu * N / kt
        x = np.zeros((3, 3))
        x[0], x[1] = [0.1, R, 0], [-0.2, 0, R]
        # u - w = b exp(i (theta + phi)), cos(phi) = b/R
        T = mu * N * np.exp(1j * np.arccos(b / R))
        expected = np.array([[0, T.real, -T.imag], [0, T.imag, T.real]])
        error = []
        for n in (64, 512):
            force, _, shares, _ = evaluate(x, [kt, kt], 5.0, mu, N, [0, 0], law, n_time=n, load=N)
            error.append(np.abs(force[:2] - expected).max())
            assert shares[1] == pytest.approx(1.0)
        assert error[1] < 1e-4
        assert np.log(error[0] / error[1]) / np.log(8) > 1.9
        work = np.pi * (x[0, 1] * -force[0, 2] + x[1, 2] * force[1, 1])
        assert work == pytest.approx(2 * np.pi * mu * N * np.sqrt(R**2 - b**2), rel=1e-4)

    @pytest.mark.slow
    @pytest.mark.parametrize("separation", [False, True])
    def test_force_is_that_of_the_projection_method(self, separation):
        """Against another discretisation of the law, extrapolated to small steps."""
        rng = np.random.default_rng(9)
        n, harmonics = 40, 2
        x = rng.normal(size=(n, 3, 5)) / np.array([1, 1, 1, 2, 2])
        kt, kn, mu = (
            np.exp(0.3 * rng.normal(size=n)),
            np.exp(0.3 * rng.normal(size=n)),
            rng.uniform(0.2, 0.8, n),
        )
        swing = np.abs(oracle.basis(np.linspace(0, 7, 200), harmonics) @ x[:, 2].T).max(axis=0) * kn
        n0 = swing * (rng.uniform(-0.3, 0.7, n) if separation else rng.uniform(1.05, 1.3, n))

        def load(theta):
            return np.maximum(
                n0[:, None] + kn[:, None] * (x[:, 2] @ oracle.basis(theta, harmonics).T), 0.0
            )

        coarse, fine = (
            oracle.coupled(x[:, :2], kt, mu, load, np.zeros((n, 2)), k, 16) for k in (512, 1024)
        )
        expected = 2.0 * fine - coarse
        results = [
            evaluate(x[i], [kt[i]] * 2, kn[i], mu[i], n0[i], [0, 0], COUPLED, n_time=1024)
            for i in range(n)
        ]
        slipping = [
            i for i in range(n) if results[i][2][1] > 0.15
        ]  # sixteen periods settle those that slip much
        assert len(slipping) > 20
        opened = np.mean([results[i][2][4] > 0 for i in slipping])
        assert (opened > 0.5) == separation
        for i in slipping:
            size = np.abs(expected[i]).max()
            np.testing.assert_allclose(results[i][0][:2], expected[i], rtol=0, atol=5e-3 * size)

    def test_turning_the_axes_turns_the_force(self):
        rng = np.random.default_rng(2)
        c, s = np.cos(0.7), np.sin(0.7)
        R = np.array([[c, -s], [s, c]])
        for _ in range(50):
            x, p = random_state(rng, 2)
            p["kt"][1] = p["kt"][0]
            y = np.vstack([R @ x[:2], x[2:]])
            a = evaluate(x, **p, law=COUPLED)[0]
            b = evaluate(y, **{**p, "w": R @ p["w"]}, law=COUPLED)[0]
            np.testing.assert_allclose(b[:2], R @ a[:2], rtol=0, atol=1e-10 * (1 + np.abs(a).max()))

    def test_time_shift_scaling_and_dissipation(self):
        rng = np.random.default_rng(4)
        for _ in range(60):
            x, p = random_state(rng, 2)
            p["w"] = x[:2, 0]  # moves along with the mean, whatever the phase
            force, _, shares, _ = evaluate(x, **p, law=COUPLED)
            delta = 2 * np.pi * 11 / 64
            shifted = evaluate(oracle.shift(x, delta), **p, law=COUPLED)[0]
            atol = 1e-9 * (1 + np.abs(force).max())
            np.testing.assert_allclose(shifted, oracle.shift(force, delta), rtol=0, atol=atol)
            double = evaluate(2 * x, **{**p, "n0": 2 * p["n0"], "w": 2 * p["w"]}, law=COUPLED)[0]
            np.testing.assert_allclose(double, 2 * force, rtol=0, atol=2 * atol)
            l = np.array([1, 2])
            force, _, shares, _ = evaluate(x, **p, law=COUPLED, n_time=2048)
            work = (
                np.pi * (l * (force[:2, 1::2] * x[:2, 2::2] - force[:2, 2::2] * x[:2, 1::2])).sum()
            )
            size = np.abs(force[:2]).max() * np.abs(x[:2]).max() + 1e-300
            assert work > -1e-4 * size
            assert work > 1e-3 * size or shares[1] < 0.2

    def test_points_at_rest_keep_an_admissible_slider(self):
        """From a slider that is admissible, itself; else the first admissible one on the way to the centre."""
        x = np.zeros((3, 3))
        x[0], x[1] = [0, 0.3, 0], [0, 0, 0.2]
        point = ([1.0, 1.0], 0.0, 0.5, 2.0)
        force, _, shares, _ = evaluate(x, *point, [0.2, -0.1], COUPLED, n_time=256)
        assert shares[0] == 1.0
        np.testing.assert_allclose(force[:2, 0], [-0.2, 0.1], atol=1e-14)
        for w in ([3.0, 0.0], [0.5, 2.0], [-1.0, 1.0]):
            force, _, shares, _ = evaluate(x, *point, w, COUPLED, n_time=256)
            slider = -force[:2, 0]
            np.testing.assert_allclose(
                slider / np.hypot(*slider), np.array(w) / np.hypot(*w), atol=1e-12
            )
            u = oracle.basis(2 * np.pi * np.arange(256) / 256, 1) @ x[:2].T
            assert np.hypot(*(u - slider).T).max() == pytest.approx(1.0, abs=1e-12)
            assert shares[0] == 1.0
            np.testing.assert_allclose(force[:2, 1:], x[:2, 1:], atol=1e-14)
        force = evaluate(x, *point, [3.0, 0.0], COUPLED, n_time=256)[0]
        np.testing.assert_allclose(
            force[:2, 0], [-0.7, 0.0], atol=1e-12
        )  # |u - w| = 1 where u = -0.3

    @pytest.mark.parametrize("law", [COUPLED, COUPLED_CONSTANT])
    def test_onset_of_slip(self, law):
        """From rounding to a tenth on both sides of the onset: finite, continuous, and the Jacobian is the derivative;
        that of the onset itself is the limit from the side of slip."""
        rng = np.random.default_rng(40 + law)
        name = "n0" if law == COUPLED else "load"
        distances = (0.0, *10.0 ** np.arange(-16.0, 0.0))
        jumps = []
        for _ in range(25):
            x, p = random_state(rng, int(rng.integers(1, 4)))
            d = rng.normal(size=x.shape)

            def at(n, x=x, p=p):
                return evaluate(x, **{**p, name: n}, law=law)

            slips, rests = 0.0, 1e4
            for _ in range(100):
                middle = 0.5 * (slips + rests)
                if at(middle)[2][0] < 1.0:
                    slips = middle
                else:
                    rests = middle
            if at(slips)[2][4] > 0.0:
                continue
            results = {s * e: at(rests * (1 + s * e)) for e in distances for s in (-1, 1)}
            for force, tangent, _, _ in results.values():
                assert np.isfinite(force).all()
                assert np.isfinite(tangent).all()
            there = results[0.0][0][:2]
            for e in (1e-4, 1e-6, 1e-8):
                for side in (-e, e):
                    near = min(results, key=lambda k: abs(k - side))
                    assert np.abs(results[near][0][:2] - there).max() < 1e3 * e * (
                        1 + np.abs(there).max()
                    )
            limit, beyond = (
                results[min(results, key=lambda k: abs(k + e))][1] for e in (1e-10, 1e-7)
            )
            jumps.append(np.abs(limit - beyond).max() / (1 + np.abs(beyond).max()))
            for e in (-1e-4, 1e-4):
                near = min(results, key=lambda k: abs(k - e))
                n, h = rests * (1 + near), 1e-8
                plus, minus = (evaluate(x + s * d, **{**p, name: n}, law=law)[0] for s in (h, -h))
                exact = np.einsum("aibj,bj->ai", results[near][1], d)
                np.testing.assert_allclose(
                    (plus - minus) / (2 * h), exact, rtol=0, atol=1e-4 * (1 + np.abs(exact).max())
                )
        assert len(jumps) > 15
        assert np.quantile(jumps, 0.8) < 1e-4


class TestLinearLaws:
    def test_bonded_points_are_springs_in_both_senses(self):
        x, p = random_state(np.random.default_rng(1), 2)
        for evaluation in (EXACT, SAMPLED):
            force, tangent, shares, parts = evaluate(x, **p, law=BONDED, contact_forces=evaluation)
            springs = np.array([*p["kt"], p["kn"]])
            expected = springs[:, None] * x
            expected[:, 0] += [*(-p["kt"] * p["w"]), p["n0"]]
            np.testing.assert_allclose(force, expected, atol=1e-14)
            flat = tangent.reshape(15, 15)
            np.testing.assert_array_equal(flat, np.diag(np.repeat(springs, 5)))
            np.testing.assert_array_equal(shares, [1, 0, 1, 0, 0])
            assert all(part == [(0.0, 2 * np.pi, 0)] for part in parts)

    def test_normal_alone_is_friction_without_coefficient(self):
        x, p = random_state(np.random.default_rng(1), 3)
        for evaluation in (EXACT, SAMPLED):
            normal = evaluate(x, **p, law=NORMAL, contact_forces=evaluation)
            frictionless = evaluate(x, **{**p, "mu": 0.0}, law=SEPARABLE, contact_forces=evaluation)
            np.testing.assert_array_equal(normal[0], frictionless[0])
            np.testing.assert_array_equal(normal[1], frictionless[1])
            assert not normal[0][:2].any()


@pytest.mark.parametrize("law", [SEPARABLE, CONSTANT])
@pytest.mark.parametrize("contact_forces", [EXACT, SAMPLED])
def test_ends_of_the_interval_of_residual_tractions(law, contact_forces):
    """An infinite slider is carried to the end of the interval; beyond it the point would slip."""
    x = np.array([[0.1, 0.2, 0.1], [0.0, 0.1, -0.1], [0.0, 0.2, -0.1]])
    point = ([1.0, 2.0], 1.0, 0.5, 3.0)
    theta = np.linspace(0, 2 * np.pi, 4097)
    u, v = (oracle.basis(theta, 1) @ x[i] for i in (0, 2))
    reach = 0.5 * (3.0 + (v if law == SEPARABLE else 0.0))
    ends = (u - reach).max(), (u + reach).min()
    n = 4096
    for far, end in zip((-np.inf, np.inf), ends):
        force, _, shares, _ = evaluate(x, *point, [far, 0.0], law, contact_forces, n)
        assert shares[0] == pytest.approx(1.0)
        assert force[0, 0] == pytest.approx(0.1 - end, abs=1e-6)
        inner = evaluate(x, *point, [end - 1e-3 * np.sign(far), 0.0], law, contact_forces, n)[0]
        assert inner[0, 0] == pytest.approx(0.1 - end + 1e-3 * np.sign(far), abs=1e-6)


class TestRefusals:
    def test_coupled_laws_have_no_exact_evaluation(self):
        x, p = random_state(np.random.default_rng(0), 1)
        for law in (COUPLED, COUPLED_CONSTANT):
            with pytest.raises(
                ValueError, match=r"^law: the coupled laws .* have no exact evaluation"
            ):
                evaluate(x, **p, law=law, contact_forces=EXACT)

    @pytest.mark.parametrize("law", [NORMAL, COUPLED, COUPLED_CONSTANT, BONDED])
    def test_infinite_sliders_only_where_there_is_an_interval(self, law):
        x, p = random_state(np.random.default_rng(0), 1)
        with pytest.raises(ValueError, match=r"^w: expected finite numbers"):
            evaluate(x, **{**p, "w": [np.inf, 0.0]}, law=law)
