"""The six lines of docs/index.md give what the page prints."""

import re
from pathlib import Path

import pytest

PAGE = Path(__file__).resolve().parents[2] / "docs" / "index.md"


@pytest.mark.slow
def test_six_lines(capsys):
    page = PAGE.read_text()
    code = re.search(r"```python\n(.*?)```", page, re.S)[1]
    shown = re.search(r"```\n(tracking curve.*?)```", page, re.S)[1]
    assert len(code.splitlines()) <= 7 and code.count("(50.0, 5000.0), 15)") == 1
    space = {}
    exec(compile(code.replace("(50.0, 5000.0), 15)", "(50.0, 5000.0), 15, check=False)"), str(PAGE), "exec"), space)
    found = capsys.readouterr().out  # without the ladder, which takes nine tenths of the time
    for pattern in (r"peak (\S+) m at (\S+) Hz, 2 folds", r"optimum (\S+) m at (\S+) N, (\S+) Hz \(smooth\), complete",
                    r"free (\S+) m at (\S+) Hz, stuck (\S+) m at (\S+) Hz"):  # fmt: skip
        there, here = (list(map(float, re.search(pattern, text).groups())) for text in (shown, found))
        assert here == pytest.approx(there, rel=1e-4)
    for line in re.findall(r"^(?:tracking|optimal) curve, .*$", shown, re.M):
        assert line.split(":")[0] in found
