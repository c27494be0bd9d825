"""The C core: residual and Jacobian against the matrix products they contain, and the accuracy of sampling.

All times are the best of several on one thread, ratios are within this run.  The floor is the modal matrix products alone,
``G_l^T Z_l`` for every harmonic over all contact points, by the BLAS of SciPy on arrays of the same shapes.  The state is
random, scaled so that half of the contact points slip or open within the cycle.
"""

from __future__ import annotations

import os

for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

import time  # noqa: E402
from collections.abc import Callable  # noqa: E402

import numpy as np  # noqa: E402
from numpy.typing import NDArray  # noqa: E402
from scipy.linalg.blas import dgemm  # noqa: E402

from bdamper import _core  # noqa: E402

POINTS, MODES = 96, 16
SEPARABLE, CONSTANT, COUPLED = 0, 2, 3


class Case:
    """A random structure with one state of it.

    Parameters
    ----------
    points, modes, harmonics : int
    """

    def __init__(self, points: int, modes: int, harmonics: int) -> None:
        rng = np.random.default_rng(1)
        self.points, self.modes, self.harmonics = points, modes, harmonics
        self.n = modes * (2 * harmonics + 1)
        shape = (points, 3, modes)
        self.G = [
            (rng.normal(size=shape) + 1j * (rng.normal(size=shape) if l else 0)) / np.sqrt(modes)
            for l in range(harmonics + 1)
        ]
        self.arrays = {
            "n_mode": np.full(harmonics + 1, modes, np.intc),
            "stiffness": np.tile(rng.uniform(1, 10, modes), harmonics + 1),
            "mass": np.ones(modes * (harmonics + 1)),
            "damping": np.full(modes * (harmonics + 1), 0.01),
            "G": np.concatenate([g.ravel() for g in self.G]),
            "kt": np.ones((points, 2)),
            "kn": np.ones(points),
            "mu": np.full(points, 0.5),
            "n0": np.full(points, 2.0),
            "w": np.zeros((points, 2)),
            "law": np.zeros(points, np.intc),
            "shift": np.zeros((points, 3)),
            "force": rng.normal(size=self.n),
        }
        u = rng.normal(size=self.n)
        u[:modes] *= 0.1
        for l in range(1, harmonics + 1):
            u[modes * (2 * l - 1) : modes * (2 * l + 1)] /= l**2
        self.u = u * self._half_slip(u)

    def system(
        self, contact_forces: int = 0, n_time: int = 0, law: int = SEPARABLE
    ) -> _core.SectorEquations:
        arrays = {**self.arrays, "law": np.full(self.points, law, np.intc)}
        return _core.SectorEquations(**arrays, evaluation=contact_forces, n_time=n_time)

    def _half_slip(self, u: NDArray) -> float:
        """Factor on u at which half of the points slip or open."""
        system, share = self.system(), np.empty((self.points, 5))
        X, F = (np.empty((self.points, 3, 2 * self.harmonics + 1)) for _ in range(2))
        low, high = 1e-4, 1e4
        for _ in range(40):
            middle = np.sqrt(low * high)
            system.contact(np.append(middle * u, 0.7), X, F, share)
            if ((share[:, 1] > 0) | (share[:, 3] > 0) | (share[:, 4] > 0)).mean() > 0.5:
                high = middle
            else:
                low = middle
        return 1.001 * high

    def seconds(self, system: _core.SectorEquations, jacobian: bool = True) -> float:
        y, r, J = np.append(self.u, 0.7), np.empty(self.n), np.empty((self.n, self.n))
        return best(lambda: system.evaluate(y, r, J) if jacobian else system.evaluate(y, r))

    def floor(self) -> float:
        """Seconds of the modal matrix products alone."""
        rng = np.random.default_rng(2)

        def pair(rows: int, columns: int) -> tuple[NDArray, NDArray]:
            a, z = rng.normal(size=(rows, columns)), rng.normal(size=(rows, self.n))
            return np.asfortranarray(a), np.asfortranarray(z)

        mean, harmonic = pair(3 * self.points, self.modes), pair(6 * self.points, 2 * self.modes)

        def products() -> None:
            dgemm(1.0, *mean, trans_a=True)
            for _ in range(self.harmonics):
                dgemm(1.0, *harmonic, trans_a=True)

        return best(products)

    def oracle(self) -> float:
        """Seconds of the residual alone in plain NumPy (once: it takes long)."""
        from tests import oracle

        start = time.perf_counter()
        oracle.residual(self.u, 0.7, {**self.arrays, "G": self.G})
        return time.perf_counter() - start


def best(function: Callable[[], object], budget: float = 0.3, at_least: int = 5) -> float:
    """Shortest of the runs that fit into a time budget."""
    times: list[float] = []
    end = time.perf_counter() + budget
    while time.perf_counter() < end or len(times) < at_least:
        start = time.perf_counter()
        function()
        times.append(time.perf_counter() - start)
    return min(times)


def speed() -> None:
    print(f"## Residual and Jacobian, {POINTS} contact points, {MODES} modes\n")
    print("Half of the points slip or open; one thread.\n")
    print(
        "| harmonics | floor ms | exact ms | exact/floor | sampled(128) ms | sampled/floor "
        "| coupled, sampled(128) ms | coupled/floor | residual alone, exact ms | NumPy oracle of it ms | oracle/exact |"
    )
    print("|---|---|---|---|---|---|---|---|---|---|---|")
    for harmonics in (1, 3, 7):
        case = Case(POINTS, MODES, harmonics)
        floor, exact, sampled = (
            case.floor(),
            case.seconds(case.system()),
            case.seconds(case.system(1, 128)),
        )
        coupled = case.seconds(case.system(1, 128, COUPLED))
        residual, oracle = case.seconds(case.system(), jacobian=False), case.oracle()
        print(
            f"| {harmonics} | {1e3 * floor:.3f} | {1e3 * exact:.3f} | {exact / floor:.2f} | {1e3 * sampled:.3f} | "
            f"{sampled / floor:.2f} | {1e3 * coupled:.2f} | {coupled / floor:.1f} | {1e3 * residual:.3f} | "
            f"{1e3 * oracle:.0f} | {oracle / residual:.0f} |"
        )
    print()


def accuracy_table() -> str:
    """Markdown table: relative error of sampled force and Jacobian against the exact evaluation, by law."""
    rng = np.random.default_rng(3)
    counts = (32, 64, 128, 256, 512, 1024, 4096)
    cases = (
        ("constant normal load", CONSTANT, 1),
        ("variable, no separation", SEPARABLE, 1),
        ("separation", SEPARABLE, 1),
    )
    lines = [
        "| samples | "
        + " | ".join(f"{name}: force | Jacobian" for name, _, _ in cases)
        + " | coupled: force |"
    ]
    lines.append("|---" * (2 + 2 * len(cases)) + "|")
    errors = np.zeros((len(counts), 2 * len(cases) + 1))
    for column, (name, law, _) in enumerate(cases):
        for state in _states(rng, name == "separation"):
            exact = _evaluate(*state, law, 0, 0)
            for row, n_time in enumerate(counts):
                sampled = _evaluate(*state, law, 1, n_time)
                for k in range(2):
                    errors[row, 2 * column + k] += (
                        np.abs(sampled[k] - exact[k]).max() / np.abs(exact[k]).max() / 100
                    )
    for state in _states(rng, separation=True):
        reference = _evaluate(*state, COUPLED, 1, 8192)[0]
        for row, n_time in enumerate(counts):
            error = np.abs(_evaluate(*state, COUPLED, 1, n_time)[0] - reference).max()
            errors[row, -1] += error / np.abs(reference).max() / 100
    for n_time, row in zip(counts, errors):
        lines.append(f"| {n_time} | " + " | ".join(f"{e:.1e}" for e in row) + " |")
    order = np.log(errors[2] / errors[5]) / np.log(8)
    lines.append("| order, 128 to 1024 | " + " | ".join(f"{o:.1f}" for o in order) + " |")
    return "\n".join(lines)


def _states(rng: np.random.Generator, separation: bool) -> list[tuple]:
    out = []
    for _ in range(100):
        x = rng.normal(size=(3, 7)) / np.array([1, 1, 1, 2, 2, 3, 3])
        x[:, 0] *= 0.3
        swing = float(np.hypot(x[2, 1::2], x[2, 2::2]).sum())
        out.append(
            (
                x,
                -x[2, 0]
                + swing * (rng.uniform(-0.3, 0.5) if separation else rng.uniform(1.05, 1.5)),
            )
        )
    return out


def _evaluate(
    x: NDArray, n0: float, law: int, contact_forces: int, n_time: int
) -> tuple[NDArray, NDArray]:
    F, J = np.empty_like(x), np.empty(x.shape + x.shape)
    _core.evaluate_contact(
        x, np.ones(2), 1.0, 0.4, n0, np.zeros(2), F, J, law, contact_forces, n_time, abs(n0)
    )
    return F, J


def main() -> None:
    """Print both tables."""
    speed()
    print(
        "## AFT against exact evaluation, mean relative error over 100 states with three harmonics\n"
    )
    print(accuracy_table() + "\n")


if __name__ == "__main__":
    main()
