"""Parts of a deck that are not read: elements other than solids that sets and surfaces name, and axes of supports."""

import shutil
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg

from bdamper.importers import read_abaqus, read_calculix, read_inp
from bdamper.util.errors import ModelError
from examples.calculix.decks import run_job
from tests.calculix_runs import read_frequencies
from tests.each import each

FIXTURE = Path(__file__).resolve().parents[3] / "shared" / "fixtures" / "field" / "shell_sets.inp"
MESH = """*NODE, NSET=ALL
1, 0., 0., 0.
2, 1., 0., 0.
3, 1., 1., 0.
4, 0., 1., 0.
5, 0., 0., 1.
6, 1., 0., 1.
7, 1., 1., 1.
8, 0., 1., 1.
*ELEMENT, TYPE=C3D8, ELSET=BRICK
1, 1, 2, 3, 4, 5, 6, 7, 8
"""
SHELLS = {
    "four nodes": "*ELEMENT, TYPE=S4, ELSET=SKIN\n2, 5, 6, 7, 8\n",
    "triangles": "*ELEMENT, TYPE=S3, ELSET=SKIN\n2, 5, 6, 7\n3, 5, 7, 8\n",
    "two lines": "*ELEMENT, TYPE=M3D4, ELSET=SKIN\n2, 5, 6,\n7, 8\n",
    "beams": "*ELEMENT, TYPE=B31, ELSET=SKIN\n2, 5, 6\n3, 7, 8\n",
    "generated": "*ELEMENT, TYPE=T3D2\n2, 5, 6\n*ELGEN, ELSET=SKIN\n2, 2, 2, 1\n",
}
NAMED = """*NSET, NSET=NSKIN, ELSET=SKIN
*ELSET, ELSET=BOTH
BRICK, SKIN, 2
*NSET, NSET=NBOTH, ELSET=BOTH
*SURFACE, NAME=OUTSIDE
SKIN, SPOS
*SURFACE, NAME=MIXED
SKIN, SPOS
2, SNEG
BRICK, S2
"""


@each("elements", SHELLS)
def test_sets_of_elements_that_are_not_solids(elements, tmp_path):
    (tmp_path / "a.inp").write_text(MESH + SHELLS[elements] + NAMED)
    body = read_inp(tmp_path / "a.inp")
    assert [e.tolist() for e in body.elements] == [[list(range(1, 9))]]
    assert body.node_sets["NSKIN"].tolist() == [5, 6, 7, 8]
    assert body.node_sets["NBOTH"].tolist() == list(range(1, 9))
    assert "OUTSIDE" not in body.face_sets
    assert [sorted(row) for row in body.face_sets["MIXED"][0].tolist()] == [[5, 6, 7, 8]]
    n = 2 if elements in ("triangles", "beams", "generated") else 1
    assert f"*SURFACE OUTSIDE: {n} faces of elements that are not read are omitted" in body.notes
    assert f"*SURFACE MIXED: {n + 1} faces of elements that are not read are omitted" in body.notes


def test_the_deck_of_the_field():
    if not FIXTURE.exists():
        pytest.skip(f"{FIXTURE} is not part of the project")
    body = read_inp(FIXTURE)
    assert sum(map(len, body.elements)) == 1
    assert body.node_sets["NSKIN"].tolist() == [5, 6, 7, 8]


def test_shells_of_a_part(tmp_path):
    parts = f"*PART, NAME=P\n{MESH}{SHELLS['four nodes']}{NAMED}*END PART\n*ASSEMBLY, NAME=A\n"
    for k in (1, 2):
        parts += f"*INSTANCE, NAME=I{k}, PART=P\n{2.0 * k}, 0., 0.\n*END INSTANCE\n"
    parts += "*ELEMENT, TYPE=CONN3D2, ELSET=WIRES\n1, I1.1, I2.1\n*NSET, NSET=N, ELSET=WIRES\n"
    (tmp_path / "a.inp").write_text(parts + "*END ASSEMBLY\n")
    body = read_inp(tmp_path / "a.inp")
    assert sum(map(len, body.elements)) == 2
    assert body.node_sets["I2.NSKIN"].tolist() == [13, 14, 15, 16]
    assert "N" not in body.node_sets
    assert read_inp(tmp_path / "a.inp", "I2").node_sets["NSKIN"].tolist() == [5, 6, 7, 8]


def test_an_unknown_set_is_still_refused(tmp_path):
    (tmp_path / "a.inp").write_text(MESH + "*NSET, NSET=N, ELSET=NONE\n")
    with pytest.raises(
        ModelError, match=r"\*NSET in line 12: expected a number or one of the sets"
    ):
        read_inp(tmp_path / "a.inp")


# ---- *TRANSFORM ----

MATERIAL = """*NODE
9, 0., 0., 2.
10, 1., 0., 2.
11, 1., 1., 2.
12, 0., 1., 2.
13, 0., 0., 3.
14, 1., 0., 3.
15, 1., 1., 3.
16, 0., 1., 3.
*ELEMENT, TYPE=C3D8, ELSET=BRICK
2, 5, 6, 7, 8, 9, 10, 11, 12
3, 9, 10, 11, 12, 13, 14, 15, 16
*MATERIAL, NAME=M
*ELASTIC
2.1e5, 0.3
*DENSITY
7.8e-9
*SOLID SECTION, ELSET=BRICK, MATERIAL=M
"""
HELD = "*NSET, NSET=HELD\n1, 2, 3, 4\n*TRANSFORM, NSET=HELD, TYPE=R\n1., 1., 0., -1., 1., 0.\n"
PARTLY = "*BOUNDARY\nHELD, 1, 1\nHELD, 3, 3\n"


@pytest.mark.skipif(shutil.which("ccx") is None, reason="CalculiX (ccx) is not installed")
def test_held_nodes_with_axes_of_their_own(tmp_path):
    """Held in all components: the frequencies of CalculiX.  Held in some: refused, since its rows combine components."""
    start = MESH + MATERIAL + HELD
    full = start + "*BOUNDARY\nHELD, 1, 3\n"
    matrices = "*STEP\n*FREQUENCY, SOLVER=MATRIXSTORAGE\n1\n*END STEP\n"
    run_job(full + matrices, tmp_path, "held")
    run_job(full + "*STEP\n*FREQUENCY\n6\n*END STEP\n", tmp_path, "modes")
    body = read_calculix(tmp_path / "held")
    assert any(note.startswith("*TRANSFORM of HELD: only supports of all") for note in body.notes)
    omega2 = scipy.linalg.eigvalsh(body.stiffness.toarray(), body.mass.toarray())
    theirs = read_frequencies(tmp_path / "modes.dat")
    np.testing.assert_allclose(np.sqrt(omega2[:6]) / (2.0 * np.pi), theirs, rtol=1e-6)

    run_job(start + PARTLY + matrices, tmp_path, "partly")
    message = (
        r"\*TRANSFORM in line 32: expected nodes of HELD fixed in all three .*found node \[1\]"
    )
    with pytest.raises(ModelError, match=message):
        read_calculix(tmp_path / "partly")


def test_transforms_of_abaqus_are_refused(tmp_path):
    """Its matrices have rows in these axes."""
    (tmp_path / "a.inp").write_text(MESH + HELD)
    with pytest.raises(ModelError, match=r"\*TRANSFORM in line 14: expected a job without"):
        read_abaqus(tmp_path / "a")
    (tmp_path / "b.inp").write_text(MESH + "*TRANSFORM, NSET=NONE\n1., 0., 0., 0., 1., 0.\n")
    with pytest.raises(ModelError, match=r"\*TRANSFORM in line 12: expected NSET= with a set"):
        read_inp(tmp_path / "b.inp")
