"""Result of a static analysis: forces, gaps and states of the contact points under a preload."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from bdamper.util.display import InContact, WithChecks
from bdamper.util.formatting import amount, area_text, counted, percent, short_repr
from bdamper.util.progress import Cost
from bdamper.util.records import Data
from bdamper.util.statement import Row, Statement
from bdamper.util.storage import Storable
from bdamper.util.tables import (
    EachRow,
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
"""Part of the area of a face below which it touches at an edge.  Faces of the reference models
touch with 33 to 100 %, those of an imported stage that rotation distorts with 4 to 33 %.
"""
SMALLEST_SLIP = 1e-9
"""Slip relative to the interference below which it is a rounding error."""


@short_repr
@dataclass(frozen=True)
class PreloadState(
    WithChecks, InContact, Tabular, Storable, kind="bdamper-static", row="contact_point"
):
    """Static contact state under a load.

    ``plot`` draws pressure, gap or friction utilisation over the faces
    (:func:`bdamper.plot.plot_static`).

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
        Numbers of load steps and Newton iterations.
    ok : bool
        Whether an equilibrium was found.
    reason : str
        Reason why no equilibrium was found.
    cost : Cost
    interface : tuple of str
        Interface of each contact point; empty if unknown.
    memory : (n_points, width) float, optional
        Latest motion and state of points with compiled laws.
    points : (n_points, 3) float, m, optional
        Positions.  In states from files without them, this and the following are None.
    frame : (n_points, 3, 3) float, optional
        Contact axes as rows.
    area : (n_points,) float, m2, optional
    friction : (n_points,) float, optional
        Friction coefficients.
    on_friction_face : (n_points,) bool, optional
        Whether each point lies on a face with a friction law, unlike axial stops; None in states
        from files without it.
    interference : (n_points,) float, m, optional
        Interference of the surfaces at assembly by which constant loads and negative gaps press
        them together; negative for gaps, NaN on faces of free bodies and at points without friction.
    """

    load: float
    q: NDArray
    slider: NDArray
    force: Annotated[NDArray, Quantity("N", parts=("t1", "t2", "n"))]
    closing: Metres
    status: Annotated[NDArray, EachRow((2,))]
    residual: float
    steps: int
    iterations: int
    ok: Annotated[bool, Data(file="converged")]
    reason: Annotated[str, Data(file="note")] = ""
    cost: Cost = field(default_factory=Cost)
    interface: Annotated[tuple[str, ...], Quantity()] = ()
    memory: NDArray | None = None
    points: Places | None = None
    frame: Annotated[NDArray, EachRow((3, 3))] | None = None
    area: SquareMetres | None = None
    friction: PerRow | None = None
    on_friction_face: PerRow | None = None
    interference: Annotated[Metres | None, Data(derived=True)] = None
    _summary_fields = ("contact_area",)

    @property
    def state(self) -> Kinds:
        """State of each point: "stick", "slip" (in at least one direction) or "open"."""
        all_stick = (self.status == STICK).all(axis=1)
        separated = (self.status == OPEN).any(axis=1)
        return tuple(np.select([separated, all_stick], ["open", "stick"], "slip").tolist())

    @property
    def friction_state(self) -> tuple[str, ...]:
        """State of each point on a friction face.

        If there is no such face, or if it is unknown, these are the states of all points.
        """
        if self.on_friction_face is None or not self.on_friction_face.any():
            return self.state
        return tuple(np.array(self.state)[self.on_friction_face].tolist())

    def _statement(self) -> Statement:
        states = self.friction_state
        counts = [states.count(name) for name in ("stick", "slip", "open")]
        points = counted(len(states), f"{self._kind_of_points} point")
        # as verbs of one and of several points
        verbs = {"sticks": "stick", "slips": "slip", "is open": "are open"}
        of_all = [verb for verb, count in zip(verbs, counts) if count == len(states)]
        if not self.ok:
            verdict = f"Not converged: {self.reason}"
        elif of_all and len(states) == 1:
            verdict = f"The {self._kind_of_points} point {of_all[0]}"
        elif of_all:
            verdict = f"All {points} {verbs[of_all[0]]}"
        else:
            verdict = f"{counts[1]} of {points} slip"
        named_counts = zip(("stick", "slip", "open"), counts)
        value = ", ".join(f"{name} {count}" for name, count in named_counts)
        rows = [Row(f"{self._kind_of_points.capitalize()} points", value)]
        for i, (name, force) in enumerate(self.normal_force.items()):
            text = f"{name}{self._contact_text(name, force)}{self._made_by(name)}"
            rows.append(Row("" if i else "Normal force", amount(force, "N"), text))
        outcome = "pass" if self.ok else "FAIL"
        checks = [Row("Equilibrium", outcome, f"residual {percent(self.residual)} of the load")]
        distances = [self.point_distance.get(name, np.inf) for name in self._constrained]
        if self.ok and np.isfinite(distances).any():
            outcome = "FAIL" if self.too_far else "pass"
            found = self.too_far or "less than the distance of neighbouring points"
            checks.append(Row("Static slip", outcome, found))
        remarks = [f"Edge contact: {self.edges}"] if self.edges else []
        remarks.append("Not covered: other states that friction allows")
        subject = f"static state under a preload of {amount(self.load, 'N')}"
        return Statement([f"{verdict}: {subject}"], rows, checks, remarks)

    @property
    def _kind_of_points(self) -> str:
        return "contact" if len(self.friction_state) == len(self.status) else "friction"

    def _contact_text(self, name: str, force: float) -> str:
        """Return the area in contact on an interface and the mean pressure there."""
        if force == 0.0:
            return ", no contact"
        area = self.contact_area.get(name, 0.0)
        # contacts of lumped masses have no faces, and areas of one
        has_faces = self.area is not None and np.any(self.area != 1.0)
        if not has_faces or not area > 0.0:
            return ""
        pressure = amount(force / area, "Pa")
        return f", {area_text(area)} in contact, mean pressure {pressure}"

    def _made_by(self, name: str) -> str:
        """Return the interference that presses an interface, and its slip from assembly, or ""."""
        interference = self.largest_interference.get(name)
        if interference is None:
            return ""
        slip = self.static_slip.get(name, 0.0)
        slipped = f"slip of {amount(slip, 'm')}" if slip > 0.0 else "no slip"
        return f"; {amount(interference, 'm')} of interference, {slipped}"

    @property
    def edges(self) -> str:
        """Faces with friction that touch with less than :data:`EDGE` of their area.

        The text gives their mean pressure; it is empty if there are no such faces.
        """
        if not self.ok or self.area is None or self.friction is None:
            return ""
        names = np.array(self.interface)
        texts = []
        for name, area in self.contact_area.items():
            on_face = names == name
            part = area / float(self.area[on_face].sum())
            if 0.0 < part < EDGE and np.any(self.friction[on_face] > 0.0):
                pressure = amount(self.normal_force[name] / area, "Pa")
                texts.append(
                    f"{name!r} touches with {percent(part)} of its area, "
                    f"where the mean pressure is {pressure}"
                )
        return "; ".join(texts)

    @property
    def static_slip(self) -> dict[str, float]:
        """Largest slip (m) of a point on each friction face from assembly to this state.

        It is empty if the faces are unknown.
        """
        if self.on_friction_face is None or self.points is None:
            return {}
        names = np.array(self.interface)
        slip = np.linalg.norm(self.slider, axis=1)
        closed = (self.status != OPEN).all(axis=1)
        rounding = {
            name: SMALLEST_SLIP * interference
            for name, interference in self.largest_interference.items()
        }
        total = {}
        for name in dict.fromkeys(names[np.asarray(self.on_friction_face, bool)].tolist()):
            largest = float(slip[(names == name) & closed].max(initial=0.0))
            total[name] = largest if largest > rounding.get(name, 0.0) else 0.0
        return total

    @property
    def largest_interference(self) -> dict[str, float]:
        """Largest interference (m) of each interface that has one."""
        if self.interference is None:
            return {}
        names = np.array(self.interface)
        largest = {}
        for name in dict.fromkeys(names.tolist()):
            of_face = self.interference[names == name]
            if np.any(of_face > 0.0):
                largest[name] = float(np.nanmax(of_face))
        return largest

    @property
    def _constrained(self) -> tuple[str, ...]:
        """Names of the faces between constrained bodies; empty if they are unknown."""
        if self.interference is None:
            return ()
        names = np.array(self.interface)[np.isfinite(self.interference)]
        return tuple(dict.fromkeys(names.tolist()))

    @property
    def too_far(self) -> str:
        """Faces between constrained bodies that slip beyond the distance of their points, or ""."""
        if not self.ok:
            return ""
        texts = []
        for name in self._constrained:
            slip = self.static_slip.get(name, 0.0)
            distance = self.point_distance.get(name, np.inf)
            if slip > distance:
                texts.append(
                    f"{name!r} slips by {amount(slip, 'm')}, farther than neighbouring points are "
                    f"apart ({amount(distance, 'm')}), so that the faces would leave each other: "
                    "choose a smaller load or interference"
                )
        return "; ".join(texts)

    @property
    def point_distance(self) -> dict[str, float]:
        """Distance (m) of each point to its nearest neighbour, the largest one on each interface.

        It is infinite for a face with one point.
        """
        if self.points is None:
            return {}
        names = np.array(self.interface)
        distances = {}
        for name in dict.fromkeys(names):
            points = self.points[names == name]
            apart = np.linalg.norm(points[:, None] - points, axis=2)
            np.fill_diagonal(apart, np.inf)
            nearest = apart.min(axis=1)
            # lumped masses have all points at one place
            distances[str(name)] = float(nearest.max()) if nearest.max() > 0.0 else np.inf
        return distances

    @property
    def normal_force(self) -> dict[str, float]:
        """Total normal force (N) on each interface, or "in all" if the interfaces are unknown."""
        names = np.array(self.interface or ["in all"] * len(self.force))
        total = {}
        for name in dict.fromkeys(names):
            total[str(name)] = float(self.force[names == name, 2].sum())
        return total

    @property
    def pressure(self) -> Pascals | None:
        """Contact pressure (n_points,), Pa."""
        return None if self.area is None else self.force[:, 2] / self.area

    @property
    def contact_area(self) -> dict[str, float]:
        """Area in contact (m2) on each interface; empty if areas are unknown."""
        if self.area is None:
            return {}
        names = np.array(self.interface)
        closed = (self.status != OPEN).all(axis=1)
        total = {}
        for name in dict.fromkeys(names):
            total[str(name)] = float(self.area[closed & (names == name)].sum())
        return total
