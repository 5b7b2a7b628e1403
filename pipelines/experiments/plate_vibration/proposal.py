"""Proposals of ``init``: laser exports named after the plate."""

from pipelines.experiments._kind import Found
from pipelines.experiments.shared import proposals
from pipelines.experiments.shared.record_templates import laser_record


@proposals.of_groups(proposals.without_repeat, lambda _, names: [*filter(proposals.sees_plate, names)])
def proposed(found: Found, files: list[str], name: str) -> str:
    """Propose an experiment for recordings of the plate."""
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
