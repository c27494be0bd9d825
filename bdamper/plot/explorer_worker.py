"""Worker thread of the explorer: it computes the results for the latest settings and caches them.

A question is answered in four steps:

1. the response curve with one harmonic and long steps, which is never cancelled, so that the page
   follows the sliders;
2. the response curve with all harmonics;
3. the optimal curve;
4. the steady-state amplitude in time at the peak.

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
from bdamper.response.response_curve import frequency_response
from bdamper.response.response_curve_result import ResponseCurve
from bdamper.response.verification import TimeResponse
from bdamper.study import Study
from bdamper.util.errors import INTERRUPTED, NOT_FOUND, BdamperError, SettingError
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
        Steady-state amplitude by time integration at the peak of the curve.
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
        self.study = study
        self.deliver = deliver
        self.most = most
        self.preloads = preloads
        self.kept: OrderedDict[Hashable, Any] = OrderedDict()
        # lock of the waiting question, and events that end the work for a question and the thread
        self.changed = Condition()
        self.stop = Event()
        self.ended = Event()
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
                question = self.wanted
                self.wanted = None
                self.stop.clear()
            if self.closed or question is None:
                return
            try:
                self._answer(question)
            # any error is shown, and the thread continues with the next question
            except Exception as error:
                is_expected = isinstance(error, BdamperError)
                self.deliver(str(error) if is_expected else f"{type(error).__name__}: {error}")

    def _answer(self, question: Question) -> None:
        """Deliver the answers of all steps, until a newer question or the end of the thread."""
        full_key = self._key(self.curve, question, None)
        if full_key not in self.kept:
            # the provisional curve is never cancelled by a newer question
            with LongWork() as work, stopped_by(self.ended):
                self.deliver(self.curve(question, 1))
            if work.interrupted or self.stop.is_set():
                return
        steps: list[Callable[[Question], Answer]] = [self.curve]
        if question.preloads:
            steps.append(self.optimal)
        steps.append(self.time_response)
        for step in steps:
            with LongWork() as work, stopped_by(self.stop):
                self.deliver(step(question))
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
        settings = dict(question.settings)
        if harmonics:
            settings["harmonics"] = harmonics
        return self.once(("study", *sorted(settings.items())), lambda: vary(self.study, settings))

    def band(self, question: Question) -> tuple[float, float]:
        """Return the interval (Hz) around the free and the stuck resonance, to three digits."""
        highest_load = question.preloads[1] if question.preloads else question.preload

        def interval() -> tuple[float, float]:
            problem = self.varied(question, 1).problem
            return peak_interval(problem.at(highest_load), None, question.mode)

        key = ("band", question.settings, question.mode, highest_load)
        low, high = self.once(key, interval)
        return float(f"{low:.3g}"), float(f"{high:.3g}")

    def curve(self, question: Question, harmonics: int | None = None) -> Answer:
        """Compute the response curve, and with all harmonics (None) its limits and the motion.

        The provisional curve has the interval of the unchanged settings, so that the axes do not
        change.
        """
        if harmonics:
            return self._provisional_curve(question, harmonics)
        study = self.varied(question)
        # the curves without contact and with stuck contacts have one harmonic
        linear = self.varied(question, harmonics=1)
        load = question.preload
        band = self.band(question)
        key = self._key(self.curve, question, None)

        def compute_curve() -> ResponseCurve:
            return _whole(study.frequency_response(load, band, options=None))

        def compute_limits() -> Any:
            # without preload, the contacts that any preload closes are stuck
            return linear.free(band), linear.stuck(band, load or 1.0)

        curve: ResponseCurve = self.once(key, compute_curve)
        limits = self.once(("limits", key), compute_limits)
        answer = Answer(question, True, study, curve, limits)
        if not len(curve):
            return answer
        point = curve.peak_index
        if question.point is not None:
            point = min(question.point, len(curve) - 1)
        answer = self._with_contacts(answer, curve, point)
        try:
            drawing: LineDrawing | str = line_drawing(study, curve.unknowns[point])
        except SettingError as error:
            drawing = str(error)
        return replace(answer, drawing=drawing)

    def _provisional_curve(self, question: Question, harmonics: int) -> Answer:
        """Compute the curve that follows the sliders, with few harmonics and long steps."""
        study = self.varied(question, harmonics)
        order_only = tuple(
            (name, value) for name, value in question.settings if name == "engine_order"
        )
        band = self.band(replace(question, settings=order_only))
        curve: ResponseCurve = self.once(
            self._key(self.curve, question, harmonics),
            # without the verdict on its peak, which the curve with all harmonics has
            lambda: _whole(
                frequency_response(study.problem, question.preload, band, options=MOVING)
            ),
        )
        answer = Answer(question, False, study, curve)
        return self._with_contacts(answer, curve, curve.peak_index) if len(curve) else answer

    def _with_contacts(self, answer: Answer, curve: ResponseCurve, point: int) -> Answer:
        """Return an answer with the contact states and the loops of a point of the curve."""
        contacts = contact_status(answer.study, curve.unknowns[point], answer.question.preload)
        loops = answer.study.hysteresis(curve, point)
        return replace(answer, contacts=contacts, loops=loops, point=point)

    def optimal(self, question: Question) -> Answer:
        """Compute the optimal curve with all harmonics."""
        study = self.varied(question)
        preloads = question.preloads or (1.0, 2.0)
        band = self.band(question)

        def compute() -> Any:
            return _whole(
                study.optimal_curve(
                    preloads, self.preloads, frequency=band, mode=question.mode, check=False
                )
            )

        curve = self.once(self._key(self.optimal, question, None), compute)
        return Answer(question, True, study, optimal=curve)

    def time_response(self, question: Question) -> Answer:
        """Compute the steady-state amplitude in time at the peak of the response curve."""
        # the curve with all harmonics, usually cached
        answer = self.curve(question)
        curve = answer.curve
        assert curve is not None

        def compute() -> Any:
            # without an amplitude in time, the page shows the reason
            try:
                return _whole(answer.study.time_response(curve))
            except BdamperError as error:
                return TimeResponse(
                    mean=np.nan,
                    lowest=np.nan,
                    highest=np.nan,
                    frequency=np.nan,
                    preload=question.preload,
                    balance=np.nan,
                    status=NOT_FOUND,
                    reason=str(error),
                )

        found = self.once(self._key(self.time_response, question, None), compute)
        return replace(answer, time_response=found)


def _whole(result: Any) -> Any:
    """Return a result; raise KeyboardInterrupt if it was interrupted."""
    if getattr(result, "interrupted", result.status == INTERRUPTED):
        raise KeyboardInterrupt
    return result
