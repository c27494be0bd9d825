"""A local basis from bare matrices and a set of nodes: that of the finite element model, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

pytest.importorskip("skfem", reason="scikit-fem is not installed (extra bdamper[fe])")

from bdamper.fem import LocalSizes, sector_inside
from bdamper.importers import ContactFaces
from bdamper.model.validation import check_model
from bdamper.util.errors import BdamperError
from tests.annulus import small_sector
from tests.fe_bodies import FIRST_NUMBER, SIX_BLADES, contacts
from tests.imports import build
from tests.printed import said

N = 6
SETTINGS = SIX_BLADES | {"nodal_diameters": (0, 1, 2, 3), "n_modes": 6, "contacts": contacts(4)}


@pytest.fixture(scope="module")
def fe():
    return small_sector(N)


@pytest.mark.slow
def test_a_set_of_nodes_makes_the_local_basis(fe, bodies):
    built = build(
        *bodies,
        **SETTINGS,
        blade_nodes="BLADE",
        locations={"tip": fe.blade.nodes[:, 1].argmax() + FIRST_NUMBER},
    )
    check_model(built.model)
    local = built.model.bodies["blade"].local
    assert (local.n_cantilever, local.n_attachment, local.n_interface) == (
        12,
        12 + 3,
        16,
    )  # three directions at the tip
    np.testing.assert_allclose(local.omega2, fe.blade_part().cantilever(12)[0], rtol=1e-8)
    for d, basis in built.model.bodies["blade"].bases.items():
        np.testing.assert_allclose(local.nodal_diameter(d).omega2[:3], basis.omega2[:3], rtol=1e-4)
    assert np.all(local.blade_stiffness[-16:] == 0.0)
    assert "of them at its root; clamped there" in said(built.summary())
    few = (
        build(*bodies, **SETTINGS, blade_nodes="BLADE", local_sizes=LocalSizes(4, 6, 6))
        .model.bodies["blade"]
        .local
    )
    assert few.n == 16


@pytest.mark.slow
def test_all_nodal_diameters_share_a_factorisation_on_one_thread(bodies, monkeypatch):
    """One for the modes and one for the disk; threads of a BLAS cost more than they bring."""
    threads, plain = [], sector_inside.factorise

    def noted(matrix):
        threads.extend(lib["num_threads"] for lib in threadpool_info() if lib["user_api"] == "blas")
        threads.append(None)
        return plain(matrix)

    monkeypatch.setattr(sector_inside, "factorise", noted)
    with threadpool_limits(2, user_api="blas"):
        model = build(*bodies, **{**SETTINGS, "n_modes": 10}, blade_nodes="BLADE").model
    assert sorted(model.bodies["blade"].bases) == [0, 1, 2, 3]
    assert threads.count(None) == 2  # the inside of the sector, and the disk
    assert set(threads) == {1, None}


@pytest.mark.slow
def test_shapes_for_pictures_are_those_of_the_excited_wave(bodies):
    settings = {**SETTINGS, "nodal_diameters": None, "engine_order": 4, "harmonics": 1}
    model = build(*bodies, **settings).model
    assert sorted(model.bodies["blade"].bases) == [0, 2]
    assert list(model.meshes["blade"].modes) == [2]
    every = build(*bodies, **SETTINGS).model.meshes["blade"].modes
    np.testing.assert_array_equal(model.meshes["blade"].modes[2], every[2])
    assert list(every) == [0, 1, 2, 3]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("wheel", "words"),
    [
        ("ALL", "blade_nodes: expected one of the sets"),
        (
            "BORE",
            "blade_nodes: expected the nodes of a blade from root to tip, with all its contact faces",
        ),
        ("EVERY", "found a blade without a root node that connects it to the disk"),
        ("HALF", "found contact points that are not on the blade"),
    ],
)
def test_a_set_that_is_no_blade_is_refused(fe, bodies, wheel, words):
    blade, damper = bodies
    nodes = fe.blade_part().nodes
    own = {
        "EVERY": FIRST_NUMBER + np.arange(len(fe.blade.nodes)),
        "HALF": FIRST_NUMBER
        + nodes[fe.blade.nodes[nodes, 1] > np.median(fe.blade.nodes[nodes, 1])],
    }
    blade = replace(blade, node_sets={**blade.node_sets, **own})
    with pytest.raises(BdamperError) as error:
        build(blade, damper, **SETTINGS, blade_nodes=wheel)
    assert words in str(error.value)


def test_blades_that_touch_each_other_are_refused_before_the_work(bodies, monkeypatch):
    """A wheel does not serve them, and a build for it says so at once."""
    monkeypatch.setattr(sector_inside, "factorise", lambda matrix: pytest.fail("work was done"))
    shroud = ContactFaces("shroud", "HIGH", "LOW", "blade", "blade", points=2)
    with pytest.raises(
        BdamperError,
        match="blade_nodes: expected contacts between blades and dampers only, found 'shroud'",
    ):
        build(
            *bodies,
            **{**SETTINGS, "contacts": [*SETTINGS["contacts"], shroud]},
            blade_nodes="BLADE",
        )
