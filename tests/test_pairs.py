"""Pairs of features that are described in different places, each used in every way: printed, saved and read again, swept,
reported, explored.

The features are two rotor speeds, blisks, rings, shrouds, strain gauges, an accelerated base, several dampers, and own
contact laws.  The right values come from models without one of the two: a stiffness raised by 10 % at the second speed
raises all frequencies by the root of 1.1.
"""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

import bdamper as bd
from bdamper.importers import ContactFaces, over_speed, read_calculix, read_job
from bdamper.importers.example_decks import example_decks
from bdamper.plot.explorer_worker import Answers, Question
from bdamper.response.linear_limits import peak_interval
from tests.each import each
from tests.importers import test_rings
from tests.imports import build
from tests.plain import plain_study

TOP = 600.0
"""Second speed, rad/s."""
STIFFER = 1.1
"""Factor on the stiffness at this speed."""
ELASTICITY = (2.1e5, 0.3)
BLISK = {
    "contacts": [],
    "n_blades": 36,
    "faces": ("LOW", "HIGH"),
    "fixed": "BORE",
    "units": "mm-t-s",
    "axis": (1, 0, 0),
    "engine_order": 4,
    "harmonics": 1,
    "n_modes": 8,
    "damping_ratio": 0.002,
    "locations": {"tip": 117},
}


def at_two_speeds(body):
    return over_speed({0.0: body, TOP: replace(body, stiffness=STIFFER * body.stiffness)})


@pytest.fixture(scope="module")
def sector(tmp_path_factory):
    folder = tmp_path_factory.mktemp("decks")
    example_decks("calculix", folder)
    return read_calculix(folder / "sector")


@pytest.fixture(scope="module")
def blisk(sector):
    """A blisk at two speeds, with stress at the fillet."""
    gauges = {"stress": {"fillet": "FILLET"}, "elasticity": ELASTICITY, "blade_nodes": "BLADE"}
    return build(at_two_speeds(sector), **BLISK, **gauges)


def assert_usable(study, preload, band, folder, sweeps):
    """Print, save, read, and sweep; a stored result has the same values."""
    assert str(study)
    curve, peak = study.frequency_response(preload, band), study.peak(preload, band)
    for result in (curve, peak, study.free(band)):
        assert str(result) and result.summary()
        result.save(folder / "result.h5")
        again = bd.load(folder / "result.h5")
        np.testing.assert_array_equal(again.amplitude, result.amplitude)
    study.save(folder / "study.h5")
    again = bd.load_study(folder / "study.h5")
    assert again.peak(preload, band).amplitude == pytest.approx(peak.amplitude, rel=1e-9)
    for name, values in sweeps.items():
        table = bd.sweep(study, {name: values}, preload=preload, frequency=band)
        assert table.ok and np.isfinite(table.array("amplitude")).all()
    return peak


@pytest.mark.slow
def test_a_blisk_at_two_speeds(blisk, sector, tmp_path):
    alone = build(sector, **BLISK)
    force = bd.Excitation("tip", amplitude=1.0)
    study = bd.Study(blisk.model, force, engine_order=4, harmonics=1)
    single = bd.Study(alone.model, force, engine_order=4, harmonics=1)
    lowest = alone.frequencies[4][0]
    band = 0.97 * lowest, 1.1 * lowest
    right = single.peak(0.0, band)
    peaks = {}
    for speed in (0.0, TOP):
        running = study.at_speed(speed) if speed else study
        peaks[speed] = assert_usable(
            running, 0.0, band, tmp_path, {"damping_ratio": [0.002, 0.003]}
        )
    assert peaks[0.0].frequency == pytest.approx(right.frequency, rel=1e-7)
    assert peaks[0.0].amplitude == pytest.approx(right.amplitude, rel=1e-6)
    # the amplitude of a stiffer mode falls with the stiffness
    assert peaks[TOP].frequency == pytest.approx(np.sqrt(STIFFER) * right.frequency, rel=1e-6)
    assert peaks[TOP].amplitude == pytest.approx(right.amplitude / STIFFER, rel=1e-4)
    diagram = study.campbell((100.0, TOP), [4])
    highest = diagram.free[diagram.row(4), :, 0].max()
    assert highest == pytest.approx(np.sqrt(STIFFER) * lowest, rel=1e-7)


@pytest.mark.slow
def test_gauges_of_a_blisk_at_two_speeds(blisk, tmp_path):
    """Without contacts the stress is that of the modes: at either speed it is proportional to the amplitude."""
    force = bd.Excitation("tip", amplitude=1.0)
    study = bd.Study(blisk.model, force, engine_order=4, harmonics=1)
    lowest = blisk.frequencies[4][0]
    band = 0.97 * lowest, 1.1 * lowest
    ratio = []
    for speed in (0.0, TOP):
        running = study.at_speed(speed) if speed else study
        peak = running.peak(0.0, band)
        cycle = running.stress(peak)
        cycle.save(tmp_path / "stress.h5")
        assert bd.load(tmp_path / "stress.h5").settings == cycle.settings
        largest = np.abs(cycle.coefficients[..., 1]).max()
        ratio.append(largest / peak.amplitude)
    assert ratio[1] == pytest.approx(ratio[0], rel=1e-3)


@pytest.mark.slow
def test_a_ring_below_a_blade_at_two_speeds(tmp_path):
    example_decks("ring", tmp_path)
    sector, ring = read_job(tmp_path / "sector.inp"), read_job(tmp_path / "ring.inp")
    few = {"points": (2, 2), "n_damper_modes": 8, "n_modes": 8}
    alone = test_rings.build((sector, ring), **few)
    built = test_rings.build((at_two_speeds(sector), ring), **few)
    d = test_rings.ORDER
    at_top = built.model.at_speed(TOP)
    for name, factor in (("blade", STIFFER), ("ring", 1.0)):
        found = np.sort(at_top.bodies[name].bases[d].omega2)
        right = factor * np.sort(alone.model.bodies[name].bases[d].omega2)
        np.testing.assert_allclose(found, right, rtol=1e-6, atol=1e-6 * right.max())
    study = test_rings.study(built).at_speed(TOP)
    preload = study.preload
    band = peak_interval(study.problem.at(preload), None)
    peak = assert_usable(study, preload, band, tmp_path, {"friction_coefficient": [0.15, 0.2]})
    assert peak.ok and study.static(preload).ok


@each("absolute", [False, True])
def test_an_own_law_on_an_accelerated_base(tmp_path, absolute):
    """An acceleration a of the ground acts as the force -m a, and one Jenkins element is friction of constant load."""
    mass, acceleration = 2.0, 0.15 + 0.1j
    contact = bd.Contact(0, kt=1.0, mu=1.0, preload=0.2)
    ways = {"contacts": [contact], "harmonics": 3}
    law = {"friction_law": bd.ContactLaw.jenkins([1.0], [0.2]), "contact_forces": bd.AFT(512)}
    base = bd.lumped(mass, 0.05, 2.0, base=acceleration, absolute=absolute, **ways, **law)
    force = bd.lumped(mass, 0.05, 2.0, forces={0: -mass * acceleration}, **ways)
    band = (0.1, 0.3)
    peak = assert_usable(base, 0.0, band, tmp_path, {"excitation.amplitude": [0.1, 0.2]})
    if absolute:
        return
    assert peak.amplitude == pytest.approx(force.peak(0.0, band).amplitude, rel=1e-4)


@pytest.mark.slow
def test_shares_of_several_dampers(tmp_path):
    """Half of the preload with twice the load on each damper is the same load."""
    model = bd.reference_model("shrouded_blade")
    settings = {"engine_order": 4, "friction_coefficient": 0.3}
    once = plain_study(
        model, bd.Excitation("tip"), load_per_preload={"front": 1.0, "rear": 0.6}, **settings
    )
    twice = once.replace(load_per_preload={"front": 2.0, "rear": 1.2})
    band = peak_interval(once.problem.at(200.0), None)
    curve, other = once.frequency_response(200.0, band), twice.frequency_response(100.0, band)
    np.testing.assert_allclose(other.peak.amplitude, curve.peak.amplitude, rtol=1e-9)
    table = bd.sweep(once, {"load_per_preload.rear": [0.6, 0.9]}, preload=200.0, frequency=band)
    assert len(table) == 2
    once.save(tmp_path / "study.h5")
    again = bd.load_study(tmp_path / "study.h5")
    assert again.settings.load_per_preload == once.settings.load_per_preload


def assert_shown(study, preload, band, folder):
    """The explorer draws the study with its optimal curve, and the review page of this curve has its pictures."""
    answers = Answers(study, print, preloads=3)
    try:
        question = Question((), preload, (0.5 * preload, 2.0 * preload))
        for ask in (partial(answers.curve, harmonics=1), answers.curve, answers.optimal):
            shown = ask(question)
            assert len(shown.curve or shown.optimal) > 2
        assert len(answers.curve(question).limits) == 2
    finally:
        answers.ask(None)
    curve = study.optimal_curve((0.5 * preload, 2.0 * preload), 3, frequency=band, check=False)
    page = curve.report(folder / "review.html", study)
    assert page.read_text().count("<img") >= 3


FEW = {"engine_order": 4, "n_modes": 8, "damping_ratio": 0.001}
"""Options of a small import."""


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:blade .* Young's modulus")
def test_a_shroud_at_two_speeds(tmp_path):
    """At the second speed the blade is one of a stiffness that is 10 % higher, whose shrouds still touch."""
    example_decks("shroud", tmp_path)
    blade = read_job(tmp_path / "blade.inp")
    shroud = ContactFaces("shroud", "SHROUD_HIGH", "SHROUD_LOW", "blade", "blade", points=(1, 4))
    options = {
        "contacts": [shroud],
        "n_blades": 36,
        "faces": ("LOW", "HIGH"),
        "fixed": "BORE",
        "units": "m-kg-s",
        "locations": {"tip": (0.0, 0.345, 0.0)},
        **FEW,
    }
    load = 20e3
    loaded = {
        "engine_order": 4,
        "constant_loads": {"shroud": load},
        "friction_coefficient": 0.2,
    }
    models = [
        build(body, **options).model
        for body in (at_two_speeds(blade), replace(blade, stiffness=STIFFER * blade.stiffness))
    ]
    study, stiffer = (
        plain_study(model, bd.Excitation("tip", "axial"), **loaded) for model in models
    )
    running = study.at_speed(TOP)
    # the disk grows with the speed, which takes a part of the load that was there at assembly; the
    # rest sticks under 1 N
    left = [study.at_speed(speed).static(0.0).normal_force["shroud"] for speed in (0.5 * TOP, TOP)]
    assert load > left[0] > left[1] > 0.0
    stuck = stiffer.stuck((1500.0, 2500.0)).peak.frequency
    band = 0.97 * stuck, 1.03 * stuck
    peak = assert_usable(running, 0.0, band, tmp_path, {"friction_coefficient": [0.2, 0.3]})
    right = stiffer.peak(0.0, band)
    assert peak.frequency == pytest.approx(right.frequency, rel=1e-6)
    assert peak.amplitude == pytest.approx(right.amplitude, rel=1e-4)


@pytest.mark.slow
def test_gauges_beside_a_ring(tmp_path):
    """Without contact a ring leaves the stress of the sector alone."""
    example_decks("ring", tmp_path)
    sector, ring = read_job(tmp_path / "sector.inp"), read_job(tmp_path / "ring.inp")
    inner = np.setdiff1d(
        sector.node_sets["ALL"], [*sector.node_sets["LOW"], *sector.node_sets["HIGH"]]
    )
    seat = ContactFaces("seat", "SEAT", "SEAT", body_a="ring", points=(2, 2))
    options = {
        "n_blades": test_rings.N,
        "faces": test_rings.FACES,
        "fixed": "BORE",
        "units": "mm-t-s",
        "locations": {"tip": (0.0, 230.0, 4.0)},
        "stress": {"web": inner},
        "elasticity": ELASTICITY,
        **FEW,
    }
    alone = build(sector, contacts=[], **options)
    built = build(
        sector,
        {"ring": ring},
        contacts=[seat],
        rings={"ring": test_rings.FACES},
        n_damper_modes=8,
        **options,
    )
    excitation = bd.Excitation("tip", "axial", 1.0)
    free = bd.Study(alone.model, excitation, engine_order=4, harmonics=1)
    study = bd.Study(
        built.model, excitation, 4, harmonics=1, damper_modes=2, friction_coefficient=0.2
    )
    band = 0.97 * alone.frequencies[4][0], 1.03 * alone.frequencies[4][0]
    stress = {}
    for name, one in (("alone", free), ("ring", study)):
        stress[name] = one.stress(one.free(band))
    largest = {name: np.abs(cycle.coefficients[..., 1]).max() for name, cycle in stress.items()}
    assert largest["ring"] == pytest.approx(largest["alone"], rel=1e-4)
    pressing = study.stress(study.peak(20.0))
    pressing.save(tmp_path / "stress.h5")
    np.testing.assert_array_equal(
        bd.load(tmp_path / "stress.h5").coefficients, pressing.coefficients
    )
    wide = peak_interval(study.problem.at(20.0), None)
    assert_shown(study, 20.0, wide, tmp_path)
