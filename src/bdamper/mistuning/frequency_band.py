"""The frequencies between which the blades of a wheel may have their highest peaks, from the waves of the tuned wheel."""

from __future__ import annotations

from dataclasses import replace
from math import tau

import numpy as np

from bdamper.mistuning.wheel_problem import WheelProblem

FAR = 1.5
"""Ratio to the frequency of the tuned peak beyond which a wave of another nodal diameter counts as of another family."""


def band(wheel: WheelProblem, preload: float) -> tuple[float, float, float]:
    """Frequencies (Hz) between which blades may have peaks, and the width of the tuned peak at half its power.

    Every contact point is replaced by the spring and the damper that do what it does in the first harmonic at the tuned
    peak.  The band holds the resonances of all waves of the tuned wheel, and is wider by the standard deviation of the
    blades' frequencies and by two widths at each end.
    """
    tuned, s = wheel.structure.tuned, wheel.structure
    top = wheel.tuned_peak(preload)
    system = tuned.system(preload)
    X, F, _ = system.contact(top.y[:-1])
    x, f = X[..., 1] - 1j * X[..., 2], F[..., 1] - 1j * F[..., 2]
    complex_stiffness = np.where(np.abs(x) > 0.0, f / np.where(np.abs(x) > 0.0, x, 1.0), 0.0)
    springs, loss = np.maximum(complex_stiffness.real, 0.0), np.maximum(complex_stiffness.imag, 0.0)
    omega = float(top.y[-1])
    N, n, nominal = s.n_blades, s.n, replace(s, stiffness=s.local.blade_stiffness[None])
    e = int(tuned.engine_order) % N
    reference, found = None, {}
    for d in [e if 2 * e <= N else N - e, *range(N // 2 + 1)]:
        squares, phi, motion = nominal.wave(d, springs)
        own = phi[: s.local.n_cantilever]
        if reference is None:
            k = int(np.argmin(np.abs(squares - omega**2)))
            reference = own[:, k]
            friction = float((loss.ravel() * np.abs(motion[:, k]) ** 2).sum())
            viscous = float((phi[:n, k].conj() @ s.damping[d] @ phi[:n, k]).real) * omega
            width = (friction + viscous) / omega
        near = np.flatnonzero((squares > (omega / FAR) ** 2) & (squares < (omega * FAR) ** 2))
        if len(near):
            alike = np.abs(reference.conj() @ own[:, near]) / np.linalg.norm(own[:, near], axis=0)
            found[d] = float(np.sqrt(squares[near[int(np.argmax(alike))]]))
    mean, spread = float(wheel.deviation.mean()), float(wheel.deviation.std())
    low = min(omega, *found.values()) * (1.0 + mean - spread) - 2.0 * width
    high = max(omega, *found.values()) * (1.0 + mean + spread) + 2.0 * width
    return low / tau, high / tau, width / tau
