"""Drives a base along a route, also sideways, and waits while something is in its
way.
"""
