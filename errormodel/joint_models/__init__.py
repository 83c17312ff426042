"""Error models of a joint: how an error motion depends on the joint's position. One class a file, found by itself."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from errormodel.joint_models.base import JointModel


@cache
def registry() -> Mapping[str, type[JointModel]]:
    """Every joint error model by its word in ``machine.yaml``, those without a number first.

    A word that is defined twice is a mistake of the project's own and raises.
    """
    from errormodel.discovery import by_word, classes
    from errormodel.joint_models.base import JointModel

    found = by_word((kind.word, kind) for kind in classes(__name__, JointModel))  # type: ignore[type-abstract]
    return dict(sorted(found.items(), key=lambda item: bool(item[1].counts)))
