"""Progress of long work on the terminal or in a notebook."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, Literal, TypeVar

T = TypeVar("T")


def each(items: Sequence[T], show: bool, what: str, unit: str) -> Iterable[T]:
    """The items, with a bar that counts them if it is to be shown."""
    if not show:
        return items
    from tqdm.auto import tqdm

    bar: Iterable[T] = tqdm(items, desc=what, unit=unit)
    return bar


class progress_bar:
    """Progress over the frequency interval, or nothing."""

    def __init__(self, show: bool, low: float, high: float) -> None:
        self.show, self.low, self.high = show, low, high

    def __enter__(self) -> Any:
        if not self.show:
            return None
        from tqdm.auto import tqdm

        self.bar = tqdm(total=100, unit="%", desc="tracking", bar_format="{l_bar}{bar}| {n:.0f} % [{elapsed}]")

        def update(point: Any) -> None:
            now = 100.0 * (point.y[-1] - self.low) / (self.high - self.low)
            self.bar.n = max(0.0, min(100.0, now))
            self.bar.refresh()

        return update

    def __exit__(self, *_: object) -> Literal[False]:
        if self.show:
            self.bar.close()
        return False
