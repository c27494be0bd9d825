"""Many wheels: the highest blade of each, on any executor, in a file that survives an interruption, with its own audit.

Wheel ``k`` has the deviations (and dampers) that are drawn with the seed ``(seed, k)``: one unit pattern, scaled to every
standard deviation, so that wheels are the same at every preload and every standard deviation, and the same in a study with
more harmonics.  A sample can be continued with more wheels in the same results file.

**Audit.**  The highest peak is that of a coarse sweep and some climbs (:mod:`bdamper.wheel.search`), which can miss it.  So
a share of the wheels, drawn by their numbers before any result is known, is searched again with half the spacing and three
times the climbs; and after the sample so is the same share of the highest wheels in each cell, since the tail is what is
quoted.  Both searches free their dampers, and it is the freed peaks that are compared.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from contextlib import closing, nullcontext
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bdamper.design.workers import check_executor, run_stored
from bdamper.problem.problem import Problem
from bdamper.problem.variation import study_fingerprint
from bdamper.util import validate
from bdamper.util.blas import one_thread
from bdamper.util.cost import Cost
from bdamper.util.errors import BdamperError
from bdamper.util.progress import LongWork
from bdamper.util.results_file import ResultsFile
from bdamper.util.status import COMPLETE, FAILED, NOT_RUN, because, word
from bdamper.util.versions import HERE
from bdamper.wheel.mistuning import DISTRIBUTIONS, DamperVariation, Mistuning
from bdamper.wheel.peak import WheelPeakOptions
from bdamper.wheel.sample_result import MistunedSample, highest_wheels
from bdamper.wheel.wheel import Wheel

_AUDIT = 3
"""Last number of the seed with which audited wheels are drawn."""
OF_PEAKS = "amplitude", "frequency", "blade", "residual", "springs", "error"
_VARIED = ("mass", "friction_coefficient", "contact_stiffness", "gap", "missing")


@dataclass(frozen=True)
class _Job:
    """What all wheels have in common."""

    wheel: Wheel
    distribution: str | Mistuning
    mean: str
    modes: int | None
    dampers: Mapping[str, Any] | None
    frequency: tuple[float, float] | None
    options: WheelPeakOptions
    seed: int

    def drawn(self, k: int, standard_deviation: float) -> Wheel:
        """Wheel k."""
        n, seed = self.wheel.n_blades, (self.seed, k)
        mistuning = Mistuning.drawn(n, standard_deviation, self.distribution, modes=self.modes, seed=seed)
        changes: dict[str, Any] = {"mistuning": mistuning.without_mean() if self.mean == "taken out" else mistuning}
        if self.dampers is not None:
            changes["dampers"] = DamperVariation.drawn(n, **self.dampers, seed=seed)
        return self.wheel.with_(**changes)

    def run(self, settings: Mapping[str, Any]) -> dict[str, Any]:
        """Highest peak of one wheel at one preload, by a thorough search where an interval is given."""
        status, cost = COMPLETE, Cost()
        values: dict[str, Any] = {}
        try:
            with LongWork() as work:
                wheel = self.drawn(settings["wheel"], settings["standard_deviation"])
                options = thorough(self.options) if "interval" in settings else replace(self.options, connected=False)
                peak = wheel.peak(settings["preload"], settings.get("interval", self.frequency), options=options)
                if not peak.found:
                    raise BdamperError(f"{peak.status}: {peak.reason}")
                cost, values = peak.cost, {name: getattr(peak, name) for name in OF_PEAKS}
                values |= {
                    "climbs": len(peak.climbs), "points": len(peak.sweep_frequency), "interval": list(peak.interval)
                }  # fmt: skip
            if work.interrupted:
                raise KeyboardInterrupt
        except (BdamperError, ArithmeticError, np.linalg.LinAlgError) as error:
            status = because(FAILED, error)
        return {"status": status, "values": values, "seconds": cost.seconds, "cost": asdict(cost)}


def thorough(options: WheelPeakOptions) -> WheelPeakOptions:
    """A search with which another one is audited: half the spacing, three times the climbs."""
    return replace(
        options, spacing=0.5 * options.spacing, climbs=3 * options.climbs, least=2 * options.least, most=2 * options.most,
        connected=False,
    )  # fmt: skip


def audit_wheels(wheels: Sequence[int], share: float, seed: int = 0) -> NDArray:
    """Numbers of the wheels that are audited, each drawn by itself with a probability, before any result is known."""
    share = validate.number("audit", share, least=0.0, most=1.0)
    return np.array([k for k in wheels if np.random.default_rng([seed, k, _AUDIT]).random() < share], int)


@one_thread
def mistuned_sample(
    study: Problem,
    standard_deviation: float | Sequence[float] | NDArray,
    preload: float | Sequence[float] | NDArray,
    wheels: int | Sequence[int] = 1000,
    *,
    distribution: str | Mistuning = "normal",
    mean: str = "kept",
    modes: int | None = None,
    dampers: Mapping[str, Any] | None = None,
    frequency: tuple[float, float] | None = None,
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
        As in :meth:`bdamper.wheel.Mistuning.drawn`; a measured pattern is drawn from with repetition.
    mean : {"kept", "taken out"}
        Whether the mean of the deviations of each wheel is as it was drawn.
    modes : int, optional
        Independent deviations for so many cantilever modes of each blade.
    dampers : mapping, optional
        Relative standard deviations of "mass", "friction_coefficient" and "contact_stiffness", mean of "gap" (m), numbers
        of the dampers "missing", as in :meth:`bdamper.wheel.DamperVariation.drawn`; all alike by default.
    frequency, options
        Of the search for each peak, as in ``Wheel.peak``.
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
    wheel = Wheel(study)
    deviations = validate.numbers("standard_deviation", np.atleast_1d(standard_deviation), least=0.0)
    preloads = validate.numbers("preload", np.atleast_1d(preload), least=0.0, unit="N")
    numbers = validate.wholes("wheels", wheels if np.ndim(wheels) else range(validate.whole("wheels", wheels, least=1)))
    if not isinstance(distribution, Mistuning):
        validate.choice("distribution", distribution, DISTRIBUTIONS)
    validate.choice("mean", mean, ("kept", "taken out"))
    seed = validate.whole("seed", seed)
    options = validate.instance("options", options or WheelPeakOptions(), WheelPeakOptions)
    frequency = None if frequency is None else validate.interval("frequency", frequency)
    check_executor(executor)
    validate.flag("progress", progress)
    given = None if dampers is None else dict(validate.mapping("dampers", dampers, _VARIED, "variations of dampers"))
    job = _Job(wheel, distribution, mean, modes, given, frequency, options, seed)
    job.drawn(0, float(deviations.max()))  # deviations or dampers beyond what there can be, or more modes than there are
    asked = _Asked(numbers, deviations, preloads, float(audit), audit_wheels(numbers, audit, seed))
    for value in preloads:
        wheel.tuned_peak(float(value))  # made before the job is sent out
    kept = nullcontext() if resume is None else closing(ResultsFile(resume, _header(job, asked), "sample of wheels"))
    with kept as store:
        return _result(job, asked, *_records(job, asked, executor, store, progress))


@dataclass(frozen=True)
class _Asked:
    """Wheels, standard deviations, preloads, share of the audits, and the wheels to be audited whatever they show."""

    wheels: tuple[int, ...]
    deviations: NDArray
    preloads: NDArray
    audit: float
    audited: NDArray

    @property
    def shape(self) -> tuple[int, int, int]:
        return len(self.wheels), len(self.deviations), len(self.preloads)

    def points(self) -> list[dict[str, Any]]:
        """Every wheel at every standard deviation and preload, wheel by wheel."""
        grid = itertools.product(self.wheels, self.deviations.tolist(), self.preloads.tolist())
        return [dict(zip(("wheel", "standard_deviation", "preload"), cell)) for cell in grid]


def _header(job: _Job, asked: _Asked) -> dict[str, Any]:
    """What identifies a sample in its results file."""
    return {
        "format": "bdamper-wheel-sample", "version": 4, **HERE.attributes(), "study": study_fingerprint(job.wheel.study),
        **_drawn(job), "standard_deviation": asked.deviations.tolist(), "preload": asked.preloads.tolist(),
        "frequency": job.frequency, "options": repr(job.options),
    }  # fmt: skip


def _drawn(job: _Job) -> dict[str, Any]:
    """How the wheels were drawn."""
    pattern = job.distribution.deviation.tolist() if isinstance(job.distribution, Mistuning) else job.distribution
    return {
        "distribution": pattern, "mean": job.mean, "modes": job.modes or 1, "dampers": job.dampers or {}, "seed": job.seed
    }  # fmt: skip


def _records(
    job: _Job, asked: _Asked, executor: Executor | None, store: ResultsFile | None, progress: bool
) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Records of all peaks and of the thorough searches, empty where none was asked for."""
    points = asked.points()
    names = [" ".join(str(value) for value in point.values()) for point in points]
    peaks = run_stored(job, points, names, executor, store, progress, "wheels", "peak")
    curves: list[dict[str, Any]] = [{} for _ in points]
    if any(word(r["status"]) == NOT_RUN for r in peaks):
        return peaks, curves
    height = np.array([r["values"].get("amplitude", np.nan) for r in peaks]).reshape(asked.shape)
    whole = highest_wheels(height, asked.audit) | np.isin(asked.wheels, asked.audited)[:, None, None]
    at = [int(i) for i in np.flatnonzero(whole) if "interval" in peaks[i]["values"]]
    audited = [points[i] | {"interval": peaks[i]["values"]["interval"]} for i in at]
    again = [f"audit {names[i]}" for i in at]
    for i, record in zip(at, run_stored(job, audited, again, executor, store, progress, "audit", "search")):
        curves[i] = record
    return peaks, curves


def _result(job: _Job, asked: _Asked, peaks: list[dict[str, Any]], curves: list[dict[str, Any]]) -> MistunedSample:
    tuned = [job.wheel.tuned_peak(float(p)) for p in asked.preloads]

    def array(records: list[dict[str, Any]], name: str, of: str = "values", missing: float = np.nan) -> NDArray:
        return np.array([r.get(of, {}).get(name, missing) for r in records], float).reshape(asked.shape)

    columns: dict[str, Any] = {name: array(peaks, name) for name in OF_PEAKS}
    return MistunedSample(
        n_blades=job.wheel.n_blades,
        wheels=np.array(asked.wheels),
        standard_deviation=asked.deviations,
        preload=asked.preloads,
        **columns,
        tuned_amplitude=np.array([p.amplitude for p in tuned]),
        tuned_frequency=np.array([p.frequency for p in tuned]),
        status=tuple(r["status"] for r in peaks),
        audited=asked.audited,
        audit_share=asked.audit,
        curve_amplitude=array(curves, "amplitude"),
        curve_status=tuple(str(r.get("status", "not asked")) for r in curves),
        processor=array(peaks, "processor", "cost", 0.0),
        curve_processor=array(curves, "processor", "cost", 0.0),
        drawn=_drawn(job),
        settings=job.wheel.tuned().record(),
        model_hash=job.wheel.study.model.hash,
    )
