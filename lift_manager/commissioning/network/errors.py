"""What can keep network rules from being made."""

from __future__ import annotations


class UnknownHost(Exception):
    """The sentence says why, and what to do."""
