"""Files that would read without end, fill the memory or lead to other folders: one line each, before they are read."""

import io
import struct
import tracemalloc
import zipfile
import zlib

import numpy as np
import pytest

from bdamper.importers import read_bdf, read_body, read_inp, read_matrix
from bdamper.util.errors import ModelError
from tests.each import each
from tests.importers.test_io_files import DECK
from tests.importers.test_keywords import BULK


@each("line", ["/etc/{}", "../{}", "sub/../../{}", "..\\{}", "C:\\{}", "\\\\host\\{}"])
@each("reader", ["inp", "bdf"])
def test_files_of_other_folders_are_not_included(line, reader, tmp_path):
    (tmp_path / "own" / "sub").mkdir(parents=True)
    (tmp_path / "more").write_text(DECK if reader == "inp" else BULK)
    word = line.format("more")
    text = f"*INCLUDE, INPUT={word}\n" if reader == "inp" else f"INCLUDE '{word}'\n{BULK}"
    (tmp_path / "own" / f"a.{reader}").write_text(text)
    below = "a file in the folder of this one or below, or a folder named by include_folder"
    expected = rf"a\.{reader}: .*INCLUDE in line 1: expected {below}, found '.*more'$"
    with pytest.raises(ModelError, match=expected):
        read_body(tmp_path / "own" / f"a.{reader}")


@each("linked", ["file", "folder"])
@each("reader", ["inp", "bdf"])
def test_a_link_to_another_folder_is_not_followed(linked, reader, tmp_path):
    (tmp_path / "own").mkdir()
    (tmp_path / "other").mkdir()
    for folder in ("own", "other"):
        (tmp_path / folder / "mesh").write_text(DECK if reader == "inp" else BULK)
    name, target = ("link", "mesh") if linked == "file" else ("link/mesh", "")
    deck = tmp_path / "own" / f"a.{reader}"
    deck.write_text(f"*INCLUDE, INPUT={name}\n" if reader == "inp" else f"INCLUDE '{name}'\n")
    (tmp_path / "own" / "link").symlink_to(tmp_path / "other" / target)
    with pytest.raises(ModelError, match=rf"below, found '{name}', a link to another folder$"):
        read_body(deck)
    if linked == "file":
        (tmp_path / "own" / "link").unlink()
        (tmp_path / "own" / "link").symlink_to(tmp_path / "own" / target)
        assert len(read_body(deck).numbers) == (8 if reader == "inp" else 4)


@each("reader", ["inp", "bdf"])
@each("named", ["{folder}/more", "../more", "..\\more"])
def test_files_of_a_named_folder_are_included(reader, named, tmp_path):
    """The folder is permitted by name, and no other one."""
    (tmp_path / "run").mkdir()
    (tmp_path / "other").mkdir()
    text = DECK if reader == "inp" else BULK
    for folder in (tmp_path, tmp_path / "other"):
        (folder / "more").write_text(text)
    name = named.format(folder=tmp_path)
    line = f"*INCLUDE, INPUT={name}\n" if reader == "inp" else f"INCLUDE '{name}'\n"
    deck = tmp_path / "run" / f"a.{reader}"
    deck.write_text(line)
    read = read_inp if reader == "inp" else read_bdf
    with pytest.raises(ModelError, match="or a folder named by include_folder"):
        read(deck)
    assert len(read(deck, include_folder=tmp_path).numbers) == (8 if reader == "inp" else 4)
    with pytest.raises(ModelError, match="a file in the folder of this one or below, found"):
        read(deck, include_folder=tmp_path / "other")
    with pytest.raises(ModelError, match="include_folder: expected an existing folder"):
        read(deck, include_folder=tmp_path / "none")


def test_files_of_own_folders_are_included_with_either_slash(tmp_path):
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub" / "mesh.inp").write_text(DECK)
    for slash in "/\\":
        (tmp_path / "a.inp").write_text(f"*INCLUDE, INPUT=sub{slash}mesh.inp\n")
        assert len(read_inp(tmp_path / "a.inp").numbers) == 8


def test_the_number_of_included_files_is_bounded(tmp_path):
    """Three files of ten lines each make 1,110 reads, five of 100 lines 10^10."""
    (tmp_path / "d.inp").write_text("** nothing\n")
    for own, other in ("ab", "bc", "cd"):
        (tmp_path / f"{own}.inp").write_text(10 * f"*INCLUDE, INPUT={other}.inp\n")
    expected = r"\.inp: \*INCLUDE in line \d+: expected at most 100 included files, nested at most 5 deep, found more"
    with pytest.raises(ModelError, match=expected):
        read_inp(tmp_path / "a.inp")


def test_included_bulk_data_stands_in_its_place(tmp_path):
    lines = BULK.splitlines()
    (tmp_path / "grid.bdf").write_text("\n".join([*lines[1:5], ""]))
    (tmp_path / "a.bdf").write_text(
        "\n".join([lines[0], "include 'grid.bdf'", *lines[5:], "ENDDATA", ""])
    )
    assert read_body(tmp_path / "a.bdf").nodes.tolist() == [
        [0, 0, 0],
        [1, 0, 0],
        [0, 1, 0],
        [0, 0, 1],
    ]


def refused(path, expected):
    """Refused with a message, and without room for the numbers."""
    tracemalloc.start()
    try:
        with pytest.raises(ModelError, match=expected):
            read_matrix(path)
        assert tracemalloc.get_traced_memory()[1] < 60_000_000
    finally:
        tracemalloc.stop()


@pytest.mark.slow
@pytest.mark.parametrize(
    "names",
    [
        ("K",),
        pytest.param(("format", "shape", "indices", "indptr", "data"), marks=pytest.mark.slow),
    ],
)
def test_compressed_zeros_are_not_expanded(names, tmp_path, monkeypatch):
    """2 GB of zeros in an archive of NumPy, alone and as the numbers of a sparse matrix."""
    head = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        head, {"descr": "<f8", "fortran_order": False, "shape": (250_000_000,)}
    )
    small = io.BytesIO()
    np.save(small, np.array([2, 2]))
    with zipfile.ZipFile(tmp_path / "k.npz", "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        for name in names[:-1]:
            archive.writestr(f"{name}.npy", small.getvalue())
        with archive.open(f"{names[-1]}.npy", "w", force_zip64=True) as member:
            member.write(head.getvalue())
            for _ in range(200):
                member.write(bytes(10_000_000))
    assert (tmp_path / "k.npz").stat().st_size < 2e7
    refused(
        tmp_path / "k.npz",
        r"k\.npz: arrays: expected a size, bytes, from 1 to 1600000000, found 2000\d+",
    )


def test_a_sparse_file_of_zeros_is_not_read(tmp_path):
    np.lib.format.open_memmap(
        tmp_path / "k.npy", "w+", float, (250_000_000,)
    )  # has no blocks on disk
    refused(
        tmp_path / "k.npy",
        r"k\.npy: arrays: expected a size, bytes, from 1 to 1600000000, found 2000000128",
    )


@pytest.mark.slow
def test_a_compressed_variable_of_matlab_is_not_expanded(tmp_path):
    """An element of type 14 of 2 GB in one of type 15: flags, dimensions, name, and zeros."""
    packer = zlib.compressobj(1)
    parts = [packer.compress(struct.pack("<II", 14, 2_000_000_056))]
    parts.append(
        packer.compress(
            struct.pack("<IIII", 6, 8, 6, 0) + struct.pack("<IIii", 5, 8, 250_000_000, 1)
        )
    )
    parts.append(
        packer.compress(struct.pack("<II8s", 1, 1, b"K") + struct.pack("<II", 9, 2_000_000_000))
    )
    parts += [packer.compress(bytes(10_000_000)) for _ in range(200)]
    content = b"".join([*parts, packer.flush()])
    head = b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack("<H", 0x0100) + b"IM"
    (tmp_path / "k.mat").write_bytes(head + struct.pack("<II", 15, len(content)) + content)
    expected = r"compressed variable: expected bytes, with those before it, from 0 to 1600000000, found 2000000056"
    refused(tmp_path / "k.mat", expected)
