"""The guide: its references name everything that there is, and its links lead somewhere."""

import re
import sys
from pathlib import Path

import msgspec
import pytest

from labpipe.errors import UsageError
from pipelines.cli import COMMANDS
from pipelines.experiments import KINDS
from pipelines.guide import _gallery, _reference, _site, pages


def test_every_field_of_every_kind_is_in_the_reference() -> None:
    text = _reference.settings()
    for kind in KINDS.values():
        part = text.partition(f'kind = "{kind.name}"')[2].partition("\n## ")[0]
        for path, table in _reference._tables("", kind.settings):
            assert not path or f"### `{path}` in" in part
            for field in msgspec.structs.fields(table):
                assert field.name == "kind" or f"| `{field.name}` |" in part, (kind.name, path, field.name)


def test_a_default_is_shown_as_it_would_be_written() -> None:
    rows = [line.split(" | ") for line in _reference.settings().splitlines() if line.startswith("| `")]
    shown = {(row[0].strip("| `"), row[2].strip(" |")) for row in rows}
    assert {("height", "required"), ("velocity", '`"spline"`'), ("gravity", '`"9.81 m/s2"`')} <= shown
    assert ("inclination_from_height", "`false`") in shown
    assert not any("Quantity(" in cell for row in rows for cell in row)


def test_every_command_is_in_the_reference() -> None:
    text = _reference.commands()
    for name in COMMANDS:
        assert re.search(rf"^## `labpipe {name}`$", text, re.MULTILINE), name
    assert "### `labpipe acquire keyence`" in text
    assert "--json" in text


def test_links_lead_to_pages_of_the_site_and_others_become_words(tmp_path: Path) -> None:
    (tmp_path / "analyst.md").touch()
    text = "[a](analyst.md#x), [b](../../sample_data/README.md), [c](https://doi.org/1), ![d](e.png), [f](#g)"
    assert _site._within(text, tmp_path) == "[a](analyst.md#x), b, [c](https://doi.org/1), ![d](e.png), [f](#g)"


def test_the_gallery_shows_one_report_of_each_kind(
    processed_session: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(_gallery, "shown", lambda source, page, name, text: f"![{text}]({name})\n")
    _gallery.write(tmp_path, [processed_session])
    kinds = {path.stem for path in (tmp_path / "reports").iterdir()}
    text = (tmp_path / "gallery.md").read_text("utf-8")
    assert kinds
    assert text.count("\n## ") == len(kinds)
    assert all(f"<reports/{kind}.html>" in text and KINDS[kind].title in text for kind in kinds)


def test_without_sphinx_it_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "sphinx.application", None)
    with pytest.raises(UsageError, match=r"pip install 'labpipe\[guide\]'"):
        _site.build(tmp_path / "site")


def test_the_installed_guide_is_small_whole_and_leads_nowhere_else() -> None:
    made = pages()
    assert {"experimenter", "settings", "commands", "films"} <= set(made)
    assert sum(len(text.encode()) for text in made.values()) < 5_000_000
    for name, text in made.items():
        links = re.findall(r'(?:href|src)="([^"]*)"', text)
        own = {link for link in links if not link.startswith(("#", "data:", "https://doi.org/", "https://"))}
        assert own <= {"app.css", *(f"{other}.html" for other in made)} | {
            link for link in own if link.partition(".html#")[0] in made
        }, name
        assert "<script" not in text
        assert not re.search(r'src="http', text)
    for text in made.values():
        for name, anchor in re.findall(r'href="(\w+)\.html#([^"]+)"', text):
            assert f'id="{anchor}"' in made[name], (name, anchor)
