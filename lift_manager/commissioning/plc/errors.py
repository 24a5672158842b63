"""The error of the PLC generator."""

from __future__ import annotations


class ProgramError(Exception):
    """No program can be written for this map or these floors; the message says what to change."""
