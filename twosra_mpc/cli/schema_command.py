"""``twosra schema``."""

from __future__ import annotations

import json
from typing import get_args

import click

from twosra_mpc.cli.options import command
from twosra_mpc.cli.output import Output
from twosra_mpc.schema import Subject, json_schema


@command("schema")
@click.argument("subject", type=click.Choice(get_args(Subject)))
def schema_command(subject: Subject, output: Output) -> None:
    """Print the JSON Schema of scenario, robot or plan files: keys, types, ranges, units.

    \b
    Completion and checking while you type, in VS Code with the extension "Even Better TOML":
      twosra schema scenario > scenario.schema.json
    and then, as the first line of your scenario:
      #:schema ./scenario.schema.json
    The same for robots:
      twosra schema robot > robot.schema.json
    For programs that read plans:
      twosra schema plan > plan.schema.json

    For scenarios and plans in JSON, VS Code takes the file in its setting "json.schemas".
    """
    schema = json_schema(subject)
    output.report(lambda: schema, lambda: click.echo(json.dumps(schema, indent=2)))
