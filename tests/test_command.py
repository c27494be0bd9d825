"""The command: prints, files and exit codes; every question on the typical blade."""

import subprocess
import sys

import pytest
from numpy.testing import assert_array_equal

import bdamper as bd
from bdamper.__main__ import main, parser, study_of, with_flag
from tests.each import each

QUICK = {
    "response": ["--preload", "104", "--band", "630", "690"],
    "optimum": ["--preloads", "80", "160", "-n", "4", "--no-check"],
    "crossings": ["--speeds", "9000", "9500", "--orders", "5"],
    "margin": ["--preload", "104", "--endurance=300", "--ultimate=1200", "--yield=900"],
}


SLOW = ("optimum", "margin")


@pytest.mark.slow
@pytest.mark.parametrize(
    "command", [pytest.param(c, marks=[pytest.mark.slow] * (c in SLOW)) for c in QUICK]
)
def test_answers_are_printed_and_written(command, tmp_path, capsys):
    files = [f"--{kind}={tmp_path / f'out.{kind}'}" for kind in ("csv", "h5", "png")]
    files += [f"--html={tmp_path / 'out.html'}"] * (command == "optimum")
    assert main([command, "--demo", "--harmonics", "1", *QUICK[command], *files]) == 0
    out = capsys.readouterr().out
    result = bd.load(tmp_path / "out.h5")
    assert str(result).splitlines()[0] in out
    assert ("by harmonic balance alone" in out) == (command == "optimum"), (
        "a margin has the amplitude in time"
    )
    assert (tmp_path / "out.csv").read_text().count("\n") > 2
    assert (tmp_path / "out.png").read_bytes()[1:4] == b"PNG"
    assert (tmp_path / "out.html").exists() == (command == "optimum")


@pytest.mark.slow
def test_what_is_asked_is_what_the_study_answers(capsys, tmp_path):
    path, picture = tmp_path / "curve.h5", tmp_path / "curve.png"
    asked = [
        "--direction=axial",
        "--friction-coefficient=0.5",
        "--amplitude=2",
        "--harmonics=1",
        "--preload=104",
        "--band",
        "630",
        "690",
    ]
    assert (
        main(["response", "--demo", *asked, "--quiet", "--h5", str(path), "--png", str(picture)])
        == 0
    )
    told, wrote = capsys.readouterr().err.splitlines()
    assert (
        "--direction: plausible along the motion of a mode" in told and wrote == f"wrote {picture}"
    )
    study = bd.Study(
        bd.reference_model("turbine_blade"), bd.Excitation("tip", "axial", 2.0), 5, 0.5, harmonics=1
    )
    assert_array_equal(
        bd.load(path).amplitude, study.frequency_response(104.0, (630.0, 690.0)).amplitude
    )
    strength = [
        "--endurance=300",
        "--ultimate=1200",
        "--yield=900",
        "--no-check",
        "--speed=7639.437268410977",
    ]
    assert (
        main(
            [
                "margin",
                "--demo",
                "--harmonics=1",
                "--preload=3616",
                *strength,
                "--quiet",
                "--h5",
                str(path),
            ]
        )
        == 0
    )
    assert (
        bd.load(path).speed == 800.0 == bd.load(path).settings["speed"]
        and "contradict" not in capsys.readouterr().err
    )


@pytest.mark.slow
def test_a_margin_without_an_amplitude_in_time(capsys, monkeypatch):
    def lost(*_, **__):
        raise bd.BdamperError("why")

    monkeypatch.setattr(bd.Study, "time_response", lost)
    assert main(["margin", "--demo", "--harmonics=1", "--quiet", *QUICK["margin"]]) == 0
    out, err = capsys.readouterr()
    assert (
        "bdamper: no amplitude by time integration: why\n" in err
        and "Next time integration: study.margin(peak, material" in " ".join(out.split())
    )


@pytest.mark.slow
def test_info_of_a_file(capsys, tmp_path):
    bd.save_model(bd.reference_model("blade_to_ground"), tmp_path / "model.h5")
    assert main(["info", str(tmp_path / "model.h5"), "--png", str(tmp_path / "model.png")]) == 0
    assert "platform: friction, blade on ground" in capsys.readouterr().out
    assert (tmp_path / "model.png").exists()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "code", "text"),
    [
        (["info", "nowhere.h5"], 1, "nowhere.h5"),
        (
            ["crossings", "--demo", "--speeds", "1000", "2000"],
            1,
            "give a range wider than 1000 to 2000 rpm",
        ),
        (
            ["crossings", "--demo", "--speeds", "1000", "2000", "--orders", "10"],
            1,
            "rpm with free contacts and at",
        ),
        (["response", "--demo", "--preload", "-1"], 2, "bdamper: --preload: expected a finite"),
        (["optimum", "--demo", "--preloads", "9", "-3"], 2, "bdamper: --preloads: expected a seq"),
        (["response", "--demo", "--location", "tap"], 2, "bdamper: --location: expected one of"),
        (
            ["response", "--demo", "--load", "left=9"],
            2,
            "bdamper: --load: expected names of loaded",
        ),
        (["response", "--demo", "--engine-order", "4"], 2, "nodal diameter"),
    ],
)
def test_no_answer_is_told_in_a_line(arguments, code, text, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(arguments) == code
    out, err = capsys.readouterr()
    assert text in " ".join((out + err).split()) and "Traceback" not in err


@each(
    ("arguments", "words"),
    [
        ([], "the following arguments are required: command"),
        (["trak", "--demo"], "invalid choice: 'trak'"),
        (["response"], "one of the arguments model --demo is required"),
        (["response", "--demo", "m.h5"], "not allowed with argument"),
        (["optimum", "--demo", "-n", "many"], "argument -n: invalid int value: 'many'"),
        (
            ["response", "--demo", "--png", "out.xyz"],
            "--png: expected .png or .pdf or .svg in an existing folder, found 'out.xyz'",
        ),
        (["response", "--demo", "--csv", "nowhere/out.csv"], "found 'nowhere/out.csv'"),
        (["response", "--demo", "--load", "shroud=much"], "expected NAME=N, found 'shroud=much'"),
        (
            ["import", "a.inp", "--contact", "a=A,B", "--points", "a=few"],
            "argument --points: expected NAME=N or NAME=N,N, found 'a=few'",
        ),
        (["explore", "--demo", "--png=out.png"], "unrecognized arguments: --png"),
        (
            ["margin", "--demo"],
            "the following arguments are required: --endurance, --ultimate, --yield",
        ),
    ],
)
def test_wrong_use_is_told_in_a_line(arguments, words, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit, match="2"):
        main(arguments)
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("bdamper") and words in line


def test_faces_have_loads_of_their_own():
    """A shroud at 20 N beside dampers at 50 N, as by the settings of a study."""
    given = parser().parse_args(
        ["response", "stage.h5", "--engine-order", "4", "--load", "shroud=20"]
    )
    model = bd.reference_model("shrouded_blade")
    study = study_of(given, model)
    forces = study.static(50.0).normal_force
    loaded = bd.Study(model, bd.Excitation("tip"), engine_order=4, constant_loads={"shroud": 20.0})
    assert forces == loaded.static(50.0).normal_force
    assert forces["shroud"] > study.replace(constant_loads=None).static(50.0).normal_force["shroud"]


def test_messages_name_the_face_of_a_flag():
    assert (
        with_flag("contact 'wedge': points: expected 1", "import") == "--points wedge: expected 1"
    )
    assert (
        with_flag("constant_loads of 'shroud': expected", "response") == "--load shroud: expected"
    )
    assert with_flag("preload: expected 1", "optimum") == "--preloads: expected 1"
    assert with_flag("gap between bodies: expected 1", "import") == "gap between bodies: expected 1"


def test_the_check_of_an_optimum_is_one_that_a_study_has(capsys):
    assert main(["optimum", "--demo", "-n", "1"]) == 2
    assert capsys.readouterr().err == "bdamper: -n: expected a whole number >= 2, found 1\n", (
        "not refused for the check"
    )


def test_help_names_units_and_defaults(capsys):
    words = {
        "optimum": "in N, default 20 2000",
        "margin": "yield strength in MPa",
        "crossings": "rpm",
    }
    for command, word in words.items():
        with pytest.raises(SystemExit, match="0"):
            parser().parse_args([command, "--help"])
        assert word in capsys.readouterr().out


@pytest.mark.slow
def test_doubts_and_details(capsys, tmp_path):
    asked = [
        "--band",
        "3900",
        "4400",
        "--harmonics=1",
        "--quiet",
        f"--png={tmp_path / 'curve.png'}",
    ]
    assert main(["response", "--demo", *asked]) == 0
    out, err = capsys.readouterr()
    assert "all values: --details" in out and "summary()" not in out
    assert (
        err.startswith("bdamper: --band: plausible an interval in Hz")
        and "possibly given in radians per second\n" in err
    )
    assert main(["response", "--demo", *asked, "--details"]) == 0
    (residual,) = (
        line.split()
        for line in capsys.readouterr().out.splitlines()
        if line.startswith("  residual ")
    )
    assert (
        0.0 < float(residual[1]) <= float(residual[2]) < 1e-6
    )  # the least and the largest of the points


@pytest.mark.slow
def test_runs_as_a_module():
    run = subprocess.run(
        [sys.executable, "-m", "bdamper", "--version"], capture_output=True, text=True
    )
    assert run.stdout.strip() == bd.__version__


def test_the_demo_leaves_no_file_unasked(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("bdamper.util.progress.FIRST_LINE", 0.0)
    assert main(["response", "--demo", "--harmonics", "1", *QUICK["response"]]) == 0
    assert not list(tmp_path.iterdir())
    told = (
        capsys.readouterr().err.splitlines()
    )  # no terminal: a line at each tenth of the way, never back
    tenths = [int(line.removeprefix("response curve: ").removesuffix(" %")) for line in told]
    assert tenths == sorted(set(tenths)) and tenths[-1] == 100 and all(x % 10 == 0 for x in tenths)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["csv", "h5", "png"])
def test_an_answer_is_printed_before_a_file_that_cannot_be_written(kind, tmp_path, capsys):
    path = tmp_path / f"out.{kind}"
    path.mkdir()  # in place of the file
    assert (
        main(
            [
                "response",
                "--demo",
                "--harmonics",
                "1",
                "--quiet",
                *QUICK["response"],
                f"--{kind}",
                str(path),
            ]
        )
        == 1
    )
    out, err = capsys.readouterr()
    assert out.startswith("Resonance peak ") and err.splitlines()[-1].startswith(
        f"bdamper: {path}: expected a file that"
    )
