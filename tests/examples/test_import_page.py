"""The code of docs/import.md, from matrices in plain files to a tracking curve, runs and gives the reference model's."""

import re
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp

pytest.importorskip("skfem", reason="scikit-fem is not installed (extra bdamper[fe])")

from bdamper import Excitation
from bdamper.fe import SectorFE, bladed_disk
from tests.fe_bodies import sector_and_damper
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
}


def write_files(fe):
    """The files that the page reads, in the present folder."""
    for body, name in zip(sector_and_damper(fe), ("sector", "damper")):
        keep = np.arange(3 * len(body.nodes))
        if name == "sector":
            held = np.isin(body.numbers, body.node_sets["BORE"])
            keep = keep[~np.repeat(held, 3)]
            table = np.column_stack([body.numbers[keep // 3], keep % 3 + 1])
            np.savetxt("sector_dofs.csv", table, fmt="%d", delimiter=",")
        sp.save_npz(f"{name}_K.npz", body.stiffness[keep][:, keep])
        sp.save_npz(f"{name}_M.npz", body.mass[keep][:, keep])
        np.savetxt(
            f"{name}_nodes.csv", np.column_stack([body.numbers, body.nodes]), fmt=["%d", *3 * ["%.14e"]], delimiter=","
        )
        np.savetxt(f"{name}_elements.csv", body.elements[0], fmt="%d", delimiter=",")
        for file, key in SETS.items():
            if key in body.node_sets:
                np.savetxt(f"{file}.csv", body.node_sets[key], fmt="%d")


@pytest.mark.slow
def test_page(tmp_path, monkeypatch, capsys):
    pyuff = pytest.importorskip("pyuff", reason="pyuff is not installed (extra bdamper[unv])")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "Agg")
    fe = SectorFE()
    write_files(fe)
    x = np.linspace(250.0, 400.0, 31)
    measured = pyuff.prepare_58(
        binary=0, func_type=4, rsp_node=1, rsp_dir=1, ref_dir=1, ref_node=1, data=1e-5 / (320.0 - x + 3j), x=x, id1="rig",
        id2="", id3="", id4="", id5="", rsp_ent_name="B", ref_ent_name="B", abscissa_spacing=1, abscissa_spec_data_type=18,
        ordinate_spec_data_type=8, orddenom_spec_data_type=13, ordinate_axis_units_lab="m",
    )  # fmt: skip
    pyuff.UFF("measured.unv").write_sets([measured], "overwrite")
    blocks = re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.S)
    assert len(blocks) == 5
    space = {}
    exec(compile("\n".join(blocks), str(PAGE), "exec"), space)
    assert Path("report.png").stat().st_size > 10_000
    assert Path("curve.png").stat().st_size > 5_000
    assert "Import report" in capsys.readouterr().out
    assert len(space["axes"].lines) > 1

    reference = bladed_disk(24, n_modes=20, engine_order=5, harmonics=3, fe=fe)
    tip = space["built"].model.locations["tip"].position
    theirs = reference.locations["tip"].position
    assert np.linalg.norm(tip - theirs) < 1e-9, f"the tip is node {fe.blade.nearest_node(theirs) + 101}"
    assert space["curve"].complete
    # the rectangles of the constraint planes differ by 3.5 mm, which residual modes tell in the fourth digit
    studies = [plain_study(m, Excitation("tip"), 5, friction_coefficient=0.3) for m in (space["built"].model, reference)]
    found, expected = (s.track(500.0, (250.0, 400.0)).peak for s in studies)
    assert found.amplitude == pytest.approx(expected.amplitude, rel=1e-3)
    assert found.frequency == pytest.approx(expected.frequency, rel=1e-4)


def test_page_is_short():
    assert len(PAGE.read_text().splitlines()) < 190
