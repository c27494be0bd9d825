"""What a blade keeps at the optimum of an optimal curve: fields, prints, files, neighbours."""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
import pytest

import bdamper as bd
from bdamper.peaks import marched
from bdamper.util.kept import Kept
from bdamper.util.text import amount
from tests.plain import plain_study


@pytest.fixture(scope="module")
def study():
    return plain_study(bd.reference_model("bladed_disk", 9), bd.Excitation("tip"), 5)


@pytest.fixture(scope="module")
def curve(study):
    return study.optimal_curve((1000.0, 5000.0), 3, frequency=(280.0, 370.0), check=False)


def keeps(problem, tracked):
    """In place of the march: nine tenths of the peak, more at lower preloads."""
    top, p = tracked.peak.amplitude, tracked.preload
    mean = 0.9 * top * (1.0 + 1e-6 * (5000.0 - p))
    return Kept(mean, 0.95 * mean, 1.1 * mean, tracked.peak.frequency, p, top, 1.0, "down", 480, (0, 5), "complete")


def test_by_default_it_is_asked_for_at_the_optimum(study, curve, monkeypatch, tmp_path):
    monkeypatch.setattr(marched.in_time, "kept", keeps)
    found = study.optimal_curve((1000.0, 5000.0), 3, frequency=(280.0, 370.0))
    (one,) = found.kept
    assert found.ladder is None and one.preload == curve.optimum.preload
    assert one.balance == pytest.approx(curve.optimum.amplitude, rel=1e-3)
    assert f"with 1 harmonic; a blade keeps {one.text}." in found.bottom_line() and "a blade keeps" in found.details()
    found.save(tmp_path / "optimal.h5")
    assert bd.load(tmp_path / "optimal.h5").kept == found.kept
    ax = found.plot()[0]
    assert "a blade keeps in time, and range" in ax.get_legend_handles_labels()[1]
    plt.close("all")


def test_neighbours_on_request(study, curve, monkeypatch):
    monkeypatch.setattr(marched.in_time, "kept", keeps)
    found = study.optimal_curve((1000.0, 5000.0), 3, frequency=(280.0, 370.0), check="neighbours")
    best = curve.optimum.preload
    np.testing.assert_allclose([k.preload for k in found.kept], [best / 1.2, best, best * 1.2])
    said, least = found.bottom_line(), found.least_kept
    assert said.count("; a blade keeps") == 3 and said.count("At ") == 2
    assert least.mean == min(k.mean for k in found.kept) and least in found.kept
    at = amount(least.preload, "N")
    ends = least.preload != best
    assert f"Of the preloads where it is known a blade keeps least at {at}{', the last on its side' * ends}" in said
    assert ("least is kept", f"at {at}, {least.text}") in [fact[:2] for fact in found.facts()]
    assert f"least kept, {at}" in found.plot()[0].get_legend_handles_labels()[1]
    plt.close("all")
    low, middle, high = found.kept
    lower = replace(found, kept=(low, replace(middle, mean=0.5 * low.mean), high))
    assert lower.least_kept.preload == best and "the last on its side" not in lower.bottom_line()
    lone = replace(found, kept=(low, replace(middle, mean=np.nan), replace(high, mean=np.nan)))
    assert lone.least_kept is None and "keeps least" not in lone.bottom_line()
    for i, doubt in ((1, "incomplete: its mean still changes"), (1, "interrupted"), (0, "not found: no motion stays")):
        open_ = [low, replace(middle, mean=0.5 * low.mean), replace(high, mean=0.4 * low.mean)]
        for least, last in ((2, open_), (1 - i, [*open_[:2], replace(high, mean=2.0 * low.mean)])):
            kept = [replace(k, status=doubt) if j == i else k for j, k in enumerate(last)]
            at = amount(kept[least].preload, "N")
            assert f"keeps least at {at}, the last on its side: less" in replace(found, kept=tuple(kept)).bottom_line()


def test_what_cannot_be_marched_says_why(study, curve, monkeypatch):
    """One basis for several nodal diameters is no structure in time."""
    shared = study.with_(single_basis=True, harmonics=2)
    monkeypatch.setattr(marched, "_matching", lambda problem, curve: problem)
    (found,) = marched.with_kept(shared, replace(curve, kept=())).kept
    assert found.status.startswith("not found: ") and "single_basis" in found.status and np.isnan(found.mean)
    with pytest.raises(bd.SettingError, match=r"^check: expected .*, found 'ladder'"):
        study.optimal_curve((1000.0, 5000.0), 3, check="ladder")


def test_the_bottom_line_says_what_is_open(study, curve):
    best = curve.optimum
    known = Kept(9e-6, 8e-6, 1e-5, 300.0, best.preload, 1e-5, periods=9, status="incomplete: some steps failed")
    assert "(8 to 10), incomplete: some steps failed." in replace(curve, kept=(known,)).bottom_line()
    none = Kept(*(np.nan,) * 4, best.preload, 1e-5, status="not found: no motion stays")
    said = replace(curve, kept=(none,)).bottom_line()
    assert f"At {amount(best.preload, 'N')} it is not known what a blade keeps, so" in said
    assert "nothing confirms the peak of the harmonic balance: no motion stays." in said
