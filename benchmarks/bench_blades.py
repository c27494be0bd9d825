"""Scenes in which blades of a tuned wheel do not vibrate alike, and the amplitudes in time.

``python -m benchmarks blades`` prints, in some ten minutes of the processor:

* the hard disk at a friction coefficient of 0.23, engine order 5 and 78.6 N, integrated downward from 322 to 310 Hz in
  steps of one hertz: amplitudes of all blades at each frequency;
* the answers of ``study.time_response`` on the turbine blade at 0.496, engine order 10 and 38.5 N with rings of six and of
  twelve blades, and at 0.54, engine order 5 and 43.7 N: first lines, answers, waves and energies.

``python -m benchmarks.bench_blades map`` computes amplitudes in time of the turbine blade at five friction coefficients,
four preloads and two engine orders, stores them in ``benchmarks/results/in_time_map.json``, and draws by how much the
highest blade exceeds the peak of the balance (``docs/images/in-time-map.png``).  ``python -m benchmarks.bench_blades draw``
draws the stored values.

``python -m benchmarks.bench_blades wheel`` makes the turbine blade with all its 31 nodal diameters and integrates a ring of
twelve blades and the whole wheel of sixty at engine order 5, in a scene where blades part and in one where they do not.
"""

from __future__ import annotations

import json
import sys
import time
from dataclasses import asdict, dataclass
from math import tau
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.patches import Rectangle

import bdamper as bd
from bdamper.plot import save_figure
from bdamper.plot.axes import STYLE
from bdamper.time_domain.integration import STEPS, all_sectors
from bdamper.time_domain.steady_amplitude import BalanceCurve
from bdamper.time_domain.time_response import of_blades
from bdamper.time_domain.transient import CRITERIA, Transient
from bdamper.util.errors import BdamperError
from benchmarks.measuring import RESULTS

IMAGE = Path(__file__).parents[1] / "docs" / "images" / "in-time-ring.png"
"""Of the ring of twelve blades at engine order 10."""
MAP = IMAGE.with_name("in-time-map.png")
MAP_VALUES = RESULTS / "in_time_map.json"
FRICTION, PRELOADS, ORDERS = (0.2, 0.3, 0.4, 0.5, 0.6), (40.0, 80.0, 160.0, 320.0), (5, 10)
"""Of the map; preloads in N."""
RATIOS, GREYS = (1.0, 2.0), LinearSegmentedColormap.from_list("greys", ["1.0", "0.65"])
"""Ratios between which cells of the map darken, and their colours."""
BLADE = bd.Excitation("tip", "tangential", 1.0)
DOWN = np.arange(322.0, 309.9, -1.0)
"""Hz."""


def turbine(friction: float, order: int) -> bd.Study:
    return bd.Study(
        bd.reference_model("turbine_blade"), BLADE, order, friction_coefficient=friction
    )


def down() -> None:
    """The hard disk downward: all blades at each frequency, from one motion to the next."""
    study = bd.Study(
        bd.reference_model("bladed_disk", 9), bd.Excitation("tip"), 5, friction_coefficient=0.23
    )
    curve = study.frequency_response(78.6, (285.0, 380.0))
    ring, begin = all_sectors(study.problem, 78.6), time.process_time()
    start = ring.start(BalanceCurve(curve).solution(DOWN[0]), tau * DOWN[0], STEPS)
    transient = Transient(ring, tau * DOWN[0], ring.seeded(start, CRITERIA.seed, 0))
    transient.run(120)
    print(
        "| Hz | amplitudes of all blades, \u00b5m (last 40 periods) | waves, \u00b5m | missing energy |\n|---|---|---|---|"
    )
    for before, f in zip((DOWN[0], *DOWN), DOWN):
        moving = Transient(ring, tau * before, transient.motion)
        if f < before:
            moving.sweep(tau * f, CRITERIA.fewest)
        transient = Transient(ring, tau * f, moving.motion)
        transient.run(80)
        said = of_blades(transient, CRITERIA.window)
        blades = ", ".join(f"{1e6 * a:.1f}" for a in said["blades"].mean(axis=0))
        waves = ", ".join(f"{d:.0f}: {1e6 * a:.1f}" for d, a in said["waves"][:3])
        work, *losses = said["energy"]
        print(f"| {f:g} | {blades} | {waves} | {(work - sum(losses)) / work:.2%} |", flush=True)
    print(f"\n{time.process_time() - begin:.0f} s of the processor\n")


def highest(study: bd.Study, preload: float, **ring: int) -> tuple[float, bd.TimeResponse | None]:
    """Peak of the balance (m), and the amplitude in time; None where it is not found."""
    curve = study.frequency_response(preload, (600.0, 720.0))
    try:
        found = study.time_response(curve, **ring)
    except BdamperError:
        return curve.peak.amplitude, None
    return curve.peak.amplitude, found if np.isfinite(found.mean) else None


# ---- Map over friction coefficient and preload ----


@dataclass(frozen=True)
class Cell:
    """Highest blade in time over the peak of harmonic balance, in one scene of the map.

    Parameters
    ----------
    ratio : float or None
        Mean amplitude over the peak; None if no amplitude in time was found.
    low, high : float or None
        Lowest and highest answer over the peak, if the amplitude has not settled.
    blades_differ : bool
        Whether the blades do not vibrate alike.
    """

    ratio: float | None
    low: float | None = None
    high: float | None = None
    blades_differ: bool = False

    @classmethod
    def of(cls, balance: float, found: bd.TimeResponse | None) -> Cell:
        """Return the cell of a peak (m) and an amplitude in time."""
        if found is None:
            return cls(None)
        ratio = found.mean / balance
        if "not settled" in found.reason:
            answers = found.answers.values()
            return cls(ratio, min(answers) / balance, max(answers) / balance)
        return cls(ratio, blades_differ=bool(found.blades_differ))

    @property
    def text(self) -> str:
        """Text in the picture, in one or two lines."""
        if self.ratio is None:
            return "not found"
        if self.low is not None:
            return f"{self.low:.2f} to\n{self.high:.2f}"
        return f"{self.ratio:.2f}" + ("\nblades differ" if self.blades_differ else "")


Map = dict[int, list[list[Cell]]]
"""By engine order: a row of cells for each friction coefficient, a cell for each preload."""


def compute_map() -> Map:
    """Compute all scenes of the map."""
    return {
        order: [
            [Cell.of(*highest(turbine(friction, order), preload)) for preload in PRELOADS]
            for friction in FRICTION
        ]
        for order in ORDERS
    }


def write_map(cells: Map) -> None:
    """Store a map."""
    orders = {
        str(order): [[asdict(cell) for cell in row] for row in rows]
        for order, rows in cells.items()
    }
    stored = {"friction": FRICTION, "preload": PRELOADS, "orders": orders}
    MAP_VALUES.write_text(json.dumps(stored, indent=1) + "\n")


def read_map() -> Map:
    """Return the stored map."""
    stored = json.loads(MAP_VALUES.read_text())
    assert (stored["friction"], stored["preload"]) == (list(FRICTION), list(PRELOADS))
    return {
        int(order): [[Cell(**cell) for cell in row] for row in rows]
        for order, rows in stored["orders"].items()
    }


def table_of_map(cells: Map) -> str:
    """Return the tables of a map in Markdown, one for each engine order."""
    preloads = " | ".join(f"{preload:g} N" for preload in PRELOADS)
    lines = []
    for order, rows in cells.items():
        lines += [f"| engine order {order} | {preloads} |", "|---" * (len(PRELOADS) + 1) + "|"]
        for friction, row in zip(FRICTION, rows):
            texts = " | ".join(cell.text.replace("\n", " ") for cell in row)
            lines.append(f"| mu {friction:g} | {texts} |")
    return "\n".join(lines)


def draw_map(cells: Map) -> None:
    """Draw a map; the darker a scene, the further the highest blade exceeds the peak."""
    with plt.rc_context(STYLE):
        size = {"figsize": (7.2, 3.2), "constrained_layout": True}
        figure, axes = plt.subplots(1, len(cells), sharey=True, **size)
        shades = ScalarMappable(Normalize(*RATIOS, clip=True), GREYS)
        for ax, (order, rows) in zip(axes, cells.items()):
            ax.grid(False)
            for i, row in enumerate(rows):
                for k, cell in enumerate(row):
                    colour = "w" if cell.ratio is None else shades.to_rgba(cell.ratio)
                    place = (k - 0.5, i - 0.5)
                    ax.add_patch(
                        Rectangle(place, 1.0, 1.0, facecolor=colour, edgecolor="k", linewidth=0.5)
                    )
                    ax.text(k, i, cell.text, ha="center", va="center", fontsize=6.5)
            ax.set(
                title=f"Engine order {order}",
                xlabel="Preload (N)",
                xlim=(-0.5, len(PRELOADS) - 0.5),
                ylim=(-0.5, len(FRICTION) - 0.5),
            )
            ax.set_xticks(range(len(PRELOADS)), [f"{preload:g}" for preload in PRELOADS])
            ax.set_yticks(range(len(FRICTION)), [f"{friction:g}" for friction in FRICTION])
        axes[0].set_ylabel("Friction coefficient")
        label = "Highest blade in time / peak of harmonic balance"
        figure.colorbar(shades, ax=axes, label=label, extend="both")
        save_figure(figure, MAP)


def map_from_start() -> None:
    """Compute, store, print and draw the map."""
    write_map(compute_map())
    map_from_file()


def map_from_file() -> None:
    """Print and draw the stored map."""
    cells = read_map()
    print(table_of_map(cells))
    draw_map(cells)


# ---- Whole wheel ----


def wheel() -> None:
    """A ring of twelve blades beside the whole wheel."""
    from bdamper.fem.generated_models import MeshDensity, SectorFE, bladed_disk
    from tools.make_reference_model import NICKEL_ALLOY, TURBINE

    fe = SectorFE(TURBINE, MeshDensity.preset("reference"), NICKEL_ALLOY, keep_factors=False)
    model = bladed_disk(
        9, fe=fe, n_modes=20, n_damper_modes=10, pictures=(5,), nodal_diameters=tuple(range(31))
    )
    for friction, preload in ((0.54, 43.7), (0.3, 103.6)):
        for blades in (12, 60):
            begin = time.process_time()
            study = bd.Study(model, BLADE, 5, friction_coefficient=friction)
            balance, found = highest(study, preload, blades=blades)
            print(f"mu {friction:g}, {preload:g} N, {blades} blades, peak of the balance {1e6 * balance:.1f} \u00b5m, "
                  f"{time.process_time() - begin:.0f} s\n")  # fmt: skip
            if found is not None:
                amplitudes = ", ".join(f"{1e6 * a:.1f}" for a in found.blades.mean(axis=0))
                print(f"{found.summary()}\nblades, \u00b5m: {amplitudes}")
            print(flush=True)


def main() -> None:
    for name, work in {"map": map_from_start, "draw": map_from_file, "wheel": wheel}.items():
        if name in sys.argv[1:]:
            work()
            return
    down()
    for friction, order, preload, blades in (
        (0.496, 10, 38.5, 6),
        (0.496, 10, 38.5, 12),
        (0.54, 5, 43.7, 12),
    ):
        study = turbine(friction, order)
        found = study.time_response(
            study.frequency_response(preload, (600.0, 720.0)), blades=blades
        )
        if (order, blades) == (10, 12):
            save_figure(found.plot(), IMAGE)
        print(
            f"mu {friction:g}, engine order {order}, {preload:g} N, {blades} blades\n\n{found.summary()}\n"
        )
        print(
            "blades, \u00b5m: "
            + ", ".join(f"{1e6 * a:.1f}" for a in found.blades.mean(axis=0))
            + "\n",
            flush=True,
        )


if __name__ == "__main__":
    main()
