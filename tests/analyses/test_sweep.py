"""Sweeps on any executor, results files that survive being killed, samples and percentiles."""

import json
import multiprocessing
import os
import random
import re
import signal
import subprocess
import sys
import time
import tracemalloc
from collections import Counter
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import closing, contextmanager
from dataclasses import dataclass, replace
from types import SimpleNamespace

import h5py
import numpy as np
import pytest
from scipy import stats

import bdamper as bd
from bdamper.analyses import robust_optimum
from bdamper.analyses.sweep import OptimalTask, PeakTask
from bdamper.harmonic_balance.parameters import study_fingerprint
from bdamper.response.events import ContinuationOptions
from bdamper.response.followed_peak import highest_peak
from bdamper.response.linear_limits import peak_interval
from bdamper.response.optimal_curve import optimal_curve
from bdamper.response.optimum_checks import with_checks
from bdamper.response.verification import TimeResponse
from bdamper.util import storage
from bdamper.util.errors import Ending
from bdamper.util.formatting import amount
from bdamper.util.progress import Cost, LongWork
from bdamper.util.storage import ResultsFile, from_line, json_line
from tests.analyses.test_executors import Ends
from tests.models import ground_model
from tests.plain import plain_study
from tests.printed import said

INTERVAL = (250.0, 400.0)


@pytest.fixture(scope="module")
def study():
    model = bd.reference_model(contact_points=9)
    return plain_study(
        model, excitation=bd.Excitation("tip"), engine_order=5, friction_coefficient=0.3
    )


OVER = {"friction_coefficient": [0.2, 0.3, 0.5], "preload": [800.0, 2000.0]}


@pytest.fixture(scope="module")
def serial(study):
    return bd.sweep(study, over=OVER, frequency=INTERVAL)


def answers(result):
    return json.dumps(result.values.tolist())


def residual_norm(study, preload):
    """A quick question: size of the residual at rest."""
    system = study.problem.system(preload)
    r, _, _ = system.evaluate(np.full(system.n_unknowns, 1e-7), 2000.0)
    return {"norm": float(np.linalg.norm(r)), "list": [float(r[0]), float(r[-1])]}


def quick_question(study, preload):
    return {"value": study.settings.friction_coefficient * preload, "note": "x" * 200}


def many_numbers(study, preload):
    return {f"number {k}": k * preload for k in range(9)} | {"note": "x" * 200}


def slow_question(study, preload):
    time.sleep(0.004)
    return quick_question(study, preload)


def stopping_question(study, preload):
    """Ctrl-C at 300 N."""
    if preload == 300.0:
        raise KeyboardInterrupt
    return {"value": preload}


def part_so_far(study, preload):
    """Ctrl-C within work that returns what it has by then, from 300 N."""
    with LongWork():
        stopping_question(study, preload)
    return {"value": preload}


def deadly_question(study, preload):
    """The end of the worker at 300 N."""
    if preload == 300.0:
        os._exit(1)
    return {"value": preload}


@dataclass(frozen=True)
class Logged:
    """A question that writes a line for each call, and ends its process (SIGKILL) once, at a preload (N)."""

    log: str
    deadly: float = np.nan

    def __call__(self, study, preload):
        with open(self.log, "a") as log:
            log.write(f"{preload}\n")
        time.sleep(0.01)
        if preload == self.deadly and self.calls()[preload] == 1:
            os.kill(os.getpid(), signal.SIGKILL)
        return residual_norm(study, preload)

    def calls(self):
        with open(self.log) as log:
            return Counter(map(float, log))


@contextmanager
def dask_executor():
    distributed = pytest.importorskip("distributed", reason="dask.distributed is not installed")
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, dashboard_address=None, silence_logs=50
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        yield client.get_executor()


def sweep_on_dask(study, over, question, path):
    with dask_executor() as executor:
        return bd.sweep(study, over, question, executor=executor, resume=path)


class TestAnswers:
    @pytest.mark.slow
    def test_each_point_is_what_the_study_gives_alone(self, study, serial):
        assert serial.complete
        assert serial.shape == (3, 2)
        amplitude = serial.array("amplitude")
        for i, mu in enumerate(OVER["friction_coefficient"]):
            for j, p in enumerate(OVER["preload"]):
                alone = highest_peak(study.replace(friction_coefficient=mu).problem, p, INTERVAL)
                assert amplitude[i, j] == pytest.approx(alone.amplitude, rel=1e-12)

    @pytest.mark.slow
    def test_threads_and_processes_give_the_same(self, study, serial):
        with ThreadPoolExecutor(2) as pool:
            assert answers(
                bd.sweep(study, over=OVER, frequency=INTERVAL, executor=pool)
            ) == answers(serial)
        with ProcessPoolExecutor(2) as pool:
            assert answers(
                bd.sweep(study, over=OVER, frequency=INTERVAL, executor=pool)
            ) == answers(serial)

    @pytest.mark.slow
    def test_dask_gives_the_same(self, study, serial):
        with dask_executor() as executor:
            result = bd.sweep(study, over=OVER, frequency=INTERVAL, executor=executor)
        assert answers(result) == answers(serial)

    def test_a_question_of_ones_own_and_factors(self, study):
        over = {
            "friction_coefficient": [0.3, 0.4],
            "damper_inertia_factor": [1.0, 2.0],
            "preload": [100.0],
        }
        result = bd.sweep(study, over=over, evaluate=residual_norm)
        assert result.complete, result.status
        direct = study.replace(friction_coefficient=0.3)
        assert result.array("norm")[0, 0, 0] == residual_norm(direct, 100.0)["norm"]
        assert len(np.unique(result.array("norm"))) == 4
        assert result.array("list").shape == (2, 2, 1, 2)

    def test_a_point_without_an_answer_is_marked(self, study):
        result = bd.sweep(study, over={"preload": [1000.0, -1.0]}, frequency=INTERVAL)
        assert result.status[0] == "complete"
        assert result.status_text[1].startswith("failed: preload: expected")
        assert np.isnan(result.array("amplitude")[1])
        assert not result.complete
        assert "1 failed" in result.summary()

    @pytest.mark.parametrize(
        ("arguments", "message"),
        [
            ({"over": {}}, "over: expected"),
            ({"over": {"preload": []}}, "at least one value"),
            ({"over": {"preload": "abc"}}, "sequence"),
            ({"over": {"colour": [1]}}, "expected one of .* found 'colour'"),
            ({"over": {"friction_coefficient": [0.1]}}, "preload: expected a number"),
            ({"over": {"preload": [1.0]}, "combine": "all"}, "combine"),
            (
                {"over": {"preload": [1.0], "friction_coefficient": [0.1, 0.2]}, "combine": "zip"},
                "same number of values",
            ),
            (
                {"over": {"preload": [1.0]}, "evaluate": residual_norm, "frequency": INTERVAL},
                "omit them if evaluate is given",
            ),
        ],
    )
    def test_bad_input(self, study, arguments, message):
        with pytest.raises(bd.SettingError, match=message):
            bd.sweep(study, **arguments)


class TestInterrupted:
    """Ctrl-C keeps the points that are finished."""

    over = {"preload": [100.0, 200.0, 300.0, 400.0]}

    def test_points_left_out_are_not_run(self, study, tmp_path):
        result = bd.sweep(study, self.over, stopping_question, resume=tmp_path / "r.jsonl")
        assert result.status == ("complete", "complete", "not run", "not run")
        assert (
            result.array("value")[:2].tolist() == [100.0, 200.0]
            and np.isnan(result.array("value")[2:]).all()
        )
        assert not result.complete
        assert result.summary().count("interrupted: 2 of 4 parts were not run") == 1
        assert " points over preload, 2 not run" in said(result)
        result.save(tmp_path / "part.h5")
        assert bd.load(tmp_path / "part.h5").status == result.status
        lines = (tmp_path / "r.jsonl").read_text().splitlines()
        assert [json.loads(line)["index"] for line in lines[1:]] == [0, 1]

    def test_a_part_interrupted_on_a_worker_alone_is_no_answer(self, study, tmp_path):
        with ProcessPoolExecutor(1) as pool:
            pool.submit(os.getpid).result()  # begins the worker outside of the sweep
            result = bd.sweep(
                study, self.over, part_so_far, executor=pool, resume=tmp_path / "r.jsonl"
            )
        assert result.status[:3] == ("complete", "complete", "not run")
        lines = (tmp_path / "r.jsonl").read_text().splitlines()[1:]
        assert not {json.loads(line)["index"] for line in lines} & {2}

    def test_the_end_of_a_worker_keeps_what_is_finished(self, study):
        with ProcessPoolExecutor(1) as pool:
            result = bd.sweep(study, self.over, deadly_question, executor=pool)
        assert result.status[:2] == ("complete", "complete") and result.array("value")[
            :2
        ].tolist() == [100.0, 200.0]
        assert all(
            s.startswith("not run: A process in the process pool was terminated")
            for s in result.status_text[2:]
        )
        assert "2 of 4 parts were not run: A process" in result.summary()

    @pytest.mark.nightly
    @pytest.mark.slow
    def test_dask_replaces_a_killed_worker(self, study, tmp_path):
        """The points of its tasks run again; those that it had finished and not yet sent, too."""
        question, over = Logged(str(tmp_path / "log"), 250.0), {"preload": np.arange(1.0, 501.0)}
        with dask_executor() as executor:
            result = bd.sweep(study, over, question, executor=executor, resume=tmp_path / "r.jsonl")
        assert question.calls()[250.0] == 2
        assert result.complete and len((tmp_path / "r.jsonl").read_text().splitlines()) == 501
        assert answers(result) == answers(bd.sweep(study, over, residual_norm))

    @pytest.mark.nightly
    @pytest.mark.slow
    def test_a_killed_client_of_dask_continues(self, study, tmp_path):
        """Finished points are neither lost nor computed again, except for those of the few tasks on the workers."""
        question, path = Logged(str(tmp_path / "log")), tmp_path / "r.jsonl"
        arguments = study, {"preload": np.arange(1.0, 1001.0)}, question, path
        client = multiprocessing.get_context("spawn").Process(target=sweep_on_dask, args=arguments)
        client.start()
        while (
            not path.exists() or path.read_bytes().count(b"\n") < 200
        ):  # of which one is the header
            assert client.is_alive()
            time.sleep(0.01)
        client.kill()
        client.join()
        time.sleep(1.0)  # its workers end
        stored = {json.loads(line)["index"] + 1.0 for line in path.read_bytes().split(b"\n")[1:-1]}
        before = question.calls()
        assert set(before.values()) == {1} and 199 <= len(stored) <= len(before) < 1000
        result = sweep_on_dask(*arguments)
        again = {preload for preload, calls in question.calls().items() if calls > 1}
        assert again <= set(before) - stored, "no stored point is computed again"
        assert len(again) <= 4 * 20, "points of at most two tasks on each worker"
        assert result.complete and answers(result) == answers(
            bd.sweep(study, arguments[1], residual_norm)
        )

    def test_points_finished_while_one_is_written_are_kept(self, study, tmp_path, monkeypatch):
        """Ctrl-C while the first line after the header is written; all four points are finished by then."""
        calls, write = [], os.write

        def stop(file, content):
            calls.append(file)
            if len(calls) == 2:
                raise KeyboardInterrupt
            return write(file, content)

        monkeypatch.setattr(os, "write", stop)
        result = bd.sweep(
            study, self.over, residual_norm, executor=Ends(4, "broken"), resume=tmp_path / "r.jsonl"
        )
        assert result.complete
        lines = (tmp_path / "r.jsonl").read_text().splitlines()
        assert sorted(json.loads(line)["index"] for line in lines[1:]) == [0, 1, 2, 3]

    def test_lines_are_forced_to_disk_once_a_second(self, study, tmp_path, monkeypatch):
        """And at the end: each takes as long as a small point."""
        calls = []
        monkeypatch.setattr(os, "fsync", calls.append)
        with closing(ResultsFile(tmp_path / "r.jsonl", {"format": "x"})) as file:
            for i in range(50):
                file.append(json_line({"index": i}))
            assert len(calls) == 1 and len((tmp_path / "r.jsonl").read_text().splitlines()) == 51
            file.synced -= 2.0
            file.append(json_line({"index": 50}))
            assert len(calls) == 2
        assert len(calls) == 3

    @pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork on this system")
    def test_a_worker_that_outlives_its_parent_does_not_lock_the_file(self, tmp_path):
        file, (here, there) = ResultsFile(tmp_path / "r.jsonl", {"format": "x"}), os.pipe()
        worker = os.fork()
        if not worker:
            os.write(there, b"started")
            time.sleep(60.0)
            os._exit(0)
        try:
            os.read(here, 1)
            os.close(file.file)  # the system closes the files of a killed parent
            with closing(ResultsFile(tmp_path / "r.jsonl", {"format": "x"})) as again:
                assert not list(again.finished())
        finally:
            os.kill(worker, signal.SIGKILL)
            os.waitpid(worker, 0)

    @pytest.mark.slow
    def test_samples(self, study, monkeypatch):
        """Percentiles are those of the draws that were run; a robust optimum is never taken over a part of them."""
        whole, made = optimal_curve, []

        def stopped(*args, **options):
            if len(made) == 3:
                raise KeyboardInterrupt
            made.append(whole(*args, **options))
            return made[-1]

        monkeypatch.setattr(sys.modules["bdamper.analyses.sweep"], "optimal_curve", stopped)
        four = {"friction_coefficient": [0.25, 0.3, 0.35, 0.4]}
        curve = bd.optimal_curve_uncertainty(study, four, (1e3, 2e3), 3, frequency=INTERVAL)
        assert curve.status == ("complete", "complete", "complete", "not run")
        assert np.array_equal(curve.percentile(100.0), curve.amplitude[:3].max(axis=0))
        assert (
            "interrupted: 1 of 4 parts were not run" in curve.summary()
            and "without a peak" not in curve.summary()
        )

    def test_of_a_robust_optimum(self, study, monkeypatch):
        """It is never taken over a part of the draws."""
        left = [14]

        def stopped(*_):
            left[0] -= 1
            if left[0] < 0:
                raise KeyboardInterrupt
            return found_at_all(1.0)

        monkeypatch.setattr(robust_optimum, "at_preload", stopped)
        samples, ways = (
            {"friction_coefficient": [0.25, 0.3]},
            {"n": 5, "tolerance": 1e-3, "frequency": INTERVAL},
        )
        assert bd.robust_optimum(study, samples, (1e3, 2e3), **ways).status == "interrupted"
        with pytest.raises(KeyboardInterrupt):
            bd.robust_optimum(study, samples, (1e3, 2e3), **ways)
        left[0] = 100
        found = bd.robust_optimum(study, samples, (1e3, 2e3), executor=Ends(13, "broken"), **ways)
        assert found.status_text == "interrupted: the workers are gone"
        with pytest.raises(bd.BdamperError, match="robust optimum: the workers are gone"):
            bd.robust_optimum(study, samples, (1e3, 2e3), executor=Ends(0, "broken"), **ways)

    @pytest.mark.slow
    @pytest.mark.usefixtures("interruptible")
    def test_a_signal_to_all_processes(self, tmp_path):
        """As a terminal sends it: to the process and to the workers of its pool."""
        script = tmp_path / "pool.py"
        script.write_text(POOL_SCRIPT)
        child = subprocess.Popen(
            [sys.executable, script],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        assert child.stdout.readline() == "begins\n"
        time.sleep(2.0)
        os.killpg(child.pid, signal.SIGINT)
        out, err = child.communicate(timeout=60)
        status = json.loads(out)
        assert 0 < status.count("complete") < 1000 and set(status) == {"complete", "not run"}, err


POOL_SCRIPT = """
import json, time
from concurrent.futures import ProcessPoolExecutor
import bdamper as bd

def question(study, preload):
    time.sleep(0.05)
    return {"value": preload}

if __name__ == "__main__":
    study = bd.Study(bd.reference_model(contact_points=9), excitation=bd.Excitation("tip"), engine_order=5)
    pool = ProcessPoolExecutor(2)
    print("begins", flush=True)
    result = bd.sweep(study, {"preload": [float(p) for p in range(1, 1001)]}, question, executor=pool)
    print(json.dumps(result.status))
"""


class TestResultsFile:
    over = {"friction_coefficient": np.linspace(0.1, 0.6, 10), "preload": [100.0, 200.0, 300.0]}

    def run(self, study, path, evaluate=quick_question, **more):
        return bd.sweep(study, over=self.over, evaluate=evaluate, resume=path, **more)

    @pytest.mark.slow
    def test_killed_at_random_moments_and_resumed(self, study, tmp_path):
        """10 kills, each at a random moment; no finished point is lost, and the results are those of one quiet run."""
        assert hasattr(os, "fork")
        begin = time.monotonic()
        quiet = answers(self.run(study, tmp_path / "quiet.jsonl", slow_question))
        span = time.monotonic() - begin
        path = tmp_path / "killed.jsonl"
        rng = random.Random(1)
        finished = 0
        for _ in range(10):
            child = os.fork()
            if child == 0:
                try:
                    self.run(study, path, slow_question)
                finally:
                    os._exit(0)
            time.sleep(rng.uniform(0.0, 0.7 * span))
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)
            lines = path.read_bytes().split(b"\n")[1:-1] if path.exists() else []
            indices = [json.loads(line)["index"] for line in lines]
            assert len(set(indices)) == len(indices)  # nothing computed twice
            assert len(indices) >= finished
            finished = len(indices)
        assert finished > 0
        assert answers(self.run(study, path, slow_question)) == quiet
        # and a run of a finished file computes nothing
        before = path.read_bytes()
        assert answers(self.run(study, path, slow_question)) == quiet
        assert path.read_bytes() == before

    @pytest.mark.slow
    def test_torn_last_line_at_every_length(self, study, tmp_path):
        """The file may end anywhere."""
        path = tmp_path / "r.jsonl"
        full = self.run(study, path)
        content = path.read_bytes()
        starts = [0, *[i + 1 for i, c in enumerate(content) if c == 10]]
        for cut in [
            0,
            5,
            starts[1] - 1,
            starts[1],
            starts[1] + 1,
            starts[2] - 1,
            len(content) - 1,
            len(content) - 30,
        ]:
            path.write_bytes(content[:cut])
            assert answers(self.run(study, path)) == answers(full), cut
            assert answers(self.run(study, path)) == answers(full), (
                cut
            )  # and the mended file reads well
            assert path.read_bytes().startswith(content[: starts[1]])

    @pytest.mark.slow
    def test_a_point_takes_little_memory_also_when_it_is_read(self, study, tmp_path, monkeypatch):
        """Its numbers and pointers to texts that are the same; each line of the file is read once."""
        n, read = 3000, []
        over = {"preload": np.linspace(1.0, 2.0, n).tolist()}
        first = bd.sweep(study, over, many_numbers, resume=tmp_path / "r.jsonl")
        parts = first.points, first.values, first.cost, first.seconds
        assert sum(part.nbytes for part in parts) == n * (8 + 80 + 112 + 8)
        assert len({id(text) for text in first.values["note"]}) == 1
        monkeypatch.setattr(storage, "from_line", lambda line: read.append(line) or from_line(line))
        tracemalloc.start()
        again = bd.sweep(study, over, many_numbers, resume=tmp_path / "r.jsonl")
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert (
            again.values.tolist() == first.values.tolist()
            and again.cost.tolist() == first.cost.tolist()
        )
        assert len(read) == n and peak - sum(map(len, read)) < 1000 * n

    def test_file_of_another_study_is_refused(self, study, tmp_path):
        path = tmp_path / "r.jsonl"
        self.run(study, path)
        content = path.read_bytes()
        with pytest.raises(bd.BdamperError, match="results of different settings: study"):
            self.run(study.replace(engine_order=60), path)
        with pytest.raises(bd.BdamperError, match="results of different settings: over"):
            bd.sweep(study, over={"preload": [1.0]}, evaluate=quick_question, resume=path)
        with pytest.raises(bd.BdamperError, match="results of different settings: evaluate"):
            bd.sweep(study, over=self.over, evaluate=residual_norm, resume=path)
        assert path.read_bytes() == content

    def test_something_else_is_refused_and_left_alone(self, study, tmp_path):
        for text in (b"notes of mine\n", b"notes", b'{"format": "other"}\n'):
            path = tmp_path / "notes.txt"
            path.write_bytes(text)
            with pytest.raises(bd.BdamperError, match=r"found a file of a different kind$"):
                self.run(study, path)
            assert path.read_bytes() == text

    def test_two_runs_on_one_file_are_refused(self, study, tmp_path):
        header = {"format": "bdamper-sweep-results"}
        first = ResultsFile(tmp_path / "r.jsonl", header)
        with pytest.raises(bd.BdamperError, match="no other run uses"):
            ResultsFile(tmp_path / "r.jsonl", header)
        first.close()
        ResultsFile(tmp_path / "r.jsonl", header).close()

    def test_fingerprint_sees_every_setting(self, study):
        base = study_fingerprint(study.problem)
        others = [
            study.replace(friction_coefficient=0.31),
            study.replace(harmonics=3),
            study.replace(excitation=replace(study.excitation, amplitude=2.0)),
            study.replace(contact_stiffness=1e7),
            study.replace(contact_forces=bd.AFT(64)),
            study.replace(model=bd.reference_model(contact_points=24)),
        ]
        prints = [study_fingerprint(s) for s in others]
        assert len({base, *prints}) == len(prints) + 1
        assert study_fingerprint(study._with_problem(study.problem.replace()).problem) == base


DISTRIBUTIONS = {
    "friction_coefficient": stats.uniform(0.2, 0.2),
    "damping_factor": stats.lognorm(0.1),
}


@pytest.fixture(scope="module")
def samples():
    return bd.sample(DISTRIBUTIONS, 4, seed=3)


@pytest.fixture(scope="module")
def curve(study, samples):
    return bd.optimal_curve_uncertainty(study, samples, (200.0, 10e3), 5, frequency=INTERVAL)


class TestWarnings:
    """What an answer leaves open reaches the result of a sweep, and what is made of sweeps."""

    @pytest.fixture
    def short(self, monkeypatch):
        """Scans that stop early."""
        options = ContinuationOptions(tolerance=1e-7, step=0.1, locate_tolerance=0.05, budget=450)
        for name in ("coarse_options", "ContinuationOptions"):
            monkeypatch.setattr(sys.modules["bdamper.response.highest_peak"], name, lambda: options)

    def test_a_peak_of_an_incomplete_scan(self, study, short):
        wide = (200.0, 1200.0)
        peak = study.peak(3000.0, wide)
        assert peak.search_status == "incomplete"
        search = f"incomplete: {peak.search_reason}"
        result = bd.sweep(study, {"preload": [3000.0]}, frequency=wide)
        assert not result.complete and result.status_text == (peak.status_text,)
        assert result.array("search_status").tolist() == ["incomplete"]
        assert result.array("search_reason").tolist() == [peak.search_reason]
        assert result.warnings == (f"search {search}",)
        assert "failed" not in result._headline()
        # lines are at most 88 wide
        assert " ".join(result.summary().split()).count(f"search {search}") == 1

    @pytest.mark.slow
    def test_optimal_curves_and_what_is_made_of_them(self, study, monkeypatch, tmp_path):
        whole = optimal_curve

        def coarse(*args, **options):
            curve = whole(*args, **options)
            coarse_optimum = replace(
                curve.optimum, status="incomplete", reason="lost", uncertainty=0.1
            )
            return replace(
                curve, optimum=coarse_optimum, status=("scan incomplete (lost)", *curve.status[1:])
            )

        monkeypatch.setattr(sys.modules["bdamper.analyses.sweep"], "optimal_curve", coarse)
        samples = {"friction_coefficient": [0.3]}
        result = bd.sweep(study, samples, OptimalTask((500.0, 3000.0), 5, INTERVAL))
        assert result.plot().axes[0].get_ylabel() == "Optimum amplitude (µm)"
        assert result.values[0]["optimum_status"] == "incomplete"
        assert result.values[0]["optimum_reason"] == "lost"
        assert result.values[0]["optimum_uncertainty"] == 0.1
        expected = (
            "500 N: scan incomplete (lost); optimum: lowest amplitude at the lower end of the "
            "range, 500 N; a lower amplitude may lie below it; "
            "optimum incomplete: lost, preload uncertain by 10 %"
        )
        assert result.warnings == (expected,)
        curve = bd.optimal_curve_uncertainty(study, samples, (500.0, 3000.0), 5, frequency=INTERVAL)
        assert curve.warnings == (expected,)
        assert "optimum incomplete: lost" in curve.summary()
        curve.save(tmp_path / "curve.h5")
        assert bd.load(tmp_path / "curve.h5").warnings == (expected,)


def found_at_all(amplitude, known=True, rattles=""):
    """What the search at one preload comes to."""
    end = Ending() if known else Ending("incomplete", "why")
    if rattles:
        end = Ending("not found", f"no steady periodic response: {rattles}")
    # without folds no peak is followed from a lower preload
    curve = SimpleNamespace(folds=())
    return SimpleNamespace(
        amplitude=amplitude,
        known=known,
        rattles=rattles,
        ending=end,
        cost=Cost(),
        top=None,
        curve=curve,
    )


class TestUncertainty:
    @pytest.mark.slow
    def test_every_draw_is_its_own_optimal_curve(self, study, samples, curve):
        from bdamper.harmonic_balance.parameters import vary

        own = vary(study, {name: float(v[2]) for name, v in samples.items()})
        alone = own.optimal_curve((200.0, 10e3), 5, frequency=INTERVAL, check=False)
        assert curve.amplitude[2] == pytest.approx(alone.amplitude, rel=1e-9)
        assert curve.frequency[2] == pytest.approx(alone.frequency, rel=1e-9)

    @pytest.mark.slow
    def test_percentiles_are_ordered_and_reach_the_extremes(self, curve):
        low, mid, high = curve.percentile([5.0, 50.0, 95.0])
        assert np.all(low < mid)
        assert np.all(mid < high)
        assert curve.percentile(0.0) == pytest.approx(curve.amplitude.min(axis=0))
        assert curve.percentile(100.0) == pytest.approx(curve.amplitude.max(axis=0))

    @pytest.mark.nightly
    @pytest.mark.slow
    def test_robust_optimum_bounds_a_spread_of_friction(self, study):
        """Friction and preload act nearly as a product, so the robust preload lies between the two extremes' optima."""
        spread = {"friction_coefficient": [0.25, 0.3, 0.35]}
        found = bd.robust_optimum(
            study, spread, (20.0, 70.0), percentile=100.0, n=7, tolerance=0.05, frequency=INTERVAL
        )  # fmt: skip
        worst = bd.optimal_curve_uncertainty(study, spread, [0.9 * found.preload, found.preload, 1.1 * found.preload],
                                   frequency=INTERVAL).percentile(100.0)  # fmt: skip
        assert worst[1] == pytest.approx(found.amplitude, rel=1e-9)
        assert worst[1] <= min(worst[0], worst[2])

    @pytest.fixture
    def robust(self, study, monkeypatch):
        """Robust optimum of given amplitudes: 1 + |ln(p/p0)| with p0 in proportion to 1/mu.

        The least maximum is 1 + ln(2)/2 for coefficients of 0.2 to 0.4, at the geometric mean of the two p0.
        """

        def answer(change=lambda mu, p, size: found_at_all(size), preload=(100.0, 1e4), **ways):
            def stands_in(problem, p, frequency):
                mu = problem.settings.friction_coefficient
                assert frequency == INTERVAL
                return change(mu, p, 1.0 + abs(np.log(p * mu / 300.0)))

            monkeypatch.setattr(robust_optimum, "at_preload", stands_in)
            ways = {"percentile": 100.0, "frequency": INTERVAL} | ways
            return bd.robust_optimum(
                study, {"friction_coefficient": [0.2, 0.3, 0.4]}, preload, **ways
            )

        return answer

    BEST, HEIGHT = 300.0 / np.sqrt(0.2 * 0.4), 1.0 + 0.5 * np.log(2.0)

    @pytest.mark.slow
    def test_a_robust_optimum_of_given_peaks(self, robust):
        whole = robust(tolerance=1e-6)
        assert (whole.preload, whole.amplitude) == pytest.approx((self.BEST, self.HEIGHT), rel=1e-5)
        assert (whole.status, whole.kind, whole.warnings) == ("complete", "interior", 0)
        middle = robust(percentile=50.0, tolerance=1e-6)
        expected = (
            np.sqrt(750.0 * 1000.0),
            1.0 + 0.5 * np.log(4.0 / 3.0),
        )  # between the p0 of 0.4 and of 0.3
        assert (middle.preload, middle.amplitude) == pytest.approx(expected, rel=1e-5)
        end = robust(preload=(2e3, 1e4))
        assert (end.preload, end.kind) == (2000.0, "end") and end.amplitude == pytest.approx(
            1.0 + np.log(8.0 / 3.0)
        )

    @pytest.mark.slow
    def test_lower_bounds_are_no_candidates(self, robust):
        """They leave a doubt where they are lower than the answer, also if only the first grid has met them."""

        def bound(size, below):
            return lambda mu, p, own: found_at_all(size or own, known=not (mu == 0.4 and p < below))

        part = robust(bound(0.0, 1.2 * self.BEST))
        assert 1.2 * self.BEST <= part.preload < 1.25 * self.BEST and part.warnings > 0
        assert re.fullmatch(
            r"incomplete: \d+ preloads whose peak was not found in every draw could be lower",
            part.status_text,
        )
        far = robust(lambda mu, p, own: found_at_all(own if p > 150.0 else 0.1, known=p > 150.0))
        assert far.preload == pytest.approx(self.BEST, rel=0.03) and far.warnings == 0
        assert (
            far.status_text
            == "incomplete: 1 preload whose peak was not found in every draw could be lower"
        )
        higher = robust(lambda mu, p, own: found_at_all(own, known=p > 150.0))
        assert higher.preload == pytest.approx(self.BEST, rel=0.03) and higher.status == "complete"
        with pytest.raises(
            bd.BdamperError, match="no preload from 100 to 10000 N has a steady peak in all 3 draws"
        ):
            robust(bound(0.0, 1e5))

    def test_preloads_at_which_a_damper_rattles_are_no_candidates(self, robust):
        def below(mu, p, own):
            return found_at_all(
                own if p > 2e3 else 0.1, rattles="why" if p < 2e3 and mu == 0.2 else ""
            )

        found = robust(below)
        assert 2e3 < found.preload < 2.1e3 and found.status == "complete"

    @pytest.mark.parametrize("n", [6, 7])
    def test_the_best_so_far_is_kept(self, robust, n):
        """One preload alone has a peak in every draw; the finer grids find no other."""
        alone = float(np.geomspace(100.0, 1e4, n)[3])
        found = robust(
            lambda mu, p, own: found_at_all(own if p == alone else 0.0, known=p == alone), n=n
        )
        assert found.preload == alone and found.status_text.startswith("incomplete: ")

    @pytest.mark.slow
    def test_an_unknown_draw_counts_as_infinite(self, robust):
        """One unknown draw of three has no influence on the median, and excludes a preload from the maximum."""

        def gone(mu, p, own):
            return found_at_all(0.0 if mu == 0.2 else own, known=mu != 0.2)

        # without 0.2, the highest of 0.3 and 0.4 is the median of all three: p0 of 1000 and 750 N
        middle = robust(gone, percentile=50.0, tolerance=1e-6)
        expected = np.sqrt(750.0 * 1000.0), 1.0 + 0.5 * np.log(4.0 / 3.0)
        assert (middle.preload, middle.amplitude) == pytest.approx(expected, rel=1e-5)
        with pytest.raises(bd.BdamperError, match="has a steady peak in all 3 draws"):
            robust(gone)

    @pytest.mark.slow
    def test_percentiles_of_a_robust_optimum_are_draws(self, robust):
        """70 % of three draws: two of three are only 67 %, so that it is the highest one."""
        found = robust(percentile=70.0, tolerance=1e-6)
        assert (found.preload, found.amplitude) == pytest.approx((self.BEST, self.HEIGHT), rel=1e-5)
        height = amount(found.amplitude, "m")
        text = said(found)
        assert (
            f": at most {height} in all 3 draws Amplitude {height} largest of 3 draws of " in text
        )
        assert "70th percentile not known requires at least 5 draws " in text
        assert " in 50 % of 3 draws " in said(robust(percentile=50.0))
        assert "requires" not in str(robust(percentile=100.0))

    def test_a_draw_that_fails_is_named(self, study, monkeypatch):
        """It does not count, and the other draws give the optimum that they give alone."""
        monkeypatch.setattr(
            robust_optimum,
            "at_preload",
            lambda problem, p, frequency: found_at_all(1.0 + abs(p - 1500.0)),
        )
        ways = {"preload": (1e3, 2e3), "n": 5, "frequency": INTERVAL}
        found = bd.robust_optimum(study, {"friction_coefficient": [0.2, -0.1, 0.3]}, **ways)
        alone = bd.robust_optimum(study, {"friction_coefficient": [0.2, 0.3]}, **ways)
        assert (found.preload, found.amplitude, found.draws) == (alone.preload, alone.amplitude, 2)
        named = "1 of 3 draws failed and does not count; the first is draw 1: friction_coefficient: expected a finite"
        assert named in said(found)
        with pytest.raises(bd.SettingError, match="friction_coefficient: expected a finite"):
            bd.robust_optimum(study, {"friction_coefficient": [-0.1]}, **ways)

    def test_a_draw_without_a_peak_counts_as_infinite(self, curve):
        """Seven draws of eight unknown: no amplitude bounds half of them."""
        size = np.arange(1.0, 9.0)[:, None] * np.ones(2)
        size[1:, 1] = np.nan
        names = {
            "preload": np.array([1.0, 2.0]),
            "frequency": size,
            "status": ("complete",) * 8,
            "warnings": (),
        }
        found = replace(
            curve, amplitude=size, samples={"friction_coefficient": np.ones(8)}, **names
        )
        assert found.percentile(0.0).tolist() == [1.0, 1.0]
        assert found.percentile([50.0, 95.0]).tolist() == [[5.0, np.inf], [8.0, np.inf]]
        # any sequence of 4 unknown frequencies could be lower or higher than the others
        assert found.percentile(50.0, "frequency").tolist() == pytest.approx(
            [5.0, np.nan], nan_ok=True
        )
        assert not found.complete
        text = said(found)
        assert text.startswith(
            "Not for design: the best preload, 1 N, is at the lower end of the range "
            "Amplitude 8 m largest of 8 draws of the friction coefficient "
            "95th percentile not known requires at least 21 draws "
        )
        assert " 1 N 5 m 8 m 2 N no peak no peak " in text
        assert "7 of 8 draws have no peak at some preloads" in text
        status = ("failed", *found.status[1:])
        failed = replace(found, status=status, reason=("why", *found.reason[1:]))
        assert failed.percentile(0.0).tolist() == [2.0, np.inf]
        assert "1 of 8 draws failed and does not count; the first is draw 0: why" in said(failed)
        assert failed.plot().axes[0].get_legend_handles_labels()[1][-1] == "95 %: no value"

    def test_percentiles_of_many_draws(self, curve):
        """95 % of n draws are at or below the percentile, for every n; from 21 draws on it is below the highest."""
        for n in range(2, 45):
            size = np.random.default_rng(n).permutation(np.arange(1.0, n + 1.0))[:, None]
            found = replace(curve, preload=np.array([1.0]), amplitude=size, frequency=size, status=("complete",) * n,
                            samples={"friction_coefficient": np.ones(n)}, warnings=())  # fmt: skip
            reached = float(found.percentile(95.0)[0])
            assert np.count_nonzero(size <= reached) >= 0.95 * n and (reached < n) == (n >= 21)
            assert ("not known requires at least 21 draws" in said(found)) == (n < 21)

    def test_low_percentiles_take_the_lower_draw(self, curve):
        """Draws of a uniform distribution: a band contains its share of them, and its mirror image is its other end."""

        def of_draws(size):
            n = len(size)
            return replace(curve, preload=np.array([1.0]), amplitude=size[:, None], frequency=size[:, None],
                           status=("complete",) * n, samples={"friction_coefficient": np.ones(n)}, warnings=())  # fmt: skip

        three = of_draws(np.array([506e-6, 53e-6, 591e-6]))
        shares = [5.0, 25.0, 50.0, 75.0, 95.0]
        expected = [53e-6, 53e-6, 506e-6, 591e-6, 591e-6]
        assert three.percentile(shares)[:, 0].tolist() == expected
        for n in range(2, 45):
            uniform = (np.random.default_rng(n).permutation(n) + 0.5) / n
            found, mirrored = of_draws(uniform), of_draws(1.0 - uniform)
            for q in (0.0, 2.5, 5.0, 25.0, 40.0):
                low, high = found.percentile([q, 100.0 - q])[:, 0]
                assert np.count_nonzero((low <= uniform) & (uniform <= high)) >= (1 - q / 50) * n
                # next to the percentile of the distribution
                assert abs(low - q / 100.0) <= 1.0 / n and abs(high - 1.0 + q / 100.0) <= 1.0 / n
                assert mirrored.percentile(100.0 - q)[0] == pytest.approx(1.0 - low)

    def test_draws_of_an_uncertain_curve_that_fail(self, study, monkeypatch):
        """A draw with invalid settings does not count; one whose search ends in an error is unknown."""
        whole = optimal_curve

        def some(problem, *args, **options):
            if problem.settings.friction_coefficient == 0.25:
                raise bd.BdamperError("no peak found")
            return whole(problem, *args, **options)

        monkeypatch.setattr(sys.modules["bdamper.analyses.sweep"], "optimal_curve", some)
        draws = {"friction_coefficient": [-0.1, 0.3, 0.25]}
        found = bd.optimal_curve_uncertainty(study, draws, (1e3, 2e3), 2, frequency=INTERVAL)
        assert [s.partition(":")[0] for s in found.status] == ["failed", "complete", "not found"]
        assert np.isinf(found.percentile(100.0)).all() and np.array_equal(
            found.percentile(0.0), found.amplitude[1]
        )

    def test_the_mode_sets_the_interval(self, study, monkeypatch):
        seen = set()

        def at(problem, p, frequency):
            seen.add(frequency)
            return found_at_all(p)

        monkeypatch.setattr(robust_optimum, "at_preload", at)
        bd.robust_optimum(study, {"friction_coefficient": [0.3]}, (1e3, 1.01e3), n=5, mode=2)
        assert seen <= {
            peak_interval(study.problem.at(p), None, 2) for p in np.geomspace(1e3, 1.01e3, 5)
        }

    @pytest.mark.slow
    def test_other_friction_is_that_of_other_studies(self, study, monkeypatch, tmp_path):
        curve = study.optimal_curve((500.0, 3000.0), 3, frequency=INTERVAL, check=False)
        found = robust_optimum.with_other_friction(study.problem, curve)
        best = curve.optimum
        own, *others = found.other_friction
        assert (own.factor, own.preload) == (1.0, best.preload) and own.amplitude == pytest.approx(
            best.amplitude, rel=1e-6
        )
        for k, factor in zip(others, (0.7, 1.3), strict=True):
            peak = study.replace(friction_coefficient=factor * 0.3).peak(best.preload, INTERVAL)
            assert (k.factor, k.preload, k.status) == (factor, best.preload, peak.search_status)
            assert (
                k.amplitude
                == pytest.approx(peak.amplitude, rel=1e-9)
                != pytest.approx(best.amplitude, rel=1e-3)
            )
        assert (
            found.cost.evaluations > curve.cost.evaluations
            and found.cost.seconds > curve.cost.seconds
        )
        high = [k for k in others if k.amplitude > 1.2 * own.amplitude]
        worse = replace(
            found,
            other_friction=(own, others[0], replace(others[1], amplitude=3.0 * own.amplitude)),
        )
        for shown, names in (
            (found, high),
            (worse, [*[k for k in high if k.factor < 1.0], worse.other_friction[2]]),
        ):
            labels = shown.plot().axes[0].get_legend_handles_labels()[1]
            drawn = [label for label in labels if "times the friction" in label]
            assert drawn == [f"{k.factor:g} times the friction" for k in names]
        found.save(tmp_path / "found.h5")
        stored = bd.load(tmp_path / "found.h5")
        assert (
            stored.other_friction == found.other_friction
            and stored.mass_radius == found.mass_radius
        )
        with h5py.File(tmp_path / "found.h5", "a") as file:  # like a file of an earlier version
            del file["other_friction"], file.attrs["mass_radius"]
        assert bd.load(tmp_path / "found.h5").other_friction == () and np.isnan(
            bd.load(tmp_path / "found.h5").mass_radius
        )
        assert "other friction 3" in str(found.diff(worse))
        own_law = bd.ContactLaw.jenkins([1e7], 0.0, 0.3, kn=1e7)
        for other in (
            {"friction_coefficient": 0.0},
            {"friction_law": "bonded"},
            {"friction_law": own_law},
        ):
            assert (
                robust_optimum.with_other_friction(study.replace(**other).problem, curve) is curve
            )

    @pytest.mark.slow
    def test_other_friction_is_asked_for_at_the_recommended_preload(self, study, monkeypatch):
        """What fails, rattles or is interrupted is not known, and the first line does not call it covered."""
        curve = study.optimal_curve((500.0, 3000.0), 3, frequency=INTERVAL, check=False)
        times = [
            TimeResponse(a, a, a, 1.0, p, a)
            for p, a in ((curve.optimum.preload, 2.0), (900.0, 1.0))
        ]
        asked = []

        def stands_in(*answers):
            left = list(answers)

            def at(problem, p, frequency):
                asked.append((round(problem.settings.friction_coefficient, 6), p, frequency))
                answer = left.pop(0) if left else peak
                if isinstance(answer, BaseException):
                    raise answer
                return answer

            monkeypatch.setattr(robust_optimum, "at_preload", at)
            # the answers are given in the order of the factors
            with bd.set_workers(1):
                return robust_optimum.with_other_friction(
                    study.problem, replace(curve, time_response=tuple(times))
                )

        peak, rattling = found_at_all(1.0), found_at_all(1.0, rattles="why")
        found = stands_in(peak, peak, peak)
        assert asked[:3] == [(mu, 900.0, INTERVAL) for mu in (0.3, 0.21, 0.39)]
        assert (
            found.friction_range.text
            == "the amplitude does not double from 0.67 to 1.5 times the friction"
        )
        assert "friction coefficients outside 0.7 to 1.3 times 0.3" in said(found)
        moved = said(replace(found, time_response=tuple(times[:1])))
        call = f"{with_checks(found)}, so far run at 900 N only"
        assert call.startswith("study.optimal_curve((")
        price = r"(, about [\d.]+ m?s)?"
        assert re.search(f"other friction coefficients{price}: {re.escape(call)}", moved)
        assert "friction coefficients other than 0.3" in moved
        lost = stands_in(peak, bd.BdamperError("why"), rattling).other_friction
        assert [k.status_text for k in lost[1:]] == [
            "not found: why",
            "not found: no steady periodic response: why",
        ]
        assert np.isnan(lost[1].amplitude) and lost[2].amplitude == np.inf
        part = stands_in(peak, peak, KeyboardInterrupt())
        assert [k.status for k in part.other_friction] == ["complete", "complete", "interrupted"]
        assert part.friction_range.interrupted and not found.friction_range.interrupted
        assert "beyond 0." not in said(stands_in(peak, bd.BdamperError("why"), rattling))

    def test_a_factor_on_all_friction_coefficients(self, study):
        assert study.replace(friction_factor=1.5).settings.friction_coefficient == pytest.approx(
            0.45
        )
        points = study.model.interfaces["left"].n_points
        each_one = study.replace(
            friction_coefficient={"left": np.linspace(0.1, 0.5, points), "right": 0.2}
        )
        scaled = each_one.replace(friction_factor=0.5).settings.friction_coefficient
        np.testing.assert_allclose(scaled["left"], np.linspace(0.05, 0.25, points))
        assert scaled["right"] == pytest.approx(0.1)
        listed = study.replace(friction_coefficient={"left": [0.3] * points, "right": 0.2}).replace(
            friction_factor=0.5
        )
        np.testing.assert_allclose(listed.settings.friction_coefficient["left"], 0.15)

    @pytest.mark.parametrize(
        ("call", "message"),
        [
            (lambda s: bd.sample({}, 8), "distributions: expected"),
            (lambda s: bd.robust_optimum(s, {"preload": [1.0]}), "other than the preload"),
            (lambda s: bd.robust_optimum(s, {}), "other than the preload, found none"),
            (
                lambda s: bd.robust_optimum(
                    s, {"friction_factor": [1.0, 2.0], "gap_factor": [1.0]}
                ),
                r"found \[2, 1\]",
            ),
            (
                lambda s: s.replace(friction_law="bonded").replace(friction_factor=2.0),
                "friction_factor: no friction interface has",
            ),
            (
                lambda s: bd.robust_optimum(s, {"friction_factor": 0.7}),
                "'friction_factor': expected a sequence of values",
            ),
            (
                lambda s: bd.robust_optimum(s, {"contact_stiffness": np.ones((2, 9))}),
                r"'contact_stiffness': expected one number for each draw, found an array of shape \(2, 9\)",
            ),
            (
                lambda s: bd.optimal_curve_uncertainty(s, {"gap": [[0.0], [0.0, 1e-6]]}),
                "'gap': expected a sequence of values",
            ),
            (lambda s: bd.sample({"x": 3}, 8), "one of scipy.stats"),
            (lambda s: bd.sample({"x": stats.norm()}, 7), "power of two"),
            (
                lambda s: bd.optimal_curve_uncertainty(s, {"preload": [1.0]}),
                "other than the preload",
            ),
            (
                lambda s: bd.robust_optimum(s, {"friction_coefficient": [0.3]}, percentile=101),
                "percentile",
            ),
        ],
    )
    def test_bad_input(self, study, call, message):
        with pytest.raises(bd.SettingError, match=message):
            call(study)


def constant(study, preload):
    """An answer that no setting changes, but for rounding."""
    return {"amplitude": 2e-3 * (1.0 + 1e-14 * study.problem.settings.damping_ratio)}


def test_a_setting_without_effect_has_no_lowest_value():
    study = bd.lumped(
        1.0, 0.1, 1.0, contacts=[bd.Contact(0, kt=1.0, mu=1.0, preload=1.0)], forces={0: 1.0}
    )
    found = bd.sweep(study, {"damping_ratio": [0.01, 0.02, 0.03]}, constant)
    assert said(found).startswith("No effect of damping ratio: amplitude 2 mm at all points")
    assert "owest" not in said(found)


def test_models_without_a_loaded_body_say_so():
    study = plain_study(
        ground_model(), excitation=bd.Excitation("tip"), engine_order=2, contact_stiffness=1e6
    )
    with pytest.raises(bd.SettingError, match="carries a load"):
        study.optimal_curve(check=False)
    assert PeakTask(0.0) == PeakTask(0.0)
    result = bd.sweep(study, over={"friction_coefficient": [0.1]}, evaluate=OptimalTask())
    assert result.status_text[0].startswith(
        "failed: optimal_curve: expected a model with a body that carries a load"
    )


def test_answers_do_not_depend_on_order(study):
    """To the last bit, also where only the preload varies and all points share one study."""
    loads = [5000.0, 700.0, 1500.0]
    fresh = study._with_problem(study.problem.replace())
    first = bd.sweep(fresh, over={"preload": loads}, frequency=INTERVAL)
    again = bd.sweep(
        study._with_problem(study.problem.replace()),
        over={"preload": loads[::-1]},
        frequency=INTERVAL,
    )
    assert repr(first.values.tolist()) == repr(again.values[::-1].tolist()), (
        "NaN is not equal to itself"
    )


@pytest.mark.slow
def test_a_shroud_over_its_interference():
    """The columns are those of single answers, by load and by gap; below first slip the peak is linear."""
    study = bd.Study(
        bd.reference_model("shrouded_blade"), bd.Excitation("tip", "axial", 0.2), engine_order=4,
        harmonics=1, load_per_preload={"front": 1.0, "rear": 0.6}, constant_loads={"shroud": 1.0},
    )  # fmt: skip
    loads = (100.0, 500.0)
    band = (1400.0, 1640.0)
    task = bd.PeakTask(preload=300.0, frequency=band, errors=False, shroud="shroud")
    swept = bd.sweep(study, {"constant_loads.shroud": loads}, task)
    for i, load in enumerate(loads):
        single = study.replace(constant_loads={"shroud": load})
        state = single.static(300.0)
        limit = single.first_slip(300.0, band)
        row = swept.values[i]
        assert row["shroud_force"] == pytest.approx(state.normal_force["shroud"], rel=1e-9)
        assert row["interference"] == pytest.approx(state.largest_interference["shroud"], rel=1e-9)
        assert row["static_slip"] == pytest.approx(state.static_slip["shroud"], abs=1e-15)
        assert row["first_slip"] == pytest.approx(limit.factor, rel=1e-6)
        assert row["locked_amplitude"] == pytest.approx(limit.amplitude_at_first_slip, rel=1e-6)
        if limit.locked:
            linear = limit.amplitude_at_first_slip / limit.factor
            assert row["amplitude"] == pytest.approx(linear, rel=1e-6)
    interference = swept.array("interference")[1]
    by_gap = study.replace(constant_loads=None)
    swept_gap = bd.sweep(by_gap, {"gap.shroud": [-interference]}, task)
    assert swept_gap.array("interference")[0] == pytest.approx(interference, rel=1e-12)
    with pytest.raises(bd.SettingError, match="shroud: expected"):
        bd.PeakTask(preload=300.0, frequency=band, shroud="tip")(study, None)


@pytest.mark.slow
def test_a_sweep_over_speed_has_the_load_of_the_damper():
    """Without a preload it is that of each speed; without a speed it is missing."""
    study = bd.Study(
        bd.reference_model("turbine_blade"), bd.Excitation("tip", amplitude=20.0), engine_order=5,
        harmonics=1, blade_modes=3,
    )  # fmt: skip
    task = bd.PeakTask(frequency=(600.0, 900.0), errors=False)
    swept = bd.sweep(study, {"speed": [850.0, 900.0]}, task)
    for i, speed in enumerate((850.0, 900.0)):
        at = study.at_speed(speed)
        expected = at.peak(at.preload, (600.0, 900.0), errors=False)
        assert swept.values[i]["amplitude"] == pytest.approx(expected.amplitude, rel=1e-9)
    with pytest.raises(bd.SettingError, match="preload: expected a number"):
        bd.sweep(study, {"friction_coefficient": [0.2]}, task)
