"""The reference models that come with the package."""

from __future__ import annotations

from importlib import resources

from bdamper.io.model_file import load_model
from bdamper.model.model import Model
from bdamper.util import validate
from bdamper.util.errors import SettingError

CONTACT_POINTS = {"bladed_disk": (9, 24, 48), "blade_to_ground": (24,), "test_rig": (24,)}


def reference_model(name: str = "bladed_disk", contact_points: int = 24) -> Model:
    """A model shipped with the package, made by ``tools/make_reference_model.py`` from :mod:`bdamper.fe`.

    Parameters
    ----------
    name : str
        "bladed_disk": 65 blades with wedge dampers, modes at the nodal diameters of engine order 5 up to its seventh
        harmonic; mode shapes for pictures come with 24 contact points.
        "blade_to_ground": one blade that rubs on the ground with one side of its platform; normal loads and gaps are
        prescribed (:func:`bdamper.prescribe_preload`).
        "test_rig": one test blade with two dampers between dummy blades, an acyclic structure.
    contact_points : int
        Contact points on each face: 9, 24 or 48 for "bladed_disk", 24 for the others.

    Raises
    ------
    SettingError
        If there is no such model.
    """
    validate.choice("reference model", name, sorted(CONTACT_POINTS))
    if contact_points not in CONTACT_POINTS[name]:
        raise SettingError(f"contact_points of '{name}': expected one of {CONTACT_POINTS[name]}, found {contact_points}")
    with resources.as_file(resources.files("bdamper") / "data" / f"{name}_{contact_points}.h5") as path:
        return load_model(path)
