class InvalidHandle(Exception):
    pass


class InvalidTopicNameException(Exception):
    pass


class ParameterAlreadyDeclaredException(Exception):
    pass


class ParameterNotDeclaredException(Exception):
    pass


class InvalidParameterTypeException(Exception):
    pass


class RCLError(RuntimeError):
    """rclpy has it in its C++ part only."""
