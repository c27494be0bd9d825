"""A study: one model under one set of settings, asked for responses.

Everything is made once and kept: the bases of the harmonics, contact stiffness, static preload analyses.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import asdict, dataclass, field, fields, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal, overload

import numpy as np
from numpy.typing import NDArray

from bdamper.balance.system import HarmonicSystem
from bdamper.contact.friction_axes import major_angles, turned
from bdamper.contact.laws import LAW_BONDED, LAW_COUPLED, LAW_NORMAL, LAW_SEPARABLE, Sampled, check_evaluation
from bdamper.contact.no_separation import without_separation
from bdamper.contact.points import PointArrays
from bdamper.contact.residual_modes import ResidualModes
from bdamper.contact.static import OPEN, PreloadState, StaticSystem, scaled_state, static_state
from bdamper.contact.stiffness import (
    METHODS,
    Contact,
    PerArea,
    StiffnessComparison,
    StiffnessReport,
    check_method,
    contact_stiffness,
    literal_negative,
    report,
)
from bdamper.contact.wedge import ContactMap, WedgeFriction, wedge_friction
from bdamper.continuation.curve import Curve, InterruptedCurve, uninterrupted
from bdamper.continuation.follower import ContinuationOptions
from bdamper.continuation.linear_curve import linear_curve
from bdamper.continuation.mean_position import why_no_solution
from bdamper.continuation.start import NO_AIDS, Aids, first_point
from bdamper.continuation.track import track_curve
from bdamper.effects.compare_laws import CHOICES, LawComparison, known_laws
from bdamper.model.coarsening import unite_contact_points, united_gap, united_stiffness
from bdamper.model.coupling import RIGID_NAMES, Coupling, HarmonicBasis, retained_modes, standard_rigid_modes
from bdamper.model.loads import Excitation, Response, direction_vector
from bdamper.model.model import ContactStiffness, Model
from bdamper.model.validation import check_model
from bdamper.problem.effects import LAW_NAMES, TRACTIONS, Effects, check_law, harmonic_numbers, whole_harmonics
from bdamper.stability.floquet import stability_of_points
from bdamper.stability.steady_state import FEWEST, Motion, SettledResponse, settle
from bdamper.stability.time_integration import Verification, verify_solution
from bdamper.util import validate
from bdamper.util.blas import one_thread
from bdamper.util.cost import Cost, CostMeter
from bdamper.util.errors import SettingError, StaticError
from bdamper.util.repr import brief, short

if TYPE_CHECKING:
    from bdamper.effects.adaptive import AdaptivePeak
    from bdamper.effects.advice import Advice
    from bdamper.peaks.newton import Peak, PeakOptions
    from bdamper.peaks.optimal import OptimalCurve, OptimumPoint
    from bdamper.peaks.sensitivity import PeakSensitivity
    from bdamper.util.estimates import ErrorEstimates

_SWITCHES = ("bias", "variable_normal_load", "separation", "constraints")
LAWS = dict(zip(LAW_NAMES, (LAW_SEPARABLE, LAW_COUPLED, LAW_BONDED)))
BLADE_MODES = 10
"""By default; fewer where the model has no more."""


@brief
@dataclass(frozen=True, eq=False)
class Study:
    """Settings of an analysis of one model.

    Studies are told apart by identity; what two of them have in common is seen in the settings of their results.

    Parameters
    ----------
    model : Model
    excitation : Excitation
    engine_order : int
        Of the fundamental harmonic.
    friction_coefficient : float or mapping of interface name to float
    response : Response, optional
        Location and direction of the excitation by default.
    harmonics : int or tuple of int
        Harmonics of the response besides the mean: how many, or which.
    contact_stiffness : {"residual_modes", "unit_traction", "eq4", "model"}, ResidualModes, float, PerArea or mapping
        Method (see :mod:`bdamper.contact.stiffness`), values in N/m or N/m3, or "model": those that the model carries.
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
    evaluation : {"exact"} or Sampled
        How contact forces are found over a cycle.
    friction_law : {"separable", "coupled", "constant_normal_load", "bonded"} or mapping of interface name to these
        "separable": an independent 1-D element along each of two axes.  "coupled": the friction force lies in a disk of
        radius mu N (needs ``evaluation=Sampled(...)``; the static analysis uses the separable law, see
        :mod:`bdamper.contact.static`).  "bonded": linear springs in all directions and both senses.
        "constant_normal_load": separable with ``variable_normal_load=False``; together with "coupled" give the latter.
    friction_axes : {"contact", "major"}
        Axes of the separable law: those of the interface, or at each point the major directions of its motion
        (:mod:`bdamper.contact.friction_axes`).
    major_frequency : float, Hz, optional
        At which the stuck response shows the major directions; by default its resonance with the largest response.  Only
        with ``friction_axes="major"``.
    residual_traction : {"static", "lower", "upper"}
        Friction force of points that never slip, which the equations leave open within an interval
        (``HarmonicSystem.slider_interval``): that of the static state, or that end of the interval at which friction
        carries as much of the damper's load as it can ("lower": lowest normal loads), or works against it as much as it
        can ("upper").  Directions that are normal to the load keep the static value.
    bias, variable_normal_load, separation : bool
        Whether the mean moves, the friction limit follows the normal load, surfaces open and close; what is assumed
        otherwise stands in :class:`~bdamper.problem.effects.Effects`.
    contact_points : int, optional
        At most so many contact points on each friction face, by uniting neighbouring patches.
    gap : mapping of interface name to (n_points,) float, optional
        Initial distance of the surfaces in m, instead of the model's; see :func:`bdamper.model.misfit.misfit`.  None under
        the law "bonded".
    load_history : tuple of float
        Load factors through which a preload is reached, the last one 1: (1.5, 1.0) is an overload before it.
    stability : bool
        Whether tracking curves come with the stability of every point.
    effects : Effects, optional
        All settings that decide which effects take part, at once; the settings hold them afterwards, and
        ``Effects.of(study)`` reads them.

    Raises
    ------
    SettingError, ModelError
        At once, naming the setting, what was expected and what was found.
    """

    model: Model = field(repr=False)
    excitation: Excitation
    engine_order: int = 1
    friction_coefficient: float | Mapping[str, float] = 0.3
    response: Response | None = None
    harmonics: int | tuple[int, ...] = 1
    contact_stiffness: str | float | ResidualModes | PerArea | Mapping[str, NDArray] = "unit_traction"
    blade_modes: int = BLADE_MODES
    damper_modes: int = 0
    rigid_modes: tuple[str, ...] = RIGID_NAMES
    constraints: bool = True
    single_basis: bool = False
    damping_ratio: float | None = None
    evaluation: str | Sampled = "exact"
    friction_law: str | Mapping[str, str] = "separable"
    friction_axes: str = "contact"
    major_frequency: float | None = None
    residual_traction: str = "static"
    bias: bool = True
    variable_normal_load: bool = True
    separation: bool = True
    contact_points: int | None = None
    gap: Mapping[str, NDArray] | None = None
    load_history: tuple[float, ...] = (1.0,)
    stability: bool = False
    effects: Effects | None = None
    contact_stiffness_factor: float = 1.0
    _states: dict[tuple[float, ...], PreloadState] = field(default_factory=dict, init=False, repr=False, compare=False)
    _angles: dict[float, NDArray] = field(default_factory=dict, init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if self.effects is not None:
            self._take_effects(validate.instance("effects", self.effects, Effects))
        if not getattr(self.model, "_checked", False):
            check_model(self.model)
            object.__setattr__(self.model, "_checked", True)
        validate.instance("excitation", self.excitation, Excitation, "an Excitation(location, direction, amplitude)")
        if self.response is not None:
            validate.instance("response", self.response, Response, "a Response(location, direction)")
        for name, place in (("excitation", self.excitation), ("response", self._response)):
            validate.choice(f"{name} location", place.location, sorted(self.model.locations))
        self._check_friction()
        validate.fields(self, validate.whole, "engine_order", "damper_modes")
        validate.fields(self, validate.whole, "blade_modes", least=1, most=max(BLADE_MODES, self._modes_of("constrained")))
        validate.fields(self, validate.names, "rigid_modes", choices=RIGID_NAMES)
        switches = ("bias", "variable_normal_load", "separation", "constraints", "single_basis", "stability")
        validate.fields(self, validate.flag, *switches)
        _ = Effects.of(self)
        object.__setattr__(self, "harmonics", whole_harmonics(self.harmonics))
        check_evaluation(self.evaluation, self.harmonic_numbers[-1])
        object.__setattr__(self, "load_history", _check_history(self.load_history, "load_history"))
        if self.load_history[-1] != 1.0:
            raise SettingError(f"load_history: expected 1.0 at its end, found {self.load_history}")
        if self.damping_ratio is not None:
            validate.fields(self, validate.number, "damping_ratio", least=0.0, below=1.0)
        validate.fields(self, validate.number, "contact_stiffness_factor", above=0.0)
        _ = self._modal_bases  # the nodal diameters that the harmonics need
        _ = self._gap
        self._check_stiffness()

    def _modes_of(self, kind: str) -> int:
        """Modes that every body of a kind has at every nodal diameter; 0 without such a body."""
        bodies = [body for body in self.model.bodies.values() if body.kind == kind]
        return min((basis.n_modes for body in bodies for basis in body.bases.values()), default=0)

    def _check_stiffness(self) -> None:
        """Names and the user's own values; what a method needs of the model is found when it is used."""
        method = self.contact_stiffness
        if not (isinstance(method, str) and method == "model"):
            check_method(method)
        if not isinstance(method, ResidualModes) and (not isinstance(method, str) or method == "model"):
            _ = self._contact

    def _take_effects(self, effects: Effects) -> None:
        own = {f.name: f.default for f in fields(self)}
        for name, value in self._settings_for(effects).items():
            given = getattr(self, name)
            if given not in (own[name], value):
                raise SettingError(
                    f"{name}: expected only one of effects and {name}, found effects with {value!r} and {given!r}; "
                    "use with_effects to change the effects of a study"
                )
            object.__setattr__(self, name, value)
        object.__setattr__(self, "effects", None)

    def _settings_for(self, effects: Effects) -> dict[str, Any]:
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
        validate.choice("residual_traction", self.residual_traction, TRACTIONS)
        laws = set(self._law_by_interface().values())
        if self.residual_traction != "static" and LAW_COUPLED in laws:
            raise SettingError('residual_traction: expected "static" with coupled friction, found an end of the interval')
        if isinstance(self.evaluation, str) and LAW_COUPLED in laws:
            raise SettingError(
                'evaluation: expected Sampled(n_time) with friction_law="coupled", which has no closed form, found "exact"'
            )
        if self.major_frequency is not None:
            validate.fields(self, validate.number, "major_frequency", above=0.0, unit="Hz")
            if self.friction_axes != "major":
                raise SettingError(
                    f'major_frequency: expected friction_axes="major" with it, found friction_axes="{self.friction_axes}"'
                )
        _ = self._friction_by_interface()

    def _law_by_interface(self) -> dict[str, int]:
        """Law of each friction interface, before it is known which of them have friction."""
        given = self.friction_law
        names = [name for name, face in self.model.interfaces.items() if face.kind == "friction"]
        return {name: LAWS[given if isinstance(given, str) else given[name]] for name in names}

    def __str__(self) -> str:
        def place(at: Excitation | Response) -> str:
            return f"{at.location} {at.direction if isinstance(at.direction, str) else short(at.direction)}"

        mu = sorted({value for value in self._friction_by_interface().values() if value > 0.0})
        law = self.friction_law if isinstance(self.friction_law, str) else short(self.friction_law)
        method = self.contact_stiffness
        stiffness = method if isinstance(method, str) else short(method)
        factor = "" if self.contact_stiffness_factor == 1.0 else f" times {self.contact_stiffness_factor:g}"
        off = [f.name for f in fields(self) if f.name in _SWITCHES and not getattr(self, f.name)]
        gap = {} if self.gap is None else {name: f"{1e6 * np.max(g):.3g} um" for name, g in self.gap.items()}
        other = {
            "rigid_modes": " ".join(self.rigid_modes) if self.rigid_modes != RIGID_NAMES else None,
            "damping_ratio": self.damping_ratio,
            "contact_points": self.contact_points,
            "gap": ", ".join(f"{name} up to {g}" for name, g in gap.items()) or None,
            "load_history": self.load_history if self.load_history != (1.0,) else None,
            "friction_axes": self.friction_axes if self.friction_axes != "contact" else None,
            "residual_traction": self.residual_traction if self.residual_traction != "static" else None,
            "off": ", ".join(off) or None,
        }
        harmonics, friction = " ".join(map(str, self.harmonic_numbers)), ", ".join(f"{value:g}" for value in mu) or "none"
        lines = [
            f"study of model {self.model.hash}, engine order {self.engine_order}",
            f"  {self.excitation.amplitude:g} N at {place(self.excitation)}, response at {place(self._response)}",
            f"  harmonics {harmonics}, blade modes {self.blade_modes}, elastic damper modes {self.damper_modes}, "
            f"{self.coupling.n_points} contact points",
            f"  friction {friction} ({law}), contact stiffness {stiffness}{factor}, evaluation {self.evaluation}",
            *(f"  {name.replace('_', ' ')}: {value}" for name, value in other.items() if value is not None),
        ]
        return "\n".join(lines)

    def with_effects(self, effects: Effects) -> Study:
        """The same study with other effects; what does not depend on them is shared."""
        settings = self._settings_for(validate.instance("effects", effects, Effects))
        changed = {name for name, value in settings.items() if value != getattr(self, name)}
        if not changed <= {"harmonics", "bias", "stability"}:
            return replace(self, **settings)
        out = copy(self)
        for name, value in settings.items():
            object.__setattr__(out, name, value)
        for name in ("bases", "_modal_bases", "_response_rows"):
            out.__dict__.pop(name, None)
        check_evaluation(out.evaluation, out.harmonic_numbers[-1])
        _ = out.bases
        return out

    def without_highest_harmonic(self) -> Study:
        """The same study with one harmonic fewer.

        Raises
        ------
        SettingError
            If it has only one.
        """
        return self.with_effects(replace(Effects.of(self), harmonics=self.harmonic_numbers[:-1]))

    # ---- parts, made once ----

    @property
    def _response(self) -> Response:
        return self.response or Response(self.excitation.location, self.excitation.direction)

    def _interfaces(self) -> tuple[str, ...]:
        return tuple(
            name for name, face in self.model.interfaces.items() if self.constraints or face.kind == "friction"
        )

    def _friction_by_interface(self) -> dict[str, float]:
        out = {}
        given = self.friction_coefficient
        if isinstance(given, Mapping):
            validate.mapping("friction_coefficient", given, self.model.interfaces, "interfaces")
        for name in self._interfaces():
            if self.model.interfaces[name].kind == "constraint":
                out[name] = 0.0
            elif isinstance(given, Mapping):
                if name not in given:
                    raise SettingError(f"friction_coefficient: expected a value for interface '{name}'")
                out[name] = validate.number(f"friction_coefficient of '{name}'", given[name], least=0.0)
            else:
                out[name] = validate.number("friction_coefficient", given, least=0.0)
        return out

    @cached_property
    def coupling(self) -> Coupling:
        """The model with the retained modes and interfaces."""
        bodies = {
            name: standard_rigid_modes(self.model, body) if body.kind == "free" else body
            for name, body in self.model.bodies.items()
        }
        model = replace(self.model, bodies=bodies)
        if self.contact_points is not None:
            model = unite_contact_points(model, self.contact_points)
        available = [min(b.n_modes for b in body.bases.values()) for body in bodies.values() if body.kind == "constrained"]
        blade_modes = min([self.blade_modes, *available]) if self.blade_modes > 0 else self.blade_modes
        modes = retained_modes(model, blade_modes, self.damper_modes, self.rigid_modes)
        return Coupling(model, self._interfaces(), modes, int(self.engine_order), self.single_basis)

    @property
    def harmonic_numbers(self) -> tuple[int, ...]:
        """Harmonics besides the mean, ascending."""
        return harmonic_numbers(self.harmonics)

    @property
    def _active(self) -> set[int]:
        """Harmonics that have unknowns, the mean counted as 0."""
        return {*self.harmonic_numbers, *([0] if self.bias else [])}

    @cached_property
    def _static_basis(self) -> HarmonicBasis:
        """Modes of the static state."""
        return self._with_residual(self.coupling.basis(0), 0)

    def _with_residual(self, basis: HarmonicBasis, harmonic: int) -> HarmonicBasis:
        residual = self._contact.residual
        if residual is None:
            return basis
        return residual.basis(harmonic).stiffer(float(self.contact_stiffness_factor)).join(basis)

    @cached_property
    def _modal_bases(self) -> list[HarmonicBasis]:
        return [
            self.coupling.basis(l) if l in self._active else self.coupling.no_basis()
            for l in range(self.harmonic_numbers[-1] + 1)
        ]

    @cached_property
    def bases(self) -> list[HarmonicBasis]:
        """Modes of each harmonic, from the mean on; residual modes, if there are any, come last."""
        bases = [
            self._with_residual(b, l) if l in self._active else b for l, b in enumerate(self._modal_bases)
        ]
        if self.damping_ratio is not None:
            bases = [replace(b, damping_ratio=np.where(b.omega2 > 0.0, self.damping_ratio, 0.0)) for b in bases]
        return bases

    @cached_property
    def friction(self) -> NDArray:
        """(n_points,) friction coefficients."""
        mu = np.zeros(self.coupling.n_points)
        for name, value in self._friction_by_interface().items():
            mu[self.coupling.rows(name)] = value
        return mu

    @cached_property
    def _contact(self) -> Contact:
        method = self.contact_stiffness
        if isinstance(method, str) and method == "model":
            missing = [name for name in self.coupling.interfaces if name not in self.model.contact]
            if missing:
                raise SettingError(f'contact_stiffness="model": the model has none for interfaces {missing}')
            return Contact({name: self.coupling.model.contact[name] for name in self.coupling.interfaces})
        if self.contact_points is not None and not isinstance(method, (str, ResidualModes, PerArea)):
            # numbers are given for the points of the model
            whole = method if isinstance(method, Mapping) else dict.fromkeys(self.coupling.interfaces, method)
            method = {
                name: united_stiffness(self.model.interfaces[name], self.contact_points, np.asarray(k, float))
                for name, k in whole.items()
            }
        return contact_stiffness(self.coupling, method, self.friction)

    @cached_property
    def stiffness(self) -> dict[str, ContactStiffness]:
        """Contact stiffness of each interface."""
        factor = float(self.contact_stiffness_factor)
        if factor == 1.0:
            return self._contact.stiffness
        return {n: replace(c, stiffness=factor * c.stiffness) for n, c in self._contact.stiffness.items()}

    @property
    def stiffness_report(self) -> tuple[StiffnessReport, ...]:
        """Range of the contact stiffness and use of fallback rules, for each interface."""
        return tuple(report(name, contact) for name, contact in self.stiffness.items())

    def compare_stiffness(self, n_frequencies: int = 5) -> StiffnessComparison:
        """All methods of contact stiffness side by side: values, fallbacks, frequencies with the contact bonded."""
        validate.whole("n_frequencies", n_frequencies, least=1)
        names = tuple(n for n in self.coupling.interfaces if self.coupling.model.interfaces[n].kind == "friction")
        faces = {name: self.coupling.model.interfaces[name] for name in names}
        stiffness, frequencies = {}, {}
        for method in METHODS:
            study = replace(self, contact_stiffness=method)
            stiffness[method] = {name: study.stiffness[name] for name in names}
            bonded = study._k * study._friction_points[:, None]
            frequencies[method] = study.system(0.0).linear_modes(bonded)[0][:n_frequencies] / (2.0 * np.pi)
        return StiffnessComparison(
            names,
            {name: face.points for name, face in faces.items()},
            {name: face.frame for name, face in faces.items()},
            {name: face.area for name, face in faces.items()},
            stiffness,
            literal_negative(self.coupling, self.friction),
            frequencies,
        )

    @cached_property
    def _k(self) -> NDArray:
        return np.concatenate([self.stiffness[name].stiffness for name in self.coupling.interfaces])

    @cached_property
    def _gap(self) -> NDArray:
        given = {} if self.gap is None else validate.mapping("gap", self.gap, self.coupling.interfaces, "interfaces")
        parts = []
        for name in self.coupling.interfaces:
            face = self.coupling.model.interfaces[name]
            gap = validate.numbers(f"gap of '{name}'", given[name]) if name in given else face.gap
            whole = self.model.interfaces[name]
            if self.contact_points is not None and gap.shape == (whole.n_points,):  # given for the points of the model
                gap = united_gap(whole, self.contact_points, gap)
            if gap.shape != (face.n_points,):
                raise validate.unfit(f"gap of '{name}'", f"{face.n_points} finite numbers", gap)
            if self._law_by_interface().get(name) == LAW_BONDED and (gap > 0.0).any():
                raise SettingError(
                    f"gap of '{name}': expected none under friction_law=\"bonded\", which holds the surfaces together in "
                    f"both senses, found {gap.max():.3g} m at the widest of {(gap > 0.0).sum()} points"
                )
            parts.append(gap)
        return np.concatenate(parts)

    @cached_property
    def _law(self) -> NDArray:
        """(n_points,) law of each contact point."""
        law = np.full(self.coupling.n_points, LAW_NORMAL)
        for name, value in self._law_by_interface().items():
            rows = self.coupling.rows(name)
            law[rows] = value if value == LAW_BONDED else np.where(self.friction[rows] > 0.0, value, LAW_NORMAL)
        return law

    @cached_property
    def _bonded(self) -> NDArray:
        """(n_points,) bool: points of linear springs."""
        return self._law == LAW_BONDED

    @cached_property
    def _kt(self) -> NDArray:
        return self._k[:, :2] * (self._law != LAW_NORMAL)[:, None]

    @cached_property
    def _friction_points(self) -> NDArray:
        """(n_points,) bool: points of friction interfaces, whatever their coefficient."""
        faces = [self.coupling.model.interfaces[name] for name in self.coupling.interfaces]
        return np.concatenate([np.full(face.n_points, face.kind == "friction") for face in faces])

    @cached_property
    def _load(self) -> tuple[NDArray, NDArray]:
        force, shift = self.coupling.load()
        return np.pad(force, (0, self._static_basis.n_modes - len(force))), shift

    def _location_modes(self, location: str, harmonic: int) -> NDArray:
        """(3, n_modes) motion of a location by the coordinates of one harmonic; residual modes do not move it."""
        modes = self.coupling.location_modes(location, harmonic)
        return np.pad(modes, ((0, 0), (0, self.bases[harmonic].n_modes - modes.shape[1])))

    @cached_property
    def _force_rows(self) -> NDArray:
        """(n_modes,) complex modal excitation at harmonic 1."""
        modes = self._location_modes(self.excitation.location, 1)
        force = self.excitation.amplitude * np.exp(1j * self.excitation.phase)
        return (direction_vector(self.excitation.direction, "excitation direction") @ modes).conj() * force

    @cached_property
    def _response_rows(self) -> list[NDArray]:
        direction = direction_vector(self._response.direction, "response direction")
        rows = [
            direction @ self._location_modes(self._response.location, l) if l in self._active else np.zeros(0)
            for l in range(self.harmonic_numbers[-1] + 1)
        ]
        rows[0] = rows[0].real
        return rows

    # ---- static ----

    @one_thread
    def static(self, preload: float, history: Sequence[float] | None = None) -> PreloadState:
        """Quasi-static contact analysis (paper, section 3.1) under a load on the damper.

        Parameters
        ----------
        preload : float, N
        history : sequence of float, optional
            Load factors, up and down, through which the load passes from zero; ``load_history`` of the study by default.
            The state is that at the last one.

        Returns
        -------
        PreloadState
        """
        preload = self._check_preload(preload)
        factors = self.load_history if history is None else _check_history(history, "history")
        key = (preload, *factors)
        if key not in self._states:
            start = time.perf_counter()
            force, shift = self._load
            system = StaticSystem(
                self._static_basis.omega2,
                self._static_basis.G.real,
                self._kt,
                self._k[:, 2],
                self.friction,
                -self._k[:, 2] * self._gap,
                force,
                shift,
                np.zeros_like(force),
                self._bonded,
            )
            state = None
            if len(factors) == 1:
                # always from one and the same load, so that results do not depend on what was asked before
                unit = self._states.get((1.0, 1.0)) or static_state(system, 1.0)
                self._states[(1.0, 1.0)] = unit
                state = scaled_state(system, unit, factors[0] * preload)
                if state is not None:
                    self._states[key] = replace(state, cost=Cost(seconds=time.perf_counter() - start))
                    return self._states[key]
            for factor in factors:
                state = static_state(system, factor * preload, start=state)
                if not state.converged:
                    break
            assert state is not None
            self._states[key] = replace(state, cost=Cost(time.perf_counter() - start, iterations=state.iterations))
        return self._states[key]

    def _at_rest(self, preload: float, history: Sequence[float] | None = None) -> PreloadState:
        """The static state that a result is built on, an error where there is none."""
        state = self.static(preload, history)
        if not state.converged:
            raise StaticError(f"expected a static state under {preload:g} N, found none: {state.note}")
        return state

    def contact_map(self, preload: float, history: Sequence[float] | None = None) -> ContactMap:
        """Pressure, gap and state over the faces in the static state; arguments as for :meth:`static`."""
        factors = self.load_history if history is None else _check_history(history, "history")
        return ContactMap.make(self.coupling, self._at_rest(preload, factors), self.friction, factors)

    def wedge_friction(self, preload: float = 1.0) -> WedgeFriction:
        """Interval of normal forces that statics and friction leave possible; names a self-locking wedge."""
        return wedge_friction(self.coupling, self.friction, self._check_preload(preload))

    @cached_property
    def self_locking(self) -> tuple[str, ...]:
        """Bodies that friction alone holds between their faces, so that their static normal load is not unique.

        Those for which :meth:`wedge_friction` finds no upper bound of the normal force.
        """
        if not any(body.kind == "free" and body.load is not None for body in self.model.bodies.values()):
            return ()
        try:
            found = self.wedge_friction()
        except SettingError:  # nothing holds the load
            return ()
        faces = [name for name, high in zip(found.interfaces, found.highest) if np.isinf(high)]
        holders = {self.coupling.model.interfaces[name].body_a for name in faces}
        springs = {name for name, law in self._law_by_interface().items() if law == LAW_BONDED}
        holders -= {self.coupling.model.interfaces[name].body_a for name in springs}
        return tuple(body.name for body in self.model.bodies.values() if body.load is not None and body.name in holders)

    def _check_preload(self, preload: float) -> float:
        preload = validate.number("preload", preload, least=0.0, unit="N")
        if preload > 0.0 and not np.any(self._load[0]):
            raise SettingError(f"preload: expected 0, since {self._why_no_load}, found {preload:g} N")
        return preload

    @property
    def _why_no_load(self) -> str:
        loaded = [n for n, b in self.model.bodies.items() if b.load is not None and np.any(b.load.generalised)]
        if not loaded:
            return "no body of the model carries a load"
        return f"the study leaves out the motions of {loaded} along the load (rigid_modes={self.rigid_modes})"

    # ---- harmonic balance ----

    @property
    def n_unknowns(self) -> int:
        """Of the harmonic balance."""
        n = [len(b.omega2) for b in self.bases]
        return n[0] + 2 * sum(n[1:])

    def system(self, preload: float) -> HarmonicSystem:
        """Harmonic balance equations at one preload (N).

        Raises
        ------
        StaticError
            If no static state was found under it.
        """
        state = self._at_rest(preload)
        load, shift = self._load
        e = self._force_rows
        n_mode = [len(b.omega2) for b in self.bases]
        force = np.zeros(n_mode[0] + 2 * sum(n_mode[1:]))
        force[: n_mode[0]] = (state.load * load)[: n_mode[0]]
        n = n_mode[1]
        force[n_mode[0] : n_mode[0] + n] = e.real
        force[n_mode[0] + n : n_mode[0] + 2 * n] = -e.imag
        shift = state.load * shift
        if not self.bias:
            shift = shift + self._static_basis.G.real @ state.q
        points = PointArrays(
            kt=self._kt,
            kn=self._k[:, 2],
            mu=self.friction,
            n0=-self._k[:, 2] * self._gap,
            slider=np.where(self._bonded[:, None], 0.0, state.slider),
            law=self._law.copy(),
            shift=shift,
        )
        bases = self.bases
        if self.friction_axes == "major":
            bases, points = turned(bases, points, self.major_directions(preload))
        if self.residual_traction != "static":
            points = replace(points, slider=self._extreme_sliders(points, preload))
        if not self.separation or not self.variable_normal_load:
            bases, points = without_separation(
                bases, points, state, self._friction_points, constant_load=not self.variable_normal_load
            )
        vibration = float(np.abs(self._force_rows).max())
        pressed = np.einsum("pdm,pd->m", self._static_basis.G.real, state.force)
        mean = max(float(np.abs(state.load * load).max()), float(np.abs(pressed).max()), vibration)
        scale = (mean or 1.0, vibration or mean or 1.0)
        system = HarmonicSystem(bases, points, force, self._response_rows, self.evaluation, scale)
        system.spring_bases = self.bases  # linear springs are those of the points of the coupling
        return system

    def _extreme_sliders(self, points: PointArrays, preload: float) -> NDArray:
        """(n_points, 2) sliders, infinite where an end of their interval is asked for."""
        along = np.zeros((self.coupling.n_points, 2))
        for name in self.coupling.interfaces:
            face = self.coupling.model.interfaces[name]
            for sense, body in ((-1.0, face.body_a), (1.0, face.body_b)):
                load = self.coupling.model.bodies[body].load
                if load is not None:
                    along[self.coupling.rows(name)] = sense * face.frame[:, :2] @ load.direction
        if self.friction_axes == "major":
            angle = self.major_directions(preload)
            c, s = np.cos(angle), np.sin(angle)
            along = np.column_stack([c * along[:, 0] + s * along[:, 1], c * along[:, 1] - s * along[:, 0]])
        # a traction T acts on body a along +t and on body b along -t; the slider at the upper end gives the lowest T
        end = -np.inf if self.residual_traction == "lower" else np.inf
        asked = (np.abs(along) > 1e-6) & (points.law[:, None] == LAW_SEPARABLE)
        return np.where(asked, np.copysign(end, along * np.sign(end)), points.slider)

    def _stuck_springs(self, state: PreloadState) -> NDArray:
        """(n_points, 3) linear springs: points that the preload has closed do not slip."""
        closed = ~(state.status == OPEN).any(axis=1)
        springs = np.concatenate([self._kt, self._k[:, 2:]], axis=1)
        return springs * closed[:, None]

    def major_directions(self, preload: float) -> NDArray:
        """Angle of the major direction of the stuck motion from the first contact axis, at every contact point.

        Parameters
        ----------
        preload : float, N
            Decides which points are closed.

        Returns
        -------
        (n_points,) float, rad
        """
        if preload in self._angles:
            return self._angles[preload]
        springs = self._stuck_springs(self._at_rest(preload))
        plain = copy(self)  # shares all that was made
        object.__setattr__(plain, "friction_axes", "contact")
        system = plain.system(preload)
        if self.major_frequency is not None:
            omega = 2.0 * np.pi * self.major_frequency
        else:
            poles = [w for w in system.linear_modes(springs)[0] if w > 0.0]
            heights = [abs(system.linear_response(w, springs) @ self._response_rows[1]) for w in poles]
            omega = poles[int(np.argmax(heights))]
        self._angles[preload] = major_angles(self.bases[1].G[:, :2] @ system.linear_response(omega, springs))
        return self._angles[preload]

    @one_thread
    def compare_laws(
        self,
        preload: float,
        frequency: tuple[float, float],
        laws: Sequence[str] = ("separable", "major", "coupled"),
        *,
        options: ContinuationOptions | None = None,
    ) -> LawComparison:
        """Tracking curves under several friction laws, everything else the same.

        Parameters
        ----------
        preload : float, N
        frequency : (low, high), Hz
        laws : sequence of str
            Out of "separable", "major" (separable along major directions), "coupled", "constant_normal_load", "bonded".
            The coupled law is sampled, with 128 samples unless ``evaluation`` says otherwise.
        options : ContinuationOptions

        Returns
        -------
        LawComparison
            Prints the differences of the peaks to the last law.
        """
        preload, frequency = self._check_preload(preload), validate.interval("frequency", frequency)
        curves = []
        for law in known_laws(laws):
            settings: dict[str, Any] = dict(CHOICES[law])
            if law != "major":
                settings["major_frequency"] = None
            if law == "coupled":
                settings["residual_traction"] = "static"
                if self.evaluation == "exact":
                    settings["evaluation"] = Sampled(max(128, 8 * self.harmonic_numbers[-1] + 8))
            curves.append(uninterrupted(replace(self, **settings).track(preload, frequency, options=options)))
        return LawComparison(tuple(laws), tuple(curves))

    @one_thread
    def find_start(
        self, preload: float, omega: float, options: ContinuationOptions, meter: CostMeter, aids: Aids = NO_AIDS
    ) -> tuple[NDArray | None, list[str]]:
        """A solution at one frequency (rad/s); see :func:`bdamper.continuation.start.first_point`.

        Returns
        -------
        (n_unknowns + 1,) float or None, and what was tried
        """
        state = self.static(preload)
        if not state.converged:
            return None, [f"static state: {state.note}"]
        system = self.system(preload)
        meter.watch(system)
        found, log, last = first_point(system, state, self._stuck_springs(state), omega, options, meter, aids)
        why = why_no_solution(system, self.coupling.model, self.bases[0].coordinates, last) if found is None else ""
        return found, [*log, why] if why else log

    # ---- curves ----

    @one_thread
    def track(
        self,
        preload: float,
        frequency: tuple[float, float],
        *,
        from_high: bool = False,
        options: ContinuationOptions | None = None,
        progress: bool = False,
        search_branches: bool | Sequence[float] = False,
        stability: bool = False,
        effects: Literal["all", "auto"] = "all",
        tolerance: float | None = None,
    ) -> Curve:
        """Tracking curve: the response over a frequency interval at one preload, with all branches on the way.

        Parameters
        ----------
        preload : float, N
            Radial load on the damper.
        frequency : (low, high), Hz
        from_high : bool
            Set off from the upper end.
        options : ContinuationOptions
        progress : bool
            Show a progress bar.
        search_branches : bool or sequence of float
            Look for branches apart from the one that is followed, with solutions at other preloads as starts: ratios to
            the preload, 0.9 and 1.2 by default.
        stability : bool
            Judge the stability of every point (:meth:`with_stability`), also if the study's ``stability`` is off.
        effects : {"all", "auto"}
            "auto": harmonics of the study are on only where they matter; see
            :func:`bdamper.effects.adaptive_curves.adaptive_curve`.
        tolerance : float, optional
            Relative.  With "auto": at every point, by leaving harmonics of the study out (0.01 by default).  With "all": at
            the highest peak, by choosing harmonics and evaluation whatever the study has
            (:func:`bdamper.accuracy.tolerance.track_to_tolerance`); the notes of the curve say what was chosen and why.

        Returns
        -------
        Curve
            ``status`` is "complete" if its branches span the interval; otherwise ``reason`` says why not, and the points
            found so far are there.  A branch that does not reach the other end is complemented by one from there.
        """
        preload, frequency = self._check_preload(preload), validate.interval("frequency", frequency)
        for name, value in (("from_high", from_high), ("progress", progress), ("stability", stability)):
            validate.flag(name, value)
        ratios: tuple[float, ...] = (0.9, 1.2) if search_branches is True else ()
        if not isinstance(search_branches, bool):
            ratios = tuple(validate.numbers("search_branches, ratios to the preload", search_branches, above=0.0).tolist())
        if options is not None:
            validate.instance("options", options, ContinuationOptions)
        if tolerance is not None:
            tolerance = validate.number("tolerance", tolerance, above=0.0, below=1.0)
        validate.choice("effects", effects, ("all", "auto"))
        if effects == "auto" and (from_high or progress or search_branches is not False):
            raise SettingError('effects: expected "all" with from_high, progress or search_branches, found "auto"')
        if self.static(preload).converged and (effects == "auto" or tolerance is not None):
            from bdamper.accuracy.tolerance import track_to_tolerance
            from bdamper.effects.adaptive_curves import adaptive_curve

            try:
                if effects == "auto":
                    judged = self.with_effects(replace(Effects.of(self), stability=True)) if stability else self
                    within = 0.01 if tolerance is None else tolerance
                    return adaptive_curve(judged, preload, frequency, tolerance=within, options=options)
                assert tolerance is not None
                return track_to_tolerance(
                    self, preload, frequency, tolerance, options=options, from_high=from_high, progress=progress,
                    search_branches=search_branches, stability=stability,
                )  # fmt: skip
            except InterruptedCurve as stop:
                return stop.curve
        curve = track_curve(
            self, preload, frequency, from_high=from_high, options=options or ContinuationOptions(), progress=progress,
            ratios=ratios,
        )  # fmt: skip
        if len(curve) and curve.status != "interrupted" and (stability or self.stability):
            return self.with_stability(curve)
        return curve

    @one_thread
    def with_stability(
        self,
        curve: Curve,
        nodal_diameters: Sequence[int] = (),
        oscillating: bool = False,
        every_point: bool = False,
    ) -> Curve:
        """The same tracking curve with the stability of every point; see :mod:`bdamper.stability.floquet` for what it
        covers.

        Parameters
        ----------
        curve : Curve
            Tracked by this study.
        nodal_diameters : sequence of int
            Further disturbances of a travelling wave: by how many nodal diameters they differ from it.  The model must have
            the modes of these nodal diameters; those of their harmonics are used where it has them.
        oscillating : bool
            Whether disturbances of a travelling wave that oscillate while they grow are judged as well, which takes some
            times as long as the curve; implied by ``nodal_diameters``.  Without cyclic symmetry they always are if all
            harmonics from the mean on are there, up to the highest (neither ``bias=False`` nor ``harmonics=(1, 3)``), with
            the same modes and without residual modes: all disturbances are judged then.  The note of the curve says which
            were.
        every_point : bool
            Count oscillating growth at every point, instead of only where :mod:`bdamper.stability.wave` asks for it.
        """
        if (study := self.of(curve)) is not self:
            return study.with_stability(curve, nodal_diameters, oscillating, every_point)
        self._check_curve(curve)
        oscillating, every_point = validate.flag("oscillating", oscillating), validate.flag("every_point", every_point)
        others = {int(d): self._bases_beside(int(d)) for d in validate.wholes("nodal_diameters", nodal_diameters)}
        omega = 2.0 * np.pi * curve.frequency
        result = stability_of_points(
            self.system(curve.preload),
            curve.unknowns,
            omega,
            others,
            oscillating or bool(others),
            None if every_point else curve.branch,
        )
        note = f"{result.note}; {result.seconds:.2f} s, {curve.cost.seconds:.2f} s for the curve"
        return replace(curve, stable=result.stable, stability_note=note)

    def _bases_beside(self, d: int, highest: int | None = None) -> dict[int, HarmonicBasis]:
        """Modes of the nodal diameters ``d + l EO`` that the model has, by l up to the highest harmonic."""
        if self._contact.residual is not None or self.friction_axes != "contact" or self.single_basis:
            raise SettingError(
                "nodal_diameters: expected no residual modes, friction axes of the contact and bases of each nodal "
                "diameter, found other settings"
            )
        if not (self.separation and self.variable_normal_load):
            raise SettingError("nodal_diameters: expected separation and a variable normal load, found one of them off")
        waves = replace(self.coupling, engine_order=1)
        have = set.intersection(*(set(b.bases) for b in self.model.bodies.values() if b.kind == "constrained"))
        out = {}
        highest = self.harmonic_numbers[-1] if highest is None else highest
        for l in range(-highest, highest + 1):
            order = (d + l * int(self.engine_order)) % self.model.n_blades
            if self.model.folded_nodal_diameter(order)[0] in have:
                basis = waves.basis(order)
                if self.damping_ratio is not None:
                    basis = replace(basis, damping_ratio=np.where(basis.omega2 > 0.0, self.damping_ratio, 0.0))
                out[l] = basis
        if 0 not in out:
            raise SettingError(f"nodal_diameters: expected those whose modes the model has, {sorted(have)}, found {d}")
        return out

    @one_thread
    def verify(
        self,
        curve: Curve,
        index: int | None = None,
        *,
        periods: int = 100,
        steps_per_period: int | None = None,
        progress: bool = False,
    ) -> Verification:
        """March in time from a point of a tracking curve and compare where the motion settles.

        All sectors take part, each with its own contacts; no Fourier series is cut off, no travelling wave assumed
        (:mod:`bdamper.stability.time_integration`).  A period takes some ten thousand steps: seconds on a reference bladed
        disk, so that the default of 100 takes minutes.

        Parameters
        ----------
        curve : Curve
            Tracked by this study.
        index : int, optional
            Of the point; the largest response by default.
        periods : int
            Periods of the excitation to march.
        steps_per_period : int, optional
            By default what the stiffest contact asks for.
        progress : bool
            Show a progress bar.
        """
        if (study := self.of(curve)) is not self:
            return study.verify(curve, index, periods=periods, steps_per_period=steps_per_period)
        self._check_curve(curve)
        periods = validate.whole("periods", periods, least=1)
        if steps_per_period is not None:
            steps_per_period = validate.whole("steps_per_period", steps_per_period, least=1)
        i = curve.peak.index if index is None else validate.whole("index of a point", index, -len(curve), len(curve) - 1)
        return verify_solution(
            self.system(curve.preload),
            curve.unknowns[i],
            2.0 * np.pi * float(curve.frequency[i]),
            self.model.n_blades,
            int(self.engine_order),
            periods=periods,
            steps_per_period=steps_per_period,
            progress=progress,
        )

    @one_thread
    def settle(
        self,
        start: Curve | SettledResponse,
        frequency: float | None = None,
        *,
        periods: int = 200,
        steps_per_period: int | None = None,
        progress: bool = False,
    ) -> SettledResponse:
        """March in time and say what the response comes to, period by period.

        For frequencies at which no solution was found, or none that is stable: a damper that rattles in its seat may have
        no periodic response at all, and then it is a mean amplitude and a range that count.  All sectors take part, each
        with its own contacts (:mod:`bdamper.stability.steady_state`).

        Parameters
        ----------
        start : Curve or SettledResponse
            A tracking curve of this study, from whose solution nearest in frequency the march sets off; or what was found
            before, to go on with, at the same or another frequency.
        frequency : float, Hz, optional
            By default the middle of the widest part of the curve without solutions; or that of the earlier response.
        periods : int
            Of the excitation.  A transient of a mode with the damping ratio ``zeta`` takes about ``1/(2 zeta)`` of them.
        steps_per_period : int, optional
            By default what the stiffest contact asks for.
        progress : bool
            Show a progress bar.

        Returns
        -------
        SettledResponse
            With what is computed, if Ctrl-C ends it after the first few periods.

        Raises
        ------
        SettingError
            If the curve has a solution at every frequency and none is given, if the settings describe something else than a
            structure in time, or a number does not fit.
        """
        validate.instance("start", start, (Curve, SettledResponse))
        if isinstance(start, Curve) and (study := self.of(start)) is not self:
            return study.settle(
                start, frequency, periods=periods, steps_per_period=steps_per_period, progress=progress
            )
        periods = validate.whole("periods", periods, least=FEWEST)
        if steps_per_period is not None:
            steps_per_period = validate.whole("steps_per_period", steps_per_period, least=1)
        if frequency is not None:
            frequency = validate.number("frequency", frequency, above=0.0, unit="Hz")
        if isinstance(start, Curve):
            self._check_curve(start)
            if not len(start):
                raise validate.unfit("start", "a curve with points", f"one without ({start.status}: {start.reason})")
            if frequency is None:
                if start.gap is None:
                    raise validate.unfit("frequency", "one in Hz, as the curve has a solution at each", None)
                frequency = float(np.mean(start.gap))
            state: NDArray | Motion = start.unknowns[int(np.abs(start.frequency - frequency).argmin())]
        else:
            if start.model_hash != self.model.hash:
                raise validate.unfit("start", "a response of this study", "one of another model")
            frequency = start.frequency if frequency is None else frequency
            state = start.motion
        return settle(
            self.system(start.preload),
            2.0 * np.pi * frequency,
            self.model.n_blades,
            int(self.engine_order),
            state,
            preload=start.preload,
            periods=periods,
            steps_per_period=steps_per_period,
            progress=progress,
            model_hash=self.model.hash,
        )

    def of(self, curve: Curve) -> Study:
        """This study with the harmonics and the evaluation that :meth:`track` chose for a curve to a tolerance.

        For any other curve it is the study itself.  The study's own functions find it by themselves; those that take
        ``curve.unknowns`` need it: ``contact_status(study.of(curve), curve.unknowns[i], curve.preload)``.
        """
        validate.instance("curve", curve, Curve, "a tracking curve of this study")
        if "chosen" not in curve.settings:
            return self
        evaluation = curve.settings["evaluation"]
        harmonics = tuple(curve.settings["harmonics"])
        chosen = evaluation if isinstance(evaluation, str) else Sampled(**evaluation)
        if harmonics == self.harmonic_numbers and chosen == self.evaluation:
            return self
        study = replace(self, harmonics=harmonics, evaluation=chosen)
        study._states.update(self._states)
        return study

    def _check_curve(self, curve: Curve) -> None:
        if curve.kind != "tracking" or curve.model_hash != self.model.hash:
            raise SettingError("curve: expected a tracking curve of this model, found another")
        system = self.system(curve.preload)
        n = system.n_unknowns
        if curve.unknowns.shape[1] != n:
            raise SettingError(f"curve: expected one of this study with {n} unknowns, found {curve.unknowns.shape[1]}")
        if not len(curve) or "adaptive" in curve.settings:  # such a curve solves the equations to its own tolerance
            return
        i = curve.peak.index
        r, _, _ = system.evaluate(curve.unknowns[i], 2.0 * np.pi * float(curve.frequency[i]))
        error = float(np.abs(r * system.row_scale).max())
        if error > max(1e-6, 100.0 * float(curve.residual[i])):
            raise SettingError(
                f"curve: expected one of this study, found one with other settings (residual {error:.2g} at its peak)"
            )

    # ---- accuracy ----

    @one_thread
    def estimate_errors(
        self, result: Curve | Peak | AdaptivePeak, preload: float | None = None, *, sources: Sequence[str] | None = None
    ) -> ErrorEstimates:
        """Estimated errors of a peak by source; see :func:`bdamper.accuracy.estimate.estimate_errors`.

        They are those of the settings that the result was computed with: the harmonics that were chosen for a curve to a
        tolerance, or those that were on in an adaptive peak.
        """
        from bdamper.accuracy.estimate import SOURCES, estimate_errors
        from bdamper.effects.adaptive import AdaptivePeak, plain_peak

        study: Study = self
        if isinstance(result, AdaptivePeak):
            study, result = plain_peak(self, result)
        elif isinstance(result, Curve):
            study = self.of(result)
        return estimate_errors(study, result, preload, sources=SOURCES if sources is None else sources)

    @one_thread
    def with_errors(self, curve: Curve, *, sources: Sequence[str] | None = None) -> Curve:
        """The same tracking curve with estimated errors of its highest peak, which it prints and saves."""
        validate.instance("curve", curve, Curve)
        return replace(curve, error_estimates=self.estimate_errors(curve, sources=sources))

    # ---- peaks ----

    @overload
    def peak(
        self,
        preload: float,
        frequency: tuple[float, float] | None = ...,
        *,
        mode: int = ...,
        options: PeakOptions | None = ...,
        effects: Literal["all"] = ...,
        tolerance: None = ...,
    ) -> Peak: ...

    @overload
    def peak(
        self,
        preload: float,
        frequency: tuple[float, float] | None = ...,
        *,
        mode: int = ...,
        options: PeakOptions | None = ...,
        effects: Literal["auto"],
        tolerance: float | None = ...,
    ) -> AdaptivePeak: ...

    @one_thread
    def peak(
        self,
        preload: float,
        frequency: tuple[float, float] | None = None,
        *,
        mode: int = 1,
        options: PeakOptions | None = None,
        effects: Literal["all", "auto"] = "all",
        tolerance: float | None = None,
    ) -> Peak | AdaptivePeak:
        """The highest resonance peak at one preload; see :func:`bdamper.peaks.optimal.highest_peak`.

        With ``effects="auto"`` only those harmonics of the study are on that change it by more than the relative
        ``tolerance`` (0.01 by default); see :func:`bdamper.effects.adaptive.adaptive_peak`.
        """
        auto = validate.choice("effects", effects, ("all", "auto")) == "auto"
        if not auto and tolerance is not None:
            raise SettingError(
                'tolerance: expected effects="auto" with it, found "all"; to a tolerance whatever harmonics the study has, '
                "track a curve (Study.track)"
            )
        if auto:
            from bdamper.peaks.optimal import peak_interval

            if options is not None:
                raise SettingError('effects: expected "all" with options, found "auto"')
            within = 0.01 if tolerance is None else tolerance
            return self.adaptive_peak(preload, peak_interval(self, frequency, mode), tolerance=within)
        from bdamper.peaks.optimal import highest_peak

        return highest_peak(self, preload, frequency, mode=mode, options=options)

    @one_thread
    def peak_sensitivities(
        self, peak: Peak | AdaptivePeak, parameters: Sequence[str] | None = None
    ) -> dict[str, PeakSensitivity]:
        """Derivatives of a peak with respect to settings; see :func:`bdamper.peaks.optimal.peak_sensitivities`.

        Those of an adaptive peak are taken with the harmonics that were on in it.
        """
        from bdamper.effects.adaptive import AdaptivePeak, plain_peak
        from bdamper.peaks.optimal import PARAMETERS, peak_sensitivities

        study: Study = self
        if isinstance(peak, AdaptivePeak):
            study, peak = plain_peak(self, peak)
        return peak_sensitivities(study, peak, PARAMETERS if parameters is None else parameters)

    @one_thread
    def optimal_curve(
        self,
        preload: tuple[float, float] | Sequence[float] | NDArray = (10.0, 25e3),
        n: int = 50,
        *,
        frequency: tuple[float, float] | None = None,
        mode: int = 1,
        checks: int = 0,
        options: PeakOptions | None = None,
    ) -> OptimalCurve:
        """Resonance amplitude and frequency over the preload; see :func:`bdamper.peaks.optimal.optimal_curve`."""
        from bdamper.peaks.optimal import optimal_curve

        return optimal_curve(self, preload, n, frequency=frequency, mode=mode, checks=checks, options=options)

    @one_thread
    def optimum(
        self,
        preload: tuple[float, float] | Sequence[float] | NDArray = (10.0, 25e3),
        n: int = 24,
        *,
        frequency: tuple[float, float] | None = None,
        mode: int = 1,
        options: PeakOptions | None = None,
    ) -> OptimumPoint:
        """The preload of least resonance amplitude; see :func:`bdamper.peaks.optimal.optimal_curve`."""
        return self.optimal_curve(preload, n, frequency=frequency, mode=mode, options=options).optimum

    # ---- effects ----

    @one_thread
    def advise(
        self,
        preload: float,
        frequency: tuple[float, float],
        *,
        against: Effects | None = None,
        tolerance: float = 0.01,
    ) -> Advice:
        """Which of the effects that are off would change the highest peak; see :func:`bdamper.effects.advice.advise`."""
        from bdamper.effects.advice import advise

        preload, frequency = self._check_preload(preload), validate.interval("frequency", frequency)
        tolerance = validate.number("tolerance", tolerance, above=0.0, below=1.0)
        if against is not None:
            validate.instance("against", against, Effects)
        return advise(self, preload, frequency, against=against, tolerance=tolerance)

    @one_thread
    def adaptive_peak(
        self, preload: float, frequency: tuple[float, float], *, tolerance: float = 0.01
    ) -> AdaptivePeak:
        """The highest peak with no more harmonics than it calls for; see :func:`bdamper.effects.adaptive.adaptive_peak`."""
        from bdamper.effects.adaptive import adaptive_peak

        preload, frequency = self._check_preload(preload), validate.interval("frequency", frequency)
        tolerance = validate.number("tolerance", tolerance, above=0.0, below=1.0)
        return adaptive_peak(self, preload, frequency, tolerance=tolerance)

    # ---- linear limits ----

    @one_thread
    def free(self, frequency: tuple[float, float]) -> Curve:
        """Response without any contact: the limit of no preload.

        Parameters
        ----------
        frequency : (low, high), Hz
        """
        return self._linear("free", 0.0, frequency, None)

    @one_thread
    def stuck(self, frequency: tuple[float, float], preload: float = 1.0) -> Curve:
        """Response with every point stuck that the preload closes: the limit of high preload.

        Parameters
        ----------
        frequency : (low, high), Hz
        preload : float, N
            Decides which points are closed; without gaps its size does not matter.
        """
        if not np.any(self._load[0]):
            preload = 0.0
        return self._linear("stuck", preload, frequency, self._stuck_springs(self._at_rest(preload)))

    def _linear(self, kind: str, preload: float, frequency: tuple[float, float], springs: NDArray | None) -> Curve:
        low, high = (2.0 * np.pi * f for f in validate.interval("frequency", frequency))
        system, settings = self.system(preload), self._settings(None)
        return linear_curve(system, kind, (low, high), springs, preload, settings, self.model.hash)

    def _settings(self, options: ContinuationOptions | None) -> dict[str, Any]:
        given = self.contact_stiffness
        out: dict[str, Any] = {
            "engine_order": int(self.engine_order),
            "harmonics": list(self.harmonic_numbers),
            "bias": self.bias,
            "variable_normal_load": self.variable_normal_load,
            "separation": self.separation,
            "contact_points": self.contact_points,
            "stability": self.stability,
            "friction_coefficient": self._friction_by_interface(),
            "excitation": asdict(self.excitation),
            "response": asdict(self._response),
            "contact_stiffness": _stiffness_setting(given),
            "contact_stiffness_factor": self.contact_stiffness_factor,
            "load_history": list(self.load_history),
            "gap": self.gap,
            "blade_modes": int(self.blade_modes),
            "damper_modes": int(self.damper_modes),
            "rigid_modes": list(self.rigid_modes),
            "constraints": self.constraints,
            "single_basis": self.single_basis,
            "damping_ratio": self.damping_ratio,
            "friction_law": self.friction_law if isinstance(self.friction_law, str) else dict(self.friction_law),
            "friction_axes": self.friction_axes,
            "major_frequency": self.major_frequency,
            "residual_traction": self.residual_traction,
            "evaluation": self.evaluation if isinstance(self.evaluation, str) else asdict(self.evaluation),
        }
        if options is not None:
            out["continuation"] = asdict(options)
        settings: dict[str, Any] = _plain(out)
        return settings


def _stiffness_setting(given: Any) -> Any:
    if isinstance(given, ResidualModes):
        return {"residual_modes": asdict(given)}
    if isinstance(given, PerArea):
        return {"per_area": given.stiffness}
    return given if isinstance(given, str) else {"values": given}


def _plain(value: Any) -> Any:
    """Settings as they stand in a file: numbers, texts, lists and mappings of these."""
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (np.ndarray, np.generic)):
        return value.tolist()
    return [_plain(item) for item in value] if isinstance(value, (list, tuple)) else value


def _check_history(history: Sequence[float], name: str) -> tuple[float, ...]:
    return tuple(validate.numbers(f"{name}, load factors", history, least=0.0).tolist())
