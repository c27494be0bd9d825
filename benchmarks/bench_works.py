"""Times, counts and memory of typical works: one table that compares versions and machines.

``make bench`` runs every work in a process of its own on one thread.  It writes
``benchmarks/results/bench.jsonl`` and the table of docs/evidence/times.md.  Names as arguments run
and print only these works.  ``python -m benchmarks.bench_works --against FILE`` runs nothing and
compares the stored table with the file of another version, in units of processor time
(:mod:`benchmarks.measuring`).
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Sequence
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np

import bdamper as bd
from benchmarks import fill
from benchmarks.bench_core import Case
from benchmarks.measuring import (
    EVIDENCE,
    RESULTS,
    Unit,
    UnitClock,
    in_own_process,
    peak_memory,
    processor_name,
    read_lines,
    write_lines,
)

STORED = RESULTS / "bench.jsonl"
DISK_PRELOAD, BLADE_PRELOAD = 2000.0, 104.0
"""Preloads (N) of the difficult disk and of the turbine blade."""
SWEEP = {"friction_coefficient": (0.2, 0.3, 0.4), "preload": (100.0, 200.0, 400.0)}
KERNEL_EVALUATIONS = 2000
NOTEWORTHY = 0.1
"""Relative change of the contact part of the unit, compared with its factorisations, that the
comparison reports."""
Counts = dict[str, int]
Work = Callable[[], Callable[[], Counts]]
"""Preparation of a work, which is not measured, and the work with its counts."""


# ---- Works ----


def study_of(model: str) -> bd.Study:
    """Return the default study of a shipped model at engine order 5."""
    tip = bd.Excitation("tip", direction="tangential", amplitude=1.0)
    return bd.Study(bd.reference_model(model), tip, 5)


def optimal_curve(model: str) -> Callable[[], Counts]:
    """Return the default optimal curve of a model, without its checks."""
    study = study_of(model)

    def run() -> Counts:
        curve = study.optimal_curve(check=False, progress=False, errors=False)
        return {"points": len(curve.preload), "evaluations": curve.cost.evaluations}

    return run


def peak() -> Callable[[], Counts]:
    """Return the search for the highest peak of the difficult disk."""
    study = study_of("bladed_disk")

    def run() -> Counts:
        found = study.peak(DISK_PRELOAD, progress=False, errors=False)
        return {"evaluations": found.cost.evaluations}

    return run


def time_response() -> Callable[[], Counts]:
    """Return the default amplitude in time of the turbine blade near its optimal preload."""
    study = study_of("turbine_blade")
    start = study.peak(BLADE_PRELOAD, progress=False, errors=False)

    def run() -> Counts:
        response = study.time_response(start, progress=False)
        return {"evaluations": response.cost.evaluations, "periods": response.periods}

    return run


def sweep() -> Callable[[], Counts]:
    """Return a sweep of peaks of the turbine blade over friction coefficient and preload."""
    study = study_of("turbine_blade")

    def run() -> Counts:
        result = bd.sweep(study, SWEEP, progress=False)
        return {"points": len(result), "evaluations": int(result.cost["evaluations"].sum())}

    return run


def event_kernel() -> Callable[[], Counts]:
    """Return evaluations of residual and Jacobian with event-driven contact forces."""
    case = Case(points=96, modes=16, harmonics=3)
    system = case.system()
    point = np.append(case.u, 0.7)
    residual, jacobian = np.empty(case.n), np.empty((case.n, case.n))

    def run() -> Counts:
        for _ in range(KERNEL_EVALUATIONS):
            system.evaluate(point, residual, jacobian)
        return {"evaluations": KERNEL_EVALUATIONS}

    return run


def sector_import(mesh: str) -> Callable[[], Counts]:
    """Return the import of a sector from its matrices."""
    # needs scikit-fem
    from bdamper.fem.generated_models import SectorFE
    from benchmarks.bench_import import DENSITIES, count_equations, import_sector

    fe = SectorFE(density=DENSITIES[mesh])
    work = import_sector(fe)

    def run() -> Counts:
        work()
        return {"equations": count_equations(fe)}

    return run


WORKS: dict[str, Work] = {
    "event kernel": event_kernel,
    "peak, disk": peak,
    "sweep, blade": sweep,
    "optimal curve, disk": lambda: optimal_curve("bladed_disk"),
    "optimal curve, blade": lambda: optimal_curve("turbine_blade"),
    "time response, blade": time_response,
    "import, smallest mesh": lambda: sector_import("smallest"),
    "import, small mesh": lambda: sector_import("small"),
    "import, middle mesh": lambda: sector_import("middle"),
    "import, medium mesh": lambda: sector_import("medium"),
}


# ---- Measurement ----


def measure(name: str) -> dict[str, Any]:
    """Run a work in this process.

    The result has counts, processor and wall time (s), peak memory (MB), and both parts of the unit
    (s).  The unit is measured before and after the work.
    """
    run = WORKS[name]()
    clock = UnitClock()
    clock.run(2)
    wall = time.perf_counter()
    processor = time.process_time()
    counts = run()
    wall = time.perf_counter() - wall
    processor = time.process_time() - processor
    memory = peak_memory()
    clock.run(3)
    unit = clock.shortest
    return {
        "work": name,
        "counts": counts,
        "processor": round(processor, 4),
        "wall": round(wall, 4),
        "memory": round(memory),
        "factorisations": round(unit.factorisations, 4),
        "contact": round(unit.contact, 4),
    }


def header() -> dict[str, str]:
    """Return what all works of a run share."""
    return {
        "processor": processor_name(),
        "version": bd.__version__,
        "date": date.today().isoformat(),
    }


def unit_of(record: dict[str, Any]) -> float:
    """Return the processor time (s) of a unit in the process of a work."""
    return Unit(record["factorisations"], record["contact"]).seconds


def contact_share(record: dict[str, Any]) -> float:
    """Return the time of contact forces over that of factorisations, of the unit."""
    return float(record["contact"] / record["factorisations"])


# ---- Tables ----


def counts_in_words(counts: Counts) -> str:
    """Return counts as the text of a cell."""
    return ", ".join(f"{number:,} {name}" for name, number in counts.items())


def table(head: dict[str, str], records: Sequence[dict[str, Any]]) -> str:
    """Return the table of all works in Markdown."""
    lines = [
        f"{head['processor']}, version {head['version']}, {head['date']}. One unit took "
        f"{min(map(unit_of, records)):.2f} to {max(map(unit_of, records)):.2f} s.",
        "",
        "| work | counts | processor (units) | wall (units) | processor (s) | wall (s) "
        "| peak memory (MB) |",
        "|---" * 7 + "|",
    ]
    for record in records:
        unit = unit_of(record)
        cells = (
            record["work"],
            counts_in_words(record["counts"]),
            f"{record['processor'] / unit:.3g}",
            f"{record['wall'] / unit:.3g}",
            f"{record['processor']:.3g}",
            f"{record['wall']:.3g}",
            f"{record['memory']:,.0f}",
        )
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def comparison(
    head: dict[str, str],
    records: Sequence[dict[str, Any]],
    other_head: dict[str, str],
    others: Sequence[dict[str, Any]],
) -> str:
    """Return the ratios of a run to another run.

    Processor and wall time are compared in units, memory and counts directly.
    """
    known = {record["work"]: record for record in others}
    lines = [f"version {head['version']} over version {other_head['version']}"]
    lines += [f"  {one['processor']}, {one['date']}" for one in (head, other_head)]
    lines += ["", f"{'work':<24}{'processor':>10}{'wall':>8}{'memory':>8}  counts"]
    contact_changes = []
    for record in records:
        other = known.get(record["work"])
        if other is None:
            lines.append(f"{record['work']:<24}only in version {head['version']}")
            continue
        units = unit_of(record) / unit_of(other)
        processor = record["processor"] / other["processor"] / units
        wall = record["wall"] / other["wall"] / units
        memory = record["memory"] / other["memory"]
        contact_changes.append(contact_share(record) / contact_share(other))
        counts = [
            f"{name} {number / other['counts'][name]:.3g}"
            for name, number in record["counts"].items()
            if other["counts"].get(name)
        ]
        lines.append(
            f"{record['work']:<24}{processor:>10.2f}{wall:>8.2f}{memory:>8.2f}  {', '.join(counts)}"
        )
    if contact_changes:
        change = float(np.median(contact_changes))
        if abs(change - 1.0) > NOTEWORTHY:
            lines += [
                "",
                f"Contact forces take {change:.2f} times as long compared with factorisations: "
                "the unit itself has changed.",
            ]
    return "\n".join(lines)


# ---- Command line ----


def main() -> None:
    """Run the works, or compare the stored table with a file."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.bench_works", description=__doc__)
    parser.add_argument("works", nargs="*", help=f"out of {', '.join(WORKS)}; by default all")
    parser.add_argument("--against", type=Path, metavar="FILE", help="bench.jsonl of another run")
    parser.add_argument("--json", action="store_true", help="run in this process, print JSON")
    given = parser.parse_args()
    unknown = [name for name in given.works if name not in WORKS]
    if unknown:
        parser.error(f"unknown works: {', '.join(unknown)}")
    if given.json:
        (name,) = given.works
        print(json.dumps(measure(name)))
        return
    if given.against:
        head, *records = read_lines(STORED)
        other_head, *others = read_lines(given.against)
        print(comparison(head, records, other_head, others))
        return
    records = []
    for name in given.works or WORKS:
        print(name, file=sys.stderr, flush=True)
        records.append(in_own_process("benchmarks.bench_works", name, "--json"))
    text = table(header(), records)
    print(text)
    if not given.works:
        write_lines(STORED, [header(), *records])
        EVIDENCE.write_text(fill(EVIDENCE.read_text(), "works", text))


if __name__ == "__main__":
    main()
