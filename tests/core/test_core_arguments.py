"""The list of arrays of a call of the core does not grow beyond its end."""

import ctypes
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

import numpy as np
import pytest

HERE = Path(__file__).parent
SOURCES = HERE.parents[1] / "csrc"


@pytest.fixture(scope="module")
def library(tmp_path_factory):
    """The checks of arguments, compiled with a function that enters any number of arrays."""
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        pytest.skip("no C compiler")
    path = tmp_path_factory.mktemp("arguments") / "arguments.so"
    includes = [SOURCES, sysconfig.get_path("include"), np.get_include()]
    command = [compiler, "-std=c17", "-shared", "-fPIC", *(f"-I{folder}" for folder in includes)]
    if sys.platform == "darwin":
        command += ["-undefined", "dynamic_lookup"]
    command += [str(HERE / "arguments_of_a_call.c"), "-o", str(path)]
    subprocess.run(command, check=True, timeout=60)
    found = ctypes.PyDLL(str(path))
    found.accepted.restype = ctypes.py_object
    found.accepted.argtypes = [ctypes.py_object, ctypes.c_int, ctypes.c_int]
    return found


@pytest.mark.slow
def test_more_arrays_than_there_is_room_for_are_refused(library):
    room = library.capacity()
    x = np.zeros(3)
    assert library.accepted(x, 3, room) == room
    with pytest.raises(SystemError, match=f"x: expected at most {room} arrays in one call"):
        library.accepted(x, 3, room + 1)
