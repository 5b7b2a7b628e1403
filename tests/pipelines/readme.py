"""Renew the README's pictures and its table of the benchmark, and record what they show.

``python -m tests.pipelines.readme`` takes an idle computer, and a Chromium for the report. Tests compare the record
with figures, reports and errors as they are now, of the small sessions that they have at hand.
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
from importlib.util import find_spec
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
    "drop-first": "first impact", "drop-train": "34 bounces", "line-tapping-1": "tapping, one term",
    "line-tapping-15": "tapping, 15 terms", "velocity": "velocity", "dic": "image correlation",
    "contact-radius": "contact radius",
}  # fmt: skip
WORD = r"[^\W\d_]{2,}"


def of_figure(figure: Figure, drawing: Drawing) -> dict[str, list[float] | str]:
    """Return the words of a figure's caption; number of points, and ends and mean of x and y, of every curve."""
    found: dict[str, list[float] | str] = {"caption": " ".join(re.findall(WORD, drawing.caption(figure.id, "")))}
    if data := drawing.data():  # circles on images are no curves
        table = pd.read_csv(io.StringIO(data), keep_default_na=False, na_values={"x": "", "y": ""})
        curves = table.groupby(["panel", "curve", "x_axis", "y_axis"])
        ends = {f"{how} {axis}": (axis, how) for axis in "xy" for how in ("min", "max", "mean")}
        for name, *row in curves.agg(n=("x", "size"), **ends).itertuples(name=None):
            found[re.sub(r"[+−-]?\d+\.\d+", "#", " | ".join(name))] = [float(f"{value:.4g}") for value in row]
    return found


def of_report(page: Path) -> str:
    """Return the words of a report's first screen."""
    first = page.read_text("utf-8").partition("<main")[2].partition("What the verdict rests on")[0]
    text = html.unescape(re.sub(r"<[^>]+>", " ", re.sub(r"(?s)<(script|style|svg)\b.*?</\1>", " ", first)))
    return " ".join(re.findall(WORD, text))


def recorded() -> Any:
    return json.loads(RECORD.read_text("utf-8"))


def digests() -> dict[str, str]:
    names = re.findall(r"\]\(\.github/([^)]+)\)", README.read_text("utf-8"))
    return {name: hashlib.sha256((PICTURES / name).read_bytes()).hexdigest() for name in names}


def rows() -> list[list[str]]:
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
    lines = [f"| {' | '.join(row)} |" for row in rows() if row[2].startswith("pyidi") and not find_spec("pyidi")]
    for suite, other, ours, error, time, low, high in getattr(page.ratios(suites), "rows", ()):
        ends = "one run" if low == high else f"{low:.2g} – {high:.2g}"
        cell = "–" if time is None else f"{time:.2g} ({ends})"  # unknown where the computer was busy
        lines.append(f"| {NAMES[suite]} | {ours} | {other} | {float(f'{error:.2g}'):,g} | {cell} |")
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
