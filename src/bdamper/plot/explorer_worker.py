"""What the page asks and what it is answered: one thread, the newest question first, finished answers kept.

A question is answered in steps: the response curve with one harmonic in long steps, which is never cancelled so that
something follows the hand; the curve with all harmonics; the optimal curve; the steady-state amplitude in time at the peak.
A newer question ends every step but the first.  There is never more than one question waiting.  Where preload and
excitation keep their ratio, and no gap closes, curves are multiplied and not computed again
(:mod:`bdamper.plot.explorer`).
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, replace
from threading import Condition, Event, Thread
from typing import Any, TypeVar

import numpy as np

from bdamper.analyses.hysteresis import Hysteresis
from bdamper.harmonic_balance.parameters import vary
from bdamper.plot.force_scaling import rescaled_curve, rescaled_optimal
from bdamper.plot.motion import ContactStatus, LineDrawing, contact_status, line_drawing
from bdamper.response.events import ContinuationOptions
from bdamper.response.optimal_curve_result import OptimalCurve
from bdamper.response.peak import peak_interval
from bdamper.response.response_curve_result import ResponseCurve
from bdamper.response.verification import TimeResponse
from bdamper.study import Study
from bdamper.util.errors import INTERRUPTED, NOT_FOUND, BdamperError, SettingError, with_reason
from bdamper.util.progress import LongWork, stopped_by

T = TypeVar("T")
R = TypeVar("R", ResponseCurve, OptimalCurve)
MOVING = ContinuationOptions(tolerance=1e-6, step=0.1, max_step=0.3, max_turn=0.6, budget=2000, locate=False)
"""Of the curve that follows the hand: peaks within 0.2 % of those of ordinary steps, in two thirds of the time; the few
curves with an open damper that use up the budget (ordinary ones take up to twenty times as much) end early."""
FORCE = "excitation.amplitude"


@dataclass(frozen=True)
class Question:
    """Settings that a window asks about.

    Parameters
    ----------
    settings : tuple of (name, value)
        That differ from the study's own, as :func:`bdamper.harmonic_balance.parameters.vary` takes them.
    preload : float, N
    preloads : (low, high), N, optional
        Of the optimal curve; none where nothing is loaded.
    mode : int
    point : int, optional
        Of the response curve, of which contacts and loop are shown; the highest one by default.
    """

    settings: tuple[tuple[str, Any], ...]
    preload: float
    preloads: tuple[float, float] | None
    mode: int = 1
    point: int | None = None


@dataclass(frozen=True)
class Answer:
    """A part of the answer to a question.

    Parameters
    ----------
    question : Question
    full : bool
        With all harmonics.
    study : Study
    curve : ResponseCurve, optional
    limits : tuple of ResponseCurve
        Free and stuck.
    optimal : OptimalCurve, optional
    contacts : ContactStatus, optional
    loops : Hysteresis, optional
    drawing : LineDrawing or str, optional
        Of the motion, or why there is none.  All three are of the chosen point of the curve, number ``point``.
    point : int
    marched : TimeResponse, optional
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
    marched: TimeResponse | None = None


class Answers:
    """A thread that answers the newest question.

    Parameters
    ----------
    study : Study
    deliver : callable
        Takes an :class:`Answer`, a text where there is none, or None where all of a question is answered; in the thread.
    most : int
        Finished parts in memory; a curve of the typical blade takes some 100 kB.
    preloads : int
        Of an optimal curve, before it refines the optimum.
    """

    def __init__(
        self, study: Study, deliver: Callable[[Answer | str | None], None], most: int = 200, preloads: int = 7
    ) -> None:
        self.study, self.deliver, self.most, self.preloads = study, deliver, most, preloads
        self.kept: OrderedDict[Hashable, Any] = OrderedDict()
        self.changed, self.stop, self.ended = Condition(), Event(), Event()
        self.wanted: Question | None = None
        Thread(target=self._work, daemon=True).start()

    def ask(self, question: Question | None) -> None:
        """Replace the question that waits or is being answered; None ends the thread and all its work."""
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
            except Exception as error:  # whatever it is, the next question is answered
                self.deliver(str(error) if isinstance(error, BdamperError) else f"{type(error).__name__}: {error}")

    def _answer(self, question: Question) -> None:
        asks: list[Callable[[Question, int | None], Answer]] = [self.curve]
        asks += [self.optimal] if question.preloads else []
        for ask, harmonics in ((self.curve, 1), *((ask, None) for ask in (*asks, self.time_response))):
            if harmonics and self._key(ask, question, None) in self.kept:
                continue
            with LongWork() as work, stopped_by(self.ended if harmonics else self.stop):
                self.deliver(ask(question, harmonics))
            if work.interrupted or self.stop.is_set():
                return
        self.deliver(None)

    def _key(self, ask: Callable[..., Answer], question: Question, harmonics: int | None) -> Hashable:
        """What an answer depends on: an optimal curve not on the preload, none on the point that is looked at."""
        preload = 0.0 if ask == self.optimal else question.preload
        return ask.__name__, harmonics, replace(question, point=None, preload=preload)

    def _at_any_force(
        self,
        question: Question,
        load_per_preload: Sequence[float],
        make: Callable[[], R],
        rescale: Callable[[Study, R, float], R | None],
    ) -> R:
        """A finished result at the same ratio of loads to excitation, multiplied; a new one where that is not possible."""
        settings = dict(question.settings)
        force = settings.pop(FORCE, self.study.excitation.amplitude)
        if self.study.excitation.beside:  # which the force does not change
            return make()
        ratios: list[float] = [float(f"{load / force:.6g}") for load in load_per_preload]
        key: Hashable = (rescale, tuple(settings.items()), question.mode, *ratios)
        known: R
        before, known = self.once(key, lambda: (force, make()))
        return known if before == force else rescale(self.varied(question), known, force / before) or make()

    def once(self, key: Hashable, make: Callable[[], T]) -> T:
        """Cached value of a key, computed if missing; the oldest entry is removed."""
        if key not in self.kept:
            self.kept[key] = make()
        self.kept.move_to_end(key)
        while len(self.kept) > self.most:
            self.kept.popitem(last=False)
        found: T = self.kept[key]
        return found

    def varied(self, question: Question, harmonics: int | None = None) -> Study:
        """The study of a question, or with fewer harmonics."""
        settings: Mapping[str, Any] = dict(question.settings) | ({"harmonics": harmonics} if harmonics else {})
        return self.once(("study", *sorted(settings.items())), lambda: vary(self.study, settings))

    def band(self, question: Question) -> tuple[float, float]:
        """Frequencies (Hz) around the free and the stuck resonance of the mode, to three digits."""
        load = question.preloads[1] if question.preloads else question.preload
        key = "band", question.settings, question.mode, load
        ends = self.once(key, lambda: peak_interval(self.varied(question, 1).problem, None, load, question.mode))
        return float(f"{ends[0]:.3g}"), float(f"{ends[1]:.3g}")

    def curve(self, question: Question, harmonics: int | None) -> Answer:
        """The response curve with its limits, or with one harmonic between the frequencies of the study's own damper."""
        still = tuple(item for item in question.settings if item[0] == "engine_order")
        study, own = self.varied(question, harmonics), replace(question, settings=still)
        band = self.band(own if harmonics else question)
        key, load = self._key(self.curve, question, harmonics), question.preload

        def followed() -> ResponseCurve:
            return _whole(study.frequency_response(load, band, options=MOVING if harmonics else None))

        def found() -> ResponseCurve:
            return followed() if harmonics else self._at_any_force(question, [load], followed, rescaled_curve)

        curve = self.once(key, found)
        one = self.varied(question, 1)
        limits = () if harmonics else self.once(("limits", key), lambda: (one.free(band), one.stuck(band, load or 1.0)))
        if not len(curve):
            return Answer(question, harmonics is None, study, curve, limits)
        i = curve.peak.index if question.point is None or harmonics else min(question.point, len(curve) - 1)
        contacts, loops = contact_status(study, curve.unknowns[i], load), study.hysteresis(curve, i)
        drawing: LineDrawing | str | None = None
        if not harmonics:
            try:
                drawing = line_drawing(study, curve.unknowns[i])
            except SettingError as error:
                drawing = str(error)
        return Answer(question, harmonics is None, study, curve, limits, None, contacts, loops, drawing, i)

    def optimal(self, question: Question, harmonics: int | None = None) -> Answer:
        """The optimal curve, with all harmonics."""
        study, preloads = self.varied(question), question.preloads or (1.0, 2.0)
        ask: dict[str, Any] = {"frequency": self.band(question), "mode": question.mode, "check": False}

        def searched() -> OptimalCurve:
            return _whole(study.optimal_curve(preloads, self.preloads, **ask))

        key = self._key(self.optimal, question, None)
        found = self.once(key, lambda: self._at_any_force(question, preloads, searched, rescaled_optimal))
        return Answer(question, True, study, optimal=found)

    def time_response(self, question: Question, harmonics: int | None = None) -> Answer:
        """The steady-state amplitude in time at the peak of the response curve."""
        answer = self.curve(question, None)
        curve, study = answer.curve, answer.study
        none = TimeResponse(*(np.nan,) * 4, question.preload, np.nan)

        def marched() -> TimeResponse:
            try:
                found = study.time_response(curve) if curve is not None and len(curve) else replace(none, status=NOT_FOUND)
            except BdamperError as error:
                return replace(none, status=with_reason(NOT_FOUND, error))
            if found.status == INTERRUPTED:
                raise KeyboardInterrupt
            return found

        return replace(answer, marched=self.once(self._key(self.time_response, question, None), marched))


def _whole(found: Any) -> Any:
    """Raise KeyboardInterrupt if the result is incomplete."""
    if found.interrupted:
        raise KeyboardInterrupt
    return found
