"""The settings of a problem: what the user chooses about one model, checked at once.

Every setting stands for a choice of the method (paper, sections 2 and 3): modes and nodal diameters of the bodies, contact
stiffness, friction law, preload history, harmonics of the response.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import InitVar, asdict, dataclass, field, fields, is_dataclass, replace
from typing import Any, Protocol, get_type_hints

import numpy as np
from numpy.typing import NDArray

from bdamper.contact.laws import LAW_BONDED, LAW_COUPLED, LAW_SEPARABLE, Sampled, check_evaluation
from bdamper.contact.residual_modes import ResidualModes
from bdamper.contact.stiffness import PerArea
from bdamper.model.coupling import RIGID_NAMES
from bdamper.model.loads import Excitation, Response
from bdamper.model.model import Model
from bdamper.model.validation import check_model_once
from bdamper.problem.effects import (
    BLADE_MODES,
    HARMONICS,
    LAW_NAMES,
    SWITCHES,
    Effects,
    check_law,
    check_traction,
    harmonic_numbers,
    whole_harmonics,
)  # fmt: skip
from bdamper.util import validate
from bdamper.util.errors import SettingError
from bdamper.util.hdf5 import typed

LAWS = dict(zip(LAW_NAMES, (LAW_SEPARABLE, LAW_COUPLED, LAW_BONDED)))
PAPER: Mapping[str, Any] = {
    "contact_stiffness": "eq4", "blade_modes": 10, "damper_modes": 0, "harmonics": 1, "single_basis": True
}  # fmt: skip
"""Settings of the paper (sections 2.2, 3.2 and 4.1): ``Study(model, ..., **PAPER)``, ``study.with_(**PAPER)``."""


@dataclass(frozen=True, eq=False)
class Settings:
    """What the user chooses about one model.

    Parameters
    ----------
    model : Model
    excitation : Excitation
    engine_order : int
        Of the fundamental harmonic; a bladed disk has no default, a structure without cyclic symmetry needs none.
    friction_coefficient : float or mapping of interface name to float
    response : Response, optional
        Location and direction of the excitation by default.
    harmonics : int or tuple of int
        Harmonics of the response besides the mean: how many, or which.
    contact_stiffness : {"residual_modes", "unit_traction", "eq4", "model"}, ResidualModes, float, PerArea, mapping, None
        Method (see :mod:`bdamper.contact.stiffness`), values in N/m or N/m3, or "model": those that the model carries.
        By default residual modes where the model carries the static flexibility that they need; else the values that the
        model carries, or unit tractions, with a note in ``stiffness_report`` and a
        :class:`~bdamper.util.warn.BdamperWarning`.
    contact_stiffness_factor : float
        On all contact stiffness, whatever its method, that of residual modes too: the flexibility of the whole contact is
        divided by it.
    blade_modes : int
        Modes of each constrained body, no more than the model has; the default stands for all of a model that has fewer.
    damper_modes : int
        Elastic modes of each free body.
    rigid_modes : sequence of str
        Rigid-body modes of free bodies: "TX", "TY", "TZ" (translation) and "RX", "RY", "RZ" (rotation), along and about
        the damper's own axes.
    constraints : bool
        Whether constraint planes (front and back of a damper) take part.
    single_basis : bool
        Describe every harmonic by the modes of the fundamental's nodal diameter, as the paper does.
    damping_ratio : float, optional
        For all elastic modes, instead of the model's.
    damper_damping_ratio : float
        Of every motion of free bodies, rigid and elastic, by itself on the springs of its friction faces while these are
        closed and stuck and the blades at rest, on top of the model's own; a motion against which nothing acts has none.
        Modes of the stuck damper, which combine these motions, have 0.7 to 1.7 times that on the shipped models.
    damper_drag : float, N s/m
        Viscous force on the translation of free bodies over its velocity, in proportion to mass on all their motions.
    evaluation : {"exact"} or Sampled
        How contact forces are found over a cycle.
    friction_law : {"separable", "coupled", "constant_normal_load", "bonded"} or mapping of interface name to these
        "separable": an independent 1-D element along each of two axes.  "coupled": the friction force lies in a disk of
        radius mu N (needs ``evaluation=Sampled(...)``; the static analysis uses the separable law, see
        :mod:`bdamper.contact.preload`).  "bonded": linear springs in all directions and both senses.
        "constant_normal_load": separable with ``variable_normal_load=False``; together with "coupled" give the latter.
    friction_axes : {"contact", "major"}
        Axes of the separable law: those of the interface, or at each point the major directions of its motion at the
        resonance of the stuck contact with the largest response (:mod:`bdamper.contact.friction_axes`).
    bias, variable_normal_load, separation : bool
        Whether the mean moves, the friction limit follows the normal load, surfaces open and close; what is assumed
        otherwise stands in :class:`~bdamper.problem.effects.Effects`.
    contact_points : int, optional
        At most so many contact points on each friction face, by uniting neighbouring patches; no more than the model has.
    gap : mapping of interface name to (n_points,) float, optional
        Initial distance of the surfaces in m, instead of the model's; see :func:`bdamper.misfit`.  None under
        the law "bonded".
    load_history : tuple of float
        Load factors through which a preload is reached, the last one 1: (1.5, 1.0) is an overload before it.
    stability : bool
        Whether tracking curves come with the stability of every point.
    effects : Effects, optional
        All settings that decide which effects take part, at once; the settings hold them afterwards, and
        ``Effects.of(study)`` reads them.
    speed : float, rad/s, optional
        Rotor speed that the model belongs to, as :meth:`bdamper.Study.at_speed` sets it.  The static analysis then takes
        the displacement of the faces by rotation, per newton of the damper's own centrifugal load.
    slip_offset : float, m
        Standard deviation of the displacements from assembly at which friction has no force, drawn for every contact point;
        the static analysis starts from them.
    slip_offset_seed : int
        Equal seeds draw equal offsets.

    Raises
    ------
    SettingError, ModelError
        At once, naming the setting, what was expected and what was found.
    """

    model: Model = field(repr=False)
    excitation: Excitation
    engine_order: int = None  # type: ignore[assignment]  # 1 without cyclic symmetry
    friction_coefficient: float | Mapping[str, float] = 0.3
    response: Response | None = None
    harmonics: int | tuple[int, ...] = HARMONICS
    contact_stiffness: str | float | ResidualModes | PerArea | Mapping[str, NDArray] | None = None
    blade_modes: int = BLADE_MODES
    damper_modes: int = 0
    rigid_modes: tuple[str, ...] = RIGID_NAMES
    constraints: bool = True
    single_basis: bool = False
    damping_ratio: float | None = None
    damper_damping_ratio: float = 0.0
    damper_drag: float = 0.0
    evaluation: str | Sampled = "exact"
    friction_law: str | Mapping[str, str] = "separable"
    friction_axes: str = "contact"
    residual_traction: InitVar[str] = "static"
    bias: bool = True
    variable_normal_load: bool = True
    separation: bool = True
    contact_points: int | None = None
    gap: Mapping[str, NDArray] | None = None
    load_history: tuple[float, ...] = (1.0,)
    stability: bool = False
    effects: Effects | None = None
    contact_stiffness_factor: float = 1.0
    speed: float | None = None
    slip_offset: float = 0.0
    slip_offset_seed: int = 0

    def __post_init__(self, residual_traction: str) -> None:
        check_traction(residual_traction)
        if self.effects is not None:
            self._take_effects(validate.instance("effects", self.effects, Effects))
        check_model_once(self.model)
        validate.instance("excitation", self.excitation, Excitation, "an Excitation(location, direction, amplitude)")
        if self.response is not None:
            validate.instance("response", self.response, Response, "a Response(location, direction)")
        for name, place in (("excitation", self.excitation), ("response", self.response_location)):
            validate.choice(f"{name} location", place.location, sorted(self.model.locations))
        self._check_friction()
        if self.engine_order is None:
            expected = f"that of the excitation, since the model has {self.model.n_blades} sectors"
            validate.require(self.model.n_blades <= 1, "engine_order", expected, "none")
            object.__setattr__(self, "engine_order", 1)
        validate.fields(self, validate.whole, "engine_order", "damper_modes")
        validate.fields(self, validate.whole, "blade_modes", least=1, most=max(BLADE_MODES, self.most_modes("constrained")))
        validate.fields(self, validate.names, "rigid_modes", choices=RIGID_NAMES)
        switches = ("bias", "variable_normal_load", "separation", "constraints", "single_basis", "stability")
        validate.fields(self, validate.flag, *switches)
        _ = Effects.of(self)
        self._check_contact_points()
        object.__setattr__(self, "harmonics", whole_harmonics(self.harmonics))
        check_evaluation(self.evaluation, self.harmonic_numbers[-1])
        object.__setattr__(self, "load_history", check_history(self.load_history, "load_history"))
        validate.require(self.load_history[-1] == 1.0, "load_history", "1.0 at its end", self.load_history)
        if self.damping_ratio is not None:
            validate.fields(self, validate.number, "damping_ratio", least=0.0, below=1.0)
        validate.fields(self, validate.number, "damper_damping_ratio", least=0.0, below=1.0)
        validate.fields(self, validate.number, "damper_drag", least=0.0, unit="N s/m")
        for name in ("damper_damping_ratio", "damper_drag"):
            if getattr(self, name) and not any(body.kind == "free" for body in self.model.bodies.values()):
                raise SettingError(f"{name}: expected 0, since the model has no free body, found {getattr(self, name):g}")
        validate.fields(self, validate.number, "contact_stiffness_factor", above=0.0)
        validate.fields(self, validate.number, "slip_offset", least=0.0, unit="m")
        validate.fields(self, validate.whole, "slip_offset_seed")
        if self.speed is not None:
            validate.fields(self, validate.number, "speed", above=0.0, unit="rad/s")
            own = self.model.provenance.get("rotor speed", "none")
            expected = f"a model at {self.speed:.9g} rad/s, as study.at_speed makes it"
            validate.require(own == f"{self.speed:.9g} rad/s", "speed", expected, f"one at {own}")
        self._check_held()

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
        validate.that(not drag or self.damping_ratio is None, "damping_ratio", expected, self.damping_ratio)
        own = isinstance(self.contact_stiffness, Mapping) and self.contact_stiffness_factor == 1.0
        if self.holds_preload and not own:
            raise SettingError(
                "contact_stiffness: expected that with which the model was made, since the preload of its contacts does "
                "not follow it; make the model with other contacts instead"
            )

    def _check_contact_points(self) -> None:
        """Patches are united, never split: no more contact points than the model has."""
        most = max(self.most_points, 1)
        expected = f"at most {most}, those of a friction face of the model, which decides how many there are (None for all)"
        validate.that((self.contact_points or 0) <= most, "contact_points", expected, self.contact_points)

    @property
    def most_points(self) -> int:
        """Contact points of the friction face of the model that has most of them; 0 without such a face."""
        return max((face.n_points for face in self.model.interfaces.values() if face.kind == "friction"), default=0)

    def most_modes(self, kind: str) -> int:
        """Modes that every body of a kind has at every nodal diameter, elastic ones of free bodies; 0 without a body."""
        bodies = [body for body in self.model.bodies.values() if body.kind == kind]
        modes = min((basis.n_modes for body in bodies for basis in body.bases.values()), default=0)
        return modes - len(RIGID_NAMES) if bodies and kind == "free" else modes

    def _take_effects(self, effects: Effects) -> None:
        own = {f.name: f.default for f in fields(self)}
        for name, value in self.settings_for(effects).items():
            given = getattr(self, name)
            found = f"effects with {value!r} and {given!r}; use with_effects to change the effects of a study"
            validate.require(given in (own[name], value), name, f"only one of effects and {name}", found)
            object.__setattr__(self, name, value)
        object.__setattr__(self, "effects", None)

    def settings_for(self, effects: Effects) -> dict[str, Any]:
        """Settings that carry some effects, by name."""
        settings = effects.settings()
        law = effects.friction_law
        if self.evaluation == "exact" and "coupled" in ([law] if isinstance(law, str) else law.values()):
            settings["evaluation"] = Sampled(max(128, 8 * effects.harmonic_numbers[-1] + 8))
        return settings

    def _check_friction(self) -> None:
        given = self.friction_law
        if given == "constant_normal_load":
            object.__setattr__(self, "friction_law", "separable")
            object.__setattr__(self, "variable_normal_load", False)
        else:
            check_law(given, (*LAW_NAMES, "constant_normal_load"))
            faces = [name for name, face in self.model.interfaces.items() if face.kind == "friction"]
            if isinstance(given, Mapping) and set(given) != set(faces):
                raise validate.unfit("friction_law", f"one of {LAW_NAMES} for each interface {faces}", dict(given))
        validate.choice("friction_axes", self.friction_axes, ("contact", "major"))
        laws = set(self.law_by_interface().values())
        expected = 'Sampled(n_time) with friction_law="coupled", which has no closed form'
        validate.require(not (isinstance(self.evaluation, str) and LAW_COUPLED in laws), "evaluation", expected, '"exact"')
        _ = self.friction_by_interface()

    def law_by_interface(self) -> dict[str, int]:
        """Law of each friction interface, before it is known which of them have friction."""
        given = self.friction_law
        names = [name for name, face in self.model.interfaces.items() if face.kind == "friction"]
        return {name: LAWS[given if isinstance(given, str) else given[name]] for name in names}

    @property
    def response_location(self) -> Response:
        """Where and along which direction the response is asked for: at the excitation by default."""
        return self.response or Response(self.excitation.location, self.excitation.direction)

    def interface_names(self) -> tuple[str, ...]:
        """Interfaces that take part, constraint planes only if they are asked for."""
        return tuple(name for name, face in self.model.interfaces.items() if self.constraints or face.kind != "constraint")

    def friction_by_interface(self) -> dict[str, float]:
        """Friction coefficient of each interface that takes part; none but on friction interfaces."""
        out = {}
        given = self.friction_coefficient
        if isinstance(given, Mapping):
            validate.mapping("friction_coefficient", given, self.model.interfaces, "interfaces")
        for name in self.interface_names():
            if self.model.interfaces[name].kind != "friction":
                out[name] = 0.0
            elif isinstance(given, Mapping):
                if name not in given:
                    raise SettingError(f"friction_coefficient: expected a value for interface '{name}'")
                out[name] = validate.number(f"friction_coefficient of '{name}'", given[name], least=0.0)
            else:
                out[name] = validate.number("friction_coefficient", given, least=0.0)
        return out

    @property
    def stiffness_method(self) -> Any:
        """The method or the values of the contact stiffness."""
        return "residual_modes" if self.contact_stiffness is None else self.contact_stiffness

    @property
    def harmonic_numbers(self) -> tuple[int, ...]:
        """Harmonics besides the mean, ascending."""
        return harmonic_numbers(self.harmonics)

    @property
    def active_harmonics(self) -> set[int]:
        """Harmonics that have unknowns, the mean counted as 0."""
        return {*self.harmonic_numbers, *([0] if self.bias else [])}

    @property
    def needed_diameters(self) -> set[int]:
        """Nodal diameters of the mean and of the harmonics."""
        orders = {self.engine_order * (1 if self.single_basis else l) for l in {1, *self.active_harmonics}} | {0}
        return {self.model.folded_nodal_diameter(order)[0] for order in orders}

    def _unusual(self) -> dict[str, Any]:
        """Values of settings that are told only where they are not the usual ones, by name."""
        off = [f.name for f in fields(self) if f.name in SWITCHES and not getattr(self, f.name)]
        gap = {} if self.gap is None else {name: f"{1e6 * np.max(g):.3g} um" for name, g in self.gap.items()}
        other: dict[str, Any] = {
            "rigid_modes": " ".join(self.rigid_modes) if self.rigid_modes != RIGID_NAMES else None,
            "damping_ratio": self.damping_ratio,
            "damper_damping_ratio": self.damper_damping_ratio or None,
            "damper_drag": f"{self.damper_drag:g} N s/m" if self.damper_drag else None,
            "contact_points": self.contact_points,
            "speed": f"{self.speed:g} rad/s" if self.speed is not None else None,
            "neglected": "; ".join(self.model.neglected_over_speed(self.needed_diameters)) or None if self.speed else None,
            "gap": ", ".join(f"{name} up to {g}" for name, g in gap.items()) or None,
            "load_history": self.load_history if self.load_history != (1.0,) else None,
            "slip_offset": f"{self.slip_offset:g} m, seed {self.slip_offset_seed}" if self.slip_offset else None,
            "friction_axes": self.friction_axes if self.friction_axes != "contact" else None,
            "off": ", ".join(off) or None,
        }
        return {name: value for name, value in other.items() if value is not None}

    def recorded(self, options: object = None) -> dict[str, Any]:
        """What a result says of how it was made: settings, as :meth:`record` returns them, and hash of the model."""
        return {"settings": self.record(options), "model_hash": self.model.hash}

    def record(self, options: Any = None) -> dict[str, Any]:
        """All settings as results keep them: numbers, texts, lists and mappings of these.

        Parameters
        ----------
        options : dataclass, optional
            Of the continuation, kept beside them.
        """
        places = {"excitation": self.excitation, "response": self.response_location}
        out = {f.name: getattr(self, f.name) for f in fields(Settings) if f.name not in ("model", "effects", *places)}
        out |= {"harmonics": self.harmonic_numbers, "friction_coefficient": self.friction_by_interface(), **places}
        out["contact_stiffness"] = _stiffness_setting(self.stiffness_method)
        if options is not None:
            out["continuation"] = options
        settings: dict[str, Any] = _plain(out)
        return settings


def settings_of(record: Mapping[str, Any]) -> dict[str, Any]:
    """Settings by name from what :meth:`Settings.record` made of them; what a result keeps besides is left out."""
    hints = get_type_hints(Settings)
    given = {f.name: typed(hints[f.name], record[f.name]) for f in fields(Settings) if f.name in record}
    if isinstance(given["evaluation"], Mapping):
        given["evaluation"] = Sampled(**given["evaluation"])
    if isinstance(given["contact_stiffness"], Mapping):
        ((kind, value),) = given["contact_stiffness"].items()
        plain: Any = tuple(value) if isinstance(value, list) else _arrays(value)
        made = PerArea(plain) if kind == "per_area" else plain
        given["contact_stiffness"] = ResidualModes(**value) if kind == "residual_modes" else made
    return given | {"gap": _arrays(given.get("gap"))}


def _arrays(value: Any) -> Any:
    return {name: np.array(item) for name, item in value.items()} if isinstance(value, Mapping) else value


class SomeResult(Protocol):
    """What a result keeps of the study that it is of."""

    @property
    def settings(self) -> dict[str, Any]: ...
    @property
    def model_hash(self) -> str: ...


def check_result(problem: Settings, result: SomeResult, name: str = "result") -> None:
    """Refuse a result of another model, of another rotor speed among them, or of other settings.

    Parameters
    ----------
    problem : Problem
        With the harmonics that a tolerance chose for the result.
    result
        With ``model_hash`` and ``settings``, which may lack some of those that there are now.
    name : str

    Raises
    ------
    SettingError
    """
    kept, own = result.settings, problem.record()
    other = [key for key in own if key in kept and kept[key] != own[key] and key != "stability"]
    if "speed" in other:
        mine, at = ("none" if x is None else f"{x:.9g} rad/s" for x in (own["speed"], kept["speed"]))
        raise SettingError(f"{name}: expected one at the rotor speed of this study, {mine}, found one at {at}")
    if result.model_hash not in (problem.model.hash, replace(problem.model, stress={}).hash):  # stress may come later
        raise SettingError(f"{name}: expected one of this study's model, found one of {'another' * bool(kept) or 'none'}")
    found = ", ".join(f"{key} = {kept[key]} for {own[key]}" for key in other)
    validate.require(not other, name, "one of this study", f"one with {found}")


def _stiffness_setting(given: Any) -> Any:
    if isinstance(given, ResidualModes):
        return {"residual_modes": given}
    if isinstance(given, PerArea):
        return {"per_area": given.stiffness}
    return given if isinstance(given, str) else {"values": given}


def _plain(value: Any) -> Any:
    """Settings as they stand in a file: numbers, texts, lists and mappings of these."""
    if is_dataclass(value) and not isinstance(value, type):
        value = asdict(value)
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (np.ndarray, np.generic)):
        return value.tolist()
    return [_plain(item) for item in value] if isinstance(value, (list, tuple)) else value


def check_history(history: Sequence[float], name: str) -> tuple[float, ...]:
    """Load factors, checked: at least one, none negative."""
    return tuple(validate.numbers(f"{name}, load factors", history, least=0.0).tolist())
