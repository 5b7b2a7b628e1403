"""A face gives away what it defines, and what it imports as itself or for the type checker; nothing else."""

import importlib
import sys
from pathlib import Path

import pytest

FACE = """
from json import JSONDecodeError, loads as loads
from typing import TYPE_CHECKING
from labpipe.installation import lazily

if TYPE_CHECKING:
    from plain.inner import thing as renamed
else:
    __getattr__ = lazily(__name__)

LIMIT = 3
_HIDDEN = 4


def helpful(): ...
"""


def test_a_name_is_imported_on_its_first_use(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "plain").mkdir()
    (tmp_path / "plain/__init__.py").write_text(FACE)
    (tmp_path / "plain/inner.py").write_text("thing = 7\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    try:
        face = importlib.import_module("plain")
        assert "plain.inner" not in sys.modules
        assert face.renamed == 7
        with pytest.raises(AttributeError, match="'plain' has no attribute 'thing'"):
            _ = face.thing
        assert dir(face) == face.__all__ == ["LIMIT", "helpful", "loads", "renamed"]
    finally:
        for name in ("plain", "plain.inner"):
            sys.modules.pop(name, None)
