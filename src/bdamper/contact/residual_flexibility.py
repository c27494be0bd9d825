r"""Residual modes: the flexibility that the retained modes leave out, as a few more modal coordinates.

A force :math:`F` at the contact points moves them by :math:`-R F` more than the retained modes give, :math:`R` the residual
flexibility (:mod:`bdamper.model.kinematics`).  A contact element can carry a diagonal :math:`D` of it only.  The rest,
:math:`E = R - D`, is projected onto a few force patterns :math:`W`,

.. math:: R \approx D + E W\,(W^H E W)^{-1}\,(E W)^H,

which is exact for every force in the span of :math:`W`, Hermitian, and positive definite as soon as the small matrix
:math:`S = W^H E W` is.  With coordinates :math:`a` it is a relative motion :math:`x = G q + E W a` and an energy
:math:`\tfrac12 a^H S a`: further modal columns :math:`E W` with the modal stiffness :math:`S`.  The modes left out have
inertia too.  To second order in frequency they answer with
:math:`R + \omega^2 R_2`, :math:`R_2 = \sum \phi\,\Omega^{-4} \phi^H` over those in the model, and the coordinates
represent it with the modal mass :math:`W^H R_2 W`; without known modes they are massless, and so are as many of them as
there are more patterns than such modes.  Stiffness and mass are made diagonal together.

Patterns of a harmonic are the contact forces of its stuck modes,
:math:`W = R^{-1} G Q` with :math:`(\Omega^2 + G^H R^{-1} G) Q = Q \Lambda`, lowest frequencies first: the stuck frequencies
are then those of the whole :math:`R`.  The mean has in addition, before the modes, the contact forces of the static
load, once stuck and once with friction.

The diagonal is a share of the point flexibility, :math:`D = s\,\mathrm{diag}(R)` at the fundamental harmonic: as large as
asked for, but no larger than leaves :math:`S` of the mean and of the fundamental at least a tenth of :math:`W^H R W`.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Annotated, Literal

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from bdamper.model.fields import check
from bdamper.model.kinematics import Coordinate, Coupling, HarmonicBasis
from bdamper.util import validation
from bdamper.util.errors import mismatch
from bdamper.util.formatting import short_repr

MARGIN = 0.1
"""Smallest share of the flexibility of a pattern that residual modes must carry."""
ROUNDING = 1e-9
"""Negative flexibility, relative to that of a point, and mass, relative to the largest, that count as rounding.  With
masses of 1e-17 in place of none a march in time leapt from 0.03 to 1.5 mm where it began."""

RESIDUAL = "residual"
"""Name of the body of residual modes among the coordinates of a basis."""


def _count_or_all(name: str, value: int | str) -> int | str:
    return value if isinstance(value, str) and value == "all" else validation.integer(name, value, least=1)


@dataclass(frozen=True)
class ResidualModes(validation.Checked):
    """Settings of residual modes.

    Parameters
    ----------
    n_vectors : int or "all"
        Force patterns, hence coordinates, for each harmonic: five give five stuck frequencies; beside ten blade modes six
        give the highest peak to 8 %, twelve to 4 % at twice the time (docs/measured.md).  "all" keeps all
        forces that move something: exact, with as many unknowns as the contact points have, meant as a reference.
    contact_share : float
        Of the point flexibility that stays at the contact point, at most.
    inertia : bool
        Give the coordinates the mass of those left-out modes that the model has.
    """

    n_vectors: Annotated[int | Literal["all"], _count_or_all] = 6
    contact_share: Annotated[float, validation.Limits(above=0.0, most=1.0)] = 0.5
    inertia: bool = True


def joined(basis: HarmonicBasis, residual: HarmonicBasis) -> HarmonicBasis:
    """A basis with residual coordinates at its end."""
    return replace(
        basis,
        coordinates=(*basis.coordinates, *residual.coordinates),
        omega2=np.concatenate([basis.omega2, residual.omega2]),
        damping_ratio=np.concatenate([basis.damping_ratio, residual.damping_ratio]),
        G=np.concatenate([basis.G, residual.G], axis=2),
        mass=np.concatenate([basis.mass, residual.mass]),
        drag=np.concatenate([np.broadcast_to(b.drag, b.omega2.shape) for b in (basis, residual)]),
    )


def active_components(coupling: Coupling, friction: NDArray) -> NDArray:
    """(n_points, 3) bool: force components of friction interfaces that can arise."""
    active = np.zeros((coupling.n_points, 3), bool)
    rows = coupling.friction_rows
    active[rows, 2] = True
    active[rows, :2] = (friction[rows] > 0.0)[:, None]
    return active


def check_definite(flexibility: NDArray, what: str) -> NDArray:
    """Lower Cholesky factor of a flexibility, scaled by its diagonal: ``L L^H = d^-1 R d^-1``, ``d = sqrt(diag R)``.

    Raises
    ------
    ModelError
        If the flexibility is not positive semi-definite, with its smallest eigenvalue.
    """
    own = np.diag(flexibility).real
    found = f"{own.min(initial=np.inf):.3g} m/N; the retained modes are softer than the full model"
    check((own > 0.0).all(), what, "a positive flexibility at every contact point", found)
    size = np.sqrt(own)
    scaled = flexibility / size[:, None] / size
    try:
        return scipy.linalg.cholesky(scaled + ROUNDING * np.eye(len(size)), lower=True)
    except np.linalg.LinAlgError:
        lowest = float(np.linalg.eigvalsh(scaled)[0])
        found = f"an eigenvalue of {lowest:.3g} times the flexibility of a point; modes and static flexibility do not"
        raise mismatch(what, "a positive semi-definite matrix", f"{found} belong together") from None


def stuck_modes(basis: HarmonicBasis, residual: NDArray, what: str) -> tuple[NDArray, NDArray]:
    """Frequencies (rad/s) and contact forces (3 n, n_modes) of the modes with all given contact components bonded.

    Parameters
    ----------
    basis : HarmonicBasis
        Whose ``G``, (3 n, n_modes), belongs to these components.
    residual : (3 n, 3 n) complex or float
    """
    factor = check_definite(residual, what)
    size = np.sqrt(np.diag(residual).real)
    G = basis.G
    half = scipy.linalg.solve_triangular(factor, G / size[:, None], lower=True)
    pole, Q = np.linalg.eigh(np.diag(basis.omega2) + half.conj().T @ half)
    force = scipy.linalg.solve_triangular(factor, half @ Q, lower=True, trans="C") / size[:, None]
    return np.sqrt(np.maximum(pole, 0.0)), force


def _stuck_static(coupling: Coupling, basis: HarmonicBasis, R: NDArray, kept: NDArray, what: str) -> NDArray | None:
    """Contact forces under the static load with every point bonded."""
    load, shift = coupling.load()
    if not np.any(load):
        return None
    factor, size = check_definite(R, what), np.sqrt(np.diag(R))
    G = scipy.linalg.solve_triangular(factor, basis.G / size[:, None], lower=True)
    s = scipy.linalg.solve_triangular(factor, shift.ravel()[kept] / size, lower=True)
    # (Omega^2 + G^T R^-1 G) q = f - G^T R^-1 s
    q = np.linalg.lstsq(np.diag(basis.omega2) + G.T @ G, load - G.T @ s, rcond=1e-13)[0]
    return scipy.linalg.solve_triangular(factor, G @ q + s, lower=True, trans="T") / size


@short_repr
@dataclass(frozen=True)
class ResidualSet:
    """Residual modes of a coupling, made for each harmonic when it is asked for.

    Parameters
    ----------
    coupling : Coupling
    options : ResidualModes
    active : (n_points, 3) bool
        Force components that can arise.
    flexibility : (n_points, 3) float, m/N
        The diagonal: what stays at the points; zero where no force can arise.
    share : float
        Of the point flexibility.
    static : (n_points, 3) float, optional
        Contact forces of the static load with friction, a pattern of the mean.
    """

    coupling: Coupling
    options: ResidualModes
    active: NDArray
    flexibility: NDArray
    share: float
    static: NDArray | None = None
    _bases: dict[int, HarmonicBasis] = field(default_factory=dict, repr=False, compare=False)
    _parts: dict[int, tuple[NDArray, NDArray, NDArray]] = field(default_factory=dict, repr=False, compare=False)

    @classmethod
    def make(
        cls, coupling: Coupling, friction: NDArray, options: ResidualModes, static: NDArray | None = None
    ) -> ResidualSet:
        """Choose the diagonal from the mean and the fundamental harmonic.

        Parameters
        ----------
        coupling : Coupling
        friction : (n_points,) float
        options : ResidualModes
        static : (n_points, 3) float, optional

        Raises
        ------
        ModelError
            If a flexibility is missing or not positive semi-definite, with the number that shows it.
        """
        active = active_components(coupling, friction)
        kept = active.ravel()
        validation.check(kept.any(), "residual modes", "an interface with friction", "none")
        point = np.where(kept, np.diag(coupling.residual_flexibility(1)).real, 0.0)
        bare = cls(coupling, options, active, point.reshape(-1, 3), 1.0, static)
        largest = max(bare._point_share(l) for l in (0, 1))
        share = min(options.contact_share, (1.0 - MARGIN) / largest)
        return replace(bare, flexibility=share * bare.flexibility, share=share)

    def _matrices(self, harmonic: int) -> tuple[NDArray, NDArray, NDArray]:
        """Residual flexibility of all components, patterns, and the flexibility of these; no choice of the diagonal."""
        if harmonic in self._parts:
            return self._parts[harmonic]
        R = self.coupling.residual_flexibility(harmonic)
        if harmonic == 0:
            R = R.real
        kept = self.active.ravel()
        static = None if self.static is None else self.static.ravel()[kept]
        W = self._patterns(harmonic, R, static)
        whole = W.conj().T @ R[np.ix_(kept, kept)] @ W
        self._parts[harmonic] = R, W, 0.5 * (whole + whole.conj().T)
        return self._parts[harmonic]

    def _patterns(self, harmonic: int, residual: NDArray, static: NDArray | None) -> NDArray:
        """(n_active, n) force patterns of one harmonic, of unit length, independent."""
        n_active = int(self.active.sum())
        basis = self.coupling.basis(harmonic)
        kept = self.active.ravel()
        if self.options.n_vectors == "all":  # but those that move nothing, where points are more than the nodes below them
            size = np.sqrt(np.maximum(np.diag(residual)[kept].real, np.finfo(float).tiny))
            part, W = np.linalg.eigh(residual[np.ix_(kept, kept)] / size[:, None] / size)
            return np.asarray(W[:, part > ROUNDING * part[-1]] / size[:, None])
        what = f"residual flexibility at harmonic {harmonic}, nodal diameter {basis.nodal_diameter}"
        restricted = replace(basis, G=basis.G.reshape(len(kept), -1)[kept])
        R = residual[np.ix_(kept, kept)]
        if harmonic == 0:
            R, restricted = R.real, replace(restricted, G=restricted.G.real)
        _, modes = stuck_modes(restricted, R, what)
        columns = [modes]
        if harmonic == 0:
            stuck = _stuck_static(self.coupling, restricted, R, kept, what)
            columns = [c for c in (static, stuck) if c is not None] + columns
        W = np.concatenate([c.reshape(n_active, -1) for c in columns], axis=1)
        norm = np.linalg.norm(W, axis=0)
        W = W[:, norm > 0.0] / norm[norm > 0.0]
        # in order, those that say something new
        chosen: list[int] = []
        rest = W.copy()
        for k in range(W.shape[1]):
            size = np.linalg.norm(rest[:, k])
            if size > 1e-3:
                chosen.append(k)
                unit = rest[:, k] / size
                rest = rest - np.outer(unit, unit.conj() @ rest)
            if len(chosen) == self.options.n_vectors:
                break
        return W[:, chosen]

    def _point_share(self, harmonic: int) -> float:
        """Largest share of the flexibility of a pattern that the diagonal has."""
        _, W, whole = self._matrices(harmonic)
        D = self.flexibility.ravel()[self.active.ravel()]
        return float(scipy.linalg.eigh(W.conj().T @ (D[:, None] * W), whole, eigvals_only=True)[-1])

    def basis(self, harmonic: int) -> HarmonicBasis:
        """Residual coordinates of one harmonic."""
        if harmonic in self._bases:
            return self._bases[harmonic]
        R, W, whole = self._matrices(harmonic)
        kept, D = self.active.ravel(), self.flexibility.ravel()
        # rows of constraint planes too: friction forces move them
        columns = (R - np.diag(D))[:, kept] @ W
        S = W.conj().T @ columns[kept]
        rest, V = scipy.linalg.eigh(0.5 * (S + S.conj().T), whole)
        # at higher harmonics the diagonal may leave nothing of a pattern
        V = V[:, rest > 0.5 * MARGIN] / np.sqrt(rest[rest > 0.5 * MARGIN])
        bodies, n = self.coupling.basis(harmonic), V.shape[1]
        reference = float(bodies.omega2.max())
        mass = damping = np.zeros(n)
        if self.options.inertia and harmonic > 0:
            left_out, pole, ratio = self.coupling.left_out_modes(harmonic)
            P = (W @ V).conj().T @ left_out[kept] / pole
            mass, turn = np.linalg.eigh(P @ P.conj().T)
            mass, V = np.where(mass > ROUNDING * mass.max(initial=0.0), mass, 0.0), V @ turn
            damping = np.full(n, float(np.mean(ratio)) if len(ratio) else 0.0)
        # one stiffness for all coordinates, so that they are of the size of the others
        G = (columns @ V * np.sqrt(reference)).reshape(-1, 3, n).astype(complex)
        names = tuple(Coordinate(RESIDUAL, i, f"residual {i + 1}") for i in range(n))
        stiffness = np.full(n, reference)
        made = HarmonicBasis(names, stiffness, damping, G, bodies.nodal_diameter, mass * reference)
        self._bases[harmonic] = made
        return made
