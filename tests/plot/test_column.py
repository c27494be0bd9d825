"""Every picture at the width of a column: no text lies on another one or is cut, and grey print tells lines apart."""

from dataclasses import replace
from functools import cache
from itertools import combinations

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.text import Text

import bdamper as bd
from bdamper.fatigue.criteria import Material
from bdamper.mistuning import DiskPeak
from bdamper.plot import new_axes, plot_crossings, plot_curves, plot_response_map
from bdamper.plot.axes import COLUMN, Picture, name_point, place_names, wrapped
from bdamper.response.verification import Convergence, HarmonicPeak, TimeResponse
from tests.each import each
from tests.every_result import RESULTS
from tests.every_result import result as of_masses
from tests.fatigue.test_margins import with_stress
from tests.plain import plain_study

N, BAND = 65, (330.0, 365.0)
STEEL = Material(endurance_limit=300e6, ultimate_strength=900e6, yield_strength=800e6)


@cache
def bladed_disk():
    model = with_stress(bd.reference_model("bladed_disk", contact_points=9))
    return plain_study(model, bd.Excitation("tip"), engine_order=5, friction_coefficient=0.4)


def turbine():
    model = bd.reference_model("turbine_blade", contact_points=9)
    return bd.Study(
        model, bd.Excitation("tip", amplitude=10.0), 5, friction_coefficient=0.3, harmonics=1
    )


OF_DISK = {
    "frequency_response": lambda s: s.frequency_response(2000.0, BAND, stability=True),
    "free": lambda s: s.free(BAND),
    "peak": lambda s: s.peak(2000.0, BAND),
    "optimal_curve": lambda s: s.optimal_curve((500.0, 4e3), 4, frequency=BAND, check=False),
    "static": lambda s: s.static(500.0),
    "hysteresis": lambda s: s.hysteresis(made("frequency_response")),
    "dissipation": lambda s: s.dissipation(made("frequency_response")),
    "motion_in_time": lambda s: s.motion_in_time(
        made("frequency_response"), periods=2, steps_per_period=512
    ),
    "effect_significance": lambda s: s.effect_significance(2000.0, BAND),
    "peak_sensitivities": lambda s: s.peak_sensitivities(made("peak")),
    "compare": lambda s: bd.compare(
        {"now": s, "smooth": {"friction_coefficient": 0.2}},
        lambda one: one.frequency_response(2000.0, BAND),
    ),
    "sweep": lambda s: bd.sweep(
        s, {"friction_coefficient": [0.2, 0.4], "preload": [1e3, 2e3]}, frequency=BAND
    ),
    "campbell": lambda s: turbine().campbell((350.0, 600.0, 850.0), (5,), modes=1),
    "nonlinear_mode": lambda s: s.nonlinear_mode(2000.0, 1, (1e-6, 1e-4)),
    "stress": lambda s: s.stress(made("peak")),
    "margins": lambda s: s.margin(made("peak"), STEEL),
    "margin_curve": lambda s: s.margin(made("frequency_response"), STEEL),
    "mistuned_sample": lambda s: of_masses("mistuned_sample"),
}


@cache
def made(name):
    return OF_DISK[name](bladed_disk())


def optimal():
    return made("optimal_curve")


def disk_peak(**other):
    response = 1e-4 * (1.0 + np.random.default_rng(1).uniform(size=(N, 2))) + 0j
    climbs, sweep, unknowns = np.zeros((0, 5)), np.array([350.0]), np.zeros((N, 1, 1))
    blade = int(np.abs(response[:, 1]).argmax())
    peak = DiskPeak(2000.0, 350.0, abs(response[blade, 1]), blade, 1.5e-4, response, climbs, sweep, "complete", "", 0.0,
                    unknowns)  # fmt: skip
    return replace(peak, **other)


def not_found():
    return disk_peak(
        status="not found", reason="no local search converges", amplitude=np.nan, blade=-1
    )


def failed_checks():
    o = optimal().optimum
    motion = TimeResponse(
        0.5 * o.amplitude, 0.4 * o.amplitude, 0.6 * o.amplitude, o.frequency, o.preload, o.amplitude
    )
    return replace(
        optimal(),
        optimum=replace(o, status="incomplete", reason="less may be elsewhere"),
        time_response=(motion,),
    )


def all_marks():
    """An optimum with every mark of :func:`bdamper.plot.plot_optimal`."""
    o = optimal().optimum
    top = o.amplitude
    least = TimeResponse(0.9 * top, 0.8 * top, 0.95 * top, o.frequency, o.preload, top)
    higher = replace(least, preload=1.35 * o.preload, highest=1.2 * top)
    peaks = tuple(HarmonicPeak(n, a * top, o.frequency, 1.0) for n, a in ((3, 1.0), (16, 0.8)))
    convergence = Convergence(o.preload, 0.05, peaks)
    return replace(optimal(), time_response=(least, higher), convergence=convergence)


def without_values():
    best = replace(
        optimal().optimum,
        preload=np.nan,
        amplitude=np.nan,
        kind="none",
        status="not found",
        reason="no peak",
    )
    return replace(optimal(), amplitude=np.full(len(optimal()), np.nan), optimum=best)


MISSING = {
    "optimal_curve_uncertainty": ("amplitude",),
    "sweep": ("values",),
    "mistuned_sample": ("amplitude", "tuned_amplitude"),
    "margin_curve": ("margin",),
    "campbell": ("free", "stuck"),
}  # fmt: skip
"""Results of which nothing is known, and what is missing."""


def without(name):
    """Return a result without the values that its picture shows."""
    result, lost = of_masses(name), MISSING[name]
    if lost == ("values",):
        values = result.values.copy()
        values["amplitude"] = np.nan
        return replace(result, values=values)
    return replace(result, **{key: np.full_like(getattr(result, key), np.nan) for key in lost})


def disks():
    shape = 20, 2, 3
    factor, none = np.random.default_rng(1).uniform(1.0, 1.8, shape), np.full(shape, np.nan)
    tuned = np.array([2e-4, 1.4e-4, 3.2e-4])
    return replace(made("mistuned_sample"), disks=np.arange(20), standard_deviation=np.array([0.01, 0.02]),
                   preload=np.array([250.0, 500.0, 2000.0]), amplitude=factor * tuned, frequency=none, residual=none,
                   springs=none, error=np.full(shape, 0.02), tuned_amplitude=tuned)  # fmt: skip


WITHOUT = "estimate_errors", "robust_optimum", "dampers", "audit", "best_preload", "tail"
"""Results of masses that have no picture."""
PICTURES = {
    **{
        f"masses: {name}": lambda name=name: of_masses(name).plot()
        for name in RESULTS
        if name not in WITHOUT
    },
    **{name: lambda name=name: made(name).plot() for name in OF_DISK},
    "curve with its limits": lambda: made("frequency_response").plot(
        limits=[made("free"), bladed_disk().stuck(BAND)]
    ),
    "six curves": lambda: plot_curves(
        [bladed_disk().frequency_response(p, BAND) for p in (5e2, 1e3, 2e3, 3e3, 4e3, 5e3)]
    ),
    "optimum with failed checks": lambda: failed_checks().plot(),
    "optimum with all marks": lambda: all_marks().plot(),
    "optimal curve without values": lambda: without_values().plot(),
    **{
        f"masses: {name} without values": lambda name=name: without(name).plot() for name in MISSING
    },
    "response map": lambda: plot_response_map(optimal()),
    "loops": lambda: made("hysteresis").plot(where=["left", "right", 4]),
    "history": lambda: made("hysteresis").plot_history(4),
    "energy": lambda: made("hysteresis").plot_energy(),
    "gap": lambda: made("static").plot(quantity="gap"),
    "SAFE diagram": lambda: made("campbell").plot_safe(600.0),
    "crossings": lambda: plot_crossings(
        bladed_disk().resonance_crossings((300.0, 600.0), [5], damper_mass_factor=(0.1, 0.3))
    ),
    "crossings without any": lambda: plot_crossings(
        turbine().resonance_crossings((350.0, 850.0), [5], damper_mass_factor=(0.5,))
    ),
    "flutter": lambda: (
        bladed_disk().flutter((1e3, 4e3), -0.005, amplitude=(1e-6, 1e-3), n=3).plot()
    ),
    "model": lambda: bladed_disk().model.plot(),
    "mode": lambda: bladed_disk().model.plot_mode(2),
    "critical points": lambda: made("margins").plot_critical(bladed_disk().model),
    "disk from the front": lambda: disk_peak().plot_wheel(bladed_disk().model),
    "blades": lambda: disk_peak(
        status="incomplete", reason="no blade is as high as on the tuned disk"
    ).plot(),
    "blades without a peak": lambda: not_found().plot(),
    "disk without a peak": lambda: not_found().plot_wheel(bladed_disk().model),
    "contacts of a curve": lambda: made("frequency_response").plot_contacts(bladed_disk(), point=3),
    "contacts of a peak": lambda: made("peak").plot_contacts(bladed_disk()),
    "contacts of an optimum": lambda: optimal().plot_contacts(bladed_disk()),
    "contacts of a mode": lambda: made("nonlinear_mode").plot_contacts(bladed_disk(), direction=1),
    "contacts at rest": lambda: made("static").plot_contacts(),
}


def texts(figure):
    """Texts that are drawn."""
    found = [*figure.texts, *(text for legend in figure.legends for text in legend.get_texts())]
    for ax in figure.axes:
        found += [ax.title, *ax.texts, *(ax.get_legend().get_texts() if ax.get_legend() else [])]
        for axis in (ax.xaxis, ax.yaxis) if ax.axison else ():
            low, high = sorted(axis.get_view_interval())
            ticks = [*axis.get_major_ticks(), *axis.get_minor_ticks()]
            found += [axis.label]
            found += [
                side for t in ticks if low <= t.get_loc() <= high for side in (t.label1, t.label2)
            ]
    return [text for text in found if text.get_visible() and text.get_text().strip()]


def look(handle):
    """Line style, marker and its filling, and the grey value in steps of a sixth."""
    grey = round(6.0 * float(np.dot(to_rgb(handle.get_color()), [0.299, 0.587, 0.114])))
    hollow = str(handle.get_markerfacecolor()) in ("w", "none")
    return (
        handle.get_linestyle(),
        str(handle._unscaled_dash_pattern),
        handle.get_marker(),
        hollow,
        grey,
    )


@pytest.mark.nightly
@pytest.mark.slow
@each("name", PICTURES)
def test_no_text_lies_on_another_one_or_is_cut(name):
    drawn = np.ravel(np.asarray(PICTURES[name](), object))[0]
    figure = drawn if isinstance(drawn, Figure) else drawn.figure
    assert figure.get_figwidth() in (COLUMN, 2.0 * COLUMN)
    figure.canvas.draw()
    boxes = [(text.get_text(), Text.get_window_extent(text)) for text in texts(figure)]
    assert all(text.get_fontsize() >= 6.5 for text in texts(figure)), "readable in print"
    for text, box in boxes:
        (left, low), (right, high) = box.min, box.max
        within = min(left, low, figure.bbox.x1 - right, figure.bbox.y1 - high)
        assert within > -0.5, f"{text!r} is cut by {-within:.1f} pixels"
    for (one, a), (other, b) in combinations(boxes, 2):
        assert not a.overlaps(b), f"{one!r} lies on {other!r}"
    for legend in [*figure.legends, *(ax.get_legend() for ax in figure.axes if ax.get_legend())]:
        handles = [look(line) for line in legend.legend_handles if isinstance(line, Line2D)]
        assert len(set(handles)) == len(handles), "lines differ in more than the colour"
    notes = [text.get_text() for ax in figure.axes for text in ax.texts if text.get_gid() == "note"]
    lacking = (
        "campbell",
        "masses: flutter",
        "optimal_curve",
        "optimum with failed checks",
        "optimum with all marks",
    )  # these three: no free resonance
    assert bool(notes) == (name in lacking or "without" in name), notes
    plt.close("all")


@pytest.mark.slow
@pytest.mark.parametrize("highest", [2, 3, 17, 47, 58, 63])
def test_numbers_of_blades_lie_beyond_the_tips_and_not_on_each_other(highest):
    ax = disk_peak(blade=highest).plot_wheel(bladed_disk().model).axes[0]
    ax.figure.canvas.draw()
    numbers = {int(text.get_text()): text.get_window_extent() for text in ax.texts}
    tenth = {k for k in range(0, N, 10) if min(abs(k - highest), N - abs(k - highest)) > 2}
    assert set(numbers) == tenth | {highest}
    assert not any(a.overlaps(b) for a, b in combinations(numbers.values(), 2))
    (blades,) = ax.collections
    corners = np.concatenate([path.vertices for path in blades.get_paths()])
    on_screen = ax.transData.transform(corners)
    for box in numbers.values():
        assert not ((on_screen > box.min) & (on_screen < box.max)).all(axis=1).any()
    plt.close("all")


@pytest.mark.slow
def test_a_failed_check_is_in_the_name_of_the_optimum():
    names = [" ".join(text.get_text().split()) for text in failed_checks().plot().axes[0].texts]
    (name,) = [name for name in names if "not verified" in name]
    assert name.startswith("lowest at the end of the range, not verified: ")
    assert name.endswith(" not for design: 4 checks failed")


def test_an_incomplete_peak_says_why():
    title = disk_peak(status="incomplete", reason="the sweep has a gap").plot().axes[0].get_title()
    assert " ".join(title.split()).endswith("incomplete: the sweep has a gap")


@pytest.mark.slow
def test_contact_states_are_those_of_the_shares():
    """The areas over time are the shares of the cycle, and a face that never touches is named."""
    study, peak = bladed_disk(), made("peak")
    figure = peak.plot_contacts(study)
    assert "always open: front, back" in figure.texts[0].get_text()
    left = figure.axes[1]
    area = [patch.get_paths()[0] for patch in left.collections]
    shares = [np.trapezoid(*curve.vertices[:, ::-1].T) for curve in area]
    from bdamper.plot.motion import contact_status

    status = contact_status(study, peak.y[:-1], peak.parameter)
    expected = 100.0 * status.share[status.rows("left"), 0].mean(axis=0)
    assert np.abs(shares) == pytest.approx(expected, abs=1.0)
    with pytest.raises(bd.SettingError, match="the study of the result"):
        peak.plot_contacts()
    with pytest.raises(bd.SettingError, match="a result of this study"):
        peak.plot_contacts(study.replace(friction_coefficient=0.1))
    with pytest.raises(bd.SettingError, match="point"):
        made("frequency_response").plot_contacts(study, point=10_000)


def test_a_path_is_a_file_of_a_known_kind(tmp_path):
    figure = made("free").plot(tmp_path / "free.pdf")
    assert (tmp_path / "free.pdf").read_bytes().startswith(b"%PDF") and isinstance(figure, Figure)
    for path, said in (
        (tmp_path / "free.xyz", "file extension"),
        ("amplitude", "extension"),
        (plt.gca(), "path"),
    ):
        with pytest.raises(bd.SettingError, match=said):
            made("free").plot(path)


def test_a_second_result_is_drawn_into_the_figure_of_the_first():
    figure = made("frequency_response").plot()
    assert made("free").plot(ax=figure) is figure and len(figure.axes) == 1
    assert "free" in [text.get_text() for text in figure.axes[0].texts]


def test_a_notebook_shows_a_figure_once(monkeypatch):
    """By its usual representations, as the value of a cell or at the end of the cell, whichever is first."""
    figure = new_axes().figure
    assert isinstance(figure, Picture)
    for backend, kept in (("agg", True), ("module://matplotlib_inline.backend_inline", False)):
        monkeypatch.setattr(plt, "get_backend", lambda backend=backend: backend)
        with pytest.raises(NotImplementedError):
            figure._ipython_display_()
        assert plt.fignum_exists(figure.number) == kept


def test_names_avoid_lines_and_each_other():
    ax = new_axes()
    ax.plot([0.0, 1.0], [0.0, 1.0])
    for k in range(3):
        name_point(ax, "a name", (0.5, 0.5))
    ax.figure.canvas.draw()
    place_names(ax)
    boxes = [Text.get_window_extent(text) for text in ax.texts]
    assert not any(a.overlaps(b) for a, b in combinations(boxes, 2))
    along = ax.transData.transform(np.linspace(0.0, 1.0, 500)[:, None] * [1.0, 1.0])
    assert not any(box.contains(*point) for box in boxes for point in along)


def test_a_line_break_does_not_part_a_number_from_its_unit():
    assert (
        wrapped("the peak of 474 µm lies at 344 Hz", 26).split("\n")[0]
        == "the peak of 474 µm lies at"
    )


def test_points_of_a_haigh_diagram_are_whole_and_within_it():
    """Those on an axis and those beyond the ultimate strength, too."""
    margins = made("margins")
    for mean in (0.0, 2.0 * STEEL.ultimate_strength):
        ax = replace(margins, mean=np.full_like(margins.mean, mean)).plot().axes[0]
        marks = [line for line in ax.lines if line.get_linestyle() == "None"]
        assert len(marks) >= 2 and not any(line.get_clip_on() for line in marks)
        low, high = ax.get_xlim()
        assert all(low <= x <= high for line in marks for x in line.get_xdata())
    plt.close("all")
