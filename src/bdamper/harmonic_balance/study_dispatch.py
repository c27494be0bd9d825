"""Functions of a problem that also take a study.

Studies stand above all rooms.  What the rooms see of one is its ``problem``, and that it makes another study of another
problem; functions under :func:`asked` take the first and answer a new problem with the second.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import Any, Concatenate, ParamSpec, Protocol, Self, TypeVar, overload

from bdamper.harmonic_balance.problem import Problem
from bdamper.model.structure import Model
from bdamper.util import validation


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
