#!/bin/sh
# Runs the commands and then the Python code of README.md in a fresh copy of the tracked files with an empty virtual
# environment.  The Python code runs in the root folder of that copy, as a reader would paste it.
set -eu
cd "$(dirname "$0")/.."
place=$PWD/builddir-readme
rm -rf "$place" && mkdir "$place" "$place/copy"
git ls-files -z | tar --null -T - -cf - | tar -xf - -C "$place/copy"
"${PYTHON:-python3}" -m venv "$place/venv"
PATH=$place/venv/bin:$PATH
export PATH MPLBACKEND=Agg XDG_CACHE_HOME="$place/cache"
cd "$place/copy"
python - <<'END'
import re
import subprocess
import sys
from pathlib import Path

blocks = re.findall(r"```(\w*)\n(.*?)```", Path("README.md").read_text(encoding="utf-8"), re.S)
commands = next(text for language, text in blocks if not language)
code = [text for language, text in blocks if language == "python"]
assert "pip install" in commands and code, "README.md has no installation command or no Python code"
subprocess.run(["sh", "-e", "-c", commands], check=True)
for text in code:
    subprocess.run([sys.executable, "-"], input=text, text=True, check=True)
print(f"README.md: {len(commands.splitlines())} commands and {len(code)} blocks of Python code ran")
END
rm -rf "$place"
