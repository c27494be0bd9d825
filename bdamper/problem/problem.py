"""A problem: one model under one set of settings, and the equations that follow from them.

Everything is made once and kept: the bases of the harmonics, contact stiffness, static states under the preload.  The
equations of the harmonic balance at one preload are ``system(preload)``.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import InitVar, dataclass, field, replace
from typing import Any, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from bdamper.contact.friction_axes import major_angles, turned
from bdamper.contact.laws import LAW_BONDED, LAW_CUBIC, LAW_NORMAL, Sampled
from bdamper.contact.no_separation import without_separation
from bdamper.contact.points import PointArrays
from bdamper.contact.preload import OPEN, PreloadState, StaticSystem, assembly_offsets, scaled_state, static_state
from bdamper.contact.residual_modes import ResidualModes
from bdamper.contact.stiffness import Contact, PerArea, StiffnessReport, check_method, contact_stiffness, report
from bdamper.contact.wedge import ContactMap, WedgeFriction, wedge_friction
from bdamper.harmonic_balance.system import HarmonicSystem
from bdamper.model.coarsening import unite_contact_points, united_gap, united_stiffness
from bdamper.model.coupling import Coordinate, Coupling, HarmonicBasis, damper_drag, retained_modes, standard_rigid_modes
from bdamper.model.loads import Excitation, Response, direction_vector
from bdamper.model.model import ContactStiffness
from bdamper.problem.effects import Effects
from bdamper.problem.parts import part
from bdamper.problem.settings import Settings, check_history
from bdamper.util import validate
from bdamper.util.blas import one_thread
from bdamper.util.cost import Cost, Stopwatch
from bdamper.util.errors import ModelError, SettingError, StaticError
from bdamper.util.repr import brief, short
from bdamper.util.warn import say

P = TypeVar("P", bound="Problem")
SMALLEST_SHARE = 1e-3
"""Share of a damper's load that its rigid-body modes in the study must carry."""


@brief
@dataclass(frozen=True, eq=False)
class Problem(Settings):
    """Settings with what is made from them.

    Problems are told apart by identity; what two of them have in common is seen in the settings of their results.
    Parameters are those of ``bdamper.problem.settings.Settings``.
    """

    _given: InitVar[Mapping[str, Any] | None] = None
    parts: dict[str, Any] = field(init=False, repr=False, compare=False)
    """What has been made so far, by name (``bdamper.problem.parts.part``)."""

    def __post_init__(self, residual_traction: str, _given: Mapping[str, Any] | None) -> None:
        object.__setattr__(self, "parts", dict(_given or {}))
        super().__post_init__(residual_traction)
        _ = self.modal_bases  # the nodal diameters that the harmonics need
        _ = self.point_gaps
        self._check_stiffness()

    def _check_stiffness(self) -> None:
        """Names and the user's own values; what a method needs of the model is found when it is used."""
        method = self.contact_stiffness
        if method is None:
            return
        if not (isinstance(method, str) and method == "model"):
            check_method(method)
        if not isinstance(method, ResidualModes) and (not isinstance(method, str) or method == "model"):
            _ = self.contact

    def __str__(self) -> str:
        def place(at: Excitation | Response) -> str:
            return f"{at.location} {at.direction if isinstance(at.direction, str) else short(at.direction)}"

        mu = sorted({value for value in self.friction_by_interface().values() if value > 0.0})
        law = self.friction_law if isinstance(self.friction_law, str) else short(self.friction_law)
        method = self.stiffness_method
        stiffness = method if isinstance(method, str) else short(method)
        factor = "" if self.contact_stiffness_factor == 1.0 else f" times {self.contact_stiffness_factor:g}"
        harmonics, friction = " ".join(map(str, self.harmonic_numbers)), ", ".join(f"{value:g}" for value in mu) or "none"
        lines = [
            f"study of model {self.model.hash}, engine order {self.engine_order}",
            f"  {self.excitation.amplitude:g} N at {place(self.excitation)}, response at {place(self.response_location)}",
            f"  harmonics {harmonics}, blade modes {self.blade_modes}, elastic damper modes {self.damper_modes}, "
            f"{(~self.coupling.spring_points).sum()} contact points",
            f"  friction {friction} ({law}), contact stiffness {stiffness}{factor}, evaluation {self.evaluation}",
            *(f"  {name.replace('_', ' ')}: {value}" for name, value in self._unusual().items()),
        ]
        return "\n".join(lines)

    # ---- other settings ----

    def with_(self, **settings: Any) -> Self:
        """The same problem under other settings, given by name; what does not depend on them is shared.

        Raises
        ------
        SettingError
            If a value does not fit.
        """
        changed = {name for name, value in settings.items() if not hasattr(self, name) or value is not getattr(self, name)}
        if not changed <= {"harmonics", "bias", "stability"}:
            return replace(self, **settings)
        out = self.sharing(self.parts.keys() - {"bases", "modal_bases", "response_rows"}, **settings)
        if self.contact_stiffness is None and not changed <= {"stability"}:
            if self.contact.note:
                return replace(self, **settings)
            try:
                _ = out.bases
            except ModelError:  # no flexibility at the nodal diameters of these harmonics
                return replace(self, **settings)
        _ = out.bases
        return out

    def sharing(self, names: Iterable[str], **settings: Any) -> Self:
        """The same problem under other settings, which the parts of these names must not depend on."""
        return replace(self, _given={name: self.parts[name] for name in tuple(names) if name in self.parts}, **settings)

    def given(self, **parts: Any) -> Self:
        """The same problem with parts that were made elsewhere, by name."""
        return replace(self, _given=self.parts | parts)

    def with_effects(self, effects: Effects) -> Self:
        """The same problem with other effects; what does not depend on them is shared."""
        settings = self.settings_for(validate.instance("effects", effects, Effects))
        return self.with_(**{name: value for name, value in settings.items() if value != getattr(self, name)})

    # ---- parts, made once ----

    @part
    def static_states(self) -> dict[tuple[float, ...], PreloadState]:
        """Static states so far, by preload and load history; problems that agree in all that they depend on share them."""
        return {}

    @part
    def _angles(self) -> dict[float, NDArray]:
        return {}

    @part
    def coupling(self) -> Coupling:
        """The model with the retained modes and interfaces."""
        bodies = {
            name: standard_rigid_modes(self.model, body) if body.kind == "free" else body
            for name, body in self.model.bodies.items()
        }
        model = replace(self.model, bodies=bodies)
        if self.contact_points is not None:
            model = unite_contact_points(model, self.contact_points)
        blade_modes = min(self.blade_modes, self.most_modes("constrained"))
        modes = retained_modes(model, blade_modes, self.damper_modes, self.rigid_modes)
        return Coupling(model, self.interface_names(), modes, int(self.engine_order), self.single_basis)

    @part
    def static_basis(self) -> HarmonicBasis:
        """Modes of the static state."""
        return self._with_residual(self.coupling.basis(0), 0)

    def _with_residual(self, basis: HarmonicBasis, harmonic: int) -> HarmonicBasis:
        residual = self.contact.residual
        if residual is None:
            return basis
        return residual.basis(harmonic).stiffer(float(self.contact_stiffness_factor)).join(basis)

    @part
    def modal_bases(self) -> list[HarmonicBasis]:
        """Modes of the bodies for each harmonic, from the mean on."""
        return [
            self.coupling.basis(l) if l in self.active_harmonics else self.coupling.no_basis()
            for l in range(self.harmonic_numbers[-1] + 1)
        ]

    @part
    def bases(self) -> list[HarmonicBasis]:
        """Modes of each harmonic, from the mean on; residual modes, if there are any, come last."""
        bases = [self._with_residual(b, l) if l in self.active_harmonics else b for l, b in enumerate(self.modal_bases)]
        return [self.damped(b) for b in bases]

    def damped(self, basis: HarmonicBasis) -> HarmonicBasis:
        """The modes of a harmonic with the damping that the settings ask for."""
        if self.damping_ratio is not None:
            basis = replace(basis, damping_ratio=np.where(basis.omega2 > 0.0, self.damping_ratio, 0.0))
        own = self._damper_drag
        return replace(basis, drag=basis.drag + np.array([own.get(c, 0.0) for c in basis.coordinates])) if own else basis

    @part
    def _damper_drag(self) -> dict[Coordinate, float]:
        if not (self.damper_damping_ratio or self.damper_drag):
            return {}
        held = (self.friction_points | self.coupling.spring_points)[:, None]
        springs = held * np.concatenate([self.tangential_stiffness, self.point_stiffness[:, 2:]], axis=1)
        return damper_drag(self.model, self.static_basis, springs, self.damper_damping_ratio, self.damper_drag)

    @part
    def friction(self) -> NDArray:
        """(n_points,) friction coefficients."""
        mu = np.zeros(self.coupling.n_points)
        for name, value in self.friction_by_interface().items():
            mu[self.coupling.rows(name)] = value
        return mu

    @part
    def contact(self) -> Contact:
        """Contact stiffness by the method asked for, with residual modes if it has any.

        By default residual modes; where the model lacks what they need, what it carries, or unit tractions.
        """
        if self.contact_stiffness is not None:
            return self._contact_by(self.contact_stiffness)
        try:
            contact = self._contact_by("residual_modes")
            for l in sorted({0, *self.active_harmonics}):
                _ = contact.residual and contact.residual.basis(l)
            return contact
        except (ModelError, SettingError) as error:
            why = str(error)
        carried = all(name in self.model.contact for name in self.coupling.interfaces)
        contact = self._contact_by("model" if carried else "unit_traction")
        note = (
            f'contact stiffness "{contact.method}" instead of residual modes ({why}); peaks may be off by tens of percent, '
            "which more blade modes would show"
        )
        say(note)
        return replace(contact, note=note)

    def _contact_by(self, method: Any) -> Contact:
        given = method
        if isinstance(method, str) and method == "model":
            missing = [name for name in self.coupling.interfaces if name not in self.model.contact]
            if missing:
                raise SettingError(f'contact_stiffness="model": the model has none for interfaces {missing}')
            return Contact({n: self.coupling.model.contact[n] for n in self.coupling.interfaces}, method=given)
        if self.contact_points is not None and not isinstance(method, (str, ResidualModes, PerArea)):
            # numbers are given for the points of the model
            whole = method if isinstance(method, Mapping) else dict.fromkeys(self.coupling.interfaces, method)
            method = {
                name: united_stiffness(self.model.interfaces[name], self.contact_points, np.asarray(k, float))
                for name, k in whole.items()
            }
        return replace(contact_stiffness(self.coupling, method, self.friction), method=given)

    @property
    def stiffness_method(self) -> Any:
        """The method or the values of the contact stiffness, the one in use where the study leaves it to the model."""
        if self.contact_stiffness is not None:
            return self.contact_stiffness
        try:
            return self.contact.method
        except (ModelError, SettingError):  # no stiffness at all, which an analysis says
            return super().stiffness_method

    @part
    def stiffness(self) -> dict[str, ContactStiffness]:
        """Contact stiffness of each interface."""
        factor = float(self.contact_stiffness_factor)
        if factor == 1.0:
            return self.contact.stiffness
        kinds = {name: face.kind for name, face in self.model.interfaces.items()}
        scaled = {n: replace(c, stiffness=factor * c.stiffness) for n, c in self.contact.stiffness.items()}
        return {n: self.contact.stiffness[n] if kinds[n] in ("cubic", "spring") else c for n, c in scaled.items()}

    @property
    def stiffness_report(self) -> tuple[StiffnessReport, ...]:
        """Range of the contact stiffness and use of fallback rules, for each interface."""
        return tuple(report(name, contact, self.contact.note) for name, contact in self.stiffness.items())

    @part
    def point_stiffness(self) -> NDArray:
        """(n_points, 3) contact stiffness along t1, t2, n, N/m."""
        return np.concatenate([self.stiffness[name].stiffness for name in self.coupling.interfaces])

    @part
    def point_gaps(self) -> NDArray:
        """(n_points,) initial distance of the surfaces, m; negative for interference."""
        given = {} if self.gap is None else validate.mapping("gap", self.gap, self.coupling.interfaces, "interfaces")
        parts = []
        for name in self.coupling.interfaces:
            face = self.coupling.model.interfaces[name]
            gap = validate.numbers(f"gap of '{name}'", given[name]) if name in given else face.gap
            whole = self.model.interfaces[name]
            if self.contact_points is not None and gap.shape == (whole.n_points,):  # given for the points of the model
                gap = united_gap(whole, self.contact_points, gap)
            validate.that(gap.shape == (face.n_points,), f"gap of '{name}'", f"{face.n_points} finite numbers", gap)
            if self.law_by_interface().get(name) == LAW_BONDED and (gap > 0.0).any():
                raise SettingError(
                    f"gap of '{name}': expected none under friction_law=\"bonded\", which holds the surfaces together in "
                    f"both senses, found {gap.max():.3g} m at the widest of {(gap > 0.0).sum()} points"
                )
            parts.append(gap)
        return np.concatenate(parts)

    @part
    def point_laws(self) -> NDArray:
        """(n_points,) law of each contact point."""
        law = np.full(self.coupling.n_points, LAW_NORMAL)
        for name in self.coupling.interfaces:
            kind = self.model.interfaces[name].kind
            law[self.coupling.rows(name)] = {"cubic": LAW_CUBIC, "spring": LAW_BONDED}.get(kind, LAW_NORMAL)
        for name, value in self.law_by_interface().items():
            rows = self.coupling.rows(name)
            law[rows] = value if value == LAW_BONDED else np.where(self.friction[rows] > 0.0, value, LAW_NORMAL)
        return law

    @part
    def bonded_points(self) -> NDArray:
        """(n_points,) bool: points of linear springs."""
        return self.point_laws == LAW_BONDED

    @part
    def tangential_stiffness(self) -> NDArray:
        """(n_points, 2) contact stiffness along t1 and t2, N/m; none where there is neither friction nor bond."""
        return self.point_stiffness[:, :2] * ~np.isin(self.point_laws, (LAW_NORMAL, LAW_CUBIC))[:, None]

    @part
    def friction_points(self) -> NDArray:
        """(n_points,) bool: points of friction interfaces, whatever their coefficient."""
        faces = [self.coupling.model.interfaces[name] for name in self.coupling.interfaces]
        return np.concatenate([np.full(face.n_points, face.kind == "friction") for face in faces])

    @part
    def damper_load(self) -> tuple[NDArray, NDArray]:
        """Modal force (n_modes,) per newton of preload, and motion (n_points, 3) of the points that the modes do not
        carry."""
        force, shift = self.coupling.load(spinning=self.speed is not None)
        return np.pad(force, (0, self.static_basis.n_modes - len(force))), shift

    @part
    def constant_force(self) -> NDArray:
        """(n_modes,) modal static force that does not scale with the preload."""
        force = self.coupling.constant_force()
        return np.pad(force, (0, self.static_basis.n_modes - len(force)))

    def location_modes(self, location: str, harmonic: int) -> NDArray:
        """(3, n_modes) motion of a location by the coordinates of one harmonic; residual modes do not move it."""
        modes = self.coupling.location_modes(location, harmonic)
        return np.pad(modes, ((0, 0), (0, self.bases[harmonic].n_modes - modes.shape[1])))

    @part
    def force_rows(self) -> NDArray:
        """(n_modes,) complex modal excitation at harmonic 1."""
        modes = self.location_modes(self.excitation.location, 1)
        force = self.excitation.amplitude * np.exp(1j * self.excitation.phase)
        return (direction_vector(self.excitation.direction, "excitation direction") @ modes).conj() * force

    @part
    def response_rows(self) -> list[NDArray]:
        """(n_modes,) rows that give the response, for each harmonic from the mean on."""
        place = self.response_location
        direction = direction_vector(place.direction, "response direction")
        rows = [
            direction @ self.location_modes(place.location, l) if l in self.active_harmonics else np.zeros(0)
            for l in range(self.harmonic_numbers[-1] + 1)
        ]
        rows[0] = rows[0].real
        return rows

    # ---- static ----

    @part
    def static_system(self) -> StaticSystem:
        """The static contact problem under the load on the damper."""
        force, shift = self.damper_load
        return StaticSystem(
            stiffness=self.static_basis.omega2,
            G=self.static_basis.G.real,
            kt=self.tangential_stiffness,
            kn=self.point_stiffness[:, 2],
            mu=self.friction,
            n0=-self.point_stiffness[:, 2] * self.point_gaps,
            force=force,
            shift=shift,
            constant_force=self.constant_force,
            bonded=self.bonded_points,
            cubic=self.point_stiffness[:, :2] * (self.point_laws == LAW_CUBIC)[:, None],
        )

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
        preload = self.check_preload(preload)
        factors = self.load_history if history is None else check_history(history, "history")
        key = (preload, *factors)
        if key not in self.static_states:
            watch = Stopwatch()
            system = self.static_system
            offset = assembly_offsets(self.slip_offset, self.slip_offset_seed, self.friction)
            state = None
            if len(factors) == 1 and preload > 0.0 and not self.slip_offset:
                # always from one and the same load, so that results do not depend on what was asked before
                unit = self.static_states.get((1.0, 1.0)) or static_state(system, 1.0)
                self.static_states[(1.0, 1.0)] = unit
                state = scaled_state(system, unit, factors[0] * preload)
                if state is not None:
                    self.static_states[key] = replace(state, cost=Cost(**watch.read()))
                    return self.static_states[key]
            for factor in factors:
                state = static_state(system, factor * preload, start=state, offset=offset)
                if not state.converged:
                    break
            assert state is not None
            self.static_states[key] = replace(state, cost=Cost(**watch.read(), iterations=state.iterations))
        return self.static_states[key]

    def equilibrium(self, preload: float, history: Sequence[float] | None = None) -> PreloadState:
        """The static state that a result is built on, an error where there is none."""
        state = self.static(preload, history)
        if not state.converged:
            raise StaticError(f"expected a static state under {preload:g} N, found none: {state.note}")
        return state

    def contact_map(self, preload: float, history: Sequence[float] | None = None) -> ContactMap:
        """Pressure, gap and state over the faces in the static state.

        Parameters
        ----------
        preload : float, N
        history : sequence of float, optional
            Load factors through which the preload is reached; those of the settings by default.
        """
        factors = self.load_history if history is None else check_history(history, "history")
        return ContactMap.make(self.coupling, self.equilibrium(preload, factors), self.friction, factors)

    def wedge_friction(self, preload: float = 1.0) -> WedgeFriction:
        """Interval of normal forces that statics and friction leave possible; names a self-locking wedge."""
        return wedge_friction(self.coupling, self.friction, self.check_preload(preload))

    def check_preload(self, preload: float) -> float:
        """The preload (N), refused where it is none or where nothing carries it."""
        preload = validate.number("preload", preload, least=0.0, unit="N")
        if preload > 0.0 and not self.carries_load:
            raise SettingError(f"preload: expected 0, since {self.why_no_load}, found {preload:g} N")
        return preload

    @part
    def carries_load(self) -> bool:
        """Whether the study has the motions along which the model's dampers are loaded.

        The generalised load on the rigid-body modes that the study has must be at least a thousandth of that on all six:
        motions across the load carry nothing but rounding.
        """
        shares = []
        for body in self.coupling.model.bodies.values():
            if body.load is None or not np.any(body.load.generalised):
                continue
            omega2, kept = body.bases[0].omega2, self.coupling.modes[body.name]
            counts = omega2 == 0.0 if body.kind == "free" else np.ones(len(omega2), bool)
            load = np.where(counts, body.load.generalised, 0.0)
            shares.append(float(np.linalg.norm(load[kept]) / np.linalg.norm(load)))
        return min(shares, default=0.0) > SMALLEST_SHARE

    @property
    def why_no_load(self) -> str:
        """Why no load acts on a damper, if none does."""
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
        SettingError
            If nothing is excited, or the force is not finite.
        """
        e = self.force_rows
        if not np.finfo(float).tiny <= np.abs(e).max() < np.inf:
            at = self.excitation
            raise SettingError(
                f"excitation: expected a finite force that works on the modes of harmonic 1, found {at.amplitude:g} N at "
                f"'{at.location}', {at.direction}"
            )
        state = self.equilibrium(preload)
        load, shift = self.damper_load
        n_mode = [len(b.omega2) for b in self.bases]
        force = np.zeros(n_mode[0] + 2 * sum(n_mode[1:]))
        force[: n_mode[0]] = (state.load * load + self.constant_force)[: n_mode[0]]
        n = n_mode[1]
        force[n_mode[0] : n_mode[0] + n] = e.real
        force[n_mode[0] + n : n_mode[0] + 2 * n] = -e.imag
        shift = state.load * shift
        if not self.bias:
            shift = shift + self.static_basis.G.real @ state.q
        points = PointArrays(
            kt=self.point_stiffness[:, :2] * (self.point_laws != LAW_NORMAL)[:, None],
            kn=self.point_stiffness[:, 2],
            mu=self.friction,
            n0=-self.point_stiffness[:, 2] * self.point_gaps,
            slider=np.where(self.bonded_points[:, None], 0.0, state.slider),
            law=self.point_laws.copy(),
            shift=shift,
        )
        bases = self.bases
        if self.friction_axes == "major":
            bases, points = turned(bases, points, self.major_directions(preload))
        if not self.separation or not self.variable_normal_load:
            bases, points = without_separation(
                bases, points, state, self.friction_points, constant_load=not self.variable_normal_load
            )
        vibration = float(np.abs(self.force_rows).max())
        pressed = np.einsum("pdm,pd->m", self.static_basis.G.real, state.force)
        mean = max(float(np.abs(state.load * load).max()), float(np.abs(pressed).max()), vibration)
        scale = (mean or 1.0, vibration or mean or 1.0)
        system = HarmonicSystem(bases, points, force, self.response_rows, self.evaluation, scale)
        system.spring_bases = self.bases  # linear springs are those of the points of the coupling
        system.springs = self.point_stiffness * self.coupling.spring_points[:, None]
        return system

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
        springs = stuck_springs(self, self.equilibrium(preload))
        system = self.sharing(self.parts, friction_axes="contact").system(preload)
        motions = [system.linear_response(w, springs) for w in system.linear_modes(springs)[0] if w > 0.0]
        largest = max(motions, key=lambda motion: abs(motion @ self.response_rows[1]))
        self._angles[preload] = major_angles(self.bases[1].G[:, :2] @ largest)
        return self._angles[preload]


def stuck_springs(problem: Problem, state: PreloadState) -> NDArray:
    """(n_points, 3) linear springs: points that the preload has closed do not slip."""
    closed = ~(state.status == OPEN).any(axis=1) & ~problem.coupling.spring_points
    springs = np.concatenate([problem.tangential_stiffness, problem.point_stiffness[:, 2:]], axis=1)
    return springs * closed[:, None]


def matching(problem: P, settings: Mapping[str, Any]) -> P:
    """The same problem with the harmonics and the evaluation of a result.

    Parameters
    ----------
    settings : mapping
        Of the result.  Where they do not say that a tolerance chose them, the problem itself is returned.
    """
    if "tolerance" not in settings:
        return problem
    evaluation = settings["evaluation"]
    harmonics = tuple(settings["harmonics"])
    chosen = evaluation if isinstance(evaluation, str) else Sampled(**evaluation)
    if harmonics == problem.harmonic_numbers and chosen == problem.evaluation:
        return problem
    return problem.sharing(["static_states"], harmonics=harmonics, evaluation=chosen)
