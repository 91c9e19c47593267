"""Say how far each fitted curve can be trusted."""
