"""The pictures of the README and of the first page are those that the demonstration draws today."""

import json
import runpy
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


def flat(value):
    if isinstance(value, dict):
        return [x for item in value.values() for x in flat(item)]
    return [x for item in value for x in flat(item)] if isinstance(value, list) else [value]


@pytest.mark.nightly
@pytest.mark.slow
def test_pictures_are_those_of_the_demonstration(tmp_path, capsys):
    """By the numbers that they show, which stand beside them; time integration and more harmonics are left out."""
    runpy.run_path(str(ROOT / "examples" / "demo.py"))["main"](tmp_path, check=False)
    assert "Without contact 978 µm 13 times the lowest amplitude" in " ".join(
        capsys.readouterr().out.split()
    )
    found, kept = (
        json.loads((folder / "optimum.json").read_text())
        for folder in (tmp_path, ROOT / "docs/images")
    )
    assert found.keys() == kept.keys()
    for name, value in kept.items():
        assert flat(found[name]) == pytest.approx(flat(value), rel=2e-3), (
            f"{name}: demo.py --figures docs/images"
        )
    for name in ("optimum.png", "response.png"):
        assert (tmp_path / name).stat().st_size > 10_000 and (ROOT / "docs/images" / name).exists()
