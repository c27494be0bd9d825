"""Parameters identified from measured responses: estimates with intervals, misfits, and predictions.

A misfit is the root mean square of residuals in units of the noise: near 1 if the model is right. The misfit of a test in a
fit without this test measures the error of a prediction. The identified parameters belong to the settings of their fit, and
:meth:`Fitted.apply` refuses others.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from bdamper.analyses.response_residuals import FORCE
from bdamper.harmonic_balance.checks import A, check_result, problem_of
from bdamper.harmonic_balance.parameters import present_name, vary
from bdamper.util import validation
from bdamper.util.display import Plottable
from bdamper.util.errors import COMPLETE
from bdamper.util.formatting import percent, short_repr, spaced
from bdamper.util.storage import Recorded, Storable
from bdamper.util.tables import Column, Tabular

WRONG = 30.0
"""Misfit of a test in units of the noise above which the model does not describe the data."""
UNKNOWN = "not determined by these data"
"""Text of a parameter whose interval is its complete range."""


@short_repr
@dataclass(frozen=True)
class Fitted(Plottable, Tabular, Recorded, Storable, kind="bdamper-fit", row="point"):
    """Parameters identified from measured responses; they are valid for the settings of the fit only.

    ``plot`` draws measured and computed responses with the residuals (:func:`bdamper.plot.plot_fit`).
    :func:`bdamper.plot.plot_information` draws the contribution of each test.

    Parameters
    ----------
    names : tuple of str
    values, low, high : (k,) float
        Estimates and their intervals within the ranges: 95 % intervals, or wider ones if the model error exceeds the noise.
    deviation, left_out : (k,) float
        Relative standard deviations. ``deviation`` follows from the covariance, scaled by the misfit if it exceeds 1;
        infinite if the data do not determine the parameter. ``left_out`` follows from the omission of tests; NaN for fewer
        than two tests.
    information : (k, n_tests) float
        Share of each test in the information about each parameter. The prior of the parameter has the rest.
    tests : tuple of str
    noise : float
        Relative standard deviation of the measured amplitudes.
    place : (n,) float, Hz
        Frequencies of the points.
    measured, model : (n,) complex, m
        Measured and computed responses. For resonances over load, the measured amplitude is scaled by the ratio of the
        computed to the measured amplitude without load. For modes and controlled responses, the computed response is the
        measured one times measured over computed damping ratio or force.
    residual : (n, 2) float
        Residuals in units of the noise.
    test : (n,) int
        Index of the test of each point.
    prediction : (n, 2) float
        Residuals of each point in a fit without its test and the repetitions of this test; NaN if no test remains.
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
    notes: tuple[str, ...] = ()
    _summary_fields = ("status", "notes")

    def check_rows(self) -> None:
        """Raise ValueError unless all fields belong to the same points, parameters and tests."""
        super().check_rows()
        n, k, n_tests = len(self.place), len(self.names), len(self.tests)
        expected: dict[str, tuple[int, ...]] = dict.fromkeys(
            ("place", "measured", "model", "test"), (n,)
        )
        expected |= dict.fromkeys(("values", "low", "high", "deviation", "left_out"), (k,))
        expected |= {"residual": (n, 2), "information": (k, n_tests)}
        # fits of older versions have none
        if len(self.prediction):
            expected["prediction"] = (n, 2)
        for name, shape in expected.items():
            found = np.shape(getattr(self, name))
            if found != shape:
                raise ValueError(f"'{name}' has the shape {found}, not {shape}")

    def with_present_names(self) -> Self:
        """Return a result of version 3 of the format with the present names of settings."""
        return replace(self, names=tuple(map(present_name, self.names)))

    @property
    def misfits(self) -> NDArray:
        """Root mean square of the residuals of each test (n_tests,), in units of the noise."""
        return self._by_test(self.residual)

    @property
    def predictions(self) -> NDArray:
        """Root mean square of the residuals of each test (n_tests,) in a fit without it, in units of the noise; or NaN."""
        return self._by_test(
            self.prediction if len(self.prediction) else np.full_like(self.residual, np.nan)
        )

    def _by_test(self, residual: NDArray) -> NDArray:
        n = len(self.tests)
        sums = np.bincount(self.test, (residual**2).sum(axis=1), n)
        return np.sqrt(
            sums / np.maximum(np.bincount(self.test, np.count_nonzero(residual, axis=1), n), 1)
        )

    @property
    def misfit(self) -> float:
        """Root mean square of all residuals, in units of the noise."""
        return float(np.sqrt((self.residual**2).sum() / max(np.count_nonzero(self.residual), 1)))

    def __getitem__(self, name: str) -> float:
        """Return the estimate of a parameter."""
        return float(
            self.values[self.names.index(validation.choice("parameter", name, self.names))]
        )

    def apply(self, study: A | Callable[..., A]) -> A:
        """Return a study with the identified parameters, without the force gain of the rig.

        Parameters
        ----------
        study : Study or callable
            Study or function of the fit.

        Raises
        ------
        SettingError
            If the study has another model or other settings than the fit. Contact parameters compensate for
            omitted modes, contact points and harmonics, and are wrong with other settings.
        """
        if callable(study):
            return study(
                **{name: float(v) for name, v in zip(self.names, self.values) if name != FORCE}
            )
        check_result(problem_of(study), self, f"study (the constants belong to {self._belong()})")
        return vary(
            study, {name: float(v) for name, v in zip(self.names, self.values) if name != FORCE}
        )

    def widen(self, richer: Fitted) -> Fitted:
        """Widen the intervals by the distance to a fit with more detailed settings.

        An interval of one model does not show an error that this model makes under all loads.

        Parameters
        ----------
        richer : Fitted
            Fit of the same parameters to the same data with more harmonics, modes or contact points.

        Returns
        -------
        Fitted
        """
        validation.check(
            richer.names == self.names, "richer", f"a fit of {self.names}", f"one of {richer.names}"
        )
        away = np.exp(np.abs(np.log(richer.values / self.values)))
        low, high = (
            np.minimum(self.low / away, richer.low),
            np.maximum(self.high * away, richer.high),
        )
        return replace(
            self,
            low=low,
            high=high,
            notes=(*self.notes, f"intervals reach a fit with {richer._belong()}"),
        )

    def _belong(self) -> str:
        s = self.settings
        texts = {
            "harmonics": " ".join(map(str, s["harmonics"])),
            "blade modes": s["blade_modes"],
            "contact points": s["contact_points"] or "all of the model",
            "contact stiffness": s["contact_stiffness"]
            if isinstance(s["contact_stiffness"], str)
            else "given",
        }
        return ", ".join(f"{name} {value}" for name, value in texts.items())

    def columns(self) -> dict[str, Column]:
        """Return one row for each measured point."""
        arrays = {
            "test": self.test,
            "place": self.place,
            "measured": np.abs(self.measured),
            "model": np.abs(self.model),
        }
        return {name: Column(v) for name, v in arrays.items()} | {
            "residual": Column(self.residual[:, 0])
        }

    @property
    def wrong(self) -> str:
        """Statement that the model does not describe the test of largest misfit, with a hint at wrong units; or empty."""
        worst = int(np.argmax(self.misfits))
        if not self.misfits[worst] > WRONG:
            return ""
        ratio = float(np.nanmedian(np.abs(self.measured / self.model)[self.test == worst]))
        power = (
            np.rint(np.log10(ratio) / 3.0) if np.isfinite(ratio) else 0.0
        )  # of 1000, between m, mm and um
        factor = f"{1e3**power:g} times those of the model"
        hint = f"; measured amplitudes are about {factor}: check the units" if power else ""
        return f"the model does not describe these data (misfit {self.misfits[worst]:.2g} times the noise{hint})"

    @property
    def doubts(self) -> str:
        """Reasons why the fit is incomplete, without the statement of :attr:`wrong`; empty for a complete fit."""
        return self.status.partition(": ")[2].removeprefix(self.wrong).removeprefix("; ")

    def _headline(self) -> str:
        rows = zip(self.names, self.values, self.low, self.high, self.deviation)
        estimates = "; ".join(
            f"{spaced(name)} {f'{v:.3g}' if np.isfinite(d) else UNKNOWN} ({a:.3g} to {b:.3g})"
            for name, v, a, b, d in rows
        )
        worst = int(np.argmax(self.misfits))
        out = [f"{self.wrong[:1].upper()}{self.wrong[1:]}."] if self.wrong else []
        wrong = ": the model is wrong by more than the noise" if self.misfit > 1.5 else ""
        most = f"most in {self.tests[worst]} ({self.misfits[worst]:.2g})"
        constants = f"{estimates[:1].upper()}{estimates[1:]}, with intervals for 95 %."
        misfit = f"Misfit {self.misfit:.2g} times the noise{wrong}, {most}."
        out += [misfit, constants] if wrong else [constants, misfit]
        if np.isfinite(left := self.predictions).any():
            last = int(np.nanargmax(left))
            far = f"{left[last]:.2g} times the noise ({percent(left[last] * self.noise)}) in {self.tests[last]}"
            out.append(
                f"Tests left out of the fit are predicted within {np.nanmin(left):.2g} to {far}."
            )
        out += [
            f"{note[:1].upper()}{note[1:]}." for note in self.notes if note.startswith("correlated")
        ]
        if wrong:
            out.append(
                "True constants may lie outside of the intervals: compare a fit with richer settings (widen)."
            )
        out.append(f"The constants belong to {self._belong()}, and to no other settings.")
        if self.doubts:
            out.append(f"The fit is incomplete: {self.doubts}.")
        return " ".join(out)
