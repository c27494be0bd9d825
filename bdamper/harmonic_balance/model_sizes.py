"""Characteristic sizes of a model, such as extent and stiffness, as reference for plausible ranges
of settings.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bdamper.model.kinematics import centrifugal_arms
from bdamper.model.structure import Interface
from bdamper.util.errors import ModelError, warn_implausible

TOLERATED = 0.05
"""Relative difference between a preload and the centrifugal load that is no contradiction."""


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
        """Largest extent of contact points and locations along an axis, m; infinite for a lumped
        model.
        """
        model = self.problem.model
        places = [face.points for face in model.interfaces.values()]
        places += [place.position[None] for place in model.locations.values()]
        extent = float(np.ptp(np.concatenate(places), axis=0).max())
        if self.lumped or extent == 0.0:
            return np.inf
        return extent

    @property
    def least_order(self) -> float:
        """Smallest plausible engine order: 1 for a bladed disk, 0 without sectors."""
        return float(self.problem.model.n_blades > 1)

    @property
    def largest_order(self) -> float:
        """Largest engine order that excites the nodal diameter with the same number.

        It is 1 for a structure without sectors.
        """
        return max(self.problem.model.n_blades // 2, 1)

    @property
    def amplitude(self) -> float:
        """Excitation amplitude (N) as reference for a preload.

        It is 0 without a force at a location or without a load, and for a lumped model: its
        quantities are often normalised, and the preload is then below the excitation.
        """
        settings = self.problem.settings
        if self.lumped or not (settings.acts_at_location and self.problem.carries_load):
            return 0.0
        return settings.excitation.amplitude

    @property
    def least_force(self) -> float:
        """Smallest plausible excitation amplitude, N; 0 for a lumped model, which may be
        normalised.
        """
        return 0.0 if self.lumped else 1e-6

    @property
    def body_stiffness(self) -> float:
        """Mean stiffness of the bodies at a component of a contact point, N/m.

        It is NaN if the model does not contain it.
        """
        try:
            flexibility = self.problem.coupling.residual_flexibility(1)
        except ModelError:
            return np.nan
        of_points = flexibility.diagonal().real.reshape(-1, 3)
        rows = self.problem.friction_points
        if not rows.any() or not of_points[rows].min() > 0.0:
            return np.nan
        return float(np.mean(1.0 / of_points[rows]))

    def faces(self, name: str) -> list[Interface]:
        """Return the interface with this name, or the interfaces of the body with this name."""
        faces = self.problem.model.interfaces
        if name in faces:
            return [faces[name]]
        return [face for face in faces.values() if name in (face.body_a, face.body_b)]

    def bearable(self, name: str) -> float:
        """Return the load (N) of a body or an interface at a mean pressure of 1 GPa."""
        area = sum(float(face.area.sum()) for face in self.faces(name))
        if self.lumped or area == 0.0:
            return np.inf
        return 1e9 * area

    def volume(self, name: str) -> float:
        """Return the volume (m3) of a box around the contact points of a body."""
        points = np.concatenate([face.points for face in self.faces(name)])
        edges = np.ptp(points, axis=0)
        # points in a plane belong to a body with a thickness
        return float(np.prod(np.maximum(edges, 0.1 * edges.max())))

    def deflecting(self, location: str) -> float:
        """Return the static force (N) that deflects a location by a tenth of the model's extent."""
        omega2 = self.problem.modal_bases[1].omega2
        elastic = omega2 > 0.0
        motion = np.linalg.norm(self.problem.coupling.location_modes(location, harmonic=1), axis=0)
        flexibility = float(np.sum(motion[elastic] ** 2 / omega2[elastic]))
        if flexibility == 0.0:
            return np.inf
        return 0.1 * self.size / flexibility

    def critical_drag(self, name: str | None) -> float:
        """Return 2 m omega_1 (N s/m) for the mass of a body and the first natural frequency.

        Without a name the body is the heaviest free body.
        """
        bodies = self.problem.model.bodies
        names = [name] if name else self.problem.settings.free_bodies
        mass = max((bodies[body].mass or 0.0 for body in names), default=0.0)
        omega2 = self.problem.modal_bases[1].omega2
        lowest = omega2[omega2 > 0.0].min(initial=np.inf)
        if mass == 0.0 or np.isinf(lowest):
            return np.inf
        return 2.0 * mass * float(np.sqrt(lowest))

    def centrifugal_load(self, speed: NDArray) -> NDArray:
        """Return the centrifugal load (n,) of the first loaded body at rotor speeds (n,), N.

        It is 0 if no load is known.
        """
        if not self.problem.carries_load:
            return np.zeros(np.shape(speed))
        arms = centrifugal_arms(self.problem.model)
        first_arm = next(iter(arms.values()), 0.0)
        return np.asarray(first_arm * np.square(speed))

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
            Expected load and preloads found; None if the preloads contain the load, or no load is
            known.
        """
        speeds = np.broadcast_to(speed, np.shape(preload))
        load = mass * self.centrifugal_load(speeds)
        if not load.all():
            return None
        ratio = preload / load
        contains_load = ratio.min() < 1.0 + TOLERATED and ratio.max() > 1.0 - TOLERATED
        if contains_load:
            return None
        nearest = int(np.abs(preload - load).argmin())
        expected = (
            f"{load[nearest]:.4g} N, the centrifugal load of the damper at "
            f"{speeds[nearest]:.4g} rad/s"
        )
        # one number if all preloads are equal
        ends = dict.fromkeys((preload.min(), preload.max()))
        found = " to ".join(f"{end:.4g}" for end in ends)
        return (
            expected,
            f"{found} N; possibly {preload[nearest] / load[nearest]:.3g} times the damper mass, "
            "or a different speed",
        )

    def check_preload(
        self, preload: NDArray, speed: float | NDArray | None = None, mass: float = 1.0
    ) -> bool:
        """Warn if preloads contradict the centrifugal load, and return whether they do.

        Without ``speed`` the study's speed is used, and only the first contradiction is reported.
        """
        once = speed is None
        if speed is None:
            speed = self.problem.settings.speed
        if speed is None:
            return False
        contradiction = self.contradiction(preload, speed, mass)
        if contradiction is None:
            return False
        if once and "preload" in self.told:
            return True
        warn_implausible("preload", *contradiction)
        if once:
            self.told.add("preload")
        return True

    def check_faces(self, preload: float) -> None:
        """Warn once if friction faces touch only along an edge under a preload."""
        if "faces" in self.told or not (self.problem.carries_load and preload > 0.0):
            return
        edges = self.problem.at(preload).static.edges
        if edges:
            self.told.add("faces")
            warn_implausible(
                "contact at rest",
                "faces that touch over most of their area",
                f"{edges} under {preload:.4g} N",
            )

    def check_optimum(self, preload: float, preloads: NDArray) -> None:
        """Warn if the preload of an optimum contradicts the centrifugal load.

        The computed preloads contain this load, otherwise they have been reported.
        """
        speed = self.problem.settings.speed
        if speed is not None and np.isfinite(preload) and not self.contradiction(preloads, speed):
            self.check_preload(np.array([preload]))
