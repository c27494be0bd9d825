"""What the page asks and what it is answered: one thread, the newest question first, finished answers kept.

A question is answered in steps: the tracking curve with one harmonic in long steps, which is never cancelled so that
something follows the hand; the curve with all harmonics; the optimal curve with one; that with all.  A newer question ends
every step but the first.  There is never more than one question waiting.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from threading import Condition, Event, Thread
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from bdamper.continuation.curve import Curve
from bdamper.continuation.path import ContinuationOptions
from bdamper.effects.hysteresis import Hysteresis
from bdamper.peaks.interval import peak_interval
from bdamper.peaks.optimal_curve import OptimalCurve
from bdamper.plot.motion import ContactStatus, contact_status
from bdamper.problem.variation import vary
from bdamper.speed.family import with_needed_bases
from bdamper.study import Study
from bdamper.util.errors import BdamperError
from bdamper.util.progress import LongWork, ended_by

T = TypeVar("T")
MOVING = ContinuationOptions(tolerance=1e-6, step=0.1, max_step=0.3, max_turn=0.6, budget=2000, locate=False)
"""Of the curve that follows the hand: peaks within 0.2 % of those of ordinary steps, in two thirds of the time; the few
curves with an open damper that use up the budget (ordinary ones take up to twenty times as much) end early."""
NOT_OF_THE_BAND = ("friction_coefficient", "excitation.amplitude", "harmonics")
"""Settings that free and stuck resonances do not depend on."""


@dataclass(frozen=True)
class Question:
    """What a window asks.

    Parameters
    ----------
    settings : tuple of (name, value)
        That differ from the study's own, as :func:`bdamper.problem.variation.vary` takes them.
    preload : float, N
    preloads : (low, high), N, optional
        Of the optimal curve; none where nothing is loaded.
    mode : int
    point : int, optional
        Of the tracking curve, of which contacts and loop are shown; the highest one by default.
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
    curve : Curve, optional
    limits : tuple of Curve
        Free and stuck.
    optimal : OptimalCurve, optional
    contacts : ContactStatus, optional
    loops : Hysteresis, optional
        Of the chosen point of the curve, number ``point``.
    point : int
    """

    question: Question
    full: bool
    study: Study
    curve: Curve | None = None
    limits: tuple[Curve, ...] = ()
    optimal: OptimalCurve | None = None
    contacts: ContactStatus | None = None
    loops: Hysteresis | None = None
    point: int = 0


class Answers:
    """A thread that answers the newest question.

    Parameters
    ----------
    study : Study
    deliver : callable
        Takes an :class:`Answer`, a text where there is none, or None where all of a question is answered; in the thread.
    most : int
        Finished parts that are kept; a curve of the typical blade takes some 100 kB.
    preloads : int
        Of an optimal curve, before it refines the optimum.
    """

    def __init__(
        self, study: Study, deliver: Callable[[Answer | str | None], None], most: int = 200, preloads: int = 12
    ) -> None:
        self.study, self.deliver, self.most, self.preloads = study, deliver, most, preloads
        self.kept: OrderedDict[Hashable, Any] = OrderedDict()
        self.changed, self.stop = Condition(), Event()
        self.wanted: Question | None = None
        self.closed = False
        Thread(target=self._work, daemon=True).start()

    def ask(self, question: Question | None) -> None:
        """Take a question in place of any that waits or is being answered; None ends the thread."""
        with self.changed:
            self.wanted, self.closed = question, self.closed or question is None
            self.stop.set()
            self.changed.notify()

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
        for ask in (self.curve, self.optimal) if question.preloads else (self.curve,):
            for harmonics in (1, None):
                if harmonics and self._key(ask, question, None) in self.kept:
                    continue
                first = ask == self.curve and harmonics
                with LongWork() as work, ended_by(Event() if first else self.stop):
                    self.deliver(ask(question, harmonics))
                if work.interrupted or self.stop.is_set():
                    return
        self.deliver(None)

    def _key(self, ask: Callable[..., Answer], question: Question, harmonics: int | None) -> Hashable:
        """What an answer depends on: an optimal curve not on the preload, none on the point that is looked at."""
        preload = question.preload if ask == self.curve else 0.0
        return ask.__name__, harmonics, replace(question, point=None, preload=preload)

    def once(self, key: Hashable, make: Callable[[], T]) -> T:
        """What was made before for a key, or is made now; the oldest goes."""
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
        lean = harmonics is not None and "engine_order" not in settings
        return self.once(("study", *sorted(settings.items())), lambda: vary(self.lean if lean else self.study, settings))

    @cached_property
    def lean(self) -> Study:
        """The study with the bases that one harmonic needs, which comes to a speed in a fifth of the time."""
        return with_needed_bases(self.study.with_(harmonics=1))

    def band(self, question: Question) -> tuple[float, float]:
        """Frequencies (Hz) around the free and the stuck resonance of the mode, to three digits."""
        kept = tuple(item for item in question.settings if item[0] not in NOT_OF_THE_BAND)
        linear = replace(question, settings=kept)
        ends = self.once(("band", kept, question.mode), lambda: peak_interval(self.varied(linear, 1), None, question.mode))
        return float(f"{ends[0]:.3g}"), float(f"{ends[1]:.3g}")

    def curve(self, question: Question, harmonics: int | None) -> Answer:
        """The tracking curve with its limits, or with one harmonic between the frequencies of the study's own damper."""
        still = tuple(item for item in question.settings if item[0] == "engine_order")
        study, own = self.varied(question, harmonics), replace(question, settings=still)
        band = self.band(own if harmonics else question)
        key, load = self._key(self.curve, question, harmonics), question.preload
        curve = self.once(key, lambda: _whole(study.track(load, band, options=MOVING if harmonics else None)))
        one = self.varied(question, 1)
        limits = () if harmonics else self.once(("limits", key), lambda: (one.free(band), one.stuck(band, load or 1.0)))
        if not len(curve):
            return Answer(question, harmonics is None, study, curve, limits)
        i = curve.peak.index if question.point is None or harmonics else min(question.point, len(curve) - 1)
        contacts, loops = contact_status(study, curve.unknowns[i], load, 16), study.hysteresis(curve, i)
        return Answer(question, harmonics is None, study, curve, limits, None, contacts, loops, i)

    def optimal(self, question: Question, harmonics: int | None) -> Answer:
        """The optimal curve with all harmonics, or with one."""
        study, preloads = self.varied(question, harmonics), question.preloads or (1.0, 2.0)
        ask: dict[str, Any] = {"frequency": self.band(question), "mode": question.mode, "check": False}
        key = self._key(self.optimal, question, harmonics)
        found = self.once(key, lambda: _whole(study.optimal_curve(preloads, self.preloads, **ask)))
        return Answer(question, harmonics is None, study, optimal=found)


def _whole(found: Any) -> Any:
    """A result, unless a newer question has ended it."""
    if found.interrupted:
        raise KeyboardInterrupt
    return found


def tiles(share: NDArray, x: NDArray, y: NDArray, dx: float, dy: float) -> tuple[NDArray, ...]:
    """Left and right ends, bottoms, tops and states of patches at contact points, each divided by its shares (n, 3)."""
    left = y[:, None] + 0.9 * dy * (np.pad(np.cumsum(share, axis=1), ((0, 0), (1, 0))) - 0.5)
    low = np.repeat(x - 0.45 * dx, 3)
    return left[:, :-1].ravel(), left[:, 1:].ravel(), low, low + 0.9 * dx, np.tile(np.arange(3), len(x))
