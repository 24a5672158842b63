"""The Open-RMF lift adapter, over DDS or as a node of ROS 2.

`adapter`, `lift_sessions`, `lift_state`, `messages`, `port`, `remote_manager`, `ros_node` and what they import run on Python 3.10 with the
standard library (and rclpy) alone.
"""
