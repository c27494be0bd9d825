"""Reference models that are too large for the wheel: made once, kept whole, found where they are."""

import importlib.util
import shutil
import sys
import time
from concurrent.futures import ThreadPoolExecutor

import pytest

import bdamper as bd
from bdamper.fem import reference_models
from tests.test_codebase import ROOT

SMALL = ROOT / "bdamper" / "data" / "blade_to_ground_24.h5"


@pytest.fixture
def installed(tmp_path, monkeypatch):
    """As where a wheel is installed, away from the checkout: the cache folder."""
    monkeypatch.setattr(
        reference_models,
        "__file__",
        str(tmp_path / "lib" / "site" / "bdamper" / "fem" / "reference_models.py"),
    )
    monkeypatch.setattr(
        reference_models, "user_cache_path", lambda name, version: tmp_path / "cache" / version
    )
    monkeypatch.delenv("BDAMPER_MODELS", raising=False)
    return tmp_path


@pytest.fixture
def maker(monkeypatch):
    """Counts its calls and takes its time over a small model."""
    large = pytest.importorskip(
        "bdamper.fem.generated_models", reason="scikit-fem is not installed (extra bdamper[fe])"
    )
    calls = []

    def make(points, progress):
        calls.append((points, progress))
        time.sleep(0.1)
        return bd.load_model(SMALL)

    monkeypatch.setitem(large.MAKERS, "paper_disk", make)
    return calls


def read():
    return reference_models.reference_model("paper_disk", 48)


def test_made_once_and_kept(installed, maker):
    first, second = read(), read()
    assert maker == [(48, True)] and first.hash == second.hash
    assert [path.name for path in installed.rglob("*.h5")] == ["paper_disk_48.h5"]


def test_two_at_once_make_one(installed, maker):
    with ThreadPoolExecutor(2) as pool:
        models = [job.result() for job in [pool.submit(read), pool.submit(read)]]
    assert len(maker) == 1 and models[0].hash == models[1].hash


def test_interruption_leaves_nothing_half_written(installed, monkeypatch):
    def cut(file, model):
        file["half"] = 1.0
        raise KeyboardInterrupt

    with monkeypatch.context() as broken:
        broken.setattr("bdamper.model.model_file.write_model", cut)
        large = pytest.importorskip(
            "bdamper.fem.generated_models", reason="scikit-fem is not installed (extra bdamper[fe])"
        )
        broken.setitem(large.MAKERS, "paper_disk", lambda points, progress: bd.load_model(SMALL))
        with pytest.raises(KeyboardInterrupt):
            read()
    assert [path.name for path in installed.rglob("*.*") if path.is_file()] == [
        "paper_disk_48.lock"
    ]


def test_without_scikit_fem_one_error_says_what_to_do(installed, monkeypatch):
    monkeypatch.setitem(sys.modules, "bdamper.fem.generated_models", None)
    with pytest.raises(
        bd.BdamperError,
        match=r"pip install 'bdamper\[fe\]', or set BDAMPER_MODELS to a folder that contains paper_disk_48.h5",
    ):
        read()


def test_folder_of_the_environment_variable(installed, tmp_path, monkeypatch):
    mine = tmp_path / "mine"
    mine.mkdir()
    shutil.copy(SMALL, mine / "paper_disk_48.h5")
    monkeypatch.setenv("BDAMPER_MODELS", str(mine))
    assert read().hash == bd.load_model(SMALL).hash


@pytest.mark.nightly
@pytest.mark.slow
@pytest.mark.parametrize(
    "path", ["tests/models/paper_disk_24.h5", "bdamper/data/shrouded_blade_4.h5"]
)
def test_what_is_made_is_what_is_stored(path):
    """Up to rounding, 1.4e-9 for the flexibility of a free damper, whose factors a shift keeps from singularity."""
    large = pytest.importorskip(
        "bdamper.fem.generated_models", reason="scikit-fem is not installed (extra bdamper[fe])"
    )
    spec = importlib.util.spec_from_file_location(
        "make_reference_model", ROOT / "tools" / "make_reference_model.py"
    )
    tool = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(tool)
    made = (
        tool.modes_alone(tool.shrouded().model)
        if "shrouded" in path
        else large.MAKERS["paper_disk"](24)
    )
    found = tool.differences(made, bd.load_model(ROOT / path))
    assert len(found) > 20 and max(found.values()) < 1e-8, max(found, key=found.get)
