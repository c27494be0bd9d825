"""Report of an import: what was read, made and checked, as one page of text and a picture."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from bdamper.model.model import Model
from bdamper.util.plotting import Plottable
from bdamper.util.repr import brief


@brief
@dataclass(frozen=True)
class FaceSummary:
    """Figures of one interface of an imported model.

    Parameters
    ----------
    interface : str
    n_points : int
    area : float, m2
    area_a, area_b : float or None, m2
        Of the faces given on either side.
    distance : (2,) float, m
        Smallest and largest mean normal distance of the two meshes at the points.
    sector_b : int
    normal : (3,) float
    """

    interface: str
    n_points: int
    area: float
    area_a: float
    area_b: float | None
    distance: NDArray
    sector_b: int
    normal: NDArray


@brief
@dataclass(frozen=True)
class ImportReport(Plottable):
    """The report of :func:`bdamper.io.build_model`.

    ``plot`` draws frequencies over nodal diameter, and the bodies with faces and points
    (:func:`bdamper.plot.plot_import_report`).

    Parameters
    ----------
    sources : mapping of body to str
        Files and numbers of nodes, elements and equations.
    frequencies : mapping of nodal diameter to (n,) float, Hz
        Lowest frequencies of the sector.
    damper_frequencies : (n,) float, Hz
        Elastic modes of the free body.
    faces : tuple of FaceSummary
    mass, centre, inertia : of the free body, recomputed; None without one
    checks : tuple of str
        Checks made and passed, with figures.
    missing : tuple of str
        Quantities that the model does not have, and what to do about it.
    """

    sources: dict[str, str]
    frequencies: dict[int, NDArray]
    damper_frequencies: NDArray
    faces: tuple[FaceSummary, ...]
    mass: float | None
    centre: NDArray | None
    inertia: NDArray | None
    checks: tuple[str, ...]
    missing: tuple[str, ...]
    model: Model = field(repr=False)

    def __str__(self) -> str:
        lines = ["Import report", "", "Read"]
        lines += [f"  {name}: {text}" for name, text in self.sources.items()]
        lines += ["", "Frequencies of the sector, Hz, for each nodal diameter"]
        for d, values in self.frequencies.items():
            shown = "  ".join(f"{f:.6g}" for f in values[:6])
            lines.append(f"  {d:4d}  {shown}{'  ...' if len(values) > 6 else ''}  ({len(values)} modes)")
        if self.mass is not None and self.centre is not None and self.inertia is not None:
            lines += ["", "Free body, recomputed"]
            lines.append(f"  mass {self.mass:.6g} kg, centre ({', '.join(f'{c:.6g}' for c in self.centre)}) m")
            moments = np.linalg.eigvalsh(self.inertia)
            lines.append(f"  principal moments of inertia {', '.join(f'{m:.6g}' for m in moments)} kg m2")
            if len(self.damper_frequencies):
                lines.append("  elastic modes, Hz: " + "  ".join(f"{f:.6g}" for f in self.damper_frequencies[:6]))
        lines += ["", "Interfaces"]
        for f in self.faces:
            shares = f"{100 * f.area / f.area_a:.4g} % of face a"
            if f.area_b is not None:
                shares += f", {100 * f.area / f.area_b:.4g} % of face b"
            normal = ", ".join(f"{c:.4f}" for c in f.normal)
            place = f"side b in sector {f.sector_b:+d}"
            lines.append(f"  {f.interface}: {f.n_points} points, {f.area:.6g} m2 ({shares}), {place}")
            lines.append(
                f"    mean outward normal of side a ({normal}), meshes {f.distance[0]:.2g} to {f.distance[1]:.2g} m apart"
            )
        if self.checks:
            lines += ["", "Checks passed", *(f"  {check}" for check in self.checks)]
        if self.missing:
            lines += ["", "Not in this model", *(f"  {text}" for text in self.missing)]
        return "\n".join(lines)
