#!/bin/sh
# Nastran readers beside pyNastran, in an environment of their own: pyNastran needs a NumPy before 2.
set -eu
cd "$(dirname "$0")/.."
venv=.venv-nastran
place=builddir-nastran
[ -x $venv/bin/python ] || "${PYTHON:-python3}" -m venv $venv
if ! $venv/bin/python -m pip install -qq . "pyNastran>=1.4" "numpy<2" pytest pytest-timeout; then
  $venv/bin/python -c 'import sys; sys.exit(sys.version_info < (3, 13))' || exit 1
  echo "make: no comparison with pyNastran: no NumPy before 2 for this Python; set PYTHON=python3.12"
  exit 0
fi
rm -rf $place && mkdir -p $place/project
cp -r tests tools pyproject.toml $place/project/
cd $place/project
# the installed package is tested, not the source tree, so only this copy is on the path
"../../$venv/bin/python" -m pytest -q tests/importers/test_beside_pynastran.py
