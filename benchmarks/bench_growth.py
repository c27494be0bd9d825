"""Growth of processor time with the size of a problem: exponents and their picture.

``python -m benchmarks growth`` measures every growth but that of imports, whose times are those of
``make bench``.  It writes ``benchmarks/results/growth.jsonl``, the table of docs/evidence/times.md
and docs/images/growth.png.  ``python -m benchmarks.bench_growth --draw`` writes table and picture
anew from the stored times.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.patheffects import withStroke
from matplotlib.ticker import FuncFormatter, LogLocator
from numpy.typing import NDArray

import bdamper as bd
from bdamper.plot import save_figure
from bdamper.plot.axes import STYLE
from bdamper.response.peak import Peak
from bdamper.time_domain.integration import STEPS, AllSectors, all_sectors
from benchmarks import bench_works, fill
from benchmarks.bench_core import Case
from benchmarks.measuring import (
    EVIDENCE,
    RESULTS,
    processor_time,
    read_lines,
    write_lines,
)

STORED = RESULTS / "growth.jsonl"
PICTURE = Path(__file__).parents[1] / "docs" / "images" / "growth.png"
FITTED = 3
"""Number of the largest sizes to which an exponent is fitted."""
SHORTEST, ROUNDS = 0.05, 12
"""Least processor time (s) of a measurement, and number of rounds over all sizes, of which the
shortest time counts."""
POINTS, MODES, HARMONICS = 18, 16, 3
"""Contact points, modes and harmonics of the core if they do not grow."""
SETTLING = 2
"""Periods before the measured one, in which the contact patterns settle."""


@dataclass(frozen=True)
class Growth:
    """Processor time over one size.

    Parameters
    ----------
    over, work : str
        Names of the size and of the measured work.
    sizes : tuple of int
        In increasing order.
    expected : (2,) float
        Lowest and highest expected exponent.
    reason : str
        Why these exponents are expected.
    """

    over: str
    work: str
    sizes: tuple[int, ...]
    expected: tuple[float, float]
    reason: str


# ---- One Newton iteration of the core ----


def operations(points: int, modes: int, harmonics: int) -> float:
    """Return the work of one Newton iteration by the weights of :class:`bdamper.Cost`."""
    n = modes * (2 * harmonics + 1)
    evaluation = 28_000 * points * (2 * harmonics + 1)
    jacobian = 6 * points * n**2
    factorisation = n**3 + 700 * n**2 + 1_000_000
    return float(evaluation + jacobian + factorisation)


def sizes_of_core(over: str, size: int) -> tuple[int, int, int]:
    """Return contact points, modes and harmonics, of which one grows."""
    sizes = {"contact points": POINTS, "modes": MODES, "harmonics": HARMONICS} | {over: size}
    return sizes["contact points"], sizes["modes"], sizes["harmonics"]


def newton_iteration(over: str, size: int) -> Callable[[], object]:
    """Return the calculation of residual, Jacobian, factorisation and solution."""
    case = Case(*sizes_of_core(over, size))
    system = case.system()
    point = np.append(case.u, 0.7)
    border, scale = np.ones(case.n + 1), np.ones(case.n + 1)
    right = np.ones((1, case.n + 1))

    def run() -> None:
        status = system.bordered(point, border, scale, right.copy(), False)[0]
        assert status == 0

    return run


def core_growth(over: str, sizes: tuple[int, ...], limit: float, reason: str) -> Growth:
    """Return a growth of a Newton iteration, with the exponent of its operations at these sizes."""
    counted = [operations(*sizes_of_core(over, size)) for size in sizes]
    at_these_sizes = exponent(sizes, counted)
    return Growth(over, "Newton iteration", sizes, (at_these_sizes, limit), reason)


# ---- Time integration ----


@cache
def start() -> tuple[bd.Study, Peak]:
    """Return the turbine blade at engine order 20, and its peak."""
    tip = bd.Excitation("tip", direction="tangential", amplitude=1.0)
    study = bd.Study(bd.reference_model("turbine_blade"), tip, 20)
    return study, study.peak(bench_works.BLADE_PRELOAD, progress=False)


def integration(blades: int, steps: int) -> Callable[[], object]:
    """Return the integration of all blades over a period."""
    study, peak = start()
    omega = float(peak.y[-1])
    ring: AllSectors = all_sectors(study.problem, bench_works.BLADE_PRELOAD, blades)
    motion = ring.start(peak.y[:-1], omega, steps)
    settled = ring.integrate(motion, omega, steps, SETTLING).motion
    return lambda: ring.integrate(settled, omega, steps)


# ---- Exponents ----


def exponent(sizes: Sequence[float], seconds: Sequence[float]) -> float:
    """Return the exponent of a power law fitted to the largest sizes."""
    x, y = np.log(sizes[-FITTED:]), np.log(seconds[-FITTED:])
    return float(np.polyfit(x, y, 1)[0])


GROWTHS = (
    core_growth("harmonics", (2, 4, 8, 16, 32), 3.0, "LU factorisation of order modes × (2H + 1)"),
    core_growth(
        "contact points", (12, 24, 48, 96, 192, 384), 1.0, "forces and Jacobian, a sum over points"
    ),
    core_growth(
        "modes",
        (8, 16, 32, 64, 128),
        3.0,
        "LU factorisation, condensed to the contact points if their motion has less than half the unknowns",
    ),
    Growth(
        "time steps",
        "period in time",
        (256, 512, 1024, 2048, 4096, 8192),
        (1.0, 1.0),
        "equal work in each step; fewer than 2,048 steps need more iterations each",
    ),
    Growth(
        "blades",
        "period in time",
        (3, 6, 12),
        (1.0, 2.0),
        "contact forces of each blade; the sum over blades and nodal diameters is quadratic",
    ),
)
IMPORTS = Growth(
    "equations",
    "import",
    (),
    (4.0 / 3.0, 2.0),
    "sparse factors of a solid: solutions with exponent 4/3, factorisation with exponent 2",
)


# ---- Measurement ----


def work_of(over: str, size: int) -> Callable[[], object]:
    """Return the work at one size, prepared."""
    if over == "time steps":
        return integration(3, size)
    if over == "blades":
        return integration(size, STEPS)
    return newton_iteration(over, size)


def seconds_each(work: Callable[[], object]) -> float:
    """Return the processor time (s) of work, which is repeated until it takes long enough."""
    times = int(np.ceil(SHORTEST / max(processor_time(work), 1e-6)))

    def repeated() -> None:
        for _ in range(times):
            work()

    return processor_time(repeated) / times


def measure() -> list[dict[str, Any]]:
    """Measure all growths in rounds, because other work of the machine changes slowly."""
    works = [[work_of(growth.over, size) for size in growth.sizes] for growth in GROWTHS]
    shortest = [[np.inf] * len(growth.sizes) for growth in GROWTHS]
    for _ in range(ROUNDS):
        for row, growth_works in zip(shortest, works):
            for i, work in enumerate(growth_works):
                row[i] = min(row[i], seconds_each(work))
    return [
        {"over": growth.over, "sizes": growth.sizes, "seconds": [float(f"{t:.4g}") for t in row]}
        for growth, row in zip(GROWTHS, shortest)
    ]


# ---- Table and picture ----


@dataclass(frozen=True)
class Measured:
    """Growth with its processor times (s)."""

    growth: Growth
    sizes: tuple[int, ...]
    seconds: tuple[float, ...]

    @property
    def exponent(self) -> float:
        """Fitted exponent."""
        return exponent(self.sizes, self.seconds)

    @property
    def expected(self) -> str:
        """Range of the expected exponent in words."""
        low, high = (f"{value:.2g}" for value in self.growth.expected)
        return low if low == high else f"{low} to {high}"


def stored_growths() -> list[Measured]:
    """Return all growths with their stored times."""
    by_name = {record["over"]: record for record in read_lines(STORED)}
    growths = [
        Measured(growth, growth.sizes, tuple(by_name[growth.over]["seconds"])) for growth in GROWTHS
    ]
    _, *works = read_lines(bench_works.STORED)
    imports = sorted(
        (record["counts"]["equations"], record["processor"])
        for record in works
        if "equations" in record["counts"]
    )
    sizes, seconds = zip(*imports)
    return [*growths, Measured(IMPORTS, sizes, seconds)]


def table(growths: Sequence[Measured]) -> str:
    """Return the table of exponents in Markdown."""
    lines = [
        "| over | work | sizes | processor time | exponent | expected | reason |",
        "|---" * 7 + "|",
    ]
    for measured in growths:
        growth = measured.growth
        low, high = measured.seconds[0], measured.seconds[-1]
        cells = (
            growth.over,
            growth.work,
            f"{measured.sizes[0]:,} to {measured.sizes[-1]:,}",
            f"{in_words(low)} to {in_words(high)}",
            f"{measured.exponent:.2f}",
            measured.expected,
            growth.reason,
        )
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def in_words(seconds: float) -> str:
    """Return a time with its unit."""
    return f"{seconds:.3g} s" if seconds >= 1.0 else f"{1e3 * seconds:.3g} ms"


def power_law(sizes: NDArray, power: float, through: tuple[float, float]) -> NDArray:
    """Return the times of a power law through one point."""
    size, seconds = through
    return seconds * (sizes / size) ** power


def draw(growths: Sequence[Measured]) -> None:
    """Draw processor times over sizes, with fitted and expected exponents."""
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots(2, 3, figsize=(7.2, 4.4), constrained_layout=True)
        for ax, measured in zip(axes.flat, growths):
            draw_one(ax, measured)
        for ax in axes[:, 0]:
            ax.set_ylabel("Processor time")
        handles, labels = axes[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=len(labels))
        save_figure(figure, PICTURE)


def draw_one(ax: Any, measured: Measured) -> None:
    """Draw one growth."""
    sizes, seconds = np.array(measured.sizes, float), np.array(measured.seconds)
    fitted = sizes[-FITTED:]
    # a fit in logarithms passes through the geometric means
    centre = float(np.exp(np.log(fitted).mean())), float(np.exp(np.log(seconds[-FITTED:]).mean()))
    low, high = (power_law(fitted, power, centre) for power in measured.growth.expected)
    ax.fill_between(
        fitted, low, high, color="0.85", linewidth=0.0, label="between expected exponents"
    )
    for edge in (low, high):
        ax.plot(fitted, edge, color="0.6", linewidth=0.8)
    fit = power_law(fitted, measured.exponent, centre)
    ax.plot(fitted, fit, color="k", linewidth=1.2, label=f"fitted to the {FITTED} largest sizes")
    ax.plot(sizes, seconds, "o", color="C0", markersize=4.0, label="measured")
    ax.set(xscale="log", yscale="log", xlabel=measured.growth.over.capitalize())
    ax.set_xticks(sizes, [f"{size:,}" for size in measured.sizes], fontsize=6.5)
    ax.yaxis.set_major_locator(LogLocator(subs=(1.0, 3.0)))
    ax.yaxis.set_major_formatter(FuncFormatter(lambda seconds, _: in_words(seconds)))
    ax.minorticks_off()
    words = f"exponent {measured.exponent:.2f}\nexpected {measured.expected}"
    edge = [withStroke(linewidth=1.5, foreground="w")]
    ax.text(0.04, 0.96, words, transform=ax.transAxes, va="top", fontsize=7.0, path_effects=edge)
    work = measured.growth.work
    ax.set_title(work[0].upper() + work[1:], fontsize=8.0)


# ---- Command line ----


def write() -> None:
    """Write table and picture from the stored times."""
    growths = stored_growths()
    text = table(growths)
    print(text)
    EVIDENCE.write_text(fill(EVIDENCE.read_text(), "growth", text))
    draw(growths)


def main() -> None:
    """Measure what is asked, and write table and picture."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.bench_growth", description=__doc__)
    parser.add_argument("--draw", action="store_true", help="only from the stored times")
    if not parser.parse_args().draw:
        write_lines(STORED, measure())
    write()


if __name__ == "__main__":
    main()
