"""Pictures and reports of shipped models, and pictures that a result cannot have.

No text lies on another one or outside of its figure.
"""

from dataclasses import replace
from itertools import combinations
from types import SimpleNamespace

import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.axis import Axis
from matplotlib.text import Text

import bdamper as bd
from bdamper.plot.axes import drawing
from bdamper.plot.bodies import plot_model
from bdamper.plot.contact import face_coordinates, plot_faces
from bdamper.plot.report import _band_around_peaks
from bdamper.response.linear_limits import peak_interval
from bdamper.response.optimal_curve_result import OptimalCurve
from bdamper.util.display import _DRAWINGS, _load_pictures, draw
from tests.every_result import result as made
from tests.plain import plain_study
from tests.plot.test_pictures import drawn_ticks

NIGHTLY = pytest.mark.nightly
MODELS = {
    # engine order, preload (N), further settings
    "turbine_blade": (5, 200.0, {}),
    "blade_to_ground": (0, 0.0, {}),
    "bladed_disk": (5, 200.0, {}),
    "paper_disk": (5, 200.0, {}),
    "test_rig": (1, 200.0, {}),
    "shrouded_blade": (4, 200.0, {"load_per_preload": {"front": 1.0, "rear": 1.0}}),
}
QUICK = ("turbine_blade", "blade_to_ground")
NOT_A_PICTURE = {"report", "mark", "figure", "image", "dissipation", "energy", "history", "loops"}
"""Pictures that need arguments, or are drawn by "plot" as well."""


def results(study, preload):
    """Results of the kinds that take little time."""
    band = peak_interval(study.problem.at(preload), None)
    curve = study.frequency_response(preload, band)
    yield study.model
    yield curve
    yield study.static(preload)
    yield study.hysteresis(curve)
    yield study.dissipation(curve)
    peak = study.peak(preload, band)
    if peak.ok:
        yield peak
        yield study.harmonic_convergence(peak, harmonics=(1,))
    if study.problem.carries_load:
        # other resonances may be higher
        wide = band[0], 1.6 * band[1]
        preloads = 0.5 * preload, 2.0 * preload
        yield study.optimal_curve(preloads, 3, frequency=wide, check=False)
    # own loads are not those of a rotor speed
    if (
        study.settings.engine_order
        and not study.settings.load_per_preload
        and study.model.n_blades > 1
    ):
        yield study.campbell((100.0, 1000.0), [study.settings.engine_order])


def pictures_of(shown):
    """Names of all pictures that are registered for the type of a result or a base class."""
    return sorted({name for kind, name in _DRAWINGS if isinstance(shown, kind)} - NOT_A_PICTURE)


def drawn_texts(figure):
    """Texts of a figure, without the labels of ticks beyond its axes."""
    hidden = set()
    for axis in figure.findobj(Axis):
        is_drawn = axis.get_visible() and axis.axes.get_visible() and axis.axes.axison
        shown = drawn_ticks(axis) if is_drawn else []
        for tick in [*axis.get_major_ticks(), *axis.get_minor_ticks()]:
            hidden |= {label for label in (tick.label1, tick.label2) if label not in shown}
        if not is_drawn:
            hidden |= {axis.label, axis.get_offset_text()}
    return [
        text
        for text in figure.findobj(Text)
        if text.get_text().strip() and text.get_visible() and text not in hidden
    ]


def misplaced(figure):
    """Texts outside of a figure, and pairs of texts of which one lies on the other by more than a pixel."""
    figure.canvas.draw()
    frame = figure.bbox.padded(1.0)
    # an arrow does not belong to the text of an annotation
    boxes = {text: Text.get_window_extent(text) for text in drawn_texts(figure)}
    outside = [
        text.get_text()
        for text, box in boxes.items()
        if not (frame.x0 <= box.x0 and box.x1 <= frame.x1)
        or not (frame.y0 <= box.y0 and box.y1 <= frame.y1)
    ]
    on_another = [
        (one.get_text(), other.get_text())
        for one, other in combinations(boxes, 2)
        if boxes[one].padded(-0.5).overlaps(boxes[other].padded(-0.5))
    ]
    return [*outside, *on_another]


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=() if name in QUICK else NIGHTLY) for name in MODELS]
)
def test_every_picture_of_a_shipped_model(tmp_path, name):
    _load_pictures()
    order, preload, more = MODELS[name]
    model = bd.reference_model(name)
    place = "tip" if "tip" in model.locations else "tip_trailing_edge"
    study = plain_study(model, bd.Excitation(place), order, friction_coefficient=0.3, **more)
    faults = {}
    for shown in results(study, preload):
        pictures = pictures_of(shown)
        assert "plot" in pictures
        for picture in pictures:
            arguments = [study.problem] if picture == "plot_contacts" else []
            assert draw(shown, picture, *arguments) is not None
            for number in plt.get_fignums():
                found = misplaced(plt.figure(number))
                if found:
                    faults[type(shown).__name__, picture] = found
            plt.close("all")
        if isinstance(shown, OptimalCurve) and shown.optimum.preload > 0.0:
            page = shown.report(tmp_path / "review.html", study)
            assert page.read_text().count("<img") >= 3
    assert not faults


def test_misplaced_texts_are_found():
    figure, ax = plt.subplots()
    assert misplaced(figure) == []
    ax.text(0.5, 0.5, "one")
    ax.text(0.51, 0.5, "other")
    ax.text(0.99, 0.8, "far outside of the figure")
    assert misplaced(figure) == ["far outside of the figure", ("one", "other")]
    plt.close(figure)


def test_long_titles_are_broken_until_they_fit():
    """Wide letters make lines longer than their number of letters lets expect."""
    with drawing(title="WWW and MMM " * 8) as ax:
        ax.figure.suptitle("always open: " + ", ".join(f"face_{k}" for k in range(20)))
    lines = ax.get_title().split("\n")
    assert len(lines) > 2
    assert misplaced(ax.figure) == []
    plt.close(ax.figure)


def test_a_face_of_one_row_and_a_long_face():
    """Numbers beside a strip that is true to scale would lie on each other."""
    row = np.array([(0.0, 0.3, 0.01 * k) for k in range(8)])
    frame = np.array([[(0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (1.0, 0.0, 0.0)]] * 16)
    strip = np.concatenate([row, row + [0.0, 1e-3, 0.0]])
    *_, dx, dy = face_coordinates(row, frame[0])
    assert dx == dy == pytest.approx(10.0)
    for points in (row, strip):
        axes = plot_faces([("face", points, frame[: len(points)])], [np.ones(len(points))], "N")
        assert misplaced(axes[0].figure) == []
        height = axes[0].get_window_extent().height
        assert height > 0.2 * axes[0].get_window_extent().width
        plt.close(axes[0].figure)


def test_a_legend_with_long_names_fits():
    model = bd.reference_model("turbine_blade")
    faces = {f"{name}_face_of_a_long_damper": face for name, face in model.interfaces.items()}
    axes = plot_model(replace(model, interfaces=faces))
    assert misplaced(axes.figure) == []
    plt.close(axes.figure)


@pytest.mark.slow
def test_the_report_of_a_shrouded_blade(tmp_path):
    """The stuck frequency is several times the free one."""
    loads = {"load_per_preload": {"front": 1.0, "rear": 1.0}}
    study = bd.Study(
        bd.reference_model("shrouded_blade"), bd.Excitation("tip"), 4, harmonics=1, **loads
    )
    curve = study.optimal_curve((100.0, 400.0), 3, check=False)
    path = curve.report(tmp_path / "review.html", study)
    assert path.read_text().count("<img") >= 3


def test_the_band_of_a_report_is_positive():
    def limit(frequency):
        return SimpleNamespace(frequency=frequency)

    curve = SimpleNamespace(free=limit(230.0), stuck=limit(1220.0), optimum=limit(1100.0))
    low, high = _band_around_peaks(curve)
    assert 0.0 < low < 230.0 and high > 1220.0


def test_the_dissipation_of_one_solution_is_refused():
    with pytest.raises(
        bd.SettingError, match="dissipation: expected a result of several solutions"
    ):
        draw(made("hysteresis"), "dissipation")
