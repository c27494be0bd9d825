"""Convergence of stiffness, static contact, bonded frequency and peak with the number of contact points.

    python examples/contact_point_convergence.py [--mesh faces] [--points 9 24 48 96 192] [--figure points.png]

The finite element model of the bladed disk is reduced for each number of contact points per face.
Two points on one element make the flexibility singular, so the mesh "faces" is fine at the contact
faces and coarse elsewhere; the mesh "coarse" suffices for 24 points.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import bdamper as bd
from bdamper.fem import MeshDensity, SectorFE, bladed_disk
from bdamper.plot import save_figure
from bdamper.plot.axes import MARKERS, colours, drawing

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from tools.bonded import reference_frequencies

# 8 x 14 elements under a contact face, 8 x 12 on the damper, as few as possible elsewhere
FACES = MeshDensity(
    centre=2, contact=8, fillet=1, chord=12, disk=1, shank=1, platform=1, airfoil=3,
    damper_face=8, damper_ridge=1, damper_height=2, damper_length=12,
)  # fmt: skip
SETTINGS: dict[str, Any] = {"blade_modes": 10, "harmonics": 1}


@dataclass(frozen=True)
class Row:
    """Results of one number of contact points.

    ``stiffness`` is the normal stiffness of the left face under unit traction, N/m; ``normal`` (N
    per newton of load) and ``area`` (fraction) are its normal force and contact area in the static
    state. ``bonded`` and ``reduced`` (Hz) are the frequencies of the full and the reduced model
    with bonded contact points. ``peak`` is in m, and ``seconds`` is the total time.
    """

    points: int
    stiffness: float
    normal: float
    area: float
    bonded: float
    reduced: float
    peak: float
    peak_frequency: float
    seconds: float


def convergence(
    points: tuple[int, ...], mesh: str = "coarse", preload: float = 4000.0
) -> Iterator[Row]:
    """Compute one row for each number of points, with the same mesh, factorisations and modes."""
    fe = SectorFE(density=FACES if mesh == "faces" else MeshDensity.preset(mesh))
    for n in points:
        start = time.perf_counter()
        model = bladed_disk(n, n_modes=20, nodal_diameters=(5,), fe=fe)
        study = bd.Study(
            model,
            bd.Excitation("tip"),
            5,
            contact_stiffness="residual_modes",
            constraint_planes=False,
            **SETTINGS,
        )
        unit = bd.Study(
            model,
            bd.Excitation("tip"),
            5,
            contact_stiffness="unit_traction",
            constraint_planes=False,
            **SETTINGS,
        )
        contact = study.static(preload)
        springs = np.concatenate(
            [study.problem.stiffness[name].stiffness for name in study.problem.coupling.interfaces]
        )
        curve = study.frequency_response(preload, (345.0, 375.0))
        face = model.interfaces["left"]
        yield Row(
            points=n,
            stiffness=float(np.sum(unit.problem.stiffness["left"].stiffness[:, 2])),
            normal=contact.normal_force["left"] / preload,
            area=contact.contact_area["left"] / float(face.area.sum()),
            bonded=float(reference_frequencies(fe, 5, n, 1)[0]),
            reduced=float(study.problem.at(0.0).sector.linear.modes(springs)[0][0]) / (2.0 * np.pi),
            peak=curve.peak.amplitude,
            peak_frequency=curve.peak.frequency,
            seconds=time.perf_counter() - start,
        )


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--mesh", default="faces", choices=("coarse", "faces", "reference"))
    parser.add_argument("--points", type=int, nargs="+", default=[9, 24, 48, 96, 192])
    parser.add_argument("--figure", default=None)
    arguments = parser.parse_args()
    heads = (
        ("points", 7),
        ("kn of face N/m", 16),
        ("N/P", 9),
        ("area", 8),
        ("bonded Hz", 12),
        ("reduced Hz", 12),
    )
    print(
        "".join(
            f"{text:>{width}}" for text, width in (*heads, ("peak um", 10), ("Hz", 10), ("s", 7))
        )
    )
    rows = []
    for r in convergence(tuple(arguments.points), arguments.mesh):
        rows.append(r)
        print(
            f"{r.points:>7}{r.stiffness:>16.4g}{r.normal:>9.4f}{r.area:>8.3f}{r.bonded:>12.4f}{r.reduced:>12.4f}"
            f"{1e6 * r.peak:>10.2f}{r.peak_frequency:>10.3f}{r.seconds:>7.1f}",
            flush=True,
        )
    if arguments.figure:
        last, few = rows[-1], rows[0]
        shown = {"area": "contact area", "normal": "normal force", "reduced": "bonded frequency",
                 "stiffness": "normal stiffness", "peak": "peak amplitude"}  # fmt: skip
        title = f"With {few.points} points a face the peak differs by {100.0 * (few.peak / last.peak - 1.0):+.0f} %"
        with drawing(title=title, legend=6.5) as ax:
            for (key, label), colour, marker in zip(shown.items(), colours(len(shown)), MARKERS):
                values = [100.0 * (getattr(r, key) / getattr(last, key) - 1.0) for r in rows]
                ax.plot(
                    [r.points for r in rows],
                    values,
                    marker + "-",
                    color=colour,
                    markersize=5.0,
                    label=label,
                )
            ax.set(
                xscale="log",
                xlabel="Contact points on a face",
                ylabel=f"Difference from {last.points} points (%)",
            )
        save_figure(ax, arguments.figure)


if __name__ == "__main__":
    main()
