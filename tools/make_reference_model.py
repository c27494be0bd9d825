"""Make the shipped models, or check that they can still be made.

    python tools/make_reference_model.py            writes turbine_blade_9.h5, bladed_disk_9.h5, paper_disk_9.h5,
                                                    blade_to_ground_24.h5, test_rig_24.h5, shrouded_blade_4.h5 to
                                                    bdamper/data, which is in the wheel, and
                                                    {bladed,paper}_disk_{24,48}.h5 to tests/models
    python tools/make_reference_model.py test_rig   writes only the files whose names start so
    python tools/make_reference_model.py --keep bladed_disk_9
                                                    only the nodal diameters over speed that the stored file lacks;
                                                    the numbers that it has stay as they are
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
from typing import Any

import numpy as np

from bdamper.fem import LocalSizes
from bdamper.fem.generated_models import (
    SectorFE,
    blade_to_ground,
    bladed_disk,
    paper_disk,
    reference_disk,
)
from bdamper.fem.meshes import ElasticMaterial, Geometry, MeshDensity
from bdamper.fem.reduced_bodies import needed_nodal_diameters
from bdamper.fem.reference_models import CONTACT_POINTS
from bdamper.model.model_file import load_model, save_model
from bdamper.model.structure import Model

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from tools.bonded import reference_frequencies
from tools.rig import rig
from tools.shrouded import modes_alone, shrouded

LARGEST = 9
"""Contact points of the model that serves wheels of unequal blades, rotor speed and stress too."""
BONDED_DIAMETER = 5
ROWS = ("modes", "contact")
SPEED_REST = ("coriolis", "checked_at", "error", "source")
SPEED_ORDERS, SPEED_HARMONICS, TOP_SPEED = range(3, 11), 3, 600.0
"""Engine orders of the speed-dependent model with harmonics of each, and the speed (rad/s) at which it is checked."""
ROOT = Path(__file__).resolve().parent.parent
FOLDERS = (ROOT / "bdamper" / "data", ROOT / "tests" / "models")
"""Of the wheel, and of what is too large for it."""
TURBINE = Geometry(
    n_blades=60, bore_radius=0.200, rim_radius=0.260, axial_length=0.036, shank_width=0.013, face_angle=np.radians(25),
    face_length=0.010, face_width=0.032, ridge_radius=0.2919463, ridge_width=0.001, damper_body_height=0.003,
    platform_clearance=0.0008, platform_edge_thickness=0.005, airfoil_height=0.100, root_chord=0.032, tip_chord=0.026,
    root_thickness=0.008, tip_thickness=0.003, camber=0.003, twist=np.radians(20),
)  # fmt: skip
"""A damper of 20 g between blades of 100 mm; faces so steep that neither edge opens near the optimum."""
NICKEL_ALLOY = ElasticMaterial(2.0e11, 0.3, 8200.0)


def build(fe: SectorFE, points: int, stored: Model | None = None) -> Model:
    """One model, with the full finite element frequencies of the bonded damper in its provenance; what ``stored`` lacks."""
    if points == LARGEST:
        fe = SectorFE(fe.geometry, fe.density, fe.material, keep_factors=False)
        rotation = fe.rotation(TOP_SPEED)
        orders = {
            order: 7 if order == BONDED_DIAMETER else SPEED_HARMONICS for order in SPEED_ORDERS
        }
        n = fe.geometry.n_blades
        diameters = {
            d
            for order, harmonics in orders.items()
            for d in needed_nodal_diameters(n, order, harmonics)
        }
        settings: dict[str, Any] = {"rotation": rotation, "wheel": LocalSizes(), "stress": True}
        if stored is not None:
            blade = stored.bodies["blade"]
            diameters -= {d for d, basis in blade.bases.items() if basis.speed is not None}
            settings["wheel"] = LocalSizes() if blade.local is None else None
        model = bladed_disk(
            points, fe=fe, pictures=(BONDED_DIAMETER,), nodal_diameters=tuple(diameters), **settings
        )
        model = shortened(model, set(needed_nodal_diameters(n, BONDED_DIAMETER, 7)))
    else:
        model = reference_disk(points, progress=True)
    if stored is not None:
        return dataclasses.replace(model, provenance=stored.provenance)
    bonded = reference_frequencies(fe, BONDED_DIAMETER, points)
    note = {
        f"bonded frequencies, nodal diameter {BONDED_DIAMETER}": " ".join(
            f"{f:.6f}" for f in bonded
        )
        + " Hz"
    }
    return dataclasses.replace(model, provenance={**model.provenance, **note})


def turbine_blade() -> Model:
    """The typical case, for engine order 5, all of whose harmonics meet seven nodal diameters."""
    fe = SectorFE(TURBINE, MeshDensity.preset("reference"), NICKEL_ALLOY, keep_factors=False)
    rotation = fe.rotation(1000.0)
    model = bladed_disk(
        9,
        fe=fe,
        n_modes=20,
        n_damper_modes=10,
        pictures=(BONDED_DIAMETER,),
        rotation=rotation,
        stress=True,
    )
    return shortened(model, set(model.bodies["blade"].bases))


def shortened(model: Model, full: set[int]) -> Model:
    """The model with data over speed in single precision, and other nodal diameters than ``full`` too: for their size."""

    def single(value: Any) -> Any:
        if isinstance(value, np.ndarray):
            return value.astype(np.complex64 if value.dtype.kind == "c" else np.float32).astype(
                value.dtype
            )
        return (
            {key: single(part) for key, part in value.items()} if isinstance(value, dict) else value
        )

    def parts(record: Any, *names: str) -> dict[str, Any]:
        return {name: single(getattr(record, name)) for name in names}

    def short(array: np.ndarray, bits: int) -> np.ndarray:
        """So many bits of each number: of the flexibility, which changes by a percent, and of the Coriolis report."""
        size, exponent = np.frexp(array.view(float))
        out: np.ndarray = np.ldexp(np.round(size * 2.0**bits) / 2.0**bits, exponent).view(
            array.dtype
        )
        return out

    blade = model.bodies["blade"]
    bases = {}
    for d, basis in blade.bases.items():
        rounded = parts(basis, "contact_modes", "locations", "flexibility")
        own = parts(basis.speed, "stiffness2", "residual2", *SPEED_REST)
        own |= {"residual2": short(own["residual2"], 12), "coriolis": short(own["coriolis"], 8)}
        bases[d] = (basis if d in full else dataclasses.replace(basis, **rounded)).with_speed(**own)
    return dataclasses.replace(
        model, bodies={**model.bodies, "blade": dataclasses.replace(blade, bases=bases)}
    )


def time_response(new: Model, old: Model) -> Model:
    """``new`` with the numbers of ``old`` where both have them and agree, so that a file only grows.

    Raises
    ------
    ValueError
        If modes to which data over speed are added do not agree to a relative 1e-6, one by one.
    """

    def known(record: Any) -> Any:
        places = {name: value for name, value in record.locations.items() if name in old.locations}
        return dataclasses.replace(record, locations=places)

    bodies = dict(new.bodies)
    for name, body in old.bodies.items():
        bases = {d: known(basis) for d, basis in new.bodies[name].bases.items()}
        for d, basis in body.bases.items():
            made, bases[d] = bases.get(d, basis), basis
            if basis.speed is None and made.speed is not None:
                error = (
                    np.abs(made.contact_modes - basis.contact_modes).max()
                    / np.abs(basis.contact_modes).max()
                )
                if not error < 1e-6:
                    raise ValueError(f"{name}, nodal diameter {d}: modes differ by {error:.2g}")
                rest = {
                    key: getattr(made.speed, key)
                    for key in ("stiffness2", "residual2", *SPEED_REST)
                }
                bases[d] = basis.with_speed(**rest)
        spin = new.bodies[name].spin
        spin, local = body.spin or (spin and known(spin)), body.local or new.bodies[name].local
        bodies[name] = dataclasses.replace(body, bases=bases, spin=spin, local=local)
    stress = dict(new.stress)
    for name, rows in old.stress.items():
        if name in stress:
            more = {
                key: dict(sorted({**getattr(stress[name], key), **getattr(rows, key)}.items()))
                for key in ROWS
            }
            stress[name] = dataclasses.replace(rows, **more)
    parts = {"interfaces": old.interfaces, "locations": old.locations, "meshes": old.meshes}
    return dataclasses.replace(new, bodies=bodies, stress={**old.stress, **stress}, **parts)


def differences(new: Model, old: Model) -> dict[str, float]:
    """Largest relative difference of each kind of number."""
    out: dict[str, float] = {}

    def note(name: str, a: Any, b: Any) -> None:
        scale = np.linalg.norm(b) or 1.0
        out[name] = (
            float(np.linalg.norm(np.asarray(a) - b) / scale) if a.shape == b.shape else np.inf
        )

    for name, body in old.bodies.items():
        if set(body.bases) != set(new.bodies[name].bases):
            out[f"{name}: nodal diameters"] = np.inf
            continue
        for d, basis in body.bases.items():
            other = new.bodies[name].bases[d]
            note(f"{name}, {d}: omega2", other.omega2, basis.omega2)
            if basis.flexibility is not None and other.flexibility is not None:
                note(f"{name}, {d}: flexibility", other.flexibility, basis.flexibility)
            if basis.speed is not None and other.speed is not None:
                speeds = [b.at_speed(TOP_SPEED)[0] for b in (other, basis)]
                note(f"{name}, {d}: omega2 at {TOP_SPEED:g} rad/s", *(b.omega2 for b in speeds))
                note(
                    f"{name}, {d}: flexibility at {TOP_SPEED:g} rad/s",
                    *(b.flexibility for b in speeds),
                )
            modes = [b.contact_modes.reshape(-1, b.n_modes) for b in (other, basis)]
            note(f"{name}, {d}: modes", *(m @ m.conj().T for m in modes))
        if body.local is not None and (made := new.bodies[name].local) is not None:
            waves = [
                [local.modes(d)[0] for d in range(old.n_blades // 2 + 1)]
                for local in (made, body.local)
            ]
            note(f"{name}, local basis: omega2", *(np.array(w) for w in waves))
    for name, face in old.interfaces.items():
        for key in ("points", "area", "frame", "gap"):
            note(f"{name}: {key}", getattr(new.interfaces[name], key), getattr(face, key))
    return out


def main() -> int:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("name", nargs="?", default="", help="only the files whose names start so")
    parser.add_argument(
        "--check", action="store_true", help="compare with the stored files, write nothing"
    )
    parser.add_argument(
        "--keep",
        action="store_true",
        help="keep the numbers of the stored files where there are any",
    )
    parser.add_argument(
        "--folder", type=Path, help="where the files are, other than in the two of the checkout"
    )
    arguments = parser.parse_args()
    start = time.perf_counter()

    def place(name: str) -> Path:
        large = name.startswith(("bladed", "paper")) and not name.endswith("_9")
        return (arguments.folder or FOLDERS[large]) / f"{name}.h5"

    @functools.cache  # made once, if needed
    def sector() -> SectorFE:
        return SectorFE(Geometry(), MeshDensity.preset("reference"))

    def disk(points: int) -> Model:
        stored = load_model(place(f"bladed_disk_{points}")) if arguments.keep else None
        return build(sector(), points, stored)

    jobs: dict[str, Any] = {"turbine_blade_9": turbine_blade}
    jobs |= {
        f"bladed_disk_{points}": functools.partial(disk, points)
        for points in CONTACT_POINTS["bladed_disk"]
    }
    jobs |= {
        f"paper_disk_{points}": functools.partial(paper_disk, points)
        for points in CONTACT_POINTS["paper_disk"]
    }
    jobs["blade_to_ground_24"] = functools.partial(blade_to_ground, 24, mesh="reference")
    jobs["test_rig_24"] = functools.partial(rig, 24, mesh="reference")
    jobs["shrouded_blade_4"] = lambda: modes_alone(shrouded().model)
    worst = 0.0
    for name, make in jobs.items():
        if not name.startswith(arguments.name):
            continue
        path = place(name)
        model = make()
        if arguments.check:
            found = differences(model, load_model(path))
            key = max(found, key=found.__getitem__)
            worst = max(worst, found[key])
            print(f"{path.name}: largest relative difference {found[key]:.2e} ({key})")
        else:
            path.parent.mkdir(parents=True, exist_ok=True)
            save_model(time_response(model, load_model(path)) if arguments.keep else model, path)
            print(
                f"{path.name}: {path.stat().st_size / 1e6:.2f} MB, {time.perf_counter() - start:.0f} s"
            )
    return int(worst > 1e-6)


if __name__ == "__main__":
    sys.exit(main())
