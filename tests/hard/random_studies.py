"""Random models, settings and preloads for the suites of hard cases, each from one seed."""

import os

import numpy as np

import bdamper as bd
from bdamper.response.response_curve import frequency_response
from tests import oracle
from tests.cases import for_oracle
from tests.models import ALL_MODELS
from tests.plain import plain_study

FULL = int(os.environ.get("BDAMPER_HARD", "0"))
"""Number of cases at full size, 0 for the default run."""


def number_of_cases(default=150):
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
        angles = {
            "alpha": np.radians(rng.uniform(35.0, 70.0)),
            "beta": np.radians(rng.uniform(35.0, 70.0)),
        }
    if kind == "acyclic":
        model, order = (
            ALL_MODELS[kind](seed, n_points=n_points, n_blade_modes=n_blade_modes, **angles),
            0,
        )
    else:
        n_blades, order = int(rng.integers(6, 40)), int(rng.integers(1, 6))
        model = ALL_MODELS[kind](
            seed,
            n_blades,
            order,
            n_points=n_points,
            n_blade_modes=n_blade_modes,
            harmonics=harmonics,
            **angles,
        )
    excitation = float(10.0 ** rng.uniform(-1.0, 1.5))
    preload = (
        excitation * float(10.0 ** rng.uniform(1.0, 4.0)) if kind in ("wedge", "acyclic") else 0.0
    )
    translation = rng.random() < 0.3
    if wide and preload > 0.0:
        preload = float(10.0 ** rng.uniform(0.0, 4.4))
    study = plain_study(
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


def oracle_residuals(study, preload, curve):
    """Largest residual of every point by the NumPy oracle, relative to the loads as the continuation has it, and rounding.

    The forces of a damper that has walked far are differences of large numbers: their rounding comes beside the residual.

    Returns
    -------
    residual, rounding : (n_points,) float
    """
    system = study.problem.system(preload)
    a = for_oracle(system.structure.arrays)
    found = oracle.residuals(curve.unknowns, 2 * np.pi * curve.frequency, a)
    spring = np.column_stack([a["kt"], a["kn"]]) * np.abs(oracle.motions(curve.unknowns, a)).max(
        axis=3
    )
    modal = max(np.abs(G).max(initial=0.0) for G in a["G"]) * system.row_scale.max()
    rounding = 4.0 * np.finfo(float).eps * modal * spring.max(axis=(1, 2), initial=0.0)
    return np.abs(found * system.row_scale).max(axis=1, initial=0.0), rounding


def tracked_curve(study, preload, interval, **options):
    """Response curve without the verdict on its highest point: complete if its branches cover the interval."""
    return frequency_response(study.problem, preload, interval, **options)
