"""From a stick of 51 files to verdicts by the browser alone, every click and character counted.

``python -m tests.pipelines.app.stopwatch`` prints the table of the guide. The time of a person is
that of the keystroke-level model (Card, Moran & Newell, Communications of the ACM 23 (1980) 396,
doi:10.1145/358886.358895), with two times of our own for what that model leaves out: a value that
is looked up in the notebook, and a part of the page that is read. The computer's time is apart.
"""

import json
import sys
import tempfile
import threading
import time
from dataclasses import dataclass
from pathlib import Path

from pipelines.app import open as serve
from tests.labpipe.report.conftest import Browser
from tests.pipelines.app.pile import FILES, HEIGHTS, write_pile

KEY, POINT, BUTTON, HOME, THINK = 0.28, 1.1, 0.1, 0.4, 1.35
"""s: a character of an average typist, the mouse to a target, its button down or up, the hand to the
other device, getting ready for one action."""
LOOK_UP, READ = 5.0, 10.0
"""s, assumed: a value in the notebook, a part of the page."""

SPECIMEN = {"radius": "9,525 ± 0,005", "mass": "505 ± 0,5 g", "temperature": "20 ± 0,5"}
LASER = {"by": "Maria", "how": "Mikrometer", "inclination of": "12 ± 0,1°"}
RHEOMETER = {"Poisson's ratio ν": "0,35 ± 0,02"}


@dataclass
class Count:
    """What a person did so far."""

    clicks: int = 0
    typed: int = 0
    values: int = 0
    parts: int = 0
    moves: int = 0

    @property
    def seconds(self) -> float:
        """Time of a person [s]."""
        by_mouse = self.clicks * (THINK + POINT + 2 * BUTTON)
        by_keys = self.typed * KEY + self.moves * HOME
        return by_mouse + by_keys + self.values * LOOK_UP + self.parts * READ


class Mouse:
    """Somebody with a mouse, who types only what no file says.

    Parameters
    ----------
    window : Browser
    """

    def __init__(self, window: Browser) -> None:
        self.window = window
        self.count = Count()
        self._types = False

    def click(self, finds: str) -> None:
        """Click on the middle of what a script finds; it must be seen there, uncovered."""
        self.window.until(f"(() => {{ const e = {finds}; return Boolean(e && e.offsetParent && !e.disabled); }})()")
        x, y = self.window.run(
            f"(() => {{ const e = {finds}; e.scrollIntoView({{block: 'center', behavior: 'instant'}});"
            " const b = e.getBoundingClientRect(), x = b.left + b.width / 2, y = b.top + b.height / 2;"
            " const top = document.elementFromPoint(x, y);"
            " return top && (e.contains(top) || top.contains(e)) ? [x, y] : [-1, -1]; })()"
        )
        if x < 0:
            message = f"something covers {finds}"
            raise AssertionError(message)
        self.window.click(x, y)
        self.count.clicks += 1
        self.count.moves += self._types
        self._types = False

    def button(self, text: str, inside: str = "body") -> None:
        """Click on a button by its text."""
        self.click(
            f"[...document.querySelectorAll('{inside} button')].find(b => b.textContent === '{text}' && b.offsetParent)"
        )

    def type(self, label: str, text: str, inside: str = "#setup") -> None:
        """Fill a field in, found by how it is called."""
        named = f"e => e.ariaLabel === {json.dumps(label)}"
        self.click(f"[...document.querySelectorAll('{inside} [aria-label]')].find({named})")
        self.count.values += 1
        is_choice = self.window.run("document.activeElement.tagName === 'SELECT'")
        if is_choice:  # the first letters find it
            text = text[:1].lower()
            self.window.send("Input.dispatchKeyEvent", type="char", text=text)
        else:
            self.window.send("Input.insertText", text=text)
        self.count.typed += len(text)
        self.count.moves += 1
        self._types = True

    def read(self) -> None:
        """Read a part of the page."""
        self.count.parts += 1


def to_verdicts(window: Browser, address: str, *, is_whole: bool = True) -> dict[str, tuple[Count, float]]:
    """Set the stick up and run it; return what it took until each point, and the computer's time [s].

    Only what no file says is typed, as a notebook has it; all else stays as it was proposed. Unless
    whole, the first verdict is the end.
    """
    reached: dict[str, tuple[Count, float]] = {}
    began = time.monotonic()
    person = Mouse(window)

    def note(point: str) -> None:
        reached[point] = (Count(**vars(person.count)), time.monotonic() - began)

    window.visit(address)
    window.until(f"document.querySelectorAll('#file-list li').length === {FILES - 1}")
    person.read()
    person.button("Propose a session", "#files")
    window.until("document.querySelectorAll('#setup-experiments > li').length > 1")
    person.read()
    for key, text in SPECIMEN.items():
        person.type(f"{key} of the specimen acrylic_dma", text)
    for key, text in LASER.items():
        person.type(f"{key}{' ' if key.endswith('of') else ', '}calibration/laser.toml", text)
    card = "#setup-experiments [data-name=acrylic_dma]"
    for key, text in RHEOMETER.items():
        person.type(key, text, card)
    window.until("!document.querySelector('#setup-experiments [data-name=acrylic_7mm] .is-wrong')")
    note("set up")
    person.button("Look at the difference and write")
    person.read()
    person.button("Write", "#difference")
    window.until("document.getElementById('message').textContent.startsWith('Written')")
    person.button("Run", "nav")
    person.button("Process", "#run")
    verdicts = "[...document.querySelectorAll('#experiments li p')].filter(p => p.textContent.startsWith('believable'))"
    window.until(f"{verdicts}.length > 0", 240)
    person.read()
    note("first verdict")
    if not is_whole:
        return reached
    window.until(f"{verdicts}.length >= {len(HEIGHTS) + 2}", 240)
    person.click(
        "[...document.querySelectorAll('#experiments li')].find(e => e.querySelector('h3').textContent"
        " === 'acrylic_7mm').querySelector('button')"
    )
    window.until("document.getElementById('page').src.endsWith('acrylic_7mm.html')")
    person.read()
    note("a report read")
    return reached


def table(reached: dict[str, tuple[Count, float]]) -> str:
    """Return the table of the guide."""
    lines = ["| until | clicks | values | characters | time of a person |", "|---|---|---|---|---|"]
    for point, (count, _) in reached.items():
        minutes, seconds = divmod(round(count.seconds), 60)
        lines.append(f"| {point} | {count.clicks} | {count.values} | {count.typed} | {minutes} min {seconds:02d} s |")
    return "\n".join(lines)


def main() -> None:
    """Print what it takes."""
    with tempfile.TemporaryDirectory(prefix="labpipe-stick-") as place:
        served = serve(write_pile(Path(place) / "stick"))
        thread = threading.Thread(target=served.run)
        thread.start()
        window = Browser(Path(place) / "profile")
        try:
            reached = to_verdicts(window, served.address)
        finally:
            window.close()
            served.stop()
            thread.join()
    sys.stdout.write(f"{table(reached)}\n")
    for point, (_, seconds) in reached.items():
        sys.stdout.write(f"{point}: {seconds:.0f} s on this computer, its waits included\n")


if __name__ == "__main__":
    main()
