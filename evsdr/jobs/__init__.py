"""Many fits: rows of a table, each in a process of its own, on one machine or many."""
