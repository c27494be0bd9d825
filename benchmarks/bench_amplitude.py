"""Amplitudes in time that a study states, their error beside the whole structure, and what accuracy costs in time.

``python -m benchmarks.bench_amplitude references`` computes the references that ``results/amplitude.jsonl`` does not have,
``... answers`` the default answers, ``... restarts`` the same with other disturbances of the motions, and ``... curves``
peaks of response curves.  ``... show`` compares them, and draws ``docs/images/cost.png``.  Numbers of scenes may follow.

Each scene is drawn from its number before anything is computed: the turbine blade (even numbers) or the difficult disk (odd
ones), engine order 5 or 10, a friction coefficient of 0.2 to 0.6, and 0.8 to 4 times the preload of the least peak of the
harmonic balance.  The reference has all modes of blade and damper and 24 residual patterns.  Its motion starts

* on either flank of the resonance, from where the frequency changes slowly towards the tip and beyond until it falls,
* and at the tip, with the solution of the harmonic balance.

Each start ends in motions at fixed frequencies, from the highest place of the sweep backward, with waves of every nodal
diameter added.  The first of them that keeps its amplitude over 160 periods counts; of a motion that beats the error bar
covers all means of 40 periods.  The highest of all starts is the
reference, and its error bar covers the single means of 40 periods and the motion with 512 time steps in a period.
"""

from __future__ import annotations

import json
import sys
import time
import warnings
from pathlib import Path
from typing import Any
from unittest.mock import patch

import matplotlib.pyplot as plt
import numpy as np

import bdamper as bd
from bdamper.contact.residual_flexibility import RESIDUAL
from bdamper.plot import save_figure
from bdamper.plot.axes import STYLE
from bdamper.time_domain.integration import AllSectors, IntegrationFailed, Motion, all_sectors
from bdamper.time_domain.transient import Transient
from bdamper.util.errors import BdamperError, BdamperWarning

RESULTS = Path(__file__).parent / "results" / "amplitude.jsonl"
SEED, SCENES = 20261125, 48
BANDS = {"turbine_blade": (600.0, 720.0), "bladed_disk": (285.0, 380.0)}
WHOLE: dict[str, dict[str, Any]] = {
    "turbine_blade": {
        "blade_modes": 20,
        "damper_modes": 4,
        "contact_stiffness": bd.ResidualModes(24, partial_contact=False),
    },
    "bladed_disk": {
        "blade_modes": 40,
        "damper_modes": 10,
        "contact_stiffness": bd.ResidualModes(24, partial_contact=False),
    },
}
PACE = 60.0  # periods in which a sweep covers the half width of the resonance
WINDOW, HOLD, AWAY = 40, 160, 0.05
SETTLED = 0.1  # relative width of the error bar of a settled reference
CURVES: dict[str, dict[str, Any]] = {
    "1 harmonic, unit tractions": {"harmonics": 1, "contact_stiffness": "unit_traction"}, "default curve": {},
}  # fmt: skip
IN_TIME = "default, in time", "all modes, in time"
IMAGE = Path(__file__).parents[1] / "docs" / "images" / "cost.png"
Known = dict[str, dict[str, Any]]


def random(number: int) -> tuple[str, int, float, float]:
    """Model, engine order, friction coefficient and preload over that of the least peak."""
    rng = np.random.default_rng([SEED, number])
    order, friction = int(rng.choice([5, 10])), round(float(rng.uniform(0.2, 0.6)), 2)
    return (
        ("bladed_disk" if number % 2 else "turbine_blade"),
        order,
        friction,
        float(0.8 * 5.0 ** rng.uniform()),
    )


def study(name: str, order: int, friction: float, **settings: Any) -> bd.Study:
    excitation = bd.Excitation("tip", "tangential", 1.0)
    return bd.Study(
        bd.reference_model(name, 9), excitation, order, friction_coefficient=friction, **settings
    )


def flanks(curve: bd.ResponseCurve) -> tuple[float, list[float]]:
    """Half width of the resonance (Hz), and a frequency on each side at half of the peak or beyond (Hz)."""
    tip, height = curve.peak.frequency, curve.peak.amplitude
    out = []
    for side in (1.0, -1.0):
        beyond = (curve.frequency - tip) * side > 0.0
        low = beyond & (curve.amplitude <= 0.6 * height)
        nearest = np.abs(curve.frequency[low] - tip).min() if low.any() else np.inf
        out.append(float(min(nearest, np.abs(curve.frequency[beyond] - tip).max())))
    return min(out), [tip + out[0], tip - out[1]]


def mean(transient: Transient, periods: int) -> float:
    return float(transient.amplitude[-periods:].mean())


def hold(
    ring: AllSectors, frequency: float, motion: Motion
) -> tuple[float, float, float, Motion, bool]:
    """Mean, lowest and highest mean of a window, final motion, and whether the motion keeps its amplitude."""
    transient = Transient(ring, 2.0 * np.pi * frequency, ring.seeded(motion, 0.01, 0))
    before = np.inf
    for _ in range(4):
        transient.run(len(transient.harmonics) + HOLD)
        windows = (
            np.abs(transient.blades[-HOLD:]).reshape(-1, WINDOW, transient.sectors.n).mean(axis=1)
        )
        best = windows[:, windows[-1].argmax()]
        if np.ptp(best) <= AWAY * best[-1] or best[-1] < 0.7 * before:
            break
        before = best[0]
    steady = bool(np.ptp(best) <= AWAY * best[-1])
    if not steady and len(transient.harmonics) >= 4 * HOLD:  # a motion that beats
        windows = (
            np.abs(transient.blades[-2 * HOLD :])
            .reshape(-1, WINDOW, transient.sectors.n)
            .mean(axis=1)
        )
        best = windows[:, windows.mean(axis=0).argmax()]
    return float(best.mean()), float(best.min()), float(best.max()), transient.motion, steady


def swept(
    ring: AllSectors, begin: float, end: float, pace: float, motion: Motion
) -> tuple[list[tuple[float, float, Motion]], int]:
    """Frequency, mean amplitude and motion every 8 periods of a slow sweep until the motion falls, and its periods."""
    transient = Transient(ring, 2.0 * np.pi * begin, ring.seeded(motion, 0.01, 0))
    transient.run(60)
    places, periods, frequency = [(begin, mean(transient, 8), transient.motion)], 60, begin
    step = np.sign(end - begin) * 8.0 * pace
    while (end - frequency) * step > 0.0:
        moving = Transient(ring, 2.0 * np.pi * frequency, transient.motion)
        moving.advance(8, (2.0 * np.pi * frequency, 2.0 * np.pi * (frequency + step)))
        transient, frequency, periods = moving, frequency + step, periods + 8
        places.append((frequency, float(np.abs(moving.blades).mean(axis=0).max()), moving.motion))
        if places[-1][1] < 0.5 * max(p[1] for p in places):
            break
    return places, periods


def settled(ring: AllSectors, places: list[tuple[float, float, Motion]]) -> dict[str, Any]:
    """Highest steady motion at places of a sweep."""
    k, found, fell = int(np.argmax([p[1] for p in places])), None, []
    stays, falls, back = -1, k + 1, 1
    while 0 <= k < falls and k > stays:  # backward in growing steps, then by bisection
        frequency, expected, motion = places[k]
        at, low, high, final, steady = hold(ring, frequency, motion)
        if at >= 0.8 * expected:  # a motion that beats has a wide error bar
            stays = k
            if found is None or 1e6 * at > found["um"]:
                found = {
                    "um": 1e6 * at,
                    "lowest": 1e6 * low,
                    "highest": 1e6 * high,
                    "hz": float(frequency),
                    "motion": final,
                }
        else:
            falls = k
            fell.append((round(float(frequency), 3), round(1e6 * at, 2), steady))
        k, back = (k - back, 2 * back) if stays < 0 else ((stays + falls) // 2, back)
    return {**(found or {"um": np.nan, "hz": np.nan}), "fell": fell}


def reference(number: int, preload: float) -> dict[str, Any]:
    name, order, friction, _ = random(number)
    begin = time.process_time()
    base, whole = study(name, order, friction), study(name, order, friction, **WHOLE[name])
    curve = base.frequency_response(preload, BANDS[name])
    if curve.peak_at_end:
        return {
            "preload": preload,
            "no peak": f"highest at {curve.peak.frequency:.6g} Hz, the end of the band",
        }
    width, sides = flanks(curve)
    ring, small = all_sectors(whole.problem, preload), all_sectors(base.problem, preload)
    tip = curve.peak.frequency
    starts: dict[str, dict[str, Any]] = {}
    sweeps: list[list[tuple[float, float, Motion]]] = []

    def balance(frequency: float) -> Motion:
        near = np.abs(curve.frequency - frequency) <= 0.02 * width
        k = (
            np.flatnonzero(near)[curve.amplitude[near].argmax()]
            if near.any()
            else np.abs(curve.frequency - frequency).argmin()
        )
        at = small.start(curve.unknowns[k], 2.0 * np.pi * frequency, 256)
        return carried(small, at, ring)

    for where, first in (("down", sides[0]), ("up", sides[1]), ("tip", tip)):
        try:
            if where == "tip":
                transient = Transient(ring, 2.0 * np.pi * tip, ring.seeded(balance(tip), 0.01, 0))
                transient.run(60)
                places = [(tip, mean(transient, 20), transient.motion)]
                others = [p for way in sweeps for p in way]
                nearest = min(others, key=lambda p: abs(p[0] - tip))[1] if others else 0.0
                if places[0][1] > 1.05 * nearest:  # another branch than those from the flanks
                    for end in (tip - 1.5 * width, tip + 1.5 * width):
                        more, _ = swept(ring, tip, end, width / PACE, transient.motion)
                        if max(p[1] for p in more) > 1.02 * max(p[1] for p in places):
                            places = more
            else:
                last = tip + (tip - first)
                last = (
                    float(np.clip(last, *BANDS[name]))
                    if abs(tip - first) > 2.0 * width
                    else 2.0 * tip - first
                )
                places, _ = swept(ring, first, last, width / PACE, balance(first))
                sweeps.append(places)
            found = settled(ring, places)
            found["last"] = float(places[-1][0])
        except (IntegrationFailed, BdamperError) as error:
            found = {"um": np.nan, "failed": str(error)}
        starts[where] = found
    good = {w: s for w, s in starts.items() if np.isfinite(s["um"])}
    out: dict[str, Any] = {
        "preload": preload,
        "tip": tip,
        "balance": 1e6 * curve.peak.amplitude,
        "width": width,
    }
    if good:
        where = max(good, key=lambda w: good[w]["um"])
        best = good[where]
        fine = Transient(ring, 2.0 * np.pi * best["hz"], best["motion"]._replace(a=None), 512)
        fine.run(80)
        with_512 = 1e6 * mean(fine, WINDOW)
        out |= {"um": best["um"], "hz": best["hz"], "from": where, "fine": with_512,
                "low": min(best["lowest"], with_512), "high": max(best["highest"], with_512)}  # fmt: skip
    for s in starts.values():
        s.pop("motion", None)
    return out | {"starts": starts, "seconds": round(time.process_time() - begin, 1)}


def carried(source: AllSectors, motion: Motion, target: AllSectors) -> Motion:
    """The same motion in the coordinates of another structure with the same contact points; other coordinates are zero."""
    n, m = source.n_coordinates, target.n_coordinates
    where = {d: s for d, (_, s, *_) in zip(source.families, source.blocks)}
    out = []
    for x in (motion.q, motion.v):
        z, y = x[:n] + 1j * x[n:], np.zeros(m, complex)
        for d, (l, s, *_) in zip(target.families, target.blocks):
            if d not in where:
                continue
            old = {
                (c.body, c.index): i
                for i, c in enumerate(source.wide.structure.bases[source.families[d]].coordinates)
            }
            for i, c in enumerate(target.wide.structure.bases[l].coordinates):
                if (k := old.get((c.body, c.index))) is not None and c.body != RESIDUAL:
                    y[s.start + i] = z[where[d].start + k]
        out.append(np.concatenate([y.real, y.imag]))
    return Motion(out[0], out[1], motion.w)


def answer(number: int, preload: float, start: int = 0) -> dict[str, Any]:
    """Default answer at the preload of a scene; ``start`` selects the phases of the waves that disturb the motions."""
    name, order, friction, _ = random(number)
    base = study(name, order, friction)
    begin = time.process_time()
    curve = base.frequency_response(preload, BANDS[name])
    if curve.peak_at_end:
        return {"status": "no peak"}
    seeded = AllSectors.seeded
    with patch.object(
        AllSectors,
        "seeded",
        lambda ring, motion, share, seed: seeded(ring, motion, share, seed + 101 * start),
    ):
        t = base.time_response(curve)
    sizes = {"um": t.mean, "low": t.lowest, "high": t.highest, "highest period": t.highest_period}
    out: dict[str, Any] = {what: round(1e6 * value, 3) for what, value in sizes.items()}
    out |= {"hz": t.frequency, "fall": t.jump_frequency, "status": t.status, "periods": t.periods}
    out["answers"] = {what: round(1e6 * value, 3) for what, value in t.answers.items()}
    return out | {"seconds": round(time.process_time() - begin, 1)}


def curves(number: int, preload: float) -> dict[str, Any]:
    """Peaks of cheap and default response curves at the preload of a scene."""
    name, order, friction, _ = random(number)
    out: dict[str, Any] = {}
    for what, settings in CURVES.items():
        begin = time.process_time()
        curve = study(name, order, friction, **settings).frequency_response(preload, BANDS[name])
        out[what] = {
            "um": 1e6 * curve.peak.amplitude,
            "seconds": round(time.process_time() - begin, 3),
        }
    return out


def costs(known: Known, model: int) -> dict[str, tuple[Any, Any]]:
    """Errors (%) and seconds of each way to an amplitude, in the scenes of a model with a settled reference.

    Where the default answer carried a higher motion over to the whole structure than the reference found, this counts.
    """
    out: dict[str, tuple[list[float], list[float]]] = {
        what: ([], []) for what in (*CURVES, *IN_TIME)
    }
    for n in range(model, SCENES, 2):
        truth, said, cheap = (
            known.get(f"{n} {what}", {}) for what in ("reference", "answer", "curves")
        )
        if not (
            cheap
            and "um" in said
            and truth.get("high", np.inf) <= (1.0 + SETTLED) * truth.get("low", 0.0)
        ):
            continue
        carried = said["answers"].get("all modes, 24 residual modes", 0.0)
        middle = 0.5 * (truth["low"] + truth["high"])
        middle = carried if carried > (1.0 + SETTLED) * middle else middle
        ways = dict(cheap) | dict(
            zip(IN_TIME, (said, {"um": truth["high"], "seconds": truth["seconds"]}))
        )
        for what, way in ways.items():
            out[what][0].append(100.0 * abs(way["um"] / middle - 1.0))
            out[what][1].append(way["seconds"])
    return {what: (np.array(errors), np.array(seconds)) for what, (errors, seconds) in out.items()}


def draw(known: Known) -> None:
    """Draw the error over the time of each way: medians and quartiles."""
    names = [*CURVES, *IN_TIME]
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots(1, 2, figsize=(7.2, 3.2), sharey=True)
        for model, (ax, title) in enumerate(zip(axes, ("typical turbine blade", "difficult disk"))):
            found = costs(known, model)
            x = np.array([np.median(seconds) for _, seconds in found.values()])
            low, y, high = np.array(
                [np.quantile(errors, (0.25, 0.5, 0.75)) for errors, _ in found.values()]
            ).T
            ax.errorbar(
                x,
                y,
                [y - low, high - y],
                fmt="o-",
                color="k",
                markersize=5.0,
                capsize=2.0,
                linewidth=1.0,
            )
            for k, name in enumerate(names):
                places = (
                    ((6, 6), "left", y),
                    ((6, 6), "left", y),
                    ((-6, -14), "right", low),
                    ((0, -12), "center", low),
                )
                offset, ha, height = places[k]
                ax.annotate(
                    name,
                    (x[k], height[k]),
                    xytext=offset,
                    ha=ha,
                    textcoords="offset points",
                    fontsize=8.0,
                )
            scenes = len(found[names[0]][0])
            ax.set(
                xscale="log",
                yscale="log",
                title=f"{title}, {scenes} scenes",
                xlabel="Processor time (s)",
            )
            ax.xaxis.set_major_formatter("{x:g}")
            ax.set(xlim=(0.5 * x[0], 20.0 * x[-1]), ylim=(0.2, 200.0))
        axes[0].set_ylabel("Error of the amplitude (%)")
        axes[0].yaxis.set_major_formatter("{x:g}")
        save_figure(figure, IMAGE)
    for model in range(2):
        for what, (errors, seconds) in costs(known, model).items():
            low, middle, high = np.quantile(errors, (0.25, 0.5, 0.75))
            print(
                f"| {what} | {np.median(seconds):.2g} s | {middle:.2g} ({low:.2g} to {high:.2g}) |"
            )


def show(known: Known, kind: str) -> None:
    """Print every answer or restart beside its reference, and what the aims of the comparison count."""
    rows = []
    for n in range(SCENES):
        truth, said = known.get(f"{n} reference", {}), known.get(f"{n} {kind}", {})
        name, order, friction, _ = random(n)
        scene = f"{n:2d} {name:13} {order:2d} {friction:.2f} {truth.get('preload', np.nan):6.1f} N"
        if "um" not in truth or "um" not in said:
            print(f"{scene}  reference {truth.get('um', np.nan):.4g}: {said.get('status', '')}")
            continue
        complete = said["status"].startswith("complete")
        inside = said["low"] <= truth["high"] and truth["low"] <= said["high"]
        off, width = (
            100.0 * (said["um"] / truth["um"] - 1.0),
            100.0 * (said["high"] / said["low"] - 1.0),
        )
        rows.append((complete, inside, off, width, said["seconds"]))
        print(
            f"{scene}  {truth['um']:6.1f} ({truth['low']:.1f} to {truth['high']:.1f})  {said['um']:6.1f} "
            f"({said['low']:.1f} to {said['high']:.1f}) {off:+5.1f} % {'' if inside else 'OUTSIDE'} "
            f"{said['periods']} periods {said['seconds']} s  {said['status'][:60]}"
        )
    complete = [row for row in rows if row[0]]
    print(
        f"{len(rows)} scenes with a reference, {sum(inside or not c for c, inside, *_ in rows)} within the range or not "
        f"settled, {len(rows) - len(complete)} not settled; of the complete ones the largest difference is "
        f"{max((abs(off) for _, _, off, _, _ in complete), default=0.0):.1f} %, the median width "
        f"{np.median([width for *_, width, _ in complete]):.1f} %, the median time "
        f"{np.median([seconds for *_, seconds in complete]):.1f} s"
    )


def read() -> Known:
    lines = RESULTS.read_text().splitlines() if RESULTS.exists() else []
    return {key: value for line in lines for key, value in json.loads(line).items()}


def keep(key: str, value: dict[str, Any]) -> None:
    with RESULTS.open("a") as file:
        file.write(json.dumps({key: value}) + "\n")
    print(key, value, flush=True)


def preload_of(number: int, known: Known) -> float:
    name, order, friction, factor = random(number)
    key = f"{number} optimum"
    if key not in known:
        known[key] = {
            "N": study(name, order, friction)
            .optimal_curve(frequency=BANDS[name], check=False)
            .optimum.preload
        }
        keep(key, known[key])
    return round(factor * known[key]["N"], 1)


def main() -> None:
    what, *numbers = sys.argv[1:] or ["show"]
    warnings.simplefilter("ignore", BdamperWarning)
    known = read()
    if what == "show":
        for kind in ("answer", "restart"):
            show(known, kind)
        return draw(known)
    for number in map(int, numbers or range(SCENES)):
        preload = preload_of(number, known)
        if what == "references" and f"{number} reference" not in known:
            keep(f"{number} reference", reference(number, preload))
        if what == "curves" and f"{number} curves" not in known:
            keep(f"{number} curves", curves(number, preload))
        if what == "answers" and f"{number} answer" not in known:
            keep(f"{number} answer", answer(number, preload))
        if what == "restarts" and f"{number} restart" not in known:
            keep(f"{number} restart", answer(number, preload, 1))


if __name__ == "__main__":
    main()
