"""Equations at a preload are made once in each thread, and budgets of threads do not touch each other."""

import threading

import pytest

import bdamper as bd
from bdamper.harmonic_balance.problem import made_once
from bdamper.harmonic_balance.sector import SectorData
from bdamper.response.response_curve import frequency_response
from tests.plain import plain_study

BAND = (250.0, 400.0)


@pytest.fixture
def study():
    return plain_study(
        bd.reference_model("bladed_disk", 9), bd.Excitation("tip", "tangential"), engine_order=5
    )


def test_problems_do_not_wait_for_each_other():
    """One makes its part in a thread while another is asked for its own, on any version of Python."""
    begun, free = threading.Event(), threading.Event()

    class Holder:
        def __init__(self, waits: bool) -> None:
            self.waits = waits

        @made_once
        def part(self) -> bool:
            begun.set()
            return free.wait(20.0) if self.waits else True

    slow, quick = Holder(True), Holder(False)
    threads = [
        threading.Thread(target=lambda holder=holder: holder.part, daemon=True)
        for holder in (slow, quick)
    ]
    threads[0].start()
    assert begun.wait(5.0)
    threads[1].start()
    threads[1].join(5.0)
    done = not threads[1].is_alive()
    free.set()
    threads[0].join(5.0)
    assert done and slow.part and quick.part


def test_a_track_and_a_peak_make_one_core(study, monkeypatch):
    """At a preload without folds; a peak of a curve with folds is followed from lower preloads as well."""
    made, core = [], SectorData.core
    monkeypatch.setattr(
        SectorData, "core", lambda self, **over: made.append(1) or core(self, **over)
    )
    study.frequency_response(8000.0, BAND)
    assert len(made) == 1
    study.replace(damping_ratio=0.002).peak(8000.0, BAND, errors=False)
    assert len(made) == 2
    for preload in range(1, 40):
        _ = study.problem.at(float(preload)).sector
    assert (
        study.problem.system(8000.0) is not None and len(made) == 3
    )  # the cache keeps the equations of sixteen preloads
    assert study.problem.system(8000.0) is study.problem.system(8000) and len(made) == 3


def test_tracks_on_threads_count_for_themselves(study):
    """A budget that is enough alone is enough beside others, and each curve names its own evaluations."""
    options, curves = (
        bd.ContinuationOptions(budget=4 * study.frequency_response(200.0, BAND).cost.evaluations),
        [None] * 3,
    )
    alone = study.frequency_response(200.0, BAND, options=options)
    assert alone.complete

    def follow(i):
        curves[i] = study.frequency_response(200.0, BAND, options=options)

    threads = [threading.Thread(target=follow, args=(i,)) for i in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert [curve.cost.evaluations for curve in curves] == [alone.cost.evaluations] * 3
    assert all(curve.complete for curve in curves)


def test_the_evaluations_of_all_parts_of_a_search_are_counted(study):
    core = study.problem.system(200.0).core
    before = core.cost.evaluations
    # without the verdict, which follows curves at lower preloads with cores of their own
    curve = frequency_response(study.problem, 200.0, BAND)
    assert curve.cost.evaluations == core.cost.evaluations - before
