"""Hostile texts in session.toml, a record, the names and heads of files, and a damaged cell.

One session carries them everywhere at once; its pages are looked at with a parser, its tables as a spreadsheet would,
and the command line's words for what a terminal would obey.
"""

import base64
import contextlib
import csv
import hashlib
import io
import json
import re
import unicodedata
from datetime import datetime
from html.parser import HTMLParser
from pathlib import Path

import pytest

from labpipe import files, materials
from pipelines.cli import main
from pipelines.rig.drops import DropRig, write_drops
from pipelines.rig.session_text import drop_section, laser_record, session_head

MARK = "window.pwned=1"
SHORT = f"<img src=x onerror={MARK}>"
PAYLOAD = (
    f"=cmd|' /C calc'!A0 </title></style></script><script>{MARK}</script>{SHORT}"
    f"<svg/onload={MARK}>\" onmouseover=\"{MARK}\" ' onfocus='{MARK}' autofocus "
    f"x='javascript:{MARK} {{{{7*7}}}}${{{MARK}}}`--><base href='https://example.org/'>"
    "<meta http-equiv=refresh content='0;url=//x'></textarea></pre></table></main>"
    "\u202egnp\u2028\u2029 \u0085\u009b31m &lt;b&gt; \\u003cb\\u003e"
)
NAME = f"n' onclick='{MARK}' & {{{{7+7}}}} ${{{MARK}}} @SUM(1)"
BROKEN = "=broken & 'cell'"


def quoted(text: str) -> str:
    """Write any text for TOML: everything beyond plain ASCII as an escape."""
    plain = "".join(c if c.isascii() and c.isprintable() and c not in '"\\' else f"\\U{ord(c):08x}" for c in text)
    return f'"{plain}"'


def with_values(text: str, values: dict[str, str]) -> str:
    for key, value in values.items():
        text, count = re.subn(rf"(?m)^{key} = .*$", lambda _, v=value, k=key: f"{k} = {v}", text)
        assert count, key
    return text


@pytest.fixture(scope="module")
def hostile(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A processed session: one drop that works and one that is damaged."""
    folder = tmp_path_factory.mktemp("hostile")
    acrylic = materials.load("acrylic")
    (name,) = write_drops(folder, "drop", DropRig(duration=0.15), acrylic, 1.5e-3, 1, 11, datetime(2024, 5, 14, 9, 30))
    sound = (folder / name).read_text("utf-8-sig")
    head = f"Comment,{SHORT} {MARK}</script>\nOperator,=1+1\n"
    sound = sound.replace("Model,LK-G5001", f"Model,LK-G5001 {SHORT}\n{head.strip()}")
    (folder / name).unlink()
    (folder / f"laser/{NAME}.csv").write_text(sound, "utf-8")
    broken = sound.replace("\n77,", f"\n77,{SHORT}\u202e\u009b2J", 1)
    (folder / "laser/broken.csv").write_text(broken, "utf-8")
    record = with_values(laser_record(), {k: quoted(PAYLOAD) for k in ("id", "who", "how")})
    files.write_text(folder / "calibration/laser.toml", record)
    head = with_values(session_head("x"), {k: quoted(PAYLOAD) for k in ("title", "operator", "notes")})
    one = drop_section(NAME, [f"laser/{NAME}.csv"], 1.5e-3, "acrylic")
    files_of_two = [f"laser/{NAME}.csv", "laser/broken.csv"]
    two = drop_section(BROKEN, files_of_two, 1.5e-3, "acrylic")
    head += one.replace(f"experiments.{NAME}", f"experiments.{quoted(NAME)}")
    head += two.replace(f"experiments.{BROKEN}", f"experiments.{quoted(BROKEN)}")
    files.write_text(folder / "session.toml", head)
    code, said = command_line("process", str(folder), "--jobs", "1")
    assert code == 1, said
    (folder / "said.txt").write_text(said, "utf-8")
    return folder


def command_line(*arguments: str) -> tuple[int, str]:
    """Run a command here; its exit code and everything it said."""
    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        try:
            main(arguments)
        except SystemExit as end:
            return int(end.code or 0), said.getvalue()
    raise AssertionError(arguments)


class Page(HTMLParser):
    """What a browser would make of a page."""

    def __init__(self, text: str) -> None:
        super().__init__(convert_charrefs=True)
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.scripts: list[tuple[str | None, str]] = []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))
        if tag == "script":
            self.scripts.append((dict(attrs).get("type"), ""))

    def handle_data(self, data: str) -> None:
        if self.elements and self.elements[-1][0] == "script" and self.cdata_elem == "script":
            kind, text = self.scripts[-1]
            self.scripts[-1] = (kind, text + data)


def pages(folder: Path) -> list[Path]:
    found = sorted((folder / "labpipe").glob("*.html")) + sorted((folder / "labpipe/reports").glob("*.html"))
    assert len(found) >= 3
    return found


def test_no_text_becomes_an_element_an_attribute_or_a_script(hostile: Path) -> None:
    whole = "".join(path.read_text("utf-8") for path in pages(hostile))
    assert all(part in whole for part in ("&lt;img src=x", "=cmd|", "onclick=", "&lt;base href"))
    for path in pages(hostile):
        page = Page(path.read_text("utf-8"))
        policy = next(
            a["content"] or ""
            for t, a in page.elements
            if t == "meta" and a.get("http-equiv") == "Content-Security-Policy"
        )
        assert policy.startswith("default-src 'none'")
        for tag, attributes in page.elements:
            assert tag not in {"iframe", "object", "embed", "base", "form", "foreignobject"}
            assert not any(name.startswith("on") or name == "autofocus" for name in attributes)
            assert (attributes.get("http-equiv") or "").lower() != "refresh"
            for key in ("src", "href", "xlink:href"):
                address = attributes.get(key) or ""
                is_inside = address.startswith("data:image/") or address == "data:,"
                assert ":" not in address.split("/")[0] or is_inside, (tag, address)
        for kind, text in page.scripts:
            if kind == "application/json":
                json.loads(text)
            else:
                assert MARK not in text
                digest = base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
                assert f"'sha256-{digest}'" in policy


def obeyed(text: str) -> set[str]:
    """Characters that a terminal obeys instead of showing."""
    return {c for c in text if c != "\n" and unicodedata.category(c) in ("Cc", "Cs")} | (
        set(text) & set("\u202a\u202b\u202d\u202e\u2066\u2067\u2068")
    )


COMMANDS = [["plan", "."], ["plan", ".", "--json"], ["compare", "."]]
COMMANDS += [["inspect", name] for name in (".", "laser/broken.csv", f"laser/{NAME}.csv")]


@pytest.mark.parametrize("command", COMMANDS, ids=" ".join)
def test_a_terminal_is_told_nothing_that_it_would_obey(
    hostile: Path, command: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(hostile)
    code, said = command_line(*command)
    assert code in (0, 1, 3), said
    assert len(said) > 40
    assert obeyed(said) == set()
    assert obeyed((hostile / "said.txt").read_text("utf-8")) == set()


def test_a_spreadsheet_finds_no_formula(hostile: Path, tmp_path: Path) -> None:
    """Every cell of every table is a number, or begins with nothing that is computed."""
    code, said = command_line("export", str(hostile), "--only", NAME, "--out", str(tmp_path / "out"))
    assert code == 0, said
    tables = list((tmp_path / "out").rglob("*.csv"))
    assert tables
    for path in tables:
        text = path.read_text("utf-8")
        for row in csv.reader(io.StringIO(text)):
            for cell in row:
                is_number = re.fullmatch(r"-?(\d+\.?\d*(e[+-]?\d+)?|inf)", cell) is not None
                assert is_number or not cell.startswith(("=", "+", "-", "@", "\t", "\r")), cell
