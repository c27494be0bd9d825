"""Contact points of a study: loads by interference, contact stiffness, and contacts without
separation.

**Normal loads between constrained bodies** (shrouds, roots, a platform pressed on the ground) are
made by interference at assembly.  With the loads ``N`` of the contact points the surfaces approach
by

    e = N/kn - v,      K q = -G^T F(T, N),      v = (G q)_n,

after the structure has deformed under the loads.  The friction ``T`` follows from surfaces that
stick or slip during loading; free bodies are absent.  ``e`` is part of the motion of the contact
points, ``x = G q + P s + s_0`` (:mod:`bdamper.contact.static_state`).

**Contact stiffness** comes from the method in the settings, or from the best method for which the
model has data.

**Without separation** a point has the two-sided normal spring ``n0 + kn v``, the difference of two
one-sided springs,

    n0 + kn v = max(n0 + kn v, 0) - max(-n0 - kn v, 0),

so a second point with the opposite normal is added, which costs little.  It carries no force unless
the contact would open.  Friction acts under pressure only, ``|T| <= mu max(n0 + kn v, 0)``.  For a
constant friction limit the core has laws that store the static normal load and have a two-sided
normal spring.  Friction points that are open in the static state are omitted.  Bonded points
neither open nor slip and remain unchanged.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from bdamper.contact.laws import (
    LAW_BONDED,
    LAW_CONSTANT,
    LAW_COUPLED,
    LAW_COUPLED_CONSTANT,
    LAW_NORMAL,
    LAW_SEPARABLE,
    PointArrays,
)
from bdamper.contact.preload_state import OPEN, PreloadState
from bdamper.contact.residual_flexibility import ResidualModes
from bdamper.contact.static_state import StaticSystem, static_state
from bdamper.contact.stiffness import ContactModel, PerArea, contact_stiffness
from bdamper.harmonic_balance.settings import Settings
from bdamper.model.contact_points import united
from bdamper.model.kinematics import Coupling, HarmonicBasis
from bdamper.model.structure import Interface
from bdamper.util import validation
from bdamper.util.errors import ModelError, SettingError, warn

SMALLEST_SHARE = 1e-3
"""Smallest fraction of a damper's load that its rigid-body modes in the study must carry."""

# ---- normal loads between constrained bodies ----


def at_points(
    name: str,
    value: float | NDArray,
    face: Interface,
    settings: Settings,
    kind: Literal["sum", "mean"],
) -> NDArray:
    """Return the values (n_points,) of one interface.

    Parameters
    ----------
    name : str
        Name in error messages.
    value : float or (n,) float
        One value for all points, or one for each point of the study or of the model.
    face : Interface
        Interface in the study.
    settings : Settings
        Settings with the interface in the model.
    kind : {"sum", "mean"}
        How united points get their values from the points of the model.

    Raises
    ------
    SettingError
        If a value is not finite, or their number is wrong.
    """
    if np.ndim(value) == 0:
        return np.full(face.n_points, validation.number(name, value))
    values = validation.numbers(name, value)
    # values of the model's points, whose patches the study has united
    face_of_model = settings.model.interfaces[face.name]
    are_united = face.n_points != face_of_model.n_points
    if are_united and len(values) == face_of_model.n_points:
        values = united(face_of_model, settings.contact_points, values, kind)
    validation.check_value(
        values.shape == (face.n_points,), name, f"one or {face.n_points} finite numbers", values
    )
    return values


def normal_loads(coupling: Coupling, settings: Settings, item: str) -> NDArray:
    """Return the normal loads (n_points,) of interfaces between constrained bodies, NaN without a
    load.

    Parameters
    ----------
    coupling : Coupling
    settings : Settings
    item : {"load_per_preload", "constant_loads"}
        Newtons per newton of preload, or constant loads in N.
    """
    by_point = np.full(coupling.n_points, np.nan)
    loads = getattr(settings, item)
    if loads is None:
        return by_point
    for name, load in loads.items():
        # other names are bodies
        if name not in coupling.interfaces:
            continue
        face = coupling.model.interfaces[name]
        values = at_points(f"{item} of '{name}'", load, face, settings, "sum")
        # a single number is the sum over the face
        if np.ndim(load) == 0:
            values = values * face.area / face.area.sum()
        by_point[coupling.rows(name)] = values
    return by_point


def approach(
    system: StaticSystem, load_per_preload: NDArray, touching: NDArray, item: str
) -> NDArray:
    """Compute the approach (n_points, 3) of the undeformed surfaces, m.

    It gives contact points their loads at rest.

    Parameters
    ----------
    system : StaticSystem
        System without the loads.
    load_per_preload : (n_points,) float, N
        NaN without a load.  A negative load is a gap of ``-N/kn`` at rest.
    touching : (n_points,) bool
        Points without a load that touch in the system without loads; all others are open.
    item : str
        Name of the loads in error messages.

    Raises
    ------
    SettingError
        If a loaded point has no normal stiffness, or there is no state at rest.
    """
    # components along t1, t2 and n; surfaces approach along n
    approach_at_points = np.zeros((len(load_per_preload), 3))
    pressed = ~np.isnan(load_per_preload)
    if not pressed.any():
        return approach_at_points
    kn = system.kn
    validation.check(
        (kn[pressed] > 0.0).all(),
        item,
        "loads only on points with a positive normal stiffness",
        f"a loaded point with {kn[pressed].min():g} N/m",
    )

    # an almost vanishing normal spring holds N constant while the structure deforms; a negative
    # constant load keeps other points apart
    apart = ~pressed & ~touching
    load_of_others = np.where(apart, -1.0, system.n0)
    held = replace(
        system,
        own=None,
        kt=system.kt * ~apart[:, None],
        kn=np.where(pressed | apart, 1e-12 * kn, kn),
        n0=np.where(pressed, load_per_preload, load_of_others),
        bonded=system.bonded & ~apart,
    )
    state = static_state(held, load=0.0)
    validation.check(state.ok, item, "a structure that can carry them at rest", state.reason)

    # e = N/kn - v
    motion = system.G @ state.q
    v = motion[pressed, 2]
    approach_at_points[pressed, 2] = load_per_preload[pressed] / kn[pressed] - v
    return approach_at_points


def gaps(coupling: Coupling, settings: Settings) -> NDArray:
    """Return the initial gaps (n_points,) of the surfaces, m.

    They are negative for interference, and 0 at points with a given load.
    """
    gap_by_name: Mapping[str, Any] = {}
    if settings.gap is not None:
        interfaces = coupling.interfaces
        gap_by_name = validation.mapping("gap", settings.gap, interfaces, "interfaces")
    parts = [np.zeros(0)]
    for name in coupling.interfaces:
        face = coupling.model.interfaces[name]
        gap = face.gap
        if name in gap_by_name:
            gap = at_points(f"gap of '{name}'", gap_by_name[name], face, settings, "mean")
        bonded = settings.law_by_interface().get(name) == LAW_BONDED
        if bonded and (gap > 0.0).any():
            raise SettingError(
                f"gap of '{name}': a bonded interface cannot have a gap, found {gap.max():.3g} m "
                f"at the widest of {(gap > 0.0).sum()} points"
            )
        parts.append(gap)

    by_preload = normal_loads(coupling, settings, "load_per_preload")
    constant = normal_loads(coupling, settings, "constant_loads")
    unloaded = np.isnan(by_preload) & np.isnan(constant)
    return np.where(unloaded, np.concatenate(parts), 0.0)


def carried(coupling: Coupling, settings: Settings, shares: Mapping[str, float] | None) -> bool:
    """Return whether the modes of a study can carry its preload.

    The generalised load on the rigid-body modes of the study must be at least `SMALLEST_SHARE` of
    the load on all six rigid-body modes.  Motions across the load carry only rounding errors.

    Parameters
    ----------
    coupling : Coupling
    settings : Settings
    shares : mapping of body name to float, optional
        Newtons on bodies per newton of preload.
    """
    shares_carried = []
    for body in coupling.model.bodies.values():
        loaded = shares is None or shares.get(body.name, 0.0) > 0.0
        if body.load is None or not np.any(body.load.generalised) or not loaded:
            continue
        if body.kind == "ring":
            # its static deformation carries the load, with any modes
            shares_carried.append(1.0)
            continue
        omega2 = body.bases[0].omega2
        retained = coupling.modes[body.name]
        load = body.load.generalised
        if body.kind == "free":
            # elastic modes of a free body do not carry its load
            load = np.where(omega2 == 0.0, load, 0.0)
        shares_carried.append(float(np.linalg.norm(load[retained]) / np.linalg.norm(load)))
    if shares_carried:
        return min(shares_carried) > SMALLEST_SHARE
    # without a loaded body the preload may press faces
    load_per_preload = settings.load_per_preload or {}
    return any(load_per_preload.get(name, 0.0) > 0.0 for name in settings.constrained_faces)


def assembly_offsets(spread: float, seed: int, friction: NDArray) -> NDArray:
    """Draw initial slider positions (n_points, 2), m.

    Points with friction have the standard deviation ``spread``.
    """
    drawn = np.random.default_rng(seed).standard_normal((len(friction), 2))
    # both directions of a point without friction have the offset 0
    has_friction = (friction > 0.0)[:, None]
    return np.asarray(spread * drawn * has_friction)


# ---- contact stiffness ----


def contact_of(settings: Settings, coupling: Coupling, friction: NDArray) -> ContactModel:
    """Compute the contact stiffness by the method of the settings, with residual modes if the
    method has them.

    The default is residual modes.  :attr:`Model.partial_contact` adds force vectors of partial
    contact.  If the model lacks the data for them, the stiffness in the model is used, or unit
    tractions if the model has no stiffness.
    """
    if not coupling.interfaces:
        return ContactModel({}, method="none")
    if settings.contact_stiffness is not None:
        return _contact_by(settings, coupling, friction, settings.contact_stiffness)
    default: Any = "residual_modes"
    if settings.model.partial_contact:
        default = ResidualModes(partial_contact=True)
    try:
        contact = _contact_by(settings, coupling, friction, default)
        # the data of a harmonic may be missing
        if contact.residual is not None:
            for harmonic in sorted({0, *settings.active_harmonics}):
                _ = contact.residual.basis(harmonic)
        return contact
    except (ModelError, SettingError) as error:
        reason = str(error)
    in_model = all(name in settings.model.contact for name in coupling.interfaces)
    second_best = "model" if in_model else "unit_traction"
    contact = _contact_by(settings, coupling, friction, second_best)
    note = (
        f'contact stiffness "{contact.method}" instead of residual modes ({reason}); peaks may be '
        "wrong by tens of per cent; compare with more blade modes"
    )
    warn(note)
    return replace(contact, note=note)


def _contact_by(
    settings: Settings, coupling: Coupling, friction: NDArray, method: Any
) -> ContactModel:
    if isinstance(method, str) and method == "model":
        missing = [name for name in coupling.interfaces if name not in settings.model.contact]
        if missing:
            raise SettingError(
                f'contact_stiffness="model": the model has none for interfaces {missing}'
            )
        stiffness = {name: coupling.model.contact[name] for name in coupling.interfaces}
        return ContactModel(stiffness, method=method)
    at_points_of_study = method
    values = not isinstance(method, (str, ResidualModes, PerArea))
    if values and settings.contact_points is not None:
        at_points_of_study = _united_stiffness(settings, coupling, method)
    return replace(contact_stiffness(coupling, at_points_of_study, friction), method=method)


def _united_stiffness(settings: Settings, coupling: Coupling, method: Any) -> dict[str, NDArray]:
    """Return the stiffness at united points from values at the points of the model."""
    if isinstance(method, Mapping):
        of_interface = method
    else:
        of_interface = dict.fromkeys(coupling.interfaces, method)
    stiffness = {}
    for name, value in of_interface.items():
        face = settings.model.interfaces[name]
        values = np.broadcast_to(np.asarray(value, float), (face.n_points, 3))
        stiffness[name] = united(face, settings.contact_points, values, "sum")
    return stiffness


# ---- contacts without separation or with a constant friction limit ----


CONSTANT = {
    LAW_SEPARABLE: LAW_CONSTANT,
    LAW_COUPLED: LAW_COUPLED_CONSTANT,
    LAW_NORMAL: LAW_CONSTANT,
}
"""Law of constant normal load for each law of variable load."""


def without_separation(
    bases: list[HarmonicBasis],
    points: PointArrays,
    state: PreloadState,
    friction_points: NDArray,
    *,
    constant_load: bool,
) -> tuple[list[HarmonicBasis], PointArrays]:
    """Return modes and points under the assumption that the static contact area does not change.

    Parameters
    ----------
    bases : list of HarmonicBasis
    points : PointArrays
    state : PreloadState
        Static state: defines the closed points and the constant normal load.
    friction_points : (n_points,) bool
        Points to which the assumption applies.  Constraint planes remain one-sided.
    constant_load : bool
        Whether the friction limit has its static value.

    Returns
    -------
    bases, points
        Retained points in their order, then the additional points.
    """
    closed = ~(state.status == OPEN).any(axis=1)
    bonded = points.law == LAW_BONDED
    keep = np.flatnonzero(closed | bonded | ~friction_points)
    # closed points to which the assumption applies
    held = np.flatnonzero(closed & friction_points & ~bonded)
    if constant_load:
        retained = points.taken(keep)
        for i in np.flatnonzero(np.isin(keep, held)):
            law = int(retained.law[i])
            retained.law[i] = CONSTANT.get(law, law)
        # component 2 is the normal force
        retained = replace(retained, load=state.force[keep, 2])
        return [replace(basis, G=basis.G[keep]) for basis in bases], retained

    # each held point has a second one with the opposite normal, without friction
    source = np.concatenate([keep, held])
    added = slice(len(keep), None)
    # factors on (u1, u2, v); the second points have no tangential motion
    sign = np.ones((len(source), 3))
    sign[added] = [-0.0, -0.0, -1.0]
    doubled = points.taken(source)
    doubled.law[added] = LAW_NORMAL
    doubled.mu[added] = 0.0
    doubled.kt[added] = 0.0
    doubled.slider[added] = 0.0
    doubled.n0[added] *= -1.0
    doubled = replace(doubled, shift=doubled.shift * sign)
    signed_bases = []
    for basis in bases:
        # (n_points, 3, n_modes)
        G = basis.G[source] * sign[..., None]
        signed_bases.append(replace(basis, G=G))
    return signed_bases, doubled
