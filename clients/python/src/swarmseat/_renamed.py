"""Functions under their old names, for one release."""

import sys
import warnings
from collections.abc import Callable, Mapping
from typing import Any


def warn_renamed(old: str, new: str) -> None:
    """Warns the caller of a function with an old name."""
    warnings.warn(f"{old} is now {new}; the next release has the new name only", DeprecationWarning, stacklevel=3)


def renamed(module: str, names: Mapping[str, str], load: Callable[[str], Any] | None = None) -> Callable[[str], Any]:
    """The `__getattr__` of a module that gives functions under their old names, with a warning.

    Args:
        module: The name of the module.
        names: The names of the functions, by their old names.
        load: A function that gives all other attributes of the module.
    """

    def give(name: str) -> Any:
        if name not in names:
            if load is not None:
                return load(name)
            raise AttributeError(f"module {module!r} has no attribute {name!r}")
        warn_renamed(f"{module}.{name}", names[name])
        return getattr(sys.modules[module], names[name])

    return give
