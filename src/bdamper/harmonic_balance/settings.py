"""The settings of a problem: what the user chooses about one model, checked at once.

Every setting stands for a choice of the method (paper, sections 2 and 3): modes and nodal diameters of the bodies, contact
stiffness, friction law, preload history, harmonics of the response.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from functools import partial
from typing import Annotated, Any, get_type_hints

import numpy as np
from numpy.typing import NDArray

from bdamper.contact.laws import AFT, LAW_BONDED, LAW_COUPLED, LAW_SEPARABLE, LAW_USER, ContactLaw, check_evaluation
from bdamper.contact.residual_flexibility import ResidualModes
from bdamper.contact.stiffness import PerArea
from bdamper.harmonic_balance.effects import BLADE_MODES, HARMONICS, LAW_NAMES, ByBody, Harmonics, Law, harmonic_numbers
from bdamper.model.kinematics import RIGID_NAMES
from bdamper.model.loads import FIELD, Excitation, Response, direction_vector
from bdamper.model.structure import Interface, Model
from bdamper.model.validation import check_model_once
from bdamper.util import validation
from bdamper.util.errors import SettingError
from bdamper.util.formatting import short_repr
from bdamper.util.storage import from_json

LAWS = dict(zip(LAW_NAMES, (LAW_SEPARABLE, LAW_COUPLED, LAW_BONDED)))
CIGEROGLU_2009: Mapping[str, Any] = {
    "contact_stiffness": "cigeroglu2009", "blade_modes": 10, "damper_modes": 0, "harmonics": 1,
    "fundamental_modes_only": True
}  # fmt: skip
"""Settings of the paper (sections 2.2, 3.2 and 4.1): ``Study(model, ..., **CIGEROGLU_2009)``,
``study.replace(**CIGEROGLU_2009)``."""


@partial(validation.check_arguments, name="Study")
@short_repr
@dataclass(frozen=True, eq=False)
class Settings:
    """Settings of a study of one model.

    Parameters
    ----------
    model : Model
    excitation : Excitation
    engine_order : int
        Of the fundamental harmonic; a bladed disk has no default, a structure without cyclic symmetry needs none.
    friction_coefficient : float or mapping of interface name to float or (n_points,) float
        An array has a value for each contact point of the interface in the model; united patches have the mean.
    response : Response, optional
        Location and direction of the excitation by default.
    harmonics : int or tuple of int
        Harmonics of the response besides the mean: how many, or which.
    contact_stiffness : {"residual_modes", "unit_traction", "cigeroglu2009", "model"}, ResidualModes, float, PerArea,
    mapping, None
        Method (see :mod:`bdamper.contact.stiffness`), values in N/m or N/m3, or "model": those that the model carries.
        By default residual modes where the model carries the static flexibility that they need; else the values that the
        model carries, or unit tractions, with a note in ``stiffness_report`` and a
        :class:`~bdamper.util.errors.BdamperWarning`.
    contact_stiffness_factor : float
        On all contact stiffness, whatever its method, that of residual modes too: the flexibility of the whole contact is
        divided by it.
    blade_modes : int
        Modes of each constrained body, no more than the model has; the default stands for all of a model that has fewer.
    damper_modes : int or mapping of body name to int
        Elastic modes of each free body; of those that a mapping does not name, none.
    rigid_modes : sequence of str
        Rigid-body modes of free bodies: "TX", "TY", "TZ" (translation) and "RX", "RY", "RZ" (rotation), along and about
        the damper's own axes.
    constraint_planes : bool
        Whether constraint planes (front and back of a damper) take part.
    fundamental_modes_only : bool
        Describe every harmonic by the modes of the fundamental's nodal diameter, as the paper does.
    damping_ratio : float, optional
        For all elastic modes, instead of the model's.
    damper_damping_ratio : float or mapping of body name to float
        Of every motion of free bodies, rigid and elastic, by itself on the springs of its friction faces while these are
        closed and stuck and the blades at rest, on top of the model's own; a motion against which nothing acts has none.
        Modes of the stuck damper, which combine these motions, have 0.7 to 1.7 times that on the shipped models.
    aerodynamic_damping : complex or mapping of nodal diameter to complex, optional
        Of a flow around the blades: a damping ratio of every mode of the constrained bodies, besides their own; of a
        complex number the imaginary part is that, and the real part a relative shift of the frequency, as in
        :meth:`bdamper.Study.flutter`.  At the nodal diameter of the engine order, or at those given: waves ``d`` and
        ``n_blades - d`` (or ``-d``) run in opposite senses.  None at others and on the mean.
        :func:`bdamper.influence_coefficients` gives them from a few blades.
    damper_drag : float or mapping of body name to float, N s/m
        Viscous force on the translation of free bodies over its velocity, in proportion to mass on all their motions.
    contact_forces : {"event_driven"} or AFT
        How contact forces are found over a cycle.
    friction_law : {"uncoupled", "coupled", "bonded"}, ContactLaw or mapping of interface to these
        "uncoupled": an independent 1-D element along each of two axes.  "coupled": the friction force lies in a disk of
        radius mu N (the static analysis uses the uncoupled law, see :mod:`bdamper.contact.static_state`).  "bonded": linear
        springs in all directions and both senses.  A :class:`~bdamper.ContactLaw` is a compiled function, with springs of
        its own in place of the contact stiffness.  It and "coupled" are sampled, at 128 instants unless ``contact_forces``
        says otherwise.
    bias, variable_normal_load, separation : bool
        Whether the mean moves, the friction limit follows the normal load, surfaces open and close; what is assumed
        otherwise stands in :class:`~bdamper.harmonic_balance.effects.Effects`.
    contact_points : int, optional
        At most so many contact points on each friction face, by uniting neighbouring patches; no more than the model has.
    gap : mapping of interface name to float or (n_points,) float, optional
        Initial distance of the surfaces in m, instead of the model's, negative for interference; see
        :func:`bdamper.face_gap`.  None under the law "bonded".
    load_per_preload : mapping of name to float, optional
        Newtons per newton of preload: on free bodies, by name, and of normal load on friction interfaces between
        constrained bodies (shrouds, roots); nothing on those that are not named.  By default 1 on every loaded body.  At a
        rotor speed mass times radius of the bodies decides, and the preload is that of the first one.
    constant_loads : mapping of name to float or (n_points,) float, optional
        Newtons that do not change with the preload, on the same bodies and interfaces; one value for each contact point
        of an interface, or their sum, which is shared by area.  Normal loads of an interface are those of the assembly:
        after the structure has given way to them, and before the free bodies are loaded.  A negative load of a point is a
        gap of ``-load/kn`` then; gaps of interfaces with a load do not count.
    load_history : tuple of float
        Load factors through which a preload is reached, the last one 1: (1.5, 1.0) is an overload before it.
    stability : bool
        Whether response curves come with the stability of every point.
    speed : float, rad/s, optional
        Rotor speed that the model belongs to, as :meth:`bdamper.Study.at_speed` sets it.  The static analysis then takes
        the displacement of the faces by rotation, per newton of the damper's own centrifugal load.
    residual_slip_std : float, m
        Standard deviation of the displacements from assembly at which friction has no force, drawn for every contact point;
        the static analysis starts from them.
    residual_slip_seed : int
        Equal seeds draw equal offsets.

    Raises
    ------
    SettingError, ModelError
        At once, naming the setting, what was expected and what was found.
    """

    model: Model = field(repr=False)
    excitation: Annotated[Excitation, partial(validation.instance, kind=Excitation)]
    engine_order: validation.Natural = None  # type: ignore[assignment]  # 1 without cyclic symmetry
    friction_coefficient: float | Mapping[str, float | NDArray] = 0.3
    response: Annotated[Response, partial(validation.instance, kind=Response)] | None = None
    harmonics: Harmonics = HARMONICS
    contact_stiffness: str | float | ResidualModes | PerArea | Mapping[str, NDArray] | None = None
    blade_modes: validation.Count = BLADE_MODES
    damper_modes: ByBody = 0
    rigid_modes: Annotated[tuple[str, ...], partial(validation.names, choices=RIGID_NAMES)] = RIGID_NAMES
    constraint_planes: bool = True
    fundamental_modes_only: bool = False
    damping_ratio: validation.Share | None = None
    damper_damping_ratio: Annotated[
        float | Mapping[str, float], validation.each(validation.Limits(least=0.0, below=1.0))
    ] = 0.0
    damper_drag: Annotated[float | Mapping[str, float], validation.each(validation.Limits(least=0.0, unit="N s/m"))] = 0.0
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

    def __post_init__(self) -> None:
        check_model_once(self.model)
        if self.engine_order is None:
            expected = f"that of the excitation, since the model has {self.model.n_blades} sectors"
            validation.check(self.model.n_blades <= 1, "engine_order", expected, "none")
            object.__setattr__(self, "engine_order", 1)
        validation.check_fields(self)
        self._check_places()
        validation.integer("blade_modes", self.blade_modes, 1, max(BLADE_MODES, self.most_modes("constrained")))
        self._check_friction()
        most = max(self.most_points, 1)
        expected = f"at most {most}, those of a friction face of the model, which decides how many there are (None for all)"
        validation.check_value((self.contact_points or 0) <= most, "contact_points", expected, self.contact_points)
        check_evaluation(self.contact_forces, self.harmonic_numbers[-1])
        validation.check(self.load_history[-1] == 1.0, "load_history", "1.0 at its end", self.load_history)
        for name in ("damper_modes", "damper_damping_ratio", "damper_drag"):
            given = getattr(self, name)
            if isinstance(given, Mapping):
                validation.mapping(name, given, self.free_bodies, "free bodies")
            elif name != "damper_modes":
                validation.check_value(self.free_bodies or not given, name, "0, since the model has no free body", given)
        if self.speed is not None:
            own = self.model.provenance.get("rotor speed", "none")
            expected = f"a model at {self.speed:.9g} rad/s, as study.at_speed makes it"
            validation.check(own == f"{self.speed:.9g} rad/s", "speed", expected, f"one at {own}")
        self._check_held()
        self._check_loads()
        self._check_orders()
        if self.aerodynamic_damping is not None:
            object.__setattr__(self, "aerodynamic_damping", self._flow(self.aerodynamic_damping))

    def _flow(self, given: complex | Mapping[int, complex]) -> dict[int, complex]:
        """Relative shift of the frequency and damping ratio by the wave, 0 to n_blades - 1."""
        own = given if isinstance(given, Mapping) else {self.engine_order: given}
        validation.check(self.most_modes("constrained"), "aerodynamic_damping", "None without a constrained body", given)
        out = {}
        for d, value in own.items():
            item = f"aerodynamic_damping at nodal diameter {d}"
            wave = validation.integer(item.replace("damping at", "damping,"), d, -self.model.n_blades) % self.model.n_blades
            finite = isinstance(value, (int, float, complex)) and np.isfinite(value)
            validation.check_value(finite, item, "a finite number", value)
            validation.check(wave not in out, item, "each wave once", f"that of {d} twice")
            out[wave] = value if isinstance(value, complex) else 1j * value
        return out

    def _check_places(self) -> None:
        places = sorted(name for name, place in self.model.locations.items() if place.kind is None)
        modes = [f"mode {k + 1}" for k in range(self.most_modes("constrained"))]
        for each in (self.excitation, *self.excitation.beside):
            others = modes if each.location.startswith("mode ") and each.location not in self.model.locations else ()
            validation.choice("excitation location", each.location, (*sorted(self.model.locations), *others))
            plain = each.location in places or each.direction == "tangential"
            expected = f"none, which '{each.location}' does not have"
            validation.check_value(plain, "excitation direction", expected, each.direction)
        if self.response is None:
            expected = "a Response(location, direction), since the excitation is no force at a location"
            validation.check(self.acts_at_location, "response", expected, "none")
        validation.choice("response location", self.response_location.location, places)

    def _check_orders(self) -> None:
        """Every force acts on a harmonic that is solved for, the first one among them, which the amplitude is of."""
        for each in (self.excitation, *self.excitation.beside):
            own = self.engine_order if each.engine_order is None else each.engine_order
            known = [self.engine_order * l for l in self.harmonic_numbers]
            expected = f"one of {known}, those of the harmonics"
            validation.check_value(own in known, "engine_order of an excitation", expected, own)
        found = sorted(self.excited)
        validation.check(
            found[0] == 1, "excitation", "a force of the study's own engine_order", f"harmonics {found} alone"
        )

    @property
    def acts_at_location(self) -> bool:
        """Whether the (first) excitation is a force in N at a location, no field of forces and no modal force."""
        place = self.model.locations.get(self.excitation.location)
        return place is not None and place.kind is None

    @property
    def excited(self) -> dict[int, list[tuple[str, NDArray, complex]]]:
        """Forces on each harmonic: location, direction (3,) that makes a row of its motions, and complex amplitude (N)."""
        out: dict[int, list[tuple[str, NDArray, complex]]] = {}
        for each in (self.excitation, *self.excitation.beside):
            place = self.model.locations.get(each.location)
            whole = place is None or place.kind is not None  # a mode or a field
            along = FIELD if whole else direction_vector(each.direction, "excitation direction")
            order = self.engine_order if each.engine_order is None else each.engine_order
            out.setdefault(order // (self.engine_order or 1) or 1, []).append((each.location, along, each.force))
        return out

    @property
    def places(self) -> tuple[tuple[str, NDArray], ...]:
        """Locations and directions (3,) of the forces, those on a mode aside, and of the response."""
        forces = [(at, along) for group in self.excited.values() for at, along, _ in group if at in self.model.locations]
        response = self.response_location
        return (*forces, (response.location, direction_vector(response.direction, "response direction")))

    @property
    def free_bodies(self) -> tuple[str, ...]:
        """Names of the free bodies."""
        return tuple(body.name for body in self.model.bodies.values() if body.kind == "free")

    def by_body(self, name: str) -> dict[str, Any]:
        """A setting of free bodies ("damper_modes", "damper_damping_ratio", "damper_drag") for each of them."""
        given = getattr(self, name)
        return {body: given.get(body, 0) if isinstance(given, Mapping) else given for body in self.free_bodies}

    @property
    def friction_faces(self) -> tuple[Interface, ...]:
        """Interfaces with friction."""
        return tuple(face for face in self.model.interfaces.values() if face.kind == "friction")

    @property
    def constrained_faces(self) -> tuple[str, ...]:
        """Friction interfaces that no free body takes part in: shrouds, roots, a platform pressed on the ground."""
        free = self.free_bodies
        return tuple(face.name for face in self.friction_faces if face.body_a not in free and face.body_b not in free)

    @property
    def loaded(self) -> tuple[str, ...]:
        """Names of what may be loaded: bodies with a load, and friction interfaces between constrained bodies."""
        return (*(name for name, body in self.model.bodies.items() if body.load is not None), *self.constrained_faces)

    def given_loads(self, item: str) -> dict[str, Any]:
        """``load_per_preload`` (1 on every loaded body where none are given) or ``constant_loads``, by name."""
        given = getattr(self, item)
        if given is None and item == "load_per_preload":
            return {name: 1.0 for name in self.loaded if name in self.model.bodies}
        return dict(given or {})

    def _check_loads(self) -> None:
        bodies = [name for name in self.loaded if name in self.model.bodies]
        for item in ("load_per_preload", "constant_loads"):
            given = getattr(self, item)
            words = "bodies with a load and friction interfaces between constrained bodies"
            names = () if given is None else validation.mapping(item, given, self.loaded, words)
            for name in names:
                if np.ndim(given[name]) == 0 or item == "load_per_preload" or name in bodies:
                    validation.number(f"{item} of '{name}'", given[name], least=0.0)
        if self.load_per_preload is not None:
            validation.check(
                any(self.load_per_preload.values()), "load_per_preload", "at least one above 0", dict(self.load_per_preload)
            )
        if self.speed is not None:
            expected = "none at a rotor speed, where mass times radius of the bodies decides (vary damper_mass there)"
            validation.check(self.load_per_preload is None, "load_per_preload", expected, self.load_per_preload)
            held = [name for name in self.constant_loads or () if name in bodies]
            validation.check(not held, "constant_loads", "those of interfaces alone at a rotor speed", held)

    @property
    def holds_preload(self) -> bool:
        """Whether contacts of lumped masses have a preload, which does not follow the contact stiffness."""
        faces = self.model.interfaces
        lumped = [body for body in self.model.bodies.values() if body.kind == "lumped"]
        return any((faces[port[0]].gap < 0.0).any() for body in lumped for port in body.ports)

    def _check_held(self) -> None:
        """What a lumped model carries as forces and matrices does not follow settings of contacts and modes."""
        drag = any(basis.drag is not None for body in self.model.bodies.values() for basis in body.bases.values())
        expected = "none, since the model carries a damping matrix that couples its modes"
        validation.check_value(not drag or self.damping_ratio is None, "damping_ratio", expected, self.damping_ratio)
        own = isinstance(self.contact_stiffness, Mapping) and self.contact_stiffness_factor == 1.0
        if self.holds_preload and not own:
            raise SettingError(
                "contact_stiffness: expected that with which the model was made, since the preload of its contacts does "
                "not follow it; make the model with other contacts instead"
            )

    @property
    def most_points(self) -> int:
        """Contact points of the friction face of the model that has most of them; 0 without such a face."""
        return max((face.n_points for face in self.friction_faces), default=0)

    def most_modes(self, kind: str) -> int:
        """Modes that every body of a kind has at every nodal diameter, elastic ones of free bodies; 0 without a body."""
        bodies = [body for body in self.model.bodies.values() if body.kind == kind]
        modes = min((basis.n_natural for body in bodies for basis in body.bases.values()), default=0)
        return modes - len(RIGID_NAMES) if bodies and kind == "free" else modes

    def _check_friction(self) -> None:
        given, faces = self.friction_law, [face.name for face in self.friction_faces]
        if isinstance(given, Mapping) and set(given) != set(faces):
            raise validation.invalid("friction_law", f"one of {LAW_NAMES} for each interface {faces}", dict(given))
        # settings that laws of the user's own do not go with
        served = {"separation": True, "variable_normal_load": True, "stability": False}
        for name, value in served.items() if self.own_laws() else ():
            validation.check_value(getattr(self, name) == value, name, f"{value!r} with a ContactLaw", getattr(self, name))
        sampled = {LAW_COUPLED, LAW_USER} & set(self.law_by_interface().values())
        if (
            sampled and isinstance(self.contact_forces, str) and self.contact_forces == "event_driven"
        ):  # neither has a closed form
            object.__setattr__(self, "contact_forces", AFT(max(128, 8 * self.harmonic_numbers[-1] + 8)))
        _ = self.friction_by_interface()

    def _laws(self) -> dict[str, str | ContactLaw]:
        """Of each friction interface."""
        given = self.friction_law
        return {face.name: given[face.name] if isinstance(given, Mapping) else given for face in self.friction_faces}

    def own_laws(self) -> dict[str, ContactLaw]:
        """The user's own laws of friction interfaces."""
        return {name: law for name, law in self._laws().items() if isinstance(law, ContactLaw)}

    def law_by_interface(self) -> dict[str, int]:
        """Law of each friction interface, before it is known which of them have friction."""
        return {name: LAW_USER if isinstance(law, ContactLaw) else LAWS[law] for name, law in self._laws().items()}

    @property
    def response_location(self) -> Response:
        """Location and direction of the response; those of the excitation by default."""
        return self.response or Response(self.excitation.location, self.excitation.direction)

    def interface_names(self) -> tuple[str, ...]:
        """Interfaces that take part, constraint planes only if they are asked for."""
        return tuple(
            name for name, face in self.model.interfaces.items() if self.constraint_planes or face.kind != "constraint"
        )

    def friction_by_interface(self) -> dict[str, float | NDArray]:
        """Friction coefficient of each interface that takes part, or those (n_points,) of its points in the model; none but
        on friction interfaces."""
        out: dict[str, float | NDArray] = {}
        given = self.friction_coefficient
        if isinstance(given, Mapping):
            validation.mapping("friction_coefficient", given, self.model.interfaces, "interfaces")
        for name in self.interface_names():
            if self.model.interfaces[name].kind != "friction":
                out[name] = 0.0
            elif isinstance(given, Mapping):
                if name not in given:
                    raise SettingError(f"friction_coefficient: expected a value for interface '{name}'")
                points = partial(validation.numbers, n=self.model.interfaces[name].n_points)
                check: Any = validation.number if np.ndim(given[name]) == 0 else points
                out[name] = check(f"friction_coefficient of '{name}'", given[name], least=0.0)
            else:
                out[name] = validation.number("friction_coefficient", given, least=0.0)
        return out

    def friction_values(self) -> list[float]:
        """Friction coefficients that there are, ascending, without 0."""
        values = [np.atleast_1d(value) for value in self.friction_by_interface().values()]
        return [mu for mu in np.unique(np.concatenate([*values, [0.0]])).tolist() if mu > 0.0]

    @property
    def harmonic_numbers(self) -> tuple[int, ...]:
        """Harmonics besides the mean, ascending."""
        return harmonic_numbers(self.harmonics)

    @property
    def active_harmonics(self) -> set[int]:
        """Active harmonics; 0 is the mean."""
        return {*self.harmonic_numbers, *([0] if self.bias else [])}

    @property
    def needed_diameters(self) -> set[int]:
        """Nodal diameters of the mean and of the harmonics."""
        orders = {self.engine_order * (1 if self.fundamental_modes_only else l) for l in {1, *self.active_harmonics}} | {0}
        return {self.model.folded_nodal_diameter(order)[0] for order in orders}

    def record(self, stiffness_method: object, options: object = None) -> dict[str, Any]:
        """All settings as results keep them: numbers, texts, lists and mappings of these.

        Parameters
        ----------
        stiffness_method
            That is in use for the contact stiffness.
        options : dataclass, optional
            Of the continuation, kept beside them.
        """
        places = {"excitation": self.excitation, "response": self.response_location}
        out = {f.name: getattr(self, f.name) for f in fields(Settings) if f.name not in ("model", *places)}
        out |= {"harmonics": self.harmonic_numbers, "friction_coefficient": self.friction_by_interface(), **places}
        out["contact_stiffness"] = _stiffness_setting(stiffness_method)
        if options is not None:
            out["continuation"] = options
        settings: dict[str, Any] = json.loads(json.dumps(out, default=_plain))
        return settings


def settings_of(record: Mapping[str, Any]) -> dict[str, Any]:
    """Settings by name from what :meth:`Settings.record` made of them; what a result keeps besides is left out."""
    if record.get("friction_axes", "contact") != "contact":
        raise SettingError('friction_axes: expected "contact", the axes of this version, found "major"')
    hints = get_type_hints(Settings)
    given = {f.name: from_json(hints[f.name], record[f.name]) for f in fields(Settings) if f.name in record}
    if isinstance(given["contact_forces"], Mapping):
        given["contact_forces"] = AFT(**given["contact_forces"])
    if isinstance(given["contact_stiffness"], Mapping):
        ((kind, value),) = given["contact_stiffness"].items()
        plain: Any = tuple(value) if isinstance(value, list) else _arrays(value)
        made = PerArea(plain) if kind == "per_area" else plain
        given["contact_stiffness"] = ResidualModes(**value) if kind == "residual_modes" else made
    law = given.get("friction_law")
    if isinstance(law, Mapping):
        laws = {name: ContactLaw.of_record(x) if isinstance(x, Mapping) else x for name, x in law.items()}
        given["friction_law"] = ContactLaw.of_record(law) if "contact_law" in law else laws
    if given.get("aerodynamic_damping") is not None:
        given["aerodynamic_damping"] = {int(d): complex(*z) for d, z in given["aerodynamic_damping"].items()}
    return given | {name: _arrays(given.get(name)) for name in ("gap", "constant_loads")}


def _arrays(value: Any) -> Any:
    if not isinstance(value, Mapping):
        return value
    return {name: np.array(item) if isinstance(item, list) else item for name, item in value.items()}


def _stiffness_setting(given: Any) -> Any:
    if isinstance(given, ResidualModes):
        return {"residual_modes": given}
    if isinstance(given, PerArea):
        return {"per_area": given.stiffness}
    return given if isinstance(given, str) else {"values": given}


def _plain(value: Any) -> Any:
    """What JSON does not know among settings, in numbers, texts, lists and mappings of these."""
    if isinstance(value, ContactLaw):
        return value.record()
    if isinstance(value, (np.ndarray, np.generic)):
        return value.tolist()
    if isinstance(value, complex):
        return [value.real, value.imag]
    return dict(value) if isinstance(value, Mapping) else asdict(value)


def check_history(name: str, history: Sequence[float]) -> tuple[float, ...]:
    """Load factors, checked: at least one, none negative."""
    return tuple(validation.numbers(f"{name}, load factors", history, least=0.0).tolist())
