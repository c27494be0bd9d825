"""Stress at nodes of solid elements of every type: exact where strain is uniform, and CalculiX' own elsewhere."""

import shutil

import numpy as np
import pytest
from scipy.sparse.linalg import spsolve

pytest.importorskip("skfem", reason="scikit-fem is not installed (extra bdamper[fe])")

from bdamper.fem.element_stress import (
    Solids,
    _places,
    element_rows,
    in_reference_order,
    node_average,
    von_mises_size,
)
from bdamper.importers.abaqus import read_calculix, read_frd, read_frd_stress
from bdamper.util.errors import ModelError
from examples.calculix.decks import run_job
from tests.each import each
from tests.own_sector import deck, of_kind

KINDS = ("C3D4", "C3D6", "C3D8", "C3D8I", "C3D8R", "C3D10", "C3D15", "C3D20", "C3D20R")
SIZE = np.array([10.0, 8.0, 30.0])


def block(kind):
    """A bent block of such elements."""
    axes = [np.linspace(0.0, length, n + 1) for length, n in zip(SIZE, (3, 2, 4))]
    x = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    s = np.sin(np.pi * x / SIZE)
    bent = [
        s[..., 1] * s[..., 2] * np.cos(x[..., 0]),
        0.5 * s[..., 0] * s[..., 2],
        0.7 * s[..., 0] * s[..., 1],
    ]
    x = x + 0.6 * np.stack(bent, axis=-1)
    number = np.arange(x[..., 0].size).reshape(x.shape[:3])
    ends = [(a, b, c) for c in (0, 1) for a, b in ((0, 0), (1, 0), (1, 1), (0, 1))]
    corners = [number[a : a + 3, b : b + 2, c : c + 4].ravel() for a, b, c in ends]
    return of_kind(kind, x.reshape(-1, 3), np.stack(corners, axis=1))


@pytest.mark.parametrize(
    "kind", [kind for kind in KINDS if kind != "C3D8I"]
)  # CalculiX' own fails the patch test
def test_uniform_strain_is_exact(kind):
    nodes, elements = block(kind)
    gradient = np.array([[1.0, 0.2, 0.3], [-0.1, 2.0, 0.4], [0.5, 0.6, -1.0]]) * 1e-3
    rows, owner = element_rows([Solids(kind, elements, 2e5, 0.3)], nodes, np.arange(len(nodes)))
    strain = 0.5 * (gradient + gradient.T)
    stress = 2e5 * 0.3 / (1.3 * 0.4) * np.trace(strain) * np.eye(3) + 2e5 / 1.3 * strain
    expected = stress[[0, 1, 2, 0, 1, 0], [0, 1, 2, 1, 2, 2]]
    found = (rows @ (nodes @ gradient.T).ravel()).reshape(-1, 6)
    np.testing.assert_allclose(
        found, np.tile(expected, (len(owner), 1)), rtol=1e-9, atol=1e-9 * stress.max()
    )
    assert len(owner) == elements.size


@each("kind", KINDS)
def test_middle_nodes_are_found_in_any_order(kind):
    nodes, elements = block(kind)
    n_corner = {4: 4, 10: 4, 6: 6, 15: 6, 8: 8, 20: 8}[elements.shape[1]]
    mixed = np.hstack(
        [elements[:, :n_corner], np.random.default_rng(0).permuted(elements[:, n_corner:], axis=1)]
    )
    np.testing.assert_array_equal(
        in_reference_order(mixed, nodes), in_reference_order(elements, nodes)
    )


def test_wedge_of_second_order_has_its_own_functions():
    """Zero at all other nodes, by integrating the gradient along the straight line from one node to another."""
    from bdamper.fem.element_stress import _wedge

    places, (t, w) = _places(15), np.polynomial.legendre.leggauss(4)
    np.testing.assert_allclose(_wedge(places.T)[0], np.eye(15), atol=1e-12)
    for a in range(15):
        for b in range(15):
            line = places[a][:, None] + (places[b] - places[a])[:, None] * 0.5 * (t + 1.0)
            change = np.einsum("nip,i,p->n", _wedge(line)[1], places[b] - places[a], 0.5 * w)
            np.testing.assert_allclose(change, np.eye(15)[b] - np.eye(15)[a], atol=1e-12)


def test_a_missing_middle_node_is_named():
    nodes, elements = block("C3D10")
    wrong = elements.copy()
    wrong[:, 4] = wrong[:, 0]
    with pytest.raises(
        ValueError, match=r"second-order element: no midside node between two corners$"
    ):
        in_reference_order(wrong, nodes)


def solved(kind, folder):
    """Displacement and nodal stress of a block in CalculiX, held at one end, pulled and bent at the other."""
    nodes, elements = block(kind)
    ends = {
        name: np.flatnonzero(np.abs(nodes[:, 2] - z) < 1e-9)
        for name, z in (("ROOT", 0.0), ("TIP", SIZE[2]))
    }
    steps = ["*BOUNDARY", "ROOT, 1, 3", "*STEP", "*STATIC", "*CLOAD", "TIP, 1, 10.", "TIP, 3, 25."]
    output = ["*NODE FILE", "U", "*EL FILE", "S", "*EL PRINT, ELSET=BODY", "S", "*END STEP", ""]
    run_job(
        "\n".join([deck(kind, nodes, elements, 2.1e5, 0.3, 7.8e-9, ends), *steps, *output]),
        folder,
        "job",
    )
    moved = read_frd(folder / "job.frd").modes[0]
    assert np.array_equal(moved.numbers, 1 + np.arange(len(nodes)))
    return nodes, elements, moved.shapes[:, :, 0].real, read_frd_stress(folder / "job.frd")[0][1]


@pytest.mark.skipif(shutil.which("ccx") is None, reason="CalculiX (ccx) is not installed")
@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "C3D6"])
def test_stress_is_that_of_calculix(kind, tmp_path):
    """At every node, edges of the block included."""
    nodes, elements, moved, theirs = solved(kind, tmp_path)
    rows, owner = element_rows([Solids(kind, elements, 2.1e5, 0.3)], nodes, np.arange(len(nodes)))
    ours = (node_average(owner, len(nodes)) @ (rows @ moved.ravel())).reshape(-1, 6)
    assert (
        von_mises_size(ours - theirs).max() < 5e-4 * von_mises_size(theirs).max()
    )  # six digits of its displacements


@pytest.mark.skipif(shutil.which("ccx") is None, reason="CalculiX (ccx) is not installed")
def test_stress_of_wedges_of_first_order_is_that_of_calculix_at_its_points(tmp_path):
    """CalculiX 2.20 gives the values of the upper point to every second node; at the points themselves it is right."""
    nodes, elements, moved, _ = solved("C3D6", tmp_path)
    words = [line.split() for line in (tmp_path / "job.dat").read_text().splitlines()]
    table = np.array(
        [[float(w) for w in line[2:]] for line in words if len(line) == 8 and line[0].isdigit()]
    )
    theirs = table.reshape(len(elements), 2, 6).mean(axis=1)[:, [0, 1, 2, 3, 5, 4]]
    rows, _ = element_rows([Solids("C3D6R", elements, 2.1e5, 0.3)], nodes, np.arange(len(nodes)))
    ours = (
        (rows @ moved.ravel()).reshape(len(elements), 6, 6).mean(axis=1)
    )  # over the nodes of each element
    assert von_mises_size(ours - theirs).max() < 5e-4 * von_mises_size(theirs).max()


@pytest.mark.skipif(shutil.which("ccx") is None, reason="CalculiX (ccx) is not installed")
def test_internal_nodes_of_incompatible_elements_are_condensed(tmp_path):
    """The displacement of a static run is that of the matrices that CalculiX writes with nine more rows an element."""
    nodes, elements, moved, _ = solved("C3D8I", tmp_path)
    ends = {
        name: np.flatnonzero(np.abs(nodes[:, 2] - z) < 1e-9)
        for name, z in (("ROOT", 0.0), ("TIP", SIZE[2]))
    }
    steps = [
        "*BOUNDARY",
        "ROOT, 1, 3",
        "*STEP",
        "*FREQUENCY, SOLVER=MATRIXSTORAGE",
        "6,",
        "*END STEP",
        "",
    ]
    run_job(
        "\n".join([deck("C3D8I", nodes, elements, 2.1e5, 0.3, 7.8e-9, ends), *steps]),
        tmp_path,
        "matrices",
    )
    body = read_calculix(tmp_path / "matrices")
    assert body.stiffness.shape == (3 * (len(nodes) - len(ends["ROOT"])),) * 2
    force = np.zeros((len(nodes), 3))
    force[ends["TIP"]] = 10.0, 0.0, 25.0
    rows = 3 * (body.dofs[:, 0] - 1) + body.dofs[:, 1] - 1
    found = spsolve(body.stiffness.tocsc(), force.ravel()[rows])
    np.testing.assert_allclose(
        found, moved.ravel()[rows], rtol=1e-4, atol=1e-5 * np.abs(moved).max()
    )
    fewer = (tmp_path / "matrices.dof").read_text().splitlines()[:-1]
    (tmp_path / "matrices.dof").write_text("\n".join(fewer))
    with pytest.raises(ModelError, match="rows and columns 1 to"):
        read_calculix(tmp_path / "matrices")
