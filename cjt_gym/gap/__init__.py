"""Diagnosis of the gap between a recorded joint and its simulation."""
