"""Files of Ansys that ``ansys-mapdl-reader`` carries, beside the frequencies that stand in it."""

import numpy as np
import pytest

import bdamper as bd
from bdamper.importers import ContactFaces, read_ansys, read_cdb, read_rst
from tests.imports import build
from tests.others_files import ANSYS

if not ANSYS.is_dir():
    pytest.skip(
        "the files of ansys-mapdl-reader are not unpacked (make others)", allow_module_level=True
    )

BEAM = {"n_blades": 1, "axis": (0, 1, 0), "radial": (0, 0, 1), "n_modes": 6, "check_units": False}
FREQUENCIES = (1283.20036921, 1283.20036921, 5781.97486169)
"""Hz, of the beam of ``file.full``, in ``examples.py`` beside it."""


def rub(body, **settings):
    """The free end of the beam (z = 5) on the ground."""
    end = body.numbers[body.nodes[:, 2] > 5.0 - 1e-9]
    return ContactFaces("rub", end, body_a="blade", body_b="ground", points=4, **settings), {
        "tip": int(end[0])
    }


def test_matrices_of_a_full_file():
    assert str(FREQUENCIES[2]) in (ANSYS / "examples.py").read_text()
    body = read_ansys(ANSYS / "file.full", ANSYS / "HexBeam.cdb")
    contact, tip = rub(body)
    settings = {
        "contacts": [contact],
        "locations": tip,
        "expected_frequencies": {0: FREQUENCIES},
    } | BEAM
    with pytest.raises(
        bd.ModelError,
        match=r"density: expected 2700 kg/m3 of the elements C3D20R, found 0\.0004141 kg/m3",
    ):
        build(body, strict=True, **settings)  # the archive has another material
    with pytest.warns(UserWarning, match="density"):
        made = build(body, **settings)
    assert made.failed and all("possibly files of different models" in text for text in made.failed)
    np.testing.assert_allclose(made.frequencies[0][:3], FREQUENCIES, rtol=1e-9)


@pytest.mark.parametrize(
    ("name", "sizes"), [("HexBeam", (321, 40)), ("TetBeam", (1041, 3913)), ("sector", (655, 105))]
)
def test_archives(name, sizes):
    body = read_cdb(ANSYS / f"{name}.cdb")
    assert (len(body.numbers), sum(map(len, body.elements))) == sizes


def test_modes_alone_with_a_stiffness_of_the_user():
    """A beam from its result file, rubbing on the ground: the model says what it lacks, and gives a curve."""
    body = read_rst(ANSYS / "file.rst")
    assert body.stiffness is None
    for stiffness, given in (((1e7, 1e7, 1e7), None), (None, 1e7)):
        contact, tip = rub(body, stiffness=stiffness, gap=-1e-6)
        made = build(body, contacts=[contact], locations=tip, **BEAM)
        assert any("static receptances of the blade (no matrices)" in line for line in made.missing)
        excitation = bd.Excitation("tip", direction="tangential", amplitude=1000.0)
        study = bd.Study(
            made.model, excitation, friction_coefficient=0.3, harmonics=1, contact_stiffness=given
        )
        curve = study.frequency_response(0.0, (7000.0, 9000.0))
        assert curve.status == "complete" and not curve.peak_at_end
