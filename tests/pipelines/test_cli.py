"""The command line as a user meets it: outputs, exit codes, JSON, and what it does not import."""

import importlib.machinery
import importlib.util
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from pipelines.cli import COMMANDS
from tests.pipelines.command import run

HEAVY = ("numpy", "scipy", "xarray", "pandas", "matplotlib", "numba", "cv2", "netCDF4")


def test_quiet_prints_errors_alone(capsys: pytest.CaptureFixture[str], small_session: Path) -> None:
    assert run(capsys, "--quiet", "plan", str(small_session)) == (0, "", "")
    assert run(capsys, "plan", str(small_session), "--quiet") == (0, "", "")
    code, out, err = run(capsys, "--quiet", "plan", str(small_session), "--only", "no_such")
    assert (code, out) == (2, "")
    assert "no_such" in err
    assert json.loads(run(capsys, "--quiet", "plan", str(small_session), "--json")[1])["rows"]


def test_a_warning_is_a_sentence_told_once(tmp_path: Path) -> None:
    text = "f (Hz)\tE' (mPa)\tE'' (mPa)\tT (°C)\n1\t900\t45\t20\n10\t950\t40\t20\n"
    (tmp_path / "sweep.csv").write_text(text, "utf-8")
    command = [sys.executable, "-m", "labpipe", "init", str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    told = done.stderr.splitlines()
    assert {line.split(":")[0] for line in told} == {"warning"}
    assert len(told) == len(set(told)) == 1
    quiet = subprocess.run([*command, "--force", "--quiet"], capture_output=True, text=True, check=True)
    assert quiet.stderr == ""


@pytest.mark.parametrize("name", sorted(COMMANDS))
def test_every_command_has_help_with_an_example(capsys: pytest.CaptureFixture[str], name: str) -> None:
    code, out, _ = run(capsys, name, "--help")
    assert code == 0
    assert re.search(rf"^  +labpipe {name}", out, re.MULTILINE)  # on a line of its own
    assert "\\b" not in out
    assert "--json" in out or "Commands:" in out


@pytest.mark.parametrize("arguments", [["--help"], ["plan", "SESSION"], ["process", "--help"]])
def test_quick_commands_import_nothing_numerical(arguments: list[str], small_session: Path) -> None:
    script = (
        "import sys\n"
        "from pipelines.cli import main\n"
        "try:\n    main(sys.argv[1:])\n"
        "except SystemExit as left:\n    assert not left.code, left.code\n"
        f"heavy = sorted(set({HEAVY}) & set(sys.modules))\n"
        "assert not heavy, heavy\n"
    )
    words = [str(small_session) if a == "SESSION" else a for a in arguments]
    done = subprocess.run([sys.executable, "-c", script, *words], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_a_misspelt_command_is_answered_with_the_nearest(capsys: pytest.CaptureFixture[str]) -> None:
    code, _, err = run(capsys, "proccess", "x")
    assert code == 2
    assert 'Did you mean "process"?' in err


def test_bad_configuration_is_exit_3_and_says_so_in_json(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    (tmp_path / "session.toml").write_text("labpipe = 1\n[experiments.a]\nkind = 'nothing'\n\"\\u001b[2Jevil\" = 1\n")
    code, out, _ = run(capsys, "plan", str(tmp_path), "--json")
    assert code == 3
    assert json.loads(out)["error"]["problems"]
    code, out, err = run(capsys, "plan", str(tmp_path))
    assert (code, out) == (3, "")
    assert "session.toml:3" in err
    assert "\x1b" not in err  # control characters of a file do not reach the terminal


def test_what_a_file_leaves_unsaid_is_asked_for_as_it_is_typed(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    bare = tmp_path / "bare.csv"
    bare.write_text("1,+00.1234\n2,+00.1235\n3,+00.1236\n")
    line = ["inspect", str(bare)]
    for asked, typed in (
        ("If you know the instrument that wrote it, name it: --instrument keyence (", "--instrument keyence"),
        ("Give one for every output, in order: --unit mm.", "--unit mm"),
        ('Give it: --cycle "50 us".', "--cycle=50 us"),
    ):
        code, _, err = run(capsys, *line)
        assert (code, asked in err) == (3, True), err
        line += [typed] if "=" in typed else typed.split()
    code, out, _ = run(capsys, *line, "--out", str(tmp_path / "a.png"), "--json")
    assert (code, json.loads(out)["duration"]) == (0, "0.0001 s")
    code, out, _ = run(capsys, "export", *line[1:], "--out", str(tmp_path), "--format", "json")
    assert code == 0
    bare.write_text("1,+00.1234\n2,+00.1235\n3,+00.1236")
    code, _, err = run(capsys, *line)
    assert "drop this row with --option allow_incomplete=true" in err
    code, out, _ = run(capsys, *line, "--option", "allow_incomplete=true")
    assert (code, "the last line is cut" in out) == (0, True)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--option", "storage_factor=x"], 'the option storage_factor of keyence cannot be "x"; expected a whole nu'),
        (["--option", "colour=3"], 'keyence has no option "colour"; it has cycle, units, stor'),
        (["--instrument", "tarot"], 'no instrument "tarot"; known are mach1, phantom,'),
    ],
)
def test_an_option_that_there_is_not_is_usage(
    capsys: pytest.CaptureFixture[str], small_session: Path, options: list[str], said: str
) -> None:
    file = str(small_session / "laser/drop_1.csv")
    for command in ("inspect", "export"):
        code, _, err = run(capsys, command, file, *options)
        assert (code, said in err) == (2, True), err


@pytest.mark.parametrize(
    "arguments",
    [
        ("plan", "SESSION"),
        ("process", "SESSION", "--jobs", "0"),
        ("watch", "SESSION", "--until-done", "--looks", "2", "--every", "0.01", "--jobs", "0"),
        ("export", "SESSION", "--stage", "bounces", "--out", "OUT"),
        ("figures", "--list"),
        ("bench", "--list"),
        ("sample",),
        ("doctor", "SESSION"),
        ("completion", "fish"),
        ("inspect", "LASER"),
    ],
    ids=lambda arguments: arguments[0],
)
def test_json_is_one_document_and_nothing_else(
    capsys: pytest.CaptureFixture[str], session_copy: Path, tmp_path: Path, arguments: list[str]
) -> None:
    places = {
        "SESSION": str(session_copy),
        "LASER": str(session_copy / "laser/drop_1.csv"),
        "OUT": str(tmp_path / "out"),
    }
    code, out, err = run(capsys, *(places.get(a, a) for a in arguments), "--json")
    assert code == 0, err
    assert json.loads(out)
    assert err == ""


@pytest.mark.parametrize("arguments", [("proces", "x"), ("plan",), ("export", ".", "--format", "x")])
def test_a_wrong_line_is_a_document_too(capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...]) -> None:
    code, out, err = run(capsys, *arguments, "--json")
    assert (code, err) == (2, "")
    found = json.loads(out)
    assert found["exit_code"] == 2
    assert found["error"]["type"] == "UsageError"
    assert found["error"]["message"]


def test_samples_are_listed_and_go_into_new_folders_only(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    code, out, _ = run(capsys, "sample")
    assert code == 0
    assert "core" in out
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine/notes.txt").write_text("precious")
    code, _, err = run(capsys, "sample", "demo", str(tmp_path / "mine"))
    assert code == 2
    assert "not empty" in err
    assert (tmp_path / "mine/notes.txt").read_text() == "precious"


@pytest.mark.parametrize(("name", "source"), [("instruments", "import nothing_of_this_name"), ("pipelines", "B = 1")])
def test_a_foreign_package_of_our_name_is_told(tmp_path: Path, name: str, source: str) -> None:
    """As when InstrumentKit, which installs `instruments` too, came after labpipe."""
    (tmp_path / name).mkdir()
    face = tmp_path / name / "__init__.py"
    face.write_text(source)
    path = os.pathsep.join([str(tmp_path), *sys.path])
    for json_option in ([], ["--json"]):
        command = [sys.executable, "-m", "labpipe", "doctor", *json_option]
        environment = os.environ | {"PYTHONPATH": path}
        done = subprocess.run(command, check=False, capture_output=True, text=True, cwd=tmp_path, env=environment)
        said = json.loads(done.stdout)["error"]["message"] if json_option else done.stderr
        assert done.returncode == 3
        assert f"the module `{name}` at {face} is not labpipe's" in said
        assert "use a separate environment" in said
        assert "Traceback" not in done.stderr


def test_a_package_that_another_one_took_away_is_told(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    for found in (None, importlib.machinery.ModuleSpec("instruments", None, is_package=True)):
        monkeypatch.setattr(importlib.util, "find_spec", lambda _, found=found: found)
        code, _, err = run(capsys, "doctor")
        assert (code, "`instruments` of labpipe is missing or has lost its files" in err) == (3, True)


@pytest.mark.slow
def test_demo_goes_on_with_its_own_session_and_leaves_a_foreign_one(
    capsys: pytest.CaptureFixture[str], session_copy: Path
) -> None:
    code, _, err = run(capsys, "demo", str(session_copy))
    assert (code, "not empty" in err) == (2, True)
    settings = session_copy / "session.toml"
    settings.write_text(settings.read_text().replace("Small (", "Demonstration ("))
    code, out, err = run(capsys, "demo", str(session_copy), "--json")
    assert code == 0, err
    assert set(json.loads(out)["reports"]) == {"drop", "nbr"}


def test_several_sessions_are_one_document_and_a_broken_one_stops_no_other(
    session_copy: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    broken = tmp_path / "broken"
    broken.mkdir()
    folders = [str(broken), str(session_copy), f"{session_copy}/."]
    code, out, _ = run(capsys, "process", *folders, "--json")
    document = json.loads(out)
    assert code == document["exit_code"] == 1
    refused, whole = document["sessions"]
    assert (refused["session"], refused["exit_code"]) == (str(broken), 3)
    assert refused["error"]["type"] == "SourceError"
    assert (whole["session"], whole["exit_code"]) == (str(session_copy), 0)
    code, out, err = run(capsys, "process", *folders)
    assert code == 1
    assert out.startswith(f"{broken}:\n{session_copy}:\n")
    assert "there is no such file" in err
