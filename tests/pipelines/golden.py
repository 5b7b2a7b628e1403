"""Numbers of processed sessions that may not change without a reason.

``python -m tests.pipelines.golden SESSION REASON`` processes one of the sessions again, records its numbers and appends
the reason with the date to the history. A number may differ by a fiftieth of its standard uncertainty, and where it has
none by a part in ten thousand: releases of numpy and scipy stay far below both.
"""

import datetime
import json
import math
import shutil
import sys
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import xarray as xr

RECORD = Path(__file__).parent / "golden.json"
ROOT = Path(__file__).parents[2]
SESSIONS = ("small", "core", "films")
SHARE = 0.02  # of the standard uncertainty
RELATIVE = 1e-4
MOST_VALUES = 3  # of an array, from its beginning
SKIPPED = {"readings", "loads", "displacement", "keys", "loops", "velocity"}
"""Stages whose results are series and pictures; what follows from them is recorded."""


def numbers(folder: Path) -> dict[str, list[float]]:
    """Return the scalars and the first values of short arrays, each with its tolerance."""
    from pipelines.session import open_session, results

    found: dict[str, list[float]] = {}
    for experiment in open_session(folder).experiments:
        for node in results(folder, experiment).subtree:
            stage, _, recording = node.path.strip("/").partition("/")
            if stage not in SKIPPED and not recording:  # what repeats have in common is enough
                for name, value, tolerance in _numbers(node.to_dataset()):
                    found[f"{experiment}{node.path}.{name}"] = [value, float(f"{tolerance:.3g}")]
    return found


def _numbers(dataset: xr.Dataset) -> Iterator[tuple[str, float, float]]:
    for name in sorted(map(str, dataset.data_vars)):
        variable = dataset[name]
        if variable.dtype.kind != "f" or name.startswith("u_") or "time" in variable.dims:
            continue
        spread = dataset.get(f"u_{name}")
        values = variable.values.ravel()[:MOST_VALUES].tolist()
        for i, value in enumerate(values):
            u = math.nan if spread is None else float(spread.values.ravel()[min(i, spread.size - 1)])
            tolerance = max(SHARE * u, 1e-9 * abs(value)) if u > 0 else RELATIVE * abs(value)
            if math.isfinite(value):
                yield f"{name}[{i}]", value, tolerance


def recorded() -> dict[str, Any]:
    """Return what was recorded: ``numbers`` of every session, and the ``history`` of reasons."""
    if not RECORD.is_file():
        return {"numbers": {}, "history": []}
    found: dict[str, Any] = json.loads(RECORD.read_text("utf-8"))
    return found


def changes(before: Mapping[str, list[float]], now: Mapping[str, list[float]]) -> list[str]:
    """Say which numbers are new, gone, or further off than their tolerance."""
    said = [f"{name}: gone" for name in before.keys() - now.keys()]
    said += [f"{name}: new" for name in now.keys() - before.keys()]
    for name in before.keys() & now.keys():
        value, tolerance = before[name]
        if abs(now[name][0] - value) > tolerance:
            said.append(f"{name}: {value!r} -> {now[name][0]!r} (tolerance {tolerance:.2g})")
    return sorted(said)


def processed(name: str, folder: Path) -> Path:
    """Write and process one of the sessions in an empty folder."""
    from pipelines.session import process
    from tests.pipelines.small import write_small

    if name == "small":
        write_small(folder)
    else:
        shutil.copytree(ROOT / "sample_data" / name, folder, dirs_exist_ok=True)
    outcome = process(folder, jobs=1)
    assert outcome.exit_code == 0, [o.message for o in outcome.failures]
    return folder


def main(name: str, reason: str) -> None:
    """Record the numbers of a session as they are now."""
    record = recorded()
    with tempfile.TemporaryDirectory() as folder:
        now = numbers(processed(name, Path(folder)))
    said = changes(record["numbers"].get(name, {}), now)
    record["numbers"][name] = now
    day = datetime.datetime.now(datetime.UTC).date().isoformat()
    record["history"].append({"session": name, "day": day, "reason": reason, "changed": len(said)})
    RECORD.write_text(json.dumps(record, indent=1, sort_keys=True) + "\n", "utf-8")
    sys.stdout.write("\n".join([*said[:40], f"{len(now)} numbers, {len(said)} changed\n"]))


if __name__ == "__main__":
    if len(sys.argv) != 3 or sys.argv[1] not in SESSIONS or len(sys.argv[2].split()) < 3:
        sys.exit(f"usage: python -m tests.pipelines.golden {'|'.join(SESSIONS)} 'why they changed'")
    main(sys.argv[1], sys.argv[2])
