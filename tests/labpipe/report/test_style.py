"""One look for charts and figures: roles, widths, files that repeat."""

from pathlib import Path

import numpy as np
import pytest
from matplotlib import rcParams
from matplotlib.figure import Figure

from labpipe.errors import InputError
from labpipe.report import figure_style, line_arguments, save_figure
from labpipe.report._style import ROLES, figure_bytes, level_look, looks


def luminance(colour):
    parts = [int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    linear = [p / 12.92 if p <= 0.04045 else ((p + 0.055) / 1.055) ** 2.4 for p in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def contrast(a, b):
    bright, dim = sorted((luminance(a), luminance(b)), reverse=True)
    return (bright + 0.05) / (dim + 0.05)


def test_every_colour_is_visible_on_white_and_on_black():
    for look in (*looks(ROLES), *looks([None] * 6), *map(level_look, np.linspace(0, 1, 11).tolist())):
        assert contrast(look.light, "#ffffff") >= 3.0
        assert contrast(look.dark, "#14181c") >= 3.0


def test_roles_differ_without_colour():
    told = {(look.dash, look.marker, look.width) for look in looks(ROLES)}
    assert len(told) == len(ROLES)
    cycle = looks([None] * 6)
    assert len({(look.dash, look.marker, look.filled) for look in cycle}) == 6


def test_figures_have_the_width_of_a_journal_column_and_known_roles_only():
    before = rcParams["font.size"]
    for columns, millimetres in ((1, 85.0), (2, 175.0)):
        with figure_style(columns):
            assert Figure().get_figwidth() * 25.4 == pytest.approx(millimetres)
            assert rcParams["font.size"] == 8.0
    assert rcParams["font.size"] == before
    with pytest.raises(InputError, match='unknown role "guess"; known roles: measured, model'):
        line_arguments("guess")


@pytest.mark.parametrize("file_format", ["pdf", "svg"])
def test_the_same_figure_gives_the_same_bytes(file_format):
    made = []
    for _ in range(2):
        with figure_style(1):
            figure = Figure()
            axes = figure.subplots()
            axes.plot([0, 1], [0, 1], **line_arguments("model"))
            axes.plot([0, 1], [1, 0], **line_arguments("measured", style="points"))
        made.append(figure_bytes(figure, file_format))
    assert made[0] == made[1]
    assert b"CreationDate" not in made[0]


def test_figures_are_saved_in_every_format_or_not_at_all(tmp_path):
    figure = Figure()
    with pytest.raises(InputError, match='unknown figure format "bmp"'):
        save_figure(figure, tmp_path / "f", ("png", "bmp"))
    assert list(tmp_path.iterdir()) == []
    written = save_figure(figure, tmp_path / "fig_2.4", ("pdf", "png"))
    assert written == (Path(tmp_path / "fig_2.4.pdf"), Path(tmp_path / "fig_2.4.png"))
    assert written[1].read_bytes().startswith(b"\x89PNG")
