"""Settings of the documentation. Pages of reference are written from the code before each build (`generate.py`)."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

import generate

from errormodel import __version__

project = "errormodel"
author = "The errormodel developers"
project_copyright = "The errormodel developers, Apache-2.0"
release = version = __version__
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx.ext.viewcode"]
myst_enable_extensions = ["colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3
exclude_patterns = ["_build"]
html_theme = "furo"
html_title = f"errormodel {__version__}"
autodoc_typehints = "none"  # the sections on parameters say them, with shapes and units
autodoc_member_order = "bysource"
napoleon_google_docstring = False
default_role = "code"


def setup(_app: object) -> None:
    """Write the generated pages before Sphinx reads the sources."""
    generate.write(Path(__file__).parent / "reference")
