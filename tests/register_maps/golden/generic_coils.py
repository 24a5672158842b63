"""Golden vectors of generic-coils, typed from its YAML file as a person reads it.

Thirty discrete inputs from 0, so four bytes, the first input in the lowest bit of the first byte:

    byte 1  bits 0 to 7: the car is at the floor of code 0 to 7
    byte 2  bits 0 to 7: the call of code 0 to 7 is accepted
    byte 3  1 door open, 2 door closed, 4 level, 8 up, 10 down, 20 obstruction, 40 overload, 80 robot mode on
    byte 4  1 robots allowed, and 1 while all is well: 2 fire, 4 inspection, 8 independent, 10 service, 20 mains

So 3F in byte 4 is a lift without any alarm whose key switch allows robots. Outputs: FC15 over the eight call coils at 0;
hold door, close door and robot mode at 8, 9 and 10, each alone by FC05.
"""

from drivers.model import Command, CommandKind, LiftValues, Proof
from register_maps.words import Door, Mode, Motion, Side
from tests.register_maps.golden.vectors import Does, Exchange, Face, Golden, Says


def values(
    floor: str | None,
    motion: Motion,
    door: Door,
    mode: Mode,
    *told: str,
    accepted: str | None = None,
    unknown: dict[str, int] | None = None,
) -> LiftValues:
    """`told` are the flags that say yes."""
    flags = (
        *("level", "obstruction.front", "overload", "robot_mode_on", "robots_allowed"),
        *("fire", "inspection", "independent", "out_of_service", "emergency_power"),
    )
    assert set(told) <= set(flags)
    return LiftValues(
        floor=floor,
        call_accepted=accepted,
        motion=motion,
        mode=mode,
        doors={Side.FRONT: door},
        flags={flag: flag in told for flag in flags},
        unknown=unknown or {},
    )


SAYS = (
    # byte 1: bit 0; byte 3: closed 2 + level 4
    Says(
        "idle in the basement, code 0",
        "00 00 00 07 01 02 04 01 00 06 3F",
        values("B1", Motion.STOPPED, Door.CLOSED, Mode.NORMAL, "level", "robots_allowed"),
    ),
    # byte 2: bit 2; byte 3: closed 2 + up 8 + robot 80
    Says(
        "between floors on its way up to L2 for a robot",
        "00 00 00 07 01 02 04 00 04 8A 3F",
        values(None, Motion.UP, Door.CLOSED, Mode.ROBOT, "robot_mode_on", "robots_allowed", accepted="L2"),
    ),
    # byte 1: bit 1; byte 2: bit 0; byte 3: closed 2 + down 10 + robot 80
    Says(
        "passing L1 on its way down to the basement",
        "00 00 00 07 01 02 04 02 01 92 3F",
        values("L1", Motion.DOWN, Door.CLOSED, Mode.ROBOT, "robot_mode_on", "robots_allowed", accepted="B1"),
    ),
    # byte 3: level 4 + robot 80, neither limit
    Says(
        "the door moves at L2",
        "00 00 00 07 01 02 04 04 00 84 3F",
        values("L2", Motion.STOPPED, Door.MOVING, Mode.ROBOT, "level", "robot_mode_on", "robots_allowed"),
    ),
    # byte 3: open 1 + level 4 + robot 80
    Says(
        "open at L2",
        "00 00 00 07 01 02 04 04 00 85 3F",
        values("L2", Motion.STOPPED, Door.OPEN, Mode.ROBOT, "level", "robot_mode_on", "robots_allowed"),
    ),
    # byte 3: open 1 + level 4 + obstruction 20 + overload 40
    Says(
        "too many people in the doorway at L1",
        "00 00 00 07 01 02 04 02 00 65 3F",
        values(
            "L1",
            Motion.STOPPED,
            Door.OPEN,
            Mode.NORMAL,
            *("level", "obstruction.front", "overload", "robots_allowed"),
        ),
    ),
    # byte 3: both limits 3 + level 4
    Says(
        "both door limits at once",
        "00 00 00 07 01 02 04 02 00 07 3F",
        values("L1", Motion.STOPPED, Door.FAULT, Mode.NORMAL, "level", "robots_allowed"),
    ),
    # byte 3: closed 2 + up 8 + down 10
    Says(
        "up and down at once",
        "00 00 00 07 01 02 04 02 00 1A 3F",
        values("L1", Motion.UNKNOWN, Door.CLOSED, Mode.NORMAL, "robots_allowed", unknown={"motion": 3}),
    ),
    # byte 1: bits 0 and 1 are 3; byte 2: bits 1 and 2 are 6
    Says(
        "two floors and two calls at once",
        "00 00 00 07 01 02 04 03 06 06 3F",
        values(
            None,
            Motion.STOPPED,
            Door.CLOSED,
            Mode.NORMAL,
            *("level", "robots_allowed"),
            unknown={"car_floor": 3, "call_accepted": 6},
        ),
    ),
    # byte 1: bit 7, a floor that the site does not have
    Says(
        "at a floor that is none of the site's",
        "00 00 00 07 01 02 04 80 00 06 3F",
        values(None, Motion.STOPPED, Door.CLOSED, Mode.NORMAL, "level", "robots_allowed", unknown={"car_floor": 7}),
    ),
    # byte 4: each alarm takes its bit away from 3F
    Says(
        "the key switch off",
        "00 00 00 07 01 02 04 02 00 06 3E",
        values("L1", Motion.STOPPED, Door.CLOSED, Mode.NORMAL, "level"),
    ),
    Says(
        "fire",
        "00 00 00 07 01 02 04 02 00 06 3D",
        values("L1", Motion.STOPPED, Door.CLOSED, Mode.FIRE, "level", "robots_allowed", "fire"),
    ),
    Says(
        "inspection",
        "00 00 00 07 01 02 04 02 00 12 3B",
        values("L1", Motion.DOWN, Door.CLOSED, Mode.INSPECTION, "robots_allowed", "inspection"),
    ),
    Says(
        "independent service",
        "00 00 00 07 01 02 04 02 00 05 37",
        values("L1", Motion.STOPPED, Door.OPEN, Mode.INDEPENDENT, "level", "robots_allowed", "independent"),
    ),
    Says(
        "out of service",
        "00 00 00 07 01 02 04 02 00 06 2F",
        values("L1", Motion.STOPPED, Door.CLOSED, Mode.OUT_OF_SERVICE, "level", "robots_allowed", "out_of_service"),
    ),
    Says(
        "emergency power",
        "00 00 00 07 01 02 04 02 00 05 1F",
        values("L1", Motion.STOPPED, Door.OPEN, Mode.EMERGENCY, "level", "robots_allowed", "emergency_power"),
    ),
    # "a controller that has just started and serves zeros reads as on fire, at no floor, never as a healthy lift"
    Says(
        "nothing but zeros",
        "00 00 00 07 01 02 04 00 00 00 00",
        values(
            None,
            Motion.STOPPED,
            Door.MOVING,
            Mode.INSPECTION,
            *("fire", "inspection", "independent", "out_of_service", "emergency_power"),
        ),
    ),
    # thirty bits leave two of the last byte unused, and a careless device fills them too
    Says(
        "nothing but ones",
        "00 00 00 07 01 02 04 FF FF FF FF",
        values(
            None,
            Motion.UNKNOWN,
            Door.FAULT,
            Mode.ROBOT,
            *("level", "obstruction.front", "overload", "robot_mode_on", "robots_allowed"),
            unknown={"car_floor": 255, "call_accepted": 255, "motion": 3},
        ),
    ),
)

PEOPLE_AT_L1 = "00 00 00 07 01 02 04 02 00 06 3F"
ROBOT_AT_L1 = "00 00 00 07 01 02 04 02 00 86 3F"
ROBOT_AT_L1_OPEN = "00 00 00 07 01 02 04 02 00 85 3F"
CALLED_TO_L2 = "00 00 00 07 01 02 04 02 04 86 3F"
GOING_DOWN = "00 00 00 07 01 02 04 00 00 92 3F"

READ_CALLS = "00 00 00 06 01 01 00 00 00 08"
READ_HOLD = "00 00 00 06 01 01 00 08 00 01"
READ_CLOSE = "00 00 00 06 01 01 00 09 00 01"
READ_MODE = "00 00 00 06 01 01 00 0A 00 01"
READS_0 = "00 00 00 04 01 01 01 00"
READS_1 = "00 00 00 04 01 01 01 01"

WRITTEN = "00 00 00 06 01 0F 00 00 00 08"
"""FC15 echoes address 0 and quantity 8."""
CALL_B1 = "00 00 00 08 01 0F 00 00 00 08 01 01"
CALL_L1 = "00 00 00 08 01 0F 00 00 00 08 01 02"
CALL_L2 = "00 00 00 08 01 0F 00 00 00 08 01 04"
NO_CALL = "00 00 00 08 01 0F 00 00 00 08 01 00"
HOLD = "00 00 00 06 01 05 00 08 FF 00"
NO_HOLD = "00 00 00 06 01 05 00 08 00 00"
CLOSE = "00 00 00 06 01 05 00 09 FF 00"
NO_CLOSE = "00 00 00 06 01 05 00 09 00 00"
MODE = "00 00 00 06 01 05 00 0A FF 00"
NO_MODE = "00 00 00 06 01 05 00 0A 00 00"
# FC05 answers with what it was sent.

DOES = (
    # go_to: a pulse of 0.5 s over the eight call coils; the lamp is call_accepted
    Does(
        "call L2, shown by the accepted call",
        Command(CommandKind.GO_TO, "L2"),
        ROBOT_AT_L1,
        CALLED_TO_L2,
        Proof.LAMP,
        (
            Exchange(0.0, CALL_L2, WRITTEN),
            Exchange(0.5, NO_CALL, WRITTEN),
            Exchange(0.5, READ_CALLS, READS_0),
        ),
    ),
    Does(
        "call the basement, shown by the car that goes down; the release sticks at the second attempt",
        Command(CommandKind.GO_TO, "B1"),
        ROBOT_AT_L1,
        GOING_DOWN,
        Proof.EFFECT,
        (
            Exchange(0.0, CALL_B1, WRITTEN),
            Exchange(0.5, NO_CALL, WRITTEN),
            Exchange(0.5, READ_CALLS, READS_1),
            Exchange(0.7, NO_CALL, WRITTEN),
            Exchange(0.7, READ_CALLS, READS_0),
        ),
    ),
    # hold_door.front: coil 8, written again every second, confirmed by read-back
    Does(
        "hold the door",
        Command(CommandKind.HOLD_DOOR, side=Side.FRONT),
        ROBOT_AT_L1_OPEN,
        ROBOT_AT_L1_OPEN,
        None,
        (
            Exchange(0.0, HOLD, HOLD),
            Exchange(0.0, READ_HOLD, READS_1),
            Exchange(1.0, READ_HOLD, READS_1),
            Exchange(1.0, HOLD, HOLD),
            Exchange(1.5, NO_HOLD, NO_HOLD),
            Exchange(1.5, READ_HOLD, READS_0),
        ),
        let_go_s=1.5,
    ),
    # robot_mode: coil 10, written again every second, confirmed by its flag alone
    Does(
        "ask for robot mode",
        Command(CommandKind.ROBOT_MODE),
        PEOPLE_AT_L1,
        ROBOT_AT_L1,
        None,
        (
            Exchange(0.0, MODE, MODE),
            Exchange(1.0, MODE, MODE),
            Exchange(1.5, NO_MODE, NO_MODE),
            Exchange(1.5, READ_MODE, READS_0),
        ),
        let_go_s=1.5,
    ),
    # close_door.front: a pulse of 0.5 s on coil 9. Two limits tell no direction, so only a closed door shows it, and a
    # closed door ends the press: at the next poll, which is 0.1 s later
    Does(
        "press the close button",
        Command(CommandKind.CLOSE_DOOR, side=Side.FRONT),
        ROBOT_AT_L1_OPEN,
        ROBOT_AT_L1,
        Proof.EFFECT,
        (
            Exchange(0.0, CLOSE, CLOSE),
            Exchange(0.1, NO_CLOSE, NO_CLOSE),
            Exchange(0.1, READ_CLOSE, READS_0),
        ),
    ),
)

POLL = "00 00 00 06 01 02 00 00 00 1E"
"""FC02 at 0, thirty inputs."""

# Floors are 3.2 m apart: 5 s at 1 m/s; the door opens in 2 s, stays for 3 s, closes in 2.5 s.
FACE = (
    Face(0.0, "idle in the basement, in service for people", POLL, "00 00 00 07 01 02 04 01 00 06 3F"),
    Face(0.0, "a call without robot mode is taken", CALL_L2, WRITTEN),
    Face(0.5, "and let go", NO_CALL, WRITTEN),
    Face(1.0, "it did nothing", POLL, "00 00 00 07 01 02 04 01 00 06 3F"),
    Face(1.0, "robot mode is asked for", MODE, MODE),
    Face(2.0, "and granted", POLL, "00 00 00 07 01 02 04 01 00 86 3F"),
    Face(2.0, "L1 is called", CALL_L1, WRITTEN),
    Face(2.5, "the call is let go", NO_CALL, WRITTEN),
    Face(
        3.5,
        "it goes up, out of the door zone, and the call of code 1 is accepted",
        POLL,
        "00 00 00 07 01 02 04 00 02 8A 3F",
    ),
    Face(4.0, "robot mode is asked for again", MODE, MODE),
    Face(6.0, "robot mode is asked for again", MODE, MODE),
    Face(8.0, "at L1, level; the door moves and the call is served", POLL, "00 00 00 07 01 02 04 02 00 84 3F"),
    Face(8.0, "the door is held", HOLD, HOLD),
    Face(10.9, "open; the hold outlasts silence up to 3 s", POLL, "00 00 00 07 01 02 04 02 00 85 3F"),
    Face(
        12.0,
        "after 3 s without a write robot mode and hold have fallen; the dwell begins",
        POLL,
        "00 00 00 07 01 02 04 02 00 05 3F",
    ),
    Face(15.0, "and ends: the door moves", POLL, "00 00 00 07 01 02 04 02 00 04 3F"),
    # coils 8 and 10 are still set: bits 0 and 2 of the three from 8
    Face(15.0, "the outputs still say what was written", "00 00 00 06 01 01 00 08 00 03", "00 00 00 04 01 01 01 05"),
    Face(17.0, "the hold is let go", NO_HOLD, NO_HOLD),
    Face(18.5, "closed again", POLL, "00 00 00 07 01 02 04 02 00 86 3F"),
    # two call coils together are nonsense, and no call
    Face(18.5, "two floors at once", "00 00 00 08 01 0F 00 00 00 08 01 05", WRITTEN),
    Face(20.0, "it does not move", POLL, "00 00 00 07 01 02 04 02 00 86 3F"),
    # What it does not serve.
    Face(20.0, "a thirty-first input: exception 02", "00 00 00 06 01 02 00 00 00 1F", "00 00 00 03 01 82 02"),
    Face(20.0, "a twelfth coil", "00 00 00 06 01 05 00 0B FF 00", "00 00 00 03 01 85 02"),
    Face(20.0, "it has no holding registers: exception 01", "00 00 00 06 01 03 00 00 00 01", "00 00 00 03 01 83 01"),
    Face(20.0, "nobody plays unit 2: exception 0B", "00 00 00 06 02 02 00 00 00 1E", "00 00 00 03 02 82 0B"),
)

GENERIC_COILS = Golden(
    map_name="generic-coils",
    floors={"B1": 0, "L1": 1, "L2": 2},
    poll=POLL,
    takes_over=((READ_CALLS, READS_0), (READ_HOLD, READS_0), (READ_CLOSE, READS_0), (READ_MODE, READS_0)),
    says=SAYS,
    does=DOES,
    key="normal",
    face=FACE,
)
