"""Proposals of ``init``: other laser exports are repeats of a drop."""

from pipelines.experiments._kind import Found
from pipelines.experiments.shared import proposals
from pipelines.experiments.shared.record_templates import laser_record


@proposals.of_groups(proposals.without_repeat)
def proposed(found: Found, files: list[str], name: str) -> str:
    """Propose an experiment for every group of repeats, of one name."""
    return f"""[experiments.{name}]
kind = "ball_drop"  # laser readings of a fall
laser = {proposals.listed(files)}
calibration = "{laser_record(found, files[0])}"  # inclination of the sensor, with its uncertainty
{proposals.height_line(files[0], proposals.fall_shown(found.path(files[0])))}

[experiments.{name}.sphere]
{proposals.SPHERE}
{proposals.MOVING_MASS}
{proposals.material_line(files[0], found)}"""
