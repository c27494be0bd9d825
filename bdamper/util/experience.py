"""What richer settings cost and changed on scenes of the hard disk, as every optimal curve tells it.

The figures are those of ``data/cost.json``, written by ``python -m benchmarks.bench_cost ship`` and never by hand.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

TABLE = Path(__file__).resolve().parents[1] / "data" / "cost.json"


@cache
def _table() -> dict[str, Any]:
    table: dict[str, Any] = json.loads(TABLE.read_text())
    return table


def richer(settings: Mapping[str, Any]) -> tuple[str, ...]:
    """A line for each setting that has a next richer value in the table: what that costs, and what it changed.

    Parameters
    ----------
    settings : mapping
        Of a result; those that the table does not know are passed over.
    """
    table, stiffness = _table(), settings.get("contact_stiffness")
    numbers = list(settings.get("harmonics", ()))
    modes = stiffness.get("residual_modes", {}) if isinstance(stiffness, Mapping) else {}
    own = {
        "harmonics": len(numbers) if numbers == list(range(1, len(numbers) + 1)) else None,
        "blade_modes": settings.get("blade_modes"),
        "patterns": table["patterns"] if stiffness == "residual_modes" else modes.get("patterns"),
    }
    return tuple(
        f"{step['to']} {step['name']}: about {step['time']:g} times the time; changed the peak by {step['change']:g} % "
        f"(median of {table['scenes']} scenes of the hard disk)"
        for step in table["steps"]
        if own.get(step["setting"]) == step["from"]
    )
