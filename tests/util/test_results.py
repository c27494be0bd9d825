"""Every result that a study gives: it prints its bottom line first, has details, draws itself, is saved and is a table."""

import csv
from dataclasses import fields

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.axes import Axes

import bdamper as bd
from bdamper.mistuning import Mistuning
from bdamper.util.display import Plottable
from tests.plain import plain_study

BAND = (330.0, 365.0)


@pytest.fixture(scope="module")
def study():
    model = bd.reference_model("bladed_disk", contact_points=9)
    return plain_study(model, bd.Excitation("tip"), engine_order=5, friction_coefficient=0.4)


@pytest.fixture(scope="module")
def curve(study):
    return study.track(2000.0, BAND)


QUESTIONS = {
    "track": lambda s, c: c,
    "free": lambda s, c: s.free(BAND),
    "peak": lambda s, c: s.peak(2000.0, BAND),
    "optimal_curve": lambda s, c: s.optimal_curve((500.0, 4e3), 4, frequency=BAND, check=False),
    "static": lambda s, c: s.static(500.0),
    "hysteresis": lambda s, c: s.hysteresis(c),
    "dissipation": lambda s, c: s.dissipation(c),
    "verify": lambda s, c: s.verify(c, periods=2, steps_per_period=512),
    "advise": lambda s, c: s.advise(2000.0, BAND),
    "compare": lambda s, c: bd.compare(
        {"now": s, "smooth": {"friction_coefficient": 0.2}}, lambda one: one.track(2000.0, BAND)
    ),
    "sweep": lambda s, c: bd.sweep(s, {"preload": [1e3, 2e3]}, frequency=BAND),
    "uncertain_curve": lambda s, c: bd.uncertain_curve(
        s, {"friction_coefficient": [0.3, 0.4]}, (1e3, 4e3), 2, frequency=BAND
    ),
    "microslip": lambda s, c: bd.microslip(s, 500.0, [20.0, 40.0]),
    "wheel": lambda s, c: bd.Wheel(s, Mistuning.drawn(65, 0.01, seed=1)).mistuning,
}


@pytest.mark.parametrize("name", QUESTIONS)
def test_prints_draws_saves_and_is_a_table(name, study, curve, tmp_path):
    result = QUESTIONS[name](study, curve)
    first = str(result).split("\n")[0]
    assert first[0].isupper() or first[0].isdigit() or name == "wheel", "a sentence comes first"
    assert len(str(result).split("\n")) <= 16 and "e-05" not in first and "e-06" not in first
    assert isinstance(result, Plottable) and result.details() and result._repr_html_().startswith("<div>")
    drawn = np.ravel(np.asarray(result.plot(), object))
    assert all(isinstance(ax, Axes) for ax in drawn)
    plt.close("all")
    result.to_csv(tmp_path / "table.csv")
    rows = [row for row in csv.reader((tmp_path / "table.csv").open()) if not row[0].startswith("#")]
    assert len(rows) > 1 and len(rows[0]) == len(rows[1])
    result.save(tmp_path / "result.h5")
    again = bd.load(tmp_path / "result.h5")
    assert type(again) is type(result) and again.details() == result.details()
    assert {f.name for f in fields(again)} == {f.name for f in fields(result)}
