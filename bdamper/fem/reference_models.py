"""Reference models: shipped with the package, or large ones computed by `bdamper.fem` on first use
and cached.

The search order is the installed package, the folder in the environment variable BDAMPER_MODELS,
``tests/models`` of a checkout, and the cache folder of the user, where the first use stores the
model.
"""

from __future__ import annotations

import os
from contextlib import ExitStack, suppress
from pathlib import Path

from platformdirs import user_cache_path

from bdamper.model.model_file import load_model, save_model
from bdamper.model.structure import Model
from bdamper.util import validation
from bdamper.util.errors import BdamperError, SettingError, warn
from bdamper.util.storage import INSTALLED

CONTACT_POINTS = {
    "turbine_blade": (9,),
    "bladed_disk": (9, 24, 48),
    "paper_disk": (24, 9, 48),
    "blade_to_ground": (24,),
    "test_rig": (24,),
    "shrouded_blade": (4,),
}


def reference_model(name: str = "bladed_disk", contact_points: int | None = None) -> Model:
    """Return a reference model, generated with :mod:`bdamper.fem` by
    ``tools/make_reference_model.py``.

    "bladed_disk" and "paper_disk" with 24 or 48 points are too large for the package. They are
    generated on first use, which takes some minutes and needs the extra ``bdamper[fe]``, and are
    stored in the user's cache folder.

    Parameters
    ----------
    name : str
        * "turbine_blade": 60 blades of 100 mm with light wedge dampers, the typical case, for any
          harmonic of engine order 5.
        * "bladed_disk": 65 blades with wedge dampers on flexible platforms, the difficult disk, for
          engine order 5 up to harmonic 7.  With 9 points, it has engine orders 3 to 10 up to
          harmonic 3, speed-dependent data, stress sets and a local basis.
        * "paper_disk": a different disk, for which the method of the paper
          (:data:`bdamper.CIGEROGLU_2009`, friction coefficient 0.46, excitation at
          "tip_trailing_edge") reproduces Figs 8 and 9 of the paper; with 9 and 48 points, it has
          one harmonic only.
        * "blade_to_ground": a single blade with friction between one side of its platform and the
          ground; normal loads and gaps are settings of a study (``constant_loads``, ``gap``).
        * "test_rig": one test blade with two dampers between dummy blades, an acyclic structure.
        * "shrouded_blade": 36 blades with a tip shroud and two strip dampers, "front" and "rear",
          for engine order 4.
    contact_points : int, optional
        Contact points on each face: 9 (default), 24 or 48 for "bladed_disk", 24 (default), 9 or 48
        for "paper_disk", 9 for "turbine_blade", 4 for "shrouded_blade", 24 for the others.

    Raises
    ------
    SettingError
        If the model does not exist.
    BdamperError
        If the model must be generated and scikit-fem is not installed.
    """
    validation.choice("reference model", name, sorted(CONTACT_POINTS))
    points = CONTACT_POINTS[name][0] if contact_points is None else contact_points
    if points not in CONTACT_POINTS[name]:
        raise SettingError(
            f"contact_points of '{name}': expected one of {CONTACT_POINTS[name]}, found {points}"
        )
    package = Path(__file__).resolve().parents[1]
    shipped = package / "data"
    chosen = Path(os.environ.get("BDAMPER_MODELS", shipped))
    of_checkout = package.parent / "tests" / "models"
    folders = (shipped, chosen, of_checkout)
    paths = (folder / f"{name}_{points}.h5" for folder in folders)
    stored = next((path for path in paths if path.is_file()), None)
    return _kept(name, points) if stored is None else load_model(stored)


def _kept(name: str, points: int) -> Model:
    """Return a model from the cache folder of this version; generate it first if it is missing."""
    path = user_cache_path("bdamper", version=INSTALLED.bdamper) / f"{name}_{points}.h5"
    if path.is_file():
        return load_model(path)
    with ExitStack() as stack:
        # on a read-only file system there is nothing to lock
        with suppress(OSError):
            path.parent.mkdir(parents=True, exist_ok=True)
            lock = stack.enter_context(open(path.with_suffix(".lock"), "w"))
            with suppress(ImportError):  # on Windows two processes may write it at once
                import fcntl

                fcntl.flock(lock, fcntl.LOCK_EX)
        if path.is_file():
            return load_model(path)
        try:
            from bdamper.fem.generated_models import MAKERS
        except ImportError as error:
            raise BdamperError(
                f"reference model '{name}' with {points} contact points: it is not part of the "
                "installed package, and generating it needs scikit-fem: pip install "
                f"'bdamper[fe]', or set BDAMPER_MODELS to a folder that contains {path.name}"
            ) from error
        model = MAKERS[name](points, progress=True)
        try:
            save_model(model, path)
        except BdamperError as error:
            warn(f"{error}; reference model '{name}' will be regenerated by the next process")
            return model
    return load_model(path)
