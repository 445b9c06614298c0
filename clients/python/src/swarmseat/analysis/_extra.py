"""The error that says what to install if the extra `analysis` is missing."""

from importlib.util import find_spec

NEEDED = ("jinja2", "matplotlib", "numpy", "pandas", "pyarrow", "scipy", "sklearn", "statsmodels")

for name in NEEDED:
    if find_spec(name) is None:
        raise ModuleNotFoundError(
            f"swarmseat.analysis needs {name}: install this package with its extra `analysis` (docs/play/python.md)",
            name=name,
        )
