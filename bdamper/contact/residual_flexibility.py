r"""Residual modes: a few modal coordinates for the flexibility of the omitted modes.

Contact forces :math:`F` cause the displacement :math:`-R F` beyond the retained modes, with the
residual flexibility :math:`R` (:mod:`bdamper.model.kinematics`).  A contact element represents a
diagonal part :math:`D` only.  The difference :math:`E = R - D` is projected onto a few force
vectors :math:`W`,

.. math:: R \approx D + E W\,(W^H E W)^{-1}\,(E W)^H.

This is exact for forces in the span of :math:`W`, Hermitian, and positive definite if
:math:`S = W^H E W` is.  Coordinates :math:`a` with the relative motion :math:`x = G q + E W a` and
the energy :math:`\tfrac12 a^H S a` represent it: additional modal columns :math:`E W` with the
modal stiffness :math:`S`.

The omitted modes also have inertia.  To second order in frequency their flexibility is
:math:`R + \omega^2 R_2` with :math:`R_2 = \sum \phi\,\Omega^{-4} \phi^H` over the omitted modes in
the model.  The modal mass :math:`W^H R_2 W` represents it.  If the model has fewer omitted modes
than there are coordinates, the remaining coordinates are massless.  Stiffness and mass are made
diagonal together.

The vectors of a harmonic are the contact forces of its stuck modes in ascending order of frequency,
:math:`W = R^{-1} G Q` with :math:`(\Omega^2 + G^H R^{-1} G) Q = Q \Lambda`.  The stuck frequencies
are then exact.  Harmonic 0 begins with the contact forces of the static load, with friction and
stuck.  If there are fewer stuck modes than vectors, the forces with the largest flexibility follow,
:math:`d^{-1} v` with the eigenvectors :math:`v` of :math:`d^{-1} R\, d^{-1}` and
:math:`d^2 = \mathrm{diag}(R)`.

These forces do not describe contact limited to an edge.  For partial contact, more of the softest
forces follow, or the contact forces of the first mode if only some of the points stick
(:func:`parts_of_faces`).

Forces of parts are largest at their ends, so that combinations of the vectors can be stiff.  They
would make the share of every point small.  The stiffness of their coordinates is therefore
increased, which leaves these combinations to the diagonal.  The increase is smooth, because
equations from which vectors are dropped at a limit cannot be interpolated in speed.  The first
vector keeps its stiffness: the first stuck frequency of the fundamental harmonic and the static
state remain exact.

The diagonal is a fraction of the point flexibility at the fundamental harmonic,
:math:`D = s\,\mathrm{diag}(R)`.  The setting ``contact_share`` is its upper bound; a smaller
:math:`s` leaves :math:`S` of harmonics 0 and 1 at least a tenth of :math:`W^H R W`.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Annotated, Literal

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from bdamper.model.kinematics import Coordinate, Coupling, HarmonicBasis
from bdamper.util import validation
from bdamper.util.errors import mismatch
from bdamper.util.formatting import short_repr

MARGIN = 0.1
"""Smallest fraction of the flexibility under a force vector that residual modes represent."""
ROUNDING = 1e-9
"""Relative size of a mass that counts as zero.  Masses of 1e-17 instead of zero made a time
integration jump from 0.03 to 1.5 mm at its start.
"""

NEGATIVE = 1e-6
"""Relative size of a negative flexibility that counts as rounding.

Residual flexibilities of 40 modes are small differences of large ones: -1.5e-9 was found on an
imported sector.  The forces that it belongs to have no vectors (``RESOLVED``).
"""
RESOLVED, RESOLVED_HIGHER = 0.02, 2e-3
"""Smallest eigenvalue, in units of the flexibility of a point, of forces that the mesh resolves: at
the harmonics 0 and 1, and at higher ones.

Without a limit 24 points on a face of 3 by 5 nodes are 150 times too stiff, and 9 of 10 preloads
have no response.  Force vectors of the harmonics 0 and 1 limit the share of the points, so that
forces just above the limit make every point too stiff: 24 points on faces of 15 to 25 nodes became
2 to 25 times stiffer with 0.002.  The disk of the paper with 48 points has forces between 0.002 and
0.02, and its peaks change by up to 0.7 %; those of the paper's blade on the ground by up to 3.4 %.
"""

SOFT_ENOUGH = 0.17
"""Flexibility, in units of that of a point, below which combinations of force vectors fade out.

Without the limit the share falls from 0.50 to 0.01 on random sectors, and a corner that carries
alone is 9 % too stiff; with 0.2 a corner of the turbine blade is 29 % too soft
(docs/evidence/measured-contact.md).
"""
FADING = 10.0
"""Increase of the stiffness of fading combinations for each unit of flexibility below the limit.

It is also the steepness of the transition.  With 20 the largest error of parts of faces is the same
on random sectors.
"""
PART = 0.35
"""Extent of a part in units of the extent of the face."""
SAME_PLACE = 1e-6
"""Distance that counts as zero, in units of the extent of a face.

Decks of one face round coordinates differently.  Without the limit rounding chose the part of a
face with a single row of points, and changed stuck frequencies by up to 2e-3.
"""

RESIDUAL = "residual"
"""Body name of residual modes in the coordinates of a basis."""


def _count_or_all(name: str, value: int | str) -> int | str:
    if isinstance(value, str) and value == "all":
        return value
    return validation.integer(name, value, least=1)


@dataclass(frozen=True)
class ResidualModes(validation.Checked):
    """Settings of residual modes.

    Parameters
    ----------
    n_vectors : int or "all"
        Number of force vectors, and thus of coordinates, per harmonic.  Five vectors give five
        exact stuck frequencies.  With ten blade modes, the highest peak has an error of 8 % with
        six vectors, and of 4 % with twelve, which take twice the time
        (docs/evidence/measured-contact.md).  "all" is exact for the forces that the mesh resolves, and
        serves as a reference.
    contact_share : float
        Largest fraction of the flexibility of a point that its contact stiffness represents.
    inertia : bool
        Include the inertia of the omitted modes in the model.
    n_soft : int
        Number of further force vectors for partial contact, those with the largest flexibility.
        For two reference models at and above the optimal preload, six of them reduce the error of
        the peak due to edge contact, which is 3 to 7 % otherwise, to less than 1 %, in 1.5 to 2
        times the time (docs/evidence/measured-contact.md).
    partial_contact : bool
        Add the force vectors of faces that touch at one end: outer, inner, front or rear third.
        For 29 random sectors with bonded faces, they reduce the largest error of mode 1 from 44 to
        12 %, in up to 1.8 times the time (docs/evidence/measured-contact.md).  Stiff combinations fade out,
        so that only the first stuck frequency is exact.
    """

    n_vectors: Annotated[int | Literal["all"], _count_or_all] = 6
    contact_share: Annotated[float, validation.Limits(above=0.0, most=1.0)] = 0.5
    inertia: bool = True
    n_soft: validation.Natural = 0
    partial_contact: bool = False


def joined(basis: HarmonicBasis, residual: HarmonicBasis) -> HarmonicBasis:
    """Append residual coordinates to a basis."""
    # a drag of 0.0 applies to all modes
    drag_of_basis = np.broadcast_to(basis.drag, basis.omega2.shape)
    drag_of_residual = np.broadcast_to(residual.drag, residual.omega2.shape)
    return replace(
        basis,
        coordinates=(*basis.coordinates, *residual.coordinates),
        omega2=np.concatenate([basis.omega2, residual.omega2]),
        damping_ratio=np.concatenate([basis.damping_ratio, residual.damping_ratio]),
        G=np.concatenate([basis.G, residual.G], axis=2),
        mass=np.concatenate([basis.mass, residual.mass]),
        drag=np.concatenate([drag_of_basis, drag_of_residual]),
    )


def active_components(coupling: Coupling, friction: NDArray) -> NDArray:
    """Return which force components (n_points, 3) bool are possible on friction interfaces."""
    active = np.zeros((coupling.n_points, 3), bool)
    rows = coupling.friction_rows
    active[rows, 2] = True
    active[rows, :2] = (friction[rows] > 0.0)[:, None]
    return active


def force_patterns(flexibility: NDArray, what: str, resolved: float = RESOLVED) -> NDArray:
    """Return force vectors that span all forces that the mesh resolves.

    The vectors ``F`` (n, m) satisfy ``F^H R F = 1``.  They are the eigenvectors of the flexibility
    scaled by its diagonal, ``d^-1 R d^-1`` with ``d = sqrt(diag R)``.  ``F F^H`` is the inverse of
    the flexibility without the other forces.

    Parameters
    ----------
    flexibility : (n, n) complex or float, m/N
    what : str
        Name of the matrix in the error message.
    resolved : float
        Smallest eigenvalue of forces that the mesh resolves.

    Raises
    ------
    ModelError
        If the flexibility is not positive semi-definite; the message has its smallest eigenvalue.
    """
    diagonal = np.diag(flexibility).real
    if not (diagonal > 0.0).all():
        raise mismatch(
            what,
            "a positive flexibility at every contact point",
            f"{diagonal.min():.3g} m/N; the retained modes are more flexible than the full model",
        )
    # entry (i, j) of the scaled matrix is divided by d_i d_j
    size = np.sqrt(diagonal)
    eigenvalue, vectors = np.linalg.eigh(flexibility / size[:, None] / size)
    if eigenvalue.min(initial=0.0) < -NEGATIVE:
        raise mismatch(
            what,
            "a positive semi-definite matrix",
            f"an eigenvalue of {eigenvalue[0]:.3g} times the flexibility of a point; "
            "modes and static flexibility are not from the same model",
        )
    kept = eigenvalue > resolved
    unit_vectors = vectors[:, kept] / np.sqrt(eigenvalue[kept])
    return np.asarray(unit_vectors / size[:, None])


def stuck_modes(
    basis: HarmonicBasis, residual: NDArray, what: str, resolved: float = RESOLVED
) -> tuple[NDArray, NDArray]:
    """Compute the modes with all contact components bonded.

    Parameters
    ----------
    basis : HarmonicBasis
        With ``G`` (3 n, n_modes) of these components.
    residual : (3 n, 3 n) complex or float, m/N
    what : str
        Name of the residual flexibility in the error message.
    resolved : float
        See :func:`force_patterns`.

    Returns
    -------
    frequency : (n_modes,) float, rad/s
    force : (3 n, n_modes) complex or float
        Contact forces.
    """
    # F F^H is the contact stiffness, so the structure has K + G^H F F^H G
    F = force_patterns(residual, what, resolved)
    G = F.conj().T @ basis.G
    squared_frequency, Q = np.linalg.eigh(np.diag(basis.omega2) + G.conj().T @ G)
    # a free rigid body has 0, up to rounding
    frequency = np.sqrt(np.maximum(squared_frequency, 0.0))
    return frequency, F @ (G @ Q)


def softest_forces(flexibility: NDArray, n: int) -> NDArray:
    """Return the n unit forces (n_active, n) with the largest flexibility, in units of the points."""
    size = np.sqrt(np.diag(flexibility).real)
    # eigenvalues ascend: the softest is the last column
    _, vectors = np.linalg.eigh(flexibility / size[:, None] / size)
    softest_first = vectors[:, ::-1]
    forces = softest_first[:, :n] / size[:, None]
    return np.asarray(forces / np.linalg.norm(forces, axis=0))


def parts_of_faces(coupling: Coupling) -> dict[str, NDArray]:
    """Return the rows of the contact points in the outer, inner, front and rear third of the faces.

    The outer third of all friction faces together is one part, and so on.  Outer points have the
    largest radius, and front points the smallest coordinate along t2.  Faces without extent in a
    direction belong to both of its parts.
    """
    found: dict[str, list[NDArray]] = {"outer": [], "inner": [], "front": [], "rear": []}
    for name in coupling.friction_faces:
        face = coupling.model.interfaces[name]
        rows = np.arange(coupling.n_points)[coupling.rows(name)]
        along_t1, along_t2 = np.einsum("ncj,nj->cn", face.frame[:, :2], face.points)
        same = SAME_PLACE * np.hypot(np.ptp(along_t1), np.ptp(along_t2))
        from_axis = np.hypot(face.points[:, 0], face.points[:, 1])
        from_middle = along_t1 - along_t1.mean()
        # t1 points outwards on one face of a wedge and inwards on the other; negative correlation
        # with the radius, beyond rounding, means inwards
        outward = from_middle @ (from_axis - from_axis.mean())
        if outward < -same * np.abs(from_middle).sum():
            along_t1 = -along_t1
        found["inner"].append(rows[_near_lower_end(along_t1, same)])
        found["outer"].append(rows[_near_lower_end(-along_t1, same)])
        found["front"].append(rows[_near_lower_end(along_t2, same)])
        found["rear"].append(rows[_near_lower_end(-along_t2, same)])
    return {name: np.concatenate(rows) for name, rows in found.items()}


def _near_lower_end(x: NDArray, same: float) -> NDArray:
    """Return which positions (n,) are in the lowest part of their range.

    Positions beyond the limit by up to ``same`` (m) also count.
    """
    return np.asarray(x - x.min() <= PART * np.ptp(x) + same)


def _faded(energy: NDArray, in_points: NDArray, least: float) -> NDArray:
    """Return the energy (n, n) under force vectors, increased for stiff combinations.

    They are those whose energy is less than ``least`` of the energy ``in_points`` (n, n) that the
    same forces have in the flexibility of the points.  More energy is more stiffness of their
    coordinates.
    """
    if not len(energy):
        return energy
    ratio, combination = scipy.linalg.eigh(energy, in_points)
    # log(1 + exp(x)) is smooth; it is nearly 0 above the limit and x below
    increase = least * np.logaddexp(0.0, FADING * (1.0 - ratio / least))
    # the combinations are orthonormal in in_points, so this is the inverse of their transposed
    # matrix: energy = inverse diag(ratio) inverse^H
    inverse = in_points @ combination
    return np.asarray(energy + (inverse * increase) @ inverse.conj().T)


def _stuck_static(
    coupling: Coupling, basis: HarmonicBasis, R: NDArray, kept: NDArray, what: str
) -> NDArray | None:
    """Return the contact forces under the static load with every point bonded.

    The result is None without load.  ``kept`` selects the components of ``R`` and of the basis.
    """
    load, shift = coupling.load()
    if not np.any(load):
        return None
    # R^-1 = F F^T: motion and shift of the points in units of the force vectors
    F = force_patterns(R, what)
    G = F.T @ basis.G
    s = F.T @ shift.ravel()[kept]
    # (Omega^2 + G^T R^-1 G) q = f - G^T R^-1 s; by least squares, because a rigid-body motion may be
    # free
    stiffness = np.diag(basis.omega2) + G.T @ G
    q, *_ = np.linalg.lstsq(stiffness, load - G.T @ s, rcond=1e-13)
    return np.asarray(F @ (G @ q + s))


def _hermitian(matrix: NDArray) -> NDArray:
    return np.asarray(0.5 * (matrix + matrix.conj().T))


def _independent(vectors: NDArray, most: int) -> NDArray:
    """Return the columns that do not depend on previous ones, at most ``most`` (Gram-Schmidt).

    The columns of ``vectors`` have unit length.
    """
    _, n_columns = vectors.shape
    chosen: list[int] = []
    # columns without their parts along the chosen ones
    remainder = vectors.copy()
    for column in range(n_columns):
        size = np.linalg.norm(remainder[:, column])
        # less than a thousandth of its unit length is left of a dependent column
        if size > 1e-3:
            chosen.append(column)
            unit = remainder[:, column] / size
            remainder = remainder - np.outer(unit, unit.conj() @ remainder)
        if len(chosen) == most:
            break
    return vectors[:, chosen]


@dataclass(frozen=True)
class _ForceVectors:
    """Force vectors of a harmonic, independent of the diagonal.

    Parameters
    ----------
    flexibility : (3 n_points, 3 n_points) complex or float, m/N
        R of all components.
    vectors : (n_active, n) complex or float
        W, of the active components.
    energy : (n, n) complex or float
        W^H R W, increased for combinations that fade out.
    """

    flexibility: NDArray
    vectors: NDArray
    energy: NDArray


@short_repr
@dataclass(frozen=True)
class ResidualSet:
    """Residual modes of a coupling, computed on demand for each harmonic.

    Parameters
    ----------
    coupling : Coupling
    options : ResidualModes
    active : (n_points, 3) bool
        Possible force components.
    flexibility : (n_points, 3) float, m/N
        Diagonal D at the contact points; zero for components without force.
    share : float
        Fraction s of the point flexibility.
    static : (n_points, 3) float, optional
        Contact forces of the static load with friction: a force vector of harmonic 0.
    """

    coupling: Coupling
    options: ResidualModes
    active: NDArray
    flexibility: NDArray
    share: float
    static: NDArray | None = None
    _bases: dict[int, HarmonicBasis] = field(default_factory=dict, repr=False, compare=False)
    _vectors: dict[int, _ForceVectors] = field(default_factory=dict, repr=False, compare=False)

    @classmethod
    def make(
        cls,
        coupling: Coupling,
        friction: NDArray,
        options: ResidualModes,
        static: NDArray | None = None,
    ) -> ResidualSet:
        """Choose the diagonal for harmonics 0 and 1.

        Parameters
        ----------
        coupling : Coupling
        friction : (n_points,) float
        options : ResidualModes
        static : (n_points, 3) float, optional

        Raises
        ------
        ModelError
            If a flexibility is missing or not positive semi-definite.
        """
        active = active_components(coupling, friction)
        validation.check(active.any(), "residual modes", "an interface with friction", "none")
        point_flexibility = np.diag(coupling.residual_flexibility(1)).real
        diagonal = np.where(active.ravel(), point_flexibility, 0.0).reshape(-1, 3)
        unscaled = cls(coupling, options, active, flexibility=diagonal, share=1.0, static=static)
        # no force vector may have more flexibility in the diagonal than in total
        largest = max(unscaled._point_share(0), unscaled._point_share(1))
        share = min(options.contact_share, (1.0 - MARGIN) / largest)
        return replace(unscaled, flexibility=share * unscaled.flexibility, share=share)

    @property
    def _fades(self) -> bool:
        """Whether stiff combinations of the force vectors fade out."""
        return self.options.partial_contact and self.options.n_vectors != "all"

    def _force_vectors(self, harmonic: int) -> _ForceVectors:
        """Return the force vectors of a harmonic, computed once."""
        if harmonic in self._vectors:
            return self._vectors[harmonic]
        R = self.coupling.residual_flexibility(harmonic)
        if harmonic == 0:
            R = R.real
        active = self.active.ravel()
        R_active = R[np.ix_(active, active)]
        W = self._choose_vectors(harmonic, R_active)
        energy = _hermitian(W.conj().T @ R_active @ W)
        if harmonic <= 1 and self._fades:
            # all but the first vector may fade out; _choose_vectors has decoupled it
            others = W[:, 1:]
            points = np.diag(R_active).real
            in_points = _hermitian(others.conj().T @ (points[:, None] * others))
            energy[1:, 1:] = _faded(energy[1:, 1:], in_points, least=SOFT_ENOUGH)
        self._vectors[harmonic] = _ForceVectors(flexibility=R, vectors=W, energy=energy)
        return self._vectors[harmonic]

    def _choose_vectors(self, harmonic: int, R: NDArray) -> NDArray:
        """Return linearly independent force vectors (n_active, n) of unit length.

        ``R`` is the residual flexibility of the active components.
        """
        basis = self.coupling.basis(harmonic)
        what = f"residual flexibility at harmonic {harmonic}, nodal diameter {basis.nodal_diameter}"
        resolved = RESOLVED if harmonic <= 1 else RESOLVED_HIGHER
        if self.options.n_vectors == "all":
            return force_patterns(R, what, resolved)

        active = self.active.ravel()
        G = basis.G.reshape(len(active), -1)[active]
        if harmonic == 0:
            R = R.real
            G = G.real
        restricted = replace(basis, G=G)
        _, forces_of_modes = stuck_modes(restricted, R, what, resolved)
        # earlier vectors take precedence: static forces with friction, then in stick, then modes
        columns = [forces_of_modes]
        if harmonic == 0:
            stuck = _stuck_static(self.coupling, restricted, R, active, what)
            if stuck is not None:
                columns.insert(0, stuck)
            if self.static is not None:
                columns.insert(0, self.static.ravel()[active])
        # (n_active, number of vectors); the static forces are single columns
        W = np.concatenate([forces.reshape(len(R), -1) for forces in columns], axis=1)
        norm = np.linalg.norm(W, axis=0)
        not_zero = norm > 0.0
        n_vectors = self.options.n_vectors
        W = _independent(W[:, not_zero] / norm[not_zero], most=n_vectors)
        # a study may have fewer stuck modes than vectors
        n_missing = n_vectors - W.shape[1]
        soft = softest_forces(R, self.options.n_soft + n_missing)
        candidates = np.concatenate([W, soft], axis=1)
        W = _independent(candidates, most=candidates.shape[1])
        if not self.options.partial_contact:
            return W
        of_parts = self._forces_of_parts(restricted, R, what, resolved)
        candidates = np.concatenate([W, of_parts], axis=1)
        W = _independent(candidates, most=candidates.shape[1])
        # the others, which may fade out, do no work on the motion under the first: (n_active, 1)
        # and (n_active, n - 1)
        first = W[:, :1]
        others = W[:, 1:]
        work = (first.conj().T @ R @ others) / (first.conj().T @ R @ first)
        return np.concatenate([first, others - first @ work], axis=1)

    def _forces_of_parts(
        self, basis: HarmonicBasis, R: NDArray, what: str, resolved: float
    ) -> NDArray:
        """Return the contact forces (n_active, n) of the first mode with a part of the points stuck.

        ``basis`` and ``R`` have the active components only.
        """
        # row of each component (n_points, 3) among the active ones, -1 if not active
        number = np.full(self.active.shape, -1)
        number[self.active] = np.arange(len(R))
        columns = []
        for points in parts_of_faces(self.coupling).values():
            of_points = number[points].ravel()
            rows = of_points[of_points >= 0]
            of_part = replace(basis, G=basis.G[rows])
            frequency, force = stuck_modes(of_part, R[np.ix_(rows, rows)], what, resolved)
            size = np.linalg.norm(force, axis=0)
            # a free body that the part does not hold has a frequency of zero
            moving = (frequency > 1e-4 * frequency.max()) & (size > 0.0)
            if moving.any():
                first = int(np.argmax(moving))
                column = np.zeros(len(R), force.dtype)
                column[rows] = force[:, first] / size[first]
                columns.append(column)
        if not columns:
            return np.zeros((len(R), 0))
        return np.stack(columns, axis=1)

    def _point_share(self, harmonic: int) -> float:
        """Return the largest fraction of the flexibility under force vectors that the diagonal has."""
        force_vectors = self._force_vectors(harmonic)
        W = force_vectors.vectors
        diagonal = self.flexibility.ravel()[self.active.ravel()]
        # for a combination v of the vectors, W^H D W v = fraction W^H R W v
        in_diagonal = W.conj().T @ (diagonal[:, None] * W)
        fractions = scipy.linalg.eigh(in_diagonal, force_vectors.energy, eigvals_only=True)
        # they ascend
        return float(fractions[-1])

    def basis(self, harmonic: int) -> HarmonicBasis:
        """Return the residual coordinates of one harmonic as a basis."""
        if harmonic in self._bases:
            return self._bases[harmonic]
        force_vectors = self._force_vectors(harmonic)
        W = force_vectors.vectors  # (n_active, n)
        active = self.active.ravel()
        diagonal = self.flexibility.ravel()

        # motion (3 n_points, n) under the force vectors that the diagonal does not contain, also at
        # axial stops: friction forces move them
        remainder = force_vectors.flexibility - np.diag(diagonal)
        motion = remainder[:, active] @ W
        in_diagonal = _hermitian(W.conj().T @ (diagonal[active][:, None] * W))
        energy = force_vectors.energy
        # at higher harmonics the diagonal may contain the complete flexibility under a force vector
        if harmonic > 1 and self._fades:
            energy = _faded(energy, in_diagonal, least=1.0 / (1.0 - MARGIN))
        # fraction of the flexibility that the diagonal does not contain; columns of V have unit
        # energy in it
        fraction, V = scipy.linalg.eigh(energy - in_diagonal, energy)
        represented = fraction > 0.5 * MARGIN
        V = V[:, represented] / np.sqrt(fraction[represented])

        _, n = V.shape
        mass = np.zeros(n)
        damping = np.zeros(n)
        if self.options.inertia and harmonic > 0:
            omitted, omega2, ratio = self.coupling.left_out_modes(harmonic)
            # response (n, n_omitted) of the omitted modes to the forces W V, at rest; its square is
            # the mass of the coordinates
            response = (W @ V).conj().T @ omitted[active] / omega2
            # rotate to coordinates with a diagonal mass matrix
            mass, rotation = np.linalg.eigh(response @ response.conj().T)
            mass = np.where(mass > ROUNDING * mass.max(initial=0.0), mass, 0.0)
            V = V @ rotation
            if len(ratio):
                damping = np.full(n, float(np.mean(ratio)))

        # equal stiffness makes these coordinates similar in size to modal coordinates
        bodies = self.coupling.basis(harmonic)
        stiffness = float(bodies.omega2.max())
        G = (motion @ V * np.sqrt(stiffness)).reshape(-1, 3, n).astype(complex)
        self._bases[harmonic] = HarmonicBasis(
            coordinates=tuple(Coordinate(RESIDUAL, i, f"residual {i + 1}") for i in range(n)),
            omega2=np.full(n, stiffness),
            damping_ratio=damping,
            G=G,
            nodal_diameter=bodies.nodal_diameter,
            mass=mass * stiffness,
        )
        return self._bases[harmonic]
