"""Something is done when another package has been imported: how adapters come by themselves.

A .pth file of an adapter calls `add` when Python starts, so this module imports nothing else:

    import medialis_after_import
    medialis_after_import.add("pymeshlab", "medialis_meshlab", "patch")

From then on ``import pymeshlab`` is followed by ``medialis_meshlab.patch()``. Programs that import
the adapter themselves are left alone, and `MEDIALIS_AFTER_IMPORT=off` leaves everything as it was.
"""

import sys


class _Finder:
    """Asks the finders behind it for one package, and does something after its first import."""

    def __init__(self, package, module, function, alone):
        self.package, self.module, self.function, self.alone = package, module, function, alone

    def find_spec(self, name, path=None, target=None):
        """Return the package's own spec, with the call behind its execution."""
        if name != self.package:
            return None
        behind = sys.meta_path[sys.meta_path.index(self) + 1 :]
        specs = (finder.find_spec(name, path, target) for finder in behind)
        spec = next((found for found in specs if found is not None), None)
        if spec is not None and spec.loader is not None:
            execute = spec.loader.exec_module

            def exec_module(module):
                execute(module)
                self.act()

            spec.loader.exec_module = exec_module
        return spec

    def act(self):
        """Call the function, once; what it raises is a warning, as nobody asked for it."""
        if self not in sys.meta_path:
            return
        sys.meta_path.remove(self)
        if self.module in sys.modules or self.alone in sys.modules:
            return
        import importlib
        import warnings

        try:
            getattr(importlib.import_module(self.module), self.function)()
        except Exception as error:  # noqa: BLE001 - the package itself is there and works
            warnings.warn(f"medialis does nothing for {self.package}: {error}", stacklevel=2)


def add(package, module, function, alone=""):
    """Call a function of a module after the first import of a package; said twice, once.

    Parameters
    ----------
    package : str
        Not imported yet.
    module, function : str
        The function takes no arguments.
    alone : str
        Another module that is for those who call what they want themselves: if one of the two has
        been imported before, nothing is called.

    Examples
    --------
    >>> import medialis_after_import
    >>> medialis_after_import.add("colorsys", "gc", "collect")
    >>> import colorsys  # and gc.collect() is called
    """
    import os

    # Python may read a .pth file twice: `lib` and `lib64` are one folder in many environments.
    known = any(isinstance(f, _Finder) and f.module == module for f in sys.meta_path)
    off = os.environ.get("MEDIALIS_AFTER_IMPORT", "on") == "off"
    if not known and not off and package not in sys.modules:
        sys.meta_path.insert(0, _Finder(package, module, function, alone))
