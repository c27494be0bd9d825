"""Worker thread of the explorer: it computes the results for the latest settings and caches them.

A question is answered in four steps:

1. the response curve with one harmonic and long steps, which is never cancelled, so that the page
follows the sliders; 2. the response curve with all harmonics; 3. the optimal curve; 4. the
steady-state amplitude in time at the peak.

A newer question cancels every step except the first one; at most one question waits.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable
from dataclasses import dataclass, replace
from threading import Condition, Event, Thread
from typing import Any

import numpy as np

from bdamper.analyses.hysteresis import Hysteresis
from bdamper.harmonic_balance.parameters import vary
from bdamper.plot.motion import ContactStatus, LineDrawing, contact_status, line_drawing
from bdamper.response.events import ContinuationOptions
from bdamper.response.linear_limits import peak_interval
from bdamper.response.optimal_curve_result import OptimalCurve
from bdamper.response.response_curve_result import ResponseCurve
from bdamper.response.verification import TimeResponse
from bdamper.study import Study
from bdamper.util.errors import INTERRUPTED, NOT_FOUND, BdamperError, SettingError, with_reason
from bdamper.util.progress import LongWork, stopped_by

MOVING = ContinuationOptions(
    tolerance=1e-6, step=0.1, max_step=0.3, max_turn=0.6, budget=2000, locate=False
)
"""Options of the curve that follows the sliders.  Its peaks are within 0.2 % of the peaks with the
default steps, in two thirds of the time.  The budget stops the few curves with an open damper,
which take up to twenty times as much.
"""
FORCE = "excitation.amplitude"


@dataclass(frozen=True)
class Question:
    """Settings of a window.

    Parameters
    ----------
    settings : tuple of (name, value)
        Settings that differ from the study, with the names of
        :func:`bdamper.harmonic_balance.parameters.vary`.
    preload : float, N
    preloads : (low, high), N, optional
        Range of the optimal curve; None if the model has no preload.
    mode : int
    point : int, optional
        Point of the response curve whose contacts and loop are shown; the highest by default.
    """

    settings: tuple[tuple[str, Any], ...]
    preload: float
    preloads: tuple[float, float] | None
    mode: int = 1
    point: int | None = None


@dataclass(frozen=True)
class Answer:
    """Results of one step for a question.

    Parameters
    ----------
    question : Question
    full : bool
        Whether all harmonics are included.
    study : Study
    curve : ResponseCurve, optional
    limits : tuple of ResponseCurve
        Free and stuck limits.
    optimal : OptimalCurve, optional
    contacts : ContactStatus, optional
    loops : Hysteresis, optional
    drawing : LineDrawing or str, optional
        Drawing of the motion, or the reason why there is none.
    point : int
        Point of the curve to which ``contacts``, ``loops`` and ``drawing`` belong.
    time_response : TimeResponse, optional
        Steady-state amplitude in time at the peak of the curve.
    """

    question: Question
    full: bool
    study: Study
    curve: ResponseCurve | None = None
    limits: tuple[ResponseCurve, ...] = ()
    optimal: OptimalCurve | None = None
    contacts: ContactStatus | None = None
    loops: Hysteresis | None = None
    drawing: LineDrawing | str | None = None
    point: int = 0
    time_response: TimeResponse | None = None


class Answers:
    """Thread that answers the latest question.

    Parameters
    ----------
    study : Study
    deliver : callable
        Called in the thread with an :class:`Answer`, with an error text, or with None at the end of
        a question.
    most : int
        Largest number of cached results; a curve of the typical blade takes some 100 kB.
    preloads : int
        Number of preloads of an optimal curve, before the optimum is refined.
    """

    def __init__(
        self,
        study: Study,
        deliver: Callable[[Answer | str | None], None],
        most: int = 200,
        preloads: int = 7,
    ) -> None:
        self.study, self.deliver, self.most, self.preloads = study, deliver, most, preloads
        self.kept: OrderedDict[Hashable, Any] = OrderedDict()
        self.changed, self.stop, self.ended = Condition(), Event(), Event()
        self.wanted: Question | None = None
        Thread(target=self._work, daemon=True).start()

    def ask(self, question: Question | None) -> None:
        """Replace the current question; None ends the thread and its work."""
        with self.changed:
            self.wanted = question
            self.stop.set()
            if question is None:
                self.ended.set()
            self.changed.notify()

    @property
    def closed(self) -> bool:
        """Whether the thread has ended, or is about to."""
        return self.ended.is_set()

    def _work(self) -> None:
        while True:
            with self.changed:
                self.changed.wait_for(lambda: self.closed or self.wanted is not None)
                question, self.wanted = self.wanted, None
                self.stop.clear()
            if self.closed or question is None:
                return
            try:
                self._answer(question)
            except (
                Exception
            ) as error:  # any error is shown, and the thread continues with the next question
                self.deliver(
                    str(error)
                    if isinstance(error, BdamperError)
                    else f"{type(error).__name__}: {error}"
                )

    def _answer(self, question: Question) -> None:
        steps = [self.curve, *([self.optimal] if question.preloads else []), self.time_response]
        for ask, harmonics in ((self.curve, 1), *((step, None) for step in steps)):
            if harmonics and self._key(ask, question, None) in self.kept:
                continue
            with LongWork() as work, stopped_by(self.ended if harmonics else self.stop):
                self.deliver(ask(question, harmonics))
            if work.interrupted or self.stop.is_set():
                return
        self.deliver(None)

    def _key(
        self, ask: Callable[..., Answer], question: Question, harmonics: int | None
    ) -> Hashable:
        """Return the cache key of an answer.

        An optimal curve does not depend on the preload, and no answer on the shown point.
        """
        preload = 0.0 if ask == self.optimal else question.preload
        return ask.__name__, harmonics, replace(question, point=None, preload=preload)

    def once(self, key: Hashable, make: Callable[[], Any]) -> Any:
        """Return the cached value of a key, computed if missing; the oldest entry is removed."""
        if key not in self.kept:
            self.kept[key] = make()
        self.kept.move_to_end(key)
        while len(self.kept) > self.most:
            self.kept.popitem(last=False)
        return self.kept[key]

    def varied(self, question: Question, harmonics: int | None = None) -> Study:
        """Return the study of a question, or the same with fewer harmonics."""
        settings = dict(question.settings) | ({"harmonics": harmonics} if harmonics else {})
        return self.once(("study", *sorted(settings.items())), lambda: vary(self.study, settings))

    def band(self, question: Question) -> tuple[float, float]:
        """Return the interval (Hz) around the free and the stuck resonance, to three digits."""
        load = question.preloads[1] if question.preloads else question.preload
        key = "band", question.settings, question.mode, load
        ends = self.once(
            key,
            lambda: peak_interval(self.varied(question, 1).problem.at(load), None, question.mode),
        )
        return float(f"{ends[0]:.3g}"), float(f"{ends[1]:.3g}")

    def curve(self, question: Question, harmonics: int | None) -> Answer:
        """Compute the response curve with its limits.

        With one harmonic, in the band of the unchanged settings.
        """
        order_only = tuple(
            (name, value) for name, value in question.settings if name == "engine_order"
        )
        study = self.varied(question, harmonics)
        band = self.band(replace(question, settings=order_only) if harmonics else question)
        key, load, options = (
            self._key(self.curve, question, harmonics),
            question.preload,
            MOVING if harmonics else None,
        )
        curve: ResponseCurve = self.once(
            key, lambda: _whole(study.frequency_response(load, band, options=options))
        )
        linear = self.varied(question, 1)
        answer = Answer(question, not harmonics, study, curve)
        if not harmonics:
            limits = self.once(
                ("limits", key), lambda: (linear.free(band), linear.stuck(band, load or 1.0))
            )
            answer = replace(answer, limits=limits)
        if not len(curve):
            return answer
        i = (
            curve.peak_index
            if question.point is None or harmonics
            else min(question.point, len(curve) - 1)
        )
        u = curve.unknowns[i]
        drawing: LineDrawing | str | None = None
        if not harmonics:
            try:
                drawing = line_drawing(study, u)
            except SettingError as error:
                drawing = str(error)
        contacts, loops = contact_status(study, u, load), study.hysteresis(curve, i)
        return replace(answer, contacts=contacts, loops=loops, drawing=drawing, point=i)

    def optimal(self, question: Question, harmonics: int | None = None) -> Answer:
        """Compute the optimal curve with all harmonics."""
        study, preloads = self.varied(question), question.preloads or (1.0, 2.0)
        options: dict[str, Any] = {
            "frequency": self.band(question),
            "mode": question.mode,
            "check": False,
        }
        key = self._key(self.optimal, question, None)
        curve = self.once(
            key, lambda: _whole(study.optimal_curve(preloads, self.preloads, **options))
        )
        return Answer(question, True, study, optimal=curve)

    def time_response(self, question: Question, harmonics: int | None = None) -> Answer:
        """Compute the steady-state amplitude in time at the peak of the response curve."""
        answer, none = (
            self.curve(question, None),
            TimeResponse(*(np.nan,) * 4, question.preload, np.nan),
        )
        assert answer.curve is not None
        curve = answer.curve

        def computed() -> Any:
            try:
                return _whole(answer.study.time_response(curve))
            except BdamperError as error:
                return replace(none, status=with_reason(NOT_FOUND, error))

        return replace(
            answer, time_response=self.once(self._key(self.time_response, question, None), computed)
        )


def _whole(result: Any) -> Any:
    """Return a result; raise KeyboardInterrupt if it was interrupted."""
    if getattr(result, "interrupted", result.status == INTERRUPTED):
        raise KeyboardInterrupt
    return result
