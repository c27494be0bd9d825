"""Settings of a study of one model, checked on creation.

Each setting is a choice of the method (paper, sections 2 and 3): modes and nodal diameters of the
bodies, contact stiffness, friction law, preload history, harmonics of the response.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from functools import partial
from typing import Annotated, Any, Literal, get_type_hints

import numpy as np
from numpy.typing import NDArray

from bdamper.contact.laws import (
    AFT,
    LAW_BONDED,
    LAW_COUPLED,
    LAW_SEPARABLE,
    LAW_USER,
    ContactLaw,
    check_evaluation,
)
from bdamper.contact.residual_flexibility import ResidualModes
from bdamper.contact.stiffness import PerArea
from bdamper.harmonic_balance.effects import (
    BLADE_MODES,
    HARMONICS,
    LAW_NAMES,
    ByBody,
    Harmonics,
    Law,
    harmonic_numbers,
)
from bdamper.model.gauges import ALONG_GAUGE, GAUGE, gauge_point, gauge_weights
from bdamper.model.kinematics import RIGID_NAMES
from bdamper.model.loads import FIELD, Excitation, Response, direction_vector
from bdamper.model.structure import Interface, Model
from bdamper.model.validation import check_model_once
from bdamper.util import validation
from bdamper.util.errors import PlausibilityWarning, SettingError, warn
from bdamper.util.formatting import short_repr
from bdamper.util.records import from_json

LAWS = dict(zip(LAW_NAMES, (LAW_SEPARABLE, LAW_COUPLED, LAW_BONDED)))
FRICTION = 0.3
"""Default friction coefficient."""
CIGEROGLU_2009: Mapping[str, Any] = {
    "contact_stiffness": "cigeroglu2009",
    "blade_modes": 10,
    "damper_modes": 0,
    "harmonics": 1,
    "fundamental_modes_only": True,
}
"""Settings of the paper (sections 2.2, 3.2 and 4.1): ``Study(model, ..., **CIGEROGLU_2009)``,
``study.replace(**CIGEROGLU_2009)``.
"""


@partial(validation.check_arguments, name="Study")
@short_repr
@dataclass(frozen=True, eq=False)
class Settings(validation.Answering):
    """Settings of a study of one model.

    Parameters
    ----------
    model : Model
    excitation : Excitation
    engine_order : int
        Engine order of the fundamental harmonic.  Required for a bladed disk; 1 for a structure
        without cyclic symmetry.
    friction_coefficient : float or mapping of interface name to float or (n_points,) float
        An array has a value for each contact point of the interface in the model; united patches
        use the mean of their values.  Interfaces with a :class:`~bdamper.ContactLaw` need no
        coefficient.
    response : Response, optional
        Location and direction of the response; by default location and direction of the excitation.
    harmonics : int or tuple of int
        Number of harmonics of the response, not counting the mean, or a tuple of their orders.
    contact_stiffness : str, ResidualModes, float, PerArea or mapping, optional
        Method ("residual_modes", "unit_traction" or "cigeroglu2009", see
        :mod:`bdamper.contact.stiffness`), values in N/m or N/m3, or "model" for the values in the
        model.  Default: residual modes if the model contains their static
        flexibility, otherwise the values of the model or unit tractions, with a note in
        ``stiffness_report`` and a :class:`~bdamper.util.errors.BdamperWarning`.
    contact_stiffness_factor : float
        Factor by which the contact stiffness of any method is multiplied. With residual modes, the
        complete flexibility of the contact is divided by it.
    blade_modes : int
        Number of modes of each constrained body, limited by the model; the default is accepted for
        a smaller model.
    damper_modes : int or mapping of body name to int
        Number of elastic modes of each free body; 0 for bodies that a mapping does not list.
    rigid_modes : sequence of str
        Rigid-body modes of free bodies: "TX", "TY", "TZ" (translation) and "RX", "RY", "RZ"
        (rotation), along and about the damper's axes.
    constraint_planes : bool
        Include constraint planes (front and back of a damper).
    fundamental_modes_only : bool
        Describe every harmonic by the modes of the fundamental's nodal diameter, as Cigeroglu, An
        and Menq (2009) do.
    damping_ratio : float, optional
        Damping ratio of all elastic modes, instead of the values of the model.
    damper_damping_ratio : float or mapping of body name to float
        Damping ratio of each rigid-body and elastic motion of a free body.  Each motion is
        considered alone: supported by the stuck springs of the friction faces, with blades at rest.
        Motions without stiffness are not damped.  Damping in the model is added.  Modes of the
        stuck damper, which combine these motions, have 0.7 to 1.7 times this value on the shipped
        models.
    aerodynamic_damping : complex or mapping of nodal diameter to complex, optional
        Aerodynamic damping ratio of every mode of the constrained bodies, added to their damping.
        The imaginary part of a complex number is the damping ratio, its real part a relative
        frequency shift, as in :meth:`bdamper.Study.flutter`. A number applies to the nodal diameter
        of the engine order.  Waves ``d`` and ``n_blades - d`` (or ``-d``) travel in opposite
        directions.  Other nodal diameters and the mean have no aerodynamic damping.
        :func:`bdamper.influence_coefficients` computes them from a few blades.
    damper_drag : float or mapping of body name to float, N s/m
        Viscous damping constant of free bodies: drag divided by velocity in translation.  Rotation
        and deformation are damped as well, because the drag is distributed like the mass.
    contact_forces : {"event_driven"} or AFT
        Evaluation of the contact forces over a cycle.
    friction_law : {"uncoupled", "coupled", "bonded"}, ContactLaw or mapping of interface to these
        "uncoupled": independent 1-D elements along two axes.  "coupled": the friction force lies in
        a disk of radius mu N (the static analysis uses the uncoupled law, see
        :mod:`bdamper.contact.static_state`).  "bonded": linear springs in all directions, also in
        tension.  A :class:`~bdamper.ContactLaw` is a compiled function; its stiffness replaces the
        contact stiffness.  The forces of such a law and of "coupled" are evaluated from samples,
        128 per period unless ``contact_forces`` is given.
    bias, variable_normal_load, separation : bool
        Whether the mean position may change, whether the friction limit follows the normal load,
        and whether surfaces may open and close.  :class:`~bdamper.harmonic_balance.effects.Effects`
        describes the assumption made if one of them is False.
    contact_points : int, optional
        Maximum number of contact points on each friction face; neighbouring patches are united.
        Use at least 9.
    gap : mapping of interface name to float or (n_points,) float, optional
        Initial gap of the surfaces in m, instead of the values of the model; negative for
        interference.  See :func:`bdamper.face_gap`.  Not possible for the law "bonded".
    load_per_preload : mapping of name to float, optional
        Load on free bodies, and normal load on friction interfaces between constrained bodies
        (shrouds, roots), in newtons per newton of preload; 0 for names that are not listed.
        Default: 1 on every loaded body.  At a rotor speed the loads are proportional to mass times
        radius, and the preload is the load of the first body.
    constant_loads : mapping of name to float or (n_points,) float, optional
        Loads (N) on the same bodies and interfaces that do not depend on the preload.  For an
        interface, one value for each contact point, or their sum, distributed by area.  These
        normal loads act at assembly: after the deformation of the structure and before the free
        bodies are loaded.  A negative load of a point is a gap of ``-load/kn`` in this state.  Gaps
        of interfaces with a load are ignored.
    load_history : tuple of float
        Load factors through which a preload is reached, the last one 1: (1.5, 1.0) is a preceding
        overload.
    stability : bool
        Whether response curves include the stability of every point.
    speed : float, rad/s, optional
        Rotor speed of the model, set by :meth:`bdamper.Study.at_speed`.  The static analysis then
        includes the displacement of the faces due to rotation at this speed, which does not depend
        on the preload.
    residual_slip_std : float, m
        Standard deviation of the random slider positions after assembly, from which the static
        analysis starts.
    residual_slip_seed : int
        Seed of the random numbers.
    residual_forces : {"rest", "most"}, optional
        Mean friction forces of joints between constrained bodies at the start of the vibration.
        "rest": those of the static state.  "most": those that delay slip most, up to ten times
        :meth:`first slip <bdamper.Study.first_slip>`.  Default: "most" for shrouds, and for other
        joints below first slip whose forces at rest are lost in rounding; "rest" otherwise.

    Raises
    ------
    SettingError, ModelError
        If a setting is not valid; the message gives the setting, the expected and the given value.
    """

    model: Model = field(repr=False)
    excitation: Annotated[Excitation, partial(validation.instance, kind=Excitation)]
    engine_order: validation.Natural = None  # type: ignore[assignment]  # 1 without cyclic symmetry
    friction_coefficient: float | Mapping[str, float | NDArray] = FRICTION
    response: Annotated[Response, partial(validation.instance, kind=Response)] | None = None
    harmonics: Harmonics = HARMONICS
    contact_stiffness: str | float | ResidualModes | PerArea | Mapping[str, NDArray] | None = None
    blade_modes: validation.Count = BLADE_MODES
    damper_modes: ByBody = 0
    rigid_modes: Annotated[tuple[str, ...], partial(validation.names, choices=RIGID_NAMES)] = (
        RIGID_NAMES
    )
    constraint_planes: bool = True
    fundamental_modes_only: bool = False
    damping_ratio: validation.Share | None = None
    damper_damping_ratio: Annotated[
        float | Mapping[str, float], validation.each(validation.Limits(least=0.0, below=1.0))
    ] = 0.0
    damper_drag: Annotated[
        float | Mapping[str, float], validation.each(validation.Limits(least=0.0, unit="N s/m"))
    ] = 0.0
    contact_forces: str | AFT = "event_driven"
    friction_law: Law = "uncoupled"
    bias: bool = True
    variable_normal_load: bool = True
    separation: bool = True
    contact_points: validation.Count | None = None
    gap: Mapping[str, float | NDArray] | None = None
    load_per_preload: Mapping[str, float] | None = None
    constant_loads: Mapping[str, float | NDArray] | None = None
    load_history: Annotated[tuple[float, ...], check_history] = (1.0,)
    stability: bool = False
    contact_stiffness_factor: validation.Positive = 1.0
    speed: validation.Speed | None = None
    residual_slip_std: validation.Length = 0.0
    residual_slip_seed: validation.Natural = 0
    aerodynamic_damping: complex | Mapping[int, complex] | None = None
    residual_forces: Literal["rest", "most"] | None = None

    def __post_init__(self) -> None:
        check_model_once(self.model)
        if self.engine_order is None:
            n = self.model.n_blades
            missing = f"give the engine order of the excitation, because the model has {n} sectors"
            validation.check_sentence(n <= 1, "engine_order", missing)
            object.__setattr__(self, "engine_order", 1)
        validation.check_fields(self)
        self._check_places()
        # the default is accepted for a smaller model
        most_modes = max(BLADE_MODES, self.most_modes("constrained"))
        validation.integer("blade_modes", self.blade_modes, 1, most_modes)
        self._check_friction()
        self._check_points()
        validation.check(
            self.model.interfaces or self.contact_stiffness is None,
            "contact_stiffness",
            "None, since the model has no contacts",
            self.contact_stiffness,
        )
        check_evaluation(self.contact_forces, self.harmonic_numbers[-1])
        validation.check(
            self.load_history[-1] == 1.0, "load_history", "1.0 at its end", self.load_history
        )
        self._check_free_bodies()
        self._check_speed()
        self._check_held()
        self._check_loads()
        self._check_orders()
        if self.aerodynamic_damping is not None:
            object.__setattr__(self, "aerodynamic_damping", self._flow(self.aerodynamic_damping))

    def _check_points(self) -> None:
        """Check the largest number of contact points of a face."""
        # a model without friction faces has none; 1 is accepted then
        most = max(self.most_points, 1)
        validation.check_value(
            self.contact_points is None or self.contact_points <= most,
            "contact_points",
            f"at most {most}, the number of points on a friction face of the model, or None for all "
            "of them",
            self.contact_points,
        )

    def _check_free_bodies(self) -> None:
        """Check the bodies of settings for free bodies; zero is accepted without such a body."""
        for name in ("damper_modes", "damper_damping_ratio", "damper_drag"):
            value = getattr(self, name)
            if isinstance(value, Mapping):
                validation.mapping(name, value, self.free_bodies, "free bodies")
            elif name != "damper_modes":
                expected = "0, since the model has no free body"
                validation.check_value(self.free_bodies or not value, name, expected, value)
        # a damping ratio belongs to motions on the contact springs; a ring has other motions at each
        # nodal diameter
        for name, ratio in self.by_body("damper_damping_ratio").items():
            is_ring = self.model.bodies[name].kind == "ring"
            expected = "0 for a ring; use damper_drag"
            validation.check_value(
                not (is_ring and ratio), f"damper_damping_ratio of '{name}'", expected, ratio
            )

    def _check_speed(self) -> None:
        """Check that the model belongs to the rotor speed; its provenance gives its own."""
        if self.speed is None:
            return
        speed_of_model = self.model.provenance.get("rotor speed", "none")
        validation.check(
            speed_of_model == f"{self.speed:.9g} rad/s",
            "speed",
            f"a model at {self.speed:.9g} rad/s, as study.at_speed makes it",
            f"one at {speed_of_model}",
        )

    def _flow(self, damping: complex | Mapping[int, complex]) -> dict[int, complex]:
        """Return the complex aerodynamic coefficient of each wave, 0 to n_blades - 1."""
        # a number applies to the nodal diameter of the engine order
        by_diameter = damping if isinstance(damping, Mapping) else {self.engine_order: damping}
        validation.check_sentence(
            self.most_modes("constrained"),
            "aerodynamic_damping",
            "it needs a constrained body; this model has none",
        )
        n = self.model.n_blades
        by_wave = {}
        for diameter, value in by_diameter.items():
            item = f"aerodynamic_damping at nodal diameter {diameter}"
            # a backward wave -d is the wave n - d
            name = f"aerodynamic_damping, nodal diameter {diameter}"
            wave = validation.integer(name, diameter, least=-n) % n
            finite = isinstance(value, (int, float, complex)) and np.isfinite(value)
            validation.check_value(finite, item, "a finite number", value)
            twice = f"wave {diameter} twice"
            validation.check(wave not in by_wave, item, "each wave only once", twice)
            # a real number is a damping ratio
            by_wave[wave] = value if isinstance(value, complex) else 1j * value
        return by_wave

    def _check_places(self) -> None:
        """Check location and direction of each force and of the response."""
        locations = self.model.locations
        # points of the structure; other kinds are force fields, and the base
        places = sorted(name for name, place in locations.items() if place.kind is None)
        modes = [f"mode {number + 1}" for number in range(self.most_modes("constrained"))]
        for force in self._forces:
            choices = sorted(locations)
            if force.location.startswith("mode ") and force.location not in locations:
                choices += modes
            validation.choice("excitation location", force.location, tuple(choices))
            has_direction = force.location in places or self.at_base(force)
            validation.check_value(
                has_direction or force.direction == "tangential",
                "excitation direction",
                f"none, which '{force.location}' does not have",
                force.direction,
            )
        if self.response is None:
            missing = (
                "give a Response(location, direction), because the excitation is not a force at "
                "a location"
            )
            validation.check_sentence(self.acts_at_location, "response", missing)
        elif self.response.absolute:
            moves = any(map(self.at_base, self._forces))
            expected = "an excitation at the base, bd.Excitation('base', ...), for absolute=True"
            validation.check(moves, "response", expected, f"one {self.excitation.shown}")
        if self.response_location.elastic is not None:
            # a strain gauge is at a node with stresses; both calls raise if it is not valid
            gauge_point(self.model.stress, self.response_location.location)
            gauge_weights(self.response_location.direction, self.response_location.elastic)
        else:
            validation.choice("response location", self.response_location.location, places)

    def _check_orders(self) -> None:
        """Check that each force acts on a harmonic of the response, one of them on the first."""
        orders = [self.engine_order * harmonic for harmonic in self.harmonic_numbers]
        for force in self._forces:
            validation.check_value(
                self._order_of(force) in orders,
                "engine_order of an excitation",
                f"one of {orders} (harmonics)",
                self._order_of(force),
            )
        harmonics = sorted(self.excited)
        validation.check(
            harmonics[0] == 1,
            "excitation",
            "a force of the study's own engine_order",
            f"only harmonics {harmonics}",
        )

    def at_base(self, excitation: Excitation) -> bool:
        """Whether an excitation is an acceleration (m/s2) of the fixed nodes."""
        place = self.model.locations.get(excitation.location)
        return place is not None and place.kind == "base"

    def unit_of(self, excitation: Excitation) -> str:
        """Return the unit of the amplitude of an excitation."""
        return "m/s2" if self.at_base(excitation) else "N"

    @property
    def _forces(self) -> tuple[Excitation, ...]:
        """Excitation of the study and further forces."""
        return (self.excitation, *self.excitation.beside)

    def _order_of(self, force: Excitation) -> int:
        """Return the engine order of a force."""
        return self.engine_order if force.engine_order is None else force.engine_order

    def _harmonic_of(self, force: Excitation) -> int:
        """Return the harmonic of the response on which a force acts."""
        if self.engine_order == 0:
            # all harmonics have order 0, and the forces act on the first one
            return 1
        return self._order_of(force) // self.engine_order

    @property
    def acts_at_location(self) -> bool:
        """Whether the first excitation is a force (N) at a location, not a force field or a modal
        force.
        """
        place = self.model.locations.get(self.excitation.location)
        return place is not None and place.kind is None

    @property
    def excited(self) -> dict[int, list[tuple[str, NDArray, complex]]]:
        """Forces on each harmonic: location, direction (3,), and complex amplitude (N)."""
        excited: dict[int, list[tuple[str, NDArray, complex]]] = {}
        for force in self._forces:
            place = self.model.locations.get(force.location)
            # a force field and a modal force are distributed over the body
            is_distributed = place is None or place.kind == "forces"
            if is_distributed:
                direction = FIELD
            else:
                direction = direction_vector(force.direction, "excitation direction")
            of_harmonic = excited.setdefault(self._harmonic_of(force), [])
            of_harmonic.append((force.location, direction, force.force))
        return excited

    @property
    def places(self) -> tuple[tuple[str, NDArray], ...]:
        """Locations and directions (3,) of the response and of all forces except modal forces."""
        places = []
        for forces in self.excited.values():
            for location, direction, _ in forces:
                if location in self.model.locations:
                    places.append((location, direction))
        response = self.response_location
        if response.elastic is not None:
            # a strain gauge: its location in the model and its direction are made with the model
            return (*places, (GAUGE, ALONG_GAUGE))
        direction = direction_vector(response.direction, "response direction")
        return (*places, (str(response.location), direction))

    @property
    def free_bodies(self) -> tuple[str, ...]:
        """Names of the free bodies, including rings."""
        return tuple(body.name for body in self.model.bodies.values() if body.is_free)

    def by_body(self, name: str) -> dict[str, Any]:
        """Return the value of a setting for each free body.

        The settings are "damper_modes", "damper_damping_ratio" and "damper_drag".
        """
        value = getattr(self, name)
        if isinstance(value, Mapping):
            return {body: value.get(body, 0) for body in self.free_bodies}
        return dict.fromkeys(self.free_bodies, value)

    @property
    def friction_faces(self) -> tuple[Interface, ...]:
        """Interfaces with friction."""
        return tuple(face for face in self.model.interfaces.values() if face.kind == "friction")

    @property
    def constrained_faces(self) -> tuple[str, ...]:
        """Friction interfaces between constrained bodies: shrouds, roots, a platform pressed on the
        ground.
        """
        free = self.free_bodies
        return tuple(
            face.name
            for face in self.friction_faces
            if face.body_a not in free and face.body_b not in free
        )

    @property
    def shrouds(self) -> tuple[str, ...]:
        """Friction interfaces between neighbouring blades."""
        of_model = self.model.interfaces
        return tuple(
            name
            for name in self.constrained_faces
            if of_model[name].sector_a != of_model[name].sector_b
        )

    @property
    def loaded(self) -> tuple[str, ...]:
        """Names of bodies with a load and of friction interfaces between constrained bodies."""
        bodies = [name for name, body in self.model.bodies.items() if body.load is not None]
        return (*bodies, *self.constrained_faces)

    def given_loads(self, item: str) -> dict[str, Any]:
        """Return ``load_per_preload`` or ``constant_loads`` as a mapping of names to loads.

        The default of ``load_per_preload`` is 1 on every loaded body.
        """
        loads = getattr(self, item)
        if loads is not None:
            return dict(loads)
        if item == "load_per_preload":
            return {name: 1.0 for name in self.loaded if name in self.model.bodies}
        return {}

    def _check_loads(self) -> None:
        """Check names and values of the loads, and those that a rotor speed excludes."""
        bodies = [name for name in self.loaded if name in self.model.bodies]
        for item in ("load_per_preload", "constant_loads"):
            loads = getattr(self, item)
            if loads is None:
                continue
            words = "names of loaded bodies, or of friction interfaces between constrained bodies,"
            for name in validation.mapping(item, loads, self.loaded, words):
                may_be_array = item == "constant_loads" and name not in bodies
                # constant loads of the points of an interface are checked with its points
                if may_be_array and np.ndim(loads[name]) > 0:
                    continue
                validation.number(f"{item} of '{name}'", loads[name], least=0.0)
        if self.load_per_preload is not None:
            validation.check(
                any(self.load_per_preload.values()),
                "load_per_preload",
                "at least one above 0",
                dict(self.load_per_preload),
            )
        if self.speed is None:
            return
        validation.check_sentence(
            self.load_per_preload is None,
            "load_per_preload",
            "it is not allowed at a rotor speed, where mass times radius determines the loads; vary "
            "damper_mass_factor instead",
        )
        on_bodies = [name for name in self.constant_loads or () if name in bodies]
        expected = "only loads of interfaces at a rotor speed"
        validation.check(not on_bodies, "constant_loads", expected, on_bodies)

    @property
    def holds_preload(self) -> bool:
        """Whether contacts of lumped masses have a preload independent of the contact stiffness."""
        for body in self.model.bodies.values():
            if body.kind != "lumped":
                continue
            for name, _ in body.ports:
                # interference presses the faces together without any load
                if (self.model.interfaces[name].gap < 0.0).any():
                    return True
        return False

    def _check_held(self) -> None:
        """Check that settings do not contradict the forces and matrices of a lumped model."""
        has_matrix = False
        for body in self.model.bodies.values():
            has_matrix |= any(basis.drag is not None for basis in body.bases.values())
        validation.check_value(
            not has_matrix or self.damping_ratio is None,
            "damping_ratio",
            "none, because the damping matrix of the model couples its modes",
            self.damping_ratio,
        )
        # a mapping contains the values of the points; a factor would change them
        has_values = isinstance(self.contact_stiffness, Mapping)
        are_of_model = has_values and self.contact_stiffness_factor == 1.0
        if self.holds_preload and not are_of_model:
            raise SettingError(
                "contact_stiffness: the preload in this model belongs to the contact stiffness in the "
                "model; create the model with other contacts instead"
            )

    @property
    def most_points(self) -> int:
        """Largest number of contact points of a friction face; 0 without such a face."""
        return max((face.n_points for face in self.friction_faces), default=0)

    def most_modes(self, kind: str) -> int:
        """Return the number of modes that every body of a kind has at every nodal diameter.

        Rigid-body modes of free bodies do not count.
        """
        bodies = [body for body in self.model.bodies.values() if body.kind == kind]
        # of each body at each nodal diameter
        n_modes = []
        for body in bodies:
            n_modes += [basis.n_natural for basis in body.bases.values()]
        least = min(n_modes, default=0)
        if bodies and kind == "free":
            return least - len(RIGID_NAMES)
        return least

    def _check_friction(self) -> None:
        """Check friction laws and coefficients; choose a sampled evaluation for laws that need it."""
        law = self.friction_law
        faces = [face.name for face in self.friction_faces]
        if isinstance(law, Mapping) and set(law) != set(faces):
            expected = f"one of {LAW_NAMES} for each interface {faces}"
            raise validation.invalid("friction_law", expected, dict(law))
        if self.own_laws():
            required = {"separation": True, "variable_normal_load": True, "stability": False}
            for name, value in required.items():
                setting = getattr(self, name)
                expected = f"{value!r} with a ContactLaw"
                validation.check_value(setting == value, name, expected, setting)

        # the forces of these laws over a cycle have no closed form
        sampled_laws = {LAW_COUPLED, LAW_USER} & set(self.law_by_interface().values())
        is_default = isinstance(self.contact_forces, str) and self.contact_forces == "event_driven"
        if sampled_laws and is_default:
            n_samples = max(128, 8 * self.harmonic_numbers[-1] + 8)
            object.__setattr__(self, "contact_forces", AFT(n_samples))
        # raises if a value is missing or not valid
        _ = self.friction_by_interface()

    def _laws(self) -> dict[str, str | ContactLaw]:
        """Return the law of each friction interface."""
        law = self.friction_law
        faces = [face.name for face in self.friction_faces]
        if isinstance(law, Mapping):
            return {name: law[name] for name in faces}
        return dict.fromkeys(faces, law)

    def own_laws(self) -> dict[str, ContactLaw]:
        """Return the user-defined laws of friction interfaces."""
        return {name: law for name, law in self._laws().items() if isinstance(law, ContactLaw)}

    def law_by_interface(self) -> dict[str, int]:
        """Return the law of each friction interface, regardless of its friction coefficient."""
        numbers = {}
        for name, law in self._laws().items():
            numbers[name] = LAW_USER if isinstance(law, ContactLaw) else LAWS[law]
        return numbers

    @property
    def response_location(self) -> Response:
        """Location and direction of the response; by default location and direction of the
        excitation.
        """
        return self.response or Response(self.excitation.location, self.excitation.direction)

    def interface_names(self) -> tuple[str, ...]:
        """Return the interfaces in use; constraint planes only if ``constraint_planes`` is set."""
        return tuple(
            name
            for name, face in self.model.interfaces.items()
            if self.constraint_planes or face.kind != "constraint"
        )

    def friction_by_interface(self) -> dict[str, float | NDArray]:
        """Return a mapping of the interfaces in use to their friction coefficients.

        A value is one number, or one number for each contact point (n_points,).  The value of an
        interface without friction is 0.
        """
        coefficient = self.friction_coefficient
        if isinstance(coefficient, Mapping):
            interfaces = self.model.interfaces
            validation.mapping("friction_coefficient", coefficient, interfaces, "interfaces")
        values: dict[str, float | NDArray] = {}
        for name in self.interface_names():
            if self.model.interfaces[name].kind != "friction":
                values[name] = 0.0
            elif isinstance(coefficient, Mapping):
                values[name] = self._friction_of(name, coefficient)
            else:
                values[name] = validation.number("friction_coefficient", coefficient, least=0.0)
        return values

    def _friction_of(
        self, name: str, coefficients: Mapping[str, float | NDArray]
    ) -> float | NDArray:
        """Return the friction coefficient of one interface."""
        item = f"friction_coefficient of '{name}'"
        if name not in coefficients:
            # a ContactLaw does not use the coefficient
            if name in self.own_laws():
                return FRICTION
            raise SettingError(f"friction_coefficient: expected a value for interface '{name}'")
        value = coefficients[name]
        if np.ndim(value) == 0:
            return validation.number(item, value, least=0.0)
        return validation.numbers(item, value, self.model.interfaces[name].n_points, least=0.0)

    def warn_of_unused_friction(self, given: object) -> None:
        """Warn if an interface ignores its friction coefficient because it has a ContactLaw.

        Raises
        ------
        SettingError
            If the model has no friction faces.
        """
        # a stored study without friction faces has a mapping without entries
        names_nothing = isinstance(given, Mapping) and not given
        validation.check_sentence(
            self.friction_faces or names_nothing,
            "friction_coefficient",
            "has no effect on a model without friction faces; omit it",
        )
        user_laws = self.own_laws()
        if isinstance(given, Mapping):
            unused = [name for name in given if name in user_laws]
        elif len(user_laws) == len(self.friction_faces):
            unused = list(user_laws)
        else:
            unused = []
        if unused:
            names = ", ".join(map(repr, unused))
            warn(
                f"friction_coefficient has no effect on {names}, because a ContactLaw has its own "
                "parameters; set the friction there",
                PlausibilityWarning,
            )

    def friction_values(self) -> list[float]:
        """Return the positive friction coefficients that a law uses, ascending."""
        of_faces = self.friction_values_by_interface().values()
        distinct = np.unique(np.concatenate([np.zeros(0), *of_faces]))
        return [float(coefficient) for coefficient in distinct]

    def friction_values_by_interface(self) -> dict[str, NDArray]:
        """Return the positive friction coefficients (n,) that the law of each interface uses."""
        laws = self.law_by_interface()
        values = {}
        for face, coefficient in self.friction_by_interface().items():
            if laws.get(face) in (LAW_SEPARABLE, LAW_COUPLED):
                of_points = np.atleast_1d(coefficient)
                values[face] = of_points[of_points > 0.0]
        return values

    @property
    def harmonic_numbers(self) -> tuple[int, ...]:
        """Harmonics without the mean, ascending."""
        return harmonic_numbers(self.harmonics)

    @property
    def active_harmonics(self) -> set[int]:
        """Harmonics with unknowns, including 0 for the mean if it can move."""
        harmonics = set(self.harmonic_numbers)
        if self.bias:
            harmonics.add(0)
        return harmonics

    @property
    def needed_diameters(self) -> set[int]:
        """Nodal diameters of the mean and of the harmonics."""
        # the mean has engine order 0
        orders = {0}
        for harmonic in {1, *self.active_harmonics}:
            factor = 1 if self.fundamental_modes_only else harmonic
            orders.add(self.engine_order * factor)
        diameters = set()
        for order in orders:
            diameter, _ = self.model.folded_nodal_diameter(order)
            diameters.add(diameter)
        return diameters

    def record(self, stiffness_method: object, options: object = None) -> dict[str, Any]:
        """Return all settings in the form of results: numbers, texts, lists and mappings.

        Parameters
        ----------
        stiffness_method
            Method of the contact stiffness in use.
        options : dataclass, optional
            Options of the continuation, stored with the settings.
        """
        record = {
            setting.name: getattr(self, setting.name)
            for setting in fields(Settings)
            if setting.name not in ("model", "excitation", "response")
        }
        record["harmonics"] = self.harmonic_numbers
        # a ContactLaw does not use the coefficient of its interface
        user_laws = self.own_laws()
        record["friction_coefficient"] = {
            name: mu for name, mu in self.friction_by_interface().items() if name not in user_laws
        }
        record["excitation"] = self.excitation
        record["response"] = self.response_location
        record["contact_stiffness"] = _stiffness_setting(stiffness_method)
        if options is not None:
            record["continuation"] = options
        settings: dict[str, Any] = json.loads(json.dumps(record, default=_plain))
        return settings


def settings_of(record: Mapping[str, Any]) -> dict[str, Any]:
    """Return settings by name from the output of :meth:`Settings.record`; other entries are
    ignored.
    """
    # a setting of older versions, of which one value is left
    if record.get("friction_axes", "contact") != "contact":
        raise SettingError(
            'friction_axes: expected "contact", the only choice supported in this version, '
            'found "major"'
        )
    hints = get_type_hints(Settings)
    settings = {
        setting.name: from_json(hints[setting.name], record[setting.name])
        for setting in fields(Settings)
        if setting.name in record
    }
    if isinstance(settings["contact_forces"], Mapping):
        settings["contact_forces"] = AFT(**settings["contact_forces"])
    if isinstance(settings["contact_stiffness"], Mapping):
        settings["contact_stiffness"] = _recorded_stiffness(settings["contact_stiffness"])
    law = settings.get("friction_law")
    if isinstance(law, Mapping):
        settings["friction_law"] = _recorded_law(law)
    damping = settings.get("aerodynamic_damping")
    if damping is not None:
        # JSON has neither whole numbers as names nor complex numbers, only texts and pairs
        settings["aerodynamic_damping"] = {
            int(diameter): complex(real, imaginary)
            for diameter, (real, imaginary) in damping.items()
        }
    settings["gap"] = _arrays(settings.get("gap"))
    settings["constant_loads"] = _arrays(settings.get("constant_loads"))
    return settings


def _recorded_stiffness(record: Mapping[str, Any]) -> Any:
    """Return residual modes, or values, from the output of :func:`_stiffness_setting`."""
    # one entry: its name is the kind of the value
    ((kind, value),) = record.items()
    if kind == "residual_modes":
        return ResidualModes(**value)
    values: Any = tuple(value) if isinstance(value, list) else _arrays(value)
    return PerArea(values) if kind == "per_area" else values


def _recorded_law(record: Mapping[str, Any]) -> Any:
    """Return one user-defined law, or the laws of interfaces, from their record."""
    if "contact_law" in record:
        return ContactLaw.of_record(record)
    laws = {}
    for name, law in record.items():
        laws[name] = ContactLaw.of_record(law) if isinstance(law, Mapping) else law
    return laws


def _arrays(value: Any) -> Any:
    """Return a mapping with arrays instead of lists, and other values as they are."""
    if not isinstance(value, Mapping):
        return value
    return {
        name: np.array(item) if isinstance(item, list) else item for name, item in value.items()
    }


def _stiffness_setting(method: Any) -> Any:
    """Return a method or values of the contact stiffness with a name for their kind."""
    if isinstance(method, str):
        return method
    if isinstance(method, ResidualModes):
        return {"residual_modes": method}
    if isinstance(method, PerArea):
        return {"per_area": method.stiffness}
    return {"values": method}


def _plain(value: Any) -> Any:
    """Convert values that JSON does not support to numbers, texts, lists and mappings."""
    if isinstance(value, ContactLaw):
        return value.record()
    if isinstance(value, (np.ndarray, np.generic)):
        return value.tolist()
    if isinstance(value, complex):
        return [value.real, value.imag]
    if isinstance(value, Response):
        # a response without further choices has the record of earlier versions
        always = ("location", "direction")
        return {name: choice for name, choice in asdict(value).items() if choice or name in always}
    if isinstance(value, Mapping):
        return dict(value)
    return asdict(value)


def check_history(name: str, history: Sequence[float]) -> tuple[float, ...]:
    """Check and return the load factors of a preload history: at least one, none negative."""
    return tuple(validation.numbers(f"{name}, load factors", history, least=0.0).tolist())
