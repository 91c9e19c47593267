"""Work on many tasks: in other processes on this machine, or on a cluster."""
