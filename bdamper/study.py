"""Study: a model with settings, and the analyses as methods.

The analyses are functions of other modules that take a
:class:`bdamper.harmonic_balance.problem.Problem` first. :class:`Study` has a method for each of
them, with checks of the arguments and the explanation of the parameters.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import MISSING, dataclass, fields, replace
from functools import partial
from inspect import getdoc
from pathlib import Path
from typing import Any, Literal

from numpy.typing import NDArray

from bdamper.analyses import (
    accuracy,
    campbell,
    crossings,
    error_estimates,
    excitation_curve,
    flutter,
    refinement,
    robust_optimum,
)
from bdamper.analyses import effect_significance as significance
from bdamper.analyses import hysteresis as cycles
from bdamper.analyses import nonlinear_mode as modes
from bdamper.analyses.campbell import Campbell
from bdamper.analyses.crossings import Crossings
from bdamper.analyses.effect_significance import EffectSignificance
from bdamper.analyses.excitation_curve import ExcitationCurve
from bdamper.analyses.executors import check_executor
from bdamper.analyses.flutter import Flutter
from bdamper.analyses.hysteresis import Hysteresis, Solved
from bdamper.analyses.nonlinear_mode import NonlinearMode
from bdamper.analyses.optimum import check_optimum
from bdamper.analyses.refinement import Refinement
from bdamper.analyses.sweep import SweepResult
from bdamper.contact.laws import AFT, ContactLaw
from bdamper.contact.preload_state import PreloadState
from bdamper.contact.residual_flexibility import ResidualModes
from bdamper.contact.static_contact import WedgeFriction
from bdamper.contact.stiffness import PerArea, report
from bdamper.fatigue import margin as margins
from bdamper.fatigue import stress_cycle as stresses
from bdamper.fatigue.criteria import Material
from bdamper.fatigue.margin import LeastMargin, MarginCurve, Margins, SteadyAmplitude
from bdamper.fatigue.stress_cycle import StressCycle
from bdamper.harmonic_balance import checks, parameters, rotor_speed
from bdamper.harmonic_balance.checks import (
    SomeResult,
    check_question,
    check_settings,
    check_unloaded,
    needs_contacts,
)
from bdamper.harmonic_balance.effects import BLADE_MODES, HARMONICS, Effects
from bdamper.harmonic_balance.problem import Problem
from bdamper.harmonic_balance.rotor_speed import Conditions
from bdamper.harmonic_balance.settings import FRICTION, Settings, settings_of
from bdamper.model.kinematics import RIGID_NAMES
from bdamper.model.loads import Direction, Excitation, Response
from bdamper.model.model_file import read_model, write_model
from bdamper.model.structure import Model
from bdamper.model.validation import check_model, check_model_once
from bdamper.response import first_slip as slip
from bdamper.response import followed_peak, linear_limits, sensitivity
from bdamper.response import optimal_curve as optimal
from bdamper.response.events import ContinuationOptions
from bdamper.response.first_slip import FirstSlip
from bdamper.response.linear_limits import peak_interval
from bdamper.response.optimal_curve_result import OptimalCurve
from bdamper.response.peak import Peak, PeakOptions
from bdamper.response.response_curve_result import ResponseCurve
from bdamper.response.sensitivity import CurveSensitivities, Sensitivities
from bdamper.response.verification import Convergence, ErrorEstimates, MotionInTime, TimeResponse
from bdamper.time_domain import floquet
from bdamper.time_domain import frequency_sweep as sweeps
from bdamper.time_domain import time_response as in_time
from bdamper.time_domain.frequency_sweep import TimeSweep
from bdamper.time_domain.transient import CRITERIA
from bdamper.util import validation
from bdamper.util.display import Comparable, Fact
from bdamper.util.errors import INTERRUPTED, BdamperError, SettingError, check_sentence, warn
from bdamper.util.formatting import UNITS, aligned, counted, short_repr, spaced, text_of
from bdamper.util.progress import one_thread, shows_progress, stopped_after
from bdamper.util.records import new_group, place, read_attribute
from bdamper.util.storage import INSTALLED, FilePath, read_hdf5, register_reader, write_hdf5

ALWAYS_SHOWN = (
    "model",
    "excitation",
    "engine_order",
    "response",
    "friction_coefficient",
    "harmonics",
    "blade_modes",
    "damping_ratio",
    "contact_stiffness",
)
"""Settings that have a line in the summary of a study even with their default."""


@short_repr
@dataclass(frozen=True, eq=False, init=False)
class Study(Comparable):
    """Model with one set of settings.

    Two studies are equal only if they are the same object; the settings of their results can be
    compared.  The attribute ``settings`` (:class:`bdamper.harmonic_balance.settings.Settings`)
    contains the parameters below.  The attribute ``problem``
    (:class:`bdamper.harmonic_balance.problem.Problem`) contains bases, contact stiffness and the
    equations at a preload.
    """

    settings: Settings
    problem: Problem

    @partial(validation.check_arguments, name="Study", warns=False)
    def __init__(
        self,
        model: Model,
        excitation: Excitation,
        engine_order: int | None = None,
        friction_coefficient: float | Mapping[str, float | NDArray] = FRICTION,
        response: Response | None = None,
        harmonics: int | tuple[int, ...] = HARMONICS,
        contact_stiffness: str
        | float
        | ResidualModes
        | PerArea
        | Mapping[str, NDArray]
        | None = None,
        blade_modes: int = BLADE_MODES,
        damper_modes: int | Mapping[str, int] = 0,
        rigid_modes: tuple[str, ...] = RIGID_NAMES,
        constraint_planes: bool = True,
        fundamental_modes_only: bool = False,
        damping_ratio: float | None = None,
        damper_damping_ratio: float | Mapping[str, float] = 0.0,
        damper_drag: float | Mapping[str, float] = 0.0,
        contact_forces: str | AFT = "event_driven",
        friction_law: str | ContactLaw | Mapping[str, str | ContactLaw] = "uncoupled",
        bias: bool = True,
        variable_normal_load: bool = True,
        separation: bool = True,
        contact_points: int | None = None,
        gap: Mapping[str, float | NDArray] | None = None,
        load_per_preload: Mapping[str, float] | None = None,
        constant_loads: Mapping[str, float | NDArray] | None = None,
        load_history: tuple[float, ...] = (1.0,),
        stability: bool = False,
        contact_stiffness_factor: float = 1.0,
        speed: float | None = None,
        residual_slip_std: float = 0.0,
        residual_slip_seed: int = 0,
        aerodynamic_damping: complex | Mapping[int, complex] | None = None,
        residual_forces: Literal["rest", "most"] | None = None,
    ) -> None:
        # check_settings warns of implausible values, because it knows the sizes of the model
        settings = Settings(
            model=model,
            excitation=excitation,
            engine_order=engine_order,  # type: ignore[arg-type]  # 1 without cyclic symmetry
            friction_coefficient=friction_coefficient,
            response=response,
            harmonics=harmonics,
            contact_stiffness=contact_stiffness,
            blade_modes=blade_modes,
            damper_modes=damper_modes,
            rigid_modes=rigid_modes,
            constraint_planes=constraint_planes,
            fundamental_modes_only=fundamental_modes_only,
            damping_ratio=damping_ratio,
            damper_damping_ratio=damper_damping_ratio,
            damper_drag=damper_drag,
            contact_forces=contact_forces,
            friction_law=friction_law,
            bias=bias,
            variable_normal_load=variable_normal_load,
            separation=separation,
            contact_points=contact_points,
            gap=gap,
            load_per_preload=load_per_preload,
            constant_loads=constant_loads,
            load_history=load_history,
            stability=stability,
            contact_stiffness_factor=contact_stiffness_factor,
            speed=speed,
            residual_slip_std=residual_slip_std,
            residual_slip_seed=residual_slip_seed,
            aerodynamic_damping=aerodynamic_damping,
            residual_forces=residual_forces,
        )
        self._ask(Problem(settings))

    def _ask(self, problem: Problem) -> None:
        object.__setattr__(self, "settings", problem.settings)
        object.__setattr__(self, "problem", problem)
        check_settings(problem)

    def _with_problem(self, problem: Problem) -> Study:
        """Return a study of another problem."""
        study = object.__new__(Study)
        study._ask(problem)
        return study

    @property
    def model(self) -> Model:
        """Model of the structure."""
        return self.settings.model

    @property
    def excitation(self) -> Excitation:
        """Location, direction and amplitude of the excitation."""
        return self.settings.excitation

    @property
    def stiffness_report(self) -> str:
        """Table of the contact stiffness of each interface, with the number of fallback values."""
        return report(self.problem.stiffness, self.problem.contact.note).text

    def replace(self, /, **settings: Any) -> Study:
        """Return a copy of the study with some settings changed.

        Parameters
        ----------
        **settings
            Arguments of :class:`bdamper.Study`, and other names that a sweep varies, such as
            ``damper_inertia_factor``, ``gap_factor`` or ``friction_coefficient.left``.

        Raises
        ------
        SettingError
            If there is no setting of that name, or its value is not valid.
        """
        problem = parameters.replace_settings(self.problem, **settings)
        if problem is self.problem:
            return self
        return self._with_problem(problem)

    @partial(validation.check_arguments, name="static")
    @needs_contacts
    def static(self, preload: float, history: Sequence[float] | None = None) -> PreloadState:
        """Compute the quasi-static contact state under a load on the damper (paper, section 3.1).

        Parameters
        ----------
        preload : float, N
        history : sequence of float, optional
            Load factors, increasing or decreasing, that are applied in sequence, starting from zero
            load. Default: ``load_history`` of the study.

        Returns
        -------
        PreloadState
            State at the last load factor.
        """
        state = self.problem.static(preload, history)
        if not state.ok:
            warn(f"{state.reason}; the result is the last state that was found")
        return state

    @partial(validation.check_arguments, name="response_at")
    def response_at(
        self,
        result: SomeResult,
        location: str,
        direction: Direction = "tangential",
        *,
        absolute: bool = False,
    ) -> NDArray:
        """Compute the response at any location from the solutions of a peak or a curve.

        Parameters
        ----------
        result : ResponseCurve or Peak
            Result of this study.
        location : str
        direction : {"tangential", "radial", "axial"} or three floats
        absolute : bool
            Whether to return the absolute motion instead of the motion relative to the base; only
            for studies whose response is absolute.

        Returns
        -------
        (n, n_harmonics + 1) complex, m
            Amplitude of each harmonic at each point of a curve, the mean first; n is 1 for a peak.

        Raises
        ------
        SettingError
            If there is no such location, or the result belongs to another study.
        """
        return checks.response_at(self.problem, result, Response(location, direction, absolute))

    @partial(validation.check_arguments, name="wedge_friction")
    @needs_contacts
    def wedge_friction(self, preload: float = 1.0) -> WedgeFriction:
        """Return the range of normal forces that statics and friction allow; it identifies a self-locking wedge.

        Parameters
        ----------
        preload : float, N
        """
        return self.problem.wedge_friction(preload)

    @partial(validation.check_arguments, name="first_slip")
    @needs_contacts
    def first_slip(
        self,
        preload: float | None = None,
        frequency: tuple[float, float] | None = None,
        *,
        mode: int = 1,
    ) -> FirstSlip:
        """Compute the excitation at which the closed contacts of a stuck resonance begin to slip.

        Below it the structure can vibrate as if its contacts were bonded, with the residual forces
        that allow most.  A linear programme finds them.

        Parameters
        ----------
        preload : float, N, optional
            Default: centrifugal load of the damper at the rotor speed of the study; 0 if only
            constant loads or interference act.
        frequency : (low, high), Hz, optional
            Frequency interval; by default, it contains the free and the stuck resonance of
            ``mode``.
        mode : int
            Mode of the constrained bodies, 1 for the lowest.

        Returns
        -------
        FirstSlip
            Excitation and amplitude at first slip, margin of the excitation of the study, and the
            faces that limit them.

        Raises
        ------
        SettingError, StaticError
            If the study has compiled laws or no separation, or there is no static state.
        """
        if preload is None:
            preload = 0.0
            if self.problem.carries_load and self.problem.settings.speed is not None:
                preload = rotor_speed.preload_at(self.problem, self.problem.settings.speed)
        return slip.first_slip(self.problem.at(preload), frequency, mode)

    def __str__(self) -> str:
        rows = [(fact.name, fact.text) for fact in self._facts() if fact.known]
        return "\n".join(["study", *aligned(rows, "  ")])

    def _facts(self) -> tuple[Fact, ...]:
        """Return excitation, contact, size of the reduced model, and the settings that differ from
        the defaults."""
        settings = self.settings
        coupling = self.problem.coupling
        excitation = settings.excitation
        friction = ", ".join(f"{mu:g}" for mu in settings.friction_values())
        n_coordinates = sum(len(retained) for retained in coupling.modes.values())
        neglected = ""
        if settings.speed:
            effects = settings.model.neglected_over_speed(settings.needed_diameters)
            neglected = "; ".join(effects)

        return (
            Fact("model", self._model_text()),
            Fact(
                "excitation",
                float(excitation.amplitude),
                f"{settings.unit_of(excitation)} {excitation.shown}",
            ),
            Fact("beside it", "; ".join(self._force_text(force) for force in excitation.beside)),
            Fact("engine order", int(settings.engine_order)),
            Fact("response", settings.response_location.shown),
            Fact("harmonics", ", ".join(str(number) for number in settings.harmonic_numbers)),
            Fact("friction coefficient", friction or "none"),
            Fact("contact stiffness", self._stiffness_text()),
            Fact("contact points", coupling.n_points),
            Fact("coordinates", n_coordinates, f"({', '.join(self._retained_modes())})"),
            Fact("modal damping ratio", self.problem.damping_text),
            Fact("damper mass", settings.model.masses_text),
            Fact("unknowns", self.problem.n_unknowns),
            *self._changed_settings(),
            Fact("neglected", neglected),
        )

    def _stiffness_text(self) -> str:
        """Return the method of the contact stiffness; values of the user are not printed."""
        method = self.problem.stiffness_method
        return "given by the user" if isinstance(method, Mapping) else text_of(method)

    def _model_text(self) -> str:
        model = self.settings.model
        text = f"{', '.join(model.bodies)} ({model.hash})"
        if model.n_blades > 1:
            text = f"{model.n_blades} sectors, {text}"
        return text

    def _force_text(self, force: Excitation) -> str:
        """Return amplitude, place and engine order of a further force."""
        order = force.engine_order or self.settings.engine_order
        unit = self.settings.unit_of(force)
        return f"{force.amplitude:g} {unit} {force.shown}, order {order}"

    def _retained_modes(self) -> list[str]:
        """Return the number of retained modes of each body, and how many the model contains.

        The residual vectors of forces and responses are coordinates in addition to the modes.
        """
        texts = []
        for name, retained in self.problem.coupling.modes.items():
            # taken from the first nodal diameter
            basis = next(iter(self.model.bodies[name].bases.values()))
            n_modes = int((retained < basis.n_natural).sum())
            text = f"{name} {n_modes} of {counted(basis.n_natural, 'mode')}"
            n_vectors = len(retained) - n_modes
            if n_vectors:
                text += f" and {counted(n_vectors, 'residual vector')}"
            texts.append(text)
        return texts

    def _changed_settings(self) -> list[Fact]:
        """Return the settings that differ from their defaults and have no line otherwise."""
        facts = []
        for field in fields(self.settings):
            value = getattr(self.settings, field.name)
            if field.name in ALWAYS_SHOWN or value == field.default:
                continue
            shown = f"{value:.6g}" if isinstance(value, float) else text_of(value)
            unit = UNITS.get(field.name, "")
            facts.append(Fact(spaced(field.name), f"{shown} {unit}".strip()))
        return facts

    def _shown(self) -> Any:
        return self.model

    def _outcomes(self) -> tuple[Fact, ...]:
        return ()  # only results contain values

    def _asked(self) -> dict[str, Any]:
        return {"model": self.model.hash, **self.problem.record()}

    # linear limits

    @partial(validation.check_arguments, name="free")
    def free(self, frequency: tuple[float, float] | None = None, *, mode: int = 1) -> ResponseCurve:
        """Compute the linear response without contact, the limit of zero preload.

        Parameters
        ----------
        frequency : (low, high), Hz, optional
            Frequency interval; by default, it contains the free and the stuck resonance of
            ``mode``.
        mode : int
            Mode of the constrained bodies, 1 for the lowest.

        Returns
        -------
        ResponseCurve
        """
        return linear_limits.free(self.problem, frequency, mode)

    @partial(validation.check_arguments, name="stuck")
    @needs_contacts
    def stuck(
        self,
        frequency: tuple[float, float] | None = None,
        preload: float | None = None,
        *,
        mode: int = 1,
    ) -> ResponseCurve:
        """Compute the linear response with all closed points stuck, the limit of high preload.

        Parameters
        ----------
        frequency : (low, high), Hz, optional
            Frequency interval; by default, it contains the free and the stuck resonance of
            ``mode``.
        preload : float, N, optional
            Preload that closes the contact points; its magnitude has no effect if there are no
            gaps.  Default: centrifugal load of the damper at the rotor speed of the study; 1 N if
            it has none.  Open points remain open in this limit. If vibration closes them, a
            resonance may lie above it.  An interface that touches without a normal load counts as
            stuck, with a warning.
        mode : int
            Mode of the constrained bodies, 1 for the lowest.

        Returns
        -------
        ResponseCurve
        """
        return linear_limits.stuck(self.problem, frequency, preload, mode)

    @validation.check_arguments
    def frequency_response(
        self,
        preload: float,
        frequency: tuple[float, float],
        *,
        options: ContinuationOptions | None = None,
        progress: bool | None = None,
        stability: bool = False,
    ) -> ResponseCurve:
        """Compute the response curve in a frequency interval at one preload, with all branches that can be reached.

        Parameters
        ----------
        preload : float, N
            Radial load on the damper.
        frequency : (low, high), Hz
            Frequency interval.
        options : ContinuationOptions, optional
            Step sizes and tolerances of the continuation.
        progress : bool, optional
            Show progress: a bar or, without a terminal, lines of text after ten seconds; on by default.
        stability : bool
            Whether to determine the stability of each point (:meth:`with_stability`), even if
            ``stability`` of the study is off.

        Returns
        -------
        ResponseCurve
            ``status`` is "complete" if the branches span the interval, and no higher response is
            known. Otherwise, ``reason`` gives the cause, and the curve contains the points that
            were found. If the curve has folds, the response at up to two lower preloads is computed
            as well: one of its peaks may be higher at this preload on a separate branch.
        """
        problem = self.problem
        validation.flag("stability", stability)
        check_question(problem, [problem.check_preload(preload)], frequency)
        linear_limits.warn_of_shroud(problem.at(preload), frequency)
        curve = followed_peak.response_curve(
            problem, preload, frequency, options=options, progress=shows_progress(progress)
        )
        problem.sizes.check_faces(preload)
        wants_stability = stability or self.settings.stability
        # after Ctrl-C no further computation starts
        if not wants_stability or not len(curve) or curve.status == "interrupted":
            return curve
        return floquet.with_stability(problem, curve)

    # stability and time integration

    @partial(validation.check_arguments, name="with_stability")
    @needs_contacts
    def with_stability(
        self, curve: ResponseCurve, in_time: bool = False, progress: bool | None = None
    ) -> ResponseCurve:
        """Return the response curve with the stability of every point (:mod:`bdamper.time_domain.floquet`).

        Parameters
        ----------
        curve : ResponseCurve
            Response curve of this study.
        in_time : bool
            Whether to use time integration from each point.  A point is stable if its amplitude
            changes by no more than 5 %.  Points that remain undecided, or were not reached before
            Ctrl-C, keep the stability label from harmonic balance (``curve.labels``).
        progress : bool, optional
            Show how many points have been integrated; on by default.

        Returns
        -------
        ResponseCurve
        """
        return floquet.with_stability(self.problem, curve, in_time, progress)

    @partial(validation.check_arguments, name="motion_in_time")
    @needs_contacts
    def motion_in_time(
        self,
        curve: ResponseCurve,
        index: int | None = None,
        *,
        frequency: float | None = None,
        periods: int | None = None,
        tolerance: float = CRITERIA.tolerance,
        steps_per_period: int | None = None,
        seconds: float = in_time.SECONDS,
        progress: bool | None = None,
    ) -> MotionInTime:
        """Integrate in time from a point of a response curve, and decide whether the motion stays there.

        All sectors with their contacts are included, and the initial motion is disturbed in every
        nodal diameter; the modes of the curve are used. The integration ends when a decision is
        reached, usually after 96 to 200 periods. If ``frequency`` is given, it starts from the
        closest solution and runs for a given number of periods without a decision; use this if
        there is no stable solution.

        Parameters
        ----------
        curve : ResponseCurve
            Response curve of this study.
        index : int, optional
            Index of the point; the largest response by default.
        frequency : float, Hz, optional
            Frequency of the excitation, instead of a point.
        periods : int, optional
            Maximum number of periods until a decision, 1,000 by default; with ``frequency``, the
            number of periods, 200 by default.
        tolerance : float
            Relative difference of the amplitude up to which the motion agrees with the solution.
        steps_per_period : int, optional
            Number of time steps, by default 1,024, or 256 with ``frequency``. If the energy does
            not balance, four times this number is used.
        seconds : float, s
            Maximum processor time of the integration, including its equations.
        progress : bool, optional
            Show progress: a bar or, without a terminal, lines of text after ten seconds; on by default.

        Returns
        -------
        MotionInTime
            With ``frequency`` it has no verdict, and it is incomplete if the mean or the stored
            energy still changes at the end. After Ctrl-C it contains the periods computed so far.
            If the processor time is used up, it also contains them and is incomplete.

        Raises
        ------
        SettingError
            If a number is not valid, both a point and a frequency are given, or the curve has no
            points.
        IntegrationFailed
            If the time integration fails, or its energy does not balance to 2 % even with four
            times the steps.
        TimeSpent
            If the processor time is used up before there is a result.
        """
        return in_time.motion_in_time(
            self.problem,
            curve,
            index,
            frequency=frequency,
            periods=periods,
            tolerance=tolerance,
            steps_per_period=steps_per_period,
            seconds=seconds,
            progress=progress,
        )

    @partial(validation.check_arguments, name="frequency_sweep")
    @needs_contacts
    def frequency_sweep(
        self,
        preload: float,
        frequency: tuple[float, float],
        *,
        up: bool = True,
        rate: float | None = None,
        steps_per_period: int | None = None,
        seconds: float = sweeps.SWEEP_SECONDS,
        progress: bool | None = None,
    ) -> TimeSweep:
        """Integrate in time while the excitation frequency changes slowly through an interval.

        All sectors with their contacts are included, without a truncated Fourier series and without
        the assumption of a travelling wave. The integration includes all nodal diameters of the
        model. It starts from a solution at the first frequency, the lowest one that is not between
        folds. The motion settles there before the sweep begins.

        Parameters
        ----------
        preload : float, N
        frequency : (low, high), Hz
        up : bool
            Whether the frequency increases.
        rate : float, Hz/s, optional
            Default: a tenth of the half-bandwidth of the least damped mode per decay time of its
            transients.
        steps_per_period : int, optional
            256 by default.
        seconds : float, s
            Maximum processor time of the integration, including its equations.
        progress : bool, optional
            Show the progress in excitation periods; on by default.

        Returns
        -------
        TimeSweep
            After Ctrl-C it contains the periods computed so far.  If the processor time is used up,
            it also contains them and is incomplete.

        Raises
        ------
        SettingError
            If a number is not valid, a mode has no damping, or the settings do not describe a
            structure in time.
        BdamperError
            If no solution is found at the first frequency, the time integration fails, or the
            processor time is used up before the sweep begins.
        """
        return sweeps.frequency_sweep(
            self.problem,
            preload,
            frequency,
            up=up,
            rate=rate,
            steps_per_period=steps_per_period,
            seconds=seconds,
            progress=progress,
        )

    @partial(validation.check_arguments, name="time_response")
    @needs_contacts
    def time_response(
        self,
        result: ResponseCurve | Peak,
        *,
        steps_per_period: int | None = None,
        blades: int | None = None,
        starts: int = 1,
        seconds: float = in_time.SECONDS,
        progress: bool | None = None,
    ) -> TimeResponse:
        """Compute the highest steady-state amplitude near a resonance by time integration, with its error.

        All amplitudes belong to the blade with the largest amplitude
        (:mod:`bdamper.time_domain.time_response`).

        Parameters
        ----------
        result : ResponseCurve or Peak
            Response curve of this study, from one flank of the resonance to the other.  For a peak,
            the response curve in its interval is computed first.
        steps_per_period : int, optional
            Number of time steps, 256 by default. The search uses twice this number if contacts
            chatter, and integrates the highest motion again with steps of a quarter of the length.
            If the energy does not balance to 2 %, the search is repeated with four times this
            number.
        blades : int, optional
            Number of blades that are integrated, as a ring; by default the smallest number after
            which the excitation repeats. More blades allow more vibration patterns.
        starts : int
            Number of initial states at the highest point. The additional states differ in their
            disturbances, which have random phases, and in their friction forces, which are zero or
            at the friction limit in either direction.
        seconds : float, s
            Maximum processor time of the integrations, including their equations. If this time is
            used up, the result contains the motions that have settled, and its reason names the
            part that is missing.
        progress : bool, optional
            Show progress: a bar or, without a terminal, lines of text after ten seconds; on by default.

        Returns
        -------
        TimeResponse
            The status is "not found" if no motion stays at the solution or settles, the integration
            fails, or its energy does not balance. It is "incomplete" if the error exceeds 5 %, the
            mean drifts, the processor time is used up, or the curve ends before the motion jumps.
            After Ctrl-C, it describes the highest steady motion found so far.

        Raises
        ------
        SettingError
            If the result belongs to another study or has no peak, or the settings do not describe a
            structure in time.
        """
        return in_time.time_response(
            self.problem,
            result,
            steps_per_period=steps_per_period,
            blades=blades,
            starts=starts,
            seconds=seconds,
            progress=progress,
        )

    # peaks and the optimal curve
    @validation.check_arguments
    @one_thread
    def peak(
        self,
        preload: float,
        frequency: tuple[float, float] | None = None,
        *,
        mode: int = 1,
        options: PeakOptions | None = None,
        errors: bool = True,
        progress: bool | None = None,
    ) -> Peak:
        """Find the highest point of the response at one preload.

        Parameters
        ----------
        preload : float, N
            Radial load on the damper.
        frequency : (low, high), Hz, optional
            Search interval; by default, it contains the free and the stuck resonance of ``mode``.
        mode : int
            Mode of the constrained bodies, 1 for the lowest.
        options : PeakOptions, optional
            Tolerances of the peak.
        errors : bool
            Estimate how much the amplitude changes with two more harmonics and, with residual
            modes, with six more of them (``peak.errors``).  After a large change the number of
            harmonics rises further.  The estimates take about a tenth of the time of a response
            curve.
        progress : bool, optional
            Show progress: a bar or, without a terminal, lines of text after ten seconds; on by default.

        Returns
        -------
        Peak
            Highest point of the response. If none was found, the amplitude is NaN and ``status``
            gives the reason. The status is "incomplete" if a peak followed from a lower preload is
            higher. Curves of a shroud start from the friction forces with which it slips last, up to
            ten times its first slip (:meth:`first_slip`); below first slip it is locked.
        """
        problem = self.problem
        progress = shows_progress(progress)
        frequency = peak_interval(problem.at(preload), frequency, mode)
        check_question(problem, [preload], frequency)
        problem.sizes.check_faces(preload)
        linear_limits.warn_of_shroud(problem.at(preload), frequency)
        return followed_peak.highest_peak(
            problem,
            preload,
            frequency,
            mode=mode,
            options=options,
            progress=progress,
            errors=errors,
        )

    @validation.check_arguments
    @needs_contacts
    @one_thread
    def optimal_curve(
        self,
        preload: tuple[float, float] | Sequence[float] | NDArray = (10.0, 25e3),
        n: int = 50,
        *,
        frequency: tuple[float, float] | None = None,
        mode: int = 1,
        options: PeakOptions | None = None,
        executor: Executor | None = None,
        check: str | bool = "time",
        seconds: float = in_time.SECONDS,
        maximum: float | None = None,
        progress: bool | None = None,
        resume: str | Path | None = None,
        quantity: str = "amplitude",
        material: Material | None = None,
        errors: bool = True,
    ) -> OptimalCurve:
        """Compute the resonance amplitude as a function of the preload, and check the optimum by time integration.

        Parameters
        ----------
        preload : (low, high) or sequence of more than two values, N
            Preloads, or the ends of a range that is divided into ``n`` preloads in geometric
            progression.
        n : int
            Number of preloads if a range is given.
        frequency, mode, options
            See :meth:`peak`.
        executor : concurrent.futures.Executor, optional
            Executor that computes the response curves; threads by default.
        check : {"time", "harmonics", "neighbours", "range", False}
            "time": compute the peak at the optimum with up to 16 harmonics (``curve.convergence``)
            and the amplitude by time integration there (``curve.time_response``).  If this
            integration is not complete or differs from harmonic balance by more than 20 %, 1.35
            times its preload follows, and the better of the two preloads is recommended.  At the
            recommended preload, compute the peaks with 0.7 and 1.3 times the friction coefficients
            (``curve.other_friction``).  Then find out whether the amplitude doubles with 1/1.5 or
            1.5 times the friction coefficients, and if so, at which factor
            (``curve.friction_range``, 5 to 7 peaks).  "harmonics" omits the time integration, which
            takes most of the time.  With "neighbours" the time integration always
            includes the preload of the optimum times 1.35 and divided by 1.35.  With "range" it
            includes 1.35 times this preload, and both ends of ``curve.near_best``, the range in
            which the harmonic-balance amplitude is at most 1.2 times the lowest one.
        seconds : float, s
            Most processor time of the time integration at one preload.  After it the motions that
            are known are returned as incomplete, with the time that is missing.
        maximum : float, s, optional
            Most elapsed time of the curves and checks together.  After it the results so far are
            returned as after Ctrl-C, and a check that is missing is printed with the time that it
            would take.  With ``resume`` the next call continues from them.
        progress : bool, optional
            Show the current step and the remaining time; on by default.
        resume : path, optional
            File in which finished curves and checks are stored: each preload of the time
            integration, the peaks with more harmonics, and each peak with other friction.  The same
            call continues from it after Ctrl-C or a crash, and computes none of them again.
        quantity : {"amplitude", "margin"}
            "margin": also compute the fatigue margin for ``material`` (``curve.margins``).
        material : Material, optional
            Fatigue strength, required for margins.
        errors : bool
            Estimate how much each amplitude changes with two more harmonics and, with residual
            modes, with six more of them (``curve.error``).  It takes about a tenth of the time of
            the curves.

        Returns
        -------
        OptimalCurve
            Curve with the harmonics of the study.  After Ctrl-C it contains the results computed so
            far.

        Raises
        ------
        BdamperError
            If no peak was found, or none within ``maximum``.
        """
        problem = self.problem
        # all arguments are checked before the first curve is computed
        checks = ("time", "harmonics", "neighbours", "range", False)
        is_known = isinstance(check, str | bool) and check in checks
        validation.check_value(is_known, "check", f"one of {checks}", check)
        seconds = validation.number("seconds", seconds, above=0.0, unit="s")
        if maximum is not None:
            maximum = validation.number("maximum", maximum, above=0.0, unit="s")
        check_executor(executor)
        progress = shows_progress(progress)
        values = optimal.preload_values(preload, n, call="optimal_curve")
        if problem.carries_load:
            frequency = optimal.curve_interval(problem, values, frequency, mode)
        check_unloaded(problem)
        check_question(problem, values, frequency)
        validation.choice("quantity", quantity, ("amplitude", "margin"))
        margin_material = None
        if quantity == "margin":
            margin_material = validation.instance(
                "material", material, Material, "a Material, since quantity is the margin"
            )
            stresses.chosen_sets(problem)
        if problem.carries_load and frequency is not None:
            optimal.warn_of_model(problem, float(values[-1]), frequency)

        with (
            optimal.finished_parts(problem, values, frequency, options, errors, resume) as parts,
            stopped_after(maximum) as over,
        ):
            try:
                curve = optimal.optimal_curve(
                    problem,
                    preload,
                    n,
                    frequency=frequency,
                    mode=mode,
                    options=options,
                    executor=executor,
                    progress=progress,
                    resume=parts,
                    errors=errors,
                )
            except KeyboardInterrupt:
                found = f"no response curve within {maximum} s"
                validation.check_sentence(not over.is_set(), "optimal_curve", found)
                raise
            problem.sizes.check_optimum(curve.optimum.preload, values)
            problem.sizes.check_faces(curve.optimum.preload)
            curve = check_optimum(problem, curve, check, margin_material, progress, seconds, parts)
            if over.is_set() and curve.optimum.status == INTERRUPTED:
                ended = replace(curve.optimum, reason=f"after {maximum:g} s")
                curve = replace(curve, optimum=ended)
            return curve

    @partial(validation.check_arguments, name="peak_sensitivities")
    @needs_contacts
    def peak_sensitivities(
        self, peak: Peak, parameters: Sequence[str] = sensitivity.PARAMETERS
    ) -> Sensitivities:
        """Compute the derivatives of a peak's amplitude and frequency with respect to the preload and to settings.

        Parameters
        ----------
        peak : Peak
            Peak of this study, at a preload of ``peak.parameter`` newtons.
        parameters : sequence of str
            "preload" or any numeric setting (see :mod:`bdamper.harmonic_balance.parameters`);
            factors have the value 1. "damper_mass_factor" is a factor on the mass of the free
            bodies and on the preload, which is proportional to it at a rotor speed.
            "damper_inertia_factor" is a factor on their inertia only.

        Returns
        -------
        dict of name to PeakSensitivity
            Unknown derivatives are NaN, with a ``reason``.

        Raises
        ------
        SettingError
            If the peak is not converged or is at a corner, or if contact forces are sampled: events
            between samples cause ripples in the amplitude, and the maximum jumps from ripple to
            ripple.
        """
        return sensitivity.peak_sensitivities(self.problem, peak, parameters)

    @partial(validation.check_arguments, name="curve_sensitivities")
    @needs_contacts
    def curve_sensitivities(
        self, curve: ResponseCurve, parameters: Sequence[str] = sensitivity.PARAMETERS
    ) -> CurveSensitivities:
        """Compute the derivatives of a response curve, including its folds, with respect to preload and settings.

        Parameters
        ----------
        curve : ResponseCurve
            Response curve of this study.
        parameters : sequence of str
            See :meth:`peak_sensitivities`.

        Returns
        -------
        CurveSensitivities
            Mapping of name to CurveSensitivity, which prints a table.  It is the input of
            ``bdamper.plot.plot_band``, which draws the effect of uncertain settings.

        Raises
        ------
        SettingError
            If the curve belongs to another study, or contact forces are sampled.
        """
        return sensitivity.curve_sensitivities(self.problem, curve, parameters)

    @partial(validation.check_arguments, name="with_time_response")
    @needs_contacts
    def with_time_response(
        self,
        curve: OptimalCurve,
        preload: Sequence[float] | NDArray | None = None,
        *,
        seconds: float = in_time.SECONDS,
        progress: bool | None = None,
    ) -> OptimalCurve:
        """Return the optimal curve with time integrations at some preloads.

        Parameters
        ----------
        curve : OptimalCurve
            Optimal curve of this study.
        preload : sequence of float, N, optional
            By default, the preload of the optimum, and 1.35 times this preload if the integration
            at the optimum is not complete or differs from harmonic balance by more than 20 %.
        seconds : float, s
            Most processor time at each preload, see :meth:`time_response`.
        progress : bool, optional
            Show the progress at each preload; on by default.

        Returns
        -------
        OptimalCurve
            ``time_response`` contains an additional ``bdamper.response.verification.TimeResponse`` for
            each preload, in ascending order.  If time integration is not possible, the TimeResponse
            gives the reason.  Nothing is added without an optimum.  After Ctrl-C unfinished
            preloads have the status "interrupted".

        Raises
        ------
        SettingError
            If the curve belongs to another model.
        """
        return in_time.with_time_response(
            self.problem, curve, preload, seconds=seconds, progress=progress
        )

    # free vibration

    @partial(validation.check_arguments, name="nonlinear_mode")
    @needs_contacts
    def nonlinear_mode(
        self,
        preload: float,
        mode: int = 1,
        amplitude: tuple[float, float] = (1e-6, 1e-3),
        *,
        more_harmonics: int = 0,
        options: ContinuationOptions | None = None,
        progress: bool | None = None,
    ) -> NonlinearMode:
        """Compute frequency and damping of a mode as functions of the amplitude of free vibration.

        The motion is periodic: the force ``2 omega zeta M q'`` balances all losses, and zeta is the
        modal damping ratio [1]_. The excitation has no effect.

        Parameters
        ----------
        preload : float, N
        mode : int
            Number of the elastic mode without contact, from 1. The branch starts at the stuck mode
            with the highest correlation.
        amplitude : (low, high), m
            Range of the amplitude of the first harmonic of the response.
        more_harmonics : int
            Number of harmonics that are added in a second computation for comparison. The result
            contains the differences as ``damping_error`` and ``frequency_error``.
        options, progress
            See :meth:`frequency_response`.

        Returns
        -------
        NonlinearMode
            The status is "complete" if the branch reaches the upper amplitude in the same mode;
            otherwise ``reason`` describes its end.

        Raises
        ------
        SettingError
            If a value does not fit, or the response location does not move in this mode.

        References
        ----------
        .. [1] M. Krack, Computers & Structures 154, 2015.
        """
        return modes.nonlinear_mode(
            self.problem,
            preload,
            mode,
            amplitude,
            more_harmonics=more_harmonics,
            options=options,
            progress=progress,
        )

    @partial(validation.check_arguments, name="excitation_curve")
    def excitation_curve(
        self,
        preload: float,
        excitation: tuple[float, float] | Sequence[float] | NDArray,
        n: int = 12,
        *,
        frequency: tuple[float, float] | None = None,
        mode: int = 1,
        options: PeakOptions | None = None,
        scaled_from: OptimalCurve | None = None,
        progress: bool | None = None,
    ) -> ExcitationCurve:
        """Compute the resonance amplitude at a preload as a function of the excitation, with frequency and damping.

        A test at several levels of excitation measures this curve.

        Parameters
        ----------
        preload : float, N
        excitation : (low, high) or sequence of more than two values, N or m/s2
            Amplitudes of the excitation, or the ends of a range that is divided into ``n``
            amplitudes in geometric progression.  A search adds amplitudes near the one with the
            lowest response per excitation.
        n : int
            Number of amplitudes if a range is given.
        frequency, mode, options
            See :meth:`peak`.
        scaled_from : OptimalCurve, optional
            Optimal curve of this study.  Without gaps, cubic springs and constant loads only the
            ratio of excitation and preload matters: the values then follow from this curve, or
            from one that is computed, without further solutions.
        progress : bool, optional
            Show progress: a bar or, without a terminal, lines of text after ten seconds; on by default.

        Returns
        -------
        ExcitationCurve

        Raises
        ------
        SettingError
            If an argument is not valid, or ``scaled_from`` is given although more than the ratio
            matters.
        """
        return excitation_curve.excitation_curve(
            self.problem,
            preload,
            excitation,
            n,
            frequency=frequency,
            mode=mode,
            options=options,
            scaled_from=scaled_from,
            progress=progress,
        )

    @partial(validation.check_arguments, name="flutter")
    @needs_contacts
    def flutter(
        self,
        preload: float | tuple[float, float] | Sequence[float] | NDArray,
        aerodynamic_damping: complex | Mapping[int, complex],
        *,
        mode: int = 1,
        amplitude: tuple[float, float] = (1e-6, 1e-2),
        n: int = 9,
        options: ContinuationOptions | None = None,
        progress: bool | None = None,
    ) -> Flutter:
        """Compute the limit cycles of a mode in a flow, their stability, and the safe initial amplitudes.

        Parameters
        ----------
        preload : float, (low, high) or sequence of more than two values, N
        aerodynamic_damping : float or complex, or a mapping of nodal diameters to these
            Aerodynamic damping ratio, negative for a destabilising flow, at the nodal diameter of
            the engine order or at the given nodal diameters. For a complex number the imaginary
            part is the damping ratio and the real part the relative frequency shift. The force is
            proportional to the mass; its real part does not act on rigid-body motions.
        mode, amplitude, options
            See :meth:`nonlinear_mode`; limit cycles are searched for in this range of amplitudes.
        n : int
            Number of preloads between two limits.
        progress : bool, optional
            Show progress: a bar or, without a terminal, lines of text after ten seconds; on by default.

        Returns
        -------
        Flutter

        Raises
        ------
        SettingError
            If a value is not finite, or the mode was not found at a preload.
        """
        return flutter.flutter(
            self.problem,
            preload,
            aerodynamic_damping,
            mode=mode,
            amplitude=amplitude,
            n=n,
            options=options,
            progress=progress,
        )

    # stress and fatigue

    @partial(validation.check_arguments, name="stress")
    def stress(
        self,
        result: SomeResult,
        index: int | None = None,
        *,
        sets: str | Sequence[str] | None = None,
        speed: float | None = None,
    ) -> StressCycle:
        """Compute the stress of a solution over the vibration cycle.

        Parameters
        ----------
        result : Peak, ResponseCurve or OptimalCurve
            Result of this study.
        index : int, optional
            Index of a point of a curve. By default, the highest point of a response curve or the
            optimum of an optimal curve.
        sets : str or sequence of str, optional
            Stress sets of the model; all by default.
        speed : float, rad/s, optional
            Rotor speed. By default the speed of the study, or the speed at which the engine order
            excites at the frequency of the solution; 0 for a non-rotating structure.

        Returns
        -------
        StressCycle

        Raises
        ------
        SettingError
            If the model has no stress sets, or the result belongs to another study.
        """
        return stresses.stress(self.problem, result, index, sets=sets, speed=speed)

    @partial(validation.check_arguments, name="gauge_stress")
    def gauge_stress(
        self,
        result: SomeResult,
        gauge: str | Sequence[float],
        direction: Direction,
        elastic: Sequence[float] | None = None,
    ) -> NDArray:
        """Return the normal stress or strain at a gauge for every point of a result.

        Parameters
        ----------
        result : Peak, ResponseCurve or OptimalCurve
            Result of this study.
        gauge : str or (3,) float, m
            Name of a point of a stress set ("root node 215" or "root point 3", as in
            :class:`bdamper.fatigue.stress_cycle.StressCycle`), or coordinates. The nearest point is
            used; its distance is limited to a twentieth of the largest coordinate.
        direction : {"tangential", "radial", "axial"} or three floats
            Direction of the gauge.
        elastic : (Young's modulus in Pa, Poisson's ratio), optional
            Constants of a linear elastic isotropic material; if given, the result is strain.

        Returns
        -------
        (n, n_harmonics + 1) complex, Pa or 1
            Mean, including the centrifugal part, and complex amplitude of each harmonic. n is 1 for
            a peak; rows of points without a solution are NaN.

        Raises
        ------
        SettingError
            If there is no such point, no point near the coordinates, or the result belongs to
            another study.
        """
        return stresses.gauge_stress(self.problem, result, gauge, direction, elastic)

    @partial(validation.check_arguments, name="margin")
    def margin(
        self,
        result: SomeResult | StressCycle,
        material: Material,
        index: int | None = None,
        *,
        time_response: SteadyAmplitude | None = None,
        criterion: str = "von_mises",
        line: str = "goodman",
        on: str = "amplitude",
        sets: str | Sequence[str] | None = None,
        speed: float | None = None,
        temperature: float | Sequence[float] | Mapping[str, float] | None = None,
    ) -> Margins | MarginCurve:
        """Compute safety factors against fatigue for infinite life.

        Parameters
        ----------
        result : Peak, ResponseCurve, OptimalCurve or StressCycle
            Result of this study.
        material : Material
        index : int, optional
            Index of a point of a curve; all points by default.
        time_response : TimeResponse, optional
            Time integration at the preload of the solution (:meth:`time_response`). The vibration
            is multiplied by the ratio of the largest amplitude by time integration to the
            harmonic-balance amplitude; ``notes`` contain this ratio.
        criterion : {"von_mises", "findley"}
            Definition of the stress amplitude (:mod:`bdamper.fatigue.criteria`).
        line : {"goodman", "gerber", "soderberg", "table"}
            Failure line in the Haigh diagram. "findley" ignores it, because it includes the mean
            stress.
        on : {"amplitude", "both"}
            Quantity to which the factor applies: the vibration at constant mean stress, or both
            vibration and mean stress.
        sets, speed
            See :meth:`stress`.
        temperature : float, (n,) float, or mapping of name to float, °C, optional
            Temperature of the points, for the line "table": one value, a value for each point, or
            values by names of points and of stress sets.

        Returns
        -------
        Margins or MarginCurve
            Margins of one solution, or the margin at every point of a curve.

        Raises
        ------
        SettingError
            If the model has no stress sets, or if a setting or the result does not fit.
        """
        judge = LeastMargin(
            material,
            criterion=criterion,
            line=line,
            on=on,
            sets=sets,
            speed=speed,
            temperature=temperature,
        )
        return margins.margin(self.problem, result, judge, index, time_response=time_response)

    @partial(validation.check_arguments, name="best_margin")
    @needs_contacts
    def best_margin(
        self,
        curve: OptimalCurve,
        material: Material,
        *,
        criterion: str = "von_mises",
        line: str = "goodman",
        on: str = "amplitude",
        sets: str | Sequence[str] | None = None,
        speed: float | None = None,
        temperature: float | Sequence[float] | Mapping[str, float] | None = None,
    ) -> MarginCurve:
        """Compute fatigue margins along an optimal curve, and refine the preload with the largest margin.

        Parameters
        ----------
        curve : OptimalCurve
            Curve of this study. If it contains amplitudes from time integration, ``in_time``
            contains their margins.
        material : Material
        criterion, line, on, sets, speed, temperature
            See :meth:`margin`.

        Returns
        -------
        MarginCurve
            ``best_value`` is the preload, and ``best_status`` describes its accuracy. After Ctrl-C,
            it is the best preload of the curve.

        Raises
        ------
        SettingError
            If the model has no stress sets, or a setting does not fit.
        """
        judge = LeastMargin(
            material,
            criterion=criterion,
            line=line,
            on=on,
            sets=sets,
            speed=speed,
            temperature=temperature,
        )
        return robust_optimum.best_margin(self.problem, curve, judge)

    # importance of physical effects

    @partial(validation.check_arguments, name="effect_significance")
    @needs_contacts
    def effect_significance(
        self,
        preload: float,
        frequency: tuple[float, float],
        *,
        against: Effects | None = None,
        tolerance: float = 0.01,
        progress: bool | None = None,
    ) -> EffectSignificance:
        """Compute how the highest peak changes without each effect, and select the significant effects.

        This requires several response curves: the reference, one for each effect that changes the
        peak considerably, and one or more without all omitted effects. It is worthwhile before many
        computations of similar problems.

        Parameters
        ----------
        preload : float, N
        frequency : (low, high), Hz
            Search interval of the highest peak.
        against : Effects, optional
            Reference; by default, all effects that the model allows (``fullest`` in
            ``bdamper/analyses/effect_significance.py``). The friction law of the study does not
            change.
        tolerance : float
            Allowed relative change of amplitude or frequency by all omitted effects together.
        progress : bool, optional
            Show progress: a bar or, without a terminal, lines of text after ten seconds; on by default.

        Returns
        -------
        EffectSignificance

        Raises
        ------
        BdamperError
            If the reference has no peak in the interval.
        """
        return significance.effect_significance(
            self.problem,
            preload,
            frequency,
            against=against,
            tolerance=tolerance,
            progress=progress,
        )

    # contact behaviour in a cycle

    @partial(validation.check_arguments, name="hysteresis")
    @needs_contacts
    def hysteresis(
        self, result: Solved, index: int | None = None, *, n_theta: int = 720
    ) -> Hysteresis:
        """Compute the hysteresis loops of all contact points for one solution.

        Parameters
        ----------
        result : ResponseCurve, Peak or OptimalCurve
            Result of this study.
        index : int, optional
            Index of a converged point of a curve. By default, the highest point of a response curve
            or the optimum of an optimal curve.
        n_theta : int
            Number of steps in the cycle.

        Returns
        -------
        Hysteresis

        Raises
        ------
        SettingError
            If the result belongs to another study or contains no solution.
        """
        return cycles.hysteresis(self.problem, result, index, n_theta=n_theta)

    @partial(validation.check_arguments, name="dissipation")
    @needs_contacts
    def dissipation(self, result: Solved) -> Hysteresis:
        """Compute dissipated energy, equivalent stiffness and damping along a result.

        Parameters
        ----------
        result : ResponseCurve, Peak or OptimalCurve
            Result of this study. An optimal curve gives these quantities as functions of the
            resonance amplitude: without gaps, they depend only on the ratio of preload to
            excitation.

        Returns
        -------
        Hysteresis

        Raises
        ------
        SettingError
            If the result belongs to another study or contains no solution.
        """
        return cycles.dissipation(self.problem, result)

    # rotor speed

    @partial(validation.check_arguments, name="at_speed")
    def at_speed(
        self,
        omega: float | None = None,
        *,
        rpm: float | None = None,
        friction: rotor_speed.Table | None = None,
        temperature: rotor_speed.Table | None = None,
        excitation: rotor_speed.Excitations | None = None,
    ) -> Study:
        """Return the study at a rotor speed, with the model, friction and excitation at this speed.

        Parameters
        ----------
        omega : float, rad/s
        rpm : float, revolutions per minute
            Instead of ``omega``.
        friction : mapping of number to number, or callable, optional
            Friction coefficient of all friction faces as a function of speed (rad/s), or of
            ``temperature`` if it is given.
        temperature : mapping of number to number, or callable, optional
            Temperature of the contacts as a function of speed, in the unit that ``friction`` uses.
        excitation : callable or mapping, optional
            Amplitude of the excitation (N): ``excitation(omega, engine_order)``, or for each engine
            order a number or a mapping of speed to newtons.

        Returns
        -------
        Study
            ``preload`` of such a study is the centrifugal load of the damper at this speed.  An
            analysis at a different preload still uses this speed, and with it the displacement of
            the faces due to rotation.

        Raises
        ------
        SettingError
            If a table does not cover the speed, or neither the model nor the conditions depend on
            it.
        """
        conditions = Conditions(friction, temperature, excitation)
        return self._with_problem(
            rotor_speed.at_speed(self.problem, omega, rpm=rpm, conditions=conditions)
        )

    @partial(validation.check_arguments, name="campbell")
    def campbell(
        self,
        speeds: tuple[float, float] | Sequence[float] | NDArray | None = None,
        engine_orders: Sequence[int] = (),
        *,
        rpm: tuple[float, float] | Sequence[float] | NDArray | None = None,
        modes: int = 3,
        damped: SweepResult | Sequence[SweepResult] | None = None,
        progress: bool | None = None,
        friction: rotor_speed.Table | None = None,
        temperature: rotor_speed.Table | None = None,
        excitation: rotor_speed.Excitations | None = None,
    ) -> Campbell:
        """Compute free and stuck frequencies at several rotor speeds, at all nodal diameters with speed-dependent data.

        Parameters
        ----------
        speeds : (low, high) or sequence of more than two values, rad/s
            Two limits give thirteen speeds.
        engine_orders : sequence of int
            Engine orders for which lines and crossings are computed.
        rpm : (low, high) or sequence of more than two values, revolutions per minute
            Alternative to ``speeds``.
        modes : int
            Number of modes of each nodal diameter.
        damped : SweepResult or sequence of SweepResult, optional
            Damped crossings from :meth:`resonance_crossings`, which the plot shows.
        progress : bool, optional
            Show progress: a bar or, without a terminal, lines of text after ten seconds; on by default.
        friction, temperature, excitation
            Conditions that depend on speed, see :meth:`at_speed`.

        Returns
        -------
        Campbell

        Raises
        ------
        SettingError
            If speeds or orders are invalid, or damped crossings belong to another model.
        """
        return campbell.campbell(
            self.problem,
            speeds,
            engine_orders,
            rpm=rpm,
            modes=modes,
            damped=damped,
            progress=progress,
            conditions=Conditions(friction, temperature, excitation),
        )

    @partial(validation.check_arguments, name="resonance_crossings")
    @needs_contacts
    def resonance_crossings(
        self,
        speeds: tuple[float, float] | Sequence[float] | NDArray | None = None,
        engine_orders: Sequence[int] = (),
        *,
        rpm: tuple[float, float] | Sequence[float] | NDArray | None = None,
        damper_mass_factor: Sequence[float] = (1.0,),
        mode: int = 1,
        executor: Executor | None = None,
        resume: str | Path | None = None,
        progress: bool | None = None,
        margin: LeastMargin | None = None,
        errors: bool = True,
        friction: rotor_speed.Table | None = None,
        temperature: rotor_speed.Table | None = None,
        excitation: rotor_speed.Excitations | None = None,
    ) -> Crossings:
        """Compute the resonance crossings of a mode with engine orders for several damper masses.

        Parameters
        ----------
        speeds, rpm : (low, high) or sequence of more than two values, rad/s or revolutions per
        minute
            Search range; give one of the two.
        engine_orders : sequence of int
        damper_mass_factor : sequence of float
            Factors on the mass of the free bodies, which multiply centrifugal load and inertia.
        mode : int
            Mode of the constrained bodies, from 1.
        executor, resume, progress
            See :func:`bdamper.sweep`.
        margin : LeastMargin, optional
            If given, the margin against fatigue of each crossing is computed; the model needs
            stress sets.
        errors : bool
            Estimate the error of each crossing by harmonics and residual modes.
        friction, temperature, excitation
            Conditions that depend on speed, see :meth:`at_speed`.

        Returns
        -------
        Crossings

        Raises
        ------
        SettingError
            If speeds, orders or factors are missing, or no free body has a load.
        """
        return crossings.resonance_crossings(
            self.problem,
            speeds,
            engine_orders,
            rpm=rpm,
            damper_mass_factor=damper_mass_factor,
            mode=mode,
            executor=executor,
            resume=resume,
            progress=progress,
            margin=margin,
            errors=errors,
            conditions=Conditions(friction, temperature, excitation),
        )

    @partial(validation.check_arguments, name="run_up")
    def run_up(
        self,
        speeds: tuple[float, float] | None = None,
        *,
        rpm: tuple[float, float] | None = None,
        mode: int = 1,
        options: ContinuationOptions | None = None,
        progress: bool | None = None,
        friction: rotor_speed.Table | None = None,
        temperature: rotor_speed.Table | None = None,
        excitation: rotor_speed.Excitations | None = None,
    ) -> ResponseCurve:
        """Compute the response along the engine order line of the study through its crossing with a mode.

        Parameters
        ----------
        speeds : (low, high), rad/s, optional
            Range that contains the crossing. By default, it extends from the free to the stuck
            resonance on the line, with a margin, within 50 to 2000 rad/s and the range covered by
            tables of speed.
        rpm : (low, high), revolutions per minute
            Alternative to ``speeds``.
        mode : int
        options : ContinuationOptions
            Settings of the continuation; coarse by default. The highest point is refined.
        progress : bool, optional
            Show progress: a bar or, without a terminal, lines of text after ten seconds; on by default.
        friction, temperature, excitation
            Conditions that depend on speed, see :meth:`at_speed`.

        Returns
        -------
        ResponseCurve
            Curve of kind "run-up". Its highest maximum solves the equations assembled at its speed;
            ``notes`` contain the peak at fixed speed.

        Raises
        ------
        SettingError
            If a setting does not fit, or the error of the interpolation between speeds is too
            large; use a shorter range.
        BdamperError
            If there is no crossing in the range.
        """
        return campbell.run_up(
            self.problem,
            speeds,
            rpm=rpm,
            mode=mode,
            options=options,
            progress=progress,
            conditions=Conditions(friction, temperature, excitation),
        )

    @property
    def preload(self) -> float:
        """Preload (N) of a study at a rotor speed (:meth:`at_speed`): mass times radius times speed squared."""
        if self.settings.speed is None:
            raise SettingError(
                "preload: this study has no rotor speed; use study.at_speed(omega).preload"
            )
        return rotor_speed.preload_at(self.problem, self.settings.speed)

    # accuracy

    @partial(validation.check_arguments, name="harmonic_convergence")
    @needs_contacts
    def harmonic_convergence(
        self,
        peak: Peak,
        *,
        harmonics: Sequence[int] = accuracy.HARMONICS,
        tolerance: float = accuracy.TOLERANCE,
        progress: bool | None = None,
    ) -> Convergence:
        """Compute a peak with an increasing number of harmonics.

        Parameters
        ----------
        peak : Peak
            Converged peak of this study (:meth:`peak`).
        harmonics : sequence of int
            Highest harmonic of each computation, in increasing order. All lower harmonics are
            included, or only the odd ones if even harmonics vanish.
        tolerance : float
            Relative change of the amplitude below which the sequence counts as converged.
        progress : bool, optional
            Show progress: a bar or, without a terminal, lines of text after ten seconds; on by default.

        Returns
        -------
        Convergence
            After Ctrl-C it contains the results computed so far.

        Raises
        ------
        SettingError
            If the peak has not converged or belongs to another study.
        """
        return accuracy.harmonic_convergence(
            self.problem, peak, harmonics=harmonics, tolerance=tolerance, progress=progress
        )

    @partial(validation.check_arguments, name="estimate_errors")
    @needs_contacts
    def estimate_errors(
        self,
        result: ResponseCurve | Peak,
        *,
        sources: Sequence[str] = error_estimates.SOURCES,
        complete: bool = False,
    ) -> ErrorEstimates:
        """Estimate the errors of a peak by source.

        Parameters
        ----------
        result : ResponseCurve or Peak
            For a response curve, the errors of its highest peak are estimated.
        sources : sequence of str
            Subset of ``SOURCES`` in ``bdamper/analyses/error_estimates.py``, and "time", a time
            integration near the peak.
        complete : bool
            Compute the complete response curve of each more detailed study, and compare with all
            residual modes instead of six more.  Otherwise Newton's method continues from the peak,
            and a complete curve is computed only if it has no answer.  Complete curves take 7 to 60
            times as long as the peak.

        Returns
        -------
        ErrorEstimates

        Raises
        ------
        SettingError
            If the result has not converged or belongs to another study.
        """
        return error_estimates.estimate_errors(
            self.problem, result, sources=sources, complete=complete
        )

    @partial(validation.check_arguments, name="refine")
    @needs_contacts
    def refine(
        self,
        peak: Peak,
        *,
        tolerance: float = 0.05,
        maximum: float = refinement.MAXIMUM,
        sources: Sequence[str] = error_estimates.SOURCES,
        progress: bool | None = None,
    ) -> Refinement:
        """Refine the study until the estimated error of a peak is within a tolerance.

        Each step reduces the largest of the errors that :meth:`estimate_errors` finds. The estimate
        has already computed the peak of the next study, so that no peak has to be searched for
        again.

        Parameters
        ----------
        peak : Peak
            Converged peak of this study (:meth:`peak`).
        tolerance : float
            Relative tolerance of amplitude and frequency.
        maximum : float
            Maximum time (s) of all steps together.
        sources : sequence of str
            Sources of error that are estimated and reduced, as in :meth:`estimate_errors`; others
            remain.  With "harmonics" alone, the peak gets the harmonics that it needs.
        progress : bool, optional
            Show a progress bar; by default in a terminal and a notebook.

        Returns
        -------
        Refinement
            ``study`` and ``peak`` of the last step, and ``steps`` with the cost of each. The status
            is "incomplete" if the model has no more detail, a more detailed study has no peak,
            harmonic balance cannot determine the amplitude, or the next step would exceed
            ``maximum``. ``needed`` then gives the settings or the model that would reach the
            tolerance. After Ctrl-C, it contains the steps so far.

        Raises
        ------
        SettingError
            If the peak has not converged or belongs to another study.
        """
        return refinement.refine(
            self,
            peak,
            tolerance=tolerance,
            maximum=maximum,
            sources=sources,
            progress=progress,
        )

    def save(self, path: FilePath, *, include_model: bool = True) -> None:
        """Write model, settings and versions to an HDF5 file, which :func:`bdamper.load_study` reads.

        Parameters
        ----------
        path : path-like
            File to write.
        include_model : bool
            If False, the file contains the hash of the model only, and :func:`bdamper.load_study`
            requires the model as an argument.
        """
        check_model_once(self.model)
        settings = self.problem.record()
        # the record names the method in use; None lets a study of the file choose it again
        if self.settings.contact_stiffness is None:
            settings = settings | {"contact_stiffness": None}
        attributes = {
            "format": FORMAT,
            "version": 1,
            "model_hash": self.model.hash,
            **INSTALLED.attributes(),
        }
        with write_hdf5(path) as file:
            file.attrs.update(attributes)
            file["settings"] = json.dumps(settings)
            if include_model:
                write_model(new_group(file, "model"), self.model)


FORMAT = "bdamper-study"


@validation.check_arguments
def load_study(path: FilePath, model: Model | None = None) -> Study:
    """Read a study from its file, or from the file of one of its results.

    Parameters
    ----------
    path : path-like
        File written by :meth:`Study.save`, or the file of a result, which contains the settings of
        its study and the hash of its model.
    model : Model, optional
        Required if the file contains only the hash.  A model at a different rotor speed is
        converted to the speed of the study.

    Returns
    -------
    Study

    Raises
    ------
    FileNotFoundError
        If the file does not exist.
    BdamperError
        If the file contains no study, or the model is missing or different.
    """
    digest = ""
    settings: dict[str, Any] = {}
    stored_model = None
    with read_hdf5(path, "a study or a result") as file:
        if "model_hash" in file.attrs:
            digest = read_attribute(file, "model_hash")
        if digest:
            missing = "the group or dataset is missing"
            check_sentence("settings" in file, place(file, "settings"), missing)
            settings = json.loads(file["settings"][()])
        if digest and "model" in file:
            stored_model = read_model(file["model"])
    if "excitation" not in settings:
        raise BdamperError(f"{path}: expected a study or its result, found a file without settings")
    if stored_model is not None:
        check_model(stored_model, where=f"{path}: /model")
    if model is None:
        model = stored_model
    if model is None:
        raise BdamperError(f"{path}: the file contains no model; give the one with hash {digest}")
    # the hash belongs to the model at the speed of the study
    if model.hash != digest and settings.get("speed"):
        model = model.at_speed(settings["speed"])
    if model.hash != digest:
        raise BdamperError(f"{path}: expected the model with hash {digest}, found {model.hash}")
    return Study(model, **settings_of(settings))


register_reader(FORMAT, load_study)


def _settings_explained() -> str:
    """Return the parameters of the settings in numpydoc form, each with its default."""
    defaults = {}
    for field in fields(Settings):
        if field.init:
            is_required = field.default is MISSING
            defaults[field.name] = "required" if is_required else f"default {field.default!r}"
    # without docstrings (python -OO) there is nothing to explain
    lines = (getdoc(Settings) or "").splitlines()
    explained = []
    for line in lines[1:]:
        # "name : type", or several names with a common explanation
        names = line.partition(" : ")[0].split(", ")
        of_names = [defaults[name] for name in names if name in defaults]
        # equal defaults are written once
        explained.append(", ".join([line, *dict.fromkeys(of_names)]))
    return "\n".join(explained)


EXAMPLE = """
Examples
--------
Resonance peak of a bladed disk with friction dampers under the platforms:

>>> import bdamper as bd
>>> study = bd.Study(bd.reference_model("bladed_disk"), bd.Excitation("tip"), engine_order=5, friction_coefficient=0.3)
>>> peak = study.peak(2000.0)
>>> print(f"{1e6 * peak.amplitude:.3g} µm at {peak.frequency:.5g} Hz")
300 µm at 359.84 Hz
"""
Study.__doc__ = f"{getdoc(Study)}\n{_settings_explained()}\n{EXAMPLE}"
