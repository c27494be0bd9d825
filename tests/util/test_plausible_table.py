"""The table of plausible ranges: every entry is in use, and the function of each entry looks at it."""

import contextlib
import warnings
from concurrent.futures import ThreadPoolExecutor

import pytest

import bdamper as bd
from bdamper.fatigue.criteria import Material
from bdamper.harmonic_balance.parameters import FACTORS
from bdamper.util import plausible_ranges, validation
from bdamper.util.errors import PlausibilityWarning, inside_user_code
from bdamper.util.plausible_ranges import TABLE, Names, Range
from tests.each import each
from tests.util.numeric import doors, numeric

DOORS = doors()
PARAMETERS = [(name, parameter) for name, door in DOORS.items() for parameter in numeric(door)]
BY_STUDY = ("Study", "Excitation", "Body")
"""Looked at when a study is made."""
VARIED = {
    f"Study.{name}"
    for name in (*FACTORS, "force_factor", "excitation", "excitation.amplitude", "excitation.phase")
}
CONDITIONS = {"friction", "excitation"}


def own_name(name):
    """The name of a function in the table: that in errors, where the function warns by itself."""
    door = DOORS[name]
    called = door.__init__ if isinstance(door, type) else door
    return getattr(called, "doubts", name)


def key(name, parameter):
    keys = (f"{own_name(name)}.{parameter}", f"{name}.{parameter}", parameter)
    return next((k for k in keys if k in TABLE), None)


WITH_ENTRY = [(name, parameter) for name, parameter in PARAMETERS if key(name, parameter)]


@each(("name", "parameter"), WITH_ENTRY)
def test_functions_look_at_their_ranges(name, parameter):
    known = TABLE[key(name, parameter)]
    if not isinstance(known, str) and name not in BY_STUDY and name != "Mistuning":
        door = DOORS[name]
        function = door.__init__ if isinstance(door, type) else door
        assert hasattr(function, "doubts"), f"decorate {name} with validation.check_arguments"


def test_every_entry_is_in_use():
    used = (
        {key(name, parameter) for name, parameter in WITH_ENTRY}
        | VARIED
        | CONDITIONS
        | {"Body.mass"}
    )
    drawn = {
        f"DamperVariation.random.{name}"
        for name in ("mass", "friction_coefficient", "contact_stiffness", "gap")
    }
    # data classes that look up each of their fields
    read = {f"HaighTable.{name}" for name in ("amplitude", "mean", "temperature", "probability")}
    assert set(TABLE) == used | drawn | read


def test_entries_are_ranges_or_reasons():
    for name, known in TABLE.items():
        for own in known if isinstance(known, tuple) else (known,):
            if isinstance(own, Range):
                assert own.above and own.below
                assert callable(own.low) or callable(own.high) or own.low < own.high, name
            else:
                assert isinstance(own, Names) or own in vars(plausible_ranges).values(), name


def test_each_end_of_a_range_has_its_own_suspicion():
    """A value in a wrong unit is too small or too large; only a range of both signs may have one suspicion."""
    unspecific = Range(0.0, 1.0).above
    for name, known in TABLE.items():
        for own in known if isinstance(known, tuple) else (known,):
            if not isinstance(own, Range) or own.above == unspecific:
                continue
            has_both_signs = name == "Study.gap" or (not callable(own.low) and own.low < 0.0)
            assert own.above != own.below or has_both_signs, name


def nested():
    """Return two checked functions, of which the second calls a function that it is given."""

    @validation.check_arguments
    def inner(elastic):
        return elastic

    @validation.check_arguments
    def outer(elastic, call):
        return call(elastic)

    return inner, outer


def told(call):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        call()
    return [str(warning.message).split(":")[0] for warning in caught]


def test_only_the_outermost_call_warns():
    inner, outer = nested()
    too_stiff = (1e15, 0.3)
    assert told(lambda: inner(too_stiff)) == ["elastic"]
    assert told(lambda: outer(too_stiff, inner)) == ["elastic"]
    assert told(lambda: outer((2e11, 0.3), lambda _: inner(too_stiff))) == []


def test_the_code_of_a_user_warns_within_a_call():
    inner, outer = nested()

    def question(_):
        with inside_user_code():
            return inner((1e15, 0.3))

    assert told(lambda: outer((2e11, 0.3), question)) == ["elastic"]


def test_functions_of_a_user_warn_in_sweeps_and_comparisons():
    def evaluate(study, preload):
        Material(300.0, 1e9, 1e9)
        return {"answer": 1.0}

    study = bd.lumped(
        1.0, 0.02, 1.0, contacts=[bd.Contact(0, kt=1.0, mu=1.0, preload=1.0)], forces={0: 1.0}
    )
    over = {"damping_factor": [1.0]}
    assert told(lambda: bd.sweep(study, over, evaluate=evaluate)) == ["endurance_limit"]
    # threads do not know the call of the user
    with ThreadPoolExecutor(1) as pool:
        assert told(lambda: bd.sweep(study, over, evaluate=evaluate, executor=pool)) == [
            "endurance_limit"
        ]


@pytest.mark.parametrize("scale", [1.0, 1e-8])
def test_normalised_lumped_models_draw_no_warning_of_units(scale):
    """Preloads below the excitation, or beyond a million times of it, and excitations of any size."""
    contact = bd.Contact(0, {1: 1.0}, kt=1.0, kn=1.0, mu=0.5)
    study = bd.lumped(
        [1.0, 1.0],
        [0.02, 1.0],
        [1.0, 100.0],
        contacts=[contact],
        forces={0: 1.0},
        harmonics=1,
        load_per_preload={1: 1.0},
    )
    interval = (0.05, 0.5)
    with warnings.catch_warnings():
        warnings.simplefilter("error", PlausibilityWarning)
        study.replace(excitation=bd.Excitation("x0", amplitude=scale))
        for preload in (0.3, 1e7):
            study.peak(preload, interval)
            study.static(preload)
            study.optimal_curve(
                [preload, 1.5 * preload, 2.0 * preload], frequency=interval, check=False
            )
            bd.sweep(study, {"preload": [preload]}, frequency=interval)


def names(function, **given):
    """Return the items of the warnings of ``bd.fit`` for a study or a function, without a fit."""

    def call():
        with contextlib.suppress(bd.BdamperError):
            bd.fit(function, [], **given)

    return told(call)


def test_parameters_of_a_function_have_the_ranges_of_that_function():
    """The friction of a joint is a force, for which 200 N is plausible; in a study it would be 200 times the pressure."""

    def joint(frequency=80.0, friction=5.0, friction_coefficient=1.0):
        return bd.joint(frequency, 0.01, 1e3, friction)

    assert names(joint, vary={"friction": (1.0, 200.0), "friction_coefficient": (1.0, 200.0)}) == []
    assert names(joint, vary={"friction": (1.0, 200.0)}, priors={"friction": (100.0, 1e-3)}) == []
    assert names(bd.joint, vary={"friction": (1.0, 200.0)}) == []
    assert names(bd.joint, vary={"damping_ratio": (0.1, 5.0)}) == ["damping_ratio"]


def test_the_deviation_of_a_prior_is_no_value():
    study = bd.lumped(
        1.0, 0.01, 1.0, contacts=[bd.Contact(0, kt=0.25, mu=1.0, preload=0.2)], forces={0: 1.0}
    )
    vary = {"friction_coefficient": (0.1, 1.0)}
    assert names(study, vary=vary, priors={"friction_coefficient": (0.3, 0.01)}) == []
    assert names(study, vary=vary, priors={"friction_coefficient": (30.0, 0.1)}) == [
        "friction_coefficient"
    ]
