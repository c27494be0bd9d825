"""Random models, settings and preloads for the suites of hard cases, each from one seed."""

import os

import numpy as np

import bdamper as bd
from tests import oracle
from tests.models import ALL_MODELS

FULL = int(os.environ.get("BDAMPER_HARD", "0"))
"""Number of cases at full size, 0 for the default run."""


def number_of_cases(default=300):
    return FULL or default


def random_study(seed, wide=False):
    """A study of a random synthetic model, a preload (N) and a frequency interval (Hz).

    Preloads are 10 to 10,000 times the excitation, from a damper that hardly touches to one that is stuck; with ``wide``
    they are drawn from 1 N to 25 kN whatever the excitation, so that some dampers are thrown about.
    """
    rng = np.random.default_rng(seed)
    kind = ["wedge", "acyclic", "shroud", "ground"][int(rng.choice(4, p=[0.5, 0.2, 0.15, 0.15]))]
    harmonics = int(rng.choice([1, 2, 3], p=[0.6, 0.2, 0.2]))
    n_points = int(rng.choice([4, 6]))
    n_blade_modes = int(rng.integers(2, 5))
    angles = {}
    if kind in ("wedge", "acyclic"):
        angles = {"alpha": np.radians(rng.uniform(35.0, 70.0)), "beta": np.radians(rng.uniform(35.0, 70.0))}
    if kind == "acyclic":
        model, order = ALL_MODELS[kind](seed, n_points=n_points, n_blade_modes=n_blade_modes, **angles), 0
    else:
        n_blades, order = int(rng.integers(6, 40)), int(rng.integers(1, 6))
        model = ALL_MODELS[kind](
            seed, n_blades, order, n_points=n_points, n_blade_modes=n_blade_modes, harmonics=harmonics, **angles
        )
    excitation = float(10.0 ** rng.uniform(-1.0, 1.5))
    preload = excitation * float(10.0 ** rng.uniform(1.0, 4.0)) if kind in ("wedge", "acyclic") else 0.0
    translation = rng.random() < 0.3
    if wide and preload > 0.0:
        preload = float(10.0 ** rng.uniform(0.0, 4.4))
    study = bd.Study(
        model,
        engine_order=order,
        harmonics=harmonics,
        contact_stiffness="model",
        friction_coefficient=float(rng.uniform(0.05, 0.7)),
        damping_ratio=float(10.0 ** rng.uniform(-3.5, -2.0)),
        rigid_modes=("TX", "TY", "TZ") if translation else bd.RIGID_NAMES,
        excitation=bd.Excitation("tip", "tangential", excitation),
    )
    return study, preload, (200.0, 450.0)


def oracle_residual(study, preload, unknowns, omega):
    """Largest residual by the NumPy oracle, relative to the loads as the continuation measures it."""
    system = study.system(preload)
    a = dict(system.arrays)
    G, start = [], 0
    flat = np.asarray(a["G"])
    for n in a["n_mode"]:
        size = 3 * system.n_points * int(n)
        G.append(flat[start : start + size].reshape(system.n_points, 3, int(n)))
        start += size
    a["G"] = G
    return float(np.abs(oracle.residual(unknowns, omega, a) * system.row_scale).max())
