"""SciPy's linear assignment without the rest of `scipy.optimize`.

The package takes longer to import than a short replay; its solver is one extension module that
needs none of it. Where that module is not found the package is imported.
"""

from __future__ import annotations

import sys
from importlib.machinery import EXTENSION_SUFFIXES, ExtensionFileLoader
from importlib.util import find_spec, module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Any

_NAME = "scipy.optimize._lsap"


def _solver() -> Any:
    scipy = find_spec("scipy")
    for folder in (scipy.submodule_search_locations or ()) if scipy else ():
        for suffix in EXTENSION_SUFFIXES:
            path = Path(folder) / "optimize" / f"_lsap{suffix}"
            if _NAME not in sys.modules and path.is_file():
                loader = ExtensionFileLoader("_lsap", str(path))
                spec = spec_from_file_location("_lsap", path, loader=loader)
                assert spec is not None
                module = module_from_spec(spec)
                loader.exec_module(module)
                return module.linear_sum_assignment
    from scipy.optimize import linear_sum_assignment

    return linear_sum_assignment


linear_sum_assignment = _solver()
"""See `scipy.optimize.linear_sum_assignment`: (rows, columns) of the best assignment."""
