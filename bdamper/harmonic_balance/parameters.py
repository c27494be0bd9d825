"""Settings of a problem changed by name, for sweeps, samples and sensitivities.

Names are the settings of a :class:`bdamper.Study`, with a dot for parts of the excitation and the
response (``"friction_coefficient"``, ``"excitation.amplitude"``, ``"response.location"``).  Factors
scale other quantities:

- ``"friction_factor"``: all friction coefficients;
- ``"contact_stiffness_factor"``: contact stiffness, or one direction with ``".tangential"`` or
  ``".normal"``;
- ``"damping_factor"``: all modal damping ratios, not the damping of the damper;
- ``"damper_inertia_factor"``: density of free bodies at the same shape, stiffness and static load;
- ``"damper_mass_factor"``: their mass at a rotor speed, where their static load is proportional to
  it;
- ``"frequency_factor"``: all natural frequencies, by the density of all bodies;
- ``"gap_factor"``: initial gaps.

A dot selects one interface (``"friction_coefficient.left"``, ``"gap_factor.left"``), one load
(``"load_per_preload.rear"``, ``"constant_loads.shroud"``), the gap of one interface in m
(``"gap.shroud"``, negative for interference), or one free body
(``"damper_inertia_factor.rear"``, ``"damper_mass_factor.rear"``).  Without a rotor speed,
``"damper_mass_factor.rear"`` also scales the load of this body per newton of preload;
``"damper_mass_factor"`` for all bodies requires a rotor speed.

To compare solutions of two problems, :func:`like` rotates the residual modes of one problem onto
the residual modes of the other.  Modes of bodies have the phases of the model's basis.  Residual
modes have arbitrary phases, and modes of equal mass may be combined arbitrarily: the unitary
Procrustes rotation of each group of equal mass brings their motions closest.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from typing import Any

import numpy as np

from bdamper.contact.residual_flexibility import RESIDUAL
from bdamper.harmonic_balance.problem import Problem
from bdamper.harmonic_balance.rotor_speed import Conditions, under
from bdamper.harmonic_balance.study_boundary import accepts_study
from bdamper.model.kinematics import HarmonicBasis
from bdamper.model.structure import Body, Model, feed_digest
from bdamper.model.validation import as_checked
from bdamper.util import validation
from bdamper.util.errors import SettingError

# ---- settings changed by name ----


INERTIA = "damper_inertia_factor"
MASS = "damper_mass_factor"
OF_MASS = (INERTIA, MASS)
FACTORS = (
    "friction_factor",
    "damping_factor",
    INERTIA,
    MASS,
    "contact_stiffness_factor",
    "frequency_factor",
    "gap_factor",
)
OF_LOAD = ("load_per_preload", "constant_loads")
GAP = "gap"
RENAMED = {"damper_mass_factor": INERTIA, "damper_mass": MASS}
"""Present names of settings in files of version 3 of the format."""
SIDES = ("tangential", "normal")
EQUAL_MASS = 1e-6
"""Relative difference of modal masses below which residual modes form one group."""


def setting_names(problem: Problem) -> list[str]:
    """Return all names that :func:`vary` accepts."""
    settings = problem.settings
    names = [f.name for f in fields(settings) if f.name not in ("model", *FACTORS)]
    of_excitation = [f.name for f in fields(settings.excitation)]
    names += [f"excitation.{name}" for name in of_excitation if name != "beside"]
    names += [f"response.{name}" for name in of_excitation if name in ("location", "direction")]
    for setting in ("friction_coefficient", GAP, "gap_factor"):
        names += [f"{setting}.{face.name}" for face in settings.friction_faces]
    for factor in OF_MASS:
        names += [f"{factor}.{body}" for body in settings.free_bodies]
    for item in OF_LOAD:
        names += [f"{item}.{part}" for part in settings.loaded]
    names += [f"contact_stiffness_factor.{side}" for side in SIDES]
    return [*names, *FACTORS]


def present_name(name: str) -> str:
    """Return the current name of a setting in a file of version 3 of the format."""
    head, dot, part = name.partition(".")
    return f"{RENAMED.get(head, head)}{dot}{part}"


def check_name(problem: Problem, name: str) -> None:
    """Raise a SettingError that lists the valid names if a name is not valid."""
    validation.choice("setting to vary", name, setting_names(problem))


def study_fingerprint(problem: Problem) -> str:
    """Return a digest of the model and of all settings of a problem."""
    digest = hashlib.sha256(problem.model.hash.encode())
    for item in fields(problem.settings):
        if item.name != "model":
            feed_digest(digest, item.name, getattr(problem.settings, item.name))
    return digest.hexdigest()


@accepts_study
def vary(problem: Problem, settings: Mapping[str, Any]) -> Problem:
    """Return the problem with some settings changed.

    Parameters
    ----------
    problem : Problem
    settings : mapping of name to value

    Raises
    ------
    SettingError
        If there is no setting of that name, or its value is not valid.
    """
    for name in settings:
        check_name(problem, name)
    if settings.get("speed") is not None:
        speed = validation.number("speed", settings["speed"], above=0.0, unit="rad/s")
        problem = under(problem, speed, Conditions())
    plain = {
        name: value
        for name, value in settings.items()
        if "." not in name and name not in (*FACTORS, "speed")
    }
    if plain:
        problem = problem.replace(**plain)
    of_excitation = _of_part(settings, "excitation")
    if of_excitation:
        excitation = replace(problem.settings.excitation, **of_excitation)
        problem = problem.replace(excitation=excitation)
    of_response = _of_part(settings, "response")
    if of_response:
        response = replace(problem.settings.response_location, **of_response)
        problem = problem.replace(response=response)

    # loads and gaps before factors, which may scale them
    def is_factor(name: str) -> bool:
        head, _, _ = name.partition(".")
        return head not in (*OF_LOAD, GAP)

    for name in sorted(settings, key=is_factor):
        value = settings[name]
        head, _, part = name.partition(".")
        if head == "friction_coefficient" and part:
            coefficients = _coefficients(problem, part, value)
            problem = problem.replace(friction_coefficient=coefficients)
        elif head in OF_LOAD and part:
            loads = {**problem.settings.given_loads(head), part: value}
            problem = problem.replace(**{head: loads})
        elif head == GAP and part:
            loaded_by = [item for item in OF_LOAD if part in problem.settings.given_loads(item)]
            expected = "an interface without a load, since the load determines the interference"
            validation.check(not loaded_by, name, expected, f"{', '.join(loaded_by)} of '{part}'")
            problem = problem.replace(gap={**(problem.settings.gap or {}), part: value})
        elif head in FACTORS:
            problem = _scaled(problem, head, part, value)
    return problem


def _of_part(settings: Mapping[str, Any], part: str) -> dict[str, Any]:
    """Return the settings that begin with "excitation." or "response.", without this prefix."""
    prefix = part + "."
    return {
        name.removeprefix(prefix): value
        for name, value in settings.items()
        if name.startswith(prefix)
    }


def _coefficients(problem: Problem, changed: str, value: float) -> dict[str, Any]:
    """Return the friction coefficients of all interfaces, one of them changed."""
    coefficients: dict[str, Any] = problem.settings.friction_by_interface()
    user_laws = problem.settings.own_laws()
    varied = {}
    for face in problem.settings.law_by_interface():
        if face == changed:
            varied[face] = value
        elif face not in user_laws:  # these do not use a coefficient
            varied[face] = coefficients[face]
    return varied


def replace_settings(problem: Problem, /, **settings: Any) -> Problem:
    """See :meth:`bdamper.Study.replace`."""
    arguments = {f.name for f in fields(problem.settings)}
    names = setting_names(problem)
    for name in settings.keys() - {*arguments, *names}:
        raise SettingError(
            f"Study: there is no argument '{name}'{validation.hint_of_setting(name, names)}"
        )
    # the other names belong to vary alone
    plain = {name: value for name, value in settings.items() if name in arguments}
    varied = {name: settings[name] for name in names if name in settings and name not in arguments}
    return vary(problem.replace(**plain), varied)


def _scaled(problem: Problem, name: str, part: str, factor: float) -> Problem:
    """Return the problem with one of the ``FACTORS`` applied to a part of the model or to all."""
    factor = validation.number(f"{name}.{part}" if part else name, factor, above=0.0)
    if name == "friction_factor":
        return _with_friction(problem, factor)
    if name == "gap_factor":
        gap = problem.point_gaps
        gaps = {}
        for face in problem.coupling.interfaces:
            scale = factor if part in (face, "") else 1.0
            gaps[face] = gap[problem.coupling.rows(face)] * scale
        return problem.replace(gap=gaps)
    if name in OF_MASS:
        return _of_mass(problem, name, part, factor)
    if name == "contact_stiffness_factor" and part:
        return _with_stiffness(problem, part, factor)
    if name == "contact_stiffness_factor":
        total = factor * problem.settings.contact_stiffness_factor
        return problem.replace(contact_stiffness_factor=total)
    if name == "damping_factor":
        if problem.settings.damping_ratio is not None:
            return problem.replace(damping_ratio=factor * problem.settings.damping_ratio)
        bodies = {key: _damped(body, factor) for key, body in problem.model.bodies.items()}
        return problem.replace(model=as_checked(replace(problem.model, bodies=bodies)))
    # frequency_factor
    every_body = tuple(problem.model.bodies)
    model = denser(problem.model, factor**-2, every_body, whole=True)
    return problem.replace(model=as_checked(model))


def _with_friction(problem: Problem, factor: float) -> Problem:
    """Return the problem with all friction coefficients scaled."""
    settings = problem.settings
    validation.check_sentence(
        settings.friction_values(),
        "friction_factor",
        "no friction interface has a friction coefficient above 0",
    )
    coefficient = settings.friction_coefficient
    if not isinstance(coefficient, Mapping):
        return problem.replace(friction_coefficient=factor * coefficient)
    user_laws = settings.own_laws()
    scaled = {
        face: factor * np.asarray(mu) for face, mu in coefficient.items() if face not in user_laws
    }
    return problem.replace(friction_coefficient=scaled)


def _with_stiffness(problem: Problem, side: str, factor: float) -> Problem:
    """Return the problem with the contact stiffness scaled along the normal or the tangents."""
    validation.check(
        problem.contact.residual is None,
        f"contact_stiffness_factor.{side}",
        "contact stiffness by values or unit tractions",
        "residual modes, which have no separate normal and tangential stiffness",
    )
    scale = [1.0, 1.0, factor] if side == "normal" else [factor, factor, 1.0]
    friction_faces = problem.settings.law_by_interface()
    values = {}
    for face, contact in problem.stiffness.items():
        values[face] = contact.stiffness * (np.array(scale) if face in friction_faces else 1.0)
    return problem.replace(contact_stiffness=values, contact_stiffness_factor=1.0)


def _of_mass(problem: Problem, name: str, part: str, factor: float) -> Problem:
    """Scale the mass of all free bodies or of one, with or without the load that is proportional to
    it.
    """
    settings = problem.settings
    names = (part,) if part else settings.free_bodies
    validation.check_sentence(names, "mass of the damper", "the model has no free body")
    model = denser(problem.model, factor, names)
    if name == INERTIA:
        one_of_several = len(names) < len(settings.free_bodies)
        expected = f"no rotor speed, at which load and mass are proportional; vary {MASS}.{part}"
        validation.check(
            settings.speed is None or not one_of_several,
            f"{name}.{part}",
            expected,
            f"{settings.speed} rad/s",
        )
        return problem.replace(model=as_checked(model))
    if settings.speed is not None:
        return problem.replace(model=as_checked(model))
    if not part:
        each = " and ".join(f"{MASS}.{body}" for body in names)
        raise SettingError(
            f"{MASS}: it needs a rotor speed, at which the load is proportional to the mass; use "
            f"study.at_speed(...). At a given preload, vary {each} (mass and load) or {INERTIA} "
            "(mass only)"
        )
    # without a speed the load of one body is its share of the preload
    loads = settings.given_loads("load_per_preload")
    if part in loads:
        loads[part] = factor * loads[part]
    return problem.replace(model=as_checked(model), load_per_preload=loads or None)


def _damped(body: Body, factor: float) -> Body:
    """Return the body with its modal damping scaled."""
    bases = {}
    for d, basis in body.bases.items():
        drag = None if basis.drag is None else factor * basis.drag
        bases[d] = replace(basis, damping_ratio=factor * basis.damping_ratio, drag=drag)
    return replace(body, bases=bases)


def denser(model: Model, factor: float, names: Sequence[str], whole: bool = False) -> Model:
    """Return the model with the density of some bodies scaled.

    Mass-normalised modes scale; the flexibility does not change.  With ``whole`` these are all
    bodies of the model.
    """
    bodies = dict(model.bodies)
    for name in names:
        if bodies[name].bases:
            bodies[name] = _denser_body(bodies[name], factor, whole)
    return replace(model, bodies=bodies)


def _denser_body(body: Body, factor: float, whole: bool) -> Body:
    root = 1.0 / np.sqrt(factor)
    bases = {}
    for d, basis in body.bases.items():
        drag = basis.drag
        if drag is not None:
            drag = drag / (factor if whole else 1.0)
        bases[d] = replace(
            basis,
            omega2=basis.omega2 / factor,
            contact_modes=root * basis.contact_modes,
            locations={name: root * modes for name, modes in basis.locations.items()},
            drag=drag,
            speed=None if whole else basis.speed,
        )
    changed: dict[str, Any] = {"bases": bases}
    if body.load is not None:
        changed["load"] = replace(body.load, generalised=root * body.load.generalised)
    if body.constant_force is not None:
        changed["constant_force"] = root * body.constant_force
    if body.mass is not None and body.inertia is not None:
        changed["mass"] = factor * body.mass
        changed["inertia"] = factor * body.inertia
    if whole:
        changed["local"] = None
    return replace(body, **changed)


# ---- comparable coordinates of residual modes ----


def aligned(basis: HarmonicBasis, reference: HarmonicBasis) -> HarmonicBasis:
    """Return the basis with its residual modes rotated onto the residual modes of a reference
    basis.

    Raises
    ------
    SettingError
        If the two bases have different coordinates.
    """
    expected = "a range in which contacts keep their residual modes"
    found = 'a range that changes them; give a shorter one, or contact_stiffness="unit_traction"'
    validation.check(basis.coordinates == reference.coordinates, "residual modes", expected, found)
    is_residual = [coordinate.body == RESIDUAL for coordinate in basis.coordinates]
    residual = np.flatnonzero(is_residual)
    if not len(residual):
        return basis
    # modes of equal mass may be rotated against each other; the masses ascend
    mass = basis.mass[residual]
    first_of_group = np.flatnonzero(np.diff(mass) > EQUAL_MASS * mass.max()) + 1
    G = basis.G.copy()
    for group in np.split(residual, first_of_group):
        # (n_points, 3, n_group) as matrices (3 n_points, n_group)
        columns = basis.G[..., group].reshape(-1, len(group))
        target = reference.G[..., group].reshape(-1, len(group))
        # the rotation that brings the columns closest to the target (Procrustes): from the
        # singular vectors of their product
        left, _, right = np.linalg.svd(columns.conj().T @ target)
        rotated = columns @ (left @ right)
        G[..., group] = rotated.reshape(*G.shape[:2], len(group))
    return replace(basis, G=G)


def with_aligned_modes(problem: Problem, reference: Problem) -> Problem:
    """Return the problem with its residual modes rotated onto the residual modes of another
    problem.
    """
    bases = [aligned(basis, other) for basis, other in zip(problem.bases, reference.bases)]
    # without a mean there is no basis of harmonic 0 to replace that of the static state
    if bases[0].n_modes:
        return problem.given(bases=bases, static_basis=bases[0])
    return problem.given(bases=bases)
