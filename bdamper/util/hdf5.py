"""Files of results: opened for reading with one clear error where a file is something else."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import h5py

from bdamper.util.errors import BdamperError


def check_folder(path: str | os.PathLike[str]) -> None:
    """Refuse a path whose folder does not exist."""
    folder = Path(path).resolve().parent
    if not folder.is_dir():
        raise BdamperError(f"{path}: expected a folder that exists, found no '{folder}'")


@contextmanager
def writing(path: str | os.PathLike[str], kind: str, version: int = 1) -> Iterator[h5py.File]:
    """A new HDF5 file with the attributes ``format = kind`` and ``version``.

    Raises
    ------
    BdamperError
        If no file can be written there.
    """
    check_folder(path)
    try:
        with h5py.File(path, "w") as file:
            file.attrs["format"] = kind
            file.attrs["version"] = version
            yield file
    except OSError as error:
        raise BdamperError(f"{path}: expected a file that can be written, found {error}") from error


@contextmanager
def reading(path: str | os.PathLike[str], kind: str, written_by: str) -> Iterator[h5py.File]:
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
    if not Path(path).is_file():
        raise FileNotFoundError(f"there is no file '{path}'")
    try:
        with h5py.File(path, "r") as file:
            if file.attrs.get("format") != kind:
                raise BdamperError(f"{path}: expected the format '{kind}', found '{file.attrs.get('format', 'none')}'")
            yield file
    except (FileNotFoundError, BdamperError):
        raise
    except Exception as error:  # a damaged file can make HDF5 and h5py raise almost anything
        raise BdamperError(f"{path}: expected {written_by}, found something else ({error})") from error
