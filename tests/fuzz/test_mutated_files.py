"""Damaged files: every reader answers with one of its own errors or with something valid, and soon.

Valid files are written once, then their bytes, lines and numbers are changed at random.  What a reader still accepts
goes on to build_model, or through the checks of a model.  The cases follow from their number alone, so a failure can be
repeated; ``BDAMPER_FUZZ`` sets how many there are (150 by default, 20,000 for ``make fuzz``).
"""

from __future__ import annotations

import os
import re
import shutil
import signal
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import scipy.io
import scipy.sparse as sp

pytest.importorskip("skfem", reason="scikit-fem is not installed (extra bdamper[fe])")

from bdamper.fem.meshes import ElasticMaterial, discretise, join_blocks, local_order
from bdamper.importers import (
    ContactFaces,
    FEBody,
    Measurement,
    Reduction,
    Sector,
    build_model,
    read_abaqus,
    read_ansys,
    read_arrays,
    read_calculix,
    read_cdb,
    read_frd,
    read_inp,
    read_matrix,
    read_measurements,
    read_nastran,
    read_op2,
    read_op4,
    read_rst,
)
from bdamper.importers.abaqus import read_frd_stress
from bdamper.model.model_file import load_model, save_model
from bdamper.model.validation import check_model
from bdamper.util.errors import BdamperError
from bdamper.util.storage import Versions, load
from tests.ansys_files import write_cdb, write_full, write_rst
from tests.importers.test_abaqus_parts import DIAGONAL, TWO
from tests.models import wedge_model
from tests.nastran_files import write_op2, write_op4

CASES = int(os.environ.get("BDAMPER_FUZZ", "150"))
LIMIT = 20.0
"""Seconds after which a case counts as a hang."""

NUMBERS = [b"0", b"-1", b"1", b"2147483648", b"99999999999999999999", b"1e308", b"-1e-320", b"nan"]
NUMBERS += [b"inf", b"1e5", b"7", b""]


# -----------------------------------------------------------------------------------------------------------
# Valid files


def bar():
    """A bar of two elements held at one end, its numbers and sets."""
    grid = np.stack(np.meshgrid([0.0, 0.1, 0.25], [0.3, 0.5], [0.0, 0.2], indexing="ij"), axis=-1)
    body = discretise(join_blocks([grid]), ElasticMaterial())
    numbers = 1 + np.arange(len(body.nodes))
    sets = {
        "HELD": numbers[body.nodes[:, 0] < 1e-9],
        "TOP": numbers[body.nodes[:, 1] > 0.5 - 1e-9],
    }
    return body, numbers, numbers[body.elements[:, local_order()]], sets


def deck(numbers, nodes, elements, sets):
    lines = [
        "*NODE, NSET=ALL",
        *(f"{n}, {x:.9g}, {y:.9g}, {z:.9g}" for n, (x, y, z) in zip(numbers, nodes)),
    ]
    lines.append("*ELEMENT, TYPE=C3D20, ELSET=BODY")
    for k, e in enumerate(elements.tolist()):
        lines += [f"{k + 1}, " + ", ".join(map(str, e[:12])) + ",", ", ".join(map(str, e[12:]))]
    for name, members in sets.items():
        lines += [f"*NSET, NSET={name}", ", ".join(map(str, members.tolist()))]
    return "\n".join([*lines, "*SURFACE, NAME=SIDE", "BODY, S1", ""])


def triplets(matrix):
    entries = sp.triu(matrix).tocoo()
    return "".join(
        f"{i + 1} {j + 1} {v:.13e}\n" for i, j, v in zip(entries.row, entries.col, entries.data)
    )


def frd(numbers, nodes, elements):
    lines = ["    1C", f"    2C{'':18}{len(numbers):12d}{'':37}1"]

    def block(values):
        return [
            f" -1{n:10d}" + "".join(f"{v:12.5E}" for v in x) for n, x in zip(numbers, values)
        ] + [" -3"]

    lines += [*block(nodes), f"    3C{'':18}{len(elements):12d}{'':37}1"]
    for k, e in enumerate(elements.tolist()):
        lines += [f" -1{k + 1:10d}{4:5d}{0:5d}{1:5d}"]
        lines += [" -2" + "".join(f"{n:10d}" for n in e[i : i + 10]) for i in (0, 10)]
    lines.append(" -3")
    rng = np.random.default_rng(0)
    for mode in (1, 2):
        lines += [
            "    1PHID                          1",
            f"    1PMODE                         {mode}",
        ]
        for name, n in (("DISP", 3), ("DISPI", 3), ("STRESS", 6), ("STRESSI", 6)):
            lines.append(
                f"  100CL  10{mode} {100.0 * mode:11.7f}{len(numbers):12d}{'':20}2{mode:5d}MODAL      1"
            )
            lines += [f" -4  {name:8s}    4    1", *(f" -5  D{i}" for i in range(1, n + 1))]
            lines += block(rng.standard_normal((len(numbers), n)))
    return "\n".join([*lines, " 9999", ""])


def unv():
    lines = ["    -1", "    58", *5 * ["NONE"]]
    lines += [f"{4:5d}{0:10d}{1:5d}{0:10d} {'NONE':10s}{3:10d}{1:4d} {'NONE':10s}{3:10d}{1:4d}"]
    lines += [
        "".join(f"{v:10d}" for v in (5, 4, 1)) + "".join(f"{v:13.5e}" for v in (10.0, 1.0, 0.0))
    ]
    lines += 4 * [f"{18:10d}{0:5d}{0:5d}{0:5d} {'NONE':20s} {'NONE':20s}"]
    lines += [
        "".join(f"{v:13.5e}" for v in (1.0, 2.0, 3.0, 4.0, 5.0, 6.0)),
        "".join(f"{v:13.5e}" for v in (7.0, 8.0)),
    ]
    return "\n".join([*lines, "    -1", ""])


def bulk(numbers, nodes, elements):
    lines = ["BEGIN BULK", "CORD2C,7,,0.,0.,0.,0.,0.,1.", ",1.,0.,0."]
    lines += [
        f"GRID,{n},,{x[0]:.6f},{x[1]:.6f},{x[2]:.6f},{7 if n == 3 else ''}"
        for n, x in zip(numbers, nodes)
    ]
    for k, e in enumerate(elements.tolist()):
        e = [*e[:12], *e[16:], *e[12:16]]
        parts = [",".join(map(str, part)) for part in (e[:6], e[6:14], e[14:])]
        lines += [f"CHEXA,{k + 1},1,{parts[0]}", f",{parts[1]}", f",{parts[2]}"]
    lines += ["PSOLID,1,1", "MAT1,1,2.1+11,,0.3,7850.", "SET1,5,10,THRU,12"]
    for name in ("KAAX", "MAAX"):
        lines += [
            f"DMIG,{name},0,6,2,0",
            f"DMIG,{name},10,1,,10,1,2.",
            ",11,1,-1.",
            f"DMIG,{name},11,1,,11,1,3.",
        ]
    return "\n".join([*lines, "ENDDATA", ""])


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """All valid files."""
    path = tmp_path_factory.mktemp("valid")
    body, numbers, elements, sets = bar()
    save_model(wedge_model(), path / "model.h5")
    made_with = Versions(
        "0.4.0", "2.4.6", "1.17.1"
    )  # cases are bytes of the files, which name versions
    Measurement("tip", np.linspace(1.0, 2.0, 9), np.ones(9) + 0j, made_with=made_with).save(
        path / "measured.h5"
    )
    k, m = body.stiffness, body.mass
    sp.save_npz(path / "k.npz", k)
    np.save(path / "k.npy", k.toarray())
    scipy.io.savemat(path / "k.mat", {"K": k})
    scipy.io.savemat(path / "z.mat", {"K": k}, do_compression=True)
    entries = sp.triu(k).tocoo()
    place = [f"{numbers[i // 3]},{i % 3 + 1}" for i in range(len(numbers) * 3)]
    for name, matrix in (("ka.mtx", k), ("ma.mtx", m)):
        entries = sp.triu(matrix).tocoo()
        text = "".join(
            f"{place[i]}, {place[j]}, {v:.12e}\n"
            for i, j, v in zip(entries.row, entries.col, entries.data)
        )
        (path / name).write_text(text)
    (path / "nodes.csv").write_text(
        "".join(f"{n},{x[0]},{x[1]},{x[2]}\n" for n, x in zip(numbers, body.nodes))
    )
    (path / "top.csv").write_text("\n".join(map(str, sets["TOP"])) + "\n")
    free = np.setdiff1d(
        np.arange(body.n_dof), (3 * (sets["HELD"][:, None] - 1) + np.arange(3)).ravel()
    )
    (path / "job.inp").write_text(deck(numbers, body.nodes, elements, sets))
    (path / "stage.inp").write_text(TWO)
    for kind in ("STIF1", "MASS1"):
        (path / f"stage_{kind}.mtx").write_text(DIAGONAL)
    (path / "job.dof").write_text("".join(f"{numbers[i // 3]}.{i % 3 + 1}\n" for i in free))
    (path / "job.sti").write_text(triplets(k[free][:, free]))
    (path / "job.mas").write_text(triplets(m[free][:, free]))
    (path / "job.frd").write_text(frd(numbers, body.nodes, elements))
    held = (3 * (sets["HELD"][:, None] - 1) + np.arange(3)).ravel()
    write_full(path / "a.full", k, m, numbers, fixed=held.tolist())
    write_cdb(path / "a.cdb", numbers, body.nodes, elements, sets)
    rng = np.random.default_rng(1)
    shapes = [(d, 100.0 + d, rng.standard_normal((len(numbers), 3))) for d in (0, 1, 1)]
    write_rst(path / "a.rst", numbers, body.nodes, elements, shapes, 6)
    (path / "a.unv").write_text(unv())
    write_op4(path / "a.op4", {"KGG": k})
    write_op4(path / "b.op4", {"KGG": k}, binary=True, form="wide")
    write_op2(path / "a.op2", numbers, rng.standard_normal((len(numbers), 3, 2)), [1, 2], [1, 1])
    (path / "a.bdf").write_text(bulk(numbers, body.nodes, elements))
    return path


# -----------------------------------------------------------------------------------------------------------
# Readers


def build(body: FEBody) -> None:
    """From what a reader took for valid to a model, held at HELD, rubbing on the ground at TOP."""
    if body.stiffness is None:
        return
    contact = [ContactFaces("top", "TOP", body_a="blade", body_b="ground", points=4)]
    held, four = Sector(n_blades=1, fixed="HELD"), Reduction(n_modes=4)
    check_model(
        build_model(body, contacts=contact, sector=held, reduction=four, locations={"x": 5}).model
    )


def arrays(p: Path) -> None:
    body = bar()[0]
    sets = {"TOP": p / "top.csv", "HELD": bar()[3]["HELD"]}
    elements = (bar()[2],)
    del body
    build(read_arrays(p / "ka.mtx", p / "ma.mtx", p / "nodes.csv", sets=sets, elements=elements))


def matrix(name: str) -> Callable[[Path], None]:
    def read(p: Path) -> None:
        k = read_matrix(p / name)
        body, numbers, elements, sets = bar()
        build(FEBody(numbers, body.nodes, k, body.mass, elements=(elements,), node_sets=sets))

    return read


READERS: list[tuple[str, Callable[[Path], object]]] = [
    ("model.h5", lambda p: check_model(load_model(p / "model.h5"))),
    ("measured.h5", lambda p: load(p / "measured.h5")),
    *((name, matrix(name)) for name in ("k.npz", "k.npy", "k.mat", "z.mat")),
    *((name, arrays) for name in ("ka.mtx", "ma.mtx", "nodes.csv", "top.csv")),
    *(
        (f"job.{e}", lambda p: build(read_calculix(p / "job")))
        for e in ("inp", "sti", "mas", "dof")
    ),
    ("job.inp", lambda p: read_inp(p / "job.inp")),
    *(
        (f"stage{end}", lambda p: read_abaqus(p / "stage", "I"))
        for end in (".inp", "_STIF1.mtx", "_MASS1.mtx")
    ),
    ("job.frd", lambda p: read_frd(p / "job.frd")),
    ("job.frd", lambda p: read_frd_stress(p / "job.frd")),
    ("a.full", lambda p: build(read_ansys(p / "a.full", p / "a.cdb"))),
    ("a.cdb", lambda p: build(read_ansys(p / "a.full", p / "a.cdb"))),
    ("a.cdb", lambda p: read_cdb(p / "a.cdb")),
    ("a.rst", lambda p: read_rst(p / "a.rst")),
    ("a.unv", lambda p: read_measurements(p / "a.unv")),
    ("a.op4", lambda p: read_op4(p / "a.op4")),
    ("b.op4", lambda p: read_op4(p / "b.op4")),
    ("a.op2", lambda p: read_op2(p / "a.op2")),
    ("a.bdf", lambda p: read_nastran(p / "a.bdf")),
]


# -----------------------------------------------------------------------------------------------------------
# Mutations


def flip_bytes(data: bytearray, rng: np.random.Generator) -> bytearray:
    for _ in range(int(rng.integers(1, 6))):
        data[int(rng.integers(len(data)))] = int(rng.integers(256))
    return data


def flip_bits(data: bytearray, rng: np.random.Generator) -> bytearray:
    for _ in range(int(rng.integers(1, 4))):
        data[int(rng.integers(len(data)))] ^= 1 << int(rng.integers(8))
    return data


def truncate(data: bytearray, rng: np.random.Generator) -> bytearray:
    return data[: int(rng.integers(len(data)))]


def remove(data: bytearray, rng: np.random.Generator) -> bytearray:
    start, length = int(rng.integers(len(data))), int(rng.integers(1, 200))
    return data[:start] + data[start + length :]


def repeat(data: bytearray, rng: np.random.Generator) -> bytearray:
    start, length = int(rng.integers(len(data))), int(rng.integers(1, 200))
    return data[:start] + data[start : start + length] + data[start:]


def words(data: bytearray, rng: np.random.Generator) -> bytearray:
    """Integers of 32 bits set to values that sizes and pointers do not have."""
    if len(data) < 8:
        return data
    at = 4 * int(rng.integers(len(data) // 4))
    value = [0, -1, 1, 2**31 - 1, -(2**31), len(data), 7][int(rng.integers(7))]
    data[at : at + 4] = np.int32(value).tobytes()
    return data


def numbers_in_text(data: bytearray, rng: np.random.Generator) -> bytearray:
    found = list(re.finditer(rb"[-+.\w]*\d[-+.\w]*", bytes(data)))
    for k in (
        sorted(set(rng.integers(len(found), size=int(rng.integers(1, 4))).tolist()), reverse=True)
        if found
        else []
    ):
        data[found[k].start() : found[k].end()] = NUMBERS[int(rng.integers(len(NUMBERS)))]
    return data


def lines_in_text(data: bytearray, rng: np.random.Generator) -> bytearray:
    lines = bytes(data).split(b"\n")
    i, j = (int(rng.integers(len(lines))) for _ in range(2))
    kind = int(rng.integers(3))
    if kind == 0:
        lines[i], lines[j] = lines[j], lines[i]
    elif kind == 1:
        lines.insert(i, lines[j])
    else:
        del lines[i : i + int(rng.integers(1, 5))]
    return bytearray(b"\n".join(lines))


MUTATIONS = [
    flip_bytes,
    flip_bits,
    truncate,
    remove,
    repeat,
    words,
    numbers_in_text,
    numbers_in_text,
    lines_in_text,
]


# -----------------------------------------------------------------------------------------------------------


class Hang(BaseException):
    """Raised by the alarm; no reader may catch it."""


def alarm(*_):
    raise Hang


def run(case: int, folder: Path, scratch: Path) -> str:
    """One case: "error" or "valid"; anything else is an exception."""
    rng = np.random.default_rng([20240, case])
    name, reader = READERS[case % len(READERS)]
    original = folder / name
    if not original.exists():
        return "absent"
    data = bytearray(original.read_bytes())
    for _ in range(1 + int(rng.integers(2))):
        data = MUTATIONS[int(rng.integers(len(MUTATIONS)))](data, rng) if data else data
    target = scratch / name
    target.write_bytes(bytes(data))
    signal.setitimer(signal.ITIMER_REAL, LIMIT)
    try:
        reader(scratch)
    except BdamperError as error:
        text = str(error)
        assert text, f"case {case}, {name}: an error without a message"
        assert "\n" not in text, f"case {case}, {name}: an error of several lines"
        return "error"
    except FileNotFoundError as error:
        if "there is no" not in str(error):
            raise
        return "error"
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        shutil.copy(original, target)
    return "valid"


@pytest.mark.slow
@pytest.mark.skipif(
    not hasattr(signal, "setitimer"), reason="needs an alarm of the operating system"
)
@pytest.mark.timeout(300 + CASES, method="thread")  # the alarm is its own
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("part", range(10))
def test_mutated_files(folder, part):
    """A tenth of all cases."""
    before = signal.signal(signal.SIGALRM, alarm)
    outcome = {"error": 0, "valid": 0, "absent": 0}
    try:
        with tempfile.TemporaryDirectory() as name:
            scratch = Path(name)
            for source in folder.iterdir():
                shutil.copy(source, scratch)
            for case in range(part, CASES, 10):
                try:
                    outcome[run(case, folder, scratch)] += 1
                except AssertionError:
                    raise
                except BaseException as error:
                    if isinstance(error, KeyboardInterrupt):
                        raise
                    reader = READERS[case % len(READERS)][0]
                    raise AssertionError(
                        f"case {case}, {reader}: {type(error).__name__}: {error}"
                    ) from error
    finally:
        signal.signal(signal.SIGALRM, before)
    assert outcome["error"] > 0
    if CASES >= 250:
        assert outcome["valid"] > 0  # mutations that only break everything would prove little


@pytest.mark.slow
def test_unchanged_files_are_valid(folder):
    """The seeds themselves are read, so that the cases start from something."""
    for name, reader in READERS:
        if (folder / name).exists() and not (name == "a.unv" and not _has("pyuff")):
            reader(folder)


def _has(module: str) -> bool:
    import importlib.util

    return importlib.util.find_spec(module) is not None
