"""Executors that end, and several sweeps at once."""

import itertools
import json
import os
import tempfile
import threading
from concurrent.futures import (
    BrokenExecutor,
    Executor,
    Future,
    ProcessPoolExecutor,
    ThreadPoolExecutor,
)
from contextlib import nullcontext
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

import bdamper as bd
from bdamper.analyses import executors
from bdamper.response.optimal_curve import optimal_curve
from tests.util.test_disk import BAND, pressed

ASKED = {"preload": (0.5, 5.0), "n": 6, "frequency": BAND}


class Ends(Executor):
    """Runs some tasks at once; then it refuses more, its tasks fail, or are cancelled."""

    def __init__(self, tasks, how):
        self.left, self.how = tasks, how

    def submit(self, function, *arguments):
        future = Future()
        self.left -= 1
        if self.left >= 0:
            future.set_result(function(*arguments))
        elif self.how == "shut down":
            raise RuntimeError("cannot schedule new futures after shutdown")
        elif self.how == "broken":
            future.set_exception(BrokenExecutor("the workers\nare gone"))
        elif self.how == "killed":  # Dask, where a task has ended four workers
            killed = pytest.importorskip("distributed").KilledWorker
            future.set_exception(
                type("Killed", (killed,), {"__str__": lambda self: REASONS["killed"]})("", None, 3)
            )
        else:
            future.cancel()
            future.set_running_or_notify_cancel()
        return future


REASONS = {
    "shut down": "cannot schedule new futures after shutdown",
    "broken": "the workers are gone",
    "killed": "Attempted to run task '_run-1' on 4 different workers",
    "cancelled": "its tasks were cancelled",
}


def question(study, preload):
    return {"value": 2.0 * preload}


@pytest.mark.parametrize("how", REASONS)
def test_points_that_were_finished_are_returned(how):
    result = bd.sweep(pressed(), {"preload": [1.0, 2.0, 3.0, 4.0]}, question, executor=Ends(2, how))
    assert result.status_text == ("complete", "complete", *[f"not run: {REASONS[how]}"] * 2)
    assert result.array("value")[:2].tolist() == [2.0, 4.0]


@pytest.mark.slow
@pytest.mark.parametrize("how", REASONS)
def test_curves_that_were_finished_are_returned(how, tmp_path):
    whole = optimal_curve(pressed().problem, **ASKED)
    path = tmp_path / "search.jsonl"
    found = optimal_curve(pressed().problem, **ASKED, executor=Ends(4, how), resume=path)
    known = np.isfinite(found.amplitude)
    assert known.tolist() == [False] * 2 + [True] * 4  # from the highest preload down
    np.testing.assert_array_equal(found.amplitude[known], whole.amplitude[known])
    assert found.interrupted and found.optimum.status_text == f"interrupted: {REASONS[how]}"
    assert len(path.read_text().splitlines()) == 1 + 4
    again = optimal_curve(pressed().problem, **ASKED, resume=path)
    np.testing.assert_array_equal(again.amplitude, whole.amplitude)
    with pytest.raises(
        bd.BdamperError, match=f"^executor: expected one that takes tasks, found {REASONS[how]}$"
    ):
        optimal_curve(pressed().problem, **ASKED, executor=Ends(0, how))


def test_pools_that_have_ended():
    over = {"preload": [1.0, 2.0]}
    with ThreadPoolExecutor(1) as pool:
        pass
    assert (
        bd.sweep(pressed(), over, question, executor=pool).status_text
        == (f"not run: {REASONS['shut down']}",) * 2
    )
    with pytest.raises(
        bd.BdamperError, match="executor: expected one that takes tasks, found cannot schedule"
    ):
        optimal_curve(pressed().problem, **ASKED, executor=pool)
    with ProcessPoolExecutor(1) as pool:
        with pytest.raises(BrokenExecutor):
            pool.submit(partial(exec, "import os; os._exit(1)")).result()
        status = bd.sweep(pressed(), over, question, executor=pool).status_text
        assert all(text.startswith("not run: ") and "process" in text for text in status)
        with pytest.raises(
            bd.BdamperError, match="executor: expected one that takes tasks, found "
        ):
            optimal_curve(pressed().problem, **ASKED, executor=pool)


def test_an_error_of_the_question_itself_is_not_that_of_the_executor():
    def wrong(study, preload):
        raise RuntimeError("of the question")

    with ThreadPoolExecutor(1) as pool, pytest.raises(RuntimeError, match=r"^of the question$"):
        bd.sweep(pressed(), {"preload": [1.0]}, wrong, executor=pool)


def of_a_pool_that_has_ended(study, preload):
    with ThreadPoolExecutor(1) as pool:
        pass
    return {
        "value": bd.sweep(study, {"preload": [preload]}, question, executor=pool).array("value")[0]
    }


def test_an_executor_that_ends_within_a_question_fails_its_point_alone():
    with ThreadPoolExecutor(1) as pool:
        for executor in (None, pool):
            result = bd.sweep(
                pressed(), {"preload": [1.0, 2.0]}, of_a_pool_that_has_ended, executor=executor
            )
            assert result.status_text == (f"failed: {REASONS['shut down']}",) * 2


class Read:
    """A question that knows how often this process has read one."""

    read = 0

    def __init__(self, factor):
        self.factor = factor

    def __setstate__(self, state):
        Read.read += 1
        self.__dict__.update(state)

    def __call__(self, study, preload):
        return {"value": self.factor * preload, "read": self.read}


@pytest.mark.parametrize("folder", ["", "nowhere"])
def test_a_process_reads_each_job_once(folder, monkeypatch, tmp_path):
    """Also if it cannot read the file, as on another host or without room for a temporary folder."""
    over = {"preload": [float(k) for k in range(1, 21)]}
    with ProcessPoolExecutor(1) as pool:
        pool.submit(int).result()  # begins the worker before the sweep
        monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / folder))
        for k in (1, 2):
            result = bd.sweep(pressed(), over, Read(float(k)), executor=pool)
            assert set(result.array("read")) == {k} and result.array("value").tolist() == [
                k * p for p in over["preload"]
            ]
    assert Read.read == 0, "a job of this process is never read"


class Window(Executor):
    """Runs the first of the tasks in flight when the sweep waits for one; knows the largest number of them."""

    def __init__(self, pool):
        self.pool, self._max_workers, self.tasks, self.most = pool, 2, [], 0

    def submit(self, function, *arguments):
        self.tasks = [
            *(task for task in self.tasks if not task.done()),
            self.pool.submit(function, *arguments),
        ]
        self.most = max(self.most, len(self.tasks))
        return self.tasks[-1]


def test_a_few_tasks_for_each_worker_are_submitted():
    begin = threading.Event()

    def waits(study, preload):
        begin.wait(30.0)
        return question(study, preload)

    over = {"preload": [float(k) for k in range(1, 31)]}
    with ThreadPoolExecutor(1) as pool:
        window = Window(pool)
        threading.Timer(0.2, begin.set).start()
        result = bd.sweep(pressed(), over, waits, executor=window)
    assert result.complete and result.array("value").tolist() == [2.0 * p for p in over["preload"]]
    assert window.most == 2 * executors.TASKS


# ---- tasks with several points ----


class Inline(Executor):
    """Runs each task when it is submitted; knows how many points each of them had and returned."""

    _max_workers = 1

    def __init__(self):
        self.sizes, self.done = [], []

    def submit(self, function, job, points):
        future = Future()
        self.sizes.append(len(points))
        try:
            future.set_result(function(job, points))
            self.done.append(len(future.result()))
        except BaseException as error:
            future.set_exception(error)
        return future


def test_small_points_share_tasks_and_writes(tmp_path, monkeypatch):
    """Each task has twice as many as the one before it, until they fill its time; all of a task are one write."""
    monkeypatch.setattr(executors, "SECONDS", 1e9)
    writes, write = [], os.write
    monkeypatch.setattr(
        os,
        "write",
        lambda file, content: writes.append(content.count(b"\n")) or write(file, content),
    )
    over, pool = {"preload": [float(k) for k in range(1, 101)]}, Inline()
    result = bd.sweep(pressed(), over, question, executor=pool, resume=tmp_path / "r.jsonl")
    assert result.complete and result.array("value").tolist() == [2.0 * p for p in over["preload"]]
    assert executors.TASKS == 4 and pool.sizes == [1] * 4 + [2] * 4 + [4] * 4 + [8] * 4 + [
        16,
        16,
        8,
    ]
    assert sorted(writes) == sorted([1, *pool.sizes]), (
        "the header, and the tasks in the order of completion"
    )
    again = Inline()
    assert (
        bd.sweep(pressed(), over, question, executor=again, resume=tmp_path / "r.jsonl").complete
        and not again.sizes
    )


@pytest.mark.parametrize(
    ("seconds", "size"), [(0.0, 20), (0.004, 20), (0.007, 14), (0.013, 7), (0.04, 2), (0.11, 1)]
)
def test_a_task_has_as_many_points_as_fill_its_time(seconds, size):
    assert executors.SECONDS == 0.1 and executors._fitting([{"seconds": seconds}] * 10) == size


def test_a_task_ends_after_its_time_and_leaves_the_rest(monkeypatch):
    """The clock of the workers goes on by much more than this time whenever it is read."""
    ticks, asked, pool = itertools.count(), [], Inline()
    monkeypatch.setattr(executors, "SECONDS", 1e9)
    monkeypatch.setattr(executors, "time", SimpleNamespace(monotonic=lambda: 1e10 * next(ticks)))
    over = {"preload": [float(k) for k in range(1, 21)]}
    result = bd.sweep(
        pressed(), over, lambda study, p: asked.append(p) or question(study, p), executor=pool
    )
    assert result.complete and result.array("value").tolist() == [2.0 * p for p in over["preload"]]
    assert sorted(asked) == over["preload"], "each is computed once"
    assert set(pool.sizes) == {1, 2} and pool.done == [1] * 20


@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt])
def test_an_error_within_a_task_keeps_the_points_before_it(error, tmp_path, monkeypatch):
    monkeypatch.setattr(executors, "SECONDS", 1e9)
    asked, broken = [], True

    def wrong(study, preload):
        asked.append(preload)
        if broken and preload == 8.0:
            raise error("of the question")
        return question(study, preload)

    over, path = {"preload": [float(k) for k in range(1, 21)]}, tmp_path / "r.jsonl"
    with pytest.raises(error, match="of the question") if error is RuntimeError else nullcontext():
        bd.sweep(pressed(), over, wrong, executor=Inline(), resume=path)
    known = {json.loads(line)["index"] for line in path.read_text().splitlines()[1:]}
    assert known >= set(range(7)) and 7 not in known
    broken = asked.clear()
    result = bd.sweep(pressed(), over, wrong, resume=path)
    assert result.complete and asked == [p for i, p in enumerate(over["preload"]) if i not in known]


# ---- several sweeps at once ----


class Meeting:
    """A question that waits until another sweep asks one, too."""

    both = threading.Barrier(2)

    def __init__(self, factor):
        self.factor, self.calls = factor, 0

    def __call__(self, study, preload):
        self.both.wait(30.0)
        self.calls += 1
        return {"value": self.factor * preload}


def test_sweeps_side_by_side_keep_their_own_jobs():
    factors = 2.0, 3.0
    over, questions, found = (
        {"preload": [float(k) for k in range(1, 21)]},
        [Meeting(f) for f in factors],
        [None, None],
    )

    def ask(k):
        with ThreadPoolExecutor(1) as pool:
            found[k] = bd.sweep(pressed(), over, questions[k], executor=pool)

    threads = [threading.Thread(target=ask, args=[k]) for k in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(60.0)
    for result, factor in zip(found, factors, strict=True):
        assert result.complete and result.array("value").tolist() == [
            factor * p for p in over["preload"]
        ]
    assert [q.calls for q in questions] == [20, 20]
