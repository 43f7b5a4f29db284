"""The report: what a page is made of, where it reads, and how it is written."""
