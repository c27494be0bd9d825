"""Threads of one result: order, errors, parts within parts, interrupts, and the number of busy threads."""

import os
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from contextvars import copy_context
from functools import partial

import pytest

import bdamper as bd
from bdamper.analyses.executors import run_points
from bdamper.util.progress import CostMeter, raise_if_stopped
from bdamper.util.workers import on_threads, workers


class Busy:
    """Counter of the parts that run at the same time."""

    def __init__(self):
        self.lock, self.now, self.most = threading.Lock(), 0, 0

    def work(self, result):
        with self.lock:
            self.now += 1
            self.most = max(self.most, self.now)
        time.sleep(0.02)
        with self.lock:
            self.now -= 1
        return result


@pytest.mark.parametrize("number", [1, 2, 3, 7])
def test_results_keep_the_order_and_no_more_threads_are_busy_than_workers(number):
    busy = Busy()
    with bd.set_workers(number):
        assert on_threads([partial(busy.work, k) for k in range(8)]) == list(range(8))
    assert busy.most == number


@pytest.mark.parametrize("number", [1, 2, 3])
def test_parts_within_parts_share_the_threads_without_blocking_each_other(number):
    busy = Busy()

    def outer(k):
        return sum(on_threads([partial(busy.work, 10 * k + j) for j in range(3)]))

    with bd.set_workers(number):
        assert on_threads([partial(outer, k) for k in range(4)]) == [3, 33, 63, 93]
    assert busy.most == number


def test_an_idle_thread_takes_over_parts_of_a_long_part():
    threads = set()

    def note(_):
        threads.add(threading.get_ident())
        time.sleep(0.05)

    def long():
        time.sleep(0.02)  # the short part has begun before the parts of this one
        on_threads([partial(note, k) for k in range(2)])

    with bd.set_workers(2):
        on_threads([long, partial(time.sleep, 0.03)])
    assert len(threads) == 2


@pytest.mark.parametrize("number", [1, 2])
def test_the_first_error_in_order_is_raised_after_all_parts(number):
    done = []

    def fail(text, seconds):
        time.sleep(seconds)
        done.append(text)
        raise ValueError(text)

    parts = [
        partial(done.append, "first"),
        partial(fail, "second", 0.05),
        partial(fail, "third", 0.0),
    ]
    with bd.set_workers(number), pytest.raises(ValueError, match="second"):
        on_threads(parts)
    assert sorted(done) == ["first", "second", "third"]


def note_the_stop(ended):
    """Work until another thread stops this one, and note it in ``ended``."""
    try:
        while True:
            raise_if_stopped()
            time.sleep(0.001)
    except KeyboardInterrupt:
        ended.append(True)
        raise


def test_an_interrupt_of_the_calling_thread_ends_the_other_parts():
    begun, ended = threading.Event(), []

    def endless():
        begun.set()
        note_the_stop(ended)

    def interrupted():
        begun.wait()
        raise KeyboardInterrupt

    with bd.set_workers(2), pytest.raises(KeyboardInterrupt):
        on_threads([interrupted, endless])
    assert ended == [True]


def test_a_stop_of_the_outer_call_reaches_parts_within_parts():
    begun, ended = threading.Semaphore(0), []

    def endless():
        begun.release()
        note_the_stop(ended)

    def interrupted():
        begun.acquire()
        begun.acquire()
        raise KeyboardInterrupt

    with bd.set_workers(3), pytest.raises(KeyboardInterrupt):
        on_threads([interrupted, lambda: on_threads([endless, endless])])
    assert ended == [True, True]


def test_the_processor_time_of_all_threads_is_counted():
    def compute():
        end = time.thread_time() + 0.05
        while time.thread_time() < end:
            pass

    with bd.set_workers(2):
        meter = CostMeter()
        on_threads([compute, compute, partial(on_threads, [compute, compute])])
        assert 0.2 <= meter.read().processor < 0.3


def test_the_number_of_workers_is_that_of_the_cores_of_the_process():
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    assert workers() == cores
    with bd.set_workers(5):
        assert workers() == 5
    assert workers() == cores


def test_a_plain_call_sets_the_number_for_all_later_calls():
    def called():
        with bd.set_workers(4):
            bd.set_workers(3)
            inside = workers()
            with bd.set_workers(6):
                pass
            after_inner_block = workers()
        outside = workers()
        bd.set_workers(2)
        return inside, after_inner_block, outside, workers()

    cores = workers()
    assert copy_context().run(called) == (3, 3, cores, 2)
    busy = Busy()

    def computed():
        bd.set_workers(2)
        return on_threads([partial(busy.work, k) for k in range(6)])

    assert copy_context().run(computed) == list(range(6))
    assert busy.most == 2


@pytest.mark.parametrize("wrong", ["two", 0, 2.5, None])
def test_a_plain_call_refuses_what_is_no_number(wrong):
    with pytest.raises(bd.SettingError, match="number: expected a whole number >= 1"):
        bd.set_workers(wrong)


def number_of_workers(settings):
    return {"workers": float(workers())}


def test_a_point_on_an_executor_computes_on_one_thread_and_without_it_on_all():
    seen = []

    def keep(indices, records):
        seen.extend(record["values"]["workers"] for record in records)

    with bd.set_workers(3):
        run_points(number_of_workers, lambda i: {}, [0, 1], None, keep)
        with ThreadPoolExecutor(2) as executor:
            run_points(number_of_workers, lambda i: {}, [0, 1], executor, keep)
    assert seen == [3.0, 3.0, 1.0, 1.0]


def test_one_worker_within_a_part_computes_on_its_thread():
    busy = Busy()

    def part():
        with bd.set_workers(1):
            on_threads([partial(busy.work, k) for k in range(4)])

    with bd.set_workers(4):
        on_threads([part, part])
    assert busy.most == 2, "one thread for each part"


@pytest.mark.parametrize("wrong", [0, -1, 1.5, "all", True])
def test_other_numbers_of_workers_are_refused(wrong):
    with pytest.raises(bd.SettingError, match="number"), bd.set_workers(wrong):
        raise AssertionError("unreachable")
