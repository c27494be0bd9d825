"""What accuracy costs, judged by what a blade keeps in time: error over processor time for each setting by itself.

``python -m benchmarks cost`` computes what ``results/cost.json`` does not have yet, scene by scene, draws
``docs/images/cost.png`` and prints the table of docs/accuracy.md; ``python -m benchmarks.bench_cost show`` draws and prints
what is known, ``ship`` writes ``bdamper/data/cost.json`` besides, from which optimal curves say what richer settings cost.

One setting at a time is changed about the default.  The judge of a row is the amplitude that ``study.kept`` finds with the
richest structure of that row that is marched (:data:`JUDGES`); those of harmonics and of the default are one.  The error is
that of the highest solution of the balance at the frequency of what is kept, and of the top apart from it.
"""

from __future__ import annotations

import json
import sys
import time
import warnings
from pathlib import Path
from typing import Any

import numpy as np

import bdamper as bd
from bdamper.peaks.optimal import BUDGET
from bdamper.stability.kept import Levels
from bdamper.util.warn import BdamperWarning

HERE = Path(__file__).parent
RESULTS = HERE / "results" / "cost.json"
SHIPPED = HERE.parents[0] / "bdamper" / "data" / "cost.json"
BAND = (285.0, 380.0)
SCENES = (
    (0.4, 5, 1.25), (0.2, 10, 2.0), (0.6, 5, 4.0), (0.4, 10, 0.8), (0.2, 5, 0.65), (0.6, 10, 1.25),
    (0.4, 5, 4.0), (0.2, 10, 0.9), (0.6, 5, 0.8), (0.4, 10, 2.0),
)  # fmt: skip
"""Friction coefficient, engine order of 65 blades (13 sectors both), and preload over that of the least peak."""
PRELOADS = np.geomspace(30.0, 400.0, 12)
"""N, of which the one with the least peak counts as the optimum of a friction coefficient and an engine order."""
ROWS: dict[str, tuple[Any, ...]] = {
    "harmonics": (1, 3, 5, 9), "patterns": (6, 12, 24), "blade_modes": (10, 20, 40), "points": (9, 24, 48),
    "method": ("unit_traction", "residual_modes"),
}  # fmt: skip
"""Values of each setting; all others are those of the default, three harmonics, six patterns, ten modes, nine points."""
DEFAULT = {"harmonics": 3, "patterns": 6, "blade_modes": 10, "points": 9, "method": "residual_modes"}
JUDGES = {"patterns": 24, "blade_modes": 40, "points": 24}
"""The richest value of each setting of the structure that is marched besides the default."""
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
    of.system(preload)
    begin = time.process_time()
    curve = of.track(preload, BAND, options=bd.ContinuationOptions(budget=BUDGET))
    return curve, time.process_time() - begin


def least(friction: float, order: int) -> float:
    """Preload (N) of the least peak with the default settings."""
    of = study(friction, order)
    peaks = [max(curve.amplitude, default=np.inf) for curve in (tracked(of, p)[0] for p in PRELOADS)]
    return float(PRELOADS[int(np.argmin(peaks))])


def judged(friction: float, order: int, preload: float, setting: str, value: Any) -> dict[str, Any]:
    """What a blade keeps."""
    of = study(friction, order, setting, value)
    found = of.kept(tracked(of, preload)[0])
    return {
        "mean": 1e6 * found.mean, "lowest": 1e6 * found.lowest, "highest": 1e6 * found.highest,
        "frequency": found.frequency, "status": found.status, "seconds": round(found.cost.processor, 2),
    }  # fmt: skip


def balanced(friction: float, order: int, preload: float, setting: str, value: Any, at: float) -> dict[str, Any]:
    """Top of the balance, its highest solution at a frequency (Hz), and the time of the curve."""
    curve, seconds = tracked(study(friction, order, setting, value), preload)
    there = Levels(curve).at(at) if len(curve) else []
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
    for setting, value in ((setting, value) for setting, value in JUDGES.items() if later or setting == "patterns"):
        yield f"{name}/kept, {setting} {value}", judged, (*given, setting, value)
    for setting, values in ROWS.items():
        for value in values:
            yield f"{name}/{setting} {value}", balanced, (*given, setting, value, known[f"{name}/kept"]["frequency"])


def name_of(scene: tuple[float, int, float]) -> str:
    """Of a scene in the results."""
    return f"mu {scene[0]}, engine order {scene[1]}, {scene[2]} of the optimum"


def compute(scenes: int) -> None:
    """What is missing of so many scenes; after Ctrl-C the next run goes on."""
    known = json.loads(RESULTS.read_text()) if RESULTS.exists() else {}
    warnings.simplefilter("ignore", BdamperWarning)
    for later in (False, True):
        for scene in SCENES[:scenes]:
            for name, function, arguments in jobs(scene, known, later):
                if name not in known:
                    known[name] = function(*arguments)
                    RESULTS.write_text(json.dumps(known, indent=1) + "\n")
                    print(name, known[name], flush=True)


def main() -> None:
    """Compute what is missing of six scenes, or of as many as are asked for, and show it."""
    compute(int(sys.argv[1]) if sys.argv[1:] else 6)


if __name__ == "__main__":
    main()
