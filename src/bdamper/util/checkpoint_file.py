"""The file in which long work keeps what is finished, so that it can go on when it was interrupted.

Each finished part (a point of a sweep, a scan of an optimal curve) is appended at once, as one line of JSON, and forced to
disk; work that is killed leaves at most an incomplete last line, which the next run removes.  The first line identifies the
problem, the settings and the question: a file of other work, or of another version of the package, is refused.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from bdamper.util.errors import BdamperError, shortened
from bdamper.util.formatting import cut
from bdamper.util.storage import check_regular, plain, writing
from bdamper.util.versions import HERE, Versions
from bdamper.util.warn import say


class ResultsFile:
    """Lines of JSON, the first of which identifies the work.  It is locked until it is closed.

    Parameters
    ----------
    path : path
    header : mapping
        Compared with the first line of an existing file.
    work : str
        What the file belongs to: "sweep", "search for an optimal curve".

    Attributes
    ----------
    records : dict of (int or str) to mapping
        Finished parts by their "index", a number or a name.

    Raises
    ------
    BdamperError
        If another run uses the file, it is not one of this work, or no file can stand there.
    """

    def __init__(self, path: str | Path, header: Mapping[str, Any], work: str = "sweep") -> None:
        self.path = Path(path)
        self.header = dict(header)
        self.expected, self.work = f"a results file of a {work}", work
        self.records: dict[int | str, dict[str, Any]] = {}
        self.waiting = b""
        check_regular(self.path)
        with writing(self.path):
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
        except ImportError:  # no locks of this kind on this system
            return
        try:
            fcntl.flock(self.file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise self._refused("a results file of its own", "one that another run uses") from error

    def _refused(self, expected: str, found: str) -> BdamperError:
        return BdamperError(f"{self.path}: expected {expected}, found {found}")

    def _read(self) -> None:
        content = b""
        os.lseek(self.file, 0, os.SEEK_SET)
        while part := os.read(self.file, 1 << 20):
            content += part
        whole = content.rfind(b"\n") + 1
        lines = content[:whole].splitlines()
        if not lines:
            if content and not as_line(self.header).startswith(content[: len(as_line(self.header))]):
                raise self._refused(self.expected, "something else")
            os.ftruncate(self.file, 0)
            self._write(self.header)
            return
        try:
            found = json.loads(lines[0])
        except ValueError as error:
            raise self._refused(self.expected, "something else") from error
        self._compare(found)
        for number, line in enumerate(lines[1:], 2):
            try:
                record = json.loads(line)
                self.records[record["index"]] = record
            except (ValueError, KeyError, TypeError) as error:
                raise self._refused(f"one finished part in line {number}", repr(line[:60])) from error
        if whole < len(content):  # incomplete, since the run that wrote it was killed
            os.ftruncate(self.file, whole)

    def _compare(self, found: Any) -> None:
        if not isinstance(found, dict) or found.get("format") != self.header["format"]:
            raise self._refused(self.expected, "something else")
        own, other = (Versions.stored(header).bdamper for header in (self.header, found))
        if own != other:
            those = f"those of bdamper {other}, which this version cannot continue"
            raise self._refused(f"results of bdamper {own}", those)
        for name, expected in json.loads(as_line(self.header)).items():
            if name not in HERE.attributes() and found.get(name) != expected:
                values = f"{cut(json.dumps(found.get(name)), 100)}, here {cut(json.dumps(expected), 100)}"
                raise self._refused(f"results of this {self.work}", f"those of another one: {name} is {values}")

    def _write(self, *records: Mapping[str, Any]) -> None:
        self.waiting += b"".join(map(as_line, records))
        while self.waiting:
            self.waiting = self.waiting[os.write(self.file, self.waiting) :]
        os.fsync(self.file)

    def append(self, record: dict[str, Any]) -> None:
        """Add a finished part and force it to disk; if the disk is full, warn, and write it with the next part."""
        self.records[record["index"]] = record
        try:
            self._write(record)
        except OSError as error:
            say(f"{self.path}: expected room for results, found {shortened(error)}; finished results wait in memory")

    def close(self) -> None:
        """Write parts that wait for room on the disk, if there is some, and close the file."""
        with suppress(OSError):
            self._write()
        os.close(self.file)


def as_line(record: Mapping[str, Any]) -> bytes:
    """One record as a line of JSON."""
    return json.dumps(record, default=plain).encode() + b"\n"
