"""The guides: every command exists with its options, every example is valid, every link leads."""

import re
import shlex
import tomllib
from pathlib import Path

import click
import pytest

import labpipe
from pipelines.cli import COMMANDS, cli
from pipelines.session import open_session

ROOT = Path(labpipe.__file__).parents[1]
FOLDER = ROOT / "labpipe/documentation"
PAGES = sorted([*FOLDER.glob("*.md"), ROOT / "README.md", ROOT / "tests/CONTRIBUTING.md"])


def blocks(page: Path, language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", page.read_text("utf-8"), re.M | re.S)


def commands() -> list[tuple[str, str]]:
    found = []
    for page in PAGES:
        text = page.read_text("utf-8")
        lines = [line for block in blocks(page, "sh") for line in block.splitlines()]
        lines += re.findall(r"`(labpipe [^`\n]*)`", text) + re.findall(r"^\$ (labpipe .*)$", text, re.M)
        for line in lines:
            for part in line.split("&&"):
                words = re.split("[#|]", part)[0].strip().removeprefix(".venv/bin/")
                if words.startswith("labpipe "):
                    found.append((page.name, words))
    return sorted(set(found))


def parse(command: click.Command, words: list[str], parent: click.Context) -> None:
    """Parse the words of a command without running it; unknown options raise."""
    context = click.Context(command, info_name=command.name, parent=parent)
    _, rest, _ = command.make_parser(context).parse_args(list(words))
    if isinstance(command, click.Group) and rest:
        inner = command.get_command(context, rest[0])
        assert inner is not None, rest[0]
        parse(inner, words[words.index(rest[0]) + 1 :], context)


def test_every_command_in_a_guide_is_one() -> None:
    for page, line in commands():
        words = shlex.split(line)[1:]
        if not words[0].startswith("-"):
            parse(cli, words, click.Context(cli))
            assert words[0] in COMMANDS, (page, line)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_and_files_named_in_a_guide_are_there(page: Path) -> None:
    text = page.read_text("utf-8")
    links = re.findall(r"\]\(([^)#]+)\)", text)
    missing = [link for link in links if "://" not in link and not (page.parent / link).exists()]
    ours = "labpipe|instruments|calibration|pipelines|tests|sample_data"
    names = re.findall(rf"`((?:{ours})/[\w./-]+\.\w+|(?:{ours})/[\w/-]+/)`", text)
    missing += [name for name in names if not (ROOT / name).exists()]
    assert missing == []


def test_every_command_stands_in_the_readme() -> None:
    table = (ROOT / "README.md").read_text("utf-8")
    missing = [name for name in COMMANDS if not re.search(rf"^\| `{name}[ `]", table, re.M)]
    assert missing == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_code_in_a_guide_is_the_code_that_is_there(page: Path) -> None:
    for block in blocks(page, "python"):
        named = re.match(r"# in (\S+)\n", block)
        if named is None:
            compile(block, page.name, "exec")
            continue
        source = (ROOT / named[1]).read_text("utf-8")
        assert block.removeprefix(named[0]) in source, (page.name, block)


def test_the_session_of_the_guide_is_accepted(tmp_path: Path) -> None:
    (example,) = blocks(FOLDER / "experimenter.md", "toml")
    for name in re.findall(r'"((?:laser|calibration)/[^"]+)"', example):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("")
    (tmp_path / "session.toml").write_text(example, "utf-8")
    session = open_session(tmp_path)
    assert list(session.experiments) == ["acrylic_7mm", "warm"]
    assert set(tomllib.loads(example)) == {"labpipe", "session", "defaults", "experiments", "variants"}


def test_guides_are_short() -> None:
    printed = re.compile(r"^```text\n.*?^```", re.M | re.S)  # what commands print is looked at, not read
    texts = {page.name: printed.sub("", page.read_text("utf-8")).replace("|", " ") for page in FOLDER.glob("*.md")}
    long = {name: len(text.split()) for name, text in texts.items()}
    assert {name: words for name, words in long.items() if words >= 1500} == {}
