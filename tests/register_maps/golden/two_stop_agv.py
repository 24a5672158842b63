"""Golden vectors of two-stop-agv, typed from elevator-interfaces 1.4.

The source fixes the bit order by the value table in its comments: 21 = 4F open, 25 = 5F open, 22 = 4F closed, 26 = 5F
closed, all with AGV mode. In binary, lowest bit last: 21 = 0b010101, 25 = 0b011001, 22 = 0b010110, 26 = 0b011010. So
bit 0 is door open, bit 1 door closed, bit 2 car at 4F, bit 3 car at 5F, bit 4 AGV mode granted; bit 5 "must be 0".
Outputs: FC15 over all four coils at 0: go to 4F, go to 5F, hold open, hold closed.
"""

from drivers.model import Command, CommandKind, LiftValues, Proof
from register_maps.words import Door, Mode, Side
from tests.register_maps.golden.vectors import Does, Exchange, Face, Golden, Says


def values(
    floor: str | None,
    door: Door,
    mode: Mode = Mode.ROBOT,
    *,
    agv: bool = True,
    fault: bool = False,
    unknown: dict[str, int] | None = None,
) -> LiftValues:
    return LiftValues(
        floor=floor,
        mode=mode,
        doors={Side.FRONT: door},
        flags={"robot_mode_on": agv, "fault": fault},
        unknown=unknown or {},
    )


SAYS = (
    # The value table in the source's comments: its four lines, 21, 22, 25, 26.
    Says("21: at 4F, door open, AGV mode", "00 00 00 04 01 02 01 15", values("4F", Door.OPEN)),
    Says("22: at 4F, door closed, AGV mode", "00 00 00 04 01 02 01 16", values("4F", Door.CLOSED)),
    Says("25: at 5F, door open, AGV mode", "00 00 00 04 01 02 01 19", values("5F", Door.OPEN)),
    Says("26: at 5F, door closed, AGV mode", "00 00 00 04 01 02 01 1A", values("5F", Door.CLOSED)),
    # "neither = moving (do not use a bool, it would default to closed)": 16 + 4, 16 + 8.
    Says("20: at 4F, the door is moving", "00 00 00 04 01 02 01 14", values("4F", Door.MOVING)),
    Says("24: at 5F, the door is moving", "00 00 00 04 01 02 01 18", values("5F", Door.MOVING)),
    # "one-hot; all 0 between floors": 16 + 2.
    Says("18: between floors, door closed", "00 00 00 04 01 02 01 12", values(None, Door.CLOSED)),
    # "every write refused when 0": 21 and 26 without 16.
    Says(
        "5: at 4F, door open, without AGV mode",
        "00 00 00 04 01 02 01 05",
        values("4F", Door.OPEN, Mode.NORMAL, agv=False),
    ),
    Says(
        "10: at 5F, door closed, no AGV mode",
        "00 00 00 04 01 02 01 0A",
        values("5F", Door.CLOSED, Mode.NORMAL, agv=False),
    ),
    # "+5 must be 0; 1 is treated as lift error": 21 + 32.
    Says(
        "53: at 4F, door open, lift error",
        "00 00 00 04 01 02 01 35",
        values("4F", Door.OPEN, Mode.OUT_OF_SERVICE, fault=True),
    ),
    # Contradictions: both door limits (1 + 2), both floors (4 + 8). Both floors are the raw value 3 of the two floor bits.
    Says("23: both door limits at once", "00 00 00 04 01 02 01 17", values("4F", Door.FAULT)),
    Says("30: at both floors at once", "00 00 00 04 01 02 01 1E", values(None, Door.CLOSED, unknown={"car_floor": 3})),
    Says(
        "31: bits 0 to 3 all 1, an error by the source's plausibility rule",
        "00 00 00 04 01 02 01 1F",
        values(None, Door.FAULT, unknown={"car_floor": 3}),
    ),
    # "bits 0-3 all 0 -> error": nothing in it may read as a floor, as open or as closed.
    Says("16: bits 0 to 3 all 0, with AGV mode", "00 00 00 04 01 02 01 10", values(None, Door.MOVING)),
    Says(
        "0: nothing at all, as from a controller that has just started",
        "00 00 00 04 01 02 01 00",
        values(None, Door.MOVING, Mode.NORMAL, agv=False),
    ),
    Says(
        "63: everything at once",
        "00 00 00 04 01 02 01 3F",
        values(None, Door.FAULT, Mode.OUT_OF_SERVICE, fault=True, unknown={"car_floor": 3}),
    ),
    # Six bits leave two of the byte unused; a careless device may leave something in them. 21 + 64 + 128.
    Says("21, with rubbish in the two unused bits", "00 00 00 04 01 02 01 D5", values("4F", Door.OPEN)),
)

CLOSED_AT_4F = "00 00 00 04 01 02 01 16"
CLOSED_AT_5F = "00 00 00 04 01 02 01 1A"
OPEN_AT_4F = "00 00 00 04 01 02 01 15"
BETWEEN = "00 00 00 04 01 02 01 12"
MOVING_AT_4F = "00 00 00 04 01 02 01 14"

WRITTEN = "00 00 00 06 01 0F 00 00 00 04"
"""FC15 echoes address 0 and quantity 4."""
LET_GO = "00 00 00 08 01 0F 00 00 00 04 01 00"
"""FC15 at 0, quantity 4, one byte: no coil."""
READ_BACK = "00 00 00 06 01 01 00 00 00 04"
"""FC01 read-back of the four coils, as the source does it."""
AT_REST = "00 00 00 04 01 01 01 00"

GO_4F = "00 00 00 08 01 0F 00 00 00 04 01 01"
GO_5F = "00 00 00 08 01 0F 00 00 00 04 01 02"
HOLD_OPEN = "00 00 00 08 01 0F 00 00 00 04 01 04"
HOLD_CLOSED = "00 00 00 08 01 0F 00 00 00 04 01 08"

DOES = (
    # Coil 1, so 2 in the byte. It is a level: written again every 2 s if it is still on, and let go on arrival.
    Does(
        "from 4F to 5F: the car has left 4F with its door closed",
        Command(CommandKind.GO_TO, "5F"),
        CLOSED_AT_4F,
        BETWEEN,
        Proof.EFFECT,
        (
            Exchange(0.0, GO_5F, WRITTEN),
            Exchange(2.0, READ_BACK, "00 00 00 04 01 01 01 02"),
            Exchange(2.0, GO_5F, WRITTEN),
            Exchange(3.0, LET_GO, WRITTEN),
            Exchange(3.0, READ_BACK, AT_REST),
        ),
        let_go_s=3.0,
    ),
    # Coil 0, so 1.
    Does(
        "from 5F to 4F: the car is there",
        Command(CommandKind.GO_TO, "4F"),
        CLOSED_AT_5F,
        CLOSED_AT_4F,
        Proof.EFFECT,
        (
            Exchange(0.0, GO_4F, WRITTEN),
            Exchange(1.0, LET_GO, WRITTEN),
            Exchange(1.0, READ_BACK, AT_REST),
        ),
        let_go_s=1.0,
    ),
    # Coil 2, so 4: "level". The read-back shows it, before and after.
    Does(
        "hold the door open",
        Command(CommandKind.HOLD_DOOR, side=Side.FRONT),
        OPEN_AT_4F,
        OPEN_AT_4F,
        None,
        (
            Exchange(0.0, HOLD_OPEN, WRITTEN),
            Exchange(0.0, READ_BACK, "00 00 00 04 01 01 01 04"),
            Exchange(2.0, READ_BACK, "00 00 00 04 01 01 01 04"),
            Exchange(2.0, HOLD_OPEN, WRITTEN),
            Exchange(3.0, LET_GO, WRITTEN),
            Exchange(3.0, READ_BACK, AT_REST),
        ),
        let_go_s=3.0,
    ),
    # The same when the first release did nothing: it is written again until the coils read 0.
    Does(
        "hold the door open, with a release that does not stick at first",
        Command(CommandKind.HOLD_DOOR, side=Side.FRONT),
        OPEN_AT_4F,
        OPEN_AT_4F,
        None,
        (
            Exchange(0.0, HOLD_OPEN, WRITTEN),
            Exchange(0.0, READ_BACK, "00 00 00 04 01 01 01 04"),
            Exchange(1.0, LET_GO, WRITTEN),
            Exchange(1.0, READ_BACK, "00 00 00 04 01 01 01 04"),
            Exchange(1.2, LET_GO, WRITTEN),
            Exchange(1.2, READ_BACK, AT_REST),
        ),
        let_go_s=1.0,
    ),
    Does(
        "go to 5F, which ends holding the door",
        Command(CommandKind.GO_TO, "5F"),
        CLOSED_AT_4F,
        BETWEEN,
        Proof.EFFECT,
        (
            Exchange(0.0, LET_GO, WRITTEN),
            Exchange(0.0, READ_BACK, AT_REST),
            Exchange(0.0, GO_5F, WRITTEN),
            Exchange(1.0, LET_GO, WRITTEN),
            Exchange(1.0, READ_BACK, AT_REST),
        ),
        let_go_s=1.0,
        shows_after=2,
        press=(GO_5F,),
        before=Command(CommandKind.HOLD_DOOR, side=Side.FRONT),
        before_by=((HOLD_OPEN, WRITTEN), (READ_BACK, "00 00 00 04 01 01 01 04")),
        gives_way=True,
    ),
    Does(
        "hold the door open, which ends a call",
        Command(CommandKind.HOLD_DOOR, side=Side.FRONT),
        CLOSED_AT_4F,
        OPEN_AT_4F,
        None,
        (
            Exchange(0.0, LET_GO, WRITTEN),
            Exchange(0.0, READ_BACK, AT_REST),
            Exchange(0.0, HOLD_OPEN, WRITTEN),
            Exchange(0.0, READ_BACK, "00 00 00 04 01 01 01 04"),
            Exchange(1.0, LET_GO, WRITTEN),
            Exchange(1.0, READ_BACK, AT_REST),
        ),
        let_go_s=1.0,
        before=Command(CommandKind.GO_TO, "5F"),
        before_by=((GO_5F, WRITTEN),),
        gives_way=True,
    ),
    Does(
        "hold the door closed, which ends holding it open",
        Command(CommandKind.CLOSE_DOOR, side=Side.FRONT),
        OPEN_AT_4F,
        CLOSED_AT_4F,
        Proof.EFFECT,
        (
            Exchange(0.0, LET_GO, WRITTEN),
            Exchange(0.0, READ_BACK, AT_REST),
            Exchange(0.0, HOLD_CLOSED, WRITTEN),
            Exchange(0.1, LET_GO, WRITTEN),
            Exchange(0.1, READ_BACK, AT_REST),
        ),
        shows_after=2,
        press=(HOLD_CLOSED,),
        before=Command(CommandKind.HOLD_DOOR, side=Side.FRONT),
        before_by=((HOLD_OPEN, WRITTEN), (READ_BACK, "00 00 00 04 01 01 01 04")),
        gives_way=True,
    ),
    # Coil 3, so 8. It is let go with the first reading of a closed door.
    Does(
        "hold the door closed: it closes",
        Command(CommandKind.CLOSE_DOOR, side=Side.FRONT),
        OPEN_AT_4F,
        CLOSED_AT_4F,
        Proof.EFFECT,
        (
            Exchange(0.0, HOLD_CLOSED, WRITTEN),
            Exchange(0.1, LET_GO, WRITTEN),
            Exchange(0.1, READ_BACK, AT_REST),
        ),
    ),
)

POLL = "00 00 00 06 01 02 00 00 00 06"
"""FC02 at 0, six inputs."""

FACE = (
    # The key is in AGV position all the time. 3.2 m at 1 m/s take 5 s, the door opens in 2 s, stays for 3 s, closes in 2.5 s.
    Face(0.0, "it stands at 4F with its door closed: 22", POLL, CLOSED_AT_4F),
    Face(0.0, "no coil is set", READ_BACK, AT_REST),
    Face(1.0, "go to 5F: the four coils are taken together", GO_5F, WRITTEN),
    Face(1.0, "and read back as they were written", READ_BACK, "00 00 00 04 01 01 01 02"),
    Face(3.0, "two seconds later it is between floors: 18", POLL, BETWEEN),
    Face(7.0, "then at 5F, where the door is moving: 24", POLL, "00 00 00 04 01 02 01 18"),
    Face(9.5, "then open: 25", POLL, "00 00 00 04 01 02 01 19"),
    Face(9.5, "hold open, and let the call go with it", HOLD_OPEN, WRITTEN),
    Face(
        60.0,
        "a hold latches in this interface: nothing was written for 50 s and it is still open",
        POLL,
        "00 00 00 04 01 02 01 19",
    ),
    Face(60.0, "the coil is still set", READ_BACK, "00 00 00 04 01 01 01 04"),
    Face(60.0, "let go", LET_GO, WRITTEN),
    Face(64.0, "three seconds of dwell later it is closing: 24", POLL, "00 00 00 04 01 02 01 18"),
    Face(66.0, "closed: 26", POLL, "00 00 00 04 01 02 01 1A"),
    # Two floor coils together are nonsense, and no call.
    Face(66.0, "both floors at once", "00 00 00 08 01 0F 00 00 00 04 01 03", WRITTEN),
    Face(70.0, "it does not move", POLL, "00 00 00 04 01 02 01 1A"),
    Face(70.0, "go to 4F", GO_4F, WRITTEN),
    Face(77.9, "it is there and open: 21", POLL, OPEN_AT_4F),
    Face(77.9, "hold closed", HOLD_CLOSED, WRITTEN),
    Face(78.5, "the door closes before its dwell is over: 20", POLL, MOVING_AT_4F),
    Face(81.0, "closed: 22", POLL, CLOSED_AT_4F),
    # The other ways in, and out of, these tables.
    Face(81.0, "one coil by FC05", "00 00 00 06 01 05 00 03 00 00", "00 00 00 06 01 05 00 03 00 00"),
    Face(81.0, "a seventh input is not served: exception 02", "00 00 00 06 01 02 00 00 00 07", "00 00 00 03 01 82 02"),
    Face(81.0, "nor is a fifth coil", "00 00 00 08 01 0F 00 00 00 05 01 00", "00 00 00 03 01 8F 02"),
    Face(81.0, "it has no holding registers: exception 01", "00 00 00 06 01 03 00 00 00 01", "00 00 00 03 01 83 01"),
    Face(
        81.0,
        "nobody plays unit 2: exception 0B, as from a gateway",
        "00 00 00 06 02 02 00 00 00 06",
        "00 00 00 03 02 82 0B",
    ),
)

TWO_STOP_AGV = Golden(
    map_name="two-stop-agv",
    floors={"4F": 0, "5F": 1},
    poll=POLL,
    # All commands share one block, so one read shows them all.
    takes_over=((READ_BACK, AT_REST),),
    says=SAYS,
    does=DOES,
    key="robot",
    face=FACE,
)

TWO_STOP_AGV_MOVED = Golden(
    map_name="two-stop-agv",
    site="inputs from 100, outputs from 200",
    parameters={"first_input": 100, "first_output": 200},
    floors={"4F": 0, "5F": 1},
    poll="00 00 00 06 01 02 00 64 00 06",
    takes_over=(("00 00 00 06 01 01 00 C8 00 04", AT_REST),),
    says=SAYS[:4],
    does=(
        Does(
            "from 5F to 4F: the car is there",
            Command(CommandKind.GO_TO, "4F"),
            CLOSED_AT_5F,
            CLOSED_AT_4F,
            Proof.EFFECT,
            (
                Exchange(0.0, "00 00 00 08 01 0F 00 C8 00 04 01 01", "00 00 00 06 01 0F 00 C8 00 04"),
                Exchange(1.0, "00 00 00 08 01 0F 00 C8 00 04 01 00", "00 00 00 06 01 0F 00 C8 00 04"),
                Exchange(1.0, "00 00 00 06 01 01 00 C8 00 04", AT_REST),
            ),
            let_go_s=1.0,
        ),
    ),
)
