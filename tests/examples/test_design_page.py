"""The blocks of docs/design.md run as pasted, and its numbers agree with independent ones."""

import re
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pytest
from scipy.linalg import eigh

from bdamper.importers import example_decks, read_calculix
from bdamper.response.optimum_checks import checks

PAGE = Path(__file__).resolve().parents[2] / "docs" / "design.md"
TEXT = PAGE.read_text()
N_BLADES, ENGINE_ORDER, FORCE = 60, 5, 10.0  # of the page; N at the tip
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
    example_decks("turbine", folder)
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
    tip = vectors[column[176, 3], 0]  # Z of the deck is tangential
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

    A cyclic run of CalculiX lists 659.6597 Hz for five nodal diameters.
    """
    frequency, tip = mode_of_raw_matrices(decks["sector"])
    assert frequency == pytest.approx(659.6597, rel=1e-5)
    (stated,) = shown(r"([\d.]+) Hz at 5 waves")
    assert stated == pytest.approx(frequency, rel=1e-5)
    millimetres, hertz = shown(r"would reach ([\d.]+) mm at ([\d.]+) Hz")
    amplitude = FORCE * tip**2 / (2.0 * 0.002 * (2.0 * np.pi * frequency) ** 2)
    assert hertz == pytest.approx(frequency, rel=1e-5)
    # other modes add a little
    assert 1e-3 * millimetres == pytest.approx(amplitude, rel=0.01)


def test_mass_speed_and_preload_belong_together():
    """P = f m r Omega^2 and Omega = 2 pi f / EO, from the numbers of the page alone."""
    (hertz,) = shown(r"Harmonic balance +[\d.]+ \S+ ([\d.]+) Hz;")
    rpm, full, newtons, factor, grams = shown(
        r"At ([\d,]+) rpm the damper of the deck presses with ([\d,]+) N, so the preload of "
        r"([\d,]+) N requires ([\d.]+) times its mass: \*\*([\d.]+) g"
    )
    mass, radius = shown(r"([\d.]+) g at ([\d.]+) mm")
    assert rpm == pytest.approx(60.0 * hertz / ENGINE_ORDER, rel=1e-3)
    load = 1e-6 * mass * radius * (rpm * np.pi / 30.0) ** 2
    assert full == pytest.approx(load, rel=3e-3)
    assert factor == pytest.approx(newtons / full, rel=5e-3)
    assert grams == pytest.approx(factor * mass, rel=0.02)


@pytest.mark.nightly
@pytest.mark.slow
def test_the_page_has_a_case_with_all_checks(page):
    """Three harmonics, no check missing or failed, one amplitude, and a mesh for its stress.

    Time integration may be as far below harmonic balance as the page says.
    """
    space, folder = page
    best, study = space["best"], space["study"]
    assert study.settings.harmonics == 3
    colours = {check.name: check.colour for check in checks(best)}
    in_time = colours.pop("Time integration")
    assert set(colours.values()) == {"green"} and in_time in ("green", "amber")
    (response,) = best.time_response
    (below,) = shown(r"is ([\d.]+) % \*below\* harmonic balance")
    assert 1.0 - response.mean / response.balance == pytest.approx(0.01 * below, abs=0.005)
    assert 400.0 < best.optimum.preload < 3000.0
    (stated,) = {
        float(number) * {"µm": 1e-6, "mm": 1e-3}[unit]
        for number, unit in re.findall(r"design amplitude of ([\d.]+) (µm|mm)", TEXT)
    }
    assert stated == pytest.approx(best.design_amplitude, rel=5e-3)
    margins = space["margins"]
    critical = int(margins.factor.argmin())
    assert margins.names[critical] == "fillet node 266"
    stress = built_stress(space)
    assert stress.spread[list(stress.nodes).index(266)] < 0.2
    (factor,) = shown(r"\*\*([\d.]+) at the design amplitude")
    assert factor == pytest.approx(space["at_design"], abs=0.006)
    # Goodman: fatigue limit times (1 - mean/strength) over the amplitude
    amplitude = 1e-6 * margins.amplitude[critical] * best.design_amplitude / space["peak"].amplitude
    mean = 1e-6 * margins.mean[critical]
    assert factor == pytest.approx(300.0 * (1.0 - mean / 900.0) / amplitude, rel=0.01)
    (stated_mean,) = shown(r"mean stress ([\d.]+) MPa")
    assert stated_mean == pytest.approx(mean, rel=0.01)
    assert space["peak"].amplitude == pytest.approx(best.optimum.amplitude, rel=0.01)
    # among some masses the estimate is the one with the lowest crossing
    crossings = space["crossings"]
    masses = crossings.points["damper_mass_factor"]
    lowest = int(np.argmin(crossings.array("amplitude")))
    assert masses[lowest] == pytest.approx(space["factor"], rel=5e-3)
    # the report is that of the chosen damper, which presses with its best preload
    final, chosen = space["final"], space["chosen"]
    assert chosen.preload == pytest.approx(final.optimum.preload, rel=0.02)
    (micrometres,) = shown(r"([\d.]+) µm instead of")
    assert 1e-6 * micrometres == pytest.approx(final.design_amplitude, rel=5e-3)
    text = (folder / "review.html").read_text()
    assert "Example stage" in text
    assert {"model.png", "optimum.png", "haigh.png"} <= {path.name for path in folder.iterdir()}
    # sets of the picture of the import
    bore = decks_set(folder, "BORE")
    assert len(space["built"].node_sets["clamp"]) == bore


def built_stress(space):
    return space["built"].model.stress["fillet"]


def decks_set(folder, name):
    return len(read_calculix(folder / "sector").node_sets[name])
