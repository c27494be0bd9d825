"""Decks as Abaqus/CAE writes them: each deck, flat and as parts and instances, builds to the same frequencies.

The matrices are those of CalculiX, written as ``*MATRIX OUTPUT`` would write them.
"""

import shutil
from dataclasses import dataclass, replace

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.spatial.transform import Rotation

pytest.importorskip("skfem", reason="scikit-fem is not installed (extra bdamper[fe])")

from bdamper.importers import read_abaqus, read_arrays, read_calculix, read_inp
from bdamper.util.errors import ModelError
from examples.calculix.decks import run_job
from tests.each import each
from tests.imports import build
from tests.own_sector import OwnSector
from tests.own_sector import _surface as surface_lines

needs_ccx = pytest.mark.skipif(
    shutil.which("ccx") is None, reason="CalculiX (ccx) is not installed"
)
OWN = OwnSector("C3D8")
SURFACES = {"RIGHT_UNDERSIDE": "UNDER_A", "LEFT_UNDERSIDE": "UNDER_B", "LEFT": "A", "RIGHT": "B"}
NAMES = {"sector": "DISK-1", "damper": "STRIP-1"}
SHIFT = {"sector": np.array([3.0, -20.0, 11.0]), "damper": np.array([0.0, 7.0, 0.5])}
AXIS = {
    "sector": ([1.0, 2.0, 3.0], [0.0, 0.0, 1.0], 50.0),
    "damper": ([0.0, 0.0, 5.0], [1.0, 0.0, 0.0], -25.0),
}


def rotation(axis, degrees):
    return Rotation.from_rotvec(np.radians(degrees) * np.array(axis)).as_matrix()


@dataclass
class Case:
    """How a deck writes its nodes, elements and sets."""

    head: str = "*NODE"
    numbers: object = staticmethod(lambda x: x)
    before: tuple = ()
    generate: bool = False
    by_elements: bool = False
    surfaces: bool = False
    moved: bool = False
    assembly_sets: bool = False
    independent: bool = False
    labels: bool = False
    element_head: str = "*ELEMENT, TYPE=C3D8, ELSET=BODY"
    swapped: bool = False
    constraint: tuple = ()


def cylindrical(x):
    return np.column_stack(
        [np.hypot(x[:, 0], x[:, 1]), np.degrees(np.arctan2(x[:, 1], x[:, 0])), x[:, 2]]
    )


FRAME = rotation([0.6, 0.0, 0.8], 70.0)
CASES = {
    "plain": Case(),
    "generated sets": Case(generate=True),
    "sets of the assembly": Case(assembly_sets=True),
    "moved instances": Case(moved=True),
    "moved instances with sets of the assembly": Case(moved=True, assembly_sets=True, generate=True),
    "*SYSTEM": Case(
        before=("*SYSTEM", ", ".join(map(repr, [1.0, 2.0, 3.0, *(3.0 * FRAME[0] + [1.0, 2.0, 3.0]).tolist()])),
                ", ".join(map(repr, (FRAME[1] + 0.4 * FRAME[0] + [1.0, 2.0, 3.0]).tolist()))),
        numbers=lambda x: (x - [1.0, 2.0, 3.0]) @ FRAME.T,
    ),
    "*SYSTEM of two points": Case(
        before=("*SYSTEM", "1., 2., 3., 4., 6., 9."),
        numbers=lambda x: (x - [1.0, 2.0, 3.0]) @ np.array([[0.6, 0.8, 0.0], [-0.8, 0.6, 0.0], [0.0, 0.0, 1.0]]).T,
    ),
    "*NODE, SYSTEM=C": Case(head="*NODE, SYSTEM=C", numbers=cylindrical),
    "continued lines": Case(head="*node,\n nset=ALL", element_head="*Element, type=C3D8,\n** more\n elset=BODY"),
    "*NSET, ELSET=": Case(by_elements=True),
    "surfaces": Case(surfaces=True),
    "meshes of instances": Case(independent=True, moved=True),
    "labels in the matrices": Case(labels=True, moved=True),
    "another order": Case(swapped=True),
}  # fmt: skip


SLOW = (
    "plain",
    "moved instances",
    "sets of the assembly",
    "*SYSTEM of two points",
    "meshes of instances",
    "another order",
)
"""Parts that others contain, too; flat decks of all cases are slow."""


def numbered(numbers):
    return [", ".join(map(str, numbers[k : k + 16])) for k in range(0, len(numbers), 16)]


def elements_of(name, own=OWN):
    return own.mesh(own.fe.blade if name == "sector" else own.fe.damper.body, {})[1] + 1


def set_lines(name, members, case, extra=""):
    if case.generate:
        runs = np.split(members, np.flatnonzero(np.diff(members) != 1) + 1)
        return [
            f"*NSET, NSET={name}, GENERATE{extra}",
            *(f"{run[0]}, {run[-1]}, 1" for run in runs),
        ]
    return [f"*Nset, nset={name}{extra}", *numbered(members.tolist())]


def body_lines(name, case, parts, own=OWN):
    """Mesh of a body and its sets, in the axes of the part; ``*MATERIAL`` is elsewhere in a deck of parts."""
    _, sets, nodes = own.text(name)
    if case.moved and parts:
        point, axis, degrees = AXIS[name]
        nodes = (nodes - point) @ rotation(axis, degrees) + point - SHIFT[name]
    elements = elements_of(name, own)
    lines = [*case.before, case.head]
    lines += [
        f"{k}, {x!r}, {y!r}, {z!r}" for k, (x, y, z) in enumerate(case.numbers(nodes).tolist(), 1)
    ]
    lines.append(case.element_head.replace("C3D8", own.kind))
    lines += [", ".join(map(str, [k, *row])) for k, row in enumerate(elements.tolist(), 1)]
    sets = {key: members + 1 for key, members in sets.items()}
    if case.by_elements:
        lines += ["*NSET, NSET=EVERY, ELSET=BODY"]
    if case.surfaces:
        for key, surface in SURFACES.items():
            if key in sets:
                lines += [
                    f"*SURFACE, NAME={surface}, TYPE=ELEMENT",
                    *surface_lines(elements - 1, sets[key] - 1),
                ]
    if not (parts and case.assembly_sets):
        for key, members in sets.items():
            lines += set_lines(key, members, case)
    return lines, sets


def material():
    return ["*MATERIAL, NAME=STEEL", "*ELASTIC", "2.1e5, 0.3", "*DENSITY", "7.85e-9"]


STEP = [
    "*STEP",
    "*MATRIX GENERATE, STIFFNESS, MASS",
    "*MATRIX OUTPUT, STIFFNESS, MASS, FORMAT=LABELS",
    "*END STEP",
    "",
]


def write_flat(folder, case, own=OWN):
    for name in ("sector", "damper"):
        lines = [*body_lines(name, case, False, own)[0], *case.constraint, *material()]
        lines += ["*SOLID SECTION, ELSET=BODY, MATERIAL=STEEL", *STEP]
        (folder / f"{name}.inp").write_text("\n".join(lines))


def write(folder, case, parts, matrices, own=OWN):
    """Deck and matrices: two flat jobs, or one job of two instances."""
    names = ("damper", "sector") if case.swapped else ("sector", "damper")
    if not parts:
        write_flat(folder, case, own)
        for name in names:
            for kind, matrix in zip(("STIF", "MASS"), matrices[name]):
                write_matrix(folder / f"{name}_{kind}1.mtx", [(name, matrix)], case, parts)
        return read_abaqus(folder / "sector"), read_abaqus(folder / "damper.inp")
    lines, later, placed = ["*HEADING"], [], ["*ASSEMBLY, NAME=ASSEMBLY"]
    for name in names:
        mesh, sets = body_lines(name, case, parts, own)
        mesh += ["*SOLID SECTION, ELSET=BODY, MATERIAL=STEEL"]
        lines += [f"*PART, NAME={name}", *([] if case.independent else mesh), "*END PART"]
        placed.append(f"*Instance, name={NAMES[name]}, part={name}")
        if case.moved:
            point, axis, degrees = AXIS[name]
            placed.append(", ".join(map(repr, SHIFT[name].tolist())))
            placed.append(
                ", ".join(
                    map(repr, [*point, *(np.array(point) + 2.0 * np.array(axis)).tolist(), degrees])
                )
            )
        placed += [*(mesh if case.independent else []), "*End Instance"]
        if case.assembly_sets:
            for key, members in sets.items():
                later += set_lines(key, members, case, f", instance={NAMES[name]}")
    lines += [*placed, *later, *case.constraint, "*END ASSEMBLY", *material(), *STEP]
    (folder / "stage.inp").write_text("\n".join(lines))
    for at, kind in enumerate(("STIF", "MASS")):
        write_matrix(
            folder / f"stage_{kind}1.mtx",
            [(name, matrices[name][at]) for name in names],
            case,
            parts,
        )
    return tuple(read_abaqus(folder / "stage", NAMES[name]) for name in ("sector", "damper"))


def write_matrix(path, bodies, case, parts):
    lines, first = [], 0
    for name, matrix in bodies:
        upper = sp.triu(matrix).tocoo()
        prefix = f"{NAMES[name]}." if parts and case.labels else ""
        shift = 0 if prefix else first
        for i, j, value in zip(upper.row.tolist(), upper.col.tolist(), upper.data.tolist()):
            a, b = i // 3 + 1 + shift, j // 3 + 1 + shift
            lines.append(f"{prefix}{a},{i % 3 + 1}, {prefix}{b},{j % 3 + 1}, {value:.17e}")
        first += matrix.shape[0] // 3
    path.write_text("\n".join(lines))


@pytest.fixture(scope="module")
def matrices(tmp_path_factory):
    return stored_matrices(tmp_path_factory.mktemp("ccx"))


def stored_matrices(folder, own=OWN):
    """Full stiffness and mass of both bodies, by CalculiX."""
    out = {}
    for name in ("sector", "damper"):
        steps = ["*STEP", "*FREQUENCY, SOLVER=MATRIXSTORAGE", "6,", "*END STEP", ""]
        run_job("\n".join([own.text(name)[0], *steps]), folder, name)
        body = read_calculix(folder / name)
        row = 3 * (body.dofs[:, 0] - 1) + body.dofs[:, 1] - 1
        order = np.argsort(row)
        assert np.array_equal(row[order], np.arange(3 * len(body.nodes)))
        out[name] = body.stiffness[order][:, order], body.mass[order][:, order]
    return out


def settings(case):
    given = OWN.settings
    if case.surfaces:
        contacts = [
            replace(c, faces_a=SURFACES[c.faces_a], faces_b=SURFACES[c.faces_b])
            for c in given["contacts"]
        ]
        given = given | {"contacts": contacts}
    return given | {
        "engine_order": 4,
        "harmonics": 1,
        "n_modes": 4,
        "n_damper_modes": 8,
        "fixed": "BORE",
    }


@pytest.fixture(scope="module")
def reference(matrices):
    return build(*from_arrays(matrices), **settings(Case()))


def from_arrays(matrices, own=OWN):
    """Both bodies from plain arrays."""
    bodies = []
    for name in ("sector", "damper"):
        _, sets, nodes = own.text(name)
        numbers = np.arange(1, len(nodes) + 1)
        given = {key: members + 1 for key, members in sets.items()}
        bodies.append(
            read_arrays(
                *matrices[name], (numbers, nodes), sets=given, elements=elements_of(name, own)
            )
        )
    return bodies


def dialects():
    for name in CASES:
        for parts in (False, True):
            slow = name in SLOW or not parts
            yield pytest.param(
                name,
                parts,
                id=f"{name}-{'parts' if parts else 'flat'}",
                marks=[pytest.mark.slow] * slow,
            )


@pytest.mark.slow
@needs_ccx
@pytest.mark.parametrize(("name", "parts"), dialects())
def test_each_dialect_gives_the_same_frequencies(name, parts, matrices, reference, tmp_path):
    blade, damper = write(tmp_path, CASES[name], parts, matrices)
    built = build(blade, damper, **settings(CASES[name]))
    for d, expected in reference.frequencies.items():
        np.testing.assert_allclose(built.frequencies[d], expected, rtol=1e-6)
    ours, theirs = (
        model.bodies["damper"].bases[0].omega2[6:] for model in (built.model, reference.model)
    )
    np.testing.assert_allclose(ours, theirs, rtol=1e-6)
    points, others = (
        [i.area.sum() for i in model.interfaces.values()]
        for model in (built.model, reference.model)
    )
    np.testing.assert_allclose(points, others, rtol=1e-6)
    if CASES[name].by_elements:
        assert len(blade.node_sets["EVERY"]) == len(blade.nodes)


# ---- Generators of nodes and elements ----

BLOCK = """*NODE, NSET=ENDS
1, 0., 0., 0.
3, 2., 0., 0.
11, 0., 1., 0.
13, 2., 1., 0.
*NGEN, NSET=LOW
1, 3, 1
*NGEN, NSET=HIGH
11, 13
*NFILL, NSET=FRONT
LOW, HIGH, 1, 10
*NODE
{back}
*ELEMENT, TYPE=C3D8, ELSET=BODY
1, 1, 2, 12, 11, 101, 102, 112, 111
*ELGEN, ELSET=BODY
1, 2, 1, 1, 1, 0, 0, 2, 100, 10
"""


def test_generated_nodes_and_elements_are_those_of_the_written_mesh(tmp_path):
    """Two by one by two cubes; the layers behind are written out."""
    front = {k: (float(k % 10 - 1), float(k // 10), 0.0) for k in (1, 2, 3, 11, 12, 13)}
    back = "\n".join(
        f"{k + 100 * z}, {x}, {y}, {z}." for z in (1, 2) for k, (x, y, _) in front.items()
    )
    (tmp_path / "a.inp").write_text(BLOCK.format(back=back))
    body = read_inp(tmp_path / "a.inp")
    found = dict(zip(body.numbers.tolist(), map(tuple, body.nodes.tolist())))
    assert found == {
        k + 100 * z: (x, y, float(z)) for z in (0, 1, 2) for k, (x, y, _) in front.items()
    }
    first = np.array([1, 2, 12, 11, 101, 102, 112, 111])
    np.testing.assert_array_equal(body.elements[0], [first, first + 100, first + 1, first + 101])
    assert set(body.node_sets["FRONT"].tolist()) == set(front)


def test_nodes_are_filled_between_two_sets(tmp_path):
    text = "*NODE, NSET=A\n1, 0., 0., 0.\n2, 1., 0., 0.\n*NODE, NSET=B\n31, 0., 3., 6.\n32, 1., 6., 0.\n"
    (tmp_path / "a.inp").write_text(text + "*NFILL\nA, B, 3, 10\n")
    body = read_inp(tmp_path / "a.inp")
    found = dict(zip(body.numbers.tolist(), body.nodes.tolist()))
    assert found[11] == pytest.approx([0.0, 1.0, 2.0]) and found[22] == pytest.approx(
        [1.0, 4.0, 0.0]
    )


# ---- Refusals ----

TWO = """*PART, NAME=P
*NODE
1, 0., 0., 0.
2, 1., 0., 0.
3, 1., 1., 0.
4, 0., 0., 1.
*ELEMENT, TYPE=C3D4, ELSET=BODY
1, 1, 2, 3, 4
*NSET, NSET=TIP
4
*END PART
*ASSEMBLY, NAME=A
*INSTANCE, NAME=I, PART=P
*END INSTANCE
*INSTANCE, NAME=J, PART=P
5., 0., 0.
*END INSTANCE
*NSET, NSET=TIPS
I.TIP, J.4
*END ASSEMBLY
"""
REFUSED = {
    "*TIE, NAME=T\nA, B": "*TIE in line 21: expected a mesh without constraints (merge the meshes",
    "*EQUATION\n2\nI.TIP, 1, 1., J.TIP, 1, -1.": "*EQUATION in line 21: expected a mesh without constraints (remove it",
    "*COUPLING, REF NODE=1, SURFACE=S, CONSTRAINT NAME=C": "*COUPLING in line 21: expected a mesh without constraints",
    "*MPC\nBEAM, 1, 2": "*MPC in line 21: expected a mesh without constraints (remove it",
    "*RIGID BODY, ELSET=I.BODY, REF NODE=1": "*RIGIDBODY in line 21: expected a mesh without constraints",
    "*SHELL TO SOLID COUPLING, CONSTRAINT NAME=C": "*SHELLTOSOLIDCOUPLING in line 21: expected a mesh without",
    "*NODE\n1, 0., 0., 0.": "*NODE in line 21: expected nodes of parts: delete the reference points",
    "*INSTANCE, NAME=K, PART=Q": "*INSTANCE in line 21: expected PART= out of ['P'], found 'Q'",
    "*INSTANCE, NAME=I, PART=P": "*INSTANCE in line 21: expected a name that no other instance has, found 'I'",
    "*INSTANCE, NAME=K, INSTANCE=OLD": "*INSTANCE in line 21: expected no parameters of *INSTANCE but NAME, PART",
    "*INSTANCE, NAME=K, PART=P\n1., 2.": "line 22: expected 3 numbers, found '1., 2.'",
    "*INSTANCE, NAME=K, PART=P\n1., 2., 3.\n0., 0., 0., 0., 0., 0., 9.": "line 23: expected two different points",
    "*NSET, NSET=N, INSTANCE=K\n1": "*NSET in line 21: expected INSTANCE= out of ['I', 'J'], found 'K'",
    "*NSET, NSET=N\nK.1": "line 22: expected a number or one of the sets",
    "*NSET, NSET=N, ELSET=I.OTHER": "*NSET in line 21: expected a number or one of the sets ['I.BODY', 'J.BODY']",
    "*SURFACE, NAME=S\nI.TOP, S1": "*SURFACE, NAME=S: expected an element or one of the sets",
    "*PART, NAME=R\n*NODE, SYSTEM=S\n1, 1., 0., 0.": "*NODE in line 22: expected SYSTEM=R or SYSTEM=C",
    "*PART, NAME=R\n*NODE\n1, 1., 0., 0.": "expected *END PART or *END INSTANCE, found the end of the file",
    "*INSTANCE, NAME=K, PART=P\n*NODE\n1073741824, 0., 0., 0.\n*END INSTANCE": "instance K: expected labels below 10737",
    "*PART, NAME=R\n*NGEN, LINE=C\n1, 2, 1": "*NGEN in line 22: expected no parameters of *NGEN but NSET, found LINE=C",
    "*PART, NAME=R\n*NGEN\n1, 2, 1": "line 23: expected *NGEN between two nodes or ascending sets",
    "*PART, NAME=R\n*ELGEN\n1, 2, 1": "line 23: expected *ELGEN of an element",
    "*PART, NAME=R\n*SYSTEM\n0., 0., 0., 1., 0., 0.\n2., 0., 0.": "line 24: expected three points that are not on one line",
}


@each("text", list(REFUSED))
def test_decks_of_parts_that_are_refused_name_keyword_and_line(text, tmp_path):
    (tmp_path / "a.inp").write_text(f"{TWO}{text}\n")
    with pytest.raises(ModelError) as caught:
        read_inp(tmp_path / "a.inp")
    assert REFUSED[text] in str(caught.value) and "\n" not in str(caught.value)


def test_an_assembly_numbers_its_nodes_in_the_order_of_its_instances(tmp_path):
    (tmp_path / "a.inp").write_text(TWO)
    body = read_inp(tmp_path / "a.inp")
    np.testing.assert_array_equal(body.numbers, np.arange(1, 9))
    np.testing.assert_array_equal(body.nodes[4:], body.nodes[:4] + [5.0, 0.0, 0.0])
    assert {name: members.tolist() for name, members in body.node_sets.items()} == {
        "I.TIP": [4], "J.TIP": [8], "TIPS": [4, 8]
    }  # fmt: skip
    assert "instance J: nodes 5 to 8" in str(body)
    second = read_inp(tmp_path / "a.inp", "j")
    np.testing.assert_array_equal(second.numbers, [1, 2, 3, 4])
    assert {name: members.tolist() for name, members in second.node_sets.items() if len(members)} == {
        "J.TIP": [4], "TIPS": [4], "TIP": [4]
    }  # fmt: skip
    with pytest.raises(ModelError, match="an instance out of"):
        read_inp(tmp_path / "a.inp", "K")


def test_surfaces_and_quoted_names_of_an_assembly(tmp_path):
    """As Abaqus/CAE writes them: sets of elements of an instance, named by a surface of the assembly."""
    text = TWO.replace("NAME=I,", 'NAME="I 1",').replace("I.TIP", '"I 1".TIP').replace(
        "*END ASSEMBLY", "*Elset, elset=_TOP_S1, internal, instance=J\n 1,\n*Surface, type=ELEMENT, name=Top\n_TOP_S1, S1\n"
        '*Surface, type=NODE, name=Ends\n"I 1".TIP, 1.\nJ.TIP, 1.\n*End Assembly'
    )  # fmt: skip
    (tmp_path / "a.inp").write_text(text)
    body = read_inp(tmp_path / "a.inp")
    assert body.node_sets["TIPS"].tolist() == body.node_sets["ENDS"].tolist() == [4, 8]
    assert sorted(body.face_sets["TOP"][0][0].tolist()) == [5, 6, 7]
    first, second = (read_inp(tmp_path / "a.inp", name) for name in ("i 1", "J"))
    assert "TOP" not in first.face_sets and sorted(second.face_sets["TOP"][0][0].tolist()) == [
        1,
        2,
        3,
    ]
    assert first.node_sets["ENDS"].tolist() == [4]


def written(folder, stiffness):
    """A job of the assembly ``TWO`` with these lines of its stiffness; the mass couples nothing."""
    (folder / "a.inp").write_text(TWO)
    (folder / "a_STIF1.mtx").write_text(stiffness)
    (folder / "a_MASS1.mtx").write_text(
        "".join(f"{n},{c}, {n},{c}, 1.0\n" for n in range(1, 9) for c in (1, 2, 3))
    )
    return folder / "a"


DIAGONAL = "".join(f"{n},{c}, {n},{c}, 9.0\n" for n in range(1, 9) for c in (1, 2, 3))
MISMATCHED = {
    DIAGONAL
    + "-1,1, -1,1, 1.0\n": "a_STIF1.mtx: expected nodes of the deck (*MATRIX GENERATE, .*PUBLIC NODES",
    DIAGONAL
    + "9,1, 9,1, 1.0\n": "a_STIF1.mtx: expected nodes of .*a.inp (a job with noPartsInputFile=ON",
    DIAGONAL.replace(
        "9.0", "1e36"
    ): "a_STIF1.mtx: expected a job without *BOUNDARY (Sector.fixed fixes nodes)",
    DIAGONAL + "1,1, 8,1, 1.0\n": "a_STIF1.mtx: expected instance I without contact or ties",
    "I.1,1, I.1,1, 9.0\nI.7,1, I.7,1, 9.0\n": "expected nodes of .*a.inp (a job",
    "I.1,1, I.1,1\n": "a_STIF1.mtx: line 1: expected five values, found 4",
}


@each("lines", list(MISMATCHED))
def test_matrices_whose_nodes_are_not_those_of_the_deck_are_refused(lines, tmp_path):
    job = written(tmp_path, lines)
    with pytest.raises(ModelError) as caught:
        read_abaqus(job, "I")
    first, _, last = MISMATCHED[lines].partition(".*")
    assert (
        first in str(caught.value) and last in str(caught.value) and "\n" not in str(caught.value)
    )


def test_nodes_that_are_numbered_in_another_order_are_refused(tmp_path):
    """Two tetrahedra with their nodes mixed: most coupled nodes belong to different ones."""
    pairs = [
        (a, b) for group in ((1, 3, 5, 7), (2, 4, 6, 8)) for a in group for b in group if a <= b
    ]
    lines = "".join(
        f"{a},{c}, {b},{c}, {9.0 if a == b else 1.0}\n" for a, b in pairs for c in (1, 2, 3)
    )
    with pytest.raises(
        ModelError,
        match=r"expected coupled nodes that share an element of the deck, .*FORMAT=LABELS",
    ):
        read_abaqus(written(tmp_path, lines))
    written(tmp_path, DIAGONAL)
    (tmp_path / "a.inp").write_text(TWO.replace("1, 1, 2, 3, 4", "1, 1, 2, 3, 9"))
    with pytest.raises(ModelError, match=r"element 1: expected nodes of its part, found node .9."):
        read_abaqus(tmp_path / "a", "I")
    (tmp_path / "a.inp").write_text(TWO)
    (tmp_path / "a_STIF2.mtx").write_text(DIAGONAL)
    with pytest.raises(
        ModelError, match=r"expected one file a_STIF\*.mtx, found a_STIF1.mtx, a_STIF2.mtx"
    ):
        read_abaqus(tmp_path / "a")
    for file in tmp_path.glob("*.mtx"):
        file.unlink()
    with pytest.raises(FileNotFoundError, match=r"a_STIF1\.mtx"):
        read_abaqus(tmp_path / "a")


def test_internal_nodes_are_refused_by_the_reader_of_arrays_too(tmp_path):
    written(tmp_path, DIAGONAL + "-1,1, -1,1, 1.0\n")
    with pytest.raises(ModelError, match=r"PUBLIC NODES, found internal nodes"):
        read_arrays(tmp_path / "a_STIF1.mtx", tmp_path / "a_MASS1.mtx", tmp_path / "a.inp")


def test_labels_that_a_part_lacks_are_no_nodes_of_another_instance(tmp_path):
    """Two instances of nodes 1, 2, 3 and 5: label 4 of a generated set is none, not the first node of the second one."""
    part = "*PART, NAME=P\n*NODE\n1, 0, 0, 0\n2, 1, 0, 0\n3, 0, 1, 0\n5, 0, 0, 1\n*ELEMENT, TYPE=C3D4\n1, 1, 2, 3, 5\n"
    part += "*NSET, NSET=G, GENERATE\n1, 5, 1\n*SURFACE, NAME=S, TYPE=NODE\nG, 1.\n*END PART\n"
    both = "*ASSEMBLY, NAME=A\n*INSTANCE, NAME=I, PART=P\n*END INSTANCE\n*INSTANCE, NAME=J, PART=P\n5, 0, 0\n"
    both += "*END INSTANCE\n"
    (tmp_path / "a.inp").write_text(part + both + "*END ASSEMBLY\n")
    body = read_inp(tmp_path / "a.inp")
    assert [list(body.node_sets[name]) for name in ("I.G", "J.G", "I.S", "J.S")] == [
        [1, 2, 3, 4],
        [5, 6, 7, 8],
    ] * 2
    (tmp_path / "a.inp").write_text(part.replace("\nG, 1.", "\nH, 1.") + both + "*END ASSEMBLY\n")
    with pytest.raises(ModelError, match="expected a node or one of the sets"):
        read_inp(tmp_path / "a.inp")
