"""The public names: few, and each in the API reference."""

import importlib
import re
from importlib import metadata
from pathlib import Path

import pytest

import bdamper as bd
import bdamper.io

ROOT = Path(__file__).parents[1]


def test_every_public_name_is_in_the_reference():
    reference = (ROOT / "docs" / "api.md").read_text()
    named = re.findall(r"^\.\. (?:auto\w+|py:data):: bdamper\.(\w+)$", reference, re.M)
    rooms = {path.stem for path in (ROOT / "bdamper").iterdir()}
    assert [name for name in named if name not in rooms] == bd.__all__, "same names in the same order"
    assert len(bd.__all__) <= 36, "two for lumped models, one for finite element matrices, two for whole wheels"


def test_every_name_of_the_import_is_in_the_reference():
    reference = (ROOT / "docs" / "api.md").read_text()
    elsewhere = {"load_model", "save_model", "Measurement", "read_response"}  # with bdamper itself, with their module
    for name in set(bdamper.io.__all__) - elsewhere:
        assert f"bdamper.io.{name}" in reference, name


def test_everything_in_the_reference_is_there():
    for path in re.findall(r"^\.\. (?:auto\w+|py:data):: (bdamper\.\S+)$", (ROOT / "docs" / "api.md").read_text(), re.M):
        assert found(path).__doc__, path


def found(path):
    home, _, name = path.rpartition(".")
    inside = getattr(importlib.import_module(home), name, None)
    return importlib.import_module(path) if inside is None else inside


def test_an_unknown_name_is_an_ordinary_error():
    with pytest.raises(AttributeError, match="module 'bdamper' has no attribute 'Stduy'"):
        bd.Stduy  # noqa: B018


def test_the_version_stands_in_one_place():
    (version,) = re.findall(r"^project\(.*\bversion: '([^']+)'", (ROOT / "meson.build").read_text(), re.M)
    assert bd.__version__ == metadata.version("bdamper") == version, "an older build is installed: run make"
    newest = re.search(r"^## (\S+)", (ROOT / "CHANGELOG.md").read_text(), re.M)
    assert newest is not None and newest[1] == version, "the newest heading of CHANGELOG.md is this version"
    assert "version" not in re.findall(r"^(\w+) *=", (ROOT / "pyproject.toml").read_text(), re.M)
