"""Shapes and morph objects in the scene."""
