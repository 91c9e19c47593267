"""The command line: parses arguments and calls what the widget calls."""

from collections.abc import Sequence


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; returns its exit code.

    Arguments are as on the command line, without the program's name; None takes them from there.
    """
    try:  # imports take a while, and Ctrl-C must work during them
        from napari_splinesketch.cli import terminal

        if arguments is None:
            terminal.take_over()
        from napari_splinesketch.cli.commands import run

        return run(arguments)
    except (Exception, KeyboardInterrupt) as error:
        import sys

        pressed = getattr(sys.modules.get(f"{__name__}.terminal"), "was_interrupted", bool)
        if not isinstance(error, KeyboardInterrupt) and not pressed():
            raise
        if arguments is None:
            import signal

            signal.signal(signal.SIGINT, signal.SIG_IGN)
        told = str(error) if isinstance(error, KeyboardInterrupt) else ""
        print(told or "interrupted", file=sys.stderr)
        return 130
