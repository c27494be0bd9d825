"""What a wheel must keep: turned patterns, mirrored wheels, the direction of the wave, the balance of energy."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg

import bdamper as bd
from bdamper.harmonic_balance.sector import Sector
from bdamper.mistuning import BladedDisk, DamperVariation, Mistuning
from bdamper.model.kinematics import HarmonicBasis
from tests.mistuning.lumped import lumped_study, size, solution

PRELOAD, N = 300.0, 6
PATTERN = Mistuning(0.03 * np.random.default_rng(4).normal(size=N))


def study(engine_order=1, harmonics=1, **options):
    return lumped_study(N, engine_order, harmonics=harmonics, n_c=2, r=2, **options).replace(
        excitation=bd.Excitation("tip", amplitude=100.0)
    )


def solved(wheel, omega=2.0 * np.pi * 190.0, tolerance=1e-12):
    system = wheel.system(PRELOAD)
    found = solution(system, omega, tolerance=tolerance)
    assert found.status == 0
    assert 0.05 < system.contact(found.y[:-1])[2][..., 1].mean() < 0.9
    return system.structure.array(found.y[:-1]), system


def heights(system, X):
    return np.abs(system.structure.responses(system.structure.flat(X))[:, 1])


def taken(dampers, order):
    """The same dampers at other places."""
    names = ("mass", "friction_coefficient", "contact_stiffness", "gap", "missing")
    return DamperVariation(**{name: getattr(dampers, name)[order] for name in names})


def turned(X, blades=1, engine_order=1):
    """The answer that belongs to a pattern turned by some blades: sectors moved on, the wave with them."""
    out = np.roll(X, blades, axis=0)
    for l in range(1, X.shape[1] // 2 + 1):
        z = (out[:, 2 * l - 1] - 1j * out[:, 2 * l]) * np.exp(2j * np.pi * engine_order * l * blades / len(X))
        out[:, 2 * l - 1], out[:, 2 * l] = z.real, -z.imag
    return out


def assert_same(found, expected, tolerance):
    """Equal means and equal vibrations, each beside its own largest entry."""
    for part in (slice(0, 1), slice(1, None)):
        assert np.abs(found[:, part] - expected[:, part]).max() < tolerance * np.abs(expected[:, part]).max()


def test_a_pattern_turned_by_one_blade_turns_the_answer():
    dampers = DamperVariation.of(N, mass=1.0 + 0.1 * np.arange(N), missing=[3])
    base = BladedDisk(study(harmonics=2), mistuning=PATTERN, dampers=dampers)
    X, _ = solved(base)
    other, _ = solved(base.replace(mistuning=np.roll(PATTERN.deviation, 1), dampers=taken(dampers, np.arange(N) - 1)))
    assert_same(other, turned(X), 1e-12)


class Mirror:
    """The plane between two blades, with the contact points and the coordinates that it turns into each other.

    Blade ``n`` becomes blade ``-n``, the damper behind it the one before; the left face of a wedge of equal angles becomes
    its right one.  Even and odd coordinates of a blade alternate, those of the wedge that move across the plane are odd.
    """

    BLADE = np.array([1.0, -1.0, 1.0, -1.0])

    def __init__(self, model):
        faces = [model.interfaces[name] for name in ("left", "right", "front", "back")]
        self.own = sum(face.n_points for face in faces[:2])
        points = np.concatenate([face.points for face in faces])
        frames = np.concatenate([face.frame for face in faces])
        plane = np.diag([-1.0, 1.0, 1.0])
        self.partner = np.linalg.norm((points @ plane)[:, None] - points, axis=2).argmin(axis=1)
        self.axes = frames @ plane @ frames[self.partner].transpose(0, 2, 1)

    def rows(self, rows, signs):
        """Rows of the mirrored motion: those of the partner, in the axes of the point itself."""
        return self.axes[: len(rows)] @ rows[self.partner[: len(rows)]] * signs

    def damper(self, structure):
        """Signs of the coordinates of a damper, from their motion at the contact points."""
        rows = structure.rows[..., structure.n :]
        signs = np.sign((rows * self.rows(rows, 1.0)).sum(axis=(0, 1)))
        np.testing.assert_allclose(self.rows(rows, signs), rows, atol=1e-12 * np.abs(rows).max())
        return signs

    def answer(self, X, structure):
        """The mirrored answer."""
        n, before = structure.n, np.arange(len(X))
        blades = X[-before, :, :n] * self.BLADE[structure.order]
        return np.concatenate([blades, X[-before - 1, :, n:] * self.damper(structure)], axis=2)


def symmetric_study(engine_order, harmonics):
    """The study with a mirror plane between its blades."""
    base = study(engine_order, harmonics)
    model = base.model
    mirror, blade, damper = Mirror(model), model.bodies["blade"], model.bodies["damper"]
    local, S = blade.local, Mirror.BLADE
    even, half = 0.5 * (1.0 + np.outer(S, S)), mirror.own // 2
    shapes = local.contact_modes.copy()
    shapes[half:] = mirror.rows(shapes, S)[half:]
    r = local.disk_stiffness.shape[1]
    waves, size = np.sin(2.0 * np.pi * np.arange(N // 2 + 1) / N).round(12), np.abs(local.disk_stiffness).max()
    cross = 0.1 * size * np.array([[0.0, 1j], [-1j, 0.0]]) * waves[:, None, None]
    local = replace(
        local,
        blade_mass=local.blade_mass * even,
        disk_stiffness=local.disk_stiffness.real * even[-r:, -r:] + cross,
        contact_modes=shapes,
        locations={name: place * (0.5 + 0.5 * S) for name, place in local.locations.items()},
    )
    bases = {d: local.nodal_diameter(d) for d in range(N // 2 + 1)}
    load = replace(damper.load, displacement=np.zeros_like(damper.load.displacement))
    bodies = {"blade": replace(blade, bases=bases, local=local), "damper": replace(damper, load=load)}
    return base.replace(model=replace(model, bodies={**model.bodies, **bodies}))


def test_a_mirrored_wheel_with_the_reversed_order_has_the_mirrored_answer():
    """Where the sector has a mirror plane; the reversed order alone has another answer."""
    dampers = DamperVariation.of(N, mass=1.0 + 0.05 * np.arange(N), missing=[3])
    forward, backward = (BladedDisk(symmetric_study(e, 2), PATTERN, dampers) for e in (1, N - 1))
    mirror, s = Mirror(forward.study.model), forward.structure
    X, system = solved(forward)
    expected = mirror.answer(X, s)
    mirrored_pattern = PATTERN.deviation[-np.arange(N)]
    mirrored, _ = solved(backward.replace(mistuning=mirrored_pattern, dampers=taken(dampers, -np.arange(N) - 1)))
    assert_same(mirrored, expected, 1e-12)
    reverse, other = solved(backward)
    assert np.abs(heights(other, reverse) / heights(system, X) - 1.0).max() > 1e-2
    for pattern, shift in ((PATTERN, 1), (mirrored_pattern, 0)):
        others = taken(dampers, -np.arange(N) - shift)
        system = backward.replace(mistuning=pattern, dampers=others).system(PRELOAD)
        y = np.append(system.structure.flat(expected), 2.0 * np.pi * 190.0)
        assert size(system, system.residual(y)) > 1e-3, "a neighbour's place"


def test_the_reversed_order_differs_on_the_same_pattern():
    forward, _ = solved(BladedDisk(study(1), mistuning=PATTERN))
    backward, _ = solved(BladedDisk(study(N - 1), mistuning=PATTERN))
    a, b = (np.linalg.norm(X[:, 1:], axis=(1, 2)).max() for X in (forward, backward))
    assert abs(a / b - 1.0) > 1e-3


def test_dampers_of_another_mass_keep_it_on_other_blades():
    heavy, light = DamperVariation.of(N, mass=1.2), DamperVariation.of(N, mass=0.9)
    wheel = BladedDisk(study(), dampers=heavy)
    one = wheel.structure.damper_mass / 1.2
    changes = ({"mistuning": PATTERN}, 1.2), ({"dampers": light}, 0.9), ({"dampers": None}, 1.0)
    for other, factor in ((wheel.replace(**change), factor) for change, factor in changes):
        np.testing.assert_allclose(other.structure.damper_mass, factor * one, rtol=1e-14)


@pytest.mark.parametrize("harmonics", [1, 3])
def test_the_work_of_the_excitation_is_what_damping_and_friction_take(harmonics):
    wheel = BladedDisk(study(harmonics=harmonics), mistuning=PATTERN)
    X, system = solved(wheel)
    omega = 2.0 * np.pi * 190.0
    l = np.repeat(np.arange(harmonics + 1), 2)[1:, None]
    quarter = np.zeros_like(X)  # the velocity over the frequency: cosine l s, sine -l c
    quarter[:, 1::2], quarter[:, 2::2] = X[:, 2::2] * l[1::2], -X[:, 1::2] * l[2::2]
    work = np.pi * float(system.structure.force @ system.structure.flat(quarter))
    s = wheel.structure
    wave = np.fft.fft(quarter[..., : s.n], axis=0)
    viscous = np.fft.ifft(np.einsum("dij,dcj->dci", s.damping, wave), axis=0).real
    viscous = np.pi * omega * float((viscous * quarter[..., : s.n]).sum())
    F = system.contact(system.structure.flat(X))[1].reshape(N, -1, 3, X.shape[1])
    friction = np.pi * sum(float((F[..., c] * s.motion(quarter[:, c])).sum()) for c in range(X.shape[1]))
    assert friction > 0.1 * work > 0.0
    assert abs(work - viscous - friction) < 1e-10 * work


def test_the_tuned_wheel_tracks_the_curve_of_the_study():
    wheel = BladedDisk(study(harmonics=2))
    curve = wheel.frequency_response(2000.0, (150.0, 215.0))
    assert curve.complete, curve.reason
    tuned = wheel.tuned()
    whole = tuned.frequency_response(2000.0, (150.0, 215.0))
    system = tuned.problem.system(2000.0)
    assert np.ptp(np.abs(curve.blades[..., 1]), axis=1).max() < 1e-7 * curve.amplitude.max()
    near = np.abs(curve.frequency[:, None] - whole.frequency).argmin(axis=1)
    for i in range(0, len(curve), 5):
        found = system.correct_at(
            whole.unknowns[near[i]], 2.0 * np.pi * curve.frequency[i], np.full(system.n_unknowns + 1, 1e-6), 1e-11, 30, True
        )
        assert found.status == 0
        assert abs(abs(system.response(found.y[:-1])[1]) / curve.amplitude[i] - 1.0) < 1e-7


def test_bad_input_is_refused_at_once():
    with pytest.raises(bd.SettingError, match="mistuning: expected 6 blades, as in the model, found 5"):
        BladedDisk(study(), mistuning=np.zeros(5))
    with pytest.raises(bd.SettingError, match="separation"):
        BladedDisk(study().replace(separation=False))
    bare = study().model
    blade = replace(bare.bodies["blade"], local=None)
    with pytest.raises(bd.ModelError, match="local basis"):
        BladedDisk(study().replace(model=replace(bare, bodies={**bare.bodies, "blade": blade})))


def test_the_whole_annulus_as_one_system_has_the_same_solution():
    """All sectors in one real modal basis of the mistuned annulus, by the equations of a study of one sector."""
    wheel = BladedDisk(study(harmonics=3, zeta=0.0), mistuning=PATTERN)
    X, system = solved(wheel, tolerance=1e-11)
    s, omega = wheel.structure, 2.0 * np.pi * 190.0
    n, ns, nd, r = s.n, s.n_sector, s.n_damper, s.local.n_interface
    turn = np.exp(2j * np.pi * np.outer(np.arange(N), np.arange(N)) / N) / N
    K, M = np.zeros((2, N, n, N, n))
    for k in range(N):
        for j in range(N):
            for whole, disk in ((K, s.disk_stiffness), (M, s.disk_mass)):
                kernel = np.einsum("d,dij->ij", turn[(k - j) % N], disk)
                assert np.abs(kernel.imag).max() < 1e-9 * np.abs(disk).max()
                whole[k, n - r :, j, n - r :] += kernel.real
        K[k, :, k] += s.stiffness[k]
        M[k, :, k] += s.mass
    omega2, V = scipy.linalg.eigh(K.reshape(N * n, -1), M.reshape(N * n, -1))
    G = np.zeros((N, len(s.sector), 3, N * ns))
    for k in range(N):
        for p, shift in enumerate(s.sector):
            j = (k + shift) % N
            G[k, p, :, : N * n] += s.rows[p, :, :n] @ V[j * n : (j + 1) * n]
            G[k, p, :, N * n + k * nd : N * n + (k + 1) * nd] = s.rows[p, :, n:]
    stiffness = np.concatenate([omega2, np.tile(s.damper_stiffness, N)])
    zero = np.zeros(N * ns)
    basis = HarmonicBasis((), stiffness, zero, G.reshape(-1, 3, N * ns).astype(complex), 0, np.ones(N * ns))

    def modal(force):
        return np.concatenate([V.T @ force[:, :n].ravel(), force[:, n:].ravel()])

    def coordinates(x):
        return np.concatenate([V.T @ M.reshape(N * n, -1) @ x[:, :n].ravel(), x[:, n:].ravel()])

    forces = system.structure.array(system.structure.force)
    force = np.concatenate([modal(forces[:, c]) for c in range(7)])
    whole = Sector([basis] * 4, system.structure.points, force, [np.zeros(N * ns)] * 4, "event_driven").equations
    u = np.concatenate([coordinates(X[:, c]) for c in range(7)])
    residual = whole.evaluate(u, omega)[0]
    assert np.abs(residual).max() < 1e-9 * np.abs(force).max()
    scale = np.full(len(u) + 1, np.abs(u).max())
    found = whole.correct_at(u * (1.0 + 1e-4), omega, scale, 1e-11, 30, True)
    assert found.status == 0
    assert np.abs(found.y[:-1] - u).max() < 1e-7 * np.abs(u).max()


def test_a_curve_passes_where_dampers_come_free_along_the_axis():
    """At 397.9 Hz the mean axial force of the fully slipping dampers vanishes, and they move on; only vibration counts."""
    base = lumped_study(8, 1, harmonics=1, n_c=2, r=2).replace(excitation=bd.Excitation("tip", amplitude=40.0))
    wheel = BladedDisk(base)
    curve = wheel.frequency_response(PRELOAD, (390.0, 405.0))
    assert curve.complete, curve.reason
    tuned = wheel.tuned().frequency_response(PRELOAD, (390.0, 405.0))
    assert any("drifts" in note for note in tuned.notes)
    assert curve.amplitude[-1] == pytest.approx(tuned.amplitude[-1], rel=1e-6)
