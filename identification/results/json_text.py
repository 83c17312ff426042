"""JSON as results are written: NaN as null."""

from __future__ import annotations

import json
from typing import Any

import numpy as np


def dumps(data: Any) -> str:
    """Return JSON with NaN as null, so that every reader takes it."""
    return json.dumps(_plain(data), indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: _plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(v) for v in value]
    if isinstance(value, float | np.floating):
        return float(value) if np.isfinite(value) else None
    return value
