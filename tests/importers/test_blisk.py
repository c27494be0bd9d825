"""A blisk without contacts: frequencies and free response of CalculiX, mistuned response, and what needs a contact."""

import re
import shutil

import numpy as np
import pytest

import bdamper as bd
from bdamper.importers import Reduction, build_model, example_decks, read_calculix
from bdamper.importers.abaqus import read_frd
from bdamper.mistuning import Mistuning
from bdamper.util.errors import BdamperError, ModelError, PlausibilityWarning, SettingError
from examples.calculix.decks import run_job
from tests.each import each
from tests.imports import build

N, D, DAMPING = 36, 4, 0.002
TIP = 117
SETTINGS = {
    "contacts": [], "n_blades": N, "faces": ("LOW", "HIGH"), "fixed": "BORE", "units": "mm-t-s", "axis": (1, 0, 0),
    "engine_order": D, "harmonics": 1, "n_modes": 8, "damping_ratio": DAMPING, "locations": {"tip": TIP},
}  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("blisk")
    example_decks("calculix", folder)
    return folder


@pytest.fixture(scope="module")
def blade(folder):
    return read_calculix(folder / "sector")


@pytest.fixture(scope="module")
def built(blade):
    return build(blade, **SETTINGS, blade_nodes="BLADE")


@pytest.fixture(scope="module")
def study(built):
    force = bd.Excitation("tip", direction="tangential", amplitude=1.0)
    return bd.Study(built.model, force, engine_order=D, harmonics=1)


@pytest.fixture(scope="module")
def around(built):
    """Interval (Hz) around the lowest mode of nodal diameter 4."""
    return 0.97 * built.frequencies[D][0], 1.03 * built.frequencies[D][0]


def cyclic_deck(folder):
    """The deck of the sector with a cyclic tie between the faces, but for nodes that are held."""
    head = (folder / "sector.inp").read_text().split("*STEP")[0]
    sets = {}
    for name in ("BORE", "LOW", "HIGH"):
        block = re.search(rf"\*NSET, NSET={name}\n([^*]*)", head).group(1)
        sets[name] = {int(word) for word in block.replace(",", " ").split()}
    lines = [head]
    for name in ("LOW", "HIGH"):
        free = sorted(sets[name] - sets["BORE"])
        lines += [f"*NSET, NSET=N{name}", *(f"{number}," for number in free)]
        lines += [f"*SURFACE, NAME=S{name}, TYPE=NODE", f"N{name},"]
    lines += [
        "*TIE, NAME=CYCLE, CYCLIC SYMMETRY, POSITION TOLERANCE=1e-3",
        "SLOW, SHIGH",
        f"*CYCLIC SYMMETRY MODEL, N={N}, NGRAPH=1, TIE=CYCLE",
        "0., 0., 0., 1., 0., 0.",
        "*STEP\n*FREQUENCY\n24,",
        f"*SELECT CYCLIC SYMMETRY MODES, NMIN={D}, NMAX={D}",
        "*NODE FILE\nU\n*END STEP\n",
    ]
    return "\n".join(lines)


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("ccx") is None, reason="CalculiX (ccx) is not installed")
def test_frequencies_and_free_response_of_calculix(folder, built, study, around):
    """The free response is the sum over the travelling waves of CalculiX, of unit modal mass over the sector."""
    run_job(cyclic_deck(folder), folder, "cyclic")
    (modes,) = read_frd(folder / "cyclic.frd").modes
    assert modes.nodal_diameter == D
    theirs, shapes = modes.frequency, modes.shapes
    np.testing.assert_allclose(built.frequencies[D], theirs[:8], rtol=5e-6)

    # mm-t-s: millimetres for newtons; the tangential direction is z in the file
    motion = np.abs(shapes[modes.numbers.tolist().index(TIP), 2])
    omega = 2.0 * np.pi * theirs
    curve = study.free(around)
    w = 2.0 * np.pi * curve.frequency[:, None]
    response = motion**2 / (omega**2 - w**2 + 2j * DAMPING * omega * w)
    np.testing.assert_allclose(curve.amplitude, 1e-3 * abs(response.sum(axis=1)), rtol=2e-3)
    highest = 1e-3 * motion[0] ** 2 / (2.0 * DAMPING * omega[0] ** 2)
    assert curve.peak.amplitude == pytest.approx(highest, rel=1e-3)


def test_campbell_diagram(study, built):
    diagram = study.campbell((500.0, 2000.0), [D])
    row = diagram.row(D)
    np.testing.assert_allclose(diagram.free[row, 0], built.frequencies[D][:3], rtol=1e-9)
    np.testing.assert_allclose(diagram.stuck, diagram.free, rtol=1e-12)
    order, mode, free, _ = diagram.met[0]
    assert (order, mode) == (D, 1)
    assert free == pytest.approx(2.0 * np.pi * built.frequencies[D][0] / D, rel=1e-6)


def test_at_a_preload_of_zero_the_response_is_the_free_one(study, around):
    free = study.free(around).peak
    peak = study.peak(0.0, around)
    assert peak.amplitude == pytest.approx(free.amplitude, rel=1e-6)
    curve = study.frequency_response(0.0, around)
    assert curve.peak.amplitude == pytest.approx(free.amplitude, rel=1e-4)


def disk_response(disk, frequency):
    """(n_frequencies, n_blades) amplitudes of all blades, by solving the equations of the whole disk at once."""
    s = disk.structure
    m, r = s.n, s.disk_stiffness.shape[1]
    blades = np.arange(N)
    turned = np.exp(2j * np.pi * np.outer(blades, blades) / N) / np.sqrt(N)

    def whole(of_blade, of_wave):
        matrix = np.zeros((N, m, N, m), complex)
        matrix[blades, :, blades, :] = of_blade
        coupling = np.einsum("ad,dij,bd->aibj", turned, of_wave, turned.conj())
        first = m - of_wave.shape[1]
        matrix[:, first:, :, first:] += coupling
        return matrix.reshape(N * m, N * m)

    stiffness = whole(s.stiffness, s.disk_stiffness)
    mass = whole(np.broadcast_to(s.mass, (N, m, m)), s.disk_mass)
    damping = whole(np.zeros((N, m, m)), s.damping)
    assert r < m
    force = disk.excitation.ravel()
    found = []
    for hertz in frequency:
        w = 2.0 * np.pi * hertz
        x = np.linalg.solve(stiffness - w**2 * mass + 1j * w * damping, force)
        found.append(np.abs(x.reshape(N, m) @ disk.response_row))
    return np.array(found)


@pytest.mark.slow
def test_mistuned_free_response(study, around):
    disk = bd.BladedDisk(study, mistuning=Mistuning.random(N, 0.01, seed=3))
    curve = disk.frequency_response(0.0, around)
    at = np.linspace(0, len(curve) - 1, 5).astype(int)
    expected = disk_response(disk, curve.frequency[at])
    np.testing.assert_allclose(np.abs(curve.blades[at][..., 1]), expected, rtol=1e-6)
    peak = disk.peak(0.0)
    assert peak.found
    assert peak.amplitude == pytest.approx(curve.peak.amplitude, rel=0.01)
    assert disk_response(disk, [peak.frequency])[0].max() == pytest.approx(peak.amplitude, rel=1e-6)
    assert peak.tuned_amplitude == pytest.approx(study.free(around).peak.amplitude, rel=0.02)


NEEDS = {
    "static": lambda s, peak, curve: s.static(0.0),
    "stuck": lambda s, peak, curve: s.stuck((900.0, 1000.0)),
    "wedge_friction": lambda s, peak, curve: s.wedge_friction(),
    "first_slip": lambda s, peak, curve: s.first_slip(),
    "optimal_curve": lambda s, peak, curve: s.optimal_curve((10.0, 100.0)),
    "resonance_crossings": lambda s, peak, curve: s.resonance_crossings((1000.0, 2000.0), [D]),
    "time_response": lambda s, peak, curve: s.time_response(peak),
    "motion_in_time": lambda s, peak, curve: s.motion_in_time(curve),
    "frequency_sweep": lambda s, peak, curve: s.frequency_sweep(0.0, (900.0, 1000.0)),
    "with_stability": lambda s, peak, curve: s.with_stability(curve),
    "with_time_response": lambda s, peak, curve: s.with_time_response(curve),
    "nonlinear_mode": lambda s, peak, curve: s.nonlinear_mode(0.0),
    "hysteresis": lambda s, peak, curve: s.hysteresis(curve),
    "dissipation": lambda s, peak, curve: s.dissipation(curve),
    "peak_sensitivities": lambda s, peak, curve: s.peak_sensitivities(peak),
    "curve_sensitivities": lambda s, peak, curve: s.curve_sensitivities(curve),
    "effect_significance": lambda s, peak, curve: s.effect_significance(0.0, (900.0, 1000.0)),
    "estimate_errors": lambda s, peak, curve: s.estimate_errors(peak),
    "refine": lambda s, peak, curve: s.refine(peak),
    "harmonic_convergence": lambda s, peak, curve: s.harmonic_convergence(peak),
    "flutter": lambda s, peak, curve: s.flutter(0.0, -0.01),
    "time_response of a disk": lambda s, peak, curve: bd.BladedDisk(s).time_response(None),
    "optimal_curve of a disk": lambda s, peak, curve: bd.BladedDisk(s).optimal_curve([10.0, 100.0]),
}  # fmt: skip


@pytest.fixture(scope="module")
def results(study, around):
    return study.peak(0.0, around), study.frequency_response(0.0, around)


@pytest.mark.slow
@each("name", NEEDS)
def test_what_needs_a_contact_is_refused_with_one_sentence(name, study, results):
    message = rf"^{name.split()[0]}: expected a model with contacts, found none; use free, campbell, .*BladedDisk$"
    with pytest.raises(SettingError, match=message):
        NEEDS[name](study, *results)


@each("stiffness", [1e7, "residual_modes", bd.PerArea(1e12)])
def test_a_contact_stiffness_is_refused(stiffness, study):
    with pytest.raises(
        SettingError, match="contact_stiffness: expected None, since the model has no contacts"
    ):
        study.replace(contact_stiffness=stiffness)


def test_a_preload_is_refused(study):
    with pytest.raises(SettingError, match="preload: expected 0, since no body of the model"):
        study.peak(100.0)


@pytest.mark.slow
def test_the_model_can_be_stored_and_drawn(built, study, around, tmp_path):
    built.save(tmp_path / "blisk.h5")
    model = bd.load_model(tmp_path / "blisk.h5")
    assert not model.interfaces
    again = bd.Study(model, study.excitation, engine_order=D, harmonics=1)
    assert again.free(around).peak.amplitude == study.free(around).peak.amplitude
    study.save(tmp_path / "study.h5")
    assert bd.load_study(tmp_path / "study.h5").free(around).peak.frequency > 0.0
    built.plot(tmp_path / "model.png")
    study.free(around).plot(tmp_path / "curve.png")
    assert "contact points        0" in str(study)


def test_a_friction_coefficient_is_refused(study):
    """Without friction faces it has no effect, and all values of a sweep over it would be equal."""
    words = "friction_coefficient: has no effect on a model without friction faces"
    for given in (0.1, 0.4):
        with pytest.raises(SettingError, match=words):
            study.replace(friction_coefficient=given)


def test_a_damper_without_contacts_is_refused(folder, blade):
    damper = read_calculix(folder / "damper")
    with pytest.raises(
        SettingError, match="contacts: expected at least one contact of 'damper', found none"
    ):
        build_model(blade, damper, contacts=[])


def test_a_single_mode_is_doubted():
    with pytest.warns(PlausibilityWarning, match="n_modes: plausible 3 to 1000, found 1; too few"):
        Reduction(n_modes=1)


def test_other_contacts_are_refused(blade):
    for contacts in (None, "left", [1]):
        with pytest.raises(SettingError, match="contacts: expected"):
            build(blade, **{**SETTINGS, "contacts": contacts})


def test_the_message_on_the_direction_names_the_middle(blade):
    message = (
        r"radial: expected the direction from the axis to the blade, within \d+ degrees of \(.*, 1, .*\) in the axes "
        r"of the file, the middle of the box around all elements of the sector, found \(0, 0, 1\), 90 degrees off"
    )
    with pytest.raises((ModelError, BdamperError), match=message):
        build(blade, **SETTINGS, radial=(0, 0, 1))
