"""Peaks of shrouded blades around first slip.

``python -m benchmarks.bench_shrouds run [--sectors FOLDER] [--models FOLDER] [--limit 30]`` computes the cases that
``results/shrouds.jsonl`` does not have, one at a time, each within a limit of processor seconds, so that a run can be
continued.  ``... in-time`` integrates the complete peaks in time and stores their amplitudes (``--seconds``: most
processor time of each).  ``... show`` prints the tables.

The shrouds are the shipped one; with ``--models`` the stage of 72 blades with wedge and shroud (``shrouded_stage.h5``);
and with ``--sectors`` the random sectors 72005 and 72011, and those of the seeds 80021 to 80030 that have a shroud.
FOLDER has ``m_mid.h5``, the imported model with a location "mid" at half the height of the blade, and ``case.json`` of
each.  The force acts at this location in the direction in which the bonded blade moves most there.

The load on the shroud is the largest of five decades with which no face slips at rest beyond the distance of its points,
and at which there is a finite first slip.
Excitations are multiples of that of first slip.
"""

from __future__ import annotations

import argparse
import json
import time
import warnings
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import bdamper as bd
from benchmarks.sector_scenes import Say, limited

RESULTS = Path(__file__).parent / "results" / "shrouds.jsonl"
SEEDS = (72005, 72011, *range(80021, 80031))
FACTORS = (0.5, 0.9, 1.1, 1.5, 3.0)
"""Excitation over that of first slip."""
LOADS = (1e4, 1e3, 1e2, 10.0, 1.0)
"""Loads on the shroud, N."""
STAGE_WEDGE = 4000.0
"""Load on the dampers of the stage, N."""


class Shroud(NamedTuple):
    """Study of a shroud with a unit excitation, and the preload of its dampers (N)."""

    name: str
    study: bd.Study
    preload: float

    def with_load(self, load: float) -> bd.Study:
        """Return the study with an assembly load (N) on the shroud."""
        return self.study.replace(constant_loads={"shroud": load})


def shipped() -> Shroud:
    """Return the shipped shroud with its two strip dampers."""
    study = bd.Study(
        bd.reference_model("shrouded_blade"),
        bd.Excitation("tip", "axial", 1.0),
        4,
        load_per_preload={"front": 1.0, "rear": 0.6},
        harmonics=1,
    )
    return Shroud("shipped", study, 300.0)


def stage(models: Path) -> Shroud:
    """Return the stage with wedge and shroud."""
    model = bd.load_model(models / "shrouded_stage.h5")
    study = bd.Study(model, bd.Excitation("mid"), 8, friction_coefficient=0.3, harmonics=1)
    return Shroud("stage", study, STAGE_WEDGE)


def random_shroud(folder: Path) -> Shroud:
    """Return a random shroud, excited at half height."""
    case = json.loads((folder / "case.json").read_text())
    model = bd.load_model(folder / "m_mid.h5")
    studies = []
    for direction in ("tangential", "axial", "radial"):
        study = bd.Study(
            model,
            bd.Excitation("mid", direction),
            case["EO"],
            friction_coefficient=round(case["mu"], 3),
            harmonics=1,
        )
        pressed = study.replace(constant_loads={"shroud": 100.0})
        studies.append((pressed.stuck().peak.amplitude, study))
    _, study = max(studies, key=lambda item: item[0])
    return Shroud(folder.name, study, 0.0)


def shrouds(models: Path | None, sectors: Path | None) -> Iterator[Shroud]:
    """Yield the shrouds whose models there are."""
    yield shipped()
    if models is not None:
        yield stage(models)
    if sectors is not None:
        for seed in SEEDS:
            folder = sectors / str(seed)
            if (folder / "m_mid.h5").exists():
                yield random_shroud(folder)


def with_largest_load(shroud: Shroud) -> tuple[bd.Study, float] | None:
    """Return the study with the largest load at which its faces stay on each other, and this load (N)."""
    for load in LOADS:
        study = shroud.with_load(load)
        state = study.static(shroud.preload)
        if not state.ok or state.too_far:
            continue
        if np.isfinite(study.first_slip(shroud.preload).factor):
            return study, load
    return None


def compute(shroud: Shroud, factor: float, say: Say) -> None:
    """Say peak, linear amplitude and cost at a multiple of first slip."""
    found = with_largest_load(shroud)
    if found is None:
        say({"failed": "no load with which the faces stay on each other"})
        return
    study, load = found
    limit = study.first_slip(shroud.preload)
    excitation = study.settings.excitation
    study = study.replace(excitation=replace(excitation, amplitude=factor * limit.force))
    start = time.process_time()
    peak = study.peak(shroud.preload, progress=False)
    say(
        {
            "load": load,
            "interference": study.static(shroud.preload).largest_interference["shroud"],
            "first slip": limit.force,
            "linear": factor * limit.amplitude_at_first_slip,
            "frequency": limit.frequency,
            "amplitude": peak.amplitude,
            "lower bound": peak.lower_bound,
            "status": peak.search_status,
            "reason": peak.search_reason,
            "error": peak.error,
            "seconds": time.process_time() - start,
        }
    )


def run(models: Path | None, sectors: Path | None, limit: int) -> None:
    """Compute all cases that are not known, and store each."""
    known = {(row["case"], row["factor"]) for row in rows()}
    for shroud in shrouds(models, sectors):
        for factor in FACTORS:
            if (shroud.name, factor) in known:
                continue
            row: dict[str, Any] = {"case": shroud.name, "factor": factor}
            for said in limited(partial(compute, shroud, factor), limit):
                row |= said
            if "status" not in row:
                row.setdefault("failed", f"no answer in {limit} s of the processor")
            with RESULTS.open("a") as file:
                file.write(json.dumps(row) + "\n")
            print(row, flush=True)


def in_time(shroud: Shroud, row: dict[str, Any], seconds: float, say: Say) -> None:
    """Say the amplitudes by time integration near the peak of a row (m)."""
    force = row["factor"] * row["first slip"]
    excitation = replace(shroud.study.settings.excitation, amplitude=force)
    study = shroud.with_load(row["load"]).replace(excitation=excitation)
    start = time.process_time()
    peak = study.peak(shroud.preload, progress=False)
    found = study.time_response(peak, seconds=seconds, progress=False)
    say(
        {
            "lowest": found.lowest,
            "mean": found.mean,
            "highest": found.highest,
            "status": found.status_text,
            "seconds": time.process_time() - start,
        }
    )


def integrate(models: Path | None, sectors: Path | None, seconds: float, limit: int) -> None:
    """Integrate the complete peaks in time that have no such amplitude yet, and store the rows again."""
    by_name = {shroud.name: shroud for shroud in shrouds(models, sectors)}
    known = rows()
    for row in known:
        is_open = row.get("status") == "complete" and "in time" not in row
        if not is_open or row["case"] not in by_name:
            continue
        work = partial(in_time, by_name[row["case"]], row, seconds)
        said = list(limited(work, int(seconds) + limit))
        row["in time"] = said[0] if said else {"status": "no answer"}
        RESULTS.write_text("".join(json.dumps(each) + "\n" for each in known))
        print(row["case"], row["factor"], row["in time"], flush=True)


def rows() -> list[dict[str, Any]]:
    """Return the stored rows."""
    if not RESULTS.exists():
        return []
    return [json.loads(line) for line in RESULTS.read_text().splitlines()]


def show() -> None:
    """Print one row for each shroud, and the number of complete peaks."""
    by_case: dict[str, dict[float, dict[str, Any]]] = {}
    for row in rows():
        by_case.setdefault(row["case"], {})[row["factor"]] = row
    head = " | ".join(f"{factor:g}" for factor in FACTORS)
    print(f"| shroud | load, N | interference, µm | first slip, N | {head} |")
    print("|---|---|---|---|" + "---|" * len(FACTORS))
    n_complete = 0
    for name, by_factor in by_case.items():
        cells = []
        of_case: dict[str, Any] = {}
        for factor in FACTORS:
            row = by_factor.get(factor, {})
            if row.get("status") == "complete":
                n_complete += 1
                of_case = row
                ratio = row["amplitude"] / row["linear"]
                cells.append(f"{ratio:.3f}, {row['seconds']:.1f} s")
            else:
                cells.append(row.get("failed", row.get("status", "")))
        interference = 1e6 * of_case.get("interference", np.nan)
        load, slip = of_case.get("load", np.nan), of_case.get("first slip", np.nan)
        print(f"| {name} | {load:g} | {interference:.3g} | {slip:.3g} | {' | '.join(cells)} |")
    print(f"\n{n_complete} of {len(FACTORS) * len(by_case)} complete")


def main() -> None:
    """Compute or print the cases."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("action", choices=("run", "in-time", "show"))
    parser.add_argument("--models", type=Path)
    parser.add_argument("--sectors", type=Path)
    parser.add_argument("--limit", type=int, default=30)
    parser.add_argument("--seconds", type=float, default=60.0)
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    if given.action == "run":
        run(given.models, given.sectors, given.limit)
    if given.action == "in-time":
        integrate(given.models, given.sectors, given.seconds, given.limit)
    show()


if __name__ == "__main__":
    main()
