"""Every analysis has the same answer if the phase of the force, the sign or order of coordinates, the sense in which
sectors are numbered, or the sector of a damper changes, because these describe the same structure.

Answers of the harmonic balance agree to the tolerance of its iterations.  A time integration begins at another instant
of the same motion, so that amplitudes of motions that vary from period to period agree to the tolerance of the search.
"""

from dataclasses import replace

import numpy as np
import pytest

import bdamper as bd
from bdamper.model.structure import turn
from bdamper.response.optimum_checks import checks
from bdamper.time_domain.integration import all_sectors
from tests.each import each
from tests.models import wedge_model
from tests.plain import plain_study

PHASES = 0.4, np.pi / 2, 2.6, -1.9
"""Phases (rad) of the force; a quarter turn has no cosine."""
EXACT, IN_TIME = 1e-6, 5e-3


class Answers:
    """Numbers of a study that no symmetry may change, with the curve and the peak that several analyses need."""

    def __init__(self, study, preload, band):
        self.study, self.preload, self.band = study, preload, band
        self.curve = study.frequency_response(preload, band)
        self.highest = study.peak(preload, band)

    def frequency_response(self):
        at_peak = self.curve.shares[self.curve.peak_index]
        return [self.curve.status, self.curve.peak.amplitude, self.curve.peak.frequency, *at_peak]

    def peak(self):
        return [self.highest.status, self.highest.amplitude, self.highest.frequency]

    def linear_limits(self):
        free, stuck = self.study.free(self.band), self.study.stuck(self.band)
        return [free.peak.amplitude, free.peak.frequency, stuck.peak.amplitude]

    def static(self):
        state = self.study.static(self.preload)
        return [state.ok, *np.sort(np.linalg.norm(state.force, axis=-1).ravel())]

    def optimal_curve(self):
        preloads = self.preload * np.array([0.7, 1.0, 1.4])
        curve = self.study.optimal_curve(preloads, frequency=self.band, check=False)
        return [*curve.status, *curve.amplitude, curve.optimum.preload]

    def dissipation(self):
        loops = self.study.dissipation(self.curve)
        return [loops.damping_ratio[self.curve.peak_index]]

    def stability(self):
        curve = self.study.with_stability(self.curve)
        return [int(curve.unstable.sum())]

    def effect_significance(self):
        effects = self.study.effect_significance(self.preload, self.band)
        return [effects.amplitude, effects.frequency, effects.amplitude_change]

    def estimate_errors(self):
        return [self.study.estimate_errors(self.highest).amplitude]

    def harmonic_convergence(self):
        found = self.study.harmonic_convergence(self.highest, harmonics=(3, 5))
        return [peak.amplitude for peak in found.peaks]

    def sweep(self):
        values = [self.preload, 1.3 * self.preload]
        table = bd.sweep(self.study, {"preload": values}, frequency=self.band)
        return [*table.status, *table.array("amplitude")]

    def peak_sensitivities(self):
        parameters = "preload", "excitation.amplitude", "damping_factor"
        found = self.study.peak_sensitivities(self.highest, parameters)
        return [found[name].amplitude for name in parameters]

    def nonlinear_mode(self):
        scale = self.curve.peak.amplitude
        mode = self.study.nonlinear_mode(self.preload, 1, (0.01 * scale, 2.0 * scale))
        return [mode.damping_ratio.max(), mode.frequency[0]]

    def robust_optimum(self):
        friction = {"friction_coefficient": [0.3, 0.4]}
        preloads = (0.7 * self.preload, 1.4 * self.preload)
        found = bd.optimal_curve_uncertainty(self.study, friction, preloads, 2, frequency=self.band)
        return [*found.amplitude.ravel()]

    def amplitude_bound(self):
        sectors = all_sectors(self.study.problem, self.preload)
        return [sectors.amplitude_bound(2.0 * np.pi * self.highest.frequency)]


class InTime(Answers):
    """Amplitudes and verdicts of time integration."""

    def time_response(self):
        response = self.study.time_response(self.curve)
        return [response.status, response.mean]

    def motion_in_time(self):
        motion = self.study.motion_in_time(self.curve)
        return [motion.status, motion.amplitude[-1]]

    def frequency_sweep(self):
        peak = self.curve.peak.frequency
        sweep = self.study.frequency_sweep(self.preload, (0.99 * peak, 1.01 * peak), rate=None)
        return [sweep.status, sweep.amplitude.max()]


BY_BALANCE = sorted(name for name in vars(Answers) if not name.startswith("_"))
COSTLY = {"effect_significance", "estimate_errors", "harmonic_convergence", "robust_optimum"}
"""Analyses that take too long on a wheel, or need nodal diameters that the small one does not have."""
BY_INTEGRATION = sorted(name for name in vars(InTime) if not name.startswith("_"))


def assert_same(found, expected, tolerance):
    """Equal words, and numbers that differ by at most ``tolerance`` relative to the largest of their kind."""
    assert len(found) == len(expected)
    for value, right in zip(found, expected):
        if isinstance(right, str):
            assert value == right
        else:
            assert value == pytest.approx(right, rel=tolerance, abs=1e-12, nan_ok=True)


# ---- lumped masses ----


def two_masses(force=0.3, sign=1.0, order=(0, 1)):
    """Two masses in either order, with coordinates of either sign, a contact between them and one with the ground."""
    first, second = order.index(0), order.index(1)
    contacts = [
        bd.Contact({second: sign, first: -sign}, normal={second: sign}, kt=1.0, kn=1.0, mu=0.5),
        bd.Contact({first: sign}, kt=0.3, mu=0.4, preload=0.2),
    ]
    if first == 1:
        contacts.reverse()

    def placed(values):
        return [values[place] for place in order]

    return bd.lumped(
        placed([1.0, 0.1]),
        placed([0.02, 0.02]),
        placed([1.0, 0.1]),
        contacts=contacts,
        forces={first: sign * force},
        load_per_preload={second: sign},
        harmonics=3,
    )


LUMPED = {
    **{f"phase {phase:.3g}": {"force": 0.3 * np.exp(1j * phase)} for phase in PHASES},
    "sign": {"sign": -1.0},
    "order": {"order": (1, 0)},
}


@pytest.fixture(scope="module")
def lumped():
    """Answers of the two masses as they stand, and of each change."""
    changes = {"": {}} | LUMPED
    return {
        name: InTime(two_masses(**change), 1.0, (0.1, 0.35)) for name, change in changes.items()
    }


@pytest.mark.slow
@each("name", BY_BALANCE)
def test_two_masses(lumped, name):
    right = getattr(lumped[""], name)()
    for change in LUMPED:
        assert_same(getattr(lumped[change], name)(), right, EXACT)


@pytest.mark.slow
@each("name", BY_INTEGRATION)
def test_two_masses_in_time(lumped, name):
    right = getattr(lumped[""], name)()
    assert right[0] == "complete"
    for change in LUMPED:
        assert_same(getattr(lumped[change], name)(), right, IN_TIME)


@pytest.mark.slow
@each("phase", PHASES)
def test_a_mass_whose_damping_alone_limits_it(phase):
    """Slight friction: without the sine of the force, the limit of its amplitude was next to nothing."""
    contact = bd.Contact(0, kt=0.5, mu=1.0, preload=0.05)
    force = 0.1 * np.exp(1j * phase)
    study = bd.lumped(1.0, 0.02, 1.0, contacts=[contact], forces={0: force}, harmonics=3)
    curve = study.frequency_response(0.0, (0.1, 0.3))
    # friction of 0.05 N on a motion at its resonance, by the energy of one cycle
    omega = 2.0 * np.pi * curve.peak.frequency
    expected = (0.1 - 4.0 * 0.05 / np.pi) / (0.02 * omega)
    assert curve.peak.amplitude == pytest.approx(expected, rel=0.1)
    response = study.time_response(curve)
    assert response.status == "complete"
    assert response.mean == pytest.approx(curve.peak.amplitude, rel=2e-3)


@pytest.mark.slow
def test_the_default_optimum_of_a_wedge():
    """All checks, of which time integration limits its amplitude, give the same."""
    # half of a symmetric wedge, with a face of 45 degrees
    c = np.sqrt(0.5)
    face = bd.Contact({0: -c, 1: c}, {0: c, 1: c}, kt=2.0, kn=2.0, mu=0.3)
    found = []
    for phase in (0.0, np.pi / 2):
        study = bd.lumped(
            [1.0, 0.01],
            [0.01, 0.0],
            [1.0, 0.0],
            contacts=[face],
            forces={0: 0.1 * np.exp(1j * phase)},
            load_per_preload={1: 1.0},
        )
        found.append(study.optimal_curve((0.1, 1.0), 5, frequency=(0.1, 0.4)))
    at_rest, turned = found
    assert_same([*turned.status, turned.optimum.kind], [*at_rest.status, at_rest.optimum.kind], 0.0)
    assert_same(
        [*turned.amplitude, turned.optimum.preload],
        [*at_rest.amplitude, at_rest.optimum.preload],
        EXACT,
    )
    in_time = [[kept.status, kept.mean] for kept in turned.time_response]
    right = [[kept.status, kept.mean] for kept in at_rest.time_response]
    assert len(in_time) == len(right) > 0
    for own, expected in zip(in_time, right):
        assert expected[0] == "complete"
        assert_same(own, expected, IN_TIME)
    words = [[(check.name, check.colour) for check in checks(curve)] for curve in found]
    assert words[0] == words[1]


@pytest.mark.slow
def test_the_test_rig():
    """Blades and dampers that are no part of a ring."""
    model = bd.reference_model("test_rig")
    found = []
    for phase in (0.0, np.pi / 2):
        excitation = bd.Excitation("tip", phase=phase)
        study = plain_study(model, excitation, friction_coefficient=0.3, blade_modes=5)
        curve = study.frequency_response(100.0, (300.0, 350.0))
        response = study.time_response(curve)
        found.append((curve, response))
    (right, kept), (turned, kept_turned) = found
    assert right.complete and kept.ok
    assert_same(
        [turned.status, turned.peak.amplitude, turned.peak.frequency],
        [right.status, right.peak.amplitude, right.peak.frequency],
        EXACT,
    )
    assert_same([kept_turned.status, kept_turned.mean], [kept.status, kept.mean], IN_TIME)


# ---- a wheel ----

N, ORDER, PRELOAD, BAND = 12, 2, 50.0, (1000.0, 1250.0)
TIP = bd.Excitation("tip", amplitude=10.0)


def changed_bases(body, change, components):
    """The bases of a body with ``change`` of complex numbers, and signs of the components of contacts and locations."""
    along_contact, along_axes = components
    bases = {}
    for d, basis in body.bases.items():
        signs = np.tile(along_contact, len(basis.contact_modes))
        bases[d] = replace(
            basis,
            contact_modes=change(basis.contact_modes) * along_contact[:, None],
            locations={
                name: change(rows) * along_axes[:, None] for name, rows in basis.locations.items()
            },
            flexibility=change(basis.flexibility) * np.outer(signs, signs),
        )
    return bases


def moved(model, matrix, components, change=np.asarray, sectors=lambda face, sector: sector):
    """The model with all vectors multiplied by ``matrix``, and other sectors of its faces."""
    along_contact, _ = components
    bodies = {}
    for name, body in model.bodies.items():
        new = replace(body, bases=changed_bases(body, change, components))
        if body.is_free:
            load = replace(
                body.load,
                direction=matrix @ body.load.direction,
                displacement=body.load.displacement * along_contact,
            )
            inertia = matrix @ body.inertia @ matrix.T
            new = replace(new, centre=matrix @ body.centre, inertia=inertia, load=load)
        bodies[name] = new
    faces = {}
    for name, face in model.interfaces.items():
        faces[name] = replace(
            face,
            points=face.points @ matrix.T,
            frame=along_contact[:, None] * (face.frame @ matrix.T),
            sector_b=sectors(face, face.sector_b),
        )
    return replace(model, bodies=bodies, interfaces=faces, meshes={})


def mirrored(model):
    """The model in a mirror: X and the sense in which sectors are numbered change their sign.

    Waves travel the other way, so that shapes are complex conjugate.  The second tangential axis changes its sign, which
    keeps the frames right-handed.
    """
    mirror = np.diag([-1.0, 1.0, 1.0])
    components = np.array([1.0, -1.0, 1.0]), np.diag(mirror)
    new = moved(model, mirror, components, np.conj, lambda face, sector: -sector)
    places = {
        name: replace(place, position=mirror @ place.position)
        for name, place in model.locations.items()
    }
    return replace(new, locations=places)


def damper_of_sector_before(model):
    """The model in which the damper of the sector before counts as the damper of a sector."""
    same = np.ones(3), np.ones(3)
    before = turn(-2.0 * np.pi / N)

    def sectors(face, sector):
        return sector - 1 if face.body_b == "blade" else sector

    # the blade stays where it is
    new = moved(model, before, same, sectors=sectors)
    return replace(new, bodies=new.bodies | {"blade": model.bodies["blade"]})


def reordered(model):
    """The model with its bodies and interfaces in the opposite order."""
    return replace(
        model,
        bodies=dict(reversed(model.bodies.items())),
        interfaces=dict(reversed(model.interfaces.items())),
        contact=dict(reversed(model.contact.items())),
    )


def wheel(model=None, excitation=TIP, order=ORDER):
    # the face of 52 degrees tells a mirror
    model = wedge_of_two_angles() if model is None else model
    return plain_study(
        model,
        excitation,
        order,
        harmonics=3,
        blade_modes=5,
        contact_stiffness="model",
        friction_coefficient={"left": 0.35, "right": 0.25},
    )


def wedge_of_two_angles():
    return wedge_model(0, N, ORDER, alpha=np.radians(52.0), beta=np.radians(45.0))


WHEELS = {
    "phase": {"excitation": replace(TIP, phase=np.pi / 2)},
    "mirror": {"model": mirrored(wedge_of_two_angles()), "order": N - ORDER},
    "sector": {"model": damper_of_sector_before(wedge_of_two_angles())},
    "order": {"model": reordered(wedge_of_two_angles())},
}


@pytest.fixture(scope="module")
def wheels():
    changes = {"": {}} | WHEELS
    return {name: InTime(wheel(**change), PRELOAD, BAND) for name, change in changes.items()}


@pytest.mark.slow
@each("name", sorted(set(BY_BALANCE) - COSTLY))
@pytest.mark.filterwarnings(
    "ignore:engine_order"
)  # the same wave as of order 2, against the numbering
def test_a_wheel(wheels, name):
    right = getattr(wheels[""], name)()
    for change in WHEELS:
        assert_same(getattr(wheels[change], name)(), right, EXACT)


@pytest.mark.slow
@each("name", ["time_response", "motion_in_time"])
def test_a_wheel_in_time(wheels, name):
    right = getattr(wheels[""], name)()
    assert right[0] == "complete"
    for change in ("phase", "mirror", "sector"):
        assert_same(getattr(wheels[change], name)(), right, IN_TIME)
