"""What a test would see: slow sweeps of frequency marched over 13 sectors, beside tracking curves of 1, 3 and 5 harmonics.

The shipped disk with nine contact points a face, engine order 5, friction 0.4, 1 N at the tip, ten blade modes.
``python -m benchmarks in_time_sweeps`` computes what ``results/in_time_sweeps.json`` does not have yet, writes the tables
of ``docs/in-time.md`` and draws its pictures; without the file everything is computed anew.
``python -m benchmarks.bench_in_time_sweeps CASE ...`` computes single cases, as ``unit_traction/125/down``; ``show`` none.
"""

from __future__ import annotations

import json
import sys
import time
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

import bdamper as bd
from bdamper.plot import save_figure
from bdamper.plot.axes import DASHED, drawing, legend_beside, runs
from bdamper.stability.time_sweep import TimeSweep

RESULTS = Path(__file__).parent / "results" / "in_time_sweeps.json"
IMAGES = Path(__file__).parents[1] / "docs" / "images"
PAGE = Path(__file__).parents[1] / "docs" / "in-time.md"
MARKS = "<!-- written by benchmarks/bench_in_time_sweeps.py -->", "<!-- to here -->"
HARMONICS = (1, 3, 5)
LEAST = 2.0 * 0.002 * 2.0 * np.pi * 283.02
"""Full bandwidth of the first blade mode, rad/s."""
KEPT = 600
"""Points of a sweep that are stored."""
BEAT = 80
"""Periods that mean and band of a sweep are taken over in the pictures."""
SWEEPS = {"up": ("tab:orange", "^"), "down": ("tab:blue", "v")}
"""Colour and marker of a sweep."""
LINES = (("0.75", 0.9), ("0.55", 0.9), ("k", 1.5))
"""Colour and width of the curves of `HARMONICS`: the finest is the one to look at."""


class Case(NamedTuple):
    """Interval (Hz), harmonics of the study, and half bandwidths of the first blade mode that the frequency goes within the
    memory of its transients."""

    low: float
    high: float
    harmonics: int = 6
    rate: float = 0.4


CASES = {
    "unit_traction/125/up": Case(298.0, 331.0),
    "unit_traction/125/down": Case(298.0, 331.0),
    "residual_modes/500/down": Case(348.5, 354.5, 3, 0.8),
    "residual_modes/125/down": Case(325.0, 337.0, 3, 0.8),
    "residual_modes/500/up": Case(348.5, 354.5, 3, 0.8),
    "residual_modes/125/up": Case(325.0, 337.0, 3, 0.8),
    "residual_modes/2000/up": Case(357.0, 364.0, 3, 0.8),
    "residual_modes/2000/down": Case(357.0, 364.0, 3, 0.8),
}


def study(stiffness: str, harmonics: int) -> bd.Study:
    return bd.Study(
        bd.reference_model("bladed_disk", contact_points=9),
        bd.Excitation("tip", direction="tangential", amplitude=1.0),
        engine_order=5,
        friction_coefficient=0.4,
        blade_modes=10,
        contact_stiffness=stiffness,
        harmonics=harmonics,
    )


def rounded(values: Any) -> list[float]:
    return [float(f"{value:.6g}") for value in values]


def thinned(sweep: TimeSweep) -> dict[str, Any]:
    """What is stored of a sweep."""
    i = np.unique(np.linspace(0, len(sweep) - 1, KEPT).round().astype(int))
    return {
        "frequency": rounded(sweep.frequency[i]),
        "amplitude": rounded(sweep.amplitude[i]),
        "highest": rounded(sweep.highest),
        "jumps": [rounded(jump) for jump in sweep.jumps],
        "rate": sweep.rate,
        "turns": len(sweep),
        "status": sweep.status,
    }


def marched(name: str, case: Case) -> dict[str, Any]:
    """One sweep, and the same at twice the rate."""
    stiffness, preload, way = name.split("/")
    of = study(stiffness, case.harmonics)
    started = time.process_time()
    rate = case.rate * LEAST**2 / (8.0 * np.pi)
    ways: dict[str, Any] = {"up": way == "up", "rate": rate, "progress": sys.stderr.isatty()}
    sweep = of.sweep_in_time(float(preload), (case.low, case.high), **ways)
    print(sweep, flush=True)
    assert sweep.faster is not None
    return {
        **thinned(sweep), "twice": thinned(sweep.faster), "error": sweep.error, "steps_per_period": sweep.steps_per_period,
        "sectors": sweep.sectors, "harmonics": case.harmonics, "model": sweep.model_hash,
        "bdamper": sweep.made_with.bdamper, "processor": round(time.process_time() - started, 1),
    }  # fmt: skip


def tracked(name: str) -> dict[str, Any]:
    """Tracking curves at one preload, with the verdict of the sign of the determinant for each point."""
    stiffness, preload = name.split("/")
    found = {}
    for h in HARMONICS:
        started = time.process_time()
        curve = study(stiffness, h).track(float(preload), (285.0, 370.0), stability=True)
        found[str(h)] = {
            "frequency": rounded(curve.frequency),
            "amplitude": rounded(curve.amplitude),
            "stable": [int(x) for x in np.asarray(curve.stable)],
            "branch": [int(x) for x in curve.branch],
            "folds": [rounded((fold.frequency, fold.amplitude)) for fold in curve.folds],
            "peak": rounded((curve.peak.frequency, curve.peak.amplitude)),
            "status": curve.status,
            "processor": round(time.process_time() - started, 1),
        }
    return found


def stable_at(curve: dict[str, Any], f: float) -> list[float]:
    """Amplitudes of the stable branches at one frequency."""
    rows = zip(curve["frequency"], curve["amplitude"], curve["stable"], curve["branch"])
    out = []
    for (f1, a1, s1, b1), (f2, a2, s2, b2) in pairwise(rows):
        if s1 and s2 and b1 == b2 and min(f1, f2) <= f <= max(f1, f2) and f1 != f2:
            out.append(a1 + (a2 - a1) * (f - f1) / (f2 - f1))
    return out


def beside(sweep: dict[str, Any], curve: dict[str, Any]) -> str:
    """Share of the sweep within 5 % of a stable branch, median difference, and the fold next to the first jump."""
    away = []
    for f, a in zip(sweep["frequency"], sweep["amplitude"]):
        away.append(min((abs(a / x - 1.0) for x in stable_at(curve, f)), default=np.inf))
    folds = [f for f, _ in curve["folds"]]
    jump = sweep["jumps"][0][0] if sweep["jumps"] else None
    fold = f"{min(folds, key=lambda f: abs(f - jump)):.2f}" if jump and folds else "none"
    return f"{100.0 * np.mean(np.array(away) <= 0.05):.0f} %, {100.0 * np.median(away):.1f} %, {fold}"


def rows(name: str, sweep: dict[str, Any], curves: dict[str, Any]) -> tuple[list[str], list[str]]:
    """Of the two tables."""
    stiffness, preload, way = name.split("/")
    head = [stiffness.replace("_", " "), preload, way]
    f, a = sweep["highest"]
    jumps = [f"{1e6 * b:.0f} to {1e6 * c:.0f} at {g:.2f}" for g, b, c in sweep["jumps"]]
    there = ", ".join(f"{g:.2f}" for g, *_ in sweep["twice"]["jumps"][:2]) or "none"
    own = [
        f"{1e6 * a:.1f} at {f:.2f}",
        ", ".join(jumps[:2]) + (f" and {len(jumps) - 2} more" if jumps[2:] else "") or "none",
    ]
    rate = [f"{100.0 * (sweep['twice']['highest'][1] / a - 1.0):+.1f}", there, f"{100.0 * sweep['error']:.1f}"]
    first = [*head, f"{abs(sweep['rate']):.2g}", *own, *rate, f"{sweep['processor']:.0f}"]
    return first, [*head, *(beside(sweep, curves[str(h)]) for h in HARMONICS)]


def table(head: list[str], lines: list[list[str]]) -> str:
    return "\n".join(f"| {' | '.join(cells)} |" for cells in (head, ["---"] * len(head), *lines))


def page(known: dict[str, Any]) -> str:
    """What stands between the marks in the page."""
    found = [rows(name, known[name], known[name.rpartition("/")[0]]) for name in CASES if name in known]
    head = ["contact stiffness", "preload (N)", "way"]
    first = [
        "rate (Hz/s)",
        "highest (µm at Hz)",
        "jumps (µm at Hz)",
        "twice the rate: highest (%)",
        "jumps (Hz)",
        "elsewhere (%)",
        "time (s)",
    ]
    second = [f"{h} harmonic{'s' * (h > 1)}" for h in HARMONICS]
    studies = dict.fromkeys(name.rpartition("/")[0] for name in CASES if name in known)
    pictures = [f"![Slow sweeps over tracking curves, {of}](images/{image(*of.split('/'))})" for of in studies]
    missing = ", ".join(name for name in CASES if name not in known)
    return "\n\n".join([
        *pictures,
        table(head + first, [one for one, _ in found]),
        table(head + second, [two for _, two in found]),
        *([f"Not computed yet: {missing}."] if missing else []),
    ])  # fmt: skip


def image(stiffness: str, preload: str) -> str:
    return f"in-time-{stiffness.split('_')[0]}-{preload}.png"


def outline(sweep: dict[str, Any]) -> list[NDArray]:
    """Frequency (Hz), lowest, mean and highest amplitude (m) of each stretch between jumps, over `BEAT` periods around
    every point that is stored."""
    f, a = np.array(sweep["frequency"]), np.array(sweep["amplitude"])
    half = max(2, round(0.5 * BEAT * len(f) / sweep["turns"]))
    cuts = sorted({int(np.argmin(np.abs(f - g))) for g, *_ in sweep["jumps"]})
    parts = []
    for first, last in pairwise([0, *cuts, len(f)]):
        if last - first > 2 * half:
            ends = np.pad(a[first:last], half, "edge")
            seen = np.lib.stride_tricks.sliding_window_view(ends, 2 * half + 1)
            parts.append(np.array([f[first:last], seen.min(axis=1), seen.mean(axis=1), seen.max(axis=1)]))
    return parts


def draw_harmonics(ax: Axes, curve: dict[str, Any], colour: Any, width: float) -> None:
    """A curve, dashed where the sign of det J says that a blade does not keep to it."""
    f, a, s, b = (np.array(curve[name]) for name in ("frequency", "amplitude", "stable", "branch"))
    for branch in np.unique(b):
        where = np.flatnonzero(b == branch)
        for first, last in runs(s[where]):
            part = where[first : last + 2]  # joined to the next stretch
            if s[part[0]]:
                ax.plot(f[part], a[part], color=colour, linewidth=width)
            else:  # a pale line below, so that a stretch shorter than a dash is no gap
                ax.plot(f[part], a[part], color=colour, linewidth=width, alpha=0.3)
                ax.plot(f[part], a[part], color=colour, linewidth=width, linestyle=DASHED)


def title(stiffness: str, preload: str, down: dict[str, Any] | None, finest: dict[str, Any]) -> str:
    """What a picture shows, and where a sweep down falls for good (within 1 Hz) beside the last fold of harmonics."""
    text = f"Preload {preload} N, {stiffness.replace('_', ' ')}"
    if down and down["jumps"] and finest["folds"]:
        g, before, after = down["jumps"][-1]
        later = [a for f, a in zip(down["frequency"], down["amplitude"]) if f < g - 1.0]
        if max(later) < np.sqrt(before * after):
            fold = min(f for f, _ in finest["folds"])
            return f"{text}: the sweep down falls at {g:.0f} Hz, {HARMONICS[-1]} harmonics fold at {fold:.0f} Hz"
    return f"{text}: sweeps beat where {HARMONICS[-1]} harmonics are steady"


def picture(stiffness: str, preload: str, known: dict[str, Any]) -> None:
    """Sweeps up and down, as bands of what beats with their means, and the curves of harmonics on them."""
    sweeps = {way: known[name] for way in SWEEPS if (name := f"{stiffness}/{preload}/{way}") in known}
    curves = known[f"{stiffness}/{preload}"]
    low = min(min(s["frequency"]) for s in sweeps.values())
    high = max(max(s["frequency"]) for s in sweeps.values())
    head = title(stiffness, preload, sweeps.get("down"), curves[str(HARMONICS[-1])])
    with drawing(size=(6.6, 3.6), title=head) as ax:
        seen = []
        for way, sweep in sweeps.items():
            colour, marker = SWEEPS[way]
            for f, least, mean, most in outline(sweep):
                ax.fill_between(f, least, most, color=colour, alpha=0.22, linewidth=0.0)
                ax.plot(f, mean, color=colour, linewidth=1.0, marker=marker, markersize=4.0, markevery=KEPT // 12)
                seen += [least.min(), most.max()]
            ax.plot([], [], color=colour, marker=marker, markersize=4.0, label=f"sweep {way}, mean\nand range")
        for h, (colour, width) in zip(HARMONICS, LINES):
            curve = curves[str(h)]
            draw_harmonics(ax, curve, colour, width)
            ax.plot([], [], color=colour, linewidth=width, label=f"{h} harmonic{'s' * (h > 1)}")
            seen += [a for f, a in zip(curve["frequency"], curve["amplitude"]) if low <= f <= high]
        ax.plot([], [], color="k", linestyle=DASHED, label="unstable")
        margin, least, most = 0.05 * (high - low), min(seen), max(seen)
        ax.set(xlim=(low - margin, high + margin), ylim=(0.0 if least < 0.4 * most else 0.9 * least, 1.05 * most))
        ax.set(xlabel="Frequency (Hz)", ylabel="Tip amplitude (m)")
        legend_beside(ax)
    save_figure(ax, IMAGES / image(stiffness, preload))


def stored() -> dict[str, Any]:
    return dict(json.loads(RESULTS.read_text())) if RESULTS.exists() else {}


def keep(name: str, found: dict[str, Any]) -> None:
    known = stored() | {name: found}
    lines = [f"{json.dumps(key)}:{json.dumps(value, separators=(',', ':'))}" for key, value in known.items()]
    RESULTS.write_text("{\n" + ",\n".join(lines) + "\n}\n")


def main(arguments: list[str] | None = None) -> None:
    for name in arguments or CASES if arguments != ["show"] else ():
        if name not in stored():
            keep(name, marched(name, CASES[name]))
        if (of := name.rpartition("/")[0]) not in stored():
            keep(of, tracked(of))
    known = stored()
    for of in dict.fromkeys(name.rpartition("/")[0] for name in CASES if name in known):
        picture(*of.split("/"), known)
    before, _, rest = PAGE.read_text().partition(MARKS[0])
    text = page(known)
    print(text)
    PAGE.write_text(f"{before}{MARKS[0]}\n\n{text}\n\n{MARKS[1]}{rest.partition(MARKS[1])[2]}")


if __name__ == "__main__":
    main(sys.argv[1:])
