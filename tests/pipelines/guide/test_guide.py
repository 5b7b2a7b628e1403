"""The guide: its references name everything that there is, and its links lead somewhere."""

import re
from pathlib import Path

import msgspec
import pytest

from labpipe.errors import InputError, SourceError
from pipelines.cli import COMMANDS
from pipelines.experiments import KINDS
from pipelines.guide import PICTURES, pages
from pipelines.guide.__main__ import build, replay, same_words
from pipelines.guide.pages import linked, tables, texts
from tests.labpipe.report.conftest import CHROMIUM, NO_BROWSER, Browser


def test_every_field_of_every_kind_is_in_the_reference() -> None:
    text = texts()["settings"]
    for kind in KINDS.values():
        part = text.partition(f'kind = "{kind.name}"')[2].partition("\n## ")[0]
        for path, table in tables("", kind.settings):
            assert not path or f"### `{path}` in" in part
            for field in msgspec.structs.fields(table):
                assert field.name == "kind" or f"| `{field.name}` |" in part, (kind.name, path, field.name)
    rows = [line.split(" | ") for line in text.splitlines() if line.startswith("| `")]
    shown = {(row[0].strip("| `"), row[3].strip(" |")) for row in rows}
    assert {("height", "required"), ("contact", '`"polymer"`'), ("gravity", '`"9.81 m/s2"`')} <= shown
    assert ("inclination_from_height", "`false`") in shown
    assert not any("Quantity(" in cell for row in rows for cell in row)
    assert any(row[0].strip("| `") == "contact" and "prior knowledge" in row[1] for row in rows)
    assert all(row[1].strip() for row in rows)


def test_every_command_is_in_the_reference_one_level_below_its_parent() -> None:
    text = texts()["commands"]
    heads = re.findall(r"^(#+) `labpipe ([^`]+)`$", text, re.MULTILINE)
    assert {*COMMANDS, "simulate drop"} <= {path for _, path in heads}
    assert all(len(marks) == 1 + len(path.split()) for marks, path in heads)
    assert "--json" in text


def test_links_lead_to_pages_of_the_guide_and_others_become_words() -> None:
    text = "[a](analyst.md#x), [b](../../sample_data/README.md), [c](https://doi.org/1), ![d](e.png), [f](#g)"
    found = linked(text, ".html", frozenset({"analyst"}))
    assert found == "[a](analyst.html#x), b, [c](https://doi.org/1), ![d](e.png), [f](#g)"


def test_a_tutorial_gets_the_replies_of_its_commands(tmp_path: Path) -> None:
    text = "Words.\n\n```sh\necho two > file\n```\n\n```text\n$ cat file\none\n```\n\n```toml\n$ x\n```\n"
    assert replay(text, tmp_path) == text.replace("one", "two")
    long = replay("```text\n$ seq 30\n```\n", tmp_path)
    assert "6\n... (18 lines)\n25\n" in long
    with pytest.raises(InputError, match="ended with 3: exit 3"):
        replay("```sh\nexit 3\n```\n", tmp_path)


def test_a_kept_tutorial_may_differ_in_numbers_and_not_in_words() -> None:
    same_words("done in 12.1 s\n1.42 %", "done in 9 s\n1.41 %")
    for now, kept in (("a 1\ntwo", "a 2\none"), ("a\nsteps: 121 done", "a\nsteps: 122 done")):
        with pytest.raises(SourceError, match="pictures are then stale") as raised:
            same_words(now, kept)
        assert raised.value.line == 2


def test_the_installed_guide_is_small_whole_and_leads_nowhere_else() -> None:
    made = pages()
    assert {"tutorial", "gallery", "experimenter", "settings", "commands", "films"} <= set(made)
    bare = {name for name, text in made.items() if "pictures/" not in text}
    assert bare == {"settings", "commands", "changelog", "architecture"}
    assert all(part in made["all"] for part in ("A first session", "damping_ratio", "labpipe simulate drop"))
    pictures = {path.name: path.stat().st_size for path in PICTURES.iterdir()}
    assert sum(len(text.encode()) for text in made.values()) + sum(pictures.values()) < 5_000_000
    shown = set()
    for name, text in made.items():
        links = set(re.findall(r'(?:href|src)="([^"]*)"', text))
        shown |= {link for link in links if link.startswith("pictures/")}
        own = {link for link in links if not link.startswith(("#", "data:", "https://", "pictures/"))}
        assert own <= {"app.css", "search.js", *(f"{other}.html" for other in made)} | {
            link for link in own if link.partition(".html#")[0] in made
        }, name
        assert re.findall(r"<script[^>]*>", text) == ['<script src="search.js" defer>']
        assert not re.search(r"<(?:img|link|iframe)[^>]+(?:src|href)=.?(?:https?:)?//", text)
    assert shown == {f"pictures/{name}" for name in pictures}
    assert {f"pictures/gallery-{kind}.webp" for kind in KINDS} <= shown
    for text in made.values():
        for name, anchor in re.findall(r'href="(\w+)\.html#([^"]+)"', text):
            assert f'id="{anchor}"' in made[name], (name, anchor)


@pytest.mark.slow
def test_the_built_site_loads_nothing_from_elsewhere(tmp_path: Path) -> None:
    pytest.importorskip("sphinx", reason="the extra guide is not installed")
    first = build(tmp_path / "site")
    built = sorted(first.parent.glob("*.html"))
    assert len(built) > 15
    if CHROMIUM is None:
        pytest.skip(NO_BROWSER)
    window = Browser(tmp_path / "profile")
    try:
        for path in built:
            window.open(path, width=1000)
            assert [address for address in window.requests() if not address.startswith("file://")] == [], path.name
            assert window.run("[...document.images].every(i => i.naturalWidth > 0 || i.loading === 'lazy')"), path.name
    finally:
        window.close()
