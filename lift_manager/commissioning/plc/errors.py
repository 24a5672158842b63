"""Why no PLC program can be written for a map; the sentence says what to change."""

from __future__ import annotations


class ProgramError(Exception):
    """This map, or these floors, are not something the program can be written for."""
