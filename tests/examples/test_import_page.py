"""The code of docs/import.md runs in an empty folder; a model from plain files responds as the reference model."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp

pytest.importorskip("skfem", reason="scikit-fem is not installed (extra bdamper[fe])")

from bdamper import Excitation, importers
from bdamper.fem import SectorFE, bladed_disk
from bdamper.fem.generated_models import blade_points
from bdamper.fem.meshes import local_order
from bdamper.importers import Checks, ContactFaces, Reduction, Sector, build_model, read_arrays
from tests.ansys_files import write_cdb, write_full
from tests.fe_bodies import FIRST_NUMBER, modes_alone, sector_and_damper
from tests.importers.test_io_files import bulk_text
from tests.nastran_files import write_op4
from tests.own_sector import OwnSector, deck
from tests.plain import plain_study

PAGE = Path(__file__).resolve().parents[2] / "docs" / "import.md"
SETS = {
    "sector_low": "LOW",
    "sector_high": "HIGH",
    "under_right": "RIGHT_UNDERSIDE",
    "under_left": "LEFT_UNDERSIDE",
    "damper_left": "LEFT",
    "damper_right": "RIGHT",
    "damper_front": "FRONT",
    "damper_back": "BACK",
    "fillet": "FILLET",
    "blade": "BLADE",
}


def write_files(fe):
    """The files that the page reads, in the present folder."""
    blade, damper = sector_and_damper(fe)
    root = {"FILLET": blade_points(fe.blade, fe.geometry)[:4], "BLADE": fe.blade_part().nodes}
    blade = replace(
        blade,
        node_sets={
            **blade.node_sets,
            **{name: FIRST_NUMBER + nodes for name, nodes in root.items()},
        },
    )
    for body, name in ((blade, "sector"), (damper, "damper")):
        keep = np.arange(3 * len(body.nodes))
        if name == "sector":
            held = np.isin(body.numbers, body.node_sets["BORE"])
            keep = keep[~np.repeat(held, 3)]
            table = np.column_stack([body.numbers[keep // 3], keep % 3 + 1])
            np.savetxt("sector_dofs.csv", table, fmt="%d", delimiter=",")
        sp.save_npz(f"{name}_K.npz", body.stiffness[keep][:, keep])
        sp.save_npz(f"{name}_M.npz", body.mass[keep][:, keep])
        np.savetxt(
            f"{name}_nodes.csv",
            np.column_stack([body.numbers, body.nodes]),
            fmt=["%d", *3 * ["%.14e"]],
            delimiter=",",
        )
        np.savetxt(f"{name}_elements.csv", body.elements[0], fmt="%d", delimiter=",")
        for file, key in SETS.items():
            if key in body.node_sets:
                np.savetxt(f"{file}.csv", body.node_sets[key], fmt="%d")


@pytest.mark.nightly
@pytest.mark.slow
def test_page(tmp_path, monkeypatch, capsys):
    """Every block as pasted; the same sector as instances of Abaqus has the same peak."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "Agg")
    text = PAGE.read_text()
    blocks = re.findall(r"```python\n(.*?)```", text, re.S)
    assert len(blocks) == text.count("```") // 2 == 8
    space = {}
    exec(compile("\n".join(blocks), str(PAGE), "exec"), space)
    for name in ("report.png", "curve.png", "ring.png"):
        assert Path(name).stat().st_size > 5_000
    assert capsys.readouterr().out.count("imported model of") == 1
    assert space["built"].failed == () and space["curve"].complete
    peak, again, curve = space["peak"], space["again"], space["curve"]
    assert peak.status == again.status == "complete"
    assert again.amplitude == pytest.approx(peak.amplitude, rel=1e-3)
    assert curve.peak.amplitude == pytest.approx(peak.amplitude, rel=1e-3)
    assert "harmonics=1" not in "\n".join(blocks[:6])
    assert space["study"].model.n_blades == space["wheel"].n_blades == 36


@pytest.mark.slow
def test_the_example_with_a_shroud_and_two_dampers(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (code,) = re.findall(
        r"```python\n(.*?)```", (PAGE.parent / "evidence" / "import-examples.md").read_text(), re.S
    )
    space = {}
    exec(compile(code, "import-examples.md", "exec"), space)
    curve, study = space["curve"], space["study"]
    assert (
        space["built"].failed == ()
        and curve.complete
        and [*study.model.bodies] == ["blade", "front", "rear"]
    )
    assert curve.peak.amplitude < 0.1 * study.free((1000.0, 1700.0)).peak.amplitude
    loads = study.static(300.0).normal_force
    assert loads["rear_left"] == pytest.approx(0.6 * loads["front_left"], rel=0.05)


PLAIN = {
    "blade": (
        "sector",
        {
            key: file
            for file, key in zip(list(SETS)[:4], ("low", "high", "under_right", "under_left"))
        },
    ),
    "damper": ("damper", {side: f"damper_{side}" for side in ("left", "right", "front", "back")}),
}
"""Files of both bodies, and of their sets."""


@pytest.mark.nightly
@pytest.mark.slow
def test_plain_files_give_the_reference_model(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    fe = SectorFE()
    write_files(fe)
    bodies = [
        read_arrays(
            f"{name}_K.npz", f"{name}_M.npz", f"{name}_nodes.csv", "sector_dofs.csv" if name == "sector" else None,
            {key: f"{file}.csv" for key, file in sets.items()}, f"{name}_elements.csv",
        )
        for name, sets in PLAIN.values()
    ]  # fmt: skip
    planes = {"body_b": "ground", "kind": "constraint", "points": (2, 2), "gap": 2e-4}
    built = build_model(
        *bodies, sector=Sector(65, ("low", "high"), elasticity=(2.1e11, 0.3)),
        contacts=[
            ContactFaces("left", "left", "under_right", points=9), ContactFaces("right", "right", "under_left", points=9),
            ContactFaces("front", "front", **planes), ContactFaces("back", "back", **planes),
        ],
        reduction=Reduction(engine_order=5, harmonics=3, n_modes=20), locations={"tip": 344},
        checks=Checks(expected_frequencies={5: [285.2, 699.0]}),
    )  # fmt: skip
    assert built.failed == ()
    reference = bladed_disk(9, n_modes=20, engine_order=5, harmonics=3, fe=fe)
    tip, theirs = built.model.locations["tip"].position, reference.locations["tip"].position
    assert np.linalg.norm(tip - theirs) < 1e-9, (
        f"the tip is node {fe.blade.nearest_node(theirs) + 101}"
    )
    # the rectangles of the constraint planes differ by 3.5 mm, which residual modes tell in the fourth digit
    models = modes_alone(built.model), reference
    studies = [plain_study(m, Excitation("tip"), 5, friction_coefficient=0.3) for m in models]
    found, expected = (s.frequency_response(500.0, (250.0, 400.0)).peak for s in studies)
    assert found.amplitude == pytest.approx(expected.amplitude, rel=1e-3)
    assert found.frequency == pytest.approx(expected.frequency, rel=1e-4)


RECIPES = {
    "calculix": 'read_calculix("sector")',
    "abaqus": 'read_abaqus("sector")',
    "ansys": 'read_ansys("sector.full", "sector.cdb")',
    "nastran": 'read_nastran("sector.bdf", "sector.op4")',
}


def small():
    """A body for the files of other programs: matrices, nodes, elements."""
    body = OwnSector("C3D20").fe.damper.body
    return body, body.elements[:, local_order()]


def triplets(matrix, name):
    upper = sp.triu(matrix).tocoo()
    Path(name).write_text(
        "".join(f"{i + 1} {j + 1} {v:.16e}\n" for i, j, v in zip(upper.row, upper.col, upper.data))
    )


def write_calculix(body, elements):
    rows = [f"{n + 1}.{c}" for n in range(len(body.nodes)) for c in (1, 2, 3)]
    for name in ("sector", "damper"):
        Path(f"{name}.inp").write_text(
            deck("C3D20", body.nodes, elements, 2.1e11, 0.3, 7850.0, {"TIP": [0, 1]})
        )
        Path(f"{name}.dof").write_text("\n".join(rows))
        triplets(body.stiffness, f"{name}.sti")
        triplets(body.mass, f"{name}.mas")


def write_abaqus(body, elements):
    Path("sector.inp").write_text(
        deck("C3D20R", body.nodes, elements, 2.1e11, 0.3, 7850.0, {"TIP": [0, 1]})
    )
    for name, matrix in (("STIF1", body.stiffness), ("MASS1", body.mass)):
        m = sp.triu(matrix).tocoo()
        lines = [
            f"{i // 3 + 1},{i % 3 + 1},{j // 3 + 1},{j % 3 + 1},{v:.16e}"
            for i, j, v in zip(m.row, m.col, m.data)
        ]
        Path(f"sector_{name}.mtx").write_text("\n".join(lines))


def write_ansys(body, elements):
    numbers = 10 * np.arange(1, len(body.nodes) + 1)
    write_full(Path("sector.full"), body.stiffness, body.mass, numbers)
    write_cdb(Path("sector.cdb"), numbers, body.nodes, numbers[elements], {"ENDS": numbers[[0, 1]]})
    constants = [
        f"MPDATA,R5.0, 1,{name},       1, 1,  {value}    ,"
        for name, value in (("EX  ", 2.1e11), ("NUXY", 0.3))
    ]
    Path("sector.cdb").write_text("\n".join([*constants, Path("sector.cdb").read_text()]))


def write_nastran(body, elements):
    numbers = np.arange(1, len(body.nodes) + 1)
    Path("sector.bdf").write_text(bulk_text(numbers, body.nodes, numbers[elements]))
    rows = (6 * np.arange(len(numbers))[:, None] + np.arange(3)).ravel()
    pick = sp.csr_matrix(
        (np.ones(len(rows)), (rows, np.arange(len(rows)))), shape=(6 * len(numbers), len(rows))
    )
    full = {name: pick @ m @ pick.T for name, m in (("KNN", body.stiffness), ("MNN", body.mass))}
    write_op4(Path("sector.op4"), full)


@pytest.mark.slow
@pytest.mark.parametrize("program", RECIPES)
def test_recipes(program, tmp_path, monkeypatch):
    """Each reads what its program would have written: matrices, elements with their type, sets."""
    monkeypatch.chdir(tmp_path)
    body, elements = small()
    write = {
        "calculix": write_calculix,
        "abaqus": write_abaqus,
        "ansys": write_ansys,
        "nastran": write_nastran,
    }
    write[program](body, elements)
    assert (
        RECIPES[program].replace("sector", "stage" if program == "abaqus" else "sector")
        in PAGE.read_text()
    )
    blade = eval(RECIPES[program], vars(importers))
    dofs = blade.dofs
    order = np.argsort(3 * np.searchsorted(np.sort(blade.numbers), dofs[:, 0]) + dofs[:, 1] - 1)
    np.testing.assert_allclose(
        blade.stiffness[order][:, order].toarray(),
        body.stiffness.toarray(),
        atol=1e-8 * abs(body.stiffness).max(),
    )
    (kind,) = blade.element_kinds
    assert kind.name == {"abaqus": "C3D20R", "ansys": "C3D20R"}.get(program, "C3D20")
    assert set(blade.node_sets) >= {"calculix": {"TIP"}, "abaqus": {"TIP"}, "ansys": {"ENDS"}}.get(
        program, set()
    )
    assert (kind.youngs_modulus, kind.poisson_ratio) == (2.1e11, 0.3)
