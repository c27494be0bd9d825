"""Whether a result belongs to a problem, and what its solutions are elsewhere than where the response was asked for.

Functions of a problem that also take a study.

Studies stand above all rooms.  What the rooms see of one is its ``problem``, and that it makes another study of another
problem; functions under :func:`asked` take the first and answer a new problem with the second.
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

# ---- Whether a result belongs to a problem, and what its solutions are elsewhere than where the ----


class SomeResult(Protocol):
    """Settings and model hash of the problem of a result."""

    @property
    def settings(self) -> dict[str, Any]: ...
    @property
    def model_hash(self) -> str: ...


def check_result(problem: Problem, result: SomeResult, name: str = "result") -> None:
    """Refuse a result of another model, of another rotor speed among them, or of other settings.

    Parameters
    ----------
    problem : Problem
    result
        With ``model_hash`` and ``settings``, which may lack some of those that there are now.
    name : str

    Raises
    ------
    SettingError
    """
    kept, own = result.settings, problem.record()
    other = [key for key in own if key in kept and kept[key] != own[key] and key != "stability"]
    if "speed" in other:
        mine, at = ("none" if x is None else f"{x:.9g} rad/s" for x in (own["speed"], kept["speed"]))
        raise SettingError(f"{name}: expected one at the rotor speed of this study, {mine}, found one at {at}")
    if result.model_hash not in (problem.model.hash, replace(problem.model, stress={}).hash):  # stress may come later
        raise SettingError(f"{name}: expected one of this study's model, found one of {'another' * bool(kept) or 'none'}")
    found = ", ".join(f"{key} = {kept[key]} for {own[key]}" for key in other)
    validation.check(not other, name, "one of this study", f"one with {found}")


def unknowns_of(problem: Problem, result: SomeResult) -> NDArray:
    """(n, n_unknowns) the solutions of a peak or a curve, NaN where a curve has no value.

    Parameters
    ----------
    problem : Problem
    result : ResponseCurve or Peak

    Raises
    ------
    SettingError
        If there are none, or they are not those of this problem.
    """
    given: Any = result
    if hasattr(given, "y"):
        if not given.converged:
            raise SettingError(f"result: expected a converged peak, found one that is {given.status}")
        unknowns = np.asarray(given.y)[None, :-1]
    elif hasattr(given, "unknowns"):
        unknowns = np.asarray(given.unknowns)
    else:
        raise SettingError(f"result: expected a peak or a curve with its solutions, found a {type(result).__name__}")
    if not len(unknowns) or unknowns.shape[1] != problem.n_unknowns:
        n = unknowns.shape[1] if len(unknowns) else 0
        raise SettingError(f"result: expected one of this study, with {problem.n_unknowns} unknowns, found {n}")
    if hasattr(given, "settings"):
        check_result(problem, result)
    return unknowns


class Solutions(NamedTuple):
    """Unknowns (m, n), frequency (Hz) and preload (N) of solutions, each (m,)."""

    unknowns: NDArray
    frequency: NDArray
    preload: NDArray


def solutions_of(problem: Problem, result: SomeResult) -> Solutions:
    """Solutions of a peak or a curve at known preloads, NaN where it has no value; errors as for :func:`unknowns_of`."""
    given: Any = result
    unknowns = unknowns_of(problem, result)
    preload = np.asarray(given.parameter if hasattr(given, "y") else given.preload, float)
    validation.check(np.isfinite(preload).all(), "result", "one at a known preload", "none")
    n = len(unknowns)
    return Solutions(unknowns, np.broadcast_to(np.asarray(given.frequency, float), n), np.broadcast_to(preload, n))


def response_at(problem: Problem, result: SomeResult, location: str, direction: Direction = "tangential") -> NDArray:
    """Response of a solved peak or curve at any location, from its solutions.

    Parameters
    ----------
    problem : Problem
    result : ResponseCurve or Peak
        Of this study.
    location : str
    direction : {"tangential", "radial", "axial"} or three floats

    Returns
    -------
    (n, n_harmonics + 1) complex, m
        Amplitude of each harmonic at each point of a curve, the mean first; n is 1 for a peak.

    Raises
    ------
    SettingError
        If there is no such location, or the result is not one of this study.
    """
    places = [name for name, at in problem.model.locations.items() if at.kind is None]
    rows = problem.rows_at(Response(validation.choice("location", location, sorted(places)), direction))
    unknowns = unknowns_of(problem, result)
    return np.stack([problem.layout.amplitudes(unknowns, l) @ row for l, row in enumerate(rows)], axis=-1)


# ---- Functions of a problem that also take a study ----


class Asking(Protocol):
    """A study as the rooms see it."""

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
    """The problem of a study, or the one given.

    Raises
    ------
    SettingError
        If it is neither.
    """
    found: Any = getattr(study, "problem", study)
    return validation.instance("study", found, Problem, "a Study")


def like(study: A, problem: Problem) -> A:
    """A problem as what was asked has it: a study of the problem, or the problem."""
    made: Any = problem
    if not isinstance(study, Problem):
        made = study if problem is study.problem else study._with_problem(problem)
    return made


@overload
def asked(function: Callable[Concatenate[Problem, P], Problem]) -> Callable[Concatenate[A, P], A]: ...
@overload
def asked(function: Callable[Concatenate[Problem, P], R]) -> Callable[Concatenate[Asking | Problem, P], R]: ...
def asked(function: Callable[..., Any]) -> Callable[..., Any]:
    """A function that takes a problem first takes a study, too, and answers a problem with a study of it."""

    @wraps(function)
    def of_study(study: Any, /, *given: Any, **named: Any) -> Any:
        answer = function(problem_of(study), *given, **named)
        return like(study, answer) if isinstance(answer, Problem) else answer

    return of_study
