"""Residual and Jacobian of the harmonic balance equations against the NumPy oracle and finite differences."""

import re
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from numpy.random import default_rng
from numpy.testing import assert_array_equal

import bdamper as bd
from bdamper import _core
from tests import models, oracle
from tests.cases import PLAIN, SAMPLED, difference, evaluate_system, for_oracle, random_arrays
from tests.compare import assert_near
from tests.each import each
from tests.plain import plain_study

LAYOUTS = {
    "H=1": {"n_mode": (3, 4), "n_point": 4},
    "H=2, a harmonic without modes": {"n_mode": (2, 3, 0), "n_point": 3},
    "H=3, no mean, massless modes": {"n_mode": (0, 3, 2, 2), "n_point": 3, "massless": 1},
    "H=3, constraint points": {"n_mode": (2, 2, 3, 1), "n_point": 5, "constraint_points": 2},
    "H=5": {"n_mode": (2, 2, 2, 1, 2, 2), "n_point": 2, "massless": 1, "constraint_points": 1},
    "H=7": {"n_mode": (1, 2, 1, 2, 0, 2, 1, 2), "n_point": 2},
    "without contact": {"n_mode": (2, 3), "n_point": 0},
}


@pytest.mark.parametrize("name", LAYOUTS)
def test_residual_is_that_of_the_oracle(name):
    rng = default_rng(1)
    for _ in range(4):
        arrays = random_arrays(rng, **LAYOUTS[name])
        system = _core.SectorEquations(**arrays)
        u, omega = rng.normal(size=system.n_unknown), rng.uniform(0.3, 2.0)
        r, _, _ = evaluate_system(system, u, omega)
        expected = oracle.residual(u, omega, for_oracle(arrays))
        assert_near(r, expected, 1e-11 * max(1.0, np.abs(expected).max()))


@pytest.mark.parametrize("evaluation", [SAMPLED, PLAIN])
def test_sampled_residual_is_that_of_the_oracle(evaluation):
    rng = default_rng(2)
    arrays = random_arrays(rng, (2, 3, 0, 2), 4, constraint_points=1)
    system = _core.SectorEquations(**arrays, evaluation=evaluation, n_time=96)
    u = rng.normal(size=system.n_unknown)
    r, _, _ = evaluate_system(system, u, 0.8)

    def law(*a):
        return oracle.contact_sampled(*a, 96, evaluation == SAMPLED)

    assert_near(r, oracle.residual(u, 0.8, for_oracle(arrays), law), 1e-11)


@pytest.mark.parametrize("name", LAYOUTS)
def test_derivatives(name):
    """To 1e-7 of the largest entry; a state with an event within the step is recognised by a second step length."""
    rng = default_rng(3)
    compared = 0
    for _ in range(40):
        arrays = random_arrays(rng, **LAYOUTS[name])
        system = _core.SectorEquations(**arrays)
        u, omega = rng.normal(size=system.n_unknown), rng.uniform(0.3, 2.0)
        _, J, r_omega = evaluate_system(system, u, omega)
        coarse, fine = (
            difference(lambda z: evaluate_system(system, z, omega)[0], u, h) for h in (1e-5, 3e-6)
        )
        assert np.abs(J).max() > 0.1
        by_omega = difference(lambda w: evaluate_system(system, u, w[0])[0], np.array([omega]))[
            :, 0
        ]
        assert_near(r_omega, by_omega, 1e-8 * (1 + np.abs(by_omega).max()))
        assert arrays["n_mode"][1:].sum() == 0 or np.abs(r_omega).max() > 0
        if np.abs(coarse - fine).max() > 1e-8 * np.abs(J).max():
            continue
        assert not np.array_equal(J, fine)
        assert_near(J, fine, 1e-7 * np.abs(J).max())
        compared += 1
        if compared == 6:
            break
    assert compared >= 4


def test_contact_gives_the_forces_in_the_residual():
    rng = default_rng(5)
    arrays = random_arrays(rng, (2, 3, 2), 4, constraint_points=1)
    system = _core.SectorEquations(**arrays)
    u = rng.normal(size=system.n_unknown)
    X, F, share = np.full((4, 3, 5), np.nan), np.full((4, 3, 5), np.nan), np.full((4, 5), np.nan)
    assert system.contact(np.append(u, 1.0), X, F, share) == 0
    o = for_oracle(arrays)
    assert_near(X, oracle.motions(u[None], o)[0], 1e-13)
    for p in range(4):
        expected = oracle.contact(X[p], o["kt"][p], o["kn"][p], o["mu"][p], o["n0"][p], o["w"][p])
        assert_near(F[p], expected, 1e-11)


def test_arguments_are_copied():
    rng = default_rng(6)
    arrays = random_arrays(rng, (2, 3), 3)
    system = _core.SectorEquations(**arrays)
    u = rng.normal(size=system.n_unknown)
    before = evaluate_system(system, u, 1.0)[0]
    for value in arrays.values():
        value[...] = 7
    assert_array_equal(evaluate_system(system, u, 1.0)[0], before)


GOOD = random_arrays(default_rng(7), (2, 3), 3)


def changed(array, index, value):
    out = array.copy()
    out.flat[index] = value
    return out


def spoiled(arrays):
    """Each array with numbers of another type, in another shape, and with a number that it may not have."""
    for name, value in arrays.items():
        yield name, value.astype("c8")
        yield name, value[None]
        if name not in ("n_mode", "kn"):  # these arrays give the numbers of modes and points
            yield name, value.ravel()[:-1].copy()
        for bad in {"n_mode": [-3], "law": [7], "w": [np.nan]}.get(name, [np.nan, np.inf]):
            yield name, changed(value, -1, bad)
        if name in ("stiffness", "mass", "damping", "kt", "kn", "mu"):
            yield name, changed(value, 0, -1.0)


@each(
    ("name", "value"),
    [
        *spoiled(GOOD),
        ("n_mode", [2, 3]), ("kt", np.asfortranarray(GOOD["kt"])), ("row_scale", np.ones(7)), ("row_scale", np.zeros(8)),
        ("evaluation", 3), ("evaluation", -1),
    ],
)  # fmt: skip
def test_wrong_arguments_are_named(name, value):
    with pytest.raises((TypeError, ValueError), match=rf"^{name}: expected"):
        _core.SectorEquations(**{**GOOD, name: value})


@each(
    ("arguments", "message"),
    [
        ({"evaluation": 1, "n_time": 4}, "n_time: expected 8 to"),
        ({"n_time": 64}, r"n_time: expected 0 with evaluation 0 \(exact\), found 64$"),
        ({"n_mode": np.array([2], np.intc)}, "number of harmonics: expected 1 to 64, found 0"),
        ({"n_mode": np.zeros(2, np.intc)}, "n_mode: expected 1 to 30000 unknowns"),
    ],
)
def test_sizes_are_checked(arguments, message):
    with pytest.raises(ValueError, match=f"^{message}"):
        _core.SectorEquations(**{**GOOD, **arguments})


SOLVE = {
    "y": np.ones(9), "tangent": np.zeros(9), "scale": np.ones(9), "tolerance": 1e-9, "max_iterations": 10,
    "row": np.ones(9),
}  # fmt: skip
PEAK = {
    "y": np.ones(9), "tangent": np.ones(9) / 3, "scale": np.ones(9), "re": np.ones(8), "im": np.zeros(8), "tolerance": 1e-9,
    "max_iterations": 10, "curvature": -1.0, "place_tolerance": 1e-6, "max_step": 0.1,
}  # fmt: skip
FOLD = {name: value for name, value in PEAK.items() if name not in ("re", "im")}
EVALUATE = {"y": np.ones(9), "r": np.zeros(8), "J": np.zeros((8, 8)), "C": np.zeros(8)}
BORDERED = {"y": np.ones(9), "row": np.ones(9), "scale": np.ones(9), "b": np.ones((2, 9))}
CONTACT = {
    "y": np.ones(9),
    "X": np.zeros((3, 3, 3)),
    "F": np.zeros((3, 3, 3)),
    "share": np.zeros((3, 5)),
}
CALLS = {
    "solve": SOLVE,
    "peak": PEAK,
    "fold": FOLD,
    "evaluate": EVALUATE,
    "bordered": BORDERED,
    "contact": CONTACT,
}
METHODS = {name: name for name in CALLS} | {"peak": "solve", "fold": "solve"}
OUTPUTS = dict.fromkeys(("solve", "peak", "fold"), ("y", "tangent"))
OUTPUTS |= {"evaluate": ("r", "J", "C"), "bordered": ("b",), "contact": ("X", "F", "share")}


def call(name, arguments):
    """One method with copies of its arguments; contact takes them by place only."""
    if name == "sector":
        return _core.SectorEquations(**{**GOOD, **arguments})
    function = getattr(_core.SectorEquations(**GOOD), METHODS[name])
    return function(*arguments.values()) if name == "contact" else function(**arguments)


def copies(arguments):
    return {
        name: value.copy() if isinstance(value, np.ndarray) else value
        for name, value in arguments.items()
    }


def sharing():
    """Every output of every method with every other array."""
    for method, outputs in OUTPUTS.items():
        arrays = [name for name, value in CALLS[method].items() if isinstance(value, np.ndarray)]
        for i, first in enumerate(arrays):
            yield from (
                (method, first, second)
                for second in arrays[i + 1 :]
                if first in outputs or second in outputs
            )


@each(("method", "first", "second"), list(sharing()))
def test_outputs_that_share_memory_are_refused(method, first, second):
    arguments = copies(CALLS[method])
    assert call(method, dict(arguments)) is not None
    a, b = arguments[first], arguments[second]
    memory = np.zeros(a.size + b.size - 1)  # they have one number in common
    for view, name in ((memory[: a.size], first), (memory[a.size - 1 :], second)):
        shape = arguments[name].shape
        view[...] = 1.0
        arguments[name] = view.reshape(shape)
        assert np.shares_memory(arguments[name], memory)
    before = memory.copy()
    with pytest.raises(
        ValueError,
        match=rf"^{second}: expected a separate array, found memory shared with {first}$",
    ):
        call(method, arguments)
    assert_array_equal(memory, before)


def test_inputs_may_share_memory_and_outputs_may_touch():
    system, memory = _core.SectorEquations(**GOOD), np.ones(17)
    assert system.evaluate(memory[:9], memory[9:]) == 0
    same = np.full(9, 0.5)
    assert system.solve(**{**copies(PEAK), "scale": same, "re": same[:8]}).status >= 0


@each(
    ("method", "name", "value", "expected"),
    [
        ("solve", "tolerance", np.nan, "a finite positive number, found nan"),
        ("solve", "tolerance", 0.0, "a finite positive number, found 0.0"),
        ("solve", "reach", -1.0, "a finite non-negative number, found -1.0"),
        ("solve", "max_iterations", -1, "at least 0, found -1"),
        ("solve", "line_search", 99, "0, 1 or 2, found 99"),
        ("solve", "line_search", -1, "0, 1 or 2, found -1"),
        ("fold", "curvature", np.nan, "a finite number, found nan"),
        ("peak", "tolerance", np.inf, "a finite positive number, found inf"),
        ("peak", "max_iterations", -1, "at least 0, found -1"),
        ("peak", "curvature", 0.0, "a finite negative number, found 0.0"),
        ("peak", "curvature", np.nan, "a finite negative number, found nan"),
        ("peak", "place_tolerance", np.nan, "a finite positive number, found nan"),
        ("peak", "max_step", -1.0, "a finite positive number, found -1.0"),
        *(
            (method, name, changed(np.ones(n), 3, value), f"finite positive numbers, found {value} at flat index 3")
            for name, n, methods in (("scale", 9, ("solve", "peak", "fold", "bordered")), ("row_scale", 8, ("sector",)))
            for method in methods
            for value in (0.0, -1.0, np.nan, np.inf)
        ),
        *(
            (method, name, changed(CALLS[method][name], 2, np.nan), "finite numbers, found nan at flat index 2")
            for method, name in (("solve", "row"), ("bordered", "row"), ("peak", "re"), ("peak", "im"))
        ),
        *((method, "tangent", changed(np.ones(9), 2, np.nan), "finite numbers, found nan at flat index 2")
          for method in ("peak", "fold")),
        *(("solve", name, np.zeros(3), "shape (9,), found (3,)") for name in ("y", "tangent", "scale", "row")),
    ],
)  # fmt: skip
def test_wrong_numbers_are_named(method, name, value, expected):
    with pytest.raises(ValueError, match=rf"^{name}: expected {re.escape(expected)}$"):
        call(method, {**CALLS.get(method, {}), name: value})


@pytest.mark.parametrize(
    ("method", "names"),
    [("solve", ("row", "re", "im")), ("solve", ("row", "im")), ("peak", ("im",))],
)
def test_conditions_of_two_kinds_are_refused(method, names):
    given = {**CALLS[method], "row": SOLVE["row"], "re": PEAK["re"], "im": PEAK["im"]}
    chosen = {k: v for k, v in given.items() if k in names or k not in ("row", "re", "im")}
    with pytest.raises(
        ValueError, match=r"^row, re, im: expected row alone, re and im, or none of them$"
    ):
        _core.SectorEquations(**GOOD).solve(**chosen)


@pytest.mark.parametrize(
    ("name", "value", "error", "expected"),
    [
        ("sector", GOOD, TypeError, "must be bdamper._core.SectorEquations"),
        ("omega", np.nan, ValueError, "^omega: expected a finite number, found nan"),
        ("ramp", np.zeros(2), ValueError, r"^ramp: expected shape \(8,\)"),
        ("ramp", np.full(8, np.nan), ValueError, "^ramp: expected finite numbers"),
        ("support", np.zeros((8, 2)), ValueError, r"^support: expected shape \(8, 8\)"),
        ("support", np.full((8, 8), np.inf), ValueError, "^support: expected finite numbers"),
    ],
)
def test_wrong_arguments_of_eased_equations_are_named(name, value, error, expected):
    good = {
        "sector": _core.SectorEquations(**GOOD),
        "omega": 1.0,
        "ramp": np.ones(8),
        "support": np.eye(8),
    }
    _core.Eased(**good)
    with pytest.raises(error, match=expected):
        _core.Eased(**{**good, name: value})


def test_contact_forces_that_are_not_finite_are_an_error():
    study = plain_study(models.wedge_model(1), bd.Excitation("tip"), engine_order=2)
    equations = study.problem.system(10.0)
    with pytest.raises(FloatingPointError, match="contact forces are not finite"):
        equations.contact(np.full(equations.n_unknowns, np.nan))


def run_together(work, n_threads=4):
    with ThreadPoolExecutor(n_threads) as pool:
        list(pool.map(work, range(n_threads)))


@pytest.mark.parametrize("shared", [True, False], ids=["one system", "a system for each thread"])
def test_threads_give_the_serial_results(shared):
    rng = default_rng(8)
    arrays = random_arrays(rng, (3, 4, 3), 300)  # long enough for the threads to meet
    n_threads, n_states = 4, 12
    systems = (
        [_core.SectorEquations(**arrays)] * n_threads
        if shared
        else [_core.SectorEquations(**arrays) for _ in range(n_threads)]
    )
    states = rng.normal(size=(n_states, systems[0].n_unknown))
    serial = [evaluate_system(systems[0], u, 0.9) for u in states]
    found = [[None] * n_states for _ in range(n_threads)]

    def work(i):
        for k in default_rng(i).permutation(n_states):
            found[i][k] = evaluate_system(systems[i], states[k], 0.9)

    run_together(work, n_threads)
    for results in found:
        for a, b in zip(results, serial):
            for one, other in zip(a, b):
                assert_array_equal(one, other)


def test_corrector_in_threads_gives_the_serial_results():
    rng = default_rng(9)
    system = _core.SectorEquations(**random_arrays(rng, (2, 3), 6))
    n = system.n_unknown
    at_frequency = np.append(np.zeros(n), 1.0)
    starts = rng.normal(size=(12, n + 1)) * 0.1
    starts[:, -1] = np.linspace(0.5, 2.0, 12)

    def solve(k):
        y, tangent = starts[k].copy(), np.zeros(n + 1)
        out = system.solve(y, tangent, np.ones(n + 1), 1e-10, 40, True, row=at_frequency)
        return out.status, y, tangent

    serial = [solve(k) for k in range(12)]
    assert sum(status == 0 for status, _, _ in serial) >= 6

    def work(i):
        for k in range(12):
            status, y, tangent = solve(k)
            assert status == serial[k][0]
            assert_array_equal(y, serial[k][1])
            if status == 0:
                assert_array_equal(tangent, serial[k][2])

    run_together(work)


def test_cost_is_counted():
    system = _core.SectorEquations(**GOOD)
    evaluate_system(system, np.zeros(8), 1.0)
    system.evaluate(np.ones(9), np.zeros(8))
    cost = system.cost
    assert (cost.evaluations, cost.jacobians, cost.factorisations, cost.least_norm) == (2, 1, 0, 0)
    assert min(cost.contact, cost.assembly, cost.processor) >= 0.0 == cost.algebra


def test_threads_count_together():
    """No call is lost or counted twice, and no part takes less than no time."""
    rng = default_rng(10)
    system = _core.SectorEquations(**random_arrays(rng, (3, 4, 3), 300))
    n = system.n_unknown
    y = rng.normal(size=n + 1)

    def work(i):
        for k in range(20):
            before = system.cost
            system.evaluate(y, np.empty(n), np.empty((n, n)) if k % 2 else None)
            assert all(now >= then for now, then in zip(system.cost, before))

    run_together(work, 4)
    assert (system.cost.evaluations, system.cost.jacobians) == (80, 40)
