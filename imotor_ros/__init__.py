"""Test stand for piezoelectric inertia motors on ROS 2: motor, instruments, evaluation."""

__version__ = "0.1.0"
