"""What is installed is ours alone, and nothing speaks to the network but acquisition."""

import ast
import os
import sys
from pathlib import Path

import pytest

from pipelines.session import process
from tests.faults.crashes import at_once
from tests.faults.test_failed_inputs import GARBAGE, session

ROOT = Path(__file__).parents[2]
PACKAGES = ["labpipe", "instruments", "calibration", "pipelines"]
SPEAKS = {"instruments/keyence/_connection.py", "pipelines/app/_serve.py", "pipelines/commands/system.py"}
"""Modules that open a connection: the live acquisition, and the local page, which listens on 127.0.0.1."""
NETWORK = {"socket", "ssl", "http", "ftplib", "smtplib", "urllib.request", "xmlrpc", "requests", "httpx", "aiohttp"}
NETWORK |= {"pooch", "webbrowser", "asyncio", "socketserver"}


def modules_of(path: Path) -> set[str]:
    text = path.read_text("utf-8")
    found: set[str] = set()
    if not any(name.split(".")[0] in text for name in NETWORK):
        return found
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            found |= {name.name for name in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found |= {node.module, *(f"{node.module}.{name.name}" for name in node.names)}
    return found


def test_only_acquisition_and_the_local_page_can_open_a_connection() -> None:
    speaking = {
        path.relative_to(ROOT).as_posix()
        for package in PACKAGES
        for path in (ROOT / package).rglob("*.py")
        if any(name in NETWORK or name.split(".")[0] in NETWORK for name in modules_of(path))
    }
    assert speaking == SPEAKS


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_a_run_asks_nobody_for_anything(tmp_path: Path) -> None:
    """No name is looked up, nothing is connected to, no program is started but git."""
    folder = session(tmp_path / "session", GARBAGE["text"])

    def run() -> str:
        asked: list[str] = []

        def listen(event: str, arguments: tuple[object, ...]) -> None:
            if event.startswith(("socket.", "urllib.", "http.", "ftplib.", "smtplib.")):
                asked.append(event)
            if event in ("subprocess.Popen", "os.system", "os.exec", "os.posix_spawn"):
                asked.append(f"{event} {Path(str(arguments[0])).name}")

        sys.addaudithook(listen)
        process(folder, jobs=0)
        return "\n".join(sorted(set(asked)))

    assert set(at_once([run])[0].split("\n")) <= {"", "subprocess.Popen git"}
