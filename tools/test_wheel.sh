#!/bin/sh
# Builds a wheel, installs it into an empty environment and computes one tracking curve there.
set -eu
cd "$(dirname "$0")/.."
place=builddir-wheel
rm -rf $place && mkdir -p $place/elsewhere
"${PYTHON:-python3}" -m venv $place/venv
$place/venv/bin/python -m pip wheel -qq --no-deps --wheel-dir $place .
$place/venv/bin/python -m pip install -qq $place/bdamper-*.whl
cd $place/elsewhere
../venv/bin/python -W error::RuntimeWarning ../../tools/smoke.py
