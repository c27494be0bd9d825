"""Reading files of other programs: one registry of readers, and what they share.

A reader is a function of a path under :func:`reader`, which turns every failure in it into one ModelError that names the
file, what was expected of it and what was found; with endings of names, :func:`read_body` finds it by them.  Checks within
a file go through :func:`bdamper.model.fields.require` or, where there are lines, :meth:`Lines.require`.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from pathlib import Path, PureWindowsPath
from typing import Any, Concatenate, ParamSpec, TypeVar

import numpy as np

from bdamper.model.fields import require
from bdamper.util.errors import BdamperError, mismatch
from bdamper.util.storage import MOST_BYTES, FilePath

P = ParamSpec("P")
T = TypeVar("T")

BODIES: dict[str, Callable[[FilePath], Any]] = {}
"""Readers that return an FEBody, by the endings of the names of their files."""

# Exceptions that damaged input causes in parsers and libraries.  Programming errors of this package (AttributeError,
# NameError) pass unchanged; libraries that raise those too are read with ``library=True``.
_CAUSES: tuple[type[Exception], ...] = (OSError, EOFError, MemoryError, RecursionError, ValueError, LookupError, TypeError)
_CAUSES += (ArithmeticError, NotImplementedError, struct.error, zlib.error)

LARGEST_COUNT = MOST_BYTES // 8
"""Nodes, entries and so on beyond which a count in a file is taken for damage."""

MOST_INCLUDED, DEEPEST = 100, 5
"""Files that may be included in one file, in all and in each other."""


def reader(
    expected: str, *endings: str, library: bool = False
) -> Callable[[Callable[Concatenate[Path, P], T]], Callable[Concatenate[FilePath, P], T]]:
    """Decorate a function that reads one kind of file: failures become a ModelError.

    Parameters
    ----------
    expected : str
        What the file should be, for the message.
    endings : str
        If given, the function returns an :class:`bdamper.importers.FEBody` and reads files whose names end so.
    library : bool
        Whether a foreign library reads: then every exception is turned.
    """

    def decorate(function: Callable[Concatenate[Path, P], T]) -> Callable[Concatenate[FilePath, P], T]:
        @wraps(function)
        def read(path: FilePath, *args: P.args, **keywords: P.kwargs) -> T:
            source = Path(path)
            if not source.is_file():
                raise FileNotFoundError(f"there is no file '{source}'")
            try:
                with np.errstate(all="ignore"):  # on this thread; catch_warnings changes all
                    return function(source, *args, **keywords)
            except SystemExit as error:
                raise mismatch(str(source), expected, "the library ended the program") from error
            except Exception as error:
                if isinstance(error, BdamperError) or not (library or isinstance(error, _CAUSES)):
                    raise
                found = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
                raise mismatch(str(source), expected, found) from error

        BODIES.update(dict.fromkeys(endings, read))
        return read  # type: ignore[return-value]  # the path may be given by its name, too

    return decorate


def read_body(path: FilePath) -> Any:
    """A body from a file of any program: its reader follows from the ending of the name.

    Parameters
    ----------
    path : path-like
        ``.inp`` and ``.frd`` of CalculiX or Abaqus, ``.cdb`` and ``.rst`` of Ansys, ``.bdf``, ``.dat`` and ``.nas`` of
        Nastran, ``.unv`` and ``.uff``.

    Returns
    -------
    FEBody
        Nodes and what else the file has: elements, sets, modes.

    Raises
    ------
    FileNotFoundError, ModelError
    """
    ending = Path(path).suffix.lower()
    require(ending in BODIES, str(path), f"a name that ends in one of {sorted(BODIES)}", f"'{ending}'")
    return BODIES[ending](path)


def check_count(value: int, item: str, what: str, smallest: int = 0, largest: int = LARGEST_COUNT) -> int:
    """A count read from a file, if it can be one."""
    require(smallest <= value <= largest, item, f"{what} from {smallest} to {largest}", value)
    return int(value)


@contextmanager
def parsing(item: str, expected: str, found: object = None) -> Iterator[None]:
    """Turn what damaged data or numbers that do not fit raise in the block into the error for a thing.

    It says what was ``found``, a text, or otherwise what was raised.
    """
    try:
        yield
    except BdamperError:
        raise
    except (ValueError, IndexError, RuntimeError, ArithmeticError, np.linalg.LinAlgError, MemoryError) as error:
        raise mismatch(item, expected, error if found is None else f"'{str(found).strip()[:60]}'") from error


def data_lines(text: str, comments: str | tuple[str, ...]) -> list[tuple[int, str]]:
    """Lines of a text, with their numbers, that are neither empty nor comments."""
    lines = [(k, line.strip()) for k, line in enumerate(text.split("\n"), 1)]
    return [(k, line) for k, line in lines if line and not line.startswith(comments)]


class Included:
    """Files that a file includes: a bounded number, from its own folder or below."""

    def __init__(self) -> None:
        self._count = 0

    def path(self, name: str, source: Path, depth: int, item: str) -> Path:
        """Find a file that ``source`` includes.

        Parameters
        ----------
        name : str
        source : Path
        depth : int
            Number of files that include each other down to ``source``.
        item : str
            Name of the line in messages.

        Raises
        ------
        ModelError
        """
        self._count += 1
        limits = f"at most {MOST_INCLUDED} included files, {DEEPEST} in each other"
        require(self._count <= MOST_INCLUDED and depth < DEEPEST, item, limits, "more")
        relative = PureWindowsPath(name)  # takes both kinds of slashes
        below = not relative.anchor and ".." not in relative.parts
        require(below, item, "a file in the folder of this one or below", f"'{name[:60]}'")
        path = source.parent / relative.as_posix()
        require(path.is_file(), item, "an existing file", f"'{name[:60]}'")
        return path


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
        require(self._read < len(self._lines), str(self.source), what, "the end of the file")
        self._read += 1
        return self._lines[self._read - 1]

    def follows(self, *starts: str) -> bool:
        """Whether there is a next line, and it starts with one of these texts."""
        return self._read < len(self._lines) and self._lines[self._read].startswith(starts)

    @property
    def item(self) -> str:
        """How messages name the line that was read last."""
        return f"{self.source}: line {self._read}"

    def require(self, good: object, expected: str, found: object) -> None:
        """Raise the error for the line that was read last unless it is good."""
        require(good, self.item, expected, found)
