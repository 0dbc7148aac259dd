"""The perturbations of the true plant, by idea; `perturbation.py` says what one is. All files here are read."""

from importlib import import_module
from pkgutil import iter_modules

from rabbit_sim.perturbation import Perturbation

for _module in iter_modules(__path__):
    import_module(f"{__name__}.{_module.name}")
KINDS = tuple(sorted(Perturbation.__subclasses__(), key=lambda kind: (kind.order, kind.__name__)))
