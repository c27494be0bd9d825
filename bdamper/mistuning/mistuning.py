"""Mistuning of the blades and variation of the dampers of a bladed disk.

The *frequency deviation* ``eps`` of a blade refers to its natural frequencies clamped at the root,
without the disk.  These are ``(1 + eps)`` times the nominal ones, so the stiffness is ``(1 +
eps)**2`` times the nominal one.  (With the first-order ``1 + 2 eps``, the frequency would be wrong
by 0.12 % at 5 %.)  Blade ``n`` of an array is sector ``n``, counted toward +X.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bdamper.importers.measurements import HEADER, HERTZ, check_unit
from bdamper.util import plausible_ranges, validation
from bdamper.util.display import Plottable, Summarised
from bdamper.util.errors import SettingError, mismatch
from bdamper.util.formatting import counted, extent, sentence, short_repr
from bdamper.util.statement import Row, Statement
from bdamper.util.storage import FilePath, Storable, existing
from bdamper.util.tables import Column, Tabular

DISTRIBUTIONS = ("normal", "uniform")
_BLADES = 1
"""Last number of the seeds of blades, which makes their draws independent of those of dampers."""
_DAMPERS = 2
"""Last number of the seeds of dampers."""


@validation.check_arguments
@short_repr
@dataclass(frozen=True)
class Mistuning(Plottable, Tabular, Storable, kind="bdamper-mistuning", row="blade"):
    """Frequency deviations of the blades of a bladed disk.

    ``plot`` draws them as one bar for each blade (:func:`bdamper.plot.plot_mistuning`).

    Parameters
    ----------
    deviation : (n_blades,) or (n_blades, n_modes) float
        Relative deviation of the clamped frequencies of each blade, for all its modes or for each
        of the first cantilever modes.  Higher modes have the mean of the given ones.
    source : str
        Origin of the deviations: "given", a distribution or a file.
    seed : tuple of int
        Seed of a random pattern; empty otherwise.

    Raises
    ------
    SettingError
        If a deviation is not finite or not above -1.
    """

    deviation: NDArray
    source: str = "given"
    seed: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        values = _by_blade(
            "mistuning", self.deviation, -1.0, "finite frequency deviations above -1"
        )
        object.__setattr__(self, "deviation", values)
        object.__setattr__(self, "seed", tuple(self.seed))

    @classmethod
    def of(cls, n_blades: int, mistuning: Mistuning | ArrayLike | None) -> Mistuning:
        """Return the mistuning of ``n_blades`` blades from an object, an array of deviations, or
        None (tuned)."""
        if not isinstance(mistuning, Mistuning):
            if mistuning is None:
                mistuning = np.zeros(n_blades)
            mistuning = cls(np.asarray(mistuning))
        if mistuning.n_blades != n_blades:
            raise SettingError(
                f"mistuning: expected {n_blades} blades, as in the model, found "
                f"{mistuning.n_blades}"
            )
        return mistuning

    @classmethod
    def from_frequencies(
        cls,
        frequency: ArrayLike,
        reference: ArrayLike | None = None,
        source: str = "given frequencies",
    ) -> Self:
        """Return the deviations of measured blade frequencies, each blade clamped at its root.

        Parameters
        ----------
        frequency : (n_blades,) or (n_blades, n_modes) float, Hz
        reference : float or (n_modes,) float, Hz, optional
            Frequencies of the nominal blade.  By default the mean over the blades, so that the
            deviations have zero mean.
        source : str
        """
        values = _by_blade("frequency", frequency, 0.0, "frequencies above 0 Hz")
        base = values.mean(axis=0)
        if reference is not None:
            base = validation.numbers(
                "reference", np.atleast_1d(reference), np.size(base), above=0.0, unit="Hz"
            )
        deviation = values / base - 1.0
        plausible_ranges.check("Mistuning", "deviation", deviation)
        return cls(deviation, source)

    @classmethod
    def from_csv(cls, path: FilePath, reference: ArrayLike | None = None) -> Self:
        """Read measured blade frequencies from a file and return their deviations.

        Parameters
        ----------
        path : path-like
            One row for each blade, one column for each measured mode.  The header has units, such
            as ``blade,first mode (Hz)``.  A column "blade" numbers the blades from 0 or 1, in any
            order.  Lines that begin with ``#`` are comments.
        reference : float or (n_modes,) float, Hz, optional
            See :meth:`from_frequencies`.

        Raises
        ------
        FileNotFoundError
            If the file does not exist.
        BdamperError
            If the file is invalid; the message gives the row and the column.
        """
        return cls.from_frequencies(_read_frequencies(path), reference, f"file {Path(path).name}")

    @classmethod
    @validation.check_arguments
    def random(
        cls,
        n_blades: int,
        standard_deviation: float,
        distribution: str | Mistuning = "normal",
        *,
        seed: int | Sequence[int] = 0,
    ) -> Self:
        """Draw the deviation of every blade independently.

        The same seed gives the same pattern, scaled to the standard deviation.

        Parameters
        ----------
        n_blades : int
        standard_deviation : float
            Standard deviation of the distribution. The mean and standard deviation of a single
            pattern scatter about zero and this value; :meth:`without_mean` removes the mean.
        distribution : {"normal", "uniform"} or Mistuning
            A measured pattern is resampled with repetition, whole blades at a time.  Its mean is
            removed and its standard deviation over all modes is scaled to ``standard_deviation``.
        seed : int or sequence of int
            Equal seeds give equal draws.
        """
        n_blades = validation.integer("n_blades", n_blades, least=1)
        deviation = validation.number(
            "standard_deviation", standard_deviation, least=0.0, below=1.0
        )
        seed = _seed(seed)
        generator = np.random.default_rng([*seed, _BLADES])
        if isinstance(distribution, Mistuning):
            pattern = distribution.without_mean().deviation
            if pattern.std() == 0.0:
                raise SettingError(
                    "distribution: the measured pattern has identical blades; give one with different "
                    "blades"
                )
            blades = generator.integers(len(pattern), size=n_blades)
            unit = (pattern / pattern.std())[blades]
            name = f"resampled from {distribution.source}"
        else:
            name = validation.choice("distribution", distribution, DISTRIBUTIONS)
            if name == "normal":
                unit = generator.standard_normal(n_blades)
            else:
                half_width = np.sqrt(3.0)  # of the uniform distribution with standard deviation 1
                unit = generator.uniform(-half_width, half_width, n_blades)
        return cls(deviation * unit, f"{name}, standard deviation {deviation:g}", seed)

    @property
    def n_blades(self) -> int:
        return len(self.deviation)

    def by_mode(self, n_modes: int) -> tuple[NDArray, NDArray]:
        """Return the change of stiffness by cantilever mode, and of the remaining coordinates.

        Shapes are (n_blades, n_modes) and (n_blades,).

        The remaining coordinates (attachment modes and root shapes) have the mean change of the
        given modes.

        Raises
        ------
        SettingError
            If deviations are given for more modes than the model has.
        """
        # stiffness is proportional to the squared frequency: (1 + eps)**2 - 1 = eps (2 + eps)
        change_of_stiffness = self.deviation * (2.0 + self.deviation)
        change = change_of_stiffness.reshape(self.n_blades, -1)
        n_given = change.shape[1]
        if n_given > n_modes:
            raise SettingError(
                f"mistuning: the model has {n_modes} cantilever modes, found deviations of "
                f"{n_given} modes"
            )
        mean_change = change.mean(axis=1)
        higher_modes = np.repeat(mean_change[:, None], n_modes - n_given, axis=1)
        return np.hstack([change, higher_modes]), mean_change

    def without_mean(self) -> Self:
        """Return the same pattern with the mean over the blades removed from each mode."""
        return type(self)(self.deviation - self.deviation.mean(axis=0), self.source, self.seed)

    def columns(self) -> dict[str, Column]:
        """Return the table with one row for each blade."""
        columns = {"blade": Column(np.arange(self.n_blades))}
        if self.deviation.ndim == 1:
            columns["deviation"] = Column(self.deviation)
            return columns
        for k, of_mode in enumerate(self.deviation.T, start=1):
            columns[f"deviation_{k}"] = Column(of_mode)
        return columns

    @property
    def origin(self) -> str:
        """Source and random seed of the deviations, and the number of modes of each blade."""
        text = self.source
        if self.seed:
            text += f", seed {' '.join(map(str, self.seed))}"
        if self.deviation.ndim == 2:
            text += f", {counted(self.deviation.shape[1], 'mode')} of each blade"
        return text

    @property
    def _source_text(self) -> str:
        """The origin, with the distribution in words and its standard deviation in per cent."""

        def in_percent(found: re.Match[str]) -> str:
            return f"standard deviation {100.0 * float(found[1]):g} %"

        text = re.sub(r"standard deviation ([\d.e-]*\d)", in_percent, self.origin)
        return re.sub(r"^(normal|uniform),", r"\1 distribution of frequencies,", text)

    @property
    def record_text(self) -> str:
        """Text in the settings of results, the same as in files of earlier versions."""
        modes = ""
        if self.deviation.ndim == 2:
            modes = f", {self.deviation.shape[1]} modes each"
        seed = ""
        if self.seed:
            seed = f", seed {' '.join(map(str, self.seed))}"
        percents = 100.0 * self.deviation
        # a mean that is zero but for rounding has no sign: -0.0 + 0.0 is 0.0
        mean = percents.mean().round(9) + 0.0
        return (
            f"frequency deviations of {self.n_blades} blades clamped at the root{modes} "
            f"({self.source}{seed}): mean {mean:.3g} %, standard deviation {percents.std():.3g} %, "
            f"from {percents.min():.3g} to {percents.max():.3g} %"
        )

    def _statement(self) -> Statement:
        percents = 100.0 * self.deviation
        # a mean that is zero but for rounding has no sign: -0.0 + 0.0 is 0.0
        mean = percents.mean().round(9) + 0.0
        of_blade = percents.reshape(self.n_blades, -1)
        lowest = int(of_blade.min(axis=1).argmin())
        highest = int(of_blade.max(axis=1).argmax())
        blades = f"blade {lowest} lowest, blade {highest} highest (counted from 0)"
        verdict = (
            f"Frequencies of {counted(self.n_blades, 'blade')} clamped at the root deviate by "
            f"{percents.std():.3g} % (standard deviation)"
        )
        source = self._source_text
        if self.seed:
            source += f"; these {self.n_blades} draws have {percents.std():.3g} %"
        rows = [
            Row("Source", "", source),
            Row("Mean deviation", f"{mean:.3g} %", "shifts the frequencies of all blades equally"),
            Row("Range", f"{percents.min():.3g} to {percents.max():.3g} %", blades),
        ]
        return Statement([verdict], rows, remarks=["Not covered: mode shapes, damping"])


@validation.check_arguments
@short_repr
@dataclass(frozen=True)
class DamperVariation(Summarised, Storable, kind="bdamper-damper-variation"):
    """Deviations of the dampers of a bladed disk from the nominal damper.

    Damper ``n`` lies between blades ``n`` and ``n + 1``.

    Parameters
    ----------
    mass : (n_blades,) float
        Factors on the mass of each damper at the same shape, above 0.  They scale its inertia and
        its centrifugal load.
    friction_coefficient, contact_stiffness : (n_blades,) float
        Factors for all contact points of each damper; the friction factor must be at least 0, and
        the stiffness factor above 0.
    gap : (n_blades,) float, m
        Increase of the initial gaps of all contact points of each damper, at least 0.
    missing : (n_blades,) bool
        True for missing dampers.

    Raises
    ------
    SettingError
        If the arrays have different lengths, or a value is out of range.
    """

    mass: NDArray
    friction_coefficient: NDArray
    contact_stiffness: NDArray
    gap: NDArray
    missing: NDArray

    def __post_init__(self) -> None:
        n = np.size(self.missing)
        for name, limits in _LIMITS.items():
            values = np.asarray(getattr(self, name))
            object.__setattr__(self, name, validation.numbers(name, values, n, **limits))
        missing = np.array(self.missing)
        if missing.dtype != bool or missing.ndim != 1 or n == 0:
            raise validation.invalid("missing", "(n_blades,) True or False", self.missing)
        object.__setattr__(self, "missing", missing)

    @classmethod
    @validation.check_arguments
    def of(cls, n_blades: int, *, missing: Sequence[int] = (), **properties: Any) -> Self:
        """Return dampers with some properties changed; one number applies to all dampers.

        Parameters
        ----------
        n_blades : int
        missing : sequence of int
            Numbers of the missing dampers, from 0.
        **properties : float or (n_blades,) float
            mass, friction_coefficient, contact_stiffness and gap, see the class; nominal by
            default.
        """
        n = validation.integer("n_blades", n_blades, least=1)
        full: dict[str, Any] = {
            "mass": np.ones(n),
            "friction_coefficient": np.ones(n),
            "contact_stiffness": np.ones(n),
            "gap": np.zeros(n),
        }
        for name, value in properties.items():
            validation.choice("properties of dampers", name, tuple(_LIMITS))
            # one number applies to all dampers
            full[name] = [value] * n if np.ndim(value) == 0 else value
        numbers = validation.integers("missing", missing, most=n - 1)
        is_missing = np.zeros(n, bool)
        is_missing[list(numbers)] = True
        return cls(**full, missing=is_missing)

    @classmethod
    @validation.check_arguments
    def random(
        cls,
        n_blades: int,
        *,
        missing: Sequence[int] = (),
        seed: int | Sequence[int] = 0,
        **spread: float,
    ) -> Self:
        """Draw the dampers independently.

        Parameters
        ----------
        n_blades : int
        missing : sequence of int
            Numbers of the missing dampers, from 0.
        seed : int or sequence of int
            Equal seeds give equal draws of a property, whether or not other properties vary.
        **spread : float
            mass, friction_coefficient and contact_stiffness: relative standard deviations of
            factors with lognormal distributions of mean 1, which are positive.  gap: mean of
            exponentially distributed gaps, m.
        """
        n = validation.integer("n_blades", n_blades, least=1)
        generator = np.random.default_rng([*_seed(seed), _DAMPERS])
        full: dict[str, Any] = {}
        for name in _LIMITS:
            value = spread.pop(name, 0.0)
            if name == "gap":
                mean = validation.number(name, value, least=0.0, unit="m")
                full[name] = mean * generator.standard_exponential(n)
                continue
            deviation = validation.number(f"standard deviation of {name}", value, least=0.0)
            # lognormal distribution with mean 1: sigma is the standard deviation of the logarithm
            sigma = np.sqrt(np.log1p(deviation**2))
            logarithm = sigma * generator.standard_normal(n) - 0.5 * sigma**2
            full[name] = np.exp(logarithm)
        # names that are left in spread are unknown, and refused by of
        return cls.of(n, missing=missing, **full, **spread)

    @property
    def n_blades(self) -> int:
        return len(self.missing)

    @property
    def record_text(self) -> str:
        """Text in the settings of results, the same as in files of earlier versions."""
        lines = [f"{self.n_blades} dampers, {int(self.missing.sum())} missing"]
        for name in _LIMITS:
            values = getattr(self, name)
            kind = "" if name == "gap" else "factor "
            title = name.replace("_", " ")
            lines.append(f"  {title}: {kind}{values.min():.4g} to {values.max():.4g}")
        return "\n".join(lines)

    _states_all = True

    def _statement(self) -> Statement:
        missing = np.flatnonzero(self.missing)
        verdict = f"{counted(self.n_blades, 'damper')}, none missing"
        if len(missing):
            n_present = self.n_blades - len(missing)
            verdict = f"{n_present} of {counted(self.n_blades, 'damper')} present"
        rows = []
        if len(missing):
            numbers = ", ".join(map(str, missing))
            plural = "s" if len(missing) > 1 else ""
            which = f"damper number{plural} {numbers} (counted from 0)"
            rows.append(Row("Missing dampers", str(len(missing)), which))
        for name in _LIMITS:
            values = getattr(self, name)
            low = values.min()
            high = values.max()
            title = sentence(name.replace("_", " "))
            nominal = 0.0 if name == "gap" else 1.0
            if low == high == nominal:
                continue
            if name == "gap":
                rows.append(Row(title, extent(low, high, "m"), "increase of the gaps"))
                continue
            factors = f"{low:.4g}" if low == high else f"{low:.4g} to {high:.4g}"
            which = "all dampers" if low == high else ""
            rows.append(Row(title, f"{factors} times nominal", which))
        return Statement([verdict], rows)


_LIMITS: dict[str, dict[str, Any]] = {
    "mass": {"above": 0.0},
    "friction_coefficient": {"least": 0.0},
    "contact_stiffness": {"above": 0.0},
    "gap": {"least": 0.0, "unit": "m"},
}


def _by_blade(name: str, value: ArrayLike, above: float, expected: str) -> NDArray:
    """Return finite numbers above a limit with shape (n_blades,) or (n_blades, n_modes)."""
    try:
        values = np.array(value, float)
    except (TypeError, ValueError):
        # a value without dimension, which the check of the shape refuses
        values = np.array(np.nan)
    has_shape = values.ndim in (1, 2) and 0 not in values.shape
    if not has_shape or not np.isfinite(values).all() or not (values > above).all():
        raise validation.invalid(name, f"(n_blades,) or (n_blades, n_modes) {expected}", value)
    return values


def _seed(seed: Any) -> tuple[int, ...]:
    """Return a seed, one number or a sequence of numbers, as a tuple."""
    is_sequence = isinstance(seed, Sequence) and not isinstance(seed, str | bytes)
    seeds = seed if is_sequence else [seed]
    return tuple(validation.integer("seed", s) for s in seeds)


def _read_frequencies(path: FilePath) -> NDArray:
    """Read (n_blades,) or (n_blades, n_modes) frequencies from a CSV file, in the order of the
    blades."""
    try:
        text = existing(path).read_text(encoding="utf-8-sig").splitlines()
        lines = [line for line in text if line.strip() and not line.lstrip().startswith("#")]
        if not lines:
            raise ValueError("no rows")
        separator = ";" if any(";" in line for line in lines) else ","
        head = [cell.strip(' "').lower() for cell in lines[0].split(separator)]
        if not np.isnan(np.genfromtxt(lines[:1], delimiter=separator)).all():
            raise ValueError(f"no header with units, such as 'blade{separator}mode 1 (Hz)'")
        table = np.loadtxt(lines[1:], delimiter=separator, ndmin=2, quotechar='"')
    except ValueError as error:
        raise mismatch(str(path), "one row of frequencies for each blade", error) from error
    # every column but "blade" contains the frequencies of one mode
    modes = [column for column, name in enumerate(head) if name != "blade"]
    factors = [_hertz_per_unit(path, head[column]) for column in modes]
    if len(head) != table.shape[1]:
        raise mismatch(str(path), f"{len(head)} columns as in the header", table.shape[1])
    if "blade" in head:
        number = table[:, head.index("blade")]
        order = np.argsort(number, kind="stable")
        first = number.min()
        complete = np.array_equal(number[order], first + np.arange(len(number)))
        if first not in (0.0, 1.0) or not complete:
            raise mismatch(
                f"{path}, column 'blade'", "each number from 0 or 1 once", number.tolist()
            )
        table = table[order]
    frequencies = table[:, modes] * factors
    return frequencies[:, 0] if len(modes) == 1 else frequencies


def _hertz_per_unit(path: FilePath, header: str) -> float:
    """Return the factor from the unit in a header, such as "mode 1 (kHz)", to Hz."""
    match = HEADER.fullmatch(header)
    if match is None:
        return check_unit(str(path), "", "", HERTZ)
    return check_unit(str(path), match[1], match[2] or "", HERTZ)
