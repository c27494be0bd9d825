"""What the checks of a default optimum cost, and two versions as a pair.

``python -m benchmarks.bench_checks [blade] [disk]`` computes the default answer of ``optimal_curve`` in a process of its
own, and prints the processor time, the elapsed time, and the elapsed time of each check that has one.

``... --against PYTHON`` alternates with the version that another interpreter imports, ``--pairs`` times (2 by default), and
prints the ratios.  Times of machines cannot be compared, and one machine drifts within hours, so that only the ratios of
such pairs say which version is faster.  An idle machine is needed for elapsed times; ``--workers 1`` gives processor
times that hardly depend on other work.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import time
from typing import Any

ANSWERS = {
    "blade": ("turbine_blade", (30.0, 1000.0)),
    "disk": ("bladed_disk", (20.0, 2000.0)),
}
"""Models and ranges of the preload (N) of the default answers, with one newton at the tip."""
PROGRAM = """
import json, warnings
import bdamper as bd
warnings.simplefilter("ignore")
if {workers} and hasattr(bd, "set_workers"):
    bd.set_workers({workers})
tip = bd.Excitation("tip", direction="tangential")
study = bd.Study(bd.reference_model("{model}"), tip, engine_order=5, friction_coefficient=0.3)
curve = study.optimal_curve({preloads}, 12, progress=False)
try:
    from bdamper.response.optimum_checks import checks as checks_of
    run = [check for check in checks_of(curve) if check.colour != "white"]
    checks = [(check.name, getattr(check, "seconds", None)) for check in run]
except ImportError:
    checks = []
print(json.dumps({{
    "version": bd.__version__,
    "preload": curve.optimum.preload,
    "amplitude": curve.optimum.amplitude,
    "checks": [(name, seconds) for name, seconds in checks if seconds and seconds == seconds],
}}))
"""


def timed(python: str, answer: str, workers: int) -> dict[str, Any]:
    """Compute a default answer with an interpreter, and return it with its processor and elapsed time (s)."""
    model, preloads = ANSWERS[answer]
    program = PROGRAM.format(model=model, preloads=preloads, workers=workers)
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    start = time.perf_counter()
    output = subprocess.run(
        [python, "-c", program], stdout=subprocess.PIPE, text=True, check=True
    ).stdout
    elapsed = time.perf_counter() - start
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    processor = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    found: dict[str, Any] = json.loads(output.splitlines()[-1])
    return found | {"processor": processor, "elapsed": elapsed}


def show(answer: str, found: dict[str, Any]) -> None:
    """Print the times of an answer."""
    place = f"{found['preload']:.4g} N, {1e6 * found['amplitude']:.4g} µm by harmonic balance"
    print(f"{answer}, version {found['version']}: {place}")
    print(f"  processor {found['processor']:.1f} s, elapsed {found['elapsed']:.1f} s")
    for name, seconds in found["checks"]:
        print(f"  {name:<40} {seconds:8.1f} s")


def main() -> None:
    """Print the times of the default answers."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("answers", nargs="*", choices=[*ANSWERS, []], default=[])
    parser.add_argument("--against", metavar="PYTHON")
    parser.add_argument("--pairs", type=int, default=2)
    parser.add_argument("--workers", type=int, default=0)
    given = parser.parse_args()
    for answer in given.answers or ANSWERS:
        for pair in range(given.pairs if given.against else 1):
            own = timed(sys.executable, answer, given.workers)
            if pair == 0:
                show(answer, own)
            if given.against:
                other = timed(given.against, answer, given.workers)
                processor = own["processor"] / other["processor"]
                elapsed = own["elapsed"] / other["elapsed"]
                versions = f"{own['version']} over {other['version']}"
                print(f"{answer}, {versions}: processor {processor:.2f}, elapsed {elapsed:.2f}")
        print(flush=True)


if __name__ == "__main__":
    main()
