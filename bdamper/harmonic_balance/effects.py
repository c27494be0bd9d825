"""Physical effects that a simulation includes, and the assumption made if an effect is off.

Each effect adds unknowns, contact points or a more expensive contact law: higher harmonics, the mean, variable normal load,
separation, rigid-body and elastic modes of the damper, constraint planes, contact points.  :class:`Effects` contains the
settings that include them.  The equations of a study contain no terms of an effect that is off.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, Any

from bdamper.contact.laws import ContactLaw
from bdamper.model.kinematics import RIGID_NAMES
from bdamper.util import validation
from bdamper.util.errors import SettingError
from bdamper.util.formatting import aligned, spaced

LAW_NAMES = ("uncoupled", "coupled", "bonded")
MAX_HARMONIC = 64
HARMONICS = 3
"""Default number of harmonics.  With fewer the peak near the optimal preload differs (docs/evidence/measured.md)."""
BLADE_MODES = 10
"""Default number of blade modes, or all modes of a smaller model.  Residual modes replace the others (measured.md)."""
ASSUMED = {
    "harmonics": "the response is sinusoidal, with or without a mean",
    "bias": "the mean stays at its static value",
    "variable_normal_load": "friction limit of the static normal load, no separation",
    "separation": "closed points stay closed, open points stay open",
    "friction_law": "uncoupled: each tangential direction slips for itself",
    "rigid_modes": "the damper does not move along the axes or turn about the axes left out",
    "damper_modes": "the damper is rigid apart from contact stiffness",
    "fundamental_modes_only": "if on, every harmonic has the modes of the first",
    "constraint_planes": "nothing limits the axial motion of the damper",
    "contact_points": "neighbouring patches slip and open together",
    "stability": "a curve that runs back between two folds counts as unstable",
    "blade_modes": "higher modes act through the contact stiffness and residual modes alone",
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
    f"{'rotation' if mode[0] == 'R' else 'translation'} {mode[1]}": mode for mode in RIGID_NAMES
}
"""Rigid-body motions of free bodies: Y along the load, Z along the axis of rotation."""
REDUCED = ("harmonics", "damper modes", "blade modes", "contact points")
"""Effects that are reduced to a largest number."""


class Effects(dict[str, Any]):
    """Settings that include physical effects, by name: ``study.replace(**effects)``.

    ``print`` shows a table of them with the assumptions made if they are off or reduced.
    """

    def __init__(self, settings: Mapping[str, Any]) -> None:
        known = f"names out of {sorted(ASSUMED)}"
        validation.check_value(set(settings) <= set(ASSUMED), "effects", known, sorted(settings))
        super().__init__(
            {name: tuple(v) if isinstance(v, list) else v for name, v in settings.items()}
        )
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
            "bias", "variable normal load", "separation", "harmonic nodal diameters" or "constraint planes"; a rigid-body
            motion of free bodies, such as "rotation X" or "translation Z"; or "harmonics", "damper modes", "blade modes" or
            "contact points" followed by the largest remaining number, such as "harmonics beyond 3".

        Raises
        ------
        SettingError
            If there is no such effect.
        """
        what, _, most = name.partition(" beyond ")
        key = what.replace(" ", "_")
        if name in OFF:
            changed = OFF[name]
        elif name in MOTIONS:
            changed = {
                "rigid_modes": tuple(mode for mode in self["rigid_modes"] if mode != MOTIONS[name])
            }
        elif what in REDUCED and most.isdigit():
            changed = {key: _at_most(self[key], int(most))}
        else:
            raise validation.invalid("effect", "the name of an effect that can be left out", name)
        return Effects({**self, **changed})

    def __str__(self) -> str:
        rows = [
            (spaced(name), _text(self[name]), assumed)
            for name, assumed in ASSUMED.items()
            if name in self
        ]
        lines = aligned([("effect", "setting", "assumed where off or reduced"), *rows])
        numbers = harmonic_numbers(self.get("harmonics", 1))
        evens = [l for l in range(2, max(numbers), 2) if l not in numbers]
        if evens and self.get("variable_normal_load", True):
            lines.append(
                f"harmonics {evens} are left out although the variable normal load excites them"
            )
        return "\n".join(lines)


def _at_most(value: Any, most: int) -> Any:
    """Limit a number or the values of a mapping to ``most``, or drop larger numbers from a sequence."""
    if isinstance(value, Mapping):
        return {name: min(count, most) for name, count in value.items()}
    if not isinstance(value, Sequence):
        return min(most, most if value is None else value)
    left = tuple(l for l in value if l <= most)
    return (
        left if len(left) == len(value) or set(left) != set(range(1, len(left) + 1)) else len(left)
    )


def check_harmonics(name: str, harmonics: int | Sequence[int]) -> int | tuple[int, ...]:
    """Check and return a number of harmonics from 1 to 64, or a sequence of harmonics that includes the first."""
    what = f"a whole number from 1 to {MAX_HARMONIC}, or such numbers with 1 among them"
    several = isinstance(harmonics, Sequence) and not isinstance(harmonics, str | bytes)
    given: Any = harmonics if several else [harmonics]
    try:
        known = tuple(validation.integer(name, l, 1, MAX_HARMONIC) for l in given)
    except SettingError as error:
        raise validation.invalid(name, what, harmonics) from error
    validation.check_value(
        (1 in known or not several) and len(set(known)) == len(given), name, what, harmonics
    )
    return known if several else known[0]


def check_law(name: str, law: Any) -> Any:
    """Check and return a friction law: a name, a user-defined law, or a mapping of interface names to these."""
    given = law.values() if isinstance(law, Mapping) else [law]
    good = all(
        isinstance(one, ContactLaw) or (isinstance(one, str) and one in LAW_NAMES) for one in given
    )
    validation.check_value(
        good,
        name,
        f"one of {LAW_NAMES}, a ContactLaw or a mapping of interface names to these",
        law,
    )
    return law


def harmonic_numbers(harmonics: int | Sequence[int]) -> tuple[int, ...]:
    """Return the harmonics in ascending order, without the mean, from their number or from a sequence."""
    if isinstance(harmonics, Sequence):
        return tuple(sorted(int(l) for l in harmonics))
    return tuple(range(1, int(harmonics) + 1))


Harmonics = Annotated[int | tuple[int, ...], check_harmonics]
Law = Annotated[str | ContactLaw | Mapping[str, str | ContactLaw], check_law]
ByBody = Annotated[int | Mapping[str, int], validation.each(validation.integer)]


def _text(value: object) -> str:
    if isinstance(value, bool):
        return "on" if value else "off"
    if isinstance(value, Mapping):
        return ", ".join(f"{name} {count}" for name, count in value.items())
    if isinstance(value, tuple):
        return " ".join(str(v) for v in value) or "off"
    return "all" if value is None else str(value)
