#!/bin/sh
# Usage: test_versions.sh oldest|newest FOLDER...
# Runs quick tests with every dependency at its oldest supported version or at its newest release, in an
# environment of their own.  The extension is built with the headers of a current NumPy, as every wheel is.
set -eu
cd "$(dirname "$0")/.."
which=$1
shift
venv=.venv-$which
place=builddir-$which
if [ "$which" = oldest ]; then
  python=${OLDEST_PYTHON:-python3.11}
  "$python" -c 'import ensurepip, venv' 2>/dev/null \
    || { echo "skipped: no $python, the oldest supported Python, for which the oldest NumPy and SciPy are built"; exit 0; }
  sign='=='
else
  python=$(sh tools/pythons.sh | tail -1)
  [ -n "$python" ] || { echo "missing: a Python 3.11 or newer with venv and ensurepip"; exit 1; }
  sign='>='
fi
[ -x "$venv/bin/python" ] || "$python" -m venv "$venv"
dependencies=$("$venv/bin/python" -c '
import sys, tomllib
with open("pyproject.toml", "rb") as file:
    project = tomllib.load(file)["project"]
print(*(one.replace(">=", sys.argv[1]) for one in project["dependencies"] + project["optional-dependencies"]["fe"]))' "$sign")
# shellcheck disable=SC2086  # one word for each package
"$venv/bin/python" -m pip install -qq --upgrade --upgrade-strategy eager . $dependencies pytest pytest-xdist pytest-timeout hypothesis
"$venv/bin/python" -m pip list 2>/dev/null | grep -iE '^(numpy|scipy|h5py|matplotlib|scikit-fem) '
rm -rf "$place" && mkdir -p "$place"
cp -r tests csrc pyproject.toml "$place/"
mkdir "$place/docs" && cp -r docs/*.md docs/evidence docs/specification "$place/docs/"
BDAMPER_MODELS=$PWD/tests/models
export BDAMPER_MODELS
cd "$place"
# the installed package is tested, not the source tree, so only this copy is on the path
"../$venv/bin/python" -m pytest -q -n auto -m "not slow" "$@"
