"""What every caller of /api/v1 needs: standard library only, and Python 3.10 as on ROS 2 humble and iron."""
