"""Pictures: they are written, their legends and labels say what is drawn, nothing lies on anything else."""

from dataclasses import dataclass, replace
from itertools import combinations

import matplotlib

from tests.every_result import result as made
from tests.plain import plain_study

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.text import Text
from matplotlib.transforms import Bbox
from scipy.spatial import cKDTree

import bdamper as bd
from bdamper.analyses.accuracy import AccuracyCost, Forecast, ReferenceError, Run
from bdamper.analyses.effect_significance import EffectRow, EffectSignificance
from bdamper.analyses.robust_optimum import OptimalCurveUncertainty
from bdamper.harmonic_balance.effects import ASSUMED, Effects
from bdamper.importers import BuiltModel, Measurement
from bdamper.plot import draw_table, plot_accuracy, plot_curves, plot_surfaces
from bdamper.plot.axes import drawing, limit_line
from bdamper.plot.bodies import faces_between
from bdamper.plot.contact import plot_faces
from bdamper.plot.motion import VIEW
from bdamper.response.verification import Convergence, HarmonicPeak, TimeResponse
from bdamper.util.formatting import amount
from bdamper.util.tables import Newtons, Numbers, Tabular

INTERVAL = (270.0, 380.0)


@pytest.fixture(scope="module")
def study():
    model = bd.reference_model("bladed_disk", contact_points=9)
    return plain_study(model, bd.Excitation("tip"), engine_order=5, friction_coefficient=0.4)


@pytest.fixture(autouse=True)
def closed():
    yield
    plt.close("all")


def legend_texts(ax):
    return [text.get_text() for text in ax.get_legend().get_texts()]


def drawn_ticks(axis):
    """Tick labels of an axis that are drawn, major and minor."""
    low, high = sorted(axis.get_view_interval())
    ticks = [*axis.get_major_ticks(), *axis.get_minor_ticks()]
    return [
        t.label1
        for t in ticks
        if low <= t.get_loc() <= high and t.label1.get_visible() and t.label1.get_text()
    ]


def assert_nothing_overlaps(ax):
    """Tick labels and labels of the axes of a picture, all of them inside of it."""
    ax.figure.canvas.draw()
    axes = [ax.xaxis, ax.yaxis]
    texts = [text for axis in axes for text in [*drawn_ticks(axis), axis.label] if text.get_text()]
    boxes = [text.get_window_extent() for text in texts]
    for i, box in enumerate(boxes):
        assert ax.figure.bbox.x0 <= box.x0 and box.x1 <= ax.figure.bbox.x1, texts[i]
        assert ax.figure.bbox.y0 <= box.y0 and box.y1 <= ax.figure.bbox.y1, texts[i]
        for j in range(i):
            assert not box.overlaps(boxes[j]), (texts[i].get_text(), texts[j].get_text())


def test_bad_requests_are_named():
    model = bd.reference_model("bladed_disk", 24)
    with pytest.raises(
        bd.SettingError, match=r"mode: expected a whole number from 1 to 10, found 11"
    ):
        model.plot_mode(11)
    with pytest.raises(bd.SettingError, match="expected a body with mode shapes"):
        model.plot_mode(1, body="damper")


class TestCurves:
    def test_highest_at_the_end_has_an_open_marker_and_a_legend(self, study):
        (ax,) = study.frequency_response(2000.0, (360.0, 380.0)).plot().axes
        assert "highest computed point" in legend_texts(ax)
        top = next(line for line in ax.lines if line.get_markersize() == 5.0)
        assert top.get_markerfacecolor() == "w"

    @pytest.mark.slow
    @pytest.mark.parametrize(
        ("unit", "factor"), [("mm", 1e-3), ("m", 1.0), ("", 1.0), ("µm", 1e-6), ("inch", 0.0254)]
    )
    def test_measured_points_are_in_the_legend_and_in_metres(self, study, unit, factor):
        (ax,) = study.free(INTERVAL).plot().axes
        Measurement("shaker", np.array([280.0, 290.0]), np.array([1.0, 2.0j]), unit=unit).plot(
            ax=ax
        )
        assert legend_texts(ax) == ["shaker"] and [text.get_text() for text in ax.texts] == ["free"]
        assert np.allclose(ax.lines[-1].get_ydata(), [factor, 2.0 * factor], rtol=1e-15)

    def test_measured_points_in_other_units_are_refused(self):
        """Accelerations are drawn as displacements."""
        measurement = Measurement("shaker", np.array([280.0]), np.array([1.0]), unit="V")
        with pytest.raises(
            bd.SettingError,
            match=r"shaker.*expected a displacement, velocity, acceleration or strain",
        ):
            measurement.plot()
        assert measurement.plot(scale=0.5).axes[0].lines[-1].get_ydata() == [0.5]
        shown = replace(measurement, unit="m/s2").plot().axes[0].lines[-1].get_ydata()
        assert shown == pytest.approx([1.0 / (2.0 * np.pi * 280.0) ** 2], rel=1e-12)


class TestOptimalCurves:
    @pytest.mark.slow
    def test_end_of_the_range(self, study):
        ax, _ = study.optimal_curve((3e3, 2e4), 3, frequency=INTERVAL, check=False).plot().axes
        texts = [" ".join(text.get_text().split()) for text in ax.texts]
        assert any(text.startswith("lowest at the end of the range: 3 kN,") for text in texts)

    def test_flat(self, study):
        curve = study.replace(friction_law="bonded").optimal_curve(
            (20.0, 1e4), 3, frequency=INTERVAL, check=False
        )
        ax, below = curve.plot().axes
        assert "The preload does not matter" in " ".join(text.get_text() for text in ax.texts)
        assert ax.get_legend() is None and below.get_legend() is None


def test_advice_legend_shows_what_is_drawn():
    effects = tuple(
        EffectRow(name, True, change, 0.5 * change, 0.0, "computed", 0.5, significant)
        for name, change, significant in (
            ("harmonics beyond 1", 0.5, True),
            ("damper modes beyond 0", 0.001, False),
        )
    )
    sets = [Effects(ASSUMED | {"variable_normal_load": True})] * 2
    ax = (
        EffectSignificance(500.0, (300.0, 400.0), 0.01, 1e-4, 350.0, effects, *sets, 0.0, 0.0, 1.0)
        .plot()
        .axes[0]
    )
    patches = dict(zip(legend_texts(ax), ax.get_legend().get_patches()))
    said = ["black names: needed", "grey: may be left\nout together"]
    assert list(patches) == ["amplitude", "frequency", "tolerance, 1 %", *said]
    bars = [bar for container in ax.containers for bar in container]
    assert [name.get_color() for name in ax.get_yticklabels()] == ["0.55", "k"]  # from the bottom
    assert {bars[0].get_facecolor(), bars[2].get_facecolor()} == {
        patches["amplitude"].get_facecolor(), patches["frequency"].get_facecolor()
    }  # fmt: skip
    assert_nothing_overlaps(ax)


def test_effects_needed_beside_others_have_a_mark_and_wide_axes_few_ticks():
    """An effect within the tolerance is not called needed without a word."""
    effects = tuple(
        EffectRow(name, True, change, 0.5 * change, 0.0, "computed", 0.5, True)
        for name, change in (("separation", 40.0), ("bias", -40.0), ("harmonics beyond 1", 0.001))
    )
    sets = [Effects(ASSUMED | {"variable_normal_load": True})] * 2
    figure = EffectSignificance(
        500.0, (300.0, 400.0), 0.01, 1e-4, 350.0, effects, *sets, 0.0, 0.0, 1.0
    ).plot()
    (ax,) = figure.axes
    names = [name.get_text() for name in ax.get_yticklabels()]
    assert names == ["harmonics beyond 1 *", "bias", "separation"]
    assert "*: small alone, needed\nbeside other effects" in legend_texts(ax)
    low, high = ax.get_xlim()
    ticks = ax.get_xticks()
    assert low <= ticks[0] <= -1000.0 and 1000.0 <= ticks[-1] <= high
    assert_nothing_overlaps(ax)


def test_a_fit_has_one_entry_for_each_test():
    """The common part of the names stands once, beside what lines and marks are."""
    fitted = made("fit")
    n_tests = len(fitted.tests)
    names = tuple(f"beam, level {k}" for k in range(n_tests))
    figure = replace(fitted, tests=names).plot()
    said = legend_texts(figure.axes[1])
    assert len(said) == n_tests + 2
    if n_tests > 1:
        assert "beam: lines: model, marks: measured" in said and "level 0" in said
    else:
        assert "lines: model, marks: measured" in said


def test_few_draws_are_lines_and_many_have_bands():
    draws = np.linspace(1.0, 2.0, 24)[:, None] * np.array([[1e-4, 2e-4, 3e-4]])
    few = OptimalCurveUncertainty(
        preload=np.array([1.0, 2.0, 3.0]), amplitude=draws[:3], frequency=1e6 * draws[:3], samples={},
        status=("complete",) * 3, settings={}, model_hash="",
    )  # fmt: skip
    (ax,) = few.plot().axes
    assert legend_texts(ax) == ["single draws", "median"] and not ax.collections
    many = replace(few, amplitude=draws, frequency=1e6 * draws, status=("complete",) * 24)
    (ax,) = many.plot().axes
    assert legend_texts(ax) == ["5 to 95 %", "25 to 75 %", "median"]


def test_sweeps_have_units(study):
    points = {"preload": [2000.0, 4000.0], "friction_coefficient": [0.3, 0.4]}
    result = bd.sweep(study, points, frequency=INTERVAL)
    (ax,) = result.plot().axes
    assert ax.get_xlabel() == "Friction coefficient"
    assert ax.get_ylabel() == "Resonance amplitude (µm)"
    assert legend_texts(ax) == ["preload 2 kN", "preload 4 kN"]
    assert result.plot(quantity="frequency").axes[0].get_ylabel() == "Resonance frequency (Hz)"
    assert_nothing_overlaps(ax)


@pytest.mark.slow
@pytest.mark.parametrize("times", [(0.025, 0.06), (0.0011, 0.009), (0.03, 3.0)])
def test_accuracy_explains_its_lines(times):
    t = np.geomspace(*times, 4)
    runs = (
        Run("most detailed", ("5", "24"), 1e-3, 300.0, 0.0, t[3]),
        Run("harmonics", ("3", "24"), 1e-3, 300.0, 2e-3, t[2]),
        Run("harmonics", ("1", "24"), 1e-3, 300.0, 0.2, t[1]),
        Run("contact_points", ("5", "9"), np.nan, np.nan, np.nan, t[1]),
        Run("combination", ("3", "9"), 1e-3, 300.0, 0.0, t[0]),
    )
    sources = (ReferenceError("harmonics", 1e-3, 3.0, "10 harmonics"),)
    result = AccuracyCost(
        "curve", 500.0, INTERVAL, 0.01, ("harmonics", "contact_points"), runs, {}, sources=sources
    )
    assert plot_accuracy(result, title="own").get_title() == "own"
    ax = plot_accuracy(result)
    assert legend_texts(ax) == [
        "reference", "harmonics alone, reference 5", "contact points alone, reference 24", "combination",
        "fastest within 1 %:\nharmonics 3\ncontact points 9", "tolerance, 1 %",
    ]  # fmt: skip
    said = [text.get_text().replace("\n", " ") for text in ax.texts]
    assert said == ["3 harmonics", "1 harmonic", "9 contact points"]
    assert_nothing_overlaps(ax)
    frame = ax.figure.bbox
    for item in (ax.get_legend(), *ax.texts):
        box = item.get_window_extent()
        assert (
            frame.x0 <= box.x0 and box.x1 <= frame.x1 and frame.y0 <= box.y0 and box.y1 <= frame.y1
        ), item
    assert len(drawn_ticks(ax.xaxis)) >= 2


def test_accuracy_that_was_not_reached_shows_what_would():
    """Reference at its own error, and the forecast to the right of it."""
    runs = (
        Run("most detailed", ("5",), 1e-3, 300.0, 0.0, 2.0),
        Run("harmonics", ("3",), 1e-3, 300.0, 0.02, 0.5),
    )
    sources = (ReferenceError("harmonics", 0.06, 10.0, "10 harmonics"),)
    forecast = Forecast("10 harmonics", 0.03, 10.0)
    result = AccuracyCost(
        "curve", 500.0, INTERVAL, 0.05, ("harmonics",), runs, {}, sources=sources, forecast=forecast
    )
    ax = plot_accuracy(result)
    assert legend_texts(ax) == [
        "reference", "harmonics alone, reference 5", "forecast:\n10 harmonics", "tolerance, 5 %",
    ]  # fmt: skip
    drawn = np.array([line.get_xydata()[0] for line in ax.lines if len(line.get_xdata()) == 1])
    assert drawn == pytest.approx(np.array([(2.0, 6.0), (0.5, 8.12), (10.0, 3.0)]))
    assert ax.get_title().endswith("5 % not reached")
    assert_nothing_overlaps(ax)


def test_names_of_near_runs_lie_on_no_other_run():
    """Samples per period on the difficult disk; the ring around the fastest run reaches its neighbour."""
    ladder = (
        (32, 6.0e-6, 3.21e-3), (64, 9.5e-6, 3.37e-3), (128, 3.6e-6, 3.45e-3), (256, 9.9e-7, 3.78e-3),
        (512, 1.7e-7, 4.57e-3), (2048, 7.4e-9, 10.7e-3),
    )  # fmt: skip
    runs = (
        Run("most detailed", ("exact",), 1e-3, 300.0, 0.0, 3.96e-3),
        *(Run("evaluation", (f"{n} samples",), 1e-3, 300.0, e, t) for n, e, t in ladder),
    )
    result = AccuracyCost("samples", 2000.0, INTERVAL, 0.01, ("evaluation",), runs)
    ax = plot_accuracy(result)
    ax.figure.canvas.draw()
    names = {text.get_text(): Text.get_window_extent(text) for text in ax.texts}
    assert list(names) == [str(n) for n, *_ in ladder]
    assert not any(a.overlaps(b) for a, b in combinations(names.values(), 2))
    for line in ax.lines:
        if len(line.get_xdata()) == 1:
            place = line.get_transform().transform(line.get_xydata())[0]
            radius = 0.5 * line.get_markersize() * ax.figure.dpi / 72.0
            mark = Bbox([place - 0.7 * radius, place + 0.7 * radius])
            assert not any(mark.overlaps(box) for box in names.values())


class TestSurfaces:
    @pytest.mark.slow
    @pytest.mark.parametrize("name", ["bladed_disk", "blade_to_ground", "test_rig"])
    def test_models_have_a_scale_and_directions(self, name):
        ax = bd.reference_model(name).plot().axes[0]
        texts = {text.get_text(): text for text in ax.texts}
        assert {"X", "Y", "Z"} < set(texts)
        (length,) = (float(text.removesuffix(" mm")) for text in texts if text.endswith(" mm"))
        bar = next(line for line in ax.lines if line.get_linestyle() == "-")
        assert np.ptp(bar.get_xdata()) == pytest.approx(length)

    def test_a_damper_lies_over_its_blades(self):
        """All of its faces are seen, although they lie between two platforms."""
        blades, dampers = bd.reference_model("turbine_blade").plot().axes[0].collections
        red, _, blue, _ = dampers.get_facecolor().T
        assert np.ptp(red / blue) < 1e-9 and red.min() > 1.7 * blue.min(), "sand, lighter or darker"
        model = bd.reference_model("turbine_blade")
        assert (
            len(dampers.get_paths()) == len(model.meshes["damper"].quads) < len(blades.get_paths())
        )

    def test_nearer_faces_are_painted_later(self):
        quads, square = (
            np.arange(4)[None],
            np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float),
        )
        near = square + 0.1 * VIEW[2]
        for order in (
            [(near, quads, "#ff0000"), (square, quads, "#0000ff")],
            [(square, quads, "#0000ff"), (near, quads, "#ff0000")],
        ):
            (faces,) = plot_surfaces(order).collections
            assert (faces.get_facecolor()[:, 0] > 0.0).tolist() == [False, True]

    def test_import_report(self):
        model = bd.reference_model(contact_points=9)
        figure = BuiltModel(model).plot()
        names = [text.get_text() for text in figure.legends[0].get_texts()]
        contacts = [f"contact {name}" for name in model.interfaces]
        assert names == ["blade", "damper", "stress blade", *contacts]
        assert all(len(ax.collections) == 2 for ax in figure.axes)
        plt.close(figure)

    def test_clamp_sector_faces_and_stress_of_an_import(self):
        """Only the face with all of its corners in the set is coloured."""
        model = bd.reference_model(contact_points=9)
        mesh = model.meshes["blade"]
        face = mesh.points[mesh.quads[7]]
        built = BuiltModel(model, node_sets={"clamp": face, "sector faces": face})
        assert np.flatnonzero(faces_between(mesh, face)).tolist() == [7]
        figure = built.plot()
        names = [text.get_text() for text in figure.legends[0].get_texts()]
        assert {"sector faces", "clamp", "stress blade"} <= set(names)
        plt.close(figure)

    def test_a_body_is_seen_between_its_contact_points(self):
        """Marks of many points are smaller than their distance on the page."""
        figure = bd.reference_model("test_rig").plot()
        enlarged = figure.axes[-1]
        shares = []
        for line in enlarged.lines:
            places = enlarged.transData.transform(line.get_xydata())
            if len(places) == 24:
                distance, _ = cKDTree(places).query(places, k=2)
                size = line.get_markersize() * figure.dpi / 72.0
                shares.append(size / np.median(distance[:, 1]))
        # the others are seen from the side
        assert sorted(shares)[1] < 0.75
        plt.close(figure)


@dataclass(frozen=True)
class Table(Tabular):
    """Two branches, the second one a single point, and a value that is alone between two that are not known."""

    force: Newtons
    damping_ratio: Numbers
    branch: Numbers


class TestTables:
    def table(self, ratio):
        return Table(
            np.array([1.0, 2.0, 3.0, 4.0, 9.0]), np.array(ratio), np.array([0, 0, 0, 0, 1])
        )

    def test_no_line_leads_to_another_branch_and_single_points_are_seen(self):
        with drawing() as ax:
            draw_table(
                ax, self.table([0.1, np.nan, 0.3, np.nan, 0.5]), "force", "damping_ratio", marker=""
            )
        line, alone = ax.lines
        assert np.array_equal(line.get_xdata(), [1.0, 2.0, 3.0, 4.0, np.nan, 9.0], equal_nan=True)
        assert (
            alone.get_xydata().tolist() == [[1.0, 10.0], [3.0, 30.0], [9.0, 50.0]]
            and alone.get_marker() == "."
        )

    def test_labels_units_and_scales_are_those_of_the_types(self):
        table = self.table([0.1, 0.2, 0.3, 0.4, 0.5])
        with drawing() as ax:
            draw_table(ax, table, "force", "damping_ratio", rows=table.branch == 0)
        assert (ax.get_xlabel(), ax.get_ylabel()) == ("Force (N)", "Damping ratio (%)")
        assert (ax.get_xscale(), ax.get_yscale()) == ("log", "linear") and len(ax.lines) == 1
        assert ax.lines[0].get_ydata() == pytest.approx([10.0, 20.0, 30.0, 40.0])
        with drawing() as ax:
            ax.set_xlabel("Load (N)")
            draw_table(ax, replace(table, force=table.force + 10.0), "force", "damping_ratio")
        assert ax.get_xlabel() == "Load (N)" and ax.get_xscale() == "linear"


def test_a_picture_that_fails_leaves_no_figure(study):
    with pytest.raises(bd.SettingError, match="labels"):
        plot_curves([study.free(INTERVAL)], labels=["one"])
    assert not plt.get_fignums()


def test_values_that_differ_by_rounding_have_one_colour():
    points = np.array([[x, y, 0.0] for x in (0.0, 1.0) for y in (0.0, 1.0)])
    places = [("left", points, np.tile(np.eye(3), (4, 1, 1)))]
    (ax,) = plot_faces(places, [1.0 + 2e-16 * np.arange(4)], "Use")
    ax.figure.draw_without_rendering()
    assert len(np.unique(ax.collections[0].get_facecolor(), axis=0)) == 1


class TestStyle:
    """One style for all pictures: units that fit, legends beside, one meaning for each line style."""

    def test_is_a_sheet_of_matplotlib(self):
        with plt.style.context("bdamper.plot.style"):
            assert (
                plt.rcParams["axes.formatter.useoffset"] is False
                and plt.rcParams["legend.frameon"] is False
            )

    @pytest.mark.parametrize(
        ("top", "label", "last"),
        [(2.5e-4, "Height (µm)", "250"), (3e-3, "Height (mm)", "3"), (40.0, "Height (m)", "40")],
    )
    def test_numbers_are_in_the_unit_that_fits(self, top, label, last):
        with drawing() as ax:
            ax.plot([0.0, 1.0], [0.0, top])
            ax.set(ylabel="Height (m)", ylim=(0.0, top), yticks=[0.0, top])
        assert ax.get_ylabel() == label and ax.lines[0].get_ydata()[1] == top, (
            "what is drawn stays in metres"
        )
        ax.figure.draw_without_rendering()
        assert [t.get_text() for t in ax.get_yticklabels()][-1] == last
        with drawing(ax):  # once more, beside something larger
            ax.set_ylim(0.0, 1e3 * top)
        assert ax.get_ylabel() == f"Height ({amount(500.0 * top, 'm').split()[1]})"

    def test_logarithmic_axes_have_plain_numbers(self):
        with drawing() as ax:
            ax.plot([90.0, 900.0], [2e-5, 9e-4])
            ax.set(xscale="log", yscale="log", xlabel="Preload (N)", ylabel="Amplitude (m)")
        ax.figure.draw_without_rendering()
        shown = [t.get_text() for t in ax.get_yticklabels()]
        assert {"20", "50", "100", "200", "500"} <= set(
            shown
        ) and ax.get_ylabel() == "Amplitude (µm)"
        assert {"100", "200", "500"} <= {t.get_text() for t in ax.get_xticklabels()}

    @pytest.mark.slow
    def test_legends_lie_beside_what_is_drawn(self, study):
        curves = [study.frequency_response(load, (330.0, 365.0)) for load in (500.0, 2000.0)]
        ax = plot_curves([study.free(INTERVAL), *curves])
        ax.figure.draw_without_rendering()
        assert not ax.get_legend().get_window_extent().overlaps(ax.bbox)
        assert legend_texts(ax)[:2] == ["preload 500 N", "preload 2 kN"]
        upper, lower, _ = study.dissipation(curves[0]).plot().axes
        assert upper.get_ylabel() == "Equivalent contact\nstiffness (kN/m)"
        assert lower.get_ylabel() == "Equivalent damping\nratio (%)"

    @pytest.mark.slow
    def test_many_preloads_have_a_colour_bar(self, study):
        ax = plot_curves(
            [
                study.frequency_response(load, (345.0, 360.0))
                for load in (1e3, 2e3, 3e3, 4e3, 6e3, 8e3)
            ]
        )
        assert len(ax.figure.axes) == 2 and ax.figure.axes[1].get_ylabel() == "Preload (kN)"
        assert not any(
            "N" in text for text in ([] if ax.get_legend() is None else legend_texts(ax))
        )

    @pytest.mark.slow
    def test_optimum_and_its_range_are_marked(self, study):
        curve = study.optimal_curve((200.0, 5e3), 6, frequency=INTERVAL, check=False)
        curve = replace(curve, model_doubts=())
        amplitude, shift = curve.plot().axes
        (star,) = (line for line in amplitude.lines if line.get_marker() == "*")
        assert star.get_xydata().tolist() == [[curve.optimum.preload, curve.optimum.amplitude]]
        assert (
            f"optimum: {amount(curve.optimum.preload, 'N')}, {amount(curve.optimum.amplitude, 'm')}"
            in [text.get_text() for text in amplitude.texts]
        )
        assert "within 20 % of the optimum (harmonic balance)" in legend_texts(shift)
        assert shift.get_ylabel() == "Frequency\nshift (%)"
        drawn = np.concatenate(
            [line.get_xdata() for line in amplitude.lines if line.get_linestyle() == "-"]
        )
        assert curve.optimum.preload in drawn, "the line goes through the optimum"
        only = curve.plot(ax=plt.figure().add_subplot()).axes[0]
        assert only.get_ylabel() == "Tip amplitude (µm)"


def test_marks_at_an_optimum_are_explained_and_visible(study):
    """Time integration lies over the star, and more harmonics are named with their numbers."""
    curve = study.optimal_curve((200.0, 5e3), 6, frequency=INTERVAL, check=False)
    best = curve.optimum
    top = best.amplitude
    in_time = TimeResponse(
        0.98 * top, 0.97 * top, 0.99 * top, best.frequency, best.preload, top, periods=9
    )
    peaks = tuple(HarmonicPeak(n, a * top, best.frequency, 1.0) for n, a in ((3, 1.0), (5, 0.9)))
    convergence = Convergence(best.preload, 0.05, peaks)
    higher = replace(in_time, preload=1.35 * best.preload, mean=1.1 * top, highest=1.2 * top)
    shown = replace(curve, time_response=(in_time, higher), convergence=convergence)
    ax, shift = shown.plot().axes
    assert {
        "harmonic balance",
        "lowest by time integration",
        "time integration, highest blade: mean, range",
        "range with 3 to 5 harmonics",
    } <= set(legend_texts(shift))
    (star,) = (line for line in ax.lines if line.get_marker() == "*")
    (lowest,) = (line for line in ax.lines if line.get_label() == "lowest by time integration")
    assert lowest.get_zorder() > star.get_zorder()
    assert lowest.get_markersize() < 0.5 * star.get_markersize()


def test_a_limit_bears_its_name_within_the_axes_at_a_known_point():
    with drawing() as ax:
        limit_line(ax, "stuck", [], [], 1.0)
        limit_line(ax, "stuck", [1.0, 2.0], [np.nan, np.nan], 1.0)
        limit_line(ax, "tuned wheel", [1.0, 2.0, 3.0], [1.0, 2.0, np.nan], 3.0)
        limit_line(ax, "the whole wheel, tuned", [1.0, 2.0, 3.0], [1.0, 2.0, 3.0], 3.0)
    assert [text.xy for text in ax.texts] == [(2.0, 2.0), (3.0, 3.0)]
    ax.figure.canvas.draw()
    assert all(text.get_window_extent().x1 <= ax.bbox.x1 for text in ax.texts)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["bladed_disk", "paper_disk", "turbine_blade", "blade_to_ground"])
def test_numbers_of_the_pressure_of_a_shipped_model_do_not_touch(name):
    """The turbine blade has faces three times as long as high."""
    # nothing presses this blade but the contacts of its model
    alone = name == "blade_to_ground"
    order, preload = (0, 0.0) if alone else (5, 200.0)
    study = plain_study(
        bd.reference_model(name), bd.Excitation("tip"), order, friction_coefficient=0.3
    )
    figure = study.static(preload).plot()
    figure.canvas.draw()
    for ax in figure.axes:
        for axis in (ax.xaxis, ax.yaxis):
            boxes = [label.get_window_extent() for label in drawn_ticks(axis)]
            for one, other in zip(boxes, boxes[1:]):
                assert not one.overlaps(other), (ax.get_title(), axis.axis_name)
    plt.close("all")


def test_a_sweep_with_a_shroud_draws_force_slip_first_slip_and_amplitudes(study):
    """Each panel has the numbers of its columns, and a missing peak is a cross."""

    def row(_, preload):
        lost = preload > 40.0
        return {
            "amplitude": np.nan if lost else 1e-6 * preload,
            "shroud_force": 2.0 * preload,
            "static_slip": 1e-5 * preload,
            "first_slip": 0.01 * preload,
            "locked_amplitude": 1e-7 * preload,
        }

    loads = [10.0, 20.0, 50.0]
    swept = bd.sweep(study, {"preload": loads}, row)
    at_rest, first_slip, amplitudes, slip_axis = swept.plot().axes
    drawn = {
        "shroud_force": at_rest.lines[0],
        "static_slip": slip_axis.lines[0],
        "first_slip": first_slip.lines[0],
        "amplitude": amplitudes.lines[0],
        "locked_amplitude": amplitudes.lines[1],
    }
    for name, line in drawn.items():
        np.testing.assert_array_equal(line.get_ydata(), swept.array(name))
        np.testing.assert_array_equal(line.get_xdata(), loads)
    assert [line.get_xdata().tolist() for line in amplitudes.lines[2:]] == [[50.0]]
    assert "µm" in slip_axis.get_ylabel() and amplitudes.get_xlabel() == "Preload (N)"
    (single,) = swept.plot(quantity="first_slip").axes
    np.testing.assert_array_equal(single.lines[0].get_ydata(), swept.array("first_slip"))
    sticks = bd.sweep(study, {"preload": loads}, lambda _, p: row(_, p) | {"static_slip": 0.0})
    assert len(sticks.plot().axes) == 3, "without slip there is no axis of slip"
