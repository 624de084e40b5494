"""``python -m twosra_mpc`` is the ``twosra`` program."""

from twosra_mpc.cli import main

if __name__ == "__main__":
    main()
