"""Checks of the settings of a problem, checks that a result belongs to it, and the response of a result elsewhere.

Settings outside their plausible ranges (:mod:`bdamper.util.plausible_ranges`) and intervals in radians per second cause
warnings.

:func:`asked` makes functions of a problem accept a study.  Class ``Study`` is defined above all packages; these functions
use only its attribute ``problem`` and its method that returns another study of another problem.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import fields, replace
from functools import wraps
from typing import Any, Concatenate, NamedTuple, ParamSpec, Protocol, Self, TypeVar, overload

import numpy as np
from numpy.typing import NDArray

from bdamper.contact.stiffness import PerArea
from bdamper.harmonic_balance.equations import Equations
from bdamper.harmonic_balance.problem import LoadCase, Problem
from bdamper.harmonic_balance.sector import Sector
from bdamper.harmonic_balance.settings import FRICTION
from bdamper.model.loads import Direction, Response
from bdamper.model.structure import Model
from bdamper.util import plausible_ranges, validation
from bdamper.util.errors import SettingError, warn, warn_implausible
from bdamper.util.progress import one_thread

ALONG = 0.12
"""Smallest plausible cosine between force and modal motion at the excitation location (83 degrees)."""

# ---- results and their problem ----


class SomeResult(Protocol):
    """Result with the settings and the model hash of its problem."""

    @property
    def settings(self) -> dict[str, Any]: ...
    @property
    def model_hash(self) -> str: ...


def check_result(problem: Problem, result: SomeResult, name: str = "result") -> None:
    """Raise an error if a result has another model, another rotor speed or other settings.

    Parameters
    ----------
    problem : Problem
    result : SomeResult
        Its settings may lack the settings that a later version has added.
    name : str
        Name in error messages.

    Raises
    ------
    SettingError
        If the result belongs to another problem.
    """
    recorded, current = dict(result.settings), problem.record()
    # versions up to 0.10 also recorded the coefficients of interfaces with a ContactLaw
    friction, used = recorded.get("friction_coefficient"), current["friction_coefficient"]
    if isinstance(friction, Mapping):
        own = problem.settings.own_laws()
        recorded["friction_coefficient"] = {
            name: mu for name, mu in friction.items() if name in used or name not in own
        }
    other = [
        key
        for key in current
        if key in recorded and recorded[key] != current[key] and key != "stability"
    ]
    if "speed" in other:
        mine, at = (
            "none" if x is None else f"{x:.9g} rad/s" for x in (current["speed"], recorded["speed"])
        )
        raise SettingError(
            f"{name}: expected a result at the rotor speed of this study, {mine}, found {at}"
        )
    if result.model_hash not in (
        problem.model.hash,
        replace(problem.model, stress={}).hash,
    ):  # stress may be added later
        found = "a result of another model" if recorded else "a result without a model"
        raise SettingError(f"{name}: expected a result of this study's model, found {found}")
    found = ", ".join(f"{key} = {recorded[key]} instead of {current[key]}" for key in other)
    validation.check(not other, name, "a result of this study", found)


def check_solution(
    problem: Problem, preload: float, y: NDArray, residual: float, name: str
) -> None:
    """Raise SettingError unless a point (n_unknowns + 1,) solves the equations at a preload (N) as well as its residual."""
    n = len(y) - 1
    validation.check(
        n == problem.n_unknowns,
        name,
        f"a result of this study with {problem.n_unknowns} unknowns",
        n,
    )
    error = problem.system(preload).error(y)
    found = (
        f"a free or stuck limit, or a result with other settings (residual {error:.2g} at its peak)"
    )
    validation.check(error <= max(1e-6, 100.0 * residual), name, "a result of this study", found)


def unknowns_of(problem: Problem, result: SomeResult) -> NDArray:
    """Return the solutions (n, n_unknowns) of a peak or a curve, NaN at points of a curve without a solution.

    Parameters
    ----------
    problem : Problem
    result : ResponseCurve or Peak

    Raises
    ------
    SettingError
        If there are no solutions, or they belong to another problem.
    """
    given: Any = result
    if hasattr(given, "y"):
        if not given.converged:
            raise SettingError(f"result: expected a converged peak, found status {given.status!r}")
        unknowns = np.asarray(given.y)[None, :-1]
    elif hasattr(given, "unknowns"):
        unknowns = np.asarray(given.unknowns)
    else:
        expected = "a peak or a curve with its solutions, such as study.peak(preload)"
        raise SettingError(f"result: expected {expected}, found {type(result).__name__}")
    if not len(unknowns) or unknowns.shape[1] != problem.n_unknowns:
        n = unknowns.shape[1] if len(unknowns) else 0
        expected = f"a result of this study, with {problem.n_unknowns} unknowns"
        raise SettingError(f"result: expected {expected}, found {n} unknowns")
    if hasattr(given, "settings"):
        check_result(problem, result)
    return unknowns


class Solutions(NamedTuple):
    """Unknowns (m, n), frequency (Hz), preload (N) and kind ("response", "free", "stuck" ...) of solutions, each (m,)."""

    unknowns: NDArray
    frequency: NDArray
    preload: NDArray
    kind: NDArray


def solutions_of(problem: Problem, result: SomeResult) -> Solutions:
    """Return the solutions of a peak or a curve with their preloads.

    Raises
    ------
    SettingError
        See :func:`unknowns_of`, and if a peak does not solve the equations, such as the peak of a free or stuck limit.
    """
    given: Any = result
    unknowns = unknowns_of(problem, result)
    preload = np.asarray(given.parameter if hasattr(given, "y") else given.preload, float)
    validation.check(np.isfinite(preload).all(), "result", "one at a known preload", "none")
    if hasattr(given, "y"):
        check_solution(problem, float(preload), given.y, given.residual, "result")
    columns = (
        np.asarray(given.frequency, float),
        preload,
        np.asarray(getattr(given, "kind", "response")),
    )
    return Solutions(unknowns, *(np.broadcast_to(column, len(unknowns)) for column in columns))


def response_at(
    problem: Problem, result: SomeResult, location: str, direction: Direction = "tangential"
) -> NDArray:
    """See :meth:`bdamper.Study.response_at`."""
    places = [name for name, at in problem.model.locations.items() if at.kind is None]
    rows = problem.rows_at(
        Response(validation.choice("location", location, sorted(places)), direction)
    )
    unknowns = unknowns_of(problem, result)
    return np.stack(
        [problem.layout.amplitudes(unknowns, l) @ row for l, row in enumerate(rows)], axis=-1
    )


def warn_of_small_slip(problem: Problem, system: Equations[Any], unknowns: NDArray) -> None:
    """Warn of joints that move less than what their sliders represent, in the motion of a solution."""
    resolution = problem.model.slip_resolution
    if problem.own_laws is None and resolution is None:
        return
    motion = system.contact(unknowns)[0]
    if problem.own_laws is not None:
        problem.own_laws.warn_below(motion)
    if resolution is None:
        return
    largest = float(np.abs(motion[:, :2, 1:]).sum(axis=2).max())
    if largest < resolution:
        warn(
            f"the joint moves by {largest:.3g} m, less than the {resolution:.3g} m that its sliders "
            "resolve: its damping is wrong there; increase its decades"
        )


# ---- functions of a problem or a study ----


class Asking(Protocol):
    """Interface of a study that these functions use."""

    @property
    def problem(self) -> Problem: ...
    @property
    def model(self) -> Model: ...
    def replace(self, **settings: Any) -> Self: ...
    def _with_problem(self, problem: Problem) -> Self: ...


P = ParamSpec("P")
R = TypeVar("R")
A = TypeVar("A", bound=Asking | Problem)


def problem_of(study: Asking | Problem) -> Problem:
    """Return the problem of a study, or the problem itself.

    Raises
    ------
    SettingError
        If the argument is neither.
    """
    problem: Any = getattr(study, "problem", study)
    return validation.instance("study", problem, Problem, "a Study")


def like(study: A, problem: Problem) -> A:
    """Return a problem in the type of the first argument: a study of the problem, or the problem."""
    result: Any = problem
    if not isinstance(study, Problem):
        result = study if problem is study.problem else study._with_problem(problem)
    return result


@overload
def asked(
    function: Callable[Concatenate[Problem, P], Problem],
) -> Callable[Concatenate[A, P], A]: ...
@overload
def asked(
    function: Callable[Concatenate[Problem, P], R],
) -> Callable[Concatenate[Asking | Problem, P], R]: ...
def asked(function: Callable[..., Any]) -> Callable[..., Any]:
    """Decorate a function of a problem so that it also accepts a study; a returned problem becomes a study."""

    @wraps(function)
    def of_study(study: Any, /, *given: Any, **named: Any) -> Any:
        answer = function(problem_of(study), *given, **named)
        return like(study, answer) if isinstance(answer, Problem) else answer

    return of_study


# ---- plausible settings ----


def check_settings(problem: Problem) -> None:
    """Warn if settings of a problem are outside their plausible ranges, or have no effect."""
    sizes = problem.sizes
    for owner, name, value, item in _given(problem):
        plausible_ranges.check(owner, name, value, sizes, item)
    settings = problem.settings
    # a lumped model has the coefficients of its contacts; Problem.replace warns of others
    if not sizes.lumped and settings.friction_coefficient != FRICTION:
        settings.warn_of_unused_friction(settings.friction_coefficient)
    flow, n = settings.aerodynamic_damping, max(problem.model.n_blades, 1)
    used = sorted({problem.engine_order * harmonic % n for harmonic in settings.harmonic_numbers})
    if isinstance(flow, Mapping) and not set(flow) & set(used):
        warn_implausible(
            "aerodynamic_damping",
            f"at one of the nodal diameters {used} of the study",
            f"at {sorted(flow)} alone",
        )


def _given(problem: Problem) -> Iterator[tuple[str, str, Any, str]]:
    """Yield for each setting: owner and name in the table of ranges, value, and name in a warning."""
    settings, sizes = problem.settings, problem.sizes
    of_modes = [b.damping_ratio.max(initial=0.0) for b in problem.modal_bases]
    effective = {
        "friction_coefficient": settings.friction_values(),
        "damping_ratio": max(of_modes, default=0.0)
        if settings.damping_ratio is None
        else settings.damping_ratio,
        "gap": {
            name: problem.point_gaps[problem.coupling.rows(name)]
            for name in problem.coupling.interfaces
        },
        "contact_stiffness": None,
    }
    for field in fields(settings):
        yield "Study", field.name, effective.get(field.name, getattr(settings, field.name)), ""
    for force in (settings.excitation, *settings.excitation.beside):
        place = settings.model.locations.get(force.location)
        if place is not None and place.kind is None:
            yield (
                "Excitation",
                "amplitude",
                {force.location: force.amplitude},
                "excitation amplitude",
            )
    for body in problem.model.bodies.values():
        if body.kind == "free" and body.ports and sizes.volume(body.name) > 0.0:
            yield "Body", f"mass.{body.name}", body.mass or 0.0, ""
    given = settings.contact_stiffness
    rows = problem.friction_points
    if given == "model" or not (
        given is None or isinstance(given, str) or hasattr(given, "n_vectors")
    ):
        stiffness = problem.point_stiffness[rows]
        item = f"contact_stiffness of {type(given).__name__}" if isinstance(given, PerArea) else ""
        if stiffness.any() and np.isfinite(sizes.body_stiffness):
            yield "Study", "contact_stiffness", float(stiffness.mean()), item


@one_thread
def check_question(
    problem: Problem, preload: Sequence[float] | NDArray, frequency: tuple[float, float] | None
) -> None:
    """Check a frequency interval (Hz) and warn if it is implausible at the largest of the preloads (N).

    Public functions call it once for the whole range of preloads.
    """
    pressed = problem.settings.constant_loads or (problem.point_gaps < 0.0).any()
    if problem.carries_load and not np.any(preload) and not pressed:
        warn_implausible(
            "preload", "above 0 N", "0: no contact has a normal force, as in study.free"
        )
    if frequency is not None:
        frequency = validation.interval("frequency", frequency)
        check_interval(
            problem.at(float(np.max(preload)) if problem.carries_load else 0.0), frequency
        )


def check_unloaded(problem: Problem) -> None:
    """Warn if every body whose preload is varied also has a constant load: the optimum then excludes the constant load."""
    settings = problem.settings
    varied = {name for name, share in settings.given_loads("load_per_preload").items() if share}
    held = {
        name: load
        for name, load in settings.given_loads("constant_loads").items()
        if name in varied and np.any(load)
    }
    if varied and set(held) == varied:
        found = f"{', '.join(f'{float(np.sum(load)):g} N on {name!r}' for name, load in held.items())}, in addition to it"
        warn_implausible("constant_loads", "none on a body whose preload is varied", found)


def check_interval(case: LoadCase, frequency: tuple[float, float]) -> None:
    """Warn if an interval (Hz) contains the free and the stuck resonance of a mode only when read as radians per second.

    An interval that contains resonances as given is accepted, unless the response there is far weaker.
    """
    if not case.static.converged:
        return
    sector, springs = case.sector, (None, case.stuck_springs())
    low, high = frequency
    _check_direction(case.problem, sector, frequency)
    resonances = [(w, k) for k in springs for w in sector.linear.modes(k)[0] if w > 0.0]
    mistaken = [(w, k) for w, k in resonances if low < w < high]
    if len({id(k) for _, k in mistaken}) < 2 and any(
        low < w / (2.0 * np.pi) < high for w, _ in resonances
    ):
        return

    def strongest(resonances: list[tuple[float, NDArray | None]]) -> float:
        rows = sector.response_rows[1]
        return max((abs(sector.linear.response(w, k) @ rows) for w, k in resonances), default=0.0)

    given = strongest([(w, k) for w, k in resonances if low < w / (2.0 * np.pi) < high])
    # ratio of responses (read as rad/s over as given) above which rad/s is suspected; at least 333 for first modes of
    # blades under a tangential force at the tip
    weaker = 20.0
    if mistaken and strongest(mistaken) > weaker * given:
        near = ", ".join(f"{f:.4g}" for f in sorted({w / (2.0 * np.pi) for w, _ in mistaken})[:3])
        weak = (
            f"with a response {strongest(mistaken) / given:.2g} times weaker"
            if given
            else "without a resonance"
        )
        warn_implausible(
            "frequency",
            f"an interval in Hz around resonances of the model, such as {near} Hz",
            f"({low:g}, {high:g}) {weak}; divided by 2 pi it contains them: radians per second suspected",
        )
        return
    far = 2.0  # ratio of a frequency, or of an active harmonic of it, to the nearest resonance; nonlinear ones lie nearer
    times = case.problem.settings.harmonic_numbers[-1]
    cubic = any(face.kind == "cubic" for face in case.problem.model.interfaces.values())
    hertz = sorted({w / (2.0 * np.pi) for w, _ in resonances})
    if hertz and not cubic and not any(low / far < f < far * times * high for f in hertz):
        nearest = min(hertz, key=lambda f: abs(np.log(f / high)))
        warn_implausible(
            "frequency",
            f"an interval in Hz around a resonance, such as {nearest:.4g} Hz",
            f"({low:g}, {high:g}), far from every resonance: kHz or a mistaken digit suspected",
        )


def _check_direction(problem: Problem, sector: Sector, frequency: tuple[float, float]) -> None:
    """Warn of a force perpendicular to the motion of all modes without contact in an interval (Hz)."""
    omega, modes = sector.linear.modes(None)
    hertz, at = omega / (2.0 * np.pi), problem.settings.excitation
    within = (frequency[0] < hertz) & (hertz < frequency[1])
    motion = np.linalg.norm(problem.location_modes(at.location, 1) @ modes[:, within], axis=0)
    along = np.abs(problem.modal_force(1).conj() @ modes[:, within]) / at.amplitude
    if within.any() and (along <= ALONG * motion).all():
        share = np.max(along / np.where(motion > 0.0, motion, 1.0))
        modes_at = ", ".join(f"{f:.4g}" for f in hertz[within][:3])
        warn_implausible(
            "excitation direction",
            f"along the motion of a mode in the interval ({modes_at} Hz)",
            f"{at.direction} at '{at.location}', along which these have {100.0 * share:.2g} % of their motion there",
        )
