"""Evaluations of a curve by purpose: accepted and refused steps, searches for corners, events, ends and the rest.

Curves of the difficult disk with 24 points a face, from 300 to 380 Hz.  Each evaluation, with or without Jacobian, counts
for the innermost purpose.  An arc is a sequence of accepted steps between two refused ones.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import Any

import bdamper as bd
from bdamper.response.continuation import Follower
from bdamper.response.events import Events

CASES = [
    (10, 3, 125.0),
    (10, 3, 500.0),
    (10, 3, 2000.0),
    (10, 9, 500.0),
    (5, 3, 500.0),
    (20, 3, 500.0),
    (40, 3, 500.0),
]
"""Blade modes, harmonics and preload (N)."""
PURPOSES = (
    "accepted steps",
    "refused steps",
    "corners found",
    "corners not found",
    "events",
    "ends",
)


class Tally:
    """Counts of evaluations and of calls by purpose, and number of arcs, while it is entered."""

    def __init__(self) -> None:
        self.counts: Counter[str] = Counter()
        self.calls: Counter[str] = Counter()
        self.arcs = 0
        self._last = ""
        self._inner = [0]
        self._methods = [
            (Follower, "try_step", lambda out: PURPOSES[1] if out[1] else PURPOSES[0]),
            (Follower, "end_at", lambda out: PURPOSES[5]),
            (Events, "around_corner", lambda out: PURPOSES[2 if out else 3]),
            (Events, "locate", lambda out: PURPOSES[4]),
        ]
        self._kept = [getattr(owner, name) for owner, name, _ in self._methods]

    def _counted(
        self, method: Callable[..., Any], purpose: Callable[[Any], str]
    ) -> Callable[..., Any]:
        def call(owner: Any, *args: Any, **options: Any) -> Any:
            before = owner.system.core.cost.evaluations
            self._inner.append(0)
            out = method(owner, *args, **options)
            spent, inner = owner.system.core.cost.evaluations - before, self._inner.pop()
            self.counts[purpose(out)] += spent - inner
            self.calls[purpose(out)] += 1
            if method.__name__ == "try_step":
                self.arcs += (self._last, purpose(out)) == (PURPOSES[0], PURPOSES[1])
                self._last = purpose(out)
            self._inner[-1] += spent
            return out

        return call

    def __enter__(self) -> Tally:
        for (owner, name, purpose), method in zip(self._methods, self._kept):
            setattr(owner, name, self._counted(method, purpose))
        return self

    def __exit__(self, *_: object) -> None:
        for (owner, name, _purpose), method in zip(self._methods, self._kept):
            setattr(owner, name, method)


def main() -> None:
    """Print the table: of each purpose the number of calls and of evaluations."""
    sizes = (
        "blade modes",
        "harmonics",
        "preload (N)",
        "points",
        "evaluations",
        "per point",
        "arcs",
    )
    names = (*sizes, *PURPOSES, "start, rest")
    print("| " + " | ".join(names) + " |\n" + "|---" * len(names) + "|")
    model = bd.reference_model("bladed_disk", 24)
    for modes, harmonics, preload in CASES:
        study = bd.Study(model, bd.Excitation("tip"), 5, blade_modes=modes, harmonics=harmonics)
        with Tally() as tally:
            curve = study.frequency_response(preload, (300.0, 380.0))
        n, points = curve.cost.evaluations, len(curve)
        shares = [f"{tally.calls[purpose]}: {tally.counts[purpose]}" for purpose in PURPOSES]
        rest = n - sum(tally.counts.values())
        row = [
            modes,
            harmonics,
            f"{preload:g}",
            points,
            n,
            f"{n / points:.1f}",
            tally.arcs + 1,
            *shares,
            rest,
        ]
        print("| " + " | ".join(map(str, row)) + " |", flush=True)


if __name__ == "__main__":
    main()
