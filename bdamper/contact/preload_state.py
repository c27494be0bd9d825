"""Result of a static analysis: forces, gaps and states of the contact points under a preload."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from bdamper.util.display import InContact
from bdamper.util.formatting import amount, counted, percent, short_repr
from bdamper.util.progress import Cost
from bdamper.util.storage import Storable
from bdamper.util.tables import (
    Kinds,
    Metres,
    Pascals,
    PerRow,
    Places,
    Quantity,
    SquareMetres,
    Tabular,
)

STICK, SLIP_PLUS, SLIP_MINUS, OPEN = range(4)
EDGE = 0.3
"""Part of the area of a face below which it touches at an edge.  Faces of the reference models touch with 33 to 100 %,
those of an imported stage that rotation distorts with 4 to 33 %.
"""


@short_repr
@dataclass(frozen=True)
class PreloadState(InContact, Tabular, Storable, kind="bdamper-static", row="contact_point"):
    """Static contact state under a load.

    ``plot`` draws pressure, gap or friction utilisation over the faces (:func:`bdamper.plot.plot_static`).

    Parameters
    ----------
    load : float, N
    q : (n_modes,) float
        Modal coordinates of the mean position.
    slider : (n_points, 2) float, m
    force : (n_points, 3) float, N
        T1, T2, N.
    closing : (n_points,) float, m
        Penetration of the contact spring if positive, gap if negative, including the initial gap.
    status : (n_points, 2) int
        0 stick, 1 slip +, 2 slip -, 3 separation.
    residual : float
        Largest residual of modal equilibrium, relative to the modal load.
    steps, iterations : int
        Number of load steps and of Newton iterations.
    converged : bool
    note : str
        Reason if not converged.
    cost : Cost
    interface : tuple of str
        Interface of each contact point; empty if unknown.
    memory : (n_points, width) float, optional
        Latest motion and state of points with compiled laws.
    points, frame, area, friction : (n_points, 3) m, (n_points, 3, 3), (n_points,) m2, (n_points,) float, optional
        Positions, contact axes, areas and friction coefficients; None in states from files without them.
    on_friction_face : (n_points,) bool, optional
        Whether each point lies on a face with a friction law, unlike axial stops; None in states from files without it.
    """

    load: float
    q: NDArray
    slider: NDArray
    force: Annotated[NDArray, Quantity("N", parts=("t1", "t2", "n"))]
    closing: Metres
    status: PerRow
    residual: float
    steps: int
    iterations: int
    converged: bool
    note: str = ""
    cost: Cost = field(default_factory=Cost)
    interface: Annotated[tuple[str, ...], Quantity()] = ()
    memory: NDArray | None = None
    points: Places | None = None
    frame: PerRow | None = None
    area: SquareMetres | None = None
    friction: PerRow | None = None
    on_friction_face: NDArray | None = None
    _summary_fields = ("contact_area",)

    @property
    def state(self) -> Kinds:
        """State of each point: "stick", "slip" (in at least one direction) or "open"."""
        stuck, open_ = (self.status == STICK).all(axis=1), (self.status == OPEN).any(axis=1)
        return tuple(np.select([open_, stuck], ["open", "stick"], "slip").tolist())

    @property
    def friction_state(self) -> tuple[str, ...]:
        """State of each point on a friction face; of all points if there is no such face or it is unknown."""
        if self.on_friction_face is None or not self.on_friction_face.any():
            return self.state
        return tuple(np.array(self.state)[self.on_friction_face].tolist())

    def _headline(self) -> str:
        of_friction = self.friction_state
        stuck, slipping, apart = (of_friction.count(name) for name in ("stick", "slip", "open"))
        what = "contact point" if len(of_friction) == len(self.status) else "friction point"
        open_ = "" if self.converged else f" Not converged: {self.note}."
        edges = f" Edge contact: {self.edges}." if self.edges else ""
        forces = [f"{name} {amount(force, 'N')}" for name, force in self.normal_force.items()]
        return (
            f"Under a load of {amount(self.load, 'N')}, of {counted(len(of_friction), what)}: {stuck} in stick, "
            f"{slipping} in slip, {apart} open; normal forces: {', '.join(forces)}.{edges}{open_}"
        )

    @property
    def edges(self) -> str:
        """Faces with friction that touch with less than :data:`EDGE` of their area, and the pressure there; or ""."""
        found, names = [], np.array(self.interface)
        if not self.converged or self.area is None or self.friction is None:
            return ""
        for name, area in self.contact_area.items():
            part = area / float(self.area[names == name].sum())
            if 0.0 < part < EDGE and np.any(self.friction[names == name] > 0.0):
                there = amount(self.normal_force[name] / area, "Pa")
                found.append(
                    f"{name!r} touches with {percent(part)} of its area, where the mean pressure is {there}"
                )
        return "; ".join(found)

    @property
    def normal_force(self) -> dict[str, float]:
        """Total normal force (N) on each interface, or on all together if the interfaces are unknown."""
        names = np.array(self.interface or ["in all"] * len(self.force))
        return {
            str(name): float(self.force[names == name, 2].sum()) for name in dict.fromkeys(names)
        }

    @property
    def pressure(self) -> Pascals | None:
        """Contact pressure (n_points,), Pa."""
        return None if self.area is None else self.force[:, 2] / self.area

    @property
    def contact_area(self) -> dict[str, float]:
        """Area in contact (m2) on each interface; empty if areas are unknown."""
        if self.area is None:
            return {}
        names, closed = np.array(self.interface), (self.status != OPEN).all(axis=1)
        return {
            str(name): float(self.area[closed & (names == name)].sum())
            for name in dict.fromkeys(names)
        }
