"""A camera on the robot's head: draws what would be seen from where the robot is."""
