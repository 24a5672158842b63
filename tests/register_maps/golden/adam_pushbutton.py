"""Golden vectors of adam-pushbutton, typed from elevator-interfaces 1.5.

The source counts from 1: buttons 17, 18, 19 are PDU 16 to 18 (0010 to 0012), door open 20 is 0013, door close 21 is 0014; all by FC05.
The module has no inputs. The site has a second device, unit 2: its input 1 is on while the door is NOT open (inverted, as
the source's sensor is), inputs 2 to 4 are the car at one of the floors. One FC02 over its first four inputs reads them all. The first
button is read along: nothing else of the module would show that it is alive.
"""

from drivers.model import Command, CommandKind, LiftValues, Proof
from register_maps.words import Door, Mode, Side
from tests.register_maps.golden.vectors import Does, Exchange, Golden, Says


def values(floor: str | None, door: Door, *, unknown: dict[str, int] | None = None) -> LiftValues:
    return LiftValues(floor=floor, mode=Mode.NORMAL, doors={Side.FRONT: door}, unknown=unknown or {})


QUIET = "00 00 00 04 01 01 01 00"
CLOSED_AT_1 = (QUIET, "sensor: 00 00 00 04 02 02 01 03")
OPEN_AT_1 = (QUIET, "sensor: 00 00 00 04 02 02 01 02")
CLOSED_AT_2 = (QUIET, "sensor: 00 00 00 04 02 02 01 05")
BETWEEN = (QUIET, "sensor: 00 00 00 04 02 02 01 01")

SAYS = (
    Says("at floor 1, not open", CLOSED_AT_1, values("1", Door.CLOSED)),
    Says("open at floor 1", OPEN_AT_1, values("1", Door.OPEN)),
    Says("at floor 2", CLOSED_AT_2, values("2", Door.CLOSED)),
    Says("at floor 3", (QUIET, "sensor: 00 00 00 04 02 02 01 09"), values("3", Door.CLOSED)),
    Says("between floors", BETWEEN, values(None, Door.CLOSED)),
    Says(
        "at floors 1 and 3 at once",
        (QUIET, "sensor: 00 00 00 04 02 02 01 0B"),
        values(None, Door.CLOSED, unknown={"car_floor": 5}),
    ),
    # an inverted sensor that is dead reads as open, but at no floor
    Says("nothing but zeros", (QUIET, "sensor: 00 00 00 04 02 02 01 00"), values(None, Door.OPEN)),
    Says(
        "nothing but ones",
        (QUIET, "sensor: 00 00 00 04 02 02 01 FF"),
        values(None, Door.CLOSED, unknown={"car_floor": 7}),
    ),
)

BUTTON_1 = "00 00 00 06 01 05 00 10 FF 00"
NO_BUTTON_1 = "00 00 00 06 01 05 00 10 00 00"
BUTTON_2 = "00 00 00 06 01 05 00 11 FF 00"
NO_BUTTON_2 = "00 00 00 06 01 05 00 11 00 00"
NO_BUTTON_3 = "00 00 00 06 01 05 00 12 00 00"
READ_BUTTON_1 = "00 00 00 06 01 01 00 10 00 01"
READ_BUTTONS = "00 00 00 06 01 01 00 10 00 03"
OPEN_BUTTON = "00 00 00 06 01 05 00 13 FF 00"
NO_OPEN_BUTTON = "00 00 00 06 01 05 00 13 00 00"
READ_OPEN_BUTTON = "00 00 00 06 01 01 00 13 00 01"
CLOSE_BUTTON = "00 00 00 06 01 05 00 14 FF 00"
NO_CLOSE_BUTTON = "00 00 00 06 01 05 00 14 00 00"
READ_CLOSE_BUTTON = "00 00 00 06 01 01 00 14 00 01"
OFF = "00 00 00 04 01 01 01 00"
ON = "00 00 00 04 01 01 01 01"

DOES = (
    # The source presses for half a second.
    Does(
        "press the button of floor 2",
        Command(CommandKind.GO_TO, "2"),
        CLOSED_AT_1,
        CLOSED_AT_2,
        Proof.EFFECT,
        (
            Exchange(0.0, NO_BUTTON_1, NO_BUTTON_1),
            Exchange(0.0, NO_BUTTON_3, NO_BUTTON_3),
            Exchange(0.0, BUTTON_2, BUTTON_2),
            Exchange(0.5, NO_BUTTON_1, NO_BUTTON_1),
            Exchange(0.5, NO_BUTTON_2, NO_BUTTON_2),
            Exchange(0.5, NO_BUTTON_3, NO_BUTTON_3),
            Exchange(0.5, READ_BUTTONS, OFF),
        ),
        press=(NO_BUTTON_1, NO_BUTTON_3, BUTTON_2),
    ),
    # "held ON while robots pass, OFF to release"
    Does(
        "hold the door-open button",
        Command(CommandKind.HOLD_DOOR, side=Side.FRONT),
        OPEN_AT_1,
        OPEN_AT_1,
        None,
        (
            Exchange(0.0, OPEN_BUTTON, OPEN_BUTTON),
            Exchange(0.0, READ_OPEN_BUTTON, ON),
            Exchange(2.0, READ_OPEN_BUTTON, ON),
            Exchange(2.0, OPEN_BUTTON, OPEN_BUTTON),
            Exchange(3.0, NO_OPEN_BUTTON, NO_OPEN_BUTTON),
            Exchange(3.0, READ_OPEN_BUTTON, OFF),
        ),
        let_go_s=3.0,
    ),
    # Opening: close OFF, 500 ms, open ON.
    Does(
        "hold the door-open button after pressing the other one",
        Command(CommandKind.HOLD_DOOR, side=Side.FRONT),
        OPEN_AT_1,
        OPEN_AT_1,
        None,
        (
            Exchange(0.0, NO_CLOSE_BUTTON, NO_CLOSE_BUTTON),
            Exchange(0.0, READ_CLOSE_BUTTON, OFF),
            Exchange(0.5, OPEN_BUTTON, OPEN_BUTTON),
            Exchange(0.5, READ_OPEN_BUTTON, ON),
            Exchange(1.0, NO_OPEN_BUTTON, NO_OPEN_BUTTON),
            Exchange(1.0, READ_OPEN_BUTTON, OFF),
        ),
        let_go_s=1.0,
        before=Command(CommandKind.CLOSE_DOOR, side=Side.FRONT),
        before_by=((CLOSE_BUTTON, CLOSE_BUTTON),),
        gives_way=True,
    ),
    # Closing: open OFF, 500 ms, close ON, 500 ms, close OFF.
    Does(
        "press the door-close button after holding the other one",
        Command(CommandKind.CLOSE_DOOR, side=Side.FRONT),
        OPEN_AT_1,
        CLOSED_AT_1,
        Proof.EFFECT,
        (
            Exchange(0.0, NO_OPEN_BUTTON, NO_OPEN_BUTTON),
            Exchange(0.0, READ_OPEN_BUTTON, OFF),
            Exchange(0.5, CLOSE_BUTTON, CLOSE_BUTTON),
            Exchange(1.0, NO_CLOSE_BUTTON, NO_CLOSE_BUTTON),
            Exchange(1.0, READ_CLOSE_BUTTON, OFF),
        ),
        shows_after=3,
        press=(CLOSE_BUTTON,),
        before=Command(CommandKind.HOLD_DOOR, side=Side.FRONT),
        before_by=((OPEN_BUTTON, OPEN_BUTTON), (READ_OPEN_BUTTON, ON)),
        gives_way=True,
    ),
    Does(
        "press the door-close button of a door that has closed by the next reading",
        Command(CommandKind.CLOSE_DOOR, side=Side.FRONT),
        OPEN_AT_1,
        CLOSED_AT_1,
        Proof.EFFECT,
        (
            Exchange(0.0, CLOSE_BUTTON, CLOSE_BUTTON),
            Exchange(0.1, NO_CLOSE_BUTTON, NO_CLOSE_BUTTON),
            Exchange(0.1, READ_CLOSE_BUTTON, OFF),
        ),
    ),
)

ADAM_PUSHBUTTON = Golden(
    map_name="adam-pushbutton",
    floors={"1": 0, "2": 1, "3": 2},
    override={
        "endpoints": {"sensor": {"unit_id": 2, "served": {"discrete": [[1, 4]]}}},
        "signals": {
            "car_floor": {"one_of": ["sensor/discrete:2", "sensor/discrete:3", "sensor/discrete:4"]},
            "door.front": {"at": "sensor/discrete:1", "active": "low"},
        },
    },
    poll=(READ_BUTTON_1, "sensor: 00 00 00 06 02 02 00 00 00 04"),
    takes_over=((READ_BUTTONS, OFF), (READ_OPEN_BUTTON, OFF), (READ_CLOSE_BUTTON, OFF)),
    says=SAYS,
    does=DOES,
)
