"""Boundary between studies and problems: functions of a problem that also accept a study.

Class ``Study`` is defined above all packages.  These functions use only its attribute ``problem``
and its method that returns a study of another problem.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import Any, Concatenate, ParamSpec, Protocol, Self, TypeVar, overload

from bdamper.harmonic_balance.problem import Problem
from bdamper.model.structure import Model
from bdamper.util import validation


class StudyLike(Protocol):
    """Members of a study that the functions below class ``Study`` use."""

    @property
    def problem(self) -> Problem: ...
    @property
    def model(self) -> Model: ...
    def replace(self, **settings: Any) -> Self: ...
    def _with_problem(self, problem: Problem) -> Self: ...


P = ParamSpec("P")
R = TypeVar("R")
A = TypeVar("A", bound=StudyLike | Problem)


def problem_of(study: StudyLike | Problem) -> Problem:
    """Return the problem of a study, or the problem itself.

    Raises
    ------
    SettingError
        If the argument is neither.
    """
    problem: Any = getattr(study, "problem", study)
    return validation.instance("study", problem, Problem, "a Study")


def in_type_of(study: A, problem: Problem) -> A:
    """Return a problem as a study if the first argument is a study, otherwise as it is."""
    result: Any
    if isinstance(study, Problem):
        result = problem
    elif problem is study.problem:
        # the same problem needs no new study
        result = study
    else:
        result = study._with_problem(problem)
    return result


@overload
def accepts_study(
    function: Callable[Concatenate[Problem, P], Problem],
) -> Callable[Concatenate[A, P], A]: ...
@overload
def accepts_study(
    function: Callable[Concatenate[Problem, P], R],
) -> Callable[Concatenate[StudyLike | Problem, P], R]: ...
def accepts_study(function: Callable[..., Any]) -> Callable[..., Any]:
    """Decorate a function of a problem so that it also accepts a study.

    A returned problem becomes a study.
    """

    @wraps(function)
    def of_study(study: Any, /, *arguments: Any, **keywords: Any) -> Any:
        answer = function(problem_of(study), *arguments, **keywords)
        if isinstance(answer, Problem):
            return in_type_of(study, answer)
        return answer

    return of_study
