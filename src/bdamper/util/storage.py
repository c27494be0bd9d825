"""Result files.

A result is a frozen dataclass that derives from :class:`Storable` with the name of its format.  Its fields are written to
an HDF5 file: arrays as datasets, mappings of arrays and nested results as groups, all other values as JSON.  A field that
is None is omitted.  :func:`load` reads every format and converts the values to the annotated types of the fields.  A file
contains the versions of bdamper, NumPy and SciPy that computed the result.

:class:`ResultsFile` stores the finished parts of long work, so that interrupted work can continue.  Each part (a point of a
sweep, a peak of an optimal curve) is appended as a line of JSON and forced to disk.  A killed process leaves at most an
incomplete last line, which the next run removes.  The first line identifies the problem and its settings.  A file of other
work, or of another version of bdamper, is rejected.
"""

from __future__ import annotations

import json
import os
import secrets
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import InitVar, asdict, dataclass, field, fields, is_dataclass
from functools import partial
from importlib import metadata
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, ClassVar, Union, get_args, get_origin, get_type_hints

import h5py
import numpy as np

from bdamper.util.errors import BdamperError, SettingError, one_line, warn
from bdamper.util.formatting import truncate

# ---- Versions ----


@dataclass(frozen=True)
class Versions:
    """Versions of bdamper, NumPy and SciPy.

    Parameters
    ----------
    bdamper, numpy, scipy : str
    """

    bdamper: str = "unknown"
    numpy: str = "unknown"
    scipy: str = "unknown"

    @classmethod
    def stored(cls, attributes: Mapping[str, Any]) -> Versions:
        """Return the versions in the attributes of a file."""
        names = {name: attributes.get(f"{name}_version") for name in asdict(cls())}
        return cls(**{name: str(value) for name, value in names.items() if value is not None})

    def attributes(self) -> dict[str, str]:
        """Return the versions as attributes of a file."""
        return {f"{name}_version": version for name, version in asdict(self).items()}

    def __str__(self) -> str:
        return f"bdamper {self.bdamper}, NumPy {self.numpy}, SciPy {self.scipy}"


INSTALLED = Versions(*(metadata.version(name) for name in ("bdamper", "numpy", "scipy")))
"""Versions in the running process."""


# ---- HDF5 files ----


FilePath = str | os.PathLike[str]

MOST_EXPANDED = 1100
"""Largest possible ratio of compression: deflate reaches 1032, a larger ratio indicates damage."""

MOST_BYTES = 1_600_000_000
"""Largest size of all arrays in a file (bytes); a larger size indicates damage, unless the file is as large."""
MOST_TEXT = 2**28
"""Largest size of texts, attributes and names in a file (bytes)."""

_READERS: dict[str, Callable[[FilePath], Any]] = {}
"""Function that reads a file, by the attribute ``format``."""


def register_reader(kind: str, read: Callable[[FilePath], Any]) -> None:
    """Let :func:`load` read files of a format with a function of the path."""
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
        kind, made_with = _text(file.attrs.get("format", "none")), Versions.stored(file.attrs)
    if kind not in _READERS:
        since = f", written by {made_with}, which this version cannot read" if kind.startswith("bdamper-") else ""
        raise BdamperError(f"{path}: expected a file written by bdamper, found the format '{kind}'{since}")
    return _READERS[kind](path)


@dataclass(frozen=True)
class Storable:
    """Mixin of frozen dataclasses that can be saved and read by :func:`load`.

    Parameters of the class
    -----------------------
    kind : str
        Name of the format.
    version : int
        Version of the format.
    """

    _format: ClassVar[tuple[str, int]]
    made_with: Versions = field(default=INSTALLED, kw_only=True, repr=False, compare=False)
    """Versions of bdamper, NumPy and SciPy that computed the result."""

    def __init_subclass__(cls, *, kind: str = "", version: int = 2, **options: Any) -> None:
        super().__init_subclass__(**options)
        if kind:  # a derived class keeps the format of its base class
            cls._format = kind, version
            register_reader(kind, partial(_read, cls, version))

    def save(self, path: FilePath) -> None:
        """Write the result to an HDF5 file, which :func:`bdamper.load` reads.

        Raises
        ------
        BdamperError
            If the file cannot be written.
        """
        with write_hdf5(path) as file:
            file.attrs["format"], file.attrs["version"] = self._format
            _put(file, self)

    def check_rows(self) -> None:
        """Raise ValueError if fields of the same dimension differ in length, as in a damaged file."""


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


def check_folder(path: FilePath) -> None:
    """Raise BdamperError if the folder of a path does not exist or the path is a folder."""
    folder = Path(path).resolve().parent
    if not folder.is_dir():
        raise BdamperError(f"{path}: expected a folder that exists, found no '{folder}'")
    if Path(path).is_dir():
        raise BdamperError(f"{path}: expected a file that can be written, found a folder")


def check_regular(path: FilePath) -> None:
    """Raise BdamperError as :func:`check_folder`, and for a device or a pipe."""
    check_folder(path)
    if Path(path).exists() and not Path(path).is_file():
        raise BdamperError(f"{path}: expected a regular file, found a device or a pipe")


@contextmanager
def file_errors(path: object) -> Iterator[None]:
    """Convert an OSError while a file is written into a BdamperError that names the file."""
    try:
        yield
    except OSError as error:
        raise BdamperError(f"{path}: expected a file that can be written, found {one_line(error)}") from error


@contextmanager
def write_hdf5(path: FilePath, **options: Any) -> Iterator[h5py.File]:
    """Open a new HDF5 file, which replaces an existing file in a single step when the context ends.

    The content is built in memory, because HDF5 cannot close a file on a full disk and may abort the process.

    Raises
    ------
    BdamperError
        If the file cannot be written.
    """
    check_regular(path)
    target = Path(path)
    with h5py.File(target.name, "w", driver="core", backing_store=False, block_size=1 << 20, **options) as file:
        yield file
        file.flush()
        content = file.id.get_file_image()
    temporary = target.with_name(f".{target.name}.{secrets.token_hex(6)}.tmp")
    try:
        with file_errors(path):
            temporary.write_bytes(content)
            os.replace(temporary, target)
    finally:
        temporary.unlink(missing_ok=True)


@contextmanager
def read_hdf5(path: FilePath, expected: str, kind: type[BdamperError] = BdamperError) -> Iterator[h5py.File]:
    """Open an HDF5 file for reading; raise one error of type ``kind`` if it is damaged or not HDF5."""
    if Path(path).is_dir():
        raise kind(f"{path}: expected {expected}, found a folder")
    if not Path(path).is_file():
        raise FileNotFoundError(f"there is no file '{path}'")
    try:
        with h5py.File(path, "r") as file:
            _check_bytes(file, Path(path).stat().st_size)
            yield file
    except BdamperError:
        raise
    except Exception as error:  # a damaged file can make HDF5 and h5py raise almost anything
        found = one_line(error) or type(error).__name__
        raise kind(f"{path}: expected {expected}, found something else ({found})") from error


def _check_bytes(file: h5py.File, size: int) -> None:
    """Reject a file that would expand to too much memory, such as compressed zeros or a text of gigabytes."""
    found: list[tuple[int, int]] = []

    def add(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset):
            found.append((item.nbytes, item.id.get_storage_size()))

    file.visititems(add)
    arrays, stored = (sum(column) for column in zip(*found)) if found else (0, 0)
    if arrays > max(MOST_BYTES, 4 * size):
        raise ValueError(f"arrays of {arrays} bytes in {size} bytes")
    if size - stored > MOST_TEXT:
        raise ValueError(f"{size - stored} bytes of texts and attributes, more than {MOST_TEXT}")


def _read(cls: type[Storable], version: int, path: FilePath) -> Storable:
    with read_hdf5(path, f"a file written by {cls.__name__}.save") as file:
        made_with = Versions.stored(file.attrs)
        if (own := file.attrs["version"]) != version:
            expected = f"version {version} of the format '{_text(file.attrs['format'])}'"
            raise BdamperError(f"{path}: expected {expected}, found version {own}, written by {made_with}")
        try:
            return _take(cls, file, made_with)
        except SettingError as error:  # missing or invalid fields
            raise ValueError(str(error)) from error


def _text(value: Any) -> str:
    return value.decode(errors="replace") if isinstance(value, bytes) else str(value)


# ---- Fields ----


def _leaf(hint: Any) -> Any:
    """Return the type of the items of a field: ``Cost`` of ``tuple[Cost, ...]``, ``Fold`` of ``Fold | None``."""
    inner = [kind for kind in get_args(hint) if kind not in (NoneType, Ellipsis)]
    return inner[0] if len(inner) == 1 and get_origin(hint) is not dict else hint


def _is_stored(kind: Any) -> bool:
    return isinstance(kind, type) and issubclass(kind, Storable)


def _put(group: h5py.Group, result: Any) -> None:
    """Write the fields and the versions of a result."""
    group.attrs.update(result.made_with.attributes())
    hints = get_type_hints(type(result))
    for name in (f.name for f in fields(result) if f.name != "made_with"):
        value, leaf = getattr(result, name), _leaf(hints[name])
        if value is None:
            continue
        if isinstance(value, np.ndarray):
            group[name] = value
        elif _is_stored(leaf):
            for i, item in enumerate(value):
                _put(group.create_group(f"{name}/{i}"), item)
        elif isinstance(value, dict) and any(isinstance(item, np.ndarray) for item in value.values()):
            part = group.create_group(name, track_order=True)
            for key, item in value.items():
                part[key] = item
        else:
            if is_dataclass(leaf):
                value = [asdict(item) for item in value] if isinstance(value, tuple) else asdict(value)
            group[name] = json.dumps(value, default=to_json)


def _take(cls: Any, group: h5py.Group, made_with: Versions) -> Any:
    """Read a result from the fields in a group; ``made_with`` is used if the group has no versions."""
    hints = get_type_hints(cls)
    made_with = Versions.stored(group.attrs) if "bdamper_version" in group.attrs else made_with
    found: dict[str, Any] = {"made_with": made_with}
    for name in (f.name for f in fields(cls) if f.name not in found):
        leaf, item = _leaf(hints[name]), group.get(name)
        if isinstance(item, h5py.Group):
            if _is_stored(leaf):
                found[name] = tuple(_take(leaf, item[key], made_with) for key in sorted(item, key=int))
            else:
                found[name] = {key: part[()] for key, part in item.items()}
        elif item is not None:
            text = h5py.check_string_dtype(item.dtype) is not None
            found[name] = from_json(hints[name], json.loads(item[()])) if text else item[()]
    made = cls(**found)
    made.check_rows()
    return made


def from_json(hint: object, value: object) -> Any:
    """Convert a value read from JSON to the annotated type of its field."""
    return _from_json(hint, value)


def _from_json(hint: Any, value: Any) -> Any:
    origin, inner = get_origin(hint), get_args(hint)
    if value is None or hint is Any or origin in (dict, Mapping):
        return value
    if origin is np.ndarray:
        return value["real"] + 1j * np.array(value["imag"]) if isinstance(value, Mapping) else np.array(value)
    if origin is tuple:
        kinds = inner[:1] * len(value) if inner[-1] is ... else inner
        return tuple(_from_json(kind, item) for kind, item in zip(kinds, value))
    if isinstance(hint, InitVar):
        return _from_json(hint.type, value)
    if NoneType in inner and _leaf(hint) is not hint:
        return _from_json(_leaf(hint), value)
    if is_dataclass(hint):
        hints = get_type_hints(hint)
        known = {name: _from_json(hints[name], item) for name, item in value.items() if name in hints}
        return hint(**known)  # type: ignore[operator]
    if origin in (Union, UnionType):  # such as int | tuple[int, ...]
        return tuple(value) if isinstance(value, list) else value
    if isinstance(hint, type) and issubclass(hint, tuple):  # named tuple
        return hint(*value)
    return hint(value)


def to_json(value: Any) -> Any:
    """Convert arrays and numbers of NumPy, mappings and small dataclasses for JSON."""
    if isinstance(value, np.ndarray):
        return {"real": value.real.tolist(), "imag": value.imag.tolist()} if np.iscomplexobj(value) else value.tolist()
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, Mapping):
        return dict(value)
    if is_dataclass(value) and not isinstance(value, type):
        return repr(value)
    raise TypeError(f"expected a number, a text, a list or a mapping, found {type(value).__name__}")


# ---- Finished parts of long work ----


class ResultsFile:
    """File with a line of JSON for each finished part, locked until it is closed.

    Parameters
    ----------
    path : path
    header : mapping
        Identification of the work, compared with the first line of an existing file.
    work : str
        Kind of work for errors: "sweep", "search for an optimal curve".

    Attributes
    ----------
    records : dict of (int or str) to mapping
        Finished parts by "index", a number or a name.

    Raises
    ------
    BdamperError
        If another run uses the file, the file belongs to other work, or it cannot be written.
    """

    def __init__(self, path: str | Path, header: Mapping[str, Any], work: str = "sweep") -> None:
        self.path = Path(path)
        self.header = dict(header)
        self.expected, self.work = f"a results file of a {work}", work
        self.records: dict[int | str, dict[str, Any]] = {}
        self.waiting = b""
        check_regular(self.path)
        with file_errors(self.path):
            self.file = os.open(self.path, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o666)
            try:
                self._lock()
                self._read()
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
            raise self._mismatch("a results file that no other run uses", "a locked file") from error

    def _mismatch(self, expected: str, found: str) -> BdamperError:
        return BdamperError(f"{self.path}: expected {expected}, found {found}")

    def _read(self) -> None:
        content = b""
        os.lseek(self.file, 0, os.SEEK_SET)
        while part := os.read(self.file, 1 << 20):
            content += part
        whole = content.rfind(b"\n") + 1
        lines = content[:whole].splitlines()
        if not lines:
            if content and not json_line(self.header).startswith(content[: len(json_line(self.header))]):
                raise self._mismatch(self.expected, "something else")
            os.ftruncate(self.file, 0)
            self._write(self.header)
            return
        try:
            found = json.loads(lines[0])
        except ValueError as error:
            raise self._mismatch(self.expected, "something else") from error
        self._compare(found)
        for number, line in enumerate(lines[1:], 2):
            try:
                record = json.loads(line)
                self.records[record["index"]] = record
            except (ValueError, KeyError, TypeError) as error:
                raise self._mismatch(f"one finished part in line {number}", repr(line[:60])) from error
        if whole < len(content):  # incomplete line of a killed run
            os.ftruncate(self.file, whole)

    def _compare(self, found: Any) -> None:
        if not isinstance(found, dict) or found.get("format") != self.header["format"]:
            raise self._mismatch(self.expected, "something else")
        version, stored = (Versions.stored(header).bdamper for header in (self.header, found))
        if version != stored:
            unusable = f"results of bdamper {stored}, which this version cannot continue"
            raise self._mismatch(f"results of bdamper {version}", unusable)
        for name, expected in json.loads(json_line(self.header)).items():
            if name not in INSTALLED.attributes() and found.get(name) != expected:
                values = f"{truncate(json.dumps(found.get(name)), 100)}, here {truncate(json.dumps(expected), 100)}"
                raise self._mismatch(f"results of this {self.work}", f"results of other settings: {name} is {values}")

    def _write(self, *records: Mapping[str, Any]) -> None:
        self.waiting += b"".join(map(json_line, records))
        while self.waiting:
            self.waiting = self.waiting[os.write(self.file, self.waiting) :]
        os.fsync(self.file)

    def append(self, record: dict[str, Any]) -> None:
        """Add a finished part and force it to disk.

        If the disk is full, warn and retry with the next part.
        """
        self.records[record["index"]] = record
        try:
            self._write(record)
        except OSError as error:
            warn(f"{self.path}: expected free disk space, found {one_line(error)}; finished parts remain in memory")

    def close(self) -> None:
        """Write parts that were delayed by a full disk, if possible, and close the file."""
        with suppress(OSError):
            self._write()
        os.close(self.file)


def json_line(record: Mapping[str, Any]) -> bytes:
    """Return a record as a line of JSON."""
    return json.dumps(record, default=to_json).encode() + b"\n"
