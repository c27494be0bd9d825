"""Settings of a problem changed by name, for sweeps, samples and sensitivities.

Names are the settings of a :class:`bdamper.Study`, with a dot for parts of the excitation and the response
(``"friction_coefficient"``, ``"excitation.amplitude"``, ``"response.location"``).  Factors scale other quantities:

- ``"friction_factor"``: all friction coefficients;
- ``"contact_stiffness_factor"``: contact stiffness, or one direction with ``".tangential"`` or ``".normal"``;
- ``"damping_factor"``: all modal damping ratios, not the damping of the damper;
- ``"damper_inertia_factor"``: density of free bodies at the same shape, stiffness and static load;
- ``"damper_mass_factor"``: their mass at a rotor speed, where their static load is proportional to it;
- ``"frequency_factor"``: all natural frequencies, by the density of all bodies;
- ``"gap_factor"``: initial gaps.

A dot selects one interface (``"friction_coefficient.left"``, ``"gap_factor.left"``), one load
(``"load_per_preload.rear"``, ``"constant_loads.shroud"``), or one free body (``"damper_inertia_factor.rear"``,
``"damper_mass_factor.rear"``).  Without a rotor speed, ``"damper_mass_factor.rear"`` also scales the load of this body per
newton of preload, and all bodies together have no such factor.

To compare solutions of two problems, :func:`like` rotates the residual modes of one problem onto the residual modes of the
other.  Modes of
bodies have the phases of the model's basis.  Residual modes have arbitrary phases, and modes of equal mass may be combined
arbitrarily: the unitary Procrustes rotation of each group of equal mass brings their motions closest.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from typing import Any

import numpy as np

from bdamper.contact.residual_flexibility import RESIDUAL
from bdamper.harmonic_balance.checks import asked
from bdamper.harmonic_balance.problem import Problem
from bdamper.harmonic_balance.rotor_speed import Conditions, under
from bdamper.model.kinematics import HarmonicBasis
from bdamper.model.structure import Body, Model, feed_digest
from bdamper.model.validation import as_checked
from bdamper.util import validation
from bdamper.util.errors import SettingError

# ---- settings changed by name ----


FACTORS = (
    "friction_factor", "damping_factor", "damper_inertia_factor", "damper_mass_factor", "contact_stiffness_factor",
    "frequency_factor", "gap_factor",
)  # fmt: skip
OF_LOAD = ("load_per_preload", "constant_loads")
INERTIA, MASS = OF_MASS = ("damper_inertia_factor", "damper_mass_factor")
RENAMED = {"damper_mass_factor": INERTIA, "damper_mass": MASS}
"""Present names of settings in files of version 3 of the format."""
SIDES = ("tangential", "normal")


def setting_names(problem: Problem) -> list[str]:
    """Return all names that :func:`vary` accepts."""
    names = [f.name for f in fields(problem.settings) if f.name not in ("model", *FACTORS)]
    names += [
        f"excitation.{f.name}" for f in fields(problem.settings.excitation) if f.name != "beside"
    ]
    names += [
        f"response.{f.name}"
        for f in fields(problem.settings.excitation)
        if f.name in ("location", "direction")
    ]
    faces = problem.settings.friction_faces
    names += [
        f"{setting}.{face.name}"
        for setting in ("friction_coefficient", "gap_factor")
        for face in faces
    ]
    names += [f"{factor}.{body}" for factor in OF_MASS for body in problem.settings.free_bodies]
    names += [f"{item}.{part}" for item in OF_LOAD for part in problem.settings.loaded]
    return [*names, *(f"contact_stiffness_factor.{side}" for side in SIDES), *FACTORS]


def present_name(name: str) -> str:
    """Return the present name of a setting in a file of version 3 of the format."""
    head, dot, part = name.partition(".")
    return f"{RENAMED.get(head, head)}{dot}{part}"


def check_name(problem: Problem, name: str) -> None:
    """Raise a SettingError that lists the valid names if the name is not one of them."""
    validation.choice("setting to vary", name, setting_names(problem))


def study_fingerprint(problem: Problem) -> str:
    """Return a digest of the model and of all settings of a problem."""
    digest = hashlib.sha256(problem.model.hash.encode())
    for item in fields(problem.settings):
        if item.name != "model":
            feed_digest(digest, item.name, getattr(problem.settings, item.name))
    return digest.hexdigest()


@asked
def vary(problem: Problem, settings: Mapping[str, Any]) -> Problem:
    """Return the problem with settings replaced by name.

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
    for part in ("excitation", "response"):
        inner = {
            name.split(".")[1]: value
            for name, value in settings.items()
            if name.startswith(part + ".")
        }
        if inner:
            place: Any = (
                problem.settings.excitation
                if part == "excitation"
                else problem.settings.response_location
            )
            problem = problem.replace(**{part: replace(place, **inner)})
    for name, value in sorted(
        settings.items(), key=lambda item: item[0].partition(".")[0] not in OF_LOAD
    ):  # then factors
        head, _, part = name.partition(".")
        if head == "friction_coefficient" and part:
            mu = problem.settings.friction_by_interface()
            own = problem.settings.own_laws()  # they do not use a coefficient
            faces = [
                face
                for face in problem.settings.law_by_interface()
                if face == part or face not in own
            ]
            coefficients = {face: value if face == part else mu[face] for face in faces}
            problem = problem.replace(friction_coefficient=coefficients)
        elif head in OF_LOAD and part:
            problem = problem.replace(**{head: {**problem.settings.given_loads(head), part: value}})
        elif head in FACTORS:
            problem = _scaled(problem, head, part, value)
    return problem


def replace_settings(problem: Problem, /, **settings: Any) -> Problem:
    """See :meth:`bdamper.Study.replace`."""
    own = {f.name for f in fields(problem.settings)}
    known = setting_names(problem)
    for name in settings.keys() - {*own, *known}:
        raise SettingError(
            f"Study: there is no argument '{name}'{validation.suggest_name(name, known)}"
        )
    varied = {name: settings.pop(name) for name in known if name in settings and name not in own}
    return vary(problem.replace(**settings), varied)


def _scaled(problem: Problem, name: str, part: str, factor: float) -> Problem:
    factor = validation.number(f"{name}.{part}" if part else name, factor, above=0.0)
    if name == "friction_factor":
        given = problem.settings.friction_coefficient
        expected = "a friction interface whose law has a friction coefficient above 0"
        validation.check(problem.settings.friction_values(), name, expected, "none")
        if isinstance(given, Mapping):
            own = problem.settings.own_laws()
            scaled = {
                face: factor * np.asarray(mu) for face, mu in given.items() if face not in own
            }
            return problem.replace(friction_coefficient=scaled)
        return problem.replace(friction_coefficient=factor * given)
    if name == "gap_factor":
        faces, gap = problem.coupling.interfaces, problem.point_gaps
        changed = {
            f: gap[problem.coupling.rows(f)] * (factor if part in (f, "") else 1.0) for f in faces
        }
        return problem.replace(gap=changed)
    if name in OF_MASS:
        return _of_mass(problem, name, part, factor)
    if part:
        expected = (
            "contact stiffness by values or unit tractions: residual modes are flexible as a whole"
        )
        validation.check(
            problem.contact.residual is None, f"{name}.{part}", expected, "residual modes"
        )
        way = np.where(part == "normal", [1.0, 1.0, factor], [factor, factor, 1.0])
        kinds = problem.settings.law_by_interface()
        values = {
            f: c.stiffness * (way if f in kinds else 1.0) for f, c in problem.stiffness.items()
        }
        return problem.replace(contact_stiffness=values, contact_stiffness_factor=1.0)
    if name == "contact_stiffness_factor":
        return problem.replace(
            contact_stiffness_factor=factor * problem.settings.contact_stiffness_factor
        )
    if name == "damping_factor":
        if problem.settings.damping_ratio is not None:
            return problem.replace(damping_ratio=factor * problem.settings.damping_ratio)
        bodies = {key: _damped(body, factor) for key, body in problem.model.bodies.items()}
        return problem.replace(model=as_checked(replace(problem.model, bodies=bodies)))
    whole = denser(
        problem.model, factor**-2, tuple(problem.model.bodies), whole=True
    )  # frequency_factor
    return problem.replace(model=as_checked(whole))


def _of_mass(problem: Problem, name: str, part: str, factor: float) -> Problem:
    """Scale the mass of all free bodies or of one, with or without the load that is proportional to it."""
    settings = problem.settings
    names = (part,) if part else settings.free_bodies
    validation.check(names, "mass of the damper", "a model with a free body", "none")
    model = denser(problem.model, factor, names)
    if name == INERTIA:
        one = len(names) < len(settings.free_bodies)
        expected = f"no rotor speed, where load and mass of a body go together; vary {MASS}.{part}"
        validation.check(
            settings.speed is None or not one, f"{name}.{part}", expected, f"{settings.speed} rad/s"
        )
        return problem.replace(model=as_checked(model))
    if settings.speed is not None:
        return problem.replace(model=as_checked(model))
    if not part:
        each = " and ".join(f"{MASS}.{body}" for body in names)
        raise SettingError(
            f"{MASS}: expected a study at a rotor speed, where the load is proportional to the mass, found none; use "
            f"study.at_speed(...), or vary {each} with the load at a given preload, or {INERTIA} without it"
        )
    # without a speed the load of one body is its share of the preload
    loads = settings.given_loads("load_per_preload").items()
    scaled = {key: factor * share if key == part else share for key, share in loads}
    return problem.replace(model=as_checked(model), load_per_preload=scaled or None)


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


def denser(model: Model, factor: float, names: Sequence[str], whole: bool = False) -> Model:
    """Return the model with the density of some bodies scaled: mass-normalised modes scale, flexibility does not change."""
    chosen = [model.bodies[name] for name in names if model.bodies[name].bases]
    bodies, root = dict(model.bodies), 1.0 / np.sqrt(factor)
    for body in chosen:
        bases = {
            d: replace(
                basis,
                omega2=basis.omega2 / factor,
                contact_modes=root * basis.contact_modes,
                locations={name: root * modes for name, modes in basis.locations.items()},
                drag=None if basis.drag is None else basis.drag / (factor if whole else 1.0),
                speed=basis.speed if not whole else None,
            )
            for d, basis in body.bases.items()
        }
        changed: dict[str, Any] = {"bases": bases}
        if body.load is not None:
            changed["load"] = replace(body.load, generalised=root * body.load.generalised)
        if body.constant_force is not None:
            changed["constant_force"] = root * body.constant_force
        if body.mass is not None and body.inertia is not None:
            changed |= {"mass": factor * body.mass, "inertia": factor * body.inertia}
        bodies[body.name] = replace(body, **changed, local=None if whole else body.local)
    return replace(model, bodies=bodies)


# ---- comparable coordinates of residual modes ----


def aligned(basis: HarmonicBasis, reference: HarmonicBasis) -> HarmonicBasis:
    """Return the basis with its residual modes rotated onto the residual modes of a reference basis.

    Raises
    ------
    SettingError
        If the two bases have different coordinates.
    """
    expected = "a range in which contacts keep their residual modes"
    found = 'one that changes them; give a shorter one, or contact_stiffness="unit_traction"'
    validation.check(basis.coordinates == reference.coordinates, "residual modes", expected, found)
    residual = np.array([i for i, c in enumerate(basis.coordinates) if c.body == RESIDUAL], int)
    if not len(residual):
        return basis
    mass, G = basis.mass[residual], basis.G.copy()
    equal_mass = (
        1e-6  # relative difference of modal masses below which residual modes form one group
    )
    for group in np.split(residual, np.flatnonzero(np.diff(mass) > equal_mass * mass.max()) + 1):
        columns, target = (
            array[..., group].reshape(-1, len(group)) for array in (basis.G, reference.G)
        )
        U, _, V = np.linalg.svd(columns.conj().T @ target)
        G[..., group] = (columns @ (U @ V)).reshape(*G.shape[:2], len(group))
    return replace(basis, G=G)


def like(problem: Problem, reference: Problem) -> Problem:
    """Return the problem with its residual modes rotated onto the residual modes of another problem."""
    bases = [aligned(b, other) for b, other in zip(problem.bases, reference.bases)]
    return problem.given(bases=bases, **({"static_basis": bases[0]} if bases[0].n_modes else {}))
