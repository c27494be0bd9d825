"""The shipped disk with made-up speed-dependent matrices, for tests that need no particular values."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

import bdamper as bd
from bdamper.model.modal_basis import SpeedBasis, SpinStatic
from bdamper.model.structure import Body, Model


def turning_body(body: Body, diameters: tuple[int, ...], spin: bool) -> Body:
    """Stiffening of 3 to 9 per squared speed with some coupling of modes, and a residual flexibility that changes."""
    rng = np.random.default_rng(1)
    bases = {}
    for d in diameters:
        basis = replace(body.bases[d], speed=None)
        n, shapes = basis.n_modes, basis.contact_modes.reshape(-1, basis.n_modes)
        coupling = rng.standard_normal((n, n)) + (0.0 if d == 0 else 1j) * rng.standard_normal(
            (n, n)
        )
        residual = basis.flexibility - (shapes / basis.omega2) @ shapes.conj().T
        speed = SpeedBasis(
            omega_ref=0.0,
            stiffness0=np.diag(basis.omega2),
            stiffness2=np.diag(np.linspace(3.0, 9.0, n)) + 0.2 * (coupling + coupling.conj().T),
            residual0=residual,
            residual2=-0.015 / 600.0**2 * residual,
        )
        bases[d] = replace(basis, speed=speed)
    n = sum(len(basis.contact_modes) for basis in bases.values()) // len(bases)
    places = {name: np.array([0.0, 1e-9, 0.0]) for name in body.bases[0].locations}
    static = (
        SpinStatic(contact=1e-11 * rng.standard_normal((n, 3)), locations=places) if spin else None
    )
    return replace(body, bases=bases, spin=static)


def turning_disk(
    diameters: tuple[int, ...] = (0, 5, 10, 15), *, spin: bool = False, model: Model | None = None
) -> Model:
    """The shipped disk with nine contact points; ``spin`` displaces its faces by rotation, some um at 400 rad/s."""
    model = model or bd.reference_model("bladed_disk", 9)
    blade = replace(turning_body(model.bodies["blade"], diameters, spin), local=None)
    return replace(model, bodies={**model.bodies, "blade": blade}, stress={})
