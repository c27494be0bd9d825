"""Harmonic balance equations ``R(u, p) = 0`` (paper, Eq. (16)), and Newton's method for them.

For the complex modal amplitudes ``q_l`` of harmonic ``l``,

    R_l = (K - (l omega)^2 M + i l omega C) q_l + G_l^H F_l(q) - E_l = 0,

with the Fourier coefficients ``F_l`` of the contact forces (paper, Eq. (15)), the modes ``G_l`` at
the contact points and the modal forces ``E_l`` of the excitation.  Harmonic 0 is the mean, which
carries the static load.

The unknowns ``u`` hold the ``n_mode[0]`` coordinates of the mean, then for each harmonic its cosine
amplitudes ``c_l`` and its sine amplitudes ``s_l``, ``q_l = c_l - i s_l`` (:class:`Layout`).  A
point is ``y = (u, p)`` with one free parameter ``p``, usually the frequency ``omega`` in rad/s.
Newton's method solves the equations with one further condition for ``p``:

- :class:`Plane`: the point lies in a plane through the guess (arc-length continuation);
- :class:`Fixed`: the parameter is fixed;
- :class:`Fold` and :class:`Maximum`: a quantity is stationary along the curve
  (``csrc/solver/newton.c``).

The same class :class:`Equations` serves one sector, a curve along an engine order line, a nonlinear
mode and a bladed disk. They differ in the core object, in the rows that give the response
(:class:`Rows`) and in the units of a point (:class:`Measure`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Generic, Protocol, TypeVar

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from bdamper import _core
from bdamper.util.formatting import short_repr
from bdamper.util.progress import raise_if_stopped

# ---- conditions for the free parameter ----


@dataclass(frozen=True)
class Plane:
    """Plane through the guess.

    Parameters
    ----------
    normal : (n_unknowns + 1,) float
        Normal vector in scaled unknowns.  The tangent of the solution points to the same side.
    """

    normal: NDArray


@dataclass(frozen=True)
class Fixed:
    """Parameter fixed at the value of the guess."""


@dataclass(frozen=True)
class Stationary:
    """Stationary point: the slope of a quantity along the curve vanishes.

    Parameters
    ----------
    tangent : (n_unknowns + 1,) float
        Estimated tangent of the curve, of unit length in scaled unknowns.
    curvature : float
        Estimated derivative of the slope along the curve.  It has the sign of the derivative at the
        solution.
    tolerance : float
        Tolerance of the distance to the point, in scaled unknowns.
    max_step : float
        Largest single step along the curve, in scaled unknowns.
    """

    tangent: NDArray
    curvature: float
    tolerance: float
    max_step: float


class Fold(Stationary):
    """Turning point of the parameter: the last entry of the tangent vanishes."""


class Maximum(Stationary):
    """Maximum of the first harmonic of the response: the slope of its logarithm vanishes, its
    curvature is negative."""


Condition = Plane | Fixed | Fold | Maximum


def for_core(condition: Condition, n_unknowns: int) -> tuple[NDArray, dict[str, Any]]:
    """Return the initial tangent and the further arguments of the core's ``solve``; the core
    overwrites the tangent."""
    if isinstance(condition, Plane):
        return np.zeros(n_unknowns + 1), {"row": condition.normal}
    if isinstance(condition, Fixed):
        # along the parameter, the last unknown
        parameter = np.append(np.zeros(n_unknowns), 1.0)
        return np.zeros(n_unknowns + 1), {"row": parameter}
    arguments = {
        "curvature": condition.curvature,
        "place_tolerance": condition.tolerance,
        "max_step": condition.max_step,
    }
    return np.array(condition.tangent, float), arguments


# ---- equations and their unknowns ----


OK, NOT_CONVERGED, DIVERGED, SINGULAR, NOT_FINITE = range(5)
STATUS_TEXT = {
    OK: "converged",
    NOT_CONVERGED: "the iteration did not converge",
    DIVERGED: "the iteration diverged",
    SINGULAR: "the equations are singular",
    NOT_FINITE: "not finite",
}
Core = _core.SectorEquations | _core.Eased | _core.Modes | _core.Wheel
WheelCore = _core.Wheel
"""Core object of all sectors of a bladed disk (``csrc/bladed_disk/wheel_equations.h``), for
:mod:`bdamper.mistuning.disk_equations`."""
LINE_SEARCH_TRIALS = 15
"""Largest number of evaluations in one iteration with line search."""
S = TypeVar("S")


def norm2(x: NDArray) -> float:
    """Return the Euclidean norm of a vector."""
    return math.sqrt(x.dot(x))


@short_repr
@dataclass(frozen=True)
class Correction:
    """Result of one Newton solution; if converged, a point of a curve.

    Parameters
    ----------
    status : int
        `OK` if converged, otherwise the reason (`STATUS_TEXT`).
    y, tangent : (n_unknowns + 1,) float
        Point and tangent of the curve, the tangent of unit length in scaled unknowns.
    scale : (n_unknowns + 1,) float
        Scale of each unknown.
    iterations : int
    residual : float
        Largest residual relative to the excitation (harmonics) or the static load (mean).
    rank_deficiency : int
        Number of directions that the equations do not determine.  In these directions, the solution
        has minimum norm.
    shares : tuple of three floats
        Fractions of the cycle in stick, slip and separation at ``y``, averaged over the points with
        friction.  NaN if the core has not evaluated them.
    orientation : int
        Sign of det [J; tangent], constant along a curve, corners included; 0 if unknown.
    slope, curvature : float
        Slope and its derivative along the curve, at a stationary point only; the slope vanishes
        there.
    kind : str
        On a path: "regular", "fold", "maximum", "end", or "drift" (the mean position moves at
        constant vibration and frequency).
    """

    status: int
    y: NDArray
    tangent: NDArray
    scale: NDArray
    iterations: int
    residual: float
    rank_deficiency: int
    shares: tuple[float, float, float] = (math.nan, math.nan, math.nan)
    orientation: int = 0
    slope: float = math.nan
    curvature: float = math.nan
    kind: str = "regular"

    @property
    def parameter(self) -> float:
        """Last entry of ``y``: frequency (rad/s), level of a homotopy, or ln(amplitude) of a mode."""
        # a number of NumPy, as the entry is
        parameter: float = self.y[-1]
        return parameter


@dataclass(frozen=True, eq=False)
class Layout:
    """Indices of the harmonics in the vector of unknowns.

    Parameters
    ----------
    n_mode : (n_harmonics + 1,) int
        Number of modes of the mean and of each harmonic.
    """

    n_mode: NDArray

    @property
    def n_unknowns(self) -> int:
        """Number of unknowns of all harmonics."""
        return int(self.n_mode[0] + 2 * self.n_mode[1:].sum())

    def slices(self, harmonic: int) -> tuple[slice, slice]:
        """Return the slices of the cosine and sine amplitudes of a harmonic; for the mean the
        second slice is empty."""
        n = self.n_mode
        if harmonic == 0:
            return slice(0, n[0]), slice(0, 0)
        start = int(n[0] + 2 * n[1:harmonic].sum())
        middle = start + n[harmonic]
        end = start + 2 * n[harmonic]
        return slice(start, middle), slice(middle, end)

    def amplitudes(self, u: NDArray, harmonic: int) -> NDArray:
        """Return the complex modal amplitudes (..., n_modes) of a harmonic."""
        cosine, sine = self.slices(harmonic)
        if harmonic == 0:
            return u[..., cosine].astype(complex)
        return u[..., cosine] - 1j * u[..., sine]

    def parts(self, row: NDArray) -> tuple[NDArray, NDArray]:
        """Return rows (n_unknowns,) whose products with the unknowns are the real and imaginary
        part of ``row @ q_1``.

        ``row`` (n_modes,) acts on the complex modal amplitudes ``q_1`` of the first harmonic.
        """
        cosine, sine = self.slices(1)
        # row @ (c - i s) = (Re row c + Im row s) + i (Im row c - Re row s)
        re = np.zeros(self.n_unknowns)
        re[cosine] = row.real
        re[sine] = row.imag
        im = np.zeros(self.n_unknowns)
        im[cosine] = row.imag
        im[sine] = -row.real
        return re, im

    def pack(self, mean: NDArray, first: NDArray) -> NDArray:
        """Return unknowns from the mean and the complex amplitudes of the first harmonic; higher
        harmonics are zero."""
        u = np.zeros(self.n_unknowns)
        u[: self.n_mode[0]] = mean
        cosine, sine = self.slices(1)
        u[cosine] = first.real
        u[sine] = -first.imag
        return u


@dataclass(frozen=True, eq=False)
class Rows:
    """Rows (n_unknowns,) whose products with the unknowns are the real and imaginary part of the
    first harmonic.

    Parameters
    ----------
    coefficients : (n, 2, n_unknowns) float
        Coefficients of Chebyshev polynomials in the squared rotor speed; n is 1 if the rows are
        constant.
    squares : (middle, half) float
        Interval of the squared speed, rad2/s2.
    engine_order : int
        Ratio of the parameter (rad/s) to the rotor speed.
    """

    coefficients: NDArray
    squares: tuple[float, float] = (0.0, 1.0)
    engine_order: int = 1

    @property
    def moving(self) -> bool:
        """Whether the rows change with the parameter."""
        return len(self.coefficients) > 1

    def basis(self, omega: NDArray | float, n: int) -> NDArray:
        """Return the first n Chebyshev polynomials (..., n) of the squared speed at values of the
        parameter."""
        middle, half = self.squares
        t = ((omega / self.engine_order) ** 2 - middle) / half
        # T_0 = 1 has the shape of t; T_k+1 = 2 t T_k - T_k-1
        values = [0.0 * t + 1.0, t]
        while len(values) < n:
            values.append(2.0 * t * values[-1] - values[-2])
        return np.array(values[:n]).T

    def at(self, omega: float) -> tuple[NDArray, NDArray]:
        """Return both rows at a value of the parameter."""
        if not self.moving:
            return self.coefficients[0, 0], self.coefficients[0, 1]
        polynomials = self.basis(omega, len(self.coefficients))
        re, im = np.tensordot(polynomials, self.coefficients, 1)
        return re, im

    def value(self, y: NDArray) -> NDArray:
        """Return the complex response (...,) at points (..., n_unknowns + 1)."""
        rows = self.coefficients[0]
        if self.moving:
            polynomials = self.basis(y[..., -1], len(self.coefficients))
            rows = np.tensordot(polynomials, self.coefficients, 1)
        complex_rows = rows[..., 0, :] + 1j * rows[..., 1, :]
        u = y[..., :-1]
        return np.asarray((complex_rows * u).sum(axis=-1))

    def squared_gradient(self, y: NDArray) -> tuple[NDArray, float]:
        """Return the gradient of half the squared response with respect to y, and the squared
        response."""
        omega = float(y[-1])
        u = y[:-1]
        # rows (n_unknowns,) of the real and the imaginary part of the response
        real_row, imaginary_row = self.at(omega)
        real = float(real_row @ u)
        imaginary = float(imaginary_row @ u)
        by_parameter = 0.0
        if self.moving:
            # derivatives of both parts with respect to the squared speed (omega / engine order)^2
            _, half = self.squares
            slopes = chebyshev.chebder(self.coefficients) / half
            polynomials = self.basis(omega, len(slopes))
            d_real, d_imaginary = np.tensordot(polynomials, slopes, 1) @ u
            by_square = real * float(d_real) + imaginary * float(d_imaginary)
            by_parameter = by_square * 2.0 * omega / self.engine_order**2
        by_unknowns = real * real_row + imaginary * imaginary_row
        return np.append(by_unknowns, by_parameter), real * real + imaginary * imaginary


class Measure(Protocol):
    """Units of a point, which define the length of a step along a curve."""

    def vibration(self, y: NDArray) -> float:
        """Return the norm of the vibration at a point."""

    def units(self, y: NDArray, vibration: float, width: float) -> NDArray:
        """Return the units (n_unknowns + 1,) of mean, vibration and parameter (``width``) at a
        point."""

    def place(self, parameter: float) -> str:
        """Return a text for a value of the parameter."""


@dataclass(frozen=True)
class InFrequency:
    """Units if the parameter is the frequency (rad/s).

    Parameters
    ----------
    n_mean : int
        Number of unknowns of the mean.
    """

    n_mean: int

    def vibration(self, y: NDArray) -> float:
        """Return the norm of the harmonics."""
        return norm2(y[self.n_mean : -1])

    def units(self, y: NDArray, vibration: float, width: float) -> NDArray:
        """Return the units; the unit of the mean is the larger of the norms of mean and
        vibration."""
        scale = np.full(len(y), vibration)
        scale[: self.n_mean] = max(norm2(y[: self.n_mean]), vibration)
        scale[-1] = width
        return scale

    def place(self, parameter: float) -> str:
        """Return the frequency in Hz as text."""
        return f"{parameter / (2.0 * np.pi):.6g} Hz"


@short_repr
@dataclass(frozen=True, eq=False)
class Equations(Generic[S]):
    """Residual, Jacobian and Newton's method of one set of equations.

    Parameters
    ----------
    core
        Object of the C core.
    structure
        Structure that the equations describe: a sector, a sector with speed-dependent
        data, a mode or a bladed disk.
    layout : Layout
    response_rows : sequence of (n_modes,) complex
        For each harmonic, the row of modal amplitudes that gives the response.
    rows : Rows
    measure : Measure
    row_scale : (n_unknowns,) float
        Factors from residuals to residuals relative to the excitation or the static load.
    n_points : int
        Number of contact points.
    work : (4,) float
        Million operations of an evaluation, a Jacobian, a factorisation and a least-norm solution
        (:class:`bdamper.util.progress.Cost`).
    supported : bool
        Whether the parameter fades out a support
        (:func:`bdamper.harmonic_balance.sector.supported_by`).
    watched : sequence of (frequency, half-width, modal row), rad/s
        Linear resonances that a path must not step over.
    last : float
        Budget: no Newton iteration begins after this number of evaluations of the core, counted
        from its creation.
    forms_matrix : bool
        Whether the full Jacobian can be formed.
    """

    core: Core
    structure: S
    layout: Layout
    response_rows: Sequence[NDArray]
    rows: Rows
    measure: Measure
    row_scale: NDArray
    n_points: int
    work: NDArray
    supported: bool = False
    watched: Sequence[tuple[float, float, NDArray]] = ()
    last: float = math.inf
    forms_matrix: bool = True

    # ---- sizes and derived quantities ----

    @property
    def n_unknowns(self) -> int:
        """Number of unknowns without the parameter."""
        return len(self.row_scale)

    @property
    def n_mean(self) -> int:
        """Number of unknowns of the mean, which are the first unknowns."""
        return int(self.layout.n_mode[0])

    @property
    def n_harmonics(self) -> int:
        """Highest harmonic."""
        return len(self.layout.n_mode) - 1

    def response(self, u: NDArray) -> NDArray:
        """Return the complex response amplitudes (..., n_harmonics + 1) of mean and harmonics."""
        u = np.asarray(u)
        by_harmonic = []
        for l in range(self.n_harmonics + 1):
            by_harmonic.append(self.layout.amplitudes(u, l) @ self.response_rows[l])
        return np.stack(by_harmonic, axis=-1)

    def units(self, y: NDArray, width: float) -> NDArray:
        """Return the units (n_unknowns + 1,) of mean, vibration and parameter (``width``) at a
        point."""
        vibration = max(self.measure.vibration(y), 1e-300)
        return self.measure.units(y, vibration, width)

    # ---- budget ----

    def within(self, evaluations: int) -> Equations[S]:
        """Return the same equations, limited to ``evaluations`` further evaluations."""
        return replace(self, last=self.core.cost.evaluations + evaluations)

    def with_share(self, share: float) -> Equations[S]:
        """Return the same equations, limited to a fraction of the remaining evaluations."""
        if self.last == math.inf:
            return self
        return self.within(int(share * max(self.left, 0)))

    @property
    def left(self) -> float:
        """Remaining evaluations of the budget; infinite without a budget."""
        return self.last - self.core.cost.evaluations

    @property
    def spent(self) -> bool:
        """Whether the budget is used up."""
        return self.left <= 0

    # ---- evaluation ----

    def evaluate_at(self, y: NDArray) -> tuple[NDArray, NDArray, NDArray]:
        """Return residual, Jacobian and derivative with respect to the parameter at a point.

        Raises
        ------
        FloatingPointError
            If they are not finite, or if the matrix is too large to be formed.
        """
        if not self.forms_matrix:
            raise FloatingPointError("the matrix of a large wheel is not formed")
        n = self.n_unknowns
        r = np.empty(n)
        J = np.empty((n, n))
        C = np.empty(n)
        if self.core.evaluate(np.ascontiguousarray(y, float), r, J, C) != OK:
            raise FloatingPointError("the residual is not finite at this point")
        return r, J, C

    def evaluate(self, u: NDArray, omega: float) -> tuple[NDArray, NDArray, NDArray]:
        """Return residual, Jacobian and derivative with respect to omega (rad/s)."""
        return self.evaluate_at(np.append(u, omega))

    def residual(self, y: NDArray) -> NDArray:
        """Return the residual at a point."""
        r = np.empty(self.n_unknowns)
        if self.core.evaluate(np.ascontiguousarray(y, float), r) != OK:
            raise FloatingPointError("the residual is not finite at this point")
        return r

    def error(self, y: NDArray) -> float:
        """Return the largest residual at a point, relative to the excitation and the static
        load."""
        return float(np.abs(self.residual(y) * self.row_scale).max())

    def contact(self, u: NDArray) -> tuple[NDArray, NDArray, NDArray]:
        """Return Fourier coefficients of relative motion (m) and contact force (N), and the states,
        at unknowns ``u``.

        The coefficients are (n_points, 3, n_coef) along t1, t2, n. The states are fractions of the
        cycle (n_points, 5).
        """
        n_coef = 2 * self.n_harmonics + 1
        X = np.empty((self.n_points, 3, n_coef))
        F = np.empty((self.n_points, 3, n_coef))
        share = np.empty((self.n_points, 5))
        if self.core.contact(np.append(u, 1.0), X, F, share) != OK:
            raise FloatingPointError("the contact forces are not finite at this point")
        return X, F, share

    # ---- solution ----

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
        """Solve the equations and one condition for the parameter with Newton's method.

        Parameters
        ----------
        y : (n_unknowns + 1,) float
            Guess.
        condition : Plane, Fixed, Fold or Maximum
        scale : (n_unknowns + 1,) float
            Scale of each unknown.
        tolerance : float
            Tolerance of the largest residual, relative to the excitation and the static load.
        max_iterations : int
        line_search : {0, 1, 2}
            Only for ``Plane`` and ``Fixed``.  1 halves steps that do not reduce the residual.  2
            halves steps after which the next step with the same factorisation would not be shorter.
        reach : float
            Largest length of a Newton step in scaled unknowns.  A longer step ends the iteration
            without convergence; 0 means no limit.
        loose, rough : float
            Only for ``Plane`` and ``Fixed``.  A full Newton step shorter than ``loose`` counts as
            convergence if the residual is then below ``rough``; 0 for ``rough`` accepts any
            residual.

        Returns
        -------
        Correction
        """
        raise_if_stopped()
        y = np.array(y, float)
        tangent, arguments = for_core(condition, self.n_unknowns)
        if isinstance(condition, Maximum):
            arguments["re"], arguments["im"] = self.rows.at(y[-1])
        if self.spent:
            return Correction(
                NOT_CONVERGED,
                y,
                tangent,
                scale,
                iterations=0,
                residual=np.nan,
                rank_deficiency=0,
            )
        if self.last < math.inf:
            # an iteration that begins within the budget may exceed it
            per_iteration = LINE_SEARCH_TRIALS if line_search else 1
            max_iterations = min(max_iterations, 1 + int(self.left) // per_iteration)
        solution = self.core.solve(
            y,
            tangent,
            scale,
            tolerance,
            max_iterations,
            int(line_search),
            reach,
            loose=loose,
            rough=rough,
            **arguments,
        )
        # the core has written the point and its tangent into y and tangent
        result = Correction(
            status=solution.status,
            y=y,
            tangent=tangent,
            scale=scale,
            iterations=solution.iterations,
            residual=solution.residual,
            rank_deficiency=len(y) - solution.rank,
            shares=solution.shares,
            orientation=solution.orientation,
            slope=solution.slope,
            curvature=solution.curvature,
        )
        if isinstance(condition, Maximum) and self.rows.moving:
            return self._to_moving_peak(result, condition, scale, tolerance, max_iterations)
        return result

    def _to_moving_peak(
        self,
        c: Correction,
        condition: Maximum,
        scale: NDArray,
        tolerance: float,
        max_iterations: int,
    ) -> Correction:
        """Move a peak along the curve by Newton steps, if the response rows depend on the
        parameter."""
        for _ in range(max_iterations):
            if c.status != OK or not c.curvature < 0.0:
                break
            # slope of ln(amplitude) along the curve, divided by its estimated derivative
            gradient, square = self.rows.squared_gradient(c.y)
            step = -float(gradient @ (c.tangent * scale)) / square / c.curvature
            if abs(step) <= condition.tolerance:
                break
            guess = c.y + step * c.tangent * scale
            moved = self.solve(guess, Plane(c.tangent), scale, tolerance, max_iterations)
            c = replace(
                moved,
                curvature=c.curvature,
                slope=0.0,
                iterations=c.iterations + moved.iterations,
            )
        return c

    def correct_at(
        self,
        u: NDArray,
        omega: float,
        scale: NDArray,
        tolerance: float,
        max_iterations: int,
        line_search: int = 0,
    ) -> Correction:
        """Solve at a fixed frequency (rad/s); see :meth:`solve`."""
        guess = np.append(u, omega)
        return self.solve(guess, Fixed(), scale, tolerance, max_iterations, line_search)

    def solve_linear(
        self, y: NDArray, border: NDArray, scale: NDArray, right: NDArray, transposed: bool = False
    ) -> NDArray:
        """Solve linear equations with the scaled Jacobian at a point, bordered by a row; least norm
        if singular.

        Parameters
        ----------
        y, border, scale : (n_unknowns + 1,) float
        right : (m, n_unknowns + 1) float
            Right-hand sides.
        transposed : bool
            Whether to use the transposed matrix.

        Raises
        ------
        FloatingPointError
            If there is no solution.
        """
        point = np.ascontiguousarray(y, float)
        # the core overwrites the right-hand sides with the solutions
        solution = np.array(right, float)
        status = self.core.bordered(point, border, scale, solution, transposed)[0]
        if status != OK:
            raise FloatingPointError("the bordered equations have no solution at this point")
        return solution

    def slope_gradient(
        self, y: NDArray, tangent: NDArray, scale: NDArray, step: float
    ) -> tuple[NDArray, NDArray]:
        """Compute the gradient of the slope of ln(amplitude) along the curve
        (``csrc/solver/newton.h``, ``bd_gradient``).

        Parameters
        ----------
        y, tangent, scale : (n_unknowns + 1,) float
            Point of the curve, its tangent of unit length in scaled unknowns, and the units.
        step : float
            Step of the finite differences of Jacobians, in scaled unknowns.

        Returns
        -------
        row : (n_unknowns + 1,) float
            Gradient in scaled unknowns.
        nu : (n_unknowns,) float
            Adjoint vector: a change of the derivatives [J C] in scaled unknowns changes the slope
            by ``-nu @ change @ tangent``.

        Raises
        ------
        FloatingPointError
            If the gradient does not exist at this point.
        """
        point = np.ascontiguousarray(y, float)
        re, im = self.rows.at(y[-1])
        row = np.empty(self.n_unknowns + 1)
        nu = np.empty(self.n_unknowns)
        status = self.core.gradient(point, tangent, scale, row, nu, step, re, im)
        if status != OK:
            raise FloatingPointError("the slope has no gradient at this point")
        return row, nu
