"""Commands about the installation and its parts: doctor, completion, open, sample, demo, figures, bench, acquire."""

import itertools
import json
from collections import Counter
from dataclasses import fields
from pathlib import Path
from typing import Any

import click
from click.shell_completion import BashComplete, FishComplete, ZshComplete

from labpipe.errors import ConfigError, StorageError, StoreError, UsageError
from pipelines import session as verbs
from pipelines.cli import cli
from pipelines.commands.options import FOLDER, NEW_FILE, NEW_FOLDER, emit, jobs_option, json_option, members, wants_json
from pipelines.commands.progress import counted, progress, watching
from pipelines.commands.session import as_document, summary
from pipelines.commands.simulate import value_option


@click.command()
@click.argument("session", required=False, type=FOLDER)
@json_option
def doctor(session: Path | None) -> None:
    r"""Check the installation and the disk; audit SESSION.

    Lists installed versions that are missing or too old, packages that shadow ours, plug-ins, and free
    space; reads session.toml and every stored result in SESSION, or in the present folder.

    All that is wrong with the recordings and settings of SESSION comes as one table, the costliest
    first, each with the line to change; results that the verdicts need are processed first. The exit
    code is 1 when a record is impossible.

    \b
    Example:
      labpipe doctor my-session
    """
    found = verbs.doctor(session)
    audit = found.audit
    names = ("versions", "plugins", "free_bytes", "problems", "session_problems", "damaged_results")
    document = members(found, *names) | {"checks": None, "exact": None, "findings": None}
    if audit is not None:
        document |= members(audit, "checks", "exact") | {"findings": [one._asdict() for one in audit.troubles]}
    codes = (
        (found.damaged_results, StoreError.exit_code),
        (found.problems, StorageError.exit_code),
        (found.session_problems, ConfigError.exit_code),
        (audit is not None and audit.is_impossible, 1),
    )
    emit(document, repr(found).splitlines(), code=next((code for is_wrong, code in codes if is_wrong), 0))


@click.command()
@click.argument("shell", type=click.Choice(["bash", "zsh", "fish"]))
@json_option
def completion(shell: str) -> None:
    r"""Print the script that makes SHELL complete labpipe's commands and options.

    \b
    Example:
      labpipe completion bash > ~/.local/share/bash-completion/completions/labpipe
    """
    kind = {"bash": BashComplete, "zsh": ZshComplete, "fish": FishComplete}[shell]
    script = kind(cli, {}, "labpipe", "_LABPIPE_COMPLETE").source()
    emit({"shell": shell, "script": script}, [script])


@click.command("open")
@click.argument("folder", default=".", type=FOLDER)
@click.option("--port", default=0, show_default=False, type=click.IntRange(0, 65535), help="By default a free one.")
@click.option("--no-browser", is_flag=True, help="Print the address of the page; do not show it.")
@click.option("--guide", is_flag=True, help="Show the guide that is installed instead; no network is needed.")
@json_option
def open_(folder: Path, port: int, no_browser: bool, guide: bool) -> None:
    r"""Set up, run and read the session in FOLDER in a local page; end with Ctrl-C.

    The page answers on this computer only, under an address that nobody can guess, and shows
    nothing outside FOLDER. Raw files are never changed; session.toml and calibration records are
    written after a look at the difference.

    \b
    Example:
      labpipe open my-session
      labpipe open --guide
    """
    import webbrowser

    from pipelines.app import open as verb, open_guide

    served = open_guide(port=port) if guide else verb(folder, port=port)
    kept = "" if guide else "; a run that goes on is stopped then, its results are kept"
    lines = (f"{'the guide' if guide else folder}: {served.address}", f"end with Ctrl-C{kept}")
    emit({"address": served.address, "folder": None if guide else str(folder)}, lines)
    if not no_browser and not wants_json():
        webbrowser.open(served.address)
    served.run()


@click.command()
@click.argument("name", required=False)
@click.argument("dest", required=False, type=NEW_FOLDER)
@click.option("--full-size", is_flag=True, help="Films at the camera's full size.")
@click.option("--seed", type=click.IntRange(min=0), help="Draw the rig of thesis and thesis-small anew.")
@json_option
def sample(name: str | None, dest: Path | None, full_size: bool, seed: int | None) -> None:
    r"""Write the synthetic session NAME, with its true values, into the new folder DEST.

    Without NAME the samples are listed. The virtual rig generates all data; none is measured.

    \b
    Example:
      labpipe sample core my-session
    """
    from pipelines.rig import SAMPLES, sample as verb

    if name is None:
        known = {key: entry.summary for key, entry in SAMPLES.items()}
        emit(known, (f"{key:14}{text}" for key, text in known.items()))
        return
    if dest is None:
        raise click.UsageError("name the folder to write into: labpipe sample NAME DEST")
    with progress(f"recording {name}"):
        experiments = [*verb(name, dest, full_size=full_size, seed=seed).experiments]
    line = f"wrote {len(experiments)} synthetic experiment{'s' * (len(experiments) != 1)} into {dest}"
    emit({"folder": dest, "experiments": experiments}, [line])


@click.command()
@click.argument("dest", default="labpipe-demo", type=NEW_FOLDER)
@json_option
def demo(dest: Path) -> None:
    r"""Write a synthetic session into DEST, process it, and print the path of the reports.

    Where DEST holds the demonstration already, it is processed as it is.

    \b
    Example:
      labpipe demo
    """
    from pipelines import rig

    with progress("recording a session"):
        rig.record_demo(dest)
    with watching() as shown:
        outcome = rig.demo(dest, progress=shown)
    judged = verbs.verdicts_of(outcome)
    lines = itertools.chain([f"synthetic session: {dest}"], summary(outcome, judged))
    emit(as_document(outcome, dest, judged), lines, code=outcome.exit_code)


@click.command()
@click.argument("ids", nargs=-1, metavar="[ID]...")
@click.option("--list", "listed", is_flag=True, help="List what each figure needs; draw nothing.")
@click.option("--check", is_flag=True, help="Compare the thesis's printed numbers with ours.")
@click.option("--session", type=FOLDER, help="Session folder for the figures that show experiments.")
@click.option("--out", type=NEW_FOLDER, default="figures", help="Folder to write into.")
@click.option("--data", is_flag=True, help="Write the numbers that each figure draws too, as csv.")
@jobs_option
@json_option
def figures(
    ids: tuple[str, ...], listed: bool, check: bool, session: Path | None, out: Path, data: bool, jobs: int
) -> None:
    r"""Draw the figures of the thesis by number: PDF, SVG, PNG and a caption each, as text and as LaTeX.

    Without --session only computed figures are drawn. Up-to-date figures are not drawn again; of
    the session only results that the figures need are processed.

    \b
    Example:
      labpipe figures 2.6 --out FIGURES
      labpipe figures --session my-session --out FIGURES --data
    """
    from pipelines.figures import figures as verb, make

    if check:
        from pipelines.figures.check import rows as check_rows

        checked = check_rows()
        count = Counter(row.verdict for row in checked)
        counts = "; ".join(f"{n} {verdict}" for verdict, n in sorted(count.items()))
        emit({"rows": [row.document() for row in checked]}, [*(row.line() for row in checked), counts])
        return
    wanted = make.chosen(ids)
    if listed:
        rows, lines = [], []
        for s in make.states(make.Shelf.of(out, session), wanted):
            needs, figure = " and ".join(dict.fromkeys(map(str, s.figure.needs))), s.figure
            is_optional = bool(figure.needs) and all(n.is_optional for n in figure.needs)
            row = members(figure, "id", "title") | {"needs": needs, "optional": is_optional}
            rows.append(row | members(s, "state", "detail"))
            needs = f"{needs}{' (optional)' if is_optional else ''}" or "-"
            lines.append(f"{figure.id:10} {figure.title:46} {needs:26} {s.state}{s.detail and f': {s.detail}'}")
        emit({"figures": rows}, lines)
        return

    with counted(len(wanted)) as step:
        show = None if step is None else lambda outcome: step(outcome.id)
        outcomes = verb(ids, session=session, out=out, data=data, jobs=jobs, progress=show).outcomes
    made = [members(one, "id", "state", "detail", "files") for one in outcomes]
    lines = [f"{o.id:10} {o.state}{o.detail and f': {o.detail}'}" for o in outcomes]
    remedy = "name one by --session; labpipe sample thesis-small FOLDER writes a synthetic one"
    unmet = [one for one in outcomes if ids and one.state == make.NEEDS_SESSION]
    lost = [f"figure {one.id} needs a session {one.detail}: {remedy}" for one in unmet]
    code = 1 if any(o.state == make.FAILED for o in outcomes) else UsageError.exit_code if lost else 0
    emit({"out": out, "figures": made}, lines, errors=lost, code=code)


@click.command()
@click.argument("names", nargs=-1, metavar="[NAME]...")
@click.option("--quick", is_flag=True, help="Fewer settings and repeats; minutes for all parts.")
@click.option("--list", "listed", is_flag=True, help="Name the parts; measure nothing.")
@click.option("--out", type=NEW_FOLDER, default="bench", help="Folder to write into.")
@json_option
def bench(names: tuple[str, ...], quick: bool, listed: bool, out: Path) -> None:
    r"""Measure error against run time of every part, on data with known true values.

    Writes one JSON file and one page with a work-precision diagram for each part: our default
    and other settings, the thesis's own method, installed peers, and the physical limit. A note
    names peers that are not installed. On a busy machine only ratios of times are meaningful.

    \b
    Example:
      labpipe bench --quick
      labpipe bench dic velocity --out BENCH
    """
    from pipelines.bench.parts import PARTS, chosen, measure_all

    wanted = chosen(names)
    if listed:
        emit({n: PARTS[n][1] for n in wanted}, (f"{n:18}{PARTS[n][1]}" for n in wanted))
        return
    from labpipe import files
    from pipelines.bench import page
    from pipelines.bench.measure import machine

    with counted(len(wanted)) as begin:
        results, failures = measure_all(wanted, quick, begin or (lambda _: None))
    about = machine()
    document = page.as_document(results, failures, about)
    files.write_text(out / "bench.json", json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False) + "\n")
    files.write_text(out / "bench.html", page.render(results, failures, about))
    failed = [f"failed: {failure.name}: {failure.message}" for failure in failures]
    emit(document, [f"wrote {out / 'bench.html'} and bench.json"], errors=failed, code=bool(failures))


@click.group()
def acquire() -> None:
    r"""Record a running sensor into a file of a session.

    \b
    Example:
      labpipe acquire keyence my-session/laser/drop_1.csv --host 192.168.0.10 --decimals 4 --duration "5 s"
    """


@acquire.command()
@click.argument("file", type=NEW_FILE)
@click.option("--host", required=True, help="Address of the controller.")
@click.option("--port", type=click.IntRange(1, 65535), help="TCP port; 24687 for lk-g5000, required for dl-en1.")
@click.option("--protocol", type=click.Choice(["lk-g5000", "dl-en1"]), default="lk-g5000", help="Of the controller.")
@click.option("--output", "outputs", type=int, multiple=True, default=(1,), help="Output to record; may be repeated.")
@click.option("--decimals", type=int, multiple=True, required=True, help="Decimals of the display, for every output.")
@click.option("--unit", "units", multiple=True, default=("mm",), help="Unit on the display, for every output.")
@value_option("--interval", "s", "Time between two readings.", default="10 ms")
@value_option("--duration", "s", "Of the recording.", required=True)
@value_option("--patience", "s", "Longest wait for an answer of the controller.", default="10 s")
@json_option
def keyence(file: Path, **given: Any) -> None:
    r"""Record a Keyence displacement controller over TCP into FILE.

    FILE has the layout of a storage file and is readable at any moment, also after a crash; FILE.times.csv holds the
    real time of every reading. A missing reading leaves its row empty. Ctrl-C ends the recording. The protocols were
    tested against an emulator only: compare the first readings with the display.

    \b
    Example:
      labpipe acquire keyence drop_1.csv --host 192.168.0.10 --decimals 4 --duration "2 s"
    """
    from instruments import keyence as laser

    outputs, interval, patience = given["outputs"], given["interval"], given["patience"]
    port = given["port"] or (laser.LK_PORT if given["protocol"] == laser.LK_G5000 else None)
    if port is None:
        raise click.UsageError("--port is needed: that of a DL-EN1 is set on the unit")
    decimals, units = (each * len(outputs) if len(each) == 1 else each for each in (given["decimals"], given["units"]))
    wait = min(max(1.0, 2 * interval), patience)
    done = laser.record(
        file,
        laser.Setup(outputs, decimals, units, interval),
        lambda: laser.Connection(given["protocol"], given["host"], port, outputs, wait),
        given["duration"],
        patience=patience,
    )
    _show(members(done, *(each.name for each in fields(done) if not each.name.startswith("_"))))


@acquire.command()
@click.argument("file", type=NEW_FILE)
@json_option
def recover(file: Path) -> None:
    r"""Cut off the half line that a power failure may leave at the end of a recording.

    \b
    Example:
      labpipe acquire recover my-session/laser/drop_1.csv
    """
    from instruments import keyence as laser

    _show(laser.recover(file))


def _show(found: dict[str, Any]) -> None:
    emit(found, (f"{name.replace('_', ' '):20}{value}" for name, value in found.items()))
