"""Counts, units and exponents of the benchmarks; no test depends on a time."""

import json

import matplotlib.pyplot as plt
import numpy as np
import pytest

import bdamper as bd
from bdamper.fem.generated_models import SectorFE
from bdamper.fem.meshes import Geometry, sector_mesh
from benchmarks import bench_blades, bench_growth, bench_import, bench_works, measuring

MORE = 1.1
"""Ratio by which the evaluations of a work may exceed the stored number."""


@pytest.fixture(scope="module")
def stored():
    """Return the stored run: its head and the record of each work."""
    head, *records = measuring.read_lines(bench_works.STORED)
    return head, {record["work"]: record for record in records}


def count_from_mesh(density):
    """Return the equations of a sector from the nodes of its mesh, without any matrix."""
    geometry = Geometry()
    mesh = sector_mesh(geometry, density)
    midpoints = mesh.p[:, mesh.edges].mean(axis=1)
    x, y, _ = np.hstack([mesh.p, midpoints])
    radius = np.hypot(x, y)
    clamped = radius < geometry.bore_radius + 1e-8
    at_second_face = np.abs(np.arctan2(x, y) - 0.5 * geometry.pitch) < 1e-9
    dependent = at_second_face & (radius < geometry.rim_radius + 1e-8)
    return int(3 * (~clamped & ~dependent).sum())


def test_the_large_mesh_has_some_100000_equations():
    assert 90_000 <= count_from_mesh(bench_import.DENSITIES["large"]) <= 120_000


def test_equations_of_an_import_are_counted_once():
    density = bench_import.DENSITIES["smallest"]
    assert bench_import.count_equations(SectorFE(density=density)) == count_from_mesh(density)


def test_every_work_is_stored_with_its_counts(stored):
    head, records = stored
    assert list(records) == list(bench_works.WORKS)
    assert set(head) == {"processor", "version", "date"}
    for record in records.values():
        assert record["counts"]
        assert all(count > 0 for count in record["counts"].values())
    for mesh in bench_import.QUICK:
        counts = records[f"import, {mesh} mesh"]["counts"]
        assert counts == {"equations": count_from_mesh(bench_import.DENSITIES[mesh])}


def test_a_peak_takes_no_more_evaluations_than_stored(stored):
    """Fewer are welcome: run ``make bench`` afterwards."""
    _, records = stored
    counts = bench_works.WORKS["peak, disk"]()()
    known = records["peak, disk"]["counts"]
    assert counts.keys() == known.keys()
    assert counts["evaluations"] <= MORE * known["evaluations"]


def test_the_shortest_run_is_the_unit(monkeypatch):
    seconds = iter([0.4, 0.3, 0.3, 0.2, 0.2, 0.5])
    monkeypatch.setattr(measuring, "processor_time", lambda work: next(seconds))
    clock = measuring.UnitClock()
    clock.run(1)
    clock.run(2)
    assert clock.shortest == measuring.Unit(0.3, 0.2)
    assert clock.shortest.seconds == pytest.approx(0.5)


def record(work, processor, contact, evaluations):
    return {
        "work": work, "counts": {"evaluations": evaluations}, "processor": processor,
        "wall": 2.0 * processor, "memory": 100.0, "factorisations": 0.5, "contact": contact,
    }  # fmt: skip


HEAD = {"processor": "some processor", "version": "2", "date": "2026-01-01"}


def test_runs_are_compared_in_units():
    """Twice the time of a machine that is half as fast is no change."""
    slow = record("peak", 4.0, 1.0, 300) | {"factorisations": 1.0}
    fast = record("peak", 1.0, 0.5, 400)
    lines = bench_works.comparison(HEAD, [slow], HEAD | {"version": "1"}, [fast]).splitlines()
    assert lines[0] == "version 2 over version 1"
    assert lines[-1].split() == ["peak", "2.00", "2.00", "1.00", "evaluations", "0.75"]


def test_a_changed_unit_is_reported():
    before, after = [record("peak", 1.0, 0.5, 300)], [record("peak", 1.0, 0.25, 300)]
    text = bench_works.comparison(HEAD, after, HEAD, before)
    assert "Contact forces take 0.50 times as long" in text


def test_the_table_has_a_row_for_each_work():
    text = bench_works.table(HEAD, [record("peak", 2.0, 0.5, 1300)])
    assert text.splitlines()[-1] == "| peak | 1,300 evaluations | 2 | 4 | 2 | 4 | 100 |"


def test_page_and_stored_runs_agree(stored):
    head, records = stored
    page = measuring.EVIDENCE.read_text()
    assert bench_works.table(head, list(records.values())) in page
    growths = bench_growth.stored_growths()
    assert bench_growth.table(growths) in page
    assert [measured.sizes for measured in growths[:-1]] == [g.sizes for g in bench_growth.GROWTHS]
    for line in bench_growth.STORED.read_text().splitlines():
        one = json.loads(line)
        assert len(one["sizes"]) == len(one["seconds"])


def test_an_exponent_is_that_of_the_largest_sizes():
    sizes = np.array([1.0, 2.0, 4.0, 8.0])
    assert bench_growth.exponent(sizes, 3.0 * sizes**2.5) == pytest.approx(2.5)
    assert bench_growth.exponent(sizes, np.maximum(sizes**2, 3.9)) == pytest.approx(2.0, abs=0.03)


def test_counted_operations_are_those_of_the_package():
    """A Newton iteration of the core counts as much as the cost of a result."""
    problem = bd.Study(bd.reference_model("turbine_blade"), bd.Excitation("tip"), 5).problem
    system = problem.system(100.0)
    points = system.n_points
    n = system.n_unknowns
    modes = n / (2 * bench_growth.HARMONICS + 1)
    mine = bench_growth.operations(points, modes, bench_growth.HARMONICS)
    assert 1e-6 * mine == pytest.approx(system.work[:3].sum())


def test_memory_and_processor_of_this_process():
    assert measuring.peak_memory() > 10.0
    assert measuring.processor_name()


def test_an_unknown_work_is_refused(monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["bench_works", "peek"])
    with pytest.raises(SystemExit):
        bench_works.main()
    assert "unknown works: peek" in capsys.readouterr().err


def test_stored_files_are_small():
    files = [bench_works.STORED, bench_growth.STORED]
    assert all(file.stat().st_size < 10_000 for file in files)


def test_the_map_in_time_is_drawn_from_its_file(tmp_path, monkeypatch, capsys):
    """Texts stay within their cells, and a higher ratio is darker."""
    monkeypatch.setattr(bench_blades, "MAP_VALUES", tmp_path / "map.json")
    monkeypatch.setattr(bench_blades, "MAP", tmp_path / "map.png")
    kept = []
    monkeypatch.setattr(bench_blades, "save_figure", lambda figure, path: kept.append(figure))
    kinds = [
        bench_blades.Cell(1.0),
        bench_blades.Cell(1.3, 1.25, 1.5),
        bench_blades.Cell(1.94, blades_differ=True),
        bench_blades.Cell(None),
    ]
    cells = {order: [kinds] * len(bench_blades.FRICTION) for order in bench_blades.ORDERS}
    bench_blades.write_map(cells)
    assert bench_blades.read_map() == cells
    bench_blades.map_from_file()
    printed = capsys.readouterr().out
    assert "| mu 0.2 | 1.00 | 1.25 to 1.50 | 1.94 blades differ | not found |" in printed
    (figure,) = kept
    figure.canvas.draw()
    left, right, bar = figure.axes
    assert bar.get_ylabel() == "Highest blade in time / peak of harmonic balance"
    for ax in (left, right):
        for cell, text in zip(ax.patches, ax.texts, strict=True):
            inside, around = text.get_window_extent(), cell.get_window_extent()
            assert around.x0 < inside.x0 and inside.x1 < around.x1
            assert around.y0 < inside.y0 and inside.y1 < around.y1
        greys = [cell.get_facecolor()[0] for cell in ax.patches[:4]]
        assert greys[0] == greys[3] == 1.0 > greys[1] > greys[2]
    plt.close("all")


def test_numbers_below_the_growths_do_not_touch(monkeypatch):
    kept = []
    monkeypatch.setattr(bench_growth, "save_figure", lambda figure, path: kept.append(figure))
    bench_growth.draw(bench_growth.stored_growths())
    (figure,) = kept
    figure.canvas.draw()
    for ax in figure.axes:
        boxes = [label.get_window_extent() for label in ax.get_xticklabels()]
        assert all(one.x1 + 2.0 < other.x0 for one, other in zip(boxes, boxes[1:])), ax.get_xlabel()
    (legend,) = figure.legends
    words = [text.get_text() for text in legend.get_texts()]
    assert words == ["between expected exponents", "fitted to the 3 largest sizes", "measured"]
    plt.close("all")
