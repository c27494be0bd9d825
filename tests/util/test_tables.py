"""Results as tables, what a notebook shows of them, and what differs between two."""

import csv
import html
import sys
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Annotated

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
import pytest

import bdamper as bd
from bdamper.analyses.sweep import SweepResult
from bdamper.plot.motion import rigid_motion
from bdamper.response.response_curve_result import ResponseCurve
from bdamper.response.verification import HarmonicPeak
from bdamper.util.display import Plottable, register_plot
from bdamper.util.formatting import amount, peak_text
from bdamper.util.records import named_fields
from bdamper.util.tables import (
    ROW,
    Kinds,
    Metres,
    Newtons,
    Numbers,
    Quantity,
    Shares,
    Tabular,
    axis_label,
    columns_of_rows,
    quantities,
)
from tests.plain import plain_study


@pytest.fixture(scope="module")
def study():
    model = bd.reference_model("bladed_disk", 9)
    return plain_study(model, bd.Excitation("tip"), engine_order=5, friction_coefficient=0.4)


@pytest.fixture(scope="module")
def curve(study):
    return study.frequency_response(4000.0, (350.0, 358.0))


@pytest.fixture(scope="module")
def swept():
    mu, preload = np.repeat([0.2, 0.4], 3), np.tile([1.0, 2.0, 3.0], 2)
    points = named_fields({"mu": mu, "preload": preload}, 6)
    values = named_fields(
        {"amplitude": mu * preload, "curve_amplitude": [[m, 0.0] for m in mu.tolist()]}, 6
    )
    return SweepResult(("mu", "preload"), points, values, ("complete",) * 6, np.zeros(6), (2, 3))


class TestTables:
    def test_csv_has_names_units_and_every_digit(self, curve, tmp_path):
        curve.to_csv(tmp_path / "curve.csv")
        lines = (tmp_path / "curve.csv").read_text().splitlines()
        head, *rows = csv.reader(line for line in lines if not line.startswith("#"))
        assert head[:4] == ["frequency (Hz)", "amplitude (m)", "phase (rad)", "peak_to_peak (m)"]
        assert len(rows) == len(curve)
        assert np.array_equal([float(row[1]) for row in rows], curve.amplitude)
        assert f"# model_hash: {curve.model_hash}" in lines and "# preload: 4000.0" in lines

    def test_pandas(self, curve):
        pytest.importorskip("pandas")
        frame = curve.to_pandas()
        assert np.array_equal(frame["amplitude"], curve.amplitude)
        assert frame.attrs["units"]["frequency"] == "Hz" and frame.attrs["preload"] == 4000.0

    def test_xarray(self, curve, swept):
        pytest.importorskip("xarray")
        data = curve.to_xarray()
        assert (
            data["harmonics"].dims == ("point", "harmonic")
            and data["amplitude"].attrs["units"] == "m"
        )
        grid = swept.to_xarray()
        assert float(grid["amplitude"].sel(mu=0.4, preload=3.0)) == pytest.approx(1.2)
        assert grid["curve_amplitude"].shape == (2, 3, 2)

    @pytest.mark.filterwarnings("ignore:You are writing invalid netcdf features")
    def test_complex_values_in_a_file(self, curve, tmp_path):
        xarray = pytest.importorskip("xarray")
        pytest.importorskip("h5netcdf")
        data = curve.to_xarray()
        data.to_netcdf(tmp_path / "curve.nc", engine="h5netcdf", invalid_netcdf=True)
        with xarray.open_dataset(tmp_path / "curve.nc", engine="h5netcdf") as found:
            assert np.array_equal(found["harmonics"], data["harmonics"]) and np.iscomplexobj(
                found["harmonics"]
            )

    def test_a_value_twice_is_no_coordinate(self, swept):
        pytest.importorskip("xarray")
        twice = replace(
            swept,
            points=named_fields({"mu": np.full(6, 0.4), "preload": swept.points["preload"]}, 6),
        )
        with pytest.raises(
            bd.BdamperError,
            match="the values of 'mu' must be distinct, because they become coordinates; found",
        ):
            twice.to_xarray()
        assert len(twice.to_pandas()) == len(swept)

    @pytest.mark.parametrize("module", ["pandas", "xarray"])
    def test_what_is_not_installed_is_named(self, curve, module, monkeypatch):
        monkeypatch.setitem(sys.modules, module, None)
        with pytest.raises(
            bd.BdamperError,
            match=rf"to_{module} needs {module}: install the extra bdamper\[table\]",
        ):
            getattr(curve, f"to_{module}")()

    def test_every_table_has_columns(self):
        own = [cls for cls in Tabular.__subclasses__() if cls.__module__.startswith("bdamper.")]
        assert len(own) > 15 and all(
            cls.columns is not Tabular.columns or quantities(cls) for cls in own
        )


@dataclass(frozen=True)
class Base:
    left_out: np.ndarray
    place: Metres


@dataclass(frozen=True)
class Made(Base, Tabular, row="step"):
    shares: Shares
    words: Kinds
    waves: Annotated[np.ndarray, Quantity("N", dims=(ROW, "harmonic"))]
    judged: Numbers | None = None
    weight: Annotated[np.ndarray, Quantity("kg", "Mass of the disk", name="mass")] = field(
        default_factory=lambda: np.ones(2)
    )

    @property
    def twice(self) -> Metres:
        return 2.0 * self.place

    @cached_property
    def half(self) -> Annotated[np.ndarray, Quantity("mm", label="Half of it")]:
        return 500.0 * self.place

    @property
    def unmarked(self) -> np.ndarray:
        raise AssertionError


@dataclass(frozen=True)
class Gridded(Tabular, row="place"):
    load: Newtons
    height: Metres

    def _grid(self):
        return {"load": self.load, "mode": np.array([1, 2])}


def test_arrays_over_a_grid_are_columns_beside_its_coordinates():
    found = Gridded(np.array([5.0, 6.0, 7.0]), np.arange(6.0).reshape(3, 2))
    columns = found.columns()
    assert (
        list(columns) == ["load", "mode", "height"]
        and columns["load"].unit == "N"
        and columns["height"].unit == "m"
    )
    assert columns["load"].values.tolist() == [5.0, 5.0, 6.0, 6.0, 7.0, 7.0]
    assert columns["mode"].values.tolist() == [1, 2] * 3 and columns[
        "height"
    ].values.tolist() == list(range(6))
    pytest.importorskip("xarray")
    assert float(found.to_xarray()["height"].sel(load=6.0, mode=2)) == 3.0


MADE = Made(
    np.zeros(3), np.array([1.0, 2.0]), np.arange(6.0).reshape(2, 3), ("a", "b"), np.zeros((2, 4))
)


class TestQuantities:
    made = MADE

    def test_columns_follow_from_the_types_of_fields_and_properties(self):
        columns = self.made.columns()
        assert list(columns) == [
            "place",
            "twice",
            "half",
            "stick",
            "slip",
            "open",
            "kind",
            "waves",
            "mass",
        ]
        assert [columns[name].unit for name in ("place", "half", "waves", "mass", "kind")] == [
            "m",
            "mm",
            "N",
            "kg",
            "",
        ]
        assert columns["slip"].values.tolist() == [1.0, 4.0] and columns[
            "twice"
        ].values.tolist() == [2.0, 4.0]
        assert columns["waves"].dims == ("step", "harmonic") and not columns["place"].dims

    def test_what_is_none_is_left_out_and_what_is_there_is_not(self):
        assert replace(self.made, judged=np.array([True, False])).columns()[
            "judged"
        ].values.tolist() == [True, False]

    def test_labels(self):
        assert (
            axis_label(Made, "half") == "Half of it (mm)"
            and axis_label(Made, "weight") == "Mass of the disk (kg)"
        )
        assert axis_label(ResponseCurve, "peak_to_peak") == "Peak to peak (m)"
        assert axis_label(ResponseCurve, "unstable") == "Unstable"
        assert axis_label(Made, "place", "mm") == "Place (mm)"

    def test_rows_of_small_records(self):
        columns = columns_of_rows([HarmonicPeak(3, 2.0, 100.0), HarmonicPeak(5, 2.0, 101.0)])
        assert (
            columns["amplitude"].unit == "m"
            and columns["frequency"].unit == "Hz"
            and columns["harmonics"].unit == ""
        )
        assert columns["harmonics"].values.tolist() == [3, 5] and columns_of_rows([]) == {}


class TestNotebook:
    @pytest.mark.slow
    def test_a_table_with_units_and_a_picture(self, study, curve):
        for shown, line in ((curve, f"{1e6 * curve.peak.amplitude:.3g} µm"), (study, "1 N at tip")):
            page = shown._repr_html_()
            assert (
                "<table>" in page
                and line in page
                and page.count("data:image/png;base64,iVBOR") == 1
            )
        first = f"<div><p><b>{html.escape(curve._headline())}</b></p><table>"
        assert (
            curve._repr_html_().startswith(first)
            and amount(curve.peak.amplitude, "m", 6) in curve._repr_html_()
        ), "folded away"
        assert not plt.get_fignums(), "a notebook would show open figures once more"

    def test_what_is_printed_where_there_are_no_facts(self, swept):
        page = swept._repr_html_()
        assert (
            f"<p><b>{swept._headline()}</b></p><table>" in page
            and f"<pre>{swept.summary()[:10]}" in page
        )
        assert "\nmu   preload (N)  amplitude" in str(swept)
        # rows of the highest value and of the points, then the table with its head
        assert page.count("<tr>") == 2 + 1 + len(swept)

    def test_of_a_long_table_the_ends_are_printed(self):
        text = replace(
            MADE,
            words=tuple("ab" * 20),
            place=np.arange(40.0),
            shares=np.zeros((40, 3)),
            weight=np.ones(40),
        )
        assert (
            text.as_rows()[0] == ("40 steps", "smallest", "largest")
            and ("place (m)", "0", "39") in text.as_rows()
        )

    def test_without_anything_to_draw(self):
        class Empty(Plottable):
            def __str__(self):
                return "a < b"

            def plot(self):
                raise AssertionError

        register_plot(Empty)(lambda shown: (_ for _ in ()).throw(bd.SettingError("nothing")))
        assert Empty()._repr_html_() == "<div><pre>a &lt; b</pre></div>"

    def test_the_peak_of_a_curve_is_called_a_peak(self, study, curve):
        assert str(curve.peak).startswith(
            f"Resonance peak {peak_text(curve.peak.amplitude, curve.peak.frequency)}"
        )
        assert "No peak: incomplete: highest at an end" in str(
            study.frequency_response(2000.0, (360.0, 362.0)).peak
        )


class TestDifferences:
    def test_of_studies(self, study):
        twice = bd.Excitation("tip", amplitude=2.0)
        other = study.replace(friction_coefficient={"left": 0.4, "right": 0.2}, excitation=twice)
        found = study.diff(other)
        assert found.settings == (
            ("friction_coefficient.right", 0.4, 0.2),
            ("excitation.amplitude", 1.0, 2.0),
        )
        assert (
            "friction_coefficient.right  0.4    0.2     -50 %" in str(found)
            and "+100 %" in found._repr_html_()
        )
        again = study._with_problem(study.problem.replace())
        assert not study.diff(again) and str(study.diff(again)).startswith("No difference: ")

    def test_of_curves(self, study, curve):
        other = study.frequency_response(8000.0, (350.0, 358.0))
        found = curve.diff(other)
        assert found.settings == ()
        names = {a.name: (a.value, b.value) for a, b in found.outcomes}
        assert (
            names["peak amplitude"] == (curve.peak.amplitude, other.peak.amplitude)
            and "preload" in names
        )
        assert not curve.diff(curve)

    def test_settings_of_a_study_and_a_result(self, study, curve):
        assert not study.diff(curve)
        assert [name for name, *_ in study.replace(bias=False).diff(curve).settings] == ["bias"]

    def test_with_something_else_is_refused(self, curve):
        with pytest.raises(
            bd.SettingError, match=r"other: expected a study or a result, found 1\.0"
        ):
            curve.diff(1.0)


class TestMistakenArguments:
    """What a user gives in the place of something else is named for what it is."""

    def test_a_list_of_results(self, study, curve):
        with pytest.raises(
            bd.SettingError,
            match=r"curve: expected a response curve, found a list of 1 ResponseCurve$",
        ):
            study.with_stability([curve])
        with pytest.raises(bd.SettingError, match=r"found a tuple of 2 ResponseCurve$"):
            study.with_stability((curve, curve))

    def test_a_result_in_the_place_of_a_model(self, curve, tmp_path):
        with pytest.raises(bd.ModelError, match="model: expected a Model, found ResponseCurve"):
            bd.Study(curve, bd.Excitation("tip"))
        curve.save(tmp_path / "curve.h5")
        with pytest.raises(
            bd.ModelError,
            match=r"expected 'bdamper-model', found 'bdamper-curve': bd\.load reads results",
        ):
            bd.load_model(tmp_path / "curve.h5")

    def test_a_model_in_the_place_of_a_study(self, study):
        with pytest.raises(bd.SettingError, match="study: expected a Study, found a Model"):
            rigid_motion(study.model, np.zeros(3))

    @pytest.mark.parametrize("kind", ["save", "to_csv"])
    def test_a_folder_in_the_place_of_a_file(self, curve, tmp_path, kind):
        with pytest.raises(
            bd.BdamperError, match=r"expected a file that can be written, found a folder$"
        ):
            getattr(curve, kind)(tmp_path)

    def test_a_folder_in_the_place_of_a_results_file(self, study, tmp_path):
        with pytest.raises(
            bd.BdamperError, match=r"expected a file that can be written, found a folder$"
        ):
            bd.sweep(study, {"preload": [4e3]}, bd.PeakTask(), resume=tmp_path)

    def test_a_class_in_the_place_of_a_question(self, study):
        with pytest.raises(
            bd.SettingError, match=r"evaluate: expected PeakTask.* found the class PeakTask"
        ):
            bd.sweep(study, {"preload": [4e3]}, bd.PeakTask)


def test_a_sweep_draws_points_without_a_value(swept):
    assert "x" not in [line.get_marker() for line in swept.plot().axes[0].lines]
    lost = replace(swept, values=swept.values.copy())
    lost.values["amplitude"][0] = np.nan
    ax = lost.plot().axes[0]
    crosses = [line for line in ax.lines if line.get_marker() == "x" and len(line.get_xdata())]
    assert [line.get_xdata().tolist() for line in crosses] == [[1.0]]
    assert "no value" in ax.get_legend_handles_labels()[1]
