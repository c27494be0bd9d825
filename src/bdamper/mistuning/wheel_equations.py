r"""Harmonic balance of a whole wheel, as equations of the engine.

For every sector, with the coordinates of its blade and its damper (:mod:`bdamper.mistuning.structure`) and
:math:`X_l = c_l - i s_l`, the residual is

.. math::
    (K - (l\omega)^2 M + i l \omega C) X_l + P^T F_l - E_l ,

in which the disk and the damping C of the tuned wheel act by a Fourier transform over the sectors and everything else
sector by sector.  Residual, products and linear equations are in the core
(``csrc/bladed_disk/wheel_equations.c``); unknowns are laid out as those of a sector, the mean of all sectors first, so that
whoever solves or follows equations serves a wheel as well.

**Springs** that hold the mean of dampers at its static place make the equations easier: a damper that slips fully is free
along its axis.  Their solutions lead to those of the wheel itself (:mod:`bdamper.mistuning.peak`).
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bdamper.contact.law_codes import AFT
from bdamper.contact.point_parameters import PointArrays
from bdamper.harmonic_balance.equations import Equations, InFrequency, Layout, Rows, WheelCore
from bdamper.harmonic_balance.sector import evaluation_code, row_scale
from bdamper.mistuning.structure import Structure

NEUTRAL = 1e-8
"""Springs on the mean of a damper's coordinates in the Jacobian alone, relative to its stiffness when stuck: a damper that
slips fully is free along the axis, and the matrix of its sector singular.  They change steps by as much, not solutions."""


@dataclass(frozen=True)
class InWidths(InFrequency):
    """Units in which that of the frequency is no more than some widths of the narrowest resonance.

    Parameters
    ----------
    n_mean : int
    narrowest : float
        Width of the narrowest resonance, relative to its frequency.
    """

    narrowest: float = 0.0

    def units(self, y: NDArray, vibration: float, width: float) -> NDArray:
        """Units as of a sector."""
        # of the narrowest resonance: the unit of frequency along a curve. With that of the interval the first step of a
        # curve of a lumped wheel of six blades passes over all its resonances
        widths = 10.0
        return super().units(y, vibration, min(width, widths * self.narrowest * y[-1] or width))


@dataclass(frozen=True, eq=False)
class WheelScene:
    """Data of the equations of one wheel at one preload.

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
    contact_forces : {"event_driven"} or AFT
    holding : float
        Springs on the mean of dampers, relative to their stiffness when stuck.
    """

    structure: Structure
    points: PointArrays
    harmonics: Collection[int]
    load: NDArray
    excitation: NDArray
    response_row: NDArray
    missing: NDArray
    force_scale: tuple[float, float]
    mean: NDArray
    contact_forces: str | AFT = "event_driven"
    holding: float = 0.0

    @property
    def shape(self) -> tuple[int, int, int]:
        """Blades, coefficients of the harmonics, coordinates of a sector."""
        return self.structure.n_blades, 2 * max(1, *self.harmonics) + 1, self.structure.n_sector

    @cached_property
    def layout(self) -> Layout:
        """Places of the harmonics among the unknowns."""
        N, n_coef, size = self.shape
        return Layout(np.array([N * size * (l in self.harmonics) for l in range(n_coef // 2 + 1)], np.intc))

    @cached_property
    def active(self) -> NDArray:
        """(n_coefficients,) bool: those that are unknowns."""
        return np.repeat(self.layout.n_mode > 0, 2)[1:]

    @cached_property
    def force(self) -> NDArray:
        """(n_unknowns,) static load and excitation."""
        force = np.zeros(self.shape)
        force[:, 0] = self.load
        force[:, 1], force[:, 2] = self.excitation.real, -self.excitation.imag
        force[self.missing, :, self.structure.n :] = 0.0
        return self.flat(force)

    @cached_property
    def at_rest(self) -> NDArray:
        """(n_unknowns,) the static state."""
        return self.flat(np.pad(self.mean[:, None], ((0, 0), (0, self.shape[1] - 1), (0, 0))))

    def flat(self, X: NDArray) -> NDArray:
        """(n_unknowns,) those of (n_blades, n_coefficients, n_sector)."""
        return np.ascontiguousarray(X.transpose(1, 0, 2)[self.active]).ravel()

    def array(self, u: NDArray) -> NDArray:
        """(n_blades, n_coefficients, n_sector) of unknowns (n_unknowns,)."""
        out = np.zeros((self.shape[1], self.shape[0], self.shape[2]))
        out[self.active] = u.reshape(-1, self.shape[0], self.shape[2])
        return out.transpose(1, 0, 2)

    def responses(self, u: NDArray) -> NDArray:
        """(n_blades, n_harmonics + 1) complex response of all blades, the mean first."""
        x = self.array(u)[..., : self.structure.n] @ self.response_row
        return np.column_stack([x[:, 0], x[:, 1::2] - 1j * x[:, 2::2]])

    def units_about(self, y: NDArray, width: float) -> NDArray:
        """Units of a point that may be at rest, with that of the frequency (rad/s) as it is."""
        n = int(self.layout.n_mode[0])
        measure, least = InFrequency(n), max(1e-3 * float(np.abs(y[:n]).max(initial=0.0)), 1e-12)
        return measure.units(y, max(measure.vibration(y), least), width)

    @cached_property
    def stuck(self) -> NDArray:
        """(n_blades, n_damper) stiffness of the stuck contacts of each damper against its own coordinates."""
        s, points = self.structure, self.points
        k = np.concatenate([points.kt, points.kn[:, None]], axis=1).reshape(s.n_blades, -1)
        springs = k @ s.rows[..., s.n :].reshape(k.shape[1], -1) ** 2
        return np.maximum(springs, 1e-6 * springs.max(initial=1e-300))

    def _core(self) -> WheelCore:
        """The core's equations, from arrays of the types that it asks for."""
        s, points, half = self.structure, self.points, self.structure.n_blades // 2 + 1
        stuck = self.stuck
        mode, n_time = evaluation_code(self.contact_forces, self.shape[1] // 2, np.asarray(points.law))
        kinds: dict[str, type] = {"law": np.intc, "next": bool, "active": bool, "pinned": bool}
        kinds |= {"disk_stiffness": complex, "disk_mass": complex, "damping": complex}
        arrays = {
            "n_sector": s.n_blades, "n_harm": self.shape[1] // 2, "n_blade": s.n, "n_damper": s.n_damper,
            "n_root": s.n_root, "n_kept": min(s.n_kept, s.n_root), "n_point": len(s.sector), "next": s.sector == 1,
            "rows": s.rows, "active": self.active, "pinned": self.missing, "stiffness": s.stiffness, "mass": s.mass,
            "disk_stiffness": s.disk_stiffness[:half], "disk_mass": s.disk_mass[:half], "damping": s.damping[:half],
            "damper_stiffness": s.damper_stiffness, "damper_mass": s.damper_mass, "damper_damping": s.damper_damping,
            "springs": self.holding * stuck, "neutral": NEUTRAL * stuck, "home": self.mean[:, s.n :], "kt": points.kt,
            "kn": points.kn, "mu": points.mu, "n0": points.n0, "w": points.slider,
            "load": points.n0 if points.load is None else points.load, "shift": points.shift, "force": self.force,
            "row_scale": row_scale(self.layout, self.force_scale), "law": points.law,
        }  # fmt: skip
        given: dict[str, Any] = {
            k: np.ascontiguousarray(v, kinds.get(k, float)) if np.ndim(v) else v for k, v in arrays.items()
        }
        return WheelCore(**given, evaluation=mode, n_time=n_time)

    def _response(self, blade: int) -> dict[str, Any]:
        """Rows of the response of one blade."""
        row = np.zeros((self.shape[0], self.shape[2]))
        row[blade, : self.structure.n] = self.response_row
        rows = [row.ravel() * (n > 0) if n else np.zeros(0) for n in self.layout.n_mode]
        first = self.layout.parts(rows[1]) if len(rows[1]) else np.zeros((2, self.layout.n_unknowns))
        return {"response_rows": rows, "rows": Rows(np.array([first]))}

    @property
    def equations(self) -> WheelSystem:
        """The equations at any frequency, with the response of the first blade."""
        N, n_coef, size = self.shape
        contact = 28e3 * len(self.points.kn) * n_coef
        dense = 2000  # unknowns up to which the whole matrix is formed where it is asked for: 32 MB
        return Equations(
            core=self._core(), structure=self, layout=self.layout, **self._response(0),
            measure=InWidths(int(self.layout.n_mode[0]), 2.0 * self.structure.damping_ratio),
            row_scale=row_scale(self.layout, self.force_scale), n_points=len(self.points.kn),
            forms_matrix=self.layout.n_unknowns <= dense,
            work=1e-6 * np.array([contact, 0.0, 4.0 * N * (n_coef * size) ** 3, 0.0]),  # eliminated sector by sector
        )  # fmt: skip

    def held(self, springs: float) -> WheelSystem:
        """The equations with springs on the mean of dampers, relative to their stiffness when stuck."""
        return replace(self, holding=springs).equations


WheelSystem = Equations[WheelScene]
"""Equations of a wheel; the response is that of one blade."""


def of_blade(system: WheelSystem, blade: int) -> WheelSystem:
    """The same equations with the response of another blade."""
    return replace(system, **system.structure._response(blade))
