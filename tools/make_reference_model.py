"""Make the shipped models, or check that they can still be made.

    python tools/make_reference_model.py            writes bdamper/data/bladed_disk_{9,24,48}.h5,
                                                    paper_disk_{9,24,48}.h5, blade_to_ground_24.h5
                                                    and test_rig_24.h5
    python tools/make_reference_model.py test_rig   writes only the files whose names start so
    python tools/make_reference_model.py --check    makes them again and compares with the stored ones

Squared frequencies and receptances must agree to a relative 1e-6 (they differ in rounding between machines),
and so must the projections of the modes, taken together over the modes so that a rotation among close
frequencies does not count.
"""

from __future__ import annotations

import argparse
import dataclasses
import functools
import sys
import time
from pathlib import Path

import numpy as np

from bdamper.fe.blade_to_ground import blade_to_ground
from bdamper.fe.geometry import Geometry, paper_geometry
from bdamper.fe.mesh import MeshDensity
from bdamper.fe.reference import bladed_disk
from bdamper.fe.rig import rig
from bdamper.fe.sector import SectorFE
from bdamper.io.model_file import load_model, save_model
from bdamper.model.model import Model
from bdamper.reduction import LocalSizes

POINTS = (9, 24, 48)
WHEEL_POINTS = 9
"""Contact points of the model that serves wheels of unequal blades too."""
BONDED_DIAMETER = 5
PAPER_GRIDS = {9: (3, 3), 24: (4, 6), 48: (4, 12)}
"""Contact points of the paper's disk along the slope and along the axis; its mesh has five rows of nodes on the slope."""
PAPER_DAMPING = 0.0021
FOLDER = Path(__file__).resolve().parent.parent / "bdamper" / "data"


def build(fe: SectorFE, points: int) -> Model:
    """One model, with the full finite element frequencies of the bonded damper in its provenance."""
    wheel = LocalSizes() if points == WHEEL_POINTS else None
    model = bladed_disk(points, fe=fe, pictures=(BONDED_DIAMETER,), wheel=wheel)
    bonded = fe.bonded_frequencies(BONDED_DIAMETER, points)
    note = {
        f"bonded frequencies, nodal diameter {BONDED_DIAMETER}": " ".join(f"{f:.6f}" for f in bonded) + " Hz"
    }
    return dataclasses.replace(model, provenance={**model.provenance, **note})


def differences(new: Model, old: Model) -> dict[str, float]:
    """Largest relative difference of each kind of number."""
    out: dict[str, float] = {}

    def note(name: str, a: np.ndarray, b: np.ndarray) -> None:
        scale = np.linalg.norm(b) or 1.0
        out[name] = float(np.linalg.norm(np.asarray(a) - b) / scale) if a.shape == b.shape else np.inf

    for name, body in old.bodies.items():
        if set(body.bases) != set(new.bodies[name].bases):
            out[f"{name}: nodal diameters"] = np.inf
            continue
        for d, basis in body.bases.items():
            other = new.bodies[name].bases[d]
            note(f"{name}, {d}: omega2", other.omega2, basis.omega2)
            if basis.flexibility is not None and other.flexibility is not None:
                note(f"{name}, {d}: flexibility", other.flexibility, basis.flexibility)
            modes = [b.contact_modes.reshape(-1, b.n_modes) for b in (other, basis)]
            note(f"{name}, {d}: modes", *(m @ m.conj().T for m in modes))
        if body.local is not None and (made := new.bodies[name].local) is not None:
            waves = [[local.modes(d)[0] for d in range(old.n_blades // 2 + 1)] for local in (made, body.local)]
            note(f"{name}, local basis: omega2", *(np.array(w) for w in waves))
    for name, face in old.interfaces.items():
        for key in ("points", "area", "frame", "gap"):
            note(f"{name}: {key}", getattr(new.interfaces[name], key), getattr(face, key))
    return out


def main() -> int:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("name", nargs="?", default="", help="only the files whose names start so")
    parser.add_argument("--check", action="store_true", help="compare with the stored files, write nothing")
    parser.add_argument("--folder", type=Path, default=FOLDER, help="where the files are")
    arguments = parser.parse_args()
    start = time.perf_counter()

    @functools.cache  # made once, if needed
    def sector(mesh: str, geometry: Geometry) -> SectorFE:
        return SectorFE(geometry, MeshDensity.preset(mesh))

    def disk(points: int) -> Model:
        return build(sector("reference", Geometry()), points)

    def paper_disk(points: int) -> Model:
        return bladed_disk(
            PAPER_GRIDS[points],
            fe=sector("coarse", paper_geometry()),
            damping_ratio=PAPER_DAMPING,
            harmonics=7 if points == 24 else 1,  # for the size of the files
            n_modes=40 if points == 24 else 20,
            pictures=(BONDED_DIAMETER,),
        )

    jobs = {f"bladed_disk_{points}": functools.partial(disk, points) for points in POINTS}
    jobs |= {f"paper_disk_{points}": functools.partial(paper_disk, points) for points in PAPER_GRIDS}
    jobs["blade_to_ground_24"] = functools.partial(blade_to_ground, 24, mesh="reference")
    jobs["test_rig_24"] = functools.partial(rig, 24, mesh="reference")
    worst = 0.0
    for name, make in jobs.items():
        if not name.startswith(arguments.name):
            continue
        path = arguments.folder / f"{name}.h5"
        model = make()
        if arguments.check:
            found = differences(model, load_model(path))
            key = max(found, key=found.__getitem__)
            worst = max(worst, found[key])
            print(f"{path.name}: largest relative difference {found[key]:.2e} ({key})")
        else:
            path.parent.mkdir(parents=True, exist_ok=True)
            save_model(model, path)
            print(f"{path.name}: {path.stat().st_size / 1e6:.2f} MB, {time.perf_counter() - start:.0f} s")
    return int(worst > 1e-6)


if __name__ == "__main__":
    sys.exit(main())
