"""Mistuned wheels of the shipped disk, nine contact points, 65 blades: amplification factors, their tail, the best preload.

``python -m benchmarks wheel_sample`` asks wheels of 2 % (standard deviation of blade frequencies) for their highest blade
at 500, 1,000 and 2,000 N with one harmonic, audits a twentieth of them by a search with three times the climbs, prints what
they show and draws the pictures of docs/wheel.md.  ``python -m benchmarks.bench_wheel_sample 60`` takes sixty wheels,
``python -m benchmarks.bench_wheel_sample 6 3`` six with three harmonics, at 2,000 N alone and without audits since a peak
takes ten times as long, which are compared with the former.

Peaks are kept in ``benchmarks/results/wheel_<harmonics>.jsonl`` as they come, so that a sample goes on where it was
interrupted, with more wheels, too; what is complete with one harmonic is ``bdamper/data/wheels.h5``.
"""

from __future__ import annotations

import sys
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import numpy as np

import bdamper as bd
from bdamper.mistuning import BladedDisk, MistunedSample, Mistuning
from bdamper.plot import save_figure

RESULTS, IMAGES = Path(__file__).parent / "results", Path(__file__).parents[1] / "docs/images"
WHEELS, DEVIATION, PRELOADS, AUDIT = 300, 0.02, (500.0, 1000.0, 2000.0), 0.05


def study(harmonics: int) -> bd.Study:
    """The scene; attachments of the local basis carry the flexibility of the contacts in either."""
    settings = {"contact_stiffness": "unit_traction"} if harmonics == 1 else {}
    excitation = bd.Excitation("tip", direction="tangential", amplitude=1.0)
    model = bd.reference_model("bladed_disk", contact_points=9)
    return bd.Study(model, excitation, 5, friction_coefficient=0.4, harmonics=harmonics, **settings)


def place(harmonics: int) -> Path:
    """Where a complete sample is kept."""
    return (
        Path(bd.__file__).parent / "data/wheels.h5"
        if harmonics == 1
        else RESULTS / f"wheels_{harmonics}.h5"
    )


def run(wheels: int, harmonics: int) -> MistunedSample:
    """The sample, from its file as far as it is there."""
    preloads, audit = (PRELOADS, AUDIT) if harmonics == 1 else (PRELOADS[-1:], 0.0)
    with ProcessPoolExecutor(2, get_context("spawn")) as pool:
        sample = bd.mistuned_sample(
            study(harmonics), DEVIATION, preloads, wheels, audit=audit, executor=pool, progress=True,
            resume=RESULTS / f"wheel_{harmonics}.jsonl",
        )  # fmt: skip
    if any(s.startswith("not run") for s in (*sample.status, *sample.curve_status)):
        print(sample)
        sys.exit("interrupted: run it again to go on")
    sample.save(place(harmonics))
    return sample


def stored(harmonics: int = 1) -> MistunedSample:
    """The sample as it is kept."""
    sample = bd.load(place(harmonics))
    assert isinstance(sample, MistunedSample)
    return sample


def show(sample: MistunedSample) -> None:
    """What the sample says, in words and as a table."""
    print(sample.summary())
    print(
        "| preload | tuned | median | 95 % of wheels | highest | held |\n|---|---|---|---|---|---|"
    )
    median, upper = sample.percentile(50.0), sample.percentile(95.0)
    for j, preload in enumerate(sample.preload):
        factor, springs = sample.amplification[:, 0, j], sample.springs[:, 0, j]
        cells = [
            f"{v[1, 0, j]:.2f} ({v[0, 0, j]:.2f} to {v[2, 0, j]:.2f})".replace("inf", "?")
            for v in (median, upper)
        ]
        cells += [f"{np.nanmax(factor):.2f}", f"{np.mean(springs[np.isfinite(springs)] > 0.0):.0%}"]
        print(
            f"| {preload:,.0f} N | {1e3 * sample.tuned_amplitude[j]:.3f} mm | {' | '.join(cells)} |"
        )
    print(sample.best_preload(95.0))
    for preload in sample.preload:
        print(f"{preload:g} N: {sample.tail(preload=float(preload), tail=in_tail(sample))}")
    for tail in (False, True):
        print(sample.audit(tail))


def in_tail(sample: MistunedSample) -> float:
    """Share of the wheels that the fit of the tail sees: half, and all of a sample so small that half are too few."""
    return 0.5 if len(sample) >= 20 else 1.0


def draw(sample: MistunedSample) -> None:
    """The pictures of docs/wheel.md: factors over the preload, their distribution at the highest, and one wheel."""
    percentiles = (50.0, 95.0)
    save_figure(
        sample.plot(over="preload", percentiles=percentiles), IMAGES / "wheel-amplification.png"
    )
    save_figure(
        sample.plot(over="preload", quantity="amplitude", percentiles=percentiles),
        IMAGES / "wheel-preload.png",
    )
    save_figure(sample.plot_tail(tail=in_tail(sample)), IMAGES / "wheel-tail.png")
    wheel = BladedDisk(study(1), Mistuning.random(sample.n_blades, DEVIATION, seed=(0, 1)))
    save_figure(wheel.peak(PRELOADS[-1]).plot_wheel(wheel.study.model), IMAGES / "wheel-front.png")


def compare(one: MistunedSample, three: MistunedSample) -> None:
    """Ratios of amplitudes and amplification factors of the same wheels, three harmonics over one."""
    both = np.isin(one.disks, three.disks)
    for j, preload in enumerate(three.preload):
        at = both, 0, int(np.flatnonzero(one.preload == preload)[0])
        ratios = (
            three.amplitude[:, 0, j] / one.amplitude[at],
            three.amplification[:, 0, j] / one.amplification[at],
        )
        ends = (np.nanquantile(v, [0.0, 0.5, 1.0]) for v in ratios)
        print(
            f"{preload:g} N, three harmonics over one:",
            *("{1:.3f} ({0:.3f} to {2:.3f})".format(*e) for e in ends),
        )


def main(wheels: int = WHEELS, harmonics: int = 1) -> None:
    """Run a sample, print and draw what it shows."""
    sample = run(wheels, harmonics)
    if harmonics == 1:
        show(sample)
        draw(sample)
    else:
        print(sample.summary())
        compare(stored(), sample)


if __name__ == "__main__":
    main(*(int(a) for a in sys.argv[1:]))
