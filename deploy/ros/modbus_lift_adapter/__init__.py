"""The ROS package of the lift adapter. The adapter itself is `lift_manager.rmf.ros_node`."""
