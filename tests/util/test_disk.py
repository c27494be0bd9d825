"""Disks without room, devices and pipes: one line, nothing lost, and what stood there before stays."""

import errno
import json
import os
import subprocess
import sys
import warnings
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

import bdamper as bd
from bdamper.fem import generated_models, reference_models
from bdamper.importers import (
    example_decks,
    load_measured,
    read_cdb,
    read_inp,
    read_mode,
    read_response,
)
from bdamper.plot import save_figure
from bdamper.response.optimal_curve import optimal_curve
from bdamper.util.errors import BdamperWarning

BAND = (0.1, 0.3)
NO_ROOM = r"^{}: expected a file that can be written, found \[Errno {}\] [^\n]*$"


def pressed():
    """Two masses with a contact that a preload closes."""
    contact = bd.Contact((1, 0), normal=1, kt=1.0, kn=1.0, mu=0.5)
    ways = {"contacts": [contact], "forces": {0: 0.1}, "load_per_preload": {1: 1.0}, "harmonics": 1}
    return bd.lumped([1.0, 0.1], [0.02, 0.02], [1.0, 0.1], **ways)


def question(study, preload):
    """An answer of some length, without work."""
    return {"value": 2.0 * preload, "text": "x" * 200}


@pytest.fixture
def full(tmp_path):
    """A folder on a file system of 16 kB that is full but for 4 kB."""
    disk = tmp_path / "disk"
    disk.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", "size=16k", "tmpfs", str(disk)]
    if (
        sys.platform != "linux"
        or os.geteuid()
        or subprocess.run(command, capture_output=True).returncode
    ):
        pytest.skip("no file system can be mounted: root and Linux are needed")
    try:
        (disk / "others").write_bytes(b"x" * 12288)
        yield disk
    finally:
        subprocess.run(["umount", str(disk)], check=True)


class Disk:
    """Stands in for ``os.write``: so many bytes fit on it, the last of them as a part of what is written."""

    def __init__(self, room):
        self.room, self.write = room, os.write

    def __call__(self, file, content):
        if not self.room:
            raise OSError(errno.ENOSPC, "No space left on device")
        written = self.write(file, content[: self.room])
        self.room -= written
        return written


# ---- files of results ----


SCRIPT = """
import resource, sys
import bdamper as bd
contact = bd.Contact((1, 0), normal=1, kt=1.0, kn=1.0, mu=0.5)
study = bd.lumped([1.0, 0.1], [0.02, 0.02], [1.0, 0.1], contacts=[contact], forces={0: 0.1}, load_per_preload={1: 1.0},
    harmonics=1)
curve = study.frequency_response(1.0, (0.1, 0.3))
resource.setrlimit(resource.RLIMIT_FSIZE, (8192, 8192))
for saved in (curve, study):
    try:
        saved.save(sys.argv[1])
    except bd.BdamperError as error:
        print(error)
"""


@pytest.mark.slow
def test_a_file_that_cannot_grow_is_one_line_and_leaves_the_former_one(tmp_path):
    """In a process of its own: HDF5 prints its errors as they come, and at the end of the process once more."""
    pytest.importorskip("resource", reason="no limits of this kind on this system")
    path = tmp_path / "curve.h5"
    path.write_bytes(b"former")
    done = subprocess.run([sys.executable, "-c", SCRIPT, str(path)], capture_output=True, text=True)
    assert done.returncode == 0 and not done.stderr
    too_large = f"{path}: expected a file that can be written, found [Errno {errno.EFBIG}] "
    assert done.stdout.startswith(too_large) and done.stdout.count("\n") <= 2
    assert path.read_bytes() == b"former" and [item.name for item in tmp_path.iterdir()] == [
        "curve.h5"
    ]


def test_every_writer_on_a_full_disk(full):
    study = pressed()
    curve = study.frequency_response(1.0, BAND)
    writers = {
        "curve.h5": curve.save,
        "curve.csv": curve.to_csv,
        "curve.png": lambda path: save_figure(curve.plot(), path),
        "model.h5": lambda path: bd.save_model(study.model, path),
    }
    for name, write in writers.items():
        with pytest.raises(bd.BdamperError, match=NO_ROOM.format(full / name, errno.ENOSPC)):
            write(full / name)
        assert name.endswith(".png") or not (full / name).exists()
        (full / name).unlink(missing_ok=True)


def test_the_former_table_remains_if_the_disk_is_full(full):
    (full / "curve.csv").write_text("former")
    with pytest.raises(bd.BdamperError, match=NO_ROOM.format(full / "curve.csv", errno.ENOSPC)):
        pressed().frequency_response(1.0, BAND).to_csv(full / "curve.csv")
    assert (full / "curve.csv").read_text() == "former"
    assert sorted(item.name for item in full.iterdir()) == ["curve.csv", "others"]


def test_every_writer_on_a_read_only_file_system(full, monkeypatch):
    study = pressed()
    curve = study.frequency_response(1.0, BAND)
    subprocess.run(["mount", "-o", "remount,ro", str(full)], check=True)
    writers = {
        "curve.h5": curve.save,
        "curve.csv": curve.to_csv,
        "curve.png": lambda path: save_figure(curve.plot(), path),
        "model.h5": lambda path: bd.save_model(study.model, path),
        "sweep.jsonl": lambda path: bd.sweep(study, {"preload": [1.0]}, question, resume=path),
        "damper.dof": lambda path: example_decks("calculix", path.parent),
    }
    for name, write in writers.items():
        with pytest.raises(bd.BdamperError, match=NO_ROOM.format(full / name, errno.EROFS)):
            write(full / name)
    # a generated model is not lost if it cannot be stored
    monkeypatch.setattr(reference_models, "user_cache_path", lambda *_, **__: full / "cache")
    monkeypatch.setitem(
        generated_models.MAKERS, "bladed_disk", lambda points, progress: study.model
    )
    with pytest.warns(BdamperWarning, match="will be regenerated by the next process"):
        assert reference_models._kept("bladed_disk", 24) is study.model


def test_a_search_on_a_full_disk_is_finished(full):
    asked = {"preload": (0.5, 5.0), "n": 8, "frequency": BAND}
    whole = optimal_curve(pressed().problem, **asked)
    with pytest.warns(
        BdamperWarning, match=r"o\.jsonl: expected free disk space, found \[Errno 28\]"
    ):
        found = optimal_curve(pressed().problem, **asked, resume=full / "o.jsonl")
    np.testing.assert_array_equal(found.amplitude, whole.amplitude)
    assert found.optimum == whole.optimum
    (full / "others").unlink()
    lines = (full / "o.jsonl").read_text().splitlines()[1:]
    assert len(lines) < len(whole.curves), "the disk was full"


@pytest.mark.parametrize("parts", [0.3, 1.5, 3.0])
def test_a_sweep_without_room_keeps_all_results_and_writes_them_once_there_is(
    tmp_path, monkeypatch, parts
):
    over, path = {"preload": [float(k) for k in range(1, 9)]}, tmp_path / "sweep.jsonl"
    bd.sweep(pressed(), over, question, resume=tmp_path / "whole.jsonl")
    header, part = map(len, (tmp_path / "whole.jsonl").read_bytes().splitlines(keepends=True)[:2])
    room = header + int(parts * part)
    disk = Disk(room)
    monkeypatch.setattr(os, "write", disk)

    def freed(study, preload):
        if preload == 6.0 and again:
            disk.room = 10**6
        return question(study, preload)

    again = False
    with pytest.warns(
        BdamperWarning, match=r"sweep\.jsonl: expected free disk space, found \[Errno 28\]"
    ) as said:
        result = bd.sweep(pressed(), over, freed, resume=path)
    assert len({str(w.message) for w in said}) == 1
    assert result.complete and result.array("value").tolist() == [2.0 * p for p in over["preload"]]
    known = [
        json.loads(line)["index"]
        for line in path.read_bytes().splitlines(keepends=True)[1:]
        if line.endswith(b"\n")
    ]
    assert len(known) < len(result) and path.stat().st_size == room, "the disk was full"
    disk.room, again = 500, True
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        result = bd.sweep(pressed(), over, freed, resume=path)  # goes on from the part of a line
    assert result.complete and result.array("value").tolist() == [2.0 * p for p in over["preload"]]
    lines = [json.loads(line) for line in path.read_text().splitlines()[1:]]
    assert sorted(line["index"] for line in lines) == list(range(8))
    assert {line["index"]: line["values"]["value"] for line in lines} == {
        k: 2.0 * (k + 1.0) for k in range(8)
    }


def test_no_room_at_the_start_is_an_error(tmp_path, monkeypatch):
    asks = {
        "sweep.jsonl": lambda path: bd.sweep(pressed(), {"preload": [1.0]}, question, resume=path),
        "search.jsonl": lambda path: optimal_curve(
            pressed().problem, (0.5, 5.0), 3, frequency=BAND, resume=path
        ),
    }
    for name, ask in asks.items():
        monkeypatch.setattr(os, "write", Disk(100))
        with pytest.raises(bd.BdamperError, match=NO_ROOM.format(tmp_path / name, errno.ENOSPC)):
            ask(tmp_path / name)
        monkeypatch.undo()
        assert ask(tmp_path / name).complete, "the beginning of a line does no harm"


# ---- what is no file ----


DEVICE = """
import resource, sys, bdamper as bd
resource.setrlimit(resource.RLIMIT_AS, (4 * 1024**3,) * 2)
contact = bd.Contact(0, kt=1.0, mu=1.0, preload=1.0)
study = bd.lumped(1.0, 0.02, 1.0, contacts=[contact], forces={0: 1.0}, harmonics=1)
try:
    bd.sweep(study, {"damping_ratio": [0.01]}, print, resume=sys.argv[1])
except bd.BdamperError as error:
    print(error)
"""


@pytest.mark.slow
def test_a_device_is_not_read_without_end():
    if not Path("/dev/full").exists():
        pytest.skip("no /dev/full on this system")
    done = subprocess.run(
        [sys.executable, "-c", DEVICE, "/dev/full"], capture_output=True, text=True, timeout=60
    )
    assert done.stdout == "/dev/full: expected a regular file, found a device or a pipe\n", (
        done.stderr
    )


def test_a_pipe_is_left_alone(tmp_path):
    if not hasattr(os, "mkfifo"):
        pytest.skip("no pipes of this kind on this system")
    path = tmp_path / "pipe"
    os.mkfifo(path)
    curve = pressed().frequency_response(1.0, BAND)
    for write in (pressed().save, curve.save, curve.to_csv):
        with pytest.raises(
            bd.BdamperError, match=r"expected a regular file, found (a device or )?a pipe"
        ):
            write(path)
    assert path.is_fifo() and [item.name for item in tmp_path.iterdir()] == ["pipe"]


@pytest.mark.parametrize(
    ("name", "read"),
    [
        ("a.h5", bd.load), ("b.h5", bd.load_model), ("c.h5", lambda path: bd.load_study(path)), ("d.csv", read_response),
        ("e.csv", load_measured), ("f.csv", read_mode), ("g.inp", read_inp), ("h.cdb", read_cdb),
    ],
)  # fmt: skip
def test_a_pipe_is_not_read(tmp_path, name, read):
    """Nobody writes into it: reading would wait for ever."""
    if not hasattr(os, "mkfifo"):
        pytest.skip("no pipes of this kind on this system")
    os.mkfifo(tmp_path / name)
    with pytest.raises(bd.BdamperError, match="expected a regular file, found a device or a pipe"):
        read(tmp_path / name)


MEMORY = """
import resource, sys
import bdamper as bd
bd.load_model(sys.argv[2])  # imports what is needed
used = 4096 * int(open("/proc/self/statm").read().split()[0])
resource.setrlimit(resource.RLIMIT_AS, (used + 2**20,) * 2)
try:
    bd.load_model(sys.argv[1])
except bd.BdamperError as error:
    print(error)
"""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="no limits of this kind on this system")
def test_a_lack_of_memory_does_not_blame_the_file(tmp_path):
    path, small = tmp_path / "model.h5", tmp_path / "small.h5"
    bd.save_model(bd.reference_model("turbine_blade"), path)
    bd.save_model(pressed().model, small)
    command = [sys.executable, "-c", MEMORY, str(path), str(small)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert done.stdout.startswith(f"{path}: expected enough memory, found too little"), done
    assert done.stdout.count("\n") == 1


def without_memory(*_, **__):
    raise MemoryError


def test_a_lack_of_memory_at_one_point_keeps_the_others(monkeypatch):
    def greedy(study, preload):
        return without_memory() if preload == 2.0 else {"value": preload}

    found = bd.sweep(pressed(), {"preload": [1.0, 2.0, 3.0]}, greedy)
    assert found.status_text == ("complete", "failed: MemoryError", "complete")
    assert found.array("value")[[0, 2]].tolist() == [1.0, 3.0]


def test_a_lack_of_memory_names_what_was_called(monkeypatch):
    study = pressed()
    monkeypatch.setattr(type(study.problem), "static_states", property(without_memory))
    with pytest.raises(
        bd.BdamperError,
        match=r"^static: expected enough memory, found too little; close other programs",
    ) as caught:
        study.static(1.0)
    assert isinstance(caught.value, MemoryError)


def test_a_folder_without_permission(tmp_path, monkeypatch):
    def refuse(*_):
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr(os, "open", refuse)
    with pytest.raises(
        bd.BdamperError,
        match=r"r\.jsonl: expected a file that can be written, found .*Permission denied",
    ):
        bd.sweep(pressed(), {"preload": [1.0]}, question, resume=tmp_path / "r.jsonl")


def test_files_are_written_from_several_threads(tmp_path):
    curve = pressed().frequency_response(1.0, BAND)
    with ThreadPoolExecutor(4) as pool:
        list(pool.map(curve.save, [tmp_path / f"{k}.h5" for k in range(16)]))
    for k in range(16):
        np.testing.assert_array_equal(bd.load(tmp_path / f"{k}.h5").unknowns, curve.unknowns)
