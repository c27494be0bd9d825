"""Plain files, CalculiX, Nastran and universal files: what is written here comes back, what is broken is named."""

import shutil
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy.io
import scipy.sparse as sp

pytest.importorskip("skfem", reason="scikit-fem is not installed (extra bdamper[fe])")

from bdamper.fem.contact_patches import Facets
from bdamper.fem.meshes import (
    ElasticMaterial,
    Geometry,
    MeshDensity,
    damper_mesh,
    discretise,
    join_blocks,
    local_order,
)
from bdamper.fem.surface import area_vectors, enclosed_volume
from bdamper.importers import (
    Measurement,
    arrays,
    read_abaqus_matrix,
    read_arrays,
    read_bdf,
    read_body,
    read_calculix,
    read_dofs,
    read_frd,
    read_inp,
    read_matrix,
    read_measurements,
    read_nastran,
    read_nodes,
    read_op4,
    read_set,
)
from bdamper.importers.abaqus import read_frd_stress
from bdamper.importers.arrays import read_mat
from bdamper.importers.fe_body import parsing
from bdamper.importers.prepared_body import Placement, PreparedBody
from bdamper.util.errors import BdamperError, BdamperWarning, ModelError, mismatch
from bdamper.util.storage import load
from examples.calculix.decks import matrix_input, run_job
from tests.calculix_runs import free_input
from tests.each import each
from tests.nastran_files import write_op4

NASTRAN = Path(__file__).resolve().parents[3] / "shared" / "fixtures" / "nastran"


@pytest.fixture(scope="module")
def bar():
    grid = np.stack(np.meshgrid([0.0, 0.1, 0.25], [0.3, 0.5], [0.0, 0.2], indexing="ij"), axis=-1)
    return discretise(join_blocks([grid]), ElasticMaterial())


# ---- matrices and tables ----


def coordinate_text(matrix, triangle=True):
    entries = sp.triu(matrix).tocoo() if triangle else matrix.tocoo()
    return "".join(
        f"{i + 1}, {j + 1}, {v:.16e}\n" for i, j, v in zip(entries.row, entries.col, entries.data)
    )


def node_text(matrix, numbers):
    entries = sp.triu(matrix).tocoo()
    return "".join(
        f"{numbers[i // 3]},{i % 3 + 1}, {numbers[j // 3]},{j % 3 + 1}, {v:.16e}\n"
        for i, j, v in zip(entries.row, entries.col, entries.data)
    )


def test_a_matlab_file_of_version_7_3(bar, tmp_path, monkeypatch):
    """An HDF5 file after 512 bytes of text: dense matrices transposed, sparse ones as a group, complex ones skipped."""
    k, path = sp.csc_matrix(bar.stiffness), tmp_path / "new.mat"
    uneven = k + sp.csc_matrix(np.triu(np.ones(k.shape)))
    with h5py.File(path, "w", userblock_size=512) as file:
        file["K"] = uneven.toarray().T
        file["z"] = np.ones((2, 2)) * 1j
        file["away"] = h5py.ExternalLink("other.mat", "K")
        group = file.create_group("S")
        group.attrs["MATLAB_sparse"] = k.shape[0]
        for name, values in (("data", k.data), ("ir", k.indices), ("jc", k.indptr)):
            group[name] = values
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file")
    found = read_mat(path)
    assert sorted(found) == ["K", "S"]
    np.testing.assert_array_equal(found["K"], uneven.toarray())
    np.testing.assert_array_equal(read_matrix(path, "S").toarray(), k.toarray())
    monkeypatch.setattr(arrays, "MOST_BYTES", 100)
    with pytest.raises(
        ModelError, match=r"new.mat: 'K': expected bytes, with those before it, from 0 to 100"
    ):
        read_matrix(path, "S")


def test_every_form_of_a_matrix(bar, tmp_path):
    k = bar.stiffness
    sp.save_npz(tmp_path / "sparse.npz", k)
    np.savez(tmp_path / "dense.npz", K=k.toarray(), other=np.ones(3))
    np.save(tmp_path / "dense.npy", k.toarray())
    scipy.io.savemat(tmp_path / "both.mat", {"K": k, "M": bar.mass})
    scipy.io.savemat(
        tmp_path / "compressed.mat",
        {"K": k.toarray(), "text": "x", "z": np.ones(2) * 1j},
        do_compression=True,
    )
    scipy.io.savemat(tmp_path / "integers.mat", {"K": np.arange(9).reshape(3, 3)})
    (tmp_path / "abaqus.mtx").write_text(coordinate_text(k))
    (tmp_path / "whole.mtx").write_text(coordinate_text(k, triangle=False))
    for name, key in (
        ("sparse.npz", None), ("dense.npz", "K"), ("dense.npy", None), ("both.mat", "K"),
        ("compressed.mat", "K"), ("abaqus.mtx", None), ("whole.mtx", None),
    ):  # fmt: skip
        found = read_matrix(tmp_path / name, key)
        assert abs(found - k).max() < 1e-9 * abs(k).max(), name
    np.testing.assert_array_equal(
        read_matrix(tmp_path / "integers.mat").toarray(), np.arange(9).reshape(3, 3)
    )


def test_arrays_and_tables_together(bar, tmp_path):
    """Matrices with the table of nodes in them, CSV for everything else."""
    numbers = 7 * np.arange(1, len(bar.nodes) + 1)
    shuffled = np.random.default_rng(0).permutation(len(numbers))
    (tmp_path / "k.mtx").write_text(node_text(bar.stiffness, numbers))
    (tmp_path / "m.mtx").write_text(node_text(bar.mass, numbers))
    rows = [f"{numbers[i]}," + ",".join(map(repr, bar.nodes[i].tolist())) for i in shuffled]
    (tmp_path / "nodes.csv").write_text(
        "number,x,y,z\n" + "\n".join(r.replace("np.float64(", "").replace(")", "") for r in rows)
    )
    (tmp_path / "ends.csv").write_text("# ends\n7\n14\n")
    (tmp_path / "faces.csv").write_text("7,14,21,28\n")
    found = read_arrays(
        tmp_path / "k.mtx", tmp_path / "m.mtx", tmp_path / "nodes.csv",
        sets={"ends": tmp_path / "ends.csv", "face": tmp_path / "faces.csv", "given": np.array([7])},
    )  # fmt: skip
    assert list(found.node_sets["ends"]) == [7, 14]
    assert found.face_sets["face"][0].tolist() == [[7, 14, 21, 28]]
    order = np.lexsort((found.dofs[:, 1], found.dofs[:, 0]))
    k = found.stiffness.toarray()[np.ix_(order, order)]
    np.testing.assert_allclose(k, bar.stiffness.toarray(), atol=1e-9 * k.max())
    m = found.mass.toarray()[np.ix_(order, order)]
    np.testing.assert_allclose(m, bar.mass.toarray(), atol=1e-14)
    np.testing.assert_allclose(found.nodes, bar.nodes[shuffled])


BAD_TEXT = [
    ("k.mtx", "1, 1\n", "line 1: expected 3 or 5 numbers, found 2"),
    ("k.mtx", "1, 1, 2.0\n1, x, 3.0\n", "line 2: expected numbers, found 1, x"),
    ("k.mtx", "1.5, 1, 2.0\n", "column 1: expected whole numbers, found 1.5"),
    ("k.mtx", "1, 1, nan\n", "expected finite numbers"),
    ("k.mtx", "0, 1, 1.0\n", "rows and columns counted from 1"),
    ("k.mtx", "1, 1000000000, 1.0\n", "rows and columns counted from 1"),
    ("k.mtx", "\n", "at least one line of numbers, found none"),
    (
        "k.mtx",
        "%%MatrixMarket matrix coordinate real general\n1 1 1\n1 1 1.0\n",
        "pass the matrix of scipy.io.mmread",
    ),
    ("k.npz", "no archive", "a matrix as .npz"),
    ("k.mat", "no MATLAB file", "a MATLAB file of version 5 to 7.3, found no such header"),
    ("k.dat", "1 1 1.0", "the extension .npz, .npy, .mat or .mtx, found '.dat'"),
]


@each(("name", "text", "message"), BAD_TEXT, ids=[m[:30] + n for n, _, m in BAD_TEXT])
def test_bad_matrices(tmp_path, name, text, message):
    (tmp_path / name).write_text(text)
    with pytest.raises(ModelError, match=message) as caught:
        read_matrix(tmp_path / name)
    assert name in str(caught.value)


@each(
    ("read", "text", "message"),
    [
        (read_nodes, "1,0,0,0\n2,0,0\n", "line 2: expected 4 numbers, found 3"),
        (read_nodes, "1.5,0,0,0\n", "column 1: expected whole numbers"),
        (read_dofs, "1,2,3\n", "expected 2 numbers"),
        (read_set, "1,2,3,4,5\n", "1 or 3 or 4 or 6 or 8 numbers"),
    ],
)
def test_bad_tables(tmp_path, read, text, message):
    (tmp_path / "t.csv").write_text(text)
    with pytest.raises(ModelError, match=message):
        read(tmp_path / "t.csv")


def test_tables_that_do_not_fit(tmp_path):
    (tmp_path / "t.csv").write_text("12.3\n13.1\n")
    assert read_dofs(tmp_path / "t.csv").tolist() == [[12, 3], [13, 1]]
    with pytest.raises(FileNotFoundError, match=r"there is no file .*none.csv"):
        read_set(tmp_path / "none.csv")
    np.savez(tmp_path / "two.npz", a=np.eye(3), b=np.eye(3))
    with pytest.raises(ModelError, match=r"the name of an array, found the arrays \['a', 'b'\]"):
        read_matrix(tmp_path / "two.npz")
    with pytest.raises(ModelError, match=r"an array 'c'"):
        read_matrix(tmp_path / "two.npz", "c")
    (tmp_path / "k.mtx").write_text("1,1, 1,1, 1.0\n")
    (tmp_path / "m.mtx").write_text("2,1, 2,1, 1.0\n")
    with pytest.raises(
        ModelError, match=r"nodes and components of the stiffness matrix, found also \[\(2, 1\)"
    ):
        read_arrays(tmp_path / "k.mtx", tmp_path / "m.mtx", (np.array([1, 2]), np.zeros((2, 3))))
    assert read_abaqus_matrix(tmp_path / "k.mtx")[1].tolist() == [[1, 1]]


def test_a_matrix_that_cannot_be_opened_is_refused(tmp_path, bar, monkeypatch):
    (tmp_path / "k.mtx").write_text(coordinate_text(bar.stiffness))

    def denied(path, *_, **__):
        raise PermissionError(13, "Permission denied", str(path))

    monkeypatch.setattr(Path, "read_bytes", denied)
    with pytest.raises(
        ModelError, match=r"k\.mtx: expected Abaqus coordinate text, found PermissionError"
    ):
        read_arrays(tmp_path / "k.mtx", bar.mass, (np.arange(len(bar.nodes)), bar.nodes))


def test_errors_of_checks_pass_where_numbers_are_parsed():
    with (
        pytest.raises(ModelError, match=r"^line 3: expected a count of 8, found 7$"),
        parsing("file", "numbers", "x"),
    ):
        raise mismatch("line 3", "a count of 8", 7)
    with (
        pytest.raises(ModelError, match=r"^file: expected numbers, found 'x'$"),
        parsing("file", "numbers", "x"),
    ):
        float("x")


# ---- CalculiX ----

DECK = """*HEADING
a comment follows
** comment
*NODE, NSET=ALL
1, 0., 0., 0.
2, 1., 0.
3, 1., 1., 0.
4, 0., 1., 0.
5, 0., 0., 2.
6, 1., 0., 2.
7, 1., 1., 2.
8, 0., 1., 2.
*ELEMENT, TYPE=C3D8R, ELSET=BODY
11, 1, 2, 3, 4,
5, 6, 7, 8
*ELEMENT, TYPE=S4, ELSET=SHELL
12, 1, 2, 3, 4
*NSET, NSET=ends
1, 2
ALL
*NSET, NSET=steps, GENERATE
1, 7, 3
*ELSET, ELSET=top
11
*SURFACE, NAME=face
top, S2
11, S4
*SURFACE, NAME=points, TYPE=NODE
steps,
"""


def test_deck(tmp_path):
    (tmp_path / "a.inp").write_text(DECK)
    (tmp_path / "b.inp").write_text("*INCLUDE, INPUT=a.inp\n")
    for name in ("a.inp", "b.inp"):
        body = read_inp(tmp_path / name)
        assert body.numbers.tolist() == list(range(1, 9))
        assert body.elements[0].tolist() == [list(range(1, 9))]
        assert body.node_sets["STEPS"].tolist() == [1, 4, 7]
        assert body.node_sets["ENDS"].tolist() == list(range(1, 9))
        facets = body.face_sets["face".upper()][0]
        vectors = area_vectors(Facets((facets - 1,)), body.nodes)
        np.testing.assert_allclose(vectors, [[0, 0, 1], [2, 0, 0]], atol=1e-15)
        assert body.node_sets["POINTS"].tolist() == [1, 4, 7]
        assert "elements of type S4 are not read" in str(body)


def test_the_reader_follows_from_the_ending(tmp_path):
    for name in ("a.inp", "B.INP"):
        (tmp_path / name).write_text(DECK)
        body = read_body(tmp_path / name)
        np.testing.assert_array_equal(body.nodes, read_inp(tmp_path / name).nodes)
        assert len(body.elements) == len(read_inp(tmp_path / name).elements) > 0
    (tmp_path / "a.frd").write_text(DECK)
    with pytest.raises(ModelError, match=r"a\.frd: expected a block of nodes \(2C\), found none"):
        read_body(tmp_path / "a.frd")
    with pytest.raises(FileNotFoundError, match=r"there is no file '.*none\.cdb'"):
        read_body(tmp_path / "none.cdb")
    with pytest.raises(
        ModelError,
        match=r"a\.stp: expected a file name with one of the extensions \['\.bdf', .*found '\.stp'",
    ):
        read_body(tmp_path / "a.stp")


def frd_block(name, values, mode, hertz):
    """A result of one mode as CalculiX writes it: node numbers from 1."""
    rows = [f" -1{k + 1:10d}" + "".join(f"{v:12.5E}" for v in row) for k, row in enumerate(values)]
    head = [
        f"    1PHID  {2:10d}",
        f"    1PMODE {mode:10d}",
        f"  100CL{100 + mode:5d}{hertz:12.5E}{len(rows):12d}" + " " * 30 + "1",
    ]
    return [*head, f" -4  {name:8s}    4    1", " -5  ALL         1    2    1    0", *rows, " -3"]


def test_real_and_imaginary_parts_of_a_result_file_are_put_together(tmp_path):
    rng = np.random.default_rng(3)
    nodes = rng.standard_normal((3, 3))
    lines = [
        "    2C" + " " * 40 + "1",
        *(f" -1{k + 1:10d}" + "".join(f"{v:12.5E}" for v in x) for k, x in enumerate(nodes)),
        " -3",
    ]
    parts = rng.standard_normal((2, 2, 3, 3))
    stress = rng.standard_normal((2, 2, 3, 6))
    for mode, hertz in ((1, 120.0), (2, 340.0)):
        for part, ending in enumerate(("", "I")):
            lines += frd_block("DISP" + ending, parts[mode - 1, part], mode, hertz)
            lines += frd_block("STRESS" + ending, stress[mode - 1, part], mode, hertz)
    (tmp_path / "a.frd").write_text("\n".join([*lines, " 9999"]))
    (modes,) = read_body(tmp_path / "a.frd").modes
    assert modes.nodal_diameter == 2
    np.testing.assert_array_equal(modes.frequency, [120.0, 340.0])
    np.testing.assert_allclose(
        modes.shapes, np.moveaxis(parts[:, 0] + 1j * parts[:, 1], 0, 2), atol=1e-4
    )
    found = read_frd_stress(tmp_path / "a.frd")
    np.testing.assert_allclose(
        [values for _, values in found], stress[:, 0] + 1j * stress[:, 1], atol=1e-4
    )


BAD_DECKS = [
    ("1, 0., 0., 0.", "1, 0., zero, 0.", "line 5: expected a node number and its position"),
    (
        "11, 1, 2, 3, 4,",
        "11, 1, 2, 3,",
        r"\*ELEMENT in line 13: expected 1 \+ 8 numbers for each element of type C3D8R",
    ),
    ("1, 7, 3", "1, 7, 0", "first, last and step"),
    ("1, 7, 3", "1, 99999999999, 1", "first, last and step"),
    ("\nALL\n", "\nNONE\n", r"a number or one of the sets .*, found 'NONE'"),
    ("top, S2", "top, S7", "faces S1 to S6, found 'S7'"),
    (
        "top, S2",
        "bottom, S2",
        r"an element or one of the sets \['BODY', 'SHELL', 'TOP'\], found 'bottom'",
    ),
    ("11, S4", "44, S4", "element 44 is not a solid element of this deck"),
    (
        "*NODE",
        "*NOTE",
        # an unknown keyword is passed over, so the set that it would define is missing
        r"a\.inp: line 20: expected a number or one of the sets \['ENDS'\], found 'ALL'",
    ),
    ("*HEADING", "*INCLUDE, INPUT=c.inp", "expected an existing file, found 'c.inp'"),
    ("*HEADING", "*INCLUDE, INPUT=a.inp", "at most 100 included files, nested at most 5 deep"),
    ("5, 6, 7, 8\n", "5, 6, 7, 99\n", "elements with existing nodes, found nodes .99"),
]


@each(("old", "new", "message"), BAD_DECKS, ids=[m[:40] for *_, m in BAD_DECKS])
def test_bad_decks(tmp_path, old, new, message):
    assert old in DECK
    (tmp_path / "a.inp").write_text(DECK.replace(old, new, 1))
    with pytest.raises(ModelError, match=message) as caught:
        read_inp(tmp_path / "a.inp")
    assert "a.inp" in str(caught.value)


@pytest.fixture(scope="module")
def run(bar, tmp_path_factory):
    """Matrices and a cyclic run of CalculiX, of a damper."""
    if shutil.which("ccx") is None:
        pytest.skip("CalculiX (ccx) is not installed")
    folder = tmp_path_factory.mktemp("ccx")
    body = discretise(
        damper_mesh(Geometry(), MeshDensity(2, 1, 1, 2, 1, 1, 1, 1, 1, 1, 1, 2)), ElasticMaterial()
    )
    run_job(matrix_input(body, {"SOME": np.arange(5)}), folder, "damper")
    free = free_input(body, 8).replace("*END STEP", "*NODE FILE\nU\n*END STEP")
    run_job(free, folder, "modes")
    return folder, body


def test_matrices_of_calculix(run):
    folder, body = run
    found = read_calculix(folder / "damper", modes=folder / "modes.frd")
    order = np.lexsort((found.dofs[:, 1], found.dofs[:, 0]))
    k, m = (x.toarray()[np.ix_(order, order)] for x in (found.stiffness, found.mass))
    # other elements than ours (their own integration), the same matrices
    np.testing.assert_allclose(k, body.stiffness.toarray(), atol=1e-9 * k.max())
    np.testing.assert_allclose(m, body.mass.toarray(), atol=1e-6 * m.max())
    np.testing.assert_allclose(found.nodes, body.nodes, atol=1e-11)
    assert found.node_sets["SOME"].tolist() == [1, 2, 3, 4, 5]
    assert len(found.modes[0].frequency) == 8
    other = read_calculix(folder / "damper.sti", mesh=folder / "modes.frd")
    np.testing.assert_allclose(other.nodes, body.nodes, atol=1e-6)
    assert [e.shape for e in other.elements] == [e.shape for e in found.elements]
    shapes = found.modes[0].shapes[:, :, 6:].reshape(-1, 2)
    np.testing.assert_allclose(shapes.T @ body.mass @ shapes, np.eye(2), atol=1e-4)


@pytest.mark.parametrize(
    ("ending", "change", "message"),
    [
        ("sti", lambda t: t[: len(t) // 2] + "\n1 2", "lines of row, column, value"),
        (
            "sti",
            lambda t: "99999 1 1.0\n" + t,
            "rows and columns 1 to .*, as many .*, found 1 to 99999",
        ),
        ("sti", lambda t: "1 1 nan\n" + t, "expected finite numbers"),
        ("mas", lambda t: "a b c\n" + t, "lines of row, column, value"),
        ("dof", lambda t: "1,1,1\n" + t, "line 1: expected 2 numbers, found 3"),
        ("dof", lambda t: "", "at least one line of numbers, found none"),
        ("dof", lambda t: t.splitlines()[0], "rows and columns 1 to 1"),
    ],
)
def test_bad_matrices_of_calculix(run, tmp_path, ending, change, message):
    for source in run[0].glob("damper.*"):
        shutil.copy(source, tmp_path)
    path = tmp_path / f"damper.{ending}"
    path.write_text(change(path.read_text()))
    with pytest.raises(ModelError, match=message) as caught:
        read_calculix(tmp_path / "damper")
    assert "damper." in str(caught.value)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            lambda t: t[: len(t) // 2],
            "the end of a block|a node number and 3 values|a line of values",
        ),
        (lambda t: t.replace("    2C", "    4C", 1), r"a block of nodes \(2C\)"),
        (lambda t: t.replace(" -1         3", " -1         x", 1), "a node number and 3 values"),
        (
            lambda t: t.replace("  100CL", "  100CL   x", 1),
            "a frequency in columns 13 to 24|result file",
        ),
        (lambda t: "\x00" + t, "the binary form"),
    ],
)
def test_bad_results_of_calculix(run, tmp_path, change, message):
    text = (run[0] / "modes.frd").read_text()
    (tmp_path / "x.frd").write_text(change(text))
    for read in (read_frd, read_frd_stress):
        with pytest.raises(ModelError, match=message):
            read(tmp_path / "x.frd")


# ---- universal files ----


def block(kind, lines):
    return f"    -1\n{kind:6d}\n" + "\n".join(lines) + "\n    -1\n"


@pytest.fixture
def universal(tmp_path):
    pyuff = pytest.importorskip("pyuff", reason="pyuff is not installed (extra bdamper[unv])")
    return pyuff, tmp_path / "a.unv"


def test_measured_response(universal, tmp_path):
    pyuff, path = universal
    x = np.linspace(100.0, 200.0, 51)
    y = 1e-5 / (150.0 - x + 2j)
    functions = [
        pyuff.prepare_58(
            binary=0, func_type=4, rsp_node=17, rsp_dir=-2, ref_dir=1, ref_node=3, data=y, x=x, id1="tip", id2="",
            id3="", id4="", id5="", rsp_ent_name="B", ref_ent_name="B", abscissa_spacing=1, abscissa_spec_data_type=18,
            ordinate_spec_data_type=8, orddenom_spec_data_type=13, ordinate_axis_units_lab="m",
        )
    ]  # fmt: skip
    pyuff.UFF(str(path)).write_sets(functions, "overwrite")
    (found,) = read_measurements(path)
    np.testing.assert_allclose(found.frequency, x, rtol=1e-5)
    np.testing.assert_allclose(found.response, y, rtol=1e-4)
    assert (found.node, found.direction, found.name, found.unit) == (17, -2, "tip", "m")
    assert "100 to 200 Hz  51 points" in str(found) and found._headline().endswith(" Hz: tip")
    (axes,) = found.plot(scale=1e3).axes
    np.testing.assert_allclose(axes.lines[0].get_ydata(), 1e3 * found.amplitude)
    found.save(tmp_path / "m.h5")
    again = load(tmp_path / "m.h5")
    np.testing.assert_array_equal(again.response, found.response)
    assert str(again) == str(found)
    (tmp_path / "x.h5").write_bytes(b"no file")
    with pytest.raises(BdamperError, match="a file written by bdamper"):
        load(tmp_path / "x.h5")
    with pytest.raises(ModelError, match="as many responses as frequencies"):
        Measurement("x", np.ones(3), np.ones(2))


def function_58(kind, data=(1.0, 2.0, 3.0), abscissa=18):
    """Data set 58 of three real values, as the manual of the format describes it."""
    head = ["record", "NONE", "01-Jan-26 10:00:00", "NONE", "NONE"]
    head += [f"{kind:5d}{0:10d}{0:5d}{0:10d}       NONE{1:10d}{3:4d}       NONE{1:10d}{3:4d}"]
    head += [f"{2:10d}{len(data):10d}{1:10d}{1:13.5E}{1:13.5E}{0:13.5E}"]
    axes = (abscissa, 12, 0, 0)
    head += [f"{axis:10d}{0:5d}{0:5d}{0:5d} NONE                 NONE" for axis in axes]
    return block(58, [*head, "".join(f"{value:13.5E}" for value in data)])


OTHERS = {
    1: "record over time",
    2: "auto-spectrum",
    3: "cross-spectrum",
    6: "coherence",
    9: "power spectral density",
    25: "function of type 25",
}


@each("kind", OTHERS)
def test_functions_that_are_no_responses_are_named(kind, universal):
    _, path = universal
    text = function_58(kind, abscissa=17 if kind == 1 else 18)
    path.write_text(text)
    with pytest.raises(ModelError, match=rf"functions .*, found {OTHERS[kind]}") as caught:
        read_measurements(path)
    assert ("read_ring_down" in str(caught.value)) == (kind == 1)
    # beside a response they are left out with a warning
    path.write_text(text + function_58(4))
    with pytest.warns(BdamperWarning, match=f"found also {OTHERS[kind]}"):
        (found,) = read_measurements(path)
    np.testing.assert_allclose(found.response, [1.0, 2.0, 3.0])


@each(
    ("kind", "name"),
    [(0, "record"), (4, "record"), (5, "record (transmissibility)"), (12, "record (spectrum)")],
)
def test_responses_of_other_types_are_named(kind, name, universal):
    _, path = universal
    path.write_text(function_58(kind))
    (found,) = read_measurements(path)
    assert found.name == name


@pytest.mark.parametrize(
    "text", ["", "nothing of the kind\n", block(58, ["x"] * 12), block(15, [])]
)
def test_bad_universal_files(universal, text):
    path = universal[1]
    path.write_text(text)
    with pytest.raises(ModelError, match=r"frequency response functions|universal file"):
        read_measurements(path)


# ---- Nastran ----


def test_real_op4():
    path = NASTRAN / "testplate_kgg.op4"
    if not path.exists():
        pytest.skip(f"{path.name} is not here: {NASTRAN} is not part of the project")
    k = read_op4(path)["KGG"]
    assert k.shape == (726, 726)
    assert abs(k - k.T).max() == 0.0
    values = np.linalg.eigvalsh(k.toarray())
    assert np.sum(np.abs(values) < 1e-12 * values[-1]) == 6
    assert values[6] > 1e-9 * values[-1]
    assert values[0] > -1e-14 * values[-1]


def bulk_text(numbers, nodes, elements):
    lines = ["BEGIN BULK"]
    for number, x in zip(numbers, nodes):
        lines.append(f"GRID,{number},,{x[0]:.9f},{x[1]:.9f},{x[2]:.9f}")
    for k, e in enumerate(elements):
        first = ",".join(map(str, e[:6]))
        lines.append(f"CHEXA,{k + 1},1,{first}")
        rest = [e[6:14], e[14:]]
        lines += ["," + ",".join(map(str, r)) for r in rest if len(r)]
    lines += ["PSOLID,1,1", "MAT1,1,2.1+11,,0.3,7850.", "SET1,5,10,THRU,12", "ENDDATA", ""]
    return "\n".join(lines)


def nastran_order(common):
    """Corners, bottom middles, upright ones, top middles."""
    return common[:, [*range(12), 16, 17, 18, 19, 12, 13, 14, 15]]


def test_bulk_data_and_op4(bar, tmp_path):
    numbers = 10 + np.arange(len(bar.nodes))
    elements = nastran_order(numbers[bar.elements[:, local_order()]])
    (tmp_path / "a.bdf").write_text(bulk_text(numbers, bar.nodes, elements))
    rows = (6 * np.arange(len(numbers))[:, None] + np.arange(3)).ravel()
    pick = sp.csr_matrix(
        (np.ones(len(rows)), (rows, np.arange(len(rows)))), shape=(6 * len(numbers), len(rows))
    )
    full = {name: pick @ m @ pick.T for name, m in (("KNN", bar.stiffness), ("MNN", bar.mass))}
    write_op4(tmp_path / "a.op4", full)
    found = read_nastran(tmp_path / "a.bdf", tmp_path / "a.op4")
    assert found.dofs.shape == (3 * len(numbers), 2)
    np.testing.assert_allclose(
        found.stiffness.toarray(), bar.stiffness.toarray(), atol=1e-9 * abs(bar.stiffness).max()
    )
    np.testing.assert_allclose(found.nodes, bar.nodes, atol=1e-9)
    prepared = PreparedBody("bar", found, Placement())
    assert enclosed_volume(prepared.boundary, prepared.nodes) == pytest.approx(
        0.25 * 0.2 * 0.2, rel=1e-7
    )
    assert "empty rows dropped" in str(found)
    with pytest.raises(ModelError, match=r"a matrix 'KXX', found the matrices \['KNN', 'MNN'\]"):
        read_nastran(tmp_path / "a.bdf", tmp_path / "a.op4", names=("KXX", "MGG"))


def test_dmig(tmp_path):
    text = bulk_text([10, 11], np.zeros((2, 3)) + [[0, 0, 0], [1, 0, 0]], [])
    cards = []
    for name, scale in (("KAAX", 100.0), ("MAAX", 1.0)):
        cards.append(f"DMIG,{name},0,6,2,0")
        cards.append(f"DMIG,{name},10,1,,10,1,{2 * scale}\n,11,1,{-scale}")
        cards.append(f"DMIG,{name},11,1,,11,1,{3 * scale}")
    (tmp_path / "d.bdf").write_text(text.replace("ENDDATA", "\n".join([*cards, "ENDDATA"])))
    found = read_nastran(tmp_path / "d.bdf")
    assert found.dofs.tolist() == [[10, 1], [11, 1]]
    np.testing.assert_allclose(found.stiffness.toarray(), [[200.0, -100.0], [-100.0, 300.0]])
    np.testing.assert_allclose(found.mass.toarray(), [[2.0, -1.0], [-1.0, 3.0]])


def test_axes_of_displacement(tmp_path):
    (tmp_path / "c.bdf").write_text(
        "BEGIN BULK\nCORD2C,7,,0.,0.,0.,0.,0.,1.\n,1.,0.,0.\nGRID,1,,0.,2.,0.,7\nGRID,2,7,3.,90.,1.\nENDDATA\n"
    )
    body = read_bdf(tmp_path / "c.bdf")
    np.testing.assert_allclose(
        body.nodes[1], [0.0, 3.0, 1.0], atol=1e-12
    )  # given in cylindrical coordinates
    np.testing.assert_allclose(body.node_axes[1], [[0, 1, 0], [-1, 0, 0], [0, 0, 1]], atol=1e-12)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "GRID,1,,x,0.,0.\n",
        "BEGIN BULK\nGRID,1,99,0.,0.,0.\nENDDATA\n",
        "BEGIN BULK\nCTETRA,1,1,1,2,3,4\nENDDATA\n",
    ],
)
def test_bad_bulk_data(tmp_path, text):
    (tmp_path / "x.bdf").write_text(text)
    with pytest.raises(ModelError, match=r"x\.bdf"):
        read_bdf(tmp_path / "x.bdf")


def test_missing_library_is_named(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "pyuff", None)
    (tmp_path / "a.unv").write_text(block(15, []))
    with pytest.raises(BdamperError, match=r"install the extra bdamper\[unv\]"):
        read_measurements(tmp_path / "a.unv")
