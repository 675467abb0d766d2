"""The command line: one file a command, which parses and calls the package."""

from zpm2.cli.app import main

__all__ = ["main"]
