"""Cyclic decks of CalculiX' own test suite, unchanged, beside its own cyclic runs."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest

import bdamper as bd
from bdamper.importers import ContactFaces
from tests.imports import build
from tests.others_files import (
    AXES,
    cyclic_frequencies,
    deck,
    front,
    has_decks,
    held,
    sector,
    shrouded,
    stuck_frequency,
)

if not has_decks():
    pytest.skip(
        "CalculiX (ccx) and its decks (Debian: calculix-ccx-test) are not installed",
        allow_module_level=True,
    )

HIGHEST = {"segmenttet": 2, "fullseg": 2}
"""Nodal diameters that a deck asks for, or fewer of a large one; all others ask for 0 to 6."""


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Body and frequencies of a deck; those that hold nothing are held at bore or rim."""

    @cache
    def run(name):
        folder: Path = tmp_path_factory.mktemp(name)
        text = deck(name)
        text += "" if "*BOUNDARY" in text else held(text)
        return sector(text, folder), cyclic_frequencies(text, folder, HIGHEST.get(name, 6))

    return run


def built(body, diameters=None, **settings):
    rub = ContactFaces("rub", front(body), body_a="blade", body_b="ground", points=4, gap=-1e-5)
    return build(body, contacts=[rub], n_modes=8, nodal_diameters=diameters, **AXES, **settings)


@pytest.mark.parametrize(
    ("name", "faces", "tolerance"),
    [
        ("segdyn", ("NLEFT", "NRIGHT"), 1e-5), ("segdyn", None, 1e-5), ("segststate", None, 1e-5),
        ("segment", None, 1e-5), ("fullseg", ("NLEFT", "NRIGHT"), 1e-3), ("segmenttet", ("NLEFT", "NRIGHT"), 1e-3),
    ],
)  # fmt: skip
def test_frequencies_are_those_of_its_own_cyclic_run(runs, name, faces, tolerance):
    body, theirs = runs(name)
    made = built(body, range(max(theirs) + 1), faces=faces)
    assert made.model.n_blades == 12
    for d, frequency in made.frequencies.items():
        n = min(len(frequency), len(theirs[d]))
        assert n >= 4
        np.testing.assert_allclose(frequency[:n], theirs[d][:n], rtol=tolerance)


def test_shrouds_that_stick_are_the_whole_sector(runs):
    """Blade-to-blade contact where the faces were joined: the frequency of the joined sector at nodal diameter 3."""
    body, theirs = runs("segdyn")
    assert stuck_frequency(shrouded(body)) == pytest.approx(theirs[3][0], rel=3e-4)


def test_faces_that_do_not_match_to_a_tracking_curve(runs):
    """The way of docs/import.md: a cyclic deck, a friction pair, curves whose peak depends on the excitation."""
    body, _ = runs("segmenttet")
    tip = {"tip": int(front(body)[0])}
    made = built(body, faces=("NLEFT", "NRIGHT"), engine_order=2, harmonics=1, locations=tip)
    assert any("meshes that differ" in line for line in made.checks)
    second = made.frequencies[2][1]
    peaks = {}
    for force in (1e-3, 0.2):
        excitation = bd.Excitation("tip", direction="axial", amplitude=force)
        study = bd.Study(
            made.model, excitation, engine_order=2, friction_coefficient=0.3, harmonics=1
        )
        curve = study.frequency_response(0.0, (0.5 * second, 1.5 * second))
        assert curve.status == "complete"
        peaks[force] = curve.peak
    assert not curve.peak_at_end and second < peaks[0.2].frequency < 1.1 * second  # it slips
    assert (
        peaks[1e-3].amplitude / 1e-3 < 0.2 * peaks[0.2].amplitude / 0.2
    )  # it sticks, and resonates elsewhere
