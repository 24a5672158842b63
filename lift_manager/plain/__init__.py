"""What a caller of /api/v1 needs wherever it runs: the standard library alone, and Python 3.10, the one of ROS 2 humble and iron."""
