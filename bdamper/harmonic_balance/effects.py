"""Physical effects included in a simulation, and the assumption made if an effect is off.

Each effect adds unknowns, contact points or a more expensive contact law: higher harmonics, the
mean, variable normal load, separation, rigid-body and elastic modes of the damper, constraint
planes, contact points.  :class:`Effects` contains the settings that include them.  The equations of
a study contain no terms of an effect that is off.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, Any

from bdamper.contact.laws import ContactLaw
from bdamper.util import validation
from bdamper.util.errors import SettingError
from bdamper.util.formatting import aligned, spaced

LAW_NAMES = ("uncoupled", "coupled", "bonded")
MAX_HARMONIC = 64
HARMONICS = 3
"""Default number of harmonics.  With fewer the peak near the optimal preload differs
(docs/evidence/measured.md).
"""
BLADE_MODES = 10
"""Default number of blade modes, or all modes of a smaller model.  Residual modes replace the
others (measured.md).
"""
ASSUMED = {
    "harmonics": "the response is sinusoidal, with or without a mean",
    "bias": "the mean stays at its static value",
    "variable_normal_load": "the static normal load limits friction, and there is no separation",
    "separation": "closed points stay closed, open points stay open",
    "friction_law": "uncoupled: both tangential directions slip independently",
    "rigid_modes": "the damper does not translate along the omitted axes or rotate about them",
    "damper_modes": "the damper is rigid apart from contact stiffness",
    "fundamental_modes_only": "if on, all harmonics use the modes of the first harmonic",
    "constraint_planes": "nothing limits the axial motion of the damper",
    "contact_points": "neighbouring patches slip and open together",
    "stability": "the part of a curve that runs back between two folds counts as unstable",
    "blade_modes": "higher modes act only through the contact stiffness and residual modes",
}
"""Settings that include effects, and the assumption made if the effect is off or reduced."""
OFF: Mapping[str, Mapping[str, Any]] = {
    "bias": {"bias": False},
    "variable normal load": {"variable_normal_load": False, "separation": False},
    "separation": {"separation": False},
    "harmonic nodal diameters": {"fundamental_modes_only": True},
    "constraint planes": {"constraint_planes": False},
}
"""Effects that are on or off, and the settings without them."""
MOTIONS = {
    "translation X": "TX",
    "translation Y": "TY",
    "translation Z": "TZ",
    "rotation X": "RX",
    "rotation Y": "RY",
    "rotation Z": "RZ",
}
"""Rigid-body motions of free bodies: Y along the load, Z along the axis of rotation."""
REDUCED = ("harmonics", "damper modes", "blade modes", "contact points")
"""Effects that are reduced to a largest number."""


class Effects(dict[str, Any]):
    """Settings that turn physical effects on or off; ``study.replace(**effects)`` applies them.

    ``print`` shows a table of the effects, with the assumption made if an effect is off or reduced.
    """

    def __init__(self, settings: Mapping[str, Any]) -> None:
        expected = f"names out of {sorted(ASSUMED)}"
        validation.check_value(set(settings) <= set(ASSUMED), "effects", expected, sorted(settings))
        super().__init__(settings)
        # files have lists
        for name, value in settings.items():
            if isinstance(value, list):
                self[name] = tuple(value)
        # without a variable normal load nothing separates
        if not self.get("variable_normal_load", True):
            self["separation"] = False

    @classmethod
    def of(cls, problem: Any) -> Effects:
        """Return the effects that a study, a problem or settings include."""
        settings = getattr(problem, "settings", problem)
        return cls({name: getattr(settings, name) for name in ASSUMED})

    def without(self, name: str) -> Effects:
        """Return the settings without one effect; they do not change if it is already off.

        Parameters
        ----------
        name : str
            "bias", "variable normal load", "separation", "harmonic nodal diameters" or "constraint
            planes"; a rigid-body motion of free bodies, such as "rotation X" or "translation Z"; or
            "harmonics", "damper modes", "blade modes" or "contact points" followed by the largest
            remaining number, such as "harmonics beyond 3".

        Raises
        ------
        SettingError
            If there is no such effect.
        """
        # such as "harmonics beyond 3"
        reduced, _, most = name.partition(" beyond ")
        if name in OFF:
            changed = OFF[name]
        elif name in MOTIONS:
            remaining = [mode for mode in self["rigid_modes"] if mode != MOTIONS[name]]
            changed = {"rigid_modes": tuple(remaining)}
        elif reduced in REDUCED and most.isdigit():
            setting = reduced.replace(" ", "_")
            changed = {setting: _at_most(self[setting], int(most))}
        else:
            raise validation.invalid("effect", "the name of an effect that can be omitted", name)
        return Effects({**self, **changed})

    def __str__(self) -> str:
        rows = [("effect", "setting", "assumption if off or reduced")]
        for name, assumed in ASSUMED.items():
            if name in self:
                rows.append((spaced(name), _text(self[name]), assumed))
        lines = aligned(rows)
        numbers = harmonic_numbers(self.get("harmonics", 1))
        missing_evens = [number for number in range(2, max(numbers), 2) if number not in numbers]
        # contacts that open or change their friction limit are not symmetric over a cycle
        if missing_evens and self.get("variable_normal_load", True):
            lines.append(
                f"harmonics {missing_evens} are omitted although the variable normal load excites "
                "them"
            )
        return "\n".join(lines)


def _at_most(value: Any, most: int) -> Any:
    """Return a setting with numbers up to ``most``.

    A setting is a number, None for all, a number for each body, or a sequence of harmonics.
    """
    if isinstance(value, Mapping):
        return {name: min(count, most) for name, count in value.items()}
    if value is None:
        return most
    if not isinstance(value, Sequence):
        return min(most, value)
    remaining = tuple(harmonic for harmonic in value if harmonic <= most)
    # harmonics without a gap are given by their number, but unchanged ones remain as they are
    is_shorter = len(remaining) < len(value)
    has_no_gap = set(remaining) == set(range(1, len(remaining) + 1))
    return len(remaining) if is_shorter and has_no_gap else remaining


def check_harmonics(name: str, harmonics: int | Sequence[int]) -> int | tuple[int, ...]:
    """Check and return the harmonics of a response.

    They are a number of harmonics from 1 to 64, or a sequence of harmonics that includes the first.
    """
    expected = f"a whole number from 1 to {MAX_HARMONIC}, or such numbers with 1 among them"
    is_sequence = isinstance(harmonics, Sequence) and not isinstance(harmonics, str | bytes)
    listed: Any = harmonics if is_sequence else [harmonics]
    try:
        numbers = tuple(validation.integer(name, number, 1, MAX_HARMONIC) for number in listed)
    except SettingError as error:
        raise validation.invalid(name, expected, harmonics) from error
    if not is_sequence:
        return numbers[0]
    distinct = len(set(numbers)) == len(numbers)
    validation.check_value(1 in numbers and distinct, name, expected, harmonics)
    return numbers


def check_law(name: str, law: Any) -> Any:
    """Check and return a friction law.

    It is a name, a user-defined law, or a mapping of interface names to these.
    """
    expected = f"one of {LAW_NAMES}, a ContactLaw or a mapping of interface names to these"
    laws = list(law.values()) if isinstance(law, Mapping) else [law]
    for each in laws:
        is_name = isinstance(each, str) and each in LAW_NAMES
        validation.check_value(is_name or isinstance(each, ContactLaw), name, expected, law)
    return law


def harmonic_numbers(harmonics: int | Sequence[int]) -> tuple[int, ...]:
    """Return the harmonics in ascending order, without the mean.

    ``harmonics`` is their number, or a sequence of them.
    """
    if isinstance(harmonics, Sequence):
        return tuple(sorted(int(number) for number in harmonics))
    return tuple(range(1, int(harmonics) + 1))


Harmonics = Annotated[int | tuple[int, ...], check_harmonics]
Law = Annotated[str | ContactLaw | Mapping[str, str | ContactLaw], check_law]
ByBody = Annotated[int | Mapping[str, int], validation.each(validation.integer)]


def _text(value: object) -> str:
    """Return a setting in the words of the table."""
    if isinstance(value, bool):
        return "on" if value else "off"
    if isinstance(value, Mapping):
        return ", ".join(f"{name} {count}" for name, count in value.items())
    if isinstance(value, tuple):
        return " ".join(map(str, value)) if value else "off"
    if value is None:
        return "all"
    return str(value)
