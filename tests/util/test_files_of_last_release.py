"""A file of each kind that version 0.10.0 wrote is read, with its values, or refused in one line that names the version.

`tests/files/version_0_10_0.zip` contains files that version 0.10.0 saved, of two masses with a contact and of small arrays,
and `values.json`: the class of each and the sums of the finite absolute values of some arrays, as that version read them.
"""

import json
import zipfile
from pathlib import Path

import numpy as np
import pytest

import bdamper as bd
from tests.each import each

ARCHIVE = Path(__file__).parents[1] / "files" / "version_0_10_0.zip"
with zipfile.ZipFile(ARCHIVE) as archive:
    VALUES = json.loads(archive.read("values.json"))

REFUSED = {"accuracy_cost"}
"""Kinds without the errors that a result of today has."""
KNOWN = "amplitude", "frequency", "preload", "margin", "damping_ratio", "deviation"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("version_0_10_0")
    with zipfile.ZipFile(ARCHIVE) as archive:
        archive.extractall(folder)
    return folder


@each("name", sorted(set(VALUES) - REFUSED - {"incomplete_peak"}))
def test_a_file_is_read_and_printed(folder, name):
    result = bd.load(folder / f"{name}.h5")
    assert type(result).__name__ == VALUES[name]["class"]
    assert str(result)
    for value in KNOWN:
        if value in VALUES[name] and VALUES[name]["class"] != "Fitted":
            numbers = np.asarray(getattr(result, value), float)
            total = np.abs(numbers[np.isfinite(numbers)]).sum()
            assert total == pytest.approx(VALUES[name][value], rel=1e-12), value


@each("name", sorted(REFUSED))
def test_a_refused_file_names_its_version_in_one_line(folder, name):
    with pytest.raises(
        bd.BdamperError, match=r"written by bdamper 0\.10\.0.*compute it again"
    ) as found:
        bd.load(folder / f"{name}.h5")
    assert "\n" not in str(found.value)


def test_the_end_of_an_incomplete_search_is_a_lower_bound(folder):
    """Version 0.10 stored it as the amplitude."""
    peak = bd.load(folder / "incomplete_peak.h5")
    assert peak.status == "incomplete" and np.isnan(peak.amplitude)
    assert peak.lower_bound == pytest.approx(VALUES["incomplete_peak"]["amplitude"], rel=1e-12)


def test_the_peaks_with_other_friction_have_no_lower_bound(folder):
    curve = bd.load(folder / "optimal_curve.h5")
    assert [peak.factor for peak in curve.other_friction] == [1.0, 0.7, 1.3]
    assert np.isnan([peak.lower_bound for peak in curve.other_friction]).all()
    assert curve.optimum.amplitude == pytest.approx(0.5357969002959815, rel=1e-12)
