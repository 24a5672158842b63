"""Golden vectors of seer-generic, typed from the value tables in elevator-interfaces 1.2.

The site has put the outputs at 10 (target floor), 11 (open) and 12 (close), and the inputs at 20 (floor), 21 (door), 22 (motion)
and 23 (emergency). Door: 0 closed, 1 opening, 2 closing, 3 moving, 4 open. Motion: 0 stopped, 1 up, 2 down. Emergency: 0 or 1,
"anything else is an error". To open or close, the hold time 5 is written; 0 releases. This PLC needs an edge: 0 first, for half a second.
"""

from drivers.model import Command, CommandKind, LiftValues, Proof
from register_maps.words import Door, Mode, Motion, Side
from tests.register_maps.golden.vectors import Does, Exchange, Face, Golden, Says


def values(
    floor: str | None,
    door: Door,
    motion: Motion,
    mode: Mode = Mode.NORMAL,
    *,
    emergency: bool | None = False,
    unknown: dict[str, int] | None = None,
) -> LiftValues:
    return LiftValues(
        floor=floor,
        motion=motion,
        mode=mode,
        doors={Side.FRONT: door},
        flags={} if emergency is None else {"emergency_power": emergency},
        unknown=unknown or {},
    )


# floor, door, motion, emergency
SAYS = (
    Says(
        "stopped at 1F, closed",
        "00 00 00 0B 01 03 08 00 01 00 00 00 00 00 00",
        values("1F", Door.CLOSED, Motion.STOPPED),
    ),
    Says(
        "the door opens at 1F",
        "00 00 00 0B 01 03 08 00 01 00 01 00 00 00 00",
        values("1F", Door.OPENING, Motion.STOPPED),
    ),
    Says(
        "the door closes at 2F",
        "00 00 00 0B 01 03 08 00 02 00 02 00 00 00 00",
        values("2F", Door.CLOSING, Motion.STOPPED),
    ),
    Says(
        "the door moves, and the controller cannot tell which way",
        "00 00 00 0B 01 03 08 00 02 00 03 00 00 00 00",
        values("2F", Door.MOVING, Motion.STOPPED),
    ),
    Says(
        "open at 5F",
        "00 00 00 0B 01 03 08 00 05 00 04 00 00 00 00",
        values("5F", Door.OPEN, Motion.STOPPED),
    ),
    Says(
        "passing 2F on its way up",
        "00 00 00 0B 01 03 08 00 02 00 00 00 01 00 00",
        values("2F", Door.CLOSED, Motion.UP),
    ),
    Says(
        "passing 2F on its way down",
        "00 00 00 0B 01 03 08 00 02 00 00 00 02 00 00",
        values("2F", Door.CLOSED, Motion.DOWN),
    ),
    Says(
        "an emergency at 2F",
        "00 00 00 0B 01 03 08 00 02 00 04 00 00 00 01",
        values("2F", Door.OPEN, Motion.STOPPED, Mode.EMERGENCY, emergency=True),
    ),
    # the source takes an emergency that cannot be read for one
    Says(
        "an emergency that is neither yes nor no",
        "00 00 00 0B 01 03 08 00 02 00 04 00 00 00 02",
        values("2F", Door.OPEN, Motion.STOPPED, Mode.UNKNOWN, emergency=None, unknown={"emergency_power": 2}),
    ),
    # 0 clears the target, so it is no floor
    Says(
        "nothing but zeros",
        "00 00 00 0B 01 03 08 00 00 00 00 00 00 00 00",
        values(None, Door.CLOSED, Motion.STOPPED, unknown={"car_floor": 0}),
    ),
    Says(
        "codes that no table lists",
        "00 00 00 0B 01 03 08 00 03 00 05 00 03 00 00",
        values(None, Door.UNKNOWN, Motion.UNKNOWN, unknown={"car_floor": 3, "door.front": 5, "motion": 3}),
    ),
    Says(
        "nothing but ones",
        "00 00 00 0B 01 03 08 FF FF FF FF FF FF FF FF",
        values(
            None,
            Door.UNKNOWN,
            Motion.UNKNOWN,
            Mode.UNKNOWN,
            emergency=None,
            unknown={"car_floor": 65535, "door.front": 65535, "motion": 65535, "emergency_power": 65535},
        ),
    ),
)

CLOSED_AT_1F = "00 00 00 0B 01 03 08 00 01 00 00 00 00 00 00"
GOING_UP = "00 00 00 0B 01 03 08 00 01 00 00 00 01 00 00"
OPEN_AT_1F = "00 00 00 0B 01 03 08 00 01 00 04 00 00 00 00"
CLOSING_AT_1F = "00 00 00 0B 01 03 08 00 01 00 02 00 00 00 00"

GO_5F = "00 00 00 06 01 06 00 0A 00 05"
NO_FLOOR = "00 00 00 06 01 06 00 0A 00 00"
READ_FLOOR = "00 00 00 06 01 03 00 0A 00 01"
OPEN_5 = "00 00 00 06 01 06 00 0B 00 05"
OPEN_0 = "00 00 00 06 01 06 00 0B 00 00"
READ_OPEN = "00 00 00 06 01 03 00 0B 00 01"
CLOSE_5 = "00 00 00 06 01 06 00 0C 00 05"
CLOSE_0 = "00 00 00 06 01 06 00 0C 00 00"
READ_CLOSE = "00 00 00 06 01 03 00 0C 00 01"
READS_0 = "00 00 00 05 01 03 02 00 00"
READS_5 = "00 00 00 05 01 03 02 00 05"

DOES = (
    Does(
        "go to 5F: the car moves up",
        Command(CommandKind.GO_TO, "5F"),
        CLOSED_AT_1F,
        GOING_UP,
        Proof.EFFECT,
        (
            Exchange(0.0, GO_5F, GO_5F),
            Exchange(2.0, READ_FLOOR, "00 00 00 05 01 03 02 00 05"),
            Exchange(2.0, GO_5F, GO_5F),
            Exchange(3.0, NO_FLOOR, NO_FLOOR),
            Exchange(3.0, READ_FLOOR, READS_0),
        ),
        let_go_s=3.0,
    ),
    # "write 0, wait 500 ms, then write the value"
    Does(
        "open the door and hold it: the value is the hold time",
        Command(CommandKind.HOLD_DOOR, side=Side.FRONT),
        OPEN_AT_1F,
        OPEN_AT_1F,
        None,
        (
            Exchange(0.0, OPEN_0, OPEN_0),
            Exchange(0.5, OPEN_5, OPEN_5),
            Exchange(0.5, READ_OPEN, READS_5),
            Exchange(2.5, READ_OPEN, READS_5),
            Exchange(2.5, OPEN_5, OPEN_5),
            Exchange(3.0, OPEN_0, OPEN_0),
            Exchange(3.0, READ_OPEN, READS_0),
        ),
        let_go_s=3.0,
    ),
    Does(
        "close the door: it closes",
        Command(CommandKind.CLOSE_DOOR, side=Side.FRONT),
        OPEN_AT_1F,
        CLOSING_AT_1F,
        Proof.EFFECT,
        (
            Exchange(0.0, CLOSE_0, CLOSE_0),
            Exchange(0.5, CLOSE_5, CLOSE_5),
            Exchange(2.0, CLOSE_0, CLOSE_0),
            Exchange(2.0, READ_CLOSE, READS_0),
        ),
        let_go_s=2.0,
        press=(CLOSE_5,),
    ),
    Does(
        "hold the door open that was being closed",
        Command(CommandKind.HOLD_DOOR, side=Side.FRONT),
        OPEN_AT_1F,
        OPEN_AT_1F,
        None,
        (
            Exchange(0.0, CLOSE_0, CLOSE_0),
            Exchange(0.0, READ_CLOSE, READS_0),
            Exchange(0.5, OPEN_0, OPEN_0),
            Exchange(1.0, OPEN_5, OPEN_5),
            Exchange(1.0, READ_OPEN, READS_5),
            Exchange(2.0, OPEN_0, OPEN_0),
            Exchange(2.0, READ_OPEN, READS_0),
        ),
        let_go_s=2.0,
        before=Command(CommandKind.CLOSE_DOOR, side=Side.FRONT),
        before_s=0.8,
        before_by=((CLOSE_0, CLOSE_0), (CLOSE_5, CLOSE_5)),
        gives_way=True,
    ),
    # "open/close mutually exclusive (release the other first)", and then the edge
    Does(
        "close the door that was held open",
        Command(CommandKind.CLOSE_DOOR, side=Side.FRONT),
        OPEN_AT_1F,
        CLOSING_AT_1F,
        Proof.EFFECT,
        (
            Exchange(0.0, OPEN_0, OPEN_0),
            Exchange(0.0, READ_OPEN, READS_0),
            Exchange(0.5, CLOSE_0, CLOSE_0),
            Exchange(1.0, CLOSE_5, CLOSE_5),
            Exchange(2.0, CLOSE_0, CLOSE_0),
            Exchange(2.0, READ_CLOSE, READS_0),
        ),
        let_go_s=2.0,
        shows_after=3,
        press=(CLOSE_5,),
        before=Command(CommandKind.HOLD_DOOR, side=Side.FRONT),
        before_s=0.8,
        before_by=((OPEN_0, OPEN_0), (OPEN_5, OPEN_5), (READ_OPEN, READS_5)),
        gives_way=True,
    ),
)

POLL = "00 00 00 06 01 03 00 14 00 04"
GO_2F = "00 00 00 06 01 06 00 0A 00 02"

FACE = (
    # 3.2 m at 1 m/s take 5 s, the door opens in 2 s, stays for 3 s, closes in 2.5 s.
    Face(0.0, "stopped at 1F, closed", POLL, CLOSED_AT_1F),
    Face(1.0, "go to 2F", GO_2F, GO_2F),
    Face(1.0, "which reads back", READ_FLOOR, "00 00 00 05 01 03 02 00 02"),
    Face(3.0, "it moves up from 1F", POLL, GOING_UP),
    Face(7.0, "at 2F the door opens", POLL, "00 00 00 0B 01 03 08 00 02 00 01 00 00 00 00"),
    Face(9.5, "open", POLL, "00 00 00 0B 01 03 08 00 02 00 04 00 00 00 00"),
    Face(9.5, "the target is cleared", NO_FLOOR, NO_FLOOR),
    Face(9.5, "hold the door with 5", OPEN_5, OPEN_5),
    Face(40.0, "as long as nobody writes 0 it stays", POLL, "00 00 00 0B 01 03 08 00 02 00 04 00 00 00 00"),
    Face(40.0, "let go", OPEN_0, OPEN_0),
    Face(44.0, "it closes", POLL, "00 00 00 0B 01 03 08 00 02 00 02 00 00 00 00"),
    Face(46.0, "closed", POLL, "00 00 00 0B 01 03 08 00 02 00 00 00 00 00 00"),
    Face(
        46.0, "a register before the first one is not served", "00 00 00 06 01 03 00 09 00 01", "00 00 00 03 01 83 02"
    ),
)

SEER_GENERIC = Golden(
    map_name="seer-generic",
    floors={"1F": 1, "2F": 2, "5F": 5},
    parameters={
        "dest_floor": 10,
        "open_door": 11,
        "close_door": 12,
        "lift_floor": 20,
        "door_status": 21,
        "move_status": 22,
        "emergency": 23,
        "first_register": 10,
        "last_register": 23,
        "reset_first_s": 0.5,
    },
    poll=POLL,
    takes_over=((READ_FLOOR, READS_0), (READ_OPEN, READS_0), (READ_CLOSE, READS_0)),
    says=SAYS,
    does=DOES,
    face=FACE,
)
