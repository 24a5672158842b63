"""Golden vectors of seer-siemens-chengdu-block, typed from elevator-interfaces 1.1, V2.

One block of holding registers: call, go, in place, left, may enter, may leave, door (1 open), floor. The site puts it at
100, so FC16 writes four registers from 0064 and the poll reads four from 0068, at unit 0. The four are written in every cycle.
"""

from drivers.model import Command, CommandKind, LiftValues, Proof
from register_maps.words import Door, Mode, Side
from tests.register_maps.golden.vectors import Does, Exchange, Golden, Says


def values(
    floor: str | None,
    door: Door,
    *,
    enter: bool | None = False,
    leave: bool | None = False,
    unknown: dict[str, int] | None = None,
) -> LiftValues:
    """A flag that is None cannot be read."""
    flags = {"may_enter": enter, "may_leave": leave}
    return LiftValues(
        floor=floor,
        mode=Mode.NORMAL,
        doors={Side.FRONT: door},
        flags={name: told for name, told in flags.items() if told is not None},
        unknown=unknown or {},
    )


CLOSED_AT_1F = "00 00 00 0B 00 03 08 00 00 00 00 00 00 00 01"
OPEN_AT_1F = "00 00 00 0B 00 03 08 00 01 00 00 00 01 00 01"
CLOSED_AT_2F = "00 00 00 0B 00 03 08 00 00 00 00 00 00 00 02"
OPEN_AT_3F = "00 00 00 0B 00 03 08 00 00 00 01 00 01 00 03"

SAYS = (
    Says("at 1F, closed, no permission", CLOSED_AT_1F, values("1F", Door.CLOSED)),
    Says("open at 1F, a robot may enter", OPEN_AT_1F, values("1F", Door.OPEN, enter=True)),
    Says("open at 3F, a robot may leave", OPEN_AT_3F, values("3F", Door.OPEN, leave=True)),
    Says(
        "open at 2F, and nobody may drive",
        "00 00 00 0B 00 03 08 00 00 00 00 00 01 00 02",
        values("2F", Door.OPEN),
    ),
    Says(
        "nothing but zeros",
        "00 00 00 0B 00 03 08 00 00 00 00 00 00 00 00",
        values(None, Door.CLOSED, unknown={"car_floor": 0}),
    ),
    Says(
        "2 is neither yes nor no, and no door; 4 is no floor here",
        "00 00 00 0B 00 03 08 00 02 00 02 00 02 00 04",
        values(
            None,
            Door.UNKNOWN,
            enter=None,
            leave=None,
            unknown={"may_enter": 2, "may_leave": 2, "door.front": 2, "car_floor": 4},
        ),
    ),
    Says(
        "nothing but ones",
        "00 00 00 0B 00 03 08 FF FF FF FF FF FF FF FF",
        values(
            None,
            Door.UNKNOWN,
            enter=None,
            leave=None,
            unknown={"may_enter": 65535, "may_leave": 65535, "door.front": 65535, "car_floor": 65535},
        ),
    ),
)

CALL_2F = "00 00 00 0F 00 10 00 64 00 04 08 00 02 00 00 00 00 00 00"
GO_3F = "00 00 00 0F 00 10 00 64 00 04 08 00 00 00 03 00 00 00 00"
IN_PLACE = "00 00 00 0F 00 10 00 64 00 04 08 00 00 00 00 00 01 00 00"
LEFT = "00 00 00 0F 00 10 00 64 00 04 08 00 00 00 00 00 00 00 01"
REST = "00 00 00 0F 00 10 00 64 00 04 08 00 00 00 00 00 00 00 00"
WRITTEN = "00 00 00 06 00 10 00 64 00 04"
READ_BACK = "00 00 00 06 00 03 00 64 00 04"
AT_REST = "00 00 00 0B 00 03 08 00 00 00 00 00 00 00 00"
CALLS_2F = "00 00 00 0B 00 03 08 00 02 00 00 00 00 00 00"

DOES = (
    # "read, sleep one polling period, write": what is wanted goes out in every cycle, if it is still on
    Does(
        "call the empty car to 2F",
        Command(CommandKind.CALL, "2F"),
        CLOSED_AT_1F,
        CLOSED_AT_2F,
        Proof.EFFECT,
        (
            Exchange(0.0, CALL_2F, WRITTEN),
            Exchange(0.5, READ_BACK, CALLS_2F),
            Exchange(0.5, CALL_2F, WRITTEN),
            Exchange(1.0, READ_BACK, CALLS_2F),
            Exchange(1.0, CALL_2F, WRITTEN),
            Exchange(1.2, REST, WRITTEN),
            Exchange(1.2, READ_BACK, AT_REST),
        ),
        let_go_s=1.2,
    ),
    Does(
        "go to 3F with the robot aboard",
        Command(CommandKind.GO, "3F"),
        CLOSED_AT_1F,
        OPEN_AT_3F,
        Proof.EFFECT,
        (
            Exchange(0.0, GO_3F, WRITTEN),
            Exchange(0.4, REST, WRITTEN),
            Exchange(0.4, READ_BACK, AT_REST),
        ),
        let_go_s=0.4,
    ),
    Does(
        "a call ends the go before it",
        Command(CommandKind.CALL, "2F"),
        CLOSED_AT_1F,
        CLOSED_AT_2F,
        Proof.EFFECT,
        (
            Exchange(0.0, REST, WRITTEN),
            Exchange(0.0, READ_BACK, AT_REST),
            Exchange(0.0, CALL_2F, WRITTEN),
            Exchange(0.4, REST, WRITTEN),
            Exchange(0.4, READ_BACK, AT_REST),
        ),
        let_go_s=0.4,
        shows_after=2,
        press=(CALL_2F,),
        before=Command(CommandKind.GO, "3F"),
        before_by=((GO_3F, WRITTEN),),
        gives_way=True,
    ),
    Does(
        "a go ends the call before it",
        Command(CommandKind.GO, "3F"),
        CLOSED_AT_1F,
        OPEN_AT_3F,
        Proof.EFFECT,
        (
            Exchange(0.0, REST, WRITTEN),
            Exchange(0.0, READ_BACK, AT_REST),
            Exchange(0.0, GO_3F, WRITTEN),
            Exchange(0.4, REST, WRITTEN),
            Exchange(0.4, READ_BACK, AT_REST),
        ),
        let_go_s=0.4,
        shows_after=2,
        press=(GO_3F,),
        before=Command(CommandKind.CALL, "2F"),
        before_by=((CALL_2F, WRITTEN),),
        gives_way=True,
    ),
    Does(
        "the robot is in place, said for 5 s",
        Command(CommandKind.ROBOT_IN_PLACE),
        OPEN_AT_1F,
        OPEN_AT_1F,
        Proof.READBACK,
        (
            *(
                step
                for at in (0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0, 4.5)
                for step in (
                    Exchange(at, IN_PLACE, WRITTEN),
                    Exchange(at, READ_BACK, "00 00 00 0B 00 03 08 00 00 00 00 00 01 00 00"),
                )
            ),
            Exchange(5.0, REST, WRITTEN),
            Exchange(5.0, READ_BACK, AT_REST),
        ),
    ),
    Does(
        "the robot has left, said for 5 s",
        Command(CommandKind.ROBOT_LEFT),
        OPEN_AT_3F,
        OPEN_AT_3F,
        Proof.READBACK,
        (
            *(
                step
                for at in (0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0, 4.5)
                for step in (
                    Exchange(at, LEFT, WRITTEN),
                    Exchange(at, READ_BACK, "00 00 00 0B 00 03 08 00 00 00 00 00 00 00 01"),
                )
            ),
            Exchange(5.0, REST, WRITTEN),
            Exchange(5.0, READ_BACK, AT_REST),
        ),
    ),
)

SEER_SIEMENS_CHENGDU_BLOCK = Golden(
    map_name="seer-siemens-chengdu-block",
    floors={"1F": 1, "2F": 2, "3F": 3},
    parameters={"first": 100},
    poll="00 00 00 06 00 03 00 68 00 04",
    takes_over=((READ_BACK, AT_REST),),
    cycle=(REST, WRITTEN),
    cycle_s=0.5,
    says=SAYS,
    does=DOES,
)
