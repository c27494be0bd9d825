"""Each form of a block of an Ansys archive: read as it was written, or refused by name and line."""

import re

import numpy as np
import pytest

from bdamper.importers import read_cdb
from bdamper.util.errors import ModelError
from tests.each import each

# two bricks on top of each other, with coordinates that need all their digits
NODES = {
    k + 10: (x + 0.25, y / 3.0, 1e-3 * z)
    for k, (z, y, x) in enumerate(np.ndindex(3, 2, 2), start=1)
}
CORNERS = (0, 1, 3, 2)
BRICKS = [
    [11 + 4 * layer + k for k in CORNERS] + [15 + 4 * layer + k for k in CORNERS]
    for layer in (0, 1)
]
HELD = [11, 12, 13, 14, 18, 21, 22]


def scientific(value, width, digits, exponent=2, letter="E"):
    """A number in the form Ew.dEe of Fortran."""
    mantissa, power = f"{value:.{digits}E}".split("E")
    return f"{mantissa}{letter}{int(power):+0{exponent + 1}d}".rjust(width)


def node_lines(form, whole, real, n_whole=3, gap=0):
    """NBLOCK with fields of ``whole`` columns and numbers from ``real``; zeros at the end of a line are left out."""
    head = (
        f"NBLOCK,6,SOLID,{max(NODES)},{len(NODES)}" if n_whole == 3 else f"NBLOCK,3,,{len(NODES)}"
    )
    lines = [head, form]
    for number, position in NODES.items():
        numbers = [number, *[0] * (n_whole - 1)]
        line = "".join(f"{value:{whole}d}" for value in numbers) + " " * gap
        lines.append(line + "".join(real(x) for x in position))
    return [*(line.rstrip() for line in lines), "N,R5.3,LOC,       -1,"]


def element_lines(width, head="EBLOCK,19,SOLID,2,2", end=True):
    lines = [head, f"(19i{width})"]
    for k, nodes in enumerate(BRICKS):
        values = [1, 1, 1, 1, 0, 0, 0, 0, 8, 0, k + 1, *nodes]
        lines.append("".join(f"{value:{width}d}" for value in values))
    return [*lines, f"{-1:{width}d}"] if end else lines


NODE_FORMS = {
    "(3i8,6e16.9)": (8, lambda x: scientific(x, 16, 9), 3, 0, 1e-9),
    "(3i8,6e20.13)": (8, lambda x: scientific(x, 20, 13), 3, 0, 1e-13),
    "(3i9,6e21.13e3)": (9, lambda x: scientific(x, 21, 13, 3), 3, 0, 1e-13),
    "(3i10,6e21.13e3)": (10, lambda x: scientific(x, 21, 13, 3), 3, 0, 1e-13),
    "(3i9,1p6e21.13)": (9, lambda x: scientific(x, 21, 13), 3, 0, 1e-13),
    "(3i9,6es21.13e3)": (9, lambda x: scientific(x, 21, 13, 3), 3, 0, 1e-13),
    "(3i9,2x,6e21.13)": (9, lambda x: scientific(x, 21, 13), 3, 2, 1e-13),
    "(3i9,6d21.13)": (9, lambda x: scientific(x, 21, 13, letter="d"), 3, 0, 1e-13),
    "(3i9,2(3e21.13e3))": (9, lambda x: scientific(x, 21, 13, 3), 3, 0, 1e-13),
    "(2(i9),(i9),3(2(e21.13e3)))": (9, lambda x: scientific(x, 21, 13, 3), 3, 0, 1e-13),
    # left-justified: the last number ends before its field
    "(3i9,6e22.13e3)": (9, lambda x: scientific(x, 0, 13, 3).ljust(22), 3, 0, 1e-13),
    # the same with a blank in place of the sign of positive numbers
    "(3i8,6e22.13)": (8, lambda x: scientific(x, 20, 13).ljust(22), 3, 0, 1e-13),
    # an exponent of three digits takes the place of its letter
    "(3i9,6e20.12)": (9, lambda x: scientific(x, 20, 12, 3, ""), 3, 0, 1e-12),
    "(1i9,3e20.9e3)": (9, lambda x: scientific(x, 20, 9, 3), 1, 0, 1e-9),
}
COMPONENTS = {
    "ranges": ["CMBLOCK,HELD,NODE,       5  ! users node component definition", "(8i10)",
               "".join(f"{k:10d}" for k in (11, -14, 18, 21, -22))],
    "range over a line": ["CMBLOCK,HELD    ,NODE,       5,,,,1", "(2i8)", "".join(f"{k:8d}" for k in (11, -14)),
                          "".join(f"{k:8d}" for k in (18, 21)), f"{-22:8d}"],
    "single nodes": ["CMBLOCK,HELD,NODE,7", "(8i10)", "".join(f"{k:10d}" for k in HELD)],
    "beside elements": ["CMBLOCK,SKIN,ELEM,2", "(8i10)", f"{1:10d}{-2:10d}", "CMBLOCK,NONE,NODE,0",
                        "CMBLOCK,EMPTY,NODE,0", "(8i10)", "CMBLOCK,HELD,NODE,7", "(8i10)",
                        "".join(f"{k:10d}" for k in HELD)],
}  # fmt: skip
TYPES = {
    "ET": ["ET,        1,185"],
    "named": ["ET,1,SOLID185", "KEYOPT,1,2,3"],
    "ETBLOCK": ["ETBLOCK,        2,        2", "(2i9,19a9)", "        7      154" + 19 * "        0",
                "        1      185" + 19 * "        0", "       -1"],
    "none": [],
}  # fmt: skip


def archive(path, types="ET", nodes="(3i9,6e21.13e3)", elements=9, components="ranges"):
    whole, real, n_whole, gap, _ = NODE_FORMS[nodes]
    lines = [
        "/PREP7",
        *TYPES[types],
        *node_lines(nodes, whole, real, n_whole, gap),
        *element_lines(elements),
        *COMPONENTS[components],
        "FINISH",
    ]
    path.write_text("\n".join(lines) + "\n")
    return path


def check(body, accuracy=1e-13):
    assert body.numbers.tolist() == list(NODES)
    np.testing.assert_allclose(body.nodes, list(NODES.values()), rtol=accuracy, atol=0.0)
    assert body.node_axes == {}
    assert [elements.tolist() for elements in body.elements] == [BRICKS]
    assert body.node_sets["HELD"].tolist() == HELD


@each("form", NODE_FORMS)
def test_columns_of_nodes(form, tmp_path):
    check(read_cdb(archive(tmp_path / "a.cdb", nodes=form)), NODE_FORMS[form][-1])


@each("width", [7, 8, 9, 10, 12])
def test_columns_of_elements(width, tmp_path):
    check(read_cdb(archive(tmp_path / "a.cdb", elements=width)))


@each("types", TYPES)
def test_element_types(types, tmp_path):
    check(read_cdb(archive(tmp_path / "a.cdb", types=types)))


@each("components", COMPONENTS)
def test_components(components, tmp_path):
    check(read_cdb(archive(tmp_path / "a.cdb", components=components)))


def numbered(lines, which):
    """Lines with the number of their card in columns 73 to 80, where it is the last in the line."""
    return [
        f"{line:72s}{k:8d}" if len(line) <= 71 and re.match(which, line) else line
        for k, line in enumerate(lines, 1)
    ]


@each("which", ["[A-Z/]", r"CMBLOCK|\(|[A-Z/]", " +(11|21) +-?"])
def test_card_numbers(which, tmp_path):
    """They are left out behind commands, formats and the last nodes of a component."""
    path = archive(tmp_path / "a.cdb")
    lines = path.read_text().splitlines()
    body = next(k for k, line in enumerate(lines) if line.startswith("CMBLOCK"))
    changed = numbered(lines[:body], which) if which[0] != " " else lines[:body]
    path.write_text("\n".join(changed + numbered(lines[body:], which)) + "\n")
    assert path.read_text() != "\n".join(lines) + "\n"
    check(read_cdb(path))


SURFACE = """et,3,154
keyo,3,2,1
eblock,10,,,2
(15i9)
        3        3        3        3       12       11       12       14       13       11
        4        3        3        3       12       15       16       18       17
-1
"""


@each("types", ["", "type,3\n"])
def test_surface_elements_of_workbench_are_left_out(types, tmp_path):
    """Blocks without the key SOLID, whose type is that of their section or of TYPE."""
    path = archive(tmp_path / "a.cdb")
    blocks = SURFACE.replace("eblock", f"{types}eblock")
    path.write_text(path.read_text().replace("FINISH", f"{blocks}FINISH"))
    body = read_cdb(path)
    check(body)
    assert "2 elements of type 154 are not solids and are not read" in body.notes


@each(
    ("old", "new"),
    [("et,3,154", "et,3,185"), ("et,3,154", "et,4,154"), ("et,3,154", "et,3,154\ntype,1")],
)
def test_solids_in_a_block_of_other_elements_are_refused(old, new, tmp_path):
    path = archive(tmp_path / "a.cdb")
    blocks = SURFACE.replace(old, new)
    path.write_text(path.read_text().replace("FINISH", f"{blocks}FINISH"))
    with pytest.raises(ModelError, match="EBLOCK with the key SOLID, or of a known type of other"):
        read_cdb(path)


def test_card_numbers_behind_left_justified_numbers_are_refused(tmp_path):
    """In (3i8,6e16.9) the columns 73 to 80 begin the first angle of the axes of a node."""
    lines = [f"NBLOCK,6,SOLID,1,{len(NODES)}", "(3i8,6e16.9)"]
    for number, position in NODES.items():
        lines.append(
            f"{number:8d}{0:8d}{0:8d}" + "".join(f"{x:.7f}".ljust(16) for x in position) + f"{9:8d}"
        )
    (tmp_path / "a.cdb").write_text("\n".join([*lines, "N,R5.3,LOC,       -1,", ""]))
    with pytest.raises(ModelError, match="line 3: expected a number that ends in column 88"):
        read_cdb(tmp_path / "a.cdb")
    # a long one, with blanks in place of the signs of the coordinates
    text = (tmp_path / "a.cdb").read_text().replace("       9\n", " 1234567\n")
    text = re.sub(r"(\d\.\d+) ", r" \1", text)
    (tmp_path / "a.cdb").write_text(text)
    with pytest.raises(ModelError, match="line 3: expected a number that ends in column 88"):
        read_cdb(tmp_path / "a.cdb")


def test_zeros_and_a_blank_for_the_sign(tmp_path):
    """Short numbers at the left of their field, as an archive of an older release has them."""
    lines = [
        "NBLOCK,6,SOLID",
        "(3i8,6e16.9)",
        "       1       0       0 0.             -1.5             2.    ",
        "       2       0       0 0.25            0.              0.5   ",
        "N,R5.3,LOC,       -1,",
    ]
    (tmp_path / "a.cdb").write_text("\n".join([*lines, ""]))
    body = read_cdb(tmp_path / "a.cdb")
    assert body.nodes.tolist() == [[0.0, -1.5, 2.0], [0.25, 0.0, 0.5]]


def test_card_numbers_that_look_like_angles_are_refused(tmp_path):
    """In (3i8,6e16.9) the columns 73 to 80 begin the first angle of the axes of a node."""
    path = archive(tmp_path / "a.cdb", nodes="(3i8,6e16.9)")
    lines = path.read_text().splitlines()
    at = next(k for k, line in enumerate(lines) if line.startswith("      13"))
    lines[at] = f"{lines[at]:72s}{9:8d}"
    path.write_text("\n".join(lines) + "\n")
    expected = rf"a.cdb: line {at + 1}: expected a number that ends in column 88, or a line without card numbers, found '9'"
    with pytest.raises(ModelError, match=expected):
        read_cdb(path)


@each(
    ("old", "new", "line", "message"),
    [
        ("EBLOCK,19,SOLID,2,2", "EBLOCK,19,,,2", 19, "expected EBLOCK with the key SOLID, or of a known type of other"),
        ("       18\n", "       18       99\n", 20, "expected 8 nodes of an element, found 9 numbers"),
        ("(3i9,6e21.13e3)", "(3i9,6z21.13)", 4, r"a format like \(3i9,6e21.13e3\), found '\(3i9,6z21.13\)'"),
        ("(19i9)", "(19i)", 19, "a format like"),
        ("CMBLOCK,HELD,NODE,       5  !", "CMBLOCK,HELD,NODE,       9  !", 26,
         "expected whole numbers in the columns .*, found 'FINISH'"),
        ("        18        21       -22", "        18       -21       -17", 23,
         "expected ranges in component 'HELD', found -17"),
    ],
)  # fmt: skip
def test_other_forms_are_refused_with_their_line(old, new, line, message, tmp_path):
    path = archive(tmp_path / "a.cdb")
    text = path.read_text()
    if old == "       18\n":
        old, new = "       18       17\n", "       18       17       99\n"
        text = text.replace("(19i9)", "(20i9)")
    assert old in text
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(ModelError, match=message) as caught:
        read_cdb(path)
    assert re.search(rf"a\.cdb: line {line}\b", str(caught.value)), str(caught.value)


def test_an_archive_without_the_end_of_its_elements_is_refused(tmp_path):
    path = archive(tmp_path / "a.cdb")
    text = path.read_text()
    path.write_text(text[: text.index("       -1\nCMBLOCK")])
    with pytest.raises(ModelError, match=r"expected the end of EBLOCK \(-1\)"):
        read_cdb(path)
