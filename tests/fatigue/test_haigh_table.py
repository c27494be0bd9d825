"""Haigh tables of laboratories: files, stress ratios, survival probabilities, temperatures at the points."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm

import bdamper as bd
from bdamper.fatigue import HaighTable, Margins, Material
from bdamper.fatigue.haigh_table import at_points, mean_at_ratio
from bdamper.util.errors import BdamperError, PlausibilityWarning, SettingError
from tests.each import each
from tests.fatigue.test_margins import with_stress

MPA = 1e6
# amplitude at -200, 0, 400 MPa; 20 and 600 °C; a normal scatter of 20 MPa
AT_HALF = {20.0: (420.0, 400.0, 250.0), 600.0: (330.0, 300.0, 100.0)}
MEANS = (-200.0, 0.0, 400.0)
STD = 20.0


def rows(probabilities=(0.5, 0.99865)):
    """Mean, temperature, probability and amplitude of each row, MPa and °C."""
    return [
        (mean, temperature, p, amplitude - STD * norm.ppf(p))
        for temperature, amplitudes in AT_HALF.items()
        for mean, amplitude in zip(MEANS, amplitudes)
        for p in probabilities
    ]


def table(probabilities=(0.5, 0.99865)):
    mean, temperature, p, amplitude = np.array(rows(probabilities)).T
    return HaighTable(MPA * amplitude, MPA * mean, temperature, p)


@pytest.fixture
def material():
    return Material(300e6, 1000e6, 900e6, haigh=table().at_probability(0.5))


def test_a_file(tmp_path):
    lines = ["# a laboratory", "mean (MPa),amplitude (ksi),temperature (K),probability (%),remark"]
    for mean, temperature, p, amplitude in rows():
        lines.append(f"{mean},{amplitude / 6.894757293168:.10f},{temperature + 273.15},{100 * p},x")
    (tmp_path / "haigh.csv").write_text("\n".join(lines))
    found, expected = HaighTable.from_csv(tmp_path / "haigh.csv"), table()
    for name in ("amplitude", "mean", "temperature", "probability"):
        np.testing.assert_allclose(
            getattr(found, name), getattr(expected, name), rtol=1e-8, atol=1e-9
        )
    assert found.source.endswith("haigh.csv")
    assert found.temperatures == pytest.approx([20.0, 600.0])
    assert found.probabilities == pytest.approx([0.5, 0.99865])


def test_a_file_of_stress_ratios(tmp_path):
    """R = -1 has no mean, R = 0 a mean of the amplitude, R = 0.5 three times the amplitude, R = -3 a negative one."""
    text = "R;amplitude (MPa);temperature (°C);probability\n-1;300;20;0,5\n0;200;20;0,5\n0,5;100;20;0,5\n-3;350;20;0,5\n"
    (tmp_path / "haigh.csv").write_text(text)
    found = HaighTable.from_csv(tmp_path / "haigh.csv")
    np.testing.assert_allclose(found.mean, MPA * np.array([0.0, 200.0, 300.0, -175.0]))
    np.testing.assert_allclose(
        mean_at_ratio(np.array(found.amplitude), [-1, 0, 0.5, -3]), found.mean
    )
    steel = Material(250e6, 900e6, 800e6, haigh=found)
    # the limits at the ratios of the tests are those of the tests
    at_ratios = steel.amplitude_at_ratio(np.array([-1.0, 0.0, 0.5, -3.0]), "table")
    np.testing.assert_allclose(at_ratios, found.amplitude, rtol=1e-12)
    # between R = -1 and 0 the line a = 300 - m/2 meets m = a (1 + R)/(1 - R)
    slope = 1.4 / 0.6
    assert steel.amplitude_at_ratio(-0.4, "table") == pytest.approx(300e6 / (1 + 0.5 / slope))


def test_a_file_of_mean_stresses_and_stress_ratios(tmp_path):
    """Rounded ratios agree with the mean stress; a blank one says nothing."""
    head = "R;mean (MPa);amplitude (MPa);temperature (C);probability\n"
    text = f"{head}-1;0;300;20;0.5\n0.33;199;100;20;0.5\n;500;50;20;0.5\n"
    (tmp_path / "haigh.csv").write_text(text)
    found = HaighTable.from_csv(tmp_path / "haigh.csv")
    assert found.mean == pytest.approx([0.0, 199e6, 500e6])


def test_other_lines_at_a_stress_ratio():
    """Goodman and Soderberg in closed form, Gerber by its quadratic equation."""
    limit, ultimate, yields = 300e6, 900e6, 800e6
    steel = Material(limit, ultimate, yields)
    ratio = np.array([-1.0, -0.5, 0.0, 0.1, 0.5])
    q = (1 + ratio) / (1 - ratio)
    np.testing.assert_allclose(
        steel.amplitude_at_ratio(ratio), 1 / (1 / limit + q / ultimate), rtol=1e-12
    )
    soderberg = steel.amplitude_at_ratio(ratio, "soderberg")
    np.testing.assert_allclose(soderberg, 1 / (1 / limit + q / yields), rtol=1e-12)
    gerber = steel.amplitude_at_ratio(ratio, "gerber")
    np.testing.assert_allclose(gerber / limit + (q * gerber / ultimate) ** 2, 1.0, rtol=1e-12)
    with pytest.raises(SettingError, match="R: expected stress ratios below 1"):
        steel.amplitude_at_ratio(1.0)


def test_probabilities_follow_the_normal_scatter():
    """At a probability p the amplitude is the median less 20 MPa for each unit of the normal quantile."""
    for p in (0.5, 0.8, norm.cdf(2.0), 0.99865):
        found = table().at_probability(p)
        assert found.probabilities == pytest.approx([p])
        for temperature, amplitudes in AT_HALF.items():
            expected = MPA * (np.array(amplitudes) - STD * norm.ppf(p))
            at_means = found.allowed(MPA * np.array(MEANS), 1000e6, temperature)
            np.testing.assert_allclose(at_means, expected, rtol=1e-10)


def by_ratio(amplitudes, probabilities=(0.1, 0.9), ratios=(-1.0, 0.0, 0.5)):
    """Table of series at stress ratios, with one tuple of amplitudes (MPa) for each probability."""
    tested = [
        (MPA * amplitude, MPA * amplitude * (1.0 + r) / (1.0 - r), 20.0, p)
        for p, series in zip(probabilities, amplitudes)
        for amplitude, r in zip(series, ratios)
    ]
    return HaighTable(*zip(*tested))


def test_no_tested_mean_stress_is_lost_between_probabilities():
    """At R = 0.5 the series have mean stresses of 360 and 300 MPa, and the middle one 330 MPa."""
    table = by_ratio([(300.0, 200.0, 120.0), (250.0, 170.0, 100.0)])
    for p, mean, amplitude in ((0.1, 360.0, 120.0), (0.9, 300.0, 100.0), (0.5, 330.0, 110.0)):
        allowed = table.at_probability(p).allowed(MPA * mean, 900e6)
        assert allowed == pytest.approx(MPA * amplitude, rel=1e-12)


def test_series_of_different_tests_are_not_interpolated():
    table = by_ratio([(300.0, 200.0, 120.0), (250.0, 100.0)])
    with pytest.raises(
        bd.SettingError, match=r"Haigh table: the rows at .* need the same mean stresses"
    ):
        table.at_probability(0.5)
    assert table.at_probability(0.9).allowed(0.0, 900e6) == pytest.approx(250e6)


def test_neighbouring_probabilities_are_two_series():
    """In the tail of the distribution 1e-5 of the probability is a series of its own."""
    table = by_ratio([(300.0, 200.0, 120.0), (250.0, 170.0, 100.0)], (0.99998, 0.99999))
    for p, amplitude in ((0.99998, 300.0), (0.99999, 250.0)):
        assert table.at_probability(p).allowed(0.0, 900e6) == pytest.approx(MPA * amplitude)


def test_temperatures_of_other_points_are_named(material):
    with pytest.raises(
        SettingError, match=r"temperature: expected one value or one for each point, shape \(3,\)"
    ):
        material.amplitude_at_ratio(np.array([-1.0, 0.0, 0.5]), "table", np.array([20.0, 30.0]))


def test_interpolation_over_mean_stress_and_temperature(material):
    allowed = material.allowed(
        MPA * np.array([-500.0, 100.0, 700.0, 1000.0, 1200.0]), "table", 20.0
    )
    np.testing.assert_allclose(allowed, MPA * np.array([420.0, 362.5, 125.0, 0.0, 0.0]))
    # a quarter of the way from 20 to 600 °C
    middle = material.allowed(100e6, "table", 165.0)
    assert middle == pytest.approx(MPA * (0.75 * 362.5 + 0.25 * 250.0))
    several = material.allowed(100e6, "table", np.array([20.0, 165.0, 600.0]))
    np.testing.assert_allclose(several, MPA * np.array([362.5, 0.75 * 362.5 + 0.25 * 250.0, 250.0]))


def test_factor_on_both_ends_on_the_line(material):
    amplitude = MPA * np.array([50.0, 120.0, 10.0, 0.0])
    mean = MPA * np.array([100.0, 0.0, 300.0, 250.0])
    temperature = np.array([20.0, 300.0, 600.0, 20.0])
    n = material.factor(amplitude, mean, "table", "both", temperature)
    on_line = material.allowed(n[:3] * mean[:3], "table", temperature[:3])
    np.testing.assert_allclose(n[:3] * amplitude[:3], on_line, rtol=1e-12)
    assert n[3] == pytest.approx(4.0)
    alone = material.factor(amplitude[:3], mean[:3], "table", "amplitude", temperature[:3])
    expected = material.allowed(mean[:3], "table", temperature[:3]) / amplitude[:3]
    np.testing.assert_allclose(alone, expected)


def test_a_table_on_the_goodman_line_gives_the_factors_of_goodman():
    line = HaighTable((300e6,), (0.0,), (20.0,), (0.9,))
    steel = Material(300e6, 900e6, 800e6, haigh=line)
    amplitude, mean = np.array([100e6, 50e6, 20e6]), np.array([0.0, 200e6, 700e6])
    for on in ("amplitude", "both"):
        np.testing.assert_allclose(
            steel.factor(amplitude, mean, "table", on), steel.factor(amplitude, mean, "goodman", on), rtol=1e-12
        )  # fmt: skip


@pytest.fixture(scope="module")
def study():
    model = with_stress(bd.reference_model("bladed_disk", 9))
    return bd.Study(model, bd.Excitation("tip", "tangential", 2.0), 5, blade_modes=5)


@pytest.fixture(scope="module")
def peak(study):
    return study.peak(200.0)


@pytest.mark.slow
def test_margins_at_the_temperature_of_each_point(study, peak, material, tmp_path):
    degrees = {"root": 20.0, "root point 2": 450.0}
    margins = study.margin(peak, material, line="table", temperature=degrees)
    at = np.array([20.0, 450.0, 20.0])
    allowed = material.allowed(margins.mean, "table", at)
    np.testing.assert_allclose(margins.factor, allowed / margins.amplitude, rtol=1e-12)
    assert "allowable amplitudes at 20 to 450 °C" in margins.notes
    same = study.margin(peak, material, line="table", temperature=[20.0, 450.0, 20.0])
    np.testing.assert_array_equal(same.factor, margins.factor)
    cold = study.margin(peak, material, line="table", temperature=20.0)
    assert (margins.factor <= cold.factor).all() and margins.factor[1] < cold.factor[1]

    margins.save(tmp_path / "margins.h5")
    again = bd.load(tmp_path / "margins.h5")
    assert isinstance(again, Margins)
    assert again.material == material
    np.testing.assert_array_equal(again.factor, margins.factor)
    margins.plot(tmp_path / "haigh.png")


@pytest.mark.slow
def test_margins_along_a_curve(study, material):
    curve = study.frequency_response(200.0, (285.0, 360.0))
    degrees = {"root": 20.0, "root point 2": 450.0}
    along = study.margin(curve, material, line="table", temperature=degrees)
    at = np.tile([20.0, 450.0, 20.0], (len(curve), 1))
    expected = material.allowed(along.mean, "table", at) / along.amplitude
    np.testing.assert_allclose(along.factor, expected, rtol=1e-12)


@pytest.mark.slow
def test_a_temperature_without_the_table_is_refused(study, peak, material):
    for settings in ({}, {"line": "goodman"}, {"line": "table", "criterion": "findley"}):
        with pytest.raises(SettingError, match="temperature: expected line='table' with"):
            study.margin(peak, material, temperature=20.0, **settings)


@each(
    ("call", "message"),
    [
        (lambda m: m.allowed(0.0, "table"), "temperature: give the temperature of the points, 20 to 600 °C"),
        (lambda m: m.allowed(0.0, "table", 700.0), "temperature: expected 20 to 600 °C, as in the table, found .*700"),
        (lambda m: replace(m, haigh=None).allowed(0.0, "table"), r"line: expected a material with a HaighTable"),
        (lambda m: replace(m, haigh=table()), r"haigh: expected a table of one survival probability .*found 2"),
        (lambda m: replace(m, ultimate_strength=390e6, yield_strength=380e6), "haigh: expected mean stresses below"),
        (lambda m: replace(m, haigh="table"), "haigh: expected a HaighTable"),
        (lambda m: table().at_probability(0.4), r"probability: expected 0\.5 to 0\.99865 at 20 °C, found 0\.4"),
        (lambda m: table().allowed(0.0, 1e9, 20.0), r"Haigh table: expected one probability"),
        (lambda m: HaighTable((1e8, 1e8), (0.0,), (20.0,), (0.5,)), "Haigh table: expected 2 rows each"),
        (lambda m: HaighTable((-1e8,), (0.0,), (20.0,), (0.5,)), "amplitude"),
        (lambda m: HaighTable((1e8,), (0.0,), (-300.0,), (0.5,)), r"temperature: .*> -273\.15 °C"),
        (lambda m: by_ratio([(300.0, 200.0, 120.0), (250.0, 230.0, 100.0)]),
         "Haigh table: expected amplitudes that fall with the survival probability, found one that rises from "
         r"0\.1 to 0\.9 at 20 °C, at a mean stress of 2e\+08 Pa"),
        (lambda m: HaighTable((1e8,), (0.0,), (20.0,), (50.0,)), "probability: expected survival probabilities"),
        (lambda m: HaighTable((1e8, 2e8), (0.0, 0.0), (20.0, 20.0), (0.5, 0.5)), "Haigh table: expected one amplitude"),
        (lambda m: at_points({"fillet": 20.0}, ["root node 3"]), "temperature: the value for 'root node 3'"),
        (lambda m: at_points([20.0], ["root node 3", "root node 4"]), "temperature: expected 2"),
        (lambda m: HaighTable.from_csv({"amplitude (MPa)": [300.0, 200.0], "mean (MPa)": [0.0, 0.0], "R": [-1.0, 0.0],
                                        "temperature (C)": [20.0, 600.0], "probability": [0.5, 0.5]}),
         r"Haigh table, row 2: expected R = -1, as computed from amplitude and mean .*found R = 0"),
        (lambda m: HaighTable.from_csv({"amplitude (MPa)": [1.0]}), "expected the columns amplitude, mean; or"),
        (lambda m: HaighTable.from_csv({"amplitude": [1.0], "R": [0.0], "temperature (C)": [20.0], "probability": [0.5]}),
         "column 'amplitude': expected its unit"),
    ],
)  # fmt: skip
def test_messages(call, message, material):
    with pytest.raises((BdamperError, SettingError), match=message):
        call(material)


def test_a_table_without_temperature_and_probability():
    """Rows of a test at room temperature: at R = -0.2 the mean is 2/3 of the amplitude.

    This line meets the one from 400 MPa at R = -1 to 300 MPa at R = 0, which falls by a third of the
    mean, at 400 / (1 + 2/9) MPa.
    """
    found = HaighTable.from_csv({"R": [-1, 0, 0.5], "amplitude (MPa)": [400, 300, 180]})
    assert set(found.temperature) == {20.0} and set(found.probability) == {0.5}
    alloy = Material(400e6, 1000e6, 900e6, name="alloy", haigh=found)
    assert alloy.amplitude_at_ratio(-0.2, "table") == pytest.approx(400e6 / (1 + 2 / 9), rel=1e-9)
    expected = "temperature: expected 20 to 20 °C, as in the table"
    with pytest.raises((BdamperError, SettingError), match=expected):
        alloy.allowed(0.0, "table", 600.0)


def changed(**columns):
    """A table of one series at two temperatures, with other columns (MPa)."""
    usual = {
        "amplitude (MPa)": [400.0, 250.0, 300.0, 100.0],
        "mean (MPa)": [0.0, 400.0, 0.0, 400.0],
        "temperature (C)": [20.0, 20.0, 600.0, 600.0],
        "probability (%)": [99.0] * 4,
    }
    return HaighTable.from_csv(usual | columns)


@each(
    ("call", "message"),
    [
        (lambda: changed(**{"amplitude (MPa)": [250.0, 400.0, 100.0, 300.0]}),
         "Haigh table: plausible amplitudes that fall with the mean stress, found a rise from 0 to 4e+08 Pa at 20 °C"),
        (lambda: changed(**{"temperature (C)": [600.0, 600.0, 20.0, 20.0]}),
         "Haigh table: plausible amplitudes that fall with the temperature, found a rise from 20 to 600 °C at a mean "
         "stress of 0 Pa"),
        (lambda: Material(30e6, 1000e6, 900e6, haigh=changed()),
         "endurance_limit: plausible 1.5e+08 to 8e+08 Pa, within a factor of 2 of the Haigh table without mean "
         "stress, found 3e+07 Pa"),
    ],
)  # fmt: skip
def test_implausible_tables_are_named(call, message):
    with pytest.warns(PlausibilityWarning) as caught:
        call()
    assert message in str(caught[0].message)


def test_a_plausible_table_is_silent():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for endurance in (150e6, 300e6, 400e6):
            Material(endurance, 1000e6, 900e6, haigh=changed())
        table((0.1, 0.5, 0.9)).at_probability(0.3)
