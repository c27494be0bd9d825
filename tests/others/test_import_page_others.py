"""The examples of docs/evidence/import-examples.md, which read models by others."""

import re
from pathlib import Path

import numpy as np
import pytest

from tests.others_files import ANSYS, deck, front, has_decks, held, read_calculix, sector

PAGE = Path(__file__).parents[2] / "docs" / "evidence" / "import-examples.md"

if not (has_decks() and ANSYS.is_dir()):
    pytest.skip(
        "CalculiX with its decks and the files that make others unpacks", allow_module_level=True
    )


def test_examples(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    text = deck("segmenttet")
    body = sector(text, tmp_path)
    rows = "\n".join(f"{number}," for number in front(body))
    text += f"*NSET, NSET=FRONT\n{rows}\n" + held(text)
    sector(text, tmp_path)
    for end in ("inp", "sti", "mas", "dof"):
        (tmp_path / f"matrices.{end}").rename(tmp_path / f"segmenttet.{end}")
    assert "FRONT" in read_calculix("segmenttet").node_sets
    (tmp_path / "file.rst").write_bytes((ANSYS / "file.rst").read_bytes())
    blocks = re.findall(r"```{code-block} python\n(.*?)```", PAGE.read_text(), re.S)
    assert len(blocks) == 2
    space: dict = {}
    exec(compile("\n".join(blocks), str(PAGE), "exec"), space)
    assert len(re.findall(r"all values: \w+\.summary\(\)", capsys.readouterr().out)) == 2
    assert space["curve"].complete
    assert np.isfinite(space["curve"].peak.amplitude)
