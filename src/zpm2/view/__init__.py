"""Results as pictures, and as a page (`view.report`)."""

from zpm2.view.overlay import overlay, unmatched

__all__ = ["overlay", "unmatched"]
