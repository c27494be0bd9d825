"""Where the evaluations of a curve go: steps along it, refused ones, corners, events, its start; and what they count to.

Plain and converged curves of the shipped disk with nine points a face.  Evaluations are those of the equations, with or
without Jacobian; each counts for the innermost purpose.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import Any

import bdamper as bd
from bdamper.response.continuation import Follower
from bdamper.response.events import Events

CASES = [
    ("unit_traction", 1, 200.0),
    ("unit_traction", 3, 2000.0),
    ("residual_modes", 3, 125.0),
    ("residual_modes", 3, 500.0),
]
PURPOSES = ("accepted steps", "refused steps", "corners", "events", "ends", "start and the rest")


class Tally:
    """Counts evaluations by purpose while it is entered."""

    def __init__(self) -> None:
        self.counts: Counter[str] = Counter()
        self._inner = [0]
        self._methods = [
            (Follower, "try_step", lambda out: PURPOSES[1] if out[1] else PURPOSES[0]),
            (Follower, "end_at", lambda out: PURPOSES[4]),
            (Events, "around_corner", lambda out: PURPOSES[2]),
            (Events, "between", lambda out: PURPOSES[3]),
        ]
        self._kept = [getattr(owner, name) for owner, name, _ in self._methods]

    def _counted(self, method: Callable[..., Any], purpose: Callable[[Any], str]) -> Callable[..., Any]:
        def call(owner: Any, *args: Any, **options: Any) -> Any:
            before = owner.system.core.cost.evaluations
            self._inner.append(0)
            out = method(owner, *args, **options)
            spent, inner = owner.system.core.cost.evaluations - before, self._inner.pop()
            self.counts[purpose(out)] += spent - inner
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
    """Print the table."""
    print("| contact stiffness | harmonics | preload | points | evaluations | iterations | factorisations | "
          + " | ".join(f"{p}, %" for p in PURPOSES) + " |\n" + "|---" * (7 + len(PURPOSES)) + "|")  # fmt: skip
    for stiffness, harmonics, preload in CASES:
        study = bd.Study(
            bd.reference_model("bladed_disk"), engine_order=5, friction_coefficient=0.4, harmonics=harmonics,
            excitation=bd.Excitation("tip", "tangential", 1.0), contact_stiffness=stiffness,
        )  # fmt: skip
        with Tally() as tally:
            curve = study.frequency_response(preload, (270.0, 370.0))
        cost = curve.cost
        tally.counts[PURPOSES[-1]] = cost.evaluations - sum(tally.counts.values())
        shares = [f"{100.0 * tally.counts[purpose] / cost.evaluations:.0f}" for purpose in PURPOSES]
        row = [stiffness, harmonics, preload, len(curve), cost.evaluations, cost.iterations, cost.factorisations, *shares]
        print("| " + " | ".join(map(str, row)) + " |", flush=True)


if __name__ == "__main__":
    main()
