"""Work that is not lost: written down on every change, offered again with the image."""
