"""Constant, bending and shear fields through every element type of every reader, beside closed forms."""

from types import SimpleNamespace

import numpy as np
import pytest
import scipy.sparse as sp

pytest.importorskip("skfem", reason="scikit-fem is not installed (extra bdamper[fe])")

from bdamper.fem.element_stress import Solids, element_rows, node_average
from bdamper.fem.sector_faces import no_faces
from bdamper.importers import (
    Sector,
    read_arrays,
    read_bdf,
    read_calculix,
    read_cdb,
    read_elements,
    read_frd,
    read_inp,
    read_rst,
)
from bdamper.importers.fe_body import FEBody
from bdamper.importers.prepared_body import CyclicStructure, Placement, PreparedBody
from bdamper.importers.stress_sets import stress_rows
from tests.ansys_files import write_rst
from tests.each import each
from tests.own_sector import deck, of_kind

YOUNG, POISSON = 2e5, 0.3
SHEAR = YOUNG / (2.0 * (1.0 + POISSON))
LAME = YOUNG * POISSON / ((1.0 + POISSON) * (1.0 - 2.0 * POISSON))
FIRST = 11
"""Number of the first node."""
SIZE = (1.0, 0.8, 1.5)
ALONG = {4: 4, 6: 6, 8: 8, 10: 4, 15: 6, 20: 8}
"""Corners by the number of nodes."""
UPRIGHT_FIRST = {4: range(4), 6: range(6), 8: range(8), 10: range(10), 15: [*range(9), 12, 13, 14, 9, 10, 11],
                 20: [*range(12), 16, 17, 18, 19, 12, 13, 14, 15]}  # fmt: skip
"""Nodes between the two triangles or quadrilaterals before those of the upper one: Nastran, results of CalculiX."""


def box(n):
    """A box of two elements each way, and elements of n nodes (all wedges along z)."""
    axes = [np.linspace(0.0, length, 3) for length in SIZE]
    x = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    number = np.arange(27).reshape(3, 3, 3)
    ends = [(a, b, c) for c in (0, 1) for a, b in ((0, 0), (1, 0), (1, 1), (0, 1))]
    corners = [number[a : a + 2, b : b + 2, c : c + 2].ravel() for a, b, c in ends]
    return of_kind(f"C3D{n}", x.reshape(-1, 3), np.stack(corners, axis=1))


# ---- files ----


def from_inp(kind, nodes, elements, folder):
    (folder / "a.inp").write_text(deck(kind, nodes, elements, YOUNG, POISSON, 1.0))
    return read_inp(folder / "a.inp"), 1


def from_run(kind, nodes, elements, folder):
    (folder / "a.inp").write_text(
        deck(kind.replace("C3D6R", "C3D6"), nodes, elements, YOUNG, POISSON, 1.0)
    )
    (folder / "a.dof").write_text(
        "".join(f"{k + 1}.{i}\n" for k in range(len(nodes)) for i in (1, 2, 3))
    )
    for end in ("sti", "mas"):
        (folder / f"a.{end}").write_text(
            "".join(f"{k} {k} 1.\n" for k in range(1, 3 * len(nodes) + 1))
        )
    return read_calculix(folder / "a"), 1


def from_frd(kind, nodes, elements, folder):
    code = {8: 1, 6: 2, 4: 3, 20: 4, 15: 5, 10: 6}[elements.shape[1]]
    lines = ["    2C" + " " * 60 + "1"]
    lines += [f" -1{FIRST + k:10d}" + "".join(f"{v:12.5E}" for v in x) for k, x in enumerate(nodes)]
    lines += [" -3", "    3C" + " " * 60 + "1"]
    for k, e in enumerate((FIRST + elements[:, UPRIGHT_FIRST[elements.shape[1]]]).tolist(), 1):
        lines.append(f" -1{k:10d}{code:5d}    0    1")
        lines += [" -2" + "".join(f"{n:10d}" for n in e[i : i + 10]) for i in range(0, len(e), 10)]
    (folder / "a.frd").write_text("\n".join([*lines, " -3", " 9999", ""]))
    return read_frd(folder / "a.frd"), FIRST


def from_cdb(kind, nodes, elements, folder, number="185"):
    lines = [
        "/PREP7",
        f"ET,1,{number}",
        f"NBLOCK,6,SOLID,{len(nodes)},{len(nodes)}",
        "(3i9,6e21.13e3)",
    ]
    lines += [
        f"{FIRST + k:9d}{0:9d}{0:9d}" + "".join(f"{v:21.13E}" for v in x)
        for k, x in enumerate(nodes)
    ]
    lines += ["N,R5.3,LOC,       -1,", f"EBLOCK,19,SOLID,{len(elements)},{len(elements)}", "(19i9)"]
    for k, e in enumerate((FIRST + elements).tolist(), 1):
        words = [1, 1, 1, 1, 0, 0, 0, 0, len(e), 0, k, *e]
        lines += ["".join(f"{v:9d}" for v in words[i : i + 19]) for i in range(0, len(words), 19)]
    lines += [
        f"{-1:9d}",
        f"MPDATA,R5.0, 1,EX  ,1, 1, {YOUNG}",
        f"MPDATA,R5.0, 1,PRXY,1, 1, {POISSON}",
        "FINISH",
    ]
    (folder / "a.cdb").write_text("\n".join([*lines, ""]))
    return read_cdb(folder / "a.cdb"), FIRST


def from_rst(kind, nodes, elements, folder):
    modes = [(0, 1.0, np.ones((len(nodes), 3)))]
    write_rst(folder / "a.rst", FIRST + np.arange(len(nodes)), nodes, FIRST + elements, modes, 1)
    return read_rst(folder / "a.rst"), FIRST


def from_bdf(kind, nodes, elements, folder):
    n = elements.shape[1]
    name = {4: "CTETRA", 6: "CPENTA", 8: "CHEXA"}[ALONG[n]]
    lines = [
        "BEGIN BULK",
        *(f"GRID,{FIRST + k},,{x},{y},{z}" for k, (x, y, z) in enumerate(nodes.round(9).tolist())),
    ]
    for k, e in enumerate((FIRST + elements[:, UPRIGHT_FIRST[n]]).tolist(), 1):
        words = [str(word) for word in (k, 1, *e)]
        parts = [",".join(words[i : i + 8]) for i in range(0, len(words), 8)]
        lines += [f"{name},{parts[0]}", *(f",{part}" for part in parts[1:])]
    lines += ["PSOLID,1,1", f"MAT1,1,{YOUNG},,{POISSON},1.", "ENDDATA", ""]
    (folder / "a.bdf").write_text("\n".join(lines))
    return read_bdf(folder / "a.bdf"), FIRST


def from_csv(kind, nodes, elements, folder):
    (folder / "e.csv").write_text(
        "".join(",".join(map(str, e)) + "\n" for e in (FIRST + elements).tolist())
    )
    (folder / "x.csv").write_text(
        "".join(f"{FIRST + k},{x},{y},{z}\n" for k, (x, y, z) in enumerate(nodes.tolist()))
    )
    one = sp.identity(3 * len(nodes))
    assert len(read_elements(folder / "e.csv")) == 1
    return read_arrays(one, one, folder / "x.csv", elements=folder / "e.csv"), FIRST


ALL = ("C3D4", "C3D6", "C3D8", "C3D10", "C3D15", "C3D20")
CASES = [
    *((from_inp, kind, {}) for kind in (*ALL, "C3D8R", "C3D8I", "C3D20R")),
    *((from_run, kind, {}) for kind in ("C3D4", "C3D6R", "C3D8", "C3D15")),
    *((reader, kind, {}) for reader in (from_frd, from_bdf, from_csv) for kind in ALL),
    *((from_rst, kind, {}) for kind in ("C3D8", "C3D10", "C3D20")),
    *((from_cdb, "C3D8", {"number": number}) for number in ("45", "185")),
    *((from_cdb, "C3D10", {"number": number}) for number in ("92", "187")),
    *((from_cdb, kind, {"number": number}) for kind, number in (("C3D4", "285"), ("C3D20", "95"), ("C3D20R", "186"))),
]  # fmt: skip


# ---- fields and their stress ----


def affine(x):
    """Displacement (n, 3) and stress (n, 6) of a uniform strain."""
    gradient = np.array([[1.0, 0.2, 0.3], [-0.1, 2.0, 0.4], [0.5, 0.6, -1.0]]) * 1e-3
    return x @ gradient.T, np.tile(hooke(gradient), (len(x), 1))


def bending(x):
    """Bending of a beam along z: all stress is along its axis."""
    x, y, z = x.T
    moved = [-0.5 * z**2 - 0.5 * POISSON * (x**2 - y**2), -POISSON * x * y, x * z]
    return np.column_stack(moved), YOUNG * np.column_stack([0 * x, 0 * x, x, 0 * x, 0 * x, 0 * x])


def bending_held(x):
    """The same without strain across, which elements of first order can follow."""
    x, _, z = x.T
    normal = [LAME * x, LAME * x, (LAME + 2.0 * SHEAR) * x]
    return np.column_stack([-0.5 * z**2, 0 * x, x * z]), np.column_stack(
        [*normal, 0 * x, 0 * x, 0 * x]
    )


def twist(x):
    """Cross-sections that turn about the axis: shear alone."""
    x, y, z = x.T
    return np.column_stack([-y * z, x * z, 0 * x]), SHEAR * np.column_stack(
        [0 * x, 0 * x, 0 * x, 0 * x, x, -y]
    )


def hooke(gradient):
    strain = 0.5 * (gradient + gradient.T)
    stress = LAME * np.trace(strain) * np.eye(3) + 2.0 * SHEAR * strain
    return stress[[0, 1, 2, 0, 1, 0], [0, 1, 2, 1, 2, 2]]


def by_linear_fits(nodes, elements, moved):
    """Stress of elements that carry one strain: of the linear field nearest to their displacements, meant over elements."""
    total, count = np.zeros((len(nodes), 6)), np.zeros((len(nodes), 1))
    for e in elements:
        total[e] += hooke(
            np.linalg.lstsq(np.column_stack([np.ones(len(e)), nodes[e]]), moved[e], rcond=None)[0][
                1:
            ].T
        )
        count[e] += 1.0
    return total / count


def stress_of(body: FEBody, moved, first):
    """Stress (n, 6) at all nodes by the rows that an import makes."""
    one = sp.identity(moved.size)
    given = FEBody(**{**body.__dict__, "stiffness": one, "mass": one, "dofs": None})
    prepared = PreparedBody("blade", given, Placement())
    laid = SimpleNamespace(
        interfaces={}, ports={"blade": ()}, rows={"blade": sp.csr_matrix((0, moved.size))}
    )
    elasticity = (
        None if body.element_kinds and body.element_kinds[0].youngs_modulus else (YOUNG, POISSON)
    )
    nodes, ring = {"all": first + np.arange(len(moved))}, CyclicStructure(no_faces(), (), ())
    (rows,) = stress_rows(prepared, Sector(stress=nodes, elasticity=elasticity), laid, ring)
    return (rows._rows @ moved.ravel()).reshape(-1, 6)


NAMES = [f"{reader.__name__}-{kind}{''.join(options.values())}" for reader, kind, options in CASES]


@pytest.mark.slow
@each(("reader", "kind", "options"), CASES, ids=NAMES)
def test_fields_of_every_element_type_of_every_reader(reader, kind, options, tmp_path):
    """Exact where the element can follow the field; where it has one strain across, that of a linear fit."""
    n = int(kind.removeprefix("C3D").rstrip("RI"))
    nodes, elements = box(n)
    body, first = reader(kind, nodes, elements, tmp_path, **options)
    inner = np.isclose(
        nodes[:, 2], 0.5 * SIZE[2]
    )  # here the parasitic shear of elements of first order cancels
    for field in (affine, bending if n > 8 or kind == "C3D8I" else bending_held, twist):
        moved, expected = field(nodes)
        if kind in ("C3D4", "C3D6R", "C3D8R"):
            expected = by_linear_fits(nodes, elements, moved)
        found = stress_of(body, moved, first)
        if field is bending_held and kind != "C3D4":
            found[~inner, 5] = expected[~inner, 5] = 0.0
        np.testing.assert_allclose(
            found, expected, rtol=0.0, atol=1e-9 * np.abs(expected).max(), err_msg=field.__name__
        )


def collapsed(elements):
    """Wedges (n, 6 | 15) and tetrahedra (n, 4 | 10) as Ansys writes them, as hexahedra with repeated nodes."""
    if elements.shape[1] in (4, 10):
        a, b, c, d, *between = elements.T
        corners, names = [a, b, c, c, d, d, d, d], []
        if between:
            ab, bc, ca, ad, bd, cd = between
            names = [ab, bc, c, ca, d, d, d, d, ad, bd, cd, cd]
    else:
        a, b, c, d, e, f, *between = elements.T
        corners, names = [a, b, c, c, d, e, f, f], []
        if between:
            ab, bc, ca, de, ef, fd, ad, be, cf = between
            names = [ab, bc, c, ca, de, ef, f, fd, ad, be, cf, cf]
    return np.column_stack([*corners, *names])


@pytest.mark.parametrize("n", [4, 6, 10, 15])
def test_fields_of_collapsed_hexahedra_are_those_of_wedges_and_tetrahedra(n, tmp_path):
    nodes, elements = box(n)
    read = [(from_cdb, {"number": "185" if n < 8 else "186"})] + [(from_rst, {})] * (n > 8)
    for reader, options in read:
        body, first = reader("", nodes, collapsed(elements), tmp_path, **options)
        assert [e.shape for e in body.elements] == [elements.shape]
        for field in (affine, bending if n > 8 else bending_held, twist):
            moved, expected = field(nodes)
            if n == 4:
                expected = by_linear_fits(nodes, elements, moved)
            found = stress_of(body, moved, first)
            if n == 6:
                expected[:, 5] = found[:, 5] if field is bending_held else expected[:, 5]
            np.testing.assert_allclose(
                found, expected, rtol=0.0, atol=1e-9 * np.abs(expected).max()
            )


def test_a_repeated_node_counts_once_in_the_average():
    """A cube at rest and a wedge that is stretched, on one edge of which both corners are one node."""
    nodes = np.array(
        [[x, y, z] for z in (0.0, 1.0) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1), (2, 0.5))]
    )
    cube, wedge = [0, 1, 2, 3, 5, 6, 7, 8], [1, 4, 2, 2, 6, 9, 7, 7]
    moved = np.column_stack([np.maximum(nodes[:, 0] - 1.0, 0.0), np.zeros((10, 2))])
    rows, owner = element_rows(
        [Solids("C3D8", np.array([cube, wedge]), YOUNG, POISSON)], nodes, np.arange(10)
    )
    assert len(owner) == 8 + 6
    found = (node_average(owner, 10) @ (rows @ moved.ravel())).reshape(-1, 6)[:, 0]
    stretched = LAME + 2.0 * SHEAR
    share = {0.0: 0.0, 1.0: 0.5, 2.0: 1.0}
    np.testing.assert_allclose(
        found, [stretched * share[x] for x in nodes[:, 0]], atol=1e-9 * stretched
    )
