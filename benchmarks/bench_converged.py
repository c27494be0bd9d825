"""Converged, plain and optimal curves: processor time, counts and values, beside another checkout if one is named.

``python -m benchmarks.bench_converged [--against FOLDER]``: FOLDER is a checkout with an environment of its own (``make
.venv/dev.stamp``), such as that of the commit before.  Each case runs in turn in both, the better of two runs counts.
"""

from __future__ import annotations

import argparse
import inspect
import json
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import bdamper as bd

CONVERGED = [
    (modes, harmonics, preload)
    for modes in (5, 10)
    for harmonics in (3, 5)
    for preload in (125.0, 500.0, 2000.0)
]
PLAIN = [(10, harmonics, preload) for harmonics in (1, 3, 7) for preload in (200.0, 2000.0)]
OPTIMAL = [(modes, 3, 0.0) for modes in (5, 10)]
"""Optimal curves of 20 preloads from 100 N to 25 kN, not verified."""
TWELVE: Any = bd.ResidualModes(12) if hasattr(bd, "ResidualModes") else "residual_modes"
"""Residual modes of the same number in every version: twelve were the default of the first."""
if hasattr(TWELVE, "partial_contact"):
    TWELVE = replace(TWELVE, partial_contact=False)
REPEATS = 2


def run(kind: str, modes: int, harmonics: int, preload: float) -> dict[str, Any]:
    """Processor seconds of one curve of the shipped disk, its counts and values: an optimal one without a preload."""
    study = bd.Study(
        bd.reference_model("bladed_disk", 24),
        engine_order=5,
        friction_coefficient=0.4,
        excitation=bd.Excitation("tip", amplitude=1.0, direction="tangential"),
        harmonics=harmonics,
        blade_modes=modes,
        contact_stiffness="unit_traction" if kind == "plain" else TWELVE,
    )
    study.static(preload or 25e3)
    known = inspect.signature(study.optimal_curve).parameters
    alone: dict[str, Any] = {name: False for name in ("check", "verify") if name in known}
    seconds = []
    for _ in range(REPEATS):
        started = time.process_time()
        if kind == "optimal":
            fresh = study._with_problem(study.problem.replace())
            curve: Any = fresh.optimal_curve((100.0, 25e3), 20, frequency=(270.0, 380.0), **alone)
        else:
            curve = study.frequency_response(
                preload, (300.0, 380.0) if kind == "converged" else (270.0, 370.0)
            )
        seconds.append(time.process_time() - started)
    cost = curve.cost
    values = (
        curve.amplitude[curve.requested].tolist()
        if kind == "optimal"
        else [float(curve.peak.amplitude)]
    )
    return {
        "seconds": min(seconds),
        "counts": (cost.evaluations, cost.iterations, cost.factorisations, cost.failed_steps),
        "points": len(curve),
        "status": "complete" if curve.complete else "incomplete",
        "values": values,
    }


def serve() -> None:
    """Runs the cases that come line by line, for :class:`Checkout`."""
    for line in sys.stdin:
        print(json.dumps(run(*json.loads(line))), flush=True)


class Checkout:
    """A process in the environment of a checkout that runs cases."""

    def __init__(self, folder: Path) -> None:
        self.process = subprocess.Popen(
            [str(folder / ".venv/bin/python"), __file__, "--serve"],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=folder,
        )  # fmt: skip

    def run(self, *case: Any) -> dict[str, Any]:
        assert self.process.stdin is not None and self.process.stdout is not None
        print(json.dumps(case), file=self.process.stdin, flush=True)
        out: dict[str, Any] = json.loads(self.process.stdout.readline())
        return out


def table(kind: str, cases: list[tuple[int, int, float]], other: Checkout | None) -> None:
    print(f"## {kind} curves of the shipped disk, 24 points a face\n")
    print("| blade modes | harmonics | preload | points | evaluations, iterations, factorisations, failed steps | seconds |"
          " before: points | counts | seconds | ratio | values moved by | least of them |")  # fmt: skip
    print("|---|---|---|---|---|---|---|---|---|---|---|---|")
    sums = [0.0, 0.0]
    for case in cases:
        now = run(kind, *case)
        sums[0] += now["seconds"]
        row = [*case, now["points"], now["counts"], f"{now['seconds']:.3f}"]
        if other is not None:
            before = other.run(kind, *case)
            sums[1] += before["seconds"]
            row += [before["points"], tuple(before["counts"]), f"{before['seconds']:.3f}"]
            moved = max(abs(a / b - 1.0) for a, b in zip(now["values"], before["values"]))
            row += [f"{now['seconds'] / before['seconds']:.2f}", f"{moved:.0e}"]
        row += [f"{min(now['values']):.12g}", "" if now["status"] == "complete" else now["status"]]
        print("| " + " | ".join(str(item) for item in row) + " |", flush=True)
    print(
        f"\nIn sum {sums[0]:.2f} s" + (f", ratio {sums[0] / sums[1]:.2f}" if other else "") + "\n"
    )


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.bench_converged", description=__doc__
    )
    parser.add_argument("--against", type=Path, metavar="FOLDER")
    folder = parser.parse_known_args()[0].against
    other = Checkout(folder) if folder else None
    for kind, cases in (("converged", CONVERGED), ("plain", PLAIN), ("optimal", OPTIMAL)):
        table(kind, cases, other)


if __name__ == "__main__":
    serve() if "--serve" in sys.argv else main()
