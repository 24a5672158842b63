"""Golden vectors of generic-registers-cluster, typed from its YAML file as a person reads it.

Eleven holding registers from 0: alive, car floor, motion, door, mode, flags, destination, call accepted, as in generic-registers;
then the epoch that was obeyed, high half first, and its owner. One block of seven registers takes everything, so FC16 at 16: owner,
epoch high, epoch low, go to, hold door, robot mode, close door. The driver here has no cluster, and the controller has obeyed nobody
yet: so it claims epoch 1 of machine 0.
"""

from drivers.model import Command, CommandKind, Proof
from register_maps.words import Door, Mode, Motion, Side
from tests.register_maps.golden.generic_registers import flags, values
from tests.register_maps.golden.vectors import Does, Exchange, Face, Golden, Says

SAYS = (
    # alive 42, floor -1, motion 1, door 1, mode 1, flags 00101, no destination, no call; nothing obeyed yet
    Says(
        "idle in the basement, floor -1",
        "00 00 00 19 01 03 16 00 2A FF FF 00 01 00 01 00 01 00 05 00 00 00 00 00 00 00 00 00 00",
        values("B1", Motion.STOPPED, Door.CLOSED, Mode.NORMAL, flags(level=True)),
    ),
    Says(
        "on its way from the basement to L2 for a robot, for machine 2",
        "00 00 00 19 01 03 16 00 2B FF FF 00 02 00 01 00 02 00 03 00 02 00 02 00 01 00 02 00 02",
        values("B1", Motion.UP, Door.CLOSED, Mode.ROBOT, flags(robot=True), destination="L2", accepted="L2"),
    ),
    Says(
        "nothing but zeros",
        "00 00 00 19 01 03 16 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00",
        values(
            None,
            Motion.UNKNOWN,
            Door.UNKNOWN,
            Mode.FIRE,
            flags(fire=True),
            unknown={"motion": 0, "door.front": 0, "mode": 0},
        ),
    ),
)

PEOPLE_AT_L1 = "00 00 00 19 01 03 16 00 64 00 01 00 01 00 01 00 01 00 05 00 00 00 00 00 00 00 00 00 00"
ROBOT_AT_L1 = "00 00 00 19 01 03 16 00 65 00 01 00 01 00 01 00 02 00 07 00 00 00 00 00 00 00 00 00 00"
ROBOT_AT_L1_OPEN = "00 00 00 19 01 03 16 00 66 00 01 00 01 00 03 00 02 00 07 00 00 00 00 00 00 00 00 00 00"
ROBOT_AT_L1_STILL_OPEN = "00 00 00 19 01 03 16 00 6B 00 01 00 01 00 03 00 02 00 07 00 00 00 00 00 00 00 00 00 00"
ROBOT_AT_L1_CLOSING = "00 00 00 19 01 03 16 00 67 00 01 00 01 00 04 00 02 00 07 00 00 00 00 00 00 00 00 00 00"
CALLED_TO_L2 = "00 00 00 19 01 03 16 00 68 00 01 00 01 00 01 00 02 00 07 00 02 00 02 00 01 00 02 00 02"
CALLED_TO_B1 = "00 00 00 19 01 03 16 00 6A 00 01 00 01 00 01 00 02 00 07 FF FF FF FF 00 00 00 01 00 00"

READ = "00 00 00 06 01 03 00 10 00 07"
READS_NOTHING = "00 00 00 11 01 03 0E 00 00 00 00 00 00 00 00 00 00 00 00 00 00"
READS_HOLD = "00 00 00 11 01 03 0E 00 00 00 00 00 00 00 00 00 01 00 00 00 00"
"""Owner and epoch were taken out."""

WRITTEN = "00 00 00 06 01 10 00 10 00 07"
"""FC16 echoes address 16 and quantity 7."""
CALL_L2 = "00 00 00 15 01 10 00 10 00 07 0E 00 00 00 00 00 01 00 02 00 00 00 00 00 00"
NOTHING = "00 00 00 15 01 10 00 10 00 07 0E 00 00 00 00 00 01 00 00 00 00 00 00 00 00"
HOLD = "00 00 00 15 01 10 00 10 00 07 0E 00 00 00 00 00 01 00 00 00 01 00 00 00 00"
MODE = "00 00 00 15 01 10 00 10 00 07 0E 00 00 00 00 00 01 00 00 00 00 00 01 00 00"
CLOSE = "00 00 00 15 01 10 00 10 00 07 0E 00 00 00 00 00 01 00 00 00 00 00 00 00 01"
CALL_B1 = "00 00 00 15 01 10 00 10 00 07 0E 00 00 00 00 00 01 FF FF 00 00 00 00 00 00"

DOES = (
    Does(
        "call L2, shown by the accepted call",
        Command(CommandKind.GO_TO, "L2"),
        ROBOT_AT_L1,
        CALLED_TO_L2,
        Proof.LAMP,
        (
            Exchange(0.0, CALL_L2, WRITTEN),
            Exchange(0.5, NOTHING, WRITTEN),
            Exchange(0.5, READ, READS_NOTHING),
        ),
    ),
    Does(
        "call the basement: -1 is FFFF",
        Command(CommandKind.GO_TO, "B1"),
        ROBOT_AT_L1,
        CALLED_TO_B1,
        Proof.LAMP,
        (
            Exchange(0.0, CALL_B1, WRITTEN),
            Exchange(0.5, NOTHING, WRITTEN),
            Exchange(0.5, READ, READS_NOTHING),
        ),
    ),
    Does(
        "hold the door",
        Command(CommandKind.HOLD_DOOR, side=Side.FRONT),
        ROBOT_AT_L1_OPEN,
        ROBOT_AT_L1_STILL_OPEN,
        None,
        (
            Exchange(0.0, HOLD, WRITTEN),
            Exchange(0.0, READ, READS_HOLD),
            Exchange(1.0, READ, READS_HOLD),
            Exchange(1.0, HOLD, WRITTEN),
            Exchange(1.5, NOTHING, WRITTEN),
            Exchange(1.5, READ, READS_NOTHING),
        ),
        let_go_s=1.5,
    ),
    Does(
        "ask for robot mode",
        Command(CommandKind.ROBOT_MODE),
        PEOPLE_AT_L1,
        ROBOT_AT_L1,
        None,
        (
            Exchange(0.0, MODE, WRITTEN),
            Exchange(1.0, MODE, WRITTEN),
            Exchange(1.5, NOTHING, WRITTEN),
            Exchange(1.5, READ, READS_NOTHING),
        ),
        let_go_s=1.5,
    ),
    Does(
        "press the close button",
        Command(CommandKind.CLOSE_DOOR, side=Side.FRONT),
        ROBOT_AT_L1_OPEN,
        ROBOT_AT_L1_CLOSING,
        Proof.EFFECT,
        (
            Exchange(0.0, CLOSE, WRITTEN),
            Exchange(0.5, NOTHING, WRITTEN),
            Exchange(0.5, READ, READS_NOTHING),
        ),
    ),
)

POLL = "00 00 00 06 01 03 00 00 00 0B"
"""FC03 at 0, eleven registers."""

# Beats and times as in generic-registers. Machine 1 has epoch 00010002, machine 2 the one before and the one after it.
FACE = (
    Face(
        0.0,
        "idle in the basement, in service for people, and nobody obeyed yet",
        POLL,
        "00 00 00 19 01 03 16 00 00 FF FF 00 01 00 01 00 01 00 05 00 00 00 00 00 00 00 00 00 00",
    ),
    Face(
        0.0,
        "robot mode is asked for by machine 1",
        "00 00 00 15 01 10 00 10 00 07 0E 00 01 00 01 00 02 00 00 00 00 00 01 00 00",
        WRITTEN,
    ),
    Face(
        1.0,
        "and granted; its epoch and its number are shown",
        POLL,
        "00 00 00 19 01 03 16 00 02 FF FF 00 01 00 01 00 02 00 07 00 00 00 00 00 01 00 02 00 01",
    ),
    Face(
        1.0,
        "L1 is called",
        "00 00 00 15 01 10 00 10 00 07 0E 00 01 00 01 00 02 00 01 00 00 00 01 00 00",
        WRITTEN,
    ),
    Face(
        1.5,
        "the call is let go",
        "00 00 00 15 01 10 00 10 00 07 0E 00 01 00 01 00 02 00 00 00 00 00 01 00 00",
        WRITTEN,
    ),
    Face(
        2.0,
        "what machine 2 wrote in the epoch before arrives late, and would end it all",
        "00 00 00 15 01 10 00 10 00 07 0E 00 02 00 01 00 01 00 00 00 00 00 00 00 00",
        WRITTEN,
    ),
    Face(
        2.5,
        "it goes up to 1 in robot mode, for machine 1",
        POLL,
        "00 00 00 19 01 03 16 00 05 FF FF 00 02 00 01 00 02 00 03 00 01 00 01 00 01 00 02 00 01",
    ),
    Face(
        7.0,
        "at L1, level; the door opens and the call is served",
        POLL,
        "00 00 00 19 01 03 16 00 0E 00 01 00 01 00 02 00 02 00 07 00 00 00 00 00 01 00 02 00 01",
    ),
    Face(
        7.0,
        "machine 2 takes over in the next epoch, and holds the door",
        "00 00 00 15 01 10 00 10 00 07 0E 00 02 00 01 00 03 00 00 00 01 00 01 00 00",
        WRITTEN,
    ),
    Face(
        7.5,
        "machine 1 claims the same epoch, and wants nothing",
        "00 00 00 15 01 10 00 10 00 07 0E 00 01 00 01 00 03 00 00 00 00 00 00 00 00",
        WRITTEN,
    ),
    Face(
        8.0,
        "somebody without an epoch lets the door go",
        "00 00 00 06 01 06 00 14 00 00",
        "00 00 00 06 01 06 00 14 00 00",
    ),
    Face(
        14.9,
        "open; the hold outlasts silence up to 8 s",
        POLL,
        "00 00 00 19 01 03 16 00 1D 00 01 00 01 00 03 00 02 00 07 00 00 00 00 00 01 00 03 00 02",
    ),
    Face(
        16.0,
        "after 8 s without a write that it obeys robot mode and hold have fallen; the dwell begins",
        POLL,
        "00 00 00 19 01 03 16 00 20 00 01 00 01 00 03 00 01 00 05 00 00 00 00 00 01 00 03 00 02",
    ),
    Face(
        16.0,
        "the outputs still say what was obeyed, without owner and epoch",
        READ,
        "00 00 00 11 01 03 0E 00 00 00 00 00 00 00 00 00 01 00 01 00 00",
    ),
    # What it does not serve.
    Face(16.0, "register 11 is in the gap: exception 02", "00 00 00 06 01 03 00 0B 00 01", "00 00 00 03 01 83 02"),
    Face(16.0, "and a write behind the block", "00 00 00 06 01 06 00 17 00 01", "00 00 00 03 01 86 02"),
    Face(16.0, "it has no coils: exception 01", "00 00 00 06 01 05 00 00 FF 00", "00 00 00 03 01 85 01"),
)

GENERIC_REGISTERS_CLUSTER = Golden(
    map_name="generic-registers-cluster",
    floors={"B1": -1, "L1": 1, "L2": 2},
    poll=POLL,
    takes_over=((READ, READS_NOTHING),),
    says=SAYS,
    does=DOES,
    key="normal",
    face=FACE,
)
