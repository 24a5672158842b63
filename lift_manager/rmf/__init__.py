"""The Open-RMF lift adapter: the contract, the ways to the manager, and the ways to RMF, with ROS and without.

`messages`, `views`, `port`, `contract`, `adapter`, `beside` and `ros_node` run on Python 3.10 with the standard library (and rclpy) alone.
"""
