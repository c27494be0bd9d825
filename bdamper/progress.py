"""Progress of long work on the terminal or in a notebook."""

from __future__ import annotations

from typing import Any, Literal

from bdamper.continuation import PathPoint


class progress_bar:
    """Progress over the frequency interval, or nothing."""

    def __init__(self, show: bool, low: float, high: float) -> None:
        self.show, self.low, self.high = show, low, high

    def __enter__(self) -> Any:
        if not self.show:
            return None
        from tqdm.auto import tqdm

        self.bar = tqdm(total=100, unit="%", desc="tracking", bar_format="{l_bar}{bar}| {n:.0f} % [{elapsed}]")

        def update(point: PathPoint) -> None:
            now = 100.0 * (point.y[-1] - self.low) / (self.high - self.low)
            self.bar.n = max(0.0, min(100.0, now))
            self.bar.refresh()

        return update

    def __exit__(self, *_: object) -> Literal[False]:
        if self.show:
            self.bar.close()
        return False
