"""What stays at the contact points and what goes into residual modes: effect on slip.

    python examples/contact_stiffness_split.py [--points 9] [--figure split.png]

Tracks the first mode of the reference bladed disk at three preloads for several numbers of force patterns and shares of the
point flexibility, and prints peak amplitude, frequency and shares of stick, slip and separation at the peak.  The other
methods of contact stiffness stand beside them.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass

import bdamper as bd

PRELOADS = (1500.0, 4000.0, 10000.0)
CHOICES: tuple[str | bd.ResidualModes, ...] = (
    "unit_traction",
    "eq4",
    bd.ResidualModes(5, 0.5),
    bd.ResidualModes(8, 0.5),
    bd.ResidualModes(12, 0.1),
    bd.ResidualModes(12, 0.5),
    bd.ResidualModes(16, 0.5),
)


@dataclass(frozen=True)
class Row:
    """One peak."""

    method: str
    preload: float
    amplitude: float
    frequency: float
    shares: tuple[float, float, float]
    seconds: float
    status: str


def name_of(choice: str | bd.ResidualModes) -> str:
    """Text for a table."""
    return choice if isinstance(choice, str) else f"{choice.patterns} patterns, share {choice.share:g}"


def split_study(
    points: int = 9,
    preloads: tuple[float, ...] = PRELOADS,
    choices: tuple[str | bd.ResidualModes, ...] = CHOICES,
) -> list[Row]:
    """Peaks for every choice and preload."""
    model = bd.reference_model("bladed_disk", points)
    rows = []
    for choice in choices:
        study = bd.Study(model, bd.Excitation("tip"), 5, contact_stiffness=choice, constraints=False)
        for preload in preloads:
            curve = study.track(preload, (330.0, 375.0))
            i = curve.peak.index
            stick, slip, apart = (float(s) for s in curve.shares[i])
            rows.append(
                Row(
                    name_of(choice),
                    preload,
                    curve.peak.amplitude,
                    curve.peak.frequency,
                    (stick, slip, apart),
                    curve.cost.seconds,
                    curve.status,
                )
            )
    return rows


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--points", type=int, default=9, choices=(9, 24, 48))
    parser.add_argument("--figure", default=None, help="file for a figure of peak amplitude over patterns")
    arguments = parser.parse_args()
    rows = split_study(arguments.points)
    print(f"{'method':<26}{'preload N':>10}{'peak um':>10}{'Hz':>10}{'stick':>8}{'slip':>8}{'open':>8}{'s':>7}")
    for r in rows:
        shares = "".join(f"{s:>8.2f}" for s in r.shares)
        print(
            f"{r.method:<26}{r.preload:>10g}{1e6 * r.amplitude:>10.2f}{r.frequency:>10.3f}{shares}{r.seconds:>7.2f}"
            + ("" if r.status == "complete" else f"  {r.status}")
        )
    if arguments.figure:
        from bdamper.plotting import new_axes, save_figure

        ax = new_axes(6.0, 3.4)
        names = [name_of(c) for c in CHOICES]
        for marker, preload in zip("osD", PRELOADS):
            here = {r.method: r.amplitude for r in rows if r.preload == preload}
            ax.plot(names, [here[n] / here[names[-1]] for n in names], marker, label=f"{preload:g} N")
        ax.set_ylabel("Peak relative to 16 patterns")
        ax.tick_params(axis="x", rotation=30)
        ax.legend()
        save_figure(ax, arguments.figure)


if __name__ == "__main__":
    main()
