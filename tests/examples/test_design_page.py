"""The blocks of docs/design.md run as pasted, and its numbers agree with independent ones."""

import re
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pytest
from scipy.linalg import eigh

from bdamper.importers import example_decks, read_calculix

PAGE = Path(__file__).resolve().parents[2] / "docs" / "design.md"
TEXT = PAGE.read_text()
N_BLADES, ENGINE_ORDER, FORCE = 36, 10, 100.0  # of the page; N at the tip
MM, TONNE = 1e-3, 1e3
HEXAHEDRON = [(0, 1, 2, 6), (0, 2, 3, 6), (0, 3, 7, 6), (0, 7, 4, 6), (0, 4, 5, 6), (0, 5, 1, 6)]
"""Tetrahedra of an element with eight corners."""


def shown(pattern):
    """Return the numbers that the page states."""
    found = re.search(pattern, " ".join(TEXT.split()))
    return [float(text.replace(",", "")) for text in found.groups()]


@pytest.fixture(scope="module")
def decks(tmp_path_factory):
    folder = tmp_path_factory.mktemp("decks")
    example_decks("calculix", folder)
    return {name: read_calculix(folder / name) for name in ("sector", "damper")}


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    """Names after the last block, which runs in an empty folder."""
    pytest.importorskip("skfem", reason="scikit-fem is not installed (extra bdamper[fe])")
    folder = tmp_path_factory.mktemp("page")
    blocks = re.findall(r"```python\n(.*?)```", TEXT, re.S)
    assert len(blocks) == 8
    space = {"__name__": "__main__"}
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        for k, block in enumerate(blocks):
            exec(compile(block, f"design.md, block {k + 1}", "exec"), space)
            plt.close("all")
    return space, folder


def mode_of_raw_matrices(sector):
    """Return frequency (Hz) and mass-normalised tangential motion at the tip of mode 1.

    The nodes of the face HIGH are tied to those of LOW, turned by one sector, with the phase of the
    nodal diameter.
    """
    number = {int(n): k for k, n in enumerate(sector.numbers)}
    row = {(int(n), int(c)): k for k, (n, c) in enumerate(sector.dofs)}
    angle = 2.0 * np.pi / N_BLADES
    place = {name: [int(n) for n in sector.node_sets[name]] for name in ("LOW", "HIGH")}

    def turned(sign):
        c, s = np.cos(sign * angle), np.sin(sign * angle)
        return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])

    def distance(n, m, sign):
        return np.linalg.norm(turned(sign) @ sector.nodes[number[n]] - sector.nodes[number[m]])

    first = place["LOW"][0]
    sign = min((1, -1), key=lambda sign: min(distance(first, m, sign) for m in place["HIGH"]))
    image = {m: min(place["LOW"], key=lambda n: distance(n, m, sign)) for m in place["HIGH"]}
    free = [key for key in row if key[0] not in image]
    column = {key: k for k, key in enumerate(free)}
    tied = np.zeros((len(row), len(free)), complex)
    for (node, component), k in row.items():
        if node not in image:
            tied[k, column[node, component]] = 1.0
            continue
        for other in (1, 2, 3):
            if (image[node], other) in column:
                factor = turned(sign)[component - 1, other - 1]
                phase = np.exp(1j * ENGINE_ORDER * angle)
                tied[k, column[image[node], other]] = factor * phase
    stiffness, mass = (tied.conj().T @ m.toarray() @ tied for m in (sector.stiffness, sector.mass))
    values, vectors = eigh(stiffness, mass, subset_by_index=(0, 0))
    tip = vectors[column[117, 3], 0]  # Z of the deck is tangential
    return np.sqrt(values[0]) / (2.0 * np.pi), abs(tip) / np.sqrt(TONNE)


def test_mass_and_radius_are_those_of_the_mesh(decks):
    """Volume of the elements times density, and their centroid."""
    damper = decks["damper"]
    row = {int(n): k for k, n in enumerate(damper.numbers)}
    corners = damper.nodes[np.vectorize(row.get)(damper.elements[0])]
    volume, moment = 0.0, np.zeros(3)
    for tetrahedron in HEXAHEDRON:
        x = corners[:, tetrahedron]
        sizes = np.abs(np.linalg.det(x[:, 1:] - x[:, :1])) / 6.0
        volume += sizes.sum()
        moment += sizes @ x.mean(axis=1)
    grams, radius = shown(r"([\d.]+) g at ([\d.]+) mm")
    assert grams == pytest.approx(7.85e-9 * volume * TONNE * 1e3, rel=1e-3)
    assert radius == pytest.approx(np.hypot(*(moment / volume)[1:]), rel=1e-3)


@pytest.mark.slow
def test_the_free_blade_is_that_of_the_raw_matrices(decks):
    """A mode of the cyclic matrices without the importer, and its resonance F phi^2/(2 zeta omega^2).

    CalculiX lists 978.2100 Hz for ten nodal diameters at standstill.
    """
    frequency, tip = mode_of_raw_matrices(decks["sector"])
    assert frequency == pytest.approx(978.2100, rel=1e-5)
    (stated,) = shown(r"([\d.]+) Hz at 10 waves")
    assert stated == pytest.approx(frequency, rel=1e-3)
    millimetres, hertz = shown(r"would reach ([\d.]+) mm at ([\d.]+) Hz")
    amplitude = FORCE * tip**2 / (2.0 * 0.002 * (2.0 * np.pi * frequency) ** 2)
    assert hertz == pytest.approx(frequency, rel=1e-3)
    # other modes add a little
    assert 1e-3 * millimetres == pytest.approx(amplitude, rel=0.01)


def test_calculix_at_speed():
    """Values of CalculiX for ten nodal diameters; stiffening follows the square of the speed."""
    assert shown(r"CalculiX gives ([\d.]+) Hz at standstill and ([\d,.]+) Hz at 1,000") == [
        978.21,
        1013.4,
    ]


@pytest.mark.nightly
@pytest.mark.slow
def test_preload_speed_and_mass_belong_together(page):
    """P = f m r Omega^2 and Omega = 2 pi f / EO, for a preload and each crossing."""
    mass, radius = 0.0689984, 0.236179
    newtons, hertz, rpm, full, again, factor = shown(
        r"design for at least ([\d,]+) N\. Engine order 10 crosses the resonance at this preload "
        r"\(([\d,.]+) Hz\) at ([\d,]+) rpm, .*? presses with ([\d,]+) N: a preload of ([\d,]+) N "
        r"requires ([\d.]+) times"
    )
    enough = page[0]["enough"]
    assert newtons == again == enough.parameter
    assert hertz == pytest.approx(enough.frequency, rel=1e-3)
    assert rpm == pytest.approx(60.0 * hertz / ENGINE_ORDER, rel=1e-3)
    assert full == pytest.approx(mass * radius * (rpm * np.pi / 30.0) ** 2, rel=2e-3)
    assert factor == pytest.approx(newtons / full, rel=0.02)
    rows = re.findall(
        r"^\| ([\d.]+) g \| ([\d,]+) rpm \| ([\d,]+) N \| ([\d,.]+) Hz \| ([\d.,]+) µm", TEXT, re.M
    )
    assert len(rows) == len(page[0]["factors"])
    amplitudes = page[0]["found"].array("amplitude").ravel()
    for row, factor, amplitude in zip(rows, page[0]["factors"], amplitudes):
        grams, rpm, newtons, hertz, micrometres = (float(text.replace(",", "")) for text in row)
        assert grams == pytest.approx(1e3 * factor * mass, rel=2e-3)
        assert rpm == pytest.approx(60.0 * hertz / ENGINE_ORDER, rel=1e-3)
        load = factor * mass * radius * (rpm * np.pi / 30.0) ** 2
        assert newtons == pytest.approx(load, rel=2e-3)
        assert 1e-6 * micrometres == pytest.approx(amplitude, rel=0.01)


@pytest.mark.slow
def test_the_margin_is_that_of_goodman(page):
    """Fatigue limit times (1 - mean/strength) over the amplitude, from the numbers of the page."""
    amplitude, mean, margin = shown(
        r"fillet: ([\d.]+) MPa about a mean of ([\d.]+) MPa, a margin of ([\d.]+)"
    )
    assert margin == pytest.approx(300.0 * (1.0 - mean / 900.0) / amplitude, rel=5e-3)
    assert margin == pytest.approx(page[0]["margins"].factor.min(), rel=0.01)
    (micrometres,) = shown(r"highest peak is ([\d.]+) µm")
    assert 1e-6 * micrometres == pytest.approx(page[0]["peak"].amplitude, rel=0.01)


@pytest.mark.nightly
@pytest.mark.slow
def test_harmonics_agree_where_the_page_says_so(page):
    """Rows of the table, except for the values of the lowest preload with more harmonics."""
    study, best = page[0]["study"], page[0]["optimal"].optimum
    micrometres, newtons = shown(r"lowest amplitude is ([\d,]+) µm at ([\d,]+) N")
    assert [newtons, micrometres] == pytest.approx([best.preload, 1e6 * best.amplitude], rel=0.01)
    rows = re.findall(r"^\| ([\d,]+) N \| (\d+) µm \| (\d+) µm \| (\d+) µm", TEXT, re.M)
    assert [row[0] for row in rows] == ["4,000", "7,500"]
    for row in rows:
        newtons, *stated = (float(text.replace(",", "")) for text in row)
        found = [
            1e6 * study.replace(harmonics=harmonics).peak(newtons).amplitude
            for harmonics in (1, 3, 5)
        ]
        assert found == pytest.approx(stated, rel=0.01)
        assert found == sorted(found, reverse=True)
        assert max(found) / min(found) < 1.13
    with_more = study.replace(harmonics=3).peak(best.preload).amplitude
    assert with_more > 2.0 * best.amplitude, "the optimum with one harmonic is not known"


@pytest.mark.slow
def test_the_chosen_damper(page):
    """Peaks at the speed of the chosen damper, and the resonance with a stuck damper."""
    millimetres, hertz = shown(r"with a stuck one ([\d.]+) mm at ([\d,.]+) Hz")
    stuck = page[0]["stuck"]
    assert [millimetres, hertz] == pytest.approx([1e3 * stuck.amplitude, stuck.frequency], rel=5e-3)
    one, three = shown(r"highest peak is (\d+) µm, with three harmonics (\d+) µm")
    found = [1e6 * page[0][name].amplitude for name in ("peak", "richer")]
    assert [one, three] == pytest.approx(found, rel=0.01)
    assert page[0]["at"].preload > 1.35 * page[0]["enough"].parameter


@pytest.mark.slow
def test_the_files_of_the_page(page):
    names = {path.name for path in page[1].iterdir()}
    assert {"model.png", "haigh.png", "review.html"} <= names
    assert "Example stage" in (page[1] / "review.html").read_text()
