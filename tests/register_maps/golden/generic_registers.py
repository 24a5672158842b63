"""Golden vectors of generic-registers, typed from its YAML file as a person reads it.

Eight holding registers from 0: alive, car floor, motion, door, mode, flags, destination, call accepted. Flags: bit 0 is 1
when there is no fire, bit 1 robot mode on, bit 2 level, bit 3 obstruction, bit 4 overload. Floors are int16, so the first
basement (-1) is FFFF. Outputs from 16: go to, hold door, robot mode, close door; each written alone, so FC06.
"""

from drivers.model import Command, CommandKind, LiftValues, Proof
from register_maps.words import Door, Mode, Motion, Side
from tests.register_maps.golden.vectors import Does, Exchange, Face, Golden, Says


def flags(
    *, fire: bool = False, robot: bool = False, level: bool = False, curtain: bool = False, overload: bool = False
) -> dict[str, bool]:
    return {
        "fire": fire,
        "robot_mode_on": robot,
        "level": level,
        "obstruction.front": curtain,
        "overload": overload,
    }


def values(
    floor: str | None,
    motion: Motion,
    door: Door,
    mode: Mode,
    told: dict[str, bool],
    *,
    destination: str | None = None,
    accepted: str | None = None,
    unknown: dict[str, int] | None = None,
) -> LiftValues:
    return LiftValues(
        floor=floor,
        destination=destination,
        call_accepted=accepted,
        motion=motion,
        mode=mode,
        doors={Side.FRONT: door},
        flags=told,
        unknown=unknown or {},
    )


SAYS = (
    # alive 42, floor -1, motion 1, door 1, mode 1, flags 00101 (level, no fire), destination 0 = none, accepted 0 = none
    Says(
        "idle in the basement, floor -1",
        "00 00 00 13 01 03 10 00 2A FF FF 00 01 00 01 00 01 00 05 00 00 00 00",
        values("B1", Motion.STOPPED, Door.CLOSED, Mode.NORMAL, flags(level=True)),
    ),
    # motion 2 = up, mode 2 = robot, flags 00011 (robot, no fire), destination 2, accepted 2
    Says(
        "on its way from the basement to L2 for a robot",
        "00 00 00 13 01 03 10 00 2B FF FF 00 02 00 01 00 02 00 03 00 02 00 02",
        values("B1", Motion.UP, Door.CLOSED, Mode.ROBOT, flags(robot=True), destination="L2", accepted="L2"),
    ),
    # floor 1 passed, motion 3 = down, destination -1, accepted -1
    Says(
        "passing L1 on its way down to the basement",
        "00 00 00 13 01 03 10 00 2C 00 01 00 03 00 01 00 02 00 03 FF FF FF FF",
        values("L1", Motion.DOWN, Door.CLOSED, Mode.ROBOT, flags(robot=True), destination="B1", accepted="B1"),
    ),
    # door 2 = opening; flags 00111 (level, robot, no fire)
    Says(
        "the door opens at L2",
        "00 00 00 13 01 03 10 00 2D 00 02 00 01 00 02 00 02 00 07 00 00 00 00",
        values("L2", Motion.STOPPED, Door.OPENING, Mode.ROBOT, flags(robot=True, level=True)),
    ),
    # door 3 = open
    Says(
        "open at L2",
        "00 00 00 13 01 03 10 00 2E 00 02 00 01 00 03 00 02 00 07 00 00 00 00",
        values("L2", Motion.STOPPED, Door.OPEN, Mode.ROBOT, flags(robot=True, level=True)),
    ),
    # door 4 = closing, mode 1; flags 01101 (obstruction, level, no fire)
    Says(
        "the door closes on somebody at L1",
        "00 00 00 13 01 03 10 00 2F 00 01 00 01 00 04 00 01 00 0D 00 00 00 00",
        values("L1", Motion.STOPPED, Door.CLOSING, Mode.NORMAL, flags(level=True, curtain=True)),
    ),
    # door 5 = fault, mode 3 = independent; flags 10101 (overload, level, no fire)
    Says(
        "overloaded, with a door fault, in independent service",
        "00 00 00 13 01 03 10 00 30 00 01 00 01 00 05 00 03 00 15 00 00 00 00",
        values("L1", Motion.STOPPED, Door.FAULT, Mode.INDEPENDENT, flags(level=True, overload=True)),
    ),
    # mode 4; not level
    Says(
        "inspection",
        "00 00 00 13 01 03 10 00 31 00 01 00 03 00 01 00 04 00 01 00 00 00 00",
        values("L1", Motion.DOWN, Door.CLOSED, Mode.INSPECTION, flags()),
    ),
    # mode 5, and bit 0 fallen: flags 00100; sent to floor 1
    Says(
        "fire recall to L1",
        "00 00 00 13 01 03 10 00 32 00 02 00 03 00 01 00 05 00 00 00 01 00 00",
        values("L2", Motion.DOWN, Door.CLOSED, Mode.FIRE, flags(fire=True), destination="L1"),
    ),
    # mode says 1, normal, but bit 0 is 0: a fire is believed from whoever tells it
    Says(
        "the fire bit alone",
        "00 00 00 13 01 03 10 00 33 00 01 00 01 00 03 00 01 00 04 00 00 00 00",
        values("L1", Motion.STOPPED, Door.OPEN, Mode.FIRE, flags(fire=True, level=True)),
    ),
    # mode 6 and 7
    Says(
        "emergency power",
        "00 00 00 13 01 03 10 00 34 00 01 00 01 00 03 00 06 00 05 00 00 00 00",
        values("L1", Motion.STOPPED, Door.OPEN, Mode.EMERGENCY, flags(level=True)),
    ),
    Says(
        "out of service",
        "00 00 00 13 01 03 10 00 35 00 01 00 01 00 01 00 07 00 05 00 00 00 00",
        values("L1", Motion.STOPPED, Door.CLOSED, Mode.OUT_OF_SERVICE, flags(level=True)),
    ),
    # floors 9, -2 and 258 are none of the site's; motion 7, door 6 and mode 8 are not in the tables
    Says(
        "codes that no table lists",
        "00 00 00 13 01 03 10 00 36 00 09 00 07 00 06 00 08 00 05 FF FE 01 02",
        values(
            None,
            Motion.UNKNOWN,
            Door.UNKNOWN,
            Mode.UNKNOWN,
            flags(level=True),
            unknown={"car_floor": 9, "motion": 7, "door.front": 6, "mode": 8, "destination": -2, "call_accepted": 258},
        ),
    ),
    # 8000 is the lowest int16
    Says(
        "floor -32768",
        "00 00 00 13 01 03 10 00 37 80 00 00 01 00 01 00 01 00 05 00 00 00 00",
        values(None, Motion.STOPPED, Door.CLOSED, Mode.NORMAL, flags(level=True), unknown={"car_floor": -32768}),
    ),
    # "a controller that has just started and serves zeros reads as unknown and on fire, never as a healthy lift"
    Says(
        "nothing but zeros",
        "00 00 00 13 01 03 10 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00",
        values(
            None,
            Motion.UNKNOWN,
            Door.UNKNOWN,
            Mode.FIRE,
            flags(fire=True),
            unknown={"motion": 0, "door.front": 0, "mode": 0},
        ),
    ),
    # a floor code of -1 is real, everything else in it is not: no word to trust, so no mode either
    Says(
        "nothing but ones, as from a broken back plane",
        "00 00 00 13 01 03 10 FF FF FF FF FF FF FF FF FF FF FF FF FF FF FF FF",
        values(
            "B1",
            Motion.UNKNOWN,
            Door.UNKNOWN,
            Mode.UNKNOWN,
            flags(robot=True, level=True, curtain=True, overload=True),
            destination="B1",
            accepted="B1",
            unknown={"motion": 65535, "door.front": 65535, "mode": 65535},
        ),
    ),
)

PEOPLE_AT_L1 = "00 00 00 13 01 03 10 00 64 00 01 00 01 00 01 00 01 00 05 00 00 00 00"
ROBOT_AT_L1 = "00 00 00 13 01 03 10 00 65 00 01 00 01 00 01 00 02 00 07 00 00 00 00"
ROBOT_AT_L1_OPEN = "00 00 00 13 01 03 10 00 66 00 01 00 01 00 03 00 02 00 07 00 00 00 00"
ROBOT_AT_L1_STILL_OPEN = "00 00 00 13 01 03 10 00 6B 00 01 00 01 00 03 00 02 00 07 00 00 00 00"
ROBOT_AT_L1_CLOSING = "00 00 00 13 01 03 10 00 67 00 01 00 01 00 04 00 02 00 07 00 00 00 00"
CALLED_TO_L2 = "00 00 00 13 01 03 10 00 68 00 01 00 01 00 01 00 02 00 07 00 02 00 02"
CALLED_TO_B1 = "00 00 00 13 01 03 10 00 69 00 01 00 01 00 01 00 02 00 07 FF FF FF FF"
GOING_UP = "00 00 00 13 01 03 10 00 6A 00 01 00 02 00 01 00 02 00 03 00 02 00 00"

READ_CALL = "00 00 00 06 01 03 00 10 00 01"
READ_HOLD = "00 00 00 06 01 03 00 11 00 01"
READ_MODE = "00 00 00 06 01 03 00 12 00 01"
READ_CLOSE = "00 00 00 06 01 03 00 13 00 01"
READS_0 = "00 00 00 05 01 03 02 00 00"
READS_1 = "00 00 00 05 01 03 02 00 01"

CALL_L2 = "00 00 00 06 01 06 00 10 00 02"
CALL_B1 = "00 00 00 06 01 06 00 10 FF FF"
NO_CALL = "00 00 00 06 01 06 00 10 00 00"
HOLD = "00 00 00 06 01 06 00 11 00 01"
NO_HOLD = "00 00 00 06 01 06 00 11 00 00"
MODE = "00 00 00 06 01 06 00 12 00 01"
NO_MODE = "00 00 00 06 01 06 00 12 00 00"
CLOSE = "00 00 00 06 01 06 00 13 00 01"
NO_CLOSE = "00 00 00 06 01 06 00 13 00 00"
# FC06 answers with what it was sent.

DOES = (
    # go_to: a pulse of 0.5 s on register 16; rest is 0; the lamp is call_accepted
    Does(
        "call L2, shown by the accepted call",
        Command(CommandKind.GO_TO, "L2"),
        ROBOT_AT_L1,
        CALLED_TO_L2,
        Proof.LAMP,
        (
            Exchange(0.0, CALL_L2, CALL_L2),
            Exchange(0.5, NO_CALL, NO_CALL),
            Exchange(0.5, READ_CALL, READS_0),
        ),
    ),
    Does(
        "call the basement: -1 is FFFF",
        Command(CommandKind.GO_TO, "B1"),
        ROBOT_AT_L1,
        CALLED_TO_B1,
        Proof.LAMP,
        (
            Exchange(0.0, CALL_B1, CALL_B1),
            Exchange(0.5, NO_CALL, NO_CALL),
            Exchange(0.5, READ_CALL, READS_0),
        ),
    ),
    Does(
        "call L2, shown by the car that goes up; the release sticks at the second attempt",
        Command(CommandKind.GO_TO, "L2"),
        ROBOT_AT_L1,
        GOING_UP,
        Proof.EFFECT,
        (
            Exchange(0.0, CALL_L2, CALL_L2),
            Exchange(0.5, NO_CALL, NO_CALL),
            Exchange(0.5, READ_CALL, "00 00 00 05 01 03 02 00 02"),
            Exchange(0.7, NO_CALL, NO_CALL),
            Exchange(0.7, READ_CALL, READS_0),
        ),
    ),
    # hold_door.front: register 17, written again every second, confirmed by read-back
    Does(
        "hold the door",
        Command(CommandKind.HOLD_DOOR, side=Side.FRONT),
        ROBOT_AT_L1_OPEN,
        ROBOT_AT_L1_STILL_OPEN,
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
    # robot_mode: register 18, written again every second, confirmed by bit 1 of the flags alone
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
    # close_door.front: a pulse of 0.5 s on register 19
    Does(
        "press the close button",
        Command(CommandKind.CLOSE_DOOR, side=Side.FRONT),
        ROBOT_AT_L1_OPEN,
        ROBOT_AT_L1_CLOSING,
        Proof.EFFECT,
        (
            Exchange(0.0, CLOSE, CLOSE),
            Exchange(0.5, NO_CLOSE, NO_CLOSE),
            Exchange(0.5, READ_CLOSE, READS_0),
        ),
    ),
)

POLL = "00 00 00 06 01 03 00 00 00 08"
"""FC03 at 0, eight registers."""

# The simulated lift beats twice a second, so the first word of its answers is twice the time. Floors are 3.2 m apart: 5 s
# at 1 m/s; the door opens in 2 s, stays for 3 s, closes in 2.5 s.
FACE = (
    Face(
        0.0,
        "idle in the basement, in service for people",
        POLL,
        "00 00 00 13 01 03 10 00 00 FF FF 00 01 00 01 00 01 00 05 00 00 00 00",
    ),
    Face(0.0, "a call without robot mode is taken", CALL_L2, CALL_L2),
    Face(0.5, "and let go", NO_CALL, NO_CALL),
    Face(1.0, "it did nothing", POLL, "00 00 00 13 01 03 10 00 02 FF FF 00 01 00 01 00 01 00 05 00 00 00 00"),
    Face(1.0, "robot mode is asked for", MODE, MODE),
    Face(
        2.0, "and granted: mode 2, bit 1", POLL, "00 00 00 13 01 03 10 00 04 FF FF 00 01 00 01 00 02 00 07 00 00 00 00"
    ),
    Face(2.0, "L1 is called", "00 00 00 06 01 06 00 10 00 01", "00 00 00 06 01 06 00 10 00 01"),
    Face(2.5, "the call is let go", NO_CALL, NO_CALL),
    Face(
        2.5,
        "it goes up, away from level, to 1, and the call is accepted",
        POLL,
        "00 00 00 13 01 03 10 00 05 FF FF 00 02 00 01 00 02 00 03 00 01 00 01",
    ),
    Face(4.0, "robot mode is asked for again", MODE, MODE),
    Face(
        4.5,
        "still between the floors: the basement is what it passed last",
        POLL,
        "00 00 00 13 01 03 10 00 09 FF FF 00 02 00 01 00 02 00 03 00 01 00 01",
    ),
    Face(6.0, "robot mode is asked for again", MODE, MODE),
    Face(
        8.0,
        "at L1, level; the door opens and the call is served",
        POLL,
        "00 00 00 13 01 03 10 00 10 00 01 00 01 00 02 00 02 00 07 00 00 00 00",
    ),
    Face(
        8.0,
        "the door is held and robot mode with it, in one FC16",
        "00 00 00 0B 01 10 00 11 00 02 04 00 01 00 01",
        "00 00 00 06 01 10 00 11 00 02",
    ),
    Face(
        10.9,
        "open; the hold outlasts silence up to 3 s",
        POLL,
        "00 00 00 13 01 03 10 00 15 00 01 00 01 00 03 00 02 00 07 00 00 00 00",
    ),
    Face(
        12.0,
        "after 3 s without a write robot mode and hold have fallen; the dwell begins",
        POLL,
        "00 00 00 13 01 03 10 00 18 00 01 00 01 00 03 00 01 00 05 00 00 00 00",
    ),
    Face(
        15.0, "and ends: the door closes", POLL, "00 00 00 13 01 03 10 00 1E 00 01 00 01 00 04 00 01 00 05 00 00 00 00"
    ),
    Face(
        15.0,
        "the outputs still say what was written",
        "00 00 00 06 01 03 00 10 00 04",
        "00 00 00 0B 01 03 08 00 00 00 01 00 01 00 00",
    ),
    Face(
        17.0,
        "robot mode again, the hold let go, in one FC16",
        "00 00 00 0B 01 10 00 11 00 02 04 00 00 00 01",
        "00 00 00 06 01 10 00 11 00 02",
    ),
    Face(18.0, "granted at L1", POLL, "00 00 00 13 01 03 10 00 24 00 01 00 01 00 01 00 02 00 07 00 00 00 00"),
    Face(18.0, "the basement is called: FFFF", CALL_B1, CALL_B1),
    Face(18.5, "the call is let go", NO_CALL, NO_CALL),
    Face(19.0, "it goes down, to -1", POLL, "00 00 00 13 01 03 10 00 26 00 01 00 03 00 01 00 02 00 03 FF FF FF FF"),
    Face(20.5, "robot mode is asked for again", MODE, MODE),
    Face(23.0, "robot mode is asked for again", MODE, MODE),
    Face(25.5, "open in the basement", POLL, "00 00 00 13 01 03 10 00 33 FF FF 00 01 00 03 00 02 00 07 00 00 00 00"),
    Face(25.5, "the close button", CLOSE, CLOSE),
    Face(26.0, "is let go", NO_CLOSE, NO_CLOSE),
    Face(
        26.5,
        "and the door closes before its dwell is over",
        POLL,
        "00 00 00 13 01 03 10 00 35 FF FF 00 01 00 04 00 02 00 07 00 00 00 00",
    ),
    # What it does not serve.
    Face(27.0, "register 8 is in the gap: exception 02", "00 00 00 06 01 03 00 08 00 01", "00 00 00 03 01 83 02"),
    Face(27.0, "so is a read that runs into it", "00 00 00 06 01 03 00 00 00 09", "00 00 00 03 01 83 02"),
    Face(27.0, "and a write", "00 00 00 06 01 06 00 14 00 01", "00 00 00 03 01 86 02"),
    Face(27.0, "it has no coils: exception 01", "00 00 00 06 01 05 00 00 FF 00", "00 00 00 03 01 85 01"),
    Face(27.0, "nobody plays unit 255: exception 0B", "00 00 00 06 FF 03 00 00 00 08", "00 00 00 03 FF 83 0B"),
)

GENERIC_REGISTERS = Golden(
    map_name="generic-registers",
    floors={"B1": -1, "L1": 1, "L2": 2},
    poll=POLL,
    takes_over=((READ_CALL, READS_0), (READ_HOLD, READS_0), (READ_MODE, READS_0), (READ_CLOSE, READS_0)),
    says=SAYS,
    does=DOES,
    key="normal",
    face=FACE,
)
