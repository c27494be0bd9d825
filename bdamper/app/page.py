"""What one window shows: sliders, linked views, buttons; its callbacks run in the thread of the server."""

from __future__ import annotations

import base64
import html
import tempfile
from functools import partial
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from bdamper.app.answers import Answer, Answers, Question, tiles
from bdamper.model.coupling import centrifugal_load
from bdamper.plot.contact import STATUS_COLOURS, face_coordinates
from bdamper.plot.motion import STATES
from bdamper.problem.at_speed import RPM
from bdamper.study import Study
from bdamper.util.errors import needed
from bdamper.util.plotting import draw
from bdamper.util.text import amount, height, percent

PRELOAD = "Preload (N)"
LOGARITHMIC = ("preload", "excitation.amplitude", "mass")
EDGES = ("left", "right", "bottom", "top")
COARSE = "<i>Provisional, with one harmonic:</i> "


class Place(Protocol):
    """Where a view was clicked, in its own units; None beside its axes."""

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
        self.models: Any = needed("bokeh.models", "explore", "app")
        self.document, self.study, self.source = document, study, source
        self.shown: dict[str, Answer] = {}
        self.point: int | None = None
        self.answers = Answers(study, lambda answer: document.add_next_tick_callback(partial(self.show, answer)))
        document.on_session_destroyed(lambda _: self.answers.ask(None))
        document.title = "bdamper explorer"
        self._controls()
        self._views()
        self._lay_out()
        self.ask()

    # ---- what is moved ----

    def _slider(self, name: str, title: str, low: float, high: float, value: float, step: float = 0.01) -> Any:
        look: dict[str, Any] = {"name": name, "title": title, "step": step, "sizing_mode": "stretch_width"}
        if name in LOGARITHMIC:
            low, high, value = (float(np.log10(v)) for v in (low, high, value))
            look["format"] = self.models.CustomJSTickFormatter(code="return String(Number((10**tick).toPrecision(3)))")
        slider = self.models.Slider(start=low, end=high, value=value, **look)
        slider.on_change("value", partial(self.moved, name))
        return slider

    def _controls(self) -> None:
        study, model = self.study, self.study.model
        force, mu = study.excitation.amplitude or 1.0, max(study.friction_by_interface().values(), default=0.0)
        self.preloads = (10.0 * force, 1e4 * force)
        rows: list[tuple[Any, ...]] = [
            ("preload", PRELOAD, *self.preloads, 200.0 * force),
            ("friction_coefficient", "Friction coefficient", min(0.05, mu), 1.0, mu),
            ("excitation.amplitude", "Excitation (N)", 0.01 * force, 100.0 * force, force),
            ("harmonics", "Harmonics", 1, 9, study.harmonic_numbers[-1], 1),
        ]
        if study.carries_load and any(body.kind == "free" for body in model.bodies.values()):
            rows.append(("mass", "Damper mass (factor)", 0.1, 10.0, 1.0))
            if any(basis.speed is not None for body in model.bodies.values() for basis in body.bases.values()):
                radius = max(float(np.hypot(*place.position[:2])) for place in model.locations.values())
                fastest = 500.0 / radius * RPM  # at which the tip has 500 m/s
                rows.append(("speed", "Rotor speed (rpm); 0: off", 0, fastest, 0, 10))
        self.sliders = {row[0]: self._slider(*row) for row in rows}
        self.sliders["preload"].disabled = not study.carries_load
        self.resting = self.sliders["preload"].value
        self.first = {name: slider.value for name, slider in self.sliders.items()}
        diameters = set.intersection(*(set(b.bases) for b in model.bodies.values() if b.kind == "constrained"))
        wave = model.folded_nodal_diameter
        met = {n for n in range(1, model.n_blades) if wave(n)[0] in diameters} | {int(study.engine_order)}
        orders = [(str(n), f"{n} (nodal diameter {wave(n)[0]})") for n in sorted(met)]
        faces = [name for name in study.coupling.interfaces if model.interfaces[name].kind == "friction"]
        select = partial(self.models.Select, sizing_mode="stretch_width")
        self.mode = select(name="mode", title="Mode", value="1", options=[str(k) for k in range(1, 6)])
        self.order = select(name="order", title="Engine order", value=str(study.engine_order), options=orders)
        self.loop = select(name="loop", title="Loop of", value=[*faces, "whole"][0], options=["whole", *faces])
        for chooser in (self.mode, self.order):
            chooser.on_change("value", partial(self.moved, "mode"))
        self.loop.on_change("value", lambda attr, old, new: self._contacts())
        self.buttons = [self.models.Button(name=label, label=label, width=80) for label in ("Pictures", "CSV", "Python")]
        for button, action in zip(self.buttons, (self.pictures, self.tables, self.lines)):
            button.on_click(action)
        self.text, self.least = (self.models.Div(name=name) for name in ("text", "least"))
        self.busy = self.models.Div(name="busy", styles={"position": "absolute", "right": "0"})
        self.code = self.models.PreText(name="code", styles={"white-space": "pre-wrap"})
        self.file = self.models.ColumnDataSource({"name": [], "kind": [], "content": []}, name="file")
        self.text.tags = [self.file]  # so that it belongs to the document
        save = """
            const {name, kind, content} = source.data, link = document.createElement("a");
            Object.assign(link, {href: `data:${kind[0]};base64,${content[0]}`, download: name[0]}).click();
        """
        self.file.js_on_change("data", self.models.CustomJS(args={"source": self.file}, code=save))

    def value(self, name: str) -> float:
        """Of a slider, in the unit that it shows."""
        value = float(self.sliders[name].value)
        return float(10.0**value) if name in LOGARITHMIC else value

    def moved(self, name: str, attr: str, old: object, new: object) -> None:
        """A slider has another value: at speed the preload is the centrifugal one, at rest again what it was before."""
        slider = self.sliders["preload"]
        turns = self.value("speed") / RPM if "speed" in self.sliders else 0.0
        if name == "preload" and not turns:
            self.resting = slider.value
        elif name in ("speed", "mass"):
            own = np.log10(centrifugal_load(self.study.model) * self.value("mass") * turns**2) if turns else self.resting
            slider.title = PRELOAD + (", centrifugal" if turns else "")
            slider.start, slider.end, slider.value = min(slider.start, own), max(slider.end, own), float(own)
        self.point = None
        self.ask()

    def question(self) -> Question:
        """What the sliders ask."""
        settings: dict[str, Any] = {
            name: self.value(name)
            for name, slider in self.sliders.items()
            if name not in ("preload", "mass", "speed") and slider.value != self.first[name]
        }
        if "harmonics" in settings:
            settings["harmonics"] = int(settings["harmonics"])
        if int(self.order.value) != self.study.engine_order:
            settings["engine_order"] = int(self.order.value)
        turning = "speed" in self.sliders and self.value("speed") > 0.0
        if turning:
            settings["speed"] = self.value("speed") / RPM
        if "mass" in self.sliders and self.sliders["mass"].value != self.first["mass"]:
            settings["damper_mass" if turning else "damper_mass_factor"] = self.value("mass")
        preload, preloads = (self.value("preload"), self.preloads) if self.study.carries_load else (0.0, None)
        return Question(tuple(settings.items()), float(f"{preload:.6g}"), preloads, int(self.mode.value), self.point)

    def ask(self) -> None:
        """Ask what the sliders stand for now."""
        question, before = self.question(), self.shown.get("optimal")
        self.busy.visible, self.busy.text, self.code.text = True, "<i>computing ...</i>", ""
        if before is not None and (before.question.settings, before.question.mode) != (question.settings, question.mode):
            self.least.text = "<i>The optimal curve is still that of the settings before.</i>"
        self.answers.ask(question)

    # ---- what is seen ----

    def _views(self) -> None:
        figure = needed("bokeh.plotting", "explore", "app").figure
        size = {"height": 330, "min_width": 340, "toolbar_location": None, "tools": "", "sizing_mode": "stretch_width"}
        zoomed = {"tools": "box_zoom,wheel_zoom,reset,hover", "active_drag": None, "toolbar_location": "right"}
        seen = self.study.response or self.study.excitation
        high = {**size, **zoomed, "y_axis_type": "log", "y_axis_label": f"Amplitude at {seen.location} (µm)"}
        self.curve = figure(title="Tracking curve", x_axis_label="Frequency (Hz)", **high)
        self.best = figure(title="Optimal curve", x_axis_label="Preload (N)", x_axis_type="log", **high)
        self.faces = figure(title="Contact points", match_aspect=True, **size)
        self.cycle = figure(title="Hysteresis loop", x_axis_label=" ", y_axis_label=" ", **size)
        self.sources, self.glyphs = {}, {}
        for name, view, look in (
            ("free", self.curve, {"color": "#888888", "line_dash": "dotdash", "legend_label": "free"}),
            ("stuck", self.curve, {"color": "#888888", "line_dash": "dotted", "legend_label": "stuck"}),
            ("curve", self.curve, {"color": "black", "line_width": 2, "legend_label": "tracking curve"}),
            ("optimal", self.best, {"color": "black", "line_width": 2}),
            ("loop", self.cycle, {"color": "black", "line_width": 2}),
            ("point", self.curve, {"size": 13, "color": "#c0392b"}),
            ("optimum", self.best, {"size": 18, "marker": "star", "color": "black"}),
            ("marker", self.best, {"size": 13, "color": "#c0392b"}),
        ):
            source = self.sources[name] = self.models.ColumnDataSource({"x": [], "y": []}, name=name)
            self.glyphs[name] = (view.scatter if "size" in look else view.line)("x", "y", source=source, **look).glyph
        for view in (self.curve, self.best):
            view.yaxis.ticker.mantissas = [1, 2, 5]
            view.toolbar.logo = None
        self.curve.legend[0].update(orientation="horizontal", padding=0, margin=0, border_line_color=None)
        self.curve.add_layout(self.curve.legend[0], "above")
        self.tiles = self.models.ColumnDataSource({name: [] for name in (*EDGES, "color")}, name="faces")
        self.faces.quad(**{name: name for name in EDGES}, color="color", source=self.tiles)
        self.names = self.models.ColumnDataSource({"x": [], "y": [], "text": []})
        self.faces.text("x", "y", "text", source=self.names, text_align="center", text_font_size="12px")
        self.faces.axis.visible = self.faces.grid.visible = False
        self.curve.on_event("tap", self.chosen)
        for event in ("tap", "pan"):
            self.best.on_event(event, self.dragged)

    def _lay_out(self) -> None:
        layout, wrap = needed("bokeh.layouts", "explore", "app"), {"flex-wrap": "wrap"}
        row = partial(layout.row, sizing_mode="stretch_width")
        keys = "".join(f'<b style="color:{c}">■</b> {n} ' for n, c in zip(STATES, STATUS_COLOURS))
        hint = """One bar for each contact point, its parts the shares of a cycle. Click the curve to choose a point, drag
            in the optimal curve to move the preload. Pictures and CSV are of both curves and the loop."""
        moved = [*self.sliders.values(), self.mode, self.order, self.loop, layout.row(*self.buttons)]
        views = [row(self.curve, self.best, styles=wrap), row(self.faces, self.cycle, styles=wrap)]
        left = layout.column(*moved, sizing_mode="stretch_width", min_width=280, styles={"flex": "1 1 280px"})
        shown = [self.busy, self.text, self.least, *views, self.models.Div(text=f"{keys}&nbsp; {hint}"), self.code]
        right = layout.column(*shown, sizing_mode="stretch_width", min_width=340, styles={"flex": "99 1 600px"})
        self.document.add_root(row(left, right, styles=wrap))

    def show(self, answer: Answer | str | None) -> None:
        """A part of the answer has come, a line that says why there is none, or the end of it."""
        if answer is None or isinstance(answer, str):
            self.busy.visible = False
            if answer is not None:
                self.text.text = f'<span style="color:#c0392b">{html.escape(answer)}</span>'
            return
        for name in ("curve", "optimal"):
            if getattr(answer, name) is not None:
                self.shown[name] = answer
        if answer.curve is not None:
            self._curve(answer)
        if answer.optimal is not None:
            found, least = answer.optimal, answer.optimal.optimum
            x, y = np.append(found.preload, least.preload), 1e6 * np.append(found.amplitude, least.amplitude)
            order = np.argsort(x)[np.isfinite(y[np.argsort(x)])]
            self._line("optimal", x[order], y[order])
            self._line("optimum", x[-1:], y[-1:])
            self._say("optimal", self.least, answer.full, answer.optimal.bottom_line())

    def _say(self, name: str, place: Any, full: bool, text: str) -> None:
        """A sentence on a curve, which is dashed as long as it is provisional."""
        place.text = ("" if full else COARSE) + html.escape(text)
        self.glyphs[name].line_dash = [] if full else [6]

    def _line(self, name: str, x: Any, y: Any) -> None:
        self.sources[name].data = {"x": np.asarray(x), "y": np.asarray(y)}

    def _curve(self, answer: Answer) -> None:
        curve = answer.curve
        assert curve is not None
        chosen = answer.full and answer.question.point is not None and len(curve) > 0
        at = f" Chosen point: {height(curve.amplitude[answer.point], curve.frequency[answer.point])}." if chosen else ""
        whole = answer.full or curve.complete
        told = curve.bottom_line() if whole else "the curve ends early, as long as the slider moves."
        self._say("curve", self.text, answer.full, told + at)
        if answer.full:
            self.busy.text = "<i>computing the optimal curve ...</i>"
        turns = np.flatnonzero(np.diff(curve.branch)) + 1  # a gap between branches
        self._line("curve", np.insert(curve.frequency, turns, np.nan), 1e6 * np.insert(curve.amplitude, turns, np.nan))
        for name, limit in zip(("free", "stuck"), answer.limits):
            self._line(name, limit.frequency, 1e6 * limit.amplitude)
        if len(curve):
            self._line("point", curve.frequency[[answer.point]], 1e6 * curve.amplitude[[answer.point]])
            is_peak = [] if curve.peak_at_end else [curve.peak]
            self._line("marker", [curve.preload for _ in is_peak], [1e6 * peak.amplitude for peak in is_peak])
        self._contacts()

    def _contacts(self) -> None:
        answer = self.shown.get("curve")
        if answer is None or answer.contacts is None or answer.loops is None:
            return
        moved, force = answer.loops.loop(where := self.loop.value)
        self._line("loop", 1e6 * moved, force)
        whole, lost = where == "whole", answer.loops.by_interface.get(where, answer.loops.lost)
        self.cycle.title.text = f"Hysteresis loop: {amount(lost, 'J')} in a cycle"
        self.cycle.xaxis.axis_label = "Response (µm)" if whole else f"Sliding at {where} (µm)"
        self.cycle.yaxis.axis_label = "Contact force at the response (N)" if whole else f"Friction force at {where} (N)"
        share = [f"{n} {percent(x)}" for n, x in zip(STATES, answer.contacts.share[:, 0].mean(axis=0))]
        self.faces.title.text = f"Contact points, mean over the cycle: {', '.join(share)}"
        names: dict[str, list[Any]] = {"x": [], "y": [], "text": []}
        parts, at = [], 0.0
        model = answer.study.coupling.model
        for name in self.loop.options[1:]:
            face, rows = model.interfaces[name], answer.contacts.rows(name)
            x, y, dx, dy = face_coordinates(face.points, face.frame[0])
            y = y - y.min() + 0.5 * dy + at
            parts.append(tiles(answer.contacts.share[rows, 0], x, y, dx, dy))
            for key, value in (("x", float(y.mean())), ("y", float(x.max() + 0.6 * dx)), ("text", name)):
                names[key].append(value)
            at = float(y.max() + 2.0 * dy)
        edges = [np.concatenate(column) for column in zip(*parts)]
        colours = [STATUS_COLOURS[k] for k in edges.pop()]
        self.tiles.data = dict(zip((*EDGES, "color"), [*edges, colours]))
        self.names.data = names

    # ---- what is clicked ----

    def chosen(self, event: Place) -> None:
        """The nearest point of the curve, as it is seen."""
        answer = self.shown.get("curve")
        if answer is None or answer.curve is None or event.x is None or event.y is None or event.y <= 0.0:
            return
        f, a = answer.curve.frequency, np.log(answer.curve.amplitude)
        apart = np.hypot((f - event.x) / np.ptp(f), (a - np.log(event.y / 1e6)) / np.ptp(a))
        self.point = int(np.argmin(apart))
        self.ask()

    def dragged(self, event: Place) -> None:
        """The preload under the pointer."""
        slider = self.sliders["preload"]
        if event.x is not None and event.x > 0.0 and not slider.disabled:
            slider.value = float(np.clip(np.round(np.log10(event.x), 2), slider.start, slider.end))

    def _send(self, name: str, kind: str, content: bytes) -> None:
        self.file.data = {"name": [name], "kind": [kind], "content": [base64.b64encode(content).decode()]}

    def _results(self) -> dict[str, Any]:
        """What is shown, by the names of its files, which tell its settings and what is provisional."""
        found: dict[str, Any] = {}
        for answer in self.shown.values():
            given = f"{answer.question.preload:.3g}-N-engine-order-{answer.study.engine_order}"
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
            lines += ["from bdamper.problem.variation import vary", f"study = vary(study, {dict(question.settings)!r})"]
        lines.append(f"curve = study.track({question.preload!r}, ({low!r}, {high!r}))")
        if question.preloads:
            lines.append(f"optimal = study.optimal_curve({question.preloads!r}, mode={question.mode})")
        self.code.text = "\n".join(lines)
