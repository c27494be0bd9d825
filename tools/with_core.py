"""Run pytest with another build of the core: ``python tools/with_core.py _core.so ARGUMENTS``."""

import importlib.util
import sys

import pytest

spec = importlib.util.spec_from_file_location("bdamper._core", sys.argv[1])
sys.modules[spec.name] = importlib.util.module_from_spec(spec)
spec.loader.exec_module(sys.modules[spec.name])
sys.exit(pytest.main(sys.argv[2:]))
