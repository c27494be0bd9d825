"""Builds of the inner loops: which there are, which one is used, and that all say the same.

``BDAMPER_KERNEL=plain python -m pytest tests/core`` runs all tests of the core under one of them.
"""

import os

import numpy as np
import pytest
from numpy.random import default_rng

from bdamper import _core
from tests.cases import EXACT, PLAIN, SAMPLED, evaluate_system, random_arrays
from tests.compare import assert_close
from tests.each import each

KERNELS = "plain", "generic", "avx2", "avx512"


def test_the_fastest_is_used_unless_another_one_is_asked_for(monkeypatch):
    kernels = _core.kernels()
    assert kernels[-1] == "plain"
    assert set(kernels) <= set(KERNELS)
    assert _core.kernel() == os.environ.get("BDAMPER_KERNEL", kernels[0])
    for name in kernels:
        monkeypatch.setenv("BDAMPER_KERNEL", name)
        assert _core.kernel() == name
    monkeypatch.delenv("BDAMPER_KERNEL")
    assert _core.kernel() == kernels[0]


def test_an_unknown_one_is_named(monkeypatch):
    arrays = random_arrays(default_rng(1), (1, 1), 1)
    monkeypatch.setenv("BDAMPER_KERNEL", "none")
    expected = r"^BDAMPER_KERNEL: expected one of \('.*'\,?.*\), found 'none'$"
    with pytest.raises(ValueError, match=expected):
        _core.kernel()
    with pytest.raises(ValueError, match=expected):
        _core.SectorEquations(**arrays)


@each("name", KERNELS)
@each(
    ("law", "evaluation"),
    [(0, EXACT), (0, SAMPLED), (0, PLAIN), (2, EXACT), (3, SAMPLED), (3, PLAIN), (4, SAMPLED)],
)
def test_all_give_the_same_residual_and_jacobian(monkeypatch, name, law, evaluation):
    if name not in _core.kernels():
        pytest.skip(f"this processor or build has no {name} kernel")
    rng = default_rng(2)
    arrays = random_arrays(rng, (2, 3, 0, 2), 11)
    arrays["law"][:] = law
    sampled = {} if evaluation == EXACT else {"n_time": 64}
    found = {}
    for kernel in ("plain", name):
        monkeypatch.setenv("BDAMPER_KERNEL", kernel)
        system = _core.SectorEquations(**arrays, evaluation=evaluation, **sampled)
        u = default_rng(3).normal(size=system.n_unknown)
        found[kernel] = evaluate_system(system, u, 0.8)
    for one, other in zip(found[name], found["plain"]):
        assert np.abs(other).max() > 0.1
        assert_close(one, other, 1e-11)
