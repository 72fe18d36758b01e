"""Runs on joints on a bus, real or emulated: what is asked for, one joint or several, figures."""
