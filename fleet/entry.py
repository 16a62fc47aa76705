"""Where the command ``unspoken`` begins: the imports take a second, in which Ctrl-C is answered too."""


def main() -> None:
    """Run the command line; its exit status is that of the command."""
    try:
        from fleet.cli import app

        app()
    except KeyboardInterrupt:
        raise SystemExit(1) from None
