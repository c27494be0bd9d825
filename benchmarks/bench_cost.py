"""What accuracy costs in time: errors of ways to an amplitude, beside a march in time with the whole structure.

``python -m benchmarks cost`` computes what ``results/cost.jsonl`` does not have yet, draws ``docs/images/cost.png`` and
prints the tables of docs/accuracy.md and docs/measured.md; ``python -m benchmarks.bench_cost 0 2 4`` computes those scenes
alone, so that several processes can share the work, and ``... show`` computes nothing.

Each scene is drawn from its number before anything is computed: the turbine blade (even numbers) or the difficult disk
(odd ones) with default settings, engine order 5 or 10, a friction coefficient of 0.2 to 0.6, and 0.8 to 4 times the preload
of the least peak of the harmonic balance.  The reference is the amplitude in time of the highest blade with the whole
structure: all stored modes of blade and damper and 24 residual patterns.  A scene counts where this march is settled.
Beside that stand

* whole answers, from one harmonic with unit tractions to the march with the default structure;
* harmonics alone, beside the march with the same, default, structure, where blades vibrate alike: no number of harmonics of
  the travelling wave comes to the highest of blades that do not;
* structures alone, each marched;
* steps of a period alone: a motion of 120 periods with the default structure, beside the answer with 1,024 steps, where
  blades vibrate alike.

A panel shows the scenes in which all of its values were found.  ``... hard`` marches cells of the difficult disk with low
preloads and many contact points.
"""

from __future__ import annotations

import json
import sys
import time
import warnings
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from numpy.typing import NDArray

import bdamper as bd
from bdamper.plot import save_figure
from bdamper.plot.axes import STYLE
from bdamper.util.errors import BdamperError, BdamperWarning

HERE = Path(__file__).parent
RESULTS = HERE / "results" / "cost.jsonl"
IMAGE = HERE.parents[0] / "docs" / "images" / "cost.png"
SEED, SCENES = 20261124, 20
BANDS = {"turbine_blade": (600.0, 720.0), "bladed_disk": (285.0, 380.0)}
MODES = {"turbine_blade": {"blade_modes": 20, "damper_modes": 4}, "bladed_disk": {"blade_modes": 40, "damper_modes": 10}}
"""All that the models store."""
PATTERNS = bd.ResidualModes(24)
HARMONICS = (5, 7, 9, 12, 16, 20, 26)
STEPS = (128, 256, 512)
LIKE_DEFAULT = "marched, 10 modes, 6 patterns"
STRUCTURES: dict[str, dict[str, Any]] = {
    "marched, unit tractions": {"contact_stiffness": "unit_traction"}, LIKE_DEFAULT: {},
    "marched, 24 patterns": {"contact_stiffness": PATTERNS}, "marched, all modes": {"all": True},
    "reference": {"all": True, "contact_stiffness": PATTERNS},
}  # fmt: skip
CURVES: dict[str, dict[str, Any]] = {
    "1 harmonic, unit tractions": {"harmonics": 1, "contact_stiffness": "unit_traction"},
    "3 harmonics, unit tractions": {"contact_stiffness": "unit_traction"},
    "1 harmonic": {"harmonics": 1}, "3 harmonics": {},
}  # fmt: skip
WAYS = {
    "1 harmonic, unit tractions": "1 harmonic, unit tractions",
    "3 harmonics, unit tractions": "3 harmonics, unit tractions",
    "3 harmonics": "default curve, 3 harmonics", LIKE_DEFAULT: "in time", "marched, all modes": "in time, all modes",
}  # fmt: skip
"""Whole answers that a designer would ask for, and their words."""
SHOWN = 16
"""Highest number of harmonics that is shown; beyond it too few scenes have a peak."""
Known = dict[str, dict[str, Any]]


def random(number: int) -> tuple[str, int, float, float]:
    """Model, engine order, friction coefficient and preload over that of the least peak."""
    rng = np.random.default_rng([SEED, number])
    order, friction = int(rng.choice([5, 10])), round(float(rng.uniform(0.2, 0.6)), 2)
    return ("bladed_disk" if number % 2 else "turbine_blade"), order, friction, float(0.8 * 5.0 ** rng.uniform())


def study(name: str, order: int, friction: float, points: int = 9) -> bd.Study:
    excitation = bd.Excitation("tip", "tangential", 1.0)
    return bd.Study(bd.reference_model(name, points), excitation, order, friction_coefficient=friction)


def curve_of(of: bd.Study, preload: float, band: tuple[float, float]) -> tuple[bd.ResponseCurve, dict[str, Any]]:
    begin = time.process_time()
    curve = of.frequency_response(preload, band)
    seconds = time.process_time() - begin
    return curve, {"um": 1e6 * curve.peak.amplitude, "status": curve.status, "seconds": round(seconds, 3)}


def marched(of: bd.Study, preload: float, band: tuple[float, float]) -> dict[str, Any]:
    """Amplitude in time of the highest blade, with all that it takes from the study on."""
    begin = time.process_time()
    try:
        found = of.time_response(curve_of(of, preload, band)[0])
    except BdamperError as error:
        return {"um": np.nan, "status": f"not found: {error}", "seconds": round(time.process_time() - begin, 2)}
    answers = {name: 1e6 * a for name, a in found.answers.items()}
    return {
        "um": 1e6 * found.mean, "hz": found.frequency, "lowest": 1e6 * found.lowest, "highest": 1e6 * found.highest,
        "answers": answers, "parted": found.parted, "status": found.status,
        "seconds": round(time.process_time() - begin, 2),
    }  # fmt: skip


def compute(number: int, known: Known) -> None:
    """What is missing of a scene; after Ctrl-C the next run goes on."""
    name, order, friction, factor = random(number)
    base, band = study(name, order, friction), BANDS[name]

    def ask(what: str, answer: Any) -> dict[str, Any]:
        key = f"{number} {what}"
        if key not in known:
            known[key] = answer()
            with RESULTS.open("a") as file:
                file.write(json.dumps({key: known[key]}) + "\n")
            print(key, known[key], flush=True)
        return known[key]

    optimum = ask("optimum", lambda: {"N": base.optimal_curve(frequency=band, check=False).optimum.preload})["N"]
    preload = round(factor * optimum, 1)
    for what, given in CURVES.items():
        ask(what, lambda given=given: curve_of(base.replace(**given), preload, band)[1])
    if f"{number} {HARMONICS[-1]} harmonics" not in known:
        for what, row in more_harmonics(base, preload, band, known[f"{number} 3 harmonics"]["seconds"]).items():
            ask(what, lambda row=row: row)
    for what, given in STRUCTURES.items():
        whole = {key: value for key, value in given.items() if key != "all"} | (MODES[name] if "all" in given else {})
        ask(what, lambda whole=whole: marched(base.replace(**whole), preload, band))
    if np.isfinite(at := known[f"{number} {LIKE_DEFAULT}"].get("hz", np.nan)):
        curve = base.frequency_response(preload, band)
        for steps in STEPS:
            ask(f"{steps} steps", lambda steps=steps: settled(base, curve, at, steps))


def more_harmonics(of: bd.Study, preload: float, band: tuple[float, float], seconds: float) -> Known:
    """Peaks with more harmonics; each has the time of the default curve and of all numbers up to its own."""
    try:
        found = of.harmonic_convergence(of.peak(preload, band), harmonics=HARMONICS, tolerance=1e-9)
        peaks, status = {p.harmonics: p for p in found.peaks[1:]}, found.status
    except BdamperError as error:
        peaks, status = {}, str(error)
    rows: Known = {}
    for h in HARMONICS:
        rows[f"{h} harmonics"] = {"um": np.nan, "status": status, "seconds": np.nan}
        if h in peaks:
            seconds += peaks[h].seconds
            rows[f"{h} harmonics"] = {"um": 1e6 * peaks[h].amplitude, "status": "complete", "seconds": round(seconds, 3)}
    return rows


def settled(of: bd.Study, curve: bd.ResponseCurve, at: float, steps: int) -> dict[str, Any]:
    try:
        found = of.settle(curve, at, periods=120, steps_per_period=steps)
    except BdamperError as error:
        return {"um": np.nan, "status": f"not found: {error}", "seconds": np.nan}
    return {"um": 1e6 * found.mean, "status": found.status, "seconds": round(found.cost.processor, 3)}


def read() -> Known:
    lines = RESULTS.read_text().splitlines() if RESULTS.exists() else []
    return {key: value for line in lines for key, value in json.loads(line).items()}


def references(known: Known) -> dict[int, float]:
    """Amplitude of each scene whose reference is settled, µm."""
    found = {n: known.get(f"{n} reference", {}) for n in range(SCENES)}
    return {n: r["um"] for n, r in found.items() if r.get("status") == "complete"}


def row(known: Known, what: str, judge: dict[int, float]) -> tuple[NDArray, NDArray]:
    """Errors (%) of a way beside its judge and times over that of the default curve, in all scenes of the judge."""
    found = [known[f"{n} {what}"] for n in judge]
    errors = [100.0 * abs(f["um"] / reference - 1.0) for f, reference in zip(found, judge.values())]
    times = [f["seconds"] / known[f"{n} 3 harmonics"]["seconds"] for f, n in zip(found, judge)]
    return np.array(errors), np.array(times)


Panel = tuple[dict[str, str], dict[int, float]]


def panels(known: Known, model: int) -> dict[str, Panel]:
    """For each panel its ways with the words beside their marks, and the judge of each scene that has all of them."""
    whole = {n: um for n, um in references(known).items() if n % 2 == model}
    same = {n: known[f"{n} {LIKE_DEFAULT}"] for n in whole}
    time_ = {n: found["um"] for n, found in same.items() if found["status"] == "complete" and not found["parted"]}
    fine = {n: same[n].get("answers", {}).get("1024 steps", np.nan) for n in time_}
    wave = {"1 harmonic": "1"} | {f"{h} harmonics": str(h) for h in (3, *HARMONICS) if h <= SHOWN}
    found = {
        "Whole answers": ({w: WAYS[w] for w in WAYS}, whole),
        "Harmonics alone": (wave, time_),
        "Structure alone, in time": ({s: s.partition(", ")[2] for s in list(STRUCTURES)[:-1]}, whole),
        "Steps of a period alone": ({f"{n} steps": str(n) for n in STEPS}, fine),
    }
    return {title: (ways, {n: um for n, um in judge.items() if _has(known, n, ways, um)})
            for title, (ways, judge) in found.items()}  # fmt: skip


def _has(known: Known, n: int, ways: dict[str, str], judge: float) -> bool:
    return bool(np.isfinite([judge, *(known.get(f"{n} {what}", {}).get("um", np.nan) for what in ways)]).all())


def draw(known: Known) -> None:
    """Error over time, a panel for each kind of refinement."""
    looks = (("o-", "k", "turbine blade"), ("s--", "0.45", "difficult disk"))
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots(2, 2, figsize=(7.2, 6.4), sharex=True, sharey=True)
        for model, (marks, colour, label) in enumerate(looks):
            for ax, (title, (ways, judge)) in zip(axes.flat, panels(known, model).items()):
                ax.set(xscale="log", yscale="log", title=title)
                if not judge:
                    continue
                found = [row(known, what, judge) for what in ways]
                x = np.array([np.median(times) for _, times in found])
                low, y, high = np.array([np.quantile(errors, (0.25, 0.5, 0.75)) for errors, _ in found]).T
                said = f"{label}, {len(judge)} scene" + "s" * (len(judge) > 1)
                ax.errorbar(x, y, [y - low, high - y], fmt=marks, color=colour, markersize=4.0, capsize=2.0, linewidth=1.0,
                            markerfacecolor="w" if model else "k", label=said)  # fmt: skip
                for k, text in enumerate(ways.values()):
                    beside = text if text.isdigit() else f"({k + 1})"
                    ax.annotate(beside, (x[k], y[k]), xytext=(4, -9 if model else 4), textcoords="offset points",
                                fontsize=7.0, color=colour)  # fmt: skip
        for ax in axes.flat:
            ax.xaxis.set_major_formatter("{x:g}")
            ax.yaxis.set_major_formatter("{x:g}")
            ax.xaxis.set_minor_formatter("")
            ax.legend(fontsize=7.0, loc="upper right")
        for ax, (ways, _) in zip(axes.flat, panels(known, 0).values()):
            words = [f"({k + 1}) {text}" for k, text in enumerate(ways.values()) if not text.isdigit()]
            ax.text(0.03, 0.03, "\n".join(words), transform=ax.transAxes, fontsize=7.0, va="bottom")
        figure.supylabel("Difference of the amplitude (%)", fontsize=9.0)
        figure.supxlabel("Processor time over that of the default curve", fontsize=9.0)
        save_figure(figure, IMAGE)


def show(known: Known) -> None:
    """The tables of docs/accuracy.md and docs/measured.md."""
    for title in panels(known, 0):
        both = [panels(known, model)[title] for model in (0, 1)]
        scenes = [f"{len(judge)} scene" + "s" * (len(judge) > 1) for _, judge in both]
        print(f"\n| {title.lower()} | time, blade | error (%), {scenes[0]} | time, disk | error (%), {scenes[1]} |")
        print("|---|---|---|---|---|")
        for what, text in both[0][0].items():
            cells = [text]
            for _, judge in both:
                errors, times = row(known, what, judge)
                if len(errors):
                    low, middle, high = np.quantile(errors, (0.25, 0.5, 0.75))
                    cells += [f"{np.median(times):.2g}", f"{middle:.2g} ({low:.2g} to {high:.2g})"]
            print(f"| {' | '.join(cells)} |")
    ways = ["1 harmonic, unit tractions", "1 harmonic", "3 harmonics", f"{SHOWN} harmonics", *STRUCTURES]
    print("\n| scene | " + " | ".join(w.removeprefix("marched, ") for w in ways) + " | |")
    print("|---" * (len(ways) + 2) + "|")
    for n in range(SCENES):
        if f"{n} reference" in known:
            name, order, friction, factor = random(n)
            load = round(factor * known[f"{n} optimum"]["N"], 1)
            cells = [f"{known[f'{n} {w}']['um']:.1f}".replace("nan", "-") for w in ways]
            status = known[f"{n} reference"]["status"]
            parted = "blades do not vibrate alike" if known[f"{n} reference"].get("parted") else ""
            scene = f"{name.replace('_', ' ')}, engine order {order}, mu {friction}, {load} N ({factor:.2g} of the optimum)"
            print(f"| {scene} | {' | '.join(cells)} | {parted if status == 'complete' else status} |")


def hard() -> None:
    """March cells of the difficult disk that are hard: low preloads, many contact points."""
    print("| preload (N) | points a face | peak of the balance | in time | s |\n|---|---|---|---|---|")
    band = (220.0, 380.0)  # the free blade resonates at 283 Hz
    for points in (24, 48):
        of = study("bladed_disk", 5, 0.4, points)
        for preload in (20.0, 50.0):
            found = curve_of(of, preload, band)[1]
            there = marched(of, preload, band)
            balance, in_time = (f"{one['um']:.1f} ({one['status']})" for one in (found, there))
            cells = (f"{preload:g}", points, balance, in_time)
            print(f"| {' | '.join(map(str, cells))} | {there['seconds']:.0f} |", flush=True)


def main() -> None:
    asked = sys.argv[1:]
    warnings.simplefilter("ignore", BdamperWarning)
    if "hard" in asked:
        hard()
        return
    known = read()
    for number in [] if "show" in asked else map(int, asked or range(SCENES)):
        compute(number, known)
    show(read())
    draw(read())


if __name__ == "__main__":
    main()
