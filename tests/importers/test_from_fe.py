"""Plain arrays of nodes and elements, and the order of the corners of elements."""

import itertools
import re
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("skfem", reason="scikit-fem is not installed (extra bdamper[fe])")

from bdamper.fem.contact_patches import Patches
from bdamper.fem.meshes import (
    ElasticMaterial,
    Geometry,
    MeshDensity,
    damper_mesh,
    discretise,
    local_order,
)
from bdamper.fem.surface import twisted
from bdamper.importers import ContactFaces, Placement, Sector, read_arrays
from bdamper.util.errors import ModelError
from tests.imports import build

ROWS = [0, 1, 3, 2, 4, 5, 7, 6]  # corners row by row in place of in turn
SETTINGS = {
    "fixed": "end",
    "contacts": [ContactFaces("pad", "face", None, "blade", "ground", points=(2, 2))],
    "n_modes": 4,
}


@pytest.fixture(scope="module")
def block():
    """A small body, held at one end: matrices, nodes, elements in the agreed order, sets."""
    body = discretise(
        damper_mesh(Geometry(), MeshDensity(2, 2, 1, 4, 2, 2, 1, 6, 2, 1, 1, 2)), ElasticMaterial()
    )
    z = body.nodes[:, 2]
    sets = {"end": np.flatnonzero(z > z.max() - 1e-9), "face": np.flatnonzero(z < z.min() + 1e-9)}
    return body.stiffness, body.mass, body.nodes, body.elements[:, local_order()], sets


def test_plain_arrays_are_numbered_from_0(block):
    K, M, nodes, elements, sets = block
    given = {"n_blades": 1, "locations": {"tip": nodes[np.argmin(nodes[:, 2])]}, **SETTINGS}
    plain = read_arrays(K.toarray(), M.toarray(), nodes, elements=elements, sets=sets)
    numbered = read_arrays(K, M, (np.arange(len(nodes)), nodes), sets=sets, elements=(elements,))
    assert build(plain, **given).model.hash == build(numbered, **given).model.hash


def test_a_face_on_the_ground_has_one_contact(block):
    """Two contacts on one face would be twice as stiff; patches on one face may have other places."""
    K, M, nodes, elements, sets = block
    body = read_arrays(K, M, nodes, elements=elements, sets=sets | {"part": sets["face"][:-3]})
    ground = {"faces_b": None, "body_a": "blade", "body_b": "ground"}
    for faces in ("face", "part"):
        contacts = [*SETTINGS["contacts"], ContactFaces("other", faces, points=(2, 3), **ground)]
        message = r"other.*: expected other faces than those of contact 'pad', found \d+ element faces of both; remove one"
        with pytest.raises(ModelError, match=message):
            build(body, n_blades=1, **SETTINGS | {"contacts": contacts})
    z, middle = nodes[:, 2].min(), nodes[sets["face"]].mean(axis=0)
    frame = np.array([[[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]])
    places = [np.array([[middle[0], middle[1] + shift, z]]) for shift in (-1e-4, 1e-4)]
    patches = [Patches(place, frame, np.array([[1e-4, 1e-4]])) for place in places]
    pair = [ContactFaces(f"patch {k}", "face", patches=patches[k], **ground) for k in (0, 1)]
    assert len(build(body, n_blades=1, **SETTINGS | {"contacts": pair}).model.interfaces) == 2
    twice = [pair[0], replace(pair[1], patches=patches[0])]
    with pytest.raises(
        ModelError,
        match=r"than those of contact 'patch 0', found 1 contact points at the same positions",
    ):
        build(body, n_blades=1, **SETTINGS | {"contacts": twice})


@pytest.mark.parametrize("n", [8, 20])
def test_another_order_of_the_corners_is_named(block, n):
    K, M, nodes, elements, sets = block
    wrong = np.hstack([elements[:, ROWS], elements[:, 8:]])[:, :n]
    message = "blade (the given arrays): elements, such as the one with nodes [" + ", ".join(
        map(str, wrong[0, :8])
    )
    with pytest.raises(ModelError, match="^" + re.escape(message)) as caught:
        build(read_arrays(K, M, nodes, elements=wrong, sets=sets), n_blades=1, **SETTINGS)
    assert "4 corners in turn around one face, then the 4 opposite ones in the same turn" in str(
        caught.value
    )
    assert f"a different order in {len(wrong)} of {len(wrong)}" in str(caught.value)


def test_both_senses_and_collapsed_elements_are_in_order(block):
    _, _, nodes, elements, _ = block
    corners = elements[:, :8]
    assert not twisted(corners, nodes).any()
    assert not twisted(corners[:, [3, 2, 1, 0, 7, 6, 5, 4]], nodes).any(), "the other sense"
    assert not twisted(corners[:, [0, 1, 2, 2, 4, 5, 6, 6]], nodes).any(), (
        "a hexahedron that is a wedge"
    )
    assert not twisted(corners[:, [0, 1, 2, 4, 5, 6]], nodes).any()
    for order in (
        ROWS,
        [0, 1, 2, 3, 5, 4, 7, 6],
        [0, 1, 2, 3, 6, 7, 4, 5],
        [0, 1, 2, 3, 5, 6, 7, 4],
    ):
        assert twisted(corners[:, order], nodes).all()
    assert twisted(corners[:, [0, 1, 2, 5, 6, 4]], nodes).all()


def test_only_the_symmetries_of_a_cube_are_in_order():
    """48 of the 40320 orders of its corners."""
    cube = np.array(
        [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]],
        float,
    )
    orders = np.array([order for order in itertools.permutations(range(8)) if order[0] == 0])
    assert (~twisted(orders, cube)).sum() == 48 / 8


def test_options_of_equal_values_are_equal():
    """Arrays in them would make the comparison fail."""
    assert Placement(radial=np.array([0, 2, 0])) == Placement(radial=(0.0, 2.0, 0.0))
    assert Sector(elasticity=[2e11, 0.3]) == Sector(elasticity=(2e11, 0.3)) != Sector()
