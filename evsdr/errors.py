"""What goes wrong with input, as plain sentences."""


class InputError(Exception):
    """Input that can't be used.

    The message is one plain sentence that names file, field and remedy. The commands print it on
    standard error and exit with 2.
    """


class InputWarning(UserWarning):
    """Input that can be used, with something the user should know; one plain sentence."""
