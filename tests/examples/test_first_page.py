"""The README and the first page of the documentation print what they show."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
README, PAGE = ((ROOT / name).read_text() for name in ("README.md", "docs/index.md"))


def test_the_readme_is_short():
    assert len(README.split()) <= 350 and README.count("![") == 1
    (code,) = re.findall(r"```python\n(.*?)```", README, re.S)
    assert len([line for line in code.splitlines() if line]) <= 9 and code in PAGE


@pytest.mark.slow
def test_first_page(capsys):
    """Without time integration, which takes most of the time."""
    first, second = re.findall(r"```python\n(.*?)```", PAGE, re.S)
    space = {}
    for code in (first.replace("1000.0), 12)", "1000.0), 12, check=False)"), second):
        exec(compile(code, "docs/index.md", "exec"), space)
    found = capsys.readouterr().out.replace("\n", " ")
    for text in (README, PAGE):
        shown = re.search(r"```\n(Preload: .*?)(?:  |```)", text, re.S)[1].replace("\n", " ")
        near, balance = (re.search(what, shown)[0] for what in (r"the amplitude is within .*?N\.", r"\S+ µm at 661 Hz"))
        assert near in found and balance in found and shown.strip().endswith(found[found.index("mistuning, wear") :][:54])
        assert "in time 70.2 to 73.9 µm" in shown and shown.startswith("Preload: 104 N"), "left out here"
