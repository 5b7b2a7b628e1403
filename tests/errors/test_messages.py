"""The exact message of every wrong input: where, what was found, what was expected, what to do."""

import pickle
import re
import tomllib
import warnings
from pathlib import Path

import pytest

from labpipe.errors import LabpipeError
from tests.errors.wrong_inputs import CASES

EXPECTED = tomllib.loads((Path(__file__).parent / "messages.toml").read_text("utf-8"))


def test_there_is_a_message_for_each_case() -> None:
    assert set(CASES) == set(EXPECTED)


@pytest.mark.parametrize("name", sorted(CASES))
def test_a_wrong_input_is_answered_with_its_message(name: str, tmp_path: Path) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with pytest.raises(LabpipeError) as caught:
            CASES[name](tmp_path)
    text = str(caught.value).replace(str(tmp_path), "FOLDER")
    assert (type(caught.value).__name__, text) == (EXPECTED[name]["error"], EXPECTED[name]["message"])


def test_no_library_speaks_in_a_message() -> None:
    foreign = re.compile(r"RFC ?3339|Traceback|NoneType|0x[0-9a-f]{8}|msgspec|tomllib")
    assert [name for name, entry in EXPECTED.items() if foreign.search(entry["message"])] == []


def test_errors_survive_a_process_boundary(tmp_path: Path) -> None:
    """Workers send errors to the command line, which shows the same text."""
    for name in ("field_missing", "keyence_letter_in_number", "material_of_no_name"):
        folder = tmp_path / name
        folder.mkdir()
        with pytest.raises(LabpipeError) as caught:
            CASES[name](folder)
        again = pickle.loads(pickle.dumps(caught.value))  # noqa: S301
        assert (type(again), str(again)) == (type(caught.value), str(caught.value))
