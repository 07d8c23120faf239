"""Sensors: what each of them measures in a scene."""
