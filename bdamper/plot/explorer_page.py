"""Explorer page of one window: sliders, linked plots and buttons.

Callbacks run in the thread of the server.
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

from bdamper.analyses.hysteresis import Hysteresis
from bdamper.harmonic_balance.parameters import INERTIA, MASS
from bdamper.harmonic_balance.rotor_speed import RPM
from bdamper.model.kinematics import centrifugal_load
from bdamper.plot.axes import broken, ticks_within
from bdamper.plot.contact import STATUS_COLOURS, face_coordinates, tiles
from bdamper.plot.curves import PRELOAD, with_optimum
from bdamper.plot.explorer_worker import FORCE, Answer, Answers, Question
from bdamper.plot.motion import STATES, ContactStatus, LineDrawing
from bdamper.response.optimal_curve_result import OptimalCurve
from bdamper.response.optimum_statement import statement
from bdamper.response.response_curve_result import ResponseCurve
from bdamper.response.verification import TimeResponse
from bdamper.study import Study
from bdamper.util.display import draw, in_unit_of_response
from bdamper.util.errors import import_extra
from bdamper.util.formatting import amount, peak_text, percent

EDGES = ("left", "right", "bottom", "top")
HERE = "#c0392b"
"""Colour of the chosen point and preload, used for nothing else."""
DOT = f'<b style="color:{HERE}">●</b>'
COARSE = "<i>Provisional, with one harmonic:</i> "
PANELS = {
    "curve": "Response against frequency",
    "best": "Highest peak against preload",
    "contacts": "Contacts",
    "motion": "Motion over one cycle",
}
WAITING = "being computed ..."
"""Text of a panel before its first result."""
SIZE = "12px"
"""Font size of all texts except the title and the answer."""
DAMPER = ("#e8b563", "#c08a2e")
"""Fill and line colours of free bodies."""
BODY_EDGE = "#a3aeb4"
"""Line colour of all other bodies."""
WIDE: dict[str, Any] = {"sizing_mode": "stretch_width"}
RELATIVE_RANGE = (20.0, 5000.0)
"""Range of the preload relative to the excitation, at the friction coefficient of the study."""
FACTOR_TITLES = {INERTIA: "Damper inertia (×)", MASS: "Damper mass (×)"}
"""Titles of the factor at rest, where the preload is given, and with rotation, where it follows the
mass.
"""
IN_ONE_ROW = """
            .bk-input-group { flex-direction: row; align-items: center; justify-content: space-between; }
            .bk-input-group > label { flex: 1; } .bk-input-group > :not(label) { flex: 0 0 86px; width: 86px; }
            input.bk-input { height: 24px; padding: 0 6px; font-size: inherit; }
        """
"""Style of a number field with its title to the left."""
SAVE = """
            const {name, kind, content} = source.data, link = document.createElement("a");
            Object.assign(link, {href: `data:${kind[0]};base64,${content[0]}`, download: name[0]}).click();
        """
"""JavaScript that saves the file in a data source."""
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


def _same_optimum(one: Question, other: Question) -> bool:
    """Return whether two questions have the same optimal curve."""
    return one.settings == other.settings and one.mode == other.mode


def _text_of_curve(answer: Answer, curve: ResponseCurve) -> str:
    """Describe the peak of a curve, or the reason why there is none."""
    provisional = "" if answer.full else COARSE
    if not answer.full and not curve.complete:
        return f"{provisional}the curve ends early while the slider moves."
    if not len(curve) or curve.may_be_higher or curve.peak_at_end:
        return provisional + html.escape(curve._headline())
    peak = peak_text(curve.peak.amplitude, curve.peak.frequency)
    load = f" at a preload of {amount(curve.preload, 'N')}" if curve.preload else ""
    return f"{provisional}{DOT} <b>Peak {peak}</b>{load}."


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
        self.document = document
        self.study = study
        self.source = source
        # the latest answers, and their texts
        self.shown: dict[str, Answer] = {}
        self.texts: dict[str, str] = {}
        # data sources, number fields and names of logarithmic sliders
        self.sources: dict[str, Any] = {}
        self.numbers: dict[str, Any] = {}
        self.logarithmic: set[str] = set()
        self.point: int | None = None
        self.answers = Answers(study, self._deliver)
        document.on_session_destroyed(lambda _: self.answers.ask(None))
        # not for requests without a window
        document.on_event("document_ready", lambda _: self.ask())
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
        # the window may have been closed in the meantime
        if not self.answers.closed:
            self.document.add_next_tick_callback(partial(self.show, answer))

    # ---- controls ----

    def _slider(
        self, name: str, title: str, low: float, high: float, value: float, step: float = 0.01
    ) -> Any:
        """Create a slider below a number field that shows and sets the same value.

        Logarithmic if the range is wide.
        """
        kind = int if step == 1 else float
        if high > 50.0 * low > 0.0:
            self.logarithmic.add(name)
        self.numbers[name] = self.models.NumericInput(
            name=name,
            title=title,
            value=kind(value),
            mode=kind.__name__,
            low=low,
            high=high,
            stylesheets=[IN_ONE_ROW],
            margin=(3, 5, 0, 5),
            **WIDE,
        )
        handle = f".noUi-handle {{ background: {HERE}; }}" if name == "preload" else ""
        slider = self.models.Slider(
            name=f"{name} slider",
            start=self._place(name, low),
            end=self._place(name, high),
            value=self._place(name, value),
            step=step,
            show_value=False,
            title="",
            margin=(0, 12, 2, 12),
            **WIDE,
            stylesheets=[handle],
        )
        slider.on_change("value", partial(self._slid, name))
        self.numbers[name].on_change("value", partial(self.moved, name))
        return slider

    def _controls(self) -> None:
        """Create sliders, choices, buttons and texts."""
        study = self.study
        self.force = study.excitation.amplitude or 1.0
        self.mu = max(study.settings.friction_values(), default=0.0)
        harmonics = study.settings.harmonic_numbers[-1]
        sliders: list[tuple[Any, ...]] = [
            ("preload", PRELOAD, 10.0 * self.force, 1e4 * self.force, 200.0 * self.force),
            ("friction_coefficient", "Friction coefficient", min(0.05, self.mu), 1.0, self.mu),
            (FORCE, "Excitation (N)", 0.01 * self.force, 100.0 * self.force, self.force),
            ("harmonics", "Harmonics", 1, 9, harmonics, 1),
        ]
        for name, title, load in self._further_loads():
            sliders.append((name, f"Load on {title}", 0.01 * load, 100.0 * load, load))
        sliders += self._mass_and_speed()
        self.sliders = {arguments[0]: self._slider(*arguments) for arguments in sliders}
        for control in (self.sliders["preload"], self.numbers["preload"]):
            control.disabled = not study.problem.carries_load
        # preload to which the page returns without rotation, and all values of the study
        self.resting = self.numbers["preload"].value
        self.first = {name: number.value for name, number in self.numbers.items()}
        self._choices()
        self.buttons = []
        for label, action in (
            ("Pictures", self.pictures),
            ("CSV", self.tables),
            ("Python", self.lines),
        ):
            button = self.models.Button(name=label, label=label, width=70, margin=(6, 2, 0, 3))
            button.on_click(action)
            self.buttons.append(button)
        self._text_fields()

    def _further_loads(self) -> list[tuple[str, str, float]]:
        """Return setting, title and value of all loads except the preload."""
        settings = self.study.settings
        loads: list[tuple[str, str, Any]] = []
        # at speed the loads follow from mass and radius
        if settings.speed is None:
            shares = list(settings.given_loads("load_per_preload").items())
            # the first body carries the preload
            for name, share in shares[1:]:
                loads.append((f"load_per_preload.{name}", f"{name} (N per N)", share))
        for name, load in settings.given_loads("constant_loads").items():
            loads.append((f"constant_loads.{name}", f"{name} (N)", load))
        return [
            (name, title, load) for name, title, load in loads if np.ndim(load) == 0 and load > 0.0
        ]

    def _mass_and_speed(self) -> list[tuple[Any, ...]]:
        """Return the sliders of damper mass and rotor speed if the model has loaded free bodies."""
        model = self.study.model
        bodies = model.bodies.values()
        has_damper = any(body.is_free for body in bodies)
        if not self.study.problem.carries_load or not has_damper:
            return []
        sliders: list[tuple[Any, ...]] = [("mass", FACTOR_TITLES[INERTIA], 0.1, 10.0, 1.0)]
        rotates = any(basis.speed is not None for body in bodies for basis in body.bases.values())
        if rotates:
            positions = [location.position for location in model.locations.values()]
            radius = max(float(np.hypot(*position[:2])) for position in positions)
            fastest = round(500.0 / radius * RPM)  # tip speed of 500 m/s
            sliders.append(("speed", "Rotor speed (rpm)", 0, fastest, 0, 10))
        return sliders

    def _choices(self) -> None:
        """Create the choices of mode, engine order and loop."""
        study = self.study
        model = study.model
        select = partial(self.models.Select, stylesheets=["select { font-size: inherit; }"], **WIDE)
        modes = [str(k) for k in range(1, 6)]
        self.mode = select(name="mode", title="Mode", value="1", options=modes)
        orders = []
        for order in self._engine_orders():
            diameter, _ = model.folded_nodal_diameter(order)
            orders.append((str(order), f"{order} (nodal diameter {diameter})"))
        self.order = select(
            name="order",
            title="Engine order",
            value=str(study.settings.engine_order),
            options=orders,
        )
        for chooser in (self.mode, self.order):
            chooser.on_change("value", partial(self.moved, "mode"))
        faces = [
            name
            for name in study.problem.coupling.interfaces
            if model.interfaces[name].kind == "friction"
        ]
        first = faces[0] if faces else "whole"
        self.loop = select(name="loop", title="Loop of", value=first, options=["whole", *faces])
        self.loop.on_change("value", lambda attr, old, new: self._contacts())

    def _engine_orders(self) -> list[int]:
        """Return the engine orders whose nodal diameter all constrained bodies have."""
        model = self.study.model
        of_bodies = [set(b.bases) for b in model.bodies.values() if b.kind == "constrained"]
        diameters = set.intersection(*of_bodies) if of_bodies else set()
        orders = {int(self.study.settings.engine_order)}
        for order in range(1, model.n_blades):
            diameter, _ = model.folded_nodal_diameter(order)
            if diameter in diameters:
                orders.add(order)
        return sorted(orders)

    def _text_fields(self) -> None:
        """Create the texts of the page, and the source of files to download."""
        quiet = partial(self.models.Div, styles={"color": "#5b666d"}, **WIDE)
        self.text = self.models.Div(name="answer", styles={"font-size": "14px"}, **WIDE)
        self.notes = {name: quiet(name=f"{name}_text") for name in PANELS}
        limits = "grey: without contact and with stuck contact"
        self.notes["curve"].text = f"{DOT} chosen point, ◇ time integration; {limits}"
        for name in ("best", "contacts", "motion"):
            self.notes[name].text = WAITING
        self.busy = quiet(name="busy")
        hint = "Click the curve to choose a point; drag in the curve of peaks to move the preload."
        self.help = quiet(text=hint)
        self.code = self.models.PreText(
            name="code", visible=False, styles={"white-space": "pre-wrap"}, **WIDE
        )
        file = self._source("file", "name", "kind", "content")
        file.js_on_change("data", self.models.CustomJS(args={"source": file}, code=SAVE))
        # a model belongs to the document only if another one refers to it
        self.text.tags = [file]

    def _source(self, name: str, *columns: str) -> Any:
        """Create a data source with empty columns under a name."""
        empty: dict[str, list[Any]] = {column: [] for column in columns}
        self.sources[name] = self.models.ColumnDataSource(empty, name=f"{name} data")
        return self.sources[name]

    def value(self, name: str) -> float:
        """Return the value of a number field."""
        return float(self.numbers[name].value)

    @property
    def speed(self) -> float:
        """Rotor speed in rad/s; 0 if the blades do not rotate."""
        return self.value("speed") / RPM if "speed" in self.numbers else 0.0

    def _slid(self, name: str, attr: str, old: object, new: float) -> None:
        """Set the number field to the value of its slider.

        Nothing changes if the field has moved the slider.
        """
        number = self.numbers[name]
        if abs(self._place(name, number.value) - new) <= 1e-9:
            return
        text = f"{10.0**new:.3g}" if name in self.logarithmic else f"{new:.6g}"
        value = float(text)
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
        if name == "preload" and not self.speed:
            self.resting = self.numbers["preload"].value
        elif name in ("speed", "mass"):
            self._set_preload()
        slider = self.sliders.get(name)
        if slider:
            place = self._place(name, self.value(name))
            slider.value = min(max(place, slider.start), slider.end)
        self.point = None
        self.ask()

    def _set_preload(self) -> None:
        """Set the preload to the centrifugal load, or without rotation to its former value."""
        speed = self.speed
        number = self.numbers["preload"]
        slider = self.sliders["preload"]
        if speed:
            preload = centrifugal_load(self.study.model) * self.value("mass") * speed**2
            number.title = f"{PRELOAD}, centrifugal"
        else:
            preload = self.resting
            number.title = PRELOAD
        if "mass" in self.numbers:
            self.numbers["mass"].title = FACTOR_TITLES[MASS if speed else INERTIA]
        number.low = min(number.low, preload)
        number.high = max(number.high, preload)
        slider.start = self._place("preload", number.low)
        slider.end = self._place("preload", number.high)
        number.value = float(f"{preload:.6g}")

    def question(self) -> Question:
        """Return the question for the current values.

        The range of the optimal curve is centred on the expected optimum, which is inversely
        proportional to friction.
        """
        low, high = self._optimal_range()
        carries_load = self.study.problem.carries_load
        return Question(
            settings=tuple(self._changed_settings().items()),
            preload=float(f"{self.value('preload'):.6g}") if carries_load else 0.0,
            preloads=(low, high) if carries_load else None,
            mode=int(self.mode.value),
            point=self.point,
        )

    def _changed_settings(self) -> dict[str, Any]:
        """Return the settings that differ from the study."""
        speed = self.speed
        settings: dict[str, Any] = {}
        for name, number in self.numbers.items():
            # at speed the load follows from mass and radius of the bodies
            follows = bool(speed) and name.startswith("load_per_preload.")
            is_other = name in ("preload", "mass", "speed")
            if number.value != self.first[name] and not is_other and not follows:
                settings[name] = number.value
        order = int(self.order.value)
        if order != self.study.settings.engine_order:
            settings["engine_order"] = order
        if speed:
            settings["speed"] = speed
        if "mass" in self.numbers and self.value("mass") != 1.0:
            settings[MASS if speed else INERTIA] = self.value("mass")
        return settings

    def _optimal_range(self) -> tuple[float, float]:
        """Return the preloads (N) of the optimal curve, to six digits."""
        # the optimum is inversely proportional to friction
        friction_ratio = self.mu / self.value("friction_coefficient") if self.mu else 1.0
        unit = self.value(FORCE) * friction_ratio
        low, high = RELATIVE_RANGE
        return float(f"{low * unit:.6g}"), float(f"{high * unit:.6g}")

    def ask(self) -> None:
        """Ask the question for the current values."""
        question = self.question()
        self.busy.text = "computing the curve ..."
        self.busy.visible = True
        self.code.text = ""
        self.code.visible = False
        shown = self.shown.get("optimal")
        if shown is not None and not _same_optimum(shown.question, question):
            self.texts["optimal"] = "The optimum is being computed."
            self.glyphs["optimal"].line_dash = [6]
            self.notes["best"].text = "Dashed: before the last change of settings."
        self.texts["time"] = "Time integration is running."
        for name in ("time", "range"):
            self._put(name)
        self.answers.ask(question)

    # ---- plots ----

    def _views(self) -> None:
        """Create the plots."""
        self.figure = import_extra("bokeh.plotting", "explore", "app").figure
        size: dict[str, Any] = {"min_width": 200, "min_height": 120, "sizing_mode": "stretch_both"}
        plain: dict[str, Any] = {**size, "tools": "", "toolbar_location": None}
        location = (self.study.settings.response or self.study.excitation).location
        of_amplitude: dict[str, Any] = {
            **size,
            "tools": "box_zoom,wheel_zoom,reset,hover",
            "active_drag": None,
            "toolbar_location": "right",
            "y_axis_type": "log",
            "y_axis_label": f"Amplitude at {location} (µm)",
        }
        self.curve = self._figure(
            "curve",
            **of_amplitude,
            x_axis_label="Frequency (Hz)",
            x_range=(0.0, 1.0),
            y_range=(1.0, 10.0),
        )
        self.best = self._figure(
            "best",
            **of_amplitude,
            x_axis_label=PRELOAD,
            x_axis_type="log",
            x_range=(10.0 * self.force, 1e4 * self.force),
            y_range=(1.0, 10.0),
        )
        self.faces = self._figure("faces", match_aspect=True, **plain)
        self.cycle = self._figure("cycle", x_axis_label=" ", y_axis_label=" ", **plain)
        self.motion = self._figure("motion", match_aspect=True, **plain)
        self._lines_and_marks()
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

    def _lines_and_marks(self) -> None:
        """Create the lines and marks of the curves and the loop, with an empty source each."""
        black = {"color": "black", "line_width": 2}
        grey = {"color": "#7b868c", "line_width": 1.2}
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
        # the line between the computed preloads is an interpolation
        computed = self.sources["optimal"]
        self.best.scatter("x", "y", source=computed, size=5, color="black", name="computed")

    def _figure(self, name: str, **options: Any) -> Any:
        """Create a figure with uniform font sizes, and suitable ticks on logarithmic axes."""
        view = self.figure(name=name, **options)
        for axis in view.axis:
            axis.axis_label_text_font_size = axis.major_label_text_font_size = SIZE
            axis.axis_label_text_font_style = "normal"
        view.toolbar.logo = None
        for axis, limits in ((view.xaxis[0], view.x_range), (view.yaxis[0], view.y_range)):
            if type(axis).__name__ != "LogAxis":
                continue
            axis.formatter = self.models.CustomJSTickFormatter(
                code="return String(Number(tick.toPrecision(3)))"
            )
            update = partial(self._limits_moved, axis, limits)
            for end in ("start", "end"):
                limits.on_change(end, update)
            self._tick(axis, limits)
        return view

    def _tick(self, axis: Any, limits: Any) -> None:
        """Set the ticks of a logarithmic axis to its limits."""
        low, high = sorted((limits.start, limits.end))
        axis.ticker = self.models.FixedTicker(ticks=ticks_within(low, high))

    def _limits_moved(self, axis: Any, limits: Any, attr: str, old: object, new: object) -> None:
        self._tick(axis, limits)

    def _moving(self) -> None:
        """Create the patches of the moving surfaces, drawn from the farthest to the nearest."""
        frame = self.motion.scatter("x", "y", source=self._source("box", "x", "y"), size=1, alpha=0)
        # without the surfaces, whose motion would change the limits
        for limits in (self.motion.x_range, self.motion.y_range):
            limits.renderers = [frame]
        patches = self._source("patches", "xs", "ys", "fill", "line")
        look = {"fill_color": "fill", "line_color": "line", "line_width": 0.5}
        self.motion.patches("xs", "ys", source=patches, **look)
        quads = self._source("quads", "a", "b", "c", "d", "fill", "line")
        nodes = self._source("nodes", "x", "y", "cx", "cy", "sx", "sy")
        # no glyph draws the quads themselves, so that a tag keeps them in the page
        self.text.tags += [quads]
        args = {"nodes": nodes, "faces": quads, "patches": patches}
        quads.js_on_change("data", self.models.CustomJS(args=args, code=MOVE))

    def _lay_out(self) -> None:
        """Add all models to the document; ``page.html`` places the roots."""
        layout = import_extra("bokeh.layouts", "explore", "app")
        dense = {**WIDE, "spacing": 0}
        fields = {
            name: layout.column(self.numbers[name], slider, **dense)
            for name, slider in self.sliders.items()
        }
        choices = layout.column(self.mode, self.order, **dense)
        buttons = layout.row(*self.buttons, spacing=0)
        first = layout.column(fields.pop("preload"), name="first", **dense)
        controls = layout.column(
            *fields.values(), choices, self.loop, buttons, self.help, name="controls", **dense
        )
        titles = {"Contact points": self.faces, "Hysteresis loop": self.cycle}
        tabs = [self.models.TabPanel(title=title, child=view) for title, view in titles.items()]
        contacts = self.models.Tabs(tabs=tabs, name="contacts", sizing_mode="stretch_both")
        for root in (
            self.text,
            self.busy,
            first,
            controls,
            self.curve,
            self.best,
            contacts,
            self.motion,
            *self.notes.values(),
            self.code,
        ):
            self.document.add_root(root)

    def show(self, answer: Answer | str | None) -> None:
        """Show a part of the answer, an error text, or the end of the computation (None)."""
        if answer is None or isinstance(answer, str):
            self.busy.visible = False
            if answer is not None:
                self.text.text = f"<b>No result:</b> {html.escape(answer)}"
                for note in self.notes.values():
                    note.text = note.text.replace(WAITING, "no result")
            return
        if answer.curve is not None:
            self.shown["curve"] = answer
        if answer.optimal is not None:
            self.shown["optimal"] = answer
        if answer.time_response is not None:
            self._in_time(answer.time_response)
        elif answer.curve is not None:
            self._curve(answer, answer.curve)
        if answer.optimal is not None:
            self._optimal(answer.optimal)
        if answer.full:
            next_step = "time integration" if answer.optimal else "optimum"
            self.busy.text = f"computing the {next_step} ..."
        texts = [self.texts.get(name) for name in ("curve", "time", "optimal")]
        self.text.text = " ".join(text for text in texts if text)

    def _put(self, name: str, *columns: Any) -> None:
        """Replace the columns of a data source; clear them if none are given."""
        source = self.sources[name]
        if not columns:
            source.data = {column: [] for column in source.data}
            return
        values = [column if isinstance(column, np.ndarray) else list(column) for column in columns]
        source.data = dict(zip(source.data, values))

    def _optimal(self, found: OptimalCurve) -> None:
        """Show the optimal curve with its optimum."""
        optimum = found.optimum
        preload, amplitude, _ = with_optimum(found)
        micrometres = 1e6 * amplitude
        self._put("optimal", preload, micrometres)
        self._put("optimum", [optimum.preload], [1e6 * optimum.amplitude])
        self.glyphs["optimal"].line_dash = []
        self.notes["best"].text = f"• computed preload, ★ optimum, {DOT} chosen preload"
        self._fit(self.best.y_range, micrometres)
        loads = [*preload, self.value("preload")]
        self.best.x_range.update(start=0.8 * min(loads), end=1.25 * max(loads))
        # the verdict alone: tables would leave no space for the panels
        verdict = " ".join(in_unit_of_response(found, statement(found)).verdict)
        text = f"{html.escape(verdict)}."
        if np.isfinite(optimum.preload):
            text = f"★ {peak_text(optimum.amplitude, optimum.frequency)}. {text}"
        self.texts["optimal"] = text

    def _in_time(self, found: TimeResponse) -> None:
        """Show the steady-state amplitude by time integration next to the peak."""
        if not np.isfinite(found.mean):
            self.texts["time"] = f"Time integration: {html.escape(found.status_text)}."
            return
        self._put("time", [found.frequency], [1e6 * found.mean])
        self._put("range", [found.frequency] * 2, [1e6 * found.lowest, 1e6 * found.largest])
        warning = "" if found.ok else f", {html.escape(found.status_text)}"
        self.texts["time"] = f"◇ Time integration: {found.text}{warning}."

    def _curve(self, answer: Answer, curve: ResponseCurve) -> None:
        """Show the response curve with its limits and the chosen point."""
        point = ""
        if len(curve):
            point = peak_text(curve.amplitude[answer.point], curve.frequency[answer.point])
        text = _text_of_curve(answer, curve)
        if point and answer.full and answer.question.point is not None:
            text += f" Chosen point: {point}."
        self.texts["curve"] = text
        self.glyphs["curve"].line_dash = [] if answer.full else [6]
        self._put("curve", *broken(curve.branch, curve.frequency, 1e6 * curve.amplitude))
        for name, limit in zip(("free", "stuck"), answer.limits):
            self._put(name, limit.frequency, 1e6 * limit.amplitude)
        if len(curve):
            self._mark_point(curve, answer.point)
            low = float(curve.frequency.min())
            high = float(curve.frequency.max())
            self.curve.x_range.update(start=low, end=high)
        if answer.full and len(curve):
            tops = [
                (limit.peak.frequency, 1e6 * limit.peak.amplitude, limit.kind)
                for limit in answer.limits
                if len(limit)
            ]
            self._put("names", *zip(*tops))
            amplitudes = np.concatenate([c.amplitude for c in (curve, *answer.limits)])
            self._fit(self.curve.y_range, 1e6 * amplitudes)
        self._contacts()
        if answer.drawing is not None:
            self._draw(answer.drawing, point)

    def _mark_point(self, curve: ResponseCurve, point: int) -> None:
        """Mark the chosen point, and in the curve of peaks the peak of the curve."""
        self._put("point", curve.frequency[[point]], 1e6 * curve.amplitude[[point]])
        if curve.peak_at_end or curve.may_be_higher:
            # this curve has no peak, only a lower bound of it; so no marker in the curve of peaks
            self._put("marker")
        else:
            self._put("marker", [curve.preload], [1e6 * curve.peak.amplitude])

    def _fit(self, shown: Any, values: Any) -> None:
        """Set the limits of a logarithmic axis to show all values, with space for a name above."""
        positive = values[np.isfinite(values) & (values > 0.0)]
        if not len(positive):
            return
        low = float(positive.min())
        high = float(positive.max())
        margin = max(high / low, 1.2) ** 0.06
        shown.update(start=low / margin, end=high * margin**2)

    def _draw(self, drawing: LineDrawing | str, point: str) -> None:
        """Show the moving surfaces, or the reason why there are none."""
        if isinstance(drawing, str):
            self.notes["motion"].text = html.escape(drawing)
            for name in ("quads", "nodes"):
                self._put(name)
            return
        rest = 1e3 * drawing.points
        vibration = 1e3 * drawing.magnification * drawing.amplitude
        # colours of free bodies are fixed, others become darker with the amplitude
        of_faces = np.linalg.norm(np.abs(vibration), axis=1)[drawing.quads].mean(axis=1)
        shades = colormaps["Reds"](0.8 * of_faces / max(of_faces.max(), 1e-300))
        fill = []
        line = []
        for body, shade in zip(drawing.body, shades):
            is_free = self.study.model.bodies[body].is_free
            face_fill, face_line = DAMPER if is_free else (to_hex(shade), BODY_EDGE)
            fill.append(face_fill)
            line.append(face_line)
        # the axes contain the whole motion
        reach = np.abs(vibration).max(axis=0)
        low = rest.min(axis=0) - reach
        high = rest.max(axis=0) + reach
        self._put("box", *zip(low, high))
        nodes = np.concatenate([rest, vibration.real, vibration.imag], axis=1, dtype=np.float32)
        self._put("nodes", *nodes.T)
        self._put("quads", *drawing.quads.T.astype(np.int32), fill, line)
        magnified = f"magnified {drawing.magnification:.0f} times"
        self.notes["motion"].text = f"{point}, {magnified}; darker with the amplitude"

    def _contacts(self) -> None:
        """Show the contact states and the chosen loop of the latest curve."""
        answer = self.shown.get("curve")
        if answer is None or answer.contacts is None or answer.loops is None:
            return
        self._loop(answer.loops)
        where = self.loop.value
        mean = answer.contacts.share[:, 0].mean(axis=0)
        shares = [
            f'<b style="color:{colour}">■</b> {state} {percent(share)}'
            for state, colour, share in zip(STATES, STATUS_COLOURS, mean)
        ]
        energy = answer.loops.by_interface.get(where, answer.loops.lost)
        lost = f"{html.escape(where)} dissipates {amount(energy, 'J')}"
        self.notes["contacts"].text = f"{' '.join(shares)} of the cycle; {lost}"
        self._tiles(answer.study, answer.contacts)

    def _loop(self, loops: Hysteresis) -> None:
        """Show the loop of the chosen face, or of all contacts."""
        where = self.loop.value
        displacement, force = loops.loop(where)
        self._put("loop", 1e6 * displacement, force)
        if where == "whole":
            self.cycle.xaxis.axis_label = "Response (µm)"
            self.cycle.yaxis.axis_label = "Equivalent force (N)"
        else:
            self.cycle.xaxis.axis_label = f"Relative motion at {where} (µm)"
            self.cycle.yaxis.axis_label = f"Friction force at {where} (N)"

    def _tiles(self, study: Study, contacts: ContactStatus) -> None:
        """Show the faces next to each other, each point divided by its shares of the cycle."""
        titles = []
        edges_and_states = [np.zeros((5, 0))]
        right_end = 0.0
        model = study.problem.coupling.model
        # the first option is the whole contact, the others are the names of the faces
        faces = self.loop.options[1:]
        for name in faces:
            face = model.interfaces[name]
            x, y, dx, dy = face_coordinates(face.points, face.frame[0])
            y = y - y.min() + 0.5 * dy + right_end
            share = contacts.share[contacts.rows(name), 0]
            edges_and_states.append(np.array(tiles(share, x, y, dx, dy)))
            titles.append((float(y.mean()), float(x.max() + 0.6 * dx), name))
            right_end = float(y.max() + 2.0 * dy)
        *edges, states = np.concatenate(edges_and_states, axis=1)
        self._put("tiles", *edges, [STATUS_COLOURS[int(state)] for state in states])
        self._put("titles", *zip(*titles))

    # ---- clicks and downloads ----

    def _chosen(self, event: Any) -> None:
        """Choose the point of the curve nearest to a click on the screen.

        Ignore clicks outside the axes.
        """
        answer = self.shown.get("curve")
        if answer is None or answer.curve is None:
            return
        is_inside = event.x is not None and event.y is not None and event.y > 0.0
        if not is_inside:
            return
        frequency = answer.curve.frequency
        height = np.log(answer.curve.amplitude)
        # relative to the size of the curve on the screen
        across = (frequency - event.x) / np.ptp(frequency)
        upward = (height - np.log(event.y / 1e6)) / np.ptp(height)
        self.point = int(np.argmin(np.hypot(across, upward)))
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
            order = answer.study.settings.engine_order
            settings = f"{answer.question.preload:.3g}-N-engine-order-{order}"
            if not answer.full:
                settings += "-provisional"
            parts = {"curve": answer.curve, "loop": answer.loops, "optimal": answer.optimal}
            for name, part in parts.items():
                if part is not None:
                    results[f"{name}-{settings}"] = part
        return results

    def pictures(self) -> None:
        """Download both curves and the loop as images."""
        for name, result in self._results().items():
            self._send(f"{name}.png", "image/png", draw(result, "image"))

    def tables(self) -> None:
        """Download both curves and the loop as tables."""
        with tempfile.TemporaryDirectory() as folder:
            for name, result in self._results().items():
                path = Path(folder) / f"{name}.csv"
                result.to_csv(path)
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
            arguments = f"{question.preloads!r}, mode={question.mode}"
            lines.append(f"optimal = study.optimal_curve({arguments})")
        self.code.update(text="\n".join(lines), visible=True)
