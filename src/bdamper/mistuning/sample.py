"""Many wheels: the highest blade of each, on any executor, in a file that survives an interruption, with its own audit.

BladedDisk ``k`` has the deviations (and dampers) that are drawn with the seed ``(seed, k)``: one unit pattern, scaled to
every standard deviation, so that wheels are the same at every preload and every standard deviation, and the same in a
study with more harmonics.  A sample can be continued with more wheels in the same results file.

**Audit.**  The highest peak is that of a coarse sweep and local searches (:mod:`bdamper.mistuning.peak_search`), which can
miss it. So a share of the wheels, drawn by their numbers before any result is known, is searched again with half the
spacing and three times as many searches; and after the sample so is the same share of the highest wheels in each cell,
since the tail is what is quoted.  Both searches free their dampers, and it is the freed peaks that are compared.

What a sample of wheels tells: amplification factors and their percentiles, the tail, the best preload, the audit.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import closing, nullcontext
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from bdamper.analyses.executors import Record, check_executor, recorded, run_stored
from bdamper.harmonic_balance.parameters import study_fingerprint
from bdamper.harmonic_balance.problem import Problem
from bdamper.harmonic_balance.result_checks import Asking, problem_of
from bdamper.mistuning.mistuning import DamperVariation, Mistuning
from bdamper.mistuning.peak import WheelPeakOptions
from bdamper.mistuning.statistics import Interval, WeibullTail, percentile, share, weibull_tail
from bdamper.mistuning.wheel import OF_PEAKS, BladedDisk, answers
from bdamper.response.peak import Peak
from bdamper.util import validation
from bdamper.util.display import Fact, Plottable, Summarised, draw
from bdamper.util.errors import COMPLETE, FAILED, NOT_RUN, BdamperError, SettingError, all_complete, status_word
from bdamper.util.formatting import amount, short_repr
from bdamper.util.progress import one_thread
from bdamper.util.storage import INSTALLED, Recorded, ResultsFile, Storable
from bdamper.util.tables import Hertz, Metres, Newtons, Numbers, Quantity, Resonance, Seconds, Tabular

# ---- What a sample of wheels tells ----


def highest_wheels(height: NDArray, audit: float) -> NDArray:
    """(n_wheels, ...) bool: a share of the wheels, the highest in each cell."""
    n = int(np.ceil(audit * len(height) - 1e-9))
    rank = np.argsort(np.argsort(-np.nan_to_num(height, nan=-np.inf), axis=0, kind="stable"), axis=0, kind="stable")
    return np.asarray((rank < n) & np.isfinite(height))


@short_repr
@dataclass(frozen=True)
class Audit(Summarised, Tabular, row="search"):
    """Highest peaks of a search beside those of a wider one on the same wheels, dampers freed in both.

    Parameters
    ----------
    kind : {"drawn before any result", "highest wheels"}
    wheel : (n,) int
    standard_deviation, preload : (n,) float
    search, thorough : (n,) float, m
        Highest amplitude of any blade by either; NaN where it is not known.
    error : (n,) float
        What the search says of its own (:class:`~bdamper.mistuning.peak.WheelPeak`).
    tolerance : float
        A peak is missed if the thorough search is higher by more than this share.
    status : tuple of str
        "complete", or why one of the searches has no peak.
    """

    kind: str
    wheel: Numbers
    standard_deviation: Numbers
    preload: Newtons
    search: Metres
    thorough: Metres
    error: Numbers
    tolerance: float
    status: Annotated[tuple[str, ...], Quantity(name="run")]

    @property
    def missed(self) -> Numbers:
        """(n,) bool: where the thorough search has found a higher peak."""
        return np.asarray(self.thorough > (1.0 + self.tolerance) * self.search)

    @property
    def covered(self) -> NDArray:
        """(n,) bool: where the error that the search has named, or the tolerance, covers the higher peak."""
        return np.asarray(self.thorough <= (1.0 + np.maximum(self.error, self.tolerance)) * self.search)

    @property
    def undecided(self) -> NDArray:
        """(n,) bool: where one of the searches has no peak."""
        return ~self.missed & (np.array(self.status) != COMPLETE)

    @property
    def share(self) -> Interval:
        """Share of wheels of which a peak was missed anywhere, with its binomial interval of 95 %.

        Of the wheels that are decided: a peak is missed, or both searches have one wherever they were asked.
        """
        missed = np.unique(self.wheel[self.missed])
        open_still = np.setdiff1d(self.wheel[self.undecided], missed)
        return share(len(missed), len(np.setdiff1d(self.wheel, open_still)))

    def _headline(self) -> str:
        n, missed, found = len(np.unique(self.wheel)), self.missed, self.share
        named = ", ".join(map(str, np.unique(self.wheel[missed])))
        return (
            f"Audit of {n} wheels ({self.kind}), {len(missed)} wider searches: {int(missed.sum())} "
            f"higher by more than {100.0 * self.tolerance:g} %, {int((missed & ~self.covered).sum())} beyond their error, "
            f"{int(self.undecided.sum())} not decided; {100.0 * found.value:.3g} % of the wheels with any "
            f"({100.0 * found.low:.3g} to {100.0 * found.high:.3g} %){f': {named}' if named else ''}."
        )


@short_repr
@dataclass(frozen=True)
class BestPreload:
    """The preload, of those of a sample, at which a percentile of the worst blade's amplitude is least.

    Parameters
    ----------
    percentile : float
    standard_deviation : float
    preload : float, N
    amplitude : Interval, m
        The percentile there, with its interval of 95 %, which has the errors of the amplitudes.
    low, high : float, N
        Range of the preloads that may be the best, whatever the errors of the amplitudes, in 95 % of the samples drawn
        again from the wheels, whole wheels at a time (bootstrap).
    kind : {"interior", "end"}
        Whether the preload lies within the range of the sample or at one end of it.
    tuned_preload, tuned_amplitude : float, N and m
        The best of the same preloads for the tuned wheel.
    wheels : int
        Those known at every preload, which count.
    """

    percentile: float
    standard_deviation: float
    preload: float
    amplitude: Interval
    low: float
    high: float
    kind: str
    tuned_preload: float
    tuned_amplitude: float
    wheels: int

    def __str__(self) -> str:
        tuned = f"tuned {amount(self.tuned_preload, 'N')}, {amount(self.tuned_amplitude, 'm')}"
        return (
            f"Best preload for the worst blade in {self.percentile:g} % of {self.wheels} wheels, standard deviation "
            f"{100.0 * self.standard_deviation:g} %: {Interval(self.low, self.preload, self.high).to_text('N')}, "
            f"{self.kind} of the preloads asked, {self.amplitude.to_text('m')}; {tuned}"
        )


@short_repr
@dataclass(frozen=True)
class MistunedSample(Plottable, Tabular, Recorded, Storable, kind="bdamper-wheel-sample", version=1, row="wheel"):
    """Highest blades of many wheels; arrays of shape (n_wheels, n_deviations, n_preloads) are NaN where there is no answer.

    ``plot`` draws percentiles over the standard deviation or the preload (:func:`bdamper.plot.plot_sample`), ``plot_tail``
    the distribution with its tail.

    Parameters
    ----------
    n_blades : int
    wheels : (n_wheels,) int
        Their numbers, with which they were drawn.
    standard_deviation : (n_deviations,) float
    preload : (n_preloads,) float, N
    amplitude, frequency, blade : float, m and Hz
        Of the highest blade, and its number.
    residual, springs, error : float
        ``springs`` on the mean of dampers, and ``error`` of the amplitude that they leave
        (:class:`~bdamper.mistuning.peak.WheelPeak`).
    tuned_amplitude : (n_preloads,) float, m
        Of the tuned wheel at the same preload.
    status : tuple of str
        In the order of the arrays: "complete", "failed: " with the reason, or "not run".
    audited : (n,) int
        Wheels that were drawn for the audit before any result.
    audit_share : float
        Probability with which they were, and share of the highest wheels that are audited.
    curve_amplitude : float, m
        By the thorough search, of the wheels that were audited; in files before 0.6 that of whole curves with dampers held.
    curve_status : tuple of str
    processor, curve_processor : float, s
        Spent on the peaks and on the audit.
    drawn : mapping
        Distribution, variations of the dampers and seed.
    settings : mapping
        Of the tuned study.
    model_hash : str
    """

    n_blades: int
    wheels: NDArray
    standard_deviation: NDArray
    preload: Newtons
    amplitude: Resonance
    frequency: Hertz
    blade: Numbers
    residual: Numbers
    springs: Numbers
    error: Numbers
    tuned_amplitude: NDArray
    status: Annotated[tuple[str, ...], Quantity(name="run")]
    audited: NDArray
    audit_share: float
    curve_amplitude: Metres
    curve_status: tuple[str, ...]
    processor: Seconds
    curve_processor: NDArray
    drawn: dict[str, Any] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.wheels)

    @property
    def complete(self) -> bool:
        """Whether there is an answer for every wheel, and a thorough one of each that was to be audited."""
        return all_complete(self.status) and all(s in (COMPLETE, "not asked") for s in self.curve_status)

    @property
    def amplification(self) -> Numbers:
        """(n_wheels, n_deviations, n_preloads) amplitude over that of the tuned wheel at the same preload."""
        return np.asarray(self.amplitude / self.tuned_amplitude)

    @property
    def held(self) -> float:
        """Share of the peaks that were found only with springs on the mean of dampers."""
        known = self.springs[np.isfinite(self.springs)]
        return float(np.mean(known > 0.0)) if len(known) else 0.0

    def percentile(self, q: float, quantity: str = "amplification") -> NDArray:
        """(3, n_deviations, n_preloads): lower end, estimate, upper end of a percentile over the wheels.

        Intervals are those of order statistics (:mod:`bdamper.mistuning.statistics`) of amplitudes that may be off by their
        ``error``, and infinite where the sample is too small.
        """
        values = getattr(self, validation.choice("quantity", quantity, ("amplification", "amplitude", "frequency")))
        error = 0.0 * self.error if quantity == "frequency" else self.error
        cells = [
            [percentile(values[:, i, j], q, error[:, i, j]) for j in range(values.shape[2])] for i in range(values.shape[1])
        ]
        return np.moveaxis(np.array(cells), -1, 0)

    def tail(self, standard_deviation: float | None = None, preload: float | None = None, tail: float = 0.5) -> WeibullTail:
        """Weibull distribution fitted to the upper amplification factors of one cell; the largest values by default."""
        i, j = self.cell(standard_deviation, preload)
        return weibull_tail(self.amplification[:, i, j], tail)

    def cell(self, standard_deviation: float | None, preload: float | None) -> tuple[int, int]:
        """Numbers of a standard deviation and a preload of the sample, the last ones by default.

        Raises
        ------
        SettingError
            If the sample has no such value.
        """
        out = []
        for name, value in (("standard_deviation", standard_deviation), ("preload", preload)):
            known = getattr(self, name)
            at = np.flatnonzero(np.isclose(known, known[-1] if value is None else value, rtol=1e-9, atol=0.0))
            if not len(at):
                raise SettingError(f"{name}: expected one of {known.tolist()}, found {value!r}")
            out.append(int(at[0]))
        return out[0], out[1]

    def best_preload(self, q: float = 95.0, standard_deviation: float | None = None) -> BestPreload:
        """The preload that protects the worst blade of ``q`` % of the wheels best, of the preloads of the sample.

        Raises
        ------
        BdamperError
            If no wheel is known at every preload.
        """
        i, _ = self.cell(standard_deviation, None)
        height, error = self.amplitude[:, i], self.error[:, i]
        whole = np.isfinite(height).all(axis=1)
        n = int(whole.sum())
        if not n:
            raise BdamperError("best preload: expected wheels with a peak at every preload, found none")
        ends = [percentile(x, q, e) for x, e in zip(np.where(whole[:, None], height, np.nan).T, error.T)]
        k = int(np.argmin([one.value for one in ends]))
        generator = np.random.default_rng(0)
        bounds = np.stack([height * (1.0 - error), height * (1.0 + error)])[:, whole]
        resamples = 2000  # of a bootstrap over wheels
        drawn = (bounds[:, generator.integers(n, size=n)] for _ in range(resamples))
        again = (np.quantile(some, q / 100.0, axis=1, method="median_unbiased") for some in drawn)
        best = [self.preload[least <= most.min()] for least, most in again]
        low = np.quantile([p.min() for p in best], 0.025, method="nearest")
        high = np.quantile([p.max() for p in best], 0.975, method="nearest")
        edge = self.preload[k] in (self.preload.min(), self.preload.max())
        t = int(np.argmin(np.nan_to_num(self.tuned_amplitude, nan=np.inf)))
        return BestPreload(
            q, float(self.standard_deviation[i]), float(self.preload[k]), ends[k], float(low), float(high),
            "end" if edge else "interior", float(self.preload[t]), float(self.tuned_amplitude[t]), n,
        )  # fmt: skip

    def audit(self, tail: bool = False, tolerance: float = 0.01) -> Audit:
        """The search beside a thorough one: of the wheels drawn before any result, or of the highest of each cell."""
        chosen = np.broadcast_to(np.isin(self.wheels, self.audited)[:, None, None], self.amplitude.shape)
        chosen = highest_wheels(self.amplitude, self.audit_share) if tail else chosen
        status = [s if status_word(s) == FAILED else c for s, c in zip(self.status, self.curve_status)]
        asked = np.array([s != "not asked" and status_word(s) != NOT_RUN for s in status], bool)
        flat = np.flatnonzero(chosen.ravel() & asked)
        i, j, k = np.unravel_index(flat, chosen.shape)
        kind = "highest wheels" if tail else "drawn before any result"
        return Audit(
            kind, self.wheels[i], self.standard_deviation[j], self.preload[k], self.amplitude.ravel()[flat],
            self.curve_amplitude.ravel()[flat], self.error.ravel()[flat],
            validation.number("tolerance", tolerance, above=0.0), tuple(status[n] for n in flat),
        )  # fmt: skip

    def plot_tail(self, *arguments: Any, **options: Any) -> Any:
        """Draw the distribution of one cell with its tail (:func:`bdamper.plot.plot_sample_tail`)."""
        return draw(self, "plot_tail", *arguments, **options)

    def _grid(self) -> dict[str, Any]:
        return {"wheel": self.wheels, "standard_deviation": self.standard_deviation, "preload": self.preload}

    def _facts(self) -> tuple[Fact, ...]:
        """Number of wheels, the amplification factors of every cell, and what the audits say."""
        middle, upper = self.percentile(50.0)[1], self.percentile(95.0)
        cells = [
            Fact(f"factor at {100.0 * d:g} %, {p:g} N", f"median {middle[i, j]:.4g}, 95 % {Interval(*upper[:, i, j])}")
            for i, d in enumerate(self.standard_deviation) for j, p in enumerate(self.preload)
        ]  # fmt: skip
        spent = float(np.nansum(self.processor)), float(np.nansum(self.curve_processor))
        return (
            Fact("wheels", f"{len(self)} of {self.n_blades} blades"),
            Fact("without a peak", sum(status_word(s) == FAILED for s in self.status)),
            Fact("held", int((self.springs > 0.0).sum())),
            *cells,
            *(Fact(f"missed, {a.kind}", f"{a.missed.sum()} of {len(a.wheel)}") for a in map(self.audit, (False, True))),
            Fact("processor", f"{spent[0]:.0f} s, {spent[1]:.0f} s for the audit"),
        )

    def _headline(self) -> str:
        middle, upper = (self.percentile(q)[:, -1, -1] for q in (50.0, 95.0))
        spread, load = f"{100.0 * float(self.standard_deviation[-1]):.3g} %", amount(self.preload[-1], "N")
        ends = f" ({upper[0]:.3g} to {upper[2]:.3g})" if np.isfinite(upper).all() else " (no upper bound from so few)"
        return (
            f"Blades that differ by {spread} raise the highest amplitude by the factor {middle[1]:.3g} in half of "
            f"{len(self)} wheels and by {upper[1]:.3g}{ends} in one of twenty, at a preload of {load}."
        )


# ---- Many wheels ----


_AUDIT = 3
"""Last number of the seed with which audited wheels are drawn."""


@dataclass(frozen=True)
class _Sample:
    """The wheels that are asked for, and the search that each is asked by.

    Parameters
    ----------
    wheel : BladedDisk
        Without mistuning.
    mistuning : callable
        Deviations of a standard deviation and a seed.
    random : mapping
        How wheels are drawn, as their result keeps it.
    options : WheelPeakOptions
        Of the search.
    over : mapping
        Wheels, standard deviations and preloads.
    """

    wheel: BladedDisk
    mistuning: Callable[..., Mistuning]
    random: Mapping[str, Any]
    options: WheelPeakOptions
    over: Mapping[str, Sequence[Any]]

    @property
    def shape(self) -> tuple[int, ...]:
        return tuple(len(values) for values in self.over.values())

    def draw(self, k: int, standard_deviation: float) -> BladedDisk:
        """BladedDisk k."""
        seed, dampers = (self.random["seed"], k), self.random["dampers"]
        wheel = self.wheel.replace(mistuning=self.mistuning(standard_deviation, seed=seed))
        return wheel.replace(dampers=DamperVariation.random(wheel.n_blades, **dampers, seed=seed)) if dampers else wheel

    def audits(self, peaks: list[Record], share: float, drawn: NDArray) -> list[int]:
        """Numbers of the points that are searched again: of wheels drawn before, and of the highest once all are known."""
        if any(status_word(r["status"]) == NOT_RUN for r in peaks):
            return []
        height = np.array([r["values"].get("amplitude", np.nan) for r in peaks]).reshape(self.shape)
        chosen = highest_wheels(height, share) | np.isin(self.over["wheel"], drawn)[:, None, None]
        return [int(i) for i in np.flatnonzero(chosen) if "interval" in peaks[i]["values"]]

    def run(self, settings: Mapping[str, Any]) -> Record:
        """Highest peak of one wheel at one preload, by a thorough search where an interval is given."""
        return recorded(lambda: self._peak(**settings))

    def _peak(
        self, wheel: int, standard_deviation: float, preload: float, interval: tuple[float, float] | None = None
    ) -> Mapping[str, Any]:
        options = thorough(self.options) if interval else self.options
        peak = self.draw(wheel, standard_deviation).peak(preload, interval, options=options)
        return answers(peak) | {"interval": list(peak.interval)}

    def header(self) -> dict[str, Any]:
        """Header that identifies a sample in its results file, which also serves more wheels."""
        over = {name: values for name, values in self.over.items() if name != "wheel"}
        return {
            "format": "bdamper-wheel-sample", "version": 4, **INSTALLED.attributes(),
            "study": study_fingerprint(problem_of(self.wheel.study)), **self.random, **over,
            "options": repr(self.options),
        }  # fmt: skip


def thorough(options: WheelPeakOptions) -> WheelPeakOptions:
    """A search with which another one is audited: half the spacing, three times as many local searches."""
    return replace(
        options, spacing=0.5 * options.spacing, climbs=3 * options.climbs, least=2 * options.least, most=2 * options.most
    )  # fmt: skip


def audit_wheels(wheels: Sequence[int], share: float, seed: int = 0) -> NDArray:
    """Numbers of the wheels that are audited, each drawn by itself with a probability, before any result is known."""
    share = validation.number("audit", share, least=0.0, most=1.0)
    return np.array([k for k in wheels if np.random.default_rng([seed, k, _AUDIT]).random() < share], int)


@validation.check_arguments
@one_thread
def mistuned_sample(
    study: Asking | Problem,
    standard_deviation: float | Sequence[float] | NDArray,
    preload: float | Sequence[float] | NDArray,
    wheels: int | Sequence[int] = 1000,
    *,
    distribution: str | Mistuning = "normal",
    dampers: Mapping[str, Any] | None = None,
    options: WheelPeakOptions | None = None,
    audit: float = 0.05,
    seed: int = 0,
    executor: Executor | None = None,
    resume: str | Path | None = None,
    progress: bool = False,
) -> MistunedSample:
    """The highest blade of many wheels, over the standard deviation of mistuning and the preload.

    Parameters
    ----------
    study : Study
        Of one sector; its model has a local basis.
    standard_deviation : float or (n_deviations,) float
        Of the frequency deviations of the blades clamped at their roots, relative.
    preload : float or (n_preloads,) float, N
    wheels : int or sequence of int
        How many, or which: wheel ``k`` is the same whichever others there are.
    distribution : {"normal", "uniform"} or Mistuning
        As in :meth:`bdamper.mistuning.Mistuning.random`; a measured pattern is drawn from with repetition.
    dampers : mapping, optional
        Relative standard deviations of "mass", "friction_coefficient" and "contact_stiffness", mean of "gap" (m), numbers
        of the dampers "missing", as in :meth:`bdamper.mistuning.DamperVariation.random`; all alike by default.
    options : WheelPeakOptions
        Of the search for each peak.
    audit : float
        Probability with which a wheel, drawn before any result, is searched thoroughly, and share of the highest that are.
    seed : int
        Equal seeds give equal wheels.
    executor, resume, progress
        As in :func:`bdamper.sweep`; a results file serves more wheels, too.

    Returns
    -------
    MistunedSample
        After Ctrl-C, or the death of a worker, with what was finished by then.

    Raises
    ------
    SettingError, ModelError
        If a setting does not fit, or the model has no local basis.
    BdamperError
        If the results file is of another sample, or the tuned wheel has no peak at a preload.
    """
    wheel = BladedDisk(study)
    deviations = validation.numbers("standard_deviation", np.atleast_1d(standard_deviation), least=0.0)
    preloads = validation.numbers("preload", np.atleast_1d(preload), least=0.0, unit="N")
    given = wheels if np.ndim(wheels) else range(validation.integer("wheels", wheels, least=1))
    numbers = validation.integers("wheels", given)
    seed = validation.integer("seed", seed)
    name = distribution.deviation.tolist() if isinstance(distribution, Mistuning) else distribution
    varied = dict(validation.instance("dampers", dampers or {}, Mapping, "variations of dampers by name"))
    drawn = {"distribution": name, "dampers": varied, "seed": seed}
    options = validation.instance("options", options or WheelPeakOptions(), WheelPeakOptions)
    check_executor(executor)
    validation.flag("progress", progress)
    over = {"wheel": numbers, "standard_deviation": deviations.tolist(), "preload": preloads.tolist()}
    mistuning = partial(Mistuning.random, wheel.n_blades, distribution=distribution)
    asked = _Sample(wheel, mistuning, drawn, options, over)
    asked.draw(0, float(deviations.max()))  # deviations or dampers beyond what there can be, or more modes than there are
    audited = audit_wheels(numbers, audit, seed)
    tuned = [wheel.tuned_peak(value) for value in over["preload"]]  # made before the job is sent out
    kept = nullcontext() if resume is None else closing(ResultsFile(resume, asked.header(), "sample of wheels"))
    with kept as store:
        run = partial(run_stored, asked, executor=executor, store=store, progress=progress)
        peaks, curves = _records(asked, audit, audited, run)
    return _result(asked, peaks, curves, tuned=tuned, audited=audited, audit_share=float(audit))


def _records(
    asked: _Sample, audit: float, audited: NDArray, run: Callable[..., list[Record]]
) -> tuple[list[Record], list[Record]]:
    """Records of all peaks and of the thorough searches, empty where none was asked for."""
    cells = list(itertools.product(*asked.over.values()))
    points, names = [dict(zip(asked.over, cell)) for cell in cells], [" ".join(map(str, cell)) for cell in cells]
    peaks = run(points, names, what="wheels", unit="peak")
    at = asked.audits(peaks, audit, audited)
    again = [points[i] | {"interval": peaks[i]["values"]["interval"]} for i in at]
    found = dict(zip(at, run(again, [f"audit {names[i]}" for i in at], what="audit", unit="search")))
    return peaks, [found.get(i, {}) for i in range(len(points))]


def _result(
    asked: _Sample, peaks: list[Record], curves: list[Record], *, tuned: list[Peak], **audit: Any
) -> MistunedSample:
    """The sample from the records of all searches, thorough ones empty where they were not asked for."""

    def array(records: list[Record], name: str, of: str = "values", missing: float = np.nan) -> NDArray:
        return np.array([r.get(of, {}).get(name, missing) for r in records], float).reshape(asked.shape)

    columns: dict[str, Any] = {name: array(peaks, name) for name in OF_PEAKS}
    wheels, deviations, preloads = map(np.array, asked.over.values())
    return MistunedSample(
        n_blades=asked.wheel.n_blades,
        wheels=wheels,
        standard_deviation=deviations,
        preload=preloads,
        **columns,
        **audit,
        tuned_amplitude=np.array([p.amplitude for p in tuned]),
        status=tuple(r["status"] for r in peaks),
        curve_amplitude=array(curves, "amplitude"),
        curve_status=tuple(str(r.get("status", "not asked")) for r in curves),
        processor=array(peaks, "processor", "cost", 0.0),
        curve_processor=array(curves, "processor", "cost", 0.0),
        drawn=dict(asked.random),
        settings=asked.wheel.structure.tuned.record(),
        model_hash=asked.wheel.study.model.hash,
    )
