"""Flexibility at the contact points and in residual modes: effect on slip.

    python examples/contact_stiffness_split.py [--points 9] [--figure split.png]
    python examples/contact_stiffness_split.py --microslip [--points 24] [--figure microslip.png]

The script computes the resonance of the first mode of the reference bladed disk at three preloads,
for several numbers of force vectors and fractions of the point flexibility. It prints peak
amplitude, frequency, and fractions of stick, slip and separation at the peak, together with the
results of the other methods for the contact stiffness. With ``--microslip``, it computes the static
force along the damper axis against displacement at 1000 N, for first loading up to sliding.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from typing import Any

import numpy as np

import bdamper as bd
from bdamper.analyses.hysteresis import microslip
from bdamper.analyses.sweep import SweepResult
from bdamper.plot import save_figure
from bdamper.plot.axes import STYLES, colours, drawing
from bdamper.util.formatting import amount

PRELOADS = (1500.0, 4000.0, 10000.0)


def bonded(n_vectors: int, share: float) -> bd.ResidualModes:
    """Return residual modes with the force vectors of bonded faces only, because stiff combinations
    fade out in partial contact.
    """
    return bd.ResidualModes(n_vectors, share, partial_contact=False)


CHOICES: tuple[str | bd.ResidualModes, ...] = (
    "unit_traction",
    "cigeroglu2009",
    bonded(5, 0.5),
    bonded(8, 0.5),
    bonded(12, 0.1),
    bonded(12, 0.5),
    bonded(16, 0.5),
)
SETTINGS: dict[str, Any] = {"blade_modes": 10, "harmonics": 1}
MICROSLIP_PRELOAD = 1000.0
MICROSLIP_FORCES = np.concatenate([np.arange(15.0, 271.0, 15.0), np.arange(275.0, 311.0, 5.0)])
MICROSLIP_CHOICES: tuple[str | bd.ResidualModes, ...] = (
    "unit_traction",
    "cigeroglu2009",
    bonded(5, 0.5),
    bonded(8, 0.5),
    bonded(12, 0.02),
    bonded(12, 0.1),
    bonded(12, 0.5),
    bd.ResidualModes("all"),
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
    """Return the name of a choice in a table."""
    if isinstance(choice, str):
        return {"unit_traction": "unit tractions", "cigeroglu2009": "equation (4)"}[choice]
    return f"{choice.n_vectors} vectors, share {choice.contact_share:g}"


def split_study(
    points: int = 9,
    preloads: tuple[float, ...] = PRELOADS,
    choices: tuple[str | bd.ResidualModes, ...] = CHOICES,
) -> list[Row]:
    """Compute the peaks for every choice and preload."""
    model = bd.reference_model("bladed_disk", points)
    rows = []
    for choice in choices:
        study = bd.Study(
            model,
            bd.Excitation("tip"),
            5,
            contact_stiffness=choice,
            constraint_planes=False,
            **SETTINGS,
        )
        for preload in preloads:
            curve = study.frequency_response(preload, (330.0, 375.0))
            i = curve.peak_index
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


def microslip_study(
    points: int = 24, choices: tuple[str | bd.ResidualModes, ...] = MICROSLIP_CHOICES
) -> dict[str, SweepResult]:
    """Compute the first loading along the axis for every choice; "all" force vectors represent the
    complete flexibility.
    """
    model = bd.reference_model("bladed_disk", points)
    curves = {}
    for choice in choices:
        study = bd.Study(
            model,
            bd.Excitation("tip"),
            5,
            contact_stiffness=choice,
            constraint_planes=False,
            **SETTINGS,
        )
        curves[name_of(choice)] = microslip(study, MICROSLIP_PRELOAD, MICROSLIP_FORCES)
    return curves


def loading(found: SweepResult) -> tuple[np.ndarray, np.ndarray]:
    """Return the forces (N) up to the force at which the damper slides, and the displacement (m)
    under each.
    """
    displacement = found.array("displacement")
    known = np.isfinite(displacement)
    return np.array([point["force"] for point in found.points])[known], displacement[known]


def print_microslip(points: int, figure: str | None) -> None:
    """Print a table of the curves: three secant stiffnesses, displacement at three forces, and
    largest force.
    """
    curves = microslip_study(points)
    last = MICROSLIP_FORCES[-1]
    at = (150.0, 270.0, 300.0)
    heads = "".join(f"{f'um at {q:g} N':>13}" for q in at)
    print(f"{'method':<26}{heads}{'N/um: first':>13}{'at 270':>9}{'last N':>9}")
    for name, c in curves.items():
        force, displacement = loading(c)
        u = [np.interp(q, force, 1e6 * displacement, right=np.nan) for q in at]
        slope = 1e-6 * np.diff(force) / np.diff(displacement)
        late = slope[np.flatnonzero(force[1:] >= 270.0)[0]]
        print(
            f"{name:<26}" + "".join(f"{v:>13.4f}" for v in u) + f"{slope[0]:>13.2f}{late:>9.2f}"
            + (f"{force[-1]:>9g}" if c.complete else f"{force[-1]:>9g}  slides below {last:g} N")
        )  # fmt: skip
    if figure:
        title = f"Damper seated with {MICROSLIP_PRELOAD:g} N, pushed along its axis until it slides"
        with drawing(title=title, legend=6.5) as ax:
            for k, ((name, c), colour) in enumerate(zip(curves.items(), colours(len(curves)))):
                whole = name == list(curves)[-1]
                look = {"color": colour, "label": name}
                if whole:
                    look = {
                        "color": "k",
                        "label": "whole flexibility",
                        "linewidth": 2.5,
                        "zorder": 1,
                    }
                force, displacement = loading(c)
                stiffness = np.diff(force) / np.diff(displacement)
                ax.plot(force[1:], stiffness, linestyle=STYLES[k % 6 * (not whole)], **look)
            ax.set(xlabel="Force along the axis (N)", ylabel="Stiffness along the axis (N/m)")
        save_figure(ax, figure)


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--points", type=int, default=9, choices=(9, 24, 48))
    parser.add_argument(
        "--figure", default=None, help="file for a figure of peak amplitude over patterns"
    )
    parser.add_argument("--microslip", action="store_true", help="first loading instead of peaks")
    arguments = parser.parse_args()
    if arguments.microslip:
        print_microslip(arguments.points, arguments.figure)
        return
    rows = split_study(arguments.points)
    print(
        f"{'method':<26}{'preload N':>10}{'peak um':>10}{'Hz':>10}{'stick':>8}{'slip':>8}{'open':>8}{'s':>7}"
    )
    for r in rows:
        shares = "".join(f"{s:>8.2f}" for s in r.shares)
        print(
            f"{r.method:<26}{r.preload:>10g}{1e6 * r.amplitude:>10.2f}{r.frequency:>10.3f}{shares}{r.seconds:>7.2f}"
            + ("" if r.status == "complete" else f"  {r.status}")
        )
    if arguments.figure:
        names = [name_of(c) for c in CHOICES]
        with drawing(
            title="Residual modes agree from five patterns on, other stiffnesses do not", legend=6.5
        ) as ax:
            for marker, preload, colour in zip("osD", PRELOADS, colours(len(PRELOADS))):
                here = {r.method: r.amplitude for r in rows if r.preload == preload}
                change = [100.0 * (here[n] / here[names[-1]] - 1.0) for n in names]
                ax.plot(
                    change,
                    names,
                    marker,
                    color=colour,
                    markersize=5.0,
                    label=f"preload {amount(preload, 'N')}",
                )
            ax.axvline(0.0, color="0.6", linewidth=1.0, zorder=0)
            ax.set(
                xlabel="Peak amplitude, difference from 16 patterns (%)", ylabel="Contact stiffness"
            )
            ax.invert_yaxis()
        save_figure(ax, arguments.figure)


if __name__ == "__main__":
    main()
