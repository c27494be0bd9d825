"""Normal loads of interfaces between constrained bodies: shrouds, roots, a platform pressed on the ground.

Such a load is made by interference at assembly.  With the loads ``N`` of the contact points the surfaces approach by

    e = N/kn - v,      K q = -G^T F(T, N),      v = (G q)_n,

when the structure has given way to them, where the friction ``T`` is that of surfaces that stick or slip while the loads
are put on, and free bodies are not there.  ``e`` takes part in the motion of the contact points,
``x = G q + P s + s_0`` (:mod:`bdamper.contact.static_state`), as what preload or fixed loads displace.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bdamper.contact.law_codes import LAW_BONDED
from bdamper.contact.static_state import StaticSystem, static_state
from bdamper.harmonic_balance.settings import Settings
from bdamper.model.kinematics import Coupling
from bdamper.model.patch_merging import united_mean, united_sum
from bdamper.model.structure import Interface
from bdamper.util import validation
from bdamper.util.errors import SettingError

SMALLEST_SHARE = 1e-3
"""Share of a damper's load that its rigid-body modes in the study must carry."""


def at_points(
    name: str, value: float | NDArray, face: Interface, whole: Interface, united: Callable[..., NDArray]
) -> NDArray:
    """(n_points,) values of one interface.

    Parameters
    ----------
    name : str
        In errors.
    value : float or (n,) float
        One for all points, or one for each point of the study or of the model.
    face, whole : Interface
        In the study and in the model.
    united : callable
        Values of the points of the study from those of the model: ``united(whole, n_points, values)``.

    Raises
    ------
    SettingError
        If they are not finite, or of another number.
    """
    if np.ndim(value) == 0:
        return np.full(face.n_points, validation.number(name, value))
    values = validation.numbers(name, value)
    if len(values) == whole.n_points != face.n_points:
        values = united(whole, face.n_points, values)
    validation.that(values.shape == (face.n_points,), name, f"one or {face.n_points} finite numbers", values)
    return values


def normal_loads(coupling: Coupling, settings: Settings, item: str) -> NDArray:
    """(n_points,) normal loads of interfaces between constrained bodies, NaN where none is given.

    Parameters
    ----------
    coupling : Coupling
    settings : Settings
    item : {"loads", "constant_loads"}
        Newtons per newton of preload, or fixed ones.
    """
    out = np.full(coupling.n_points, np.nan)
    for name, load in (getattr(settings, item) or {}).items():
        if name in coupling.interfaces:
            face, whole = coupling.model.interfaces[name], settings.model.interfaces[name]
            values = at_points(f"{item} of '{name}'", load, face, whole, united_sum)
            out[coupling.rows(name)] = values * face.area / face.area.sum() if np.ndim(load) == 0 else values
    return out


def approach(system: StaticSystem, load_per_preload: NDArray, touching: NDArray, item: str) -> NDArray:
    """(n_points, 3) approach of the undeformed surfaces that gives contact points their loads at rest.

    Parameters
    ----------
    system : StaticSystem
        Without the loads.
    loads : (n_points,) float, N
        NaN where none is given; a negative one is a gap of ``-N/kn`` at rest.
    touching : (n_points,) bool
        Points without a load that touch as they do without it; the others are apart.
    item : str
        Name of the loads in errors.

    Raises
    ------
    SettingError
        If a loaded point has no normal stiffness, or there is no state at rest.
    """
    out, pressed, kn = np.zeros((len(load_per_preload), 3)), ~np.isnan(load_per_preload), system.kn
    if not pressed.any():
        return out
    expected = "loads of points with a normal stiffness"
    validation.require((kn[pressed] > 0.0).all(), item, expected, f"one of {kn[pressed].min():g} N/m")
    apart = ~pressed & ~touching
    # a normal spring that is all but missing keeps N at its value while the structure moves
    held = replace(
        system, own=None, kt=system.kt * ~apart[:, None], kn=np.where(pressed | apart, 1e-12 * kn, kn),
        n0=np.where(pressed, load_per_preload, np.where(apart, -1.0, system.n0)),
        bonded=system.bonded & ~apart,
    )  # fmt: skip
    state = static_state(held, 0.0)
    validation.require(state.converged, item, "a structure that can carry them at rest", state.note)
    out[pressed, 2] = load_per_preload[pressed] / kn[pressed] - (system.G @ state.q)[pressed, 2]
    return out


def gaps(coupling: Coupling, settings: Settings) -> NDArray:
    """(n_points,) initial distance of the surfaces (m), negative for interference, none where a load is given.

    Parameters
    ----------
    coupling : Coupling
    settings : Settings
    """
    given = {} if settings.gap is None else validation.mapping("gap", settings.gap, coupling.interfaces, "interfaces")
    parts = []
    for name in coupling.interfaces:
        face = coupling.model.interfaces[name]
        gap = face.gap
        if name in given:
            gap = at_points(f"gap of '{name}'", given[name], face, settings.model.interfaces[name], united_mean)
        if settings.law_by_interface().get(name) == LAW_BONDED and (gap > 0.0).any():
            raise SettingError(
                f"gap of '{name}': expected none under friction_law=\"bonded\", which holds the surfaces together in "
                f"both senses, found {gap.max():.3g} m at the widest of {(gap > 0.0).sum()} points"
            )
        parts.append(gap)
    unloaded = np.isnan(
        normal_loads(coupling, settings, "load_per_preload") + normal_loads(coupling, settings, "constant_loads")
    )
    return np.where(unloaded, np.concatenate(parts), 0.0)


def carried(coupling: Coupling, settings: Settings, shares: Mapping[str, float] | None) -> bool:
    """Whether a study has the motions along which its preload acts.

    The generalised load on the rigid-body modes that the study has must be at least a thousandth of that on all six:
    motions across the load carry nothing but rounding.

    Parameters
    ----------
    coupling : Coupling
    settings : Settings
    shares : mapping of body name to float, optional
        Newtons on bodies per newton of preload.
    """
    found = []
    for body in coupling.model.bodies.values():
        loaded = shares is None or shares.get(body.name, 0.0) > 0.0
        if body.load is None or not np.any(body.load.generalised) or not loaded:
            continue
        omega2, kept = body.bases[0].omega2, coupling.modes[body.name]
        counts = omega2 == 0.0 if body.kind == "free" else np.ones(len(omega2), bool)
        load = np.where(counts, body.load.generalised, 0.0)
        found.append(float(np.linalg.norm(load[kept]) / np.linalg.norm(load)))
    on_faces = any((settings.load_per_preload or {}).get(name, 0.0) > 0.0 for name in settings.constrained_faces)
    return min(found, default=float(on_faces)) > SMALLEST_SHARE


def assembly_offsets(spread: float, seed: int, friction: NDArray) -> NDArray:
    """(n_points, 2) float, m: sliders before any load, drawn with a standard deviation where there is friction."""
    drawn = np.random.default_rng(seed).standard_normal((len(friction), 2))
    return np.asarray(spread * drawn * (friction > 0.0)[:, None])
