"""Images and films, on a disk or behind a URL, read one frame at a time."""
