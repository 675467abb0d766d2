"""Results as pictures."""

from zpm2.view.overlay import overlay

__all__ = ["overlay"]
