"""Compute the converged counterparts of the paper's figures and store them in ``examples/converged``.

    python examples/make_converged.py           what is missing
    python examples/make_converged.py mode_1    again what begins so

Some five minutes of processor time in all, and each file its own.  Curves are stored without their unknowns.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache, partial
from typing import Any

import fig06_07_tracking as fig06
import fig08_09_optimal as fig08
import fig10_11_higher_modes as fig10
import fig12_13_rigid_body_motion as fig12
import fig14_rotation as fig14
import fig15_16_contact_points as fig15
import numpy as np
from paper_disk import MODES, STORED, study

import bdamper as bd
from bdamper.continuation.curve import Curve
from bdamper.peaks.optimal_curve import OptimalCurve


def tracking(preload: float, mode: int = 1, **settings: Any) -> Curve:
    """A tracking curve without its unknowns."""
    curve = study(mode, **settings).track(preload, MODES[mode].band)
    return replace(curve, unknowns=np.empty((len(curve), 0)))


def optimal(mode: int, interval: tuple[float, float], n: int) -> OptimalCurve:
    """An optimal curve without its unknowns."""
    curve = study(mode).optimal_curve(interval, n, frequency=MODES[mode].band, check=False)
    return replace(curve, unknowns=np.empty((len(curve), 0)))


@cache
def model(n: int) -> bd.Model:
    """The disk with another grid of contact points, which needs the finite element model (``bdamper[fe]``)."""
    from bdamper.fe import MeshDensity, SectorFE, bladed_disk
    from bdamper.fe.geometry import paper_geometry

    fe = SectorFE(paper_geometry(), MeshDensity.preset("coarse"))
    return bladed_disk({9: (3, 3), 48: (4, 12)}[n], fe=fe, n_modes=20, harmonics=3, damping_ratio=0.0021)


def points(n: int, preload: float) -> Curve:
    """A tracking curve with another number of contact points."""
    return tracking(preload, model=model(n))


def rigid_motion() -> dict[str, np.ndarray]:
    """Rigid-body motion of the damper at the resonance of mode 1."""
    return fig12.motion_over_preload(study(1), fig12.PRELOADS[::2])


def jobs() -> Iterator[tuple[str, Callable[[], Any]]]:
    """Names of the files and what computes them."""
    preloads = {1: fig06.PRELOADS[1] + fig14.PRELOADS + fig15.PRELOADS, 2: fig06.PRELOADS[2]}
    preloads |= {mode: case.preloads for mode, case in fig10.CASES.items()}
    for mode, values in preloads.items():
        for preload in sorted(set(values)):
            yield f"mode_{mode}_{preload:g}N", partial(tracking, preload, mode)
    for preload in fig14.PRELOADS:
        yield f"translations_{preload:g}N", partial(tracking, preload, rigid_modes=("TX", "TY", "TZ"))
    yield "rigid_motion", rigid_motion
    for mode in (2, 1):
        yield f"optimal_{mode}", partial(optimal, mode, (20.0, fig08.INTERVAL[1]), 15)
    for n in (9, 48):
        yield f"points_{n}_{fig15.PRELOADS[0]:g}N", partial(points, n, fig15.PRELOADS[0])


def save(result: Any, name: str) -> str:
    """Writes a result and says what it is."""
    if isinstance(result, dict):
        np.savez_compressed(STORED / f"{name}.npz", **result)
        return f"{len(result)} arrays"
    result.save(STORED / f"{name}.h5")
    return str(result).splitlines()[1].strip()


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("name", nargs="?", default="", help="only the files whose names begin so, and those again")
    wanted = parser.parse_args().name
    STORED.mkdir(exist_ok=True)
    for name, job in jobs():
        if name.startswith(wanted) if wanted else not list(STORED.glob(f"{name}.*")):
            start = time.process_time()
            what = save(job(), name)
            print(f"{name}: {time.process_time() - start:.1f} s; {what}", flush=True)


if __name__ == "__main__":
    main()
