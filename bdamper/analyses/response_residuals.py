r"""Residuals between computed and measured responses, and their derivatives.

At a measured frequency the residual of the amplitude is :math:`\ln|X/X_i|/\sigma` with the standard
deviation :math:`\sigma` of the noise. If a phase was measured, its residual is
:math:`2\sin(\tfrac12\arg(X/X_i))/\sigma`, which equals the phase difference for small differences
and is continuous. The computed response lies on the branch that the sweep of the test follows. It
is solved at the measured frequency itself, because interpolation along a curve causes ripples of
the residual that stop the search for the best parameters.

Near a jump of the sweep a small change of a parameter moves the point to another branch. Within a
few frequency steps of a jump the residual is therefore the distance from the measured point to the
curve, stable or unstable. Coordinates are ln(frequency) over the frequency step and ln(amplitude)
over :math:`\sigma`. Elsewhere this distance is not used: a narrow spike between two measured
frequencies would not contribute.

If the rig controls the response, frequency and amplitude are settings and the force is the result.
The residual is then :math:`\ln(F_i/F)/\sigma`, with the force F at which the computed response has
the measured amplitude. If it controls the phase, the amplitude alone is a setting: F and the
frequency are computed for the measured amplitude and phase. The second residual is the difference
of the frequencies times the slope of the phase, so that :math:`\sigma` is the noise of a phase.
Both remain unique where the response under a given force has several branches.

For a point of a nonlinear mode, damping ratio and frequency are compared at the measured amplitude.
An error of :math:`\sigma` in the phase of a resonance changes its frequency by the relative amount
:math:`\zeta\sigma`.

:func:`bdamper.response.sensitivity.across` gives the derivatives across the curve.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Annotated, Any, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from bdamper.analyses.nonlinear_mode import mode_points, mode_system
from bdamper.harmonic_balance.equations import OK, Correction, Equations, Plane, norm2
from bdamper.harmonic_balance.parameters import vary, with_aligned_modes
from bdamper.harmonic_balance.problem import Problem
from bdamper.harmonic_balance.sector import SectorData
from bdamper.importers.measured_modes import MeasuredMode
from bdamper.importers.measurements import Measured, Measurement
from bdamper.response.events import ContinuationOptions
from bdamper.response.followed_peak import highest_peak
from bdamper.response.linear_limits import linear_peak, peak_interval
from bdamper.response.peak import Family
from bdamper.response.response_curve import frequency_response, sweep_of
from bdamper.response.sensitivity import across, sensitivities
from bdamper.util import validation
from bdamper.util.display import Summarised
from bdamper.util.errors import BdamperError, ModelError, SettingError
from bdamper.util.formatting import amount
from bdamper.util.statement import Row, Statement

T = TypeVar("T")
FORCE = "force_factor"
"""Parameter that multiplies the excitation of all tests."""
NEAR_JUMP = 5.0
"""Number of frequency steps around a jump within which points are compared with the complete curve.
"""
LOST = 10.0
"""Residual of a point without computed response."""
FARTHEST = 1e4
"""Ratio of the force that a measured response needs to the nominal force, or its inverse, at which
the search ends.
"""
STEP = 1e-5
"""Relative step of the finite differences of the resonance without a damper."""
BESIDE = 0.1
"""Relative margin of the curves beyond the frequencies measured under phase control."""
EDGE = 1e-6
"""Relative margin of the curves beyond the measured frequencies; also the step or distance that
counts as zero.
"""


@validation.check_arguments
@dataclass(frozen=True)
class MeasuredResponse(Summarised, validation.Checked):
    """Measured frequency response with its test conditions.

    Parameters
    ----------
    data : Measurement
        Displacement, velocity or acceleration at the response location of the study, or strain at
        its gauge. If it has a phase, it is relative to the excitation: ``x(t) = Re(X exp(i omega
        t))`` under ``Re(F exp(i omega t))``.
    preload : float, N
        Preload of the damper.
    force : float, N, optional
        Nominal amplitude of the excitation.  Default: the force in the data at each point, or the
        amplitude in the settings of the study if the data have none.
    base_acceleration : float, m/s2, optional
        The same for base excitation.
    sweep : {"up", "down"}
        Direction of the frequency sweep.
    control : {"force", "response", "phase"}
        Quantity that the rig controls. "force": the force, or the acceleration of the base.
        "response": the force, measured at each point, is compared at the measured frequency and
        amplitude. "phase": force and frequency are compared at the measured amplitude and phase.
        Without a measured phase, the displacement lags the force by 90 degrees, and leads the
        acceleration of the base by 90 degrees.

    Raises
    ------
    SettingError
        If there are fewer than three frequencies (one under phase control), frequencies or
        amplitudes are not positive, or forces are missing.
    """

    __test__ = False  # pytest ignores this class
    data: Measurement
    preload: validation.Force = 0.0
    force: Annotated[float, validation.Limits(above=0.0, unit="N")] | None = None
    base_acceleration: Annotated[float, validation.Limits(above=0.0, unit="m/s2")] | None = None
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
        name = self.data.name
        _ = self.data.displacement  # raises for an unknown unit
        if self.control != "phase":
            several = len(np.unique(self.data.frequency)) > 2
            n = len(np.unique(self.data.frequency))
            validation.check(several, name, "at least three frequencies", n)
        if self.control != "force":
            expected = f"a measured force at each point under {self.control} control"
            validation.check(self._excitation_is_measured, name, expected, "no measured force")
        one = self.force is None or self.base_acceleration is None
        validation.check_sentence(one, name, "give either force or base_acceleration, not both")
        # a nominal amplitude replaces the measured ones of one kind only
        kinds = {
            "force": (self.force, self.data.base_acceleration),
            "base_acceleration": (self.base_acceleration, self.data.force),
        }
        for kind, (nominal, other_data) in kinds.items():
            fits = nominal is None or other_data is None
            conflict = f"{kind} cannot replace the other excitation, which the data contain"
            validation.check_sentence(fits, name, conflict)
        least = min(self.data.frequency.min(), self.data.amplitude.min())
        validation.check(least > 0.0, name, "frequencies and amplitudes above 0", f"{least:g}")

    @property
    def _given(self) -> float | None:
        """Nominal amplitude of the user: a force (N) or an acceleration of the base (m/s2)."""
        return self.force if self.base_acceleration is None else self.base_acceleration

    @property
    def _excitation_is_measured(self) -> bool:
        """Whether it was measured at each point, and no nominal amplitude replaces it."""
        return self._given is None and self.data.excitation is not None

    @property
    def at_base(self) -> bool | None:
        """Whether the base was shaken; None without a measured or nominal excitation."""
        if self._given is not None:
            return self.base_acceleration is not None
        if self.data.excitation is None:
            return None
        return self.data.base_acceleration is not None

    @property
    def nominal(self) -> float | None:
        """Nominal force (N) or acceleration of the base (m/s2).

        It is the median of values that were measured at each point, and None if the amplitude of
        the study applies.
        """
        if self._excitation_is_measured:
            return float(np.median(self.data.excitation))  # type: ignore[arg-type]
        return self._given

    @property
    def factors(self) -> NDArray:
        """Ratio of the excitation at each point to the nominal excitation, (n,)."""
        if not self._excitation_is_measured:
            return np.ones(len(self.data.frequency))
        return np.asarray(self.data.excitation) / self.nominal

    @property
    def label(self) -> str:
        """Name of the test with its conditions, as results list it."""
        force = "" if self.force is None else f", {self.force:g} N"
        if self.base_acceleration is not None:
            force = f", {self.base_acceleration:g} m/s2"
        return f"{self.data.name} ({self.preload:g} N{force}, {self.sweep})"

    def _statement(self) -> Statement:
        measured = self.data._statement()
        conditions = Row("Preload", amount(self.preload, "N"), f"sweep {self.sweep}")
        rows = [conditions, Row("Control", self.control), *measured.rows]
        if self.nominal is not None:
            unit = "m/s2" if self.at_base else "N"
            rows.insert(1, Row("Excitation", amount(self.nominal, unit)))
        return replace(measured, rows=rows)


def forced(system: Equations[SectorData], factor: float) -> Equations[SectorData]:
    """Return the equations with a factor on the excitation, under the same static load."""
    if factor == 1.0:
        return system
    sector = system.structure
    force = np.array(sector.force)
    force[system.n_mean :] *= factor
    static_scale, dynamic_scale = sector.force_scale
    return replace(
        sector, force=force, force_scale=(static_scale, factor * dynamic_scale)
    ).equations


class Variations:
    """Problem at given parameters and at neighbouring values, with comparable unknowns.

    Parameters
    ----------
    make : callable
        Returns the problem at a mapping of parameters to values.
    values : mapping of name to float
        Parameters. ``"force_factor"`` is not passed to ``make``; it multiplies the excitation of
        every test.
    """

    def __init__(
        self, make: Callable[[dict[str, float]], Problem], values: dict[str, float]
    ) -> None:
        self.make = make
        self.values = values
        self.own = self._at(values)
        # computed once for all tests
        _ = self.own.bases, self.own.static_states
        self._neighbours: dict[tuple[str, float], Problem] = {}

    def _at(self, values: dict[str, float]) -> Problem:
        """Return the problem at these values; the factor on the force is none of its settings."""
        return self.make({name: value for name, value in values.items() if name != FORCE})

    def neighbour(self, name: str, value: float) -> Problem:
        """Return the problem with a different value of one parameter."""
        if name == FORCE or value == self.values[name]:
            return self.own
        if (name, value) not in self._neighbours:
            problem = with_aligned_modes(self._at(self.values | {name: value}), self.own)
            _ = problem.static_states
            self._neighbours[name, value] = problem
        return self._neighbours[name, value]

    def ratio(self, force: float | None, gain: float | None = None) -> float:
        """Return ``gain`` times a force amplitude (N) over the force amplitude of the study.

        None is the amplitude of the study.
        """
        if gain is None:
            gain = self.values.get(FORCE, 1.0)
        if force is None:
            return gain
        return gain * (force / self.own.settings.excitation.amplitude)

    def under(self, force: float | None, problem: Problem | None = None) -> Problem:
        """Return the problem under the force amplitude of a test (N).

        For None it is under the amplitude of the study.
        """
        amplitude = self.ratio(force) * self.own.settings.excitation.amplitude
        return vary(problem or self.own, {"excitation.amplitude": amplitude})

    def system(self, force: float | None, preload: float) -> Equations[SectorData]:
        """Return the equations at one preload under the force amplitude of a test."""
        return forced(self.own.system(preload), self.ratio(force))

    def families(self, force: float | None, preload: float) -> dict[str, tuple[Family, float]]:
        """Return the equations at one preload as functions of each parameter and of the force."""

        def family(name: str) -> Family:
            def at(value: float) -> Equations:
                gain = value if name == FORCE else None
                system = self.neighbour(name, value).system(preload)
                return forced(system, self.ratio(force, gain))

            return at

        values = {FORCE: 1.0} | self.values
        return {name: (family(name), value) for name, value in values.items()}


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
        Residuals of amplitude and phase of a swept response, or of amplitude and frequency of
        resonances; 0 without a measured value.
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
    """Return the residuals of a swept response; points without a computed response get ``LOST``."""
    settings = varied.own.settings
    expected = f"the excitation of the study in {settings.unit_of(settings.excitation)}"
    fits = test.at_base is None or test.at_base == settings.at_base(settings.excitation)
    found = "accelerations of the base" if test.at_base else "forces"
    validation.check(fits, test.data.name, expected, found)
    place = settings.response_location
    is_gauge = place.elastic is not None
    # a sum of degrees of freedom of a lumped model may be a strain
    is_lumped = any(body.kind == "lumped" for body in settings.model.bodies.values())
    fits = test.data.is_strain == is_gauge or (is_lumped and not is_gauge)
    expected = f"the response of the study in {place.unit}"
    remedy = "; bd.Response(point, direction, elastic=(modulus, ratio)) is a gauge"
    found = f"strains{remedy}" if test.data.is_strain else "motions"
    validation.check(fits, test.data.name, expected, found)
    # under phase control the frequency of a solution may differ from the measured frequency
    margin = BESIDE if test.control == "phase" else EDGE
    f = test.data.frequency
    band = f.min() * (1.0 - margin), f.max() * (1.0 + margin)
    search, reason = attempt(lambda: _Swept(varied, test, band))
    if search is None:
        return _without_model(varied, test, reason)
    if not len(search.curve):
        return _without_model(varied, test, search.curve.reason)
    if test.control == "force":
        return _ForceControl(search, varied, test, noise).separation()
    return _OtherControl(search, varied, test, noise).separation()


def _without_model(varied: Variations, test: MeasuredResponse, reason: str) -> Separation:
    """Return the residuals of a response of which no point was computed."""
    n = len(test.data.frequency)
    return Separation(
        place=test.data.frequency,
        measured=test.data.displacement,
        model=np.full(n, np.nan + 0j),
        residual=np.tile([LOST, 0.0], (n, 1)),
        slopes=lambda: np.zeros((n, 2, len(varied.values))),
        lost=np.ones(n, bool),
        reason=reason,
    )


class _Control:
    """Measured response and the solutions of a study that it is compared with.

    ``model`` contains the response of the study at each point, ``residual`` two residuals, and
    ``lost`` whether there is no solution.
    """

    def __init__(
        self, search: _Swept, varied: Variations, test: MeasuredResponse, noise: float
    ) -> None:
        self.search = search
        self.varied = varied
        self.test = test
        self.noise = noise
        self.frequency = test.data.frequency
        self.measured = test.data.displacement
        self.factors = test.factors
        self.has_phase = bool(np.any(test.data.response.imag))
        n = len(self.frequency)
        self.model = np.full(n, np.nan + 0j)
        self.residual = np.tile([LOST, 0.0], (n, 1))
        self.lost = np.ones(n, bool)


class _ForceControl(_Control):
    """Residuals of a response under force control, on the branch that its sweep follows.

    Near a jump the residual is the distance to the curve in scaled logarithms of frequency and
    amplitude.  ``normal`` (n, 2) is the normal of the curve there, and NaN elsewhere.
    """

    def __init__(
        self, search: _Swept, varied: Variations, test: MeasuredResponse, noise: float
    ) -> None:
        super().__init__(search, varied, test, noise)
        # unit of ln(frequency) in the distance to the curve: distance of neighbouring frequencies
        ascending = np.unique(np.log(self.frequency))
        self.step = float(np.median(np.diff(ascending)))
        n = len(self.frequency)
        self.normal = np.full((n, 2), np.nan)
        self.solutions: dict[int, Correction] = {}
        for i in range(n):
            solution = self._compare(i)
            if solution is not None:
                self.solutions[i] = solution
                self.model[i] = search.response(solution)
                self.lost[i] = False

    def separation(self) -> Separation:
        """Return the residuals with their derivatives."""
        return Separation(
            self.frequency, self.measured, self.model, self.residual, self.slopes, self.lost
        )

    def _compare(self, i: int) -> Correction | None:
        """Set the residual of a point, and return the solution that it is compared with."""
        f = self.frequency[i]
        if self.search.jumps(f, NEAR_JUMP * self.step):
            solution = self._nearest(i)
            if solution is not None:
                return solution
        solution = self.search.at(f, self.factors[i])
        if solution is None:
            return None
        ratio = self.search.response(solution) / self.measured[i]
        amplitude = np.log(abs(ratio))
        # zero without measured phases
        phase = self.has_phase * 2.0 * np.sin(0.5 * np.angle(ratio))
        self.residual[i] = amplitude / self.noise, phase / self.noise
        return solution

    def _nearest(self, i: int) -> Correction | None:
        """Set the residual of a point to its distance from the curve; return the solution there."""
        units = np.array([self.step, self.noise])
        log_frequency = np.log(self.frequency[i]) / self.step
        log_amplitude = np.log(abs(self.measured[i]) / self.factors[i]) / self.noise
        target = np.array([log_frequency, log_amplitude])
        solution = self.search.nearest(target, units)
        if solution is None:
            return None
        # from the point to the curve, in units of ln(frequency) and ln(amplitude)
        gap, tangent = self.search.gap_and_tangent(solution, target, units)
        along_frequency, along_amplitude = tangent
        self.normal[i] = np.array([-along_amplitude, along_frequency]) / norm2(tangent)
        # the distance is the only residual; the phase does not count near a jump
        self.residual[i] = gap @ self.normal[i], 0.0
        return solution

    def slopes(self) -> NDArray:
        """Return the derivatives (n, 2, n_parameters) of the residuals."""
        names = list(self.varied.values)
        derivatives = np.zeros((len(self.frequency), 2, len(names)))
        rows = np.flatnonzero(~self.lost)
        if not len(rows):
            return derivatives
        model = self.model[rows]
        normal = self.normal[rows]
        near_jump = np.isfinite(normal[:, 0])
        families = self.varied.families(self.test.nominal, self.test.preload)
        rates = across(
            self.search.system,
            [self.solutions[int(i)] for i in rows],
            np.tile(self.search.scale, (len(rows), 1)),
            {name: families[name] for name in names},
            # near a jump the curve belongs to the nominal force
            np.where(near_jump, 1.0, self.factors[rows]),
        )
        # derivative of 2 sin(phase difference / 2)
        phase_slope = np.cos(0.5 * np.angle(model / self.measured[rows]))
        for j, rate in enumerate(rates.values()):
            # away from jumps: derivatives of amplitude and phase at constant frequency
            relative = rate.at_frequency / model
            phase = self.has_phase * phase_slope * relative.imag
            at_frequency = np.array([relative.real, phase]).T / self.noise
            # near a jump: movement of the curve along its normal
            log_frequency = rate.frequency / self.frequency[rows] / self.step
            log_amplitude = (rate.response / model).real / self.noise
            movement = np.array([log_frequency, log_amplitude]).T
            distance = np.zeros((len(rows), 2))
            distance[:, 0] = (movement * normal).sum(axis=1)
            derivatives[rows, :, j] = np.where(near_jump[:, None], distance, at_frequency)
        return np.nan_to_num(derivatives, posinf=0.0, neginf=0.0)


@dataclass(frozen=True)
class _ControlledPoint:
    """Computed point of a response under response or phase control.

    Parameters
    ----------
    solution : Correction
    factor : float
        Force over the nominal force.
    by_frequency : complex
        Derivative of ln(response) with respect to ln(frequency) along the curve.
    phase_slope : float
        Slope of the phase over ln(frequency) in the residual of the frequency.
    """

    solution: Correction
    factor: float
    by_frequency: complex
    phase_slope: float


class _OtherControl(_Control):
    """Residuals of a response under response or phase control.

    The amplitude is prescribed, so the residuals compare the force and either the phase (response
    control) or the frequency (phase control).
    """

    def __init__(
        self, search: _Swept, varied: Variations, test: MeasuredResponse, noise: float
    ) -> None:
        super().__init__(search, varied, test, noise)
        self.gain = varied.values.get(FORCE, 1.0)
        self.free_frequency = test.control == "phase"
        n = len(self.frequency)
        self.points: dict[int, _ControlledPoint] = {}
        target = self.measured
        if self.free_frequency and not self.has_phase:
            # phase resonance: the displacement is 90 degrees behind the force, which is opposite to
            # the acceleration of the base
            target = (1j if test.at_base else -1j) * self.measured
        for i in range(n):
            held = search.held(self.frequency[i], target[i], self.free_frequency)
            if held is not None:
                self._compare(i, held)

    def separation(self) -> Separation:
        """Return the residuals with their derivatives."""
        return Separation(
            self.frequency, self.measured, self.model, self.residual, self.slopes, self.lost
        )

    def _compare(self, i: int, held: _Held) -> None:
        """Set the residual of a point from the solution with its measured amplitude."""
        solution = held.solution
        response = self.search.response(solution)
        omega = solution.y[-1]
        # change of the response and of the frequency along the curve
        along = solution.tangent * self.search.scale
        response_change = complex(self.search.system.rows.value(along))
        by_frequency = response_change / along[-1] / response * omega
        frequency_ratio = omega / (2.0 * np.pi * self.frequency[i])
        # of one mode: by its mass and measured quantities alone
        phase_slope = held.phase_slope * (
            self.gain * held.factor / self.factors[i] / frequency_ratio**2
        )
        if self.free_frequency:
            second = np.log(frequency_ratio) * phase_slope
        else:
            phase = np.angle(response / self.measured[i])
            second = self.has_phase * 2.0 * np.sin(0.5 * phase)
        force_ratio = np.log(self.factors[i] / held.factor)
        self.residual[i] = force_ratio / self.noise, second / self.noise
        self.model[i] = self.measured[i] * self.factors[i] / held.factor
        self.lost[i] = False
        self.points[i] = _ControlledPoint(solution, held.factor, by_frequency, phase_slope)

    def slopes(self) -> NDArray:
        """Return the derivatives (n, 2, n_parameters) of the residuals."""
        names = list(self.varied.values)
        derivatives = np.zeros((len(self.frequency), 2, len(names)))
        if not self.points:
            return derivatives
        rows = list(self.points)
        points = list(self.points.values())
        responses = [self.search.response(point.solution) for point in points]
        rates = across(
            self.search.system,
            [point.solution for point in points],
            np.tile(self.search.scale, (len(points), 1)),
            self.varied.families(self.test.nominal, self.test.preload),
            np.array([point.factor for point in points]),
        )
        by_force = self.gain * (rates[FORCE].at_frequency / responses)
        for j, name in enumerate(names):
            by_parameter = rates[name].at_frequency / responses
            if self.free_frequency:
                force, second = self._at_constant_response(points, by_parameter, by_force)
            else:
                force, second = self._at_constant_amplitude(rows, responses, by_parameter, by_force)
            derivatives[rows, :, j] = np.array([-force, second]).T / self.noise
        return np.nan_to_num(derivatives, posinf=0.0, neginf=0.0)

    def _at_constant_response(
        self, points: Sequence[_ControlledPoint], by_parameter: NDArray, by_force: NDArray
    ) -> tuple[NDArray, NDArray]:
        """Return the derivatives of ln(force) and of the second residual at constant response.

        The change of ln(response) by a parameter, by ln(force) and by ln(frequency) is zero.
        """
        by_frequency = np.array([point.by_frequency for point in points])
        phase_slope = np.array([point.phase_slope for point in points])
        # one complex equation, two real ones, for the changes of ln(force) and ln(frequency)
        determinant = (by_force * by_frequency.conj()).imag
        force = -(by_parameter * by_frequency.conj()).imag / determinant
        frequency = -(by_force * by_parameter.conj()).imag / determinant
        return force, frequency * phase_slope

    def _at_constant_amplitude(
        self,
        rows: Sequence[int],
        responses: Sequence[complex],
        by_parameter: NDArray,
        by_force: NDArray,
    ) -> tuple[NDArray, NDArray]:
        """Return the derivatives of ln(force) and of the second residual at constant amplitude."""
        force = -by_parameter.real / by_force.real
        # derivative of 2 sin(phase difference / 2)
        ratio = [response / self.measured[i] for response, i in zip(responses, rows)]
        phase_slope = np.cos(0.5 * np.angle(ratio))
        phase = self.has_phase * phase_slope * (by_parameter + by_force * force).imag
        return force, phase


@dataclass(frozen=True)
class _Held:
    """Solution with a given response.

    Parameters
    ----------
    solution : Correction
    factor : float
        Its force over the nominal force.
    phase_slope : float
        Slope of its phase over ln(frequency) at constant amplitude.
    """

    solution: Correction
    factor: float
    phase_slope: float


@dataclass(frozen=True)
class _Reached:
    """Point with a given response.

    Parameters
    ----------
    y : (n_unknowns + 1,) float
    factors : (2,) float
        Factors of both loads.
    effects : (complex, complex)
        Derivatives of ln(response) with respect to both factors.
    """

    y: NDArray
    factors: NDArray
    effects: tuple[complex, complex]


class _Swept:
    """Solutions on the branch of a sweep, and points of its curve nearest to a measured point.

    Without points on the curve there are no solutions; ``curve.reason`` says why.
    """

    def __init__(
        self, varied: Variations, test: MeasuredResponse, band: tuple[float, float]
    ) -> None:
        curve = frequency_response(varied.under(test.nominal), test.preload, band)
        self.curve = curve
        if not len(curve):
            return
        self.system = varied.system(test.nominal, test.preload)
        self.sense = 1.0 if test.sweep == "up" else -1.0
        self.sweep = sweep_of(curve, test.sweep)
        self.y = np.column_stack([curve.unknowns, 2.0 * np.pi * curve.frequency])
        highest = self.y[int(np.argmax(curve.amplitude))]
        self.scale = self.system.units(highest, float(np.pi * np.ptp(curve.frequency)))
        options = ContinuationOptions()
        self.tolerance = options.tolerance
        self.most = 2 * options.max_iterations

    def response(self, solution: Correction) -> complex:
        """Return the complex amplitude (m) of the first harmonic at the response location."""
        return complex(self.system.rows.value(solution.y))

    def jumps(self, frequency: float, within: float) -> bool:
        """Return whether the sweep jumps or ends within a relative distance of a frequency."""
        return any(abs(np.log(frequency / jump.frequency)) <= within for jump in self.sweep.jumps)

    def at(self, frequency: float, factor: float = 1.0) -> Correction | None:
        """Return the solution on the branch of the sweep under ``factor`` times the force.

        The frequency is in Hz. The force changes from the nominal force in steps of equal ratio, in
        more steps if Newton's method fails.  The result is None if it fails with all of them.
        """
        nominal = self._nominal(frequency)
        if nominal is None or factor == 1.0:
            return nominal
        for n_steps in (1, 2, 8):
            solution = self._with_force(nominal, 2.0 * np.pi * frequency, factor, n_steps)
            if solution is not None:
                return solution
        return None

    def _with_force(
        self, nominal: Correction, omega: float, factor: float, n_steps: int
    ) -> Correction | None:
        """Return the solution under ``factor`` times the force; None if Newton's method fails."""
        n_mean = self.system.n_mean
        u = nominal.y[:-1]
        for step in range(1, n_steps + 1):
            system = forced(self.system, factor ** (step / n_steps))
            # the vibration grows with the force, the mean position does not
            u = np.append(u[:n_mean], factor ** (1.0 / n_steps) * u[n_mean:])
            solution = system.correct_at(
                u, omega, self.scale, self.tolerance, max_iterations=self.most, line_search=1
            )
            if solution.status != OK:
                return None
            u = solution.y[:-1]
        return solution

    def held(self, frequency: float, target: complex, free_frequency: bool) -> _Held | None:
        """Return the solution with a given response, or None if the search fails.

        With ``free_frequency`` the response equals the target (m) in amplitude and phase, and the
        frequency is unknown. Otherwise it equals the target in amplitude at the given frequency
        (Hz), and the phase of the force is unknown, because the phase of the response changes fast
        across a resonance. The search begins at the nearest point of the curve and changes the
        amplitude in equal ratios, in more of them if Newton's method fails.
        """
        omega = 2.0 * np.pi * frequency
        value = self.system.rows.value
        # the excitation without static loads, and no change of the frequency (last entry)
        load = np.append(self.system.structure.force, 0.0)
        load[: self.system.n_mean] = 0.0
        # Two unknowns produce a response of given amplitude and phase: a factor on the excitation
        # (load) and a factor on another right-hand side, which the two cases below choose.
        direction: Any  # unit phasor of the response
        if free_frequency:
            distance = np.angle(value(self.y) / target)
            nearest = self.y[int(np.argmin(np.abs(distance)))]
            direction = target / abs(target)
            start = np.array(nearest)
            # the second unknown multiplies the frequency
            other = np.append(0.0 * load[:-1], 1.0) / self.scale[-1]
        else:
            distance = np.log(self.y[:, -1] / omega)
            nearest = self.y[int(np.argmin(np.abs(distance)))]
            direction = complex(value(nearest)) / abs(value(nearest))
            start = np.array(nearest)
            start[-1] = omega
            # the second unknown multiplies a force in quadrature
            other = self._turned(load, 0.5 * np.pi)
        for n_steps in (1, 4, 16):
            # without the present amplitude
            amplitudes = np.geomspace(abs(value(nearest)), abs(target), n_steps + 1)[1:]
            reached = self._reached(start, direction * amplitudes, load, other, free_frequency)
            if reached is None:
                continue
            held = self._with_target(reached, target, free_frequency)
            if held is not None:
                return held
        return None

    def _with_target(
        self, reached: _Reached, target: complex, free_frequency: bool
    ) -> _Held | None:
        """Return the solution at a point with the response ``target``.

        None if its force is too small, or if it is no solution.
        """
        y = reached.y
        omega = y[-1]
        in_phase, in_quadrature = reached.factors
        factor = float(in_phase) if free_frequency else float(norm2(reached.factors))
        if not (factor > 1.0 / FARTHEST and omega > 0.0):
            return None
        if not free_frequency:
            # the force has a phase of zero
            y = self._turned(y, -float(np.arctan2(in_quadrature, in_phase)))
        system = forced(self.system, factor)
        solution = system.correct_at(y[:-1], omega, self.scale, self.tolerance, self.most)
        if solution.status != OK:
            return None
        if not abs(abs(self.response(solution) / target) - 1.0) < EDGE:
            return None
        by_force, by_other = reached.effects
        # the force keeps the amplitude constant
        phase_change = by_other.imag - by_force.imag * by_other.real / by_force.real
        return _Held(solution, factor, abs(phase_change) * solution.y[-1])

    def _reached(
        self, start: NDArray, targets: NDArray, load: NDArray, other: NDArray, free_frequency: bool
    ) -> _Reached | None:
        """Change a point until its response equals one target after another, by Newton's method.

        Further unknowns are the factor of ``load``, and a multiple of ``other``: of the frequency
        with ``free_frequency``, otherwise of a force. The result is None if the force becomes
        ``FARTHEST`` times the nominal one, or if the effects of both unknowns on the logarithm of
        the response are parallel.
        """
        y = start
        factors = np.array([1.0, 0.0])
        scale = self.scale
        value = self.system.rows.value
        frequency_step = np.append(0.0 * load[:-1], 1.0)
        by_load = by_other = 0j
        for target in targets:
            for _ in range(self.most):
                excess = (factors[0] - 1.0) * load
                if not free_frequency:
                    excess = excess + factors[1] * other
                unbalanced = excess - np.append(self.system.residual(y), 0.0)
                right = np.array([unbalanced, load, other])
                moves = self.system.solve_linear(y, frequency_step, scale, right) * scale
                response = complex(value(y))
                if response == 0.0:
                    return None
                newton, by_load, by_other = (complex(value(move)) / response for move in moves)
                # change of ln(response) that both unknowns must give
                gap = np.log(target / response) - newton
                determinant = (by_load.conjugate() * by_other).imag
                if determinant == 0.0 or not np.isfinite(determinant):
                    return None
                load_change = (gap.conjugate() * by_other).imag
                other_change = (by_load.conjugate() * gap).imag
                changes = np.array([load_change, other_change]) / determinant
                step = moves[0] + changes @ moves[1:]
                y = y + step
                factors = factors + changes
                if not norm2(factors) < FARTHEST:
                    return None
                if not norm2(step / scale) > self.tolerance:
                    break
        return _Reached(y, factors, (by_load, by_other))

    def _turned(self, y: NDArray, angle: float) -> NDArray:
        """Return a point shifted in time by an angle of the first harmonic (rad)."""
        turned = np.array(y)
        for harmonic in range(1, self.system.n_harmonics + 1):
            cosine, sine = self.system.layout.slices(harmonic)
            amplitude = self.system.layout.amplitudes(turned[:-1], harmonic) * np.exp(
                1j * harmonic * angle
            )
            turned[cosine] = amplitude.real
            turned[sine] = -amplitude.imag
        return turned

    def _nominal(self, frequency: float) -> Correction | None:
        """Return the solution on the branch of the sweep at a frequency (Hz) and nominal force."""
        # number of the first point of the sweep beyond the frequency, in the sense of the sweep
        beyond = int(np.searchsorted(self.sense * self.sweep.frequency, self.sense * frequency))
        if not 0 < beyond < len(self.sweep.point):
            return None
        # index of this point on the curve, and of its neighbours on the other side of the frequency
        # on the same branch
        frequencies = self.curve.frequency
        branch = self.curve.branch
        point = int(self.sweep.point[beyond])
        neighbours = []
        for i in (point - 1, point + 1):
            if not 0 <= i < len(frequencies) or branch[i] != branch[point]:
                continue
            if (frequencies[i] - frequency) * (frequencies[point] - frequency) <= 0.0:
                neighbours.append(i)
        if not neighbours:
            return None
        # the one from which the sweep comes
        previous = int(self.sweep.point[beyond - 1])
        neighbour = min(neighbours, key=lambda i: abs(i - previous))
        start, end = self.y[neighbour], self.y[point]
        share = 0.0
        if frequencies[point] != frequencies[neighbour]:
            step = frequencies[point] - frequencies[neighbour]
            share = (frequency - frequencies[neighbour]) / step
        between = start + share * (end - start)
        farthest = norm2((end - start) / self.scale) + self.tolerance
        # interpolation fails at a corner between both points, so each of them is a guess; the
        # second number is the line search
        for guess, search in ((between, 0), (between, 1), (start, 1), (end, 1)):
            omega = 2.0 * np.pi * frequency
            solution = self.system.correct_at(
                guess[:-1], omega, self.scale, self.tolerance, self.most, search
            )
            if solution.status != OK:
                continue
            # farther away it is another branch
            if norm2((solution.y - between) / self.scale) <= farthest:
                return solution
        return None

    def gap_and_tangent(
        self, solution: Correction, target: NDArray, units: NDArray
    ) -> tuple[NDArray, NDArray]:
        """Return the vector from a measured point to a point of the curve, and the tangent there.

        Both are in logarithms of frequency and amplitude over ``units``.
        """
        response = self.response(solution)
        along = solution.tangent * self.scale
        by_frequency = along[-1] / solution.y[-1]
        by_amplitude = (self.system.rows.value(along) / response).real
        tangent = np.array([by_frequency, by_amplitude]) / units
        here = np.array([np.log(solution.y[-1] / (2.0 * np.pi)), np.log(abs(response))]) / units
        return here - target, tangent

    def nearest(self, target: NDArray, units: NDArray) -> Correction | None:
        """Return the point of the curve nearest to a measured point.

        The search takes tangential steps from the nearest computed point.
        """
        logs = np.log([self.curve.frequency, self.curve.amplitude]).T / units
        i = int(np.argmin(((logs - target) ** 2).sum(axis=1)))
        before = max(i - 1, 0)
        after = min(i + 1, len(logs) - 1)
        chord = (self.y[after] - self.y[before]) / self.scale
        longest = max(norm2(chord), 1e-300)
        solution = self.system.solve(
            self.y[i], Plane(chord / longest), self.scale, self.tolerance, self.most
        )
        for _ in range(self.most):
            if solution.status != OK or solution.y[-1] <= 0.0:
                return None
            gap, tangent = self.gap_and_tangent(solution, target, units)
            size = norm2(tangent)
            if size < EDGE:  # only the mean changes along the curve
                return None
            step = -float(gap @ tangent) / size**2
            if abs(step) * size < EDGE:
                break
            move = float(np.clip(step, -longest, longest)) * solution.tangent * self.scale
            solution = self.system.solve(
                solution.y + move, Plane(solution.tangent), self.scale, self.tolerance, self.most
            )
        return solution if solution.status == OK else None


def of_mode(varied: Variations, data: MeasuredMode, noise: float) -> Separation:
    """Return the residuals of damping ratio and frequency of a nonlinear mode."""
    amplitude = np.asarray(data.amplitude)
    n = len(amplitude)
    low = 0.5 * float(amplitude.min())
    mode, reason = attempt(lambda: mode_points(varied.own, data.preload, data.mode, amplitude, low))
    if mode is None:
        system = None
        points: list[Any] = [None] * n
    else:
        system, points = mode
    lost = np.array([point is None for point in points])
    # damping ratio and frequency of each point
    measured = np.array([data.damping_ratio, data.frequency]).T
    model = np.full((n, 2), np.nan)
    for i, point in enumerate(points):
        if point is not None:
            model[i] = point.y[-2], point.y[-3] / (2.0 * np.pi)
    damping = measured[:, 0]
    if data.noise:
        frequency_noise = np.full(n, data.noise)
    else:
        frequency_noise = noise * np.where(np.isnan(damping), np.nanmean(damping), damping)
    # a higher damping ratio is a lower amplitude
    units = np.array([np.full(n, -noise), frequency_noise]).T
    residual = np.nan_to_num(np.log(model / measured) / units)
    residual[lost] = LOST, 0.0

    def slopes() -> NDArray:
        derivatives = np.zeros((n, 2, len(varied.values)))
        for j, (name, value) in enumerate(varied.values.items()):
            if name == FORCE or system is None:
                continue
            neighbours = [varied.neighbour(name, value * s) for s in (1.0 + STEP, 1.0 - STEP)]
            above, below = (
                mode_system(problem, data.preload, data.mode, low)[0] for problem in neighbours
            )
            for i, point in enumerate(points):
                if point is None:
                    continue
                rate = (above.residual(point.y) - below.residual(point.y)) / (2.0 * STEP * value)
                # at constant amplitude, the last unknown
                border = np.append(0.0 * rate, 1.0)
                right = np.append(-rate, 0.0)[None]
                move = system.solve_linear(point.y, border, point.scale, right)[0] * point.scale
                relative = np.array([move[-2] / point.y[-2], move[-3] / point.y[-3]])
                derivatives[i, :, j] = relative / units[i]
        return np.where(np.isfinite(measured)[..., None], derivatives, 0.0)

    # values that were not measured do not count
    frequency = np.where(np.isfinite(measured[:, 1]), measured[:, 1], model[:, 1])
    ratio = np.where(np.isfinite(damping), damping / model[:, 0], 1.0)
    return Separation(
        frequency, amplitude + 0j, amplitude * ratio + 0j, residual, slopes, lost, reason
    )


def of_resonances(varied: Variations, data: Measured, noise: float) -> Separation:
    """Return the residuals of resonances at several loads, in amplitude and frequency.

    Resonances are relative to the resonance without load.

    Noise of the amplitude hides the position of a maximum of relative width w up to ``w sqrt(2
    noise)``. This is the standard deviation of its frequency, so a flat peak has little weight.
    """
    loaded = data.load > 0.0
    loads = np.unique(data.load[loaded])
    n = int(loaded.sum())
    problem = varied.under(None)
    band = peak_interval(varied.own.at(float(loads[-1])), None)
    unloaded = int(np.argmin(data.load))
    least = float(data.load[unloaded])
    source = data.source or "resonances"
    validation.check(
        least == 0.0, source, "a row with load 0 as reference", f"{least:g} N as the smallest load"
    )
    order = np.argsort(data.load)[-n:]
    # amplitude and frequency, relative to those without load
    measured = np.array([data.amplitude, data.frequency]).T[order]
    measured = measured / [data.amplitude[unloaded], data.frequency[unloaded]]
    computed = {}
    reasons = []
    for load in loads:
        computed[load], reason = attempt(partial(highest_peak, problem, load, band))
        if reason:
            reasons.append(reason)

    def reference(problem: Problem) -> NDArray:
        free = linear_peak(problem.at(0.0), band, stuck=False)
        return np.log([free.amplitude, free.frequency])

    peaks = [computed[load] for load in data.load[order]]
    lost = np.array([peak is None or not peak.ok for peak in peaks])
    units = np.full((n, 2), noise)
    model = np.full((n, 2), np.nan)
    for i, peak in enumerate(peaks):
        if peak is None or lost[i]:
            continue
        # the amplitude falls by half the square of the distance over the width
        curvature = max(-peak.curvature, 1e-300)
        width = abs(peak.tangent[-1] * peak.scale[-1]) / peak.y[-1] / np.sqrt(curvature)
        units[i, 1] = max(width * np.sqrt(2.0 * noise), EDGE)
        model[i] = np.log([peak.amplitude, peak.frequency]) - reference(problem)
    residual = np.nan_to_num((model - np.log(measured)) / units)
    residual[lost] = LOST, 0.0

    def reference_slope(name: str) -> NDArray:
        """Return the derivatives of the logarithms of the resonance without load."""
        value = varied.values[name]
        if name == FORCE:
            return np.array([1.0 / value, 0.0])
        above, below = (
            varied.under(None, varied.neighbour(name, value * s)) for s in (1.0 + STEP, 1.0 - STEP)
        )
        return (reference(above) - reference(below)) / (2.0 * STEP * value)

    def slopes() -> NDArray:
        derivatives = np.zeros((n, 2, len(varied.values)))
        for j, name in enumerate(varied.values):
            of_reference = reference_slope(name)
            for i, peak in enumerate(peaks):
                if peak is None or lost[i]:
                    continue
                families = varied.families(None, peak.parameter)
                s = sensitivities(peak, {name: families[name]})[name]
                relative = np.nan_to_num(
                    [s.amplitude / peak.amplitude, s.frequency / peak.frequency]
                )
                rate = relative - of_reference
                derivatives[i, :, j] = np.where(np.isfinite(measured[i]), rate / units[i], 0.0)
        return derivatives

    amplitude, frequency = np.exp(reference(problem))
    # the model gives frequencies that were not measured
    relative_frequency = np.where(np.isfinite(measured[:, 1]), measured[:, 1], np.exp(model[:, 1]))
    return Separation(
        place=frequency * relative_frequency,
        measured=amplitude * measured[:, 0] + 0j,
        model=amplitude * np.exp(model[:, 0]) + 0j,
        residual=residual,
        slopes=slopes,
        lost=lost,
        reason="; ".join(reasons),
    )
