"""The person of a checkout at a terminal, or behind a pipe."""

from __future__ import annotations

import asyncio
import os
import sys
from collections.abc import Callable
from pathlib import Path

from lift_manager.cli.common import out
from lift_manager.commissioning.checkout.person import Question, Reply
from lift_manager.commissioning.checkout.record import Outcome

if sys.platform != "win32":
    import termios

_LONGEST_LINE = 4096
HELP = (
    "ENTER done, y yes, n no; or end this item: `skip REASON`, `na REASON` (not applicable), `doc REFERENCE` (proved by document),"
    " `fail WHAT`. Beside the answer: `note TEXT`, `photo FILE`, `seen NAME` (a second person saw it). Ctrl-C ends the checkout for now."
)
_ENDS = {
    "skip": Outcome.SKIPPED,
    "na": Outcome.NOT_APPLICABLE,
    "doc": Outcome.DOCUMENT,
    "fail": Outcome.FAILED,
}
_WORDS = {"y": "yes", "n": "no"}


class EndOfInput(Exception):
    """Nobody can answer any more: Ctrl-D, or the terminal was closed."""


class TerminalPerson:
    """Prints questions on stdout and reads answers from stdin."""

    def __init__(self, stream: int) -> None:
        """`stream` is the descriptor that answers come from."""
        self._stream = stream
        self._unread = b""
        self._prompt = ""
        """What waits for an answer."""
        self.actions: dict[str, Callable[[], None]] = dict.fromkeys(("?", "help"), lambda: self.show(HELP))
        """What a line does that is no answer, beside every question."""

    def show(self, text: str) -> None:
        """Print a line, wrapped."""
        out.print(text, markup=False, highlight=False)

    def interrupt(self, text: str) -> None:
        """Print a line that comes while a question waits, and the question again below it."""
        self.show(f"\n{text}" if self._prompt else text)
        self._show_prompt()

    async def answer(self, question: Question) -> Reply:
        """Ask until there is an answer. Raises EndOfInput."""
        notes: list[str] = []
        photos: list[str] = []
        seen_by = ""
        while True:
            line = await self._line(_prompt(question))
            word, _, rest = line.partition(" ")
            rest = rest.strip()
            match word:
                case _ if line in self.actions:
                    self.actions[line]()
                case "note" if rest:
                    notes.append(rest)
                    self.show("kept beside the answer")
                case "seen" if rest:
                    seen_by = rest
                    self.show("kept beside the answer")
                case "photo" if rest:
                    if path := _file(rest):
                        photos.append(path)
                        self.show(f"kept beside the answer: {path}")
                    else:
                        self.show(f"there is no file {rest}")
                case _ if word in _ENDS and (rest or not question.is_text):
                    if rest:
                        note = "; ".join([rest, *notes])
                        return Reply("", _ENDS[word], note, tuple(photos), seen_by)
                    self.show(f"`{word}` needs a few words: `{word} ...`")
                case _:
                    answer = _answer(question, line)
                    if answer is not None:
                        return Reply(answer, None, "; ".join(notes), tuple(photos), seen_by)
                    self.show(
                        f"{' or '.join(question.choices) or 'press ENTER once it is done'}; ? shows what else is possible"
                    )

    async def _line(self, prompt: str) -> str:
        """Print a prompt and return the next line. What was typed before it is discarded at a terminal."""
        self._flush()
        self._prompt = prompt
        self._show_prompt()
        try:
            return await self._next_line()
        finally:
            self._prompt = ""

    def _show_prompt(self) -> None:
        if self._prompt:
            out.print(self._prompt, markup=False, highlight=False, end=" ")
            out.file.flush()

    async def _next_line(self) -> str:
        while b"\n" not in self._unread:
            chunk = await self._read()
            if not chunk:
                self.show("")
                raise EndOfInput
            self._unread += chunk
        line, _, self._unread = self._unread.partition(b"\n")
        return line.decode("utf-8", "replace").strip()

    def _flush(self) -> None:
        if os.isatty(self._stream):
            termios.tcflush(self._stream, termios.TCIFLUSH)
            self._unread = b""

    async def _read(self) -> bytes:
        loop = asyncio.get_running_loop()
        is_ready = asyncio.Event()
        try:
            loop.add_reader(self._stream, is_ready.set)
        except PermissionError:  # a regular file, which is always ready
            return self._read_now()
        try:
            await is_ready.wait()
            return self._read_now()
        finally:
            loop.remove_reader(self._stream)

    def _read_now(self) -> bytes:
        try:
            return os.read(self._stream, _LONGEST_LINE)
        except OSError:  # such as EIO, once the terminal was closed
            return b""


def _file(text: str) -> str:
    """Return the absolute path of a file; empty if there is none."""
    path = Path(text).expanduser()
    return str(path.resolve()) if path.is_file() else ""


def _prompt(question: Question) -> str:
    if question.is_text:
        return f"{question.text} >"
    if question.choices == ("yes", "no"):
        return f"{question.text} [y/n/?]"
    return f"{question.text} [{'/'.join(question.choices) or 'ENTER'}/?]"


def _answer(question: Question, line: str) -> str | None:
    """Return the choice that a line means; None if it means none."""
    if question.is_text:
        return line
    if not question.choices:
        return "" if not line else None
    word = _WORDS.get(line.lower(), line) if "yes" in question.choices else line
    return next((choice for choice in question.choices if choice.lower() == word.lower()), None)
