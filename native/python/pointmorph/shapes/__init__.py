"""Sampled shapes and the features marked on them."""
