"""``python -m twosra_mpc`` is the ``twosra`` program."""

# Python has this module when it starts; to load ``signal`` takes 0.5 ms, in which Ctrl-C is loud.
import _signal as signal  # type: ignore[import-not-found]
import gc
import os
import sys

signal.signal(signal.SIGINT, signal.SIG_DFL)  # while there is nothing to lose, and nobody to say it


def main() -> None:
    """Import the commands and run one.

    What a command makes lives as long as its process. So it is rarely searched for what nobody
    needs any more, and not at the end, which takes as long as a plan.
    """
    gc.set_threshold(200_000, 20, 20)
    os.environ["MPLBACKEND"] = "agg"  # whatever a user's windows are: figures are only written
    from twosra_mpc.native_output import separate_native_output

    separate_native_output(shown="--debug" in sys.argv)
    from twosra_mpc.cli import main as run

    signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        run()
    finally:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
        gc.freeze()


if __name__ == "__main__":
    main()
