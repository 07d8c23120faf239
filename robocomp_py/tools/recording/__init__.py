"""Recordings of topics: MCAP files in a folder that is a ROS 2 bag."""
