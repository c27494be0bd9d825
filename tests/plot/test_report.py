"""The report for a design review: one file, the same bytes, lights by their rules."""

import re
from dataclasses import replace
from datetime import date
from html.parser import HTMLParser

import numpy as np
import pytest
from matplotlib.text import Text

import bdamper as bd
from bdamper.analyses.fit_result import Fitted
from bdamper.plot.report import lights
from bdamper.response.verification import TimeResponse
from bdamper.util.display import draw
from bdamper.util.formatting import amount
from tests.every_result import result as made
from tests.printed import said


class Page(HTMLParser):
    """Tags that are open, links, and the text."""

    def __init__(self, text):
        super().__init__()
        self.open, self.sources, self.said = [], [], ""
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        self.sources += [value for name, value in attributes if name in ("src", "href")]
        if tag not in ("meta", "img"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.said += data


@pytest.fixture(scope="module")
def study():
    return bd.Study(bd.reference_model("turbine_blade"), bd.Excitation("tip"), 5, harmonics=1)


@pytest.fixture(scope="module")
def curve(study):
    return study.optimal_curve((60.0, 240.0), 6, check=False)


@pytest.fixture
def words_alone(monkeypatch):
    """Reports without their pictures, which take most of the time, for tests that read the text."""
    monkeypatch.setattr("bdamper.plot.report._picture", lambda *_, **__: "<p>a picture</p>")


@pytest.mark.slow
def test_one_file_without_links(study, curve, tmp_path):
    curve.report(tmp_path / "review.html", study)
    curve.report(tmp_path / "again.html", study)
    content = (tmp_path / "review.html").read_bytes()
    assert content == (tmp_path / "again.html").read_bytes()
    # names with a white edge are outlines, 10 to 20 kB in a picture
    assert len(content) < 500_000
    page = Page(content.decode())
    assert page.open == [] and len(page.sources) == 6
    for text in (
        "Blades and dampers",
        "Stick, slip and separation",
        "Pressure at rest",
        "Hysteresis loop",
    ):
        assert text in page.said
    assert (
        all(source.startswith("data:image/") for source in page.sources) and "http" not in page.said
    )
    printed = curve._statement()
    # the effects that are not covered are a row of a table
    remarks = [remark.removeprefix("Not covered: ") for remark in printed.remarks]
    texts = [*printed.verdict, *(cell for row in printed.rows for cell in row), *remarks]
    for text in (*texts, curve.model_hash, str(curve.made_with)):
        assert text in page.said
    for text in ("friction coefficient", "Not modelled", "bd.load_study", "harmonics"):
        assert text in page.said
    damper = study.model.bodies["damper"]
    mass = f"{damper.mass:.4g} kg at a radius of {np.hypot(*damper.centre[:2]):.4g} m"
    assert re.search(rf"modal damping ratio\s*0\.002\s*damper\s*{mass}", page.said)


@pytest.mark.slow
@pytest.mark.usefixtures("words_alone")
def test_the_first_screen_says_what_by_whom_and_when(curve, tmp_path):
    given = {
        "project": "Stage 3",
        "author": "A. Engineer",
        "date": "2026-01-02",
        "model_file": "stage.h5",
    }
    path = tmp_path / "review.html"
    assert curve.report(path, disk=made("mistuned_sample"), **given) == path
    said = " ".join(Page(path.read_text()).said.split())
    first = said[: said.index("Checks")]
    rows = (
        *given.values(),
        curve.model_hash,
        "engine order 5, tangential at tip, amplitude 1",
        "not given, freq",
    )
    for text in (*rows, "60 N to 240 N", *curve._statement().verdict):
        assert text in first
    assert "Mistuned bladed disk" in said and "Not for design" not in first
    assert curve.report(tmp_path / "today.html").read_text().count(date.today().isoformat()) == 1


@pytest.mark.slow
@pytest.mark.usefixtures("words_alone")
def test_settings_that_are_not_given_have_their_meaning(curve, tmp_path):
    said = " ".join(Page(curve.report(tmp_path / "review.html").read_text()).said.split())
    settings = said[said.index("Settings") : said.index("To do it again")]
    assert "null" not in said and "None" not in said and "null" not in settings
    for text in (
        "damping ratioas in the model",
        "contact pointsall of the model",
        "speednone",
        "gapas in the model",
    ):
        assert text in settings
    assert "modal damping ratioas in the model; report(path, study) prints it" in said
    set_here = replace(curve, settings=curve.settings | {"damping_ratio": 0.0037})
    said = " ".join(Page(set_here.report(tmp_path / "set.html").read_text()).said.split())
    assert (
        "modal damping ratio0.0037" in said
        and "damping ratio0.0037" in said[said.index("Settings") :]
    )


@pytest.mark.usefixtures("words_alone")
def test_the_first_sentence_has_the_colour_of_the_checks(curve, tmp_path):
    """Grey while a check has not been run, and green only if none failed."""

    def shown(curve):
        return re.search(
            r'<div class="answer (\w+)"><p><b>(Not for design: )?',
            curve.report(tmp_path / "r.html").read_text(),
        )

    optimum = replace(curve.optimum, status="incomplete", reason="less may be elsewhere")
    assert shown(curve).groups() == ("white", None)
    assert shown(replace(curve, optimum=optimum)).groups() == ("red", "Not for design: ")


@pytest.mark.slow
def test_the_response_at_the_optimum_is_beside_its_limits(study, curve, tmp_path, monkeypatch):
    texts = {}

    def texts_of(shown, kind="plot", *arguments, **options):
        axes = draw(shown, kind, *arguments, **options)
        figure = np.atleast_1d(axes)[0].figure
        texts[type(shown).__name__, kind] = {text.get_text() for text in figure.findobj(Text)}
        return "<p>a picture</p>"

    monkeypatch.setattr("bdamper.plot.report._picture", texts_of)
    curve.report(tmp_path / "limits.html", study)
    assert {"free", "stuck"} <= texts["ResponseCurve", "plot"], texts.keys()


@pytest.mark.slow
@pytest.mark.usefixtures("words_alone")
def test_the_lines_that_do_it_again(study, curve, tmp_path, monkeypatch):
    curve.report(tmp_path / "review.html")
    page = Page((tmp_path / "review.html").read_text())
    assert "the report was made without the study" in page.said
    named = Page(curve.report(tmp_path / "named.html", model_file="stage.h5").read_text()).said
    assert 'bd.load_model("stage.h5")' in named and 'bd.load_model("model.h5")' in page.said
    lines = page.said[page.said.index("import bdamper as bd") :].strip().splitlines()
    curve.save(tmp_path / "best.h5")
    bd.save_model(study.model, tmp_path / "model.h5")
    here = {}
    monkeypatch.chdir(tmp_path)
    exec("\n".join(lines[:3]), here)
    assert here["best"].optimum.amplitude == pytest.approx(curve.optimum.amplitude, rel=1e-9)


def colours(curve, name):
    (found,) = [light.colour for light in lights(curve) if light.name == name]
    return found


@pytest.mark.slow
def test_an_optimum_at_the_end_of_the_range_is_red(study, curve):
    assert colours(curve, "Optimum within the range") == "green"
    end = study.optimal_curve((150.0, 300.0), 4, check=False)
    assert end.optimum.kind == "end" and colours(end, "Optimum within the range") == "red"
    assert "Remedy: include preloads below 150 N" in said(end)
    amplitude = end.amplitude.copy()
    amplitude[1] = np.nan
    alone = said(replace(end, amplitude=amplitude))
    assert (
        "include preloads" not in alone
        and "Remedy: find a value at the next preload first" in alone
    )


@pytest.mark.parametrize(
    ("ratio", "colour"),
    [(0.97, "green"), (0.9, "amber"), (1.1, "amber"), (0.7, "red"), (1.3, "red")],
)
def test_balance_against_time(curve, ratio, colour):
    high = curve.optimum.amplitude
    kept = TimeResponse(
        ratio * high, ratio * high, ratio * high, 660.0, curve.optimum.preload, high
    )
    assert colours(replace(curve, time_response=(kept,)), "Time integration") == colour
    unknown = replace(kept, status="incomplete", reason="stopped")
    assert colours(replace(curve, time_response=(unknown,)), "Time integration") == "red"
    assert colours(curve, "Time integration") == "white"


def test_the_recommended_preload_is_checked(curve):
    """Time integration contradicts the optimum of the harmonic balance, and agrees at the preload with less in time."""
    high = curve.optimum.amplitude
    best, other = curve.optimum.preload, 1.35 * curve.optimum.preload
    here = TimeResponse(2.0 * high, 2.0 * high, 2.0 * high, 660.0, best, high)
    there = TimeResponse(1.2 * high, 1.2 * high, 1.2 * high, 660.0, other, 1.21 * high)
    both = replace(curve, time_response=(here, there))
    assert both.recommended_preload == other and curve.recommended_preload == best
    assert colours(both, "Time integration") == "green"
    rows = [line.split("  ") for line in str(both).split("\n")]
    by_balance = next(i for i, row in enumerate(rows) if row[0] == "Harmonic balance")
    shown = [" ".join(" ".join(row).split()) for row in rows[by_balance : by_balance + 2]]
    assert shown[0].endswith(f"{amount(1.21 * high, 'm')} at this preload")
    assert shown[1].startswith(amount(high, "m")) and "at its optimum" in shown[1]
    swapped = replace(
        curve,
        time_response=(
            replace(here, preload=other),
            replace(there, preload=best, balance=0.5 * high),
        ),
    )
    assert swapped.recommended_preload == best
    assert colours(swapped, "Time integration") == "red"


@pytest.mark.usefixtures("words_alone")
@pytest.mark.parametrize(
    ("misfit", "settings", "mu", "colour"),
    [(1.0, {}, None, "green"), (2.0, {}, None, "amber"), (4.0, {}, None, "red"), (1.0, {"harmonics": [1, 3]}, None, "red"),
     (1.0, {}, 0.123, "red")],
)  # fmt: skip
def test_a_fit_and_whether_its_constants_are_those_of_the_curve(
    curve, tmp_path, misfit, settings, mu, colour
):
    one, two = np.ones(1), np.full((1, 2), misfit)
    values = one * (mu or curve.settings["friction_coefficient"]["left"])
    fit = Fitted(
        ("friction_coefficient",), values, values, values, one, one, one, ("rig",), 0.02, one, one, one, two,
        np.zeros(1, int), settings={**curve.settings, **settings}, model_hash=curve.model_hash,
    )  # fmt: skip
    (light,) = [light for light in lights(curve, fit) if light.name == "Contact constants"]
    assert light.colour == colour and ("other values" in light.found) == bool(settings or mu)
    first = Page(curve.report(tmp_path / "review.html", fit=fit).read_text()).said.partition(
        "Checks"
    )[0]
    assert ("Not for design: contact constants: misfit" in first) == (colour == "red")
    best = curve.optimum
    response = TimeResponse(*[best.amplitude] * 3, best.frequency, best.preload, best.amplitude)
    checked = replace(
        curve, optimum=replace(best, kind="smooth", status="complete"), time_response=(response,)
    )
    first = Page(checked.report(tmp_path / "checked.html", fit=fit).read_text()).said.partition(
        "Checks"
    )[0]
    assert ("Design amplitude" in first) == (colour != "red"), (
        "the lights and the first sentence agree"
    )


def test_what_is_open_is_red(curve):
    amplitude = curve.amplitude.copy()
    amplitude[-1] = float("nan")
    assert colours(replace(curve, amplitude=amplitude), "A value at every preload") == "amber"
    low = replace(curve, amplitude=amplitude[::-1], lowest_steady_preload=float(curve.preload[0]))
    (light,) = [light for light in lights(low) if light.name == "A value at every preload"]
    assert light.colour == "amber"
    assert (
        light.found
        == f"{len(curve) - 1} of {len(curve)}, no steady response up to {amount(curve.preload[0], 'N')}"
    )
    best = replace(curve.optimum, status="incomplete", reason="less may be elsewhere")
    assert colours(replace(curve, optimum=best), "Search for the optimum") == "red"


@pytest.mark.slow
def test_mistakes(study, curve, tmp_path):
    with pytest.raises(bd.SettingError, match="a result of this study"):
        curve.report(tmp_path / "review.html", study.replace(friction_coefficient=0.5))
    with pytest.raises(bd.BdamperError, match="existing folder"):
        curve.report(tmp_path / "none" / "review.html")
    with pytest.raises(bd.BdamperError, match="with an optimum"):
        replace(curve, optimum=replace(curve.optimum, amplitude=float("nan"))).report(
            tmp_path / "review.html"
        )
    assert not list(tmp_path.iterdir())
