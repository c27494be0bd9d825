"""Result files.

A result is a frozen dataclass that derives from :class:`Storable` with the name of its format.  An
HDF5 file contains its fields (:mod:`bdamper.util.records`) and the versions of bdamper, NumPy and
SciPy that computed it.  :func:`load` reads every format.

:class:`ResultsFile` stores the finished parts of a long computation, which can continue from them
after an interruption.  Each part (a point of a sweep, a peak of an optimal curve, a check of its
optimum) is appended as a line of JSON; once a second all lines are forced to disk.  A killed
process leaves at most an incomplete last line, which the next run removes; a power failure loses at
most the last second.  :class:`FinishedParts` reads and appends them.
The first line identifies the problem and its settings.  A file of another computation or version
of bdamper is rejected.
"""

from __future__ import annotations

import json
import math
import mmap
import os
import secrets
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, field
from functools import partial
from importlib import import_module, metadata
from pathlib import Path
from threading import Lock
from typing import Any, ClassVar, Self, TypeVar
from weakref import WeakSet

import h5py

from bdamper.util import validation
from bdamper.util.errors import BdamperError, TooLittleMemory, one_line, too_little_memory, warn
from bdamper.util.formatting import truncate
from bdamper.util.records import (
    Record,
    from_json,
    read_attribute,
    read_record,
    subgroup,
    to_json,
    write_record,
    write_text,
)

T = TypeVar("T")

# ---- Versions ----


@dataclass(frozen=True)
class Versions(Record):
    """Versions of bdamper, NumPy and SciPy.

    Parameters
    ----------
    bdamper, numpy, scipy : str
    """

    bdamper: str = "unknown"
    numpy: str = "unknown"
    scipy: str = "unknown"

    def attributes(self) -> dict[str, str]:
        """Return the versions under their names in the headers of files."""
        return {f"{name}_version": version for name, version in asdict(self).items()}

    def __str__(self) -> str:
        return f"bdamper {self.bdamper}, NumPy {self.numpy}, SciPy {self.scipy}"


INSTALLED = Versions(*(metadata.version(name) for name in ("bdamper", "numpy", "scipy")))
"""Versions in the running process."""


# ---- HDF5 files ----


FilePath = str | os.PathLike[str]

VERSION = 4
"""Version of the format of all results."""
OLDEST = 3
"""Oldest version that can be read (:meth:`Storable.with_present_names`)."""
MOST_BYTES = 1_600_000_000
"""Largest size of all arrays in a file (bytes); a larger size indicates damage, unless the file is
as large.
"""
OF_HDF5 = 2**22
"""Memory that HDF5 needs beside the arrays of a file (bytes)."""
MOST_TEXT = 2**28
"""Largest size of texts, attributes and names in a file (bytes)."""

FORMATS = {
    "bdamper-accuracy": "bdamper.analyses.accuracy",
    "bdamper-campbell": "bdamper.analyses.campbell",
    "bdamper-comparison": "bdamper.analyses.sweep",
    "bdamper-crossings": "bdamper.analyses.crossings",
    "bdamper-curve": "bdamper.response.response_curve_result",
    "bdamper-damper-variation": "bdamper.mistuning.mistuning",
    "bdamper-effect-significance": "bdamper.analyses.effect_significance",
    "bdamper-fit": "bdamper.analyses.fit_result",
    "bdamper-excitation-curve": "bdamper.analyses.excitation_curve",
    "bdamper-flutter": "bdamper.analyses.flutter",
    "bdamper-hysteresis": "bdamper.analyses.hysteresis",
    "bdamper-margin-curve": "bdamper.fatigue.margin",
    "bdamper-margins": "bdamper.fatigue.margin",
    "bdamper-measurement": "bdamper.importers.measurements",
    "bdamper-mistuning": "bdamper.mistuning.mistuning",
    "bdamper-model": "bdamper.model.model_file",
    "bdamper-motion-in-time": "bdamper.response.verification",
    "bdamper-nonlinear-mode": "bdamper.analyses.nonlinear_mode",
    "bdamper-optimal": "bdamper.response.optimal_curve_result",
    "bdamper-optimal-curve-uncertainty": "bdamper.analyses.robust_optimum",
    "bdamper-peak": "bdamper.response.peak",
    "bdamper-refinement": "bdamper.analyses.refinement",
    "bdamper-static": "bdamper.contact.preload_state",
    "bdamper-stress": "bdamper.fatigue.stress_cycle",
    "bdamper-study": "bdamper.study",
    "bdamper-sweep": "bdamper.analyses.sweep",
    "bdamper-time-response": "bdamper.response.verification",
    "bdamper-time-sweep": "bdamper.time_domain.frequency_sweep",
    "bdamper-wheel-peak": "bdamper.mistuning.peak",
    "bdamper-wheel-sample": "bdamper.mistuning.sample",
}
"""Module that registers the reader of a format; :func:`load` imports no other one."""

_READERS: dict[str, Callable[[FilePath], Any]] = {}
"""Function that reads a file, by the attribute ``format``."""


def register_reader(kind: str, read: Callable[[FilePath], Any]) -> None:
    """Register a function that reads files of a format; :func:`load` calls it with the path."""
    _READERS[kind] = read


def load(path: FilePath) -> Any:
    """Read a result or a model from a file.

    Parameters
    ----------
    path : path-like

    Returns
    -------
    ResponseCurve, OptimalCurve, SweepResult, Model, ...
        Saved object; ``made_with`` of a result contains the versions that computed it.

    Raises
    ------
    FileNotFoundError
        If the file does not exist.
    BdamperError
        If the file is damaged, not a file of bdamper, or of a version that cannot be read.
    """
    with read_hdf5(path, "a file written by bdamper") as file:
        kind = read_attribute(file, "format") if "format" in file.attrs else "none"
        origin = ""
        if kind.startswith("bdamper-"):
            origin = f", {_written_by(file)}, which this version cannot read"
    # the module of a format registers its reader
    if kind in FORMATS:
        import_module(FORMATS[kind])
    if kind not in _READERS:
        raise BdamperError(
            f"{path}: expected a file written by bdamper, found the format '{kind}'{origin}"
        )
    return _READERS[kind](path)


def _made_with(file: h5py.File) -> Versions | None:
    """Return the versions that wrote a file; None if they are unknown."""
    if "made_with" not in file:
        return None
    made_with: Versions = read_record(subgroup(file, "made_with"), Versions)
    return made_with


def _written_by(file: h5py.File) -> str:
    made_with = _made_with(file)
    if made_with is None:
        return "written by an unknown version of bdamper"
    return f"written by {made_with}"


@dataclass(frozen=True)
class Storable(Record):
    """Mixin of frozen dataclasses that can be saved and read by :func:`load`.

    Parameters of the class
    -----------------------
    kind : str
        Name of the format.
    """

    _format: ClassVar[str]
    made_with: Versions = field(default=INSTALLED, kw_only=True, repr=False, compare=False)
    """Versions of bdamper, NumPy and SciPy that computed the result."""

    def __init_subclass__(cls, *, kind: str = "", **options: Any) -> None:
        super().__init_subclass__(**options)
        if kind:  # a derived class keeps the format of its base class
            cls._format = kind
            register_reader(kind, partial(_read, cls))

    def save(self, path: FilePath) -> None:
        """Write the result to an HDF5 file, which :func:`bdamper.load` reads.

        Raises
        ------
        BdamperError
            If the file cannot be written.
        """
        with write_hdf5(path) as file:
            write_text(file, "format", self._format)
            file.attrs["version"] = VERSION
            write_record(file, self)

    def with_present_names(self) -> Self:
        """Return a result of an earlier version with the present names and meanings."""
        return self


@dataclass(frozen=True)
class Recorded:
    """Result that contains the settings and the model hash of its problem.

    Parameters
    ----------
    settings : mapping
        Settings of the problem and arguments of the analysis.
    model_hash : str
    """

    settings: dict[str, Any] = field(default_factory=dict, kw_only=True, repr=False)
    model_hash: str = field(default="", kw_only=True)


def as_path(path: FilePath) -> Path:
    """Return a path; raise SettingError if it is neither a string nor a path."""
    return Path(validation.instance("path", path, (str, os.PathLike), "the path of a file"))


def existing(path: FilePath, kind: type[BdamperError] = BdamperError) -> Path:
    """Return the path of a file or folder.

    Raises
    ------
    FileNotFoundError
        If it does not exist.
    BdamperError
        If it is a device or a pipe, which may be endless. The error has the type ``kind``.
    """
    file = as_path(path)
    if not file.exists():
        raise FileNotFoundError(f"there is no file '{path}'")
    if is_endless(file):
        raise kind(f"{path}: expected a regular file, found a device or a pipe")
    return file


def is_endless(path: Path) -> bool:
    """Return whether a path is a device or a named pipe.

    If ``/dev/stdin`` is a pipe, the answer is False, because such a pipe has a writer, which ends
    it.
    """
    real = path.resolve()
    return real.exists() and not (real.is_file() or real.is_dir())


def check_folder(path: FilePath) -> None:
    """Raise BdamperError if the folder of a path does not exist or the path is a folder."""
    folder = as_path(path).resolve().parent
    if not folder.is_dir():
        raise BdamperError(f"{path}: expected an existing folder, found no '{folder}'")
    if Path(path).is_dir():
        raise BdamperError(f"{path}: expected a file that can be written, found a folder")


def check_regular(path: FilePath) -> None:
    """Raise BdamperError unless a path is free or a regular file in an existing folder."""
    check_folder(path)
    if Path(path).exists() and not Path(path).is_file():
        raise BdamperError(f"{path}: expected a regular file, found a device or a pipe")


@contextmanager
def file_errors(path: object) -> Iterator[None]:
    """Convert an OSError while a file is written into a BdamperError that names the file."""
    try:
        yield
    except OSError as error:
        raise BdamperError(
            f"{path}: expected a file that can be written, found {one_line(error)}"
        ) from error


@contextmanager
def replacing(path: FilePath) -> Iterator[Path]:
    """Yield a temporary path, whose file replaces ``path`` in one step when the context ends.

    After an error, for example on a full disk, the former file remains.

    Raises
    ------
    BdamperError
        If the file cannot be written.
    """
    # a link stays a link
    target = Path(path).resolve()
    temporary = target.with_name(f".{target.name}.{secrets.token_hex(6)}.tmp")
    try:
        with file_errors(path):
            yield temporary
            os.replace(temporary, target)
    finally:
        # a read-only file system refuses this, even without a file
        with suppress(OSError):
            temporary.unlink()


@contextmanager
def write_hdf5(path: FilePath) -> Iterator[h5py.File]:
    """Open a new HDF5 file, which replaces an existing file in a single step when the context ends.

    The content is built in memory, because HDF5 cannot close a file on a full disk and may abort
    the process.

    Raises
    ------
    BdamperError
        If the file cannot be written.
    """
    check_regular(path)
    with h5py.File(
        Path(path).name,
        "w",
        driver="core",
        backing_store=False,
        block_size=1 << 20,
        track_order=True,
    ) as file:
        yield file
        file.flush()
        content = file.id.get_file_image()
    with replacing(path) as temporary:
        temporary.write_bytes(content)


@contextmanager
def read_hdf5(
    path: FilePath, expected: str, kind: type[BdamperError] = BdamperError
) -> Iterator[h5py.File]:
    """Open an HDF5 file for reading.

    Raise one error of type ``kind`` if it is damaged or not HDF5.
    """
    if existing(path, kind).is_dir():
        raise kind(f"{path}: expected {expected}, found a folder")
    size = Path(path).stat().st_size
    _require_memory(path, size)
    try:
        with h5py.File(path, "r") as file:
            _require_memory(path, _check_bytes(file, size))
            yield file
    except TooLittleMemory:
        raise
    except BdamperError as error:
        raise kind(str(error)) from error
    except MemoryError as error:
        raise too_little_memory(str(path), error) from error
    # a damaged file can make HDF5 and h5py raise almost anything
    except Exception as error:
        found = "an empty file"
        if size:
            reason = one_line(error) or type(error).__name__
            found = f"a damaged or different file ({reason})"
        raise kind(f"{path}: expected {expected}, found {found}") from error


def _require_memory(path: FilePath, size: int) -> None:
    """Raise TooLittleMemory unless ``size`` bytes are free, and some more for HDF5.

    Without memory HDF5 reports damage, or aborts the process.
    """
    try:
        mmap.mmap(-1, size + OF_HDF5).close()
    except (OSError, OverflowError) as error:
        raise too_little_memory(str(path), error) from error


def _check_bytes(file: h5py.File, size: int) -> int:
    """Return the bytes of all arrays of a file with ``size`` bytes.

    Reject a file that would expand to too much memory, such as compressed zeros or a text of
    gigabytes.
    """
    bytes_in_memory: list[int] = []
    bytes_in_file: list[int] = []

    def add(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset):
            bytes_in_memory.append(item.nbytes)
            bytes_in_file.append(item.id.get_storage_size())

    file.visititems(add)
    arrays = int(sum(bytes_in_memory))
    others = size - sum(bytes_in_file)
    if arrays > max(MOST_BYTES, 4 * size):
        raise ValueError(
            f"arrays that expand from {size} to {arrays} bytes, more than {max(MOST_BYTES, 4 * size)}"
        )
    if others > MOST_TEXT:
        raise ValueError(f"texts and attributes of {others} bytes, more than {MOST_TEXT}")
    return arrays


def _read(cls: type[Storable], path: FilePath) -> Any:
    with read_hdf5(path, f"a file written by {cls.__name__}.save") as file:
        version = read_attribute(file, "version", int)
        if not OLDEST <= version <= VERSION:
            expected = f"version {OLDEST} or {VERSION} of the format '{cls._format}'"
            found = f"version {version}, {_written_by(file)}"
            raise BdamperError(f"{path}: expected {expected}, found {found}; compute it again")
        try:
            result = read_record(file, cls)
            is_present = version == VERSION and result.made_with.bdamper == INSTALLED.bdamper
            return result if is_present else result.with_present_names()
        except MemoryError:
            raise
        # invalid fields, or those of another version of bdamper
        except Exception as error:
            reason = one_line(error) or type(error).__name__
            # an error that names the file and the faulty place in it is complete
            if reason.startswith(f"{file.filename}: "):
                raise BdamperError(f"{error} ({_written_by(file)})") from error
            made_with = _made_with(file)
            if made_with is not None and made_with.bdamper != INSTALLED.bdamper:
                raise BdamperError(
                    f"{path}: expected a file written by {cls.__name__}.save of bdamper "
                    f"{INSTALLED.bdamper}, found one {_written_by(file)} ({reason}); compute it again"
                ) from error
            raise ValueError(f"{_written_by(file)}: {reason}") from error


# ---- Finished parts of a long computation ----


class ResultsFile:
    """File with a line of JSON for each finished part, locked until it is closed.

    Parameters
    ----------
    path : path
    header : mapping
        Identification of the computation, compared with the first line of an existing file.
    work : str
        Name of the computation in error messages: "sweep", "search for an optimal curve".

    Raises
    ------
    BdamperError
        If another run uses the file, if it belongs to another computation, or if it cannot be
        written.
    """

    def __init__(self, path: str | Path, header: Mapping[str, Any], work: str = "sweep") -> None:
        self.path = Path(path)
        self.header = dict(header)
        self.work = work
        self.expected = f"a results file of a {work}"
        # lines that could not be written yet, and the time of the last forced write
        self.waiting = b""
        self.synced = -math.inf
        check_regular(self.path)
        with file_errors(self.path):
            self.file = os.open(self.path, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o666)
            try:
                self._lock()
                self._check()
                _OPEN.add(self)
            except BaseException:
                os.close(self.file)
                raise

    def _lock(self) -> None:
        try:
            import fcntl
        except ImportError:  # the system has no file locks
            return
        try:
            fcntl.flock(self.file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            expected = "a results file that no other run uses"
            raise self._mismatch(expected, "a locked file") from error

    def _mismatch(self, expected: str, found: str) -> BdamperError:
        return BdamperError(f"{self.path}: expected {expected}, found {found}")

    def _check(self) -> None:
        """Compare the header of an existing file, or write the header of a new file."""
        with open(self.path, "rb") as lines:
            first = lines.readline()
            complete_bytes = len(first) + sum(len(line) for line in lines if line.endswith(b"\n"))
        if not first.endswith(b"\n"):
            # a new file, or one of a run that was killed while it wrote the header
            if not json_line(self.header).startswith(first):
                raise self._mismatch(self.expected, "a file of a different kind")
            os.ftruncate(self.file, 0)
            self._write(json_line(self.header))
            return
        try:
            header = json.loads(first)
        except ValueError as error:
            raise self._mismatch(self.expected, "a file of a different kind") from error
        self._compare(header)
        # the last line of a killed run may be incomplete
        os.ftruncate(self.file, complete_bytes)

    def finished(self) -> Iterator[dict[str, Any]]:
        """Read the finished parts one after the other; "index" is the number or name of a part."""
        with open(self.path, "rb") as lines:
            next(lines)
            for number, line in enumerate(lines, 2):
                try:
                    record = from_line(line)
                    _ = record["index"]
                except (ValueError, KeyError, TypeError) as error:
                    expected = f"one finished part in line {number}"
                    raise self._mismatch(expected, repr(line[:60])) from error
                yield record

    def _compare(self, stored: Any) -> None:
        """Raise BdamperError if the stored header belongs to other work."""
        if not isinstance(stored, dict) or stored.get("format") != self.header["format"]:
            raise self._mismatch(self.expected, "a file of a different kind")
        version = self.header.get("bdamper_version")
        stored_version = stored.get("bdamper_version")
        if version != stored_version:
            unusable = f"results of bdamper {stored_version}, which this version cannot continue"
            raise self._mismatch(f"results of bdamper {version}", unusable)
        for name, value in json.loads(json_line(self.header)).items():
            # other versions of NumPy and SciPy may continue
            if name in INSTALLED.attributes() or stored.get(name) == value:
                continue
            stored_text = truncate(json.dumps(stored.get(name)), 100)
            text = truncate(json.dumps(value), 100)
            raise self._mismatch(
                f"results of this {self.work}",
                f"results of different settings: {name} is {stored_text}, here {text}",
            )

    def _write(self, *lines: bytes) -> None:
        self.waiting += b"".join(lines)
        while self.waiting:
            n_written = os.write(self.file, self.waiting)
            self.waiting = self.waiting[n_written:]
        # forcing takes 4 ms on a disk, as long as a small point
        if not lines or time.monotonic() > self.synced + 1.0:
            os.fsync(self.file)
            self.synced = time.monotonic()

    def append(self, *lines: bytes) -> None:
        """Add the lines (:func:`json_line`) of finished parts in one write.

        If the disk is full, warn and retry with the next parts.
        """
        try:
            self._write(*lines)
        except OSError as error:
            found = f"found {one_line(error)}; finished parts remain in memory"
            warn(f"{self.path}: expected free disk space, {found}")

    def close(self) -> None:
        """Write the parts that could not be written to a full disk, if possible, and close the
        file.
        """
        _OPEN.discard(self)
        with suppress(OSError):
            self._write()
        os.close(self.file)


_OPEN: WeakSet[ResultsFile] = WeakSet()
"""Open results files.  A forked worker closes them; otherwise it would keep the file of a killed
parent locked.
"""


def _close_open() -> None:
    for file in _OPEN:
        os.close(file.file)


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_close_open)


class FinishedParts:
    """Finished parts of a computation by their names; with a results file, which stores them, also
    those of an earlier run.

    Parameters
    ----------
    file : ResultsFile, optional

    Attributes
    ----------
    records : dict
        Records of the file as it was opened, by the name of the part.
    """

    def __init__(self, file: ResultsFile | None = None) -> None:
        self.file = file
        self.lock = Lock()
        self.records: dict[int | str, dict[str, Any]] = {}
        if file is not None:
            self.records = {record["index"]: record for record in file.finished()}

    def store(self, record: Mapping[str, Any]) -> None:
        """Store the record of a finished part, with its name as "index"; any thread may do it."""
        if self.file is None:
            return
        line = json_line(record)
        with self.lock:
            self.file.append(line)

    def once(self, name: str, kind: type[T], compute: Callable[[], T]) -> T:
        """Return a part, a dataclass of this kind, from the file, or compute and store it.

        A part that fails or is interrupted is not stored.
        """
        if name in self.records:
            part: T = from_json(kind, self.records[name]["part"])
            return part
        part = compute()
        if self.file is not None:
            self.store({"index": name, "part": asdict(part)})  # type: ignore[call-overload]
        return part


def json_line(record: Mapping[str, Any]) -> bytes:
    """Return a record as a line of JSON."""
    return json.dumps(record, default=to_json).encode() + b"\n"


def from_line(line: bytes) -> dict[str, Any]:
    """Return the record of a line of JSON; equal keys of all records share their memory."""

    def with_shared_keys(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        return {sys.intern(key): value for key, value in pairs}

    record: dict[str, Any] = json.loads(line, object_pairs_hook=with_shared_keys)
    return record
