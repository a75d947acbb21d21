"""
What each part of the stand does with blocks, without ROS: one module per role.

The nodes and the in-process bench both call these, so that the same program and the same seed
give the same samples on either. Nothing is imported here: a node loads only its own role.
"""
