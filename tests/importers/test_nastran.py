"""Nastran's cards in all formats, coordinate systems, OP4 and OP2 files, written after its manual."""

import numpy as np
import pytest
import scipy.sparse as sp

from bdamper.importers import read_bdf, read_op2, read_op4
from bdamper.util.errors import ModelError
from tests.each import each
from tests.importers.test_keywords import BULK
from tests.nastran_files import write_op2, write_op4

BRICK = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 2), (1, 0, 2), (1, 1, 2), (0, 1, 2)]


def read(tmp_path, *lines):
    (tmp_path / "a.bdf").write_text("\n".join(["BEGIN BULK", *lines, "ENDDATA", "any text", ""]))
    return read_bdf(tmp_path / "a.bdf")


def small(*fields):
    return "".join(f"{field:8}" for field in map(str, fields)).rstrip()


def large(*fields):
    rows = [fields[1:5], fields[5:9]]
    heads = [f"{fields[0]}*", "*"]
    lines = [
        f"{head:8}" + "".join(f"{field!s:16}" for field in row) for head, row in zip(heads, rows)
    ]
    return "\n".join(lines)


def free(*fields):
    return ",".join(map(str, fields))


def brick(card):
    """A brick with its material, in one of the three formats."""
    grids = [
        card("GRID", 10 + k, "", f"{x}.", f"{y}.", f"{z}.") for k, (x, y, z) in enumerate(BRICK)
    ]
    return [
        "$ a comment with $ and ,",
        *grids,
        # the labels of continuations are those of Patran
        f"{small('CHEXA', 5, 1, 10, 11, 12, 13, 14, 15):72}+A1   $",
        "+A1     16      17",
        card("PSOLID", 1, 3),
        card("MAT1", 3, "2.1+11", "", ".3", "7.85-9"),
        card("SET1", 7, 10, "THRU", 14),
    ]


@each("card", [small, large, free])
def test_cards_of_every_format(card, tmp_path):
    body = read(tmp_path, *brick(card))
    np.testing.assert_array_equal(body.numbers, np.arange(10, 18))
    np.testing.assert_array_equal(body.nodes, np.array(BRICK, float))
    np.testing.assert_array_equal(body.elements[0], [np.arange(10, 18)])
    (kind,) = body.element_kinds
    assert (kind.name, kind.youngs_modulus, kind.poisson_ratio) == ("C3D8", 2.1e11, 0.3)
    assert kind.density == 7.85e-9
    assert body.node_sets["SET7"].tolist() == [10, 11, 12, 13, 14]


def test_tabs_lower_case_and_case_control(tmp_path):
    lines = [line.lower().replace(",", "\t") for line in brick(free)]
    (tmp_path / "a.bdf").write_text(
        "\n".join(
            ["SOL 103", "CEND", "SET 5 = 1 THRU 9,", " 20", "begin bulk", *lines[1:], "enddata"]
        )
    )
    assert len(read_bdf(tmp_path / "a.bdf").numbers) == 8


def test_defaults_of_grid_points(tmp_path):
    """GRDSET: the system of positions, the axes of displacement, and held components."""
    lines = [
        "GRDSET,,8,,,,8,123456",
        "CORD2R,8,0,1.,0.,0.,1.,0.,1.,\n,1.,1.,0.",
        "GRID,1,,2.,0.,0.",
        "GRID,2,0,2.,0.,0.,0,4",
        # a rigid element of a held point
        "GRID,9,,0.,0.,0.",
        "RBE2,5,9,123,1",
        "CTETRA,1,1,1,2,3,4",
        "GRID,3,0,0.,1.,0.",
        "GRID,4,0,0.,0.,1.",
    ]
    body = read(tmp_path, *lines)
    # the first axis of system 8 is Y, the second -X, the origin (1, 0, 0)
    np.testing.assert_allclose(body.nodes[0], [1.0, 2.0, 0.0], atol=1e-15)
    np.testing.assert_allclose(body.nodes[1], [2.0, 0.0, 0.0], atol=1e-15)
    np.testing.assert_allclose(body.node_axes[1], [[0, 1, 0], [-1, 0, 0], [0, 0, 1]], atol=1e-15)
    assert 2 not in body.node_axes
    assert "RBE2 5 fixes its dependent grid points, because 9 is fixed" in body.notes


def test_chain_of_coordinate_systems(tmp_path):
    """A spherical system of grid points, in which a cylindrical system is given, and a point in it."""
    body = read(
        tmp_path,
        "CORD1S,3,1,2,4",
        "CORD2C,5,3,0.,0.,0.,2.,0.,0.\n,1.,90.,0.",
        "GRID,1,,1.,1.,1.",
        "GRID,2,,1.,1.,4.",
        "GRID,4,,3.,1.,1.",
        "GRID,6,3,2.,60.,30.",
        "GRID,7,5,2.,90.,-1.",
    )
    polar, azimuth = np.radians([60.0, 30.0])
    direction = [np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)]
    np.testing.assert_allclose(body.nodes[3], 1.0 + 2.0 * np.array(direction), rtol=1e-14)
    np.testing.assert_allclose(body.nodes[4], [1.0, 3.0, 0.0], rtol=1e-14, atol=1e-14)


WRONG = {
    "a system that depends on itself": ["CORD1R,3,1,2,4", "GRID,1,3,0.,0.,0.", "GRID,2", "GRID,4"],
    "an existing coordinate system, found 9": ["GRID,1,9,0.,0.,0."],
    "each grid point once, found 1 twice": ["GRID,1,,0.,0.,0.", "GRID,1,,0.,0.,1."],
    "an integer in field 2, found 'X'": ["GRID,X,,0.,0.,0."],
    "an ascending range, found 9 THRU 1": ["GRID,1", "SET1,3,9,THRU,1"],
    "the continuation 'A' of the line before, found 'B'": [
        f"{'CHEXA   5       1':72}+A",
        "+B      1",
    ],
    "at most 8 fields of data": ["GRID,1,,0.,0.,0.,,,,,5"],
    "the name of a card, found '+ 1'": ["+ 1"],
    "existing grid points, found [2]": ["GRID,1", "CTETRA,1,1,1,2,3,4"],
    "a real matrix, found values of type 3": [
        *["GRID,1", "DMIG,KAAX,0,6,3,0", "DMIG,KAAX,1,1,,1,1,2.,3."],
        *["DMIG,MAAX,0,6,1,0", "DMIG,MAAX,1,1,,1,1,2."],
    ],
    "BEGIN SUPER=1, which may create": ["GRID,1", "BEGIN SUPER=1"],
}


@each("expected", list(WRONG))
def test_wrong_cards_are_named(expected, tmp_path):
    with pytest.raises(ModelError) as caught:
        read(tmp_path, *WRONG[expected])
    text = str(caught.value)
    assert expected.replace("a system", "no system") in text and "\n" not in text, text
    assert "a.bdf: " in text


def test_both_triangles_of_a_symmetric_matrix(tmp_path):
    """Terms of a matrix of form 6 may lie in either triangle."""
    cards = []
    for name in ("KAAX", "MAAX"):
        cards += [f"DMIG,{name},0,6,2,0", f"DMIG,{name},1,1,,1,1,5.\n,2,1,-1."]
        cards += [f"DMIG,{name},2,1,,2,1,6.", f"DMIG,{name},3,1,,3,1,7.,,\n,2,1,-2."]
    grids = [f"GRID,{k},,{k}.,0.,0." for k in (1, 2, 3)]
    body = read(tmp_path, *grids, *cards)
    np.testing.assert_array_equal(body.stiffness.toarray(), [[5, -1, 0], [-1, 6, -2], [0, -2, 7]])


# ---- OP4 ----


@each("binary", [False, True])
@each("form", ["dense", "small", "wide"])
@each("kind", [1, 2])
@each("order", ["<", ">"])
def test_every_form_of_a_matrix(binary, form, kind, order, tmp_path):
    rng = np.random.default_rng(105)
    matrix = rng.standard_normal((7, 7)) * (rng.random((7, 7)) < 0.5)
    matrix[:, 3] = 0.0
    other = np.diag([1.0, 0.0, -3.0])
    contents = {"KGG": matrix + matrix.T, "MGG": other, "OBLONG": np.ones((2, 3))}
    write_op4(tmp_path / "a.op4", contents, binary, form, kind, order)
    found = read_op4(tmp_path / "a.op4")
    assert sorted(found) == ["KGG", "MGG"]
    accuracy = 2e-7 if kind == 1 else 1e-15
    np.testing.assert_allclose(found["KGG"].toarray(), contents["KGG"], rtol=accuracy)
    np.testing.assert_allclose(found["MGG"].toarray(), other, rtol=accuracy)


def test_other_formats_of_numbers(tmp_path):
    """Five numbers of 16 columns in a line, letters D of exponents, and numbers counted, not words."""
    matrix = np.arange(1.0, 37.0).reshape(6, 6)
    write_op4(tmp_path / "a.op4", {"K": matrix}, numbers=5, width=16)
    text = (tmp_path / "a.op4").read_text().replace("E+", "D+").replace("      12\n", "       6\n")
    (tmp_path / "a.op4").write_text(text.replace("5D16", "5E16"))
    np.testing.assert_array_equal(read_op4(tmp_path / "a.op4")["K"].toarray(), matrix)


@each("binary", [False, True])
@each("form", ["dense", "small", "wide"])
def test_complex_matrices_are_named(binary, form, tmp_path):
    write_op4(tmp_path / "a.op4", {"K": np.eye(3) * (1 + 2j)}, binary, form, 4)
    with pytest.raises(ModelError, match=r"a\.op4: K: expected a real matrix, found a complex one"):
        read_op4(tmp_path / "a.op4")


@each("binary", [False, True])
@each("form", ["dense", "small", "wide"])
def test_every_cut_of_a_matrix_is_refused(binary, form, tmp_path):
    """Files that end early, except in the number behind the last column."""
    write_op4(tmp_path / "a.op4", {"K": sp.eye(4) * 2.0}, binary, form)
    content = (tmp_path / "a.op4").read_bytes()
    end = len(content) - (0 if binary else 40)
    for length in range(0, end, 7):
        (tmp_path / "b.op4").write_bytes(content[:length])
        with pytest.raises(ModelError, match=r"b\.op4"):
            read_op4(tmp_path / "b.op4")


def test_long_integers_are_named(tmp_path):
    (tmp_path / "a.op4").write_bytes(b"\x30\0\0\0" + bytes(60))
    with pytest.raises(ModelError, match=r"integers of four bytes .*, found eight bytes"):
        read_op4(tmp_path / "a.op4")


# ---- OP2 ----


@each("order", ["<", ">"])
def test_modes_of_grid_points(order, tmp_path):
    numbers, hertz, masses = np.array([3, 4, 8, 9]), [50.0, 80.0], [2.0, 3.0]
    shapes = np.random.default_rng(105).standard_normal((4, 3, 2))
    # the third point is a scalar point
    write_op2(tmp_path / "m.op2", numbers, shapes, hertz, masses, order, types=[1, 1, 2, 1])
    modes = read_op2(tmp_path / "m.op2", nodal_diameter=3)
    assert modes.nodal_diameter == 3
    np.testing.assert_array_equal(modes.numbers, [3, 4, 9])
    np.testing.assert_allclose(modes.frequency, hertz, rtol=1e-6)
    np.testing.assert_allclose(modes.modal_mass, masses, rtol=1e-6)
    np.testing.assert_allclose(modes.shapes, shapes[[0, 1, 3]], rtol=1e-6)
    quarter = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])  # first axis along Y
    turned = read_op2(tmp_path / "m.op2", axes={4: quarter})
    np.testing.assert_allclose(turned.shapes[1, 1], modes.shapes[1, 0])
    np.testing.assert_allclose(turned.shapes[1, 0], -modes.shapes[1, 1])
    with pytest.raises(ModelError, match=r"a subcase out of \[1\], found 4"):
        read_op2(tmp_path / "m.op2", subcase=4)
    content = (tmp_path / "m.op2").read_bytes()
    # the last table ends with a marker of its number, a flag and two zeros of 12 bytes each
    for length in range(0, len(content) - 100, 97):
        (tmp_path / "x.op2").write_bytes(content[:length])
        with pytest.raises(ModelError, match=r"x\.op2"):
            read_op2(tmp_path / "x.op2")


def test_an_included_file_may_have_a_comment(tmp_path):
    (tmp_path / "grid.bdf").write_text(BULK.split("\n", 1)[1])
    assert len(read(tmp_path, "INCLUDE 'grid.bdf'  $ the mesh").numbers) == 4
