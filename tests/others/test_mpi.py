"""Sweeps on ``mpi4py.futures`` with one worker, as the how-to starts them (make others)."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("mpi4py", reason="mpi4py is not installed (make others)")
MPIEXEC = shutil.which("mpiexec", path=str(Path(sys.executable).parent)) or shutil.which("mpiexec")
if MPIEXEC is None:
    pytest.skip("there is no mpiexec (make others)", allow_module_level=True)

SCRIPT = """
import json
from mpi4py.futures import MPIPoolExecutor
import bdamper as bd
from tests.analyses.test_executors import pressed, question

if __name__ == "__main__":
    over = {"preload": [float(p) for p in range(1, 101)]}
    with MPIPoolExecutor() as pool:
        result = bd.sweep(pressed(), over, question, executor=pool, resume="r.jsonl")
        print(json.dumps([pool.num_workers, result.status, result.array("value").tolist()]))
"""


def test_a_sweep_on_one_worker(tmp_path, monkeypatch):
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[2]))
    (tmp_path / "sweep_mpi.py").write_text(SCRIPT)
    command = [MPIEXEC, "-n", "2", sys.executable, "-m", "mpi4py.futures", "sweep_mpi.py"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout) == [1, ["complete"] * 100, [2.0 * p for p in range(1, 101)]]
    assert len((tmp_path / "r.jsonl").read_text().splitlines()) == 101
