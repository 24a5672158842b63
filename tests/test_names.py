"""Refuse retired names, so that each idea keeps one word in all of the product."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]

CHECKED = ("benchmarks", "drivers", "examples", "lift_manager", "register_maps", "simulator")
"""Folders that must be free of retired names: all of the product."""

RETIRED = {
    # whole names of classes
    "Admission": "Inhibits",
    "Aim": "Target",
    "Around": "a noun for what it holds",
    "Ask": "LiftRequest",
    "Beside": "RemoteManager",
    "Boarding": "Occupancy",
    "Book": "LiftRecord",
    "Carrier": "OutputWorker",
    "Do": "CommandType",
    "Done": "a noun for the result",
    "Followed": "CommandStatus",
    "Gate": "RateLimiter, Authenticator or Inhibits",
    "Inside": "LocalManager",
    "Interlock": "Inhibits",
    "Line": "Queue or Unit",
    "Lines": "Units",
    "Memory": "LiftRecord",
    "Met": "a noun for what was met",
    "Out": "a noun for what goes out",
    "PeopleFirst": "SafetyLatches",
    "PeopleWords": "OperatorActions",
    "Remembered": "LiftRecord",
    "Seeing": "Observation",
    "Seen": "StateInputs",
    "Serving": "a noun for what serves",
    "SessionBook": "SessionHistory",
    "Sheet": "LiftRecord",
    "Shown": "LiftState",
    "Sight": "Observation",
    "Sparing": "RowRateLimiter",
    "Spell": "DiskOutage",
    "Tenure": "Session",
    "Told": "CommandProgress",
    "TurnedAway": "Refused",
    "WaitingLine": "Queue",
    "Want": "LiftRequest",
    "Way": "Link",
    "Who": "Occupancy",
    "Wish": "AuditEntry, RmfDemand or PendingWrite",
    # words of which a name consists, in every case
    "aim": "target",
    "anew": "again, or no word at all",
    "around": "a word for what it does",
    "ask": "request, send",
    "asked": "requested",
    "asks": "requests, sends",
    "beside": "remote, others",
    "errand": "action",
    "gate": "limiter, authenticator, inhibits",
    "hear": "receive",
    "heard": "received",
    "hears": "receives",
    "inside": "local, within",
    "keeper": "owner, store",
    "let_go": "release",
    "letting_go": "releasing",
    "noted": "recorded",
    "not_granted": "grant_missing",
    "owed": "unacknowledged",
    "owes": "unacknowledged",
    "said": "printed, reported",
    "say": "print_line, report",
    "says": "reports",
    "seen": "observed, read",
    "sees": "observes",
    "sight": "observation",
    "spell": "outage",
    "stood_open": "opened_at_target",
    "tale": "report",
    "tell": "report, announce",
    "tells": "reports",
    "tenure": "session",
    "told": "reported, announced, outcome",
    "untold": "unacknowledged",
    "want": "request, need",
    "wanted": "requested, expected",
    "wants": "requests, needs",
    "way": "link, method, direction",
    "ways": "links, methods, directions",
    "wish": "request, demand",
    "wishes": "requests, demands",
}
"""A retired word, and what to use instead. With a capital it is the whole name of a class; else it is part of any name, as in
`was_told`, `WasTold` and `WAS_TOLD`."""

ALLOWED = {
    "AcceptAndSayNothing": "the public name of the fault `accept_and_say_nothing`, in scenarios",
    "NOT_GRANTED": "the member of the public reason `not_granted`, in metrics and journal",
    "SaysWrongFloor": "the public name of the fault `says_wrong_floor`, in scenarios",
    "RmfWantedRequest": "a schema of the public interface",
    "asked_at": "a field of the public interface",
    "let_go_door": "a command of the public interface, and of its client",
    "under_way": "trade term: a car under way",
}
"""Names and parts of names that stay although they hold a retired word, each with its reason. Parts are in lower case."""

ALLOWED_IN = {
    ("lift_manager/lab/scenario/verdict.py", "around"): "a field of the output of `scenario run --json`",
}
"""Names that stay in one file alone, each with its reason."""

_PART = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+")


def parts(name: str) -> str:
    """Return the words of a name without its allowed parts, such as `_was_told_` for `WasTold`."""
    words = f"_{'_'.join(_PART.findall(name)).lower()}_"
    for allowed in ALLOWED:
        words = words.replace(f"_{allowed}_", "__")
    return words


def instead_of(name: str, *, is_class: bool = False) -> str | None:
    """Return what to use instead of a retired name; None for a good one."""
    if name in ALLOWED:
        return None
    if is_class and (instead := RETIRED.get(name.strip("_"))) is not None:
        return instead
    words = parts(name)
    return next((new for old, new in RETIRED.items() if old.islower() and f"_{old}_" in words), None)


def names(tree: ast.Module) -> Iterator[tuple[int, str, bool]]:
    """Yield (line, name, whether it is a class) of each class, function, parameter, attribute and constant that a module defines."""
    for node in ast.walk(tree):
        match node:
            case ast.ClassDef():
                yield node.lineno, node.name, True
            case ast.FunctionDef() | ast.AsyncFunctionDef():
                yield node.lineno, node.name, False
            case ast.arg():
                yield node.lineno, node.arg, False
            case ast.Attribute(ctx=ast.Store()):
                yield node.lineno, node.attr, False
            case _:
                pass
        if isinstance(node, ast.Module | ast.ClassDef):
            for statement in node.body:
                targets = (
                    statement.targets if isinstance(statement, ast.Assign) else [getattr(statement, "target", None)]
                )
                yield from ((target.lineno, target.id, False) for target in targets if isinstance(target, ast.Name))


def retired_names(path: Path, text: str) -> Iterator[str]:
    """Yield a line about each retired name that a file defines, its own name included."""
    if (instead := instead_of(path.stem)) is not None:
        yield f"{path}: module {path.stem}: use {instead}"
    for line, name, is_class in sorted(set(names(ast.parse(text)))):
        if (path.as_posix(), name) in ALLOWED_IN:
            continue
        if (instead := instead_of(name, is_class=is_class)) is not None:
            yield f"{path}:{line}: {name}: use {instead}"


def test_no_name_of_the_product_is_retired() -> None:
    found = [
        line
        for folder in CHECKED
        for path in sorted((ROOT / folder).rglob("*.py"))
        for line in retired_names(path.relative_to(ROOT), path.read_text("utf-8"))
    ]
    assert not found, "\n".join(found)


def test_a_retired_name_is_refused_wherever_it_is_defined() -> None:
    text = """
WAS_TOLD = 1
class Wish:
    heard: int
    def __init__(self, asked): self._says = asked
def let_go(): ...
class Gated: floor_under_way = 1
NOT_GRANTED = 1
"""
    assert list(retired_names(Path("anew/tell_all.py"), text)) == [
        "anew/tell_all.py: module tell_all: use report, announce",
        "anew/tell_all.py:2: WAS_TOLD: use reported, announced, outcome",
        "anew/tell_all.py:3: Wish: use AuditEntry, RmfDemand or PendingWrite",
        "anew/tell_all.py:4: heard: use received",
        "anew/tell_all.py:5: _says: use reports",
        "anew/tell_all.py:5: asked: use requested",
        "anew/tell_all.py:6: let_go: use release",
    ]


def test_a_name_that_stays_in_one_file_is_refused_in_others() -> None:
    (allowed, name), *_ = ALLOWED_IN
    assert list(retired_names(Path(allowed), f"{name} = 1")) == []
    assert list(retired_names(Path("other.py"), f"{name} = 1")) == [f"other.py:1: {name}: use {RETIRED[name]}"]
