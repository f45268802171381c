"""`report.html`: what a fit found, as one page that needs nothing but a browser."""
