"""What a result has cost: wall-clock and processor time, counts of the core, old files."""

import time

import pytest

import bdamper as bd
from bdamper.util.cost import Cost, Stopwatch
from tests import models
from tests.plain import plain_study


def test_waiting_costs_no_processor_time():
    watch = Stopwatch()
    time.sleep(0.05)
    spent = watch.read()
    assert spent["seconds"] >= 0.05
    assert spent["processor"] < 0.02


def test_a_curve_carries_both_times(tmp_path):
    study = plain_study(models.wedge_model(1), bd.Excitation("tip", amplitude=5.0), engine_order=2)
    begin, processor = time.perf_counter(), time.thread_time()
    curve = study.track(200.0, (280.0, 320.0))
    cost = curve.cost
    assert 0.0 < cost.core_processor < cost.processor <= time.thread_time() - processor
    assert cost.core <= cost.seconds <= time.perf_counter() - begin
    assert cost.evaluations >= cost.jacobians >= cost.factorisations > 0
    assert f"{cost.seconds:.3f} s, {cost.processor:.3f} s of the processor: contact" in str(curve)
    curve.save(tmp_path / "curve.h5")
    assert bd.load(tmp_path / "curve.h5").cost == cost


def test_a_cost_without_processor_time_does_not_print_it():
    assert str(Cost(seconds=2.0)).startswith("2.000 s: contact")


@pytest.mark.parametrize("name", ["seconds", "processor"])
def test_a_static_state_carries_both_times(name):
    study = plain_study(models.wedge_model(1), bd.Excitation("tip", amplitude=5.0), engine_order=2)
    assert getattr(study.static(200.0).cost, name) > 0.0
