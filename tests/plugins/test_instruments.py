"""An instrument of another distribution takes part in every verb; a broken one harms nothing."""

import json
import shutil
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import instruments
from instruments import keyence
from labpipe import plugins
from labpipe.errors import SourceError, UsageError
from pipelines.cli import cli
from pipelines.session import describe
from tests.pipelines.small import write_small

HOME = Path(__file__).parent / "toy_instrument"


def visible(monkeypatch: pytest.MonkeyPatch, *places: Path) -> None:
    """Make distributions visible as an installation would, and forget what was known before."""
    for place in places:
        monkeypatch.syspath_prepend(str(place))
    instruments.added.cache_clear()


@pytest.fixture(autouse=True)
def _forget(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setattr(instruments, "_FAILED", set())
    yield
    monkeypatch.undo()
    sys.modules.pop("toy_vibrometer", None)
    instruments.added.cache_clear()


@pytest.fixture
def toy(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    visible(monkeypatch, HOME)
    return


def as_toy(source: Path, target: Path) -> None:
    """Write what a Keyence file holds as the toy would."""
    found = keyence.read(source)
    micrometres = found["out1"].values * 1e6
    rows = ["lost" if np.isnan(x) else f"{x:.2f}" for x in micrometres]
    head = f"toy vibrometer\nstart {found.attrs['start']}\n"
    head += f"interval_s {found.attrs['sampling_interval']!r}"
    target.write_text("\n".join([head, *rows]) + "\n", "utf-8")


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The small session, its drops recorded by the toy."""
    folder = write_small(tmp_path_factory.mktemp("toy") / "session")
    for path in sorted((folder / "laser").glob("*.csv")):
        as_toy(path, path)
    return folder


@pytest.fixture
def session(recorded: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(recorded, tmp_path / "session"))


@contextmanager
def telling() -> Iterator[list[str]]:
    """Collect what is told of plug-ins; nothing else may be told."""
    told: list[str] = []
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("error")
        warnings.simplefilter("always", plugins.PluginWarning)
        yield told
        told += [str(warning.message) for warning in caught]


def run(*line: str) -> str:
    done = CliRunner().invoke(cli, line)
    assert done.exit_code == 0, done.output
    return done.output


@pytest.mark.usefixtures("toy")
def test_it_is_inspected_and_exported(session: Path, tmp_path: Path) -> None:
    path = session / "laser/drop_1.csv"
    assert instruments.identify(path) == "toy_vibrometer"
    found = json.loads(run("inspect", str(path), "--json"))
    said = (found["reader"], found["kind"], found["rate"])
    assert said == ("toy_vibrometer", "table", "20000 Hz")
    twice = json.loads(run("inspect", str(path), "--json", "--option", "gain=2"))
    ranges = [next(v for v in each["variables"] if v["name"] == "out1") for each in (found, twice)]
    assert ranges[1]["max"] == pytest.approx(2 * ranges[0]["max"], rel=1e-12)
    run("export", str(path), "--out", str(tmp_path / "out"), "--format", "json")
    (exported,) = (tmp_path / "out").glob("*.json")
    assert json.loads(json.loads(exported.read_text())["remarks"]["provenance"])["reader"] == ("toy_vibrometer")
    with pytest.raises(UsageError, match='toy_vibrometer has no option "cycle"; it has gain'):
        describe(path, {"cycle": "50 us"})
    path.write_text(path.read_text() + "twelve\n")
    with pytest.raises(SourceError, match='found "twelve", expected a number or lost'):
        instruments.read(path)


CHANGED = "from toy_vibrometer import INSTRUMENT as toy\nfrom dataclasses import replace\nINSTRUMENT = replace(toy, {})"
BROKEN: dict[str, tuple[str, str]] = {
    "import": ("import nothing_of_this_name", "ModuleNotFoundError: No module named"),
    "type": ("INSTRUMENT = 3", "is a int, expected a Instrument"),
    "content": (
        CHANGED.format("name='other', content='colour'"),
        'its content is "colour"; known are displacement, force',
    ),
    "ours": (CHANGED.format("name='keyence'"), 'the name "keyence" is taken'),
}


@pytest.fixture
def broken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, session: Path) -> Callable[[str], None]:
    """Install a distribution whose instrument is made by some source."""

    def install(source: str) -> None:
        home = tmp_path / "site"
        (home / "zz_lab-2.0.dist-info").mkdir(parents=True)
        (home / "zz_lab-2.0.dist-info/METADATA").write_text("Metadata-Version: 2.1\nName: zz-lab\nVersion: 2.0\n")
        (home / "zz_lab-2.0.dist-info/entry_points.txt").write_text("[labpipe.instruments]\nbad = zz_lab:INSTRUMENT\n")
        (home / "zz_lab.py").write_text(source + "\n")
        monkeypatch.delitem(sys.modules, "zz_lab", raising=False)
        visible(monkeypatch, HOME, home)

    return install


@pytest.mark.parametrize("fault", BROKEN)
def test_a_broken_one_is_named_once_and_left_out(
    fault: str, broken: Callable[[str], None], session: Path, tmp_path: Path
) -> None:
    source, reason = BROKEN[fault]
    broken(source)
    with telling() as told:
        assert instruments.identify(session / "laser/drop_1.csv") == "toy_vibrometer"
        instruments.identify(session / "laser/drop_2.csv")
    (line,) = told
    assert line.startswith('the plug-in "bad" of zz-lab 2.0 is left out: ')
    assert reason in line
    assert instruments.by_name("keyence") is keyence.INSTRUMENT
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", plugins.PluginWarning)
        listed = json.loads(run("doctor", str(tmp_path), "--json"))["plugins"]
    assert listed == ['the plug-in "toy_vibrometer" of toy-instrument 1.0 is used', line]


def test_one_whose_sniff_raises_is_named_once_and_left_out(
    broken: Callable[[str], None], session: Path, tmp_path: Path
) -> None:
    broken(CHANGED.format("name='bad', sniff=lambda head, path: head[9999]"))
    letter = tmp_path / "letter.txt"
    letter.write_text("dear reader\n")
    with telling() as told:
        for _ in range(2):
            with pytest.raises(SourceError, match="no instrument recognises the content"):
                instruments.identify(letter)
        assert instruments.identify(session / "laser/drop_1.csv") == "toy_vibrometer"
    (line,) = told
    assert "zz-lab 2.0 is left out: its sniff raised IndexError" in line
