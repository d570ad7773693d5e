"""`python -m benchmarks NAME`, in a clone: measure this machine, or repeat a study."""

from __future__ import annotations

import importlib
import json
import sys

import click

from benchmarks.catalogue import BENCHMARKS, STUDIES, as_lines, run
from geoprior.errors import GeopriorError


class Catalogue(click.Group):
    """Commands by name, imported when they are wanted."""

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002 - click's signature
        """Benchmarks first, then studies."""
        return [*BENCHMARKS, *STUDIES]

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:  # noqa: ARG002
        """A benchmark has options of its own; a study reads its arguments itself."""
        if cmd_name in BENCHMARKS:
            return _benchmark(cmd_name)
        return _study(cmd_name) if cmd_name in STUDIES else None


@click.command(
    cls=Catalogue,
    epilog="Those from generate to demos take --quick and --json; the others have a --help of their own.",
)
def main() -> None:
    """Measure this machine, or repeat a study of docs/benchmarks.md.

    Leave the machine alone meanwhile where speed is measured: whatever else runs is measured too.
    """


def _benchmark(name: str) -> click.Command:
    @click.command(name, help=BENCHMARKS[name].summary, short_help=BENCHMARKS[name].summary)
    @click.option("--quick", is_flag=True, help="Less data, no goals: does it work, and about how fast?")
    @click.option("--json", "as_json", is_flag=True, help="Print one object: machine, versions, results.")
    def command(quick: bool, as_json: bool) -> None:  # noqa: FBT001 - click gives flags by keyword
        content = run(name, quick=quick, say=lambda line: click.echo(line, err=True))
        click.echo(json.dumps(content, indent=2) if as_json else "\n".join(as_lines(content)))

    return command


def _study(name: str) -> click.Command:
    @click.command(
        name,
        short_help=STUDIES[name],
        add_help_option=False,
        context_settings={"ignore_unknown_options": True, "allow_extra_args": True},
    )
    @click.argument("arguments", nargs=-1, type=click.UNPROCESSED)
    def command(arguments: tuple[str, ...]) -> None:
        sys.argv = [f"python -m benchmarks {name}", *arguments]
        importlib.import_module(f"benchmarks.{name}").main()

    return command


if __name__ == "__main__":
    try:
        main()
    except GeopriorError as error:
        click.echo(f"error: {error.message}", err=True)
        if error.hint:
            click.echo(f"    {error.hint}", err=True)
        sys.exit(error.exit_code)
