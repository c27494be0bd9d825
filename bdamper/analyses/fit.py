"""Identification of parameters from measured responses, with intervals that include model errors.

The fit finds the logarithms of the parameters that minimise the sum of squared residuals of
:mod:`bdamper.analyses.response_residuals`. If a response without damper is given, natural frequency, damping and force gain
are fitted to it first and then held constant: a stiffer contact and a stiffer structure have the same effect on loaded
responses. The errors of the held parameters widen the intervals of the others.

The interval of a parameter is its profile. The parameter is held at a value and the others are fitted again, until the sum
of squares has risen by the 95 % limit of a t distribution. The noise level is the larger of the given noise and the
residual. A parameter whose interval is its complete range is not determined by the data.

Model errors are not noise: more points do not average them out, and the parameters absorb a part that the residual does not
show. If the residual exceeds the noise, the profile therefore continues until the misfit has doubled. The sum of squares
then rises by three times its excess over the expectation from noise. The interval also covers the changes if one test after
another is omitted,

.. math:: d_t = (J^T J - J_t^T J_t)^{-1} J_t^T r_t,

with the rows :math:`J_t` and :math:`r_t` of test t. Their jackknife standard error includes model errors that differ
between loads. No residual shows an error that the parameters compensate under all loads. The true constants then lie
outside the interval; :meth:`bdamper.analyses.fit_result.Fitted.widen` widens it by comparison with a more detailed model.

A fit without one test predicts this test, and the residuals measure the error of the prediction. Tests repeated under the
same conditions are omitted together. Their scatter is the noise unless another is given.
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
from bdamper.harmonic_balance.checks import Asking, problem_of
from bdamper.harmonic_balance.parameters import setting_names, vary
from bdamper.harmonic_balance.problem import Problem
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
    with_reason,
)
from bdamper.util.formatting import spaced
from bdamper.util.progress import one_thread

P95 = 0.975
"""Quantile of a two-sided 95 % interval."""
TAKEN_UP = 3.0
"""Accepted rise of the sum of squares relative to its excess at the best point: the misfit doubles."""
ROUGH = 1e-4
"""Relative tolerance of the sum of squares along a profile."""
LEAST = 1e-4
"""Relative change of the sum of squares below which a fit ends; Gauss-Newton steps toward the data change it much more."""
MOST = 60
"""Maximum number of evaluations of a fit."""
ALIKE = 1e4
"""Condition number of the derivatives above which a combination of parameters counts as unknown."""
NO_EFFECT = 1e-9
"""Singular value of the derivatives, relative to the largest, below which a combination of parameters has no effect."""
CORRELATED = 0.95
"""Correlation of two parameters above which the result names it."""
SEARCH = 12
"""Maximum number of evaluations on each side of a profile."""
PREDICTIONS = 5
"""Maximum number of evaluations of a fit without one test."""
LOWER = 0.9
"""Sum of squares of a fit without one test, relative to that of the fit to all tests, below which the fit is repeated from
there.  Fitted with five harmonics, the data of docs/fit.md end at a misfit of 5.8 from the initial values and of 0.8 from
there."""
ALIKE_FORCE = 0.05
"""Relative difference of the nominal forces of repeated tests."""
NOISE = 0.02
"""Noise of tests without repetitions."""
CONTRADICTED = 3.0
"""Distance between a prior and the data, in standard deviations, above which the result names the prior."""
NEARLY = 0.05
"""Relative tolerance of the square root of a rise at the end of a profile."""
HOW: dict[type, Callable[..., Separation]] = {
    MeasuredResponse: of_test, Measured: of_resonances, MeasuredMode: of_mode
}  # fmt: skip
"""Functions that return the residuals of each kind of data."""
UNLOADED = {"damping_factor": (0.05, 20.0), "frequency_factor": (0.8, 1.25), FORCE: (0.2, 5.0)}
"""Parameters fitted to the response without damper, with their ranges."""


@dataclass(eq=False)
class Objective:
    """Residuals of all data as a function of the logarithms of the parameters.

    Parameters
    ----------
    problem : Problem or callable
        Study with settings to vary, or a function that returns the study for parameters given as keywords.
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

    problem: Asking | Problem | Callable[..., Asking]
    data: Sequence[MeasuredResponse | Measured | MeasuredMode]
    ranges: Mapping[str, tuple[float, float]]
    noise: float
    held: dict[str, float] = field(default_factory=dict)
    profiles: bool = True
    priors: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.priors = {name: pair for name, pair in self.priors.items() if name in self.ranges}
        self.problem = self.problem if callable(self.problem) else problem_of(self.problem)
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
        """Logarithms (k,) of the initial values: from the study or defaults of the function, or middles of the ranges."""
        middle = dict(zip(self.ranges, np.exp(self.bounds.mean(axis=0)).tolist()))
        if callable(self.problem):
            given = inspect.signature(self.problem).parameters
            known = {name: given[name].default for name in middle if name in given}
            values = {
                name: value for name, value in known.items() if value is not inspect.Parameter.empty
            }
        else:
            values = {
                name: setting_value(problem_of(self.problem), name)
                for name in middle
                if name != FORCE
            }
        values = middle | ({FORCE: 1.0} if FORCE in middle else {}) | values
        return np.clip(np.log([values[name] or 1e-300 for name in middle]), *self.bounds)

    def parts(self, x: NDArray) -> list[Separation]:
        """Return the residuals of each data set; the last result is stored."""
        if self._last is None or not np.array_equal(self._last[0], x):
            held = dict(self.held)
            gain = (
                {FORCE: held.pop(FORCE)} if FORCE in held else {}
            )  # jacobian() omits its derivatives
            values = dict(zip(self.ranges, np.exp(x).tolist()))
            given = values | {n: v for n, v in gain.items() if n not in values}
            varied = Variations(lambda at: self.made(held | at), given)
            self._last = x.copy(), [HOW[type(each)](varied, each, self.noise) for each in self.data]
        return self._last[1]

    def residual(self, x: NDArray) -> NDArray:
        """Return the residuals (m,) of all data, then those of the priors."""
        values = dict(zip(self.ranges, np.exp(x)))
        prior = [
            (values[name] - mean) / deviation for name, (mean, deviation) in self.priors.items()
        ]
        return np.concatenate([*(part.residual.ravel() for part in self.parts(x)), prior])

    def jacobian(self, x: NDArray) -> NDArray:
        """Return the derivatives (m, k) with respect to the logarithms of the parameters."""
        k = len(self.ranges)
        slopes = [part.slopes()[..., :k].reshape(-1, k) for part in self.parts(x)]
        prior = np.eye(k)[[list(self.ranges).index(name) for name in self.priors]]
        return np.concatenate(
            [*slopes, *(row[None] / self.priors[n][1] for n, row in zip(self.priors, prior))]
        ) * np.exp(x)

    def log_probability(self, values: Sequence[float] | NDArray) -> float:
        """Return the logarithm of the probability density of parameter values, up to a constant, for samplers.

        Noise and priors are normal. Without a prior, values within their range are equally probable in their logarithm;
        outside they are impossible.
        """
        x = np.log(validation.numbers("values", values, len(self.ranges), above=0.0))
        low, high = self.bounds
        return (
            -0.5 * float((self.residual(x) ** 2).sum())
            if ((x >= low) & (x <= high)).all()
            else -np.inf
        )

    def least(
        self,
        x: NDArray,
        free: NDArray,
        tolerance: float = LEAST,
        most: int = MOST,
        rows: NDArray | slice = slice(None),
    ) -> NDArray:
        """Minimise the sum of squares of some rows from a point x over the free coordinates."""
        low, high = self.bounds

        def whole(part: NDArray) -> NDArray:
            out = x.copy()
            out[free] = part
            return out

        margin = 1e-6 * (high - low)[free]
        start = np.clip(x[free], low[free] + margin, high[free] - margin)
        solution = scipy.optimize.least_squares(
            lambda part: self.residual(whole(part))[rows], start, lambda part: self.jacobian(whole(part))[rows][:, free],
            (low[free], high[free]), xtol=1e-9, ftol=tolerance, gtol=1e-9, max_nfev=most, x_scale="jac",
        )  # fmt: skip
        return whole(solution.x)


def covariance(J: NDArray) -> NDArray:
    """Return the covariance (k, k) of parameters for residuals of unit variance.

    Combinations of parameters without effect have a very large variance; a pseudo-inverse would give zero.

    Parameters
    ----------
    J : (m, k) float
        Derivatives of the residuals.
    """
    _, s, ways = np.linalg.svd(np.pad(J, ((0, J.shape[1]), (0, 0))), full_matrices=False)
    inverse = ways.T / np.maximum(s, max(NO_EFFECT * s[0], NO_EFFECT))
    return np.asarray(inverse @ inverse.T)


def left_out(r: NDArray, J: NDArray, rows: Sequence[slice | NDArray]) -> NDArray:
    """Return the jackknife standard errors (k,) from the omission of each group of rows.

    Parameters
    ----------
    r : (m,) float
        Residuals.
    J : (m, k) float
        Derivatives of the residuals.
    rows : sequence of slice or array
        Rows of each group.
    """
    moved = np.array([np.linalg.pinv(J.T @ J - J[s].T @ J[s]) @ (J[s].T @ r[s]) for s in rows])
    return np.asarray(
        np.sqrt((1.0 - 1.0 / len(rows)) * ((moved - moved.mean(axis=0)) ** 2).sum(axis=0))
    )


@validation.check_arguments
@one_thread
def fit(
    problem: Asking | Problem | Callable[..., Asking],
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
        Study with the initial values, or a function that returns the study for parameters given as keywords. Default values
        of the function are the initial values; other parameters start at the middle of their range.
    data : MeasuredResponse, Measured, MeasuredMode, or a sequence of these
        Responses over frequency, resonances over load relative to the resonance without load, or frequency and damping of a
        mode over its amplitude.
    vary : mapping of name to (low, high)
        Positive ranges of the parameters. Names are settings of :mod:`bdamper.harmonic_balance.parameters`, such as
        "friction_coefficient", "friction_coefficient.left", "contact_stiffness_factor", "contact_stiffness_factor.normal",
        "damping_factor", "frequency_factor" or "gap_factor", or keywords of the function; and "force_factor", the gain of
        all forces.
    free : Measurement or MeasuredResponse, optional
        Response without damper. Damping, frequency and force gain are fitted to it first and then held constant; ``vary``
        may give their ranges.
    noise : float, optional
        Relative standard deviation of a measured amplitude, force or damping ratio, and standard deviation of a phase in
        radians. By default the scatter of the amplitudes of tests repeated under the same conditions, or 0.02 without
        repetitions.
    priors : mapping of str to pair of float, optional
        Mean and standard deviation of parameters that are known from other sources. A prior counts like a measurement.
    intervals : {"profile", "linear"}
        Profiles of the sum of squares, or its quadratic approximation by the covariance, which needs no further responses.

    Returns
    -------
    Fitted

    Raises
    ------
    SettingError
        If parameters or ranges are missing, if the data cannot distinguish the parameters, or if a test does not fit the
        model, for example a preload on a model without loads.
    BdamperError
        If no response can be computed at any measured point.
    """
    data = _tests(data)
    groups, scatter = repetitions(data)
    notes = (
        (f"noise {scatter:.3g}, the scatter of repeated tests",)
        if noise is None and scatter
        else ()
    )
    noise = validation.number(
        "noise", (scatter or NOISE) if noise is None else noise, above=0.0, below=1.0
    )
    own = problem if callable(problem) else problem_of(problem)
    profiles = validation.choice("intervals", intervals, ("profile", "linear")) == "profile"
    ranges, known = _checked(own, vary, priors or {})
    first = None
    validation.check(
        free is None or not callable(own), "free", "none for a function of all parameters", "one"
    )
    if free is not None:
        unladen = free if isinstance(free, MeasuredResponse) else MeasuredResponse(free, 0.0)
        unloaded = {name: ranges.pop(name, ends) for name, ends in UNLOADED.items()}
        first = _stage(Objective(own, [unladen], unloaded, noise, {}, profiles, known))
    validation.check(
        ranges, "vary", "parameters that the free response does not determine", list(vary)
    )
    stiff = [name for name in ranges if name.startswith("contact_stiffness")]
    if (
        not callable(own)
        and "frequency_factor" in ranges
        and stiff
        and not any(isinstance(t, MeasuredResponse) and t.preload == 0.0 for t in data)
    ):
        raise SettingError(
            f"vary: frequency_factor and {stiff[0]} need a test without load (free=), found none: a stiffer contact and a "
            "stiffer structure have the same resonances"
        )
    last = _stage(Objective(own, data, ranges, noise, {}, profiles, known), first, groups)[0]
    last = replace(last, notes=(*notes, *last.notes))
    return last if first is None else _joined(first[0], last)


def _checked(
    own: Problem | Callable[..., Asking],
    vary: Mapping[str, tuple[float, float]],
    priors: Mapping[str, tuple[float, float]],
) -> tuple[dict[str, tuple[float, float]], dict[str, tuple[float, float]]]:
    """Return the ranges of the parameters and their priors."""
    names = (*(inspect.signature(own).parameters if callable(own) else setting_names(own)), FORCE)
    ranges = {}
    for name, ends in validation.mapping("vary", vary, names, "parameters").items():
        ranges[name] = validation.interval(f"range of {name}", ends, "the unit of the parameter")
    known = {}
    for name, pair in validation.mapping("priors", priors, ranges, "parameters of vary").items():
        mean, deviation = validation.numbers(f"prior of {name}", pair, 2, above=0.0)
        known[name] = float(mean), float(deviation)
    return ranges, known


def _tests(data: Any) -> list[MeasuredResponse | Measured | MeasuredMode]:
    """Return one test or several as a list of tests."""
    kinds = MeasuredResponse, Measured, MeasuredMode
    found = (
        [data]
        if isinstance(data, kinds)
        else validation.instance("data", data, Iterable, "tests, as MeasuredResponse")
    )
    tests = [validation.instance("data", each, kinds) for each in found]
    validation.check(tests, "data", "one test or more", "none")
    return tests


def repetitions(
    data: Sequence[MeasuredResponse | Measured | MeasuredMode],
) -> tuple[list[int], float]:
    """Return for each test the index of the first test under the same conditions, and the scatter of repeated tests.

    The scatter is the standard deviation of the logarithm of amplitude over force, 0 without repetitions. Tests measured
    at other frequencies are interpolated.
    """
    groups, squares = list(range(len(data))), []
    tests = [
        (i, t)
        for i, t in enumerate(data)
        if isinstance(t, MeasuredResponse) and t.control == "force"
    ]
    for k, (i, one) in enumerate(tests):
        for j, other in tests[:k]:
            conditions = [(t.preload, t.sweep, t.nominal is None) for t in (one, other)]
            alike = abs((one.nominal or 1.0) / (other.nominal or 1.0) - 1.0) < ALIKE_FORCE
            if conditions[0] == conditions[1] and alike:
                (f, size), (g, known) = (_logarithms(one), _logarithms(other))
                common = (f >= g[0]) & (f <= g[-1])
                if not common.any():  # parts of one test
                    continue
                groups[i] = min(groups[i], groups[j])
                squares.append((size - np.interp(f, g, known))[common] ** 2 / 2.0)
    return groups, float(np.sqrt(np.concatenate(squares or [np.zeros(1)]).mean()))


def _logarithms(test: MeasuredResponse) -> tuple[NDArray, NDArray]:
    """Return frequencies in ascending order and logarithms of amplitude over force."""
    order = np.argsort(test.data.frequency)
    ratio = np.abs(test.data.displacement) / test.factors / (test.nominal or 1.0)
    return test.data.frequency[order], np.log(ratio)[order]


def _stage(
    objective: Objective,
    before: tuple[Fitted, NDArray] | None = None,
    groups: Sequence[int] | None = None,
) -> tuple[Fitted, NDArray]:
    """Fit one stage with the parameters of the previous stage held constant; return the result and its covariance.

    ``groups`` has the same number for tests that are left out together; by default each test is left out alone.
    """
    if before is not None:
        objective.held = dict(zip(before[0].names, before[0].values.tolist()))
    names, (low, high) = tuple(objective.ranges), objective.bounds
    x = objective.least(objective.start, np.ones(len(names), bool))
    parts = objective.parts(x)
    labels = tuple(
        str(each) if isinstance(each, MeasuredResponse) else each.source or "resonances"
        for each in objective.data
    )
    if all(part.lost.all() for part in parts):
        raise BdamperError(
            f"fit: no response could be computed at the measured points, first of {labels[0]} "
            f"({parts[0].reason or 'no solution on the swept branch'}); check preloads, forces and frequencies"
        )
    sizes = np.cumsum([0, *(part.residual.size for part in parts)])
    rows = [slice(a, b) for a, b in zip(sizes, sizes[1:])]
    group = np.repeat(groups or np.arange(len(parts)), np.diff(sizes))
    prediction, other = _predictions(objective, x, group)
    if other is not None:
        x = objective.least(other, np.ones(len(names), bool))
        parts, (prediction, _) = objective.parts(x), _predictions(objective, x, group)
    half, C, left = _uncertainty(
        objective, x, [np.flatnonzero(group == each) for each in np.unique(group)], before
    )
    J = objective.jacobian(x)
    information = np.array([(J[s] ** 2).sum(axis=0) for s in rows]).T
    ends = np.clip([x - half[0], x + half[1]], low, high)
    unknown = (ends[0] <= low + EDGE) & (ends[1] >= high - EDGE)
    _, singular, ways = np.linalg.svd(J, full_matrices=False)
    deviation = np.sqrt(np.diag(C))
    related = np.abs(C) / np.outer(deviation, deviation)
    pairs = [f"{spaced(names[i])} and {spaced(names[j])} ({C[i, j] / deviation[i] / deviation[j]:+.3f})"
             for i, j in zip(*np.nonzero(np.triu(related > CORRELATED, 1)))]  # fmt: skip
    notes = (f"correlated: {', '.join(pairs)}",) if pairs and not unknown.any() else ()
    doubts = [f"{spaced(name)} {UNKNOWN}" for name, whole in zip(names, unknown) if whole]
    if singular[-1] * ALIKE < singular[0] and not unknown.any():
        parts_of = " ".join(
            f"{c:+.2f} ln {name}" for c, name in zip(ways[-1], names) if abs(c) > 0.1
        )
        doubts.append(f"the data do not determine {parts_of}")
    at_end = (np.minimum(x - low, high - x) < 1e-3 * (high - low)) & ~unknown
    doubts += [
        f"{spaced(name)} is at an end of its range"
        for name, is_at_end in zip(names, at_end)
        if is_at_end
    ]
    doubts += _far_priors(objective, x)
    for label, part in zip(labels, parts):
        if lost := int(part.lost.sum()):
            why = f" ({part.reason})" if part.reason else ""
            counted = f"each counted as {LOST:g} times the noise"
            doubts.append(f"no response was found at {lost} points of {label}{why}, {counted}")
    of_points: dict[str, Any] = {
        name: np.concatenate([getattr(part, name) for part in parts])
        for name in ("place", "measured", "model", "residual")
    }
    own = (
        objective.made(dict(zip(names, np.exp(x))))
        if callable(objective.problem)
        else problem_of(objective.problem)
    )
    result = Fitted(
        names=names, values=np.exp(x), low=np.exp(ends[0]), high=np.exp(ends[1]),
        deviation=np.where(unknown, np.inf, deviation), left_out=left,
        information=information / np.maximum((J**2).sum(axis=0)[:, None], 1e-300), tests=labels, prediction=prediction,
        notes=notes, noise=objective.noise,
        test=np.repeat(np.arange(len(parts)), [len(part.place) for part in parts]), **of_points,
        **own.recorded(),
    )  # fmt: skip
    return _with_status(result, doubts), C


def _far_priors(objective: Objective, x: NDArray) -> list[str]:
    """Return a statement for each prior that the data contradict.

    Without its prior, a parameter has a value and a deviation from the other rows. The distance of the prior from that
    value, in standard deviations of the difference, is the residual of the prior divided by the root of one minus its
    leverage; the formula of Sherman and Morrison avoids the difference of nearly equal numbers.
    """
    r, J, names = objective.residual(x), objective.jacobian(x), list(objective.ranges)
    widths = np.ptp(objective.bounds, axis=0)
    first = len(r) - len(objective.priors)
    out = []
    for row, (name, (mean, deviation)) in enumerate(objective.priors.items(), first):
        C = covariance(np.delete(J, row, axis=0))
        j = names.index(name)
        # the prior is the only information on such a parameter
        if np.sqrt(C[j, j]) > widths[j]:
            continue
        distance = abs(r[row]) * np.sqrt(1.0 + J[row] @ C @ J[row])
        if distance > CONTRADICTED:
            of = f"the prior of {spaced(name)} ({mean:g} with {deviation:g})"
            out.append(f"{of} is {distance:.2g} standard deviations from the data: examine both")
    return out


def _predictions(
    objective: Objective, x: NDArray, group: NDArray
) -> tuple[NDArray, NDArray | None]:
    """Return the residuals (n, 2) of each point in a fit without the tests of its group; NaN if there is only one group.

    ``group`` (m,) is the group of each row of the residual, without those of the priors.  If ``x`` is a local minimum, one
    of these fits may have a lower sum of squares over all data; its parameters (k,) are returned as well, otherwise None.
    """
    out, best = np.full(len(group), np.nan), None
    r, J = objective.residual(x), objective.jacobian(x)
    least = LOWER * float(r @ r)
    for each in np.unique(group) if len(np.unique(group)) > 1 else ():
        omitted = np.flatnonzero(group == each)
        kept = np.setdiff1d(np.arange(len(r)), omitted)
        step = -covariance(J[kept]) @ (J[kept].T @ r[kept])
        start = np.clip(x + np.clip(step, -1.0, 1.0), *objective.bounds)
        at = objective.least(start, np.ones(len(x), bool), LEAST, PREDICTIONS, kept)
        found = objective.residual(at)
        out[omitted] = found[omitted]
        if found @ found < least:
            least, best = float(found @ found), at
    return out.reshape(-1, 2), best


def _uncertainty(
    objective: Objective, x: NDArray, rows: Sequence[NDArray], before: tuple[Fitted, NDArray] | None
) -> tuple[NDArray, NDArray, NDArray]:
    """Return half widths (2, k) of the intervals, covariance (k, k), and jackknife standard deviations (k,) over groups."""
    r, J = objective.residual(x), objective.jacobian(x)
    k, n = len(x), len(rows)
    spare = max(int(np.count_nonzero(r)) - k, 1)
    scale = max(1.0, float(r @ r) / spare)
    quantile = float(scipy.stats.t.ppf(P95, spare))
    excess = max(float(r @ r) - float(scipy.stats.chi2.ppf(P95, spare)), 0.0)
    rise = max(scale * quantile**2, TAKEN_UP * excess)
    C = scale * covariance(J)
    linear = np.sqrt(rise / scale * np.diag(C))
    half = np.array([linear, linear])
    if objective.profiles:
        half = np.array([_profile(objective, x, j, rise, linear[j]) for j in range(k)]).T
    left = left_out(r, J, rows) if n > 1 else np.full(k, np.nan)
    if n > 1 and excess > 0.0:  # otherwise noise explains the differences between tests
        half = np.fmax(half, float(scipy.stats.t.ppf(P95, n - 1)) * left)
    if before is not None:  # errors of the held parameters propagate to the others
        held, held_covariance = before
        ranges = UNLOADED | dict(objective.ranges)
        joint = Objective(
            objective.problem, objective.data, ranges, objective.noise, priors=objective.priors
        )
        K = joint.jacobian(np.append(np.log(held.values), x))[:, : len(held.values)]
        move = covariance(J) @ J.T @ K
        carried = move @ held_covariance @ move.T
        C, half = C + carried, np.hypot(half, quantile * np.sqrt(np.diag(carried)))
    return half, C, left


def _profile(objective: Objective, x: NDArray, j: int, rise: float, half: float) -> NDArray:
    """Return the distances (2,) below and above ``x[j]`` at which the profiled sum of squares has risen by ``rise``."""
    least = float((objective.residual(x) ** 2).sum())
    free = np.arange(len(x)) != j
    J, (low, high) = objective.jacobian(x), objective.bounds
    others = -np.linalg.lstsq(J[:, free], J[:, j], rcond=None)[0] if free.any() else np.zeros(0)
    ends = np.array([x[j] - low[j], high[j] - x[j]])
    for side, sense in enumerate((-1.0, 1.0)):
        limit, reach = ends[side], min(half, ends[side])
        inner, outer = (
            (0.0, -1.0),
            None,
        )  # distance, and relative excess of the square root of the rise
        for _ in range(SEARCH):
            at = x.copy()
            at[j] += sense * reach
            at[free] += sense * reach * others
            at = np.clip(at, low, high)

            def gap_at(at: NDArray) -> float:
                more = float((objective.residual(at) ** 2).sum()) - least
                return min(np.sqrt(max(more, 0.0) / rise) - 1.0, 1.0)

            gap = gap_at(at)
            if free.any() and abs(gap) >= NEARLY:
                gap = gap_at(objective.least(at, free, ROUGH))
            if abs(gap) < NEARLY or (gap < 0.0 and reach >= limit):
                break
            inner, outer = ((reach, gap), outer) if gap < 0.0 else (inner, (reach, gap))
            if outer is None:
                reach = min(limit, reach / max(1.0 + gap, 0.2))
            else:
                reach = inner[0] + (outer[0] - inner[0]) * inner[1] / (inner[1] - outer[1])
        ends[side] = reach
    return ends


def _with_status(found: Fitted, doubts: Sequence[str]) -> Fitted:
    doubts = [each for each in (found.wrong, *doubts) if each]
    return replace(found, status=with_reason(INCOMPLETE, "; ".join(doubts)) if doubts else COMPLETE)


def _joined(first: Fitted, last: Fitted) -> Fitted:
    """Join parameters and tests of the results of two stages."""
    information = scipy.linalg.block_diag(first.information, last.information)
    arrays = (
        "values",
        "low",
        "high",
        "deviation",
        "left_out",
        "place",
        "measured",
        "model",
        "residual",
        "prediction",
    )
    whole: dict[str, Any] = {
        name: np.concatenate([getattr(first, name), getattr(last, name)]) for name in arrays
    }
    joined = replace(
        last, names=first.names + last.names, tests=first.tests + last.tests,
        **whole, information=information, notes=first.notes + last.notes,
        test=np.append(first.test, last.test + len(first.tests)),
    )  # fmt: skip
    return _with_status(joined, (first.doubts, last.doubts))
