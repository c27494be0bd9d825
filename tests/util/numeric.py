"""Numbers that users give: the parameters of what the package offers whose annotations hold numbers."""

import inspect
import sys
import types
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Union, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import ArrayLike

import bdamper as bd
from bdamper.contact.laws import ContactLaw
from bdamper.fatigue.criteria import Material
from bdamper.fatigue.margin import LeastMargin
from bdamper.fem import ElasticMaterial, Geometry
from bdamper.fem.local_basis import LocalSizes
from bdamper.harmonic_balance.rotor_speed import Conditions
from bdamper.harmonic_balance.settings import Settings
from bdamper.importers import (
    Checks,
    ContactFaces,
    Placement,
    Reduction,
    Sector,
    Units,
    build_model,
    over_speed,
)
from bdamper.importers.contact_faces import Patches
from bdamper.mistuning import BladedDisk, DamperVariation, DiskPeakOptions, Mistuning
from bdamper.util.records import is_array

FURTHER = (
    LeastMargin, Material, ContactFaces, Units, Sector, Placement, Reduction, Checks, build_model, over_speed, Patches,
    Conditions, LocalSizes, DamperVariation, Mistuning, DiskPeakOptions, Geometry,
)  # fmt: skip
PARTS = (bd.Study, BladedDisk, ContactLaw, Mistuning, DamperVariation)
"""Classes with methods that take numbers."""
OUTSIDE = ("Effects", "Model", "load", "load_model", "load_study", "save_model", "ContactLaw")
"""Made by programs and files, and checked there."""
PLAIN = (float, int, complex, np.ndarray, np.generic)


def holds_numbers(hint: Any) -> bool:
    """Whether values of a type are numbers, or hold them."""
    origin = get_origin(hint)
    if hint is Any or hint is ArrayLike or is_array(hint):
        return True
    if origin is Annotated:
        return holds_numbers(get_args(hint)[0])
    if origin in (Union, types.UnionType, tuple, list, Sequence, Mapping):
        inner = get_args(hint)[1:] if origin is Mapping else get_args(hint)
        return any(holds_numbers(part) for part in inner)
    return isinstance(hint, type) and issubclass(hint, PLAIN) and hint is not bool


def doors() -> dict[str, Any]:
    """Functions and classes by name, as the table of plausible ranges names them."""
    found = {name: getattr(bd, name) for name in bd.__all__ if name not in OUTSIDE}
    found = {
        name: thing for name, thing in found.items() if callable(thing) and not _is_error(thing)
    }
    found |= {thing.__name__: thing for thing in FURTHER} | {"ElasticMaterial": ElasticMaterial}
    for cls in PARTS:
        for name in dir(cls):
            method = getattr(cls, name)
            if not name.startswith("_") and callable(method) and not isinstance(method, type):
                found[f"{cls.__name__}.{name}"] = method
    return found


def _is_error(thing: Any) -> bool:
    return isinstance(thing, type) and issubclass(thing, (Exception, Warning))


def numeric(door: Any) -> list[str]:
    """Parameters of a function or class that take numbers."""
    made = Settings if door is bd.Study else door
    called = made.__init__ if isinstance(made, type) else made
    names = [
        n
        for n, p in inspect.signature(called).parameters.items()
        if p.kind not in (p.VAR_KEYWORD, p.VAR_POSITIONAL)
    ]
    names = [n for n in names if n not in ("self", "cls") and n[0] != "_"]
    if isinstance(made, type):
        return [n for n in names if holds_numbers(_of_field(made, n))]
    hints = get_type_hints(inspect.unwrap(called), include_extras=True)
    return [n for n in names if holds_numbers(hints.get(n))]


def _of_field(cls: type, name: str) -> Any:
    """Type of a field of a dataclass, by the module of the class that has it."""
    home = next(base for base in cls.__mro__ if name in vars(base).get("__annotations__", {}))
    return eval(vars(home)["__annotations__"][name], vars(sys.modules[home.__module__]))
