"""Example decks: their files, jobs read by the files beside a deck, and models from the command line."""

import re
from dataclasses import replace
from pathlib import Path

import pytest

import bdamper as bd
from bdamper.__main__ import main, parser, study_of
from bdamper.importers import (
    Checks,
    ContactFaces,
    Placement,
    Reduction,
    Sector,
    build_model,
    example_decks,
    read_calculix,
    read_job,
)
from bdamper.util.errors import ModelError, SettingError

WEDGE = ["--units", "mm-t-s", "--axis", "1", "0", "0", "--faces", "LOW", "HIGH", "--engine-order", "4", "--harmonics", "1",
         "--contact", "left=LEFT,RIGHT_UNDERSIDE", "right=RIGHT,LEFT_UNDERSIDE", "--stop", "front=FRONT,0.2",
         "back=damper/BACK,0.2", "--modes", "8"]  # fmt: skip
STRIPS = [
    f"{d}_{a}={d}/{a},UNDER_{b}"
    for d in ("front", "rear")
    for a, b in (("LEFT", "RIGHT"), ("RIGHT", "LEFT"))
]


def test_example_decks_are_small_and_never_replace_other_files(tmp_path):
    written = [
        path
        for name in ("abaqus", "ansys", "calculix", "shroud")
        for path in example_decks(name, tmp_path)
    ]
    assert len(written) == 3 + 4 + 8 + 12 and all(path.is_file() for path in written)
    turbine = tmp_path / "turbine"
    turbine.mkdir()
    assert len(example_decks("turbine", turbine)) == 8
    assert (
        sum(path.stat().st_size for path in Path(bd.__file__).parent.glob("data/decks/*"))
        < 1_000_000
    )
    example_decks("shroud", tmp_path)
    (tmp_path / "stage.inp").write_text("*NODE")
    with pytest.raises(
        FileExistsError, match=r"stage\.inp' exists and is not the file of the example 'abaqus'"
    ):
        example_decks("abaqus", tmp_path)
    assert (tmp_path / "stage.inp").read_text() == "*NODE"
    with pytest.raises(SettingError, match="example: expected one of"):
        example_decks("../abaqus", tmp_path)


def test_a_job_is_read_by_the_files_beside_its_deck(tmp_path):
    example_decks("calculix", tmp_path)
    example_decks("abaqus", tmp_path)
    ours, theirs = read_job(tmp_path / "damper.inp"), read_job(tmp_path / "stage.inp", "Strip-1")
    assert ours.stiffness.shape == theirs.stiffness.shape == (180, 180)
    assert abs(ours.nodes - theirs.nodes).max() < 1e-8
    with pytest.raises(ModelError, match=r"a deck \.inp or \.cdb"):
        read_job(tmp_path / "damper.sti")
    with pytest.raises(FileNotFoundError):
        read_job(tmp_path / "other.cdb")


@pytest.mark.parametrize(
    ("keyword", "line", "elasticity", "text"),
    [
        (
            "DENSITY",
            "4.43e-9",
            None,
            "density: expected 4430 kg/m3 of the elements C3D8, found 7850 kg/m3 in the matrices",
        ),
        (
            "ELASTIC",
            "1.14e5, 0.3",
            None,
            "expected 1.14e\\+11 Pa of the elements C3D8, found 2.1e\\+11 Pa in the",
        ),
        (
            "ELASTIC",
            "2.1e5, 0.33",
            None,
            "Poisson's ratio 0.33: expected 2.1e\\+11 Pa of the elements C3D8, found 1.827",
        ),
        (
            "ELASTIC",
            "2.1e5, 0.3",
            (2e5, 0.3),
            "expected 2e\\+11 Pa of the elements C3D8, found 2.1e\\+11 Pa in the",
        ),
    ],
)
def test_a_material_that_is_not_that_of_the_matrices(keyword, line, elasticity, text, tmp_path):
    """Deck and matrices of different materials are a failed comparison, by rows away from the held bore."""
    example_decks("calculix", tmp_path)
    deck = tmp_path / "sector.inp"
    deck.write_text(re.sub(rf"\*{keyword}\n.*", f"*{keyword}\n{line}", deck.read_text()))
    pairs = ("left", "RIGHT"), ("right", "LEFT")
    faces = [ContactFaces(a, a.upper(), f"{b}_UNDERSIDE", points=(2, 2)) for a, b in pairs]
    settings = {
        "placement": Placement("mm-t-s", axis=(1, 0, 0)), "reduction": Reduction(engine_order=4, harmonics=1, n_modes=8),
        "sector": Sector(36, ("LOW", "HIGH"), elasticity=elasticity), "contacts": faces, "checks": Checks(strict=True),
    }  # fmt: skip
    with pytest.raises(ModelError, match=text):
        build_model(
            read_calculix(tmp_path / "sector"), read_calculix(tmp_path / "damper"), **settings
        )


def test_a_pair_of_faces_has_one_contact(tmp_path):
    """Under another name, also with the bodies exchanged."""
    example_decks("calculix", tmp_path)
    bodies = read_calculix(tmp_path / "sector"), read_calculix(tmp_path / "damper")
    faces = [
        ContactFaces(a, a.upper(), f"{b}_UNDERSIDE", points=(3, 2))
        for a, b in (("left", "RIGHT"), ("right", "LEFT"))
    ]
    exchanged = ContactFaces("again", "RIGHT_UNDERSIDE", "LEFT", "blade", "damper", points=(3, 3))
    settings = {"placement": Placement("mm-t-s", axis=(1, 0, 0)), "sector": Sector(36, ("LOW", "HIGH")),
                "reduction": Reduction(engine_order=4, harmonics=1, n_modes=8)}  # fmt: skip
    for again in (replace(faces[0], name="again", points=(3, 3)), exchanged):
        with pytest.raises(
            ModelError, match=r"again.*: expected other faces than those of contact 'left', found"
        ):
            build_model(*bodies, contacts=[*faces, again], **settings)


@pytest.mark.slow
def test_decks_and_instances_give_the_same_model_on_the_command_line(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["decks", "calculix"]) == main(["decks", "abaqus"]) == main(["decks", "ansys"]) == 0
    assert (
        main(["import", "sector.inp", "--damper", "damper.inp", *WEDGE, "--tip", "0", "346.6", "0"])
        == 0
    )
    stage = [
        "stage.inp:Sector-1",
        "--damper",
        "stage.inp:Strip-1",
        "--fixed",
        "BORE",
        "--out",
        "abaqus",
        "--tip",
        "117",
    ]
    assert main(["import", *stage, *WEDGE]) == 0
    out = capsys.readouterr()
    assert "wrote sector.h5, sector.txt, sector.png" in out.err
    assert (tmp_path / "sector.txt").read_text() in out.out
    # the bore is held and has no rows
    assert re.search(r"^blade +pass +density of the matrices 7850 kg/m3$", out.out, re.M)
    assert (tmp_path / "sector.png").stat().st_size > 10_000
    files = ["sector.cdb", "--damper", "damper.cdb", "--out", "ansys", "--tip", "117"]
    assert main(["import", *files, *WEDGE]) == 0
    one, other, third = (bd.load_model(f"{name}.h5") for name in ("sector", "abaqus", "ansys"))
    for d, basis in one.bodies["blade"].bases.items():
        assert other.bodies["blade"].bases[d].omega2[:8] == pytest.approx(
            basis.omega2[:8], rel=1e-6
        )
        assert third.bodies["blade"].bases[d].omega2[:8] == pytest.approx(
            basis.omega2[:8], rel=2e-5
        )  # others: ten digits
    areas = [[face.area.sum() for face in model.interfaces.values()] for model in (one, third)]
    assert areas[1] == pytest.approx(
        areas[0], rel=1e-9
    )  # wedges that are stored as hexahedra have the areas of hexahedra
    # three rows are the least along t1; along t2 the blade has three lines of nodes
    assert [face.n_points for face in one.interfaces.values()] == [9, 9, 4, 4]
    chosen = (
        "left 9 points (3 x 3 along t1 and t2; lines of nodes: 3 x 5 on side a and 2 x 3 on side b"
    )
    printed = " ".join(out.out.split())
    assert chosen in printed
    assert "which do not resolve 24 points" in printed
    assert [one.interfaces[name].gap.tolist() for name in ("front", "back")] == [
        pytest.approx([2e-4] * 4)
    ] * 2
    assert one.locations["tip"].position == pytest.approx(other.locations["tip"].position)


@pytest.mark.slow
def test_a_shroud_and_two_dampers_on_the_command_line(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    main(["decks", "shroud"])
    bodies = [
        "blade.inp",
        "--damper",
        "front=front.inp",
        "rear=rear.inp",
        "--faces",
        "LOW",
        "HIGH",
        "--points",
        "3",
        "2",
        "shroud=1,4",
        "--gap",
        "front_LEFT=1e-6",
        "--tip",
        "0",
        "0.345",
        "0",
    ]
    faces = ["--contact", "shroud=blade/SHROUD_HIGH,SHROUD_LOW", *STRIPS]
    assert (
        main(["import", *bodies, *faces, "--engine-order", "4", "--harmonics", "1", "--modes", "8"])
        == 0
    )
    model = bd.load_model("blade.h5")
    assert [*model.bodies] == ["blade", "front", "rear"] and len(model.interfaces) == 5
    points = [face.n_points for face in model.interfaces.values()]
    assert points == [4, 6, 6, 6, 6] and model.interfaces["shroud"].sector_b == 1
    # the decks are in m
    assert model.interfaces["front_LEFT"].gap.tolist() == pytest.approx([1e-6] * 6)
    assert not model.interfaces["rear_LEFT"].gap.any()
    # what is imported can be studied
    given = parser().parse_args(
        ["response", "blade.h5", "--engine-order", "4", "--harmonics", "1", "--load", "shroud=100"]
    )
    alone = study_of(given, model).static(0.0).normal_force["shroud"]
    assert alone == pytest.approx(100.0, rel=1e-6)


@pytest.mark.parametrize(
    ("arguments", "code", "text"),
    [
        (
            ["decks", "nastran"],
            2,
            "example: expected one of ('abaqus', 'ansys', 'calculix', 'ring', 'shroud', 'turbine'), found 'nastran'",
        ),
        (["import", "nowhere.inp", "--contact", "a=A,B"], 1, "nowhere.inp"),
        (
            ["import", "sector.inp", "--contact", "A,B"],
            2,
            "--contact: expected NAME=SET,SET, found 'A,B'",
        ),
        (
            ["import", "sector.inp", "--contact", "a=A,B", "--points", "b=4"],
            2,
            "--points: expected contacts out of a, found b",
        ),
        (
            ["import", "sector.inp", "--contact", "a=A,B", "--points", "a=0"],
            2,
            "--points a: expected a whole number from 1 to 400, found 0",
        ),
        (
            ["import", "sector.inp", "--contact", "a=A,B", "--stop", "b=B"],
            2,
            "--stop: expected NAME=SET,GAP, found 'b=B'",
        ),
        (["import", "sector.inp", "--contact", "a=A,ground", *WEDGE[:-8]], 1, "contact 'a'"),
    ],
)
def test_a_failed_import_is_told_in_a_line(arguments, code, text, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    example_decks("calculix")
    assert main(arguments) == code
    told = capsys.readouterr().err
    assert text in told and told.count("\n") == 1
    assert not list(tmp_path.glob("*.h5"))
