#!/bin/sh
# Quick tests with every dependency at its oldest supported version, in an environment of their own.
# The extension is built with the headers of a current NumPy, as every wheel is, and runs with the oldest.
set -eu
cd "$(dirname "$0")/.."
venv=.venv-oldest
place=builddir-oldest
python=${OLDEST_PYTHON:-python3.11}
"$python" -c 'import ensurepip, venv' 2>/dev/null \
  || { echo "skipped: no $python, the oldest supported Python, for which the oldest NumPy and SciPy are built"; exit 0; }
[ -x $venv/bin/python ] || "$python" -m venv $venv
oldest=$($venv/bin/python -c '
import tomllib
with open("pyproject.toml", "rb") as file:
    project = tomllib.load(file)["project"]
print(*(one.replace(">=", "==") for one in project["dependencies"] + project["optional-dependencies"]["fe"]))')
echo "$oldest"
# shellcheck disable=SC2086  # one word for each package
$venv/bin/python -m pip install -qq . $oldest pytest pytest-xdist hypothesis
rm -rf $place && mkdir -p $place
cp -r tests pyproject.toml $place/
cd $place
# the installed package is tested, not the source tree, so only this copy is on the path
"../$venv/bin/python" -m pytest -q -n auto -m "not slow" \
  tests/core tests/contact tests/model tests/harmonic_balance tests/continuation tests/util
