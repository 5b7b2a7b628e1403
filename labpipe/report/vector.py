"""Shapes and texts of a still picture, written as SVG.

All lengths are whole numbers of a twentieth of a point: a third of what a good printer resolves,
and half the bytes of decimal numbers.
"""

from collections.abc import Iterator
from html import escape
from typing import TYPE_CHECKING

import numpy as np

from labpipe.report.style import LineLook

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Numbers = NDArray[np.float64]

UNITS = 20
"""Units of the picture per point."""
# Coordinates outside the picture are cut to this many of its widths.
_FARTHEST = 20_000.0
# Advance widths of DejaVu Sans, the widest of the fonts that the pictures name, in em.
_WIDTHS = {
    character: width
    for width, characters in (
        (0.29, "ijlI'|"),
        (0.35, " ,.·:;/\\fJ"),
        (0.41, "()[]tr-!⁰¹²³⁴⁵⁶⁷⁸⁹"),
        (0.52, '*_"°–sz?⁻cL'),
        (0.84, "#+<=>~−±×ωwMm%W@…OQDGN"),
    )
    for character in characters
}
_USUAL_WIDTH = 0.64
_FONT = "DejaVu Sans,Arial,Helvetica,sans-serif"
_HEAD = '<?xml version="1.0" encoding="utf-8"?>\n'


def units(points: float) -> int:
    """Turn points into units of the picture."""
    return round(points * UNITS)


def text_width(text: str, size: float) -> float:
    """Estimate how wide a text is, in points; `size` is that of its font."""
    return size * sum(_WIDTHS.get(character, _USUAL_WIDTH) for character in text)


def write_text(x: float, y: float, text: str, size: float, anchor: str = "start") -> str:
    """Write one line of text; (x, y) in points is the foot of its start, middle or end."""
    placed = "" if anchor == "start" else f' text-anchor="{anchor}"'
    place = f'x="{units(x)}" y="{units(y)}" font-size="{units(size)}"'
    return f"<text {place}{placed}>{escape(text)}</text>"


def picture(width: float, height: float, parts: list[str]) -> bytes:
    """Wrap shapes into an SVG file of the given size in points, on a white ground."""
    w, h = units(width), units(height)
    head = (
        f'{_HEAD}<svg xmlns="http://www.w3.org/2000/svg" width="{width:.2f}pt" '
        f'height="{height:.2f}pt" viewBox="0 0 {w} {h}" font-family="{_FONT}" '
        'stroke-linejoin="round">'
    )
    ground = f'<path fill="#fff" d="M0 0h{w}v{h}h-{w}z"/>'
    return "\n".join([head, ground, *parts, "</svg>\n"]).encode()


def whole(x: "Numbers", y: "Numbers") -> "NDArray[np.int64]":
    """Bring places in points (n,) to units of the picture (n, 2)."""
    both = np.stack([x, y], axis=1)
    return np.rint(np.clip(both, -_FARTHEST, _FARTHEST) * UNITS).astype(np.int64)


def runs(x: "Numbers", *curves: "Numbers") -> Iterator[slice]:
    """Go through the stretches without a gap."""
    is_shown = np.isfinite(x)
    for curve in curves:
        is_shown = is_shown & np.isfinite(curve)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], is_shown, [False]])))
    for start, stop in edges.reshape(-1, 2):
        yield slice(int(start), int(stop))


def line(points: "NDArray[np.int64]") -> str:
    """Join places (n, 2) by a line; what falls onto one place is written once."""
    steps = np.diff(points, axis=0)
    steps = steps[steps.any(axis=1)]
    begin = f"M{points[0, 0]} {points[0, 1]}"
    if not len(steps):
        # A line of no length shows nothing; one unit shows as a dot of the line's width.
        return f"{begin}h1"
    return f"{begin}l" + " ".join(map(str, steps.ravel().tolist())).replace(" -", "-")


def curve_path(x: "Numbers", y: "Numbers") -> str:
    """Join places in points by a line with its gaps."""
    return "".join(line(whole(x[part], y[part])) for part in runs(x, y))


def area_path(x: "Numbers", low: "Numbers", high: "Numbers") -> str:
    """Outline the area between two curves, in points."""
    outlines = []
    for part in runs(x, low, high):
        there, back = whole(x[part], low[part]), whole(x[part], high[part])
        outlines.append(line(np.concatenate([there, back[::-1]])) + "z")
    return "".join(outlines)


def stroke(path: str, look: LineLook) -> str:
    """Draw a path as the line of a look."""
    return (
        f'<path fill="none" stroke="{look.light}" stroke-width="{units(look.width)}"'
        f'{_dashes(look)} d="{path}"/>'
    )


def _dashes(look: LineLook) -> str:
    lengths = " ".join(str(units(length)) for length in look.dash)
    return f' stroke-dasharray="{lengths}"' if lengths else ""


# Markers 3.2 points across, about (0, 0).
_SHAPES = {
    "circle": "M-32 0a32 32 0 1 0 64 0a32 32 0 1 0-64 0z",
    "square": "M-32-32h64v64h-64z",
    "triangle": "M0-32l32 64h-64z",
    "diamond": "M0-45l45 45l-45 45l-45-45z",
}


def marker_definition(name: str, look: LineLook) -> str:
    """Define a marker that :func:`marked` names."""
    face = look.light if look.filled else "#fff"
    return (
        f'<marker id="{name}" markerUnits="userSpaceOnUse" overflow="visible"><path '
        f'd="{_SHAPES[look.marker]}" fill="{face}" stroke="{look.light}" '
        f'stroke-width="{units(0.8)}"/></marker>'
    )


def marked(points: "NDArray[np.int64]", name: str) -> str:
    """Put a marker at each of the places (n, 2)."""
    if not len(points):
        return ""
    steps = np.diff(points, axis=0)
    begin = f"M{points[0, 0]} {points[0, 1]}"
    rest = " ".join(map(str, steps.ravel().tolist())).replace(" -", "-")
    path = f"{begin}l{rest}" if rest else f"{begin}h0"
    ends = f'marker-start="url(#{name})" marker-mid="url(#{name})"'
    last = f' marker-end="url(#{name})"' if rest else ""
    return f'<path fill="none" {ends}{last} d="{path}"/>'
