"""Schema of ``manifest.json`` as far as it is read back."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel, ConfigDict


class _Part(BaseModel):
    model_config = ConfigDict(extra="ignore", strict=True)  # keys of later versions are additions


class _Input(_Part):
    name: str
    sha256: str


class ManifestFile(_Part):
    """The keys of a manifest; the first versions wrote no options and no arguments."""

    holds: str
    command: str
    files: dict[str, str]
    inputs: list[_Input]
    options: dict[str, Any] = {}
    arguments: dict[str, Any] | None = None
    version: str = ""
