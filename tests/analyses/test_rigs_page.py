"""The tables of docs/measurements.md are what ``python -m benchmarks.rigs`` writes."""

import numpy as np
import pytest

from benchmarks import rigs


def stated(head):
    """Rows of a table of the page."""
    lines = rigs.PAGE.read_text(encoding="utf-8").splitlines()
    rows = []
    for line in lines[lines.index(head) + 2 :]:
        if not line.startswith("|"):
            break
        rows.append(line)
    return rows


@pytest.mark.slow
def test_tables_of_the_friction_damped_beam():
    """Both stiffnesses, beside an independent calculation on all 28 degrees of freedom."""
    rows = rigs.beam_rows()
    assert stated(rigs.OF_BEAM) == rows
    assert stated(rigs.OF_FREQUENCIES) == rigs.frequency_rows()
    # with 6.985e7 N/m: a shift of 36.85 %, and 15.87, 14.44, 16.52 % with 1, 3, 9 harmonics
    assert rigs.fitted_stiffness() == pytest.approx(6.985e7, rel=1e-4)
    for row, damping in zip(rows[3:], (15.87, 14.44, 16.52), strict=True):
        cells = row.split("|")
        assert float(cells[3].split("%")[0]) == pytest.approx(damping, abs=0.06)
        assert float(cells[4].split("%")[0]) == pytest.approx(36.85, abs=0.06)


@pytest.mark.slow
def test_resonance_of_the_beam_over_the_excitation():
    """The highest damping ratio of a test at several levels: published are up to 15 %."""
    study = rigs.friction_damped_beam(3, contact_stiffness=rigs.fitted_stiffness())
    curve = study.excitation_curve(0.0, (0.1, 9.5), 4)
    assert curve.ok
    assert curve.frequency[0] == pytest.approx(rigs.MEASURED_FREQUENCIES[0], rel=5e-3)
    assert curve.damping_ratio.max() == pytest.approx(rigs.MEASURED_DAMPING, abs=0.01)
    assert np.all(np.diff(curve.frequency) < 0.0)


@pytest.mark.nightly
@pytest.mark.slow
def test_table_of_the_dampers_of_the_first_page():
    assert stated(rigs.OF_REDUCTION) == rigs.reduction_rows()


def test_a_table_is_replaced_as_a_whole():
    page = "text\n\n| a |\n|---|\n| 1 |\n| 2 |\n\nmore\n"
    assert rigs.with_table(page, "| a |", ["| 3 |"]) == "text\n\n| a |\n|---|\n| 3 |\n\nmore\n"
