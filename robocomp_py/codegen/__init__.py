"""Generates files from models. Templates hold the text; filters hold the logic."""
