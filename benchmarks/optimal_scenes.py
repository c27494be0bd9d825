"""How far optimal curves agree with tracking curves, on random studies of the shipped bladed disk.

``python -m benchmarks.optimal_scenes results.jsonl [first last]`` computes the studies of these numbers (0 to 59 by
default), as many at once as ``--workers`` says, appends a line for each to the file, and prints a summary of all that the
file holds; studies that it holds already are not computed again.

A study has 9 or 24 contact points a face, unit tractions or residual modes, 1, 3 or 5 harmonics, one of the modes 1 to 4,
an excitation of 1 N along the circumference or the axis, and a friction coefficient of 0.2 to 0.6; its number is the seed.
Its optimal curve has 30 preloads from 30 N to 25 kN.  At 20 of these, drawn before any is computed, whole tracking curves
are followed over the same interval of frequency; where one is incomplete another preload is drawn.

* A value *agrees* if it differs from the highest maximum of the tracking curve by no more than 1 %, or lies above it and
  satisfies the equations on its own (then it lies on a branch that the curve has missed, which is counted apart).
* An optimum is *contradicted* by a tracking curve at another preload whose highest maximum is lower by more than 1 %.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

import bdamper as bd
from bdamper.continuation.curve import Curve
from bdamper.continuation.track import track
from bdamper.peaks.newton import find_peak
from bdamper.peaks.optimal import optimal_curve

STUDIES = 60
PRELOADS = np.geomspace(30.0, 25e3, 30)
CURVES = 20
TOLERANCE = 0.01


@lru_cache
def _model(points: int) -> bd.Model:
    return bd.reference_model("bladed_disk", points)


def draw(number: int) -> tuple[bd.Study, int, str]:
    """The study of a number, its mode, and both in words."""
    rng = np.random.default_rng([22, number])
    points, harmonics = int(rng.choice([9, 24])), int(rng.choice([1, 3, 5]))
    method, mode = str(rng.choice(["unit_traction", "residual_modes"])), int(rng.integers(1, 5))
    direction, friction = str(rng.choice(["tangential", "axial"])), float(rng.uniform(0.2, 0.6))
    study = bd.Study(
        _model(points), bd.Excitation("tip", direction), 5, friction_coefficient=friction, harmonics=harmonics,
        contact_stiffness=method, blade_modes=5 if method == "residual_modes" else 10,
    )  # fmt: skip
    return study, mode, f"{points} points, {method}, H = {harmonics}, mode {mode}, {direction}, mu {friction:.2f}"


def highest_maximum(curve: Curve) -> tuple[float, float] | None:
    """Amplitude (m) and frequency (Hz) of the highest maximum, the ends of the interval left out; None without one."""
    inner = [i for i, kind in enumerate(curve.point_kind) if kind in ("maximum", "drift")]
    best = max(inner, key=curve.amplitude.item, default=None)
    return None if best is None else (float(curve.amplitude[best]), float(curve.frequency[best]))


def run(number: int) -> dict[str, Any]:
    """The optimal curve of one study beside its tracking curves."""
    study, mode, text = draw(number)
    begin = time.process_time()
    out: dict[str, Any] = {"number": number, "text": text, "pairs": [], "incomplete": []}
    found = optimal_curve(study, PRELOADS, mode=mode)
    best = found.optimum
    out |= {"seconds": time.process_time() - begin, "preload": best.preload, "amplitude": best.amplitude,
            "kind": best.kind, "status": best.status, "values": list(found.status)}  # fmt: skip
    for k in np.random.default_rng([23, number]).permutation(len(PRELOADS)):
        if len(out["pairs"]) == CURVES:
            break
        begin = time.process_time()
        curve = track(study, PRELOADS[k], found.settings["frequency"])
        seconds = time.process_time() - begin
        if not curve.complete:
            out["incomplete"].append({"preload": PRELOADS[k], "why": f"{curve.status}: {curve.reason}", "seconds": seconds})
            continue
        value, top = found.amplitude[k], highest_maximum(curve)
        if top is None:
            continue
        alone = False
        if value > (1.0 + TOLERANCE) * top[0]:
            start = np.append(found.unknowns[k], 2.0 * np.pi * found.frequency[k])
            peak = find_peak(study.system(PRELOADS[k]), start)
            alone = bool(peak.converged and abs(peak.amplitude / value - 1.0) < 1e-6)
        out["pairs"].append({"preload": PRELOADS[k], "value": float(value), "status": found.status[k], "curve": top[0],
                             "at": top[1], "alone": alone, "seconds": seconds})  # fmt: skip
    return out


def _name(study: dict[str, Any]) -> str:
    return f"study {study['number']} ({study['text']})"


def summary(studies: Sequence[dict[str, Any]]) -> str:
    """What all studies together say, and every disagreement in a line of its own."""
    lines, verified, contradicted = [], 0, 0
    pairs = [(s, p) for s in studies for p in s["pairs"]]
    ordinary = [(s, p) for s, p in pairs if p["preload"] >= 60.0]
    carried = [(s, p) for s, p in ordinary if np.isfinite(p["value"])]
    wrong = [(s, p) for s, p in pairs if np.isfinite(p["value"]) and not p["alone"]
             and abs(p["value"] / p["curve"] - 1.0) > TOLERANCE]  # fmt: skip
    for s, p in pairs:
        if p["alone"]:
            lines.append(f"{_name(s)} at {p['preload']:.4g} N: {p['value']:.5g} m above the curve's {p['curve']:.5g} m, "
                         "and satisfies the equations")  # fmt: skip
    for s, p in wrong:
        lines.append(f"{_name(s)} at {p['preload']:.4g} N: {p['value']:.5g} m ({p['status']}) against {p['curve']:.5g} m "
                     f"at {p['at']:.5g} Hz")  # fmt: skip
    for s in studies:
        if s["status"] != "complete":
            lines.append(f"{_name(s)}: optimum {s['kind']}, {s['status']}")
            continue
        verified += 1
        lower = [p for p in s["pairs"] if p["curve"] < (1.0 - TOLERANCE) * s["amplitude"]]
        contradicted += bool(lower)
        if lower:
            p = min(lower, key=lambda p: p["curve"])
            lines.append(f"{_name(s)}: optimum {s['amplitude']:.5g} m at {s['preload']:.4g} N, but "
                         f"{p['curve']:.5g} m at {p['preload']:.4g} N")  # fmt: skip
    n_wrong = sum(p["preload"] >= 60.0 for _, p in wrong)
    claimed = sum(p["status"] == "complete" for _, p in wrong)
    missing = sum(len(s["incomplete"]) for s in studies)
    seconds = [s["seconds"] for s in studies]
    return "\n".join([
        *lines,
        f"{len(ordinary)} pairs from 60 N on: {len(carried)} carry a value, {len(carried) - n_wrong} of these agree within "
        f"{100 * TOLERANCE:g} %; {len(pairs) - len(ordinary)} pairs below",
        f"{claimed} disagreements claim to be complete; {missing} tracking curves were incomplete, drawn again",
        f"{verified} of {len(studies)} optima are verified, {contradicted} of these are contradicted",
        f"processor time of an optimal curve: median {np.median(seconds):.1f} s, largest {max(seconds):.1f} s",
    ])  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("results", type=Path)
    parser.add_argument("numbers", nargs="*", type=int, default=[0, STUDIES - 1], help="first and last study")
    parser.add_argument("--workers", type=int, default=2)
    given = parser.parse_args()
    done = [json.loads(line) for line in given.results.read_text().splitlines()] if given.results.exists() else []
    known = {s["number"] for s in done}
    todo = [n for n in range(given.numbers[0], given.numbers[1] + 1) if n not in known]
    with ProcessPoolExecutor(given.workers) as pool, given.results.open("a") as file:
        for future in as_completed([pool.submit(run, n) for n in todo]):
            done.append(future.result())
            file.write(json.dumps(done[-1]) + "\n")
            file.flush()
            print(f"{_name(done[-1])}: {done[-1]['status']}, {done[-1]['seconds']:.1f} s", flush=True)
    print(summary(sorted(done, key=lambda s: s["number"])))


if __name__ == "__main__":
    main()
