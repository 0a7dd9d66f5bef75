"""The public door for plug-ins: its names, and its version."""

from __future__ import annotations

import re
from importlib import import_module
from pathlib import Path

import pytest

import imuscope.plugin
from imuscope.protocols.family import plugins
from imuscope.protocols.family.plugins import API_VERSION, ProtocolPlugin, plugins_of_others
from imuscope.protocols.registry.families import load_families
from tests.support.source_files import ROOT, facts_of, python_files

DOCUMENTS = sorted((ROOT / "docs").glob("add-*.md"))


def test_every_public_name_is_there_and_documented() -> None:
    for name, module in imuscope.plugin.public_names().items():
        result = getattr(imuscope.plugin, name)
        assert result is getattr(import_module(module), name)
        assert name in dir(imuscope.plugin)
        if isinstance(result, type):
            assert (result.__doc__ or "").strip(), f"{module}.{name} has no docstring"


def test_a_name_that_is_not_public_is_refused() -> None:
    with pytest.raises(AttributeError, match="'Session' is not a public name of imuscope"):
        imuscope.plugin.Session  # noqa: B018


def test_plug_ins_and_documents_use_public_names_only() -> None:
    wrong = [
        f"{path.relative_to(ROOT)}:{line} imports {module}"
        for path in python_files("tests/plugins/plugin_family")
        for line, module in facts_of(path).imports
        if module.split(".")[0] in ("server", "protocols", "recordings")
    ]
    for path in DOCUMENTS:
        code = re.findall(r"^```python\n(.*?)^```", path.read_text(), re.M | re.S)
        matches = [name for block in code for name in re.findall(r"^from (imuscope(?:\.[\w.]+)?) import", block, re.M)]
        wrong += [f"{path.name} imports {name}" for name in matches if name != "imuscope.plugin"]
    assert not wrong, "\n".join(wrong)


def test_no_record_of_a_family_has_more_than_ten_members() -> None:
    family = import_module("imuscope.protocols.family.info")
    names = ("ProtocolInfo", "FrameFormat", "Decoding", "StreamTraits", "DeviceTraits", "ConfigurationTraits")
    for name in (*names, "VendorLogs", "PageWords"):
        assert len(getattr(family, name).__dataclass_fields__) <= 10, name


def test_a_plug_in_of_another_version_is_refused_before_it_is_imported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, group in (("later", "imuscope.protocols.2"), ("present", "imuscope.protocols")):
        about = tmp_path / f"imuscope_{name}-3.1.dist-info"
        about.mkdir()
        (about / "METADATA").write_text(f"Metadata-Version: 2.1\nName: imuscope-{name}\nVersion: 3.1\n")
        (about / "entry_points.txt").write_text(f"[{group}]\n{name} = no_such_module:FAMILY\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    results = [one for one in plugins_of_others(plugins.GROUP) if one.name in ("later", "present")]
    assert [(one.name, one.api) for one in results] == [("later", 2), ("present", API_VERSION)]
    assert load_families(results) == (
        {},
        [
            "The protocol 'later' of imuscope-later 3.1 cannot be used: it is written for version 2 of the plug-in "
            "API, and this imuscope has version 1. Install a newer imuscope.",
            "The protocol 'present' of imuscope-present 3.1 cannot be used: ModuleNotFoundError: No module named "
            "'no_such_module'.",
        ],
    )


def test_an_earlier_plug_in_is_refused_with_the_advice_to_renew_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(plugins, "API_VERSION", 2)
    with pytest.raises(ValueError, match="Install a newer imuscope-mip"):
        ProtocolPlugin("mip", "imuscope_mip:FAMILY", "imuscope-mip 0.1.0", 1).check()
