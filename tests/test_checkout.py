"""Python that is started in a checkout: the installed package comes before sources without a compiled core."""

import shutil
import subprocess
import sys
from importlib.machinery import EXTENSION_SUFFIXES
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


@pytest.fixture
def sources(tmp_path):
    """Return the package as a checkout has it: its first file, and no core."""
    folder = tmp_path / "checkout" / "bdamper"
    folder.mkdir(parents=True)
    for name in ("__init__.py", "__init__.pyi"):
        shutil.copy(ROOT / "bdamper" / name, folder)
    return folder


def run(code, *folders):
    """Run code in a process that sees these folders and the standard library alone."""
    places = [str(folder) for folder in folders]
    line = f"import sys; sys.path[:0] = {places}; {code}"
    return subprocess.run(
        [sys.executable, "-S", "-c", line], capture_output=True, text=True, cwd="/"
    )


def test_sources_without_a_core_say_what_to_do(sources):
    done = run("import bdamper", sources.parent)
    assert done.returncode == 1
    assert done.stderr.splitlines()[-1].startswith(
        f"ImportError: bdamper in {sources} has no compiled core; run 'pip install .'"
    )


def test_the_installed_package_replaces_the_sources_as_a_whole(sources, tmp_path):
    """The name stub and the modules come from the folder that has the core."""
    installed = tmp_path / "site-packages" / "bdamper"
    installed.mkdir(parents=True)
    (installed / f"_core{EXTENSION_SUFFIXES[0]}").touch()
    (installed / "__init__.py").touch()
    (installed / "__init__.pyi").write_text("from .room import only_here as only_here\n")
    (installed / "room.py").write_text("only_here = __file__\n")
    library = tmp_path / "library"
    library.mkdir()
    import lazy_loader

    shutil.copytree(Path(lazy_loader.__file__).parent, library / "lazy_loader")
    code = "import bdamper; print(bdamper.__file__, bdamper.__all__, bdamper.only_here, sep='\\n')"
    done = run(code, sources.parent, installed.parent, library)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split("\n")[:3] == [
        str(installed / "__init__.py"),
        "['only_here']",
        str(installed / "room.py"),
    ]
