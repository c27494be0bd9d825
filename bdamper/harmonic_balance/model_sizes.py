"""Characteristic sizes of a model, such as extent and stiffness, as reference for plausible ranges of settings."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bdamper.model.kinematics import centrifugal_arms
from bdamper.model.structure import Interface
from bdamper.util.errors import ModelError, warn_implausible


@dataclass(frozen=True)
class Sizes:
    """Characteristic sizes of a model under its settings, as reference for plausible ranges.

    Parameters
    ----------
    problem : Problem
    told : set of str
        Subjects of warnings that are given once.
    """

    problem: Any
    told: set[str] = field(default_factory=set)

    @property
    def lumped(self) -> bool:
        """Whether the model consists of point masses, without an extent."""
        return any(body.kind == "lumped" for body in self.problem.model.bodies.values())

    @property
    def size(self) -> float:
        """Largest extent of contact points and locations along an axis, m; infinite for a lumped model."""
        model = self.problem.model
        places = [face.points for face in model.interfaces.values()]
        places += [place.position[None] for place in model.locations.values()]
        extent = float(np.ptp(np.concatenate(places), axis=0).max())
        return np.inf if self.lumped or extent == 0.0 else extent

    @property
    def least_order(self) -> float:
        """Smallest plausible engine order: 1 for a bladed disk, 0 for a structure without sectors."""
        return float(self.problem.model.n_blades > 1)

    @property
    def largest_order(self) -> float:
        """Largest engine order that excites a nodal diameter of the same number; 1 for a structure without sectors."""
        return max(self.problem.model.n_blades // 2, 1)

    @property
    def amplitude(self) -> float:
        """Excitation amplitude (N) as reference for a preload; 0 without a force at a location or without a load.

        Also 0 for a lumped model: its quantities are often normalised, and the preload is then below the excitation.
        """
        settings = self.problem.settings
        if self.lumped or not (settings.acts_at_location and self.problem.carries_load):
            return 0.0
        return settings.excitation.amplitude

    @property
    def least_force(self) -> float:
        """Smallest plausible excitation amplitude, N; 0 for a lumped model, which may be normalised."""
        return 0.0 if self.lumped else 1e-6

    @property
    def body_stiffness(self) -> float:
        """Mean stiffness of the bodies at a component of a contact point, N/m; NaN if the model does not contain it."""
        try:
            flexibility = (
                self.problem.coupling.residual_flexibility(1).diagonal().real.reshape(-1, 3)
            )
        except ModelError:
            return np.nan
        rows = self.problem.friction_points
        return (
            float(np.mean(1.0 / flexibility[rows]))
            if rows.any() and flexibility[rows].min() > 0.0
            else np.nan
        )

    def faces(self, name: str) -> list[Interface]:
        """Return the interface with this name, or the interfaces of the body with this name."""
        faces = self.problem.model.interfaces
        return (
            [faces[name]]
            if name in faces
            else [f for f in faces.values() if name in (f.body_a, f.body_b)]
        )

    def bearable(self, name: str) -> float:
        """Return the load (N) of a body or an interface at a mean pressure of 1 GPa."""
        area = sum(float(face.area.sum()) for face in self.faces(name))
        return np.inf if self.lumped or not area else 1e9 * area

    def volume(self, name: str) -> float:
        """Return the volume (m3) of a box around the contact points of a body."""
        size = np.ptp(np.concatenate([face.points for face in self.faces(name)]), axis=0)
        return float(np.prod(np.maximum(size, 0.1 * size.max())))

    def deflecting(self, location: str) -> float:
        """Return the static force (N) at a location that deflects it by a tenth of the extent of the model."""
        omega2 = self.problem.modal_bases[1].omega2
        motion = np.linalg.norm(self.problem.coupling.location_modes(location, 1), axis=0)
        flexibility = float(np.sum(motion[omega2 > 0.0] ** 2 / omega2[omega2 > 0.0]))
        return 0.1 * self.size / flexibility if flexibility > 0.0 else np.inf

    def critical_drag(self, name: str | None) -> float:
        """Return 2 m omega_1 (N s/m) for the mass of a body, or of the heaviest free body, and the first natural
        frequency.
        """
        bodies, omega2 = self.problem.model.bodies, self.problem.modal_bases[1].omega2
        names = [name] if name else self.problem.settings.free_bodies
        mass = max((bodies[body].mass or 0.0 for body in names), default=0.0)
        lowest = omega2[omega2 > 0.0].min(initial=np.inf)
        return 2.0 * mass * float(np.sqrt(lowest)) if mass > 0.0 and np.isfinite(lowest) else np.inf

    def contradiction(
        self, preload: NDArray, speed: float | NDArray, mass: float = 1.0
    ) -> tuple[str, str] | None:
        """Compare preloads with the centrifugal load of the damper.

        Parameters
        ----------
        preload : (n,) float, N
        speed : float or (n,) float, rad/s
            Rotor speed, or that of each preload.
        mass : float
            Factor on the mass of the damper.

        Returns
        -------
        tuple of str, optional
            Expected load and preloads found; None if the preloads contain the load, or no load is known.
        """
        arms = centrifugal_arms(self.problem.model) if self.problem.carries_load else {}
        load = (
            mass * next(iter(arms.values()), 0.0) * np.broadcast_to(speed, np.shape(preload)) ** 2
        )
        apart = 0.05  # relative difference that is tolerated
        if not load.all() or (
            (preload / load).min() < 1.0 + apart and (preload / load).max() > 1.0 - apart
        ):
            return None
        i = int(np.abs(preload - load).argmin())
        at = np.broadcast_to(speed, load.shape)[i]
        expected = f"{load[i]:.4g} N, the centrifugal load of the damper at {at:.4g} rad/s"
        found = " to ".join(f"{x:.4g}" for x in dict.fromkeys((preload.min(), preload.max())))
        return (
            expected,
            f"{found} N: a damper of {preload[i] / load[i]:.3g} times the mass, or another speed suspected",
        )

    def check_preload(
        self, preload: NDArray, speed: float | NDArray | None = None, mass: float = 1.0
    ) -> bool:
        """Warn if preloads contradict the centrifugal load, and return whether they do.

        Without ``speed`` the study's speed is used, and only the first contradiction is reported.
        """
        own, speed = speed is None, self.problem.settings.speed if speed is None else speed
        contradiction = None if speed is None else self.contradiction(preload, speed, mass)
        if contradiction and not (own and "preload" in self.told):
            warn_implausible("preload", *contradiction)
            self.told.update(["preload"] * own)
        return contradiction is not None

    def check_faces(self, preload: float) -> None:
        """Warn once if friction faces touch at an edge under a preload."""
        if "faces" in self.told or not (self.problem.carries_load and preload > 0.0):
            return
        edges = self.problem.at(preload).static.edges
        if edges:
            self.told.add("faces")
            warn_implausible(
                "contact at rest",
                "faces that touch over their area",
                f"{edges} under {preload:.4g} N",
            )

    def check_optimum(self, preload: float, preloads: NDArray) -> None:
        """Warn if the preload of an optimum contradicts the centrifugal load, which the computed preloads contain."""
        speed = self.problem.settings.speed
        if speed is not None and np.isfinite(preload) and not self.contradiction(preloads, speed):
            self.check_preload(np.array([preload]))
