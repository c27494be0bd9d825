"""What a user gives is checked at once, by name: bad values of every kind of setting and argument."""

import re
from dataclasses import astuple, dataclass, fields, replace
from functools import partial
from typing import Annotated, Literal

import numpy as np
import pytest

import bdamper as bd
from bdamper import plot as plotting
from bdamper.fatigue.criteria import Material
from bdamper.fatigue.haigh_table import HaighTable
from bdamper.fatigue.margin import Rule
from bdamper.fem import ElasticMaterial, Geometry
from bdamper.fem.local_basis import LocalSizes
from bdamper.harmonic_balance.settings import Settings
from bdamper.importers import Checks, Placement, Reduction, Sector, Units
from bdamper.mistuning import DiskPeakOptions
from bdamper.plot.motion import contact_status, rigid_motion
from bdamper.util import validation
from tests.each import each
from tests.plain import plain_study

WRONG = "5", object(), [object()]
"""What no number, choice, flag, sequence or option is."""


@pytest.mark.parametrize("value", [2, 2.0, np.float32(2.0), np.int64(2), np.array(2.0)])
def test_numbers_pass_in_every_form(value):
    out = validation.number("n", value, above=1.0, most=2.0)
    assert out == 2.0
    assert type(out) is float
    whole = validation.integer("n", value, least=2, most=2)
    assert whole == 2
    assert type(whole) is int


@each("value", ["2", None, True, np.True_, np.nan, np.inf, [2.0], np.array([2.0]), 2j, 10**400])
def test_other_things_are_no_numbers(value):
    for check in (validation.number, validation.integer):
        with pytest.raises(bd.SettingError, match=r"n: expected a (finite|whole) number.*, found "):
            check("n", value)


def test_limits_are_in_the_message():
    for limits, good, bad, words in [
        ({"above": 0.0}, 1e-9, 0.0, "a finite number > 0 N, found 0.0"),
        ({"least": 0.0}, 0.0, -1.0, "a finite number >= 0 N, found -1.0"),
        ({"above": 0.0, "below": 1.0}, 0.5, 1.0, "a number between 0 and 1 N, found 1.0"),
        ({"above": 0.0, "most": 1.0}, 1.0, 1.1, "a finite number > 0 and <= 1 N, found 1.1"),
    ]:
        assert validation.number("p", good, unit="N", **limits) == good
        with pytest.raises(bd.SettingError) as error:
            validation.number("p", bad, unit="N", **limits)
        assert str(error.value) == f"p: expected {words}"


@pytest.mark.parametrize(
    ("check", "good", "bad"),
    [
        (validation.flag, True, ["yes", 1, None]),
        (lambda n, v: validation.choice(n, v, ("a", "b")), "a", ["c", 1, None, ["a"]]),
        (
            lambda n, v: validation.names(n, v, ("a", "b"), least=1),
            ("b",),
            ["a", ("a", "a"), ("c",), (1,), (), None, ([],)],
        ),
        (
            lambda n, v: validation.instance(n, v, bd.Excitation),
            bd.Excitation("tip"),
            ["tip", None, bd.Excitation],
        ),
        (
            lambda n, v: validation.mapping(n, v, ("a",), "faces"),
            {"a": 1},
            [("a", 1), {"b": 1}, None],
        ),
        (
            lambda n, v: validation.interval(n, v),
            (1.0, 2.0),
            [1.0, (2.0, 1.0), (0.0, 1.0), (1.0,), "12", ("1", "2"), None],
        ),
        (
            lambda n, v: validation.integers(n, v, most=9),
            (1, 2),
            [1, "12", (1.5,), (10,), (1, 1), None],
        ),
    ],
)
def test_checks_return_what_is_good_and_name_what_is_not(check, good, bad):
    assert check("thing", good) == good
    for value in bad:
        with pytest.raises(bd.SettingError, match=r"thing: expected .*, found "):
            check("thing", value)


def test_sequences_of_numbers():
    np.testing.assert_array_equal(validation.numbers("f", [1, 2.0, np.float32(3)]), [1.0, 2.0, 3.0])
    assert validation.numbers("f", np.arange(3.0), 3).dtype == float
    for value in (
        "123",
        1.0,
        None,
        [],
        [1.0, "2"],
        [[1.0, 2.0, 3.0]],
        [1.0, np.nan],
        np.eye(3),
        np.array(1.0),
    ):
        with pytest.raises(
            bd.SettingError, match="f: expected a sequence of one or more finite numbers"
        ):
            validation.numbers("f", value)
    with pytest.raises(bd.SettingError) as caught:
        validation.numbers("f", [1.0, 2.0, 0.0], 3, above=0.0, unit="N")
    assert str(caught.value) == "f: expected 3 finite numbers > 0 N, found [1.0, 2.0, 0.0]"
    for wrong, shown in ((None, "None"), ("a", "'a'"), (-1.0, "-1.0")):
        # one wrong value in a long sequence is shown with its index
        with pytest.raises(bd.SettingError) as caught:
            validation.numbers("f", [1.0] * 5 + [wrong] + [1.0] * 4, 10, above=0.0)
        assert str(caught.value) == f"f: expected 10 finite numbers > 0, found {shown} at index 5"


def test_long_things_are_not_printed_whole():
    with pytest.raises(bd.SettingError) as error:
        validation.number("k", np.zeros((500, 3)))
    assert str(error.value).endswith("found an array of shape (500, 3)")


# ---- settings of a study ----


@pytest.fixture(scope="module")
def study():
    model = bd.reference_model("bladed_disk", contact_points=9)
    return plain_study(model, bd.Excitation("tip"), engine_order=5, friction_coefficient=0.4)


@each("value", WRONG)
@each("name", [field.name for field in fields(Settings)])
def test_every_setting_of_a_study_is_checked(study, name, value):
    with pytest.raises(bd.BdamperError, match=rf"^{name}.*: .*expected"):
        study.replace(**{name: value})


@each(
    ("name", "value"),
    [
        *((name, None) for name in (
            "bias", "excitation", "friction_coefficient", "harmonics", "rigid_modes", "contact_forces", "friction_law",
        )),
        ("bias", 1), ("friction_coefficient", [0.3, 0.4]), ("friction_coefficient", {"left": "0.3", "right": 0.3}),
        ("friction_coefficient", True), ("engine_order", 2.5), ("engine_order", True),
        ("harmonics", 2.5), ("harmonics", (1, "2")), ("blade_modes", 0), ("damper_modes", 1000),
        ("rigid_modes", ("TX", "TX")), ("rigid_modes", ("QX",)), ("contact_stiffness", [1e7]),
        ("contact_stiffness", np.nan), ("contact_stiffness", {"left": 1e7}),
        ("contact_stiffness", {"left": "1", "right": 1.0}), ("contact_stiffness", "model"),
        ("contact_stiffness_factor", 0.0), ("contact_forces", 128), ("friction_law", {"left": "x", "right": "x"}),
        ("friction_law", 1), ("damping_ratio", 1.0), ("contact_points", 0), ("gap", 1e-6), ("gap", {"left": "wide"}),
        ("gap", {"left": np.zeros(4)}), ("gap", ()), ("load_history", 1.0), ("load_history", ()), ("load_history", (2.0,)),
    ],
)  # fmt: skip
def test_a_study_refuses_bad_settings_at_once(study, name, value):
    with pytest.raises(bd.SettingError, match=rf"^{name}.*: .*(expected|the model has none)"):
        study.replace(**{name: value})


def test_too_few_samples_for_the_harmonics_are_refused_at_once(study):
    with pytest.raises(
        bd.SettingError, match="AFT with at least 24 samples for 5 harmonics, found 16"
    ):
        study.replace(harmonics=5, contact_forces=bd.AFT(16))
    few = study.replace(contact_forces=bd.AFT(16))
    with pytest.raises(bd.SettingError, match="contact_forces: expected"):
        few.replace(harmonics=5)


OPTIONS = (
    bd.AFT(), bd.ContinuationOptions(), bd.Excitation("tip"), bd.OptimalTask(), bd.PeakOptions(),
    bd.PeakTask(), bd.PerArea(1e12), bd.ResidualModes(), bd.Response("tip"), LocalSizes(), Material(3e8, 9e8, 8e8),
    ElasticMaterial(),
    Rule(), Units(), DiskPeakOptions(), Sector(), Placement(), Reduction(), Checks(), Geometry(),
    HaighTable((2e8,), (0.0,), (20.0,), (0.5,)),
)  # fmt: skip
FREE = {"name", "source", "location", "shroud", "beside", "fixed", "blade_nodes", "stress"}
"""Texts, names that the model knows, further excitations, and node sets, which are checked with the mesh."""


@each("value", WRONG)
@each(
    ("option", "name"),
    [
        (option, f.name)
        for option in OPTIONS
        for f in fields(option)
        if f.init and f.name not in FREE
    ],
)
def test_every_field_of_options_is_checked(option, name, value):
    with pytest.raises(bd.SettingError, match=rf"{name.replace('_', '.')}.*: expected .*, found "):
        replace(option, **{name: value})


def test_all_kinds_of_options_are_checked_here():
    kinds = {
        kind.__name__
        for kind in validation.Checked.__subclasses__()
        if kind.__module__.startswith("bdamper.")
    }
    assert kinds <= {type(option).__name__ for option in OPTIONS} | {
        "LeastMargin",
        "MeasuredResponse",
    }


@each(
    "make",
    [
        *(lambda kind=kind, n=n, v=v: kind(**{n: v}) for kind, cases in {
            bd.ContinuationOptions: [
                ("corner_step", -1), ("step", 1.0), ("patience", 1),
            ],
            bd.PeakOptions: [("tolerance", 0.0), ("max_trials", 1)],
            bd.ResidualModes: [("n_vectors", 0), ("contact_share", 0.0)],
        }.items() for n, v in cases),
        *(lambda v=v: bd.PerArea(v) for v in [-1, np.nan, None, (1.0, 2.0), (1.0, 2.0, "3")]),
        *(lambda v=v: bd.AFT(v) for v in [10**9, 4, 12.5, None]),
        *(lambda n=n, v=v: bd.Excitation(**{"location": "tip", n: v}) for n, v in [
            ("location", 1), ("direction", (0.0, 0.0, 0.0)), ("direction", None), ("amplitude", -1.0),
        ]),
        lambda: bd.Response(None),
        lambda: bd.Response("tip", (1.0, "x", 0.0)),
    ],
)  # fmt: skip
def test_options_refuse_bad_values_at_once(make):
    with pytest.raises(bd.SettingError, match=r": expected .*, found "):
        make()


def double(name, value):
    return 2.0 * validation.number(name, value)


@dataclass(frozen=True)
class Base(validation.Checked):
    force: validation.Force = 1.0
    doubled: Annotated[float, double] = 1.0
    kind: Literal["a", "b"] = "a"


@dataclass(frozen=True)
class Options(Base):
    count: validation.Count | None = None
    on: bool = True
    free: float = 0.0
    text: Annotated[Literal["x", "y"], partial(validation.choice, choices=("x",))] = "x"


def test_fields_are_checked_as_they_are_annotated():
    made = Options(np.float32(2.0), 3, "b", np.int64(4), np.True_, "anything")
    assert made == Options(2.0, 3.0, "b", 4, True, "anything")
    assert [type(value) for value in astuple(made)] == [float, float, str, int, bool, str, str]
    assert made.doubled == 6.0
    assert Options().count is None


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"force": -1.0}, "force: expected a finite number >= 0 N, found -1.0"),
        ({"force": None}, "force: expected a finite number >= 0 N, found None"),
        ({"doubled": "1"}, "doubled: expected a finite number, found '1'"),
        ({"kind": "c"}, "kind: expected one of ('a', 'b'), found 'c'"),
        ({"count": 0}, "count: expected a whole number >= 1, found 0"),
        ({"on": 1}, "on: expected True or False, found 1"),
        ({"text": "y"}, "text: expected one of ('x',), found 'y'"),
    ],
)
def test_a_field_that_does_not_fit_its_annotation_is_named(given, words):
    with pytest.raises(bd.SettingError, match=f"^{re.escape(words)}$"):
        Options(**given)


def test_a_prefix_stands_before_the_names_of_fields():
    with pytest.raises(
        bd.SettingError, match=r"^excitation amplitude: expected a finite number >= 0 N, found -1"
    ):
        bd.Excitation("tip", amplitude=-1)


# ---- arguments ----

F = (270.0, 380.0)


@each(
    "ask",
    [
        lambda s: s.frequency_response(None, F), lambda s: s.frequency_response(9.0, "ab"),
        lambda s: s.frequency_response(9.0, F, options=bd.PeakOptions()), lambda s: s.free("low"), lambda s: s.static("a"),
        lambda s: s.static(5.0, history="up"), lambda s: s.wedge_friction(None), lambda s: s.peak(9.0, mode=0),
        lambda s: s.optimal_curve((20.0, 25e3), F), lambda s: s.optimal_curve((25e3, 20.0)),
        lambda s: s.effect_significance(9.0, F, against="all"), lambda s: s.motion_in_time(None),
        lambda s: s.refine(None), lambda s: s.estimate_errors(None), lambda s: s.peak_sensitivities("peak"),
        lambda s: bd.compare({}, len), lambda s: bd.compare({"a": s, "b": {"frictoin": 1}}, len),
        lambda s: bd.compare({"a": s}, str), lambda s: bd.accuracy_cost(s, 9.0, F, vary=()),
        lambda s: bd.accuracy_cost(s, 9.0, F, quantity="x"), lambda s: bd.sweep(s, {"preload": [1.0]}, "peak"),
        lambda s: bd.sweep(s, {"preload": [1.0]}, executor="threads"), lambda s: bd.sweep(s, {"preload": ["a"]}),
        lambda s: bd.sweep(s, {"preload": 5.0}), lambda s: bd.sweep(s, {"preload": [1.0]}, model="m"),
        lambda s: bd.PeakTask("9"), lambda s: bd.microslip(s, 9.0, [1.0], location="x"),
        lambda s: bd.face_gap(s.model.interfaces["left"], angle="x"), lambda s: bd.face_gap("left"),
    ],
)  # fmt: skip
def test_calls_refuse_bad_arguments(study, ask):
    with pytest.raises(bd.SettingError, match=r": .*(expected .*, found| argument )"):
        ask(study)


def test_calls_on_results_refuse_bad_arguments(study):
    curve, peak = study.frequency_response(1000.0, F), study.peak(1000.0, F)
    for ask in (
        lambda: study.peak_sensitivities(peak, ["mu"]),
        lambda: study.peak_sensitivities(peak, "preload"),
        lambda: study.peak_sensitivities(curve),
        lambda: study.with_stability(curve, in_time="yes"),
        lambda: study.motion_in_time(curve, index=10**6),
        lambda: study.estimate_errors(curve, sources="harmonics"),
    ):
        with pytest.raises(bd.SettingError, match=r": .*(expected .*, found| argument )"):
            ask()


@pytest.mark.slow
def test_files_that_cannot_be_named(study, tmp_path):
    curve = study.free(F)
    for save in (curve.save, lambda path: bd.save_model(study.model, path)):
        with pytest.raises(
            bd.BdamperError, match=r"a\.h5: expected an existing folder, found no '.*nowhere'"
        ):
            save(tmp_path / "nowhere" / "a.h5")
    (tmp_path / "folder").mkdir()
    for use in (bd.load, bd.load_model, lambda path: bd.save_model(study.model, path)):
        with pytest.raises(bd.BdamperError, match=r"folder: expected .*, found a folder"):
            use(tmp_path / "folder")
    with pytest.raises(FileNotFoundError, match=r"^there is no file '.*zz\.h5'$"):
        bd.load(tmp_path / "zz.h5")


@pytest.fixture(scope="module")
def tracked(study):
    return study.frequency_response(1000.0, F)


@each(
    "draw",
    [
        lambda s, c, st: plotting.plot_status_map(st, s.model, "lft"),
        lambda s, c, st: plotting.plot_status_map(st, s.model, "left", direction=3),
        lambda s, c, st: plotting.plot_status_bars(st, [500]),
        lambda s, c, st: plotting.plot_status_bars(st, 5),
        lambda s, c, st: plotting.plot_status_bars(st, [0], direction=2),
        lambda s, c, st: plotting.plot_mode(s.model, "mode.png"),
        lambda s, c, st: plotting.plot_curves([c, c], labels=["a"]),
        lambda s, c, st: plotting.plot_curves([c, None]),
        lambda s, c, st: plotting.plot_curves(c),
        lambda s, c, st: plotting.plot_curve([c]),
        lambda s, c, st: plotting.plot_optimal(c),
        lambda s, c, st: plotting.plot_model(s),
        lambda s, c, st: bd.sweep(c, {"preload": [100.0]}),
        lambda s, c, st: bd.accuracy_cost(c, 100.0),
        lambda s, c, st: contact_status(s, c.unknowns[0, 1:], 1000.0),
        lambda s, c, st: rigid_motion(s, "unknowns"),
    ],
)
def test_pictures_refuse_what_they_cannot_draw(study, tracked, draw):
    status = contact_status(study, tracked.unknowns[0], 1000.0)
    with pytest.raises(bd.SettingError, match=r": expected .*, found "):
        draw(study, tracked, status)


def test_a_load_whose_motions_are_left_out_is_named(study):
    still = study.replace(rigid_modes=())
    for ask in (lambda: still.static(10.0), lambda: still.optimal_curve((10.0, 100.0), 3)):
        with pytest.raises(
            bd.SettingError,
            match=r"the study omits the motions of \['damper'\] along the load",
        ):
            ask()
    assert still.static(0.0).ok


def test_keys_of_a_mapping_may_be_an_iterator():
    assert validation.mapping("x", {"b": 1}, (k for k in "ab"), "faces") == {"b": 1}
