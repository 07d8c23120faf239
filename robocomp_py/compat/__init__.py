"""What components of RoboComp's own generators expect around them, so that their files run as they are."""
