"""RoboComp's old files and code: read, run and written; joined to the rest by entry points only."""
