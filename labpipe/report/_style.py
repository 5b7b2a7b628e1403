"""The common style of figures and charts: colours, dashes, markers and sizes by role.

A line's *role* is its kind (measured, model, ...) and decides its colour, its dashes and
its marker, so that curves stay apart for colour-blind readers and in a greyscale print. The
interactive charts of a page and the figures of a paper take their colours from the same table.

The hues follow Okabe and Ito, *Color universal design* (2008), darkened on white and lightened
on black until thin lines keep a contrast of at least 3 to 1.
"""

import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cache
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args

from labpipe.errors import InputError
from labpipe.report._tables import MINUS, SUPERSCRIPT

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Role = Literal["measured", "model", "residual", "reference", "repeat"]
ROLES: tuple[str, ...] = get_args(Role)

COLUMN_WIDTHS_MM = {1: 85.0, 2: 175.0}


@dataclass(frozen=True, slots=True)
class LineLook:
    """Look of one curve.

    ``light``, ``dark``: colour on a white and on a black page, ``#rrggbb``; ``dash``: lengths of strokes and gaps in
    points, none for a solid line; ``marker``: ``circle``, ``square``, ``triangle`` or ``diamond``, ``filled`` or
    hollow; ``width``: of the line in points.
    """

    light: str
    dark: str
    dash: tuple[float, ...]
    marker: str
    filled: bool
    width: float


_BY_ROLE: dict[str, LineLook] = {
    "measured": LineLook("#0066a6", "#5cb8f0", (), "circle", True, 1.3),
    "model": LineLook("#cc4e00", "#f5a45d", (6.0, 4.0), "square", False, 1.3),
    "residual": LineLook("#8a3a6b", "#e29cc4", (), "diamond", True, 1.0),
    "reference": LineLook("#404040", "#c4c4c4", (2.0, 2.0), "triangle", False, 1.1),
    "repeat": LineLook("#7f97a8", "#7d93a3", (), "circle", True, 0.7),
}
_CYCLE: tuple[LineLook, ...] = (
    _BY_ROLE["measured"],
    replace(_BY_ROLE["model"], dash=(7.0, 3.0)),
    LineLook("#00795a", "#4fd0a8", (7.0, 2.0, 1.5, 2.0), "triangle", True, 1.3),
    LineLook("#8a3a6b", "#e29cc4", (3.5, 2.0), "diamond", False, 1.3),
    LineLook("#8f6400", "#e3c14a", (11.0, 3.0), "circle", False, 1.3),
    LineLook("#2b2b2b", "#dddddd", (1.5, 2.0), "square", True, 1.3),
)

# From cold to warm: hue and, less so, lightness change steadily; every colour keeps 3 to 1.
_SCALE = {
    "light": ("#17408f", "#5a3ea8", "#9a2f8a", "#c2364f", "#b85c00"),
    "dark": ("#7fa8ff", "#b79bff", "#ee8fd0", "#ff9c94", "#ffc247"),
}


def level_look(level: float, role: str | None = None) -> LineLook:
    """Return the look of a curve of a family: colours by its place from 0 (cold) to 1 (warm), all else by its role."""
    place = min(max(level, 0.0), 1.0) * 4
    first = min(int(place), 3)
    mixed = []
    for colours in (_SCALE["light"], _SCALE["dark"]):
        parts = [[int(colour[i : i + 2], 16) for i in (1, 3, 5)] for colour in colours[first : first + 2]]
        mixed.append("#" + "".join(f"{round(a + (b - a) * (place - first)):02x}" for a, b in zip(*parts, strict=True)))
    return replace(_BY_ROLE[role or "measured"], light=mixed[0], dark=mixed[1])


def looks(roles: Sequence[str | None]) -> tuple[LineLook, ...]:
    """Give every curve of one chart its look, by their roles in drawing order; an unknown one raises InputError.

    A role that occurs once keeps its own colour. When it occurs several times (four heights, measured and modelled),
    the colour distinguishes the curves of one role and the dashes still the roles: the second measured curve and the
    second model curve share a colour. Curves without a role take colour, dashes and marker from a cycle of six.
    """
    known = list(roles)
    return tuple(_look(role, known[:n].count(role), several=known.count(role) > 1) for n, role in enumerate(known))


def _look(role: str | None, count: int, *, several: bool) -> LineLook:
    if role is not None and role not in _BY_ROLE:
        raise InputError(f'unknown role "{role}"; known roles: {", ".join(ROLES)}, or None')
    varied = _CYCLE[count % len(_CYCLE)]
    look = varied if role is None else _BY_ROLE[role]
    # Repeats are a crowd that is read as one; they never take the cycle's colours.
    is_varied = several and role not in (None, "repeat")
    return replace(look, light=varied.light, dark=varied.dark, marker=varied.marker) if is_varied else look


@cache
def _settings() -> Any:
    """Return matplotlib's settings for journal figures."""
    from matplotlib import rc_params_from_file

    return rc_params_from_file(str(Path(__file__).parent / "assets/figure.mplstyle"), use_default_template=False)


@contextmanager
def figure_style(columns: Literal[1, 2] = 1, aspect: float = 0.68) -> Iterator[None]:
    """Set matplotlib up for a journal figure while the ``with`` block runs.

    Parameters
    ----------
    columns : 1 or 2
        One column is 85 mm wide, two columns 175 mm.
    aspect : float
        Height of the figure as a fraction of its width.

    Raises
    ------
    InputError
        `columns` is neither 1 nor 2, or `aspect` is not positive.

    Examples
    --------
    >>> from matplotlib.figure import Figure
    >>> with figure_style(columns=1):
    ...     figure = Figure()
    >>> round(float(figure.get_figwidth()) * 25.4)
    85
    """
    if columns not in COLUMN_WIDTHS_MM or not aspect > 0:
        message = f"figure_style: columns={columns}, aspect={aspect}; expected 1 or 2 columns and a positive aspect"
        raise InputError(message)
    from cycler import cycler
    from matplotlib import rc_context

    width = COLUMN_WIDTHS_MM[columns] / 25.4
    curves = cycler(color=[look.light for look in _CYCLE]) + cycler(
        linestyle=[matplotlib_dash(look) for look in _CYCLE]
    )
    settings = dict(_settings()) | {"figure.figsize": (width, width * aspect), "axes.prop_cycle": curves}
    with rc_context(settings):
        yield


def matplotlib_dash(look: LineLook) -> Any:
    """Return the dashes in matplotlib's form (``"-"`` or an offset with lengths)."""
    # matplotlib scales dashes with the line width; the table states them in points.
    return "-" if not look.dash else (0.0, tuple(length / look.width for length in look.dash))


def line_arguments(role: Role | None = None, *, style: str = "line", count: int = 0) -> dict[str, Any]:
    """Return keyword arguments for ``Axes.plot`` that draw a curve of this role.

    Parameters
    ----------
    role : str or None
        Kind of curve.
    style : {"line", "points", "both"}
        Draw the line, the markers or both.
    count : int
        How many curves of the same role were drawn before; 0 keeps the role's own colour.

    Examples
    --------
    >>> line_arguments("measured", style="points")["linestyle"]
    'none'
    """
    look = _look(role, count, several=count > 0)
    arguments: dict[str, Any] = {
        "color": look.light,
        "linewidth": look.width,
        "linestyle": "none" if style == "points" else matplotlib_dash(look),
    }
    if style != "line":
        arguments["marker"] = {"circle": "o", "square": "s", "triangle": "^", "diamond": "D"}[look.marker]
        arguments["markerfacecolor"] = look.light if look.filled else "white"
        arguments["markeredgecolor"] = look.light
        arguments["markeredgewidth"] = 0.8
    return arguments


# Without these, every file would carry the moment of its making.
_METADATA = {"pdf": {"CreationDate": None}, "svg": {"Date": None}, "png": {"Software": None}}


def _write_plain_numbers(figure: "Figure") -> None:
    """Have all ticks write raised digits in place of formulas, whose parsing takes a third of the time of a figure."""

    def plain(text: str) -> str:
        bare = re.sub(r"\$|\\mathdefault|\\(?=times)", "", text).replace("times", "×")
        raised = re.sub(r"\^\{([^{}]+)\}", lambda found: found[1].replace(MINUS, "-").translate(SUPERSCRIPT), bare)
        number = re.sub(r"[{}]", "", raised)
        return number if "$" in text and re.fullmatch(rf"[0-9.,+\-{MINUS}×⁰¹²³⁴⁵⁶⁷⁸⁹⁻ eE]*", number) else text

    axes = [axis for one in figure.axes for axis in (one.xaxis, one.yaxis)]
    forms: list[Any] = [form for axis in axes for form in (axis.get_major_formatter(), axis.get_minor_formatter())]
    for form in forms:
        form.format_ticks = lambda values, write=form.format_ticks: [plain(text) for text in write(values)]
        form.get_offset = lambda write=form.get_offset: plain(write())


def figure_bytes(figure: "Figure", file_format: str) -> bytes:
    """Draw a figure into memory; the same figure gives the same bytes.

    Parameters
    ----------
    figure : matplotlib Figure
        The figure.
    file_format : {"pdf", "svg", "png"}
        The file format.

    Raises
    ------
    InputError
        The format is none of the three.
    """
    return _drawn(figure, [file_format])[0]


def _drawn(figure: "Figure", formats: Sequence[str]) -> list[bytes]:
    """Draw a figure in several formats; it is laid out once, which takes as long as drawing."""
    from matplotlib import rc_context
    from matplotlib.backend_bases import get_registered_canvas_class
    from matplotlib.layout_engine import PlaceHolderLayoutEngine

    if unknown := [name for name in formats if name not in _METADATA]:
        raise InputError(f'unknown figure format "{unknown[0]}"; expected one of {", ".join(_METADATA)}')
    _write_plain_numbers(figure)
    keys = ("svg.hashsalt", "svg.fonttype", "pdf.fonttype", "path.simplify")
    settings: Any = {key: _settings()[key] for key in keys}
    engine, canvas, resolution = figure.get_layout_engine(), figure.canvas, figure.dpi
    drawn = []
    with rc_context(settings):
        try:
            if engine is not None and not isinstance(engine, PlaceHolderLayoutEngine):
                engine.execute(figure)  # the places alone: nothing is drawn for them
                figure.set_layout_engine("none")
            for name in formats:
                # ``savefig`` would draw everything once more before, for the layout that is known.
                drawing: Any = get_registered_canvas_class(name)(figure)
                figure.set_dpi(300.0 if name == "png" else resolution)
                getattr(drawing, f"print_{name}")(target := BytesIO(), metadata=_METADATA[name])
                drawn.append(target.getvalue())
        finally:
            figure.set_canvas(canvas)
            figure.set_dpi(resolution)
            if engine is not None:
                figure.set_layout_engine(engine)
    return drawn


def save_figure(
    figure: "Figure", path_stem: str | Path, formats: Sequence[str] = ("pdf", "svg", "png")
) -> tuple[Path, ...]:
    """Write a figure as ``path_stem.pdf``, ``.svg``, ``.png``, each file whole or not at all; return the paths.

    Raises
    ------
    InputError
        A format is none of the three; nothing is written then.
    """
    from labpipe.files import write_bytes

    paths = tuple(Path(f"{path_stem}.{name}") for name in formats)
    for path, data in zip(paths, _drawn(figure, formats), strict=True):
        write_bytes(path, data)
    return paths
