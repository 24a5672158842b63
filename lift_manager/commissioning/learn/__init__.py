"""Learns the registers of an undocumented controller from a ride: survey, recording, analysis, draft map."""
