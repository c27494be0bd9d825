"""Check that the calls in the code of the manual exist, also in blocks that need decks and are not run.

``python -m tools.manual_names`` gives the blocks of each page to mypy, as one program a page, and prints unknown
attributes and unknown arguments with the block's line.  Other findings, such as names that the text defines, do not count.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PAGES = (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")))
BLOCK = re.compile(r"^```(?:python|py)[^\n]*\n(.*?)^```", re.S | re.M)
IMPORTS = "import bdamper as bd\nimport numpy as np\n"
FINDING = re.compile(r"^(\S+?)\.py:(\d+): error: (.*\[(?:attr-defined|call-arg)\])$", re.M)


def program(text: str) -> str:
    """Return the code blocks of a page as one program, without blocks that show a session."""
    blocks = [block for block in BLOCK.findall(text) if not block.lstrip().startswith(">>>")]
    return IMPORTS + "\n".join(blocks)


def findings(pages: dict[str, str]) -> list[str]:
    """Return unknown attributes and arguments in the texts of pages by name, each with its line of code."""
    programs = {f"page_{i}": program(text) for i, text in enumerate(pages.values())}
    names = dict(zip(programs, pages))
    with tempfile.TemporaryDirectory() as folder:
        for stem, code in programs.items():
            (Path(folder) / f"{stem}.py").write_text(code)
        command = [
            sys.executable,
            "-m",
            "mypy",
            "--ignore-missing-imports",
            "--follow-imports=silent",
        ]
        command += [
            f"--cache-dir={ROOT / '.mypy_cache'}",
            "--config-file=",
            *(f"{stem}.py" for stem in programs),
        ]
        done = subprocess.run(
            command, cwd=folder, env={"MYPYPATH": str(ROOT)}, capture_output=True, text=True
        )
    if done.returncode not in (0, 1):
        raise SystemExit(done.stdout + done.stderr)
    found = []
    for stem, line, message in FINDING.findall(done.stdout):
        code = programs[stem].splitlines()[int(line) - 1].strip()
        found.append(f"{names[stem]}: {code}: {message}")
    return found


def main() -> None:
    """Print the findings; exit with an error if there are any."""
    found = findings({str(page.relative_to(ROOT)): page.read_text() for page in PAGES})
    print("\n".join(found))
    raise SystemExit(1 if found else 0)


if __name__ == "__main__":
    main()
