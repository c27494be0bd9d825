r"""Harmonic balance of a whole wheel, as equations of the engine.

For every sector, with the coordinates of its blade and its damper (:mod:`bdamper.wheel.structure`) and
:math:`X_l = c_l - i s_l`, the residual is

.. math::
    (K - (l\omega)^2 M + i l \omega C) X_l + P^T F_l - E_l ,

in which the disk and the damping C of the tuned wheel act by a Fourier transform over the sectors and everything else
sector by sector.  Residual, products and linear equations are those of the core (``csrc/bd_wheel.c``); unknowns are laid
out as those of a sector, the mean of all sectors first, so that whoever solves or follows equations serves a wheel as well.

**Springs** that hold the mean of dampers at its static place make the equations easier: a damper that slips fully is free
along its axis.  Their solutions lead to those of the wheel itself (:mod:`bdamper.wheel.peak`).
"""

from __future__ import annotations

import math
from collections.abc import Collection
from copy import copy
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from bdamper.contact.laws import Sampled
from bdamper.contact.points import PointArrays
from bdamper.harmonic_balance.system import HarmonicSystem, WholeWheel, evaluation_code
from bdamper.wheel.structure import Structure

NEUTRAL = 1e-8
"""Springs on the mean of a damper's coordinates in the Jacobian alone, relative to its stiffness when stuck: a damper that
slips fully is free along the axis, and the matrix of its sector singular.  They change steps by as much, not solutions."""
WIDTHS = 10.0
"""Of the narrowest resonance: the unit of frequency along a curve.  With that of the interval the first step of a curve of
a lumped wheel of six blades passes over all its resonances."""
DENSE = 2000
"""Unknowns up to which the whole matrix is formed where it is asked for: 32 MB."""


class WheelSystem(HarmonicSystem):
    """Equations of one wheel at one preload; the response is that of one blade (:meth:`of_blade`).

    Parameters
    ----------
    structure : Structure
    points : PointArrays
        Of all sectors, sector by sector, with the part of the relative motion that the coordinates do not carry.
    harmonics : collection of int
        That are unknowns.
    load : (n_blades, n_sector) float
        Static forces.
    excitation : (n_blades, n_sector) complex
        Forces of the first harmonic.
    response_row : (n,) float
        Blade coordinates to the response.
    missing : (n_blades,) bool
        Dampers that are not there; their coordinates stay zero.
    force_scale : (2,) float
        Forces of the mean and of the harmonics to which the residual is related.
    mean : (n_blades, n_sector) float
        Of the static state, where springs on dampers are at rest.
    evaluation : {"exact"} or Sampled

    Attributes
    ----------
    at_rest : (n_unknowns,) float
        The static state.
    holding : float
        Springs on the mean of dampers, relative to their stiffness when stuck.
    """

    def __init__(
        self,
        structure: Structure,
        points: PointArrays,
        harmonics: Collection[int],
        load: NDArray,
        excitation: NDArray,
        response_row: NDArray,
        missing: NDArray,
        force_scale: tuple[float, float],
        mean: NDArray,
        evaluation: str | Sampled = "exact",
    ) -> None:
        N, size = structure.n_blades, structure.n_sector
        self.structure, self.points, self.evaluation = structure, points, evaluation
        self.n_harmonics = max(1, *harmonics)
        self.n_mode = np.array([N * size * (l in harmonics) for l in range(self.n_harmonics + 1)], np.intc)
        self.active = np.repeat(self.n_mode > 0, 2)[1:]
        self.n_mean, self.n_unknowns = int(self.n_mode[0]), int(self.active.sum()) * N * size
        self.shape = (N, 2 * self.n_harmonics + 1, size)
        self.evaluation_code = evaluation_code(evaluation, self.n_harmonics, np.asarray(points.law))
        self.exact, self.n_points = self.evaluation_code[0] == 0, len(points.kn)
        self.supported, self.most_evaluations, self.watched = False, math.inf, []
        self.response_row, self.holding = response_row, 0.0
        self.narrowest = 2.0 * structure.damping_ratio
        force = np.zeros(self.shape)
        force[:, 0] = load
        force[:, 1], force[:, 2] = excitation.real, -excitation.imag
        force[missing, :, structure.n :] = 0.0
        self.force = self.flat(force)
        self.at_rest = self.flat(np.pad(mean[:, None], ((0, 0), (0, self.shape[1] - 1), (0, 0))))
        self.force_scale = force_scale
        self.row_scale = np.full(self.n_unknowns, 1.0 / force_scale[1])
        self.row_scale[: self.n_mean] = 1.0 / force_scale[0]
        self.stuck = _stuck_springs(structure, points)
        half = N // 2 + 1
        n, n_root = structure.n, structure.n_root
        self.arrays = {
            "n_sector": N, "n_harm": self.n_harmonics, "n_blade": n, "n_damper": structure.n_damper, "n_root": n_root,
            "n_kept": min(structure.n_kept, n_root), "n_point": len(structure.sector), "next": structure.sector == 1,
            "rows": structure.rows,
            "active": self.active, "pinned": missing, "stiffness": structure.stiffness, "mass": structure.mass,
            "disk_stiffness": structure.disk_stiffness[:half], "disk_mass": structure.disk_mass[:half],
            "damping": structure.damping[:half], "damper_stiffness": structure.damper_stiffness,
            "damper_mass": structure.damper_mass, "damper_damping": structure.damper_damping,
            "springs": 0.0 * self.stuck, "neutral": NEUTRAL * self.stuck, "home": mean[:, n:], "kt": points.kt,
            "kn": points.kn,
            "mu": points.mu, "n0": points.n0, "w": points.slider, "load": points.n0 if points.load is None else points.load,
            "shift": points.shift, "force": self.force, "row_scale": self.row_scale, "law": points.law,
        }  # fmt: skip
        self._make()
        self._at_blade(0)

    def _make(self) -> None:
        """The core's equations, from arrays of the types that it asks for."""
        kinds: dict[str, type] = {"law": np.intc, "next": bool, "active": bool, "pinned": bool}
        kinds |= {"disk_stiffness": complex, "disk_mass": complex, "damping": complex}
        given: dict[str, Any] = {
            k: np.ascontiguousarray(v, kinds.get(k, float)) if np.ndim(v) else v for k, v in self.arrays.items()
        }
        self.core = WholeWheel(**given, evaluation=self.evaluation_code[0], n_time=self.evaluation_code[1])

    def _at_blade(self, blade: int) -> None:
        row = np.zeros((self.shape[0], self.shape[2]))
        row[blade, : self.structure.n] = self.response_row
        self.response_rows = [row.ravel() * (n > 0) if n else np.zeros(0) for n in self.n_mode]

    @property
    def work(self) -> NDArray:
        """As that of a sector; a factorisation eliminates sector by sector."""
        N, n_coef, size = self.shape
        return 1e-6 * np.array([28e3 * self.n_points * n_coef, 0.0, 4.0 * N * (n_coef * size) ** 3, 0.0])

    def held(self, springs: float) -> Self:
        """The same equations with springs on the mean of dampers, relative to their stiffness when stuck."""
        out = copy(self)
        out.holding, out.arrays = springs, self.arrays | {"springs": springs * self.stuck}
        out._make()
        return out

    def of_blade(self, blade: int) -> Self:
        """The same equations with the response of another blade."""
        out = copy(self)
        out._at_blade(blade)
        return out

    def parts_at(self, omega: float) -> tuple[NDArray, NDArray]:
        """As those of a sector, of the blade that is the response."""
        return self._parts(np.asarray(self.response_rows[1]))

    def evaluate_at(self, y: NDArray) -> tuple[NDArray, NDArray, NDArray]:
        """As that of a sector; the matrix of a large wheel is not formed."""
        if self.n_unknowns > DENSE:
            raise FloatingPointError("the matrix of a large wheel is not formed")
        return super().evaluate_at(y)

    def flat(self, X: NDArray) -> NDArray:
        """(n_unknowns,) those of (n_blades, n_coefficients, n_sector)."""
        return np.ascontiguousarray(X.transpose(1, 0, 2)[self.active]).ravel()

    def array(self, u: NDArray) -> NDArray:
        """(n_blades, n_coefficients, n_sector) of unknowns (n_unknowns,)."""
        out = np.zeros((self.shape[1], self.shape[0], self.shape[2]))
        out[self.active] = u.reshape(-1, self.shape[0], self.shape[2])
        return out.transpose(1, 0, 2)

    def units(self, y: NDArray, vibration: float, width: float) -> NDArray:
        """As those of a sector, with no more for the frequency than some widths of the narrowest resonance."""
        return super().units(y, vibration, min(width, WIDTHS * self.narrowest * y[-1] or width))

    def units_about(self, y: NDArray, width: float) -> NDArray:
        """Units of a point that may be at rest, with that of the frequency (rad/s) as it is."""
        least = max(1e-3 * float(np.abs(y[: self.n_mean]).max(initial=0.0)), 1e-12)
        return super().units(y, max(self.vibration(y), least), width)

    def responses(self, u: NDArray) -> NDArray:
        """(n_blades, n_harmonics + 1) complex response of all blades, the mean first."""
        x = self.array(u)[..., : self.structure.n] @ self.response_row
        return np.column_stack([x[:, 0], x[:, 1::2] - 1j * x[:, 2::2]])


def _stuck_springs(structure: Structure, points: PointArrays) -> NDArray:
    """(n_blades, n_damper) stiffness of the stuck contacts of each damper against its own coordinates."""
    k = np.concatenate([points.kt, points.kn[:, None]], axis=1).reshape(structure.n_blades, -1)
    springs = k @ structure.rows[..., structure.n :].reshape(k.shape[1], -1) ** 2
    return np.maximum(springs, 1e-6 * springs.max(initial=1e-300))
