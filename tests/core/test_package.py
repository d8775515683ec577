"""The package that is imported is this one, under one version number."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from importlib.metadata import version
from pathlib import Path

import snnav_core

MANIFEST = ElementTree.parse(Path(__file__).parents[2] / "snnav_core" / "package.xml").getroot()


def test_manifest_metadata_and_module_agree_on_the_version() -> None:
    assert MANIFEST.findtext("name") == "snnav_core"
    assert MANIFEST.findtext("version") == version("snnav_core") == snnav_core.__version__
