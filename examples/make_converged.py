"""Compute the converged results for the paper's figures, which take long, and store them in
``examples/converged``.

    python examples/make_converged.py           what is missing
    python examples/make_converged.py mode_1    again what begins so

The computation takes about six minutes of processor time; each result has its own file. Curves are
stored without their unknowns.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache, partial
from typing import Any

import numpy as np
from paper_disk import (
    DAMPING_RATIO,
    MODES,
    MOTION_PRELOADS,
    POINTS_PRELOADS,
    RIG_BAND,
    RIG_LOADS,
    RIG_PLAIN,
    ROTATION_PRELOADS,
    STORED,
    TRANSLATIONS,
    motion_over_preload,
    rig_study,
    study,
)  # fmt: skip

import bdamper as bd
from bdamper.response.optimal_curve_result import OptimalCurve
from bdamper.response.response_curve_result import ResponseCurve


def tracking(preload: float, mode: int = 1, **settings: Any) -> ResponseCurve:
    """Compute a response curve without its unknowns."""
    curve = study(mode, **settings).frequency_response(preload, MODES[mode].band)
    return replace(curve, unknowns=np.empty((len(curve), 0)))


def optimal(
    asked: bd.Study, interval: tuple[float, float], n: int, band: tuple[float, float]
) -> OptimalCurve:
    """Compute an optimal curve without its unknowns."""
    curve = asked.optimal_curve(interval, n, frequency=band, check=False)
    return replace(curve, unknowns=np.empty((len(curve), 0)))


@cache
def model(n: int) -> bd.Model:
    """Return the disk with a different grid of contact points, which requires the finite element
    model (``bdamper[fe]``).
    """
    from bdamper.fem import MeshDensity, SectorFE, bladed_disk
    from bdamper.fem.meshes import paper_geometry

    fe = SectorFE(paper_geometry(), MeshDensity.preset("coarse"))
    return bladed_disk(
        {9: (3, 3), 48: (4, 12)}[n], fe=fe, n_modes=20, harmonics=3, damping_ratio=DAMPING_RATIO
    )


def points(n: int, preload: float) -> ResponseCurve:
    """Compute a response curve with a different number of contact points."""
    return tracking(preload, model=model(n))


def jobs() -> Iterator[tuple[str, Callable[[], Any]]]:
    """Return the functions that compute the files, by file name."""
    lowest = POINTS_PRELOADS[0]
    for mode, driven in MODES.items():
        more = (*ROTATION_PRELOADS, lowest) if mode == 1 else ()
        for preload in sorted({*driven.preloads, *more}):
            yield f"mode_{mode}_{preload:g}N", partial(tracking, preload, mode)
    for preload in ROTATION_PRELOADS:
        yield f"translations_{preload:g}N", partial(tracking, preload, rigid_modes=TRANSLATIONS)
    yield "rigid_motion", partial(motion_over_preload, study(1), MOTION_PRELOADS[::2])
    for mode, driven in MODES.items():
        interval = (20.0, driven.interval[1]) if mode < 3 else driven.interval
        yield f"optimal_{mode}", partial(optimal, study(mode), interval, 15, driven.band)
    for n in (9, 48):
        yield f"points_{n}_{lowest:g}N", partial(points, n, lowest)
    yield "optimal_rig", partial(optimal, rig_study(), RIG_LOADS, 20, RIG_BAND)
    yield (
        "optimal_rig_40_modes",
        partial(optimal, rig_study(**RIG_PLAIN, blade_modes=40), RIG_LOADS, 30, RIG_BAND),
    )


def save(result: Any, name: str) -> str:
    """Write a result to its file, and print a description."""
    if isinstance(result, dict):
        np.savez_compressed(STORED / f"{name}.npz", **result)
        return f"{len(result)} arrays"
    result.save(STORED / f"{name}.h5")
    return result._headline()


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "name", nargs="?", default="", help="only the files whose names begin so, and those again"
    )
    wanted = parser.parse_args().name
    STORED.mkdir(exist_ok=True)
    for name, job in jobs():
        if name.startswith(wanted) if wanted else not list(STORED.glob(f"{name}.*")):
            start = time.process_time()
            what = save(job(), name)
            print(f"{name}: {time.process_time() - start:.1f} s; {what}", flush=True)


if __name__ == "__main__":
    main()
