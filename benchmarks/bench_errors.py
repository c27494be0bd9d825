"""Stated errors of peaks beside the changes of complete searches.

``python -m benchmarks.bench_errors run [GROUP ...] [--sectors FOLDER] [--limit 60]`` computes the cases that
``results/peak_errors.jsonl`` does not have, one at a time, each within a limit of processor seconds, so that a run can be
continued.  ``... show`` prints the tables.

Groups
    ``known``: the turbine blade and the bladed disk (engine orders 5 and 10) at 0.7, 1, 1.5 and 3 times the preload of
    their optimum, and lumped masses; 24 cases.
    ``new``: 20 cases drawn with the seeds 80001 to 80020: model, engine order, friction coefficient, and preload.
    ``sectors``: ten random sectors with the seeds 80021 to 80030 at a drawn multiple of the preload of their optimum.
    FOLDER has the imported model ``m_def_def_def.h5`` and ``case.json`` of each, as for
    :mod:`benchmarks.sector_scenes`.

The stated errors are those of :attr:`bdamper.response.peak.Peak.errors` with one step of two harmonics.  A true change is
the difference from the highest point of a complete search with two more harmonics, with all residual modes (at most 72),
and with two more harmonics and six more residual modes together.  A search that exceeds ``BUDGET`` evaluations or the
limit has no truth.
"""

from __future__ import annotations

import argparse
import json
import time
import warnings
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import bdamper as bd
from bdamper.analyses.error_estimates import richer_study
from bdamper.harmonic_balance.problem import Problem
from bdamper.response.highest_peak import found_at, with_errors
from bdamper.response.linear_limits import peak_interval
from bdamper.response.peak_error import HARMONICS, VECTORS
from bdamper.response.richer_peak import LARGE_CHANGE, with_more_harmonics, with_soft_vectors
from benchmarks import sector_scenes

RESULTS = Path(__file__).parent / "results" / "peak_errors.jsonl"
NEW_SEEDS = range(80001, 80021)
SECTOR_SEEDS = range(80021, 80031)
BUDGET = 6000
"""Evaluations of a complete search with more harmonics or residual modes."""
FACTORS = (0.7, 1.0, 1.5, 3.0)
"""Preloads relative to that of the optimum."""
OPTIMA = {("turbine_blade", 5): 104.0, ("bladed_disk", 5): 33.48, ("bladed_disk", 10): 34.02}
"""Preloads (N) of optima with friction coefficient 0.3 and one newton."""


class Case(NamedTuple):
    """Study, preload (N), and interval (Hz) of a case, None for the default interval."""

    name: str
    study: bd.Study
    preload: float
    interval: tuple[float, float] | None = None


def shipped(model: str, order: int, friction: float = 0.3) -> bd.Study:
    """Return a study of a shipped model with one newton at the tip."""
    points = 9 if model == "bladed_disk" else None
    excitation = bd.Excitation("tip", direction="tangential", amplitude=1.0)
    loaded = bd.reference_model(model, points)
    return bd.Study(loaded, excitation, order, friction_coefficient=friction)


def separating() -> bd.Study:
    """Return two masses with a friction contact that opens."""
    contact = bd.Contact((1, 0), normal=1, kt=1.0, kn=1.0, mu=0.5)
    masses, damping, stiffness = [1.0, 0.1], [0.02, 0.02], [1.0, 0.1]
    load = {1: 1.0}
    return bd.lumped(
        masses,
        damping,
        stiffness,
        contacts=[contact],
        forces={0: 0.1},
        load_per_preload=load,
        harmonics=3,
    )


def internal_resonance(preload: float) -> bd.Study:
    """Return two masses with frequencies 1 to 3 and a Jenkins element."""
    contact = bd.Contact(0, kt=2.0, mu=1.0, preload=preload)
    stiffness = [[5.0, -4.0], [-4.0, 5.0]]
    return bd.lumped(
        [1.0, 1.0], [0.02, 0.02], stiffness, contacts=[contact], forces={1: 1.0}, harmonics=3
    )


def known_cases() -> Iterator[Case]:
    """Yield the cases on which the estimate was developed."""
    for (model, order), optimum in OPTIMA.items():
        study = shipped(model, order)
        for factor in FACTORS:
            yield Case(f"{model} {order} {factor:g}", study, factor * optimum)
    for preload in (0.1, 0.2, 0.4, 0.8):
        yield Case(f"separating {preload:g}", separating(), preload, (0.08, 0.4))
    for preload in (0.4, 0.8, 1.6, 3.0):
        yield Case(f"1:3 {preload:g}", internal_resonance(preload), 0.0, (0.1, 0.7))
    for preload in (0.4, 0.6, 0.8, 0.95):
        contact = bd.Contact(0, kt=20.0, mu=1.0, preload=preload)
        study = bd.lumped(1.0, 0.05, 1.0, contacts=[contact], forces={0: 1.0}, harmonics=3)
        yield Case(f"Jenkins {preload:g}", study, 0.0, (0.1, 1.0))


def new_cases() -> Iterator[Case]:
    """Yield the cases drawn with new seeds."""
    for seed in NEW_SEEDS:
        rng = np.random.default_rng(seed)
        model, order = list(OPTIMA)[int(rng.integers(3))]
        friction = float(rng.uniform(0.2, 0.5))
        factor = float(np.exp(rng.uniform(np.log(0.7), np.log(4.0))))
        # less friction needs a higher load
        preload = factor * OPTIMA[model, order] * 0.3 / friction
        yield Case(f"{seed} {model}", shipped(model, order, friction), preload)


def sector_cases(sectors: Path) -> Iterator[Case]:
    """Yield the random sectors whose models are in a folder."""
    for seed in SECTOR_SEEDS:
        if not (sectors / str(seed) / "m_def_def_def.h5").exists():
            continue
        study, preloads = sector_scenes.study_of(str(seed), sectors)
        study = study.replace(contact_stiffness="residual_modes")
        rng = np.random.default_rng(seed)
        factor = float(np.exp(rng.uniform(np.log(0.7), np.log(3.0))))
        optimum = sector_scenes.optimum(study, preloads)
        yield Case(f"{seed} sector", study, factor * optimum)


def compute(case: Case, say: sector_scenes.Say) -> None:
    """Say stated and true changes of a case, with seconds and evaluations, as far as known."""
    problem = case.study.problem
    preload = case.preload
    interval = peak_interval(problem.at(preload), case.interval, 1)
    start = time.process_time()
    own = found_at(problem, preload, interval)
    row: dict[str, Any] = {
        "case": case.name,
        "preload": preload,
        "seconds": time.process_time() - start,
        "evaluations": own.cost.evaluations,
        "amplitude": own.amplitude,
        "known": own.known,
    }
    say(dict(row))
    if not own.known:
        return
    start = time.process_time()
    estimated = with_errors(problem, own)
    row["estimate_seconds"] = time.process_time() - start
    row["estimate_evaluations"] = estimated.cost.evaluations - own.cost.evaluations
    assert estimated.top is not None
    for item in estimated.top.peak.errors:
        row[item.source] = item.amplitude if item.known else None
        row[f"{item.source} read"] = bool(0.0 < item.uncertainty < np.inf)
    say(dict(row))
    richer: dict[str, Callable[[], Problem | None]] = {
        f"true {HARMONICS}": lambda: with_more_harmonics(problem),
        f"true {VECTORS}": lambda: _all_vectors(problem),
        "true both": lambda: with_soft_vectors(with_more_harmonics(problem)),
    }
    for name, make in richer.items():
        other = make()
        if other is None:
            continue
        start = time.process_time()
        true = found_at(other, preload, interval, budget=BUDGET)
        row[name] = true.amplitude / own.amplitude - 1.0 if true.known else None
        row[f"{name} seconds"] = time.process_time() - start
        say(dict(row))


def _all_vectors(problem: Problem) -> Problem | None:
    richer = richer_study(problem, "residual flexibility", all_vectors=True)
    return None if richer is None else richer.problem


def run(groups: list[str], sectors: Path, limit: int) -> None:
    """Compute the missing cases."""
    done = {row["case"] for row in read()}
    for group in groups:
        cases = {"known": known_cases, "new": new_cases, "sectors": lambda: sector_cases(sectors)}
        for case in cases[group]():
            if case.name in done:
                continue
            row: dict[str, Any] = {"case": case.name, "failed": f"more than {limit} s"}
            for found in sector_scenes.limited(partial(compute, case), limit):
                row = found
            with RESULTS.open("a") as file:
                file.write(json.dumps({"group": group} | row, default=float) + "\n")
            print(json.dumps(row, default=float), flush=True)


def read() -> list[dict[str, Any]]:
    """Return the computed cases."""
    if not RESULTS.exists():
        return []
    return [json.loads(line) for line in RESULTS.read_text().splitlines()]


def show() -> None:
    """Print answers, misses, false alarms and share of the price by group and source."""
    rows = read()
    for group in dict.fromkeys(row["group"] for row in rows):
        of_group = [row for row in rows if row["group"] == group and row.get("known")]
        print(
            f"{group}: {len(of_group)} peaks of {sum(row['group'] == group for row in rows)} cases"
        )
        for source in (HARMONICS, VECTORS):
            _show_source(of_group, source)
        shares = [row["estimate_seconds"] / row["seconds"] for row in of_group]
        if shares:
            print(f"  price: median {np.median(shares):.2f}, largest {max(shares):.2f} of a search")
        _show_sum(of_group)


def _show_source(rows: list[dict[str, Any]], source: str) -> None:
    """Print how many stated changes of a source agree with the true ones."""
    asked = [row for row in rows if source in row]
    compared = [row for row in asked if row.get(f"true {source}") is not None]
    answers = [row for row in compared if row[source] is not None]
    large = [row for row in compared if abs(row[f"true {source}"]) > LARGE_CHANGE]
    without = [row["case"] for row in large if row[source] is None]
    missed = [
        row["case"]
        for row in large
        if row[source] is not None and abs(row[source]) < 0.5 * abs(row[f"true {source}"])
    ]
    false = [
        row["case"]
        for row in answers
        if abs(row[source]) > LARGE_CHANGE and abs(row[f"true {source}"]) < 0.4 * abs(row[source])
    ]
    n_known = sum(row[source] is not None for row in asked)
    print(
        f"  {source}: {n_known} answers of {len(asked)}, {len(compared)} with a truth, "
        f"{len(large)} above 5 %: missed {missed}, no answer {without}; false alarms {false}"
    )


def _show_sum(rows: list[dict[str, Any]]) -> None:
    """Print how the sum of both changes compares with the change by both together."""
    ratios: dict[str, list[float]] = {"sum of sizes": [], "signed sum": [], "root of squares": []}
    for row in rows:
        true, one, other = row.get("true both"), row.get(HARMONICS), row.get(VECTORS)
        if true is None or one is None or other is None or abs(true) < 0.01:
            continue
        ratios["sum of sizes"].append((abs(one) + abs(other)) / abs(true))
        ratios["signed sum"].append(abs(one + other) / abs(true))
        ratios["root of squares"].append(float(np.hypot(one, other)) / abs(true))
    for name, values in ratios.items():
        if values:
            low, middle, high = np.quantile(values, [0.1, 0.5, 0.9])
            below = sum(value < 0.5 for value in values)
            print(
                f"  {name} over the change by both: {low:.2f}, {middle:.2f}, {high:.2f} "
                f"(tenth, half, nine tenths of {len(values)}), below a half {below}"
            )


def main() -> None:
    """Run the command of the docstring of this module."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("command", choices=["run", "show"])
    parser.add_argument("groups", nargs="*", default=["known", "new", "sectors"])
    parser.add_argument("--sectors", type=Path, default=Path("sectors"))
    parser.add_argument("--limit", type=int, default=60)
    asked = parser.parse_args()
    warnings.simplefilter("ignore")
    bd.set_workers(1)
    if asked.command == "run":
        run(asked.groups, asked.sectors, asked.limit)
    else:
        show()


if __name__ == "__main__":
    main()
