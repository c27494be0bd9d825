"""A friction ring of lumped masses against the equations of blade and ring, written without the package."""

import numpy as np
import pytest
from scipy.optimize import fsolve, minimize_scalar

import bdamper as bd
from bdamper.model.structure import (
    Body,
    BodyLoad,
    ContactStiffness,
    Interface,
    Location,
    ModalBasis,
    Model,
)
from bdamper.model.validation import check_model
from bdamper.util.errors import ModelError, PlausibilityWarning, SettingError

N, ORDER = 24, 4
BLADE, BLADE_STIFFNESS, DAMPING = 0.2, 0.2 * 5000.0**2, 0.002
RING, HOOP = 0.02, 8.0e6
"""Mass of the ring per sector, and the spring along the circumference between two sectors."""
CONTACT, NORMAL, MU = 1.5e6, 3.0e6, 0.3
BREATHING = 2.0e6
"""Radial stiffness of a closed ring per sector: its hoop force."""
FORCE = 1.0


def ring_stiffness(d):
    """Stiffness of the wave of d nodal diameters in a chain of masses along the circumference."""
    return 2.0 * HOOP * (1.0 - np.cos(2.0 * np.pi * d / N))


def basis(omega2, motion, flexibility=None, locations=None):
    """One basis with the motion (3, n) along t1, t2, n of one contact point."""
    omega2 = np.asarray(omega2, float)
    return ModalBasis(
        omega2=omega2,
        damping_ratio=np.zeros(len(omega2)),
        contact_modes=np.asarray(motion, float)[None],
        locations=locations or {},
        flexibility=flexibility,
    )


def ring(split):
    """The ring: circumferential motion at each nodal diameter, radial motion at nodal diameter 0."""
    unit = 1.0 / np.sqrt(RING)
    stiff = 1e12 * np.arange(1, 6)  # modes that do not move the contact
    bases = {}
    for d in (0, 4, 8, 12):
        motion = np.zeros((3, 6))
        if d:
            motion[0, 0] = unit
            bases[d] = basis([ring_stiffness(d) / RING, *stiff], motion)
            continue
        radial, along, about = (0, 1, 2) if split else (2, 0, 1)
        motion[2, radial] = unit
        motion[1, along] = unit
        motion[0, about] = unit
        omega2 = [0.0, 0.0, 0.0, *stiff[:3]]
        omega2[radial] = 0.0 if split else BREATHING / RING
        bases[d] = basis(omega2, motion)
    generalised = np.zeros(6)
    generalised[0 if split else 2] = unit
    displacement = np.array([[0.0, 0.0, 0.0 if split else 1.0 / BREATHING]])
    load = BodyLoad(np.array([0.0, 1.0, 0.0]), generalised, displacement)
    return Body(
        "ring", "ring", (("seat", "a"),), bases, RING, np.array([0.0, 0.15, 0.0]), 1e-6 * np.eye(3), load
    )  # fmt: skip


def model(split=True):
    modes = {}
    for d in (0, 4, 8, 12):
        motion = np.array([[1.0], [0.0], [0.0]]) / np.sqrt(BLADE)
        modes[d] = ModalBasis(
            omega2=np.array([BLADE_STIFFNESS / BLADE]),
            damping_ratio=np.array([DAMPING]),
            contact_modes=motion[None],
            locations={"tip": motion},
        )
    face = Interface(
        "seat", "friction", "ring", 0, "blade", 0, np.array([[0.0, 0.156, 0.0]]), np.array([1e-4]),
        np.array([[[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]]), np.zeros(1),
    )  # fmt: skip
    return Model(
        n_blades=N,
        bodies={
            "ring": ring(split),
            "blade": Body("blade", "constrained", (("seat", "b"),), modes),
        },
        interfaces={"seat": face},
        locations={"tip": Location("tip", "blade", np.array([0.0, 0.2, 0.0]))},
        contact={"seat": ContactStiffness(np.array([[CONTACT, CONTACT, NORMAL]]), "user")},
    )


def study(split=True, **settings):
    force = bd.Excitation("tip", "tangential", FORCE)
    used = {
        "engine_order": ORDER,
        "harmonics": 1,
        "friction_coefficient": MU,
        "blade_modes": 1,
        **settings,
    }
    return bd.Study(model(split), force, contact_stiffness="model", **used)


def friction(amplitude, limit):
    """Complex stiffness of a spring that slips at ``limit``, for one harmonic, in closed form."""
    slip = limit / CONTACT
    if amplitude <= slip:
        return complex(CONTACT)
    angle = np.arccos(1.0 - 2.0 * slip / amplitude)
    real = CONTACT / np.pi * (angle - 0.5 * np.sin(2.0 * angle))
    imaginary = 4.0 * limit * (1.0 - slip / amplitude) / (np.pi * amplitude)
    return real + 1j * imaginary


def blade_amplitude(omega, limit):
    """Amplitude of the blade (m) in the sticking and slipping wave of nodal diameter 4."""
    of_blade = BLADE_STIFFNESS - BLADE * omega**2
    of_blade = of_blade + 2j * DAMPING * np.sqrt(BLADE_STIFFNESS * BLADE) * omega
    of_ring = ring_stiffness(ORDER) - RING * omega**2

    def motion(amplitude):
        k = friction(amplitude, limit)
        return np.linalg.solve([[of_blade + k, -k], [-k, of_ring + k]], [FORCE, 0.0])

    def error(unknown):
        x, y = motion(abs(unknown[0]))
        return [abs(x - y) / unknown[0] - 1.0]

    best = []
    for start in np.geomspace(1e-8, 1e-3, 16):
        found, _, converged, _ = fsolve(error, [start], xtol=1e-14, full_output=True)
        if converged == 1 and abs(error(found)[0]) < 1e-10:
            best.append(abs(motion(abs(found[0]))[0]))
    return max(best)


@pytest.mark.parametrize("preload", [2.0, 10.0, 40.0, 200.0])
def test_split_ring_of_lumped_masses_against_its_equations(preload):
    """The whole load presses the face of a split ring; amplitude and frequency of the peak agree to 1e-6."""
    peak = study().peak(preload, (700.0, 1000.0))
    assert peak.status == "complete"
    limit = MU * preload

    def negative(hertz):
        return -blade_amplitude(2.0 * np.pi * hertz, limit)

    near = (peak.frequency * (1 - 2e-3), peak.frequency * (1 + 2e-3))
    found = minimize_scalar(negative, near, bounds=near, method="bounded", options={"xatol": 1e-7})
    assert peak.amplitude == pytest.approx(-found.fun, rel=1e-6)
    assert peak.frequency == pytest.approx(found.x, rel=1e-6)


def test_hoop_force_carries_its_share():
    """Contact and hoop stiffness are springs side by side under the radial load of a closed ring."""
    preload = 100.0
    for split, share in ((True, 1.0), (False, NORMAL / (NORMAL + BREATHING))):
        one = study(split)
        force = one.static(preload).force
        assert force[0, 2] == pytest.approx(share * preload, rel=1e-9)


def test_a_ring_has_rigid_motions_at_nodal_diameters_0_and_1_alone():
    whole = model()
    body = whole.bodies["ring"]
    wrong = dict(body.bases)
    wrong[8] = wrong[0]
    body = Body(**{**vars(body), "bases": wrong})
    with pytest.raises(ModelError, match=r"ring.*nd008.*expected 0 rigid-body modes of a ring"):
        check_model(Model(**{**vars(whole), "bodies": {**whole.bodies, "ring": body}}))


def test_damping_of_a_ring():
    """A damper to the rotor acts on the ring at every nodal diameter; a ratio has no meaning there."""
    drag = 4.0
    free = study(damper_drag=drag)
    own = [
        b.drag[k]
        for b in free.problem.bases
        for k, c in enumerate(b.coordinates)
        if c.body == "ring"
    ]
    assert own == pytest.approx([drag / RING] * len(own))
    with pytest.raises(SettingError, match="damper_damping_ratio of 'ring'"):
        study(damper_damping_ratio=0.1)


def test_only_an_engine_order_of_all_sectors_moves_a_ring_along_its_axis():
    """Otherwise slip leaves the mean position along and about the axis undetermined, and it is held."""
    names = {(c.body, c.index) for c in study().problem.coupling.basis(0).coordinates}
    assert {("ring", 0), ("ring", 3)} <= names and not {("ring", 1), ("ring", 2)} & names
    with pytest.warns(PlausibilityWarning, match="engine_order"):
        whole = study(engine_order=N)
    names = {(c.body, c.index) for c in whole.problem.coupling.basis(0).coordinates}
    assert {("ring", k) for k in range(6)} <= names


def test_file_and_mistuned_disk(tmp_path):
    whole = model(split=False)
    bd.save_model(whole, tmp_path / "ring.h5")
    assert bd.load_model(tmp_path / "ring.h5").hash == whole.hash
    assert "ring: ring, 6 modes at nodal diameters 0, 4, 8, 12, 0.02 kg per sector" in str(whole)
    with pytest.raises(
        SettingError, match=r"bladed disk: expected dampers between two blades .*rings \['ring'\]"
    ):
        bd.BladedDisk(study())
