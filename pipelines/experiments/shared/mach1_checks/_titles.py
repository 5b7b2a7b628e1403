"""Quantities that a Mach-1 file is checked by, and the titles of these checks."""

from pipelines.experiments.shared import mach1_traces
from pipelines.experiments.shared.judgements import Title

AMPLITUDE, FREQUENCY = "amplitude of the oscillation", "frequency of the oscillation"
TRAVEL, SPEED = "travel of the ramp", "speed of the ramp"
APPROACH, HOLD = "speed of the approach", "length of the hold"
CLOCK, CAPACITY, MODULUS = "clock of the blocks", "capacity of the cell", "contact modulus"
RATIO, SCALE = "force for the named material", "scale of the cell"
SIGN, FALL, PHASE = "sign of the stiffness", "fall of the force in the hold", "phase lag"
LATE, LEADS = "force after the ramp", "order of motion and force"
KNOCK, DRIFT = "steadiness of the force", "mean force of the oscillation"
STEADY = "stiffness from cycle to cycle"
STAGE, DIRECTION = "position within the stage", "direction of the motion"
SHAPE, CYCLES = "shape of the oscillation", "cycles of the oscillation"
TOUCHED = "position of first touch"
RESOLVED, CALIBRATED, AXES = "resolution of the position", "date of the cell", "axes"
DELAY, SWAPPED, CELL = "delay of the filter", "order of the columns", "cell of the record"
FACTOR = "factor of the cell"

TITLES = {
    "columns": Title(
        "Position and force stand in their columns, with the stage's direction and the cell's sign.",
        (SWAPPED, "columns of the file", STAGE, DIRECTION, SIGN, AXES),
    ),
    "commands": Title(
        "The motion has the amplitude, frequency, travel and speed of its command.",
        (AMPLITUDE, FREQUENCY, TRAVEL, SPEED, APPROACH, HOLD, SHAPE, CYCLES, RESOLVED),
    ),
    "clock": Title("Times of the readings, blocks and files are consistent.", (CLOCK, "times of the tests")),
    "load cell": Title(
        "The force stays within the cell's capacity and is scaled once.",
        (
            CAPACITY,
            SCALE,
            FACTOR,
            CELL,
            DELAY,
            "response of the cell",
            "saturation of the cell",
            "factor of the record",
        ),
    ),
    "order of motion and force": Title(
        "Force follows motion and relaxes: 0 < phase lag < 90°.", (LEADS, PHASE, LATE, FALL)
    ),
    "steadiness of the force": Title(
        "At a constant mean depth, force and stiffness do not grow.",
        (KNOCK, DRIFT, STEADY, mach1_traces.JUMP, mach1_traces.MOVED, mach1_traces.ZERO),
    ),
    "first touch and punch": Title(
        "The stated position of first touch is that of the record; the punch can be pressed in so far.",
        (TOUCHED, mach1_traces.FOUND, "size of the punch", "period of the punch", "depth of the indentation"),
    ),
    "contact modulus": Title(
        "Forces give one modulus, that of the material, at all depths.",
        (MODULUS, RATIO, "force at other depths", "relaxation at other depths"),
    ),
    "continuity of the readings": Title(
        "A recording holds every reading once; readings have inertia and noise.",
        (mach1_traces.SPIKE, mach1_traces.QUIET, mach1_traces.LEAP, mach1_traces.HELD, "rows of another file"),
    ),
}
