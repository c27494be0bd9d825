"""Many mistuned wheels of the shipped disk with nine contact points, 65 blades: time, audit, harmonics, best preload.

``python -m benchmarks wheel_sample`` runs four samples, one after the other:

``many``      1,000 wheels, one harmonic, standard deviation 2 %, 500 N, with the audits of 5 % by a thorough search
``deviation`` 50 wheels, drawn before any result, over standard deviations at three preloads, one harmonic
``preload1``, ``preload3``
              the same 50 wheels over the preload, with one harmonic and with three and residual flexibility

and prints what they show.  ``python -m benchmarks.bench_wheel_sample many 200`` runs one of them, with so many wheels.
Every sample goes on where it was interrupted, with more wheels, too: finished wheels stand in
``benchmarks/results/wheel_<name>.jsonl``, what is complete in ``wheel_<name>.h5``.
"""

from __future__ import annotations

import resource
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

import bdamper as bd
from bdamper.wheel import MistunedSample

RESULTS = Path(__file__).parent / "results"
WHEELS, FEW, SHARE = 1000, 50, 0.05
PRELOADS = (250.0, 350.0, 500.0, 700.0, 1000.0, 1400.0, 2000.0)
SAMPLES: dict[str, dict[str, Any]] = {
    "many": {"standard_deviation": 0.02, "preload": 500.0, "audit": SHARE},
    "deviation": {"standard_deviation": (0.0025, 0.005, 0.01, 0.02, 0.04), "preload": (250.0, 500.0, 2000.0), "audit": 0.0},
    "preload1": {"standard_deviation": 0.02, "preload": PRELOADS, "audit": 0.0},
    "preload3": {"standard_deviation": 0.02, "preload": PRELOADS, "audit": 0.0},
}


def study(harmonics: int) -> bd.Study:
    """The scene; attachments of the local basis carry the flexibility of the contacts in either."""
    settings = {"contact_stiffness": "unit_traction"} if harmonics == 1 else {}
    excitation = bd.Excitation("tip", direction="tangential", amplitude=1.0)
    model = bd.reference_model("bladed_disk", contact_points=9)
    return bd.Study(model, excitation, 5, friction_coefficient=0.4, harmonics=harmonics, **settings)


def run(name: str, wheels: int | None = None) -> MistunedSample:
    """One sample, from its files as far as it is there."""
    numbers = range(wheels or (WHEELS if name == "many" else FEW))
    start = time.perf_counter()
    with ProcessPoolExecutor(2, get_context("spawn")) as pool:
        sample = bd.mistuned_sample(
            study(3 if name == "preload3" else 1), wheels=numbers, executor=pool, progress=True,
            resume=RESULTS / f"wheel_{name}.jsonl", **SAMPLES[name],
        )  # fmt: skip
    if any(s.startswith("not run") for s in (*sample.status, *sample.curve_status)):
        print(sample)
        sys.exit("interrupted: run it again to go on")
    sample.save(RESULTS / f"wheel_{name}.h5")
    memory = max(resource.getrusage(who).ru_maxrss for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)) / 1024.0
    spent = float(sample.processor.sum())
    print(
        f"\n## {name}: {time.perf_counter() - start:.0f} s in this run; peaks {spent:.0f} s of the processor, "
        f"{spent / 120.0:.1f} min on two cores, {spent / sample.processor.size:.2f} s each; {memory:.0f} MB\n\n{sample}\n"
    )
    return sample


def harmonics_compared(one: MistunedSample, three: MistunedSample) -> None:
    """Ratios of amplification factors, and of best preloads, of the same wheels with one harmonic and with three."""
    print("| preload | tuned | median of the ratio of factors | 5 to 95 % of wheels | largest | wheels |")
    print("|---|---|---|---|---|---|")
    ratio = three.amplification / one.amplification
    for j, preload in enumerate(one.preload):
        known = ratio[:, 0, j][np.isfinite(ratio[:, 0, j])]
        low, median, high = np.quantile(known, [0.05, 0.5, 0.95]) if len(known) else [np.nan] * 3
        top = known[np.argmax(np.abs(np.log(known)))] if len(known) else np.nan
        tuned = three.tuned_amplitude[j] / one.tuned_amplitude[j]
        print(f"| {preload:g} N | {tuned:.3f} | {median:.3f} | {low:.3f} to {high:.3f} | {top:.3f} | {len(known)} |")
    known = np.isfinite(one.amplitude[:, 0]).all(axis=1) & np.isfinite(three.amplitude[:, 0]).all(axis=1)
    best = [s.preload[np.argmin(s.amplitude[known, 0], axis=1)] for s in (one, three)]
    if known.any():
        print(f"\nbest preload of each wheel, three harmonics over one: median {np.median(best[1] / best[0]):.3f}, "
              f"{np.mean(best[0] == best[1]):.0%} of {known.sum()} wheels the same")  # fmt: skip
        for name, sample in (("one harmonic", one), ("three harmonics", three)):
            print(f"{name}: {sample.best_preload(99.0)}")


def main(asked: str = "", wheels: int | None = None) -> None:
    """Run one sample, or all, and print what they show."""
    found = {name: run(name, wheels) for name in ([asked] if asked else SAMPLES)}
    if "many" in found:
        for tail in (False, True):
            print(found["many"].audit(tail), "\n")
        print(found["many"].tail(), "\n")
    if "preload1" in found and "preload3" in found:
        harmonics_compared(found["preload1"], found["preload3"])


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "", int(sys.argv[2]) if len(sys.argv) > 2 else None)
