"""A branch of resonance peaks over the preload, and the form in which a file keeps it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np

from bdamper.peaks.newton import Peak


@dataclass
class Branch:
    """Peaks of one branch, continuous in the preload.

    Parameters
    ----------
    number : int
    peaks : dict of int to Peak
        By the index of the preload.
    joined : dict of int to int
        Number of the branch that this one joins, by the index where it does.
    down, up : str
        How the branch ended toward lower and higher preloads.
    """

    number: int
    peaks: dict[int, Peak]
    joined: dict[int, int] = field(default_factory=dict)
    down: str = ""
    up: str = ""

    def record(self) -> dict[str, Any]:
        """The branch in numbers, texts, lists and arrays."""
        return {
            "number": self.number, "down": self.down, "up": self.up, "joined": sorted(self.joined.items()),
            "peaks": [(k, _plain(q)) for k, q in sorted(self.peaks.items())],
        }  # fmt: skip

    @staticmethod
    def of(record: Mapping[str, Any]) -> Branch:
        """The branch of a record that was read from JSON."""
        peaks = {k: _peak(fields_of) for k, fields_of in record["peaks"]}
        return Branch(record["number"], peaks, dict(record["joined"]), record["down"], record["up"])


def _plain(peak: Peak) -> dict[str, Any]:
    """Fields of a peak but those that a branch's peaks do not have."""
    left = ("cost", "settings", "model_hash", "ladder")
    return {f.name: getattr(peak, f.name) for f in fields(peak) if f.name not in left}


def _peak(record: Mapping[str, Any]) -> Peak:
    values: dict[str, Any] = {name: np.array(v) if isinstance(v, list) else v for name, v in record.items()}
    return Peak(**values)
