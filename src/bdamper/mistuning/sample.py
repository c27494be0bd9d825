"""Many wheels: the highest blade of each, on any executor, in a file that survives an interruption, with its own audit.

BladedDisk ``k`` has the deviations (and dampers) that are drawn with the seed ``(seed, k)``: one unit pattern, scaled to
every standard deviation, so that wheels are the same at every preload and every standard deviation, and the same in a
study with more harmonics.  A sample can be continued with more wheels in the same results file.

**Audit.**  The highest peak is that of a coarse sweep and local searches (:mod:`bdamper.mistuning.peak_search`), which can
miss it. So a share of the wheels, drawn by their numbers before any result is known, is searched again with half the
spacing and three times as many searches; and after the sample so is the same share of the highest wheels in each cell,
since the tail is what is quoted.  Both searches free their dampers, and it is the freed peaks that are compared.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import closing, nullcontext
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bdamper.analyses.executors import Record, check_executor, recorded, run_stored
from bdamper.harmonic_balance.parameters import study_fingerprint
from bdamper.harmonic_balance.problem import Problem
from bdamper.harmonic_balance.study_dispatch import Asking, problem_of
from bdamper.mistuning.mistuning import DamperVariation, Mistuning
from bdamper.mistuning.optimal import OF_PEAKS, answers
from bdamper.mistuning.peak import WheelPeakOptions
from bdamper.mistuning.sample_result import MistunedSample, highest_wheels
from bdamper.mistuning.wheel import BladedDisk
from bdamper.response.peak import Peak
from bdamper.util import validation
from bdamper.util.checkpoint_file import ResultsFile
from bdamper.util.status import NOT_RUN, word
from bdamper.util.threading import one_thread
from bdamper.util.versions import HERE

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
        if any(word(r["status"]) == NOT_RUN for r in peaks):
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
            "format": "bdamper-wheel-sample", "version": 4, **HERE.attributes(),
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


@validation.spelt
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
    numbers = validation.wholes("wheels", wheels if np.ndim(wheels) else range(validation.whole("wheels", wheels, least=1)))
    seed = validation.whole("seed", seed)
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
