"""Test stand for piezoelectric inertia motors: virtual motor, instruments and evaluation on ROS 2."""

__version__ = "0.1.0"
