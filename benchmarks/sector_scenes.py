"""Random sectors: bonded parts of faces, stated and true errors of peaks, and amplitudes in time.

FOLDER has a folder for each seed, with ``case.json`` of the generator of sectors and the imported
model ``m_def_def_def.h5``.  Names of seeds may follow each command.

``python -m benchmarks.sector_scenes peaks --sectors FOLDER`` computes the peaks that
``results/peaks.jsonl`` does not have, on sectors and on two shipped models.
``... bonded --sectors FOLDER`` does the linear test (``results/bonded_parts.jsonl``).
``... in_time --sectors FOLDER --seconds 60`` integrates one peak of each sector in time
(``results/sectors_in_time.jsonl``), with the default vectors.  The peak is the first complete one
at 1.2, 1.7, and 2.5 times the preload of the optimum.  A sector that reaches the limit keeps its
error of the energy and the range of its last motion; a larger limit computes it again.
``... optima --sectors FOLDER`` computes the default optimal curve of sectors, and the peak at the
recommended preload with its references (``results/sector_optima.jsonl``).
``... show`` prints the tables of docs/evidence/measured-contact.md.

A peak belongs to a study with the vectors of partial contact at a multiple of the preload of its optimum.  The
stated error is the sum of :meth:`bdamper.Study.estimate_errors`.  The reference has all residual
modes, 20 blade modes and all modes of the damper, and two harmonics more until the amplitude
changes by less than 2 %.  It is only computed if time integration near the peak, the first
reference, does not settle within its limit of processor time.  If neither does, the peak has no
reference.

The linear test compares the shift of mode 1 by bonded parts of the faces
(:mod:`bdamper.contact.partial_contact`) with the vectors of all parts, and with vectors adapted to
each part: the contact forces of mode 1 with this part bonded.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import resource
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from itertools import pairwise
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

import bdamper as bd
from bdamper.analyses.error_estimates import Tops, solve_other
from bdamper.contact import residual_flexibility
from bdamper.contact.partial_contact import (
    SMALL_SHIFT,
    bonded_parts,
    coupling_of_default,
    partial_contact,
)
from bdamper.response.peak import Peak
from bdamper.response.richer_peak import with_stand_ins
from bdamper.time_domain.transient import CRITERIA, Transient, energy_error, second_half
from bdamper.util.errors import COMPLETE, BdamperWarning

RESULTS = Path(__file__).parent / "results" / "peaks.jsonl"
BONDED = Path(__file__).parent / "results" / "bonded_parts.jsonl"
IN_TIME = Path(__file__).parent / "results" / "sectors_in_time.jsonl"
OPTIMA = Path(__file__).parent / "results" / "sector_optima.jsonl"
SEEDS = tuple(str(seed) for seed in range(62001, 62014))
"""Ten wedges and three shrouds."""
STUBBY = tuple(str(seed) for seed in range(63001, 63011))
SLENDER = tuple(f"630{n}" for n in (13, 22, 26, 29, 31, 32, 36, 37, 39, 41))
"""The first ten seeds from 63001 on of each family, stubby and slender necks."""
WITH_OPTIMA = ("62006", "62008", "62010", "62013")
SHIPPED = {"turbine_blade": 0.3, "bladed_disk": 0.4}
"""Friction coefficient by model."""
FACTORS, SHIPPED_FACTORS = (1.2, 3.0, 0.5), (1.0, 1.2, 3.0, 0.5)
ESTIMATE_LIMIT, LIMIT = 160, 90
"""Processor time of an estimate, and of a reference by harmonic balance or in time, s."""
IN_TIME_SECONDS = 60
"""Processor time after which a reference in time ends with what it has, s."""
SETTLED = 0.02
MOST_HARMONICS = 15
WHOLE: dict[str, Any] = {"blade_modes": 20, "contact_stiffness": bd.ResidualModes("all")}
VECTORS = bd.ResidualModes(partial_contact=True)
OPTIMUM_PRELOADS = 20
"""Preloads of a default optimal curve."""
TIME_FACTORS = (1.2, 1.7, 2.5)
"""Preloads of time integrations over that of the optimum, in the order in which they are tried."""
LARGEST_ERROR = 0.1
"""Largest true error that a complete peak may have."""
Known = dict[str, dict[str, Any]]
Say = Callable[[Any], None]


# ---- scenes ----


def sector(name: str, sectors: Path) -> tuple[dict[str, Any], bd.Model, int]:
    """Return dimensions and model of a sector, and the nodal diameter of its engine order."""
    folder = sectors / name
    case = json.loads((folder / "case.json").read_text())
    model = bd.load_model(folder / "m_def_def_def.h5")
    return case, model, model.folded_nodal_diameter(case["EO"])[0]


def study_of(name: str, sectors: Path) -> tuple[bd.Study, tuple[float, float] | None]:
    """Return the default study of a model, and the preloads (N) that contain its optimum.

    The excitation of a sector moves the tip of the free blade by 1 % of its length.
    """
    if name in SHIPPED:
        model = bd.reference_model(name, 9)
        study = bd.Study(model, bd.Excitation("tip"), 5, friction_coefficient=SHIPPED[name])
        return study.replace(contact_stiffness=VECTORS), None
    case, model, diameter = sector(name, sectors)
    basis = model.bodies["blade"].bases[diameter]
    motion = np.abs(basis.locations["tip"][:, 0])
    direction = ("tangential", "radial", "axial")[int(motion.argmax())]
    free = 1e-5 * case["H"]
    force = free * 2.0 * case["zeta"] * basis.omega2[0] / motion.max() ** 2
    excitation = bd.Excitation("tip", direction=direction, amplitude=force)
    friction = round(case["mu"], 3)
    more = {"load_per_preload": {"shroud": 1.0}} if case["kind"] == "shroud" else {}
    study = bd.Study(model, excitation, case["EO"], friction_coefficient=friction, **more)
    return study.replace(contact_stiffness=VECTORS), (10.0 * force, 5e4 * force)


def optimum(study: bd.Study, preloads: tuple[float, float] | None) -> float:
    """Return the preload (N) of the optimum; of sectors with one harmonic.

    A curve without an optimum gives the middle of its preloads.
    """
    if preloads is None:
        return study.optimal_curve(check=False, progress=False).optimum.preload
    quick = study.replace(harmonics=1)
    found = quick.optimal_curve(preloads, 9, check=False, progress=False).optimum.preload
    low, high = preloads
    return found if np.isfinite(found) else float(np.sqrt(low * high))


# ---- one scene ----


def limited(work: Callable[[Say], None], seconds: int = LIMIT) -> Iterator[Any]:
    """Yield what the work says in a process of its own until it ends or the time is used up."""
    receiver, sender = multiprocessing.Pipe(duplex=False)
    process = multiprocessing.get_context("fork").Process(target=_run, args=(work, sender, seconds))
    process.start()
    sender.close()
    while True:
        try:
            yield receiver.recv()
        except EOFError:
            break
    process.join()


def _run(work: Callable[[Say], None], sender: Connection, seconds: int) -> None:
    resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds))
    try:
        work(sender.send)
    except (bd.BdamperError, ArithmeticError, np.linalg.LinAlgError) as error:
        sender.send({"failed": str(error)})


def estimate(study: bd.Study, peak: Peak, say: Say) -> None:
    """Say the stated error, its sources, and what is unknown."""
    found = study.estimate_errors(peak)
    sizes = {item.source: round(item.size, 4) for item in found.sources if item.known}
    say(
        {
            "stated": round(found.total, 4),
            "sources": sizes,
            "unknown": list(found.unknown),
            "undecided": found.undecided,
            "seconds": round(found.cost.seconds, 1),
        }
    )


def in_harmonics(study: bd.Study, peak: Peak, say: Say) -> None:
    """Say number of harmonics, amplitude (m) and frequency (Hz) until the harmonics agree.

    The structure is enriched step by step, and each peak starts the search of the next one.
    """
    dampers = study.problem.settings.by_body("damper_modes")
    elastic = max((study.model.bodies[name].n_elastic for name in dampers), default=0)
    richer_structures = [
        study.replace(contact_stiffness=WHOLE["contact_stiffness"]),
        study.replace(**WHOLE),
        study.replace(**WHOLE, damper_modes=elastic),
    ]
    before, tops, last = study.problem, Tops((peak,)), np.inf
    steps = [(structure.problem, 3) for structure in richer_structures]
    steps += [(steps[-1][0], harmonics) for harmonics in range(5, MOST_HARMONICS + 1, 2)]
    for step, (structure, harmonics) in enumerate(steps):
        richer = with_stand_ins(structure, harmonics)
        found = solve_other(before, richer, peak.parameter, tops, by_newton=True)
        if found.tops is None or found.tops.at_end:
            say({"failed": found.change.how or "highest at an end"})
            return
        tops, before = found.tops, richer
        if step < len(richer_structures) - 1:
            continue
        highest = tops.peaks[0]
        say([harmonics, highest.amplitude, highest.frequency])
        if abs(highest.amplitude / last - 1.0) < SETTLED:
            return
        last = highest.amplitude


def in_time(study: bd.Study, peak: Peak, say: Say) -> None:
    """Say mean and range (m) of the amplitude by time integration."""
    found = study.time_response(peak, seconds=IN_TIME_SECONDS, progress=False)
    say(
        {
            "um": 1e6 * found.mean,
            "low": 1e6 * found.lowest,
            "high": 1e6 * found.highest,
            "status": found.status_text,
            "settled": found.ok,
        }
    )


def peak_of(study: bd.Study, preload: float) -> dict[str, Any]:
    """Return the default answer at a preload."""
    start = time.process_time()
    peak = study.peak(preload, progress=False)
    return {
        "preload": preload,
        "um": 1e6 * peak.amplitude,
        "hz": peak.frequency,
        "status": peak.status_text,
        "seconds": round(time.process_time() - start, 2),
    }


def compared(study: bd.Study, known: dict[str, Any]) -> dict[str, Any]:
    """Return the stated error of a complete peak, unless it is known, and its references."""
    preload = known["preload"]
    peak = study.peak(preload, progress=False)
    stopped = {"failed": "stopped by the limit"}
    out: dict[str, Any] = {}
    out["estimate"] = known.get("estimate") or next(
        limited(partial(estimate, study, peak), ESTIMATE_LIMIT), stopped
    )
    out["time"] = next(limited(partial(in_time, study, peak)), stopped)
    # with all modes a sector has 1,000 unknowns and more
    out["rungs"] = []
    if not out["time"].get("settled"):
        out["rungs"] = list(limited(partial(in_harmonics, study, peak)))
    return out


def settled_rung(found: dict[str, Any]) -> float | None:
    """Return the amplitude (µm) on which the last two numbers of harmonics agree, or None."""
    amplitudes = [rung[1] for rung in found["rungs"] if isinstance(rung, list)]
    if len(amplitudes) < 2 or abs(amplitudes[-1] / amplitudes[-2] - 1.0) >= SETTLED:
        return None
    return 1e6 * float(amplitudes[-1])


def reference(found: dict[str, Any]) -> tuple[float, str] | None:
    """Return the reference (µm) of a scene with a peak, and how it was found, or None."""
    if "rungs" not in found:
        return None
    amplitude = settled_rung(found)
    if amplitude is not None:
        highest = [rung[0] for rung in found["rungs"] if isinstance(rung, list)][-1]
        return amplitude, f"{highest} harmonics"
    response = found.get("time", {})
    if response.get("settled"):
        return float(response["um"]), "in time"
    return None


# ---- results ----


def read(path: Path) -> Known:
    """Return the stored scenes."""
    lines = path.read_text().splitlines() if path.exists() else []
    return {key: value for line in lines for key, value in json.loads(line).items()}


def keep(known: Known, key: str, value: dict[str, Any], path: Path = RESULTS) -> None:
    """Store and print a scene."""
    known[key] = value
    with path.open("a") as file:
        file.write(json.dumps({key: value}) + "\n")
    print(key, value, flush=True)


def scenes(names: list[str]) -> list[tuple[str, float]]:
    """Return models and factors, one factor after the other."""
    listed = []
    for place in range(len(SHIPPED_FACTORS)):
        for name in names:
            factors = SHIPPED_FACTORS if name in SHIPPED else FACTORS
            if place < len(factors):
                listed.append((name, factors[place]))
    return listed


def compute(names: list[str], sectors: Path) -> None:
    """Compute the peaks that are not stored, then their stated errors and references."""
    known = read(RESULTS)
    for name, factor in scenes(names):
        if name not in known:
            study, preloads = study_of(name, sectors)
            keep(known, name, {"optimum": optimum(study, preloads)})
        if f"{name} {factor:g}" not in known:
            study, _ = study_of(name, sectors)
            try:
                found = peak_of(study, factor * known[name]["optimum"])
            except bd.BdamperError as error:
                found = {"status": f"not found: {error}", "um": np.nan, "seconds": np.nan}
            keep(known, f"{name} {factor:g}", found)
    for name, factor in scenes(names):
        found = known[f"{name} {factor:g}"]
        if found["status"] == COMPLETE and "rungs" not in found:
            study, _ = study_of(name, sectors)
            keep(known, f"{name} {factor:g}", found | compared(study, found))


def table(known: Known) -> str:
    """Return the table of all scenes in Markdown, and what they count."""
    lines = [
        "| model | factor | peak, µm | status | stated error | reference, µm | true error | seconds |",
        "|---|---|---|---|---|---|---|---|",
    ]
    complete, compared, within, near = 0, 0, 0, 0
    for key in sorted(key for key in known if " " in key):
        found = known[key]
        model, factor = key.split()
        is_complete = found["status"] == COMPLETE
        complete += is_complete
        stated = found.get("estimate", {}).get("stated", np.nan)
        against = reference(found)
        true, text = np.nan, "none"
        if against is not None:
            true = found["um"] / against[0] - 1.0
            text = f"{against[0]:.3g}, {against[1]}"
        if is_complete and against is not None:
            compared += 1
            within += abs(true) <= stated
            near += abs(true) <= LARGEST_ERROR
        cells = [
            model,
            factor,
            f"{found['um']:.3g}",
            found["status"].split(":")[0],
            f"{stated:.1%}",
        ]
        cells += [text, f"{true:+.1%}", f"{found['seconds']:.1f}"]
        row = f"| {' | '.join(cells)} |"
        lines.append(row.replace("+nan%", "not known").replace("nan%", "none").replace("%", " %"))
    lines += [
        "",
        f"{complete} of {len(lines) - 2} peaks are complete, and {compared} of these have a "
        f"reference: {within} are within the stated error, {near} within 10 %.",
    ]
    return "\n".join(lines)


# ---- time integration ----


def integrate(names: list[str], sectors: Path, seconds: float) -> None:
    """Store amplitudes in time, with a limit of the processor time (s) for each.

    Those that a smaller limit ended are computed again.
    """
    known = read(IN_TIME)
    for name in names:
        found = known.get(name, {"limit": 0.0, "settled": False})
        if not found["settled"] and found["limit"] < seconds:
            keep(known, name, amplitude_in_time(name, sectors, seconds), IN_TIME)


def amplitude_in_time(name: str, sectors: Path, seconds: float) -> dict[str, Any]:
    """Return the amplitude in time at the first complete peak of a sector, its energy and cost."""
    case, _, _ = sector(name, sectors)
    study, preloads = study_of(name, sectors)
    study = study.replace(contact_stiffness="residual_modes")
    out: dict[str, Any] = {"kind": case["kind"], "vectors": bd.ResidualModes().n_vectors}
    out |= {"limit": seconds, "settled": False, "motions": 0, "free": 1e-5 * case["H"]}
    try:
        of_optimum = optimum(study, preloads)
    except bd.BdamperError as error:
        no_peak = {"factor": np.nan, "balance": np.nan, "seconds": np.nan}
        return out | no_peak | {"status": f"no optimum: {error}"}
    for factor in TIME_FACTORS:
        peak = study.peak(factor * of_optimum, progress=False)
        out |= {"factor": factor, "N": peak.parameter, "balance": peak.amplitude}
        if peak.status == COMPLETE:
            break
    start = time.process_time()
    try:
        with collected_motions() as motions, bd.set_workers(1):
            found = study.time_response(peak, seconds=seconds, progress=False)
    except bd.BdamperError as error:
        out["status"] = f"not found: {error}"
    else:
        out |= {"mean": found.mean, "low": found.lowest, "high": found.highest}
        out |= {"status": found.status_text, "settled": found.ok, "periods": found.periods}
    out["seconds"] = round(time.process_time() - start, 1)
    return out | energy_and_amplitudes(motions)


@contextmanager
def collected_motions() -> Iterator[list[Transient]]:
    """Collect all motions that are integrated, with those that a limit of the time ends."""
    motions: list[Transient] = []
    advance = Transient.advance

    def collect_and_advance(transient: Transient, *given: Any, **options: Any) -> None:
        if not any(transient is known for known in motions):
            motions.append(transient)
        advance(transient, *given, **options)

    with mock.patch.object(Transient, "advance", collect_and_advance):
        yield motions


def energy_and_amplitudes(motions: list[Transient]) -> dict[str, Any]:
    """Return the largest error of the energy balance over the last periods of a motion, ten of them
    or a part of a sweep, and the range (m) of the last motion.
    """
    balanced = [
        motion
        for before, motion in pairwise([None, *motions])
        if begins_undisturbed(motion, before)
    ]
    if not balanced:
        return {}
    amplitudes = second_half(balanced[-1].amplitude)
    latest = [float(amplitudes.min()), float(amplitudes.max())]
    return {"energy": max(map(energy_error, balanced)), "motions": len(balanced), "latest": latest}


def begins_undisturbed(motion: Transient, before: Transient | None) -> bool:
    """Return whether the last periods of a motion do not follow a solution or a disturbance.

    The energy of their first periods goes to rest in the contacts, and is no error of the steps.
    The first part of a sweep begins with such periods.
    """
    is_part_of_sweep = is_part(motion) and before is not None and is_part(before)
    later_periods = len(motion.stored) > 2 and len(motion.harmonics) > CRITERIA.balanced
    return is_part_of_sweep or later_periods


def is_part(motion: Transient) -> bool:
    """Return whether a motion has the length of a part of a sweep."""
    return len(motion.harmonics) == CRITERIA.stride


def in_time_table(known: Known) -> str:
    """Return the table of amplitudes in time in Markdown, and what it counts."""
    lines = [
        "| sector | kind | times the optimum | free blade, µm | harmonic balance, µm "
        "| in time, µm | energy error | limit, s | seconds | status |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for name, found in sorted(known.items()):
        error = f"{100.0 * found['energy']:.2g} %" if found["motions"] else "no motion"
        cells = [name, found["kind"], f"{found['factor']:g}", f"{1e6 * found['free']:.4g}"]
        cells += [f"{1e6 * found['balance']:.4g}", amplitude_text(found), error]
        cells += [f"{found['limit']:g}", f"{found['seconds']:.0f}", found["status"].split(":")[0]]
        lines.append(f"| {' | '.join(cells)} |")
    settled = [name for name, found in known.items() if found["settled"]]
    of_motions = {name: found["energy"] for name, found in known.items() if found["motions"]}
    balanced = [name for name, error in of_motions.items() if error <= CRITERIA.energy]
    lines += [
        "",
        f"{len(settled)} of {len(known)} settle within their limit.  Of {len(of_motions)} with a "
        f"motion {len(balanced)} balance their energy to {CRITERIA.energy:.0%}.".replace("%", " %"),
    ]
    return "\n".join(lines)


def amplitude_text(found: dict[str, Any]) -> str:
    """Return the amplitude in time (µm) with its range, or the range when the time was spent."""
    if np.isfinite(found.get("low", np.nan)):
        low, mean, high = (1e6 * found[what] for what in ("low", "mean", "high"))
        return f"{mean:.4g} ({low:.4g} to {high:.4g})"
    if not found["motions"]:
        return "none"
    low, high = (1e6 * value for value in found["latest"])
    return f"last motion {low:.4g} to {high:.4g}"


# ---- optimal curves ----


def optima(names: list[str], sectors: Path) -> None:
    """Store default optimal curves of sectors, with references at the recommended preload."""
    known = read(OPTIMA)
    for name in names:
        if name not in known:
            keep(known, name, default_optimum(name, sectors), OPTIMA)


def default_optimum(name: str, sectors: Path) -> dict[str, Any]:
    """Return the answer of a default optimal curve, and references at its recommended preload."""
    study, preloads = study_of(name, sectors)
    study = study.replace(contact_stiffness="residual_modes")
    start = time.process_time()
    curve = study.optimal_curve(preloads, OPTIMUM_PRELOADS, progress=False)
    seconds = time.process_time() - start
    preload = curve.recommended_preload
    out: dict[str, Any] = {
        "optimum": curve.optimum.preload,
        "preload": preload,
        "design": 1e6 * curve.design_amplitude,
        "status": curve.status_text,
        "failures": list(curve.failures),
        "printed": str(curve),
        "seconds": round(seconds, 1),
    }
    response = curve.recommended_response
    if response is not None:
        amplitudes = (response.lowest, response.mean, response.highest)
        out["in_time"] = [1e6 * amplitude for amplitude in amplitudes]
        out["in_time_ok"] = response.ok
    peak = study.peak(preload, progress=False)
    out |= {"um": 1e6 * peak.amplitude, "peak": peak.status_text}
    out["rungs"] = list(limited(partial(in_harmonics, study, peak)))
    return out


def optima_table(known: Known) -> str:
    """Return the table of default optimal curves in Markdown."""
    lines = [
        "| sector | recommended preload, N | harmonic balance, µm | in time, µm "
        "| amplitude for the stress, µm | all modes and more harmonics, µm | seconds | outcome |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for name, found in sorted(known.items()):
        in_time = "none"
        if "in_time" in found:
            low, mean, high = found["in_time"]
            in_time = f"{mean:.4g} ({low:.4g} to {high:.4g})"
        against = settled_rung(found)
        design = found["design"]
        cells = [name, f"{found['preload']:.4g}", f"{found['um']:.4g}", in_time]
        cells += ["none" if np.isnan(design) else f"{design:.4g}"]
        cells += ["none" if against is None else f"{against:.4g}", f"{found['seconds']:.0f}"]
        cells += ["not for design" if found["failures"] else "complete"]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


# ---- linear test ----


def bonded(names: list[str], sectors: Path) -> None:
    """Store the errors of the shift of mode 1 by bonded parts of the faces."""
    known = read(BONDED)
    for name in names:
        if name not in known:
            keep(known, name, bonded_parts_of(name, sectors), BONDED)


def bonded_parts_of(name: str, sectors: Path) -> dict[str, Any]:
    """Return the shift by whole faces and the errors with default and with adapted vectors."""
    case, model, diameter = sector(name, sectors)
    coupling = coupling_of_default(model, diameter)
    assert coupling is not None
    found = partial_contact(coupling, VECTORS)
    adapted = {}
    for part, rows in bonded_parts(coupling).items():
        own_part = mock.Mock(return_value={part: rows})
        with mock.patch.object(residual_flexibility, "parts_of_faces", own_part):
            errors = partial_contact(coupling, VECTORS).errors
        if part in errors:
            adapted[part] = errors[part]
    default = dict(found.errors)
    return {"kind": case["kind"], "shift": found.shift, "default": default, "adapted": adapted}


def bonded_table(known: Known) -> str:
    """Return the largest errors of the sectors whose bonded faces shift mode 1, in Markdown."""
    lines = [
        "| sector | kind | shift of mode 1 | all parts: whole | largest part | adapted: largest |",
        "|---|---|---|---|---|---|",
    ]
    for name, found in known.items():
        if found["shift"] < SMALL_SHIFT:
            continue
        whole, *parts = found["default"].values()
        largest = max(map(abs, parts))
        adapted = max(map(abs, found["adapted"].values()))
        shift = f"{100.0 * found['shift']:.1f} %"
        errors = [f"{100.0 * value:.2f} %" for value in (abs(whole), largest, adapted)]
        lines.append(f"| {' | '.join([name, found['kind'], shift, *errors])} |")
    small = [name for name, found in known.items() if found["shift"] < SMALL_SHIFT]
    lines += ["", f"Shift below {100.0 * SMALL_SHIFT:g} %: {', '.join(small)}."]
    return "\n".join(lines)


def main() -> None:
    """Compute or show."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.sector_scenes", description=__doc__)
    parser.add_argument(
        "what",
        choices=("peaks", "bonded", "in_time", "optima", "show"),
        nargs="?",
        default="show",
    )
    parser.add_argument("names", nargs="*", help="models; all by default")
    parser.add_argument("--sectors", type=Path, default=Path("sectors"))
    parser.add_argument("--seconds", type=float, default=150.0, help="limit of in_time")
    given = parser.parse_args()
    warnings.simplefilter("ignore", BdamperWarning)
    if given.what == "peaks":
        compute(given.names or [*SHIPPED, *SEEDS], given.sectors)
    elif given.what == "bonded":
        bonded(given.names or [*STUBBY, *SLENDER], given.sectors)
    elif given.what == "in_time":
        integrate(given.names or [*SEEDS], given.sectors, given.seconds)
    elif given.what == "optima":
        optima(given.names or [*WITH_OPTIMA], given.sectors)
    else:
        print(table(read(RESULTS)))
        print(optima_table(read(OPTIMA)))
        print(bonded_table(read(BONDED)))
        print(in_time_table(read(IN_TIME)))


if __name__ == "__main__":
    main()
