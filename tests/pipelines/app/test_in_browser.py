"""The local page in a real browser: from raw files to a report, with the keyboard alone as well."""

import shutil
import threading
import tomllib
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from instruments import phantom
from instruments.phantom._writer import Recording
from pipelines.app import open_guide
from pipelines.session import open_session
from tests.labpipe.report.conftest import Browser, opened
from tests.pipelines.app.conftest import Page
from tests.pipelines.app.test_measuring import ruler


@pytest.fixture(scope="module")
def window(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    yield from opened(tmp_path_factory.mktemp("profile"))


class Person:
    """Somebody at the keyboard: Tab, typed text, Enter; counts what it takes."""

    def __init__(self, window: Browser) -> None:
        self.window = window
        self.keys = 0

    def press(self, key: str, text: str = "", code: int = 0) -> None:
        more = {"text": text} if text else {}
        for kind in ("keyDown", "keyUp"):
            self.window.send("Input.dispatchKeyEvent", type=kind, key=key, code=key, windowsVirtualKeyCode=code, **more)
        self.keys += 1

    def tab_to(self, test: str) -> None:
        """Press Tab until a condition on the focused element ``e`` holds."""
        for _ in range(300):
            self.press("Tab", code=9)
            if self.window.run(f"(() => {{ const e = document.activeElement; return Boolean(e && ({test})); }})()"):
                return
        raise AssertionError(test)

    def enter(self) -> None:
        self.press("Enter", "\r", 13)

    def type(self, text: str) -> None:
        self.window.send("Input.insertText", text=text)
        self.keys += len(text)


def button(text: str) -> str:
    return f"e.tagName === 'BUTTON' && e.textContent === '{text}' && !e.closest('[hidden]')"


def quiet(window: Browser, page: Page) -> None:
    assert window.complaints() == []
    assert {a for a in window.requests() if not a.startswith(page.address)} == set()


@pytest.mark.slow
def test_from_raw_files_to_a_verdict_by_the_keyboard_alone(
    window: Browser, page: Page, raw: Path, tmp_path: Path
) -> None:
    window.visit(page.address)
    person = Person(window)
    window.until("document.querySelectorAll('#file-list li').length === 4")
    person.tab_to(button("Propose a session"))
    person.enter()
    window.until("document.querySelectorAll('#setup-experiments > li').length === 2")
    values = {
        "material of": "acrylic", "radius of": "9,525 ± 0,005 mm", "mass of": "505 ± 0,5 g", "height": "1,5 ± 0,005 mm",
    }  # fmt: skip
    for label, value in values.items():
        person.tab_to(f"(e.getAttribute('aria-label') || '').startsWith('{label}')")
        person.type(value)
    window.until("document.getElementById('setup-state').textContent.includes('; 0 values')")
    assert not (raw / "session.toml").exists()
    person.tab_to("e.id === 'setup-write'")
    person.enter()
    window.until("document.querySelector('#difference[open] #difference-words li') !== null")
    person.tab_to("e.id === 'difference-write'")
    person.enter()
    window.until("document.getElementById('message').textContent.startsWith('Written: session.toml')")
    assert set(open_session(raw).experiments) == {"drop", "nbr"}
    person.tab_to(button("Run"))
    person.enter()
    person.tab_to(button("Process"))
    person.enter()
    window.until("document.querySelectorAll('#experiments .is-ok').length === 2", 240)
    window.until("[...document.querySelectorAll('#experiments button')].length === 2", 60)
    # the card that tells of itself first stands first until the plan is there
    person.tab_to("e.textContent === 'Report' && e.closest('#experiments > li')?.dataset.name === 'drop'")
    window.run("drawRun()")  # news arrive
    assert window.run("document.activeElement.textContent === 'Report'")
    person.enter()
    window.until("document.getElementById('page').src.endsWith('/reports/reports/drop.html')")
    for width in (1400, 390):
        window.visit(page.address, width=width)
        window.until("document.querySelectorAll('#file-list li').length === 4")
        for part in ("Files", "Set-up", "Measure", "Run", "Reports"):
            window.run(f"[...document.querySelectorAll('nav button')].find(b => b.textContent === '{part}').click()")
            window.settle()
            assert window.run("document.documentElement.scrollWidth") <= width, part
        quiet(window, page)
    # Four values and the way through the page, Tab by Tab.
    assert person.keys < 400


def test_hostile_names_are_shown_as_text(
    window: Browser, small_session: Path, tmp_path: Path, serving: Callable[[Path], Page]
) -> None:
    folder = tmp_path / "<b>x&amp;"
    shutil.copytree(small_session / "laser", folder / "laser")
    name = '<img src=x onerror="document.title=1">.csv'
    (folder / name).write_text("nothing")
    page = serving(folder)
    window.visit(page.address)
    window.until("document.querySelectorAll('#file-list li').length === 3")
    assert name in window.run("document.getElementById('file-list').textContent")
    assert window.run("document.querySelectorAll('#file-list img[src=x]').length") == 0
    assert window.run("document.title").startswith("<b>x&amp;")
    quiet(window, page)


def test_the_guide_finds_its_sections_by_words(window: Browser) -> None:
    served = open_guide()
    answering = threading.Thread(target=served.run)
    answering.start()
    window.visit(f"{served.address}films.html")
    person = Person(window)
    person.tab_to("e.id === 'search'")
    person.type("damping_ratio plate")
    window.until("document.querySelectorAll('#found a').length > 0")
    first = window.run("document.querySelector('#found a').href")
    person.enter()
    window.until(f"location.href === '{first}' && document.getElementById(location.hash.slice(1)) !== null")
    assert window.complaints() == []
    assert {a for a in window.requests() if not a.startswith(served.address)} == set()
    served.stop()
    answering.join(60)


def test_the_page_says_when_its_server_is_gone(window: Browser, page: Page) -> None:
    window.visit(page.address)
    window.until("document.querySelectorAll('#file-list li').length === 4")
    page.served.stop()
    window.until("document.getElementById('message').textContent.includes('does not answer')")


@pytest.fixture
def filmed(tmp_path: Path) -> Path:
    """A film of a body between two edges 380 px apart, and nothing else."""
    folder = tmp_path / "filmed"
    folder.mkdir()
    grey = ruler(0.0, 380.0, "edge", np.random.default_rng(3)).astype(np.uint8)
    day = int(datetime(2024, 5, 14, 9, 30, tzinfo=UTC).timestamp())
    recording = Recording(frame_rate=4000, exposure=5e-5, bits=8, trigger=day)
    phantom.write(folder / "acrylic_front.cine", np.stack([grey] * 3), (3, *grey.shape), np.arange(3) / 4000, recording)
    return folder


def test_two_clicks_and_a_drag_make_a_scale_and_a_subset(
    window: Browser, filmed: Path, serving: Callable[[Path], Page]
) -> None:
    page = serving(filmed)
    page.propose()
    before = (filmed / "session.toml").read_text("utf-8").splitlines()
    window.visit(page.address)
    measure = "[...document.querySelectorAll('#file-list button')].find(b => b.textContent === 'Measure in it')"
    window.until(f"Boolean({measure})")
    window.run(f"{measure}.click()")
    window.until("stage.image !== null && document.getElementById('measure-canvas').width > 100")
    window.settle()

    def at(x: float, y: float) -> tuple[float, float]:
        window.run("document.getElementById('measure-canvas').scrollIntoView({block: 'center'})")
        left, top = window.run(
            "(() => { const b = document.getElementById('measure-canvas').getBoundingClientRect();"
            " return [b.left, b.top]; })()"
        )
        return left + x + 0.5, top + y + 0.5

    window.run("document.getElementById('measure-tool').value = 'cover'")
    window.drag(at(300, 150), at(-40, 100))  # let go beyond the border, where the nearest pixel counts
    assert window.until("stage.from === null && stage.points.length === 2 && stage.points[1][0] === 0")
    window.run("document.getElementById('measure-tool').value = 'scale'; begin()")
    window.click(*at(62, 150))
    window.click(*at(438, 150))
    text = window.until("stage.result && stage.result.text")
    value, u = (float(part) for part in text.removesuffix(" px").split(" ± "))
    assert abs(value - 380.0) < 0.06
    assert 0 < u < 0.06
    window.until("document.getElementById('measure-length') !== null")
    window.run("document.getElementById('measure-length').value = '30,00 ± 0,02 mm'")
    window.run("[...document.querySelectorAll('#measure button')].find(b => b.textContent === 'Use as scale').click()")
    window.until("!document.getElementById('setup').hidden")
    drags = {
        "body": ((250, 150), (290, 150)),
        "line": ((100, 80), (400, 80)),
        "region": ((420, 40), (80, 260)),
        "cover": ((200, 100), (240, 130)),
        "obstruction": ((300, 20), (310, 200)),
    }
    for tool, (start, stop) in drags.items():
        window.run("show('measure')")
        window.run(
            "(() => { const t = document.getElementById('measure-tool');"
            f" t.value = '{tool}'; t.dispatchEvent(new Event('change')); }})()"
        )
        window.drag(at(*start), at(*stop))
        window.until("document.getElementById('measure-experiment') !== null")
        window.run("[...document.querySelectorAll('#measure-use button')].at(-1).click()")
        window.until("!document.getElementById('setup').hidden")
    window.run("document.getElementById('setup-write').click()")
    window.until("document.querySelector('#difference[open] .plus') !== null")
    window.run("document.getElementById('difference-write').click()")
    window.until("document.getElementById('message').textContent.startsWith('Written')")
    record = (filmed / "calibration/camera_front.toml").read_text("utf-8")
    assert f'pixel_length = "{text}"' in record
    assert 'reference_length = "30,00 ± 0,02 mm"' in record
    tracking = tomllib.loads((filmed / "session.toml").read_text("utf-8"))["experiments"]["acrylic_front"]["tracking"]
    assert tracking["body_subset"] == 81
    assert tracking["body"] == pytest.approx([250, 150], abs=1.5)
    assert np.allclose(tracking["line"], drags["line"], atol=1.5)
    assert np.allclose(tracking["regions"], [[(80, 40), (420, 40), (420, 260), (80, 260)]], atol=1.5)
    assert np.allclose(tracking["covers"], [[(200, 100), (240, 100), (240, 130), (200, 130)]], atol=1.5)
    assert np.allclose(tracking["obstructions"], [[(300, 20), (310, 20), (310, 200), (300, 200)]], atol=1.5)
    after = iter((filmed / "session.toml").read_text("utf-8").splitlines())
    assert all(line in after for line in before)  # remarks and order are kept
    quiet(window, page)
