"""Random contact points and small systems for tests of the C core, and finite differences of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bdamper import _core

EXACT, SAMPLED, PLAIN = range(3)
STICK, PLUS, MINUS, OPEN = range(4)


@dataclass(frozen=True)
class Point:
    """Arguments of one contact element."""

    kt: NDArray
    kn: float
    mu: float
    n0: float
    w: NDArray

    @property
    def arguments(self) -> tuple:
        return self.kt, self.kn, self.mu, self.n0, self.w


@dataclass(frozen=True)
class Evaluated:
    """What the core says about a point: force (3, M), tangent (3, M, 3, M), shares (5,), parts of the cycle."""

    force: NDArray
    tangent: NDArray
    shares: NDArray
    parts: tuple

    @property
    def states(self) -> tuple:
        """Sequence of states in both directions, turned so that the cut at theta = 0 does not matter."""
        out = []
        for parts in self.parts:
            sequence = [state for _, _, state in parts]
            if len(sequence) > 1 and sequence[0] == sequence[-1]:
                sequence.pop()
            turns = [tuple(sequence[i:] + sequence[:i]) for i in range(len(sequence))] or [()]
            out.append(min(turns))
        return tuple(out)


def evaluate(
    x, point: Point, contact_forces: int = EXACT, n_time: int = 0, law: int = 0
) -> Evaluated:
    """One contact point; outputs are filled with NaN before, so that what is not written shows.

    The number of samples does not count where the evaluation is exact.
    """
    n_time = 0 if contact_forces == EXACT else n_time
    x = np.ascontiguousarray(x, float)
    force, tangent = np.full(x.shape, np.nan), np.full(x.shape + x.shape, np.nan)
    shares, parts = _core.evaluate_contact(
        x, *point.arguments, force, tangent, law, contact_forces, n_time
    )
    return Evaluated(force, tangent, np.array(shares), parts)


def random_point(rng: np.random.Generator) -> Point:
    return Point(
        kt=rng.uniform(0.5, 3.0, 2),
        kn=float(rng.uniform(0.5, 3.0)),
        mu=float(rng.uniform(0.1, 0.9)),
        n0=float(rng.uniform(-1.5, 3.0)),
        w=rng.uniform(-0.5, 0.5, 2),
    )


def random_motion(rng: np.random.Generator, n_harm: int) -> NDArray:
    """(3, M) with harmonics that fall off, as they do in a response."""
    decay = np.concatenate([[1.0], np.repeat(1.0 / np.arange(1, n_harm + 1), 2)])
    return rng.normal(size=(3, 2 * n_harm + 1)) * decay


def difference(f, x: NDArray, h: float = 1e-5) -> NDArray:
    """Derivative of f (...,) with respect to x: (..., *x.shape), of fourth order in h."""
    out = []
    for index in np.ndindex(x.shape):
        values = []
        for step in (h, -h, 2 * h, -2 * h):
            moved = np.array(x)
            moved[index] += step
            values.append(f(moved))
        out.append((8 * (values[0] - values[1]) - (values[2] - values[3])) / (12 * h))
    out = np.array(out)
    return np.moveaxis(out, 0, -1).reshape(out.shape[1:] + x.shape)


def far_from_events(
    x: NDArray, point: Point, rng: np.random.Generator, distance: float = 5e-3
) -> bool:
    """Whether the sequence of states stays the same all around x, with no part about to vanish."""
    here = evaluate(x, point)
    if any(
        end - start < 4 * distance
        for parts in here.parts
        for start, end, _ in parts
        if len(parts) > 1
    ):
        return False
    for _ in range(12):
        move = rng.normal(size=x.shape)
        move *= distance * np.abs(x).max() / np.abs(move).max()
        if (
            evaluate(x + move, point).states != here.states
            or evaluate(x - move, point).states != here.states
        ):
            return False
    return True


def random_arrays(
    rng: np.random.Generator,
    n_mode,
    n_point: int,
    *,
    massless: int = 0,
    constraint_points: int = 0,
) -> dict:
    """Arguments of ``_core.SectorEquations``; the last modes have no mass, the last points are stops with a gap."""
    n_mode = np.array(n_mode, np.intc)
    total = int(n_mode.sum())
    unknowns = int(n_mode[0] + 2 * n_mode[1:].sum())
    shapes = [(n_point, 3, n) for n in n_mode]
    G = [
        rng.normal(size=shape) + (1j * rng.normal(size=shape) if l else 0)
        for l, shape in enumerate(shapes)
    ]
    mass = np.ones(total)
    for l in range(len(n_mode)):
        last = int(n_mode[: l + 1].sum())
        mass[last - min(massless, n_mode[l]) : last] = 0.0
    points = [random_point(rng) for _ in range(n_point)]
    mu = np.array([p.mu for p in points])
    n0 = np.array([p.n0 for p in points])
    law = np.zeros(n_point, np.intc)
    if constraint_points:
        mu[-constraint_points:] = 0.0
        n0[-constraint_points:] = -0.3
        law[-constraint_points:] = 1
    return {
        "n_mode": n_mode,
        "stiffness": rng.uniform(0.5, 3.0, total),
        "mass": mass,
        "damping": rng.uniform(0.01, 0.1, total),
        "G": np.concatenate([g.ravel() for g in G]).astype(complex)
        if total
        else np.zeros(0, complex),
        "kt": np.array([p.kt for p in points]).reshape(n_point, 2),
        "kn": np.array([p.kn for p in points]),
        "mu": mu,
        "n0": n0,
        "w": np.array([p.w for p in points]).reshape(n_point, 2),
        "law": law,
        "shift": rng.normal(size=(n_point, 3)) * 0.2,
        "force": rng.normal(size=unknowns),
    }


def for_oracle(arrays: dict) -> dict:
    """The same arguments with G as the oracle wants it: one (n_point, 3, n_mode) array for each harmonic."""
    out = dict(arrays)
    n_point = len(arrays["kn"])
    ends = np.cumsum(3 * n_point * arrays["n_mode"])
    parts = np.split(arrays["G"], ends[:-1])
    out["G"] = [part.reshape(n_point, 3, n) for part, n in zip(parts, arrays["n_mode"])]
    out["kt"] = np.where((arrays["law"] == 1)[:, None], 0.0, arrays["kt"])
    return out


def evaluate_system(system, u, omega):
    """Residual, Jacobian and frequency derivative; outputs pre-filled with NaN."""
    n = system.n_unknown
    r, J, r_omega = np.full(n, np.nan), np.full((n, n), np.nan), np.full(n, np.nan)
    status = system.evaluate(np.append(u, omega), r, J, r_omega)
    assert status == 0
    return r, J, r_omega
