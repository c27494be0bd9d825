"""Parameters identified from measured responses, with intervals, misfits, and predictions.

A misfit is the root mean square of residuals in units of the noise; it is close to 1 if the model
is correct. The misfit of a test in a fit without this test measures the error of a prediction. The
identified parameters belong to the settings of their fit, and :meth:`Fitted.apply` refuses others.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from bdamper.analyses.response_residuals import FORCE
from bdamper.harmonic_balance.checks import check_result
from bdamper.harmonic_balance.parameters import present_name, vary
from bdamper.harmonic_balance.study_boundary import A, problem_of
from bdamper.util import validation
from bdamper.util.display import Plottable, Result
from bdamper.util.errors import COMPLETE
from bdamper.util.formatting import listed, percent, sentence, short_repr, spaced
from bdamper.util.records import Reason
from bdamper.util.statement import Row, Statement
from bdamper.util.storage import Recorded, Storable
from bdamper.util.tables import Column, Tabular

WRONG = 30.0
"""Misfit of a test in units of the noise above which the model does not describe the data."""
EXCEEDS_NOISE = 1.5
"""Misfit of all tests in units of the noise above which the model misses them."""
UNKNOWN = "not determined by these data"
"""Text of a parameter whose interval is its complete range."""


@short_repr
@dataclass(frozen=True)
class Fitted(Result, Plottable, Tabular, Recorded, Storable, kind="bdamper-fit", row="point"):
    """Parameters identified from measured responses.

    They are valid for the settings of the fit only.

    ``plot`` draws measured and computed responses with the residuals
    (:func:`bdamper.plot.plot_fit`). :func:`bdamper.plot.plot_information` draws the contribution of
    each test.

    Parameters
    ----------
    names : tuple of str
    values, low, high : (k,) float
        Estimates and their intervals within the ranges: 95 % intervals, or wider ones if the model
        error exceeds the noise.
    deviation, left_out : (k,) float
        Relative standard deviations. ``deviation`` follows from the covariance, scaled by the
        misfit if it exceeds 1; infinite if the data do not determine the parameter. ``left_out``
        follows from the omission of tests; NaN for fewer than two tests.
    information : (k, n_tests) float
        Contribution of each test to the information about each parameter. The prior of the
        parameter provides the rest.
    tests : tuple of str
    noise : float
        Relative standard deviation of the measured amplitudes.
    place : (n,) float, Hz
        Frequencies of the points.
    measured, model : (n,) complex, m
        Measured and computed responses. For resonances at several loads, the measured amplitude is
        scaled by the ratio of the computed to the measured amplitude without load. For modes and
        controlled responses, the computed response is the measured one times measured over computed
        damping ratio or force.
    residual : (n, 2) float
        Residuals in units of the noise.
    test : (n,) int
        Index of the test of each point.
    prediction : (n, 2) float
        Residuals of each point in a fit without its test and the repetitions of this test; NaN if
        no test remains.
    status : str
        "complete", or "incomplete: ..." with the reasons for doubt.
    notes : tuple of str
    settings, model_hash
        Settings and model of the study before the fit.
    """

    names: tuple[str, ...]
    values: NDArray
    low: NDArray
    high: NDArray
    deviation: NDArray
    left_out: NDArray
    information: NDArray
    tests: tuple[str, ...]
    noise: float
    place: NDArray
    measured: NDArray
    model: NDArray
    residual: NDArray
    test: NDArray
    prediction: NDArray = field(default_factory=lambda: np.empty((0, 2)))
    status: str = COMPLETE
    reason: Reason = ""
    notes: tuple[str, ...] = ()
    _summary_fields = ("status", "notes")

    def check_rows(self) -> None:
        """Raise ValueError unless all fields belong to the same points, parameters and tests."""
        super().check_rows()
        n = len(self.place)
        k = len(self.names)
        expected: dict[str, tuple[int, ...]] = {}
        for name in ("place", "measured", "model", "test"):
            expected[name] = (n,)
        for name in ("values", "low", "high", "deviation", "left_out"):
            expected[name] = (k,)
        expected["residual"] = (n, 2)
        expected["information"] = (k, len(self.tests))
        # fits of older versions have none
        if len(self.prediction):
            expected["prediction"] = (n, 2)
        for name, shape in expected.items():
            actual = np.shape(getattr(self, name))
            if actual != shape:
                raise ValueError(f"'{name}' needs the shape {shape}, but has the shape {actual}")

    def with_present_names(self) -> Self:
        """Return a result of an earlier version with the present names of settings."""
        return replace(self, names=tuple(map(present_name, self.names)))

    @property
    def misfits(self) -> NDArray:
        """Root mean square of the residuals of each test (n_tests,), in units of the noise."""
        return self._by_test(self.residual)

    @property
    def predictions(self) -> NDArray:
        """Root mean square of the residuals of each test (n_tests,) in a fit without it.

        It is in units of the noise; NaN if it is not known.
        """
        if not len(self.prediction):
            return self._by_test(np.full_like(self.residual, np.nan))
        return self._by_test(self.prediction)

    def _by_test(self, residual: NDArray) -> NDArray:
        """Return the root mean square of the residuals (n, 2) of each test."""
        # bincount adds the values of the points of each test
        n_tests = len(self.tests)
        squares = (residual**2).sum(axis=1)
        sums = np.bincount(self.test, weights=squares, minlength=n_tests)
        # absent phases have a residual of zero and do not count
        n_residuals = np.count_nonzero(residual, axis=1)
        counts = np.bincount(self.test, weights=n_residuals, minlength=n_tests)
        return np.sqrt(sums / np.maximum(counts, 1))

    @property
    def misfit(self) -> float:
        """Root mean square of all residuals, in units of the noise."""
        # absent phases have a residual of zero and do not count
        count = max(np.count_nonzero(self.residual), 1)
        return float(np.sqrt((self.residual**2).sum() / count))

    def __getitem__(self, name: str) -> float:
        """Return the estimate of a parameter."""
        validation.choice("parameter", name, self.names)
        return float(self.values[self.names.index(name)])

    def apply(self, study: A | Callable[..., A]) -> A:
        """Return a study with the identified parameters, without the force gain of the rig.

        Parameters
        ----------
        study : Study or callable
            Study or function of the fit.

        Raises
        ------
        SettingError
            If the study has a different model or different settings. Contact parameters compensate
            for omitted modes, contact points and harmonics, and are wrong with different settings.
        """
        # the gain belongs to the rig
        settings = {
            name: float(value) for name, value in zip(self.names, self.values) if name != FORCE
        }
        if callable(study):
            return study(**settings)
        fitted_with = f"study for constants that were fitted with {self._settings_text()}"
        check_result(problem_of(study), self, fitted_with)
        return vary(study, settings)

    def widen(self, richer: Fitted) -> Fitted:
        """Widen the intervals by the distance to a fit with more detailed settings.

        The interval from a single model does not account for a systematic error of that model, which
        is the same under all loads.

        Parameters
        ----------
        richer : Fitted
            Fit of the same parameters to the same data with more harmonics, modes or contact
            points.

        Returns
        -------
        Fitted
        """
        validation.check(
            richer.names == self.names, "richer", f"a fit of {self.names}", f"one of {richer.names}"
        )
        # factor between the estimates of both fits, at least 1
        factor = np.exp(np.abs(np.log(richer.values / self.values)))
        return replace(
            self,
            low=np.minimum(self.low / factor, richer.low),
            high=np.maximum(self.high * factor, richer.high),
            notes=(*self.notes, f"intervals include a fit with {richer._settings_text()}"),
        )

    def _settings_text(self) -> str:
        """Return the settings of the fit that determine its parameters."""
        numbers = self.settings["harmonics"]
        plural = "s" if len(numbers) > 1 else ""
        only_first = list(numbers) == [1]
        harmonics = "1 harmonic" if only_first else f"harmonic{plural} {listed(map(str, numbers))}"
        modes = f"{self.settings['blade_modes']} blade modes"
        # the setting is None if all points of the model are in use
        points = f"{self.settings['contact_points'] or 'all'} contact points"
        method = self.settings["contact_stiffness"]
        # options and values of a method are too long for a sentence
        stiffness = "the contact stiffness of this fit"
        if isinstance(method, str):
            stiffness = f'contact_stiffness="{method}"'
        return listed([harmonics, modes, points, stiffness])

    def columns(self) -> dict[str, Column]:
        """Return one row for each measured point."""
        # the second column belongs to the phase, or to the frequency of a resonance
        residual_of_amplitude = self.residual[:, 0]
        return {
            "test": Column(self.test),
            "place": Column(self.place),
            "measured": Column(np.abs(self.measured)),
            "model": Column(np.abs(self.model)),
            "residual": Column(residual_of_amplitude),
        }

    @property
    def wrong(self) -> str:
        """Message with the largest misfit of a test, if the model does not describe that test.

        It includes a hint if the units may be wrong.  It is empty if the model describes all tests.
        """
        misfits = self.misfits
        worst = int(np.argmax(misfits))
        if not misfits[worst] > WRONG:
            return ""
        ratios = np.abs(self.measured / self.model)
        ratio_of_worst = float(np.nanmedian(ratios[self.test == worst]))
        # m, mm and um differ by powers of 1000
        power_of_1000 = 0.0
        if np.isfinite(ratio_of_worst):
            power_of_1000 = np.rint(np.log10(ratio_of_worst) / 3.0)
        hint = ""
        if power_of_1000:
            factor = f"{1e3**power_of_1000:g} times those of the model"
            hint = f"; measured amplitudes are about {factor}: check the units"
        misfit = f"misfit {misfits[worst]:.2g} times the noise"
        return f"the model does not describe these data ({misfit}{hint})"

    @property
    def doubts(self) -> str:
        """Reasons why the fit is incomplete, without :attr:`wrong`; empty for a complete fit."""
        return self.reason.removeprefix(self.wrong).removeprefix("; ")

    def _statement(self) -> Statement:
        model_is_wrong = self.misfit > EXCEEDS_NOISE
        misfits = self.misfits
        worst = int(np.argmax(misfits))
        size = f"{self.misfit:.2g} times the noise"
        if self.wrong:
            verdict = f"Not for design: {self.wrong}"
        elif model_is_wrong:
            verdict = f"Not for design: the model deviates from the tests by {size}"
        elif self.doubts:
            verdict = f"Incomplete fit: {self.doubts}; misfit {size}"
        else:
            verdict = f"Fitted with a misfit of {size}"
        finding = (
            f"{size} of {percent(self.noise)}, fails above {EXCEEDS_NOISE:g}; largest in test "
            f"'{self.tests[worst]}' ({misfits[worst]:.2g})"
        )
        checks = [Row("Misfit", "FAIL" if model_is_wrong else "pass", finding)]
        if np.isfinite(self.predictions).any():
            checks.append(Row("Prediction", "run", self._prediction_text()))
        remarks = [sentence(note) for note in self.notes if note.startswith("correlated")]
        if model_is_wrong:
            remarks.append(
                "Remedy: fit again with a finer model; the intervals above may be too narrow "
                "(fitted.widen(finer_fit) widens them)"
            )
            remarks.append(f"Fitted with {self._settings_text()}")
        else:
            remarks.append(f"Use these values only with {self._settings_text()}")
        if self.doubts and model_is_wrong:
            remarks.append(f"The fit is incomplete: {self.doubts}")
        return Statement([verdict], self._estimate_rows(), checks, remarks)

    def _estimate_rows(self) -> list[Row]:
        """Return the parameters with their intervals of 95 %."""
        rows = []
        for i, name in enumerate(self.names):
            value = f"{self.values[i]:.3g}" if np.isfinite(self.deviation[i]) else UNKNOWN
            interval = f"{self.low[i]:.3g} to {self.high[i]:.3g}"
            rows.append(Row(sentence(spaced(name)), value, f"95 % confidence interval: {interval}"))
        return rows

    def _prediction_text(self) -> str:
        """Return the errors of the predictions of tests."""
        errors = self.predictions
        worst = int(np.nanargmax(errors))
        return (
            f"a fit without one test predicts this test with an error of {np.nanmin(errors):.2g} "
            f"to {errors[worst]:.2g} times the noise (largest: "
            f"{percent(errors[worst] * self.noise)} for '{self.tests[worst]}')"
        )
