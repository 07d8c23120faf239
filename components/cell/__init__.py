"""Simulates ../belt.xml: each of its devices is a named instance, with the id of its
node. Simulation, InnerModelManager and SimulationPub are of the simulation itself.
"""
