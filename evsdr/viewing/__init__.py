"""`python -m evsdr.view`: what a file of events holds, and whether it is good, before anything is fitted."""
