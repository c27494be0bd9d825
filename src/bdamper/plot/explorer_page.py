"""What one window shows: numbers with sliders, linked views, buttons; its callbacks run in the thread of the server.

Where its parts stand on the page, and in which sizes of letters, is written in ``page.html``.
"""

from __future__ import annotations

import base64
import html
import tempfile
from functools import partial
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from bdamper.harmonic_balance.rotor_speed import RPM
from bdamper.model.kinematics import centrifugal_load
from bdamper.plot.axes import ticks_within
from bdamper.plot.contact import STATUS_COLOURS, face_coordinates, tiles
from bdamper.plot.curves import PRELOAD, with_optimum
from bdamper.plot.explorer_worker import FORCE, Answer, Answers, Question
from bdamper.plot.motion import STATES, LineDrawing
from bdamper.response.optimal_curve_result import OptimalCurve
from bdamper.response.response_curve_result import ResponseCurve
from bdamper.response.verification import TimeResponse
from bdamper.study import Study
from bdamper.util.display import draw
from bdamper.util.errors import import_extra
from bdamper.util.formatting import amount, peak_text, percent

LOGARITHMIC_SLIDERS = ("preload", FORCE, "mass")
EDGES = ("left", "right", "bottom", "top")
HERE = "#c0392b"
"""Colour of the point and of the preload that are looked at, and of nothing else."""
DOT = f'<b style="color:{HERE}">●</b>'
COARSE = "<i>Provisional, with one harmonic:</i> "
PANELS = {
    "curve": "Response over frequency",
    "best": "Highest peak over preload",
    "contacts": "Contacts",
    "motion": "Motion over one cycle",
}
QUIET = {"color": "#5b666d"}
SIZE = "12px"
"""Of all letters besides the title and the answer."""
FACES = {"damper": ("#e8b563", "#c08a2e"), "": ("#f6f8f9", "#a3aeb4")}
"""Fill and line of free bodies and of all others."""
MOVE = """
    const draw = (theta) => {
        const {x, y, cx, cy, sx, sy} = nodes.data, {a, b, c, d} = faces.data, [co, si] = [Math.cos(theta), Math.sin(theta)];
        const at = (p, c, s) => (k) => p[k] + co * c[k] - si * s[k], [u, v] = [at(x, cx, sx), at(y, cy, sy)];
        const corners = Array.from(a, (_, i) => [a[i], b[i], c[i], d[i]]);
        const [xs, ys] = [u, v].map((p) => corners.map((q) => q.map(p)));
        Object.assign(patches.data, {xs, ys, fill: faces.data.fill, line: faces.data.line});
        patches.change.emit();  // assigning data would send all of it to the server at every instant
    };
    draw(0);
    if (!window.moving && !matchMedia("(prefers-reduced-motion: reduce)").matches)
        window.moving = setInterval(() => document.hidden || draw(2 * Math.PI * (Date.now() % PERIOD) / PERIOD), 80);
""".replace("PERIOD", "2400")
"""Draws the faces at an instant of the cycle, again and again."""


class Place(Protocol):
    """Position of a click on a view in its own units; None outside its axes."""

    x: float | None
    y: float | None


class Page:
    """Sliders and views of a study in one document.

    Parameters
    ----------
    document : bokeh.document.Document
    study : Study
    source : str
        Lines of Python that make the study, under the name ``study``.
    """

    def __init__(self, document: Any, study: Study, source: str) -> None:
        self.models: Any = import_extra("bokeh.models", "explore", "app")
        self.document, self.study, self.source = document, study, source
        self.shown: dict[str, Answer] = {}
        self.told: dict[str, str] = {}
        self.sources: dict[str, Any] = {}
        self.point: int | None = None
        self.answers = Answers(study, self._deliver)
        document.on_session_destroyed(lambda _: self.answers.ask(None))
        document.on_event("document_ready", lambda _: self.ask())  # and not for a request without a window
        document.title = "bdamper explorer"
        document.template = Path(__file__).with_name("page.html").read_text(encoding="utf-8")
        model = study.model
        sectors = f"{model.n_blades} sectors: " if model.n_blades > 1 else ""
        named = f"{sectors}{', '.join(model.bodies)} (model {model.hash})"
        document.template_variables.update(model=named, panels=list(PANELS.items()), here=HERE)
        self._controls()
        self._views()
        self._lay_out()

    def _deliver(self, answer: Answer | str | None) -> None:
        if not self.answers.closed:  # as when the window was closed meanwhile
            self.document.add_next_tick_callback(partial(self.show, answer))

    # ---- what is moved ----

    def _slider(self, name: str, title: str, low: float, high: float, value: float, step: float = 0.01) -> Any:
        """A slider below the number that it moves, which can be typed."""
        whole, wide = step == 1, {"sizing_mode": "stretch_width"}
        ends = [float(np.log10(v)) if logarithmic(name) else v for v in (low, high, value)]
        beside = """
            .bk-input-group { flex-direction: row; align-items: center; justify-content: space-between; }
            .bk-input-group > label { flex: 1; } .bk-input-group > :not(label) { flex: 0 0 86px; width: 86px; }
            input.bk-input { height: 24px; padding: 0 6px; font-size: inherit; }
        """
        self.numbers[name] = self.models.NumericInput(
            name=name, title=title, value=int(value) if whole else float(value), mode="int" if whole else "float", low=low,
            high=high, stylesheets=[beside], margin=(3, 5, 0, 5), **wide,
        )  # fmt: skip
        coloured = f".noUi-handle {{ background: {HERE}; }}" if name == "preload" else ""
        slider = self.models.Slider(
            name=f"{name} slider", start=ends[0], end=ends[1], value=ends[2], step=step, show_value=False, title="",
            margin=(0, 12, 2, 12), stylesheets=[coloured], **wide,
        )  # fmt: skip
        slider.on_change("value", partial(self._slid, name))
        self.numbers[name].on_change("value", partial(self.moved, name))
        return slider

    def _controls(self) -> None:
        study, model = self.study, self.study.model
        self.numbers: dict[str, Any] = {}
        self.force = study.excitation.amplitude or 1.0
        self.mu = max(study.settings.friction_values(), default=0.0)
        rows: list[tuple[Any, ...]] = [
            ("preload", PRELOAD, 10.0 * self.force, 1e4 * self.force, 200.0 * self.force),
            ("friction_coefficient", "Friction coefficient", min(0.05, self.mu), 1.0, self.mu),
            (FORCE, "Excitation (N)", 0.01 * self.force, 100.0 * self.force, self.force),
            ("harmonics", "Harmonics", 1, 9, study.settings.harmonic_numbers[-1], 1),
        ]
        shares, fixed = (study.settings.given_loads(item) for item in ("load_per_preload", "constant_loads"))
        shares = {} if study.settings.speed is not None else shares
        each = [
            (f"load_per_preload.{name}", f"Load on {name} (N per N)", share) for name, share in list(shares.items())[1:]
        ]
        each += [
            (f"constant_loads.{name}", f"Load on {name} (N)", load) for name, load in fixed.items() if np.ndim(load) == 0
        ]
        rows += [(name, title, 0.01 * load, 100.0 * load, load) for name, title, load in each if load > 0.0]
        if study.problem.carries_load and any(body.kind == "free" for body in model.bodies.values()):
            rows.append(("mass", "Damper mass (factor)", 0.1, 10.0, 1.0))
            if any(basis.speed is not None for body in model.bodies.values() for basis in body.bases.values()):
                radius = max(float(np.hypot(*place.position[:2])) for place in model.locations.values())
                fastest = round(500.0 / radius * RPM)  # at which the tip has 500 m/s
                rows.append(("speed", "Rotor speed (rpm); 0: off", 0, fastest, 0, 10))
        self.sliders = {row[0]: self._slider(*row) for row in rows}
        for control in (self.sliders["preload"], self.numbers["preload"]):
            control.disabled = not study.problem.carries_load
        self.resting = self.numbers["preload"].value
        self.first = {name: number.value for name, number in self.numbers.items()}
        known = [set(b.bases) for b in model.bodies.values() if b.kind == "constrained"]
        diameters = set.intersection(*known) if known else set()
        wave = model.folded_nodal_diameter
        met = {n for n in range(1, model.n_blades) if wave(n)[0] in diameters} | {int(study.settings.engine_order)}
        orders = [(str(n), f"{n} (nodal diameter {wave(n)[0]})") for n in sorted(met)]
        faces = [name for name in study.problem.coupling.interfaces if model.interfaces[name].kind == "friction"]
        select = partial(self.models.Select, sizing_mode="stretch_width", stylesheets=["select { font-size: inherit; }"])
        self.mode = select(name="mode", title="Mode", value="1", options=[str(k) for k in range(1, 6)])
        self.order = select(name="order", title="Engine order", value=str(study.settings.engine_order), options=orders)
        self.loop = select(name="loop", title="Loop of", value=[*faces, "whole"][0], options=["whole", *faces])
        for chooser in (self.mode, self.order):
            chooser.on_change("value", partial(self.moved, "mode"))
        self.loop.on_change("value", lambda attr, old, new: self._contacts())
        near = {"width": 70, "margin": (6, 2, 0, 3)}
        self.buttons = [self.models.Button(name=label, label=label, **near) for label in ("Pictures", "CSV", "Python")]
        for button, action in zip(self.buttons, (self.pictures, self.tables, self.lines)):
            button.on_click(action)
        wide = {"sizing_mode": "stretch_width"}
        self.text = self.models.Div(name="answer", styles={"font-size": "14px"}, **wide)
        self.notes = {name: self.models.Div(name=f"{name}_text", styles=QUIET, **wide) for name in PANELS}
        self.notes["curve"].text = f"{DOT} chosen point, ◇ in time; grey: without contact and with stuck contact"
        self.busy = self.models.Div(name="busy", styles=QUIET, **wide)
        self.code = self.models.PreText(name="code", visible=False, styles={"white-space": "pre-wrap"}, **wide)
        file = self._source("file", "name", "kind", "content")
        self.text.tags = [file]  # so that it belongs to the document
        save = """
            const {name, kind, content} = source.data, link = document.createElement("a");
            Object.assign(link, {href: `data:${kind[0]};base64,${content[0]}`, download: name[0]}).click();
        """
        file.js_on_change("data", self.models.CustomJS(args={"source": file}, code=save))

    def _source(self, name: str, *columns: str) -> Any:
        """Empty columns under a name."""
        self.sources[name] = self.models.ColumnDataSource({column: [] for column in columns}, name=f"{name} data")
        return self.sources[name]

    def value(self, name: str) -> float:
        """The number that is typed, or that its slider has set."""
        return float(self.numbers[name].value)

    def _slid(self, name: str, attr: str, old: object, new: float) -> None:
        """The number of a slider, unless it is what has moved the slider."""
        value = float(f"{10.0**new:.3g}") if logarithmic(name) else float(f"{new:.6g}")
        if abs(self._place(name) - new) > 1e-9:
            self.numbers[name].value = int(value) if self.numbers[name].mode == "int" else value

    def _place(self, name: str) -> float:
        """Of a number on its slider."""
        return float(np.log10(self.value(name))) if logarithmic(name) else self.value(name)

    def moved(self, name: str, attr: str, old: object, new: object) -> None:
        """A number is another one: at speed the preload is the centrifugal one, at rest again what it was before."""
        if new is None:  # an empty field
            self.numbers[name].value = old
            return
        turns = self.value("speed") / RPM if "speed" in self.numbers else 0.0
        number, slider = self.numbers["preload"], self.sliders["preload"]
        if name == "preload" and not turns:
            self.resting = number.value
        elif name in ("speed", "mass"):
            own = centrifugal_load(self.study.model) * self.value("mass") * turns**2 if turns else self.resting
            number.title = PRELOAD + (", centrifugal" if turns else "")
            number.low, number.high = min(number.low, own), max(number.high, own)
            slider.start, slider.end = float(np.log10(number.low)), float(np.log10(number.high))
            number.value = float(f"{own:.6g}")
        if name in self.sliders:
            self.sliders[name].value = min(max(self._place(name), self.sliders[name].start), self.sliders[name].end)
        self.point = None
        self.ask()

    def question(self) -> Question:
        """What the numbers ask; the optimal curve is about the optimum, which is higher the less friction there is."""
        settings: dict[str, Any] = {
            name: number.value
            for name, number in self.numbers.items()
            if name not in ("preload", "mass", "speed") and number.value != self.first[name]
        }
        if int(self.order.value) != self.study.settings.engine_order:
            settings["engine_order"] = int(self.order.value)
        turning = "speed" in self.numbers and self.value("speed") > 0.0
        if turning:  # where mass times radius of the bodies decides
            settings = {name: value for name, value in settings.items() if not name.startswith("load_per_preload.")}
            settings["speed"] = self.value("speed") / RPM
        if "mass" in self.numbers and self.numbers["mass"].value != self.first["mass"]:
            settings["damper_mass" if turning else "damper_mass_factor"] = self.value("mass")
        unit = self.value(FORCE) * (self.mu / self.value("friction_coefficient") if self.mu else 1.0)
        # preloads of the optimal curve for each newton of excitation, at the friction coefficient of the study
        searched = (20.0, 5000.0)
        low, high = (float(f"{end * unit:.6g}") for end in searched)
        loaded = self.study.problem.carries_load
        preload, preloads = (float(f"{self.value('preload'):.6g}"), (low, high)) if loaded else (0.0, None)
        return Question(tuple(settings.items()), preload, preloads, int(self.mode.value), self.point)

    def ask(self) -> None:
        """Ask what the numbers stand for now."""
        question, before = self.question(), self.shown.get("optimal")
        self.busy.text, self.busy.visible, self.code.text = "computing the curve ...", True, ""
        self.code.visible = False
        if before is not None and (before.question.settings, before.question.mode) != (question.settings, question.mode):
            self.told["optimal"] = "The optimum is being computed."
            self.glyphs["optimal"].line_dash = [6]
            self.notes["best"].text = "Dashed: before the last change of settings."
        self.told["march"] = "The amplitude in time is being computed."
        self._clear("time", "range")
        self.answers.ask(question)

    # ---- what is seen ----

    def _views(self) -> None:
        self.figure = import_extra("bokeh.plotting", "explore", "app").figure
        size: dict[str, Any] = {"min_width": 200, "min_height": 120, "sizing_mode": "stretch_both"}
        plain: dict[str, Any] = {**size, "tools": "", "toolbar_location": None}
        tools = {"tools": "box_zoom,wheel_zoom,reset,hover", "active_drag": None, "toolbar_location": "right"}
        at = (self.study.settings.response or self.study.excitation).location
        high: dict[str, Any] = {**size, **tools, "y_axis_type": "log", "y_axis_label": f"Amplitude at {at} (µm)"}
        self.curve = self._figure("curve", **high, x_axis_label="Frequency (Hz)", x_range=(0.0, 1.0), y_range=(1.0, 10.0))
        low, top = (end * self.force for end in (10.0, 1e4))
        self.best = self._figure(
            "best",
            **high, x_axis_label=PRELOAD, x_axis_type="log", x_range=(low, top), y_range=(1.0, 10.0),
        )  # fmt: skip
        self.faces = self._figure("faces", match_aspect=True, **plain)
        self.cycle = self._figure("cycle", x_axis_label=" ", y_axis_label=" ", **plain)
        self.motion = self._figure("motion", match_aspect=True, **plain)
        black, grey = {"color": "black", "line_width": 2}, {"color": "#7b868c", "line_width": 1.2}
        ring = {"size": 16, "fill_color": None, "line_color": HERE, "line_width": 3}
        star = {"size": 16, "marker": "star", "color": "black"}
        diamond = {"size": 9, "marker": "diamond", "line_color": "black", "fill_color": "white"}
        self.glyphs = {}
        for name, view, kind, look in (
            ("free", self.curve, "line", {**grey, "line_dash": "dotdash"}),
            ("stuck", self.curve, "line", {**grey, "line_dash": "dotted"}),
            ("curve", self.curve, "line", black),
            ("optimal", self.best, "line", black),
            ("loop", self.cycle, "line", black),
            ("optimum", self.best, "scatter", star),
            ("point", self.curve, "scatter", ring),
            ("marker", self.best, "scatter", ring),
            ("range", self.curve, "line", black),
            ("time", self.curve, "scatter", diamond),
        ):
            self.glyphs[name] = getattr(view, kind)("x", "y", source=self._source(name, "x", "y"), **look).glyph
        self.faces.quad(**{name: name for name in EDGES}, color="color", source=self._source("tiles", *EDGES, "color"))
        for name, view, text in (
            ("names", self.curve, {"text_color": "#5b666d", "y_offset": -3}),
            ("titles", self.faces, {"text_align": "center"}),
        ):
            view.text("x", "y", "text", source=self._source(name, "x", "y", "text"), text_font_size=SIZE, **text)
        for view in (self.faces, self.motion):
            view.axis.visible = view.grid.visible = False
            view.outline_line_color = None
        self._moving()
        self.curve.on_event("tap", self.chosen)
        for event in ("tap", "pan"):
            self.best.on_event(event, self.dragged)

    def _figure(self, name: str, **options: Any) -> Any:
        """A figure in the one size of letters; logarithmic axes get ticks that fit whatever they show."""
        view = self.figure(name=name, **options)
        for axis in view.axis:
            axis.axis_label_text_font_size = axis.major_label_text_font_size = SIZE
            axis.axis_label_text_font_style = "normal"
        view.toolbar.logo = None
        for axis, shown in ((view.xaxis[0], view.x_range), (view.yaxis[0], view.y_range)):
            if type(axis).__name__ == "LogAxis":
                axis.formatter = self.models.CustomJSTickFormatter(code="return String(Number(tick.toPrecision(3)))")
                for end in ("start", "end"):
                    shown.on_change(end, lambda attr, old, new, axis=axis, shown=shown: self._tick(axis, shown))
                self._tick(axis, shown)
        return view

    def _tick(self, axis: Any, shown: Any) -> None:
        axis.ticker = self.models.FixedTicker(ticks=ticks_within(*sorted((shown.start, shown.end))))

    def _moving(self) -> None:
        """Patches of the moving surfaces, painted from the farthest to the nearest so that they hide lines."""
        frame = self.motion.scatter("x", "y", source=self._source("box", "x", "y"), size=1, alpha=0)
        for shown in (self.motion.x_range, self.motion.y_range):
            shown.renderers = [frame]  # and not the surfaces, with which the view would move
        patches = self._source("patches", "xs", "ys", "fill", "line")
        look = {"fill_color": "fill", "line_color": "line", "line_width": 0.5}
        self.motion.patches("xs", "ys", source=patches, **look)
        quads = self._source("quads", *"abcd", "fill", "line")
        nodes = self._source("nodes", "x", "y", "cx", "cy", "sx", "sy")
        self.text.tags += [quads]
        args = {"nodes": nodes, "faces": quads, "patches": patches}
        quads.js_on_change("data", self.models.CustomJS(args=args, code=MOVE))

    def _lay_out(self) -> None:
        layout, wide = import_extra("bokeh.layouts", "explore", "app"), {"sizing_mode": "stretch_width", "spacing": 0}
        pairs = [layout.column(self.numbers[name], slider, **wide) for name, slider in self.sliders.items()]
        hint = "Click the curve to choose a point; drag in the curve of peaks to move the preload."
        said = self.models.Div(text=hint, styles=QUIET, sizing_mode="stretch_width")
        rows = [*pairs, layout.row(self.mode, self.order, **wide), self.loop, layout.row(*self.buttons, spacing=0), said]
        controls = layout.column(*rows, name="controls", **wide)
        titles = {"Contact points": self.faces, "Hysteresis loop": self.cycle}
        tabs = [self.models.TabPanel(title=title, child=view) for title, view in titles.items()]
        contacts = self.models.Tabs(tabs=tabs, name="contacts", sizing_mode="stretch_both")
        views = [self.curve, self.best, contacts, self.motion]
        for root in (self.text, self.busy, controls, *views, *self.notes.values(), self.code):
            self.document.add_root(root)

    def show(self, answer: Answer | str | None) -> None:
        """A part of the answer has come, a line that says why there is none, or the end of it."""
        if answer is None or isinstance(answer, str):
            self.busy.visible = False
            if answer is not None:
                self.text.text = f"<b>No answer:</b> {html.escape(answer)}"
            return
        for name in ("curve", "optimal"):
            if getattr(answer, name) is not None:
                self.shown[name] = answer
        if answer.marched is not None:
            self._marched(answer.marched)
        elif answer.curve is not None:
            self._curve(answer, answer.curve)
        if answer.optimal is not None:
            self._optimal(answer.optimal)
        if answer.full:
            self.busy.text = f"computing the {'amplitude in time' if answer.optimal else 'optimum'} ..."
        self.text.text = " ".join(self.told[name] for name in ("curve", "march", "optimal") if self.told.get(name))

    def _line(self, name: str, x: Any, y: Any) -> None:
        self.sources[name].data = {"x": np.asarray(x), "y": np.asarray(y)}

    def _texts(self, name: str, placed: list[tuple[float, float, str]]) -> None:
        self.sources[name].data = {column: [place[i] for place in placed] for i, column in enumerate(("x", "y", "text"))}

    def _clear(self, *names: str) -> None:
        for name in names:
            self.sources[name].data = {column: [] for column in self.sources[name].data}

    def _optimal(self, found: OptimalCurve) -> None:
        """The curve of peaks with its optimum."""
        o, (x, amplitude, _) = found.optimum, with_optimum(found)
        y = 1e6 * amplitude
        self._line("optimal", x, y)
        self._line("optimum", [o.preload], [1e6 * o.amplitude])
        self.glyphs["optimal"].line_dash = []
        self.notes["best"].text = f"★ optimum, {DOT} chosen preload"
        self._fit(self.best.y_range, y)
        loads = [*x, self.value("preload")]
        self.best.x_range.update(start=0.8 * min(loads), end=1.25 * max(loads))
        star = "★ " if np.isfinite(o.preload) else ""
        self.told["optimal"] = star + html.escape(found._headline())

    def _marched(self, found: TimeResponse) -> None:
        """The steady-state amplitude in time, beside the peak."""
        if not np.isfinite(found.mean):
            self.told["march"] = f"In time: {html.escape(found.status)}."
            return
        self._line("time", [found.frequency], [1e6 * found.mean])
        self._line("range", [found.frequency] * 2, [1e6 * found.lowest, 1e6 * found.highest])
        doubt = "" if found.status.startswith("complete") else f", {html.escape(found.status)}"
        self.told["march"] = f"◇ In time {found.text}{doubt}."

    def _curve(self, answer: Answer, curve: ResponseCurve) -> None:
        """The response curve with its limits and the chosen point."""
        here = peak_text(curve.amplitude[answer.point], curve.frequency[answer.point]) if len(curve) else ""
        at = f" Chosen point: {here}." if here and answer.full and answer.question.point is not None else ""
        whole = answer.full or curve.complete
        if whole and len(curve) and curve.complete and not curve.peak_at_end:
            peak, load = peak_text(curve.peak.amplitude, curve.peak.frequency), amount(curve.preload, "N")
            told = f"{DOT} <b>Peak {peak}</b>" + (f" at a preload of {load}." if curve.preload else ".")
        else:
            told = html.escape(curve._headline()) if whole else "the curve ends early, as long as the slider moves."
        self.told["curve"] = ("" if answer.full else COARSE) + told + at
        self.glyphs["curve"].line_dash = [] if answer.full else [6]
        turns = np.flatnonzero(np.diff(curve.branch)) + 1  # a gap between branches
        self._line("curve", np.insert(curve.frequency, turns, np.nan), 1e6 * np.insert(curve.amplitude, turns, np.nan))
        tops = [(limit.peak.frequency, 1e6 * limit.peak.amplitude, limit.kind) for limit in answer.limits if len(limit)]
        for name, limit in zip(("free", "stuck"), answer.limits):
            self._line(name, limit.frequency, 1e6 * limit.amplitude)
        if len(curve):
            self._line("point", curve.frequency[[answer.point]], 1e6 * curve.amplitude[[answer.point]])
            is_peak = [] if curve.peak_at_end else [curve.peak]
            self._line("marker", [curve.preload for _ in is_peak], [1e6 * peak.amplitude for peak in is_peak])
            self.curve.x_range.update(start=float(curve.frequency.min()), end=float(curve.frequency.max()))
        if answer.full and len(curve):
            self._texts("names", tops)
            self._fit(self.curve.y_range, 1e6 * np.concatenate([c.amplitude for c in (curve, *answer.limits)]))
        self._contacts()
        if answer.drawing is not None:
            self._draw(answer.drawing, here)

    def _fit(self, shown: Any, values: Any) -> None:
        """A logarithmic axis that shows all values, with room for a name above."""
        known = values[np.isfinite(values) & (values > 0.0)]
        if len(known):
            low, high = float(known.min()), float(known.max())
            room = max(high / low, 1.2) ** 0.06
            shown.update(start=low / room, end=high * room**2)

    def _draw(self, found: LineDrawing | str, at: str) -> None:
        """The moving surfaces, or why there are none."""
        if isinstance(found, str):
            self.notes["motion"].text = html.escape(found)
            self._clear("quads", "nodes")
            return
        turned = [[0.0, -1.0], [1.0, 0.0]] if np.diff(np.ptp(found.points, axis=0)) > 0.0 else np.eye(2)  # views are wide
        rest, shape = 1e3 * found.points @ turned, 1e3 * found.magnification * found.amplitude @ turned
        free = [self.study.model.bodies[name].kind == "free" for name in found.body]
        fill, line = zip(*(FACES["damper" if own else ""] for own in free))
        room = np.abs(shape).max(axis=0)
        low, high = rest.min(axis=0) - room, rest.max(axis=0) + room
        self._line("box", *zip(low, high))
        parts = {"x": rest[:, 0], "y": rest[:, 1], "cx": shape[:, 0].real, "cy": shape[:, 1].real}
        parts |= {"sx": shape[:, 0].imag, "sy": shape[:, 1].imag}
        self.sources["nodes"].data = {name: value.astype(np.float32) for name, value in parts.items()}
        corners = zip("abcd", found.quads.T.astype(np.int32))
        self.sources["quads"].data = {**dict(corners), "fill": list(fill), "line": list(line)}
        self.notes["motion"].text = f"{at}, drawn {found.magnification:.0f} times as large"

    def _contacts(self) -> None:
        answer = self.shown.get("curve")
        if answer is None or answer.contacts is None or answer.loops is None:
            return
        moved, force = answer.loops.loop(where := self.loop.value)
        self._line("loop", 1e6 * moved, force)
        whole, lost = where == "whole", answer.loops.by_interface.get(where, answer.loops.lost)
        self.cycle.xaxis.axis_label = "Response (µm)" if whole else f"Sliding at {where} (µm)"
        self.cycle.yaxis.axis_label = "Contact force at the response (N)" if whole else f"Friction force at {where} (N)"
        mean = answer.contacts.share[:, 0].mean(axis=0)
        keys = zip(STATES, STATUS_COLOURS, mean)
        share = " ".join(f'<b style="color:{colour}">■</b> {name} {percent(x)}' for name, colour, x in keys)
        self.notes["contacts"].text = f"{share} of the cycle; {html.escape(where)} loses {amount(lost, 'J')}"
        names, parts, at = [], [], 0.0
        model = answer.study.problem.coupling.model
        for name in self.loop.options[1:]:
            face, rows = model.interfaces[name], answer.contacts.rows(name)
            x, y, dx, dy = face_coordinates(face.points, face.frame[0])
            y = y - y.min() + 0.5 * dy + at
            parts.append(tiles(answer.contacts.share[rows, 0], x, y, dx, dy))
            names.append((float(y.mean()), float(x.max() + 0.6 * dx), name))
            at = float(y.max() + 2.0 * dy)
        *edges, states = np.concatenate(parts, axis=1) if parts else np.zeros((5, 0))
        self.sources["tiles"].data = dict(zip((*EDGES, "color"), [*edges, [STATUS_COLOURS[int(k)] for k in states]]))
        self._texts("titles", names)

    # ---- what is clicked ----

    def chosen(self, event: Place) -> None:
        """The point of the curve that is the nearest to a click, as it is seen; none for one outside of the axes."""
        answer = self.shown.get("curve")
        if answer is None or answer.curve is None or event.x is None or event.y is None or event.y <= 0.0:
            return
        f, a = answer.curve.frequency, np.log(answer.curve.amplitude)
        apart = np.hypot((f - event.x) / np.ptp(f), (a - np.log(event.y / 1e6)) / np.ptp(a))
        self.point = int(np.argmin(apart))
        self.ask()

    def dragged(self, event: Place) -> None:
        """The preload under the pointer."""
        number = self.numbers["preload"]
        if event.x is not None and event.x > 0.0 and not number.disabled:
            number.value = float(f"{np.clip(event.x, number.low, number.high):.3g}")

    def _send(self, name: str, kind: str, content: bytes) -> None:
        self.sources["file"].data = {"name": [name], "kind": [kind], "content": [base64.b64encode(content).decode()]}

    def _results(self) -> dict[str, Any]:
        """What is shown, by the names of its files, which tell its settings and what is provisional."""
        found: dict[str, Any] = {}
        for answer in self.shown.values():
            given = f"{answer.question.preload:.3g}-N-engine-order-{answer.study.settings.engine_order}"
            parts = {"curve": answer.curve, "loop": answer.loops, "optimal": answer.optimal}
            found |= {f"{n}-{given}{'-provisional' * (not answer.full)}": p for n, p in parts.items() if p is not None}
        return found

    def pictures(self) -> None:
        """Both curves and the loop as pictures."""
        for name, result in self._results().items():
            self._send(f"{name}.png", "image/png", draw(result, "image"))

    def tables(self) -> None:
        """The same as tables."""
        with tempfile.TemporaryDirectory() as folder:
            for name, result in self._results().items():
                result.to_csv(path := Path(folder) / f"{name}.csv")
                self._send(path.name, "text/csv", path.read_bytes())

    def lines(self) -> None:
        """The lines of Python that make what is seen."""
        question = self.question()
        low, high = self.answers.band(question)
        lines = [self.source]
        if question.settings:
            lines += [
                "from bdamper.harmonic_balance.parameters import vary",
                f"study = vary(study, {dict(question.settings)!r})",
            ]
        lines.append(f"curve = study.frequency_response({question.preload!r}, ({low!r}, {high!r}))")
        if question.preloads:
            lines.append(f"optimal = study.optimal_curve({question.preloads!r}, mode={question.mode})")
        self.code.update(text="\n".join(lines), visible=True)


def logarithmic(name: str) -> bool:
    """Whether a number has a logarithmic slider."""
    return name in LOGARITHMIC_SLIDERS or "load_per_preload." in name
