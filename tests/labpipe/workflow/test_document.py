"""Every value of a TOML file is found on its line."""

import tomllib

import pytest
from hypothesis import given, strategies as st

from labpipe.workflow.document import line_index, placed

DOCUMENT = '''\
# a comment with [brackets] and = signs
labpipe = 1
[session] # behind it another
notes = """
two lines = "quoted"
\\""" end"""
'odd key' = 'literal \\'
"quoted.key" = "a # no comment \\" still"
a.b . c = 2

[experiments.drop]
laser = [
  "r1.csv", # first

  [1,
   2],
]
sphere = { radius = "1 mm", more = [1,
  { x = 3 }] }
[[runs]]
n = 1
[[runs]]
[runs.part]
date = 1979-05-27T07:32:00Z'''

LINES = {
    (): 1,
    ("session",): 3,
    ("session", "notes"): 4,
    ("session", "odd key"): 7,
    ("session", "quoted.key"): 8,
    ("session", "a", "b", "c"): 9,
    ("experiments", "drop"): 11,
    ("experiments", "drop", "laser", 0): 13,
    ("experiments", "drop", "laser", 1, 0): 15,
    ("experiments", "drop", "laser", 1, 1): 16,
    ("experiments", "drop", "sphere", "radius"): 18,
    ("experiments", "drop", "sphere", "more", 1, "x"): 19,
    ("runs", 0, "n"): 21,
    ("runs", 1): 22,
    ("runs", 1, "part", "date"): 24,
}


@pytest.mark.parametrize("ends", ["\n", "\r\n"])
def test_each_value_is_on_its_line(ends: str) -> None:
    found = line_index(DOCUMENT.replace("\n", ends))
    assert {place: found[place] for place in LINES} == LINES


@given(st.text("a=[]{}\"'#.,\n\\ 1", max_size=40))
def test_whatever_the_parser_accepts_is_indexed_whole(text: str) -> None:
    try:
        tree = tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        return
    assert {place for place, _ in placed(tree)} <= line_index(text).keys()
