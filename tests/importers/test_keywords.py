"""Keywords of mesh files that make, move or tie nodes, elements or sets: each is read, or refused by name with its line."""

import re
from pathlib import Path

import numpy as np
import pytest

from bdamper.importers import read_body, read_cdb, read_inp
from bdamper.util.errors import ModelError
from tests.ansys_files import write_cdb
from tests.each import each
from tests.importers.test_io_files import DECK
from tests.nastran_files import write_op4

# ---- CalculiX and Abaqus ----

TIES = """*CLEARANCE, MASTER=A
*CONNECTOR SECTION, ELSET=BODY
*CONTACT PAIR, INTERACTION=I, ADJUST=0.1
*CONTACT PAIR, INTERACTION=I, TIED
*COUPLING, REF NODE=1, SURFACE=FACE, CONSTRAINT NAME=C
*KINEMATIC
*DISTRIBUTING
*DISTRIBUTING COUPLING, ELSET=BODY
*KINEMATIC COUPLING, REF NODE=1
*EMBEDDED ELEMENT
*EQUATION
*FASTENER, INTERACTION NAME=F
*MPC
*Network Mpc
*PRE-TENSION SECTION, SURFACE=FACE, NODE=1
*RIGID BODY, ELSET=BODY, REF NODE=1
*SHELL TO SOLID COUPLING, CONSTRAINT NAME=C
*TIE, NAME=T"""
MAKES = """*PART, NAME=P
*Instance, name=I, part=P
*NCOPY, CHANGE NUMBER=100, OLD SET=ALL, SHIFT
*NMAP, NSET=ALL
*NODE, SYSTEM=S
*NGEN, LINE=C
*NFILL, BIAS=2.
*ELGEN, ALL NODES
*NODE, INPUT=more.inp
*IMPERFECTION, FILE=f, STEP=1
*ADJUST, NODE SET=ALL, SURFACE=FACE
*ELCOPY, ELEMENT SHIFT=1, OLD SET=BODY, SHIFT NODES=1
*ELEMENT, TYPE=C3D8, INPUT=more.inp
*NSET, NSET=N, ELSET=OTHER
*NSET, NSET=N, INSTANCE=I
*ELSET, ELSET=E, INSTANCE=I
*SURFACE, NAME=S, COMBINE=UNION
*SURFACE, NAME=S, TYPE=CYLINDER
*MODEL CHANGE, REMOVE
*REFINE MESH, LIMIT=10
*CONTACT INITIALIZATION DATA, NAME=C, INTERFERENCE
*CONTACT INITIALIZATION ASSIGNMENT
*CONTACT CLEARANCE, NAME=C, ADJUST=YES
*CONTACT CLEARANCE ASSIGNMENT
*ADAPTIVE MESH, ELSET=BODY
*MAP SOLUTION, STEP=1
*BOND
*DISPLAY BODY, INSTANCE=I
*ELEM, TYPE=C3D8
*EQUAT
*SYMMETRIC MODEL GENERATION, REVOLVE
*IMPORT, STEP=1
*PARAMETER
*INCLUDE, INPUT=more.inp, PASSWORD=x"""
HARMLESS = """*CYCLIC SYMMETRY MODEL, N=12
*TIE, CYCLIC SYMMETRY, NAME=T
*Boundary
*Density
*EXPANSION, ZERO=20.
*INITIAL CONDITIONS, TYPE=TEMPERATURE
*NODE FILE
*NODE PRINT, NSET=ALL
*Node Output
*STEP, NLGEOM
*STATIC
*DLOAD
*FREQUENCY, SOLVER=MATRIXSTORAGE
*MATRIX GENERATE, STIFFNESS, MASS
*END STEP"""

PASSED_OVER = """*SURFACE PROPERTY ASSIGNMENT, PROPERTY=THICKNESS
*CONTACT FORMULATION, TYPE=EDGE TO EDGE
*CONTACT STABILIZATION
*CONTACT CONTROLS ASSIGNMENT, TYPE=SCALE PENALTY
*CONTACT EXCLUSIONS
*CONTACT SMOOTHING ASSIGNMENT
*CONTACT INTERFERENCE, SHRINK
*CHANGE FRICTION, INTERACTION=FACES
*DAMAGE INITIATION, CRITERION=MAXS
*DAMAGE EVOLUTION, TYPE=ENERGY
*DAMAGE STABILIZATION
*COHESIVE BEHAVIOR
*FRACTURE CRITERION, TYPE=VCCT
*CLEARANCE BOUND
*SURFACE SMOOTHING, NAME=S
*BULK VISCOSITY
*FIXED MASS SCALING, FACTOR=2.
*CONNECTOR BEHAVIOR, NAME=C
*CONNECTOR ELASTICITY
*SUBMODEL, TYPE=NODE, INPUT=g.frd
*NODE RESPONSE
*INERTIA RELIEF
*NODAL ENERGY RATE
*LOAD CASE, NAME=L
*END LOAD CASE"""


@each("line", [*TIES.splitlines(), *MAKES.splitlines()])
def test_keywords_of_decks_that_could_change_the_mesh_are_refused(line, tmp_path):
    at = len(DECK.splitlines()) + 2
    (tmp_path / "a.inp").write_text(f"{DECK}** a comment\n{line}\n1, 2, 3\n")
    (tmp_path / "more.inp").write_text("*NODE\n9, 9., 9., 9.\n")
    with pytest.raises(ModelError) as caught:
        read_inp(tmp_path / "a.inp")
    keyword = "".join(line.split(",")[0].upper().split())
    assert f"a.inp: {keyword} in line {at}: expected " in str(caught.value)
    assert "\n" not in str(caught.value)


def test_harmless_keywords_of_decks_leave_the_mesh_as_it_is(tmp_path):
    (tmp_path / "plain.inp").write_text(DECK)
    (tmp_path / "more.inp").write_text(
        DECK + "".join(f"{line}\n1, 2, 3\n" for line in HARMLESS.splitlines())
    )
    plain, more = (read_inp(tmp_path / f"{name}.inp") for name in ("plain", "more"))
    np.testing.assert_array_equal(more.nodes, plain.nodes)
    assert str(more).replace("more.inp", "plain.inp") == str(plain)
    (tmp_path / "spring.inp").write_text(DECK + "*SPRING, ELSET=SHELL\n1\n1.\n")
    note = "*SPRING of the deck is not read: its stiffness or mass must be in the matrices"
    assert note in str(read_inp(tmp_path / "spring.inp"))


@each("line", PASSED_OVER.splitlines())
def test_other_keywords_of_decks_are_passed_over_by_name(line, tmp_path):
    (tmp_path / "a.inp").write_text(f"{DECK}{line}\n1, 2, 3\n{line}\n")
    (tmp_path / "plain.inp").write_text(DECK)
    body, plain = read_inp(tmp_path / "a.inp"), read_inp(tmp_path / "plain.inp")
    np.testing.assert_array_equal(body.nodes, plain.nodes)
    keyword = "".join(line.split(",")[0].upper().split())
    assert body.notes == (*plain.notes, f"keywords of the deck that are not read: {keyword}")


# ---- Ansys ----

CDB_REFUSED = """CE,R5.0,DEFI,       2,       1,  0.00000000
CP,R5.0,DEFI, 1, UX, 2
CERIG,1,2,UXYZ
CPINTF,ALL
CECYC,LOW,HIGH,9,1
CEINTF
N,R5.3,LOC,      77,  1.0, 2.0
EN,R5.5,ATTR, 3, 4
E,1,2,3,4
NGEN,2,100,1,8,1,0.25
ngen,2,100,1,8,1,0.25
NSYM,X,100,ALL
NROTAT,ALL
NMODIF,1,0.5
NUMMRG,NODE
TRANSFER,1,1,ALL
EGEN,2,100,ALL
EMODIF,1,1,2
ESYM,,100,ALL
CM,TOP,NODE
CMBLOCK,TOP
SE,part
MSHCOPY,VOLU
CDREAD,DB,more,cdb
/INPUT,more,cdb
*USE,macro
RESUME,stage,db
CERI,1,2,UXYZ
NUMM,NODE
FILL,1,8
VMESH,ALL
RBE3,1,ALL,2
N,UNBL,LOC,  77,-1
N,77,1,2,-1
N,R5.3,LOC,  77,  1.0, -1
ET,KIND,185
NUMOFF,NODE,100"""
CDB_ON_ONE_LINE = {
    "X=1 $ NGEN,2,100,1,8,1,0.25": "NGEN,2,100",
    "*SET,X,1 $ CP,1,UX,1,2": "CP,1,UX,1,2",
    "*SET,NAME,'a long name of a directory! with $ in it' $ EGEN,2,100,ALL": "EGEN,2,100,ALL",
}
CDB_TEXTS = """/COM,ANSYS RELEASE 19.2 $ of NGEN
/TITLE, CP and $ NGEN
C*** NGEN,2,100
! NGEN,2,100
_CDRDOFF=             !reset flag
CE=3
X(2)=1
N,R5.3,LOC,       -1,
N,UNBL,LOC,-1,
EN,R5.5,ATTR,      -1"""
CDB_NOTED = """TYPE,        3
MAT,1 $ REAL,1
*IF,_CDRDOFF,EQ,1,THEN     !if solid model was read in
*ELSE $ *ENDIF
DOF,DELETE
KEYOPT,1,2,3
DMPOPT,ESAV,NO
NLDIAG,NRRE,0
SECCONTROL, 0.00000000    , 0.00000000
*DIM,_WB_SOLVERFILES_DIR,STRING,  248,    1,    1,
*SET,NAME,'NGEN $ EGEN'
RLBLOCK,1,1,6,7
(2i8,6g16.9)
       1       6  1.0
DBLOCK,UX,        1
(2i9,3x,a4,e21.13e3)
        1        0   ALL 0.0000000000000E+000
       -1
LOCAL,R5.0,LOC,  11, 0, 0.25, 0., 0.
D,      1,UX  ,  0.00000000    ,  0.00000000
MPDATA,R5.0, 1,DENS,       1, 1,  7850.00000    ,
SETTING2031,ON"""


@pytest.fixture
def archive(tmp_path):
    numbers, corners = np.arange(1, 9), ((0, 0), (1, 0), (1, 1), (0, 1))
    nodes = np.array([[x, y, z] for z in (0, 2) for x, y in corners], float)
    write_cdb(tmp_path / "plain.cdb", numbers, nodes, [numbers], {"TOP": numbers[4:]})
    return tmp_path


@each("line", CDB_REFUSED.splitlines())
def test_commands_of_archives_that_could_change_the_mesh_are_refused(line, archive):
    lines = (archive / "plain.cdb").read_text().splitlines()
    (archive / "a.cdb").write_text("\n".join([*lines, line, ""]))
    command = re.escape(line.split(",")[0])
    with pytest.raises(
        ModelError, match=rf"a\.cdb: line {len(lines) + 1}: expected .*found {command}"
    ) as caught:
        read_body(archive / "a.cdb")
    assert "\n" not in str(caught.value)


@each("line", list(CDB_ON_ONE_LINE))
def test_commands_on_one_line_are_judged_one_by_one(line, archive):
    lines = (archive / "plain.cdb").read_text().splitlines()
    (archive / "a.cdb").write_text("\n".join([*lines, line, ""]))
    found = re.escape(CDB_ON_ONE_LINE[line])
    with pytest.raises(
        ModelError, match=rf"a\.cdb: line {len(lines) + 1}: expected .*, found {found}"
    ):
        read_body(archive / "a.cdb")


def test_other_commands_of_archives_leave_the_mesh_as_it_is_and_are_named(archive):
    text = (archive / "plain.cdb").read_text()
    (archive / "more.cdb").write_text(text.replace("FINISH", f"{CDB_TEXTS}\n{CDB_NOTED}\nFINISH"))
    plain, more = (read_body(archive / f"{name}.cdb") for name in ("plain", "more"))
    np.testing.assert_array_equal(more.nodes, plain.nodes)
    np.testing.assert_array_equal(more.elements, plain.elements)
    assert plain.notes == ("commands of the archive that are not read: /PREP7, FINISH",)
    assert more.notes == (
        "commands of the archive that are not read: /PREP7, MAT, REAL, *IF, *ELSE, *ENDIF, DOF, KEYOPT, DMPOPT, "
        "NLDIAG, SECCONTROL, *DIM, *SET, RLBLOCK, DBLOCK, LOCAL, D, SETTING2031, FINISH",
    )


def test_a_node_after_a_block_is_refused(archive):
    text = (archive / "plain.cdb").read_text()
    (archive / "a.cdb").write_text(
        text.replace("N,R5.3,LOC,       -1,", "N,R5.3,LOC,       77,  1.0\nN,R5.3,LOC,-1")
    )
    with pytest.raises(ModelError, match=r"expected a node, found 'N,R5\.3,LOC"):
        read_body(archive / "a.cdb")


def test_element_types_of_a_block_are_read(archive):
    """Type 1 is a solid; with type 200, which is for meshing only, no element is left."""
    text = (archive / "plain.cdb").read_text()
    for kind, count in (("185", 1), ("200", 0)):
        fields = "".join(f"{v:>9}" for v in (1, kind, *[0] * 19))
        block = f"ETBLOCK,        1,        1\n(2i9,19a9)\n{fields}\n       -1"
        (archive / f"{kind}.cdb").write_text(text.replace("ET,1,185", block))
        body = read_body(archive / f"{kind}.cdb")
        assert sum(map(len, body.elements)) == count
    assert "1 elements of type 200 are not solids and are not read" in body.notes


def test_geometry_in_front_of_an_archive_is_left_out(archive):
    """With the solid model, lines of 80 characters in IGES form precede the mesh; some contain commands."""
    lines = [
        "NGEN of a blade".ljust(72) + "S      1",
        "EGEN,2,100,ALL".ljust(72) + "S      2",
        "S      2T      1",
    ]
    text = "\n".join(
        [*lines, ":CDWRITE      ! START OF CDWRITE DATA", (archive / "plain.cdb").read_text()]
    )
    (archive / "both.cdb").write_text(text)
    np.testing.assert_array_equal(
        read_body(archive / "both.cdb").nodes, read_body(archive / "plain.cdb").nodes
    )
    (archive / "geometry.cdb").write_text("\n".join(lines))
    with pytest.raises(
        ModelError, match=r"expected the line :CDWRITE after the geometry \(IGES\), found the end"
    ):
        read_body(archive / "geometry.cdb")


WORKBENCH = Path(__file__).resolve().parents[3] / "shared" / "fixtures" / "field" / "workbench.cdb"


@pytest.mark.skipif(
    not WORKBENCH.exists(), reason="no archive of Workbench in ../shared/fixtures/field"
)
def test_an_archive_of_a_current_release_is_read():
    """Two bricks from z = 0 to 2, written in the form of release 2025 R1."""
    body = read_cdb(WORKBENCH)
    np.testing.assert_array_equal(body.numbers, np.arange(1, 13))
    np.testing.assert_array_equal(body.node_sets["HELD"], [1, 2, 3, 4])
    np.testing.assert_array_equal(
        np.sort(np.concatenate(body.elements), axis=1), [np.arange(1, 9), np.arange(5, 13)]
    )
    assert np.ptp(body.nodes, axis=0).tolist() == [1.0, 1.0, 2.0]


# ---- Nastran ----

BULK = """BEGIN BULK
GRID,1,,0.,0.,0.
GRID,2,,1.,0.,0.
GRID,3,,0.,1.,0.
GRID,4,,0.,0.,1.
CTETRA,1,1,1,2,3,4
PSOLID,1,1
MAT1,1,2.1+11,,0.3,7850.
"""
BDF_REFUSED = """RBAR,5,1,2,123456
RROD,5,1,2,1
RBE1,5,1,123456,,,,UM,2,1
RSPLINE,5,,1,2,123,3
MPCADD,2,3
SPOINT,99
CYJOIN,1,T1,1,2
BCTSET,1,1,2
BGSET,1,1,2
SEBULK,1,COPY
GENEL,5,,1,1
FOOBAR,1,2"""
BDF_HARMLESS = """EIGRL,1,,,6
SPC1,1,123,1
ASET1,123,2,THRU,4
FORCE,2,2,0,1.,1.,0.,0.
PARAM,COUPMASS,1
TEMP,4,1,20."""


@pytest.fixture
def bulk_data(tmp_path):
    def read(cards, before=""):
        (tmp_path / "a.bdf").write_text(f"{before}{BULK}{cards}\nENDDATA\n")
        return read_body(tmp_path / "a.bdf")

    return read


@each("card", BDF_REFUSED.splitlines())
@each("before", ["", "SOL 103\nCEND\nTITLE=A\n"])
def test_cards_that_could_change_the_mesh_are_refused(card, before, bulk_data):
    name, line = card.split(",")[0], len(f"{before}{BULK}".splitlines()) + 1
    where = rf"a\.bdf: {name} in line {line}: "
    with pytest.raises(
        ModelError, match=rf"{where}expected a mesh of .*, found {name},.* which may"
    ) as caught:
        bulk_data(card, before)
    assert "\n" not in str(caught.value)


TIED = {
    "RBE2,5,9,123,2,3": "RBE2,5,9,123,2,3",
    "RBE2           5       9     123       2       3": "RBE2           5       9     123       2",
    "RBE2*                  5               9             123               2\n*                      3": "RBE2*",
    "RBE3,5,,4,123,1.,123,1,2": "RBE3,5,,4,123,1.,123,1,2",
    "RBE3,6,,9,123,1.,123,1,2\n,UM,1,123": "RBE3,6,,9,123,1.,123,1,2",
    "MPC,3,9,1,1.,2,1,-1.\nMPC,3,1,1,1.,2,1,-1.": "MPC,3,1,1,1.,2,1,-1.",
    "SPC1,1,12345,9\nRBE2,5,9,123,2,3": "RBE2,5,9,123,2,3",
    "SPC1,1,123456,9\nSPC1,2,123,1\nRBE2,5,9,123,2,3": "RBE2,5,9,123,2,3",
}


@each("cards", list(TIED))
def test_ties_of_solid_elements_are_refused_by_card_number_and_line(cards, bulk_data):
    text, (lines, found) = f"GRID,9,,0.5,0.,0.\n{cards}", (cards.splitlines(), TIED[cards])
    at = (
        len(BULK.splitlines())
        + 2
        + next(k for k, line in enumerate(lines) if line.startswith(found))
    )
    with pytest.raises(ModelError) as caught:
        bulk_data(text)
    where = f"a.bdf: {found.split(',')[0].split()[0].strip('*')} in line {at}: expected a mesh without constraints, or RBE2"
    assert where in str(caught.value) and f", found {' '.join(found.split())}" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_harmless_cards_leave_the_mesh_as_it_is_and_masses_are_noted(bulk_data):
    plain, more, mass = bulk_data(""), bulk_data(BDF_HARMLESS), bulk_data("CONM2,7,1,,2.5")
    np.testing.assert_array_equal(more.nodes, plain.nodes)
    assert str(more) == str(plain)
    assert str(mass) == f"{plain}\n\ncards CONM2 (1) are not read: the matrices must contain them"


def test_matrices_that_are_not_used_are_named(bulk_data):
    names = ("KAAX", "MAAX", "K4AAX", "PAX")
    cards = [f"DMIG,{name},{rest}" for name in names for rest in ("0,6,2,0", "1,1,,1,1,2.")]
    body = bulk_data("\n".join(cards))
    assert body.stiffness.toarray().tolist() == [[2.0]]
    assert "matrices K4AAX, PAX (DMIG) are not used" in body.notes
    alone = bulk_data("\n".join(cards[2:4]))
    assert alone.stiffness is None and "matrices MAAX (DMIG) are not used" in alone.notes


SPIDERS = """GRID,8,,0.5,0.5,0.
GRID,9,,0.,0.,0.
RBE3,6,,8,123456,1.,123,3,4
RBE2,5,9,123456,1,2
SPC1,1,123456,9
EIGRL,1,,,6"""


def test_matrices_after_constraints_match_by_independent_components(bulk_data, tmp_path):
    """A spider of an output point (RBE3) and a spider that holds nodes 1 and 2 (RBE2), in KNN and KAAX."""
    from bdamper.importers import read_nastran

    body = bulk_data(SPIDERS)
    assert (
        "RBE3 6 ties grid points without solid elements: it must be in the matrices" in body.notes
    )
    assert "RBE2 5 fixes its dependent grid points, because 9 is fixed" in body.notes
    solid = np.diag(np.arange(1.0, 7.0)) + 1.0  # grid points 3 and 4
    knn = np.zeros((18, 18))  # six rows of 3, 4 and 9
    kept = [0, 1, 2, 6, 7, 8]
    knn[np.ix_(kept, kept)], knn[12:, 12:] = solid, np.eye(6)
    write_op4(tmp_path / "n.op4", {"KNN": knn, "MNN": 2.0 * knn})
    found = read_nastran(tmp_path / "a.bdf", tmp_path / "n.op4")
    np.testing.assert_array_equal(found.dofs, [(n, c) for n in (3, 4) for c in (1, 2, 3)])
    np.testing.assert_allclose(found.stiffness.toarray(), solid)
    np.testing.assert_allclose(found.mass.toarray(), 2.0 * solid)
    np.testing.assert_array_equal(found.numbers, [1, 2, 3, 4])
    assert "12 fixed or empty rows dropped" in found.notes
    cards = [f"DMIG    {name}           0       6       2       0" for name in ("KAAX", "MAAX")]
    for name, n, c in (
        (name, n, c) for name in ("KAAX", "MAAX") for n in (3, 4, 9) for c in (1, 2, 3)
    ):  # in the form of punched cards
        cards.append(f"DMIG*   {name:16s}{n:16d}{c:16d}\n*       {n:16d}{c:16d} 3.000000000D+00")
    found = bulk_data("\n".join([SPIDERS, *cards]))
    np.testing.assert_array_equal(found.stiffness.toarray(), 3.0 * np.eye(6))
    np.testing.assert_array_equal(found.dofs, [(n, c) for n in (3, 4) for c in (1, 2, 3)])
    np.testing.assert_array_equal(found.numbers, [1, 2, 3, 4])


def test_matrices_that_lack_the_rows_of_constraints_are_refused(bulk_data, tmp_path):
    """KNN has no rows of dependent components: six for each grid point are wanted."""
    from bdamper.importers import read_nastran

    bulk_data("")
    whole = np.diag(np.arange(1.0, 25.0))
    write_op4(tmp_path / "g.op4", {"KGG": whole, "MGG": whole})
    with pytest.raises(ModelError, match=r"a matrix 'KNN', found the matrices \['KGG', 'MGG'\]"):
        read_nastran(tmp_path / "a.bdf", tmp_path / "g.op4")
    assert read_nastran(
        tmp_path / "a.bdf", tmp_path / "g.op4", names=("KGG", "MGG")
    ).stiffness.shape == (24, 24)
    part = whole[:21, :21]
    write_op4(tmp_path / "n.op4", {"KNN": part, "MNN": part})
    with pytest.raises(
        ModelError,
        match=r"expected 24 rows: six for each grid point, without the dependent .*, found 21",
    ):
        read_nastran(tmp_path / "a.bdf", tmp_path / "n.op4")
