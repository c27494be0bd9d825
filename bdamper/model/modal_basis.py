r"""Modes of one body, also as functions of rotor speed, and the local basis of mistuned bladed
disks.

``bdamper.model.structure`` describes the conventions.

In the local basis each sector has coordinates along the axes of its blade: amplitudes of the modes
of the blade clamped at its root (cantilever modes), of static shapes of forces at its contact
points (attachment modes), and of shapes of the root, the interface of blade and disk.  Cantilever
and attachment modes do not move the root, so only root shapes couple to the disk.  The disk has one
Hermitian stiffness and mass matrix for each nodal diameter,

.. math:: K(d) = K_B + K_D(d), \quad M(d) = M_B + M_D(d), \quad K_D(N - d) = \overline{K_D(d)} .

A blade whose clamped frequencies differ by the factor 1 + eps has the stiffness
:math:`(1 + eps)^2 K_B`.

Damping is defined by the modes of the tuned disk, with a ratio for each mode at every nodal
diameter.  A study of one sector uses the same rule, so both have the same response.  The damping
matrix

.. math:: C(d) = M \Phi\, \mathrm{diag}(2 \zeta \omega)\, \Phi^H M

couples neighbouring sectors slightly.  Mistuning does not change it.

In the rotating frame, without Coriolis forces,
:math:`K(\Omega) = K_0 + \Omega^2 \Phi^H (K_\sigma - M_s) \Phi` is the modal stiffness at the speed
:math:`\Omega` (:class:`SpeedBasis`), with the geometric stiffness :math:`K_\sigma` of the
centrifugal stress and the mass :math:`M_s` in the plane of rotation, both per squared speed.  The
static receptance is :math:`R_{res,0} + \Omega^2 R_{res,2} + \Phi K(\Omega)^{-1} \Phi^H`, so that
the residual part is positive semi-definite.  A receptance of one speed with frequencies of another
would overestimate it and make contacts too soft.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, Literal

import numpy as np
import scipy  # scipy.optimize loads on first use; it takes a tenth of a second
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.linalg import eigh

from bdamper.util import validation
from bdamper.util.errors import SettingError
from bdamper.util.formatting import short_repr
from bdamper.util.records import Data, Record
from bdamper.util.validation import Limits

MODAL: Any = ("n_modes", "n_modes"), "field"
FLEXIBLE: Any = ("n_forces", "n_forces"), "field"
DAMPING = Limits(least=0.0, below=1.0)
NotNegative = Annotated[float, Data(limits=validation.Limits(least=0.0))]


@short_repr
@dataclass(frozen=True)
class SpeedBasis(Record):
    """Change of stiffness and residual flexibility of one modal basis with rotor speed.

    The stiffness is a polynomial in the squared speed.  The residual flexibility is linear in it
    between the speeds with matrices, because a weighted mean of two flexibilities is positive
    semi-definite as they are, while a polynomial through three is not.

    Parameters
    ----------
    omega_ref : float, rad/s
        Speed of the basis: its :meth:`stiffness` is the diagonal matrix of its ``omega2``.
    stiffness0 : (n_modes, n_modes) complex or float, rad2/s2
        Hermitian modal stiffness at standstill.
    stiffness2 : (n_modes, n_modes) complex or float
        Hermitian; geometric stiffness minus spin softening, per squared speed.
    residual0, residual2 : (3 n_points, 3 n_points) complex or float, m/N and m s2/N, optional
        Hermitian; residual flexibility at standstill and its change per squared speed.  Without
        them the basis has no flexibility at other speeds.
    stiffness4 : (n_modes, n_modes) complex or float, s2/rad2, optional
        Hermitian; coefficient of the fourth power of the speed, if matrices of three speeds are
        given.
    middle : float, rad/s, optional
        Middle one of three speeds.
    residual_above : (3 n_points, 3 n_points) complex or float, m s2/N, optional
        Hermitian; addition to ``residual2`` above the speed ``middle``.
    coriolis : (n_modes, n_modes) complex or float, optional
        Skew-Hermitian ``Phi^H S Phi`` with the Coriolis matrix ``2 Omega S``, only for
        :meth:`coriolis_size`.
    checked_at, error : float, optional
        Highest speed (rad/s) of a comparison with the frequencies of the full model, and the
        largest relative difference at all compared speeds.
    flexibility_error : float, optional
        Largest relative difference from the flexibility of the full model at these speeds.
    source : str
    """

    omega_ref: NotNegative
    stiffness0: Annotated[NDArray, Data("rad2/s2", *MODAL, matrix="Hermitian", derived=True)]
    stiffness2: Annotated[NDArray, Data("1", *MODAL, matrix="Hermitian")]
    residual0: Annotated[NDArray, Data("m/N", *FLEXIBLE, matrix="Hermitian")] | None = None
    residual2: Annotated[NDArray, Data("m s2/N", *FLEXIBLE, matrix="Hermitian")] | None = None
    stiffness4: Annotated[NDArray, Data("s2/rad2", *MODAL, matrix="Hermitian")] | None = None
    middle: NotNegative | None = None
    residual_above: Annotated[NDArray, Data("m s2/N", *FLEXIBLE, matrix="Hermitian")] | None = None
    coriolis: Annotated[NDArray, Data("1", *MODAL, matrix="skew-Hermitian")] | None = None
    checked_at: NotNegative | None = None
    error: NotNegative | None = None
    flexibility_error: NotNegative | None = None
    source: str = ""

    def stiffness(self, omega: float) -> NDArray:
        """Return the modal stiffness (n_modes, n_modes) at a speed (rad/s)."""
        return self.stiffness0 + self.stiffening(omega)

    def stiffening(self, omega: float) -> NDArray:
        """Return the change (n_modes, n_modes) of the modal stiffness from standstill to a speed."""
        matrix: NDArray = omega**2 * self.stiffness2
        if self.stiffness4 is not None:
            matrix = matrix + omega**4 * self.stiffness4
        return matrix

    def residual(self, omega: float) -> NDArray | None:
        """Return the residual flexibility (3 n_points, 3 n_points), m/N, at a speed (rad/s).

        The result is None if it is unknown.
        """
        change = self.residual_change(omega)
        if self.residual0 is None or change is None:
            return None
        return self.residual0 + change

    def residual_change(self, omega: float) -> NDArray | None:
        """Return the change (3 n_points, 3 n_points) of the residual flexibility from standstill.

        The result is None if it is unknown.
        """
        if self.residual2 is None:
            return None
        matrix: NDArray = omega**2 * self.residual2
        if self.residual_above is not None and self.middle is not None:
            matrix = matrix + max(omega**2 - self.middle**2, 0.0) * self.residual_above
        return matrix

    def modes(self, omega: float) -> tuple[NDArray, NDArray]:
        r"""Compute the modes at a speed (rad/s), in the order and with the phases of the basis.

        The eigenproblem :math:`K(\Omega) v = \omega^2 v` gives the modes :math:`\Phi v`.  They are
        assigned by similarity of shape, not by order of frequency, and have the phase that makes
        the projection on the assigned mode real and positive.  Damping ratios and mode numbers thus
        follow the shapes if frequencies cross.

        Returns
        -------
        omega2 : (n_modes,) float
        shapes : (n_modes, n_modes) unitary
            Column ``i`` is the mode most similar to mode ``i`` of the basis.

        Raises
        ------
        SettingError
            If the structure is unstable at this speed.
        """
        omega2, shapes = eigh(self.stiffness(omega))
        unstable = omega2[0] < -1e-12 * omega2[-1]
        found = (
            f"a negative squared frequency at {omega:.6g} rad/s; the stiffness is linear in the "
            "squared speed through the two imported speeds, so import a second one closer to this"
        )
        validation.check(not unstable, "rotor speed", "a stable structure", found)

        # rows are modes of the basis, columns modes at this speed: one column for each row, with
        # the largest sum of squared components
        similarity = np.abs(shapes) ** 2
        _, order = scipy.optimize.linear_sum_assignment(-similarity)
        omega2 = np.maximum(omega2[order], 0.0)
        shapes = shapes[:, order]
        # the projection on the assigned mode becomes real and positive
        overlap = np.diag(shapes)
        size = np.maximum(np.abs(overlap), np.finfo(float).tiny)
        turn_back = np.where(overlap == 0.0, 1.0, overlap.conj() / size)
        return omega2, shapes * turn_back

    def conjugate(self) -> SpeedBasis:
        """Return the complex conjugate basis (nodal diameter ``N - d``)."""
        return replace(
            self,
            stiffness0=_conjugate(self.stiffness0),
            stiffness2=_conjugate(self.stiffness2),
            residual0=_conjugate(self.residual0),
            residual2=_conjugate(self.residual2),
            stiffness4=_conjugate(self.stiffness4),
            residual_above=_conjugate(self.residual_above),
            coriolis=_conjugate(self.coriolis),
        )

    def turned(self, omega: float, shapes: NDArray) -> SpeedBasis:
        """Transform to the modes of another speed.

        Parameters
        ----------
        omega : float, rad/s
        shapes : (n_modes, n_modes) complex or float
            Modes at this speed as combinations of the modes of the basis.
        """
        coriolis = self.coriolis
        if coriolis is not None:
            coriolis = shapes.conj().T @ coriolis @ shapes
        stiffness4 = self.stiffness4
        if stiffness4 is not None:
            stiffness4 = shapes.conj().T @ stiffness4 @ shapes
        return replace(
            self,
            omega_ref=omega,
            stiffness0=shapes.conj().T @ self.stiffness0 @ shapes,
            stiffness2=shapes.conj().T @ self.stiffness2 @ shapes,
            stiffness4=stiffness4,
            coriolis=coriolis,
        )

    def coriolis_size(self, omega: float, omega2: NDArray) -> tuple[NDArray, NDArray]:
        """Estimate the effect of the neglected Coriolis forces on the modes at a speed (rad/s).

        Parameters
        ----------
        omega : float
        omega2 : (n_modes,) float
            Squared frequencies at that speed, for the modes of this basis.

        Returns
        -------
        shift : (n_modes,) float
            Relative change of each frequency, ``Omega |S_ii| / omega_i``.
        mixing : (n_modes,) float
            Largest contribution of another mode, ``Omega |S_ij| / |omega_i - omega_j|``.

        Raises
        ------
        SettingError
            If the basis has no Coriolis matrix.
        """
        if self.coriolis is None:
            raise SettingError("coriolis_size: this basis has no Coriolis matrix")
        size = omega * np.abs(self.coriolis)
        frequency = np.sqrt(omega2)
        # [i, j] between modes i and j; a mode does not mix with itself
        difference = np.abs(frequency[:, None] - frequency)
        np.fill_diagonal(difference, np.inf)
        difference = np.maximum(difference, np.finfo(float).tiny)
        shift = np.diag(size) / frequency
        mixing = (size / difference).max(axis=1, initial=0.0)
        return shift, mixing


def _conjugate(matrix: Any) -> Any:
    """Return the complex conjugate of a matrix, or None for None."""
    return None if matrix is None else matrix.conj()


@short_repr
@dataclass(frozen=True)
class SpinStatic(Record):
    """Static displacement of a body due to its rotation without contact, per squared speed.

    It has the nodal diameter 0.

    Parameters
    ----------
    contact : (n_points, 3) float, m s2
        At the contact points of all ports, in the order of ``Body.ports``, along t1, t2, n.
    locations : mapping of name to (3,) array, m s2
        At the named locations on this body, along X, Y, Z.
    theory : {"linear", "stiffened"}
        Stiffness of the structure at standstill, or at the speed ``omega`` (rad/s).
    omega : float
    """

    contact: Annotated[NDArray, Data("m s2", ("n_points", 3))]
    locations: Annotated[Mapping[str, NDArray], Data("m s2", (3,))] = field(default_factory=dict)
    theory: Literal["linear", "stiffened"] = "linear"
    omega: NotNegative = 0.0


# ---- Modal basis ----


@short_repr
@dataclass(frozen=True)
class ModalBasis(Record):
    """Modes of one body at one nodal diameter.

    Parameters
    ----------
    omega2 : (n_modes,) float, rad2/s2
        Squared natural frequencies, ascending; exactly zero for the rigid-body modes of a free
        body.
    damping_ratio : (n_modes,) float
        Modal damping ratios; zero for rigid-body modes.
    contact_modes : (n_points, 3, n_modes) complex or float, kg^-1/2
        Mass-normalised modes at the contact points of all ports, in the order of ``Body.ports``,
        along t1, t2, n.
    locations : mapping of name to (3, n_modes) array, kg^-1/2
        Modes at the named locations on this body along X, Y, Z.
    flexibility : (3 n_points, 3 n_points) complex or float, m/N, optional
        Hermitian static receptance of the full finite element model between the contact points:
        patch-averaged displacement for patch-averaged force.  For a free body it is the elastic
        deformation with inertia relief, orthogonal to the rigid-body modes in the mass matrix.
    drag : (n_modes,) float, 1/s, optional
        Viscous damping in addition to the damping ratios, for modes without stiffness or beyond
        critical damping.
    speed : SpeedBasis, optional
        Change of stiffness and flexibility with rotor speed.
    static_shapes : int, optional
        Number of static shapes at the end of the modes.  They represent the remaining flexibility
        of the locations, orthogonal to all modes and to each other
        (:mod:`bdamper.model.residual_vectors`).
    """

    omega2: Annotated[NDArray, Data("rad2/s2", ("n_modes",))]
    damping_ratio: Annotated[NDArray, Data("1", ("n_modes",), limits=DAMPING)]
    contact_modes: Annotated[NDArray, Data("kg^-1/2", ("n_points", 3, "n_modes"), "field", "modes")]
    locations: Annotated[Mapping[str, NDArray], Data("kg^-1/2", (3, "n_modes"), "field")] = field(
        default_factory=dict
    )
    flexibility: (
        Annotated[NDArray, Data("m/N", ("n_forces", "n_forces"), "field", matrix="Hermitian")]
        | None
    ) = None
    drag: Annotated[NDArray, Data("1/s", ("n_modes",), limits=Limits(least=0.0))] | None = None
    speed: SpeedBasis | None = None
    static_shapes: Annotated[int, Data(limits=Limits(least=0))] | None = None

    @property
    def n_modes(self) -> int:
        """Number of modes and static shapes."""
        return len(self.omega2)

    @property
    def n_natural(self) -> int:
        """Number of modes without static shapes."""
        return len(self.omega2) - (self.static_shapes or 0)

    def conjugate(self) -> ModalBasis:
        """Return the complex conjugate basis (nodal diameter ``N - d``)."""
        return replace(
            self,
            contact_modes=self.contact_modes.conj(),
            locations={name: modes.conj() for name, modes in self.locations.items()},
            flexibility=_conjugate(self.flexibility),
            speed=None if self.speed is None else self.speed.conjugate(),
        )

    def with_speed(
        self,
        stiffness2: NDArray,
        residual2: NDArray | None = None,
        omega_ref: float = 0.0,
        **others: Any,
    ) -> ModalBasis:
        """Add the speed dependence to the basis, and derive the data at standstill.

        The basis is valid at the speed ``omega_ref``.  For the parameters see
        :class:`~bdamper.model.modal_basis.SpeedBasis`.
        """
        unknown = np.zeros_like(stiffness2)
        changes = SpeedBasis(omega_ref, unknown, stiffness2, None, residual2, **others)
        residual0 = None
        residual_change = changes.residual_change(omega_ref)
        if residual_change is not None and self.flexibility is not None:
            shapes = self.contact_modes.reshape(-1, self.n_modes)
            of_modes = (shapes / self.omega2) @ shapes.conj().T
            residual0 = self.flexibility - of_modes - residual_change
        diagonal = np.diag(self.omega2).astype(stiffness2.dtype)
        stiffness0 = diagonal - changes.stiffening(omega_ref)
        speed = replace(changes, stiffness0=stiffness0, residual0=residual0)
        return replace(self, speed=speed)

    def at_speed(self, omega: float) -> tuple[ModalBasis, NDArray]:
        """Return the basis at a rotor speed (rad/s), with the modes in the same order.

        Returns
        -------
        basis : ModalBasis
        shapes : (n_modes, n_modes)
            Modes at this speed as combinations of the modes of this basis.
        """
        speed = self.speed
        if speed is None or omega == speed.omega_ref:
            return self, np.eye(self.n_modes)
        omega2, shapes = speed.modes(omega)
        contact = self.contact_modes @ shapes
        flexibility = speed.residual(omega)
        if flexibility is not None:
            flat = contact.reshape(-1, self.n_modes)
            flexibility = flexibility + (flat / omega2) @ flat.conj().T
            flexibility = 0.5 * (flexibility + flexibility.conj().T)
        basis = ModalBasis(
            omega2=omega2,
            damping_ratio=self.damping_ratio,
            contact_modes=contact,
            locations={name: modes @ shapes for name, modes in self.locations.items()},
            flexibility=flexibility,
            speed=speed.turned(omega, shapes),
            static_shapes=self.static_shapes,
        )
        return basis, shapes


# ---- Rigid-body motion and phase of shapes ----


def rigid_motions(
    points: NDArray, centre: NDArray, axes: NDArray, turning: NDArray | None = None
) -> NDArray:
    """Return unit translations along ``axes`` and rotations about ``turning`` as columns.

    The result is (3 n_points, 6).

    Parameters
    ----------
    points : (n_points, 3) float, m
    centre : (3,) float, m
        Point on the axes of rotation.
    axes, turning : (3, 3) float
        Axes as rows; ``turning`` is ``axes`` by default.
    """
    if turning is None:
        turning = axes
    # (3 axes, 1, 3) x (n_points, 3) = (3 axes, n_points, 3)
    by_axis = np.cross(turning[:, None], points - centre)
    # point, direction and axis
    rotations = by_axis.transpose(1, 2, 0)
    translations = np.broadcast_to(axes.T, rotations.shape)
    motions = np.concatenate([translations, rotations], axis=2)
    return np.ascontiguousarray(motions).reshape(-1, 6)


def fix_phase(vectors: NDArray, mass: NDArray | sp.spmatrix) -> NDArray:
    """Normalise the phase of each column.

    ``u^T M u`` is then real and positive, which makes the mode as real as possible.  Unlike a rule
    for one component this is continuous if two components are about equally large.  The largest
    component is positive, which fixes the sign.  NaN components have no influence.
    """
    finite = np.nan_to_num(vectors)
    if np.iscomplexobj(vectors):
        square = np.einsum("ij,ij->j", finite, mass @ finite)
        turn_back = np.exp(-0.5j * np.angle(square))
        vectors = vectors * turn_back
        finite = finite * turn_back
    # in a symmetric body several components are equally large up to rounding: use the first of them
    size = np.abs(finite)
    is_largest = size > (1.0 - 1e-6) * size.max(axis=0)
    # argmax finds the first True of each column
    first = is_largest.argmax(axis=0)
    largest = finite[first, np.arange(finite.shape[1])]
    sign = np.where(largest.real < 0.0, -1.0, 1.0)
    return vectors * sign


# ---- Local basis of blade and disk ----


@short_repr
@dataclass(frozen=True)
class LocalBasis(Record):
    """Blade and disk in local coordinates: cantilever modes, attachment modes, root shapes.

    Shapes have the unit kg^-1/2, so coordinates have the unit of mass-normalised modes.  The number
    of coordinates is n = ``n_cantilever + n_attachment + n_interface``.

    Parameters
    ----------
    region : str
        Description of the part of the sector that is the blade.
    omega2 : (n_cantilever,) float, rad2/s2
        Squared frequencies of the blade clamped at its root.
    damping_ratio : (n,) float
        Damping ratios of the modes of the tuned disk in ascending order of frequency, at every
        nodal diameter.
    blade_stiffness, blade_mass : (n, n) float, rad2/s2 and 1
    disk_stiffness, disk_mass : (N // 2 + 1, n_interface, n_interface) complex, rad2/s2 and 1
        Hermitian, for the root shapes; real at nodal diameters 0 and N/2.
    contact_modes : (n_points, 3, n) float, kg^-1/2
        Shapes at the contact points, see :class:`~bdamper.model.modal_basis.ModalBasis`.
    locations : mapping of name to (3, n) array, kg^-1/2
    flexibility : (3 n_points, 3 n_points) float, m/N, optional
        Static receptance between the contact points of the full blade clamped at its root.
    """

    region: str
    omega2: Annotated[NDArray, Data("rad2/s2", ("n_cantilever",), limits=Limits(above=0.0))]
    damping_ratio: Annotated[NDArray, Data("1", ("n",), limits=DAMPING)]
    blade_stiffness: Annotated[NDArray, Data("rad2/s2", ("n", "n"), matrix="symmetric")]
    blade_mass: Annotated[NDArray, Data("1", ("n", "n"), matrix="symmetric")]
    disk_stiffness: Annotated[
        NDArray, Data("rad2/s2", ("n_diameters", "n_interface", "n_interface"), "field")
    ]
    disk_mass: Annotated[NDArray, Data("1", ("n_diameters", "n_interface", "n_interface"), "field")]
    contact_modes: Annotated[NDArray, Data("kg^-1/2", ("n_points", 3, "n"), file="modes")]
    locations: Annotated[Mapping[str, NDArray], Data("kg^-1/2", (3, "n"))] = field(
        default_factory=dict
    )
    flexibility: (
        Annotated[NDArray, Data("m/N", ("n_forces", "n_forces"), matrix="symmetric")] | None
    ) = None

    @property
    def n(self) -> int:
        """Number of coordinates of a sector."""
        return len(self.blade_stiffness)

    @property
    def n_cantilever(self) -> int:
        return len(self.omega2)

    @property
    def n_interface(self) -> int:
        return int(self.disk_stiffness.shape[-1])

    @property
    def n_attachment(self) -> int:
        return self.n - self.n_cantilever - self.n_interface

    def stiffness(self, d: int) -> NDArray:
        """Return K(d), (n, n) Hermitian, real if the disk matrix is; nodal diameters 0 to N/2."""
        return self._with_disk(self.blade_stiffness, self.disk_stiffness[d])

    def mass(self, d: int) -> NDArray:
        """Return M(d), (n, n) Hermitian, real if the disk matrix is."""
        return self._with_disk(self.blade_mass, self.disk_mass[d])

    def _with_disk(self, blade: NDArray, disk: NDArray) -> NDArray:
        """Add a matrix of the disk to a matrix of the blade; the root shapes are last."""
        if not np.any(disk.imag):
            disk = disk.real
        matrix = blade.astype(disk.dtype)
        roots = slice(-self.n_interface, None)
        matrix[roots, roots] += disk
        return matrix

    def modes(self, d: int) -> tuple[NDArray, NDArray]:
        """Return squared frequencies (n,) and modes (n, n) of the tuned disk.

        The modes are mass-normalised, with normalised phase.
        """
        omega2, phi = eigh(self.stiffness(d), self.mass(d))
        return omega2, fix_phase(phi, self.mass(d).real)

    def damping(self, d: int, ratio: NDArray | float | None = None) -> NDArray:
        """Return C(d), (n, n) Hermitian, 1/s, for damping ratios (n,) of the tuned disk.

        They are ``damping_ratio`` by default.
        """
        if ratio is None:
            ratio = self.damping_ratio
        # C = M Phi diag(2 zeta omega) Phi^H M, because Phi^H M Phi = 1
        omega2, phi = self.modes(d)
        weighted = self.mass(d) @ phi
        rate = 2.0 * ratio * np.sqrt(omega2)
        return np.asarray((weighted * rate) @ weighted.conj().T)

    def residual_flexibility(self) -> NDArray | None:
        """Return the flexibility of a blade that the coordinates do not represent, m/N.

        It is (3 n_points, 3 n_points).
        """
        if self.flexibility is None:
            return None
        # cantilever and attachment modes: all but the root shapes
        clamped = slice(self.n - self.n_interface)
        shapes = self.contact_modes.reshape(-1, self.n)[:, clamped]
        stiffness = self.blade_stiffness[clamped, clamped]
        return np.asarray(self.flexibility - shapes @ np.linalg.solve(stiffness, shapes.T))

    def nodal_diameter(self, d: int) -> ModalBasis:
        """Return all n modes of the tuned disk at a nodal diameter from 0 to N/2."""
        omega2, phi = self.modes(d)
        contact_modes = self.contact_modes @ phi
        flexibility = self.residual_flexibility()
        if flexibility is not None:
            flat = contact_modes.reshape(-1, self.n)
            flexibility = flexibility + (flat / omega2) @ flat.conj().T
        return ModalBasis(
            omega2=omega2,
            damping_ratio=self.damping_ratio.copy(),
            contact_modes=contact_modes,
            locations={name: shapes @ phi for name, shapes in self.locations.items()},
            flexibility=flexibility,
        )
