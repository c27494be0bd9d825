"""Files of results: opened for reading with one clear error where a file is something else."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import h5py

from bdamper.errors import BdamperError


@contextmanager
def reading(path: str | Path, kind: str, written_by: str) -> Iterator[h5py.File]:
    """An HDF5 file with the attribute ``format = kind``, open while its contents are taken out.

    Parameters
    ----------
    path : str or Path
    kind : str
    written_by : str
        What such a file is, for the message.

    Raises
    ------
    FileNotFoundError
    BdamperError
        If the file, or what is read from it, is not what was expected.
    """
    try:
        with h5py.File(path, "r") as file:
            if file.attrs.get("format") != kind:
                raise BdamperError(f"{path}: expected the format '{kind}', found '{file.attrs.get('format', 'none')}'")
            yield file
    except (FileNotFoundError, BdamperError):
        raise
    except (OSError, KeyError, ValueError, TypeError) as error:
        raise BdamperError(f"{path}: expected {written_by}, found something else ({error})") from error
