"""The report of a result: one HTML file that works from disk, without a network."""

from zpm2.view.report.build import files, report

__all__ = ["files", "report"]
