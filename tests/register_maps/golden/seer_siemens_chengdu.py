"""Golden vectors of seer-siemens-chengdu, typed from the point table in elevator-interfaces 1.1.

The table prints 4x0001 call, 4x0002 go, 0x0001 in place, 0x0002 left, 1x0001 may enter, 1x0002 may leave, 1x0003 door (1 open)
and 3x0001 the floor; the code sends these numbers as they are, to unit 0. So FC02 reads three inputs from 1 (may enter is
bit 0 of the byte, may leave bit 1, the door bit 2) and FC04 reads one register at 1. Calls go out by FC06 and are cleared with 0,
acknowledgements by FC05, for 5 s.
"""

from drivers.model import Command, CommandKind, LiftValues, Proof
from register_maps.words import Door, Mode, Side
from tests.register_maps.golden.vectors import Does, Exchange, Golden, Says


def values(
    floor: str | None,
    door: Door,
    *,
    enter: bool = False,
    leave: bool = False,
    unknown: dict[str, int] | None = None,
) -> LiftValues:
    return LiftValues(
        floor=floor,
        mode=Mode.NORMAL,
        doors={Side.FRONT: door},
        flags={"may_enter": enter, "may_leave": leave},
        unknown=unknown or {},
    )


SAYS = (
    Says(
        "at 1F, closed, no permission",
        ("00 00 00 04 00 02 01 00", "00 00 00 05 00 04 02 00 01"),
        values("1F", Door.CLOSED),
    ),
    # bits 0 and 2: 1 + 4
    Says(
        "open at 2F, a robot may enter",
        ("00 00 00 04 00 02 01 05", "00 00 00 05 00 04 02 00 02"),
        values("2F", Door.OPEN, enter=True),
    ),
    # bits 1 and 2: 2 + 4
    Says(
        "open at 3F, a robot may leave",
        ("00 00 00 04 00 02 01 06", "00 00 00 05 00 04 02 00 03"),
        values("3F", Door.OPEN, leave=True),
    ),
    # "door-open is not the permission to drive"
    Says(
        "open at 3F, and nobody may drive",
        ("00 00 00 04 00 02 01 04", "00 00 00 05 00 04 02 00 03"),
        values("3F", Door.OPEN),
    ),
    Says(
        "permissions with a closed door: each is told as it is",
        ("00 00 00 04 00 02 01 03", "00 00 00 05 00 04 02 00 02"),
        values("2F", Door.CLOSED, enter=True, leave=True),
    ),
    Says(
        "nothing but zeros: 0 means no command, and is no floor",
        ("00 00 00 04 00 02 01 00", "00 00 00 05 00 04 02 00 00"),
        values(None, Door.CLOSED, unknown={"car_floor": 0}),
    ),
    Says(
        "a floor that the site does not list",
        ("00 00 00 04 00 02 01 04", "00 00 00 05 00 04 02 00 09"),
        values(None, Door.OPEN, unknown={"car_floor": 9}),
    ),
    # five bits of the byte belong to nobody
    Says(
        "nothing but ones",
        ("00 00 00 04 00 02 01 FF", "00 00 00 05 00 04 02 FF FF"),
        values(None, Door.OPEN, enter=True, leave=True, unknown={"car_floor": 65535}),
    ),
)

CLOSED_AT_1F = ("00 00 00 04 00 02 01 00", "00 00 00 05 00 04 02 00 01")
OPEN_AT_1F = ("00 00 00 04 00 02 01 05", "00 00 00 05 00 04 02 00 01")
CLOSED_AT_2F = ("00 00 00 04 00 02 01 00", "00 00 00 05 00 04 02 00 02")
OPEN_AT_3F = ("00 00 00 04 00 02 01 06", "00 00 00 05 00 04 02 00 03")

# FC06 and FC05 answer with what they were sent.
CALL_2F = "00 00 00 06 00 06 00 01 00 02"
NO_CALL = "00 00 00 06 00 06 00 01 00 00"
READ_CALL = "00 00 00 06 00 03 00 01 00 01"
GO_3F = "00 00 00 06 00 06 00 02 00 03"
NO_GO = "00 00 00 06 00 06 00 02 00 00"
READ_GO = "00 00 00 06 00 03 00 02 00 01"
READS_0 = "00 00 00 05 00 03 02 00 00"
IN_PLACE = "00 00 00 06 00 05 00 01 FF 00"
NOT_IN_PLACE = "00 00 00 06 00 05 00 01 00 00"
READ_IN_PLACE = "00 00 00 06 00 01 00 01 00 01"
LEFT = "00 00 00 06 00 05 00 02 FF 00"
NOT_LEFT = "00 00 00 06 00 05 00 02 00 00"
READ_LEFT = "00 00 00 06 00 01 00 02 00 01"
OFF = "00 00 00 04 00 01 01 00"
ON = "00 00 00 04 00 01 01 01"

DOES = (
    Does(
        "call the empty car to 2F: written again every 2 s, and cleared with 0",
        Command(CommandKind.CALL, "2F"),
        CLOSED_AT_1F,
        CLOSED_AT_2F,
        Proof.EFFECT,
        (
            Exchange(0.0, CALL_2F, CALL_2F),
            Exchange(2.0, READ_CALL, "00 00 00 05 00 03 02 00 02"),
            Exchange(2.0, CALL_2F, CALL_2F),
            Exchange(3.0, NO_CALL, NO_CALL),
            Exchange(3.0, READ_CALL, READS_0),
        ),
        let_go_s=3.0,
    ),
    Does(
        "go to 3F with the robot aboard",
        Command(CommandKind.GO, "3F"),
        CLOSED_AT_1F,
        OPEN_AT_3F,
        Proof.EFFECT,
        (
            Exchange(0.0, GO_3F, GO_3F),
            Exchange(1.0, NO_GO, NO_GO),
            Exchange(1.0, READ_GO, READS_0),
        ),
        let_go_s=1.0,
    ),
    Does(
        "a go ends the call before it",
        Command(CommandKind.GO, "3F"),
        CLOSED_AT_1F,
        OPEN_AT_3F,
        Proof.EFFECT,
        (
            Exchange(0.0, NO_CALL, NO_CALL),
            Exchange(0.0, READ_CALL, READS_0),
            Exchange(0.0, GO_3F, GO_3F),
            Exchange(2.0, READ_GO, "00 00 00 05 00 03 02 00 03"),
            Exchange(2.0, GO_3F, GO_3F),
            Exchange(3.0, NO_GO, NO_GO),
            Exchange(3.0, READ_GO, READS_0),
        ),
        let_go_s=3.0,
        shows_after=2,
        press=(GO_3F,),
        before=Command(CommandKind.CALL, "2F"),
        before_by=((CALL_2F, CALL_2F),),
        gives_way=True,
    ),
    Does(
        "a call ends the go before it",
        Command(CommandKind.CALL, "2F"),
        CLOSED_AT_1F,
        CLOSED_AT_2F,
        Proof.EFFECT,
        (
            Exchange(0.0, NO_GO, NO_GO),
            Exchange(0.0, READ_GO, READS_0),
            Exchange(0.0, CALL_2F, CALL_2F),
            Exchange(1.0, NO_CALL, NO_CALL),
            Exchange(1.0, READ_CALL, READS_0),
        ),
        let_go_s=1.0,
        shows_after=2,
        press=(CALL_2F,),
        before=Command(CommandKind.GO, "3F"),
        before_by=((GO_3F, GO_3F),),
        gives_way=True,
    ),
    # "1, cleared by client after 5 s"
    Does(
        "the robot is in place",
        Command(CommandKind.ROBOT_IN_PLACE),
        OPEN_AT_1F,
        OPEN_AT_1F,
        Proof.READBACK,
        (
            Exchange(0.0, IN_PLACE, IN_PLACE),
            Exchange(0.0, READ_IN_PLACE, ON),
            Exchange(5.0, NOT_IN_PLACE, NOT_IN_PLACE),
            Exchange(5.0, READ_IN_PLACE, OFF),
        ),
    ),
    Does(
        "the robot has left; the first release does not stick",
        Command(CommandKind.ROBOT_LEFT),
        OPEN_AT_3F,
        OPEN_AT_3F,
        Proof.READBACK,
        (
            Exchange(0.0, LEFT, LEFT),
            Exchange(0.0, READ_LEFT, ON),
            Exchange(5.0, NOT_LEFT, NOT_LEFT),
            Exchange(5.0, READ_LEFT, ON),
            Exchange(5.2, NOT_LEFT, NOT_LEFT),
            Exchange(5.2, READ_LEFT, OFF),
        ),
    ),
)

SEER_SIEMENS_CHENGDU = Golden(
    map_name="seer-siemens-chengdu",
    floors={"1F": 1, "2F": 2, "3F": 3},
    poll=("00 00 00 06 00 02 00 01 00 03", "00 00 00 06 00 04 00 01 00 01"),
    takes_over=((READ_CALL, READS_0), (READ_GO, READS_0), (READ_IN_PLACE, OFF), (READ_LEFT, OFF)),
    says=SAYS,
    does=DOES,
)

SEER_SIEMENS_CHENGDU_FROM_1 = Golden(
    map_name="seer-siemens-chengdu",
    site="counted from 1",
    parameters={"base": 1},
    floors={"1F": 1, "2F": 2, "3F": 3},
    # every address is one less
    poll=("00 00 00 06 00 02 00 00 00 03", "00 00 00 06 00 04 00 00 00 01"),
    takes_over=(
        ("00 00 00 06 00 03 00 00 00 01", READS_0),
        ("00 00 00 06 00 03 00 01 00 01", READS_0),
        ("00 00 00 06 00 01 00 00 00 01", OFF),
        ("00 00 00 06 00 01 00 01 00 01", OFF),
    ),
    says=SAYS[1:2],
    does=(
        Does(
            "call the empty car to 2F",
            Command(CommandKind.CALL, "2F"),
            CLOSED_AT_1F,
            CLOSED_AT_2F,
            Proof.EFFECT,
            (
                Exchange(0.0, "00 00 00 06 00 06 00 00 00 02", "00 00 00 06 00 06 00 00 00 02"),
                Exchange(1.0, "00 00 00 06 00 06 00 00 00 00", "00 00 00 06 00 06 00 00 00 00"),
                Exchange(1.0, "00 00 00 06 00 03 00 00 00 01", READS_0),
            ),
            let_go_s=1.0,
        ),
    ),
)
