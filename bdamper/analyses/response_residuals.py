r"""Residuals of computed against measured responses, and their derivatives with respect to parameters.

At a measured frequency the residual of the amplitude is :math:`\ln|X/X_i|/\sigma` with the standard deviation
:math:`\sigma` of the noise. If a phase was measured, its residual is :math:`2\sin(\tfrac12\arg(X/X_i))/\sigma`, which
equals the phase difference for small differences and is continuous. The computed response lies on the branch that the sweep
of the test follows. It is solved at the measured frequency itself, since interpolation along a curve causes ripples of the
residual that stop the search for the best parameters.

Near a jump of the sweep a small change of a parameter moves the point to another branch. Within a few frequency steps of a
jump the residual is therefore the distance from the measured point to the curve, stable or unstable. Coordinates are
ln(frequency) over the frequency step and ln(amplitude) over :math:`\sigma`. Elsewhere this distance is not used: a narrow
spike between two measured frequencies would not contribute.

If the rig controls the response, frequency and amplitude are settings and the force is the result. The residual is then
:math:`\ln(F_i/F)/\sigma`, with the force F at which the computed response has the measured amplitude. If it controls the
phase, the amplitude alone is a setting: F and the frequency are computed for the measured amplitude and phase. The second
residual is the difference of the frequencies times the slope of the phase, so that :math:`\sigma` is the noise of a phase.
Both remain unique where the response under a given force has several branches.

For a point of a nonlinear mode, damping ratio and frequency are compared at the measured amplitude. An error
of :math:`\sigma` in the phase of a resonance changes its frequency by the relative amount :math:`\zeta\sigma`.

:func:`bdamper.response.sensitivity.across` gives the derivatives across the curve.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Annotated, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from bdamper.analyses.nonlinear_mode import mode_points, mode_system
from bdamper.harmonic_balance.equations import OK, Correction, Equations, Plane, norm2
from bdamper.harmonic_balance.parameters import like, vary
from bdamper.harmonic_balance.problem import Problem
from bdamper.harmonic_balance.sector import Sector
from bdamper.importers.measured_modes import MeasuredMode
from bdamper.importers.measurements import Measured, Measurement
from bdamper.response.events import ContinuationOptions
from bdamper.response.highest_peak import highest_peak
from bdamper.response.linear_limits import linear_peak, peak_interval
from bdamper.response.peak import Family, Peak
from bdamper.response.response_curve import frequency_response, sweep_of
from bdamper.response.sensitivity import across, sensitivities
from bdamper.util import validation
from bdamper.util.display import Summarised
from bdamper.util.errors import BdamperError, ModelError, SettingError

T = TypeVar("T")
FORCE = "force_factor"
"""Parameter that multiplies the excitation of all tests."""
NEAR_JUMP = 5.0
"""Number of frequency steps around a jump within which points are compared with the complete curve."""
LOST = 10.0
"""Residual of a point without computed response."""
FARTHEST = 1e4
"""Ratio of the force that a measured response needs to the nominal force, or its inverse, at which the search ends."""
STEP = 1e-5
"""Relative step of the finite differences of the resonance without damper."""
BESIDE = 0.1
"""Relative margin of the curves beyond the frequencies measured under phase control."""
EDGE = 1e-6
"""Relative margin of the curves beyond the measured frequencies; also the step or distance that counts as zero."""


@validation.check_arguments
@dataclass(frozen=True)
class MeasuredResponse(Summarised, validation.Checked):
    """Measured response over frequency with its test conditions.

    Parameters
    ----------
    data : Measurement
        Displacement, velocity or acceleration at the response location of the study. If it has a phase, it is relative to
        the excitation: ``x(t) = Re(X exp(i omega t))`` under ``Re(F exp(i omega t))``.
    preload : float, N
        Preload of the damper.
    force : float, N, optional
        Nominal amplitude of the excitation; by default the force of the data at each point, otherwise the amplitude in the
        settings of the study.
    sweep : {"up", "down"}
        Direction of the frequency sweep.
    control : {"force", "response", "phase"}
        Quantity that the rig controls. "response": the force, measured at each point, is compared at the measured
        frequency and amplitude. "phase": force and frequency are compared at the measured amplitude and phase, of a
        displacement 90 degrees behind the force if no phase was measured.

    Raises
    ------
    SettingError
        If there are fewer than three frequencies (one under phase control), frequencies or amplitudes are not positive, or
        forces are missing.
    """

    __test__ = False  # pytest ignores this class
    data: Measurement
    preload: validation.Force = 0.0
    force: Annotated[float, validation.Limits(above=0.0, unit="N")] | None = None
    sweep: Literal["up", "down"] = "up"
    control: Literal["force", "response", "phase"] = "force"

    def __post_init__(self) -> None:
        super().__post_init__()
        validation.instance(
            "data",
            self.data,
            Measurement,
            "a Measurement, as bdamper.importers.read_response reads it",
        )
        name, least = self.data.name, min(self.data.frequency.min(), self.data.amplitude.min())
        _ = self.data.displacement  # raises for an unknown unit
        if self.control != "phase":
            validation.check(
                len(np.unique(self.data.frequency)) > 2, name, "three frequencies or more", "fewer"
            )
        if self.control != "force":
            given = self.force is None and self.data.force is not None
            validation.check(
                given, name, f"a measured force at each point under {self.control} control", "none"
            )
        validation.check(least > 0.0, name, "frequencies and amplitudes above 0", f"{least:g}")

    @property
    def nominal(self) -> float | None:
        """Nominal force (N): the median if it was measured at each point; None if the amplitude of the study applies."""
        measured = self.force is None and self.data.force is not None
        return float(np.median(self.data.force)) if measured else self.force  # type: ignore[arg-type]

    @property
    def factors(self) -> NDArray:
        """Force at each point over the nominal force, (n,)."""
        if self.force is not None or self.data.force is None:
            return np.ones(len(self.data.frequency))
        return np.asarray(self.data.force) / self.nominal

    def __str__(self) -> str:
        force = "" if self.force is None else f", {self.force:g} N"
        return f"{self.data.name} ({self.preload:g} N{force}, {self.sweep})"


def forced(system: Equations[Sector], factor: float) -> Equations[Sector]:
    """Return the equations with the excitation multiplied by a factor, under the same static load."""
    if factor == 1.0:
        return system
    sector = system.structure
    force = np.array(sector.force)
    force[system.n_mean :] *= factor
    return replace(
        sector, force=force, force_scale=(sector.force_scale[0], factor * sector.force_scale[1])
    ).equations


class Variations:
    """Problem at given parameters and at neighbouring values, with comparable unknowns.

    Parameters
    ----------
    make : callable
        Returns the problem at a mapping of parameters to values.
    values : mapping of name to float
        Parameters. ``"force_factor"`` is not passed to ``make``; it multiplies the excitation of every test.
    """

    def __init__(
        self, make: Callable[[dict[str, float]], Problem], values: dict[str, float]
    ) -> None:
        self.make, self.values = make, values
        self.own = self._at(values)
        _ = self.own.bases, self.own.static_states  # computed once for all tests
        self._neighbours: dict[tuple[str, float], Problem] = {}

    def _at(self, values: dict[str, float]) -> Problem:
        return self.make({name: value for name, value in values.items() if name != FORCE})

    def neighbour(self, name: str, value: float) -> Problem:
        """Return the problem with another value of one parameter."""
        if name == FORCE or value == self.values[name]:
            return self.own
        if (name, value) not in self._neighbours:
            problem = like(self._at(self.values | {name: value}), self.own)
            _ = problem.static_states
            self._neighbours[name, value] = problem
        return self._neighbours[name, value]

    def ratio(self, force: float | None, gain: float | None = None) -> float:
        """Return ``gain`` times the ratio of a force amplitude (N), or 1 for None, to the force amplitude of the study."""
        gain = self.values.get(FORCE, 1.0) if gain is None else gain
        return gain * (1.0 if force is None else force / self.own.settings.excitation.amplitude)

    def under(self, force: float | None, problem: Problem | None = None) -> Problem:
        """Return the problem under the force amplitude of a test (N), or under the amplitude of the study for None."""
        amplitude = self.ratio(force) * self.own.settings.excitation.amplitude
        return vary(problem or self.own, {"excitation.amplitude": amplitude})

    def system(self, force: float | None, preload: float) -> Equations[Sector]:
        """Return the equations at one preload under the force amplitude of a test."""
        return forced(self.own.system(preload), self.ratio(force))

    def families(self, force: float | None, preload: float) -> dict[str, tuple[Family, float]]:
        """Return the equations at one preload as functions of each parameter and of the force."""

        def family(name: str) -> Callable[[float], Equations]:
            def at(value: float) -> Equations:
                gain = value if name == FORCE else None
                return forced(self.neighbour(name, value).system(preload), self.ratio(force, gain))

            return at

        return {name: (family(name), value) for name, value in ({FORCE: 1.0} | self.values).items()}


@dataclass(frozen=True)
class Separation:
    """Residuals of one data set and their derivatives.

    Parameters
    ----------
    place : (n,) float, Hz
        Frequencies.
    measured, model : (n,) complex
        Measured and computed responses.
    residual : (n, 2) float
        Residuals of amplitude and phase of a swept response, or of amplitude and frequency of resonances; 0 without a
        measured value.
    slopes : callable
        Returns the derivatives (n, 2, n_parameters).
    lost : (n,) bool
        Whether no response was computed.
    reason : str
        Error of the solver.
    """

    place: NDArray
    measured: NDArray
    model: NDArray
    residual: NDArray
    slopes: Callable[[], NDArray]
    lost: NDArray
    reason: str = ""


def attempt(compute: Callable[[], T]) -> tuple[T | None, str]:
    """Return the result of a computation, or None and the reason if the solver fails.

    Errors of the input are raised.
    """
    try:
        return compute(), ""
    except (SettingError, ModelError):
        raise
    except (BdamperError, ArithmeticError, np.linalg.LinAlgError) as error:
        return None, str(error)


def of_test(varied: Variations, test: MeasuredResponse, noise: float) -> Separation:
    """Return the residuals of a swept response; points without computed response have the residual ``LOST``."""
    if test.control != "force":
        return _of_controlled(varied, test, noise)
    f, measured = test.data.frequency, test.data.displacement
    force, factors, n = test.nominal, test.factors, len(f)
    phase = bool(np.any(test.data.response.imag))
    model, residual, lost = np.full(n, np.nan + 0j), np.zeros((n, 2)), np.ones(n, bool)
    normal = np.full((n, 2), np.nan)
    points: dict[int, Correction] = {}
    residual[:, 0] = LOST
    step = float(np.median(np.diff(np.unique(np.log(f)))))
    band = f.min() * (1.0 - EDGE), f.max() * (1.0 + EDGE)
    search, reason = attempt(lambda: _Swept(varied, test, band))
    if search is None or not len(search.curve):
        reason = reason if search is None else search.curve.reason
        return Separation(
            f, measured, model, residual, lambda: np.zeros((n, 2, len(varied.values))), lost, reason
        )
    for i in range(n):
        solution = None
        target = np.array([np.log(f[i]) / step, np.log(abs(measured[i]) / factors[i]) / noise])
        if search.jumps(f[i], NEAR_JUMP * step):
            solution = search.nearest(target, np.array([step, noise]))
            if solution is not None:
                gap, way = search.away(solution, target, np.array([step, noise]))
                normal[i] = np.array([-way[1], way[0]]) / norm2(way)
                residual[i] = gap @ normal[i], 0.0
        if solution is None and (solution := search.at(f[i], factors[i])) is not None:
            ratio = search.first(solution) / measured[i]
            residual[i] = (
                np.log(abs(ratio)) / noise,
                phase * 2.0 * np.sin(0.5 * np.angle(ratio)) / noise,
            )
        if solution is not None:
            lost[i], model[i], points[i] = False, search.first(solution), solution

    def slopes() -> NDArray:
        out = np.zeros((n, 2, len(varied.values)))
        rows = np.flatnonzero(~lost)
        if not len(rows):
            return out
        near = np.isfinite(normal[rows, 0])
        families = varied.families(force, test.preload)
        families = {name: families[name] for name in varied.values}
        scale = np.tile(search.scale, (len(rows), 1))
        turned = np.cos(0.5 * np.angle(model[rows] / measured[rows]))
        under = np.where(near, 1.0, factors[rows])
        for j, s in enumerate(
            across(search.system, [points[int(i)] for i in rows], scale, families, under).values()
        ):
            relative = s.at_frequency / model[rows]
            vertical = np.array([relative.real, phase * turned * relative.imag]).T / noise
            sideways = np.array(
                [s.frequency / f[rows] / step, (s.response / model[rows]).real / noise]
            ).T
            distance = np.pad((sideways * normal[rows]).sum(axis=1)[:, None], ((0, 0), (0, 1)))
            out[rows, :, j] = np.where(near[:, None], distance, vertical)
        return np.nan_to_num(out, posinf=0.0, neginf=0.0)

    return Separation(f, measured, model, residual, slopes, lost)


def _of_controlled(varied: Variations, test: MeasuredResponse, noise: float) -> Separation:
    """Return the residuals of a response under response or phase control: of the force, and of the phase or frequency."""
    f, measured, n = test.data.frequency, test.data.displacement, len(test.data.frequency)
    phase, free = bool(np.any(test.data.response.imag)), test.control == "phase"
    target = measured if phase or not free else -1j * measured
    width, gain = BESIDE if free else EDGE, varied.values.get(FORCE, 1.0)
    residual, lost, model = np.tile([LOST, 0.0], (n, 1)), np.ones(n, bool), np.full(n, np.nan + 0j)
    search, reason = attempt(
        lambda: _Swept(varied, test, (f.min() * (1.0 - width), f.max() * (1.0 + width)))
    )
    if search is None or not len(search.curve):
        reason = reason if search is None else search.curve.reason
        return Separation(
            f, measured, model, residual, lambda: np.zeros((n, 2, len(varied.values))), lost, reason
        )
    points: dict[int, tuple[Correction, float, complex, float]] = {}
    for i in range(n):
        if (found := search.held(f[i], target[i], free)) is None:
            continue
        c, factor, slope = found
        along, ratio = c.tangent * search.scale, c.y[-1] / (2.0 * np.pi * f[i])
        by_frequency = (
            complex(search.system.rows.value(along)) / along[-1] / search.first(c) * c.y[-1]
        )
        slope *= (
            gain * factor / test.factors[i] / ratio**2
        )  # of one mode: by its mass and measured quantities alone
        points[i] = c, factor, by_frequency, slope
        if free:
            second = np.log(ratio) * slope
        else:
            second = phase * 2.0 * np.sin(0.5 * np.angle(search.first(c) / measured[i]))
        residual[i] = np.log(test.factors[i] / factor) / noise, second / noise
        lost[i], model[i] = False, measured[i] * test.factors[i] / factor

    def slopes() -> NDArray:
        out = np.zeros((n, 2, len(varied.values)))
        if not points:
            return out
        rows, scale = list(points), np.tile(search.scale, (len(points), 1))
        families = varied.families(test.nominal, test.preload)
        factors, by_frequency, slope = (np.array([points[i][k] for i in rows]) for k in (1, 2, 3))
        rates = across(search.system, [points[i][0] for i in rows], scale, families, factors)
        relative = {
            name: s.at_frequency / [search.first(points[i][0]) for i in rows]
            for name, s in rates.items()
        }
        by_force = gain * relative[FORCE]
        for j, name in enumerate(varied.values):
            x = relative[name]
            if free:  # ln F and ln f for constant amplitude and phase
                whole = (by_force * by_frequency.conj()).imag
                force = -(x * by_frequency.conj()).imag / whole
                frequency = -(by_force * x.conj()).imag / whole
                second = frequency * slope
            else:
                force = -x.real / by_force.real
                turned = np.cos(
                    0.5 * np.angle([search.first(points[i][0]) / measured[i] for i in rows])
                )
                second = phase * turned * (x + by_force * force).imag
            out[rows, :, j] = np.array([-force, second]).T / noise
        return np.nan_to_num(out, posinf=0.0, neginf=0.0)

    return Separation(f, measured, model, residual, slopes, lost)


class _Swept:
    """Solutions near the points of a response curve: on the branch of a sweep, and nearest to a measured point.

    Without points on the curve there are no solutions; ``curve.reason`` says why.
    """

    def __init__(
        self, varied: Variations, test: MeasuredResponse, band: tuple[float, float]
    ) -> None:
        self.curve = curve = frequency_response(varied.under(test.nominal), test.preload, band)
        if not len(curve):
            return
        self.system = system = varied.system(test.nominal, test.preload)
        self.sense = 1.0 if test.sweep == "up" else -1.0
        self.sweep = sweep_of(curve, test.sweep)
        self.y = np.column_stack([curve.unknowns, 2.0 * np.pi * curve.frequency])
        top = self.y[int(np.argmax(curve.amplitude))]
        self.scale = system.units(top, float(np.pi * np.ptp(curve.frequency)))
        options = ContinuationOptions()
        self.tolerance, self.most = options.tolerance, 2 * options.max_iterations

    def first(self, c: Correction) -> complex:
        return complex(self.system.rows.value(c.y))

    def jumps(self, frequency: float, within: float) -> bool:
        """Return whether the sweep jumps or ends within a relative distance of a frequency."""
        return any(abs(np.log(frequency / jump.frequency)) <= within for jump in self.sweep.jumps)

    def at(self, frequency: float, factor: float = 1.0) -> Correction | None:
        """Return the solution at a frequency (Hz) on the branch of the sweep under ``factor`` times the force.

        The force changes from the nominal force in steps of equal ratio, in more steps if Newton's method fails.  The
        result is None if it fails with all of them.
        """
        c = self._nominal(frequency)
        if c is None or factor == 1.0:
            return c
        omega, n = 2.0 * np.pi * frequency, self.system.n_mean
        for steps in (1, 2, 8):
            at, u = c, c.y[:-1]
            for k in range(1, steps + 1):
                system = forced(self.system, factor ** (k / steps))
                u = np.append(u[:n], factor ** (1.0 / steps) * u[n:])
                at = system.correct_at(u, omega, self.scale, self.tolerance, self.most, 1)
                u = at.y[:-1]
                if at.status != OK:
                    break
            else:
                return at
        return None

    def held(
        self, frequency: float, target: complex, free: bool
    ) -> tuple[Correction, float, float] | None:
        """Return the solution with a given response, its force over the nominal one, and the slope of its phase over the
        logarithm of the frequency at constant amplitude; None without success.

        With ``free`` the response equals the target (m) in amplitude and phase, and the frequency is unknown. Otherwise it
        equals the target in amplitude at the given frequency (Hz), and the phase of the force is unknown, because the phase
        of the response changes fast across a resonance. The search begins at the nearest point of the curve and changes the
        amplitude in equal ratios, in more of them if Newton's method fails.
        """
        omega, scale, n, value = (
            2.0 * np.pi * frequency,
            self.scale,
            self.system.n_mean,
            self.system.rows.value,
        )
        away = np.angle(value(self.y) / target) if free else np.log(self.y[:, -1] / omega)
        near = self.y[int(np.argmin(np.abs(away)))]
        direction = target / abs(target) if free else complex(value(near)) / abs(value(near))
        load = np.append(self.system.structure.force, 0.0)
        load[:n] = 0.0
        frequency_step = np.append(0.0 * load[:-1], 1.0)
        other = frequency_step / scale[-1] if free else self._turned(load, 0.5 * np.pi)
        start = np.array(near)
        start[-1] = start[-1] if free else omega
        for steps in (1, 4, 16):
            targets = direction * np.geomspace(abs(value(near)), abs(target), steps + 1)[1:]
            reached = self._reached(start, targets, load, other, free)
            if reached is None:
                continue
            y, factors, first, second = reached
            factor = float(factors[0]) if free else float(norm2(factors))
            if factor > 1.0 / FARTHEST and y[-1] > 0.0:
                y = y if free else self._turned(y, -float(np.arctan2(factors[1], factors[0])))
                c = forced(self.system, factor).correct_at(
                    y[:-1], y[-1], scale, self.tolerance, self.most
                )
                if c.status == OK and abs(abs(self.first(c) / target) - 1.0) < EDGE:
                    return (
                        c,
                        factor,
                        abs(second.imag - first.imag * second.real / first.real) * c.y[-1],
                    )
        return None

    def _reached(
        self, start: NDArray, targets: NDArray, load: NDArray, other: NDArray, free: bool
    ) -> tuple[NDArray, NDArray, complex, complex] | None:
        """Change a point until its response equals one target after another, by Newton's method.

        Further unknowns are the factor of ``load``, and a multiple of ``other``: of the frequency with ``free``, otherwise
        of a force. Return the point, both unknowns, and their effects on the logarithm of the response. The result is None
        if the force becomes ``FARTHEST`` times the nominal one, or if both effects are parallel.
        """
        y, factors, scale, value = start, np.array([1.0, 0.0]), self.scale, self.system.rows.value
        frequency_step = np.append(0.0 * load[:-1], 1.0)
        first = second = 0j
        for target in targets:
            for _ in range(self.most):
                excess = (factors[0] - 1.0) * load + (0.0 if free else factors[1] * other)
                right = np.array([excess - np.append(self.system.residual(y), 0.0), load, other])
                moves = self.system.solve_linear(y, frequency_step, scale, right) * scale
                response = complex(value(y))
                if response == 0.0:
                    return None
                here, first, second = (complex(value(move)) / response for move in moves)
                gap = np.log(target / response) - here
                whole = (first.conjugate() * second).imag
                if whole == 0.0 or not np.isfinite(whole):
                    return None
                more = (
                    np.array([(gap.conjugate() * second).imag, (first.conjugate() * gap).imag])
                    / whole
                )
                step = moves[0] + more @ moves[1:]
                y, factors = y + step, factors + more
                if not norm2(factors) < FARTHEST:
                    return None
                if not norm2(step / scale) > self.tolerance:
                    break
        return y, factors, first, second

    def _turned(self, y: NDArray, angle: float) -> NDArray:
        """Return a point (n_unknowns + 1,) shifted in time by an angle of the first harmonic (rad)."""
        y = np.array(y)
        for l in range(1, self.system.n_harmonics + 1):
            c, s = self.system.layout.slices(l)
            q = self.system.layout.amplitudes(y[:-1], l) * np.exp(1j * l * angle)
            y[c], y[s] = q.real, -q.imag
        return y

    def _nominal(self, frequency: float) -> Correction | None:
        """Return the solution at a frequency (Hz) on the branch of the sweep under the nominal force."""
        k = int(np.searchsorted(self.sense * self.sweep.frequency, self.sense * frequency))
        if not 0 < k < len(self.sweep.point):
            return None
        j, f, branch = int(self.sweep.point[k]), self.curve.frequency, self.curve.branch
        neighbours = [i for i in (j - 1, j + 1) if 0 <= i < len(f) and branch[i] == branch[j]]
        neighbours = [i for i in neighbours if (f[i] - frequency) * (f[j] - frequency) <= 0.0]
        if not neighbours:
            return None
        i = min(neighbours, key=lambda i: abs(i - int(self.sweep.point[k - 1])))
        share = (frequency - f[i]) / (f[j] - f[i]) if f[j] != f[i] else 0.0
        between = self.y[i] + share * (self.y[j] - self.y[i])
        apart = norm2((self.y[j] - self.y[i]) / self.scale) + self.tolerance
        # interpolation fails at a corner between both points, so each of them is a guess
        for guess, search in ((between, 0), (between, 1), (self.y[i], 1), (self.y[j], 1)):
            omega = 2.0 * np.pi * frequency
            c = self.system.correct_at(
                guess[:-1], omega, self.scale, self.tolerance, self.most, search
            )
            if c.status == OK and norm2((c.y - between) / self.scale) <= apart:
                return c
        return None

    def away(self, c: Correction, target: NDArray, units: NDArray) -> tuple[NDArray, NDArray]:
        """Return the vector from a measured point to a point of the curve, and the tangent of the curve there."""
        first, along = self.first(c), c.tangent * self.scale
        way = np.array([along[-1] / c.y[-1], (self.system.rows.value(along) / first).real]) / units
        here = np.array([np.log(c.y[-1] / (2.0 * np.pi)), np.log(abs(first))]) / units
        return here - target, way

    def nearest(self, target: NDArray, units: NDArray) -> Correction | None:
        """Return the point of the curve nearest to a measured one, by tangential steps from the nearest computed point."""
        logs = np.log([self.curve.frequency, self.curve.amplitude]).T / units
        i = int(np.argmin(((logs - target) ** 2).sum(axis=1)))
        before, after = (min(max(k, 0), len(logs) - 1) for k in (i - 1, i + 1))
        chord = (self.y[after] - self.y[before]) / self.scale
        longest = max(norm2(chord), 1e-300)
        c = self.system.solve(
            self.y[i], Plane(chord / longest), self.scale, self.tolerance, self.most
        )
        for _ in range(self.most):
            if c.status != OK or c.y[-1] <= 0.0:
                return None
            gap, way = self.away(c, target, units)
            size = norm2(way)
            if size < EDGE:  # only the mean changes along the curve
                return None
            step = -float(gap @ way) / size**2
            if abs(step) * size < EDGE:
                break
            move = float(np.clip(step, -longest, longest)) * c.tangent * self.scale
            c = self.system.solve(
                c.y + move, Plane(c.tangent), self.scale, self.tolerance, self.most
            )
        return c if c.status == OK else None


def of_mode(varied: Variations, data: MeasuredMode, noise: float) -> Separation:
    """Return the residuals of damping ratio and frequency of a nonlinear mode at the measured amplitudes."""
    n, amplitude = len(data.amplitude), np.asarray(data.amplitude)
    measured = np.array([data.damping_ratio, data.frequency]).T
    low = 0.5 * float(amplitude.min())
    found, reason = attempt(
        lambda: mode_points(varied.own, data.preload, data.mode, amplitude, low)
    )
    system, points = found or (None, [None] * n)
    lost = np.array([c is None for c in points])
    model = np.array(
        [[np.nan] * 2 if c is None else [c.y[-2], c.y[-3] / (2.0 * np.pi)] for c in points]
    )
    narrow = data.noise or noise * np.where(
        np.isnan(measured[:, 0]), np.nanmean(measured[:, 0]), measured[:, 0]
    )
    units = np.array([np.full(n, -noise), np.broadcast_to(narrow, n)]).T
    residual = np.where(lost[:, None], [LOST, 0.0], np.nan_to_num(np.log(model / measured) / units))

    def slopes() -> NDArray:
        out = np.zeros((n, 2, len(varied.values)))
        for j, (name, value) in enumerate(varied.values.items()):
            if name == FORCE or system is None:
                continue
            sides = [varied.neighbour(name, value * s) for s in (1.0 + STEP, 1.0 - STEP)]
            above, below = (mode_system(side, data.preload, data.mode, low)[0] for side in sides)
            for i, c in enumerate(points):
                if c is not None:
                    rate = (above.residual(c.y) - below.residual(c.y)) / (2.0 * STEP * value)
                    border = np.append(0.0 * rate, 1.0)
                    move = (
                        system.solve_linear(c.y, border, c.scale, np.append(-rate, 0.0)[None])[0]
                        * c.scale
                    )
                    out[i, :, j] = [move[-2] / c.y[-2], move[-3] / c.y[-3]] / units[i]
        return np.where(np.isfinite(measured)[..., None], out, 0.0)

    frequency = np.where(np.isfinite(measured[:, 1]), measured[:, 1], model[:, 1])
    ratio = np.where(np.isfinite(measured[:, 0]), measured[:, 0] / model[:, 0], 1.0)
    return Separation(
        frequency, amplitude + 0j, amplitude * ratio + 0j, residual, slopes, lost, reason
    )


def of_resonances(varied: Variations, data: Measured, noise: float) -> Separation:
    """Return the residuals of resonances over load, relative to those without load, in amplitude and frequency.

    Noise of the amplitude hides the position of a maximum of relative width w up to ``w sqrt(2 noise)``. This is the
    standard deviation of its frequency, so a flat peak has little weight.
    """
    loads, n = np.unique(data.load[data.load > 0.0]), int((data.load > 0.0).sum())
    problem, band = varied.under(None), peak_interval(varied.own.at(float(loads[-1])), None)
    order = np.argsort(data.load)[-n:]
    rest = int(np.argmin(data.load))
    source, least = data.source or "resonances", float(data.load[rest])
    validation.check(
        least == 0.0, source, "a row of load 0, the reference", f"{least:g} N as the least load"
    )
    measured = np.array([data.amplitude, data.frequency]).T[order] / [
        data.amplitude[rest],
        data.frequency[rest],
    ]
    peaks, reasons = {}, []
    for load in loads:
        peaks[load], reason = attempt(partial(highest_peak, problem, load, band))
        reasons += [reason] if reason else []

    def reference(problem: Problem) -> NDArray:
        free = linear_peak(problem.at(0.0), band, stuck=False)
        return np.log([free.amplitude, free.frequency])

    def ratio(peak: Peak) -> NDArray:
        return np.log([peak.amplitude, peak.frequency]) - reference(problem)

    rows = [peaks[load] for load in data.load[order]]
    lost = np.array([peak is None or not peak.converged for peak in rows])
    units, model = np.full((n, 2), noise), np.full((n, 2), np.nan)
    for i, p in enumerate(rows):
        if p is not None and p.converged:
            width = abs(p.tangent[-1] * p.scale[-1]) / p.y[-1] / np.sqrt(max(-p.curvature, 1e-300))
            units[i, 1], model[i] = max(width * np.sqrt(2.0 * noise), EDGE), ratio(p)
    residual = np.where(
        lost[:, None], [LOST, 0.0], np.nan_to_num((model - np.log(measured)) / units)
    )

    def slopes() -> NDArray:
        out = np.zeros((n, 2, len(varied.values)))
        for j, name in enumerate(varied.values):
            value = varied.values[name]
            above, below = (
                varied.under(None, varied.neighbour(name, value * s))
                for s in (1.0 + STEP, 1.0 - STEP)
            )
            reference_slope = (reference(above) - reference(below)) / (2.0 * STEP * value)
            if name == FORCE:
                reference_slope = np.array([1.0 / value, 0.0])
            for i, p in enumerate(rows):
                if p is None or lost[i]:
                    continue
                s = sensitivities(p, {name: varied.families(None, p.parameter)[name]})[name]
                rate = (
                    np.nan_to_num([s.amplitude / p.amplitude, s.frequency / p.frequency])
                    - reference_slope
                )
                out[i, :, j] = np.where(np.isfinite(measured[i]), rate / units[i], 0.0)
        return out

    size, frequency = np.exp(reference(problem))
    frequencies = frequency * np.where(
        np.isfinite(measured[:, 1]), measured[:, 1], np.exp(model[:, 1])
    )
    observed, computed = size * measured[:, 0] + 0j, size * np.exp(model[:, 0]) + 0j
    return Separation(frequencies, observed, computed, residual, slopes, lost, "; ".join(reasons))
