"""One model under one set of settings, and the equations that follow from them.

When they are first needed, :class:`Problem` computes the modal bases of the harmonics, the contact
stiffness, and the static states under the preload (paper, section 3.1).  :class:`LoadCase`,
``problem.at(preload)``, contains the harmonic balance equations at one preload (paper, Eq. (16)).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import InitVar, dataclass, replace
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from bdamper.contact.laws import LAW_BONDED, LAW_CUBIC, LAW_NORMAL, LAW_USER, OwnLaws, PointArrays
from bdamper.contact.preload_state import OPEN, PreloadState
from bdamper.contact.residual_flexibility import RESIDUAL, ResidualModes, joined
from bdamper.contact.static_contact import WedgeFriction, wedge_friction
from bdamper.contact.static_state import StaticSystem, scaled_state, static_state
from bdamper.contact.stiffness import ContactModel, check_method
from bdamper.harmonic_balance import residual_forces
from bdamper.harmonic_balance.contact_setup import (
    approach,
    assembly_offsets,
    at_points,
    carried,
    contact_of,
    gaps,
    normal_loads,
    without_separation,
)
from bdamper.harmonic_balance.equations import Equations, Layout
from bdamper.harmonic_balance.model_sizes import Sizes
from bdamper.harmonic_balance.residual_forces import ROUNDING, Residual
from bdamper.harmonic_balance.sector import Linear, SectorData
from bdamper.harmonic_balance.settings import Settings, check_history
from bdamper.model.contact_points import unite_contact_points
from bdamper.model.gauges import ALONG_GAUGE, GAUGE, with_gauge
from bdamper.model.kinematics import (
    Coordinate,
    Coupling,
    HarmonicBasis,
    centrifugal_arms,
    damper_drag,
    in_flow,
    standard_rigid_modes,
)
from bdamper.model.loads import BASE, Response, direction_vector
from bdamper.model.residual_vectors import completed
from bdamper.model.structure import ContactStiffness, Model
from bdamper.util import validation
from bdamper.util.errors import ModelError, SettingError, StaticError, inside_package, warn
from bdamper.util.formatting import amount, listed
from bdamper.util.progress import CostMeter, one_thread

T = TypeVar("T")
FORCES = (1e-100, 1e100)
"""Range of modal forces for which the squared response neither underflows nor overflows."""


def made_once(make: Callable[[Any], T]) -> cached_property[T]:
    """Return a cached property without the lock of Python 3.11.

    All instances share the lock, and it would serialise threads.
    """
    prop = cached_property(make)
    prop.lock = nullcontext()  # type: ignore[attr-defined]
    return prop


@dataclass(frozen=True, eq=False)
class Problem:
    """Model with settings, and all quantities derived from them.

    Two problems are equal only if they are the same object.

    Parameters
    ----------
    settings : Settings

    Raises
    ------
    SettingError, ModelError
        If the model lacks a nodal diameter that the harmonics need, or gaps or stiffness values are
        not valid.
    """

    settings: Settings
    # derived quantities by name, such as "bases", that replace the computed ones; see `given`
    _derived: InitVar[Mapping[str, Any] | None] = None

    def __post_init__(self, _derived: Mapping[str, Any] | None) -> None:
        # a cached property returns an attribute of its name without computing it
        if _derived is not None:
            for name, part in _derived.items():
                object.__setattr__(self, name, part)
        # these raise if a nodal diameter is missing or a gap is not valid
        _ = self.modal_bases
        _ = self.point_gaps
        self._check_stiffness()

    def _check_stiffness(self) -> None:
        """Check method names and user-defined values; data that a method needs are checked when it
        is used.
        """
        method = self.settings.contact_stiffness
        if method is None:
            return
        from_model = isinstance(method, str) and method == "model"
        if not from_model:
            check_method(method)
        # using them raises if a value is missing or not valid
        are_values = not isinstance(method, str | ResidualModes)
        if from_model or are_values:
            _ = self.contact

    @property
    def model(self) -> Model:
        """Model of the structure."""
        return self.settings.model

    @property
    def engine_order(self) -> int:
        """Engine order of the fundamental harmonic."""
        return self.settings.engine_order

    @property
    def harmonic_numbers(self) -> tuple[int, ...]:
        """Harmonics without the mean, ascending."""
        return self.settings.harmonic_numbers

    # ---- record in results ----

    def record(self, options: object = None) -> dict[str, Any]:
        """Return all settings in the form of results, with ``options`` of the continuation."""
        return self.settings.record(self.stiffness_method, options)

    def recorded(self, options: object = None) -> dict[str, Any]:
        """Return settings (:meth:`record`) and hash of the model, for results."""
        return {"settings": self.record(options), "model_hash": self.model.hash}

    @property
    def damping_text(self) -> str:
        """Modal damping ratio of the retained elastic modes.

        It is the value in the settings, or the value of each body in the model.
        """
        setting = self.settings.damping_ratio
        if setting is not None:
            return f"{setting:.3g}"
        texts = {}
        for name, modes in self.coupling.modes.items():
            body = self.model.bodies[name]
            if len(modes) > body.n_rigid and body.damping_text:
                texts[name] = body.damping_text
        if len(texts) == 1:
            return next(iter(texts.values()))
        return ", ".join(f"{name} {text}" for name, text in texts.items())

    # ---- other settings ----

    def replace(self, /, **settings: Any) -> Problem:
        """Return a copy of the problem with some settings changed.

        Raises
        ------
        SettingError
            If a value is not valid.
        """
        # check_settings warns about implausible values; it needs the sizes of the model
        with inside_package():
            changed = replace(self.settings, **settings)
        if self.sizes.lumped and "friction_coefficient" in settings:
            changed.warn_of_unused_friction(settings["friction_coefficient"])
        return Problem(changed)

    def given(self, **parts: Any) -> Problem:
        """Return the problem with the given derived quantities; all other quantities already
        computed are reused.

        Parameters
        ----------
        **parts
            Values of properties, for example ``bases=``.
        """
        derived = dict(vars(self))
        # sizes and load cases refer to this problem, and forces to its modes
        for name in ("settings", "sizes", "excitation_force", "linear", "_load_cases"):
            derived.pop(name, None)
        return Problem(self.settings, derived | parts)

    # ---- derived quantities, computed once ----

    @made_once
    def static_states(self) -> dict[tuple[float, ...], PreloadState]:
        """Static states computed so far, by preload and load history."""
        return {}

    @made_once
    def coupling(self) -> Coupling:
        """Model with the retained modes and interfaces."""
        settings = self.settings
        bodies = dict(self.model.bodies)
        for name, body in bodies.items():
            if body.kind == "free":
                bodies[name] = standard_rigid_modes(self.model, body)
        model = replace(self.model, bodies=bodies)
        if settings.contact_points is not None:
            model = unite_contact_points(model, settings.contact_points)
        if settings.response_location.elastic is not None:
            model = with_gauge(model, settings.response_location)
        model, retained = completed(
            model,
            settings.places,
            min(settings.blade_modes, settings.most_modes("constrained")),
            settings.by_body("damper_modes"),
            settings.rigid_modes,
        )
        return Coupling(
            model,
            settings.interface_names(),
            retained,
            int(self.engine_order),
            settings.fundamental_modes_only,
        )

    @made_once
    def body_loads(self) -> Mapping[str, float] | None:
        """Load (N) on each body per newton of preload; at a rotor speed, it is proportional to mass
        times radius.
        """
        if self.settings.speed is None:
            return self.settings.load_per_preload
        # the preload is the load of the first body
        arms = centrifugal_arms(self.model)
        first = next(iter(arms.values()), 1.0)
        return {name: arm / first for name, arm in arms.items()}

    @made_once
    def static_basis(self) -> HarmonicBasis:
        """Modes of the static state."""
        return self._with_residual(self.coupling.basis(0), 0)

    def _with_residual(self, basis: HarmonicBasis, harmonic: int) -> HarmonicBasis:
        """Append the residual modes of a harmonic, if the contact stiffness has them."""
        residual = self.contact.residual
        if residual is None:
            return basis
        modes = residual.basis(harmonic)
        factor = float(self.settings.contact_stiffness_factor)
        return joined(basis, replace(modes, omega2=factor * modes.omega2))

    def _with_base(self, basis: HarmonicBasis, harmonic: int) -> HarmonicBasis:
        """Append the translations of the base if it moves at this harmonic and the response is absolute.

        They are free masses of 1 kg, which no contact moves.  A force on them is their
        acceleration.
        """
        kinds = {name: place.kind for name, place in self.model.locations.items()}
        base_moves = False
        for location, _direction, _force in self.settings.excited.get(harmonic, ()):
            if kinds.get(location) == "base":
                base_moves = True
        if not (self.settings.response_location.absolute and base_moves):
            return basis
        n_points = len(basis.G)
        translations = HarmonicBasis(
            coordinates=tuple(Coordinate(BASE, i, f"base {axis}") for i, axis in enumerate("XYZ")),
            omega2=np.zeros(3),
            damping_ratio=np.zeros(3),
            G=np.zeros((n_points, 3, 3), basis.G.dtype),
            nodal_diameter=basis.nodal_diameter,
            mass=np.ones(3),
        )
        return joined(basis, translations)

    @made_once
    def modal_bases(self) -> list[HarmonicBasis]:
        """Modes of the bodies for the mean and each harmonic."""
        active = self.settings.active_harmonics
        bases = []
        for harmonic in range(self.harmonic_numbers[-1] + 1):
            if harmonic in active:
                bases.append(self.coupling.basis(harmonic))
            else:
                bases.append(self.coupling.no_basis())
        return bases

    @made_once
    def bases(self) -> list[HarmonicBasis]:
        """Modes of each harmonic, the mean first; residual modes are last."""
        active = self.settings.active_harmonics
        bases = []
        for harmonic, basis in enumerate(self.modal_bases):
            if harmonic in active:
                basis = self._with_base(basis, harmonic)
                basis = self._with_residual(basis, harmonic)
            # a mean is no wave
            wave = int(self.engine_order) * harmonic if harmonic > 0 else None
            bases.append(self.damped(basis, wave))
        return bases

    def damped(self, basis: HarmonicBasis, wave: int | None) -> HarmonicBasis:
        """Return the modes of a harmonic with the damping of the settings.

        ``wave`` is None for a mean.
        """
        ratio = self.settings.damping_ratio
        if ratio is not None:
            basis = replace(basis, damping_ratio=np.where(basis.omega2 > 0.0, ratio, 0.0))
        flow = self.settings.aerodynamic_damping
        if wave is not None and isinstance(flow, Mapping):
            basis = in_flow(basis, self.model, flow, wave)
        if not self._damper_drag:
            return basis
        of_damper = [self._damper_drag.get(mode, 0.0) for mode in basis.coordinates]
        return replace(basis, drag=basis.drag + np.array(of_damper))

    @made_once
    def _damper_drag(self) -> dict[Coordinate, float]:
        """Damping constants of the motions of free bodies by the settings; empty without any."""
        ratio = self.settings.by_body("damper_damping_ratio")
        drag = self.settings.by_body("damper_drag")
        if not (any(ratio.values()) or any(drag.values())):
            return {}
        # springs of stuck friction faces and of spring interfaces, (n_points, 3)
        held = self.friction_points | self.coupling.spring_points
        springs = held[:, None] * self.stick_stiffness
        rates = damper_drag(self.model, self.static_basis, springs, ratio=ratio, drag=drag)
        # a ring has other motions at each nodal diameter, all with the same rate
        for basis in self.modal_bases:
            for mode in basis.coordinates:
                body = self.model.bodies[mode.body]
                if body.kind == "ring" and body.mass is not None:
                    rates[mode] = drag[mode.body] / body.mass
        return rates

    @property
    def stick_stiffness(self) -> NDArray:
        """Stiffness (n_points, 3) of points that stick, N/m; 0 along t1 and t2 without friction."""
        # columns t1 and t2, then n
        normal_stiffness = self.point_stiffness[:, 2:]
        return np.concatenate([self.tangential_stiffness, normal_stiffness], axis=1)

    @made_once
    def friction(self) -> NDArray:
        """Friction coefficient of each point, (n_points,)."""
        mu = np.zeros(self.coupling.n_points)
        for name, value in self.settings.friction_by_interface().items():
            face = self.coupling.model.interfaces[name]
            mu[self.coupling.rows(name)] = at_points(
                "friction_coefficient", value, face, self.settings, "mean"
            )
        return mu

    @made_once
    def contact(self) -> ContactModel:
        """Contact stiffness by the method of the settings, with residual modes if the method has
        them.
        """
        return contact_of(self.settings, self.coupling, self.friction)

    @property
    def stiffness_method(self) -> Any:
        """Method or values of the contact stiffness; without a setting, the method that is used."""
        if self.settings.contact_stiffness is not None:
            return self.settings.contact_stiffness
        try:
            return self.contact.method
        except (ModelError, SettingError):
            # no method is possible; an analysis raises the error
            return "residual_modes"

    @made_once
    def stiffness(self) -> dict[str, ContactStiffness]:
        """Contact stiffness of each interface."""
        factor = float(self.settings.contact_stiffness_factor)
        user_laws = self.settings.own_laws()
        stiffness = {}
        for name, contact in self.contact.stiffness.items():
            if name in user_laws:
                stiffness[name] = user_laws[name].springs(len(contact.stiffness), name)
            elif self.model.interfaces[name].kind in ("cubic", "spring"):
                # the factor applies to contacts alone
                stiffness[name] = contact
            else:
                stiffness[name] = replace(contact, stiffness=factor * contact.stiffness)
        return stiffness

    @made_once
    def own_laws(self) -> OwnLaws | None:
        """User-defined contact laws at the points, or None."""
        user_laws = [
            (self.coupling.rows(name), name, law) for name, law in self.settings.own_laws().items()
        ]
        if not user_laws:
            return None
        # a typical motion of the points: the static response in stick to the excitation
        basis = self.bases[1]
        # motion (3 n_points, n_modes) of the points, and the spring of each row
        motion_rows = basis.G.reshape(-1, basis.n_modes)
        springs = self.point_stiffness.reshape(-1, 1)
        stiffness = np.diag(basis.omega2) + motion_rows.conj().T @ (springs * motion_rows)
        # by least squares, because a rigid-body motion may be free
        q, *_ = np.linalg.lstsq(stiffness, self.modal_force(1), rcond=None)
        motion = np.abs(motion_rows @ q).reshape(-1, 3)
        length = max(float(motion[rows].max()) for rows, _, _ in user_laws)
        if length == 0.0:
            length = 1.0
        kn = self.point_stiffness[:, 2]
        return OwnLaws.of(user_laws, kn, self.point_gaps, length)

    @made_once
    def point_stiffness(self) -> NDArray:
        """Contact stiffness (n_points, 3) along t1, t2, n, N/m."""
        stiffness = [self.stiffness[name].stiffness for name in self.coupling.interfaces]
        return np.concatenate([np.zeros((0, 3)), *stiffness])

    @made_once
    def point_gaps(self) -> NDArray:
        """Initial gaps (n_points,) of the surfaces, m.

        They are negative for interference, and 0 at points with a given load.
        """
        return gaps(self.coupling, self.settings)

    @made_once
    def point_laws(self) -> NDArray:
        """Number of the contact law of each point (n_points,), see :mod:`bdamper.contact.laws`."""
        law = np.full(self.coupling.n_points, LAW_NORMAL)
        for name in self.coupling.interfaces:
            rows = self.coupling.rows(name)
            kind = self.model.interfaces[name].kind
            if kind == "cubic":
                law[rows] = LAW_CUBIC
            elif kind == "spring":
                law[rows] = LAW_BONDED
        for name, friction_law in self.settings.law_by_interface().items():
            rows = self.coupling.rows(name)
            if friction_law in (LAW_BONDED, LAW_USER):
                law[rows] = friction_law
            else:
                law[rows] = np.where(self.friction[rows] > 0.0, friction_law, LAW_NORMAL)
        return law

    @made_once
    def bonded_points(self) -> NDArray:
        """Whether each point has linear springs instead of contact, (n_points,) bool."""
        return self.point_laws == LAW_BONDED

    @made_once
    def tangential_stiffness(self) -> NDArray:
        """Contact stiffness (n_points, 2) along t1 and t2, N/m; 0 without friction or bond."""
        frictionless = np.isin(self.point_laws, (LAW_NORMAL, LAW_CUBIC))
        # (n_points, 2) * (n_points, 1)
        return self.point_stiffness[:, :2] * ~frictionless[:, None]

    @made_once
    def friction_points(self) -> NDArray:
        """Whether each point belongs to a friction interface, (n_points,) bool.

        Its friction coefficient may be 0.
        """
        parts = [np.zeros(0, bool)]
        for name in self.coupling.interfaces:
            face = self.coupling.model.interfaces[name]
            parts.append(np.full(face.n_points, face.kind == "friction"))
        return np.concatenate(parts)

    @made_once
    def damper_load(self) -> tuple[NDArray, NDArray]:
        """Load per newton of preload.

        Modal force (n_modes,), and displacement (n_points, 3) that the modes do not contain.
        """
        force, shift = self.coupling.load(self.body_loads)
        loads = normal_loads(self.coupling, self.settings, "load_per_preload")
        nothing_touches = np.zeros(len(loads), bool)
        shift = shift + approach(self._unloaded, loads, nothing_touches, "load_per_preload")
        return self._padded(force), shift

    @made_once
    def fixed_load(self) -> tuple[NDArray, NDArray]:
        """Load without preload, as ``damper_load``.

        Modal force (n_modes,), N kg^-1/2, and displacement (n_points, 3), m.
        """
        constant_loads = self.settings.constant_loads or {}
        total = {name: float(np.sum(load)) for name, load in constant_loads.items()}
        force, shift = self.coupling.load(total)
        constant = self._padded(self.coupling.constant_force())
        loads = normal_loads(self.coupling, self.settings, "constant_loads")
        touching = np.isin(self.coupling.interface_of, self.settings.constrained_faces)
        unloaded = replace(self._unloaded, constant_force=constant)
        shift = shift + approach(unloaded, loads, touching, "constant_loads")
        return constant + self._padded(force), shift

    @property
    def interference(self) -> NDArray:
        """Interference of the surfaces at assembly (n_points,), m: that of constant loads, or minus the
        gap.  It is NaN at points that are no face between constrained bodies.
        """
        _, shift = self.fixed_load
        constrained = np.isin(self.coupling.interface_of, self.settings.constrained_faces)
        return np.where(constrained, shift[:, 2] - self.point_gaps, np.nan)

    def _padded(self, force: NDArray) -> NDArray:
        """Append zero forces for the residual modes."""
        return np.pad(force, (0, self.static_basis.n_modes - len(force)))

    def location_modes(self, location: str, harmonic: int) -> NDArray:
        """Return the motion (3, n_modes) of a location for unit modal coordinates of a harmonic.

        The columns of residual modes are zero.
        """
        modes = self.coupling.location_modes(location, harmonic)
        if any(coordinate.body == BASE for coordinate in self.bases[harmonic].coordinates):
            modes = np.hstack([modes, self.coupling.carried_by_base(location, BASE)])
        n_residual = self.bases[harmonic].n_modes - modes.shape[1]
        return np.pad(modes, ((0, 0), (0, n_residual)))

    def modal_force(self, harmonic: int) -> NDArray:
        """Return the complex modal excitation (n_modes,) of an excited harmonic."""
        modal = []
        for location, direction, force in self.settings.excited[harmonic]:
            motion = direction @ self.location_modes(location, harmonic)
            modal.append(motion.conj() * force)
        return np.sum(modal, axis=0)

    @made_once
    def response_rows(self) -> list[NDArray]:
        """Row (n_modes,) of each harmonic, starting with the mean.

        Its product with the modal amplitudes is the response.
        """
        return self.rows_at(self.settings.response_location)

    def rows_at(self, place: Response) -> list[NDArray]:
        """Return one row (n_modes,) for each harmonic, starting with the mean.

        Multiplied by the modal amplitudes, a row gives the motion of a location along a direction,
        or the strain of a gauge.
        """
        # only a strain gauge has a material
        is_gauge = place.elastic is not None
        if is_gauge:
            # with_gauge() has stored the strain as the first component of a location
            location = GAUGE
            direction = ALONG_GAUGE
        else:
            location = str(place.location)
            direction = direction_vector(place.direction, "response direction")
        active = self.settings.active_harmonics
        rows = []
        for harmonic in range(self.harmonic_numbers[-1] + 1):
            if harmonic in active:
                row = direction @ self.location_modes(location, harmonic)
                if is_gauge:
                    row = row + self._strain_of_residual_modes(place, harmonic)
                # a relative response excludes the motion of the base
                if not place.absolute:
                    moves_base = [c.body == BASE for c in self.bases[harmonic].coordinates]
                    row = np.where(moves_base, 0.0, row)
                rows.append(row)
            else:
                rows.append(np.zeros(0))
        # the mean is real
        rows[0] = rows[0].real
        return rows

    def _strain_of_residual_modes(self, place: Response, harmonic: int) -> NDArray:
        """Return the row (n_modes,) of the strain that contact forces cause beyond the retained modes.

        Residual modes follow the contact forces, ``omega2 q = -G^H F``.  The row combines them to
        the strain ``-s^H F`` of these forces.
        """
        basis = self.bases[harmonic]
        row = np.zeros(basis.n_modes, complex)
        is_residual = np.array([c.body == RESIDUAL for c in basis.coordinates])
        strain = self.coupling.strain_by_contact(place, harmonic)
        if not is_residual.any():
            if strain.any() and harmonic == 1:
                warn(
                    "response: the strain lacks the local part that contact forces cause at the "
                    "gauge, because the contact stiffness does not come from residual modes; "
                    "study.gauge_stress includes it"
                )
            return row
        # with G c = s the strain -s^H F is -c^H G^H F = c^H omega2 q
        G = basis.G.reshape(-1, basis.n_modes)[:, is_residual]
        c, *_ = np.linalg.lstsq(G, strain, rcond=1e-9)
        row[is_residual] = c.conj() * basis.omega2[is_residual]
        return row

    @made_once
    def sizes(self) -> Sizes:
        """Characteristic sizes of the model, used to check whether settings are plausible."""
        return Sizes(self)

    # ---- static analysis ----

    @made_once
    def _unloaded(self) -> StaticSystem:
        """Static contact problem without loads."""
        basis = self.static_basis
        kn = self.point_stiffness[:, 2]
        cubic = self.point_laws == LAW_CUBIC
        no_force = np.zeros(basis.n_modes)
        # number of the body of each mode; a residual mode counts as a body
        owners = [c if c.body == RESIDUAL else c.body for c in basis.coordinates]
        number = {owner: i for i, owner in enumerate(dict.fromkeys(owners))}
        return StaticSystem(
            stiffness=basis.omega2,
            G=basis.G.real,
            kt=self.tangential_stiffness,
            kn=kn,
            mu=self.friction,
            n0=-kn * self.point_gaps,
            force=no_force,
            shift=np.zeros((self.coupling.n_points, 3)),
            constant_force=no_force,
            bonded=self.bonded_points,
            cubic=self.point_stiffness[:, :2] * cubic[:, None],
            own=self.own_laws,
            body=np.array([number[owner] for owner in owners], int),
        )

    @made_once
    def displacement_by_rotation(self) -> NDArray:
        """Displacement (n_points, 3) of the faces at the rotor speed, m.

        The centrifugal load of the blade causes it.
        """
        speed = self.settings.speed or 0.0
        return speed**2 * self.coupling.closing_by_rotation()

    def static_system(self, preload: float) -> StaticSystem:
        """Return the static contact problem under the loads."""
        force, shift = self.damper_load
        constant_force, constant_shift = self.fixed_load
        # displacement by rotation and preload rise together from 0; shift is per newton of preload
        if preload > 0.0:
            shift = shift + self.displacement_by_rotation / preload
        else:
            constant_shift = constant_shift + self.displacement_by_rotation
        return replace(
            self._unloaded,
            force=force,
            shift=shift,
            constant_force=constant_force,
            constant_shift=constant_shift,
        )

    @made_once
    def _surfaces(self) -> dict[str, Any]:
        """Geometry and friction of the contact points, for static states."""
        faces = [self.coupling.model.interfaces[name] for name in self.coupling.interfaces]
        return {
            "points": np.concatenate([np.zeros((0, 3)), *(face.points for face in faces)]),
            "frame": np.concatenate([np.zeros((0, 3, 3)), *(face.frame for face in faces)]),
            "area": np.concatenate([np.zeros(0), *(face.area for face in faces)]),
            "friction": self.friction,
            "on_friction_face": self.friction_points,
            "interface": self.coupling.interface_of,
            "interference": self.interference,
        }

    @one_thread
    def static(self, preload: float, history: Sequence[float] | None = None) -> PreloadState:
        """Compute the quasi-static contact state at a preload (paper, section 3.1).

        Parameters
        ----------
        preload : float, N
        history : sequence of float, optional
            Load factors, increasing or decreasing, that are applied in sequence, starting from zero
            load.  Default: ``load_history`` of the study.

        Returns
        -------
        PreloadState
            State at the last load factor.
        """
        preload = self.check_preload(preload)
        if history is None:
            factors = self.settings.load_history
        else:
            factors = check_history("history", history)
        key = preload, *factors
        if key in self.static_states:
            return self.static_states[key]
        watch = CostMeter()
        system = self.static_system(preload)
        state = None
        slips_at_assembly = self.settings.residual_slip_std or self.settings.constant_loads
        one_load = len(factors) == 1
        if one_load and preload > 0.0 and not slips_at_assembly:
            state = self._scaled_static(system, preload, factors[0])
        # states are not proportional to the load
        if state is None:
            state = self._loaded_static(system, preload, factors)
            watch.count(state.iterations)
        if not state.ok:
            state = replace(state, reason=f"{state.reason}{self._other_loads}")
        self.static_states[key] = replace(state, cost=watch.read(), **self._surfaces)
        return self.static_states[key]

    @property
    def _other_loads(self) -> str:
        """Interference of a study without static state, with a remedy, or ""."""
        texts = []
        for name in dict.fromkeys(self.coupling.interface_of):
            of_face = self.interference[self.coupling.rows(name)]
            largest = float(np.nan_to_num(of_face).max(initial=0.0))
            if largest > 0.0:
                texts.append(f"{amount(largest, 'm')} of interference on '{name}'")
        if not texts:
            return ""
        return (
            f" with {listed(texts)}; a slightly different interference, load or friction "
            "coefficient may have one"
        )

    def _scaled_static(
        self, system: StaticSystem, preload: float, factor: float
    ) -> PreloadState | None:
        """Scale the static state of one fixed load, or return None if states do not scale.

        The fixed load keeps results independent of the order of calls.
        """
        # one state under 1 N serves all preloads, unless the displacement by rotation makes the
        # system depend on the preload
        system_of = float(preload * np.any(self.displacement_by_rotation))
        # `static` has at least two numbers in its keys: preload and load factors
        key = (system_of,)
        if key not in self.static_states:
            under_one_newton = static_state(system, load=1.0)
            self.static_states[key] = replace(under_one_newton, **self._surfaces)
        return scaled_state(system, self.static_states[key], load=factor * preload)

    def _loaded_static(
        self, system: StaticSystem, preload: float, factors: Sequence[float]
    ) -> PreloadState:
        """Compute the static state after all load factors, or up to the first without a state."""
        settings = self.settings
        offset = assembly_offsets(
            settings.residual_slip_std, settings.residual_slip_seed, self.friction
        )
        state = None
        for factor in factors:
            state = static_state(system, factor * preload, start=state, offset=offset)
            if not state.ok:
                break
        assert state is not None
        return state

    def wedge_friction(self, preload: float = 1.0) -> WedgeFriction:
        """Return the range of normal forces that statics and friction allow.

        It identifies a self-locking wedge.
        """
        return wedge_friction(
            self.coupling, self.friction, self.check_preload(preload), self.body_loads
        )

    def check_preload(self, preload: float) -> float:
        """Check and return a preload (N).

        Raises SettingError if it is negative or acts on no body.
        """
        preload = validation.number("preload", preload, least=0.0, unit="N")
        if preload > 0.0 and not self.carries_load:
            raise SettingError(
                f"preload: expected 0, since {self.why_no_load}, found {preload:g} N"
            )
        return preload

    @made_once
    def carries_load(self) -> bool:
        """Whether the preload acts along a motion of the study."""
        return carried(self.coupling, self.settings, self.body_loads)

    @property
    def why_no_load(self) -> str:
        """Reason why no load acts on a damper."""
        loaded = [
            name
            for name, body in self.model.bodies.items()
            if body.load is not None and np.any(body.load.generalised)
        ]
        if not loaded:
            return "no body of the model carries a load"
        return (
            f"the study omits the motions of {loaded} along the load "
            f"(rigid_modes={self.settings.rigid_modes})"
        )

    # ---- harmonic balance ----

    @property
    def layout(self) -> Layout:
        """Indices of the harmonics in the harmonic-balance unknowns."""
        return Layout(np.array([basis.n_modes for basis in self.bases]))

    @property
    def n_unknowns(self) -> int:
        """Number of harmonic-balance unknowns."""
        return self.layout.n_unknowns

    @made_once
    def excitation_force(self) -> tuple[NDArray, float]:
        """Modal forces (n_unknowns,) of the harmonics, without mean, and the largest of them.

        Raises SettingError if nothing is excited or the force is not finite.
        """
        forces = {harmonic: self.modal_force(harmonic) for harmonic in self.settings.excited}
        vibration = max(float(np.abs(modal).max()) for modal in forces.values())
        least, most = FORCES
        if not least <= np.abs(forces[1]).max() <= vibration <= most:
            excitation = self.settings.excitation
            unit = self.settings.unit_of(excitation)
            raise SettingError(
                "excitation: expected a force that works on the modes of harmonic 1, with modal "
                f"forces from {least:g} to {most:g}, found {excitation.amplitude:g} {unit} at "
                f"'{excitation.location}', {excitation.direction}"
            )
        layout = self.layout
        force = np.zeros(layout.n_unknowns)
        for harmonic, modal in forces.items():
            cosine, sine = layout.slices(harmonic)
            force[cosine] = modal.real
            force[sine] = -modal.imag
        return force, vibration

    @made_once
    def linear(self) -> Linear:
        """Structure with linear springs in place of the contact.  It needs no static state."""
        force, _ = self.excitation_force
        springs = self.point_stiffness * self.coupling.spring_points[:, None]
        return Linear(tuple(self.bases), springs, self.layout, force)

    @made_once
    def _load_cases(self) -> dict[float, LoadCase]:
        return {}

    def __getstate__(self) -> dict[str, Any]:
        """Return all attributes except the load cases, which other processes compute again."""
        return {name: value for name, value in self.__dict__.items() if name != "_load_cases"}

    def at(self, preload: float) -> LoadCase:
        """Return the problem under one preload (N); the latest 16 are stored."""
        preload = self.check_preload(preload)
        if preload not in self._load_cases:
            # all but the latest 15; another thread may have removed one
            for former in list(self._load_cases)[:-15]:
                self._load_cases.pop(former, None)
            self._load_cases[preload] = LoadCase(self, preload)
        return self._load_cases[preload]

    def system(self, preload: float) -> Equations[SectorData]:
        """Return the harmonic balance equations at one preload (N): ``at(preload).equations``."""
        return self.at(preload).equations


@dataclass(frozen=True, eq=False)
class LoadCase:
    """Problem under one preload: static state, springs in stick, and equations, each computed once.

    Parameters
    ----------
    problem : Problem
    preload : float, N
    from_rest : bool
        Whether the vibration starts from the static state in any case.
    """

    problem: Problem
    preload: float
    from_rest: bool = False

    @made_once
    def static(self) -> PreloadState:
        """State from which the vibration starts.  It has residual forces, or is the static state and
        then may not have converged.
        """
        if self.residual is not None:
            return self.residual.state
        return self.problem.static(self.preload)

    @made_once
    def residual(self) -> Residual | None:
        """Residual forces from which the vibration starts, None if it starts from rest.

        They depend on the study and the preload alone, not on analyses before.
        """
        return None if self.from_rest else residual_forces.of_case(self.rest)

    @made_once
    def rest(self) -> LoadCase:
        """Return the same load case, but let the vibration start from rest."""
        return LoadCase(self.problem, self.preload, from_rest=True)

    @property
    def equilibrium(self) -> PreloadState:
        """State from which the vibration starts; StaticError if there is none."""
        if not self.static.ok:
            raise StaticError(
                f"there is no static state under {self.preload:g} N: {self.static.reason}"
            )
        return self.static

    def stuck_springs(self, *, touching: bool = False) -> NDArray:
        """Return the springs (n_points, 3) of stuck points, N/m: the stick stiffness where the preload
        closes the contact, and zero elsewhere.

        With ``touching``, points in contact at assembly also count as closed, with a warning, if
        their interface has no free body and no point closed by the preload.
        """
        problem = self.problem
        is_open = (self.equilibrium.status == OPEN).any(axis=1)
        # springs of the bodies are no contacts
        closed = ~is_open & ~problem.coupling.spring_points
        if touching:
            for name in problem.coupling.friction_faces:
                rows = problem.coupling.rows(name)
                if not closed[rows].any():
                    closed[rows] = self._touching(name)
        return problem.stick_stiffness * closed[:, None]

    def _touching(self, name: str) -> NDArray:
        """Return which points (n,) of an interface without normal load touch, with one warning.

        No point does if the interface has a free body.
        """
        problem = self.problem
        face = problem.model.interfaces[name]
        rows = problem.coupling.rows(name)
        touch = problem.point_gaps[rows] <= 0.0
        bodies = [problem.model.bodies[body] for body in (face.body_a, face.body_b)]
        if any(body.is_free for body in bodies):
            return np.zeros_like(touch)
        # a lumped mass has a load without being a free body: at rest the load may hold points
        # apart that touch at assembly
        has_load = any(body.load is not None for body in bodies)
        if has_load:
            touch &= self.equilibrium.closing[rows] >= 0.0
        told = problem.sizes.told
        subject = f"load on '{name}'"
        if touch.any() and subject not in told:
            told.add(subject)
            warn(
                f"interface '{name}' touches without a normal load: its touching points count as "
                "stuck, although they carry no load at rest; load_per_preload=, constant_loads= "
                "or a negative gap applies one"
            )
        return touch

    @property
    def equations(self) -> Equations[SectorData]:
        """Harmonic balance equations, one object for each thread."""
        return self.sector.equations

    @made_once
    def sector(self) -> SectorData:
        """Data of the equations.

        Raises StaticError if there is no static state, and SettingError if nothing is excited or
        the force is not finite.
        """
        problem = self.problem
        settings = problem.settings
        _, vibration = problem.excitation_force
        state = self.equilibrium
        force = self._modal_forces()
        points = self._points(state)
        bases = problem.bases
        if not settings.separation or not settings.variable_normal_load:
            bases, points = without_separation(
                bases,
                points,
                state,
                problem.friction_points,
                constant_load=not settings.variable_normal_load,
            )

        # reference force of the mean: the largest modal force of load, contacts and excitation
        load, _ = problem.damper_load
        by_load = float(np.abs(state.load * load).max())
        by_contacts = np.einsum("pdm,pd->m", problem.static_basis.G.real, state.force)
        static = max(by_load, float(np.abs(by_contacts).max()), vibration)
        _, most = FORCES
        validation.check(
            static <= most,
            "load_per_preload",
            f"static forces on the modes up to {most:g}",
            f"{static:.3g}",
        )
        if self.residual is not None:
            rounding_static, rounding_vibration = self.residual.rounding
            static = max(static, rounding_static / ROUNDING)
            vibration = max(vibration, rounding_vibration / ROUNDING)
        return SectorData(
            bases=bases,
            points=points,
            force=force,
            response_rows=problem.response_rows,
            contact_forces=settings.contact_forces,
            force_scale=(static, vibration),
            springs=problem.point_stiffness * problem.coupling.spring_points[:, None],
            spring_bases=problem.bases,
        )

    def _modal_forces(self) -> NDArray:
        """Return the forces (n_unknowns,) of mean and harmonics."""
        problem = self.problem
        excitation, _ = problem.excitation_force
        load, _ = problem.damper_load
        constant_force, _ = problem.fixed_load
        force = excitation.copy()
        mean, _ = problem.layout.slices(0)
        force[mean] = (self.equilibrium.load * load + constant_force)[mean]
        return force

    def _points(self, state: PreloadState) -> PointArrays:
        """Return the contact points, with the sliders of a static state."""
        problem = self.problem
        kn = problem.point_stiffness[:, 2]
        tangential = problem.point_laws != LAW_NORMAL
        shift = problem.static_system(self.preload).shift_at(state.load)
        if not problem.settings.bias:
            # the mean stays where the static state is
            shift = shift + problem.static_basis.G.real @ state.q
        return PointArrays(
            kt=problem.point_stiffness[:, :2] * tangential[:, None],
            kn=kn,
            mu=problem.friction,
            n0=-kn * problem.point_gaps,
            slider=np.where(problem.bonded_points[:, None], 0.0, state.slider),
            law=problem.point_laws.copy(),
            shift=shift,
            own=problem.own_laws,
            memory=state.memory,
        )
