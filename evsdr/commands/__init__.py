"""What is run from a shell: options, tables, sentences."""
