"""The tutorial: from unsorted files to a figure, run while it is written.

What the page shows of commands is what they printed, and its pictures are of what they wrote.
"""

import os
import re
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from click.testing import CliRunner

from labpipe import files
from labpipe.errors import InputError
from labpipe.workflow.plan import page_name
from pipelines.cli import cli
from pipelines.guide._screens import shown, shrink
from pipelines.rig import sample

_SESSION = "my-session"
_SHOWN = 12, 12
"""First and last lines of what a command printed."""
_HERE = ("--jobs", "0")
"""Added to a command while this page is written: it is computed in this process."""


def write(source: Path) -> None:
    """Write the page, with its pictures, into the folder of the site's sources.

    Raises
    ------
    InputError
        A command of the tutorial did not end as the text says.
    """
    with tempfile.TemporaryDirectory(prefix="labpipe-tutorial-") as folder, _inside(Path(folder)):
        files.write_text(source / "tutorial.md", "".join(_parts(source, Path(folder))))


@contextmanager
def _inside(folder: Path) -> Iterator[None]:
    before = Path.cwd()
    os.chdir(folder)
    try:
        yield
    finally:
        os.chdir(before)


def _parts(source: Path, folder: Path) -> Iterator[str]:
    made, session = folder / "made", folder / _SESSION
    sample("core", made)
    for part in made.iterdir():  # as they come from the instruments
        if part.is_dir() and part.name not in ("calibration", "truth"):
            shutil.copytree(part, session / part.name)
    yield (
        "# A first session\n\nA folder of files from the laboratory becomes calibrated results, the simulation that "
        "belongs to them, and pages that say whether both agree. Everything below was run while this page was "
        "written; the data are synthetic, made by the virtual rig. To follow it, let the rig record, and take what the "
        "instruments wrote:\n\n```sh\nlabpipe sample core made\nmkdir my-session\n"
        "cp -r made/laser made/mach1 made/dma my-session\n```\n\n## 1. What is there\n\n"
        "The folder holds what the instruments wrote, and nothing else. `inspect` says what a file is:\n\n"
    )
    yield _run("inspect", f"{_SESSION}/laser/acrylic_1p5mm_1.csv")
    yield (
        "## 2. What no file says\n\n`init` recognises the instruments, groups the repeats and writes a commented "
        "`session.toml`. What no file contains (the sphere's mass and radius, the laser's inclination) it asks for at "
        "a terminal; here every answer is left open:\n\n"
    )
    yield _run("init", _SESSION, "--no-ask")
    yield (
        "The lines to fill in are marked `FILL`; until then `plan` and `process` name each of them. A number with ± "
        "carries its standard uncertainty to every result. Filled in, one experiment reads:\n\n"
    )
    shutil.copytree(made / "calibration", session / "calibration", dirs_exist_ok=True)
    shutil.copyfile(made / "session.toml", session / "session.toml")
    yield f"```toml\n{_first_experiment(session / 'session.toml')}\n```\n\n"
    yield (
        "The answers that belong to these recordings lie beside them; to go on with those in place of your own:\n\n"
        "```sh\ncp -r made/session.toml made/calibration my-session\n```\n\n"
        "## 3. Process\n\n`plan` says what would run and why:\n\n"
    )
    yield _run("plan", _SESSION)
    yield "`process` runs it:\n\n"
    yield _run("process", _SESSION, here=_HERE)
    yield "Only what a change can reach is computed again; a second `process` does nothing.\n\n"
    yield "## 4. Can it be believed?\n\nThe session's page has a line for each experiment, with its verdict:\n\n"
    yield shown(source, "session", "The first page of a session", session / "labpipe/index.html")
    yield "Each report says first whether the record can be believed and whether the model agrees, and why:\n\n"
    yield shown(source, "report", "A report", session / "labpipe" / page_name("acrylic_7mm"))
    yield "`compare` puts all experiments beside their models:\n\n"
    # Its rows stand in the order of their deviations: which come first hangs on the last digit.
    yield _run("compare", _SESSION, here=_HERE, shown_lines=(5, 1))
    yield shown(source, "compare", "Measurement against model", session / "labpipe/compare.html")
    yield (
        "## 5. A mistake\n\nIn `session.toml` the fall height of `acrylic_1p5mm` is typed as 15 mm in place of 1.5 mm. "
        "The result is still computed and shown, marked, and the exit code is 1:\n\n"
    )
    text = (session / "session.toml").read_text("utf-8")
    files.write_text(session / "session.toml", text.replace('height = "1.5', 'height = "15'))
    yield _run("process", _SESSION, "--only", "acrylic_1p5mm", here=_HERE, code=1)
    page = session / "labpipe" / page_name("acrylic_1p5mm")
    yield shown(source, "impossible", "A report that says impossible", page)
    files.write_text(session / "session.toml", text)
    yield "With the height as it was, `process` takes up what it had computed before.\n\n"
    yield (
        "## 6. Into the thesis\n\nFigures are drawn by their number, with the data beside them; `export` writes one "
        "table of all quantities, as `xlsx` or for LaTeX:\n\n"
    )
    yield _run("figures", "3.10", "--session", _SESSION, "--out", "figures", here=_HERE)
    shrink(folder / "figures/3.10.png", source / "pictures/figure.webp")
    yield "![Displacement of the sphere for four heights, laser and model](pictures/figure.webp)\n\n"
    yield _run("export", _SESSION, "--format", "tex")
    yield f"```latex\n{_head(session / 'labpipe/export/quantities.tex')}\n```\n"


def _run(*line: str, here: tuple[str, ...] = (), code: int = 0, shown_lines: tuple[int, int] = _SHOWN) -> str:
    """Run a command, with options that no reader needs, and return it with what it printed."""
    result = CliRunner().invoke(cli, [*line, *here], standalone_mode=False)
    ended = result.return_value if isinstance(result.return_value, int) else 0
    if result.exception is not None or ended != code:
        message = f"labpipe {' '.join(line)}: ended with {result.exception or ended}, not {code}:\n{result.output}"
        raise InputError(message)
    said = result.output.replace(str(Path.cwd()) + "/", "").splitlines()
    first, last = shown_lines
    if len(said) > first + last:
        said = [*said[:first], f"... ({len(said) - first - last} lines)", *said[-last:]]
    return "```text\n$ labpipe " + " ".join(line) + "\n" + "\n".join(said) + "\n```\n\n"


def _first_experiment(path: Path) -> str:
    lines = path.read_text("utf-8").splitlines()
    begins = [i for i, line in enumerate(lines) if re.fullmatch(r"\[experiments\.\w+\]", line)]
    return "\n".join(lines[begins[0] : begins[1]]).strip()


def _head(path: Path) -> str:
    lines = [line for line in path.read_text("utf-8").splitlines() if not line.startswith("%")]
    return "\n".join([*lines[:10], "..."])
