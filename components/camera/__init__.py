"""Draws what a camera on the robot would see."""
