"""Small edits of a session's recordings and settings, as mistakes of a laboratory make them."""

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np

from labpipe.arrays import Floats

HEAD = 9  # lines above the first reading
ALL = ("laser/drop_1.csv", "laser/drop_2.csv", "laser/drop_3.csv")

Edit = Callable[[Path], None]


def header(old: str, new: str, files: tuple[str, ...] = ALL) -> Edit:
    """Replace text in the header of recordings."""

    def edit(folder: Path) -> None:
        for name in files:
            lines = (folder / name).read_text("utf-8").splitlines()
            head = "\n".join(lines[:HEAD])
            assert old in head
            _write(folder / name, head.replace(old, new).splitlines() + lines[HEAD:])

    return edit


def cells(change: Callable[[list[str]], list[str]], files: tuple[str, ...] = ALL, *, counted: bool = True) -> Edit:
    """Change the texts of the readings; points are numbered again, and counted again if wanted."""

    def edit(folder: Path) -> None:
        for name in files:
            lines = (folder / name).read_text("utf-8").splitlines()
            texts = change([line.partition(",")[2] for line in lines[HEAD:]])
            head = lines[:HEAD]
            if counted:
                head = [re.sub(r"^Data count,\d+", f"Data count,{len(texts)}", line) for line in head]
            _write(folder / name, head + [f"{i},{text}" for i, text in enumerate(texts, 1)])

    return edit


def values(change: Callable[[Floats], Floats], files: tuple[str, ...] = ALL, decimals: int = 4) -> Edit:
    """Change the readings [mm], written with so many decimals."""

    def changed(texts: list[str]) -> list[str]:
        return [f"{x:+.{decimals}f}" for x in change(np.array([float(t) for t in texts]))]

    return cells(changed, files)


def setting(old: str, new: str, name: str = "session.toml") -> Edit:
    """Replace the first occurrence of a text in a TOML file."""

    def edit(folder: Path) -> None:
        text = (folder / name).read_text("utf-8")
        assert old in text
        (folder / name).write_text(text.replace(old, new, 1), "utf-8")

    return edit


def _write(path: Path, lines: list[str]) -> None:
    path.write_text("\n".join(lines) + "\n", "utf-8")
