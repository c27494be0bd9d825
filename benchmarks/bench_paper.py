"""What each of the paper's approximations is worth, on the disk on which its method finds its numbers.

``python -m benchmarks.bench_paper`` computes what is missing in ``benchmarks/results/paper.json``, with a name only what
begins so, and draws ``docs/images/paper.png``; half an hour of processor time in all, ``--draw`` only the picture.

Optimal curves of both modes with one setting after the other; peaks at fixed preloads with 1 to 9 harmonics; and a slow
sweep in time through the resonance at 300 N, with the nodal diameters of three harmonics: it assumes no Fourier series.
"""

from __future__ import annotations

import argparse
import functools
import json
import time
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np

import bdamper as bd
from bdamper.plot import save_figure
from bdamper.plot.axes import MARKERS, STYLE, colours, fit_units, legend_beside
from bdamper.time_domain.integration import STEPS, AllSectors

RESULTS = Path(__file__).parent / "results" / "paper.json"
PICTURE = Path(__file__).parents[1] / "docs" / "images" / "paper.png"
OWN = {**bd.CIGEROGLU_2009, "fundamental_modes_only": False}
ROWS: dict[str, dict[str, Any]] = {
    "the paper": dict(bd.CIGEROGLU_2009),
    "modes of its own nodal diameter for each harmonic": OWN,
    "uniform tractions": {**bd.CIGEROGLU_2009, "contact_stiffness": "unit_traction"},
    "20 blade modes": {**bd.CIGEROGLU_2009, "blade_modes": 20},
    "40 blade modes": {**bd.CIGEROGLU_2009, "blade_modes": 40},
    "three harmonics": {**OWN, "harmonics": 3},
    "residual modes": {**OWN, "contact_stiffness": "residual_modes"},
    "residual modes, three harmonics": {},
}
DRIVEN = {
    1: ("tangential", 1.0, (245.0, 330.0), (20.0, 10e3), 20),
    2: ("radial", 12.0, (442.0, 490.0), (50.0, 5e3), 15),
}
LADDER = {"equations (4), (10)": OWN, "residual modes": {}}
HARMONICS = (1, 3, 5, 7, 9)
PRELOADS = (135.0, 300.0, 600.0, 2000.0)
SWEEP = (300.0, 301.0, 286.0, 700)
"""Preload (N), first and last frequency (Hz) and periods of the sweep in time."""


def study(mode: int, model: bd.Model | None = None, **settings: Any) -> bd.Study:
    """The disk driven at the trailing-edge corner of the tip."""
    direction, force, *_ = DRIVEN[mode]
    driven = bd.Excitation("tip_trailing_edge", direction=direction, amplitude=force)
    model = model or bd.reference_model("paper_disk")
    return bd.Study(model, driven, engine_order=5, friction_coefficient=0.46, **settings)


def row(mode: int, settings: dict[str, Any]) -> dict[str, Any]:
    """Ratio, shift and optimum of an optimal curve."""
    *_, band, interval, n = DRIVEN[mode]
    curve = study(mode, **settings).optimal_curve(interval, n, frequency=band, check=False)
    o = curve.optimum
    return {
        "ratio": round(curve.ratio, 2), "shift": round(curve.stuck_shift_percent, 2), "preload": round(o.preload, 1),
        "amplitude": float(f"{o.amplitude:.4g}"), "frequency": round(o.frequency, 2),
    }  # fmt: skip


def peak(preload: float, settings: dict[str, Any], rows: int | None = None) -> dict[str, Any]:
    """Highest response of mode 1 over the whole curve, and its folds."""
    curve = study(1, rows and with_rows(rows), **settings).frequency_response(preload, DRIVEN[1][2])
    return {"amplitude": float(f"{curve.peak.amplitude:.4g}"), "frequency": round(curve.peak.frequency, 2),
            "folds": len(curve.folds), "complete": curve.complete}  # fmt: skip


@functools.cache
def with_rows(rows: int) -> bd.Model:
    """The disk with another number of rows of contact points along the slope, six points in each (``bdamper[fe]``)."""
    from bdamper.fem import MeshDensity, SectorFE, bladed_disk
    from bdamper.fem.meshes import paper_geometry

    fe = SectorFE(paper_geometry(), MeshDensity.preset("coarse"))
    return bladed_disk((rows, 6), fe=fe, n_modes=20, harmonics=1, damping_ratio=0.0021)


def sweep(settings: dict[str, Any]) -> dict[str, Any]:
    """Largest |X1| of a slow sweep in time from the high branch down through the resonance."""
    preload, first, last, periods = SWEEP
    asked = study(1, **settings)
    curve = asked.frequency_response(preload, DRIVEN[1][2])
    start = int(np.argmin(np.abs(curve.frequency - first)))
    omega, end = 2.0 * np.pi * curve.frequency[start], 2.0 * np.pi * last
    ring, steps = AllSectors(asked.problem.system(preload), asked.model.n_blades, 5), 2 * STEPS
    settled = ring.integrate(ring.start(curve.unknowns[start], omega, steps), omega, steps, 60)
    found = ring.integrate(settled.motion, omega, steps, periods, omega_end=end)
    amplitude = np.abs(found.harmonics[:, 0, 1])
    k = int(np.argmax(amplitude))
    frequency = np.sqrt(np.linspace(omega**2, end**2, periods + 1))[k] / (2.0 * np.pi)
    return {"amplitude": float(f"{amplitude[k]:.4g}"), "frequency": round(float(frequency), 2)}


def jobs() -> dict[str, Any]:
    """Functions by the name of their result."""
    out: dict[str, Any] = {}
    for mode in DRIVEN:
        for name, settings in ROWS.items():
            out[f"mode {mode}/{name}"] = lambda m=mode, s=settings: row(m, s)
    for name, settings in LADDER.items():
        for harmonics in HARMONICS:
            for preload in PRELOADS:
                key = f"ladder/{name}/{harmonics}/{preload:g}"
                out[key] = lambda p=preload, s={**settings, "harmonics": harmonics}: peak(p, s)
    for name, settings in (
        ("equations (4), (10)", bd.CIGEROGLU_2009),
        ("residual modes", {"harmonics": 1}),
    ):
        for rows in (2, 3, 4, 5):
            for preload in (100.0, 200.0, 1000.0):
                out[f"rows/{name}/{rows}/{preload:g}"] = lambda p=preload, s=settings, r=rows: peak(
                    p, s, r
                )
    out["sweep in time/equations (4), (10)/3"] = lambda: sweep({**OWN, "harmonics": 3})
    return out


def draw(found: dict[str, dict[str, Any]]) -> None:
    """Peaks over the number of harmonics, and the sweep in time."""
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots(1, 2, figsize=(8.6, 3.5), sharey=True)
        swept = found.get("sweep in time/equations (4), (10)/3")
        for ax, name in zip(axes, LADDER):
            for preload, shade, marker in zip(PRELOADS, colours(len(PRELOADS)), MARKERS):
                known = [h for h in HARMONICS if f"ladder/{name}/{h}/{preload:g}" in found]
                values = [found[f"ladder/{name}/{h}/{preload:g}"]["amplitude"] for h in known]
                ax.semilogy(
                    known,
                    values,
                    color=shade,
                    marker=marker,
                    markersize=4.5,
                    label=f"preload {preload:g} N",
                )
                if preload == SWEEP[0] and swept and ax is axes[0]:
                    label = f"slow sweep in time, {preload:g} N"
                    ax.axhline(
                        swept["amplitude"], color=shade, linestyle="-.", linewidth=1.0, label=label
                    )
            ax.set_title(f"Contact stiffness by {name}", fontsize=9.0)
            ax.set(xlabel="Harmonics", xticks=HARMONICS)
        axes[0].set_ylabel("Peak at the tip, first harmonic (m)")
        legend_beside(axes[1], handles=axes[0].get_legend_handles_labels()[0])
        fit_units(axes[0])
    save_figure(figure, PICTURE)


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("name", nargs="?", default="", help="only what begins so, and that again")
    parser.add_argument("--draw", action="store_true", help="only draw what there is")
    arguments = parser.parse_args()
    found = json.loads(RESULTS.read_text()) if RESULTS.exists() else {}
    for name, job in jobs().items():
        if not arguments.draw and (
            name.startswith(arguments.name) if arguments.name else name not in found
        ):
            started = time.process_time()
            found[name] = {**job(), "seconds": round(time.process_time() - started, 1)}
            print(name, found[name], flush=True)
            RESULTS.write_text(json.dumps(found, indent=1) + "\n")
    draw(found)


if __name__ == "__main__":
    main()
