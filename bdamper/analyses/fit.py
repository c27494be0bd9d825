"""Identification of parameters from measured responses, with intervals that include model errors.

The fit finds the logarithms of the parameters that minimise the sum of squared residuals of
:mod:`bdamper.analyses.response_residuals`. If a response without a damper is given, natural
frequency, damping and force gain are fitted to it first and then held constant: a stiffer contact
and a stiffer structure have the same effect on loaded responses. The errors of the held parameters
widen the intervals of the others.

The interval of a parameter is its profile. The parameter is held at a value and the others are
fitted again, until the sum of squares has risen by the 95 % limit of a t distribution. The noise
level is the larger of the given noise and the residual. A parameter whose interval is its complete
range is not determined by the data.

Model errors are not noise: more points do not average them out, and the parameters absorb part of
them, which the residual does not show. If the residual exceeds the noise, the profile therefore
continues until the misfit has doubled. The sum of squares then rises by three times its excess over
the expectation from noise. The interval also covers the changes if one test after another is
omitted,

.. math:: d_t = (J^T J - J_t^T J_t)^{-1} J_t^T r_t,

with the rows :math:`J_t` and :math:`r_t` of test t. Their jackknife standard error includes model
errors that differ between loads. No residual shows an error that the parameters compensate under
all loads. The true constants then lie outside the interval;
:meth:`bdamper.analyses.fit_result.Fitted.widen` widens it by comparison with a more detailed model.

A fit that omits one test predicts this test, and the residuals measure the error of the prediction.
Tests repeated under the same conditions are omitted together. Their scatter is the noise unless
another is given.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
import scipy  # scipy.stats loads on first use; it takes half a second
from numpy.typing import NDArray

from bdamper.analyses.fit_result import UNKNOWN, Fitted
from bdamper.analyses.response_residuals import (
    EDGE,
    FORCE,
    LOST,
    MeasuredResponse,
    Separation,
    Variations,
    of_mode,
    of_resonances,
    of_test,
)
from bdamper.harmonic_balance.parameters import setting_names, vary
from bdamper.harmonic_balance.problem import Problem
from bdamper.harmonic_balance.study_boundary import StudyLike, problem_of
from bdamper.importers.measured_modes import MeasuredMode
from bdamper.importers.measurements import Measured, Measurement
from bdamper.response.sensitivity import setting_value
from bdamper.util import validation
from bdamper.util.errors import (
    COMPLETE,
    INCOMPLETE,
    BdamperError,
    SettingError,
    inside_user_code,
)
from bdamper.util.formatting import spaced
from bdamper.util.progress import one_thread

P95 = 0.975
"""Quantile of a two-sided 95 % interval."""
TAKEN_UP = 3.0
"""Accepted rise of the sum of squares relative to its excess at the best point: the misfit doubles.
"""
ROUGH = 1e-4
"""Relative tolerance of the sum of squares along a profile."""
LEAST = 1e-4
"""Relative change of the sum of squares below which a fit ends; Gauss-Newton steps toward the data
change it much more.
"""
MOST = 60
"""Maximum number of evaluations of a fit."""
ALIKE = 1e4
"""Condition number of the derivatives above which a combination of parameters counts as unknown."""
NO_EFFECT = 1e-9
"""Singular value of the derivatives, relative to the largest, below which a combination of
parameters has no effect.
"""
CORRELATED = 0.95
"""Correlation of two parameters above which the result names it."""
SEARCH = 12
"""Maximum number of evaluations on each side of a profile."""
PREDICTIONS = 5
"""Maximum number of evaluations of a fit without one test."""
LOWER = 0.9
"""Sum of squares of a fit without one test, relative to that of the fit to all tests, below which
the fit is repeated from there.  Fitted with five harmonics, the data of docs/fit.md end at a misfit
of 5.8 from the initial values and of 0.8 from there."""
ALIKE_FORCE = 0.05
"""Relative difference of the nominal forces of repeated tests."""
NOISE = 0.02
"""Noise of tests without repetitions."""
CONTRADICTED = 3.0
"""Distance between a prior and the data, in standard deviations, above which the result gives the
prior.
"""
NEARLY = 0.05
"""Relative tolerance of the square root of a rise at the end of a profile."""
HOW: dict[type, Callable[..., Separation]] = {
    MeasuredResponse: of_test,
    Measured: of_resonances,
    MeasuredMode: of_mode,
}
"""Functions that return the residuals of each kind of data."""
UNLOADED = {"damping_factor": (0.05, 20.0), "frequency_factor": (0.8, 1.25), FORCE: (0.2, 5.0)}
"""Parameters fitted to the response without a damper, with their ranges."""


@dataclass(eq=False)
class Objective:
    """Residuals of all data as a function of the logarithms of the parameters.

    Parameters
    ----------
    problem : Problem or callable
        Study with settings to vary, or a function that returns the study for parameters given as
        keywords.
    data : sequence of MeasuredResponse, Measured or MeasuredMode
    ranges : mapping of name to (low, high)
    noise : float
        Relative standard deviation of the measured amplitudes.
    held : mapping of name to float
        Constant parameters.
    profiles : bool
        Whether intervals follow from profiles; otherwise they follow from the covariance.
    priors : mapping of str to pair of float
        Mean and standard deviation of parameters that are known from other sources.
    """

    problem: StudyLike | Problem | Callable[..., StudyLike]
    data: Sequence[MeasuredResponse | Measured | MeasuredMode]
    ranges: Mapping[str, tuple[float, float]]
    noise: float
    held: dict[str, float] = field(default_factory=dict)
    profiles: bool = True
    priors: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.priors = {name: pair for name, pair in self.priors.items() if name in self.ranges}
        if not callable(self.problem):
            self.problem = problem_of(self.problem)
        self._last: tuple[NDArray, list[Separation]] | None = None

    @property
    def bounds(self) -> NDArray:
        """Logarithms of the ranges (2, k)."""
        return np.log(np.array(list(self.ranges.values()))).T

    def made(self, values: Mapping[str, float]) -> Problem:
        """Return the problem at values of the parameters, without the force gain."""
        values = {name: float(value) for name, value in values.items() if name != FORCE}
        if not callable(self.problem):
            return vary(problem_of(self.problem), values)
        with inside_user_code():
            made = self.problem(**values)
        return problem_of(made)

    @property
    def start(self) -> NDArray:
        """Logarithms (k,) of the initial values.

        They come from the study, from the defaults of the function, or from the middle of each
        range.
        """
        values = dict(zip(self.ranges, np.exp(self.bounds.mean(axis=0)).tolist()))
        if FORCE in values:
            values[FORCE] = 1.0
        if callable(self.problem):
            parameters = inspect.signature(self.problem).parameters
            for name in values:
                if name not in parameters:
                    continue
                default = parameters[name].default
                if default is not inspect.Parameter.empty:
                    values[name] = default
        else:
            problem = problem_of(self.problem)
            for name in values:
                if name != FORCE:
                    values[name] = setting_value(problem, name)
        # a setting of zero has no logarithm: it begins at the lower end of its range
        positive = [value or 1e-300 for value in values.values()]
        low, high = self.bounds
        return np.clip(np.log(positive), low, high)

    def parts(self, x: NDArray) -> list[Separation]:
        """Return the residuals of each data set; the last result is stored."""
        if self._last is not None and np.array_equal(self._last[0], x):
            return self._last[1]
        parameters = dict(zip(self.ranges, np.exp(x).tolist()))
        # the force gain is no setting: Variations takes it from its parameters and multiplies the
        # excitation by it.  A held gain is therefore listed there too, after the fitted
        # parameters; jacobian() keeps only the derivatives of these
        if FORCE in self.held and FORCE not in self.ranges:
            parameters[FORCE] = self.held[FORCE]
        held_settings = {name: value for name, value in self.held.items() if name != FORCE}
        varied = Variations(lambda values: self.made(held_settings | values), parameters)
        separations = [HOW[type(test)](varied, test, self.noise) for test in self.data]
        self._last = x.copy(), separations
        return separations

    def residual(self, x: NDArray) -> NDArray:
        """Return the residuals (m,) of all data, then those of the priors."""
        values = dict(zip(self.ranges, np.exp(x)))
        tests = [part.residual.ravel() for part in self.parts(x)]
        priors = [
            (values[name] - mean) / deviation for name, (mean, deviation) in self.priors.items()
        ]
        return np.concatenate([*tests, priors])

    def jacobian(self, x: NDArray) -> NDArray:
        """Return the derivatives (m, k) with respect to the logarithms of the parameters."""
        names = list(self.ranges)
        k = len(names)
        rows = []
        for part in self.parts(x):
            # (n, 2, parameters); a held force gain is one more column behind the k fitted ones
            slopes = part.slopes()[..., :k]
            rows.append(slopes.reshape(-1, k))
        for name, (_, deviation) in self.priors.items():
            prior = np.zeros((1, k))
            prior[0, names.index(name)] = 1.0 / deviation
            rows.append(prior)
        # the derivative by ln p is p times that by p
        return np.concatenate(rows) * np.exp(x)

    def log_probability(self, values: Sequence[float] | NDArray) -> float:
        """Return the logarithm of the probability density of parameter values, for samplers.

        It is known up to a constant.

        Noise and priors are normal. Without a prior, values within their range are equally probable
        in their logarithm; outside they are impossible.
        """
        x = np.log(validation.numbers("values", values, len(self.ranges), above=0.0))
        low, high = self.bounds
        if not ((x >= low) & (x <= high)).all():
            return -np.inf
        return -0.5 * float((self.residual(x) ** 2).sum())

    def least(
        self,
        x: NDArray,
        free: NDArray,
        tolerance: float = LEAST,
        most: int = MOST,
        rows: NDArray | slice = slice(None),
    ) -> NDArray:
        """Return the point (k,) at which the sum of squared residuals is least.

        Parameters
        ----------
        x : (k,) float
            Logarithms of the parameters, from which the search begins.
        free : (k,) bool
            Parameters that change; the others keep their values.
        tolerance : float
            Relative change of the sum of squares below which the search ends.
        most : int
            Maximum number of evaluations.
        rows : slice or (n,) int
            Residuals that count; by default all.
        """
        low, high = self.bounds

        def whole(part: NDArray) -> NDArray:
            point = x.copy()
            point[free] = part
            return point

        def residual(part: NDArray) -> NDArray:
            return self.residual(whole(part))[rows]

        def jacobian(part: NDArray) -> NDArray:
            return self.jacobian(whole(part))[rows][:, free]

        # the method begins inside of the bounds
        margin = 1e-6 * (high - low)[free]
        start = np.clip(x[free], low[free] + margin, high[free] - margin)
        solution = scipy.optimize.least_squares(
            residual,
            start,
            jacobian,
            bounds=(low[free], high[free]),
            xtol=1e-9,
            ftol=tolerance,
            gtol=1e-9,
            max_nfev=most,
            x_scale="jac",
        )
        return whole(solution.x)


def covariance(J: NDArray) -> NDArray:
    """Return the covariance (k, k) of parameters for residuals of unit variance.

    Combinations of parameters without effect have a very large variance; a pseudo-inverse would
    give zero.

    Parameters
    ----------
    J : (m, k) float
        Derivatives of the residuals.
    """
    k = J.shape[1]
    # k rows of zeros below: without them, fewer residuals than parameters have too few singular
    # values
    padded = np.pad(J, ((0, k), (0, 0)))
    _, singular, directions = np.linalg.svd(padded, full_matrices=False)
    least = max(NO_EFFECT * singular[0], NO_EFFECT)
    inverse = directions.T / np.maximum(singular, least)
    return np.asarray(inverse @ inverse.T)


def left_out(r: NDArray, J: NDArray, rows: Sequence[slice | NDArray]) -> NDArray:
    """Return the jackknife standard errors (k,), obtained by omitting each group of rows in turn.

    A Gauss-Newton step from the minimum of all rows approximates the fit without a group.

    Parameters
    ----------
    r : (m,) float
        Residuals.
    J : (m, k) float
        Derivatives of the residuals.
    rows : sequence of slice or array
        Rows of each group.
    """
    normal_matrix = J.T @ J
    changes = []
    for group in rows:
        remaining = normal_matrix - J[group].T @ J[group]
        # at the minimum J^T r is zero, so the gradients of the group and of the other rows differ
        # in sign alone
        changes.append(np.linalg.pinv(remaining) @ (J[group].T @ r[group]))
    squared_deviation = (np.array(changes) - np.mean(changes, axis=0)) ** 2
    # (g - 1)/g for g groups: their fits share most rows and scatter less than independent ones
    factor = 1.0 - 1.0 / len(rows)
    return np.asarray(np.sqrt(factor * squared_deviation.sum(axis=0)))


@validation.check_arguments
@one_thread
def fit(
    problem: StudyLike | Problem | Callable[..., StudyLike],
    data: MeasuredResponse
    | Measured
    | MeasuredMode
    | Sequence[MeasuredResponse | Measured | MeasuredMode],
    vary: Mapping[str, tuple[float, float]],
    *,
    free: Measurement | MeasuredResponse | None = None,
    noise: float | None = None,
    priors: Mapping[str, tuple[float, float]] | None = None,
    intervals: Literal["profile", "linear"] = "profile",
) -> Fitted:
    """Identify parameters of a study from measured responses.

    Parameters
    ----------
    problem : Study or callable
        Study with the initial values, or a function that returns the study for parameters given as
        keywords. Default values of the function are the initial values; other parameters start at
        the middle of their range.
    data : MeasuredResponse, Measured, MeasuredMode, or a sequence of these
        Frequency responses, resonances at several loads relative to the resonance without load, or
        frequency and damping of a mode as functions of its amplitude.
    vary : mapping of name to (low, high)
        Positive ranges of the parameters. Names are settings of
        :mod:`bdamper.harmonic_balance.parameters`, such as "friction_coefficient",
        "friction_coefficient.left", "contact_stiffness_factor", "contact_stiffness_factor.normal",
        "damping_factor", "frequency_factor" or "gap_factor", or keywords of the function; and
        "force_factor", the gain of all forces.
    free : Measurement or MeasuredResponse, optional
        Response without a damper. Damping, frequency and force gain are fitted to it first and then
        held constant; ``vary`` may give their ranges.
    noise : float, optional
        Relative standard deviation of a measured amplitude, force or damping ratio, and standard
        deviation of a phase in radians. By default the scatter of the amplitudes of tests repeated
        under the same conditions, or 0.02 without repetitions.
    priors : mapping of str to pair of float, optional
        Mean and standard deviation of parameters that are known from other sources. A prior is
        treated like a measurement.
    intervals : {"profile", "linear"}
        Profiles of the sum of squares, or its quadratic approximation by the covariance, which
        needs no further responses.

    Returns
    -------
    Fitted

    Raises
    ------
    SettingError
        If parameters or ranges are missing, if the data cannot distinguish the parameters, or if a
        test does not fit the model, for example a preload on a model without loads.
    BdamperError
        If no response can be computed at any measured point.
    """
    tests = _tests(data)
    groups, scatter = repetitions(tests)
    notes: tuple[str, ...] = ()
    if noise is None:
        noise = scatter or NOISE
        if scatter:
            notes = (f"noise {scatter:.3g}, the scatter of repeated tests",)
    noise = validation.number("noise", noise, above=0.0, below=1.0)
    model = problem if callable(problem) else problem_of(problem)
    profiles = validation.choice("intervals", intervals, ("profile", "linear")) == "profile"
    ranges, checked_priors = _checked(model, vary, priors or {})
    unloaded = None
    # a function has no settings for damping and frequency, which the free response determines
    is_possible = free is None or not callable(model)
    cannot = "it cannot be combined with a function of all parameters"
    validation.check_sentence(is_possible, "free", cannot)
    if free is not None:
        test = free if isinstance(free, MeasuredResponse) else MeasuredResponse(free, preload=0.0)
        # the first stage has the parameters of UNLOADED; the user may give their ranges
        in_first_stage = {name: ends for name, ends in ranges.items() if name in UNLOADED}
        ranges = {name: ends for name, ends in ranges.items() if name not in UNLOADED}
        unloaded = _stage(
            Objective(
                model,
                [test],
                UNLOADED | in_first_stage,
                noise,
                profiles=profiles,
                priors=checked_priors,
            )
        )
    validation.check(
        ranges, "vary", "parameters that the free response does not determine", list(vary)
    )
    if not callable(model):
        _check_stiffness(ranges, tests)
    objective = Objective(model, tests, ranges, noise, profiles=profiles, priors=checked_priors)
    loaded = _stage(objective, unloaded, groups).result
    loaded = replace(loaded, notes=(*notes, *loaded.notes))
    if unloaded is None:
        return loaded
    return _joined(unloaded.result, loaded)


def _check_stiffness(
    ranges: Mapping[str, Any], tests: Sequence[MeasuredResponse | Measured | MeasuredMode]
) -> None:
    """Raise SettingError if no test distinguishes a stiffer contact from a stiffer structure."""
    contact = [name for name in ranges if name.startswith("contact_stiffness")]
    if "frequency_factor" not in ranges or not contact:
        return
    if any(isinstance(test, MeasuredResponse) and test.preload == 0.0 for test in tests):
        return
    raise SettingError(
        f"vary: frequency_factor and {contact[0]} need a test without load (free=), because "
        "a stiffer contact and a stiffer structure have the same resonances"
    )


def _checked(
    model: Problem | Callable[..., StudyLike],
    vary: Mapping[str, tuple[float, float]],
    priors: Mapping[str, tuple[float, float]],
) -> tuple[dict[str, tuple[float, float]], dict[str, tuple[float, float]]]:
    """Return the ranges of the parameters and their priors."""
    names = inspect.signature(model).parameters if callable(model) else setting_names(model)
    ranges = {}
    checked = validation.mapping("vary", vary, (*names, FORCE), "parameters")
    for name, ends in checked.items():
        ranges[name] = validation.interval(f"range of {name}", ends, "the unit of the parameter")
    checked_priors = {}
    for name, pair in validation.mapping("priors", priors, ranges, "parameters of vary").items():
        mean, deviation = validation.numbers(f"prior of {name}", pair, 2, above=0.0)
        checked_priors[name] = float(mean), float(deviation)
    return ranges, checked_priors


def _tests(data: Any) -> list[MeasuredResponse | Measured | MeasuredMode]:
    """Return one test or several as a list of tests."""
    kinds = MeasuredResponse, Measured, MeasuredMode
    if isinstance(data, kinds):
        return [data]
    validation.instance(
        "data",
        data,
        Iterable,
        "a MeasuredResponse, a Measured, a MeasuredMode or a sequence of these",
    )
    tests = [validation.instance("data", test, kinds) for test in data]
    validation.check(tests, "data", "one test or more", "none")
    return tests


def repetitions(
    data: Sequence[MeasuredResponse | Measured | MeasuredMode],
) -> tuple[list[int], float]:
    """Return the repetitions among tests, and their scatter.

    Returns
    -------
    groups : list of int
        For each test the index of the first test under the same conditions, which may be itself.
    scatter : float
        Standard deviation of the logarithm of amplitude over force, 0 without repetitions.  Tests
        measured at other frequencies are interpolated.
    """
    groups = list(range(len(data)))
    swept_at_force = [
        (index, test)
        for index, test in enumerate(data)
        if isinstance(test, MeasuredResponse) and test.control == "force"
    ]
    variances = []
    for position, (index, test) in enumerate(swept_at_force):
        for earlier_index, earlier in swept_at_force[:position]:
            if not _same_conditions(test, earlier):
                continue
            difference = _difference(test, earlier)
            # without common frequencies they are parts of one test
            if len(difference):
                groups[index] = min(groups[index], groups[earlier_index])
                # the difference of two tests has twice the variance of one
                variances.append(difference**2 / 2.0)
    if not variances:
        return groups, 0.0
    return groups, float(np.sqrt(np.concatenate(variances).mean()))


def _same_conditions(one: MeasuredResponse, other: MeasuredResponse) -> bool:
    """Return whether two tests have the same preload and sweep, and nearly the same force."""
    if (one.preload, one.sweep) != (other.preload, other.sweep):
        return False
    if (one.nominal is None) != (other.nominal is None):
        return False
    # without nominal forces the ratio is 1
    force_ratio = (one.nominal or 1.0) / (other.nominal or 1.0)
    return abs(force_ratio - 1.0) < ALIKE_FORCE


def _difference(test: MeasuredResponse, other: MeasuredResponse) -> NDArray:
    """Return ln(amplitude over force) of a test minus that of another.

    There is a value at each frequency of ``test`` within the range of ``other``, which is
    interpolated; the array is empty if the ranges do not overlap.
    """
    frequency, logarithm = _logarithms(test)
    other_frequency, other_logarithm = _logarithms(other)
    lowest = other_frequency[0]
    highest = other_frequency[-1]
    is_common = (frequency >= lowest) & (frequency <= highest)
    difference = logarithm - np.interp(frequency, other_frequency, other_logarithm)
    return difference[is_common]


def _logarithms(test: MeasuredResponse) -> tuple[NDArray, NDArray]:
    """Return frequencies (n,) in ascending order and logarithms (n,) of amplitude over force."""
    ascending = np.argsort(test.data.frequency)
    # the force at each point is its factor times the nominal force, if there is one
    amplitude = np.abs(test.data.displacement)
    amplitude_over_force = amplitude / test.factors / (test.nominal or 1.0)
    return test.data.frequency[ascending], np.log(amplitude_over_force)[ascending]


@dataclass(frozen=True)
class _Stage:
    """Result of one stage of a fit, with the covariance (k, k) of the logarithms."""

    result: Fitted
    covariance: NDArray


def _stage(
    objective: Objective, before: _Stage | None = None, groups: Sequence[int] | None = None
) -> _Stage:
    """Fit one stage with the parameters of the previous stage held constant.

    ``groups`` has the same number for tests that are left out together; by default each test is
    left out alone.
    """
    if before is not None:
        objective.held = dict(zip(before.result.names, before.result.values.tolist()))
    names = tuple(objective.ranges)
    # x contains the logarithms (k,) of the parameters
    x = objective.least(objective.start, free=np.ones(len(names), bool))
    parts = objective.parts(x)
    labels = tuple(_label(test) for test in objective.data)
    if all(part.lost.all() for part in parts):
        reason = parts[0].reason or "no solution on the swept branch"
        raise BdamperError(
            f"fit: no response could be computed at any measured point (first test: {labels[0]}, "
            f"{reason}); check preloads, forces and frequencies"
        )
    if groups is None:
        groups = range(len(parts))
    # group of each row of the residual
    sizes = [part.residual.size for part in parts]
    group_of_row = np.repeat(groups, sizes)
    x, prediction = _lowest_minimum(objective, x, group_of_row)
    parts = objective.parts(x)
    group_rows = [np.flatnonzero(group_of_row == number) for number in np.unique(group_of_row)]
    uncertainty = _uncertainty(objective, x, group_rows, before)

    lowest, highest = objective.bounds
    below, above = uncertainty.half_widths
    interval_low, interval_high = np.clip([x - below, x + above], lowest, highest)
    # an interval that is the complete range says nothing about the parameter
    unknown = (interval_low <= lowest + EDGE) & (interval_high >= highest - EDGE)
    J = objective.jacobian(x)
    deviation = np.sqrt(np.diag(uncertainty.covariance))
    correlated = _correlated(names, uncertainty.covariance)
    notes: tuple[str, ...] = ()
    if correlated and not unknown.any():
        notes = (f"correlated: {', '.join(correlated)}",)
    doubts = _doubts(objective, x, J, unknown)
    doubts += _far_priors(objective, x)
    for label, part in zip(labels, parts):
        doubts += _lost_points(label, part)

    if callable(objective.problem):
        problem = objective.made(dict(zip(names, np.exp(x))))
    else:
        problem = problem_of(objective.problem)
    result = Fitted(
        names=names,
        values=np.exp(x),
        low=np.exp(interval_low),
        high=np.exp(interval_high),
        deviation=np.where(unknown, np.inf, deviation),
        left_out=uncertainty.left_out,
        information=_information(J, sizes),
        tests=labels,
        noise=objective.noise,
        place=np.concatenate([part.place for part in parts]),
        measured=np.concatenate([part.measured for part in parts]),
        model=np.concatenate([part.model for part in parts]),
        residual=np.concatenate([part.residual for part in parts]),
        test=np.repeat(np.arange(len(parts)), [len(part.place) for part in parts]),
        prediction=prediction,
        notes=notes,
        **problem.recorded(),
    )
    return _Stage(_with_status(result, doubts), uncertainty.covariance)


def _information(J: NDArray, sizes: Sequence[int]) -> NDArray:
    """Return the share (k, n_tests) of each test in the information about each parameter.

    The information is the sum of squares of a column of ``J``.  ``sizes`` contains the number of
    rows of each test; rows of priors follow.
    """
    information_of_tests = []
    for end, size in zip(np.cumsum(sizes), sizes):
        rows_of_test = J[end - size : end]
        information_of_tests.append((rows_of_test**2).sum(axis=0))
    # (k, 1); a parameter without any effect has shares of zero
    whole = np.maximum((J**2).sum(axis=0)[:, None], 1e-300)
    return np.asarray(np.array(information_of_tests).T / whole)


def _label(test: MeasuredResponse | Measured | MeasuredMode) -> str:
    """Return the name of a test in results."""
    if isinstance(test, MeasuredResponse):
        return test.label
    return test.source or "resonances"


def _correlated(names: Sequence[str], covariance: NDArray) -> list[str]:
    """Return the pairs of parameters with a strong correlation, with its value."""
    deviation = np.sqrt(np.diag(covariance))
    correlation = np.abs(covariance) / np.outer(deviation, deviation)
    # above the diagonal each pair occurs once
    is_strong = np.triu(correlation > CORRELATED, 1)
    pairs = []
    for i, j in zip(*np.nonzero(is_strong)):
        signed = covariance[i, j] / deviation[i] / deviation[j]
        pairs.append(f"{spaced(names[i])} and {spaced(names[j])} ({signed:+.3f})")
    return pairs


def _doubts(objective: Objective, x: NDArray, J: NDArray, unknown: NDArray) -> list[str]:
    """Return a statement for each parameter that the data do not determine or that is at an end.

    ``J`` contains the derivatives at ``x``, and ``unknown`` (k,) says whether the interval of a
    parameter is its complete range.
    """
    names = list(objective.ranges)
    low, high = objective.bounds
    doubts = [f"{spaced(name)} {UNKNOWN}" for name, is_unknown in zip(names, unknown) if is_unknown]
    # singular values descend: the last direction has the smallest effect on the residuals
    _, singular, directions = np.linalg.svd(J, full_matrices=False)
    is_undetermined = singular[-1] * ALIKE < singular[0]
    # a single unknown parameter has such a direction as well, and is named above
    if is_undetermined and not unknown.any():
        weakest = directions[-1]
        terms = []
        for share, name in zip(weakest, names):
            if abs(share) > 0.1:
                terms.append(f"{share:+.2f} ln {name}")
        doubts.append(f"the data do not determine {' '.join(terms)}")
    distance = np.minimum(x - low, high - x)
    at_end = (distance < 1e-3 * (high - low)) & ~unknown
    for name, is_at_end in zip(names, at_end):
        if is_at_end:
            doubts.append(f"{spaced(name)} is at an end of its range")
    return doubts


def _lost_points(label: str, part: Separation) -> list[str]:
    """Return a statement if no response was computed at some points of a test."""
    n_lost = int(part.lost.sum())
    if not n_lost:
        return []
    reason = f" ({part.reason})" if part.reason else ""
    return [
        f"no response was found at {n_lost} points of {label}{reason}, each counted as {LOST:g} "
        "times the noise"
    ]


def _far_priors(objective: Objective, x: NDArray) -> list[str]:
    """Return a statement for each prior that the data contradict.

    Without its prior, a parameter has a value and a deviation from the other rows. The distance of
    the prior from that value, in standard deviations of the difference, is the residual of the
    prior divided by the root of one minus its leverage; the formula of Sherman and Morrison avoids
    the difference of nearly equal numbers.
    """
    residual = objective.residual(x)
    J = objective.jacobian(x)
    names = list(objective.ranges)
    widths = np.ptp(objective.bounds, axis=0)
    first_prior = len(residual) - len(objective.priors)
    doubts = []
    for row, (name, (mean, deviation)) in enumerate(objective.priors.items(), first_prior):
        without_prior = covariance(np.delete(J, row, axis=0))
        j = names.index(name)
        # the prior is the only information on such a parameter
        if np.sqrt(without_prior[j, j]) > widths[j]:
            continue
        distance = abs(residual[row]) * np.sqrt(1.0 + J[row] @ without_prior @ J[row])
        if distance > CONTRADICTED:
            prior = f"the prior of {spaced(name)} ({mean:g} with {deviation:g})"
            doubts.append(
                f"{prior} is {distance:.2g} standard deviations from the data: examine both"
            )
    return doubts


def _lowest_minimum(objective: Objective, x: NDArray, group: NDArray) -> tuple[NDArray, NDArray]:
    """Return a minimum (k,) and the residuals (n, 2) of its predictions.

    The minimum is ``x``, or a lower one to which a fit without some tests has led.  For ``group``
    and the predictions see :func:`_predictions`.
    """
    prediction, lower = _predictions(objective, x, group)
    if lower is None:
        return x, prediction
    x = objective.least(lower, free=np.ones(len(x), bool))
    prediction, _ = _predictions(objective, x, group)
    return x, prediction


def _predictions(
    objective: Objective, x: NDArray, group: NDArray
) -> tuple[NDArray, NDArray | None]:
    """Return the residuals (n, 2) of each point in a fit without the tests of its group.

    They are NaN if there is only one group.  ``group`` (m,) is the group of each row of the
    residual, without those of the priors.  If ``x`` is a local minimum, one of these fits may have
    a lower sum of squares over all data; its parameters (k,) are returned as well, otherwise None.
    """
    # two rows for each point, as in the residual: amplitude and phase, or amplitude and frequency
    prediction = np.full(len(group), np.nan)
    numbers = np.unique(group)
    if len(numbers) == 1:
        return prediction.reshape(-1, 2), None
    residual = objective.residual(x)
    J = objective.jacobian(x)
    low, high = objective.bounds
    all_free = np.ones(len(x), bool)
    # sum of squares over all data that a better minimum must not exceed
    lowest = LOWER * float(residual @ residual)
    lower_minimum = None
    for number in numbers:
        omitted = np.flatnonzero(group == number)
        kept = np.setdiff1d(np.arange(len(residual)), omitted)
        # a Gauss-Newton step, at most by a factor of e
        step = -covariance(J[kept]) @ (J[kept].T @ residual[kept])
        start = np.clip(x + np.clip(step, -1.0, 1.0), low, high)
        x_without = objective.least(start, all_free, most=PREDICTIONS, rows=kept)
        residual_without = objective.residual(x_without)
        prediction[omitted] = residual_without[omitted]
        if residual_without @ residual_without < lowest:
            lowest = float(residual_without @ residual_without)
            lower_minimum = x_without
    return prediction.reshape(-1, 2), lower_minimum


@dataclass(frozen=True)
class _Uncertainty:
    """Uncertainty of the logarithms of k parameters.

    Parameters
    ----------
    half_widths : (2, k) float
        Widths of the intervals below and above the estimates.
    covariance : (k, k) float
    left_out : (k,) float
        Jackknife standard deviations over groups of tests; NaN for one group.
    """

    half_widths: NDArray
    covariance: NDArray
    left_out: NDArray


def _uncertainty(
    objective: Objective, x: NDArray, rows: Sequence[NDArray], before: _Stage | None
) -> _Uncertainty:
    """Return the uncertainty of the parameters of a fit.

    Parameters
    ----------
    x : (k,) float
        Logarithms of the parameters at the minimum.
    rows : sequence of (n,) int
        Rows of the residual of each group of tests.
    before : _Stage, optional
        Previous stage, whose parameters are held.
    """
    residual = objective.residual(x)
    J = objective.jacobian(x)
    k = len(x)
    n_groups = len(rows)
    sum_of_squares = float(residual @ residual)
    # absent phases have a residual of zero and do not count
    degrees_of_freedom = max(int(np.count_nonzero(residual)) - k, 1)
    # variance of the residuals: 1 by noise alone, or more with the misfit of the model
    variance = max(1.0, sum_of_squares / degrees_of_freedom)
    t_quantile = float(scipy.stats.t.ppf(P95, degrees_of_freedom))
    # part of the sum of squares that noise does not explain: the model error
    largest_by_noise = float(scipy.stats.chi2.ppf(P95, degrees_of_freedom))
    excess = max(sum_of_squares - largest_by_noise, 0.0)
    # rise of the sum of squares at the ends of the intervals
    rise = max(variance * t_quantile**2, TAKEN_UP * excess)
    of_parameters = variance * covariance(J)
    linear = np.sqrt(rise / variance * np.diag(of_parameters))
    # distances (2, k) to the lower and to the upper end
    if objective.profiles:
        distances = [_profile(objective, x, j, rise, linear[j]) for j in range(k)]
        half_widths = np.array(distances).T
    else:
        half_widths = np.array([linear, linear])
    jackknife_error = np.full(k, np.nan)
    if n_groups > 1:
        jackknife_error = left_out(residual, J, rows)
        # without excess, noise explains the differences between tests
        if excess > 0.0:
            t_of_groups = float(scipy.stats.t.ppf(P95, n_groups - 1))
            half_widths = np.fmax(half_widths, t_of_groups * jackknife_error)
    if before is not None:
        # errors of both stages are independent: their squares add
        carried = _carried_covariance(objective, x, J, before)
        of_parameters = of_parameters + carried
        half_widths = np.hypot(half_widths, t_quantile * np.sqrt(np.diag(carried)))
    return _Uncertainty(half_widths, of_parameters, jackknife_error)


def _carried_covariance(objective: Objective, x: NDArray, J: NDArray, before: _Stage) -> NDArray:
    """Return the covariance (k, k) of the parameters from the errors of the held parameters."""
    held = before.result.values
    # held parameters first, then those of this stage
    joint = Objective(
        objective.problem,
        objective.data,
        UNLOADED | dict(objective.ranges),
        objective.noise,
        priors=objective.priors,
    )
    J_held = joint.jacobian(np.append(np.log(held), x))[:, : len(held)]
    # change (k, n_held) of the least squares solution per change of the held parameters, with the
    # opposite sign, which the product below does not show
    effect = covariance(J) @ J.T @ J_held
    return np.asarray(effect @ before.covariance @ effect.T)


def _profile(objective: Objective, x: NDArray, j: int, rise: float, half: float) -> NDArray:
    """Return the distances (2,) below and above ``x[j]`` of the ends of a profile.

    There the sum of squares, minimised over the other parameters, has risen by ``rise``. The search
    begins at the distance ``half``.
    """
    least_sum = float((objective.residual(x) ** 2).sum())
    J = objective.jacobian(x)
    low, high = objective.bounds
    free = np.arange(len(x)) != j
    # per unit of the parameter, the others change as in the linear problem
    direction = np.ones(len(x))
    if free.any():
        direction[free] = -np.linalg.lstsq(J[:, free], J[:, j], rcond=None)[0]

    def excess(point: NDArray) -> float:
        """Return by which fraction the root of the rise exceeds that of ``rise``, at most 1.

        The root is nearly proportional to the distance, because the sum of squares is nearly a
        parabola.
        """
        risen = float((objective.residual(point) ** 2).sum()) - least_sum
        return min(np.sqrt(max(risen, 0.0) / rise) - 1.0, 1.0)

    def excess_at(distance: float) -> float:
        """Return the excess at a signed distance from ``x[j]``."""
        point = np.clip(x + distance * direction, low, high)
        linear = excess(point)
        if not free.any() or abs(linear) < NEARLY:
            return linear
        # the others are fitted again unless the linear problem has led to the end of the profile
        return excess(objective.least(point, free, ROUGH))

    below = _zero_distance(lambda distance: excess_at(-distance), half, x[j] - low[j])
    above = _zero_distance(excess_at, half, high[j] - x[j])
    return np.array([below, above])


def _zero_distance(excess_at: Callable[[float], float], start: float, limit: float) -> float:
    """Return the distance, at most ``limit``, at which a function that rises from -1 is zero.

    The function is nearly linear.  The search begins at the distance ``start``.
    """
    distance = min(start, limit)
    # distance and value on both sides of the zero
    inner_distance, inner_value = 0.0, -1.0
    outer: tuple[float, float] | None = None
    for _ in range(SEARCH):
        value = excess_at(distance)
        if abs(value) < NEARLY or (value < 0.0 and distance >= limit):
            break
        if value < 0.0:
            inner_distance, inner_value = distance, value
        else:
            outer = distance, value
        if outer is None:
            # the line from -1 at distance 0 through the value, at most five times as far
            distance = min(limit, distance / max(1.0 + value, 0.2))
        else:
            # zero of the chord between both sides
            outer_distance, outer_value = outer
            width = outer_distance - inner_distance
            distance = inner_distance + width * inner_value / (inner_value - outer_value)
    return distance


def _with_status(result: Fitted, doubts: Sequence[str]) -> Fitted:
    reasons = [text for text in (result.wrong, *doubts) if text]
    status = INCOMPLETE if reasons else COMPLETE
    return replace(result, status=status, reason="; ".join(reasons))


def _joined(first: Fitted, last: Fitted) -> Fitted:
    """Join parameters and tests of the results of two stages."""

    def both(name: str) -> NDArray:
        return np.concatenate([getattr(first, name), getattr(last, name)])

    joined = replace(
        last,
        names=first.names + last.names,
        values=both("values"),
        low=both("low"),
        high=both("high"),
        deviation=both("deviation"),
        left_out=both("left_out"),
        information=scipy.linalg.block_diag(first.information, last.information),
        tests=first.tests + last.tests,
        place=both("place"),
        measured=both("measured"),
        model=both("model"),
        residual=both("residual"),
        test=np.append(first.test, last.test + len(first.tests)),
        prediction=both("prediction"),
        notes=first.notes + last.notes,
    )
    return _with_status(joined, (first.doubts, last.doubts))
