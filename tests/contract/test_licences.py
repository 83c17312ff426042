"""No package comes with errormodel whose licence asks more of a user than Apache-2.0 does."""

from __future__ import annotations

from email.message import Message
from importlib.metadata import Distribution
from typing import Any

import pytest

from tests.helpers.licences import allowed, licence_of, requirements, tree, wrong


def test_all_dependencies_may_be_used():
    found = list(tree(requirements()))
    names = [name for name, _ in found]
    assert len(set(names)) == len(names)
    assert {"numpy", "h5py", "python-neo-lzf", "markupsafe"} <= set(names)  # direct, by an extra, and of another
    assert not wrong(found)


@pytest.mark.parametrize(
    ("licence", "may"),
    [
        ("MIT", True), ("BSD-3-Clause AND 0BSD AND MIT AND Zlib AND CC0-1.0", True), ("GPL-3.0-only OR MIT", True),
        ("GPL-3.0-only", False), ("MIT AND GPL-3.0-only", False), ("unknown", False), ("not installed", False),
        ("", False),
        ("GNU General Public License v3 or later (GPLv3+)", False), ("AGPL-3.0-or-later", False),
        ("GNU Lesser General Public License v3 or later (LGPLv3+)", False),
    ],
)  # fmt: skip
def test_what_is_allowed(licence: str, may: bool):
    assert allowed("some-package", licence) is may
    assert bool(wrong([("some-package", licence)])) is not may


def test_an_exception_is_for_one_licence_of_one_package():
    lesser = "GNU Lesser General Public License v3 or later (LGPLv3+)"
    assert allowed("casadi", lesser)
    assert not allowed("casadi", "GNU General Public License v3 or later (GPLv3+)")


@pytest.mark.parametrize(
    ("headers", "licence"),
    [
        ([("License-Expression", "MIT"), ("License", "GPL")], "MIT"),
        (
            [("Classifier", "License :: OSI Approved :: BSD License"), ("License", "Copyright\nAll")],
            "BSD License",
        ),
        ([("Classifier", "License :: OSI Approved"), ("License", "LGPL-3.0")], "LGPL-3.0"),
        (
            [("Classifier", "License :: OSI Approved :: MIT License"), ("Classifier", "License :: Other :: GPL")],
            "MIT License AND GPL",
        ),
        ([("License", "")], "unknown"),
        ([], "unknown"),
    ],
)
def test_how_a_package_states_its_licence(headers: list[tuple[str, str]], licence: str):
    class Stated(Distribution):
        @property
        def metadata(self) -> Any:
            message = Message()
            for name, value in headers:
                message[name] = value
            return message

        def read_text(self, filename: str) -> str | None:
            raise NotImplementedError

        def locate_file(self, path: object) -> Any:
            raise NotImplementedError

    assert licence_of(Stated()) == licence


def test_a_requirement_that_is_not_installed_is_not_passed_over():
    assert list(tree(["no-such-package-anywhere"])) == [("no-such-package-anywhere", "not installed")]
    assert list(tree(["no-such-package-anywhere; python_version < '3'"])) == []
