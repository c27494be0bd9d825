"""Public archives of Ansys: numbers of nodes and elements beside those of ``mapdl-archive``."""

import json
import os
import subprocess
import sys

import numpy as np
import pytest

from bdamper.importers import read_cdb
from bdamper.util.errors import ModelError
from tests.others_files import READER, REPOSITORIES, UNPACKED, archives

if not READER.is_dir():
    pytest.skip("mapdl-archive is not unpacked (make others)", allow_module_level=True)

COUNTS = """
import json, sys
import mapdl_archive, numpy

archive = mapdl_archive.Archive(sys.argv[1], parse_vtk=False)
types = dict(archive.ekey[:, :2].tolist()) if len(archive.ekey) else {}
kinds = [types.get(int(row[1])) for row in archive.elem]
sets = {name: len(numpy.unique(nodes)) for name, nodes in archive.node_components.items()}
json.dump({"nodes": int(archive.n_node), "kinds": kinds, "sets": sets}, sys.stdout)
"""
SOLIDS = {45, 185, 95, 186, 90, 92, 187, 10, 285}
NAMES = {"HexBeam.cdb": 2, "TetBeam.cdb": 2, "sector.cdb": 2, "academic_rotor.cdb": 1}
"""Archives of the wheels, and in how many of them each is."""


def counts(path):
    """Numbers of nodes, of each element type and of each component, by the other reader."""
    environment = {**os.environ, "PYTHONPATH": str(UNPACKED)}
    command = [sys.executable, "-c", COUNTS, str(path)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=600)
    if done.returncode != 0:
        pytest.skip(f"mapdl-archive does not read it: {done.stderr[-200:]}")
    return json.loads(done.stdout)


@pytest.mark.parametrize("path", archives(), ids=lambda path: str(path.relative_to(UNPACKED)))
def test_counts_are_those_of_another_reader(path):
    """Or the archive is refused with one line that names it."""
    try:
        body = read_cdb(path)
    except ModelError as error:
        refusal = str(error)
        if path.name in NAMES or str(path) not in refusal or "\n" in refusal:
            raise
        pytest.skip(refusal)
    theirs = counts(path)
    assert len(body.numbers) == theirs["nodes"]
    n_solids = sum(kind in SOLIDS for kind in theirs["kinds"])
    assert sum(map(len, body.elements)) == n_solids
    found = {name: len(np.unique(nodes)) for name, nodes in body.node_sets.items()}
    # the other reader keeps the blanks that fill a name
    assert found == {name.strip(): count for name, count in theirs["sets"].items() if count}


def test_the_archives_of_the_wheels_are_here():
    names = [path.name for path in archives() if not path.is_relative_to(REPOSITORIES[0])]
    for name, count in NAMES.items():
        assert names.count(name) >= count


@pytest.mark.parametrize("folder", REPOSITORIES, ids=lambda folder: folder.name)
def test_the_repositories_are_here(folder):
    if not folder.is_dir():
        pytest.skip(f"{folder} was not copied (make others, with a network)")
    assert any(path.is_relative_to(folder) for path in archives())
