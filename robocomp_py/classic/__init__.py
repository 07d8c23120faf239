"""Support for RoboComp's own files and code. Other packages use it through entry points only."""
