"""Explorer page of one window: sliders, linked plots and buttons.  Callbacks run in the thread of the server.

``page.html`` defines the layout and the font sizes.
"""

from __future__ import annotations

import base64
import html
import tempfile
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.colors import to_hex

from bdamper.harmonic_balance.parameters import INERTIA, MASS
from bdamper.harmonic_balance.rotor_speed import RPM
from bdamper.model.kinematics import centrifugal_load
from bdamper.plot.axes import broken, ticks_within
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

EDGES = ("left", "right", "bottom", "top")
HERE = "#c0392b"
"""Colour of the chosen point and preload, used for nothing else."""
DOT = f'<b style="color:{HERE}">●</b>'
COARSE = "<i>Provisional, with one harmonic:</i> "
PANELS = {
    "curve": "Response over frequency",
    "best": "Highest peak over preload",
    "contacts": "Contacts",
    "motion": "Motion over one cycle",
}
SIZE = "12px"
"""Font size of all texts except the title and the answer."""
DAMPER, BODY_EDGE = ("#e8b563", "#c08a2e"), "#a3aeb4"
"""Fill and line colours of free bodies, and the line colour of all others."""
FACTOR_TITLES = {INERTIA: "Damper inertia (factor)", MASS: "Damper mass (factor)"}
"""Titles of the factor at rest, where the preload is given, and with rotation, where it follows the
mass.
"""
MOVE = """
    const draw = (theta) => {
        const {x, y, cx, cy, sx, sy} = nodes.data, {a, b, c, d} = faces.data, [co, si] = [Math.cos(theta), Math.sin(theta)];
        const at = (p, c, s) => (k) => p[k] + co * c[k] - si * s[k], [u, v] = [at(x, cx, sx), at(y, cy, sy)];
        const corners = Array.from(a, (_, i) => [a[i], b[i], c[i], d[i]]);
        const [xs, ys] = [u, v].map((p) => corners.map((q) => q.map(p)));
        Object.assign(patches.data, {xs, ys, fill: faces.data.fill, line: faces.data.line});
        patches.change.emit();  // assigning data would send it to the server at every instant
    };
    draw(0);
    if (!window.moving && !matchMedia("(prefers-reduced-motion: reduce)").matches)
        window.moving = setInterval(() => document.hidden || draw(2 * Math.PI * (Date.now() % PERIOD) / PERIOD), 80);
""".replace("PERIOD", "2400")
"""JavaScript that draws the faces at successive instants of the cycle."""


class Page:
    """Sliders and plots of a study in one document.

    Parameters
    ----------
    document : bokeh.document.Document
    study : Study
    source : str
        Python code that creates the study, under the name ``study``.
    """

    def __init__(self, document: Any, study: Study, source: str) -> None:
        self.models: Any = import_extra("bokeh.models", "explore", "app")
        self.document, self.study, self.source = document, study, source
        self.shown: dict[str, Answer] = {}
        self.texts: dict[str, str] = {}
        self.sources: dict[str, Any] = {}
        self.numbers: dict[str, Any] = {}
        self.logarithmic: set[str] = set()
        self.point: int | None = None
        self.answers = Answers(study, self._deliver)
        document.on_session_destroyed(lambda _: self.answers.ask(None))
        document.on_event(
            "document_ready", lambda _: self.ask()
        )  # not for requests without a window
        document.title = "bdamper explorer"
        document.template = Path(__file__).with_name("page.html").read_text(encoding="utf-8")
        model = study.model
        sectors = f"{model.n_blades} sectors: " if model.n_blades > 1 else ""
        title = f"{sectors}{', '.join(model.bodies)} (model {model.hash})"
        document.template_variables.update(model=title, panels=list(PANELS.items()), here=HERE)
        self._controls()
        self._views()
        self._lay_out()

    def _deliver(self, answer: Answer | str | None) -> None:
        if not self.answers.closed:  # it is closed if the window was closed in the meantime
            self.document.add_next_tick_callback(partial(self.show, answer))

    # ---- controls ----

    def _slider(
        self, name: str, title: str, low: float, high: float, value: float, step: float = 0.01
    ) -> Any:
        """Create a slider below a number field that shows and sets the same value.

        Logarithmic if the range is wide.
        """
        kind, wide = int if step == 1 else float, {"sizing_mode": "stretch_width"}
        if high > 50.0 * low > 0.0:
            self.logarithmic.add(name)
        in_one_row = """
            .bk-input-group { flex-direction: row; align-items: center; justify-content: space-between; }
            .bk-input-group > label { flex: 1; } .bk-input-group > :not(label) { flex: 0 0 86px; width: 86px; }
            input.bk-input { height: 24px; padding: 0 6px; font-size: inherit; }
        """
        self.numbers[name] = self.models.NumericInput(
            name=name, title=title, value=kind(value), mode=kind.__name__, low=low, high=high, stylesheets=[in_one_row],
            margin=(3, 5, 0, 5), **wide,
        )  # fmt: skip
        start, end, place = (self._place(name, item) for item in (low, high, value))
        slider = self.models.Slider(
            name=f"{name} slider", start=start, end=end, value=place, step=step, show_value=False, title="",
            margin=(0, 12, 2, 12), **wide,
            stylesheets=[f".noUi-handle {{ background: {HERE}; }}" if name == "preload" else ""],
        )  # fmt: skip
        slider.on_change("value", partial(self._slid, name))
        self.numbers[name].on_change("value", partial(self.moved, name))
        return slider

    def _controls(self) -> None:
        study, model = self.study, self.study.model
        self.force = study.excitation.amplitude or 1.0
        self.mu = max(study.settings.friction_values(), default=0.0)
        rows: list[tuple[Any, ...]] = [
            ("preload", PRELOAD, 10.0 * self.force, 1e4 * self.force, 200.0 * self.force),
            ("friction_coefficient", "Friction coefficient", min(0.05, self.mu), 1.0, self.mu),
            (FORCE, "Excitation (N)", 0.01 * self.force, 100.0 * self.force, self.force),
            ("harmonics", "Harmonics", 1, 9, study.settings.harmonic_numbers[-1], 1),
        ]
        given = study.settings.given_loads
        shares = {} if study.settings.speed is not None else given("load_per_preload")
        loads = [
            (f"load_per_preload.{name}", f"{name} (N per N)", share)
            for name, share in list(shares.items())[1:]
        ]
        loads += [
            (f"constant_loads.{name}", f"{name} (N)", load)
            for name, load in given("constant_loads").items()
        ]
        rows += [
            (name, f"Load on {title}", 0.01 * load, 100.0 * load, load)
            for name, title, load in loads if np.ndim(load) == 0 and load > 0.0
        ]  # fmt: skip
        if study.problem.carries_load and any(
            body.kind == "free" for body in model.bodies.values()
        ):
            rows.append(("mass", FACTOR_TITLES[INERTIA], 0.1, 10.0, 1.0))
            if any(
                basis.speed is not None
                for body in model.bodies.values()
                for basis in body.bases.values()
            ):
                radius = max(
                    float(np.hypot(*location.position[:2])) for location in model.locations.values()
                )
                fastest = round(500.0 / radius * RPM)  # tip speed of 500 m/s
                rows.append(("speed", "Rotor speed (rpm)", 0, fastest, 0, 10))
        self.sliders = {row[0]: self._slider(*row) for row in rows}
        for control in (self.sliders["preload"], self.numbers["preload"]):
            control.disabled = not study.problem.carries_load
        self.resting = self.numbers["preload"].value
        self.first = {name: number.value for name, number in self.numbers.items()}
        known = [set(b.bases) for b in model.bodies.values() if b.kind == "constrained"]
        diameters = set.intersection(*known) if known else set()
        folded = model.folded_nodal_diameter
        numbers = {n for n in range(1, model.n_blades) if folded(n)[0] in diameters} | {
            int(study.settings.engine_order)
        }
        orders = [(str(n), f"{n} (nodal diameter {folded(n)[0]})") for n in sorted(numbers)]
        faces = [
            name
            for name in study.problem.coupling.interfaces
            if model.interfaces[name].kind == "friction"
        ]
        wide = {"sizing_mode": "stretch_width"}
        select = partial(self.models.Select, stylesheets=["select { font-size: inherit; }"], **wide)
        self.mode = select(
            name="mode", title="Mode", value="1", options=[str(k) for k in range(1, 6)]
        )
        self.order = select(
            name="order",
            title="Engine order",
            value=str(study.settings.engine_order),
            options=orders,
        )
        self.loop = select(
            name="loop", title="Loop of", value=[*faces, "whole"][0], options=["whole", *faces]
        )
        for chooser in (self.mode, self.order):
            chooser.on_change("value", partial(self.moved, "mode"))
        self.loop.on_change("value", lambda attr, old, new: self._contacts())
        self.buttons = []
        for label, action in (
            ("Pictures", self.pictures),
            ("CSV", self.tables),
            ("Python", self.lines),
        ):
            self.buttons.append(
                self.models.Button(name=label, label=label, width=70, margin=(6, 2, 0, 3))
            )
            self.buttons[-1].on_click(action)
        quiet = partial(self.models.Div, styles={"color": "#5b666d"}, **wide)
        self.text = self.models.Div(name="answer", styles={"font-size": "14px"}, **wide)
        self.notes = {name: quiet(name=f"{name}_text") for name in PANELS}
        self.notes[
            "curve"
        ].text = f"{DOT} chosen point, ◇ in time; grey: without contact and with stuck contact"
        self.busy = quiet(name="busy")
        self.help = quiet(
            text="Click the curve to choose a point; drag in the curve of peaks to move the preload."
        )
        self.code = self.models.PreText(
            name="code", visible=False, styles={"white-space": "pre-wrap"}, **wide
        )
        save = """
            const {name, kind, content} = source.data, link = document.createElement("a");
            Object.assign(link, {href: `data:${kind[0]};base64,${content[0]}`, download: name[0]}).click();
        """
        file = self._source("file", "name", "kind", "content")
        file.js_on_change("data", self.models.CustomJS(args={"source": file}, code=save))
        self.text.tags = [file]  # a model belongs to the document only if another one refers to it

    def _source(self, name: str, *columns: str) -> Any:
        """Create a data source with empty columns under a name."""
        self.sources[name] = self.models.ColumnDataSource(
            {column: [] for column in columns}, name=f"{name} data"
        )
        return self.sources[name]

    def value(self, name: str) -> float:
        """Return the value of a number field."""
        return float(self.numbers[name].value)

    @property
    def speed(self) -> float:
        """Rotor speed in rad/s; 0 if the blades do not rotate."""
        return self.value("speed") / RPM if "speed" in self.numbers else 0.0

    def _slid(self, name: str, attr: str, old: object, new: float) -> None:
        """Set the number field to the value of its slider, unless the field has moved the slider."""
        number = self.numbers[name]
        if abs(self._place(name, number.value) - new) > 1e-9:
            value = float(f"{10.0**new:.3g}" if name in self.logarithmic else f"{new:.6g}")
            number.value = int(value) if number.mode == "int" else value

    def _place(self, name: str, value: float) -> float:
        """Return the slider position of a value."""
        return float(np.log10(value) if name in self.logarithmic else value)

    def moved(self, name: str, attr: str, old: object, new: object) -> None:
        """Handle a changed value.

        With rotation the preload is set to the centrifugal load; without rotation it is set to its
        former value.
        """
        if new is None:  # an empty field
            self.numbers[name].value = old
            return
        speed = self.speed
        number, slider = self.numbers["preload"], self.sliders["preload"]
        if name == "preload" and not speed:
            self.resting = number.value
        elif name in ("speed", "mass"):
            preload = (
                centrifugal_load(self.study.model) * self.value("mass") * speed**2
                if speed
                else self.resting
            )
            number.title = PRELOAD + (", centrifugal" if speed else "")
            if "mass" in self.numbers:
                self.numbers["mass"].title = FACTOR_TITLES[MASS if speed else INERTIA]
            number.low, number.high = min(number.low, preload), max(number.high, preload)
            slider.start, slider.end = (
                self._place("preload", end) for end in (number.low, number.high)
            )
            number.value = float(f"{preload:.6g}")
        if slider := self.sliders.get(name):
            slider.value = min(max(self._place(name, self.value(name)), slider.start), slider.end)
        self.point = None
        self.ask()

    def question(self) -> Question:
        """Return the question for the current values.

        The range of the optimal curve is centred on the expected optimum, which is inversely
        proportional to friction.
        """
        speed = self.speed  # at speed the load follows from mass and radius of the bodies
        settings: dict[str, Any] = {
            name: number.value
            for name, number in self.numbers.items()
            if number.value != self.first[name]
            and not (
                name in ("preload", "mass", "speed")
                or (speed and name.startswith("load_per_preload."))
            )
        }
        if int(self.order.value) != self.study.settings.engine_order:
            settings["engine_order"] = int(self.order.value)
        if speed:
            settings["speed"] = speed
        if "mass" in self.numbers and self.value("mass") != 1.0:
            settings[MASS if speed else INERTIA] = self.value("mass")
        unit = self.value(FORCE) * (
            self.mu / self.value("friction_coefficient") if self.mu else 1.0
        )
        # range of the preload relative to the excitation, at the friction coefficient of the study
        relative_range = (20.0, 5000.0)
        low, high = (float(f"{end * unit:.6g}") for end in relative_range)
        loaded = self.study.problem.carries_load
        preload, preloads = (
            (float(f"{self.value('preload'):.6g}"), (low, high)) if loaded else (0.0, None)
        )
        return Question(
            tuple(settings.items()), preload, preloads, int(self.mode.value), self.point
        )

    def ask(self) -> None:
        """Ask the question for the current values."""
        question, shown = self.question(), self.shown.get("optimal")
        self.busy.text, self.busy.visible, self.code.text = "computing the curve ...", True, ""
        self.code.visible = False
        if shown is not None and (shown.question.settings, shown.question.mode) != (
            question.settings,
            question.mode,
        ):
            self.texts["optimal"] = "The optimum is being computed."
            self.glyphs["optimal"].line_dash = [6]
            self.notes["best"].text = "Dashed: before the last change of settings."
        self.texts["time"] = "The amplitude in time is being computed."
        for name in ("time", "range"):
            self._put(name)
        self.answers.ask(question)

    # ---- plots ----

    def _views(self) -> None:
        self.figure = import_extra("bokeh.plotting", "explore", "app").figure
        size: dict[str, Any] = {"min_width": 200, "min_height": 120, "sizing_mode": "stretch_both"}
        plain: dict[str, Any] = {**size, "tools": "", "toolbar_location": None}
        tools = {
            "tools": "box_zoom,wheel_zoom,reset,hover",
            "active_drag": None,
            "toolbar_location": "right",
        }
        location = (self.study.settings.response or self.study.excitation).location
        high: dict[str, Any] = {
            **size,
            **tools,
            "y_axis_type": "log",
            "y_axis_label": f"Amplitude at {location} (µm)",
        }
        self.curve = self._figure(
            "curve", **high, x_axis_label="Frequency (Hz)", x_range=(0.0, 1.0), y_range=(1.0, 10.0)
        )
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
        for name, view, look in (
            ("free", self.curve, {**grey, "line_dash": "dotdash"}),
            ("stuck", self.curve, {**grey, "line_dash": "dotted"}),
            ("curve", self.curve, black),
            ("optimal", self.best, black),
            ("loop", self.cycle, black),
            ("optimum", self.best, star),
            ("point", self.curve, ring),
            ("marker", self.best, ring),
            ("range", self.curve, black),
            ("time", self.curve, diamond),
        ):
            add = view.scatter if "size" in look else view.line
            self.glyphs[name] = add("x", "y", source=self._source(name, "x", "y"), **look).glyph
        self.faces.quad(
            **{name: name for name in EDGES},
            color="color",
            source=self._source("tiles", *EDGES, "color"),
        )
        for name, view, text in (
            ("names", self.curve, {"text_color": "#5b666d", "y_offset": -3}),
            ("titles", self.faces, {"text_align": "center"}),
        ):
            view.text(
                "x",
                "y",
                "text",
                source=self._source(name, "x", "y", "text"),
                text_font_size=SIZE,
                **text,
            )
        for view in (self.faces, self.motion):
            view.axis.visible = view.grid.visible = False
            view.outline_line_color = None
        self._moving()
        self.curve.on_event("tap", self._chosen)
        for event in ("tap", "pan"):
            self.best.on_event(event, self._dragged)

    def _figure(self, name: str, **options: Any) -> Any:
        """Create a figure with uniform font sizes, and suitable ticks on logarithmic axes."""
        view = self.figure(name=name, **options)
        for axis in view.axis:
            axis.axis_label_text_font_size = axis.major_label_text_font_size = SIZE
            axis.axis_label_text_font_style = "normal"
        view.toolbar.logo = None
        for axis, shown in ((view.xaxis[0], view.x_range), (view.yaxis[0], view.y_range)):
            if type(axis).__name__ == "LogAxis":
                axis.formatter = self.models.CustomJSTickFormatter(
                    code="return String(Number(tick.toPrecision(3)))"
                )
                for end in ("start", "end"):
                    shown.on_change(
                        end, lambda attr, old, new, axis=axis, shown=shown: self._tick(axis, shown)
                    )
                self._tick(axis, shown)
        return view

    def _tick(self, axis: Any, shown: Any) -> None:
        axis.ticker = self.models.FixedTicker(ticks=ticks_within(*sorted((shown.start, shown.end))))

    def _moving(self) -> None:
        """Create the patches of the moving surfaces, drawn from the farthest to the nearest."""
        frame = self.motion.scatter("x", "y", source=self._source("box", "x", "y"), size=1, alpha=0)
        for shown in (self.motion.x_range, self.motion.y_range):
            shown.renderers = [frame]  # without the surfaces, whose motion would change the limits
        patches = self._source("patches", "xs", "ys", "fill", "line")
        look = {"fill_color": "fill", "line_color": "line", "line_width": 0.5}
        self.motion.patches("xs", "ys", source=patches, **look)
        quads = self._source("quads", *"abcd", "fill", "line")
        nodes = self._source("nodes", "x", "y", "cx", "cy", "sx", "sy")
        self.text.tags += [quads]
        args = {"nodes": nodes, "faces": quads, "patches": patches}
        quads.js_on_change("data", self.models.CustomJS(args=args, code=MOVE))

    def _lay_out(self) -> None:
        layout, wide = (
            import_extra("bokeh.layouts", "explore", "app"),
            {"sizing_mode": "stretch_width", "spacing": 0},
        )
        pairs = [
            layout.column(self.numbers[name], slider, **wide)
            for name, slider in self.sliders.items()
        ]
        choices, buttons = (
            layout.row(self.mode, self.order, **wide),
            layout.row(*self.buttons, spacing=0),
        )
        first = layout.column(pairs.pop(list(self.sliders).index("preload")), name="first", **wide)
        controls = layout.column(
            *pairs, choices, self.loop, buttons, self.help, name="controls", **wide
        )
        titles = {"Contact points": self.faces, "Hysteresis loop": self.cycle}
        tabs = [self.models.TabPanel(title=title, child=view) for title, view in titles.items()]
        contacts = self.models.Tabs(tabs=tabs, name="contacts", sizing_mode="stretch_both")
        views = [self.curve, self.best, contacts, self.motion]
        for root in (
            self.text,
            self.busy,
            first,
            controls,
            *views,
            *self.notes.values(),
            self.code,
        ):
            self.document.add_root(root)

    def show(self, answer: Answer | str | None) -> None:
        """Show a part of the answer, an error text, or the end of the computation (None)."""
        if answer is None or isinstance(answer, str):
            self.busy.visible = False
            if answer is not None:
                self.text.text = f"<b>No answer:</b> {html.escape(answer)}"
            return
        for name in ("curve", "optimal"):
            if getattr(answer, name) is not None:
                self.shown[name] = answer
        if answer.time_response is not None:
            self._in_time(answer.time_response)
        elif answer.curve is not None:
            self._curve(answer, answer.curve)
        if answer.optimal is not None:
            self._optimal(answer.optimal)
        if answer.full:
            self.busy.text = (
                f"computing the {'amplitude in time' if answer.optimal else 'optimum'} ..."
            )
        self.text.text = " ".join(
            self.texts[name] for name in ("curve", "time", "optimal") if self.texts.get(name)
        )

    def _put(self, name: str, *columns: Any) -> None:
        """Replace the columns of a data source; clear them if none are given."""
        source, values = (
            self.sources[name],
            (v if isinstance(v, np.ndarray) else [*v] for v in columns),
        )
        source.data = (
            dict(zip(source.data, values)) if columns else {column: [] for column in source.data}
        )

    def _optimal(self, found: OptimalCurve) -> None:
        """Show the optimal curve with its optimum."""
        o, (x, amplitude, _) = found.optimum, with_optimum(found)
        y = 1e6 * amplitude
        self._put("optimal", x, y)
        self._put("optimum", [o.preload], [1e6 * o.amplitude])
        self.glyphs["optimal"].line_dash = []
        self.notes["best"].text = f"★ optimum, {DOT} chosen preload"
        self._fit(self.best.y_range, y)
        loads = [*x, self.value("preload")]
        self.best.x_range.update(start=0.8 * min(loads), end=1.25 * max(loads))
        star = "★ " if np.isfinite(o.preload) else ""
        self.texts["optimal"] = star + html.escape(found._headline())

    def _in_time(self, found: TimeResponse) -> None:
        """Show the steady-state amplitude in time next to the peak."""
        if not np.isfinite(found.mean):
            self.texts["time"] = f"In time: {html.escape(found.status)}."
            return
        self._put("time", [found.frequency], [1e6 * found.mean])
        self._put("range", [found.frequency] * 2, [1e6 * found.lowest, 1e6 * found.largest])
        warning = "" if found.status.startswith("complete") else f", {html.escape(found.status)}"
        self.texts["time"] = f"◇ In time {found.text}{warning}."

    def _curve(self, answer: Answer, curve: ResponseCurve) -> None:
        """Show the response curve with its limits and the chosen point."""
        point = (
            peak_text(curve.amplitude[answer.point], curve.frequency[answer.point])
            if len(curve)
            else ""
        )
        chosen = (
            f" Chosen point: {point}."
            if point and answer.full and answer.question.point is not None
            else ""
        )
        whole = answer.full or curve.complete
        if whole and len(curve) and not curve.may_be_higher and not curve.peak_at_end:
            peak, load = (
                peak_text(curve.peak.amplitude, curve.peak.frequency),
                amount(curve.preload, "N"),
            )
            text = f"{DOT} <b>Peak {peak}</b>" + (
                f" at a preload of {load}." if curve.preload else "."
            )
        else:
            text = (
                html.escape(curve._headline())
                if whole
                else "the curve ends early while the slider moves."
            )
        self.texts["curve"] = ("" if answer.full else COARSE) + text + chosen
        self.glyphs["curve"].line_dash = [] if answer.full else [6]
        self._put("curve", *broken(curve.branch, curve.frequency, 1e6 * curve.amplitude))
        tops = [
            (limit.peak.frequency, 1e6 * limit.peak.amplitude, limit.kind)
            for limit in answer.limits
            if len(limit)
        ]
        for name, limit in zip(("free", "stuck"), answer.limits):
            self._put(name, limit.frequency, 1e6 * limit.amplitude)
        if len(curve):
            self._put(
                "point", curve.frequency[[answer.point]], 1e6 * curve.amplitude[[answer.point]]
            )
            # the curve of the preload shows lower bounds; the marker belongs to peaks
            is_peak = [] if curve.peak_at_end or curve.may_be_higher else [curve.peak]
            self._put(
                "marker",
                [curve.preload for _ in is_peak],
                [1e6 * peak.amplitude for peak in is_peak],
            )
            self.curve.x_range.update(
                start=float(curve.frequency.min()), end=float(curve.frequency.max())
            )
        if answer.full and len(curve):
            self._put("names", *zip(*tops))
            self._fit(
                self.curve.y_range,
                1e6 * np.concatenate([c.amplitude for c in (curve, *answer.limits)]),
            )
        self._contacts()
        if answer.drawing is not None:
            self._draw(answer.drawing, point)

    def _fit(self, shown: Any, values: Any) -> None:
        """Set the limits of a logarithmic axis to show all values, with space for a name above."""
        known = values[np.isfinite(values) & (values > 0.0)]
        if len(known):
            low, high = float(known.min()), float(known.max())
            margin = max(high / low, 1.2) ** 0.06
            shown.update(start=low / margin, end=high * margin**2)

    def _draw(self, drawing: LineDrawing | str, point: str) -> None:
        """Show the moving surfaces, or the reason why there are none."""
        if isinstance(drawing, str):
            self.notes["motion"].text = html.escape(drawing)
            for name in ("quads", "nodes"):
                self._put(name)
            return
        rest, shape = 1e3 * drawing.points, 1e3 * drawing.magnification * drawing.amplitude
        free = [self.study.model.bodies[name].kind == "free" for name in drawing.body]
        vibration = np.linalg.norm(np.abs(shape), axis=1)[drawing.quads].mean(axis=1)
        shades = colormaps["Reds"](0.8 * vibration / max(vibration.max(), 1e-300))
        fill, line = zip(
            *(
                DAMPER if is_free else (to_hex(shade), BODY_EDGE)
                for is_free, shade in zip(free, shades)
            )
        )
        margin = np.abs(shape).max(axis=0)
        low, high = rest.min(axis=0) - margin, rest.max(axis=0) + margin
        self._put("box", *zip(low, high))
        self._put(
            "nodes", *np.concatenate([rest, shape.real, shape.imag], axis=1, dtype=np.float32).T
        )
        self._put("quads", *drawing.quads.T.astype(np.int32), fill, line)
        self.notes[
            "motion"
        ].text = f"{point}, magnified {drawing.magnification:.0f} times; darker with the amplitude"

    def _contacts(self) -> None:
        answer = self.shown.get("curve")
        if answer is None or answer.contacts is None or answer.loops is None:
            return
        displacement, force = answer.loops.loop(where := self.loop.value)
        self._put("loop", 1e6 * displacement, force)
        whole, energy = where == "whole", answer.loops.by_interface.get(where, answer.loops.lost)
        self.cycle.xaxis.axis_label = (
            "Response (µm)" if whole else f"Relative motion at {where} (µm)"
        )
        self.cycle.yaxis.axis_label = (
            "Equivalent force (N)" if whole else f"Friction force at {where} (N)"
        )
        mean = answer.contacts.share[:, 0].mean(axis=0)
        keys = zip(STATES, STATUS_COLOURS, mean)
        share = " ".join(
            f'<b style="color:{colour}">■</b> {name} {percent(x)}' for name, colour, x in keys
        )
        self.notes[
            "contacts"
        ].text = f"{share} of the cycle; {html.escape(where)} dissipates {amount(energy, 'J')}"
        names, parts, offset = [], [], 0.0
        model = answer.study.problem.coupling.model
        for name in self.loop.options[1:]:
            face, rows = model.interfaces[name], answer.contacts.rows(name)
            x, y, dx, dy = face_coordinates(face.points, face.frame[0])
            y = y - y.min() + 0.5 * dy + offset
            parts.append(tiles(answer.contacts.share[rows, 0], x, y, dx, dy))
            names.append((float(y.mean()), float(x.max() + 0.6 * dx), name))
            offset = float(y.max() + 2.0 * dy)
        *edges, states = np.concatenate(parts, axis=1) if parts else np.zeros((5, 0))
        self._put("tiles", *edges, [STATUS_COLOURS[int(k)] for k in states])
        self._put("titles", *zip(*names))

    # ---- clicks and downloads ----

    def _chosen(self, event: Any) -> None:
        """Choose the point of the curve nearest to a click on the screen.

        Ignore clicks outside the axes.
        """
        answer = self.shown.get("curve")
        if (
            answer is None
            or answer.curve is None
            or event.x is None
            or event.y is None
            or event.y <= 0.0
        ):
            return
        f, a = answer.curve.frequency, np.log(answer.curve.amplitude)
        distance = np.hypot((f - event.x) / np.ptp(f), (a - np.log(event.y / 1e6)) / np.ptp(a))
        self.point = int(np.argmin(distance))
        self.ask()

    def _dragged(self, event: Any) -> None:
        """Set the preload to the pointer position."""
        number = self.numbers["preload"]
        if event.x is not None and event.x > 0.0 and not number.disabled:
            number.value = float(f"{np.clip(event.x, number.low, number.high):.3g}")

    def _send(self, name: str, kind: str, content: bytes) -> None:
        self._put("file", [name], [kind], [base64.b64encode(content).decode()])

    def _results(self) -> dict[str, Any]:
        """Return the shown results by file name, with settings and "provisional" in the name."""
        results: dict[str, Any] = {}
        for answer in self.shown.values():
            settings = (
                f"{answer.question.preload:.3g}-N-engine-order-{answer.study.settings.engine_order}"
            )
            settings += "-provisional" * (not answer.full)
            parts = {"curve": answer.curve, "loop": answer.loops, "optimal": answer.optimal}
            results |= {
                f"{name}-{settings}": part for name, part in parts.items() if part is not None
            }
        return results

    def pictures(self) -> None:
        """Download both curves and the loop as images."""
        for name, result in self._results().items():
            self._send(f"{name}.png", "image/png", draw(result, "image"))

    def tables(self) -> None:
        """Download both curves and the loop as tables."""
        with tempfile.TemporaryDirectory() as folder:
            for name, result in self._results().items():
                result.to_csv(path := Path(folder) / f"{name}.csv")
                self._send(path.name, "text/csv", path.read_bytes())

    def lines(self) -> None:
        """Show the Python code that computes the shown results."""
        question = self.question()
        low, high = self.answers.band(question)
        lines = [self.source]
        if question.settings:
            lines.append(f"study = study.replace(**{dict(question.settings)!r})")
        lines.append(f"curve = study.frequency_response({question.preload!r}, ({low!r}, {high!r}))")
        if question.preloads:
            lines.append(
                f"optimal = study.optimal_curve({question.preloads!r}, mode={question.mode})"
            )
        self.code.update(text="\n".join(lines), visible=True)
