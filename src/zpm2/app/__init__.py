"""`zpm2 app`: a page on this machine on which a person points at a region and sees it in the other photograph."""
