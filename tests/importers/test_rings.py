"""Import of a friction ring: frequencies of CalculiX, rigid motions, hoop force, optimum and refusals."""

import shutil
from dataclasses import replace

import numpy as np
import pytest

import bdamper as bd
from bdamper.importers import (
    ContactFaces,
    Placement,
    Reduction,
    Sector,
    build_model,
    example_decks,
    read_job,
)
from bdamper.util.errors import ModelError, SettingError
from examples.calculix.decks import run_job
from tests.calculix_runs import run
from tests.printed import said

N, ORDER = 24, 4
FACES = ("LOW", "HIGH")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("ring")
    example_decks("ring", folder)
    return folder


@pytest.fixture(scope="module")
def bodies(folder):
    return read_job(folder / "sector.inp"), read_job(folder / "ring.inp")


def build(bodies, points=(5, 2), nodal_diameters=None, n_damper_modes=16, n_modes=20, **sector):
    options = {"n_blades": N, "faces": FACES, "fixed": "BORE", "rings": {"ring": FACES}, **sector}
    return build_model(
        bodies[0],
        {"ring": bodies[1]},
        contacts=[ContactFaces("seat", "SEAT", "SEAT", body_a="ring", points=points)],
        sector=Sector(**options),
        placement=Placement("mm-t-s"),
        reduction=Reduction(
            engine_order=ORDER,
            nodal_diameters=nodal_diameters,
            n_modes=n_modes,
            n_damper_modes=n_damper_modes,
            damping_ratio=0.001,
        ),
        locations={"tip": (0.0, 230.0, 4.0)},
    )


def study(built, **settings):
    used = {
        "engine_order": ORDER,
        "harmonics": 1,
        "damper_modes": 2,
        "friction_coefficient": 0.2,
        **settings,
    }
    return bd.Study(built.model, bd.Excitation("tip", "axial", 1.0), **used)


@pytest.fixture(scope="module")
def built(bodies):
    return build(bodies)


@pytest.fixture(scope="module")
def split(bodies):
    return build(bodies, split_rings=("ring",))


def ring_frequencies(built, d):
    return np.sqrt(built.model.bodies["ring"].bases[d].omega2) / (2.0 * np.pi)


@pytest.mark.slow
def test_bending_of_the_ring_beside_a_thin_ring(bodies):
    """In-plane bending of a thin ring without extension (Love, Theory of Elasticity, art. 293):

    w^2 = E I / (rho A R^4) d^2 (d^2 - 1)^2 / (d^2 + 1).  Shear and rotary inertia lower it by about
    (d h / R)^2 / 3 at nodal diameter d, which is 0.4 % at 4 and 1.4 % at 8.  Displacements linear along
    an element raise it by about a twelfth of the squared phase over the element: 0.4 % at 4, 1.5 % at 8.
    """
    built = build(bodies, nodal_diameters=[2, 4, 8])
    height, radius, modulus, density = 4e-3, 154e-3, 2.1e11, 7850.0
    for d in (2, 4, 8):
        shape = d**2 * (d**2 - 1) ** 2 / (d**2 + 1)
        omega2 = modulus * height**2 / 12.0 / (density * radius**4) * shape
        thin = np.sqrt(omega2) / (2.0 * np.pi)
        # the next mode bends out of the plane
        found = ring_frequencies(built, d)
        nearest = found[np.argmin(abs(found - thin))]
        phase = d * 2.0 * np.pi / N / 5.0
        assert nearest == pytest.approx(
            thin, rel=(d * height / radius) ** 2 / 3.0 + phase**2 / 12.0
        )


class TestCalculix:
    pytestmark = pytest.mark.skipif(shutil.which("ccx") is None, reason="CalculiX (ccx) is missing")

    @staticmethod
    def cyclic(text, sets, d, n_modes, held):
        """The deck with a cyclic tie between its faces, but for nodes that are held."""
        lines = [text]
        for name in FACES:
            free = np.setdiff1d(sets[name], sets["BORE"]) if held else sets[name]
            lines += [f"*NSET, NSET=N{name}", *(f"{k + 1}," for k in free)]
            lines += [f"*SURFACE, NAME=S{name}, TYPE=NODE", f"N{name},"]
        if held:
            lines += ["*BOUNDARY", "BORE, 1, 3"]
        lines += [
            "*TIE, NAME=CYCLE, CYCLIC SYMMETRY, POSITION TOLERANCE=1e-3",
            "SLOW, SHIGH",
            f"*CYCLIC SYMMETRY MODEL, N={N}, NGRAPH=1, TIE=CYCLE",
            "0., 0., 0., 0., 0., 1.",
            f"*STEP\n*FREQUENCY\n{2 * n_modes},",
            f"*SELECT CYCLIC SYMMETRY MODES, NMIN={d}, NMAX={d}",
            "*NODE FILE\nU\n*END STEP\n",
        ]
        return "\n".join(lines)

    @pytest.mark.slow
    @pytest.mark.parametrize(
        ("kind", "d"), [*(("C3D8", d) for d in (0, 1, 2, 4, 12)), ("C3D8I", 2), ("C3D8I", 4)]
    )
    def test_free_ring(self, bodies, tmp_path, kind, d):
        """CalculiX lists each frequency of a cyclic model twice; the rigid motions are near 0 Hz there.

        CalculiX keeps the inertia of the internal modes of C3D8I, which are condensed here.  This
        matters above 5 kHz, at the nodal diameters that are compared with C3D8 alone.
        """
        from tools.make_example_decks import STEPS
        from tools.ring_sector import meshes, text_of

        run_job("\n".join([text_of("ring", kind), *STEPS]), tmp_path, "ring")
        ring = build((bodies[0], read_job(tmp_path / "ring.inp")), nodal_diameters=[d])
        sets = meshes()["ring"][2]
        theirs = run(self.cyclic(text_of("ring", kind), sets, d, 4, False), tmp_path)[::2]
        ours = ring_frequencies(ring, d)[:4]
        n_rigid = {0: 2, 1: 2}.get(d, 0)
        assert (ours[:n_rigid] == 0.0).all() and theirs[:n_rigid].max(initial=0.0) < 1e-2
        assert (ours[n_rigid:] > 10.0).all()
        np.testing.assert_allclose(
            ours[n_rigid : n_rigid + 2], theirs[n_rigid : n_rigid + 2], rtol=1e-4
        )

    @pytest.mark.slow
    def test_bonded_ring(self, bodies, tmp_path):
        """Sector and ring with common nodes on their face: so many patches leave the face no other motion."""
        from tools.ring_sector import joined

        # twice as many patches along the arc change the frequencies by less than 1e-10
        # with the vectors of partial contact the first stuck frequency alone is exact, and the second 2e-4 higher
        one = study(
            build(bodies, points=(5, 2), n_damper_modes=30),
            blade_modes=20,
            damper_modes=24,
            contact_stiffness=bd.ResidualModes(partial_contact=False),
        )
        text, sets = joined()
        theirs = run(self.cyclic(text, sets, ORDER, 2, True), tmp_path)[::2]
        around = theirs[0] * np.array([0.9, 1.1])
        assert one.stuck(around).peak.frequency == pytest.approx(theirs[0], rel=1e-4)
        ours = one.campbell((200.0, 201.0), [ORDER], modes=2).stuck[ORDER // 4, 0]
        np.testing.assert_allclose(ours, theirs[:2], rtol=1e-4)


@pytest.mark.slow
def test_rigid_motions(built, bodies):
    """Along and about the axis at nodal diameter 0, across it and tilting at 1, with exact modal mass over a sector."""
    ring = build(bodies, nodal_diameters=[0, 1, 2]).model.bodies["ring"]
    n_rigid = [int((ring.bases[d].omega2 == 0.0).sum()) for d in (0, 1, 2)]
    assert n_rigid == [2, 2, 0]
    points = built.model.interfaces["seat"].points
    frames = built.model.interfaces["seat"].frame
    along = frames[:, :, 2] / np.sqrt(ring.mass)
    np.testing.assert_allclose(ring.bases[0].contact_modes[:, :, 0], along, atol=1e-9)
    # about the axis: the moment of inertia of the sector about it
    inertia = ring.inertia[2, 2] + ring.mass * ring.radius**2
    about = np.cross([0.0, 0.0, 1.0], points)
    about = np.einsum("pij,pj->pi", frames, about) / np.sqrt(inertia)
    # points are means over plane patches, which lie inside of the arc
    np.testing.assert_allclose(
        ring.bases[0].contact_modes[:, :, 1], about, atol=2e-5 * abs(about).max()
    )
    # a ring that moves across: sector by sector the phase undoes the rotation
    across = np.einsum("pij,j->pi", frames, [1.0, -1.0j, 0.0]) / np.sqrt(2.0 * ring.mass)
    stored = ring.bases[1].contact_modes[:, :, :2].reshape(-1, 2)
    combination = np.linalg.lstsq(stored, across.ravel(), rcond=None)[0]
    assert np.linalg.norm(stored @ combination - across.ravel()) < 1e-9 * np.linalg.norm(across)
    assert np.linalg.norm(combination) == pytest.approx(1.0, rel=1e-9)


def test_contact_axes_follow_the_circumference(built):
    face = built.model.interfaces["seat"]
    outward = face.points * [1.0, 1.0, 0.0]
    outward /= np.linalg.norm(outward, axis=1)[:, None]
    np.testing.assert_allclose(face.frame[:, 2], outward, atol=1e-6)
    np.testing.assert_allclose(face.frame[:, 1], np.tile([0.0, 0.0, -1.0], (10, 1)), atol=1e-9)


def test_hoop_stress_carries_a_part_of_the_load(built, split):
    """A split ring presses its seat with its whole load, a closed one with less.

    Without the seat a closed thin ring grows by its load over the pitch times E A / R.
    """
    ring = built.model.bodies["ring"]
    radius, area = ring.radius, 4e-3 * 10e-3
    hoop = 2.1e11 * area / radius * (2.0 * np.pi / N)
    growth = ring.load.displacement[:, 2].mean()
    assert growth == pytest.approx(1.0 / hoop, rel=0.03)
    preload = 1000.0
    closed = study(built).static(preload).normal_force["seat"]
    whole = study(split).static(preload).normal_force["seat"]
    # forces on the seat: along the normal, and friction against its motion relative to the ring
    face = built.model.interfaces["seat"]
    on_seat = study(split).static(preload).force * [-1.0, -1.0, 1.0]
    resultant = np.einsum("pi,pij->j", on_seat, face.frame)
    assert resultant[1] == pytest.approx(preload, rel=1e-6)
    assert whole == pytest.approx(preload, rel=0.02)
    assert 0.3 * preload < closed < 0.95 * preload


def test_load_of_a_rotor_speed(built):
    """The load of one sector: its mass times the radius of its centre of mass."""
    ring = built.model.bodies["ring"]
    omega = 300.0
    assert study(built).at_speed(omega).preload == pytest.approx(
        ring.mass * ring.radius * omega**2, rel=1e-9
    )


@pytest.mark.slow
def test_peaks_over_the_preload(built, split):
    """Friction along the circumference: free below, stuck above, and far lower between them."""
    around = (700.0, 1100.0)
    for model in (built, split):
        one = study(model)
        free = one.free(around).peak
        stuck = one.stuck(around).peak
        assert stuck.frequency > 1.02 * free.frequency
        between = one.peak(300.0, around)
        assert between.status == "complete" and between.amplitude < 0.2 * free.amplitude
        high = one.peak(1e5, around)
        assert high.frequency == pytest.approx(stuck.frequency, rel=1e-3)


@pytest.mark.nightly
@pytest.mark.slow
def test_from_deck_to_an_optimum_with_its_checks(bodies):
    """Time integration and more harmonics confirm an optimum inside of the range."""
    curve = study(build(bodies, points=(5, 1)), harmonics=3).optimal_curve()
    best = curve.optimum
    assert best.status == "complete" and best.amplitude < 0.2 * curve.free.amplitude
    text = str(curve)
    assert "Optimum within the range pass" in " ".join(text.split())
    assert "Search for the optimum pass" in " ".join(text.split())
    assert "Time integration" in text


def test_report_and_picture(built, tmp_path):
    text = said(built.summary())
    assert (
        "ring pass closed ring of 24 sectors, rigid-body motions at nodal diameters 0 and 1 only"
        in text
    )
    assert "ring pass its hoop stiffness carries a part of its centrifugal load" in text
    assert "ring, nodal diameters 0, 4, 8, 12: modes of one rotor speed" in "; ".join(
        built.model.neglected_over_speed()
    )
    built.model.plot(tmp_path / "ring.png")
    assert (tmp_path / "ring.png").stat().st_size > 10000


def test_a_ring_that_is_not_named(bodies):
    with pytest.raises(
        ModelError, match=r"expected Sector\(rings=\{'ring': \(set, set\)\}\).*one sector carries"
    ):
        build(bodies, rings=None)
    pieces = build(bodies, rings={"ring": None})
    assert pieces.model.bodies["ring"].kind == "free"


@pytest.mark.parametrize(
    "case",
    [
        ({"rings": {"collar": FACES}}, SettingError, "rings.*collar"),
        ({"rings": {"ring": ("LOW",)}}, SettingError, "rings 'ring'.*two sets of nodes"),
        ({"rings": {"ring": ("LOW", "SEAT")}}, ModelError, "ring.*sector faces"),
        (
            {"split_rings": ("collar",)},
            SettingError,
            r"split_rings.*names out of the rings \['ring'\].*collar",
        ),
        ({"split_rings": "ring"}, SettingError, "split_rings.*a sequence of names of rings"),
    ],
)
def test_refused(bodies, case):
    sector, kind, text = case
    with pytest.raises(kind, match=text):
        build(bodies, **sector)


def test_a_ring_needs_matrices(bodies):
    bare = replace(bodies[1], stiffness=None, mass=None)
    with pytest.raises(ModelError, match=r"ring.*expected stiffness and mass matrix"):
        build((bodies[0], bare))
