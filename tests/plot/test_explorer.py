"""The explorer: its thread answers the newest question, and the page, in a real browser, shows what the study gives."""

import base64
import html
import json
import re
import socket
import threading
import time
from contextlib import suppress
from dataclasses import replace
from queue import Empty, SimpleQueue
from threading import Event
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import bdamper as bd
from bdamper.harmonic_balance.parameters import vary
from bdamper.plot import explorer_worker
from bdamper.plot.axes import ticks_within
from bdamper.plot.contact import STATUS_COLOURS, tiles
from bdamper.plot.explorer_page import DAMPER, Page
from bdamper.plot.explorer_worker import MOVING, Answers, Question
from bdamper.plot.motion import contact_status
from bdamper.response import optimal_curve
from bdamper.response.events import ContinuationOptions
from bdamper.response.linear_limits import peak_interval
from bdamper.util.formatting import peak_text
from bdamper.util.progress import raise_if_stopped
from tests.chromium import MISSING, headless, is_installed

SHORT = 60.0  # longest wait for an answer, s
SIZES = {"desktop": (1280, 800), "phone": (390, 844)}
HEADINGS = [
    "Response against frequency",
    "Highest peak against preload",
    "Contacts",
    "Motion over one cycle",
]


def small():
    """A mass with a Jenkins element, which answers at once."""
    contact = bd.Contact(0, kt=1.0, mu=1.0, preload=1.0)
    return bd.lumped(1.0, 0.02, 1.0, contacts=[contact], forces={0: 1.0}, harmonics=3)


def asked(preload=0.0, **settings):
    return Question(tuple(settings.items()), preload, None)


@pytest.fixture
def answering():
    """Threads that answer, all of which end with the test."""
    made = []

    def make(study, deliver=print, **options):
        made.append(Answers(study, deliver, **options))
        return made[-1]

    yield make
    for answers in made:
        answers.ask(None)


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
        time.sleep(0.01)


# ---- the thread ----


def test_a_question_is_answered_coarsely_then_in_full_and_kept(answering):
    study, queue = small(), SimpleQueue()
    answers = answering(study, queue.put)
    answers.ask(asked(damping_ratio=0.02))
    quick, full, in_time = until_done(queue)
    assert (
        not quick.full and full.full and full.time_response is None and in_time.curve is full.curve
    )
    assert in_time.time_response.balance == pytest.approx(full.curve.peak.amplitude)
    np.testing.assert_equal(in_time.time_response.mean, full.study.time_response(full.curve).mean)
    given = vary(study, {"damping_ratio": 0.02})
    band = answers.band(asked())
    assert_array_equal(full.curve.amplitude, given.frequency_response(0.0, band).amplitude)
    assert_array_equal(
        quick.curve.amplitude,
        given.replace(harmonics=1).frequency_response(0.0, band, options=MOVING).amplitude,
    )
    assert [limit.kind for limit in full.limits] == ["free", "stuck"]
    assert full.point == full.curve.peak_index and full.loops.amplitude == full.curve.peak.amplitude
    answers.ask(asked(damping_ratio=0.02))
    again, again_in_time = until_done(queue)
    assert again.curve is full.curve and again_in_time.time_response is in_time.time_response
    answers.ask(Question((("damping_ratio", 0.02),), 0.0, None, point=3))
    other, _ = until_done(queue)
    assert other.point == 3 and other.loops.frequency == full.curve.frequency[3]


def loaded():
    """Two masses of 0.16 and 0.28 Hz, and a third one that a static load presses against the first."""
    contact = bd.Contact((2, 0), normal=2, kt=0.2, kn=1.0, mu=0.5)
    k = [[2.0, -1.0, 0.0], [-1.0, 2.0, 0.0], [0.0, 0.0, 0.1]]
    ways = {"contacts": [contact], "forces": {0: 0.3}, "load_per_preload": {2: 1.0}, "harmonics": 2}
    return bd.lumped([1.0, 1.0, 0.1], [0.02, 0.02, 0.02], k, **ways)


@pytest.mark.slow
def test_every_answer_is_that_of_the_study_whatever_was_asked_before(answering):
    """Each question differs from the first in one thing alone, and all of them are asked of one thread's answers."""
    study, preloads = loaded(), (0.5, 2.0)
    answers = answering(study, preloads=3)
    first = Question((), 1.0, preloads)
    names = {"excitation.amplitude": 0.5, "contact_stiffness_factor": 4.0, "harmonics": 3}
    others = [replace(first, settings=(item,)) for item in names.items()]
    others += [
        replace(first, preload=2.0),
        replace(first, preloads=(0.7, 3.0)),
        replace(first, mode=2),
        first,
    ]
    shown = []
    for question in (first, *others):
        given = vary(study, dict(question.settings))
        for harmonics in (1, None):
            kind = given.replace(harmonics=1) if harmonics else given
            own = peak_interval(study.replace(harmonics=1).problem.at(1.0), None, question.mode)
            band = peak_interval(given.replace(harmonics=1).problem.at(1.0), None, question.mode)
            curve, best = answers.curve(question, harmonics), answers.optimal(question)
            assert (
                curve.full == (harmonics is None)
                and best.full
                and curve.question is best.question is question
            )
            ends = float(curve.curve.frequency[0]), float(curve.curve.frequency[-1])
            assert ends == pytest.approx(own if harmonics else band, rel=5e-3), (
                "what follows the hand has axes that stay"
            )
            expected = kind.frequency_response(
                question.preload, ends, options=MOVING if harmonics else None
            )
            assert_array_equal(curve.curve.amplitude, expected.amplitude)
            touching = contact_status(kind, expected.unknowns[curve.point], question.preload)
            assert_array_equal(curve.contacts.share, touching.share)
            searched = best.optimal.settings["frequency"]
            assert searched == pytest.approx(band, rel=5e-3)
            least = given.optimal_curve(
                question.preloads, 3, frequency=searched, mode=question.mode, check=False
            )
            assert_array_equal(best.optimal.preload, least.preload)
            assert_array_equal(best.optimal.amplitude, least.amplitude)
        one = given.replace(harmonics=1)
        for found, limit in zip(
            curve.limits, (one.free(ends), one.stuck(ends, question.preload)), strict=True
        ):
            assert_array_equal(found.amplitude, limit.amplitude)
        shown.append((curve.curve.peak.amplitude, *best.optimal.amplitude, len(curve.curve)))
    assert len(set(shown[:-1])) == len(others) and shown[-1] == shown[0], (
        "and none of them shows what another does"
    )


def test_what_cannot_be_answered_is_one_line(answering):
    queue = SimpleQueue()
    answers = answering(small(), queue.put)
    for question, words in (
        (asked(5.0), "preload: expected 0"),
        (asked(damping_ratio=2.0), "damping_ratio: expected"),
        (asked(harmonics=200), "harmonics: expected"),
    ):
        answers.ask(question)
        assert words in until_done(queue)[-1]
    answers.ask(asked())
    assert len(until_done(queue)) == 3, "the thread goes on"


@pytest.mark.slow
@pytest.mark.parametrize(("harmonics", "begun_at_all"), [(3, [1, 3, 1, 3]), (1, [1, 1, 3])])
def test_a_newer_question_ends_the_work_and_takes_the_place_of_what_waits(
    monkeypatch, harmonics, begun_at_all, answering
):
    """All work but the first step, which is finished and shown, so that a view follows the hand."""
    queue, begun, go = SimpleQueue(), Event(), Event()
    answers, calls = answering(small(), queue.put), []
    frequency_response = bd.Study.frequency_response
    curve_alone = explorer_worker.frequency_response

    def wait_for(study):
        calls.append(study.settings.harmonic_numbers[-1])
        if (
            study.settings.harmonic_numbers[-1] == harmonics
            and study.settings.damping_ratio == 0.05
        ):
            begun.set()
            go.wait(SHORT)

    def slow(study, *given, **keywords):
        wait_for(study)
        return frequency_response(study, *given, **keywords)

    def slow_curve(problem, *given, **keywords):
        wait_for(problem)
        return curve_alone(problem, *given, **keywords)

    monkeypatch.setattr(bd.Study, "frequency_response", slow)
    # the first step asks for the curve alone
    monkeypatch.setattr(explorer_worker, "frequency_response", slow_curve)
    answers.ask(asked(damping_ratio=0.05))
    assert begun.wait(SHORT)
    for ratio in (0.1, 0.2, 0.3):
        answers.ask(asked(damping_ratio=ratio))
    go.set()
    found = until_done(queue)
    known = [
        (dict(a.question.settings)["damping_ratio"], a.full) for a in found if not a.time_response
    ]
    assert known == [(0.05, False), (0.3, False), (0.3, True)]
    assert calls == begun_at_all, (
        "the full answer to the first was ended or never begun, those between were not begun"
    )


@pytest.mark.parametrize("analysis", ["frequency_response", "optimal_curve"])
def test_a_part_of_a_result_is_never_kept_as_the_whole(monkeypatch, analysis, answering):
    whole = getattr(bd.Study, analysis)
    answers, question = answering(loaded(), preloads=3), Question((), 1.0, (0.5, 2.0))
    ask = answers.curve if analysis == "frequency_response" else answers.optimal

    def part(*given, **more):
        found = whole(*given, **more)
        stopped = (
            {"status": "interrupted"}
            if ask == answers.curve
            else {"optimum": replace(found.optimum, status="interrupted")}
        )
        return replace(found, **stopped)

    monkeypatch.setattr(bd.Study, analysis, part)
    with pytest.raises(KeyboardInterrupt):
        ask(question)
    monkeypatch.undo()
    answer = ask(question)
    assert not (answer.curve or answer.optimal).interrupted


def pressed():
    """Two masses with a contact that a preload closes."""
    contact = bd.Contact((1, 0), normal=1, kt=1.0, kn=1.0, mu=0.5)
    ways = {"contacts": [contact], "forces": {0: 0.1}, "load_per_preload": {1: 1.0}, "harmonics": 1}
    return bd.lumped([1.0, 0.1], [0.02, 0.02], [1.0, 0.1], **ways)


@pytest.mark.parametrize("harmonics", [1, 3])
def test_the_end_of_the_thread_ends_all_its_work(monkeypatch, harmonics, answering):
    """The first step, too, which a newer question does not end."""
    begun, frequency_response = Event(), bd.Study.frequency_response

    def endless(study, *given, **keywords):
        if study.settings.harmonic_numbers[-1] != harmonics:
            return frequency_response(study, *given, **keywords)
        begun.set()
        while True:
            raise_if_stopped()
            time.sleep(0.01)

    if harmonics == 1:
        # the first step asks for the curve alone
        monkeypatch.setattr(explorer_worker, "frequency_response", endless)
    monkeypatch.setattr(bd.Study, "frequency_response", endless)
    before = set(threading.enumerate())
    answers = answering(small(), lambda _: None)
    (own,) = set(threading.enumerate()) - before
    answers.ask(asked())
    assert begun.wait(SHORT)
    if harmonics == 1:
        answers.ask(asked(damping_ratio=0.05))
        own.join(0.2)
        assert own.is_alive()
    answers.ask(None)
    own.join(SHORT)
    assert not own.is_alive() and answers.closed


def test_a_newer_question_ends_an_optimal_curve_in_its_threads(monkeypatch, answering):
    study = pressed()
    queue, ended, at_preload = SimpleQueue(), [], optimal_curve.at_preload
    answers = answering(study, queue.put)

    def asked_again(*given):
        answers.stop.set()
        try:
            return at_preload(*given)
        except KeyboardInterrupt:
            ended.append(given[1])
            raise

    monkeypatch.setattr(optimal_curve, "at_preload", asked_again)
    answers.ask(Question((), 1.0, (0.5, 5.0)))
    for _ in range(2):  # the response curve, coarse and in full
        assert queue.get(timeout=SHORT).optimal is None
    until(lambda: ended)


def test_what_is_kept_is_bounded(answering):
    answers = answering(small(), lambda _: None, most=5)
    for k in range(20):
        answers.once(k, lambda k=k: k)
    assert list(answers.kept) == [15, 16, 17, 18, 19]
    assert answers.once(15, lambda: None) == 15


def test_colours_of_states_are_those_of_browsers():
    assert all(re.fullmatch("#[0-9a-f]{6}", colour) for colour in STATUS_COLOURS)


def test_patches_are_divided_by_their_shares():
    left, right, low, high, state = tiles(
        np.array([[0.2, 0.3, 0.5]]), np.array([1.0]), np.array([4.0]), 2.0, 10.0
    )
    assert_allclose(right - left, [1.8, 2.7, 4.5])
    assert_allclose((left[0], right[-1], low[0], high[0]), (-0.5, 8.5, 0.1, 1.9))
    assert state.tolist() == [0, 1, 2]


def test_the_extra_is_named_where_bokeh_is_missing(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "bokeh.server.server", None)
    with pytest.raises(
        bd.BdamperError, match=r"explore needs bokeh: install the extra bdamper\[app\]"
    ):
        bd.explore(small())
    with pytest.raises(bd.SettingError, match=r"study: expected a Study, found 'model\.h5'"):
        bd.explore("model.h5")


# ---- the page ----


@pytest.mark.parametrize(
    "ends", [(1.0, 1e4), (10.0, 1e4), (61.0, 1050.0), (70.0, 95.0), (6.0, 1300.0), (1e-3, 2e9)]
)
def test_ticks_are_few_round_and_apart(ends):
    ticks = ticks_within(*ends)
    assert 2 <= len(ticks) <= 9 and ends[0] <= min(ticks) and max(ticks) <= ends[1]
    span = np.log(ends[1] / ends[0])
    assert np.diff(np.log(ticks)).min() > 0.02 * span


def test_a_provisional_curve_that_ends_early_is_told_without_its_reasons(page, answers):
    """At 10 N the budget of a moving slider is used up; the whole answer says why a curve ends."""
    answer = answers.curve(Question((), 10.0, None), 1)
    assert not answer.curve.complete
    page.show(answer)
    assert page.text.text.startswith("<i>Provisional, with one harmonic:</i> the curve ends early")
    assert page.glyphs["curve"].line_dash == [6]
    page.show(replace(answer, full=True))
    assert (
        html.escape(answer.curve.reason[:20]) in page.text.text
        and page.glyphs["curve"].line_dash == []
    )


HOSTILE = "<svg onload=document[`harm`]=1>"


def renamed(study, mark):
    """A lumped study with a mark in front of all names of bodies, interfaces and places."""
    model, old = study.model, study.settings
    bodies = {
        mark + n: replace(
            b, name=mark + n, ports=tuple((mark + face, side) for face, side in b.ports)
        )
        for n, b in model.bodies.items()
    }
    for body in bodies.values():
        for d, basis in body.bases.items():
            body.bases[d] = replace(
                basis, locations={mark + n: rows for n, rows in basis.locations.items()}
            )
    faces = {
        mark + n: replace(f, name=mark + n, body_a=mark + f.body_a, body_b=mark + f.body_b)
        for n, f in model.interfaces.items()
    }
    places = {
        mark + n: replace(p, name=mark + n, body=mark + p.body) for n, p in model.locations.items()
    }
    model = replace(model, bodies=bodies, interfaces=faces, locations=places)
    return bd.Study(
        model, replace(study.excitation, location=mark + study.excitation.location), friction_coefficient=0.5, harmonics=1,
        contact_stiffness={mark + n: k for n, k in old.contact_stiffness.items()},
    )  # fmt: skip


@pytest.fixture
def served():
    """The page of a study whose names are lines of HTML, and what a request for it by any host is answered."""
    pytest.importorskip("bokeh.server", reason="bokeh is not installed: the extra bdamper[app]")
    explorer = bd.explore(renamed(pressed(), HOSTILE))
    port, path = explorer.address.rsplit(":", 1)[1].split("/")

    def get(host=f"localhost:{port}", path=path, head=""):
        with socket.create_connection(("127.0.0.1", int(port)), SHORT) as link:
            link.sendall(
                f"GET /{path} HTTP/1.1\r\nHost: {host}\r\n{head or 'Connection: close'}\r\n\r\n".encode()
            )
            found = b""
            while part := link.recv(65536):
                found += part
                if head:
                    break
        return int(found.split(b" ")[1]), found.decode(errors="replace")

    yield explorer, int(port), path, get
    explorer.close()


def test_names_of_a_model_are_text_on_the_page(served):
    explorer, _, _, get = served
    status, page = get()
    assert status == 200 and HOSTILE not in page
    assert html.escape(HOSTILE) in page, "the name of the body"
    page = Page(type(explorer.pages[-1].document)(), explorer.pages[-1].study, "")
    page.show(page.answers.curve(page.question(), None))
    assert HOSTILE in page.loop.value, "the name of the interface"
    for told in (page.text, *page.notes.values()):
        assert "<svg" not in told.text
    assert html.escape(HOSTILE) in page.notes["contacts"].text
    page.answers.ask(None)


def test_only_requests_to_this_machine_with_the_token_are_answered(served):
    explorer, port, path, get = served
    upgrade = "Connection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\n"
    upgrade += "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA=="
    for host in (f"localhost:{port}", f"127.0.0.1:{port}", f"LOCALHOST:{port}"):
        assert get(host)[0] == 200
        for origin, status in ((host.lower(), 101), ("elsewhere.example", 403)):
            assert get(host, f"{path}/ws", f"Origin: http://{origin}\r\n{upgrade}")[0] == status
    known = len(explorer.pages)
    for host in (
        "elsewhere.example",
        f"elsewhere.example:{port}",
        "localhost",
        f"localhost:{port + 1}",
    ):
        for way in (path, f"{path}/metadata", f"{path}/autoload.js?bokeh-autoload-element=1"):
            assert get(host, way)[0] == 403
        assert get(host, f"{path}/ws", f"Origin: http://localhost:{port}\r\n{upgrade}")[0] == 403
    assert [get(path=way)[0] for way in ("", "x", "explore")] == [404] * 3
    assert len(explorer.pages) == known and len(path) >= 32
    for address in {item[4][0] for item in socket.getaddrinfo(socket.gethostname(), None)} - {
        "127.0.0.1",
        "::1",
    }:
        with socket.socket() as probe:
            probe.settimeout(1.0)
            assert probe.connect_ex((address, port)) != 0, address


def seen(page):
    """Do what a browser does once it shows the page."""
    event = pytest.importorskip("bokeh.events").DocumentReady()
    page.document.add_next_tick_callback(lambda: page.document.callbacks.trigger_event(event))


def test_a_request_without_a_window_computes_nothing_and_a_window_computes_once(served):
    explorer, _, _, get = served
    for _ in range(3):
        assert get()[0] == 200
    time.sleep(0.5)
    assert len(explorer.pages) == 3 and not any(page.answers.kept for page in explorer.pages)
    found, page = SimpleQueue(), explorer.pages[-1]
    page.answers.deliver = found.put
    seen(page)
    assert until_done(found)[0].curve.preload == page.value("preload")
    assert not any(page.answers.kept for page in explorer.pages[:-1])


@pytest.mark.slow
def test_the_work_of_a_session_ends_with_it(served, monkeypatch):
    client = pytest.importorskip("bokeh.client")
    explorer, port, path, _ = served
    begun = Event()

    def endless(study, *given, **keywords):
        begun.set()
        while True:
            raise_if_stopped()
            time.sleep(0.01)

    monkeypatch.setattr(bd.Study, "frequency_response", endless)
    window = client.pull_session(url=f"http://localhost:{port}/{path}")
    page = explorer.pages[-1]
    seen(page)
    assert begun.wait(SHORT)
    before = threading.active_count()
    window.close()
    until(lambda: page.answers.closed)
    until(lambda: threading.active_count() < before)


@pytest.fixture(scope="module")
def browser():
    pytest.importorskip("selenium.webdriver", reason="selenium is not installed")
    if not is_installed():
        pytest.skip(MISSING)
    with headless("window-size=1400,1000") as found:
        yield found


class Window:
    """A page in the browser, by the names of its models."""

    def __init__(self, browser, explorer, size="desktop"):
        self.browser, self.explorer = browser, explorer
        width, height = SIZES[size]
        self.tell(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=1,
            mobile=width < 800,
        )
        browser.get(explorer.address)
        self.wait("return window.Bokeh !== undefined && Bokeh.documents.length > 0")
        self.settle()
        empty = (
            "could not determine",
            "could not set initial ranges",
        )  # views, before the first answer
        self.early = [
            line
            for line in self._complaints()
            if not any(words in line["message"] for words in empty)
        ]

    def run(self, script, *given):
        return self.browser.execute_script(
            f"const get = (n) => Bokeh.documents[0].get_model_by_name(n); {script}", *given
        )

    def wait(self, script):
        until(lambda: self.run(script))

    def tell(self, command, **given):
        return self.browser.execute_cdp_cmd(command, given)

    def settle(self):
        """Wait until all is answered but the amplitude in time."""
        self.wait("return !get('busy').visible || get('busy').text.includes('time integration')")

    def shown(self, name="curve"):
        """The answer in full that the page shows to what stands on it."""
        page = self.explorer.pages[-1]
        until(
            lambda: (
                name in page.shown
                and page.shown[name].full
                and page.shown[name].question == page.question()
            )
        )
        return page.shown[name]

    def type(self, name, text):
        """Type into the field of a number."""
        self.run("const field = Bokeh.index.find_one(get(arguments[0])).el.shadowRoot.querySelector('input');"
                 "field.value = arguments[1]; field.dispatchEvent(new Event('change'))", name, text)  # fmt: skip

    def boxes(self, selector):
        return self.run("return [...document.querySelectorAll(arguments[0])].map((e) => {const b = "
                        "e.getBoundingClientRect(); return [b.left, b.top + scrollY, b.right, b.bottom + scrollY]})",
                        selector)  # fmt: skip

    def size(self):
        """Width and height of the document and of the window."""
        return self.run(
            "const d = document.documentElement; return [d.scrollWidth, d.scrollHeight, innerWidth, innerHeight]"
        )

    def move(self, name, value):
        self.run("get(arguments[0]).value = arguments[1]", name, value)

    def data(self, name):
        columns = self.run("const data = get(arguments[0] + ' data'); return JSON.stringify("
                           "[...data.get_column('x')].concat([...data.get_column('y')]))", name)  # fmt: skip
        return json.loads(columns)

    def text(self, name="answer"):
        return self.run("return get(arguments[0]).text", name)

    def click(self, name):
        self.run(
            "Bokeh.index.find_one(get(arguments[0])).el.shadowRoot.querySelector('button').click()",
            name,
        )

    def _complaints(self):
        return [
            line
            for line in self.browser.get_log("browser")
            if line["level"] in ("SEVERE", "WARNING")
        ]

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
def page_of(monkeypatch):
    """Pages in no browser, whose questions nobody answers."""
    bokeh = pytest.importorskip(
        "bokeh.document", reason="bokeh is not installed: the extra bdamper[app]"
    )
    monkeypatch.setattr(
        "bdamper.plot.explorer_page.Answers", lambda *_: SimpleNamespace(ask=lambda _: None)
    )
    return lambda study: Page(bokeh.Document(), study, "study")


@pytest.fixture
def page(study, page_of):
    return page_of(study)


@pytest.fixture
def answers(study, answering):
    return answering(study)


def test_every_load_has_a_slider(page_of):
    """Those beside the preload: shares of the other bodies, and what does not change with it."""
    loads = {"load_per_preload": {"front": 1.0, "rear": 0.6}, "constant_loads": {"shroud": 500.0}}
    study = bd.Study(
        bd.reference_model("shrouded_blade"), bd.Excitation("tip"), 4, harmonics=1, **loads
    )
    page = page_of(study)
    assert [name for name in page.numbers if "." in name][1:] == [
        "load_per_preload.rear",
        "constant_loads.shroud",
    ]
    assert page.question().settings == ()
    page.sliders["constant_loads.shroud"].value = np.log10(250.0)
    page.numbers["load_per_preload.rear"].value = 0.9
    assert dict(page.question().settings) == {
        "load_per_preload.rear": 0.9,
        "constant_loads.shroud": 250.0,
    }
    given = vary(study, dict(page.question().settings)).settings
    assert given.load_per_preload == {"front": 1.0, "rear": 0.9} and given.constant_loads == {
        "shroud": 250.0
    }


def test_a_structure_without_friction_faces_has_no_tiles(page_of, answering):
    study = bd.lumped(1.0, 0.02, 1.0, cubic={0: 0.1}, forces={0: 1.0}, harmonics=1)
    page, answers = page_of(study), answering(study)
    page.show(answers.curve(page.question(), None))
    assert page.loop.options == ["whole"] and page.sources["loop"].data["x"].size
    assert all(
        len(page.sources["tiles"].data[name]) == 0
        for name in ("left", "right", "bottom", "top", "color")
    )
    assert page.sources["titles"].data == {"x": [], "y": [], "text": []}


def test_files_are_named_by_the_settings_of_what_is_in_them(page, answers):
    page.order.value = "10"
    page.show(provisional := answers.curve(page.question(), 1))
    page.order.value, page.numbers["preload"].value = "5", 501.0
    assert [*page._results()] == [
        f"{part}-200-N-engine-order-10-provisional" for part in ("curve", "loop")
    ]
    page.show(replace(provisional, full=True))
    assert list(page._results()) == ["curve-200-N-engine-order-10", "loop-200-N-engine-order-10"]


def test_a_chosen_point_is_told_once_it_is_the_one_that_is_shown(page, answers):
    provisional = answers.curve(replace(page.question(), point=3), 1)
    page.show(provisional)
    assert "Peak" in page.text.text and "Chosen point" not in page.text.text
    page.show(replace(provisional, full=True, point=3))
    curve = provisional.curve
    assert f" Chosen point: {peak_text(curve.amplitude[3], curve.frequency[3])}." in page.text.text


def test_the_optimum_is_told_in_a_sentence(page, answers):
    """Tables of checks would leave no space for the panels."""
    page.show(answers.optimal(page.question()))
    text = page.text.text
    assert text.startswith("★ ") and "Lowest amplitude at" in text and text.endswith(".")
    assert "<table" not in text and len(text) < 250


def test_of_an_empty_curve_the_curve_alone_is_saved(page, answers, monkeypatch):
    monkeypatch.setattr("bdamper.plot.explorer_worker.MOVING", ContinuationOptions(budget=1))
    empty = answers.curve(replace(page.question(), point=3), 1)
    assert not len(empty.curve)
    page.show(replace(empty, full=True))
    assert (
        page.text.text.startswith("No point of this curve was found")
        and "Chosen" not in page.text.text
    )
    for click, ending in ((page.pictures, "png"), (page.tables, "csv")):
        click()
        assert page.sources["file"].data["name"] == [f"curve-200-N-engine-order-5.{ending}"]


@pytest.mark.slow
def test_the_page_shows_what_the_study_gives(browser, explorer, study, answering):
    window = Window(browser, explorer)
    window.move("preload", 199.5)
    window.type("friction_coefficient", "0.4")
    until(lambda: explorer.pages[-1].question().settings == (("friction_coefficient", 0.4),))
    window.shown("optimal")
    varied = vary(study, {"friction_coefficient": 0.4})
    band = answering(study).band(asked(200.0))
    curve = varied.frequency_response(199.5, band)
    drawn = np.array([np.nan if v is None else v for v in window.data("curve")]).reshape(2, -1)
    drawn = drawn[:, np.isfinite(drawn[0])]
    assert_allclose(drawn, [curve.frequency, 1e6 * curve.amplitude], rtol=1e-12)
    assert window.data("point") == pytest.approx([curve.peak.frequency, 1e6 * curve.peak.amplitude])
    best = varied.optimal_curve((15.0, 3750.0), 7, frequency=band, check=False)
    assert window.data("optimum") == pytest.approx(
        [best.optimum.preload, 1e6 * best.optimum.amplitude]
    )
    assert set(window.run("return [...get('tiles data').get_column('color')]")) == set(
        STATUS_COLOURS
    )
    window.click("Python")
    window.wait("return get('code').text")
    names = {"study": study}
    exec(
        "\n".join(
            line for line in window.text("code").splitlines() if not line.startswith("optimal")
        ),
        names,
    )
    assert_array_equal(names["curve"].amplitude, curve.amplitude)
    window.click("CSV")
    window.wait("return get('file data').data.name[0] == 'optimal-200-N-engine-order-5.csv'")
    table = base64.b64decode(window.run("return get('file data').data.content[0]")).decode()
    assert table.count("\n") > len(best)
    window.click("Pictures")
    window.wait("return get('file data').data.name[0] == 'optimal-200-N-engine-order-5.png'")
    assert base64.b64decode(window.run("return get('file data').data.content[0]")).startswith(
        b"\x89PNG"
    )
    window.move("speed", 3000.0)
    window.wait(
        "return get('preload').title.includes('centrifugal') && get('preload').value != 199.5 && !get('code').text"
    )
    window.move("speed", 0.0)
    window.wait(
        "return get('preload').value == 199.5 && !get('preload').title.includes('centrifugal')"
    )
    assert not window.errors()


@pytest.mark.slow
@pytest.mark.parametrize("size", SIZES)
def test_every_control_at_both_sizes(browser, explorer, size):
    """Nothing is cut or lies on anything else, and every control changes what it says."""
    window = Window(browser, explorer, size)
    (wide, high), (width, height_, inner, _) = SIZES[size], window.size()
    assert width == inner == wide and (height_ <= high) == (size == "desktop")
    panels = window.boxes("#page > section")
    assert len(panels) == 4 and all(
        right - left > 300 and low - top > 200 for left, top, right, low in panels
    )
    parts = [*panels, *window.boxes("nav"), *window.boxes("header")]
    for i, (left, top, right, low) in enumerate(parts):
        assert left >= 0 and right <= wide and low <= height_
        for other in parts[:i]:
            apart = (
                left >= other[2] - 1,
                other[0] >= right - 1,
                top >= other[3] - 1,
                other[1] >= low - 1,
            )
            assert any(apart), "panels overlap"
    texts = "return [...document.querySelectorAll('h1, h2')].map((e) => [e.textContent, e.scrollWidth - e.clientWidth])"
    assert window.run(texts) == [[text, 0] for text in ("bdamper explorer", *HEADINGS)]
    assert (
        explorer.pages[-1].study.model.hash in browser.find_element("css selector", ".model").text
    )
    assert window.run("return getComputedStyle(document.querySelector('h1')).fontSize") == "18px"

    first = window.shown().curve.peak.amplitude
    for name, value, setting in (
        ("friction_coefficient", "0.4", ("friction_coefficient", 0.4)),
        ("harmonics", "1", ("harmonics", 1)),
        ("excitation.amplitude", "2.5", ("excitation.amplitude", 2.5)),
        ("mass", "2", ("damper_inertia_factor", 2.0)),
        ("speed", "3000", ("speed", pytest.approx(100.0 * np.pi))),
    ):
        window.type(name, value)
        until(lambda setting=setting: setting in explorer.pages[-1].question().settings)
        peak = window.shown().curve.peak
        assert peak.amplitude != first
        until(
            lambda peak=peak: f"Peak {peak_text(peak.amplitude, peak.frequency)}" in window.text()
        )
        window.move(name, explorer.pages[-1].first[name])
        until(lambda: not explorer.pages[-1].question().settings)
    window.type("preload", "104")
    until(lambda: "at a preload of 104 N" in window.text())
    window.run("get('preload slider').value = 2.5")
    window.wait(
        "return get('preload').value == 316 && get('answer').text.includes('at a preload of 316 N')"
    )
    window.move("preload", 200.0)
    until(
        lambda: (
            "at a preload of 200 N" in window.text()
            and window.shown().curve.peak.amplitude == first
        )
    )
    window.move("mode", "2")
    until(lambda: explorer.pages[-1].question().mode == 2)
    assert window.shown().curve.peak.amplitude != first
    window.move("mode", "1")
    window.move("order", "10")
    window.wait("return get('motion_text').text.includes('mode shapes of nodal diameter 10')")
    window.move("order", "5")
    window.wait("return get('motion_text').text.includes('magnified')")
    assert window.shown().curve.peak.amplitude == first
    before = window.data("loop")
    window.move("loop", "whole")
    until(lambda: window.data("loop") != before)
    window.run("get('contacts').active = 1")
    window.wait(
        "return Bokeh.index.find_one(get('cycle')) && Bokeh.index.find_one(get('cycle')).el.offsetWidth > 200"
    )
    window.run("get('contacts').active = 0")
    window.move("loop", "left")
    for name in ("Python", "CSV", "Pictures"):
        window.click(name)
    window.wait("return get('code').text && (get('file data').data.name[0] || '').endsWith('png')")
    ticks = window.run(
        "return [get('curve').left[0].ticker.ticks, get('curve').y_range.start, get('curve').y_range.end]"
    )
    inside = [x for x in ticks[0] if ticks[1] <= x <= ticks[2]]
    assert 3 <= len(inside) <= 7
    moving = "return JSON.stringify(get('patches data').data.xs.slice(0, 50))"
    seen = window.run(moving)
    until(lambda: window.run(moving) != seen)
    fills = set(window.run("return get('patches data').data.fill"))
    assert DAMPER[0] in fills and len(fills) > 10, "blades have the colours of their amplitudes"
    assert not window.errors()


@pytest.mark.slow
@pytest.mark.timeout(400)
def test_the_amplitude_in_time_stands_beside_the_peak(browser, explorer, study):
    window = Window(browser, explorer)
    page = explorer.pages[-1]
    window.type("preload", "2000")  # a time integration that the next move ends
    window.wait("return get('busy').text.includes('time integration')")
    window.type("preload", "200")
    for _ in range(5):
        with suppress(AssertionError):
            window.wait("return !get('busy').visible")
            break
    found = page.answers.time_response(page.question()).time_response
    assert found.ok and f"In time {found.text}" in window.text()
    assert window.data("time") == pytest.approx([found.frequency, 1e6 * found.mean])
    assert window.run("return [...get('range data').get_column('y')]") == pytest.approx(
        [1e6 * found.lowest, 1e6 * found.highest]
    )
    window.type("preload", "210")
    window.wait("return get('time data').data.x.length == 0")


@pytest.mark.slow
@pytest.mark.parametrize("size", SIZES)
def test_a_drag_moves_the_preload(browser, explorer, size):
    actions = pytest.importorskip("selenium.webdriver").ActionChains(browser)
    window = Window(browser, explorer, size)
    before = window.run("return get('preload').value")
    script = "const e = Bokeh.index.find_one(get(arguments[0])).el; e.scrollIntoView({block: 'center'}); "
    script += "const b = e.getBoundingClientRect(); return [b.x, b.y, b.width, b.height]"

    def pointer(name, share):
        canvas = window.run(script, name)
        return canvas[0] + share * canvas[2], canvas[1] + 0.5 * canvas[3]

    x, y = pointer("best", 0.5)
    actions.w3c_actions.pointer_action.move_to_location(int(x), int(y)).click_and_hold()
    for k in range(1, 6):
        actions.w3c_actions.pointer_action.move_to_location(int(x + 10 * k), int(y))
    actions.w3c_actions.pointer_action.release()
    actions.perform()
    until(lambda: abs(np.log10(window.run("return get('preload').value") / before)) > 0.05)
    dragged = window.shown().curve.preload
    until(lambda: window.data("marker")[0] == pytest.approx(dragged, rel=1e-5))
    assert abs(np.log10(dragged / before)) > 0.05
    x, y = pointer("curve", 0.3)
    actions.w3c_actions.pointer_action.move_to_location(int(x), int(y)).click()
    actions.perform()
    until(lambda: "Chosen point" in window.text())
    answer = window.shown()
    chosen = [answer.curve.frequency[answer.point], 1e6 * answer.curve.amplitude[answer.point]]
    until(lambda: window.data("point") == pytest.approx(chosen))
    assert answer.point != answer.curve.peak_index


def test_nothing_waits_for_ever(answering):
    queue = SimpleQueue()
    answers = answering(small(), queue.put)
    answers.ask(None)
    with pytest.raises(Empty):
        queue.get(timeout=0.2)
