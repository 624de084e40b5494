"""What the reference says of attributes whose class has no section on them.

That of a file's key is what its JSON Schema says; of a member of an enumeration, the comment beside
it. So both are written once.
"""

from __future__ import annotations

from typing import Any

import griffe

from twosra_mpc.keys import describe

_NOT_SAID = ("model_config", "tag_key", "kinds")  # of no use to who has a record


class Attributes(griffe.Extension):
    """Adds a section on its attributes to the docstring of a class that has none."""

    def on_class(self, *, cls: griffe.Class, **_: Any) -> None:
        """Collect the class's own attributes in the order of the source."""
        if cls.docstring is None or "Attributes:" in cls.docstring.value:
            return
        own = [
            (name, item)
            for name, item in cls.attributes.items()
            if name[0] != "_"
            and name not in _NOT_SAID
            and "property" not in item.labels
            and item.docstring is None
        ]
        if own:
            lines = [f"    {name}: {_words(name, item)}" for name, item in own]
            cls.docstring.value += "\n\nAttributes:\n" + "\n".join(lines)


def _words(name: str, attribute: griffe.Attribute) -> str:
    _, _, comment = attribute.source.splitlines()[0].partition("  # ")
    words = comment.removeprefix("noqa") or describe(name)
    return words[0].upper() + words[1:]
