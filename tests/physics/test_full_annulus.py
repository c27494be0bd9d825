"""A full annulus of eight sectors against the model of one.

The annulus is put together here in physical coordinates and in one global frame: every blade a set of lumped degrees of
freedom tied to its neighbours, every damper a rigid body that moves and turns about global axes, contact points and normals
turned sector by sector.  Nothing of the cyclic conventions of the package enters.  All eight sectors are then one system of
the core.  A motion that repeats from sector to sector with the phase of an engine order must give, in every sector, the
residual of the one-sector model with the same phase.
"""

from dataclasses import replace

import numpy as np
import pytest

import bdamper as bd
from bdamper.contact.laws import PointArrays
from bdamper.harmonic_balance.sector import SectorData
from bdamper.model.kinematics import HarmonicBasis
from bdamper.model.structure import Body, ModalBasis
from bdamper.response.events import ContinuationOptions
from bdamper.util.progress import CostMeter
from tests.following import find_start
from tests.models import wedge_model
from tests.plain import plain_study

N, H, DOF = 8, 4, 6
DAMPING = 4e-3
MU = 0.35
PRELOAD = 300.0


def turn(k):
    """From the axes of sector 0 to those of sector k: +Y moves toward +X."""
    angle = 2 * np.pi * k / N
    return np.array(
        [[np.cos(angle), np.sin(angle), 0], [-np.sin(angle), np.cos(angle), 0], [0, 0, 1]]
    )


class Structure:
    """Physical properties of a blade with lumped degrees of freedom, unit masses, tied to its neighbours."""

    def __init__(self, seed=0):
        rng = np.random.default_rng(seed)
        self.template = wedge_model(
            seed, n_blades=N, engine_order=3, n_points=4, harmonics=H, alpha=0.7, beta=0.9
        )
        faces = self.template.interfaces
        a = rng.normal(size=(DOF, DOF))
        scale = (2 * np.pi * 300.0) ** 2
        self.own = scale * (
            np.diag(np.arange(1.0, DOF + 1) ** 2) + 0.1 * a @ a.T + 2.0 * np.eye(DOF)
        )
        self.tie = -scale * (
            0.3 * np.eye(DOF) + 0.05 * rng.normal(size=(DOF, DOF))
        )  # to the next sector
        # motion in the blade's own axes: at its contact points under the damper of the same sector, of the one before, and
        # at the tip
        self.left = rng.normal(size=(faces["left"].n_points, 3, DOF))
        self.right = rng.normal(size=(faces["right"].n_points, 3, DOF))
        self.tip = rng.normal(size=(3, DOF))

    def dynamic_stiffness(self, d):
        """Stiffness of a wave of d nodal diameters."""
        z = np.exp(2j * np.pi * d / N)
        K = self.own + self.tie * z + self.tie.T * np.conj(z)
        return K.real if d in (0, N // 2) else K

    def model(self):
        """The one-sector model, as its conventions ask for it."""
        faces = self.template.interfaces
        bases = {}
        for d in range(N // 2 + 1):
            omega2, modes = np.linalg.eigh(self.dynamic_stiffness(d))
            ports = np.concatenate(
                [faces["left"].frame @ self.left, faces["right"].frame @ turn(1) @ self.right]
            )
            bases[d] = ModalBasis(
                omega2, np.full(DOF, DAMPING), ports @ modes, {"tip": self.tip @ modes}
            )
        blade = Body("blade", "constrained", self.template.bodies["blade"].ports, bases)
        # a rigid damper, its load without elastic deformation
        damper = self.template.bodies["damper"]
        basis = damper.bases[0]
        rigid = replace(
            basis,
            omega2=basis.omega2[:6],
            damping_ratio=basis.damping_ratio[:6],
            contact_modes=basis.contact_modes[..., :6],
            flexibility=None,
        )
        load = replace(
            damper.load,
            generalised=damper.load.generalised[:6],
            displacement=np.zeros_like(damper.load.displacement),
        )
        damper = replace(damper, bases={0: rigid}, load=load)
        return replace(
            self.template, bodies={**self.template.bodies, "blade": blade, "damper": damper}
        )


def skew(r):
    return np.array([[0, r[2], -r[1]], [-r[2], 0, r[0]], [r[1], -r[0], 0]])  # w x r = skew(r) w


def annulus(structure, study, engine_order):
    """All sectors as one system of the core, and the maps from the unknowns of one sector to those of all.

    Returns the system of the core, ``wave(l)`` (the modal coordinates of all sectors, complex, by those of one, at harmonic
    l) and the number of modes.
    """
    whole, wave, n = annulus_system(structure, study, engine_order)
    return whole.core, wave, n


def annulus_system(structure, study, engine_order):
    """The same as a system of harmonic balance with one real basis."""
    model = structure.template
    faces = [model.interfaces[name] for name in ("left", "right", "front", "back")]
    damper = model.bodies["damper"]
    one = study.problem.system(PRELOAD)

    K = np.zeros((N * DOF, N * DOF))
    for k in range(N):
        rows, after = (
            slice(k * DOF, (k + 1) * DOF),
            slice((k + 1) % N * DOF, ((k + 1) % N + 1) * DOF),
        )
        K[rows, rows] += structure.own
        K[rows, after] += structure.tie
        K[after, rows] += structure.tie.T
    omega2, V = np.linalg.eigh(K)

    # the six rigid-body coordinates of the study as translation and rotation (t, w) about the centre, sector 0
    port = np.concatenate([face.points for face in faces]) - damper.centre
    frames = np.concatenate([face.frame for face in faces])
    kinematics = np.concatenate(
        [np.tile(np.eye(3), (len(port), 1, 1)), np.array([skew(r) for r in port])], axis=2
    )
    stored = study.problem.coupling.model.bodies["damper"].bases[0].contact_modes[..., :6]
    rigid = np.linalg.lstsq(
        (frames @ kinematics).reshape(-1, 6), stored.real.reshape(-1, 6), rcond=None
    )[0]
    inertia = np.block(
        [[damper.mass * np.eye(3), np.zeros((3, 3))], [np.zeros((3, 3)), damper.inertia]]
    )
    np.testing.assert_allclose(rigid.T @ inertia @ rigid, np.eye(6), rtol=0, atol=1e-12)

    n_blade, n = N * DOF, N * (DOF + 6)
    blocks = []
    for k in range(N):
        Rk = turn(k)
        for i, face in enumerate(faces):
            for p in range(face.n_points):
                frame = face.frame[p] @ Rk.T  # rows t1, t2, n in global axes
                relative = np.zeros((3, n))
                r = Rk @ (face.points[p] - damper.centre)
                both = (
                    np.block([[Rk, np.zeros((3, 3))], [np.zeros((3, 3)), Rk]]) @ rigid
                )  # t and w in global axes
                columns = slice(n_blade + 6 * k, n_blade + 6 * (k + 1))
                relative[:, columns] -= both[:3] + skew(r) @ both[3:]
                if i < 2:  # a blade on the other side: of this sector, or of the next
                    j = (k + i) % N
                    shape = structure.left[p] if i == 0 else structure.right[p]
                    relative[:, :n_blade] += turn(j) @ shape @ V[j * DOF : (j + 1) * DOF]
                row = frame @ relative
                row[2] *= -1.0  # closing
                blocks.append(row)
    G = np.array(blocks)

    def wave(l):
        phase = np.exp(2j * np.pi * engine_order * l * np.arange(N) / N)
        modes = np.linalg.eigh(
            structure.dynamic_stiffness(min(l * engine_order % N, -l * engine_order % N))
        )[1]
        modes = modes.conj() if l * engine_order % N > N // 2 else modes
        blade = V.T @ np.concatenate([z * modes for z in phase])
        bodies = np.concatenate([z * np.eye(6) for z in phase])
        out = np.zeros((n, DOF + 6), complex)
        out[:n_blade, :DOF], out[n_blade:, DOF:] = blade, bodies
        return out

    # loads: the tip force of the engine order on every blade, the radial load on every damper
    force = np.zeros(n * (2 * H + 1))
    for k in range(N):
        Rk = turn(k)
        load = PRELOAD * (Rk @ [0.0, 1.0, 0.0]) @ (Rk @ rigid[:3])
        force[n_blade + 6 * k : n_blade + 6 * (k + 1)] = load
        tip = study.excitation.amplitude * np.exp(
            1j * (study.excitation.phase + 2 * np.pi * engine_order * k / N)
        )
        pull = V[k * DOF : (k + 1) * DOF].T @ structure.tip[0] * tip
        force[n : n + n_blade] += pull.real
        force[2 * n : 2 * n + n_blade] -= pull.imag
    p = one.structure.points
    damping = np.concatenate([np.full(n_blade, DAMPING), np.zeros(6 * N)])
    stiffness = np.concatenate([omega2, np.zeros(6 * N)])
    basis = HarmonicBasis(
        (), stiffness, damping, G.reshape(-1, 3, n).astype(complex), 0, np.ones(n)
    )
    points = PointArrays(
        kt=np.tile(p.kt, (N, 1)),
        kn=np.tile(p.kn, N),
        mu=np.tile(p.mu, N),
        n0=np.tile(p.n0, N),
        slider=np.tile(p.slider, (N, 1)),
        law=np.tile(p.law, N),
        shift=np.tile(p.shift, (N, 1)),
    )
    system = SectorData([basis] * (H + 1), points, force, [np.zeros(n)] * (H + 1)).equations
    return system, wave, n


def spread(one, u, wave, n, flip=False):
    """Unknowns (or residual) of one sector, repeated around the annulus."""
    out = np.empty(n * (2 * H + 1))
    for l in range(H + 1):
        q = one.layout.amplitudes(u, l)
        # the mean of the annulus is the real wave of nodal diameter 0
        x = wave(l) @ q
        if l == 0:
            out[:n] = x.real
            assert np.abs(x.imag).max() == 0.0
        else:
            x = x.conj() if flip else x
            out[n * (2 * l - 1) : n * 2 * l], out[n * 2 * l : n * (2 * l + 1)] = x.real, -x.imag
    return out


def make_study(structure, engine_order, amplitude=5.0):
    return plain_study(
        structure.model(),
        bd.Excitation("tip", amplitude=amplitude, phase=0.3),
        engine_order=engine_order,
        friction_coefficient=MU,
        harmonics=H,
        contact_stiffness=2e6,
        blade_modes=DOF,
    )


def shares_all(system, u, n):
    out = np.empty((n, 5))
    motion, force = (np.empty((n, 3, 2 * H + 1)) for _ in range(2))
    assert system.contact(np.append(u, 1.0), motion, force, out) == 0  # at any frequency
    return out


# nodal diameters of harmonics 1..4; a star marks the conjugated ones
ORDERS = {2: "2 4 2* 0", 3: "3 2* 1 4", 5: "3* 2 1* 4", 7: "1* 2* 3* 4"}


@pytest.mark.parametrize("engine_order", ORDERS, ids=[f"EO {k}: {v}" for k, v in ORDERS.items()])
def test_travelling_waves_give_the_same_residual(engine_order):
    structure = Structure()
    study = make_study(structure, engine_order)
    one = study.problem.system(PRELOAD)
    system, wave, n = annulus(structure, study, engine_order)
    rng = np.random.default_rng(engine_order)
    slip = separation = 0.0
    for _ in range(4):
        u = 2e-6 * rng.normal(size=one.n_unknowns)
        u[: one.n_mean] += study.static(PRELOAD).q
        omega = 2 * np.pi * rng.uniform(250.0, 900.0)
        r = one.evaluate(u, omega)[0]
        shares = one.contact(u)[2]
        whole = np.full(system.n_unknown, np.nan)
        waves = spread(one, u, wave, n)
        assert system.evaluate(np.append(waves, omega), whole) == 0
        expected = spread(one, r, wave, n)
        np.testing.assert_allclose(whole, expected, rtol=0, atol=1e-12 * np.abs(expected).max())
        np.testing.assert_allclose(
            shares_all(system, waves, N * one.n_points), np.tile(shares, (N, 1)), rtol=0, atol=1e-9
        )
        friction = one.structure.points.mu > 0
        slip += shares[friction][:, [1, 3]].mean() / 4
        separation += ((shares[friction][:, 4] > 0) & (shares[friction][:, 4] < 1)).mean() / 4
        # the annulus also sees what one sector cannot: a wave that runs the other way is another motion
        flipped = np.empty_like(whole)
        assert system.evaluate(np.append(spread(one, u, wave, n, flip=True), omega), flipped) == 0
        wrong = spread(one, r, wave, n, flip=True)
        assert np.abs(flipped - wrong).max() > 1e-3 * np.abs(expected).max()
    assert slip > 0.1
    assert separation > 0.3


@pytest.mark.parametrize("engine_order", [3, 5])
def test_a_converged_solution_of_one_sector_is_one_of_the_annulus(engine_order):
    structure = Structure()
    study = make_study(structure, engine_order, amplitude=300.0)
    options = ContinuationOptions(tolerance=1e-11)
    u, one, omega = None, study.problem.system(PRELOAD), 0.0
    for frequency in (800.0, 1000.0):
        omega = 2 * np.pi * frequency
        y, _ = find_start(study.problem, PRELOAD, omega, options, CostMeter())
        if y is not None:
            u = y[:-1]
            shares = one.contact(u)[2][one.structure.points.mu > 0]
            if shares[:, [1, 3]].max() > 0.05 and shares[:, 4].max() > 0:
                break
    else:
        pytest.fail("no frequency with slip and separation")
    system, wave, n = annulus(structure, study, engine_order)
    r = np.full(system.n_unknown, np.nan)
    assert system.evaluate(np.append(spread(one, u, wave, n), omega), r) == 0
    # relative to the scales of the study: excitation for the harmonics, static load for the mean
    excitation, load = (
        np.abs(study.problem.modal_force(1)).max(),
        PRELOAD * np.abs(study.problem.coupling.load()[0]).max(),
    )
    assert np.abs(r[n:]).max() <= 1e-10 * excitation
    assert np.abs(r[:n]).max() <= 1e-10 * max(load, excitation)


def test_the_static_state_is_the_same_in_every_sector():
    structure = Structure()
    study = make_study(structure, 3)
    state = study.static(PRELOAD)
    one = study.problem.system(PRELOAD)
    system, wave, n = annulus(structure, study, 3)
    u = np.zeros(one.n_unknowns)
    u[: one.n_mean] = state.q
    r = np.empty(system.n_unknown)
    assert system.evaluate(np.append(spread(one, u, wave, n), 1000.0), r) == 0
    assert np.abs(r[:n]).max() <= 1e-9 * PRELOAD * 10
    assert state.force[:, 2].max() > 1.0
