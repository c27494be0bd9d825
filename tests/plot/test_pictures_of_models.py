"""Reports of shipped models, and pictures that a result cannot have."""

from types import SimpleNamespace

import pytest

import bdamper as bd
from bdamper.plot.report import _band_around_peaks
from bdamper.util.display import draw
from tests.every_result import result as made


@pytest.mark.slow
def test_the_report_of_a_shrouded_blade(tmp_path):
    """The stuck frequency is several times the free one."""
    loads = {"load_per_preload": {"front": 1.0, "rear": 1.0}}
    study = bd.Study(
        bd.reference_model("shrouded_blade"), bd.Excitation("tip"), 4, harmonics=1, **loads
    )
    curve = study.optimal_curve((100.0, 400.0), 3, check=False)
    path = curve.report(tmp_path / "review.html", study)
    assert path.read_text().count("<img") >= 3


def test_the_band_of_a_report_is_positive():
    def limit(frequency):
        return SimpleNamespace(frequency=frequency)

    curve = SimpleNamespace(free=limit(230.0), stuck=limit(1220.0), optimum=limit(1100.0))
    low, high = _band_around_peaks(curve)
    assert 0.0 < low < 230.0 and high > 1220.0


def test_the_dissipation_of_one_solution_is_refused():
    with pytest.raises(
        bd.SettingError, match="dissipation: expected a result of several solutions"
    ):
        draw(made("hysteresis"), "dissipation")
