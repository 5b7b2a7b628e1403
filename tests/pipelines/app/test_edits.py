"""Changes of session.toml: comments and order stay, and what cannot be done is refused."""

import tomllib

import pytest

from labpipe.errors import InputError
from pipelines.app import _edits as edits
from pipelines.session import SETTINGS

TEXT = """\
labpipe = 1  # version
[session]
title = "t"  # of the day

# the first one
[experiments.a]
kind = "ball_drop"
laser = [
  "a1.csv",  # the good one
  "a2.csv",
]
height = "7 mm"  # proposed
[experiments.a.sphere]
material = "acrylic"

# the second one
[experiments.b]
kind = "ball_drop"
laser = ["b1.csv"]
plate_from = "a"
"""


def test_a_value_is_set_where_it_stands() -> None:
    changed = edits.set_value(TEXT, ("experiments", "a", "height"), "7 ± 0,1 mm")
    assert changed == TEXT.replace('"7 mm"  # proposed', '"7 ± 0,1 mm"  # proposed')
    assert edits.set_value(changed, ("experiments", "a", "height"), None) == TEXT.replace(
        'height = "7 mm"  # proposed\n', ""
    )
    made = edits.set_value(TEXT, ("experiments", "b", "sphere", "radius"), "9 mm")
    assert tomllib.loads(made)["experiments"]["b"]["sphere"] == {"radius": "9 mm"}
    assert "# the second one" in made


def test_windows_line_ends_stay() -> None:
    changed = edits.set_value(TEXT.replace("\n", "\r\n"), ("experiments", "a", "height"), "8 mm")
    assert changed == TEXT.replace('"7 mm"', '"8 mm"').replace("\n", "\r\n")


def test_an_experiment_is_renamed_where_it_is_and_where_it_is_named() -> None:
    changed = edits.rename(TEXT, "a", "Kugel 7 mm", SETTINGS)
    assert changed == TEXT.replace("experiments.a", 'experiments."Kugel 7 mm"').replace(
        'plate_from = "a"', 'plate_from = "Kugel 7 mm"'
    )


def test_a_recording_that_came_later_is_added_behind_the_others() -> None:
    changed = edits.add(TEXT, "a", "laser", ["a2.csv", "a3.csv"])
    assert changed == TEXT.replace('  "a2.csv",\n', '  "a2.csv",\n  "a3.csv",\n')  # no other line is touched
    assert "# the second one" in changed
    with pytest.raises(InputError, match="no list of recordings"):
        edits.add(TEXT, "a", "height", ["a3.csv"])


def test_an_experiment_is_left_out_with_its_remark() -> None:
    changed = edits.remove(TEXT, "a")
    assert "first one" not in changed
    assert changed.startswith(TEXT[: TEXT.index("# the first one")])
    assert changed.endswith(TEXT[TEXT.index("# the second one") :])
    with pytest.raises(InputError, match="this is the last one"):
        edits.remove(changed, "b")


def test_recordings_are_split_off_and_merged_again() -> None:
    apart = edits.separate(TEXT, "a", "c", "laser", ["a2.csv"])
    tree = tomllib.loads(apart)["experiments"]
    assert list(tree) == ["a", "c", "b"]
    assert (tree["a"]["laser"], tree["c"]["laser"]) == (["a1.csv"], ["a2.csv"])
    assert tree["c"]["sphere"] == tree["a"]["sphere"]
    together = tomllib.loads(edits.join(apart, "a", "c", "laser"))
    assert together == tomllib.loads(TEXT)
    for names in ([], ["a1.csv", "a2.csv"], ["z.csv"]):
        with pytest.raises(InputError, match="choose some"):
            edits.separate(TEXT, "a", "c", "laser", names)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda: edits.rename(TEXT, "a", "b", SETTINGS), "already"),
        (lambda: edits.rename(TEXT, "z", "y", SETTINGS), 'no experiment "z"'),
        (lambda: edits.rename(TEXT, "a", " ", SETTINGS), "a name is needed"),
        (lambda: edits.rename('experiments.a.kind = "x"\n', "a", "b", SETTINGS), "by hand"),
        (lambda: edits.set_value(TEXT, ("labpipe", "x"), "1"), "no such table"),
        (lambda: edits.set_value("= 3", ("x",), "1"), "is not TOML"),
    ],
)
def test_what_cannot_be_done_is_refused(change, words: str) -> None:
    with pytest.raises(InputError, match=words):
        change()
