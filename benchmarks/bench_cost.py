"""What accuracy costs, judged by what a blade keeps in time: error over processor time for each setting by itself.

``python -m benchmarks cost`` computes what ``results/cost.json`` does not have yet, scene by scene, draws
``docs/images/cost.png`` and prints the table of docs/accuracy.md; ``python -m benchmarks.bench_cost show`` draws and prints
what is known.

One setting at a time is changed about the default.  The judge of harmonics is the amplitude that ``study.kept`` finds with
the default structure: the highest solution of the balance at its frequency, and the top apart from that.  Patterns, modes
and points change the structure itself, and with it the frequency; their judge is what is kept with the richest structure of
their row that was marched (:data:`JUDGES`), that of the method is the one with most patterns, and tops alone are compared.
"""

from __future__ import annotations

import json
import sys
import time
import warnings
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from numpy.typing import NDArray

import bdamper as bd
from bdamper.peaks.optimal import BUDGET
from bdamper.plot import save_figure
from bdamper.plot.axes import PAPER
from bdamper.stability.kept import Levels
from bdamper.util.errors import BdamperError
from bdamper.util.warn import BdamperWarning

HERE = Path(__file__).parent
RESULTS = HERE / "results" / "cost.json"
IMAGE = HERE.parents[0] / "docs" / "images" / "cost.png"
BAND = (285.0, 380.0)
SCENES = (
    (0.4, 5, 1.25), (0.2, 10, 2.0), (0.6, 5, 4.0), (0.4, 10, 0.8), (0.2, 5, 0.65), (0.4, 5, 4.0),
    (0.6, 10, 1.25), (0.2, 10, 0.9), (0.6, 5, 0.8), (0.4, 10, 2.0),
)  # fmt: skip
"""Friction coefficient, engine order of 65 blades (13 sectors both), and preload over that of the least peak."""
PRELOADS = np.geomspace(30.0, 400.0, 12)
"""N, of which the one with the least peak of a complete curve counts as the optimum of a friction coefficient and an engine
order."""
JUDGES = {"patterns": 24, "blade_modes": 40, "points": 24}
"""The richest value of each setting of the structure that is marched besides the default."""
ROWS: dict[str, tuple[Any, ...]] = {
    "harmonics": (1, 3, 5, 9), "patterns": (6, 12, 24), "blade_modes": (10, 20, 40), "points": (9, 24, 48),
    "method": ("unit_traction", "residual_modes"),
}  # fmt: skip
"""Values of each setting; all others are those of the default, three harmonics, six patterns, ten modes, nine points."""
DEFAULT = {"harmonics": 3, "patterns": 6, "blade_modes": 10, "points": 9, "method": "residual_modes"}
NAMES = {
    "harmonics": "harmonics", "patterns": "residual patterns", "blade_modes": "blade modes", "points": "points a face",
    "method": "contact stiffness",
}  # fmt: skip


def study(friction: float, order: int, setting: str = "harmonics", value: Any = 3) -> bd.Study:
    """The shipped disk with one setting changed."""
    given: dict[str, Any] = {"contact_stiffness": "residual_modes"}
    if setting == "patterns":
        given["contact_stiffness"] = bd.ResidualModes(value)
    elif setting == "method":
        given["contact_stiffness"] = value
    elif setting != "points":
        given[setting] = value
    model = bd.reference_model("bladed_disk", value if setting == "points" else 9)
    return bd.Study(model, bd.Excitation("tip"), order, friction_coefficient=friction, **given)


def tracked(of: bd.Study, preload: float) -> tuple[bd.Curve, float]:
    """A curve as an optimal curve follows it, and the seconds of the processor that it took."""
    of.problem.system(preload)
    begin = time.process_time()
    curve = of.track(preload, BAND, options=bd.ContinuationOptions(budget=BUDGET))
    return curve, time.process_time() - begin


def least(friction: float, order: int) -> float:
    """Preload (N) of the least peak with the default settings, among curves that span the band and peak within it.

    Raises
    ------
    BdamperError
        If there is no such curve.
    """
    of = study(friction, order)
    curves = {float(p): tracked(of, p)[0] for p in PRELOADS}
    peaks = {p: curve.peak.amplitude for p, curve in curves.items() if curve.complete and not curve.peak_at_end}
    if not peaks:
        raise BdamperError(f"friction {friction:g}, engine order {order}: no curve is complete and has a peak in {BAND} Hz")
    return min(peaks, key=peaks.__getitem__)


def judged(friction: float, order: int, preload: float, setting: str, value: Any) -> dict[str, Any]:
    """What a blade keeps."""
    of = study(friction, order, setting, value)
    try:
        found = of.march(tracked(of, preload)[0])
    except BdamperError as error:  # as of a damper that rattles
        return {"mean": np.nan, "frequency": np.nan, "status": f"not found: {error}"}
    return {
        "mean": 1e6 * found.mean, "lowest": 1e6 * found.lowest, "highest": 1e6 * found.highest,
        "frequency": found.frequency, "status": found.status, "seconds": round(found.cost.processor, 2),
    }  # fmt: skip


def balanced(friction: float, order: int, preload: float, setting: str, value: Any, at: float) -> dict[str, Any]:
    """Top of the balance, its highest solution at a frequency (Hz), and the time of the curve."""
    curve, seconds = tracked(study(friction, order, setting, value), preload)
    there = Levels(curve).at(at) if len(curve) and np.isfinite(at) else []
    return {
        "top": 1e6 * float(max(curve.amplitude, default=np.nan)), "at": 1e6 * float(max(there, default=np.nan)),
        "status": curve.status, "points": len(curve), "seconds": round(seconds, 3),
    }  # fmt: skip


def jobs(scene: tuple[float, int, float], known: dict[str, Any], later: bool) -> Any:
    """Name, function and arguments of each computation of a scene, those first on which others rest."""
    friction, order, factor = scene
    name = name_of(scene)
    best = f"optimum of mu {friction}, engine order {order}"
    yield best, least, (friction, order)
    given = friction, order, factor * known[best]
    yield f"{name}/kept", judged, (*given, "harmonics", 3)
    for setting, values in ROWS.items():
        for value in values:
            yield f"{name}/{setting} {value}", balanced, (*given, setting, value, known[f"{name}/kept"]["frequency"])
    for setting, value in JUDGES.items() if later else ():
        yield f"{name}/kept, {setting} {value}", judged, (*given, setting, value)


def name_of(scene: tuple[float, int, float]) -> str:
    """Of a scene in the results."""
    return f"mu {scene[0]}, engine order {scene[1]}, {scene[2]} of the optimum"


def compute(scenes: int) -> None:
    """What is missing of so many scenes, the longest marches last; after Ctrl-C the next run goes on."""
    known = json.loads(RESULTS.read_text()) if RESULTS.exists() else {}
    warnings.simplefilter("ignore", BdamperWarning)
    for later in (False, True):
        for scene in SCENES[:scenes]:
            for name, function, arguments in jobs(scene, known, later):
                if name not in known:
                    known[name] = function(*arguments)
                    RESULTS.write_text(json.dumps(known, indent=1) + "\n")
                    print(name, known[name], flush=True)


class Shown(NamedTuple):
    """One value of a setting over all scenes where its judge is known: median and quartiles.

    Parameters
    ----------
    value : int or str
    time : float
        Of a curve, over that with the default settings in the same scene.
    top, at : (3,) float
        Lower quartile, median and upper quartile of the error (%), of tops and at one frequency, there of the scenes whose
        curve has it; NaN where not compared.
    scenes : int
    """

    value: Any
    time: float
    top: NDArray
    at: NDArray
    scenes: int


def rows(known: dict[str, Any]) -> dict[str, list[Shown]]:
    """What the benchmark found, by setting."""
    names = [name for name in map(name_of, SCENES) if np.isfinite(known.get(f"{name}/kept", {}).get("mean", np.nan))]
    out: dict[str, list[Shown]] = {}
    for setting, values in ROWS.items():
        judge = {"harmonics": "kept", "method": "kept, patterns 24"}.get(setting, f"kept, {setting} {JUDGES.get(setting)}")
        there = [n for n in names if np.isfinite(known.get(f"{n}/{judge}", {}).get("mean", np.nan))]
        there = [n for n in there if all(f"{n}/{setting} {value}" in known for value in values)]
        out[setting] = []
        for value in values if there else ():
            found = [known[f"{n}/{setting} {value}"] for n in there]
            plain = [known[f"{n}/{setting} {DEFAULT[setting]}"]["seconds"] for n in there]
            kept = np.array([known[f"{n}/{judge}"]["mean"] for n in there])
            errors = {name: 100.0 * np.abs(np.array([r[name] for r in found]) / kept - 1.0) for name in ("top", "at")}
            quartiles = {name: np.nanquantile(e, (0.25, 0.5, 0.75)) for name, e in errors.items()}
            at = quartiles["at"] if setting == "harmonics" else np.full(3, np.nan)
            time_ = float(np.median([r["seconds"] / s for r, s in zip(found, plain)]))
            out[setting].append(Shown(value, time_, quartiles["top"], at, len(there)))
    return out


def structures(known: dict[str, Any]) -> dict[str, NDArray]:
    """Change (%) of what is kept from the default to the richest structure, in each scene where both are known."""
    out = {}
    for setting, value in JUDGES.items():
        both = [(known.get(f"{n}/kept", {}), known.get(f"{n}/kept, {setting} {value}", {})) for n in map(name_of, SCENES)]
        change = np.array([100.0 * (b.get("mean", np.nan) / a.get("mean", np.nan) - 1.0) for a, b in both])
        out[setting] = change[np.isfinite(change)]
    return out


def draw(known: dict[str, Any]) -> None:
    """Error over time of a curve, one panel for each setting."""
    found = {setting: values for setting, values in rows(known).items() if values and values[0].scenes > 1}
    with plt.rc_context(PAPER):
        figure, axes = plt.subplots(1, len(found), figsize=(3.0 * len(found), 3.6), sharex=True, sharey=True)
        for ax, (setting, values) in zip(axes, found.items()):
            looks = {"top": ("o-", "k", "highest peak"), "at": ("D-", "0.5", "at the frequency of that amplitude")}
            for name, (marks, colour, label) in looks.items():
                low, middle, high = np.array([getattr(v, name) for v in values]).T
                if not np.isfinite(middle).any():
                    continue
                x = np.array([v.time for v in values]) * (1.0 if name == "top" else 1.12)
                ax.errorbar(x, middle, [middle - low, high - middle], fmt=marks, color=colour, markersize=4.0, capsize=2.0,
                            linewidth=1.0, markerfacecolor="k" if name == "top" else "w", label=label)  # fmt: skip
            for k, v in enumerate(values):
                text = str(v.value).replace("unit_traction", "unit tractions").replace("residual_modes", "residual modes")
                usual = v.value == DEFAULT[setting]
                crowded = usual or 1.5 * values[k - 1].time > v.time > values[0].time
                above = np.nanmax([v.top[2], v.at[2]])
                ax.annotate(f"{text}, default" if usual else text, (v.time, above), xytext=(0, 4),
                            ha="left" if crowded else "center",
                            textcoords="offset points", fontsize=7.5)  # fmt: skip
            ax.set(xscale="log", xlim=(0.15, 80.0))
            ax.set_xticks([0.3, 1.0, 3.0, 10.0, 30.0], minor=False)
            ax.set_xticks([], minor=True)
            ax.xaxis.set_major_formatter("{x:g}")
            ax.set_title(f"{NAMES[setting].capitalize()} ({values[0].scenes} scenes)", fontsize=9.0)
        axes[0].set(yscale="log", ylim=(1.0, 130.0))
        axes[0].set_yticks([1, 2, 5, 10, 20, 50, 100], minor=False)
        axes[0].set_yticks([], minor=True)
        axes[0].yaxis.set_major_formatter("{x:g}")
        figure.suptitle("Error and time of settings, changed one at a time", fontsize=9.0)
        figure.supylabel("Difference from the highest amplitude\nthat stays in a march in time (%)", fontsize=9.0)
        figure.supxlabel("Time of a tracking curve over that with the default settings", fontsize=9.0)
        axes[0].legend(loc="lower right", title="median, quartiles of scenes", title_fontsize=7.5, fontsize=7.5)
        save_figure(figure, IMAGE)


def show(known: dict[str, Any]) -> None:
    """The table of docs/accuracy.md."""
    print("| setting | value | time of a curve | error of the top (%) | at the frequency of what is kept (%) | scenes |")
    print("|---|---|---|---|---|---|")
    for setting, values in rows(known).items():
        for v in values:
            cells = [f"{e[1]:.2g} ({e[0]:.2g} to {e[2]:.2g})" if np.isfinite(e[1]) else "" for e in (v.top, v.at)]
            value = str(v.value).replace("_", " ") + (", default" if v.value == DEFAULT[setting] else "")
            print(f"| {NAMES[setting]} | {value} | {v.time:.2g} | {' | '.join(cells)} | {v.scenes} |")
    for setting, change in structures(known).items():
        if len(change):
            spread = f"{np.median(change):+.2g} % ({change.min():+.2g} to {change.max():+.2g})"
            print(f"\nWhat is kept with {JUDGES[setting]} {NAMES[setting]}: {spread}, {len(change)} scenes.")
    print("\n| scene | kept | harmonics 1 | 3 | 5 | 9 | kept with 24 patterns | 40 modes | 24 points |")
    print("|---" * 9 + "|")
    for name in map(name_of, SCENES):
        if f"{name}/kept" in known:
            get = lambda key: known.get(f"{name}/{key}", {}).get("mean", np.nan)  # noqa: B023, E731
            tops = [known.get(f"{name}/harmonics {h}", {}).get("top", np.nan) for h in ROWS["harmonics"]]
            judges = [get(f"kept, {setting} {value}") for setting, value in JUDGES.items()]
            print(f"| {name} | " + " | ".join(f"{x:.1f}" for x in (get("kept"), *tops, *judges)) + " |")


def main() -> None:
    """Compute what is missing of six scenes, or of as many as are asked for, and show it."""
    asked = sys.argv[1:]
    if not asked or asked[0].isdigit():
        compute(int(asked[0]) if asked else 6)
    known = json.loads(RESULTS.read_text())
    show(known)
    draw(known)


if __name__ == "__main__":
    main()
