"""What can be wrong with what a ROS graph sends."""

from common.errors import RetraverseError


class RosDataError(RetraverseError):
    """A sample of a ROS topic that cannot be used; the sentence says why."""
