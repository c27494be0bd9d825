"""A sector with matrices at two rotor speeds has the frequencies of these matrices at both of them."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import eigh

pytest.importorskip("skfem", reason="scikit-fem is not installed (extra bdamper[fe])")

from bdamper.importers import over_speed
from tests.annulus import small_sector
from tests.fe_bodies import SIX_BLADES, contacts
from tests.imports import build

ND, LAST, COUNT = 1, 3000.0, 6
"""Nodal diameter, second speed (rad/s), and number of modes."""


@pytest.fixture(scope="module")
def fe():
    return small_sector(6)


def dense_frequencies(fe, stiffness):
    """The lowest frequencies (rad/s) of the full matrices, without the reduction and its eigensolver."""
    T = fe.cyclic(ND).transformation
    K, M = ((T.conj().T @ matrix @ T).toarray() for matrix in (stiffness, fe.blade.mass))
    return np.sqrt(eigh(K, M, eigvals_only=True, subset_by_index=(0, COUNT - 1)))


@pytest.mark.slow
def test_frequencies_at_both_speeds_are_those_of_the_full_matrices(fe, bodies):
    blade, damper = bodies
    running = replace(blade, stiffness=blade.stiffness + LAST**2 * fe.rotation().per_squared_speed)
    settings = SIX_BLADES | {"nodal_diameters": (0, ND), "n_modes": COUNT, "contacts": contacts(4)}
    built = build(over_speed({0.0: blade, LAST: running}), damper, **settings)
    for omega, body in ((0.0, blade), (LAST, running)):
        basis = built.model.at_speed(omega).bodies["blade"].bases[ND]
        assert basis.n_natural == COUNT
        # modes keep their numbers where frequencies cross
        found = np.sqrt(np.sort(basis.omega2[:COUNT]))
        np.testing.assert_allclose(found, dense_frequencies(fe, body.stiffness), rtol=1e-7)
    line = f"blade: frequencies at nodal diameter {ND}, 0 and 3000 rad/s are those of the matrices"
    assert any(line in check for check in built.checks) and not built.failed
