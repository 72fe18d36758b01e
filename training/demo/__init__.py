"""The demonstration, and the real drive that it replays."""
