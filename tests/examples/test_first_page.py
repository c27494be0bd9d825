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
        shown = re.search(r"```\n(Optimum: .*?)(?:  |```)", text, re.S)[1].replace("\n", " ")
        for sentence in re.findall(r"(?:Optimum|Peak|Within).*?[a-z)%N]\.(?= |$)", shown):
            assert sentence in found, "the time integration is left out here"
        assert "Time integration gives 71.6 µm (70.2 to 73.9), 5 % less" in shown and "Recommended: 104 N" in shown
