"""What an import returns: a model, and what was read, made and checked, as one page of text and a picture."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from bdamper.model.model_file import save_model
from bdamper.model.structure import ModalBasis, Model
from bdamper.util.display import Plottable
from bdamper.util.short_repr import brief
from bdamper.util.storage import FilePath


def frequencies_of(basis: ModalBasis) -> NDArray:
    """Frequencies (n_modes,) of the modes of a body, Hz."""
    return np.sqrt(basis.omega2[: basis.n_natural]) / (2.0 * np.pi)


@brief
@dataclass(frozen=True)
class BuiltModel(Plottable):
    """A model and the report on how it came about, which it prints.

    ``plot`` draws the bodies with faces and points (:func:`bdamper.plot.plot_import_report`).

    Parameters
    ----------
    model : Model
    sources : mapping of body to str
        Files and numbers of nodes, elements and equations.
    faces : tuple of str
        Figures of each interface.
    checks : tuple of str
        Checks made and passed, with figures.
    missing : tuple of str
        Quantities that the model does not have, and what to do about it.
    failed : tuple of str
        Comparisons with another program that failed.
    """

    model: Model
    sources: Mapping[str, str] = field(default_factory=dict)
    faces: tuple[str, ...] = ()
    checks: tuple[str, ...] = ()
    missing: tuple[str, ...] = ()
    failed: tuple[str, ...] = ()

    @property
    def frequencies(self) -> dict[int, NDArray]:
        """Frequencies (n_modes,) of the sector, Hz, for each nodal diameter."""
        return {d: frequencies_of(basis) for d, basis in self.model.bodies["blade"].bases.items()}

    def save(self, path: FilePath) -> None:
        """Write the model file; the report goes into its provenance."""
        save_model(self.model, path)

    def __str__(self) -> str:
        frequencies = []
        for d, values in self.frequencies.items():
            shown = "  ".join(f"{f:.6g}" for f in values[:6])
            frequencies.append(f"{d:4d}  {shown}{'  ...' if len(values) > 6 else ''}  ({len(values)} modes)")
        parts: dict[str, list[str]] = {
            "Comparisons that FAILED": [*self.failed],
            "Read": [f"{name}: {text}" for name, text in self.sources.items()],
            "Frequencies of the sector, Hz, for each nodal diameter": frequencies,
        }
        for free in self.model.bodies.values():
            if free.centre is None or free.inertia is None:
                continue
            moments = np.linalg.eigvalsh(free.inertia)
            parts[f"Free body {free.name}, recomputed"] = own = [
                f"mass {free.mass:.6g} kg, centre ({', '.join(f'{c:.6g}' for c in free.centre)}) m",
                f"principal moments of inertia {', '.join(f'{m:.6g}' for m in moments)} kg m2",
            ]
            if len(elastic := frequencies_of(free.bases[0])[6:12]):
                own.append("elastic modes, Hz: " + "  ".join(f"{f:.6g}" for f in elastic))
        parts |= {"Interfaces": [*self.faces], "Checks passed": [*self.checks], "Not in this model": [*self.missing]}
        lines = ["Import report"]
        for title, texts in parts.items():
            if texts:
                lines += ["", title, *(f"  {text}" for text in texts)]
        return "\n".join(lines)
