"""Dampers that roll because their faces have few rows of contact points: statics, amplitudes, headline and files."""

from dataclasses import replace

import h5py
import numpy as np
import pytest
import scipy.optimize

import bdamper as bd
from bdamper.harmonic_balance.rolling import (
    MOST_ROWS,
    FaceInSection,
    rolling_dampers,
    rows_to_slide,
)
from bdamper.response import optimal_curve
from bdamper.response.optimum_checks import checks
from tests.printed import said

FRICTION_BETWEEN_LIMITS = 0.37
"""On the difficult disk a damper rolls on three rows above 0.35, and on four rows above 0.39."""


def disk(points, **settings):
    tip = bd.Excitation("tip", direction="tangential", amplitude=1.0)
    return bd.Study(
        bd.reference_model("bladed_disk", points), tip, engine_order=5, harmonics=1, **settings
    )


def has_equilibrium(faces, rows, load, loaded_at, sense):
    """Whether points with friction at its limit can balance a load, by a linear program."""
    columns = []
    for face, towards_ridge in zip(faces, (1.0, -1.0)):
        tangent = towards_ridge * np.array([face.normal[1], -face.normal[0]])
        for place in (np.arange(rows) + 0.5) / rows * 2.0 - 1.0:
            point = face.centre + place * face.half_length * tangent
            # a turn of the damper moves its left and its right face in opposite senses of t1
            force = face.normal + sense * face.friction * np.array(
                [face.normal[1], -face.normal[0]]
            )
            moment = point[0] * force[1] - point[1] * force[0]
            columns.append([*force, moment])
    moment_of_load = loaded_at[0] * load[1] - loaded_at[1] * load[0]
    balance = -np.array([*load, moment_of_load])
    columns = np.array(columns).T
    cost = np.zeros(columns.shape[1])
    found = scipy.optimize.linprog(cost, A_eq=columns, b_eq=balance, bounds=(0.0, None))
    return found.status == 0


def wedge(rng):
    """Two faces under a ridge, symmetric or not, lengths about 1."""
    faces = []
    asymmetric = rng.random() < 0.5
    angle, length = rng.uniform(0.4, 1.25), rng.uniform(0.6, 1.6)
    for side in (-1.0, 1.0):
        if asymmetric and side > 0.0:
            angle += rng.uniform(-0.2, 0.2)
        down = np.array([side * np.sin(angle), -np.cos(angle)])
        inward = np.array([-side * np.cos(angle), -np.sin(angle)])
        centre = np.array([side * 0.05, 0.0]) + 0.5 * length * down
        faces.append(FaceInSection(centre, inward, 0.0, 0.5 * length, 0, 0.0))
    friction = rng.uniform(0.15, 0.6)
    return [replace(face, friction=friction) for face in faces]


def with_rows(faces, rows):
    return [replace(face, reach=(rows - 1) / rows * face.half_length, rows=rows) for face in faces]


@pytest.mark.slow
def test_rows_agree_with_the_equilibrium_of_the_points():
    """Random wedges on one to eight rows of points: 200 of 200 agree with linear programs."""
    rng = np.random.default_rng(81)
    rolling = 0
    for _ in range(200):
        faces = wedge(rng)
        rows = int(rng.integers(1, 9))
        load = np.array([0.0, 1.0])
        loaded_at = np.array([rng.uniform(-0.05, 0.05), -0.3])

        def slides(n, faces=faces, load=load, loaded_at=loaded_at):
            return [has_equilibrium(faces, n, load, loaded_at, sense) for sense in (1.0, -1.0)]

        enough = rows_to_slide(with_rows(faces, rows), load, loaded_at)
        on_faces = slides(MOST_ROWS)
        assert (enough > 0) == (slides(rows) != on_faces)
        if enough:
            rolling += 1
            assert enough > rows
            assert slides(enough) == on_faces
            assert slides(enough - 1) != on_faces
    assert 20 < rolling < 180


@pytest.mark.slow
@pytest.mark.parametrize(
    ("points", "friction", "doubted"),
    [
        (9, 0.33, False),
        (9, FRICTION_BETWEEN_LIMITS, True),
        (48, FRICTION_BETWEEN_LIMITS, False),
        (48, 0.41, True),
    ],
)
def test_a_doubted_damper_does_not_reduce_the_amplitude(points, friction, doubted):
    """At 60 N it has 29 to 33 µm where it slides, and more than 200 µm where it rolls."""
    study = disk(points, friction_coefficient=friction)
    assert bool(rolling_dampers(study.problem)) == doubted
    amplitude = study.peak(60.0).amplitude
    assert (amplitude > 200e-6) == doubted
    assert (amplitude < 40e-6) != doubted


def test_united_points_count():
    """Two by twelve groups of the 48 points had 841 µm where 16 µm are right."""
    study = disk(48, friction_coefficient=0.3)
    assert rolling_dampers(study.problem) == ()
    (doubt,) = rolling_dampers(study.replace(contact_points=4).problem)
    assert doubt == "'damper' rolls on 2 rows of contact points; on 3 it would slide"


@pytest.mark.parametrize(
    "settings",
    [
        {"friction_law": "bonded"},
        {"rigid_modes": ("TX", "TY", "TZ", "RX", "RY")},
        {"friction_coefficient": {"left": FRICTION_BETWEEN_LIMITS, "right": 0.2}},
    ],
)
def test_a_damper_that_cannot_turn_or_slip_does_not_roll(settings):
    study = disk(9, friction_coefficient=FRICTION_BETWEEN_LIMITS).replace(**settings)
    assert rolling_dampers(study.problem) == ()


@pytest.mark.parametrize("friction", [0.1, 0.3, 0.5])
def test_strips_under_level_faces_are_not_doubted(friction):
    """The faces carry moments as a pair: four rows change their optimum by 25 %, not by several times."""
    study = bd.Study(
        bd.reference_model("shrouded_blade"), bd.Excitation("tip"), 4, friction_coefficient=friction
    )
    assert rolling_dampers(study.problem) == ()


def test_a_doubt_about_the_model_comes_before_the_first_curve_and_once(monkeypatch, recwarn):
    class FirstCurve(Exception):
        """The search has begun."""

    def begins(*_, **__):
        raise FirstCurve

    monkeypatch.setattr(optimal_curve, "optimal_curve", begins)
    study = disk(9, friction_coefficient=FRICTION_BETWEEN_LIMITS)
    for preloads in ([100.0, 200.0, 400.0], [50.0, 100.0, 150.0]):
        with pytest.raises(FirstCurve):
            study.optimal_curve(preloads, check=False)
    doubt = "'damper' rolls on 3 rows of contact points; on 4 it would slide"
    told = [str(warning.message) for warning in recwarn]
    assert [text for text in told if doubt in text] == [
        f"{doubt}; amplitudes may be wrong by several times; use more rows of contact points along t1"
    ]
    recwarn.clear()
    with pytest.raises(FirstCurve):
        disk(48, friction_coefficient=0.3).optimal_curve([100.0, 200.0, 400.0], check=False)
    assert not [warning for warning in recwarn if "damper" in str(warning.message)]


@pytest.mark.slow
def test_headline_checks_and_files(tmp_path):
    curve = disk(9, friction_coefficient=FRICTION_BETWEEN_LIMITS).optimal_curve(
        [100.0, 200.0, 400.0], check=False
    )
    doubt = "'damper' rolls on 3 rows of contact points; on 4 it would slide"
    assert curve.model_doubts == (doubt,)
    assert f"{doubt}; amplitudes may be wrong by several times" in curve.failures
    assert curve._headline().startswith(f"Not for design: {doubt};")
    assert "Remedy: use more rows of contact points along t1" in said(curve)
    assert np.isnan(curve.design_amplitude)

    path = tmp_path / "curve.h5"
    curve.save(path)
    assert bd.load(path).model_doubts == (doubt,)
    with h5py.File(path, "a") as file:
        names = [name for name in (*file, *file.attrs) if name == "model_doubts"]
        assert names
        if "model_doubts" in file:
            del file["model_doubts"]
        else:
            del file.attrs["model_doubts"]
    old = bd.load(path)
    assert old.model_doubts is None
    (check,) = [check for check in checks(old) if check.name == "Damper rolling"]
    assert (check.colour, check.found) == ("white", "study.optimal_curve(...)")

    replace(curve, model_doubts=()).save(path)
    assert bd.load(path).model_doubts == ()
