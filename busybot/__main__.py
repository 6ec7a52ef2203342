"""`python -m busybot` is the command `busybot`."""

from busybot.cli.main import main

if __name__ == "__main__":
    main()
