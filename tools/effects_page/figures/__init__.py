"""The figures of all effects; importing this package enters them in `PLOTS`."""

from importlib import import_module
from pkgutil import iter_modules

from tools.effects_page.plot import PLOTS

__all__ = ["PLOTS"]

for module in iter_modules(__path__, f"{__name__}."):
    import_module(module.name)
