"""What can keep network rules from being made."""

from __future__ import annotations


class NetworkRefused(Exception):
    """The sentence says why, and what to do."""
