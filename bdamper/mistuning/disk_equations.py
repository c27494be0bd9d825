r"""Structure and harmonic balance equations of a mistuned bladed disk with all its sectors.

**Coordinates.**  The unknowns of sector ``n`` are the local coordinates :math:`u_n` of blade ``n``
(``bdamper.model.modal_basis.LocalBasis``) and the coordinates :math:`y_n` of damper ``n``, which
lies between blades ``n`` and ``n + 1``.  The motion of a contact point is

.. math:: v_n = P\, u_{n + s} + D\, y_n,

where its blade is in its own sector (s = 0) or in the next one (s = 1).  Only two terms couple
sectors: the disk, through the root shapes, and the damping of the tuned modes.  Both are circulant,
with one matrix for each nodal diameter, and are applied by a Fourier transform over the sectors.

**Residual.**  With :math:`X_l = c_l - i s_l`, the residual of harmonic l in each sector is

.. math::
    (K - (l\omega)^2 M + i l \omega C) X_l + P^T F_l - E_l .

The core (``csrc/bladed_disk/wheel_equations.c``) computes it, its products and the solution of its
linear equations. Unknowns have the same layout as for one sector, the mean of all sectors first, so
the solvers and the continuation also accept a bladed disk.

**Holding springs** hold the mean of dampers at its static position.  A damper in full slip is free
along its axis, and the springs make the equations easier to solve.  Their solutions are initial
guesses for the solutions without springs (:mod:`bdamper.mistuning.peak`).
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from bdamper.contact.laws import AFT, PointArrays, refuse
from bdamper.contact.residual_flexibility import ResidualModes
from bdamper.harmonic_balance.equations import Equations, InFrequency, Layout, Rows, WheelCore
from bdamper.harmonic_balance.problem import Problem
from bdamper.harmonic_balance.sector import evaluation_code, row_scale
from bdamper.mistuning.mistuning import Mistuning
from bdamper.model.loads import direction_vector
from bdamper.model.modal_basis import LocalBasis
from bdamper.model.structure import Model, SurfaceMesh
from bdamper.model.validation import as_checked
from bdamper.util.errors import ModelError, SettingError, warn
from bdamper.util.formatting import short_repr


def local_model(model: Model) -> Model:
    """Return the model with all modes of its local basis at every nodal diameter from 0 to N/2.

    A study of it with all these ``blade_modes`` spans the same space as the bladed disk.  Mode
    shapes for plots, stress rows and the dependence on rotor speed refer to the replaced modes and
    are left out.

    Raises
    ------
    ModelError
        If no body of the model has a local basis.
    """
    bodies, meshes, stress = dict(model.bodies), dict(model.meshes), dict(model.stress)
    for name, body in model.bodies.items():
        if body.local is not None:
            bases = {d: body.local.nodal_diameter(d) for d in range(model.n_blades // 2 + 1)}
            bodies[name] = replace(body, bases=bases)
            if name in meshes:  # its shapes belong to the modes that are replaced
                meshes[name] = SurfaceMesh(meshes[name].points, meshes[name].quads)
            stress = {key: rows for key, rows in stress.items() if rows.body != name}
    if all(body.local is None for body in model.bodies.values()):
        raise ModelError(
            "a bladed disk needs a local basis of blade and disk, and no body of the model has one; create it with "
            "bladed_disk(wheel=LocalSizes()) of bdamper.fem, or with build_model(sector=Sector(blade_nodes=...))"
        )
    return as_checked(replace(model, bodies=bodies, meshes=meshes, stress=stress))


# ---- Structure ----

KEPT = 8
"""Number of root shapes, the most important ones, whose coupling to neighbours the elimination
includes.  On the shipped disk (9 points, 16 shapes) with one harmonic 16, 8, 6 and 4 take 3, 3, 3
and 4 iterations to 1e-2.  With three harmonics 16, 8 and 6 take 29, 36 and 104 to 1e-4.  The cost
of the ring grows with the third power of this number.  The reduced disk
(:mod:`bdamper.mistuning.peak_search`) includes only the family's shape with one harmonic, with the
same total number of evaluations; with three harmonics that leaves 1e-3 after 80 iterations, while
eight shapes leave 1e-7 after 17."""


@short_repr
@dataclass(frozen=True, eq=False)
class Structure:
    """Matrices of a bladed disk, without contact laws and loads.

    Parameters
    ----------
    tuned : Problem
        Study of one sector that spans the same space.
    local : LocalBasis
        Local basis with the root shapes in reverse order, the most important one last.
    order : (n,) int
        Indices of its coordinates in the basis of the model.
    n_blades, n_damper : int
        Number of sectors, and of coordinates of a damper.
    stiffness : (n_blades, n, n) float
        Stiffness of every blade, with mistuning.
    mass : (n, n) float
    disk_stiffness, disk_mass : (n_blades, r, r) complex
        Matrices of every nodal diameter from 0 to N - 1.
    damping : (n_blades, n, n) complex
        Damping of the tuned modes at every nodal diameter.
    damper_stiffness, damper_damping : (n_damper,) float
    damper_mass : (n_blades, n_damper) float
    rows : (n_points, 3, n + n_damper) float
        Relative motion (u1, u2, v) at the points of one sector, by blade and damper coordinates.
    sector : (n_points,) int
        Offset of the sector of the point's blade: 0 or 1.
    n_kept : int
        Number of the last blade coordinates whose coupling to neighbours the elimination includes.
    """

    tuned: Problem
    local: LocalBasis
    order: NDArray
    n_blades: int
    n_damper: int
    stiffness: NDArray
    mass: NDArray
    disk_stiffness: NDArray
    disk_mass: NDArray
    damping: NDArray
    damper_stiffness: NDArray
    damper_mass: NDArray
    damper_damping: NDArray
    rows: NDArray
    sector: NDArray
    n_kept: int = KEPT

    @property
    def n(self) -> int:
        """Number of coordinates of a blade."""
        return len(self.mass)

    @property
    def n_root(self) -> int:
        """Number of root shapes: the last coordinates of a blade, which the disk couples."""
        return self.disk_stiffness.shape[1]

    @property
    def damping_ratio(self) -> float:
        """Smallest damping ratio of the tuned modes."""
        ratio = self.tuned.settings.damping_ratio
        return float(np.min(self.local.damping_ratio if ratio is None else ratio))

    def motion(self, x: NDArray) -> NDArray:
        """Return the motion of the contact points (n_blades, n_points, 3) for coordinates
        (n_blades, n_sector)."""
        ahead = np.concatenate([np.roll(x[:, : self.n], -1, axis=0), x[:, self.n :]], axis=1)
        return np.where(
            self.sector[:, None] == 1, *(np.einsum("pij,nj->npi", self.rows, z) for z in (ahead, x))
        )

    def gathered(self, force: NDArray) -> NDArray:
        """Return the forces on the coordinates (n_blades, n_sector) for forces at the points
        (n_blades, n_points, 3)."""
        own, ahead = (
            np.einsum("pij,npi->nj", self.rows[p], force[:, p])
            for p in (self.sector == s for s in (0, 1))
        )
        return own + np.concatenate(
            [np.roll(ahead[:, : self.n], 1, axis=0), ahead[:, self.n :]], axis=1
        )

    @property
    def n_sector(self) -> int:
        """Number of coordinates of a blade and a damper."""
        return self.n + self.n_damper

    @classmethod
    def of(cls, study: Problem) -> Structure:
        """Return the structure with nominal blades and dampers and the settings of a study.

        Parameters
        ----------
        study : Problem

        Raises
        ------
        SettingError
            If the study has settings that a bladed disk does not support.
        ModelError
            If the model has no local basis.
        """
        tuned = tuned_problem(study)
        model, N = tuned.coupling.model, tuned.coupling.model.n_blades
        blade = next(body for body in model.bodies.values() if body.local is not None)
        assert blade.local is not None
        local, order = _reversed(blade.local)
        rows, sector = _rows(tuned, blade.name, local)
        waves = np.arange(N)
        folded, reverse = np.minimum(waves, N - waves), waves > N - waves

        def all_nodal_diameters(matrices: NDArray) -> NDArray:
            full = np.asarray(matrices, complex)[folded]
            full[reverse] = full[reverse].conj()
            return full

        ratio = (
            None if tuned.settings.damping_ratio is None else float(tuned.settings.damping_ratio)
        )
        damping = all_nodal_diameters(
            np.array([local.damping(d, ratio) for d in range(N // 2 + 1)])
        )
        if tuned.settings.aerodynamic_damping is not None:
            raise SettingError(
                "aerodynamic_damping is not supported by a bladed disk with all sectors; set it to None"
            )
        basis = tuned.damped(tuned.coupling.basis(1), None)
        of_damper = np.array([c.body != blade.name for c in basis.coordinates], bool)
        return cls(
            tuned=tuned,
            local=local,
            order=order,
            n_blades=N,
            n_damper=int(of_damper.sum()),
            stiffness=_blades(local, Mistuning.of(N, None)),
            mass=local.blade_mass,
            disk_stiffness=all_nodal_diameters(local.disk_stiffness),
            disk_mass=all_nodal_diameters(local.disk_mass),
            damping=damping,
            damper_stiffness=basis.omega2[of_damper],
            damper_mass=np.tile(basis.mass[of_damper], (N, 1)),
            damper_damping=basis.damping[of_damper],
            rows=rows,
            sector=sector,
        )

    def varied(self, mistuning: Mistuning, factor: NDArray) -> Structure:
        """Return the same disk with mistuned blades, and with the damper masses multiplied by
        ``factor`` (n_blades,)."""
        return replace(
            self,
            stiffness=_blades(self.local, mistuning),
            damper_mass=self.damper_mass[:1] * factor[:, None],
        )

    def reduced(self, shapes: NDArray) -> Structure:
        """Reduce every blade to m shapes, the columns of ``shapes`` (n, m) in its coordinates.

        The disk then couples all coordinates of a blade to its neighbours, since all shapes move
        the root.
        """
        T, root = shapes.T, shapes[self.n - self.n_root :]
        return replace(
            self, stiffness=T @ self.stiffness @ shapes, mass=T @ self.mass @ shapes, damping=T @ self.damping @ shapes,
            disk_stiffness=root.T @ self.disk_stiffness @ root, disk_mass=root.T @ self.disk_mass @ root,
            rows=np.concatenate([self.rows[..., : self.n] @ shapes, self.rows[..., self.n :]], axis=2),
            n_kept=KEPT if max(self.tuned.settings.active_harmonics) > 1 else 1,
        )  # fmt: skip

    def wave(self, d: int, springs: NDArray) -> tuple[NDArray, NDArray, NDArray]:
        """Solve the eigenvalue problem of a travelling wave of mean blades, with springs at the
        contact points.

        Returns
        -------
        squares : (n_sector,) float
            Squared natural frequencies.
        phi, motion : (n_sector, n_sector), (3 n_points, n_sector) complex
            Modes, and their motion at the points.
        """
        n, root = self.n, slice(self.n - self.n_root, self.n)
        K = scipy.linalg.block_diag(
            self.stiffness.mean(axis=0), np.diag(self.damper_stiffness)
        ).astype(complex)
        M = scipy.linalg.block_diag(self.mass, np.diag(self.damper_mass.mean(axis=0))).astype(
            complex
        )
        K[root, root] += self.disk_stiffness[d]
        M[root, root] += self.disk_mass[d]
        G = self.rows.astype(complex)
        G[..., :n] *= np.exp(2j * np.pi * d * self.sector / self.n_blades)[:, None, None]
        G = G.reshape(-1, self.n_sector)
        squares, phi = scipy.linalg.eigh(K + G.conj().T @ (springs.reshape(-1, 1) * G), M)
        return squares, phi, G @ phi

    def elastic_forces(self, x: NDArray) -> NDArray:
        """Return the static forces of blades and disk (n_blades, n) at coordinates
        (n_blades, n)."""
        out = np.einsum("nij,nj->ni", self.stiffness, x)
        wave = np.fft.fft(x[:, self.n - self.n_root :], axis=0)
        out[:, self.n - self.n_root :] += np.fft.ifft(
            np.einsum("dij,dj->di", self.disk_stiffness, wave), axis=0
        ).real
        return out

    def location_rows(
        self, location: str, direction: str | Sequence[float], setting: str
    ) -> NDArray:
        """Return the row (n,) of the motion of a blade location along a direction."""
        if self.local.locations.get(location) is None:
            body = self.tuned.model.locations[location].body
            raise SettingError(
                f"{setting}: expected a location on the blade, found '{location}' on '{body}'"
            )
        return np.asarray(
            direction_vector(direction, f"{setting} direction") @ self.local.locations[location]
        )

    def modes(self, d: int) -> NDArray:
        """Return the modes (n, n) of the tuned study at a nodal diameter, in the coordinates of
        this structure."""
        local = next(
            body.local for body in self.tuned.model.bodies.values() if body.local is not None
        )
        return np.asarray(local.modes(d)[1][self.order])


def tuned_problem(study: Problem) -> Problem:
    """Return the study of one sector with all modes of the local basis.

    If the contact stiffness is computed by a method, the attachment modes contain the flexibility
    of the contacts.  The contact stiffness then represents the flexibility that the local basis
    leaves out, by unit tractions.  Given values are used unchanged.  This flexibility is computed
    for nominal blades.  Division by ``(1 + eps)**2`` would be exact; it changes the stuck
    frequencies of disks of five to eight blades with deviations of 5 % by at most 0.05 %
    (family 1: 0.01 %).
    """
    required = {"fundamental_modes_only": False, "separation": True, "variable_normal_load": True}
    for name, value in required.items():
        if getattr(study.settings, name) != value:
            raise SettingError(
                f"{name} must be {value!r} for a bladed disk, found {getattr(study.settings, name)!r}"
            )
    refuse(study.own_laws, "a bladed disk")
    speed = study.settings.speed
    if speed and all(body.local is None for body in study.model.bodies.values()):
        raise SettingError(
            f"speed: the modes of a bladed disk are known without rotation, found {speed:g} rad/s; pass the study without "
            "at_speed, and the preload of this speed to the disk"
        )
    if np.any(study.coupling.closing_by_rotation()):
        warn(
            "bladed disk: modes and faces at standstill, although rotation displaces the faces of this model"
        )
    model = local_model(study.model)
    local = next(body.local for body in model.bodies.values() if body.local is not None)
    stiffness = study.settings.contact_stiffness
    if stiffness is None or stiffness == "residual_modes" or isinstance(stiffness, ResidualModes):
        stiffness = "model" if local.flexibility is None else "unit_traction"
    return study.replace(model=model, blade_modes=local.n, contact_stiffness=stiffness)


def _reversed(local: LocalBasis) -> tuple[LocalBasis, NDArray]:
    """Return the basis with the root shapes in reverse order, and the order of its coordinates."""
    n, r = local.n, local.n_interface
    order = np.concatenate([np.arange(n - r), np.arange(n - 1, n - r - 1, -1)])
    basis = replace(
        local,
        blade_stiffness=local.blade_stiffness[np.ix_(order, order)],
        blade_mass=local.blade_mass[np.ix_(order, order)],
        disk_stiffness=local.disk_stiffness[:, ::-1, ::-1],
        disk_mass=local.disk_mass[:, ::-1, ::-1],
        contact_modes=np.ascontiguousarray(local.contact_modes[..., order]),
        locations={name: shapes[:, order] for name, shapes in local.locations.items()},
    )
    return basis, order


def _blades(local: LocalBasis, mistuning: Mistuning) -> NDArray:
    """Return the stiffness (n_blades, n, n) of every mistuned blade."""
    out = np.repeat(local.blade_stiffness[None], mistuning.n_blades, axis=0)
    m = local.n_cantilever
    modes, rest = mistuning.by_mode(m)
    out[:, m:, m:] *= 1.0 + rest[:, None, None]
    k = np.arange(m)
    out[:, k, k] = local.omega2 * (1.0 + modes)
    return out


def _rows(tuned: Problem, blade: str, local: LocalBasis) -> tuple[NDArray, NDArray]:
    """Return the relative motion at the points by sector coordinates (n_points, 3, n_sector), and
    the sector offset (n_points,) of their blade.
    """
    coupling = tuned.coupling
    n_points = coupling.n_points
    sector, blade_rows, damper_rows = np.zeros(n_points, int), np.zeros((n_points, 3, local.n)), []
    for body in coupling.model.bodies.values():
        if body.kind == "ground":
            continue
        modes = coupling.modes[body.name]
        shapes = (
            local.contact_modes
            if body.name == blade
            else body.bases[0].contact_modes[..., modes].real
        )
        previous, own, following = (coupling.placed(body, shapes, 0, (s,)).real for s in (-1, 0, 1))
        if previous.any() or (body.name != blade and following.any()):
            raise SettingError(
                f"model: the dampers of a bladed disk must be in sector 0, between the blades of sectors 0 and 1; "
                f"'{body.name}' is in another sector"
            )
        if body.name != blade:
            damper_rows.append(own)
            continue
        on_following = following.any(axis=(1, 2))
        if np.any(own.any(axis=(1, 2)) & on_following):
            raise SettingError(
                "model: blades of a bladed disk may touch dampers only, found blades that touch each other"
            )
        sector[on_following] = 1
        blade_rows += own + following
    return np.concatenate([blade_rows, *damper_rows], axis=2), sector


# ---- Equations ----

NEUTRAL = 1e-8
"""Springs on the mean of damper coordinates in the Jacobian alone, relative to the stuck
stiffness.  A damper in full slip is free along its axis, which would make the matrix of its sector
singular.  The springs change Newton steps by this relative amount, but not the solutions."""


@dataclass(frozen=True)
class InWidths(InFrequency):
    """Units with the frequency unit limited to some widths of the narrowest resonance.

    Parameters
    ----------
    n_mean : int
    narrowest : float
        Width of the narrowest resonance, relative to its frequency.
    """

    narrowest: float = 0.0

    def units(self, y: NDArray, vibration: float, width: float) -> NDArray:
        """Return the units of the unknowns and the frequency."""
        # with the width of the interval as the unit, the first step along a curve of a lumped disk
        # of six blades passes over all its resonances
        widths = 10.0
        return super().units(y, vibration, min(width, widths * self.narrowest * y[-1] or width))


@dataclass(frozen=True, eq=False)
class DiskScene:
    """Data of the equations of one bladed disk at one preload.

    Parameters
    ----------
    structure : Structure
    points : PointArrays
        Contact points of all sectors, sector by sector, with the relative motion that the
        coordinates do not represent.
    harmonics : collection of int
        Harmonics among the unknowns.
    load : (n_blades, n_sector) float
        Static forces.
    excitation : (n_blades, n_sector) complex
        Forces of the first harmonic.
    response_row : (n,) float
        Row of the response by blade coordinates.
    missing : (n_blades,) bool
        Missing dampers, whose coordinates stay zero.
    force_scale : (2,) float
        Scales of the residual of the mean and of the harmonics.
    mean : (n_blades, n_sector) float
        Static state, at which holding springs have no force.
    contact_forces : {"event_driven"} or AFT
    holding : float
        Holding springs on the mean of dampers, relative to their stuck stiffness.
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
        """Number of blades, of Fourier coefficients, and of coordinates of a sector."""
        return self.structure.n_blades, 2 * max(1, *self.harmonics) + 1, self.structure.n_sector

    @cached_property
    def layout(self) -> Layout:
        """Layout of the harmonics among the unknowns."""
        N, n_coef, size = self.shape
        return Layout(
            np.array([N * size * (l in self.harmonics) for l in range(n_coef // 2 + 1)], np.intc)
        )

    @cached_property
    def active(self) -> NDArray:
        """Whether each Fourier coefficient is an unknown, (n_coefficients,) bool."""
        return np.repeat(self.layout.n_mode > 0, 2)[1:]

    @cached_property
    def force(self) -> NDArray:
        """Static load and excitation, (n_unknowns,)."""
        force = np.zeros(self.shape)
        force[:, 0] = self.load
        force[:, 1], force[:, 2] = self.excitation.real, -self.excitation.imag
        force[self.missing, :, self.structure.n :] = 0.0
        return self.flat(force)

    @cached_property
    def at_rest(self) -> NDArray:
        """Static state as unknowns (n_unknowns,), without vibration."""
        return self.flat(np.pad(self.mean[:, None], ((0, 0), (0, self.shape[1] - 1), (0, 0))))

    def flat(self, X: NDArray) -> NDArray:
        """Return the unknowns (n_unknowns,) from an array (n_blades, n_coefficients, n_sector)."""
        return np.ascontiguousarray(X.transpose(1, 0, 2)[self.active]).ravel()

    def array(self, u: NDArray) -> NDArray:
        """Return the array (n_blades, n_coefficients, n_sector) from unknowns (n_unknowns,)."""
        out = np.zeros((self.shape[1], self.shape[0], self.shape[2]))
        out[self.active] = u.reshape(-1, self.shape[0], self.shape[2])
        return out.transpose(1, 0, 2)

    def responses(self, u: NDArray) -> NDArray:
        """Return the complex response of all blades (n_blades, n_harmonics + 1), the mean first."""
        x = self.array(u)[..., : self.structure.n] @ self.response_row
        return np.column_stack([x[:, 0], x[:, 1::2] - 1j * x[:, 2::2]])

    def units_about(self, y: NDArray, width: float) -> NDArray:
        """Return the units for a point that may be at rest, with ``width`` (rad/s) as the unit of
        frequency."""
        n = int(self.layout.n_mode[0])
        measure, least = InFrequency(n), max(1e-3 * float(np.abs(y[:n]).max(initial=0.0)), 1e-12)
        return measure.units(y, max(measure.vibration(y), least), width)

    @cached_property
    def stuck(self) -> NDArray:
        """Stiffness (n_blades, n_damper) of the stuck contacts of each damper for its own
        coordinates."""
        s, points = self.structure, self.points
        k = np.concatenate([points.kt, points.kn[:, None]], axis=1).reshape(s.n_blades, -1)
        springs = k @ s.rows[..., s.n :].reshape(k.shape[1], -1) ** 2
        return np.maximum(springs, 1e-6 * springs.max(initial=1e-300))

    def _core(self) -> WheelCore:
        """Create the equations of the core, from arrays of the required types."""
        s, points, half = self.structure, self.points, self.structure.n_blades // 2 + 1
        stuck = self.stuck
        mode, n_time = evaluation_code(
            self.contact_forces, self.shape[1] // 2, np.asarray(points.law)
        )
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
        inputs: dict[str, Any] = {
            k: np.ascontiguousarray(v, kinds.get(k, float)) if np.ndim(v) else v
            for k, v in arrays.items()
        }
        return WheelCore(**inputs, evaluation=mode, n_time=n_time)

    def _response(self, blade: int) -> dict[str, Any]:
        """Return the response rows of one blade, as fields of the equations."""
        row = np.zeros((self.shape[0], self.shape[2]))
        row[blade, : self.structure.n] = self.response_row
        rows = [row.ravel() * (n > 0) if n else np.zeros(0) for n in self.layout.n_mode]
        first = (
            self.layout.parts(rows[1]) if len(rows[1]) else np.zeros((2, self.layout.n_unknowns))
        )
        return {"response_rows": rows, "rows": Rows(np.array([first]))}

    @property
    def equations(self) -> DiskSystem:
        """Equations at any frequency, with the response of the first blade."""
        N, n_coef, size = self.shape
        contact = 28e3 * len(self.points.kn) * n_coef
        dense = 2000  # largest number of unknowns for which the full matrix (32 MB) may be formed
        return Equations(
            core=self._core(), structure=self, layout=self.layout, **self._response(0),
            measure=InWidths(int(self.layout.n_mode[0]), 2.0 * self.structure.damping_ratio),
            row_scale=row_scale(self.layout, self.force_scale), n_points=len(self.points.kn),
            forms_matrix=self.layout.n_unknowns <= dense,
            work=1e-6 * np.array([contact, 0.0, 4.0 * N * (n_coef * size) ** 3, 0.0]),  # elimination sector by sector
        )  # fmt: skip

    def held(self, springs: float) -> DiskSystem:
        """Return the equations with holding springs on the mean of dampers, of ``springs`` times
        their stuck stiffness."""
        return replace(self, holding=springs).equations


DiskSystem = Equations[DiskScene]
"""Equations of a bladed disk; the response is the motion of one blade."""


def of_blade(system: DiskSystem, blade: int) -> DiskSystem:
    """Return the same equations with the response of another blade."""
    return replace(system, **system.structure._response(blade))
