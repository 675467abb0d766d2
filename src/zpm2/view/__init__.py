"""Results as pictures."""

from zpm2.view.overlay import overlay, unmatched

__all__ = ["overlay", "unmatched"]
