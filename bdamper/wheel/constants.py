"""What all equations of one wheel have in common: matrices and memory of their approximate inverse."""

from __future__ import annotations

import threading
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from bdamper.contact.points import PointArrays
from bdamper.harmonic_balance.many_points import Elimination
from bdamper.wheel.condensation import Condensation
from bdamper.wheel.structure import Structure

KEPT = 8
"""Shapes of the root, the most important ones, in the ring.  On the shipped disk (9 points, 16 shapes) with one harmonic
16, 8, 6 and 4 take 3, 3, 3 and 4 iterations to 1e-2; with three harmonics 16, 8 and 6 take 29, 36 and 104 to 1e-4.  The
cost of the ring falls with the third power of their number."""


@dataclass(frozen=True, eq=False)
class Constants:
    """Constant parts of the equations of a wheel, and for each thread one workspace, which goes with the thread.

    Parameters
    ----------
    structure : Structure
    weight : (n_blades, n_points, 3) float, N/m
        Stiffness of the contacts along t1, t2, n.
    n_harmonics : int
    active : (n_coefficients,) bool
        Coefficients that are unknowns; others stay zero.
    pinned : (n_blades,) bool
        Dampers that are missing; their coordinates stay zero.
    """

    structure: Structure
    weight: NDArray
    n_harmonics: int
    active: NDArray
    pinned: NDArray
    _condensations: dict[int, Condensation] = field(default_factory=dict, init=False, repr=False)
    _workspace: threading.local = field(default_factory=threading.local, init=False, repr=False)

    @classmethod
    def of(cls, structure: Structure, points: PointArrays, active: NDArray, pinned: NDArray) -> Constants:
        """Those of a structure with contact points, sector by sector."""
        weight = np.concatenate([points.kt, points.kn[:, None]], axis=1).reshape(structure.n_blades, -1, 3)
        return cls(structure, weight, len(active) // 2, np.ascontiguousarray(active), np.ascontiguousarray(pinned))

    @cached_property
    def groups(self) -> list[NDArray]:
        """Points of each sector whose blade is that sector's, and the next one's."""
        return [np.flatnonzero(self.structure.sector == s) for s in (0, 1)]

    @property
    def root(self) -> slice:
        """Root shapes among the coordinates of a sector."""
        s = self.structure
        return slice(s.n - s.local.n_interface, s.n)

    @cached_property
    def kept(self) -> int:
        """Shapes of the root whose coupling to neighbours the approximate inverse keeps."""
        return min(KEPT, self.structure.local.n_interface)

    @cached_property
    def damper_springs(self) -> NDArray:
        """(n_blades, n_damper) stiffness of the stuck contacts of each damper against its own coordinates."""
        k = self.weight.reshape(len(self.weight), -1)
        own = self.structure.rows[..., self.structure.n :].reshape(k.shape[1], -1)
        springs = k @ own**2
        return np.maximum(springs, 1e-6 * springs.max(initial=1e-300))

    def condensation(self, omega: float) -> tuple[Condensation, Elimination]:
        """What is condensed out of the blades, and the elimination of the rest, for frequencies (rad/s) of one octave."""
        octave = int(np.ceil(np.log2(max(omega, 1.0))))
        of = self._condensations.get(octave)
        if of is None:
            s = self.structure
            disk_k, disk_m, damping, _, _ = self.kernel
            stiffness, nominal, mass = s.stiffness.copy(), s.local.blade_stiffness.copy(), s.mass.copy()
            for matrix, disk in ((stiffness, disk_k), (nominal, disk_k), (mass, disk_m)):
                matrix[..., self.root, self.root] += disk
            fastest = self.n_harmonics * 2.0**octave
            of = Condensation.of(
                stiffness, nominal, mass, damping, s.rows, self.weight.max(axis=0), self.kept, fastest
            )  # fmt: skip
            self._condensations[octave] = of
        if getattr(self._workspace, "octave", None) != octave:
            s = self.structure
            self._workspace.core = None  # its memory serves the next one
            own, following = (np.ascontiguousarray(of.rows[g]) for g in self.groups)
            self._workspace.core = Elimination(
                s.n_blades, self.n_harmonics, len(of.mass), s.n_damper, self.kept, own, following, self.active, self.pinned
            )  # fmt: skip
            self._workspace.octave = octave
        return of, self._workspace.core

    @cached_property
    def kernel(self) -> tuple[NDArray, ...]:
        """Own parts of disk stiffness, mass and damping, and those of the sector before (stiffness and mass alone)."""
        s = self.structure
        turn = np.exp(2j * np.pi * np.arange(s.n_blades) / s.n_blades)[:, None, None]
        own = [m.mean(axis=0).real for m in (s.disk_stiffness, s.disk_mass, s.damping)]
        return (*own, (turn * s.disk_stiffness).mean(axis=0).real, (turn * s.disk_mass).mean(axis=0).real)

    @cached_property
    def far(self) -> tuple[NDArray, ...]:
        """What the approximate inverse leaves out of disk stiffness, mass, mass of eased damping, and damping.

        Each is (n_blades, n_root, n_root), complex, of every nodal diameter.
        """
        s, k = self.structure, self.kept
        disk_k, disk_m, damping, near_k, near_m = self.kernel
        behind = np.exp(-2j * np.pi * np.arange(s.n_blades) / s.n_blades)[:, None, None]

        def rest(full: NDArray, near: NDArray) -> NDArray:
            out, before = full.copy(), behind * near[-k:, -k:]
            out[:, -k:, -k:] -= before + before.conj().transpose(0, 2, 1)
            return out

        eased, damped = s.disk_mass - disk_m, (s.damping - damping)[:, self.root, self.root]
        return rest(s.disk_stiffness - disk_k, near_k), rest(eased, near_m), eased, damped
