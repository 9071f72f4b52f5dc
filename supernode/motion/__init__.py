"""Motions in files: what `supernode export` writes of a solution over time.

Read `mcap_file` first: it writes joints, poses and the scene for Foxglove and the like, in the messages of `schemas`.
`robot_messages` adds what belongs to a robot from a URDF; `messages` holds the parts of messages. `text` writes the
same motion as CSV or JSON, and `ros` as a trajectory message of ROS.
"""
