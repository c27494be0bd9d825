"""The table of plausible ranges: every number that a user gives has an entry, and every entry is in use."""



from bdamper.harmonic_balance.parameters import FACTORS
from bdamper.util import plausible_ranges
from bdamper.util.plausible_ranges import TABLE, Names, Range
from tests.each import each
from tests.util.numeric import doors, numeric

DOORS = doors()
PARAMETERS = [(name, parameter) for name, door in DOORS.items() for parameter in numeric(door)]
BY_STUDY = ("Study", "Excitation", "Body")
"""Looked at when a study is made."""
VARIED = {f"Study.{name}" for name in (*FACTORS, "force_factor", "excitation", "excitation.amplitude", "excitation.phase")}
CONDITIONS = {"friction", "temperature", "excitation"}


def own_name(name):
    """The name of a function in the table: that in errors, where the function warns by itself."""
    door = DOORS[name]
    called = door.__init__ if isinstance(door, type) else door
    return getattr(called, "doubts", name)


def key(name, parameter):
    keys = (f"{own_name(name)}.{parameter}", f"{name}.{parameter}", parameter)
    return next((k for k in keys if k in TABLE), None)


@each(("name", "parameter"), PARAMETERS)
def test_every_number_that_a_user_gives_has_an_entry(name, parameter):
    found = key(name, parameter)
    assert found, f"enter {name}.{parameter} into bdamper.util.plausible_ranges.TABLE"
    known = TABLE[found]
    if not isinstance(known, str) and name not in BY_STUDY and name != "Mistuning":
        door = DOORS[name]
        function = door.__init__ if isinstance(door, type) else door
        assert hasattr(function, "doubts"), f"decorate {name} with validation.check_arguments"


def test_every_entry_is_in_use():
    used = {key(name, parameter) for name, parameter in PARAMETERS} | VARIED | CONDITIONS | {"Body.mass"}
    drawn = {f"DamperVariation.random.{name}" for name in ("mass", "friction_coefficient", "contact_stiffness", "gap")}
    assert set(TABLE) == used | drawn


def test_entries_are_ranges_or_reasons():
    for name, known in TABLE.items():
        for own in known if isinstance(known, tuple) else (known,):
            if isinstance(own, Range):
                assert own.above and own.below
                assert callable(own.low) or callable(own.high) or own.low < own.high, name
            else:
                assert isinstance(own, Names) or own in vars(plausible_ranges).values(), name
