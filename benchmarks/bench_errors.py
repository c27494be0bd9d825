"""Stated errors of peaks beside the changes of complete searches.

``python -m benchmarks.bench_errors run [GROUP ...] [--sectors FOLDER] [--limit 60]`` computes the cases that
``results/peak_errors.jsonl`` does not have, one at a time, each within a limit of processor seconds, so that a run can be
continued.  ``... restate`` computes the stated errors of all cases again, for example after a change of the estimate, and
keeps the complete searches.  ``... show`` prints the tables.

Groups
    ``known``: the turbine blade and the bladed disk (engine orders 5 and 10) at 0.7, 1, 1.5 and 3 times the preload of
    their optimum, and lumped masses; 24 cases.
    ``new``: 20 cases drawn with the seeds 80001 to 80020: model, engine order, friction coefficient, and preload.
    ``sectors``: ten random sectors with the seeds 80021 to 80030 at a drawn multiple of the preload of their optimum.
    FOLDER has the imported model ``m_def_def_def.h5`` and ``case.json`` of each, as for
    :mod:`benchmarks.sector_scenes`.

The stated errors are those of :attr:`bdamper.response.peak.Peak.errors` with one step of two harmonics.  A true change is
the difference from the highest point of a complete search: with two more harmonics, with these and six more residual
modes, and with all residual modes (at most 72) beside the harmonics of the study.  The true change by residual modes is
that of the second search without that of the first.  All residual modes beside three harmonics are no reference, because
they leave the contact forces above the third harmonic without flexibility.  A search that exceeds ``BUDGET`` evaluations
or the limit has no truth.
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
from bdamper.response.highest_peak import AtPreload, found_at, with_errors
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
    row |= stated(problem, own)
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


def stated(problem: Problem, own: AtPreload) -> dict[str, Any]:
    """Return the stated changes of a known response by source, None if unknown, and their price."""
    start = time.process_time()
    estimated = with_errors(problem, own)
    row: dict[str, Any] = {
        "estimate_seconds": time.process_time() - start,
        "estimate_evaluations": estimated.cost.evaluations - own.cost.evaluations,
    }
    assert estimated.top is not None
    for item in estimated.top.peak.errors:
        row[item.source] = item.amplitude if item.known else None
        row[f"{item.source} read"] = bool(0.0 < item.uncertainty < np.inf)
    return row


def restate(groups: list[str], sectors: Path) -> None:
    """Compute the stated errors of the known cases again."""
    rows = {row["case"]: row for row in read()}
    for case in cases_of(groups, sectors):
        row = rows.get(case.name, {})
        if HARMONICS not in row:
            continue
        problem = case.study.problem
        interval = peak_interval(problem.at(case.preload), case.interval, 1)
        row |= stated(problem, found_at(problem, case.preload, interval))
        print(json.dumps(row, default=float), flush=True)
    lines = [json.dumps(row, default=float) + "\n" for row in rows.values()]
    RESULTS.write_text("".join(lines))


def _all_vectors(problem: Problem) -> Problem | None:
    richer = richer_study(problem, "residual flexibility", all_vectors=True)
    return None if richer is None else richer.problem


def cases_of(groups: list[str], sectors: Path) -> Iterator[Case]:
    """Yield the cases of groups."""
    makers = {"known": known_cases, "new": new_cases, "sectors": partial(sector_cases, sectors)}
    for group in groups:
        yield from makers[group]()


def run(groups: list[str], sectors: Path, limit: int) -> None:
    """Compute the missing cases."""
    done = {row["case"] for row in read()}
    for group in groups:
        for case in cases_of([group], sectors):
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
    for group in (*dict.fromkeys(row["group"] for row in rows), "all"):
        asked = [row for row in rows if group in (row["group"], "all")]
        peaks = [row for row in asked if row.get("known")]
        # motion that the estimate leaves out
        rattling = [row["case"] for row in peaks if HARMONICS not in row]
        print(f"{group}: {len(peaks)} peaks of {len(asked)} cases; without errors: {rattling}")
        peaks = [row for row in peaks if HARMONICS in row]
        _show_source(peaks, HARMONICS, partial(_true, name=f"true {HARMONICS}"))
        _show_source(peaks, VECTORS, _true_by_vectors)
        _show_source(peaks, VECTORS, partial(_true, name=f"true {VECTORS}"), ", all at once")
        for unit in ("seconds", "evaluations"):
            shares = [row[f"estimate_{unit}"] / row[unit] for row in peaks]
            if shares:
                middle, most = np.median(shares), max(shares)
                print(f"  {unit}: median {middle:.2f}, largest {most:.2f} of a search")
        _show_sum(peaks)


def _true(row: dict[str, Any], name: str) -> float | None:
    return row.get(name)


def _true_by_vectors(row: dict[str, Any]) -> float | None:
    """Return the true change by six more residual modes beside two more harmonics."""
    both, harmonics = row.get("true both"), row.get(f"true {HARMONICS}")
    return None if both is None or harmonics is None else both - harmonics


def _show_source(
    rows: list[dict[str, Any]],
    source: str,
    truth: Callable[[dict[str, Any]], float | None],
    remark: str = "",
) -> None:
    """Print how many stated changes of a source agree with the true ones."""
    asked = [row for row in rows if source in row]
    compared = [(row["case"], row[source], truth(row)) for row in asked if truth(row) is not None]
    large = [(case, one, true) for case, one, true in compared if abs(true) > LARGE_CHANGE]
    without = [case for case, one, _ in large if one is None]
    missed = [case for case, one, true in large if one is not None and abs(one) < 0.5 * abs(true)]
    false = [
        case
        for case, one, true in compared
        if one is not None and abs(one) > LARGE_CHANGE and abs(true) < 0.4 * abs(one)
    ]
    n_known = sum(row[source] is not None for row in asked)
    print(
        f"  {source}{remark}: {n_known} answers of {len(asked)}, {len(compared)} with a truth, "
        f"{len(large)} above 5 %: missed {missed}, no answer {without}; false alarms {false}"
    )


SMALL = 0.02
"""Relative error that may be stated too small or too large."""


def _show_sum(rows: list[dict[str, Any]]) -> None:
    """Print how rules for both changes compare with the change by both together."""
    rules: dict[str, Callable[[float, float], float]] = {
        "sum of sizes": lambda one, other: abs(one) + abs(other),
        "signed sum": lambda one, other: abs(one + other),
        "root of squares": lambda one, other: float(np.hypot(one, other)),
    }
    compared = []
    for row in rows:
        # lumped masses have no residual modes
        true = row.get("true both" if VECTORS in row else f"true {HARMONICS}")
        one, other = row[HARMONICS], row.get(VECTORS, 0.0)
        if true is not None and one is not None and other is not None:
            compared.append((row["case"], abs(true), one, other))
    for name, rule in rules.items():
        above, below = [], []
        for case, true, one, other in compared:
            size = rule(one, other)
            if true > max(2.0 * size, SMALL):
                above.append(case)
            if size > max(4.0 * true, SMALL):
                below.append(case)
        print(
            f"  {name}, {len(compared)} compared with the change by both: more than twice it in "
            f"{above}, less than a quarter of it in {below}"
        )


def main() -> None:
    """Run the command of the docstring of this module."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("command", choices=["run", "restate", "show"])
    parser.add_argument("groups", nargs="*", default=["known", "new", "sectors"])
    parser.add_argument("--sectors", type=Path, default=Path("sectors"))
    parser.add_argument("--limit", type=int, default=60)
    asked = parser.parse_args()
    warnings.simplefilter("ignore")
    bd.set_workers(1)
    if asked.command == "run":
        run(asked.groups, asked.sectors, asked.limit)
    elif asked.command == "restate":
        restate(asked.groups, asked.sectors)
    else:
        show()


if __name__ == "__main__":
    main()
