"""Forced response of structures with frictional contacts: bladed disks with friction dampers.

The public names are listed in ``__init__.pyi``.  Each module is imported when one of its names is first used.
"""

from importlib import import_module
from typing import Any

import lazy_loader

_import_name, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)


def __getattr__(name: str) -> Any:
    if name == "__version__":
        return import_module("bdamper.util.storage").INSTALLED.bdamper
    if name == "load":  # a file can contain a result of any module, and each module registers its own kinds
        for other in set(__all__) - {"load"}:
            _import_name(other)
    try:
        return _import_name(name)
    except AttributeError:
        near = import_module("bdamper.util.validation").suggest_name(name, __all__)
        raise AttributeError(f"bdamper has no attribute '{name}'{near}", name=name) from None
