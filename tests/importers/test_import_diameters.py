"""Which nodal diameters an import makes, what the report says of it, and what is seen of the work."""

import re
from contextlib import nullcontext
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("skfem", reason="scikit-fem is not installed (extra bdamper[fe])")

import bdamper as bd
from bdamper.fem import factorisation, lowest_modes, sector_inside
from bdamper.fem.surface import Facets
from bdamper.importers import Modes, Reduction, Sector
from bdamper.importers.build import _diameters, _sector_faces
from bdamper.util import storage
from bdamper.util.errors import ModelError, SettingError
from bdamper.util.progress import Steps
from tests.annulus import small_sector
from tests.fe_bodies import SIX_BLADES, contacts
from tests.imports import build
from tests.printed import said

N = 6
SETTINGS = SIX_BLADES | {"n_modes": 4, "contacts": contacts(4)}


@pytest.fixture(scope="module")
def fe():
    return small_sector(N)


@pytest.mark.parametrize(
    ("n_blades", "order", "harmonics", "expected"),
    [
        (36, 4, None, {0, 4, 8, 12, 16}),  # 9 sectors, all of theirs
        (65, 5, None, {0, 5, 10, 15, 20, 25, 30}),
        (31, 3, None, set(range(16))),  # 31 sectors: time integration needs all
        (36, 5, None, {0, 5, 10, 15, 16, 11, 6, 1, 4, 9}),  # 36 sectors: nine harmonics alone
        (36, 5, 3, {0, 5, 10, 15}),
        (36, [4, 5], 2, {0, 4, 8, 5, 10}),
        (36, (6, 9, 12), None, {0, 6, 12, 18, 9}),
    ],
)
def test_those_of_nine_harmonics_and_of_time_integration(
    bodies, n_blades, order, harmonics, expected
):
    found, excited, reason = _diameters(n_blades, Reduction(order, harmonics), bodies[0])
    assert set(found) == expected
    orders = (order,) if isinstance(order, int) else order
    assert set(excited) == {min(o % n_blades, -o % n_blades) for o in orders}
    assert ", ".join(map(str, orders)) in reason and ("time integration" in reason) == (
        harmonics is None
    )


def test_a_file_of_modes_limits_them(bodies):
    shape = Modes(4, np.ones(1), np.arange(2), np.ones((2, 3, 1)))
    alone = replace(
        bodies[0], stiffness=None, mass=None, modes=(shape, replace(shape, nodal_diameter=0))
    )
    assert _diameters(36, Reduction(4), alone)[0] == (0, 4)
    assert _diameters(36, Reduction(), alone)[0] == (0, 4)


@pytest.mark.slow
def test_the_report_names_them_and_nine_harmonics_run(bodies):
    """A study with nine harmonics finds all that it needs."""
    tip = int(bodies[0].numbers[bodies[0].nodes[:, 1].argmax()])
    built = build(*bodies, **SETTINGS, engine_order=[1, 2], locations={"tip": tip})
    blade = built.model.bodies["blade"]
    assert sorted(blade.bases) == [0, 1, 2, 3]
    assert list(built.model.meshes["blade"].modes) == [1, 2]
    text = "4 nodal diameters, for 9 harmonics of engine order 1, 2 and time integration"
    assert text in said(built.summary())
    study = bd.Study(
        built.model, bd.Excitation("tip"), engine_order=2, friction_coefficient=0.3, harmonics=9
    )
    assert len(study.problem.bases) == 10


@pytest.mark.slow
def test_a_wave_that_travels_backward_has_the_diameter_of_the_one_forward(bodies):
    """Of 6 blades the engine orders 5 and 8 repeat from blade to blade as 1 and 2 do, one backward, one forward."""
    forward, folded = (
        build(*bodies, **SETTINGS, engine_order=orders, harmonics=1) for orders in ([1, 2], [5, 8])
    )
    assert list(folded.model.meshes["blade"].modes) == [1, 2]
    assert folded.model.hash == forward.model.hash


def rounded(body, share, direction):
    """The body with one inner node of its second face moved by a share of its largest extent."""
    node = body.node_sets["HIGH"][len(body.node_sets["HIGH"]) // 2] - body.numbers[0]
    nodes = body.nodes.copy()
    nodes[node] += share * np.ptp(nodes, axis=0).max() * np.array(direction)
    return replace(body, nodes=nodes)


@pytest.mark.slow
@pytest.mark.parametrize("direction", [(1.0, 0.0, 0.0), (0.0, 0.6, -0.8)])
def test_sector_faces_match_as_exactly_as_files_round_positions(bodies, direction):
    """Six digits of a position are rounded by 5e-6 of the sector; what is 3e-5 off is another mesh, 3e-4 another face."""
    settings = {**SETTINGS, "nodal_diameters": (1,), "face_tolerance": 2e-3}
    for share, words in ((5e-6, "pairs of nodes match"), (3e-5, "meshes that differ")):
        built = build(rounded(bodies[0], share, direction), bodies[1], **settings)
        assert sum(words in line for line in built.checks) == 1
    with pytest.raises(
        ModelError, match=r"sector faces: expected two sets of nodes .* largest distance .* apart"
    ):
        build(rounded(bodies[0], 3e-4, (1.0, 0.0, 0.0)), bodies[1], **settings)


def opened(body, share):
    """The body with its angles about the axis of rotation larger by a share."""
    angle, radius = (
        (1.0 + share) * np.arctan2(body.nodes[:, 0], body.nodes[:, 1]),
        np.hypot(*body.nodes[:, :2].T),
    )
    return replace(
        body,
        nodes=np.column_stack([radius * np.sin(angle), radius * np.cos(angle), body.nodes[:, 2]]),
    )


@pytest.mark.slow
def test_a_sector_of_almost_one_pitch_passes_with_a_word_of_the_deviation(bodies):
    """30.015 degrees are 5e-4 more than 360/12; CalculiX takes up to 1 %."""
    blade = opened(bodies[0], 5e-4)
    exact, near = (
        build(body, bodies[1], **SETTINGS, nodal_diameters=(1,)) for body in (bodies[0], blade)
    )
    assert not any("from 60;" in line for line in exact.checks)
    assert any("60.03 degrees apart, +0.05 % from 60; tied as if" in line for line in near.checks)
    for d, frequencies in exact.frequencies.items():
        np.testing.assert_allclose(near.frequencies[d], frequencies, rtol=1e-3)
    without = {**SETTINGS, "n_blades": None}
    assert build(blade, bodies[1], **without, nodal_diameters=(1,)).model.n_blades == N
    with pytest.raises(ModelError, match=r"60.03 degrees apart; the closest number is 6 sectors"):
        build(blade, bodies[1], **SETTINGS, nodal_diameters=(1,), angle_tolerance=1e-4)
    for settings in (SETTINGS, without):
        with pytest.raises(
            ModelError, match=r"the faces are 61.2 degrees apart; the closest number is 6 sectors"
        ):
            build(opened(bodies[0], 0.02), bodies[1], **settings, nodal_diameters=(1,))


@pytest.mark.parametrize(
    ("order", "words"),
    [
        ([1, 1], "engine_order: expected whole numbers, each at most once"),
        ("1", "engine_order: expected a whole number >= 0, found '1'"),
        ([1, 2.5], "engine_order: expected a whole number >= 0, found 2.5"),
    ],
)
def test_engine_orders_that_are_none(bodies, order, words):
    with pytest.raises(SettingError) as error:
        build(*bodies, **SETTINGS, engine_order=order)
    assert words in str(error.value)


@pytest.mark.slow
def test_steps_are_named_and_counted(bodies, capsys, monkeypatch):
    monkeypatch.setattr("bdamper.util.progress.FIRST_LINE", 0.0)
    settings = {**SETTINGS, "nodal_diameters": (0, 2)}
    build(*bodies, **settings, blade_nodes="BLADE", progress=True)
    shown = capsys.readouterr().err
    for step in ("nodal diameter 2", "disk of the wheel, nodal diameter 3", "damper"):
        assert f"import: {step}" in shown
    told = [int(share) for share in re.findall(r"^import(?:: .*)?: (\d+) %$", shown, re.M)]
    assert (
        told == sorted(told) and told[-1] == 100
    )  # waves 0, 1, 2, 3, the disk at each, the damper
    build(*bodies, **settings, progress=False)
    assert "import" not in capsys.readouterr().err


class Watched(Steps):
    """Steps of an import that note each pass, and how many columns are solved outside of passes."""

    made = None

    def __init__(self, *given):
        super().__init__(*given)
        self.passes, self.most_columns = [], 0
        Watched.made = self

    def report_pass(self, name, done, total):
        super().report_pass(name, done, total)
        if not self.in_pass:
            self.passes.append((name, total, []))
        assert self.passes[-1][:2] == (name, total), "one pass at a time"
        self.passes[-1][2].append(done)

    @property
    def in_pass(self):
        return bool(self.passes) and self.passes[-1][2][-1] < self.passes[-1][1]

    def solve(self, force):
        if not self.in_pass:
            self.most_columns = max(self.most_columns, force[0].size)


@pytest.mark.slow
@pytest.mark.parametrize("stored", [500e6, 0.0])
def test_each_long_pass_is_reported_until_its_end(bodies, monkeypatch, stored):
    """No solution for many right-hand sides is outside of a pass, and each pass ends at its total."""
    monkeypatch.setattr("bdamper.importers.build.Steps", Watched)
    monkeypatch.setattr(sector_inside, "STORED", stored)
    monkeypatch.setattr(sector_inside, "COLUMNS", 16)
    calls = {"factorisation": 0, "modes": 0}

    class Factors(factorisation.SuperLUFactors):
        def __init__(self, matrix):
            calls["factorisation"] += 1
            assert Watched.made.in_pass
            super().__init__(matrix)

        def solve(self, force):
            Watched.made.solve(force)
            return super().solve(force)

    most_flexible = lowest_modes._most_flexible

    def counted(*given):
        calls["modes"] += 1
        return most_flexible(*given)

    monkeypatch.setattr(factorisation, "SuperLUFactors", Factors)
    monkeypatch.setattr(lowest_modes, "_most_flexible", counted)
    settings = {**SETTINGS, "nodal_diameters": (0, 2)}
    build(*bodies, **settings, blade_nodes="BLADE", progress=False)

    seen = Watched.made
    assert seen.begun == seen.total
    assert seen.most_columns <= 16
    for name, total, done in seen.passes:
        assert done[-1] == total, name
        if name != "modes":
            assert done == list(range(total + 1)), name
    names = [name for name, *_ in seen.passes]
    # sector, damper, clamped blade, disk
    assert names.count("factorisation") == calls["factorisation"] == 4
    assert names.count("modes") == calls["modes"] > 0
    assert (
        names.count("static shapes of the faces") == names.count("mass of the static shapes") == 2
    )
    assert "static shapes" in names


def test_an_interruption_leaves_nothing_half_written(bodies, tmp_path, monkeypatch):
    """Neither of the build nor of the file, and an existing file as it was."""
    built = build(*bodies, **SETTINGS, nodal_diameters=(1,))
    built.save(tmp_path / "model.h5")
    before = (tmp_path / "model.h5").read_bytes()

    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(storage.os, "replace", interrupted)
    with pytest.raises(KeyboardInterrupt):
        built.save(tmp_path / "model.h5")
    assert [path.name for path in tmp_path.iterdir()] == ["model.h5"]
    assert (tmp_path / "model.h5").read_bytes() == before


@pytest.mark.slow
@pytest.mark.parametrize("given", [None, 120, 119])
def test_number_of_sectors_does_not_depend_on_the_grading_of_skewed_faces(given):
    """Faces 3 degrees apart with different meshes have centres 2.971 degrees apart, nearer to 121 sectors than to 120."""

    def face(angle, z):
        rows, radius = [], np.linspace(0.3, 0.4, 9)
        for height in z:
            turned = angle + height * np.tan(np.radians(15.0)) / 0.35
            rows.append(
                np.column_stack(
                    [radius * np.sin(turned), radius * np.cos(turned), np.full(9, height)]
                )
            )
        corner = (9 * np.arange(len(z) - 1)[:, None] + np.arange(8)).ravel()[:, None]
        return np.concatenate(rows), corner + [0, 1, 10, 9]

    first, quads = face(-np.pi / 120, np.linspace(0.0, 0.1, 9))
    second, more = face(np.pi / 120, 0.1 * np.linspace(0.0, 1.0, 10) ** 1.03)
    sets = {"A": np.arange(len(first)), "B": len(first) + np.arange(len(second))}

    def require(good, *words):
        if not good:
            raise ModelError(" ".join(words))

    body = SimpleNamespace(
        nodes=np.concatenate([first, second]), boundary=Facets((np.concatenate([quads, len(first) + more]),)),
        elements=(1,), size=0.15, node_set=lambda name, _: sets[name], passed=lambda _: None,
        refusing=lambda *_: nullcontext(), require=require,
    )  # fmt: skip
    if given == 119:
        with pytest.raises(ModelError, match="faces that fit 120 sectors"):
            _sector_faces(body, Sector(119, ("A", "B")))
    else:
        assert _sector_faces(body, Sector(given, ("A", "B"))).n_sectors == 120
