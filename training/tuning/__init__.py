"""Tuning: one budgeted search for the gains of every controller, and the files it writes."""
