"""Find the path that each sketch means."""
