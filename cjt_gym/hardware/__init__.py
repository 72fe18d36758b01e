"""Runs on real or emulated joints on a bus."""
