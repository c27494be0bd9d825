"""The whole way on a model of one's own: decks, CalculiX, import, optimum, stress, margin, speed, crossings, a wheel.

Both decks are written here, as a user's would be: hexahedra in millimetres and tonnes with the damper at one flank,
tetrahedra in metres with the damper at the other, about another axis.  Every step is held against physics, or against
what CalculiX finds by itself.
"""

import shutil

import numpy as np
import pytest

pytest.importorskip("skfem", reason="scikit-fem is not installed (extra bdamper[fe])")

import bdamper as bd
from bdamper.fatigue.criteria import Material
from bdamper.fem.element_stress import von_mises_size
from examples.calculix.decks import run_job
from tests.imports import build
from tests.own_sector import OwnSector

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(shutil.which("ccx") is None, reason="CalculiX (ccx) is not installed"),
]
D = 4
STEEL = Material(300e6, 900e6, 800e6, name="a steel")
CASES = {
    "hexahedra": OwnSector("C3D20R", "mm-t-s", flank=1),
    "tetrahedra": OwnSector(
        "C3D10", "m-kg-s", axis=(0.0, -1.0, 0.0), radial=(0.0, 0.0, 1.0), flank=-1
    ),
}


@pytest.fixture(scope="module", params=CASES)
def own(request):
    return CASES[request.param]


@pytest.fixture(scope="module")
def folder(own, tmp_path_factory):
    folder = tmp_path_factory.mktemp(own.kind)
    own.write_and_run(folder)
    run_job(own.cyclic(own.steps_of_modes(D, 4)), folder, "free")
    run_job(own.cyclic(own.steps_of_modes(D, 4), bonded=True), folder, "bonded")
    return folder


@pytest.fixture(scope="module")
def built(own, folder):
    asked = {"engine_order": D, "n_modes": 20, "stress": "FILLET", "blade_nodes": "BLADE"}
    return build(*own.read(folder), **own.settings, **asked)


@pytest.fixture(scope="module")
def study(built):
    return bd.Study(
        built.model,
        bd.Excitation("tip", amplitude=1.0),
        engine_order=D,
        friction_coefficient=0.3,
        harmonics=1,
    )


def theirs(folder, job):
    """Frequencies that CalculiX prints, one of each pair."""
    words = [line.split() for line in (folder / f"{job}.dat").read_text().splitlines()]
    return np.array([float(line[4]) for line in words if len(line) == 6 and line[0] == str(D)])[::2]


def test_free_frequencies_are_those_of_calculix(built, folder):
    np.testing.assert_allclose(built.frequencies[D][:4], theirs(folder, "free"), rtol=1e-3)
    assert sorted(built.frequencies) == [0, 4, 8, 12, 16]


def test_stuck_frequencies_are_those_of_a_bonded_run(study, folder):
    """Six contact points a face give a little: the first is 0.3 to 0.4 % below faces that are tied all over."""
    springs = np.concatenate(
        [study.problem.stiffness[name].stiffness for name in study.problem.coupling.interfaces]
    )
    ours = study.problem.system(0.0).structure.linear.modes(springs)[0][:4] / (2.0 * np.pi)
    bonded = theirs(folder, "bonded")
    np.testing.assert_allclose(ours[0], bonded[0], rtol=5e-3)
    np.testing.assert_allclose(ours, bonded, rtol=0.012)
    assert np.all(ours < bonded) and bonded[0] > 1.3 * theirs(folder, "free")[0]


def test_stress_of_a_mode_is_that_of_calculix(own, built, folder):
    """To 1 %; its size depends on the modal mass, one unit of mass of the file."""
    mine, other = built.model.stress["FILLET"].modes[D][..., 0], own.stress_of(folder / "free.frd")
    unit = {"mm-t-s": 1000.0, "m-kg-s": 1.0}[own.units]
    errors = []
    for wave in (mine, mine.conj()):
        scale = np.vdot(wave, other) / np.vdot(wave, wave)
        errors.append(von_mises_size(other - scale * wave).max() / von_mises_size(other).max())
        assert abs(scale) * np.sqrt(unit) == pytest.approx(1.0, rel=0.05)
    assert min(errors) < 0.01


def test_preload_is_the_centrifugal_force_of_the_damper(own, study):
    damper = own.fe.damper
    radius = np.hypot(*damper.centre[:2])
    assert study.at_speed(400.0).preload == pytest.approx(
        damper.total_mass * radius * 400.0**2, rel=1e-4
    )


def test_the_optimum_lies_between_free_and_stuck_and_its_margin_is_larger(study, folder):
    """There friction takes most of the response; at eight times the preload the damper sticks."""
    curve = study.optimal_curve((150.0, 300.0), 5, check=False)
    best = curve.optimum
    free, stuck = theirs(folder, "free")[0], theirs(folder, "bonded")[0]
    assert free < best.frequency < stuck
    assert best.amplitude < 0.1 * curve.free.amplitude
    at_best, at_stuck = study.peak(best.preload), study.peak(8.0 * best.preload)
    assert at_best.amplitude < 0.5 * at_stuck.amplitude
    assert at_best.frequency < at_stuck.frequency <= 1.001 * stuck
    margins = [study.margin(peak, STEEL, speed=400.0) for peak in (at_best, at_stuck)]
    assert margins[0].factor.min() > 1.5 * margins[1].factor.min() > 1.5
    slow, fast = (
        study.stress(at_best, speed=speed).coefficients[..., 0].real for speed in (400.0, 500.0)
    )
    np.testing.assert_allclose(
        fast - slow, (500.0**2 - 400.0**2) * study.model.stress["FILLET"].static, rtol=1e-5
    )
