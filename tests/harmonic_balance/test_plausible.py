"""Values that nothing built has draw one warning each, with the plausible range and what was found; shipped scenes none."""

import warnings
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import bdamper as bd
from bdamper.harmonic_balance.checks import check_interval
from bdamper.util import plausible_ranges
from bdamper.util.errors import PlausibilityWarning


def study(name="bladed_disk", points=9, **settings):
    model = bd.reference_model(name, points)
    order = 5 if model.n_blades > 1 else 0
    given = {"engine_order": order, "friction_coefficient": 0.4, "excitation": bd.Excitation("tip")}
    return bd.Study(model, **(given | settings))


def test_intervals_in_radians_per_second_and_loads_of_another_size_are_named():
    s = study()
    expected = (
        r"frequency: .* 283\.08 Hz, found \(1700, 1850\) without a resonance; divided by 2 pi"
    )
    with pytest.warns(PlausibilityWarning, match=expected):
        s.free((1700.0, 1850.0))
    with pytest.warns(PlausibilityWarning, match=r"frequency: plausible"):
        s.frequency_response(2000.0, (1700.0, 1850.0), options=bd.ContinuationOptions(budget=20))
    strong = study(excitation=bd.Excitation("tip", amplitude=1e4))
    with pytest.warns(
        PlausibilityWarning,
        match=r"preload: plausible 1e\+04 to .* the excitation .*, found 2000 N; possibly given in kN",
    ):
        strong.frequency_response(2000.0, (340.0, 350.0), options=bd.ContinuationOptions(budget=20))
    with pytest.warns(PlausibilityWarning, match=r"preload: .* found 20 to 200 N"):
        plausible_ranges.check("Study", "preload", [20.0, 200.0], strong.problem.sizes)


# modes that lie in the interval as given and respond, by their frequencies in the comment
IN_HERTZ = [
    ("shrouded_blade", 4, (1100.0, 2400.0)),  # 1187, 1373, 1785 Hz, and 284 Hz in rad/s
    ("paper_disk", 5, (1380.0, 2000.0)),  # 1393 Hz, stuck 1438 Hz, and 263 Hz in rad/s
]


@pytest.mark.slow
@pytest.mark.parametrize(("name", "order", "interval"), IN_HERTZ)
def test_an_interval_around_higher_modes_is_not_suspected_of_radians_per_second(
    name, order, interval
):
    """The second bending mode of a blade lies near 2 pi times the first, as that of a cantilever."""
    s = bd.Study(
        bd.reference_model(name), bd.Excitation("tip"), order, contact_stiffness="unit_traction"
    )
    with warnings.catch_warnings():
        warnings.simplefilter("error", PlausibilityWarning)
        check_interval(s.problem.at(100.0), interval)


@pytest.mark.slow
def test_a_range_is_named_once_at_the_line_of_the_user_and_not_for_each_of_its_preloads():
    interval, quick = (
        (270.0, 380.0),
        {"harmonics": 1, "contact_stiffness": "unit_traction", "blade_modes": 5},
    )
    with warnings.catch_warnings():
        warnings.simplefilter("error", PlausibilityWarning)
        study(**quick).optimal_curve((0.3, 5000.0), 2, frequency=interval, check=False)
    weak = study(**quick, excitation=bd.Excitation("tip", amplitude=1e-4))  # stuck, so quick
    with (
        ThreadPoolExecutor(2) as threads,
        pytest.warns(PlausibilityWarning, match=r"found 2000 to 3000 N") as caught,
    ):
        bd.sweep(weak, {"preload": [2000.0, 3000.0]}, frequency=interval, executor=threads)
    assert len(caught) == 1 and caught[0].filename == __file__


SHIPPED = [("bladed_disk", 9), ("bladed_disk", 24), ("blade_to_ground", 24), ("test_rig", 24)]


@pytest.mark.slow
@pytest.mark.parametrize(("name", "points"), SHIPPED)
def test_shipped_scenes_are_plausible(name, points):
    """The models with the settings of the examples, around their first modes, and ranges of preloads."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", PlausibilityWarning)
        for mu in (0.1, 0.4, 0.7):
            s = study(name, points, friction_coefficient=mu, contact_stiffness=2e7)
        s = study(name, points)
        preload = 1000.0 if s.problem.carries_load else 0.0
        omega2 = s.problem.modal_bases[1].omega2
        for f in np.sqrt(omega2[omega2 > 0.0][:6]) / (2.0 * np.pi):
            check_interval(s.problem.at(preload), (0.9 * f, 1.1 * f))
        plausible_ranges.check("Study", "preload", [10.0, 25e3], s.problem.sizes)
        plausible_ranges.check("Study", "preload", preload, s.problem.sizes)


def test_engine_order_0_of_a_wheel_is_named():
    with pytest.warns(
        PlausibilityWarning, match="engine_order: plausible 1 to 32, found 0; a force"
    ) as caught:
        study(engine_order=0)
    assert len(caught) == 1
    with warnings.catch_warnings():
        warnings.simplefilter("error", PlausibilityWarning)
        study("blade_to_ground", 24)  # one blade, without orders


ASKED = {
    "peak": lambda s, band: s.peak(200.0, band),
    "peak of the mode": lambda s, band: s.peak(200.0, mode=1 if band[0] < 400.0 else 2),
    "frequency_response": lambda s, band: s.frequency_response(200.0, band),
    "free": lambda s, band: s.free(band),
    "optimal curve": lambda s, band: s.optimal_curve([200.0, 400.0], frequency=band, check=False),
}


@pytest.mark.slow
@pytest.mark.parametrize(
    "asked",
    [
        pytest.param(a, marks=[pytest.mark.slow] * (a not in ("peak of the mode", "free")))
        for a in ASKED
    ],
)
def test_a_force_across_the_motion_of_the_mode_is_named(asked):
    """Mode 1 is tangential, mode 2 axial, by their shapes at the tip in the model."""
    model = bd.reference_model("bladed_disk", 9)
    basis = model.bodies["blade"].bases[5]
    shape = np.abs(basis.locations["tip"][:, :2])
    along = dict(zip(("tangential", "axial"), (shape / np.linalg.norm(shape, axis=0))[[0, 2]]))
    axes = {d: bd.Excitation("tip", d) for d in along}
    for mode, band in ((0, (230.0, 410.0)), (1, (640.0, 760.0))):
        for direction, share in along.items():
            s = study(excitation=axes[direction], harmonics=1, contact_stiffness="unit_traction")
            with warnings.catch_warnings(record=True) as caught:
                warnings.simplefilter("always")
                ASKED[asked](s, band)
            told = [str(w.message) for w in caught if "excitation direction" in str(w.message)]
            across = share[mode] < 0.12
            assert len(told) == across and across == ((mode, direction) == (0, "axial"))
            assert (
                not across
                or f"found axial at 'tip', with at most {100.0 * share[mode]:.2g} % of the motion of these modes"
                in told[0]
            )
