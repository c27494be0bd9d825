#!/bin/sh
# Tests of the Nastran readers in an environment of their own: pyNastran needs a NumPy before 2.
set -eu
cd "$(dirname "$0")/.."
venv=.venv-nastran
place=builddir-nastran
[ -x $venv/bin/python ] || "${PYTHON:-python3}" -m venv $venv
$venv/bin/python -m pip install -qq ".[fe,nastran,unv]" "numpy<2" pytest pytest-timeout hypothesis
rm -rf $place && mkdir -p $place/project
cp -r tests tools examples docs pyproject.toml $place/project/
[ ! -d ../shared ] || ln -s "$(cd ../shared && pwd)" $place/shared
cd $place/project
# the installed package is tested, not the source tree, so only this copy is on the path
"../../$venv/bin/python" -m pytest -q tests/importers/test_io_files.py tests/importers/test_stress_fields.py tests/importers/test_keywords.py tests/importers/test_bounds.py "tests/examples/test_import_page.py::test_recipes"
