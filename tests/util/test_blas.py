"""Threads of the linear algebra while a curve is solved."""

from concurrent.futures import ThreadPoolExecutor
from threading import Barrier

import pytest
from threadpoolctl import ThreadpoolController, threadpool_info, threadpool_limits

from bdamper.util.progress import one_thread, single_thread
from tests.plain import plain_study


def blas():
    return {info["num_threads"] for info in threadpool_info() if info["user_api"] == "blas"}


@pytest.fixture(autouse=True)
def _two_threads():
    with threadpool_limits(limits=None, user_api="blas"):
        pass  # no thread is in charge
    before = blas()
    for library in ThreadpoolController().select(user_api="blas").lib_controllers:
        library.set_num_threads(2)
    if blas() != {2}:
        pytest.skip("this BLAS does not take a number of threads")
    with threadpool_limits(limits=None, user_api="blas"):
        pass
    yield
    for library in ThreadpoolController().select(user_api="blas").lib_controllers:
        library.set_num_threads(min(before))
    with threadpool_limits(limits=None, user_api="blas"):
        pass


def test_one_thread_inside_and_as_before_afterwards():
    assert one_thread(lambda: one_thread(blas)())() == {1}
    assert blas() == {2}


def test_taken_back_after_an_error():
    @one_thread
    def fails():
        raise ValueError("inside")

    with pytest.raises(ValueError, match="inside"):
        fails()
    assert blas() == {2}


def test_held_by_the_caller_of_several_threads():
    @one_thread
    def all_of_them():
        with ThreadPoolExecutor(2) as pool:
            inside = list(pool.map(lambda _: one_thread(blas)(), range(8)))
        return [*inside, blas()]

    assert all(threads == {1} for threads in all_of_them())
    assert blas() == {2}


def test_threads_that_overlap_leave_it_as_it_was():
    first, last = Barrier(2), Barrier(2)

    @one_thread
    def short():
        first.wait()

    @one_thread
    def long():
        first.wait()
        last.wait()

    with ThreadPoolExecutor(2) as pool:
        still = pool.submit(long)
        pool.submit(short).result()
        last.wait()
        still.result()
    assert blas() == {2}


def test_a_thread_that_ends_after_the_one_that_limits_leaves_it_as_it_was():
    inside, left = Barrier(2), Barrier(2)

    @one_thread
    def worker():
        inside.wait()
        left.wait()

    with ThreadPoolExecutor(1) as pool:
        with single_thread():
            still = pool.submit(worker)
            inside.wait()
        left.wait()
        still.result()
    assert blas() == {2}


def test_a_study_solves_on_one_thread(monkeypatch):
    import bdamper as bd
    from bdamper.response import response_curve as track_module

    seen = []
    inner = track_module.first_point
    monkeypatch.setattr(
        track_module, "first_point", lambda *args: seen.append(blas()) or inner(*args)
    )
    plain_study(
        bd.reference_model("bladed_disk", 9),
        bd.Excitation("tip"),
        engine_order=5,
        friction_coefficient=0.4,
    ).frequency_response(2000.0, (340.0, 360.0))
    assert seen
    assert all(threads == {1} for threads in seen)
