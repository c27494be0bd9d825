"""What a result has cost: wall-clock and processor time, counts of the core, old files."""

import os
import subprocess
import sys
import time
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import bdamper as bd
from bdamper._core import Counts
from bdamper.util import progress
from bdamper.util.progress import Cost, CostMeter
from tests import models
from tests.plain import plain_study


@pytest.fixture
def clocks(monkeypatch):
    """Wall clock at 100 s, processor clock at 10 s, and no other thread that has worked for this one."""
    monkeypatch.setattr(time, "perf_counter", lambda: 100.0)
    monkeypatch.setattr(time, "thread_time", lambda: 10.0)
    monkeypatch.setattr(progress._other_threads, "seconds", 0.0)


def test_waiting_costs_no_processor_time(clocks):
    cost = CostMeter(40.0, processor_start=9.5).read()
    assert (cost.seconds, cost.processor) == (60.0, 0.5)


@pytest.fixture
def crowded():
    """One processor for this process and three that never rest, so that it waits for three quarters of the time."""
    if not hasattr(os, "sched_setaffinity"):
        pytest.skip("no choice of the processor on this system")
    own = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(own)})
    others = [subprocess.Popen([sys.executable, "-c", "print(flush=True)\nwhile True: pass"], stdout=subprocess.PIPE)
              for _ in range(3)]  # fmt: skip
    for other in others:
        other.stdout.readline()
    yield
    for other in others:
        other.kill()
        other.communicate()
    os.sched_setaffinity(0, own)


@pytest.mark.slow
def test_no_part_counts_time_in_which_the_thread_waits(crowded):
    """The parts of a call are its processor time; on the wall clock they take several times as much."""
    study = plain_study(models.wedge_model(1), bd.Excitation("tip", amplitude=5.0), engine_order=2)
    equations = study.problem.system(200.0)
    y, r = np.full(equations.n_unknowns + 1, 1e-6), np.zeros(equations.n_unknowns)
    y[-1], n = 1900.0, len(r)
    J, wall, own = np.zeros((n, n)), time.perf_counter(), time.thread_time()
    before = equations.core.cost
    while time.thread_time() - own < 0.3:
        equations.core.evaluate(y, r, J)
    wall, own, after = time.perf_counter() - wall, time.thread_time() - own, equations.core.cost
    parts = after.contact + after.assembly - before.contact - before.assembly
    assert parts == pytest.approx(after.processor - before.processor, rel=1e-9)
    assert 0.5 * own < parts <= own, "the clock of the thread around all calls"
    assert wall > 2.0 * own, "the fixture leaves the thread to itself"


@pytest.mark.slow
def test_integration_in_time_is_a_part_of_its_own(crowded):
    study = plain_study(models.wedge_model(1), bd.Excitation("tip", amplitude=5.0), engine_order=2)
    cost = study.motion_in_time(
        study.frequency_response(200.0, (280.0, 320.0)), frequency=300.0, periods=30
    ).cost
    assert (
        cost.contact
        == cost.assembly
        == 0.0
        < cost.time_integration
        <= cost.core
        < cost.processor
        < cost.seconds
    )
    assert (
        cost.python == cost.processor - cost.core
        and f", time {cost.time_integration:.3f}, Python {cost.python:.3f};" in str(cost)
    )


def test_a_meter_sums_systems_and_parts(clocks):
    def counted(n):
        core = SimpleNamespace(cost=Counts([*4 * [0.1 * n], 4 * n, 3 * n, 2 * n, n, n]))
        return SimpleNamespace(core=core, work=np.ones(4))

    def spend(system, n):
        system.core.cost = counted(n).core.cost

    systems, meter = [counted(1), counted(5)], CostMeter(90.0, processor_start=9.0)
    for system in systems:
        meter.watch(system)
    spend(systems[0], 3)
    spend(systems[1], 6)
    meter.count(7, 2)
    meter.add(Cost(evaluations=100, iterations=10, work=5.0))
    cost = meter.read()
    assert (cost.seconds, cost.processor) == pytest.approx((10.0, 1.0))
    assert meter.read(Cost(jacobians=4, work=1.0)) == replace(
        cost, jacobians=cost.jacobians + 4, work=cost.work + 1.0
    )
    assert (cost.evaluations, cost.jacobians, cost.factorisations, cost.least_norm) == (
        112,
        9,
        6,
        3,
    )
    assert (cost.iterations, cost.failed_steps) == (17, 2)
    assert cost.work == pytest.approx(5.0 + 3 * (4 + 3 + 2 + 1))


def test_a_cost_without_processor_time_does_not_print_it():
    assert str(Cost(seconds=2.0)).startswith("2.000 s: contact")


def test_a_static_state_carries_both_times(monkeypatch):
    monkeypatch.setattr(CostMeter, "read", lambda watch: Cost(seconds=3.0, processor=2.0))
    study = plain_study(models.wedge_model(1), bd.Excitation("tip", amplitude=5.0), engine_order=2)
    cost = study.static(200.0).cost
    assert (cost.seconds, cost.processor) == (3.0, 2.0)
