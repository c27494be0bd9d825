"""Equations ``R(u, p) = 0`` as whoever solves or follows them sees them: for a sector, along the line of an engine order,
for a nonlinear mode, or for a whole wheel.

A point is ``y = (u, p)``: the unknowns ``u``, which are the ``n_mode[0]`` coordinates of the mean and then for each
harmonic its cosine and its sine amplitudes, and the free parameter ``p``, mostly the frequency.  The core evaluates and
solves; small objects say what else differs: rows of the response (:class:`Rows`) and units of a point (:class:`Measure`).

What is asked of a point beside the equations: one condition for the one free parameter.

A linear one is a plane in scaled unknowns; a stationary one holds where something has no slope along the curve, which
Newton's method on the curve and a secant along it find together (``csrc/bd_solver.c``).
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

# ---- What is asked of a point beside the equations ----


@dataclass(frozen=True)
class Plane:
    """A plane through the guess.

    Parameters
    ----------
    normal : (n_unknowns + 1,) float
        In scaled unknowns; the tangent that is found points along it.
    """

    normal: NDArray


@dataclass(frozen=True)
class Fixed:
    """The parameter stays where the guess has it."""


@dataclass(frozen=True)
class Stationary:
    """Something has no slope along the curve.

    Parameters
    ----------
    tangent : (n_unknowns + 1,) float
        Estimate of the direction of the curve, of unit length in scaled unknowns.
    curvature : float
        Estimate of the derivative along the curve of what vanishes; its sign is that of the point.
    tolerance : float
        On the distance to the point, in scaled unknowns.
    max_step : float
        Along the curve at a time, in scaled unknowns.
    """

    tangent: NDArray
    curvature: float
    tolerance: float
    max_step: float


class Fold(Stationary):
    """The parameter: the tangent's last entry vanishes."""


class Peak(Stationary):
    """The amplitude of the first harmonic of the response, at a maximum: the slope of its logarithm falls through zero."""


Condition = Plane | Fixed | Fold | Peak


def for_core(condition: Condition, n_unknowns: int) -> tuple[NDArray, dict[str, Any]]:
    """The tangent on entry, which becomes that of the point found, and other arguments of the core's ``solve``."""
    if isinstance(condition, Plane):
        return np.zeros(n_unknowns + 1), {"row": condition.normal}
    if isinstance(condition, Fixed):
        return np.zeros(n_unknowns + 1), {"row": np.append(np.zeros(n_unknowns), 1.0)}
    return np.array(condition.tangent, float), {
        "curvature": condition.curvature, "place_tolerance": condition.tolerance, "max_step": condition.max_step,
    }  # fmt: skip


# ---- Equations ``R(u, p) = 0`` as whoever solves or follows them sees them ----


OK, NOT_CONVERGED, DIVERGED, SINGULAR, NOT_FINITE = range(5)
STATUS_TEXT = {
    OK: "converged",
    NOT_CONVERGED: "Newton did not converge",
    DIVERGED: "Newton diverged",
    SINGULAR: "singular Jacobian",
    NOT_FINITE: "not finite",
}
Core = _core.Sector | _core.Eased | _core.Modes | _core.Wheel
WheelCore = _core.Wheel
"""Equations of all sectors of a wheel (``csrc/bd_wheel.h``), for :mod:`bdamper.mistuning.wheel_equations`."""
LINE_SEARCH_TRIALS = 15
"""Most evaluations of an iteration with line search."""
S = TypeVar("S")


def norm2(x: NDArray) -> float:
    """Euclidean norm of a vector."""
    return math.sqrt(x.dot(x))


@short_repr
@dataclass(frozen=True)
class Correction:
    """Outcome of one Newton corrector: where it converged, a point of a curve.

    Parameters
    ----------
    status : int
    y, tangent : (n_unknowns + 1,) float
        Point and direction of the curve, the latter of unit length in scaled unknowns.
    scale : (n_unknowns + 1,) float
        Units of the unknowns.
    iterations : int
    residual : float
        Largest residual relative to the excitation (harmonics) or the static load (mean).
    rank_deficiency : int
        Directions that the equations leave undetermined, held by least norm.
    shares : tuple of three floats
        Shares of the cycle that stick, slip and are open at ``y``, averaged over the points with friction; NaN where the
        core has not evaluated it.
    orientation : int
        Sign of det [J; tangent], which stays the same along a curve, corners included; 0 if it is not known.
    slope, curvature : float
        Of a stationary point: what vanishes there, and its derivative along the curve.
    kind : str
        On a path: "regular", "fold", "maximum", "end", or "drift": the mean position moves while vibration and frequency
        stay.
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


@dataclass(frozen=True, eq=False)
class Layout:
    """Places of the harmonics among the unknowns.

    Parameters
    ----------
    n_mode : (n_harmonics + 1,) int
        Coordinates of each harmonic, the mean first.
    """

    n_mode: NDArray

    @property
    def n_unknowns(self) -> int:
        """Number of unknowns of all harmonics."""
        return int(self.n_mode[0] + 2 * self.n_mode[1:].sum())

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
        return u[..., c].astype(complex) if harmonic == 0 else u[..., c] - 1j * u[..., s]

    def parts(self, row: NDArray) -> tuple[NDArray, NDArray]:
        """Real and imaginary part of a row (n_modes,) of the first harmonic, as rows (n_unknowns,)."""
        re, im = np.zeros(self.n_unknowns), np.zeros(self.n_unknowns)
        c, s = self.slices(1)
        re[c], re[s] = row.real, row.imag
        im[c], im[s] = row.imag, -row.real
        return re, im

    def pack(self, mean: NDArray, first: NDArray) -> NDArray:
        """Unknowns from the mean and the complex amplitudes of the first harmonic, the others zero."""
        u = np.zeros(self.n_unknowns)
        u[: self.n_mode[0]] = mean
        c, s = self.slices(1)
        u[c], u[s] = first.real, -first.imag
        return u


@dataclass(frozen=True, eq=False)
class Rows:
    """Real and imaginary part of the quantity of which peaks are maxima, as rows of the unknowns.

    Parameters
    ----------
    coefficients : (n, 2, n_unknowns) float
        Of Chebyshev polynomials of the squared rotor speed; one where the rows do not change.
    squares : (middle, half) float
        Interval of the squared speed, rad2/s2.
    engine_order : int
        Ratio of the parameter (rad/s) to the speed.
    """

    coefficients: NDArray
    squares: tuple[float, float] = (0.0, 1.0)
    engine_order: int = 1

    @property
    def moving(self) -> bool:
        """Whether the rows change with the parameter."""
        return len(self.coefficients) > 1

    def basis(self, omega: NDArray | float, n: int) -> NDArray:
        """(..., n) Chebyshev polynomials of the squared speed at values of the parameter."""
        t = ((omega / self.engine_order) ** 2 - self.squares[0]) / self.squares[1]
        values = [0.0 * t + 1.0, t]
        while len(values) < n:
            values.append(2.0 * t * values[-1] - values[-2])
        return np.array(values[:n]).T

    def at(self, omega: float) -> tuple[NDArray, NDArray]:
        """Both rows at a value of the parameter."""
        if not self.moving:
            return self.coefficients[0, 0], self.coefficients[0, 1]
        re, im = np.tensordot(self.basis(omega, len(self.coefficients)), self.coefficients, 1)
        return re, im

    def value(self, y: NDArray) -> NDArray:
        """(...,) complex quantity at points (..., n_unknowns + 1)."""
        rows = np.tensordot(self.basis(y[..., -1], len(self.coefficients)), self.coefficients, 1)
        return np.asarray(((rows[..., 0, :] + 1j * rows[..., 1, :]) * y[..., :-1]).sum(axis=-1))

    def squared_gradient(self, y: NDArray) -> tuple[NDArray, float]:
        """Gradient of half the squared quantity with respect to y, and the squared quantity."""
        omega, u = float(y[-1]), y[:-1]
        re, im = self.at(omega)
        a, b, by_parameter = float(re @ u), float(im @ u), 0.0
        if self.moving:
            slopes = chebyshev.chebder(self.coefficients) / self.squares[1]
            da, db = np.tensordot(self.basis(omega, len(slopes)), slopes, 1) @ u
            by_parameter = (a * float(da) + b * float(db)) * 2.0 * omega / self.engine_order**2
        return np.append(a * re + b * im, by_parameter), a * a + b * b


class Measure(Protocol):
    """Units of a point, which decide how long a step along a curve is."""

    def vibration(self, y: NDArray) -> float:
        """Size of the vibration at a point."""

    def units(self, y: NDArray, vibration: float, width: float) -> NDArray:
        """(n_unknowns + 1,) units of the mean, of the vibration and of the parameter (``width``) at a point."""

    def place(self, parameter: float) -> str:
        """A value of the parameter in words."""


@dataclass(frozen=True)
class InFrequency:
    """Units where the parameter is the frequency (rad/s)."""

    n_mean: int

    def vibration(self, y: NDArray) -> float:
        """Norm of the harmonics."""
        return norm2(y[self.n_mean : -1])

    def units(self, y: NDArray, vibration: float, width: float) -> NDArray:
        """The mean counts as much as the vibration unless it is larger."""
        scale = np.full(len(y), vibration)
        scale[: self.n_mean] = max(norm2(y[: self.n_mean]), vibration)
        scale[-1] = width
        return scale

    def place(self, parameter: float) -> str:
        """The frequency."""
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
        What the equations are of: a sector, a family over speed, a mode, a wheel.
    layout : Layout
    response_rows : sequence of (n_modes,) complex
        Row of modal amplitudes that gives the response, for each harmonic.
    rows : Rows
    measure : Measure
    row_scale : (n_unknowns,) float
        Residuals to those relative to excitation or static load.
    n_points : int
        Contact points.
    work : (4,) float
        Million operations of an evaluation, a Jacobian, a factorisation and a solution by least norm
        (:class:`bdamper.util.progress.Cost`).
    supported : bool
        Whether the parameter fades a support out (:func:`bdamper.harmonic_balance.sector.supported_by`).
    watched : sequence of (frequency, half-width, modal row), rad/s
        Linear resonances that a path must not step over.
    last : float
        Evaluations of the core, those before a budget began included, after which no correction is begun.
    forms_matrix : bool
        Whether the whole Jacobian can be formed where it is asked for.
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

    # ---- sizes, and what is read from a point ----

    @property
    def n_unknowns(self) -> int:
        """Unknowns besides the parameter."""
        return len(self.row_scale)

    @property
    def n_mean(self) -> int:
        """Coordinates of the mean, which come first."""
        return int(self.layout.n_mode[0])

    @property
    def n_harmonics(self) -> int:
        """Highest harmonic."""
        return len(self.layout.n_mode) - 1

    def response(self, u: NDArray) -> NDArray:
        """(..., n_harmonics + 1) complex response amplitudes, the mean first."""
        rows = self.response_rows
        return np.stack([self.layout.amplitudes(np.asarray(u), l) @ rows[l] for l in range(self.n_harmonics + 1)], axis=-1)

    def units(self, y: NDArray, width: float) -> NDArray:
        """(n_unknowns + 1,) units of the mean, of the vibration and of the parameter (``width``) at a point."""
        return self.measure.units(y, max(self.measure.vibration(y), 1e-300), width)

    # ---- budget ----

    def within(self, evaluations: int) -> Equations[S]:
        """The same equations with a budget: no correction is begun after so many evaluations from now on."""
        return replace(self, last=self.core.cost.evaluations + evaluations)

    def with_share(self, share: float) -> Equations[S]:
        """The same equations with a part of what is left of the budget."""
        return self if self.last == math.inf else self.within(int(share * max(self.left, 0)))

    @property
    def left(self) -> float:
        """Evaluations left of the budget; infinite without one."""
        return self.last - self.core.cost.evaluations

    @property
    def spent(self) -> bool:
        """Whether the budget is used up."""
        return self.left <= 0

    # ---- evaluation ----

    def evaluate_at(self, y: NDArray) -> tuple[NDArray, NDArray, NDArray]:
        """Residual, Jacobian and derivative with respect to the parameter at a point.

        Raises
        ------
        FloatingPointError
            If they are not finite, or the matrix is too large to be formed.
        """
        if not self.forms_matrix:
            raise FloatingPointError("the matrix of a large wheel is not formed")
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

    def error(self, y: NDArray) -> float:
        """Largest residual at a point, relative to excitation and static load."""
        return float(np.abs(self.residual(y) * self.row_scale).max())

    def contact(self, u: NDArray) -> tuple[NDArray, NDArray, NDArray]:
        """Relative motion and force (n_points, 3, n_coef) and shares (n_points, 5) at a point."""
        n_coef = 2 * self.n_harmonics + 1
        X, F = np.empty((self.n_points, 3, n_coef)), np.empty((self.n_points, 3, n_coef))
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
        raise_if_stopped()
        y = np.array(y, float)
        tangent, arguments = for_core(condition, self.n_unknowns)
        if isinstance(condition, Peak):
            arguments["re"], arguments["im"] = self.rows.at(y[-1])
        if self.spent:
            return Correction(NOT_CONVERGED, y, tangent, scale, 0, np.nan, 0)
        if self.last < math.inf:
            max_iterations = min(max_iterations, 1 + int(self.left) // (LINE_SEARCH_TRIALS if line_search else 1))
        c = self.core.solve(
            y, tangent, scale, tolerance, max_iterations, int(line_search), reach, loose=loose, rough=rough, **arguments
        )
        found = Correction(
            c.status, y, tangent, scale, c.iterations, c.residual, len(y) - c.rank, c.shares, c.orientation,
            c.slope, c.curvature,
        )  # fmt: skip
        if isinstance(condition, Peak) and self.rows.moving:
            return self._to_own_peak(found, condition, scale, tolerance, max_iterations)
        return found

    def _to_own_peak(
        self, c: Correction, condition: Peak, scale: NDArray, tolerance: float, max_iterations: int
    ) -> Correction:
        """From the peak of the response with its rows held to that with its own, by secants."""
        for _ in range(max_iterations):
            if c.status != OK or not c.curvature < 0.0:
                break
            gradient, square = self.rows.squared_gradient(c.y)
            way = -float(gradient @ (c.tangent * scale)) / square / c.curvature
            if abs(way) <= condition.tolerance:
                break
            beside = self.solve(c.y + way * c.tangent * scale, Plane(c.tangent), scale, tolerance, max_iterations)
            c = replace(beside, curvature=c.curvature, slope=0.0, iterations=c.iterations + beside.iterations)
        return c

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
        re, im = self.rows.at(y[-1])
        if self.core.gradient(np.ascontiguousarray(y, float), tangent, scale, row, nu, step, re, im) != OK:
            raise FloatingPointError("the slope has no gradient at this point")
        return row, nu
