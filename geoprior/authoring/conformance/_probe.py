"""Run in a fresh interpreter: imports one module and tells what that cost. Not imported by anything.

Arguments: the module, then the names of modules that count as heavy. Prints one JSON object.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Sequence
from importlib import import_module
from importlib.abc import MetaPathFinder
from types import ModuleType


class Watch(MetaPathFinder):
    """Notes which line of which file first asks for a heavy module, and finds nothing."""

    def __init__(self, heavy: Sequence[str]) -> None:
        self.heavy = frozenset(heavy)
        self.asked: dict[str, str] = {}

    def find_spec(self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None) -> None:
        """See `importlib.abc.MetaPathFinder`."""
        del path, target
        if fullname in self.heavy and fullname not in self.asked:
            self.asked[fullname] = _first_line_outside()


def _first_line_outside() -> str:
    """The outermost line of the import that is under way: it stands in the plug-in."""
    frame, line = sys._getframe(), ""
    while frame.f_back is not None:
        frame = frame.f_back
        if frame.f_code.co_filename != __file__ and "importlib" not in frame.f_code.co_filename:
            line = f"{frame.f_code.co_filename}:{frame.f_lineno}"
    return line


def main() -> None:
    """Import what every command of geoprior imports anyway, then the plug-in."""
    module, *heavy = sys.argv[1:]
    import_module("geoprior.hooks.manager").Plugins().load_builtins()
    watch = Watch(heavy)
    sys.meta_path.insert(0, watch)
    begun = time.process_time()
    import_module(module)
    seconds = time.process_time() - begun
    loaded = {name: line for name, line in watch.asked.items() if name in sys.modules}
    print(json.dumps({"seconds": round(seconds, 3), "heavy": loaded}))  # noqa: T201 - this is its result


if __name__ == "__main__":
    main()
