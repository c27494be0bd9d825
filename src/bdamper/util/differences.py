"""What differs between two studies or results: settings, model, and what they come to."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from bdamper.util.display import Fact, Summarised
from bdamper.util.errors import SettingError
from bdamper.util.formatting import percent
from bdamper.util.short_repr import brief, plain

MISSING = "not there"


@brief
@dataclass(frozen=True)
class Differences(Summarised):
    """Differences between two studies or results.

    Parameters
    ----------
    settings : tuple of (name, first, second)
        Settings that differ, those within others by their whole name ("excitation.amplitude").
    outcomes : tuple of (first, second)
        What both results say of the same quantity, as ``bdamper.util.display.Fact``, where it differs in the six
        digits that are printed.
    kinds : tuple of two str
        What was compared.
    """

    settings: tuple[tuple[str, Any, Any], ...]
    outcomes: tuple[tuple[Fact, Fact], ...]
    kinds: tuple[str, str]

    def __bool__(self) -> bool:
        return bool(self.settings or self.outcomes)

    def _headline(self) -> str:
        return f"{' and '.join(self.kinds)}{' differ:' if self else ': no difference'}"

    def _rows(self) -> list[tuple[str, ...]]:
        rows = [(name, plain(a), plain(b), _change(a, b)) for name, a, b in self.settings]
        rows += [(a.name, a.to_digits(6), b.to_digits(6), _change(a.value, b.value)) for a, b in self.outcomes]
        return [("", "first", "second", "change"), *rows] if rows else []


def _change(a: Any, b: Any) -> str:
    numbers = all(isinstance(value, (int, float)) and not isinstance(value, bool) for value in (a, b))
    return percent(b / a - 1.0, True) if numbers and a and np.isfinite([a, b]).all() else ""


class Comparable(Summarised):
    """A study or a result that can be compared with another one; a mixin."""

    def compare(self, other: Any) -> Differences:
        """Differences between this and another study or result: settings, model and values.

        Parameters
        ----------
        other : Study, ResponseCurve, OptimalCurve, ...
            What two of different kinds come to is not compared, but their settings are.

        Returns
        -------
        Differences
            Prints a line for each; the change is from this to the other.  False if there is none.

        Raises
        ------
        SettingError
            If the other is neither.
        """
        if not isinstance(other, Comparable):
            raise SettingError(f"other: expected a study or a result to compare with, found a {type(other).__name__}")
        same = type(self) is type(other)
        own, others = (one._asked() for one in (self, other))
        # results of different kinds have settings of their own beside those of the study
        names = own.keys() | others.keys() if same else own.keys() & others.keys()
        first, second = (_flat({k: v for k, v in one.items() if k in names}) for one in (own, others))
        settings = tuple(
            (name, first.get(name, MISSING), second.get(name, MISSING))
            for name in dict.fromkeys([*first, *second])
            if first.get(name, MISSING) != second.get(name, MISSING)
        )
        outcomes: tuple[tuple[Fact, Fact], ...] = ()
        if same:
            there = {fact.name: fact for fact in other._outcomes()}
            both = [(fact, there[fact.name]) for fact in self._outcomes() if fact.name in there]
            outcomes = tuple((a, b) for a, b in both if a.to_digits(6) != b.to_digits(6))
        return Differences(settings, outcomes, (type(self).__name__, type(other).__name__))

    def _outcomes(self) -> tuple[Fact, ...]:
        return self._facts()

    def _asked(self) -> dict[str, Any]:
        """Model, except where no problem was asked, and settings."""
        digest = getattr(self, "model_hash", "")
        return ({"model": digest} if digest else {}) | getattr(self, "settings", {})


def _flat(settings: Mapping[str, Any], before: str = "") -> dict[str, Any]:
    """Settings within settings by names with dots."""
    out: dict[str, Any] = {}
    for name, value in settings.items():
        out |= _flat(value, f"{before}{name}.") if isinstance(value, Mapping) else {f"{before}{name}": value}
    return out
