"""Checks of the data over rotor speed, as those of :mod:`bdamper.model.validation`."""

from __future__ import annotations

import numpy as np

from bdamper.model.checks import SINGLE, check_array, check_hermitian, check_one_of, check_type, require
from bdamper.model.model import Body, ModalBasis
from bdamper.model.spin import SpeedBasis, SpinStatic
from bdamper.util.errors import mismatch

STIFFNESS_TOLERANCE = 1e-9


def check_speed(basis: ModalBasis, speed: SpeedBasis, item: str) -> None:
    """Matrices of the right symmetry that give back the basis at its own speed."""
    check_type(speed, SpeedBasis, item)
    for name in ("omega_ref", "checked_at", "error"):
        value = getattr(speed, name)
        good = isinstance(value, int | float | np.floating) and np.isfinite(value) and value >= 0
        if not good and (value is not None or name == "omega_ref"):
            raise mismatch(f"{item}/@{name}", "a finite number >= 0", repr(value))
    require(basis.drag is None, f"{item}", "no drag on modes that change with speed", "drag")
    n, m = basis.n_modes, 3 * len(basis.contact_modes)
    for name in ("stiffness0", "stiffness2"):
        check_array(getattr(speed, name), (n, n), f"{item}/{name}", "field")
        check_hermitian(getattr(speed, name), f"{item}/{name}")
    if speed.coriolis is not None:
        check_array(speed.coriolis, (n, n), f"{item}/coriolis", "field")
        check_hermitian(1j * speed.coriolis, f"{item}/coriolis", "skew-Hermitian")
    size = np.sqrt(np.maximum(basis.omega2, 1e-8 * basis.omega2.max(initial=0.0)))
    error = np.abs(speed.stiffness(speed.omega_ref) - np.diag(basis.omega2)) / (size[:, None] * size)
    require(
        error.max(initial=0.0) <= STIFFNESS_TOLERANCE,
        f"{item}/stiffness0",
        "stiffness0 + omega_ref^2 stiffness2 = the diagonal matrix of omega2",
        f"a relative difference of {error.max(initial=0.0):.3g}",
    )
    if speed.residual0 is None and speed.residual2 is None:
        return
    for name in ("residual0", "residual2"):
        check_array(getattr(speed, name), (m, m), f"{item}/{name}", "field")
        check_hermitian(getattr(speed, name), f"{item}/{name}")
    if basis.flexibility is None:
        return
    shapes, used = basis.contact_modes.reshape(m, n), basis.omega2 > 0.0
    whole = speed.residual(speed.omega_ref) + (shapes[:, used] / basis.omega2[used]) @ shapes[:, used].conj().T
    error = np.linalg.norm(whole - basis.flexibility) / (np.linalg.norm(basis.flexibility) or 1.0)
    expected = "residual0 + omega_ref^2 residual2 + Phi Omega^-2 Phi^H = flexibility"
    require(error <= SINGLE, f"{item}/residual0", expected, f"a relative difference of {error:.3g}")


def check_spin(body: Body, spin: SpinStatic, item: str) -> None:
    check_type(spin, SpinStatic, item)
    check_array(spin.contact, (len(body.bases[0].contact_modes), 3), f"{item}/contact")
    if set(spin.locations) != set(body.bases[0].locations):
        raise mismatch(f"{item}/locations", f"{sorted(body.bases[0].locations)}", f"{sorted(spin.locations)}")
    for name, values in spin.locations.items():
        check_array(values, (3,), f"{item}/locations/{name}")
    check_one_of(spin.theory, ("linear", "stiffened"), f"{item}/@theory")
    good = isinstance(spin.omega, int | float | np.floating) and np.isfinite(spin.omega) and spin.omega >= 0
    require(good, f"{item}/@omega", "a finite number >= 0", repr(spin.omega))
