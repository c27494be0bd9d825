#!/bin/sh
# Does what README.md says, as a new user would: its commands run in a copy of the tracked files, with an empty home and neither
# environment nor caches; then its installation and its Python code in an empty environment of one's own.
set -eu
cd "$(dirname "$0")/.."
root=$PWD
place=$root/builddir-readme
rm -rf "$place" && mkdir "$place" "$place/copy" "$place/home"
git ls-files -z | tar --null -T - -cf - | tar -xf - -C "$place/copy"
# tests that need files beside the checkout find them beside the copy
if [ -d "$root/../shared" ]; then ln -s "$(cd "$root/../shared" && pwd)" "$place/shared"; fi

# interpreters and the address of the package index stay where they are
PYENV_ROOT=${PYENV_ROOT:-$HOME/.pyenv}
for settings in "$HOME/.config/pip/pip.conf" "$HOME/.pip/pip.conf"; do
  if [ -f "$settings" ]; then PIP_CONFIG_FILE=${PIP_CONFIG_FILE:-$settings}; export PIP_CONFIG_FILE; fi
done
HOME=$place/home XDG_CACHE_HOME=$place/home/.cache PIP_CACHE_DIR=$place/home/.cache/pip MPLBACKEND=Agg
export PYENV_ROOT HOME XDG_CACHE_HOME PIP_CACHE_DIR MPLBACKEND
unset VIRTUAL_ENV PYTHONPATH PYTHONHOME XDG_CONFIG_HOME XDG_DATA_HOME MAKEFLAGS MAKELEVEL

cd "$place/copy"
git init -q . && git add .
PYTHON=${PYTHON:-python3}
export PYTHON
"$PYTHON" - <<'END'
import os
import re
import subprocess
import sys
import time
from pathlib import Path

text = Path("README.md").read_text(encoding="utf-8")
blocks = re.findall(r"^```(\w*)\n(.*?)^```", text, re.S | re.M)
commands = next(block for language, block in blocks if not language).splitlines()
code = [block for language, block in blocks if language == "python"]
(installation,) = re.findall(r"`(pip install [^`]+)`", text)


def run(command: str) -> None:
    """Run a command of the README in a shell, and print its wall and processor seconds."""
    begin, before = time.monotonic(), os.times()
    subprocess.run(["sh", "-e", "-c", command], check=True, stdin=subprocess.DEVNULL)
    after = os.times()
    processor = after.children_user + after.children_system - before.children_user - before.children_system
    print(f"README.md: {command.strip()}: {time.monotonic() - begin:.0f} s, processor {processor:.0f} s", flush=True)


names = [command.partition("#")[0].strip() for command in commands]
assert names == ["make demo", "make test"], names
assert code, "README.md has no Python code"
for command in commands:
    run(command)
left = subprocess.run(["git", "ls-files", "--others", "--exclude-standard"], check=True, capture_output=True, text=True).stdout
assert not left, f"the commands left files that git does not ignore: {left}"

subprocess.run([sys.executable, "-m", "venv", "../venv"], check=True)
os.environ["PATH"] = f"{Path('../venv/bin').resolve()}{os.pathsep}{os.environ['PATH']}"
run(installation)
for block in code:
    subprocess.run(["python", "-"], input=block, text=True, check=True)
print(f"README.md: {len(commands)} commands, the installation, and {len(code)} block of Python code ran")
END
rm -rf "$place"
