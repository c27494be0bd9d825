"""Harmonic balance equations of a model under given settings: the only module that talks to the C core.

Unknowns ``u``: the ``n_mode[0]`` coordinates of the mean, then for each harmonic its cosine and its sine amplitudes.
``y = (u, omega)`` is a point in the space in which response curves live.
"""

from __future__ import annotations

import math
from copy import copy
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Self

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from bdamper import _core
from bdamper.contact.laws import (
    LAW_COUPLED,
    LAW_COUPLED_CONSTANT,
    LAW_SEPARABLE,
    Sampled,
    check_evaluation,
)
from bdamper.contact.points import PointArrays
from bdamper.harmonic_balance.conditions import Condition, Fixed, Peak, for_core
from bdamper.model.coupling import HarmonicBasis
from bdamper.util import validate
from bdamper.util.errors import SettingError
from bdamper.util.progress import end_if_asked
from bdamper.util.repr import brief

OK, NOT_CONVERGED, DIVERGED, SINGULAR, NOT_FINITE = range(5)
STATUS_TEXT = {
    OK: "converged",
    NOT_CONVERGED: "Newton did not converge",
    DIVERGED: "Newton diverged",
    SINGULAR: "singular Jacobian",
    NOT_FINITE: "not finite",
}
WholeWheel = _core.Wheel
"""Equations of all sectors of a wheel (``csrc/bd_wheel.h``), for :mod:`bdamper.wheel.system`."""
LINE_SEARCH_TRIALS = 15
"""Most evaluations of an iteration with line search."""


def norm2(x: NDArray) -> float:
    """Euclidean norm of a vector."""
    return math.sqrt(x.dot(x))


@brief
@dataclass(frozen=True)
class Correction:
    """Outcome of one Newton corrector.

    Parameters
    ----------
    status : int
    y, tangent : (n_unknowns + 1,) float
    iterations : int
    residual : float
        Largest residual relative to the excitation (harmonics) or the static load (mean).
    condition : float
        Estimated reciprocal condition of the equilibrated bordered matrix.
    rank_deficiency : int
        Directions that the equations leave undetermined, held by least norm.
    shares : tuple of three floats
        Shares of the cycle that stick, slip and are open at ``y``, averaged over the points with friction; NaN where the
        core has not evaluated it.
    orientation : int
        Sign of det [J; tangent], which stays the same along a curve, corners included; 0 if it is not known.
    slope, curvature : float
        Of a stationary point: what vanishes there, and its derivative along the curve.
    """

    status: int
    y: NDArray
    tangent: NDArray
    iterations: int
    residual: float
    condition: float
    rank_deficiency: int
    shares: tuple[float, float, float] = (math.nan, math.nan, math.nan)
    orientation: int = 0
    slope: float = math.nan
    curvature: float = math.nan


class HarmonicSystem:
    """Residual, Jacobian and corrector for one structure, one preload, one excitation.

    Parameters
    ----------
    bases : sequence of HarmonicBasis
        One for each harmonic 0..n_harmonics.
    points : PointArrays
    force : (n_unknowns,) float
        Modal excitation and static load, in the layout of the unknowns.
    response : sequence of (n_modes,) complex
        Row of modal amplitudes that gives the response, for each harmonic.
    evaluation : {"exact"} or Sampled
    force_scale : (2,) float
        Reference modal forces of the mean and of the harmonics, for the relative residual.
    """

    def __init__(
        self,
        bases: list[HarmonicBasis],
        points: PointArrays,
        force: NDArray,
        response: list[NDArray],
        evaluation: str | Sampled = "exact",
        force_scale: tuple[float, float] = (1.0, 1.0),
    ) -> None:
        self.bases = bases
        self.spring_bases = bases
        """Modes at the points and along the axes to which linear springs are given."""
        self.springs: NDArray | float = 0.0
        """(n_points, 3) springs there that are a part of the bodies: with contact and without it."""
        self.points = points
        self.force = np.ascontiguousarray(force, float)
        self.response_rows = response
        self.n_harmonics = len(bases) - 1
        self.n_mode = np.array([len(b.omega2) for b in bases], np.intc)
        validate.require(self.n_harmonics >= 1, "harmonics", "at least 1", "0")
        self.evaluation, self.force_scale = evaluation, force_scale
        mode, n_time = self.evaluation_code = evaluation_code(evaluation, self.n_harmonics, np.asarray(points.law))
        self.exact = mode == 0
        damping = [b.damping for b in bases]
        self.arrays: dict[str, Any] = {
            "n_mode": self.n_mode,
            "stiffness": np.concatenate([b.omega2 for b in bases]),
            "mass": np.concatenate([b.mass for b in bases]),
            "damping": np.concatenate(damping),
            "G": np.concatenate([np.ascontiguousarray(b.G, complex).ravel() for b in bases]),
            "kt": np.ascontiguousarray(points.kt, float),
            "kn": np.ascontiguousarray(points.kn, float),
            "mu": np.ascontiguousarray(points.mu, float),
            "n0": np.ascontiguousarray(points.n0, float),
            "w": np.ascontiguousarray(points.slider, float),
            "law": np.ascontiguousarray(points.law, np.intc),
            "shift": np.ascontiguousarray(points.shift, float),
            "force": self.force,
            "load": np.ascontiguousarray(points.n0 if points.load is None else points.load, float),
        }
        self.n_unknowns = len(self.force)
        self.n_mean = int(self.n_mode[0])
        self.n_points = len(points.kn)
        self.row_scale = np.full(self.n_unknowns, 1.0 / force_scale[1])
        self.row_scale[: self.n_mean] = 1.0 / force_scale[0]
        self._fixed: dict[str, Any] = {"evaluation": mode, "n_time": n_time, "row_scale": self.row_scale}
        self.core: _core.Sector | _core.Eased | _core.Modes | _core.Wheel = _core.Sector(**self.arrays, **self._fixed)
        self.supported = False
        """Whether the parameter fades a support out (:meth:`supported_by`)."""
        self.most_evaluations = math.inf
        """Evaluations of the core in all after which no correction is begun (:meth:`within`)."""
        self.watched: list[tuple[float, float, NDArray]] = []
        """Linear resonances that a path must not step over: frequency and half-width (rad/s), modal row."""

    @property
    def work(self) -> NDArray:
        """(4,) million operations of an evaluation, Jacobian, factorisation, solution by least norm (:class:`Cost`)."""
        n, points = self.n_unknowns, self.n_points
        contact = 28e3 * (2 * self.n_harmonics + 1) if self.exact else 120e3 + 1.2e3 * self.evaluation_code[1]
        return 1e-6 * np.array([points * contact, 6.0 * points * n**2, n**3 + 700.0 * n**2 + 1e6, 15.0 * n**3])

    def within(self, evaluations: int) -> Self:
        """The same equations with a budget: no correction is begun after so many evaluations from now on."""
        out = copy(self)
        out.most_evaluations = self.core.cost.evaluations + evaluations
        return out

    def with_share(self, share: float) -> Self:
        """The same equations with a part of what is left of the budget of evaluations."""
        left = self.most_evaluations - self.core.cost.evaluations
        return self if math.isinf(left) else self.within(int(share * max(left, 0.0)))

    @property
    def spent(self) -> bool:
        """Whether the budget of evaluations is used up."""
        return self.most_evaluations < math.inf and self.core.cost.evaluations >= self.most_evaluations

    def slices(self, harmonic: int) -> tuple[slice, slice]:
        """Places of the cosine and sine amplitudes of one harmonic (for 0: of the mean, and an empty one)."""
        n = self.n_mode
        if harmonic == 0:
            return slice(0, n[0]), slice(0, 0)
        start = int(n[0] + 2 * n[1:harmonic].sum())
        return slice(start, start + n[harmonic]), slice(start + n[harmonic], start + 2 * n[harmonic])

    def amplitudes(self, u: NDArray, harmonic: int) -> NDArray:
        """(..., n_modes) complex modal amplitudes of one harmonic."""
        c, s = self.slices(harmonic)
        if harmonic == 0:
            return u[..., c].astype(complex)
        return u[..., c] - 1j * u[..., s]

    def response(self, u: NDArray) -> NDArray:
        """(..., n_harmonics + 1) complex response amplitudes, the mean first."""
        u = np.asarray(u)
        return np.stack([self.amplitudes(u, l) @ self.response_rows[l] for l in range(self.n_harmonics + 1)], axis=-1)

    def excitation_ramp(self, omega: float, support: NDArray | None = None) -> HarmonicSystem:
        """The same equations with a factor on the excitation of harmonics as the parameter, at fixed omega.

        The last entry of a point ``y`` is then the factor, which also fades out the linear force ``support``
        (n_unknowns, n_unknowns), if there is one.
        """
        assert isinstance(self.core, _core.Sector)
        out = copy(self)
        ramp = self.force.copy()
        ramp[: self.n_mean] = 0.0
        out.core = _core.Eased(self.core, float(omega), ramp, support)
        out.supported = support is not None
        out.watched = []
        return out

    @property
    def supported_coordinates(self) -> list[NDArray]:
        """For each harmonic (n_modes,) bool: those of free bodies, or all if no body is free."""
        free = [basis.omega2 == 0.0 for basis in self.bases]
        return free if any(f.any() for f in free) else [np.ones_like(f) for f in free]

    def supported_by(self, omega: float, drag: float, spring: float) -> HarmonicSystem:
        """The same equations at fixed omega with free bodies on a support that fades as the parameter s goes to 1.

        Viscous ``drag`` on the vibration and ``spring`` on the mean of coordinates without stiffness of their own (of all,
        if there are none), in units of ``omega`` and ``omega**2``, times ``1/s - 1``.  The last entry of a point ``y`` is
        then s, which is also the factor on the excitation: bodies without preload, which answer in proportion to it, rest
        on the support at its start.
        """
        support = np.zeros((self.n_unknowns, self.n_unknowns))
        for l, free in enumerate(self.supported_coordinates):
            c, s = (np.arange(self.n_unknowns)[part] for part in self.slices(l))
            if l == 0:
                support[c[free], c[free]] = spring * omega**2
            else:
                support[c[free], s[free]] = drag * l * omega**2
                support[s[free], c[free]] = -drag * l * omega**2
        return self.excitation_ramp(omega, support)

    def evaluate_at(self, y: NDArray) -> tuple[NDArray, NDArray, NDArray]:
        """Residual, Jacobian and derivative with respect to the parameter at a point."""
        n = self.n_unknowns
        r, J, C = np.empty(n), np.empty((n, n)), np.empty(n)
        if self.core.evaluate(np.ascontiguousarray(y, float), r, J, C) != OK:
            raise FloatingPointError("the residual is not finite at this point")
        return r, J, C

    def evaluate(self, u: NDArray, omega: float) -> tuple[NDArray, NDArray, NDArray]:
        """Residual, Jacobian and derivative with respect to omega."""
        return self.evaluate_at(np.append(u, omega))

    def residual(self, y: NDArray) -> NDArray:
        """Residual alone at a point."""
        r = np.empty(self.n_unknowns)
        if self.core.evaluate(np.ascontiguousarray(y, float), r) != OK:
            raise FloatingPointError("the residual is not finite at this point")
        return r

    def solve(
        self,
        y: NDArray,
        condition: Condition,
        scale: NDArray,
        tolerance: float,
        max_iterations: int,
        line_search: int = 0,
        reach: float = 0.0,
        loose: float = 0.0,
        rough: float = 0.0,
    ) -> Correction:
        """Newton's method to where the equations and one condition hold.

        Parameters
        ----------
        y : (n_unknowns + 1,) float
            Guess.
        condition : Plane, Fixed, Fold or Peak
        scale : (n_unknowns + 1,) float
            Units of the unknowns.
        tolerance : float
            On the largest residual, relative to excitation and static load.
        max_iterations : int
        line_search : {0, 1, 2}
            1 halves a step that does not reduce the residual, 2 one that does not make the next one with the same factors
            shorter; for ``Plane`` and ``Fixed``.
        reach : float
            It ends without having converged where a Newton step is longer, in scaled unknowns, if that is not 0.
        loose : float
            A whole Newton step shorter than this ends it as converged, for ``Plane`` and ``Fixed``,
        rough : float
            if the residual is then below this, or whatever it is if that is 0.
        """
        end_if_asked()
        y = np.array(y, float)
        tangent, arguments = for_core(condition, self.n_unknowns)
        if isinstance(condition, Peak):
            arguments["re"], arguments["im"] = self.parts_at(y[-1])
        if self.spent:
            return Correction(NOT_CONVERGED, y, tangent, 0, np.nan, 0.0, 0)
        if self.most_evaluations < math.inf:
            left = int(self.most_evaluations) - self.core.cost.evaluations
            max_iterations = min(max_iterations, 1 + left // (LINE_SEARCH_TRIALS if line_search else 1))
        c = self.core.solve(
            y, tangent, scale, tolerance, max_iterations, int(line_search), reach, loose=loose, rough=rough, **arguments
        )
        return Correction(
            c.status, y, tangent, c.iterations, c.residual, c.condition, len(y) - c.rank, c.shares, c.orientation, c.slope,
            c.curvature,
        )  # fmt: skip

    def correct_at(
        self, u: NDArray, omega: float, scale: NDArray, tolerance: float, max_iterations: int, line_search: int = 0
    ) -> Correction:
        """Newton at a fixed frequency."""
        return self.solve(np.append(u, omega), Fixed(), scale, tolerance, max_iterations, line_search)

    def solve_linear(
        self, y: NDArray, border: NDArray, scale: NDArray, right: NDArray, transposed: bool = False
    ) -> NDArray:
        """Solutions with the Jacobian in scaled unknowns at a point, bordered by a row; of least norm where it is singular.

        Parameters
        ----------
        y, border, scale : (n_unknowns + 1,) float
        right : (m, n_unknowns + 1) float
            Right-hand sides.
        transposed : bool
            With the transposed matrix.
        """
        out = np.array(right, float)
        if self.core.bordered(np.ascontiguousarray(y, float), border, scale, out, transposed)[0] != OK:
            raise FloatingPointError("the bordered equations have no solution at this point")
        return out

    def slope_gradient(self, y: NDArray, tangent: NDArray, scale: NDArray, step: float) -> tuple[NDArray, NDArray]:
        """How the slope of ln(amplitude) along the curve changes with the point (``csrc/bd_solver.h``, ``bd_gradient``).

        Parameters
        ----------
        y, tangent, scale : (n_unknowns + 1,) float
            A point of the curve, its tangent of unit length in scaled unknowns, and their units.
        step : float
            Of the differences of Jacobians, in scaled unknowns.

        Returns
        -------
        row : (n_unknowns + 1,) float
            Gradient in scaled unknowns.
        nu : (n_unknowns,) float
            A change of the derivatives [J C] in scaled unknowns changes the slope by ``-nu @ change @ tangent``.
        """
        row, nu = np.empty(self.n_unknowns + 1), np.empty(self.n_unknowns)
        re, im = self.parts_at(y[-1])
        if self.core.gradient(np.ascontiguousarray(y, float), tangent, scale, row, nu, step, re, im) != OK:
            raise FloatingPointError("the slope has no gradient at this point")
        return row, nu

    @cached_property
    def response_parts(self) -> tuple[NDArray, NDArray]:
        """Rows of the unknowns that give real and imaginary part of the first harmonic of the response."""
        return self._parts(np.asarray(self.response_rows[1]))

    def _parts(self, row: NDArray) -> tuple[NDArray, NDArray]:
        """Real and imaginary part of a row (n_modes,) of the first harmonic, as rows of the unknowns."""
        re, im = np.zeros(self.n_unknowns), np.zeros(self.n_unknowns)
        c, s = self.slices(1)
        re[c], re[s] = row.real, row.imag
        im[c], im[s] = row.imag, -row.real
        return re, im

    def parts_at(self, omega: float) -> tuple[NDArray, NDArray]:
        """These rows at a frequency: the same at all."""
        return self.response_parts

    def at(self, omega: float) -> HarmonicSystem:
        """The equations around a frequency: these at all."""
        return self

    def vibration(self, y: NDArray) -> float:
        """Size of the vibration at a point."""
        return norm2(y[self.n_mean : -1])

    def units(self, y: NDArray, vibration: float, width: float) -> NDArray:
        """(n_unknowns + 1,) units of the mean, of the vibration and of the parameter (``width``) at a point."""
        scale = np.full(len(y), vibration)
        scale[: self.n_mean] = max(norm2(y[: self.n_mean]), vibration)
        scale[-1] = width
        return scale

    def place(self, parameter: float) -> str:
        """A value of the parameter in words."""
        return f"{parameter / (2.0 * np.pi):.6g} Hz"

    def first_harmonic(self, y: NDArray) -> NDArray:
        """(...,) complex amplitude of the first harmonic of the response at points (..., n_unknowns + 1)."""
        return np.asarray(self.amplitudes(y[..., :-1], 1) @ self.response_rows[1])

    def squared_gradient(self, y: NDArray) -> tuple[NDArray, float]:
        """Gradient of half the squared amplitude of the first harmonic with respect to y, and the squared amplitude."""
        re, im = self.parts_at(y[-1])
        a, b = float(re @ y[:-1]), float(im @ y[:-1])
        return np.append(a * re + b * im, 0.0), a * a + b * b

    def contact(self, u: NDArray) -> tuple[NDArray, NDArray, NDArray]:
        """Relative motion and force (n_points, 3, n_coef) and shares (n_points, 5) at a point."""
        n_coef = 2 * self.n_harmonics + 1
        X, F = np.empty((self.n_points, 3, n_coef)), np.empty((self.n_points, 3, n_coef))
        share = np.empty((self.n_points, 5))
        if self.core.contact(np.append(u, 1.0), X, F, share) != OK:
            raise FloatingPointError("the contact forces are not finite at this point")
        return X, F, share

    def closing(self, u: NDArray, direction: NDArray) -> tuple[NDArray, NDArray]:
        """Largest closing in the cycle at every contact point, and its rate along a direction of the mean.

        Parameters
        ----------
        u : (n_unknowns,) float
        direction : (n_mean,) float

        Returns
        -------
        closing : (n_points,) float, m
            Negative: the gap that is left, so the point is open all the cycle; 0 for points without a normal spring.
        rate : (n_points,) float
            m per unit of the direction.
        """
        X, _, _ = self.contact(u)
        theta = np.linspace(0.0, 2.0 * np.pi, 64 * self.n_harmonics, endpoint=False)
        l = np.arange(1, self.n_harmonics + 1)
        wave = np.stack([np.cos(np.outer(l, theta)), np.sin(np.outer(l, theta))], axis=1).reshape(-1, len(theta))
        kn = self.arrays["kn"]
        held = kn > 0.0
        closing = (X[:, 2, :1] + X[:, 2, 1:] @ wave).max(axis=1) + self.arrays["n0"] / np.where(held, kn, 1.0)
        return np.where(held, closing, 0.0), self.bases[0].G[:, 2].real @ direction

    def linear_matrix(self, omega: float, contact: NDArray | None, harmonic: int = 1) -> NDArray:
        """Complex dynamic stiffness of one harmonic with linear springs (n_points, 3) at the contact points."""
        b = self.spring_bases[harmonic]
        w = harmonic * omega
        Z = np.diag(b.omega2 - w**2 * b.mass + 1j * w * b.damping).astype(complex)
        if contact is not None or np.any(self.springs):
            G = b.G.reshape(-1, 3, len(b.omega2))
            k = np.broadcast_to(self.springs + (0.0 if contact is None else contact), G.shape[:2])
            Z += G.reshape(-1, len(b.omega2)).conj().T @ (k[..., None] * G).reshape(-1, len(b.omega2))
        return Z

    def linear_modes(self, contact: NDArray | None, harmonic: int = 1) -> tuple[NDArray, NDArray]:
        """Undamped frequencies (rad/s), ascending, and mass-normalised modes under linear springs (n_points, 3).

        Modal coordinates without mass follow the others statically and add no frequency.
        """
        b = self.bases[harmonic]
        K = self.linear_matrix(0.0, contact, harmonic)
        shift = max(float(np.abs(np.diag(K)).max()) * 1e-6, 1.0)  # free rigid-body modes have no stiffness
        M = np.diag(b.mass)
        inverse, vectors = scipy.linalg.eigh(M, 0.5 * (K + K.conj().T) + shift * M)
        keep = np.flatnonzero(inverse > 1e-12 * inverse[-1])[::-1]
        pole = np.maximum(1.0 / inverse[keep] - shift, 0.0)
        return np.sqrt(pole), vectors[:, keep] / np.sqrt(inverse[keep])

    def linear_response(self, omega: float, contact: NDArray | None, harmonic: int = 1) -> NDArray:
        """Complex modal amplitudes of one harmonic under linear contact; rigid modes without any contact stay at rest."""
        c, s = self.slices(harmonic)
        e = self.force[c] - 1j * self.force[s]
        return np.linalg.lstsq(self.linear_matrix(omega, contact, harmonic), e, rcond=1e-14)[0]

    def pack(self, mean: NDArray, harmonic_one: NDArray) -> NDArray:
        """Unknowns from the mean and the complex amplitudes of the first harmonic, the others zero."""
        u = np.zeros(self.n_unknowns)
        u[: self.n_mean] = mean
        c, s = self.slices(1)
        u[c], u[s] = harmonic_one.real, -harmonic_one.imag
        return u


def segments(
    x: NDArray,
    kt: NDArray,
    kn: float,
    mu: float,
    n0: float,
    slider: NDArray,
    law: int = LAW_SEPARABLE,
    evaluation: str | Sampled = "exact",
    load: float | None = None,
) -> list[list[tuple[float, float, int]]]:
    """Parts of the cycle at one contact point: for each tangential direction a list of (start, end, state).

    Parameters
    ----------
    x : (3, n_coef) float
        Motion (u1, u2, v) as coefficients.
    evaluation : {"exact"} or Sampled
        Coupled laws need samples.
    load : float, N, optional
        Normal load that limits friction under the laws of constant load; ``n0`` by default.

    Returns
    -------
    list of two lists; states 0 stick, 1 slip + (or slip of a coupled law), 2 slip -, 3 open; angles in radians, the last
    may pass 2 pi.
    """
    F = np.empty_like(x)
    J = np.empty(x.shape + x.shape)
    mode, n_time = evaluation_code(evaluation, x.shape[1] // 2, np.array(law))
    _, parts = _core.evaluate_contact(
        np.ascontiguousarray(x), kt, kn, mu, n0, slider, F, J, law, mode, n_time, n0 if load is None else load
    )
    return list(parts)


def evaluation_code(evaluation: str | Sampled, harmonics: int, law: NDArray) -> tuple[int, int]:
    if evaluation == "exact" and ((law == LAW_COUPLED) | (law == LAW_COUPLED_CONSTANT)).any():
        raise SettingError(
            'evaluation: expected Sampled(n_time) with coupled friction, which has no closed form, found "exact"'
        )
    check_evaluation(evaluation, harmonics)
    if isinstance(evaluation, Sampled):
        return (1 if evaluation.interpolate else 2), evaluation.n_time
    return 0, 0
