"""Small edits of the text of Mach-1 files, of their records and of what a session says of them."""

import re
from collections.abc import Callable
from pathlib import Path

from tests.mistakes.recordings import Edit

Row = tuple[float, float, float]
"""Time [s], position [mm] and force [N] as a file has them."""
_ROW = re.compile(r"^-?[0-9.]+\t-?[0-9.]+\t-?[0-9.]+$", re.MULTILINE)


def columns(change: Callable[[float, float, float], Row], name: str) -> Edit:
    """Change every row of a file."""

    def changed(found: re.Match[str]) -> str:
        return "\t".join(f"{v:.6f}" for v in change(*map(float, found[0].split("\t"))))

    return rewritten(lambda text: _ROW.sub(changed, text), name)


def rewritten(change: Callable[[str], str], name: str) -> Edit:
    """Change the whole text of a file."""

    def edit(folder: Path) -> None:
        text = (folder / name).read_text("utf-8")
        other = change(text)
        assert other != text
        (folder / name).write_text(other, "utf-8")

    return edit


def rows(change: Callable[[list[str]], list[str]], name: str, block: int = -1) -> Edit:
    """Change the list of rows of one block, by its number among those with data."""

    def changed(text: str) -> str:
        begin = [m.end() for m in re.finditer(r"<DATA>\n.*\n", text)][block]
        end = text.index("<END DATA>", begin)
        return text[:begin] + "\n".join(change(text[begin:end].splitlines())) + "\n" + text[end:]

    return rewritten(changed, name)
