"""Renew the README's pictures and its table of the benchmark, and record what they show.

``python -m tests.pipelines.readme`` takes an idle computer, and a Chromium for the report.
Tests compare the record with figures, reports and errors as they are now: each with the same things of the small
sessions, which are at hand, so that no campaign is made to find a stale picture.
"""

import datetime
import hashlib
import html
import io
import json
import re
import shutil
import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pandas as pd

from pipelines.bench.measure import Suite
from pipelines.figures import Figure
from pipelines.figures.drawing import Drawing

ROOT = Path(__file__).parents[2]
README, PICTURES, RECORD = ROOT / "README.md", ROOT / ".github", Path(__file__).parent / "readme.json"
FIGURES = {"3.10": 1000, "3.14": 500, "3.16": 1000, "B.2": 1000}  # px wide
ADVICE = "the README is stale; renew its pictures and its table: python -m tests.pipelines.readme"
HEAD = "| what | ours | other method | its error / ours | its time / ours |\n|---|---|---|---|---|\n"
NAMES = {
    "drop-first": "first impact",
    "drop-train": "34 bounces",
    "line-tapping-1": "tapping, one term",
    "line-tapping-15": "tapping, 15 terms",
    "velocity": "velocity",
    "dic": "image correlation",
    "contact-radius": "contact radius",
}


def of_figure(figure: Figure, drawing: Drawing) -> dict[str, list[float] | str]:
    """Return the words of a figure's caption; number of points, and ends and mean of x and y, of every curve."""
    found: dict[str, list[float] | str] = {"caption": _words(drawing.caption(figure.id, figure.title))}
    if data := drawing.data():  # circles on images are no curves
        table = pd.read_csv(io.StringIO(data), keep_default_na=False, na_values={"x": "", "y": ""})
        curves = table.groupby(["panel", "curve", "x_axis", "y_axis"])
        ends = {f"{how} {axis}": (axis, how) for axis in "xy" for how in ("min", "max", "mean")}
        for name, *row in curves.agg(n=("x", "size"), **ends).itertuples(name=None):
            found[re.sub(r"[+−-]?\d+\.\d+", "#", " | ".join(name))] = [float(f"{value:.4g}") for value in row]
    return found


def _words(text: str) -> str:
    return " ".join(re.findall(r"[^\W\d_]{2,}", text))


def of_report(page: Path) -> str:
    """Return the words of a report's first screen."""
    first = page.read_text("utf-8").partition("<main")[2].partition("What the verdict rests on")[0]
    text = html.unescape(re.sub(r"<[^>]+>", " ", re.sub(r"(?s)<(script|style|svg)\b.*?</\1>", " ", first)))
    return _words(text)


def recorded() -> dict[str, Any]:
    """Return the digest of every picture, and what the figures and the report of the small sessions showed."""
    found: dict[str, Any] = json.loads(RECORD.read_text("utf-8"))
    return found


def digests() -> dict[str, str]:
    """Return the digest of every picture of the README."""
    names = re.findall(r"\]\(\.github/([^)]+)\)", README.read_text("utf-8"))
    return {name: hashlib.sha256((PICTURES / name).read_bytes()).hexdigest() for name in names}


def rows() -> list[list[str]]:
    """Return the cells of the README's table of the benchmark."""
    return [line.strip("| ").split(" | ") for line in _table(README.read_text("utf-8")).splitlines()]


def _table(text: str) -> str:
    return text.partition(HEAD)[2].partition("\n\n")[0]


def stale(suites: Iterable[Suite]) -> list[str]:
    """Name rows of the README's table whose ratio of errors is another one now."""
    said = []
    for suite in suites:
        errors = {f"{p.group}: {p.setting}": p.error for p in suite.points} | {p.setting: p.error for p in suite.points}
        for name, ours, other, ratio, _ in rows():
            if name == NAMES.get(suite.name) and {ours, other} <= errors.keys():
                now = errors[other] / errors[ours]
                if abs(now / float(ratio.replace(",", "")) - 1.0) > 0.1:
                    said.append(f"{name}, {other}: {ratio} -> {now:.2g}")
    return said


def _ratio(middle: float, low: float | None, high: float | None) -> str:
    return f"{middle:.2g} " + ("(one run)" if low == high or low is None else f"({low:.2g} – {high:.2g})")


def main() -> None:
    """Draw all anew."""
    from pipelines.bench import page
    from pipelines.bench.parts import PARTS, measure_all
    from pipelines.figures import figures, make
    from pipelines.guide.__main__ import of_page, write_picture
    from pipelines.rig import sample
    from pipelines.session import process
    from tests.pipelines.small import write_small

    measured, failures = measure_all(list(PARTS), True, print)
    assert not failures, failures
    suites = [suite for part in measured for suite in part.suites if suite.name in NAMES]
    (PICTURES / "bench-drop.svg").write_bytes(page.draw(next(s for s in suites if s.name == "drop-first")))
    kept = {(name, other): (ours, ratio, time) for name, ours, other, ratio, time in rows()}
    here = {point.group for suite in suites for point in suite.points}
    table: dict[tuple[str, str], tuple[str, str, str]] = {}
    for suite, other, ours, error, *taken in getattr(page.ratios(suites), "rows", ()):
        key = NAMES[suite], other
        before = kept.get(key, ("", "", "–"))[2]  # stays where the computer was busy
        table[key] = ours, f"{float(f'{error:.2g}'):,g}", before if taken[0] is None else _ratio(*taken)
    table |= {key: row for key, row in kept.items() if key[1].startswith("pyidi") and "pyidi" not in here}
    lines = (
        f"| {name} | {ours} | {other} | {ratio} | {time} |" for (name, other), (ours, ratio, time) in table.items()
    )
    text = README.read_text("utf-8").replace(_table(README.read_text("utf-8")), "\n".join(lines))
    day = f"{datetime.date.today():%-d %B %Y}"
    README.write_text(re.sub(r"(?<=`labpipe bench --quick` on )\d+ \w+ \d+", day, text), "utf-8")
    record: dict[str, Any] = {}
    with tempfile.TemporaryDirectory(prefix="labpipe-readme-") as place:
        folder = Path(place)
        sample("thesis", folder / "thesis")
        for name in ("thesis-small", "core"):
            shutil.copytree(ROOT / "sample_data" / name, folder / name)
        figures(FIGURES, session=folder / "thesis", out=folder / "figures", jobs=2)
        figures(FIGURES, session=folder / "thesis-small", out=folder / "small", jobs=2)
        for one, width in FIGURES.items():
            write_picture(folder / f"figures/{one}.png", PICTURES / f"figure-{one}.png", width)
        shelf = make.Shelf.of(folder / "again", folder / "thesis-small")
        for state in make.states(shelf, make.chosen(FIGURES)):
            record[state.id] = of_figure(state.figure, make.draw(shelf, state.figure, state.experiments))
        process(folder / "core", only=["acrylic_1p5mm"])
        of_page((folder / "core/labpipe/reports/acrylic_1p5mm.html").as_uri(), PICTURES / "report.png", height=1500)
        process(write_small(folder / "session"), only=["drop"])
        record["report"] = of_report(folder / "session/labpipe/reports/drop.html")
    RECORD.write_text(json.dumps({"pictures": digests()} | record, indent=1, ensure_ascii=False) + "\n", "utf-8")


if __name__ == "__main__":
    main()
