"""Study: a model with settings, and the analyses as methods.

The analyses are functions of other modules that take a :class:`bdamper.harmonic_balance.problem.Problem` first.
:class:`Study` binds them to its problem.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import MISSING, dataclass, fields
from functools import wraps
from inspect import getdoc, signature
from pathlib import Path
from types import MethodType
from typing import Any, Concatenate, Generic, ParamSpec, TypeVar, get_type_hints, overload

from numpy.typing import NDArray

from bdamper.analyses import accuracy as more_harmonics
from bdamper.analyses import campbell, crossings, error_estimates, flutter, robust_optimum
from bdamper.analyses import campbell as campbell_diagram
from bdamper.analyses import effect_significance as significance
from bdamper.analyses import hysteresis as cycles
from bdamper.analyses import nonlinear_mode as modes
from bdamper.analyses.executors import check_executor
from bdamper.analyses.optimum import check_optimum
from bdamper.contact.preload_state import PreloadState
from bdamper.contact.stiffness import report
from bdamper.fatigue import margin as margins
from bdamper.fatigue import stress_cycle as stresses
from bdamper.fatigue.criteria import Material
from bdamper.harmonic_balance import checks, parameters
from bdamper.harmonic_balance import rotor_speed as at_speed
from bdamper.harmonic_balance.checks import asked, check_question, check_settings, check_unloaded
from bdamper.harmonic_balance.problem import Problem
from bdamper.harmonic_balance.settings import Settings, settings_of
from bdamper.model.loads import Excitation
from bdamper.model.model_file import read_model, write_model
from bdamper.model.structure import Model
from bdamper.model.validation import check_model, check_model_once
from bdamper.response import highest_peak, linear_limits, sensitivity
from bdamper.response import optimal_curve as optimal
from bdamper.response import response_curve as tracking
from bdamper.response.events import ContinuationOptions
from bdamper.response.linear_limits import peak_interval
from bdamper.response.optimal_curve_result import OptimalCurve
from bdamper.response.peak import Peak, PeakOptions
from bdamper.response.response_curve_result import ResponseCurve
from bdamper.time_domain import floquet
from bdamper.time_domain import time_response as in_time
from bdamper.time_domain.frequency_sweep import frequency_sweep
from bdamper.util import validation
from bdamper.util.display import Comparable, Fact
from bdamper.util.errors import BdamperError, SettingError, inside_package, warn
from bdamper.util.formatting import UNITS, aligned, short_repr, spaced, text_of
from bdamper.util.progress import one_thread, shows_progress
from bdamper.util.records import new_group, read_attribute
from bdamper.util.storage import INSTALLED, FilePath, read_hdf5, register_reader, write_hdf5

S = ParamSpec("S")
P = ParamSpec("P")
R = TypeVar("R")


class analysis(Generic[P, R]):
    """Descriptor that turns a function of a problem into a method of a study.

    Access through the class returns the function itself.
    """

    def __init__(self, function: Callable[Concatenate[Problem, P], R]) -> None:
        self.function, self.__doc__ = function, function.__doc__

    @overload
    def __get__(self, study: None, owner: type) -> Callable[Concatenate[Problem, P], R]: ...
    @overload
    def __get__(self, study: Study, owner: type) -> Callable[P, R]: ...
    def __get__(self, study: Study | None, owner: type) -> Callable[..., R]:
        return self.function if study is None else MethodType(self.function, study.problem)


@wraps(Problem.static)
def _static(*args: Any, **given: Any) -> PreloadState:
    """Warn of a state that has not converged."""
    state = Problem.static(*args, **given)
    if not state.converged:
        warn(f"{state.note}; the result is the last state that was found")
    return state


def signature_of(makes: Callable[S, Any]) -> Callable[[Callable[..., None]], Callable[Concatenate[Study, S], None]]:
    """Decorate a constructor to have the signature of the constructor of ``makes``, with types but without their checks."""

    def signed(init: Callable[..., None]) -> Callable[..., None]:
        own, hints = signature(makes.__init__), get_type_hints(makes)
        plain = [
            p.replace(annotation=hints[p.name]) if re.search("validation|Annotated|ByBody", str(p.annotation)) else p
            for p in own.parameters.values()
        ]
        init.__signature__ = own.replace(parameters=plain)  # type: ignore[attr-defined]
        return init

    return signed


@short_repr
@dataclass(frozen=True, eq=False, init=False)
class Study(Comparable):
    """Model with one set of settings.

    Two studies are equal only if they are the same object; the settings of their results can be compared.  The attribute
    ``settings`` (:class:`bdamper.harmonic_balance.settings.Settings`) contains the parameters below.  The attribute
    ``problem`` (:class:`bdamper.harmonic_balance.problem.Problem`) contains bases, contact stiffness and the equations at
    a preload.
    """

    settings: Settings
    problem: Problem

    @signature_of(Settings)
    def __init__(self, *given: Any, **settings: Any) -> None:
        # check_settings warns of the values, with the sizes of the model
        with inside_package():
            checked = Settings(*given, **settings)
        self._ask(Problem(checked))

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
        """Range of the contact stiffness, and use of fallback rules, for each interface."""
        lines = [report(name, contact) for name, contact in self.problem.stiffness.items()]
        return "\n".join(filter(None, [*lines, self.problem.contact.note]))

    replace = asked(parameters.replace_settings)
    static = analysis(validation.check_arguments(_static, name="static"))
    response_at = analysis(validation.check_arguments(checks.response_at))
    wedge_friction = analysis(validation.check_arguments(Problem.wedge_friction, name="wedge_friction"))

    def __str__(self) -> str:
        return "\n".join(["study", *aligned([(fact.name, fact.text) for fact in self._facts() if fact.known], "  ")])

    def _facts(self) -> tuple[Fact, ...]:
        """Return excitation, contact, size of the reduced model, and the settings that differ from the defaults."""
        s, coupling = self.settings, self.problem.coupling
        own = {f.name: f.default for f in fields(s)}
        named = ("model", "excitation", "engine_order", "response", "friction_coefficient", "harmonics", "blade_modes",
                 "damping_ratio")  # fmt: skip
        other = [name for name in own if name not in (*named, "contact_stiffness") and getattr(s, name) != own[name]]
        at, seen = s.excitation, s.response_location
        sectors = f"{s.model.n_blades} sectors, " if s.model.n_blades > 1 else ""
        friction = s.friction_values()

        bases = {name: next(iter(s.model.bodies[name].bases.values())) for name in coupling.modes}
        stored = [f"{name} {len(modes)} of {bases[name].n_modes}" for name, modes in coupling.modes.items()]

        def shown(value: Any) -> str:
            return f"{value:.6g}" if isinstance(value, float) else text_of(value)

        def force(e: Excitation) -> str:
            return f"{e.amplitude:g} N {e.shown}, order {e.engine_order or s.engine_order}"

        return (
            Fact("model", f"{sectors}{', '.join(s.model.bodies)} ({s.model.hash})"),
            Fact("excitation", float(at.amplitude), f"N {at.shown}"),
            Fact("beside it", "; ".join(map(force, at.beside))),
            Fact("engine order", int(s.engine_order)),
            Fact("response", f"{seen.location} {text_of(seen.direction)}"),
            Fact("harmonics", " ".join(map(str, s.harmonic_numbers))),
            Fact("friction coefficient", ", ".join(f"{mu:g}" for mu in friction) or "none"),
            Fact("contact stiffness", text_of(self.problem.stiffness_method)),
            Fact("contact points", coupling.n_points),
            Fact("modes", sum(map(len, coupling.modes.values())), f"({', '.join(stored)})"),
            Fact("modal damping ratio", self.problem.damping_text),
            Fact("damper mass", s.model.masses_text),
            Fact("unknowns", self.problem.n_unknowns),
            *(Fact(spaced(name), f"{shown(getattr(s, name))} {UNITS.get(name, '')}".strip()) for name in other),
            Fact("neglected", "; ".join(s.model.neglected_over_speed(s.needed_diameters)) if s.speed else ""),
        )

    def _shown(self) -> Any:
        return self.model

    def _outcomes(self) -> tuple[Fact, ...]:
        return ()  # only results contain values

    def _asked(self) -> dict[str, Any]:
        return {"model": self.model.hash, **self.problem.record()}

    # linear limits
    free = analysis(linear_limits.free)
    stuck = analysis(linear_limits.stuck)

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
        """Compute the response curve over a frequency interval at one preload, with all branches that are reached.

        Parameters
        ----------
        preload : float, N
            Radial load on the damper.
        frequency : (low, high), Hz
            Frequency interval.
        options : ContinuationOptions, optional
            Step sizes and tolerances of the continuation.
        progress : bool, optional
            Show a progress bar; by default in a terminal and a notebook.
        stability : bool
            Determine the stability of each point (:meth:`with_stability`), even if the study's ``stability`` is off.

        Returns
        -------
        ResponseCurve
            ``status`` is "complete" if the branches span the interval.  Otherwise ``reason`` contains the explanation,
            and the curve contains the points found.
        """
        problem = self.problem
        validation.flag("stability", stability)
        check_question(problem, [problem.check_preload(preload)], frequency)
        curve = tracking.frequency_response(problem, preload, frequency, options=options, progress=shows_progress(progress))
        problem.sizes.check_faces(preload)
        compute = len(curve) and curve.status != "interrupted" and (stability or self.settings.stability)
        return floquet.with_stability(problem, curve) if compute else curve

    # stability and time integration
    with_stability = analysis(floquet.with_stability)
    motion_in_time = analysis(in_time.motion_in_time)
    frequency_sweep = analysis(frequency_sweep)
    time_response = analysis(in_time.time_response)

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
        progress: bool | None = None,
    ) -> Peak:
        """Find the highest point of the response at one preload.

        Parameters
        ----------
        preload : float, N
            Radial load on the damper.
        frequency : (low, high), Hz, optional
            Search interval; by default it surrounds the free and the stuck resonance of ``mode``.
        mode : int
            Mode of the bodies with their constraints, 1 for the lowest.
        options : PeakOptions, optional
            Tolerances of the peak.
        progress : bool, optional
            Show a progress bar; by default in a terminal and a notebook.

        Returns
        -------
        Peak
            The highest point, or a peak with a status and NaN if none was found.
        """
        problem, progress = self.problem, shows_progress(progress)
        frequency = peak_interval(problem.at(preload), frequency, mode)
        check_question(problem, [preload], frequency)
        problem.sizes.check_faces(preload)
        return highest_peak.highest_peak(problem, preload, frequency, mode=mode, options=options, progress=progress)

    @validation.check_arguments
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
        progress: bool | None = None,
        resume: str | Path | None = None,
        quantity: str = "amplitude",
        material: Material | None = None,
    ) -> OptimalCurve:
        """Compute the resonance amplitude over the preload, and check the optimum by time integration.

        Parameters
        ----------
        preload : (low, high) or sequence of more than two values, N
            Preloads, or the ends of a range that is divided into ``n`` preloads with equal ratios.
        n : int
            Number of preloads between two values.
        frequency, mode, options
            See :meth:`peak`.
        executor : concurrent.futures.Executor, optional
            Executor of the curves; threads by default.
        check : {"time", "neighbours", "range", False}
            "time": compute the peak at the optimum with up to 16 harmonics (``curve.convergence``) and the amplitude by
            time integration there and at 1.35 times its preload (``curve.time_response``).  At the better of both preloads
            compute the peaks with 0.7 and 1.3 times the friction (``curve.other_friction``).  Then find the factors on the
            friction coefficients at which the amplitude doubles (``curve.friction_range``, 6 to 13 peaks).  With
            "neighbours" the time integration also includes the preload of the optimum divided by 1.35.  With "range" it
            includes both ends of ``curve.near_best``: the preloads with at most 1.2 times the lowest amplitude by harmonic
            balance.
        progress : bool, optional
            Show the current step and the remaining time; by default in a terminal and a notebook.
        resume : path, optional
            File for all finished curves; interrupted work continues from it.
        quantity : {"amplitude", "margin"}
            "margin": also compute the fatigue margin for ``material`` (``curve.margins``).
        material : Material, optional
            Fatigue strength, required for margins.

        Returns
        -------
        OptimalCurve
            Curve with the harmonics of the study.  After Ctrl-C it contains the results computed until then.
        """
        problem = self.problem
        check = check if check is False else validation.choice("check", check, ("time", "neighbours", "range"))
        check_executor(executor)
        progress, values = shows_progress(progress), optimal.preload_values(preload, n)
        frequency = optimal.curve_interval(problem, values, frequency, mode) if problem.carries_load else frequency
        check_unloaded(problem)
        check_question(problem, values, frequency)
        ways: dict[str, Any] = {"frequency": frequency, "mode": mode, "options": options}
        margin = validation.choice("quantity", quantity, ("amplitude", "margin")) == "margin"
        if margin:
            validation.instance("material", material, Material, "a Material, since quantity is the margin")
            stresses.chosen_sets(problem)
        curve = optimal.optimal_curve(problem, preload, n, executor=executor, **ways, progress=progress, resume=resume)
        problem.sizes.check_optimum(curve.optimum.preload, values)
        problem.sizes.check_faces(curve.optimum.preload)
        return check_optimum(problem, curve, check, material if margin else None, progress)

    peak_sensitivities = analysis(sensitivity.peak_sensitivities)
    curve_sensitivities = analysis(sensitivity.curve_sensitivities)
    with_time_response = analysis(in_time.with_time_response)

    # free vibration
    nonlinear_mode = analysis(modes.nonlinear_mode)
    flutter = analysis(flutter.flutter)

    # stress and fatigue
    stress = analysis(stresses.stress)
    gauge_stress = analysis(stresses.gauge_stress)
    margin = analysis(margins.margin)

    best_margin = analysis(robust_optimum.best_margin)

    # importance of physical effects
    effect_significance = analysis(significance.effect_significance)

    # contact behaviour in a cycle
    hysteresis = analysis(cycles.hysteresis)
    dissipation = analysis(cycles.dissipation)

    # rotor speed
    at_speed = at_speed.at_speed
    campbell = analysis(campbell.campbell)
    resonance_crossings = analysis(crossings.resonance_crossings)
    run_up = analysis(campbell_diagram.run_up)

    @property
    def preload(self) -> float:
        """Preload (N) of a study at a rotor speed (:meth:`at_speed`): mass times radius times speed squared."""
        if self.settings.speed is None:
            raise SettingError("preload: expected a study at a rotor speed, study.at_speed(omega), found none")
        return at_speed.preload_at(self.problem, self.settings.speed)

    # accuracy
    harmonic_convergence = analysis(more_harmonics.harmonic_convergence)
    estimate_errors = analysis(error_estimates.estimate_errors)

    def save(self, path: FilePath, *, include_model: bool = True) -> None:
        """Write the study to an HDF5 file, which :func:`bdamper.load_study` reads: model, settings and versions.

        Parameters
        ----------
        path : path-like
            File to write.
        include_model : bool
            If False, the file contains the hash of the model only, and :func:`bdamper.load_study` needs the model.
        """
        check_model_once(self.model)
        settings = self.problem.record() | ({"contact_stiffness": None} if self.settings.contact_stiffness is None else {})
        with write_hdf5(path) as file:
            file.attrs.update({"format": FORMAT, "version": 1, "model_hash": self.model.hash, **INSTALLED.attributes()})
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
        File of :meth:`Study.save`, or of a result, which contains the settings of its study and the hash of its model.
    model : Model, optional
        Required if the file contains only the hash.  A model of another rotor speed is converted to the speed of the study.

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
    with read_hdf5(path, "a study or a result") as file:
        digest = read_attribute(file, "model_hash") if "model_hash" in file.attrs else ""
        settings = json.loads(file["settings"][()]) if digest else {}
        own = read_model(file["model"]) if digest and "model" in file else None
    if "excitation" not in settings:
        raise BdamperError(f"{path}: expected a study or its result, found a file without settings")
    if own is not None:
        check_model(own, where=f"{path}: /model")
    model = own if model is None else model
    if model is not None and model.hash != digest and settings.get("speed"):
        model = model.at_speed(settings["speed"])
    if model is None or model.hash != digest:
        found = "none" if model is None else model.hash
        raise BdamperError(f"{path}: expected the model with hash {digest}, found {found}")
    return Study(model, **settings_of(settings))


register_reader(FORMAT, load_study)


def _settings_explained() -> str:
    """Return the parameters of the settings in numpydoc form, each with its default."""
    named = {f.name: "required" if f.default is MISSING else f"default {f.default!r}" for f in fields(Settings) if f.init}
    lines = getdoc(Settings).splitlines() if getdoc(Settings) else []  # type: ignore[union-attr]
    heads = ((line, [named[n] for n in line.partition(" : ")[0].split(", ") if n in named]) for line in lines[1:])
    return "\n".join(f"{line}, {', '.join(dict.fromkeys(found))}" if found else line for line, found in heads)


EXAMPLE = """
Examples
--------
Resonance peak of a bladed disk with friction dampers under the platforms:

>>> import bdamper as bd
>>> study = bd.Study(bd.reference_model("bladed_disk"), bd.Excitation("tip"), engine_order=5, friction_coefficient=0.4)
>>> peak = study.peak(2000.0)
>>> print(f"{peak.amplitude:.3g} m at {peak.frequency:.4g} Hz")
0.000359 m at 360.5 Hz
"""
Study.__doc__ = f"{getdoc(Study)}\n{_settings_explained()}\n{EXAMPLE}"
