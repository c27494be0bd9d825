"""Checks that a result belongs to a problem, and the response of its solutions at other locations.

:func:`asked` makes functions of a problem accept a study.  Class ``Study`` is defined above all packages; these functions
use only its attribute ``problem`` and its method that returns another study of another problem.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import wraps
from typing import Any, Concatenate, NamedTuple, ParamSpec, Protocol, Self, TypeVar, overload

import numpy as np
from numpy.typing import NDArray

from bdamper.harmonic_balance.problem import Problem
from bdamper.model.loads import Direction, Response
from bdamper.model.structure import Model
from bdamper.util import validation
from bdamper.util.errors import SettingError

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
    recorded, current = result.settings, problem.record()
    other = [key for key in current if key in recorded and recorded[key] != current[key] and key != "stability"]
    if "speed" in other:
        mine, at = ("none" if x is None else f"{x:.9g} rad/s" for x in (current["speed"], recorded["speed"]))
        raise SettingError(f"{name}: expected a result at the rotor speed of this study, {mine}, found {at}")
    if result.model_hash not in (problem.model.hash, replace(problem.model, stress={}).hash):  # stress may be added later
        found = "a result of another model" if recorded else "a result without a model"
        raise SettingError(f"{name}: expected a result of this study's model, found {found}")
    found = ", ".join(f"{key} = {recorded[key]} instead of {current[key]}" for key in other)
    validation.check(not other, name, "a result of this study", found)


def check_solution(problem: Problem, preload: float, y: NDArray, residual: float, name: str) -> None:
    """Raise SettingError unless a point (n_unknowns + 1,) solves the equations at a preload (N) as well as its residual."""
    n = len(y) - 1
    validation.check(n == problem.n_unknowns, name, f"a result of this study with {problem.n_unknowns} unknowns", n)
    error = problem.system(preload).error(y)
    found = f"a free or stuck limit, or a result with other settings (residual {error:.2g} at its peak)"
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
        raise SettingError(f"result: expected a peak or a curve with its solutions, found a {type(result).__name__}")
    if not len(unknowns) or unknowns.shape[1] != problem.n_unknowns:
        n = unknowns.shape[1] if len(unknowns) else 0
        expected = f"a result of this study, with {problem.n_unknowns} unknowns"
        raise SettingError(f"result: expected {expected}, found {n} unknowns")
    if hasattr(given, "settings"):
        check_result(problem, result)
    return unknowns


class Solutions(NamedTuple):
    """Unknowns (m, n), frequency (Hz) and preload (N) of solutions, each (m,)."""

    unknowns: NDArray
    frequency: NDArray
    preload: NDArray


def solutions_of(problem: Problem, result: SomeResult) -> Solutions:
    """Return the solutions of a peak or a curve with their preloads.

    Raises
    ------
    SettingError
        See :func:`unknowns_of`.
    """
    given: Any = result
    unknowns = unknowns_of(problem, result)
    preload = np.asarray(given.parameter if hasattr(given, "y") else given.preload, float)
    validation.check(np.isfinite(preload).all(), "result", "one at a known preload", "none")
    n = len(unknowns)
    return Solutions(unknowns, np.broadcast_to(np.asarray(given.frequency, float), n), np.broadcast_to(preload, n))


def response_at(problem: Problem, result: SomeResult, location: str, direction: Direction = "tangential") -> NDArray:
    """Compute the response of a peak or a curve at any location, from its solutions.

    Parameters
    ----------
    problem : Problem
    result : ResponseCurve or Peak
        Result of this study.
    location : str
    direction : {"tangential", "radial", "axial"} or three floats

    Returns
    -------
    (n, n_harmonics + 1) complex, m
        Amplitude of each harmonic at each point of a curve, the mean first; n is 1 for a peak.

    Raises
    ------
    SettingError
        If there is no such location, or the result belongs to another study.
    """
    places = [name for name, at in problem.model.locations.items() if at.kind is None]
    rows = problem.rows_at(Response(validation.choice("location", location, sorted(places)), direction))
    unknowns = unknowns_of(problem, result)
    return np.stack([problem.layout.amplitudes(unknowns, l) @ row for l, row in enumerate(rows)], axis=-1)


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
def asked(function: Callable[Concatenate[Problem, P], Problem]) -> Callable[Concatenate[A, P], A]: ...
@overload
def asked(function: Callable[Concatenate[Problem, P], R]) -> Callable[Concatenate[Asking | Problem, P], R]: ...
def asked(function: Callable[..., Any]) -> Callable[..., Any]:
    """Decorate a function of a problem so that it also accepts a study; a returned problem becomes a study."""

    @wraps(function)
    def of_study(study: Any, /, *given: Any, **named: Any) -> Any:
        answer = function(problem_of(study), *given, **named)
        return like(study, answer) if isinstance(answer, Problem) else answer

    return of_study
