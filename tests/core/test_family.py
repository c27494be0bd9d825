"""Equations as functions of speed: against plain equations whose arrays are polynomials of NumPy, and differences."""

import numpy as np
import pytest
from numpy.random import default_rng
from numpy.testing import assert_allclose, assert_array_equal

from bdamper import _core
from bdamper.contact.laws import (
    LAW_BONDED,
    LAW_CONSTANT,
    LAW_COUPLED,
    LAW_COUPLED_CONSTANT,
    LAW_CUBIC,
    LAW_NORMAL,
    LAW_SEPARABLE,
)
from tests.each import each

ORDER, SPEEDS = 3.0, np.array([1.0, 1.15, 1.25, 1.4])
N_MODE = np.array([2, 3, 0, 2], np.intc)
POINTS = 5
UNKNOWNS = int(N_MODE[0] + 2 * N_MODE[1:].sum())
VARYING = (
    "stiffness",
    "mass",
    "damping",
    "G",
    "kt",
    "kn",
    "mu",
    "n0",
    "w",
    "shift",
    "force",
    "load",
)


def arrays(law, spread, seed=0):
    """Arrays at each speed, which differ by so much."""
    rng = default_rng(seed)
    modes = int(N_MODE.sum())
    G = rng.standard_normal(3 * POINTS * modes) + 1j * rng.standard_normal(3 * POINTS * modes)
    G[: 3 * POINTS * N_MODE[0]] = G[: 3 * POINTS * N_MODE[0]].real
    base = {
        "stiffness": rng.uniform(1.0, 3.0, modes), "mass": rng.uniform(0.1, 1.0, modes),
        "damping": rng.uniform(0.1, 0.2, modes), "G": G, "kt": rng.uniform(1.0, 2.0, (POINTS, 2)),
        "kn": rng.uniform(1.0, 2.0, POINTS), "mu": rng.uniform(0.2, 0.5, POINTS), "n0": rng.uniform(0.2, 1.0, POINTS),
        "w": rng.uniform(-0.1, 0.1, (POINTS, 2)), "shift": rng.uniform(-0.1, 0.1, (POINTS, 3)),
        "force": rng.uniform(-1.0, 1.0, UNKNOWNS), "load": rng.uniform(0.3, 1.0, POINTS),
    }  # fmt: skip
    return [
        {name: a * (1.0 + spread * rng.uniform(-1.0, 1.0, a.shape)) for name, a in base.items()}
        | {"n_mode": N_MODE, "law": np.full(POINTS, law, np.intc)}
        for _ in SPEEDS
    ]


def mixed(nodes, omega):
    """Arrays at a speed by NumPy's polynomials through those at the nodes."""
    at = SPEEDS**2
    where = (omega / ORDER) ** 2
    weights = [np.prod([(where - b) / (a - b) for b in at if b != a]) for a in at]
    return nodes[0] | {
        name: sum(w * node[name] for w, node in zip(weights, nodes)) for name in VARYING
    }


def family(nodes, **evaluation):
    systems = tuple(_core.SectorEquations(**node, **evaluation) for node in nodes)
    return _core.SectorEquations(
        **nodes[1], **evaluation, nodes=systems, squares=SPEEDS**2, order=ORDER
    )


def evaluated(core, u, omega):
    r, J, d = np.empty(UNKNOWNS), np.empty((UNKNOWNS, UNKNOWNS)), np.empty(UNKNOWNS)
    assert core.evaluate(np.append(u, omega), r, J, d) == 0
    return r, J, d


SAMPLED = {"evaluation": 1, "n_time": 256}
CASES = [
    (LAW_SEPARABLE, {}), (LAW_NORMAL, {}), (LAW_CONSTANT, {}), (LAW_BONDED, {}), (LAW_CUBIC, {}), (LAW_SEPARABLE, SAMPLED),
    (LAW_COUPLED, SAMPLED), (LAW_COUPLED_CONSTANT, SAMPLED),
]  # fmt: skip


@each(("law", "evaluation"), CASES)
@each("size", [0.05, 1.0], ids=["stuck", "moving"])
def test_residual_and_jacobian_are_those_of_the_arrays_at_the_speed(law, evaluation, size):
    nodes = arrays(law, 0.1)
    u = size * default_rng(1).standard_normal(UNKNOWNS)
    for omega in (3.3, 4.0):
        plain = _core.SectorEquations(**mixed(nodes, omega), **evaluation)
        for one, other in zip(
            evaluated(family(nodes, **evaluation), u, omega)[:2], evaluated(plain, u, omega)[:2]
        ):
            assert_allclose(one, other, rtol=1e-10, atol=1e-11 * np.abs(other).max())


@each(("law", "evaluation"), CASES)
@each("alone", [*VARYING, ""])
def test_the_derivative_along_the_line_is_that_of_differences(law, evaluation, alone):
    """Of plain equations with the arrays of speeds beside it; one array alone changes, and all."""
    nodes = arrays(law, 0.1)
    if alone:
        nodes = [nodes[0] | {alone: node[alone]} for node in nodes]
    u = 0.7 * default_rng(2).standard_normal(UNKNOWNS)
    exact = evaluated(family(nodes, **evaluation), u, 3.7)[2]

    def difference(h):
        beside = [
            evaluated(_core.SectorEquations(**mixed(nodes, w), **evaluation), u, w)[0]
            for w in (3.7 + h, 3.7 - h)
        ]
        return (beside[0] - beside[1]) / (2.0 * h)

    errors = [float(np.abs(difference(h) - exact).max()) for h in (3e-4, 1e-4, 3e-5, 1e-5)]
    assert min(errors) < 3e-8 * np.abs(exact).max(), errors


def test_motion_and_forces_of_a_family_are_those_of_the_frequency():
    nodes = arrays(LAW_SEPARABLE, 0.1)
    u = default_rng(3).standard_normal(UNKNOWNS)
    found, expected = (
        [np.empty((POINTS, 3, 7)), np.empty((POINTS, 3, 7)), np.empty((POINTS, 5))]
        for _ in range(2)
    )
    assert family(nodes).contact(np.append(u, 3.9), *found) == 0
    assert _core.SectorEquations(**mixed(nodes, 3.9)).contact(np.append(u, 3.9), *expected) == 0
    for one, other in zip(found, expected):
        assert_allclose(one, other, rtol=1e-9, atol=1e-11)


def test_nothing_depends_on_the_call_before():
    core = family(arrays(LAW_SEPARABLE, 0.1))
    u = default_rng(4).standard_normal(UNKNOWNS)
    before = evaluated(core, u, 3.6)
    evaluated(core, 0.5 * u, 4.1)
    core.evaluate(np.append(u, np.nan), np.empty(UNKNOWNS))
    for one, other in zip(before, evaluated(core, u, 3.6)):
        assert_array_equal(one, other)


def test_beyond_the_nodes_there_are_no_equations():
    """Polynomials run away there: of their range a twentieth more to each side."""
    core = family(arrays(LAW_SEPARABLE, 0.1))
    u, r = np.zeros(UNKNOWNS), np.empty(UNKNOWNS)
    width = SPEEDS[-1] ** 2 - SPEEDS[0] ** 2
    for square, status in (
        (1.0 - 0.04 * width, 0),
        (1.0 - 0.06 * width, 4),
        (1.96 + 0.06 * width, 4),
    ):
        assert core.evaluate(np.append(u, ORDER * np.sqrt(square)), r) == status


def test_there_are_no_nonlinear_modes_of_a_family():
    """Its arrays are those of the speed evaluated last, and excitation and damping would be mixed anew."""
    nodes = arrays(LAW_SEPARABLE, 0.1)
    motion = np.ones((2, UNKNOWNS))
    assert _core.Modes(_core.SectorEquations(**nodes[0]), *motion, 1.0).n_unknown == UNKNOWNS + 2
    with pytest.raises(
        ValueError, match=r"^sector: expected a sector at fixed speed, found a speed family$"
    ):
        _core.Modes(family(nodes), *motion, 1.0)


def test_nodes_that_do_not_fit_are_refused():
    nodes = arrays(LAW_SEPARABLE, 0.1)
    systems = tuple(_core.SectorEquations(**node) for node in nodes)
    other = _core.SectorEquations(**arrays(LAW_NORMAL, 0.1)[0])
    infinite = _core.SectorEquations(**(nodes[0] | {"w": np.full((POINTS, 2), np.inf)}))
    for given in ((*systems[:3], other), (*systems[:3], infinite), (*systems[:3], family(nodes))):
        with pytest.raises(
            ValueError, match="nodes: expected Sectors of the same sizes and contact laws"
        ):
            _core.SectorEquations(**nodes[0], nodes=given, squares=SPEEDS**2, order=ORDER)
    with pytest.raises(ValueError, match="at different speeds"):
        _core.SectorEquations(
            **nodes[0], nodes=systems, squares=np.array([1.0, 1.0, 2.0, 3.0]), order=ORDER
        )
    with pytest.raises(TypeError, match="nodes: expected a tuple of two or more Sectors"):
        _core.SectorEquations(**nodes[0], nodes=systems[:1], squares=SPEEDS[:1], order=ORDER)
    for wrong in ((object(), object()), (*systems[:3], None), list(systems)):
        with pytest.raises(TypeError, match="nodes: expected a tuple of two or more Sectors"):
            _core.SectorEquations(
                **nodes[0], nodes=wrong, squares=SPEEDS[: len(wrong)] ** 2, order=ORDER
            )
    for without in ({"squares": SPEEDS**2}, {"order": ORDER}):
        with pytest.raises(ValueError, match="squares, order: expected none without nodes"):
            _core.SectorEquations(**nodes[0], **without)
    for wrong in ({"squares": -SPEEDS}, {"squares": SPEEDS, "order": 0.0}):
        with pytest.raises(ValueError, match="expected"):
            _core.SectorEquations(**nodes[0], **({"nodes": systems, "order": ORDER} | wrong))
