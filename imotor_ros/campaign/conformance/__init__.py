"""What a driver has to do, checked on records of what it did; without ROS."""
