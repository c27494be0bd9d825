"""The explorer: its thread answers the newest question, and the page, in a real browser, shows what the study gives."""

import base64
import json
import re
import shutil
import socket
import time
import urllib.error
import urllib.request
from dataclasses import replace
from queue import Empty, SimpleQueue
from threading import Event
from types import SimpleNamespace

import numpy as np
import pytest

import bdamper as bd
from bdamper.app.answers import MOVING, Answers, Question, tiles
from bdamper.app.page import Page
from bdamper.continuation.path import ContinuationOptions
from bdamper.peaks import optimal
from bdamper.plot.contact import STATUS_COLOURS
from bdamper.problem.variation import vary
from bdamper.util.text import height

SHORT = 60.0  # longest wait for an answer, s


def small():
    """A mass with a Jenkins element, which answers at once."""
    contact = bd.Contact(0, kt=1.0, mu=1.0, preload=1.0)
    return bd.lumped(1.0, 0.02, 1.0, contacts=[contact], forces={0: 1.0}, harmonics=3)


def asked(preload=0.0, **settings):
    return Question(tuple(settings.items()), preload, None)


def until_done(queue):
    """Answers up to the end of a question."""
    found = []
    while (item := queue.get(timeout=SHORT)) is not None:
        found.append(item)
        if isinstance(item, str):
            break
    return found


def until(true):
    end = time.monotonic() + SHORT
    while not true():
        assert time.monotonic() < end
        time.sleep(0.05)


# ---- the thread ----


def test_a_question_is_answered_coarsely_then_in_full_and_kept():
    study, queue = small(), SimpleQueue()
    answers = Answers(study, queue.put)
    answers.ask(asked(damping_ratio=0.02))
    quick, full = until_done(queue)
    assert not quick.full and full.full
    given = vary(study, {"damping_ratio": 0.02})
    band = answers.band(asked())
    np.testing.assert_array_equal(full.curve.amplitude, given.track(0.0, band).amplitude)
    np.testing.assert_array_equal(
        quick.curve.amplitude, given.with_(harmonics=1).track(0.0, band, options=MOVING).amplitude
    )
    assert [limit.kind for limit in full.limits] == ["free", "stuck"]
    assert full.point == full.curve.peak.index and full.loops.amplitude == full.curve.peak.amplitude
    answers.ask(asked(damping_ratio=0.02))
    (again,) = until_done(queue)
    assert again.curve is full.curve
    answers.ask(Question((("damping_ratio", 0.02),), 0.0, None, point=3))
    (other,) = until_done(queue)
    assert other.point == 3 and other.loops.frequency == full.curve.frequency[3]
    answers.ask(None)


def test_what_cannot_be_answered_is_one_line():
    queue = SimpleQueue()
    answers = Answers(small(), queue.put)
    for question, words in (
        (asked(5.0), "preload: expected 0"),
        (asked(damping_ratio=2.0), "damping_ratio: expected"),
        (asked(harmonics=200), "harmonics: expected"),
    ):
        answers.ask(question)
        assert words in until_done(queue)[-1]
    answers.ask(asked())
    assert len(until_done(queue)) == 2, "the thread goes on"
    answers.ask(None)


def test_a_newer_question_ends_the_work_and_takes_the_place_of_what_waits(monkeypatch):
    queue, begun, go = SimpleQueue(), Event(), Event()
    answers, calls = Answers(small(), queue.put), []
    track = bd.Study.track

    def slow(study, *given, **keywords):
        calls.append(study.harmonic_numbers[-1])
        if study.harmonic_numbers[-1] == 3 and study.damping_ratio == 0.05:
            begun.set()
            go.wait(SHORT)
        return track(study, *given, **keywords)

    monkeypatch.setattr(bd.Study, "track", slow)
    answers.ask(asked(damping_ratio=0.05))
    assert begun.wait(SHORT)
    for ratio in (0.1, 0.2, 0.3):
        answers.ask(asked(damping_ratio=ratio))
    go.set()
    found = until_done(queue)
    known = [(dict(a.question.settings)["damping_ratio"], a.full) for a in found]
    assert known == [(0.05, False), (0.3, False), (0.3, True)]
    assert calls == [1, 3, 1, 3], "the full answer to the first was ended, those between were not begun"
    answers.ask(None)


def test_a_newer_question_ends_an_optimal_curve_in_its_threads(monkeypatch):
    contact = bd.Contact((1, 0), normal=1, kt=1.0, kn=1.0, mu=0.5)
    ways = {"contacts": [contact], "forces": {0: 0.1}, "loads": {1: 1.0}, "harmonics": 1}
    study = bd.lumped([1.0, 0.1], [0.02, 0.02], [1.0, 0.1], **ways)
    queue, ended, at_preload = SimpleQueue(), [], optimal.at_preload
    answers = Answers(study, queue.put)

    def asked_again(*given):
        answers.stop.set()
        try:
            return at_preload(*given)
        except KeyboardInterrupt:
            ended.append(given[1])
            raise

    monkeypatch.setattr(optimal, "at_preload", asked_again)
    answers.ask(Question((), 1.0, (0.5, 5.0)))
    for _ in range(2):  # the tracking curve, coarse and in full
        assert queue.get(timeout=SHORT).optimal is None
    until(lambda: ended)
    answers.ask(None)


def test_what_is_kept_is_bounded():
    answers = Answers(small(), lambda _: None, most=5)
    for k in range(20):
        answers.once(k, lambda k=k: k)
    assert list(answers.kept) == [15, 16, 17, 18, 19]
    assert answers.once(15, lambda: None) == 15
    answers.ask(None)


def test_colours_of_states_are_those_of_browsers():
    assert all(re.fullmatch("#[0-9a-f]{6}", colour) for colour in STATUS_COLOURS)


def test_patches_are_divided_by_their_shares():
    left, right, low, high, state = tiles(np.array([[0.2, 0.3, 0.5]]), np.array([1.0]), np.array([4.0]), 2.0, 10.0)
    np.testing.assert_allclose(right - left, [1.8, 2.7, 4.5])
    np.testing.assert_allclose((left[0], right[-1], low[0], high[0]), (-0.5, 8.5, 0.1, 1.9))
    assert state.tolist() == [0, 1, 2]


def test_the_extra_is_named_where_bokeh_is_missing(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "bokeh.server.server", None)
    with pytest.raises(bd.BdamperError, match=r"explore needs bokeh: install the extra bdamper\[app\]"):
        bd.explore(small())
    with pytest.raises(bd.SettingError, match=r"study: expected a Study, found 'model\.h5'"):
        bd.explore("model.h5")


# ---- the page ----


def test_a_provisional_curve_that_ends_early_is_told_without_its_reasons():
    """At 10 N the budget of a moving slider is used up; the whole answer says why a curve ends."""
    document = pytest.importorskip("bokeh.document", reason="bokeh is not installed: the extra bdamper[app]").Document()
    page = Page(document, bd.Study(bd.reference_model("turbine_blade"), bd.Excitation("tip"), 5, 0.3, harmonics=2), "")
    answer = page.answers.curve(Question((), 10.0, None), 1)
    assert not answer.curve.complete
    page.show(answer)
    assert page.text.text.startswith("<i>Provisional, with one harmonic:</i> the curve ends early")
    assert page.glyphs["curve"].line_dash == [6]
    page.show(replace(answer, full=True))
    assert answer.curve.reason[:20] in page.text.text and page.glyphs["curve"].line_dash == []
    page.answers.ask(None)


@pytest.fixture(scope="module")
def browser():
    webdriver = pytest.importorskip("selenium.webdriver", reason="selenium is not installed")
    chromium, driver = shutil.which("chromium"), shutil.which("chromedriver")
    if not (chromium and driver):
        pytest.skip("no browser: Debian's chromium and chromium-driver are not installed")
    options = webdriver.ChromeOptions()
    options.binary_location = chromium
    for argument in ("headless=new", "no-sandbox", "disable-gpu", "disable-dev-shm-usage", "window-size=1400,1000"):
        options.add_argument(f"--{argument}")
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    with webdriver.Chrome(options=options, service=webdriver.ChromeService(driver)) as found:
        yield found


class Window:
    """A page in the browser, by the names of its models."""

    def __init__(self, browser, explorer):
        self.browser = browser
        browser.get(explorer.address)
        self.wait("return window.Bokeh !== undefined && Bokeh.documents.length > 0")
        self.settle()
        empty = "could not determine", "could not set initial ranges"  # views, before the first answer
        self.early = [line for line in self._complaints() if not any(words in line["message"] for words in empty)]

    def run(self, script, *given):
        return self.browser.execute_script(f"const get = (n) => Bokeh.documents[0].get_model_by_name(n); {script}", *given)

    def wait(self, script):
        until(lambda: self.run(script))

    def settle(self):
        """Wait until everything is answered."""
        self.wait("return !get('busy').visible")

    def move(self, name, value):
        self.run("get(arguments[0]).value = arguments[1]", name, value)

    def data(self, name):
        return json.loads(self.run("return JSON.stringify([...get(arguments[0]).get_column('x')].concat("
                                   "[...get(arguments[0]).get_column('y')]))", name))  # fmt: skip

    def text(self, name="text"):
        return self.run("return get(arguments[0]).text", name)

    def click(self, name):
        self.run("Bokeh.index.find_one(get(arguments[0])).el.shadowRoot.querySelector('button').click()", name)

    def _complaints(self):
        return [line for line in self.browser.get_log("browser") if line["level"] in ("SEVERE", "WARNING")]

    def errors(self):
        """What the console has, besides that views are empty before the first answer."""
        return self.early + self._complaints()


@pytest.fixture(scope="module")
def study():
    return bd.Study(bd.reference_model("turbine_blade"), bd.Excitation("tip"), 5, 0.3, harmonics=2)


@pytest.fixture(scope="module")
def explorer(study):
    pytest.importorskip("bokeh", reason="bokeh is not installed: the extra bdamper[app]")
    page = bd.explore(study)
    yield page
    page.close()


@pytest.fixture
def page(study, monkeypatch):
    """A page in no browser, whose questions nobody answers."""
    document = pytest.importorskip("bokeh.document", reason="bokeh is not installed: the extra bdamper[app]").Document()
    monkeypatch.setattr("bdamper.app.page.Answers", lambda *_: SimpleNamespace(ask=lambda _: None))
    return Page(document, study, "study")


@pytest.fixture
def answers(study):
    found = Answers(study, print)
    yield found
    found.ask(None)


def test_files_are_named_by_the_settings_of_what_is_in_them(page, answers):
    page.order.value = "10"
    page.show(provisional := answers.curve(page.question(), 1))
    page.order.value, page.sliders["preload"].value = "5", 2.7
    assert [*page._results()] == [f"{part}-200-N-engine-order-10-provisional" for part in ("curve", "loop")]
    page.show(replace(provisional, full=True))
    assert list(page._results()) == ["curve-200-N-engine-order-10", "loop-200-N-engine-order-10"]


def test_a_chosen_point_is_told_once_it_is_the_one_that_is_shown(page, answers):
    provisional = answers.curve(replace(page.question(), point=3), 1)
    page.show(provisional)
    assert "Resonance" in page.text.text and "Chosen point" not in page.text.text
    page.show(replace(provisional, full=True, point=3))
    curve = provisional.curve
    assert page.text.text.endswith(f" Chosen point: {height(curve.amplitude[3], curve.frequency[3])}.")


def test_of_an_empty_curve_the_curve_alone_is_saved(page, answers, monkeypatch):
    monkeypatch.setattr("bdamper.app.answers.MOVING", ContinuationOptions(budget=1))
    empty = answers.curve(replace(page.question(), point=3), 1)
    assert not len(empty.curve)
    page.show(replace(empty, full=True))
    assert page.text.text.startswith("No point of this curve was found") and "Chosen" not in page.text.text
    for click, ending in ((page.pictures, "png"), (page.tables, "csv")):
        click()
        assert page.file.data["name"] == [f"curve-200-N-engine-order-5.{ending}"]


@pytest.mark.slow
def test_the_page_shows_what_the_study_gives(browser, explorer, study):
    window = Window(browser, explorer)
    window.move("preload", 2.3)
    window.move("friction_coefficient", 0.4)
    until(lambda: explorer.pages[-1].shown["optimal"].question.settings == (("friction_coefficient", 0.4),))
    window.settle()
    band = Answers(study, print).band(asked(200.0))
    curve = vary(study, {"friction_coefficient": 0.4}).track(float(f"{10**2.3:.6g}"), band)
    drawn = np.array([np.nan if v is None else v for v in window.data("curve")]).reshape(2, -1)
    drawn = drawn[:, np.isfinite(drawn[0])]
    np.testing.assert_allclose(drawn, [curve.frequency, 1e6 * curve.amplitude], rtol=1e-12)
    assert window.data("point") == pytest.approx([curve.peak.frequency, 1e6 * curve.peak.amplitude])
    best = vary(study, {"friction_coefficient": 0.4}).optimal_curve((10.0, 1e4), 12, frequency=band, check=False)
    assert window.data("optimum") == pytest.approx([best.optimum.preload, 1e6 * best.optimum.amplitude])
    assert set(window.run("return [...get('faces').get_column('color')]")) == set(STATUS_COLOURS)
    window.click("Python")
    window.wait("return get('code').text")
    names = {"study": study}
    exec("\n".join(line for line in window.text("code").splitlines() if not line.startswith("optimal")), names)
    np.testing.assert_array_equal(names["curve"].amplitude, curve.amplitude)
    window.click("CSV")
    window.wait("return get('file').data.name[0] == 'optimal-200-N-engine-order-5.csv'")
    table = base64.b64decode(window.run("return get('file').data.content[0]")).decode()
    assert table.count("\n") > len(best)
    window.click("Pictures")
    window.wait("return get('file').data.name[0] == 'optimal-200-N-engine-order-5.png'")
    assert base64.b64decode(window.run("return get('file').data.content[0]")).startswith(b"\x89PNG")
    window.move("speed", 3000.0)
    window.wait("return get('preload').title.includes('centrifugal') && get('preload').value != 2.3 && !get('code').text")
    window.move("speed", 0.0)
    window.wait("return get('preload').value == 2.3 && !get('preload').title.includes('centrifugal')")
    assert not window.errors()


@pytest.mark.slow
def test_two_hundred_moves_leave_no_error(browser, explorer):
    window, random = Window(browser, explorer), np.random.default_rng(1)
    ends = window.run("return ['preload','friction_coefficient','excitation.amplitude','mass','speed','harmonics'].map("
                      "(n) => [n, get(n).start, get(n).end, get(n).step])")  # fmt: skip
    start = window.run("return arguments[0].map((n) => [n, get(n).value])", [end[0] for end in ends])
    for _ in range(200):
        name, low, high, step = ends[random.integers(len(ends))]
        window.move(name, float(np.round(random.uniform(low, high) / step) * step))
    for name, value in start:  # what was asked first is kept
        window.move(name, value)
    window.settle()
    page = explorer.pages[-1]
    assert len(page.answers.kept) <= page.answers.most
    assert window.text().startswith("Resonance of") and "color:" not in window.text()
    window.move("harmonics", 9)
    window.move("order", "59")
    window.wait("return get('text').text.includes('nodal diameter')")
    assert not window.errors()


@pytest.mark.slow
def test_a_drag_moves_the_preload(browser, explorer):
    actions = pytest.importorskip("selenium.webdriver").ActionChains(browser)
    window = Window(browser, explorer)
    before = window.run("return get('preload').value")
    canvas = browser.execute_script(
        "const f = [...Bokeh.documents[0]._all_models.values()].find((m) => m.title && m.title.text == 'Optimal curve');"
        "const box = Bokeh.index.find_one(f).el.getBoundingClientRect(); return [box.x, box.y, box.width, box.height]"
    )
    x, y = canvas[0] + 0.5 * canvas[2], canvas[1] + 0.5 * canvas[3]
    actions.w3c_actions.pointer_action.move_to_location(int(x), int(y)).click_and_hold()
    for k in range(1, 6):
        actions.w3c_actions.pointer_action.move_to_location(int(x + 20 * k), int(y))
    actions.w3c_actions.pointer_action.release()
    actions.perform()
    window.wait(f"return Math.abs(get('preload').value - {before}) > 0.05 && !get('busy').visible")
    assert window.data("marker")[0] == pytest.approx(10 ** window.run("return get('preload').value"), rel=1e-5)


def test_only_the_address_with_its_token_is_served(explorer):
    host = explorer.address.rsplit("/", 1)[0]
    for path in ("/", "/x", "/explore"):
        with pytest.raises(urllib.error.HTTPError, match="404"):
            urllib.request.urlopen(host + path, timeout=SHORT)
    assert len(explorer.address.rsplit("/", 1)[1]) >= 32
    port = int(host.rsplit(":", 1)[1])
    others = {item[4][0] for item in socket.getaddrinfo(socket.gethostname(), None)} - {"127.0.0.1", "::1"}
    for address in others:
        with socket.socket() as probe:
            probe.settimeout(1.0)
            assert probe.connect_ex((address, port)) != 0, address
    path = explorer.address.rsplit("/", 1)[1]
    for origin, status in (("http://elsewhere.example", "403"), (host, "101")):
        head = f"GET /{path}/ws HTTP/1.1\r\nHost: localhost:{port}\r\nOrigin: {origin}\r\nConnection: Upgrade\r\n"
        head += "Upgrade: websocket\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n"
        with socket.create_connection(("127.0.0.1", port), SHORT) as link:
            link.sendall(head.encode())
            assert link.recv(100).decode().startswith(f"HTTP/1.1 {status}")


def test_nothing_waits_for_ever():
    queue = SimpleQueue()
    answers = Answers(small(), queue.put)
    answers.ask(None)
    with pytest.raises(Empty):
        queue.get(timeout=0.2)
