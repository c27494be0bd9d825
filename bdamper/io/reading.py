"""Errors while a file of another program is read: all of them become one ModelError that names the file."""

from __future__ import annotations

import struct
import warnings
import zlib
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bdamper.util.errors import BdamperError, ModelError, mismatch
from bdamper.util.hdf5 import FilePath

# Exceptions that damaged input causes in parsers and libraries.  Programming errors of this package (AttributeError,
# NameError) pass unchanged; libraries that raise those too are read with ``library=True``.
_CAUSES = (
    OSError,
    ValueError,
    IndexError,
    KeyError,
    TypeError,
    OverflowError,
    MemoryError,
    EOFError,
    ArithmeticError,
    struct.error,
    zlib.error,
    RecursionError,
    NotImplementedError,
)

LARGEST_COUNT = 200_000_000
"""Nodes, entries and so on beyond which a count in a file is taken for damage."""

MOST_EXPANDED = 1100
"""Deflate cannot compress by more than a factor of 1032: what claims to be larger is damage."""


@contextmanager
def reading(path: FilePath, expected: str, library: bool = False) -> Iterator[Path]:
    """Turn failures in the block into a ModelError that names the file and what was expected of it.

    Parameters
    ----------
    path : path-like
    expected : str
        What the file should be, for the message.
    library : bool
        Whether a foreign library reads: then every exception is turned.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    ModelError
    """
    source = Path(path)
    if not source.is_file():
        raise FileNotFoundError(f"there is no file '{source}'")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield source
    except SystemExit as error:
        raise mismatch(str(source), expected, "the library ended the program") from error
    except Exception as error:
        if isinstance(error, BdamperError) or not (library or isinstance(error, _CAUSES)):
            raise
        found = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
        raise mismatch(str(source), expected, found) from error


def check_count(value: int, item: str, what: str, smallest: int = 0, largest: int = LARGEST_COUNT) -> int:
    """A count read from a file, if it can be one."""
    if not smallest <= value <= largest:
        raise mismatch(item, f"{what} from {smallest} to {largest}", value)
    return int(value)


class Lines:
    """The lines of a text file one after another, and errors that name the line that was read last."""

    def __init__(self, source: Path, encoding: str) -> None:
        self.source = source
        self._lines = source.read_text(encoding=encoding, errors="replace").splitlines()
        self._read = 0

    def __iter__(self) -> Iterator[str]:
        """The lines that are left; others may be taken by :meth:`take` in between."""
        while self._read < len(self._lines):
            yield self.take("another line")

    def take(self, what: str) -> str:
        """The next line, which is to hold ``what``."""
        if self._read == len(self._lines):
            raise mismatch(str(self.source), what, "the end of the file")
        self._read += 1
        return self._lines[self._read - 1]

    def follows(self, *starts: str) -> bool:
        """Whether there is a next line, and it starts with one of these texts."""
        return self._read < len(self._lines) and self._lines[self._read].startswith(starts)

    @property
    def item(self) -> str:
        """How messages name the line that was read last."""
        return f"{self.source}: line {self._read}"

    def error(self, expected: str, found: object) -> ModelError:
        """The error for the line that was read last."""
        return mismatch(self.item, expected, found)


def grouped(elements: Iterable[Sequence[int] | NDArray]) -> tuple[NDArray, ...]:
    """Solid elements, given one by one by their node numbers, as an array (n, n_nodes) for each number of nodes."""
    groups: dict[int, list[Sequence[int] | NDArray]] = {}
    for nodes in elements:
        groups.setdefault(len(nodes), []).append(nodes)
    return tuple(np.array(group, np.int64) for group in groups.values())
