"""Proposals of ``init`` from laser exports: of the plate, of a sphere under loads, and else repeats of a drop."""

from collections.abc import Iterator, Sequence

from pipelines.experiments._kind import Found, Proposed
from pipelines.experiments.shared import proposals
from pipelines.experiments.shared.proposals import GAP
from pipelines.experiments.shared.record_templates import laser_record


def drops(found: Found, names: Sequence[str]) -> Iterator[Proposed]:
    """Propose an experiment for every group of repeats, of one name."""
    yield from proposals.of_groups(found, names, proposals.without_repeat, _drop)


def plates(found: Found, names: Sequence[str]) -> Iterator[Proposed]:
    """Propose an experiment for recordings that are named after the plate."""
    yield from proposals.of_groups(found, names, proposals.without_repeat, _plate, proposals.sees_plate)


def loads(found: Found, names: Sequence[str]) -> Iterator[Proposed]:
    """Propose an experiment for slow readings."""

    def is_slow(name: str) -> bool:
        return proposals.is_slow(found.path(name))

    yield from proposals.of_groups(found, names, proposals.without_repeat, _loading, is_slow)


def _drop(found: Found, files: Sequence[str], name: str) -> str:
    return f"""[experiments.{name}]
kind = "ball_drop"  # laser readings of a fall
laser = {proposals.listed(files)}
calibration = "{laser_record(found, files[0])}"  # inclination of the sensor, with its uncertainty
{proposals.height_line(files[0], proposals.fall_shown(found.path(files[0])))}

[experiments.{name}.sphere]
{proposals.SPHERE}
{proposals.MOVING_MASS}
{proposals.material_line(files[0], found)}"""


def _plate(found: Found, files: Sequence[str], name: str) -> str:
    record = laser_record(found, files[0], proposals.sees_plate)
    return f"""[experiments.{name}]
kind = "plate_vibration"  # proposed from the file name
calibration = "{record}"  # inclination of the sensor in its place over the plate

[experiments.{name}.sphere]  # for the modal mass; without it frequency and damping alone
{proposals.SPHERE}
{proposals.MOVING_MASS}

[[experiments.{name}.drops]]  # one such table for each material and height
{proposals.material_line(files[0], found, is_shown=True)}
{proposals.height_line(files[0])}
laser = {proposals.listed(files)}"""


def _loading(found: Found, files: Sequence[str], name: str) -> str:
    return f"""[experiments.{name}]
kind = "static_loading"  # proposed because the readings are slow
laser = "{proposals.quoted(files[0])}"
calibration = "{laser_record(found, files[0])}"  # inclination of the sensor, with its uncertainty

[experiments.{name}.sphere]
{proposals.SPHERE}
{proposals.material_line(files[0], found)}

[[experiments.{name}.loads]]  # on from the beginning
mass = "{GAP} kg"  # all that rests on the disc, holder included, with ±, e.g. "0.500 ± 0.001 kg"

[[experiments.{name}.loads]]  # one such table for each further load
mass = "{GAP} kg"  # all that rests on the disc then, with ±
# time = "2.55 min"  # when it was put on; without it the record is searched"""
