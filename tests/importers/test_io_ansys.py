"""Ansys files: real ones with known answers, and small ones written here for every form of record and every damage."""

import shutil
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg

pytest.importorskip("skfem", reason="scikit-fem is not installed (extra bdamper[fe])")

from bdamper.fem.cyclic_symmetry import travelling_waves
from bdamper.fem.element_stress import Solids, element_rows
from bdamper.fem.meshes import ElasticMaterial, discretise, join_blocks, local_order
from bdamper.fem.sector_faces import find_faces
from bdamper.fem.surface import FACES, enclosed_volume
from bdamper.importers import read_ansys, read_cdb, read_full, read_rst
from bdamper.importers.ansys import _HEADER, _Binary, _Header, _node_axes
from bdamper.importers.plausibility import check_corners
from bdamper.importers.prepared_body import Placement, PreparedBody
from bdamper.model.structure import turn
from bdamper.util.errors import ModelError
from tests.ansys_files import EDGES, Writer, collapsed, write_cdb, write_full, write_rst
from tests.each import each

FIXTURES = Path(__file__).resolve().parents[3] / "shared" / "fixtures" / "ansys"


def fixture(name):
    path = FIXTURES / name
    if not path.exists():
        pytest.skip(f"the file {name} is not here: {FIXTURES} is not part of the project")
    return path


# ---- real files ----


def test_real_matrices():
    found = read_full(fixture("file.full"))
    assert found.dropped == 63
    assert found.stiffness.shape == (900, 900)
    assert abs(found.stiffness - found.stiffness.T).max() == 0.0
    omega2 = scipy.linalg.eigh(found.stiffness.toarray(), found.mass.toarray(), eigvals_only=True)
    hertz = np.sqrt(omega2) / (2 * np.pi)
    for known in (1283.200, 5781.975, 6919.399):
        assert np.abs(hertz - known).min() < 6e-4
    assert hertz[0] == pytest.approx(1283.200, abs=6e-4)


def test_real_archives():
    beam = read_cdb(fixture("HexBeam.cdb"))
    assert beam.nodes.shape == (321, 3)
    assert [e.shape for e in beam.elements] == [(40, 20)]
    assert set(beam.node_sets) == {"NCOMP2", "NODE_SELECTION"}
    sector = read_cdb(fixture("sector.cdb"))
    assert sector.nodes.shape == (655, 3)
    body = PreparedBody("beam", beam, Placement())
    # the elements fill the box that the nodes span: orientation, corners and nodes between them are understood
    assert enclosed_volume(body.boundary, body.nodes) == pytest.approx(
        np.ptp(beam.nodes, axis=0).prod(), rel=1e-9
    )
    # on these nodes no rigid motion may cause a force of its matrices
    found = PreparedBody("sector", sector, body.placement)
    assert enclosed_volume(found.boundary, found.nodes) > 0.0


def test_real_matrices_belong_to_the_real_archive():
    body = read_ansys(fixture("file.full"), fixture("HexBeam.cdb"))
    assert body.dofs.shape == (900, 2)
    assert set(body.dofs[:, 0]) <= set(body.numbers)
    assert "63 rows of fixed components dropped" in str(body)
    prepared = PreparedBody("beam", body, Placement())
    assert (~prepared.fixed(None)).sum() == 900


def test_real_matrices_are_not_of_another_archive():
    """All numbers of their nodes are in it, so that what is missing are nodes of the archive's solid elements."""
    archive = read_cdb(fixture("sector.cdb"))
    matrices = read_full(fixture("file.full"))
    solid = set(np.concatenate([e.ravel() for e in archive.elements]).tolist())
    missing = sorted(solid - set(matrices.nodes.tolist()))
    assert set(matrices.nodes.tolist()) <= set(archive.numbers.tolist()) and len(missing) > 5
    some = ", ".join(map(str, missing[:5]))
    with pytest.raises(
        ModelError, match=rf"file.full: .*{len(missing)} of {len(solid)} missing: {some}, \.\.\."
    ):
        read_ansys(fixture("file.full"), fixture("sector.cdb"))


def test_real_cyclic_modes():
    """Eight sectors about Y; the pairs of shapes combine to waves, whatever the direction in the file."""
    body = read_rst(fixture("file_cyclic.rst"))
    assert len(body.numbers) == 51
    assert [m.nodal_diameter for m in body.modes] == [0, 1, 2, 3, 4]
    assert [len(m.frequency) for m in body.modes] == 5 * [6]
    for d, known in ((0, 670386.33), (1, 679667.39), (2, 708505.07)):
        assert body.modes[d].frequency[0] == pytest.approx(known, abs=6e-3)
    np.testing.assert_allclose(body.modes[1].frequency[0], body.modes[1].frequency[1], rtol=1e-9)
    prepared = PreparedBody("blade", body, Placement(axis=(0, 1, 0), radial=(0, 0, 1)))
    faces = find_faces(prepared.nodes, prepared.boundary, None, 1e-9)
    assert faces.n_sectors == 8 and len(faces.dependent) == 13
    for modes in body.modes:
        shapes = prepared.shapes(modes.numbers, modes.shapes, "modes")
        waves = travelling_waves(modes.frequency, shapes, faces, modes.nodal_diameter)
        assert waves.mismatch.max() < 1e-11
    # Sets 6 and 7 are u6 and u7: u6 + i u7 runs one way, u6 - i u7 the other.
    shapes = prepared.shapes(body.modes[1].numbers, body.modes[1].shapes, "modes")
    residual = {}
    for sign in (1, -1):
        u = (shapes[:, 0] + sign * 1j * shapes[:, 1]).reshape(-1, 3)
        ahead = (
            u[faces.dependent]
            - np.exp(2j * np.pi / 8) * u[faces.independent] @ turn(2 * np.pi / 8).T
        )
        residual[sign] = np.abs(ahead).max() / np.abs(u).max()
    assert sorted(residual.values())[0] < 1e-14
    assert sorted(residual.values())[1] > 1.0


# ---- files written here ----


@pytest.fixture(scope="module")
def bar():
    """A small bar, its numbers and elements in the order of the program."""
    grid = np.stack(np.meshgrid([0.0, 0.1, 0.25], [0.3, 0.5], [0.0, 0.2], indexing="ij"), axis=-1)
    body = discretise(join_blocks([grid]), ElasticMaterial())
    numbers = 10 + np.arange(len(body.nodes))
    return body, numbers, numbers[body.elements[:, local_order()]]


@pytest.fixture
def files(bar, tmp_path):
    body, numbers, elements = bar
    write_full(tmp_path / "bar.full", body.stiffness, body.mass, numbers, fixed=(0, 1, 2, 7))
    write_cdb(
        tmp_path / "bar.cdb", numbers, body.nodes, elements, {"ENDS": numbers[[0, 1, 2, 3, 9]]}
    )
    rng = np.random.default_rng(0)
    sets = [
        (0, 100.0, rng.standard_normal((len(numbers), 3))),
        (1, 150.0, rng.standard_normal((len(numbers), 3))),
    ]
    write_rst(tmp_path / "bar.rst", numbers, body.nodes, elements, sets, 6)
    return tmp_path, sets


def test_written_files_come_back(bar, files):
    body, numbers, elements = bar
    folder, sets = files
    found = read_ansys(folder / "bar.full", folder / "bar.cdb", folder / "bar.rst")
    keep = np.setdiff1d(np.arange(body.n_dof), [0, 1, 2, 7])
    np.testing.assert_allclose(
        found.stiffness.toarray(), body.stiffness.toarray()[np.ix_(keep, keep)]
    )
    np.testing.assert_allclose(found.mass.toarray(), body.mass.toarray()[np.ix_(keep, keep)])
    np.testing.assert_array_equal(found.dofs, np.column_stack([numbers[keep // 3], keep % 3 + 1]))
    np.testing.assert_allclose(found.nodes, body.nodes, atol=1e-13)
    np.testing.assert_array_equal(found.elements[0], elements)
    np.testing.assert_array_equal(found.node_sets["ENDS"], numbers[[0, 1, 2, 3, 9]])
    for modes, (d, hertz, shape) in zip(found.modes, sets):
        assert (modes.nodal_diameter, modes.frequency[0]) == (d, hertz)
        np.testing.assert_array_equal(modes.shapes[:, :, 0], shape)
    result = read_rst(folder / "bar.rst")
    np.testing.assert_array_equal(result.elements[0], elements)
    np.testing.assert_allclose(result.nodes, body.nodes)


@pytest.mark.parametrize(
    ("place", "numbers", "message"),
    [
        (
            "bar.full",
            [2, 5],
            r"bar.cdb: expected the nodes of .*bar.full, .*, found 2 of 32 missing: 902, 905$",
        ),
        (
            "bar.cdb",
            [4],
            r"bar.cdb: expected the nodes of .*bar.full, .*, found 1 of 32 missing: 14$",
        ),
        ("both", [11], None),
    ],
)
def test_matrices_and_archive_of_different_models(bar, files, place, numbers, message):
    """Other numbers in one of the files are refused; the same in both are read, fixed nodes included."""
    body, own, _ = bar
    changed = own.copy()
    changed[numbers] = 900 + np.array(numbers)
    folder, _ = files
    if place != "bar.cdb":
        write_full(folder / "bar.full", body.stiffness, body.mass, changed, fixed=(0, 1, 2, 7))
    if place != "bar.full":
        write_cdb(
            folder / "bar.cdb", changed, body.nodes, changed[body.elements[:, local_order()]], {}
        )
    if message is None:
        assert 911 in read_ansys(folder / "bar.full", folder / "bar.cdb").dofs
    else:
        with pytest.raises(ModelError, match=message):
            read_ansys(folder / "bar.full", folder / "bar.cdb")


def test_archive_with_more_elements_than_the_matrices(bar, files):
    """Every node of the matrices is there, but the archive has a further element."""
    body, numbers, elements = bar
    folder, _ = files
    more, far = np.append(numbers, [901, 902, 903, 904]), body.nodes[:4] + [1.0, 0.0, 0.0]
    beyond = np.append(elements[-1][:-4], more[-4:])[None]
    write_cdb(
        folder / "bar.cdb", more, np.vstack([body.nodes, far]), np.vstack([elements, beyond]), {}
    )
    with pytest.raises(
        ModelError,
        match=r"bar.full: expected the nodes of .*bar.cdb, .* 4 of 36 missing: 901, 902, 903,",
    ):
        read_ansys(folder / "bar.full", folder / "bar.cdb")


HEXAHEDRON = np.array([0, 1, 5, 4, 8, 9, 13, 12])
TURNED = [1, 2, 3, 0, 5, 6, 7, 4, 9, 10, 11, 8, 13, 14, 15, 12, 17, 18, 19, 16]
"""Nodes of a hexahedron from its second corner on."""


def mixed_block():
    """Three cubes in a row: a hexahedron, one about its centre (pyramids, one cut in two tetrahedra), and two wedges.

    Returns
    -------
    nodes : (17, 3), corners of all elements
    """
    grid = np.stack(np.meshgrid([0.0, 1.0], [0.0, 1.5], np.arange(4.0), indexing="ij"), axis=-1)[
        ..., ::-1
    ].reshape(-1, 3)
    cube = HEXAHEDRON + 1
    sides = [cube[list(face)] for face in FACES[8]]  # outward; the apex is inside
    pyramids = [[*side[::-1], 16] for side in sides[1:]]
    a, b, c, d = sides[0][::-1]
    others = [[a, b, c, 16], [a, c, d, 16]]
    nodes = np.vstack([grid, grid[cube].mean(axis=0)])
    wedges = [HEXAHEDRON[corners] + 2 for corners in ([0, 1, 2, 4, 5, 6], [0, 2, 3, 4, 6, 7])]
    return nodes, [*map(np.array, [HEXAHEDRON, *pyramids, *others, *wedges])]


@pytest.mark.parametrize("second", [False, True], ids=["SOLID185", "SOLID186"])
def test_collapsed_elements_are_read(second, tmp_path):
    """Pyramids, wedges and tetrahedra as hexahedra with repeated nodes fill the block, and a uniform strain is uniform."""
    nodes, elements = mixed_block()
    if second:
        edges = [
            [tuple(sorted(e[list(edge)].tolist())) for edge in EDGES[len(e)]] for e in elements
        ]
        unique = sorted({edge for own in edges for edge in own})
        elements = [
            [*e, *(len(nodes) + unique.index(edge) for edge in own)]
            for e, own in zip(elements, edges)
        ]
        nodes = np.vstack([nodes, nodes[np.array(unique)].mean(axis=1)])
    numbers = 5 + np.arange(len(nodes))
    stored = [numbers[collapsed(e)] for e in elements]
    stored[-1] = stored[-1][
        TURNED[: len(stored[-1])]
    ]  # a wedge whose repeated nodes are other ones
    constants = [
        f"MPDATA,R5.0, 1,{name},1,1,{value}," for name, value in (("EX  ", 1.0), ("PRXY", 0.3))
    ]
    write_cdb(tmp_path / "a.cdb", numbers, nodes, stored, {}, constants)
    read = read_cdb(tmp_path / "a.cdb")
    assert sum(map(len, read.elements)) == 10
    body = PreparedBody("block", read, Placement())
    assert enclosed_volume(body.boundary, body.nodes) == pytest.approx(4.5, rel=1e-12)
    assert len(body.boundary) == 5 + 5 + 7
    check_corners(body)
    rows, owner = element_rows(
        [Solids(k.name, e, k.youngs_modulus, k.poisson_ratio) for k, e in zip(read.element_kinds, body.elements)],
        body.nodes, np.arange(len(nodes)),
    )  # fmt: skip
    assert set(owner) == set(range(len(nodes)))
    strain = np.array([[1.0, 0.3, -0.2], [0.3, -0.5, 0.7], [-0.2, 0.7, 0.4]])
    stress = 0.3 / 1.3 / 0.4 * np.trace(strain) * np.eye(3) + strain / 1.3
    found = (rows @ (nodes @ strain).ravel()).reshape(-1, 6)
    expected = stress[[0, 1, 2, 0, 1, 0], [0, 1, 2, 1, 2, 2]]
    np.testing.assert_allclose(found, np.tile(expected, (len(owner), 1)), atol=1e-12)


def test_forms_of_records(tmp_path):
    cases = [
        (np.array([0.0, 3.0, 0.0, 0.0, 5.0, 6.0]), "windows"),
        (np.array([1.0, 1.0, 1.0, 0.0, 2.0]), "windows"),
        (np.array([7, 0, 0, 8], np.int32), "windows"),
        (np.array([0, 0, 4, 0], np.int32), "bits"),
        (np.array([0.5, 0.0, -2.0]), "bits"),
        (np.arange(5), "plain"),
    ]
    writer = Writer(4)
    places = [writer.add(values, form) for values, form in cases]
    writer.save(tmp_path / "x.full")
    file = _Binary(tmp_path / "x.full", 4)
    for place, (values, _) in zip(places, cases):
        np.testing.assert_array_equal(file.record(place, "test"), values)


def test_axes_of_a_node():
    """A turn of 90 degrees about Z carries the first axis to Y; the rows are a right-handed triad."""
    np.testing.assert_allclose(
        _node_axes(np.array([90.0, 0.0, 0.0])), [[0, 1, 0], [-1, 0, 0], [0, 0, 1]], atol=1e-15
    )
    axes = _node_axes(np.array([20.0, -30.0, 50.0]))
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-15)
    assert np.linalg.det(axes) == pytest.approx(1.0)


def patched(path, position, value, word=0):
    """A file with one number of its header changed."""
    data = bytearray(path.read_bytes())
    at = 4 * (103 + 2 + position - 1) if not word else 4 * word
    data[at : at + 4] = np.int32(value).tobytes()
    path.write_bytes(bytes(data))


@each(
    ("name", "position", "value", "message"),
    [
        ("bar.full", 1, 4, r"symbolically assembled matrix \(-4\), found 4"),
        ("bar.full", 14, 1, "expected symmetric matrices"),
        ("bar.full", 11, 1, r"consistent mass matrix \(LUMPM,OFF\)"),
        ("bar.full", 21, 3, "no constraint equations .*, found 3"),
        ("bar.full", 27, 0, "mass matrix: expected a matrix, found none in the file"),
        ("bar.full", 19, 10**8, "stiffness matrix, record 1 of .* expected a record within"),
        ("bar.full", 2, 13, "degrees of freedom of each node: expected 13 in all"),
        ("bar.full", 33, -5, "expected a number of nodes from 1"),
        ("bar.rst", 8, 0, "expected a modal analysis: number 2, found 0"),
        ("bar.rst", 8, 3, "expected a modal analysis: number 2, found 3"),
        ("bar.rst", 9, 0, "expected a number of result sets from 1"),
        ("bar.rst", 3, 10**6, "expected a number of nodes"),
        ("bar.rst", 3, 6, r"expected all 32 nodes of the model \(.* COMBINE,RST\), found 6"),
        ("bar.rst", 49, 64, r"expected all 64 nodes of the model \(.* COMBINE,RST\), found 32"),
        (
            "bar.full",
            62,
            192,
            r"expected all 192 equations of the model \(.* COMBINE,FULL\), found 96",
        ),
        (
            "bar.rst",
            21,
            0,
            "expected sectors of one stage .*, found harmonic indices up to 1 without a number of sectors",
        ),
        ("bar.rst", 17, 0, "the nodal diameters of the disk with 6 sectors are missing"),
        ("bar.rst", 16, 3, "geometry header: expected whole numbers"),
    ],
)
def test_bad_headers(files, tmp_path, name, position, value, message):
    path = Path(shutil.copy(files[0] / name, tmp_path))
    patched(path, position, value)
    reader = read_full if name.endswith("full") else read_rst
    with pytest.raises(ModelError, match=message) as caught:
        reader(path)
    assert str(path) in str(caught.value)


def test_results_of_several_stages_are_refused(files):
    """Each stage has its own nodal diameters; item 54 of the geometry header counts the stages."""
    path = files[0] / "bar.rst"
    geometry = _Header(_Binary(path, 12), _HEADER, "header")[16]
    patched(path, 0, 2, word=geometry + 2 + 54 - 1)
    with pytest.raises(
        ModelError,
        match=r"expected sectors of one stage .*, found a multistage result with 2 stages",
    ):
        read_rst(path)


def test_results_of_releases_without_distributed_solution_are_read(files):
    """Their header has no number of nodes of the model."""
    path = files[0] / "bar.rst"
    numbers = read_rst(path).numbers
    patched(path, 49, 0)
    np.testing.assert_array_equal(read_rst(path).numbers, numbers)


def test_one_domain_of_a_distributed_run_is_refused(tmp_path):
    """In a real file, item 49 of the header is the number of its nodes; here half of the nodes are missing."""
    path = Path(shutil.copy(fixture("file_cyclic.rst"), tmp_path / "file0.rst"))
    assert len(read_rst(path).numbers) == 51
    patched(path, 49, 102)
    with pytest.raises(ModelError, match=r"expected all 102 nodes of the model .*, found 51"):
        read_rst(path)


def test_other_files_are_told_apart(files, tmp_path):
    with pytest.raises(
        ModelError, match=r"expected a file of matrices \(.full\): number 4, found 12, results"
    ):
        read_full(files[0] / "bar.rst")
    (tmp_path / "text.full").write_text(
        "no binary file at all, but long enough to hold a header\n" * 20
    )
    with pytest.raises(ModelError, match="standard header"):
        read_full(tmp_path / "text.full")
    with pytest.raises(FileNotFoundError, match="there is no file"):
        read_rst(tmp_path / "nothing.rst")


def test_any_format_of_the_archive_is_obeyed(files):
    """Columns of other widths, as Workbench 19.3 writes them, and exponents by D."""
    path = files[0] / "bar.cdb"
    body, lines = read_cdb(path), path.read_text().splitlines()
    at = lines.index("(3i9,6e21.13e3)")
    lines[at] = "(1i7,2i9,6e21.13)"
    for k in range(at + 1, at + 1 + len(body.numbers)):
        lines[k] = lines[k][2:].replace("E", "D")
    path.write_text("\n".join(lines))
    np.testing.assert_array_equal(read_cdb(path).nodes, body.nodes)


@pytest.mark.parametrize("share", [0.02, 0.3, 0.7, 0.97])
def test_truncated_files(files, share):
    for name, reader in (("bar.full", read_full), ("bar.rst", read_rst)):
        path = files[0] / name
        path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])
        with pytest.raises(ModelError, match=r"truncated|damaged|header|within"):
            reader(path)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("(3i9,6e21.13e3)", "(x)", "a format like"),
        ("N,R5.3,LOC,       -1,\nEBLOCK", "EBLOCK", "a node"),
        ("       10        0        0", "       xx        0        0", "expected a node"),
        ("NBLOCK", "NBLICK", r"expected a block of nodes \(NBLOCK\), found none"),
        (
            "ENDS    ,NODE,       3",
            "ENDS    ,NODE,      99",
            "whole numbers in the columns .*, found 'FINISH'",
        ),
        ("       -13", "        -5", "ranges in component"),
        ("FINISH", "EBLOCK,19,SOLID,9,9\n(19i9)", r"the end of EBLOCK"),
    ],
)
def test_bad_archives(files, old, new, message):
    path = files[0] / "bar.cdb"
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(ModelError, match=message):
        read_cdb(path)
