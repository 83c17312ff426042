"""Controllers that take compensation tables: a plug-in registry, one class per file of this package."""

from errormodel.controllers.base import instead, registry, target

__all__ = ["instead", "registry", "target"]
