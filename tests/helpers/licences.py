"""Licences of what comes with errormodel: `python -m tests.helpers.licences` lists them, and fails at a wrong one.

The tree of requirements of pyproject.toml is walked, the developers' tools among them (the packages that benchmarks
compare with are not installed with it). Allowed is what an Apache-2.0 package may depend on without passing on other
terms to its users. A licence that is not known is not allowed.
"""

from __future__ import annotations

import re
import sys
import tomllib
from collections.abc import Iterable, Iterator
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[2]
# SPDX identifiers, the names of PyPI's classifiers, and what some authors write instead
ALLOWED = {
    "MIT", "MIT-0", "MIT-CMU", "BSD-2-Clause", "BSD-3-Clause", "0BSD", "Apache-2.0", "ISC", "PSF-2.0", "MPL-2.0",
    "Zlib", "CC0-1.0", "MIT License", "BSD License", "Apache Software License", "Python Software Foundation License",
    "ISC License (ISCL)", "Mozilla Public License 2.0 (MPL 2.0)", "MIT No Attribution License (MIT-0)", "BSD",
    "BSD 3-Clause License", "Apache 2.0", "Apache License, Version 2.0",
    "Apache-2.0 WITH LLVM-exception",  # which grants more than Apache-2.0 alone
}  # fmt: skip
EXCEPTIONS = {  # package: its licence, for the reason beside it
    # A library on its own that is installed unmodified, imported at run time and can be exchanged by its users: LGPL-3,
    # section 4. Nothing of it is in errormodel's own files.
    "casadi": "GNU Lesser General Public License v3 or later (LGPLv3+)",
}


def licence_of(package: Distribution) -> str:
    """The licence as the package states it: SPDX expression, else classifiers, else the first line of its text."""
    if expression := package.metadata.get("License-Expression"):
        return str(expression)
    said = [c.split(" :: ")[-1] for c in package.metadata.get_all("Classifier", []) if c.startswith("License ::")]
    named = [c for c in said if c != "OSI Approved"]  # which says nothing
    lines = str(package.metadata.get("License") or "").strip().splitlines()
    return " AND ".join(named) if named else lines[0].strip() if lines else "unknown"


def allowed(name: str, licence: str) -> bool:
    """Whether a package of this licence may be a dependency."""
    terms = [part.split(" OR ") for part in licence.split(" AND ")]
    return EXCEPTIONS.get(name) == licence or all(any(t in ALLOWED for t in choice) for choice in terms)


def tree(requirements: Iterable[str]) -> Iterator[tuple[str, str]]:
    """All packages that some requirements bring in this environment, each once, with its licence."""
    seen: set[tuple[str, str]] = set()
    told: set[str] = set()
    left = [(Requirement(r), ("",)) for r in requirements]
    while left:
        requirement, extras = left.pop()
        if requirement.marker and not any(requirement.marker.evaluate({"extra": e}) for e in extras):
            continue
        name, wanted = canonicalize_name(requirement.name), ("", *sorted(requirement.extras))
        new = tuple(e for e in wanted if (name, e) not in seen)
        if not new:
            continue
        seen.update((name, e) for e in new)
        try:
            package = distribution(name)
        except PackageNotFoundError:
            yield name, "not installed"
            continue
        if name not in told:
            told.add(name)
            yield name, licence_of(package)
        left += [(Requirement(r), new) for r in package.requires or []]


def wrong(packages: Iterable[tuple[str, str]]) -> list[str]:
    """Those whose licence is not allowed, in words."""
    return [f"{name}: {licence}" for name, licence in packages if not allowed(name, licence)]


def requirements(extra: str = "dev") -> list[str]:
    """Those of pyproject.toml, with those of an extra; "": with none."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    return [*project["dependencies"], *project["optional-dependencies"].get(extra, [])]


if __name__ == "__main__":
    found = sorted(tree(requirements()))
    for name_, licence_ in found:
        sys.stdout.write(f"{name_:24} {re.sub(r'[^ -~]', '?', licence_)}\n")
    if bad := wrong(found):
        sys.exit("not allowed for a package under Apache-2.0:\n" + "\n".join(bad))
