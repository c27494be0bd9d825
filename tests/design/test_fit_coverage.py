"""Coverage of the 95 % intervals of fits to synthetic tests with drawn truth, loads, noise and numbers of points."""

import numpy as np
import pytest

import bdamper as bd
from bdamper.problem.variation import vary
from tests.design.test_fit import blank, measured

RANGES = {"friction_coefficient": (0.1, 1.0), "contact_stiffness_factor": (0.3, 4.0)}
UNLOADED = ("damping_factor", "frequency_factor", "force_factor")


def oscillator():
    """Build one mass with an elastic friction element whose normal load is that of a second mass."""
    contact = bd.Contact(tangential=0, normal=1, kt=1.0, kn=20.0, mu=0.5)
    return bd.lumped([1.0, 1.0], [0.02, 0.02], [2.0, 1.0], contacts=[contact], forces={0: 1.0}, loads={1: 1.0}, harmonics=1)


def drawn_fit(seed):
    """Fit drawn synthetic tests, every fourth time after a drawn test without load; return the result and the truth."""
    rng = np.random.default_rng(seed)
    study, free = oscillator(), seed % 4 == 0
    true = {"friction_coefficient": rng.uniform(0.25, 0.7), "contact_stiffness_factor": np.exp(rng.uniform(-0.5, 0.7))}
    rig = {"damping_factor": rng.uniform(0.7, 1.5), "frequency_factor": rng.uniform(0.98, 1.02)} if free else {}
    gain = rng.uniform(0.9, 1.1) if free else 1.0
    truth = vary(study, true | rig | {"excitation.amplitude": gain})
    noise = np.exp(rng.uniform(*np.log([0.005, 0.05])))

    def run(load, n, phase):
        top = truth.peak(load).frequency if load else 0.225 * rig["frequency_factor"]
        band = (top * (1.0 - rng.uniform(0.05, 0.15)), top * (1.0 + rng.uniform(0.05, 0.15)))
        return measured(truth, blank(load, band, n, phase=phase), noise, int(rng.integers(2**31)))

    loads = np.exp(rng.uniform(*np.log([0.4, 6.0]), int(rng.integers(1, 4))))
    tests = [run(load, int(rng.integers(8, 16)), bool(rng.integers(2))) for load in loads]
    unloaded = run(0.0, 12, bool(rng.integers(2))) if free else None
    found = bd.fit(study, tests, RANGES, free=unloaded, noise=noise)
    return found, true | rig | ({"force_factor": gain} if free else {})


def covered(found, truth):
    """Tell of each parameter whether its interval contains the truth."""
    exact = np.array([truth[name] for name in found.names])
    return (found.low <= exact) & (exact <= found.high)
