"""What a stored result imports when it is read, and what a missing attribute costs."""

import subprocess
import sys
from importlib import import_module, metadata

import pytest

import bdamper as bd
from bdamper.util.display import Summarised
from bdamper.util.storage import FORMATS, Storable


@pytest.fixture(scope="module")
def study():
    return bd.lumped(
        1.0,
        0.02,
        1.0,
        contacts=[bd.Contact(0, kt=1.0, mu=1.0, preload=1.0)],
        forces={0: 1.0},
        harmonics=1,
    )


def modules_after(code):
    """Return the modules that a fresh process has imported at the end of this code."""
    lines = f"import sys, bdamper as bd; {code}; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", lines], capture_output=True, text=True, check=True)
    return set(done.stdout.split())


def test_each_format_is_read_by_its_module():
    for module in set(FORMATS.values()):
        import_module(module)

    def formats(kind):
        for derived in kind.__subclasses__():
            if "_format" in vars(derived):
                yield derived._format, derived.__module__
            yield from formats(derived)

    results = {name: module for name, module in formats(Storable) if module.startswith("bdamper.")}
    others = {"bdamper-model": "bdamper.model.model_file", "bdamper-study": "bdamper.study"}
    assert results | others == FORMATS


@pytest.mark.slow
def test_a_curve_is_read_without_the_analyses_and_matplotlib(study, tmp_path):
    path = tmp_path / "curve.h5"
    study.frequency_response(0.0, (0.1, 0.3)).save(path)
    imported = modules_after(f"curve = bd.load({str(path)!r}); print(curve.amplitude.max() > 0.0)")
    assert "True" in imported
    rooms = {name.split(".")[1] for name in imported if name.startswith("bdamper.")}
    assert "response" in rooms
    assert not rooms & {"analyses", "mistuning", "plot", "study", "time_domain", "importers", "fem"}
    assert not {name for name in imported if name.split(".")[0] == "matplotlib"}


def test_pictures_are_found_by_an_entry_point(study):
    (entry,) = metadata.entry_points(group="bdamper_pictures")
    assert entry.value == "bdamper.plot"
    assert study.frequency_response(0.0, (0.1, 0.3)).plot().axes


def test_a_missing_attribute_is_explained_when_it_is_printed(study, monkeypatch):
    looked_at = []
    monkeypatch.setattr(
        "bdamper.util.display._kinds", lambda kind: looked_at.append(kind) or iter([Summarised])
    )
    curve = study.frequency_response(0.0, (0.1, 0.3))
    assert not hasattr(curve, "zzzz")  # a name that no result has
    assert not looked_at
    with pytest.raises(
        AttributeError, match=r"ResponseCurve has no attribute 'amplitud'; did you mean .*amplitude"
    ):
        curve.amplitud  # noqa: B018
    with pytest.raises(AttributeError, match=r"^ResponseCurve has no attribute 'zzzz'$"):
        curve.zzzz  # noqa: B018
    assert looked_at
