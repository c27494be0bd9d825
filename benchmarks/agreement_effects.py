"""Adaptive against everything on, over many models, modes, engine orders and preloads.

    python -m benchmarks.agreement_effects [--cases 300] [--first 0] [--out agreement_effects.jsonl] [--again]

For each case (:mod:`tests.effect_cases`): the highest peak of the tracking curve with everything on, and the adaptive one
at a tolerance of 1 %; then advice on a random choice of effects that are off, against what each of them changes when it is
switched on.  Where responses coexist one curve may miss the highest.  So the peak that counts is the highest of three: of
the curve followed from below, of that followed from above, and of the one that the adaptive peak leads to under the
equations with everything on; which it was is noted.  The time that counts is that of the one curve from below.

Numbers are drawn until there are so many cases with a static state, a complete curve with everything on and a maximum
inside the interval; what is passed over is counted.  Times are processor time of this process.  A run can be interrupted
and resumed; results go to the file one line a case.  The numbers from 0 and from 100,000 to 600,000 were used while the
method was made, as were those from 700,000 to 1,200,000 since; those from 1,300,000 were run once it was fixed; those from
:data:`HELD_OUT` (``--first``) were not run yet.
"""

from __future__ import annotations

import argparse
import json
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

import bdamper as bd
from bdamper.balance.system import OK
from bdamper.effects.adaptive import RESPONSES, AdaptivePeak
from bdamper.effects.advice import advise
from bdamper.effects.indicator import embed, highest_peaks
from bdamper.effects.rivals import amplitude_of
from bdamper.peaks.carryover import LOOSE, carried_over
from bdamper.peaks.newton import coarse_options, peak_scale
from tests.effect_cases import Case, draw, everything_on, found, scene, study_of

TOLERANCE = 0.01
HELD_OUT = 1_400_000
OPTIONS = bd.ContinuationOptions(max_points=1500)


def sparse(case: Case) -> bd.Effects:
    """A random choice of effects that are off."""
    full, rng = everything_on(case), np.random.default_rng([7, case.number])
    chosen = replace(full, harmonics=1)
    if rng.random() < 0.4:
        chosen = replace(chosen, bias=False)
    contact = rng.random()
    if contact < 0.25:
        chosen = replace(chosen, separation=False)
    elif contact < 0.4:
        chosen = replace(chosen, variable_normal_load=False)
    chosen = replace(chosen, rotation=tuple(a for a in "XYZ" if rng.random() >= 0.25))
    chosen = replace(chosen, translation=tuple(a for a in "XYZ" if a == "Y" or rng.random() >= 0.1))
    if rng.random() < 0.4:
        chosen = replace(chosen, damper_modes=0)
    if rng.random() < 0.4:
        chosen = replace(chosen, constraints=False)
    if rng.random() < 0.4:
        chosen = replace(chosen, harmonic_nodal_diameters=False)
    if rng.random() < 0.4:
        chosen = replace(chosen, blade_modes=full.blade_modes // 2)
    if rng.random() < 0.4:
        chosen = replace(chosen, contact_points=max(2, case.points // 2))
    return chosen


def timed(work: Callable[[], Any]) -> tuple[Any, float]:
    begin = time.process_time()
    out = work()
    return out, time.process_time() - begin


def searched(study: bd.Study, preload: float, interval: tuple[float, float]) -> tuple[Any, str, bd.Curve]:
    """Highest peak of a coarse curve with refined maxima, and the curve."""
    curve = study.track(preload, interval, options=coarse_options())
    peaks = highest_peaks(study.system(preload), curve) if len(curve) else []
    return (peaks[0] if peaks else None), curve.status, curve


def run(case: Case) -> dict[str, Any]:
    """All that is measured on one case."""
    out: dict[str, Any] = {"number": case.number, "case": str(case)}
    study = replace(study_of(case))
    place = scene(study, case)
    if place is None:
        return {**out, "note": "no static state or no stuck resonance"}
    preload, interval = place
    out |= {"preload": preload, "interval": interval}
    curve, seconds = timed(lambda: study.track(preload, interval, options=OPTIONS))
    out |= {"status": curve.status, "reason": curve.reason, "seconds_full": seconds, "points": len(curve)}
    if not curve.complete:
        return {**out, "note": f"curve with everything on: {curve.status}"}
    top = curve.peak
    if curve.point_kind[top.index] != "maximum":
        return {**out, "note": "no maximum inside the interval"}
    out |= {"from_below": [top.amplitude, top.frequency], "folds": len(curve.folds)}
    out["shares"] = [float(x) for x in curve.shares[top.index]]
    out["from_above"] = out["from_below"]
    if curve.shares[:, 0].min() < 1.0:  # a contact that sticks throughout has one response
        above = study.track(preload, interval, from_high=True, options=OPTIONS)
        peaks = highest_peaks(study.system(preload), above, share=0.9, options=LOOSE) if len(above) else []
        out["from_above"] = [peaks[0].amplitude, peaks[0].frequency] if peaks else None
    adapt(out, study)
    out["advice"] = advice(case, preload, (0.9 * interval[0], 1.15 * interval[1]))
    return out


def adapt(row: dict[str, Any], study: bd.Study) -> None:
    """Adds the adaptive peak to a result, and the peak with everything on that counts."""
    preload, interval = row["preload"], tuple(row["interval"])
    study = replace(study)  # what the curves have computed does not serve
    scene(study, draw(row["number"]))
    auto, row["seconds_auto"] = timed(lambda: study.adaptive_peak(preload, interval, tolerance=TOLERANCE))
    row["auto"] = [auto.amplitude, auto.frequency] if auto.converged else None
    row |= {"effects": [list(auto.effects.harmonic_numbers), auto.effects.damper_modes], "error_bound": auto.error_bound}
    row |= {"responses": auto.responses, "coexisting": sorted({part.kind for part in auto.coexisting})}
    row["log"] = list(auto.log)
    row["followed"] = polished(study, auto, interval)
    ways = {name: row[name] for name in ("from_below", "from_above", "followed") if row[name]}
    best = max(ways, key=lambda name: ways[name][0] * (1.0 + 1e-3 * (name == "from_below")))
    row["best"] = best
    row["amplitude"], row["frequency"] = ways[best]


def polished(study: bd.Study, auto: AdaptivePeak, interval: tuple[float, float]) -> list[float] | None:
    """The peak with everything on that the adaptive one leads to, if there is one inside the interval.

    Where the search for it ends elsewhere (at a corner it may), the adaptive solution counts if the equations with
    everything on have one at its frequency that is as high.
    """
    if not auto.converged:
        return None
    y = embed(study.with_effects(auto.effects), study, auto.preload, auto.y)
    system = study.system(auto.preload)
    peak = carried_over(system, [y], y, 0.01 * y[-1])
    if peak is not None and interval[0] < peak.frequency < interval[1] and near(peak.amplitude, auto.amplitude):
        return [peak.amplitude, peak.frequency]
    c = system.correct_at(y[:-1], y[-1], peak_scale(system, y, y[-1]), 1e-9, 40, True)
    height = amplitude_of(system, c.y)
    return [height, auto.frequency] if c.status == OK and near(height, auto.amplitude) else None


def near(a: float, b: float) -> bool:
    return abs(a / b - 1.0) <= TOLERANCE


def advice(case: Case, preload: float, interval: tuple[float, float]) -> list[list[Any]]:
    """Estimates and true changes for effects that are off."""
    effects, full = sparse(case), everything_on(case)
    study = study_of(case, effects)
    peak, _, curve = searched(study, preload, interval)
    if peak is None:
        return []
    given = advise(study, preload, interval, against=full, tolerance=TOLERANCE, curve=curve)
    rows = []
    for name, one in effects.missing(full).items():
        true, status, _ = searched(study.with_effects(one), preload, interval)
        change = [true.amplitude / peak.amplitude - 1.0, true.frequency / peak.frequency - 1.0] if true else None
        item = given[name]
        rows.append(
            [name, item.amplitude_change, item.frequency_change, item.defect, item.reliability, change, status, item.reason]
        )
    return rows


def disagrees(row: dict[str, Any]) -> bool:
    if row["auto"] is None:
        return True
    return not all(near(a, row[key]) for a, key in zip(row["auto"], ("amplitude", "frequency")))


def above_the_curves(row: dict[str, Any]) -> bool:
    """Whether the peak that counts is the adaptive one, higher than both curves with everything on."""
    curves = [row[way][0] for way in ("from_below", "from_above") if row[way]]
    return row["best"] == "followed" and row["amplitude"] > (1.0 + TOLERANCE) * max(curves)


def summary(rows: list[dict[str, Any]]) -> str:
    """What the issue of agreement comes to."""
    good = [r for r in rows if "note" not in r]
    wrong = [r for r in good if disagrees(r)]
    lines = [
        f"cases: {len(good)}; passed over: {dict(Counter(r['note'] for r in rows if 'note' in r))}",
        f"adaptive within {100 * TOLERANCE:g} % of everything on: {len(good) - len(wrong)} of {len(good)} "
        f"({100 * (1 - len(wrong) / max(len(good), 1)):.2f} %)",
        f"  of these {sum(above_the_curves(r) and not disagrees(r) for r in good)} above the curves from below and from "
        "above, which miss it: they solve the equations with everything on",
    ]
    for name, some in (
        ("all", good),
        ("reference model", [r for r in good if "reference" in r["case"]]),
        ("random models", [r for r in good if "reference" not in r["case"]]),
    ):
        full, auto = (sum(r[key] for r in some) for key in ("seconds_full", "seconds_auto"))
        lines.append(
            f"  {name}: {len(some)} cases, {sum(disagrees(r) for r in some)} exceptions; processor time of tracking curves "
            f"{full:.1f} s, adaptive {auto:.1f} s: {auto / max(full, 1e-9):.3f}"
        )
    for kind in RESPONSES:
        some = [r for r in good if r["responses"] == kind]
        lines.append(f"  responses {kind!r}: {len(some)} cases, {sum(disagrees(r) for r in some)} exceptions")
    for r in good:
        if r["amplitude"] > (1.0 + TOLERANCE) * r["from_below"][0]:
            lines.append(
                f"  {r['case']}: the curve from below misses {r['amplitude']:.5g} m at {r['frequency']:.6g} Hz "
                f"({r['best'].replace('_', ' ')}), its own peak is {r['from_below'][0]:.5g} m"
            )
    for r in wrong:
        mine = "none" if r["auto"] is None else f"{r['auto'][0]:.5g} m at {r['auto'][1]:.6g} Hz"
        lines.append(
            f"  {r['case']}: everything on {r['amplitude']:.5g} m at {r['frequency']:.6g} Hz "
            f"({r['best'].replace('_', ' ')}, {r['points']} points, {r['folds']} folds), adaptive {mine}"
        )
        lines += [f"      {line}" for line in r["log"]]
    table: Counter[tuple[str, str]] = Counter()
    missed = []
    unknown = 0
    for r in good:
        for row in r["advice"]:
            if row[5] is None:
                unknown += 1
                continue
            change = max(abs(c) for c in row[5])
            table[row[4], "below 1 %" if change < 0.01 else "1 to 5 %" if change <= 0.05 else "above 5 %"] += 1
            if row[4] == "small" and change > 0.05:
                missed.append((r, row))
    lines.append(f"advice: {sum(table.values())} effects, {len(missed)} called small that change the peak by more than 5 %")
    for kind in ("small", "significant", "must be on"):
        lines.append(f"  {kind}: " + ", ".join(f"{k} {table[kind, k]}" for k in ("below 1 %", "1 to 5 %", "above 5 %")))
    lines.append(f"  without a peak to compare with: {unknown}")
    for r, row in missed:
        lines.append(f"  missed: {r['case']}: {row}")
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=int, default=300)
    parser.add_argument("--out", default="agreement_effects.jsonl")
    parser.add_argument("--first", type=int, default=0, help="number of the first case")
    parser.add_argument("--again", action="store_true", help="adaptive peaks of the results on file anew")
    given = parser.parse_args()
    rows = found(given.out)
    if given.again:
        for row in rows:
            if "note" not in row:
                adapt(row, study_of(draw(row["number"])))
        with open(given.out, "w") as file:
            file.writelines(json.dumps(row) + "\n" for row in rows)
    done = {r["number"] for r in rows}
    number = given.first
    while sum("note" not in r for r in rows) < given.cases:
        if number not in done:
            row = run(draw(number))
            rows.append(row)
            with open(given.out, "a") as file:
                file.write(json.dumps(row) + "\n")
        number += 1
    print(summary(sorted(rows, key=lambda r: r["number"])))


if __name__ == "__main__":
    main()
