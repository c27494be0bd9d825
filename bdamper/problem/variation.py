"""A problem with settings changed by name, as sweeps, samples and sensitivities change them.

Names are those of the settings of a :class:`bdamper.Study`, with a dot for the parts of excitation and response
(``"friction_coefficient"``, ``"excitation.amplitude"``, ``"response.location"``), and factors on what is not a single
number: ``"contact_stiffness_factor"``, ``"damping_factor"`` (all modal damping ratios, not the damping of the damper),
``"damper_mass_factor"`` (the density of free bodies, at the same shape and stiffness and the same static load) and
``"damper_mass"`` (the same at a rotor speed, where the faces stay displaced as this speed displaces them under any load of
the damper: the load belongs to the mass).
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import fields, replace
from typing import Any, TypeVar

import numpy as np

from bdamper.contact.residual_modes import ResidualModes
from bdamper.model.model import Body, Model, feed_digest
from bdamper.model.validation import as_checked
from bdamper.problem.at_speed import Conditions, under
from bdamper.problem.problem import Problem
from bdamper.util import validate

P = TypeVar("P", bound=Problem)
FACTORS = ("damping_factor", "damper_mass_factor", "damper_mass", "contact_stiffness_factor")


_CONTACT = ("contact", "stiffness")
_EXCITATION = (
    "coupling", "bases", "friction", *_CONTACT, "point_stiffness", "point_gaps", "tangential_stiffness", "damper_load",
    "response_rows",
)  # fmt: skip
_KEPT = {
    "friction_coefficient": ("coupling",),
    "excitation.amplitude": _EXCITATION,
    "excitation.phase": _EXCITATION,
    "damping_ratio": ("coupling", "friction", *_CONTACT),
    "damper_damping_ratio": ("coupling", "friction", *_CONTACT),
    "damper_drag": ("coupling", "friction", *_CONTACT),
    "contact_stiffness_factor": ("coupling", "friction", "contact"),
    "damping_factor": ("friction",),
    "damper_mass_factor": ("friction", *_CONTACT),
    "damper_mass": ("friction", *_CONTACT),
}
"""Parts of a problem, made once and kept, that a change of a setting leaves as they are."""
_VIBRATION = ("excitation.amplitude", "excitation.phase", "damping_ratio", "damper_damping_ratio", "damper_drag")
"""Settings that static states do not depend on."""


def setting_names(problem: Problem) -> list[str]:
    """All names that :func:`vary` understands."""
    names = [f.name for f in fields(problem) if f.init and f.name not in ("model", *FACTORS)]
    names += [f"excitation.{f.name}" for f in fields(problem.excitation)]
    names += [f"response.{f.name}" for f in fields(problem.excitation) if f.name in ("location", "direction")]
    return [*names, *FACTORS]


def check_name(problem: Problem, name: str) -> None:
    """Raises a SettingError that lists the names there are."""
    validate.choice("setting to vary", name, setting_names(problem))


def study_fingerprint(problem: Problem) -> str:
    """Digest of the model and of all settings of a problem."""
    digest = hashlib.sha256(problem.model.hash.encode())
    for item in fields(problem):
        if item.name != "model" and item.init:
            feed_digest(digest, item.name, getattr(problem, item.name))
    return digest.hexdigest()


def vary(problem: P, settings: Mapping[str, Any]) -> P:
    """The problem with settings replaced by name.

    Parameters
    ----------
    problem : Problem
    settings : mapping of name to value

    Raises
    ------
    SettingError
        If there is no setting of that name, or its value does not fit.
    """
    for name in settings:
        check_name(problem, name)
    return _with_kept_parts(problem, _varied(problem, settings), list(settings))


def _with_kept_parts(old: P, new: P, names: list[str]) -> P:
    """Hands the parts on that need not be made again."""
    if new is old or not all(name in _KEPT for name in names):
        return new
    kept = set.intersection(*(set(_KEPT[name]) for name in names))
    method = old.stiffness_method
    residual = isinstance(method, ResidualModes) or (isinstance(method, str) and method == "residual_modes")
    if residual and not {"damper_mass_factor", "damper_mass"}.isdisjoint(names):
        kept -= set(_CONTACT)  # the patterns are those of stuck modes
    if "friction_coefficient" in names and not residual and not (isinstance(method, str) and method == "eq4"):
        others = [set(_KEPT[name]) for name in names if name != "friction_coefficient"]
        kept |= set(_CONTACT).intersection(*others)
    if all(name in _VIBRATION for name in names):
        kept.add("static_states")
    parts = {name: old.parts[name] for name in kept & old.parts.keys() - new.parts.keys()}
    return new.given(**parts) if parts else new


def _varied(problem: P, settings: Mapping[str, Any]) -> P:
    if settings.get("speed") is not None:
        speed = validate.number("speed", settings["speed"], above=0.0, unit="rad/s")
        problem = under(problem, speed, Conditions())
    plain = {name: value for name, value in settings.items() if "." not in name and name not in (*FACTORS, "speed")}
    if plain:
        problem = problem.with_(**plain)
    for part in ("excitation", "response"):
        inner = {name.split(".")[1]: value for name, value in settings.items() if name.startswith(part + ".")}
        if inner:
            place: Any = problem.excitation if part == "excitation" else problem.response_location
            problem = replace(problem, **{part: replace(place, **inner)})
    for name in FACTORS:
        if name in settings:
            problem = _scaled(problem, name, settings[name])
    return problem


def _scaled(problem: P, name: str, factor: float) -> P:
    factor = validate.number(name, factor, above=0.0)
    if name == "contact_stiffness_factor":
        return replace(problem, contact_stiffness_factor=factor * problem.contact_stiffness_factor)
    if name == "damping_factor":
        if problem.damping_ratio is not None:
            return replace(problem, damping_ratio=factor * problem.damping_ratio)
        bodies = {key: _damped(body, factor) for key, body in problem.model.bodies.items()}
        return replace(problem, model=as_checked(replace(problem.model, bodies=bodies)))
    model = denser(problem.model, factor)
    if name == "damper_mass_factor":  # the displacement by rotation stays what it is at this load
        spun = [(key, body, body.spin) for key, body in model.bodies.items()]
        moved = {key: replace(b, spin=s and replace(s, contact=factor * s.contact)) for key, b, s in spun}
        model = replace(model, bodies=moved)
    return replace(problem, model=as_checked(model))


def _damped(body: Body, factor: float) -> Body:
    bases = {
        d: replace(
            basis,
            damping_ratio=factor * basis.damping_ratio,
            drag=None if basis.drag is None else factor * basis.drag,
        )
        for d, basis in body.bases.items()
    }
    return replace(body, bases=bases)


def denser(model: Model, factor: float) -> Model:
    """The model with the density of its free bodies multiplied: mass-normalised modes shrink, flexibility stays."""
    free = [body for body in model.bodies.values() if body.kind == "free"]
    validate.require(free, "mass of the damper", "a model with a free body", "none")
    bodies = dict(model.bodies)
    root = 1.0 / np.sqrt(factor)
    for body in free:
        assert body.mass is not None and body.inertia is not None
        bases = {
            d: replace(
                basis,
                omega2=basis.omega2 / factor,
                contact_modes=root * basis.contact_modes,
                locations={name: root * modes for name, modes in basis.locations.items()},
            )
            for d, basis in body.bases.items()
        }
        load = body.load
        if load is not None:
            load = replace(load, generalised=root * load.generalised)
        bodies[body.name] = replace(
            body, mass=factor * body.mass, inertia=factor * body.inertia, bases=bases, load=load
        )  # fmt: skip
    return replace(model, bodies=bodies)
