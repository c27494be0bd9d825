"""What optimal curves say of richer settings: the table that ships is that of the benchmark, and its lines are told."""

import json

import pytest

from bdamper.util.experience import TABLE, richer

DEFAULT = {"harmonics": [1, 2, 3], "blade_modes": 10, "contact_stiffness": "residual_modes"}


@pytest.fixture(scope="module")
def table():
    return json.loads(TABLE.read_text())


def test_the_table_that_ships_is_that_of_the_benchmark(table):
    bench_cost = pytest.importorskip("benchmarks.bench_cost", reason="the benchmarks stand beside the source alone")
    assert table == json.loads(json.dumps(bench_cost.shipped(json.loads(bench_cost.RESULTS.read_text()))))
    assert table["scenes"] >= 5 and all(step["time"] > 0.0 and step["change"] >= 0.0 for step in table["steps"])


def test_each_setting_has_its_next_step(table):
    lines = richer(DEFAULT)
    five = next(s for s in table["steps"] if s["setting"] == "harmonics" and s["to"] == 5)
    assert lines[0] == (
        f"5 harmonics: about {five['time']:g} times the time; changed the peak by {five['change']:g} % "
        f"(median of {table['scenes']} scenes of the hard disk)"
    )
    assert [line.split(":")[0] for line in lines] == ["5 harmonics", "12 residual patterns", "20 blade modes"]


@pytest.mark.parametrize(("settings", "said"), [
    (DEFAULT | {"harmonics": list(range(1, 10)), "blade_modes": 40, "contact_stiffness": "unit_traction"}, []),
    (DEFAULT | {"harmonics": [1, 3, 5], "blade_modes": 11}, ["12 residual patterns"]),
    (DEFAULT | {"contact_stiffness": {"residual_modes": {"patterns": 12}}, "harmonics": [1], "blade_modes": 5},
     ["3 harmonics", "24 residual patterns"]),
    ({}, []),
])  # fmt: skip
def test_what_the_table_does_not_know_is_passed_over(settings, said):
    assert [line.split(":")[0] for line in richer(settings)] == said
