"""The guide: its references name everything that there is, and its links lead somewhere."""

import re
import shutil
import sys
from pathlib import Path

import msgspec
import pytest

import labpipe
from labpipe.errors import SourceError, UsageError
from pipelines.cli import COMMANDS
from pipelines.experiments import KINDS
from pipelines.guide import PICTURES, _gallery, _reference, _screens, _site, _tutorial, pages
from pipelines.guide._loaded import in_page, loaded
from tests.labpipe.report.conftest import CHROMIUM, Browser


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


def test_a_command_stands_one_level_below_what_it_belongs_to() -> None:
    heads = re.findall(r"^(#+) `labpipe ([^`]+)`$", _reference.commands(), re.MULTILINE)
    assert {"simulate", "simulate drop", "acquire keyence"} <= {path for _, path in heads}
    assert all(len(marks) == 1 + len(path.split()) for marks, path in heads)


def test_links_lead_to_pages_of_the_site_and_others_become_words(tmp_path: Path) -> None:
    (tmp_path / "analyst.md").touch()
    text = "[a](analyst.md#x), [b](../../sample_data/README.md), [c](https://doi.org/1), ![d](e.png), [f](#g)"
    assert _site._within(text, tmp_path) == "[a](analyst.md#x), b, [c](https://doi.org/1), ![d](e.png), [f](#g)"


def test_the_gallery_shows_one_report_of_each_kind(
    processed_session: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn = []

    def draw(page: Path, target: Path, **_: object) -> bool:
        drawn.append(page)
        target.write_bytes(b"drawn anew")
        return True

    monkeypatch.setattr(_screens, "picture", draw)
    shutil.copytree(PICTURES, tmp_path / "pictures")
    _gallery.write(tmp_path, [processed_session])
    kinds = {path.stem for path in (tmp_path / "reports").iterdir()}
    text = (tmp_path / "gallery.md").read_text("utf-8")
    assert len(kinds) == len(drawn) > 1
    assert all(f"## {kind.title}\n" in text for kind in KINDS.values())
    assert all(f"<reports/{kind}.html>" in text for kind in kinds)
    for name in KINDS:
        picture = (tmp_path / f"pictures/gallery-{name}.webp").read_bytes()
        assert (picture == b"drawn anew") == (name in kinds)


def test_without_a_browser_the_picture_of_the_package_is_shown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_screens, "browser", lambda: None)
    shutil.copytree(PICTURES, tmp_path / "pictures")
    page = tmp_path / "page.html"
    assert _screens.shown(tmp_path, "session", "A session", page) == "![A session](pictures/session.webp)\n\n"
    assert _screens.shown(tmp_path, "another", "Nothing", page) == ""


def test_a_kept_tutorial_may_differ_in_numbers_and_not_in_words() -> None:
    _site._same_words("done in 12.1 s\n1.42 %", "done in 9 s\n1.41 %")
    with pytest.raises(SourceError, match='says "two", not "one"') as raised:
        _site._same_words("a 1\ntwo", "a 2\none")
    assert raised.value.line == 2


@pytest.mark.parametrize(
    "page",
    [
        '<script src="https://cdn.example/x.js"></script>',
        '<img srcset="a.png 1x, //cdn.example/b.png 2x">',
        '<link rel="stylesheet" href="http://cdn.example/x.css">',
        '<link rel="preconnect" href="https://fonts.example">',
        '<div style="background: url(https://cdn.example/x.png)">',
        "<style>@import 'https://cdn.example/x.css';</style>",
        "<script>fetch('https://cdn.example/x')</script>",
        "<script>image.src = '//cdn.example/x'</script>",
        "<script>request.open('GET', 'https://cdn.example/x')</script>",
        "<script>element.setAttribute('src', 'https://cdn.example/x')</script>",
        '<meta http-equiv="refresh" content="0; url=https://cdn.example">',
        '<svg><image xlink:href="https://cdn.example/x.png"/></svg>',
        '<svg><use href="https://cdn.example/x.svg#a"/></svg>',
        '<iframe src="https://cdn.example"></iframe>',
    ],
)
def test_what_a_page_would_load_from_elsewhere_is_found(page: str) -> None:
    assert len(in_page(page)) == 1


def test_what_nothing_loads_is_let_be() -> None:
    assert not in_page(
        '<a href="https://doi.org/1">x</a><link rel="canonical" href="https://x.example">'
        '<svg xmlns="http://www.w3.org/2000/svg"><use href="#a"/></svg><img src="data:image/png;base64,//x">'
        "<script>// see https://x.example\nconst space = 'http://www.w3.org/1999/xlink';</script>"
    )


def test_the_packages_own_pages_load_nothing_from_elsewhere() -> None:
    root = Path(labpipe.__file__).parents[1]
    looked_at = [
        path
        for part in ("labpipe", "pipelines")
        for path in (root / part).rglob("*")
        if path.suffix in (".html", ".css", ".js")
    ]
    assert len(looked_at) > 8
    assert [(path, list(loaded(path))) for path in looked_at if list(loaded(path))] == []
    assert {name: found for name, text in pages().items() if (found := in_page(text))} == {}


def test_without_sphinx_it_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "sphinx.application", None)
    with pytest.raises(UsageError, match=r"pip install 'labpipe\[guide\]'"):
        _site.build(tmp_path / "site")


def test_the_installed_guide_is_small_whole_and_leads_nowhere_else() -> None:
    made = pages()
    assert {"tutorial", "gallery", "experimenter", "settings", "commands", "films"} <= set(made)
    pictures = {path.name: path.stat().st_size for path in PICTURES.iterdir()}
    assert sum(len(text.encode()) for text in made.values()) + sum(pictures.values()) < 5_000_000
    shown = set()
    for name, text in made.items():
        links = set(re.findall(r'(?:href|src)="([^"]*)"', text))
        shown |= {link for link in links if link.startswith("pictures/")}
        own = {link for link in links if not link.startswith(("#", "data:", "https://", "pictures/"))}
        assert own <= {"app.css", *(f"{other}.html" for other in made)} | {
            link for link in own if link.partition(".html#")[0] in made
        }, name
        assert "<script" not in text
        assert "{download}" not in text
    assert shown == {f"pictures/{name}" for name in pictures}
    assert {f"pictures/gallery-{kind}.webp" for kind in KINDS} <= shown
    for text in made.values():
        for name, anchor in re.findall(r'href="(\w+)\.html#([^"]+)"', text):
            assert f'id="{anchor}"' in made[name], (name, anchor)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*Check CHANGES for Sphinx API")  # of the parser of the texts, not ours
def test_the_built_site_loads_nothing_from_elsewhere(
    processed_session: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("sphinx", reason="the extra guide is not installed")
    monkeypatch.setattr(_screens, "browser", lambda: None)
    monkeypatch.setattr(_tutorial, "write", lambda source: None)  # the kept one is there
    first = _site.build(tmp_path / "site", [processed_session])
    built = sorted(first.parent.glob("*.html"))
    assert len(built) > 20
    if CHROMIUM is None:
        pytest.skip("no Chromium on this machine; the site is not looked at")
    window = Browser(tmp_path / "profile")
    try:
        for path in built:
            window.open(path, width=1000)
            assert [address for address in window.requests() if not address.startswith("file://")] == [], path.name
            assert window.run("[...document.images].every(i => i.naturalWidth > 0 || i.loading === 'lazy')"), path.name
    finally:
        window.close()
