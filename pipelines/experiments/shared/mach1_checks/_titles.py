"""Quantities that a Mach-1 file is checked by, and the titles of these checks."""

from pipelines.experiments.shared import mach1_traces
from pipelines.experiments.shared.judgements import Title

AMPLITUDE, FREQUENCY = "amplitude of the oscillation", "frequency of the oscillation"
TRAVEL, SPEED = "travel of the ramp", "speed of the ramp"
APPROACH, HOLD = "speed of the approach", "length of the hold"
CLOCK, CAPACITY, MODULUS = "clock of the blocks", "capacity of the cell", "contact modulus"
RATIO, SCALE = "force for the named material", "scale of the cell"
SIGN, FALL, PHASE = "sign of the stiffness", "fall of the force in the hold", "phase lag"
DIRECTION, DELAY, SWAPPED = "direction of the motion", "delay of the filter", "order of the columns"

TITLES = {
    "columns": Title(
        "Position and force stand in their columns, with the stage's direction and the cell's sign.",
        (SWAPPED, "columns of the file", DIRECTION, SIGN),
    ),
    "commands": Title(
        "The motion has the amplitude, frequency, travel and speed of its command.",
        (AMPLITUDE, FREQUENCY, TRAVEL, SPEED, APPROACH, HOLD),
    ),
    "clock": Title("Times of the readings and of the blocks are consistent.", (CLOCK,)),
    "load cell": Title(
        "The force stays within the cell's capacity and is scaled once.",
        (CAPACITY, SCALE, DELAY, "response of the cell", "saturation of the cell"),
    ),
    "order of motion and force": Title("Force follows motion and relaxes: 0 < phase lag < 90°.", (PHASE, FALL)),
    "steadiness of the force": Title(
        "The level of the force does not jump while the stage holds or oscillates.", (mach1_traces.JUMP,)
    ),
    "punch": Title(
        "The stated punch can be pressed in so far.",
        ("size of the punch", "period of the punch", "depth of the indentation"),
    ),
    "contact modulus": Title(
        "Forces give one modulus, that of the material, at all depths.",
        (MODULUS, RATIO, "force at other depths", "relaxation at other depths"),
    ),
    "continuity of the readings": Title(
        "A recording holds every reading once; readings have inertia and noise.",
        (mach1_traces.SPIKE, mach1_traces.QUIET, mach1_traces.HELD, "readings of another record"),
    ),
}
