"""Command lines that begin quickly: what a command needs is imported when that command runs."""

import sys
from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Annotated, Any

import typer
from typer.core import TyperCommand

from chassis.refusal import LOOK, ExitStatus, Group, app_of


def lazy_app(
    about: str, commands: Mapping[str, tuple[str, str]], version: Callable[[], str] | None = None
) -> typer.Typer:
    """A group of commands of which each is imported when it is called.

    Args:
        about: its help text.
        commands: by name, where the function or the app is, such as ``fleet.run.command:run``, and a line of
            help.
        version: what ``--version`` prints; None for a group within another one.
    """

    class Commands(Group):
        def __init__(self, **settings: Any) -> None:
            super().__init__(**settings)
            for name, (_, line) in commands.items():
                self.add_command(TyperCommand(name, help=line))

        def resolve_command(self, ctx: Any, args: list[str]) -> tuple[str | None, Any, list[str]]:
            name, _, rest = super().resolve_command(ctx, args)
            return name, name and _imported(commands[name][0]), rest

    app = typer.Typer(
        cls=Commands,
        help=about,
        no_args_is_help=True,
        add_completion=version is not None,
        pretty_exceptions_enable=False,
        rich_markup_mode=None,
        context_settings=LOOK,
    )
    if version is None:
        app.callback()(lambda: None)
        return app

    def print_version(wanted: bool) -> None:
        if wanted:
            typer.echo(version())
            raise typer.Exit

    @app.callback()
    def _options(
        _version: Annotated[
            bool,
            typer.Option("--version", callback=print_version, is_eager=True, help="Print the version."),
        ] = False,
    ) -> None:
        """Options of the group itself."""

    return app


def _imported(where: str) -> Any:
    module, _, attribute = where.partition(":")
    try:
        target = getattr(import_module(module), attribute)
        return typer.main.get_command(target if isinstance(target, typer.Typer) else app_of(target))
    except KeyboardInterrupt:  # imports take a second, in which Ctrl-C is answered quietly, too
        sys.exit(ExitStatus.UNMET)
