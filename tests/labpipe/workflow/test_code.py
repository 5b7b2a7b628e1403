"""The code behind a function: a changed line counts where it is reached, and nowhere else."""

import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from labpipe.errors import InstallationError, SourceError
from labpipe.workflow import code
from labpipe.workflow._definitions import OURS, Module
from labpipe.workflow.code import Code, Identity
from pipelines.experiments import KINDS
from tests.by_day import by_day

ROOT = Path(__file__).parents[3]
FUNCTIONS = sorted({stage.function for kind in KINDS.values() for stage in kind.stages})
PAGES = {s.function for kind in KINDS.values() for s in kind.stages if s.output == "page"}

PACKAGE = {
    "__init__.py": "from toys.face import helper as shown\nfrom toys.other import unrelated\n",
    "face/__init__.py": "from toys.face.home import helper, idle\n__all__ = ['helper', 'idle']\n",
    "face/home.py": ("def helper(x):\n    return x + CONSTANT\n\n\nCONSTANT = 1\n\n\ndef idle():\n    return 0\n"),
    "other.py": "def unrelated():\n    return 1\n",
    "stages.py": (
        "from toys import face\n"
        "from toys.other import unrelated\n\n\n"
        "def first(x):\n    return face.helper(x)\n\n\n"
        "def second():\n    return unrelated()\n\n\n"
        "def later():\n    from toys.other import unrelated as name\n\n    return name()\n\n\n"
        "def chosen(name):\n    return load(TABLE[name])\n\n\n"
        "TABLE = {'one': 'toys.other:unrelated'}\n\n\n"
        "def load(text):\n    return text\n\n\n"
        "def drawn():\n    return files('toys.face')\n\n\n"
        "from importlib.resources import files\n"
    ),
    "face/style.css": "body {}\n",
}


@pytest.fixture
def toys(tmp_path: Path) -> Path:
    for name, text in PACKAGE.items():
        (tmp_path / "toys" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "toys" / name).write_text(text)
    return tmp_path


def behind(root: Path, function: str) -> Identity:
    return Code(search=[str(root)]).behind(f"toys.{function}")


def edit(path: Path, old: str, new: str) -> None:
    text = path.read_text("utf-8")
    assert old in text
    path.write_text(text.replace(old, new), "utf-8")


CHECKED = "from typing import TYPE_CHECKING\n\nif TYPE_CHECKING:\n    import toys.face.home"
UNUSED = "import toys.other as unused"
ALL = ("first", "second", "later", "chosen", "drawn")


def touched(root: Path, change: Callable[[], object]) -> set[str]:
    """Functions of the toys whose code a change reaches."""
    before = {name: behind(root, f"stages:{name}") for name in ALL}
    change()
    return {name for name in ALL if behind(root, f"stages:{name}") != before[name]}


@pytest.mark.parametrize(
    ("name", "old", "new", "reached"),
    [
        ("face/home.py", "x + CONSTANT", "x - CONSTANT", {"first"}),
        ("face/home.py", "CONSTANT = 1", "CONSTANT = 2", {"first"}),
        ("face/home.py", "return 0", "return 1", set()),
        ("other.py", "return 1", "return 2", {"second", "later", "chosen"}),
        ("stages.py", "def load(text):", "def load(text, more=1):", {"chosen"}),
        ("stages.py", "face.helper(x)", "face.helper(-x)", {"first"}),
        ("stages.py", "import unrelated as name", "import gone as name", {"later"}),
        ("face/__init__.py", "import helper, idle", "import idle as helper, idle", {"first"}),
        ("face/style.css", "{}", "{ }", {"drawn"}),
        # What does not run counts for nothing.
        ("face/home.py", "    return x", "    # because\n    return x", set()),
        ("face/home.py", "def helper(x):", 'def helper(x: int) -> "int":\n    """Add."""', set()),
        ("other.py", "def un", f"{CHECKED}\n\n\ndef un", set()),
        # What runs with the module counts for everything of it.
        ("other.py", "def un", "print()\n\n\ndef un", {"second", "later", "chosen"}),
        ("stages.py", "def first", f"{UNUSED}\n\n\ndef first", {"first", "drawn"}),
    ],
)
def test_a_change_reaches_what_depends_on_it(toys: Path, name: str, old: str, new: str, reached: set[str]) -> None:
    assert touched(toys, lambda: edit(toys / "toys" / name, old, new)) == reached


def test_a_module_that_is_handed_on_counts_whole(toys: Path) -> None:
    edit(toys / "toys/stages.py", "face.helper(x)", "getattr(face, x)()")
    home = toys / "toys/face/home.py"
    assert touched(toys, lambda: edit(home, "return 0", "return 1")) == {"first"}


def test_a_local_name_is_not_the_module_s(toys: Path) -> None:
    edit(toys / "toys/stages.py", "def first(x):\n    return", "def first(face):\n    return")
    home = toys / "toys/face/home.py"
    assert touched(toys, lambda: edit(home, "CONSTANT = 1", "CONSTANT = 2")) == set()


@pytest.mark.parametrize(
    "text",
    [
        "_HOMES = {'helper': 'home'}\n\n\ndef __getattr__(name):\n    return _HOMES[name]\n",
        "if TYPE_CHECKING:\n    from toys.face.home import helper\nelse:\n    __getattr__ = lazily(__name__)\n",
    ],
)
def test_a_face_that_imports_on_first_use_leads_to_the_module(toys: Path, text: str) -> None:
    (toys / "toys/face/__init__.py").write_text(text)
    home = toys / "toys/face/home.py"
    assert touched(toys, lambda: edit(home, "return 0", "return 1")) == set()
    assert touched(toys, lambda: edit(home, "CONSTANT = 1", "CONSTANT = 2")) == {"first"}


def test_imports_in_a_circle_end(toys: Path) -> None:
    (toys / "toys/other.py").write_text("from toys import stages\n\n\ndef unrelated():\n    return stages.second()\n")
    found = behind(toys, "stages:second").modules
    assert {"toys.stages", "toys.other"} <= set(found)


def test_an_object_s_methods_count_where_it_is_annotated(toys: Path) -> None:
    (toys / "toys/other.py").write_text(
        "class Settings:\n    size: int = 1\n\n    @property\n    def double(self):\n"
        "        return 2 * self.size\n\n\ndef unrelated():\n    return 1\n"
    )
    edit(toys / "toys/stages.py", "import unrelated\n\n", "import Settings, unrelated\n\n")
    edit(toys / "toys/stages.py", "def first(x):", "def first(x: Settings):")
    other = toys / "toys/other.py"
    assert touched(toys, lambda: edit(other, "int = 1", "int = 2")) == set()
    assert touched(toys, lambda: edit(other, "2 *", "3 *")) == {"first"}


def test_a_decorator_of_ours_may_have_kept_the_function(toys: Path) -> None:
    edit(toys / "toys/other.py", "def un", "KEPT = []\n\n\n@KEPT.append\ndef registered():\n    return 5\n\n\ndef un")
    other = toys / "toys/other.py"
    assert touched(toys, lambda: edit(other, "return 5", "return 6")) == {"second", "later", "chosen"}


def test_libraries_count_by_their_version(toys: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    edit(toys / "toys/other.py", "def un", "import numpy as np\nimport json\n\n\ndef un")
    edit(toys / "toys/other.py", "return 1", "return json.dumps(np.pi)")
    before = behind(toys, "stages:second")
    assert set(before.libraries) == {"numpy"}
    monkeypatch.setattr(code, "_version", lambda top: "1.2.3")
    assert behind(toys, "stages:second").libraries == {"numpy": "1.2.3"}
    assert behind(toys, "stages:second").modules == before.modules


def test_a_syntax_error_is_told_with_its_line(toys: Path) -> None:
    edit(toys / "toys/other.py", "return 1", "return (")
    with pytest.raises(SourceError, match=r"other\.py:2: is no Python"):
        behind(toys, "stages:second")
    assert behind(toys, "stages:first").modules


def test_unchanged_code_is_not_read_again(toys: Path, tmp_path: Path) -> None:
    memory = tmp_path / "code.json"
    past = time.time() - 100
    for path in (toys / "toys").rglob("*"):
        os.utime(path, (past, past))

    def look() -> Code:
        made = Code(memory, search=[str(toys)])
        made.behind("toys.stages:first")
        return made

    first = look()
    assert first.n_read > 0
    first.save()
    if memory.exists():  # the inode's time is new: it is kept only once that is old
        pytest.fail("files changed just now, so nothing may be kept of them")
    time.sleep(2.1)
    first = look()
    first.save()
    assert memory.exists()
    again = look()
    assert again.n_read == 0
    edit(toys / "toys/face/home.py", "x + CONSTANT", "x - CONSTANT")
    assert look().n_read > 0
    memory.write_bytes(memory.read_bytes()[:-9])
    assert look().behind("toys.stages:first") == Code(search=[str(toys)]).behind("toys.stages:first")


def test_a_new_session_knows_what_another_has_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(code, "_COMPILED", tmp_path / "compiled")
    monkeypatch.setattr(sys, "dont_write_bytecode", False)
    function = "labpipe.files:seal"
    first = Code(tmp_path / "one.json")
    first.behind(function)
    first.save()
    second = Code(tmp_path / "two.json")
    assert second.behind(function) == first.behind(function)
    assert (first.n_read > 0, second.n_read) == (True, 0)
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    third = Code(tmp_path / "three.json")
    third.behind(function)
    assert third.n_read == first.n_read


def test_what_one_run_has_found_no_other_forgets(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Not a session that knew less before, and not one that follows the packages of a plug-in too."""
    monkeypatch.setattr(code, "_COMPILED", tmp_path / "compiled")
    monkeypatch.setattr(sys, "dont_write_bytecode", False)
    runs = [("one", "labpipe.files:seal"), ("two", "labpipe.text:survey"), ("one", "labpipe.text:parse_rows")]
    for session, function in [*runs, ("three", "tomlkit:parse")]:
        made = Code(tmp_path / f"{session}.json")
        made.behind(function)
        made.save()
    new = Code(tmp_path / "new.json")
    for _, function in runs:
        new.behind(function)
    assert new.n_read == 0


def test_a_file_changed_under_a_running_program_is_refused(toys: Path) -> None:
    made = Code(search=[str(toys)])
    modules = made.behind("toys.stages:first").modules
    made.refuse_changed(modules)
    edit(toys / "toys/face/home.py", "x + CONSTANT", "x - CONSTANT")
    with pytest.raises(InstallationError, match=r"home\.py was changed while this program ran"):
        made.refuse_changed(modules)


def test_a_plug_in_counts_where_any_instrument_may_read(monkeypatch: pytest.MonkeyPatch) -> None:
    function = "pipelines.experiments.shared.laser_readings:read_laser"
    assert "toy_vibrometer" not in Code().behind(function).modules
    monkeypatch.syspath_prepend(ROOT / "tests/plugins/toy_instrument")
    assert "toy_vibrometer" in Code().behind(function).modules


# --- the packages themselves --------------------------------------------------------------------


@pytest.fixture(scope="module")
def copy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("copy")
    for name in OURS:
        shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
    return folder


@pytest.fixture(scope="module")
def before(copy: Path) -> dict[str, Identity]:
    return identities(copy)


def identities(root: Path) -> dict[str, Identity]:
    made = Code(search=[str(root)])
    return {function: made.behind(function) for function in FUNCTIONS}


def differing(copy: Path, before: dict[str, Identity], name: str, old: str, new: str) -> set[str]:
    path = copy / name
    text = path.read_bytes()
    try:
        edit(path, old, new)
        now = identities(copy)
    finally:
        path.write_bytes(text)
    return {function for function in FUNCTIONS if now[function] != before[function]}


def test_a_helper_of_the_signals_reaches_the_stages_that_use_it(copy: Path, before: dict[str, Identity]) -> None:
    found = differing(copy, before, "labpipe/signals/_events.py", "1 / fall", "2 / fall")
    assert {f.rpartition(":")[2] for f in found} == {"bounces", "displacement", "comparison"}
    assert found == {f for f in FUNCTIONS if "labpipe.signals._events" in before[f].modules}
    assert not {f for f in found if f.endswith((":readings", ":track", ":radius"))}


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [("labpipe/report/assets/page.css", "{", "{ "), ("labpipe/report/templates/page.html", "<body", "<body ")],
)
def test_an_asset_reaches_every_page_and_nothing_else(
    copy: Path, before: dict[str, Identity], name: str, old: str, new: str
) -> None:
    assert differing(copy, before, name, old, new) == PAGES


def test_comments_and_docstrings_reach_nothing(copy: Path, before: dict[str, Identity]) -> None:
    assert differing(copy, before, "labpipe/units.py", '"""Table', '"""Words. Table') == set()
    assert differing(copy, before, "labpipe/units.py", "\nclass ", "\n# why\nclass ") == set()


def test_a_material_of_the_library_reaches_the_simulations(copy: Path, before: dict[str, Identity]) -> None:
    found = differing(copy, before, "labpipe/materials/library/nbr.toml", "labpipe_", " labpipe_")
    assert {f.rpartition(":")[2] for f in found} >= {"model"}
    assert not {f for f in found if f.endswith((":readings", ":displacement"))}


def test_no_stage_reaches_the_tables_of_all_stages(before: dict[str, Identity]) -> None:
    packages = ("labpipe", "instruments", "calibration", "pipelines")
    whole = sum(1 for package in packages for _ in (ROOT / package).rglob("*.py"))
    for function, found in before.items():
        assert "pipelines.stages" not in found.modules, function
        assert len(found.modules) < whole / 5, function


@pytest.mark.parametrize("version", by_day(["3.13", "3.12"], 0, 1))
def test_other_versions_of_python_find_the_same(version: str, copy: Path, before: dict[str, Identity]) -> None:
    kept = sorted(Path.home().glob(f".pyenv/versions/{version}.*/bin/python"))
    python = str(kept[-1]) if kept else shutil.which(f"python{version}")
    if python is None:
        pytest.skip(f"no Python {version} beside this one")
    script = (
        "import json, sys; from labpipe.workflow.code import Code\n"
        "made = Code(search=[sys.argv[1]])\n"
        "print(json.dumps({f: made.behind(f).modules for f in sys.argv[2:]}))"
    )
    told = subprocess.run(
        [python, "-c", script, str(copy), *FUNCTIONS], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert json.loads(told.stdout) == {name: before[name].modules for name in FUNCTIONS}


def test_a_digest_does_not_depend_on_how_fields_are_listed() -> None:
    """Pinned, so that a version of Python that parses otherwise is noticed at once."""
    text = b"def f(a, /, b=1, *c, d: int = 2, **e):\n    return f'{a!r:>{b}}' if b else [*c]\n"
    assert Module(text, "m").definition("f")[0] == "7f63c9f6a5d1acc2"
