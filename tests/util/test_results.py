"""Every result that a study gives: it prints its bottom line first, has details, draws itself, is saved and is a table."""

import csv
from dataclasses import fields

import matplotlib
import pytest

matplotlib.use("Agg")

import matplotlib.pyplot as plt
from matplotlib.figure import Figure

import bdamper as bd
from bdamper.util.display import Plottable
from tests.each import each
from tests.every_result import RESULTS, WITHOUT_TABLE
from tests.every_result import result as made


@pytest.mark.slow
@each("name", [name for name in RESULTS if name not in (*WITHOUT_TABLE, "flutter")])
def test_prints_draws_saves_and_is_a_table(name, tmp_path):
    result = made(name)
    first = str(result).split("\n")[0]
    assert first[0].isupper() or first[0].isdigit() or name == "mistuning", "a sentence comes first"
    lines = str(result).split("\n")
    # a statement has its own tables (tests/util/test_statement.py)
    assert len(lines) <= (30 if result._statement() else 16)
    assert "e-05" not in first and "e-06" not in first
    assert (
        isinstance(result, Plottable)
        and result.summary()
        and result._repr_html_().startswith("<div>")
    )
    figure = result.plot(tmp_path / "picture.svg")
    assert isinstance(figure, Figure) and figure.axes and (tmp_path / "picture.svg").stat().st_size
    assert not plt.get_fignums(), "a saved figure is closed"
    result.to_csv(tmp_path / "table.csv")
    rows = [
        row for row in csv.reader((tmp_path / "table.csv").open()) if not row[0].startswith("#")
    ]
    assert len(rows) > 1 and len(rows[0]) == len(rows[1])
    result.save(tmp_path / "result.h5")
    again = bd.load(tmp_path / "result.h5")
    assert type(again) is type(result) and again.summary() == result.summary()
    assert {f.name for f in fields(again)} == {f.name for f in fields(result)}
