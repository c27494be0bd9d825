r"""Allowable stress amplitudes as reported by laboratories: a table of mean stress, temperature and
survival probability.

Each row is the allowable amplitude of a test series at a mean stress, or at a stress ratio :math:`R
= \sigma_{min}/\sigma_{max}`, which corresponds to the mean stress

.. math:: \sigma_m = \sigma_a \frac{1 + R}{1 - R}.

Between the rows the amplitude is interpolated: linearly over the mean stress, linearly over the
temperature at the same mean stress, and linearly over the quantile of the normal distribution of
the survival probability, between rows of the same mean stress or stress ratio. Below the lowest
mean stress the amplitude is constant, and above the highest one a straight line ends at the
ultimate strength. A temperature or probability outside the table is an error.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtri

from bdamper.importers.measurements import read_columns
from bdamper.util import validation
from bdamper.util.errors import quiet, warn_implausible
from bdamper.util.storage import FilePath

STRESSES = {"MPa": 1e6, "Pa": 1.0, "GPa": 1e9, "N/mm2": 1e6, "N/mm^2": 1e6, "ksi": 6.894757293168e6}
"""Units of stress in pascal."""
DEGREES = {"C": 1.0, "°C": 1.0, "degC": 1.0, "K": 1.0}
"""Units of temperature; kelvin are shifted after they are read."""
UNITLESS = {"": 1.0, "1": 1.0, "-": 1.0}
UNITS = {
    "amplitude": STRESSES,
    "mean": STRESSES,
    "r": UNITLESS,
    "temperature": DEGREES,
    "probability": {"%": 0.01, **UNITLESS},
}
"""Units of the columns of a file."""
ICE = 273.15
ROOM, MEDIAN = 20.0, 0.5
"""Temperature (°C) and survival probability of a table without their columns."""
NOTABLE_RISE = 0.01
"""Relative rise of an allowable amplitude that scatter and rounding of a table do not explain."""


def _numbers(name: str, values: object) -> tuple[float, ...]:
    return tuple(validation.numbers(name, values).tolist())


ROUNDED_RATIO = 0.01
"""Largest difference of a tabulated stress ratio from that of amplitude and mean stress."""


def mean_at_ratio(amplitude: ArrayLike, ratio: ArrayLike) -> NDArray:
    """Return the mean stress (...) of a stress amplitude (...) at a stress ratio R < 1 (...)."""
    return np.asarray(amplitude, float) * means_per_amplitude(ratio)


def _check_ratios(amplitude: NDArray, mean: NDArray, ratio: NDArray) -> None:
    """Raise SettingError if a stress ratio (n,) contradicts amplitude and mean; NaN is not given."""
    for row, (tabulated, a, m) in enumerate(zip(ratio, amplitude, mean), start=1):
        if np.isnan(tabulated):
            continue
        lowest = m - a
        highest = m + a
        computed = lowest / highest if highest != 0.0 else np.inf
        # tables round stress ratios
        agrees = abs(computed - tabulated) <= ROUNDED_RATIO * max(1.0, abs(tabulated))
        expected = (
            f"R = {computed:.4g}, as computed from amplitude and mean (or only one of the columns "
            "mean and R)"
        )
        validation.check(agrees, f"Haigh table, row {row}", expected, f"R = {tabulated:.4g}")


def means_per_amplitude(ratio: ArrayLike) -> NDArray:
    """Return the mean stress per amplitude (...) at a stress ratio R < 1 (...)."""
    values = np.asarray(ratio, float)
    validation.check_value(bool(np.all(values < 1.0)), "R", "stress ratios below 1", ratio)
    return (1.0 + values) / (1.0 - values)


@validation.check_arguments
@dataclass(frozen=True)
class HaighTable(validation.Checked):
    """Allowable stress amplitudes as functions of mean stress, temperature and survival
    probability.

    Parameters
    ----------
    amplitude, mean : (n,) float, Pa
        Allowable amplitude and the mean stress to which it applies, one pair for each row.
    temperature : (n,) float, °C
    probability : (n,) float
        Survival probability, between 0 and 1.
    source : str
        File or origin.

    Raises
    ------
    SettingError
        If the numbers of rows differ, an amplitude is not positive, a temperature is below absolute
        zero, a probability is not between 0 and 1, two rows have the same mean stress, temperature
        and probability, or an amplitude rises with the survival probability.
    """

    amplitude: Annotated[tuple[float, ...], _numbers]
    mean: Annotated[tuple[float, ...], _numbers]
    temperature: Annotated[tuple[float, ...], _numbers]
    probability: Annotated[tuple[float, ...], _numbers]
    source: str = ""

    def __post_init__(self) -> None:
        super().__post_init__()
        n = len(self.amplitude)
        counts = [len(values) for values in (self.mean, self.temperature, self.probability)]
        validation.check(n > 0 and counts == [n, n, n], "Haigh table", f"{n} rows each", counts)
        validation.numbers("amplitude", self.amplitude, above=0.0, unit="Pa")
        validation.numbers("temperature", self.temperature, above=-ICE, unit="°C")
        between = all(0.0 < probability < 1.0 for probability in self.probability)
        expected = "survival probabilities between 0 and 1"
        validation.check_value(between, "probability", expected, self.probability)
        rows = list(zip(self.mean, self.temperature, self.probability))
        repeated = next((row for row in rows if rows.count(row) > 1), None)
        expected = "one amplitude for each mean stress, temperature and probability"
        validation.check(repeated is None, "Haigh table", expected, f"several for {repeated}")
        self._check_survival()
        self._doubt_rises()

    def _check_survival(self) -> None:
        """Raise SettingError if more parts survive at a higher amplitude."""
        for temperature in self.temperatures.tolist():
            for lower, higher in pairwise(self.probabilities.tolist()):
                before = self._line(temperature, lower)
                after = self._line(temperature, higher)
                place = _rise_between(before, after)
                expected = "amplitudes that fall with the survival probability"
                found = (
                    f"one that rises from {lower:g} to {higher:g} at {temperature:g} °C, {place}"
                )
                validation.check(not place, "Haigh table", expected, found)

    def _doubt_rises(self) -> None:
        """Warn of amplitudes that rise with the mean stress or with the temperature."""
        for temperature in self.temperatures.tolist():
            for probability in self.probabilities.tolist():
                means, amplitudes = self._line(temperature, probability)
                rises = amplitudes[1:] > (1.0 + NOTABLE_RISE) * amplitudes[:-1]
                if rises.any():
                    i = int(np.argmax(rises))
                    warn_implausible(
                        "Haigh table",
                        "amplitudes that fall with the mean stress",
                        f"a rise from {means[i]:.4g} to {means[i + 1]:.4g} Pa at "
                        f"{temperature:g} °C; possibly a mean stress without its sign",
                    )
        for cooler, hotter in pairwise(self.temperatures.tolist()):
            for probability in self.probabilities.tolist():
                before = self._line(cooler, probability)
                after = self._line(hotter, probability)
                place = _rise_between(before, after)
                if place:
                    warn_implausible(
                        "Haigh table",
                        "amplitudes that fall with the temperature",
                        f"a rise from {cooler:g} to {hotter:g} °C {place}; possibly exchanged "
                        "temperatures",
                    )

    @classmethod
    def from_csv(cls, path: FilePath | Mapping[str, object]) -> Self:
        """Read a table from a CSV file with one row for each allowable amplitude.

        The header has names and units: ``amplitude (MPa)``, ``mean (MPa)`` or ``R``, ``temperature
        (C)`` and ``probability (%)``, the probability of survival.  With both ``mean`` and ``R``,
        the values of a row must agree.  A table without temperatures belongs to 20 °C, a table
        without probabilities to a survival probability of 50 %.

        Parameters
        ----------
        path : path-like, or mapping of header to values

        Raises
        ------
        ModelError, SettingError
            If a column or unit is missing, or a row is not valid.
        """
        others = ("temperature", "probability")
        columns = read_columns(
            path, ("amplitude", "mean"), ("amplitude", "r"), units=UNITS, optional=others
        )
        amplitude = columns["amplitude"][0]
        if "mean" in columns:
            mean = columns["mean"][0]
            ratio = read_columns(
                path,
                ("amplitude", "mean"),
                units=UNITS,
                blank=("r",),
                optional=("r",),
            ).get("r")
            if ratio is not None:
                _check_ratios(amplitude, mean, ratio[0])
        else:
            mean = mean_at_ratio(amplitude, columns["r"][0])
        temperature, unit = columns.get("temperature", (np.full_like(mean, ROOM), "C"))
        probability, _ = columns.get("probability", (np.full_like(mean, MEDIAN), ""))
        if unit.strip().upper() == "K":
            temperature = temperature - ICE
        source = "table" if isinstance(path, Mapping) else str(path)
        return cls(amplitude, mean, temperature, probability, source)  # type: ignore[arg-type]

    @property
    def temperatures(self) -> NDArray:
        """Temperatures (k,) of the table, ascending, °C."""
        return np.unique(self.temperature)

    @property
    def probabilities(self) -> NDArray:
        """Survival probabilities (k,) of the table, ascending."""
        return np.unique(self.probability)

    def _line(self, temperature: float, probability: float) -> tuple[NDArray, NDArray]:
        """Return mean stresses, ascending, and amplitudes of one test series; empty if absent."""
        # equal, not close: near 1 the probabilities of two series may differ by 1e-5
        at_temperature = np.array(self.temperature) == temperature
        of_series = at_temperature & (np.array(self.probability) == probability)
        mean = np.array(self.mean)[of_series]
        amplitude = np.array(self.amplitude)[of_series]
        order = np.argsort(mean)
        return mean[order], amplitude[order]

    def at_probability(self, probability: float) -> HaighTable:
        """Return the table for one survival probability.

        Parameters
        ----------
        probability : float
            Between the lowest and the highest probability at each temperature.

        Raises
        ------
        SettingError
            If the table has no such probabilities at a temperature.
        """
        wanted = validation.number("probability", probability, above=0.0, below=1.0)
        rows: list[tuple[float, float, float]] = []
        for temperature in self.temperatures:
            of_temperature = np.array(self.temperature) == temperature
            known = np.unique(np.array(self.probability)[of_temperature])
            lowest = known[0]
            highest = known[-1]
            within = lowest * (1.0 - 1e-12) <= wanted <= highest * (1.0 + 1e-12)
            expected = f"{lowest:g} to {highest:g} at {temperature:g} °C"
            validation.check(within, "probability", expected, f"{wanted:g}")
            means, amplitudes = self._line_at(temperature, known, wanted)
            rows += [
                (a, m, float(temperature)) for m, a in zip(means.tolist(), amplitudes.tolist())
            ]
        amplitudes_of_rows, means_of_rows, temperatures = zip(*rows)
        survival = (wanted,) * len(rows)
        # the complete table has been checked
        with quiet():
            return HaighTable(
                amplitudes_of_rows, means_of_rows, temperatures, survival, self.source
            )

    def _line_at(
        self, temperature: float, known: NDArray, probability: float
    ) -> tuple[NDArray, NDArray]:
        """Return mean stresses and amplitudes at a probability between those of the table.

        A row belongs to the row of the other probability with the same mean stress or the same
        stress ratio, so that no tested mean stress is lost.
        """
        tabulated = np.isclose(known, probability, rtol=1e-12, atol=0.0)
        if tabulated.any():
            return self._line(temperature, float(known[tabulated][0]))
        upper = int(np.searchsorted(known, probability))
        # the two neighbours of the probability in the table
        below = float(known[upper - 1])
        above = float(known[upper])
        mean_0, amplitude_0 = self._line(temperature, below)
        mean_1, amplitude_1 = self._line(temperature, above)
        match = len(mean_0) == len(mean_1) and (
            np.allclose(mean_0, mean_1, rtol=0.01)
            or np.allclose(mean_0 / amplitude_0, mean_1 / amplitude_1, rtol=0.01)
        )
        differ = (
            f"the rows at {temperature:g} °C with the survival probabilities {below:g} and "
            f"{above:g} need the same mean stresses or stress ratios"
        )
        validation.check_sentence(match, "Haigh table", differ)
        # linear in the quantile of the normal distribution
        quantile_0, quantile_1 = ndtri([below, above])
        share = float((ndtri(probability) - quantile_0) / (quantile_1 - quantile_0))
        means = (1.0 - share) * mean_0 + share * mean_1
        amplitudes = (1.0 - share) * amplitude_0 + share * amplitude_1
        return means, amplitudes

    def allowed(
        self, mean: ArrayLike, ultimate_strength: float, temperature: ArrayLike | None = None
    ) -> NDArray:
        """Return the allowable amplitude for each mean stress and temperature.

        Parameters
        ----------
        mean : (...) float, Pa
        ultimate_strength : float, Pa
            Mean stress at which no amplitude is allowable.
        temperature : float or (...) float, °C, optional
            Needed if the table has several temperatures.

        Returns
        -------
        (...) float, Pa

        Raises
        ------
        SettingError
            If the table has several probabilities, or a temperature is missing or outside the
            table.
        """
        validation.check(
            len(self.probabilities) == 1,
            "Haigh table",
            "one probability (table.at_probability(0.99))",
            f"{self.probabilities.tolist()}",
        )
        known = self.temperatures
        span = f"{known[0]:g} to {known[-1]:g} °C"
        if temperature is None:
            missing = f"give the temperature of the points, {span}"
            validation.check_sentence(len(known) == 1, "temperature", missing)
            temperature = known[0]
        shape = np.shape(temperature)
        of_points = np.shape(mean)
        one_for_each = shape in ((), of_points) or of_points == ()
        expected = f"one value or one for each point, shape {of_points}"
        validation.check_value(one_for_each, "temperature", expected, f"shape {shape}")
        means, degrees = np.broadcast_arrays(
            np.asarray(mean, float), np.asarray(temperature, float)
        )
        within = (degrees >= known[0] - 1e-9) & (degrees <= known[-1] + 1e-9)
        outside = np.ravel(degrees[~within])[:1]
        validation.check(within.all(), "temperature", f"{span}, as in the table", outside)
        # allowable amplitudes (...) at each temperature of the table
        amplitudes = [self._allowed_at(t, means, ultimate_strength) for t in known]
        if len(known) == 1:
            return amplitudes[0]

        # linear between the temperatures below and above each point
        upper = np.clip(np.searchsorted(known, degrees), 1, len(known) - 1)
        lower = upper - 1
        share = (degrees - known[lower]) / (known[upper] - known[lower])
        of_temperatures = np.array(amplitudes)
        below = np.take_along_axis(of_temperatures, lower[None], axis=0)[0]
        above = np.take_along_axis(of_temperatures, upper[None], axis=0)[0]
        return np.asarray((1.0 - share) * below + share * above)

    def _allowed_at(self, temperature: float, mean: NDArray, ultimate_strength: float) -> NDArray:
        """Return the allowable amplitudes (...) at a temperature of the table.

        They are constant below the lowest mean stress of the table, and fall to 0 at the ultimate
        strength.
        """
        only_probability = self.probability[0]
        means, amplitudes = self._line(temperature, only_probability)
        means = np.append(means, ultimate_strength)
        amplitudes = np.append(amplitudes, 0.0)
        return np.asarray(np.interp(mean, means, amplitudes))


def _rise_between(before: tuple[NDArray, NDArray], after: tuple[NDArray, NDArray]) -> str:
    """Return the mean stress at which the amplitude rises from one series to another, in words.

    A series has ascending mean stresses (n,) and amplitudes (n,), Pa.  They are compared at the
    mean stresses that both cover.  The text is empty without a rise.
    """
    means_before, amplitudes_before = before
    means_after, amplitudes_after = after
    if not len(means_before) or not len(means_after):
        return ""
    lowest = max(means_before[0], means_after[0])
    highest = min(means_before[-1], means_after[-1])
    means = np.union1d(means_before, means_after)
    common = means[(means >= lowest) & (means <= highest)]
    lower = np.interp(common, means_before, amplitudes_before)
    upper = np.interp(common, means_after, amplitudes_after)
    rises = upper > (1.0 + NOTABLE_RISE) * lower
    if not rises.any():
        return ""
    return f"at a mean stress of {common[int(np.argmax(rises))]:.4g} Pa"


def at_points(
    temperature: float | Sequence[float] | NDArray | Mapping[str, float] | None,
    names: Sequence[str],
) -> NDArray | None:
    """Return the temperature (n,) of each point of the stress sets in °C, or None if it is not
    given.

    Parameters
    ----------
    temperature : float, (n,) float, or mapping of name to float, °C
        One value, a value for each point, or values by the names of points ("root node 215") and of
        stress sets ("root"); the name of a point precedes that of its set.
    names : sequence of str
        Names of the points.

    Raises
    ------
    SettingError
        If a value is not a number, or a point has none.
    """
    if temperature is None:
        return None
    if isinstance(temperature, Mapping):
        values = []
        for name in names:
            # a name consists of the set, "node" or "point", and a number
            set_name, *_ = name.rsplit(" ", 2)
            value = temperature.get(name, temperature.get(set_name))
            missing = f"the value for '{name}' or its stress set is missing"
            validation.check_sentence(value is not None, "temperature", missing)
            values.append(value)
        return validation.numbers("temperature", values, len(names))
    if np.ndim(temperature) == 0:
        return np.full(len(names), validation.number("temperature", temperature))
    return validation.numbers("temperature", temperature, len(names))
