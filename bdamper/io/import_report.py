"""Report of an import: what was read, made and checked, as one page of text and a picture."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from bdamper.model.model import Interface, ModalBasis, Model
from bdamper.util.plotting import Plottable
from bdamper.util.repr import brief


def frequencies_of(basis: ModalBasis) -> NDArray:
    """Frequencies (n_modes,) of the modes of a body, Hz."""
    return np.sqrt(basis.omega2[: basis.n_natural]) / (2.0 * np.pi)


@brief
@dataclass(frozen=True)
class FaceSummary:
    """Figures of one interface of an imported model.

    Parameters
    ----------
    interface : Interface
    area_a, area_b : float or None, m2
        Of the faces given on either side.
    distance : (2,) float, m
        Smallest and largest mean normal distance of the two meshes at the points.
    """

    interface: Interface
    area_a: float
    area_b: float | None
    distance: NDArray


@brief
@dataclass(frozen=True)
class ImportReport(Plottable):
    """The report of :func:`bdamper.io.build_model`.

    ``plot`` draws the bodies with faces and points (:func:`bdamper.plot.plot_import_report`).

    Parameters
    ----------
    sources : mapping of body to str
        Files and numbers of nodes, elements and equations.
    faces : tuple of FaceSummary
    checks : tuple of str
        Checks made and passed, with figures.
    missing : tuple of str
        Quantities that the model does not have, and what to do about it.
    model : Model
    failed : tuple of str
        Comparisons with another program that failed.
    """

    sources: dict[str, str]
    faces: tuple[FaceSummary, ...]
    checks: tuple[str, ...]
    missing: tuple[str, ...]
    model: Model = field(repr=False)
    failed: tuple[str, ...] = ()

    @property
    def frequencies(self) -> dict[int, NDArray]:
        """Frequencies (n_modes,) of the sector, Hz, for each nodal diameter."""
        return {d: frequencies_of(basis) for d, basis in self.model.bodies["blade"].bases.items()}

    def __str__(self) -> str:
        lines = ["Import report", ""]
        if self.failed:
            lines += ["Comparisons that FAILED", *(f"  {text}" for text in self.failed), ""]
        lines.append("Read")
        lines += [f"  {name}: {text}" for name, text in self.sources.items()]
        lines += ["", "Frequencies of the sector, Hz, for each nodal diameter"]
        for d, values in self.frequencies.items():
            shown = "  ".join(f"{f:.6g}" for f in values[:6])
            lines.append(f"  {d:4d}  {shown}{'  ...' if len(values) > 6 else ''}  ({len(values)} modes)")
        for free in self.model.bodies.values():
            if free.centre is None or free.inertia is None:
                continue
            lines += ["", f"Free body {free.name}, recomputed"]
            lines.append(f"  mass {free.mass:.6g} kg, centre ({', '.join(f'{c:.6g}' for c in free.centre)}) m")
            moments = np.linalg.eigvalsh(free.inertia)
            lines.append(f"  principal moments of inertia {', '.join(f'{m:.6g}' for m in moments)} kg m2")
            elastic = frequencies_of(free.bases[0])[6:12]
            if len(elastic):
                lines.append("  elastic modes, Hz: " + "  ".join(f"{f:.6g}" for f in elastic))
        lines += ["", "Interfaces"]
        for f in self.faces:
            own, area = f.interface, float(f.interface.area.sum())
            shares = f"{100 * area / f.area_a:.4g} % of face a"
            if f.area_b is not None:
                shares += f", {100 * area / f.area_b:.4g} % of face b"
            normal = ", ".join(f"{c:.4f}" for c in own.frame[:, 2].mean(axis=0))
            place = f"side b in sector {own.sector_b:+d}"
            lines.append(f"  {own.name}: {own.n_points} points, {area:.6g} m2 ({shares}), {place}")
            apart = f"meshes {f.distance[0]:.2g} to {f.distance[1]:.2g} m apart"
            lines.append(f"    mean outward normal of side a ({normal}), {apart}")
        if self.checks:
            lines += ["", "Checks passed", *(f"  {check}" for check in self.checks)]
        if self.missing:
            lines += ["", "Not in this model", *(f"  {text}" for text in self.missing)]
        return "\n".join(lines)
