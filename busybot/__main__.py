"""The command `busybot`, also as `python -m busybot`."""

import atexit
import gc
import sys


def main() -> None:
    """Entry of the console script: exits 0 when done, 1 when input or environment is at fault, 2 on wrong usage.

    The command line is imported here, so that Ctrl-C ends the imports as quietly as everything later.
    """
    # else Python ends by searching all that PyTorch has made for cycles to free, which takes most of a second
    atexit.register(gc.freeze)
    try:
        from busybot.cli.main import run

        run()
    except KeyboardInterrupt:
        sys.exit(130)


if __name__ == "__main__":
    main()
