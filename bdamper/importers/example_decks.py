"""Example decks with their matrices, and the reader of a deck with its matrices."""

from __future__ import annotations

from pathlib import Path
from zipfile import ZipFile

from bdamper.importers.abaqus import read_abaqus, read_calculix
from bdamper.importers.ansys import read_ansys
from bdamper.importers.fe_body import FEBody
from bdamper.util import validation
from bdamper.util.errors import mismatch
from bdamper.util.storage import FilePath, existing, file_errors

_ARCHIVES = Path(__file__).resolve().parents[1] / "data" / "decks"


def example_decks(name: str, folder: FilePath = ".") -> list[Path]:
    """Write the files of an example to a folder.

    Parameters
    ----------
    name : {"abaqus", "ansys", "calculix", "ring", "shroud", "turbine"}
        Sector with wedge damper: instances of an Abaqus deck, two archives of Ansys, or two decks
        of CalculiX.  The others are decks of CalculiX: "shroud", a sector with tip shroud and two
        strip dampers, "ring", one of 24 sectors with a friction ring, and "turbine", one of 60
        sectors with a damper of 19 g, whose optimum passes all checks.
    folder : path-like
        Existing folder.

    Returns
    -------
    list of Path

    Raises
    ------
    SettingError
        If there is no such example.
    FileExistsError
        If another file with one of the names exists.
    """
    validation.choice("example", name, sorted(path.stem for path in _ARCHIVES.glob("*.zip")))
    with ZipFile(_ARCHIVES / f"{name}.zip") as archive:
        contents = {Path(folder) / file: archive.read(file) for file in archive.namelist()}
    for path, content in contents.items():
        if path.exists() and existing(path).read_bytes() != content:
            raise FileExistsError(f"'{path}' exists and is not the file of the example '{name}'")
    for path, content in contents.items():
        with file_errors(path):
            path.write_bytes(content)
    return list(contents)


@validation.check_arguments
def read_job(deck: FilePath, instance: str | None = None) -> FEBody:
    """Read a body from a deck and the matrices in the same folder.

    Parameters
    ----------
    deck : path-like
        ``job.inp`` with ``job.sti`` (CalculiX) or ``job_STIF*.mtx`` (Abaqus), or ``job.cdb`` with
        ``job.full`` (Ansys).
    instance : str, optional
        Instance of an Abaqus deck.

    Raises
    ------
    FileNotFoundError, ModelError
        If a file does not exist or is damaged, or the deck has a different file extension.
    """
    path = Path(deck)
    ending = path.suffix.lower()
    if ending == ".cdb":
        return read_ansys(path.with_suffix(".full"), path)
    if ending != ".inp":
        expected = "a deck .inp or .cdb (other files: bdamper.importers)"
        raise mismatch(str(path), expected, f"the extension '{path.suffix}'")
    has_matrices_of_calculix = path.with_suffix(".sti").is_file()
    if instance is None and has_matrices_of_calculix:
        return read_calculix(path)
    return read_abaqus(path, instance)
