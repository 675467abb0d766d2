"""The command line: one file a command, which parses, calls the package and prints."""

from zpm2.cli.app import main

__all__ = ["main"]
