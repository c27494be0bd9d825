"""Physical effects that a simulation includes, and what it assumes where one is left out.

Each effect costs unknowns, contact points or a more expensive contact law: further harmonics, the mean, the variation of
the normal load, separation, motions of the damper, elastic modes, constraint planes, contact points.  :class:`Effects`
names them all.  The equations of a study hold nothing of an effect that is off.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Annotated, Any

from bdamper.contact.laws import ContactLaw
from bdamper.util import validation
from bdamper.util.errors import SettingError
from bdamper.util.formatting import aligned, spaced

AXES = ("X", "Y", "Z")
LAW_NAMES = ("uncoupled", "coupled", "bonded")
MAX_HARMONIC = 64
HARMONICS = 3
"""By default: with fewer the peak near the optimal preload is another one (docs/measured.md)."""
BLADE_MODES = 10
"""By default; fewer where the model has no more.  Residual modes carry what the others would (docs/measured.md)."""
SWITCHES = ("bias", "variable_normal_load", "separation", "harmonic_nodal_diameters", "constraint_planes")
"""Effects that are on or off."""
AS_NAMED = (
    "harmonics", "bias", "variable_normal_load", "separation", "friction_law", "damper_modes", "constraint_planes",
    "contact_points", "stability", "blade_modes",
)  # fmt: skip
"""Effects that are settings of a study of the same name."""


def _effect(default: Any, off: str) -> Any:
    return field(default=default, metadata={"off": off})


@validation.check_arguments
@dataclass(frozen=True)
class Effects:
    """Physical effects that a simulation includes.

    Parameters
    ----------
    harmonics : int or sequence of int
        How many harmonics of the engine order, or which: ``(1, 3)`` leaves the second out.  The first is always there.
        Even harmonics vanish only where the normal load is constant: friction with a constant limit is odd in the motion.
    bias : bool
        Mean motion as unknowns.  Off: the mean stays at its static value.
    variable_normal_load : bool
        The friction limit follows the normal load through the cycle.  Off: it is that of the static state; surfaces then
        do not separate either.
    separation : bool
        Surfaces may open and close.  Off: friction points that are closed statically stay closed, the others open.
    friction_law : {"uncoupled", "coupled", "bonded"}, ContactLaw or mapping of interface name to these
        "uncoupled": each tangential direction slips for itself.  "coupled": the friction force lies in a disk, sampled.
    rotation, translation : sequence of "X", "Y", "Z"
        Rigid-body motions of free bodies about and along their own axes: Y along the load, Z along that of rotation.
    damper_modes : int or mapping of body name to int
        Elastic modes of free bodies; none of those that a mapping does not name.
    harmonic_nodal_diameters : bool
        Each harmonic has the modes of the nodal diameter that it excites.  Off: all have those of the first.
    constraints : bool
        Constraint planes (front and back of a damper).
    contact_points : int, optional
        At most so many on each friction face, by uniting neighbouring patches; the model's own by default.
    stability : bool
        Stability of every point of a response curve.  It changes no solution.
    blade_modes : int
        Modes of each constrained body (at most what the model has).
    """

    harmonics: Harmonics = _effect(HARMONICS, "the response is sinusoidal, with or without a mean")
    bias: bool = _effect(True, "the mean stays at its static value")
    variable_normal_load: bool = _effect(True, "friction limit of the static normal load, no separation")
    separation: bool = _effect(True, "closed points stay closed, open points stay open")
    friction_law: Law = _effect("uncoupled", "uncoupled: each tangential direction slips for itself")
    rotation: Axes = _effect(AXES, "the damper does not turn about this axis")
    translation: Axes = _effect(AXES, "the damper does not move along this axis")
    damper_modes: ByBody = _effect(0, "the damper is rigid apart from contact stiffness")
    harmonic_nodal_diameters: bool = _effect(True, "every harmonic has the modes of the first")
    constraint_planes: bool = _effect(True, "nothing limits the axial motion of the damper")
    contact_points: validation.Count | None = _effect(None, "neighbouring patches slip and open together")
    stability: bool = _effect(False, "a curve that runs back between two folds counts as unstable")
    blade_modes: validation.Count = _effect(
        BLADE_MODES, "higher modes act through the contact stiffness and residual modes alone"
    )

    def __post_init__(self) -> None:
        validation.check_fields(self)
        if not self.variable_normal_load:
            object.__setattr__(self, "separation", False)

    @property
    def harmonic_numbers(self) -> tuple[int, ...]:
        """Harmonics besides the mean, ascending."""
        return harmonic_numbers(self.harmonics)

    @classmethod
    def of(cls, problem: Any) -> Effects:
        """The effects that a study, a problem or settings include."""
        own = getattr(problem, "settings", problem)
        return cls(
            **{name: getattr(own, name) for name in AS_NAMED},
            rotation=tuple(name[1] for name in own.rigid_modes if name[0] == "R"),
            translation=tuple(name[1] for name in own.rigid_modes if name[0] == "T"),
            harmonic_nodal_diameters=not own.fundamental_modes_only,
        )

    def settings(self) -> dict[str, Any]:
        """The settings of a study that carry these effects, by name."""
        same = {name: getattr(self, name) for name in AS_NAMED}
        rigid = *(f"T{axis}" for axis in self.translation), *(f"R{axis}" for axis in self.rotation)
        return same | {"rigid_modes": rigid, "fundamental_modes_only": not self.harmonic_nodal_diameters}

    def without(self, name: str) -> Effects:
        """This set without one effect; the set itself where the effect is off already.

        Parameters
        ----------
        name : str
            "bias", "variable normal load", "separation", "harmonic nodal diameters", "constraints"; "rotation X" or
            "translation Z" and the like; "harmonics", "damper modes", "blade modes" or "contact points" with the most
            that remain, as "harmonics beyond 3".

        Raises
        ------
        SettingError
            If there is no such effect.
        """
        what, _, most = name.partition(" beyond ")
        motion, _, axis = what.partition(" ")
        key, changed = what.replace(" ", "_"), dict[str, Any]()
        if name.replace(" ", "_") in SWITCHES:
            changed[key] = False
        elif name == what and motion in ("rotation", "translation") and axis in AXES:
            changed[motion] = tuple(a for a in getattr(self, motion) if a != axis)
        elif most.isdigit() and key == "harmonics":
            left = tuple(l for l in self.harmonic_numbers if l <= int(most))
            if left != self.harmonic_numbers:
                changed[key] = len(left) if left == tuple(range(1, len(left) + 1)) else left
        elif most.isdigit() and key in ("damper_modes", "blade_modes", "contact_points"):
            own = getattr(self, key)
            if isinstance(own, Mapping):
                changed[key] = {body: min(count, int(most)) for body, count in own.items()}
            else:
                changed[key] = min(int(most), own or int(most)) if key == "contact_points" else min(int(most), own)
        else:
            raise validation.invalid("effect", "the name of an effect that can be left out", name)
        return replace(self, **changed)

    def describe(self) -> str:
        """A table of all effects: the setting, and what is assumed where it is off or reduced."""
        rows = [(spaced(f.name), _text(getattr(self, f.name)), f.metadata["off"]) for f in fields(self)]
        lines = aligned([("effect", "setting", "assumed where off or reduced"), *rows])
        evens = [l for l in range(2, max(self.harmonic_numbers)) if l % 2 == 0 and l not in self.harmonic_numbers]
        if evens and self.variable_normal_load:
            lines.append(f"harmonics {evens} are left out although the variable normal load excites them")
        return "\n".join(lines)


def check_harmonics(name: str, harmonics: int | Sequence[int]) -> int | tuple[int, ...]:
    """A count from 1 to 64, or a set of harmonics that contains the first."""
    what = f"a whole number from 1 to {MAX_HARMONIC}, or such numbers with 1 among them"
    several = isinstance(harmonics, Sequence) and not isinstance(harmonics, str | bytes)
    given: Any = harmonics if several else [harmonics]
    try:
        known = tuple(validation.integer(name, l, 1, MAX_HARMONIC) for l in given)
    except SettingError as error:
        raise validation.invalid(name, what, harmonics) from error
    validation.check_value((1 in known or not several) and len(set(known)) == len(given), name, what, harmonics)
    return known if several else known[0]


def check_law(name: str, law: Any) -> Any:
    """The name of a friction law, a law of the user's own, or a mapping of interface names to them."""
    given = law.values() if isinstance(law, Mapping) else [law]
    good = all(isinstance(one, ContactLaw) or (isinstance(one, str) and one in LAW_NAMES) for one in given)
    validation.check_value(good, name, f"one of {LAW_NAMES}, a ContactLaw or a mapping of interface names to these", law)
    return law


def harmonic_numbers(harmonics: int | Sequence[int]) -> tuple[int, ...]:
    """Harmonics besides the mean, ascending, from a count or a set."""
    if isinstance(harmonics, Sequence):
        return tuple(sorted(int(l) for l in harmonics))
    return tuple(range(1, int(harmonics) + 1))


def _axes(name: str, value: Sequence[str]) -> tuple[str, ...]:
    given = validation.names(name, value, AXES)
    return tuple(axis for axis in AXES if axis in given)


Axes = Annotated[tuple[str, ...], _axes]
Harmonics = Annotated[int | tuple[int, ...], check_harmonics]
Law = Annotated[str | ContactLaw | Mapping[str, str | ContactLaw], check_law]
ByBody = Annotated[int | Mapping[str, int], validation.each(validation.integer)]


def _text(value: object) -> str:
    if isinstance(value, bool):
        return "on" if value else "off"
    if isinstance(value, Mapping):
        return ", ".join(f"{name} {own}" for name, own in value.items())
    if isinstance(value, tuple):
        return " ".join(str(v) for v in value) or "off"
    return "all" if value is None else str(value)
