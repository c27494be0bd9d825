"""Contact laws as functions in the core: against ours, a plain oracle of the periodic state, and finite differences."""

import ctypes

import numpy as np
import pytest
from numpy.random import default_rng
from numpy.testing import assert_array_equal
from scipy import LowLevelCallable

from bdamper import _core
from tests import oracle
from tests.cases import SAMPLED, Point, difference, evaluate, random_motion, random_point
from tests.compare import assert_near

USER = 7
NUMBER = ctypes.POINTER(ctypes.c_double)
CALL = ctypes.CFUNCTYPE(None, *[NUMBER] * 10, ctypes.c_void_p)


def own(x, function, parameters, memory, evaluation=SAMPLED, n_time=128, kn=0.0, n0=0.0):
    """Force and tangent of one point with a law of its own."""
    x = np.ascontiguousarray(x, float)
    force, tangent = np.full(x.shape, np.nan), np.full(x.shape + x.shape, np.nan)
    law = (function, np.array(parameters, float), np.array(memory, float))
    zero = np.zeros(2)
    shares, _ = _core.evaluate_contact(
        x, zero, kn, 0.0, n0, zero, force, tangent, USER, evaluation, n_time, own=(law,)
    )
    return force, tangent, np.array(shares)


def pointer(law, n_state):
    """A function pointer that does law(x, before, s0) -> (s1, F, Fx, Fs, sx, ss)."""

    def call(x, before, p, s0, s1, F, Fx, Fs, sx, ss, data):
        given = [np.ctypeslib.as_array(a, (3,)) for a in (x, before)]
        found = law(
            *given, np.ctypeslib.as_array(s0, (n_state,)).copy() if n_state else np.zeros(0)
        )
        shapes = ((n_state,), (3,), (3, 3), (3, n_state), (n_state, 6), (n_state, n_state))
        for to, shape, value in zip((s1, F, Fx, Fs, sx, ss), shapes, found):
            if to and np.prod(shape):
                np.ctypeslib.as_array(to, shape)[...] = value

    return LowLevelCallable(CALL(call))


def close(found, expected, tolerance, size=None):
    size = np.abs(expected).max() if size is None else size
    assert_near(found, expected, tolerance * size)


class TestOursAsAFunction:
    def test_one_jenkins_element_is_ours(self):
        """A slider that the first period moves and that then rests has the derivative of its settling."""
        rng = default_rng(8)
        rests = 0
        for _ in range(200):
            point, x = random_point(rng), random_motion(rng, 2)
            k = point.kt[0]
            ours = evaluate(
                x, Point(np.full(2, k), point.kn, point.mu, point.n0, point.w), SAMPLED, 64
            )
            force, tangent, _ = own(
                x,
                _core.jenkins,
                [1, point.kn, k, 0, point.mu],
                [0, 0, 0, *point.w],
                n_time=64,
                kn=point.kn,
                n0=point.n0,
            )
            size = max(k, point.kn)
            close(force, ours.force, 1e-13, size * np.abs(x).max())
            close(tangent, ours.tangent, 1e-13, size)
            rests += ours.shares[0] == 1.0 and np.abs(ours.tangent[0, :, 2]).max() > 0.0
        assert rests > 3


def jenkins_forces(x, p, memory):
    """(n_time, 3) forces of independent sliders at motions x (n_time, 3), followed until nothing changes."""
    k, f = np.array(p[2:]).reshape(-1, 3)[:, :2].T
    s = np.array(memory[3:]).reshape(2, -1)
    F = np.zeros((len(x), 3))
    for _ in range(3):
        for i, at in enumerate(x):
            s = np.clip(s, (at[:2, None] - f / k), (at[:2, None] + f / k))
            F[i, :2] = (k * (at[:2, None] - s)).sum(axis=1)
    F[:, 2] = np.maximum(p[1] * x[:, 2], 0.0)
    return F


def bouc_wen_forces(x, p, memory, periods=300, parts=4):
    """The same of Bouc-Wen: each step by the trapezoidal rule, its equation solved by bisection."""
    kn, k, alpha, beta, gamma, n = p

    def rate(z, sense):
        return 1 - np.abs(z) ** n * (gamma + beta * np.where(sense * z < 0.0, -1.0, 1.0))

    z, before = np.array(memory[3:]), x[-1, :2]
    F = np.zeros((len(x), 3))
    for _ in range(periods):
        last = z
        for i, at in enumerate(x):
            h = (at[:2] - before) / parts
            for _ in range(parts):
                target = z + 0.5 * h * rate(z, h)
                low, high = target - np.abs(h) * 2 - 1, target + np.abs(h) * 2 + 1
                for _ in range(70):
                    middle = 0.5 * (low + high)
                    below = middle - 0.5 * h * rate(middle, h) < target
                    low, high = np.where(below, middle, low), np.where(below, high, middle)
                z = 0.5 * (low + high)
            before = at[:2]
            F[i, :2] = alpha * k * at[:2] + (1 - alpha) * k * z
        if np.abs(z - last).max() < 1e-14:
            break
    F[:, 2] = np.maximum(kn * x[:, 2], 0.0)
    return F


LAWS = {
    "jenkins": (
        _core.jenkins, [4, 1.2, *np.column_stack([[0.5, 0.4, 0.3, 0.2], [0.05, 0.2, 0.4, 2.0], np.zeros(4)]).ravel()], 8,
        jenkins_forces,
    ),
    "bouc-wen": (_core.bouc_wen, [1.5, 2.0, 0.1, 0.8, 0.3, 1.0], 2, bouc_wen_forces),
    "bouc-wen, rounder": (_core.bouc_wen, [1.5, 2.0, 0.1, 0.8, -0.3, 2.5], 2, bouc_wen_forces),
}  # fmt: skip


@pytest.mark.parametrize("name", LAWS)
class TestShipped:
    def motion(self, seed, harmonics=2):
        x = random_motion(default_rng(seed), harmonics)
        x[2, 0] += 6.0  # closed
        return x

    @pytest.mark.slow
    def test_the_periodic_state_is_that_of_plain_sliders(self, name):
        function, p, n_state, forces = LAWS[name]
        x, n_time = self.motion(3), 32
        b = oracle.basis(2 * np.pi * np.arange(n_time) / n_time, 2)
        memory = np.zeros(3 + n_state)
        expected = forces((b @ x.T), p, memory).T @ b * np.array([1, 2, 2, 2, 2]) / n_time
        force, _, _ = own(x, function, p, memory, n_time=n_time)
        close(force, expected, 1e-11)

    def test_tangent_by_finite_differences(self, name):
        function, p, n_state, _ = LAWS[name]
        for seed in range(3):
            x = self.motion(seed)
            _, tangent, _ = own(x, function, p, np.zeros(3 + n_state))
            expected = difference(lambda y: own(y, function, p, np.zeros(3 + n_state))[0], x, 1e-6)
            close(tangent, expected, 1e-7)

    def test_a_step_by_finite_differences(self, name):
        function, p, n_state, _ = LAWS[name]
        rng = default_rng(4)
        memory = np.concatenate([rng.normal(size=3), 0.3 * rng.normal(size=n_state)])[None]

        def step(x):
            after, F, D = np.empty_like(memory), np.empty((1, 3)), np.empty((1, 3, 3))
            _core.step_laws(((function, np.array(p, float), memory[0]),), x, memory, after, F, D)
            return F[0], D[0], after[0]

        for _ in range(5):
            x = rng.normal(size=(1, 3))
            close(step(x)[1], difference(lambda y: step(y)[0], x)[:, 0], 1e-8, 1.0)
            assert_array_equal(step(x)[2][:3], x[0])

    def test_a_step_of_no_length_changes_nothing(self, name):
        function, p, n_state, _ = LAWS[name]
        memory, after = np.zeros((1, 3 + n_state)), np.empty((1, 3 + n_state))
        F, D = np.empty((1, 3)), np.empty((1, 3, 3))
        law = ((function, np.array(p, float), memory[0]),)
        x = np.array([[0.6, -0.4, 0.2]])
        _core.step_laws(law, x, memory, after, F, D)
        once, force = after.copy(), F.copy()
        _core.step_laws(law, x, once, after, F, D)
        close(after, once, 1e-15)
        close(F, force, 1e-15)


def test_small_motions_of_bouc_wen_settle():
    """Mean forces fade by a part in a thousand a period, which plain periods follow for thousands of them."""
    x = np.zeros((3, 3))
    x[0, 1] = x[1, 2] = 0.01
    p = [0.0, 1.0, 0.0, 0.02, 0.01, 1.0]
    force, tangent, _ = own(x, _core.bouc_wen, p, [0, 0, 0, 0.5, -0.3])
    assert (
        abs(force[0, 0]) < 1e-12 and abs(force[1, 0]) < 1e-12
    )  # by symmetry the initial state has no effect
    assert np.isfinite(tangent).all()


def test_what_does_not_settle_is_not_a_number():
    def drifts(x, before, s0):
        return (
            s0 + 1.0,
            np.array([s0[0], 0.0, 0.0]),
            np.zeros((3, 3)),
            np.eye(3)[:, :1],
            np.zeros((1, 6)),
            np.eye(1),
        )

    force, _, _ = own(np.ones((3, 3)), pointer(drifts, 1), [], np.zeros(4), n_time=8)
    assert np.isnan(force).all()


def test_all_blocks_of_the_tangent():
    """A law without state, whose forces depend on all three motions, the normal force on the tangential ones."""
    A = np.arange(1.0, 10.0).reshape(3, 3)

    def quadratic(x, before, s0):
        return (
            s0,
            A @ x + x[0] * x,
            A + x[0] * np.eye(3) + np.outer(x, [1, 0, 0]),
            *[np.zeros((3, 0))] * 3,
        )

    x = random_motion(default_rng(1), 1)
    law = pointer(quadratic, 0)
    _, tangent, _ = own(x, law, [], np.zeros(3), n_time=16)
    close(tangent, difference(lambda y: own(y, law, [], np.zeros(3), n_time=16)[0], x), 1e-9)


@pytest.mark.parametrize(
    ("laws", "message"),
    [
        (None, "own: expected a function for each point with law 7"),
        ((None,), "own: expected a function for each point with law 7"),
        ((1, 2), "tuple of 1 laws"),
        ((("f", np.zeros(1), np.zeros(3)),), "expected a capsule"),
        (((_core.jenkins, np.zeros(1, int), np.zeros(3)),), "parameters as a vector"),
        (((_core.jenkins, np.full(1, np.nan), np.zeros(3)),), "parameters: expected"),
        (((_core.jenkins, np.zeros(1), np.zeros(2)),), "memory as a vector of at least 3"),
    ],
)
def test_what_is_no_law_is_refused(laws, message):
    x = np.zeros((3, 3))
    with pytest.raises((TypeError, ValueError), match=message):
        _core.evaluate_contact(
            x,
            np.ones(2),
            1.0,
            0.0,
            0.0,
            np.zeros(2),
            np.empty_like(x),
            np.empty((3, 3, 3, 3)),
            USER,
            SAMPLED,
            16,
            own=laws,
        )


def test_the_exact_evaluation_has_none():
    x = np.zeros((3, 3))
    law = ((_core.bouc_wen, np.ones(6), np.zeros(5)),)
    with pytest.raises(ValueError, match="law: expected 0 to 6"):
        _core.evaluate_contact(
            x,
            np.ones(2),
            1.0,
            0.0,
            0.0,
            np.zeros(2),
            np.empty_like(x),
            np.empty((3, 3, 3, 3)),
            USER,
            0,
            0,
            own=law,
        )
