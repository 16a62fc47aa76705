"""Where the command ``unspoken`` of a device begins, which carries ``agent`` and ``protocol`` only."""


def main() -> None:
    """Run the command line; its exit status is that of the command."""
    try:
        from agent.cli import app

        app()
    except KeyboardInterrupt:
        raise SystemExit(1) from None
