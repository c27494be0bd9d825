"""Lumped wheels for tests: every blade a few masses on a disk mass, dampers those of the random wedge."""

from dataclasses import replace

import numpy as np

import bdamper as bd
from bdamper.harmonic_balance.equations import Fixed
from bdamper.model.modal_basis import LocalBasis
from tests.models import wedge_model

FREQUENCY = 2.0 * np.pi * 200.0


def lumped_local(
    model, n_blades, n_c=2, r=1, n_att=0, seed=1, coupling=0.05, zeta=2e-3, complex_disk=False
):
    """Cantilever modes, attachments and root shapes with random contact rows, on a chain of disk masses."""
    rng = np.random.default_rng(seed)
    n_points = sum(model.interfaces[name].n_points for name, _ in model.bodies["blade"].ports)
    n = n_c + n_att + r
    omega2 = (FREQUENCY * np.arange(1, n_c + 1) ** 1.5) ** 2
    K = np.zeros((n, n))
    K[:n_c, :n_c] = np.diag(omega2)
    if n_att:
        K[n_c : n_c + n_att, n_c : n_c + n_att] = np.diag(
            FREQUENCY**2 * (30.0 + 10.0 * np.arange(n_att))
        )
    M = np.eye(n)
    M[:n_c, n_c + n_att :] = 0.5 * rng.normal(size=(n_c, r))
    M[n_c + n_att :, :n_c] = M[:n_c, n_c + n_att :].T
    M[n_c + n_att :, n_c + n_att :] += 2.0 * np.eye(r)
    waves = np.arange(n_blades // 2 + 1)
    a = rng.normal(size=(r, r))
    own = FREQUENCY**2 * (20.0 * np.eye(r) + a @ a.T)
    tie = coupling * FREQUENCY**2 * 20.0 * (np.eye(r) + 0.3 * rng.normal(size=(r, r)))
    z = np.exp(2j * np.pi * waves / n_blades)[:, None, None]
    disk = own + 2.0 * coupling * FREQUENCY**2 * 40.0 * np.eye(r) - tie * z - tie.T * z.conj()
    disk = 0.5 * (disk + disk.conj().transpose(0, 2, 1))
    second = 0.2 * tie * z**2
    disk = disk - second - second.conj().transpose(0, 2, 1)
    for d in waves:
        if 2 * d % n_blades == 0:
            disk[d] = disk[d].real
    shapes = rng.normal(size=(n_points, 3, n))
    shapes[..., n_c + n_att :] *= 0.3
    return LocalBasis(
        region="masses",
        omega2=omega2,
        damping_ratio=np.full(n, zeta),
        blade_stiffness=K,
        blade_mass=M,
        disk_stiffness=disk.astype(complex),
        disk_mass=np.repeat(np.eye(r)[None], len(waves), axis=0).astype(complex),
        contact_modes=shapes,
        locations={"tip": rng.normal(size=(3, n)) + 1.0},
    )


def lumped_study(
    n_blades=6, engine_order=1, harmonics=1, n_points=4, constraint_planes=True, **options
):
    """A study whose model carries a lumped local basis."""
    own = ("friction_coefficient", "bias", "contact_forces", "friction_law")
    settings = {k: options.pop(k) for k in list(options) if k in own}
    model = wedge_model(
        0, n_blades=n_blades, engine_order=engine_order, n_points=n_points, n_damper_modes=0
    )
    local = lumped_local(model, n_blades, **options)
    blade = model.bodies["blade"]
    bases = {d: local.nodal_diameter(d) for d in range(n_blades // 2 + 1)}
    model = replace(
        model, bodies={**model.bodies, "blade": replace(blade, bases=bases, local=local)}
    )
    return bd.Study(
        model, bd.Excitation("tip", amplitude=1.0), engine_order, harmonics=harmonics, contact_stiffness=2e6,
        constraint_planes=constraint_planes, blade_modes=local.n, **settings,
    )  # fmt: skip


def solution(system, omega, start=None, tolerance=1e-11):
    """Newton's method with shortened steps at one frequency, from the static state or from unknowns."""
    y = np.append(system.structure.at_rest if start is None else start, omega)
    return system.solve(y, Fixed(), system.structure.units_about(y, 1.0), tolerance, 60, 2)


def size(system, r):
    """Largest entry of a residual, relative to excitation and static load."""
    return float(np.abs(r * system.row_scale).max())


def wave(structure, u):
    """Unknowns of the wheel, (n_blades, n_coefficients, n_sector), from those of the tuned study."""
    system, N = structure.tuned, structure.n_blades
    bases = system.bases
    H = len(bases) - 1
    out = np.zeros((N, 2 * H + 1, structure.n_sector))
    start = 0
    for l, basis in enumerate(bases):
        m = basis.n_modes
        if m == 0:
            continue
        q = u[start : start + m] - (1j * u[start + m : start + 2 * m] if l else 0.0)
        start += m if l == 0 else 2 * m
        own = np.array([system.model.bodies[c.body].local is None for c in basis.coordinates])
        d, conjugate = system.model.folded_nodal_diameter(l * int(system.engine_order))
        phi = structure.modes(d)
        x = np.concatenate([(phi.conj() if conjugate else phi) @ q[~own], q[own]])
        turned = x * np.exp(2j * np.pi * system.engine_order * l * np.arange(N) / N)[:, None]
        if l == 0:
            out[:, 0] = turned.real
        else:
            out[:, 2 * l - 1], out[:, 2 * l] = turned.real, -turned.imag
    return out
