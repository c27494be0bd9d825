"""Random studies of a few masses, and slow sweeps of frequency in time by an integration in plain NumPy, side by side.

The integration shares nothing with the package: central differences, and for each contact the increments of a spring whose
force is limited by the normal load.  All studies and both directions are lanes of the same arrays.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

import bdamper as bd

SEED = 65
MASSES, CONTACTS = 4, 2
"""Most of each; lanes with fewer have masses without forces and contacts without stiffness."""
SETTLING = 80
"""Periods at the first frequency before a sweep begins."""
FILTER = 4.0
"""Periods of the two low passes, one after the other, behind which the amplitude is read."""


@dataclass(frozen=True, eq=False)
class Drawn:
    """A study of some masses: matrices, contacts, force on each freedom, freedom of the response, and a band (Hz)."""

    mass: NDArray
    damping: NDArray
    stiffness: NDArray
    contacts: tuple[dict[str, Any], ...]
    forces: NDArray
    response: int
    band: tuple[float, float]

    def study(self, **settings: Any) -> bd.Study:
        """Return the study of the package."""
        contacts = [bd.Contact(**contact) for contact in self.contacts]
        return bd.lumped(
            self.mass, self.damping, self.stiffness, contacts=contacts, forces=dict(enumerate(self.forces)),
            response=self.response, **settings,
        )  # fmt: skip


def draw(number: int) -> Drawn:
    """Two to four masses in a chain with one or two contacts: stops with gaps, and friction of all kinds.

    Gaps and preloads are between a fiftieth and all of the motion, or of its force, that the masses have without contact in
    resonance, equally distributed in their logarithm.
    """
    rng = np.random.default_rng([SEED, number])

    def decades(low: float, high: float) -> float:
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))

    n = int(rng.integers(2, MASSES + 1))
    mass, coupling = np.diag(rng.uniform(0.5, 2.0, n)), rng.uniform(0.5, 3.0, n - 1)
    stiffness = np.diag([rng.uniform(0.5, 2.0), *rng.uniform(0.0, 0.5, n - 1)])
    for i, k in enumerate(coupling):
        stiffness[i : i + 2, i : i + 2] += k * np.array([[1.0, -1.0], [-1.0, 1.0]])
    omega = float(np.sqrt(np.linalg.eigvals(np.linalg.solve(mass, stiffness)).real.min()))
    damping = float(rng.uniform(0.02, 0.05)) * (omega * mass + stiffness / omega)
    response = int(rng.integers(n))
    forces = np.where(np.arange(n) == response, 0.1, 0.0)
    motion = np.abs(np.linalg.solve(stiffness - omega**2 * mass + 1j * omega * damping, forces))
    contacts = []
    for _ in range(int(rng.integers(1, CONTACTS + 1))):
        kind = str(rng.choice(["stop", "constant", "preloaded", "with a gap"]))
        u, v = (int(i) for i in rng.permutation(n)[:2])
        kt, kn, mu = decades(0.2, 5.0), decades(0.5, 20.0), float(rng.uniform(0.1, 0.6))
        share = decades(0.02, 1.0)
        contact: dict[str, Any] = {}
        if kind != "stop":
            contact |= {"tangential": u, "kt": kt, "mu": mu}
        if kind != "constant":
            contact |= {"normal": v, "kn": kn}
        if kind in ("stop", "with a gap"):
            contact["gap"] = share * float(motion[v])
        else:
            contact["preload"] = share * float(
                kt * motion[u] / mu if kind == "constant" else kn * motion[v]
            )
        contacts.append(contact)
    hertz = omega / (2.0 * np.pi)
    band = hertz * float(rng.uniform(0.6, 0.98)), hertz * float(rng.uniform(1.05, 2.2))
    return Drawn(mass, damping, stiffness, tuple(contacts), forces, response, band)


def highest_in_sweeps(drawn: list[Drawn], periods: int = 2500, steps: int = 128) -> NDArray:
    """(studies, 2) highest amplitude (m) of the first harmonic in slow sweeps up and down, both from rest.

    Parameters
    ----------
    random : list of Drawn
    periods : int
        Of the excitation in a sweep, at the mean frequency.
    steps : int
        In a period of the highest frequency.
    """
    lanes = [(one, up) for one in drawn for up in (True, False)]
    n, m = len(lanes), MASSES
    M, C, K = (np.tile(np.eye(m)[:, :, None], n) for _ in range(3))
    slide, close = np.zeros((2, CONTACTS, m, n))
    kt, kn, mu, load, rest = np.zeros((5, CONTACTS, n))
    force, seen = np.zeros((m, n)), np.zeros(n, int)
    ends = np.array([one.band if up else one.band[::-1] for one, up in lanes]).T * 2.0 * np.pi
    for i, (one, _) in enumerate(lanes):
        k = len(one.mass)
        M[:k, :k, i], C[:k, :k, i], K[:k, :k, i] = one.mass, one.damping, one.stiffness
        force[:k, i], seen[i] = one.forces, one.response
        for c, contact in enumerate(one.contacts):
            if "tangential" in contact:
                slide[c, contact["tangential"], i], kt[c, i], mu[c, i] = (
                    1.0,
                    contact["kt"],
                    contact["mu"],
                )
            if "normal" in contact:
                close[c, contact["normal"], i], kn[c, i] = 1.0, contact["kn"]
            rest[c, i] = contact.get("preload", 0.0)
            load[c, i] = rest[c, i] - kn[c, i] * contact.get("gap", 0.0)
    dt = 2.0 * np.pi / (steps * ends.max(axis=0))
    inverse = np.linalg.inv(np.moveaxis(M / dt**2 + C / (2.0 * dt), 2, 0))
    onward = [2.0 * M / dt**2 - K, C / (2.0 * dt) - M / dt**2, np.tile(np.eye(m)[:, :, None], n)]
    step = np.concatenate(
        [np.moveaxis(inverse @ np.moveaxis(part, 2, 0), 0, 2) for part in onward], axis=1
    )
    state, friction, u = np.zeros((3 * m, n)), np.zeros((CONTACTS, n)), np.zeros((CONTACTS, n))
    x = state[:m]
    first, omega, phase = ends[0], ends[0].copy(), np.zeros(n)
    mean = ends.mean(axis=0)
    settling, sweeping = (
        int(np.ceil((p * 2.0 * np.pi / (w * dt)).max()))
        for p, w in ((SETTLING, first), (periods, mean))
    )
    change = (ends[1] - ends[0]) / sweeping
    slow, slower, highest, lane = (
        np.zeros(n, complex),
        np.zeros(n, complex),
        np.zeros(n),
        np.arange(n),
    )
    for i in range(settling + sweeping):
        normal = np.maximum(load + kn * np.einsum("cil,il->cl", close, x), 0.0)
        before, u = u, np.einsum("cil,il->cl", slide, x)
        limit = mu * normal
        friction = np.minimum(np.maximum(friction + kt * (u - before), -limit), limit)
        turn = np.exp(-1j * phase)
        state[2 * m :] = force * turn.real
        state[2 * m :] -= np.einsum("cil,cl->il", slide, friction) + np.einsum(
            "cil,cl->il", close, normal - rest
        )
        part = omega * dt / (2.0 * np.pi * FILTER)
        slow += part * (2.0 * x[seen, lane] * turn - slow)
        slower += part * (slow - slower)
        following = np.einsum("ijl,jl->il", step, state)
        state[m : 2 * m] = x
        state[:m] = following
        phase += omega * dt
        if i >= settling:
            omega += change
            if i % 32 == 0:
                np.maximum(highest, np.abs(slower), out=highest)
    return highest.reshape(-1, 2)
