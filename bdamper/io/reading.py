"""Errors while a file of another program is read: all of them become one ModelError that names the file."""

from __future__ import annotations

import os
import struct
import warnings
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from bdamper.util.errors import BdamperError, mismatch

# Exceptions that damaged input causes in parsers and libraries.  Programming errors of this package (AttributeError,
# NameError) pass unchanged; libraries that raise those too are read with ``library=True``.
_CAUSES = (
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


@contextmanager
def reading(path: str | os.PathLike[str], expected: str, library: bool = False) -> Iterator[Path]:
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
    except BdamperError:
        raise
    except OSError as error:
        raise mismatch(str(source), expected, _text(error)) from error
    except _CAUSES as error:
        raise mismatch(str(source), expected, _text(error)) from error
    except Exception as error:
        if not library:
            raise
        raise mismatch(str(source), expected, _text(error)) from error
    except SystemExit as error:
        raise mismatch(str(source), expected, "the library ended the program") from error


def _text(error: BaseException) -> str:
    return f"{type(error).__name__}: {error}" if str(error) else type(error).__name__


def check_count(value: int, item: str, what: str, smallest: int = 0, largest: int = LARGEST_COUNT) -> int:
    """A count read from a file, if it can be one."""
    if not smallest <= value <= largest:
        raise mismatch(item, f"{what} from {smallest} to {largest}", value)
    return int(value)
