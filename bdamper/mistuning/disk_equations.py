r"""Matrices and harmonic balance equations of a mistuned bladed disk with all its sectors.

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

**Support springs** are auxiliary springs that hold the mean of dampers at its static position.  A
damper in full slip is free along its axis, and the springs make the equations easier to solve.
Their solutions are initial guesses for the solutions without springs (:mod:`bdamper.mistuning.peak`).
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
from bdamper.model.structure import Body, Model, SurfaceMesh
from bdamper.model.validation import as_checked
from bdamper.util import validation
from bdamper.util.errors import ModelError, SettingError, warn
from bdamper.util.formatting import short_repr


def local_model(model: Model) -> Model:
    """Return the model with all modes of its local basis at every nodal diameter from 0 to N/2.

    The basis of a study with all these ``blade_modes`` spans the same space as the basis of the
    bladed disk.  Mode shapes for plots, stress rows and the dependence on rotor speed refer to the replaced modes and
    are omitted.

    Raises
    ------
    ModelError
        If no body of the model has a local basis.
    """
    between_blades = [
        name for name, interface in model.interfaces.items() if interface.body_a == interface.body_b
    ]
    if between_blades:
        raise ModelError(
            "a bladed disk: expected contacts between blades and dampers only, found "
            f"'{between_blades[0]}' between blades; compute the tuned disk"
        )
    if all(body.local is None for body in model.bodies.values()):
        raise ModelError(
            "a bladed disk needs a local basis of blade and disk, and no body of the model has "
            "one; create it with bladed_disk(wheel=LocalSizes()) of bdamper.fem, or with "
            "build_model(sector=Sector(blade_nodes=...))"
        )
    bodies = dict(model.bodies)
    meshes = dict(model.meshes)
    stress = dict(model.stress)
    nodal_diameters = range(model.n_blades // 2 + 1)
    for name, body in model.bodies.items():
        if body.local is None:
            continue
        bases = {d: body.local.nodal_diameter(d) for d in nodal_diameters}
        bodies[name] = replace(body, bases=bases)
        # shapes of a mesh and rows of stress belong to the modes that are replaced
        if name in meshes:
            meshes[name] = SurfaceMesh(meshes[name].points, meshes[name].quads)
        stress = {key: rows for key, rows in stress.items() if rows.body != name}
    return as_checked(replace(model, bodies=bodies, meshes=meshes, stress=stress))


def blade_of(model: Model) -> Body:
    """Return the body that carries the local basis; the model must have a local basis."""
    return next(body for body in model.bodies.values() if body.local is not None)


# ---- Matrices ----

KEPT = 8
"""Number of root shapes, the most important ones, for which the elimination retains the coupling to
neighbouring blades.  On the shipped disk (9 points, 16 shapes) with one harmonic 16, 8, 6 and 4 take 3, 3, 3
and 4 iterations to 1e-2.  With three harmonics 16, 8 and 6 take 29, 36 and 104 to 1e-4.  The cost
of the ring grows with the third power of this number.  The reduced disk
(:mod:`bdamper.mistuning.peak_search`) includes only the family's shape with one harmonic, with the
same total number of evaluations; with three harmonics that leaves 1e-3 after 80 iterations, while
eight shapes leave 1e-7 after 17."""


@short_repr
@dataclass(frozen=True, eq=False)
class DiskMatrices:
    """Matrices of a bladed disk, without contact laws and loads.

    Parameters
    ----------
    tuned : Problem
        Study of one sector whose basis spans the same space.
    local : LocalBasis
        Local basis, with the root shapes in reverse order, so that the most important one is last.
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
        Relative motion (u1, u2, v) at the points of one sector, in terms of blade and damper
        coordinates.
    sector : (n_points,) int
        Offset of the sector of the point's blade: 0 or 1.
    n_kept : int
        Number of trailing blade coordinates for which the elimination retains the coupling to
        neighbouring blades.
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
        if ratio is None:
            return float(np.min(self.local.damping_ratio))
        return float(np.min(ratio))

    def motion(self, x: NDArray) -> NDArray:
        """Return the motion of the contact points for coordinates (n_blades, n_sector).

        The result has the shape (n_blades, n_points, 3).
        """
        # points on the following blade move with blade n + 1, but with damper n
        following_blade = np.roll(x[:, : self.n], -1, axis=0)
        x_following = np.concatenate([following_blade, x[:, self.n :]], axis=1)
        motion_own = np.einsum("pij,nj->npi", self.rows, x)
        motion_following = np.einsum("pij,nj->npi", self.rows, x_following)
        return np.where(self.sector[:, None] == 1, motion_following, motion_own)

    def gathered(self, force: NDArray) -> NDArray:
        """Return the forces on the coordinates for forces at the points (n_blades, n_points, 3).

        The result has the shape (n_blades, n_sector).
        """
        on_own = self.sector == 0
        on_following = self.sector == 1
        of_own = np.einsum("pij,npi->nj", self.rows[on_own], force[:, on_own])
        of_following = np.einsum("pij,npi->nj", self.rows[on_following], force[:, on_following])
        # points on the following blade load blade n + 1, but damper n
        on_blade = np.roll(of_following[:, : self.n], 1, axis=0)
        on_damper = of_following[:, self.n :]
        return of_own + np.concatenate([on_blade, on_damper], axis=1)

    @property
    def n_sector(self) -> int:
        """Number of coordinates of a blade and a damper."""
        return self.n + self.n_damper

    @classmethod
    def of(cls, study: Problem) -> DiskMatrices:
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
        model = tuned.coupling.model
        N = model.n_blades
        blade = blade_of(model)
        assert blade.local is not None
        local, order = _most_important_last(blade.local)
        rows, sector = _rows(tuned, blade.name, local)
        ratio = tuned.settings.damping_ratio
        if ratio is not None:
            ratio = float(ratio)
        damping = np.array([local.damping(d, ratio) for d in range(N // 2 + 1)])
        if tuned.settings.aerodynamic_damping is not None:
            raise SettingError(
                "aerodynamic_damping is not supported by a bladed disk with all sectors; set it to "
                "None"
            )
        # only the entries of the dampers matter below, and they are the same at every harmonic; a
        # wave has an effect only with aerodynamic damping, refused above
        basis = tuned.damped(tuned.coupling.basis(harmonic=1), wave=None)
        of_damper = np.array([c.body != blade.name for c in basis.coordinates], bool)
        return cls(
            tuned=tuned,
            local=local,
            order=order,
            n_blades=N,
            n_damper=int(of_damper.sum()),
            stiffness=_blades(local, Mistuning.of(N, mistuning=None)),
            mass=local.blade_mass,
            disk_stiffness=_all_waves(local.disk_stiffness, N),
            disk_mass=_all_waves(local.disk_mass, N),
            damping=_all_waves(damping, N),
            damper_stiffness=basis.omega2[of_damper],
            damper_mass=np.tile(basis.mass[of_damper], (N, 1)),
            damper_damping=basis.damping[of_damper],
            rows=rows,
            sector=sector,
        )

    def varied(self, mistuning: Mistuning, factor: NDArray) -> DiskMatrices:
        """Return the same disk with mistuned blades, and with the damper masses multiplied by
        ``factor`` (n_blades,)."""
        return replace(
            self,
            stiffness=_blades(self.local, mistuning),
            damper_mass=self.damper_mass[:1] * factor[:, None],
        )

    def reduced(self, shapes: NDArray) -> DiskMatrices:
        """Reduce every blade to m shapes, the columns of ``shapes`` (n, m) in its coordinates.

        The disk then couples all coordinates of a blade to its neighbours, because all shapes move
        the root.
        """
        root = shapes[self.n - self.n_root :]
        blade_rows = self.rows[..., : self.n] @ shapes
        damper_rows = self.rows[..., self.n :]
        has_higher_harmonics = max(self.tuned.settings.active_harmonics) > 1
        return replace(
            self,
            stiffness=shapes.T @ self.stiffness @ shapes,
            mass=shapes.T @ self.mass @ shapes,
            damping=shapes.T @ self.damping @ shapes,
            disk_stiffness=root.T @ self.disk_stiffness @ root,
            disk_mass=root.T @ self.disk_mass @ root,
            rows=np.concatenate([blade_rows, damper_rows], axis=2),
            n_kept=KEPT if has_higher_harmonics else 1,
        )

    def wave(self, d: int, springs: NDArray) -> tuple[NDArray, NDArray, NDArray]:
        """Solve the eigenvalue problem of one travelling wave with springs at the contact points.

        All blades have the mean stiffness of the blades.

        Returns
        -------
        squares : (n_sector,) float
            Squared natural frequencies.
        phi, motion : (n_sector, n_sector), (3 n_points, n_sector) complex
            Modes, and their motion at the points.
        """
        blade_stiffness = self.stiffness.mean(axis=0)
        damper_stiffness = np.diag(self.damper_stiffness)
        damper_mass = np.diag(self.damper_mass.mean(axis=0))
        stiffness = scipy.linalg.block_diag(blade_stiffness, damper_stiffness).astype(complex)
        mass = scipy.linalg.block_diag(self.mass, damper_mass).astype(complex)
        root = slice(self.n - self.n_root, self.n)
        stiffness[root, root] += self.disk_stiffness[d]
        mass[root, root] += self.disk_mass[d]
        # the following blade is ahead by the phase of the wave over one sector
        phase = np.exp(2j * np.pi * d * self.sector / self.n_blades)
        motion_rows = self.rows.astype(complex)
        motion_rows[..., : self.n] *= phase[:, None, None]
        motion_rows = motion_rows.reshape(-1, self.n_sector)
        contact_stiffness = motion_rows.conj().T @ (springs.reshape(-1, 1) * motion_rows)
        squares, phi = scipy.linalg.eigh(stiffness + contact_stiffness, mass)
        return squares, phi, motion_rows @ phi

    def elastic_forces(self, x: NDArray) -> NDArray:
        """Return the static forces of blades and disk (n_blades, n) at coordinates
        (n_blades, n)."""
        root = slice(self.n - self.n_root, self.n)
        force = np.einsum("nij,nj->ni", self.stiffness, x)
        # the disk couples the roots of all blades; for each travelling wave it is one matrix
        wave = np.fft.fft(x[:, root], axis=0)
        wave_force = np.einsum("dij,dj->di", self.disk_stiffness, wave)
        force[:, root] += np.fft.ifft(wave_force, axis=0).real
        return force

    def location_rows(
        self, location: str, direction: str | Sequence[float], setting: str
    ) -> NDArray:
        """Return the row (n,) of the motion of a blade location along a direction."""
        shapes = self.local.locations.get(location)
        if shapes is None:
            body = self.tuned.model.locations[location].body
            raise SettingError(
                f"{setting}: expected a location on the blade, found '{location}' on '{body}'"
            )
        return np.asarray(direction_vector(direction, f"{setting} direction") @ shapes)

    def modes(self, d: int) -> NDArray:
        """Return the modes (n, n) of the tuned study at a nodal diameter, in the coordinates of
        this structure."""
        local = blade_of(self.tuned.model).local
        assert local is not None
        _, phi = local.modes(d)
        return np.asarray(phi[self.order])


def tuned_problem(study: Problem) -> Problem:
    """Return the study of one sector with all modes of the local basis.

    If the contact stiffness is computed by a method, the attachment modes contain the flexibility
    of the contacts.  The contact stiffness then represents the flexibility that the local basis
    omits, by unit tractions.  Given values are used unchanged.  This flexibility is computed for
    nominal blades.  Division by ``(1 + eps)**2`` would be exact; it changes the stuck frequencies
    of disks of five to eight blades with deviations of 5 % by at most 0.05 % (family 1: 0.01 %).
    """
    required = {"fundamental_modes_only": False, "separation": True, "variable_normal_load": True}
    for name, value in required.items():
        setting = getattr(study.settings, name)
        if setting != value:
            raise SettingError(f"{name} must be {value!r} for a bladed disk, found {setting!r}")
    refuse(study.own_laws, "a bladed disk")
    speed = study.settings.speed
    if speed and all(body.local is None for body in study.model.bodies.values()):
        raise SettingError(
            "speed: modes of a bladed disk are available only at rest, found "
            f"{speed:g} rad/s; create the disk from the study without at_speed, and use the "
            "preload at this speed"
        )
    if np.any(study.coupling.closing_by_rotation()):
        warn(
            "bladed disk: modes and faces at standstill, although rotation displaces the faces of "
            "this model"
        )
    rings = [name for name, body in study.model.bodies.items() if body.kind == "ring"]
    validation.check(not rings, "bladed disk", "dampers between two blades each", f"rings {rings}")
    model = local_model(study.model)
    local = blade_of(model).local
    assert local is not None
    stiffness = study.settings.contact_stiffness
    from_residual_modes = stiffness == "residual_modes" or isinstance(stiffness, ResidualModes)
    if study.model.interfaces and (stiffness is None or from_residual_modes):
        stiffness = "model" if local.flexibility is None else "unit_traction"
    return study.replace(model=model, blade_modes=local.n, contact_stiffness=stiffness)


def _all_waves(matrices: NDArray, n_blades: int) -> NDArray:
    """Extend matrices of the nodal diameters 0 to N/2 to 0 to N - 1."""
    waves = np.arange(n_blades)
    nodal_diameter = np.minimum(waves, n_blades - waves)
    all_matrices = np.asarray(matrices, complex)[nodal_diameter]
    # a wave in the opposite direction has the complex conjugate matrix
    opposite = waves > n_blades - waves
    all_matrices[opposite] = all_matrices[opposite].conj()
    return all_matrices


def _most_important_last(local: LocalBasis) -> tuple[LocalBasis, NDArray]:
    """Return the basis with the root shapes in reverse order, and the order of its coordinates.

    The basis begins its root shapes with the most important one.  The elimination couples the last
    coordinates of a blade to its neighbours (``n_kept``), so these must be the most important ones.
    """
    n = local.n
    first_root = n - local.n_interface
    reversed_root = np.arange(n - 1, first_root - 1, -1)
    order = np.concatenate([np.arange(first_root), reversed_root])
    both = np.ix_(order, order)
    basis = replace(
        local,
        blade_stiffness=local.blade_stiffness[both],
        blade_mass=local.blade_mass[both],
        disk_stiffness=local.disk_stiffness[:, ::-1, ::-1],
        disk_mass=local.disk_mass[:, ::-1, ::-1],
        contact_modes=np.ascontiguousarray(local.contact_modes[..., order]),
        locations={name: shapes[:, order] for name, shapes in local.locations.items()},
    )
    return basis, order


def _blades(local: LocalBasis, mistuning: Mistuning) -> NDArray:
    """Return the stiffness (n_blades, n, n) of every mistuned blade."""
    stiffness = np.repeat(local.blade_stiffness[None], mistuning.n_blades, axis=0)
    m = local.n_cantilever
    change_of_modes, change_of_others = mistuning.by_mode(m)
    stiffness[:, m:, m:] *= 1.0 + change_of_others[:, None, None]
    # cantilever modes are not coupled to other coordinates in the stiffness
    k = np.arange(m)
    stiffness[:, k, k] = local.omega2 * (1.0 + change_of_modes)
    return stiffness


def _rows(tuned: Problem, blade: str, local: LocalBasis) -> tuple[NDArray, NDArray]:
    """Return the relative motion at the points by sector coordinates (n_points, 3, n_sector), and
    the sector offset (n_points,) of their blade.
    """
    coupling = tuned.coupling
    n_points = coupling.n_points
    sector = np.zeros(n_points, int)
    blade_rows = np.zeros((n_points, 3, local.n))
    damper_rows = []
    for body in coupling.model.bodies.values():
        if body.kind == "ground":
            continue
        is_blade = body.name == blade
        modes = coupling.modes[body.name]
        shapes = local.contact_modes if is_blade else body.bases[0].contact_modes[..., modes].real
        rows_previous = coupling.placed(body, shapes, harmonic=0, sectors=(-1,)).real
        rows_own = coupling.placed(body, shapes, harmonic=0, sectors=(0,)).real
        rows_following = coupling.placed(body, shapes, harmonic=0, sectors=(1,)).real
        if rows_previous.any() or (not is_blade and rows_following.any()):
            raise SettingError(
                "model: the dampers of a bladed disk must be in sector 0, between the blades of "
                f"sectors 0 and 1; '{body.name}' is in another sector"
            )
        if not is_blade:
            damper_rows.append(rows_own)
            continue
        on_own = rows_own.any(axis=(1, 2))
        on_following = rows_following.any(axis=(1, 2))
        if np.any(on_own & on_following):
            raise SettingError(
                "model: blades of a bladed disk may touch dampers only, found blades that touch "
                "each other"
            )
        sector[on_following] = 1
        blade_rows += rows_own + rows_following
    return np.concatenate([blade_rows, *damper_rows], axis=2), sector


# ---- Equations ----

NEUTRAL = 1e-8
"""Springs on the mean of damper coordinates in the Jacobian alone, relative to the stuck
stiffness.  A damper in full slip is free along its axis, which would make the matrix of its sector
singular.  The springs change Newton steps by this relative amount, but not the solutions."""


@dataclass(frozen=True)
class InWidths(InFrequency):
    """Units of a point, with the unit of frequency limited to a few widths of the narrowest
    resonance.

    Parameters
    ----------
    n_mean : int
    narrowest : float
        Width of the narrowest resonance, relative to its frequency.
    """

    narrowest: float = 0.0

    def units(self, y: NDArray, vibration: float, width: float) -> NDArray:
        """Return the scales of the unknowns and the frequency."""
        # with the width of the interval as the unit, the first step along a curve of a lumped disk
        # of six blades passes over all its resonances
        most_widths = 10.0
        largest = most_widths * self.narrowest * y[-1]
        if largest > 0.0:
            width = min(width, largest)
        return super().units(y, vibration, width)


@dataclass(frozen=True, eq=False)
class DiskScene:
    """Data of the equations of one bladed disk at one preload.

    Parameters
    ----------
    structure : DiskMatrices
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
        Row whose product with the coordinates of a blade is its response.
    missing : (n_blades,) bool
        Missing dampers, whose coordinates stay zero.
    force_scale : (2,) float
        Scales of the residual of the mean and of the harmonics.
    mean : (n_blades, n_sector) float
        Static state, at which support springs have no force.
    contact_forces : {"event_driven"} or AFT
    holding : float
        Support springs on the mean of dampers, relative to their stuck stiffness.
    """

    structure: DiskMatrices
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
        """Numbers of blades, Fourier coefficients and coordinates per sector."""
        highest_harmonic = max(1, *self.harmonics)
        n_coefficients = 2 * highest_harmonic + 1
        return self.structure.n_blades, n_coefficients, self.structure.n_sector

    @cached_property
    def layout(self) -> Layout:
        """Layout of the harmonics among the unknowns."""
        n_blades, n_coef, n_sector = self.shape
        n_mode = np.zeros(n_coef // 2 + 1, np.intc)
        n_mode[list(self.harmonics)] = n_blades * n_sector
        return Layout(n_mode)

    @cached_property
    def active(self) -> NDArray:
        """Whether each Fourier coefficient is an unknown, (n_coefficients,) bool."""
        # two coefficients for each harmonic, but one for the mean
        is_unknown = self.layout.n_mode > 0
        return np.repeat(is_unknown, 2)[1:]

    @cached_property
    def force(self) -> NDArray:
        """Static load and excitation, (n_unknowns,)."""
        # coefficient 0 is the mean, 1 and 2 are cosine and sine of the first harmonic
        force = np.zeros(self.shape)
        force[:, 0] = self.load
        force[:, 1] = self.excitation.real
        force[:, 2] = -self.excitation.imag
        # no forces on missing dampers
        force[self.missing, :, self.structure.n :] = 0.0
        return self.flat(force)

    @cached_property
    def at_rest(self) -> NDArray:
        """Static state as unknowns (n_unknowns,), without vibration."""
        coefficients = np.zeros(self.shape)
        coefficients[:, 0] = self.mean
        return self.flat(coefficients)

    def flat(self, X: NDArray) -> NDArray:
        """Return the unknowns (n_unknowns,) from an array (n_blades, n_coefficients, n_sector)."""
        return np.ascontiguousarray(X.transpose(1, 0, 2)[self.active]).ravel()

    def array(self, u: NDArray) -> NDArray:
        """Return the array (n_blades, n_coefficients, n_sector) from unknowns (n_unknowns,)."""
        n_blades, n_coef, n_sector = self.shape
        by_coefficient = np.zeros((n_coef, n_blades, n_sector))
        by_coefficient[self.active] = u.reshape(-1, n_blades, n_sector)
        return by_coefficient.transpose(1, 0, 2)

    def responses(self, u: NDArray) -> NDArray:
        """Return the complex response of all blades (n_blades, n_harmonics + 1), the mean first."""
        x = self.array(u)[..., : self.structure.n] @ self.response_row
        mean = x[:, 0]
        cosine = x[:, 1::2]
        sine = x[:, 2::2]
        return np.column_stack([mean, cosine - 1j * sine])

    def units_about(self, y: NDArray, width: float) -> NDArray:
        """Return the units for a point that may be at rest, with ``width`` (rad/s) as the unit of
        frequency."""
        n_mean = int(self.layout.n_mode[0])
        measure = InFrequency(n_mean)
        largest_mean = float(np.abs(y[:n_mean]).max(initial=0.0))
        # at rest the unit is a small part of the static displacement
        least = max(1e-3 * largest_mean, 1e-12)
        vibration = max(measure.vibration(y), least)
        return measure.units(y, vibration, width)

    @cached_property
    def stuck(self) -> NDArray:
        """Stiffness (n_blades, n_damper) of the stuck contacts of each damper for its own
        coordinates."""
        matrices = self.structure
        of_points = np.concatenate([self.points.kt, self.points.kn[:, None]], axis=1)
        n_springs = 3 * len(matrices.sector)  # of one sector
        stiffness = of_points.reshape(matrices.n_blades, n_springs)
        damper_rows = matrices.rows[..., matrices.n :].reshape(n_springs, matrices.n_damper)
        # diagonal of rows^T stiffness rows for each sector
        springs = stiffness @ damper_rows**2
        # missing dampers and coordinates without contact get weak springs
        return np.maximum(springs, 1e-6 * springs.max(initial=1e-300))

    def _core(self) -> WheelCore:
        """Create the equations of the core, from arrays of the required types."""
        s = self.structure
        points = self.points
        n_harmonics = self.shape[1] // 2
        stuck = self.stuck
        evaluation, n_time = evaluation_code(
            self.contact_forces, n_harmonics, np.asarray(points.law)
        )
        reference_load = points.n0 if points.load is None else points.load
        # waves in the opposite direction have the complex conjugate matrices
        half = s.n_blades // 2 + 1

        def values(array: NDArray, kind: type = float) -> NDArray:
            return np.ascontiguousarray(array, kind)

        return WheelCore(
            n_sector=s.n_blades,
            n_harm=n_harmonics,
            n_blade=s.n,
            n_damper=s.n_damper,
            n_root=s.n_root,
            n_kept=min(s.n_kept, s.n_root),
            n_point=len(s.sector),
            next=values(s.sector == 1, bool),
            rows=values(s.rows),
            active=values(self.active, bool),
            pinned=values(self.missing, bool),
            stiffness=values(s.stiffness),
            mass=values(s.mass),
            disk_stiffness=values(s.disk_stiffness[:half], complex),
            disk_mass=values(s.disk_mass[:half], complex),
            damping=values(s.damping[:half], complex),
            damper_stiffness=values(s.damper_stiffness),
            damper_mass=values(s.damper_mass),
            damper_damping=values(s.damper_damping),
            springs=values(self.holding * stuck),
            neutral=values(NEUTRAL * stuck),
            home=values(self.mean[:, s.n :]),
            kt=values(points.kt),
            kn=values(points.kn),
            mu=values(points.mu),
            n0=values(points.n0),
            w=values(points.slider),
            load=values(reference_load),
            shift=values(points.shift),
            force=values(self.force),
            row_scale=values(row_scale(self.layout, self.force_scale)),
            law=values(points.law, np.intc),
            evaluation=evaluation,
            n_time=n_time,
        )

    def _response(self, blade: int) -> dict[str, Any]:
        """Return the response rows of one blade, as fields of the equations."""
        N, _, size = self.shape
        row = np.zeros((N, size))
        row[blade, : self.structure.n] = self.response_row
        # empty for harmonics that are no unknowns
        response_rows = [row.ravel() if n > 0 else np.zeros(0) for n in self.layout.n_mode]
        first_harmonic = np.zeros((2, self.layout.n_unknowns))
        if self.layout.n_mode[1] > 0:
            first_harmonic[:] = self.layout.parts(response_rows[1])
        return {"response_rows": response_rows, "rows": Rows(first_harmonic[None])}

    @property
    def equations(self) -> DiskSystem:
        """Equations at any frequency, with the response of the first blade."""
        N, n_coef, size = self.shape
        n_points = len(self.points.kn)
        n_mean = int(self.layout.n_mode[0])
        contact = 28e3 * n_points * n_coef
        elimination = 4.0 * N * (n_coef * size) ** 3  # sector by sector
        dense = 2000  # largest number of unknowns for which the full matrix (32 MB) may be formed
        return Equations(
            core=self._core(),
            structure=self,
            layout=self.layout,
            **self._response(0),
            # a resonance is twice as wide as its damping ratio
            measure=InWidths(n_mean, 2.0 * self.structure.damping_ratio),
            row_scale=row_scale(self.layout, self.force_scale),
            n_points=n_points,
            forms_matrix=self.layout.n_unknowns <= dense,
            work=1e-6 * np.array([contact, 0.0, elimination, 0.0]),
        )

    def held(self, springs: float) -> DiskSystem:
        """Return the equations with support springs on the mean of dampers, of ``springs`` times
        their stuck stiffness."""
        return replace(self, holding=springs).equations


DiskSystem = Equations[DiskScene]
"""Equations of a bladed disk; the response is the motion of one blade."""


def of_blade(system: DiskSystem, blade: int) -> DiskSystem:
    """Return the same equations with the response of another blade."""
    return replace(system, **system.structure._response(blade))
