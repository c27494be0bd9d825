"""A study: a problem that is asked for responses.

The analyses are functions of their rooms that take a problem first; here they become methods.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import MISSING, dataclass, fields, replace
from inspect import getdoc
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from bdamper.accuracy import estimate
from bdamper.accuracy import tolerance as accuracy_tolerance
from bdamper.continuation import linear_curve
from bdamper.continuation import track as tracking
from bdamper.continuation.curve import Curve
from bdamper.continuation.path import ContinuationOptions
from bdamper.design import compare as designs
from bdamper.design import sensitivity
from bdamper.effects import advice
from bdamper.effects import compare_laws as laws
from bdamper.effects import hysteresis as cycles
from bdamper.fatigue import cycle as stresses
from bdamper.fatigue import margin as margins
from bdamper.fatigue.material import Material
from bdamper.io.model_file import read_model, write_model
from bdamper.io.model_groups import new_group
from bdamper.model.model import Model
from bdamper.model.validation import check_model, check_model_once
from bdamper.modes import flutter
from bdamper.modes import mode as modes
from bdamper.peaks import best_margin, highest, marched, optimal
from bdamper.peaks.newton import Peak, PeakOptions
from bdamper.peaks.optimal_curve import OptimalCurve
from bdamper.problem import at_speed
from bdamper.problem import compare_stiffness as methods
from bdamper.problem.plausible import check_question, check_settings
from bdamper.problem.problem import Problem, matching
from bdamper.problem.settings import Settings, settings_of
from bdamper.speed import campbell, crossings, run_up
from bdamper.stability import floquet, steady_state, time_sweep, verification
from bdamper.util import validate
from bdamper.util.blas import one_thread
from bdamper.util.differences import Comparable
from bdamper.util.errors import BdamperError
from bdamper.util.hdf5 import FilePath, check_folder, enter_reader, load, opened, written
from bdamper.util.plotting import Fact
from bdamper.util.repr import brief, short
from bdamper.util.status import INTERRUPTED
from bdamper.util.versions import HERE

SHOWN = (
    "model", "excitation", "with_", "static", "contact_map", "wedge_friction", "stiffness_report", "compare", "details",
)  # fmt: skip
"""What a study inherits and a user asks for."""


@validate.spelt
@brief
@dataclass(frozen=True, eq=False)
class Study(Problem, Comparable):
    """One model under one set of settings, asked for responses.

    Studies are told apart by identity; what two of them have in common is seen in the settings of their results.  What
    makes the equations is inherited from :class:`bdamper.problem.problem.Problem`.
    """

    def __dir__(self) -> list[str]:
        """What a user asks of a study; settings and arrays, which analyses read from it as a problem, are not named."""
        return [name for name in (*vars(Study), *SHOWN) if not name.startswith("_")]

    def __post_init__(self, residual_traction: str, _given: Mapping[str, Any] | None) -> None:
        super().__post_init__(residual_traction, _given)
        check_settings(self)

    # what is shown of it
    def facts(self) -> tuple[Fact, ...]:
        """Excitation, contact and size of the reduced model, and the settings that are no defaults."""
        own = {f.name: f.default for f in fields(self) if f.init}
        named = ("model", "excitation", "engine_order", "response", "friction_coefficient", "harmonics", "blade_modes")
        other = [name for name in own if name not in (*named, "contact_stiffness") and getattr(self, name) != own[name]]
        at, seen = self.excitation, self.response_location
        sectors = f"{self.model.n_blades} sectors, " if self.model.n_blades > 1 else ""
        friction = sorted({mu for mu in self.friction_by_interface().values() if mu > 0.0})
        return (
            Fact("model", f"{sectors}{', '.join(self.model.bodies)} ({self.model.hash})"),
            Fact("excitation", float(at.amplitude), f"N at {at.location} {short(at.direction)}"),
            Fact("engine order", int(self.engine_order)),
            Fact("response", f"{seen.location} {short(seen.direction)}"),
            Fact("harmonics", " ".join(map(str, self.harmonic_numbers))),
            Fact("friction coefficient", ", ".join(f"{mu:g}" for mu in friction) or "none"),
            Fact("contact stiffness", short(self.stiffness_method)),
            Fact("contact points", self.coupling.n_points),
            Fact("modes", sum(len(modes) for modes in self.coupling.modes.values())),
            Fact("unknowns", self.n_unknowns),
            *(Fact(name.replace("_", " "), short(getattr(self, name))) for name in other),
        )

    def _shown(self) -> Any:
        return self.model

    def _outcomes(self) -> tuple[Fact, ...]:
        return ()  # what the settings come to is seen in results

    def _settings(self) -> dict[str, Any]:
        return self.record()

    def _model(self) -> dict[str, str]:
        return {"model": self.model.hash}

    # linear limits
    free = linear_curve.free
    stuck = linear_curve.stuck

    @validate.spelt
    def track(
        self,
        preload: float,
        frequency: tuple[float, float],
        *,
        from_high: bool = False,
        options: ContinuationOptions | None = None,
        progress: bool = False,
        search_branches: bool | Sequence[float] = False,
        stability: bool = False,
        tolerance: float | None = None,
    ) -> Curve:
        """Tracking curve: the response over a frequency interval at one preload, with all branches on the way.

        Parameters
        ----------
        preload : float, N
            Radial load on the damper.
        frequency : (low, high), Hz
        from_high : bool
            Set off from the upper end.
        options : ContinuationOptions, optional
            Steps and tolerances of the path.
        progress : bool
            Show a progress bar.
        search_branches : bool or sequence of float
            Look for branches apart, from solutions at other preloads: ratios to the preload, 0.9 and 1.2 by default.
        stability : bool
            Judge the stability of every point (:meth:`with_stability`), also if the study's ``stability`` is off.
        tolerance : float, optional
            Relative, on amplitude and frequency of the highest point: whole curves with the study's harmonics, two more,
            four more ... are computed until the last three agree (:mod:`bdamper.accuracy.tolerance`).  The ``ladder`` of
            the curve says whether they do, and their range.

        Returns
        -------
        Curve
            ``status`` is "complete" if its branches span the interval; otherwise ``reason`` says why not, and the points
            found so far are there.
        """
        validate.flag("stability", stability)
        check_question(self, [self.check_preload(preload)], frequency)
        ways: dict[str, Any] = {
            "from_high": from_high, "options": options, "progress": progress, "search_branches": search_branches
        }  # fmt: skip
        if tolerance is not None:
            return accuracy_tolerance.track_to_tolerance(self, preload, frequency, tolerance, stability=stability, **ways)
        curve = tracking.track(self, preload, frequency, **ways)
        judged = len(curve) and curve.status != "interrupted" and (stability or self.stability)
        return floquet.with_stability(self, curve) if judged else curve

    def of(self, result: Curve | Peak | OptimalCurve) -> Study:
        """This study with the harmonics that a tolerance chose for a result; otherwise the study itself.

        The study's own functions find it by themselves; those that take ``curve.unknowns`` need it:
        ``contact_status(study.of(curve), curve.unknowns[i], curve.preload)``.
        """
        kinds = Curve, Peak, OptimalCurve
        return matching(self, validate.instance("result", result, kinds, "a curve or a peak of this study").settings)

    # stability and time
    with_stability = floquet.with_stability
    verify = verification.verify
    settle = steady_state.settle
    sweep_in_time = time_sweep.sweep_in_time
    kept = marched.kept

    # peaks and the optimal curve
    @validate.spelt
    @one_thread
    def peak(
        self,
        preload: float,
        frequency: tuple[float, float] | None = None,
        *,
        mode: int = 1,
        options: PeakOptions | None = None,
        tolerance: float | None = None,
    ) -> Peak:
        """The highest point of the response at one preload.

        Parameters
        ----------
        preload : float, N
        frequency : (low, high), Hz, optional
            Where to look; around the free and the stuck resonance of ``mode`` by default.
        mode : int
            Mode of the constrained bodies, 1 for the lowest.
        options : PeakOptions, optional
            How exactly the highest point is refined.
        tolerance : float, optional
            Relative: harmonics are chosen as for :meth:`track`, by the amplitude and the frequency of the peak.
        """
        check_question(self, [self.check_preload(preload)], frequency)
        ways: dict[str, Any] = {"mode": mode, "options": options}
        if tolerance is not None:
            return accuracy_tolerance.peak_to_tolerance(self, preload, frequency, tolerance, **ways)
        return highest.highest_peak(self, preload, frequency, **ways)

    @validate.spelt
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
        tolerance: float = 0.05,
        check: str | bool = "time",
        progress: bool = False,
        resume: str | Path | None = None,
        quantity: str = "amplitude",
        material: Material | None = None,
    ) -> OptimalCurve:
        """Resonance over the preload, and what a blade keeps of it at the optimum.

        Parameters
        ----------
        preload : (low, high) or sequence of more than two values, N
            Two values: ``n`` preloads between them, equal ratios apart.
        frequency, mode, options
            As for :meth:`peak`.
        executor : concurrent.futures.Executor, optional
            On which the curves are followed; threads by default.
        tolerance : float
            Relative, on the amplitude of the optimum: whether its ``ladder`` says "converged".
        check : {"time", "neighbours", "harmonics", False}
            "time": what a blade keeps at the optimum, by a march in time, in ``curve.kept``; "neighbours": also a factor
            of 1.2 below and above (``bdamper.peaks.marched.with_kept``), and the least of them in ``curve.least_kept``.
            "harmonics": compare with two, four and six more harmonics there and two more elsewhere, in ``curve.ladder``.
        progress : bool
            Show what is being done, and the time left.
        resume : path, optional
            File that keeps every curve, those of the ladder too; work that was interrupted goes on from there.
        quantity : {"amplitude", "margin"}
            "margin": also that against fatigue of a ``material``, in ``curve.margins``, with that of what a blade keeps.
        material : Material, optional

        Returns
        -------
        OptimalCurve
            With the study's own harmonics.  After Ctrl-C what was known by then.
        """
        tolerance = validate.number("tolerance", tolerance, above=0.0, below=1.0)
        check = check if check is False else validate.choice("check", check, ("time", "neighbours", "harmonics"))
        check_question(self, optimal.preload_values(preload, n), frequency)
        ways: dict[str, Any] = {"frequency": frequency, "mode": mode, "options": options}
        shown: dict[str, Any] = {"progress": progress, "resume": resume}
        margin = validate.choice("quantity", quantity, ("amplitude", "margin")) == "margin"
        if margin:
            validate.instance("material", material, Material, "a Material, since quantity is the margin")
            stresses.chosen_sets(self)
        curve = optimal.optimal_curve(self, preload, n, executor=executor, **ways, **shown)
        if check in ("time", "neighbours") and not curve.interrupted:
            best = curve.optimum.preload  # NaN where there is no optimum
            places = [best / 1.2, best, 1.2 * best] if check == "neighbours" and best > 0.0 else None
            curve = marched.with_kept(self, curve, places, progress=progress)
        stopped = curve.interrupted or any(k.status == INTERRUPTED for k in curve.kept)
        if margin and material is not None and not stopped:
            try:
                curve = replace(curve, margins=(best_margin.best_margin(self, curve, material),))
            except KeyboardInterrupt:
                return curve
            stopped = curve.margins[0].best_status == INTERRUPTED
        if check != "harmonics" or stopped:
            return curve
        return accuracy_tolerance.with_ladder(self, curve, tolerance, **shown)

    peak_sensitivities = sensitivity.peak_sensitivities
    with_kept = marched.with_kept
    with_sweeps = marched.with_sweeps

    # free vibration
    nonlinear_mode = modes.nonlinear_mode
    flutter = flutter.flutter

    # stress and fatigue
    stress = stresses.stress
    margin = margins.margin

    best_margin = best_margin.best_margin

    # effects
    advise = advice.advise
    apply = advice.apply
    check = advice.check
    compare_laws = laws.compare_laws
    compare_stiffness = methods.compare_stiffness

    # beside other designs
    compare_designs = designs.compare_designs

    # what the contacts do in a cycle
    hysteresis = cycles.hysteresis
    dissipation = cycles.dissipation

    # over rotor speed
    at_speed = at_speed.at_speed
    campbell = campbell.campbell
    crossings = crossings.crossings
    run_up = run_up.run_up

    @property
    def preload(self) -> float:
        """Preload (N) of a study at a rotor speed (:meth:`at_speed`): mass times radius times squared speed."""
        return at_speed.own_preload(self)

    # accuracy
    estimate_errors = estimate.estimate_errors
    with_errors = estimate.with_errors

    def save(self, path: FilePath, *, include_model: bool = True) -> None:
        """Write the study to an HDF5 file, which :func:`bdamper.load_study` reads: model, settings and versions.

        Parameters
        ----------
        path : path-like
        include_model : bool
            Without it the file holds the model's hash alone, and the model must be given when the study is loaded.
        """
        check_folder(path)
        check_model_once(self.model)
        settings = self.record() | ({"contact_stiffness": None} if self.contact_stiffness is None else {})
        with written(path, track_order=True) as file:
            file.attrs.update({"format": FORMAT, "version": 1, "model_hash": self.model.hash, **HERE.attributes()})
            file["settings"] = json.dumps(settings)
            if include_model:
                write_model(new_group(file, "model"), self.model)


FORMAT = "bdamper-study"


def load_study(path: FilePath, model: Model | None = None) -> Study:
    """The study in a file, or that of which a file holds a result.

    Parameters
    ----------
    path : path-like
        Of :meth:`Study.save`, or of a result's ``save``, which keeps the settings of its study and the hash of its model.
    model : Model, optional
        Where the file holds only the hash; one of another rotor speed is brought to that of the study.

    Raises
    ------
    FileNotFoundError
    BdamperError
        If the file is neither, or the model is missing or another one.
    """
    with opened(path, "a study or a result") as file:
        digest = str(file.attrs.get("model_hash", ""))
        settings = json.loads(file["settings"][()]) if digest else {}
        own = read_model(file["model"]) if digest and "model" in file else None
    if not digest:
        result = load(path)
        settings, digest = getattr(result, "settings", {}), getattr(result, "model_hash", "")
    if "excitation" not in settings:
        raise BdamperError(f"{path}: expected a study or a result of one, found neither")
    if own is not None:
        check_model(own, where=f"{path}: /model")
    model = own if model is None else model
    if model is not None and model.hash != digest and settings.get("speed"):
        model = model.at_speed(settings["speed"])
    if model is None or model.hash != digest:
        found = "none" if model is None else model.hash
        raise BdamperError(f"{path}: expected model={digest}, of which the file holds the hash, found {found}")
    return Study(model, **settings_of(settings))


enter_reader(FORMAT, load_study)


def _settings_explained() -> str:
    """The settings as numpydoc has them, each with its default."""
    named = {f.name: "required" if f.default is MISSING else f"default {f.default!r}" for f in fields(Settings) if f.init}
    lines = getdoc(Settings).splitlines() if getdoc(Settings) else []  # type: ignore[union-attr]
    heads = ((line, [named[n] for n in line.partition(" : ")[0].split(", ") if n in named]) for line in lines[1:])
    return "\n".join(f"{line}, {', '.join(dict.fromkeys(found))}" if found else line for line, found in heads)


Study.__doc__ = f"{getdoc(Study)}\n{_settings_explained()}"
