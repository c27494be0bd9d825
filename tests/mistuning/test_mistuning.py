"""Deviations of blades and dampers: from arrays, files and draws, saved, refused."""

import numpy as np
import pytest

import bdamper as bd
from bdamper.mistuning import DamperVariation, Mistuning
from tests.printed import said


def test_stiffness_follows_the_square_of_the_frequency():
    one = Mistuning([0.05, -0.02, 0.0])
    modes, rest = one.by_mode(4)
    assert np.allclose(1.0 + rest, [1.05**2, 0.98**2, 1.0], rtol=1e-15)
    assert modes.shape == (3, 4) and np.array_equal(modes[:, 3], rest)


def test_modes_that_are_not_given_have_the_mean_of_those_that_are():
    one = Mistuning([[0.01, 0.03], [0.0, 0.0]])
    modes, rest = one.by_mode(3)
    change = np.array([1.01**2, 1.03**2]) - 1.0
    assert np.allclose(modes[0], [*change, change.mean()]) and np.isclose(rest[0], change.mean())
    with pytest.raises(
        bd.SettingError, match="the model has 1 cantilever modes, found deviations of 2 modes"
    ):
        one.by_mode(1)


def test_measured_frequencies(tmp_path):
    path = tmp_path / "blades.csv"
    path.write_text(
        "# bench, clamped\nBlade, first (Hz), second (Hz)\n3,102,300\n1,98,297\n2,100,303\n"
    )
    one = Mistuning.from_csv(path)
    assert np.allclose(one.deviation, [[-0.02, -0.01], [0.0, 0.01], [0.02, 0.0]])
    kept = Mistuning.from_csv(path, reference=[100.0, 297.0])
    assert np.isclose(kept.deviation[0, 1], 0.0) and kept.deviation[:, 1].mean() > 0.009
    path.write_text("f (Hz)\n98;\n")
    with pytest.raises(
        bd.BdamperError, match=r"blades.csv: expected one row of frequencies .* row 0, column 2"
    ):
        Mistuning.from_csv(path)
    path.write_text("blade,f (Hz)\n1,98\n1,99\n")
    with pytest.raises(
        bd.BdamperError, match=r"column 'blade': expected each number from 0 or 1 once"
    ):
        Mistuning.from_csv(path)
    path.write_text("f (Hz)\n98\n-1\n")
    with pytest.raises(bd.BdamperError, match="frequencies above 0 Hz"):
        Mistuning.from_csv(path)
    for text, found in (
        ("98\n99\n", "no header with units, such as 'blade,mode"),
        ("blade,f\n1,98\n", "'f'.* no unit"),
    ):
        path.write_text(text)
        with pytest.raises(bd.BdamperError, match=found):
            Mistuning.from_csv(path)
    path.write_text("f (kHz)\n0.098\n0.1\n")
    assert np.allclose(Mistuning.from_csv(path, reference=100.0).deviation, [-0.02, 0.0])


def test_draws_are_reproducible_and_scale():
    one, again = (Mistuning.random(24, 0.03, seed=(7, 2)) for _ in range(2))
    assert np.array_equal(one.deviation, again.deviation) and one.seed == (7, 2)
    assert np.allclose(Mistuning.random(24, 0.01, seed=(7, 2)).deviation, one.deviation / 3.0)
    assert not np.array_equal(one.deviation, Mistuning.random(24, 0.03, seed=(7, 3)).deviation)
    many = Mistuning.random(100_000, 0.03, "uniform")
    assert np.isclose(many.deviation.std(), 0.03, rtol=5e-3) and np.abs(
        many.deviation
    ).max() <= 0.03 * np.sqrt(3.0)
    assert abs(one.without_mean().deviation.mean()) < 1e-17
    pattern = Mistuning([[0.01, 0.02], [0.03, -0.02], [0.02, 0.0]])
    taken = Mistuning.random(50, 0.05, pattern, seed=1)
    rows = pattern.without_mean().deviation / pattern.without_mean().deviation.std() * 0.05
    assert all(any(np.allclose(row, r) for r in rows) for row in taken.deviation)


def test_dampers():
    one = DamperVariation.random(1000, mass=0.1, gap=1e-6, missing=[3], seed=4)
    assert np.isclose(one.mass.std(), 0.1, rtol=0.1) and np.all(one.friction_coefficient == 1.0)
    assert one.missing.sum() == 1 and one.missing[3] and np.isclose(one.gap.mean(), 1e-6, rtol=0.1)
    with pytest.raises(
        bd.SettingError, match="missing: expected a whole number from 0 to 4, found 5"
    ):
        DamperVariation.of(5, missing=[5])
    with pytest.raises(bd.SettingError, match="mass: expected 5 finite numbers > 0"):
        DamperVariation.of(5, mass=[1.0, 2.0])


@pytest.mark.parametrize("bad", [np.nan, [[[0.1]]], [0.1, np.inf], [-1.5], "0.1", []])
def test_what_is_no_deviation_is_refused(bad):
    with pytest.raises(bd.SettingError, match="finite frequency deviations above -1"):
        Mistuning(bad)


def test_files(tmp_path):
    by_mode = Mistuning(np.linspace(-0.02, 0.03, 18).reshape(6, 3), "a file", (1, 2))
    for one in (
        Mistuning.random(6, 0.02, seed=(1, 2)),
        by_mode,
        DamperVariation.random(6, mass=0.1, missing=[0], seed=3),
    ):
        one.save(tmp_path / "one.h5")
        again = bd.load(tmp_path / "one.h5")
        assert str(again) == str(one) and getattr(again, "seed", None) == getattr(one, "seed", None)
    assert again.missing.dtype == bool and np.array_equal(again.mass, one.mass)


def test_quoted_tables_are_read_and_empty_ones_refused(tmp_path):
    quoted, plain, empty = (tmp_path / name for name in ("quoted.csv", "plain.csv", "empty.csv"))
    quoted.write_text('"blade";"f (kHz)"\n"2";"101"\n"1";"100"\n"3";"102"\n')
    plain.write_text("f (Hz)\n100\n101\n102\n")
    found, expected = Mistuning.from_csv(quoted), Mistuning.from_csv(plain)
    np.testing.assert_array_equal(found.deviation, expected.deviation)
    empty.write_text("# nothing\n")
    with pytest.raises(
        bd.ModelError, match="expected one row of frequencies for each blade, found no rows"
    ):
        Mistuning.from_csv(empty)


def test_deviations_print_as_rows():
    one = Mistuning([0.05, -0.02, 0.0], source="bench")
    shown = said(one)
    mean, deviation = 0.01, np.std([5.0, -2.0, 0.0])
    beginning = "Frequencies of 3 blades clamped at the root deviate by"
    assert shown.startswith(f"{beginning} {deviation:.3g} % (standard deviation) Source bench")
    assert f"Mean deviation {100.0 * mean:g} % " in shown
    assert "Range -2 to 5 % blade 1 lowest, blade 0 highest" in shown
    assert "seed 4, 2 modes of each blade" in said(
        Mistuning([[0.01, 0.02], [0.0, 0.03]], "normal", (4,))
    )


def test_dampers_print_as_rows():
    dampers = DamperVariation.of(4, missing=[1, 3], mass=[1.0, 1.0, 1.2, 0.9], gap=2e-5)
    shown = said(dampers)
    assert shown.startswith(
        "2 of 4 dampers present Missing dampers 2 damper numbers 1, 3 (counted from 0) Mass 0.9 to 1.2 times"
    )
    assert shown.endswith("Gap 20 µm increase of the gaps")


def test_results_keep_the_record_of_earlier_versions():
    """Stored peaks are compared with their disk by these texts, copied from earlier files."""
    assert Mistuning.random(6, 0.02, seed=1).record_text == (
        "frequency deviations of 6 blades clamped at the root (normal, standard deviation 0.02, "
        "seed 1): mean 0.992 %, standard deviation 0.734 %, from 0.364 to 2.48 %"
    )
    assert DamperVariation.of(6, missing=[2], mass=1.1).record_text == (
        "6 dampers, 1 missing\n"
        "  mass: factor 1.1 to 1.1\n"
        "  friction coefficient: factor 1 to 1\n"
        "  contact stiffness: factor 1 to 1\n"
        "  gap: 0 to 0"
    )
