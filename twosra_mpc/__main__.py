"""``python -m twosra_mpc`` is the ``twosra`` program."""

import signal

signal.signal(signal.SIGINT, signal.SIG_DFL)  # while there is nothing to lose, and nobody to say it


def main() -> None:
    """Import the commands and run one."""
    from twosra_mpc.cli import main as run

    signal.signal(signal.SIGINT, signal.default_int_handler)
    run()


if __name__ == "__main__":
    main()
