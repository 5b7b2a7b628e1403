"""The server of the local page: who may ask, what is reachable, what is written, how runs end."""

import hashlib
import json
import os
import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from labpipe import files
from pipelines.app import open_guide
from pipelines.session import open_session
from tests.pipelines.app.conftest import Page


def contents(folder: Path) -> dict[str, str]:
    return {
        p.relative_to(folder).as_posix(): hashlib.sha256(p.read_bytes()).hexdigest()
        for p in files.files_below(folder)
        if not p.relative_to(folder).as_posix().startswith(("labpipe/", "session.toml"))
    }


def test_the_page_and_its_parts_come_from_here_alone(page: Page) -> None:
    status, text = page.ask("")
    assert status == 200
    assert b"http" not in text
    assert "default-src 'none'" in page.headers["content-security-policy"]
    assert page.headers["x-content-type-options"] == "nosniff"
    for name in ("app.js", "setup.js", "measure.js", "app.css"):
        assert page.ask(f"assets/{name}")[0] == 200
    assert page.ask("assets/../_serve.py")[0] == 404
    assert page.ask("assets/app.html")[0] == 404


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({"Host": "evil.example"}, 403),
        ({"Host": "127.0.0.1"}, 403),
        ({"Origin": "http://evil.example"}, 403),
        ({"Origin": "null"}, 403),
        ({"Origin": ""}, 403),
        ({"Content_Type": "text/plain"}, 415),
        ({"Content_Length": "2000000"}, 413),
        ({}, 200),
    ],
)
def test_only_this_page_may_ask(page: Page, headers: dict[str, str], status: int) -> None:
    assert page.ask("api/run", b'{"action": "stop"}', **headers)[0] == status


def test_an_address_without_the_token_is_not_found(page: Page) -> None:
    for path in ("/", "/api/files", f"{page.path[:-1]}x/api/files", "/" + "A" * 32 + "/"):
        assert page.ask(path, whole=True)[0] == 404
    assert page.ask("", method="DELETE")[0] == 405


def test_files_are_told_with_kind_use_and_picture(page: Page, raw: Path) -> None:
    (raw / "Kopie").mkdir()
    (raw / "Kopie/drop_1.csv").write_bytes((raw / "laser/drop_1.csv").read_bytes())
    found = {entry["name"]: entry for entry in page.told("api/files")["files"]}
    assert found["laser/drop_1.csv"]["kind"] == "Keyence storage file"
    assert found["Kopie/drop_1.csv"]["copy_of"] == "laser/drop_1.csv"
    assert found["calibration/laser.toml"]["kind"] == "calibration record of a laser"
    assert page.propose() == ["session.toml"]
    used = {entry["name"]: entry["used_by"] for entry in page.told("api/files")["files"]}
    assert used["laser/drop_1.csv"] == ["drop"]
    assert used["Kopie/drop_1.csv"] == []
    status, picture = page.ask("api/picture?name=laser/drop_1.csv")
    assert (status, picture[:8]) == (200, b"\x89PNG\r\n\x1a\n")


@pytest.mark.parametrize(
    "name", ["../secret.csv", "/etc/passwd", "link.csv", "inner/secret.csv", "round", "a\x00b", "", "no-such.csv"]
)
def test_nothing_outside_the_folder_is_reachable(page: Page, raw: Path, name: str) -> None:
    (raw.parent / "secret.csv").write_bytes((raw / "laser/drop_1.csv").read_bytes())
    (raw / "link.csv").symlink_to(raw.parent / "secret.csv")
    (raw / "inner").symlink_to(raw.parent)
    (raw / "round").symlink_to(raw / "round")
    from urllib.parse import quote

    assert page.ask(f"api/picture?name={quote(name)}")[0] == 400
    assert page.ask(f"reports/{quote(name)}")[0] in (400, 404)
    told = {entry["name"]: entry for entry in page.told("api/files")["files"]}
    assert told["link.csv"]["reason"] == "a link that leads out of the folder"
    assert not any(entry.startswith("inner/") for entry in told)


def test_reports_and_nothing_else_of_labpipe_are_shown(page: Page, raw: Path) -> None:
    (raw / "labpipe/reports").mkdir(parents=True)
    (raw / "labpipe/reports/drop.html").write_text("<p>page</p>")
    (raw / "labpipe/run.jsonl").write_text("{}")
    (raw / "labpipe/store/31").mkdir(parents=True)
    (raw / "labpipe/store/31/page.html").write_text("<p>part of a page</p>")
    assert page.told("api/files")["pages"] == ["reports/drop.html"]
    assert page.ask("reports/reports/drop.html") == (200, b"<p>page</p>")
    assert "frame-ancestors 'self'" in page.headers["content-security-policy"]
    assert page.ask("reports/run.jsonl")[0] == 400
    (raw / "labpipe/reports/out.html").symlink_to(raw / "laser/drop_1.csv")
    assert page.ask("reports/reports/out.html")[0] == 400


def test_hostile_names_and_damaged_pictures_stop_nothing(page: Page, raw: Path) -> None:
    for name in ('<img src=x onerror="alert(1)">.csv', "a' b\";.txt", "…\u202e.csv", "x" * 200 + ".csv", "\n.csv"):
        (raw / name).write_text("nothing")
    head, size = b"\x89PNG\r\n\x1a\n\x00\x00\x00\rIHDR", (100_000).to_bytes(4) * 2
    (raw / "bomb.png").write_bytes(head + size + b"\x08\x02\x00\x00\x00" + b"\0" * 40)
    os.mkfifo(raw / "pipe.csv")
    found = {entry["name"] for entry in page.told("api/files")["files"]}
    assert '<img src=x onerror="alert(1)">.csv' in found
    assert page.ask("api/picture?name=bomb.png")[0] == 400
    assert page.ask("api/check", b"[" * 100_000)[0] == 400
    assert page.ask("api/check", {"base": 1, "edits": "x"})[0] == 400


FILLED = [
    ("height", "1,5 ± 0,005 mm"),
    ("sphere.radius", "9,525 ± 0,005 mm"),
    ("sphere.mass", "505 ± 0,5 g"),
    ("sphere.material", "acrylic"),
]


def edits(*values: tuple[str, str]) -> list[dict[str, object]]:
    return [
        {"op": "set", "file": "session.toml", "place": ["experiments", "drop", *key.split(".")], "text": text}
        for key, text in values
    ]


def fill_in(page: Page) -> None:
    page.propose()
    page.told("api/write", {"base": page.told("api/session")["base"], "edits": edits(*FILLED)})


def test_a_session_is_set_up_and_written_after_its_difference(page: Page, raw: Path) -> None:
    before = contents(raw)
    page.propose()
    state = page.told("api/session")
    assert len(state["problems"]) == len(FILLED)
    wrong = page.told("api/check", {"base": state["base"], "edits": edits(*FILLED[:3], ("sphere.mass", "9 mm"))})
    assert [p["place"] for p in wrong["problems"] if "9 mm" in p["message"]] == ["experiments.drop.sphere.mass"]
    asked = {"base": state["base"], "edits": edits(*FILLED)}
    looked = page.told("api/check", asked)
    assert looked["problems"] == []
    assert '+height = "1,5 ± 0,005 mm"' in "\n".join(looked["difference"])
    assert "FILL" in (raw / "session.toml").read_text("utf-8")
    assert page.told("api/write", asked)["written"] == ["session.toml"]
    assert set(open_session(raw).experiments) == {"drop", "nbr"}
    assert "# of the sphere" in (raw / "session.toml").read_text("utf-8")
    assert contents(raw) == before
    status, text = page.ask("api/write", asked)
    assert (status, "changed elsewhere" in json.loads(text)["error"]) == (400, True)


def test_nothing_is_written_before_it_was_seen_and_every_write_can_be_undone(page: Page, raw: Path) -> None:
    before = contents(raw)
    first = page.told("api/session")
    assert [one["name"] for one in first["experiments"]] == ["drop", "nbr"]
    assert not (raw / "session.toml").exists()
    assert first["words"][:2] == ["session.toml is new", "drop: new, Ball drop"]
    page.propose()
    page.told("api/write", {"base": page.told("api/session")["base"], "edits": edits(*FILLED[:1])})
    state = page.told("api/session")
    assert len(state["versions"]) == 2
    back = [{"op": "restore", "version": version} for version in state["versions"]]
    one = page.told("api/check", {"base": state["base"], "edits": back[:1]})
    assert one["words"] == ["drop: height: 1,5 ± 0,005 mm → to be filled in"]
    assert page.told("api/write", {"base": state["base"], "edits": back})["written"] == ["session.toml"]
    assert not (raw / "session.toml").exists()
    assert contents(raw) == before
    assert page.ask("api/check", {"base": one["base"], "edits": [{"op": "restore", "version": "../.."}]})[0] == 400


def test_the_kind_of_an_experiment_is_changed_and_it_keeps_what_both_kinds_have(page: Page) -> None:
    page.propose()
    base = page.told("api/session")["base"]
    asked = {"base": base, "edits": [*edits(*FILLED), {"op": "kind", "name": "drop", "to": "plate_vibration"}]}
    (drop, _) = page.told("api/check", asked)["experiments"]
    values = {".".join(map(str, field["place"][2:])): field["text"] for field in drop["fields"]}
    assert (drop["kind"], values["calibration"], values["sphere.mass"]) == (
        "plate_vibration", "calibration/laser.toml", "505 ± 0,5 g",
    )  # fmt: skip
    assert values["drops.0.height"] == "1,5 ± 0,005 mm"
    assert ["ball_drop", "Ball drop"] in drop["kinds"]
    asked["edits"].append({"op": "kind", "name": "drop", "to": "ball_drop"})
    (drop, _) = page.told("api/check", asked)["experiments"]
    assert next(f["files"] for f in drop["fields"] if f["files"]) == ["laser/drop_1.csv", "laser/drop_2.csv"]
    assert page.ask("api/check", {"base": base, "edits": [{"op": "kind", "name": "drop", "to": "no"}]})[0] == 400


def test_a_bare_number_gets_the_unit_that_was_asked_for(page: Page) -> None:
    page.propose()
    base = page.told("api/session")["base"]
    bare = edits(("height", "1,5 ± 0,005"), ("sphere.radius", "9,53"), ("sphere.mass", "0.505 kg"))
    looked = page.told("api/check", {"base": base, "edits": bare})
    difference = "\n".join(looked["difference"])
    for line in ('+height = "1,5 ± 0,005 mm"', '+radius = "9,53 mm"', '+mass = "0.505 kg"'):
        assert line in difference
    assert {problem["place"] for problem in looked["problems"]} == {"experiments.drop.sphere.material"}


def test_columns_of_an_unknown_table_are_named_on_the_card(page: Page, raw: Path) -> None:
    rows = "".join(f"{k * 1e-4:.4f},{3 - k * k * 5e-8:.6f}\n" for k in range(40))
    (raw / "laser/recorder.csv").write_text(f"Time (s) Run #1,Position (m) Run #1\n{rows}")
    page.propose()
    unknown = {entry["name"]: entry for entry in page.told("api/files")["files"]}["laser/recorder.csv"]
    assert (unknown["kind"], "columns = {" in unknown["reason"]) == ("", True)
    add = {"op": "add", "name": "drop", "key": "laser", "names": ["laser/recorder.csv"]}
    base = page.told("api/session")["base"]
    looked = page.told("api/check", {"base": base, "edits": [add]})
    fields = {field["dotted"]: field for one in looked["experiments"] for field in one["fields"]}
    (proposed,) = fields["experiments.drop.keyence.columns"]["suggestions"]
    assert proposed == '{ time = "Time (s) Run #1", displacement = "Position (m) Run #1" }'
    wrong = {"base": base, "edits": [add, *edits(("keyence.columns", '{ gravity = "Position (m) Run #1" }'))]}
    problems = {p["place"]: p["message"] for p in page.told("api/check", wrong)["problems"]}
    assert '"gravity" is no quantity' in problems["experiments.drop.keyence.columns"]
    page.told("api/write", {"base": base, "edits": [add, *edits(("keyence.columns", f"columns = {proposed}"))]})
    assert f"columns = {proposed}\n" in (raw / "session.toml").read_text("utf-8")
    fields = {f["dotted"]: f for one in page.told("api/session")["experiments"] for f in one["fields"]}
    assert fields["experiments.drop.keyence.columns"]["text"] == proposed


def test_before_a_run_it_is_told_what_would_run_and_what_waits_for_which_line(page: Page, raw: Path) -> None:
    page.propose()
    (raw / "laser/other_1.csv").write_bytes((raw / "laser/drop_1.csv").read_bytes().replace(b"0", b"1", 1))
    told = page.told("api/plan")
    cards = {card["name"]: card for card in told["experiments"]}
    written = enumerate((raw / "session.toml").read_text("utf-8").splitlines(), 1)
    line = next(number for number, text in written if text.startswith('height = "FILL'))
    assert any(f"session.toml:{line}" in waits for waits in cards["drop"]["waits"]), cards["drop"]["waits"]
    assert not told["known"]
    assert cards["nbr"]["to_run"] == cards["nbr"]["steps"] > 0
    assert cards["nbr"]["why"]
    assert told["unused"] == ["laser/other_1.csv"]
    page.told("api/write", {"base": page.told("api/session")["base"], "edits": edits(*FILLED)})
    told = page.told("api/plan")
    assert all(not card["waits"] and card["to_run"] for card in told["experiments"])
    (raw / "mach1/nbr.txt").unlink()
    cards = {card["name"]: card for card in page.told("api/plan")["experiments"]}
    assert any("nbr.txt" in line for line in cards["nbr"]["waits"])


def test_the_guide_comes_from_the_installation_and_shows_nothing_else() -> None:
    served = open_guide()
    thread = threading.Thread(target=served.run)
    thread.start()
    try:
        page = Page(served)
        assert page.ask("")[0] == 307
        status, text = page.ask("experimenter.html")
        assert (status, b"For the experimenter" in text) == (200, True)
        assert "default-src 'none'" in page.headers["content-security-policy"]
        assert "script-src 'self';" in page.headers["content-security-policy"]
        assert (page.ask("app.css")[0], page.ask("search.js")[0]) == (200, 200)
        for name in ("../app.css", "api/files", "etc/passwd.html", "nothing.html"):
            assert page.ask(name)[0] == 404
        assert page.ask("/experimenter.html", whole=True)[0] == 404
    finally:
        served.stop()
        thread.join(60)


def until(page: Page, is_so: Callable[[dict], bool]) -> dict:
    end = time.monotonic() + 240
    while not is_so(state := page.told("api/run")):
        assert time.monotonic() < end, state
        time.sleep(0.2)
    return state


@pytest.mark.slow
def test_a_run_is_stopped_and_goes_on_to_its_verdicts(page: Page, raw: Path) -> None:
    fill_in(page)
    page.told("api/run", {"action": "process"})
    assert page.ask("api/run", {"action": "process"})[0] == 400
    until(page, lambda state: any(e["kind"] == "done" for e in state["events"]))
    page.told("api/run", {"action": "stop"})
    stopped = until(page, lambda state: not state["running"])
    assert stopped["code"] == 130
    done = {(e["experiment"], e["stage"], e["recording"]) for e in stopped["events"] if e["kind"] == "done"}
    page.told("api/run", {"action": "process"})
    ended = until(page, lambda state: not state["running"])
    assert ended["code"] in (0, 1), ended
    again = {(e["experiment"], e["stage"], e["recording"]) for e in ended["events"] if e["kind"] == "done"}
    assert done
    assert not done & again
    assert {e["experiment"] for e in ended["events"] if e["kind"] == "verdict"} == {"drop", "nbr"}
    assert "reports/drop.html" in page.told("api/files")["pages"]


@pytest.mark.slow
def test_what_arrives_while_it_is_watched_is_processed(page: Page, raw: Path) -> None:
    fill_in(page)
    late = raw / "mach1/nbr.txt"
    data = late.read_bytes()
    late.unlink()
    page.told("api/run", {"action": "watch"})
    until(page, lambda state: ("nbr", "waiting") in [(e.get("experiment"), e.get("state")) for e in state["events"]])
    late.write_bytes(data)
    state = until(page, lambda state: "nbr" in [e["experiment"] for e in state["events"] if e["kind"] == "verdict"])
    assert ("nbr", "processed") in [(e.get("experiment"), e.get("state")) for e in state["events"]]
    page.told("api/run", {"action": "stop"})
    assert until(page, lambda state: not state["running"])["code"] == 130
